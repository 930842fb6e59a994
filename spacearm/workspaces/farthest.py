"""Upper bound of the tip's distance from the system CM, over all joint angles.

Seen from the system CM the tip is a sum of vectors w_k, each fixed in a body: for a chain those of
the virtual manipulator. The farthest reach in direction e, with joint i and all beyond it turning
freely, is a support function,

    V_k(e) = e . w_k + sum of W_i(e) over the joints i on body k,   W_i(e) = max over q_i of V_i,

and W_i depends only on the angle between e and the axis of joint i: one table for each joint,
computed from the last to the first. Support functions are convex, so that between two nodes of a
table a bound follows from both, exact up to the square of their distance; no box is ever halved.
"""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.compiled import bodies
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode

NODES = 601
"""Nodes of a table, from one pole of the joint's axis to the other."""
AROUND = 1200
"""Directions about the axis at each node."""


def farthest(arm: SpaceArm, mode: BaseMode) -> float:
    """Bound the distance of the tip from the system CM from above [m].

    For a fixed spacecraft from its own CM. The bound is larger than the largest distance by some
    1e-5 of the arm's length for each joint.

    Args:
        arm: An arm of revolute joints, none of which mimics another.
        mode: What the spacecraft does.
    """
    b, tip, E = bodies(arm)
    w = _vectors(b, tip, E, mode)
    size = np.linalg.norm(w, axis=1)
    tables: dict[int, Array] = {}
    for k in range(len(b) - 1, -1, -1):
        joints = [i for i in range(k + 1, len(b)) if b[i]["parent"] == k]
        for i in joints:
            size[k] += size[i]  # the farthest that all beyond joint i can be
        tables[k] = _table(w[k], [(b[i]["E"] @ [0.0, 0.0, 1.0], tables[i]) for i in joints], size[k])
    return float(tables[0].max() / np.cos(np.pi / (NODES - 1) / 2.0))


def _vectors(b: Array, tip: int, E: Array, mode: BaseMode) -> Array:
    """Return the vectors (N + 1, 3) whose sum is the tip from the system CM, each in its body."""
    w = np.zeros((len(b), 3))
    w[tip] += E
    if mode == "fixed":
        w[0] -= b[0]["c"]
    for k in range(len(b)):
        if mode != "fixed":
            w[k] -= b[k]["m"] / b[0]["carried"] * b[k]["c"]
        if k > 0:
            share = 0.0 if mode == "fixed" else b[k]["carried"] / b[0]["carried"]
            w[b[k]["parent"]] += (float(b[k]["on_chain"]) - share) * b[k]["t"]
    return w


def _table(w: Array, joints: list[tuple[Array, Array]], size: float) -> Array:
    """Bound the support function on circles about z, at NODES angles from +z to -z.

    Args:
        w: (3,) vector fixed in the body.
        joints: The axis (3,) of each joint on the body and its own table.
        size: Bound of the support function.
    """
    polar, around = np.linspace(0.0, np.pi, NODES), 2.0 * np.pi * np.arange(AROUND) / AROUND
    e = np.stack(np.broadcast_arrays(
        np.outer(np.sin(polar), np.cos(around)),
        np.outer(np.sin(polar), np.sin(around)),
        np.cos(polar)[:, None],
    ), axis=-1)  # fmt: skip
    V = e @ w
    for axis, table in joints:
        V += _between(table, np.arccos(np.clip(e @ axis, -1.0, 1.0)))
    # between two directions on a circle: a chord, longer by 1 / cos, and the rest along z
    rest = 1.0 / np.cos(np.pi / AROUND) - 1.0
    return V.max(axis=1) + 2.0 * size * rest + 1e-14 * size


def _between(table: Array, angle: Array) -> Array:
    """Bound a support function at angles between the nodes of its table."""
    step = np.pi / (NODES - 1)
    i = np.minimum((angle / step).astype(np.int_), NODES - 2)
    t = angle - i * step
    return (table[i] * np.sin(step - t) + table[i + 1] * np.sin(t)) / np.sin(step)
