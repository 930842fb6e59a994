"""Whether postures are connected: paths that are proven, and proofs that there is none."""

import re
from collections import Counter

import numpy as np
import pinocchio as pin
import pytest
import scipy
from helpers.arms import chosen, load_text, planar_pair, random_chain

import spacearm as sa
from spacearm.motion.goal import goal_axes
from spacearm.planning.many_curves import inverse_kinematics
from spacearm.planning.strategies import relaxations
from spacearm.singularities.polynomials import singularity_polynomial
from spacearm.singularities.sides import on_the_other_side

FEW = sa.Search(timeout=5.0)


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


def side(arm, q):
    return np.sign(sa.singularity(arm.at(q)).determinant)


def test_signs_part_postures_of_square_arms_and_no_path_is_free_between_them():
    """Whatever curve leads from one to the other: det J* falls through zero on it."""
    arm, rng = sa.load("mda6"), np.random.default_rng(3)
    q = rng.uniform(arm.lower, arm.upper, (20, 6))
    sides = np.array([side(arm, x) for x in q])
    a, b = q[sides > 0][0], q[sides < 0][0]
    answer = sa.connected(arm.at(a), arm.at(b))
    assert answer.answer == "no"
    assert "every way between them meets a singularity" in answer.reason
    assert not len(answer.path)
    for bend in rng.normal(size=(3, 6)):
        s = np.linspace(0.0, 1.0, 40)[:, None]
        curve = a + s * (b - a) + np.sin(np.pi * s) * bend
        assert not sa.singular_set(arm).clearance(curve)


def test_the_answer_yes_comes_with_a_path_that_is_proven(arm):
    """Also where the straight line is singular: another way about leads there."""
    rng, found = np.random.default_rng(0), set()
    for _ in range(12):
        a, b = rng.uniform(-3.0, 3.0, (2, 2))
        answer = sa.connected(arm.at(a), arm.at(b), limits=False, search=FEW)
        assert (answer.answer == "no") == (side(arm, a) != side(arm, b))
        if answer.answer == "yes":
            np.testing.assert_array_equal(answer.path[0], a)
            np.testing.assert_array_equal(answer.path[-1], b)
            assert sa.singular_set(arm).clearance(answer.path)
            found.add(answer.reason.split(":")[0])
    assert "straight from one to the other" in found


def test_within_limits_postures_of_one_sign_are_apart_where_no_way_leads_round_the_set(monkeypatch):
    """As the points of a fine grid that have this sign are."""
    monkeypatch.setattr(relaxations, "TIME", 0.1)
    arm = sa.load("planar2").replace(lower=[-2.5, -2.5], upper=[2.0, 5.0])
    ticks = [np.linspace(*ends, 401) for ends in zip(arm.lower, arm.upper, strict=True)]
    Q = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
    S = singularity_polynomial(arm)(Q.reshape(-1, 2)).reshape(401, 401)
    apart, rng = 0, np.random.default_rng(0)
    for _ in range(20):
        a, b = map(tuple, rng.integers(20, 381, (2, 2)).tolist())
        part, _ = scipy.ndimage.label(S * S[a] > 0.0)
        one_sign, joined = S[a] * S[b] > 0.0, part[a] == part[b]
        answer = sa.connected(arm.at(Q[a]), arm.at(Q[b]), search=FEW)
        assert answer.answer == ("yes" if joined else "no")
        assert ("proven by boxes" in answer.reason) == (one_sign and not joined)
        if one_sign and not joined and not apart:
            with pytest.raises(sa.ImpossibleError, match="impossible, proven: det J"):
                sa.plan(arm.at(Q[a]), sa.Joints(Q[b]), search=FEW)
        apart += one_sign and not joined
    assert apart


def test_what_has_no_boxes_is_planned_all_the_same():
    """A slide of 2 km: its minors are mostly rounding, which the message names, and what to do."""
    kinds = ("prismatic", "revolute")
    wide = load_text(random_chain(chosen(3), 3, kinds), tip="tip", task="position")
    assert wide.slides.tolist() == [True, False, False]
    arm = wide.replace(lower={"joint_1": -1e3}, upper={"joint_1": 1e3})
    start, goal = arm.at([0.0, 0.5, 0.5]), np.array([0.05, 0.55, 0.55])
    np.testing.assert_allclose(sa.plan(start, sa.Joints(goal), search=FEW).q[-1], goal, atol=1e-9)
    for ask in (lambda: sa.connected(start, arm.at(goal)), lambda: sa.free_box(start)):
        with pytest.raises(sa.UnsupportedError, match=r"limits.*arm.replace\(lower=, upper=\)"):
            ask()


def test_redundant_arms_have_no_sides():
    arm = sa.load("chaser7")
    rng = np.random.default_rng(1)
    q = rng.uniform(np.maximum(arm.lower, -1.0), np.minimum(arm.upper, 1.0), (2, arm.n))
    answer = sa.connected(*(arm.at(x) for x in q), search=FEW)
    assert answer.answer == "yes"
    assert sa.singular_set(arm).clearance(answer.path)


@pytest.mark.slow
def test_limits_and_singular_ends(arm):
    lower, upper = sa.load("mda6").lower, sa.load("mda6").upper
    mda6 = sa.load("mda6")
    inside = 0.5 * (np.maximum(lower, -2.0) + np.minimum(upper, 2.0))
    j = int(np.flatnonzero(np.isfinite(upper))[0])
    outside = inside.copy()
    outside[j] = upper[j] + 0.1
    with pytest.warns(sa.ModelWarning, match="outside its limits"):
        beyond = mda6.at(outside)
    answer = sa.connected(mda6.at(inside), beyond)
    assert answer.answer == "no"
    assert ("beyond its limits" in answer.reason) == (side(mda6, inside) == side(mda6, outside))
    singular = sa.singular_set(arm).solve([0.3, 1.2])[0]
    answer = sa.connected(arm.at([0.3, 1.2]), arm.at(singular), limits=False, search=FEW)
    assert answer.answer != "yes"


def test_ends_of_different_arms_are_refused(arm):
    with pytest.raises(sa.ConfigurationError, match="one arm"):
        sa.connected(arm.at([0.3, 1.2]), sa.load("planar3").at([0.1, 0.2, 0.3]))


def test_plans_say_that_they_are_impossible(arm):
    with pytest.raises(sa.ImpossibleError, match="impossible, proven: det J"):
        sa.plan(arm.at([0.3, 1.2]), sa.Joints([0.3, -1.2]))
    with pytest.raises(sa.ImpossibleError, match="impossible, proven: the goal is"):
        sa.plan(arm.at([0.3, 1.2]), (40.0, 0.0))


def test_the_relaxation_of_an_impossible_plan_that_is_said_to_work_does(arm):
    """Another posture with the tip at the same place on the spacecraft; an attitude left open."""
    goal = np.array([0.3, -1.2])
    with pytest.raises(sa.ImpossibleError, match="and works: another posture") as error:
        sa.plan(arm.at([0.3, 1.2]), sa.Joints(goal))
    q = np.radians([float(x) for x in re.findall(r"(-?[\d.]+)°", str(error.value))])
    tips = [arm.at(x).centred(np.zeros(3)).tip.translation[:2] for x in (q, goal)]
    np.testing.assert_allclose(*tips, atol=2e-3)  # q is written with four digits
    assert sa.plan(arm.at([0.3, 1.2]), sa.Joints(q)).certificate.free
    with pytest.raises(sa.ImpossibleError, match="and works: final_attitude left open"):
        sa.plan(arm.at([0.3, 1.2]), (0.9, 1.4), final_attitude=sa.pose(rpy=(0.3, 0.0, 0.0)))


@pytest.mark.slow
def test_another_tip_that_is_said_to_work_does(monkeypatch):
    monkeypatch.setattr(relaxations, "TIME", 60.0)  # of a busy machine
    arm = planar_pair(tip="left").replace(link_length={"left_1": 0.3})
    start, free = arm.at([2.0, 0.9]), sa.Constraints(collisions=False)
    held = dict(zip(arm.joint_names, start.q, strict=True))
    other = arm.replace(tip="right", locked=held)
    goal = other.at([0.9, -0.8]).centred(start.com).tip.translation[:2]
    with pytest.raises(sa.ImpossibleError, match="tried, and works: tip='right'"):
        sa.plan(start, goal, constraints=free)
    right = other.at(np.zeros(2)).centred(start.com)
    assert sa.plan(right, goal, constraints=free).certificate.free


def test_what_is_not_connected_says_which_posture_is(arm, monkeypatch):
    monkeypatch.setattr(relaxations, "TIME", 60.0)
    start, goal = arm.at([0.3, 1.2]), arm.at([0.3, -1.2])
    reason = sa.connected(start, goal, search=sa.Search(timeout=60.0)).reason
    assert "tried, and works: another posture of the same pose" in reason
    q = np.radians([float(x) for x in re.findall(r"(-?[\d.]+)°", reason)])
    assert sa.connected(start, arm.at(q)).answer == "yes"


@pytest.mark.parametrize("seed", range(3))
def test_random_arms(seed):
    arm = load_text(random_chain(seed, 6))
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-1.0, 1.0, (2, arm.n))
    answer = sa.connected(arm.at(a), arm.at(b), limits=False, search=sa.Search(timeout=2.0))
    assert (answer.answer == "no") == (side(arm, a) != side(arm, b))


def limited(name, task, low, high):
    """An arm of the catalogue with other joint limits."""
    pairs = iter(zip(low, high, strict=True))
    text = re.sub(
        r'lower="[^"]*" upper="[^"]*"',
        lambda _: 'lower="{:.9f}" upper="{:.9f}"'.format(*next(pairs)),
        sa.load(name).path.read_text(),
    )
    return load_text(text, task=task)


@pytest.mark.slow
def test_no_posture_of_the_starts_sign_is_found_where_it_is_proven_that_there_is_none():
    """Inverse kinematics from everywhere, the attitude free, contradicts no proof."""
    rng, proven = chosen(5), Counter()
    for name, task in (("planar2", "x y"), ("planar3", "x y rz")) * 12:
        n = int(name[-1])
        low = rng.uniform(-2.5, 0.5, n)
        arm = limited(name, task, low, low + rng.uniform(0.5, 2.5, n))
        S, Q = singularity_polynomial(arm), rng.uniform(arm.lower, arm.upper, (50, n))
        q, end, turn = Q[S(Q).argmin()], Q[S(Q).argmax()], rng.uniform(-3.0, 3.0)
        start = arm.at(q).centred(np.zeros(3))
        turned = pin.SE3(pin.exp3(np.array([0.0, 0.0, turn])), np.zeros(3))
        goal = arm.at(end, base=turned).centred(np.zeros(3)).tip
        why = on_the_other_side(start, goal, goal_axes(start), arm.lower, arm.upper)
        limits = arm.lower, arm.upper
        Q, _, miss = inverse_kinematics(
            arm, rng.uniform(*limits, (200, n)), goal, np.tile(np.eye(3), (200, 1, 1)),
            goal_axes(start), 40, limits=limits, turning=True,
        )  # fmt: skip
        sides = S(Q[miss < 1e-7]) / S.scale * np.sign(S(q))
        assert not why or (sides <= 1e-5).all()
        proven[bool(why), bool((sides > 0.0).any())] += 1
    assert proven[True, False]
    assert proven[False, True]


def test_a_plan_to_the_other_side_is_impossible_whatever_the_attitude_and_says_what_works():
    arm = limited("planar3", "x y rz", [-1.0, 0.3, 0.3], [1.0, 1.2, 1.2])
    wide = sa.load("planar3", task="x y rz")
    S = singularity_polynomial(wide)
    start = arm.at([0.0, 0.5, 0.5])
    origin, axes = np.zeros(3), np.eye(3)
    others = np.random.default_rng(0).uniform(-2.0, 2.0, (100, 3))
    places = [wide.at(q).centred(origin) for q in others if S(q) * S(start.q) < 0.0]
    here, within = start.centred(origin), (arm.lower, arm.upper)
    end = next(cfg for cfg in places if on_the_other_side(here, cfg.tip, axes, *within))
    goal = end.centred(start.com).tip
    with pytest.raises(sa.ImpossibleError, match="whatever the attitude") as caught:
        sa.plan(start, goal, constraints=sa.Constraints(collisions=False))
    with pytest.raises(sa.ImpossibleError, match="whatever the attitude"):  # no line arrives either
        sa.plan(
            start,
            goal,
            constraints=sa.Constraints(collisions=False),
            search=sa.Search(method="straight"),
        )
    free = sa.Constraints(collisions=False, limits=False)
    if "tried, and works: limits=False" in str(caught.value):
        assert sa.plan(start, goal, constraints=free).certificate.free
    else:
        assert "tried without success: limits=False" in str(caught.value)
