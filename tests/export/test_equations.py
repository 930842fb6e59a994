"""The exported equations, computed with NumPy, against the package's own."""

from itertools import combinations

import numpy as np
import pytest
from helpers.arms import chains, load_text, random_chain, seeds, trees
from helpers.reference import planar_singularity
from hypothesis import given

import spacearm as sa
from spacearm.compiler import numbers
from spacearm.equations import linear_algebra, measures
from spacearm.export.functions import EQUATIONS, structure_in
from spacearm.mechanics.arm_kernels import parameters_of
from spacearm.mechanics.jacobian import task_jacobian

MODES = ("free-floating", "attitude-controlled", "fixed")


def at(arm, name, q, *more, mode="free-floating"):
    function, _ = EQUATIONS[name]
    return function(numbers, structure_in(arm, mode), parameters_of(arm), np.array(q), *more)


def assert_same(value, wanted, rtol=1e-12):
    np.testing.assert_allclose(value, wanted, rtol=0.0, atol=rtol * np.abs(wanted).max())


def assert_all_the_same(arm, q, rng):
    cfg = arm.at(q)
    for mode in MODES:
        J = sa.generalized_jacobian(cfg, mode=mode)
        assert_same(at(arm, "jacobian", q, mode=mode), J)
        assert_same(at(arm, "task_jacobian", q, mode=mode), task_jacobian(cfg, mode=mode))
        H = sa.generalized_inertia(cfg, mode=mode)
        assert_same(at(arm, "generalized_inertia", q, mode=mode), H)
        dq, tau = rng.normal(size=(2, arm.n))
        ddq = sa.forward_dynamics(cfg, dq, tau, mode=mode).ddq
        found = at(arm, "forward_dynamics", q, dq, tau, mode=mode)
        c = np.linalg.cond(H) * 1e-15
        assert_same(found, ddq, 1e-12 + c)
    D, D_q = cfg.A[3:, 3:6], cfg.A[3:, 6:]
    assert_same(at(arm, "base_inertia", q), D)
    assert_same(at(arm, "momentum", q), cfg.A[:, 6:])
    assert_same(at(arm, "connection", q), -np.linalg.solve(D, D_q))
    assert_same(at(arm, "centre", q), cfg.com)
    positions = np.array([tip.translation - cfg.com for tip in cfg.tips])
    rotations = np.array([tip.rotation for tip in cfg.tips])
    assert_same(at(arm, "tip_position", q), np.squeeze(positions))
    assert_same(at(arm, "tip_rotation", q), np.squeeze(rotations))


@given(trees(), seeds)
def test_random_trees(cfg, seed):
    """Turning, sliding and mimic joints, branches."""
    assert_all_the_same(cfg.arm, cfg.q, np.random.default_rng(seed))


@pytest.mark.parametrize("name", ["planar2", "planar3", "chaser7", "mda6", "ets7", "tecsas"])
def test_arms_of_the_catalogue(name):
    arm, rng = sa.load(name, check="accept"), np.random.default_rng(1)
    assert_all_the_same(arm, rng.uniform(-np.pi, np.pi, arm.n), rng)


def test_two_tips():
    arm = sa.load("dual_ur5", tip=("left", "right"), joints="all")
    rng = np.random.default_rng(2)
    assert_all_the_same(arm, rng.uniform(-np.pi, np.pi, arm.n), rng)


@given(seeds)
def test_equation_41(seed):
    """S of the planar example is the closed form itself, factor and all."""
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, 2)
    assert at(sa.load("planar2"), "S", q) == pytest.approx(
        planar_singularity(*q), rel=1e-12, abs=1e-14
    )


def ratios(arm, Q, mode="free-floating"):
    """S over the polynomial of the package, where that is not small."""
    S = sa.singularity_polynomial(arm, mode=mode)
    values = S(Q)
    mine = np.array([at(arm, "S", q, mode=mode) for q in Q])
    return mine / values, np.abs(values) / S.scale


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("n", "task"), [(3, "position"), (3, "orientation"), (2, "x z")])
def test_S_is_the_polynomial_times_a_constant(n, task, mode):
    arm = load_text(random_chain(5, n), tip="tip", task=task)
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (40, n))
    ratio, size = ratios(arm, Q, mode)
    ratio = ratio[size > 1e-2]
    assert len(ratio) > 10
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-10, atol=0)


def test_S_of_six_joints_is_the_polynomial_times_a_constant():
    arm = sa.load("mda6")
    ratio, size = ratios(arm, np.random.default_rng(0).uniform(-np.pi, np.pi, (40, 6)))
    np.testing.assert_allclose(ratio[size > 1e-3], ratio[np.argmax(size)], rtol=1e-10, atol=0)


@given(chains())
def test_S_of_redundant_arms_is_the_sum_of_squared_minors(cfg):
    arm, J = cfg.arm, task_jacobian(cfg)
    S = at(arm, "S", cfg.q)
    size = np.prod(np.sort(np.linalg.norm(J, axis=1))) if arm.n >= arm.task.k else 0.0

    D = np.linalg.det(cfg.A[3:, 3:6] @ cfg.base.rotation.T)
    if arm.n > arm.task.k:
        volume = np.prod(np.linalg.svd(J, compute_uv=False))
        assert pytest.approx(D * volume, rel=1e-9, abs=1e-12 * D * size) == S**0.5
    elif arm.n == arm.task.k:
        assert pytest.approx(D * np.linalg.det(J), rel=1e-9, abs=1e-12 * D * size) == S
    else:
        assert S == 0.0


def test_S_of_many_joints_is_the_same_without_minors(monkeypatch):
    arm = load_text(random_chain(3, 6), tip="tip", task="position")
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (5, 6)):
        by_minors = at(arm, "S", q)
        with monkeypatch.context() as few:
            few.setattr(measures, "MOST_MINORS", 10)
            assert at(arm, "S", q) == pytest.approx(by_minors, rel=1e-9)


@given(seeds)
def test_minors_are_determinants(seed):
    A = np.random.default_rng(seed).normal(size=(3, 5))
    wanted = [np.linalg.det(A[:, c]) for c in combinations(range(5), 3)]
    np.testing.assert_allclose(linear_algebra.minors(A), wanted, atol=1e-12)


@given(seeds)
def test_elimination_solves(seed):
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(4, 6)), rng.normal(size=(4, 2))
    A = A @ A.T + 0.1 * np.eye(4)
    np.testing.assert_allclose(A @ linear_algebra.solve(numbers, A, B), B, atol=1e-9)
