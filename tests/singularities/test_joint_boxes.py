"""Free boxes against the zero set itself, postures at random, and the files they are written to."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import tomllib
from helpers.arms import chosen, load_text, random_chain

import spacearm as sa
from spacearm.mechanics.distance import is_singular
from spacearm.polynomial.free_regions import Trial
from spacearm.singularities import joint_boxes


def inside(box, rng, m=4000):
    """Random joint positions in a box, its faces and corners; where any angle is free, a turn."""
    low, high = np.clip(box.lower, -np.pi, None), np.clip(box.upper, None, np.pi)
    return low + (high - low) * rng.uniform(-0.5, 1.5, size=(m, box.arm.n)).clip(0.0, 1.0)


def ends(box):
    return np.stack((box.lower, box.upper), axis=1).ravel()


def check_stops(box):
    """Every singular posture that stops a side is one, in the ranges of the other joints."""
    width = np.repeat(box.upper - box.lower, 2)
    for stop, end, size in zip(box.stops, ends(box), width, strict=True):
        if stop.why == "singular":
            j = box.arm.joint_names.index(stop.joint)
            assert sa.singularity(box.arm.at(stop.at)).sigma_min < 1e-9
            assert 0.0 <= (stop.at[j] - end) * (1 if stop.side == "upper" else -1) <= 0.01 * size
            others = np.arange(box.arm.n) != j
            assert (stop.at >= box.lower - 1e-9)[others].all()
            assert (stop.at <= box.upper + 1e-9)[others].all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
@pytest.mark.parametrize("seed", range(4))
def test_nothing_in_a_box_of_a_planar_arm_is_singular_and_its_stops_are(seed):
    arm, rng = sa.load("planar2"), np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, 2)
    box, S = sa.free_box(arm.at(q)), sa.singularity_polynomial(arm)
    assert box.contains(q)
    assert (S(inside(box, rng)) * S(q) > 0.0).all()
    members = sa.singular_set(arm).sample(2000, rng)
    assert not any(map(box.contains, members))
    assert sum(stop.why == "singular" for stop in box.stops) >= 2
    check_stops(box)


@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
def test_the_clearance_is_kept_from_every_singular_posture():
    arm, rng = sa.load("planar2"), np.random.default_rng(1)
    clearance = 0.15
    box = sa.free_box(arm.at([0.3, 1.2]), clearance=clearance)
    members = np.concatenate(
        [sa.singular_set(arm).sample(20_000, rng) + 2 * np.pi * turn for turn in (-1, 0, 1)]
    )
    away = np.linalg.norm(
        np.maximum(np.maximum(box.lower - members, members - box.upper), 0), axis=1
    )
    assert away.min() > clearance
    assert away.min() < clearance + 0.05  # and it is no smaller than it need be
    assert sa.free_box(arm.at([0.3, 1.2])).contains(np.array([box.lower, box.upper]))


@pytest.mark.slow
def test_joints_that_do_not_matter_have_their_whole_range():
    arm = sa.load("mda6")
    q, rng = np.radians([20, 60, -100, -50, 30, 0]), np.random.default_rng(0)
    box, S = sa.free_box(arm.at(q)), sa.singularity_polynomial(arm)
    assert (box.lower[5], box.upper[5]) == (arm.lower[5], arm.upper[5])
    assert [stop.why for stop in box.stops[10:]] == ["irrelevant"] * 2
    assert (S(inside(box, rng, 20_000)) * S(q) > 0.0).all()
    check_stops(box)


@pytest.mark.slow
def test_no_part_of_a_box_has_the_other_sign():
    """Cells in which S keeps its sign, and a derivative its own, may lie beyond the set."""
    arm = sa.load("mda6")
    q, rng = np.radians([34, 61, -37, 140, -98, 44]), np.random.default_rng(0)
    box, S = sa.free_box(arm.at(q)), sa.singularity_polynomial(arm)
    assert (S(inside(box, rng, 20_000)) * S(q) > 0.0).all()
    check_stops(box)


def test_a_redundant_arm_has_a_box_whose_stops_are_singular():
    """Its singular set has one dimension less than a surface, and the minors no one sign."""
    arm, rng = sa.load("planar3", task="x y"), np.random.default_rng(0)
    box = sa.free_box(arm.at([0.2, 1.1, -0.7]), at_least=0.05)
    assert (box.upper - box.lower >= 0.05 - 1e-9).all()
    assert min(sa.singularity(arm.at(x)).sigma_min for x in inside(box, rng, 50)) > 0.0
    assert not any(map(box.contains, sa.singular_set(arm).sample(2000, rng)))
    assert any(stop.why == "singular" for stop in box.stops)
    assert not any(stop.why == "undecided" for stop in box.stops)
    check_stops(box)


@pytest.mark.parametrize("side", [(2, 0), (2, 1)])
def test_what_is_proven_of_a_slab_counts_where_its_effort_ends(side):
    """All cells of a slab too thick for its effort were thrown away."""
    arm, q, reach = sa.load("planar3", task="x y"), np.array([0.2, 1.1, -0.7]), np.full(3, 3.0)
    end = 0.9 if side[1] else -0.9

    class UpToThere:
        """Proves cells up to an end, if they are small."""

        def __init__(self, *_):
            self.relevant, self.alone = np.array([False, True, True]), False

        def values(self, X):
            return np.zeros(len(X))

        def tried(self, centre, half, *_):
            beyond = (np.sign(end) * centre + half)[:, 2] > 0.9
            free = (half.max(axis=1) < 0.1) & ~beyond
            return Trial(free, half, len(free), np.zeros(len(free)), np.zeros(half.shape))

    ends, effort = np.array((q - reach, q + reach)), joint_boxes.Effort(0.4, 4000, 500)
    growth = joint_boxes.Growth(UpToThere, arm, "free-floating", q[None], ends, 0.0, None, effort)
    growth.extent[:] = 0.4
    growth.move(side, {side: 1.0}, np.inf)
    assert 0.8 <= growth.extent[side] <= 0.9


def test_large_polynomials_get_fewer_cells(monkeypatch):
    """A cell of theirs takes longer: a box did not end in ten minutes."""
    monkeypatch.setattr(joint_boxes, "LARGE", 4)  # coefficients; mda6 has 4,725
    cfg = sa.load("mda6").at(np.radians([0, 60, -100, -50, 30, 0]))
    box = sa.free_box(cfg)
    assert 0 < box.cells < 400_000 * 4 / 4725 + joint_boxes.BATCH
    assert "undecided" in {stop.why for stop in box.stops}
    assert box.contains(cfg)


def test_effort_is_a_factor_on_the_cells():
    cfg = sa.load("mda6").at(np.radians([0, 60, -100, -50, 30, 0]))
    little = sa.free_box(cfg, effort=1e-3)
    assert 0 < little.cells < 400 + joint_boxes.BATCH
    assert little.contains(cfg)
    assert "undecided" in {stop.why for stop in little.stops}


def test_named_joints_are_at_least_as_wide_as_in_any_order():
    arm = sa.load("planar2")
    cfg = arm.at([0.3, 1.2])
    first = sa.free_box(cfg, joints=["joint_1"])
    width = first.upper - first.lower
    assert width[0] >= (sa.free_box(cfg).upper - sa.free_box(cfg).lower)[0] - 1e-9


@pytest.mark.slow
def test_sides_with_a_clearance_stop_at_singular_postures_as_near_as_that():
    arm, clearance = sa.load("servicer_ur5"), 0.05
    limits = np.clip((arm.lower, arm.upper), -np.pi, np.pi)
    drawn = np.random.default_rng(0).uniform(*limits, (20, arm.n))
    q = next(q for q in drawn if sa.singular_set(arm).nearest(q).distance > 3 * clearance)
    box = sa.free_box(arm.at(q), clearance=clearance)
    assert not any(stop.why == "undecided" for stop in box.stops)
    stopped = [stop for stop in box.stops if stop.why == "singular"]
    assert stopped
    for stop in stopped:
        assert is_singular(arm, stop.at, "free-floating")
        beyond = np.maximum(np.maximum(box.lower - stop.at, stop.at - box.upper), 0.0)
        width = (box.upper - box.lower)[arm.joint_names.index(stop.joint)]
        assert clearance < np.linalg.norm(beyond) < clearance + 0.01 * width


@pytest.mark.parametrize("seed", [3, 4, 6])
def test_sides_of_named_joints_stop_at_singular_postures_while_the_others_stand(seed):
    arm = load_text(random_chain(chosen(seed), 4, ("revolute",)), task="position")
    box = sa.free_box(arm.at(chosen(seed).uniform(-2.5, 2.5, 4)), joints=["q2", "q3"])
    assert not any(stop.why == "undecided" for stop in box.stops)
    for stop in box.stops:
        if stop.why == "singular":
            assert sa.singularity(arm.at(stop.at)).sigma_min < 1e-9


def test_a_side_that_ends_at_a_limit_is_the_limit_itself():
    arm, ended = sa.load("planar3"), 0
    allowed = np.array([[-2.9, -1.1, -2.3], [3.0, 2.9, 0.7]])
    for q in np.random.default_rng(0).uniform(*allowed, (40, 3)):
        box = sa.free_box(arm.at(q), within=tuple(allowed))
        assert (box.lower >= allowed[0]).all()
        assert (box.upper <= allowed[1]).all()
        at_limit = np.array([stop.why in ("limit", "irrelevant") for stop in box.stops])
        assert (ends(box) == allowed.T.ravel())[at_limit].all()
        ended += at_limit.sum()
    assert ended > 80


def test_a_box_holds_the_whole_motion():
    arm = sa.load("planar2")
    motion = sa.follow(arm.at([0.3, 1.2]), [arm.at([0.5, 1.5]).tip])
    box = sa.free_box(motion)
    assert box.contains(motion)
    assert not box.contains(motion.q + 3.0)


def test_a_motion_is_in_a_box_with_all_that_lies_between_its_rows():
    arm = sa.load("planar2")
    plan = sa.plan(arm.at([0.3, 1.2]), sa.Joints([0.6, 1.6]))
    box = sa.free_box(plan)
    assert box.contains(plan)
    bent = plan.control_points + 0.05 * np.sin(np.arange(plan.control_points.shape[1]))[:, None]
    bulged = SimpleNamespace(arm=arm, q=plan.q, control_points=bent)
    rows = replace(box, lower=plan.q.min(axis=0), upper=plan.q.max(axis=0))
    assert rows.contains(plan.q)
    assert not rows.contains(bulged)


def test_a_box_holds_a_plan_along_a_limit_and_never_less_than_is_flown():
    """Control points may be beyond the limit by rounding. What is more is outside."""
    arm = sa.load("planar2").replace(lower=[-3.0, -3.0])
    plan = sa.plan(arm.at([-3.0, 1.2]), sa.Joints([-3.0, 1.9]))
    for beyond in (2e-14, 1e-5):
        lower = plan.control_points - [beyond, 0.0]
        flown = SimpleNamespace(arm=arm, q=plan.q, control_points=lower)
        if beyond < 1e-9:
            assert sa.free_box(flown).contains(flown)
            continue
        with pytest.raises(sa.ConfigurationError, match=r"is at -3\.00001, outside the range"):
            sa.free_box(flown)


def test_a_width_that_cannot_be_is_refused_with_the_box_that_there_is():
    arm = sa.load("planar2")
    with pytest.raises(sa.NoSolutionError, match="degrees asked for") as error:
        sa.free_box(arm.at([0.3, 1.2]), at_least=3.1)
    assert isinstance(error.value.best, sa.FreeBox)
    assert sa.free_box(arm.at([0.3, 1.2]), at_least=1.0).contains([0.3, 1.2])


def test_a_singular_start_has_no_box():
    arm = sa.load("planar2")
    q = sa.singular_set(arm).sample(1, np.random.default_rng(0))[0]
    with pytest.raises(sa.NoSolutionError, match="not proven free"):
        sa.free_box(arm.at(q))


def test_the_files_hold_the_ranges(tmp_path):
    arm = sa.load("planar2")
    box = sa.free_box(arm.at([0.3, 1.2]))
    written = tomllib.loads(box.save(tmp_path / "box.toml").read_text())
    assert {name: tuple(ends) for name, ends in written["ranges"].items()} == box.ranges


@pytest.mark.parametrize("within", [None, ([-np.inf, 0.5], [np.inf, np.inf])])
def test_a_box_holds_what_is_within_the_limits_that_it_becomes(within, tmp_path):
    arm = sa.load("planar2")
    box = sa.free_box(arm.at([0.3, 1.2]), within=within)
    limited = arm.replace(lower=box.lower, upper=box.upper)
    Q = inside(box, chosen(0), 500) + chosen(1).normal(scale=0.1, size=(500, 2))
    held = [box.contains(q) for q in Q]
    assert 0 < sum(held) < 500
    for other in (limited, sa.load(limited.to_urdf(tmp_path / "limited.urdf"))):
        np.testing.assert_array_equal(other.lower, box.lower)
        np.testing.assert_array_equal(other.upper, box.upper)
        assert ((other.lower <= Q) & (other.upper >= Q)).all(axis=1).tolist() == held


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"within": ([0, 0], [1, 1])}, "outside the range allowed"),
        ({"within": [0, 1, 2]}, "within is .*; give 2 values"),
        ({"clearance": -1.0}, "clearance is -1.0"),
        ({"at_least": 0.0}, "at_least is 0.0"),
        ({"joints": ["elbow"]}, "elbow"),
        ({"effort": 0.0}, "effort is 0.0"),
    ],
)
def test_arguments_that_make_no_sense_are_named(options, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.free_box(sa.load("planar2").at([0.3, 1.2]), **options)
