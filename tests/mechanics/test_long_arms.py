"""Arms of so many joints that their equations are not compiled: computed singly, or refused."""

import numpy as np
import pytest
from helpers.arms import load_text
from helpers.long_arms import in_a_row

import spacearm as sa
from spacearm.compiler import expressions
from spacearm.mechanics import arm_kernels
from spacearm.mechanics.arm_kernels import ArmKernel
from spacearm.mechanics.distance import linearise


@pytest.fixture
def nothing_is_compiled(monkeypatch):
    arm_kernels._compiled.cache_clear()
    monkeypatch.setattr(expressions, "LONGEST", 10)
    yield
    arm_kernels._compiled.cache_clear()


def computed(arm, Q):
    rates = np.full_like(Q, 0.1)
    return [
        *sa.evaluate(arm, Q, ["sigma_min", "condition", "distance"]).values(),
        sa.generalized_jacobians(arm, Q),
        sa.joint_accelerations(arm, Q, rates, Q),
        *linearise(arm, Q)[:2],
    ]


@pytest.mark.usefixtures("nothing_is_compiled")
def test_what_is_not_compiled_is_computed_singly(monkeypatch):
    arm, Q = sa.load("chaser7"), np.random.default_rng(0).uniform(-2, 2, (12, 7))
    singly = computed(arm, Q)
    monkeypatch.undo()
    arm_kernels._compiled.cache_clear()
    for a, b in zip(singly, computed(arm, Q), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9)


@pytest.mark.usefixtures("nothing_is_compiled")
def test_what_nothing_else_computes_is_refused_with_the_bound():
    kernel = ArmKernel([sa.load("planar2")], "free-floating", sines)
    for _ in range(2):
        with pytest.raises(sa.UnsupportedError, match=r"2 joints .*more than 10 operations.*lock"):
            kernel({"q": np.zeros((3, 2))})


def sines(xp, _tree, _parameters, q):
    return xp.stack([xp.sin(q[0] * i) for i in range(20)])


@pytest.mark.slow
def test_a_hundred_joints_in_a_row_answer():
    arm = load_text(in_a_row(100))
    q = 0.3 * np.sin(1.0 + np.arange(100))
    report = sa.singularity(arm.at(q))
    assert report.sigma_min > 0.0
    found = sa.evaluate(arm, [q, q], "sigma_min")["sigma_min"]
    np.testing.assert_allclose(found, report.sigma_min, rtol=1e-9, atol=1e-12)
