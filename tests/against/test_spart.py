"""What spartpy 1.1.3 computes differently, and where the difference comes from.

Its inverse dynamics sums the inertial forces of the first n links, n the number of joints that
move (the C source runs that loop to nQ), so that as many links as there are fixed joints have
none: with a massive link on a fixed joint the accelerations are wrong as soon as something moves.
Its velocities take the link listed before, not the parent, as the one that carries a link.
"""

import numpy as np
import pinocchio as pin
import pytest
from comparison import states
from conventions import Answers, Spacearm, spart_model, urdf
from helpers.arms import load_text, random_tree

import spacearm as sa

pytest.importorskip("SPARTpy", reason="pip install spacearm[against]")


def spart_acceleration(model, cfg, v, tau):
    """Joint accelerations of an arm whose spacecraft has its CM in its frame's origin."""
    R, r = cfg.base.rotation, cfg.base.translation
    u = np.concatenate((R.T @ v[3:6], v[:3], v[6:]))
    _, RL, _, rL, e, g = model.kinematics(R, r, cfg.q)
    Bij, Bi0, P0, pm = model.diff_kinematics(R, r, rL, e, g)
    t0, tL = model.velocities(Bij, Bi0, P0, pm, u[:6], u[6:])
    I0, Im = model.i_i(R, RL)
    none = np.zeros_like(tL)
    frames, bodies = (t0, tL, P0, pm), (I0, Im, Bij, Bi0)
    return model.forward_dynamics(
        none[:, 0], tau, none[:, 0], none, *frames, *bodies, u[:6], u[6:]
    )[1]


def inertial_wrench(cfg, v, link):
    """Of a link with its CM in its origin, while no velocity of SPART's changes: (6,) [f; torque].

    Those are the spacecraft's angular velocity in its own axes, its linear one in inertial axes.
    """
    arm, R = cfg.arm, cfg.base.rotation
    own = np.concatenate((R.T @ v[:3], R.T @ v[3:6], v[6:]))
    rate = np.zeros_like(own)
    rate[:3] = -np.cross(own[3:6], own[:3])  # spatial acceleration of a straight motion
    data = arm.model.createData()
    pin.forwardKinematics(arm.model, data, cfg.full, own, rate)
    frame, body = arm.model.getFrameId(link), arm.tree.links[link]
    pin.updateFramePlacements(arm.model, data)
    a = pin.getFrameClassicalAcceleration(arm.model, data, frame, pin.LOCAL_WORLD_ALIGNED)
    w = pin.getFrameVelocity(arm.model, data, frame, pin.LOCAL_WORLD_ALIGNED).angular
    turned = data.oMf[frame].rotation
    inertia = turned @ body.inertia @ turned.T
    torque = inertia @ a.angular + np.cross(w, inertia @ w)
    return np.concatenate((body.mass * a.linear, torque))


def test_the_accelerations_lack_the_inertial_forces_of_the_last_link():
    arm = sa.load("chaser7")
    model = spart_model(urdf(arm))
    for state in states(arm):
        cfg, v, tau = state
        found = spart_acceleration(model, cfg, v, tau)
        ours: Answers = Spacearm()(state)
        scale = np.abs(ours.acceleration[6:]).max()
        assert np.abs(found - ours.acceleration[6:]).max() > 1e-3 * scale
        lacking = {arm.tip: inertial_wrench(cfg, v, arm.tip)}
        moving = cfg.with_momentum(ours.momentum)
        explained = sa.forward_dynamics(moving, v[6:], tau, wrenches=lacking).ddq
        np.testing.assert_allclose(found, explained, rtol=0, atol=1e-10 * scale)


def test_at_rest_the_accelerations_agree():
    arm = sa.load("chaser7")
    for cfg, v, tau in states(arm):
        found = spart_acceleration(spart_model(urdf(arm)), cfg, 0 * v, tau)
        ours = sa.forward_dynamics(cfg, 0 * v[6:], tau).ddq
        np.testing.assert_allclose(found, ours, rtol=0, atol=1e-10 * np.abs(ours).max())


def test_velocities_are_handed_on_from_the_link_listed_before():
    arm = load_text(random_tree(0, 6), tip="link_6", task="position", joints="all")
    model = spart_model(urdf(arm))
    rng = np.random.default_rng(0)
    q, um, u0 = rng.normal(size=6), rng.normal(size=6), rng.normal(size=6)
    _, _, _, rL, e, g = model.kinematics(np.eye(3), np.zeros(3), q)
    Bij, Bi0, P0, pm = model.diff_kinematics(np.eye(3), np.zeros(3), rL, e, g)
    t0, found = model.velocities(Bij, Bi0, P0, pm, u0, um)
    before, behind = np.zeros((6, 6)), np.zeros((6, 6))
    for i, joint in enumerate(model.robot.joints):
        parent, own = int(joint.parent_link) - 1, pm[:, i] * um[int(joint.q_id) - 1]
        for twists, carrier in ((before, i - 1), (behind, parent)):
            handed = Bi0[i] @ t0 if parent < 0 else Bij[i, carrier] @ twists[:, carrier]
            twists[:, i] = handed + own
    np.testing.assert_allclose(found, before, rtol=0, atol=1e-12)
    assert np.abs(found - behind).max() > 0.1
