"""The singularity polynomials of all arms in a box of parameters, in Bernstein form.

With the tip as root body every column of the momentum matrix is linear in the masses, first and
second moments of the bodies, so that its determinant S(q; t) is a polynomial of the shares t of the
parameters in their intervals. In Bernstein form, S = sum_a B_a(t) S_a(q), where B_a >= 0 and
sum_a B_a = 1: for each q the values lie between the least and the largest S_a(q), and those at the
corners of the box are attained. Halving the box (de Casteljau) brings both together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import comb

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError
from spacearm.polynomial.jets import Jets
from spacearm.polynomial.trig import Sampler, TrigPolynomial
from spacearm.polynomial.univariate import Complex
from spacearm.singularities.polynomials import check_square, comparable_sampler
from spacearm.uncertainty.intervals import UncertainArm

HIGHEST = 12
"""Largest degree in a parameter: six columns, each of second degree in a shift of a CM."""
MOST = 2000
"""Most Bernstein coefficients, each of which is a polynomial of the joints."""
PROBES = 16
"""Random arms and postures at which degrees are found and the fit is checked."""
EXACT = 1e-9
"""Largest difference of the fit from S there, as a share of the largest |S|."""


@dataclass(frozen=True, eq=False)
class Family:
    """The singularity polynomials of all arms in a box.

    Attributes:
        low: (p,) lower corner of the box, as shares of the intervals.
        high: (p,) upper corner.
        degrees: Degree in each parameter.
        coefficients: (a_1, ..., a_p, *shape) coefficients of the S_a, as `TrigPolynomial` has them.
        error: Bound of the distance of each S_a from what it was fitted to.
    """

    low: Array
    high: Array
    degrees: tuple[int, ...]
    coefficients: Complex
    error: float

    @property
    def p(self) -> int:
        """Number of parameters."""
        return len(self.degrees)

    @cached_property
    def control(self) -> list[TrigPolynomial]:
        """The S_a, in the order of the flattened indices."""
        shape = self.coefficients.shape[self.p :]
        flat = self.coefficients.reshape(-1, *shape)
        return [TrigPolynomial(c, self.error) for c in flat]

    def corners(self) -> tuple[list[int], Array]:
        """Return the numbers of the S_a at the corners of the box, and the corners (2^p, p)."""
        shape = tuple(d + 1 for d in self.degrees)
        at = np.array(np.meshgrid(*([0, 1] for _ in shape), indexing="ij")).reshape(self.p, -1).T
        index = at * np.array(self.degrees)
        numbers = np.ravel_multi_index(tuple(index.T), shape)
        return [int(i) for i in numbers], self.low + at * (self.high - self.low)

    def jets(self) -> list[Jets]:
        """Return the S_a as what a certificate takes."""
        return [Jets.of(f) for f in self.control]

    def __call__(self, q: Array, shares: Array) -> Array:
        """Evaluate S at one posture (n,) for many arms (m, p)."""
        shape = [1, *(d + 1 for d in self.degrees)]
        values: Array = np.array([f(q) for f in self.control]).reshape(shape)
        values = values.repeat(len(shares), axis=0)
        t = (shares - self.low) / (self.high - self.low)
        for j, d in enumerate(self.degrees):
            values = np.einsum("ma,ma...->m...", _bernstein(t[:, j], d), values)
        return values

    def halves(self, j: int) -> tuple[Family, Family]:
        """Return the families of the two halves of the box along a parameter."""
        rows = np.moveaxis(self.coefficients, j, 0)
        left, right = [rows[0]], [rows[-1]]
        while len(rows) > 1:
            rows = 0.5 * (rows[:-1] + rows[1:])
            left.append(rows[0])
            right.append(rows[-1])
        middle = 0.5 * (self.low[j] + self.high[j])
        below, above = self.high.copy(), self.low.copy()
        below[j] = above[j] = middle
        first, second = (np.moveaxis(np.array(part), 0, j) for part in (left, right[::-1]))
        lower = replace(self, high=below, coefficients=first)
        return lower, replace(self, low=above, coefficients=second)


@lru_cache(maxsize=8)
def family_of(uncertain: UncertainArm) -> Family:
    """Fit the singularity polynomials of all arms in the box.

    Raises:
        UnsupportedError: The arm has no singularity polynomial, or there are too many parameters.
    """
    check_square(uncertain.arm)
    p, n = len(uncertain.parameters), uncertain.arm.n
    rng = np.random.default_rng(0)
    Q = rng.uniform(-np.pi, np.pi, (PROBES, n))
    degrees = tuple(_degree(uncertain, j, Q, rng) for j in range(p))
    size = int(np.prod([d + 1 for d in degrees]))
    if size > MOST:
        raise UnsupportedError(
            f"the proof takes {size} polynomials for {p} uncertain numbers, more than {MOST}; name "
            "fewer of them: those of the spacecraft and the payload matter most"
        )
    nodes = [_nodes(d) for d in degrees]
    grid = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, p)
    samplers = [_sampler(uncertain, t) for t in grid]
    inverse = [np.linalg.inv(_bernstein(x, d)) for x, d in zip(nodes, degrees, strict=True)]

    def control(Q: Array) -> Array:
        values = np.stack([sampler(Q) for sampler in samplers], axis=1)
        values = values.reshape(len(Q), *(d + 1 for d in degrees))
        for j, matrix in enumerate(inverse):
            values = np.moveaxis(np.tensordot(matrix, values, axes=(1, j + 1)), 0, j + 1)
        return values.reshape(len(Q), -1)

    fitted = TrigPolynomial.fit_each(control, n)
    shape = tuple(max(f.coefficients.shape[j] for f in fitted) for j in range(n))
    whole = np.array([_padded(f.coefficients, shape) for f in fitted])
    error = max(f.error for f in fitted)
    found = Family(
        np.zeros(p), np.ones(p), degrees, whole.reshape(*(d + 1 for d in degrees), *shape), error
    )
    _check(found, uncertain, Q, rng)
    return found


def _sampler(uncertain: UncertainArm, shares: Array) -> Sampler:
    """Return the function that computes S of one of the arms, comparable between them."""
    return comparable_sampler(uncertain.realise(shares), uncertain.arm)


def _degree(uncertain: UncertainArm, j: int, Q: Array, rng: np.random.Generator) -> int:
    """Return the degree of S in a parameter, found from samples on a line in the box."""
    x = _nodes(HIGHEST)
    shares = np.tile(uncertain.sample(1, rng), (len(x), 1))
    shares[:, j] = x
    values = np.array([_sampler(uncertain, t)(Q) for t in shares])
    series = np.polynomial.chebyshev.chebfit(2.0 * x - 1.0, values.reshape(len(x), -1), HIGHEST)
    size = np.abs(series).max(axis=1)
    return max(1, int(np.flatnonzero(size > 1e-11 * size.max()).max(initial=0)))


def _check(found: Family, uncertain: UncertainArm, Q: Array, rng: np.random.Generator) -> None:
    """Compare the family with S of random arms.

    Raises:
        UnsupportedError: They differ.
    """
    for t in uncertain.sample(4, rng):
        wanted = _sampler(uncertain, t)(Q)[:, 0]
        got = np.array([found(q, t[None])[0] for q in Q])
        off = float(np.abs(got - wanted).max() / np.abs(wanted).max())
        if off > EXACT:
            raise UnsupportedError(
                f"the polynomials of uncertain arms differ from S by {off:.1e} of it; intervals "
                "over several orders of magnitude are too wide for them: narrow them"
            )


def _nodes(degree: int) -> Array:
    """Return Chebyshev nodes between 0 and 1."""
    k = np.arange(degree + 1)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * (k + 0.5) / (degree + 1)))


def _bernstein(t: Array, degree: int) -> Array:
    """Return the Bernstein polynomials (m, degree + 1) of a degree at t (m,)."""
    k = np.arange(degree + 1)
    binomial = np.array([comb(degree, int(i)) for i in k])
    return np.asarray(binomial * t[:, None] ** k * (1.0 - t[:, None]) ** (degree - k))


def _padded(coefficients: Complex, shape: tuple[int, ...]) -> Complex:
    """Return coefficients in the middle of an array of a larger shape."""
    pad = [(size - own) // 2 for size, own in zip(shape, coefficients.shape, strict=True)]
    return np.pad(coefficients, [(width, width) for width in pad])
