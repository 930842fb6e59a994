"""Following: the tip led along a path by J*, until it arrives or a singularity stops it.

Along a path x(s), s its length, the joints move as J* dq = x' ds (equation (1)). At a singularity
where x' points in the lost direction, q(s) has a vertical tangent and turns back; as a curve in
(q, s) it stays smooth. This curve is therefore integrated over its own length: its tangent (dq, ds)
is the unit vector with J* dq - x' ds = 0, and the singularity is the point where ds = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, positive
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.dynamics import spacecraft_twist
from spacearm.mechanics.floating import quaternion_rate
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration, kinematics
from spacearm.model.mode import BaseMode
from spacearm.motion.events import NEAR, Event, EventFinder, EventFunction, limit_functions
from spacearm.motion.goal import goal_axes, goal_rows, twist_between
from spacearm.motion.motion import Motion, samples
from spacearm.motion.motion_file import Quantity
from spacearm.motion.tip_path import Path, Segment, segments
from spacearm.singularities.report import NO_INVERSE, singular_values

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver

RETURN = 10.0
"""Rate at which the tip returns to its path from rounding errors [1/m]."""
RTOL, ATOL = 1e-10, 1e-11
SPACING = 0.02
"""Largest distance between outputs along the curve in (q, s) [rad], [m]."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Followed(Motion):
    """The motion of an arm whose tip follows a path, from `sa.follow`: a `Motion` with more to it.

    The times are those of a tip that moves at constant speed.

    Attributes:
        s: (m,) length of path behind the tip [m]; turns count by the task's length, 1 m/rad where
            it has none, so that it is an angle [rad] for tasks without linear rows.
        length: Length of the whole path, in the unit of s.
        ended: "arrived", "singularity" or "joint limit".
        reason: The same in a sentence, with the place.
    """

    s: Array
    length: float
    ended: str
    reason: str

    QUANTITIES: ClassVar[Mapping[str, Quantity]] = {**Motion.QUANTITIES, "s": Quantity("m or rad")}

    @property
    def arrived(self) -> bool:
        """Whether the tip came to the end of the path."""
        return self.ended == "arrived"

    @cached_property
    def sigma_min(self) -> Array:
        """(m,) least singular value of the task Jacobian along the axes of the path.

        These are the task axes, or inertial ones where the task axes turn on the way.
        """
        return self._each(lambda cfg: singular_values(cfg, mode=self.mode, axes=goal_axes(cfg))[-1])

    @property
    def story(self) -> str:
        """What the spacecraft did and how the motion ended, in one line."""
        return f"{self.mode}: {'arrived' if self.arrived else f'ended by {self.ended}'}"

    @property
    def singular_times(self) -> tuple[float, ...]:
        """The time of the singularity that ended the motion, if one did [s]."""
        return (float(self.t[-1]),) if self.ended == "singularity" else ()

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
    """Lead the tip along a path at zero momentum, until it arrives or cannot go on.

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
    cfg, speed = arm.at(q0, base=base), positive(speed, "speed", "speed [m/s]")
    _check_start(cfg, mode, limits)
    pieces = segments(cfg, path, length)
    states, behind = [_state(cfg, 0.0)], 0.0
    for piece in pieces:
        curve = _Curve(cfg, piece, mode, limits)
        y, end = curve.integrate()
        y[:, -1] += behind
        behind += piece.length
        states.append(y)
        cfg = curve.configuration(y[-1])
        if end.kind != "arrived":
            break
    rows = np.vstack(states)
    rows = rows[np.append(True, np.diff(rows[:, -1]) > 0.0)]
    s, whole = rows[:, -1], sum(piece.length for piece in pieces)
    return Followed(
        arm=arm,
        mode=mode,
        t=s / speed,
        **samples([curve.configuration(y) for y in rows]),
        s=s.copy(),
        length=whole,
        ended=end.kind,
        reason=_reason(curve.configuration(rows[-1]), float(s[-1]), whole, end),
    )


def _check_start(cfg: Configuration, mode: BaseMode, limits: bool) -> None:
    """Refuse a start from which no path can be followed.

    Raises:
        ConfigurationError: It is singular, or beyond the joint limits where these count.
        UnsupportedError: The task has more rows than the arm has joints.
    """
    arm = cfg.arm
    if arm.task.k > arm.n:
        raise UnsupportedError(
            f"{arm.name} has {arm.n} joints and a task of {arm.task.k} rows; no path can be "
            "followed in all of them"
        )
    sigma = singular_values(cfg, mode=mode, axes=goal_axes(cfg))
    if sigma[-1] <= NO_INVERSE * sigma[0]:
        raise ConfigurationError(
            f"q0 is singular (sigma_min {sigma[-1]:.1e} of {sigma[0]:.1e}); start elsewhere, or "
            "leave it first along sa.singularity(cfg).gradient"
        )
    beyond = np.flatnonzero((cfg.q < arm.lower) | (cfg.q > arm.upper))
    if limits and len(beyond):
        j = int(beyond[0])
        raise ConfigurationError(
            f"q0 of joint {arm.joint_names[j]!r} is {cfg.q[j]:.6g}, its limits are "
            f"{arm.lower[j]:.6g} and {arm.upper[j]:.6g}; limits=False ignores them"
        )


class _Curve:
    """The curve of states (q, attitude quaternion, s) along which the tip follows one segment.

    Args:
        cfg: Configuration at its start.
        segment: The segment.
        mode: What the spacecraft does.
        limits: Whether joint limits end it.
    """

    def __init__(self, cfg: Configuration, segment: Segment, mode: BaseMode, limits: bool) -> None:
        self.arm, self.start, self.segment = cfg.arm, cfg, segment
        self.mode, self.limits = mode, limits
        self.square = self.arm.task.k == self.arm.n
        self.sense = np.sign(self.determinant(_state(cfg, 0.0))) if self.square else 1.0

    def configuration(self, y: Array) -> Configuration:
        """Return the configuration in a state; the system CM stays, or the spacecraft if fixed."""
        n = self.arm.n
        if self.mode == "fixed":
            return self.arm.at(y[:n], base=self.start.base)
        attitude = pin.Quaternion(y[n : n + 4] / np.linalg.norm(y[n : n + 4]))
        turned = kinematics(self.arm, y[:n].copy(), pin.SE3(attitude, np.zeros(3)))
        return turned.centred(self.start.com)

    def jacobian(self, cfg: Configuration) -> Array:
        """Return the rows (k, n) of J* that the task names."""
        return goal_rows(cfg, generalized_jacobian(cfg, mode=self.mode))

    def determinant(self, y: Array) -> float:
        """Return det J*, which has opposite signs on the two sides of a singularity."""
        return float(np.linalg.det(self.jacobian(self.configuration(y))))

    def tangent(self, cfg: Configuration, s: float) -> Array:
        """Return the unit vector (dq, ds) along the curve.

        Of a redundant arm the joint rates are the least; of others ds changes its sign with det J*,
        so that the curve goes on beyond a singularity, back along the path.
        """
        J = self.jacobian(cfg)
        back = RETURN * twist_between(cfg.tip, self.segment.pose(s))
        x = goal_rows(cfg, self.segment.twist(s) + back)
        if not self.square:
            along = np.append(np.linalg.pinv(J) @ x, 1.0)
            return along / np.linalg.norm(along)
        along = np.linalg.svd(np.column_stack((J, -x)))[2][-1]
        return along * self.sense * np.sign(np.linalg.det(J)) * np.sign(along[-1])

    def rate(self, _: float, y: Array) -> Array:
        """Return the derivative of the state with respect to the length of the curve."""
        cfg = self.configuration(y)
        along = self.tangent(cfg, float(y[-1]))
        dq, ds = along[:-1], along[-1]
        turning = quaternion_rate(y[-5:-1], spacecraft_twist(cfg, dq, self.mode)[3:])
        return np.concatenate((dq, turning, [ds]))

    def end_functions(self) -> list[EventFunction]:
        """Return the functions whose roots end the segment."""

        def nearness(_: float, y: Array) -> float:
            cfg = self.configuration(y)
            sigma = singular_values(cfg, mode=self.mode, axes=goal_axes(cfg))
            return float(sigma[-1] - NEAR * sigma[0])

        singular = (
            EventFunction("singularity", "", lambda _, y: self.determinant(y), False)
            if self.square
            else EventFunction("singularity", "", nearness, True)
        )
        length = self.segment.length
        arrived = EventFunction("arrived", "", lambda _, y: length - float(y[-1]), True)
        return [singular, arrived, *(limit_functions(self.arm) if self.limits else [])]

    def integrate(self) -> tuple[Array, Event]:
        """Return the states (m, n + 5) up to the end, and the event that ends the segment.

        Raises:
            NoSolutionError: The integrator fails.
        """
        from scipy import integrate  # slow to import

        y0 = _state(self.start, 0.0)
        method: Callable[..., OdeSolver] = integrate.DOP853
        solver = method(self.rate, 0.0, y0, np.inf, rtol=RTOL, atol=ATOL)
        finder = EventFinder(self.end_functions(), self.arm.n, 0.0, y0)
        states: list[Array] = []
        while True:
            if failure := solver.step():
                raise NoSolutionError(f"{self.arm.name}: the path cannot be followed: {failure}")
            piece, end = solver.dense_output(), solver.t
            found = finder.in_step(piece, end)
            if found:
                end = found[0].t
            steps = 1 + int((end - solver.t_old) / SPACING)
            states.append(piece(np.linspace(solver.t_old, end, steps + 1)[1:]).T)
            if found:
                return np.vstack(states), found[0]


def _state(cfg: Configuration, s: float) -> Array:
    """Return the state (q, attitude quaternion, s)."""
    return np.concatenate((cfg.q, pin.SE3ToXYZQUAT(cfg.base)[3:], [s]))


def _reason(cfg: Configuration, s: float, length: float, end: Event) -> str:
    """Return where and why the motion ended."""
    place = ", ".join(f"{x:.4g}" for x in cfg.tip.translation)
    unit = "m" if min(cfg.arm.task.indices) < 3 else "rad"
    if end.kind == "arrived":
        return f"arrived at ({place}) after {s:.4g} {unit}"
    where = f"after {s:.4g} of {length:.4g} {unit}, tip at ({place})"
    if end.kind == "joint limit":
        return f"joint {end.detail!r} reaches its limit {where}"
    q = ", ".join(f"{x:.4g}" for x in cfg.q)
    return f"singular {where}, q = ({q}): J* cannot lead the tip on along the path"
