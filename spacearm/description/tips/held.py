"""Held joints: those that do not count among the n, held where they are."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Literal, TypeAlias

from spacearm.description.bodies import Joint
from spacearm.description.tree import Tree
from spacearm.errors import ConfigurationError, unknown

Counting: TypeAlias = Literal["tip", "all"] | Collection[str]
"""Which joints count: those on the way to the tips, all, or some more by name."""


def hold(tree: Tree, tips: Sequence[str], joints: Counting) -> tuple[Tree, dict[str, float]]:
    """Return the tree with the joints that do not count held, and their values by name.

    A joint on the way to a tip counts, or the joint that it mimics. Joints that mimic a held one
    are held with it, and are not named.

    Args:
        tree: The tree.
        tips: Names of its tip links.
        joints: Which joints count; see `loading.load`.

    Raises:
        ConfigurationError: joints names no movable joint, or one that mimics another.
    """
    leading = {joint.name: joint for joint in tree.leading()}
    counting = {leader(tree, j).name for tip in tips for j in tree.chain(tip) if j.movable}
    counting |= leading.keys() if joints == "all" else _named(tree, joints)
    held = {name: rest(joint) for name, joint in leading.items() if name not in counting}
    return tree.locked(held), held


def leader(tree: Tree, joint: Joint) -> Joint:
    """Return the joint that a joint mimics in the end; the joint itself if it mimics none."""
    while joint.mimic:
        joint = tree.joints[joint.mimic.leader]
    return joint


def rest(joint: Joint) -> float:
    """Return the value that a held joint has [rad] or [m]: zero, or the limit nearest to it."""
    return min(max(0.0, joint.lower), joint.upper)


def counted(joints: Counting) -> str | tuple[str, ...]:
    """Return `joints` as it was given, checked and with its names as a tuple.

    Raises:
        ConfigurationError: It is neither "tip", "all" nor names.
    """
    if isinstance(joints, str) and joints in ("tip", "all"):
        return joints
    if isinstance(joints, str) or not isinstance(joints, Collection):
        raise ConfigurationError(f'joints is {joints!r}; give "tip", "all" or a list of names')
    return tuple(joints)


def _named(tree: Tree, joints: Counting) -> set[str]:
    """Return the joints that are named, checked."""
    if joints == "tip":
        return set()
    leading = [joint.name for joint in tree.leading()]
    for name in joints:
        joint = tree.joints.get(name) if isinstance(name, str) else None
        if joint and joint.movable and joint.mimic:
            raise ConfigurationError(
                f"joints: {name!r} mimics {joint.mimic.leader!r}; name that one"
            )
        if name not in leading:
            raise ConfigurationError(f"joints: {unknown('movable joint', name, leading)}")
    return set(joints)


def remaining(tree: Tree, joints: str | tuple[str, ...]) -> Counting:
    """Return `joints` without the names of joints that have been locked or made wheels since."""
    if isinstance(joints, str):
        return counted(joints)
    leading = {joint.name for joint in tree.leading()}
    return tuple(name for name in joints if name in leading)
