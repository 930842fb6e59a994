"""Flat bodies: planar systems whose file gives inertia about the normal of the plane only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.bodies import TRIANGLE_TOLERANCE, Inertial
from spacearm.description.readers.xml import Source
from spacearm.description.tree import Tree

SAME_HEIGHT = 1e-6
"""Share of the size of a robot by which centres of mass may lie out of one plane."""


def with_flat_bodies(source: Source, tree: Tree) -> Tree:
    """Return the tree with flat plates for the links that have inertia about its normal only.

    A planar system never turns out of its plane, so that the moments about the axes in the plane
    do not count. They are set to those of a flat plate, half the moment about the normal each.

    Args:
        source: The file.
        tree: Its links and joints.

    Warns:
        ModelWarning: Moments were set.
    """
    axis = tree.plane_normal()
    if axis is None:
        return tree
    frames = _frames(tree)
    plates = {
        link: plate
        for link, part in tree.links.items()
        if part and (plate := _plate(part, frames[link].rotation[axis])) is not None
    }
    if not plates or not _level(tree, frames, axis):
        return tree
    moments = ", ".join(f"{link!r}" for link in plates)
    source.warn(
        f"planar system: of {moments} only the moment of inertia about {'xyz'[axis]} is used, and "
        "half of it is taken about the axes in the plane, which does not count there"
    )
    return replace(tree, links={**tree.links, **plates})


def _plate(part: Inertial, normal: Array) -> Inertial | None:
    """Return a flat plate for a part that has inertia about the normal of the plane only.

    Args:
        part: Mass properties.
        normal: (3,) normal of the plane in link axes.
    """
    n = part.origin.rotation.T @ normal
    moment = float(n @ part.inertia @ n)
    rest = np.abs(part.inertia - moment * np.outer(n, n)).max()
    if part.mass <= 0.0 or moment <= 0.0 or rest > TRIANGLE_TOLERANCE * moment:
        return None
    return part._replace(inertia=0.5 * moment * (np.eye(3) + np.outer(n, n)))


def _level(tree: Tree, frames: dict[str, pin.SE3], axis: int) -> bool:
    """Whether all centres of mass lie in one plane, as they must for a planar motion."""
    points = np.array(
        [frames[link].act(part.origin.translation) for link, part in tree.links.items() if part]
    )
    size = float(np.ptp(points, axis=0).max())
    return float(np.ptp(points[:, axis])) <= SAME_HEIGHT * max(size, 1.0)


def _frames(tree: Tree) -> dict[str, pin.SE3]:
    """Return the poses of all links in the root frame, joints at zero."""
    frames = {tree.root: pin.SE3.Identity()}
    for joint in tree.depth_first():
        frames[joint.child] = frames[joint.parent] * joint.origin
    return frames
