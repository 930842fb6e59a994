"""Many configurations at once against one at a time, and against numpy."""

import math
import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from helpers.arms import joint, link, load_text, one_to_eight, random_tree, robot, seeds
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa
from spacearm.mechanics import arm_kernels, distance
from spacearm.mechanics.batch import BLOCK, QUANTITIES, SINGLY, tips_from_centre

FEW = math.ceil(arm_kernels.WORTH / SINGLY)  # compiled from here on
MODELS = ("planar2", "planar3", "mda6", "ets7", "chaser7")
MANY = FEW + 14  # takes the compiled path, with lanes left over


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def compare(arm, Q, rows=8):
    """The batch against `singularity` and `generalized_jacobian` at some rows of Q."""
    values, J = sa.evaluate(arm, Q), sa.generalized_jacobians(arm, Q)
    for i in np.linspace(0, len(Q) - 1, rows).astype(int):
        cfg = arm.at(Q[i])
        expected = sa.generalized_jacobian(cfg)
        np.testing.assert_allclose(J[i], expected, rtol=0, atol=1e-12 * abs(expected).max())
        report = sa.singularity(cfg)
        largest = report.sigma[0]
        assert values["sigma_min"][i] == pytest.approx(report.sigma_min, abs=1e-12 * largest)
        assert values["manipulability"][i] == pytest.approx(
            report.manipulability, abs=1e-12 * largest**arm.task.k
        )
        if report.condition < 1e6:
            assert values["condition"][i] == pytest.approx(report.condition, rel=1e-8)
        if report.determinant is None:
            assert math.isnan(values["determinant"][i])
        else:
            assert values["determinant"][i] == pytest.approx(
                report.determinant, abs=1e-12 * largest**arm.task.k
            )
        radius = np.linalg.norm(cfg.tip.translation - cfg.com)
        assert values["radius"][i] == pytest.approx(radius, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_agrees_with_one_at_a_time_on_every_model(name, rng):
    arm = sa.load(name)
    compare(arm, rng.uniform(-np.pi, np.pi, (MANY, arm.n)), rows=MANY)


tasks = st.sampled_from(["pose", "position", "orientation", "x y", "z rx", "ry"])


@pytest.mark.slow
@given(seeds, one_to_eight, tasks)
def test_agrees_on_random_trees_and_tasks(seed, n, task):
    rows = sa.Task(task)
    rows = sa.Task(task, 0.7) if rows.mixed else rows
    arm = load_text(random_tree(seed, n), tip=f"link_{n}", task=rows, joints="all")
    compare(arm, np.random.default_rng(seed).uniform(-4, 4, (MANY, arm.n)))


def compare_distances(arm, Q):
    """The compiled derivative of J* against that of the matrices, and the report."""
    values = sa.evaluate(arm, Q, ("distance", "away"))
    assert values["away"].shape == Q.shape
    for i in np.linspace(0, len(Q) - 1, 8).astype(int):
        report = sa.singularity(arm.at(Q[i]))
        if report.condition > 1e9:
            assert values["distance"][i] < 1e-6
        elif 0.0 < report.distance < 1e3:
            assert values["distance"][i] == pytest.approx(report.distance, rel=1e-7)
            scale = abs(report.away).max()
            assert values["away"][i] == pytest.approx(report.away, abs=1e-6 * scale)


@pytest.mark.parametrize("name", MODELS)
def test_distances_agree_with_one_at_a_time(name, rng):
    arm = sa.load(name)
    compare_distances(arm, rng.uniform(-np.pi, np.pi, (MANY, arm.n)))


@given(seeds, one_to_eight, tasks)
def test_distances_agree_on_trees_with_sliding_and_mimic_joints(seed, n, task):
    rows = sa.Task(task)
    arm = load_text(
        random_tree(seed, n), tip=f"link_{n}", task=sa.Task(task, 0.7) if rows.mixed else rows
    )
    compare_distances(arm, np.random.default_rng(seed).uniform(-3, 3, (MANY, arm.n)))


@pytest.mark.parametrize("mode", ["attitude-controlled", "fixed"])
@pytest.mark.parametrize("name", ["planar2", "chaser7"])
def test_a_held_spacecraft_is_one_without_end_of_inertia(name, mode, rng):
    """The compiled equations against the matrices."""
    arm = sa.load(name)
    Q = rng.uniform(-3, 3, (20, arm.n))
    many, one = distance.linearise(arm, Q, mode), distance.linearise_singly(arm, Q, mode)
    assert many.distance == pytest.approx(one.distance, rel=1e-9)
    assert many.sigma == pytest.approx(one.sigma, abs=1e-13)
    for a, b in zip(many.rows, one.rows, strict=True):
        assert a.T @ a == pytest.approx(b.T @ b, abs=1e-9)


def test_distances_without_the_compiler_are_the_same(rng):
    arm = sa.load("chaser7")
    Q = rng.uniform(-3, 3, (MANY, 7))
    many, few = (sa.evaluate(arm, rows, ("distance", "away")) for rows in (Q, Q[:5]))
    for name in many:
        np.testing.assert_allclose(few[name], many[name][:5], rtol=1e-9, atol=1e-12)


def test_distances_at_singular_configurations_are_zero(rng):
    for name in ("planar2", "mda6"):
        arm = sa.load(name)
        Q = sa.singular_set(arm).sample(MANY, rng)
        found = sa.evaluate(arm, Q, ("distance", "away"))
        assert found["distance"].max() < 1e-9
        assert np.linalg.norm(found["away"], axis=1) == pytest.approx(1.0)


def test_distances_of_rows_that_are_not_finite_are_nan_and_out_takes_vectors(rng):
    arm, Q = sa.load("planar3"), rng.uniform(-3, 3, (MANY, 3))
    Q[7, 1] = np.nan
    out = {"away": np.empty((MANY, 3))}
    found = sa.evaluate(arm, Q, ("distance", "away"), out=out)
    assert found["away"] is out["away"]
    assert np.isnan(found["distance"]).nonzero()[0].tolist() == [7]
    assert np.isnan(found["away"]).all(axis=1).nonzero()[0].tolist() == [7]
    with pytest.raises(sa.ConfigurationError, match=r"out\['away'\]"):
        sa.evaluate(arm, Q, ("away",), out={"away": np.empty(MANY)})


def test_an_arm_with_too_few_joints_is_singular_everywhere(rng):
    arm = sa.load("planar2", task="pose")
    assert not sa.evaluate(arm, rng.uniform(-3, 3, (MANY, 2)), ("distance",))["distance"].any()


def test_locked_joints(rng):
    arm = sa.load("chaser7", locked={sa.load("chaser7").joint_names[2]: 0.4})
    compare(arm, rng.uniform(-np.pi, np.pi, (MANY, arm.n)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "mda6", "ets7"])
def test_exactly_singular_configurations(name, rng):
    arm = sa.load(name)
    Q = sa.singular_set(arm).sample(MANY, rng)
    values = sa.evaluate(arm, Q)
    sigma = np.array([sa.singularity(arm.at(q)).sigma for q in Q])
    assert (abs(values["sigma_min"] - sigma[:, -1]) <= 1e-12 * sigma[:, 0]).all()
    assert values["sigma_min"].max() < 1e-10 * sigma[:, 0].max()


def test_a_joint_that_does_nothing_makes_the_least_singular_value_vanish():
    """The tip stands in the axis of a last body that is balanced about that axis."""
    text = robot(
        link("bus", 40.0),
        link("upper", 4.0, com=(0.5, 0, 0)),
        joint("shoulder", "bus", "upper"),
        link("wheel", 2.0),
        joint("spin", "upper", "wheel", xyz=(1, 0, 0)),
    )
    arm = load_text(text, tip="wheel", task="x y")
    Q = np.random.default_rng(0).uniform(-3, 3, (MANY, 2))
    values = sa.evaluate(arm, Q)
    sigma = np.array([sa.singularity(arm.at(q)).sigma for q in Q])
    np.testing.assert_allclose(values["sigma_min"], sigma[:, 1], atol=1e-12 * sigma.max())


@pytest.mark.parametrize("m", [0, 1, FEW - 1, FEW, BLOCK + 1])
def test_any_number_of_configurations(m, rng):
    arm = sa.load("planar2")
    Q = rng.uniform(-3, 3, (m, 2))
    values = sa.evaluate(arm, Q)
    assert tuple(values) == QUANTITIES
    assert all(v.shape == (m,) and v.dtype == np.float64 for v in values.values())
    assert sa.generalized_jacobians(arm, Q).shape == (m, 6, 2)
    if m:
        report = sa.singularity(arm.at(Q[-1]))
        assert values["sigma_min"][-1] == pytest.approx(report.sigma_min, abs=1e-14)


def test_both_routes_agree_where_they_meet(rng):
    arm = sa.load("mda6")
    Q = rng.uniform(-3, 3, (FEW, 6))
    many, few = sa.evaluate(arm, Q), sa.evaluate(arm, Q[1:])
    for name in QUANTITIES:
        np.testing.assert_allclose(many[name][1:], few[name], rtol=1e-9, atol=1e-12)
    J, J_few = sa.generalized_jacobians(arm, Q), sa.generalized_jacobians(arm, Q[1:])
    np.testing.assert_allclose(J[1:], J_few, atol=1e-13)


@pytest.mark.parametrize("m", [FEW // 2, MANY])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_rows_that_are_no_configuration_give_nan_and_touch_no_other(m, bad, rng):
    arm = sa.load("mda6")
    Q = rng.uniform(-3, 3, (m, 6))
    clean, J_clean = sa.evaluate(arm, Q), sa.generalized_jacobians(arm, Q)
    Q[3, 2], Q[m - 1, 0] = bad, bad
    values, J = sa.evaluate(arm, Q), sa.generalized_jacobians(arm, Q)
    wrong = np.isin(np.arange(m), (3, m - 1))
    for name in QUANTITIES:
        assert np.isnan(values[name][wrong]).all(), name
        np.testing.assert_array_equal(values[name][~wrong], clean[name][~wrong])
    assert np.isnan(J[wrong]).all()
    np.testing.assert_array_equal(J[~wrong], J_clean[~wrong])


def test_arms_with_fewer_joints_than_rows_are_singular_everywhere():
    arm = sa.load("planar2", task="x y rz")
    for m in (4, MANY):
        values = sa.evaluate(arm, np.full((m, 2), 0.3))
        assert (values["sigma_min"] == 0).all()
        assert (values["manipulability"] == 0).all()
        assert np.isinf(values["condition"]).all()
        assert np.isnan(values["determinant"]).all()


def test_angles_of_many_turns(rng):
    arm = sa.load("mda6")
    Q = rng.uniform(-3, 3, (MANY, 6))
    turns = rng.integers(-3, 3, Q.shape)
    far = sa.evaluate(arm, Q + 2 * np.pi * turns)
    for name, near in sa.evaluate(arm, Q).items():
        np.testing.assert_allclose(far[name], near, rtol=1e-9, atol=1e-12)
    compare(arm, rng.uniform(-1e7, 1e7, (MANY, 6)))


@pytest.mark.parametrize("make", [
    np.asfortranarray,
    lambda Q: np.repeat(Q, 2, axis=0)[::2],
    lambda Q: np.hstack((Q, Q))[:, :6],
    lambda Q: Q[::-1][::-1],
])  # fmt: skip
def test_any_order_of_memory(make, rng):
    arm = sa.load("mda6")
    Q = rng.uniform(-3, 3, (MANY, 6))
    for name, values in sa.evaluate(arm, make(Q)).items():
        np.testing.assert_array_equal(values, sa.evaluate(arm, Q)[name])


@pytest.mark.parametrize("kind", [np.float32, np.float16, np.int64])
def test_other_storage(kind, rng):
    arm = sa.load("mda6")
    Q = rng.uniform(-3, 3, (MANY, 6)).astype(kind)
    out = {"sigma_min": np.empty(MANY, np.float32)}
    values = sa.evaluate(arm, Q, ("sigma_min", "determinant"), out=out)
    exact = sa.evaluate(arm, Q.astype(np.float64), ("sigma_min", "determinant"))
    assert values["sigma_min"] is out["sigma_min"]
    np.testing.assert_array_equal(values["determinant"], exact["determinant"])
    np.testing.assert_array_equal(values["sigma_min"], exact["sigma_min"].astype(np.float32))
    assert Q.dtype == kind


def test_results_do_not_depend_on_threads_and_Q_stays(rng):
    arm = sa.load("mda6")
    Q = rng.uniform(-3, 3, (3 * MANY, 6))
    before = Q.copy()
    one = sa.evaluate(arm, Q, threads=1)
    for threads in (2, 3, 7):
        for name, values in sa.evaluate(arm, Q, threads=threads).items():
            np.testing.assert_array_equal(values, one[name])
    np.testing.assert_array_equal(Q, before)


def test_few_distances_do_not_depend_on_threads(rng):
    """The choice between reference and compiled code is made for all of them."""
    arm = sa.load("planar3")
    for m in (4, 6, 12):
        Q = rng.uniform(-3, 3, (m, 3))
        one, four = (sa.evaluate(arm, Q, "distance", threads=t)["distance"] for t in (1, 4))
        assert one.tolist() == four.tolist()


def test_progress(rng):
    seen = []
    arm, m = sa.load("planar2"), 3 * BLOCK + 5
    Q = rng.uniform(-3, 3, (m, 2))
    sa.evaluate(arm, Q, ["radius"], progress=lambda done, of: seen.append((done, of)))
    assert [done for done, _ in seen] == sorted({done for done, _ in seen})
    assert seen[-1] == (m, m)
    assert len(seen) > 1


def test_an_error_in_progress_stops_the_work(rng):
    def stop(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sa.evaluate(sa.load("planar2"), rng.uniform(-3, 3, (3 * BLOCK, 2)), progress=stop)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((np.zeros((4, 3)),), {}, r"shape \(4, 3\).*\(m, 2\).*joint_1, joint_2"),
        ((np.zeros(2),), {}, r"shape \(2,\)"),
        (([["a", "b"]],), {}, "Q is .*; give numbers"),
        ((np.zeros((4, 2), complex),), {}, "complex128"),
        ((np.zeros((4, 2)), ["sigma"]), {}, "'sigma'.*sigma_min"),
        (
            (np.zeros((4, 2)),),
            {"out": {"determinant": np.empty(3)}},
            r"determinant'\].*\(4,\)",
        ),
        ((np.zeros((4, 2)),), {"out": {"determinant": np.empty(4, int)}}, "int64"),
        ((np.zeros((4, 2)),), {"out": {"dot": np.empty(4)}}, "'dot'.*det"),
        ((np.zeros((4, 2)), ["determinant"]), {"out": {"radius": np.empty(4)}}, "radius.*not name"),
        ((np.zeros((4, 2)),), {"threads": 0}, "threads is 0"),
    ],
)
def test_bad_arguments(arguments, options, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.evaluate(sa.load("planar2"), *arguments, **options)


def test_read_only_output():
    out = np.empty(4)
    out.flags.writeable = False
    with pytest.raises(sa.ConfigurationError, match="read-only"):
        sa.evaluate(sa.load("planar2"), np.zeros((4, 2)), out={"determinant": out})


def run(code, **environment):
    """The output of a fresh interpreter."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_small_batches_load_no_compiler():
    run("""
        import sys, numpy as np, spacearm as sa
        arm = sa.load("chaser7")
        sa.evaluate(arm, np.zeros((49, 7)))
        sa.generalized_jacobians(arm, np.zeros((49, 7)))
        assert not {"numba", "llvmlite"} & set(sys.modules)
    """)


@pytest.mark.slow
def test_memory_maps_do_not_fill_memory(tmp_path):
    """5 million configurations, 320 MB in and out, through less than 120 MB."""
    out = run(f"""
        import resource, numpy as np, spacearm as sa
        arm, folder = sa.load("planar2"), {str(tmp_path)!r}
        sa.evaluate(arm, np.zeros((100, 2)))
        Q = np.memmap(folder + "/Q", np.float64, "w+", shape=(5_000_000, 2), order="C")
        for i in range(0, len(Q), 500_000):
            Q[i:i + 500_000] = np.arange(1_000_000).reshape(-1, 2) * 1e-6 + i * 1e-7
        last = Q[-1].copy()
        del Q
        Q = np.memmap(folder + "/Q", np.float64, "r", shape=(5_000_000, 2))
        names = ("sigma_min", "manipulability", "condition", "determinant", "radius")
        maps = {{n: np.memmap(folder + "/" + n, np.float64, "w+", shape=len(Q)) for n in names}}

        peak = 0
        def watch(done, of):
            global peak
            peak = max(peak, int(open("/proc/self/statm").read().split()[1]) * 4096)

        watch(0, 0)
        start, peak = peak, 0
        sa.evaluate(arm, Q, out=maps, progress=watch)
        reread = np.memmap(folder + "/sigma_min", np.float64, "r", shape=len(Q))
        assert reread[-1] == maps["sigma_min"][-1]
        assert abs(reread[-1] - sa.singularity(arm.at(last)).sigma_min) < 1e-12
        print(peak - start)
    """)
    assert int(out) < 120e6


@pytest.mark.parametrize("mode", ["free-floating", "attitude-controlled", "fixed"])
@pytest.mark.parametrize("name", ["mda6", "chaser7"])
def test_tips_of_few_configurations_are_those_of_many(name, mode):
    arm = sa.load(name)
    Q = np.random.default_rng(0).uniform(-3.0, 3.0, (100, arm.n))
    many_tips = tips_from_centre(arm, Q, mode)
    few = np.vstack([tips_from_centre(arm, q[None], mode) for q in Q])
    np.testing.assert_allclose(few, many_tips, rtol=0.0, atol=1e-14 * np.abs(many_tips).max())


@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
def test_units_are_finite_where_impossible_inertias_are_accepted():
    parts = (link("bus", 5.0, inertia=-9 * np.eye(3)), link("upper"), link("lower"))
    joints = (joint("1", "bus", "upper"), joint("2", "upper", "lower", xyz=(1, 0, 0)))
    arm = load_text(robot(*parts, *joints), check="accept", task="x y")
    assert np.isfinite(sa.singularity_polynomial(arm).coefficients).all()
