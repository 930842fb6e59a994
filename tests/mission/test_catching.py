"""Catches: contact without impact, momentum by parts, limits kept, and clear reasons why not."""

from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, numbers, with_wheels
from scipy.interpolate import BPoly

import spacearm as sa
from spacearm.mission.approaching import Approach
from spacearm.mission.braking import braked
from spacearm.mission.catch_report import grasp_of
from spacearm.motion.flights import load_peaks
from spacearm.planning.account import SearchAccount, TimeUpError

START = np.array([0.0, 0.6, 0.0, 1.2, 0.0, 0.8, 0.0])
RING = sa.pose((0, 0, -0.45))
LARGE = sa.WheelHold(stiffness=0.0, damping=0.0, torque=20.0, capacity=40.0)
HELD = "attitude-controlled"
COARSE = sa.Integration(rtol=1e-7, atol=1e-9, dt=0.1)
STRAIGHT = sa.Search(method="straight", timeout=3600.0)
"""Straight ways only: so many tries, however loaded the machine is."""


def tumbling(cfg, w=(0.02, 0.03, 0.02), off=(0.1, 0.1, 0.35), mass=60.0, **changes) -> sa.Target:
    """A box whose grapple frame is before the hand at time 0, and turns with w."""
    ring = cfg.tip * sa.pose(off, (0.2, 0.1, 0.0))
    values = {"twist": (0.0, 0.002, 0.0, *w), "grapples": {"ring": RING}}
    bus = sa.Bus(mass, size=(0.6, 0.6, 0.8), com=(0.02, 0.0, 0.05), name="debris")
    return sa.Target(bus, ring * RING.inverse(), **(values | changes))


@pytest.fixture(scope="module")
def caught() -> sa.Catch:
    """A catch of a target that tumbles at 2.4 deg/s."""
    start = sa.load("chaser7").at(START)
    return sa.catch(start, tumbling(start), window=(10, 30), wanted=1, search=STRAIGHT)


def test_at_contact_the_tip_has_pose_and_twist_of_the_frame(caught):
    """By J* of Pinocchio's momentum matrices; the twist of the frame by differences of its pose."""
    end, dq = caught.chase[-1], caught.chase.dq[-1]
    before, frame, after = (caught.target.at(caught.t + h, "ring").pose for h in (-1e-3, 0, 1e-3))
    assert np.linalg.norm(pin.log6(end.tip.actInv(frame)).vector) < 1e-7
    v = (after.translation - before.translation) / 2e-3
    w = pin.log3(after.rotation @ before.rotation.T) / 2e-3
    twist = sa.generalized_jacobian(end) @ dq
    np.testing.assert_allclose(twist, np.concatenate((v, w)), rtol=0, atol=2e-6)
    assert caught.place_error < 1e-7
    assert np.abs(caught.twist_error).max() < 2e-6


def in_orbit(off, momentum=(0.0,) * 6) -> Approach:
    """A catch that is asked for in low orbit, all of it shifted by off [m]."""
    start = sa.load("chaser7").at(START, base=sa.pose(off), momentum=momentum)
    other = tumbling(start, name="other", orbit=0.0011).replace(
        pose=sa.pose(np.add(off, (0.0, 9.0, 0.0)))
    )
    return Approach.of(
        start, tumbling(start, orbit=0.0011), None, (30, 40), 0.2, 0.05, None, (np.inf, np.inf),
        sa.Constraints(obstacles=other), "free-floating",
    )  # fmt: skip


def test_in_orbit_target_and_obstacles_drift_relative_to_the_cm_of_the_chaser():
    """The same 50 m off radially; a later beginning of a motion changes nothing."""
    here, there = in_orbit(np.zeros(3)), in_orbit([50.0, 0.0, 0.0])
    for one, other in zip(here._around(0.0), there._around(0.0), strict=True):
        for a, b in zip(one.poses(30.0), other.poses(30.0), strict=True):
            moved = b.translation - a.translation
            np.testing.assert_allclose(moved, [50.0, 0.0, 0.0], rtol=0, atol=1e-12)
    for one, late in zip(there._around(0.0), there._around(12.0), strict=True):
        for a, b in zip(one.poses(30.0), late.poses(18.0), strict=True):
            np.testing.assert_allclose(a.homogeneous, b.homogeneous, rtol=0, atol=1e-12)


@pytest.mark.parametrize("number", [0, 1])
def test_linear_momentum_on_board_counts_in_orbit(number):
    """In the axes of the chaser's CM all moves as if its velocity were that of the frame.

    Number 0 is the obstacle, 1 the target.
    """
    velocity, t, n = np.array([0.03, -0.02, 0.01]), 300.0, 0.0011
    still = in_orbit(np.zeros(3))
    p = velocity * still.start.arm.mass
    drifts = in_orbit(np.zeros(3), np.append(p, np.zeros(3)))
    a, b = still._around(0.0)[number].target, drifts._around(0.0)[number].target
    faster = b.replace(twist=b.twist + np.append(velocity, np.zeros(3)))
    seen = faster.at(t).pose.translation - t * velocity
    np.testing.assert_allclose(seen, a.at(t).pose.translation, rtol=0, atol=1e-12)
    np.testing.assert_allclose(faster.at(t).twist[:3], a.at(t).twist[:3] + velocity, atol=1e-12)
    ignored = a.replace(twist=faster.twist).at(t).pose.translation - t * velocity
    assert np.linalg.norm(ignored - seen) > 0.5 * n * t * 0.01


@pytest.mark.slow
def test_a_catch_in_orbit_far_from_the_origin_strikes_nothing():
    """With linear momentum on board too; flown with the target as the caller gave it."""
    off, momentum = [80.0, -40.0, 20.0], (10.0, 5.0, -5.0, 0.0, 0.0, 0.0)
    start = sa.load("chaser7").at(START, base=sa.pose(off), momentum=momentum)
    target = tumbling(start, orbit=0.0011)
    found = sa.catch(start, target, window=(12, 20), wanted=1, search=STRAIGHT)
    frame = found.target.at(found.t, "ring").pose
    for flight in (found.fly(integration=COARSE), found.fly(target, integration=COARSE)):
        assert flight.captures[0].energy_lost < 1e-9
        end = flight.phases[1][-1]
        off = np.linalg.norm(end.tip.translation - frame.translation)
        reach = np.linalg.norm(end.tip.translation - end.com)
        assert off <= found.place_error + COARSE.rtol * reach  # as `Catch` says
    blind = found.target.at(found.t).pose.translation - target.at(found.t).pose.translation
    assert np.linalg.norm(blind) > 1e-3


def torques_between(motion, parts: int) -> np.ndarray:
    """Largest joint torques of a motion as flown, at so many instants of each interval.

    From Pinocchio's mass matrix and bias forces alone, with the spacecraft's twist and acceleration
    from the conservation of momentum.
    """
    arm, way = motion.arm, motion.spline
    model, data = arm.model, arm.model.createData()
    momentum, full, found = motion.momentum[0, 3:], pin.neutral(arm.model), np.zeros(arm.n)
    for a, b in pairwise(motion.t):
        for t in a + (b - a) * np.arange(parts + 1) / parts:
            q, dq, ddq = way(t), way(t, 1), way(t, 2)
            full[7:] = q
            M = np.array(pin.crba(model, data, full))
            M = np.triu(M) + np.triu(M, 1).T
            h = np.append(np.zeros(3), motion.at(t).base.rotation.T @ momentum)
            twist = np.linalg.solve(M[:6, :6], h - M[:6, 6:] @ dq)
            v = np.append(twist, dq)
            c = pin.rnea(model, data, full, v, np.zeros_like(v))
            turned = np.linalg.solve(M[:6, :6], -c[:6] - M[:6, 6:] @ ddq)
            tau = M[6:, :6] @ turned + M[6:, 6:] @ ddq + c[6:]
            found = np.maximum(found, np.abs(tau))
    return found


def test_torques_between_the_samples_are_within_what_is_claimed(caught):
    """Of the last part of the way to contact, where they are largest, and of the braking."""
    last = caught.chase
    part = sa.Motion(last.arm, last.t[-9:], last.q[-9:], last.base[-9:])
    object.__setattr__(part, "momentum", np.zeros((9, 6)))
    part.__dict__["spline"] = last.spline
    largest = np.maximum(torques_between(part, 3), torques_between(caught.brake, 2))
    assert (largest <= caught.torque * (1.0 + 1e-9)).all()
    ends = caught.brake.largest_torques
    np.testing.assert_allclose(torques_between(caught.brake, 2), ends, rtol=0.02, atol=0)


@pytest.mark.parametrize(
    ("account", "left"),
    [
        ("collisions checked: by their visuals bus", ""),
        ("collisions checked: by their visuals bus; NOT checked: links without shapes: hand",
         "links without shapes: hand"),
        ("collisions NOT checked (collisions=False)", "collisions"),
    ],
)  # fmt: skip
def test_the_verdict_says_what_was_not_checked(caught, account, left):
    found = replace(caught, plan=replace(caught.plan, checked=account))
    assert found.describe().verdict.partition("; ")[2] == f"NOT checked: {left}" * bool(left)
    assert found.not_checked.startswith(left or "torques")


def test_the_way_is_one_from_the_start_to_contact(caught):
    """No jump where its parts meet, and the rates of the joints are kept."""
    way = caught.approach
    assert way.t[0] == 0.0
    assert way.t[-1] == pytest.approx(caught.t, abs=1e-9)
    np.testing.assert_array_equal(way.q[0], START)
    np.testing.assert_allclose(caught.plan.q[-1], caught.chase.q[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(caught.plan.base[-1], caught.chase.base[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(caught.chase.dq[0], np.zeros(7), rtol=0, atol=1e-5)
    most = [way.arm.tree.joints[name].velocity for name in way.arm.joint_names]
    assert (np.abs(caught.chase.dq) <= most).all()


def test_a_rehearsed_approach_is_about_the_one_that_is_led(caught):
    """All at once in few steps: where it ends, how the spacecraft has turned, and the rates."""
    start, rates = caught.plan[0], sa.Constraints().joint_rates(caught.arm)
    request = Approach.of(
        start, caught.target, None, (10.0, 30.0), 0.2, 0.05, None, (np.inf, np.inf),
        sa.Constraints(), "free-floating",
    )  # fmt: skip
    far = sa.singularity(start).distance
    assert request.proves == pytest.approx(min(np.radians(20.0), 0.7 * far), rel=1e-6)
    share, Q, turns = request.rehearsed(caught.t, caught.grapple, caught.plan.q[[-1, -1]])
    np.testing.assert_array_equal(Q[0], Q[1])
    np.testing.assert_allclose(Q[0, -1], caught.chase.q[-1], rtol=0, atol=0.03)
    away = pin.log3(turns[0, -1].T @ caught.chase[-1].base.rotation)
    assert np.linalg.norm(away) < 0.01
    tip = start.arm.at(Q[0, -1], base=pin.SE3(turns[0, -1], np.zeros(3))).centred(start.com).tip
    frame = caught.target.at(caught.t, caught.grapple).pose
    assert np.linalg.norm(pin.log6(tip.actInv(frame)).vector) < 0.01
    assert share[0] == pytest.approx((np.abs(caught.chase.dq) / rates).max(), rel=0.2)


def test_an_arm_that_cannot_wait_begins_at_once():
    """A target that comes through the elbow later on: the way to the stand-off lasts all the time.

    A late way would do without it; and a start where the target is at once is refused.
    """
    start = sa.load("chaser7").at(START)
    elbow = sa.Bus(10.0, size=(0.3, 0.3, 0.3), name="debris")
    place, goal = np.array([3.2, -0.1, 1.0]), sa.Joints([1.2, *START[1:]])
    request = list[Approach]()
    for begin in (10.0, 0.0, 1e4):
        there = pin.SE3(np.eye(3), place + np.array([0.0, 0.15 * begin, 0.0]))
        target = sa.Target(elbow, there, twist=(0, -0.15, 0, 0, 0, 0), grapples={"ring": RING})
        request += [
            Approach.of(
                start, target, None, (10.0, 30.0), 0.2, 0.05, None, (np.inf, np.inf),
                sa.Constraints(), "free-floating",
            )
        ]  # fmt: skip
    through, at_once, never = request
    assert 5.0 < through.rests_until < 10.0
    reach = through._reach(goal, 20.0, STRAIGHT)
    assert reach.t[-1] == pytest.approx(20.0)
    assert not sa.collision_check(reach, obstacles=sa.Obstacle.of_target(through.target)).contact
    assert never._reach(goal, 20.0, STRAIGHT).t[-1] < 5.0
    through.check_start()
    with pytest.raises(sa.NoSolutionError, match=r"at time 0 .*touching"):
        at_once.check_start()


def test_obstacles_that_move_are_minded_when_they_are_there(caught):
    """One that comes through the elbow while the arm waits; one that is on the way at its time."""
    start, goal = sa.load("chaser7").at(START), sa.Joints([1.2, *START[1:]])

    def request(target, box):
        return Approach.of(
            start, target, None, (10.0, 30.0), 0.2, 0.05, None, (np.inf, np.inf),
            sa.Constraints(obstacles=[box]), "free-floating",
        )  # fmt: skip

    far, slow = caught.target.replace(pose=sa.pose((0, 0, 50))), (0, -0.15, 0, 0, 0, 0)
    through = sa.Obstacle.box(0.3, sa.pose((3.2, 1.4, 1.0)), twist=slow, name="box")
    waiting = request(far, through)
    assert 5.0 < waiting.rests_until < 10.0
    reach = waiting._reach(goal, 20.0, STRAIGHT)
    assert reach.t[-1] == pytest.approx(20.0)
    assert not sa.collision_check(reach, obstacles=through).contact
    for passes in (caught.t, caught.t - caught.chase.t[-1] - 5.0):  # a spacecraft of a metre
        origin = caught.chase[-1].base.translation + np.array([0.0, passes, 0.0])
        fast = (0, -1.0, 0, 0, 0, 0)
        box = sa.Obstacle.box(0.2, pin.SE3(np.eye(3), origin), twist=fast, name="box")
        found = request(caught.target, box)
        if passes < caught.t:
            found._check_contacts(caught.chase, caught.t)
        else:
            with pytest.raises(sa.NoSolutionError, match=r"box.* meet after"):
                found._check_contacts(caught.chase, caught.t)


@pytest.mark.slow
def test_the_distance_proven_is_no_more_than_what_a_search_finds(caught):
    """No posture nearer to the way than proven is found by the search of singular postures."""
    found = sa.singular_set(caught.arm)
    for q in caught.approach.q[:: len(caught.approach) // 8]:
        assert found.nearest(q).distance >= caught.distance_proven
    ways = [found.clearance(w, at_least=np.radians(20)) for w in (caught.plan, caught.chase)]
    wanted = min(way.clearance for way in ways)
    assert caught.distance_proven == pytest.approx(wanted, rel=1e-6)  # all that can be


@pytest.mark.slow
def test_in_flight_nothing_strikes_and_the_momentum_is_that_of_the_target(caught):
    """Simulated: no energy is lost, momentum of parts stays through contact, the joints rest."""
    flight, target = caught.fly(), caught.target
    assert [run.ended for run in flight.phases] == ["duration"] * 3
    moving = 0.5 * target.mass * float(target.cm[1] @ target.cm[1])
    w = target.at(caught.t)
    # grasped where the hand is, which follows the plan to the error of the integration
    pose = flight.phases[1][-1].tip * caught.chase[-1].tip.actInv(w.pose)
    I = pose.rotation @ target.inertia @ pose.rotation.T
    moving += 0.5 * float(w.twist[3:] @ I @ w.twist[3:])
    assert 0.0 <= flight.captures[0].energy_lost < 1e-6 * moving
    # the arm had none; that of the target about the common CM
    com, v = pose.act(target.com), target.cm[1]
    held = flight.phases[2][0]
    angular = I @ w.twist[3:] + np.cross(com - held.com, target.mass * v)
    momentum = np.concatenate((target.mass * v, angular))
    size = np.linalg.norm(momentum)
    for row in (0, -1):
        found = flight.phases[2].momentum[row]
        np.testing.assert_allclose(found, momentum, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(caught.momentum, momentum, rtol=0, atol=1e-4 * size)
    assert np.abs(flight.phases[2].dq[-1]).max() < 1e-6
    np.testing.assert_allclose(flight.phases[2].q[-1], caught.brake.q[-1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(flight.phases[2].base[-1], caught.brake.base[-1], rtol=0, atol=1e-5)
    end = flight.phases[2]
    largest = max(np.abs(run.torque).max() for run in flight.phases[1:])
    assert largest <= caught.torque.max() * 1.2
    spin = sa.base_velocity(end[-1].with_momentum(end.momentum[-1]), np.zeros(7))[3:]
    np.testing.assert_allclose(spin, caught.tumble, rtol=0, atol=1e-3 * np.linalg.norm(spin))


def test_what_the_grapple_bears_changes_the_momentum_of_the_target(caught):
    """The integral of the wrench on the target, about the origin, is what its momentum changes."""
    brake, target, end = caught.brake, caught.target, caught.brake[-1]
    tips = [cfg.tip for cfg in brake]
    force = np.array([T.rotation @ x[:3] for T, x in zip(tips, brake.wrench, strict=True)])
    moment = [
        T.rotation @ x[3:] + np.cross(T.translation, f)
        for T, x, f in zip(tips, brake.wrench, force, strict=True)
    ]
    given = np.trapezoid(np.hstack((force, moment)), brake.t, axis=0)
    met = target.at(caught.t).pose
    after = end.tip * brake[0].tip.actInv(met)  # held by the hand

    def momentum(pose, v, w):
        R = pose.rotation
        spin = R @ target.inertia @ R.T @ w
        return np.concatenate((v, np.cross(pose.act(target.com), v))) * target.mass + np.append(
            np.zeros(3), spin
        )

    w = target.at(caught.t).twist[3:]
    drift = caught.momentum[:3] / brake.arm.mass
    v = drift + np.cross(caught.tumble, after.act(target.com) - end.com)
    change = momentum(after, v, caught.tumble) - momentum(met, target.cm[1], w)
    for part in (slice(3), slice(3, 6)):
        size = np.linalg.norm(change[part])
        np.testing.assert_allclose(given[part], change[part], rtol=0, atol=0.01 * size)


def test_a_weaker_grapple_is_braked_more_slowly(caught):
    """A limit below what the braking found takes bears at most that, and longer.

    Rates are halved until it is the braking that counts, not what the tumbling alone takes.
    """
    held = caught.brake[0].with_momentum(caught.momentum)
    body = grasp_of(caught.target, caught.t, held.tip)
    efforts, rates, weak = np.full(7, 200.0), caught.chase.dq[-1], np.full(2, np.inf)
    while not np.isfinite(weak).any():
        brake = braked(held, rates, body, True, efforts, np.full(2, np.inf))
        tumbling_on = np.linalg.norm(brake.wrench[[0, -1]].reshape(2, 2, 3), axis=2).max(axis=0)
        weak = np.where(brake.borne > 1.5 * tumbling_on, 0.5 * (tumbling_on + brake.borne), np.inf)
        rates = 0.5 * rates
    slower = braked(held, 2.0 * rates, body, True, efforts, weak)
    assert slower.t[-1] > brake.t[-1]
    assert (slower.borne <= weak).all()
    with pytest.raises(sa.NoSolutionError, match="of the grapple"):
        braked(held, 2.0 * rates, body, True, efforts, 1e-6 * weak)


@pytest.mark.slow
def test_a_target_heavier_than_planned_is_caught_with_its_own_momentum(caught):
    """The plastic impact of the grasp takes the actual body; energy is lost, none is won."""
    start = caught.plan[0]
    actual = tumbling(start, mass=72.0, w=(0.022, 0.03, 0.02))
    flight = caught.fly(actual, integration=COARSE)
    (grasp,) = [event for event in flight.events if event.kind == "grasp"]
    off = flight.phases[1].tip[-1, :3] - actual.at(grasp.t, "ring").pose.translation
    assert np.linalg.norm(off) > 1e-3  # the planned error is that of the target as it was planned
    assert f"tip off the grapple frame by {np.linalg.norm(off):.1e} m" in grasp.detail
    assert flight.captures[0].energy_lost > 0.0
    assert flight.phases[2][0].arm.mass == pytest.approx(start.arm.mass + 72.0)


def drifting(start, mode) -> sa.Configuration:
    """The start with momentum on board; in the wheels where these hold the attitude."""
    momentum = np.array([5.0, -3.0, 4.0, 3.0, 2.0, -3.0])
    if mode != HELD:
        return start.with_momentum(momentum).with_wheels([0.5, -0.4, 0.3])
    held = np.array([0.5, -0.4, 0.3])
    momentum[3:] = start.base.rotation @ held
    return start.with_momentum(momentum).with_wheels(held)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["free-floating", HELD])
def test_with_momentum_on_board_it_catches_as_simulated(mode):
    """The tip meets the frame, nothing strikes, and the momentum is the sum of the parts."""
    arm = load_text(with_wheels("chaser7", np.eye(3), torque=20.0, rate=4000.0), task="pose")
    start = drifting(arm.at(START), mode)
    target = tumbling(start)
    search = sa.Search(timeout=3600.0)  # until one is found
    catch = sa.catch(start, target, window=(10, 30), wanted=1, mode=mode, search=search)
    flight, met = catch.fly(integration=COARSE), target.at(catch.t, "ring")
    assert np.linalg.norm(pin.log6(flight.phases[1][-1].tip.actInv(met.pose))) < 1e-6
    assert flight.captures[0].energy_lost < 1e-9
    w, (_, v) = target.at(catch.t), target.cm
    spin = w.pose.rotation @ target.inertia @ w.pose.rotation.T @ w.twist[3:]
    end = catch.chase[-1]
    held, place = catch.brake[0], w.pose.act(target.com)
    p = start.momentum[:3] + target.mass * v
    angular = start.momentum[3:] + spin + np.cross(place - held.com, target.mass * v)
    angular += np.cross(end.com - held.com, start.momentum[:3])
    size = np.linalg.norm(angular)
    np.testing.assert_allclose(catch.momentum, np.append(p, angular), rtol=0, atol=1e-4 * size)
    if mode == HELD:  # at rest the wheels hold all of it, as simulated with the torques planned
        last = flight.phases[2]
        np.testing.assert_allclose(last.q[-1], catch.brake.q[-1], rtol=0, atol=1e-6)
        np.testing.assert_allclose(last.base[-1], catch.brake.base[-1], rtol=0, atol=1e-5)
        np.testing.assert_allclose(last.wheels[-1], catch.brake.wheels[-1], atol=1e-4 * size)
        assert flight.turning[-1] < 1e-5
        at_rest = catch.brake.base[-1]
        T = pin.XYZQUATToSE3(at_rest).rotation
        np.testing.assert_allclose(T @ catch.brake.wheels[-1], catch.momentum[3:], atol=1e-6 * size)
        np.testing.assert_allclose(T, start.base.rotation, atol=1e-9)
        assert "N m s" in catch.wheel_load[2]


@pytest.mark.slow
def test_wheels_that_cannot_hold_the_target_are_named():
    """Capacity and torque below what the target brings: each contact says which wheel, and why."""
    start = sa.load("chaser7").at(START)
    for small in ({"capacity": 0.2}, {"torque": 1e-4}):
        wheels = sa.WheelHold(stiffness=0.0, damping=0.0, **small)
        kept = sa.Constraints(wheels=wheels)
        with pytest.raises(sa.NoSolutionError, match=r"wheel about . at most"):
            sa.catch(
                start,
                tumbling(start),
                window=(12, 12),
                mode=HELD,
                constraints=kept,
                search=STRAIGHT,
            )


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "rests"), [(400.0, True), (20.0, False)])
def test_after_contact_wheels_take_up_what_they_can(rate, rests):
    """Within torque and capacity; what is left is the momentum that no wheel holds, and turns."""
    arm = load_text(with_wheels("chaser7", np.eye(3), torque=0.5, rate=rate), task="pose")
    start = arm.at(START)
    catch = sa.catch(start, tumbling(start), window=(10, 30), wanted=1, search=STRAIGHT)
    flight = catch.fly(integration=sa.Integration(dt=0.1))
    assert flight.names == ("approach", "closing in", "braking", "detumbling")
    assert np.abs(flight.wheel_torque).max() <= 0.5 * (1.0 + 1e-9)
    assert np.abs(flight.wheels).max() <= 0.01 * rate * (1.0 + 1e-6)
    end, size = flight.phases[-1][-1], np.linalg.norm(catch.momentum[3:])
    left = end.momentum[3:] - end.base.rotation @ flight.wheels[-1]
    np.testing.assert_allclose(flight.left_over, left, atol=1e-9 * size)
    turning = np.linalg.norm(np.linalg.solve(end.A[3:, 3:6] @ end.base.rotation.T, left))
    assert flight.turning[-1] == pytest.approx(turning, abs=1e-6)
    assert ("wheels can hold" in catch.rest) == rests
    full = {event.kind for event in flight.events} >= {"wheel full"}
    assert full != rests
    if rests:
        assert np.linalg.norm(left) < 0.02 * size
        assert flight.turning[-1] < 0.02 * np.linalg.norm(catch.tumble)
    else:
        assert np.linalg.norm(left) > 0.2 * size
    # what the tip bears while braking is what was planned, but for what the wheels do
    most = np.linalg.norm(flight.tip_wrench[:, :3], axis=1).max()
    assert most == pytest.approx(catch.brake.borne[0], rel=0.1)
    assert not flight.tip_wrench[flight.t < catch.t - 1e-6].any()


def wide(timeout=3600.0, limits=(10.0, 30.0), **fields) -> Approach:
    """A request whose window holds several candidates."""
    start = sa.load("chaser7").at(START)
    return Approach.of(
        start, tumbling(start), None, limits, 0.2, 0.05, None, (np.inf, np.inf),
        sa.Constraints(**fields), "free-floating", SearchAccount(timeout),
    )  # fmt: skip


@pytest.mark.parametrize("window", [(10.0, 30.0), (20.0, 60.0)])
def test_the_first_contacts_tried_lie_in_all_parts_of_the_window(window):
    """Those in reach: of every four the times are in as many quarters, as long as there are any."""
    request = wide(limits=window)
    first, second = islice(request.candidates(), 2)
    assert len({t for t, _ in first + second}) == 25
    for found in (first, second):
        reached = [t for t, name in found if not request.rank(t, name)[0]]
        assert [t for t, _ in found[: len(reached)]] == reached  # the others come last
        quarters = [min(int(4 * (t - window[0]) / (window[1] - window[0])), 3) for t in reached]
        there = len(set(quarters))
        assert len(set(quarters[:there])) == there


def test_a_search_that_ends_by_time_says_how_many_contacts_were_tried(monkeypatch):
    """And names the limit; those tried lie in several parts of the window."""
    seen = []

    def attempt(self, t, *_):
        seen.append(t)
        if len(seen) == 3:
            self.account.timeout = 0.0
        raise sa.NoSolutionError("it does not reach")

    monkeypatch.setattr(Approach, "attempt", attempt)
    start = sa.load("chaser7").at(START)
    search = sa.Search(timeout=1234.0)
    words = r"timeout = 1234 s, when 3 of 25 candidates .*longer timeout"
    with pytest.raises(sa.NoSolutionError, match=words) as failed:
        sa.catch(start, tumbling(start), window=(10, 30), search=search)
    assert [one.t for one in failed.value.best] == seen
    assert len({int((t - 10.0) / 5.0) for t in seen}) == 3


def test_a_search_that_tried_all_contacts_does_not_ask_for_more_time(monkeypatch):
    def attempt(*_):
        raise sa.ImpossibleError("it is out of reach")

    monkeypatch.setattr(Approach, "attempt", attempt)
    start = sa.load("chaser7").at(START)
    with pytest.raises(sa.NoSolutionError, match="25 of 25 candidates") as failed:
        sa.catch(start, tumbling(start), window=(10, 30))
    assert "timeout" not in str(failed.value)
    assert "and 24 more" in str(failed.value)


def test_a_try_ends_with_the_time_of_the_whole_call(caught):
    """Each of its long computations: leading the tip, the proof, the bounds, the braking."""
    request = wide(timeout=1e-9)
    chase, account = caught.chase, request.account
    reach = caught.plan
    with pytest.raises(TimeUpError):
        request._caught(caught.t, caught.grapple, reach)
    with pytest.raises(TimeUpError):
        request._proven(reach, chase)
    with pytest.raises(TimeUpError):
        load_peaks(chase, check_time=account.check_time)
    with pytest.raises(TimeUpError):
        request.attempt(caught.t, caught.grapple, iter([sa.Joints(START)]), STRAIGHT, 0.0)
    near = replace(caught, distance_proven=1e-3)
    assert request.settled(near) is near
    search = replace(STRAIGHT, timeout=1e-9)
    with pytest.raises(sa.NoSolutionError, match="0 of 1 candidates"):
        sa.catch(caught.plan[0], caught.target, window=(10, 10), search=search)


def test_a_target_without_size_is_caught_where_collisions_are_left_out():
    """Else the message names the remedy."""
    start = sa.load("chaser7").at(START)
    bare = sa.Bus(60.0, inertia=np.diag((4.0, 5.0, 6.0)), name="debris")
    target = sa.Target(bare, tumbling(start).pose, grapples={"ring": RING})
    with pytest.raises(sa.ModelError, match=r"debris has no shape.*size=.*collisions=False"):
        sa.catch(start, target, window=(10, 10), search=STRAIGHT)


def test_how_far_the_base_rotates_is_said(caught):
    """By the attitudes of all parts of the way."""
    first = caught.plan[0].base.rotation
    turns = [
        np.linalg.norm(pin.log3(first.T @ cfg.base.rotation))
        for motion in (caught.plan, caught.chase, caught.brake)
        for cfg in motion
    ]
    assert caught.base_rotation == pytest.approx(max(turns), abs=1e-9)
    facts = dict(caught.describe().tables[0].rows)
    assert facts["largest rotation of the base"].value == caught.base_rotation
    assert caught.to_dict()["base_rotation"] == caught.base_rotation


def test_time_that_ends_while_straight_ways_are_sought_is_no_error_of_its_own(monkeypatch):
    def late(*_):
        raise TimeUpError("the time is up (timeout)")

    monkeypatch.setattr("spacearm.mission.approaching.ramp_ends", late)
    start = sa.load("chaser7").at(START)
    with pytest.raises(sa.NoSolutionError, match="does not catch"):
        sa.catch(start, tumbling(start), window=(10, 12), search=STRAIGHT)


def test_nothing_in_reach_is_said_for_each_contact():
    """A target that is far off: impossible, and each time and frame says why."""
    start = sa.load("chaser7").at(START)
    far = tumbling(start, off=(0.0, 0.0, 30.0))
    with pytest.raises(sa.NoSolutionError, match=r"comes no farther.*widen the window") as caught:
        sa.catch(start, far, window=(10, 20))
    assert {one.grapple for one in caught.value.best} == {"ring"}
    assert all("comes no farther" in one.story for one in caught.value.best)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s, t: sa.catch(s, t, "rings"), "ring"),
        (lambda s, t: sa.catch(s, t.replace(grapples={})), "grapple frame"),
        (lambda s, t: sa.catch(s, t, window=(5, 2)), "window"),
        (lambda s, t: sa.catch(s, t, window=3), "window"),
        (lambda s, t: sa.catch(s, t, approach=-1.0), "approach"),
        (lambda s, t: sa.catch(s, t, closing=0.0), "closing"),
        (lambda s, t: sa.catch(s, t, touching=["palm"]), "palm"),
        (lambda s, t: sa.catch(s, t, bears=(10.0, 0.0)), "bears"),
        (lambda s, t: sa.catch(s, t, bears=[3.0]), "bears"),
        (lambda s, t: sa.catch(s, t, mode="fixed"), "mode"),
        (lambda s, t: sa.catch(s, t, constraints=sa.Constraints(wheels=LARGE)), "no"),
        (lambda _, t: sa.catch(sa.load("planar2").at([0.3, 1.2]), t), "pose"),
        (lambda s, _: sa.catch(s, "debris"), "Target"),
    ],
)
def test_mistakes_are_named(change, words):
    """Each error names the argument and the remedy."""
    start = sa.load("chaser7").at(START)
    with pytest.raises(sa.SpaceArmError, match=words):
        change(start, tumbling(start))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_random_targets_before_the_hand_are_caught(seed):
    """20 to 150 kg, 0.5 to 3 deg/s about random axes: caught, and its tip meets the frame."""
    rng = np.random.default_rng(seed)
    start = sa.load("chaser7").at(START)
    w = rng.normal(size=3)
    w *= np.radians(rng.uniform(0.5, 3.0)) / np.linalg.norm(w)
    target = tumbling(start, w=w, mass=rng.uniform(20, 150), off=(*rng.normal(size=2) / 10, 0.3))
    search = sa.Search(timeout=3600.0)  # until one is found
    catch = sa.catch(start, target, window=(9, 40), wanted=1, search=search)
    assert catch.place_error < 1e-6
    assert np.abs(catch.twist_error).max() < 1e-5
    parts = [torques_between(motion, 20) for motion in (catch.chase, catch.brake)]
    largest = np.max(parts, axis=0)
    assert (largest <= catch.torque * (1.0 + 1e-5)).all()
    assert (catch.torque <= 1.02 * largest).all()


@pytest.mark.slow
def test_a_planar_arm_catches_what_stays_in_its_plane():
    """The x axis of its frame points into the target; the twist is that of free motion."""
    start = sa.load("planar3").at([0.2, 0.9, 0.7])
    stand_off = sa.move(start, [-0.3, 1.6, 0.4]).tip
    puck = sa.Target(
        sa.Bus(20, size=(0.3, 0.3, 0.3), name="puck"), stand_off * sa.pose((0.2, 0, 0)),
        twist=(-0.001, 0.001, 0, 0, 0, 0.01), grapples={"side": sa.pose((-0.16, 0, 0))},
    )  # fmt: skip
    catch = sa.catch(start, puck, window=(12.5, 12.5), wanted=1, search=STRAIGHT)
    frame, end = puck.at(12.5, "side"), catch.chase[-1]
    assert np.linalg.norm(pin.log6(end.tip.actInv(frame.pose)).vector) < 1e-7
    slip = sa.generalized_jacobian(end) @ catch.chase.dq[-1] - frame.twist
    np.testing.assert_allclose(slip, np.zeros(6), rtol=0, atol=1e-6)
    assert catch.distance_proven > 0.1
    np.testing.assert_allclose(catch.momentum[[2, 3, 4]], np.zeros(3), rtol=0, atol=1e-12)
    lifted = puck.replace(twist=(0, 0, 0.001, 0, 0, 0.01))
    with pytest.raises(sa.NoSolutionError, match=r"\d m off the plane in which the tip of planar3"):
        sa.catch(start, lifted, window=(12.5, 12.5), wanted=1)
    with pytest.raises(sa.UnsupportedError, match="of a planar arm task='x y rz'"):
        sa.catch(sa.load("planar2").at([0.2, 0.9]), puck)


def test_a_method_is_that_of_the_ways_to_the_stand_off():
    """With "straight" no others are looked for."""
    start = sa.load("chaser7").at(START)
    near = tumbling(start, off=(0.0, 0.0, -1.5), twist=(0, 0, 1, 0, 0, 0))  # in the spacecraft
    near = near.replace(pose=near.at(-10.0).pose)  # after 10 s
    with pytest.raises(sa.NoSolutionError, match="straight way"):
        sa.catch(start, near, window=(10, 10), search=STRAIGHT)


@pytest.mark.slow
def test_mujoco_flies_the_same_way(caught, tmp_path):
    """Its own model and integrator, under the torques of the plan alone, and its own target.

    From contact on it is the model of the arm with the target, whose parts move on as they did.
    """
    mujoco = pytest.importorskip("mujoco")
    step, target = 0.002, caught.target

    def of(model):
        model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_RK4
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
        return model, mujoco.MjData(model)

    def placed(data, pose):
        x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
        data.qpos[:7] = (*pose.translation, w, x, y, z)

    I = target.inertia
    six = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
    text = (
        '<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/><inertial '
        f'pos="{numbers(target.com)}" mass="{target.mass}" fullinertia="{numbers(six)}"/>'
        "</body></worldbody></mujoco>"
    )
    debris, free = of(mujoco.MjModel.from_xml_string(text))
    placed(free, target.pose)
    free.qvel[:3], free.qvel[3:] = target.twist[:3], target.pose.rotation.T @ target.twist[3:]
    count = int(np.ceil(caught.t / step))
    debris.opt.timestep = caught.t / count
    for _ in range(count):
        mujoco.mj_step(debris, free)
    turn = pin.Quaternion(*free.qpos[3:7]).matrix()
    met = pin.SE3(turn, free.qpos[:3].copy()) * target.frame(caught.grapple)

    data, off = None, []
    for motion in (caught.plan, caught.chase, caught.brake):
        arm, way = motion[0].arm, motion.spline
        if motion is caught.chase:
            rows = zip(motion.q, motion.dq, motion.ddq, strict=True)
            way = BPoly.from_derivatives(motion.t, [list(row) for row in rows])
        model, state = of(mujoco.MjModel.from_xml_path(str(sa.to_mjcf(arm, tmp_path / "m.xml"))))
        if data is None:
            placed(state, caught.plan[0].base)
            state.qpos[7:] = caught.plan.q[0]
        else:
            state.qpos[:], state.qvel[:] = data.qpos, data.qvel
        data = state
        stops = np.unique(np.linspace(0, len(motion) - 1, 9).astype(int))
        for i, j in pairwise(stops):
            count = int(np.ceil((motion.t[j] - motion.t[i]) / step))
            model.opt.timestep = h = (motion.t[j] - motion.t[i]) / count
            for t in motion.t[i] + h * (np.arange(count) + 0.5):
                cfg = arm.at(way(t)).with_momentum(motion[0].momentum)
                data.qfrc_applied[6:] = sa.inverse_dynamics(cfg, way(t, 1), way(t, 2)).tau
                mujoco.mj_step(model, data)
            mujoco.mj_kinematics(model, data)
            site = data.site(caught.arm.tip)
            tip = pin.SE3(site.xmat.reshape(3, 3).copy(), site.xpos.copy())
            off.append(np.linalg.norm(pin.log6(motion[j].tip.actInv(tip)).vector))
        if motion is caught.chase:
            off.append(np.linalg.norm(pin.log6(met.actInv(tip)).vector))
    assert max(off) < 5e-5  # the torques lead, nothing corrects: 1e-5 by their rounding
