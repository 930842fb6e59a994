"""J*, the connection and the turns of the spacecraft of many configurations, compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from spacearm.arrays import Array
from spacearm.equations import turns
from spacearm.mechanics.many import ArmKernel, arms_kernel
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


class Turns(NamedTuple):
    """Turns of the spacecraft in m intervals, and how they depend on the curve of the joints.

    Attributes:
        T: (m, 3, 3) rotations from the axes at the end of each interval to those at its start.
        effects: (m, 2, 2, 3, n) how the axes at the end turn with q and with dq at each of its two
            Gauss points.
        J: (m, 2, 6, n) J* at these.
        A: (m, 3, n) the connection at the second.
        r: (m, 3) the tip from the system CM there [m].
        R: (m, 3, 3) attitude of the tip there.
    """

    T: Array
    effects: Array
    J: Array
    A: Array
    r: Array
    R: Array


def reactions(arm: SpaceArm, Q: Array) -> Reactions:
    """Compute J*, the connection and the pose of the first tip at Q (m, n)."""
    kernel = arms_kernel([arm], "free-floating", turns.reactions, (("q", (arm.n,)),), rows=len(Q))
    return Reactions(*kernel({"q": Q}))


def turns_of_spacecraft(arm: SpaceArm, Q: Array, rates: Array, h: Array) -> Array:
    """Compute the turns (m, 3, 3) of the spacecraft in intervals without momentum.

    Args:
        arm: The arm.
        Q: (m, 2, n) joint positions at the Gauss points of each interval.
        rates: (m, 2, n) their derivatives by the curve's parameter.
        h: (m,) lengths of the intervals.
    """
    found: Array = _in_intervals(arm, turns.turn, len(h))({"q": Q, "dq": rates, "h": h})
    return found


def turns_and_effects(arm: SpaceArm, Q: Array, rates: Array, h: Array) -> Turns:
    """Compute `turns_of_spacecraft`, and how they depend on the curve."""
    kernel = _in_intervals(arm, turns.turn_and_effects, len(h))
    return Turns(*kernel({"q": Q, "dq": rates, "h": h}))


def _in_intervals(arm: SpaceArm, function: Callable[..., Any], m: int) -> ArmKernel:
    """Return a function of the Gauss points of m intervals."""
    shapes = (("q", (2, arm.n)), ("dq", (2, arm.n)), ("h", ()))
    return arms_kernel([arm], "free-floating", function, shapes, rows=m)


def chained(T: Array) -> Array:
    """Return the products T_0 T_1 ... T_i of rotations (..., m, 3, 3), for each i."""
    found, by = T.copy(), 1
    while by < T.shape[-3]:
        found[..., by:, :, :] = found[..., :-by, :, :] @ found[..., by:, :, :]
        by *= 2
    return found
