"""The least and the largest distance of the tip from the system CM in a box of joints, proven.

In a box of a chain of joints both are found by branch and bound; `equations.reach` has the bounds
of a box. Over the whole torus of any tree the largest one is bounded from above as follows.

The tip from the CM is p = sum_k T_k b_k, with b_k constant in body k and T_k its rotation. The
largest |p| is the largest u . p over all directions u. Seen from body k, what it and the bodies
beyond it can add to that is

    h_k(u) = u . b_k + sum_c g_c(angle of u and the axis of joint c),   g_c(t) = max h_c(u),

c the joints on body k, the maximum over all u at the angle t from the axis of joint c: a turn of
the joint takes u around. So functions of one angle, made from the tip on, give the bound. Each is a
maximum of functions whose second derivatives are at most the length rho of what it adds: between
points at a distance s it is below the chord + rho s^2 / 8.
"""

from __future__ import annotations

from functools import lru_cache, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, Integers
from spacearm.compiler.machine import processors
from spacearm.equations.kinematics import Parameters, Structure
from spacearm.equations.reach import attitudes_at_zero, bound, constant_vectors
from spacearm.mechanics.arm_kernels import parameters_of, structure_of
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm


class Box(NamedTuple):
    """Range of the joints: a box that spans at most one turn in each.

    Attributes:
        low: (n,) lower corner.
        high: (n,) upper corner.
        limited: Whether it is less than the torus.
    """

    low: Array
    high: Array
    limited: bool

    @classmethod
    def of(cls, lower: Array, upper: Array, limits: bool) -> Box:
        """Return the box of the joint limits, or the torus."""
        whole = np.logical_or(upper - lower >= 2.0 * np.pi, not limits)
        low = np.where(whole, -np.pi, lower)
        return cls(low, np.where(whole, np.pi, upper), not whole.all())

    def fold(self, Q: Array) -> Array:
        """Move angles by whole turns to where the box begins."""
        return self.low + (Q - self.low) % (2.0 * np.pi)

    def holds(self, Q: Array) -> Any:
        """Check which folded configurations (..., n) are in the box."""
        return (self.high + 1e-12 >= Q).all(axis=-1)


#: Number of intervals of the angle to an axis, 0 to pi.
ANGLES = 4096
#: Intervals around an axis; into how many those that may hold the maximum are divided, how
#: often.
AROUND, FINER, REFINED = 128, 8, 2
#: Sine of the angle of two axes below which they are parallel.
PARALLEL = 1e-14
#: Share of the length of all that is added below which values are the same.
SAME = 1e-13


def largest_distance(
    arm: SpaceArm, mode: BaseMode, positions: tuple[Array, Array] | None = None
) -> float:
    """Bound the distance of the tip from the system CM over the whole torus, from above [m].

    For a fixed spacecraft from its own CM. At given angles the tip from the CM is affine in the
    positions of sliding joints, so that its largest distance is attained where each of them is at
    an end of its range. Joints that mimic others count as if they did not, which can only raise the
    bound.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        positions: Least and largest positions (n,) of the joints, of which those of sliding joints
            matter; None for arms without any.
    """
    tree, p = structure_of(arm, mode), parameters_of(arm)
    sliding = [k for k in range(1, len(tree.parents)) if tree.slides[k]]
    if positions is None or not sliding:
        return _largest_at(tree, p)
    low, high = positions
    gains = tree.gains[[k - 1 for k in sliding]]
    middle = tree.offsets[[k - 1 for k in sliding]] + gains @ (0.5 * (low + high))
    half = np.abs(gains) @ (0.5 * (high - low))
    largest = 0.0
    for signs in product((-1.0, 1.0), repeat=len(sliding)):
        moved = p.joint_positions.copy()
        for k, position in zip(sliding, middle + np.array(signs) * half, strict=True):
            axis = p.joint_rotations[k - 1] @ tree.turns[k][:, 2]
            moved[k - 1] = moved[k - 1] + position * axis
        largest = max(largest, _largest_at(tree, p._replace(joint_positions=moved)))
    return largest


def _largest_at(tree: Structure, p: Parameters) -> float:
    """Bound the distance from above with sliding joints where the parameters have them [m]."""
    E = attitudes_at_zero(tree, p)
    own, count = constant_vectors(tree, p), len(tree.parents)
    root, fixed_to = list(range(count)), [np.eye(3)] * count
    for k in range(1, count):
        if tree.slides[k]:  # it does not turn: a part of the body before
            parent = tree.parents[k]
            root[k], fixed_to[k] = root[parent], fixed_to[parent] @ E[k]
            own[root[k]] += fixed_to[k] @ own[k]
    turning = [k for k in range(count) if root[k] == k]
    axes = {c: fixed_to[tree.parents[c]] @ E[c][:, 2] for c in turning[1:]}
    length = np.linalg.norm(own, axis=1)
    tables: dict[int, Array] = {}
    for k in reversed(turning):
        beyond = [c for c in turning[1:] if root[tree.parents[c]] == k]
        for c in beyond:
            length[k] += length[c]
        reaches = [_Reach(axes[c], tables.pop(c), length[c]) for c in beyond]
        skew = [c for c in beyond if np.hypot(*axes[c][:2]) > PARALLEL]  # others do not vary
        off_axis = float(np.hypot(*own[k, :2])) + sum(float(length[c]) for c in skew)
        tables[k] = _largest_around(own[k], reaches, off_axis, SAME * length[k])
    step = np.pi / ANGLES
    return float(tables[0].max() + length[0] * (step**2 / 8.0 + 2.0 * SAME * count))


class _Reach:
    """What the bodies beyond a joint can add, an upper bound, by the angle of u to its axis."""

    def __init__(self, axis: Array, table: Array, length: float) -> None:
        self.axis, self.table = axis, table
        self.above = length * (np.pi / ANGLES) ** 2 / 8.0

    def __call__(self, cosine: Array) -> Array:
        x = np.arccos(np.clip(cosine, -1.0, 1.0)) * (ANGLES / np.pi)
        i = np.minimum(x.astype(np.intp), ANGLES - 1)
        low = self.table[i]
        return np.asarray(low + (x - i) * (self.table[i + 1] - low) + self.above)


def _largest_around(own: Array, reaches: list[_Reach], length: float, rounding: float) -> Array:
    """Bound the maxima (ANGLES + 1,) of h over all u at each angle from the z axis.

    `length` bounds the distance from that axis of all that is added.
    """
    t = np.linspace(0.0, np.pi, ANGLES + 1)
    high, low = np.cos(t), np.sin(t)

    def h(row: Integers, turn: Array) -> Array:
        cosine, sine, z = low[row] * np.cos(turn), low[row] * np.sin(turn), high[row]
        value = cosine * own[0] + sine * own[1] + z * own[2]
        for reach in reaches:
            a = reach.axis
            value = value + reach(cosine * a[0] + sine * a[1] + z * a[2])
        return value

    width = 2.0 * np.pi / AROUND
    row = np.arange(ANGLES + 1).repeat(AROUND)
    start = np.tile(width * np.arange(AROUND), ANGLES + 1)
    values = h(row, start).reshape(ANGLES + 1, AROUND)
    best = np.full(ANGLES + 1, -np.inf)
    left, right = values.ravel(), np.roll(values, -1, axis=1).ravel()
    for refinement in range(REFINED + 1):
        np.maximum.at(best, row, np.maximum(left, right))
        above = length * low[row] * width**2 / 8.0
        bound = np.maximum(left, right) + above
        if refinement == REFINED:
            break
        kept = bound > best[row] + rounding
        width /= FINER
        row, start = row[kept].repeat(FINER), start[kept]
        ends = np.stack((left[kept], right[kept]))
        start = (start[:, None] + width * np.arange(FINER)).ravel()
        inner = h(row, start).reshape(-1, FINER)
        inner[:, 0] = ends[0]
        left = inner.ravel()
        right = np.concatenate((inner[:, 1:], ends[1][:, None]), axis=1).ravel()
    most = best + rounding
    np.maximum.at(most, row, bound)
    return most


#: Share of the largest distance up to which a bound comes near to what is attained.
NEAR = 1e-5
#: Share of the length of the arm that rounding adds for each joint.
ROUNDING = 1e-13
#: Largest number of boxes that wait.
MOST = 1_000_000
#: So many boxes are halved at once, or that share of those that wait if it is more.
AT_ONCE, SHARE = 512, 8


def least_distance(arm: SpaceArm, mode: BaseMode, box: Box, known: Array) -> float:
    """Bound the distance of the tip from the system CM in a box, from below [m].

    0 where joints beside the way to the tip matter too.

    Args:
        arm: An arm of revolute joints, none of which mimics another.
        mode: What the spacecraft does.
        box: Range of the joints.
        known: (2,) distances that are attained; the bound need not be nearer to the first than
            `NEAR` times the second [m].
    """
    chain = chain_of(arm, mode)
    if chain is None or known[0] <= 0.0:
        return 0.0
    least = _lowest(chain, box, True, float(known[0]), float(NEAR * known[1]))
    return max(least - _rounding(chain), 0.0)


def largest_distance_within(arm: SpaceArm, mode: BaseMode, box: Box, known: Array) -> float:
    """Bound the distance of the tip from the system CM in a box, from above [m].

    That of the whole torus where joints beside the way to the tip matter too. Arguments as of
    `least_distance`, near the second distance here.
    """
    whole = largest_distance(arm, mode)
    chain = chain_of(arm, mode)
    slack = float(NEAR * known[1])
    if chain is None or not box.limited or whole <= known[1] + slack:
        return whole
    least = _lowest(chain, box, False, -float(known[1]), slack)
    return min(whole, _rounding(chain) - least)


class Chain(NamedTuple):
    """A chain of revolute joints; joint k carries body k. See `equations.reach.place`."""

    E: Array
    b: Array
    rho: Array
    middle: int


def chain_of(arm: SpaceArm, mode: BaseMode) -> Chain | None:
    """Return the constants of an arm whose joints all lead to the tip, else None."""
    tree, p = structure_of(arm, mode), parameters_of(arm)
    n = len(tree.parents) - 1
    if tree.tips[0] != n or tree.parents[1:] != tuple(range(n)):
        return None
    E, own, middle = attitudes_at_zero(tree, p), constant_vectors(tree, p), n // 2
    rho = np.zeros(n)
    inner = [E[k].T @ own[k - 1] for k in range(1, middle + 1)]
    rho[:middle] = _radii(inner, [abs(E[k][2, 2]) for k in range(2, middle + 1)])
    outer = list(range(n, middle, -1))
    rho[middle:] = _radii([own[k] for k in outer], [abs(E[k][2, 2]) for k in outer[:-1]])[::-1]
    rho[rho < ROUNDING * np.linalg.norm(own, axis=1).sum()] = 0.0
    return Chain(E, own, rho, middle)


def _radii(vectors: list[Array], cosines: list[float]) -> list[float]:
    """Bound how far from each axis the sum of the vectors so far can be, each in axes of its joint.

    `cosines` are those of the angles between one axis and the next.
    """
    radii, radius, length = [], 0.0, 0.0
    for v, cosine in zip(vectors, (1.0, *cosines), strict=False):
        tilted = radius + np.sqrt(max(1.0 - cosine**2, 0.0)) * length
        radius = float(np.hypot(v[0], v[1]) + min(length, tilted))
        length += float(np.linalg.norm(v))
        radii.append(radius)
    return radii


def _rounding(chain: Chain) -> float:
    """Bound what rounding adds [m]."""
    return ROUNDING * len(chain.rho) * float(np.linalg.norm(chain.b, axis=1).sum())


def _lowest(chain: Chain, box: Box, nearest: bool, known: float, slack: float) -> float:
    """Bound |p| from below over a box of joint positions, or -|p| if not `nearest` [m].

    Branch and bound, many boxes with the least bounds at a time.

    Args:
        chain: The chain.
        box: The box.
        nearest: Whether it is |p|.
        known: What is attained [m].
        slack: How much less the bound may be than what is attained, then or on the way [m].
    """
    numbers, target = {"E": chain.E, "b": chain.b, "rho": chain.rho}, known - slack
    kernel = _bounds(len(chain.rho), chain.middle, nearest)

    def tried(centre: Array, half: Array, before: Array) -> _Boxes:
        threads = processors() if len(half) > AT_ONCE else 1
        bound, size, errors = kernel({"q": centre, "half": half}, numbers, threads=threads)
        nonlocal target
        target = min(target, (size if nearest else -size).min() - slack)
        least = np.maximum(bound, before)
        return _Boxes(centre, half, least, errors.argmax(axis=1)).where(least < target)

    half = np.where(chain.rho == 0.0, 0.0, 0.5 * (box.high - box.low))
    wait = tried(0.5 * (box.low + box.high)[None], half[None], np.full(1, -np.inf))
    while len(wait.least):
        reached = float(wait.least.min())
        if reached >= target or len(wait.least) >= MOST:
            return min(reached, target)
        count = max(AT_ONCE, len(wait.least) // SHARE)
        order = np.argpartition(wait.least, min(count, len(wait.least)) - 1)
        now, later = wait.where(order[:count]), wait.where(order[count:])
        row = np.arange(len(now.least))
        now.half[row, now.split] *= 0.5
        step = np.zeros_like(now.half)
        step[row, now.split] = now.half[row, now.split]
        found = tried(
            np.concatenate((now.centre - step, now.centre + step)),
            np.concatenate((now.half, now.half)),
            np.concatenate((now.least, now.least)),
        )
        wait = _Boxes(*map(np.concatenate, zip(later, found, strict=True)))
        wait = wait.where(wait.least < target)
    return target


class _Boxes(NamedTuple):
    """Boxes that wait: (m, n) centres and half widths, (m,) bounds and joints to halve."""

    centre: Any
    half: Any
    least: Any
    split: Any

    def where(self, chosen: npt.NDArray[Any]) -> _Boxes:
        """Return some of them."""
        return _Boxes(*(values[chosen] for values in self))


@lru_cache(maxsize=32)
def _bounds(n: int, middle: int, nearest: bool) -> Any:
    """Return the machine code of `equations.reach.bound`, for all chains of n joints."""
    from spacearm.compiler import symbols
    from spacearm.compiler.kernel import compiled

    return compiled(
        partial(bound, symbols, middle, nearest),
        {"q": (n,), "half": (n,)},
        {"E": (n + 1, 3, 3), "b": (n + 1, 3), "rho": (n,)},
    )
