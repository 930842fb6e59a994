"""Scene: the drawing of a configuration, in layers that can be hidden."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, pairwise

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
from spacearm.viewer.layers import Grid, draw_grid
from spacearm.viewer.motions import some
from spacearm.viewer.readouts import NEAR
from spacearm.viewer.shapes import Bodies, along, at, bar, distance_colors, overlay, tube
from spacearm.viewer.window import Window

AXES = (0xD62728, 0x00914D, 0x1F4FD8)
BROWN, PURPLE, CYAN, AMBER, MAGENTA, PINK = (
    0x7A4A00, 0x7B52C7, 0x17BECF, 0xF5A800, 0xD6007F, 0xF065B5,
)  # fmt: skip
SHELL_COLORS = (0x56B4E9, 0xD55E00, 0x009E73, 0xCC79A7)

#: Largest number of points of a drawn path.
MOST_POINTS = 600
#: Scale of the ellipsoid: the tip motion in this time at joint rates of 1 rad/s or 1 m/s.
ELLIPSOID_SECONDS = 0.3


class Scene:
    """The drawing of one arm in a window.

    Attributes:
        root: The node that everything is drawn under.
        arm: The arm.
        size: Radius of the system at q = 0 [m].
        grid: The grid.
        bodies: What is drawn of its links.
    """

    def __init__(self, window: Window, arm: SpaceArm) -> None:
        self.root = meshcat.Visualizer(window=window)["/spacearm"]
        self.arm = arm
        self._virtual_links = 0
        self.bodies = Bodies(self.root["bodies"], arm)
        centre, self.size = _extent(arm)
        normal, below = arm.tree.plane_normal(), float(centre[2]) - self.size
        self.grid = Grid.of(self.size, *((2, below) if normal is None else (normal, 0.0)))
        draw_grid(self.root["grid"]["lines"], self.grid)
        self._draw_markers()
        for name in ("/Grid", "/Axes"):  # meshcat's own, of one metre
            meshcat.Visualizer(window=window)[name].set_property("visible", False)

    def _draw_markers(self) -> None:
        size, arrow = self.size, self.root["directions"]
        self.root["centre of mass"]["ball"].set_object(g.Sphere(0.022 * size), overlay(BROWN))
        for axis, color in enumerate(AXES):
            node = self.root["tip frame"]["axes"][str(axis)]
            node.set_object(g.Cylinder(0.14 * size, 0.005 * size), overlay(color))
            node.set_transform(along(np.zeros(3), 0.14 * size * np.eye(3)[axis]))
        ball = g.MeshPhongMaterial(color=CYAN, opacity=0.35)
        self.root["ellipsoid"]["body"].set_object(g.Sphere(1.0), ball)
        for name, color in (("lost", MAGENTA), ("weak", PINK)):
            _double_arrow(arrow[name], color)
        arrow["line"].set_object(g.Cylinder(1.0, 0.007 * size), overlay(AMBER))
        disc = g.Cylinder(0.004 * size, 0.3 * size)
        arrow["plane"].set_object(disc, g.MeshBasicMaterial(color=AMBER, opacity=0.3))
        arrow["turn"].set_object(_ring(0.16 * size, 0.008 * size), overlay(MAGENTA))

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
        self.bodies.place(cfg)
        self.root["centre of mass"].set_transform(at(cfg.com))
        self.root["tip frame"].set_transform(cfg.tip.homogeneous)
        self._draw_virtual_manipulator(cfg)

    def _draw_virtual_manipulator(self, cfg: Configuration) -> None:
        try:
            points = barycentric(cfg).virtual_manipulator.points
        except UnsupportedError:
            return  # arms with prismatic joints or movable side branches have none
        layer = self.root["virtual manipulator"]
        for i, (start, end) in enumerate(pairwise(points)):
            if i >= self._virtual_links:
                self._virtual_links += 1
                layer[str(i)].set_object(g.Cylinder(1.0, 0.006 * self.size), overlay(PURPLE))
                layer[f"joint_{i}"].set_object(g.Sphere(0.013 * self.size), overlay(PURPLE))
            layer[str(i)].set_transform(bar(start, end))
            layer[f"joint_{i}"].set_transform(at(end))

    def _draw_ellipsoid(self, cfg: Configuration, mode: BaseMode) -> None:
        U, sigma, _ = np.linalg.svd(generalized_jacobian(cfg, mode=mode)[:3])
        radii = np.zeros(3)
        radii[: len(sigma)] = ELLIPSOID_SECONDS * sigma
        pose = at(cfg.tip.translation)
        U[:, 2] *= np.sign(np.linalg.det(U))
        pose[:3, :3] = U * np.maximum(radii, 0.004 * self.size)
        self.root["ellipsoid"]["body"].set_transform(pose)

    def _draw_directions(self, cfg: Configuration, report: SingularityReport) -> None:
        layer, tip = self.root["directions"], cfg.tip.translation
        singular = report.kind != "regular"
        twist = np.zeros(6)
        twist[cfg.arm.task.indices] = (report.lost if singular else report.available)[:, -1]
        linear, angular = report.axes @ twist[:3], report.axes @ twist[3:]
        moves, turns = np.linalg.norm(linear) > 0.3, np.linalg.norm(angular) > 0.3
        _show(layer["lost"], singular and moves)
        _show(layer["weak"], report.distance < NEAR and not singular and moves)
        _show(layer["turn"], singular and turns)
        if moves:
            direction = linear / np.linalg.norm(linear)
            pose = along(tip - direction, tip + direction)
            pose[:3, :3] *= 0.3 * self.size
            for name in ("lost", "weak"):
                layer[name].set_transform(pose)
        if turns:
            layer["turn"].set_transform(along(tip - angular, tip + angular))
        self._draw_available(layer, tip, report, cfg.arm.task.indices)

    def _draw_available(
        self, layer: meshcat.Visualizer, tip: Array, report: SingularityReport, rows: Sequence[int]
    ) -> None:
        """Draw the line or the plane in which the tip can still move."""
        linear = [row for row, index in enumerate(rows) if index < 3]
        U, sigma, _ = np.linalg.svd(report.jacobian[linear])
        rank = int(np.count_nonzero(sigma > report.tolerance * report.sigma[0]))
        axes = report.axes[:, [rows[row] for row in linear]] @ U
        singular = report.kind != "regular"
        _show(layer["line"], singular and rank == 1)
        _show(layer["plane"], singular and rank == 2 and len(linear) == 3)
        if rank == 1:
            reach = 0.3 * self.size * axes[:, 0]
            layer["line"].set_transform(bar(tip - reach, tip + reach))
        if rank == 2 and len(linear) == 3:
            layer["plane"].set_transform(along(tip - axes[:, 2], tip + axes[:, 2]))

    # --- on request -----------------------------------------------------------------------

    def shells(self, radii: Sequence[float]) -> None:
        """Draw translucent spheres of radii [m] about the system CM."""
        layer = self.root["shells"]
        layer.delete()
        for i, (radius, color) in enumerate(zip(radii, cycle(SHELL_COLORS), strict=False)):
            material = g.MeshPhongMaterial(color=color, opacity=0.12, depthWrite=False)
            layer[str(i)].set_object(g.Sphere(radius), material)

    def trace(self, points: Array, values: Array) -> None:
        """Draw a path (m, 3) [m], coloured by values (m,): vermilion at 0, yellow, blue at 1."""
        rows = some(len(points), MOST_POINTS)
        geometry = tube(points[rows], distance_colors(values[rows]), 0.006 * self.size)
        material = g.MeshBasicMaterial(
            vertexColors=True, transparent=True, depthTest=False, depthWrite=False
        )
        self.root["trace"]["line"].set_object(geometry, material)


def _extent(arm: SpaceArm) -> tuple[Array, float]:
    """Compute centre (3,) and radius of a ball around the system at q = 0 [m]."""
    data = pin.Data(arm.model)
    pin.framesForwardKinematics(arm.model, data, arm.at(np.zeros(arm.n)).full)
    base = arm.model.inertias[1]
    gyration = 1.3 * np.sqrt(float(np.trace(base.inertia)) / (2.0 * base.mass))
    body = data.oMi[1].act(base.lever)
    points = [M.translation for M in list(data.oMf)[1:]]
    low = np.min([*points, body - gyration], axis=0)
    high = np.max([*points, body + gyration], axis=0)
    return (low + high) / 2.0, max(float(np.linalg.norm(high - low)) / 2.0, 1e-3)


def _show(node: meshcat.Visualizer, visible: bool | np.bool_) -> None:
    node.set_property("visible", bool(visible))


def _double_arrow(node: meshcat.Visualizer, color: int) -> None:
    """Draw a double arrow of half length 1 along y."""
    node["shaft"].set_object(g.Cylinder(1.7, 0.035), overlay(color))
    for sign in (1.0, -1.0):
        head = node[f"head{sign:+.0f}"]
        head.set_object(g.Cylinder(0.25, radiusTop=0.0, radiusBottom=0.1), overlay(color))
        head.set_transform(along(np.array([0, 0.75 * sign, 0]), np.array([0, sign, 0])))


def _ring(radius: float, thickness: float) -> g.TriangularMeshGeometry:
    """Make a torus about the y axis."""
    import trimesh

    torus = trimesh.creation.torus(radius, thickness)  # about z
    return g.TriangularMeshGeometry(torus.vertices[:, [1, 2, 0]], torus.faces)
