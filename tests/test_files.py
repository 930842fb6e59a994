"""Files that are read and written: regular ones, up to a size."""

import os
import sys
from pathlib import Path

import pytest

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


@pytest.mark.parametrize("load", TEXTS)
def test_no_more_is_read_than_a_person_writes(tmp_path, load):
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(files.LARGEST_TEXT + 1)
    with pytest.raises(sa.SpaceArmError, match="larger than 10 MB"):
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
        with pytest.raises(sa.SpaceArmError, match="no regular file"):
            files.write(path, b"content")
    assert (tmp_path / "pipe").is_fifo()
    assert [p.name for p in tmp_path.iterdir()] == ["pipe"]
