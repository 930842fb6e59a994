"""SpaceArm: a spacecraft and its arm, loaded from a URDF with a free-flyer root."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm import urdf
from spacearm.arrays import LARGEST, Array
from spacearm.catalogue import find
from spacearm.configuration import Configuration, configure, sound_pose
from spacearm.defaults import chain_length, choose_tip, default_task, movable
from spacearm.errors import ConfigurationError, ModelError, UnsupportedError, unknown
from spacearm.task import Task
from spacearm.tree import Tree

MOST_JOINTS = 200
"""Movable joints that a model may have."""


def load(
    model: str | os.PathLike[str],
    *,
    tip: str | None = None,
    task: str | Task | None = None,
    locked: Mapping[str, float] | None = None,
    check: urdf.Check | None = None,
) -> SpaceArm:
    """Loads a spacecraft with its arm.

    The spacecraft is the URDF's root link with all that fixed joints hold to it; a massless root
    joined to the real bus is fine. Side branches (solar panels, other arms) are bodies and
    joints like any other. Joints that mimic another follow it and are not counted in n.

    Args:
        model: A catalogue name (see `catalogue`) or the path of a URDF.
        tip: Link whose frame is the tip. Default: the leaf link behind the most movable joints
            (of several, the one behind the most joints of any kind).
        task: The twist rows that count, as "x y rz", "pose", "position", "orientation" or a
            `Task`. Default: for planar arms the rows of the plane ("x y", from 3 joints on with
            the rotation); otherwise "pose" from 6 joints on, else "position".
        locked: Joints to freeze, with their values [rad] or [m].
        check: "error", "warn" or "accept": what to do with inertias that no rigid body can
            have. Default: what the catalogue says for its models, "error" for files.

    Raises:
        ModelError: The model is unknown, cannot be read or is unsound.
        ConfigurationError: tip, task or locked name something that does not exist.
    """
    info = find(model)
    path = info.path if info else Path(model)
    tree = urdf.read(path, check or (info.check if info else "error"))
    return SpaceArm.of(_lock(tree, locked or {}), path, tip=tip, task=task)


@dataclass(frozen=True, eq=False, repr=False)
class SpaceArm:
    """A free-floating spacecraft with an arm. It never changes; `replace` gives a new one.

    Attributes:
        name: The robot's name.
        path: Where its URDF was read.
        tree: Links and joints as read, locked joints frozen.
        model: pin.Model with a free-flyer root, not to be edited. All its joints have one number
            each, the unlimited ones too; joints that mimic another are separate joints here.
        tip: Name of the tip link.
        tip_frame: Index of its frame in the model.
        task: The twist rows that count.
        joint_names: The n movable joints, in the model's order.
        coupling: (model.nv - 6, n) rates of the model's joints per rate of the n, None if they
            are the same (no mimic joint).
        offsets: (model.nv - 6,) positions of the model's joints at q = 0.
        lower: (n,) lower joint limits [rad] or [m], -inf where there is none.
        upper: (n,) upper joint limits [rad] or [m], inf where there is none.
    """

    name: str
    path: Path
    tree: Tree
    model: pin.Model
    tip: str
    tip_frame: int
    task: Task
    joint_names: tuple[str, ...]
    coupling: Array | None
    offsets: Array
    lower: Array
    upper: Array
    _asked: Task | None
    _spare: list[pin.Data] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        tree: Tree,
        path: Path,
        *,
        tip: str | None = None,
        task: str | Task | None = None,
    ) -> SpaceArm:
        """The arm in a checked tree; arguments as in `load`."""
        leading = tree.leading()
        if not leading:
            raise ModelError(f"{path}: no joint can move; an arm needs at least one free joint")
        if len(tree.coupling()[0]) > MOST_JOINTS:
            raise UnsupportedError(
                f"{path}: {len(tree.coupling()[0])} movable joints, and Pinocchio's memory grows "
                f"with their cube; lock all but {MOST_JOINTS}"
            )
        tip = choose_tip(tree, path, tip)
        asked = task if task is None or isinstance(task, Task) else Task(task)
        task = asked or default_task(tree, tip)
        if task.mixed and task.length is None:
            task = replace(task, length=chain_length(tree, tip, path))
        coupling, offsets = tree.coupling()
        model = tree.pinocchio()
        return cls(
            name=tree.name,
            path=path,
            tree=tree,
            model=model,
            tip=tip,
            tip_frame=model.getFrameId(tip, pin.BODY),
            task=task,
            joint_names=tuple(joint.name for joint in leading),
            coupling=None if len(coupling) == len(leading) else coupling,
            offsets=offsets,
            lower=_read_only([joint.lower for joint in leading]),
            upper=_read_only([joint.upper for joint in leading]),
            _asked=asked,
        )

    @property
    def n(self) -> int:
        """Number of movable joints."""
        return len(self.joint_names)

    @property
    def mass(self) -> float:
        """Total mass M [kg]."""
        return float(sum(inertia.mass for inertia in self.model.inertias))

    @property
    def sigma_unit(self) -> str:
        """Unit of the singular values of the task Jacobian: task rows per joint rate."""
        sliding = {self.tree.joints[name].kind == "prismatic" for name in self.joint_names}
        rate = "(rad or m)" if len(sliding) == 2 else "m" if True in sliding else "rad"
        row = "1" if self.task.mixed else "rad" if min(self.task.indices) >= 3 else "m"
        return f"{row}/{rate}"

    @property
    def mount(self) -> pin.SE3:
        """Pose of the first joint on the way to the tip, in the spacecraft frame."""
        name = movable(self.tree, self.tip)[0].name
        return self.model.jointPlacements[self.model.getJointId(name)].copy()

    def at(self, q: npt.ArrayLike, base: pin.SE3 | None = None) -> Configuration:
        """The configuration at joint positions q, inside the joint limits or not.

        Args:
            q: (n,) joint angles [rad] or displacements [m].
            base: Pose of the spacecraft frame in the inertial frame; the identity if None.

        Raises:
            ConfigurationError: q or base has the wrong shape or is not finite.
        """
        return configure(self, q, base)

    def all_joints(self, q: Array) -> Array:
        """(nv - 6,) positions of all joints of the model, those that mimic another included."""
        return q if self.coupling is None else self.coupling @ q + self.offsets

    def all_rates(self, dq: Array) -> Array:
        """(nv - 6,) rates of all joints of the model."""
        return dq if self.coupling is None else self.coupling @ dq

    def project(self, matrix: Array) -> Array:
        """(..., 6 + n) columns for the n joints out of (..., nv) columns of the model."""
        if self.coupling is None:
            return matrix
        return np.hstack((matrix[:, :6], matrix[:, 6:] @ self.coupling))

    def borrow(self) -> pin.Data:
        """Pinocchio's work space: making one costs more than using it, so it is kept."""
        return self._spare.pop() if self._spare else pin.Data(self.model)

    def give_back(self, data: pin.Data) -> None:
        """Keeps a work space for the next caller."""
        self._spare.append(data)

    def replace(
        self,
        *,
        base_mass: float | None = None,
        base_inertia: npt.ArrayLike | None = None,
        mount: pin.SE3 | None = None,
        link_mass: Mapping[str, float] | None = None,
        payload: float | None = None,
        tip: str | None = None,
        task: str | Task | None = None,
    ) -> SpaceArm:
        """A new arm with some things changed.

        Args:
            base_mass: Mass of the spacecraft (with all that is fixed to it) [kg]; its CM stays.
            base_inertia: (3, 3) inertia of the spacecraft about its CM, spacecraft axes [kg m^2].
            mount: Pose of the first joint on the way to the tip, in the spacecraft frame.
            link_mass: Masses of links [kg]; their inertias grow in proportion.
            payload: A point mass held at the tip [kg].
            tip: Link whose frame is the tip; a task that was not asked for is chosen anew.
            task: The twist rows that count.

        Raises:
            ModelError: No rigid body can have this mass and inertia.
        """
        tree = self.tree
        if base_mass is not None or base_inertia is not None:
            tree = tree.with_spacecraft(base_mass, base_inertia)
        if mount is not None:
            tree = tree.with_mount(movable(tree, self.tip)[0], sound_pose(mount, "mount"))
        for link, mass in (link_mass or {}).items():
            tree = tree.with_mass(link, mass)
        if payload is not None:
            tree = tree.with_payload(self.tip if tip is None else tip, payload)
        if task is None:
            task = self.task if tip is None else self._asked
        return SpaceArm.of(tree, self.path, tip=self.tip if tip is None else tip, task=task)

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_spare": []}

    def __repr__(self) -> str:
        return (
            f"SpaceArm({self.name}: {self.n} joints, {self.mass:g} kg, tip {self.tip!r}, "
            f"task {self.task.names!r})"
        )


def _lock(tree: Tree, values: Mapping[str, float]) -> Tree:
    """The tree with joints frozen, once it is sure that they exist and lead."""
    if not isinstance(values, Mapping):
        raise ConfigurationError(f"locked is {values!r}; give {{joint: value}}")
    leading = [joint.name for joint in tree.leading()]
    for name, value in values.items():
        joint = tree.joints.get(name)
        if joint and joint.mimic:
            raise ConfigurationError(
                f"locked: joint {name!r} mimics {joint.mimic.leader!r}; lock that one"
            )
        if name not in leading:
            raise ConfigurationError(f"locked: {unknown('movable joint', name, leading)}")
        if not isinstance(value, (int, float, np.number)) or not abs(value) <= LARGEST:
            raise ConfigurationError(f"locked: joint {name!r} at {value}; give a finite value")
    return tree.locked(values)


def _read_only(values: list[float]) -> Array:
    array = np.array(values)
    array.flags.writeable = False
    return array
