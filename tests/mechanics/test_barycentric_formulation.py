"""The barycentric formulation against the centroidal one, and its own identities."""

import numpy as np
import pinocchio as pin
import pytest
from helpers import reference
from helpers.arms import (
    chains,
    joint,
    link,
    load_text,
    random_chain,
    random_configuration,
    robot,
    two_links,
)
from hypothesis import given, settings

import spacearm as sa
from spacearm.mechanics.barycentric_formulation import (
    attitude,
    euler_parameter_rates,
    euler_parameters,
)


def agreement(cfg):
    J = sa.generalized_jacobian(cfg)
    return np.abs(sa.barycentric(cfg).generalized_jacobian() - J).max() / np.abs(J).max()


@pytest.mark.parametrize("info", sa.catalogue(), ids=lambda info: info.name)
def test_both_routes_agree_on_every_model(info):
    arm = sa.load(info.name)
    arm = arm.replace(locked=dict.fromkeys(arm.held, 0.3))  # a second arm, away from zero
    assert max(agreement(random_configuration(arm, seed)) for seed in range(50)) < 1e-12


@given(chains())
@settings(max_examples=60)
def test_both_routes_agree_on_random_chains(cfg):
    assert agreement(cfg) < 1e-12


@given(chains())
def test_identities_of_the_paper(cfg):
    b = sa.barycentric(cfg)
    N = len(b.rho) - 1
    m = np.array([inertia.mass for inertia in list(cfg.arm.model.inertias)[1:]])
    assert np.abs(m @ b.rho).max() < 1e-12 * b.M  # (5)
    for k in range(1, N + 1):  # (4)
        assert np.allclose(b.rho[k] - b.rho[k - 1], b.r[k - 1] - b.l[k], atol=1e-12)
    r_star, l_star, c_star = b.r - b.c, b.l - b.c, -b.c
    for i in range(1, N):  # (10)
        balance = b.M * (b.mu[i] * l_star[i] + (1 - b.mu[i + 1]) * r_star[i]) + m[i] * c_star[i]
        assert np.abs(balance).max() < 1e-12 * b.M
    assert b.mu[0] == 0.0
    assert b.mu[-1] == pytest.approx(1.0, abs=1e-15)
    assert np.abs(b.D - b.D.T).max() < 1e-12 * np.abs(b.D).max()
    assert np.allclose(b.r_cm, cfg.com, atol=1e-12)
    A_b, A_q = sa.momentum_matrix(cfg)
    assert np.allclose(b.T0 @ b.D @ b.T0.T, A_b[3:, 3:], atol=1e-11 * np.abs(A_b).max())
    assert np.allclose(b.T0 @ b.Dq, A_q[3:], atol=1e-11 * np.abs(A_q).max())


@given(chains())
def test_virtual_manipulator_ends_at_the_tip(cfg):
    b = sa.barycentric(cfg)
    vm = b.virtual_manipulator
    assert np.allclose(vm.end, cfg.tip.translation, atol=1e-12)
    assert np.allclose(vm.points[0], cfg.com, atol=1e-12)
    J = sa.generalized_jacobian(cfg, mode="attitude-controlled")
    assert np.abs(vm.jacobian - J).max() < 1e-12 * np.abs(J).max()


@given(chains())
def test_virtual_manipulator_has_constant_links_and_its_own_jacobian(cfg):
    """Held by its first link, it moves its end as its links turning about the axes say."""
    vm = sa.barycentric(cfg).virtual_manipulator
    other = sa.barycentric(cfg.arm.at(cfg.q + 0.3, base=cfg.base)).virtual_manipulator
    lengths, others = (np.linalg.norm(v.links, axis=1) for v in (vm, other))
    assert np.allclose(lengths, others, atol=1e-12)
    h = 1e-6
    for j, step in enumerate(np.eye(cfg.arm.n) * h):
        ahead, behind = (
            sa.barycentric(cfg.arm.at(cfg.q + s, base=cfg.base)).virtual_manipulator
            for s in (step, -step)
        )
        relative = ((ahead.end - ahead.ground) - (behind.end - behind.ground)) / (2 * h)
        assert np.allclose(relative, vm.jacobian[:3, j], atol=1e-7)


def test_planar2_has_the_numbers_of_the_paper():
    arm = sa.load("planar2")
    b = sa.barycentric(arm.at([0.0, 0.0]))
    assert b.mu == pytest.approx([0, 40 / 47, 44 / 47, 1], abs=1e-15)
    wanted = [reference.alpha, reference.beta, reference.gamma]
    assert wanted == pytest.approx([20 / 47, 42 / 47, 45.5 / 47])
    assert np.abs(b.v_E - np.outer(wanted, [1, 0, 0])).max() < 1e-15
    q = np.radians([30, -70])
    b = sa.barycentric(arm.at(q))
    R = np.linalg.norm(b.virtual_manipulator.end - b.r_cm)
    assert pytest.approx(reference.planar_radius(*q), rel=1e-14) == R
    D = b.D_j[:, 2, 2]
    assert pytest.approx(reference.planar_inertias(*q), rel=1e-14) == D


def test_tip_on_a_link_before_the_last():
    arm = load_text(random_chain(8, 6), tip="link_4")
    assert agreement(random_configuration(arm, 8)) < 1e-12


def test_mimic_joints_follow():
    text = random_chain(9, 4).replace(
        'effort="10" velocity="1"/></joint>\n<link name="tip"/>',
        'effort="10" velocity="1"/><mimic joint="joint_2" multiplier="-2" offset="0.3"/></joint>\n'
        '<link name="tip"/>',
    )
    arm = load_text(text, tip="tip")
    assert arm.n == 3
    assert agreement(random_configuration(arm, 9)) < 1e-12


def test_euler_parameters_equations_27_to_36():
    rng = np.random.default_rng(36)
    for _ in range(20):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        angle = rng.uniform(-np.pi, np.pi)
        e, n = euler_parameters(axis, angle)
        assert np.allclose(attitude(e, n), pin.exp3(axis * angle), atol=1e-15)
        w, h = rng.normal(size=3), 1e-6
        de, dn = euler_parameter_rates(e, n, w)
        difference = (attitude(e + h * de, n + h * dn) - attitude(e - h * de, n - h * dn)) / (2 * h)
        assert np.allclose(difference, attitude(e, n) @ pin.skew(w), atol=1e-9)


def test_prismatic_joints_are_refused_with_the_reason():
    arm = load_text(robot(*two_links(kind="prismatic")), tip="arm")
    with pytest.raises(sa.UnsupportedError, match="'elbow' is prismatic"):
        sa.barycentric(arm.at([0.1]))


def test_movable_side_joints_are_refused_and_locked_ones_lumped():
    text = robot(
        *two_links(), link("panel", 3.0, (0, 1, 0)), joint("wing", "bus", "panel", axis=(0, 1, 0))
    )
    with pytest.raises(sa.UnsupportedError, match=r"tip can move \(wing\).*locked"):
        sa.barycentric(load_text(text, tip="arm", joints="all").at([0.1, 0.2]))
    for options in ({}, {"locked": {"wing": 0.4}}):
        arm = load_text(text, tip="arm", **options)
        assert agreement(random_configuration(arm, 1)) < 1e-12
