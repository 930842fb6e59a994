"""Masses: the mass data of a robot checked, and completed where mechanics leaves no doubt.

What counts in mechanics is the inertia of each rigid body, which may consist of several links, and
whether every joint moves some mass. So a fault of one link is a warning where the body that it is
part of is sound, and a link without mass between two joints is fine as long as no motion of the
joints is left that moves no mass at all.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from spacearm.description.bodies import TRIANGLE_TOLERANCE, Inertial
from spacearm.description.couplings import coupling
from spacearm.description.plausible import implausible
from spacearm.description.readers.flat import with_flat_bodies
from spacearm.description.readers.xml import Source
from spacearm.description.tree import Tree

SINGULAR = 1e-10
"""Eigenvalue of the scaled joint inertia up to which some motion moves no mass."""
LIGHT = 0.2
"""Mass of a spacecraft, as a share of what moves on it, up to which it looks like a foot."""
SHOWN = 6
"""Names that a list of links or joints shows."""


def checked(source: Source, tree: Tree) -> Tree:
    """Return a tree with mass data that mechanics can use.

    Args:
        source: The file, which says how it is read.
        tree: Its links and joints.

    Raises:
        ModelError: There is a fault that cannot be repaired without doubt.

    Warns:
        ModelWarning: Something was assumed or left out.
    """
    if source.reading.density is not None:
        from spacearm.description.readers.densities import with_density  # slow to import

        tree = with_density(source, tree, source.reading.density)
    _require_masses(source, tree)
    tree = with_flat_bodies(source, tree)
    _check_links(source, tree)
    if source.reading.check != "accept":
        tree = _without_idle_leaves(source, tree)
    _check_motions(source, tree)
    for doubt in implausible(tree, bodies(tree)):
        source.warn(doubt)
    return tree


def bodies(tree: Tree) -> dict[str, Inertial]:
    """Return the rigid bodies, in link axes at their CM, by the link nearest to the root."""
    inertias = list(tree.pinocchio().inertias)[1:]
    leaders = [tree.root, *(joint.child for joint in tree.depth_first() if joint.movable)]
    return {
        leader: Inertial(float(I.mass), pin.SE3(np.eye(3), I.lever), np.array(I.inertia))
        for leader, I in zip(leaders, inertias, strict=True)
    }


def _require_masses(source: Source, tree: Tree) -> None:
    """Refuse a spacecraft without mass, and a robot of which nothing that moves has mass."""
    masses = {leader: body.mass for leader, body in bodies(tree).items()}
    if source.reading.spacecraft and masses[tree.root] == 0.0:
        file = str(source.path)
        source.fail(
            f"the spacecraft {tree.root!r}, the root link, has no mass (its <inertial> is zero or "
            "missing), as if this is an arm alone",
            f"mount it: sa.mount({file!r}, sa.Bus(mass=..., size=...)), or on the command line "
            f"--bus-mass KG, or spacearm mount {file} --bus-mass KG -o robot.urdf; or give that "
            "link a mass and an inertia",
        )
    spacecraft = masses.pop(tree.root)
    moving = sum(masses.values())
    if source.reading.spacecraft and spacecraft < LIGHT * moving:
        source.note(
            f"the spacecraft {tree.root!r} has {spacecraft:.3g} kg, and what moves on it "
            f"{moving:.3g} kg, as if this is an arm alone: sa.mount and --bus-mass put it on one"
        )
    if masses and not any(masses.values()):
        source.fail(
            f"no movable link has mass: <inertial> is zero or missing in {_some(masses)}",
            "add it, or estimate it from their shapes: density=2700 [kg/m^3] in Python, "
            "--density 2700 on the command line"
            if source.reading.density is None
            else "add it, or the mesh files of their shapes: packages=[FOLDER] or --package FOLDER",
        )


def _check_links(source: Source, tree: Tree) -> None:
    """Refuse links that no rigid body can be, unless they are part of a body that is sound."""
    whole, check = bodies(tree), source.reading.check
    for leader, lump in tree.lumps().items():
        parts = {link: part for link in lump if (part := tree.links[link]) is not None}
        sound = whole[leader].mass > 0.0 and whole[leader].fault() is None
        for link, part in parts.items():
            fault = part.fault()
            if fault is None or _thin(part):
                continue
            fixed = leader == tree.root and part.mass == 0.0 and not source.reading.spacecraft
            if fixed or (sound and len(parts) > 1):
                source.warn(f"link {link!r} {fault}: accepted, as the body it is fixed to is sound")
            elif check == "error":
                source.fail(
                    f"link {link!r} {fault}", 'correct it, or load with check="warn" to accept it'
                )
            elif check == "warn":
                source.warn(f"link {link!r} {fault}")
    root = whole[tree.root]
    if source.reading.spacecraft and _thin(root) and (fault := root.fault()):
        problem = f"the spacecraft {tree.root!r} has no inertia about some axis ({fault})"
        if check == "error":
            source.fail(problem, 'correct it, or load with check="warn" to accept it')
        source.warn(problem)


def _thin(body: Inertial) -> bool:
    """Whether all mass is on a line or in a point: the limit of rigid bodies, not one itself."""
    if body.mass <= 0.0:
        return False
    small, middle, large = np.linalg.eigvalsh(body.inertia)
    lever = float(body.origin.translation @ body.origin.translation)
    rounding = TRIANGLE_TOLERANCE * (large + TRIANGLE_TOLERANCE * body.mass * lever)
    return abs(small) <= rounding and large - middle <= 2.0 * rounding


def _without_idle_leaves(source: Source, tree: Tree) -> Tree:
    """Return the tree with the joints held that carry nothing but links without mass."""
    carried = {link: _content(part) for link, part in tree.links.items()}
    for joint in reversed(tree.depth_first()):
        carried[joint.parent] += carried[joint.child]
    led = coupling(tree)[0] != 0.0
    movable = [joint for joint in tree.depth_first() if joint.movable]
    idle = [
        joint
        for joint, moves in zip(tree.leading(), led.T, strict=True)
        if not any(carried[j.child] for j, moved in zip(movable, moves, strict=True) if moved)
    ]
    for joint in idle:
        source.warn(
            f"movable link {joint.child!r} has no mass and carries none: its joint {joint.name!r} "
            "is held; if it is to move, give it mass and inertia, or density="
        )
    held = {joint.name: float(np.clip(0.0, joint.lower, joint.upper)) for joint in idle}
    return tree.locked(held) if held else tree


def _content(part: Inertial | None) -> float:
    """Return a number above zero if a link has mass or inertia."""
    return 0.0 if part is None else part.mass + float(np.abs(part.inertia).sum())


def _check_motions(source: Source, tree: Tree) -> None:
    """Check that no motion of the joints is left that moves no mass, where links are massless.

    The joint-space inertia of the arm on a fixed base is evaluated at two random configurations.
    With a spacecraft that is a rigid body it is singular exactly where the inertia of all
    coordinates is.
    """
    weak = {
        leader: body
        for leader, body in bodies(tree).items()
        if leader != tree.root and (body.mass == 0.0 or _thin(body))
    }
    if not weak:
        return
    say = source.note if source.reading.check == "accept" else source.warn
    if moving := _motion_without_mass(tree):
        problem = (
            f"a motion of {_some(moving)} moves no mass: no mass, or no inertia about some axis, "
            f"is given for {_some(weak)}"
        )
        if source.reading.check == "error":
            source.fail(
                problem,
                'give them mass and inertia, or density=; check="warn" accepts it, for all that '
                "needs no joint torques",
            )
        say(problem)
        return
    if massless := [
        leader for leader, body in weak.items() if body.mass == 0.0 and leader not in tree.marks
    ]:
        say(f"links between joints without mass are taken as massless: {_some(massless)}")
    if thin := [leader for leader, body in weak.items() if _thin(body)]:
        say(f"bodies without inertia about some axis are taken as thin: {_some(thin)}")


def _motion_without_mass(tree: Tree) -> list[str]:
    """Return the joints of a motion that moves no mass; none if there is no such motion."""
    model, (C, c) = tree.pinocchio(), coupling(tree)
    leading = [joint.name for joint in tree.leading()]
    data, rng = model.createData(), np.random.default_rng(0)
    for _ in range(2):
        base = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        q = np.concatenate((base, C @ rng.uniform(-1.0, 1.0, len(leading)) + c))
        M = pin.crba(model, data, q)
        H = C.T @ (np.triu(M) + np.triu(M, 1).T)[6:, 6:] @ C
        scale = np.sqrt(H.diagonal().clip(0.0))
        if still := [name for name, s in zip(leading, scale, strict=True) if s * s <= _noise(H)]:
            return still
        values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
        if values[0] > SINGULAR:
            return []
    motion = np.abs(vectors[:, 0])
    return [name for name, x in zip(leading, motion, strict=True) if x > 0.1 * motion.max()]


def _noise(H: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> float:
    """Return what rounding leaves of an inertia [kg m^2] or mass [kg] that is zero."""
    return 1e-15 * float(np.abs(H).max())


def _some(names: Iterable[str]) -> str:
    """Return the first names, and how many more there are."""
    listed = [repr(name) for name in names]
    rest = len(listed) - SHOWN
    return ", ".join(listed[:SHOWN]) + (f" and {rest} more" if rest > 0 else "")
