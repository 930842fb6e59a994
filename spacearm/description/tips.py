"""Tips: the tip links of an arm, asked for, named by a file, or chosen as an engineer would.

Where nobody names it, the tip is looked for on every arm, that is on every body behind which
nothing but fingers moves. It is the frame there that has a name for tips, such as tool0 or
hand_tcp. Else it is the hand, else the last link before the fingers branch, else the link farthest
out. Of several arms one that ends in such a frame or in a gripper comes before others, then the
one with the most joints. Of frames at one place the one with the shortest name is taken. Where two
are equally right the question is asked.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from spacearm.description import grippers
from spacearm.description.grippers import fingers
from spacearm.description.loops import closed_chain
from spacearm.description.srdf import named_tips
from spacearm.description.tree import Tree
from spacearm.errors import ConfigurationError, ModelError, UnsupportedError, listed, require_known

#: Largest number of movable joints among which a tip is looked for.
MOST_JOINTS = 300

#: Distance of two links that are at one place, as a share of the way to them.
SAME_PLACE = 1e-6


class Tips(NamedTuple):
    """Tip links, and why they are the tips, a phrase."""

    links: tuple[str, ...]
    reason: str


class _Candidate(NamedTuple):
    """A link that could be the tip: the best one of an arm."""

    link: str
    reason: str
    sure: bool
    joints: int


def choose_tips(tree: Tree, path: Path, tip: str | Sequence[str] | Tips | None) -> Tips:
    """Return the tips asked for, else those that the file names, else the one that is found.

    Args:
        tree: The tree.
        path: The file, beside which an SRDF may name the tip.
        tip: What was asked for; tips chosen before are kept with their reason.

    Raises:
        ConfigurationError: No link is named, one twice, or one that cannot be a tip.
        ModelError: Several links could be the tip, or the loops of the description are not those
            of several arms that hold one thing.
    """
    if tip is None and (chain := closed_chain(tree, path)):
        return Tips(chain.tips, f"they close a chain: {listed(chain.loops)}")
    if tip is None and not tree.tips:
        return _found(tree, path)
    if isinstance(tip, Tips):
        links, reason = tip
    elif tip is None:
        links, reason = tree.tips, "the model names it"
    else:
        links, reason = (tip,) if isinstance(tip, str) else tuple(tip), "it was asked for"
    for link in links:
        _check(tree, link)
    if not links or len(set(links)) != len(links):
        raise ConfigurationError(f"tip is {tip!r}; name one link or several different ones")
    return Tips(tuple(links), reason)


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


def _check(tree: Tree, link: str) -> None:
    """Refuse a link that does not exist or is part of the spacecraft."""
    require_known("link", link, tree.links, "tip: ")
    if not tree.movable(link):
        raise ConfigurationError(
            f"tip {link!r} is part of the spacecraft; choose a link behind a movable joint: "
            f"{listed([link for link in tree.links if tree.movable(link)])}"
        )


# --- found ----------------------------------------------------------------------------------


def _found(tree: Tree, path: Path) -> Tips:
    """Find the tip.

    Raises:
        ModelError: Several links could be it.
    """
    if tree.freedoms > MOST_JOINTS:
        raise ModelError(
            f"{path}: {tree.freedoms} movable joints are too many to look for a tip among; name "
            "it: tip=LINK"
        )
    common, arms = grippers.shared(joint.child for joint in tree.movable()), _arms(tree)
    found = [tip for body, begin in arms.items() for tip in _on(tree, common, body, begin)]
    candidates = _named_by_srdf(tree, common, path, arms) or found
    if not candidates:
        wheels = [joint.name for joint in tree.leading()]
        if not wheels:
            raise ModelError(f"{path}: no joint can move; an arm needs at least one free joint")
        named = next(link for link in tree.links if link not in tree.marks and tree.movable(link))
        idle = [link for link, part in tree.links.items() if not part and link in tree.visuals]
        raise ModelError(
            f"{path}: nothing moves but wheels ({listed(wheels)}); an arm needs a joint; if one "
            f"of them is an arm's, name its link: tip={named!r}"
            + f"; links without mass do not move ({listed(idle)}): density=2700 estimates it"
            * bool(idle)
        )
    most = max(candidate.joints for candidate in candidates)
    sure = [c for c in candidates if c.sure and 2 * c.joints >= most] or candidates
    most = max(candidate.joints for candidate in sure)
    best = _without_twins(tree, [candidate for candidate in sure if candidate.joints == most])
    links = [candidate.link for candidate in best]
    others = [
        c.link
        for c in (*candidates, *found)
        if 2 * c.joints >= most
        and c.link not in links
        and not any(_same_arm(tree, c.link, link) for link in links)
    ]
    rest = f"; other arms end in {listed(dict.fromkeys(others))}" if others else ""
    if len(best) > 1:
        raise ModelError(
            f"{path}: {len(links)} links could be the tip: {listed(links)}; choose one with "
            f"tip={links[0]!r}, or several with tip=({links[0]!r}, {links[1]!r}){rest}"
        )
    return Tips((links[0],), best[0].reason + rest)


def _without_twins(tree: Tree, candidates: Sequence[_Candidate]) -> list[_Candidate]:
    """Return the candidates, of several at one place of one body that with the shortest name.

    Which of them is taken makes no difference to what the arm can do.
    """
    kept: dict[str, _Candidate] = {}
    for candidate in sorted(candidates, key=lambda candidate: len(candidate.link)):
        link = candidate.link
        twin = next((other for other in kept if _at_one_place(tree, other, link)), None)
        if twin is None:
            kept[link] = candidate
        else:
            reason = f"{kept[twin].reason}, and {link!r} is at the same place"
            kept[twin] = kept[twin]._replace(reason=reason)
    return [kept[candidate.link] for candidate in candidates if candidate.link in kept]


def _at_one_place(tree: Tree, link: str, other: str) -> bool:
    """Whether the origins of two links are one point of one body."""
    if tree.body_of[link] != tree.body_of[other]:
        return False
    apart = tree.frames[link].translation - tree.frames[other].translation
    return float(np.linalg.norm(apart)) <= SAME_PLACE * tree.way_to(link)


def _arms(tree: Tree) -> dict[str, tuple[str, ...]]:
    """Return the bodies behind which nothing but fingers moves, and the fingers' first joints.

    A body is named by its first link, as in `Tree.lumps`; the spacecraft and wheels are none.
    """
    palms = fingers(tree)
    first = {joint for begin in palms.values() for joint in begin}
    ends: dict[str, tuple[str, ...]] = {}
    carries = {j.child for j in tree.joints.values() if grippers.is_wheel(j.name, j.child)}
    for joint in tree.movable():
        carrier = tree.body_of[joint.parent]
        if joint.name not in first and (carrier in ends or carrier == tree.root):
            ends[joint.child] = palms.get(joint.child, ())
            carries.add(carrier)
    return {body: begin for body, begin in ends.items() if body not in carries}


def _same_arm(tree: Tree, link: str, other: str) -> bool:
    """Whether the joints on the way to one of two links are on the way to the other."""
    one, two = ({joint.name for joint in tree.movable(end)} for end in (link, other))
    return one <= two or two <= one


def _count(tree: Tree, link: str) -> int:
    """Return the number of joints that move a link on their own, or by joints that mimic them."""
    return len({tree.leader(joint).name for joint in tree.movable(link)})


def _on(tree: Tree, common: Collection[str], body: str, begin: Sequence[str]) -> list[_Candidate]:
    """Return the links of the last body of an arm that could be its tip, one where it is clear.

    Args:
        tree: The tree.
        common: Words that the names of all moving links share.
        body: The body.
        begin: The joints on it at which fingers begin.
    """
    links, count = tree.lumps[body], _count(tree, body)
    ranks = {link: grippers.tip_rank(link, common) for link in links}
    if named := _outermost(tree, [link for link, rank in ranks.items() if rank is not None]):
        surest = min(rank for link in named if (rank := ranks[link]) is not None)
        named = [link for link in named if ranks[link] == surest]
        return [_Candidate(link, "its name is one for tips", True, count) for link in named]
    if hands := _outermost(tree, [link for link in links if grippers.is_hand(link, common)]):
        hands = [fork] if grippers.is_hand(fork := _fork(tree, hands), common) else hands
        return [_Candidate(link, "its name is one for hands", True, count) for link in hands]
    if begin:
        held = " and ".join(begin)
        palms = {tree.joints[name].parent for name in begin}
        palm = _fork(tree, sorted(palms))
        return [_Candidate(palm, f"it is the last link before the fingers {held}", True, count)]
    leaves = [link for link in tree.leaves() if link in links and not grippers.measures(link)]
    leaves = list(dict.fromkeys(_without_fingers(tree, common, leaf) for leaf in leaves))
    depth = {leaf: len(tree.chain(leaf)) for leaf in leaves or [body]}
    outer = _fork(tree, [leaf for leaf in depth if depth[leaf] == max(depth.values())])
    reason = "it is the last link" if outer in depth else "it is the last link before others branch"
    if (cargo := _cargo(tree, body, outer)) and cargo != outer:
        outer, reason = cargo, "it is the first link that outweighs the arm"
    return [_Candidate(outer, reason, False, count)]


def _without_fingers(tree: Tree, common: Collection[str], link: str) -> str:
    """Return the last link on the fixed way to a link that is not named as a finger, else it."""
    for joint in reversed(tree.chain(link)):
        if not grippers.is_finger(joint.child, common):
            return joint.child
        if joint.movable:
            break
    return link


def _outermost(tree: Tree, links: Sequence[str]) -> list[str]:
    """Return the links that no other one of them lies behind.

    A link with mass is not preferred to a frame without, which it lies behind: it may be carried.
    """

    def carried(link: str) -> bool:
        part = tree.links[link]
        return part is not None and part.mass > 0.0

    behind = {link: {joint.parent for joint in tree.chain(link)} for link in links}
    inner = {
        link
        for link in links
        for other in links
        if (link in behind[other] and carried(link) >= carried(other))
        or (other in behind[link] and carried(link) > carried(other))
    }
    return [link for link in links if link not in inner]


def _cargo(tree: Tree, body: str, link: str) -> str | None:
    """Return the first link behind a body, on the way to a link, that outweighs the arm, if any."""
    lumps = tree.lumps
    mass = {name: 0.0 if part is None else part.mass for name, part in tree.links.items()}
    way = [joint.child for joint in tree.chain(link)]
    arm = sum(mass[other] for joint in tree.movable(body)[:-1] for other in lumps[joint.child])
    for name in way[way.index(body) :]:
        if name != body and mass[name] > arm > 0.0:
            return name
        arm += mass[name]
    return None


def _fork(tree: Tree, links: Sequence[str]) -> str:
    """Return the last link on the way to all these links; the link itself if there is one."""
    ways = [[*(joint.parent for joint in tree.chain(link)), link] for link in links]
    same = [step[0] for step in zip(*ways, strict=False) if len(set(step)) == 1]
    return same[-1]


def _named_by_srdf(
    tree: Tree, common: Collection[str], path: Path, arms: dict[str, tuple[str, ...]]
) -> list[_Candidate]:
    """Return the tips that an SRDF beside the file names; a finger stands for its palm."""
    first = {joint: body for body, begin in arms.items() for joint in begin}
    found: dict[str, _Candidate] = {}
    links, file = named_tips(tree, path)
    for link in links:
        palm = next((first[j.name] for j in tree.movable(link) if j.name in first), None)
        if palm is None:
            found[link] = _Candidate(link, f"{file} names it", True, _count(tree, link))
        else:
            for other in _on(tree, common, palm, arms[palm]):
                reason = f"{file} names {link!r}, a part that moves in its gripper"
                found.setdefault(other.link, other._replace(reason=reason))
    bodies: dict[str, list[str]] = {}
    for link in found:
        bodies.setdefault(tree.body_of[link], []).append(link)
    return [found[link] for named in bodies.values() for link in _outermost(tree, named)]


#: Which joints count: those on the way to the tips, all, or some more by name.
Counting: TypeAlias = Literal["tip", "all"] | Collection[str]


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
    counting = {tree.leader(joint).name for tip in tips for joint in tree.movable(tip)}
    if isinstance(joints, str) and joints == "all":
        counting |= leading.keys()
    elif not isinstance(joints, str) or joints != "tip":
        tree.require_leading(joints, "joints", "name")
        counting |= set(joints)
    held = {name: joint.rest for name, joint in leading.items() if name not in counting}
    return tree.locked(held), held


def remaining(tree: Tree, joints: Counting) -> Counting:
    """Return `joints` without the names of joints that have been locked or made wheels since."""
    if isinstance(joints, str):
        return joints
    leading = {joint.name for joint in tree.leading()}
    return tuple(name for name in joints if name in leading)
