"""Many curves at once: they turn the spacecraft as one does, and arrive where they should."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chosen, random_base

import spacearm as sa
from spacearm.mechanics.floating import walk
from spacearm.planning.guesses import INTERVALS, FreeSpace, GuessFinder
from spacearm.planning.many_curves import inverse_kinematics, spacecraft_turns
from spacearm.planning.optimiser import CurveFamily, CurveOptimiser, Sines, Target, sides


def test_a_curve_that_crosses_what_divides_joint_space_changes_sides():
    x = np.array([0.3, 0.1, -0.1, -0.2, 0.1])
    normal = np.array([0.6, 0.8])
    away, distance = np.sign(x)[:, None] * normal, np.abs(x)
    assert list(sides(away, distance)) == [1, 1, -1, -1, 1]
    along = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, -1.0]])  # about a point: no sides
    assert list(sides(along, np.full(3, 0.1))) == [1, 1, 1]
    assert list(sides(away, distance + 1.0)) == [1] * 5  # too far to tell


@pytest.mark.parametrize("name", ["planar2", "mda6", "chaser7"])
def test_many_curves_turn_the_spacecraft_as_each_alone(name):
    arm, rng = sa.load(name), np.random.default_rng(1)
    family = CurveFamily(arm, rng.normal(size=arm.n), Sines(3), INTERVALS)
    curves = rng.normal(size=(5, 4, arm.n))
    Q = np.array([family.points(p)[:-1] for p in curves])
    rates = np.array([family.slope @ (p - family._offset) for p in curves])
    for p, turn in zip(curves, spacecraft_turns(arm, Q, rates), strict=True):
        alone = family.samples(p, family.points(p))
        np.testing.assert_allclose(turn, alone.turn, atol=1e-12)


def test_landing_with_the_attitude_held():
    arm, rng = sa.load("mda6"), chosen(2)
    T = np.array([random_base(rng).rotation for _ in range(40)])
    goal = arm.at(rng.uniform(-1, 1, 6)).centred(np.zeros(3)).tip
    Q, _, miss = inverse_kinematics(arm, rng.uniform(-3, 3, (40, 6)), goal, T, np.eye(3), 40)
    there = np.flatnonzero(miss < 1e-9)
    assert len(there) > 10
    for i in there:
        tip = arm.at(Q[i], base=pin.SE3(T[i], np.zeros(3))).centred(np.zeros(3)).tip
        np.testing.assert_allclose(tip.homogeneous, goal.homogeneous, atol=1e-8)


@pytest.mark.parametrize(("name", "task"), [("mda6", "pose"), ("planar3", "x y rz")])
def test_landing_with_an_attitude_that_is_free(name, task):
    """Few attitudes let the arm reach the pose: only those that turn find them."""
    arm, rng = sa.load(name, task=task), np.random.default_rng(2)
    normal = arm.tree.plane_normal()
    goal = arm.at(np.full(arm.n, 0.3)).centred(np.zeros(3)).tip
    w = rng.normal(size=(40, 3)) * (1.0 if normal is None else np.eye(3)[normal])
    T = np.array([pin.exp3(turn) for turn in w])
    q, limits = rng.uniform(arm.lower, arm.upper, (40, arm.n)), (arm.lower, arm.upper)
    Q, T, miss = inverse_kinematics(arm, q, goal, T, np.eye(3), 60, limits=limits, turning=True)
    there = np.flatnonzero(miss < 1e-9)
    assert len(there) > 20
    for i in there:
        tip = arm.at(Q[i], base=pin.SE3(T[i], np.zeros(3))).centred(np.zeros(3)).tip
        np.testing.assert_allclose(tip.homogeneous, goal.homogeneous, atol=1e-8)
        assert ((arm.lower <= Q[i]) & (Q[i] <= arm.upper)).all()
        np.testing.assert_allclose(T[i].T @ T[i], np.eye(3), atol=1e-12)


def test_free_space_ends_at_limits_and_singularities():
    arm = sa.load("mda6")
    q = np.radians([0, 60, -100, -50, 30, 0])
    free = FreeSpace(arm, q, arm.lower, arm.upper)
    inside = q + 1e-3 * np.linspace(0, 1, 5)[:, None] * np.ones(6)
    beyond = q + np.linspace(0, 1, 5)[:, None] * np.array([0, 0, 0, 0, 0, 4.0])
    elbow = q + np.linspace(0, 1, 41)[:, None] * np.array([0, 0, np.radians(200), 0, 0, 0])
    room = free.least_distance(
        np.array([np.resize(inside, (41, 6)), np.resize(beyond, (41, 6)), elbow])
    )
    least = sa.evaluate(arm, inside, ("distance",))["distance"].min()
    assert room[0] == pytest.approx(min(1.0, least))
    assert (room[1:] < 0.0).all()
    np.testing.assert_allclose(free.wrapped(q[None] + 2 * np.pi), q[None], atol=1e-12)


@pytest.mark.parametrize("way", ["direct", "looped"])
@pytest.mark.parametrize("name", ["planar2", pytest.param("mda6", marks=pytest.mark.slow)])
def test_guesses_arrive_and_are_free(name, way):
    arm, rng = sa.load(name), np.random.default_rng(3)
    q = np.array([0.7, 1.1]) if name == "planar2" else np.radians([0, 60, -100, -50, 30, 0])
    start = arm.at(q).centred(np.zeros(3))
    turned = arm.at(q + 0.3, base=pin.SE3(pin.exp3(np.array([0, 0, 0.2])), np.zeros(3)))
    tip = turned.centred(np.zeros(3)).tip
    target = Target(tip, None, None, 1e-3, arm.lower, arm.upper)
    finder = GuessFinder(start, target, 3, rng)
    guesses = list(finder.curves(0.5, 600) if way == "direct" else finder.loops_and_lines())
    free = [guess for guess in guesses if guess.room > 0.0][:5]
    assert free
    for guess in free:
        optimiser = CurveOptimiser(start, target, Sines(3), guess.loops)
        motion = walk(start, optimiser.positions(guess.x))
        assert (
            np.linalg.norm(optimiser.target.missed(motion[0], motion[-1])) < 5e-3
        )  # its integration is coarse
        assert min(sa.singularity(cfg).distance for cfg in motion) > 0.5 * guess.room
        assert (finder.points(guess) <= arm.upper).all()
