"""Free boxes for all values in the intervals, against random members of the family."""

import numpy as np
import pytest
from helpers.arms import chosen, load_text, random_chain

import spacearm as sa
from spacearm.singularities.regularity import Momenta
from spacearm.uncertainty.robust_boxes import Family


def members(about, rng, m):
    """Random members, half of them corners of the box of values."""
    shares = about.sample(m, rng)
    shares[::2] = shares[::2].round()
    return [about.realise(t) for t in shares]


def inside(box, rng, m):
    low, high = np.clip(box.lower, -np.pi, None), np.clip(box.upper, None, np.pi)
    return low + (high - low) * rng.uniform(size=(m, box.arm.n))


def check(about, box, rng, arms=20, m=500):
    """No sampled member is singular in the box, and stops are singular for the values named."""
    for arm in members(about, rng, arms):
        signs = np.sign(sa.evaluate(arm, inside(box, rng, m), ["determinant"])["determinant"])
        assert abs(signs.sum()) == m
    for stop in box.stops:
        if stop.why == "singular":
            p = about.parameters
            values = [stop.values.get(x.name, 0.5 * (x.low + x.high)) for x in p]
            shares = [(v - x.low) / (x.high - x.low) for v, x in zip(values, p, strict=True)]
            there = about.realise(np.clip(shares, 0.0, 1.0)).at(stop.at)
            assert sa.singularity(there).sigma_min < 1e-8
            assert not box.contains(stop.at)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
def test_no_member_is_singular_in_the_box_and_each_stop_is_of_a_member():
    arm, rng = sa.load("planar2"), np.random.default_rng(0)
    about = sa.uncertain(arm, {"link_1": {"com": [0.05, 0, 0]}, "spacecraft": {"mass": 0.2}})
    start, within = arm.at([0.3, 1.2]), ([-0.5, -1.0], [1.0, 3.0])
    box = sa.free_box_for_all(about, start, within=within)
    check(about, box, rng)
    assert any(stop.why == "singular" for stop in box.stops)
    nominal = sa.free_box(start, within=within)
    narrower = box.upper - box.lower <= nominal.upper - nominal.lower + 1e-9
    assert narrower.any()
    assert set(box.uncertain) == {p.name for p in about.parameters}
    assert box.to_dict()["uncertain"]["mass of spacecraft"] == list(
        box.uncertain["mass of spacecraft"]
    )


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
def test_random_arms_have_boxes_that_no_member_contradicts():
    rng = np.random.default_rng(3)
    for n, kinds in ((3, ("revolute",)), (4, ("revolute", "prismatic"))):
        text, task = random_chain(rng, n, kinds), "position" if n == 3 else "x y z rx"
        arm = load_text(text, tip="tip", task=task)
        about = sa.uncertain(arm, {name: {"mass": 0.1} for name in ("bus", "link_1")})
        low, high = np.maximum(arm.lower, -0.5), np.minimum(arm.upper, 0.5)
        Q = low + (high - low) * rng.uniform(size=(200, n))
        start = Q[np.argmax(sa.evaluate(arm, Q, ["sigma_min"])["sigma_min"])]
        box = sa.free_box_for_all(about, arm.at(start), within=(low, high))
        check(about, box, rng)


def test_a_redundant_arm_keeps_its_rank_in_the_box():
    arm, rng = sa.load("planar3", task="x y"), np.random.default_rng(1)
    about = sa.uncertain(arm, {"link_2": {"mass": 0.1}})
    box = sa.free_box_for_all(
        about, arm.at([0.2, 1.1, -0.7]), within=([-0.2, 0.8, -1.2], [0.6, 1.4, -0.2])
    )
    assert (box.upper > box.lower).all()
    for one in members(about, rng, 4):
        assert all(sa.singularity(one.at(q)).sigma_min > 1e-4 for q in inside(box, rng, 20))


@pytest.mark.slow
def test_a_clearance_is_kept_by_every_member():
    """Also where nothing is left of a slab in which a singular posture is looked for."""
    arm, rng = sa.load("planar3"), np.random.default_rng(2)
    about = sa.uncertain(arm, {"spacecraft": {"mass": 0.3}})
    q = chosen(1).uniform(-2.5, 2.5, 3)
    box = sa.free_box_for_all(about, arm.at(q), clearance=0.03)
    check(about, box, rng)
    for member in members(about, rng, 6):
        for x in inside(box, rng, 4):
            assert sa.singularity(member.at(x), exact=True).distance > 0.03


def test_enclosures_hold_the_momenta_of_members():
    """The bound R of M X - 1 holds for random members and postures of random boxes."""
    arm, rng = sa.load("planar3"), np.random.default_rng(2)
    about = sa.uncertain(arm, {"link_1": {"mass": 0.3, "inertia": 0.2}, "spacecraft": {"com": 0.1}})
    n, p = arm.n, len(about.parameters)
    family = Family(
        Momenta(about, np.zeros((1, 1, n))), np.zeros(n), np.ones(n), -np.ones(n), np.ones(n)
    )
    centre = rng.uniform(-0.6, 0.6, (5, n + p))
    half = rng.uniform(0.05, 0.3, (5, n + p))
    X, R = family.enclosure(centre, half)[:2]
    for _ in range(40):
        x = centre + half * rng.choice([-1.0, 0.3, 1.0], (5, n + p))
        E = family.matrix(x) @ X - np.eye(R.shape[1])
        assert (np.abs(E) <= R * (1.0 + 1e-9)).all()


def test_what_is_of_another_arm_is_refused():
    arm = sa.load("planar2")
    about = sa.uncertain(arm, {"link_1": {"mass": 0.1}})
    with pytest.raises(sa.ConfigurationError, match="another arm"):
        sa.free_box_for_all(about, sa.load("mda6").at(np.zeros(6)))


def test_time_limits_the_proof_of_a_box():
    """What is not settled by then is undecided; the ranges that are proven hold all the same."""
    arm = sa.load("planar2")
    about = sa.uncertain(arm, {"link_1": {"mass": 0.1}})
    long = sa.free_box_for_all(about, arm.at([0.3, 1.2]), timeout=3600.0)
    short = sa.free_box_for_all(about, arm.at([0.3, 1.2]), timeout=1e-9)
    assert any(stop.why == "singular" for stop in long.stops)
    assert all(stop.why in ("undecided", "irrelevant") for stop in short.stops)
    assert (short.lower >= long.lower - 1e-12).all()
    assert (short.upper <= long.upper + 1e-12).all()
    assert short.contains([0.3, 1.2])
    with pytest.raises(sa.ConfigurationError, match="timeout is 0"):
        sa.free_box_for_all(about, arm.at([0.3, 1.2]), timeout=0)
