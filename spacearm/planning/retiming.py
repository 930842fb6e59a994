"""Time-optimal timing: as fast along a path as the motors of a floating arm allow."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
from scipy.interpolate import CubicSpline

from spacearm.arrays import Array, ArrayLike, within
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, imported
from spacearm.mechanics.dynamics import inverse_dynamics, momentum_and_torque
from spacearm.mechanics.floating import carried_along, placed, samples
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.flights import load_peaks
from spacearm.motion.motion import Motion
from spacearm.motion.plant import WheelHold
from spacearm.planning.many_curves import FlownRows
from spacearm.planning.problem import ROUNDING, beyond_limits, contact_as_flown
from spacearm.planning.reactions import Wheels, load_of
from spacearm.planning.result import Plan
from spacearm.planning.strategies.attitude_held import slowed
from spacearm.planning.timing import corners, for_each_joint, largest_rates, rate_bounds
from spacearm.signatures import checked
from spacearm.singularities.nearest import angle
from spacearm.singularities.sets import prove_way


class Limits:
    """The limits of a motion, infinite where there is none.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        rate: Largest joint rates [rad/s] or [m/s], one or (n,); those of the description if None.
        acceleration: Largest joint accelerations [rad/s^2] or [m/s^2], likewise; none if None.
        torque: Largest torques [N m] or forces [N], likewise; those of the description if None.
        wheels: The wheels that hold the attitude; None if none do.

    Raises:
        ConfigurationError: One is not a positive number, nor one per joint.
        UnsupportedError: Neither accelerations nor torques have limits.
    """

    def __init__(
        self,
        arm: SpaceArm,
        mode: BaseMode,
        rate: ArrayLike | None,
        acceleration: ArrayLike | None,
        torque: ArrayLike | None,
        wheels: Wheels | None,
    ) -> None:
        self.arm, self.mode, self.wheels = arm, mode, wheels
        none = np.full(arm.n, np.inf)
        efforts = np.array([arm.tree.joints[name].effort for name in arm.joint_names])
        self.rate = for_each_joint(arm, rate, "rate", largest_rates(arm))
        self.acceleration = for_each_joint(arm, acceleration, "acceleration", none)
        self.torque = for_each_joint(arm, torque, "torque", efforts)
        unlimited = np.isinf(self.acceleration) & np.isinf(self.torque)
        if unlimited.any():
            name = arm.joint_names[int(unlimited.argmax())]
            raise UnsupportedError(
                f"{arm.name}: nothing limits how fast joint {name!r} changes its rate: its "
                "description gives no effort; give torque or acceleration"
            )

    def load(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the shares of the limits that accelerations (n,) take.

        Torques come first, those of wheels last.
        """
        tau = inverse_dynamics(self.arm.at(q), dq, ddq, mode=self.mode).tau
        used, most = np.append(tau, ddq), np.append(self.torque, self.acceleration)
        if self.wheels is not None:
            spun = momentum_and_torque(self.arm, q[None], dq[None], ddq[None])[1][0]
            used = np.append(used, self.wheels.shares @ spun)
            most = np.append(most, self.wheels.torque)
        return np.asarray(used / most)[np.isfinite(most)]

    def fastest(self, q: Array, slope: Array) -> Array:
        """Return the rates (m,) of a path's parameter at which joints or wheels are at a limit.

        Args:
            q: (m, n) joint positions on the path.
            slope: (m, n) their derivative by the parameter.
        """
        with np.errstate(divide="ignore"):
            found = (self.rate / np.abs(slope)).min(axis=1)
        if self.wheels is None:
            return found
        taken = momentum_and_torque(self.arm, q, slope, np.zeros_like(slope))[0]
        return np.minimum(found, self.wheels.fastest(taken))

    def slowdown(self, q: Array, dq: Array, ddq: Array) -> float:
        """Return the factor by which a motion (m, n) must be slower for the limits to hold.

        At zero momentum and without gravity torques fall with its square.
        """
        rate = (np.abs(dq) / self.rate).max()
        load = max(np.abs(self.load(*row)).max() for row in zip(q, dq, ddq, strict=True))
        return float(max(rate, np.sqrt(load)))

    def slowdown_as_flown(self, motion: Motion, jumps: bool) -> float:
        """Return the factor by which a motion must be slower for the limits to hold as it is flown.

        Bounds between the rows count. Those of the wheels are seen to by `slowed`.

        Args:
            motion: The motion.
            jumps: Whether its torques and accelerations jump, which no spline through its rows
                does: then only the rates count.
        """
        found = [(rate_bounds(motion.spline) / self.rate).max()]
        if jumps:
            return float(found[0])
        if np.isfinite(self.acceleration).any():
            bends = rate_bounds(motion.spline.derivative())
            found.append(np.sqrt((bends / self.acceleration).max()))
        if np.isfinite(self.torque).any():
            torques = load_peaks(motion).bound[: self.arm.n]
            found.append(np.sqrt((torques / self.torque).max()))
        return float(max(found))


def smooth_pieces(q: Array, divided: int) -> list[CubicSpline]:
    """Return twice differentiable curves (n,) through joint positions, from corner to corner.

    The parameter of each begins at 0 and grows with the length of the straight lines between its
    knots.

    Args:
        q: (m, n) joint positions.
        divided: Knots in each straight line between rows: the more, the nearer the curves are to
            these lines, and the sharper they bend.
    """
    rows = q[np.append(True, np.abs(np.diff(q, axis=0)).max(axis=1) > 0.0)]
    share = np.arange(divided * (len(rows) - 1) + 1) / divided
    knots = np.column_stack([np.interp(share, np.arange(len(rows)), x) for x in rows.T])
    pieces = pairwise(corners(np.diff(knots, axis=0)))
    return [_curve(knots[first : last + 1]) for first, last in pieces]


def _curve(knots: Array) -> CubicSpline:
    """Return a cubic spline through knots (m, n)."""
    length = np.linalg.norm(np.diff(knots, axis=0), axis=1)
    return CubicSpline(np.append(0.0, np.cumsum(length)), knots)


AnyMotion = TypeVar("AnyMotion", Motion, Plan)

#: Share of the duration over which torques build up, unless given.
RISE = 0.1
#: Points of a piece of path at which its rate is sought.
GRID = 200
#: Times at which that rate is smoothed.
FINE = 4000
#: Rows of the result.
ROWS = 400
#: Rows of a piece, at least.
FEWEST = 30
#: Limits of which the fastest motion takes less than this share are seen to afterwards.
UNFELT = 1e-3
#: Largest and least rates along a path, in paths for about the time that one takes.
FASTEST, LEAST = 100.0, 1e-12
#: Knots between two rows, tried in order.
DIVIDED = (1, 2, 4, 8)


@checked
def time_optimal(
    motion: AnyMotion,
    *,
    torque: ArrayLike | None = None,
    rate: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    wheels: WheelHold | None = None,
    rise: float = RISE,
) -> AnyMotion:
    """Retime a motion along its path to be as fast as its joints allow, from rest to rest.

    The path is a smooth curve through the motion's rows; at its sharp corners the joints come to
    rest. The fastest timing that keeps the limits is found by reachability analysis: Pham & Pham,
    IEEE Trans. Robot. 34(3), 645-659 (2018), DOI 10.1109/TRO.2018.2819195, with the library toppra
    (extra `timing`). Torques are those of the floating arm at zero momentum, or in the motion's
    mode. They would jump at the ends and wherever another limit becomes active, so a moving
    average, a raised cosine over `rise`, makes them continuous, from zero to zero. Then time is
    stretched until all limits hold. If wheels hold the attitude of a plan, torque and momentum of
    each stay within its limits too, at every instant.

    Args:
        motion: The motion, at zero momentum, or held by wheels; a `Plan` remains one, others become
            a `Motion`.
        torque: Largest torques [N m] or forces [N], one number or (n,); if None the efforts of the
            description.
        rate: Largest joint rates [rad/s] or [m/s], likewise; if None those of the description, and
            0.5 where it gives none.
        acceleration: Largest joint accelerations [rad/s^2] or [m/s^2], likewise; no limit if None.
        wheels: Limits of each wheel that holds the attitude of a plan; if None those of the
            description.
        rise: Share of the duration over which torques build up, from 0 to 1. With 0 they jump;
            torques and accelerations then keep their limits at the rows only.

    Returns:
        The motion with new times and rows. Joint limits, clearance and collisions of a plan are
        checked again.

    Raises:
        ConfigurationError: An argument does not make sense, or the motion stays where it is.
        UnsupportedError: The plan ends with a twist, the motion has momentum that no wheels hold,
            toppra is not installed (pip install 'spacearm[timing]'), or nothing limits the
            acceleration of a joint.
        NoSolutionError: The smooth path violates what the plan keeps; names it.

    Example:
        >>> import spacearm as sa
        >>> plan = sa.plan(sa.load("planar2").at([0.3, 1.2]), (0.9, 1.4))
        >>> fast = sa.time_optimal(plan, torque=20.0, rate=2.0)
        >>> bool(fast.t[-1] < 0.5 * plan.t[-1]), fast.certificate.free
        (True, True)
    """
    rise = within(rise, "rise", 0.0, 1.0, "a share of the duration")
    if isinstance(motion, Plan) and motion.final_rates.any():
        raise UnsupportedError(
            "the plan ends with a twist of the tip, which another timing would change; give plan a "
            "shorter duration"
        )
    holds = _wheels(motion, wheels)
    if len(motion) < 2 or not np.ptp(motion.q, axis=0).any():
        raise ConfigurationError(f"{motion!r} stays where it is; there is nothing to time")
    limits = Limits(motion.arm, motion.mode, rate, acceleration, torque, holds)
    for divided in DIVIDED:
        pieces = smooth_pieces(motion.q, divided)
        timed = _timed(motion, pieces, [_fastest(piece, limits, rise) for piece in pieces])
        over = limits.slowdown_as_flown(timed, jumps=rise == 0.0)
        timed = replace(timed, t=timed.t * max(1.0, over))
        if holds is not None:
            timed = replace(timed, **slowed(timed.arm, timed.t, timed.q, holds))
        broken = _broken(motion, timed)
        if broken is None:
            return timed
    raise NoSolutionError(f"the smooth path through the plan's rows breaks what it keeps: {broken}")


def _wheels(motion: Motion, hold: WheelHold | None) -> Wheels | None:
    """Return the wheels that hold the attitude of a plan; None if none do.

    Raises:
        UnsupportedError: The motion has momentum that they do not hold.
        ConfigurationError: Limits are given and no wheels hold the attitude.
        NoSolutionError: A wheel is full at the start.
    """
    if not isinstance(motion, Plan) or not motion.wheel_load or motion.mode == "free-floating":
        if hold is not None:
            raise ConfigurationError(
                "wheels have limits, and none hold the attitude of this motion"
            )
        if motion[0].momentum.any():
            raise UnsupportedError(
                f"the {type(motion).__name__} has momentum on board, so that the base depends on "
                "its times; give a motion at zero momentum"
            )
        return None
    if motion.momentum[0, :3].any():
        raise UnsupportedError("the system CM moves on, so that the plan depends on its times")
    found = Wheels.of(motion[0], hold)
    found.slowdown(load_of(motion.arm, motion.spline))  # refuses wheels that are full
    return found


def _fastest(path: CubicSpline, limits: Limits, rise: float) -> CubicSpline:
    """Return where along a path (its parameter) a motion is over time, from rest to rest."""
    t, rate = _smoothed(*_bang_bang(path, limits), rise)
    along, length = CubicSpline(t, rate).antiderivative()(t), path.x[-1]
    s = CubicSpline(t, along * (length / along[-1]), bc_type="clamped")
    few = np.linspace(0.0, t[-1], GRID)
    u, du, ddu = (s(few, order)[:, None] for order in range(3))
    u = np.clip(u[:, 0], 0.0, length)
    q, slope, bend = (path(u, order) for order in range(3))
    slower = limits.slowdown(q, slope * du, bend * du**2 + slope * ddu)
    return CubicSpline(slower * t, s(t), bc_type="clamped")


def _bang_bang(path: CubicSpline, limits: Limits) -> tuple[Array, Array]:
    """Return times (m,) and the rates of the parameter (m,) of the fastest motion along a path.

    The length of the path and about the time it takes are the units, as the numbers of toppra's
    linear programs must not be far from one.
    """
    toppra = imported("toppra", "toppra", "timing")
    grid, length = np.linspace(0.0, 1.0, GRID), path.x[-1]
    curve = toppra.SplineInterpolator(path.x / length, path(path.x))
    slope = curve(grid, 1)
    rows = zip(curve(grid), np.zeros((GRID, limits.arm.n)), slope, strict=True)
    most = np.abs([limits.load(*row) for row in rows]).max(axis=0)
    felt = most > UNFELT * most.max()
    along = limits.fastest(curve(grid), slope)
    unit = max(np.sqrt(most.max()), (1.0 / along).max())
    rates = np.minimum(along * unit, FASTEST)[:, None] * np.abs(slope) + LEAST
    both = np.vstack((np.eye(felt.sum()), -np.eye(felt.sum())))

    def load(q: Array, dq: Array, ddq: Array) -> Array:
        return limits.load(q, dq / unit, ddq / unit**2)[felt]

    def rate(u: float) -> Array:
        most = np.array([np.interp(u, grid, one) for one in rates.T])
        return np.column_stack((-most, most))

    of, ones = toppra.constraint, np.ones(len(both))
    constraints = [
        of.JointVelocityConstraintVarying(rate),
        of.SecondOrderConstraint(load, lambda _: both, lambda _: ones, limits.arm.n),
    ]
    found = toppra.algorithm.TOPPRA(constraints, curve, gridpoints=grid, solver_wrapper="seidel")
    found.compute_parameterization(0.0, 0.0)
    speed = found.problem_data.sd_vec
    if speed is None or not np.isfinite(speed).all():
        raise NoSolutionError(f"toppra found no timing: {found.problem_data.return_code.value}")
    steps = 2.0 * np.diff(grid) / np.maximum(speed[:-1] + speed[1:], LEAST)
    return unit * np.append(0.0, np.cumsum(steps)), speed


def _smoothed(t: Array, rate: Array, rise: float) -> tuple[Array, Array]:
    """Return times and rates after a moving average over a share of the duration."""
    step = t[-1] / FINE
    width = round(rise * FINE)
    fine = np.interp(np.arange(FINE + 1) * step, t, rate)
    window = np.hanning(width + 2)[1:-1] if width > 1 else np.ones(1)
    smooth = np.convolve(fine, window / window.sum())
    return np.arange(len(smooth)) * step, smooth


def _timed(motion: AnyMotion, pieces: list[CubicSpline], along: list[CubicSpline]) -> AnyMotion:
    """Return a motion along pieces of path, each with its parameter over time."""
    start = np.append(0.0, np.cumsum([s.x[-1] for s in along]))
    t, ways = [np.zeros(1)], [motion.q[:1]]
    for path, s, before in zip(pieces, along, start, strict=False):
        rows = max(FEWEST, round(ROWS * s.x[-1] / start[-1]))
        times = np.linspace(0.0, s.x[-1], rows + 1)[1:]
        t.append(before + times)
        ways.append(path(np.clip(s(times), 0.0, path.x[-1])))
    rows = _walked(motion, np.concatenate(t), np.vstack(ways))
    timed = {"t": np.concatenate(t), **samples(rows)}
    if isinstance(motion, Plan):
        return replace(motion, **timed, **carried_along(motion[0], len(rows)))
    return Motion(motion.arm, **timed, mode=motion.mode)


def _walked(motion: Motion, t: Array, q: Array) -> list[Configuration]:
    """Return the configurations along joint positions (m, n), the spacecraft as its mode has it.

    A floating one turns along the curve a little more or less than along the rows of the motion;
    the curve is bent so that it ends as it did, and the tip with it.
    """
    start = motion[0]
    if motion.mode == "free-floating":
        wheels, rest = np.zeros((len(t), len(motion.arm.wheels))), np.zeros(motion.arm.n)
        flown = FlownRows(start, t, q, wheels, rest)
        flown, T = flown.landed({len(t) - 1: motion[-1].base.rotation})
        return [placed(start, *row) for row in zip(flown.q, T, strict=True)]
    if motion.mode == "attitude-controlled":
        return [placed(start, row, start.base.rotation) for row in q]
    return [motion.arm.at(row, base=start.base) for row in q]


def _broken(before: Motion, timed: Motion) -> str | None:
    """Return what a plan keeps and its timed motion does not, in words; None where all is kept."""
    if not isinstance(before, Plan) or not isinstance(timed, Plan):
        return None
    arm, points, kept = timed.arm, timed.control_points, before.control_points
    lower = np.minimum(arm.lower, kept.min(axis=(0, 1))) - ROUNDING
    upper = np.maximum(arm.upper, kept.max(axis=(0, 1))) + ROUNDING
    if over := beyond_limits(arm, points, lower, upper):
        return over
    if (proof := before.certificate) is not None:
        least = min(before.clearance, proof.clearance)
        flown = prove_way(arm, timed.mode, points, least)
        if proof and flown is not None and not flown:
            return f"only {angle(flown.clearance, down=True)} to singular postures are proven"
    contact = contact_as_flown(timed) if before.apart else None
    return None if contact is None else str(contact)
