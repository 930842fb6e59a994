"""What all tests share: settings of hypothesis, a sweep that ran through.

Tests marked `slow` are left out unless they are asked for: `pytest -m slow`, or `-m ""` for all.
The environment's `SPACEARM_TEST_SEED=1` moves every random seed of the tests by one.
"""

import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a worker a core; read when numpy is imported
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # else each process compiles all sources anew

import numpy as np
import pytest
from helpers.sweeps import STUDY
from hypothesis import settings

import spacearm as sa

TESTS = str(Path(__file__).parent)
MOVED = int(os.environ.get("SPACEARM_TEST_SEED", "0"))

if MOVED:
    seeded = np.random.default_rng

    def moved(seed=None):
        """Return a generator whose seed is moved where a test asks for it."""
        by_test = sys._getframe(1).f_code.co_filename.startswith(TESTS)
        return seeded(seed + MOVED if by_test and isinstance(seed, int | np.integer) else seed)

    np.random.default_rng = moved

settings.register_profile(  # first examples load much
    "spacearm", deadline=None, derandomize=not MOVED, max_examples=20
)
settings.load_profile("spacearm")


@pytest.fixture(scope="session")
def study():
    return sa.Study.parse(STUDY)


@pytest.fixture
def study_file(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return path


@pytest.fixture(scope="session")
def whole(study, tmp_path_factory):
    """The store of an uninterrupted run on two processes of this machine."""
    path = tmp_path_factory.mktemp("whole") / "whole.zarr"
    sa.sweep(study, path, workers=2)
    return path
