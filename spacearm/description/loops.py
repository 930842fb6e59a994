"""Loops: closed chains of a description, read as an open tree with a list of what holds what.

A loop is cut where two links hold each other. Links that hold one thing, be it a body that floats,
the fixed world or one another, are the tips of a closed chain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.description.bodies import Joint
from spacearm.description.grippers import fingers
from spacearm.description.tree import Loop, Tree, free_name
from spacearm.errors import ConfigurationError, ModelError, listed, unknown, warn

#: What a loop holds that holds the fixed world.
WORLD = ""
#: Fewest joints of an arm that the spacecraft carries, and of one that a moving body carries.
LEAST_JOINTS, LEAST_JOINTS_OF_BRANCHES = 2, 3


class ClosedChain(NamedTuple):
    """Tips that hold one thing.

    Attributes:
        tips: Links of the tree, one a body.
        grasps: Their poses in the frame of what they hold, by name.
        held: What they hold: a body that floats; a frame without mass, where they hold one another;
            None for the fixed world.
        loops: Names of the loops.
    """

    tips: tuple[str, ...]
    grasps: dict[str, pin.SE3]
    held: Tree | None
    loops: tuple[str, ...]


def closed_chain(tree: Tree, path: object = "") -> ClosedChain | None:
    """Return the closed chain of a description, if it has one.

    Loops within one body, and those of fingers, which are held, are none.

    Args:
        tree: The description.
        path: The file, for the error.

    Raises:
        ModelError: The loops are none that several tips close which hold one thing.
    """
    if not tree.loops:
        return None
    first = {name for begin in fingers(tree).values() for name in begin}
    loops = [
        loop
        for loop in tree.loops
        if not any(
            j.name in first for end in _ends(tree, loop) for j in tree.chain(end) if j.movable
        )
        and _node(tree, loop.link) != _node(tree, loop.other)
    ]
    if not loops:
        return None
    begin = next((loop for loop in loops if loop.other not in tree.links), None)
    held = None if begin is None or begin.other == WORLD else tree.cargo
    if begin is None:
        held = Tree(loops[0].name, "frame", {"frame": None}, {})
        known = {_node(tree, loops[0].link): _start(tree, loops[0].link)}
    else:
        known = {begin.other: pin.SE3.Identity()}
    grasps: dict[str, pin.SE3] = {} if begin else {loops[0].link: pin.SE3.Identity()}
    left = list(loops)
    while reached := [loop for loop in left if {_node(tree, e) for e in loop[1:3]} & known.keys()]:
        for loop in reached:
            left.remove(loop)
            for _, end, other, step, _ in (loop, loop.turned()):
                if _node(tree, end) in known and _node(tree, other) not in known:
                    place = known[_node(tree, end)] * _start(tree, end).inverse() * step
                    known[_node(tree, other)] = place * _start(tree, other)
                    grasps[other] = place
    names = tuple(loop.name for loop in loops)
    if left or not set(grasps) <= set(tree.links):
        fault = "several closed chains"
    else:
        fault = _fault(tree, tuple(grasps), first)
    if fault:
        raise ModelError(
            f"{path or tree.name}: {listed(names)}: {fault}, and only chains of several arms "
            "that hold one thing can be closed; name the tip, tip=LINK, and it loads with the loop "
            "open, or lock the joints of the linkage, locked={...}"
        )
    return ClosedChain(tuple(grasps), grasps, held, names)


def _fault(tree: Tree, tips: Sequence[str], first: set[str]) -> str:
    """Say why these are not tips of arms that hold one thing; "" if they are."""
    ways = [[joint for joint in tree.chain(tip) if joint.movable] for tip in tips]
    names = [[joint.name for joint in way] for way in ways]
    shared = [step[0] for step in zip(*names, strict=False) if len(set(step)) == 1]
    shared = shared if len(tips) > 1 else []
    least = LEAST_JOINTS_OF_BRANCHES if shared else LEAST_JOINTS
    for tip, way in zip(tips, names, strict=True):
        body = tree.body_of[tip]
        if not way:
            return f"a loop through the spacecraft, at link {tip!r}"
        if len(tips) > 1 and len(way) - len(shared) < least:
            return f"a loop inside one arm, at link {tip!r}"
        for joint in tree.movable():
            if tree.body_of[joint.parent] == body and joint.name not in first:
                return f"a loop inside one arm, which goes on with joint {joint.name!r}"
    return ""


def _ends(tree: Tree, loop: Loop) -> list[str]:
    """Return the links of the tree that a loop joins."""
    return [end for end in (loop.link, loop.other) if end in tree.links]


def _node(tree: Tree, link: str) -> str:
    """Return the body of a link of the tree; other names stand for themselves."""
    return tree.body_of.get(link, link)


def _start(tree: Tree, link: str) -> pin.SE3:
    """Return the pose of the first link of a body in the frame of a link of it."""
    if link not in tree.links:
        return pin.SE3.Identity()
    return tree.frames[link].actInv(tree.frames[tree.body_of[link]])


def chain_of(tree: Tree, tips: Sequence[str]) -> ClosedChain | None:
    """Return the closed chain of these tips that a description has; None if it has none."""
    try:
        chain = closed_chain(tree)
    except ModelError:
        return None
    return chain if chain and set(chain.tips) == set(tips) else None


def open_loops(tree: Tree, tips: Sequence[str]) -> str:
    """Say which loops are open of a robot with these tips, and where they are closed, if any."""
    if not tree.loops:
        return ""
    names = listed([loop.name for loop in tree.loops])
    if chain_of(tree, tips):
        return (
            f"a chain is closed by {names}: sa.hold(arm.at(q)) keeps it closed, everything else "
            f"takes the tips {listed(tips)} as free"
        )
    return f"equalities or joints that close a loop are left out, the loop open: {names}"


def warn_of_lost_loops(tree: Tree, path: object) -> None:
    """Say which loops a file that is written does not hold, if there are any."""
    if tree.loops:
        warn(
            f"{path}: loops are not written: {listed([loop.name for loop in tree.loops])}; the "
            "chain is open there, and sa.hold(start, target, grasps) closes it by grasps"
        )


def with_ball_joints(tree: Tree, path: object) -> Tree:
    """Return a tree whose closed chain has three hinges in place of each point that it holds."""
    loops, balls = list[Loop](), list[str]()
    for loop in tree.loops if closed_chain(tree, path) else ():
        if loop.point is None:
            loops.append(loop)
            continue
        if loop.other in tree.links and len(tree.movable(loop.link)) < len(
            tree.movable(loop.other)
        ):
            loop = loop.turned()
        at = pin.SE3(loop.pose.rotation, loop.point)
        names = [free_name(f"{loop.name}_{axis}", tree.joints.__contains__) for axis in "xyz"]
        ends = [free_name(f"{name}_end", tree.links.__contains__) for name in names]
        poses, axes = (at, pin.SE3.Identity(), pin.SE3.Identity()), np.eye(3)
        rows = zip(names, (loop.link, *ends), ends, poses, axes, strict=False)
        hinges = {row[0]: Joint(row[0], "continuous", *row[1:]) for row in rows}
        tree = replace(
            tree,
            links={**tree.links, **dict.fromkeys(ends)},
            joints={**tree.joints, **hinges},
            marks=(*tree.marks, *ends),
        )
        balls.append(loop.name)
        loops.append(Loop(loop.name, ends[-1], loop.other, at.actInv(loop.pose)))
    if not balls:
        return tree
    note = f"points held by {listed(balls)} are ball joints of three hinges without mass each"
    return replace(tree, loops=tuple(loops), notes=(*tree.notes, note))


def balls(tree: Tree) -> list[tuple[str, ...]]:
    """Return the hinges, three each, that stand for the points that a closed chain holds."""
    rows = [tree.chain(loop.link)[-3:] for loop in tree.loops if loop.link in tree.marks]
    return [
        tuple(joint.name for joint in row)
        for row in rows
        if len(row) == 3
        and all(j.kind == "continuous" and j.child in tree.marks for j in row)
        and all(b.parent == a.child for a, b in pairwise(row))
    ]


def holding_each_other(tree: Tree, pairs: Mapping[str, str]) -> Tree:
    """Return a tree with more loops: pairs of links whose frames are one.

    Raises:
        ConfigurationError: There is no such link.
    """
    for link in (*pairs, *pairs.values()):
        if link not in tree.links:
            raise ConfigurationError(f"tip: {unknown('link', link, tree.links)}")
    here = pin.SE3.Identity()
    loops = [Loop(f"{link} = {other}", link, other, here) for link, other in pairs.items()]
    return replace(tree, loops=(*tree.loops, *loops))
