"""Ways of straight pieces whose turns of the spacecraft add up."""

from itertools import islice, pairwise
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import quad

import spacearm as sa
from spacearm.collisions.separation import Collisions
from spacearm.mechanics.floating import walk
from spacearm.planning.guesses import GuessFinder
from spacearm.planning.optimiser import Corners, CurveFamily, CurveOptimiser, Sines, Target
from spacearm.planning.roadmap import GAP, Roadmap
from tests.helpers.replay import replay


@pytest.mark.parametrize("shape", [Sines(3), Corners(3), Corners(0)])
def test_lengths_are_the_integrals_of_the_slopes(shape):
    arm, rng = sa.load("mda6"), np.random.default_rng(0)
    family = CurveFamily(arm, rng.normal(size=6), shape, shape.intervals)
    p = rng.normal(size=(shape.count + 1, 6))

    def squared(s):
        ahead, behind = (
            family.q0 + shape.at(np.array([x]))[0] @ (p - family._offset)
            for x in (s + 1e-6, s - 1e-6)
        )
        return float((((ahead - behind) / 2e-6) ** 2).sum())

    knots = np.linspace(0.0, 1.0, 5)
    whole = sum(quad(squared, a + 1e-5, b - 1e-5)[0] for a, b in pairwise(knots))
    assert family.length_squared(p)[0] == pytest.approx(whole, rel=1e-3)


def test_the_derivatives_of_contacts_and_ends_are_those_of_differences():
    arm, rng = sa.load("chaser7"), np.random.default_rng(1)
    start = arm.at(rng.uniform(-1.0, 1.0, 7)).centred(np.zeros(3))
    target = Target(start.tip, None, None, 1e-3, arm.lower, arm.upper)
    optimiser = CurveOptimiser(start, target, Corners(2), 2, collisions=Collisions(arm))
    x = np.concatenate((start.q, np.zeros(14), np.zeros(14))) + rng.normal(scale=0.3, size=35)
    optimiser._pairs = np.arange(len(optimiser._collisions.gaps(start.q)))
    at, way = optimiser.values(x), rng.normal(size=35)
    ahead, behind = (optimiser.values(x + h * way) for h in (1e-6, -1e-6))
    ends = (ahead.end - behind.end) / 2e-6
    assert at.d_end @ way == pytest.approx(ends, rel=1e-4, abs=1e-5)
    count = len(
        optimiser._contact_margins(
            optimiser._collisions, optimiser.family.points(optimiser.parts(x)[0])
        )[0]
    )
    contacts = slice(-count, None)  # of the loop, the last ones
    slopes = (ahead.margins - behind.margins)[contacts] / 2e-6
    assert count
    assert at.d_margins[contacts] @ way == pytest.approx(slopes, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize(
    "name", ["planar3", *(pytest.param(n, marks=pytest.mark.slow) for n in ("mda6", "chaser7"))]
)
def test_guesses_lead_near_the_goal_clear_of_singularities_and_contacts(name):
    arm, rng = sa.load(name), np.random.default_rng(2)
    q = np.radians([0, 60, -100, -50, 30, 0, 20])[: arm.n]
    start = arm.at(q).centred(np.zeros(3))
    turn = 1.0 * np.eye(3)[2]
    tip = arm.at(q + 0.2, base=pin.SE3(pin.exp3(turn), np.zeros(3))).centred(np.zeros(3)).tip
    target = Target(tip, None, None, 1e-3, arm.lower, arm.upper)
    bodies = Collisions(arm)
    finder = GuessFinder(start, target, 3, rng, collisions=bodies)
    guesses = list(islice(Roadmap(finder).guesses(), 20))
    assert guesses
    for guess in guesses:
        corners = finder.points(guess)
        assert guess.room > target.clearance
        assert bodies.contact(corners) is None
        end = walk(start, corners)[-1]
        far = max(1.0, float(np.linalg.norm(end.tip.translation)))
        assert np.linalg.norm(target.missed(start, end)) < 2.0 * GAP * far
        assert ((corners >= arm.lower) & (corners <= arm.upper)).all()


def test_ways_avoid_pieces_on_which_a_contact_was_found():
    arm, rng = sa.load("planar3"), np.random.default_rng(2)
    start = arm.at(np.radians([0, 60, -100])).centred(np.zeros(3))
    goal = arm.at(start.q + np.array([0.6, -0.1, 0.1])).centred(np.zeros(3))
    target = Target(goal.tip, None, None, 1e-3, arm.lower, arm.upper)

    def meets_wall(corners):
        """A wall across joint 1, too thin to be seen at single postures, with a gap."""
        (a, b), wall = corners, start.q[0] + 0.3
        if (a[0] - wall) * (b[0] - wall) >= 0.0:
            return None
        return (a + (wall - a[0]) / (b[0] - a[0]) * (b - a))[2] < start.q[2] + 0.3 or None

    bodies = SimpleNamespace(touch=lambda _: False, contact=meets_wall)
    road = Roadmap(GuessFinder(start, target, 3, rng, collisions=bodies))
    guesses = list(islice(road.guesses(), 2000))
    blocked = {piece for piece, free in road._found_free.items() if not free}
    taken = {(min(i, j), max(i, j)) for i, j in enumerate(road._before.tolist()) if j >= 0}
    assert guesses
    assert blocked
    assert not taken & blocked
    for guess in guesses[:50]:
        assert not any(meets_wall(piece) for piece in pairwise(road.finder.points(guess)))


@pytest.mark.slow
def test_a_roadmap_leads_to_a_pose_that_takes_a_large_turn_of_the_spacecraft():
    arm, q = sa.load("mda6"), np.radians([0, 60, -100, -50, 30, 0])
    goal = arm.at(q, base=pin.SE3(pin.exp3(np.array([0.0, 0.0, 1.2])), np.zeros(3)))
    goal = goal.centred(arm.at(q).com).tip
    plan = sa.plan(arm.at(q), goal, search=sa.Search(method="roadmap", timeout=120.0))
    end, _ = replay(plan)
    assert plan.certificate.free
    assert plan.apart
    assert end.tip.translation == pytest.approx(goal.translation, abs=1e-7)
    assert pin.log3(goal.rotation.T @ end.tip.rotation) == pytest.approx(0.0, abs=1e-7)
