"""Scene: the drawing of a configuration, in layers that can be hidden."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError
from spacearm.mechanics.barycentric_formulation import barycentric
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.singularities.report import SingularityReport
from spacearm.viewer.layers.grid import Grid, draw_grid
from spacearm.viewer.layers.paths import distance_colors, tube
from spacearm.viewer.layers.shapes import along, shapes
from spacearm.viewer.panel.readouts import NEAR
from spacearm.viewer.window import Window

AXES = (0xD62728, 0x00914D, 0x1F4FD8)
BROWN, PURPLE, CYAN, AMBER, MAGENTA, PINK = (
    0x7A4A00, 0x7B52C7, 0x17BECF, 0xF5A800, 0xD6007F, 0xF065B5,
)  # fmt: skip

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
    "wheels": "#009e73",
    "wrenches": "#8a8a00",
    "trace": "#d55e00",
    "goal": "#7d8794",
    "comparison": "#3a7ca5",
}
"""Layers, and their colours in the panel; red, green and blue are for axes alone."""

MOST_POINTS = 600
"""Largest number of points of a drawn path."""
ELLIPSOID_SECONDS = 0.3
"""Scale of the ellipsoid: the tip motion in this time at joint rates of 1 rad/s or 1 m/s."""


class Scene:
    """The drawing of one arm in a window.

    Attributes:
        root: The node that everything is drawn under.
        arm: The arm.
        size: Radius of the system at q = 0 [m].
        grid: The grid.
        shapes: What is drawn of each link.
    """

    def __init__(self, window: Window, arm: SpaceArm) -> None:
        self.root = meshcat.Visualizer(window=window)["/spacearm"]
        self.arm = arm
        self._data = pin.Data(arm.model)
        self._links: dict[str, int] = {}
        self._virtual_links = 0
        self._draw_bodies()
        centre, self.size = self._extent(arm.at(np.zeros(arm.n)))
        normal, below = arm.tree.plane_normal(), float(centre[2]) - self.size
        self.grid = Grid.of(self.size, *((2, below) if normal is None else (normal, 0.0)))
        draw_grid(self._layer("grid")["lines"], self.grid)
        self._draw_markers()
        for name in ("/Grid", "/Axes"):  # meshcat's own, of one metre
            meshcat.Visualizer(window=window)[name].set_property("visible", False)

    # --- once -----------------------------------------------------------------------------

    def _layer(self, name: str) -> meshcat.Visualizer:
        return self.root[name]

    def _draw_bodies(self) -> None:
        self.shapes = shapes(self.arm)
        for i, shape in enumerate(self.shapes):
            self._links[shape.link] = self.arm.model.getFrameId(shape.link, pin.BODY)
            node = self._layer("bodies")[_name(shape.link)][str(i)]
            r, gr, b, opacity = shape.color
            color = (int(255 * r) << 16) + (int(255 * gr) << 8) + int(255 * b)
            node.set_object(shape.geometry, g.MeshPhongMaterial(color=color, opacity=opacity))
            node.set_transform(shape.pose)

    def _draw_markers(self) -> None:
        size = self.size
        ball = self._layer("centre of mass")["ball"]
        ball.set_object(g.Sphere(0.022 * size), _overlay(BROWN))
        tip = self._layer("tip frame")["axes"]
        for axis, color in enumerate(AXES):
            node = tip[str(axis)]
            node.set_object(g.Cylinder(0.14 * size, 0.005 * size), _overlay(color))
            node.set_transform(along(np.zeros(3), 0.14 * size * np.eye(3)[axis]))
        ellipsoid = self._layer("ellipsoid")["body"]
        ellipsoid.set_object(g.Sphere(1.0), g.MeshPhongMaterial(color=CYAN, opacity=0.35))
        arrow = self._layer("directions")
        for name, color in (("lost", MAGENTA), ("weak", PINK)):
            _arrow(arrow[name], color)
        arrow["line"].set_object(g.Cylinder(1.0, 0.007 * size), _overlay(AMBER))
        disc = g.Cylinder(0.004 * size, 0.3 * size)
        arrow["plane"].set_object(disc, g.MeshBasicMaterial(color=AMBER, opacity=0.3))
        arrow["turn"].set_object(_ring(0.16 * size, 0.008 * size), _overlay(MAGENTA))

    # --- at every configuration -------------------------------------------------------------

    def draw(self, cfg: Configuration, report: SingularityReport) -> None:
        """Draw the ellipsoid and directions of a configuration.

        Args:
            cfg: The configuration.
            report: Its singularity report.
        """
        self._draw_ellipsoid(cfg, report.mode)
        self._draw_directions(cfg, report)

    def move(self, cfg: Configuration) -> None:
        """Move what needs no Jacobian: bodies, centre of mass, tip and virtual manipulator."""
        pin.framesForwardKinematics(self.arm.model, self._data, cfg.full)
        bodies = self._layer("bodies")
        for link, frame in self._links.items():
            bodies[_name(link)].set_transform(self._data.oMf[frame].homogeneous)
        self._layer("centre of mass").set_transform(_at(cfg.com))
        self._layer("tip frame").set_transform(cfg.tip.homogeneous)
        self._draw_virtual_manipulator(cfg)

    def _draw_virtual_manipulator(self, cfg: Configuration) -> None:
        try:
            points = barycentric(cfg).virtual_manipulator.points
        except UnsupportedError:
            return  # arms with prismatic joints or movable side branches have none
        layer = self._layer("virtual manipulator")
        for i, (start, end) in enumerate(pairwise(points)):
            if i >= self._virtual_links:
                self._virtual_links += 1
                layer[str(i)].set_object(g.Cylinder(1.0, 0.006 * self.size), _overlay(PURPLE))
                layer[f"joint_{i}"].set_object(g.Sphere(0.013 * self.size), _overlay(PURPLE))
            stretch = np.diag([1.0, max(float(np.linalg.norm(end - start)), 1e-9), 1.0, 1.0])
            layer[str(i)].set_transform(along(start, end) @ stretch)
            layer[f"joint_{i}"].set_transform(_at(end))

    def _draw_ellipsoid(self, cfg: Configuration, mode: BaseMode) -> None:
        U, sigma, _ = np.linalg.svd(generalized_jacobian(cfg, mode=mode)[:3])
        radii = np.zeros(3)
        radii[: len(sigma)] = ELLIPSOID_SECONDS * sigma
        pose = _at(cfg.tip.translation)
        U[:, 2] *= np.sign(np.linalg.det(U))
        pose[:3, :3] = U * np.maximum(radii, 0.004 * self.size)
        self._layer("ellipsoid")["body"].set_transform(pose)

    def _draw_directions(self, cfg: Configuration, report: SingularityReport) -> None:
        layer, tip = self._layer("directions"), cfg.tip.translation
        indices = cfg.arm.task.indices
        singular = report.kind != "regular"
        weakest = (report.lost if singular else report.available)[:, -1]
        twist = np.zeros(6)
        twist[indices] = weakest
        linear, angular = report.axes @ twist[:3], report.axes @ twist[3:]
        near = report.distance < NEAR
        moves, turns = np.linalg.norm(linear) > 0.3, np.linalg.norm(angular) > 0.3
        _show(layer["lost"], singular and moves)
        _show(layer["weak"], near and not singular and moves)
        _show(layer["turn"], singular and turns)
        if moves:
            direction = linear / np.linalg.norm(linear)
            pose = along(tip - direction, tip + direction)
            pose[:3, :3] *= 0.3 * self.size
            for name in ("lost", "weak"):
                layer[name].set_transform(pose)
        if turns:
            layer["turn"].set_transform(along(tip - angular, tip + angular))
        self._draw_available(layer, tip, report, indices, singular)

    def _draw_available(
        self,
        layer: meshcat.Visualizer,
        tip: Array,
        report: SingularityReport,
        indices: Sequence[int],
        singular: bool,
    ) -> None:
        """Draw the line or the plane in which the tip can still move."""
        linear = [row for row, index in enumerate(indices) if index < 3]
        columns = [indices[row] for row in linear]
        U, sigma, _ = np.linalg.svd(report.jacobian[linear]) if linear else (np.eye(0), [], None)
        rank = int(np.count_nonzero(np.asarray(sigma) > report.tolerance * report.sigma[0]))
        axes = report.axes[:, columns] @ U if linear else np.zeros((3, 0))
        _show(layer["line"], singular and rank == 1)
        _show(layer["plane"], singular and rank == 2 and len(linear) == 3)
        if rank == 1:
            reach = 0.3 * self.size * axes[:, 0]
            pose = along(tip - reach, tip + reach) @ np.diag([1.0, 0.6 * self.size, 1.0, 1.0])
            layer["line"].set_transform(pose)
        if rank == 2 and len(linear) == 3:
            normal = axes[:, 2]
            pose = along(tip - normal, tip + normal)
            layer["plane"].set_transform(pose)

    # --- on request -----------------------------------------------------------------------

    def show_layer(self, name: str, visible: bool) -> None:
        """Show or hide a layer."""
        self._layer(name).set_property("visible", visible)

    def shells(self, radii: Sequence[tuple[float, int]]) -> None:
        """Draw translucent spheres about the system CM, of pairs of radius [m] and colour."""
        layer = self._layer("shells")
        layer.delete()
        for i, (radius, color) in enumerate(radii):
            material = g.MeshPhongMaterial(color=color, opacity=0.12, depthWrite=False)
            layer[str(i)].set_object(g.Sphere(radius), material)

    def trace(self, points: Array, values: Array) -> None:
        """Draw a path (m, 3) [m], coloured by values (m,): vermilion at 0, yellow, blue at 1."""
        rows = np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS)).round().astype(int)
        geometry = tube(points[rows], distance_colors(values[rows]), 0.006 * self.size)
        material = g.MeshBasicMaterial(
            vertexColors=True, transparent=True, depthTest=False, depthWrite=False
        )
        self._layer("trace")["line"].set_object(geometry, material)

    def _extent(self, cfg: Configuration) -> tuple[Array, float]:
        """Compute centre (3,) and radius of a ball around the system [m]."""
        model = self.arm.model
        pin.framesForwardKinematics(model, self._data, cfg.full)
        base = model.inertias[1]
        gyration = 1.3 * np.sqrt(float(np.trace(base.inertia)) / (2.0 * base.mass))
        points = np.array([M.translation for M in list(self._data.oMf)[1:]])
        body = self._data.oMi[1].act(base.lever)
        low = np.minimum(points.min(axis=0), body - gyration)
        high = np.maximum(points.max(axis=0), body + gyration)
        return (low + high) / 2.0, max(float(np.linalg.norm(high - low)) / 2.0, 1e-3)


def _name(link: str) -> str:
    """Return a link's name as one element of a meshcat path."""
    return link.replace("/", "\u2215")


def _at(position: Array) -> Array:
    """Return the pose (4, 4) at a position (3,), unrotated."""
    pose = np.eye(4)
    pose[:3, 3] = position
    return pose


def _overlay(color: int, opacity: float = 1.0) -> g.MeshLambertMaterial:
    """Make a material that is seen through the bodies in front of it."""
    return g.MeshLambertMaterial(
        color=color, opacity=opacity, transparent=True, depthTest=False, depthWrite=False
    )


def _show(node: meshcat.Visualizer, visible: bool | np.bool_) -> None:
    node.set_property("visible", bool(visible))


def _arrow(node: meshcat.Visualizer, color: int) -> None:
    """Draw a double arrow of half length 1 along y."""
    node["shaft"].set_object(g.Cylinder(1.7, 0.035), _overlay(color))
    for sign in (1.0, -1.0):
        head = node[f"head{sign:+.0f}"]
        head.set_object(g.Cylinder(0.25, radiusTop=0.0, radiusBottom=0.1), _overlay(color))
        head.set_transform(along(np.array([0, 0.75 * sign, 0]), np.array([0, sign, 0])))


def _ring(radius: float, thickness: float) -> g.TriangularMeshGeometry:
    """Make a torus about the y axis."""
    import trimesh

    torus = trimesh.creation.torus(radius, thickness)  # about z
    return g.TriangularMeshGeometry(torus.vertices[:, [1, 2, 0]], torus.faces)
