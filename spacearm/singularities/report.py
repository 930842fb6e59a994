"""Singularity report of a configuration: singular values, lost directions, the way out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.linalg import norm

from spacearm.arrays import Array, Progress, within
from spacearm.errors import listed
from spacearm.mechanics.distance import rank_distances_of, refined_at
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.model.arguments import BaseMode, impossible
from spacearm.model.arm import Configuration
from spacearm.model.joints import joint_scales
from spacearm.results import (
    Cell,
    Column,
    Description,
    Measure,
    Result,
    Table,
    Tone,
    joint_measures,
    without_noise,
)
from spacearm.signatures import checked
from spacearm.singularities.immaterial_masses import payload_note
from spacearm.singularities.nearest import NearestSingular, angle, nearness
from spacearm.singularities.rounding import error_bars
from spacearm.singularities.sets import search_on_way

#: "closure" is for held targets alone, see `HeldReport`.
Kind = Literal["regular", "closure", "kinematic", "dynamic"]

#: Share of the largest singular value below which J* cannot be inverted to continue a motion.
NO_INVERSE = 1e-9
#: Default distance to the singular set up to which a configuration is singular [rad].
#:
#: It recognises a singular configuration given in hundredths of a degree, as in figure 3 of the
#: paper.
TOLERANCE = 1e-4
#: What the distance is, in one sentence, for the command line, the page and plots.
IN_WORDS = (
    "Distance to the singular set: how far the joints must turn at least, taken together (root of "
    "the sum of squares), until the tip can no longer move in some direction."
)
#: Distances beyond this are called far: to first order they tell no more [rad].
FAR = np.pi / 2.0
#: Joints with less than this share of the way out are not named in it.
LED = 0.2
TONES: Mapping[Kind, Tone] = {
    "regular": "good", "closure": "bad", "kinematic": "caution", "dynamic": "bad",
}  # fmt: skip


class SingularityReport(Result):
    """Singular values of the task Jacobian and the directions that a configuration loses.

    Directions are given in the task's rows: along the task axes, linear rows divided by `length`
    where the task mixes linear and angular rows. The Jacobian of a revolute arm is in m/rad for
    linear tasks, dimensionless for angular and mixed ones.

    Attributes:
        configuration: The configuration.
        mode: What the spacecraft does.
        impossible: Why the arm can do the task at no posture, and which task it can do; all
            postures are then singular. "" if the task is possible.
        sigma: (k,) singular values of the task Jacobian, largest first; zeros at the end where
            the arm has fewer joints than the task has rows.
        sigma_min: Least singular value.
        error: Bound on the rounding errors of the singular values, from `error_bars`. A singular
            value that is not above it may be zero, and counts as zero.
        distance: How far in joint space the nearest singular configuration is [rad]. If `nearest`
            is there, it is the distance of that one, so the nearest of all is no farther; else an
            estimate to first order, see `singularity`. Zero where sigma_min is not above `error`;
            inf where no small motion of the joints makes it vanish to first order. An estimate that
            a proof refutes is replaced by `distance_proven`.
        distance_proven: No singular configuration is nearer than this [rad]: proven, rounding
            included. Zero where nothing is proven, as without `exact`.
        distances: (k,) distances to first order for several singular values: entry j is how far
            away sigma[j] and all after it vanish. Zeros where the arm has fewer joints than the
            task has rows.
        away: (n,) joint motion [rad] or [m] per radian of distance that leads away from the
            nearest singular configuration; zeros where `distance` is inf.
        nearest: (n,) the nearest singular configuration, if `exact` asked for it and the search
            found one; else None.
        searched: Whether the nearest one was searched for. If so and `nearest` is None, one may
            have been missed; none is within `distance_proven`.
        rank: Number of singular values whose distance is above `tolerance`.
        manipulability: Yoshikawa's sqrt(det(J J^T)), the product of the singular values.
        condition: Largest over least singular value; infinite if the least is zero.
        determinant: det(J), equation (37), for square tasks; else None.
        kind: "regular" at full rank; "kinematic" if the fixed-base task Jacobian loses rank at
            the same configuration too; else "dynamic".
        available: (k, rank) orthonormal directions in which the tip can move.
        lost: (k, k - rank) orthonormal directions in which it cannot.
        null_space: (n, n - rank) orthonormal joint motions that leave the tip at rest.
        gradient: (n,) derivative of sigma_min with respect to q. At sigma_min = 0, and where
            the least singular value is repeated, the one-sided derivative of one branch.
        radian: (n,) what counts as a radian of each joint in distances. For a revolute joint 1 rad;
            for a sliding one its travel between the limits over 2 pi [m], but no more than the
            arm's length. Without limits it is the arm's length.
        jacobian: (k, n) the task Jacobian J.
        axes: (3, 3) columns: the task axes in inertial axes; see `Task.axes`.
        length: The length [m] that divides the linear rows of a mixed task; else None.
        tolerance: The tolerance that decided rank and kind [rad].
    """

    configuration: Configuration
    mode: BaseMode
    impossible: str
    sigma: Array
    sigma_min: float
    error: float
    distance: float
    distance_proven: float
    distances: Array
    away: Array
    nearest: Array | None
    searched: bool
    rank: int
    manipulability: float
    condition: float
    determinant: float | None
    kind: Kind
    available: Array
    lost: Array
    null_space: Array
    gradient: Array
    radian: Array
    jacobian: Array
    axes: Array
    length: float | None
    tolerance: float

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data, with verdict, way out, radius of the tip and task."""
        cfg = self.configuration
        tips = [float(np.linalg.norm(tip.translation - cfg.com)) for tip in cfg.tips]
        return {
            **super().to_dict(),
            "verdict": self.verdict,
            "way_out": self.way_out,
            "radius": tips[0] if len(tips) == 1 else tips,
            "task": {"rows": list(cfg.arm.task.rows), "unit": cfg.arm.sigma_unit},
        }

    @property
    def verdict(self) -> str:
        """The answer in one sentence."""
        if self.impossible:
            return self.impossible
        kind = self.kind if self.rank == len(self.sigma) else f"{self.kind} singularity"
        if self.nearest is not None:
            return f"{kind}: {nearness(self.distance, self.distance_proven)}"
        estimate = to_first_order(self.distance)
        if not self.searched:
            return f"{kind}: {estimate}"
        said = f"{kind}: the search found no singular posture"
        if not self.distance_proven:
            return f"{said}; one may be missed; {estimate}"
        said += f"; none within {angle(self.distance_proven, down=True)}, proven"
        return said if self.distance <= self.distance_proven else f"{said}; {estimate}"

    @property
    def way_out(self) -> str:
        """The joints that lead away from the nearest singular configuration, the best first.

        With their motion per degree of distance; joints with less than a fifth of it are left out.
        """
        arm, shares, steps = self.configuration.arm, self.away / self.radian, self.away
        joints = [int(j) for j in np.argsort(-np.abs(shares)) if abs(shares[j]) >= LED]
        return ", ".join(
            f"{arm.joint_names[j]} {steps[j]:+.2g}°"
            if not arm.slides[j]
            else f"{arm.joint_names[j]} {1e3 * np.radians(steps[j]):+.2g} mm"
            for j in joints
        )

    def __repr__(self) -> str:
        k, n = self.jacobian.shape
        how = "to first order" if self.nearest is None else "found"
        return (
            f"SingularityReport({self.kind}, rank {self.rank} of {k}, {n} joint{'s' * (n > 1)}, "
            f"distance={self.distance:.4g} rad {how}, sigma_min={self.sigma_min:.6g}, "
            f"condition={self.condition:.6g})"
        )

    not_checked = "joint limits of the singular posture, collisions"

    def describe(self) -> Description:
        """Describe posture, tip, directions and the joint motions that leave the tip at rest."""
        arm, k = self.configuration.arm, len(self.sigma)
        outside = self.configuration.outside_limits
        more = f", {k - self.rank} of {k} directions lost" if self.rank < k else ""
        more += f"; outside its limits: {listed(outside)}" if outside else ""
        notes = [] if self.impossible else [IN_WORDS, payload_note(arm, self.mode)]
        if self.way_out:
            notes.insert(0, f"To get away, per degree: {self.way_out}")
        tables = [self._posture(), Table.facts(self._facts(), "Tip"), self._directions()]
        if self.null_space.size:
            motions = without_noise(self.null_space.T).tolist()
            tables.append(
                Table(arm.joint_names, motions, "Joint motions that leave the tip at rest")
            )
        return Description(
            title=f"{arm.name}, {self.mode}",
            verdict=self.verdict + more,
            tone=TONES[self.kind],
            notes=notes,
            tables=tables,
        )

    def _posture(self) -> Table:
        cfg, slides = self.configuration, self.configuration.arm.slides
        joint = "m" if slides.all() else "rad or m" if slides.any() else "rad"
        columns: dict[Column | str, Sequence[Cell]] = {
            "joint": cfg.arm.joint_names, "q": joint_measures(cfg.q, slides)
        }  # fmt: skip
        if self.nearest is not None and not self.impossible:
            columns["nearest singular"] = joint_measures(self.nearest, slides)
        slope = Column("dsigma_min/dq", f"{cfg.arm.sigma_unit} per {joint}", ".4g")
        columns[slope] = list(without_noise(self.gradient))
        if outside := cfg.outside_limits:
            columns[""] = ["outside its limits" * (n in outside) for n in cfg.arm.joint_names]
        return Table.by_columns(columns, "Posture")

    def _facts(self) -> dict[str, Cell]:
        """Return the facts of the tip, or of the tips, by their names."""
        cfg, unit, k = self.configuration, self.configuration.arm.sigma_unit, len(self.sigma)
        volume = unit if k == 1 else f"({unit})^{k}"
        facts: dict[str, Cell] = {}
        for name, tip in zip(cfg.arm.tips, cfg.tips, strict=True):
            which, from_cm = f"{name}: " * (len(cfg.tips) > 1), tip.translation - cfg.com
            facts[f"{which}position, spacecraft at the origin"] = Measure(tip.translation, "m")
            facts[f"{which}position from the system CM"] = Measure(from_cm, "m")
            facts[f"{which}distance R from the system CM"] = Measure(
                float(norm(from_cm)), "m", ".6g"
            )
        if self.sigma_min <= self.error:
            facts["sigma_min may be zero: rounding errors up to"] = Measure(self.error, unit)
        facts["sigma_min"] = Measure(self.sigma_min, unit, ".6g")
        facts["condition (ratio)"] = Measure(self.condition, "", ".6g")
        facts["manipulability"] = Measure(self.manipulability, volume, ".6g")
        if self.determinant is not None:
            facts["determinant"] = Measure(self.determinant, volume, ".6g")
        if self.length is not None:
            facts["linear rows divided by"] = Measure(self.length, "m", ".6g")
        return facts

    def _directions(self) -> Table:
        """Return the directions of the tip, or the tips, with their singular values."""
        arm = self.configuration.arm
        unit, tips = arm.sigma_unit, arm.tips if len(arm.tips) > 1 else ()
        names = [f"{tip}: {row}" for tip in tips for row in arm.task.rows] or arm.task.rows
        axes = "inertial" if np.allclose(self.axes, np.eye(3)) else "task"
        directions = np.hstack((self.available, self.lost)).T
        rows = [
            ("available" if i < self.rank else "lost", self.sigma[i], *without_noise(direction))
            for i, direction in enumerate(directions)
        ]
        columns: list[Column | str] = ["", Column("sigma", unit, ".4g")]
        columns += [Column(name, "", ".4g") for name in names]
        return Table(columns, rows, f"Directions, {axes} axes")


@checked
def singularity(
    cfg: Configuration,
    *,
    mode: BaseMode = "free-floating",
    tolerance: float = TOLERANCE,
    exact: bool = False,
    progress: Progress | None = None,
) -> SingularityReport:
    """Report whether and how a configuration is singular for the arm's task.

    Dynamic singularities: section IV of Papadopoulos & Dubowsky (1993), DOI 10.1115/1.2897406.
    Nothing in the report depends on the spacecraft's position, and the singular values do not
    depend on its attitude either.

    The distance to the singular set in joint space decides. Unlike singular values and their ratios
    it does not depend on the size, the masses and the units of an arm. To first order it is
    sigma_min over the norm of its gradient, for redundant arms of that part of the gradient which
    keeps the null space (see `mechanics.distance`). Below 4 degrees a second step, from the point
    that the first one leads to, corrects it for the curvature of the set. This is an estimate: as a
    rule within 20 percent up to about a degree; far away it says only that the set is far. A
    sliding joint counts by `SingularityReport.radian`. In three cases one derivative does not give
    the distance:

    - sigma_min may be zero by its error bar: the distance is zero, whatever the gradient;
    - the gradient vanishes and sigma_min does not, as at a largest or least sigma_min: the distance
      is inf, the configuration regular;
    - sigma_min is zero without changing at first order, as where two singular surfaces touch: the
      distance is too short by a factor of up to two.

    `exact` looks for the nearest singular configuration itself, and proves that none is nearer.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does; see `generalized_jacobian`.
        tolerance: Distance up to which a configuration is singular [rad]. Singular values that
            vanish together within it count as zero together.
        exact: Whether to find the nearest singular configuration, and to prove that none is nearer
            than 99 % of its distance (90 % for redundant arms), as `SingularSet.nearest` does. Rank
            and kind are still decided to first order.
        progress: As in `SingularSet.nearest`, for `exact`.

    Returns:
        Singular values, distance, verdict, directions and the way out.

    Raises:
        ConfigurationError: `mode` or `tolerance` is not valid.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at(np.radians([-65, -11.41]))
        >>> report = sa.singularity(cfg)
        >>> report.kind, report.way_out
        ('dynamic', 'joint_2 +1°')
    """
    tolerance = within(tolerance, "tolerance", 0.0, np.pi, "an angle [rad]")
    task = cfg.arm.task
    J = task_jacobian(cfg, mode=mode)
    k, n = J.shape
    U, sigma, VT = np.linalg.svd(J)
    sigma, V = np.pad(sigma, (0, k - len(sigma))), VT.T  # of fewer joints than rows zeros too
    dJ, error = task_jacobian_derivative(cfg, mode=mode), error_bars(cfg, mode=mode).sigma
    found = rank_distances_of(cfg.arm, J, dJ, error)
    rank = int(np.count_nonzero(found.distances > tolerance))
    distance, away = refined_at(cfg, found, mode)
    distances = np.append(np.maximum(found.distances[:-1], distance), distance)
    report = SingularityReport(
        configuration=cfg,
        mode=mode,
        impossible=impossible(cfg.arm, mode),
        sigma=sigma,
        sigma_min=float(sigma[-1]),
        error=error,
        distance=distance,
        distance_proven=0.0,
        distances=distances,
        away=away,
        nearest=None,
        searched=False,
        rank=rank,
        manipulability=float(np.prod(sigma)),
        condition=float(sigma[0] / sigma[-1]) if sigma[-1] > 0.0 else float("inf"),
        determinant=float(np.linalg.det(J)) if k == n else None,
        kind="regular" if rank == k else _kind(cfg, tolerance),
        available=U[:, :rank],
        lost=U[:, rank:],
        null_space=V[:, rank:],
        gradient=U[:, -1] @ dJ @ V[:, k - 1] if k <= n else np.zeros(n),
        radian=joint_scales(cfg.arm),
        jacobian=J,
        axes=task.axes(cfg.base.rotation),
        length=task.length if task.mixed else None,
        tolerance=tolerance,
    )
    if not exact:
        return report
    return searched(report, *search_on_way(cfg.arm, mode, cfg.q[None, None], progress))


def to_first_order(distance: float) -> str:
    """Say what a first-order estimate tells of the distance to the singular set [rad]."""
    if distance > FAR:
        return f"the first-order estimate is above {angle(FAR)}, too far to tell the distance"
    return f"a singular posture about {angle(distance)} away, to first order"


def searched(
    report: SingularityReport, near: NearestSingular | None, proven: float = 0.0
) -> SingularityReport:
    """Return a report to first order with what a search found.

    Args:
        report: The report to first order.
        near: The nearest singular configuration that was found; None if none was.
        proven: How far none is, if none was found [rad].
    """
    if near is None:
        distance = max(report.distance, proven)
        return replace(report, searched=True, distance=distance, distance_proven=proven)
    apart = near.distance > report.tolerance
    return replace(
        report,
        searched=True,
        nearest=near.q,
        distance=near.distance,
        distance_proven=near.distance_proven,
        away=(near.start - near.q) / near.distance if apart else report.away,
    )


def _kind(cfg: Configuration, tolerance: float) -> Kind:
    """Tell whether a singular configuration is kinematic or dynamic."""
    J, dJ = task_jacobian(cfg, mode="fixed"), task_jacobian_derivative(cfg, mode="fixed")
    found = rank_distances_of(cfg.arm, J, dJ, error_bars(cfg, mode="fixed").sigma)
    return "dynamic" if (found.distances > tolerance).all() else "kinematic"
