"""Velocities of closed chains: what keeps the grasps closed, and what it does to what is held.

The tips i hold one target, whose twist is v_t, while momentum is zero (free components of v_b):

    A_b v_b + A_q dq + M_t v_t = 0,    J_b v_b + J_q dq = G v_t,

M_t the momentum of the target per twist, G the twists of the grasps. With N^T G = 0 the joint
rates that keep the grasps closed are those with N^T (J_b B + J_q) dq = 0, where v_b = B dq follows
from the momentum; they move the target by v_t = G^+ (J_b B + J_q) dq. Where the fixed world is held
it is the spacecraft that moves, by v_b, and J_q dq = -G v_b.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.mechanics.target import Target
from spacearm.model.arguments import BaseMode, free_components
from spacearm.model.arm import Configuration
from spacearm.model.joints import joint_scales

#: Share of the largest singular value up to which one is rounding: grasps close to that.
ROUNDING = 1e-9


class ClosedMotions(NamedTuple):
    """The joint motions that keep grasps closed, in radians, and what they do.

    K are the task's rows of all tips, k those of one; rows are along the task axes, linear ones
    divided by the task's length.

    Attributes:
        rows: (k, 6) the task's rows of a twist in inertial axes.
        grasps: (K, k) G, the twists of the grasps by that of what is held.
        motions: (n, p) orthonormal joint motions that keep the grasps closed.
        held: (k, p) twists of what is held that they bring.
        spacecraft: (6, p) twists of the spacecraft that they bring, spacecraft axes.
    """

    rows: Array
    grasps: Array
    motions: Array
    held: Array
    spacecraft: Array


def closed_motions(cfg: Configuration, target: Target | None, mode: BaseMode) -> ClosedMotions:
    """Compute the joint motions that keep grasps closed.

    Args:
        cfg: The configuration; all its tips hold the target.
        target: The target, where it is; None if the tips hold the fixed world.
        mode: What the spacecraft does; does not count where the fixed world is held.
    """
    task, R, f = cfg.arm.task, cfg.base.rotation, free_components(mode)
    J, A, unit = task.jacobian(cfg.J, R), cfg.A, joint_scales(cfg.arm)
    rows = replace(task, tips=1).jacobian(np.eye(6), R)
    back = np.linalg.pinv(rows)
    centre = cfg.base.translation if target is None else target.pose.translation
    G = task.jacobian(np.vstack([carried(tip.translation - centre) for tip in cfg.tips]), R) @ back
    if target is None:
        G, B = -G, A[:0, 6:]
    else:
        M = (_momentum(target, cfg.com) @ back @ np.linalg.pinv(G))[:f]
        B = -np.linalg.solve(A[:f, :f] + M @ J[:, :f], A[:f, 6:] + M @ J[:, 6:])
    H = (J[:, : len(B)] @ B + J[:, 6:]) * unit
    N = np.linalg.svd(G)[0][:, G.shape[1] :]
    _, sigma, VT = np.linalg.svd(N.T @ H)
    floor = ROUNDING * float(np.linalg.norm(H, 2))
    Z = VT[int(np.count_nonzero(sigma > floor)) :].T
    T = np.linalg.pinv(G) @ H @ Z
    if target is None:
        turned = np.kron(np.eye(2), R.T)
        spacecraft = turned @ back @ T
    else:
        spacecraft = np.vstack((B * unit @ Z, np.zeros((6 - len(B), Z.shape[1]))))
    return ClosedMotions(rows, G, Z, T, spacecraft)


def carried(lever: Array) -> Array:
    """Return the twist (6, 6) of a point that a body carries, by that of the body's origin."""
    return np.block([[np.eye(3), -pin.skew(lever)], [np.zeros((3, 3)), np.eye(3)]])


def _momentum(target: Target, about: Array) -> Array:
    """Return the momentum (6, 6) of a target about a point, by the twist of its frame."""
    R = target.pose.rotation
    lever = R @ target.com
    linear = target.mass * carried(lever)[:3]
    angular = np.hstack((np.zeros((3, 3)), R @ target.inertia @ R.T))
    return np.vstack((linear, angular + pin.skew(target.pose.translation + lever - about) @ linear))
