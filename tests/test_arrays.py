"""Numbers that callers give: counts, spacings and values, of Python and of NumPy."""

import json
import math

import numpy as np
import pinocchio as pin
import pytest

import spacearm as sa
from spacearm.arrays import (
    MOST_COUNT,
    ReadOnlyMapping,
    floats,
    number_of,
    plain,
    positive,
    steps,
    whole,
    within,
)
from spacearm.signatures import shown

HUGE = (10**30, 10**400, 10**5000, 1e30, 1e308, math.inf)
NO_COUNTS = (*HUGE, 0, -1, 2.5, 1e-300, math.nan, True, np.True_, "1", None, [1], np.ones(1))
NO_NUMBERS = (*HUGE, -HUGE[1], math.nan, -1e308, True, np.True_, "1", "", None, [1.0], 1j)


@pytest.mark.parametrize("value", NO_COUNTS, ids=shown)
def test_a_count_is_a_whole_number_up_to_a_bound_that_the_message_names(value):
    with pytest.raises(sa.ConfigurationError, match=f"samples is .*from 1 to {MOST_COUNT:,}"):
        whole(value, "samples", 1)


@pytest.mark.parametrize("value", NO_NUMBERS, ids=shown)
def test_a_number_is_finite_and_not_beyond_all_use(value):
    with pytest.raises(sa.ConfigurationError, match=r"length is .*from 1e-12 to 1e\+12"):
        positive(value, "length")
    with pytest.raises(sa.ConfigurationError, match=r"margin is .*from 0 to 1e\+12"):
        within(value, "margin", 0.0)


@pytest.mark.parametrize("value", [1e-308, 5e-324, 0.0, -0.0, 1e-13])
def test_a_positive_number_is_not_so_small_that_its_square_vanishes(value):
    with pytest.raises(sa.ConfigurationError, match=r"length is .*from 1e-12 to 1e\+12"):
        positive(value, "length")


@pytest.mark.parametrize(
    "kind", [float, np.float64, np.float32, np.longdouble, int, np.int8, np.uint64, np.array]
)
def test_numbers_of_numpy_are_numbers(kind):
    assert positive(kind(2), "length") == within(kind(2), "length", 0.0) == number_of(kind(2)) == 2
    if kind in (int, np.int8, np.uint64, np.array):
        assert whole(kind(2), "samples", 1) == 2
        assert type(whole(kind(2), "samples", 1)) is int


def test_what_may_be_infinite_is_infinite_or_of_a_size_that_can_be():
    assert within(math.inf, "torque", 0.0, math.inf) == math.inf
    for value in (1e13, 1e308, 10**400):
        with pytest.raises(sa.ConfigurationError, match=r"torque is .*, or inf"):
            within(value, "torque", 0.0, math.inf)


@pytest.mark.parametrize("step", [1e-300, 5e-324, 1e-8, 0.0, -1.0, math.nan, 10**400], ids=shown)
def test_a_span_has_no_more_steps_than_a_bound(step):
    with pytest.raises(sa.ConfigurationError, match="dt is "):
        steps(1.0, step, "dt", 1000)


def test_the_message_says_which_step_is_possible():
    with pytest.raises(sa.ConfigurationError, match=r"at least 0.002, .* at most 1,000 steps"):
        steps(2.0, 1e-300, "dt", 1000)
    assert steps(2.0, 0.002, "dt", 1000) == 0.002


@pytest.mark.parametrize("values", [1j, [1.0, 2j], np.ones(2, dtype=complex)])
def test_complex_numbers_are_not_cut_to_their_real_parts(values):
    with pytest.raises(TypeError, match="complex"):
        floats(values)


ARM = sa.load("planar2")
CFG = ARM.at([0.3, 1.2])


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda n: sa.risk_profile(ARM, samples=n), "samples"),
        (lambda n: sa.risk_profile(ARM, bins=n), "bins"),
        (lambda n: sa.risk_profile(ARM, samples=4, bins=2, threads=n), "threads"),
        (lambda n: sa.pose_risk(ARM, samples=n), "samples"),
        (lambda n: sa.pose_risk(ARM, poses=n), "poses"),
        (lambda n: sa.pose_risk(ARM, neighbours=n), "neighbours"),
        (lambda n: sa.singular_map(ARM, points=n), "points"),
        (lambda n: sa.singular_set(ARM).sample(n), "m"),
        (lambda n: sa.free_boxes(ARM, most=n), "most"),
        (lambda n: sa.workspace(ARM, effort=n), "effort"),
        (lambda n: sa.size_wheels(ARM, tip_speed=0.1, samples=n), "samples"),
        (lambda n: sa.level_reach(CFG, 0.03, directions=n), "directions"),
        (lambda n: sa.feasible_attitudes(CFG, [(2.0, 0.0), (1.5, 1.5)], samples=n), "samples"),
        (lambda n: sa.uncertain(ARM, {"link_1": {"mass": 0.1}}).tried(n, 0, 1), "samples"),
        (lambda n: sa.evaluate(ARM, [CFG.q], ["sigma_min"], threads=n), "threads"),
        (lambda n: sa.simulate_many(CFG, lambda *_: [0, 0], 0.1, threads=n), "threads"),
        (lambda n: sa.Task("x y", tips=n), "tips of a task"),
        (lambda n: sa.singularity_polynomial(ARM).grid((4, n)), "points of a grid"),
        (lambda n: sa.TrigPolynomial.fit(lambda X: X[:, 0], n), "n"),
        (lambda n: sa.design.optimise_mount(ARM, {"mount_x": (0, 1)}, most=n), "most"),
    ],
)
def test_counts_beyond_all_memory_are_refused_everywhere(call, name):
    for count in (10**12, 10**30, 10**400, 10**5000):
        with pytest.raises(sa.ConfigurationError, match=f"{name} is .*whole number"):
            call(count)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda x: sa.simulate(CFG, lambda *_: [0, 0], x), "duration"),
        (lambda x: sa.simulate(CFG, lambda *_: [0, 0], 1.0, integration=sa.Integration(dt=x)),
         "dt"),
        (lambda x: sa.simulate(CFG, lambda *_: [0, 0], 1.0, sampling=sa.Sampling(period=x)),
         "period"),
        (lambda x: sa.Integration(reach=x), "reach"),
        (lambda x: sa.Integration(rtol=x), "rtol"),
        (lambda x: sa.Integration(atol=x), "atol"),
        (lambda x: sa.Sampling(period=x), "period"),
        (lambda x: sa.Search(timeout=x), "timeout"),
        (lambda x: sa.Constraints(keep_attitude=x), "keep_attitude"),
        (lambda x: sa.free_box(CFG, clearance=x), "clearance"),
        (lambda x: sa.free_box(CFG, at_least=x), "at_least"),
        (lambda x: sa.free_boxes(ARM, share=x), "share"),
        (lambda x: sa.follow(CFG, [(1.5, 1.2)], speed=x), "speed"),
        (lambda x: sa.ResolvedRate(target=(0, 1), servo=-x), "servo"),
        (lambda x: sa.DampedLeastSquares(target=(0, 1), threshold=x), "threshold"),
        (lambda x: sa.Servo(ARM, tau=x), "tau"),
        (lambda x: sa.level_reach(CFG, x), "tilt"),
        (lambda x: sa.size_wheels(ARM, tip_speed=x), "tip_speed"),
        (lambda x: sa.Obstacle.sphere(x, sa.pose()), "radius"),
        (lambda x: sa.Task("x y rz", length=x), "length"),
    ],
)  # fmt: skip
def test_times_steps_and_spacings_of_no_use_are_refused_everywhere(call, name):
    for number in (1e-308, 1e308, 10**400, math.nan):
        if (name, number) == ("timeout", 1e-308):  # it gives up at once
            continue
        with pytest.raises(sa.ConfigurationError, match=f"{name} is "):
            call(number)


def test_a_clearance_beyond_all_angles_is_refused():
    for number in (1e30, 1e308, math.inf):
        with pytest.raises(sa.ConfigurationError, match=r"clearance is .*angle"):
            sa.free_box(CFG, clearance=number)


def test_a_grid_of_designs_has_a_bound():
    many = np.linspace(1.0, 2.0, 2000)
    with pytest.raises(sa.ConfigurationError, match=r"designs.* 4000000; .* to 1,000,000"):
        sa.design.workspaces(ARM, {"base_inertia": many, "payload": many})


READ_ONLY = np.array([0.01, 0, 0, 0, 0, 0.02])
READ_ONLY.flags.writeable = False


def test_arrays_and_motions_of_libraries_are_what_lists_are():
    plain = sa.capture(CFG, READ_ONLY.tolist(), 5.0, np.eye(3).tolist(), [0, 0, 0.1])
    inertia = np.eye(3)
    inertia.flags.writeable = False
    other = sa.capture(CFG, READ_ONLY, np.float32(5), inertia, np.array([0, 0, 0.1]))
    np.testing.assert_array_equal(plain.twist, other.twist)
    still = sa.capture(CFG, pin.Motion.Zero(), 5.0)
    assert still.energy_lost == 0.0
    named = sa.load("planar2", joints=np.array(["joint_1", "joint_2"]))
    assert named.joint_names == ARM.joint_names
    found = sa.singular_map(ARM, points=5, joints=np.array(["q1", "q2"]))
    assert found.joints == ARM.joint_names


def test_truth_values_of_numpy_are_truth_values(tmp_path):
    kept = sa.Constraints(limits=np.True_, collisions=np.False_)
    plan = sa.plan(CFG, (0.9, 1.4), constraints=kept)
    plan.save(tmp_path / "plan.npz")
    assert sa.Plan.load(tmp_path / "plan.npz", ARM).q.shape == plan.q.shape
    found = sa.workspace(ARM, limits=np.True_)
    assert json.loads(json.dumps(found.to_dict()))["limits"] is True


def test_what_takes_part_in_a_message_is_said_in_few_words():
    with pytest.raises(sa.ConfigurationError, match="a whole number of some 5000 digits"):
        sa.Integration(dt=10**5000)


@pytest.mark.parametrize("value", [1e-308, 1e308, 0.0, 10**400, math.nan])
def test_limits_of_a_timing_that_no_time_keeps_are_refused(value):
    plan = sa.plan(CFG, sa.Joints([0.4, 1.1]))
    with pytest.raises(sa.ConfigurationError, match="rate is "):
        sa.time_optimal(plan, torque=20.0, rate=value)


@pytest.mark.parametrize("limits", [..., {...}, 3.0, [1.0], np.zeros(3), [1e308, 1.0], "ab"])
def test_limits_of_wheels_that_are_none_are_refused(limits):
    with pytest.raises(sa.ConfigurationError, match="wheels"):
        sa.load("planar2", wheels={"joint_2": limits})


@pytest.mark.parametrize("wheels", [{...}, ..., 3, [...], {1: ()}])
def test_names_of_wheels_that_are_none_are_refused(wheels):
    with pytest.raises(sa.ConfigurationError, match="wheels"):
        sa.load("planar2", wheels=wheels)


def test_numbers_of_extended_precision_are_plain_numbers():
    values = [np.longdouble(0.5), np.clongdouble(0.5j), np.array([0.5], dtype=np.longdouble)]
    found = plain(values)
    assert found == [0.5, [0.0, 0.5], [0.5]]
    json.dumps(found)
    sa.CaptureEnvelope(place=np.longdouble(0.5))


def test_mappings_that_cannot_be_changed_join_others():
    held = ReadOnlyMapping({"a": 1, "b": 2})
    assert held | {"b": 3} == {"a": 1, "b": 3}
    assert {"b": 3, "c": 4} | held == {"a": 1, "b": 2, "c": 4}
