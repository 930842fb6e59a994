"""Plots of motions: figures 5 and 6 of Papadopoulos & Dubowsky (1993), for any arm."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from matplotlib.figure import Figure
from matplotlib.patches import Annulus, Circle
from scipy.optimize import isotonic_regression

from spacearm.arrays import Array, finite, shape_of
from spacearm.motion.goal import goal_axes
from spacearm.motion.motion import Motion
from spacearm.plots.style import (
    BLUE,
    COLOURS,
    GREEN,
    GREY,
    ORANGE,
    RED,
    figure,
    style,
)
from spacearm.workspaces.path_dependent import Workspace

CLOSE = 0.05
"""Share of the tip path's extent within which its end needs no name beside the target's."""
LABEL = 0.13
"""Share of an axis that a label beside it takes."""
MOST_MARKS = 12
"""Events of a kind that are marked; the later ones of a chattering motion are left out."""
FAR = 45.0
"""Largest distance to the singular set that is told apart [deg]."""


def draw_motion(
    motion: Motion, target: npt.ArrayLike | None = None, workspace: Workspace | None = None
) -> Figure:
    """Draw a motion: tip path (figure 5), attitude, joints (figure 6), distance from singularities.

    Components are along the goal axes, so that a tilted plane is drawn as a flat one.

    Args:
        motion: The motion, from `sa.simulate`, `sa.follow` or `sa.plan`, or another one.
        target: (3,) a point to mark on the tip path [m], or (2,) in the plane of a planar arm.
        workspace: Of a planar arm, to draw its shells about the system CM.

    Raises:
        ConfigurationError: The target has another shape or is not finite.
    """
    mark = None if target is None else _in_picture(motion, target)
    with style():
        whole = figure(11.0, 6.4)
        both: Any = whole.subfigures(1, 2, width_ratios=[1.0, 1.1])
        left, right = both
        _draw_path(left, motion, mark, workspace)
        attitude, joints, nearness = right.subplots(3, 1, sharex=True)
        _draw_attitude(attitude, motion)
        _draw_joints(joints, motion)
        nearness.plot(motion.t, np.minimum(np.degrees(motion.distance), FAR), color=RED, lw=1.8)
        nearness.set(ylabel="to a singular\nposture [deg]", xlabel="time [s]", ylim=(0.0, FAR))
        nearness.set_yticks((0.0, 15.0, 30.0, FAR), ("0", "15", "30", f"over {FAR:g}"))
        for axes in (attitude, joints, nearness):
            for t in motion.singular_times[:MOST_MARKS]:
                axes.axvline(t, color=GREY, lw=0.8, ls=":")
        whole.align_ylabels()
        return whole


def _in_picture(motion: Motion, target: npt.ArrayLike) -> Array:
    """Return the components of a point to draw: 3, or the 2 in the plane of a planar arm."""
    normal, meaning = motion.arm.tree.plane_normal(), "[m]"
    if normal is None:
        return finite(target, (3,), "target", meaning)
    in_plane = shape_of(target) == (2,)
    x = finite(target, (2,) if in_plane else (3,), "target", f"{meaning}, or 2 in the plane")
    return x if in_plane else np.delete(x @ goal_axes(motion[0]), normal)


def _draw_path(
    figure: Any, motion: Motion, target: Array | None, workspace: Workspace | None
) -> None:
    normal = motion.arm.tree.plane_normal()
    start = motion[0]
    x = motion.tip[:, :3] @ goal_axes(start)
    if normal is None:
        axes = figure.add_subplot(projection="3d")
        axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    else:
        axes = figure.add_subplot()
        x = np.delete(x, normal, axis=1)
        labels = [f"{name} [m]" for i, name in enumerate("xyz") if i != normal]
        axes.set(xlabel=labels[0], ylabel=labels[1], aspect="equal", adjustable="datalim")
        axes.grid(alpha=0.3)
        if workspace is not None:
            _draw_shells(axes, np.delete(start.com @ goal_axes(start), normal), workspace)
    axes.plot(*x.T, color=BLUE, lw=2)
    axes.plot(*x[:1].T, "o", color=BLUE)
    marks = [("start", x[0], BLUE)]
    if target is None or np.linalg.norm(x[-1] - target) > CLOSE * np.ptp(x, axis=0).max():
        marks.append(("end", x[-1], BLUE))
    first = motion.singular_times[:1]
    if first:
        at = np.array([np.interp(first[0], motion.t, column) for column in x.T])
        axes.plot(*at[:, None], "x", color=RED, ms=10, mew=2.5)
        marks.append(("singular", at, RED))
    if target is not None:
        axes.plot(*target[:, None], "*", color=GREEN, ms=13)
        marks.append(("target", target, GREEN))
    for label, at, color in marks:
        if normal is None:
            axes.text(*at, f"  {label}", color=color)
        else:
            axes.annotate(label, at, (8, 6), textcoords="offset points", color=color)
    if normal is None:
        axes.set_aspect("equal", adjustable="datalim")
    figure.suptitle(f"{motion.arm.name}, {motion.story}", x=0.02, ha="left")


def _draw_shells(axes: Any, com: Array, workspace: Workspace) -> None:
    """Draw the path dependent shells and the edge of the reachable workspace."""
    x, y = map(float, com)
    outer = float(workspace.reachable[0, 1])
    axes.add_patch(Circle((x, y), outer, facecolor="none", edgecolor=GREY, lw=1.2))
    for low, high in workspace.pdw:
        if high > low:
            ring = Annulus((x, y), high, high - low) if low > 0.0 else Circle((x, y), high)
            ring.set(facecolor=ORANGE, alpha=0.3, lw=0)
            axes.add_patch(ring)
    low, high = workspace.pdw[-1] if len(workspace.pdw) else (outer, outer)
    axes.text(
        x,
        y - 0.5 * (low + high),
        "path dependent",
        ha="center",
        va="center",
        fontsize=9,
        color=GREY,
    )
    axes.plot(x, y, "P", color="black", ms=7)


def _draw_attitude(axes: Any, motion: Motion) -> None:
    along = goal_axes(motion[0]).T
    rotations = [along @ pin.XYZQUATToSE3(pose).rotation for pose in motion.base]
    turns = np.degrees([pin.log3(R) for R in rotations])
    normal = motion.arm.tree.plane_normal()
    if normal is None:
        for i, color in enumerate((BLUE, ORANGE, GREEN)):
            axes.plot(motion.t, turns[:, i], color=color, lw=1.8)
        _name(axes, motion.t[-1], turns[-1], list("xyz"))
        axes.set_ylabel("rotation\nvector [deg]")
    else:
        axes.plot(motion.t, np.unwrap(turns[:, normal], period=360.0), color=BLUE, lw=1.8)
        axes.set_ylabel("attitude\n[deg]")


def _draw_joints(axes: Any, motion: Motion) -> None:
    arm = motion.arm
    q = motion.q * np.where(arm.slides, 100.0, 180.0 / np.pi)
    for i in range(arm.n):
        axes.plot(motion.t, q[:, i], color=COLOURS[i % len(COLOURS)], lw=1.5)
    _name(axes, motion.t[-1], q[-1], [f"q{i + 1}" for i in range(arm.n)])
    unit = "cm" if arm.slides.all() else "deg" if not arm.slides.any() else "deg, cm"
    axes.set_ylabel(f"joints\n[{unit}]")


def _name(axes: Any, x: float, ends: Array, labels: list[str]) -> None:
    """Write labels at the ends of curves, in their colours, apart from each other."""
    low, high = axes.get_ylim()
    apart = LABEL * (high - low)
    order = np.argsort(ends)
    steps = apart * np.arange(len(ends))
    at = steps + isotonic_regression(ends[order] - steps).x
    for i, y in zip(order, at, strict=True):
        axes.annotate(
            labels[i], (x, y), (4, 0), textcoords="offset points", va="center", fontsize=9,
            color=axes.lines[i].get_color(), annotation_clip=False,
        )  # fmt: skip
