"""Configuration: one posture of an arm and one pose of its spacecraft, computed once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import LARGEST, Array
from spacearm.errors import ConfigurationError, unknown

if TYPE_CHECKING:
    from spacearm.arm import SpaceArm


LWA = pin.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True, eq=False, repr=False)
class Configuration:
    """A posture q and a spacecraft pose, with the two matrices that everything follows from.

    Made by `SpaceArm.at`; that it exists means that its kinematics have run. Nothing in it
    changes: arrays are read-only, `base` and `tip` are copies.

    The base columns of `A` and `J` act on the spacecraft's twist in spacecraft axes, as
    Pinocchio has them; products such as J_b A_b^-1 do not depend on that choice.
    `momentum_matrix` gives them for inertial axes.

    Attributes:
        arm: The arm.
        q: (n,) joint angles [rad] or displacements [m].
        com: (3,) system centre of mass in the inertial frame [m].
        A: (6, 6 + n) centroidal momentum matrix [A_b A_q], rows [linear; angular about the
            system CM], inertial axes.
        J: (6, 6 + n) Jacobian [J_b J_q] of the tip, rows [linear; angular], inertial axes.
    """

    arm: SpaceArm
    q: Array
    com: Array
    A: Array
    J: Array
    _base: pin.SE3
    _tip: pin.SE3

    @property
    def base(self) -> pin.SE3:
        """Pose of the spacecraft frame in the inertial frame."""
        return self._base.copy()

    @property
    def tip(self) -> pin.SE3:
        """Pose of the tip frame in the inertial frame."""
        return self._tip.copy()

    @property
    def full(self) -> Array:
        """(nq,) configuration of the Pinocchio model: [x y z, qx qy qz qw, joints]."""
        return np.concatenate((pin.SE3ToXYZQUAT(self._base), self.arm.all_joints(self.q)))

    @property
    def full_at_origin(self) -> Array:
        """(nq,) the same with the spacecraft at the origin, where no digits are lost to orbits."""
        full = self.full
        full[:3] = 0.0
        return full

    def centred(self, com: Array) -> Configuration:
        """The same posture and attitude, the spacecraft placed so that the system CM is at com."""
        by = com - self.com
        poses = pin.SE3(self._base), pin.SE3(self._tip)
        for pose in poses:
            pose.translation += by
        return replace(self, com=self.com + by, _base=poses[0], _tip=poses[1])

    def __repr__(self) -> str:
        base = np.array2string(pin.SE3ToXYZQUAT(self.base), precision=6, separator=", ")
        q = np.array2string(self.q, precision=6, separator=", ")
        return f"Configuration({self.arm.name}, q={q}, base(xyz, xyzw)={base})"


def configure(arm: SpaceArm, q: npt.ArrayLike, base: pin.SE3 | None) -> Configuration:
    """The configuration of `arm` at q with the spacecraft at `base`, both checked."""
    base = pin.SE3.Identity() if base is None else sound_pose(base, "base")
    return kinematics(arm, joint_vector(arm, q, "q"), base)


def kinematics(arm: SpaceArm, q: Array, base: pin.SE3) -> Configuration:
    """The configuration at (n,) numbers and a pose that are known to be sound, which it keeps."""
    model, frame = arm.model, arm.tip_frame
    full = np.zeros(model.nq)  # at the origin: far from it, as in orbit, digits would be lost
    full[3:7] = pin.SE3ToXYZQUAT(base)[3:]
    full[7:] = arm.all_joints(q)

    data = arm.borrow()
    A = arm.project(pin.computeCentroidalMap(model, data, full))
    J = arm.project(pin.computeFrameJacobian(model, data, full, frame, LWA))
    com = data.com[0] + base.translation
    tip = pin.updateFramePlacement(model, data, frame).copy()
    tip.translation += base.translation
    arm.give_back(data)

    for array in (q, com, A, J):
        array.flags.writeable = False
    return Configuration(arm, q, com, A, J, base, tip)


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
    sound = np.abs(vector) <= LARGEST
    if not sound.all():
        worst = int(np.flatnonzero(~sound)[0])
        raise ConfigurationError(
            f"{what} of joint {arm.joint_names[worst]!r} is {vector[worst]:g}; give a finite "
            f"number up to {LARGEST:g}"
        )
    return vector


def joint_name(arm: SpaceArm, text: str) -> str:
    """A joint by its name, or by its number as q1, q2, ..."""
    numbers = {f"q{i}": name for i, name in enumerate(arm.joint_names, start=1)}
    if text in arm.joint_names:
        return text
    if text not in numbers:
        raise ConfigurationError(unknown("joint", text, [*arm.joint_names, *numbers]))
    return numbers[text]


def sound_pose(pose: pin.SE3, what: str) -> pin.SE3:
    """A checked copy of a pose, its rotation orthonormal to rounding."""
    if not isinstance(pose, pin.SE3):
        raise ConfigurationError(f"{what} is a {type(pose).__name__}; give it as pin.SE3(R, p)")
    R, p = pose.rotation, pose.translation
    if not (np.isfinite(R).all() and np.abs(p).max() <= LARGEST):
        raise ConfigurationError(
            f"{what} holds NaN, infinity or a position over {LARGEST:g} m; give a finite pose"
        )
    if np.abs(R.T @ R - np.eye(3)).max() > 1e-9 or np.linalg.det(R) < 0.0:
        raise ConfigurationError(
            f"{what}.rotation is not a rotation matrix (R^T R = 1, det R = 1, to 1e-9); "
            "build it from a unit quaternion or with pin.rpy.rpyToMatrix"
        )
    return pin.SE3(pin.Quaternion(R).normalized(), p)
