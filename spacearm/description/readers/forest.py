"""Forest: links and joints as a reader finds them, and the one robot among them as a tree."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.bodies import Inertial, Joint
from spacearm.description.grippers import PARALLEL, fingers
from spacearm.description.loops import WORLD
from spacearm.description.readers.masses import LIGHT
from spacearm.description.readers.source import Source
from spacearm.description.shapes import Visuals
from spacearm.description.tree import Loop, Tree, free_name
from spacearm.errors import listed, unknown

#: Mass and inertia of links between slides and hinges of a base, over the largest of all links, up
#: to which they are there because a format allows no links without mass.
NEGLIGIBLE = 1e-5
HERE = pin.SE3.Identity()
#: Distance [m] and turn [rad] up to which two frames are one.
SAME_FRAME = 1e-15


class Forest:
    """Links and joints of a file, in which there may be more than one robot.

    Attributes:
        links: Mass properties of every link, by name; None for a frame without mass.
        joints: Every joint, by name.
        visuals: Shapes of the links that have any, by name.
        marks: Links without mass that only mark a place or are between joints; see `Tree`.
        loops: Links of any robot that hold each other; see `cut`.
    """

    def __init__(self) -> None:
        self.links: dict[str, Inertial | None] = {}
        self.joints: dict[str, Joint] = {}
        self.visuals: dict[str, Visuals] = {}
        self.marks: list[str] = []
        self.loops: list[Loop] = []

    def add(
        self, link: str, inertial: Inertial | None = None, shapes: Visuals | None = None
    ) -> None:
        """Add a link."""
        self.links[link] = inertial
        if shapes and any(shapes):
            self.visuals[link] = shapes

    def mark(self, name: str, link: str, pose: pin.SE3) -> None:
        """Add a frame that marks a place on a link, under another name if it is taken."""
        name = free_name(name, self.links.__contains__)
        self.add(name)
        self.marks.append(name)
        self.fix(link, name, pose)

    def fix(self, parent: str, child: str, pose: pin.SE3, name: str = "") -> None:
        """Fix a link to another at a pose in the frame of that one."""
        name = name or free_name(f"{child}_fixed", self.joints.__contains__)
        self.joints[name] = Joint(name, "fixed", parent, child, pose, np.array([1.0, 0.0, 0.0]))

    def join(
        self, parent: str, child: str, joints: Sequence[Joint], last: pin.SE3 | None = None
    ) -> None:
        """Join a link to another by joints in a row, with massless links between them.

        Args:
            parent: The link that carries the first joint.
            child: The link behind the last joint.
            joints: The joints; the origin of each is its pose in the moved frame of the one before
                it, that of the first in the frame of `parent`. Their parents and children are set
                here.
            last: Pose of `child` in the moved frame of the last joint; the identity if None.
        """
        apart = last is not None and not last.isIdentity(SAME_FRAME)
        for joint in joints:
            behind = child
            if apart or joint is not joints[-1]:
                behind = free_name(f"{child}_at_{joint.name}", self.links.__contains__)
                self.add(behind)
                self.marks.append(behind)
            self.joints[joint.name] = replace(joint, parent=parent, child=behind)
            parent = behind
        if last is not None and (apart or not joints):
            self.fix(parent, child, last)

    def graft(self, tree: Tree) -> None:
        """Add the links and joints of a robot."""
        self.links |= tree.links
        self.joints |= tree.joints
        self.visuals |= tree.visuals
        self.marks += tree.marks

    def cut(self) -> None:
        """Cut loops: of the joints that lead to a link the one that is nearest to the root stays.

        Each other one leads to a link of its own, without mass, where it holds that link. Before,
        joints are turned that lead to the robot from what it carries.
        """
        self._hang()
        roots = sorted(self.roots(), key=lambda root: -len(self.behind(root)))
        after, reached = self._after(), set(roots)
        for root in roots:
            waiting = [root]
            for link in waiting:
                for joint in after.get(link, ()):
                    end = joint.child
                    if end in reached:
                        end = free_name(f"{end}_at_{joint.name}", self.links.__contains__)
                        self.add(end)
                        self.marks.append(end)
                        self.joints[joint.name] = replace(joint, child=end)
                        self.loops.append(Loop(self._moved_by(joint), end, joint.child, HERE))
                    reached.add(end)
                    waiting.append(end)

    def _hang(self) -> None:
        """Hang roots on links that others lead to, too, the lighter root on the heavier one.

        A root that is fixed to such a link is held by it and stays.
        """
        after, into = self._after(), dict[str, Joint]()
        owner: dict[str, str] = {}
        for root in self.roots():
            owner[root], waiting = root, [root]
            for link in waiting:
                for joint in after.get(link, ()):
                    end = joint.child
                    if end not in owner:
                        owner[end], into[end] = root, joint
                        waiting.append(end)
                        continue
                    mine, theirs = [*_way_to(link, into), joint], _way_to(end, into)
                    tops = mine[0].parent, theirs[0].parent if theirs else end
                    if tops[0] == tops[1] or _fixed(mine) or _fixed(theirs):
                        continue
                    if self._weight(tops[0]) <= self._weight(tops[1]):
                        self._turn(mine, into)
                    else:
                        self._turn(theirs, into)
                        into[end] = joint

    def _after(self) -> dict[str, list[Joint]]:
        """Return the joints that start from each link, as they are now."""
        after: dict[str, list[Joint]] = {}
        for joint in self.joints.values():
            after.setdefault(joint.parent, []).append(joint)
        return after

    def _weight(self, root: str) -> float:
        """Return the mass of a root; what has none carries the others."""
        part = self.links[root]
        return part.mass if part and part.mass else math.inf

    def _turn(self, way: Sequence[Joint], into: dict[str, Joint]) -> None:
        """Lead a row of joints from its last link to its first one.

        Args:
            way: The joints.
            into: The joint that leads to each link, which is kept up to date.
        """
        for joint in way:
            there = joint.origin.inverse()
            if joint.movable:
                back = replace(joint, origin=HERE, axis=-joint.axis)
                self.join(joint.child, joint.parent, [back], there)
            else:
                self.fix(joint.child, joint.parent, there, joint.name)
            turned = self.joints[joint.name]
            into[turned.child] = turned
            if turned.child != joint.parent:  # `join` puts what is between last
                into[joint.parent] = next(reversed(self.joints.values()))

    def _moved_by(self, joint: Joint) -> str:
        """Return the name of a joint, or of the movable one in a row of which it is the end."""
        into, last = {other.child: other for other in self.joints.values()}, joint
        while not last.movable and last.parent in self.marks and last.parent in into:
            last = into[last.parent]
        return last.name if last.movable else joint.name

    def anchored(self, world: str) -> dict[str, pin.SE3]:
        """Return the links that are fixed to the world, with their poses in it."""
        places = {world: pin.SE3.Identity()}
        while more := {
            joint.child: places[joint.parent] * joint.origin
            for joint in self.joints.values()
            if joint.kind == "fixed" and joint.parent in places and joint.child not in places
        }:
            places |= more
        return places

    def closed(self, source: Source, tree: Tree, anchored: Mapping[str, pin.SE3]) -> Tree:
        """Return a robot with its loops, and the body that they hold if it floats by itself.

        Args:
            source: The file.
            tree: The robot.
            anchored: Links that are fixed to the world, with their poses in it.

        Raises:
            ModelError: The loops hold several bodies, or one whose joints move.
        """
        into = {joint.child: joint.parent for joint in self.joints.values()}
        found, cargo = list[Loop](), None
        for loop in self.loops:
            loop = loop if loop.link in tree.links else loop.turned()
            name, link, other, step, _ = loop
            if link not in tree.links:
                continue
            if other not in tree.links and other in anchored:
                step, other = step * anchored[other].inverse(), WORLD
            elif other not in tree.links:
                root = other
                while root in into:
                    root = into[root]
                body, holds = self.tree(root, root), f"{name!r} holds {root!r}"
                if body.freedoms:
                    source.fail(
                        f"{holds}, whose joints move",
                        "fix its joints, or lead them from the hands to it, not from it",
                    )
                if cargo and cargo.root != root:
                    source.fail(f"{holds}, and others another body", "keep one of them")
                cargo, step, other = body, step * body.frames[other].inverse(), root
            found.append(loop._replace(other=other, pose=step))
        return replace(tree, loops=tuple(found), cargo=cargo)

    def check(self, source: Source) -> None:
        """Refuse loops.

        Raises:
            ModelError: Two joints lead to a link, or links form a ring.
        """
        into: dict[str, list[Joint]] = {}
        for joint in self.joints.values():
            into.setdefault(joint.child, []).append(joint)
        for link, joints in into.items():
            if len(joints) > 1:
                movers = (into[j.parent][0] if j.parent in self.marks else j for j in joints)
                one, other, *_ = (repr(joint.name) for joint in movers)
                source.fail(
                    f"link {link!r} closes a loop: joints {one} and {other} both lead to it",
                    f"lead one of them to a new link at the place of {link!r}, and name the two as "
                    f"tips that hold each other: tip={{NEW: {link!r}}}",
                )
        reached = self.behind(*self.roots())
        if stray := [link for link in self.links if link not in reached]:
            source.fail(f"links {listed(stray)} form a loop", "cut it at one joint")

    def roots(self) -> list[str]:
        """Return the links without a parent."""
        children = {joint.child for joint in self.joints.values()}
        return [link for link in self.links if link not in children]

    def behind(self, *roots: str) -> set[str]:
        """Return the links that hang on some links, these included."""
        after, reached, waiting = self._after(), set(roots), [*roots]
        for link in waiting:
            waiting += (more := {joint.child for joint in after.get(link, ())} - reached)
            reached |= more
        return reached

    def tree(self, name: str, root: str) -> Tree:
        """Return the tree behind a root link."""
        whole = Tree(name, root, self.links, self.joints, self.visuals, marks=tuple(self.marks))
        return whole.within(self.behind(root))

    def robot(self, source: Source, name: str, roots: Sequence[str]) -> Tree:
        """Return the tree with the tips asked for, else the most movable joints; say what is left.

        Args:
            source: The file.
            name: Name of the robot.
            roots: The roots to choose from.

        Raises:
            ModelError: There is none with a joint, or several with equally many.
        """
        trees = sorted((self.tree(name, root) for root in roots), key=lambda t: -t.freedoms)
        tips = source.reading.tips
        if asked := [tree for tree in trees if tips and all(_has(tree, tip) for tip in tips)]:
            trees = [asked[0], *(tree for tree in trees if tree is not asked[0])]
        if not trees or (trees[0].freedoms == 0 and not source.reading.rigid):
            source.fail("no joint can move", "describe the joints of an arm")
        alike = [tree.root for tree in trees if tree.freedoms == trees[0].freedoms]
        if len(alike) > 1 and not asked:
            source.fail(
                f"holds {len(alike)} robots of the most joints, {trees[0].freedoms}, with roots "
                f"{listed(alike)}",
                "name the tip of one with tip=LINK, keep one of them, or join them to one "
                "spacecraft",
            )
        held = {end for loop in self.loops for end in loop[1:3]}
        if others := [tree.root for tree in trees[1:] if held.isdisjoint(tree.links)]:
            source.warn(
                f"{trees[0].root} is taken as the root of the robot; left out, as not fixed to "
                f"it: {listed(others)}"
            )
        return trees[0]


def _way_to(link: str, into: Mapping[str, Joint]) -> list[Joint]:
    """Return the joints from a root to a link."""
    way = list[Joint]()
    while link in into:
        way.append(into[link])
        link = way[-1].parent
    return way[::-1]


def _fixed(way: Sequence[Joint]) -> bool:
    """Whether a row of joints fixes its ends to each other."""
    return bool(way) and not any(joint.movable for joint in way)


def _has(tree: Tree, tip: str) -> bool:
    """Whether a tree has a link of this name, or of this name in a model."""
    return any(link == tip or link.endswith(f"::{tip}") for link in tree.links)


def turns(name: str, letters: str, origin: pin.SE3, slides: str = "") -> list[Joint]:
    """Return hinges in a row about coordinate axes, such as "xyz", as `Forest.join` takes them.

    Those about the axes in `slides` slide along them.
    """
    axes = dict(zip("xyz", np.eye(3), strict=True))
    poses = [origin] + [pin.SE3.Identity()] * (len(letters) - 1)
    return [
        Joint(
            f"{name}_{letter}",
            "prismatic" if letter in slides else "continuous",
            *("", "", pose, axes[letter]),
        )
        for letter, pose in zip(letters, poses, strict=True)
    ]


def warn_of_balls(source: Source, tree: Tree) -> None:
    """Say which ball joints of a robot are taken as hinges, but for those that are left out."""
    for name in source.balls:
        if f"{name}_y" in tree.joints:
            source.warn(
                f"ball joint {name} is taken as three hinges, {name}_x, {name}_y and {name}_z: at "
                f"{name}_y = ±90° they describe a singular configuration that the ball joint does "
                "not have"
            )


def unprefixed(tree: Tree, tips: Sequence[str]) -> Tree:
    """Return the tree without the name of a model that all its names start with.

    They keep it where a tip that was asked for is named with it.
    """
    prefix = tree.root.partition("::")[0] + "::"
    if not all(name.startswith(prefix) for name in (*tree.links, *tree.joints)):
        return tree
    if not any(tip.startswith(prefix) for tip in tips):
        tree = tree.renamed(lambda name: name.removeprefix(prefix))
    return replace(tree, name=prefix[:-2])


def check_mimics(source: Source, joints: dict[str, Joint]) -> None:
    """Check that mimic joints lead to others; those of fixed joints are fixed too."""
    for joint in list(joints.values()):
        if joint.mimic and (leader := joints.get(joint.mimic.leader)) and leader.kind == "fixed":
            joints[joint.name] = joint.frozen(joint.mimic.offset)
            source.warn(f"joint {joint.name!r} mimics {leader.name!r}, which is fixed, and is too")
    movable = {joint.name: joint for joint in joints.values() if joint.movable}
    sound: set[str] = set()
    for joint in joints.values():
        seen, mimic = {joint.name}, joint.mimic
        while mimic and mimic.leader not in sound:
            if mimic.leader not in movable:
                what = unknown("movable joint", mimic.leader, movable)
                source.fail(f"<mimic> of joint {joint.name!r}: {what}", "name one")
            if mimic.leader in seen:
                source.fail(f"joint {joint.name!r} mimics itself", "remove that <mimic>")
            seen.add(mimic.leader)
            mimic = joints[mimic.leader].mimic
        sound |= seen & movable.keys()


def with_floating_base(source: Source, tree: Tree) -> Tree:
    """Return the tree from the spacecraft on, where joints without mass between stand for floating.

    Three slides and three hinges let a body float in space; two slides and a hinge across both in
    their plane, which is the same for a robot that moves in this plane only. A root that is light
    beside what it carries by them stands for the world too.

    Raises:
        ModelError: The joints may be a rail as well.

    Warns:
        ModelWarning: Joints were left out; or they were not, as a bus is to carry them, or as links
            between have mass.
    """
    chain, masses = _chain(tree), {leader: body.mass for leader, body in tree.bodies.items()}
    ends = [k for k, joint in enumerate(chain, 1) if _bodies(source, tree, joint.child)]
    world, foot = not _bodies(source, tree, tree.root), masses[tree.root]
    if not ends or not (world or 0.0 < foot <= LIGHT * (sum(masses.values()) - foot)):
        return tree
    way = chain[: world * ends[0]]
    for k in ends:
        *lighter, last = (masses[joint.child] for joint in chain[:k])
        if sum(lighter) <= LIGHT * last and _floats(tree, chain[:k]):
            way = chain[:k]
    if not _carries_a_robot(tree, way) or not len(_axes(tree, way, "prismatic")):
        return tree
    names = listed([joint.name for joint in way])
    spacecraft = _bodies(source, tree, way[-1].child)[-1]
    floats = len(way) == ends[0] and _floats(tree, way)
    if floats and source.reading.spacecraft:
        left = "" if world else f", with {tree.root!r} of {foot:.3g} kg"
        source.warn(
            f"joints {names} are left out{left}: the spacecraft {spacecraft!r} floats by itself"
        )
        base = _from(tree, way[-1].child)
        return replace(base, loops=(*base.loops, *_to_the_world(tree, base)))
    if floats:
        source.warn(
            f"joints {names} carry {spacecraft!r} as if it were a floating spacecraft; they "
            "become joints of an arm on the bus: load the file without a bus to leave them out"
        )
    elif source.reading.spacecraft:
        doubt = (
            f"the link {tree.root!r} has {'no mass' if world else f'{foot:.3g} kg'} and carries "
            f"{spacecraft!r} by {names}: {spacecraft!r} may be a spacecraft that floats, or an arm "
            "on a rail"
        )
        lock = (
            f"for a spacecraft, lock {names} (locked={{{way[0].name!r}: 0.0}} locks one), and it "
            "floats by itself"
        )
        if world:
            bus = f"sa.mount({str(source.path)!r}, sa.Bus(mass=..., size=...))"
            source.fail(doubt, f"{lock}; an arm on a rail is mounted with its rail: {bus}")
        source.warn(f"{doubt}, as which it is taken; {lock}")
    return tree


def _carries_a_robot(tree: Tree, way: list[Joint]) -> bool:
    """Whether what the joints carry has joints of its own that need no other."""
    if not way:
        return False
    base = _from(tree, way[-1].child)
    leaders = (joint.mimic.leader for joint in base.joints.values() if joint.mimic)
    return bool(base.freedoms) and all(leader in base.joints for leader in leaders)


def _floats(tree: Tree, way: list[Joint]) -> bool:
    """Whether joints let what they carry float, in space or in the plane of its joints."""
    slides, hinges = _axes(tree, way, "prismatic"), _axes(tree, way, "revolute", "continuous")
    in_space = _spans(slides, 3) and _spans(hinges, 3)
    return in_space or _in_plane(tree, way, slides, hinges)


def _to_the_world(tree: Tree, base: Tree) -> list[Loop]:
    """Return the loops by which links that a base carries hold what is fixed to the root."""
    world, found = tree.lumps[tree.root], list[Loop]()
    for loop in tree.loops:
        loop = loop.turned() if loop.link in world else loop
        if loop.link in base.links and loop.other in world:
            there = tree.frames[tree.root].actInv(tree.frames[loop.other])
            found.append(loop._replace(other=WORLD, pose=loop.pose * there.inverse()))
    return found


def _chain(tree: Tree) -> list[Joint]:
    """Return the joints from the root on, as long as one alone is behind the other."""
    chain, after = list[Joint](), [tree.root]
    while after:
        lump = tree.lumps[after[0]]
        behind = [joint for joint in tree.movable() if joint.parent in lump]
        after = [joint.child for joint in behind if not joint.mimic and len(behind) == 1]
        chain += behind[: len(after)]
    return chain


def _bodies(source: Source, tree: Tree, leader: str) -> list[str]:
    """Return the links fixed to one that are bodies, the heaviest last."""
    found = [link for link in tree.lumps[leader] if _is_body(source, tree, link)]
    return sorted(found, key=lambda link: part.mass if (part := tree.links[link]) else 0.0)


def _is_body(source: Source, tree: Tree, link: str) -> bool:
    """Whether a link has mass that counts beside the heaviest one, or gets one from its shapes."""
    size = np.array([(p.mass, np.trace(p.inertia)) for p in tree.links.values() if p is not None])
    part = tree.links[link]
    if part is not None:
        own = np.array([part.mass, np.trace(part.inertia)])
        if (own > NEGLIGIBLE * size.max(axis=0)).any():
            return True
    return source.reading.density is not None and link in tree.visuals


def _from(tree: Tree, root: str) -> Tree:
    """Return the part of a tree that a link carries, that link its root."""
    part = replace(tree, root=root)
    return part.within({root, *(joint.child for joint in part.depth_first())})


def _axes(tree: Tree, joints: list[Joint], *kinds: str) -> Array:
    """Return the axes (m, 3) of the joints of some kinds, root frame, joints at zero."""
    axes = [tree.frames[j.child].rotation @ j.axis for j in joints if j.kind in kinds]
    return np.array(axes).reshape(-1, 3)


def _spans(axes: Array, count: int) -> bool:
    """Whether there are so many axes, and none is a combination of the others."""
    return len(axes) == count and np.linalg.matrix_rank(axes, tol=PARALLEL) == count


def _in_plane(tree: Tree, way: list[Joint], slides: Array, hinges: Array) -> bool:
    """Whether two slides and a hinge span a plane that all joints but those of fingers keep."""
    if not (_spans(slides, 2) and len(hinges) == 1):
        return False
    base = _from(tree, way[-1].child)
    across = slides @ hinges[0]
    begin = {name for joints in fingers(base).values() for name in joints}
    moving = [j for j in base.movable() if begin.isdisjoint(k.name for k in base.chain(j.child))]
    along = _axes(tree, moving, "prismatic") @ hinges[0]
    turned = np.cross(_axes(tree, moving, "revolute", "continuous"), hinges[0])
    return all(bool((np.abs(x) < PARALLEL).all()) for x in (across, along, turned))
