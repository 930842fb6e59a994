"""The exact singular set of an arm: the common roots of minors that form a triangle.

A square arm has one minor, the singularity polynomial S, whose roots along any joint are the whole
set. The minors of a redundant arm form a triangle (`Minors.triangle`): all joints but a few are
free, and these follow one after the other in closed form. Newton's method is used only to find the
member nearest to a configuration and the extremes of the tip's distance R on a component.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spacearm.arrays import Array, ArrayLike, Booleans, Progress, whole
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.batch import conditions
from spacearm.mechanics.distance import AT_A_ROOT
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_name, joint_vector
from spacearm.polynomial import level_set
from spacearm.polynomial.certificate import Certificate
from spacearm.polynomial.jets import Chart, Jets
from spacearm.polynomial.newton import bounded_extreme, polish
from spacearm.polynomial.triangle import Triangle
from spacearm.polynomial.trig import NOISE, TrigPolynomial
from spacearm.polynomial.univariate import Roots, distinct, line_roots, wrap
from spacearm.signatures import checked
from spacearm.singularities.abstract_set import Component, SingularSet, check_sampled, prove_free
from spacearm.singularities.polynomials import distances, radius_squared

#: Values of a joint that S does not depend on, from which extremes of R are searched.
TURNS = 96
#: Number of points from which each is then searched, the best ones so far apart [rad]; on curves,
#: whose points lie close together, one does.
STARTS, APART = 4, 0.5


def extremes(arm: SpaceArm, mode: BaseMode, S: TrigPolynomial, points: Array) -> Array:
    """Find configurations (2, n) of the least and the largest R on a component.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        S: The singularity polynomial.
        points: (m, n) points on the component, or near to it.
    """
    R2 = radius_squared(arm, mode=mode)
    starts, free = points, [j for j in range(arm.n) if not S.degrees[j]]
    for j in free:
        starts = starts.repeat(TURNS, axis=0)
        starts[:, j] = np.tile(2.0 * np.pi * np.arange(TURNS) / TURNS, len(starts) // TURNS)
    squares, count = R2(starts), STARTS if arm.n > 2 else 1
    low = _best(R2, S, starts, squares, 1.0, count)
    high = _best(R2, S, starts, squares, -1.0, count)
    return np.array([low, high])


def _best(
    F: TrigPolynomial, S: TrigPolynomial, starts: Array, values: Array, sign: float, count: int
) -> Array:
    """Return the configuration with the least sign * F on S = 0 near some starts, best first.

    `values` (m,) are those of F at the starts (m, n).
    """
    tried = list[Array]()
    while len(starts):
        start = starts[int(np.argmin(sign * values))]
        tried.append(bounded_extreme(F, (S,), polish(S, start[None])[0], sign))
        if len(tried) == count:
            break
        apart = (np.abs(wrap(starts - start)) > APART).any(axis=1)
        starts, values = starts[apart], values[apart]
    return min(tried, key=lambda q: sign * F(q))


#: Lines without any root after which a set counts as empty.
MOST_LINES = 1 << 17
#: Share of the scale below which a polynomial vanishes at a root of another.
VANISHES = 1e-9


@checked
@dataclass(frozen=True, eq=False, repr=False)
class ExactSet(SingularSet):
    """The whole singular set of an arm whose minors form a triangle.

    Of square arms it lacks nothing. Of redundant arms it lacks configurations in a set of fewer
    dimensions: there the first k - 1 columns, which the minors share, are dependent, and the
    others do not make up for it. They are limits of members as a rule. `is_free` proves paths free
    of them too.

    A sliding joint counts within its limits, or 1 m to both sides of zero where it has none.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        triangle: The minors, polynomials of the angles in `chart`, and the joints they give.
        chart: The angles of the joints: those of revolute joints themselves.
        sifted: Whether roots of the triangle need not be singular; see `Minors.sifted`.
    """

    triangle: Triangle
    chart: Chart
    sifted: bool = False

    complete = True

    @property
    def codimension(self) -> int:
        """Number of minors: equations that singular configurations fulfil."""
        return len(self.triangle.equations)

    @property
    def S(self) -> TrigPolynomial:
        """The singularity polynomial of an arm with as many revolute joints as task rows."""
        if self.codimension > 1 or self.chart.slides.any():
            raise UnsupportedError(
                f"{self.arm.name}: only arms with as many revolute joints as task rows have a "
                f"singularity polynomial; this set is given by {self.codimension} of the angles "
                "in .triangle.polynomials"
            )
        return self.triangle.polynomials[0]

    @property
    def relevant(self) -> tuple[int, ...]:
        """Numbers of the joints that the set depends on."""
        return self.triangle.relevant

    @property
    def dimension(self) -> int:
        """Dimension of the set in the space of the relevant joints."""
        return len(self.relevant) - self.codimension

    @cached_property
    def _jets(self) -> list[Jets]:
        """The minors with their derivatives, functions of the joint positions, of scale 1."""
        return [Jets.of(f, self.chart) for f in self.triangle.equations]

    def __repr__(self) -> str:
        degrees = ", ".join(str(f.degrees) for f in self.triangle.equations)
        return f"ExactSet({self.arm.label}, degrees {degrees})"

    def roots(self, q: ArrayLike, joint: int | str | None = None) -> Roots:
        """Find every singular value of one joint; see `SingularSet.roots`."""
        j = self._joint(joint)
        point = self._angles(joint_vector(self.arm, q, "q"), j)[None]
        lines = [(f, f.along(point, (j,))) for f in self.triangle.equations]
        moving = [(f, line) for f, line in lines if np.abs(line).max() > NOISE * f.scale]
        if not moving:
            return Roots(np.empty(0), np.empty(0, dtype=int), True)
        angles, multiplicity = distinct(line_roots(moving[0][1])[0])
        at = point.repeat(len(angles), axis=0)
        at[:, j] = angles
        common = [np.abs(f(at)) <= VANISHES * f.scale for f, _ in moving[1:]]
        kept = np.logical_and.reduce([~self.chart.slides[j] | (angles >= 0.0), *common])
        kept[kept] = self.are_singular(self.chart.positions(at[kept]))
        at, multiplicity = self.chart.positions(at[kept]), multiplicity[kept]
        order = np.argsort(at[:, j])
        return Roots(at[order, j], multiplicity[order], False)

    def solve(self, q: ArrayLike) -> Array:
        """Find all singular configurations that have the free joints of q; see `SingularSet`."""
        point = self._angles(joint_vector(self.arm, q, "q"), *self.triangle.joints)
        return self._proper(self.triangle.solve(point[None]))

    def sample(self, m: int, rng: np.random.Generator | None = None) -> Array:
        """Sample m singular configurations that cover the set, angles in (-pi, pi].

        Raises:
            ConfigurationError: m is not a whole number from 0 on.
            NoSolutionError: The set is empty, or so small that none of many lines meets it.
        """
        m, rng = whole(m, "m", 0), rng or np.random.default_rng()
        check_sampled(self.arm, m)
        found, count, lines = [], 0, 0
        first = 256 if self.codimension == 1 else min(256, m)  # enough along each of the joints
        while count < m:
            draws = max(256, int((m - count) * (lines + 1) / (count + 1) * 1.1))
            draws = min(draws, 1 << 16) if lines else first
            batch = self._proper(self.triangle.crossings(self._draw(draws, rng)))
            found.append(rng.permutation(batch))
            count, lines = count + len(batch), lines + draws
            if not count and (lines > MOST_LINES or not self.relevant):
                raise NoSolutionError(
                    f"{self.arm.name}, {self.mode}: none of {lines} lines meets the singular set; "
                    "it is empty or very small"
                )
        return np.concatenate([np.empty((0, self.arm.n)), *found])[:m]

    def _proof(self, path: ArrayLike, limits: bool, progress: Progress | None) -> Certificate:
        """Prove that a path of straight segments (m, n) meets no singularity."""
        proof = prove_free(self.arm, self.mode, self._jets, path, limits, progress)
        if self.codimension == 1 or proof.verdict != "undecided":
            return proof
        return super()._proof(path, limits, progress)  # all minors prove more

    def curves(
        self,
        joints: Sequence[int | str] | None = None,
        q: ArrayLike | None = None,
        *,
        resolution: float = 0.0,
    ) -> list[Array]:
        """Trace the set over some joints; see `SingularSet.curves`."""
        chosen, centre = self._slice(joints, q, 1)

        def singular(points: Array) -> Booleans:
            return self.are_singular(self._embed(points, chosen, centre))

        pieces = level_set.curves(self._reduced(chosen, centre), singular, resolution)
        return [self._embed(piece, chosen, centre) for piece in pieces]

    def surface(
        self,
        joints: Sequence[int | str] | None = None,
        q: ArrayLike | None = None,
        *,
        resolution: float = 0.0,
    ) -> level_set.Mesh:
        """Triangulate the set over some joints; see `SingularSet.surface`."""
        chosen, centre = self._slice(joints, q, 2)
        (S,) = self._reduced(chosen, centre)
        return level_set.surface(S, resolution)

    def components(self) -> list[Component]:
        """Find the connected components; see `SingularSet.components`."""
        if self.codimension > 1:
            raise UnsupportedError(
                f"{self.arm.name}: the set has {self.codimension} equations; components are those "
                "of sets with one. Use .curves and .sample"
            )
        ends = [extremes(self.arm, self.mode, self.S, piece) for piece in self.pieces]
        return [
            Component(piece, distances(self.arm, at, self.mode), at)
            for piece, at in zip(self.pieces, ends, strict=True)
        ]

    @cached_property
    def pieces(self) -> list[Array]:
        """Points (m, n) on each connected piece of a set of up to two dimensions."""
        if self.dimension == 0:
            return [point[None] for point in self.triangle.solve(np.zeros((1, self.arm.n)))]
        if self.dimension == 1:
            return self.curves()
        return [polish(self.S, piece) for piece in self.rough_pieces()]

    def rough_pieces(self, resolution: float = 0.0) -> list[Array]:
        """Find points (m, n) near each connected piece of a set of up to two dimensions.

        Those of curves are on the set. Those of surfaces are only near it.

        Args:
            resolution: Grids for surfaces need not be finer than this [rad]: pieces that are nearer
                to each other may become one, and smaller ones may be missed.
        """
        if self.dimension < 2:
            return self.pieces
        chosen, centre = self._slice(None, None, 2)
        mesh = level_set.rough_surface(self._reduced(chosen, centre)[0], resolution)
        edges = mesh.triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
        return level_set.connected(self._embed(mesh.vertices, chosen, centre), edges)

    # --- parts ------------------------------------------------------------------------------

    def _angles(self, q: Array, *solved: int) -> Array:
        """Return the angles of a configuration; those of joints to solve for do not matter."""
        angles = self.chart.angles(q).copy()
        angles[list(solved)] = 0.0
        if (beyond := np.flatnonzero(np.isnan(angles))).size:
            j = int(beyond[0])
            middle, half = self.chart.centre[j], self.chart.half[j]
            raise ConfigurationError(
                f"q of joint {self.arm.joint_names[j]!r} is {q[j]:.6g}; the set is known from "
                f"{middle - half:.6g} to {middle + half:.6g}"
            )
        return angles

    def _draw(self, m: int, rng: np.random.Generator) -> Array:
        """Draw angles (m, n), such that positions are uniform."""
        turns = rng.uniform(-np.pi, np.pi, (m, self.arm.n))
        return np.where(self.chart.slides, np.arccos(turns / np.pi), turns)

    def having(self, angles: Array) -> Array:
        """Find the members (r, n) that have the free angles of rows (m, n), of all sheets."""
        return self._proper(self.triangle.having(angles))

    def _proper(self, angles: Array) -> Array:
        """Return the positions of roots (m, n), without the second angle of a sliding joint."""
        kept = (angles[:, self.chart.slides] >= 0.0).all(axis=1)
        Q = self.chart.positions(angles[kept])
        return Q[self.are_singular(Q)] if self.sifted else Q

    def are_singular(self, Q: Array) -> Booleans:
        """Return which common roots of the minors are singular: of one minor all are.

        Args:
            Q: (m, n) the roots.
        """
        if self.codimension == 1 or not len(Q):
            return np.ones(len(Q), dtype=bool)
        return ~(conditions(self.arm, Q, self.mode) < 1.0 / AT_A_ROOT)

    def _slice(
        self, joints: Sequence[int | str] | None, q: ArrayLike | None, dimension: int
    ) -> tuple[tuple[int, ...], Array]:
        """Return the joints over which a picture of a dimension is taken, and all positions."""
        centre = joint_vector(self.arm, np.zeros(self.arm.n) if q is None else q, "q")
        named = self.relevant if joints is None else [self._joint(j) for j in joints]
        chosen, wanted = tuple(sorted(set(named))), dimension + self.codimension
        if len(chosen) != wanted:
            raise UnsupportedError(
                f"{self.arm.name}: a singular set of dimension {dimension} is one over {wanted} "
                f"joints, not {len(chosen)}; name {wanted} with joints=, or use .sample and .roots"
            )
        if sliding := [self.arm.joint_names[j] for j in chosen if self.arm.slides[j]]:
            raise UnsupportedError(
                f"joint {sliding[0]!r} slides; pictures are over revolute joints"
            )
        return chosen, centre

    def _reduced(self, chosen: tuple[int, ...], centre: Array) -> list[TrigPolynomial]:
        """Return the minors as functions of the chosen joints, the others as in `centre`."""
        held = self._angles(centre, *chosen)
        others = {j: float(held[j]) for j in range(self.arm.n) if j not in chosen}
        return [f.fix(others) if others else f for f in self.triangle.equations]

    def _embed(self, points: Array, chosen: tuple[int, ...], centre: Array) -> Array:
        """Return points of the chosen joints as configurations, the others as in `centre`."""
        full = np.tile(centre, (len(points), 1))
        full[:, list(chosen)] = points
        return full

    def _joint(self, joint: int | str | None) -> int:
        """Return the number of a joint given by number or name; the last one solved for if None."""
        if joint is None:
            return self.triangle.joints[-1]
        if isinstance(joint, str):
            return self.arm.joint_names.index(joint_name(self.arm, joint))
        return whole(joint, "joint", 0, self.arm.n - 1)
