"""Catches by two hands: contact at once or in turn, braking along closure, momentum, refusals."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.closed import closed, densely
from scipy.integrate import simpson, solve_ivp
from scipy.interpolate import CubicHermiteSpline

import spacearm as sa
from spacearm.mission.kept_limits import with_checks
from spacearm.mission.two_hands import HandsApproach, impact, stopping
from spacearm.motion.flights import CLEARANCE, Grasp, held_loads

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


@pytest.fixture(scope="module")
def in_turn(start) -> sa.Catch:
    search, turns = sa.Search(timeout=3600.0, method="straight"), [{"right": "b"}, {"left": "a"}]
    return sa.catch(start, panel(), turns, window=(14, 14), approach=0.1, wanted=1, search=search)


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


def spacecraft(y) -> pin.SE3:
    """The pose of place and quaternion (7,)."""
    return pin.SE3(pin.Quaternion(y[3:] / np.linalg.norm(y[3:])).matrix(), y[:3].copy())


def drifted(parts, joints, momentum, y, span):
    """Where the spacecraft drifts while the joints move, by an integration of its own."""

    def rate(t, y):
        v = parts(t, y).spacecraft(joints(t, 1), momentum)
        turn = pin.Quaternion(y[3:] / np.linalg.norm(y[3:]))
        spin = (turn * pin.Quaternion(0.0, *v[3:])).coeffs() / 2
        return np.concatenate((turn.matrix() @ v[:3], spin))

    return solve_ivp(rate, span, y, rtol=1e-9, atol=1e-11, dense_output=True)


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
    assert "upper bound" in caught.margin
    assert caught.tried[-1].caught
    limits = [caught.arm.tree.joints[name] for name in caught.arm.joint_names]
    assert (np.abs(caught.chase.dq) <= [joint.velocity for joint in limits]).all()
    assert (caught.torque <= [joint.effort for joint in limits]).all()


@pytest.mark.slow
def test_the_braking_keeps_closure_and_the_momentum_of_the_target(in_turn):
    """Its joints alone, through a spline; the spacecraft by an integration of its own."""
    brake, target, arm = in_turn.brake, in_turn.target, in_turn.arm
    met, grasp = target.at(in_turn.t), target.grapples["a"]
    momentum = momentum_map(target, met.pose) @ met.twist
    joints = CubicHermiteSpline(brake.t, brake.q, brake.dq)

    def parts(t, y) -> Parts:
        return Parts(arm, joints(t), spacecraft(y), target, grasp)

    end = drifted(parts, joints, momentum, brake.base[0], brake.t[[0, -1]]).y[:, -1]
    np.testing.assert_allclose(end[:3], brake.base[-1, :3], rtol=0, atol=1e-7)
    turned = pin.Quaternion(end[3:]).inverse() * pin.Quaternion(brake.base[-1, 3:])
    assert np.linalg.norm(pin.log3(turned.matrix())) < 1e-7
    for t in np.linspace(0.0, brake.t[-1], 25):
        left, right = parts(t, brake.base[0]).tips
        off = left.actInv(right).actInv(grasp.actInv(target.grapples["b"]))
        assert np.linalg.norm(pin.log6(off).vector) < 1e-6  # between the rows, too
    assert max(brake.gap.max(), brake.gap_angle.max()) < 1e-9
    assert np.abs(brake.dq[-1]).max() < 1e-9
    np.testing.assert_allclose(brake.dq[0], in_turn.chase.dq[-1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(in_turn.momentum[:3], momentum[:3], rtol=0, atol=1e-6)


@pytest.mark.slow
def test_what_both_grapples_bear_changes_the_momentum_of_the_target(in_turn):
    """The integral of both wrenches about the origin is what its momentum changes by."""
    brake, target = in_turn.brake, in_turn.target
    given = list[np.ndarray]()
    for cfg, wrenches in zip(brake, brake.wrench.reshape(len(brake), 2, 2, 3), strict=True):
        total = np.zeros(6)
        for tip, (force, moment) in zip(cfg.tips, wrenches, strict=True):
            f = tip.rotation @ force
            total += [*f, *(tip.rotation @ moment + np.cross(tip.translation, f))]
        given.append(total)
    met, last, grasp = target.at(in_turn.t), brake[-1], target.grapples["a"]
    before = momentum_map(target, met.pose) @ met.twist
    pose = last.tips[0] * grasp.inverse()
    parts = Parts(in_turn.arm, last.q, last.base, target, grasp)
    v = np.append(parts.spacecraft(np.zeros(12), before), np.zeros(12))
    after = momentum_map(target, pose) @ about(pose, parts.tips[0]) @ parts.J[0] @ v
    change = after - before
    impulse = simpson(np.array(given), x=brake.t, axis=0)
    np.testing.assert_allclose(impulse, change, rtol=0, atol=0.01 * np.abs(change).max())


@pytest.mark.slow
def test_a_hand_that_holds_moves_with_the_target_while_the_other_closes_in(in_turn):
    """By its joints alone, without momentum: the target tumbles on as if nothing held it."""
    chase, arm, target = in_turn.chase, in_turn.arm, in_turn.target
    clock = in_turn.t - chase.t[-1] + chase.t
    first, last = in_turn.grasped["right"], in_turn.grasped["left"]
    assert (first, last) == (pytest.approx(12.0), 14.0)
    assert "right grasps after 12 s" in repr(in_turn.describe())
    joints = CubicHermiteSpline(clock, chase.q, chase.dq)
    row = int(np.searchsorted(clock, first))

    def parts(t, y) -> Parts:
        return Parts(arm, joints(t), spacecraft(y))

    way = drifted(parts, joints, 0.0, chase.base[row], clock[[row, -1]])
    for t in np.linspace(clock[row], last, 20):
        left, right = parts(t, way.sol(t)).tips
        off = right.actInv(target.at(t, "b").pose)
        assert np.linalg.norm(pin.log6(off).vector) < 1e-6
        closes = left.actInv(target.at(t, "a").pose)  # along its z axis
        np.testing.assert_allclose(closes.translation[:2], 0.0, rtol=0, atol=1e-6)
        np.testing.assert_allclose(closes.rotation, np.eye(3), rtol=0, atol=1e-6)
    assert in_turn.place_error < 1e-7
    np.testing.assert_allclose(in_turn.brake.dq[0], chase.dq[-1], rtol=0, atol=1e-6)


@pytest.mark.slow
def test_what_a_catch_says_of_the_braking_holds_between_its_samples(in_turn):
    """Torques and loads at times that are no samples, by the equations of the closed chain."""
    brake, n = in_turn.brake, in_turn.arm.n
    dense = densely(in_turn.held.carrying, brake, 400)
    assert (dense[:, :n] <= in_turn.torque * (1.0 + 1e-5)).all()
    loads = dense[:, n:].reshape(len(dense), -1, 2).max(axis=(0, 1))
    assert (loads <= brake.borne * (1.0 + 1e-5)).all()
    assert (brake.borne <= 1.06 * loads).all()


@pytest.mark.slow
def test_weaker_grapples_are_braked_more_slowly(in_turn, start):
    """Within the limit, and longer, from the same rates on."""
    quick = in_turn.brake

    def braked(bears) -> sa.Motion:
        request = HandsApproach.of(
            start, in_turn.target, HANDS, (12, 12), 0.1, 0.05, None, bears, sa.Constraints(), FREE
        )
        return request._braked(in_turn.held, quick.dq[0], np.full(12, 1.0), 0.01)

    slow = braked(0.3 * quick.borne)
    assert slow.t[-1] > quick.t[-1]
    assert (slow.borne <= 0.3 * quick.borne).all()
    assert (slow.borne / (0.3 * quick.borne)).max() > 0.97  # no braking is 1 % shorter
    assert max(slow.gap.max(), slow.gap_angle.max()) < 1e-9
    np.testing.assert_allclose(slow.dq[0], quick.dq[0], rtol=0, atol=1e-7)


@pytest.mark.slow
def test_in_flight_hands_grasp_in_turn_and_the_joints_come_to_rest(in_turn):
    """Simulated with closure forces, which are what changes the target's momentum. It is drawn."""
    flight, target = in_turn.fly(integration=COARSE), in_turn.target
    assert flight.names == ("approach", "closing in, right", "closing in, left", "braking")
    assert [event.t for event in flight.events if event.kind == "grasp"] == [
        pytest.approx(12.0), 14.0
    ]  # fmt: skip
    *_, one, both = flight.phases
    assert set(one.grasps) == {"right"}
    moving = 0.5 * target.mass * float(target.cm[1] @ target.cm[1])
    for run, hit in zip((one, both), flight.captures, strict=True):
        assert run.ended == "duration"
        assert max(run.gap.max(), run.gap_angle.max()) < 1e-9
        assert -1e-12 < hit.energy_lost < 1e-5 * moving
        np.testing.assert_allclose(run.momentum[-1], in_turn.momentum, rtol=0, atol=1e-5)
    assert np.abs(both.dq[-1]).max() < 1e-5
    np.testing.assert_allclose(both.q[-1], in_turn.brake.q[-1], rtol=0, atol=1e-5)
    assert flight.tip_wrench.shape == (len(flight), 12)
    held = flight.tip_wrench[(flight.t > one.t[1] + 12.0) & (flight.t <= 14.0)]
    assert np.abs(held).max() < 0.1 * np.abs(in_turn.brake.wrench).max()  # it is only followed
    bus = pin.XYZQUATToSE3(one.target[-1]).inverse() * target.at(14.0).pose
    assert np.linalg.norm(pin.log6(bus).vector) < 1e-5  # nothing has braked it
    whens = [
        line.get_xdata()[0] for line in sa.plot(in_turn).axes[0].lines if line.get_ls() == "--"
    ]
    assert set(in_turn.grasped.values()) <= set(whens)
    for drawn in (sa.plot(in_turn), sa.plot(flight)):
        assert len(drawn.axes) >= 3
    viewer = sa.view(flight, open=False)
    viewer.target(in_turn)
    assert "/spacearm/target" in viewer._stage.poses()["nodes"]
    with pytest.raises(sa.UnsupportedError, match="several tips"):
        sa.fly_many(in_turn)
    (near,) = [
        check
        for check in with_checks(flight, replace(in_turn.limits, clearance=9.0)).limits
        if check.limit == CLEARANCE
    ]
    phases = [flight.phase_distances(i) for i in range(4)]
    assert near.value == pytest.approx(min(one.min() for one in phases), rel=1e-2)
    assert near.exceeded == 0.0
    along = in_turn.brake.closure_distance  # the same posture is found, or one nearer
    assert phases[3].min() <= 1.05 * along.min()


def test_a_target_that_one_tip_holds_moves_as_a_payload(start):
    """The accelerations are those of an arm that has grasped it, and so are momentum and wrench."""
    one = start.arm.replace(tip="left", joints=start.arm.joint_names).at(START)
    bus, grasp = panel(), sa.pose((-0.15, 0.3, 0), (0.1, np.pi / 2, 0))
    held = sa.hold(one, bus.replace(pose=one.tip * grasp.inverse()), {"left": grasp})
    torque = np.linspace(-1.0, 1.0, 12)
    run = held.simulate(lambda *_: torque, 0.2, integration=COARSE)
    R, com = grasp.rotation, grasp.actInv(bus.com)
    body = Grasp(mass=bus.mass, inertia=R.T @ bus.inertia @ R, com=com)
    whole = one.arm.grasp(mass=body.mass, inertia=body.inertia, com=com)
    for i in (0, -1):
        cfg = whole.at(run.q[i], base=run[i].base)
        tau, wrench = held_loads(cfg, run.dq[i], run.ddq[i], body)
        np.testing.assert_allclose(tau, torque, rtol=0, atol=1e-6)
        turned = np.kron(np.eye(2), cfg.tip.rotation) @ wrench
        np.testing.assert_allclose(run.grasps["left"][i], turned, rtol=0, atol=1e-6)
    assert run.gap.max() < 1e-12


def test_hands_that_grasp_in_turn_close_in_one_after_the_other(start):
    """All follow the target; the one whose turn it is comes nearer along its axis."""
    turns = [{"right": "b"}, {"left": "a"}]
    given = start, panel(), turns, (14, 20), 0.1, 0.05, None, (9, 9), sa.Constraints(), FREE
    request = HandsApproach.of(*given)
    assert request.duration == (2.0, 4.0)
    ways = {name: request.path(14.0, name, nodes=6) for name in ("a", "b")}
    for name, begins in (("b", 2.0), ("a", 4.0)):
        poses, clock = ways[name]
        joined = [(t, pose) for t, pose in zip(clock, poses, strict=True) if t >= 2.0]
        off = [panel().at(8.0 + t, name).pose.actInv(pose).translation for t, pose in joined]
        np.testing.assert_allclose(np.array(off)[:, :2], 0.0, rtol=0, atol=1e-12)
        t, far = np.array([t for t, _ in joined]), -np.array(off)[:, 2]
        np.testing.assert_allclose(far[t <= begins], 0.1, rtol=0, atol=1e-12)
        np.testing.assert_allclose(far[t >= begins + 2.0], 0.0, rtol=0, atol=1e-12)
        assert (np.diff(far) <= 1e-12).all()


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
        ({}, {"grapple": [HANDS, {"left": "b"}]}, sa.ConfigurationError, "each tip of"),
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
