"""What counts as a radian of each joint: sliding joints are compared with turning ones by it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from spacearm.arrays import Array
from spacearm.model.arm import SpaceArm
from spacearm.model.defaults import way_to_tip

TURN = 2.0 * np.pi


@lru_cache(maxsize=64)
def radians(arm: SpaceArm) -> Array:
    """Return what counts as a radian of each joint in distances in joint space, (n,).

    1 [rad] for revolute joints. Of a sliding joint [m] its travel between the limits counts as one
    turn, but no longer way than the arm's length, the sum of the distances between its joints up
    to the tip, counts as a radian: by that way a turn of one radian moves the tip at most. A
    sliding joint without limits counts by that length (1 m if it is zero).
    """
    length = max(way_to_tip(arm.tree, tip) for tip in arm.tips)
    travel = (arm.upper - arm.lower) / TURN
    limited = np.isfinite(travel) & (travel > 0.0)
    slide = np.where(limited, np.minimum(travel, length or np.inf), length or 1.0)
    found = np.where(arm.slides, slide, 1.0)
    found.flags.writeable = False
    return found
