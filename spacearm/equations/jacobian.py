"""J* of a floating arm, equation (35), and the connection of (33c).

Papadopoulos & Dubowsky (1993), DOI 10.1115/1.2897406: J* = J_q - J_b A_b^-1 A_q. The tests hold
this to `mechanics.jacobian`, which takes the momentum matrix from Pinocchio, and to
`mechanics.barycentric_formulation`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from spacearm.equations.linear import solve
from spacearm.equations.posture import Posture, posture
from spacearm.equations.structure import Parameters, Structure


def connection(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute -D^-1 D_q (3, n) of (33c): the spacecraft turns with w_0 = connection dq."""
    return connection_at(xp, tree, posture(xp, tree, p, q))


def connection_at(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute the connection (3, n) of a posture."""
    return response(xp, tree, at)[3:] @ tree.gains


def jacobian(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute J* (6 tips, n) of (35), in the mode of the structure."""
    return jacobian_at(xp, tree, posture(xp, tree, p, q))


def jacobian_at(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute J* (6 tips, n) of a posture."""
    X, v, w = response(xp, tree, at), at.s[:, :3], at.s[:, 3:]
    blocks = []
    for tip in range(len(tree.tips)):
        r, reaches = at.tip_positions[tip], tree.reaches[tip][:, None]
        angular = reaches * w + X[3:].T
        linear = reaches * v + X[:3].T + xp.cross(angular, r)
        blocks.append(xp.concatenate([linear, angular], axis=1).T)
    return xp.concatenate(blocks, axis=0) @ tree.gains


def base_twist(xp: Any, tree: Structure, at: Posture, h: Any) -> Any:
    """Compute M_bb^-1 h (6, m), the spacecraft's twist about the system CM, of what is free of it.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        at: The posture.
        h: (6, m) momenta of the whole.
    """
    rest = np.zeros((3, h.shape[1]))
    linear = rest if tree.mode == "fixed" else h[:3] * (1.0 / at.M)
    angular = solve(xp, at.D, h[3:]) if tree.mode == "free-floating" else rest
    return xp.concatenate([linear, angular], axis=0)


def response(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute the spacecraft's twist (6, N) about the system CM per unit rate of the joints."""
    return base_twist(xp, tree, at, -at.P.T)


def tip_twist(xp: Any, tree: Structure, at: Posture, dq: Any) -> Any:
    """Compute J* dq (6 tips,) of a posture, without J*."""
    rates = tree.gains @ dq
    own = base_twist(xp, tree, at, -(rates @ at.P)[:, None])[:, 0]
    blocks = []
    for tip in range(len(tree.tips)):
        moved = own + (tree.reaches[tip] * rates) @ at.s
        blocks += [moved[:3] + xp.cross(moved[3:], at.tip_positions[tip]), moved[3:]]
    return xp.concatenate(blocks)


def task_jacobian(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute the rows (k, n) of J* that the task names, scaled."""
    return task_jacobian_at(xp, tree, posture(xp, tree, p, q))


def task_jacobian_at(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute the `task_jacobian` of a posture."""
    return tree.scale * jacobian_at(xp, tree, at)[np.array(tree.rows)]
