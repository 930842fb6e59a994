"""Singular maps: figure 4 of Papadopoulos & Dubowsky (1993), for any two joints."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from spacearm.arrays import Array
from spacearm.plots.style import RED, TITLE, style
from spacearm.singularities.map import SingularMap

if TYPE_CHECKING:
    pass


def draw_map(result: SingularMap) -> Figure:
    """Draws a singular map: figure 4 of Papadopoulos & Dubowsky (1993) for planar2."""
    with style():
        figure = Figure(figsize=(7.2, 6.0))
        axes = figure.subplots()
        degrees = np.degrees(result.angles)
        floor = max(float(result.sigma_min.max()) * 1e-3, 1e-300)
        image = axes.pcolormesh(
            degrees,
            degrees,
            np.log10(np.maximum(result.sigma_min.T, floor)),
            cmap="cividis",
            rasterized=True,
        )
        figure.colorbar(image, ax=axes, label=f"log10 of sigma_min [{result.unit}]", shrink=0.9)
        for curve in result.curves or []:
            axes.plot(*_on_screen(np.degrees(curve)).T, color=RED, lw=2.0)
        turn = range(-180, 181, 60)
        axes.set(
            xlim=(-180, 180), ylim=(-180, 180), xticks=turn, yticks=turn, aspect="equal",
            xlabel=f"{result.joints[0]} [deg]", ylabel=f"{result.joints[1]} [deg]",
        )  # fmt: skip
        what = "sigma_min" if result.curves is None else "singular set (red)"
        held = ", ".join(
            f"{name}\N{NO-BREAK SPACE}{np.degrees(x):.4g}" for name, x in result.held.items() if x
        )
        where = "\n" + textwrap.fill(f"{held} deg, others 0", TITLE) if held else ""
        axes.set_title(f"{result.arm}: {what}{where}")
        return figure


def _on_screen(curve: Array) -> Array:
    """A curve on the torus folded into -180 .. 180, broken where it leaves the screen."""
    folded = 180.0 - (180.0 - curve) % 360.0
    jumps = np.flatnonzero(np.abs(np.diff(folded, axis=0)).max(axis=1) > 180.0) + 1
    return np.insert(folded, jumps, np.nan, axis=0)
