"""Configuration: one posture of an arm and one pose of its spacecraft, computed once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError

if TYPE_CHECKING:
    from spacearm.arm import SpaceArm


LWA = pin.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True, eq=False, repr=False)
class Configuration:
    """A posture q and a spacecraft pose, with the two matrices that everything follows from.

    Made by `SpaceArm.at`; that it exists means that its kinematics have run. Nothing in it
    changes: q and the matrices are read-only copies.

    The base columns of `A` and `J` act on the spacecraft's twist in spacecraft axes, as
    Pinocchio has them; products such as J_b A_b^-1 do not depend on that choice.
    `momentum_matrix` gives them for inertial axes.

    Attributes:
        arm: The arm.
        q: (n,) joint angles [rad] or displacements [m].
        base: Pose of the spacecraft frame in the inertial frame.
        tip: Pose of the tip frame in the inertial frame.
        com: (3,) system centre of mass in the inertial frame [m].
        A: (6, 6 + n) centroidal momentum matrix [A_b A_q], rows [linear; angular about the
            system CM], inertial axes.
        J: (6, 6 + n) Jacobian [J_b J_q] of the tip, rows [linear; angular], inertial axes.
    """

    arm: SpaceArm
    q: Array
    base: pin.SE3
    tip: pin.SE3
    com: Array
    A: Array
    J: Array

    @property
    def full(self) -> Array:
        """(nq,) configuration of the Pinocchio model: [x y z, qx qy qz qw, joints]."""
        return np.concatenate((pin.SE3ToXYZQUAT(self.base), self.arm.all_joints(self.q)))

    def __repr__(self) -> str:
        base = np.array2string(pin.SE3ToXYZQUAT(self.base), precision=6, separator=", ")
        q = np.array2string(self.q, precision=6, separator=", ")
        return f"Configuration({self.arm.name}, q={q}, base(xyz, xyzw)={base})"


def configure(arm: SpaceArm, q: npt.ArrayLike, base: pin.SE3 | None) -> Configuration:
    """Runs the kinematics of `arm` at q with the spacecraft at `base`."""
    q = joint_vector(arm, q, "q")
    base = pin.SE3.Identity() if base is None else _sound_pose(base)
    model, frame = arm.model, arm.tip_frame
    full = np.empty(model.nq)
    full[:7] = pin.SE3ToXYZQUAT(base)
    full[7:] = arm.all_joints(q)

    data = arm.borrow()
    A = arm.project(pin.computeCentroidalMap(model, data, full))
    J = arm.project(pin.computeFrameJacobian(model, data, full, frame, LWA))
    com = np.array(data.com[0])
    tip = pin.updateFramePlacement(model, data, frame).copy()
    arm.give_back(data)

    for array in (q, com, A, J):
        array.flags.writeable = False
    return Configuration(arm, q, base, tip, com, A, J)


def joint_vector(arm: SpaceArm, values: npt.ArrayLike, what: str) -> Array:
    """A checked copy of one finite number per movable joint, (n,)."""
    try:
        vector = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"{what} must be {arm.n} numbers: {error}") from None
    if vector.shape != (arm.n,):
        raise ConfigurationError(
            f"{what} has shape {vector.shape}; {arm.name} needs ({arm.n},), one number for each "
            f"of: {', '.join(arm.joint_names)}"
        )
    if not np.isfinite(vector).all():
        worst = int(np.flatnonzero(~np.isfinite(vector))[0])
        raise ConfigurationError(
            f"{what} of joint {arm.joint_names[worst]!r} is {vector[worst]}; give a finite number"
        )
    return vector


def _sound_pose(base: pin.SE3) -> pin.SE3:
    if not isinstance(base, pin.SE3):
        raise ConfigurationError(
            f"base is a {type(base).__name__}; give the spacecraft pose as pin.SE3(R, p)"
        )
    R, p = base.rotation, base.translation
    if not (np.isfinite(R).all() and np.isfinite(p).all()):
        raise ConfigurationError("base holds NaN or infinity; give a finite rotation and position")
    if np.abs(R.T @ R - np.eye(3)).max() > 1e-9 or np.linalg.det(R) < 0.0:
        raise ConfigurationError(
            "base.rotation is not a rotation matrix (R^T R = 1, det R = 1, to 1e-9); "
            "build it from a unit quaternion or with pin.rpy.rpyToMatrix"
        )
    return pin.SE3(pin.Quaternion(R).normalized(), p)
