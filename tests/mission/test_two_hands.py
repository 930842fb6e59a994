"""Catches by two hands: contact of both at once, braking along closure, momentum, refusals."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.closed import closed
from scipy.integrate import simpson, solve_ivp
from scipy.interpolate import CubicHermiteSpline

import spacearm as sa
from spacearm.mission.two_hands import HandsApproach, impact, stopping

START = np.array([-0.3, -1.5, 2.1, -0.6, 1.3, -1.6] * 2)
HANDS = {"left": "a", "right": "b"}
FREE = "free-floating"
COARSE = sa.Integration(rtol=1e-6, atol=1e-8, dt=0.1)


@pytest.fixture(scope="module")
def start() -> sa.Configuration:
    return sa.load("dual_ur5", tip=["left", "right"]).at(START)


def panel(**changes) -> sa.Target:
    """A panel before both hands that tumbles at half a degree a second; z of the hands is its x."""
    forward = (0.0, np.pi / 2, 0.0)
    handles = {name: sa.pose((-0.15, y, 0), forward) for name, y in (("a", 0.3), ("b", -0.3))}
    values = {"twist": (0, 0.001, 0, 0.004, 0.006, -0.004), "grapples": handles}
    bus = sa.Bus(90, size=(0.1, 1.0, 0.5), com=(0.02, 0.05, 0.01), name="panel")
    return sa.Target(bus, sa.pose((0.75, 0.02, 0.7), (0.02, 0.05, -0.05)), **(values | changes))


@pytest.fixture(scope="module")
def caught(start) -> sa.Catch:
    search = sa.Search(timeout=3600.0, method="straight")
    return sa.catch(start, panel(), HANDS, window=(12, 12), approach=0.1, wanted=1, search=search)


class Parts:
    """Arm and target at one instant, by Pinocchio's centroidal map and frame Jacobians alone.

    The target is carried by the first tip. Momenta are about the inertial origin.
    """

    def __init__(self, arm, q, T, target=None, grasp=None) -> None:
        model, data = arm.model, arm.model.createData()
        full = np.concatenate((pin.SE3ToXYZQUAT(T), q))
        A = np.array(pin.computeCentroidalMap(model, data, full))
        com = pin.centerOfMass(model, data, full)
        A[3:] += pin.skew(com) @ A[:3]
        pin.computeJointJacobians(model, data, full)
        pin.updateFramePlacements(model, data)
        frames = arm.tip_frames
        self.tips = [data.oMf[i].copy() for i in frames]
        self.J = [pin.getFrameJacobian(model, data, i, pin.LOCAL_WORLD_ALIGNED) for i in frames]
        if target is not None:
            self.pose = self.tips[0] * grasp.inverse()
            A = A + momentum_map(target, self.pose) @ about(self.pose, self.tips[0]) @ self.J[0]
        self.A = A

    def spacecraft(self, dq, momentum=0.0) -> np.ndarray:
        """The twist (6,) of the spacecraft, its own axes, with which the momentum is kept."""
        return np.linalg.solve(self.A[:, :6], momentum - self.A[:, 6:] @ dq)


def about(pose, tip) -> np.ndarray:
    """The twist of a pose's origin by that of a tip on the same body."""
    return np.block(
        [[np.eye(3), -pin.skew(pose.translation - tip.translation)], [np.zeros((3, 3)), np.eye(3)]]
    )


def momentum_map(target, pose) -> np.ndarray:
    """The momentum (6,) of a target about the inertial origin, by the twist of its frame."""
    lever, R = pose.rotation @ target.com, pose.rotation
    linear = target.mass * np.hstack((np.eye(3), -pin.skew(lever)))
    spin = np.hstack((np.zeros((3, 3)), R @ target.inertia @ R.T))
    return np.vstack((linear, spin + pin.skew(pose.translation + lever) @ linear))


@pytest.mark.slow
def test_at_contact_both_tips_have_pose_and_twist_of_their_frames(caught):
    """By Pinocchio's Jacobians with zero momentum; twists of the frames by differences of poses."""
    end, dq, target = caught.chase[-1], caught.chase.dq[-1], caught.target
    parts = Parts(caught.arm, end.q, end.base)
    v = np.append(parts.spacecraft(dq), dq)
    for tip, J, name in zip(parts.tips, parts.J, HANDS.values(), strict=True):
        before, frame, after = (target.at(caught.t + h, name).pose for h in (-1e-3, 0, 1e-3))
        assert np.linalg.norm(pin.log6(tip.actInv(frame)).vector) < 1e-7
        moves = (after.translation - before.translation) / 2e-3
        turns = pin.log3(after.rotation @ before.rotation.T) / 2e-3
        np.testing.assert_allclose(J @ v, [*moves, *turns], rtol=0, atol=2e-6)
    assert caught.place_error < 1e-7
    assert caught.distance_proven == 0.0
    assert "to first order" in caught.margin
    assert caught.tried[-1].caught
    limits = [caught.arm.tree.joints[name] for name in caught.arm.joint_names]
    assert (np.abs(caught.chase.dq) <= [joint.velocity for joint in limits]).all()
    assert (caught.torque <= [joint.effort for joint in limits]).all()


@pytest.mark.slow
def test_the_braking_keeps_closure_and_the_momentum_of_the_target(caught):
    """Its joints alone, through a spline; the spacecraft by an integration of its own."""
    brake, target, arm = caught.brake, caught.target, caught.arm
    met, grasp = target.at(caught.t), target.grapples["a"]
    momentum = momentum_map(target, met.pose) @ met.twist
    joints = CubicHermiteSpline(brake.t, brake.q, brake.dq)

    def parts(t, y) -> Parts:
        R = pin.Quaternion(y[3:] / np.linalg.norm(y[3:])).matrix()
        return Parts(arm, joints(t), pin.SE3(R, y[:3].copy()), target, grasp)

    def rate(t, y):
        v = parts(t, y).spacecraft(joints(t, 1), momentum)
        turn = pin.Quaternion(y[3:] / np.linalg.norm(y[3:]))
        spin = (turn * pin.Quaternion(0.0, *v[3:])).coeffs() / 2
        return np.concatenate((turn.matrix() @ v[:3], spin))

    run = solve_ivp(rate, brake.t[[0, -1]], brake.base[0], rtol=1e-9, atol=1e-11)
    end = run.y[:, -1]
    np.testing.assert_allclose(end[:3], brake.base[-1, :3], rtol=0, atol=1e-7)
    turned = pin.Quaternion(end[3:]).inverse() * pin.Quaternion(brake.base[-1, 3:])
    assert np.linalg.norm(pin.log3(turned.matrix())) < 1e-7
    for t in np.linspace(0.0, brake.t[-1], 25):
        left, right = parts(t, brake.base[0]).tips
        off = left.actInv(right).actInv(grasp.actInv(target.grapples["b"]))
        assert np.linalg.norm(pin.log6(off).vector) < 1e-6  # between the rows, too
    assert max(brake.gap.max(), brake.gap_angle.max()) < 1e-9
    assert np.abs(brake.dq[-1]).max() < 1e-9
    np.testing.assert_allclose(brake.dq[0], caught.chase.dq[-1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(caught.momentum[:3], momentum[:3], rtol=0, atol=1e-6)


@pytest.mark.slow
def test_what_both_grapples_bear_changes_the_momentum_of_the_target(caught):
    """The integral of both wrenches about the origin is what its momentum changes by."""
    brake, target = caught.brake, caught.target
    given = list[np.ndarray]()
    for cfg, wrenches in zip(brake, brake.wrench.reshape(len(brake), 2, 2, 3), strict=True):
        total = np.zeros(6)
        for tip, (force, moment) in zip(cfg.tips, wrenches, strict=True):
            f = tip.rotation @ force
            total += [*f, *(tip.rotation @ moment + np.cross(tip.translation, f))]
        given.append(total)
    met, last, grasp = target.at(caught.t), brake[-1], target.grapples["a"]
    before = momentum_map(target, met.pose) @ met.twist
    pose = last.tips[0] * grasp.inverse()
    parts = Parts(caught.arm, last.q, last.base, target, grasp)
    v = np.append(parts.spacecraft(np.zeros(12), before), np.zeros(12))
    after = momentum_map(target, pose) @ about(pose, parts.tips[0]) @ parts.J[0] @ v
    change = after - before
    impulse = simpson(np.array(given), x=brake.t, axis=0)
    np.testing.assert_allclose(impulse, change, rtol=0, atol=0.01 * np.abs(change).max())


@pytest.mark.slow
def test_weaker_grapples_are_braked_more_slowly(caught, start):
    """Within the limit, and longer, from the same rates on."""
    quick = caught.brake

    def braked(bears) -> sa.Motion:
        request = HandsApproach.of(
            start, caught.target, HANDS, (12, 12), 0.1, 0.05, None, bears, sa.Constraints(), FREE
        )
        return request._braked(caught.held, quick.dq[0], np.full(12, 1.0), 0.01)

    slow = braked(0.3 * quick.borne)
    assert slow.t[-1] > quick.t[-1]
    assert (slow.borne <= 0.3 * quick.borne).all()
    assert max(slow.gap.max(), slow.gap_angle.max()) < 1e-9
    np.testing.assert_allclose(slow.dq[0], quick.dq[0], rtol=0, atol=1e-7)


@pytest.mark.slow
def test_in_flight_both_hands_grasp_and_the_joints_come_to_rest(caught):
    """Simulated with closure forces; a target that differs costs energy. Both are drawn."""
    flight = caught.fly(integration=COARSE)
    assert flight.names == ("approach", "closing in", "braking")
    run = flight.phases[-1]
    assert run.ended == "duration"
    assert max(run.gap.max(), run.gap_angle.max()) < 1e-9
    assert np.abs(run.dq[-1]).max() < 1e-5
    target = caught.target
    moving = 0.5 * target.mass * float(target.cm[1] @ target.cm[1])
    assert -1e-12 < flight.captures[0].energy_lost < 1e-5 * moving
    np.testing.assert_allclose(run.momentum[-1], caught.momentum, rtol=0, atol=1e-5)
    np.testing.assert_allclose(run.q[-1], caught.brake.q[-1], rtol=0, atol=1e-5)
    assert flight.tip_wrench.shape == (len(flight), 12)
    for drawn in (sa.plot(caught), sa.plot(flight)):
        assert len(drawn.axes) >= 3
    viewer = sa.view(flight, open=False)
    viewer.target(caught)
    assert "/spacearm/target" in viewer._stage.poses()["nodes"]
    with pytest.raises(sa.UnsupportedError, match="several tips"):
        sa.fly_many(caught)


@pytest.mark.parametrize("seed", range(4))
def test_an_impact_of_both_hands_keeps_the_momentum_and_closes_the_velocities(seed):
    """Of a random closed chain, hands and target with any velocities: energy is lost, none won."""
    held, rng = closed(seed), np.random.default_rng(seed)
    arm, cfg, target = held.arm, held.configuration, held.target
    dq, twist, grasps = rng.normal(size=arm.n), rng.normal(size=6), list(held.grasps.values())
    hit = impact(held, dq, twist)
    parts = Parts(arm, cfg.q, cfg.base)
    whole = Parts(arm, cfg.q, cfg.base, target, grasps[0])
    before = momentum_map(target, target.pose) @ twist
    turned = np.kron(np.eye(2), cfg.base.rotation.T)
    after = np.append(turned @ hit.twist, hit.dq)
    size = np.abs(before).max() + np.abs(whole.A[:, 6:] @ dq).max()
    np.testing.assert_allclose(whole.A @ after, before, rtol=0, atol=1e-9 * size)
    moved = [
        about(target.pose, tip) @ J @ after for tip, J in zip(parts.tips, parts.J, strict=True)
    ]
    np.testing.assert_allclose(moved[0], moved[1], rtol=0, atol=1e-8 * np.abs(moved[0]).max())
    assert hit.energy_lost > 0.0
    moving = replace(held, configuration=cfg.with_momentum(cfg.A @ after))
    again = impact(moving, hit.dq, moved[0])  # nothing strikes
    np.testing.assert_allclose(again.dq, hit.dq, rtol=0, atol=1e-8 * np.abs(hit.dq).max())


def test_the_screw_that_stops_begins_with_its_twist_and_ends_at_rest():
    twist, pose = np.array([0.1, -0.2, 0.05, 0.3, 0.1, -0.2]), sa.pose((1, 2, 3), (0.1, 0.2, 0.3))
    piece, h = stopping(pose, twist), 1e-5
    for t in (0.0, 0.3, 0.8):
        a, b = piece.pose(t), piece.pose(t + h)
        moved = np.append(b.translation - a.translation, pin.log3(b.rotation @ a.rotation.T)) / h
        np.testing.assert_allclose(moved, piece.twist(t + h / 2), rtol=0, atol=1e-8)
    np.testing.assert_allclose(piece.twist(0.0), twist, rtol=0, atol=0)
    np.testing.assert_allclose(piece.twist(1.0), np.zeros(6), rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("changes", "options", "error", "words"),
    [
        ({}, {"grapple": {"left": "a"}}, sa.UnsupportedError, "grapple={tip: frame}"),
        ({}, {"grapple": "a"}, sa.UnsupportedError, "grapple={tip: frame}"),
        ({}, {"grapple": {"left": "a", "middle": "b"}}, sa.ConfigurationError, "each tip of"),
        ({}, {"grapple": {"left": "a", "right": "c"}}, sa.ConfigurationError, "'c'"),
        ({}, {"grapple": {"left": "a", "right": "a"}}, sa.ConfigurationError, "frame of its own"),
        ({}, {"mode": "attitude-controlled"}, sa.UnsupportedError, "leave out mode"),
        ({"momentum": [0, 0, 0, 1, 0, 0]}, {}, sa.UnsupportedError, "momentum on board"),
    ],
)
def test_what_two_hands_cannot_do_is_named(start, changes, options, error, words):
    there = start.arm.at(START, **changes)
    with pytest.raises(error, match=words.replace("{", "[{]")):
        sa.catch(there, panel(), **{"grapple": HANDS, **options})


def test_one_tip_may_be_named_too():
    """Of an arm with one tip a mapping is the name of its frame."""
    one = sa.load("dual_ur5", tip="left").at(START[:6])
    with pytest.raises(sa.ConfigurationError, match="'c'"):
        sa.catch(one, panel(), {"left": "c"})
    with pytest.raises(sa.ConfigurationError, match="tip of"):
        sa.catch(one, panel(), {"right": "a"})
