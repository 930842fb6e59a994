"""Many joint curves at once: the turn of the spacecraft along each, and inverse kinematics.

Without derivatives with respect to the curves; the module `curve` has those, for one curve at a
time.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from spacearm.arrays import Array
from spacearm.mechanics.floating import Reactions, reactions, turns_of_spacecraft
from spacearm.model.arm import SpaceArm
from spacearm.planning.loops import Indices
from spacearm.singularities.polynomials import plane_of_motion

STRIDE = 0.5
"""Largest joint motion of one step of Newton's method [rad] or [m]."""

DONE = 1e-10
"""What the tip misses where Newton's method stops [m], [rad]."""

FAR = -0.9
"""Cosine of the angle beyond which the sine of a rotation does not tell its axis."""

Turns = Callable[[Array, Indices], Array]
"""Returns the attitudes (r, 3, 3) of the spacecraft at the ends (r, n) of some of the curves."""


@lru_cache(maxsize=64)
def turning_axes(arm: SpaceArm) -> tuple[int, ...]:
    """Return the axes about which an arm turns its spacecraft: the normal of a plane, or all."""
    normal = plane_of_motion(arm)
    return (0, 1, 2) if normal is None else (normal,)


def spacecraft_turns(arm: SpaceArm, Q: Array, rates: Array) -> Array:
    """Return the turns of the spacecraft (K, 3, 3) along curves, by the Magnus method of `move`.

    Args:
        arm: The arm.
        Q: (K, 2 g, n) positions at the Gauss points of g equal intervals.
        rates: (K, 2 g, n) derivatives there, the curve's parameter from 0 to 1.
    """
    K, points, n = Q.shape
    g = points // 2
    parts = turns_of_spacecraft(
        arm, Q.reshape(-1, 2, n), rates.reshape(-1, 2, n), np.full(K * g, 1.0 / g)
    ).reshape(K, g, 3, 3)
    T = parts[:, 0]
    for i in range(1, g):
        T = T @ parts[:, i]
    return T


def held_jacobian(at: Reactions) -> Array:
    """Return the Jacobians (m, 6, n) with the attitude held: J* without the turning by A dq."""
    swept = np.cross(at.r[:, None], np.swapaxes(at.A, 1, 2))
    return at.J + np.concatenate((np.swapaxes(swept, 1, 2), -at.A), axis=1)


def inverse_kinematics(
    arm: SpaceArm,
    q: Array,
    tip: pin.SE3,
    attitude: Array | Turns,
    axes: Array,
    steps: int,
    check_time: Callable[[], None] = lambda: None,
    limits: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Find joint positions that bring the tip to a pose, by damped Newton steps from first guesses.

    Args:
        arm: The arm.
        q: (K, n) first guesses.
        tip: The pose, from the system CM.
        attitude: (K, 3, 3) attitudes of the spacecraft, held; or a function that gives them for
            joint positions (r, n) and the numbers of their curves: then the spacecraft turns with
            each step by (33c).
        axes: (3, 3) the goal axes; see `goal_axes`.
        steps: Number of steps.
        check_time: Called at every step; it may raise an error to end the search.
        limits: (n,) least and (n,) largest joint positions, which no step passes.

    Returns:
        (K, n) joint positions; (K,) norm of what the tip misses in the task's rows [m], [rad].
    """
    q, miss, rows = q.copy(), np.empty(len(q)), np.arange(len(q))
    for step in range(steps + 1):
        check_time()
        T = attitude(q[rows], rows) if callable(attitude) else attitude[rows]
        at = reactions(arm, q[rows])
        left = _left(arm, at, T, tip, axes)
        miss[rows] = np.linalg.norm(left, axis=1)
        far = miss[rows] > DONE
        if step == steps or not far.any():
            break
        J = _in_rows(arm, at.J if callable(attitude) else held_jacobian(at), T, axes)
        rows = rows[far]
        q[rows] += _damped_step(J[far], left[far])
        if limits is not None:
            q[rows] = np.clip(q[rows], *limits)
    return q, miss


def turned_kinematics(
    arm: SpaceArm,
    q: Array,
    tip: pin.SE3,
    attitude: Array,
    axes: Array,
    steps: int,
    check_time: Callable[[], None],
    limits: tuple[Array, Array],
) -> tuple[Array, Array, Array]:
    """Find joint positions and attitudes of the spacecraft together that bring the tip to a pose.

    The arguments are those of `inverse_kinematics`, but the attitudes are first guesses too: they
    turn about the axes about which the arm can turn its spacecraft.

    Returns:
        (K, n) joint positions; (K, 3, 3) attitudes; (K,) norm of what the tip misses.
    """
    n, turns, rows = arm.n, list(turning_axes(arm)), np.arange(len(q))
    q, T, miss = q.copy(), attitude.copy(), np.empty(len(q))
    for step in range(steps + 1):
        check_time()
        at = reactions(arm, q[rows])
        left = _left(arm, at, T[rows], tip, axes)
        miss[rows] = np.linalg.norm(left, axis=1)
        far = miss[rows] > DONE
        if step == steps or not far.any():
            break
        about = np.tile(np.vstack((np.zeros((3, 3)), np.eye(3))), (len(rows), 1, 1))
        about[:, :3] = np.swapaxes(np.cross(np.eye(3), at.r[:, None]), 1, 2)  # e_i x r
        both = np.concatenate((held_jacobian(at), about[:, :, turns]), axis=2)
        J, rows = _in_rows(arm, both, T[rows], axes)[far], rows[far]
        change = _damped_step(J, left[far])
        q[rows] = np.clip(q[rows] + change[:, :n], *limits)
        turn = np.zeros((len(rows), 3))
        turn[:, turns] = change[:, n:]
        T[rows] = T[rows] @ Rotation.from_rotvec(turn).as_matrix()
    return q, T, miss


def _left(arm: SpaceArm, at: Reactions, T: Array, tip: pin.SE3, axes: Array) -> Array:
    """Return what the tip misses (m, k) in the task's rows along the goal axes."""
    goal, T = pin.SE3(axes.T, np.zeros(3)) * tip, axes.T @ T
    turn = rotation_vectors(goal.rotation @ np.swapaxes(T @ at.R, 1, 2))
    reached = (T @ at.r[:, :, None])[:, :, 0]
    return np.concatenate((goal.translation - reached, turn), axis=1)[:, arm.task.indices]


def rotation_vectors(R: Array) -> Array:
    """Return the rotation vectors (m, 3) of rotations (m, 3, 3)."""
    sines = 0.5 * (R[:, [2, 0, 1], [1, 2, 0]] - R[:, [1, 2, 0], [2, 0, 1]])
    sine, cosine = np.linalg.norm(sines, axis=1), 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0)
    vectors = sines / np.sinc(np.arctan2(sine, cosine) / np.pi)[:, None]
    if (far := cosine < FAR).any():
        vectors[far] = Rotation.from_matrix(R[far]).as_rotvec()
    return vectors


def _in_rows(arm: SpaceArm, J: Array, T: Array, axes: Array) -> Array:
    """Return the task's rows (m, k, p), along the goal axes, of Jacobians in spacecraft axes."""
    turned = (axes.T @ T)[:, None] @ J.reshape(len(J), 2, 3, -1)
    return turned.reshape(J.shape)[:, arm.task.indices]


def _damped_step(J: Array, left: Array) -> Array:
    """Return damped Newton steps (m, p), none of whose components is larger than `STRIDE`."""
    damping = 1e-3 + 0.1 * np.minimum(1.0, np.linalg.norm(left, axis=1))
    Jt = np.swapaxes(J, 1, 2)
    square = J @ Jt + (damping**2)[:, None, None] * np.eye(J.shape[1])
    step = (Jt @ np.linalg.solve(square, left[:, :, None]))[:, :, 0]
    return step * np.minimum(1.0, STRIDE / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
