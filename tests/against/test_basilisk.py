"""What `to_mjcf` writes, flown by Basilisk: its MuJoCo scenes and its integrators."""

import warnings

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import spacearm as sa

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of SWIG
    pytest.importorskip("Basilisk", reason="pip install spacearm[basilisk]")
    from Basilisk.architecture import messaging
    from Basilisk.simulation import mujoco, svIntegrators
    from Basilisk.utilities import SimulationBaseClass, macros

DURATION = 1.0


def flown(path, arm, q0, tau):
    """Positions and velocities as MuJoCo orders them, and the tip's position and twist."""
    simulation = SimulationBaseClass.SimBaseClass()
    task = simulation.CreateNewTask("task", macros.sec2nano(1e-3))
    simulation.CreateNewProcess("process").addTask(task)
    scene = mujoco.MJScene.fromFile(str(path))
    scene.setIntegrator(svIntegrators.svIntegratorRK4(scene))
    simulation.AddModelToTask("task", scene)
    torques = [
        messaging.SingleActuatorMsg().write(messaging.SingleActuatorMsgPayload(input=float(x)))
        for x in tau
    ]
    for name, torque in zip(arm.joint_names, torques, strict=True):
        scene.getSingleActuator(name).actuatorInMsg.subscribeTo(torque)
    simulation.InitializeSimulation()
    for name, position in zip(arm.joint_names, q0, strict=True):
        body = scene.getBody(arm.tree.joints[name].child)
        body.getScalarJoint(name).setPosition(float(position))
    simulation.ConfigureStopTime(macros.sec2nano(DURATION))
    simulation.ExecuteSimulation()
    state, tip = scene.stateOutMsg.read(), scene.getSite(arm.tip).stateOutMsg.read()
    turn = Rotation.from_mrp(tip.sigma_BN)
    twist = np.append(tip.v_BN_N, turn.apply(tip.omega_BN_B))
    return np.ravel(state.qpos).copy(), np.ravel(state.qvel).copy(), np.array(tip.r_BN_N), twist


@pytest.mark.parametrize("name", ["planar2", "chaser7", "vispa"])
def test_the_same_motion_and_generalized_jacobian(name, tmp_path):
    bus = sa.Bus(mass=200, size=(1, 1, 1))
    arm = sa.mount("vispa", bus) if name == "vispa" else sa.load(name)
    q0 = np.linspace(0.5, -0.4, arm.n)
    tau = 0.3 * np.diag(sa.generalized_inertia(arm.at(q0)))
    qpos, qvel, tip, twist = flown(sa.to_mjcf(arm, tmp_path / "robot.xml"), arm, q0, tau)
    run = sa.simulate(
        arm.at(q0),
        lambda *_: tau,
        DURATION,
        integration=sa.Integration(rtol=1e-10, atol=1e-12, events=(), method="DOP853"),
    )
    x, y, z, w = run.base[-1, 3:] * np.sign(run.base[-1, 6] * qpos[3])
    np.testing.assert_allclose((*run.base[-1, :3], w, x, y, z, *run.q[-1]), qpos, atol=1e-9)
    np.testing.assert_allclose(run.dq[-1], qvel[6:], atol=1e-9)
    assert np.abs(run.q[-1] - q0).max() > 0.1
    base = pin.SE3(pin.Quaternion(*qpos[3:7]).toRotationMatrix(), qpos[:3])
    cfg = arm.at(qpos[7:], base=base)
    np.testing.assert_allclose(cfg.tip.translation, tip, atol=1e-13)
    np.testing.assert_allclose(sa.generalized_jacobian(cfg) @ qvel[6:], twist, atol=1e-12)
