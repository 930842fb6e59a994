"""Turns: how far a spacecraft turns along straight joint segments, at zero momentum.

On a segment of joint motion dq, s from 0 to 1, the momentum h that the arm would have with the
attitude held turns the spacecraft: D w_0 = -h. The inertia D of the system is at least that of the
spacecraft alone, I_0, as a rigid system has no less energy than one of its bodies. Hence
|w_0| <= |h| / min I_0, and h changes by at most b s with the bound b of `majorants`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from spacearm.model.arm import Configuration
from spacearm.planning.many_curves import turning_axes
from spacearm.planning.reactions.loads import momentum_and_torque
from spacearm.planning.reactions.majorants import ROOT, momentum_bounds


def largest_turn(rows: Sequence[Configuration]) -> float:
    """Return the largest turn of a spacecraft from its attitude in the first row [rad].

    Between two rows it is at most what is added to the larger of theirs.
    """
    arm, T = rows[0].arm, rows[0].base.rotation
    at_rows = np.array([np.linalg.norm(pin.log3(T.T @ cfg.base.rotation)) for cfg in rows])
    if len(rows) == 1:
        return 0.0
    Q = np.array([cfg.q for cfg in rows])
    dq = np.diff(Q, axis=0)
    ends = [momentum_and_torque(arm, q, dq, np.zeros_like(dq))[0] for q in (Q[:-1], Q[1:])]
    h = np.linalg.norm(ends, axis=2).max(axis=0)
    far = np.maximum(np.abs(Q[:-1]), np.abs(Q[1:]))
    still = np.zeros_like(dq)
    bounds = momentum_bounds(arm, np.array([far, np.abs(dq), still]).swapaxes(1, 2))
    axes = list(turning_axes(arm))
    least = np.linalg.eigvalsh(arm.model.inertias[ROOT].inertia[np.ix_(axes, axes)])[0]
    between = (0.5 * h + 0.125 * bounds[1]) / least
    return float((np.maximum(at_rows[:-1], at_rows[1:]) + between).max())
