"""Loads while several hands move one target: torques and wrenches along a motion, and bounds.

The hands give the target the least wrenches that move it. In the axes of the target these are
constant linear functions of the wrench W = (f; n) that moves it, n about its frame. The joint
torques move the arms alone, and load each tip with what its hand gives. The bounds between the
samples are those of `mechanics.motion_bounds`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from spacearm.arrays import Array
from spacearm.closure.closing import carried
from spacearm.closure.target_paths import Carrying
from spacearm.mechanics.motion_bounds import (
    MARGIN,
    HandLoad,
    OnBoard,
    Peaks,
    bounded_peaks,
    shared_load_bends,
)
from spacearm.model.arm import kinematics
from spacearm.motion.flights import Grasp, body_load, flown_configurations, held_loads
from spacearm.motion.motion import Motion

#: Margin of the bounds on a braking that keeps all limits.
LOOSE = 0.05


def least_shares(levers: Sequence[Array], length: float) -> Array:
    """Return the map (6 tips, 6) from the wrench that moves a body to the least ones of its hands.

    The pseudo-inverse gives the least wrenches; moments count by the length.

    Args:
        levers: The grasps, from the point that the moment of the wrench is about (3,) each [m].
        length: The length [m].
    """
    scale = np.tile(np.repeat([1.0, length], 3), len(levers))
    G = np.vstack([carried(lever) for lever in levers]) * scale[:, None]
    return np.asarray(scale[:, None] * np.linalg.pinv(G.T))


def shared_peaks(
    motion: Motion,
    carrying: Carrying,
    check_time: Callable[[], None] | None = None,
    *,
    allowed: Array | float = 0.0,
    margin: float = MARGIN,
) -> Peaks:
    """Bound the torques of a motion as `sa.Tracking` flies it, and what each hand gives the target.

    The quantities are the torques of the n joints [N m] or [N], and for each hand the force [N] and
    the moment [N m] about its tip. The spacecraft floats.

    Args:
        motion: The motion, of the arms with the target; closure is kept.
        carrying: The arms with the target.
        check_time: Called now and then; raises once the time is up.
        allowed: (n + 2 tips,) as of `bounded_peaks`.
        margin: As of `bounded_peaks`, of the largest torque, force or moment of all joints or
            hands.
    """
    one, whole, free, target = carrying.of_target, motion.arm, carrying.free, carrying.target
    way, on_board = motion.spline, OnBoard.of(motion[0])
    body = Grasp(mass=target.mass, inertia=target.inertia, com=target.com)
    shares = least_shares(
        [grasp.translation for grasp in carrying.grasps], whole.task.length or 1.0
    )
    at = flown_configurations(motion, one)

    def loads(t: float) -> Array:
        if check_time is not None:
            check_time()
        cfg = at(t)
        tau, wrench = held_loads(cfg, way(t, 1), way(t, 2), body)
        given = (shares @ wrench).reshape(-1, 2, 3)  # axes of the target
        R = cfg.tip.rotation
        tips = kinematics(whole, cfg.q, cfg.base)
        moved = cfg.J[:, 6:].T @ (wrench.reshape(2, 3) @ R.T).ravel()
        tau = tau - moved + tips.J[:, 6:].T @ (given @ R.T).ravel()
        return np.append(tau, np.linalg.norm(given, axis=2))

    def values(t: Array) -> Array:
        return np.array([loads(s) for s in t.tolist()])

    held = body_load(one, body)
    blocks = shares.reshape(-1, 2, 3, 2, 3).swapaxes(2, 3)
    sizes = np.linalg.norm(blocks, 2, axis=(3, 4))
    frames = [free.model.frames[i] for i in free.tip_frames]
    hands = [
        HandLoad(frame.parentJoint, frame.placement.translation, size)
        for frame, size in zip(frames, sizes, strict=True)
    ]

    def bends(begin: Array, width: Array) -> Array:
        return shared_load_bends(whole, free, way, begin, width, on_board, held, hands)

    kinds = np.concatenate((np.where(whole.slides, 1, 0), np.tile((2, 3), len(hands))))
    return bounded_peaks(values, bends, motion.t, margin, allowed, kinds)
