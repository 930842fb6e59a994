"""Plan: a joint motion that arrives, with what was tried before it."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, Result
from spacearm.errors import UnsupportedError
from spacearm.files import write
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.polynomial.certificate import Certificate
from spacearm.singularities.report import singular_values
from spacearm.singularities.sets import singular_set

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNLIMITED = 0.5
"""Rate of joints whose URDF gives no velocity limit [rad/s] or [m/s]."""
PEAK = 1.875
"""Largest rate of a motion from rest to rest along 10 u^3 - 15 u^4 + 6 u^5, over its mean."""
CORNER = 0.3
"""Rows between which the direction changes by more than this are a corner [rad]."""


@dataclass(frozen=True)
class Joints:
    """A goal in joint space.

    Attributes:
        q: (n,) joint positions [rad] or [m].
    """

    q: npt.ArrayLike


class Attempt(NamedTuple):
    """One method and what came of it.

    Attributes:
        method: Its name.
        arrived: Whether it gave the plan.
        story: What it cost, or where and why it failed.
    """

    method: str
    arrived: bool
    story: str


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Result):
    """A motion from rest to rest at zero momentum, straight in joint space between its rows.

    Attributes:
        arm: The arm.
        method: The method that found it.
        t: (m,) times [s]; the joint rates stay within the URDF's velocity limits.
        q: (m, n) joint positions [rad] or [m].
        base: (m, 7) poses of the spacecraft: position [m], quaternion xyzw, inertial frame.
        tip: (m, 7) poses of the tip, likewise.
        sigma_min: (m,) least singular value of the task Jacobian.
        clearance: Least sigma_min that was asked for.
        certificate: For square tasks of revolute joints the proof that no singularity is met;
            None for others.
        apart: Whether it is proven that no bodies meet; None if the URDF has no collision geometry
            or collisions did not matter.
        length: Joint travel, the sum over all joints [rad] or [m].
        tried: All methods that were tried, in order.
    """

    arm: SpaceArm
    method: str
    t: Array
    q: Array
    base: Array
    tip: Array
    sigma_min: Array
    clearance: float
    certificate: Certificate | None
    apart: bool | None
    length: float
    tried: tuple[Attempt, ...]

    @classmethod
    def of(
        cls,
        method: str,
        motion: Sequence[Configuration],
        clearance: float,
        tried: Sequence[Attempt],
        apart: bool | None,
    ) -> Plan:
        """From the configurations along it."""
        arm = motion[0].arm
        q = np.array([cfg.q for cfg in motion])
        return cls(
            arm=arm,
            method=method,
            t=times(arm, q),
            q=q,
            base=np.array([pin.SE3ToXYZQUAT(cfg.base) for cfg in motion]),
            tip=np.array([pin.SE3ToXYZQUAT(cfg.tip) for cfg in motion]),
            sigma_min=np.array([singular_values(cfg)[-1] for cfg in motion]),
            clearance=clearance,
            certificate=certified(arm, q),
            apart=apart,
            length=float(np.abs(np.diff(q, axis=0)).sum()),
            tried=tuple(tried),
        )

    def plot(self, target: npt.ArrayLike | None = None) -> Figure:
        """Tip path, attitude, joints and sigma_min, a matplotlib figure.

        Args:
            target: (3,) a point to mark on the tip path [m], or (2,) in the plane of a planar arm.
        """
        from spacearm.plots.motions import draw_motion  # imports matplotlib

        return draw_motion(self, target)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes t, q, base, tip and sigma_min to a NumPy file."""
        buffer = io.BytesIO()
        names = ("t", "q", "base", "tip", "sigma_min")
        arrays = {name: getattr(self, name) for name in names}
        joints = np.array(self.arm.joint_names)
        np.savez(buffer, allow_pickle=False, joints=joints, method=np.array(self.method), **arrays)
        write(Path(path), buffer.getvalue())

    def at(self, index: int) -> Configuration:
        """The configuration of one row."""
        return self.arm.at(self.q[index], base=pin.XYZQUATToSE3(self.base[index]))

    def __repr__(self) -> str:
        return (
            f"Plan({self.arm.name}, {self.method}: joint travel {self.length:.4g}, "
            f"{self.t[-1]:.4g} s, sigma_min at least {self.sigma_min.min():.3g}, "
            f"{len(self.t)} rows)"
        )


def times(arm: SpaceArm, q: Array) -> Array:
    """(m,) times at which a motion from rest to rest passes its rows (m, n) [s].

    The slowest joint sets the pace of every segment; the joints come to rest at corners too.
    """
    joints = [arm.tree.joints[name] for name in list(arm.model.names)[2:]]  # those that mimic too
    velocity = np.array([joint.velocity for joint in joints])
    velocity = np.where(np.isfinite(velocity) & (velocity > 0.0), velocity, UNLIMITED)
    step = np.diff([arm.all_joints(row) for row in q], axis=0)
    pace = np.maximum((np.abs(step) / velocity).max(axis=1), 1e-12)
    along = np.append(0.0, np.cumsum(pace))
    way = step / np.maximum(np.linalg.norm(step, axis=1), 1e-300)[:, None]
    corner = np.linalg.norm(np.diff(way, axis=0), axis=1) > CORNER
    t = np.zeros(len(q))
    for first, last in pairwise((0, *(np.flatnonzero(corner) + 1), len(q) - 1)):
        piece = along[first : last + 1] - along[first]
        t[first : last + 1] = t[first] + PEAK * piece[-1] * _eased(piece / max(piece[-1], 1e-12))
    return t


def _eased(share: Array) -> Array:
    """(m,) times, from 0 to 1, at which a motion from rest to rest has gone these shares."""
    u = np.linspace(0.0, 1.0, 2001)
    return np.interp(share, u**3 * (10.0 - 15.0 * u + 6.0 * u * u), u)


def certified(arm: SpaceArm, q: Array) -> Certificate | None:
    """The proof that straight segments through the rows (m, n) meet no singularity."""
    try:
        found = singular_set(arm)
    except UnsupportedError:
        return None
    return found.clearance(q) if found.complete else None
