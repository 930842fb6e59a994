"""Values of trigonometric polynomials by contraction with real waves.

In the basis 1, cos q, ..., cos d q, sin q, ..., sin d q of each angle a real polynomial has as many
real numbers as it has complex coefficients. At m points one matrix product sums over about half of
the angles, whose waves are multiplied out first; the others follow point by point. Blocks of points
fit the processor cache, and several blocks are computed at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.kernels.lanes import LARGEST_ANGLE
from spacearm.kernels.processors import processors
from spacearm.kernels.waves import fill_waves
from spacearm.polynomial.univariate import Complex

CACHE = 1 << 16
"""Numbers that a block of work may hold, to stay in the processor cache."""
ALONE = 4
"""Number of blocks below which one thread computes them all."""

Integers = npt.NDArray[np.int_]


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
    if d == 0:
        rows[0] = 1.0
    elif np.abs(q).max(initial=0.0) > LARGEST_ANGLE:
        fill_waves(np.remainder(q, 2.0 * np.pi), rows)
    else:
        fill_waves(q, rows)
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
    summed = [j for j in range(tensor.ndim) if j not in keep]
    first, later = _halves(summed, tensor.shape)
    kept = [tensor.shape[j] for j in keep]
    width = math.prod(tensor.shape[j] for j in first)
    matrix = tensor.transpose(*keep, *later, *first).reshape(-1, width)

    def do(q: Array) -> Array:
        by_axis = np.ascontiguousarray(q.T)
        partial = matrix @ _product(by_axis, first, tensor.shape)
        if later:
            after = _product(by_axis, later, tensor.shape)
            partial = np.einsum(
                "klm,lm->km", partial.reshape(len(matrix) // len(after), *after.shape), after
            )
        partial = partial.reshape(*kept, len(q))
        return partial if last is None else last(partial)

    block = max(64, CACHE // sum(matrix.shape))
    if len(Q) <= block:
        return do(Q)
    return np.concatenate(in_blocks(do, [Q[i : i + block] for i in range(0, len(Q), block)]), -1)


def in_blocks(do: Callable[[Array], Array], blocks: list[Array]) -> list[Array]:
    """Apply a function to blocks, on all processors if there are many."""
    if len(blocks) < ALONE:
        return [do(block) for block in blocks]
    with ThreadPoolExecutor(processors()) as pool:
        return list(pool.map(do, blocks))


def _halves(axes: list[int], shape: tuple[int, ...]) -> tuple[list[int], list[int]]:
    """Split axes in two groups, so that the products of their sizes are about the same."""
    groups: tuple[list[int], list[int]] = ([], [])
    sizes = [1, 1]
    for j in sorted(axes, key=lambda j: -shape[j]):
        smaller = int(sizes[1] < sizes[0])
        groups[smaller].append(j)
        sizes[smaller] *= shape[j]
    return groups


def _product(q: Array, axes: list[int], shape: tuple[int, ...]) -> Array:
    """Multiply out the waves of several axes of angles (n, m), (product of their sizes, m)."""
    m = q.shape[1]
    product: Array = np.ones((1, m))
    for j in axes:
        if shape[j] > 1:
            wave = waves(q[j], shape[j] // 2)
            product = (product[:, None] * wave).reshape(len(product) * len(wave), m)
    return product
