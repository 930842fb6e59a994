"""Plots, in one style: labelled axes with units, colours that all can tell apart, fit for print."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib import rcsetup
from matplotlib.figure import Figure

from spacearm.files import write
from spacearm.viewer.show import in_notebook

if TYPE_CHECKING:
    pass

BLUE, RED, GREEN, ORANGE, GREY = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#5b6470"
PURPLE, SKY = "#cc79a7", "#56b4e9"
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY)
"""Okabe and Ito's colours."""
STYLE: Any = {  # matplotlib's names of settings are no plain text to its stubs
    "figure.dpi": 110,
    "savefig.dpi": 160,
    "font.size": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": rcsetup.cycler(color=COLOURS),
    "axes.titlelocation": "left",
    "axes.titlesize": 12,
    "figure.constrained_layout.use": True,
    "svg.hashsalt": "spacearm",
}
PIXELS_PER_INCH = 90
"""Size of figures in notebooks."""
TITLE = 54
"""Characters in a line of a title."""


@contextmanager
def style() -> Iterator[None]:
    """The style of the project, for as long as the context lasts."""
    with mpl.rc_context(STYLE):
        yield


@dataclass(frozen=True)
class Shown:
    """A figure that stands in a notebook where it is the last line of a cell.

    Attributes:
        figure: The figure.
    """

    figure: Figure

    def png(self) -> bytes:
        """The picture."""
        buffer = io.BytesIO()
        with style():
            self.figure.savefig(buffer, format="png")
        return buffer.getvalue()

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """The picture and its size on the page [px]."""
        width, height = (int(PIXELS_PER_INCH * inches) for inches in self.figure.get_size_inches())
        return self.png(), {"width": width, "height": height}


def show(figure: Figure, name: str) -> Shown:
    """Shows a figure in a notebook; where the notebook runs as a script, writes NAME.png."""
    shown = Shown(figure)
    if not in_notebook():
        print(f"wrote {write(Path(f'{name}.png'), shown.png())}")
    return shown
