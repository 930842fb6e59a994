"""What the equations know of an arm: how its bodies hang together, and numbers beside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mode = Literal["free-floating", "attitude-controlled", "fixed"]


class Parameters(NamedTuple):
    """The numbers of an arm with N joints, in the frames of its model; a pytree of JAX.

    Body 0 is the spacecraft, joint i = 1..N carries body i, whose frame stands in that joint. A
    link that is fixed to another belongs to its body.

    Attributes:
        masses: (N + 1,) mass of each body [kg].
        centres: (N + 1, 3) its CM in its frame [m].
        inertias: (N + 1, 3, 3) its inertia about that CM, axes of its frame [kg m^2].
        joint_positions: (N, 3) origin of each joint in the frame of the body before it [m].
        joint_rotations: (N, 3, 3) attitude of the joint at zero in that frame.
        tip_positions: (tips, 3) origin of each tip in the frame of the body it is fixed to [m].
        tip_rotations: (tips, 3, 3) its attitude in that frame.
    """

    masses: Any
    centres: Any
    inertias: Any
    joint_positions: Any
    joint_rotations: Any
    tip_positions: Any
    tip_rotations: Any


@dataclass(frozen=True, eq=False)
class Structure:
    """How the bodies of an arm hang together, and what the spacecraft does.

    Structures with the same numbers are equal, so that what is compiled for one serves the other.

    Attributes:
        n: Number of joints that count.
        parents: (N + 1,) body that the joint of each starts from; parents come first, 0 is its own.
        slides: (N + 1,) whether the joint of each body is prismatic.
        gains: (N, n) rates of all joints per rate of those that count.
        offsets: (N,) positions of all joints at q = 0 [rad] or [m].
        turns: (N + 1, 3, 3) take z to the axis of the joint, in the frame of its body.
        tips: Number of the body that each tip is fixed to.
        rows: (k,) rows of the task in the stacked twists of all tips.
        scale: (k, 1) their factors.
        mode: What the spacecraft does.
        normal: Normal axis (0, 1, 2) of an arm that is known to move in a plane, else None.
    """

    n: int
    parents: tuple[int, ...]
    slides: tuple[bool, ...]
    gains: Array
    offsets: Array
    turns: Array
    tips: tuple[int, ...]
    rows: tuple[int, ...]
    scale: Array
    mode: Mode
    normal: int | None = None

    @cached_property
    def carries(self) -> Array:
        """(N + 1, N + 1) 1 where joint i (row; 0 is the whole) carries body j, else 0."""
        found = np.eye(len(self.parents))
        for i in range(len(found) - 1, 0, -1):
            found[self.parents[i]] += found[i]
        return found

    @cached_property
    def reaches(self) -> Array:
        """(tips, N) 1 where a joint moves a tip, else 0."""
        return self.carries[1:, self.tips].T

    @cached_property
    def _key(self) -> tuple[Any, ...]:
        arrays = (self.gains, self.offsets, self.turns, self.scale)
        discrete = (self.n, self.parents, self.slides, self.tips, self.rows, self.mode, self.normal)
        return (*discrete, *(array.tobytes() for array in arrays))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Structure) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)
