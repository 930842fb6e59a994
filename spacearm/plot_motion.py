"""Plots of motions: figures 5 and 6 of Papadopoulos & Dubowsky (1993), for any arm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure

from spacearm.arrays import Array
from spacearm.following import Followed
from spacearm.plot import BLUE, COLOURS, GREEN, GREY, ORANGE, RED, style
from spacearm.trajectory import Trajectory

MOST_MARKS = 12
"""Events of a kind that are marked; later ones of a chattering motion are not."""


def draw_motion(motion: Trajectory | Followed, target: Array | None = None) -> Figure:
    """Draws a motion: tip path (figure 5), attitude and joints (figure 6), nearness to singularity.

    Args:
        motion: From `sa.simulate` or `sa.follow`.
        target: (2,) or (3,) a point to mark on the tip path [m].
    """
    with style():
        figure = Figure(figsize=(11.0, 6.4))
        both: Any = figure.subfigures(1, 2, width_ratios=[1.0, 1.1])
        left, right = both
        _draw_path(left, motion, target)
        attitude, joints, nearness = right.subplots(3, 1, sharex=True)
        _draw_attitude(attitude, motion)
        _draw_joints(joints, motion)
        nearness.semilogy(motion.t, np.maximum(motion.sigma_min, 1e-16), color=RED, lw=1.8)
        low = max(float(motion.sigma_min.min()), 1e-6 * float(motion.sigma_min.max()))
        nearness.set(
            ylabel=f"sigma_min\n[{motion.arm.sigma_unit}]", xlabel="time [s]", ylim=(low / 2, None)
        )
        for axes in (attitude, joints, nearness):
            for t in _singular_times(motion):
                axes.axvline(t, color=GREY, lw=0.8, ls=":")
        figure.align_ylabels()
        return figure


def _draw_path(figure: Any, motion: Trajectory | Followed, target: Array | None) -> None:
    normal = motion.arm.tree.plane_normal()
    x = motion.tip[:, :3]
    if normal is None:
        axes = figure.add_subplot(projection="3d")
        axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    else:
        axes = figure.add_subplot()
        x = np.delete(x, normal, axis=1)
        labels = [f"{name} [m]" for i, name in enumerate("xyz") if i != normal]
        axes.set(xlabel=labels[0], ylabel=labels[1], aspect="equal", adjustable="datalim")
        axes.grid(alpha=0.3)
    axes.plot(*x.T, color=BLUE, lw=2)
    axes.plot(*x[:1].T, "o", color=BLUE)
    marks = [("start", x[0], BLUE), ("end", x[-1], BLUE)]
    first = _singular_times(motion)[:1]
    if first:
        at = np.array([np.interp(first[0], motion.t, column) for column in x.T])
        axes.plot(*at[:, None], "x", color=RED, ms=10, mew=2.5)
        marks.append(("singular", at, RED))
    if target is not None:
        axes.plot(*np.asarray(target)[:, None], "*", color=GREEN, ms=13)
        marks.append(("target", np.asarray(target), GREEN))
    for label, at, color in marks:
        if normal is None:
            axes.text(*at, f"  {label}", color=color)
        else:
            axes.annotate(label, at, (8, 6), textcoords="offset points", color=color)
    ended = f"{motion.t[-1]:.4g} s" if motion.ended == "duration" else f"ended by {motion.ended}"
    figure.suptitle(f"{motion.arm.name}, {motion.mode}: {ended}", x=0.02, ha="left")


def _draw_attitude(axes: Any, motion: Trajectory | Followed) -> None:
    turns = np.degrees([pin.log3(pin.XYZQUATToSE3(pose).rotation) for pose in motion.base])
    normal = motion.arm.tree.plane_normal()
    if normal is None:
        for i, color in enumerate((BLUE, ORANGE, GREEN)):
            axes.plot(motion.t, turns[:, i], color=color, lw=1.8)
            _name(axes, motion.t[-1], turns[-1, i], "xyz"[i], color)
        axes.set_ylabel("rotation\nvector [deg]")
    else:
        axes.plot(motion.t, np.unwrap(turns[:, normal], period=360.0), color=BLUE, lw=1.8)
        axes.set_ylabel("attitude\n[deg]")


def _draw_joints(axes: Any, motion: Trajectory | Followed) -> None:
    arm = motion.arm
    slides = [arm.tree.joints[name].kind == "prismatic" for name in arm.joint_names]
    for i, slide in enumerate(slides):
        q = motion.q[:, i] * (100.0 if slide else 180.0 / np.pi)
        color = COLOURS[i % len(COLOURS)]
        axes.plot(motion.t, q, color=color, lw=1.5)
        _name(axes, motion.t[-1], q[-1], f"q{i + 1}", color)
    unit = "cm" if all(slides) else "deg" if not any(slides) else "deg, cm"
    axes.set_ylabel(f"joints\n[{unit}]")


def _name(axes: Any, x: float, y: float, label: str, color: str) -> None:
    """A label at the end of a curve."""
    axes.annotate(
        label, (x, y), (4, 0), textcoords="offset points", color=color, va="center", fontsize=9
    )


def _singular_times(motion: Trajectory | Followed) -> list[float]:
    """When the motion met singularities."""
    if isinstance(motion, Followed):
        return [float(motion.t[-1])] if motion.ended == "singularity" else []
    return [event.t for event in motion.events if event.kind == "singularity"][:MOST_MARKS]
