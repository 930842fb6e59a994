"""Loading: a spacecraft with its arm from a file or the catalogue, or an arm on a bus."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pinocchio as pin

from spacearm.description.bus import Bus
from spacearm.description.loops import holding_each_other
from spacearm.description.model_catalogue import assembled, bolted, find_model
from spacearm.description.readers import formats
from spacearm.description.readers.formats import RobotSource
from spacearm.description.readers.source import Check, Folders, Reading
from spacearm.description.tips import Counting
from spacearm.description.tree import Tree, Wheels
from spacearm.model.arm import SpaceArm
from spacearm.model.frames import PoseLike, sound_pose
from spacearm.model.task import Task
from spacearm.signatures import checked


@checked
def load(
    source: RobotSource,
    *,
    tip: str | Sequence[str] | Mapping[str, str] | None = None,
    task: str | Task | None = None,
    joints: Counting = "tip",
    locked: Mapping[str, float] | None = None,
    check: Check | None = None,
    wheels: Wheels = (),
    packages: Folders = (),
    xacro_args: Mapping[str, object] | None = None,
    density: float | None = None,
    up_axes: bool = False,
) -> SpaceArm:
    """Load a spacecraft with its arm.

    The spacecraft is the root link with all links that fixed joints hold to it. A massless root
    fixed to the actual bus is fine; a massless root in which the bus floats is left out, whether by
    a floating joint or by massless slides and hinges. Movable leaves without mass are held. The n
    joints are those between the spacecraft and the tip. Fingers, solar panels and other arms are
    held at the home of their joint, or at the limit nearest to it (see `SpaceArm.held`). The home
    is the <home value="..."/> of a URDF, the keyframe "home" of an MJCF, or the group state "home"
    of an SRDF beside the file, else zero. Joints that mimic another are not among the n joints;
    their limits count as limits of the joint that they follow.

    Args:
        source: A name of the catalogue (see `catalogue`); the path of a URDF, .xacro, MJCF (.xml)
            or SDF; or a pin.Model or RobotWrapper, fixed base or free-flyer.
        tip: Link whose frame is the tip, or several, whose task rows are then stacked. A mapping of
            links to links states which hold each other, frame on frame: a closed chain, which
            `hold` closes. Default, the first of these that exists: the links by which an MJCF or
            SDF closes a chain; those that the URDF names by <tip link>; what an SRDF beside the
            file names; the frame with a name for tips (tool0, hand_tcp, ee_link, ...); the hand;
            the last link before the fingers branch. Of several arms the one with the most joints
            counts. `SpaceArm.tip_reason` says which it was.
        task: The twist rows that count, as "x y rz", "pose", "position", "orientation" or a `Task`.
            Default: for planar arms the rows of the plane ("x y", from 3 joints on with the
            rotation); otherwise "pose" from 6 joints on, else "position". If these are impossible
            together, those that the joints move.
        joints: Which joints count besides those between spacecraft and tips: "tip" for no others,
            "all", or the names of some.
        locked: Joints to lock, with their values [rad] or [m].
        check: What to do with inertias that no rigid body can have, and with joints that move no
            mass: "error", "warn" or "accept". Default: that of the catalogue for its models,
            "error" for files.
        wheels: Joints of reaction wheels and other bodies that hold momentum, which are not among
            the n joints; `SpaceArm.at` takes their momentum. Joints with a <wheel> element are
            wheels anyway. Their limits are those of the joints, or as given: {name: (largest
            torque [N m], largest momentum [N m s])}.
        packages: Folders that hold ROS packages, or are packages, for `package://` and `$(find)`.
            They are searched before ROS_PACKAGE_PATH, AMENT_PREFIX_PATH and the folders around the
            file.
        xacro_args: Values of the arguments of a xacro source, by name.
        density: Density [kg/m^3] of the links without inertial data, which then get one from their
            collision shapes, else from those that are drawn.
        up_axes: Whether meshes are turned so that the up axis that their COLLADA file states is z,
            for masses, collisions and drawings alike. RViz and Gazebo do not turn them.

    Returns:
        The arm; what was assumed stands in its `notes`.

    Raises:
        ModelError: The model is unknown, cannot be read or has a fault; several links could be the
            tip.
        ConfigurationError: tip, task, joints, locked or wheels names something that does not exist.

    Warns:
        ModelWarning: Something was assumed or left out; `SpaceArm.notes` keeps it.

    Example:
        >>> import spacearm as sa
        >>> sa.load("mda6", locked={"joint_6": 0.0}, task="position")
        SpaceArm(mda6: 5 joints, 807.26 kg, tip 'tip', task 'position')
    """
    info = find_model(source)
    path = info.path if info else formats.path_of(source)
    check = check or (info.check if info else None)
    reading = Reading.of(check, packages, xacro_args, density, up_axes)
    pairs = tip if isinstance(tip, Mapping) else {}
    tip = None if isinstance(tip, Mapping) else tip
    if info:
        tree = assembled(info, reading).locked(locked or {})
    else:
        tips = (tip,) if isinstance(tip, str) else tuple(tip or ())
        tree = formats.read(source, replace(reading, locked=locked or {}, tips=tips))
    tree = holding_each_other(tree, pairs).with_wheels(wheels)
    return SpaceArm.of(tree, path, tip=tip, task=task, joints=joints).warned()


@checked
def mount(
    arm: RobotSource,
    bus: Bus | SpaceArm | RobotSource,
    at: PoseLike | None = None,
    *,
    name: str | None = None,
    tip: str | None = None,
    task: str | Task | None = None,
    locked: Mapping[str, float] | None = None,
    check: Check | None = None,
    packages: Folders = (),
    xacro_args: Mapping[str, object] | None = None,
    density: float | None = None,
    up_axes: bool = False,
) -> SpaceArm:
    """Bolt an arm to a spacecraft; call it again for a second and a third arm.

    Joints and moving links keep their names from the arm's file. The fixed base becomes part of
    the spacecraft, and its names get the arm's name and "_" as a prefix. All names get this prefix
    if `name` is given, or if the bus has one of them already, as with a second arm of the same
    kind. The tip "hand" of an arm mounted as "left" is then "left_hand". A frame named as the arm
    itself, "left", is at the same place.

    The tip of the result is that of the arm mounted last. Its joints count, while fingers and other
    arms are held; `SpaceArm.replace` chooses the other one, or both: `tip=("left", "right")`, or
    more joints: `joints="all"`. Otherwise the order in which arms with given names are mounted
    makes no difference.

    Args:
        arm: An arm without a spacecraft: a name that `arms` lists, or what `load` takes.
        bus: A `Bus`, a spacecraft that has arms already, or what `load` takes, whose solar panels
            and wheels are kept.
        at: Pose of the arm's root link in the frame of the bus, a pin.SE3 or a (4, 4) matrix. If
            None, the middle of the top face (+z) of a `Bus` with a size, else the identity.
        name: Name of the arm, the prefix of all its links and joints. Default: the robot's name,
            numbered from the second arm on.
        tip: Link of the arm that is its tip, as in `load`.
        task: The twist rows that count; see `load`.
        locked: Joints of the arm to lock, with their values [rad] or [m].
        check: What to do with inertias that no rigid body can have; see `load`.
        packages: Folders with ROS packages; see `load`.
        xacro_args: Arguments of the xacro source of the arm; see `load`.
        density: Density of links without inertial data [kg/m^3]; see `load`.
        up_axes: Whether meshes of the arm and the bus are turned by their up axes; see `load`.

    Returns:
        The spacecraft with its arms.

    Raises:
        ModelError: An arm is unknown, a URDF has a fault, or the name is taken.
        ConfigurationError: bus, at, tip or locked is not valid.

    Example:
        >>> import spacearm as sa
        >>> sa.mount("vispa", sa.Bus(mass=200, size=(1, 1, 1)))
        SpaceArm(bus_vispa: 6 joints, 216.054 kg, tip 'tip', task 'pose')
    """
    top = bus.top if isinstance(bus, Bus) else pin.SE3.Identity()
    at = top if at is None else sound_pose(at, "at")
    reading = Reading.of(check, packages, xacro_args, density, up_axes)
    base = _tree(bus, replace(reading, xacro_args={}, rigid=True))
    tree = bolted(base, arm, at, name=name, tip=tip, locked=locked, reading=reading)
    return SpaceArm.of(tree, Path(f"{tree.name}.urdf"), task=task).warned()


def _tree(bus: Bus | SpaceArm | RobotSource, reading: Reading) -> Tree:
    """Return the tree of what an arm is bolted to."""
    if isinstance(bus, Bus | SpaceArm):
        return bus.tree() if isinstance(bus, Bus) else bus.whole
    info = find_model(bus)
    return assembled(info) if info else formats.read(bus, reading)
