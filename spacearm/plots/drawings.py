"""Drawings: which function draws which kind of result, and where a notebook shows it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from spacearm.errors import ConfigurationError
from spacearm.plots import configurations, datasets, maps, mission, motions, reports, workspaces
from spacearm.plots.style import DRAWINGS
from spacearm.signatures import shown

#: All that draw: they are entered in `DRAWINGS` when they are imported.
MODULES = (configurations, datasets, maps, mission, motions, reports, workspaces)
#: Packages whose classes are drawn.
HOMES = ("spacearm", "numpy", "xarray", "builtins")
#: Classes that stand for what else is drawn.
OTHERS = {"Described", "dict", "ndarray", "Dataset"}


def kinds_of(thing: object) -> list[str]:
    """Return the names of the classes that a thing is of, its own first."""
    kinds = type(thing).__mro__
    return [kind.__name__ for kind in kinds if kind.__module__.partition(".")[0] in HOMES]


def drawing_of(thing: object) -> Callable[..., Any]:
    """Return what draws a thing."""
    for kind in kinds_of(thing):
        if kind in DRAWINGS:
            return DRAWINGS[kind]
    names = sorted(DRAWINGS.keys() - OTHERS)
    raise ConfigurationError(
        f"there is no drawing of {shown(thing)}; what can be drawn: "
        f"{', '.join(names)}, the arrays of evaluate, the datasets of design, sweep and "
        "simulate_many"
    )


def drawn_of(thing: object) -> object:
    """Return what is drawn of a thing: of the plan and the proof of `robust_plan` the plan."""
    if type(thing) is tuple:
        own = DRAWINGS.keys() - {"Described"}
        parts = [part for part in thing if not own.isdisjoint(kinds_of(part))]
        return parts[0] if len(parts) == 1 else thing
    return thing


def shown_once(figure: Figure) -> Figure:
    """Have a notebook that shows a figure as the value of a cell not show it as pyplot's, too."""
    if getattr(figure.canvas, "manager", None) is not None:
        vars(figure)["_ipython_display_"] = partial(_close, figure)
    return figure


def _close(figure: Figure) -> None:
    """Take a figure that is being shown from pyplot, which would show it where the cell ends.

    Raises:
        NotImplementedError: Always: it tells IPython that this method displays nothing itself.
    """
    if "inline" in mpl.get_backend():
        import matplotlib.pyplot as plt

        plt.close(figure)
    raise NotImplementedError("figures are displayed by their formatters")
