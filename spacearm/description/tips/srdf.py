"""SRDF: the tips that a semantic description beside a robot file names.

MoveIt keeps chains and end effectors of a robot in a file apart. It is looked for where packages
have it: beside the robot file, in folders srdf and config beside or above it, and in packages named
*moveit_config in the folders above. Files for another robot, and files that cannot be read, say
nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from lxml import etree

from spacearm.description.tree import Tree

ABOVE = 4
"""Folders above a robot file in which a package *moveit_config is looked for."""


def named_tips(tree: Tree, path: Path) -> tuple[tuple[str, ...], str]:
    """Return the tips that an SRDF beside a robot file names, and the name of that file.

    An SRDF with the name of the robot file comes before others. The links of end effectors and the
    ends of chains are tips, if a joint moves them.

    Args:
        tree: The robot.
        path: Its file.
    """
    own = [file for file in _files(path) if file.stem == path.name.partition(".")[0]]
    for file in (*own, *(file for file in _files(path) if file not in own)):
        if (robot := _read(file)) is not None and robot.get("name") == tree.name:
            links = _tips(robot)
            if moved := tuple(link for link in links if link in tree.links and _moves(tree, link)):
                return moved, file.name
    return (), ""


def _files(path: Path) -> list[Path]:
    """Return the SRDF files beside a robot file, the nearest first."""
    return list(
        dict.fromkeys(f for folder in _folders(path) for f in sorted(folder.glob("*.srdf")))
    )


def _folders(path: Path) -> Iterator[Path]:
    if not path.is_file():  # a name only, of what `mount` put together
        return
    above = list(path.resolve().parents)[:ABOVE]
    for folder in above[:2]:
        yield from (folder, folder / "srdf", folder / "config")
    for folder in above[1:]:
        for package in sorted(folder.glob("*moveit_config*")):
            yield from (package / "config", package / "srdf")


def _read(file: Path) -> etree._Element | None:
    """Return the root of an SRDF, without entities or network access; None if it is none."""
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True
    )
    try:
        document = etree.parse(file, parser)
    except (OSError, etree.XMLSyntaxError):
        return None
    sound = document.getroot().tag == "robot" and not document.docinfo.doctype
    return document.getroot() if sound else None


def _tips(robot: etree._Element) -> list[str]:
    """Return the parent links of end effectors, and the ends of chains."""
    effectors = [element.get("parent_link") for element in robot.findall("end_effector")]
    chains = [element.get("tip_link") for element in robot.findall("group/chain")]
    return list(dict.fromkeys(link for link in (*effectors, *chains) if link))


def _moves(tree: Tree, link: str) -> bool:
    return any(joint.movable for joint in tree.chain(link))
