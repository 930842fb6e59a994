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


@pytest.mark.parametrize(("name", "size"), [("planar2", 1.0), ("chaser7", 4.0)])
def test_ten_seconds_of_the_same_motion(name, size):
    arm = sa.load(name)
    n, q0 = arm.n, np.linspace(0.5, -0.4, arm.n)
    run = sa.simulate(
        arm, q0, lambda t, *_: torque(t, n, size), 10.0, rtol=1e-10, atol=1e-12, events=(),
        method="DOP853",
    )  # fmt: skip
    ends = []
    for step in (4e-3, 2e-3):
        model, data = engine(arm, step)
        data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
        data.qpos[7:] = q0

        def push(_, data):
            data.qfrc_applied[6:] = torque(data.time, n, size)

        mujoco.set_mjcb_control(push)
        try:
            for _ in range(round(10.0 / step)):
                mujoco.mj_step(model, data)
        finally:
            mujoco.set_mjcb_control(None)
        mujoco.mj_normalizeQuat(model, data.qpos)
        ends.append(np.concatenate((data.qpos, data.qvel[6:])))
    own_accuracy = np.abs(ends[1] - ends[0]).max()
    x, y, z, w = run.base[-1, 3:] * np.sign(run.base[-1, 6] * ends[1][3])
    ours = np.concatenate((run.base[-1, :3], (w, x, y, z), run.q[-1], run.dq[-1]))
    assert np.abs(run.q[-1] - q0).max() > 0.5
    assert own_accuracy < 1e-6
    np.testing.assert_allclose(ours, ends[1], atol=own_accuracy)
