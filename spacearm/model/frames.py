"""Frames: the frame in which twists are given, and the check of a pose."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import LARGEST, finite, plain, shape_of
from spacearm.errors import ConfigurationError

LWA = pin.LOCAL_WORLD_ALIGNED
"""Pinocchio's frame for twists and Jacobians: of the frame's origin, in inertial axes."""


PoseLike: TypeAlias = pin.SE3 | npt.ArrayLike
"""A pose as a caller may give it: a pin.SE3 or a (4, 4) homogeneous matrix."""


def sound_pose(pose: PoseLike, what: str) -> pin.SE3:
    """Return a checked copy of a pose, its rotation orthonormal to rounding.

    Args:
        pose: What was given.
        what: Name of the argument.

    Raises:
        ConfigurationError: It is neither pin.SE3 nor (4, 4), not finite, or has no rotation matrix.
    """
    if not isinstance(pose, pin.SE3):
        if shape_of(pose) != (4, 4):
            raise ConfigurationError(
                f"{what} is a {type(pose).__name__}; give it as pin.SE3(R, p) or as a (4, 4) matrix"
            )
        matrix = finite(pose, (4, 4), what, "[R, p; 0, 1]")
        if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
            raise ConfigurationError(
                f"{what} has the last row {matrix[3].tolist()}; a homogeneous matrix has 0 0 0 1"
            )
        pose = pin.SE3(matrix[:3, :3], matrix[:3, 3])
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


@plain.register(pin.SE3)
def _(pose: pin.SE3) -> list[float]:
    return pin.SE3ToXYZQUAT(pose).tolist()
