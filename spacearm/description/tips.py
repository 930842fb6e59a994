"""Tips: the tip links of an arm, asked for or chosen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from spacearm.description.bodies import Joint
from spacearm.description.tree import Tree
from spacearm.errors import ConfigurationError, ModelError, UnsupportedError, listed, unknown


def movable(tree: Tree, tip: str) -> list[Joint]:
    """Return the joints between the spacecraft and a link that can move, the first one first."""
    return [joint for joint in tree.chain(tip) if joint.movable]


def choose_tips(tree: Tree, path: Path, tip: str | Sequence[str] | None) -> tuple[str, ...]:
    """Return the tips asked for, else those that the file names, else that of `choose_tip`.

    Raises:
        ConfigurationError: No link is named, one twice, or one that cannot be a tip.
        ModelError: Several links could be the tip.
    """
    if tip is None or isinstance(tip, str):
        tips: Sequence[str | None] = (tip,) if tip is not None or not tree.tips else tree.tips
    else:
        tips = tip
    chosen = tuple(choose_tip(tree, path, name) for name in tips)
    if not chosen or len(set(chosen)) != len(chosen):
        raise ConfigurationError(f"tip is {tip!r}; name one link or several different ones")
    return chosen


def only_tip(tips: Sequence[str], robot: str) -> str:
    """Return the only tip of a robot.

    Raises:
        UnsupportedError: There are several.
    """
    if len(tips) > 1:
        raise UnsupportedError(
            f"{robot} has the tips {listed(tips)}, and what was asked for is about one: choose "
            f"it with arm.replace(tip={tips[0]!r})"
        )
    return tips[0]


def choose_tip(tree: Tree, path: Path, tip: str | None) -> str:
    """Return the link asked for, else the leaf behind the most movable joints.

    Of several such leaves it is the one behind the most joints of any kind.

    Raises:
        ConfigurationError: The link does not exist or is part of the spacecraft.
        ModelError: Several leaves remain.
    """
    if tip is None:
        depth = {leaf: (len(movable(tree, leaf)), len(tree.chain(leaf))) for leaf in tree.leaves()}
        candidates = [leaf for leaf in depth if depth[leaf] == max(depth.values())]
        if len(candidates) > 1:
            raise ModelError(
                f"{path}: {len(candidates)} links could be the tip: {listed(candidates)}; "
                "choose one with tip="
            )
        tip = candidates[0]
    if tip not in tree.links:
        raise ConfigurationError(f"tip: {unknown('link', tip, tree.links)}")
    if not movable(tree, tip):
        raise ConfigurationError(
            f"tip {tip!r} is part of the spacecraft; choose a link behind a movable joint: "
            f"{listed([link for link in tree.links if movable(tree, link)])}"
        )
    return tip
