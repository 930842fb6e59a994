"""Stage: an arm on show, its scene in layers that can be hidden, and the motion that plays."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Sequence
from itertools import cycle, pairwise
from typing import Any

import meshcat
import meshcat.geometry as g
import numpy as np
import pinocchio as pin
from meshcat.animation import AnimationClip

from spacearm.arrays import Array
from spacearm.collisions.obstacles import Obstacle
from spacearm.errors import SpaceArmError, UnsupportedError
from spacearm.mechanics.barycentric_formulation import barycentric
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.mission.catch_report import Catch
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion
from spacearm.singularities.report import SingularityReport, singularity
from spacearm.viewer import layers, shapes
from spacearm.viewer.layers import Grid, draw_grid
from spacearm.viewer.motions import Comparison, some
from spacearm.viewer.readouts import FAR, NEAR, joint_map
from spacearm.viewer.session import Session
from spacearm.viewer.window import Window
from spacearm.workspaces.path_dependent import centre_of

AXES = (0xD62728, 0x00914D, 0x1F4FD8)
BROWN, PURPLE, CYAN, AMBER, MAGENTA, PINK = (
    0x7A4A00, 0x7B52C7, 0x17BECF, 0xF5A800, 0xD6007F, 0xF065B5,
)  # fmt: skip
SHELL_COLORS = (0x56B4E9, 0xD55E00, 0x009E73, 0xCC79A7)

#: Largest number of points of a drawn path.
MOST_POINTS = 400
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
        self.bodies = shapes.Bodies(self.root["bodies"], arm)
        centre, self.size = _extent(arm)
        normal, below = arm.tree.plane_normal(), float(centre[2]) - self.size
        self.grid = Grid.of(self.size, *((2, below) if normal is None else (normal, 0.0)))
        draw_grid(self.root["grid"]["lines"], self.grid)
        self._draw_markers()
        for name in ("/Grid", "/Axes"):  # meshcat's own, of one metre
            meshcat.Visualizer(window=window)[name].set_property("visible", False)

    def _draw_markers(self) -> None:
        size, arrow = self.size, self.root["directions"]
        self.root["centre of mass"]["ball"].set_object(
            g.Sphere(0.022 * size), shapes.overlay(BROWN)
        )
        for axis, color in enumerate(AXES):
            node = self.root["tip frame"]["axes"][str(axis)]
            node.set_object(g.Cylinder(0.14 * size, 0.005 * size), shapes.overlay(color))
            node.set_transform(shapes.along(np.zeros(3), 0.14 * size * np.eye(3)[axis]))
        ball = g.MeshLambertMaterial(color=CYAN, opacity=0.35)
        self.root["ellipsoid"]["body"].set_object(g.Sphere(1.0), ball)
        for name, color in (("lost", MAGENTA), ("weak", PINK)):
            _double_arrow(arrow[name], color)
        arrow["line"].set_object(g.Cylinder(1.0, 0.007 * size), shapes.overlay(AMBER))
        disc = g.Cylinder(0.004 * size, 0.3 * size)
        arrow["plane"].set_object(disc, g.MeshBasicMaterial(color=AMBER, opacity=0.3))
        arrow["turn"].set_object(_ring(0.16 * size, 0.008 * size), shapes.overlay(MAGENTA))

    # --- at every configuration -------------------------------------------------------------

    def draw(self, cfg: Configuration, report: SingularityReport, tip: pin.SE3) -> None:
        """Draw the ellipsoid and directions of a configuration.

        Args:
            cfg: The configuration.
            report: Its singularity report.
            tip: Where they are drawn.
        """
        self._draw_ellipsoid(cfg, report, tip.translation)
        self._draw_directions(cfg, report, tip.translation)

    def move(self, cfg: Configuration, tip: pin.SE3) -> None:
        """Move what needs no Jacobian: bodies, centre of mass, tip and virtual manipulator."""
        self.bodies.place(cfg)
        self.root["centre of mass"].set_transform(shapes.at(cfg.com))
        self.root["tip frame"].set_transform(tip.homogeneous)
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
                layer[str(i)].set_object(g.Cylinder(1.0, 0.006 * self.size), shapes.overlay(PURPLE))
                layer[f"joint_{i}"].set_object(g.Sphere(0.013 * self.size), shapes.overlay(PURPLE))
            layer[str(i)].set_transform(shapes.bar(start, end))
            layer[f"joint_{i}"].set_transform(shapes.at(end))

    def _draw_ellipsoid(self, cfg: Configuration, report: SingularityReport, tip: Array) -> None:
        J, task = generalized_jacobian(cfg, mode=report.mode)[:3], cfg.arm.task
        if len(report.jacobian) < task.k or not np.allclose(tip, cfg.tips[0].translation):  # held
            linear = [i for i in task.indices[: len(report.jacobian)] if i < 3]
            rows = (report.length or 1.0) * report.jacobian[: len(linear)]
            J = report.axes[:, linear] @ rows
        U, sigma, _ = np.linalg.svd(J)
        radii = np.zeros(3)
        radii[: len(sigma)] = ELLIPSOID_SECONDS * sigma
        pose = shapes.at(tip)
        U[:, 2] *= np.sign(np.linalg.det(U))
        pose[:3, :3] = U * np.maximum(radii, 0.004 * self.size)
        self.root["ellipsoid"]["body"].set_transform(pose)

    def _draw_directions(self, cfg: Configuration, report: SingularityReport, tip: Array) -> None:
        layer = self.root["directions"]
        singular = report.kind != "regular"
        twist = np.zeros(6)
        rows = len(cfg.arm.task.rows)  # those of the first tip
        way = (report.lost if singular else report.available)[:rows, -1]
        twist[cfg.arm.task.indices[:rows]] = way
        linear, angular = report.axes @ twist[:3], report.axes @ twist[3:]
        moves, turns = np.linalg.norm(linear) > 0.3, np.linalg.norm(angular) > 0.3
        _show(layer["lost"], singular and moves)
        _show(layer["weak"], report.distance < NEAR and not singular and moves)
        _show(layer["turn"], singular and turns)
        if moves:
            direction = linear / np.linalg.norm(linear)
            pose = shapes.along(tip - direction, tip + direction)
            pose[:3, :3] *= 0.3 * self.size
            for name in ("lost", "weak"):
                layer[name].set_transform(pose)
        if turns:
            layer["turn"].set_transform(shapes.along(tip - angular, tip + angular))
        self._draw_available(layer, tip, report, cfg.arm.task.indices[:rows])

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
            layer["line"].set_transform(shapes.bar(tip - reach, tip + reach))
        if rank == 2 and len(linear) == 3:
            layer["plane"].set_transform(shapes.along(tip - axes[:, 2], tip + axes[:, 2]))

    # --- on request -----------------------------------------------------------------------

    def shells(self, radii: Sequence[float]) -> None:
        """Draw translucent spheres of radii [m] about the system CM."""
        layer = self.root["shells"]
        layer.delete()
        for i, (radius, color) in enumerate(zip(radii, cycle(SHELL_COLORS), strict=False)):
            material = g.MeshLambertMaterial(color=color, opacity=0.12, depthWrite=False)
            layer[str(i)].set_object(g.Sphere(radius), material)

    def trace(self, points: Array, values: Array) -> None:
        """Draw a path (m, 3) [m], coloured by values (m,): vermilion at 0, yellow, blue at 1."""
        rows = some(len(points), MOST_POINTS)
        geometry = shapes.tube(
            points[rows], shapes.distance_colors(values[rows]), 0.006 * self.size
        )
        material = g.MeshBasicMaterial(
            vertexColors=True, transparent=True, depthTest=False, depthWrite=False, side=0
        )  # of a tube the outside alone
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
    node["shaft"].set_object(g.Cylinder(1.7, 0.035), shapes.overlay(color))
    for sign in (1.0, -1.0):
        head = node[f"head{sign:+.0f}"]
        head.set_object(g.Cylinder(0.25, radiusTop=0.0, radiusBottom=0.1), shapes.overlay(color))
        head.set_transform(shapes.along(np.array([0, 0.75 * sign, 0]), np.array([0, sign, 0])))


def _ring(radius: float, thickness: float) -> g.TriangularMeshGeometry:
    """Make a torus about the y axis."""
    import trimesh

    torus = trimesh.creation.torus(radius, thickness)  # about z
    return g.TriangularMeshGeometry(torus.vertices[:, [1, 2, 0]], torus.faces)


#: Largest number of frames of a motion in a page; each takes some kilobytes.
MOST_FRAMES = 9000
#: Largest number of maps that a saved page has of a motion.
MOST_MAPS = 25
#: Largest number of postures along a motion that the page moves through by itself.
MOST_POSES = 600
FRAMES_PER_SECOND = 15
#: Direction from which workspaces of spatial arms are cut open: the page's, but level.
VIEW = np.array([0.55, -0.75, 0.0])
#: Layers that belong to a motion.
PLAYED = ("target", "wheels", "wrenches", "trace", "goal", "comparison")


class Stage:
    """An arm on show in a window, and the motion that plays, if there is one.

    Attributes:
        session: The configuration on show.
        scene: Its drawing.
        motion: The motion; None if there is none.
        other: What it is compared with.
        obstacles: All that are on show.
        time: The time on show [s].
        played: How often another motion or comparison came on show.
        hidden: Layers that are not shown.
        legend: What the colours of workspaces, risk and attitudes mean.
    """

    def __init__(self, window: Window, session: Session, motion: Motion | None = None) -> None:
        self.session, self.scene, self._window = session, Scene(window, session.arm), window
        self.hidden: set[str] = set()
        self.played = -1
        self.legend: list[layers.Key] = []
        self._centre: BaseMode = "free-floating"
        self._around: tuple[Obstacle, ...] = ()
        self._attitudes = layers.AttitudeLayer(self.scene.root["attitudes"], self.scene.size)
        self.play(motion)

    def play(self, motion: Motion | None) -> None:
        """Show a motion from its start, in place of the present one."""
        self.motion, self.time = motion, float(motion.t[0]) if motion else 0.0
        root, session = self.scene.root, self.session
        for name in PLAYED if self.played >= 0 else ():
            root[name].delete()
            self.show_layer(name, name not in self.hidden)
        self._goal = root["goal"]["frame"]
        shapes.draw_axes(self._goal, self.scene.size, shapes.VIOLET)
        if motion:
            session.spacecraft = motion.mode
            session.show(motion[0])
        self._target: layers.TargetLayer | None = None
        self.obstruct(self._around)
        self._loads = layers.LoadLayer(root, session.cfg, motion, self.scene.size)
        self.compare(None)
        if motion and len(motion.arm.tips) == 1:  # several tips have no one path
            self.scene.trace(motion.tip[:, :3], motion.distance / FAR)
            end = shapes.Ghost(root["goal"]["end"], motion.arm, self.scene.size, shapes.GHOST, 0.2)
            end.place(motion[len(motion) - 1])

    def obstruct(self, around: tuple[Obstacle, ...]) -> None:
        """Draw obstacles besides those of the motion."""
        self._around = around
        own: tuple[Obstacle, ...] = tuple(getattr(self.motion, "obstacles", ()))
        names = {obstacle.name for obstacle in own}
        self.obstacles = (*own, *(one for one in around if one.name not in names))
        node = self.scene.root["obstacles"]
        node.delete()
        self._obstacle_layer = layers.ObstacleLayer(node, self.obstacles)
        self.show_layer("obstacles", "obstacles" not in self.hidden)

    def show_target(self, catch: Catch) -> None:
        """Draw the target of the catch that plays, in the hand too."""
        self._loads.leave_bodies()
        self._target = layers.TargetLayer(self.scene.root["target"], catch, self.scene.size)
        self.draw()

    def show_computed(self, layer: str, result: Any) -> None:
        """Draw workspaces, the risk or feasible attitudes in the layer of that name."""
        if layer == "attitudes":
            keys = self._attitudes.show(result)
        else:
            normal = self.scene.arm.tree.plane_normal()
            view = VIEW if normal is None else np.eye(3)[normal]  # in the frame of the layer
            draw = layers.draw_workspace if layer == "shells" else layers.draw_risk
            keys = draw(self.scene.root[layer], result, view)
        if layer == "shells":
            self._centre = result.mode
        self.legend = [key for key in self.legend if key.layer != layer] + keys
        self.show_layer(layer, True)

    def compare(self, other: Comparison | None) -> None:
        """Show another motion in step with the present one; none if None."""
        self.other, self._ghost = other, None
        self.played += 1
        node = self.scene.root["comparison"]
        if other is None:
            node.delete()
        else:
            self._ghost = shapes.Ghost(node, other.motion.arm, self.scene.size, shapes.STEEL, 0.45)
        self.show_layer("comparison", "comparison" not in self.hidden)
        self.draw()

    def show_layer(self, name: str, visible: bool) -> None:
        """Show or hide a layer."""
        self.hidden = self.hidden - {name} if visible else self.hidden | {name}
        self.scene.root[name].set_property("visible", visible)

    def seek(self, t: float) -> None:
        """Go to a time [s]."""
        if self.motion:
            self.time = float(np.clip(t, *self.span))
            self.session.show(self.motion.at(self.time))

    @property
    def span(self) -> tuple[float, float]:
        """First and last time of the motions [s]."""
        played = [motion for motion in (self.motion, self.other and self.other.motion) if motion]
        return min(float(m.t[0]) for m in played), max(float(m.t[-1]) for m in played)

    def draw(self) -> None:
        """Draw the configuration on show."""
        self._draw(self.session.cfg, self.session.report, self.time)

    def _draw(self, cfg: Configuration, report: SingularityReport, t: float) -> None:
        self._move(cfg, t)
        self.scene.draw(cfg, report, self.session.place(cfg))
        pose = np.eye(4)
        if self.scene.arm.tree.plane_normal() is not None:
            pose[:3, :3] = cfg.base.rotation
        centres: dict[str, BaseMode] = {"shells": self._centre, "risk": "free-floating"}
        for layer, mode in centres.items():
            pose[:3, 3] = centre_of(cfg, mode)
            self.scene.root[layer].set_transform(pose)
        self._attitudes.draw(cfg)
        goal = self.session.goal
        self._goal.set_property("visible", goal is not None)
        if goal is not None:
            self._goal.set_transform(goal.homogeneous)

    def _move(self, cfg: Configuration, t: float) -> None:
        """Move what follows from the postures alone."""
        self.scene.move(cfg, self.session.place(cfg))
        self._loads.draw(cfg, t)
        self._obstacle_layer.draw(t)
        if self._target:
            self._target.draw(cfg, t)
        if self.other and self._ghost:
            self._ghost.place(self.other.motion.at(t))

    def animate(self) -> None:
        """Record the motion into the window."""
        if not (motion := self.motion):
            return

        def draw(cfg: Configuration, t: float) -> None:
            self._draw(cfg, singularity(cfg, mode=motion.mode), t)

        self._window.send(self._recorded(motion, MOST_FRAMES, draw))

    def maps(self) -> list[dict[str, Any]]:
        """Return the map of two joints at the posture, or at postures along the motion."""
        if self.motion is None:
            starts = [(0.0, self.session.cfg, self.session.spacecraft)]
        else:
            most = MOST_MAPS if self.motion.arm.n > 2 else 1
            times = [float(t) for t in np.linspace(*self.span, most)]
            starts = [(t, self.motion.at(t), self.motion.mode) for t in times]
        try:
            return [{"t": t, **joint_map(cfg, None, mode)} for t, cfg, mode in starts]
        except SpaceArmError:  # one of the arms that have none
            return []

    def poses(self) -> dict[str, Any]:
        """Return where things are along the motion, for the page to move them in every frame."""
        if not self.motion:
            return {"played": self.played, "nodes": {}}
        tips: list[Array] = []

        def move(cfg: Configuration, t: float) -> None:
            self._move(cfg, t)
            tips.append(self.session.place(cfg).translation)

        recorder = self._recorded(self.motion, MOST_POSES, move)
        nodes = recorder.poses(len(tips))
        nodes["/spacearm/ellipsoid/body"] = np.array(tips)
        first, last = self.span
        packed = {
            path: base64.b64encode(rows.astype("<f4").tobytes()).decode()
            for path, rows in nodes.items()
        }
        played = {"played": self.played, "first": first, "last": last}
        return {**played, "rows": len(tips), "nodes": packed}

    def _recorded(
        self, motion: Motion, most: int, draw: Callable[[Configuration, float], None]
    ) -> Recorder:
        """Record what is drawn along the motion, in at most so many frames."""
        first, last = self.span
        recorder = Recorder()
        self._window.recorder = recorder
        try:
            frames = min(math.ceil((last - first) * FRAMES_PER_SECOND) + 1, most)
            for t in np.linspace(first, last, frames):
                recorder.frame = float(t - first) * FRAMES_PER_SECOND
                draw(motion.at(float(t)), float(t))
        finally:
            self._window.recorder = None
        return recorder


class Recorder:
    """Takes drawing commands in place of the window and keeps what changes, frame by frame.

    It is a command of meshcat itself: the animation.

    Attributes:
        frame: The frame that commands belong to.
    """

    def __init__(self) -> None:
        self.frame = 0.0
        self._clips: dict[str, AnimationClip] = {}

    def __call__(self, content: dict[str, Any]) -> None:
        """Record a lowered set_transform or set_property command at the current frame."""
        new = AnimationClip(fps=FRAMES_PER_SECOND, name="motion")
        clip = self._clips.setdefault(content["path"], new)
        if content["type"] == "set_property":
            clip.set_property(self.frame, content["property"], "bool", content["value"])
        elif content["type"] == "set_transform":
            matrix = np.array(content["matrix"]).reshape(4, 4).T
            scale = np.linalg.norm(matrix[:3, :3], axis=0)
            turn = pin.Quaternion(matrix[:3, :3] / scale).normalized().coeffs()
            clip.set_property(self.frame, "position", "vector3", matrix[:3, 3].tolist())
            clip.set_property(self.frame, "scale", "vector3", scale.tolist())
            clip.set_property(self.frame, "quaternion", "quaternion", turn.tolist())

    def poses(self, frames: int) -> dict[str, Array]:
        """Return (frames, 7) position [m] and quaternion x, y, z, w of nodes placed in each."""
        tracks = {path: clip.tracks for path, clip in self._clips.items()}
        return {
            path: np.hstack((found["position"].values, found["quaternion"].values))
            for path, found in tracks.items()
            if "position" in found and len(found["position"].values) == frames
        }

    def lower(self) -> dict[str, Any]:
        """Return the animation as a meshcat command."""
        return {
            "type": "set_animation",
            "path": "",
            "options": {"play": False, "repetitions": 1},
            "animations": [
                {"path": path, "clip": clip.lower()} for path, clip in self._clips.items()
            ],
        }
