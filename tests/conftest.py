"""What all tests share: settings of hypothesis, a sweep that ran through.

Tests marked `slow` are left out unless they are asked for: `pytest -m slow`, or `-m ""` for all.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a worker a core; read when numpy is imported

import pytest
from helpers.sweeps import STUDY
from hypothesis import settings

import spacearm as sa

settings.register_profile(  # first examples load much
    "spacearm", deadline=None, derandomize=True, max_examples=50
)
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
