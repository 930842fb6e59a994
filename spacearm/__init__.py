"""spacearm: where a free-floating space manipulator cannot move, why, and what to do about it.

    import spacearm as sa

    arm = sa.load("planar2")
    cfg = arm.at(np.radians([-65, -11.41]))
    sa.singularity(cfg)

Names by what they are for:

===========  ====================================================================================
load         load mount catalogue arms SpaceArm Configuration Task Bus ModelInfo ArmInfo
query        singularity generalized_jacobian generalized_jacobian_derivative
             generalized_jacobian_rate fixed_base_jacobian prescribed_motion error_bars evaluate
             generalized_jacobians SingularityReport PrescribedMotion ErrorBars
dynamics     momentum_matrix base_velocity generalized_inertia forward_dynamics inverse_dynamics
             kinetic_energy capture barycentric MomentumMatrix Dynamics Capture Barycentric
             VirtualManipulator
sets         singular_set singular_map singularity_polynomial SingularSet FoundSet SingularMap
             TrigPolynomial Certificate
workspaces   workspace risk_profile pose_risk design Workspace Region RiskProfile PoseRisk
motion       simulate follow move JointPD TransposedJacobian ResolvedRate DampedLeastSquares
             Reactionless Motion Trajectory Followed Event
planning     plan Joints Plan Attempt
sweeps       sweep Study
show         plot view
errors       SpaceArmError ModelError ConfigurationError UnsupportedError NoSolutionError
             StoreError SweepError ModelWarning
===========  ====================================================================================

Conventions, everywhere:

===========  ====================================================================================
twist        [linear; angular] of the frame's origin, inertial axes (Pinocchio's
             LOCAL_WORLD_ALIGNED)
momentum     [linear; angular about the system CM], inertial axes
quaternion   xyzw, as Pinocchio and scipy have it
pose         pin.SE3; `base` and `tip` are placements in the inertial frame
angles       rad; the command line takes degrees with --deg
q            (n,) one number per joint that counts, in the model's order, spacecraft excluded
task         rows named "x y z rx ry rz"; aliases "pose", "position", "orientation"; a length [m]
             scales the linear rows where both kinds are present
distance     to the singular set: over all joints together, rad; of sliding joints see
             SingularityReport
symbols      q, dq, J, A_b, A_q, D, D_q, M, mu, c, l, r, v as in Papadopoulos & Dubowsky, Dynamic
             Singularities in Free-Floating Space Manipulators, J. Dyn. Sys. Meas. Control 115(1),
             44-52 (1993), whose equation numbers are cited as (35)
===========  ====================================================================================
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from spacearm.description.bus import Bus
    from spacearm.description.model_catalogue import ArmInfo, ModelInfo, arms, catalogue
    from spacearm.errors import (
        ConfigurationError,
        ModelError,
        ModelWarning,
        NoSolutionError,
        SpaceArmError,
        StoreError,
        SweepError,
        UnsupportedError,
    )
    from spacearm.mechanics.barycentric_formulation import (
        Barycentric,
        VirtualManipulator,
        barycentric,
    )
    from spacearm.mechanics.batch import evaluate, generalized_jacobians
    from spacearm.mechanics.dynamics import (
        Dynamics,
        forward_dynamics,
        generalized_inertia,
        inverse_dynamics,
        kinetic_energy,
    )
    from spacearm.mechanics.floating import move
    from spacearm.mechanics.impact import Capture, capture
    from spacearm.mechanics.jacobian import (
        PrescribedMotion,
        fixed_base_jacobian,
        generalized_jacobian,
        generalized_jacobian_derivative,
        generalized_jacobian_rate,
        prescribed_motion,
    )
    from spacearm.mechanics.momentum import MomentumMatrix, base_velocity, momentum_matrix
    from spacearm.model.arm import SpaceArm
    from spacearm.model.configuration import Configuration
    from spacearm.model.loading import load, mount
    from spacearm.model.task import Task
    from spacearm.motion.controllers import (
        DampedLeastSquares,
        JointPD,
        Reactionless,
        ResolvedRate,
        TransposedJacobian,
    )
    from spacearm.motion.events import Event
    from spacearm.motion.following import Followed, follow
    from spacearm.motion.motion import Motion
    from spacearm.motion.simulation import simulate
    from spacearm.motion.trajectory import Trajectory
    from spacearm.planning.planner import plan
    from spacearm.planning.result import Attempt, Joints, Plan
    from spacearm.plots.show import plot
    from spacearm.polynomial.certificate import Certificate
    from spacearm.polynomial.trig import TrigPolynomial
    from spacearm.singularities.abstract_set import SingularSet
    from spacearm.singularities.map import SingularMap, singular_map
    from spacearm.singularities.polynomial import singularity_polynomial
    from spacearm.singularities.report import SingularityReport, singularity
    from spacearm.singularities.risk import PoseRisk, RiskProfile, pose_risk, risk_profile
    from spacearm.singularities.rounding import ErrorBars, error_bars
    from spacearm.singularities.searched_set import FoundSet
    from spacearm.singularities.sets import singular_set
    from spacearm.sweeps.runner import sweep
    from spacearm.sweeps.study import Study
    from spacearm.viewer.show import view
    from spacearm.workspaces import design
    from spacearm.workspaces.path_dependent import Workspace, workspace
    from spacearm.workspaces.regions import Region

    __version__: str

__all__ = ["__version__"]
__all__ += [
    "ArmInfo",
    "Bus",
    "Configuration",
    "ModelInfo",
    "SpaceArm",
    "Task",
    "arms",
    "catalogue",
    "load",
    "mount",
]  # load
__all__ += [
    "ErrorBars",
    "PrescribedMotion",
    "SingularityReport",
    "error_bars",
    "evaluate",
    "fixed_base_jacobian",
    "generalized_jacobian",
    "generalized_jacobian_derivative",
    "generalized_jacobian_rate",
    "generalized_jacobians",
    "prescribed_motion",
    "singularity",
]  # query
__all__ += [
    "Barycentric",
    "Capture",
    "Dynamics",
    "MomentumMatrix",
    "VirtualManipulator",
    "barycentric",
    "base_velocity",
    "capture",
    "forward_dynamics",
    "generalized_inertia",
    "inverse_dynamics",
    "kinetic_energy",
    "momentum_matrix",
]  # dynamics
__all__ += [
    "Certificate",
    "FoundSet",
    "SingularMap",
    "SingularSet",
    "TrigPolynomial",
    "singular_map",
    "singular_set",
    "singularity_polynomial",
]  # sets
__all__ += [
    "PoseRisk",
    "Region",
    "RiskProfile",
    "Workspace",
    "design",
    "pose_risk",
    "risk_profile",
    "workspace",
]  # workspaces
__all__ += [
    "DampedLeastSquares",
    "Event",
    "Followed",
    "JointPD",
    "Motion",
    "Reactionless",
    "ResolvedRate",
    "Trajectory",
    "TransposedJacobian",
    "follow",
    "move",
    "simulate",
]  # motion
__all__ += ["Attempt", "Joints", "Plan", "plan"]  # planning
__all__ += ["Study", "sweep"]  # sweeps
__all__ += ["plot", "view"]  # show
__all__ += [
    "ConfigurationError",
    "ModelError",
    "ModelWarning",
    "NoSolutionError",
    "SpaceArmError",
    "StoreError",
    "SweepError",
    "UnsupportedError",
]  # errors

_HOMES = {
    "description.bus": "Bus",
    "description.model_catalogue": "ArmInfo ModelInfo arms catalogue",
    "errors": (
        "ConfigurationError ModelError ModelWarning NoSolutionError SpaceArmError StoreError "
        "SweepError UnsupportedError"
    ),
    "mechanics.barycentric_formulation": "Barycentric VirtualManipulator barycentric",
    "mechanics.batch": "evaluate generalized_jacobians",
    "mechanics.dynamics": (
        "Dynamics forward_dynamics generalized_inertia inverse_dynamics kinetic_energy"
    ),
    "mechanics.floating": "move",
    "mechanics.impact": "Capture capture",
    "mechanics.jacobian": (
        "PrescribedMotion fixed_base_jacobian generalized_jacobian "
        "generalized_jacobian_derivative generalized_jacobian_rate prescribed_motion"
    ),
    "mechanics.momentum": "MomentumMatrix base_velocity momentum_matrix",
    "model.arm": "SpaceArm",
    "model.configuration": "Configuration",
    "model.loading": "load mount",
    "model.task": "Task",
    "motion.controllers": "DampedLeastSquares JointPD Reactionless ResolvedRate TransposedJacobian",
    "motion.events": "Event",
    "motion.following": "Followed follow",
    "motion.motion": "Motion",
    "motion.simulation": "simulate",
    "motion.trajectory": "Trajectory",
    "planning.planner": "plan",
    "planning.result": "Attempt Joints Plan",
    "plots.show": "plot",
    "polynomial.certificate": "Certificate",
    "polynomial.trig": "TrigPolynomial",
    "singularities.abstract_set": "SingularSet",
    "singularities.map": "SingularMap singular_map",
    "singularities.polynomial": "singularity_polynomial",
    "singularities.report": "SingularityReport singularity",
    "singularities.risk": "PoseRisk RiskProfile pose_risk risk_profile",
    "singularities.rounding": "ErrorBars error_bars",
    "singularities.searched_set": "FoundSet",
    "singularities.sets": "singular_set",
    "sweeps.runner": "sweep",
    "sweeps.study": "Study",
    "viewer.show": "view",
    "workspaces.design": "design",
    "workspaces.path_dependent": "Workspace workspace",
    "workspaces.regions": "Region",
}
"""Public names by the modules that hold them, which are imported when a name is first used."""


def __getattr__(name: str) -> object:
    """Import what a public name stands for."""
    home = next((home for home, names in _HOMES.items() if name in names.split()), None)
    if name == "__version__":
        from importlib.metadata import version

        value: object = version("spacearm")
    elif home is None:
        raise AttributeError(f"module 'spacearm' has no attribute {name!r}")
    else:
        module = import_module(f"spacearm.{home}")
        value = getattr(module, name, module)  # `design` is the module itself
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return __all__
