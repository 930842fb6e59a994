"""Values, gradients and second derivatives of a polynomial at many points, by nested contraction.

Each coordinate is an angle q, with the basis 1, cos q, ..., sin q, ..., or the position of a
sliding joint, d = centre + half cos(angle). As cos(k angle) = T_k((d - centre) / half), a
Chebyshev polynomial, a polynomial in d is one in its angle. One coordinate after the other is
contracted, the largest first; derivatives up to an order are carried along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array, Booleans, Integers
from spacearm.compiler.machine import processors
from spacearm.polynomial.trig import (
    TrigPolynomial,
    as_tensor,
    bounds_of_derivatives,
    derivative_bounds,
)
from spacearm.polynomial.univariate import orders
from spacearm.processes import Threads

#: Largest number of partial sums that an evaluation holds at once.
BLOCK = 1 << 22
#: Logarithm of the largest bound that is computed; numbers end at 709.
LARGEST = 600.0


@dataclass(frozen=True)
class Chart:
    """The positions q of joints as angles: revolute joints as they are, sliding ones by a cosine.

    Attributes:
        slides: (n,) which joints slide.
        centre: (n,) middle of the range of a sliding joint [m]; 0 of others.
        half: (n,) half of that range [m]; 1 of others.
    """

    slides: Booleans
    centre: Array
    half: Array

    @classmethod
    def turning(cls, n: int) -> Chart:
        """Return the chart of n revolute joints."""
        return cls(np.zeros(n, dtype=bool), np.zeros(n), np.ones(n))

    def angles(self, Q: Array) -> Array:
        """Return the angles of positions (..., n); NaN for a sliding joint out of its range."""
        if not self.slides.any():
            return Q
        x = (Q - self.centre) / self.half
        x = np.where(np.abs(np.abs(x) - 1.0) < 1e-12, np.sign(x), x)
        with np.errstate(invalid="ignore"):
            return np.where(self.slides, np.arccos(x), Q)

    def positions(self, angles: Array) -> Array:
        """Return the positions of angles (..., n)."""
        return np.where(self.slides, self.centre + self.half * np.cos(angles), angles)

    def draw(self, rng: np.random.Generator, *shape: int) -> Array:
        """Draw positions (..., n) of uniform angles."""
        return self.positions(rng.uniform(-np.pi, np.pi, (*shape, len(self.slides))))


class Jet(NamedTuple):
    """Value and derivatives at m points.

    Attributes:
        value: (m,).
        gradient: (m, n); empty if not asked for.
        hessian: (m, n, n); empty if not asked for.
        third: (m, n, n, n) third derivatives; empty if not asked for.
    """

    value: Array
    gradient: Array
    hessian: Array
    third: Array


@dataclass(frozen=True, eq=False)
class Jets:
    """A polynomial of n joint positions, ready to be evaluated with its derivatives.

    Attributes:
        polynomial: The polynomial of the angles.
        chart: What the angles are.
    """

    polynomial: TrigPolynomial
    chart: Chart

    @property
    def scale(self) -> float:
        """Bound of all values at positions in range."""
        return self.polynomial.scale

    @classmethod
    def of(cls, f: TrigPolynomial, chart: Chart | None = None) -> Jets:
        """Return a polynomial divided by its scale; of revolute joints if there is no chart."""
        size = f.scale or 1.0
        own = TrigPolynomial(f.coefficients / size, f.error / size)
        return cls(own, chart or Chart.turning(f.n))

    def noise(self, largest: float = np.pi) -> float:
        """Bound the difference of a computed value from the true one, at angles up to `largest`."""
        return self.polynomial.noise(largest)

    @cached_property
    def _axes(self) -> list[int]:
        """Coordinates that matter, those of highest degree last."""
        degrees = self.polynomial.degrees
        return sorted((j for j, d in enumerate(degrees) if d), key=lambda j: degrees[j])

    @cached_property
    def tensor(self) -> Array:
        """Real coefficients in the bases of the coordinates, axes as in `_axes`."""
        real = self.polynomial.real
        for j in np.flatnonzero(self.chart.slides):  # of a sliding joint there are no sines
            real = real.take(range(self.polynomial.degrees[j] + 1), axis=j)
        shape = [real.shape[j] for j in self._axes]
        idle = [j for j, d in enumerate(self.polynomial.degrees) if not d]
        return np.ascontiguousarray(real.transpose(*self._axes, *idle)).reshape(shape)

    @cached_property
    def _sizes(self) -> Array:
        return np.abs(self.polynomial.coefficients)

    def __call__(self, Q: Array, order: int = 0) -> Jet:
        """Evaluate at Q (m, n), with derivatives up to an order from 0 to 3."""
        return Jet(*(part[:, 0] for part in stacked([self], Q, order)))

    def partials(self, tensors: Array, Q: Array, order: int) -> tuple[list[tuple[int, ...]], Array]:
        """Compute the partial derivatives up to an order that may be other than zero.

        Points in a row that agree in the coordinates contracted so far share their sums.

        Args:
            tensors: (c, ...) coefficients of polynomials of the same degrees, as `tensor`.
            Q: (m, n) where.
            order: Up to which order.

        Returns:
            The coordinates that each is taken in, t of them, and (m, t, c) the derivatives.
        """
        found, c = [tensors.reshape(1, 1, -1)], len(tensors)
        of, other = np.zeros(len(Q), dtype=int), np.arange(len(Q)) == 0
        for j in reversed(self._axes):  # the derivatives of each order
            other[1:] |= Q[1:, j] != Q[:-1, j]
            rows = np.flatnonzero(other)
            m, before, of = len(rows), of[rows], np.cumsum(other) - 1
            waves = self._waves(Q[rows, j], j, order)
            size = waves.shape[2]
            parts: list[list[Array]] = [[] for _ in range(order + 1)]
            for d, held in enumerate(found):
                left, t = order + 1 - d, held.shape[1]
                if len(held) == 1:
                    sums = waves[:, :left].reshape(-1, size) @ held.reshape(-1, size).T
                    sums = sums.reshape(m, left, -1).swapaxes(1, 2)
                else:
                    held = held if len(held) == m else held[before]
                    sums = held.reshape(m, -1, size) @ waves[:, :left].swapaxes(1, 2)
                for e in range(left):
                    parts[d + e].append(sums[:, :, e].reshape(m, t, -1))
            found = [part[0] if len(part) == 1 else np.concatenate(part, axis=1) for part in parts]
        places = taken_in(tuple(self._axes), order)
        values = np.concatenate(found, axis=1)
        return places, values[of].reshape(len(Q), len(places), c)

    def at_point(self, q: Array, indices: tuple[tuple[int, ...], ...], order: int) -> Array:
        """Compute derivatives (t,) at one point q (n,), without the overhead of many points.

        Args:
            q: Where.
            indices: The coordinates that each derivative is taken in; () of the value.
            order: The highest order among them.
        """
        found = self.tensor.reshape(-1, 1)
        for j in reversed(self._axes):  # to all orders in each coordinate: few numbers are left
            waves = self._waves(q[j : j + 1], j, order)[0]
            found = waves @ found.reshape(-1, waves.shape[1], found.shape[-1])
            found = found.reshape(len(found), -1)
        return np.append(found, 0.0)[_places(tuple(self._axes), indices, order)]

    def order(self, Q: Array) -> Integers:
        """Return the order (m,) of points Q (m, n) in which those that share sums are in a row."""
        return np.lexsort((np.arange(len(Q)), *Q[:, self._axes].T))

    def _waves(self, q: Array, j: int, order: int) -> Array:
        """Compute the basis of a coordinate at q (m,), and derivatives: (m, order + 1, size)."""
        d = self.polynomial.degrees[j]
        if self.chart.slides[j]:
            x = (q - self.chart.centre[j]) / self.chart.half[j]
            T = chebyshev(x, d, order) / self.chart.half[j] ** np.arange(order + 1)
            return np.ascontiguousarray(T.swapaxes(1, 2))
        k = np.arange(1, d + 1)
        phases = q[:, None] * k
        cosine, sine = np.cos(phases), np.sin(phases)
        waves = np.zeros((len(q), order + 1, 2 * d + 1))
        waves[:, 0, 0] = 1.0
        for e in range(order + 1):
            waves[:, e, 1 : d + 1], waves[:, e, d + 1 :] = cosine, sine
            cosine, sine = -k * sine, k * cosine
        return waves

    def curvature(self, reach: Array) -> Array:
        """Bound the second derivatives, (n, n), wherever |(d - centre) / half| <= reach (n,)."""
        return as_tensor(self._bounds(2, reach), self.polynomial.n, 2)

    def derivative_bounds(self, order: int, Q: Array) -> Array:
        """Bound the derivatives of an order, (n, ..., n), in the box between positions Q (2, n)."""
        return as_tensor(self.bounds_of_derivatives(order, Q), self.polynomial.n, order)

    def bounds_of_derivatives(self, order: int, Q: Array) -> dict[tuple[int, ...], Array]:
        """Bound them there by the coordinates of each, in ascending order; no others than zero."""
        return self._bounds(order, self._reach(Q))

    def _bounds(self, order: int, reach: Array) -> dict[tuple[int, ...], Array]:
        """Bound derivatives by their coordinates; those with respect to angles anywhere, once."""
        if order not in self._anywhere:
            found = bounds_of_derivatives(self._sizes, self._weights(order, reach), order)
            if self.chart.slides.any():
                return found
            self._anywhere[order] = found
        return self._anywhere[order]

    @cached_property
    def _anywhere(self) -> dict[int, dict[tuple[int, ...], Array]]:
        """Bounds of the derivatives of each order that was asked for."""
        return {}

    def _reach(self, Q: Array) -> Array:
        """Return the largest |(d - centre) / half| (n,) between positions Q (2, n)."""
        return np.asarray(np.abs((Q - self.chart.centre) / self.chart.half).max(axis=0))

    def _weights(self, order: int, reach: Array) -> list[Array]:
        """Bound the waves of each coordinate and their derivatives, (size, order + 1)."""
        powers, weights = np.arange(order + 1.0), []
        for j, d in enumerate(self.polynomial.degrees):
            k = np.abs(orders(d)).astype(int)
            if self.chart.slides[j]:
                T = chebyshev(np.array([max(1.0, float(reach[j]))]), d, order)[0]
                weights.append((T / self.chart.half[j] ** powers)[k])
            else:
                weights.append(k[:, None] ** powers)
        return weights

    def bound(self, reach: Array, half_step: Array, rho: float) -> float:
        """Bound the values along a segment, its variable in the Bernstein ellipse rho.

        Infinity where the bound is too large for a number.

        Args:
            reach: (n,) largest |d - centre| on it, of sliding joints [m].
            half_step: (n,) half of the change of each joint along it [rad, m].
            rho: Sum of the half axes of the ellipse about [-1, 1].
        """
        powers = []
        for j, d in enumerate(self.polynomial.degrees):
            k = np.abs(orders(d))
            if self.chart.slides[j]:  # |T_k(z)| <= (|z| + sqrt(|z|^2 + 1))^k
                z = (reach[j] + half_step[j] * (rho + 1.0 / rho)) / self.chart.half[j]
                powers.append(k * np.log(z + np.hypot(z, 1.0)))
            else:
                powers.append(k * half_step[j] * (rho - 1.0 / rho) / 2.0)
        if sum(float(power[-1]) for power in powers) > LARGEST:
            return np.inf
        weights = [np.exp(power)[:, None] for power in powers]
        return float(derivative_bounds(self._sizes, weights, 0))


@cache
def taken_in(axes: tuple[int, ...], order: int) -> list[tuple[int, ...]]:
    """Return the coordinates that each derivative is taken in, in order, as they are contracted."""
    found: list[list[tuple[int, ...]]] = [[()]]
    for j in reversed(axes):
        some, found = found, [[] for _ in range(order + 1)]
        for d, index in enumerate(some):
            for e in range(order + 1 - d):
                found[d + e] += [(*(j,) * e, *i) for i in index]
    return [tuple(sorted(i)) for index in found for i in index]


@cache
def _places(axes: tuple[int, ...], indices: tuple[tuple[int, ...], ...], order: int) -> Integers:
    """Return where derivatives stand among those to all orders in each axis; the last one is 0."""
    places = []
    for index in indices:
        place = 0
        for j in axes:
            place = place * (order + 1) + index.count(j)
        zero = any(j not in axes for j in index)
        places.append((order + 1) ** len(axes) if zero else place)
    return np.array(places)


@cache
def _up_to(n: int, order: int) -> tuple[tuple[int, ...], ...]:
    """Return the coordinates of all derivatives of n coordinates up to an order."""
    return tuple(index for e in range(order + 1) for index in product(range(n), repeat=e))


def stacked(polynomials: Sequence[Jets], Q: Array, order: int = 0) -> Jet:
    """Evaluate c polynomials at Q (m, n): values (m, c), gradients (m, c, n), hessians, ..."""
    n, c = Q.shape[1], len(polynomials)
    found = derivatives(polynomials, Q, _up_to(n, order))
    parts, begin = [], 0
    for e in range(4):
        part = found[:, :, begin : begin + n**e] if e <= order else np.empty((0, c, n**e))
        parts.append(part)
        begin += n**e
    return Jet(*(part.reshape(*part.shape[:2], *(n,) * e) for e, part in enumerate(parts)))


def derivatives(polynomials: Sequence[Jets], Q: Array, indices: Sequence[tuple[int, ...]]) -> Array:
    """Compute derivatives (m, c, t) of c polynomials at Q (m, n).

    Those of the same degrees are evaluated together, blocks of points side by side.

    Args:
        polynomials: The polynomials.
        Q: Where.
        indices: The coordinates that each derivative is taken in; () of the value.
    """
    order = max(map(len, indices))
    if len(Q) == 1:
        listed = tuple(indices)
        return np.array([[f.at_point(Q[0], listed, order) for f in polynomials]])
    wanted = [tuple(sorted(index)) for index in indices]
    found = np.zeros((len(Q), len(polynomials), len(indices)))
    alike: dict[tuple[int, ...], list[int]] = {}
    for i, f in enumerate(polynomials):
        alike.setdefault(f.polynomial.degrees, []).append(i)

    def do(which: list[int], tensors: Array, rows: Integers) -> None:
        of, values = polynomials[which[0]].partials(tensors, Q[rows], order)
        places = {index: i for i, index in enumerate(of)}
        own = [t for t, index in enumerate(wanted) if index in places]
        at = [places[wanted[t]] for t in own]
        found[np.ix_(rows, np.array(which), np.array(own, dtype=int))] = values[:, at].swapaxes(
            1, 2
        )

    work = []
    for which in alike.values():
        tensors = np.array([polynomials[i].tensor for i in which])
        step = max(1, BLOCK // max(1, tensors.size))
        rows = polynomials[which[0]].order(Q)
        work += [(which, tensors, rows[i : i + step]) for i in range(0, len(Q), step)]
    if len(work) == len(alike):
        for some in work:
            do(*some)
    else:
        with Threads(processors()) as pool:
            list(pool.map(do, *zip(*work, strict=True)))
    return found


class Pointwise:
    """A polynomial of angles at one point after the other, for searches: each call is one pass.

    Args:
        f: The polynomial.
        unit: What it is divided by.
    """

    def __init__(self, f: TrigPolynomial, unit: float = 1.0) -> None:
        self._jets = Jets(TrigPolynomial(f.coefficients / unit), Chart.turning(f.n))

    def __call__(self, q: Array, /) -> float:
        """Compute the value at q (n,)."""
        return float(self._jets(q[None]).value[0])

    def gradient(self, q: Array, /) -> Array:
        """Compute the gradient (n,) at q (n,)."""
        return self._jets(q[None], 1).gradient[0]

    def hessian(self, q: Array, /) -> Array:
        """Compute the second derivatives (n, n) at q (n,)."""
        return self._jets(q[None], 2).hessian[0]


def chebyshev(x: Array, degree: int, order: int) -> Array:
    """Compute T_0 ... T_degree at x (m,) and their derivatives, (m, degree + 1, order + 1)."""
    T = np.zeros((len(x), degree + 1, order + 1))
    T[:, 0, 0] = 1.0
    if degree > 0:
        T[:, 1, 0] = x
        if order > 0:
            T[:, 1, 1] = 1.0
    for k in range(2, degree + 1):
        T[:, k] = 2.0 * x[:, None] * T[:, k - 1] - T[:, k - 2]
        for e in range(1, order + 1):
            T[:, k, e] += 2.0 * e * T[:, k - 1, e - 1]
    return T
