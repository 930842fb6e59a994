"""What all tests share: settings of hypothesis, compiled kernels, a sweep that ran through.

Tests marked `slow` are left out unless they are asked for: `pytest -m slow`, or `-m ""` for all.
"""

import os
import subprocess
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a worker a core; read when numpy is imported

import numpy as np
import pytest
from helpers.sweeps import STUDY
from hypothesis import settings

import spacearm as sa

settings.register_profile("spacearm", deadline=None, derandomize=True)  # first examples load much
settings.load_profile("spacearm")


SIMULATION = """
import spacearm as sa
arm, law = sa.load("planar2"), sa.JointPD(target=[0.1, 0.5], kp=1.0, kd=1.0)
sa.simulate(arm, [0.1, 0.4], law, 0.1)
sa.simulate_many(arm, [0.1, 0.4], law, 0.1)
law = sa.TransposedJacobian(target=arm.at([0.1, 0.4]).tip.translation[:2], kp=5.0, kd=15.0)
sa.simulate(arm, [0.1, 0.4], law, 0.1)
"""


def pytest_configure(config):
    """Compile the kernels once, before the workers start that would each compile them."""
    workers = getattr(config.option, "numprocesses", None)
    if workers and not hasattr(config, "workerinput") and not config.option.collectonly:
        from spacearm.mechanics.connection import reactions

        simulation = subprocess.Popen([sys.executable, "-c", SIMULATION])  # on another core
        arm, Q = sa.load("planar2"), np.zeros((64, 2))
        sa.evaluate(arm, Q)
        sa.evaluate(arm, Q, ("distance",))
        sa.generalized_jacobians(arm, Q)
        sa.joint_accelerations(arm, Q, Q, Q)
        reactions(arm, Q.T.copy())
        sa.singularity_polynomial(arm)
        sa.feasible_attitudes(arm, [(1.5, 0.2), (1.5, 0.5)], samples=8)
        assert simulation.wait() == 0


@pytest.fixture(scope="session")
def study():
    return sa.Study.parse(STUDY)


@pytest.fixture(scope="session")
def whole(study, tmp_path_factory):
    """The store of an uninterrupted run on two processes of this machine."""
    path = tmp_path_factory.mktemp("whole") / "whole.zarr"
    sa.sweep(study, path, workers=2)
    return path
