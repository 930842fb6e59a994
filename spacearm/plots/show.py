"""`spacearm.plot`: one figure for each kind of result."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from spacearm.errors import ConfigurationError
from spacearm.mechanics.barycentric_formulation import Barycentric, VirtualManipulator
from spacearm.mechanics.dynamics import Dynamics
from spacearm.mechanics.impact import Capture
from spacearm.mechanics.jacobian import PrescribedMotion
from spacearm.mechanics.momentum import MomentumMatrix
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.motion.following import Followed
from spacearm.motion.motion import Motion
from spacearm.motion.trajectory import Trajectory
from spacearm.planning.result import Plan
from spacearm.plots.configurations import (
    draw_arm,
    draw_barycentric,
    draw_configuration,
    draw_region,
    draw_virtual_manipulator_alone,
)
from spacearm.plots.maps import draw_map, draw_singular_set
from spacearm.plots.motions import draw_motion
from spacearm.plots.polynomials import draw_polynomial
from spacearm.plots.reports import (
    draw_capture,
    draw_dynamics,
    draw_error_bars,
    draw_momentum_matrix,
    draw_prescribed_motion,
    draw_report,
)
from spacearm.plots.workspaces import draw_design, draw_pose_risk, draw_profile, draw_workspace
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.singularities.exact_set import SingularSet
from spacearm.singularities.map import SingularMap
from spacearm.singularities.report import SingularityReport
from spacearm.singularities.risk import PoseRisk, RiskProfile
from spacearm.singularities.rounding import ErrorBars
from spacearm.singularities.searched_set import FoundSet
from spacearm.workspaces.path_dependent import Workspace
from spacearm.workspaces.regions import Region

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DRAWINGS: Mapping[type, Callable[..., Any]] = {
    SpaceArm: draw_arm,
    Configuration: draw_configuration,
    SingularityReport: draw_report,
    ErrorBars: draw_error_bars,
    MomentumMatrix: draw_momentum_matrix,
    PrescribedMotion: draw_prescribed_motion,
    Dynamics: draw_dynamics,
    Capture: draw_capture,
    Barycentric: draw_barycentric,
    VirtualManipulator: draw_virtual_manipulator_alone,
    TrigPolynomial: draw_polynomial,
    SingularMap: draw_map,
    SingularSet: draw_singular_set,
    FoundSet: draw_singular_set,
    Workspace: draw_workspace,
    Region: draw_region,
    RiskProfile: draw_profile,
    PoseRisk: draw_pose_risk,
    Motion: draw_motion,
    Trajectory: draw_motion,
    Followed: draw_motion,
    Plan: draw_motion,
}
"""What draws each kind of result. A function without the parameter `ax` draws several panels."""


def plot(thing: object, ax: Axes | None = None, **options: Any) -> Figure:
    """Draw a result.

    In a notebook the figure is shown where it is the last line of a cell; elsewhere write it with
    `figure.savefig`.

    Args:
        thing: An arm, a configuration, or what a function of spacearm returns: a report, a map, a
            singular set, a workspace, a risk, a motion, a capture, the dataset of `design`, ...
        ax: Matplotlib axes to draw into, if the drawing has one panel; with `projection="3d"` for
            drawings in space. None makes a new figure.
        **options: What some drawings take besides. Motions: `target` (a point to mark) and
            `workspace`, both [m] in inertial axes. Workspaces: `path` (points from the system CM
            [m]) and `profile` (a risk profile). Arms and configurations: `color` and `label`.

    Returns:
        The figure; `ax.figure` where axes are given.

    Raises:
        ConfigurationError: There is no drawing of `thing`, it does not take one of the options, or
            cannot be drawn into `ax`.
        UnsupportedError: The singular set has nothing to draw.

    Example:
        >>> import spacearm as sa
        >>> figure = sa.plot(sa.singular_map(sa.load("planar2")))
        >>> figure.savefig("map.png")
    """
    draw, name = _drawing(thing), type(thing).__name__
    _, *taken = inspect.signature(draw).parameters
    if ax is not None and "ax" not in taken:
        raise ConfigurationError(f"a drawing of a {name} has several panels; leave ax out")
    known = [option for option in taken if option != "ax"]
    for option in options:
        if option not in known:
            raise ConfigurationError(
                f"a drawing of a {name} has no option {option!r}; it takes: "
                f"{', '.join(known) or 'none'}"
            )
    return draw(thing, **options) if ax is None else draw(thing, ax=ax, **options)


def _drawing(thing: object) -> Callable[..., Any]:
    """Return what draws a thing."""
    drawings = dict(DRAWINGS)
    if "xarray" in sys.modules:  # else the thing cannot be a dataset
        drawings[sys.modules["xarray"].Dataset] = draw_design
    for kind in type(thing).__mro__:
        if kind in drawings:
            return drawings[kind]
    names = sorted({kind.__name__ for kind in DRAWINGS} | {"the dataset of spacearm.design"})
    raise ConfigurationError(
        f"there is no drawing of a {type(thing).__name__}; what can be drawn: {', '.join(names)}"
    )
