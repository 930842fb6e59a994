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
from typing import ClassVar

import numpy as np

from spacearm.arrays import Array, positive
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.mechanics.jacobian import singular_values
from spacearm.model.arguments import BaseMode, of_configuration
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.events import Event
from spacearm.motion.goal import Origin, goal_axes, started
from spacearm.motion.motion import Motion, samples
from spacearm.motion.motion_file import Quantity
from spacearm.motion.tip_curve import TipCurve, state_of
from spacearm.motion.tip_path import Path, segments
from spacearm.singularities.report import NO_INVERSE


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Followed(Motion):
    """The motion of an arm whose tip follows a path at constant speed, from `sa.follow`.

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


@of_configuration
def follow(
    start: Configuration,
    path: Path,
    *,
    origin: Origin = "spacecraft",
    mode: BaseMode = "free-floating",
    length: float | None = None,
    speed: float = 0.1,
    limits: bool = True,
    progress: Callable[[float, float], object] | None = None,
) -> Followed:
    """Lead the tip along a path at zero momentum, until it arrives or cannot go on.

    The tip goes straight to the beginning first. Redundant arms move with the least joint rates.

    Args:
        start: The configuration at the start, without momentum.
        path: The corners of a polyline, (m, k) points in the task's linear rows [m] or a sequence
            of poses; or a function of the path length that gives either. Points are given along
            the task axes (see `Task.axes`), along inertial ones where these turn on the way.
            Turns count as in `Followed.s`.
        origin: Where points are given from: "spacecraft" or "cm"; see `simulate`.
        mode: What the spacecraft does; see `generalized_jacobian`.
        length: Length of a path given as a function [m], or [rad] of a mere turn.
        speed: Speed of the tip along its path [m/s], or [rad/s] in a mere turn, for the times.
        limits: Whether joint limits stop the motion.
        progress: Called after every step as progress(s, length), of the straight piece it is on.

    Returns:
        The motion up to where it ended, with the reason.

    Raises:
        ConfigurationError: An argument does not make sense, or the start is singular or, where
            limits count, beyond them.
        UnsupportedError: The task has more rows than the arm has joints, or there is momentum.

    Example:
        >>> import spacearm as sa
        >>> sa.follow(sa.load("planar2").at([0.3, 1.2]), [(1.5, 1.2)]).reason
        'arrived at (1.5, 1.2, 0) m after 0.0966 m'
    """
    arm, speed, cfg = start.arm, positive(speed, "speed", "speed [m/s]"), started(start, origin)
    if cfg.momentum.any() or cfg.wheels.any():
        raise UnsupportedError(
            "the start has momentum on board, and sa.follow leads the tip at zero momentum only; "
            "sa.simulate takes a law that follows a path at any momentum"
        )
    check_start(cfg, mode, limits)
    pieces = segments(cfg, path, length)
    states, behind = [state_of(cfg, 0.0)], 0.0
    for piece in pieces:
        curve = TipCurve(cfg, piece, mode, limits)
        y, end = curve.integrate(progress)
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
        reason=how_it_ended(arm, curve.configuration(rows[-1]).tip.translation, s[-1], whole, end),
    )


def check_start(cfg: Configuration, mode: BaseMode, limits: bool) -> None:
    """Refuse a start from which no path can be followed.

    Raises:
        ConfigurationError: It is singular, or beyond the joint limits where they count.
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
        near = f"the start is singular (sigma_min {sigma[-1]:.1e} of {sigma[0]:.1e})"
        raise ConfigurationError(f"{near}; start elsewhere: sa.singularity(cfg).away leads away")
    beyond = np.flatnonzero((cfg.q < arm.lower) | (cfg.q > arm.upper))
    if limits and len(beyond):
        j = int(beyond[0])
        raise ConfigurationError(
            f"the start of joint {arm.joint_names[j]!r} is {cfg.q[j]:.6g}, its limits are "
            f"{arm.lower[j]:.6g} and {arm.upper[j]:.6g}; limits=False ignores them"
        )


def how_it_ended(arm: SpaceArm, tip: Array, s: float, length: float, end: Event) -> str:
    """Return where and why a motion ended, with the tip at a place (3,) [m]."""
    place = ", ".join(f"{x:.4g}" for x in tip)
    unit = "m" if min(arm.task.indices) < 3 else "rad"
    if end.kind == "arrived":
        return f"arrived at ({place}) m after {s:.4g} {unit}"
    where = f"after {s:.4g} of {length:.4g} {unit}, tip at ({place}) m"
    if end.kind == "joint limit":
        return f"joint {end.detail!r} reaches its limit {where}"
    q = arm.in_words(end.q)
    set_at = "" if end.nearest is None else f" at q = {arm.in_words(end.nearest)}"
    return (
        f"singular {where}, q = {q}{end.detail}{set_at}: J* cannot lead the tip on along the path"
    )
