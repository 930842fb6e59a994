"""Frames: the frame in which twists are given; poses, made and checked."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import LARGEST, Array, ArrayLike, finite, plain, shape_of
from spacearm.errors import ConfigurationError, type_of
from spacearm.results import Cell, Measure
from spacearm.signatures import checked

#: Pinocchio's frame for twists and Jacobians: of the frame's origin, in inertial axes.
LWA = pin.LOCAL_WORLD_ALIGNED


#: A pose as a caller may give it: a pin.SE3 or a (4, 4) homogeneous matrix.
PoseLike: TypeAlias = pin.SE3 | ArrayLike


@checked
def pose(xyz: ArrayLike = (0.0, 0.0, 0.0), rpy: ArrayLike = (0.0, 0.0, 0.0)) -> pin.SE3:
    """Make a pose of a position and of roll, pitch and yaw, as the origins of a URDF have them.

    Args:
        xyz: (3,) position [m].
        rpy: (3,) turns about the fixed axes x, then y, then z [rad].

    Returns:
        The pose, which all arguments that are poses take.

    Raises:
        ConfigurationError: xyz or rpy is not three finite numbers.

    Example:
        >>> import spacearm as sa
        >>> side = sa.pose(xyz=(0.5, 0, 0), rpy=(0, 1.5708, 0))
        >>> arm = sa.mount("vispa", sa.Bus(mass=200, size=(1, 1, 1)), side)
        >>> float(arm.mount.translation[0].round(3))
        0.68
    """
    turns = finite(rpy, (3,), "rpy", "roll, pitch, yaw [rad]")
    return pin.SE3(pin.rpy.rpyToMatrix(turns), finite(xyz, (3,), "xyz", "x, y, z [m]"))


def pose_facts(pose: pin.SE3, what: str = "place") -> dict[str, Cell]:
    """Return a pose as two facts for a table of a result."""
    rpy = pin.rpy.matrixToRpy(pose.rotation)
    return {what: Measure(pose.translation, "m"), "roll, pitch, yaw": Measure(rpy, "rad")}


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
                f"{what} is {type_of(pose)}; give it as "
                "sa.pose(xyz=..., rpy=...), as pin.SE3(R, p) or as a (4, 4) matrix"
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


def evenly_spread(m: int) -> Array:
    """Return unit vectors (m, 3), evenly spread by the golden angle."""
    z = 1.0 - (2.0 * np.arange(m) + 1.0) / m
    around = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(m)
    r = np.sqrt(1.0 - z * z)
    return np.stack((r * np.cos(around), r * np.sin(around), z), axis=1)


def pose_between(begin: pin.SE3, end: pin.SE3, start: Array, stop: Array, s: float) -> pin.SE3:
    """Return the pose at s of 0 to 1 on a cubic curve through two poses with given twists.

    The position is a cubic Hermite curve. The rotation is begin exp(phi(s)) with phi a cubic
    Hermite curve of rotation vectors; its slope at the end follows from the inverse of the right
    Jacobian of the rotation group.

    Args:
        begin: The pose at 0.
        end: The pose at 1.
        start: (6,) twist [linear; angular] at 0 by s, inertial axes.
        stop: (6,) twist at 1.
        s: Where.
    """
    from scipy.interpolate import CubicHermiteSpline  # slow to import

    turned = begin.rotation.T @ end.rotation
    slopes = (begin.rotation.T @ start[3:], pin.Jlog3(turned) @ (end.rotation.T @ stop[3:]))
    ends = np.array([begin.translation, end.translation])
    place = CubicHermiteSpline([0.0, 1.0], ends, [start[:3], stop[:3]])
    vectors = np.array([np.zeros(3), pin.log3(turned)])
    phi = CubicHermiteSpline([0.0, 1.0], vectors, slopes)
    return pin.SE3(begin.rotation @ pin.exp3(phi(s)), place(s))
