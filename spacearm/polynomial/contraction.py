"""Values of trigonometric polynomials by contraction with real waves.

In the basis 1, cos q, ..., cos d q, sin q, ..., sin d q of each angle a real polynomial has as many
real numbers as it has complex coefficients. At m points the sum over about half of the angles is a
product with their waves, multiplied out; the other half follows. Blocks of points that fit the
second cache are computed at once, their products in pieces so small that the linear algebra library
keeps to one thread: its own threads get into each other's way on busy processors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from spacearm.arrays import Array
from spacearm.compiler import numbers
from spacearm.compiler.machine import processors
from spacearm.polynomial.univariate import Complex

BLOCK = 1 << 12
"""Points of a block: a thread's work at a time."""
NUMBERS, FEWEST = 1 << 16, 128
"""Half a megabyte of numbers is worked on at once, or so many points."""
ALONE = 1 << 18
"""Products of so many numbers OpenBLAS computes in one thread."""
PIECES = 8, 48
"""Fewest and most points of such a product."""
MANY = 20_000
"""Points at which waves were multiplied out before that is compiled."""


def to_real(c: Complex) -> Array:
    """Return complex coefficients, c_k at index k + d, in the basis of real waves."""
    for axis, size in enumerate(c.shape):
        c = np.moveaxis(np.tensordot(_basis(size // 2), c, (1, axis)), 0, axis)
    return np.ascontiguousarray(c.real)


def to_complex(a: Array, axes: Sequence[int]) -> Complex:
    """Return numbers in the basis of real waves along `axes` as complex coefficients there."""
    c = a.astype(complex)
    for axis in axes:
        inverse = np.linalg.inv(_basis(a.shape[axis] // 2))
        c = np.moveaxis(np.tensordot(inverse, c, (1, axis)), 0, axis)
    return c


@lru_cache(maxsize=32)
def _basis(d: int) -> Complex:
    """Return the matrix that takes c_-d ... c_d to the factors of 1, cos k q, sin k q."""
    T = np.zeros((2 * d + 1, 2 * d + 1), dtype=complex)
    T[0, d] = 1.0
    for k in range(1, d + 1):
        T[k, d + k], T[k, d - k] = 1.0, 1.0
        T[d + k, d + k], T[d + k, d - k] = 1j, -1j
    T.flags.writeable = False
    return T


def waves(xp: Any, q: Any, d: int) -> Any:
    """Compute 1, cos q, ..., cos d q, sin q, ..., sin d q the waves on the first axis."""
    phases = np.multiply.outer(np.arange(d + 1.0), q)
    return xp.concatenate([xp.cos(phases), xp.sin(phases[1:])])


def products(xp: Any, q: Any, degrees: Sequence[int]) -> Any:
    """Multiply out the waves of angles q (n, ...), the last one running fastest.

    Returns:
        (product of the 2 d + 1, ...).
    """
    highest = max(degrees, default=0)
    table, found = waves(xp, q, highest), np.ones((1, *np.shape(q)[1:]))
    for j, d in enumerate(degrees):
        own = [*range(d + 1), *range(highest + 1, highest + d + 1)]
        found = (found[:, None] * table[own, j]).reshape((-1, *np.shape(q)[1:]))
    return found


def contract(
    tensor: Array, Q: Array, keep: tuple[int, ...], last: Callable[[Array], Array] | None = None
) -> Array:
    """Sum over all axes of a tensor of real waves but those in `keep`, at points (m, n).

    Args:
        tensor: (2 d_1 + 1, ..., 2 d_n + 1).
        Q: (m, n) angles; those in `keep` do not matter.
        keep: Numbers of the axes that remain, in growing order.
        last: Applied to each block of the result, (2 d_j + 1 for j in keep, b).

    Returns:
        (2 d_j + 1 for j in keep, m), or what `last` makes of it, joined along the last axis.
    """
    summed = [j for j in range(tensor.ndim) if j not in keep]
    first, later = _halves([j for j in summed if tensor.shape[j] > 1], tensor.shape)
    constant = [j for j in summed if tensor.shape[j] == 1]
    kept = [tensor.shape[j] for j in keep]
    width = math.prod(tensor.shape[j] for j in first)
    matrix = np.ascontiguousarray(tensor.transpose(*first, *constant, *keep, *later)).reshape(
        width, -1
    )
    degrees = [tuple(tensor.shape[j] // 2 for j in group) for group in (first, later)]
    multiplied, axes = _Products.of(*degrees), np.array([*first, *later], dtype=np.intp)
    few = min(max(NUMBERS // sum(matrix.shape), FEWEST), BLOCK)

    def do(start: int) -> Array:
        q = Q[start : start + BLOCK, axes]
        values = np.empty((math.prod(kept), len(q)))
        for i in range(0, len(q), few):
            A, B = multiplied(q[i : i + few])
            partial = _product(A, matrix).reshape(len(A), len(values), B.shape[1])
            np.einsum("mkl,ml->km", partial, B, out=values[:, i : i + few])
        values = values.reshape(*kept, len(q))
        return values if last is None else last(values)

    starts = range(0, max(len(Q), 1), BLOCK)
    if len(starts) == 1:
        return do(0)
    with ThreadPoolExecutor(processors()) as pool:
        return np.concatenate(list(pool.map(do, starts)), -1)


class _Products:
    """The waves of two groups of angles, multiplied out; compiled where they are many.

    Args:
        first: Degrees in the angles of the first group.
        later: Those of the other.
    """

    def __init__(self, first: tuple[int, ...], later: tuple[int, ...]) -> None:
        self.degrees, self.points = (first, later), 0

    @classmethod
    @lru_cache(maxsize=256)
    def of(cls, first: tuple[int, ...], later: tuple[int, ...]) -> _Products:
        """Return the one of these degrees."""
        return cls(first, later)

    def __call__(self, Q: Array) -> tuple[Array, Array]:
        """Compute both products at angles (m, n), a row for each point."""
        self.points += len(Q)
        if self.points > MANY:
            return self._kernel({"q": Q})
        A, B = self._traced(numbers, Q.T)
        return A.T, B.T

    def _traced(self, xp: Any, q: Any) -> tuple[Any, Any]:
        """Compute both products at angles (n,) or (n, m)."""
        first, later = self.degrees
        return products(xp, q[: len(first)], first), products(xp, q[len(first) :], later)

    @cached_property
    def _kernel(self) -> Any:
        from spacearm.compiler import symbols
        from spacearm.compiler.kernel import compiled

        return compiled(lambda q: self._traced(symbols, q), {"q": (sum(map(len, self.degrees)),)})


def _product(A: Array, B: Array) -> Array:
    """Compute A (m, w) @ B (w, c) in pieces that the linear algebra library has one thread for."""
    (m, width), columns = A.shape, B.shape[1]
    piece = min(max(ALONE // (width * columns), PIECES[0]), PIECES[1])
    wide = max(ALONE // (piece * width), 1)
    found = np.empty((m, columns))
    whole = m - m % piece
    for left in range(0, columns, wide):
        part, out = B[:, left : left + wide], found[:, left : left + wide]
        for given, to in ((A[:whole], out[:whole]), (A[whole:], out[whole:])):
            if len(given):
                size = min(piece, len(given))
                np.matmul(
                    given.reshape(-1, size, width), part, out=to.reshape(-1, size, to.shape[1])
                )
    return found


def _halves(axes: list[int], shape: tuple[int, ...]) -> tuple[list[int], list[int]]:
    """Split axes in two groups, so that the products of their sizes are about the same."""
    groups: tuple[list[int], list[int]] = ([], [])
    sizes = [1, 1]
    for j in sorted(axes, key=lambda j: -shape[j]):
        smaller = int(sizes[1] < sizes[0])
        groups[smaller].append(j)
        sizes[smaller] *= shape[j]
    return groups
