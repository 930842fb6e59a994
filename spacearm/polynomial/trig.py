"""Trigonometric polynomials of several angles: exact functions from few samples.

A real trigonometric polynomial on the n-torus,

    f(q) = sum_k c_k exp(i k.q),   k in Z^n, |k_j| <= d_j,   c_-k = conj(c_k),

has prod(2 d_j + 1) coefficients and is known everywhere from as many samples on a tensor grid, by
one fast Fourier transform. Along one joint, with z = exp(i q_j), it is z^-d times a polynomial of
degree 2d in z, whose roots on the unit circle are its real roots. For d = 1, a cos q + b sin q + c
vanishes at q = atan2(b, a) +- acos(-c / hypot(a, b)). From the coefficients come bounds that hold
everywhere, |df/dq_j| <= sum |c_k| |k_j| and |d2f/dq_i dq_j| <= sum |c_k| |k_i| |k_j|, and with
them certificates that a box or a segment holds no root.

If each sample is off by E at most, the interpolant is off by Lambda E at most anywhere, where
Lambda is the product of the Lebesgue constants of the axes,

    (1 / N) sum_i 1 / sin((2 i + 1) pi / (2 N)),   i = 0 ... N - 1,   N = 2 d_j + 1,

each reached between two points of the grid. E is measured: at points that are not on the grid, the
interpolant and the samples differ by what the sampler and the degrees leave out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from typing import Any

import numpy as np

from spacearm.arrays import (
    LARGEST,
    MOST_THREADS,
    NO_NUMBERS,
    Array,
    ArrayLike,
    Integers,
    floats,
    plain,
    whole,
)
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.polynomial.contraction import Index, T, contract, over_blocks, to_complex, to_real
from spacearm.polynomial.univariate import Complex, Roots, distinct, line_roots, orders, real_roots
from spacearm.processes import check_memory
from spacearm.results import Cell, Described, Description, Measure, Table
from spacearm.signatures import checked, shown

Sampler = Callable[[Array], Array]

#: Largest number of samples of a fit, to bound its memory.
MOST_SAMPLES = 10_000_000
#: Largest number of angles of a fit: with more it has too many coefficients in any case.
MOST_ANGLES = 20
#: Largest number of points of a grid whose values are kept: 4 GB.
MOST_GRID = 500_000_000
#: Memory of an angle of a sample, twice; and of a sample of one function, with its spectra [bytes].
NUMBER_BYTES, SAMPLE_BYTES = 16, 64
#: Random lines along each angle, from whose spectra its degree is found.
LINES = 4
#: Random points at which a fit is compared with new samples.
CHECKS = 64
#: How much larger the error of a sample may be than the largest seen at these points.
SAFETY = 8.0
#: Share of the largest coefficient along a line below which one is left out.
ROUNDING = 1e-13
#: How much larger a coefficient is than those that only rounding makes.
ABOVE_ROUNDING = 32.0
#: Share of the size of a function by which a fit must not miss it.
MISFIT = 1e-9


class NotPolynomialError(UnsupportedError):
    """A function is no trigonometric polynomial, or mostly rounding."""


def interpolants(sampler: Sampler, degrees: Integers) -> list[Complex]:
    """Compute the coefficients of the components, whose degrees are (n, components).

    Raises:
        UnsupportedError: There are too many.
        SpaceArmError: They need more memory than is free.
    """
    most = degrees.max(axis=1)
    shape = [2 * int(d) + 1 for d in most]
    if math.prod(shape) > MOST_SAMPLES:
        raise UnsupportedError(
            f"a trigonometric polynomial of degrees {tuple(map(int, most))} has "
            f"{math.prod(shape):.3g} coefficients, of which {MOST_SAMPLES:.0e} at most are "
            "kept; lock joints"
        )
    samples, functions = math.prod(shape), degrees.shape[1]
    need = samples * (NUMBER_BYTES * len(shape) + SAMPLE_BYTES * functions)
    what = f"a fit of {functions:,} trigonometric polynomials, {samples:,} samples each,"
    check_memory(need, what, "lock joints")
    axes = np.meshgrid(*(2.0 * np.pi * np.arange(s) / s for s in shape), indexing="ij")
    values = sampler(np.stack([axis.ravel() for axis in axes], axis=1))
    components = np.ascontiguousarray(values.T).reshape(-1, *shape)
    over = tuple(range(1, len(shape) + 1))
    spectra = np.fft.fftshift(np.fft.fftn(components, axes=over, norm="forward"), axes=over)
    inner = [tuple(map(slice, most - d, most + d + 1)) for d in degrees.T]
    return [np.ascontiguousarray(c[own]) for c, own in zip(spectra, inner, strict=True)]


def error_bound(values: Array, wanted: Array, degrees: tuple[int, ...]) -> float:
    """Bound the error of an interpolant everywhere from its values and new samples, (m,) each.

    Raises:
        NotPolynomialError: They differ by more than rounding can.
    """
    miss, size = float(np.abs(values - wanted).max()), float(np.abs(wanted).max())
    if not miss <= MISFIT * size:
        raise NotPolynomialError(
            f"the function is no trigonometric polynomial of degrees {degrees}, or mostly "
            f"rounding: its values are up to {size:.3g}, and the polynomial misses them by "
            f"{miss:.3g}; give a function that is one, or a higher degree with highest="
        )
    return SAFETY * miss * math.prod(_lebesgue(2 * d + 1) for d in degrees)


def degrees_of(sampler: Sampler, n: int, highest: int, rng: np.random.Generator) -> Integers:
    """Find the degrees (n, components): where the spectra along random lines end.

    Those of components that are mostly rounding are worth nothing, beside others.

    Raises:
        NotPolynomialError: None ends up to the highest degree, or they are not finite.
    """
    N = 2 * highest + 5
    lines = rng.uniform(-np.pi, np.pi, (n, LINES, 1, n)).repeat(N, axis=2)
    for j in range(n):
        lines[j, :, :, j] = 2.0 * np.pi * np.arange(N) / N
    values = sampler(lines.reshape(-1, n))
    if not np.isfinite(values).all():
        raise NotPolynomialError(
            "the function gives values that are not finite; give one that is finite everywhere"
        )
    spectra = np.fft.rfft(values.reshape(n, LINES, N, -1), axis=2, norm="forward")
    size = np.abs(spectra).max(axis=1)  # (n, orders, components)
    rounding = size[:, highest + 1 :].max(axis=1)
    bound = np.maximum(ROUNDING * size.max(axis=(0, 1)), ABOVE_ROUNDING * rounding)
    beyond = np.flatnonzero((rounding > MISFIT * size.max(axis=(0, 1))).all(axis=1))
    if beyond.size:
        raise NotPolynomialError(
            f"the function is no trigonometric polynomial of degree {highest} or less in angle "
            f"{beyond[0]}, or mostly rounding; give one that is, or a higher degree with highest="
        )
    orders = np.arange(size.shape[1])[None, :, None]
    return np.where(size > bound[:, None], orders, 0).max(axis=1)


def _lebesgue(N: int) -> float:
    """Return the Lebesgue constant of interpolation at N points of the circle, N odd."""
    return float((1.0 / np.sin((2 * np.arange(N) + 1) * np.pi / (2 * N))).mean())


#: Share of the scale to which Newton's method brings values on a root.
NOISE = 1e-12
EPS = float(np.finfo(np.float64).eps)


@checked
@dataclass(frozen=True, eq=False, repr=False)
class TrigPolynomial(Described):
    """A real trigonometric polynomial of n angles.

    Attributes:
        coefficients: (2 d_1 + 1, ..., 2 d_n + 1) complex, c_k at index k + d.
        error: Bound of its distance, anywhere, from the function that it was fitted to.
    """

    coefficients: Complex
    error: float = 0.0

    @property
    def n(self) -> int:
        """Number of angles."""
        return self.coefficients.ndim

    @property
    def degrees(self) -> tuple[int, ...]:
        """Degree in each angle."""
        return tuple(size // 2 for size in self.coefficients.shape)

    @cached_property
    def scale(self) -> float:
        """Sum of |c_k|, a bound of all values."""
        return float(np.abs(self.coefficients).sum())

    def describe(self) -> Description:
        """Describe degrees and coefficients."""
        facts: dict[str, Cell] = {
            "degrees": ", ".join(map(str, self.degrees)),
            "coefficients": self.coefficients.size,
            "sum of their sizes, a bound of all values": self.scale,
            "distance from the function fitted, at most": Measure(self.error, "", ".3g"),
        }
        return Description(
            title=f"degrees {self.degrees}",
            verdict=f"{self.coefficients.size} coefficients",
            tables=[Table.facts(facts)],
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the degrees and the coefficients, each as [re, im], as plain JSON data."""
        return {"degrees": plain(self.degrees), "coefficients": plain(self.coefficients)}

    @classmethod
    def fit(cls, sampler: Sampler, n: int, *, highest: int = 8) -> TrigPolynomial:
        """Fit a function that is a trigonometric polynomial, exactly but for rounding.

        Args:
            sampler: Takes (m, n) angles, returns (m,) real values.
            n: Number of angles.
            highest: Highest degree looked for in one angle.

        Returns:
            The polynomial; its `error` is bounded by the misses at the points of the check, eight
            times the largest of which every sample may be off, times the Lebesgue constants.

        Raises:
            UnsupportedError: The function is not a trigonometric polynomial up to that degree,
                gives values that are not finite, or has too many coefficients.
        """
        return cls.fit_each(lambda Q: sampler(Q)[:, None], n, highest=highest)[0]

    @classmethod
    def fit_each(cls, sampler: Sampler, n: int, *, highest: int = 8) -> list[TrigPolynomial]:
        """Fit the components of a vector, as `fit`; the sampler returns (m, components) values.

        Each has its own degrees; all are sampled on the grid of the highest.
        """
        n, highest = whole(n, "n", 1, MOST_ANGLES), whole(highest, "highest", 0, MOST_SAMPLES)
        rng = np.random.default_rng(0)
        degrees = degrees_of(sampler, n, highest, rng)
        fitted = [cls(c) for c in interpolants(sampler, degrees)]
        Q = rng.uniform(-np.pi, np.pi, (CHECKS, n))
        return [
            cls(f.coefficients, error_bound(f(Q), wanted, f.degrees))
            for f, wanted in zip(fitted, sampler(Q).T, strict=True)
        ]

    def __call__(self, Q: ArrayLike) -> Any:
        """Evaluate at (n,) or (m, n) angles: a float or (m,)."""
        points = self._angles(Q)
        values = self._along(np.atleast_2d(points), ())
        return float(values[0]) if points.ndim == 1 else values

    def _angles(self, Q: ArrayLike) -> Array:
        """Return angles (n,) or (m, n), checked."""
        try:
            points = floats(Q)
        except NO_NUMBERS:
            points = np.empty(0)
        sound = points.ndim in (1, 2) and points.shape[-1] == self.n
        if not sound or not (np.abs(points) <= LARGEST).all():
            raise ConfigurationError(
                f"Q is {shown(Q)}; give (n,) or (m, n) angles [rad], finite, n = {self.n}"
            )
        return points

    def along(self, Q: Array, keep: tuple[int, ...]) -> Complex:
        """Compute the coefficients that remain when all angles but those in `keep` are fixed.

        Args:
            Q: (m, n) angles; those in `keep` do not matter.
            keep: Numbers of the angles that remain, in growing order.

        Returns:
            (m, 2 d_j + 1 for j in keep) complex coefficients; (m,) if `keep` is empty.
        """
        lines = to_complex(self._along(Q, keep), range(len(keep)))
        return np.ascontiguousarray(np.moveaxis(lines, -1, 0))

    def _along(
        self,
        Q: Array,
        keep: tuple[int, ...],
        last: Callable[[Array], Array] | None = None,
        of: Array | None = None,
    ) -> Array:
        """Compute `along` in real waves, the points last; `last` is applied to blocks of it."""
        if Q.ndim != 2 or Q.shape[1] != self.n:
            raise ConfigurationError(f"angles have shape {Q.shape}; give (m, {self.n})")
        return contract(self.real if of is None else of, Q, keep, last)

    @cached_property
    def real(self) -> Array:
        """The coefficients of 1, cos q, ..., cos d q, sin q, ..., sin d q in each angle."""
        return to_real(self.coefficients)

    def fix(self, angles: Mapping[int, float]) -> TrigPolynomial:
        """Return the polynomial of the other angles with some fixed."""
        point = np.zeros((1, self.n))
        point[0, list(angles)] = list(angles.values())
        keep = tuple(j for j in range(self.n) if j not in angles)
        error = self.noise(np.abs(point).max(initial=0.0))
        return TrigPolynomial(self.along(point, keep)[0], error)

    def shifted(self, offset: Array) -> TrigPolynomial:
        """Return the polynomial q -> f(q + offset).

        Args:
            offset: (n,) angles.
        """
        waves = [np.exp(1j * self._k(j) * offset[j]) for j in range(self.n)]
        shifted = math.prod(waves, start=self.coefficients)
        return TrigPolynomial(shifted, self.noise(np.abs(offset).max(initial=0.0)))

    def grid(
        self, shape: tuple[int, ...], *, out: Array | None = None, threads: int | None = None
    ) -> Array:
        """Evaluate on a tensor grid; memory is the bound, see `on_grid`.

        Args:
            shape: Points N_j in each angle; point i stands at 2 pi i / N_j.
            out: (N_1, ..., N_n) array of floats to write to, of any precision.
            threads: Number of threads; one per available processor if None.

        Returns:
            (N_1, ..., N_n) values.

        Raises:
            ConfigurationError: `shape` or `out` has the wrong shape.
            SpaceArmError: The values need more memory than is free.
        """
        shape = self._grid_shape(shape)
        if out is None and math.prod(shape) > MOST_GRID:
            raise ConfigurationError(
                f"a grid of shape {shape} has {math.prod(shape):,} points; give at most "
                f"{MOST_GRID:,}, or use on_grid, which does not keep the values"
            )
        if out is None:
            need = 8.0 * math.prod(map(float, shape))
            what = f"a grid of shape {tuple(shape)}"
            check_memory(need, what, "give fewer points, or use on_grid")
        values = np.empty(shape) if out is None else out
        if values.shape != shape:
            raise ConfigurationError(f"out has shape {values.shape}; give {shape}")

        def keep(block: Array, index: Index) -> None:
            values[index] = block

        self.on_grid(shape, keep, threads=threads)
        return values

    def on_grid(
        self, shape: tuple[int, ...], do: Callable[[Array, Index], T], *, threads: int | None = None
    ) -> list[T]:
        """Evaluate on a tensor grid block by block, without keeping the values.

        Writing a value to memory takes longer than computing it. What is done with the values of a
        block, some 65,000 of them, happens in the processor cache.

        Args:
            shape: Points N_j in each angle; point i stands at 2 pi i / N_j.
            do: Takes the values of a block, (b_1, ..., b_n), and its slices of the grid. The array
                is used again: `do` may change it, not keep it. It runs on several threads.
            threads: Number of threads; one per available processor if None.

        Returns:
            What `do` returns for each block.

        Raises:
            ConfigurationError: `shape` is not a number of points for each angle.

        Example:
            The share where S < 0: `np.mean(S.on_grid(shape, lambda v, _: (v < 0.0).mean()))`.
        """
        if threads is not None:
            threads = whole(threads, "threads", 1, MOST_THREADS)
        return over_blocks(self.real, self._grid_shape(shape), do, threads)

    def _grid_shape(self, shape: Sequence[int]) -> tuple[int, ...]:
        """Return the numbers of points of a grid, checked."""
        if len(shape) != self.n:
            raise ConfigurationError(f"a grid has shape {shape}; give {self.n} numbers of points")
        return tuple(whole(points, "points of a grid", 1) for points in shape)

    @cached_property
    def derivatives(self) -> tuple[TrigPolynomial, ...]:
        """The n partial derivatives."""
        return tuple(
            TrigPolynomial(self.coefficients * (1j * self._k(j)), d * self.error)
            for j, d in enumerate(self.degrees)
        )

    def gradient(self, Q: ArrayLike) -> Array:
        """Compute the gradient at (n,) or (m, n) angles, of the same shape."""
        points = self._angles(Q)
        slopes = self._along(np.atleast_2d(points), (self.n,), of=self._slopes)
        return slopes[:, 0] if points.ndim == 1 else np.ascontiguousarray(slopes.T)

    @cached_property
    def _slopes(self) -> Array:
        """(2 d_1 + 1, ..., 2 d_n + 1, n) the derivatives in real waves."""
        return np.stack([f.real for f in self.derivatives], axis=-1)

    def hessian(self, Q: ArrayLike) -> Array:
        """Compute the second derivatives (n, n) or (m, n, n)."""
        return np.stack([f.gradient(Q) for f in self.derivatives], axis=-1)

    def _k(self, j: int) -> Array:
        """Return the orders k_j, shaped to multiply the coefficients."""
        shape = [1] * self.n
        shape[j] = -1
        return orders(self.degrees[j]).reshape(shape)

    def roots(self, q: ArrayLike, j: int) -> Roots:
        """Find all real roots along angle j, the others as in q (n,).

        Raises:
            ConfigurationError: There is no such angle, or q are no angles.
        """
        j = whole(j, "j", 0, self.n - 1)
        line = self.along(self._angles(q)[None], (j,))[0]
        if np.abs(line).max() <= NOISE * self.scale:
            return Roots(np.empty(0), np.empty(0, dtype=int), True)
        angles, multiplicity = distinct(line_roots(line[None])[0])
        return Roots(angles, multiplicity, False)

    def roots_along(self, Q: Array, j: int) -> Array:
        """Find the real roots (m, 2 d_j) along angle j for Q (m, n); NaN where there are fewer."""
        return self._along(Q, (j,), real_roots).T

    def noise(self, largest: float = np.pi) -> float:
        """Bound the difference of a computed value from that of the fitted function.

        It is `error` and the rounding of the evaluation: each angle's sums of 2 d + 1 terms and
        waves whose phase, up to d times the `largest` angle, is rounded.

        Args:
            largest: Largest |q_j| [rad].
        """
        steps = sum(2 * d + 6 + 2.0 * d * max(float(largest), np.pi) for d in self.degrees)
        return self.error + EPS * steps * self.scale

    @cached_property
    def lipschitz(self) -> Array:
        """(n,) L_j >= |df/dq_j| everywhere."""
        return self.derivative_bounds(1)

    @cached_property
    def curvature(self) -> Array:
        """(n, n) B_ij >= |d2f/dq_i dq_j| everywhere."""
        return self.derivative_bounds(2)

    def derivative_bounds(self, order: int) -> Array:
        """Bound the derivatives of an order everywhere, (n, ..., n)."""
        weights = [np.abs(orders(d))[:, None] ** np.arange(order + 1.0) for d in self.degrees]
        return derivative_bounds(np.abs(self.coefficients), weights, order)

    def enclosure(self, centre: Array, half: Array) -> tuple[Array, Array]:
        """Bound the values over boxes, rounding included.

        Args:
            centre: (m, n) centres.
            half: (m, n) half widths.

        Returns:
            (m,) values at the centres, and by how much others in the boxes differ at most:
            |df/dq| h + h B h / 2 with the gradient there, or L h if that is less.
        """
        second = 0.5 * np.einsum("mi,ij,mj->m", half, self.curvature, half)
        first = np.einsum("mj,mj->m", np.abs(self.gradient(centre)), half)
        change = np.minimum(first + second, half @ self.lipschitz)
        return self(centre), change + self.noise(np.abs(centre).max(initial=0.0))

    def sign(self, centre: Array, half: Array) -> Integers:
        """Certify signs over boxes, as of `enclosure`: +1 or -1 where no root can be, else 0.

        Args:
            centre: (m, n) centres.
            half: (m, n) half widths.
        """
        values, change = self.enclosure(centre, half)
        return np.where(np.abs(values) > change, np.sign(values), 0.0).astype(int)


def derivative_bounds(sizes: Array, weights: Sequence[Array], order: int) -> Array:
    """Sum |c_k| times the bounds of its wave's derivatives of an order, (n, ..., n).

    Args:
        sizes: (2 d_1 + 1, ..., 2 d_n + 1) |c_k|.
        weights: Of each coordinate (2 d_j + 1, order + 1) bounds of its waves and of their
            derivatives up to the order.
        order: Of the derivatives.
    """
    return as_tensor(bounds_of_derivatives(sizes, weights, order), len(weights), order)


def as_tensor(bounds: Mapping[tuple[int, ...], Array], n: int, order: int) -> Array:
    """Return bounds by the coordinates of each derivative as (n, ..., n)."""
    tensor = np.zeros((n,) * order)
    for of, value in bounds.items():
        for index in set(permutations(of)):
            tensor[index] = value
    return tensor


def bounds_of_derivatives(
    sizes: Array, weights: Sequence[Array], order: int
) -> dict[tuple[int, ...], Array]:
    """Return the same by the coordinates of each derivative, in ascending order."""
    sums: dict[tuple[int, ...], Array] = {(): sizes}
    with np.errstate(over="ignore"):
        for j in reversed(range(len(weights))):  # the axes that are left come first
            most = order + 1 if weights[j][1:].any() else 1
            sums = {
                (*(j,) * e, *of): values @ weights[j][:, e]
                for of, values in sums.items()
                for e in range(min(most, order + 1 - len(of)))
            }
    return {of: value for of, value in sums.items() if len(of) == order}
