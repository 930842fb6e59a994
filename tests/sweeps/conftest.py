"""A small study, and its store as a sweep leaves it."""

import pytest
from helpers.sweeps import SMALL

import spacearm as sa


@pytest.fixture(scope="module")
def small():
    return sa.Study.parse(SMALL)


@pytest.fixture(scope="module")
def sound(small, tmp_path_factory):
    path = tmp_path_factory.mktemp("sound") / "s.zarr"
    sa.sweep(small, path, workers=1)
    return path
