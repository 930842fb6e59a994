"""Frames: the frame in which twists are given, and the check of a pose."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from spacearm.arrays import LARGEST, plain
from spacearm.errors import ConfigurationError

LWA = pin.LOCAL_WORLD_ALIGNED
"""Pinocchio's frame for twists and Jacobians: of the frame's origin, in inertial axes."""


def sound_pose(pose: pin.SE3, what: str) -> pin.SE3:
    """Return a checked copy of a pose, its rotation orthonormal to rounding.

    Args:
        pose: What was given.
        what: Name of the argument.

    Raises:
        ConfigurationError: It is no pin.SE3, not finite, or has no rotation matrix.
    """
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


@plain.register(pin.SE3)
def _(pose: pin.SE3) -> list[float]:
    return pin.SE3ToXYZQUAT(pose).tolist()
