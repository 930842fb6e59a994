"""The spacecraft's motion eliminated from a Jacobian, for one configuration or for stacks.

Zero momentum, A_b v_b + A_q dq = 0, gives the spacecraft's twist v_b = -X dq, X = A_b^-1 A_q, and
the tip moves with J* dq, J* = J_q - J_b X. Only the free components of v_b count, the first f of
six.
"""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array


def base_response(A: Array, f: int = 6) -> Array:
    """Compute X = A_b^-1 A_q: the spacecraft moves with v_b = -X dq at zero momentum.

    Args:
        A: (..., 6, 6 + n) momentum matrices [A_b A_q].
        f: Number of free components of v_b.

    Returns:
        (..., f, n) X.
    """
    return np.linalg.solve(A[..., :f, :f], A[..., :f, 6:])


def base_response_derivative(A: Array, dA: Array, X: Array) -> Array:
    """Compute dX/dq_j from A_b X = A_q: dX = A_b^-1 (dA_q - dA_b X).

    Args:
        A: (..., 6, 6 + n) momentum matrices.
        dA: (..., n, 6, 6 + n) their derivatives with respect to each joint.
        X: (..., f, n) `base_response`.

    Returns:
        (..., n, f, n) its derivatives.
    """
    f, X = X.shape[-2], X[..., None, :, :]
    return np.linalg.solve(A[..., None, :f, :f], dA[..., :f, 6:] - dA[..., :f, :f] @ X)


def reduced_jacobian(J: Array, X: Array) -> Array:
    """Compute J* = J_q - J_b X, the spacecraft's motion eliminated.

    Args:
        J: (..., 6, 6 + n) Jacobians [J_b J_q].
        X: (..., f, n) `base_response`.

    Returns:
        (..., 6, n) J*.
    """
    return J[..., 6:] - J[..., : X.shape[-2]] @ X


def reduced_jacobian_derivative(J: Array, dJ: Array, X: Array, dX: Array) -> Array:
    """Compute dJ*/dq_j = dJ_q - dJ_b X - J_b dX.

    Args:
        J: (..., 6, 6 + n) Jacobians.
        dJ: (..., n, 6, 6 + n) their derivatives with respect to each joint.
        X: (..., f, n) `base_response`.
        dX: (..., n, f, n) its derivatives.

    Returns:
        (..., n, 6, n) derivatives of J*.
    """
    f = X.shape[-2]
    return dJ[..., 6:] - dJ[..., :f] @ X[..., None, :, :] - J[..., None, :, :f] @ dX
