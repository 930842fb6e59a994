"""The exact singular set of an arm: the roots of its singularity polynomial.

S(q) vanishes exactly where the task Jacobian is singular (see `singularity_polynomial`), so that
its roots are the whole set. Newton's method only polishes their last digits.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, whole
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.model.joints import joint_name, joint_vector
from spacearm.polynomial import level_set
from spacearm.polynomial.certificate import Certificate, certify
from spacearm.polynomial.nearest import nearest_root
from spacearm.polynomial.newton import extreme
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.univariate import Roots
from spacearm.singularities.abstract_set import Component, SingularSet
from spacearm.singularities.polynomial import distances, radius_squared

TURNS = 24
"""Values of a joint that S does not depend on, from which extremes of R are searched."""


@dataclass(frozen=True, eq=False, repr=False)
class ExactSet(SingularSet):
    """The whole singular set of an arm with as many revolute joints as task rows.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        polynomial: The singularity polynomial.
    """

    polynomial: TrigPolynomial

    @property
    def complete(self) -> bool:
        """True."""
        return True

    @property
    def S(self) -> TrigPolynomial:
        """The singularity polynomial."""
        return self.polynomial

    @cached_property
    def relevant(self) -> tuple[int, ...]:
        """Numbers of the joints that S depends on."""
        return tuple(j for j, degree in enumerate(self.S.degrees) if degree > 0)

    @property
    def dimension(self) -> int:
        """Dimension of the set in the space of the relevant joints."""
        return len(self.relevant) - 1

    @cached_property
    def eliminated(self) -> int:
        """The joint of least nonzero degree: the roots along it give the set."""
        return min(reversed(self.relevant), key=lambda j: self.S.degrees[j])

    def __repr__(self) -> str:
        return f"ExactSet({self.arm.name}, degrees {self.S.degrees})"

    def roots(self, q: npt.ArrayLike, joint: int | str | None = None) -> Roots:
        """Find every singular value of one joint; see `SingularSet.roots`."""
        return self.S.roots(joint_vector(self.arm, q, "q"), self._joint(joint))

    def sample(self, m: int, rng: np.random.Generator | None = None) -> Array:
        """Sample m singular configurations that cover the set, angles in (-pi, pi]."""
        m, rng = whole(m, "m", 0), rng or np.random.default_rng()
        found, count = [], 0
        while count < m:
            Q = rng.uniform(-np.pi, np.pi, (max(1024, m - count), self.arm.n))
            roots = self.S.roots_along(Q, self.eliminated)
            row, column = np.nonzero(~np.isnan(roots))
            batch = Q[row]
            batch[:, self.eliminated] = roots[row, column]
            found.append(rng.permutation(batch))
            count += len(batch)
        return np.concatenate([np.empty((0, self.arm.n)), *found])[:m]

    def is_free(self, q0: npt.ArrayLike, q1: npt.ArrayLike) -> Certificate:
        """Prove that a straight segment meets no singularity; see `SingularSet.is_free`."""
        ends = [joint_vector(self.arm, q, name) for q, name in ((q0, "q0"), (q1, "q1"))]
        return certify(self.S, np.array(ends))

    def clearance(self, path: npt.ArrayLike) -> Certificate:
        """Prove that a path of straight segments (m, n) meets no singularity."""
        rows = [joint_vector(self.arm, q, "path") for q in np.atleast_2d(np.asarray(path))]
        if not rows:
            raise ConfigurationError("path has no rows; give at least one configuration")
        return certify(self.S, np.array(rows))

    def nearest(self, q: npt.ArrayLike) -> tuple[Array, float]:
        """Find the singular configuration nearest to q; see `SingularSet.nearest`.

        The search for arms with more than three relevant joints starts from roots along all joints
        of many configurations about q, each polished to a stationary point of the distance.
        """
        return nearest_root(self.S, joint_vector(self.arm, q, "q"), self.relevant)

    def curves(self) -> list[Array]:
        """Trace the set of an arm with two relevant joints; see `SingularSet.curves`."""
        self._needs_dimension(1)
        return [self._embed(piece) for piece in level_set.lines(self._reduced)]

    def surface(self) -> level_set.Mesh:
        """Triangulate the set of an arm with three relevant joints."""
        self._needs_dimension(2)
        return level_set.surface(self._reduced)

    def components(self) -> list[Component]:
        """Find the connected components; see `SingularSet.components`."""
        if self.dimension == 0:
            angles = self.roots(np.zeros(self.S.n)).angles
            pieces = [self._embed(np.array([[angle]])) for angle in angles]
        elif self.dimension == 1:
            pieces = self.curves()
        else:
            from scipy.sparse import csr_array  # slow to import
            from scipy.sparse.csgraph import connected_components

            mesh = self.surface()
            edges = (mesh.triangles[:, [0, 1, 2]].ravel(), mesh.triangles[:, [1, 2, 0]].ravel())
            m = len(mesh.vertices)
            graph = csr_array((np.ones(len(edges[0])), edges), shape=(m, m))
            number, labels = connected_components(graph, directed=False)
            pieces = [self._embed(mesh.vertices[labels == i]) for i in range(number)]
        return [self._component(piece) for piece in pieces]

    @cached_property
    def _reduced(self) -> TrigPolynomial:
        """S as a function of the relevant joints."""
        return self.S.fix({j: 0.0 for j in range(self.S.n) if j not in self.relevant})

    def _embed(self, points: Array) -> Array:
        """Return points of the relevant joints as configurations, the other joints at zero."""
        full = np.zeros((len(points), self.S.n))
        full[:, list(self.relevant)] = points
        return full

    def _component(self, points: Array) -> Component:
        """Find the range of R over a component and over the joints that S does not depend on."""
        R2 = radius_squared(self.arm, mode=self.mode)
        free = [j for j in range(self.S.n) if j not in self.relevant]
        starts = points
        for j in free:
            starts = starts.repeat(TURNS, axis=0)
            starts[:, j] = np.tile(2.0 * np.pi * np.arange(TURNS) / TURNS, len(starts) // TURNS)
        values = R2(starts)
        low, high = (
            extreme(R2, self.S, starts[pick(values)], better)
            for pick, better in ((np.argmin, operator.lt), (np.argmax, operator.gt))
        )
        at = np.array([low, high])
        return Component(points, distances(self.arm, at, self.mode), at)

    def _needs_dimension(self, dimension: int) -> None:
        """Refuse a set of another dimension."""
        if self.dimension != dimension:
            raise UnsupportedError(
                f"{self.arm.name}: the singular set has dimension {self.dimension} in the joints "
                f"that matter, not {dimension}; lock joints, or use .sample and .roots"
            )

    def _joint(self, joint: int | str | None) -> int:
        """Return the number of a joint given by number or name; the eliminated one if None."""
        if joint is None:
            return self.eliminated
        if isinstance(joint, str):
            return self.arm.joint_names.index(joint_name(self.arm, joint))
        if not isinstance(joint, Integral) or not 0 <= joint < self.arm.n:
            raise ConfigurationError(f"joint is {joint!r}; give 0 to {self.arm.n - 1} or a name")
        return int(joint)
