"""The style of all figures: labelled axes with units, colours that all can tell apart."""

from __future__ import annotations

import io
import os
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime, timezone
from functools import wraps
from itertools import cycle
from pathlib import Path
from typing import Any, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib import figure as mpl_figure
from matplotlib.font_manager import FontProperties
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation, Text
from matplotlib.ticker import AutoLocator
from matplotlib.transforms import Bbox, IdentityTransform
from mpl_toolkits.mplot3d.proj3d import proj_transform

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, shortened

F = TypeVar("F", bound=Callable[..., Any])

BLUE, RED, GREEN, ORANGE, GREY = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#5b6470"
PURPLE, SKY = "#cc79a7", "#56b4e9"
#: Colours of Okabe and Ito, which colour-blind readers can tell apart.
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY)
#: What `matplotlib.style.use("spacearm.paper")` takes.
SHEET = Path(__file__).parents[1] / "paper.mplstyle"
STYLE: Any = {  # Matplotlib's stubs accept literal names only
    **mpl.rc_params_from_file(SHEET, use_default_template=False),
    "svg.hashsalt": "spacearm",
    "text.parse_math": False,  # names may hold dollar signs
}
#: What draws each kind of result, by the name of its class; see `draws`.
DRAWINGS: dict[str, Callable[..., Any]] = {}
#: Size of figures in notebooks.
PIXELS_PER_INCH = 90
#: Most intervals between ticks, in the plane and in space: their labels then do not touch.
MOST_TICKS = {False: 6, True: 5}
#: Most characters of a title: some five lines.
LONGEST_TITLE = 400
#: Mean width of a letter, as a share of the size of its font.
LETTER = 0.52
AROUND = 2.0 * np.pi * np.arange(12) / 12.0 + np.pi / 4.0
#: Where labels can stand beside their points, times distances.
OFFSETS = 1.4 * np.column_stack((np.cos(AROUND), np.sin(AROUND)))
#: Direction in which labels stand from their points if they can.
UP = np.array([1.0, 0.9])
#: Distances of labels from their points [pt].
DISTANCES = (6.0, 16.0, 28.0, 44.0, 64.0, 90.0, 120.0)
#: Order of what is drawn over all bodies.
IN_FRONT = 1e3
#: Share of their extent by which points may leave a plane and still count as flat.
FLAT = 1e-9


@contextmanager
def style() -> Iterator[None]:
    """Apply the style of the project for as long as the context lasts."""
    with mpl.rc_context(STYLE):
        yield


def draws(
    *,
    size: tuple[float, float] | None = None,
    panels: Callable[[Any], Sequence[Any]] | None = None,
    spatial: Callable[[Any], bool] = lambda _: False,
) -> Callable[[F], F]:
    """Make a function what draws the kinds of results that its first annotation names.

    It draws in the style of the project. The classes need not be imported.

    Args:
        size: Width and height of a new figure [inch] for a function that is given where it draws;
            None for one that is given what the caller gave, and returns its first panel.
        panels: Makes the panels in a figure or subfigure; None for one panel.
        spatial: Whether the one panel is three-dimensional for a result.
    """

    def register(draw: F) -> F:
        @wraps(draw)
        def styled(thing: object, ax: Any, **options: Any) -> mpl_figure.Figure:
            with style():
                if size is None:
                    return draw(thing, ax, **options).figure
                if panels:
                    where = panels_for(ax, panels, *size)[1]
                else:
                    where = [axes_for(ax, *size, spatial=spatial(thing))]
                draw(thing, where if panels else where[0], **options)
                return where[0].figure

        for kind in next(iter(draw.__annotations__.values())).split(" | "):
            DRAWINGS[kind.partition("[")[0].rpartition(".")[2]] = styled
        return draw

    return register


class Figure(mpl_figure.Figure):
    """A Matplotlib figure that a notebook shows where it is the last line of a cell."""

    def draw(self, renderer: Any) -> None:
        """Draw, laid out with the limits that equal scales lead to: their numbers need the room."""
        if engine := self.get_layout_engine():
            engine.execute(self)
            for axes in self.axes:
                axes.apply_aspect()
        super().draw(renderer)

    def savefig(self, *args: Any, **kwargs: Any) -> None:
        """Write the figure as Matplotlib does.

        Raises:
            ConfigurationError: The variable SOURCE_DATE_EPOCH, which dates SVG and PDF files, is no
                time.
        """
        try:
            super().savefig(*args, **kwargs)
        except (ValueError, OverflowError) as error:
            seconds = os.environ.get("SOURCE_DATE_EPOCH", "")
            if not seconds or _is_date(seconds):
                raise
            raise ConfigurationError(
                f"the variable SOURCE_DATE_EPOCH is {seconds!r}; give the date of the picture in "
                "whole seconds since 1970, or unset it"
            ) from error

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return the picture and its size on the page [px]."""
        buffer = io.BytesIO()
        with style(), mpl.rc_context({"text.parse_math": True}):  # as ticks of powers of ten need
            self.savefig(buffer, format="png")
        width, height = (int(PIXELS_PER_INCH * inches) for inches in self.get_size_inches())
        return buffer.getvalue(), {"width": width, "height": height}


def _is_date(seconds: str) -> bool:
    """Tell whether a text is a time in whole seconds since 1970."""
    try:
        datetime.fromtimestamp(int(seconds), timezone.utc)
    except (ValueError, OverflowError, OSError):
        return False
    return True


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
        return _few_ticks(whole.add_subplot(projection="3d" if spatial else None))
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
    return _few_ticks(ax)


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
        return whole, [_few_ticks(axes) for axes in make(whole)]
    wanted = list(make(Figure()))
    given = list(np.ravel(np.asarray(ax, dtype=object)))
    kinds = [axes.name if isinstance(axes, mpl.axes.Axes) else repr(axes) for axes in given]
    if kinds != (needed := [axes.name for axes in wanted]):
        raise ConfigurationError(
            f"ax is {', '.join(kinds)}; this drawing has {len(needed)} panels: give a figure or a "
            f"subfigure, or axes with these projections: {', '.join(needed)}"
        )
    return None, [_few_ticks(axes) for axes in given]


def headline(whole: Any, panels: Sequence[Any], text: str) -> None:
    """Write a title over all panels, or over the first one where there is no figure of theirs."""
    if whole is None:
        entitle(panels[0], text)
    else:
        width = whole.bbox.width / whole.get_figure(root=True).dpi
        whole.suptitle(folded(text, width, mpl.rcParams["axes.titlesize"]), x=0.02, ha="left")


def draw_curves(axes: Any, x: Array, columns: Array, names: Sequence[str], **look: Any) -> None:
    """Draw each column of (m, k) values over x (m,) in a colour of its own, named in the legend."""
    for column, name, color in zip(columns.T, names, cycle(COLOURS), strict=False):
        axes.plot(x, column, color=color, label=name, **look)


def legend_beside(axes: Any, **look: Any) -> None:
    """Name the curves to the right of the axes."""
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, **look)


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


class Label(Annotation):
    """A label beside a point, in the plane or in space, where it covers no other text of the axes.

    Args:
        text: The text.
        at: (2,) or (3,) the point, in the coordinates of the axes.
        towards: (2,) direction in which it stands from its point if it can.
        **look: As of `matplotlib.text.Text`.
    """

    def __init__(self, text: str, at: Array, towards: Array, **look: Any) -> None:
        line = {"arrowstyle": "-", "color": look.get("color", GREY), "lw": 0.6}
        place = (float(at[0]), float(at[1]))
        super().__init__(text, place, (0, 0), textcoords="offset points", arrowprops=line, **look)
        self._at, self._offsets = at, OFFSETS[np.argsort(-OFFSETS @ towards, kind="stable")]
        self.set_transform(IdentityTransform())
        self.set_in_layout(False)

    def draw(self, renderer: Any) -> None:
        """Draw the label where there is room for it."""
        axes: Any = self.axes
        if len(self._at) == 3:
            self.xy = proj_transform(*self._at, axes.get_proj())[:2]
        taken = [text.get_window_extent(renderer) for text in _other_texts(axes, self)]
        within = axes.bbox
        least = np.inf
        for distance in DISTANCES:
            for x, y in self._offsets:
                box = self._place(x, y, distance, renderer)
                over = sum(_common(box, other) for other in taken)
                over += box.width * box.height - _common(box, within)
                if over < least:
                    least, best = over, (x, y, distance)
            if least <= 0.0:
                break
        self._place(*best, renderer)
        if self.arrow_patch is not None:
            self.arrow_patch.set_visible(best[2] > DISTANCES[0])
        super().draw(renderer)

    def _place(self, x: float, y: float, distance: float, renderer: Any) -> Bbox:
        """Put the label at an offset; return the box of its text [px]."""
        self.set_position((x * distance, y * distance))
        self.set_horizontalalignment("left" if x > 0.5 else "right" if x < -0.5 else "center")
        self.set_verticalalignment("bottom" if y > 0.5 else "top" if y < -0.5 else "center")
        self.update_positions(renderer)
        return Text.get_window_extent(self, renderer)


def _other_texts(axes: Any, label: Label) -> Iterator[Any]:
    """Yield what a label must not touch: other texts of its axes, as far as they are drawn."""
    for text in axes.texts:
        if text is label:
            break
        yield text
    yield from (text for text in axes.texts if not isinstance(text, Label))
    yield from filter(None, (axes.title, axes._left_title, axes.get_legend()))
    for axis in (axes.xaxis, axes.yaxis, *([axes.zaxis] if axes.name == "3d" else ())):
        yield axis.label
        yield from (tick.label1 for tick in axis.get_major_ticks())


def _common(one: Bbox, other: Bbox) -> float:
    """Return the area that two boxes share."""
    both = Bbox.intersection(one, other)
    return 0.0 if both is None else float(both.width * both.height)


def annotate(
    axes: Any, text: str, at: Array, color: str, *, towards: Array = UP, formula: bool = False
) -> None:
    """Write a label beside a point, in the plane or in space, away from other labels."""
    label = Label(text, at, towards, color=color, parse_math=formula, zorder=IN_FRONT)
    label.set_path_effects([withStroke(linewidth=2.5, foreground="white")])  # over bodies, too
    axes.add_artist(label)


def entitle(axes: Any, text: str, **look: Any) -> None:
    """Write the title of axes, in lines no longer than these are wide."""
    size = look.get("fontsize", mpl.rcParams["axes.titlesize"])
    text = shortened(text, LONGEST_TITLE)
    axes.set_title(folded(text, axes.get_window_extent().width / axes.figure.dpi, size), **look)


def folded(text: str, width: float, size: float | str) -> str:
    """Return a text in lines that fit a width [inch] at a size of the font [pt]."""
    points = FontProperties(size=size).get_size_in_points()
    letters = max(int(72.0 * width / (LETTER * points)), 12)
    return "\n".join(textwrap.fill(line, letters) for line in text.split("\n"))


def _few_ticks(axes: Any) -> Any:
    """Give axes so few ticks that their labels do not touch."""
    spatial = axes.name == "3d"
    for axis in (axes.xaxis, axes.yaxis, *([axes.zaxis] if spatial else ())):
        if isinstance(locator := axis.get_major_locator(), AutoLocator):
            locator.set_params(nbins=MOST_TICKS[spatial], prune="both" if spatial else None)
        if spatial:
            axis.labelpad = 8.0  # as wide as the labels of ticks
    return axes
