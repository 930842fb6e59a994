"""Numbers of one configuration as bars and labelled matrices, and answers in words as cards."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import SymLogNorm

from spacearm.arrays import Array
from spacearm.mechanics.dynamics import Capture, Dynamics
from spacearm.mechanics.jacobian import MomentumMatrix, PrescribedMotion
from spacearm.plots import style
from spacearm.plots.configurations import draw_posture, in_plane
from spacearm.plots.triangles import stand_ins
from spacearm.results import Described, short_names
from spacearm.singularities.report import IN_WORDS, SingularityReport
from spacearm.singularities.rounding import ErrorBars

ROWS = ("x", "y", "z", "rx", "ry", "rz")
#: Share of the largest entry of a matrix below which an entry is rounding and shown as 0.
ROUNDING = 1e-14
#: Colours of verdicts.
TONES = {"good": style.GREEN, "caution": style.ORANGE, "bad": style.RED}
#: Share of the largest entry down to which colours of a matrix are logarithmic.
DECADES = 1e-3


@style.draws()
def draw_report(result: SingularityReport, ax: Any) -> Any:
    """Draw the posture, the singular values, and the direction of the tip that belongs to each.

    Lost directions are red. Each column under the singular values is one direction.

    Args:
        result: The report.
        ax: Axes for the posture, three-dimensional ones for a spatial arm, the singular values and
            the directions; or a figure or subfigure; None for a new figure.
    """
    cfg = result.configuration
    arm, k = cfg.arm, len(result.sigma)
    columns = [f"{i + 1}" if i < result.rank else f"{i + 1} lost" for i in range(k)]

    def parts(whole: Any) -> list[Any]:
        grid = whole.add_gridspec(2, 2)
        posture = whole.add_subplot(grid[:, 0], projection=None if in_plane(cfg) else "3d")
        values = whole.add_subplot(grid[0, 1])
        return [posture, values, whole.add_subplot(grid[1, 1], sharex=values)]

    whole, (posture, values, directions) = style.panels_for(ax, parts, max(11.0, 1.6 * k), 5.4)
    draw_posture(posture, cfg)
    _draw_lost(posture, result)
    style.entitle(posture, f"{arm.name}, {result.mode}\n{result.verdict}{stand_ins(arm)}")
    color = [style.GREEN] * result.rank + [style.RED] * (k - result.rank)
    bars = values.bar(range(k), result.sigma, color=color)
    values.bar_label(bars, fmt="{:.3g}", fontsize=9)
    values.set(xticks=range(k), xticklabels=columns, ylabel=f"[{arm.sigma_unit}]")
    values.margins(y=0.15)
    style.entitle(values, "Singular values")
    both = np.hstack((result.available, result.lost))
    _draw_matrix(directions, both, arm.task.rows, columns)
    style.entitle(directions, "Directions in the rows of the task")
    if whole is not None:
        words = style.folded(IN_WORDS, 0.9 * whole.bbox.width / whole.dpi, 9)
        whole.supxlabel(words, fontsize=9, color=style.GREY)
    return posture


@style.draws()
def draw_capture(result: Capture, ax: Any) -> Any:
    """Draw arm and target at the grasp, and joint rates and the spacecraft's twist just after it.

    Args:
        result: The capture.
        ax: Four axes, the first three-dimensional for a spatial arm, or a figure or subfigure; None
            for a new figure.
    """
    cfg, arm = result.configuration, result.configuration.arm

    def parts(new: Any) -> list[Any]:
        left, right = new.subfigures(1, 2)
        posture = left.add_subplot(projection=None if in_plane(cfg) else "3d")
        if posture.name == "3d":
            posture.set_box_aspect(None, zoom=0.85)  # room for the label of the vertical axis
        grid = right.add_gridspec(2, 2)
        return [posture, *(right.add_subplot(grid[at]) for at in ((0, slice(2)), (1, 0), (1, 1)))]

    whole, panels = style.panels_for(ax, parts, 11.0, 5.4)
    posture, rates, linear, angular = panels
    draw_posture(posture, cfg)
    unit = "m/s" if arm.slides.all() else "rad/s, m/s" if arm.slides.any() else "rad/s"
    _bars(rates, short_names(arm.joint_names), result.dq, f"[{unit}]", "Joint rates")
    _bars(linear, "xyz", result.twist[:3], "[m/s]", "Spacecraft, linear")
    _bars(angular, "xyz", result.twist[3:], "[rad/s]", "Spacecraft, angular")
    title = f"{arm.name} after the capture: {result.energy_lost:.4g} J lost{stand_ins(arm)}"
    style.headline(whole, panels, title)
    return posture


@style.draws(size=(10.0, 6.0), panels=lambda whole: whole.subplots(2, 2).ravel())
def draw_dynamics(result: Dynamics, panels: Any) -> None:
    """Draw joint torques and accelerations, the spacecraft's acceleration and the reaction.

    Args:
        result: The answer of `forward_dynamics` or `inverse_dynamics`.
        panels: Where it is drawn.
    """
    joints = [f"q{i + 1}" for i in range(len(result.ddq))]
    tau, ddq, base, reaction = panels
    _bars(tau, joints, result.tau, "[N m] or [N]", "Joint torques")
    _bars(ddq, joints, result.ddq, "[rad/s²] or [m/s²]", "Joint accelerations")
    _bars(base, ROWS, result.base_acceleration, "[m/s²], [rad/s²]", "Spacecraft acceleration")
    _bars(reaction, ROWS, result.reaction, "[N], [N m]", "Reaction on a held spacecraft")


@style.draws()
def draw_momentum_matrix(result: MomentumMatrix, ax: Any) -> Any:
    """Draw A_b and A_q side by side as one matrix.

    Args:
        result: The momentum matrix.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    n = result.A_q.shape[1]
    columns = [
        *(f"v{a}" for a in "xyz"),
        *(f"w{a}" for a in "xyz"),
        *(f"q{i + 1}" for i in range(n)),
    ]
    rows = [*(f"p{a}" for a in "xyz"), *(f"h{a}" for a in "xyz")]
    title = "Momentum matrix [A_b A_q]: momentum p, angular momentum h [SI]"
    axes = _matrix(np.hstack((result.A_b, result.A_q)), rows, columns, title, ax)
    axes.axvline(5.5, color="black", lw=1.5)
    return axes


@style.draws()
def draw_prescribed_motion(result: PrescribedMotion, ax: Any) -> Any:
    """Draw the Jacobian of the free joints, and the drift that the prescribed ones cause.

    Args:
        result: The prescribed motion.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    matrix = np.column_stack((result.jacobian, result.drift))
    title = "Jacobian of the free joints |\ndrift of the tip [m/s, rad/s]"
    axes = _matrix(matrix, _twist_rows(len(matrix)), [*result.joints, "drift"], title, ax)
    axes.axvline(len(result.joints) - 0.5, color="black", lw=1.5)
    return axes


@style.draws()
def draw_error_bars(result: ErrorBars, ax: Any) -> Any:
    """Draw the bounds for the rounding errors of the entries of J*.

    Args:
        result: The error bars.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    columns = [f"q{i + 1}" for i in range(result.jacobian.shape[1])]
    rows = _twist_rows(len(result.jacobian))
    title = f"Error bars of J*; of the singular values {result.sigma:.2g}"
    return _matrix(result.jacobian, rows, columns, title, ax)


def _draw_lost(axes: Any, result: SingularityReport) -> None:
    """Draw the lost directions as lines through the tip, where they are linear."""
    cfg = result.configuration
    if len(cfg.arm.tips) > 1:
        return
    normal = cfg.arm.tree.plane_normal()
    rows = [i for i in range(3) if axes.name == "3d" or i != normal]
    tip = cfg.tip.translation
    linear = [i for i, row in enumerate(cfg.arm.task.indices) if row < 3]
    along = result.axes[:, [cfg.arm.task.indices[i] for i in linear]]
    size = 0.25 * float(np.linalg.norm(tip - cfg.com))
    for lost in result.lost.T:
        span = size * (along @ lost[linear])
        axes.plot(*np.array([tip - span, tip + span])[:, rows].T, color=style.RED, lw=3)


def _twist_rows(count: int) -> list[str]:
    """Return names for the rows of stacked twists."""
    tips = count // 6
    return [row if tips == 1 else f"{row} {tip + 1}" for tip in range(tips) for row in ROWS]


def _bars(axes: Any, names: Any, values: Array, unit: str, title: str) -> None:
    axes.bar(range(len(values)), values, color=style.BLUE)
    axes.axhline(0.0, color=style.GREY, lw=0.8)
    axes.set(ylabel=unit)
    slanted = sum(map(len, names)) > 40
    axes.set_xticks(
        range(len(values)), list(names), rotation=45 if slanted else 0,
        ha="right" if slanted else "center",
    )  # fmt: skip
    axes.ticklabel_format(axis="y", scilimits=(-3, 4))
    style.entitle(axes, title)


def _matrix(values: Array, rows: Sequence[str], columns: Sequence[str], title: str, ax: Any) -> Any:
    """Draw a labelled matrix alone."""
    axes = style.axes_for(ax, 2.0 + 0.72 * len(columns), 1.6 + 0.42 * len(rows))
    _draw_matrix(axes, values, rows, columns)
    style.entitle(axes, title)
    return axes


def _draw_matrix(axes: Any, values: Array, rows: Sequence[str], columns: Sequence[str]) -> None:
    """Draw a matrix: colours by sign and size, on a logarithmic scale, the number in each cell."""
    sound = np.where(np.isfinite(values), values, 0.0)
    most = float(np.abs(sound).max()) or 1.0
    norm = SymLogNorm(DECADES * most, vmin=-most, vmax=most)
    axes.imshow(sound, norm=norm, cmap="RdBu_r", aspect="auto", alpha=0.8)
    for (i, j), value in np.ndenumerate(values):
        shown = value if abs(value) > ROUNDING * most else 0.0
        dark = abs(float(norm(sound[i, j])) - 0.5) > 0.4
        axes.text(
            j, i, f"{shown:.3g}", ha="center", va="center", fontsize=8,
            color="white" if dark else "black",
        )  # fmt: skip
    axes.set_xticks(range(len(columns)), columns, rotation=45 if max(map(len, columns)) > 6 else 0)
    axes.set_yticks(range(len(rows)), rows)


@style.draws()
def draw_card(result: Described, ax: Any) -> Any:
    """Write what has no picture of its own on a card: verdict, numbers, what is not checked.

    Args:
        result: A certificate, a step of a servo, ...
        ax: Axes, or a figure or subfigure; None for a new figure.
    """
    told = result.describe()
    lines = [*told.notes]
    for table in told.parts:
        rows = [table.head("deg"), *table.body("deg")]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        cells = (zip(row, widths, strict=True) for row in rows if any(row))
        lines += ["", table.title] if table.title else [""]
        lines += ["   ".join(cell.ljust(width) for cell, width in row) for row in cells]
    lines += ["", told.limits] if told.limits else []
    axes = style.axes_for(ax, 8.0, 1.2 + 0.19 * len(lines))
    axes.set_axis_off()
    color = TONES.get(told.tone, "black")
    style.entitle(axes, told.headline, color=color)
    axes.text(0.0, 1.0, "\n".join(lines), va="top", fontsize=9, family="monospace")
    return axes
