"""Following: the tip led along a path by J*, until it arrives or a singularity stops it.

With the path x(s), s its length, the joints move as J* dq = x' ds (equation (1)). Where J* is
singular and x' points in the lost direction, q(s) turns back like a square root and has no
derivative; as a curve in (q, s) it is smooth there. It is therefore integrated over its own length:
(dq, ds) is the unit vector with J* dq - x' ds = 0, and the singularity is the point where ds = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.integrate import DOP853, OdeSolver

from spacearm.arrays import Array, Result
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.dynamics import spacecraft_twist
from spacearm.mechanics.floating import quaternion_rate
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration, kinematics
from spacearm.model.mode import BaseMode
from spacearm.motion.events import NEAR, Lookout, Watch
from spacearm.motion.events import limits as joint_limits
from spacearm.motion.goal import in_rows, twist_between
from spacearm.motion.tip_path import Path, Segment, segments
from spacearm.singularities.report import NO_INVERSE

RETURN = 10.0
"""How fast the tip comes back to its path from rounding errors [1/m]."""
METHOD: Callable[..., OdeSolver] = DOP853
RTOL, ATOL = 1e-10, 1e-11
SPACING = 0.02
"""Largest distance between outputs along the curve in (q, s) [rad], [m]."""


@dataclass(frozen=True, eq=False, repr=False)
class Followed(Result):
    """How far the tip came along a path, and how; it plays in `sa.view`.

    Attributes:
        arm: The arm.
        mode: What the spacecraft did.
        s: (m,) length of path behind the tip [m]; turns count by the task's length, 1 m/rad where
            it has none, so that it is an angle [rad] for tasks without linear rows.
        t: (m,) times [s], the tip moving at constant speed.
        q: (m, n) joint positions [rad] or [m].
        base: (m, 7) poses of the spacecraft: position [m], quaternion xyzw, inertial frame.
        tip: (m, 7) poses of the tip, likewise.
        sigma_min: (m,) least singular value of the task Jacobian, along the axes in which the
            path is followed: inertial ones where the task axes would turn on the way.
        length: Length of the whole path, in the unit of s.
        ended: "arrived", "singularity" or "joint limit".
        reason: The same in a sentence, with the place.
    """

    arm: SpaceArm
    mode: BaseMode
    s: Array
    t: Array
    q: Array
    base: Array
    tip: Array
    sigma_min: Array
    length: float
    ended: str
    reason: str

    @property
    def arrived(self) -> bool:
        """Whether the tip came to the end of the path."""
        return self.ended == "arrived"

    def at(self, index: int) -> Configuration:
        """The configuration of one output."""
        return self.arm.at(self.q[index], base=pin.XYZQUATToSE3(self.base[index]))

    def __repr__(self) -> str:
        return f"Followed({self.arm.name}, {self.mode}: {self.reason})"


def follow(
    arm: SpaceArm,
    q0: npt.ArrayLike,
    path: Path,
    *,
    base: pin.SE3 | None = None,
    mode: BaseMode = "free-floating",
    length: float | None = None,
    speed: float = 0.1,
    limits: bool = True,
) -> Followed:
    """Leads the tip along a path at zero momentum, until it arrives or cannot go on.

    The tip first goes straight to the beginning of the path. Redundant arms move with the least
    joint rates.

    Args:
        arm: The arm.
        q0: (n,) joint positions at the start [rad] or [m].
        path: The corners of a polyline, (m, k) points in the task's linear rows [m] or a sequence
            of poses; or a function of the path length that gives either. Points are given along
            the task axes (see `Task.axes`), along inertial ones where these turn on the way.
            Turns count as in `Followed.s`.
        base: Pose of the spacecraft at the start; the identity if None.
        mode: What the spacecraft does; see `generalized_jacobian`.
        length: Length of a path given as a function [m], or [rad] of a mere turn.
        speed: Speed of the tip along its path [m/s], or [rad/s] in a mere turn, for the times.
        limits: Whether joint limits stop the motion.

    Raises:
        ConfigurationError: An argument does not make sense, or the start is singular.
        UnsupportedError: The task has more rows than the arm has joints.
    """
    cfg = arm.at(q0, base=base)
    if not (np.isfinite(speed) and speed > 0.0):
        raise ConfigurationError(f"speed is {speed}; give a positive number [m/s]")
    if arm.task.k > arm.n:
        raise UnsupportedError(
            f"{arm.name} has {arm.n} joints and a task of {arm.task.k} rows; no path can be "
            "followed in all of them"
        )
    sigma = _sigma(cfg, mode)
    if sigma[-1] <= NO_INVERSE * sigma[0]:
        raise ConfigurationError(
            f"q0 is singular (sigma_min {sigma[-1]:.1e} of {sigma[0]:.1e}); start elsewhere, or "
            "leave it first along sa.singularity(cfg).gradient"
        )
    if limits and ((cfg.q < arm.lower) | (cfg.q > arm.upper)).any():
        worst = int(np.flatnonzero((cfg.q < arm.lower) | (cfg.q > arm.upper))[0])
        raise ConfigurationError(
            f"q0 of joint {arm.joint_names[worst]!r} is {cfg.q[worst]:.6g}, its limits are "
            f"{arm.lower[worst]:.6g} and {arm.upper[worst]:.6g}; limits=False ignores them"
        )
    pieces = segments(cfg, path, length)
    whole = sum(piece.length for piece in pieces)
    states, ended, detail = [_state(cfg, 0.0)], "arrived", ""
    behind = 0.0
    for piece in pieces:
        walk = _Walk(cfg, piece, mode, limits)
        y, ended, detail = walk.integrate()
        y[:, -1] += behind
        states.append(y)
        behind += piece.length
        cfg = walk.configuration(y[-1])
        if ended != "arrived":
            break
    rows = np.vstack(states)
    rows = rows[np.append(True, np.diff(rows[:, -1]) > 0.0)]
    cfgs = [walk.configuration(y) for y in rows]
    return Followed(
        arm=arm,
        mode=mode,
        s=rows[:, -1],
        t=rows[:, -1] / speed,
        q=rows[:, : arm.n],
        base=np.array([pin.SE3ToXYZQUAT(cfg.base) for cfg in cfgs]),
        tip=np.array([pin.SE3ToXYZQUAT(cfg.tip) for cfg in cfgs]),
        sigma_min=np.array([_sigma(cfg, mode)[-1] for cfg in cfgs]),
        length=whole,
        ended=ended,
        reason=_reason(cfgs[-1], float(rows[-1, -1]), whole, ended, detail),
    )


class _Walk:
    """One segment of path and the curve in (q, attitude, s) that follows it."""

    def __init__(self, cfg: Configuration, segment: Segment, mode: BaseMode, limits: bool) -> None:
        self.start, self.segment, self.mode, self.limits = cfg, segment, mode, limits
        self.arm = cfg.arm
        self.square = self.arm.task.k == self.arm.n
        self.sense = np.sign(self.determinant(0.0, _state(cfg, 0.0))) if self.square else 1.0

    def configuration(self, y: Array) -> Configuration:
        """The configuration in a state (q, attitude quaternion, s)."""
        n = self.arm.n
        if self.mode == "fixed":
            return self.arm.at(y[:n], base=self.start.base)
        attitude = pin.Quaternion(y[n : n + 4] / np.linalg.norm(y[n : n + 4]))
        turned = kinematics(self.arm, y[:n].copy(), pin.SE3(attitude, np.zeros(3)))
        return turned.centred(self.start.com)

    def jacobian(self, cfg: Configuration) -> Array:
        """(k, n) the task's rows of J*."""
        return in_rows(cfg, generalized_jacobian(cfg, mode=self.mode))

    def determinant(self, _: float, y: Array) -> float:
        """det J*, whose sign tells the two sides of a singularity apart."""
        return float(np.linalg.det(self.jacobian(self.configuration(y))))

    def rate(self, _: float, y: Array) -> Array:
        """The unit vector along the curve, and how the attitude turns with it."""
        cfg, s = self.configuration(y), float(y[-1])
        J = self.jacobian(cfg)
        back = twist_between(cfg.tip, self.segment.pose(s))
        x = in_rows(cfg, self.segment.twist(s) + RETURN * back)
        if self.square:
            along = np.linalg.svd(np.column_stack((J, -x)))[2][-1]
            along *= self.sense * np.sign(np.linalg.det(J)) * np.sign(along[-1])
        else:
            along = np.append(np.linalg.pinv(J) @ x, 1.0)
            along /= np.linalg.norm(along)
        dq, ds = along[:-1], along[-1]
        turning = quaternion_rate(y[-5:-1], spacecraft_twist(cfg, dq, self.mode)[3:])
        return np.concatenate((dq, turning, [ds]))

    def watches(self) -> list[Watch]:
        """What ends the segment."""

        def left(_: float, y: Array) -> float:
            return self.segment.length - float(y[-1])

        def nearness(_: float, y: Array) -> float:
            sigma = _sigma(self.configuration(y), self.mode)
            return float(sigma[-1] - NEAR * sigma[0])

        stop = Watch("singularity", "", nearness, True)
        if self.square:
            stop = Watch("singularity", "", self.determinant, False)
        return [
            stop,
            Watch("arrived", "", left, True),
            *(joint_limits(self.arm) if self.limits else []),
        ]

    def integrate(self) -> tuple[Array, str, str]:
        """(m, n + 5) states up to the end, why it ended, and more about it."""
        watched, y0 = self.watches(), _state(self.start, 0.0)
        solver = METHOD(self.rate, 0.0, y0, np.inf, rtol=RTOL, atol=ATOL)
        lookout = Lookout(watched, self.arm.n, 0.0, y0)
        states: list[Array] = []
        while True:
            if failure := solver.step():
                raise NoSolutionError(f"{self.arm.name}: the path cannot be followed: {failure}")
            piece, end = solver.dense_output(), solver.t
            found = lookout.step(piece, end)
            if found:
                end = found[0].t
            steps = 1 + int((end - solver.t_old) / SPACING)
            states.append(piece(np.linspace(solver.t_old, end, steps + 1)[1:]).T)
            if found:
                return np.vstack(states), found[0].kind, found[0].detail


def _state(cfg: Configuration, s: float) -> Array:
    return np.concatenate((cfg.q, pin.SE3ToXYZQUAT(cfg.base)[3:], [s]))


def _sigma(cfg: Configuration, mode: BaseMode) -> Array:
    """(k,) singular values of the task Jacobian along the goal axes."""
    J = cfg.arm.task.scale * in_rows(cfg, generalized_jacobian(cfg, mode=mode))
    return np.linalg.svd(J, compute_uv=False)


def _reason(cfg: Configuration, s: float, length: float, ended: str, detail: str) -> str:
    """Where and why it ended."""
    place = ", ".join(f"{x:.4g}" for x in cfg.tip.translation)
    unit = "m" if min(cfg.arm.task.indices) < 3 else "rad"
    if ended == "arrived":
        return f"arrived at ({place}) after {s:.4g} {unit}"
    where = f"after {s:.4g} of {length:.4g} {unit}, tip at ({place})"
    if ended == "joint limit":
        return f"joint {detail!r} reaches its limit {where}"
    q = ", ".join(f"{x:.4g}" for x in cfg.q)
    return f"singular {where}, q = ({q}): J* cannot lead the tip on along the path"
