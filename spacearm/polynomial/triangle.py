"""Common roots of several trigonometric polynomials that form a triangle.

Polynomials f_1, ..., f_c and joints j_1, ..., j_c form a triangle if f_i contains j_i and none of
j_(i+1), ..., j_c. All joints but these are then free; f_1 = 0 gives j_1, f_2 = 0 gives j_2 and so
on, each along one line (`line_roots`), so that nothing is iterated and nothing is missed, but for

- sheets on which f_1 does not depend on j_1 at all. They are found along other joints (`sheets`);
- roots of f_1, ..., f_(i-1) at which f_i vanishes whatever j_i is, i > 1. `escapes` looks for them.

Two polynomials a cos q + b sin q + c of degree 1 in the same joint are two linear equations in
(cos q, sin q). That cos^2 + sin^2 = 1 leaves one polynomial without that joint, their resultant,
and with it a triangle (`eliminate`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

import numpy as np

from spacearm.arrays import Array
from spacearm.polynomial.jets import Jets, stacked
from spacearm.polynomial.newton import onto, shortened
from spacearm.polynomial.trig import NOISE, TrigPolynomial
from spacearm.polynomial.univariate import Complex, line_roots

#: Lines tried in the search for roots that a triangle does not give.
LINES = 4096
#: Number of those that come nearest to being such roots, which are followed up.
FEW = 16
#: Coefficients along a line below this share of the scale are zero.
VANISHES = 1e-9
#: Number of Gauss-Newton steps towards such roots, longest step, how far they may be [rad].
STEPS, STRIDE, NEAR = 20, 0.1, 0.5
#: Singular values of the derivatives below this share of the largest are zero.
RANK = 1e-5
#: Share of the scale below which another polynomial vanishes at roots of a resultant, to which
#: Newton's method then moves them.
ALMOST = 1e-5
#: Values of polynomials at a common root are below this share of their size.
COMMON = 1e-6
#: Highest degree of a resultant.
HIGHEST = 24
#: Up to this many polynomials all orders are tried.
MOST_ORDERS = 5


@dataclass(frozen=True, eq=False)
class Triangle:
    """Polynomials and the joints they are solved for, in order.

    Attributes:
        polynomials: f_1, ..., f_c, of n angles each.
        joints: j_1, ..., j_c.
        other: The other one of a pair with f_c, where f_1 is their resultant.
        checks: Polynomials that vanish at the common roots that are meant; others are left out.
    """

    polynomials: tuple[TrigPolynomial, ...]
    joints: tuple[int, ...]
    other: TrigPolynomial | None = None
    checks: tuple[TrigPolynomial, ...] = ()

    @property
    def n(self) -> int:
        """Number of angles."""
        return self.polynomials[0].n

    @property
    def equations(self) -> tuple[TrigPolynomial, ...]:
        """The polynomials whose common roots are meant, without resultants."""
        return self.polynomials if self.other is None else (self.polynomials[-1], self.other)

    @cached_property
    def relevant(self) -> tuple[int, ...]:
        """The joints that matter."""
        degrees = [f.degrees for f in self.equations]
        return tuple(j for j in range(self.n) if any(d[j] for d in degrees))

    def solve(self, Q: Array, *, sheet: int | None = None) -> Array:
        """Return the common roots that have the free angles of Q (m, n), (r, n).

        Where a polynomial vanishes whatever its joint is, the joint stays as in Q.

        Args:
            Q: Angles; those of `joints` do not matter.
            sheet: Solve f_1 for this joint instead, and return only roots on sheets that do not
                depend on j_1.
        """
        for i, (f, j) in enumerate(zip(self.polynomials, self.joints, strict=True)):
            along = j if i or sheet is None else sheet
            lines = f.along(Q, (along,))
            roots = line_roots(lines)
            row, column = np.nonzero(~np.isnan(roots))
            everywhere = np.flatnonzero(np.abs(lines).max(axis=1) <= NOISE * f.scale)
            found = Q[row]
            found[:, along] = roots[row, column]
            Q = np.concatenate((found, Q[everywhere]))
            if along != j and len(Q):
                Q = Q[np.abs(f.along(Q, (j,))).max(axis=1) <= VANISHES * f.scale]
        if self.other is not None:
            for f in (self.other, *self.checks):
                Q = Q[np.abs(f(Q)) <= ALMOST * f.scale]
            Q = onto(self.equations, Q)
        return Q

    @cached_property
    def sheets(self) -> tuple[int, ...]:
        """Joints along which f_1 has roots on sheets that do not depend on j_1."""
        f, j = self.polynomials[0], self.joints[0]
        rng = np.random.default_rng(0)
        found = []
        for other in (i for i in range(self.n) if f.degrees[i] and i != j):
            line = rng.uniform(-np.pi, np.pi, (1, self.n))
            keep = (min(j, other), max(j, other))
            table = f.along(line, keep)[0]
            if share_root(table if other == keep[0] else table.T):
                found.append(other)
        return tuple(found)

    def having(self, Q: Array) -> Array:
        """Return the common roots that have the free angles of Q (m, n), of all sheets, (r, n)."""
        return np.concatenate([self.solve(Q, sheet=sheet) for sheet in (None, *self.sheets)])

    def crossings(self, Q: Array) -> Array:
        """Return common roots (r, n) on lines through rows of Q (m, n), spread over the set.

        One polynomial is solved along each of the joints that matter in turn. Lines along joint j
        meet a part of the set as often as its projection along j is large, and the projections of a
        part along all joints add up to at least its area. Of several the free angles are as in Q.
        """
        if len(self.polynomials) > 1 or not self.relevant:
            return self.having(Q)
        lines = [(Triangle(self.polynomials, (j,)), i) for i, j in enumerate(self.relevant)]
        return np.concatenate([along.solve(Q[i :: len(lines)]) for along, i in lines])

    def escapes(self, rng: np.random.Generator) -> Array:
        """Look for roots that the triangle does not give, though as many; returns some, (r, n).

        Such are roots of f_1, ..., f_(i-1) at which f_i, i > 1, vanishes whatever j_i is. They are
        sought from those of `LINES` roots of f_1, ..., f_(i-1) at which f_i comes nearest to that.
        They are as many if they are given by no more equations: the rank of the derivatives tells.
        """
        found: list[Array] = [np.empty((0, self.n))]
        for i in range(1, len(self.polynomials)):
            part = Triangle(self.polynomials[:i], self.joints[:i])
            rest = Triangle(self.polynomials[i + 1 :], self.joints[i + 1 :])
            Q = part.having(rng.uniform(-np.pi, np.pi, (LINES, self.n)))
            f, j = self.polynomials[i], self.joints[i]
            size = np.abs(f.along(Q, (j,))).max(axis=1)
            near = Q[np.argsort(size)[:FEW]]
            if len(near):
                found.append(rest.solve(_roots_where_lost(part.polynomials, f, j, near)))
        return np.concatenate(found)


def _roots_where_lost(
    others: tuple[TrigPolynomial, ...], f: TrigPolynomial, j: int, Q: Array
) -> Array:
    """Find roots of `others` near those of Q (m, n) at which f vanishes whatever q_j is.

    Left out are those that take more equations than the roots of `others` and f.
    """
    jets, line = [Jets.of(g) for g in others], Jets.of(f)
    turns = 2.0 * np.pi * np.arange(2 * f.degrees[j] + 1) / (2 * f.degrees[j] + 1)

    def equations(X: Array) -> tuple[Array, Array]:
        lines = X.repeat(len(turns), axis=0)
        lines[:, j] = np.tile(turns, len(X))
        along = line(lines, 1)
        slopes = along.gradient.reshape(len(X), -1, f.n).copy()
        slopes[:, :, j] = 0.0
        values, gradients = stacked(jets, X, 1)[:2]
        values = np.column_stack((values, along.value.reshape(len(X), -1)))
        return values, np.concatenate((gradients, slopes), axis=1)

    X = Q
    for _ in range(STEPS):
        values, slopes = equations(X)
        step = (np.linalg.pinv(slopes, rcond=1e-6) @ values[:, :, None])[..., 0]
        X = X - shortened(step, STRIDE)
    values, slopes = equations(X)
    sigma = np.linalg.svd(slopes, compute_uv=False)
    rank = (sigma > RANK * sigma[:, :1]).sum(axis=1)
    solved = (np.abs(values).max(axis=1) < VANISHES) & (np.linalg.norm(X - Q, axis=1) < NEAR)
    return X[solved & (rank <= len(others) + 1)]


def share_root(polynomials: Complex) -> bool:
    """Check whether polynomials in one angle (2 d + 1, r), by column, have a common complex root.

    The coefficients need not be those of real functions.
    """
    size = np.abs(polynomials).max()
    columns = polynomials[:, np.abs(polynomials).max(axis=0) > VANISHES * size]
    if not columns.size:
        return False
    mix = np.random.default_rng(0).normal(size=(2, columns.shape[1]))
    f = columns @ (mix[0] + 1j * mix[1])
    used = np.flatnonzero(np.abs(f) > 1e-12 * np.abs(f).max())
    z = np.roots(f[used[0] : used[-1] + 1][::-1])
    z = z[np.abs(z) > 1e-9]
    power = np.arange(len(f))
    waves = z[:, None] ** (power - np.where(np.abs(z)[:, None] > 1.0, power[-1], 0))
    values = np.abs(waves @ columns) / (np.abs(waves) @ np.abs(columns))
    return bool((values.max(axis=1) < COMMON).any())


def eliminate(
    f: TrigPolynomial, g: TrigPolynomial, j: int, checks: tuple[TrigPolynomial, ...]
) -> Triangle | None:
    """Eliminate joint j, in which f and g have degree 1; None if nothing is left."""

    def resultant(Q: Array) -> Array:
        lines = [h.along(Q, (j,)) / h.scale for h in (f, g)]
        (a, b, c), (d, e, k) = (
            (2.0 * x[:, 2].real, -2.0 * x[:, 2].imag, x[:, 1].real) for x in lines
        )
        return np.asarray((b * k - e * c) ** 2 + (d * c - a * k) ** 2 - (a * e - b * d) ** 2)

    F = TrigPolynomial.fit(resultant, f.n, highest=HIGHEST)
    left = [i for i, d in enumerate(F.degrees) if d]
    if not left or F.scale < VANISHES:
        return None
    return Triangle((F, f), (min(reversed(left), key=lambda i: F.degrees[i]), j), g, checks)


def find_triangle(
    supports: list[tuple[int, ...]],
) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
    """Order polynomials so that they form a triangle, with joints of least degree.

    Args:
        supports: The degrees of each polynomial in each joint.

    Returns:
        The order of the polynomials and the joint of each, or None.
    """
    numbers = range(len(supports))
    by_size = tuple(sorted(numbers, key=lambda i: sum(d > 0 for d in supports[i])))
    best, least = None, math.inf
    for order in permutations(numbers) if len(supports) <= MOST_ORDERS else [by_size]:
        used: set[int] = set()
        joints: list[int] = []
        for i in order:
            new = [j for j, d in enumerate(supports[i]) if d and j not in used]
            if not new:
                break
            joints.append(min(reversed(new), key=lambda j: supports[i][j]))
            used |= {j for j, d in enumerate(supports[i]) if d}
        work = math.prod(supports[i][j] for i, j in zip(order, joints, strict=False))
        if len(joints) == len(supports) and work < least:
            best, least = (order, tuple(joints)), work
    return best
