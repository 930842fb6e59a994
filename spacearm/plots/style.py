"""The style of all figures: labelled axes with units, colours that all can tell apart."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib import figure as mpl_figure

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError

P = ParamSpec("P")

BLUE, RED, GREEN, ORANGE, GREY = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#5b6470"
PURPLE, SKY = "#cc79a7", "#56b4e9"
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY)
"""Colours of Okabe and Ito, which colour-blind readers can tell apart."""
SHEET = Path(__file__).parents[1] / "paper.mplstyle"
"""What `matplotlib.style.use("spacearm.paper")` takes."""
STYLE: Any = {  # Matplotlib's stubs accept literal names only
    **mpl.rc_params_from_file(SHEET, use_default_template=False),
    "svg.hashsalt": "spacearm",
    "text.parse_math": False,  # names may hold dollar signs
}
DRAWINGS: dict[type, Callable[..., Any]] = {}
"""What draws each kind of result; see `draws`."""
PIXELS_PER_INCH = 90
"""Size of figures in notebooks."""
TITLE = 54
"""Characters in a line of a title."""
FLAT = 1e-9
"""Share of their extent by which points may leave a plane and still count as flat."""


@contextmanager
def style() -> Iterator[None]:
    """Apply the style of the project for as long as the context lasts."""
    with mpl.rc_context(STYLE):
        yield


def draws(*kinds: type) -> Callable[[Callable[P, mpl_figure.Figure]], Callable[P, Any]]:
    """Make a function what draws kinds of results, in the style of the project.

    Args:
        *kinds: The types of the results.
    """

    def register(draw: Callable[P, mpl_figure.Figure]) -> Callable[P, Any]:
        @wraps(draw)
        def styled(*args: P.args, **options: P.kwargs) -> mpl_figure.Figure:
            with style():
                return draw(*args, **options)

        DRAWINGS.update(dict.fromkeys(kinds, styled))
        return styled

    return register


class Figure(mpl_figure.Figure):
    """A Matplotlib figure that a notebook shows where it is the last line of a cell."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return the picture and its size on the page [px]."""
        buffer = io.BytesIO()
        with style(), mpl.rc_context({"text.parse_math": True}):  # as ticks of powers of ten need
            self.savefig(buffer, format="png")
        width, height = (int(PIXELS_PER_INCH * inches) for inches in self.get_size_inches())
        return buffer.getvalue(), {"width": width, "height": height}


def figure(width: float, height: float) -> Figure:
    """Make an empty figure in the style of the project.

    Add its axes within `style()`, which gives them the style too.

    Args:
        width: Width [inch].
        height: Height [inch].
    """
    with style():
        return Figure(figsize=(width, height))


def axes_for(ax: Any, width: float, height: float, *, spatial: bool = False) -> Any:
    """Return the given axes, or those of a new figure with one panel.

    Args:
        ax: Matplotlib axes to draw into, or a figure or subfigure that gets some; None for a new
            figure.
        width: Width of a new figure [inch].
        height: Height of a new figure [inch].
        spatial: Whether three-dimensional axes are needed.

    Raises:
        ConfigurationError: `ax` is not Matplotlib axes, or has the wrong number of dimensions.
    """
    if ax is None or isinstance(ax, mpl_figure.FigureBase):
        whole = figure(width, height) if ax is None else ax
        return whole.add_subplot(projection="3d" if spatial else None)
    if not isinstance(ax, mpl.axes.Axes):
        raise ConfigurationError(
            f"ax is {ax!r}; this drawing has one panel: give Matplotlib axes, a figure or a "
            "subfigure"
        )
    if spatial != (ax.name == "3d"):
        needed = "projection='3d'" if spatial else "no projection"
        raise ConfigurationError(
            f"ax has the projection {ax.name!r}; this drawing needs figure.add_subplot with "
            f"{needed}"
        )
    return ax


def panels_for(
    ax: Any, make: Callable[[Any], Sequence[Any]], width: float, height: float
) -> tuple[Any, list[Any]]:
    """Return the figure or subfigure that is drawn into, None for given axes, and the panels.

    Args:
        ax: Axes, one for each panel, or a figure or subfigure; None for a new figure.
        make: Makes the panels in a figure or subfigure.
        width: Width of a new figure [inch].
        height: Height of a new figure [inch].

    Raises:
        ConfigurationError: `ax` is something else, or has other axes than the drawing needs.
    """
    if ax is None or isinstance(ax, mpl_figure.FigureBase):
        whole = figure(width, height) if ax is None else ax
        return whole, list(make(whole))
    wanted = list(make(Figure()))
    given = list(np.ravel(np.asarray(ax, dtype=object)))
    kinds = [axes.name if isinstance(axes, mpl.axes.Axes) else repr(axes) for axes in given]
    if kinds != (needed := [axes.name for axes in wanted]):
        raise ConfigurationError(
            f"ax is {', '.join(kinds)}; this drawing has {len(needed)} panels: give a figure or a "
            f"subfigure, or axes with these projections: {', '.join(needed)}"
        )
    return None, given


def headline(whole: Any, panels: Sequence[Any], text: str) -> None:
    """Write a title over all panels, or over the first one where there is no figure of theirs."""
    if whole is None:
        panels[0].set_title(text)
    else:
        whole.suptitle(text, x=0.02, ha="left")


def equal_axes(axes: Any, names: str = "xyz") -> None:
    """Label axes in metres and give them one scale."""
    labels = {f"{axis}label": f"{name} [m]" for axis, name in zip("xyz", names, strict=False)}
    if axes.name == "3d":
        axes.set(**labels)
        axes.set_aspect("equal", adjustable="datalim")
    else:
        axes.set(**labels, aspect="equal", adjustable="datalim")


def write_powers(axis: Any) -> None:
    """Have the powers of ten of a logarithmic axis written as formulas, which no name is."""
    for label in axis.get_ticklabels(which="both"):
        label.set_parse_math(True)


def flat_rows(points: Array) -> tuple[int, ...]:
    """Return which of x, y, z to draw: the two of a plane of axes that holds the points, or all.

    Args:
        points: (m, 3) points.
    """
    extent = points.max(axis=0) - points.min(axis=0)
    still = [i for i in range(3) if extent[i] <= FLAT * extent.max()]
    return tuple(i for i in range(3) if i != still[-1]) if still else (0, 1, 2)


def annotate(
    axes: Any, text: str, at: Array, color: str, *, below: bool = False, formula: bool = False
) -> None:
    """Write a label beside or below a point, in the plane or in space."""
    if axes.name == "3d":
        va = "top" if below else "bottom"
        axes.text(*at, f"  {text}", color=color, va=va, parse_math=formula)
    else:
        offset = (0, -18) if below else (8, 6)
        axes.annotate(
            text, at, offset, textcoords="offset points", color=color,
            ha="center" if below else "left", parse_math=formula,
        )  # fmt: skip
