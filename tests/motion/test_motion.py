"""Motion: the base of all that moves, between its samples, in files, as labelled and plain data."""

import json
import subprocess
import sys
import zipfile
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from helpers.arms import load_text, with_wheels

import spacearm as sa


def two_samples():
    arm = sa.load("planar2")
    cfgs = [arm.at([0, 0]), sa.move(arm.at([0, 0]), [0.5, 1.0])]
    return SimpleNamespace(
        arm=arm, t=[0.0, 2.0], q=[c.q for c in cfgs], base=[c.base for c in cfgs]
    )


@pytest.fixture(scope="module")
def kinds():
    """One motion of each kind."""
    arm, q = sa.load("planar2"), [0.3, 1.2]
    law = sa.JointPD(target=[0.4, 1.1], kp=5.0, kd=9.0)
    return {
        "Motion": sa.Motion.of(two_samples()),
        "Trajectory": sa.simulate(
            arm.at(q), law, 2.0, integration=sa.Integration(dt=0.5, events=["target"], reach=0.1)
        ),
        "Followed": sa.follow(arm.at(q), [(1.2, 1.0)]),
        "Plan": sa.plan(arm.at(q), (1.2, 1.0), search=sa.Search(method="straight")),
    }


KINDS = ("Motion", "Trajectory", "Followed", "Plan")


# --- samples and what lies between them -----------------------------------------------------


def test_a_motion_is_linear_between_its_samples():
    given = two_samples()
    m = sa.Motion.of(given)
    assert np.allclose(m.at(1.0).q, [0.25, 0.5])
    assert np.allclose(m.at(-1.0).q, [0, 0])
    assert np.allclose(m.at(9.0).q, [0.5, 1.0])
    assert m.at(2.0).base.isApprox(given.base[1], 1e-12)
    assert sa.Motion.of(m).at(0.3).base.isApprox(m.at(0.3).base, 1e-12)
    lists = sa.Motion(m.arm, m.t.tolist(), m.q.tolist(), m.base.tolist())
    assert np.array_equal(lists.at(0.3).q, m.at(0.3).q)


def test_a_plan_at_a_time_is_where_its_spline_leads():
    """The joints exactly; the base as `move` along the spline from the sample before has it."""
    arm = sa.load("planar2")
    plan = sa.plan(arm.at([0.3, 1.2]), (1.5, 1.5))
    straight = 0.0
    for i in range(0, len(plan) - 1, 17):
        t = 0.4 * plan.t[i] + 0.6 * plan.t[i + 1]
        found, moved = plan.at(t), plan[i]
        np.testing.assert_array_equal(found.q, plan.spline(t))
        straight = max(straight, np.abs(found.q - 0.4 * plan.q[i] - 0.6 * plan.q[i + 1]).max())
        for u in np.linspace(plan.t[i], t, 21)[1:]:
            moved = sa.move(moved, plan.spline(u))
        np.testing.assert_allclose(found.base.homogeneous, moved.base.homogeneous, atol=1e-4)
    assert straight > 1e-3  # the spline is not the straight line between the samples


def test_a_simulation_at_a_time_is_the_state_then():
    """Interpolated between 40 samples, as integrated at 400; momentum and wheels too."""
    arm = load_text(with_wheels("planar2", [0.0, 0.0, 1.0]))
    start = arm.at([0.3, 1.2], momentum=[0.5, 0.2, 0, 0, 0, 0.4])
    law = sa.JointPD(target=[0.9, 0.4], kp=5.0, kd=9.0)
    plant = sa.Plant(wheels=lambda t: [0.1 * t])
    coarse, fine = (
        sa.simulate(start, law, 4.0, plant=plant, integration=sa.Integration(dt=dt, events=()))
        for dt in (0.1, 0.01)
    )
    for i in range(5, len(fine), 10):
        found, known = coarse.at(fine.t[i]), fine[i]
        np.testing.assert_allclose(found.q, known.q, atol=5e-5)
        np.testing.assert_allclose(found.base.homogeneous, known.base.homogeneous, atol=2e-4)
        np.testing.assert_allclose(found.momentum, known.momentum, atol=1e-9)
        np.testing.assert_allclose(found.wheels, known.wheels, atol=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_samples_are_configurations(kinds, kind):
    motion = kinds[kind]
    assert len(motion) == len(motion.t) > 1
    assert isinstance(motion, sa.Motion)
    for i in (0, 1, -1):
        np.testing.assert_array_equal(motion[i].q, motion.q[i])
        np.testing.assert_allclose(pin.SE3ToXYZQUAT(motion[i].base), motion.base[i], atol=1e-12)
        np.testing.assert_allclose(motion[i].q, motion.at(motion.t[i]).q, atol=1e-12)
    assert [cfg.q.tolist() for cfg in motion] == motion.q.tolist()
    with pytest.raises(IndexError):
        motion[len(motion)]


@pytest.mark.parametrize("kind", KINDS)
def test_what_follows_from_the_samples(kinds, kind):
    motion = kinds[kind]
    for i, cfg in enumerate(motion):
        np.testing.assert_array_equal(motion.com[i], cfg.com)
        np.testing.assert_array_equal(motion.tip[i], pin.SE3ToXYZQUAT(cfg.tip))
        assert motion.sigma_min[i] == pytest.approx(sa.singularity(cfg).sigma_min, abs=1e-14)
    for name in ("t", "q", "dq", "base", "tip", "com", "sigma_min"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(motion, name)[0] = 0.0


def test_rates_are_differences_where_they_are_not_given(kinds):
    arm = sa.load("planar2")
    t = np.array([0.0, 0.1, 0.3, 0.6, 1.0])
    q = np.column_stack((t**2, 1.0 - t))
    motion = sa.Motion(arm, t, q, np.tile(np.eye(7)[6], (5, 1)))
    np.testing.assert_allclose(
        motion.dq[1:-1], np.column_stack((2 * t, -np.ones(5)))[1:-1], atol=1e-12
    )
    still = sa.Motion(arm, t[:1], q[:1], motion.base[:1])
    np.testing.assert_array_equal(still.dq, [[0.0, 0.0]])
    run = kinds["Trajectory"]
    assert np.abs(run.dq[0]).max() == 0.0  # simulated, not differences


def test_the_mode_decides_what_is_singular():
    arm = sa.load("planar2")
    base = np.eye(7)[6:]
    held = sa.Motion(arm, [0.0], [[0.3, 0.0]], base, mode="fixed")
    assert held.sigma_min[0] < 1e-12 < sa.Motion(arm, [0.0], [[0.3, 0.0]], base).sigma_min[0]
    with pytest.raises(sa.ConfigurationError, match="'adrift'"):
        sa.Motion(arm, [0.0], [[0.3, 0.0]], base, mode="adrift")


def test_a_motion_of_one_sample_stays_there():
    arm = sa.load("planar2")
    motion = sa.Motion(arm, [1.0], [[0.3, 1.2]], [[0, 0, 0, 0, 0, 0, 1]])
    for t in (0.0, 1.0, 5.0):
        np.testing.assert_array_equal(motion.spline(t), motion.q[0])
        np.testing.assert_array_equal(motion.at(t).q, motion.q[0])
    assert not motion.spline(1.0, 1).any()
    law = sa.Tracking(motion)
    np.testing.assert_allclose(law(0.0, arm.at([0.3, 1.2]), np.zeros(2)), 0.0, atol=1e-12)


def test_a_motion_of_several_tips_has_no_one_path():
    arm = sa.load("dual_ur5")
    arm = arm.replace(tip=arm.tips if len(arm.tips) > 1 else ("left", "right"))
    motion = sa.Motion(arm, [0.0, 1.0], [np.full(12, 0.4)] * 2, np.tile(np.eye(7)[6], (2, 1)))
    with pytest.raises(sa.UnsupportedError):
        _ = motion.tip
    assert motion.sigma_min.shape == (2,)
    assert "tip" not in motion.to_dict()
    assert "tip" not in motion.to_xarray()


# --- the story ------------------------------------------------------------------------------


def test_every_kind_says_how_it_ended(kinds):
    assert kinds["Motion"].story == "free-floating: 2 s"
    assert kinds["Trajectory"].story == "free-floating: 2 s"
    assert kinds["Followed"].story == "free-floating: arrived"
    assert kinds["Plan"].story.startswith("straight: joint travel ")
    for motion in kinds.values():
        assert "\n" not in motion.story
        assert motion.singular_times == ()
        assert type(motion).__name__ in repr(motion)


def test_singular_times():
    arm, q = sa.load("planar2"), np.radians([-57.936, 60.337])
    base = arm.at(q, base=pin.SE3(pin.exp3(np.radians([0, 0, 21])), np.zeros(3)))
    stuck = sa.follow(arm.at(q, base=base.centred(np.zeros(3)).base), [(1.5, 1.5)])
    assert stuck.story == "free-floating: ended by singularity"
    assert stuck.singular_times == (stuck.t[-1],)
    law = sa.JointPD(target=[0.3, -1.2], kp=5.0, kd=9.0)
    run = sa.simulate(arm.at([0.3, 1.2]), law, 20.0, stop=["singularity"])
    assert run.story == "free-floating: ended by singularity"
    assert run.singular_times == (run.events[0].t,)


# --- files ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_saved_and_loaded(kinds, kind, tmp_path):
    motion, path = kinds[kind], tmp_path / "motion.npz"
    motion.save(path)
    for read in (sa.Motion, type(motion)):
        again = read.load(path, motion.arm)
        assert type(again) is type(motion)
        assert again.to_dict() == motion.to_dict()
        assert repr(again) == repr(motion)


def test_a_plan_is_proven_anew_when_it_is_read(kinds, tmp_path):
    kinds["Plan"].save(tmp_path / "plan.npz")
    plan = sa.Motion.load(tmp_path / "plan.npz", kinds["Plan"].arm)
    assert plan.certificate.free
    assert plan.tried == kinds["Plan"].tried
    assert plan.apart is kinds["Plan"].apart


def test_a_file_of_another_kind_is_refused(kinds, tmp_path):
    path = tmp_path / "plan.npz"
    kinds["Plan"].save(path)
    with pytest.raises(sa.ConfigurationError, match=r"not a saved trajectory: .*'Plan'"):
        sa.Trajectory.load(path, kinds["Plan"].arm)
    with pytest.raises(sa.ConfigurationError, match="joint_3"):
        sa.Motion.load(path, sa.load("planar3"))


def test_a_motion_of_an_arm_with_other_wheels_says_so(tmp_path):
    arm = load_text(with_wheels("planar2", [(0, 0, 1)]))
    sa.follow(arm.at([0.3, 1.2]), [(1.5, 1.2)]).save(tmp_path / "m.npz")
    with pytest.raises(sa.ConfigurationError, match=r"with 1 wheel, and planar2 has 0; .*wheels="):
        sa.Motion.load(tmp_path / "m.npz", sa.load("planar2"))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("kind", np.array("Ballet"), "'Ballet'"),
        ("kind", np.array(3.0), "kind holds float64"),
        ("apart", np.array("perhaps"), "apart is 'perhaps'"),
        ("tried_arrived", np.array(["yes"]), "tried_arrived holds <U3"),
        ("tried_story", None, "holds no tried_story"),
        ("tried_method", np.array("straight"), "tried_method holds"),
        ("clearance", np.array(np.nan), "clearance holds numbers that are not finite"),
        ("method", None, "holds no method"),
        ("base", None, "holds no base"),
        ("com", np.zeros((2, 3)), "com holds float64"),
    ],
)
def test_damaged_plans_are_refused(kinds, tmp_path, name, value, message):
    path = tmp_path / "plan.npz"
    kinds["Plan"].save(path)
    with np.load(path) as file:
        arrays = dict(file)
    del arrays[name]
    np.savez(path, **(arrays if value is None else arrays | {name: value}))
    with pytest.raises(sa.ConfigurationError, match=f"not a saved motion: .*{message}"):
        sa.Motion.load(path, kinds["Plan"].arm)


# --- labelled and plain data ----------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_as_labelled_arrays(kinds, kind):
    motion = kinds[kind]
    data = motion.to_xarray()
    assert data.attrs["base_mode"] == "free-floating"
    assert data["tip"].dims == ("t", "pose")
    assert data["com"].attrs["units"] == "m"
    np.testing.assert_array_equal(data["t"], motion.t)
    np.testing.assert_array_equal(data["q"].sel(joint="joint_2"), motion.q[:, 1])


@pytest.mark.parametrize("kind", KINDS)
def test_labelled_arrays_go_to_netcdf_and_back(kinds, kind, tmp_path):
    data = kinds[kind].to_xarray()
    data.to_netcdf(tmp_path / "motion.nc")
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "motion.nc"), data)


@pytest.mark.parametrize("name", ["run.csv", "run", "run.json"])
def test_a_motion_is_saved_as_npz_or_not_at_all(kinds, tmp_path, name):
    with pytest.raises(sa.ConfigurationError, match=rf"{name}: .*saved whole as .npz"):
        kinds["Motion"].save(tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_as_plain_data(kinds, kind):
    motion = kinds[kind]
    data = json.loads(json.dumps(motion.to_dict()))
    assert data["arm"] == "planar2"
    for name in ("t", "q", "dq", "base", "tip", "com", "sigma_min"):
        np.testing.assert_array_equal(data[name], getattr(motion, name))


def test_parts_of_results_as_plain_data(kinds):
    (event,) = kinds["Trajectory"].events
    assert json.loads(json.dumps(event.to_dict()))["q"] == event.q.tolist()
    assert kinds["Trajectory"].to_dict()["events"] == [event.to_dict()]
    (attempt,) = kinds["Plan"].tried
    assert kinds["Plan"].to_dict()["tried"] == [attempt.to_dict()]
    assert attempt.to_dict()["method"] == "straight"
    assert sa.Joints((0.1, 0.2)).to_dict() == {"q": [0.1, 0.2]}


def still(_):
    return (1.0, 0.5)


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (sa.TransposedJacobian(target=(1.0, 0.5), kp=[5, 6], kd=np.ones(2)),
         {"target": [1.0, 0.5], "mode": "free-floating", "kp": [5, 6], "kd": [1.0, 1.0]}),
        (sa.ResolvedRate(target=pin.SE3.Identity()),
         {"target": [0, 0, 0, 0, 0, 0, 1.0], "mode": "free-floating", "gain": 1.0, "servo": 20.0,
          "rest": None}),
        (sa.DampedLeastSquares(target=still, mode="fixed"),
         {"target": repr(still), "mode": "fixed", "gain": 1.0, "servo": 20.0, "damping": 0.1,
          "threshold": 0.1}),
        (sa.Reactionless(target=(1.0, 0.5), threshold=0.2),
         {"target": [1.0, 0.5], "mode": "free-floating", "gain": 1.0, "servo": 20.0,
          "damping": 0.1, "threshold": 0.2}),
        (sa.JointPD((0.1, 0.2), kp=2, kd=4),
         {"target": [0.1, 0.2], "kp": 2, "kd": 4, "ki": 0.0, "limit": None}),
    ],
)  # fmt: skip
def test_controllers_as_plain_data(law, expected):
    assert json.loads(json.dumps(law.to_dict())) == expected


# --- bad input ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"t": [0.0]}, r"q is .*give a \(1, 2\) array of finite numbers"),
        ({"t": [0.0, 0.0]}, "t does not increase"),
        ({"q": [[0, 0], [0, np.nan]]}, "q .* finite numbers"),
        ({"t": [0.0, 1e300]}, "t .* finite numbers"),
        ({"base": [[0] * 7] * 2}, "base .* quaternions that are not of length 1"),
        ({"base": [[0] * 6] * 2}, r"(?s)base is .*give a \(2, 7\)"),
        ({"t": None}, "t is None; give 1 finite number$"),
        ({"q": [[0, 0], [1]]}, "q is .*finite numbers"),
        ({"base": None}, "cannot be played"),
    ],
)
def test_bad_motions_are_refused(change, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.Motion.of(SimpleNamespace(**{**vars(two_samples()), **change}))
    with pytest.raises(sa.ConfigurationError, match="cannot be played; give a motion"):
        sa.Motion.of({})


@pytest.mark.parametrize("name", ["t", "kind", "joints", "x"])
def test_a_file_with_a_member_that_is_no_array(tmp_path, name):
    with zipfile.ZipFile(tmp_path / "m.npz", "w") as archive:
        archive.writestr(name, b"no array")
    with pytest.raises(sa.ConfigurationError, match="is not an array"):
        sa.Motion.load(tmp_path / "m.npz", sa.load("planar2"))


@pytest.mark.slow
def test_a_motion_is_read_where_its_kind_has_not_been_used(tmp_path):
    arm = sa.load("planar2")
    sa.follow(arm.at([0.3, 1.2]), [(1.5, 1.2)]).save(tmp_path / "way.npz")
    code = (
        "import spacearm as sa; print(type(sa.Motion.load('way.npz', sa.load('planar2'))).__name__)"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "Followed"


def test_between_samples_a_plain_motion_is_what_is_followed():
    """Samples of a simulation, without its rates: followed closely, joints and base go as `at`."""
    start = sa.load("planar2").at([-0.6, 1.4])
    run = sa.simulate(start, sa.JointPD([0.2, 0.9], kp=4.0, kd=14.0), 4.0)
    some = slice(25, None, 10)  # after the jump of the accelerations at the start
    motion = sa.Motion(run.arm, run.t[some] - run.t[25], run.q[some], run.base[some])
    law = sa.Tracking(motion, rate=30.0)
    begin, last = motion.spline(0.0, 1), float(motion.t[-1])
    flown = sa.simulate(motion[0], law, last, dq=begin, integration=sa.Integration(dt=0.03))
    there = [motion.at(float(t)) for t in flown.t]
    q = np.array([cfg.q for cfg in there])
    base = np.array([pin.SE3ToXYZQUAT(cfg.base) for cfg in there])
    assert np.abs(q - flown.q).max() < 1e-7 < 1e-5 < straight(motion, motion.q, flown.t, flown.q)
    off = np.abs(base - flown.base).max()
    assert off < 1e-7 < 1e-5 < straight(motion, motion.base, flown.t, flown.base)


def straight(motion, rows, t, expected):
    """How far straight lines between rows are off, at most."""
    off = [np.interp(t, motion.t, x) - y for x, y in zip(rows.T, expected.T, strict=True)]
    return float(np.abs(off).max())
