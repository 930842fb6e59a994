"""What each engine means by its numbers, and how they become spacearm's.

==========  ============================  ========================  ===============================
engine      velocity of the spacecraft    of which point            attitude
==========  ============================  ========================  ===============================
spacearm    [linear; angular], inertial   origin of its frame       pin.SE3; xyzw
MuJoCo      [linear inertial; angular     origin of its frame       wxyz
            in spacecraft axes]
Drake       [angular; linear], inertial   origin of its frame       wxyz
iDynTree    [linear; angular], inertial   origin of its frame       4 x 4 matrix
            (MIXED_REPRESENTATION)
DART        [angular; linear], inertial   origin of its frame       4 x 4 matrix
SPART       [angular in spacecraft axes;  CM of the spacecraft      3 x 3
            linear inertial]
==========  ============================  ========================  ===============================

Velocities of engines are v' = T v with v spacearm's, (6 + n,) [linear; angular; joint rates]; then
M = T^T M' T, J = J' T, h = h', and accelerations, which the engines give as the time derivatives of
their velocities, are turned back by the blocks of T that do not depend on time. All are asked
about the same URDF, written from the arm without what is drawn, SPART about one with links that are
fixed to each other merged, as DART does. Joints are matched by name. The [angular; linear] order
of DART and SPART holds for their Jacobians too. MuJoCo, Drake, DART (by articulated bodies) and
SPART solve for the accelerations themselves; of iDynTree the equations of motion that it gives are
solved.
"""

from __future__ import annotations

import ctypes
import importlib
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from lxml import etree
from lxml.builder import E

import spacearm as sa
from spacearm.description.bodies import Inertial, Joint
from spacearm.description.tree import Tree
from spacearm.description.urdf_writer import document
from spacearm.mechanics.dynamics import mass_matrix


class State(NamedTuple):
    """What everybody is asked about: spacearm's configuration, velocity (6 + n,) and torques."""

    cfg: sa.Configuration
    v: np.ndarray
    tau: np.ndarray


class Answers(NamedTuple):
    """In spacearm's conventions; accelerations [of the origin; angular; of the joints]."""

    mass_matrix: np.ndarray
    momentum: np.ndarray
    com: np.ndarray
    tip: np.ndarray
    jacobian: np.ndarray
    generalized_jacobian: np.ndarray
    acceleration: np.ndarray


def urdf(arm: sa.SpaceArm) -> str:
    """The arm's URDF without what is drawn and without friction, which is no part of J* or tau."""
    robot = etree.fromstring(document(replace(arm.tree, visuals={}), arm.tips))
    etree.strip_elements(robot, "dynamics")
    return etree.tostring(robot).decode()


def floating(M, J):
    """J* = J_q - J_b M_bb^-1 M_bq: any mass matrix has the momentum matrix in its first rows."""
    return J[:, 6:] - J[:, :6] @ np.linalg.solve(M[:6, :6], M[:6, 6:])


class Spacearm:
    def __call__(self, state):
        cfg, v, tau = state
        T = spacecraft_axes(cfg)
        A = sa.momentum_matrix(cfg)
        h = A.A_b @ v[:6] + A.A_q @ v[6:]
        motion = sa.forward_dynamics(cfg.with_momentum(h), v[6:], tau)
        tip, J = cfg.tip, cfg.J @ T
        M = T.T @ mass_matrix(cfg) @ T
        J_star = sa.generalized_jacobian(cfg)
        acceleration = np.concatenate((motion.base_acceleration, motion.ddq))
        return Answers(M, h, cfg.com, tip.translation, J, J_star, acceleration)


def spacecraft_axes(cfg, linear=True):
    """T that turns the angular and, if asked to, the linear velocity into spacecraft axes."""
    T = np.eye(6 + cfg.arm.n)
    T[3:6, 3:6] = cfg.base.rotation.T
    if linear:
        T[:3, :3] = cfg.base.rotation.T
    return T


class MuJoCo:
    def __init__(self, arm):
        self.mujoco = mujoco = importlib.import_module("mujoco")
        options = E.mujoco(E.compiler(fusestatic="false"))
        robot = etree.fromstring(urdf(arm).encode())
        robot.append(options)
        spec = mujoco.MjSpec.from_string(etree.tostring(robot, encoding="unicode"))
        spec.worldbody.first_body().add_freejoint()
        spec.option.gravity[:] = 0.0
        for flag in ("LIMIT", "CONTACT"):
            spec.option.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}")
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in arm.joint_names]
        self.q = [int(joint.qposadr[0]) for joint in joints]
        self.v = [*range(6), *(int(joint.dofadr[0]) for joint in joints)]

    def __call__(self, state):
        mujoco, model, data = self.mujoco, self.model, self.data
        cfg, v, tau = state
        T = spacecraft_axes(cfg, linear=False)
        x, y, z, w = pin.SE3ToXYZQUAT(cfg.base)[3:]
        data.qpos[:7] = *cfg.base.translation, w, x, y, z
        data.qpos[self.q] = cfg.q
        data.qvel[self.v] = T @ v
        data.qfrc_applied[self.v[6:]] = tau
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        M = np.empty((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        J = np.empty((6, model.nv))
        tip = data.body(cfg.arm.tip)
        mujoco.mj_jac(model, data, J[:3], J[3:], tip.xpos, tip.id)
        M, J = T.T @ M[np.ix_(self.v, self.v)] @ T, J[:, self.v] @ T
        root = model.body(model.jnt_bodyid[0]).id
        linear = data.subtree_linvel[root] * model.body_subtreemass[root]
        h = np.concatenate((linear, data.subtree_angmom[root]))
        acceleration = T.T @ data.qacc[self.v]
        com = data.subtree_com[root].copy()
        return Answers(M, h, com, tip.xpos.copy(), J, floating(M, J), acceleration)


class Drake:
    def __init__(self, arm):
        plant_module = importlib.import_module("pydrake.multibody.plant")
        parsing = importlib.import_module("pydrake.multibody.parsing")
        self.tree = importlib.import_module("pydrake.multibody.tree")
        self.math = importlib.import_module("pydrake.math")
        self.plant = plant = plant_module.MultibodyPlant(time_step=0.0)
        parsing.Parser(plant).AddModelsFromString(urdf(arm), "urdf")
        plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        plant.Finalize()
        (self.spacecraft,) = (plant.get_body(i) for i in plant.GetFloatingBaseBodies())
        start = self.spacecraft.floating_velocities_start_in_v()
        joints = [plant.GetJointByName(name) for name in arm.joint_names]
        self.q = [joint.position_start() for joint in joints]
        own = [joint.velocity_start() for joint in joints]
        self.v = [*range(start + 3, start + 6), *range(start, start + 3), *own]
        self.tip = plant.GetFrameByName(arm.tip)

    def __call__(self, state):
        plant, (cfg, v, tau) = self.plant, state
        context = plant.CreateDefaultContext()
        pose = self.math.RigidTransform(cfg.base.homogeneous)
        q, (rates, forces) = plant.GetPositions(context), np.zeros((2, len(v)))
        q[self.q], rates[self.v], forces[self.v[6:]] = cfg.q, v, tau
        plant.SetPositions(context, q)
        plant.SetFreeBodyPose(context, self.spacecraft, pose)
        plant.SetVelocities(context, rates)
        plant.get_applied_generalized_force_input_port().FixValue(context, forces)
        M = plant.CalcMassMatrix(context)[np.ix_(self.v, self.v)]
        world, kV = plant.world_frame(), self.tree.JacobianWrtVariable.kV
        arguments = (context, kV, self.tip, np.zeros(3), world, world)
        J = plant.CalcJacobianSpatialVelocity(*arguments)[:, self.v]
        J = np.vstack((J[3:], J[:3]))
        com = plant.CalcCenterOfMassPositionInWorld(context)
        h = plant.CalcSpatialMomentumInWorldAboutPoint(context, com)
        h = np.concatenate((h.translational(), h.rotational()))
        rate = plant.EvalTimeDerivatives(context).CopyToVector()[-len(v) :]
        tip = self.tip.CalcPoseInWorld(context).translation()
        return Answers(M, h, com, tip, J, floating(M, J), rate[self.v])


class IDynTree:
    def __init__(self, arm):
        self.idyntree = idyntree = importlib.import_module("idyntree.bindings")
        loader = idyntree.ModelLoader()
        if not loader.loadReducedModelFromString(urdf(arm), list(arm.joint_names), "urdf"):
            raise ValueError(f"iDynTree cannot read {arm.name}")
        self.engine = idyntree.KinDynComputations()
        if not self.engine.loadRobotModel(loader.model()):
            raise ValueError(f"iDynTree cannot use {arm.name}")
        self.engine.setFrameVelocityRepresentation(idyntree.MIXED_REPRESENTATION)

    def __call__(self, state):
        engine, n, (cfg, v, tau) = self.engine, state.cfg.arm.n, state
        engine.setRobotState(cfg.base.homogeneous, cfg.q, v[:6], v[6:], np.zeros(3))
        M, J = self.idyntree.MatrixDynSize(6 + n, 6 + n), self.idyntree.MatrixDynSize(6, 6 + n)
        engine.getFreeFloatingMassMatrix(M)
        engine.getFrameFreeFloatingJacobian(cfg.arm.tip, J)
        bias = self.idyntree.FreeFloatingGeneralizedTorques(engine.model())
        engine.generalizedBiasForces(bias)
        wrench, momentum = bias.baseWrench(), engine.getCentroidalTotalMomentum()
        com, tip = engine.getCenterOfMassPosition(), engine.getWorldTransform(cfg.arm.tip)
        c = np.append(numbers(wrench.asVector()), numbers(bias.jointTorques()))
        M, J, h = numbers(M), numbers(J), numbers(momentum.asVector())
        acceleration = np.linalg.solve(M, np.append(np.zeros(6), tau) - c)
        position = numbers(tip.getPosition())
        return Answers(M, h, numbers(com), position, J, floating(M, J), acceleration)


def numbers(values):
    """A copy: iDynTree's arrays are gone with their owners."""
    return np.array(values.toNumPy())


class DART:
    """dartpy, the engine that Gazebo runs.

    It takes links without <inertial> for bodies of a kilogram: links that are fixed to each other
    are one link, and the tip is a point of it.
    """

    def __init__(self, arm):
        loader = importlib.import_module("dartpy.utils").DartLoader()
        tree = merged(arm)
        hand = tree.joints["hand"]
        links = {name: body for name, body in tree.links.items() if name != arm.tip}
        joints = {name: joint for name, joint in tree.joints.items() if name != "hand"}
        text = document(replace(tree, links=links, joints=joints), ()).decode()
        self.ask(loader.parseSkeletonString(text, ""), arm, hand.parent, hand.origin)

    def ask(self, robot, arm, last, tip):
        """Be about a skeleton, whose body `last` carries the tip of the arm at a pose."""
        self.robot, self.tip = robot, tip.translation
        robot.setGravity(np.zeros(3))
        self.free, self.last = robot.getRootJoint(), robot.getBodyNode(last)
        self.joints = [robot.getJoint(name) for name in arm.joint_names]
        order = [self.free.getIndexInSkeleton(i) for i in (3, 4, 5, 0, 1, 2)]
        self.v = [*order, *(joint.getIndexInSkeleton(0) for joint in self.joints)]

    def __call__(self, state):
        robot, (cfg, v, tau) = self.robot, state
        pose = importlib.import_module("dartpy.math").Isometry3(cfg.base.homogeneous)
        self.free.setPositions(self.free.convertToPositions(pose))
        for joint, position in zip(self.joints, cfg.q, strict=True):
            joint.setPosition(0, position)
        rates, forces = np.zeros((2, len(v)))
        rates[self.v], forces[self.v[6:]] = v, tau
        robot.setVelocities(rates)
        robot.setForces(forces)
        robot.computeForwardDynamics()
        M = robot.getMassMatrix()[np.ix_(self.v, self.v)]
        angular, linear = np.split(robot.getWorldJacobian(self.last, self.tip), 2)
        J = np.vstack((linear, angular))[:, self.v]
        com, h = robot.getCOM(), np.zeros(6)
        for body in robot.getBodyNodes():
            R, mass = body.getWorldTransform().rotation(), body.getMass()
            at, velocity = body.getCOM() - com, body.getCOMLinearVelocity()
            spin = R @ body.getInertia().getMoment() @ R.T @ body.getAngularVelocity()
            h += [*(mass * velocity), *(spin + mass * np.cross(at, velocity))]
        last = self.last.getWorldTransform()
        tip = last.translation() + last.rotation() @ self.tip
        return Answers(M, h, com, tip, J, floating(M, J), robot.getAccelerations()[self.v])


class SPART:
    """spartpy, for arms without branches; links that are fixed to each other are one link.

    It has no mass matrix: that is put together of its twists. What it does with branches and with
    fixed links is shown in test_spart.py.
    """

    def __init__(self, arm):
        assert not branches(arm)
        text = document(merged(arm), (arm.tip,)).decode()
        self.model = spart_model(text)
        self.lever = arm.model.inertias[1].lever

    def __call__(self, state):
        model, robot, (cfg, v, tau) = self.model, self.model.robot, state
        n, R = cfg.arm.n, cfg.base.rotation
        lever = R @ self.lever
        r = cfg.base.translation + lever
        T = np.eye(6 + n)
        T[:6, :6] = np.block([[np.zeros((3, 3)), R.T], [np.eye(3), -pin.skew(lever)]])
        u = T @ v
        _, RL, _, rL, e, g = model.kinematics(R, r, cfg.q)
        Bij, Bi0, P0, pm = model.diff_kinematics(R, r, rL, e, g)
        t0, tL = model.velocities(Bij, Bi0, P0, pm, u[:6], u[6:])
        I0, Im = model.i_i(R, RL)

        m = np.array([robot.base_link_mass, *(link.mass for link in robot.links)])
        I = np.array([I0, *Im])
        positions, twists = np.column_stack((r, rL)), np.column_stack((t0, tL))
        com = positions @ m / m.sum()
        orbits = np.cross((positions - com[:, None]).T, (twists[3:] * m).T)
        spins = np.einsum("kab,bk->ka", I, twists[:3])
        h = np.concatenate((twists[3:] @ m, (spins + orbits).sum(axis=0)))
        J = np.zeros((len(m), 6, 6 + n))  # of all bodies, the tip the last
        J[0, :, :6], J[1:, :, :6] = P0, Bi0 @ P0
        J[1:, :, 6:] = np.einsum("ijab,bj->iaj", Bij, pm)[:, :, :n]
        heavy = np.zeros((len(m), 6, 6))
        heavy[:, :3, :3], heavy[:, 3:, 3:] = I, np.multiply.outer(m, np.eye(3))
        M = T.T @ np.einsum("kab,kac,kcd->bd", J, heavy, J) @ T
        J_tip = J[-1] @ T
        J_tip = np.vstack((J_tip[3:], J_tip[:3]))

        none = np.zeros((6, n + 1))
        frames, bodies = (t0, tL, P0, pm), (I0, Im, Bij, Bi0)
        du, ddq = model.forward_dynamics(
            none[:, 0], tau, none[:, 0], none, *frames, *bodies, u[:6], u[6:]
        )
        w, dw = v[3:6], R @ du[:3]
        dv = du[3:] - np.cross(dw, lever) - np.cross(w, np.cross(w, lever))
        acceleration = np.concatenate((dv, dw, ddq))
        return Answers(M, h, com, rL[:, -1], J_tip, floating(M, J_tip), acceleration)


def branches(arm) -> bool:
    """Whether some link carries several joints."""
    parents = list(arm.model.parents[2:])
    return len(parents) != len(set(parents))


def spart_model(text):
    """SPARTpy.SPART of a URDF."""
    runtime = Path(sys.prefix) / "lib" / "libiomp5.so"  # where intel-openmp puts it
    if runtime.exists():
        ctypes.CDLL(str(runtime), mode=ctypes.RTLD_GLOBAL)
    spartpy = importlib.import_module("SPARTpy")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(with_inertials(text), encoding="utf-8")
        return spartpy.SPART(str(path))


def with_inertials(text):
    """spartpy wants an <inertial> in every link: zeros where there is none."""
    robot = etree.fromstring(text.encode())
    zeros = {f"i{entry}": "0" for entry in ("xx", "xy", "xz", "yy", "yz", "zz")}
    for link in robot.iter("link"):
        if link.find("inertial") is None:
            link.append(E.inertial(E.mass(value="0"), E.inertia(**zeros)))
    return etree.tostring(robot, encoding="unicode")


def merged(arm) -> Tree:
    """The arm with one link for every joint, and a frame at the tip."""
    model, tip = arm.model, arm.model.frames[arm.tip_frame]
    names = ["", "spacecraft", *(f"behind {name}" for name in arm.joint_names)]
    links: dict[str, Inertial | None] = {
        name: Inertial(body.mass, pin.SE3(np.eye(3), body.lever), body.inertia)
        for name, body in zip(names[1:], model.inertias[1:], strict=True)
    }
    joints = {
        name: replace(
            arm.tree.joints[name],
            parent=names[model.parents[j]],
            child=names[j],
            origin=model.jointPlacements[j],
            damping=0.0,
            friction=0.0,
        )
        for j, name in enumerate(arm.joint_names, start=2)
    }
    hand = Joint("hand", "fixed", names[tip.parentJoint], arm.tip, tip.placement, np.eye(3)[0])
    return Tree(arm.name, "spacecraft", links | {arm.tip: None}, joints | {"hand": hand})


ENGINES = {"MuJoCo": MuJoCo, "Drake": Drake, "iDynTree": IDynTree, "DART": DART, "SPART": SPART}
"""By the name of their conventions above."""

MODULES = {
    "MuJoCo": "mujoco",
    "Drake": "pydrake",
    "iDynTree": "idyntree",
    "DART": "dartpy",
    "SPART": "SPARTpy",
}
DISTRIBUTIONS = MODULES | {"Drake": "drake", "SPART": "spartpy"}
