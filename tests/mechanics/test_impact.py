"""Payloads and captures: limits, conservation of momentum, energy that never grows."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import (
    frame,
    joint,
    link,
    load_text,
    random_base,
    random_inertia,
    random_tree,
    robot,
    seeds,
)
from hypothesis import given, settings
from hypothesis import strategies as st

import spacearm as sa

INERTIA = np.array([[0.6, 0.1, 0.0], [0.1, 0.8, -0.1], [0.0, -0.1, 0.9]])
COM = np.array([0.1, -0.2, 0.5])


def random_state(seed: int):
    """A random tree with its tip, in motion and with momentum, and a random target in motion."""
    rng = np.random.default_rng(seed)
    arm = load_text(random_tree(seed, 5), tip="link_5", task=sa.Task("pose", 1.0), joints="all")
    q, base = rng.uniform(-np.pi, np.pi, arm.n), random_base(rng)
    mass = 10 ** rng.uniform(-1, 3)
    target = {"mass": mass, "inertia": random_inertia(rng, mass), "com": rng.normal(size=3)}
    dq, h = rng.normal(size=arm.n), 10 * rng.normal(size=6)
    return arm.at(q, base=base, momentum=h), target, dq, rng.normal(size=6)


def momentum_of_parts(links, velocities):
    """Linear momentum, angular momentum about the inertial origin, energy: summed over links."""
    P, L, T = np.zeros(3), np.zeros(3), 0.0
    for name, (pose, part) in links.items():
        v, w = velocities[name][:3], velocities[name][3:]
        R, c = pose.rotation, pose.translation + pose.rotation @ part.lever
        v_c = v + np.cross(w, pose.rotation @ part.lever)
        I = R @ part.inertia @ R.T
        P += part.mass * v_c
        L += np.cross(c, part.mass * v_c) + I @ w
        T += 0.5 * (part.mass * v_c @ v_c + w @ I @ w)
    return P, L, T


def links_of(cfg):
    arm = cfg.arm
    data = arm.model.createData()
    pin.framesForwardKinematics(arm.model, data, cfg.full)
    poses = {name: data.oMf[arm.model.getFrameId(name, pin.BODY)] for name in arm.tree.links}
    return {n: (poses[n], part.spatial()) for n, part in arm.tree.links.items() if part}


def velocities_before(cfg, dq):
    """By finite differences, which share nothing with the capture."""
    h = 1e-6
    v_b = sa.base_velocity(cfg, dq)
    ends = []
    for t in (-h, h):
        pose = pin.SE3(
            pin.exp3(t * v_b[3:]) @ cfg.base.rotation, cfg.base.translation + t * v_b[:3]
        )
        ends.append(links_of(cfg.arm.at(cfg.q + t * dq, base=pose)))
    twists = {}
    for name in ends[0]:
        a, b = ends[0][name][0], ends[1][name][0]
        turn = pin.log3(b.rotation @ a.rotation.T)
        twists[name] = np.concatenate((b.translation - a.translation, turn)) / (2 * h)
    return twists


@given(seeds, st.sampled_from(["free", "braked"]))
def test_momentum_is_kept_and_energy_never_grows(seed, joints):
    cfg, target, dq, twist = random_state(seed)
    after = sa.capture(cfg, twist, **target, dq=dq, joints=joints)
    P, L, T = momentum_of_parts(links_of(cfg), velocities_before(cfg, dq))
    R, m = cfg.tip.rotation, target["mass"]
    c = cfg.tip.act(target["com"])
    I = R @ target["inertia"] @ R.T
    P, L = P + m * twist[:3], L + np.cross(c, m * twist[:3]) + I @ twist[3:]
    T += 0.5 * (m * twist[:3] @ twist[:3] + twist[3:] @ I @ twist[3:])
    held = after.configuration
    P2, L2, T2 = momentum_of_parts(links_of(held), after.velocities)
    scale = max(np.abs(P).max(), np.abs(L).max(), 1.0)
    np.testing.assert_allclose(P2, P, atol=1e-7 * scale)  # finite differences stand on the right
    np.testing.assert_allclose(L2, L, atol=1e-7 * scale)
    assert after.energy_lost >= 0.0
    assert pytest.approx(T - after.energy_lost, rel=1e-6) == T2


@given(seeds, st.sampled_from(["free", "braked"]))
@settings(max_examples=40)
def test_momentum_is_kept_to_rounding(seed, joints):
    """About the inertial origin: h of the arm before and of the target, h of both after."""
    cfg, target, dq, twist = random_state(seed)
    after = sa.capture(cfg, twist, **target, dq=dq, joints=joints)
    h, held = cfg.momentum, after.configuration
    R, m, c = cfg.tip.rotation, target["mass"], cfg.tip.act(target["com"])
    P = h[:3] + m * twist[:3]
    spin = R @ target["inertia"] @ R.T @ twist[3:]
    L = h[3:] + np.cross(cfg.com, h[:3]) + np.cross(c, m * twist[:3]) + spin
    P2, L2, T2 = momentum_of_parts(links_of(held), after.velocities)
    scale = 1e-12 * (np.abs(P).max() + np.abs(L).max() + m * np.linalg.norm(twist) + 100.0)
    np.testing.assert_allclose(P2, P, atol=scale, rtol=0)
    np.testing.assert_allclose(L2, L, atol=scale, rtol=0)
    total = np.concatenate((P2, L2 - np.cross(held.com, P2)))
    np.testing.assert_allclose(after.momentum, total, atol=scale, rtol=0)
    np.testing.assert_array_equal(held.momentum, after.momentum)
    assert sa.kinetic_energy(held, after.dq) == pytest.approx(T2)
    if joints == "braked":
        assert not after.dq.any()


def test_the_impulse_is_what_changes_the_target():
    cfg, target, dq, twist = random_state(5)
    after = sa.capture(cfg, twist, **target, dq=dq)
    v = after.velocities["link_5"]
    R = cfg.tip.rotation
    lever = R @ target["com"]
    v_c = v[:3] + np.cross(v[3:], lever)
    linear = target["mass"] * (twist[:3] - v_c)
    spin = R @ target["inertia"] @ R.T @ (twist[3:] - v[3:])
    np.testing.assert_allclose(after.impulse[:3], linear, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        after.impulse[3:], spin + np.cross(lever, linear), rtol=1e-9, atol=1e-12
    )


def test_a_target_that_moves_with_the_tip_gives_no_impact():
    cfg = sa.load("chaser7").at(np.linspace(-1, 1, 7))
    dq = np.linspace(0.1, -0.2, 7)
    tip = sa.generalized_jacobian(cfg) @ dq
    moving = np.concatenate((tip[:3] + np.cross(tip[3:], cfg.tip.rotation @ COM), tip[3:]))
    after = sa.capture(cfg, moving, 500.0, 100 * INERTIA, COM, dq=dq)
    np.testing.assert_allclose(after.dq, dq, atol=1e-12)
    np.testing.assert_allclose(after.twist, sa.base_velocity(cfg, dq), atol=1e-12)
    assert after.energy_lost < 1e-20


def test_two_points_stick_together():
    """All in a line: the closed form of the plastic impact."""
    cfg = sa.load("planar2").at([0.0, 0.0])
    after = sa.capture(cfg, [-2, 0, 0, 0, 0, 0], 47.0)
    np.testing.assert_allclose(after.twist[:3], [-1, 0, 0], atol=1e-13)
    assert after.energy_lost == pytest.approx(0.5 * 47 * 4 / 2)


def test_a_light_target_is_no_target():
    cfg = sa.load("mda6").at(np.linspace(-1, 1, 6))
    dq = np.linspace(0.1, -0.2, 6)
    after = sa.capture(cfg, np.ones(6), 1e-9, 1e-9 * INERTIA, COM, dq=dq)
    np.testing.assert_allclose(after.dq, dq, atol=1e-6)
    assert abs(after.energy_lost) < 1e-6


@given(seeds)
def test_grasping_less_and_less_tends_to_the_free_arm(seed):
    rng = np.random.default_rng(seed)
    arm = load_text(random_tree(seed, 5), tip="link_5", task=sa.Task("pose", 1.0), joints="all")
    q = rng.uniform(-np.pi, np.pi, arm.n)
    free = sa.generalized_jacobian(arm.at(q))
    distance = [
        np.abs(sa.generalized_jacobian(arm.grasp(m, m * INERTIA, COM).at(q)) - free).max()
        for m in (1e-3, 1e-5, 1e-7)
    ]
    scale = np.abs(free).max()
    assert distance[2] < 1e-5 * scale
    assert distance[1] < 0.02 * distance[0] + 1e-12 * scale
    assert distance[2] < 0.02 * distance[1] + 1e-12 * scale


def test_the_payload_is_a_body_of_its_own_at_the_tip():
    arm = sa.load("mda6")
    held = arm.grasp(300.0, 100 * INERTIA, COM)
    q = np.linspace(-1, 1, 6)
    a, b = arm.at(q), held.at(q)
    assert held.mass == pytest.approx(arm.mass + 300.0)
    assert b.tip.isApprox(a.tip, 1e-14)
    com = (arm.mass * a.com + 300.0 * a.tip.act(COM)) / held.mass
    np.testing.assert_allclose(b.com, com, atol=1e-12)
    twice = arm.grasp(100.0, com=COM).grasp(200.0, 100 * INERTIA, COM)
    np.testing.assert_allclose(twice.at(q).A, b.A, atol=1e-9)
    assert {"payload", "payload_2"} <= twice.tree.links.keys()


def test_what_follows_from_the_arm_follows_the_payload(tmp_path):
    """Singular set, workspace and URDF are of the arm with its payload."""
    arm = sa.load("planar2")
    held = arm.grasp(20.0, np.diag([1.0, 1.0, 2.0]), (0.3, 0, 0))
    q = sa.singular_set(held).sample(1, np.random.default_rng(1))[0]
    assert sa.singularity(held.at(q)).sigma_min < 1e-9
    assert sa.singularity(arm.at(q)).sigma_min > 1e-3
    assert sa.workspace(held).reachable[0, 1] < sa.workspace(arm).reachable[0, 1]
    again = sa.load(held.to_urdf(tmp_path / "held.urdf"))
    np.testing.assert_allclose(again.at(q).A, held.at(q).A, atol=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda a: a.grasp(0.0), "mass is 0 kg; give a positive mass"),
        (lambda a: a.grasp(1.0, np.diag([1, 1, 3.0])), "the payload .*triangle inequality"),
        (lambda a: a.grasp(1.0, com=(1, 2)), "com is"),
        (lambda a: sa.capture(a.at([0, 0]), [1, 2], 1.0), "target_twist is"),
        (lambda a: sa.capture(a.at([0, 0]), np.nan * np.ones(6), 1.0), "target_twist is"),
        (lambda a: sa.capture(a.at([0, 0]), np.ones(6), 1.0, joints="fixed"), "unknown joints"),
        (lambda a: sa.capture(a.at([0, 0]), np.ones(6), 1.0, dq=[1]), "dq has shape"),
    ],
)
def test_impossible_payloads_are_refused(call, message):
    with pytest.raises(sa.SpaceArmError, match=message):
        call(sa.load("planar2"))


def test_an_arm_whose_mass_matrix_is_not_positive_definite_is_refused():
    """Its kinetic energy could grow in a grasp."""
    text = sa.load("planar2").path.read_text(encoding="utf-8")
    arm = load_text(text.replace('izz="0.25"', 'izz="-3"'), check="accept")
    with pytest.raises(sa.ModelError, match="planar2: the mass matrix M is not positive definite"):
        sa.capture(arm.at([0.3, 0.4]), [0.1, 0, 0, 0, 0, 0], 5.0, np.eye(3))


@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
def test_a_tip_so_far_away_that_rounding_makes_masses_singular_is_refused():
    """Where a pivot is just above zero, the momentum of the target is what is too large."""
    parts = (link("bus", 0.001, inertia=1e-12 * np.eye(3)), link("arm", com=(1, 0, 1)))
    hand = joint("hand", "arm", "tip", "fixed", xyz=(1e12, 0, 0))
    text = robot(*parts, joint("1", "bus", "arm", axis=(0, 1, 0)), frame("tip"), hand)
    cfg = load_text(text, check="accept", tip="tip", task="x").at([0.3])
    refused = sa.ModelError, sa.ConfigurationError
    with pytest.raises(refused, match=r"not positive definite|momentum is "):
        sa.capture(cfg, np.ones(6), 1e12, 1e12 * np.eye(3))
