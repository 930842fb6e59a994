"""Simulation and control: the paper's figures 5 and 6, conservation laws, an independent route."""

import io
import zipfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import spacearm as sa

TARGET = np.array([1.5, 1.5])
ARM = sa.load("planar2")


def at_the_cm(arm, q, attitude):
    """The spacecraft's pose that puts the system CM at the origin."""
    R = pin.exp3(np.array([0.0, 0.0, np.radians(attitude)]))
    return pin.SE3(R, -arm.at(q, base=pin.SE3(R, np.zeros(3))).com)


@pytest.fixture(scope="module")
def figure_5():
    arm = sa.load("planar2")
    q = np.radians([-57.936, 60.337])
    law = sa.TransposedJacobian(target=TARGET, kp=5, kd=15)
    return sa.simulate(arm.at(q, base=at_the_cm(arm, q, 21.0)), law, 200.0)


def push(seed, n, size=2.0):
    """Vigorous smooth torques."""
    rng = np.random.default_rng(seed)
    a, w, phase = rng.normal(size=(3, 5, n))

    def controller(t, *_):
        return size * (a * np.sin(3 * w * t + phase)).sum(axis=0)

    return controller


def nothing(*state):
    return np.zeros_like(state[-1])


# --- the paper ------------------------------------------------------------------------------


def test_figure_5_meets_a_singularity(figure_5):
    np.testing.assert_allclose(figure_5.tip[0, :2], (2.0, 0.0), atol=1e-4)
    first = figure_5.events[0]
    assert first.kind == "singularity"
    assert first.t == pytest.approx(4.889, abs=0.005)
    np.testing.assert_allclose(np.degrees(first.q), (75.71, 11.26), atol=0.01)
    i = np.searchsorted(figure_5.t, first.t)
    np.testing.assert_allclose(figure_5.tip[i, :2], (1.575, 1.169), atol=0.02)
    assert sa.singularity(figure_5.arm.at(first.q)).sigma_min < 1e-9


def test_figure_6_never_arrives(figure_5):
    np.testing.assert_allclose(figure_5.tip[-1, :2], (1.394, 1.255), atol=0.01)
    miss = np.linalg.norm(figure_5.tip[:, :2] - TARGET, axis=1)
    assert miss.min() > 0.25
    assert figure_5.ended == "duration"
    assert sum(event.kind == "singularity" for event in figure_5.events) > 10  # about singular ones


def test_a_run_can_end_at_the_first_singularity(figure_5):
    law = sa.TransposedJacobian(target=TARGET, kp=5, kd=15)
    start = figure_5[0]
    found = sa.simulate(start, law, 200.0, stop=["singularity"])
    assert found.ended == "singularity"
    assert found.t[-1] == pytest.approx(4.889, abs=0.005)
    assert found.sigma_min[-1] < 1e-8


def test_a_target_in_the_path_independent_workspace_is_reached():
    arm = sa.load("planar2")
    q = np.radians([-57.936, 60.337])
    law = sa.TransposedJacobian(target=(0.0, 1.0), kp=5, kd=15)
    far = sa.simulate(arm.at(q, base=at_the_cm(arm, q, 21.0)), law, 400.0, stop=["target"])
    assert sa.workspace(arm).regions((0.0, 1.0)).kind == "path independent"
    assert far.ended == "target"
    np.testing.assert_allclose(far.tip[-1, :2], (0, 1), atol=1.1e-3)


# --- conservation ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["planar2", "chaser7"])
def test_momentum_and_energy_under_vigorous_torques(name):
    arm = sa.load(name)
    run = sa.simulate(
        arm.at(np.full(arm.n, 0.3)),
        push(0, arm.n),
        20.0,
        integration=sa.Integration(rtol=1e-10, events=()),
    )
    assert np.abs(run.momentum).max() < 1e-10 * arm.mass
    assert np.abs(run.dq).max() > 0.1
    assert run.imbalance < 1e-8
    assert np.abs(np.linalg.norm(run.base[:, 3:], axis=1) - 1).max() < 1e-14


@pytest.mark.slow
def test_momentum_does_not_drift_in_a_thousand_seconds():
    """The poses that come out, differentiated, have no momentum either."""
    arm = sa.load("chaser7")
    limbs = np.array([20, 40, 5, 10, 1, 1, 0.1])  # what each joint may be pushed with [N m]
    torque, calm = push(5, 7), np.zeros(7)

    def vigorous(t, cfg, dq):
        return limbs * (0.2 * torque(t, cfg, dq) - 0.5 * dq + 0.5 * (calm - cfg.q))

    run = sa.simulate(
        arm.at(calm),
        vigorous,
        1000.0,
        integration=sa.Integration(rtol=1e-9, atol=1e-11, dt=0.5, events=()),
    )
    assert np.abs(run.dq).max() > 0.2
    assert run.drift < 1e-10
    assert run.imbalance < 1e-8
    h = 1e-4
    for i in (200, 1000, 1999):
        near = sa.simulate(
            run[i],
            lambda s, *now, t=run.t[i]: vigorous(t + s, *now),
            2 * h,
            dq=run.dq[i],
            integration=sa.Integration(dt=h),
        )
        before, after = near[0], near[-1]
        turning = pin.log3(after.base.rotation @ before.base.rotation.T) / (2 * h)
        momentum = sa.momentum_matrix(near[1])
        shift = (after.base.translation - before.base.translation) / (2 * h)
        h_seen = momentum.A_b @ np.append(shift, turning) + momentum.A_q @ near.dq[1]
        assert np.abs(h_seen).max() < 1e-5 * np.abs(momentum.A_q @ near.dq[1]).max()


@pytest.mark.slow
def test_an_initial_momentum_is_kept_as_a_vector():
    arm = sa.load("chaser7")
    h = np.array([3.0, -1.0, 2.0, 0.5, 4.0, -2.0])
    run = sa.simulate(
        arm.at(np.zeros(7), momentum=h), push(1, 7), 10.0, integration=sa.Integration(events=())
    )
    np.testing.assert_allclose(run.momentum, np.tile(h, (len(run.t), 1)), atol=1e-10)
    com = np.array([run[i].com for i in (0, -1)])
    np.testing.assert_allclose(com[1] - com[0], h[:3] / arm.mass * run.t[-1], atol=1e-9)


@pytest.mark.slow
def test_the_energy_balance_does_not_hang_on_the_output():
    law = sa.JointPD(target=(0.4, -0.1), kp=5, kd=20)
    for dt in (0.1, 60.0):
        assert (
            sa.simulate(
                sa.load("planar2").at([0, 0.5]), law, 60.0, integration=sa.Integration(dt=dt)
            ).imbalance
            < 1e-6
        )


@pytest.mark.parametrize(
    "duration", [15.737135444204768, 3.9631824805267923, 1.9675185533227941, 0.7]
)
def test_no_two_rows_are_a_rounding_apart(duration):
    """A thousand intervals of the duration may add up to a little less than it."""
    start = sa.load("planar2").at([0.3, 1.2])
    run = sa.simulate(start, sa.JointPD([0.4, 1.0], kp=5.0, kd=9.0), duration)
    assert run.t[-1] == duration
    assert np.diff(run.t).min() > 0.5 * duration / 1000


def test_at_rest_without_torques_nothing_moves():
    arm = sa.load("ets7")
    run = sa.simulate(arm.at(np.full(6, 0.4)), nothing, 50.0)
    assert not run.dq.any()
    np.testing.assert_allclose(run.base, np.tile(run.base[0], (len(run.t), 1)), atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["DOP853", "Rodas5P"])
@pytest.mark.parametrize("name", ["planar3", "mda6", "ets7"])
def test_an_arm_that_rests_on_its_target_stays(name, method):
    """There is no energy to compare an imbalance with, only rounding."""
    arm = sa.load(name)
    q = np.linspace(0.2, 0.9, arm.n)
    run = sa.simulate(
        arm.at(q),
        sa.ResolvedRate(target=arm.at(q).tip),
        5.0,
        integration=sa.Integration(method=method),
    )
    np.testing.assert_allclose(run.q[-1], q, atol=1e-6)


def test_a_settled_arm_can_be_simulated_on():
    arm = sa.load("planar2")
    law = sa.JointPD(target=[0.4, 0.5], kp=5.0, kd=15.0)
    settled = sa.simulate(arm.at([0.3, 0.3]), law, 120.0)[-1]
    run = sa.simulate(settled, law, 30.0)
    np.testing.assert_allclose(run.q[-1], [0.4, 0.5], atol=1e-3)


def test_time_reversal_returns_to_the_start():
    arm = sa.load("planar3")
    h = np.array([0, 0, 0, 0, 0, 1.0])
    q0, dq0 = np.array([0.2, 0.5, -0.4]), np.array([0.3, -0.2, 0.1])
    there = sa.simulate(
        arm.at(q0, momentum=h),
        nothing,
        5.0,
        dq=dq0,
        integration=sa.Integration(rtol=1e-11, atol=1e-12),
    )
    end = there[-1]
    back = sa.simulate(
        arm.at(end.q, base=end.base, momentum=-h),
        nothing,
        5.0,
        dq=-there.dq[-1],
        integration=sa.Integration(rtol=1e-11, atol=1e-12),
    )
    np.testing.assert_allclose(back.q[-1], q0, atol=1e-8)
    np.testing.assert_allclose(back.dq[-1], -dq0, atol=1e-8)
    np.testing.assert_allclose(back.base[-1], there.base[0], atol=1e-8)


@pytest.mark.slow
def test_the_full_system_by_aba_moves_the_same_way():
    """All 6 + n coordinates integrated by Pinocchio's own algorithm, no momentum assumed."""
    arm, torque = sa.load("chaser7"), push(2, 7)
    model, data = arm.model, arm.model.createData()
    q0, n = np.linspace(-0.5, 0.5, 7), 7
    run = sa.simulate(
        arm.at(q0),
        torque,
        3.0,
        integration=sa.Integration(rtol=1e-12, atol=1e-13, events=(), method="DOP853"),
    )

    def rate(t, y):
        full, v = y[: model.nq], y[model.nq :]
        R = pin.Quaternion(full[3:7] / np.linalg.norm(full[3:7])).matrix()
        x, s, w = full[3:6], full[6], v[3:6]
        turning = 0.5 * np.append(s * w + np.cross(x, w), -x @ w)
        unit = np.concatenate((full[:3], full[3:7] / np.linalg.norm(full[3:7]), full[7:]))
        tau = np.concatenate((np.zeros(6), torque(t, None, v[6:])))
        return np.concatenate((R @ v[:3], turning, v[6:], pin.aba(model, data, unit, v, tau)))

    start = np.concatenate((np.zeros(6), [1.0], q0, np.zeros(6 + n)))
    full = solve_ivp(rate, (0, 3.0), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(run.q[-1], full[7 : 7 + n], atol=1e-8)
    np.testing.assert_allclose(run.dq[-1], full[-n:], atol=1e-8)
    np.testing.assert_allclose(run.base[-1, :3], full[:3], atol=1e-8)
    assert abs(run.base[-1, 3:] @ full[3:7]) == pytest.approx(np.linalg.norm(full[3:7]), abs=1e-8)


@pytest.mark.slow
def test_a_controlled_attitude_stays_and_a_fixed_spacecraft_too():
    arm = sa.load("mda6")
    base = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([1.0, 2.0, 3.0]))
    q0 = np.array([0.1, 0.5, -0.8, 0.3, 0.2, 0.1])
    for mode in ("attitude-controlled", "fixed"):
        run = sa.simulate(
            arm.at(q0, base=base),
            push(3, 6, 20.0),
            5.0,
            mode=mode,
            integration=sa.Integration(events=()),
        )
        assert np.ptp(np.abs(run.base[:, 3:]), axis=0).max() < 1e-12
        moved = np.ptp(run.base[:, :3], axis=0).max()
        assert (moved > 1e-4) == (mode == "attitude-controlled")
        assert run.imbalance < 1e-8
        if mode == "attitude-controlled":
            assert np.abs(run.momentum[:, :3]).max() < 1e-9 * arm.mass


@pytest.mark.slow
def test_a_heavy_spacecraft_moves_its_arm_like_a_fixed_one():
    arm = sa.load("planar2")
    q0, torque = np.array([0.3, 0.7]), push(4, 2)
    fixed = sa.simulate(arm.at(q0), torque, 4.0, mode="fixed")
    off = []
    for factor in (1e3, 1e5):
        body = arm.model.inertias[1]
        heavy = arm.replace(base_mass=factor * body.mass, base_inertia=factor * body.inertia)
        off.append(np.abs(sa.simulate(heavy.at(q0), torque, 4.0).q[-1] - fixed.q[-1]).max())
    assert off[0] / off[1] == pytest.approx(100, rel=0.1)


# --- events, files, controllers -------------------------------------------------------------


def test_joint_limits_are_noted():
    arm = sa.load("planar2")
    run = sa.simulate(
        arm.at(np.zeros(2)), lambda *_: np.array([0.0, 1.0]), 60.0, stop=["joint limit"]
    )
    assert run.ended == "joint limit"
    assert run.events[-1].detail == "joint_2"
    assert abs(run.q[-1, 1]) == pytest.approx(np.pi, abs=1e-6)


def test_a_run_can_end_where_a_step_ends():
    """Stowed exactly at a limit, and then pushed beyond it."""
    arm = sa.load("planar2")
    run = sa.simulate(
        arm.at([arm.upper[0], 0.3]),
        lambda t, *_: [0.0 if t < 2.0 else 0.5 * (t - 2.0) ** 2, 0.0],
        5.0,
        stop=("joint limit",),
    )
    assert run.ended == "joint limit"
    assert run.t[-1] < 2.5
    np.testing.assert_allclose(run.q[-1, 0], arm.upper[0], atol=1e-6)


@pytest.mark.slow
def test_joint_pd_settles_and_targets_may_move():
    arm = sa.load("planar3")
    goal = np.array([-0.3, 0.4, 0.2])
    run = sa.simulate(
        arm.at(np.zeros(3)),
        sa.JointPD(target=goal, kp=2, kd=4),
        60.0,
        integration=sa.Integration(events=()),
    )
    np.testing.assert_allclose(run.q[-1], goal, atol=1e-3)
    law = sa.JointPD(lambda t: np.full(3, 0.01 * t), kp=20, kd=10)
    late = sa.simulate(arm.at(np.zeros(3)), law, 20.0, integration=sa.Integration(events=()))
    np.testing.assert_allclose(late.dq[-1], 0.01, atol=1e-3)


def test_a_pose_target():
    arm = sa.load("planar3", task="x y rz")
    q0 = np.array([0.3, 0.9, -0.7])
    goal = arm.at(q0).tip * pin.SE3(pin.exp3(np.array([0, 0, 0.05])), np.array([0.03, -0.02, 0]))
    law = sa.TransposedJacobian(target=goal, kp=[5, 5, 2], kd=[10, 10, 4])
    run = sa.simulate(
        arm.at(q0),
        law,
        120.0,
        stop=["target"],
        integration=sa.Integration(events=["target"], reach=5e-3),
    )
    assert run.ended == "target"
    with pytest.raises(sa.ConfigurationError, match=r"pin\.SE3"):
        sa.TransposedJacobian(target=(1.0, 2.0), kp=1, kd=1)(0.0, arm.at(q0), np.zeros(3))


def test_a_trajectory_is_saved_and_loaded(figure_5, tmp_path):
    path = tmp_path / "run.npz"
    figure_5.save(path)
    again = sa.Trajectory.load(path, figure_5.arm)
    for name in ("t", "q", "dq", "base", "tip", "torque", "momentum", "energy", "sigma_min"):
        np.testing.assert_array_equal(getattr(again, name), getattr(figure_5, name))
    assert [e.t for e in again.events] == [e.t for e in figure_5.events]
    assert again.ended == figure_5.ended
    with pytest.raises(sa.ConfigurationError, match="joint_3"):
        sa.Trajectory.load(path, sa.load("planar3"))
    path.write_bytes(b"nothing")
    with pytest.raises(sa.ConfigurationError, match="not a saved trajectory"):
        sa.Trajectory.load(path, figure_5.arm)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("q", lambda a: a[:-1], r"q holds float64 of shape \(\d+, 2\), not"),
        ("sigma_min", lambda a: a[:, None], "sigma_min holds float64 of shape"),
        ("base", lambda a: a.astype(str), "base holds <U32"),
        ("tip", lambda a: np.full_like(a, np.nan), "tip holds numbers that are not finite"),
        ("t", lambda a: a[::-1], "t does not increase"),
        ("events_q", lambda a: a[:, :1], "events_q holds float64"),
        ("base", np.zeros_like, "base holds quaternions that are not of length 1"),
        ("tip", lambda a: 1e200 * a, "tip holds quaternions that are not of length 1"),
        ("sigma_min", lambda a: -a, "sigma_min is negative"),
        ("joints", lambda _: np.arange(2.0), "joints holds float64"),
        ("mode", lambda _: np.array("adrift"), "'adrift'"),
        ("exchanged", lambda _: np.array([None, {}], dtype=object), "Object arrays"),
    ],
)
def test_damaged_trajectories_are_refused(figure_5, tmp_path, name, change, message):
    path = tmp_path / "run.npz"
    figure_5.save(path)
    with np.load(path) as file:
        arrays = dict(file)
    np.savez(path, **(arrays | {name: change(arrays[name])}))
    with pytest.raises(sa.ConfigurationError, match=f"not a saved trajectory: .*{message}"):
        sa.Trajectory.load(path, figure_5.arm)


def test_files_that_are_no_archives_or_packed_ones_are_refused(figure_5, tmp_path):
    path = tmp_path / "run.npz"
    figure_5.save(path)
    whole = path.read_bytes()
    for data in (whole[:-100], whole.replace(b"q.npy", b"p.npy"), whole[:500] + whole[600:]):
        path.write_bytes(data)
        with pytest.raises(sa.ConfigurationError, match="not a saved trajectory"):
            sa.Trajectory.load(path, figure_5.arm)
    with path.open("wb") as file:
        np.save(file, figure_5.q)
    for text in (path.read_bytes(), b"t,x,y\n0,1,1\n", b""):
        path.write_bytes(text)
        with pytest.raises(
            sa.ConfigurationError, match=r"not a saved trajectory: .* zip.* its save wrote"
        ):
            sa.Trajectory.load(path, figure_5.arm)
    np.savez_compressed(path, t=np.zeros(1000))
    with pytest.raises(sa.ConfigurationError, match=r"more data than it has bytes \(compressed"):
        sa.Trajectory.load(path, figure_5.arm)


@pytest.mark.parametrize(
    ("name", "kind", "shape"),
    [("joints", "<U0", (10**10,)), ("joints", "|V0", (10**12,)), ("events_kind", "<U0", (10**10,)),
     ("mode", "|V0", (10**12,)), ("t", "<f8", (10**18, 0)), ("q", "<f8", (0, 10**18))],
)  # fmt: skip
def test_arrays_of_nothing_are_refused(figure_5, tmp_path, name, kind, shape):
    """They take no bytes in the file, and any time to go through."""
    path, bad = tmp_path / "run.npz", tmp_path / "bad.npz"
    figure_5.save(path)
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": kind, "fortran_order": False, "shape": shape}
    )
    with zipfile.ZipFile(path) as good, zipfile.ZipFile(bad, "w") as archive:
        for entry in good.namelist():
            content = header.getvalue() if entry == f"{name}.npy" else good.read(entry)
            archive.writestr(entry, content)
    with pytest.raises(sa.ConfigurationError, match="not a saved trajectory"):
        sa.Trajectory.load(bad, figure_5.arm)


def test_no_more_is_read_than_the_file_holds(figure_5, tmp_path):
    """Entries of an archive may share their bytes."""
    path = tmp_path / "run.npz"
    with zipfile.ZipFile(path, "w") as archive:
        content = io.BytesIO()
        np.save(content, np.zeros(100_000))
        archive.writestr("t.npy", content.getvalue())
        archive.filelist += archive.filelist * 50
    with pytest.raises(sa.ConfigurationError, match="more data than it has bytes"):
        sa.Trajectory.load(path, figure_5.arm)


def test_a_trajectory_as_labelled_arrays(figure_5):
    data = figure_5.to_xarray()
    assert data["q"].dims == ("t", "joint")
    assert data["q"].sel(joint="joint_2").values[0] == figure_5.q[0, 1]
    assert data["torque"].attrs["units"] == "N m"
    assert "first singularity at 4.889 s" in repr(figure_5)


@pytest.mark.parametrize(
    ("controller", "message"),
    [
        (lambda *_: np.zeros(3), r"the controller's torque has shape \(3,\)"),
        (lambda t, *_: np.full(2, np.nan if t > 1 else 0.1), r"at t = .*joint_1.*nan"),
    ],
)
def test_a_controller_that_fails_leaves_the_trajectory_so_far(controller, message):
    with pytest.raises(sa.NoSolutionError, match=message) as caught:
        sa.simulate(sa.load("planar2").at([0.1, 0.2]), controller, 5.0)
    if caught.value.best is not None:
        assert 0.1 < caught.value.best.t[-1] <= 1.5
        assert np.isfinite(caught.value.best.q).all()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "DOP853", "Rodas5P"])
@pytest.mark.parametrize(
    "law",
    [
        lambda _, cfg, dq: -10.0 * np.sign(dq + cfg.q - 0.5),  # slides along its own jump
        sa.JointPD(target=(0.5, 0.5), kp=1e11, kd=1e3),
    ],
)
def test_a_step_that_collapses_is_an_error(method, law):
    with pytest.raises(sa.NoSolutionError, match="step size collapsed at t = ") as caught:
        sa.simulate(
            sa.load("planar2").at([0.1, 0.2]), law, 10.0, integration=sa.Integration(method=method)
        )
    assert caught.value.best.ended == "step collapsed"


@pytest.mark.slow
def test_high_gains_are_no_reason_to_stop():
    arm = sa.load("chaser7")
    law = sa.JointPD(target=np.zeros(7), kp=4000, kd=400)
    run = sa.simulate(arm.at(np.full(7, 0.3)), law, 10.0, stop=["target"])
    assert run.ended == "target"


@pytest.mark.slow
def test_a_simulation_may_run_inside_a_controller():
    arm = sa.load("planar2")

    def looks_ahead(_, cfg, dq):
        ahead = sa.simulate(
            arm.at(cfg.q), nothing, 0.1, dq=dq, integration=sa.Integration(dt=0.1, events=())
        )
        return 0.1 - ahead.q[-1]

    run = sa.simulate(
        arm.at([0.1, 0.2]), looks_ahead, 0.1, integration=sa.Integration(rtol=1e-4, events=())
    )
    assert run.ended == "duration"


def test_what_ctrl_c_interrupts_is_kept():
    calls = []

    def controller(t, *_):
        calls.append(t)
        if t > 2.0:
            raise KeyboardInterrupt
        return np.array([0.1, -0.1])

    run = sa.simulate(
        sa.load("planar2").at([0.1, 0.2]), controller, 60.0, integration=sa.Integration(rtol=1e-10)
    )
    assert run.ended == "interrupted"
    assert 0.5 < run.t[-1] <= 2.0


def test_errors_of_a_controller_that_are_none_of_ours_come_through():
    def controller(*_):
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        sa.simulate(sa.load("planar2").at([0.1, 0.2]), controller, 1.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration": 0.0}, "duration is 0.0"),
        ({"duration": np.inf}, "duration is inf"),
        ({"integration": sa.Integration(events=["crash"])}, "'crash'"),
        ({"integration": sa.Integration(dt=99.0)}, "dt is 99"),
        ({"mode": "free"}, "free-floating"),
        ({"mode": "fixed", "start": ARM.at([0.1, 0.2], momentum=np.ones(6))}, "fixed spacecraft"),
        ({"dq": [1.0]}, "dq"),
    ],
)
def test_bad_input(options, message):
    given = {"start": ARM.at([0.1, 0.2]), "controller": nothing, "duration": 1.0} | options
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.simulate(**given)


def test_an_integrator_that_is_not_there_is_refused():
    with pytest.raises(sa.ConfigurationError, match="'Euler'"):
        sa.Integration(method="Euler")


@pytest.mark.parametrize("compiled", [True, False])
def test_threads_may_simulate_at_once(compiled):
    """Each run has a memory of its own: all are the same to the bit as one after the other."""
    arm = sa.load("planar2")
    pull = sa.JointPD(target=[0.4, 1.0], kp=5.0, kd=9.0)
    law = pull if compiled else lambda _, cfg, dq: pull.kp * (pull.target - cfg.q) - pull.kd * dq

    def end(q1):
        return sa.simulate(arm.at([q1, 1.2]), law, 0.3).q[-1]

    starts = np.linspace(0.1, 0.6, 6)
    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(end, starts))
    np.testing.assert_array_equal(together, [end(q1) for q1 in starts])


def test_a_controller_that_fails_later_leaves_the_run_up_to_there():
    """A step that looks ahead to where it fails is tried again, shorter."""
    arm = sa.load("planar2")
    failing = (
        lambda t, *_: [np.nan if t > 1.0 else 0.1, 0.0],
        lambda t, cfg, dq: np.where(t > 1.0, np.nan, 0.1) * (0.5 - cfg.q) - dq,
    )
    for law in failing:
        with pytest.raises(sa.NoSolutionError, match="at t = 1 s") as refused:
            sa.simulate(arm.at([0.3, 1.2]), law, 5.0, integration=sa.Integration(events=()))
        assert refused.value.best.t[-1] == pytest.approx(1.0, abs=1e-6)
        assert refused.value.best.imbalance < 1e-7
