"""The interface of singular sets: what can be asked of the singular configurations of an arm."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, named
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.polynomial.certificate import Certificate
from spacearm.polynomial.level_set import Mesh
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.univariate import Roots


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

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return named(self)

    def __repr__(self) -> str:
        low, high = self.radius
        return f"Component({len(self.points)} points, R from {low:.7g} to {high:.7g} m)"


@dataclass(frozen=True, eq=False, repr=False)
class SingularSet(ABC):
    """The configurations at which the task Jacobian of an arm is singular; see `singular_set`.

    `sample` and `nearest` work for every arm. The other methods raise `UnsupportedError` where the
    set of this arm does not have what they return; the message says why.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
    """

    arm: SpaceArm
    mode: BaseMode

    @property
    @abstractmethod
    def complete(self) -> bool:
        """Whether every singular configuration is in the set: nothing is missed."""

    @property
    @abstractmethod
    def S(self) -> TrigPolynomial:
        """The singularity polynomial, which vanishes on the set and nowhere else."""

    @property
    @abstractmethod
    def relevant(self) -> tuple[int, ...]:
        """Numbers of the joints that S depends on."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Dimension of the set in the space of the relevant joints."""

    @abstractmethod
    def roots(self, q: npt.ArrayLike, joint: int | str | None = None) -> Roots:
        """Find every singular value of one joint with the others as in q.

        Args:
            q: (n,) joint angles; that of the joint itself does not matter.
            joint: Number from 0 on, or name, or q1, q2, ...; the one of least degree if None.
        """

    @abstractmethod
    def sample(self, m: int, rng: np.random.Generator | None = None) -> Array:
        """Sample m singular configurations, (m, n).

        A complete set is covered: all joints but the one of least degree are uniform on the torus,
        given that a root exists, and each root has the same probability. For a searched set no
        measure is promised.

        Args:
            m: How many.
            rng: Random numbers; new ones if None.

        Raises:
            ConfigurationError: m is no whole number from 0 on.
            NoSolutionError: The search of a set that is not complete found too few; carries those
                found.
        """

    @abstractmethod
    def nearest(self, q: npt.ArrayLike) -> tuple[Array, float]:
        """Find the singular configuration nearest to q (n,) in joint space.

        A complete set with up to three relevant joints: the global one, proven by branch and bound
        to 1e-4 rad. Others: the best of a search from many starts about q.

        Returns:
            (n,) configuration and its distance [rad], or [rad, m] with sliding joints.

        Raises:
            NoSolutionError: None was found.
        """

    @abstractmethod
    def is_free(self, q0: npt.ArrayLike, q1: npt.ArrayLike) -> Certificate:
        """Prove that the straight segment from q0 to q1 in joint space meets no singularity.

        Returns:
            A certificate, true if it is free; else it names the first singular configuration.
        """

    @abstractmethod
    def clearance(self, path: npt.ArrayLike) -> Certificate:
        """Prove the same for a path of straight segments.

        Args:
            path: (m, n) joint positions, at least one.
        """

    @abstractmethod
    def curves(self) -> list[Array]:
        """Trace the whole set of an arm with two relevant joints, such as planar2 (figure 4).

        Returns:
            Closed polylines (m, n), every point on the set to rounding, angles continuous along
            each; joints that do not matter stand at zero.

        Raises:
            UnsupportedError: The set is no set of curves.
        """

    @abstractmethod
    def surface(self) -> Mesh:
        """Triangulate the whole set of an arm with three relevant joints, on the 3-torus.

        Raises:
            UnsupportedError: The set is no surface.
        """

    @abstractmethod
    def components(self) -> list[Component]:
        """Find the connected components, each with the range of R, the tip's distance from the CM.

        Raises:
            UnsupportedError: The set has more than two dimensions.
        """

    def to_dict(self) -> dict[str, Any]:
        """Describe the set as plain JSON data: arm, mode, complete and the degrees of S or None."""
        degrees = list(self.S.degrees) if self.complete else None
        return {
            "arm": self.arm.name,
            "mode": self.mode,
            "complete": self.complete,
            "degrees": degrees,
        }
