"""Branch and bound for the least or the largest distance of a chain's tip, best boxes first."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from spacearm.kernels.cpu import kernel
from spacearm.kernels.floating import Indices, Numbers
from spacearm.kernels.lanes import part
from spacearm.kernels.reach.bounds import bound
from spacearm.kernels.reach.chain import Chain, place, places


class Boxes(NamedTuple):
    """Boxes that wait, in a binary heap: the one with the least bound is first.

    Attributes:
        centre: (most, n) their centres.
        half: (most, n) their half widths.
        least: (most,) their bounds.
        split: (most,) the joint to halve.
        heap: (most,) their numbers.
    """

    centre: Numbers
    half: Numbers
    least: Numbers
    split: Indices
    heap: Indices


@kernel
def lowest(
    chain: Chain,
    low: Numbers,
    high: Numbers,
    nearest: bool,
    known: float,
    slack: float,
    most: int,
) -> float:
    """Bound |p| from below over a box of joint positions, or -|p| if not `nearest`.

    Args:
        chain: The chain.
        low: (n,) corner of the box [rad].
        high: (n,) opposite corner [rad].
        nearest: Whether it is |p|.
        known: What is attained [m].
        slack: How much less the bound may be than what is attained, then or on the way [m].
        most: Largest number of boxes that wait.

    Returns:
        The bound [m], by more than the slack too low only after so many boxes.
    """
    n, sign, target = len(low), 1.0 if nearest else -1.0, known - slack
    w = places(n)
    wait = Boxes(
        np.empty((most, n)),
        np.empty((most, n)),
        np.empty(most),
        np.empty(most, np.int64),
        np.empty(most, np.int64),
    )
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    for j in range(n):
        if chain.rho[j] == 0.0:
            half[j] = 0.0
    wait.centre[0], wait.half[0] = centre, half
    place(chain, centre, half, w)
    wait.least[0] = bound(chain, half, nearest, w)
    wait.split[0] = np.argmax(w.errors)
    wait.heap[0] = 0
    waiting = used = 1
    while waiting > 0:
        top = wait.heap[0]
        reached = wait.least[top]
        if reached >= target or used == most:
            return min(reached, target)
        waiting = without_first(wait, waiting)
        j, free = wait.split[top], top
        centre[:], half[:] = wait.centre[top], wait.half[top]
        middle = centre[j]
        half[j] *= 0.5
        for side in (-1.0, 1.0):
            centre[j] = middle + side * half[j]
            place(chain, centre, half, w)
            least = max(bound(chain, half, nearest, w), reached)
            attained = sign * math.sqrt(w.p[0] ** 2 + w.p[1] ** 2 + w.p[2] ** 2)
            target = min(target, attained - slack)
            if least < target:
                wait.centre[free], wait.half[free] = centre, half
                wait.least[free], wait.split[free] = least, np.argmax(w.errors)
                add(wait, waiting, free)
                waiting += 1
                if free == used:
                    used += 1
                free = used
    return target


@part
def without_first(wait: Boxes, waiting: int) -> int:
    """Take the first box off the heap; return how many are left."""
    waiting -= 1
    last, i = wait.heap[waiting], 0
    while True:
        child = 2 * i + 1
        if child >= waiting:
            break
        if child + 1 < waiting and wait.least[wait.heap[child + 1]] < wait.least[wait.heap[child]]:
            child += 1
        if wait.least[wait.heap[child]] >= wait.least[last]:
            break
        wait.heap[i] = wait.heap[child]
        i = child
    wait.heap[i] = last
    return waiting


@part
def add(wait: Boxes, waiting: int, number: int) -> None:
    """Put a box on the heap."""
    i = waiting
    while i > 0:
        parent = (i - 1) // 2
        if wait.least[wait.heap[parent]] <= wait.least[number]:
            break
        wait.heap[i] = wait.heap[parent]
        i = parent
    wait.heap[i] = number
