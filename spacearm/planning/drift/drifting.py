"""Joint motions of a spacecraft with momentum: how its attitude changes.

The angular momentum h about the system CM is constant in inertial axes, and so, with (33c), the
spacecraft of attitude T turns with w_0 = D^-1 (T^T h - s - D_q dq) in its own axes, s what its
wheels hold.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array
from spacearm.model.arm import SpaceArm, kinematics


def drifting_attitudes(
    arm: SpaceArm, T: Array, t: Array, Q: Array, h: Array, stored: Array
) -> Array:
    """Return the attitudes (p, m, 3, 3) of the spacecraft along p joint motions at once.

    Args:
        arm: The arm.
        T: (3, 3) attitude at the start.
        t: (m,) times of the rows [s].
        Q: (p, m, n) joint positions of the rows, between which they are linear in time.
        h: (3,) angular momentum about the system CM [N m s], inertial axes.
        stored: (3,) what wheels hold of it all the time [N m s], spacecraft axes.
    """
    halves = np.empty((len(Q), 2 * len(t) - 1, arm.n))
    halves[:, ::2], halves[:, 1::2] = Q, 0.5 * (Q[:, :-1] + Q[:, 1:])
    D, D_q = _matrices(arm, halves)
    rates = np.diff(Q, axis=1) / np.diff(t)[:, None]
    taken = stored + np.einsum("pmkij,pmj->pmki", _stages(D_q), rates)
    return _turned(T, t, _stages(D), taken, h)


def steered_attitudes(
    arm: SpaceArm, T: Array, t: Array, Q: Array, dQ: Array, h: Array, stored: Array
) -> Array:
    """Return the attitudes (p, m, 3, 3) along p smooth motions of joints and wheels.

    Args:
        arm: The arm.
        T: (3, 3) attitude at the start.
        t: (m,) times of the rows [s].
        Q: (p, 2 m - 1, n) joint positions at the rows and at the times half way between.
        dQ: (p, 2 m - 1, n) their rates there.
        h: (3,) angular momentum about the system CM [N m s], inertial axes.
        stored: (p, 2 m - 1, 3) what the wheels hold of it there [N m s], spacecraft axes.
    """
    D, D_q = _matrices(arm, Q)
    taken = stored + np.einsum("pmij,pmj->pmi", D_q, dQ)
    return _turned(T, t, _stages(D), _stages(taken), h)


def _turned(T: Array, t: Array, D: Array, taken: Array, h: Array) -> Array:
    """Return the attitudes (p, m, 3, 3) of spacecraft with w_0 = D^-1 (T^T h - taken).

    Celledoni, Marthinsen & Owren's commutator-free method of order 4, Future Gener. Comput. Syst.
    19(3), 341-352 (2003), DOI 10.1016/S0167-739X(02)00161-9, with a step from row to row.

    Args:
        T: (3, 3) attitude at the start.
        t: (m,) times of the rows [s].
        D: (p, m - 1, 3, 3, 3) at the begin, in the middle and at the end of each step.
        taken: (p, m - 1, 3, 3) there, the momentum of joint motion and wheels [N m s].
        h: (3,) angular momentum about the system CM [N m s], inertial axes.
    """
    spins = np.linalg.inv(D) * np.diff(t)[:, None, None, None]
    out = np.empty((len(D), len(t), 3, 3))
    out[:, 0] = T
    for i in range(len(t) - 1):

        def turn(R: Array, k: int, i: int = i) -> Array:
            left = np.einsum("pkj,k->pj", R, h) - taken[:, i, k]
            return np.einsum("pij,pj->pi", spins[:, i, k], left)

        R = out[:, i]
        k1 = turn(R, 0)
        half = R @ _exp(0.5 * k1)
        k2 = turn(half, 1)
        k3 = turn(R @ _exp(0.5 * k2), 1)
        k4 = turn(half @ _exp(k3 - 0.5 * k1), 2)
        out[:, i + 1] = (
            R
            @ _exp((3.0 * k1 + 2.0 * (k2 + k3) - k4) / 12.0)
            @ _exp((3.0 * k4 + 2.0 * (k2 + k3) - k1) / 12.0)
        )
    return out


def _matrices(arm: SpaceArm, Q: Array) -> tuple[Array, Array]:
    """Return D (..., 3, 3) and D_q (..., 3, n) at joint positions (..., n)."""
    A = np.array([kinematics(arm, q, pin.SE3.Identity()).A[3:] for q in Q.reshape(-1, arm.n)])
    A = A.reshape(*Q.shape[:-1], 3, 6 + arm.n)
    return A[..., 3:6], A[..., 6:]


def _stages(x: Array) -> Array:
    """Return what is known at rows and between (p, 2 m - 1, ...) by steps (p, m - 1, 3, ...)."""
    return np.stack((x[:, :-1:2], x[:, 1::2], x[:, 2::2]), axis=2)


def _exp(w: Array) -> Array:
    """Return the rotations (p, 3, 3) of rotation vectors (p, 3)."""
    return Rotation.from_rotvec(w).as_matrix()
