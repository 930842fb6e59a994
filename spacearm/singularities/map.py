"""Singularity maps: distances to the singular set over two joints, and the exact curves there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from spacearm.arrays import Array, ArrayLike, Progress, whole
from spacearm.errors import ConfigurationError, StoppedError
from spacearm.mechanics.batch import evaluate
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_name, joint_vector
from spacearm.processes import check_memory
from spacearm.results import Cell, Description, Measure, Result, Table
from spacearm.signatures import checked, shown
from spacearm.singularities.polynomials import chart_of
from spacearm.singularities.sets import singular_set

#: Postures, and points on a line through each, by which the joints of a map are chosen.
LINES, ON_LINE = 16, 32
#: Largest number of points along each joint of a map.
MOST_POINTS = 2001
#: Numbers that are kept for each posture of a map beside its joint positions.
MEASURED = 8


class SingularMap(Result):
    """Distance to the singular set and singular curves over two joints, the others held.

    Attributes:
        arm: Name of the arm.
        joints: Names of the two joints.
        held: Positions of the other joints by name [rad] or [m].
        angles: (N,) values of both joints, -pi to pi [rad].
        distance: (N, N) distance to the singular set in the space of all joints, to first order
            [rad], first index the first joint; see `singularity`.
        sigma_min: (N, N) least singular value of the task Jacobian, likewise.
        unit: Its unit.
        curves: Singular curves, closed polylines (m, 2), exact to rounding; None for arms without
            a singularity polynomial (redundant ones, sliding or mimic joints).
        joint_limits: (2, 2) lower and upper limit of both joints [rad]; inf where there is none.

    After Ctrl-C numbers that were not computed are NaN, and curves that were not traced None.
    """

    arm: str
    joints: tuple[str, str]
    held: dict[str, float]
    angles: Array
    distance: Array
    sigma_min: Array
    unit: str
    curves: list[Array] | None
    joint_limits: Array

    JSON: ClassVar[Mapping[str, str]] = {"unit": "sigma_unit"}

    not_checked = "postures between those of the grid, collisions"

    def describe(self) -> Description:
        """Describe the grid, the joints that are held and how near the set comes."""
        facts: dict[str, Cell] = {
            "grid points along each joint": len(self.angles),
            "singular curves": "none exact" if self.curves is None else len(self.curves),
            "least distance on the grid, to first order": Measure(
                float(np.nanmin(self.distance)), "rad"
            ),
            "largest distance on the grid, to first order": Measure(
                float(np.nanmax(self.distance)), "rad"
            ),
        }
        facts |= {f"{name} held at [rad] or [m]": at for name, at in self.held.items()}
        return Description(
            title=self.arm,
            verdict=f"{self.joints[0]} x {self.joints[1]}, {len(self.angles)} points each",
            tables=[Table.facts(facts)],
        )


@checked
def singular_map(
    arm: SpaceArm,
    joints: tuple[str, str] | None = None,
    q: ArrayLike | None = None,
    points: int = 181,
    *,
    progress: Progress | None = None,
) -> SingularMap:
    """Map the singularities over two joints, the others held.

    Args:
        arm: The arm.
        joints: Two revolute joints, by name or as q1, q2, ...; those along which sigma_min changes
            most if None.
        q: (n,) positions of the other joints; zeros if None.
        points: Grid points in each joint.
        progress: Called now and then as progress(done, total); curves count as much as postures.

    Returns:
        Distances and sigma_min on the grid, and the curves.

    Raises:
        ConfigurationError: A joint does not exist, is prismatic or is named twice, or `points` is
            no whole number from 2 on.
        StoppedError: Ctrl-C; carries the map as far as it had come.

    Example:
        >>> import spacearm as sa
        >>> found = sa.singular_map(sa.load("planar2"), points=31)
        >>> len(found.curves)  # figure 4 of the paper
        2
    """
    found = singular_set(arm)
    centre = joint_vector(arm, np.zeros(arm.n) if q is None else q, "q")
    if joints is not None and len(joints) != 2:
        raise ConfigurationError(f"joints is {shown(joints)}; name two")
    if joints is None:
        names = [arm.joint_names[j] for j in telling_joints(arm)]
    else:
        names = [joint_name(arm, name) for name in joints]
    a, b = (arm.joint_names.index(name) for name in names)
    if a == b:
        raise ConfigurationError(f"joint {names[0]!r} is named twice; name two joints")
    for j in (a, b):
        if arm.slides[j]:
            name = arm.joint_names[j]
            raise ConfigurationError(f"joint {name!r} is prismatic; a map is over revolute joints")
    points = whole(points, "points", 2, MOST_POINTS)
    need = 8.0 * points**2 * (arm.n + MEASURED)
    check_memory(need, f"a map of {points:,} x {points:,} postures", "use fewer points")
    angles = np.linspace(-np.pi, np.pi, points)
    Q = np.tile(centre, (points * points, 1))
    Q[:, a], Q[:, b] = angles.repeat(points), np.tile(angles, points)
    rows = {name: np.full(points * points, np.nan) for name in ("distance", "sigma_min")}
    held = {n: float(x) for n, x in zip(arm.joint_names, centre, strict=True) if n not in names}
    result = SingularMap(
        arm=arm.name,
        joints=(names[0], names[1]),
        held=held,
        angles=angles,
        **{name: row.reshape(points, points) for name, row in rows.items()},
        unit=arm.sigma_unit,
        curves=None,
        joint_limits=np.stack((arm.lower, arm.upper), axis=1)[[a, b]],
    )
    curved = found.complete and found.codimension == 1

    def tell(done: int, total: int) -> None:
        if progress:
            progress(done, (1 + curved) * total)

    try:
        evaluate(arm, Q, tuple(rows), out=rows, progress=tell)
        if curved:
            curves = [curve[:, [a, b]] for curve in found.curves((a, b), centre)]
            result = replace(result, curves=curves)
            tell(2 * len(Q), len(Q))
    except KeyboardInterrupt:
        done = int((~np.isnan(result.distance)).sum())
        raise StoppedError(f"{done:,} of {len(Q):,} postures done", result) from None
    return result


def telling_joints(arm: SpaceArm) -> list[int]:
    """Choose the two revolute joints along which sigma_min changes most, from random postures."""
    turning = np.flatnonzero(~arm.slides)
    if len(turning) < 2:
        raise ConfigurationError(f"{arm.name} has fewer than two revolute joints; a map needs two")
    Q = chart_of(arm).draw(np.random.default_rng(0), LINES)
    lines = np.tile(Q[:, None, None], (1, len(turning), ON_LINE, 1))
    for i, j in enumerate(turning):
        lines[:, i, :, j] += 2.0 * np.pi * np.arange(ON_LINE) / ON_LINE
    sigma = evaluate(arm, lines.reshape(-1, arm.n), ("sigma_min",))["sigma_min"]
    change = sigma.reshape(LINES, len(turning), ON_LINE).std(axis=2).mean(axis=0)
    return sorted(turning[np.argsort(-change, kind="stable")[:2]].tolist())
