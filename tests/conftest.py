"""Settings of all tests: no time limit for one example, since the first one loads packages.

What tests of sweeps share: a study, and its store.
"""

import pytest
from helpers.sweeps import STUDY
from hypothesis import settings

import spacearm as sa

settings.register_profile("spacearm", deadline=None, derandomize=True)
settings.load_profile("spacearm")


@pytest.fixture(scope="session")
def study():
    return sa.Study.parse(STUDY)


@pytest.fixture(scope="session")
def whole(study, tmp_path_factory):
    """The store of an uninterrupted run on two processes of this machine."""
    path = tmp_path_factory.mktemp("whole") / "whole.zarr"
    sa.sweep(study, path, workers=2)
    return path
