"""Values of trigonometric polynomials by contraction with real waves, at points and on grids.

In the basis 1, cos q, ..., cos d q, sin q, ..., sin d q of each angle a real polynomial has as
many real numbers as it has complex coefficients. At m points the sum over about half of the angles
is a product with their waves, multiplied out; the other half follows. Blocks of points that fit
the second-level cache are computed at once. Their products are cut into pieces so small that the
linear algebra library keeps to one thread, as its own threads get into each other's way on busy
processors.

On a dense grid the tensor is contracted with one axis after the other. The last step, which makes
all the values, is a product with the 2 d + 1 waves of one axis of low degree d: a few flops for
each value. A block of values fits the processor cache, so that what is done with it there (a sign,
a least value, a count) costs no traffic to memory, which is slower than the arithmetic.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple, TypeVar

import numpy as np

from spacearm.arrays import Array
from spacearm.compiler import numbers
from spacearm.compiler.machine import processors
from spacearm.polynomial.univariate import Complex
from spacearm.processes import Threads

#: Points of a block: a thread's work at a time.
BLOCK = 1 << 12
#: Half a megabyte of numbers is worked on at once, or so many points.
NUMBERS, FEWEST = 1 << 16, 128
#: Products of so many numbers OpenBLAS computes in one thread.
ALONE = 1 << 18
#: Fewest and most points of such a product.
PIECES = 8, 48
#: Points at which tensors of a shape were summed before that is compiled.
MANY = 20_000
#: Tensors of so many numbers are summed by machine code alone.
SMALL = 256


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
    k = np.arange(1, d + 1)
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
        tensor: (2 d_1 + 1, ..., 2 d_n + 1); axes in `keep` may have any length.
        Q: (m, n) angles; those in `keep` do not matter, nor need they be there.
        keep: Numbers of the axes that remain, in growing order.
        last: Applied to each block of the result, (2 d_j + 1 for j in keep, b).

    Returns:
        (2 d_j + 1 for j in keep, m), or what `last` makes of it, joined along the last axis.
    """
    sums = _sums(tensor.shape, keep)
    matrix = sums.matrix(tensor)

    def do(start: int) -> Array:
        values = sums(matrix, Q[start : start + BLOCK])
        return values if last is None else last(values)

    starts = range(0, max(len(Q), 1), BLOCK)
    if len(starts) == 1:
        return do(0)
    with Threads(processors()) as pool:
        return np.concatenate(list(pool.map(do, starts)), -1)


class _Sums:
    """Sums over axes of tensors of one shape; compiled where there are many.

    Args:
        shape: Shape of the tensors.
        keep: Numbers of the axes that remain.
    """

    def __init__(self, shape: tuple[int, ...], keep: tuple[int, ...]) -> None:
        summed = [j for j in range(len(shape)) if j not in keep]
        first, later = _halves([j for j in summed if shape[j] > 1], shape)
        constant = [j for j in summed if shape[j] == 1]
        self._kept = [shape[j] for j in keep]
        self._order, self._angles = (*first, *constant, *keep, *later), [*first, *later]
        self._degrees = [tuple(shape[j] // 2 for j in group) for group in (first, later)]
        width, height = (math.prod(shape[j] for j in group) for group in (first, later))
        self._shape = width, math.prod(self._kept) * height
        self._few = min(max(NUMBERS // sum(self._shape), FEWEST), BLOCK)
        self._points = 0

    def matrix(self, tensor: Array) -> Array:
        """Return the numbers of a tensor, a row for each product of waves of the first group."""
        return np.ascontiguousarray(tensor.transpose(self._order)).reshape(self._shape)

    def __call__(self, matrix: Array, Q: Array) -> Array:
        """Compute the sums (2 d_j + 1 for j in keep, m) at points (m, n)."""
        q = Q[:, self._angles]
        self._points += len(q)
        often = self._points > MANY
        if often and matrix.size <= SMALL:
            values = self._summed({"q": q}, {"matrix": matrix}).T
        else:
            values = np.empty((math.prod(self._kept), len(q)))
            for i in range(0, len(q), self._few):
                part = q[i : i + self._few]
                both = self._multiplied({"q": part}) if often else self._products(numbers, part.T)
                A, B = both if often else (a.T for a in both)
                half = _product(A, matrix).reshape(len(A), len(values), B.shape[1])
                np.einsum("mkl,ml->km", half, B, out=values[:, i : i + self._few])
        return values.reshape(*self._kept, len(q))

    def _products(self, xp: Any, q: Any) -> tuple[Any, Any]:
        """Multiply out the waves of both groups of angles (n,) or (n, m)."""
        first, later = self._degrees
        return products(xp, q[: len(first)], first), products(xp, q[len(first) :], later)

    def _sum(self, xp: Any, q: Any, matrix: Any) -> Any:
        """Compute the sums (product of those kept,) at angles (n,)."""
        A, B = self._products(xp, q)
        return (A @ matrix).reshape(-1, len(B)) @ B

    @cached_property
    def _multiplied(self) -> Any:
        return self._compiled(self._products)

    @cached_property
    def _summed(self) -> Any:
        return self._compiled(self._sum, {"matrix": self._shape})

    def _compiled(self, function: Callable[..., Any], given: Any = None) -> Any:
        """Compile a function of the angles, and of numbers that all points share."""
        from spacearm.compiler import symbols
        from spacearm.compiler.kernel import compiled

        return compiled(partial(function, symbols), {"q": (len(self._angles),)}, given)


_sums = lru_cache(maxsize=256)(_Sums)


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


#: Values of a block, half a megabyte: they fit the second cache.
VALUES = 1 << 16
#: Points of an axis from which it may be the last one, whose product makes all the values.
WIDE = 16

T = TypeVar("T")
Index = tuple[slice, ...]


class Nesting(NamedTuple):
    """Order in which the axes of a grid are contracted.

    Attributes:
        outer: Axes of which a block holds one point.
        split: The axis of which it holds a part.
        inner: Axes of which it holds all points; the last one makes the values.
        part: Points of the split axis in a block.
    """

    outer: tuple[int, ...]
    split: int
    inner: tuple[int, ...]
    part: int

    @classmethod
    def of(cls, sizes: tuple[int, ...], shape: tuple[int, ...]) -> Nesting:
        """Choose it for a tensor of these sizes and a grid of this shape, of two axes at least."""
        wide = [j for j in range(len(shape)) if shape[j] >= WIDE] or list(range(len(shape)))
        last = min(wide, key=lambda j: (sizes[j], -shape[j]))
        others = sorted((j for j in range(len(shape)) if j != last), key=lambda j: -sizes[j])
        inner, values, split = [last], shape[last], others.pop()
        while others and values * shape[split] < VALUES:
            inner.insert(0, split)
            values *= shape[split]
            split = others.pop()
        part = min(shape[split], max(1, VALUES // values))
        return cls(tuple(sorted(others, key=lambda j: -shape[j])), split, tuple(inner), part)


def over_blocks(
    tensor: Array, shape: tuple[int, ...], do: Callable[[Array, Index], T], threads: int | None
) -> list[T]:
    """Call `do` with blocks of values on a tensor grid; see `TrigPolynomial.on_grid`.

    Args:
        tensor: (2 d_1 + 1, ..., 2 d_n + 1) in the basis of real waves.
        shape: Points N_j in each angle.
        do: Takes the values of a block and its slices of the grid.
        threads: Number of threads; one per available processor if None.
    """
    n = tensor.ndim
    padding = (1,) * (2 - n)  # a block needs two axes
    tensor, shape = tensor.reshape((*tensor.shape, *padding)), (*shape, *padding)
    B = [
        waves(np, 2.0 * np.pi * np.arange(N) / N, size // 2).T.copy()
        for N, size in zip(shape, tensor.shape, strict=True)
    ]
    nest = Nesting.of(tensor.shape, shape)
    order = (*nest.outer, nest.split, *nest.inner)
    ordered = tensor.transpose(order)
    to_axes = np.argsort(order)
    last = np.ascontiguousarray(B[nest.inner[-1]].T)
    width = math.prod(shape[j] for j in nest.inner)
    local = threading.local()

    def expanded(partial: Array, index: dict[int, slice]) -> Iterator[T]:
        """Expand the split and the inner axes at one point of the outer ones."""
        for axis, j in enumerate(nest.inner[:-1], start=1):
            partial = np.moveaxis(np.tensordot(B[j], partial, (1, axis)), 0, axis)
        sums = np.ascontiguousarray(partial).reshape(partial.shape[0], -1)
        if not hasattr(local, "values"):
            local.values = np.empty(nest.part * width)
        for start in range(0, shape[nest.split], nest.part):
            piece = slice(start, min(start + nest.part, shape[nest.split]))
            rows = (B[nest.split][piece] @ sums).reshape(-1, len(last))
            values = local.values[: len(rows) * last.shape[1]].reshape(len(rows), -1)
            np.matmul(rows, last, out=values)
            there = index | {nest.split: piece}
            slices = tuple(there.get(j, slice(0, N)) for j, N in enumerate(shape))
            block = values.reshape([slices[j].stop - slices[j].start for j in order])
            block = block.transpose(to_axes)
            yield do(block.reshape(block.shape[:n]) if padding else block, slices[:n])

    def nested(partial: Array, depth: int, index: dict[int, slice]) -> Iterator[T]:
        """Contract the outer axes from `depth` on, one point after the other."""
        if depth == len(nest.outer):
            yield from expanded(partial, index)
            return
        j = nest.outer[depth]
        flat = partial.reshape(len(partial), -1)
        for i, sums in enumerate(B[j] @ flat):
            there = index | {j: slice(i, i + 1)}
            yield from nested(sums.reshape(partial.shape[1:]), depth + 1, there)

    if not nest.outer:
        return list(expanded(ordered, {}))
    first = nest.outer[0]
    flat = ordered.reshape(len(ordered), -1)

    def task(i: int) -> list[T]:
        """Do the blocks at point i of the first axis."""
        sums = (B[first][i] @ flat).reshape(ordered.shape[1:])
        return list(nested(sums, 1, {first: slice(i, i + 1)}))

    with Threads(processors() if threads is None else threads) as pool:
        return [x for found in pool.map(task, range(shape[first])) for x in found]
