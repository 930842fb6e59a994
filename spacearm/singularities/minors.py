"""The maximal minors of the task Jacobian: polynomials whose common roots are the singular set.

For columns C of J*, as many as the task has rows k, det [A_b A_q; J_b J_q] of these columns is
det(A_b) det(J*[:, C]), a trigonometric polynomial like S of a square arm (`singularity_polynomial`).
J* has rank k - 1 or less exactly where all of them vanish. Let k - 1 columns B be independent: then
those with B and one column more suffice. Seen from the tip held still, column j is the momentum of
all on the spacecraft's side of joint j, so that those minors of the full pose with B the first five
columns form a triangle (`Triangle`): the one with column j has degree 1 in joint j - 1 and does not
contain joint j or later ones.

A sliding joint d = centre + half cos(angle) enters by its angle, see `Chart`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import combinations
from math import comb

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.polynomial.jets import Chart, Jets
from spacearm.polynomial.trig import Sampler, TrigPolynomial
from spacearm.polynomial.triangle import Triangle, find_triangle, share_root
from spacearm.singularities.polynomial import NEVER, plane_of_motion
from spacearm.singularities.rank_loss import is_singular, lose_rank

ANYWHERE = 1.0
"""A sliding joint without limits is covered this far to both sides of zero [m]."""
LINES = 4
"""Lines along each joint on which degrees are found."""
HIGHEST = 12
"""Highest degree looked for in one joint."""
ABSENT = 1e-11
"""Share of the largest coefficient or minor below which it counts as zero."""
MOST_MINORS = 500
"""Largest number of maximal minors."""
MOST_COEFFICIENTS = 1_000_000
"""Largest number of coefficients of the minors of a triangle."""
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
            sampler = _sampler(self.arm, self.mode, self.chart, [columns])
            f = TrigPolynomial.fit(lambda A: sampler(A)[:, 0], self.arm.n)
            self._fitted[columns] = Jets(TrigPolynomial(f.coefficients / f.scale), self.chart)
        return self._fitted[columns]

    def every(self) -> list[Jets]:
        """Return all minors that do not vanish identically."""
        return [self[C] for C in self.degrees]

    def with_columns(self, B: Columns) -> list[Jets]:
        """Return the minors with columns B and one more; they decide where B is independent."""
        own = (tuple(sorted((*B, j))) for j in range(self.arm.n) if j not in B)
        return [self[C] for C in own if C in self.degrees]

    @property
    def codimension(self) -> int:
        """Number of equations that singular configurations fulfil."""
        return self.arm.n - self.arm.task.k + 1

    @cached_property
    def triangle(self) -> Triangle | None:
        """The minors that give the whole singular set; None if no choice of columns does so.

        A choice of k - 1 columns B does if the minors with B form a triangle and

        - do not all vanish on a set of one dimension less than joint space;
        - give all singular configurations where B is independent (`Triangle.escapes`);
        - configurations at which B is dependent are singular only in a set of fewer dimensions.

        Checked is the first on a random line along each joint, in complex numbers; the others near
        thousands of roots, and by a search for singular configurations and for dependent columns.
        """
        k, n = self.arm.task.k, self.arm.n
        choices = []
        for B in combinations(range(n), k - 1):
            own = [C for j in range(n) if j not in B and (C := tuple(sorted((*B, j)))) in self.degrees]
            found = find_triangle([self.degrees[C] for C in own]) if own else None
            size = sum(np.prod([2.0 * d + 1.0 for d in self.degrees[C]]) for C in own)
            if found is not None and size <= MOST_COEFFICIENTS:
                order, joints = found
                work = np.prod([self.degrees[own[i]][j] for i, j in zip(order, joints, strict=True)])
                choices.append((work, size, B, [own[i] for i in order], joints))
        for _, _, B, order, joints in sorted(choices)[:BASES]:
            triangle = Triangle(tuple(self[C].polynomial for C in order), joints)
            if self._is_whole(triangle, B):
                return triangle
        return None

    def _is_whole(self, triangle: Triangle, B: Columns) -> bool:
        """Check whether a triangle gives the whole set."""
        if self.codimension == 1:
            return True
        rng = np.random.default_rng(0)
        if _share_factor(triangle.polynomials, rng):
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
    return arm.coupling is None and 0 < comb(arm.n, arm.task.k) <= MOST_MINORS


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
            f"joints mimic others, or too many of them ({comb(n, k)}, at most {MOST_MINORS})"
        )
    own, every = chart_of(arm), list(combinations(range(n), k))
    sampler = _sampler(arm, mode, own, every)
    rng, N = np.random.default_rng(0), 2 * HIGHEST + 3
    largest, spectra = np.zeros(len(every)), []
    for j in range(n):
        lines = rng.uniform(-np.pi, np.pi, (LINES, 1, n)).repeat(N, axis=1)
        lines[:, :, j] = 2.0 * np.pi * np.arange(N) / N
        values = sampler(lines.reshape(-1, n)).reshape(LINES, N, -1)
        largest = np.maximum(largest, np.abs(values).max(axis=(0, 1)))
        spectra.append(np.abs(np.fft.rfft(values, axis=1)).max(axis=0) / N)
    degrees = {}
    for i in np.flatnonzero(largest > ABSENT * largest.max()):
        above = [np.flatnonzero(s[:, i] > ABSENT * largest[i]) for s in spectra]
        degrees[every[i]] = tuple(int(a.max(initial=0)) for a in above)
        if max(degrees[every[i]]) > HIGHEST:
            raise UnsupportedError(f"{arm.name}: minors of J* have a degree above {HIGHEST}")
    return Minors(arm, mode, own, degrees)


def _sampler(arm: SpaceArm, mode: BaseMode, own: Chart, columns: Sequence[Columns]) -> Sampler:
    """Return the function that computes minors (m, len(columns)) at angles (m, n).

    Raises:
        UnsupportedError: The arm can never do its task.
    """
    rng = np.random.default_rng(0)
    probes = [arm.at(q) for q in own.positions(rng.uniform(-np.pi, np.pi, (32, arm.n)))]
    normal = plane_of_motion(arm, probes)
    jacobians = np.array([task_jacobian(cfg, mode=mode) for cfg in probes])
    sigma = np.linalg.svd(jacobians, compute_uv=False)
    if (sigma[:, -1] <= NEVER * sigma[:, 0]).all():
        raise UnsupportedError(
            f"{arm.name}: the task {arm.task.names!r} is singular at every configuration; choose "
            "rows that the arm can move along"
        )
    D_unit = max(np.abs(cfg.A[3:, 3:6]).max() for cfg in probes)  # neither tiny nor huge arms
    J_unit = np.abs(jacobians).max()  # may leave the range of floating-point numbers
    index = np.array(columns)

    def determinants(angles: Array) -> Array:
        cfgs = [arm.at(q) for q in own.positions(angles)]
        J = np.array([task_jacobian(cfg, mode=mode) for cfg in cfgs]) / J_unit
        det = np.linalg.det(J[:, :, index].transpose(0, 2, 1, 3))
        if mode != "free-floating":
            return det
        D = np.array([cfg.A[3:, 3:6] for cfg in cfgs]) / D_unit
        factor = np.linalg.det(D) if normal is None else D[:, normal, normal]
        return np.asarray(det * factor[:, None])

    return determinants


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
    """Check whether a triangle gives a root: no polynomial after the first vanishes along a line."""
    return all(
        np.abs(f.along(angles[None], (j,))).max() > VANISHES * f.scale
        for f, j in zip(triangle.polynomials[1:], triangle.joints[1:], strict=True)
    )
