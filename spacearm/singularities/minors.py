"""The maximal minors of the task Jacobian: polynomials whose common roots are the singular set.

For columns C of J*, as many as the task has rows k, det [A_b A_q; J_b J_q] of these columns is
det(A_b) det(J*[:, C]), a trigonometric polynomial like S of a square arm
(`singularity_polynomial`).
J* has rank k - 1 or less exactly where all of them vanish. Let k - 1 columns B be independent: then
those with B and one column more suffice. Seen from the tip held still, column j is the momentum of
all on the spacecraft's side of joint j, so that those minors of the full pose with B the first five
columns form a triangle (`Triangle`): the one with column j has degree 1 in joint j - 1 and does not
contain joint j or later ones.

A sliding joint d = centre + half cos(angle) enters by its angle, see `Chart`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import combinations

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.polynomial.fit import Sampler, degrees_of
from spacearm.polynomial.jets import Chart, Jets
from spacearm.polynomial.triangle import Triangle, eliminate, find_triangle, share_root
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.singularities.polynomial import minor_sampler
from spacearm.singularities.rank_loss import is_singular, lose_rank

ANYWHERE = 1.0
"""A sliding joint without limits is covered this far to both sides of zero [m]."""
PROBES = 256
"""Random configurations at which minors that vanish everywhere are told from others."""
HIGHEST = 12
"""Highest degree looked for in one joint."""
ABSENT = 1e-11
"""Share of the largest minor below which one vanishes everywhere."""
MOST_MINORS = 500
"""Largest number of maximal minors."""
MOST_COEFFICIENTS = 1_000_000
"""Largest number of coefficients of minors that are used together."""
BASES = 3
"""Number of choices of the columns B that are tried."""
SEARCHES = 8
"""Singular configurations found otherwise, which the triangle must give."""
VANISHES = 1e-8
"""Share of the scale below which a polynomial vanishes along a line."""

Columns = tuple[int, ...]


def chart_of(arm: SpaceArm) -> Chart:
    """Return the ranges of sliding joints: their limits, `ANYWHERE` where there are none."""
    low = np.where(np.isfinite(arm.lower), arm.lower, -ANYWHERE)
    high = np.where(np.isfinite(arm.upper), arm.upper, ANYWHERE)
    flat = high - low <= 0.0
    low, high = low - ANYWHERE * flat, high + ANYWHERE * flat
    return Chart(
        arm.slides,
        np.where(arm.slides, (low + high) / 2.0, 0.0),
        np.where(arm.slides, (high - low) / 2.0, 1.0),
    )


@dataclass(frozen=True, eq=False)
class Minors:
    """The maximal minors of an arm; made by `minors_of`.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        chart: The angles of which the minors are polynomials.
        degrees: The degrees of each minor in each joint, by its columns; without those that vanish
            identically.
    """

    arm: SpaceArm
    mode: BaseMode
    chart: Chart
    degrees: dict[Columns, tuple[int, ...]]
    _fitted: dict[Columns, Jets] = field(default_factory=dict, repr=False)

    def __getitem__(self, columns: Columns) -> Jets:
        """Return one minor, of scale 1; fitted when it is first asked for."""
        if columns not in self._fitted:
            sampler = _of_angles(self.arm, self.mode, self.chart, [columns])
            (f,) = TrigPolynomial.fit_each(sampler, self.arm.n, highest=HIGHEST)
            self._fitted[columns] = Jets.of(f, self.chart)
        return self._fitted[columns]

    def every(self) -> list[Jets]:
        """Return all minors that do not vanish identically."""
        return self._together(list(self.degrees))

    def with_columns(self, B: Columns) -> list[Jets]:
        """Return the minors with columns B and one more; they decide where B is independent."""
        return self._together(self._minors_with(B))

    @cached_property
    def few(self) -> list[Jets]:
        """Minors that have all columns but one in common, those with the fewest coefficients.

        Where one is not zero the arm is regular; where all are zero it need not be singular.
        """
        bases = combinations(range(self.arm.n), self.arm.task.k - 1)
        choices = [own for own in map(self._minors_with, bases) if len(own) >= self.codimension]
        return self._together(min(choices, key=self._size)) if choices else []

    def _together(self, columns: list[Columns]) -> list[Jets]:
        """Return several minors.

        Raises:
            UnsupportedError: They have too many coefficients.
        """
        if (size := self._size(columns)) > MOST_COEFFICIENTS:
            raise UnsupportedError(
                f"{self.arm.name}: {len(columns)} minors of J* have {size:.3g} coefficients, of "
                f"which {MOST_COEFFICIENTS:.0e} at most are kept; lock joints"
            )
        return [self[C] for C in columns]

    def _size(self, columns: list[Columns]) -> int:
        """Return how many coefficients minors have."""
        return sum(math.prod(2 * d + 1 for d in self.degrees[C]) for C in columns)

    def _minors_with(self, B: Columns) -> list[Columns]:
        """Return the columns B with one more, where that minor does not vanish identically."""
        every = (tuple(sorted((*B, j))) for j in range(self.arm.n) if j not in B)
        return [C for C in every if C in self.degrees]

    @property
    def codimension(self) -> int:
        """Number of equations that singular configurations fulfil."""
        return self.arm.n - self.arm.task.k + 1

    @property
    def triangle(self) -> Triangle | None:
        """The minors that give the whole singular set; None if no choice of columns does so."""
        return self._chosen[0]

    @cached_property
    def sifted(self) -> bool:
        """Whether roots of the triangle need not be singular: at some of them B is dependent.

        That is so if it takes joints that the triangle gives to make B dependent; otherwise it
        takes values of the free joints that are never drawn. Of one polynomial all roots count.
        """
        triangle, B = self._chosen
        rng = np.random.default_rng(1)
        for _ in range(SEARCHES if triangle is not None and self.codimension > 1 else 0):
            q = lose_rank(self.arm, self._random(rng), self.mode, B)
            if q is not None and triangle is not None:
                given = list(triangle.joints)
                q[given] = self._random(rng)[given]
                if not is_singular(self.arm, q, self.mode, B):
                    return True
        return False

    @cached_property
    def _chosen(self) -> tuple[Triangle | None, Columns]:
        """The triangle, if there is one, and the columns B of its minors.

        A choice of k - 1 columns B does if the minors with B form a triangle and

        - do not all vanish on a set of one dimension less than joint space;
        - give all singular configurations where B is independent (`Triangle.escapes`);
        - configurations at which B is dependent are singular only in a set of fewer dimensions.

        Where no minors form a triangle, a resultant of two may make one, as for "x y" with n = 3.

        Checked is the first on a random line along each joint, in complex numbers; the others near
        thousands of roots, and by a search for singular configurations and for dependent columns.
        """
        k, n = self.arm.task.k, self.arm.n
        choices = []
        for B in combinations(range(n), k - 1):
            own = self._minors_with(B)
            found = find_triangle([self.degrees[C] for C in own]) if own else None
            size = self._size(own)
            if found is not None and size <= MOST_COEFFICIENTS:
                order, joints = found
                pairs = zip(order, joints, strict=True)
                work = math.prod(self.degrees[own[i]][j] for i, j in pairs)
                choices.append((work, size, B, [own[i] for i in order], joints))
        for _, _, B, columns, solved in sorted(choices)[:BASES]:
            triangle = Triangle(tuple(self[C].polynomial for C in columns), solved)
            if self._is_whole(triangle, B):
                return triangle, B
        return self._eliminated() if not choices and self.codimension == 2 else (None, ())

    def _eliminated(self) -> tuple[Triangle | None, Columns]:
        """Return a triangle made with the resultant of two minors of degree 1 in one joint."""
        for B in combinations(range(self.arm.n), self.arm.task.k - 1):
            own = self._minors_with(B)
            small = self._size(own) <= MOST_COEFFICIENTS
            for j in range(self.arm.n) if small else ():
                if len(own) == 2 and all(self.degrees[C][j] == 1 for C in own):
                    f, g = (self[C].polynomial for C in own)
                    checks = tuple(self[C].polynomial for C in self.degrees if C not in own)
                    triangle = eliminate(f, g, j, checks)
                    if triangle is not None and self._is_whole(triangle, B):
                        return triangle, B
        return None, ()

    def _is_whole(self, triangle: Triangle, B: Columns) -> bool:
        """Check whether a triangle gives the whole set."""
        if self.codimension == 1:
            return True
        rng = np.random.default_rng(0)
        if _share_factor(triangle.equations, rng):
            return False
        escaped = self.chart.positions(triangle.escapes(rng))
        if any(is_singular(self.arm, q, self.mode) for q in escaped):
            return False
        for _ in range(SEARCHES):
            q = lose_rank(self.arm, self._random(rng), self.mode)
            if q is not None and (
                is_singular(self.arm, q, self.mode, B) or not _given(triangle, self.chart.angles(q))
            ):
                return False
            q = lose_rank(self.arm, self._random(rng), self.mode, B)
            if q is not None and is_singular(self.arm, q, self.mode):
                return False
        return True

    def _random(self, rng: np.random.Generator) -> Array:
        """Draw a configuration."""
        return self.chart.positions(rng.uniform(-np.pi, np.pi, self.arm.n))


def has_minors(arm: SpaceArm) -> bool:
    """Check whether an arm has maximal minors, and not too many."""
    return arm.coupling is None and 0 < math.comb(arm.n, arm.task.k) <= MOST_MINORS


@lru_cache(maxsize=16)
def minors_of(arm: SpaceArm, mode: BaseMode) -> Minors:
    """Find the degrees of all maximal minors of an arm.

    Args:
        arm: The arm.
        mode: What the spacecraft does.

    Raises:
        UnsupportedError: The arm has mimic joints, too many minors or polynomials of too high a
            degree, or can never do its task.
    """
    k, n = arm.task.k, arm.n
    if not has_minors(arm):
        raise UnsupportedError(
            f"{arm.name}: J* has no minors that are polynomials of the joint positions, because "
            f"joints mimic others, or too many of them ({math.comb(n, k)}, at most {MOST_MINORS})"
        )
    own, every = chart_of(arm), np.array(list(combinations(range(n), k)))
    rng = np.random.default_rng(0)
    probes = own.positions(rng.uniform(-np.pi, np.pi, (PROBES, n)))
    size = np.abs(minor_sampler(arm, every, mode)(probes)).max(axis=0)
    some = every[size > ABSENT * size.max()]
    degrees = degrees_of(_of_angles(arm, mode, own, some), n, HIGHEST, rng)
    by_columns = {
        tuple(map(int, C)): tuple(map(int, d)) for C, d in zip(some, degrees.T, strict=True)
    }
    return Minors(arm, mode, own, by_columns)


def _of_angles(arm: SpaceArm, mode: BaseMode, own: Chart, columns: Iterable[Columns]) -> Sampler:
    """Return the function that computes minors (m, len(columns)) at angles (m, n)."""
    sampler = minor_sampler(arm, columns, mode)
    return lambda angles: sampler(own.positions(angles))


def _share_factor(polynomials: Sequence[TrigPolynomial], rng: np.random.Generator) -> bool:
    """Check whether polynomials have a common factor: common roots on a line along a joint."""
    n = polynomials[0].n
    for j in range(n):
        line = rng.uniform(-np.pi, np.pi, (1, n))
        along = [f.along(line, (j,))[0] for f in polynomials]
        d = max(len(c) for c in along) // 2
        if d and share_root(np.stack([np.pad(c, d - len(c) // 2) for c in along], axis=1)):
            return True
    return False


def _given(triangle: Triangle, angles: Array) -> bool:
    """Check whether a triangle gives a root: only the first polynomial may vanish on a line.

    Roots beyond the range of a sliding joint have no angles (NaN) and do not count.
    """
    if np.isnan(angles).any():
        return True
    return all(
        np.abs(f.along(angles[None], (j,))).max() > VANISHES * f.scale
        for f, j in zip(triangle.polynomials[1:], triangle.joints[1:], strict=True)
    )
