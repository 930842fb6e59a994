"""Against MuJoCo, where it is installed: a free joint, no gravity, small steps."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from helpers.catching import caught
from scipy.interpolate import CubicSpline

import spacearm as sa

mujoco = pytest.importorskip("mujoco", reason="pip install mujoco")


def engine(arm, step):
    """The same URDF with a free joint above the spacecraft, integrated by Runge-Kutta steps."""
    options = '<mujoco><compiler fusestatic="false" balanceinertia="true"/></mujoco></robot>'
    spec = mujoco.MjSpec.from_string(Path(arm.path).read_text().replace("</robot>", options))
    spec.worldbody.first_body().add_freejoint()
    spec.option.gravity[:] = 0.0
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for flag in ("LIMIT", "CONTACT"):
        spec.option.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}")
    model = spec.compile()
    return model, mujoco.MjData(model)


def torque(t, n, size):
    """Smooth, different for every joint, strong enough to swing the arm about."""
    j = np.arange(n)
    return size * 0.5**j * np.sin((0.5 + 0.3 * j) * t + j)


def integrated(arm, q0, duration, size, prepare=None, also=None):
    """Where MuJoCo ends under smooth torques: base, joints and rates, and how accurate it is."""
    ends = []
    for step in (4e-3, 2e-3):
        model, data = engine(arm, step)
        data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
        data.qpos[7:] = q0
        if prepare:
            prepare(model)

        def push(model, data):
            data.qfrc_applied[6:] = torque(data.time, arm.n, size)
            if also:
                also(model, data)

        mujoco.set_mjcb_control(push)
        try:
            for _ in range(round(duration / step)):
                mujoco.mj_step(model, data)
        finally:
            mujoco.set_mjcb_control(None)
        mujoco.mj_normalizeQuat(model, data.qpos)
        ends.append(np.concatenate((data.qpos, data.qvel[6:])))
    return ends[1], np.abs(ends[1] - ends[0]).max()


def check(run, theirs, accuracy):
    """That a run ends where MuJoCo does."""
    x, y, z, w = run.base[-1, 3:] * np.sign(run.base[-1, 6] * theirs[3])
    ours = np.concatenate((run.base[-1, :3], (w, x, y, z), run.q[-1], run.dq[-1]))
    assert accuracy < 1e-6
    np.testing.assert_allclose(ours, theirs, atol=accuracy)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "size"), [("planar2", 1.0), ("chaser7", 4.0)])
def test_ten_seconds_of_the_same_motion(name, size):
    arm = sa.load(name)
    n, q0 = arm.n, np.linspace(0.5, -0.4, arm.n)
    run = sa.simulate(
        arm.at(q0),
        lambda t, *_: torque(t, n, size),
        10.0,
        integration=sa.Integration(rtol=1e-10, atol=1e-12, events=(), method="DOP853"),
    )
    assert np.abs(run.q[-1] - q0).max() > 0.5
    check(run, *integrated(arm, q0, 10.0, size))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "link"), [("planar2", "link_1"), ("chaser7", "link_4")])
def test_springs_dampers_and_a_wrench_on_a_link(name, link):
    """The wrench acts at the link's frame along inertial axes; MuJoCo has it at the link's CM."""
    arm, duration = sa.load(name), 5.0
    n, q0 = arm.n, np.linspace(0.5, -0.4, arm.n)
    joints = {
        joint: sa.PassiveJoint(stiffness=0.4 + 0.1 * j, rest=0.1 * j, damping=0.5 / (1 + j))
        for j, joint in enumerate(arm.joint_names)
    }
    force, moment = np.array([0.3, -0.2, 0.0]), np.array([0.0, 0.0, 0.1])
    if arm.tree.plane_normal() is None:
        force += (0.0, 0.0, 0.25)
        moment += (0.05, -0.08, 0.0)
    run = sa.simulate(
        arm.at(q0),
        lambda t, *_: torque(t, n, 1.0),
        duration,
        plant=sa.Plant(wrenches={link: np.concatenate((force, moment))}, passive=joints),
        integration=sa.Integration(rtol=1e-10, atol=1e-12, events=(), method="DOP853"),
    )

    def prepare(model):
        for joint, law in joints.items():
            i = model.joint(joint).id
            model.jnt_stiffness[i] = law.stiffness
            model.qpos_spring[model.jnt_qposadr[i]] = law.rest
            model.dof_damping[model.jnt_dofadr[i]] = law.damping

    def pull(model, data):
        body = model.body(link).id
        arm_of_force = data.xpos[body] - data.xipos[body]
        data.xfrc_applied[body] = [*force, *(moment + np.cross(arm_of_force, force))]

    ends = integrated(arm, q0, duration, 1.0, prepare, pull)
    assert np.abs(run.q[-1] - q0).max() > 0.2
    assert np.linalg.norm(run.momentum[-1]) > 0.5
    check(run, *ends)


def replayed(run, path, step=4e-3):
    """Tip of a run as MuJoCo has it: the exported model, its own integrator, the run's torques."""
    arm = run.arm
    spec = mujoco.MjSpec.from_file(str(sa.to_mjcf(arm, path)))
    spec.option.timestep, spec.option.integrator = step, mujoco.mjtIntegrator.mjINT_RK4
    for flag in ("LIMIT", "CONTACT"):
        spec.option.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}")
    model = spec.compile()
    data, first = mujoco.MjData(model), run[0]
    x, y, z, w = run.base[0, 3:]
    data.qpos[:7], data.qpos[7:] = [*run.base[0, :3], w, x, y, z], run.q[0]
    twist = sa.base_velocity(first, run.dq[0])
    data.qvel[:3], data.qvel[3:6] = twist[:3], first.base.rotation.T @ twist[3:]
    data.qvel[6:] = run.dq[0]
    torques = CubicSpline(run.t, run.torque)

    def push(_, data):
        data.qfrc_applied[6:] = torques(min(data.time, run.t[-1]))

    places, steps = [], round(float(run.t[-1]) / step)
    mujoco.set_mjcb_control(push)
    try:
        for i in range(steps + 1):
            if i % 25 == 0:
                places.append(tip_of(arm, data))
            mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_control(None)
    return step * 25 * np.arange(len(places)), np.array(places)


def tip_of(arm, data):
    """Place of the tip for MuJoCo's state."""
    w, x, y, z = data.qpos[3:7] / np.linalg.norm(data.qpos[3:7])
    base = pin.XYZQUATToSE3(np.array([*data.qpos[:3], x, y, z, w]))
    return arm.at(data.qpos[7:], base=base).tip.translation


@pytest.mark.slow
def test_a_catch_is_replayed_from_its_torques(tmp_path):
    """Approach and braking: MuJoCo's tip is where the flight's is; contact keeps the momentum."""
    catch = caught()
    target = catch.target.replace(twist=(0.0, 0.002, 0.0, 0.02, 0.03, 0.02))
    start = catch.plan[0]
    catch = sa.catch(start, target, window=(10, 30), wanted=1)
    fine = sa.Integration(rtol=1e-9, atol=1e-11, dt=0.01)
    actual = target.scaled(1.2, 0.8)
    flight = catch.fly(actual, integration=fine)
    frame, held = actual.at(catch.t), flight.phases[2]
    there = flight.phases[1][-1].tip * catch.chase[-1].tip.actInv(frame.pose)  # as it is held
    R, w, v = there.rotation, frame.twist[3:], actual.cm[1]
    lever = there.act(actual.com) - held[0].com
    angular = R @ actual.inertia @ R.T @ w + actual.mass * np.cross(lever, v)
    before = np.append(actual.mass * v, angular)  # the arm has none
    size = np.linalg.norm(before)
    for row in (0, -1):
        np.testing.assert_allclose(held.momentum[row], before, rtol=0, atol=1e-9 * size)
    for i in (1, 2):  # with the arm alone, and with the target in its hand
        run = flight.phases[i]
        t, places = replayed(run, tmp_path / f"{i}.xml")
        ours = np.array([run.at(float(s)).tip.translation for s in t])
        moved = np.abs(ours - ours[0]).max()
        assert moved > 1e-3
        np.testing.assert_allclose(places, ours, rtol=0, atol=1e-4 * moved)
