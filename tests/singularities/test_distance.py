"""Distances to the singular set: against nearest points found, and free of units."""

import numpy as np
import pytest
from helpers.arms import chosen, joint, link, load_text, random_chain, robot, scaled, spherical
from hypothesis import given, settings
from hypothesis import strategies as st

import spacearm as sa
from spacearm.mechanics.distance import led_near, linearise, lose_rank
from spacearm.model.joints import joint_scales

SQUARE = ("planar2", "planar3", "mda6", "ets7")
CATALOGUE = tuple(info.name for info in sa.catalogue())
DEGREES = (0.01, 0.1, 0.3)


def slider(seed, n=6):
    return load_text(random_chain(seed, n, ("revolute", "prismatic")), tip="tip")


ARMS = {
    **{name: lambda name=name: sa.load(name) for name in (*SQUARE, "chaser7", "cubesat_xarm")},
    "planar3, x y": lambda: sa.load("planar3", task="x y"),
    "6 joints, some slide": lambda: slider(4),
    "7 joints, some slide": lambda: slider(1, 7),
    "two tips": lambda: sa.load("dual_ur5", tip=("left", "right"), task="position"),
    "position, 4 joints": lambda: load_text(random_chain(0, 4), tip="tip", task="position"),
}


def beside(arm, rng, m, deg):
    """m points of the singular set moved by some degrees, in radians as the arm counts them."""
    Q = sa.singular_set(arm).sample(m, rng)
    steps = rng.normal(size=Q.shape)
    steps *= np.radians(deg) / np.linalg.norm(steps, axis=1)[:, None]
    return Q + joint_scales(arm) * steps


LARGE = ("chaser7", "two tips", "cubesat_xarm", "7 joints, some slide")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in LARGE else n for n in ARMS]
)
def test_distances_near_the_set_are_right_to_a_fifth(name):
    """Beside a singular configuration; the nearest one is found by a search."""
    arm, rng = ARMS[name](), np.random.default_rng(0)
    for deg in DEGREES:
        for q in beside(arm, rng, 3, deg):
            cfg = arm.at(q)
            exact = sa.singularity(cfg, exact=True)
            assert exact.distance <= np.radians(deg) * (1 + 1e-6)
            assert sa.singularity(cfg).distance == pytest.approx(exact.distance, rel=0.2)
            assert sa.singularity(arm.at(exact.nearest)).distance < 1e-7
            step = (q - exact.nearest) / joint_scales(arm)
            assert np.linalg.norm(step) == pytest.approx(exact.distance, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_distances_are_right_to_a_fifth_below_one_degree(name):
    """Of many points; those moved by 3 degrees count where the set is that near all the same."""
    arm, rng = ARMS[name](), np.random.default_rng(1)
    m, ratios = 12 if name in LARGE else 40, []
    for q in (*beside(arm, rng, m, 0.9), *beside(arm, rng, m, 3.0)):
        found = sa.singularity(arm.at(q), exact=True)
        if found.distance < np.radians(1.0):
            ratios.append(found.distances[-1] / found.distance)
    assert len(ratios) >= m
    assert (np.abs(np.array(ratios) - 1.0) < 0.2).mean() > 0.95
    assert np.median(ratios) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("name", ["planar2", "planar3"])
def test_the_exact_distance_is_that_of_the_set(name):
    arm, rng = sa.load(name), np.random.default_rng(0)
    for q in rng.uniform(-np.pi, np.pi, (3, arm.n)):
        report, d = sa.singularity(arm.at(q), exact=True), sa.singular_set(arm).nearest(q).distance
        assert report.distance == pytest.approx(d, abs=1e-7)
        assert (report.away * report.distance) == pytest.approx(q - report.nearest, abs=1e-9)


@pytest.mark.parametrize(
    "name",
    ["mda6", "chaser7", "6 joints, some slide", pytest.param("two tips", marks=pytest.mark.slow)],
)
def test_the_exact_distance_is_one_and_the_same(name):
    arm, rng = ARMS[name](), np.random.default_rng(3)
    q = beside(arm, rng, 1, 3.0)[0]
    report, near = sa.singularity(arm.at(q), exact=True), sa.singular_set(arm).nearest(q)
    assert report.distance == near.distance
    assert report.distance_proven == near.distance_proven
    assert np.array_equal(report.nearest, near.q)


@pytest.mark.parametrize("name", ["mda6", "chaser7", "6 joints, some slide"])
def test_many_and_one_take_the_second_step_alike(name):
    """From 0 to 5 degrees: all of it, some of it, none; ways out lead away by the distance."""
    arm, rng = ARMS[name](), np.random.default_rng(2)
    Q = np.concatenate([beside(arm, rng, 20, deg) for deg in (0.5, 3.0, 5.0)])
    found = sa.evaluate(arm, Q, ("distance", "away"))
    for i in range(0, 60, 4):
        report = sa.singularity(arm.at(Q[i]))
        assert found["distance"][i] == pytest.approx(report.distance, rel=1e-7)
        assert found["away"][i] == pytest.approx(report.away, abs=1e-6)
        assert np.linalg.norm(report.away / joint_scales(arm)) == pytest.approx(1.0)


def test_the_distance_of_a_redundant_arm_is_not_sigma_min_over_its_slope():
    """The singular set has codimension 2: about it sigma_min is a cone of unequal slopes."""
    arm, rng = sa.load("chaser7"), np.random.default_rng(0)
    short = []
    for q in beside(arm, rng, 12, 0.05):
        report = sa.singularity(arm.at(q))
        short.append(report.sigma_min / np.linalg.norm(report.gradient) / report.distance)
    assert max(short) < 1 + 1e-9
    assert min(short) < 0.7


@pytest.mark.parametrize("mode", ["fixed", "attitude-controlled"])
@pytest.mark.parametrize("elbow", [1e-2, 1e-4, 1e-6, 1e-9, 1e-12])
def test_a_straight_elbow_is_singular_although_the_arm_is_redundant(mode, elbow):
    """One equation makes a spherical shoulder and wrist lose rank, not n - k + 1 = 2 of them.

    The slopes of the other one vanish as sigma_min does; taken as an equation they made the elbow
    seem up to radians away from being straight.
    """
    arm, rng = spherical(), np.random.default_rng(0)
    Q = rng.uniform(0.3, 1.5, (60, 7))
    Q[:, 3] = elbow
    found = np.array([sa.singularity(arm.at(q), mode=mode).distance for q in Q[:6]])
    many = linearise(arm, Q, mode)
    np.testing.assert_allclose(found, elbow, rtol=0.01, atol=0)
    np.testing.assert_allclose(many.distance, elbow, rtol=0.1, atol=0)
    np.testing.assert_allclose(np.abs(many.rows[:, 0, 3]), 1.0, atol=0.02 + 5 * elbow)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::spacearm.errors.ModelWarning")  # links of hundreds of metres
@pytest.mark.parametrize("name", ["mda6", "chaser7"])
@pytest.mark.parametrize("length", [0.01, 100.0])
@pytest.mark.parametrize("mass", [1e-3, 1e3])
def test_lengths_and_masses_change_no_verdict(name, length, mass, tmp_path):
    arm = sa.load(name)
    text = arm.to_urdf(tmp_path / "arm.urdf").read_text()
    other = load_text(scaled(text, length, mass), tip=arm.tip, check="accept")
    assert_same_verdicts(arm, other)


@given(st.integers(0, 1000), st.sampled_from([0.01, 0.1, 10, 100]), st.sampled_from([1e-3, 1e3]))
@settings(max_examples=10)
def test_nor_do_those_of_arms_that_slide(seed, length, mass):
    text = random_chain(seed, 4, ("revolute", "prismatic"))
    arm, other = (
        load_text(t, tip="tip", task="position") for t in (text, scaled(text, length, mass))
    )
    Q = np.random.default_rng(seed).uniform(-2, 2, (4, arm.n))
    for q in Q:
        here = sa.singularity(arm.at(q))
        there = sa.singularity(other.at(np.where(arm.slides, length * q, q)))
        assert there.distance == pytest.approx(here.distance, rel=1e-6)
        assert there.kind == here.kind


@pytest.mark.parametrize("name", ["planar3", "mda6", "chaser7", "ets7"])
@pytest.mark.parametrize("length", [1e-3, 1e3])
def test_the_task_length_changes_no_verdict(name, length):
    """Far away it changes the distance, which is then no more than a guess; near the set not."""
    arm = sa.load(name)
    assert_same_verdicts(arm, arm.replace(task=sa.Task(arm.task.names, length)), rel=0.05)


def assert_same_verdicts(arm, other, rel=1e-6):
    rng = np.random.default_rng(0)
    Q = np.concatenate(
        [beside(arm, rng, 3, deg) for deg in (1e-4, 1e-3)] + [rng.uniform(-3, 3, (4, arm.n))]
    )
    for i, q in enumerate(Q):
        here, there = sa.singularity(arm.at(q)), sa.singularity(other.at(q))
        assert there.kind == here.kind
        assert there.rank == here.rank
        if i < 6:
            assert there.distance == pytest.approx(here.distance, rel=rel)
    assert {"regular", "dynamic"} <= {sa.singularity(arm.at(q)).kind for q in Q}


@pytest.mark.parametrize("name", CATALOGUE)
def test_few_postures_are_singular(name):
    """No more than 3 percent of uniform postures, whatever the condition number of the arm."""
    arm = sa.load(name)
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (2000, arm.n))
    assert (sa.evaluate(arm, Q, ("distance",))["distance"] <= 1e-4).mean() <= 0.03


def test_an_ill_conditioned_arm_is_no_singular_one():
    """A wrist on a long boom, masses over nine decades: sigma_max a million times sigma_min."""
    bodies = [
        link("bus", 1e5, inertia=1e6 * np.eye(3)),
        *(link(f"l{i}", 10.0 ** (3 - 2 * i), inertia=1e-4 * np.eye(3)) for i in range(1, 7)),
    ]
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)]
    reach = [(1, 0, 0), (0, 0, 0.1), (100, 0, 0), (100, 0, 0), (1e-3, 0, 0), (1e-3, 0, 0)]
    names = ["bus", *(f"l{i}" for i in range(1, 7))]
    joints = [
        joint(f"j{i + 1}", names[i], names[i + 1], xyz=reach[i], axis=axes[i]) for i in range(6)
    ]
    arm = load_text(robot(*bodies, *joints), tip="l6", task=sa.Task("pose", 1e-3), check="accept")
    Q = np.random.default_rng(0).uniform(-3, 3, (40, 6))
    reports = [sa.singularity(arm.at(q)) for q in Q]
    assert np.median([report.condition for report in reports]) > 1e5
    assert sum(report.kind != "regular" for report in reports) <= 1


def test_several_singular_values_vanish_together():
    """A straight arm, four of whose axes lie in a line, on a fixed spacecraft."""
    arm = load_text(random_tripod(), tip="tip", task="pose")
    exact = sa.singularity(arm.at(np.zeros(6)), mode="fixed")
    near = sa.singularity(arm.at(np.full(6, 2e-5)), mode="fixed")
    far = sa.singularity(arm.at(np.full(6, 0.2)), mode="fixed")
    assert (exact.rank, near.rank, far.rank) == (3, 3, 6)
    assert exact.kind == near.kind == "kinematic"
    assert exact.lost.shape == (6, 3)
    assert near.distances[-3] <= np.linalg.norm(np.full(6, 2e-5)) * 1.01


def random_tripod():
    """Axes z y y z y z in a line: wrist and boom are both stretched at zero."""
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1)]
    names = ["bus", *(f"l{i}" for i in range(6))]
    joints = [
        joint(f"j{i}", names[i], names[i + 1], xyz=(0, 0, 0.5), axis=axis)
        for i, axis in enumerate(axes)
    ]
    hand = joint("hand", "l5", "tip", "fixed", xyz=(0, 0, 0.5))
    return robot(*(link(name) for name in (*names, "tip")), *joints, hand)


def test_where_the_gradient_vanishes_the_distance_is_infinite_and_the_posture_regular():
    """q2 = 90 deg of an arm on a fixed spacecraft: the largest sigma_min of two equal links."""
    links = [link("bus", 50.0), link("a"), link("b"), link("tip")]
    joints = [
        joint("j1", "bus", "a", xyz=(0, 0, 0)),
        joint("j2", "a", "b", xyz=(1, 0, 0)),
        joint("hand", "b", "tip", "fixed", xyz=(0.5, 0, 0)),
    ]
    arm = load_text(robot(*links, *joints), tip="tip", task="x")
    cfg = arm.at([np.pi / 2, 0.0])  # the row is (-1.5, -0.5), its norm stationary
    report = sa.singularity(cfg, mode="fixed")
    assert report.gradient == pytest.approx(0.0, abs=1e-12)
    assert report.distance == np.inf
    assert report.kind == "regular"
    assert not report.away.any()
    assert "first-order estimate is above 90°" in report.verdict
    assert not report.searched
    exact = sa.singularity(cfg, mode="fixed", exact=True)
    assert exact.distance == pytest.approx(np.pi / 2, abs=1e-7)  # the arm along x
    assert exact.verdict == "regular: a singular posture found 90° away; none within 89.9°, proven"


def test_what_rounding_may_have_made_counts_as_zero():
    """The spacecraft's inertia drowns in rounding: nothing is known, and the report says so."""
    import pinocchio as pin

    far = pin.SE3(np.eye(3), np.array([1e9, 0.0, 0.0]))
    report = sa.singularity(sa.load("mda6").replace(mount=far).at(np.full(6, 0.3)))
    assert np.isinf(report.error)
    assert report.distance == 0.0


def test_an_arm_that_can_never_do_its_task_is_singular_where_it_is():
    cfg = sa.load("planar2", task="pose").at([0.3, 0.4])
    report = sa.singularity(cfg, exact=True)
    assert report.distance == 0.0
    assert report.nearest == pytest.approx(cfg.q)


def test_a_sliding_joint_counts_by_its_travel_or_the_length_of_the_arm():
    def arm(limit):
        bodies = [link("bus", 50.0), link("rail"), link("arm"), link("tip")]
        joints = [
            joint("slide", "bus", "rail", "prismatic", inside=limit),
            joint("turn", "rail", "arm", xyz=(2, 0, 0)),
            joint("hand", "arm", "tip", "fixed", xyz=(1, 0, 0)),
        ]
        return load_text(robot(*bodies, *joints), tip="tip", task="x y")

    def limited(travel):
        return f'<limit lower="0" upper="{travel}" effort="1" velocity="1"/>'

    assert joint_scales(arm(limited(1.0))) == pytest.approx([1 / (2 * np.pi), 1.0])
    assert joint_scales(arm(limited(1000.0))) == pytest.approx([3.0, 1.0])
    report = sa.singularity(arm(limited(1.0)).at([0.2, 0.3]))
    assert report.radian == pytest.approx([1 / (2 * np.pi), 1.0])


def test_starts_led_together_end_next_to_singular_postures():
    """Those that are led one by one from there need a step or two, to all digits."""
    arm = sa.load("planar3", task="x y")
    starts = chosen(4).uniform(-np.pi, np.pi, (40, arm.n))
    near = led_near(arm, starts, "free-floating", 10_000)
    searched = [lose_rank(arm, q, "free-floating") for q in near]
    moved = np.array(
        [np.abs(q - at).max() for q, at in zip(near, searched, strict=True) if at is not None]
    )
    assert len(moved) >= 30
    assert np.median(moved) < 1e-5
    assert np.abs(near - starts).max() > 0.1
