"""Files that are read and written: regular ones, up to a size."""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa
from spacearm import files
from spacearm.cli.workspaces import _points

TEXTS = [sa.load, _points, *([sa.Study.read] if sys.version_info >= (3, 11) else [])]
LOADERS = [*TEXTS, lambda path: sa.Trajectory.load(path, sa.load("planar2"))]
"""What reads a file of the user."""


@pytest.mark.parametrize("load", LOADERS)
def test_devices_and_pipes_are_not_read(tmp_path, load):
    os.mkfifo(tmp_path / "pipe")
    for path in (Path("/dev/zero"), tmp_path / "pipe"):
        with pytest.raises(sa.SpaceArmError, match="a device or a pipe; save what it gives"):
            load(path)


def test_what_calls_itself_a_file_and_has_nothing_to_give_is_not_waited_for(tmp_path, monkeypatch):
    """As /proc/kmsg does."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    monkeypatch.setattr(files.stat, "S_ISREG", lambda _: True)
    writer = os.open(pipe, os.O_RDWR)
    with pytest.raises(OSError, match="a device or a pipe"):
        files.read(pipe)
    os.close(writer)


@pytest.mark.parametrize("load", TEXTS)
def test_no_more_is_read_than_a_person_writes(tmp_path, load):
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(files.LARGEST_TEXT + 1)
    with pytest.raises(sa.SpaceArmError, match=r"larger than (1|10) MB"):
        load(path)
    with path.open("wb") as file:
        file.truncate(files.LARGEST_TEXT)
    assert files.read(path) == bytes(files.LARGEST_TEXT)


@pytest.mark.parametrize("load", LOADERS)
def test_folders_and_missing_files_are_named(tmp_path, load):
    for path in (tmp_path, tmp_path / "missing"):
        with pytest.raises(sa.SpaceArmError, match=str(path)):
            load(path)


def test_devices_pipes_and_folders_are_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path):
        with pytest.raises(sa.SpaceArmError, match="not a regular file"):
            files.write(path, b"content")
    assert (tmp_path / "pipe").is_fifo()
    assert [p.name for p in tmp_path.iterdir()] == ["pipe"]


@pytest.mark.parametrize(("mask", "mode"), [(0o077, 0o600), (0o022, 0o644), (0o002, 0o664)])
def test_the_umask_says_who_may_read_a_new_file(tmp_path, mask, mode):
    before = os.umask(mask)
    try:
        files.write(tmp_path / "new", b"content")
    finally:
        os.umask(before)
    assert (tmp_path / "new").stat().st_mode & 0o777 == mode


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o755])
def test_a_file_that_is_replaced_keeps_its_permissions(tmp_path, mode):
    path = tmp_path / "kept"
    path.write_bytes(b"old")
    path.chmod(mode)
    files.write(path, b"new")
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == mode


@pytest.mark.parametrize("there", [True, False])
def test_a_link_stays_and_what_it_leads_to_is_written(tmp_path, there):
    real, link = tmp_path / "folder" / "real", tmp_path / "link"
    real.parent.mkdir()
    if there:
        real.write_bytes(b"old")
    link.symlink_to(real)
    files.write(link, b"new")
    assert link.is_symlink()
    assert real.read_bytes() == b"new"
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["folder", "link", "real"]


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("kept")
    for write_it in (
        lambda path: files.write(path, b"x"),
        lambda path: files.write_folder(path, lambda _: None, ".mark"),
    ):
        with pytest.raises(sa.SpaceArmError, match="cannot be written: Not a directory"):
            write_it(tmp_path / "file" / "new")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["kept"]


def test_nothing_is_left_of_what_cannot_be_written(tmp_path):
    for path in (tmp_path / "nul\0", tmp_path / ("x" * 300), tmp_path / "none" / "file"):
        with pytest.raises(sa.SpaceArmError, match="cannot be written"):
            files.write(path, b"content")
    with pytest.raises(TypeError):
        files.write(tmp_path / "text", "no bytes")
    assert not [*tmp_path.iterdir()]


def test_what_cannot_be_written_is_refused_before_and_nothing_is_left_of_what_can(tmp_path):
    kept = tmp_path / "kept"
    kept.write_bytes(b"old")
    for path in (kept, tmp_path / "new"):
        files.writable(path)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"old"]
    for path in (tmp_path, Path("/dev/null"), tmp_path / ("x" * 300), tmp_path / "no" / "file"):
        with pytest.raises(sa.SpaceArmError, match="cannot be written"):
            files.writable(path)


@pytest.mark.slow
@given(st.text(max_size=300))
def test_no_name_leads_to_another_folder(name):
    part = files.name_part(name)
    assert Path(f"{part}_map.png").name == f"{part}_map.png"
    assert part[0] not in ".-"
    assert len(part.encode()) <= 100
    assert files.name_part(part) == part


@pytest.mark.parametrize("name", ["planar2", "ETS-VII_arm.v2", "机械臂"])
def test_sound_names_stay(name):
    assert files.name_part(name) == name
