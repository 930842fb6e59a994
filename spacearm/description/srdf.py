"""SRDF: what a semantic description beside a robot file says, as MoveIt writes it.

It names tips, and positions of groups of joints; the one called "home" is where joints rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from lxml import etree

from spacearm.description.tree import Tree
from spacearm.files import lies_in, read, xml

#: Name of the position in which a robot rests, in SRDF and MJCF.
HOME = "home"
#: Folders above a robot file in which a package *moveit_config is looked for.
ABOVE = 4


def named_tips(tree: Tree, path: Path) -> tuple[tuple[str, ...], str]:
    """Return the tips that an SRDF beside a robot file names, and the name of that file.

    The links of end effectors and the ends of chains are tips, if a joint moves them.

    Args:
        tree: The robot.
        path: Its file.
    """
    for file, robot in _about(tree, path):
        effectors = [element.get("parent_link") for element in robot.findall("end_effector")]
        chains = [element.get("tip_link") for element in robot.findall("group/chain")]
        links = dict.fromkeys(link for link in (*effectors, *chains) if link and link in tree.links)
        if moved := tuple(link for link in links if tree.movable(link)):
            return moved, file.name
    return (), ""


def with_home(tree: Tree, path: Path) -> Tree:
    """Return the tree with the positions of the group states "home" of an SRDF as home of joints.

    A position that the robot file gives itself, or beyond the limits, does not change.

    Args:
        tree: The robot.
        path: Its file.
    """
    for _, robot in _about(tree, path):
        given = {
            element.get("name", ""): _number(element.get("value", ""))
            for state in robot.findall("group_state")
            if state.get("name", "").lower() == HOME
            for element in state.findall("joint")
        }
        moved = [
            replace(joint, home=at)
            for joint in tree.leading()
            if not joint.home and (at := given.get(joint.name)) is not None
            if joint.lower <= at <= joint.upper and math.isfinite(at)
        ]
        if moved:
            return tree.with_joints(*moved)
    return tree


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _about(tree: Tree, path: Path) -> Iterator[tuple[Path, etree._Element]]:
    """Yield the SRDF files about a robot with their roots, that with the name of its file first."""
    name = path.name.partition(".")[0]
    for file in sorted(dict.fromkeys(_files(path)), key=lambda file: file.stem != name):
        robot = _read(file)
        if robot is not None and robot.get("name") == tree.name:
            yield file, robot


def _files(path: Path) -> Iterator[Path]:
    """Yield the SRDF files beside a robot file, the nearest first."""
    if not path.is_file():  # a name only, of what `mount` put together
        return
    above = list(path.resolve().parents)[:ABOVE]
    folders = [folder / inner for folder in above[:2] for inner in ("", "srdf", "config")]
    for folder in above[1:]:
        for package in sorted(folder.glob("*moveit_config*")):
            folders += (package / "config", package / "srdf")
    for folder in folders:
        yield from (file for file in sorted(folder.glob("*.srdf")) if lies_in(file, [folder]))


def _read(file: Path) -> etree._Element | None:
    """Return the root of an SRDF, without entities or network access; None if it is none."""
    try:
        robot = xml(read(file), bare=True)
    except (OSError, etree.XMLSyntaxError):
        return None
    return robot if robot.tag == "robot" and not robot.getroottree().docinfo.doctype else None
