"""Couplings: joints that mimic others, as a linear map from the joints that lead them."""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array
from spacearm.description.tree import Tree
from spacearm.errors import ModelError


def coupling(tree: Tree) -> tuple[Array, Array]:
    """Return C and c of (positions of all movable joints) = C q + c, mimic joints included."""
    movable = [joint for joint in tree.depth_first() if joint.movable]
    leading = [joint.name for joint in tree.leading()]
    C, c = np.zeros((len(movable), len(leading))), np.zeros(len(movable))
    for i, joint in enumerate(movable):
        scale = 1.0
        while joint.mimic:
            c[i] += scale * joint.mimic.offset
            scale *= joint.mimic.multiplier
            joint = tree.joints[joint.mimic.leader]
        C[i, leading.index(joint.name)] = scale
    return C, c


def joint_limits(tree: Tree) -> tuple[Array, Array]:
    """Return the lower and upper limits of q, (n,) each, those of mimic joints included.

    Raises:
        ModelError: The limits of a joint and of one that mimics it exclude each other.
    """
    leading, movable = tree.leading(), [j for j in tree.depth_first() if j.movable]
    lower = np.array([joint.lower for joint in leading])
    upper = np.array([joint.upper for joint in leading])
    for joint, gains, offset in zip(movable, *coupling(tree), strict=True):
        j = int(np.abs(gains).argmax())
        if gains[j] == 0.0:  # it stays where it is
            continue
        low, high = sorted((end - offset) / gains[j] for end in (joint.lower, joint.upper))
        if low > upper[j] or high < lower[j]:
            raise ModelError(
                f"{tree.name}: joint {leading[j].name!r} has no position within limits: "
                f"{joint.name!r}, which mimics it, needs {low:g} to {high:g}, the others allow "
                f"{lower[j]:g} to {upper[j]:g}; correct <limit> or <mimic>"
            )
        lower[j], upper[j] = max(lower[j], low), min(upper[j], high)
    lower.flags.writeable = upper.flags.writeable = False
    return lower, upper
