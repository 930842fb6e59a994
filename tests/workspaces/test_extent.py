"""Bounds of the tip's distance within a box: never passed, and next to what is reached."""

import numpy as np
import pytest
from helpers.arms import frame, joint, link, load_text, random_chain, robot

import spacearm as sa
from spacearm.singularities.polynomials import distances, radius_squared
from spacearm.workspaces.extent import NEAR, Box, chain_of, largest_distance_within, least_distance
from spacearm.workspaces.shells import ShellSearch


def torus(arm):
    return Box.of(arm.lower, arm.upper, limits=False)


def some_box(arm, seed):
    """A box with a random middle; some sides are short, so that extremes lie on faces."""
    rng = np.random.default_rng(seed)
    middle, half = rng.uniform(-3.0, 3.0, arm.n), rng.uniform(0.2, 1.6, arm.n)
    return Box(middle - half, middle + half, limited=True)


def descent(R2, q, box, sign):
    """Move each joint in turn to where sign R^2 is least: it is a cos q + b sin q + c in each."""
    for _ in range(100):
        for j in range(len(q)):
            at = np.tile(q, (5, 1))
            at[:3, j] = 0.0, np.pi / 2, np.pi
            f = R2(at[:3])
            c = 0.5 * (f[0] + f[2])
            best = np.arctan2(f[1] - c, f[0] - c) + (np.pi if sign > 0 else 0.0)
            best = box.low[j] + (best - box.low[j]) % (2.0 * np.pi)
            at[:3, j] = box.low[j], box.high[j], min(best, box.high[j])
            q = at[np.argmin(sign * R2(at[:3]))]
    return q


def check(arm, box, mode, seed):
    """Neither a sample nor descents from its best points pass the bounds, which are near them."""
    rng = np.random.default_rng(seed)
    Q = rng.uniform(box.low, box.high, (50_000, arm.n))
    R2 = radius_squared(arm, mode=mode)
    order = np.argsort(R2(Q))
    low = np.array([descent(R2, q, box, 1.0) for q in Q[order[:8]]])
    high = np.array([descent(R2, q, box, -1.0) for q in Q[order[-8:]]])
    tried = distances(arm, np.concatenate((Q, low, high)), mode)
    known = ShellSearch(arm, mode, box).about((), Q[:4096]).radius
    least, largest = (
        least_distance(arm, mode, box, known),
        largest_distance_within(arm, mode, box, known),
    )
    assert least <= min(known[0], tried.min()) + 1e-12
    assert largest >= max(known[1], tried.max()) - 1e-12
    assert least >= known[0] - 2.0 * NEAR * known[1]
    assert largest <= known[1] * (1.0 + 10.0 * NEAR)
    return known, least


@pytest.mark.parametrize("mode", ["free-floating", "fixed"])
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))]
)
def test_bounds_within_boxes(seed, mode):
    arm = load_text(random_chain(seed, 3 + seed, ("revolute",)), tip="tip")
    check(arm, some_box(arm, seed), mode, seed)


def planar(*lengths):
    """A chain in a plane with hardly any mass: its constant vectors are its links."""
    parts, before = [link("bus", 1e3, inertia=1e3 * np.eye(3))], "bus"
    for k, length in enumerate(lengths[:-1], 1):
        parts.append(link(f"l{k}", 1e-9, inertia=1e-10 * np.eye(3)))
        parts.append(joint(f"j{k}", before, f"l{k}", xyz=(length, 0, 0)))
        before = f"l{k}"
    tip = (frame("tip"), joint("jt", before, "tip", "fixed", (lengths[-1], 0, 0)))
    return load_text(robot(*parts, *tip), tip="tip", task="x y" if len(lengths) == 3 else "x")


@pytest.mark.parametrize("lengths", [(0.3, 1.0), (1.0, 0.4), (0.2, 1.0, 0.5), (0.1, 0.2, 1.3)])
def test_the_hole_of_a_planar_chain_is_its_longest_link_less_the_others(lengths):
    arm = planar(*lengths)
    hole = 2.0 * max(lengths) - sum(lengths)
    bound = least_distance(arm, "free-floating", torus(arm), np.array([hole, sum(lengths)]))
    assert hole - 2.0 * NEAR * sum(lengths) < bound <= hole + 1e-9


def test_limits_that_cut_a_planar_chain():
    """Links of 1 and 0.5 m at no less than 60 degrees from the line inwards: the law of cosines."""
    arm = planar(1.0, 0.5)
    box = Box(np.array([-2.0 * np.pi / 3.0]), np.array([-np.pi / 3.0]), limited=True)
    least, largest = np.sqrt(1.25 - 0.5), np.sqrt(1.25 + 0.5)
    known = np.array([least, largest])
    assert least - 1e-4 < least_distance(arm, "free-floating", box, known) <= least + 1e-9
    largest_bound = largest_distance_within(arm, "free-floating", box, known)
    assert largest - 1e-9 <= largest_bound < largest + 1e-4


def test_what_is_not_attained_is_not_passed():
    """Asked to come near to a distance that is too large, the bound stays below the true one."""
    arm = planar(0.3, 1.0)
    assert least_distance(arm, "free-floating", torus(arm), np.array([0.9, 1.3])) <= 0.7 + 1e-9


def test_branches_have_no_bound():
    arm = sa.load("dual_ur5", joints="all")
    assert chain_of(arm, "free-floating") is None
    assert least_distance(arm, "free-floating", torus(arm), np.array([1.0, 2.0])) == 0.0


@pytest.mark.slow
def test_the_hole_of_a_catalogue_arm():
    arm = sa.load("servicer_ur5")
    known, least = check(arm, torus(arm), "free-floating", 0)
    assert least > 0.99 * known[0]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "n"), [(2, 3), (8, 6), (0, 7)])
def test_the_bounds_are_next_to_what_spatial_arms_reach(seed, n):
    arm = load_text(random_chain(seed, n, ("revolute",)), tip="tip")
    for box in (torus(arm), some_box(arm, seed)):
        check(arm, box, "free-floating", seed)


@pytest.mark.slow
@pytest.mark.parametrize("limits", [False, True])
def test_an_arm_that_does_not_reach_the_centre_is_certified(limits):
    arm = load_text(random_chain(8, 6, ("revolute",)), tip="tip")
    result = sa.workspace(arm, effort=20_000, limits=limits)
    assert result.pdw[0, 0] > 0.5
    assert result.kind == "certified"
    assert result.gap < 1e-4 * result.reachable[0, 1]
