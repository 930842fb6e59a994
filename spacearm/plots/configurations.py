"""Configurations, in the plane or in space: figures 1 to 3 of Papadopoulos & Dubowsky (1993)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pinocchio as pin
from matplotlib.colors import is_color_like, to_hex

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.mechanics.barycentric_formulation import Barycentric, VirtualManipulator
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.plots import style
from spacearm.plots.triangles import bare, draw_bodies, draw_target, stand_ins
from spacearm.results import short_names
from spacearm.signatures import shown
from spacearm.singularities.nearest import NearestSingular
from spacearm.singularities.report import singularity

if TYPE_CHECKING:
    from spacearm.closure.held_report import HeldReport
    from spacearm.closure.holding import Held
    from spacearm.uncertainty.intervals import UncertainArm
    from spacearm.workspaces.path_dependent import Region

#: Share of a chain's length below which a link is too short for a label.
LEAST = 0.08
#: Width and height of a figure [inch].
SIZE = (7.2, 6.0)


@style.draws()
def draw_configuration(
    cfg: Configuration,
    ax: Any,
    *,
    color: str | Sequence[float] = style.GREY,
    label: bool = True,
    velocities: bool = False,
) -> Any:
    """Draw spacecraft, arm and system CM: in the plane for planar arms, in space for others.

    Args:
        cfg: The configuration.
        ax: Matplotlib axes to draw into, three-dimensional ones for a spatial arm; None for a new
            figure.
        color: Colour of the arm.
        label: Whether to name the system CM and the tip.
        velocities: Whether to draw what unit joint rates give to the tip, and the lost direction:
            for planar arms whose task is the position of the tip.

    Raises:
        ConfigurationError: Matplotlib knows no such colour.
    """
    if not is_color_like(color):
        raise ConfigurationError(f"color is {shown(color)}; give a colour of Matplotlib, as 'red'")
    axes = style.axes_for(ax, *SIZE, spatial=not in_plane(cfg))
    draw_posture(axes, cfg, color=to_hex(cast("Any", color)), label=label)
    if velocities:
        draw_velocities(axes, cfg)
    style.entitle(axes, f"{cfg.arm.name}: spacecraft, arm and system CM (+){stand_ins(cfg.arm)}")
    return axes


@style.draws(size=SIZE, spatial=lambda result: not in_plane(result.configuration))
def draw_held(result: Held | HeldReport, axes: Any) -> None:
    """Draw the arms and what they hold.

    Args:
        result: A closed posture, or a report of one.
        axes: Where they are drawn.
    """
    cfg = result.configuration
    if result.target is not None:
        draw_target(axes, result.target, _rows(cfg) if in_plane(cfg) else (0, 1, 2))
    draw_posture(axes, cfg)
    style.entitle(axes, result.describe().headline)


@style.draws()
def draw_arm(
    arm: SpaceArm, ax: Any, *, color: str | Sequence[float] = style.GREY, label: bool = True
) -> Any:
    """Draw an arm with all joints at zero, or at the limit next to zero.

    Args:
        arm: The arm.
        ax: Matplotlib axes to draw into, three-dimensional ones for a spatial arm; None for a new
            figure.
        color: Colour of the arm.
        label: Whether to name the system CM and the tip.
    """
    at_rest = arm.at(np.clip(0.0, arm.lower, arm.upper))
    return draw_configuration(at_rest, ax, color=color, label=label)


def in_plane(cfg: Configuration) -> bool:
    """Return whether the arm moves in a plane of inertial axes."""
    normal = cfg.arm.tree.plane_normal()
    return normal is not None and abs(cfg.base.rotation[normal, normal]) > 1.0 - 1e-9


def draw_posture(
    axes: Any,
    cfg: Configuration,
    *,
    color: str = style.GREY,
    label: bool = True,
    alpha: float = 1.0,
) -> None:
    """Draw the bodies of an arm and of its spacecraft, joints and tips, and the system CM.

    Bodies are drawn by their visuals at their size; links without as lines from joint to joint.

    Args:
        axes: Matplotlib axes: three-dimensional ones unless `in_plane`.
        cfg: The configuration.
        color: Colour of the arm.
        label: Whether to name the system CM and the tips.
        alpha: Opacity.

    Raises:
        UnsupportedError: The axes are flat, and the arm does not move in a plane.
    """
    arm, rows = cfg.arm, (0, 1, 2) if axes.name == "3d" else _rows(cfg)
    draw_bodies(axes, cfg, rows, color, alpha)
    over, without = {"zorder": style.IN_FRONT, "alpha": alpha}, set(bare(arm))
    for name in arm.tips:
        places, links = _places(cfg, name)
        places = places[:, rows]
        for i, link in enumerate(links):
            if arm.tree.body_of[link] in without:
                axes.plot(*places[i : i + 2].T, "-", color=color, lw=5, alpha=alpha)
        axes.plot(*places.T, "-o", color=color, lw=1.2, ms=5, mfc="white", mec=color, **over)
    axes.plot(*cfg.com[list(rows), None], marker="P", ms=9, color="black", ls="none", **over)
    if label:
        com = cfg.com[list(rows)]
        for name, pose in zip(short_names(arm.tips), cfg.tips, strict=True):
            tip = pose.translation[list(rows)]
            away = tip - com if len(rows) == 2 else style.UP  # from the arm, as far as it is known
            style.annotate(axes, "tip" if len(arm.tips) == 1 else name, tip, color, towards=away)
        style.annotate(axes, "CM", com, "black", towards=-away)
    axes.margins(0.12)
    style.equal_axes(axes, "".join("xyz"[i] for i in rows))


@style.draws()
def draw_uncertain(result: UncertainArm, ax: Any) -> Any:
    """Draw the arm as described.

    Args:
        result: The arm with its uncertain numbers.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    return draw_arm(result.arm, ax)


@style.draws(size=SIZE, spatial=lambda result: len(style.flat_rows(result.points)) == 3)
def draw_virtual_manipulator_alone(result: VirtualManipulator, axes: Any) -> None:
    """Draw the chain of constant links from the system CM to the tip.

    Args:
        result: The Virtual Manipulator.
        axes: Where it is drawn.
    """
    _draw_chain(axes, result, style.flat_rows(result.points))
    lengths = ", ".join(f"{x:.3g}" for x in np.linalg.norm(result.links, axis=1))
    style.entitle(axes, f"Virtual Manipulator: links of {lengths} m")


@style.draws()
def draw_barycentric(result: Barycentric, ax: Any, *, chain: bool = True) -> Any:
    """Draw the bodies' CMs, their barycentres, equation (8), and the Virtual Manipulator.

    Args:
        result: The barycentric quantities of a configuration.
        chain: Whether to draw the Virtual Manipulator.
        ax: Matplotlib axes to draw into, three-dimensional ones unless all lies in a plane; None
            for a new figure.
    """
    links = result.virtual_manipulator
    bodies = result.r_cm + result.rho @ result.T0.T
    barycentres = bodies + result.c @ result.T0.T
    rows = style.flat_rows(np.vstack((links.points, bodies, barycentres)))
    axes = style.axes_for(ax, *SIZE, spatial=len(rows) == 3)
    for name, points, marker, color in (
        ("CM of a body", bodies, "o", style.BLUE),
        ("barycentre of a body", barycentres, "D", style.ORANGE),
    ):
        axes.plot(*points[:, rows].T, marker, ms=7, color=color, label=name)
    for first, last in _together(bodies):
        name = f"{first}" if first == last else f"{first}–{last}"
        style.annotate(axes, name, bodies[first : last + 1, rows].mean(axis=0), style.BLUE)
    if chain:
        _draw_chain(axes, links, rows)
    axes.legend(frameon=False, loc="upper right")
    style.equal_axes(axes, "".join("xyz"[i] for i in rows))
    also = " and Virtual Manipulator" if chain else ""
    style.entitle(axes, f"{result.M:.4g} kg: CMs{',' if chain else ' and'} barycentres{also}")
    return axes


@style.draws()
def draw_region(result: Region, ax: Any) -> Any:
    """Draw what can happen at a point: the singular postures that reach it, or its distance alone.

    Args:
        result: The answer of `Workspace.regions`.
        ax: Matplotlib axes to draw into, three-dimensional ones for the postures of a spatial arm;
            None for a new figure.
    """
    found = result.singular
    axes = style.axes_for(ax, *SIZE, spatial=bool(found) and not in_plane(found[0]))
    for cfg, color in zip(found, style.COLOURS, strict=False):
        draw_posture(axes, cfg, color=color, label=cfg is found[0])
    if not found:
        around = np.linspace(0.0, 2.0 * np.pi, 200)
        color = style.GREEN if result.kind == "path independent" else style.RED
        axes.plot(result.radius * np.cos(around), result.radius * np.sin(around), color=color)
        axes.plot(0, 0, marker="P", ms=9, color="black", ls="none")
        style.annotate(axes, "CM", np.zeros(2), "black")
        where = "from the system CM [m]"
        axes.set(aspect="equal", xlabel=where, ylabel=where)
    number = f"\nsingular postures with the tip there: {len(found)}" if found else ""
    style.entitle(axes, f"{result.radius:.4g} m from the CM: {result.kind}{number}")
    return axes


@style.draws(size=SIZE, spatial=lambda result: not in_plane(result.arm.at(result.q)))
def draw_nearest(result: NearestSingular, axes: Any) -> None:
    """Draw the posture and, in red, the nearest singular one that was found.

    Args:
        result: The answer of `SingularSet.nearest`.
        axes: Where it is drawn.
    """
    cfg, singular = (result.arm.at(q) for q in (result.start, result.q))
    draw_posture(axes, cfg)
    draw_posture(axes, singular, color=style.RED, label=False)
    style.entitle(axes, f"{result.arm.name}, {result.mode}\n{result.describe().verdict}")


def _draw_chain(axes: Any, chain: VirtualManipulator, rows: tuple[int, ...]) -> None:
    points = chain.points[:, rows]
    axes.plot(*points.T, "-o", color=style.PURPLE, lw=2.5, ms=6, mfc="white")
    axes.plot(*points[:1].T, marker="P", ms=9, color="black", ls="none")
    style.annotate(axes, "CM", points[0], "black")
    style.annotate(axes, "tip", points[-1], style.PURPLE)
    lengths = np.linalg.norm(chain.links, axis=1)
    for i in np.flatnonzero(lengths > LEAST * lengths.sum()):
        middle = 0.5 * (points[i] + points[i + 1])
        style.annotate(axes, rf"$\mathbf{{v}}_{{{i}}}$", middle, style.PURPLE, formula=True)
    axes.margins(0.12)
    style.equal_axes(axes, "".join("xyz"[i] for i in rows))


def _together(points: Array) -> list[tuple[int, int]]:
    """Return the first and last of points (m, 3) that follow each other too closely for labels."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    parts = np.split(np.arange(len(points)), np.flatnonzero(steps > LEAST * steps.sum()) + 1)
    return [(int(part[0]), int(part[-1])) for part in parts]


def _places(cfg: Configuration, tip: str) -> tuple[Array, list[str]]:
    """Return positions (m + 1, 3) of the joints on the way to a tip and of the tip [m].

    Also the m links that these joints move.
    """
    arm, data = cfg.arm, pin.Data(cfg.arm.model)
    pin.forwardKinematics(arm.model, data, cfg.full)
    chain = [joint for joint in arm.tree.chain(tip) if joint.movable]
    places = [data.oMi[arm.model.getJointId(joint.name)].translation for joint in chain]
    ends = np.array([*places, cfg.tips[arm.tips.index(tip)].translation])
    return ends, [joint.child for joint in chain]


#: Time [s] over which velocities are drawn as displacements.
SECONDS = 0.75


def draw_velocities(axes: Any, cfg: Configuration) -> None:
    """Draw the velocities that unit joint rates give to the tip, and the lost direction.

    Args:
        axes: Matplotlib axes.
        cfg: A configuration of a planar arm whose task is the position of its tip.

    Raises:
        UnsupportedError: The arm does not move in a plane, or its task is another one.
    """
    rows = _rows(cfg)
    if tuple(cfg.arm.task.indices) != rows:
        raise UnsupportedError(
            f"{cfg.arm.name}: tip velocities are drawn for the task "
            f"'{' '.join('xyz'[i] for i in rows)}', not {cfg.arm.task.names!r}; use sa.view"
        )
    report = singularity(cfg)
    tip, com = (x[list(rows)] for x in (cfg.tip.translation, cfg.com))
    sides, sigma, _ = np.linalg.svd(report.jacobian)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = np.array([np.cos(turn), np.sin(turn)])
    axes.plot(*(tip[:, None] + SECONDS * (sides * sigma) @ circle), color=style.BLUE, lw=2)
    for lost in report.lost.T:
        for sign in (1.0, -1.0):
            arrow = {"arrowstyle": "-|>", "color": style.RED, "lw": 2.5}
            axes.annotate("", tip + sign * 0.8 * lost, tip, arrowprops=arrow)
        away = np.sign(lost @ (tip - com)) * lost
        style.annotate(axes, "no motion\nthis way", tip + 0.85 * away, style.RED, towards=away)


def _rows(cfg: Configuration) -> tuple[int, int]:
    """Return which of x, y, z span the plane."""
    normal = cfg.arm.tree.plane_normal()
    if normal is None:
        raise UnsupportedError(f"{cfg.arm.name} does not move in a plane; use sa.view")
    first, second = (i for i in range(3) if i != normal)
    return first, second
