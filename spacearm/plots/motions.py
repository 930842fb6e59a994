"""Motions among obstacles: figures 5 and 6 of Papadopoulos & Dubowsky (1993), for any arm."""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from matplotlib.patches import Circle

from spacearm.arrays import Array, ArrayLike, finite, shape_of
from spacearm.collisions.solids import corners
from spacearm.description.shapes import faces
from spacearm.mechanics.target import Target
from spacearm.model.arm import Configuration
from spacearm.motion.goal import goal_axes
from spacearm.motion.motion import Motion
from spacearm.plots import style
from spacearm.plots.configurations import draw_posture
from spacearm.plots.triangles import draw_solids, draw_target, placed, stand_ins
from spacearm.plots.workspaces import draw_ring
from spacearm.results import short_names

if TYPE_CHECKING:
    from spacearm.closure.regrasping import Regrasp
    from spacearm.collisions.obstacles import Obstacle
    from spacearm.collisions.separation import CollisionReport
    from spacearm.motion.flights import Flight
    from spacearm.workspaces.path_dependent import Workspace

#: Opacities of the postures that are drawn behind the tip path, from its start to its end.
FADES = (0.15, 0.25, 0.35, 0.55)
#: Distance of a singular posture found beyond which curves are cut [deg].
FAR = 45.0


@style.draws()
def draw_motion(
    motion: Motion | Regrasp,
    ax: Any,
    *,
    target: ArrayLike | None = None,
    workspace: Workspace | None = None,
) -> Any:
    """Draw a motion: tip path (figure 5), attitude, joints (figure 6), distance from singularities.

    Components are along the goal axes, so that a tilted plane is drawn as a flat one.

    Args:
        motion: The motion, from `sa.simulate`, `sa.follow` or `sa.plan`, or another one.
        target: (3,) a point to mark on the tip path [m], or (2,) in the plane of a planar arm.
        workspace: Of a planar arm, to draw its shells about the system CM.
        ax: Axes for the tip path, three-dimensional ones for a spatial arm, and for attitude,
            wheels if there are any, joints and distance; or a figure or subfigure; None for a new
            figure.

    Raises:
        ConfigurationError: The target has another shape or is not finite.
    """
    motion = motion if isinstance(motion, Motion) else motion.motion
    mark = None if target is None else _in_picture(motion, target)
    held = getattr(motion, "wheels", np.empty((len(motion), 0)))
    spatial = motion.arm.tree.plane_normal() is None

    def parts(whole: Any) -> list[Any]:
        left, right = whole.subfigures(1, 2, width_ratios=[1.0, 1.1])
        path = left.add_subplot(projection="3d" if spatial else None)
        return [path, *right.subplots(3 + bool(held.size), 1, sharex=True)]

    whole, panels = style.panels_for(ax, parts, 11.0, 6.4)
    path, attitude, joints, *wheels, nearness = panels
    title = f"{motion.arm.name}, {motion.story}{stand_ins(motion.arm)}"
    style.headline(None if whole is None else path.figure, panels, title)
    _draw_path(path, motion, mark, workspace)
    _draw_attitude(attitude, motion)
    for axes in wheels:
        _draw_wheels(axes, motion, held)
    _draw_joints(joints, motion)
    _draw_distance(nearness, motion)
    nearness.set_xlabel("time [s]")
    for axes in (attitude, joints, *wheels, nearness):
        for t in motion.singular_times:
            axes.axvline(t, color=style.RED, lw=0.8, ls=":", alpha=0.7)
    if whole is not None:
        whole.align_ylabels()
    return path


@style.draws(size=(8.6, 8.4), panels=lambda whole: whole.subplots(5, 1, sharex=True))
def draw_flight(flight: Flight, panels: Any) -> None:
    """Draw the time line of a flight: joint rates, margin, turning, wheels, forces at the tip.

    Args:
        flight: The flight.
        panels: Where it is drawn.
    """
    rates, nearness, turning, wheels, tip = panels
    t, arm, begins = flight.t, flight.arm, flight.begins
    scale = np.where(arm.slides, 1.0, 180.0 / np.pi)
    style.draw_curves(rates, t, flight.dq * scale, short_names(arm.joint_names))
    rates.set_ylabel(f"joint rates\n[{'deg/s, m/s' if arm.slides.any() else 'deg/s'}]")
    _draw_distance(nearness, flight)
    turning.plot(t, np.degrees(flight.turning), color=style.BLUE)
    turning.set(ylabel="spacecraft\nturns [deg/s]", ylim=(0.0, None))
    _draw_wheels(wheels, flight, flight.wheels)
    loads = np.linalg.norm(flight.tip_wrench.reshape(len(flight), -1, 2, 3), axis=3)
    force, moment = loads.max(axis=1).T  # of several hands the most
    tip.plot(t, force, color=style.ORANGE, label="N")
    tip.plot(t, moment, color=style.GREEN, label="N m")
    tip.set(ylabel="force, moment\nat the tip", xlabel="time [s]", ylim=(0.0, None))
    for axes in (rates, tip):
        _legend(axes)
    for axes in panels:
        for begin in begins[1:]:
            axes.axvline(begin, color=style.GREY, lw=0.8, ls="--", zorder=0)
    ends = [*begins[1:], t[-1]]
    for number, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        rates.axvspan(
            begin,
            end,
            ymin=0.94,
            color=style.COLOURS[number % len(style.COLOURS)],
            alpha=0.35,
            lw=0,
        )
    times = zip(flight.names, begins, strict=True)
    style.entitle(
        rates, f"{arm.name}: " + ", ".join(f"{name} from {at:.4g} s" for name, at in times)
    )


def _in_picture(motion: Motion, target: ArrayLike) -> Array:
    """Return the components of a point to draw: 3, or the 2 in the plane of a planar arm."""
    normal, meaning = motion.arm.tree.plane_normal(), "[m]"
    if normal is None:
        return finite(target, (3,), "target", meaning)
    in_plane = shape_of(target) == (2,)
    x = finite(target, (2,) if in_plane else (3,), "target", f"{meaning}, or 2 in the plane")
    return x if in_plane else np.delete(x @ goal_axes(motion[0]), normal)


def _draw_distance(axes: Any, motion: Motion) -> None:
    axes.plot(motion.t, np.minimum(np.degrees(motion.distance), FAR), color=style.RED, lw=1.8)
    axes.set(ylabel="to a singular\nposture found [deg]", ylim=(0.0, FAR))
    axes.set_yticks((0.0, 15.0, 30.0, FAR), ("0", "15", "30", f"over {FAR:g}"))


def _draw_path(
    axes: Any, motion: Motion, target: Array | None, workspace: Workspace | None
) -> None:
    """Draw the tip path with a few postures of the arm, faint, and what happens on the way."""
    normal = motion.arm.tree.plane_normal()
    along = goal_axes(motion[0])
    paths = _tip_paths(motion, along)
    singular = _at_times(next(iter(paths.values())), motion)
    for cfg, alpha in zip(_snapshots(motion, along), FADES, strict=False):
        draw_posture(axes, cfg, label=False, alpha=alpha)
    _draw_obstacles(axes, motion, along, tuple(i for i in range(3) if i != normal))
    if normal is not None:
        paths = {name: np.delete(x, normal, axis=1) for name, x in paths.items()}
        singular = np.delete(singular, normal, axis=1)
        axes.grid(alpha=0.3)
        if workspace is not None:
            _draw_shells(axes, np.delete(motion[0].com @ along, normal), workspace)
    for (name, x), color in zip(paths.items(), cycle(style.COLOURS), strict=False):
        axes.plot(*x.T, color=color, lw=2, label=name, zorder=style.IN_FRONT)
    starts, ends = (np.array([x[row] for x in paths.values()]) for row in (0, -1))
    marks: list[tuple[str, Array, str, str]] = [
        ("start", starts, "o", style.BLUE),
        ("end", ends, "s", style.BLUE),
    ]
    if len(singular):
        times = f" ({len(singular)} times)" * (len(singular) > 1)
        marks.append((f"singular{times}", singular, "x", style.RED))
    if target is not None:
        marks.append(("target", target[None], "*", style.GREEN))
    for label, points, marker, color in marks:
        size = 13 if marker == "*" else 7
        axes.plot(
            *points.T, marker, color=color, ms=size, mew=2, label=label, zorder=style.IN_FRONT
        )
    axes.legend(loc="upper right", fontsize=9)
    if normal is None:
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_box_aspect(None, zoom=0.85)  # room for the label of the vertical axis


def _tip_paths(motion: Motion, along: Array) -> dict[str, Array]:
    """Return the path (m, 3) of each tip, by its name where there are several."""
    if len(motion.arm.tips) == 1:
        return {"tip": motion.tip[:, :3] @ along}
    tips = [motion[i].tips for i in range(len(motion))]
    places = np.array([[tip.translation for tip in row] for row in tips])
    return {name: places[:, i] @ along for i, name in enumerate(short_names(motion.arm.tips))}


def _at_times(x: Array, motion: Motion) -> Array:
    """Return the points (k, 3) of a path (m, 3) at the times of singular postures."""
    columns = [np.interp(motion.singular_times, motion.t, column) for column in x.T]
    return np.stack(columns, axis=1)


def _snapshots(motion: Motion, along: Array) -> list[Configuration]:
    """Return a few postures, evenly spaced along the tip paths, in the axes of the picture."""
    paths = np.stack(list(_tip_paths(motion, along).values()))
    steps = np.linalg.norm(np.diff(paths, axis=1), axis=2).sum(axis=0)
    way = np.concatenate(([0.0], np.cumsum(steps)))
    times = np.interp(np.linspace(0.0, way[-1], len(FADES)), way, motion.t)
    turn = pin.SE3(along.T, np.zeros(3))
    return [cfg.arm.at(cfg.q, base=turn * cfg.base) for cfg in map(motion.at, times)]


def _draw_shells(axes: Any, com: Array, workspace: Workspace) -> None:
    """Draw the path dependent shells and the edge of the reachable workspace."""
    x, y = map(float, com)
    outer = float(workspace.reachable[0, 1])
    axes.add_patch(Circle((x, y), outer, facecolor="none", edgecolor=style.GREY, lw=1.2))
    for low, high in workspace.pdw:
        draw_ring(axes, (x, y), low, high, 0.0, facecolor=style.ORANGE, alpha=0.3, lw=0)
    low, high = workspace.pdw[-1] if len(workspace.pdw) else (outer, outer)
    at, look = (x, y - 0.5 * (low + high)), {"ha": "center", "va": "center", "fontsize": 9}
    axes.text(*at, "path dependent", color=style.GREY, **look)
    axes.plot(x, y, "P", color="black", ms=7)


def _draw_attitude(axes: Any, motion: Motion) -> None:
    along = goal_axes(motion[0]).T
    rotations = [along @ pin.XYZQUATToSE3(pose).rotation for pose in motion.base]
    turns = np.degrees([pin.log3(R) for R in rotations])
    normal = motion.arm.tree.plane_normal()
    if normal is None:
        style.draw_curves(axes, motion.t, turns, "xyz", lw=1.8)
        _legend(axes)
        axes.set_ylabel("rotation\nvector [deg]")
    else:
        axes.plot(motion.t, np.unwrap(turns[:, normal], period=360.0), color=style.BLUE, lw=1.8)
        axes.set_ylabel("attitude\n[deg]")


def _draw_joints(axes: Any, motion: Motion) -> None:
    arm = motion.arm
    q = motion.q * np.where(arm.slides, 100.0, 180.0 / np.pi)
    style.draw_curves(axes, motion.t, q, short_names(arm.joint_names), lw=1.5)
    _legend(axes)
    unit = "cm" if arm.slides.all() else "deg" if not arm.slides.any() else "deg, cm"
    axes.set_ylabel(f"joints\n[{unit}]")


def _draw_wheels(axes: Any, motion: Motion, held: Array) -> None:
    names = tuple(wheel.name for wheel in motion.arm.wheels)
    style.draw_curves(axes, motion.t, held, short_names(names), lw=1.5)
    axes.set_ylabel("wheels\n[N m s]")
    if names:
        _legend(axes)
    else:
        axes.text(0.5, 0.5, "no wheels", transform=axes.transAxes, ha="center", color=style.GREY)


def _legend(axes: Any) -> None:
    """Name the curves to the right of the axes."""
    style.legend_beside(axes, fontsize=8, handlelength=1.2)


OPACITY = 0.35


def _draw_obstacles(axes: Any, motion: Motion, along: Array, rows: tuple[int, ...]) -> None:
    """Draw the obstacles of a motion, if it has any, at its end and faint at its start."""
    begin, end = motion.t[[0, -1]].tolist()
    for obstacle in getattr(motion, "obstacles", ()):
        if obstacle.moves:
            draw_solids(axes, _solids_of(obstacle, begin, along), rows, 0.3 * OPACITY)
        draw_solids(axes, _solids_of(obstacle, end, along), rows, OPACITY, obstacle.name)


def _solids_of(obstacle: Obstacle, t: float, along: Array) -> list[tuple[Array, str]]:
    """Return the triangles of each part of an obstacle at a time, along axes, and its colour."""
    placing = zip(obstacle.parts, obstacle.poses(t), strict=True)
    return [
        (placed(faces(corners(part.shape)), pose) @ along, style.GREY) for part, pose in placing
    ]


@style.draws(size=(6.4, 5.6), spatial=lambda _: True)
def draw_alone(thing: Target | Obstacle, axes: Any) -> None:
    """Draw a target or an obstacle where it is at time 0, in inertial axes.

    Args:
        thing: The target or the obstacle.
        axes: Where it is drawn, three-dimensional ones.
    """
    if isinstance(thing, Target):
        draw_target(axes, thing, (0, 1, 2))
    else:
        draw_solids(axes, _solids_of(thing, 0.0, np.eye(3)), (0, 1, 2), 1.0)
    style.equal_axes(axes)
    style.entitle(axes, f"{thing.name} at 0 s")


@style.draws(size=(7.0, 4.0))
def draw_collision_report(result: CollisionReport, axes: Any) -> None:
    """Draw the least distance between bodies, less the margins of obstacles: over time, if any.

    Args:
        result: The report.
        axes: Where it is drawn.
    """
    label = "least distance, less margins [m]"
    if len(result.t) == 1:
        axes.barh([0], result.distance, height=0.5, color=style.BLUE)
        axes.bar_label(axes.containers[0], fmt="{:.3g} m", padding=4)
        axes.axvline(0.0, color=style.RED, lw=1.2)
        axes.set(xlabel=label, yticks=[0], yticklabels=["posture"], ylim=(-1.0, 1.0))
        axes.margins(x=0.15)
    else:
        axes.plot(result.t, result.distance, color=style.BLUE, lw=1.8)
        axes.axhline(0.0, color=style.RED, lw=1.2)
        axes.set(xlabel="time [s]", ylabel=label)
    a, b = result.nearest
    left = f" ({len(result.unchecked)} links NOT checked)" * bool(result.unchecked)
    verdict = f"apart, proven{left}" if result.apart else "bodies meet"
    style.entitle(axes, f"{verdict}; nearest:\n{a}, {b}")
