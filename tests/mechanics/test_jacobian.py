"""The generalized Jacobian: closed form, conservation, limits, derivatives."""

import numpy as np
import pinocchio as pin
import pytest
from helpers import reference
from helpers.arms import (
    chains,
    load_text,
    moved,
    random_base,
    random_chain,
    random_configuration,
    trees,
)
from hypothesis import given

import spacearm as sa

MODES = ("free-floating", "attitude-controlled", "fixed")


def relative(a, b):
    return np.abs(a - b).max() / np.abs(b).max()


def test_planar2_has_the_closed_form_of_equation_39():
    arm = sa.load("planar2")
    rng = np.random.default_rng(39)
    for _ in range(1000):
        q, attitude = rng.uniform(-np.pi, np.pi, 2), rng.uniform(-np.pi, np.pi)
        R = pin.utils.rotate("z", attitude)
        J = sa.generalized_jacobian(arm.at(q, base=pin.SE3(R, rng.normal(size=3))))
        assert np.abs(J[:2] - R[:2, :2] @ reference.planar_jacobian(*q)).max() < 1e-13
        assert np.abs(J[2:5]).max() < 1e-15


@given(trees())
def test_tip_velocity_is_what_moving_the_system_shows(cfg):
    rng = np.random.default_rng(0)
    dq = rng.normal(size=cfg.arm.n)
    v_b = sa.base_velocity(cfg, dq)
    twist = sa.generalized_jacobian(cfg) @ dq
    h = 1e-5
    ahead, behind = moved(cfg, dq, v_b, h).tip, moved(cfg, dq, v_b, -h).tip
    linear = (ahead.translation - behind.translation) / (2 * h)
    angular = pin.log3(ahead.rotation @ behind.rotation.T) / (2 * h)
    scale = 1.0 + np.abs(twist).max()
    assert np.abs(np.concatenate((linear, angular)) - twist).max() < 1e-7 * scale


@given(trees())
def test_turning_the_spacecraft_turns_the_jacobian(cfg):
    turned = random_base(np.random.default_rng(7))
    other = cfg.arm.at(cfg.q, base=turned * cfg.base)
    for mode in MODES:
        J = np.kron(np.eye(2), turned.rotation) @ sa.generalized_jacobian(cfg, mode=mode)
        assert np.abs(sa.generalized_jacobian(other, mode=mode) - J).max() < 1e-12 * np.abs(J).max()


def test_a_heavy_spacecraft_is_a_fixed_base():
    arm = load_text(random_chain(5, 6), tip="tip")
    q = np.random.default_rng(5).uniform(-np.pi, np.pi, 6)
    base = arm.model.inertias[1]
    J = sa.fixed_base_jacobian(arm.at(q))
    factors = 10.0 ** np.arange(3, 9)
    errors = [
        np.abs(
            sa.generalized_jacobian(
                arm.replace(base_mass=f * base.mass, base_inertia=f * base.inertia).at(q)
            )
            - J
        ).max()
        for f in factors
    ]
    slope = np.polyfit(np.log10(factors), np.log10(errors), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.01)
    assert errors[-1] < 1e-4 * errors[0]


@pytest.mark.parametrize("mode", MODES)
@given(cfg=trees())
def test_derivative_agrees_with_central_differences(mode, cfg):
    h = 1e-5
    steps = np.eye(cfg.arm.n) * h
    differences = np.array(
        [
            (
                sa.generalized_jacobian(cfg.arm.at(cfg.q + step, base=cfg.base), mode=mode)
                - sa.generalized_jacobian(cfg.arm.at(cfg.q - step, base=cfg.base), mode=mode)
            )
            / (2 * h)
            for step in steps
        ]
    )
    derivative = sa.generalized_jacobian_derivative(cfg, mode=mode)
    scale = max(np.abs(derivative).max(), np.abs(sa.generalized_jacobian(cfg, mode=mode)).max())
    assert np.abs(differences - derivative).max() < 1e-6 * scale


@given(trees())
def test_rate_is_the_change_along_the_motion(cfg):
    rng = np.random.default_rng(3)
    dq, momentum, h = rng.normal(size=cfg.arm.n), rng.normal(size=6), 1e-5
    cfg = cfg.with_momentum(momentum)
    v_b = sa.base_velocity(cfg, dq)
    difference = (
        sa.generalized_jacobian(moved(cfg, dq, v_b, h))
        - sa.generalized_jacobian(moved(cfg, dq, v_b, -h))
    ) / (2 * h)
    rate = sa.generalized_jacobian_rate(cfg, dq)
    assert np.abs(difference - rate).max() < 1e-6 * (1.0 + np.abs(rate).max())


@given(chains())
def test_attitude_control_and_a_fixed_base_do_what_they_say(cfg):
    dq = np.random.default_rng(0).normal(size=cfg.arm.n)
    A_q = sa.momentum_matrix(cfg).A_q
    v_0 = -(A_q @ dq)[:3] / cfg.arm.mass
    held = sa.generalized_jacobian(cfg, mode="attitude-controlled") - sa.fixed_base_jacobian(cfg)
    assert np.allclose(held @ dq, np.concatenate((v_0, np.zeros(3))), atol=1e-12)


def test_in_orbit_as_at_the_origin():
    """Thousands of kilometres from the origin no digit of a derivative may be lost."""
    here = random_configuration(sa.load("chaser7"), 7)
    orbit = pin.SE3(here.base.rotation, np.array([4e6, -5e6, 2e6]))
    there = here.arm.at(here.q, base=orbit)
    assert np.array_equal(sa.generalized_jacobian(there), sa.generalized_jacobian(here))
    assert np.array_equal(
        sa.generalized_jacobian_derivative(there), sa.generalized_jacobian_derivative(here)
    )
    assert np.array_equal(sa.singularity(there).gradient, sa.singularity(here).gradient)
    offset = here.tip.translation - here.base.translation
    assert np.allclose(there.tip.translation - orbit.translation, offset, atol=1e-8)


def test_unknown_mode_lists_the_valid_ones():
    cfg = random_configuration(sa.load("planar2"), 0)
    with pytest.raises(sa.ConfigurationError, match="free-floating, "):
        sa.generalized_jacobian(cfg, mode="free-floatin")
