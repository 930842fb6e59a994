"""Following: the tip led along a path by J*, until it arrives or a singularity stops it.

Along a path x(s), s its length, the joints move as J* dq = x' ds (equation (1)). At a singularity
where x' points in the lost direction, q(s) has a vertical tangent and turns back; as a curve in
(q, s) it stays smooth. This curve is therefore integrated over its own length: its tangent (dq, ds)
is the unit vector with J* dq - x' ds = 0, and the singularity is the point where ds = 0.

With momentum on board the tip drifts at v_h besides, and s is the time: J* dq + (v_h - x') ds = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from itertools import pairwise
from numbers import Real
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
import scipy

from spacearm.arrays import SMALLEST, Array, ArrayLike, finite, positive
from spacearm.compiler import numbers
from spacearm.equations.laws import quaternion_rate
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.dynamics import generalized_velocity, spacecraft_twist
from spacearm.mechanics.floating import carried_along, samples
from spacearm.mechanics.jacobian import generalized_jacobian, singular_values
from spacearm.model.arguments import BaseMode, require_possible
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.motion import events
from spacearm.motion import goal as goals
from spacearm.motion.events import Event
from spacearm.motion.goal import Goal, Origin, goal_pose
from spacearm.motion.motion import Drifting, RateJump
from spacearm.motion.motion_file import Quantity
from spacearm.results import Description, Tone
from spacearm.signatures import checked, shown
from spacearm.singularities.nearest import nearest_locally
from spacearm.singularities.report import NO_INVERSE

#: The corners of a polyline, or a function of path length [m].
Path: TypeAlias = Sequence[Goal] | Array | Callable[[float], Goal]

#: Distance from the tip up to which a path in time begins there [m], [rad].
BEGIN = 1e-6
#: Intervals in which the length of a path in time is summed up.
KNOTS = 2000
#: Radians of the joints that the time of a path counts for at most: a second counts for one.
LONGEST = 40.0
#: Half the length over which the direction of a path is taken [m].
DIFFERENCE = 1e-6


class Segment(NamedTuple):
    """A smooth piece of path.

    Attributes:
        length: Its length [m].
        pose: The tip pose at a length along it; what the task leaves open does not matter.
        twist: (6,) the derivative of the pose with respect to that length.
        straight: Whether that derivative is constant.
        unit: Length along it that counts as much as a radian of the joints.
    """

    length: float
    pose: Callable[[float], pin.SE3]
    twist: Callable[[float], Array]
    straight: bool
    unit: float = 1.0


def path_start(cfg: Configuration, path: Path) -> pin.SE3:
    """Return the pose with which a path begins.

    Raises:
        ConfigurationError: The path has no beginning.
    """
    if callable(path):
        return goal_pose(cfg, path(0.0), "path(0.0)")
    try:
        return goal_pose(cfg, next(iter(path)), "path[0]")
    except (TypeError, StopIteration):
        raise _no_path(path) from None


def segments(
    cfg: Configuration, path: Path, length: float | None, start: pin.SE3 | None = None
) -> list[Segment]:
    """Return the path in smooth pieces, from where the tip is.

    Args:
        cfg: The configuration at the start.
        path: The path.
        length: Length of a path given as a function [m]; None for a polyline.
        start: A pose from which to go to the path instead.

    Raises:
        ConfigurationError: The path or its length does not make sense.
    """
    start = cfg.tip if start is None else start
    if callable(path):
        length = positive(length, "length", "length [m] of the path, which is a function")
        first = _line(cfg, start, goal_pose(cfg, path(0.0), "path(0.0)"))
        return [*first, _curve(cfg, path, length)]
    if length is not None:
        raise ConfigurationError(f"length is {length}; a polyline has its own, leave it out")
    try:
        whole = list(path)
    except TypeError:
        whole = []
    if not whole or any(isinstance(corner, Real) for corner in whole):  # one point, perhaps
        raise _no_path(path)
    corners = [goal_pose(cfg, corner, f"path[{i}]") for i, corner in enumerate(whole)]
    poses = [start, *corners]
    pieces = [_line(cfg, *pair) for pair in pairwise(poses)]
    found = [segment for piece in pieces for segment in piece]
    if not found:
        raise ConfigurationError("path ends where the tip is; there is nothing to follow")
    return found


def _no_path(path: object) -> ConfigurationError:
    return ConfigurationError(
        f"path is {shown(path)}; give corners (one: [goal]), or a function of path length"
    )


def _line(cfg: Configuration, start: pin.SE3, end: pin.SE3) -> list[Segment]:
    """Return a straight line with a constant angular velocity, nothing if it has no length.

    Turns count by the task's length [m/rad], 1 m/rad where it has none.
    """
    task = cfg.arm.task
    whole = goals.twist_between(start, end)
    rows = goals.goal_rows(cfg, whole)
    linear = np.array(task.indices) < 3
    length = float(np.linalg.norm(np.where(linear, rows, rows * (task.length or 1.0))))
    if length < 1e-12:
        return []
    twist = whole / length

    def pose(s: float) -> pin.SE3:
        turned = pin.exp3(s * twist[3:]) @ start.rotation
        return pin.SE3(turned, start.translation + s * twist[:3])

    return [Segment(length, pose, lambda _: twist, True)]


def _curve(cfg: Configuration, path: Callable[[float], Goal], length: float) -> Segment:
    """Return a path given as a function of its length, its direction by differences."""

    def pose(s: float) -> pin.SE3:
        return goal_pose(cfg, path(s), f"path({s:.6g})")

    def twist(s: float) -> Array:
        low, high = max(s - DIFFERENCE, 0.0), min(s + DIFFERENCE, length)
        return goals.twist_between(pose(low), pose(high)) / (high - low)

    return Segment(length, pose, twist, False)


def timed_curve(cfg: Configuration, path: Path, times: ArrayLike, at_rest: bool) -> Segment:
    """Return the path through corners at times, its parameter the time [s].

    Position and quaternion are cubic splines over time, from where the tip is at the start.

    Raises:
        ConfigurationError: Path or times do not make sense, or a path from t = 0 begins elsewhere.
    """
    if callable(path):
        raise ConfigurationError("times are for a path of corners, not for a function of length")
    corners = [goal_pose(cfg, corner, f"path[{i}]") for i, corner in enumerate(path)]
    t = finite(times, (len(corners),), "times", "[s], one for each corner of path, increasing")
    apart = np.diff(t if len(t) and t[0] == 0.0 else np.append(0.0, t))
    if not len(apart) or apart.min() < SMALLEST:
        more = f"increasing times from 0 s on, at least {SMALLEST:g} s apart"
        raise ConfigurationError(f"times are {np.array2string(t, threshold=5)}; give {more}")
    if t[0] == 0.0 and np.abs(off := goals.miss(cfg, corners[0])).max() > BEGIN:
        raise ConfigurationError(
            f"path begins at 0 s {goals.largest(off, cfg.arm.task.indices)} from where the tip is; "
            f"start at {goals.row_of(cfg.tip)} (sa.plan leads there), or give later times"
        )
    corners = [cfg.tip, *corners[int(t[0] == 0.0) :]]  # numbers of a file are rounded
    t = np.append(0.0, t[t > 0.0])
    turns = np.array([pin.SE3ToXYZQUAT(corner) for corner in corners])
    flips = np.sign((turns[1:, 3:] * turns[:-1, 3:]).sum(axis=1))
    turns[1:, 3:] *= np.cumprod(np.where(flips < 0.0, -1.0, 1.0))[:, None]
    spline = scipy.interpolate.CubicSpline(t, turns, bc_type="clamped" if at_rest else "not-a-knot")

    def pose(s: float) -> pin.SE3:
        x = spline(s)
        return pin.SE3(pin.Quaternion(x[3:] / np.linalg.norm(x[3:])).matrix(), x[:3])

    def twist(s: float) -> Array:
        x, dx = spline(s), spline(s, 1)
        turn = pin.Quaternion(dx[3:]) * pin.Quaternion(x[3:]).inverse()
        return np.concatenate((dx[:3], 2.0 * turn.coeffs()[:3]))

    return Segment(float(t[-1]), pose, twist, False, max(1.0, float(t[-1]) / LONGEST))


#: Length of the curve in (q, s) over which its tangent is differenced [rad], [m].
AHEAD = 1e-4
#: Share of the largest joint rate up to which rates do not jump.
SMOOTH = 1e-7
#: Rate at which the tip returns to its path from rounding errors, for a `Segment.unit`.
RETURN = 10.0
RTOL, ATOL = 1e-10, 1e-11
#: Path over joint motion [m/rad] below which a redundant arm is stuck, and what is said then.
CRAWL, STUCK = 1e-5, "where the joints move 1e5 times as far as what they lead"
#: Distance by which a singular posture counts as met [rad].
ROUNDING = 1e-6
#: What ends a segment.
ENDS = ("singularity", "arrived", "joint limit")
#: Largest distance between outputs along the curve in (q, s) [rad], [m].
SPACING = 0.02


class TipCurve:
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
        self.correction = RETURN / segment.unit
        self.moving = bool(cfg.momentum.any() or cfg.wheels.any())
        self.drift = cfg.momentum[:3] / cfg.arm.mass
        self.square = self.arm.task.k == self.arm.n
        self.sense = np.sign(np.linalg.det(self.jacobian(cfg))) if self.square else 1.0

    def configuration(self, y: Array) -> Configuration:
        """Return the configuration in a state; the system CM drifts, a fixed spacecraft stays."""
        n = self.arm.n
        if self.mode == "fixed":
            return kinematics(self.arm, y[:n].copy(), pin.SE3(self.start.base))
        attitude = pin.Quaternion(y[n : n + 4] / np.linalg.norm(y[n : n + 4]))
        com = self.start.com + y[-1] * self.drift
        there = kinematics(self.arm, y[:n].copy(), pin.SE3(attitude, np.zeros(3)), com)
        if not self.moving:
            return there
        return there.with_momentum(self.start.momentum).with_wheels(self.start.wheels)

    def jacobian(self, cfg: Configuration) -> Array:
        """Return the rows (k, n) of J* that the task names."""
        return goals.goal_rows(cfg, generalized_jacobian(cfg, mode=self.mode))

    def wanted(self, cfg: Configuration, s: float) -> Array:
        """Return the twists (6 tips,) of the tips along the path, for a unit of s."""
        error = goals.twist_between(cfg.tip, self.segment.pose(s))
        return self.segment.twist(s) + self.correction * error

    def adrift(self, cfg: Configuration) -> Array:
        """Return the twists (6 tips,) of the tips by the momentum alone."""
        return np.asarray(cfg.J @ generalized_velocity(cfg, np.zeros(self.arm.n), self.mode))

    def inner(self, cfg: Configuration) -> Array:
        """Return the joint rates (n,) of which redundant arms take the part in the null space."""
        return np.zeros(cfg.arm.n)

    def place(self, cfg: Configuration) -> Array:
        """Return where (3,) what is led along the path is [m]."""
        return cfg.tip.translation

    def tangent(self, cfg: Configuration, s: float) -> Array:
        """Return the vector (dq, ds) along the curve, of length 1 where ds is in `Segment.unit`.

        Of a redundant arm the joint rates are the least; of others ds changes its sign with det J*,
        so that the curve goes on beyond a singularity, back along the path.
        """
        J, twist, unit = self.jacobian(cfg), self.wanted(cfg, s), self.segment.unit
        x = unit * goals.goal_rows(cfg, twist - self.adrift(cfg) if self.moving else twist)
        if self.square:
            along = np.linalg.svd(np.column_stack((J, -x)))[2][-1]
            along = along * self.sense * np.sign(np.linalg.det(J)) * np.sign(along[-1])
        else:
            back = np.linalg.pinv(J)
            inner = unit * self.inner(cfg)
            along = np.append(back @ x + inner - back @ (J @ inner), 1.0)
            along = along / np.linalg.norm(along)
        along[-1] *= unit
        return along

    def rate(self, _: float, y: Array) -> Array:
        """Return the derivative of the state with respect to the length of the curve."""
        cfg = self.configuration(y)
        along = self.tangent(cfg, float(y[-1]))
        dq, ds = along[:-1], along[-1]
        if self.moving:
            cfg = cfg.with_momentum(ds * cfg.momentum).with_wheels(ds * cfg.wheels)
        w = spacecraft_twist(cfg, dq, self.mode)[3:] @ cfg.base.rotation
        return np.concatenate((dq, quaternion_rate(numbers, y[-5:-1], w), [ds]))

    def motion(self, y: Array, speed: float) -> tuple[Array, Array]:
        """Compute the joint rates and accelerations (n,) with which s grows at a constant speed.

        With the derivatives q', s' along the curve, dq/ds = q' / s' and
        d^2 q / ds^2 = (q'' - s'' q' / s') / s'^2. Second derivatives are differences of the
        tangent, ahead only where the path begins.
        """
        starts = y[-1] < AHEAD * self.segment.unit
        places, weights = ((0, 1, 2), (-1.5, 2.0, -0.5)) if starts else ((-1, 0, 1), (-0.5, 0, 0.5))
        here = self.rate(0.0, y)
        tangents = np.array([self._tangent_beyond(y, here, AHEAD * i) for i in places])
        along, bend = tangents[places.index(0)], np.array(weights) @ tangents / AHEAD
        dq = along[:-1] / along[-1]
        return speed * dq, (speed / along[-1]) ** 2 * (bend[:-1] - bend[-1] * dq)

    def _tangent_beyond(self, y: Array, rate: Array, h: float) -> Array:
        """Return the tangent a short way h along the curve from a state with its rate."""
        if not h:
            return np.append(rate[: self.arm.n], rate[-1])
        there = y + h * self.rate(0.0, y + 0.5 * h * rate)
        return self.tangent(self.configuration(there), float(there[-1]))

    def rooms(self, y: Array) -> Array:
        """Return how far (3,) a state is from each of `ENDS`: negative beyond it."""
        cfg, q, arm = self.configuration(y), y[: self.arm.n], self.arm
        if self.square:
            clear = self.sense * np.linalg.det(self.jacobian(cfg))
        else:
            clear = events.clear_of_singularities(cfg, self.mode, goals.goal_axes(cfg))
            clear = min(clear, float(self.tangent(cfg, float(y[-1]))[-1]) - CRAWL)
        inside = np.minimum(arm.upper - q, q - arm.lower).min() + events.ROUNDING
        return np.array([clear, self.segment.length - y[-1], inside if self.limits else 1.0])

    def integrate(
        self, progress: Callable[[float, float], object] | None, behind: float, whole: float
    ) -> tuple[Array, Event]:
        """Return the states (m, n + 5) up to the end, and the event that ends the segment.

        Raises:
            NoSolutionError: The integrator fails.
        """
        y = state_of(self.start, 0.0)
        method: Callable[..., scipy.integrate.OdeSolver] = scipy.integrate.DOP853
        solver = method(self.rate, 0.0, y, np.inf, rtol=RTOL, atol=ATOL)
        before, states = self.rooms(y), list[Array]()
        while True:
            if failure := solver.step():
                raise NoSolutionError(f"{self.arm.name}: the path cannot be followed: {failure}")
            if progress:
                progress(behind + min(float(solver.y[-1]), self.segment.length), whole)
            piece, begin, fall = solver.dense_output(), solver.t_old, None

            def along(t: float, piece: Any = piece) -> Array:
                return self.rooms(piece(t))

            moved = np.abs((solver.y - piece(begin))[: self.arm.n]).max()
            looks = np.linspace(begin, solver.t, 2 + int(moved / events.LOOK))
            for a, b in pairwise(looks.tolist()):
                after = along(b)
                if fall := events.first_fall(along, before, after, a, b):
                    break
                before = after
            end = fall[0] if fall else solver.t
            steps = 1 + int((end - begin) / SPACING)
            states.append(piece(np.linspace(begin, end, steps + 1)[1:]).T)
            if fall:
                return np.vstack(states), self.event(end, states[-1][-1], ENDS[fall[1]])

    def event(self, t: float, y: Array, kind: str) -> Event:
        """Return the event that ends the segment in a state."""
        arm, q, detail, nearest = self.arm, y[: self.arm.n].copy(), "", None
        if kind == "joint limit":
            detail = arm.joint_names[int(np.minimum(arm.upper - q, q - arm.lower).argmin())]
        elif kind == "singularity" and not self.square:
            near = events.clear_of_singularities(self.configuration(y), self.mode) < ROUNDING
            detail = f", {events.CLOSE if near else STUCK}"
            found = nearest_locally(arm, self.mode, q) if events.is_exact(arm) else None
            nearest = None if found is None else found[0]
        return Event(t, kind, q, detail, nearest)


def state_of(cfg: Configuration, s: float) -> Array:
    """Return the state (q, attitude quaternion, s)."""
    return np.concatenate((cfg.q, pin.SE3ToXYZQUAT(cfg.base)[3:], [s]))


class Followed(Drifting, kw_only=True):
    """The motion of an arm whose tip follows a path, from `sa.follow`.

    Attributes:
        s: (m,) length of path that the tip has covered [m]. Turns count by the task's length, or
            by 1 m/rad if it has none, so that s is an angle [rad] for tasks without linear rows.
        length: Length of the whole path, in the unit of s.
        ended: "arrived", "singularity" or "joint limit".
        reason: The same in a sentence, with the place.
        dq: (m, n) joint rates [rad/s] or [m/s], before the jump where they jump; at a singular end,
            where they have no bound, the mean of the last interval.
        ddq: (m, n) joint accelerations [rad/s^2] or [m/s^2]; at a singular end those before it.
        jumps: Where the joint rates jump, at corners and at both ends, unless the path has times.
    """

    s: Array
    length: float
    ended: str
    reason: str
    dq: Array = field()
    ddq: Array = field()
    jumps: tuple[RateJump, ...] = ()

    QUANTITIES: ClassVar[Mapping[str, Quantity]] = {
        **Drifting.QUANTITIES,
        "ddq": Quantity("rad/s^2 or m/s^2", "joint"),
        "s": Quantity("m or rad"),
    }
    JSON: ClassVar[Mapping[str, str]] = {"length": "path_length"}

    @property
    def arrived(self) -> bool:
        """Whether the tip came to the end of the path."""
        return self.ended == "arrived"

    @cached_property
    def sigma_min(self) -> Array:
        """(m,) least singular value of the task Jacobian along the axes of the path.

        These are the task axes, or inertial ones where the task axes turn on the way.
        """
        axes = goals.goal_axes
        return self._each(lambda cfg: singular_values(cfg, mode=self.mode, axes=axes(cfg))[-1])

    @property
    def story(self) -> str:
        """What the spacecraft did and how the motion ended, in one line."""
        return f"{self.mode}: {'arrived' if self.arrived else f'ended by {self.ended}'}"

    @property
    def ended_singular(self) -> bool:
        """Whether a singularity ended it, which the tip was led into at a constant speed."""
        return self.ended == "singularity"

    @property
    def singular_times(self) -> tuple[float, ...]:
        """The time of the singularity that ended the motion, if one did [s]."""
        return (float(self.t[-1]),) if self.ended == "singularity" else ()

    def describe(self) -> Description:
        """Describe the motion and why it ended."""
        tone: Tone = "good" if self.arrived else "caution"
        return replace(super().describe(), verdict=self.reason, tone=tone)


@checked
def follow(
    start: Configuration,
    path: Path,
    *,
    origin: Origin = "spacecraft",
    mode: BaseMode = "free-floating",
    length: float | None = None,
    speed: float | None = None,
    times: ArrayLike | None = None,
    at_rest: bool = True,
    limits: bool = True,
    progress: Callable[[float, float], object] | None = None,
) -> Followed:
    """Lead the tip along a path, until it arrives or cannot go on.

    The tip goes straight to the beginning first. Redundant arms move with the least joint rates.

    Args:
        start: The configuration at the start; momentum on board and in wheels, which they keep, is
            for paths with times.
        path: The corners of a polyline, (m, k) points in the task's linear rows [m] or a sequence
            of poses; or a function of the path length that gives either. Points are given along
            the task axes (see `Task.axes`), along inertial ones where these turn on the way.
            Turns count as in `Followed.s`.
        origin: Where points are given from: "spacecraft" or "cm"; see `simulate`.
        mode: What the spacecraft does; see `generalized_jacobian`.
        length: Length of a path given as a function [m], or [rad] of a mere turn.
        speed: Constant speed of the tip along its path [m/s], or [rad/s] in a mere turn; 0.1 if
            None, where there are no times.
        times: (m,) when the tip passes each corner [s], 0 at the start. The tip then takes a smooth
            way through the corners, cubic in time, in place of straight lines.
        at_rest: Whether a motion with times begins and ends with the tip at rest; if not, as the
            first and the last four corners suggest (a spline that is "not a knot").
        limits: Whether joint limits stop the motion.
        progress: Called after every step as progress(s, length), of the whole path.

    Returns:
        The motion up to where it ended, with the reason.

    Raises:
        ConfigurationError: An argument does not make sense, or the start is singular or, where
            limits count, beyond them.
        UnsupportedError: The task has more rows than the arm has joints, or there is momentum and
            the path has no times.

    Example:
        >>> import spacearm as sa
        >>> sa.follow(sa.load("planar2").at([0.3, 1.2]), [(1.5, 1.2)]).reason
        'arrived at (1.5, 1.2, 0) m after 0.0966 m'
    """
    cfg = goals.started(start, origin)
    pieces, pace, timed = path_pieces(cfg, path, length, speed, times, at_rest)
    check_start(cfg, mode, limits, timed)
    curve = partial(TipCurve, mode=mode, limits=limits)
    _, told = told_along(cfg, cfg, pieces, pace, timed, curve, progress)
    return Followed(mode=mode, **told)


def path_pieces(
    cfg: Configuration,
    path: Path,
    length: float | None,
    speed: float | None,
    times: ArrayLike | None,
    at_rest: bool,
) -> tuple[list[Segment], float, bool]:
    """Return the pieces of a path, the speed along their parameter, and whether this is time.

    Raises:
        ConfigurationError: An argument does not make sense.
    """
    if times is not None and (speed is not None or length is not None):
        raise ConfigurationError("times say how fast the tip moves; leave out speed and length")
    speed = positive(0.1 if speed is None else speed, "speed", "speed [m/s]")
    if times is not None:
        return [timed_curve(cfg, path, times, at_rest)], 1.0, True
    return segments(cfg, path, length), speed, False


class Led(NamedTuple):
    """The rows of a motion along the pieces of a path.

    Attributes:
        rows: The configurations.
        s: (m,) the parameter of the path.
        dq: (m, n) joint rates.
        ddq: (m, n) accelerations.
        jumps: Where the rates jump.
    """

    rows: list[Configuration]
    s: Array
    dq: Array
    ddq: Array
    jumps: tuple[RateJump, ...]


def rows_along(
    cfg: Configuration,
    pieces: Sequence[Segment],
    pace: float,
    curve_of: Callable[[Configuration, Segment], TipCurve],
    progress: Callable[[float, float], object] | None,
) -> tuple[Led, Event, Array]:
    """Lead an arm along the pieces of a path; return also what ended it, and where.

    Args:
        cfg: The configuration at the start.
        pieces: The pieces.
        pace: How fast their parameter grows [1/s].
        curve_of: Makes the curve of states along a piece.
        progress: As in `follow`.
    """
    n = cfg.arm.n
    states, moved, jumps = [state_of(cfg, 0.0)], list[Array](), list[RateJump]()
    behind, before = 0.0, np.zeros(n)
    whole = sum(piece.length for piece in pieces)
    for piece in pieces:
        curve = curve_of(cfg, piece)
        y, end = curve.integrate(progress, behind, whole)
        unbounded = curve.square and end.kind == "singularity"
        inside = [state_of(cfg, 0.0), *(y[:-1] if unbounded else y)]
        rates = np.array([curve.motion(state, pace) for state in inside])
        moved.append(rates[len(moved) > 0 :])
        jumps.append(RateJump(behind / pace, cfg.q, rates[0, 0] - before))
        before = rates[-1, 0]
        y[:, -1] += behind
        behind += piece.length
        states.append(y)
        cfg = curve.configuration(y[-1])
        if end.kind != "arrived":
            break
    rows, known = np.vstack(states), np.vstack(moved)
    if unbounded:
        last = (rows[-1, :n] - rows[-2, :n]) / (rows[-1, -1] - rows[-2, -1]) * pace
        known = np.append(known, [[last, known[-1, 1]]], axis=0)
    else:
        jumps.append(RateJump(rows[-1, -1] / pace, cfg.q, -before))
    least = SMOOTH * np.abs(known[:, 0]).max()
    kept = np.append(True, np.diff(rows[:, -1]) > 0.0)
    rows, known = rows[kept], known[kept]
    led = Led(
        [curve.configuration(y) for y in rows],
        rows[:, -1].copy(),
        known[:, 0].copy(),
        known[:, 1].copy(),
        tuple(jump for jump in jumps if np.abs(jump.change).max() > least),
    )
    return led, end, curve.place(led.rows[-1])


def told_along(
    cfg: Configuration,
    seen: Configuration,
    pieces: Sequence[Segment],
    pace: float,
    timed: bool,
    curve_of: Callable[..., TipCurve],
    progress: Callable[[float, float], object] | None = None,
    what: str = "tip",
) -> tuple[Led, dict[str, Any]]:
    """Lead an arm along pieces; return its rows, and the fields of `Followed` but the mode.

    Args:
        cfg: The configuration at the start.
        seen: One whose tip is what is led, there.
        pieces: The pieces.
        pace: As of `rows_along`; so are the others.
        timed: Whether the parameter of the pieces is time.
        curve_of: Makes the curve of states along a piece.
        progress: As in `follow`.
        what: What is led, for the reason.
    """
    led, last, place = rows_along(cfg, pieces, pace, curve_of, progress)
    behind, whole = lengths_of(seen, led.s, pieces, timed)
    return led, {
        "arm": cfg.arm,
        "t": led.s / pace,
        **samples(led.rows),
        **carried_along(cfg, len(led.rows)),
        "s": behind,
        "length": whole,
        "ended": last.kind,
        "reason": how_it_ended(cfg.arm, place, behind[-1], whole, last, what),
        "dq": led.dq,
        "ddq": led.ddq,
        "jumps": led.jumps,
    }


def lengths_of(
    cfg: Configuration, s: Array, pieces: Sequence[Segment], timed: bool
) -> tuple[Array, float]:
    """Return the length of path behind what is led (m,), and of the whole path."""
    if not timed:
        return s, sum(piece.length for piece in pieces)
    task, t = cfg.arm.task, np.linspace(0.0, pieces[0].length, KNOTS + 1)
    units = np.where(np.array(task.indices) < 3, 1.0, task.length or 1.0)
    v = np.array([np.linalg.norm(units * goals.goal_rows(cfg, pieces[0].twist(x))) for x in t])
    behind = np.append(0.0, np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t)))
    return np.interp(s, t, behind), float(behind[-1])


def check_start(
    cfg: Configuration, mode: BaseMode, limits: bool, timed: bool = True, what: str = "tip"
) -> None:
    """Refuse a start from which no path can be followed.

    Raises:
        ConfigurationError: It is singular, or beyond the joint limits where they count.
        UnsupportedError: The arm can never do its task, or there is momentum and no times.
    """
    arm = cfg.arm
    if not timed and (cfg.momentum.any() or cfg.wheels.any()):
        raise UnsupportedError(
            "the start has momentum on board, and the spacecraft turns with time; give times= at "
            f"which the {what} passes each corner"
        )
    require_possible(arm, mode)
    sigma = singular_values(cfg, mode=mode, axes=goals.goal_axes(cfg))
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


def how_it_ended(
    arm: SpaceArm, at: Array, s: float, length: float, end: Event, what: str = "tip"
) -> str:
    """Return where and why a motion ended, with what is led at a place (3,) [m]."""
    place = ", ".join(f"{x:.4g}" for x in at)
    unit = "m" if min(arm.task.indices) < 3 else "rad"
    if end.kind == "arrived":
        return f"arrived at ({place}) m after {s:.4g} {unit}"
    where = f"after {s:.4g} of {length:.4g} {unit}, {what} at ({place}) m"
    if end.kind == "joint limit":
        return f"joint {end.detail!r} reaches its limit {where}"
    q = arm.in_words(end.q)
    set_at = "" if end.nearest is None else f" at q = {arm.in_words(end.nearest)}"
    return f"singular {where}, q = {q}{end.detail}{set_at}: J* cannot lead the {what} on along it"
