"""Wheels: the same as joints that spin, seen from outside."""

import re

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chosen, joint, link, load_text, random_base, robot, seeds, two_links
from helpers.wheels import FREE, WHEELS, with_wheels
from hypothesis import given

import spacearm as sa


def pair(seed: int):
    """A state with the wheels as joints, and the same with them as wheels."""
    rng = np.random.default_rng(seed)
    text = with_wheels(seed)
    full = load_text(text, tip="tip", task="position", joints="all")
    arm = load_text(text, tip="tip", task="position", wheels=WHEELS)
    q, base = rng.uniform(-3, 3, full.n), random_base(rng)
    dq = rng.normal(size=full.n)
    mine = [full.joint_names.index(name) for name in arm.joint_names]
    spin = dq[[full.joint_names.index(wheel.name) for wheel in arm.wheels]]
    cfg = arm.at(q[mine], base=base, wheels=0.45 * spin)
    h = rng.normal(size=6)
    full, cfg = full.at(q, base=base, momentum=h), cfg.with_momentum(h)
    return full, dq, cfg, dq[mine], mine, h


@given(seeds)
def test_the_spacecraft_moves_as_with_the_wheels_as_joints(seed):
    full, dq, cfg, rates, mine, _ = pair(seed)
    assert cfg.arm.n == full.arm.n - 3
    np.testing.assert_allclose(cfg.com, full.com, atol=1e-12)
    np.testing.assert_allclose(sa.base_velocity(cfg, rates), sa.base_velocity(full, dq), atol=1e-10)
    J = sa.generalized_jacobian(full)[:, mine]
    np.testing.assert_allclose(sa.generalized_jacobian(cfg), J, atol=1e-11)
    wheels = {wheel.name: 1.0 for wheel in cfg.arm.wheels}
    wheels = {name: dq[full.arm.joint_names.index(name)] for name in wheels}
    prescribed = sa.prescribed_motion(full, wheels)
    np.testing.assert_allclose(sa.prescribed_motion(cfg, {}).drift, prescribed.drift, atol=1e-10)


@given(seeds)
def test_total_momentum_is_base_arm_and_wheels(seed):
    full, dq, cfg, rates, _, h = pair(seed)
    A_b, A_q = sa.momentum_matrix(cfg)
    v_b = sa.base_velocity(full, dq)
    np.testing.assert_allclose(A_b @ v_b + A_q @ rates + cfg.stored, h, atol=1e-9)
    np.testing.assert_allclose(cfg.centred(np.zeros(3)).stored, cfg.stored, atol=1e-12)


@given(seeds)
def test_torques_and_accelerations_are_those_with_the_wheels_driven_at_constant_rates(seed):
    full, dq, cfg, rates, mine, _ = pair(seed)
    ddq = np.zeros(full.arm.n)
    ddq[mine] = np.linspace(-1, 1, len(mine))
    for base in ("free-floating", "attitude-controlled", "fixed"):
        a = sa.inverse_dynamics(full, dq, ddq, mode=base)
        b = sa.inverse_dynamics(cfg, rates, ddq[mine], mode=base)
        scale = 1e-10 * (1 + np.abs(a.tau).max() + np.abs(a.reaction).max())
        np.testing.assert_allclose(b.tau, a.tau[mine], atol=scale)
        np.testing.assert_allclose(b.base_acceleration, a.base_acceleration, atol=scale)
        np.testing.assert_allclose(b.reaction, a.reaction, atol=scale)
        back = sa.forward_dynamics(cfg, rates, b.tau, mode=base)
        np.testing.assert_allclose(back.ddq, ddq[mine], atol=1e-8)


def test_wheels_that_spin_up_turn_a_spacecraft_at_rest():
    """From rest, the total stays zero: I_c w_0 = -h_w."""
    parts = [*two_links(), link("rotor", 3.0, inertia=np.diag([0.1, 0.1, 0.2]))]
    text = robot(*parts, joint("spin", "bus", "rotor", "continuous", inside=FREE))
    arm = load_text(text, tip="arm", wheels=["spin"])
    cfg = arm.at([0.3], wheels=[4.0])
    w = sa.base_velocity(cfg, [0.0])[3:]
    I_c = sa.momentum_matrix(cfg).A_b[3:, 3:]
    np.testing.assert_allclose(I_c @ w, [0, 0, -4.0], atol=1e-13)
    assert not sa.base_velocity(arm.at([0.3]), [0.0]).any()
    np.testing.assert_array_equal(cfg.A, arm.at([0.3]).A)


def test_wheels_stay_wheels_in_a_written_file_and_under_an_arm(tmp_path):
    text = with_wheels(4)
    arm = load_text(text, tip="tip", task="position", wheels=WHEELS)
    again = sa.load(arm.to_urdf(tmp_path / "a.urdf"), task="position")
    spins = np.array([1.0, 2.0, 3.0])
    q = np.linspace(-1, 1, 3)
    np.testing.assert_allclose(
        again.at(q, wheels=spins).stored, arm.at(q, wheels=spins).stored, atol=1e-12
    )
    np.testing.assert_allclose(again.at(q).A, arm.at(q).A, atol=1e-12)
    theirs = pin.buildModelFromUrdf(str(tmp_path / "a.urdf"), pin.JointModelFreeFlyer())
    assert theirs.nv == 6 + 3 + 3
    hull = [link("hull", 80.0, inertia=10 * np.eye(3)), link("rotor", inertia=np.diag([1, 1, 2]))]
    spin = joint("spin", "hull", "rotor", "continuous", inside=FREE + "<wheel/>")
    (tmp_path / "hull.urdf").write_text(robot(*hull, spin))
    mounted = sa.mount("vispa", tmp_path / "hull.urdf")
    assert (mounted.n, [wheel.name for wheel in mounted.wheels]) == (6, ["spin"])
    free = load_text(text, tip="tip", task="position").replace(wheels=WHEELS)
    np.testing.assert_allclose(
        free.at(q, wheels=spins).stored, arm.at(q, wheels=spins).stored, atol=1e-12
    )


@pytest.mark.parametrize(
    ("rotor", "more", "message"),
    [
        (link("rotor", com=(0.01, 0, 0)), "", "wheel 'spin' is not balanced: its CM is 0.01 m off"),
        (link("rotor", inertia=np.diag([1, 2, 2.5])), "", "not the same all round its axis"),
        (
            link("rotor"),
            link("rod") + joint("j", "rotor", "rod"),
            "wheel 'spin' carries joint 'j'; leave it a joint",
        ),
    ],
)
def test_bodies_that_are_no_wheels_are_refused(rotor, more, message):
    text = robot(*two_links(), rotor, more, joint("spin", "bus", "rotor"))
    with pytest.raises(sa.ModelError, match=message):
        load_text(text, tip="arm", wheels=["spin"], joints="all")


def test_wheels_are_asked_for_with_care():
    parts = [*two_links(), link("rotor"), joint("spin", "bus", "rotor")]
    text = robot(*parts)
    with pytest.raises(sa.ConfigurationError, match="wheels: unknown turning joint 'spinn'"):
        load_text(text, tip="arm", wheels=["spinn"])
    sliding = robot(*two_links(), link("r"), joint("slide", "bus", "r", "prismatic"))
    with pytest.raises(sa.ConfigurationError, match="unknown turning joint 'slide'"):
        load_text(sliding, tip="arm", wheels=["slide"])
    marked = sliding.replace("</joint>\n</robot>", "<wheel/></joint>\n</robot>")
    with pytest.raises(sa.ModelError, match="of type 'prismatic' is a <wheel>; make it cont"):
        load_text(marked, tip="arm")
    arm = load_text(text, tip="arm", wheels=["spin"])
    for wheels in ([1.0, 2.0], [np.nan], "fast", 3.0):
        with pytest.raises(sa.ConfigurationError, match=r"give 1 finite .* each of: spin"):
            arm.at([0.1], wheels=wheels)
    with pytest.raises(sa.ConfigurationError, match="no wheel"):
        sa.load("planar2").at([0, 0], wheels=[1.0])


def test_a_joint_with_limits_is_written_as_a_wheel(tmp_path):
    text = robot(*two_links(), link("rotor"), joint("spin", "bus", "rotor"))
    arm = load_text(text, tip="arm", wheels=["spin"])
    again = sa.load(arm.to_urdf(tmp_path / "arm.urdf"))
    assert [wheel.name for wheel in again.wheels] == ["spin"]
    np.testing.assert_array_equal(again.at([0.3]).A, arm.at([0.3]).A)


def test_wheels_keep_what_they_hold_through_a_grasp():
    """The momentum of both is the sum of the parts about the common CM, wheels included."""
    text = robot(*two_links(), link("rotor"), joint("spin", "bus", "rotor"))
    arm, rng = load_text(text, tip="arm", wheels=["spin"]), chosen(0)
    cfg = arm.at([0.1], wheels=[2.0], momentum=rng.normal(size=6))
    v, w, mass, com = *rng.normal(size=(2, 3)), 1.5, rng.normal(size=3)
    found = sa.capture(cfg, [*v, *w], mass, 0.3 * np.eye(3), com, dq=[0.2])
    after = found.configuration
    body, p = cfg.tip.act(com), cfg.momentum[:3]
    angular = cfg.momentum[3:] + 0.3 * w + np.cross(cfg.com - after.com, p)
    angular += np.cross(body - after.com, mass * v)
    np.testing.assert_allclose(found.momentum, np.append(p + mass * v, angular), atol=1e-12)
    np.testing.assert_array_equal(after.wheels, cfg.wheels)
    assert found.energy_lost > 0.0


def test_what_cannot_bear_spinning_wheels_says_why():
    text = robot(*two_links(), link("rotor"), joint("spin", "bus", "rotor"))
    cfg = load_text(text, tip="arm", wheels=["spin"]).at([0.1], wheels=[2.0])
    with pytest.raises(sa.UnsupportedError, match=re.escape("turns with time, not with the joi")):
        sa.move(cfg, [0.2])
    still = cfg.arm.at([0.1])
    assert sa.move(still, [0.2]).q[0] == 0.2
