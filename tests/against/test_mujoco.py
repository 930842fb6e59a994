"""Against MuJoCo, where it is installed: a free joint, no gravity, small steps."""

from pathlib import Path

import numpy as np
import pytest

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
