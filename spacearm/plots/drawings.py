"""Drawings: which function draws which kind of result."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any

from spacearm.collisions.separation import CollisionReport
from spacearm.errors import ConfigurationError
from spacearm.mechanics.barycentric_formulation import Barycentric, VirtualManipulator
from spacearm.mechanics.dynamics import Capture, Dynamics
from spacearm.mechanics.jacobian import MomentumMatrix, PrescribedMotion
from spacearm.mission.attitudes import FeasibleAttitudes
from spacearm.mission.budget import MomentumBudget
from spacearm.mission.level import LevelEnvelope, LevelReach
from spacearm.mission.reactions import Reaction, WheelSizing
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion
from spacearm.plots.configurations import (
    draw_arm,
    draw_barycentric,
    draw_configuration,
    draw_region,
    draw_virtual_manipulator_alone,
)
from spacearm.plots.maps import draw_map, draw_singular_set
from spacearm.plots.mission import (
    draw_attitudes,
    draw_budget,
    draw_envelope,
    draw_level,
    draw_reaction,
    draw_wheel_sizing,
)
from spacearm.plots.motions import draw_motion
from spacearm.plots.obstacles import draw_collision_report
from spacearm.plots.polynomials import draw_polynomial
from spacearm.plots.reports import (
    draw_capture,
    draw_dynamics,
    draw_error_bars,
    draw_momentum_matrix,
    draw_prescribed_motion,
    draw_report,
)
from spacearm.plots.uncertainty import draw_distance_range, draw_shell_bands
from spacearm.plots.workspaces import draw_design, draw_pose_risk, draw_profile, draw_workspace
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.singularities.abstract_set import SingularSet
from spacearm.singularities.map import SingularMap
from spacearm.singularities.report import SingularityReport
from spacearm.singularities.risk import PoseRisk, RiskProfile
from spacearm.singularities.rounding import ErrorBars
from spacearm.uncertainty.robust import DistanceRange, ShellBands
from spacearm.workspaces.path_dependent import Region, Workspace

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
    CollisionReport: draw_collision_report,
    Workspace: draw_workspace,
    Region: draw_region,
    RiskProfile: draw_profile,
    PoseRisk: draw_pose_risk,
    Motion: draw_motion,
    FeasibleAttitudes: draw_attitudes,
    Reaction: draw_reaction,
    WheelSizing: draw_wheel_sizing,
    LevelReach: draw_level,
    LevelEnvelope: draw_envelope,
    MomentumBudget: draw_budget,
    DistanceRange: draw_distance_range,
    ShellBands: draw_shell_bands,
}
"""What draws each kind of result."""


def drawing_of(thing: object) -> Callable[..., Any]:
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
