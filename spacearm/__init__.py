"""spacearm: where a free-floating space manipulator cannot move, why, and what to do about it.

    import spacearm as sa

    arm = sa.load("planar2")
    cfg = arm.at(np.radians([-65, -11.41]))
    sa.singularity(cfg)

Names by what they are for:

===========  ====================================================================================
load         load mount pose catalogue arms SpaceArm Configuration Task Bus ModelInfo ArmInfo
query        singularity generalized_jacobian generalized_jacobian_derivative
             generalized_jacobian_rate fixed_base_jacobian prescribed_motion error_bars evaluate
             generalized_jacobians SingularityReport PrescribedMotion ErrorBars
dynamics     momentum_matrix base_velocity generalized_inertia forward_dynamics inverse_dynamics
             joint_accelerations kinetic_energy capture barycentric MomentumMatrix Dynamics Capture
             Barycentric VirtualManipulator
sets         singular_set singular_map singularity_polynomial free_box free_boxes SingularSet
             FoundSet SingularMap TrigPolynomial Certificate FreeBox FreeBoxes
workspaces   workspace risk_profile pose_risk design Workspace Region RiskProfile PoseRisk
motion       simulate simulate_many simulate_phases follow move JointPD TransposedJacobian
             ResolvedRate DampedLeastSquares Reactionless Plant Sampling Integration PassiveJoint
             WheelHold WheelFriction Phase Grasp Release Motion Trajectory Followed Flight Event
servo        Servo ServoStep ServoControl Watched
planning     plan detumble connected time_optimal Tracking collision_check Joints Constraints
             Search Plan Attempt Connection Obstacle CollisionReport
mission      feasible_attitudes reaction size_wheels level_reach level_envelope momentum_budget
             catch fly_many hold FeasibleAttitudes Reaction WheelSizing LevelReach LevelEnvelope
             MomentumBudget Target Catch TargetErrors CaptureEnvelope CatchRuns Held HeldReport
             ClosedMap FollowedTarget TargetPlan TargetRun Regrasp
uncertainty  uncertain distance_range is_free_for_all free_box_for_all shell_bands robust_plan
             identify UncertainArm DistanceRange RobustCertificate ShellBands Identified
sweeps       sweep Study
export       to_jax to_casadi to_c to_mjcf to_sdf write_motion GeneralizedJacobianTask
             MomentumConservation SingularityBarrier
show         plot view design_report
errors       SpaceArmError ModelError ConfigurationError UnsupportedError NoSolutionError
             ImpossibleError StoppedError ResourceError StoreError SweepError ModelWarning
===========  ====================================================================================

Conventions, everywhere:

===========  ====================================================================================
twist        [linear; angular] of the frame's origin, inertial axes (Pinocchio's
             LOCAL_WORLD_ALIGNED)
momentum     [linear; angular about the system CM], inertial axes
quaternion   xyzw, as Pinocchio and scipy have it
pose         pin.SE3, also given as a (4, 4) matrix or made by `pose(xyz=, rpy=)`; `base` and `tip`
             are placements in the inertial frame
points       in the inertial frame. The spacecraft's frame starts at its origin (`base` puts it
             elsewhere), as in `SpaceArm.at`; with origin="cm" (--with origin=cm) the system CM
             does. `Workspace`, which knows no start, takes points from the system CM, or with
             `start=` in the frame of a configuration. Answers say which (`origin`)
angles       rad; the command line takes degrees with --deg
q            (n,) one number per joint that counts, in the model's order, spacecraft excluded
task         rows named "x y z rx ry rz"; aliases "pose", "position", "orientation"; a length [m]
             scales the linear rows where both kinds are present
distance     to the singular set: over all joints together, rad; of sliding joints see
             SingularityReport. Found, so that the nearest singular posture is no farther (nearest,
             motions, singularity with exact=True); proven, so that none is nearer
             (distance_proven, clearance); or to first order, an estimate (singularity, evaluate,
             maps, risk, attitudes, many runs)
symbols      q, dq, J, A_b, A_q, D, D_q, M, mu, c, l, r, v as in Papadopoulos & Dubowsky, Dynamic
             Singularities in Free-Floating Space Manipulators, J. Dyn. Sys. Meas. Control 115(1),
             44-52 (1993), whose equation numbers are cited as (35)
===========  ====================================================================================
"""

import re
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
#: The module that holds each public name, as the stub says; imported when first used.
_HOMES = {name: home for home, name in re.findall(r"from (\S+) import \(?\s*(\w+) as", _STUB)}

__all__ = sorted(["__version__", *_HOMES])


class _Package(ModuleType):
    """This package; its folders and modules are not functions, and a call of them says so."""

    def __setattr__(self, name: str, value: object) -> None:
        if isinstance(value, ModuleType) and value.__name__.startswith(f"{__name__}."):
            value.__class__ = _Part
        super().__setattr__(name, value)


class _Part(ModuleType):
    def __call__(self, *_: object, **__: object) -> None:
        path, last = f"{self.__name__}.", self.__name__.rpartition(".")[2]
        names = [name for name, home in _HOMES.items() if f"{home}.".startswith(path)]
        names += [f"{last}.{name}" for name in vars(self).get("__all__", ())]
        calls = ", ".join(f"sa.{name}" for name in names if name.islower())
        remedy = f"call {calls}" if calls else "help(spacearm) lists what to call"
        raise TypeError(f"{self.__name__} is a part of the package, no function; {remedy}")


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> object:
    """Import what a public name stands for."""
    if name == "__version__":
        from importlib.metadata import version

        value: object = version("spacearm")
    elif name not in _HOMES:
        here = sys.modules[__name__]  # by it Python proposes names
        raise AttributeError(f"module 'spacearm' has no attribute {name!r}", name=name, obj=here)
    else:
        home = import_module(_HOMES[name])
        value = getattr(home, name, None) or import_module(f"{home.__name__}.{name}")  # `design`
    setattr(sys.modules[__name__], name, value)
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return __all__
