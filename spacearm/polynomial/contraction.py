"""Values of trigonometric polynomials by contraction with real waves.

In the basis 1, cos q, ..., cos d q, sin q, ..., sin d q of each angle a real polynomial has as many
real numbers as it has complex coefficients. At m points the sum over about half of the angles is a
product with their waves, multiplied out; the other half follows. Blocks of points are computed at
once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np

from spacearm.arrays import Array
from spacearm.kernels.lanes import LARGEST_ANGLE
from spacearm.kernels.processors import processors
from spacearm.kernels.waves import fill_waves, sums
from spacearm.polynomial.univariate import Complex

BLOCK = 1 << 12
"""Points of a block: a thread's work at a time."""


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


def waves(q: Array, d: int) -> Array:
    """Compute 1, cos q, ..., cos d q, sin q, ..., sin d q at angles (m,), as (2 d + 1, m)."""
    rows = np.empty((2 * d + 1, len(q)))
    fill_waves(_small(q), rows)
    return rows


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
    first, later = _halves([j for j in range(tensor.ndim) if j not in keep], tensor.shape)
    kept = [tensor.shape[j] for j in keep]
    width = math.prod(tensor.shape[j] for j in first)
    matrix = np.ascontiguousarray(tensor.transpose(*keep, *later, *first))
    matrix = matrix.reshape(math.prod(kept), -1, width)
    axes = np.array(first, dtype=np.int_), np.array(later, dtype=np.int_), np.array(tensor.shape)
    angles = np.ascontiguousarray(_small(Q))

    def do(start: int) -> Array:
        q = angles[start : start + BLOCK]
        summed = np.empty((len(matrix), len(q)))
        sums(matrix, q, *axes, summed)
        summed = summed.reshape(*kept, -1)
        return summed if last is None else last(summed)

    starts = range(0, max(len(Q), 1), BLOCK)
    if len(starts) == 1:
        return do(0)
    with ThreadPoolExecutor(processors()) as pool:
        return np.concatenate(list(pool.map(do, starts)), -1)


def _small(q: Array) -> Array:
    """Return angles that the kernels take: those in use, or what is left of full turns."""
    return np.remainder(q, 2.0 * np.pi) if (np.abs(q) > LARGEST_ANGLE).any() else q


def _halves(axes: list[int], shape: tuple[int, ...]) -> tuple[list[int], list[int]]:
    """Split axes in two groups, so that the products of their sizes are about the same."""
    groups: tuple[list[int], list[int]] = ([], [])
    sizes = [1, 1]
    for j in sorted(axes, key=lambda j: -shape[j]):
        smaller = int(sizes[1] < sizes[0])
        groups[smaller].append(j)
        sizes[smaller] *= shape[j]
    return groups
