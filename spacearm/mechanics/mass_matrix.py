"""The mass matrix, and systems of equations with positive definite matrices of inertias."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ModelError
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration


def mass_matrix(cfg: Configuration) -> Array:
    """Compute the mass matrix M (6 + n, 6 + n), the spacecraft's twist in its own axes."""
    arm = cfg.arm
    data = arm.borrow()
    upper = np.triu(pin.crba(arm.model, data, cfg.full_at_origin))
    arm.give_back(data)
    M = upper + upper.T
    np.fill_diagonal(M, upper.diagonal())
    return M if arm.coupling is None else arm.project(arm.project(M).T)


def require_positive_definite(arm: SpaceArm, M: Array, name: str) -> None:
    """Refuse a matrix of inertias that is not positive definite; M may be (0, 0).

    Raises:
        ModelError: It is not; says so of `name`, with its least eigenvalue.
    """
    solve(arm, M, np.zeros(len(M)), name)


def solve(arm: SpaceArm, M: Array, b: Array, name: str) -> Array:
    """Compute M^-1 b of a symmetric positive definite M by Cholesky factors.

    Raises:
        ModelError: M, which is called `name`, is not positive definite.
    """
    from scipy.linalg.lapack import dposv  # imports half of scipy

    if not len(M):
        return b
    _, x, info = dposv(M, b)
    if info:
        raise not_positive_definite(arm, M, name)
    return x


def not_positive_definite(arm: SpaceArm, M: Array, name: str) -> ModelError:
    """Return the error for a matrix of inertias that no rigid bodies can have."""
    least = np.linalg.eigvalsh(0.5 * (M + M.T))[0]
    return ModelError(
        f"{arm.name}: {name} is not positive definite (least eigenvalue {least:.3g}): no rigid "
        "bodies have such masses and inertias; correct those that loading with check='error' "
        "names, or replace them"
    )
