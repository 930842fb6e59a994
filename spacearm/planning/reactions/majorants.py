"""Majorants: bounds on how fast the angular momentum of a moving arm changes.

The spacecraft keeps its attitude. The momentum about the system CM is then

    h = sum_k (m_k r_k x r_k' + R_k I_k R_k^T w_k) - M r_cm x r_cm',

r_k the CM of body k, R_k its rotation and w_k its angular velocity, seen from the spacecraft. A
quantity f is bounded by b_0, b_1, ... with |d^i f / dt^i| <= b_i, and products by Leibniz' rule.
Rotations have R' = R [u] dq, and all lengths are constant but those of sliding joints.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.model.arm import SpaceArm

ROOT = 1
"""Index of the spacecraft's joint in the model."""


def momentum_bounds(arm: SpaceArm, joints: Array) -> Array:
    """Return bounds (d, p) on h and its first d - 1 derivatives, one for each of p intervals.

    Args:
        arm: The arm.
        joints: (d + 1, n, p) bounds on the joint positions and their first d derivatives.
    """
    model, C = arm.model, np.eye(arm.n) if arm.coupling is None else np.abs(arm.coupling)
    moved = np.einsum("jn,dnp->jdp", C, joints)
    moved[:, 0] += np.abs(arm.offsets)[:, None]
    still: Array = np.zeros(joints[:, 0].shape)
    unit = still.copy()
    unit[0] = 1.0
    rotation, place, spin = {ROOT: unit}, {ROOT: still}, {ROOT: still[1:]}
    base = model.inertias[ROOT].lever
    h, carried = still[1:].copy(), still.copy()
    for joint in range(ROOT + 1, model.njoints):
        parent, x = model.parents[joint], moved[joint - ROOT - 1]
        offset = model.jointPlacements[joint].translation - (base if parent == ROOT else 0.0)
        R, p, w = rotation[parent], place[parent], spin[parent]
        p = p + np.linalg.norm(offset) * R
        if arm.tree.joints[model.names[joint]].kind == "prismatic":
            p = p + product(R, x)
        else:
            w = w + product(R[:-1], x[1:])
            R = product(R, turned(x))
        rotation[joint], place[joint], spin[joint] = R, p, w
        body: pin.Inertia = model.inertias[joint]
        r = p + np.linalg.norm(body.lever) * R
        carried += body.mass * r
        h += body.mass * product(r[:-1], r[1:])
        largest = float(np.linalg.norm(body.inertia, 2))
        h += largest * product(product(R[:-1], R[:-1]), w)
    return h + product(carried[:-1], carried[1:]) / arm.mass


def product(a: Array, b: Array) -> Array:
    """Return bounds (d, p) of a product, by Leibniz' rule, from those of its factors."""
    rows = [
        sum(math.comb(k, i) * a[i] * b[k - i] for i in range(k + 1))
        for k in range(min(len(a), len(b)))
    ]
    return np.array(rows)


def turned(angle: Array) -> Array:
    """Return bounds (d, p) of the rotation by an angle about a fixed axis, from its bounds."""
    rows = [np.ones_like(angle[0])]
    for k in range(1, len(angle)):
        terms = (math.comb(k - 1, i) * rows[i] * angle[k - i] for i in range(k))
        rows.append(np.sum(list(terms), axis=0))
    return np.array(rows)
