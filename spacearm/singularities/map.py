"""Singular map: sigma_min over two joints, and the exact singular curves in that slice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, Result, whole
from spacearm.errors import ConfigurationError
from spacearm.mechanics.batch import evaluate
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_name, joint_vector
from spacearm.polynomial import level_set
from spacearm.singularities.exact_set import SingularSet, singular_set


@dataclass(frozen=True, eq=False, repr=False)
class SingularMap(Result):
    """A slice of joint space.

    Attributes:
        arm: Name of the arm.
        joints: Names of the two joints.
        held: Where the other joints stand, by name [rad] or [m].
        angles: (N,) values of both joints, -pi to pi [rad].
        sigma_min: (N, N) least singular value of the task Jacobian, first index the first joint.
        unit: Its unit.
        curves: Singular curves, closed polylines (m, 2), exact to rounding; None for arms without
            a singularity polynomial (redundant ones, sliding or mimic joints).
    """

    arm: str
    joints: tuple[str, str]
    held: dict[str, float]
    angles: Array
    sigma_min: Array
    unit: str
    curves: list[Array] | None

    def __repr__(self) -> str:
        return f"SingularMap({self.arm}, {self.joints[0]} x {self.joints[1]}, {len(self.angles)})"


def singular_map(
    arm: SpaceArm,
    joints: tuple[str, str] | None = None,
    q: npt.ArrayLike | None = None,
    points: int = 181,
) -> SingularMap:
    """Maps the singularities over two joints, the others held.

    Args:
        arm: The arm.
        joints: The two joints, which must turn, by name or as q1, q2, ...; the first two that the
            singular set depends on if None.
        q: (n,) where the other joints stand; zeros if None.
        points: Grid points in each joint for sigma_min.

    Raises:
        ConfigurationError: A joint does not exist, does not turn or is named twice, or points is
            no number of them.
    """
    found = singular_set(arm)
    exact = found if isinstance(found, SingularSet) else None
    centre = joint_vector(arm, np.zeros(arm.n) if q is None else q, "q")
    names = [joint_name(arm, name) for name in joints or _default_joints(arm, exact)]
    if len(names) != 2:
        raise ConfigurationError(f"joints is {joints!r}; name two")
    a, b = (_turning(arm, name) for name in names)
    if a == b:
        raise ConfigurationError(f"joint {names[0]!r} is named twice; name two joints")
    points = whole(points, "points", 2)
    angles = np.linspace(-np.pi, np.pi, points)
    Q = np.tile(centre, (points * points, 1))
    Q[:, a], Q[:, b] = angles.repeat(points), np.tile(angles, points)
    sigma = evaluate(arm, Q, ["sigma_min"])["sigma_min"].reshape(points, points)
    curves = None if exact is None else _curves(exact, centre, a, b)
    held = {n: float(x) for n, x in zip(arm.joint_names, centre, strict=True) if n not in names}
    return SingularMap(arm.name, (names[0], names[1]), held, angles, sigma, arm.sigma_unit, curves)


def _curves(exact: SingularSet, q: Array, a: int, b: int) -> list[Array]:
    slice_ = exact.S.fix({j: q[j] for j in range(exact.S.n) if j not in (a, b)})
    curves = level_set.lines(slice_)
    return curves if a < b else [curve[:, ::-1] for curve in curves]


def _default_joints(arm: SpaceArm, exact: SingularSet | None) -> tuple[str, str]:
    matter = exact.relevant if exact else range(arm.n)
    numbers = [*matter, *(j for j in range(arm.n) if j not in matter)][:2]
    if len(numbers) < 2:
        raise ConfigurationError(f"{arm.name} has one joint; a map needs two")
    return arm.joint_names[numbers[0]], arm.joint_names[numbers[1]]


def _turning(arm: SpaceArm, name: str) -> int:
    if arm.slides[arm.joint_names.index(name)]:
        raise ConfigurationError(f"joint {name!r} slides; a map is drawn over joints that turn")
    return arm.joint_names.index(name)
