"""The singular set: every singular configuration of an arm, from one polynomial.

S(q) vanishes exactly where the task Jacobian is singular (see `singularity_polynomial`): its roots
are the whole set, nothing is missed and nothing is iterated but the last digits.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spacearm.arrays import Array, whole
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_name, joint_vector
from spacearm.model.mode import BaseMode
from spacearm.polynomial import level_set
from spacearm.polynomial.certificate import Certificate, certify
from spacearm.polynomial.nearest import nearest_root
from spacearm.polynomial.trig import Roots, TrigPolynomial
from spacearm.singularities.polynomial import distances, radius_squared, singularity_polynomial
from spacearm.singularities.searched_set import FoundSet

TURNS = 24
"""Values of a joint that S does not depend on from which extremes of R are sought."""


class Component(NamedTuple):
    """A connected component of the singular set.

    Attributes:
        points: (m, n) points on it.
        radius: (2,) least and largest distance of the tip from the system CM on it [m].
        at: (2, n) configurations at which they are attained.
    """

    points: Array
    radius: Array
    at: Array

    def __repr__(self) -> str:
        low, high = self.radius
        return f"Component({len(self.points)} points, R from {low:.7g} to {high:.7g} m)"


def singular_set(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> SingularSet | FoundSet:
    """The singular configurations of an arm.

    Args:
        arm: The arm.
        mode: What the spacecraft does; see `generalized_jacobian`. Attitude-controlled and fixed
            ones leave the kinematic singularities only.

    Returns:
        The whole set, exactly, for an arm with as many turning joints as task rows. For redundant
        arms and arms with sliding or mimic joints a `FoundSet`, with `sample` and `nearest` only,
        which holds what a search finds.

    Raises:
        UnsupportedError: The arm can never do its task.
    """
    turns = not arm.slides.any() and arm.coupling is None
    if arm.n >= arm.task.k and not (arm.n == arm.task.k and turns):
        return FoundSet(arm, mode)
    return SingularSet(arm, singularity_polynomial(arm, mode=mode), mode)


@dataclass(frozen=True, eq=False, repr=False)
class SingularSet:
    """The configurations at which the task Jacobian of an arm is singular.

    Attributes:
        arm: The arm.
        S: The singularity polynomial.
        mode: What the spacecraft does.
        complete: True: every singular configuration is in the set.
    """

    arm: SpaceArm
    S: TrigPolynomial
    mode: BaseMode = "free-floating"
    complete: bool = True

    @cached_property
    def relevant(self) -> tuple[int, ...]:
        """The joints that S depends on."""
        return tuple(j for j, degree in enumerate(self.S.degrees) if degree > 0)

    @property
    def dimension(self) -> int:
        """Dimension of the set in the space of the relevant joints."""
        return len(self.relevant) - 1

    @cached_property
    def eliminated(self) -> int:
        """The joint of least nonzero degree, for which the others are solved."""
        return min(reversed(self.relevant), key=lambda j: self.S.degrees[j])

    def __repr__(self) -> str:
        return f"SingularSet({self.arm.name}, degrees {self.S.degrees})"

    def roots(self, q: npt.ArrayLike, joint: int | str | None = None) -> Roots:
        """Every singular value of one joint with the others as in q.

        Args:
            q: (n,) joint angles; that of the joint itself does not matter.
            joint: Number from 0 on, or name, or q1, q2, ...; the one of least degree if None.
        """
        return self.S.roots(joint_vector(self.arm, q, "q"), self._joint(joint))

    def sample(self, m: int, rng: np.random.Generator | None = None) -> Array:
        """m singular configurations that cover the set.

        The measure: all joints but the eliminated one are uniform on the torus, given that a root
        exists; each root is taken with the same probability.

        Returns:
            (m, n) configurations, angles in (-pi, pi].

        Raises:
            ConfigurationError: m is no whole number from 0 on.
        """
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
        """Whether the straight segment from q0 to q1 in joint space meets no singularity.

        Returns:
            A certificate, true if it is free; else it names the first singular configuration.
        """
        ends = [joint_vector(self.arm, q, name) for q, name in ((q0, "q0"), (q1, "q1"))]
        return certify(self.S, np.array(ends))

    def clearance(self, path: npt.ArrayLike) -> Certificate:
        """The same for a path of straight segments.

        Args:
            path: (m, n) joint positions, at least one.
        """
        rows = [joint_vector(self.arm, q, "path") for q in np.atleast_2d(np.asarray(path))]
        if not rows:
            raise ConfigurationError("path has no rows; give at least one configuration")
        return certify(self.S, np.array(rows))

    def nearest(self, q: npt.ArrayLike) -> tuple[Array, float]:
        """The singular configuration nearest to q in joint space.

        For up to three relevant joints the global one, proven by branch and bound to 1e-4 rad;
        for more the best of a search from roots along all joints of many configurations about q,
        each polished to a stationary point of the distance.

        Returns:
            (n,) configuration and its distance [rad].
        """
        return nearest_root(self.S, joint_vector(self.arm, q, "q"), self.relevant)

    def curves(self) -> list[Array]:
        """The whole set of an arm with two relevant joints, such as planar2 (figure 4).

        Returns:
            Closed polylines (m, n), every point on the set to rounding, angles continuous along
            each; joints that do not matter stand at zero.

        Raises:
            UnsupportedError: The set is no set of curves.
        """
        self._needs_dimension(1)
        return [self._embed(piece) for piece in level_set.lines(self._reduced)]

    def surface(self) -> level_set.Mesh:
        """The whole set of an arm with three relevant joints, as a triangle mesh on the 3-torus.

        Raises:
            UnsupportedError: The set is no surface.
        """
        self._needs_dimension(2)
        return level_set.surface(self._reduced)

    def components(self) -> list[Component]:
        """The connected components, each with the range of R, the tip's distance from the CM.

        Raises:
            UnsupportedError: The set has more than two dimensions.
        """
        if self.dimension == 0:
            angles = self.roots(np.zeros(self.S.n)).angles
            pieces = [self._embed(np.array([[angle]])) for angle in angles]
        elif self.dimension == 1:
            pieces = self.curves()
        else:
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
        full = np.zeros((len(points), self.S.n))
        full[:, list(self.relevant)] = points
        return full

    def _component(self, points: Array) -> Component:
        """The range of R over a component, over the joints that do not matter to S too."""
        R2 = radius_squared(self.arm, self.mode)
        free = [j for j in range(self.S.n) if j not in self.relevant]
        starts = points
        for j in free:
            starts = starts.repeat(TURNS, axis=0)
            starts[:, j] = np.tile(2.0 * np.pi * np.arange(TURNS) / TURNS, len(starts) // TURNS)
        values = R2(starts)
        low, high = (
            level_set.extreme(R2, self.S, starts[pick(values)], better)
            for pick, better in ((np.argmin, operator.lt), (np.argmax, operator.gt))
        )
        at = np.array([low, high])
        return Component(points, distances(self.arm, at, self.mode), at)

    def _needs_dimension(self, dimension: int) -> None:
        if self.dimension != dimension:
            raise UnsupportedError(
                f"{self.arm.name}: the singular set has dimension {self.dimension} in the joints "
                f"that matter, not {dimension}; lock joints, or use .sample and .roots"
            )

    def _joint(self, joint: int | str | None) -> int:
        if joint is None:
            return self.eliminated
        if isinstance(joint, str):
            return self.arm.joint_names.index(joint_name(self.arm, joint))
        if not isinstance(joint, Integral) or not 0 <= joint < self.arm.n:
            raise ConfigurationError(f"joint is {joint!r}; give 0 to {self.arm.n - 1} or a name")
        return int(joint)
