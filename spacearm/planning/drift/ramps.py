"""Ramps: where straight joint motions end that bring the tip to its goal in spite of a drift."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.equations.turns import GAUSS
from spacearm.mechanics.batch import evaluate
from spacearm.model.arm import Configuration
from spacearm.motion.goal import goal_axes
from spacearm.planning.loops import Indices
from spacearm.planning.many_curves import inverse_kinematics, spacecraft_turns
from spacearm.planning.optimiser import Target

GUESSES, STEPS, INTERVALS = 300, 25, 6
"""First guesses of inverse kinematics, its steps, and intervals of the integration along each."""
NEAR = 0.1
"""Error of the tip that bending a motion makes up for [m], [rad]."""
SAME = 0.1
"""Ends nearer to each other than this count once [rad], [m]."""


def ramp_ends(
    start: Configuration,
    target: Target,
    turn: Array,
    reach: Array,
    rng: np.random.Generator,
    check_time: Callable[[], None],
) -> Array:
    """Return joint positions (m, n) at the goal, those that are reached soonest first.

    The spacecraft ends turned by the straight joint motion there and by the drift, which is taken
    as that of the start. Square arms end on the start's side of the singular set.

    Args:
        start: Configuration at the start.
        target: What the motion must achieve.
        turn: (3, 3) the drift until the end, inertial axes.
        reach: (n,) the largest motion of each joint [rad], [m].
        rng: Draws the first guesses.
        check_time: Called at every step; it may raise an error to end the search.
    """
    arm, q0 = start.arm, start.q
    if target.q is not None:
        return target.q[None]
    if target.tip is None:
        return q0[None]
    lower, upper = (np.clip(b, q0 - reach, q0 + reach) for b in (target.lower, target.upper))
    nodes = (np.arange(INTERVALS)[:, None] + GAUSS).ravel() / INTERVALS

    def attitudes(Q: Array, _: Indices) -> Array:
        way = (Q - q0)[:, None]
        rates = np.broadcast_to(way, (len(Q), len(nodes), arm.n))
        line = spacecraft_turns(arm, q0 + nodes[:, None] * way, rates)
        return turn @ start.base.rotation @ line

    guesses = rng.uniform(lower, upper, (GUESSES, arm.n))
    tip = pin.SE3(target.tip.rotation, target.tip.translation - start.com)
    Q, off = inverse_kinematics(
        arm, guesses, tip, attitudes, goal_axes(start), STEPS, check_time, (lower, upper)
    )
    Q = Q[off < NEAR]
    if arm.n == arm.task.k and len(Q):
        side = evaluate(arm, np.vstack((q0, Q)), ("determinant",))["determinant"]
        Q = Q[side[1:] * side[0] > 0.0]
    Q = Q[np.argsort((np.abs(Q - q0) / reach).max(axis=1))]
    first = [np.abs(Q[:i] - q).max(axis=1).min(initial=np.inf) > SAME for i, q in enumerate(Q)]
    return Q[np.array(first, dtype=bool)]
