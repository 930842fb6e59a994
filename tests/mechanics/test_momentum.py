"""Momentum is conserved by the base velocity that spacearm returns."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chains, moved, random_configuration, trees
from hypothesis import given

import spacearm as sa


@given(trees())
def test_momentum_vanishes_with_the_base_velocity(cfg):
    dq = np.random.default_rng(1).normal(size=cfg.arm.n)
    A_b, A_q = sa.momentum_matrix(cfg)
    h = A_b @ sa.base_velocity(cfg, dq) + A_q @ dq
    assert np.abs(h).max() < 1e-12 * np.abs(A_q @ dq).max()


@given(trees())
def test_momentum_is_that_of_the_moving_bodies(cfg):
    """h from the definition: sums over the bodies of a moving system, by finite differences."""
    rng = np.random.default_rng(2)
    dq, v_b, h = rng.normal(size=cfg.arm.n), rng.normal(size=6), 1e-5
    model = cfg.arm.model
    ahead, behind = (bodies(moved(cfg, dq, v_b, s)) for s in (h, -h))
    linear, angular = np.zeros(3), np.zeros(3)
    for (R1, p1), (R0, p0), inertia in zip(ahead, behind, list(model.inertias)[1:], strict=True):
        velocity, middle = (p1 - p0) / (2 * h), (p1 + p0) / 2
        w = pin.log3(R1 @ R0.T) / (2 * h)
        R = R0 @ pin.exp3(pin.log3(R0.T @ R1) / 2)
        linear += inertia.mass * velocity
        angular += R @ inertia.inertia @ R.T @ w
        angular += inertia.mass * np.cross(middle - cfg.com, velocity)
    A_b, A_q = sa.momentum_matrix(cfg)
    momentum = A_b @ v_b + A_q @ dq
    scale = np.abs(A_b).max() * 10
    assert np.abs(np.concatenate((linear, angular)) - momentum).max() < 1e-7 * scale


def bodies(cfg):
    data = pin.Data(cfg.arm.model)
    pin.forwardKinematics(cfg.arm.model, data, cfg.full)
    placements = list(data.oMi)[1:]
    inertias = list(cfg.arm.model.inertias)[1:]
    return [(M.rotation, M.act(I.lever)) for M, I in zip(placements, inertias, strict=True)]


@given(chains())
def test_base_block_has_its_closed_form_and_determinant(cfg):
    A_b = sa.momentum_matrix(cfg).A_b
    M, c = cfg.arm.mass, cfg.com - cfg.base.translation
    assert np.allclose(A_b[:3], np.hstack((M * np.eye(3), -M * pin.skew(c))), atol=1e-11 * M)
    assert np.abs(A_b[3:, :3]).max() < 1e-12 * np.abs(A_b).max()
    D = sa.barycentric(cfg).D
    assert np.linalg.det(A_b) == pytest.approx(M**3 * np.linalg.det(D), rel=1e-10)


def test_given_momentum_is_kept():
    rng = np.random.default_rng(4)
    dq, h = rng.normal(size=7), rng.normal(size=6) * 100
    cfg = random_configuration(sa.load("chaser7"), 4).with_momentum(h)
    A_b, A_q = sa.momentum_matrix(cfg)
    assert np.allclose(A_b @ sa.base_velocity(cfg, dq) + A_q @ dq, h, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("dq", "momentum", "message"),
    [
        ([1.0], None, r"dq has shape \(1,\); planar2 needs \(2,\)"),
        ([1.0, np.nan], None, "dq of joint 'joint_2' is nan"),
        ([1.0, 2.0], [1, 2, 3], "6 finite numbers"),
        ([1.0, 2.0], [np.inf] * 6, "6 finite numbers"),
        ([1.0, 2.0], "abc", "6 finite numbers"),
        ([1e308, 2.0], None, r"dq of joint 'joint_1' is 1e\+308"),
    ],
)
def test_bad_rates_and_momenta_are_named(dq, momentum, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.base_velocity(sa.load("planar2").at([0, 0], momentum=momentum), dq)
