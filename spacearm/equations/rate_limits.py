"""How fast an arm may follow a command: rates, accelerations, ends of joints, singular postures.

The rates y of a servo are scaled so that they, the accelerations and the momentum that wheels take
up keep their limits. The direction must turn no faster than the accelerations allow. An arm that
brakes from now on, while the commanded direction turns on, must stay within its limits of position
and farther than `stop` from the singular postures that are followed. See `equations.servo`, whose
`Limits`, `Memory` and `Known` these functions take. Angles count in radians of each joint.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from spacearm.equations.linear_algebra import bidiagonal, solve

#: Share of the accelerations that is left to turn by, and taken up by what the wish changes.
TURNING = 0.25
#: Share of the accelerations by which an arm that keeps its direction speeds up.
SPEEDING = 0.25
#: Share of the time in which an arm could stop for which the change of the wish is foreseen.
AHEAD = 0.5
#: Steps of Newton's method to the share that an end leaves.
NEWTON = 4
#: Share of `stop` beyond it before which an arm can stop; longest way of the arm in a tick, on
#: which no posture is lost [rad].
MARGIN, LONGEST_WAY = 0.02, 0.16
#: Longest way in a tick beyond that to `stop` [rad]; how much farther than `stop` the arm stays, by
#: the time of a tick [rad/s]: where the set branches, the nearest branch is found a tick late.
UNSEEN_WAY, UNSEEN = 0.006, 0.12
#: Share of `stop` beyond it where rates towards the set end.
EDGE = 0.04
#: Share of the rates that leads out within that edge.
OUTWARD = 0.1
#: Share of the wheels' budget that is taken: within long steps, and while an arm brakes, its
#: momentum is a little larger than at the places where it is told.
TAKEN = 0.99
#: Damping of motions in the null space that keep the attitude, as a share of the trace; how many
#: times the others they are at most.
DAMPING, LEVELS = 1e-5, 20.0
#: Share of the norm of J* up to which its least singular value is zero.
NO_INVERSE = 1e-9
#: Larger numbers are faults.
LARGEST = 1e9


def nearness(xp: Any, far: Any, limits: Any) -> Any:
    """Return x: 0 up to `stop`, 1 from `slow` on."""
    return xp.minimum(xp.maximum((far - limits.stop) / (limits.slow - limits.stop), 0.0), 1.0)


def held_off(xp: Any, y: Any, one: Any, limits: Any) -> Any:
    """Return y without what leads too fast towards a posture on the set."""
    known = xp.logical_and(one.far > 0.0, one.far < limits.slow)
    away = -one.offset / xp.where(known, one.far, 1.0)
    room, x = one.far - (1.0 + EDGE) * limits.stop, nearness(xp, one.far, limits)
    most = room / (limits.tau * xp.where(known, 1.0 - x, 1.0))
    most = xp.maximum(most, -OUTWARD * norm(xp, y))
    over = -(away @ y) - most
    return xp.where(xp.logical_and(known, over > 0.0), y + over * away, y)


def turning(xp: Any, y: Any, last: Any, memory: Any, limits: Any) -> tuple[Any, Any]:
    """Return the share of y with which the accelerations allow it to turn, and how fast it turns.

    It turns as since the last tick, or as fast as it will until the arm could have stopped.
    """
    went = memory.dt > 0.0
    per = xp.where(went, 1.0 / xp.where(went, memory.dt, 1.0), 0.0)
    turn = per * (y - memory.wished / limits.radians)
    time = AHEAD * extreme(xp.maximum, xp.absolute(last) / limits.acceleration)
    later = turn + time * per * (turn - memory.turn / limits.radians)
    most = xp.maximum(xp.absolute(turn), xp.absolute(later)) / limits.acceleration
    return at_most(xp, extreme(xp.maximum, most), TURNING), turn


def slowest(xp: Any, y: Any, moments: list[Any], limits: Any) -> tuple[Any, Any]:
    """Return the share of y that the rates leave, and that which the wheels leave of that.

    The moments (3, n) take y to the momentum of the arm at some places of its way.
    """
    rate = at_most(xp, extreme(xp.maximum, xp.absolute(y) / limits.rate), 1.0)
    most = extreme(xp.maximum, [norm(xp, moment @ y) for moment in moments])
    return rate, at_most(xp, most * rate, TAKEN * limits.wheels)


def shares_left(
    xp: Any, y: Any, turn: Any, x: Any, known: list[Any], dt: Any, braking: float,
    limits: Any,
) -> tuple[Any, Any]:  # fmt: skip
    """Return the shares of y that the ends of the joints leave, and the stopping distance.

    An arm that brakes in a straight line, by a share `braking` of the accelerations, comes
    y (dt + T / 2) far, T the time that it takes. With a direction that goes on turning by `turn`,
    as far as that leads towards an end, share s of it comes s y dt + s^2 y T / 2 + s^3 turn T^2 / 6
    far.
    """
    size = norm(xp, y)
    time = extreme(xp.maximum, xp.absolute(y) / (braking * limits.acceleration))

    def reaches(way: Any, rate: Any) -> Any:
        """Return the share s with rate (s dt + s^2 T / 2) = way, at most 1."""
        there = rate > 0.0
        length = xp.maximum(way, 0.0) / xp.where(there, rate, 1.0)
        root = dt + xp.sqrt(dt * dt + 2.0 * time * length)
        share = 2.0 * length / xp.where(root > 0.0, root, 1.0)
        return xp.where(there, xp.minimum(share, 1.0), 1.0)

    def turns(way: Any, rate: Any, turn: Any) -> Any:
        """Return the largest share that comes no farther, as the rate turns, by Newton's method."""
        share = 1.0
        for _ in range(NEWTON):
            far = share * (rate * dt + share * time * (0.5 * rate + share * time * turn / 6.0))
            slope = rate * dt + share * time * (rate + 0.5 * share * time * turn)
            over = xp.logical_and(far > way, slope > 0.0)
            share = share - xp.where(over, (far - way) / xp.where(over, slope, 1.0), 0.0)
        return xp.maximum(share, 0.0)

    def ends(rates: Any) -> list[Any]:
        return [xp.where(rates[j] > 0.0, limits.upper[j] - x[j], x[j] - limits.lower[j])
                for j in range(len(x))]  # fmt: skip

    position = extreme(xp.minimum, [
        reaches(way, xp.absolute(rate)) for way, rate in zip(ends(y), y, strict=True)
    ] + [
        turns(xp.maximum(way, 0.0), xp.where(by > 0.0, rate, -rate), xp.absolute(by))
        for way, rate, by in zip(ends(turn), y, turn, strict=True)
    ])  # fmt: skip
    room = extreme(xp.minimum, [one.far for one in known]) - limits.stop
    longest = xp.minimum(LONGEST_WAY, xp.maximum(room, 0.0) + UNSEEN_WAY)
    stopping = at_most(xp, size * dt, longest)
    for one in known:
        near = one.far < np.inf
        length = xp.where(near, one.far, 1.0)
        towards = (one.offset @ y) / xp.where(length * size > 0.0, length * size, 1.0)
        room = xp.maximum(length - (1.0 + MARGIN) * limits.stop, 0.0)
        root = xp.sqrt(towards * towards + 2.0 * room / limits.stop)
        way = xp.where(towards > 0.0, 2.0 * room / xp.where(towards > 0.0, towards + root, 1.0),
                       limits.stop * (root - towards))  # fmt: skip
        stopping = xp.where(near, xp.minimum(stopping, reaches(way, size)), stopping)
    return position, stopping


def accelerated(xp: Any, y: Any, last: Any, dt: Any, limits: Any) -> tuple[Any, Any, Any]:
    """Return the rates of an arm that brakes, the share of y that is done, and rates towards y.

    The latter are along y if the accelerations allow that, else between those that brake and y.
    """
    most = limits.acceleration * dt
    time = extreme(xp.maximum, xp.absolute(last) / limits.acceleration)
    brake = braked(xp, last, dt, limits)
    moves, change = xp.absolute(y) > 0.0, y - brake
    rate, rests = xp.where(moves, y, 1.0), xp.absolute(last) <= most
    ends = (last - most) / rate, (last + most) / rate
    least = xp.where(moves, xp.minimum(*ends), xp.where(rests, 0.0, LARGEST))
    low = xp.maximum(extreme(xp.maximum, least), 0.0)
    high = extreme(xp.minimum, xp.where(moves, xp.maximum(*ends), LARGEST))
    speed = extreme(xp.maximum, xp.absolute(y) / limits.acceleration)
    calm = (time + SPEEDING * dt) / xp.where(speed > 0.0, speed, 1.0)
    high = xp.where(speed > 0.0, xp.minimum(high, xp.maximum(low, calm)), high)
    along = xp.logical_and(low <= high, low < LARGEST)
    share = xp.where(along, xp.minimum(xp.maximum(low, 1.0), high), 0.0)
    left = xp.maximum(most - xp.where(change > 0.0, brake - last, last - brake), 0.0)
    by = extreme(xp.minimum, at_most(xp, xp.absolute(change), left))
    goes = xp.where(along, share * y, brake + by * change)
    return brake, xp.where(along, xp.minimum(share, 1.0), by), goes


def braked(xp: Any, last: Any, dt: Any, limits: Any) -> Any:
    """Return the rates of an arm that brakes for a time, in a straight line."""
    time = extreme(xp.maximum, xp.absolute(last) / limits.acceleration)
    goes_on = time > dt
    return last * xp.where(goes_on, 1.0 - dt / xp.where(goes_on, time, 1.0), 0.0)


def resolved(
    xp: Any, J: Any, least: Any, v: Any, far: Any, away: Any, limits: Any
) -> tuple[Any, Any]:
    """Return J^+ v with the motion along the lost direction slowed, and the share left of it."""
    regular = least.sigma > NO_INVERSE * xp.sqrt((J * J).sum())
    along = least.u @ v
    rest = bidiagonal(xp, J).solution(xp, v - along * least.u, np.zeros(J.shape[1] - len(v)))
    y = rest - (least.v @ rest) * least.v
    own = along / xp.where(regular, least.sigma, 1.0) * least.v
    share = xp.where(away @ own > 0.0, 1.0, nearness(xp, far, limits))
    return xp.where(regular, y + share * own, 0.0), xp.where(regular, share, 0.0)


def at_most(xp: Any, value: Any, most: Any) -> Any:
    """Return the share of a value that is at most so much."""
    over = value > most
    return xp.where(over, most / xp.where(over, value, 1.0), 1.0)


def norm(xp: Any, x: Any) -> Any:
    """Return the length of a vector."""
    return xp.sqrt((x * x).sum())


def extreme(of: Any, values: Any) -> Any:
    """Return the least, the largest, or whether all, of some numbers or masks."""
    found = values[0]
    for value in values[1:]:
        found = of(found, value)
    return found


def either(xp: Any, mask: Any, one: Any, other: Any) -> Any:
    """Return one tuple where the mask holds, else the other."""
    return type(one)(*(xp.where(mask, a, b) for a, b in zip(one, other, strict=True)))


def secant(xp: Any, found: tuple[Any, Any], missed: tuple[Any, Any]) -> Any:
    """Return the guess (n,) on the line through the last two found that misses least, as if linear.

    It goes no farther than they are apart; at first, when nothing was missed, it is what was found.
    """
    change = missed[1] - missed[0]
    square = change @ change
    known = xp.logical_and((missed[0] @ missed[0]) > 0.0, square > 0.0)
    back = xp.where(known, (change @ missed[1]) / xp.where(known, square, 1.0), 0.0)
    return found[1] - back * at_most(xp, xp.absolute(back), 1.0) * (found[1] - found[0])


def raising(xp: Any, null: list[Any], y: Any, far: Any, away: Any, limits: Any) -> Any:
    """Return the motion in the null space that raises the distance, no faster than y."""
    N = xp.stack(null)
    way = (N @ away) @ N
    rate = xp.where(far < limits.slow, (limits.slow - far) / limits.tau, 0.0)
    return xp.minimum(rate, norm(xp, y)) * way


def levelling(xp: Any, null: list[Any], A: Any, y: Any) -> Any:
    """Return the motion in the null space by which y turns the spacecraft least, damped.

    A (3, n) takes rates to those of the spacecraft. Where the null space hardly turns it, what
    makes up for y would be so fast that nothing were left of y, and would change its sign at once.
    So what is faster than `LEVELS` times y is damped, the more the less it turns the spacecraft.
    """
    N = xp.stack(null)
    B, turned = A @ N.T, A @ y
    whole, square = B.T @ B, turned @ turned

    def motion(damping: Any) -> Any:
        return solve(xp, whole + damping * np.eye(len(null)), -(B.T @ turned)[:, None])[:, 0]

    least = DAMPING * (whole * np.eye(len(null))).sum() + 1e-12
    z = motion(least)
    over = share_of(xp, square, LEVELS**2 * (y @ y)) - share_of(xp, square, z @ z)
    return motion(least + xp.maximum(over, 0.0)) @ N


def share_of(xp: Any, part: Any, whole: Any) -> Any:
    """Return part / whole, 1 where there is nothing."""
    there = whole > 0.0
    return xp.where(there, part / xp.where(there, whole, 1.0), 1.0)
