"""Caches that are missing, damaged, foreign or no caches: never run, never in the way."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.arms import chosen

from spacearm.compiler import kernel, machine
from spacearm.compiler.kernel import compiled


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Return the folder of an empty cache, in which no kernel is compiled a second time."""
    monkeypatch.setattr(kernel, "SECONDS_A_LINE", 1e9)
    monkeypatch.setenv("SPACEARM_CACHE", str(tmp_path))
    return tmp_path / "code"


def works():
    """Compile a function and compare it with NumPy."""
    x = np.arange(1.0, 6.0)
    found = compiled(lambda x: np.sin(x) / x, {"x": ()})({"x": x})
    np.testing.assert_allclose(found, np.sin(x) / x, rtol=1e-15, atol=1e-15)


def test_what_is_kept_is_the_users_alone_and_used_again(cache, monkeypatch):
    works()
    (file,) = cache.iterdir()
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    monkeypatch.setattr(machine, "keep", None)  # nothing is kept again
    works()


def test_the_oldest_go_when_there_are_too_many(cache, monkeypatch):
    monkeypatch.setattr(machine, "MOST", 3)
    for i in range(5):
        machine.keep(f"name{i}", b"code")
        os.utime(cache / f"name{i}", (i, i))
    assert sorted(file.name for file in cache.iterdir()) == ["name2", "name3", "name4"]


def broken(data, how):
    """Return a file damaged."""
    if how == "empty":
        return b""
    if how == "short":
        return data[: len(data) // 2]
    if how == "checksum":
        return bytes([data[0] ^ 1]) + data[1:]
    if how == "no code":
        return data[:32]
    at = len(data) // 2
    return data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :]


@pytest.mark.parametrize("how", ["empty", "short", "checksum", "no code", "bit"])
def test_what_is_damaged_is_compiled_anew(cache, how):
    works()
    (file,) = cache.iterdir()
    sound = file.read_bytes()
    file.write_bytes(broken(sound, how))
    assert machine.kept(file.name) is None
    works()
    assert file.read_bytes() == sound


@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_what_others_can_write_to_is_not_run(cache, mode):
    works()
    (file,) = cache.iterdir()
    assert machine.kept(file.name) is not None
    file.chmod(mode)
    assert machine.kept(file.name) is None
    works()
    file.chmod(0o600)
    cache.chmod(0o770)
    assert machine.folder() is None
    works()


def test_what_belongs_to_others_is_not_run(cache, monkeypatch):
    works()
    (file,) = cache.iterdir()
    monkeypatch.setattr(os, "getuid", lambda: file.stat().st_uid + 1)
    assert machine.folder() is None
    assert machine.kept(file.name) is None
    works()


def test_links_pipes_and_folders_in_place_of_files_are_no_trap(cache):
    works()
    (file,) = cache.iterdir()
    elsewhere = cache.parent / "elsewhere"
    for put in (
        lambda: file.symlink_to(elsewhere),
        lambda: os.mkfifo(file, 0o600),
        file.mkdir,
        lambda: file.symlink_to(file),
    ):
        file.rmdir() if file.is_dir() else file.unlink(missing_ok=True)
        works()
        file.rename(elsewhere)
        put()
        assert machine.kept(file.name) is None
        works()


def test_a_link_in_place_of_the_folder_is_no_cache(cache, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    cache.symlink_to(other)
    works()
    assert not [*other.iterdir()]


@pytest.mark.parametrize("place", ["", "/proc/nothing", "/dev/null", "a\0b"])
def test_where_nothing_can_be_kept_all_is_compiled(place, monkeypatch):
    monkeypatch.setattr(os, "environ", {**os.environ, "SPACEARM_CACHE": place})
    assert machine.folder() is None
    works()


def test_a_folder_that_cannot_be_written_to_is_tried_once(cache, monkeypatch):
    cache.mkdir(mode=0o500)
    tried = []

    def full(*_, **__):
        tried.append(machine.folder())
        raise OSError("no space left")

    monkeypatch.setattr(machine.tempfile, "mkstemp", full)
    works()
    assert tried == [cache]
    assert not [*cache.iterdir()]


def test_a_disk_that_fills_leaves_nothing_behind(cache, monkeypatch):
    def full(*_):
        raise OSError("no space left")

    monkeypatch.setattr(Path, "replace", full)
    works()
    assert not [*cache.iterdir()]


@pytest.mark.parametrize(
    ("variables", "place"),
    [
        ({"HOME": "{tmp}/file"}, None),
        ({"HOME": "{tmp}"}, ".cache/spacearm/code"),
        ({"HOME": "{tmp}", "XDG_CACHE_HOME": "{tmp}/x"}, "x/spacearm/code"),
        ({"HOME": "{tmp}", "XDG_CACHE_HOME": "relative"}, ".cache/spacearm/code"),
        ({"HOME": "{tmp}", "XDG_CACHE_HOME": ""}, ".cache/spacearm/code"),
    ],
)
@pytest.mark.skipif(sys.platform == "darwin", reason="the folder is another")
def test_the_folder_is_the_users(variables, place, tmp_path, monkeypatch):
    for name in ("SPACEARM_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value.format(tmp=tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert machine.folder() == (tmp_path / place if place else None)


def test_without_home_the_folder_is_that_of_the_account(monkeypatch):
    for name in ("SPACEARM_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(machine.Path, "mkdir", lambda *_, **__: None)
    machine.folder()


PLAIN = """
import sys
import numpy as np
from spacearm.compiler import kernel, machine
from spacearm.compiler.kernel import compiled
kernel = compiled(
    lambda x: (np.sin(x[0]) * x[1] + x[2] / x[0], np.minimum(x[1], np.floor(x[2]))), {"x": (3,)}
)
assert machine.processor() == ("x86-64", "") and kernel.lanes == 2
found = kernel({"x": np.random.default_rng(0).uniform(0.1, 1, (9, 3))})
np.save(sys.argv[1], np.array(found))
"""


@pytest.mark.skipif(machine.processor()[0].startswith("apple"), reason="another kind of processor")
def test_a_plain_processor_gives_the_same_to_rounding(tmp_path):
    import platform

    if platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("another kind of processor")
    environment = os.environ | {"SPACEARM_CPU": "x86-64", "SPACEARM_CACHE": str(tmp_path)}
    command = [sys.executable, "-c", PLAIN, str(tmp_path / "found.npy")]
    subprocess.run(command, env=environment, check=True)
    x = chosen(0).uniform(0.1, 1, (9, 3))
    expected = np.sin(x[:, 0]) * x[:, 1] + x[:, 2] / x[:, 0], np.minimum(x[:, 1], 0.0)
    np.testing.assert_allclose(np.load(tmp_path / "found.npy"), expected, rtol=1e-15, atol=1e-15)
