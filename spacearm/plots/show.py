"""`spacearm.plot`: one figure for each kind of result."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

from spacearm.errors import ConfigurationError
from spacearm.signatures import check_options, checked

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase


@checked
def plot(
    thing: object, ax: Axes | Sequence[Axes] | FigureBase | None = None, **options: Any
) -> Figure:
    """Draw a result.

    In a notebook the figure is shown where it is the last line of a cell; elsewhere write it with
    `figure.savefig`.

    Args:
        thing: An arm, a configuration, or what a function of spacearm returns: a report, a map, a
            singular set, a workspace, a risk, a motion, a capture, the arrays of `evaluate`, the
            datasets of `design`, `sweep` and `simulate_many`, ...
        ax: Matplotlib axes to draw into, with `projection="3d"` for drawings in space. For
            drawings of several panels a sequence of axes, as `sa.plot(thing).axes` has them. Or a
            figure or subfigure, which gets the axes that are needed (best made with
            layout="constrained"). None makes a new figure.
        **options: What some drawings take besides. Motions: `target` (a point to mark) and
            `workspace`, both [m] in inertial axes. Workspaces: `path` (points from the system CM
            [m]) and `profile` (a risk profile). Arms and configurations: `color` and `label`;
            configurations of planar arms: `velocities` (what unit joint rates give to the tip).
            Singular maps: `box` (joint ranges without singular posture).
            Barycentric quantities: `chain` (whether to draw the Virtual Manipulator).

    Returns:
        The figure; that of `ax` where it is given. A notebook shows it once, those of
        `matplotlib.pyplot` too.

    Raises:
        ConfigurationError: There is no drawing of `thing`, it does not take one of the options, or
            cannot be drawn into `ax`.
        UnsupportedError: The singular set has nothing to draw.

    Example:
        >>> import spacearm as sa
        >>> figure = sa.plot(sa.singular_map(sa.load("planar2")))
        >>> figure.savefig("map.png")
    """
    try:
        from spacearm.plots.drawings import drawing_of, drawn_of, shown_once  # imports matplotlib
    except ValueError as error:
        raise ConfigurationError(f"MPLBACKEND names no backend of Matplotlib: {error}") from None
    thing = drawn_of(thing)
    draw, name = drawing_of(thing), type(thing).__name__
    _, _, *known = inspect.signature(draw).parameters
    for option in options:
        if option not in known:
            raise ConfigurationError(
                f"a drawing of a {name} has no option {option!r}; it takes: "
                f"{', '.join(known) or 'none'}"
            )
    check_options(draw, f"a drawing of a {name}", options)
    return shown_once(draw(thing, ax=ax, **options).get_figure(root=True))
