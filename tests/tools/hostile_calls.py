"""Hostile calls: public functions with an argument, or an entry of one, that is wrong."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from helpers.arms import with_wheels
from hostile import FaultError

import spacearm as sa


def _read_only(values: Any) -> np.ndarray:
    """An array that nothing may write to."""
    array = np.array(values)
    array.flags.writeable = False
    return array


NUMBERS = (
    0, 1, 2, -1, 0.0, -0.0, 0.3, 1e-308, 5e-324, 1e-160, 1e-13, 1e13, 1e30, 1e160, 1e308, 10**30,
    10**400, 10**5000, -(10**400), float("nan"), float("inf"), float("-inf"), True, np.True_,
    np.float64(0.3), np.float32(0.3), np.float16(0.3), np.int64(2), np.uint8(2), np.int8(-1),
    np.longdouble(0.3), np.array(0.3), np.array(2), np.complex128(1), 1j,
)  # fmt: skip
"""Numbers of all kinds and sizes; those between are work that was asked for."""
OTHERS = (
    None, "", "a", "x y", "joint_1", "inf", b"a", [], {}, (), set(), [0.3], [0.3, 1.2],
    _read_only([0.3, 1.2]), _read_only([0.1, 0, 0, 0, 0, 0.1]), np.array([]), np.zeros((0, 2)),
    np.zeros((2, 0)), np.array(["joint_1", "joint_2"]), np.array(["joint_1"]), np.array([0, 1]),
    np.array([0.3, np.nan]), np.array([[0.3, 1.2]]), np.array([0.3, 1.2], dtype=np.float32),
    np.array([0.3, 1.2], dtype=object), np.array([True, False]), ["joint_1", "joint_2"],
    [[0.3, 1.2], [0.3]], {"joint_1": 0.1}, {"joint_1": ...}, {"a": 1}, {1: 2}, {"link_1": {}},
    pin.Motion.Zero(), pin.SE3.Identity(), pin.Force.Zero(), pin.Inertia.Zero(), np.eye(3),
    np.eye(4), _read_only(np.eye(3)), np.eye(6), object(), print, float, np.str_("joint_1"),
    np.random.default_rng(0), range(2), (x for x in (0.3, 1.2)), ..., slice(2), Path("a"),
)  # fmt: skip


@lru_cache
def _loaded(name: str) -> sa.SpaceArm:
    return sa.load(name)


def _arm(name: str = "planar2") -> sa.SpaceArm:
    return _loaded(name)


def _cfg(name: str = "planar2") -> sa.Configuration:
    arm = _arm(name)
    return arm.at(np.linspace(0.3, 1.2, arm.n))


@lru_cache
def _plan() -> sa.Plan:
    return sa.plan(_cfg(), (0.9, 1.4))


@lru_cache
def _run() -> sa.Trajectory:
    return sa.simulate(_cfg(), sa.JointPD([0.5, 1.0], 5, 9), 0.5)


@lru_cache
def _reach() -> sa.Workspace:
    return sa.workspace(_arm(), effort=20)


@lru_cache
def _about() -> sa.UncertainArm:
    return sa.uncertain(_arm(), {"link_1": {"mass": 0.1}})


@lru_cache
def _servo() -> sa.Servo:
    return sa.Servo(_arm(), rates=0.5)


@lru_cache
def _boxes() -> sa.FreeBoxes:
    return sa.free_boxes(_arm(), most=200)


@lru_cache
def _tumbling() -> sa.Target:
    """A box before the hand of chaser7."""
    place = _cfg("chaser7").tip * sa.pose((0.1, 0.0, 0.8))
    box = sa.Bus(60.0, size=(0.6, 0.6, 0.8))
    return sa.Target(box, place, grapples={"ring": sa.pose((0, 0, -0.45))})


@lru_cache
def _held() -> sa.Held:
    """The tip of chaser7 closed on a body where it is."""
    cfg = _cfg("chaser7")
    box = sa.Target(sa.Bus(6.0, size=(0.2, 0.2, 0.2)), cfg.tip)
    return sa.hold(cfg, box, {cfg.arm.tips[0]: sa.pose()}, limits=False)


def _law() -> sa.JointPD:
    return sa.JointPD([0.5, 1.0], 5, 9)


def _brief() -> sa.Search:
    return sa.Search(timeout=2.0)


Q = [[0.3, 1.2], [0.4, 1.1]]
CALLS: Mapping[str, Callable[[], tuple[Callable[..., Any], dict[str, Any]]]] = {
    "load": lambda: (sa.load, {
        "source": "planar2", "tip": None, "task": None, "joints": "tip", "locked": {"joint_1": 0.1},
        "wheels": {}, "check": "error", "packages": [], "xacro_args": {}, "density": None,
    }),
    "mount": lambda: (sa.mount, {
        "arm": "vispa", "bus": sa.Bus(mass=200, size=(1, 1, 1)), "at": None, "tip": None,
        "locked": {},
    }),
    "pose": lambda: (sa.pose, {"xyz": (0, 0, 0), "rpy": (0, 0, 0)}),
    "Bus": lambda: (sa.Bus, {"mass": 20.0, "size": (1, 1, 1)}),
    "Task": lambda: (sa.Task, {"names": "x y rz", "length": 1.0, "tips": 1}),
    "replace": lambda: (_arm().replace, {
        "base_mass": 20.0, "link_length": {"link_1": 1.0}, "link_mass": {"link_1": 1.0},
        "locked": {}, "lower": [-1, -1], "upper": {"joint_1": 1.0}, "payload": 1.0,
        "wheels": {}, "joints": "tip", "base_inertia": np.eye(3), "tip": "tip", "task": "x y",
    }),
    "at": lambda: (_arm().at, {
        "q": [0.3, 1.2], "base": None, "wheels": None, "momentum": [0, 0, 0, 0, 0, 0.1],
    }),
    "grasp": lambda: (_arm().grasp, {"mass": 2.0, "inertia": np.eye(3), "com": (0, 0, 0.1)}),
    "capture": lambda: (sa.capture, {
        "cfg": _cfg(), "target_twist": [0.02, 0, 0, 0, 0, 0.03], "mass": 5.0, "inertia": np.eye(3),
        "com": [0, 0, 0], "dq": [0.0, 0.0], "joints": "free",
    }),
    "singularity": lambda: (sa.singularity, {
        "cfg": _cfg(), "tolerance": 1e-4, "mode": "free-floating", "exact": False,
    }),
    "generalized_jacobian_rate": lambda: (
        sa.generalized_jacobian_rate, {"cfg": _cfg(), "dq": [0.1, 0.2]}
    ),
    "forward_dynamics": lambda: (
        sa.forward_dynamics, {"cfg": _cfg(), "dq": [0.0, 0.0], "tau": [1, 0]}
    ),
    "inverse_dynamics": lambda: (
        sa.inverse_dynamics, {"cfg": _cfg(), "dq": [0.0, 0.0], "ddq": [1, 0]}
    ),
    "prescribed_motion": lambda: (
        sa.prescribed_motion, {"cfg": _cfg(), "rates": {"joint_1": 0.1}}
    ),
    "base_velocity": lambda: (sa.base_velocity, {"cfg": _cfg(), "dq": [0.1, 0.2]}),
    "evaluate": lambda: (
        sa.evaluate, {"arm": _arm(), "Q": Q, "quantities": ["sigma_min"], "threads": 1, "out": None}
    ),
    "generalized_jacobians": lambda: (
        sa.generalized_jacobians, {"arm": _arm(), "Q": Q, "threads": 1}
    ),
    "joint_accelerations": lambda: (
        sa.joint_accelerations, {"arm": _arm(), "Q": Q, "dQ": Q, "tau": Q, "threads": 1}
    ),
    "singular_map": lambda: (
        sa.singular_map, {"arm": _arm(), "q": None, "joints": None, "points": 9}
    ),
    "sample": lambda: (sa.singular_set(_arm()).sample, {"m": 3}),
    "clearance": lambda: (sa.singular_set(_arm()).clearance, {"path": Q, "at_least": 0.01}),
    "is_free": lambda: (
        sa.singular_set(_arm()).is_free, {"q0": Q[0], "q1": Q[1], "clearance": 0.01}
    ),
    "roots": lambda: (sa.singular_set(_arm()).roots, {"q": [0.3, 1.2], "joint": 1}),
    "nearest": lambda: (sa.singular_set(_arm()).nearest, {"q": [0.3, 1.2], "limits": True}),
    "curves": lambda: (
        sa.singular_set(_arm("planar3")).curves,
        {"joints": [0, 1], "q": [0.1, 0.2, 0.3], "resolution": 0.1},
    ),
    "free_box": lambda: (sa.free_box, {
        "about": _cfg(), "joints": ["joint_1"], "at_least": None, "within": None,
        "clearance": 0.01, "mode": "free-floating",
    }),
    "free_boxes": lambda: (
        sa.free_boxes, {"arm": _arm(), "within": None, "share": 0.5, "most": 200, "so_far": None}
    ),
    "boxes nearest": lambda: (_boxes().nearest, {"q": np.array([0.3, 1.2]), "most": 1}),
    "boxes path": lambda: (_boxes().path, {"q0": np.array([0.3, 1.2]), "q1": np.array([0.4, 1.1])}),
    "risk_profile": lambda: (sa.risk_profile, {
        "arm": _arm(), "limits": False, "sigma_min": None, "distance": 0.1, "bins": 4,
        "samples": 200, "seed": 0, "threads": 1,
    }),
    "pose_risk": lambda: (sa.pose_risk, {
        "arm": _arm(), "limits": False, "sigma_min": 0.1, "distance": None, "poses": 2,
        "neighbours": 5, "samples": 50, "seed": 0,
    }),
    "workspace": lambda: (sa.workspace, {
        "arm": _arm(), "mode": "free-floating", "limits": False, "effort": 20, "seed": 0,
    }),
    "design.workspaces": lambda: (sa.design.workspaces, {
        "arm": _arm(), "parameters": {"base_inertia": [1, 2]}, "limits": False, "effort": 20,
        "risk_bins": 0,
    }),
    "design.vary": lambda: (sa.design.vary, {
        "arm": _arm(),
        "parameters": {"payload": 1.0, "mount_x": 0.2, "base_inertia": 2.0, "length:link_1": 1.0},
    }),
    "optimise_mount": lambda: (
        sa.design.optimise_mount, {"arm": _arm(), "bounds": {"mount_x": (0, 0.5)}, "most": 2}
    ),
    "Integration": lambda: (_simulated_with, {
        "rtol": 1e-6, "atol": 1e-9, "dt": 0.01, "reach": 1e-3, "events": ["singularity"],
        "method": "auto",
    }),
    "Sampling": lambda: (_sampled, {
        "period": 0.05, "delay": 0.0, "position_noise": 0.0, "rate_noise": 0.0,
        "attitude_noise": 0.0, "seed": 0,
    }),
    "JointPD": lambda: (_controlled(sa.JointPD), {"target": [0.5, 1.0], "kp": 5, "kd": [9, 9]}),
    "TransposedJacobian": lambda: (
        _controlled(sa.TransposedJacobian), {"target": (0.9, 1.4), "kp": 5, "kd": 9}
    ),
    "ResolvedRate": lambda: (
        _controlled(sa.ResolvedRate), {"target": (0.9, 1.4), "gain": 1.0, "servo": 20.0}
    ),
    "DampedLeastSquares": lambda: (
        _controlled(sa.DampedLeastSquares),
        {"target": (0.9, 1.4), "gain": 1.0, "damping": 0.1, "threshold": 0.1, "servo": 20.0},
    ),
    "Tracking": lambda: (_controlled(sa.Tracking), {"motion": _plan(), "rate": 5.0}),
    "Plant": lambda: (_planted, {
        "wheels": None, "wrenches": {"link_1": [0, 0, 0.1, 0, 0, 0]}, "thrusters": {},
        "passive": {"joint_1": sa.PassiveJoint(1.0)}, "limits": True,
    }),
    "PassiveJoint": lambda: (_passive, {
        "stiffness": 1.0, "rest": 0.1, "damping": 0.1, "friction": 0.1, "slip": 1e-3,
    }),
    "WheelFriction": lambda: (sa.WheelFriction, {"viscous": 0.1, "dry": 1e-3, "slip": 1e-3}),
    "WheelHold": lambda: (sa.WheelHold, {
        "stiffness": 1.0, "damping": 1.0, "torque": 1.0, "capacity": 1.0,
    }),
    "simulate": lambda: (sa.simulate, {
        "start": _cfg(), "controller": _law(), "duration": 0.2, "dq": [0, 0],
        "mode": "free-floating", "stop": [],
    }),
    "simulate_many": lambda: (sa.simulate_many, {
        "starts": [_cfg(), _cfg()], "controller": _law(), "duration": 0.2, "dq": None,
        "threads": 1,
    }),
    "simulate_phases": lambda: (_phased, {
        "duration": 0.2, "mass": 2.0, "inertia": 0.1 * np.eye(3), "com": (0, 0, 0), "stop": [],
    }),
    "follow": lambda: (sa.follow, {
        "start": _cfg(), "path": [(1.5, 1.2)], "speed": 0.1, "length": None, "times": None,
        "limits": True, "at_rest": False,
    }),
    "move": lambda: (sa.move, {"cfg": _cfg(), "q": [0.5, 1.0]}),
    "motion at": lambda: (_run().at, {"t": 0.1}),
    "plan at": lambda: (_plan().at, {"t": 0.1}),
    "Constraints": lambda: (_planned, {
        "limits": True, "collisions": True, "obstacles": (), "clearance": 0.001,
        "keep_attitude": 1.0, "rates": 0.5, "wheels": None,
    }),
    "Search": lambda: (_searched, {"seed": 0, "timeout": 2.0, "method": "auto", "boxes": None}),
    "plan": lambda: (sa.plan, {
        "start": _cfg(), "goal": (0.9, 1.4), "origin": "cm", "via": (),
        "final_attitude": None, "duration": None, "final_twist": None, "search": _brief(),
    }),
    "time_optimal": lambda: (sa.time_optimal, {
        "motion": _plan(), "torque": 20.0, "rate": 2.0, "acceleration": 5.0, "rise": 0.1,
    }),
    "connected": lambda: (sa.connected, {"start": _cfg(), "goal": _cfg(), "limits": True}),
    "Obstacle.box": lambda: (_met(sa.Obstacle.box), {"size": 0.2, "pose": sa.pose((1.2, 0.4, 0))}),
    "Obstacle.sphere": lambda: (
        _met(sa.Obstacle.sphere), {"radius": 0.2, "pose": sa.pose((1.2, 0.4, 0))}
    ),
    "Obstacle.cylinder": lambda: (
        _met(sa.Obstacle.cylinder), {"radius": 0.2, "length": 0.1, "pose": sa.pose((1.2, 0.4, 0))}
    ),
    "Obstacle": lambda: (_obstacle, {"margin": 0.01, "begin": 0.0, "twist": np.zeros(6)}),
    "Target": lambda: (_target, {
        "twist": [0, 0, 0, 0, 0, 0.1], "orbit": 0.001, "t": 1.0,
    }),
    "TargetErrors": lambda: (sa.TargetErrors, {
        "place": 0.01, "turn": 0.01, "velocity": 0.01, "rate": 0.01, "mass": 0.1, "inertia": 0.1,
        "delay": 0.1,
    }),
    "CaptureEnvelope": lambda: (
        sa.CaptureEnvelope, {"place": 0.01, "turn": 0.01, "velocity": 0.01, "rate": 0.01}
    ),
    "reaction": lambda: (sa.reaction, {"motion": _plan()}),
    "size_wheels": lambda: (sa.size_wheels, {
        "arm": _arm(), "tip_speed": 0.1, "samples": 50, "near": 0.05, "seed": 0,
    }),
    "momentum_budget": lambda: (sa.momentum_budget, {"cfg": _spinning(), "horizon": 60.0}),
    "feasible_attitudes": lambda: (sa.feasible_attitudes, {
        "start": _cfg(), "path": [(2.0, 0.0), (1.5, 1.5)], "margin": 0.01, "speed": 0.1,
        "length": None, "samples": 8, "refine": 0, "seed": 0,
    }),
    "level_reach": lambda: (sa.level_reach, {
        "start": _cfg(), "tilt": 0.03, "directions": 8, "margin": 0.0, "planned": True,
        "cell": 0.2,
    }),
    "level_envelope": lambda: (sa.level_envelope, {
        "start": _cfg(), "tilts": [0.02], "base_masses": [30.0], "travel": 0.1, "directions": 8,
    }),
    "uncertain": lambda: (sa.uncertain, {"arm": _arm(), "spread": {"link_2": {"mass": 0.1}}}),
    "about sample": lambda: (_about().sample, {"m": 2, "rng": np.random.default_rng(0)}),
    "about tried": lambda: (_about().tried, {"corners": 2, "samples": 2, "seed": 0}),
    "distance_range": lambda: (
        sa.distance_range, {"uncertain": _about(), "q": [0.3, 1.2], "samples": 3, "seed": 0}
    ),
    "shell_bands": lambda: (sa.shell_bands, {"uncertain": _about(), "samples": 1, "seed": 0}),
    "Servo": lambda: (_served, {
        "stop": 0.1, "slow": 0.2, "tau": 0.5, "rates": 0.5, "accelerations": 1.0, "wheels": None,
        "frame": "inertial", "keep_attitude": False, "mode": "free-floating",
    }),
    "servo step": lambda: (_stepped, {
        "posture": ([0.3, 1.2], np.eye(4)), "twist": [0.1, 0.0], "dt": 0.01,
    }),
    "servo watch": lambda: (_watched, {"t": 0.0, "q": [0.3, 1.2], "dq": [0.0, 0.0], "ahead": 5.0}),
    "ServoControl": lambda: (sa.ServoControl, {
        "servo": _servo(), "twist": [0.1, 0.0], "period": 0.01, "gain": 20.0,
    }),
    "TrigPolynomial": lambda: (sa.TrigPolynomial.fit, {
        "sampler": lambda X: np.cos(X[:, 0]), "n": 2, "highest": 2,
    }),
    "polynomial roots": lambda: (
        sa.singularity_polynomial(_arm()).roots, {"j": 1, "q": [0.3, 1.2]}
    ),
    "polynomial grid": lambda: (
        sa.singularity_polynomial(_arm()).grid, {"shape": (4, 4), "threads": 1}
    ),
    "GeneralizedJacobianTask": lambda: (sa.GeneralizedJacobianTask, {
        "arm": _arm(), "target": sa.pose(), "cost": 1.0, "gain": 1.0, "lm_damping": 0.0,
    }),
    "SingularityBarrier": lambda: (
        sa.SingularityBarrier, {"arm": _arm("chaser7"), "margin": 0.05, "gain": 10.0}
    ),
    "plot": lambda: (sa.plot, {"thing": _run(), "target": [1.0, 1.0]}),
    "plot of a workspace": lambda: (sa.plot, {"thing": _reach(), "path": [[1.0, 1.0]]}),
    "plot of a configuration": lambda: (sa.plot, {
        "thing": _cfg(), "color": "red", "label": True, "velocities": False,
    }),
    **{
        name: lambda name=name: (getattr(sa, name), {"cfg": _cfg(), "mode": "free-floating"})
        for name in (
            "error_bars", "generalized_inertia", "generalized_jacobian",
            "generalized_jacobian_derivative",
        )
    },
    **{
        name: lambda name=name: (getattr(sa, name), {"cfg": _cfg()})
        for name in ("barycentric", "fixed_base_jacobian", "momentum_matrix")
    },
    "kinetic_energy": lambda: (
        sa.kinetic_energy, {"cfg": _cfg(), "dq": [0.1, 0.2], "mode": "free-floating"}
    ),
    "Motion": lambda: (sa.Motion, {
        "arm": _arm(), "t": [0.0, 1.0], "q": Q, "base": np.tile(np.eye(7)[6], (2, 1)),
        "mode": "free-floating",
    }),
    "MomentumConservation": lambda: (sa.MomentumConservation, {"arm": _arm()}),
    "Reactionless": lambda: (_controlled(sa.Reactionless, "chaser7"), {
        "target": sa.pose((0.9, 0.4, 0.2)), "gain": 1.0, "servo": 20.0, "damping": 0.1,
        "threshold": 0.1, "mode": "free-floating",
    }),
    "catch": lambda: (sa.catch, {
        "start": _cfg("chaser7"), "target": _tumbling(), "grapple": "ring", "window": (1.0, 9.0),
        "approach": 0.2, "closing": 0.05, "touching": None, "bears": (50.0, 50.0), "wanted": 1,
        "mode": "free-floating", "search": sa.Search(timeout=0.5),
    }),
    "hold": lambda: (sa.hold, {
        "start": _cfg("dual_ur5"), "target": _tumbling(), "grasps": {"left": "ring"},
        "fixed": False, "limits": True, "seed": 0,
    }),
    "held report": lambda: (_held().report, {"mode": "free-floating", "tolerance": 1e-4}),
    "held map": lambda: (_held().map, {
        "axes": ("x", "y"), "span": (0.1, 0.1), "points": 3, "mode": "free-floating",
        "limits": True,
    }),
    "held follow": lambda: (_held().follow, {
        "path": [_held().target.pose * sa.pose((0.01, 0, 0))], "frame": "inertial",
        "length": None, "speed": 0.1, "times": None, "at_rest": False, "rest": None,
        "limits": False,
    }),
    "held plan": lambda: (_held().plan, {
        "goal": _held().target.pose * sa.pose((0.05, 0, 0)), "frame": "inertial",
        "mode": "free-floating", "search": sa.Search(timeout=0.5),
    }),
    "held simulate": lambda: (_held().simulate, {
        "controller": sa.JointPD(_cfg("chaser7").q, 5, 9), "duration": 0.02, "dq": np.zeros(7),
        "squeeze": None,
        "bears": (50.0, 50.0),
    }),
    "held regrasp": lambda: (_held().regrasp, {
        "tip": "tip", "grasp": sa.pose(), "approach": 0.1, "closing": 0.02,
        "search": sa.Search(timeout=0.5),
    }),
    "detumble": lambda: (sa.detumble, {
        "start": _wheeled(), "goal": (0.9, 1.4), "final_attitude": None, "duration": None,
        "origin": "cm", "search": sa.Search(timeout=0.5),
    }),
    "identify": lambda: (sa.identify, {
        "motion": _carried(), "arm": None, "dq": None, "twist": None, "noise": [0.1, 0.1, 0.1],
    }),
    "free_box_for_all": lambda: (sa.free_box_for_all, {
        "uncertain": _about(), "about": _cfg(), "joints": ["joint_1"], "at_least": None,
        "within": ([-1, 1], [1, 2]), "clearance": 0.01, "timeout": 1.0,
    }),
    "is_free_for_all": lambda: (sa.is_free_for_all, {"uncertain": _about(), "path": Q}),
    "robust_plan": lambda: (sa.robust_plan, {
        "uncertain": _about(), "start": _cfg(), "goal": (0.9, 1.4), "via": (),
        "final_attitude": None, "duration": None, "origin": "cm", "search": _brief(),
    }),
    "to_c": lambda: (sa.to_c, {
        "arm": _arm(), "folder": ".", "mode": "free-floating", "parameters": "masses",
        "servo": False,
    }),
    "to_casadi": lambda: (sa.to_casadi, {
        "arm": _arm(), "mode": "free-floating", "parameters": "masses",
    }),
    "to_mjcf": lambda: (sa.to_mjcf, {"arm": _arm(), "path": "again.xml"}),
    "to_sdf": lambda: (sa.to_sdf, {"arm": _arm(), "path": "again.sdf"}),
    "to_urdf": lambda: (_arm().to_urdf, {"path": "again.urdf"}),
    "write_motion": lambda: (sa.write_motion, {"motion": _run(), "path": "way.csv"}),
    "save": lambda: (_run().save, {"path": "way.npz"}),
    "load motion": lambda: (sa.Motion.load, {"path": "way.npz", "arm": _arm()}),
    "load boxes": lambda: (
        sa.FreeBoxes.load, {"path": "boxes.npz", "arm": _arm(), "mode": "free-floating"}
    ),
    "sweep": lambda: (sa.sweep, {"study": "study.toml", "store": "run.zarr", "workers": 1}),
    "view": lambda: (sa.view, {
        "thing": _arm(), "compare": None, "obstacles": (), "port": None, "open": False,
    }),
}  # fmt: skip


@lru_cache
def _wheeled() -> sa.Configuration:
    """An arm with a wheel, which spins."""
    path = Path("wheeled.urdf")
    path.write_text(with_wheels("planar2", (0, 0, 1)), encoding="utf-8")
    arm = sa.load(path)
    path.unlink()
    return arm.at([0.3, 1.2], momentum=[0, 0, 0, 0, 0, 0.05])


@lru_cache
def _carried() -> sa.Trajectory:
    """A run with a payload."""
    held = _arm().grasp(3.0, 0.4 * np.eye(3), (0.1, 0.2, 0)).at([0.3, 1.2])
    return sa.simulate(held, _law(), 5.0, integration=sa.Integration(dt=0.1))


def _spinning() -> sa.Configuration:
    return _arm().at([0.3, 1.2], momentum=[0, 0, 0, 0, 0, 0.1])


def _simulated_with(**given: Any) -> sa.Trajectory:
    return sa.simulate(_cfg(), _law(), 0.2, integration=sa.Integration(**given))


def _sampled(**given: Any) -> sa.Trajectory:
    return sa.simulate(_cfg(), _law(), 0.2, sampling=sa.Sampling(**given))


def _controlled(kind: Callable[..., Any], arm: str = "planar2") -> Callable[..., sa.Trajectory]:
    return lambda **given: sa.simulate(_cfg(arm), kind(**given), 0.1)


def _planted(**given: Any) -> sa.Trajectory:
    return sa.simulate(_cfg(), _law(), 0.1, plant=sa.Plant(**given))


def _passive(**given: Any) -> sa.Trajectory:
    return _planted(passive={"joint_1": sa.PassiveJoint(**given)})


def _phased(*, duration: Any, stop: Any, **body: Any) -> object:
    phases = [sa.Phase(_law(), duration, sa.Grasp(**body), stop=stop), sa.Phase(_law(), 0.1)]
    return sa.simulate_phases(_cfg(), phases)


def _planned(**given: Any) -> sa.Plan:
    return sa.plan(_cfg(), (0.9, 1.4), constraints=sa.Constraints(**given), search=_brief())


def _searched(**given: Any) -> sa.Plan:
    return sa.plan(_cfg(), (0.9, 1.4), search=sa.Search(**given))


def _met(kind: Callable[..., sa.Obstacle]) -> Callable[..., object]:
    return lambda **given: sa.collision_check(_cfg(), kind(**given))


def _obstacle(**given: Any) -> object:
    box = sa.Obstacle.box(0.2, sa.pose((1.2, 0.4, 0.0)))
    return sa.collision_check(_cfg(), replace(box, **given))


def _target(*, t: Any, **given: Any) -> object:
    return sa.Target(sa.Bus(90, size=(0.4, 0.4, 0.4)), sa.pose((5, 0, 0)), **given).at(t)


def _served(**given: Any) -> object:
    return sa.Servo(_arm(), **given).step(_cfg(), [0.1, 0.0], 0.01)


def _stepped(**given: Any) -> object:
    servo = _servo()
    servo.start(_cfg())
    step = servo.step(**given)
    after = servo.step(_cfg(), [0.1, 0.0], 0.01)
    if not np.isfinite([step.rates, after.rates]).all() and not after.halted:
        raise FaultError("the servo returns rates that are not finite")
    return step


def _watched(*, ahead: Any, **given: Any) -> object:
    states = [given, {"t": 0.1, "q": [0.3, 1.2]}]
    return list(_servo().watch(states, ahead=ahead))


WRITTEN = (
    "planar2.c",
    "planar2.h",
    "again.xml",
    "again.sdf",
    "again.urdf",
    "way.csv",
    "way.npz",
    "a",
)
"""What calls may write."""


def calls(rng: np.random.Generator, _folder: Path, named: set[str]) -> None:
    """Calls a function with one argument, or one entry of it, that is something else."""
    written = (str(x) for x in OTHERS if isinstance(x, str | Path) and str(x).strip())
    named.update(WRITTEN, written)
    names = list(CALLS)
    function, given = CALLS[names[rng.integers(len(names))]]()
    for _ in range(rng.choice([1, 2], p=[0.8, 0.2])):
        key = list(given)[rng.integers(len(given))]
        given[key] = _wrong(given[key], rng)
    repr(function(**given))


def _wrong(value: Any, rng: np.random.Generator) -> Any:
    """Another value, or the same with another entry."""
    some = NUMBERS if rng.random() < 0.6 else OTHERS
    other = some[rng.integers(len(some))]
    if rng.random() < 0.4 and isinstance(value, dict) and value:
        return value | {next(iter(value)): other}
    several = isinstance(value, list | tuple) or getattr(value, "ndim", 0) > 0
    if rng.random() < 0.4 and several and len(value):
        entries = list(value)
        entries[rng.integers(len(entries))] = other
        return entries
    return other
