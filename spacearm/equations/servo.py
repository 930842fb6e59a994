"""A tick of the servo: the commanded twist of the tip as joint rates that keep away from the set.

With J* = U diag(s) V^T, far from the singular set dq = J*^+ v. Nearer than `slow` only the
direction u of the least singular value is slowed, by a share that falls to zero at `stop`, and the
distance d to the set may fall no faster than

    d' >= -(d - stop) / tau (1 - x),    x = (d - stop) / (slow - stop):

what of dq leads faster towards the set is taken out; motions along it and away stay. Null spaces
raise the distance. Then the rates are scaled so that rates, accelerations and the momentum that
wheels take up keep their limits, so that the wish turns no faster than the accelerations allow, and
so that an arm that brakes from now on, as its wish turns on, stays within its limits of position
and beyond `stop`. A change of direction that the accelerations do not allow is mixed
with braking instead. Braking is always allowed by what held a tick before.

The rates hold until the next tick. So J* and the axes of the twist are those in the middle of the
way on which they lead, guessed from the last rates and, if the twist would be off, from those
found: where sigma_min is a ten-thousandth of sigma_max, a way 1e-4 off turns the twist by degrees.

The distance is that to singular postures that are followed from tick to tick: four, the nearest
that are known, and five scouts. These set out from the arm's posture, at random, and ahead, and
take the place of the farthest, or of one close by, when they come to rest nearer, for all that
their residual may hide. So each is found, and the nearest of all is no farther, but where sigma_min
has a valley: its slope there may take a point that is not on the set to be nearly on it, and tell
of it for a tick. Where the set folds, steps along it may come to rest nowhere: a scout that is so
near to the arm, and to the set beside it, that something nearer must be there is followed as it is.
Each goes towards the point nearest to the arm's posture on the set linearised at itself: by a whole
step of Newton's method to the set, and along it by a share. Where the set bends more than the
sphere about the posture, whole steps would lead ever farther away; the share is that by which the
last two ways along the set would have become least: Barzilai & Borwein, IMA J. Numer. Anal. 8(1),
141-148 (1988), DOI 10.1093/imanum/8.1.141. Beside the set it is less: in a valley, steps that long
leave the nearest posture itself. After a long way, or a long tick, they take a step for each part
of the arm's way. All angles x count in radians of each joint; see `model.joints.joint_scales`.
"""

from __future__ import annotations

from functools import lru_cache
from math import prod, sqrt
from typing import Any, Literal, NamedTuple

import numpy as np

from spacearm.equations.kinematics import (
    Parameters,
    Posture,
    Structure,
    base_twist,
    connection_at,
    posture,
    task_jacobian_at,
)
from spacearm.equations.laws import attitude, quaternion_rate
from spacearm.equations.linear_algebra import least_with_vectors
from spacearm.equations.measures import distance
from spacearm.equations.rate_limits import (
    LARGEST,
    LONGEST_WAY,
    TURNING,
    UNSEEN,
    accelerated,
    at_most,
    braked,
    either,
    extreme,
    held_off,
    levelling,
    norm,
    raising,
    resolved,
    secant,
    share_of,
    shares_left,
    slowest,
    turning,
)

#: Axes in which the twist is given.
Frame = Literal["inertial", "spacecraft", "tip"]
#: Singular postures that are followed, and those that look for nearer ones.
KEPT, SCOUTS = 4, 5
SLOTS = KEPT + SCOUTS
#: Ticks until a scout sets out again, and until motion begins after nothing was known.
PATIENCE, SEARCH = 24, 80
#: Residual beyond which a posture is not on the set, way below which a scout is at rest and one
#: that is followed, distance below which two are one, longest step [rad].
LOST, AT_REST, SETTLED, APART, STRIDE = 0.02, 0.02, 0.045, 0.02, 0.4
#: Share of its distance from the arm's posture that a residual may be on whole ways along the set.
BESIDE = 0.02
#: In how many parts at most the arm's last way is searched, and how long one is [rad], [s].
LOOKS, LOOK, LASTS = 8, 0.02, 0.0125
#: How often at most the way to come is guessed, how far off its end may be [rad], and that times
#: the rates that a twist of 1 takes: by about that share the twist is off.
GUESSES, AIM, ASTRAY = 6, 1e-3, 0.01
#: What of the memory the search changes.
SEARCHED = ("points", "ways", "shares", "ages", "count")
#: How many times the arm's last way a posture at rest may lag behind.
LAG = 1.0
#: Share of the way along the set that the first step takes, and the least; square of the changes of
#: a way below which the share is that of the first [rad^2].
SHARE, LEAST, SMOOTH = 0.7, 0.02, 1e-5
#: Share of the distance of one that a scout must be nearer than to be followed instead; how often
#: its residual counts then.
NEARER, DOUBTED = 0.99, 3.0
#: Scouts set out within this times the distance, `stop` or `slow` if that is more, and no farther
#: than that [rad].
BEYOND, WITHIN = 1.2, 1.5
#: How many set out on all sides; nearer than `slow` the others set out ahead of an arm that moves,
#: with this share of chance. One is lost beyond this times the widest way.
AROUND, SPREAD, ASIDE = 2, 0.5, 1.5
#: Stands for a posture that holds nothing [rad].
FREE = 1e6
#: Shortest time of a tick [s].
SHORTEST = 1e-9
#: How far the square of a quaternion may be from 1.
UNIT_LENGTH = 1e-3
#: By which share a time may be longer than the longest, by rounding.
ROUNDING = 1e-6
#: What positions may jump besides twice the largest rates [rad].
JITTER = 2e-3
#: What slows a motion, in the order of `Tick.shares`.
CAUSES = ("lost direction", "approach", "rate", "wheels", "position", "stopping distance",
          "acceleration")  # fmt: skip
#: What halts it, by `Tick.halt`.
HALTS = ("", "q", "quaternion", "twist", "dt", "momentum", "jump", "search", "numbers")


class Seen(NamedTuple):
    """What the servo is told at a tick.

    Attributes:
        q: (n,) joint positions [rad] or [m].
        quaternion: (4,) attitude of the spacecraft, xyzw.
        twist: (6 tips,) the commanded twist of the tips [linear; angular].
        dt: Time until the next tick [s].
        momentum: (6,) momentum of spacecraft and arm, inertial axes.
    """

    q: Any
    quaternion: Any
    twist: Any
    dt: Any
    momentum: Any


class Limits(NamedTuple):
    """What the servo keeps.

    Attributes:
        lower: (n,) least joint positions [rad] or [m].
        upper: (n,) largest ones.
        rate: (n,) largest rates [rad/s] or [m/s].
        acceleration: (n,) largest accelerations [rad/s^2] or [m/s^2].
        stop: Distance to the set that is kept [rad].
        slow: Distance beyond which nothing is slowed [rad].
        tau: Time constant of the approach [s].
        wheels: Largest angular momentum of the moving arm that wheels take up [N m s].
        longest: Longest time of a tick [s].
        fading: As of `measures.distance`.
        radians: (n,) what counts as a radian of each joint.
    """

    lower: Any
    upper: Any
    rate: Any
    acceleration: Any
    stop: Any
    slow: Any
    tau: Any
    wheels: Any
    longest: Any
    fading: Any
    radians: Any


class Memory(NamedTuple):
    """What the servo remembers between ticks.

    Attributes:
        rates: (n,) the last joint rates [rad/s] or [m/s].
        wished: (n,) those that do all of the commanded twist.
        turn: (n,) the rate at which these change.
        held: (n,) the nearest posture that was told, in radians; `FREE` farther than `slow`.
        q: (n,) the last joint positions [rad] or [m].
        dt: The last time of a tick [s].
        points: (SLOTS, n) singular postures that are followed, and scouts, in radians.
        ways: (SLOTS, n) the last way of each along the set, in radians.
        shares: (SLOTS,) share of it that was taken.
        ages: (SLOTS,) ticks since each set out; of those that are followed 0.
        count: Ticks since the search began; negative where nothing is known.
    """

    rates: Any
    wished: Any
    turn: Any
    held: Any
    q: Any
    dt: Any
    points: Any
    ways: Any
    shares: Any
    ages: Any
    count: Any


class Tick(NamedTuple):
    """What a tick gives.

    Attributes:
        rates: (n,) joint rates [rad/s] or [m/s].
        distance: To the nearest singular posture that is followed [rad]; inf if there is none.
        nearest: (n,) that posture [rad] or [m].
        away: (n,) joint motion that leads away from it, per radian of distance.
        lost: (6 tips,) direction of the tip's twist that is being lost, towards the set, in the
            axes of the commanded twist.
        closing: Rate at which the distance falls [rad/s].
        done: Share of the commanded twist that is done, from 0 to 1.
        shares: (7,) what each of `CAUSES` leaves of the motion.
        halt: Which of `HALTS` it is.
    """

    rates: Any
    distance: Any
    nearest: Any
    away: Any
    lost: Any
    closing: Any
    done: Any
    shares: Any
    halt: Any


class Followed(NamedTuple):
    """A posture on its way along the set.

    Attributes:
        point: (n,) where it goes [rad].
        way: (n,) to the nearest point of the set linearised where it was.
        share: Share of the part along the set that it takes.
        offset: (n,) of that point from the arm's posture.
        far: Residual: its own distance from the set.
        normal: (n,) of the set linearised there.
        slide: (n,) part of the way along the set.
    """

    point: Any
    way: Any
    share: Any
    offset: Any
    far: Any
    normal: Any
    slide: Any


class Known(NamedTuple):
    """A posture on the set that is kept off.

    Attributes:
        offset: (n,) of it from the arm's posture [rad].
        far: Distance.
        normal: (n,) of the set linearised there.
    """

    offset: Any
    far: Any
    normal: Any


@lru_cache
def shapes(kind: Any, n: int, tips: int) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the fields of `Seen`, `Limits`, `Memory` or `Tick`."""
    numbers = ("dt", "stop", "slow", "tau", "wheels", "longest", "fading", "count", "distance",
               "closing", "done", "halt")  # fmt: skip
    known: dict[str, tuple[int, ...]] = dict.fromkeys(numbers, ())
    known |= {"quaternion": (4,), "momentum": (6,), "twist": (6 * tips,), "lost": (6 * tips,)}
    known |= dict.fromkeys(("points", "ways"), (SLOTS, n)) | {"ages": (SLOTS,)}
    known["shares"] = (SLOTS,) if kind is Memory else (len(CAUSES),)
    return {name: known.get(name, (n,)) for name in kind._fields}


def size(kind: Any, n: int, tips: int) -> int:
    """Return how many numbers such a tuple holds."""
    return sum(map(prod, shapes(kind, n, tips).values()))


def packed(values: Any, xp: Any = np) -> Any:
    """Return the fields of a tuple one after the other."""
    return xp.concatenate([xp.asarray(value).reshape(-1) for value in values])


def unpacked(kind: Any, values: Any, n: int, tips: int) -> Any:
    """Return a tuple of what `packed` joined."""
    found, begin = [], 0
    for shape in shapes(kind, n, tips).values():
        size = prod(shape)
        found.append(values[begin : begin + size].reshape(shape) if shape else values[begin])
        begin += size
    return kind(*found)


def flat_step(
    xp: Any, tree: Structure, p: Parameters, *, given: Any, limits: Any, frame: Frame,
    keep_attitude: bool,
) -> Any:  # fmt: skip
    """Take a tick: `Seen` and `Memory` packed to `Tick` and `Memory` packed."""
    n, tips = tree.n, len(tree.tips)
    first = size(Seen, n, tips)
    seen, memory = unpacked(Seen, given[:first], n, tips), unpacked(Memory, given[first:], n, tips)
    kept = unpacked(Limits, limits, n, tips)
    tick, memory = step(xp, tree, p, seen, kept, memory, frame, keep_attitude)
    return packed((*tick, *memory), xp)


def unknowing(n: int, q: Any, points: Any = ()) -> Memory:
    """Return the memory of a servo at rest at q (n,) that knows singular points (m, n), m <= KEPT.

    They are in radians. It searches before it moves.
    """
    zero, every, ages = np.zeros(n), np.zeros((SLOTS, n)), np.full(SLOTS, 1.0 + PATIENCE)
    m = len(points)
    every[:m], ages[:m] = np.reshape(points, (m, n)), 0.0
    return Memory(
        zero, zero, zero, zero + FREE, q, 0.0, every, 0.0 * every, np.full(SLOTS, SHARE), ages, -1.0
    )


def step(
    xp: Any, tree: Structure, p: Parameters, seen: Seen, limits: Limits, memory: Memory,
    frame: Frame, keep_attitude: bool,
) -> tuple[Tick, Memory]:  # fmt: skip
    """Take a tick.

    Args:
        xp: The array library.
        tree: The structure of an arm with at least as many joints as the task has rows.
        p: Its numbers.
        seen: What is told.
        limits: What is kept.
        memory: Of the last tick.
        frame: Axes of the twist.
        keep_attitude: Whether the null space keeps the spacecraft's attitude.

    Returns:
        The rates and what is told of them, and the memory.
    """
    (q, quaternion, twist, dt, momentum), radians = seen, limits.radians
    limits = limits._replace(**{
        name: getattr(limits, name) / radians for name in ("lower", "upper", "rate", "acceleration")
    })  # fmt: skip
    last, before = memory.rates / radians, memory.q
    square = (quaternion * quaternion).sum()
    small = [xp.absolute(x).sum() <= LARGEST for x in (q, quaternion, twist, momentum)]
    real = xp.logical_and(dt >= SHORTEST, dt <= (1.0 + ROUNDING) * limits.longest)
    tick = xp.where(real, dt, memory.dt)
    more = xp.minimum(UNSEEN * tick, 0.5 * (limits.slow - limits.stop))
    limits = limits._replace(stop=limits.stop + more)
    began = memory.count >= 0.0
    q = xp.where(small[0], q, before + memory.rates * memory.dt)  # where it is, as far as known
    reach = 2.0 * limits.rate * xp.maximum(tick, memory.dt) + JITTER
    moved = xp.absolute(q - before) / radians
    still = extreme(xp.logical_and, moved <= reach)
    jumps = xp.logical_and(began, xp.logical_not(still))
    unit = xp.absolute(square - 1.0) <= UNIT_LENGTH
    sound = [small[0], xp.logical_and(small[1], unit), small[2], real, small[3]]
    halt = 0.0
    for number, right in reversed([*enumerate(sound, 1)]):
        halt = xp.where(right, halt, 1.0 * number)
    quaternion = xp.where(sound[1], quaternion, np.array([0.0, 0.0, 0.0, 1.0]))
    twist, momentum = xp.where(small[2], twist, 0.0), xp.where(small[3], momentum, 0.0)

    x = q / radians
    fresh = xp.logical_or(jumps, xp.logical_not(began))
    known, after = _searched(xp, tree, p, x, memory, fresh, limits)
    searching = after.count < SEARCH
    halt = xp.where(halt > 0.0, halt, xp.where(jumps, 6.0, xp.where(searching, 7.0, 0.0)))

    known.append(_released(xp, x, memory, fresh, tick, limits))
    far, offset, normal = _nearest(xp, known)
    size = norm(xp, offset)
    held = xp.where(far < limits.slow, x + offset * (far / xp.where(size > 0.0, size, 1.0)), FREE)
    away = -offset * (1.0 / xp.where(xp.logical_and(far > 0.0, far < np.inf), far, 1.0))
    away = xp.where(far > 0.0, away, normal)

    level, moment = attitude(xp, quaternion), tree.gains * radians
    turned = posture(xp, tree, p, q).P[:, 3:].T @ moment

    def move(guess: Any, found: Any, missed: Any, slower: Any, *_told: Any) -> tuple[Any, ...]:
        """Return the rates that do the twist in the middle of the way that rates as guessed go.

        Before them the next guess. The share that lets y turn stays that of the first: on a slower
        way y turns less, so the next share would be larger, the one after it smaller, and so on.
        """
        half = 0.5 * tick * at_most(xp, norm(xp, guess) * tick, LONGEST_WAY)
        at = posture(xp, tree, p, q + half * radians * guess)
        own = _own_twist(xp, tree, at, level, momentum)
        w = connection_at(xp, tree, at) @ (radians * guess) + own[3:]
        R = attitude(xp, quaternion + half * quaternion_rate(xp, quaternion, w))
        J = task_jacobian_at(xp, tree, at) * radians
        least = least_with_vectors(xp, J)
        turns = _axes(frame, R, at, len(tree.tips))
        wished = _turned(xp, turns, twist) - _drift(xp, tree, at, R, momentum)
        v = tree.scale[:, 0] * wished[np.array(tree.rows)]
        y, slowed = resolved(xp, J, least, v, far, away, limits)
        if keep_attitude:
            y = y + levelling(xp, least.null, connection_at(xp, tree, at) * radians, y)
        elif least.null:
            y = y + raising(xp, least.null, y, far, away, limits)
        asked = y
        for _ in range(2):
            for one in known:
                y = held_off(xp, y, one, limits)
        then = at.P[:, 3:].T @ moment
        moments = [turned, then, 2.0 * then - turned]  # at the beginning, in the middle, at the end
        share, turn = turning(xp, y, last, memory, limits)
        slower = xp.where(slower > 1.0, share, slower)
        rate, wheels = slowest(xp, slower * y, moments, limits)
        left = slower * rate * wheels

        def allowed(y: Any, turn: Any, braking: float) -> Any:
            return shares_left(xp, y, turn, x, known, tick, braking, limits)

        shares = allowed(left * y, left * turn, 1.0 - TURNING)
        scaled = y * (left * xp.minimum(*shares))
        brake, by, goes = accelerated(xp, scaled, last, tick, limits)
        whole = [*slowest(xp, goes, moments, limits), *allowed(goes, 0.0 * y, 1.0)]
        mixed = xp.where(extreme(xp.minimum, whole) >= 1.0 - 1e-9, goes, brake)
        rates = xp.where(halt > 0.0, brake, mixed)
        kept = share_of(xp, (asked * y).sum(), (asked * asked).sum())
        along = xp.maximum((v * (J @ rates)).sum(), 0.0)
        done = xp.minimum(share_of(xp, along, (v * v).sum()), 1.0)
        told = xp.stack([slowed, xp.minimum(kept, 1.0), rate, wheels, *shares, slower * by])
        lost = _lost(xp, tree, turns, xp.where(least.v @ away > 0.0, -least.u, least.u))
        miss = rates - guess
        off = norm(xp, miss) * tick
        goes_on = xp.logical_or(off > AIM, off * norm(xp, y) > ASTRAY * norm(xp, v))
        guess = secant(xp, (found, rates), (missed, miss))
        return guess, rates, miss, slower, y, turn, told, lost, done, goes_on

    zero = 0.0 * x
    none = np.zeros(len(CAUSES)), np.zeros(len(seen.twist)), 0.0
    start = last, last, zero, 2.0, zero, zero, *none
    _, rates, _, _, y, turn, told, lost, done = xp.while_any(move, *start, most=GUESSES)
    tick_ = Tick(
        radians * rates, far, radians * (x + offset), radians * away, lost, -(away @ rates), done,
        told, halt,
    )  # fmt: skip
    mine = {"rates": tick_.rates, "wished": radians * y, "turn": radians * turn, "held": held}
    return _secured(xp, tick_, memory, after._replace(**mine, q=q, dt=tick), last, limits)


def _secured(
    xp: Any, tick: Tick, before: Memory, memory: Memory, last: Any, limits: Limits
) -> tuple[Tick, Memory]:
    """Return tick and memory as they are if all that is and was remembered is finite.

    If not, the arm halts and knows nothing: it brakes from its last rates (n,), in radians, if
    they are finite, else it rests.
    """
    sound = xp.absolute(packed((*before, *memory), xp)).sum() < np.inf
    dt = xp.where(memory.dt < np.inf, memory.dt, 0.0)
    brake = limits.radians * braked(xp, last, dt, limits)
    brake = xp.where(xp.absolute(brake).sum() < np.inf, brake, 0.0)
    q = xp.where(xp.absolute(memory.q).sum() < np.inf, memory.q, 0.0)
    none = np.zeros(len(tick.lost)), 0.0, 0.0, np.zeros(len(CAUSES))
    halted, nothing = Tick(brake, np.inf, q, 0.0 * q, *none, 8.0), unknowing(len(q), q)
    return either(xp, sound, tick, halted), either(xp, sound, memory, nothing._replace(rates=brake))


def _searched(
    xp: Any, tree: Structure, p: Parameters, x: Any, memory: Memory, fresh: Any, limits: Limits
) -> tuple[list[Known], Memory]:
    """Follow and search in parts of the way since the last tick; return what is known at its end.

    Long ways have more parts, and those that took long.
    """
    begun = memory.q / limits.radians
    often = xp.minimum(at_most(xp, norm(xp, x - begun), LOOK), at_most(xp, memory.dt, LASTS))
    part = xp.where(fresh, 1.0, xp.maximum(often, 1.0 / LOOKS))

    def look(gone: Any, q: Any, *state: Any) -> tuple[Any, ...]:
        left = 1.0 - gone - part
        at = x - xp.where(left > 1e-9, left, 0.0) * (x - begun)
        then = memory._replace(q=q, **dict(zip(SEARCHED, state, strict=False)))
        count = xp.where(fresh, 0.0, then.count + 1.0)
        follow = _follower(xp, tree, p, at, limits.fading, limits.radians)
        known, now = _follow(xp, follow, at, then, fresh, count, limits)
        kept = (getattr(now, name) for name in SEARCHED)
        found = (xp.stack(of) for of in zip(*known, strict=True))
        return gone + part, limits.radians * at, *kept, *found, left > 1e-9

    every = np.zeros((KEPT, len(x)))
    state = [getattr(memory, name) for name in SEARCHED]
    _, _, *state = xp.while_any(
        look, 0.0, memory.q, *state, every, np.zeros(KEPT), every, most=LOOKS
    )
    after = memory._replace(**dict(zip(SEARCHED, state, strict=False)))
    return [Known(*(of[j] for of in state[len(SEARCHED) :])) for j in range(KEPT)], after


def _follower(xp: Any, tree: Structure, p: Parameters, x: Any, fading: Any, radians: Any) -> Any:
    """Return a function that takes a posture a step to the set and along it, towards x (n,).

    It takes the posture (n,), its last way along the set (n,) and the share of that.
    """

    def follow(point: Any, last: Any, share: Any) -> tuple[Any, ...]:
        far, _, rows = distance(xp, tree, p, radians * point, fading, radians)
        X = point - x
        first = xp.where(far < np.inf, far, 0.0) * np.eye(len(rows))[0]
        offset = (rows @ X - first) @ rows
        way = offset - X
        normal = -first[0] * rows[0]
        slide = way - normal
        size = norm(xp, way)
        there = xp.logical_and(far < LARGEST, size < LARGEST)
        went, change = share * at_most(xp, norm(xp, last), STRIDE) * last, slide - last
        least = (SMOOTH * SHARE - went @ change) / (SMOOTH + change @ change)
        moved = xp.logical_and(there, (last * last).sum() > 0.0)
        share = xp.where(moved, xp.minimum(xp.maximum(least, LEAST), 1.0), SHARE)
        share = share * at_most(xp, far, BESIDE * norm(xp, X))
        step = share * slide + normal
        step = at_most(xp, norm(xp, step), STRIDE) * step
        return (
            xp.where(there, point + step, np.inf), xp.where(there, way, 0.0), share,
            xp.where(there, offset, 0.0), xp.where(there, far, np.inf), rows[0],
            xp.where(there, slide, 0.0),
        )  # fmt: skip

    called = xp.procedure(follow)
    return lambda *begun: Followed(*called(*begun))


def _follow(
    xp: Any, follow: Any, x: Any, memory: Memory, fresh: Any, count: Any, limits: Limits
) -> tuple[list[Known], Memory]:
    """Take a step with all postures that are followed; scouts set out, or take a place.

    Returns:
        Those that are followed; the memory with all of them.
    """
    found = [follow(memory.points[i], memory.ways[i], memory.shares[i]) for i in range(SLOTS)]
    ages = [xp.where(fresh, 1.0 + PATIENCE, memory.ages[i]) for i in range(SLOTS)]
    ahead = x - memory.q / limits.radians
    went = norm(xp, ahead)
    ahead, still = ahead * (1.0 / xp.where(went > 0.0, went, 1.0)), AT_REST + LAG * went
    longest = [xp.maximum(still, SETTLED)] * KEPT + [still] * SCOUTS
    sizes = [_size(xp, *of) for of in zip(found, ages, longest, strict=True)]
    for i in range(KEPT):  # of two that have become one the nearer goes on
        for j in range(i):
            same = norm(xp, found[i].point - found[j].point) < APART
            nearer = sizes[i] < sizes[j]
            gone = xp.logical_and(same, nearer), xp.logical_and(same, xp.logical_not(nearer))
            sizes[j], sizes[i] = (
                xp.where(one, np.inf, size)
                for one, size in zip(gone, (sizes[j], sizes[i]), strict=True)
            )
    nearest = extreme(xp.minimum, sizes[:KEPT])
    starts, moves = [], xp.logical_and(went > 0.0, nearest < limits.slow)
    for i in range(SCOUTS):
        least = limits.slow if i % 2 else limits.stop
        wide = xp.minimum(BEYOND * xp.maximum(nearest, least), WITHIN)
        start = sqrt(3.0 / len(x)) * _chance(xp, SCOUTS * count + i, len(x))
        if i >= AROUND:
            start = xp.where(moves, ahead + SPREAD * start, start)
        starts.append(x + wide * start)
    starts[0] = xp.where(_rest(xp, count, 4.0) < 0.5, x, starts[0])
    lost = ASIDE * xp.minimum(BEYOND * xp.maximum(nearest, limits.slow), WITHIN)
    for i, start in zip(range(KEPT, SLOTS), starts, strict=True):
        scout = found[i]
        rests = xp.logical_and(sizes[i] < np.inf, norm(xp, scout.way) < still)
        bound = xp.where(sizes[i] < np.inf, _bound(xp, scout), np.inf)
        worst, place = sizes[0], 0.0 * limits.stop
        for j in range(1, KEPT):
            farther = sizes[j] > worst
            worst, place = xp.where(farther, sizes[j], worst), xp.where(farther, 1.0 * j, place)
        for j in range(KEPT):  # or that of one nearby
            close = norm(xp, scout.point - found[j].point) < APART
            close = xp.logical_and(sizes[j] < np.inf, close)
            worst = xp.where(close, NEARER * sizes[j], worst)
            place = xp.where(close, 1.0 * j, place)
        sure = xp.logical_and(bound < NEARER * nearest, bound < worst)
        takes = xp.where(rests, sizes[i] + DOUBTED * scout.far < worst, sure)
        for j in range(KEPT):
            mine = xp.logical_and(takes, xp.absolute(place - j) < 0.5)
            found[j] = either(xp, mine, scout, found[j])
            sizes[j], ages[j] = xp.where(mine, sizes[i], sizes[j]), xp.where(mine, 0.0, ages[j])
        on_the_way = xp.logical_and(ages[i] < PATIENCE, norm(xp, scout.point - x) < lost)
        goes = xp.logical_and(on_the_way, xp.logical_not(rests))
        found[i] = either(xp, goes, scout, scout._replace(point=start, slide=0.0 * x, share=SHARE))
        ages[i] = xp.where(goes, ages[i] + 1.0, 0.0)
    known = []
    for j in range(KEPT):
        there = sizes[j] < np.inf
        whole = found[j].offset
        offset = xp.where(there, at_most(xp, norm(xp, whole), sizes[j]) * whole, 0.0)
        known.append(Known(offset, xp.where(there, sizes[j], np.inf), found[j].normal))
        ages[j] = xp.where(there, 0.0, 1.0 + PATIENCE)
        lost = found[j]._replace(point=x)
        found[j] = either(xp, found[j].far < np.inf, found[j], lost)
    points, ways, shares = (
        xp.stack([getattr(one, name) for one in found]) for name in ("point", "slide", "share")
    )
    after = memory._replace(points=points, ways=ways, shares=shares)
    return known, after._replace(ages=xp.stack(ages), count=count)


def _size(xp: Any, one: Followed, age: Any, still: Any) -> Any:
    """Return how far a posture on the set is, inf of one that is not on it or not in use.

    Of one on a longer way than `still` it is what the set may be at most: it bends on the way.
    """
    on = xp.logical_and(one.far < LOST, age < 1.0 + PATIENCE)
    most, rests = _bound(xp, one), norm(xp, one.way) < still
    return xp.where(on, xp.where(rests, xp.minimum(norm(xp, one.offset), most), most), np.inf)


def _bound(xp: Any, one: Followed) -> Any:
    """Return how far the set may be at most by what one saw, wherever it comes to rest."""
    return norm(xp, one.offset - one.way) + DOUBTED * one.far


def _chance(xp: Any, number: Any, n: int) -> Any:
    """Return numbers (n,) between -1 and 1, spread evenly over all of them.

    The squares of the numbers times powers of the root of z^(n + 1) = z + 1 (Roberts, 2018), which
    stay even where every tenth is taken, say; whole multiples of 2^-20, so that they are exact.
    """
    z = 2.0
    for _ in range(60):
        z = (1.0 + z) ** (1.0 / (n + 1))
    steps = np.array([round(z ** -(j + 1.0) * 2**20) / 2**20 for j in range(n)])
    number = _rest(xp, number, 4096.0)
    return 2.0 * _rest(xp, number * number * steps, 1.0) - 1.0


def _rest(xp: Any, x: Any, size: float) -> Any:
    """Return what is left of x by whole multiples of a power of two."""
    return x - size * xp.floor(x / size)


def _released(xp: Any, x: Any, memory: Memory, fresh: Any, tick: Any, limits: Limits) -> Known:
    """Return the nearest posture of the last tick as far as it may have gone, if within `slow`.

    So none that is followed no more is let go faster than `slow` is approached.
    """
    way = memory.held - x
    size = norm(xp, way)
    far = size + limits.slow / limits.tau * tick
    there = xp.logical_and(xp.logical_not(fresh), xp.logical_and(size > 0.0, far < limits.slow))
    offset = xp.where(there, way * (far / xp.where(there, size, 1.0)), 0.0)
    return Known(offset, xp.where(there, far, np.inf), 0.0 * x)


def _nearest(xp: Any, known: list[Known]) -> tuple[Any, Any, Any]:
    """Return distance, offset and normal of the nearest posture that is followed."""
    nearest = known[0]
    for one in known[1:]:
        nearest = either(xp, one.far < nearest.far, one, nearest)
    return nearest.far, nearest.offset, nearest.normal


def _axes(frame: Frame, R: Any, at: Posture, tips: int) -> list[Any]:
    """Return rotations (3, 3) from the axes of the twist of each tip to those of the spacecraft."""
    if frame == "tip":
        return [at.tip_rotations[i] for i in range(tips)]
    return [R.T if frame == "inertial" else np.eye(3)] * tips


def _turned(xp: Any, turns: list[Any], twist: Any) -> Any:
    """Return twists (6 tips,) in other axes."""
    return xp.concatenate([
        T @ twist[6 * i + j : 6 * i + j + 3] for i, T in enumerate(turns) for j in (0, 3)
    ])  # fmt: skip


def _drift(xp: Any, tree: Structure, at: Posture, R: Any, momentum: Any) -> Any:
    """Return the twists (6 tips,) of tips that are held still, by the momentum."""
    own = _own_twist(xp, tree, at, R, momentum)
    return xp.concatenate([
        part for r in at.tip_positions for part in (own[:3] + xp.cross(own[3:], r), own[3:])
    ])  # fmt: skip


def _own_twist(xp: Any, tree: Structure, at: Posture, R: Any, momentum: Any) -> Any:
    """Return the twist (6,) of the spacecraft by the momentum."""
    h = xp.concatenate([R.T @ momentum[:3], R.T @ momentum[3:]])
    return base_twist(xp, tree, at, h[:, None])[:, 0]


def _lost(xp: Any, tree: Structure, turns: list[Any], u: Any) -> Any:
    """Return the direction u (k,) of the task as twists (6 tips,) in the axes of the wished one."""
    own = tree.scale[:, 0] * u
    rows = [0.0 * u[0]] * (6 * len(turns))
    for i, row in enumerate(tree.rows):
        rows[row] = own[i]
    found = _turned(xp, [T.T for T in turns], xp.stack(rows))
    return found / norm(xp, found)
