"""Trigonometric polynomials: a curve for one angle, a map for two, coefficients for more."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from spacearm.plots.style import BLUE, GREY, RED, axes_for, style, write_powers
from spacearm.polynomial.trig import TrigPolynomial

POINTS = 361
"""Values along each angle."""


def draw_polynomial(result: TrigPolynomial, *, ax: Any = None) -> Figure:
    """Draw a polynomial of one or two angles with its zeros, one of more by its coefficients.

    The order of a coefficient c_k is |k_1| + ... + |k_n|.

    Args:
        result: The polynomial.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    axes = axes_for(ax, 7.2, 4.4 if result.n != 2 else 6.0)
    with style():
        draw = {1: _draw_curve, 2: _draw_map}.get(result.n, _draw_coefficients)
        draw(axes, result)
        axes.set_title(f"Trigonometric polynomial of degrees {result.degrees}")
    return axes.figure


def _draw_curve(axes: Any, S: TrigPolynomial) -> None:
    q = np.linspace(-np.pi, np.pi, POINTS)
    axes.axhline(0.0, color=GREY, lw=0.8)
    axes.plot(np.degrees(q), S(q[:, None]), color=BLUE, lw=2)
    roots = S.roots(np.zeros(1), 0).angles
    axes.plot(np.degrees(roots), np.zeros(len(roots)), "o", color=RED)
    axes.set(xlim=(-180, 180), xticks=range(-180, 181, 60), xlabel="q1 [deg]", ylabel="value")


def _draw_map(axes: Any, S: TrigPolynomial) -> None:
    q = np.linspace(-np.pi, np.pi, POINTS)
    grid = np.stack(np.meshgrid(q, q, indexing="ij"), axis=-1)
    values = S(grid.reshape(-1, 2)).reshape(POINTS, POINTS).T
    degrees, most = np.degrees(q), float(np.abs(values).max()) or 1.0
    image = axes.pcolormesh(
        degrees, degrees, values, cmap="RdBu_r", vmin=-most, vmax=most, rasterized=True
    )
    axes.figure.colorbar(image, ax=axes, label="value; zero on the black lines", shrink=0.9)
    if values.min() < 0.0 < values.max():
        axes.contour(degrees, degrees, values, levels=[0.0], colors="black", linewidths=1.5)
    turn = range(-180, 181, 60)
    axes.set(xlabel="q1 [deg]", ylabel="q2 [deg]", xticks=turn, yticks=turn, aspect="equal")


def _draw_coefficients(axes: Any, S: TrigPolynomial) -> None:
    sizes = np.abs(S.coefficients)
    order = sum(
        np.abs(index - degree)
        for index, degree in zip(np.indices(sizes.shape), S.degrees, strict=True)
    )
    kept = sizes > np.finfo(np.float64).eps * max(S.scale, 1e-300)
    axes.semilogy(
        np.broadcast_to(order, sizes.shape)[kept], sizes[kept], "o", color=BLUE, alpha=0.4
    )
    axes.set(xlabel="order of the coefficient", ylabel="size of the coefficient")
    axes.xaxis.get_major_locator().set_params(integer=True)
    write_powers(axes.yaxis)
