"""Dynamics: Pinocchio's own recursions, conservation laws, limits, finite differences."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chains, load_text, moved, random_base, random_tree, trees
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa
from spacearm.mechanics.dynamics import spacecraft_twist

MODES = ("free-floating", "attitude-controlled", "fixed")
MODELS = ("planar2", "planar3", "mda6", "ets7", "chaser7")
amounts = st.floats(-2, 2)


def state(cfg, seed=0):
    rng = np.random.default_rng(seed)
    n = cfg.arm.n
    return rng.normal(size=n), rng.normal(size=n), rng.normal(size=6)


def close(a, b, rtol=1e-9):
    a, b = np.asarray(a), np.asarray(b)
    return np.abs(a - b).max(initial=0) <= rtol * max(1e-9, np.abs(b).max(initial=0))


def local(cfg, twist):
    R = cfg.base.rotation
    return np.concatenate((R.T @ twist[:3], R.T @ twist[3:]))


@given(chains())
def test_forward_dynamics_is_aba_with_a_free_base(cfg):
    """The reduced form and the articulated-body algorithm of the full system agree."""
    dq, tau, h = state(cfg)
    cfg = cfg.with_momentum(h)
    found = sa.forward_dynamics(cfg, dq, tau)
    model = cfg.arm.model
    v_b = sa.base_velocity(cfg, dq)
    v = np.concatenate((local(cfg, v_b), dq))
    full = pin.aba(model, model.createData(), cfg.full, v, np.concatenate((np.zeros(6), tau)))
    assert close(found.ddq, full[6:])
    spatial = local(cfg, found.base_acceleration)
    spatial[:3] -= np.cross(v[3:6], v[:3])
    assert close(spatial, full[:6])
    assert not found.reaction.any()


@given(trees(), st.sampled_from(MODES))
def test_forward_then_inverse_is_the_identity(cfg, mode):
    dq, tau, h = state(cfg)
    wrenches = {"link_1": h, "link_0": tau[0] * np.ones(6)}
    cfg, options = cfg.with_momentum(h), {"mode": mode, "wrenches": wrenches}
    there = sa.forward_dynamics(cfg, dq, tau, **options)
    back = sa.inverse_dynamics(cfg, dq, there.ddq, **options)
    assert close(back.tau, tau, 1e-7)
    assert close(back.base_acceleration, there.base_acceleration, 1e-7)
    assert close(back.reaction, there.reaction, 1e-7)


@given(trees())
def test_generalized_inertia_from_the_centroidal_blocks(cfg):
    """H* = M_qq - A_q^T diag(M 1, D)^-1 A_q, symmetric, positive definite."""
    H = sa.generalized_inertia(cfg)
    c = np.zeros((6, 6))
    c[:3, :3], c[3:, 3:] = cfg.arm.mass * np.eye(3), cfg.A[3:, 3:6] @ cfg.base.rotation.T
    A_q = cfg.A[:, 6:]
    M_qq = sa.generalized_inertia(cfg, mode="fixed")
    expected = M_qq - A_q.T @ np.linalg.solve(c, A_q)
    assert np.abs(H - expected).max() <= 1e-9 * np.abs(M_qq).max()
    assert (np.linalg.eigvalsh(H) > -1e-12 * np.abs(M_qq).max()).all()
    held = sa.generalized_inertia(cfg, mode="attitude-controlled")
    for smaller, larger in ((H, held), (held, M_qq)):  # what yields feels lighter
        assert np.linalg.eigvalsh(larger - smaller).min() > -1e-9 * np.abs(M_qq).max()


@given(trees(), st.sampled_from(MODES))
def test_power_is_the_rate_of_kinetic_energy(cfg, mode):
    """dT/dt = tau . dq, by central differences along the motion; momentum held."""
    dq, tau, h = state(cfg)
    h = h if mode == "free-floating" else 0 * h
    cfg = cfg.with_momentum(h)
    found = sa.forward_dynamics(cfg, dq, tau, mode=mode)
    step = 1e-6
    energy = []
    for s in (-step, step):
        rate = dq + s * found.ddq
        v_b = spacecraft_twist(cfg, dq + 0.5 * s * found.ddq, mode)
        there = moved(cfg, dq + 0.5 * s * found.ddq, v_b, s)
        energy.append(sa.kinetic_energy(there.with_momentum(h), rate, mode=mode))
    power = (energy[1] - energy[0]) / (2 * step)
    scale = np.abs(tau * dq).sum() + sa.kinetic_energy(cfg, dq, mode=mode)
    assert power == pytest.approx(tau @ dq, abs=1e-5 * scale)


@pytest.mark.parametrize("name", MODELS)
def test_kinetic_energy_is_that_of_the_bodies(name):
    cfg = sa.load(name).at(
        np.linspace(-1, 1, sa.load(name).n), base=random_base(np.random.default_rng(1))
    )
    dq, _, h = state(cfg)
    cfg, model = cfg.with_momentum(h), cfg.arm.model
    v = np.concatenate((local(cfg, sa.base_velocity(cfg, dq)), dq))
    energy = pin.computeKineticEnergy(model, model.createData(), cfg.full, v)
    assert sa.kinetic_energy(cfg, dq) == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_at_rest_without_torques_nothing_moves(name):
    cfg = sa.load(name).at(np.full(sa.load(name).n, 0.3))
    for mode in MODES:
        found = sa.forward_dynamics(cfg, np.zeros(cfg.arm.n), np.zeros(cfg.arm.n), mode=mode)
        for part in (found.ddq, found.tau, found.base_acceleration, found.reaction, found.twist):
            assert not part.any()


@given(chains(), amounts)
def test_an_external_wrench_changes_momentum(cfg, size):
    """d/dt (linear, angular about the CM) is the wrench, moved to the CM: by differences."""
    dq, tau, _ = state(cfg)
    wrench = size * np.array([1.0, -2.0, 0.5, 0.3, 0.1, -0.7])
    found = sa.forward_dynamics(cfg, dq, tau, wrenches={"tip": wrench})
    M_b = sa.momentum_matrix(cfg)
    step = 1e-6
    momenta = []
    for s in (-step, step):
        rate = dq + s * found.ddq
        v_b = sa.base_velocity(cfg, dq)
        there = moved(cfg, dq + 0.5 * s * found.ddq, v_b + 0.5 * s * found.base_acceleration, s)
        matrix = sa.momentum_matrix(there)
        momenta.append(matrix.A_b @ (v_b + s * found.base_acceleration) + matrix.A_q @ rate)
    change = (momenta[1] - momenta[0]) / (2 * step)
    arm = cfg.tip.translation - cfg.com
    expected = np.concatenate((wrench[:3], wrench[3:] + np.cross(arm, wrench[:3])))
    scale = np.abs(M_b.A_q).max() * (1 + np.abs(found.ddq).max() + np.abs(dq).max() ** 2)
    assert np.abs(change - expected).max() <= 1e-5 * max(scale, 1.0)


@given(chains())
def test_the_reaction_torque_is_what_holds_the_attitude(cfg):
    """Without external wrenches it is the rate of the angular momentum about the system CM."""
    dq, tau, _ = state(cfg)
    found = sa.forward_dynamics(cfg, dq, tau, mode="attitude-controlled")
    assert not found.reaction[:3].any()
    step = 1e-6
    momenta = []
    for s in (-step, step):
        v_b = spacecraft_twist(cfg, dq + 0.5 * s * found.ddq, "attitude-controlled")
        there = moved(cfg, dq + 0.5 * s * found.ddq, v_b, s)
        assert not v_b[3:].any()
        rate = dq + s * found.ddq
        matrix = sa.momentum_matrix(there)
        twist = spacecraft_twist(there, rate, "attitude-controlled")
        momenta.append(matrix.A_b @ twist + matrix.A_q @ rate)
    change = (momenta[1] - momenta[0]) / (2 * step)
    scale = max(1.0, np.abs(found.reaction).max(), np.abs(momenta[0]).max())
    np.testing.assert_allclose(change[:3], 0.0, atol=1e-5 * scale)
    np.testing.assert_allclose(change[3:], found.reaction[3:], atol=2e-5 * scale)


def test_a_heavy_spacecraft_is_a_fixed_one():
    """The difference of the accelerations falls with the mass of the spacecraft."""
    arm = sa.load("mda6")
    inertia = arm.model.inertias[1].inertia
    differences = []
    for factor in (1e4, 1e6, 1e8):
        heavy = arm.replace(
            base_mass=factor * arm.model.inertias[1].mass, base_inertia=factor * inertia
        )
        cfg = heavy.at([0.3, 0.8, -1.1, 0.4, 0.5, -0.2])
        dq, tau, _ = state(cfg)
        floating = sa.forward_dynamics(cfg, dq, tau)
        fixed = sa.forward_dynamics(cfg, dq, tau, mode="fixed")
        differences.append(np.abs(floating.ddq - fixed.ddq).max() / np.abs(fixed.ddq).max())
    assert differences[0] / differences[1] == pytest.approx(100, rel=0.05)
    assert differences[1] / differences[2] == pytest.approx(100, rel=0.05)


def test_mimic_joints_share_their_torque():
    """Virtual work: an arm with a mimic joint is the full one, constrained."""
    seed = next(s for s in range(100) if "mimic" in random_tree(s, 5))
    arm = load_text(random_tree(seed, 5), tip="link_5", task=sa.Task("pose", 1.0), joints="all")
    cfg = arm.at(np.full(arm.n, 0.2))
    dq, tau, _ = state(cfg)
    found = sa.forward_dynamics(cfg, dq, tau)
    model, C = arm.model, arm.coupling
    v = np.concatenate((local(cfg, sa.base_velocity(cfg, dq)), C @ dq))
    a = np.concatenate((local(cfg, found.base_acceleration), C @ found.ddq))
    a[:3] -= np.cross(v[3:6], v[:3])
    force = pin.rnea(model, model.createData(), cfg.full, v, a)
    assert close(force[:6], np.zeros(6), 1) or np.abs(force[:6]).max() < 1e-9 * np.abs(force).max()
    assert close(C.T @ force[6:], tau)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (([0.0], [0.0, 0.0]), {}, r"dq has shape \(1,\)"),
        (([0.0, 0.0], [np.nan, 0.0]), {}, "tau of joint 'joint_1' is nan"),
        (([0.0, 0.0], [0.0, 0.0]), {"mode": "free"}, "free-floating"),
        (([0.0, 0.0], [0.0, 0.0]), {"wrenches": {"link_9": np.zeros(6)}}, "link_9"),
        (([0.0, 0.0], [0.0, 0.0]), {"wrenches": {"tip": [1.0]}}, "6 finite numbers"),
    ],
)
def test_bad_input(arguments, options, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.forward_dynamics(sa.load("planar2").at([0.1, 0.2]), *arguments, **options)


def impossible_planar2(izz):
    """planar2 with a last link of a moment of inertia that no body has, loaded all the same."""
    text = sa.load("planar2").path.read_text(encoding="utf-8")
    return load_text(text.replace('izz="0.25"', f'izz="{izz}"'), check="accept")


@pytest.mark.parametrize("mode", MODES)
def test_a_mass_matrix_that_is_not_positive_definite_is_an_error(mode):
    """LAPACK's factorisation stops there: what it leaves belongs to other torques."""
    cfg = impossible_planar2(-3.0).at([0.3, 0.4])
    wrong = r"planar2: .* is not positive definite \(least eigenvalue -\d.*check='error'"
    with pytest.raises(sa.ModelError, match=wrong):
        sa.forward_dynamics(cfg, [0.1, 0.2], [1.0, 0.0], mode=mode)
    with pytest.raises(sa.ModelError, match=wrong):
        sa.generalized_inertia(cfg, mode=mode)


def test_so_is_one_whose_spacecraft_part_is_not():
    cfg = impossible_planar2(-30.0).at([0.3, 0.4])
    wrong = r"planar2: the spacecraft's block M_bb of the mass matrix is not positive definite"
    for tell in (sa.forward_dynamics, sa.inverse_dynamics):
        with pytest.raises(sa.ModelError, match=wrong):
            tell(cfg, [0.1, 0.2], [1.0, 0.0])


def test_a_locked_inertia_that_is_singular_is_an_error():
    """The spacecraft's velocity does not follow from the momentum."""
    cfg = sa.load("planar2").at([0.3, 0.4])
    A = cfg.A.copy()
    A[5, 3:6] = 0.0
    with pytest.raises(sa.ModelError, match=r"planar2: the locked inertia D .* eigenvalue 0\)"):
        sa.kinetic_energy(replace(cfg, A=A), [0.1, 0.2])
