"""Layers of the scene besides the arm: grid, obstacles, loads, workspaces and attitudes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Integers
from spacearm.collisions.obstacles import Obstacle
from spacearm.collisions.solids import corners
from spacearm.description.bodies import Inertial
from spacearm.description.shapes import faces
from spacearm.mission.attitudes import FeasibleAttitudes
from spacearm.mission.catch_report import Catch
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion
from spacearm.singularities.risk import RiskProfile
from spacearm.viewer import shapes
from spacearm.workspaces.path_dependent import Workspace

HERE = pin.SE3.Identity()
BLUE, VERMILION, TEAL, OLIVE = 0x0072B2, 0xD55E00, 0x009E73, 0x8A8A00
PALE, STEEL, SLATE, NEEDLE = 0x8B949E, 0x8A8F98, 0x5F6B7A, 0x7F7F7F
#: Layers, and their colours in the panel; red, green and blue are for axes alone.
LAYERS = {
    "grid": "#8b949e",
    "bodies": "#8a8f98",
    "centre of mass": "#7a4a00",
    "virtual manipulator": "#7b52c7",
    "tip frame": "#00914d",
    "ellipsoid": "#17becf",
    "directions": "#d6007f",
    "shells": "#56b4e9",
    "risk": "#f0e442",
    "attitudes": "#44aa99",
    "obstacles": "#5f6b7a",
    "target": "#8c6d1f",
    "wheels": "#009e73",
    "wrenches": "#8a8a00",
    "trace": "#d55e00",
    "goal": "#7d8794",
    "comparison": "#3a7ca5",
}


class Key(NamedTuple):
    """A line of the legend.

    Attributes:
        layer: The layer that it belongs to.
        colors: Its colours, from left to right.
        words: What they mean.
    """

    layer: str
    colors: tuple[str, ...]
    words: str

    @classmethod
    def of(cls, layer: str, color: int, words: str) -> Key:
        """Return the line of one colour."""
        return cls(layer, (f"#{color:06x}",), words)

    @classmethod
    def scale(cls, layer: str, ends: tuple[float, float], words: str) -> Key:
        """Return the line of the colours of values from one end to another."""
        colors = np.round(255.0 * shapes.distance_colors(np.linspace(*ends, 3))).astype(np.uint8)
        return cls(layer, tuple(f"#{color.tobytes().hex()}" for color in colors), words)


# --- grid ---------------------------------------------------------------------------------------

#: Number of squares along each side.
SQUARES = 20


class Grid(NamedTuple):
    """A grid about an axis of the inertial frame.

    Attributes:
        step: Side of a square [m].
        normal: The axis, 0 to 2.
        height: Its place along that axis [m].
        half: Half of its width [m].
    """

    step: float
    normal: int
    height: float
    half: float

    @classmethod
    def of(cls, size: float, normal: int, height: float) -> Grid:
        """Return the grid for a system of a radius [m]."""
        step = step_of(size)
        return cls(step, normal, height, step * SQUARES / 2)


def step_of(size: float) -> float:
    """Return the side of a square [m]: 1, 2 or 5 times a power of ten, at most half of a size."""
    most = 0.5 * size
    power = 10.0 ** np.floor(np.log10(most))
    return float(power * max(factor for factor in (1, 2, 5) if factor * power <= most))


def draw_grid(node: meshcat.Visualizer, grid: Grid) -> None:
    """Draw a grid as a node."""
    lines = g.PointsGeometry(grid_lines(grid).T.astype(np.float32))
    material = g.LineBasicMaterial(color=PALE, transparent=True, opacity=0.45, depthWrite=False)
    node.set_object(g.LineSegments(lines, material))


def grid_lines(grid: Grid) -> Array:
    """Return the ends (m, 3) of the lines, two by two."""
    places = grid.step * (np.arange(SQUARES + 1) - SQUARES / 2)
    end = grid.half
    ends = [[[x, -end], [x, end]] for x in places] + [[[-end, y], [end, y]] for y in places]
    return np.insert(np.array(ends).reshape(-1, 2), grid.normal, grid.height, axis=1)


# --- obstacles and loads ------------------------------------------------------------------------


class ObstacleLayer:
    """The obstacles of a motion, drawn under one node.

    Args:
        node: The node.
        obstacles: The obstacles.
    """

    def __init__(self, node: meshcat.Visualizer, obstacles: Sequence[Obstacle]) -> None:
        self._moving, number = [], itertools.count()
        for obstacle in obstacles:
            nodes = [node[str(next(number))] for _ in obstacle.parts]
            for part, pose, drawn in zip(obstacle.parts, obstacle.poses(0.0), nodes, strict=True):
                draw_triangles(drawn, faces(corners(part.shape)))
                drawn.set_transform(pose.homogeneous)
            if obstacle.moves:
                self._moving.append((obstacle, nodes))

    def draw(self, t: float) -> None:
        """Move those that move to where they are at a time [s]."""
        for obstacle, nodes in self._moving:
            for pose, node in zip(obstacle.poses(t), nodes, strict=True):
                node.set_transform(pose.homogeneous)


def draw_triangles(node: meshcat.Visualizer, triangles: Array) -> None:
    """Draw triangles (m, 3, 3) as a node, each flat."""
    numbers = np.arange(3 * len(triangles)).reshape(-1, 3)  # corners of their own
    mesh = g.TriangularMeshGeometry(triangles.reshape(-1, 3), numbers)
    node.set_object(mesh, g.MeshLambertMaterial(color=SLATE, opacity=0.6))


class TargetLayer:
    """The target of a catch, its grapple frames and the stand-off, drawn under one node.

    It tumbles until contact; from then on the hand carries it.

    Args:
        node: The node.
        catch: The catch.
        size: Radius of the system [m].
    """

    def __init__(self, node: meshcat.Visualizer, catch: Catch, size: float) -> None:
        self._node, self._catch = node, catch
        node.delete()
        begin = catch.begin + float(catch.plan.t[-1])
        places = [(pose, TEAL) for pose in catch.target.grapples.values()]
        where = catch.target.at(begin).pose
        places += [(where.actInv(tip), OLIVE) for tip in catch.plan[-1].tips]
        self._held = catch.chase[-1].tips[0].actInv(catch.target.at(catch.t).pose)
        draw_triangles(node["body"], np.concatenate(catch.target.drawn))
        for number, (pose, color) in enumerate(places):
            shapes.draw_axes(node["frames"][str(number)], 0.4 * size, color)
            node["frames"][str(number)].set_transform(pose.homogeneous)
        first = len(catch.target.grapples)
        self._standing = [node["frames"][str(i)] for i in range(first, len(places))]

    def draw(self, cfg: Configuration, t: float) -> None:
        """Move it to where it is at a time [s]."""
        free = t < self._catch.t
        pose = self._catch.target.at(t).pose if free else cfg.tips[0] * self._held
        self._node.set_transform(pose.homogeneous)
        for frame in self._standing:
            frame.set_property("visible", free)


#: Parts of a wrench: name, heads of the arrow, and the components.
PARTS = (("force", 1, slice(3)), ("torque", 2, slice(3, 6)))
#: Length of the arrow of the largest load, as a share of the size of the system.
LONGEST = 0.5
#: Least half axis of a held body, as a share of that size: a point mass is seen too.
LEAST = 0.03


class LoadLayer:
    """Loads of one configuration, or of a motion, in the layers "wheels", "wrenches" and "bodies".

    A ring stands about each wheel's axis, its arrow is what the wheel holds. Wrenches are drawn on
    the links that they push: the force as an arrow, the torque as one with two heads. Bodies that
    are held for a part of the motion are drawn as ellipsoids of uniform density with their mass and
    inertia.

    Args:
        root: The node that holds the layers.
        cfg: The configuration at the start.
        motion: The motion; None for a configuration alone.
        size: Radius of the system [m].
    """

    def __init__(
        self, root: meshcat.Visualizer, cfg: Configuration, motion: Motion | None, size: float
    ) -> None:
        self._wheels, self._wrenches, self._held = root["wheels"], root["wrenches"], []
        self._length, self._arm = LONGEST * size, cfg.arm
        self._t = np.zeros(1) if motion is None else motion.t
        self._spin: Any = getattr(motion, "wheels", None)
        self._push: Mapping[str, Array] = getattr(motion, "wrenches", {})
        for i in range(len(cfg.arm.wheels)):
            ring = self._wheels[str(i)]["ring"]
            material = g.MeshLambertMaterial(color=TEAL, opacity=0.5, transparent=True)
            ring.set_object(g.Cylinder(0.01 * size, 0.07 * size), material)
            _arrow(self._wheels[str(i)]["arrow"], TEAL, 1)
        for i in range(len(self._push)):
            for name, heads, _ in PARTS:
                _arrow(self._wrenches[str(i)][name], OLIVE, heads)
        self._bodies = root["bodies"]["held"]
        self._bodies.delete()
        holders = dict.fromkeys(run.arm for run in getattr(motion, "phases", ()))
        for i, holder in enumerate(holders):
            for link, body in holder.tree.links.items():
                if link not in cfg.arm.tree.links and body is not None:
                    node = self._bodies[str(i)][link]
                    material = g.MeshLambertMaterial(color=STEEL, opacity=0.6, transparent=True)
                    node.set_object(g.Sphere(1.0), material)
                    self._held.append((holder, link, ellipsoid(body, LEAST * size), node))

    def leave_bodies(self) -> None:
        """Leave out the bodies that are held, where they are drawn with their own shapes."""
        self._held.clear()
        self._bodies.delete()

    def draw(self, cfg: Configuration, t: float) -> None:
        """Draw the loads at a time, of a motion, or those of the configuration."""
        pose_of = shapes.link_poses(cfg.arm, cfg)
        for holder, link, shape, node in self._held:
            node.set_property("visible", holder is cfg.arm)
            if holder is cfg.arm:
                node.set_transform(pose_of(link).homogeneous @ shape)
        spin = cfg.wheels[None] if self._spin is None else self._spin
        most = float(np.abs(spin).max(initial=0.0))
        for i, wheel in enumerate(self._arm.wheels):
            joint = self._arm.tree.joints[wheel.name]
            place = pose_of(joint.parent) * joint.origin.translation
            axis = pose_of(joint.parent).rotation @ wheel.axis
            self._wheels[str(i)]["ring"].set_transform(shapes.along(place - axis, place + axis))
            self._point(self._wheels[str(i)]["arrow"], place, axis * self._now(spin, t)[i], most)
        for name, _, rows in PARTS:
            largest = (np.linalg.norm(x[:, rows], axis=1).max() for x in self._push.values())
            longest = max(map(float, largest), default=0.0)
            for i, (link, push) in enumerate(self._push.items()):
                node, place = self._wrenches[str(i)][name], pose_of(link).translation
                self._point(node, place, self._now(push, t)[rows], longest)

    def _now(self, values: Array, t: float) -> Array:
        """Return the values (m, k) at a time."""
        if len(values) == 1:
            return values[0]
        return np.array([np.interp(t, self._t, column) for column in values.T])

    def _point(self, node: meshcat.Visualizer, place: Array, load: Array, most: float) -> None:
        """Point an arrow from a place along a load; hide it where there is none."""
        size = float(np.linalg.norm(load))
        seen = most > 0.0 and size > 1e-3 * most
        node.set_property("visible", seen)
        if seen:
            length = self._length / most * size
            pose = shapes.along(place, place + self._length / most * load)
            node.set_transform(pose @ np.diag([length, length, length, 1.0]))


def _arrow(node: meshcat.Visualizer, color: int, heads: int) -> None:
    """Draw an arrow of length 1 along y about its middle."""
    node["shaft"].set_object(g.Cylinder(0.85, 0.02), shapes.overlay(color))
    node["shaft"].set_transform(shapes.at(np.array([0.0, -0.075, 0.0])))
    for i in range(heads):
        cone = g.Cylinder(0.18, radiusTop=0.0, radiusBottom=0.06)
        node[f"head_{i}"].set_object(cone, shapes.overlay(color))
        node[f"head_{i}"].set_transform(shapes.at(np.array([0.0, 0.41 - 0.15 * i, 0.0])))


def ellipsoid(body: Inertial, least: float) -> Array:
    """Return what makes a unit ball the ellipsoid (4, 4) of a body, in the frame of its link.

    A uniform ellipsoid of half axes a, b, c has the moments m (b^2 + c^2) / 5 and so on.
    """
    moments, axes = np.linalg.eigh(body.inertia)
    squares = 2.5 / body.mass * (moments.sum() - 2.0 * moments)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    shape = np.eye(4)
    shape[:3, :3] = axes * np.sqrt(np.maximum(squares, least**2))
    pose: Array = body.origin.homogeneous @ shape
    return pose


# --- workspaces and risk ------------------------------------------------------------------------

#: Points around a circle, and from the pole of half a sphere to its edge.
AROUND, DOWN = 96, 20


def draw_workspace(node: meshcat.Visualizer, space: Workspace, view: Array) -> list[Key]:
    """Draw the half of a workspace behind a cut, and its regions on the cut; rings in a plane.

    Args:
        node: The node to draw under, its origin at the centre.
        space: The workspace.
        view: (3,) direction from which the cut is seen.

    Returns:
        The legend.
    """
    node.delete()
    regions = {"path dependent": (VERMILION, space.pdw), "path independent": (BLUE, space.piw)}
    legend = []
    for name, (color, ranges) in regions.items():
        for i, (low, high) in enumerate(ranges):
            ring = g.TriangularMeshGeometry(*annulus(low, high, view))
            node[name][f"ring_{i}"].set_object(
                ring, shapes.film(0.4 if space.planar else 0.25, color)
            )
            for radius in () if space.planar else (low, high):
                if radius > 1e-6 * space.reachable[0, 1]:
                    half = half_sphere(radius, view)
                    node[name][f"{i}_{radius:.9g}"].set_object(half, shapes.glass(color, 0.25))
        if len(ranges):
            words = ", ".join(f"{low:.3f} to {high:.3f}" for low, high in ranges)
            legend.append(Key.of("shells", color, f"{name}: {words} m from the CM"))
    proof = "proven" if space.kind == "certified" else f"found, proven up to {space.gap:.2g} m"
    proof += "" if space.mode == "free-floating" else f"; spacecraft {space.mode}"
    return [key._replace(words=f"{key.words} ({proof})") for key in legend]


def draw_risk(node: meshcat.Visualizer, risk: RiskProfile, view: Array) -> list[Key]:
    """Draw a disc coloured by the share of postures near a singular one; see `draw_workspace`."""
    node.delete()
    most = float(np.nanmax(risk.share, initial=0.0))
    shares = np.nan_to_num(risk.share)
    colors = shapes.distance_colors(1.0 - shares / most if most > 0.0 else np.ones(len(shares)))
    rings = np.flatnonzero(risk.count)
    parts = [annulus(risk.edges[i], risk.edges[i + 1], view) for i in rings]
    vertices = np.concatenate([points for points, _ in parts])
    numbers = np.concatenate([faces + i * 2 * AROUND for i, (_, faces) in enumerate(parts)])
    painted = np.repeat(colors[rings], 2 * AROUND, axis=0)
    node["disc"].set_object(g.TriangularMeshGeometry(vertices, numbers, painted), shapes.film(0.7))
    words = f"postures within 5° of a singular one: 0 to {100 * most:.3g} %, by the tip's R"
    return [Key.scale("risk", (1.0, 0.0), words)]


def half_sphere(radius: float, view: Array) -> g.TriangularMeshGeometry:
    """Return the half of a sphere that is away from the viewer."""
    circle, toward = _circle(view)
    angle = np.linspace(0.0, np.pi / 2.0, DOWN + 1)[:, None, None]
    points = np.sin(angle) * circle - np.cos(angle) * toward
    return g.TriangularMeshGeometry(radius * points.reshape(-1, 3), shapes.strips(DOWN + 1, AROUND))


def annulus(low: float, high: float, view: Array) -> tuple[Array, Integers]:
    """Return the vertices (m, 3) and faces of a flat ring, facing the viewer."""
    circle, _ = _circle(view)
    return np.concatenate((low * circle, high * circle)), shapes.strips(2, AROUND)


def _circle(view: Array) -> tuple[Array, Array]:
    """Return a unit circle (AROUND, 3) that faces the viewer, and the direction to the viewer."""
    z = view / np.linalg.norm(view)
    x = np.cross(np.eye(3)[int(np.abs(z).argmin())], z)
    x /= np.linalg.norm(x)
    turn = 2.0 * np.pi * np.arange(AROUND)[:, None] / AROUND
    return np.cos(turn) * x + np.sin(turn) * np.cross(z, x), z


# --- attitudes ----------------------------------------------------------------------------------

#: Radii of the ring, and of the sphere, as shares of the size of the system.
INNER, OUTER = 0.42, 0.5
#: Least radius of the sphere, and of the ring, in radii of gyration of the spacecraft.
#:
#: The corners of a cube are at 2.1 of them.
OUTSIDE = 2.2
#: Corners of a patch of the sphere.
CORNERS = 10
#: Largest angle of a piece of the ring [rad].
FINEST = np.radians(2.0)


class AttitudeLayer:
    """The attitudes from which a path of the tip can be followed, and the attitude on show.

    Around the spacecraft of a spatial arm stands a sphere of the directions of its z axis,
    coloured by the share of feasible rolls. Around that of a planar arm stands a ring of the
    directions of the first axis in its plane. A needle shows where that axis points now.

    Args:
        node: The node to draw under.
        size: Radius of the system [m].
    """

    def __init__(self, node: meshcat.Visualizer, size: float) -> None:
        self._node, self._arm_size, self._size = node, size, size
        self._axis: int | None = None

    def show(self, found: FeasibleAttitudes) -> list[Key]:
        """Draw the attitudes in place of others.

        Returns:
            The legend.
        """
        self._node.delete()
        self._axis = 2 if found.axis is None else (found.axis + 1) % 3
        self._size = max(self._arm_size, _around(found.arm) / OUTER)
        shaft = g.Cylinder(1.0, 0.006 * self._size)
        solid = g.MeshLambertMaterial(color=NEEDLE)
        self._node["now"]["shaft"].set_object(shaft, solid)
        self._node["now"]["end"].set_object(g.Sphere(0.02 * self._size), solid)
        words = f"needle: the spacecraft's {'xyz'[self._axis]} axis now"
        drawn = (
            self._sphere(found) if found.intervals is None else self._ring(found, found.intervals)
        )
        return [*drawn, Key.of("attitudes", NEEDLE, words)]

    def draw(self, cfg: Configuration) -> None:
        """Follow the spacecraft."""
        if self._axis is None:
            return
        self._node.set_transform(shapes.at(cfg.base * cfg.arm.model.inertias[1].lever))
        end = OUTER * self._size * cfg.base.rotation[:, self._axis]
        self._node["now"]["shaft"].set_transform(shapes.bar(np.zeros(3), end))
        self._node["now"]["end"].set_transform(shapes.at(end))

    def _sphere(self, found: FeasibleAttitudes) -> list[Key]:
        directions, shares = found.by_direction
        vertices, faces = patches(directions, 0.65 * 2.0 / np.sqrt(len(directions)))
        painted = np.repeat(shapes.distance_colors(shares), CORNERS + 1, axis=0)
        mesh = g.TriangularMeshGeometry(OUTER * self._size * vertices, faces, painted)
        self._node["sphere"].set_object(mesh, shapes.film(0.9))
        words = "spacecraft's z axis: 0 to 100 % of the rolls about it feasible"
        return [Key.scale("attitudes", (0.0, 1.0), f"{words}; {_words(found)}")]

    def _ring(self, found: FeasibleAttitudes, intervals: Array) -> list[Key]:
        normal = int(found.axis or 0)
        axes = np.eye(3)[[(normal + 1) % 3, (normal + 2) % 3]]
        ends = intervals.ravel()
        rest = np.array([[-np.pi, np.pi]])
        if len(ends):
            rest = np.column_stack((ends[1::2], [*ends[2::2], ends[0] + 2.0 * np.pi]))
        for name, color, ranges in (("feasible", BLUE, intervals), ("not", VERMILION, rest)):
            for i, (low, high) in enumerate(ranges):
                if high > low:
                    vertices, faces = sector(low, high, axes)
                    mesh = g.TriangularMeshGeometry(self._size * vertices, faces)
                    self._node[name][str(i)].set_object(mesh, shapes.film(0.75, color))
        return [
            Key.of("attitudes", BLUE, f"feasible: {_words(found)}"),
            Key.of("attitudes", VERMILION, "spacecraft attitudes not feasible"),
        ]


def _words(found: FeasibleAttitudes) -> str:
    """Return what a key says of all attitudes."""
    said = found.describe()
    return "; ".join((said.verdict, *said.notes, f"margin {np.degrees(found.margin):.3g}°"))


def _around(arm: SpaceArm) -> float:
    """Return a radius about the spacecraft's centre of mass that its body hardly exceeds [m]."""
    body = arm.model.inertias[1]
    most = float(np.linalg.eigvalsh(body.inertia)[-1])
    return OUTSIDE * float(np.sqrt(most / body.mass)) if body.mass else 0.0


def patches(directions: Array, radius: float) -> tuple[Array, Integers]:
    """Return vertices and faces of small discs on the unit sphere.

    Args:
        directions: (m, 3) their middles.
        radius: Their radius.

    Returns:
        (m (CORNERS + 1), 3) vertices, the middle of each disc first; (m CORNERS, 3) faces.
    """
    least = np.eye(3)[np.abs(directions).argmin(axis=1)]
    across = np.cross(directions, least)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(directions, across)
    turn = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    edge = np.cos(turn)[:, None] * across[:, None] + np.sin(turn)[:, None] * other[:, None]
    rim = directions[:, None] + radius * edge
    vertices = np.concatenate((directions[:, None], rim), axis=1).reshape(-1, 3)
    corner = np.arange(CORNERS)
    one = np.stack((np.zeros(CORNERS, dtype=np.int64), corner + 1, (corner + 1) % CORNERS + 1), 1)
    first = (CORNERS + 1) * np.arange(len(directions))
    return vertices, (first[:, None, None] + one).reshape(-1, 3)


def sector(low: float, high: float, axes: Array) -> tuple[Array, Integers]:
    """Return vertices (m, 3) and faces of the ring from one angle to another in a plane.

    Args:
        low: First angle from the first axis to the second [rad].
        high: Last angle [rad].
        axes: (2, 3) axes of the plane.
    """
    angle = np.linspace(low, high, max(int(np.ceil((high - low) / FINEST)), 1) + 1)
    line = np.column_stack((np.cos(angle), np.sin(angle))) @ axes
    return np.concatenate((INNER * line, OUTER * line)), shapes.strips(2, len(line), closed=False)
