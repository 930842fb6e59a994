"""Moving with a floating spacecraft."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import random_base, random_configuration, trees
from hypothesis import given, settings
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline, PPoly

import spacearm as sa
from spacearm.mechanics import floating as reaction


@given(trees())
def test_moving_agrees_with_an_independent_integration_of_momentum(cfg):
    """scipy integrates the pose from `base_velocity`; `move` has its own way."""
    target = cfg.q + np.random.default_rng(1).uniform(-1, 1, cfg.arm.n)
    dq = target - cfg.q

    def rate(s, y):
        R = y[:9].reshape(3, 3)
        base = pin.SE3(pin.Quaternion(R).normalized(), y[9:])
        v = sa.base_velocity(cfg.arm.at(cfg.q + s * dq, base=base), dq)
        return np.concatenate(((pin.skew(v[3:]) @ R).ravel(), v[:3]))

    start = np.concatenate((cfg.base.rotation.ravel(), cfg.base.translation))
    end = solve_ivp(rate, (0, 1), start, "DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
    moved = sa.move(cfg, target)
    assert np.abs(moved.base.rotation - end[:9].reshape(3, 3)).max() < 1e-6
    assert np.abs(moved.base.translation - end[9:]).max() < 1e-6
    assert np.allclose(moved.com, cfg.com, atol=1e-12)
    assert np.array_equal(moved.q, target)


@given(trees())
@settings(max_examples=10)
def test_a_motion_with_momentum_agrees_with_an_independent_integration(cfg):
    """scipy integrates the attitude from `base_velocity` at the momentum on board."""
    arm = cfg.arm
    rng = np.random.default_rng(2)
    h = np.append(np.zeros(3), 0.3 * np.diag(cfg.A[3:, 3:6]) * rng.uniform(-1, 1, 3))
    start = arm.at(cfg.q, base=cfg.base, momentum=h)
    target = cfg.q + rng.uniform(-1, 1, arm.n)
    curve = CubicHermiteSpline([0.0, 2.0], [cfg.q, target], [rng.uniform(-1, 1, arm.n)] * 2)
    t = np.linspace(0.0, 2.0, 5)
    found = reaction.attitudes_over_time(start, curve, t)

    def rate(time, y):
        R = pin.Quaternion(y.reshape(3, 3)).normalized().matrix()
        there = arm.at(curve(time), base=pin.SE3(R, np.zeros(3)), momentum=h)
        return (pin.skew(sa.base_velocity(there, curve(time, 1))[3:]) @ R).ravel()

    known = solve_ivp(rate, (0, 2), cfg.base.rotation.ravel(), "DOP853", t, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.reshape(5, 9), known.y.T, atol=1e-5)


def test_a_motion_that_rests_half_way_between_two_times_is_integrated_finely():
    """Its rates are zero at both ends and in the middle; a finer grid gives the same attitude."""
    arm = sa.load("chaser7")
    cfg = random_configuration(arm, 2)
    rests = np.polynomial.Polynomial([0.0, 2.0, -3.0, 1.0])  # t (t - 1) (t - 2)
    rng = np.random.default_rng(0)
    joints = [
        (rests * (c + np.polynomial.Polynomial([0.0, d]))).integ()
        for c, d in 4.0 * rng.normal(size=(arm.n, 2))
    ]
    c = np.array([np.pad(joint.coef, (0, 6 - len(joint.coef)))[::-1] for joint in joints])
    c[:, -1] = cfg.q
    curve = PPoly(c.T[:, None], [0.0, 2.0])
    end = reaction.attitudes_over_time(cfg, curve, np.array([0.0, 2.0]))[-1]
    fine = reaction.attitudes_over_time(cfg, curve, np.linspace(0.0, 2.0, 401))[-1]
    assert np.linalg.norm(pin.log3(cfg.base.rotation.T @ fine)) > 0.01
    np.testing.assert_allclose(end, fine, atol=1e-5)


def test_moving_is_of_fourth_order(monkeypatch):
    arm = sa.load("chaser7")
    cfg = random_configuration(arm, 2)
    target = cfg.q + 1.0
    monkeypatch.setattr(reaction, "STEP", 0.002)
    exact = sa.move(cfg, target).base.rotation
    errors = []
    for step in (0.2, 0.1, 0.05):
        monkeypatch.setattr(reaction, "STEP", step)
        errors.append(np.linalg.norm(pin.log3(exact.T @ sa.move(cfg, target).base.rotation)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 3.7).all()


@given(trees())
@settings(max_examples=10)
def test_a_walk_is_one_motion_after_another(cfg):
    n, rng = cfg.arm.n, np.random.default_rng(2)
    Q = cfg.q + np.vstack((np.zeros(n), np.cumsum(rng.normal(size=(4, n)) / 5, axis=0)))
    rows = reaction.walk(cfg, Q)
    for pose, row in zip(rows.bases, rows, strict=True):
        at = pin.XYZQUATToSE3(pose)
        np.testing.assert_allclose(at.homogeneous, row.base.homogeneous, atol=1e-12)
    for q, row in zip(Q[1:], rows[1:], strict=True):
        cfg = reaction.move(cfg, q)
        np.testing.assert_array_equal(row.q, q)
        np.testing.assert_allclose(row.base.homogeneous, cfg.base.homogeneous, atol=1e-10)


def test_there_and_back_is_where_it_was_and_a_loop_is_not():
    cfg = sa.load("planar2").at([0.3, -0.4], base=random_base(np.random.default_rng(3)))
    back = sa.move(sa.move(cfg, [1.3, 0.6]), cfg.q)
    assert back.base.isApprox(cfg.base, 1e-9)
    loop = cfg
    for corner in ([1.3, -0.4], [1.3, 0.6], [0.3, 0.6], [0.3, -0.4]):
        loop = sa.move(loop, corner)
    assert np.linalg.norm(pin.log3(cfg.base.rotation.T @ loop.base.rotation)) > 0.01


def test_a_small_loop_turns_by_the_curvature_it_encloses():
    """Stokes: the turn of planar2 is the integral of d(w2)/dq1 - d(w1)/dq2 over the loop."""
    arm = sa.load("planar2")
    a, q = 1e-2, np.array([0.5, 0.9])

    def w(q):
        return sa.barycentric(arm.at(q)).base_rates[2]

    h = 1e-5
    x, y = np.eye(2)
    centre = q + a / 2
    curvature = (
        (w(centre + h * x)[1] - w(centre - h * x)[1])
        - (w(centre + h * y)[0] - w(centre - h * y)[0])
    ) / (2 * h)
    loop = arm.at(q)
    for corner in (q + a * x, q + a, q + a * y, q):
        loop = sa.move(loop, corner)
    assert pin.log3(loop.base.rotation)[2] == pytest.approx(curvature * a * a, rel=1e-4)


def test_motion_with_momentum_depends_on_time_and_is_refused():
    cfg = sa.load("planar2").at([0.3, -0.4], momentum=[0, 0, 0, 0, 0, 0.1])
    with pytest.raises(sa.UnsupportedError, match=r"momentum .* use sa.simulate"):
        sa.move(cfg, [0.5, 0.0])


@pytest.mark.parametrize("name", ["planar2", "mda6", "dual_ur5"])
def test_momenta_of_many_postures_are_those_of_pinocchio(name):
    """D and D_q, compiled, against the centroidal momentum matrix, posture by posture."""
    arm = sa.load(name)
    Q = np.random.default_rng(0).normal(size=(20, arm.n))
    D, D_q = reaction.momenta(arm, Q)
    for q, inertia, joints in zip(Q, D, D_q, strict=True):
        A_b, A_q = sa.momentum_matrix(arm.at(q))
        wanted, size = (A_b[3:, 3:], A_q[3:]), np.abs(A_b[3:, 3:]).max()
        np.testing.assert_allclose(inertia, wanted[0], rtol=0, atol=1e-13 * size)
        np.testing.assert_allclose(joints, wanted[1], rtol=0, atol=1e-13 * size)
