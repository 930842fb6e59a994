"""SpaceArm: a spacecraft and its arm, as a Pinocchio model with a free-flyer root."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, plain
from spacearm.description.assembly import holding
from spacearm.description.bodies import Inertial
from spacearm.description.couplings import coupling, joint_limits
from spacearm.description.tips.choice import Tips, choose_tips, movable, only_tip
from spacearm.description.tips.held import Counting, counted, hold, remaining
from spacearm.description.tree import Tree
from spacearm.description.urdf_writer import document
from spacearm.files import write
from spacearm.model.configuration import Configuration, configure
from spacearm.model.coordinates import Coordinates
from spacearm.model.defaults import check_count, check_movable, complete_task
from spacearm.model.facts import facts, facts_shown
from spacearm.model.frames import PoseLike, sound_pose
from spacearm.model.task import Task
from spacearm.model.wheels import Wheel, wheels_of


@dataclass(frozen=True, eq=False, repr=False)
class SpaceArm(Coordinates):
    """A free-floating spacecraft with an arm. It never changes; `replace` gives a new one.

    Attributes:
        name: The robot's name.
        path: The file it was loaded from; a name only for arms that `mount` put together.
        tree: Links, joints and visuals; locked and held joints are fixed ones.
        whole: The same with the held joints movable.
        model: pin.Model with a free-flyer root; do not edit it. Every joint has one number, also
            unlimited ones; joints that mimic another are joints of their own.
        tips: Names of the tip links, usually one.
        tip_reason: Why these are the tips, a phrase.
        tip_frames: Indices of their frames in the model.
        task: The twist rows that count.
        wheels: Momentum wheels, which are not among the joints; see `at`.
        joint_names: Names of the n movable joints, in the model's order.
        joints: Which joints count, as it was asked for: "tip", "all" or names; see `load`.
        held: Values [rad] or [m] of the joints that do not count, by name; they hold those that
            mimic them.
        coupling: (model.nv - 6, n) rates of the model's joints per rate of the n joints; None if
            they are the same joints (no joint mimics another).
        offsets: (model.nv - 6,) positions of the model's joints at q = 0.
        lower: (n,) lower joint limits [rad] or [m], -inf where there is none; see `joint_limits`.
        upper: (n,) upper joint limits [rad] or [m], inf where there is none.
    """

    name: str
    path: Path
    tree: Tree
    whole: Tree
    model: pin.Model
    tips: tuple[str, ...]
    tip_reason: str
    tip_frames: tuple[int, ...]
    task: Task
    wheels: tuple[Wheel, ...]
    joint_names: tuple[str, ...]
    joints: str | tuple[str, ...]
    held: Mapping[str, float]
    coupling: Array | None
    offsets: Array
    lower: Array
    upper: Array
    _asked: str | Task | None
    _spare: list[pin.Data] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        whole: Tree,
        path: Path,
        *,
        tip: str | Sequence[str] | Tips | None = None,
        task: str | Task | None = None,
        joints: Counting = "tip",
    ) -> SpaceArm:
        """Make the arm of a checked tree; arguments as in `loading.load`.

        Raises:
            ConfigurationError: tip, task or joints is not valid.
            ModelError: No joint can move, several links could be the tip, or the arm has no length
                for a mixed task.
            UnsupportedError: More than `defaults.MOST_JOINTS` joints count.
        """
        joints = counted(joints)
        check_movable(whole, path)
        tips, reason = choose_tips(whole, path, tip)
        tree, held = hold(whole, tips, joints)
        check_count(tree, path)
        leading, (C, offsets) = tree.leading(), coupling(tree)
        (lower, upper), model = joint_limits(tree), tree.pinocchio()
        return cls(
            name=tree.name,
            path=path,
            tree=tree,
            whole=whole,
            model=model,
            tips=tips,
            tip_reason=reason,
            tip_frames=tuple(model.getFrameId(tip, pin.BODY) for tip in tips),
            task=complete_task(task, tree, tips, path),
            wheels=wheels_of(tree, model, path),
            joint_names=tuple(joint.name for joint in leading),
            joints=joints,
            held=MappingProxyType(held),
            coupling=None if len(C) == len(leading) else C,
            offsets=offsets,
            lower=lower,
            upper=upper,
            _asked=task,
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed, repaired or left out as the model was read, a sentence each."""
        return self.tree.notes

    @property
    def tip(self) -> str:
        """Name of the tip link.

        Raises:
            UnsupportedError: There are several.
        """
        return only_tip(self.tips, self.name)

    def require_one_tip(self) -> None:
        """Raise an `UnsupportedError` if there are several tips."""
        only_tip(self.tips, self.name)

    @property
    def tip_frame(self) -> int:
        """Index of the tip's frame in the model; raises as `tip` does."""
        return self.tip_frames[self.tips.index(self.tip)]

    @property
    def mount(self) -> pin.SE3:
        """Pose of the first joint on the way to the tip, in the spacecraft frame."""
        name = movable(self.tree, self.tip)[0].name
        return self.model.jointPlacements[self.model.getJointId(name)].copy()

    def at(
        self,
        q: npt.ArrayLike,
        *,
        base: PoseLike | None = None,
        wheels: npt.ArrayLike | None = None,
        momentum: npt.ArrayLike | None = None,
    ) -> Configuration:
        """Return the configuration at joint positions q, inside the joint limits or not.

        Everything that begins somewhere begins with a configuration: queries, simulations, plans.

        Args:
            q: (n,) joint angles [rad] or displacements [m].
            base: Pose of the spacecraft frame in the inertial frame; the identity if None.
            wheels: (w,) angular momentum that each of `wheels` holds by spinning relative to the
                link that carries it, about its axis [N m s]; zeros if None.
            momentum: (6,) total momentum of the system [linear [kg m/s]; angular about the system
                CM [kg m^2/s]], inertial axes, that of the wheels included; zero if None.

        Raises:
            ConfigurationError: q, base, wheels or momentum has the wrong shape or is not finite.

        Warns:
            ModelWarning: Joints are outside their limits or look like degrees; once a line.
        """
        return configure(self, q, base, wheels, momentum)

    def borrow(self) -> pin.Data:
        """Lend a pin.Data of the model; making one costs more than using it."""
        return self._spare.pop() if self._spare else pin.Data(self.model)

    def give_back(self, data: pin.Data) -> None:
        """Take a pin.Data back for the next caller."""
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
        joints: Counting | None = None,
        locked: Mapping[str, float] | None = None,
        wheels: Collection[str] = (),
    ) -> SpaceArm:
        """Return a new arm with some things changed.

        Args:
            base_mass: Mass of the spacecraft (with all that is fixed to it) [kg]; its CM stays.
            base_inertia: (3, 3) inertia of the spacecraft about its CM, spacecraft axes [kg m^2].
            mount: Pose of the first joint on the way to the tip, in the spacecraft frame.
            link_mass: Masses of links [kg]; their inertias grow in proportion.
            payload: A point mass held at the tip [kg]; `grasp` takes bodies.
            tip: Link whose frame is the tip, or several; the joints on the way to it count.
            task: The twist rows. Default: those asked for; if none were, the default of `load`.
            joints: Which joints count besides; see `load`.
            locked: Joints to lock, with their values [rad] or [m]; held ones may be among them.
            wheels: Joints to take as momentum wheels.

        Raises:
            ModelError: No rigid body can have this mass and inertia, or there is no such link.
            ConfigurationError: An argument is of the wrong kind, or names what does not exist.
            UnsupportedError: The arm has several tips, and `mount` or `payload` need one.
        """
        tree = self.whole
        if base_mass is not None or base_inertia is not None:
            tree = tree.with_spacecraft(base_mass, base_inertia)
        if mount is not None:
            tree = tree.with_mount(movable(tree, self.tip)[0], sound_pose(mount, "mount"))
        for link, mass in (link_mass or {}).items():
            tree = tree.with_mass(link, mass)
        tree = tree.locked({} if locked is None else locked).with_wheels(wheels)
        tips = (
            Tips(self.tips, self.tip_reason) if tip is None else choose_tips(tree, self.path, tip)
        )
        if payload:
            rigid = Inertial.of(payload, np.zeros((3, 3)), body="the payload", prefix="payload_")
            tree = holding(tree, only_tip(tips.links, self.name), rigid)
        return SpaceArm.of(
            tree,
            self.path,
            tip=tips,
            task=self._asked if task is None else task,
            joints=remaining(tree, self.joints) if joints is None else joints,
        )

    def grasp(
        self, mass: float, inertia: npt.ArrayLike | None = None, com: npt.ArrayLike = (0, 0, 0)
    ) -> SpaceArm:
        """Return the arm holding a body at its tip, such as a captured satellite.

        The tip frame stays where it is on the arm. `capture` computes the impact of the grasp.

        Args:
            mass: Mass of the body [kg].
            inertia: (3, 3) its inertia about its own CM, tip axes [kg m^2]; a point mass if None.
            com: (3,) its CM in the tip frame [m].

        Raises:
            ModelError: No rigid body can have this mass and inertia.
            UnsupportedError: The arm has several tips.
        """
        I = np.zeros((3, 3)) if inertia is None else inertia
        tree = holding(self.whole, self.tip, Inertial.of(mass, I, com, body="the payload"))
        return self.on(tree)

    def on(self, tree: Tree) -> SpaceArm:
        """Return the arm with the same tips, task and joints on another tree of bodies."""
        tips = Tips(self.tips, self.tip_reason)
        return SpaceArm.of(tree, self.path, tip=tips, task=self._asked, joints=self.joints)

    def to_urdf(self, path: str | os.PathLike[str]) -> Path:
        """Write spacecraft and arm as one URDF, which `load` reads to the same numbers.

        Locked joints become fixed ones, held ones stay joints. Meshes have absolute paths,
        materials a colour only. <tip> elements, which other readers ignore, name the tips. A URDF
        holds neither `task` nor `joints`: name them again.
        Data with faults, such as that of "ets7", loads with `check="accept"`.

        Args:
            path: The file to write.

        Returns:
            The path.

        Raises:
            SpaceArmError: The file cannot be written.
        """
        return write(Path(path), document(self.whole, self.tips))

    def to_dict(self) -> dict[str, Any]:
        """Return bodies, joints, limits, tip, task, held joints, wheels and notes as plain data."""
        return facts(self)

    _repr_html_ = facts_shown

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_spare": [], "held": dict(self.held)}

    def __repr__(self) -> str:
        held = f", held {', '.join(self.held)}" if self.held else ""
        return (
            f"SpaceArm({self.name}: {self.n} joints, {self.mass:g} kg, "
            f"tip {', '.join(map(repr, self.tips))}, task {self.task.names!r}{held})"
        )


plain.register(SpaceArm, lambda arm: arm.name)
