"""Stores that are removed, moved or damaged, and disks that are full, while a sweep runs."""

import errno
import itertools
import os
import shutil
import signal
import subprocess
import sys
import threading
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers.sweeps import files, run, start, wait_for_chunks

import spacearm as sa
from spacearm.sweeps.runner import do, run_chunks
from spacearm.sweeps.store import dataset

pytest.importorskip("zarr")  # which needs Python 3.11


@pytest.fixture
def here(monkeypatch):
    """Workers of this process; what stands in `here` is called before a chunk is read back."""
    before = []

    class Here:
        width, lost, final = 1, False, ()

        def __init__(self, study, store, *_):
            self.given = study.recipe, str(store.path)

        def submit(self, work, chunk):
            future = Future()
            if work is not do and before:
                before.pop()()
            try:
                future.set_result(work(*self.given, chunk))
            except Exception as error:
                future.set_exception(error)
            return future

        def close(self):
            pass

    monkeypatch.setattr(sys.modules["spacearm.sweeps.runner"], "_workers", Here)
    return before


LOST = {
    "removed": lambda store: shutil.rmtree(store),
    "moved": lambda store: store.rename(store.with_name("moved")),
    "replaced": lambda store: (
        store.rename(store.with_name("moved")),
        shutil.copytree(store.with_name("moved"), store),
    ),
    "beheaded": lambda store: (store / "zarr.json").unlink(),
    "without an array": lambda store: shutil.rmtree(store / "sigma_min"),
    "without the marks": lambda store: shutil.rmtree(store / "chunks"),
}
THINNED = {
    "a chunk": lambda store: (store / "sigma_min/c/0/0/0").unlink(),
    "a mark": lambda store: (store / "chunks/sigma_min/c/0").unlink(),
    "the end of a chunk": lambda store: os.truncate(store / "sigma_min/c/0/0/0", 9),
    "all chunks": lambda store: shutil.rmtree(store / "sigma_min/c"),
}


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("how", LOST)
def test_a_store_that_is_lost_is_an_error_at_once(small, tmp_path, how):
    store, done = tmp_path / "s.zarr", []

    def lose(tally, _):
        done.append(tally)
        LOST[how](store)

    with pytest.raises(sa.StoreError, match=rf"store {store}") as caught:
        sa.sweep(small, store, progress=lose)
    assert done == [1]
    assert "again" in str(caught.value)
    assert store.exists() == (how not in ("removed", "moved")), "it does not come back as a part"


@pytest.mark.parametrize("how", [*LOST, *THINNED])
def test_success_is_what_the_store_holds_in_the_end(small, sound, tmp_path, here, how):
    store = tmp_path / "s.zarr"
    here.append(lambda: (LOST | THINNED)[how](store))
    with pytest.raises(sa.StoreError, match=rf"store {store}") as caught:
        sa.sweep(small, store)
    if how in THINNED:
        assert "of 2 chunks were done and are missing or damaged now (sigma_min 0" in str(
            caught.value
        )
        assert sa.sweep(small, store).identical(dataset(sound, small))
        assert files(store) == files(sound)


@pytest.mark.parametrize("label", ["base_inertia", "chunks/zarr.json", "sigma_min/zarr.json"])
@pytest.mark.usefixtures("here")
def test_labels_and_descriptions_that_are_lost_are_written_again(small, sound, tmp_path, label):
    store = tmp_path / "s.zarr"
    for _ in run_chunks(small, store):
        lost = store / label
        if lost.is_dir():
            shutil.rmtree(lost)
        elif lost.exists():
            lost.unlink()
    assert files(store) == files(sound)


MAIN = threading.main_thread()
CALLS = ("fsync", "replace", "rename", "mkdir")


@contextmanager
def failing(number, error):
    """Have the call of the system with this number raise an error; yield the calls so far.

    Ctrl-C comes in the main thread, where Zarr does not write.
    """
    made = []

    def counted(name, call):
        def run(*args, **options):
            if isinstance(error, KeyboardInterrupt) and threading.current_thread() is not MAIN:
                return call(*args, **options)
            made.append(name)
            if len(made) == number:
                raise error
            return call(*args, **options)

        return run

    with pytest.MonkeyPatch.context() as patch:
        for name in CALLS:
            patch.setattr(os, name, counted(name, getattr(os, name)))
        yield made


@pytest.mark.usefixtures("here")
@pytest.mark.slow
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), KeyboardInterrupt()])
def test_an_error_at_any_point_leaves_a_store_to_go_on_with(small, sound, tmp_path, error):
    for number in itertools.count(1):
        store = tmp_path / str(number) / "s.zarr"
        raised = None
        with failing(number, error) as made:
            try:
                sa.sweep(small, store)
            except (sa.StoreError, KeyboardInterrupt) as caught:
                raised = caught
        found = [path.name for path in (tmp_path / str(number)).rglob("*")]
        assert not [name for name in found if "partial" in name], made
        if raised is not None:
            assert raised is error or "No space left" in str(raised)
            sa.sweep(small, store)
        assert files(store) == files(sound)
        if number > len(made):
            break
    assert number > 10


@pytest.mark.usefixtures("here")
def test_each_file_is_flushed_before_it_is_renamed(small, tmp_path, monkeypatch):
    store, flushed = tmp_path / "s.zarr", set()
    replace, fsync = Path.replace, os.fsync

    def remember(number):
        flushed.add(os.fstat(number).st_ino)
        fsync(number)

    def checked(source, target):
        if store in Path(target).parents:
            assert source.stat().st_ino in flushed
        return replace(source, target)

    monkeypatch.setattr(os, "fsync", remember)
    monkeypatch.setattr(Path, "replace", checked)
    sa.sweep(small, store)
    for path in store.rglob("*"):
        assert path.stat().st_ino in flushed, path


@pytest.mark.slow
@pytest.mark.parametrize("how", ["removed", "moved", "thinned"])
def test_the_command_does_not_succeed_without_its_store(study_file, whole, tmp_path, how):
    store, moved = tmp_path / "s.zarr", tmp_path / "moved.zarr"
    process = start(study_file, store, "--workers", "2")
    wait_for_chunks(store)
    if how == "removed":
        shutil.rmtree(store, ignore_errors=True)  # workers still write
        shutil.rmtree(store, ignore_errors=True)
    elif how == "moved":
        store.rename(moved)
    else:
        next((store / "near").rglob("c/*/*/*/*")).unlink()
    _, err = process.communicate(timeout=300)
    assert process.returncode == 2, err
    assert f"store {store}" in " ".join(err.split())
    assert "Traceback" not in err
    if how == "thinned":
        assert "were done and are missing or damaged now (risk " in err
        moved = store
    else:
        assert not store.exists()
    code, _, err = run(study_file, moved, "--workers", "2")
    assert code == 0, err
    assert files(moved) == files(whole)


SWEEP = """
import sys, spacearm as sa
try:
    sa.sweep(sys.argv[1], sys.argv[2], workers=2)
except KeyboardInterrupt:
    print("KeyboardInterrupt")
"""


@pytest.mark.slow
@pytest.mark.parametrize("after", [0, 1, 2, 5, 20, 60])
def test_ctrl_c_is_a_keyboard_interrupt(study_file, tmp_path, after):
    store = tmp_path / "s.zarr"
    process = subprocess.Popen(
        [sys.executable, "-c", SWEEP, study_file, store],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    wait_for_chunks(store, after)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert (out, err) == ("KeyboardInterrupt\n", "")
    assert not [*tmp_path.rglob("*.partial")]
