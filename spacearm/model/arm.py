"""SpaceArm: a spacecraft and its arm, loaded from a URDF with a free-flyer root."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, plain
from spacearm.description.bodies import Inertial
from spacearm.description.bus import STEEL, body
from spacearm.description.tips import choose_tips, movable, the_one
from spacearm.description.tree import Tree
from spacearm.description.urdf_writer import document
from spacearm.errors import ModelError, UnsupportedError
from spacearm.files import write
from spacearm.model.configuration import Configuration, configure
from spacearm.model.defaults import chain_length, default_task
from spacearm.model.frames import sound_pose
from spacearm.model.task import Task
from spacearm.model.wheels import Wheel, wheels_of

MOST_JOINTS = 200
"""Movable joints that a model may have."""


@dataclass(frozen=True, eq=False, repr=False)
class SpaceArm:
    """A free-floating spacecraft with an arm. It never changes; `replace` gives a new one.

    Attributes:
        name: The robot's name.
        path: Where its URDF was read; a mere name for arms that `mount` put together.
        tree: Links and joints, locked joints frozen, with what is drawn of them.
        model: pin.Model with a free-flyer root, not to be edited. All its joints have one number
            each, the unlimited ones too; joints that mimic another are separate joints here.
        tips: Names of the tip links, one as a rule.
        tip_frames: Indices of their frames in the model.
        task: The twist rows that count.
        wheels: Wheels, which are not among the joints; see `at`.
        joint_names: The n movable joints, in the model's order.
        coupling: (model.nv - 6, n) rates of the model's joints per rate of the n, None if they
            are the same (no mimic joint).
        offsets: (model.nv - 6,) positions of the model's joints at q = 0.
        lower: (n,) lower joint limits [rad] or [m], -inf where there is none; where a joint that
            mimics another has narrower ones, these.
        upper: (n,) upper joint limits [rad] or [m], inf where there is none; likewise.
    """

    name: str
    path: Path
    tree: Tree
    model: pin.Model
    tips: tuple[str, ...]
    tip_frames: tuple[int, ...]
    task: Task
    wheels: tuple[Wheel, ...]
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
        tip: str | Sequence[str] | None = None,
        task: str | Task | None = None,
    ) -> SpaceArm:
        """The arm in a checked tree; arguments as in `loading.load`."""
        leading = tree.leading()
        if not leading:
            raise ModelError(f"{path}: no joint can move; an arm needs at least one free joint")
        if len(tree.coupling()[0]) > MOST_JOINTS:
            raise UnsupportedError(
                f"{path}: {len(tree.coupling()[0])} movable joints, and Pinocchio's memory grows "
                f"with their cube; lock all but {MOST_JOINTS}"
            )
        tips = choose_tips(tree, path, tip)
        asked = task if task is None or isinstance(task, Task) else Task(task)
        task = replace(asked or default_task(tree, tips), tips=len(tips))
        if task.mixed and task.length is None:
            task = replace(task, length=max(chain_length(tree, tip, path) for tip in tips))
        coupling, offsets = tree.coupling()
        lower, upper = tree.limits()
        model = tree.pinocchio()
        return cls(
            name=tree.name,
            path=path,
            tree=tree,
            model=model,
            tips=tips,
            tip_frames=tuple(model.getFrameId(tip, pin.BODY) for tip in tips),
            task=task,
            wheels=wheels_of(tree, model, path),
            joint_names=tuple(joint.name for joint in leading),
            coupling=None if len(coupling) == len(leading) else coupling,
            offsets=offsets,
            lower=lower,
            upper=upper,
            _asked=asked,
        )

    @property
    def n(self) -> int:
        """Number of movable joints."""
        return len(self.joint_names)

    @property
    def slides(self) -> npt.NDArray[np.bool_]:
        """(n,) which joints are prismatic; the others are revolute."""
        return np.array([self.tree.joints[name].kind == "prismatic" for name in self.joint_names])

    @property
    def tip(self) -> str:
        """Name of the tip link.

        Raises:
            UnsupportedError: There are several; what asks for the tip cannot do with them.
        """
        self.require_one_tip()
        return self.tips[0]

    def require_one_tip(self) -> None:
        """Refuse an arm with several tips.

        Raises:
            UnsupportedError: What was asked for is about one tip, and there are several.
        """
        the_one(self.tips, self.name)

    @property
    def tip_frame(self) -> int:
        """Index of the tip's frame in the model; raises as `tip` does."""
        return self.tip_frames[self.tips.index(self.tip)]

    @property
    def mass(self) -> float:
        """Total mass M [kg]."""
        return float(sum(inertia.mass for inertia in self.model.inertias))

    @property
    def sigma_unit(self) -> str:
        """Unit of the singular values of the task Jacobian: task rows per joint rate."""
        rate = "m" if self.slides.all() else "(rad or m)" if self.slides.any() else "rad"
        row = "1" if self.task.mixed else "rad" if min(self.task.indices) >= 3 else "m"
        return f"{row}/{rate}"

    @property
    def mount(self) -> pin.SE3:
        """Pose of the first joint on the way to the tip, in the spacecraft frame."""
        name = movable(self.tree, self.tip)[0].name
        return self.model.jointPlacements[self.model.getJointId(name)].copy()

    def at(
        self,
        q: npt.ArrayLike,
        *,
        base: pin.SE3 | None = None,
        wheels: npt.ArrayLike | None = None,
    ) -> Configuration:
        """The configuration at joint positions q, inside the joint limits or not.

        Args:
            q: (n,) joint angles [rad] or displacements [m].
            base: Pose of the spacecraft frame in the inertial frame; the identity if None.
            wheels: (w,) angular momentum that each of `wheels` holds by spinning relative to the
                link that carries it, about its axis [N m s]; zeros if None.

        Raises:
            ConfigurationError: q, base or wheels has the wrong shape or is not finite.
        """
        return configure(self, q, base, wheels)

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
        tip: str | Sequence[str] | None = None,
        task: str | Task | None = None,
        locked: Mapping[str, float] | None = None,
        wheels: Collection[str] = (),
    ) -> SpaceArm:
        """A new arm with some things changed.

        Args:
            base_mass: Mass of the spacecraft (with all that is fixed to it) [kg]; its CM stays.
            base_inertia: (3, 3) inertia of the spacecraft about its CM, spacecraft axes [kg m^2].
            mount: Pose of the first joint on the way to the tip, in the spacecraft frame.
            link_mass: Masses of links [kg]; their inertias grow in proportion.
            payload: A point mass held at the tip [kg]; `grasp` takes bodies.
            tip: Link whose frame is the tip, or several.
            task: The twist rows that count. Default: those that were asked for, if any; else they
                are chosen anew, as in `load`.
            locked: Joints to freeze, with their values [rad] or [m].
            wheels: Joints that are wheels, not the arm's.

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
        tree = tree.locked({} if locked is None else locked).with_wheels(wheels)
        tips = self.tips if tip is None else choose_tips(tree, self.path, tip)
        if payload:
            rigid = Inertial.of(payload, np.zeros((3, 3)), body="the payload", prefix="payload_")
            tree = _holding(tree, the_one(tips, self.name), rigid)
        return SpaceArm.of(tree, self.path, tip=tips, task=self._asked if task is None else task)

    def grasp(
        self,
        mass: float,
        inertia: npt.ArrayLike | None = None,
        com: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> SpaceArm:
        """The arm holding a body at its tip, such as a captured satellite.

        The tip stays where it is on the arm; see `capture` for how the body is taken.

        Args:
            mass: Mass of the body [kg].
            inertia: (3, 3) its inertia about its own CM, tip axes [kg m^2]; a point mass if None.
            com: (3,) its CM in the tip frame [m].

        Raises:
            ModelError: No rigid body can have this mass and inertia.
            UnsupportedError: The arm has several tips.
        """
        I = np.zeros((3, 3)) if inertia is None else inertia
        rigid = Inertial.of(mass, I, com, body="the payload")
        tree = _holding(self.tree, self.tip, rigid)
        return SpaceArm.of(tree, self.path, tip=self.tips, task=self._asked)

    def to_urdf(self, path: str | os.PathLike[str]) -> Path:
        """Writes spacecraft and arm as one URDF, which `load` reads to the same numbers.

        Masses, poses and limits are those of this arm, locked joints are fixed ones; visuals and
        collision bodies are the sources', their mesh files by absolute names. <tip> elements,
        which other readers ignore, name the tip. A URDF has no task: one that was asked for is to
        be asked for again. Data that was loaded with faults, as "ets7" is, is read with
        `check="accept"`.

        Returns:
            The path.

        Raises:
            SpaceArmError: The file cannot be written.
        """
        return write(Path(path), document(self.tree, self.tips))

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_spare": []}

    def __repr__(self) -> str:
        return (
            f"SpaceArm({self.name}: {self.n} joints, {self.mass:g} kg, "
            f"tip {', '.join(map(repr, self.tips))}, task {self.task.names!r})"
        )


def _holding(tree: Tree, link: str, rigid: Inertial) -> Tree:
    """The tree with a body fixed to a link, as a link "payload" of its own."""
    name = tree.free_name("payload")
    return tree.joined(body(name, rigid, None, STEEL), name, link, pin.SE3.Identity())


@plain.register
def _(arm: SpaceArm) -> str:
    return arm.name
