"""The least and the largest distance of a chain's tip from the system CM in a box, proven.

Branch and bound over the joints: `equations.reach` has the bounds of a box.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.compiler.machine import processors
from spacearm.equations.reach import attitudes_at_zero, bound, constant_vectors
from spacearm.mechanics.many import parameters_of, structure_of
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.workspaces.box import Box
from spacearm.workspaces.outermost import largest_distance

NEAR = 1e-5
"""Share of the largest distance up to which a bound comes near to what is attained."""
ROUNDING = 1e-13
"""Share of the length of the arm that rounding adds for each joint."""
MOST = 1_000_000
"""Largest number of boxes that wait."""
AT_ONCE, SHARE = 512, 8
"""So many boxes are halved at once, or that share of those that wait if it is more."""


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
