"""Masses: the mass data of a robot checked, and completed where mechanics leaves no doubt.

What counts in mechanics is the inertia of each rigid body, which may consist of several links, and
whether every joint moves some mass. So a fault of one link is a warning where the body that it is
part of is sound. A link without mass between two joints is fine as long as every motion of the
joints moves some mass.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description import shapes
from spacearm.description.bodies import LONGEST, TRIANGLE_TOLERANCE, Inertial
from spacearm.description.readers.source import Source
from spacearm.description.tree import Tree, coupling
from spacearm.errors import ModelError, listed

#: Eigenvalue of the scaled joint inertia up to which some motion moves no mass.
SINGULAR = 1e-10
#: Mass of a spacecraft, as a share of what moves on it, up to which it looks like a foot.
LIGHT = 0.2
ACCEPT = 'correct it, or load with check="warn" to accept it'


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
    estimated = dict[str, Inertial]()
    if source.reading.up_axes and not source.reading.known:
        tree = tree.upright()
    if source.reading.density is not None:
        estimated = of_density(source, tree, source.reading.density)
        tree = replace(tree, links={**tree.links, **estimated})
    _require_masses(source, tree)
    tree = with_flat_bodies(source, tree)
    _check_links(source, tree)
    if source.reading.check != "accept":
        tree = _without_idle_leaves(source, tree)
    _check_motions(source, tree)
    drawn = {} if source.reading.known else tree.visuals
    for doubt in implausible(replace(tree, visuals=drawn), estimated):
        source.warn(doubt)
    if source.reading.known:
        return tree
    if turned := shapes.lying(tree.visuals.values(), turned=True):
        source.note(f"meshes are turned by their up axes: {listed(turned)}")
    if ignored := shapes.ignored_axes(tree.visuals.values()):
        source.note(ignored)
    return tree


def _require_masses(source: Source, tree: Tree) -> None:
    """Refuse a spacecraft without mass, and a robot of which nothing that moves has mass."""
    masses = {leader: body.mass for leader, body in tree.bodies.items()}
    if source.reading.spacecraft and masses[tree.root] == 0.0:
        if not tree.freedoms and source.reading.rigid:
            source.fail(f"the root link {tree.root!r} has no mass", "give it a mass and an inertia")
        if not tree.freedoms:
            source.fail(
                f"the root link {tree.root!r} has no mass, and no joint can move",
                "describe the mass of the spacecraft and the joints of its arm",
            )
        source.fail(
            f"the spacecraft {tree.root!r}, the root link, has no mass (its <inertial> is zero or "
            "missing), as if this were an arm alone",
            f"mount it: sa.mount({str(source.path)!r}, sa.Bus(mass=..., size=...)); or give that "
            "link a mass and an inertia",
        )
    spacecraft = masses.pop(tree.root)
    moving = sum(masses.values())
    if source.reading.spacecraft and spacecraft < LIGHT * moving:
        source.note(
            f"the spacecraft {tree.root!r} has {spacecraft:.3g} kg, and what moves on it "
            f"{moving:.3g} kg, as if this were an arm alone: sa.mount puts it on one"
        )
    if masses and not any(masses.values()):
        source.fail(
            f"no movable link has mass: <inertial> is zero or missing in {_quoted(masses)}",
            "add it, or estimate it from their shapes: density=2700 [kg/m^3]"
            if source.reading.density is None
            else "add it, or the mesh files of their shapes: packages=[FOLDER]",
        )


def _check_links(source: Source, tree: Tree) -> None:
    """Refuse links that no rigid body can be, unless they are part of a body that is sound."""
    whole, check = tree.bodies, source.reading.check
    for leader, lump in tree.lumps.items():
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
                source.fail(f"link {link!r} {fault}", ACCEPT)
            elif check == "warn":
                source.warn(f"link {link!r} {fault}")
    root = whole[tree.root]
    if source.reading.spacecraft and _thin(root) and (fault := root.fault()):
        problem = f"the spacecraft {tree.root!r} has no inertia about some axis ({fault})"
        if check == "error":
            source.fail(problem, ACCEPT)
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
    carried |= {end: 1.0 for loop in tree.loops for end in loop[1:3] if end in carried}
    for joint in reversed(tree.depth_first()):
        carried[joint.parent] += carried[joint.child]
    movable, led = tree.movable(), coupling(tree)[0] != 0.0
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
    return tree.locked({joint.name: joint.rest for joint in idle})


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
        for leader, body in tree.bodies.items()
        if leader != tree.root and (body.mass == 0.0 or _thin(body))
    }
    if not weak:
        return
    say = source.note if source.reading.check == "accept" else source.warn
    if moving := _motion_without_mass(tree):
        problem = (
            f"a motion of {_quoted(moving)} moves no mass: no mass, or no inertia about some axis, "
            f"is given for {_quoted(weak)}"
        )
        ends = {link for loop in tree.loops for link in loop[1:3]}
        if not ends.isdisjoint(tree.marks):  # what a joint carries that closes a loop is cut off
            say = source.note
        elif source.reading.check == "error":
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
        say(f"links between joints without mass are taken as massless: {_quoted(massless)}")
    if thin := [leader for leader, body in weak.items() if _thin(body)]:
        say(f"bodies without inertia about some axis are taken as thin: {_quoted(thin)}")


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
        noise = 1e-15 * np.abs(H).max()  # what rounding leaves of an inertia that is zero
        if still := [name for name, s in zip(leading, scale, strict=True) if s * s <= noise]:
            return still
        values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
        if values[0] > SINGULAR:
            return []
    motion = np.abs(vectors[:, 0])
    return [name for name, x in zip(leading, motion, strict=True) if x > 0.1 * motion.max()]


def _quoted(names: Iterable[str]) -> str:
    return listed([repr(name) for name in names])


def of_density(source: Source, tree: Tree, density: float) -> dict[str, Inertial]:
    """Return mass properties for the links that have shapes and no mass, by link.

    Shapes are taken as solid; where shapes of a link overlap, both count, but for the ends of
    capsules. Those for collisions are used, else those that are drawn. A mesh that is not closed is
    taken as its convex hull.

    Args:
        source: The file.
        tree: Its links and shapes.
        density: Density [kg/m^3].

    Warns:
        ModelWarning: Links got mass properties, or got none for want of a usable shape.
    """
    found, bare, hulls = dict[str, Inertial](), list[str](), list[str]()
    for link, inertial in tree.links.items():
        solids = tree.visuals.get(link, shapes.Visuals())
        if (inertial is None or inertial.mass == 0.0) and any(solids):
            for those in (solids.collision, solids.visual):
                if (solid := solid_inertia(those)) is not None:
                    part = Inertial.of_spatial(solid)
                    found[link] = part.with_mass(density * part.mass)
                    hulls += [link] * any(map(_is_open, those))
                    break
            else:
                bare.append(link)
    if found:
        masses = ", ".join(f"{link!r} {part.mass:.4g} kg" for link, part in found.items())
        source.warn(f"density {density:g} kg/m^3 gives mass and inertia from shapes: {masses}")
    if hulls:
        source.warn(
            f"meshes of {_quoted(hulls)} are not closed and weigh as their convex hulls, which can "
            "be many times too much: compare with data of the robot, or give mass and inertia"
        )
    if bare:
        source.warn(f"density gives no mass to {_quoted(bare)}: no shapes, or unusable ones")
    return found


def solid_inertia(solids: Sequence[shapes.Shape]) -> pin.Inertia | None:
    """Return the inertia of solid shapes of density 1; None if no shape can be used."""
    parts: list[pin.Inertia] = []
    rest = list(solids)
    while rest:
        first = rest.pop(0)
        solid = _solid_of(first.geometry)
        if isinstance(first.geometry, shapes.Cylinder) and _round_ended(first, rest[:2]):
            solid = _of_primitive(coal.Capsule(*first.geometry))
            del rest[:2]
        if solid is not None and solid.mass > 0.0:
            parts.append(first.pose.act(solid))
    return sum(parts[1:], start=parts[0]) if parts else None


def _round_ended(cylinder: shapes.Shape, ends: Sequence[shapes.Shape]) -> bool:
    """Whether a cylinder and the two shapes behind it are a `capsule`."""
    _, *spheres = shapes.capsule(cylinder.pose, *cylinder.geometry)
    return len(ends) == 2 and all(
        end.geometry == sphere.geometry and end.pose.isApprox(sphere.pose)
        for end, sphere in zip(ends, spheres, strict=True)
    )


def _solid_of(geometry: shapes.Geometry) -> pin.Inertia | None:
    """Return the inertia of a solid geometry of density 1; None if it cannot be used."""
    match geometry:
        case shapes.Box(size):
            return _of_primitive(coal.Box(*size))
        case shapes.Sphere(radius):
            return _of_primitive(coal.Sphere(radius))
        case shapes.Cylinder(radius, length):
            return _of_primitive(coal.Cylinder(radius, length))
        case shapes.Mesh(_, Path() as file, scale):
            try:
                mesh = shapes.scaled_mesh(file, scale)
            except ModelError:
                return None
            solid = mesh if mesh.is_volume else mesh.convex_hull  # of one that is not closed
            centre, moments = np.array(solid.center_mass), np.array(solid.moment_inertia)
            return pin.Inertia(float(solid.volume), centre, moments)
    return None


def _is_open(shape: shapes.Shape) -> bool:
    """Whether a shape is a mesh without an inside, for which its convex hull stands."""
    match shape.geometry:
        case shapes.Mesh(_, Path() as file, scale):
            with suppress(ModelError):
                return not shapes.scaled_mesh(file, scale).is_volume
    return False


def _of_primitive(shape: coal.ShapeBase) -> pin.Inertia:
    """Return the inertia of a shape of density 1 about its centre."""
    moments = np.array(shape.computeMomentofInertia())
    return pin.Inertia(float(shape.computeVolume()), np.zeros(3), moments)


#: Share of the size of a robot by which centres of mass may lie out of one plane.
SAME_HEIGHT = 1e-6


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
    plates = {
        link: plate
        for link, part in tree.links.items()
        if part and (plate := _plate(part, tree.frames[link].rotation[axis])) is not None
    }
    if not plates or not _level(tree, axis):
        return tree
    source.warn(
        f"planar system: of {_quoted(plates)} only the moment of inertia about {'xyz'[axis]} is "
        "used, and half of it is taken about the axes in the plane, which does not count there"
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


def _level(tree: Tree, axis: int) -> bool:
    """Whether all centres of mass lie in one plane, as they must for a planar motion."""
    parts = ((link, part) for link, part in tree.links.items() if part)
    points = np.array([tree.frames[link].act(part.origin.translation) for link, part in parts])
    size = float(np.ptp(points, axis=0).max())
    return float(np.ptp(points[:, axis])) <= SAME_HEIGHT * max(size, 1.0)


#: How many times as long as the robot a radius of gyration may be.
FAR = 10.0
#: How many times as long as the robot what is drawn or collides may be: panels may be wide.
FAR_DRAWN = 30.0
#: Length [m] that a robot is taken to have at least, where its joints are close together.
LEAST_SIZE = 1.0


def implausible(tree: Tree, estimated: Mapping[str, Inertial]) -> list[str]:
    """Return what a body can have and no spacecraft has, as from wrong units, a sentence each.

    Inertias in kg mm^2, lengths in millimetres and masses in grams load without a fault. What
    betrays them is the radius of gyration of a body, sqrt(I / m), which is no longer than the robot
    itself. Meshes in millimetres give links whose mass is farther away than the robot is long, or
    that are drawn larger.

    Args:
        tree: Its links and joints.
        estimated: Mass properties of the links that got them from their shapes.
    """
    origins = {name: joint.origin.translation for name, joint in tree.joints.items()}
    lengths = {name: float(np.linalg.norm(place)) for name, place in origins.items()}
    found = [
        f"joint {name!r} is {length:.4g} m from the one before it, as if in millimetres"
        for name, length in lengths.items()
        if length > LONGEST
    ]
    described = {
        link: body
        for link, body in tree.bodies.items()
        if estimated.keys().isdisjoint(tree.lumps[link])
    }
    levers = [float(np.linalg.norm(body.origin.translation)) for body in described.values()]
    size = max(LEAST_SIZE, sum(lengths.values()), *levers)
    scale = (f"as if in millimetres; the robot is {size:.3g} m long: give its meshes a scale, as "
             "in scale='0.001 0.001 0.001'")  # fmt: skip
    for link, body in described.items():
        largest, radius = _gyration(body)
        if radius > FAR * size:
            found.append(
                f"body {link!r} of {body.mass:.4g} kg has an inertia of {largest:.4g} kg m^2, as "
                f"if its mass were {radius:.4g} m from its CM; the robot is {size:.3g} m long (SI "
                "units: kg m^2)"
            )
    for link, part in estimated.items():
        far = float(np.hypot(np.linalg.norm(part.origin.translation), _gyration(part)[1]))
        if far > min(FAR * size, LONGEST):
            found.append(
                f"link {link!r} has {part.mass:.4g} kg by its shapes, {far:.4g} m from its frame, "
                f"{scale}"
            )
    reaches = {
        link: max(shape.reach() for shape in (*solids.visual, *solids.collision))
        for link, solids in tree.visuals.items()
        if link not in estimated
    }
    if far_off := [link for link, far in reaches.items() if far > min(FAR_DRAWN * size, LONGEST)]:
        found.append(
            f"shapes of {_quoted(far_off)} reach {max(reaches.values()):.4g} m from the frame of "
            f"their link, {scale}"
        )
    return found


def _gyration(body: Inertial) -> tuple[float, float]:
    """Return the largest moment of inertia [kg m^2] and radius of gyration [m] of a body."""
    largest = float(np.linalg.eigvalsh(body.inertia)[-1])
    return largest, math.sqrt(max(largest, 0.0) / body.mass) if body.mass > 0.0 else 0.0
