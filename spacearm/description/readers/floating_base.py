"""Floating bases: a spacecraft that the world carries by slides and hinges, which are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from spacearm.arrays import Array
from spacearm.description.bodies import Joint
from spacearm.description.readers.source import Source
from spacearm.description.tree import Tree
from spacearm.errors import listed

PARALLEL = 1e-6
"""Sine of the angle up to which two axes are parallel."""


def with_floating_base(source: Source, tree: Tree) -> Tree:
    """Return the tree from the spacecraft on, where joints without mass between stand for floating.

    Three slides and three hinges let a body float in space; two slides and a hinge across both in
    their plane, which is the same for a robot that moves in this plane only.

    Raises:
        ModelError: The joints may be a rail as well.

    Warns:
        ModelWarning: Joints were left out; or they were not, as a bus is to carry them.
    """
    way = _way(source, tree)
    if not way:
        return tree
    spacecraft, names = way[-1].child, listed([joint.name for joint in way])
    base = _from(tree, spacecraft)
    if not base.freedoms or any(
        joint.mimic and joint.mimic.leader not in base.joints for joint in base.joints.values()
    ):
        return tree
    slides, hinges = _axes(tree, way, "prismatic"), _axes(tree, way, "revolute", "continuous")
    if not len(slides):
        return tree
    floats = _spans(slides, 3) and _spans(hinges, 3)
    if not (floats or _in_plane(tree, base, slides, hinges)):
        if not source.reading.spacecraft:
            return tree
        source.fail(
            f"the link {tree.root!r} has no mass and carries {spacecraft!r} by {names}: "
            f"{spacecraft!r} may be a spacecraft that floats, or an arm on a rail",
            "for a spacecraft, replace these joints by one that leaves it free (a fixed joint in "
            "URDF and SDF, <freejoint/> in MJCF); an arm on a rail is mounted with its rail: "
            f"sa.mount({str(source.path)!r}, sa.Bus(mass=..., size=...)), on the command line "
            "--bus-mass KG",
        )
    if not source.reading.spacecraft:
        source.warn(
            f"joints {names} carry {spacecraft!r} as if it was a spacecraft that floats; they "
            "become joints of an arm on the bus: load the file without a bus to leave them out"
        )
        return tree
    source.warn(f"joints {names} are left out: the spacecraft {spacecraft!r} floats by itself")
    return base


def _way(source: Source, tree: Tree) -> list[Joint]:
    """Return the only joints from a massless root to the first body; empty if there are others."""
    way, leader = list[Joint](), tree.root
    while not any(_is_body(source, tree, link) for link in tree.lumps[leader]):
        after = [joint for joint in tree.movable() if joint.parent in tree.lumps[leader]]
        if len(after) != 1 or after[0].mimic:
            return []
        way += after
        leader = after[0].child
    return way


def _is_body(source: Source, tree: Tree, link: str) -> bool:
    """Whether a link has mass, or gets one from its shapes."""
    part = tree.links[link]
    if part is not None and part.mass:
        return True
    return source.reading.density is not None and link in tree.visuals


def _from(tree: Tree, root: str) -> Tree:
    """Return the part of a tree that a link carries, that link its root."""
    links, joints = {root}, list[Joint]()
    for joint in tree.depth_first():
        if joint.parent in links:
            links.add(joint.child)
            joints.append(joint)
    return replace(
        tree,
        root=root,
        links={name: part for name, part in tree.links.items() if name in links},
        joints={joint.name: joint for joint in joints},
        visuals={name: shapes for name, shapes in tree.visuals.items() if name in links},
        tips=tuple(tip for tip in tree.tips if tip in links),
        marks=tuple(mark for mark in tree.marks if mark in links),
    )


def _axes(tree: Tree, joints: list[Joint], *kinds: str) -> Array:
    """Return the axes (m, 3) of the joints of some kinds, root frame, joints at zero."""
    axes = [tree.frames[j.child].rotation @ j.axis for j in joints if j.kind in kinds]
    return np.array(axes).reshape(-1, 3)


def _spans(axes: Array, count: int) -> bool:
    """Whether there are so many axes, and none is a combination of the others."""
    return len(axes) == count and np.linalg.matrix_rank(axes, tol=PARALLEL) == count


def _in_plane(tree: Tree, base: Tree, slides: Array, hinges: Array) -> bool:
    """Whether two slides and a hinge span a plane that all joints of the robot keep."""
    if not (_spans(slides, 2) and len(hinges) == 1):
        return False
    across = slides @ hinges[0]
    moving = base.movable()
    along = _axes(tree, moving, "prismatic") @ hinges[0]
    turned = np.cross(_axes(tree, moving, "revolute", "continuous"), hinges[0])
    return all(bool((np.abs(x) < PARALLEL).all()) for x in (across, along, turned))
