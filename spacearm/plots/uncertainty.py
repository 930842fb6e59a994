"""Ranges of distances and bands of shells of arms that are known in intervals only."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Annulus

from spacearm.plots.style import BLUE, GREY, ORANGE, RED, axes_for, style
from spacearm.uncertainty.robust import DistanceRange, ShellBands


def draw_distance_range(result: DistanceRange, *, ax: Any = None) -> Figure:
    """Draw how the distances of all arms tried are spread.

    Args:
        result: The range.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    axes = axes_for(ax, 7.2, 4.2)
    with style():
        axes.hist(np.degrees(result.distances), bins=30, color=BLUE, alpha=0.6)
        axes.axvline(np.degrees(result.nominal), color=RED, label="as described")
        axes.set(xlabel="distance to the singular set, to first order [°]", ylabel="arms")
        axes.legend(frameon=False)
        low, high = np.degrees((result.low, result.high))
        axes.set_title(f"{result.tried} arms: {low:.4g}° to {high:.4g}°")
    return axes.figure


def draw_shell_bands(result: ShellBands, *, ax: Any = None) -> Figure:
    """Draw where the workspace is path dependent for all arms tried, and for some.

    Args:
        result: The bands.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    axes = axes_for(ax, 6.6, 6.2)
    with style():
        outer = float(result.sometimes.max(initial=0.0)) or 1.0
        for ranges, color, label in (
            (result.sometimes, GREY, "path dependent for some"),
            (result.always, ORANGE, "path dependent for all"),
        ):
            for i, (low, high) in enumerate(ranges):
                ring = Annulus((0, 0), high, max(high - low, 1e-3 * outer), facecolor=color)
                ring.set(alpha=0.55, label=label if i == 0 else None)
                axes.add_patch(ring)
        axes.plot(0, 0, marker="P", color="black", ms=9)
        reach = 1.25 * outer
        axes.set(
            xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal",
            xlabel="from the system CM [m]", ylabel="from the system CM [m]",
        )  # fmt: skip
        axes.legend(frameon=False, loc="upper right")
        axes.set_title(f"{result.tried} arms")
    return axes.figure
