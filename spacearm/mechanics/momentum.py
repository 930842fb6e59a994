"""The centroidal momentum matrix, the spacecraft's motion that follows from it, the mass matrix.

Zero momentum, A_b v_b + A_q dq = 0, gives the spacecraft's twist v_b = -X dq, X = A_b^-1 A_q. Only
the free components of v_b count, the first f of six.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, finite, named
from spacearm.errors import ModelError
from spacearm.model.arguments import of_configuration
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.joints import joint_vector


class MomentumMatrix(NamedTuple):
    """The centroidal momentum matrix [A_b A_q]: h = A_b v_b + A_q dq.

    h is the momentum [linear; angular about the system CM] in inertial axes. Spinning wheels add
    their own, `Configuration.stored`.

    Attributes:
        A_b: (6, 6) acts on the spacecraft's twist in inertial axes [kg, kg m, kg m^2].
        A_q: (6, n) acts on the joint rates.
    """

    A_b: Array
    A_q: Array

    def to_dict(self) -> dict[str, Any]:
        """Return both blocks as nested lists."""
        return named(self)


@of_configuration
def momentum_matrix(cfg: Configuration) -> MomentumMatrix:
    """Compute the centroidal momentum matrix, split into its base and joint blocks.

    The spacecraft's twist v_b is that of the spacecraft frame's origin, in inertial axes.
    A_b = [[M 1, -M [c]x], [0, I_c]] with c from the spacecraft origin to the system CM and I_c
    the locked inertia about the system CM, so that det(A_b) = M^3 det(D) with D of (33c).

    Source: theory of the centroidal momentum matrix in Orin, Goswami & Lee, Auton. Robots 35,
    161-176 (2013), DOI 10.1007/s10514-013-9341-4.

    Args:
        cfg: The configuration.

    Returns:
        Both blocks; `A_b, A_q = momentum_matrix(cfg)`.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> A_b, A_q = sa.momentum_matrix(cfg)
        >>> A_b.shape, A_q.shape, A_b[0, 0].round(9)  # the total mass [kg]
        ((6, 6), (6, 2), np.float64(47.0))
    """
    R = cfg.base.rotation
    A = cfg.A
    base = np.hstack((A[:, :3] @ R.T, A[:, 3:6] @ R.T))
    base.flags.writeable = False
    return MomentumMatrix(base, A[:, 6:])


@of_configuration
def base_velocity(cfg: Configuration, dq: npt.ArrayLike) -> Array:
    """Compute the spacecraft's twist from the momentum: v_b = A_b^-1 (h - h_w - A_q dq).

    h is the total momentum (`Configuration.momentum`), h_w the part that the wheels hold
    (`Configuration.stored`). At zero momentum the angular part is equation (33c) of Papadopoulos &
    Dubowsky (1993), w_0 = -D^-1 D_q dq.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].

    Returns:
        (6,) twist [linear [m/s]; angular [rad/s]] of the spacecraft frame's origin, inertial axes.

    Raises:
        ConfigurationError: dq has the wrong shape or is not finite.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.base_velocity(cfg, [0.1, 0.2])[5].round(4)  # the spacecraft turns back [rad/s]
        np.float64(-0.0597)
    """
    A_b, A_q = momentum_matrix(cfg)
    h = cfg.momentum - cfg.stored
    return np.linalg.solve(A_b, h - A_q @ joint_vector(cfg.arm, dq, "dq"))


def momentum_vector(momentum: npt.ArrayLike | None) -> Array:
    """Check a momentum and return it, (6,); zeros if None."""
    meaning = "[linear [kg m/s]; angular about the system CM [kg m^2/s]]"
    return np.zeros(6) if momentum is None else finite(momentum, (6,), "momentum", meaning)


def base_response(A: Array, f: int = 6) -> Array:
    """Compute X = A_b^-1 A_q: the spacecraft moves with v_b = -X dq at zero momentum.

    Args:
        A: (6, 6 + n) the momentum matrix [A_b A_q].
        f: Number of free components of v_b.

    Returns:
        (f, n) X.
    """
    return np.linalg.solve(A[:f, :f], A[:f, 6:])


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
