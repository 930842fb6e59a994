"""What the exported equations need to know of an arm: its structure, and numbers beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, unknown
from spacearm.kernels.floating import Bodies
from spacearm.mechanics.compiled import all_bodies
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.singularities.polynomial import plane_of_motion, probes

Indices = npt.NDArray[np.int_]


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
    """How the bodies of an arm hang together.

    Attributes:
        n: Number of joints that count.
        bodies: (N + 1,) the same records that the compiled kernels read; of them only what is no
            number of a body: parent, column, slides, gain.
        gains: (N, n) rates of all joints per rate of those that count.
        offsets: (N,) positions of all joints at q = 0 [rad] or [m].
        turns: (N + 1, 3, 3) take z to the axis of the joint, in the frame of its body.
        carries: (N + 1, N + 1) 1 where joint i (row; 0 is the whole) carries body j, else 0.
        tips: Number of the body that each tip is fixed to.
        rows: (k,) rows of the task in the stacked twists of all tips.
        scale: (k, 1) their factors.
        mode: What the spacecraft does.
        normal: Normal axis (0, 1, 2) of an arm that moves in a plane, else None.
    """

    n: int
    bodies: Bodies
    gains: Array
    offsets: Array
    turns: Array
    carries: Array
    tips: tuple[int, ...]
    rows: tuple[int, ...]
    scale: Array
    mode: BaseMode
    normal: int | None

    @property
    def reaches(self) -> Array:
        """(tips, N) 1 where a joint moves a tip, else 0."""
        return self.carries[1:, self.tips].T


def structure_of(arm: SpaceArm, mode: BaseMode) -> Structure:
    """Return the structure of an arm."""
    b = all_bodies(arm)
    carries = np.eye(len(b))
    for i in range(len(b) - 1, 0, -1):
        carries[b[i]["parent"]] += carries[i]
    gains = np.zeros((len(b) - 1, arm.n))
    gains[np.arange(len(gains)), b["column"][1:]] = b["gain"][1:]
    model = arm.model
    return Structure(
        n=arm.n,
        bodies=b,
        gains=gains,
        offsets=np.array(arm.offsets),
        turns=_turns(arm, b),
        carries=carries,
        tips=tuple(model.frames[frame].parentJoint - 1 for frame in arm.tip_frames),
        rows=tuple(arm.task.indices),
        scale=arm.task.scale,
        mode=mode,
        normal=plane_of_motion(arm, probes(arm)),
    )


def parameters_of(arm: SpaceArm) -> Parameters:
    """Return the numbers of an arm."""
    model = arm.model
    inertias = [model.inertias[i] for i in range(1, model.njoints)]
    joints = [model.jointPlacements[i] for i in range(2, model.njoints)]
    tips = [model.frames[frame].placement for frame in arm.tip_frames]
    return Parameters(
        masses=np.array([body.mass for body in inertias]),
        centres=np.array([body.lever for body in inertias]),
        inertias=np.array([body.inertia for body in inertias]),
        joint_positions=np.array([joint.translation for joint in joints]),
        joint_rotations=np.array([joint.rotation for joint in joints]),
        tip_positions=np.array([tip.translation for tip in tips]),
        tip_rotations=np.array([tip.rotation for tip in tips]),
    )


def symbolic(p: Parameters) -> Parameters:
    """Return numbers as arrays of objects, which symbols can stand beside."""
    return Parameters(*(np.asarray(values).astype(object) for values in p))


def chosen(names: str | Sequence[str]) -> tuple[str, ...]:
    """Return names of parameters as they are given, each once.

    Raises:
        ConfigurationError: There is no such parameter.
    """
    wanted = tuple(dict.fromkeys((names,) if isinstance(names, str) else names))
    for name in wanted:
        if name not in Parameters._fields:
            raise ConfigurationError(unknown("parameter", name, Parameters._fields))
    return wanted


def _turns(arm: SpaceArm, b: Bodies) -> Array:
    """Return the turns (N + 1, 3, 3) that stand in the records of the kernels."""
    turns = np.tile(np.eye(3), (len(b), 1, 1))
    for i in range(1, len(b)):
        E = arm.model.jointPlacements[i + 1].rotation
        turns[i] = E.T @ turns[b[i]["parent"]] @ b[i]["E"]
    return turns
