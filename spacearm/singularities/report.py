"""Singularity report of a configuration: singular values, lost directions, the way out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from spacearm.arrays import Array, Result
from spacearm.errors import ConfigurationError
from spacearm.mechanics.jacobian import (
    singular_values_of,
    task_jacobian,
    task_jacobian_derivative,
)
from spacearm.model.configuration import Configuration
from spacearm.model.mode import BaseMode

Kind = Literal["regular", "kinematic", "dynamic"]

NO_INVERSE = 1e-9
"""Share of the largest singular value below which J* cannot be inverted to continue a motion."""
RANK_TOLERANCE = 1e-4
"""Default share of the largest singular value up to which a singular value counts as zero.

It recognises a singular configuration given in hundredths of a degree, as in figure 3 of the paper.
"""


@dataclass(frozen=True, eq=False, repr=False)
class SingularityReport(Result):
    """Singular values of the task Jacobian and the directions that a configuration loses.

    Directions are given in the task's rows: along the task axes, linear rows divided by `length`
    where the task mixes linear and angular rows. The Jacobian of a revolute arm is in m/rad for
    linear tasks, dimensionless for angular and mixed ones.

    Attributes:
        configuration: The configuration.
        mode: What the spacecraft does.
        sigma: (k,) singular values of the task Jacobian, largest first; zeros at the end where
            the arm has fewer joints than the task has rows.
        sigma_min: Least singular value; `error_bars` bounds its rounding errors.
        rank: Number of singular values above `tolerance` times the largest.
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
        jacobian: (k, n) the task Jacobian J.
        axes: (3, 3) columns: the task axes in inertial axes; see `Task.axes`.
        length: The length [m] that divides the linear rows of a mixed task; else None.
        tolerance: The relative tolerance that decided the rank.
    """

    configuration: Configuration
    mode: BaseMode
    sigma: Array
    sigma_min: float
    rank: int
    manipulability: float
    condition: float
    determinant: float | None
    kind: Kind
    available: Array
    lost: Array
    null_space: Array
    gradient: Array
    jacobian: Array
    axes: Array
    length: float | None
    tolerance: float

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data, with the tip's distance from the CM and the task."""
        cfg = self.configuration
        tips = [float(np.linalg.norm(tip.translation - cfg.com)) for tip in cfg.tips]
        return {
            **super().to_dict(),
            "radius": tips[0] if len(tips) == 1 else tips,
            "task": {"rows": list(cfg.arm.task.rows), "unit": cfg.arm.sigma_unit},
        }

    def __repr__(self) -> str:
        k, n = self.jacobian.shape
        return (
            f"SingularityReport({self.kind}, rank {self.rank} of {k}, {n} joints, "
            f"sigma_min={self.sigma_min:.6g}, condition={self.condition:.6g})"
        )


def singularity(
    cfg: Configuration, *, mode: BaseMode = "free-floating", tolerance: float = RANK_TOLERANCE
) -> SingularityReport:
    """Report whether and how a configuration is singular for the arm's task.

    Dynamic singularities: section IV of Papadopoulos & Dubowsky (1993), DOI 10.1115/1.2897406.
    Nothing in the report depends on the spacecraft's position, and the singular values do not
    depend on its attitude either.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does; see `generalized_jacobian`.
        tolerance: Singular values up to this share of the largest count as zero.

    Raises:
        ConfigurationError: `mode` or `tolerance` is not valid.
    """
    if not 0.0 <= tolerance < 1.0:
        raise ConfigurationError(f"tolerance is {tolerance}; give a share from 0 to below 1")
    task = cfg.arm.task
    J = task_jacobian(cfg, mode=mode)
    k, n = J.shape
    U, sigma, V = _svd(J)
    rank = _rank(sigma, tolerance)
    fixed_rank = _rank(singular_values(cfg, mode="fixed"), tolerance)
    dJ = task_jacobian_derivative(cfg, mode=mode)
    return SingularityReport(
        configuration=cfg,
        mode=mode,
        sigma=sigma,
        sigma_min=float(sigma[-1]),
        rank=rank,
        manipulability=float(np.prod(sigma)),
        condition=float(sigma[0] / sigma[-1]) if sigma[-1] > 0.0 else float("inf"),
        determinant=float(np.linalg.det(J)) if k == n else None,
        kind="regular" if rank == k else "kinematic" if fixed_rank < k else "dynamic",
        available=U[:, :rank],
        lost=U[:, rank:],
        null_space=V[:, rank:],
        gradient=U[:, -1] @ dJ @ V[:, k - 1] if k <= n else np.zeros(n),
        jacobian=J,
        axes=task.axes(cfg.base.rotation),
        length=task.length if task.mixed else None,
        tolerance=tolerance,
    )


def singular_values(
    cfg: Configuration, *, mode: BaseMode = "free-floating", axes: Array | None = None
) -> Array:
    """Compute the singular values (k,) of the task Jacobian, largest first.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does; see `generalized_jacobian`.
        axes: (3, 3) columns: the axes along which the task's rows count, in inertial axes; the
            task axes if None.
    """
    return singular_values_of(task_jacobian(cfg, mode=mode, axes=axes))


def _svd(J: Array) -> tuple[Array, Array, Array]:
    """Decompose J = U diag(sigma) V^T: U (k, k), V (n, n) and sigma (k,), padded by zeros."""
    U, sigma, VT = np.linalg.svd(J)
    return U, np.pad(sigma, (0, len(J) - len(sigma))), VT.T


def _rank(sigma: Array, tolerance: float) -> int:
    """Count the singular values above a share of the largest."""
    return int(np.count_nonzero(sigma > tolerance * sigma[0]))
