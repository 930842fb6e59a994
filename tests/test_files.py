"""Files that are read and written: regular ones, up to a size."""

import errno
import itertools
import os
import stat
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress
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


#: Calls by which files are written, besides `write` and `unlink`: of `os`, and of `Path`, whose
#: methods in Python 3.10 do not look for those of `os` when they are called.
CALLS = {os: ("fsync", "link", "fchmod"), Path: ("open", "replace", "rename", "mkdir")}


@contextmanager
def failing(number, error):
    """Have one of the calls in `CALLS` raise an error, the one with this number.

    Yields:
        The names of the calls so far.
    """
    made = []

    def counted(name, call):
        def run(*args, **options):
            made.append(name)
            if len(made) == number:
                raise error
            return call(*args, **options)

        return run

    with pytest.MonkeyPatch.context() as patch:
        for owner, names in CALLS.items():
            for name in names:
                patch.setattr(owner, name, counted(name, getattr(owner, name)))
        yield made


def content_of(folder):
    """What the files below a folder hold."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def write_one(folder):
    files.write(folder / "a", b"new")


def write_two(folder):
    files.write_together({folder / name: files.writing(b"new") for name in "ab"})


def write_marked(folder):
    def fill(made):
        for name in ("mark", "values"):
            (made / name).write_bytes(b"new")

    files.write_folder(folder / "made", fill, "mark")


FULL = OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize(
    ("write_it", "names", "there", "error"),
    [
        (write_one, ["a"], 0, FULL),
        (write_one, ["a"], 1, KeyboardInterrupt()),
        (write_two, ["a", "b"], 0, FULL),
        (write_two, ["a", "b"], 1, FULL),
        (write_two, ["a", "b"], 2, KeyboardInterrupt()),
        (write_marked, ["made/mark", "made/values"], 0, KeyboardInterrupt()),
        (write_marked, ["made/mark", "made/values"], 2, FULL),
    ],
)
def test_an_error_at_any_point_leaves_all_files_as_they_were(
    tmp_path, write_it, names, there, error
):
    old, new = dict.fromkeys(names[:there], b"old"), dict.fromkeys(names, b"new")
    for number in itertools.count(1):
        folder = tmp_path / str(number)
        folder.mkdir()
        for name, content in old.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(content)
        raised = False
        with failing(number, error) as made:
            try:
                write_it(folder)
            except (sa.SpaceArmError, KeyboardInterrupt):
                raised = True
        assert content_of(folder) == (old if raised else new), made
        assert {path.name for path in folder.iterdir()} <= {"a", "b", "made"}, made
        if number > len(made):
            break
    assert not raised
    assert made.count("fsync") >= 2, "the file, and its folder"


def test_files_are_flushed_before_they_are_renamed_and_folders_afterwards(tmp_path, monkeypatch):
    done = []

    def flushed(number):
        done.append("folder" if stat.S_ISDIR(os.fstat(number).st_mode) else "file")

    replace = Path.replace
    monkeypatch.setattr(os, "fsync", flushed)
    monkeypatch.setattr(Path, "replace", lambda *args: done.append("renamed") or replace(*args))
    write_two(tmp_path)
    assert done == ["file", "file", "renamed", "renamed", "folder"]


def test_a_file_system_that_flushes_no_folders_is_one_to_write_to(tmp_path, monkeypatch):
    def refuse(_):
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(os, "fsync", refuse)
    write_two(tmp_path)
    assert content_of(tmp_path) == {"a": b"new", "b": b"new"}


def test_a_file_system_without_hard_links_is_one_to_write_to(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    for number in itertools.count(1):
        for name in "ab":
            (tmp_path / name).write_bytes(b"old")
        raised = False
        with failing(number, FULL) as made:
            try:
                write_two(tmp_path)
            except sa.SpaceArmError:
                raised = True
        assert content_of(tmp_path) == dict.fromkeys("ab", b"old" if raised else b"new")
        if number > len(made):
            break


WRITER = """
import os, sys, time
from pathlib import Path
from spacearm import files

def fill(file):
    file.write(b"half")
    file.flush()
    print("ready", flush=True)
    time.sleep(600)

folder = Path(sys.argv[1])
if sys.argv[2] == "file":
    files.write_by(folder / "killed", fill)
else:
    files.write_folder(folder / "killed", lambda made: fill((made / "mark").open("wb")), "mark")
"""


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_what_a_killed_process_left_is_removed_by_the_next_and_what_is_in_use_stays(tmp_path, kind):
    command = [sys.executable, "-c", WRITER, str(tmp_path), kind]
    writer = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert writer.stdout.readline() == b"ready\n"
    (unfinished,) = tmp_path.iterdir()
    own = tmp_path / "notes.partial"
    own.write_bytes(b"mine")
    files.write(tmp_path / "other", b"new")
    assert unfinished.exists(), "its process still writes"
    writer.kill()
    writer.wait()
    writer.stdout.close()
    assert unfinished.exists()
    files.write(tmp_path / "other", b"newer")
    assert {path.name for path in tmp_path.iterdir()} == {"notes.partial", "other"}


def test_a_folder_that_was_being_replaced_when_its_process_was_killed_is_kept(tmp_path):
    before = tmp_path / f".{'0123abcd' * 4}.partial" / files.BEFORE
    before.mkdir(parents=True)
    files.write(tmp_path / "other", b"new")
    assert before.exists(), "it is the only copy"


def test_a_folder_that_cannot_be_moved_out_of_the_way_is_told_as_such(tmp_path, monkeypatch):
    write_marked(tmp_path)
    rename = Path.rename

    def refuse(path, to):
        if path == tmp_path / "made":
            raise OSError(errno.EBUSY, "Device or resource busy")
        return rename(path, to)

    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(sa.SpaceArmError, match="made cannot be written: Device or resource busy"):
        write_marked(tmp_path)
    assert content_of(tmp_path) == {"made/mark": b"new", "made/values": b"new"}


def test_a_folder_whose_place_others_take_while_it_is_replaced_is_kept(tmp_path, monkeypatch):
    target = tmp_path / "made"
    target.mkdir()
    (target / "mark").write_bytes(b"old")
    rename = Path.rename

    def late(path, to):
        if to == target and not target.exists():
            target.mkdir()
            (target / "theirs").write_bytes(b"theirs")
        return rename(path, to)

    monkeypatch.setattr(Path, "rename", late)
    with pytest.raises(sa.SpaceArmError, match="made cannot be written") as caught:
        write_marked(tmp_path)
    files.write(tmp_path / "other", b"next")  # removes what is left over
    kept = next(tmp_path.glob(f".*/{files.BEFORE}"))
    assert str(kept) in str(caught.value)
    assert content_of(kept) == {"mark": b"old"}
    assert content_of(target) == {"theirs": b"theirs"}


def test_what_another_process_takes_for_a_leftover_is_kept_again(tmp_path, monkeypatch):
    """It removes the file's second name before it is locked."""
    (tmp_path / "a").write_bytes(b"old")
    link, made = os.link, []

    def linked(source, to, **options):
        link(source, to, **options)
        if not made:
            files.remove_leftovers(tmp_path)
        made.append(Path(to).exists())

    monkeypatch.setattr(os, "link", linked)
    write_one(tmp_path)
    assert made == [False, True]
    assert content_of(tmp_path) == {"a": b"new"}


def test_what_others_put_in_the_place_of_a_new_file_stays(tmp_path, monkeypatch):
    """Another program writes the file just before it is taken back."""

    def flushed(number):
        if stat.S_ISDIR(os.fstat(number).st_mode):
            (tmp_path / "theirs").write_bytes(b"theirs")
            (tmp_path / "theirs").replace(tmp_path / "a")
            raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", flushed)
    with pytest.raises(sa.SpaceArmError, match="a cannot be written: Input/output error"):
        write_one(tmp_path)
    assert content_of(tmp_path) == {"a": b"theirs"}


def test_a_temporary_folder_goes_while_a_thread_still_writes_to_it():
    """As those of Zarr do when one of them has failed."""
    over = threading.Event()

    def fill(folder):
        for number in itertools.count():
            if over.is_set():
                break
            with suppress(FileNotFoundError):
                (folder / str(number)).write_bytes(b"")

    with files.temporary_folder() as folder:
        writer = threading.Thread(target=fill, args=(folder,))
        writer.start()
        threading.Timer(0.2, over.set).start()
    writer.join()
    assert not folder.exists()
