"""SpaceArm: a spacecraft and its arm, as a Pinocchio model; its configurations, computed once."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, Frozen, ReadOnlyMapping, finite, plain, read_only
from spacearm.description.bodies import Inertial, Joint
from spacearm.description.grippers import held_fingers
from spacearm.description.loops import open_loops, warn_of_lost_loops, with_ball_joints
from spacearm.description.model_catalogue import holding
from spacearm.description.tips import Counting, Tips, choose_tips, hold, only_tip, remaining
from spacearm.description.tree import Tree, Wheels, coupling, joint_limits
from spacearm.description.urdf_writer import document
from spacearm.errors import ModelError, UnsupportedError, called_from_outside, listed, warn
from spacearm.files import write
from spacearm.model.frames import LWA, PoseLike, sound_pose
from spacearm.model.joints import (
    JointLimits,
    JointSpace,
    by_joint,
    joint_vector,
    outside_limits,
    warn_outside,
)
from spacearm.model.task import MovableRows, Task, usual_task, with_length
from spacearm.model.wheels import Wheel, wheel_table, wheels_of
from spacearm.results import Cell, Column, Described, Description, Measure, Table, joint_measures
from spacearm.signatures import checked

if TYPE_CHECKING:
    from typing_extensions import Unpack

#: Largest number of movable joints that count.
MOST_JOINTS = 200
#: Momentum of a system at rest, and of wheels that do not spin.
AT_REST = read_only(np.zeros(6))
#: What the six numbers of a momentum are, for messages.
MOMENTUM = "[linear [kg m/s]; angular about the system CM [kg m^2/s]]"


@checked
@dataclass(frozen=True, eq=False, repr=False)
class SpaceArm(Frozen, JointSpace, Described):
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
        movable: Which rows of the tips' twists the joints can move at all.
        wheels: Momentum wheels, which are not among the joints; see `at`.
        joint_names: Names of the n movable joints, in the model's order.
        joints: Which joints count, as asked for: "tip", "all" or names; see `load`.
        held: Values [rad] or [m] of the joints that do not count, by name; joints that mimic them
            are held too.
        coupling: (model.nv - 6, n) rates of the model's joints per rate of the n joints; None if
            they are the same joints (no joint mimics another).
        offsets: (model.nv - 6,) positions of the model's joints at q = 0.
        lower: (n,) lower joint limits [rad] or [m], -inf where there is none; see `joint_limits`.
        upper: (n,) upper joint limits [rad] or [m], inf where there is none.
    """

    path: Path
    whole: Tree
    tip_reason: str
    tip_frames: tuple[int, ...]
    movable: MovableRows
    wheels: tuple[Wheel, ...]
    joints: Counting
    held: Mapping[str, float]
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
            UnsupportedError: More than `MOST_JOINTS` joints count.
        """
        if not whole.freedoms:
            raise ModelError(f"{path}: no joint can move; an arm needs at least one free joint")
        whole = with_ball_joints(whole, path) if tip is None else whole
        tips, reason = choose_tips(whole, path, tip)
        tree, held = hold(whole, tips, joints)
        if tree.freedoms > MOST_JOINTS:
            raise UnsupportedError(
                f"{path}: {tree.freedoms} movable joints, and Pinocchio's memory grows with their "
                f"cube; lock all but {MOST_JOINTS}"
            )
        leading, (C, offsets) = tree.leading(), coupling(tree)
        (lower, upper), model = joint_limits(tree), tree.pinocchio()
        movable, asked = MovableRows(tree, tips, model), task
        if task is None:
            task = movable.default(usual_task(tree, tips))
        elif not isinstance(task, Task):
            task = Task(task)
        return cls(
            name=tree.name,
            path=path,
            tree=tree,
            whole=whole,
            model=model,
            tips=tips,
            tip_reason=reason,
            tip_frames=tuple(model.getFrameId(tip, pin.BODY) for tip in tips),
            movable=movable,
            task=with_length(task, tree, tips, path),
            wheels=wheels_of(tree, model, path),
            joint_names=tuple(joint.name for joint in leading),
            joints=joints if isinstance(joints, str) else tuple(map(str, joints)),
            held=ReadOnlyMapping(held),
            coupling=None if len(C) == len(leading) else C,
            offsets=offsets,
            lower=lower,
            upper=upper,
            _asked=asked,
        )

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What was assumed, repaired or left out as the model was read, a sentence each."""
        held = held_fingers(self.whole, self.tips, self.held)
        doubts = (self.fault_of_task(), open_loops(self.whole, self.tips))
        return (*self.tree.notes, *held, *filter(None, doubts))

    def fault_of_task(self, free: int = 6) -> str:
        """Say why the task is impossible at every posture, and which would do; "" if it is not.

        Args:
            free: Number of free components of the spacecraft's twist; see `free_components`.
        """
        return self.movable.fault(self.task, usual_task(self.tree, self.tips), free)

    def warned(self) -> SpaceArm:
        """Return the arm, with a warning if its task is impossible or a loop is open."""
        for doubt in filter(None, (self.fault_of_task(), open_loops(self.whole, self.tips))):
            warn(f"{self.path}: {doubt}")
        return self

    @property
    def bodies(self) -> dict[str, pin.Inertia]:
        """The rigid bodies, the spacecraft first, by the names of their links that have mass.

        A body without mass has the name of its first link.
        """
        lumps, links = self.tree.lumps.values(), self.tree.links
        names = (" + ".join(link for link in lump if links[link]) or lump[0] for lump in lumps)
        return dict(zip(names, list(self.model.inertias)[1:], strict=True))

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
    def home(self) -> Array:
        """(n,) home positions of the joints within their limits: zeros unless the file says so."""
        home = [self.tree.joints[name].home for name in self.joint_names]
        return np.clip(home, self.lower, self.upper)

    @property
    def mount(self) -> pin.SE3:
        """Pose of the first joint on the way to the tip, in the spacecraft frame."""
        return self._mount(self.tip)

    def _mount(self, tip: str) -> pin.SE3:
        name = self.tree.movable(tip)[0].name
        return self.model.jointPlacements[self.model.getJointId(name)].copy()

    def at(
        self,
        q: ArrayLike,
        *,
        base: PoseLike | None = None,
        wheels: ArrayLike | None = None,
        momentum: ArrayLike | None = None,
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
        base = pin.SE3.Identity() if base is None else sound_pose(base, "base")
        cfg = kinematics(self, joint_vector(self, q, "q"), base)
        if called_from_outside():
            warn_outside(self, cfg.q)
        if momentum is not None:
            cfg = cfg.with_momentum(momentum)
        return cfg if wheels is None else cfg.with_wheels(wheels)

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
        base_inertia: ArrayLike | None = None,
        mount: pin.SE3 | None = None,
        link_mass: Mapping[str, float] | None = None,
        link_length: Mapping[str, float] | None = None,
        payload: float | None = None,
        tip: str | Sequence[str] | None = None,
        task: str | Task | None = None,
        joints: Counting | None = None,
        locked: Mapping[str, float] | None = None,
        wheels: Wheels = (),
        **limits: Unpack[JointLimits],
    ) -> SpaceArm:
        """Return a new arm with some things changed.

        Args:
            base_mass: Mass of the spacecraft with all that is fixed to it [kg]; its CM stays where
                it is.
            base_inertia: (3, 3) inertia of the spacecraft about its CM, spacecraft axes [kg m^2];
                if None it grows in proportion to the mass, as that of a body of the same shape.
            mount: Pose of the first joint on the way to the tip, in the spacecraft frame.
            link_mass: Masses of links [kg]; their inertias grow in proportion.
            link_length: Lengths of links from their joint to the next, or to the tip [m]. The link
                and all that is fixed to it keep mass and shape: a length times k, an inertia k^2.
            payload: A point mass held at the tip [kg]; `grasp` takes bodies.
            tip: Link whose frame is the tip, or several; the joints between spacecraft and tip
                count.
            task: The twist rows. Default: those asked for; if none were, the default of `load`.
            joints: Which joints count besides; see `load`.
            locked: Joints to lock, with their values [rad] or [m]; held ones may be among them.
            wheels: Joints to take as momentum wheels; see `load`.
            lower: (n,) lower limits of the joints of the new arm [rad] or [m], -inf where there is
                none; or those of some joints by name, the others keep theirs. Limits of joints that
                mimic another still count. A home position outside moves to the nearest limit.
            upper: (n,) upper limits, inf where there is none; or those of some joints by name.

        Raises:
            ModelError: No rigid body can have this mass and inertia, there is no such link, or a
                joint has no position within its limits and those of joints that mimic it.
            ConfigurationError: An argument is of the wrong kind, or names what does not exist; or
                an upper limit is below the lower one.
            UnsupportedError: The arm has several tips, and `mount` or `payload` need one.
        """
        tree = self.whole
        if base_mass is not None or base_inertia is not None:
            tree = tree.with_spacecraft(base_mass, base_inertia)
        if mount is not None:
            tree = tree.with_mount(tree.movable(self.tip)[0], sound_pose(mount, "mount"))
        for link, mass in (link_mass or {}).items():
            tree = tree.with_mass(link, mass)
        for link, length in (link_length or {}).items():
            tree = tree.with_length(link, length, self.tips)
        tree = tree.locked({} if locked is None else locked).with_wheels(wheels)
        kept = Tips(self.tips, self.tip_reason)
        tips = kept if tip is None else choose_tips(tree, self.path, tip)
        if payload:
            rigid = Inertial.of(payload, np.zeros((3, 3)), body="the payload", prefix="payload_")
            tree = holding(tree, only_tip(tips.links, self.name), rigid)
        changed = SpaceArm.of(
            tree,
            self.path,
            tip=tips,
            task=self._asked if task is None else task,
            joints=remaining(tree, self.joints) if joints is None else joints,
        )
        if ends := {side: by_joint(changed, given, side) for side, given in limits.items()}:
            changed = changed.on(changed.whole.with_limits(**ends))
        return changed if self.fault_of_task() == changed.fault_of_task() else changed.warned()

    def grasp(
        self, mass: float, inertia: ArrayLike | None = None, com: ArrayLike = (0, 0, 0)
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

    def with_home(self, positions: Mapping[str, float]) -> SpaceArm:
        """Return the arm with other home positions of some joints.

        Joints that do not count are held there, the viewer begins there, `to_urdf` writes them.

        Args:
            positions: Positions [rad] or [m] by joint.

        Raises:
            ConfigurationError: A joint does not exist, or a position is beyond its limits.
        """
        return self.on(self.whole.with_home(positions))

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

        Warns:
            ModelWarning: Loops of a closed chain are not written.
        """
        warn_of_lost_loops(self.whole, path)
        return write(Path(path), document(self.whole, self.tips))

    def to_dict(self) -> dict[str, Any]:
        """Return bodies, joints, limits, tip, task, held joints, wheels and notes as plain data."""
        return {
            "name": self.name,
            "path": str(self.path),
            "n": self.n,
            "mass": self.mass,
            "tip_link": plain(self.tips if len(self.tips) > 1 else self.tip),
            "tip_reason": self.tip_reason,
            "task": plain(self.task),
            "cm_at_zero": plain(self.at(np.zeros(self.n)).com),
            "bodies": [
                {"link": link, "mass": x.mass, "cm": plain(x.lever), "inertia": plain(x.inertia)}
                for link, x in self.bodies.items()
            ],
            "joint_data": [plain(joint) for joint in self.tree.depth_first() if joint.movable],
            "held": dict(self.held),
            "wheel_data": plain(self.wheels),
            "notes": list(self.notes),
        }

    def describe(self) -> Description:
        """Describe tip, task, bodies, joints with limits, what is held and what was assumed."""
        task, several = self.task.names, len(self.tips) > 1
        if self.task.mixed:
            task += f", linear rows divided by {self.task.length:.6g} m"
        facts: dict[str, Cell] = {
            "file": str(self.path),
            "tips" if several else "tip": f"{', '.join(self.tips)} ({self.tip_reason}); "
            "another one: tip=LINK",
            "task": task,
            **{
                f"first joint{f' to {tip}' * several}, spacecraft frame": Measure(
                    self._mount(tip).translation, "m"
                )
                for tip in self.tips
            },
            "system CM at q = 0, spacecraft frame": Measure(self.at(np.zeros(self.n)).com, "m"),
        }
        lumps = [
            (name, body.mass, body.lever, np.linalg.eigvalsh(body.inertia), self._length(link))
            for link, (name, body) in zip(self.tree.lumps, self.bodies.items(), strict=True)
        ]
        columns = ("body", Column("mass", "kg", ".6g"), Column("CM in its frame", "m"),
                   Column("principal moments", "kg m²"), Column("length", "m", ".6g"))  # fmt: skip
        tables = [
            Table.facts(facts),
            Table(columns, lumps, "Bodies"),
            _joint_table([joint for joint in self.tree.depth_first() if joint.movable]),
        ]
        if self.wheels:
            tables.append(wheel_table(self.model, self.wheels))
        held = [(name, self.whole.joints[name].kind, at) for name, at in self.held.items()]
        locked = [(j.name, *j.locked) for j in self.whole.joints.values() if j.locked]
        for title, still in (
            ('Held joints (to make them count: joints="all", or their names; to make them '
             "reaction wheels: wheels=[...])", held), ("Locked joints", locked),
        ):  # fmt: skip
            names, kinds, values = zip(*still, strict=True) if still else ((), (), ())
            at = joint_measures(values, [kind == "prismatic" for kind in kinds])
            moved = [self.whole.joints[name].child for name in names]
            rows = list(zip(names, kinds, moved, at, strict=True))
            tables += [Table(("joint", "type", "moves", "at"), rows, title)] * bool(rows)
        return Description(
            title=self.name,
            verdict=f"{self.n} joint{'s' * (self.n > 1)}, {self.mass:.6g} kg",
            notes=[f"note: {note}" for note in self.notes],
            tables=tables,
        )

    def _length(self, link: str) -> float | None:
        """Return the length of a link [m], from its joint to the next; None where there is none."""
        try:
            return self.tree.length(link, self.tips)
        except ModelError:
            return None

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_spare": []}

    def __repr__(self) -> str:
        name, tips = self.label, listed(list(map(repr, self.tips)))
        held = f", held {listed(self.held)}" if self.held else ""
        return (
            f"SpaceArm({name}: {self.n} joint{'s' * (self.n > 1)}, {self.mass:g} kg, tip {tips}, "
            f"task {self.task.names!r}{held})"
        )


plain.register(SpaceArm, lambda arm: arm.name)


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Configuration(Frozen):
    """A posture q and a spacecraft pose, with the two matrices that everything follows from.

    Made by `SpaceArm.at`, with its kinematics computed. It never changes: arrays are read-only,
    `base` and `tip` are copies.

    The base columns of `A` and `J` act on the spacecraft's twist in spacecraft axes, Pinocchio's
    convention; products such as J_b A_b^-1 do not depend on it. `momentum_matrix` gives them for
    inertial axes.

    Attributes:
        arm: The arm.
        q: (n,) joint angles [rad] or displacements [m].
        wheels: (w,) angular momentum that each wheel of the arm holds about its axis [N m s].
        stored: (6,) momentum that all wheels hold, [linear (zero); angular], inertial axes; the
            total momentum is A_b v_b + A_q dq + stored.
        momentum: (6,) total momentum of the system, which is constant while nothing acts from
            outside: [linear; angular about the system CM], inertial axes, that of the wheels
            included [kg m/s], [kg m^2/s].
        com: (3,) system centre of mass in the inertial frame [m].
        A: (6, 6 + n) centroidal momentum matrix [A_b A_q], rows [linear; angular about the
            system CM], inertial axes.
        J: (6, 6 + n) Jacobian [J_b J_q] of the tip, rows [linear; angular], inertial axes; for
            several tips (6 tips, 6 + n), stacked.
    """

    arm: SpaceArm
    q: Array
    wheels: Array
    stored: Array
    momentum: Array
    com: Array
    A: Array
    J: Array
    _base: pin.SE3
    _tips: tuple[pin.SE3, ...]

    @property
    def base(self) -> pin.SE3:
        """Pose of the spacecraft frame in the inertial frame."""
        return self._base.copy()

    @property
    def tip(self) -> pin.SE3:
        """Pose of the tip frame in the inertial frame.

        Raises:
            UnsupportedError: The arm has several tips; see `tips`.
        """
        self.arm.require_one_tip()
        return self._tips[0].copy()

    @property
    def tips(self) -> tuple[pin.SE3, ...]:
        """Poses of the frames of all tips in the inertial frame."""
        return tuple(tip.copy() for tip in self._tips)

    @property
    def outside_limits(self) -> tuple[str, ...]:
        """Names of the joints that are outside their limits."""
        return outside_limits(self.arm, self.q)

    @property
    def full(self) -> Array:
        """(nq,) configuration of the Pinocchio model: [x y z, qx qy qz qw, joints]."""
        return np.concatenate((pin.SE3ToXYZQUAT(self._base), self.arm.all_joints(self.q)))

    @property
    def full_at_origin(self) -> Array:
        """(nq,) the same with the spacecraft at the origin, where orbits cost no digits."""
        full = self.full
        full[:3] = 0.0
        return full

    def with_momentum(self, momentum: ArrayLike) -> Configuration:
        """Return the same posture, pose and wheels with another total momentum (6,).

        Raises:
            ConfigurationError: It has the wrong shape or is not finite.
        """
        return replace(self, momentum=read_only(finite(momentum, (6,), "momentum", MOMENTUM)))

    def with_wheels(self, wheels: ArrayLike) -> Configuration:
        """Return the same posture, pose and total momentum with other momenta (w,) of the wheels.

        Raises:
            ConfigurationError: They have the wrong shape or are not finite.
        """
        arm, stored = self.arm, np.zeros(6)
        names = listed([wheel.name for wheel in arm.wheels]) or "no wheel"
        h = finite(wheels, (len(arm.wheels),), "wheels", f"[N m s], one for each of: {names}")
        data = arm.borrow()
        pin.framesForwardKinematics(arm.model, data, self.full_at_origin)
        for wheel, spin in zip(arm.wheels, h, strict=True):
            stored[3:] += data.oMf[wheel.frame].rotation @ wheel.axis * spin
        arm.give_back(data)
        return replace(self, wheels=read_only(h), stored=read_only(stored))

    def centred(self, com: ArrayLike) -> Configuration:
        """Return the same posture and attitude with the system CM at `com` (3,) [m].

        Raises:
            ConfigurationError: It has the wrong shape or is not finite.
        """
        by = finite(com, (3,), "com", "[m]") - self.com
        base, *tips = (pin.SE3(pose) for pose in (self._base, *self._tips))
        for pose in (base, *tips):
            pose.translation += by
        return replace(self, com=self.com + by, _base=base, _tips=tuple(tips))

    def to_dict(self) -> dict[str, Any]:
        """Return the configuration as plain data; poses are x y z [m] and a quaternion xyzw.

        With several tips, `tip` has the poses of all.
        """
        tips = [pin.SE3ToXYZQUAT(tip).tolist() for tip in self._tips]
        return {
            "arm": self.arm.name,
            "joints": list(self.arm.joint_names),
            "q": self.q.tolist(),
            "base": pin.SE3ToXYZQUAT(self._base).tolist(),
            "tip": tips[0] if len(tips) == 1 else tips,
            "com": self.com.tolist(),
            "wheels": self.wheels.tolist(),
            "momentum": self.momentum.tolist(),
            "outside_limits": list(self.outside_limits),
        }

    def __repr__(self) -> str:
        base = np.array2string(pin.SE3ToXYZQUAT(self.base), precision=6, separator=", ")
        q = np.array2string(self.q, precision=6, separator=", ")
        return f"Configuration({self.arm.label}, q={q}, base(xyz, xyzw)={base})"


def still_wheels(cfg: Configuration, what: str) -> None:
    """Refuse wheels that hold momentum.

    Args:
        cfg: The configuration.
        what: Why they are refused, for the message.

    Raises:
        UnsupportedError: A wheel holds momentum.
    """
    if cfg.wheels.any():
        raise UnsupportedError(f"the wheels of {cfg.arm.name} hold momentum, and {what}")


def kinematics(arm: SpaceArm, q: Array, base: pin.SE3, com: Array | None = None) -> Configuration:
    """Compute the configuration at q and base, which are not checked and not copied.

    Args:
        arm: The arm.
        q: (n,) joint positions [rad] or [m].
        base: Pose of the spacecraft frame in the inertial frame.
        com: (3,) where the system CM is, to which the base is moved; None if it stays.
    """
    model = arm.model
    full = np.zeros(model.nq)  # at the origin: far from it, as in orbit, digits would be lost
    full[3:7] = pin.SE3ToXYZQUAT(base)[3:]
    full[7:] = arm.all_joints(q)

    data = arm.borrow()
    A = arm.project(pin.computeCentroidalMap(model, data, full))
    frames = [pin.computeFrameJacobian(model, data, full, frame, LWA) for frame in arm.tip_frames]
    J = arm.project(frames[0] if len(frames) == 1 else np.vstack(frames))
    if com is not None:
        base.translation = com - data.com[0]
    com = data.com[0] + base.translation
    tips = [pin.updateFramePlacement(model, data, frame).copy() for frame in arm.tip_frames]
    for tip in tips:
        tip.translation += base.translation
    arm.give_back(data)

    wheels = np.zeros(len(arm.wheels))
    for array in (q, wheels, com, A, J):
        array.flags.writeable = False
    return Configuration(arm, q, wheels, AT_REST, AT_REST, com, A, J, base, tuple(tips))


def _joint_table(joints: Sequence[Joint]) -> Table:
    """Return the table of joints that can move."""
    slides = [joint.kind == "prismatic" for joint in joints]

    def column(name: str, per: str = "") -> list[Cell]:
        return joint_measures([getattr(joint, name) for joint in joints], slides, per)

    efforts = ["none" if j.effort == np.inf else Measure(j.effort, j.effort_unit) for j in joints]
    columns: dict[str, Sequence[Cell]] = {
        "joint": [joint.name for joint in joints],
        "lower": column("lower"),
        "upper": column("upper"),
        "rate": column("velocity", "/s"),
        "effort": efforts,
        "type": [joint.kind for joint in joints],
        "moves": [joint.child for joint in joints],
        "follows": [joint.mimic.leader if joint.mimic else "" for joint in joints],
    }
    return Table.by_columns(columns, "Joints")
