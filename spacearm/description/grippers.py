"""Grippers: fingers and jaws at the end of an arm, recognised by its joints.

A finger is a short, light branch behind a body that an arm moves, its palm. Lengths count relative
to the arm and masses relative to what the arm moves, so that units do not matter. What tells
fingers from a wrist: there are three or more, or two that are alike, or one moves as the other
does (mimic joints), or they are named so. Branches that end in hands of their own are arms, and so
are two that have more joints than the arm before them, or axes that are not parallel. A single jaw
is recognised by its name, by a tool frame on the body that it is hinged to, or by the shape of
that body, which reaches along the jaw. Or it is recognised by how it moves: little, across the
palm, or from zero to one side as the joint before it does not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from itertools import chain

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.bodies import Joint
from spacearm.description.shapes import Visuals
from spacearm.description.tree import Tree
from spacearm.errors import ModelError, listed

#: Longest finger, as a share of the way from the first joint of the arm to it.
SHORT = 0.4
#: Heaviest set of fingers, as a share of the mass that the arm moves up to them.
LIGHT = 1.0
#: How far the body that carries a jaw reaches along it, as a share of the jaw, if it is one.
ALONG = 0.8
#: Longest way that a single jaw slides that only its motion tells, as a share of the way from the
#: first joint of the arm to it.
STROKE = 0.1
#: Longest jaw that only its motion tells, as a share of that way.
SMALL = 0.15
#: How far such a jaw turns past zero, as a share of its range.
ONE_SIDED = 0.15
#: Cosine of the least angle between the slide of such a jaw and the way from its palm to it.
ACROSS = 0.7
#: How many times as heavy or long as the other one of two fingers may be.
ALIKE = 3.0
#: Most joints of a finger that no name tells: of two fingers, of more, as a thumb has.
#:
#: An arm may have more.
MOST_JOINTS = (3, 5)


def fingers(tree: Tree) -> dict[str, tuple[str, ...]]:
    """Return the joints at which the fingers of each gripper begin, by the link that moves them.

    The link is the first of the palm's, as in `Tree.lumps`. The spacecraft is not a palm.
    """
    return _Grippers(tree).found


def held_fingers(tree: Tree, tips: Iterable[str], held: Collection[str]) -> tuple[str, ...]:
    """Say which of the joints that are held are fingers behind the tips, a sentence a gripper."""
    said, palms = [], fingers(tree) if held else {}
    for palm in dict.fromkeys(tree.body_of[tip] for tip in tips):
        first = set(palms.get(palm, ()))
        ways = {name: tree.chain(tree.joints[name].child) for name in held}
        if names := [name for name, way in ways.items() if first & {j.name for j in way}]:
            parent = tree.joints[min(first)].parent
            said.append(
                f"the fingers on {parent!r} are held ({listed(names)}); to take one of them as the "
                'tip name its link with tip=LINK, to let all joints count give joints="all"'
            )
    return tuple(said)


class _Branch:
    """What moves behind one joint.

    Attributes:
        first: The joint.
        joints: All movable joints behind it, itself included.
        links: The links that they move.
        mass: Their mass [kg].
        extent: Longest way from the joint to a centre of mass or a frame [m].
    """

    def __init__(self, tree: Tree, first: Joint, behind: Sequence[_Branch]) -> None:
        part = tree.links[first.child]
        reach = max((_length(b.first.origin) + b.extent for b in behind), default=0.0)
        self.first: Joint = first
        self.joints: list[Joint] = [first] if first.movable else []
        self.joints += chain.from_iterable(b.joints for b in behind)
        self.links: list[str] = [first.child, *chain.from_iterable(b.links for b in behind)]
        self.mass: float = sum((b.mass for b in behind), 0.0 if part is None else part.mass)
        self.extent: float = max(reach, 0.0 if part is None else _length(part.origin))

    @property
    def freedoms(self) -> int:
        """Number of joints that mimic no other."""
        return sum(joint.mimic is None for joint in self.joints)

    @property
    def stroke(self) -> float:
        """How far the first joint slides [m]; 0 without limits."""
        stroke = self.first.upper - self.first.lower if self.first.kind == "prismatic" else 0.0
        return stroke if math.isfinite(stroke) else 0.0


class _Grippers:
    """The grippers of one robot."""

    def __init__(self, tree: Tree) -> None:
        self._tree, self._lumps, moving = tree, tree.lumps, tree.movable()
        self._common = shared(j.name for j in moving) | shared(j.child for j in moving)
        behind: dict[str, list[_Branch]] = {link: [] for link in tree.links}
        self._branches: dict[str, _Branch] = {}
        for joint in reversed(tree.depth_first()):
            self._branches[joint.name] = branch = _Branch(tree, joint, behind[joint.child][::-1])
            behind[joint.parent].append(branch)
        self.found: dict[str, tuple[str, ...]] = {}
        for palm, links in reversed(self._lumps.items()):  # hands before what carries them
            out = [b for link in links for b in behind[link][::-1] if b.first.movable]
            if out and palm != tree.root and self._are_fingers(palm, out):
                self.found[palm] = tuple(sorted(branch.first.name for branch in out))

    def _are_fingers(self, palm: str, branches: Sequence[_Branch]) -> bool:
        """Whether what moves behind a body is fingers, by its names or its shape."""
        way = self._way(palm, branches)
        if max(branch.extent for branch in branches) > SHORT * way or self._have_tool(branches):
            return False
        if any(self._ends_in_hand(palm, branch) for branch in branches):
            return False
        names = [name for b in branches for name in (b.first.name, b.first.child)]
        if any(is_finger(name, self._common) and not FIXED & set(words(name)) for name in names):
            return True
        if max(branch.freedoms for branch in branches) > MOST_JOINTS[len(branches) > 2]:
            return False
        if len(branches) == 1:
            told = self._jaw(palm, branches[0], way)
        else:
            told = len(branches) > 2 or self._coupled(branches) or self._pair(palm, *branches)
        return told and self._light(palm, branches)

    def _ends_in_hand(self, palm: str, branch: _Branch) -> bool:
        """Whether fingers branch two joints or more behind a palm: what carries them is an arm."""
        found = {link: self.found.get(link, ()) for link in branch.links}
        hands = [self._freedoms(hand) for hand, first in found.items() if len(first) > 1]
        return max(hands, default=0) - self._freedoms(palm) > 1

    def _freedoms(self, link: str) -> int:
        """Return the number of joints on the way to a link that mimic no other."""
        return sum(joint.mimic is None for joint in self._tree.movable(link))

    def _pair(self, palm: str, one: _Branch, other: _Branch) -> bool:
        """Whether two branches are alike as two fingers are, rather than two arms."""
        sizes = [(b.mass, b.extent) for b in (one, other)]
        if one.freedoms != other.freedoms or any(
            max(pair) > ALIKE * min(pair) for pair in zip(*sizes, strict=True)
        ):
            return False
        if one.freedoms == 1:
            return True
        turning = [joint for joint in (*one.joints, *other.joints) if joint.kind != "prismatic"]
        return one.freedoms <= self._freedoms(palm) and parallel(self._tree, turning)

    def _way(self, palm: str, branches: Sequence[_Branch]) -> float:
        """Return the length of the arm up to the farthest joint of the branches [m]."""
        frames = self._tree.frames
        palms = (frames[palm].actInv(frames[branch.first.child]) for branch in branches)
        return self._tree.way_to(palm) + max(map(_length, palms))

    def _light(self, palm: str, branches: Sequence[_Branch]) -> bool:
        """Whether the branches are light beside what the first joint of the arm moves."""
        first, mass = self._tree.movable(palm)[0], sum(branch.mass for branch in branches)
        return mass <= LIGHT * (self._branches[first.name].mass - mass)

    def _tip_rank(self, links: Sequence[str]) -> int | None:
        """Return how surely one of some links is named as a tip; None if none is."""
        ranks = (tip_rank(link, self._common) for link in links)
        return min((rank for rank in ranks if rank is not None), default=None)

    def _have_tool(self, branches: Sequence[_Branch]) -> bool:
        """Whether a branch has a tip by name, and not each of several branches the same."""
        ranks = [self._tip_rank(branch.links) for branch in branches]
        return ranks != [ranks[0]] * max(2, len(ranks)) and ranks.count(None) < len(ranks)

    def _jaw(self, palm: str, branch: _Branch, way: float) -> bool:
        """Whether the only branch behind a body is a jaw, or two of which one carries the other.

        Args:
            palm: The body.
            branch: The branch.
            way: Length of the arm up to it [m].
        """
        joint, slides = branch.first, branch.first.kind == "prismatic"
        if len(branch.joints) > 1:
            return slides and self._opposed(branch)
        if joint.mimic or not self._hinged(joint) or branch.stroke > SHORT * way:
            return False
        named = self._tip_rank(self._lumps[palm]) is not None
        if named or grasps(joint.name, self._common) or self._closes(palm, branch):
            return True
        if branch.extent > SMALL * way or branch.mass > self._tree.bodies[palm].mass:
            return False
        if slides:
            return 0.0 < branch.stroke <= STROKE * way and self._across(palm, joint)
        before = self._tree.movable(palm)[-1]  # of a finger that curls, too
        return _one_sided(joint) and not (
            _one_sided(before) and parallel(self._tree, (before, joint))
        )

    def _opposed(self, branch: _Branch) -> bool:
        """Whether two slides in a row, the second led by the first, move two links oppositely."""
        first, last = branch.joints[0], branch.joints[-1]
        if len(branch.joints) > 2 or not last.mimic or last.mimic.leader != first.name:
            return False
        axes = [self._tree.frames[joint.child].rotation @ joint.axis for joint in (first, last)]
        both = 1.0 + last.mimic.multiplier * float(axes[0] @ axes[1])
        return last.kind == "prismatic" and both < 0.0

    def _across(self, palm: str, joint: Joint) -> bool:
        """Whether a joint slides across the way from the origin of its palm to what it moves."""
        frames, body = self._tree.frames, self._tree.bodies[joint.child]
        along = frames[joint.child].act(body.origin.translation) - frames[palm].translation
        moves = abs(float(along @ frames[joint.child].rotation @ joint.axis))
        return moves < ACROSS * float(np.linalg.norm(along))

    def _closes(self, palm: str, branch: _Branch) -> bool:
        """Whether a body reaches as far along a jaw at zero as the jaw, as a fixed finger does."""
        joint, frames = branch.first, self._tree.frames
        axis, hinge = frames[joint.child].rotation @ joint.axis, frames[joint.child].translation
        jaw, body = (self._points(links) - hinge for links in (branch.links, self._lumps[palm]))
        if joint.kind == "prismatic" or not (len(jaw) and len(body)):
            return False
        along = jaw.mean(axis=0)
        along -= axis * (axis @ along)
        return bool((body @ along).max() >= ALONG * (jaw @ along).max() > 0.0)

    def _points(self, links: Sequence[str]) -> Array:
        """Return points (m, 3) of the shapes of some links, root frame, those that can be read."""
        found = [np.zeros((0, 3))]
        for link in links:
            drawn = self._tree.visuals.get(link, Visuals())
            for shape in drawn.visual or drawn.collision:
                with suppress(ModelError):
                    frame = self._tree.frames[link]
                    found.append(shape.points() @ frame.rotation.T + frame.translation)
        return np.vstack(found)

    def _hinged(self, joint: Joint) -> bool:
        """Whether a joint opens and closes: less than half a turn, what it moves off its axis.

        Of one that is named so, limits may be such as say nothing.
        """
        if joint.kind == "prismatic":
            return math.isfinite(joint.upper - joint.lower)
        body = self._tree.bodies[joint.child]
        lever = body.origin.translation
        beside = np.linalg.norm(np.cross(joint.axis, lever)) > 0.1 * np.linalg.norm(lever)
        if joint.upper - joint.lower >= math.pi:
            return grasps(joint.name, self._common) and body.mass > 0.0 and bool(beside)
        return body.mass == 0.0 or bool(beside)

    def _coupled(self, branches: Sequence[_Branch]) -> bool:
        """Whether all joints of two branches move as one joint of theirs does."""
        leaders = [{self._tree.leader(j).name for j in branch.joints} for branch in branches]
        names = {joint.name for branch in branches for joint in branch.joints}
        alone = [found.copy().pop() for found in leaders if len(found) == 1 and found <= names]
        return len(alone) > len(set(alone))


def _one_sided(joint: Joint) -> bool:
    """Whether a joint turns from about zero to one side."""
    least = min(abs(joint.lower), abs(joint.upper))
    return joint.kind != "prismatic" and least <= ONE_SIDED * min(
        joint.upper - joint.lower, math.pi
    )


#: Sine of the angle up to which two axes are parallel.
PARALLEL = 1e-6


def parallel(tree: Tree, joints: Iterable[Joint]) -> bool:
    """Whether the axes of all these joints are parallel, joints at zero."""
    axes = [tree.frames[joint.child].rotation @ joint.axis for joint in joints]
    return all(float(np.linalg.norm(np.cross(axis, axes[0]))) < PARALLEL for axis in axes)


def _length(pose: pin.SE3) -> float:
    return float(np.linalg.norm(pose.translation))


WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")

#: Words of frames that tell where a tool works, the surest first.
TIPS = (
    {"tcp"}, {"tool", "tooltip"}, {"grasp", "grasping", "pinch"},
    {"ee", "eef", "eff", "effector", "endeffector", "endpoint"}, {"tip"},
)  # fmt: skip
#: Words of what a tool is fastened to, or of a hand as a whole.
HANDS = frozenset({"flange", "attachment", "hand", "palm", "gripper", "grip", "grapple"})
#: Words of what moves in a gripper, which may be run together with others.
FINGERS = re.compile(r"finger|thumb|jaw|claw|knuckle|phalanx|pincer")
#: Words of a finger that does not move beside its palm; the joint before it is one of a wrist.
FIXED = frozenset({"fixed", "static", "stationary"})
#: Words of fingers beside a thumb; alone they say nothing, but no tip of an arm has them.
DIGITS = frozenset({"index", "middle", "ring", "little", "pinky", "pinkie"})
#: Words of joints that open and close a gripper, unless the joint turns a wrist.
GRASPS = frozenset({"gripper", "grip", "grasp", "grasping", "pinch"})
#: Words of what turns and is not an arm.
WHEELS = frozenset({"wheel", "wheels", "rw", "flywheel", "rotor", "propeller", "caster"})
WRISTS = frozenset(
    {"wrist", "roll", "pitch", "yaw", "rotate", "rotation", "pan", "tilt", "twist", "swivel"}
)
#: Words of frames that only measure or draw.
SENSORS = re.compile(
    r"camera|optical|imu|sensor|laser|lidar|sonar|rgb|depth|infra|marker|led$|range$|accelero|gyro|"
    r"touch|tactile|bumper|torque|visual|collision"
)


def words(name: str) -> tuple[str, ...]:
    """Return the words of a name, in small letters."""
    return tuple(word.lower() for word in WORD.findall(name))


def shared(names: Iterable[str]) -> frozenset[str]:
    """Return the words that all of two or more names have."""
    sets = [frozenset(words(name)) for name in names]
    return frozenset.intersection(*sets) if len(sets) > 1 else frozenset()


def tip_rank(name: str, common: Collection[str] = ()) -> int | None:
    """Return how surely a link is named as a tip, 0 the surest; None if it is not."""
    said = set(words(name)) - set(common)
    if said & DIGITS or measures(name) or is_finger(name, common):
        return None
    return next((rank for rank, among in enumerate(TIPS) if said & among), None)


def is_hand(name: str, common: Collection[str] = ()) -> bool:
    """Whether a link is named as a hand or as what a tool is fastened to."""
    said = set(words(name)) - set(common)
    other = said & WRISTS or measures(name) or is_finger(name, common)
    return bool(said & HANDS) and not other


def is_finger(name: str, common: Collection[str] = ()) -> bool:
    """Whether a link or joint is named as a part that moves in a gripper."""
    return any(FINGERS.search(word) for word in set(words(name)) - set(common))


def grasps(name: str, common: Collection[str] = ()) -> bool:
    """Whether a joint is named as one that opens and closes a gripper."""
    said = set(words(name)) - set(common)
    return bool(said & GRASPS) and not said & WRISTS


def is_wheel(*names: str) -> bool:
    """Whether a joint or what it moves is named as a wheel."""
    return any(WHEELS.intersection(words(name)) for name in names)


def measures(name: str) -> bool:
    """Whether a link is named as a sensor or as something that is only drawn."""
    return any(SENSORS.search(word) for word in words(name))
