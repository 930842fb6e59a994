"""Obstacles: what is proven apart is apart on the true motion, with the spacecraft moving."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from helpers.arms import frame, joint, link, load_text, random_tree, robot, seeds
from helpers.commands import spacearm
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa
from spacearm.collisions.bodies import Bodies
from spacearm.collisions.obstacles import Drifting, Moving
from spacearm.collisions.separation import Collisions
from spacearm.collisions.swept_motion import Floating, Recorded, inertial_speeds
from spacearm.mechanics.floating import walk
from spacearm.planning.timing import largest_rates, rest_to_rest_times

Q0, GOAL = np.array([0.3, 1.2]), (0.9, 1.4)


def at(*place, turn=(0.0, 0.0, 0.0)):
    return pin.SE3(pin.exp3(np.array(turn)), np.array(place, dtype=float))


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


@pytest.fixture(scope="module")
def free(arm):
    """A plan without obstacles."""
    return sa.plan(arm.at(Q0), GOAL)


def dense(rows, m=12):
    """Configurations between the rows of a floating motion."""
    for a, b in pairwise(rows):
        for s in np.linspace(0.0, 1.0, m):
            yield sa.move(a, a.q + s * (b.q - a.q))


def of_links(cfg, links):
    """Points of the bars of planar2's links: the segments that their capsules surround."""
    data = pin.Data(cfg.arm.model)
    pin.framesForwardKinematics(cfg.arm.model, data, cfg.full)
    for name in links:
        pose = data.oMf[cfg.arm.model.getFrameId(name)]
        yield pose.act(np.zeros(3)), pose.act(np.array([1.0, 0.0, 0.0]))


# --- the bound that proofs rest on ------------------------------------------------------------


@pytest.mark.parametrize("name", ["planar2", "mda6", "chaser7"])
def test_no_point_moves_faster_than_its_bound(name):
    """The exact velocity of points of all bodies, at zero momentum, by the Jacobians."""
    arm, rng = sa.load(name), np.random.default_rng(0)
    bodies = Bodies(arm).all
    bound = inertial_speeds(arm, bodies, np.full(arm.model.nv - 6, 3.0))
    for q in rng.uniform(-3, 3, (60, arm.n)):
        speeds = point_speeds(arm, bodies, q, rng)
        assert (speeds <= bound).all()


@given(seeds, st.integers(1, 5))
def test_no_point_of_a_random_tree_moves_faster_than_its_bound(seed, n):
    """Branches, sliding joints, odd inertias; each body a ball about its joint."""
    rng = np.random.default_rng(seed)
    ball = '<collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
    text = random_tree(seed, n).replace("</link>", ball)
    arm = load_text(text, tip=f"link_{n}", task=sa.Task("pose", length=1.0), joints="all")
    bodies, q = Bodies(arm).all, rng.uniform(-2, 2, arm.n)
    bound = inertial_speeds(arm, bodies, np.abs(arm.all_joints(q)))
    assert (point_speeds(arm, bodies, q, rng) <= bound * (1.0 + 1e-9)).all()


def point_speeds(arm, bodies, q, rng):
    """The speed of a random point of each body for the unit rate of each joint (bodies, n)."""
    cfg, data = arm.at(q), pin.Data(arm.model)
    pin.computeJointJacobians(arm.model, data, cfg.full)
    react = np.linalg.solve(cfg.A[:, :6], cfg.A[:, 6:])
    speeds = []
    for body in bodies:
        J = arm.project(pin.getJointJacobian(arm.model, data, body.joint, pin.LOCAL_WORLD_ALIGNED))
        body.shape.computeLocalAABB()
        off = rng.normal(size=3)
        point = body.pose.act(
            body.shape.aabb_center + 0.5 * body.shape.aabb_radius * off / np.linalg.norm(off)
        )
        moved = J[:, 6:] - J[:, :6] @ react
        arms = data.oMi[body.joint].rotation @ point
        speeds.append(np.linalg.norm(moved[:3] + np.cross(moved[3:].T, arms).T, axis=0))
    return np.array(speeds)


@pytest.mark.slow
@given(seeds)
def test_contact_or_proof_as_dense_sampling_has_it(seed):
    """A sphere anywhere near the arm, and a random joint path on which the spacecraft turns."""
    rng = np.random.default_rng(seed)
    arm = sa.load("planar2")
    ball = sa.Obstacle.sphere(0.15, at(*rng.uniform(-2.5, 2.5, 2), 0.0))
    rows = walk(arm.at(rng.uniform(-3, 3, 2)), np.cumsum(rng.uniform(-0.6, 0.6, (3, 2)), axis=0))
    rows = walk(rows[0], np.vstack((rows[0].q, rows[0].q + rng.uniform(-0.6, 0.6, (2, 2)))))
    course = Floating(rows, np.arange(len(rows)) * 1.0)
    bodies = Collisions(arm, [ball])
    against = slice(len(bodies.margins(course, 0.0)) - len(bodies.bodies), None)
    least = min(
        bodies.margins(Floating([cfg], np.zeros(1)), 0.0)[against].min() for cfg in dense(rows)
    )
    contact = bodies.contact(course)
    met = contact is not None and contact.links[1] == "sphere"
    if least < 0.0:
        assert contact is not None
    if met:
        assert least < 5e-3
    if least > 5e-3:
        assert not met


def test_a_spacecraft_that_reacts_meets_what_one_that_is_held_does_not():
    """The reason for it all: the same joint motion, the base held and floating."""
    arm = sa.load("planar2")
    path = np.linspace((0.0, 0.4), (2.2, 0.9), 60)
    held = sa.Motion(arm, np.arange(60) * 0.2, path, np.tile(np.eye(7)[6], (60, 1)), mode="fixed")
    rows = walk(arm.at(path[0]), path)
    end = rows[-1].base.rotation
    assert pin.log3(end)[2] < -0.3
    corner = rows[-1].base.act(np.array([0.5, -0.5, -0.25]))
    ball = sa.Obstacle.sphere(0.03, at(*corner))
    assert sa.collision_check(held, ball).apart
    floating = sa.Motion(arm, held.t, path, [pin.SE3ToXYZQUAT(cfg.base) for cfg in rows])
    report = sa.collision_check(floating, ball)
    assert not report.apart
    assert report.contact.links == ("spacecraft", "sphere")
    assert report.distance.min() < 0.0


# --- obstacles that move ----------------------------------------------------------------------


def test_a_steady_twist_is_integrated():
    twist = np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6])
    drift = Drifting(at(1, 2, 3, turn=(0.2, 0.1, -0.3)), twist, 0.5)
    (a,), (b,) = drift.frames(2.0), drift.frames(2.0 + 1e-6)
    np.testing.assert_allclose((b.translation - a.translation) / 1e-6, twist[:3], atol=1e-6)
    turn = pin.log3(b.rotation @ a.rotation.T) / 1e-6
    np.testing.assert_allclose(turn, twist[3:], atol=1e-5)


@given(seeds)
def test_motions_move_points_no_farther_than_they_say(seed):
    rng = np.random.default_rng(seed)
    robot = sa.load("mda6")
    poses = [pin.SE3ToXYZQUAT(at(*rng.normal(size=3), turn=rng.normal(size=3))) for _ in range(3)]
    motion = sa.Motion(robot, [0.0, 1.0, 3.0], rng.uniform(-1, 1, (3, 6)), poses)
    moving = Moving(motion, begin := rng.uniform(-1.0, 1.0))
    t0, t1 = np.sort(rng.uniform(-0.5, 3.5, 2)) - begin
    for body in Bodies(robot).all:
        body.shape.computeLocalAABB()
        point = body.pose.act(body.shape.aabb_center)
        a, b = (moving.frames(t)[body.joint].act(point) for t in (t0, t1))
        bound = moving.moved(body, t0, t1)
        assert np.linalg.norm(b - a) <= bound + 1e-12


def test_what_drifts_into_the_way_is_met_when_it_is_there(free):
    """A ball that crosses the path of the tip at half time, and one that has passed by then."""
    middle = len(free) // 2
    place, t = free.tip[middle, :3], free.t[middle]
    velocity = np.array([0.0, 0.0, 0.3])  # through the plane
    hit = sa.Obstacle.sphere(
        0.05, pin.SE3(np.eye(3), place - t * velocity), twist=[*velocity, 0, 0, 0]
    )
    report = sa.collision_check(free, hit)
    assert not report.apart
    assert report.contact.t == pytest.approx(t, abs=1.0)
    early = pin.SE3(np.eye(3), place - 0.2 * t * velocity + (0, 0, 0.5))
    past = sa.Obstacle.sphere(0.05, early, twist=[*velocity, 0, 0, 0])
    assert sa.collision_check(free, past).apart


def test_carried_along_with_another_robot(arm):
    """A box on a spacecraft that moves is where that is, interpolated between its samples."""
    start, end = at(3, 0, 0), at(3, 1, 0, turn=(0, 0, 0.5))
    motion = sa.Motion(arm, [0, 2], np.tile(Q0, (2, 1)), [*map(pin.SE3ToXYZQUAT, (start, end))])
    panel = sa.Obstacle.box((0.1, 2.0, 0.1), at(0.5, 0, 0), along=motion)
    for t in (0.0, 0.7, 2.0, 5.0):
        expected = pin.SE3.Interpolate(start, end, min(0.5 * t, 1.0)) * at(0.5, 0, 0)
        np.testing.assert_allclose(panel.poses(t)[0].homogeneous, expected.homogeneous, atol=1e-12)
    assert panel.moves
    target = sa.Obstacle.robot(motion)
    assert len(target.parts) == len(Bodies(arm).all)


# --- shapes, margins, links that may touch ----------------------------------------------------


def test_a_mesh_a_box_and_a_robot_of_the_same_shape_are_as_far_away(arm, tmp_path):
    trimesh.creation.box((0.4, 0.6, 0.2)).export(tmp_path / "block.stl")
    box = '<collision><geometry><box size="0.4 0.6 0.2"/></geometry></collision>'
    path = tmp_path / "block.urdf"
    path.write_text(
        robot(link("block", 5.0, inside=box), link("arm", 1.0), frame("tip"),
              joint("j", "block", "arm"), joint("t", "arm", "tip", "fixed", (1, 0, 0)))
    )  # fmt: skip
    pose = at(2.0, 1.5, 0.1, turn=(0.3, -0.2, 0.9))
    block = sa.load(path)
    things = (
        sa.Obstacle.box((0.4, 0.6, 0.2), pose),
        sa.Obstacle.mesh(tmp_path / "block.stl", pose),
        sa.Obstacle.robot(block.at([0.0], base=pose)),
    )
    for q in np.random.default_rng(0).uniform(-3, 3, (5, 2)):
        found = [sa.collision_check(arm.at(q), thing).distance[0] for thing in things]
        np.testing.assert_allclose(found, found[0], atol=1e-6)


def test_a_sphere_is_as_far_away_as_it_is():
    """From the box of planar2's spacecraft, half a metre from its centre to its faces."""
    arm = sa.load("planar2")
    ball = sa.Obstacle.sphere(0.2, at(-3.0, 0.0, -0.25), margin=0.3)
    cfg = arm.at([0.3, 0.4])
    bodies = Collisions(arm, [ball])
    margins = bodies.margins(Floating([cfg], np.zeros(1)), 0.0)
    nearest = margins[[bodies.links(i) == ("spacecraft", "sphere") for i in range(len(margins))]]
    assert nearest.min() == pytest.approx(3.0 - 0.5 - 0.2 - 0.3, abs=1e-6)


def test_margins_are_kept_and_links_that_may_touch_do(arm, free):
    """A ball beside the path: met with a margin, not without."""
    ball = sa.Obstacle.sphere(0.1, pin.SE3(np.eye(3), free.tip[-1, :3] + (0.0, 0.35, 0.0)))
    report = sa.collision_check(free, ball)
    assert report.apart
    gap = report.distance.min()
    kept = sa.Obstacle.sphere(0.1, ball.pose, margin=gap + 0.02, name="dish")
    report = sa.collision_check(free, kept)
    assert not report.apart
    assert "within its margin" in report.story
    assert "dish" in report.checked
    links = [body.link for body in Collisions(arm).bodies]
    assert sa.collision_check(
        free, sa.Obstacle.sphere(0.1, ball.pose, margin=0.2, may_touch=links)
    ).apart


def test_recorded_motions_are_checked_between_their_samples(arm):
    """Two samples on either side of a thin wall: the arm sweeps through it."""
    path = np.array([[-0.6, 0.0], [0.6, 0.0]])
    motion = sa.Motion(arm, [0.0, 1.0], path, np.tile(np.eye(7)[6], (2, 1)), mode="fixed")
    wall = sa.Obstacle.box((0.2, 0.02, 0.5), at(2.2, 0.0, 0.0))
    report = sa.collision_check(motion, wall)
    assert (report.distance > 0.0).all()
    assert not report.apart
    course = Recorded(motion)
    steps = course.swept(Bodies(arm).all)
    assert steps.shape == (len(Bodies(arm).all), 1)
    assert (steps >= 0.0).all()


# --- plans ------------------------------------------------------------------------------------


def test_a_plan_around_obstacles_keeps_clear_of_them_on_the_true_motion(arm, free):
    """Distances by the closed form of a ball and a bar, the attitude by `move`."""
    middle = free.tip[len(free) // 2, :3]
    outward = (middle - free[0].com) / np.linalg.norm(middle - free[0].com)
    ball = sa.Obstacle.sphere(0.12, pin.SE3(np.eye(3), middle + 0.12 * outward), margin=0.03)
    assert not sa.collision_check(free, ball).apart
    plan = sa.plan(arm.at(Q0), GOAL, constraints=sa.Constraints(obstacles=ball))
    assert plan.apart
    assert "obstacles: sphere (0.03 m off)" in plan.checked
    assert plan.obstacles == (ball,)
    np.testing.assert_allclose(plan.tip[-1, :2], GOAL, atol=1e-7)
    for cfg in dense(list(plan), 3):
        for a, b in of_links(cfg, ("link_1", "link_2")):
            s = np.clip((ball.pose.translation - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            assert np.linalg.norm(a + s * (b - a) - ball.pose.translation) > 0.12 + 0.03


def test_a_start_in_an_obstacle_and_other_refusals(arm, tmp_path):
    box = sa.Obstacle.box(1.0, name="hatch")
    with pytest.raises(sa.NoSolutionError, match=r"start is in collision: .* 'hatch'.*may_touch"):
        sa.plan(arm.at(Q0), GOAL, constraints=sa.Constraints(obstacles=[box]))
    with pytest.raises(sa.ConfigurationError, match="leave out collisions=False"):
        sa.plan(arm.at(Q0), GOAL, constraints=sa.Constraints(obstacles=[box], collisions=False))
    with pytest.raises(sa.ConfigurationError, match=r"obstacles is \[1.0\]; give an obstacle"):
        sa.plan(arm.at(Q0), GOAL, constraints=sa.Constraints(obstacles=[1.0]))
    stranger = sa.Obstacle.box(1.0, may_touch=["link_9"])
    with pytest.raises(sa.ConfigurationError, match="unknown link of planar2 'link_9'"):
        sa.plan(arm.at(Q0), GOAL, constraints=sa.Constraints(obstacles=[stranger]))
    path = tmp_path / "bare.urdf"
    path.write_text(
        robot(link("hull", 50.0), link("l1", 5.0), frame("tip"), joint("j1", "hull", "l1"),
              joint("jt", "l1", "tip", "fixed", (1, 0, 0)))
    )  # fmt: skip
    bare = sa.load(path, task="x")
    with pytest.raises(sa.UnsupportedError, match="no shapes that could be held off"):
        sa.plan(bare.at([0.3]), sa.Joints([0.5]), constraints=sa.Constraints(obstacles=[box]))
    with pytest.raises(sa.ModelError, match="has no shape"):
        sa.Obstacle.robot(bare.at([0.0]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sa.Obstacle.box((1.0, -1.0, 1.0)), "size is -1"),
        (lambda: sa.Obstacle.box((1.0, 1.0)), "3 finite numbers"),
        (lambda: sa.Obstacle.sphere(0.0), "radius is 0"),
        (lambda: sa.Obstacle.sphere(1.0, np.eye(3)), "pose is a ndarray"),
        (lambda: sa.Obstacle.sphere(1.0, margin=-0.1), "margin is -0.1"),
        (lambda: sa.Obstacle.sphere(1.0, colour="red"), "unknown option 'colour'"),
        (lambda: sa.Obstacle.sphere(1.0, twist=(1.0, 2.0)), "twist"),
        (lambda: sa.Obstacle.sphere(1.0, may_touch="hand"), "may_touch is 'hand'"),
        (lambda: sa.Obstacle.sphere(1.0, name=""), "name is ''"),
        (lambda: sa.Obstacle.sphere(1.0, along=3), "along is 3; give a motion"),
        (lambda: sa.Obstacle.cylinder(1.0, np.inf), "length is inf"),
        (
            lambda: sa.Obstacle.robot(sa.load("planar2")),
            "thing is a SpaceArm; give",
        ),
        (lambda: sa.collision_check(3), "thing is 3; give a configuration"),
    ],
)
def test_what_no_obstacle_is(make, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        make()


def test_times_of_a_plan_are_those_of_its_check(free):
    times = rest_to_rest_times(free.q, largest_rates(free.arm))
    np.testing.assert_allclose(times, free.t, rtol=1e-5, atol=0)  # rows bent to arrive as flown


# --- what is drawn, kept and printed ----------------------------------------------------------


def test_obstacles_are_drawn_and_not_kept_in_the_file(arm, free, tmp_path):
    ball = sa.Obstacle.sphere(0.1, at(3.0, 2.0, 0.0), twist=[0.01, 0, 0, 0, 0, 0])
    block = sa.Obstacle.robot(arm.at(Q0, base=at(-4, 0, 0)))
    plan = replace(free, obstacles=(ball, block))
    names = sa.plot(plan).subfigs[0].axes[0].get_legend_handles_labels()[1]
    assert "sphere" in names
    plan.save(tmp_path / "plan.npz")
    assert sa.Plan.load(tmp_path / "plan.npz", arm).obstacles == ()
    assert [o["name"] for o in plan.to_dict()["obstacles"]] == ["sphere", "planar2"]
    page = sa.view(plan, open=False).html()
    assert "obstacles" in page


@pytest.mark.slow
def test_command_with_obstacles(tmp_path):
    words = ["plan", "planar2", 0.3, 1.2, "--goal", 0.9, 1.4, "--json"]
    done = spacearm(
        *words, "--obstacle", "sphere:-3,0,0:0.2@0.1", "--obstacle", "robot:5,0,0:planar2:0,0,1",
        "--obstacle", "box:0,-3,0:0.1,0.2,0.3", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert [o["kind"] for o in told["obstacles"]] == ["sphere", "robot", "box"]
    assert told["obstacles"][0]["margin"] == 0.1
    for wrong, message in (
        ("ball:0,0,0:1", "unknown kind 'ball'"),
        ("sphere:0,0:1", "give 3 finite numbers"),
        ("sphere", "give KIND:X,Y,Z:WHAT"),
    ):
        done = spacearm(*words, "--obstacle", wrong, cwd=tmp_path)
        assert done.returncode == 2
        assert message in done.stderr
