"""Figures of pyplot in notebooks, which are shown where a cell ends, whatever its last line is."""

from __future__ import annotations

from functools import partial

import matplotlib as mpl
from matplotlib.figure import Figure


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
