"""Formats: robot files of every format that is known, and models of Pinocchio, as one tree."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from lxml import etree

from spacearm.arrays import LARGEST, LEAST_LENGTH
from spacearm.description.readers import mjcf, pinocchio_model, sdf, urdf
from spacearm.description.readers.forest import check_mimics, warn_of_balls, with_floating_base
from spacearm.description.readers.masses import checked
from spacearm.description.readers.pinocchio_model import PINOCCHIO_MODELS, PinocchioModel
from spacearm.description.readers.source import Reading, Source, in_xacro
from spacearm.description.shapes import Shape
from spacearm.description.srdf import with_home
from spacearm.description.tree import Tree
from spacearm.errors import ModelError, listed

#: What describes a robot: the path of a file, or a model of Pinocchio.
RobotSource: TypeAlias = str | os.PathLike[str] | PinocchioModel
#: How far rounding may move a colour out of the range from 0 to 1.
COLOUR_ROUNDING = 1e-6


def read(robot: RobotSource, reading: Reading | None = None) -> Tree:
    """Read and check a robot: a file by its suffix and root element, or a model of Pinocchio.

    Args:
        robot: The path of a URDF, xacro, MJCF or SDF, or a pin.Model or RobotWrapper.
        reading: How it is read.

    Returns:
        The tree; its notes say what was assumed and what was left out.

    Raises:
        ModelError: The file has a fault; the message names file, element, value and remedy.

    Warns:
        ModelWarning: Something was assumed; each warning is a note too.
    """
    source = Source(path_of(robot), reading)
    if isinstance(robot, PINOCCHIO_MODELS):
        tree = pinocchio_model.read(source, robot)
    else:
        tree = _read(source, source.root())
    _require_places(source, tree)
    tree = _without_tiny_lengths(source, tree)
    tree = _with_colours(source, tree)
    check_mimics(source, joints := dict(tree.joints))
    tree = replace(tree, joints=joints).locked(source.reading.locked)
    tree = with_floating_base(source, tree)
    warn_of_balls(source, tree)
    tree = checked(source, tree)
    if not source.reading.known:
        tree = with_home(tree, source.path)
    return replace(tree, notes=tuple(source.notes))


def _read(source: Source, root: etree._Element) -> Tree:
    """Read a file by its root element; a xacro source is expanded before."""
    if source_of_xacro := in_xacro(source.path, root):
        from spacearm.description.readers.xacro import expanded  # slow to import

        root = expanded(source, root)
    if root.tag == "robot":
        return urdf.read(source, root)
    if root.tag == "sdf":
        return sdf.read(source, root)
    if root.tag == "mujoco":
        if source_of_xacro:
            source.fail("is an MJCF in xacro", "expand it first: xacro FILE > robot.xml")
        return mjcf.read(source, root)
    if root.tag == "mujocoinclude":
        source.fail("is a part of an MJCF", "load the file that includes it")
    source.fail(
        f"is not a robot file of a known format: its root element is <{root.tag!s}>",
        "a URDF starts with <robot>, an SDF with <sdf>, an MJCF with <mujoco>",
    )


def _require_places(source: Source, tree: Tree) -> None:
    """Refuse joints whose place or axis is not finite, or farther than `LARGEST`.

    Readers check the numbers that they read; MuJoCo and Pinocchio compute with theirs first.
    """
    for name, joint in tree.joints.items():
        numbers = np.append(joint.origin.homogeneous, joint.axis)
        if not (np.isfinite(numbers).all() and np.abs(numbers).max() <= LARGEST):
            at, axis = (
                " ".join(f"{x:g}" for x in vector)
                for vector in (joint.origin.translation, joint.axis)
            )
            source.fail(
                f"joint {name!r} is at {at} m, with the axis {axis}",
                f"give finite numbers, and lengths up to {LARGEST:g} m",
            )


def _without_tiny_lengths(source: Source, tree: Tree) -> Tree:
    """Return the tree with lengths below `LEAST_LENGTH` taken as zero, and warn of them."""
    found: list[str] = []

    def plain(pose: pin.SE3, owner: str) -> pin.SE3:
        lengths = pose.translation
        tiny = (lengths != 0.0) & (np.abs(lengths) < LEAST_LENGTH)
        if not tiny.any():
            return pose
        found.append(f"{np.abs(lengths[tiny]).min():g} m of {owner}")
        return pin.SE3(pose.rotation, np.where(tiny, 0.0, lengths))

    joints = {
        name: replace(joint, origin=plain(joint.origin, f"joint {name!r}"))
        for name, joint in tree.joints.items()
    }
    links = {
        name: part and part._replace(origin=plain(part.origin, f"link {name!r}"))
        for name, part in tree.links.items()
    }
    if not found:
        return tree
    source.warn(f"lengths below {LEAST_LENGTH:g} m are taken as 0: {listed(found)}")
    return replace(tree, joints=joints, links=links)


def _with_colours(source: Source, tree: Tree) -> Tree:
    """Return the tree with colours from 0 to 1, and warn of others.

    Whole numbers up to 255, some above 1, are colours from 0 to 255. Other numbers are no colour:
    the shape has none.
    """
    of_bytes: list[str] = []
    unusable: list[str] = []

    def plain(shape: Shape) -> Shape:
        if shape.rgba is None or _is_colour(shape.rgba):
            return shape
        text = " ".join(f"{x:g}" for x in shape.rgba)
        *rgb, opacity = shape.rgba
        opaque = 0.0 <= opacity <= 1.0 or opacity in range(256)
        if opaque and all(x in range(256) for x in rgb):
            of_bytes.append(text)
            opacity = opacity / 255.0 if opacity > 1.0 else opacity
            return shape._replace(rgba=(*(x / 255.0 for x in rgb), opacity))
        unusable.append(text)
        return shape._replace(rgba=None)

    visuals = {
        link: shapes._replace(
            visual=tuple(map(plain, shapes.visual)), collision=tuple(map(plain, shapes.collision))
        )
        for link, shapes in tree.visuals.items()
    }
    if of_bytes:
        colours = listed(list(dict.fromkeys(of_bytes)))
        source.warn(f"colours are read as numbers from 0 to 255; write them from 0 to 1: {colours}")
    if unusable:
        colours = listed(list(dict.fromkeys(unusable)))
        source.warn(f"colours are not from 0 to 1, and are left out: {colours}")
    return replace(tree, visuals=visuals) if of_bytes or unusable else tree


def _is_colour(rgba: tuple[float, ...]) -> bool:
    """Whether red, green, blue and opacity are from 0 to 1, but for rounding."""
    return len(rgba) == 4 and all(-COLOUR_ROUNDING <= x <= 1.0 + COLOUR_ROUNDING for x in rgba)


def path_of(robot: RobotSource) -> Path:
    """Return the path of a robot file, or the name of a model of Pinocchio in its place."""
    if isinstance(robot, PINOCCHIO_MODELS):
        return pinocchio_model.name_of(robot)
    if isinstance(robot, str):
        _require_path(robot)
    return Path(robot)


def _require_path(text: str) -> None:
    """Refuse the text of a robot file and the address of one in place of its path."""
    if text.lstrip().startswith("<"):
        raise ModelError(
            f"{text.strip()[:40]!r} is the text of a robot file, not its path; write it to a file "
            'first: path = pathlib.Path("robot.urdf"); path.write_text(text); sa.load(path)'
        )
    if "://" in text and not text.startswith("package://"):
        raise ModelError(
            f"{text[:200]!r} is an address, and nothing is downloaded; fetch the file with its "
            "meshes first (git clone, curl -O), then load its path"
        )
