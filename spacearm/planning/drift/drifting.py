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
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import kinematics


def drifting_attitudes(
    arm: SpaceArm, T: Array, t: Array, Q: Array, h: Array, stored: Array
) -> Array:
    """Return the attitudes (p, m, 3, 3) of the spacecraft along p joint motions at once.

    Celledoni, Marthinsen & Owren's commutator-free method of order 4, Future Gener. Comput. Syst.
    19(3), 341-352 (2003), DOI 10.1016/S0167-739X(02)00161-9, with a step from row to row.

    Args:
        arm: The arm.
        T: (3, 3) attitude at the start.
        t: (m,) times of the rows [s].
        Q: (p, m, n) joint positions of the rows, between which they are linear in time.
        h: (3,) angular momentum about the system CM [N m s], inertial axes.
        stored: (3,) what wheels hold of it all the time [N m s], spacecraft axes.
    """
    p, m, n = Q.shape
    halves = np.empty((p, 2 * m - 1, n))
    halves[:, ::2], halves[:, 1::2] = Q, 0.5 * (Q[:, :-1] + Q[:, 1:])
    A = np.array([kinematics(arm, q, pin.SE3.Identity()).A[3:] for q in halves.reshape(-1, n)])
    inverse = np.linalg.inv(A[:, :, 3:6])
    connection = -(inverse @ A[:, :, 6:]).reshape(p, -1, 3, n)
    inverse = inverse.reshape(p, -1, 3, 3)
    out = np.empty((p, m, 3, 3))
    out[:, 0] = T
    for i, dt in enumerate(np.diff(t)):
        step = Q[:, i + 1] - Q[:, i]
        turn = [np.einsum("pij,pj->pi", connection[:, 2 * i + k], step) for k in range(3)]
        spin = [dt * inverse[:, 2 * i + k] for k in range(3)]

        def rate(R: Array, k: int, turn: list[Array] = turn, spin: list[Array] = spin) -> Array:
            left = np.einsum("pkj,k->pj", R, h) - stored
            return turn[k] + np.einsum("pij,pj->pi", spin[k], left)

        R = out[:, i]
        k1 = rate(R, 0)
        half = R @ _exp(0.5 * k1)
        k2 = rate(half, 1)
        k3 = rate(R @ _exp(0.5 * k2), 1)
        k4 = rate(half @ _exp(k3 - 0.5 * k1), 2)
        out[:, i + 1] = (
            R
            @ _exp((3.0 * k1 + 2.0 * (k2 + k3) - k4) / 12.0)
            @ _exp((3.0 * k4 + 2.0 * (k2 + k3) - k1) / 12.0)
        )
    return out


def _exp(w: Array) -> Array:
    """Return the rotations (p, 3, 3) of rotation vectors (p, 3)."""
    return Rotation.from_rotvec(w).as_matrix()
