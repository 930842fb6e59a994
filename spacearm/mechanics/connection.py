"""J* and the connection of many configurations by compiled kernels.

Imports numba, so import it only where it is used.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.kernels import cpu
from spacearm.kernels.paths import turns
from spacearm.mechanics.compiled import all_bodies, all_positions, bodies, frame_on_body
from spacearm.model.arm import SpaceArm


class Reactions(NamedTuple):
    """J*, the connection and the tip pose of m configurations, in spacecraft axes.

    Attributes:
        J: (m, 6, n) J* [m/rad], [1].
        A: (m, 3, n) the connection -D^-1 D_q of (33c): w_0 = A dq.
        r: (m, 3) the tip from the system CM [m].
        R: (m, 3, 3) attitude of the tip.
    """

    J: Array
    A: Array
    r: Array
    R: Array


def reactions(arm: SpaceArm, q: Array) -> Reactions:
    """Compute J*, the connection and the tip pose at q (n, m)."""
    at = _reactions(q.shape[1], arm.n)
    q = np.ascontiguousarray(all_positions(arm, q))  # one memory order, compiled once
    cpu.reactions(*bodies(arm), q, *at)
    return _of_tip(arm, at)


def _reactions(m: int, n: int) -> Reactions:
    """Return arrays for `reactions`."""
    shapes = (m, 6, n), (m, 3, n), (m, 3), (m, 3, 3)
    return Reactions(*(np.empty(shape) for shape in shapes))


def _of_tip(arm: SpaceArm, at: Reactions) -> Reactions:
    """Return reactions whose R is the attitude of the tip, not of its body."""
    return at._replace(R=at.R @ frame_on_body(arm, arm.tip_frame).rotation)


def connections(arm: SpaceArm, q: Array, dq: Array) -> tuple[Reactions, Array]:
    """Compute `reactions` at q (n, m), and the derivatives (m, 3, n) of A dq, dq (m, n) held."""
    m, n = dq.shape
    at, G = _reactions(m, n), np.empty((m, 3, n))
    q = np.ascontiguousarray(all_positions(arm, q))  # one memory order, compiled once
    b, tip, E = bodies(arm)
    turns.connections(b, all_bodies(arm), tip, E, q, dq, *at, G)
    return _of_tip(arm, at), G
