"""Closed chains for the tests: random arms on one spacecraft that hold one target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation, RotationSpline

import spacearm as sa
from helpers.arms import (
    frame,
    joint,
    load_text,
    random_base,
    random_joint,
    random_link,
    robot,
    with_wheels,
)
from spacearm.closure.target_runs import closed_state
from spacearm.mechanics.dynamics import generalized_velocity


def several(rng, counts, kinds=("revolute",), wheels=False) -> sa.SpaceArm:
    """Random arms of so many joints each on one spacecraft; their tips are t0, t1, ...

    With three wheels, if they are asked for.
    """
    parts = [random_link(rng, "bus", 10 ** rng.uniform(1, 3))]
    for side, n in enumerate(counts):
        parent = "bus"
        for i in range(n):
            name = f"l{side}_{i}"
            parts += [random_link(rng, name)]
            parts += [random_joint(rng, f"j{side}_{i}", parent, name, kinds)]
            parent = name
        parts += [frame(f"t{side}")]
        parts += [joint(f"f{side}", parent, f"t{side}", "fixed", rng.normal(size=3) * 0.5)]
    text = with_wheels(robot(*parts), np.eye(3)) if wheels else robot(*parts)
    return load_text(text, tip=[f"t{side}" for side in range(len(counts))])


def debris(rng, mass=None, pose=None) -> sa.Target:
    """A random body."""
    mass = 10 ** rng.uniform(0, 3.7) if mass is None else mass
    bus = sa.Bus(
        mass, size=rng.uniform(0.5, 2.0, 3) * mass ** (1 / 3) / 8, com=rng.normal(size=3) / 9
    )
    return sa.Target(bus, random_base(rng) if pose is None else pose)


def rough(arm, rng, mass=None, off=0.15):
    """A rough start, a target, and grasps that some posture near by closes."""
    q = rng.uniform(-1.5, 1.5, arm.n)
    closed = arm.at(q, base=random_base(rng))
    target = debris(rng, mass, closed.tips[0] * random_base(rng))
    grasps = {
        tip: target.pose.actInv(pose) for tip, pose in zip(arm.tips, closed.tips, strict=True)
    }
    start = arm.at(q + rng.uniform(-off, off, arm.n), base=closed.base)
    return start, target, grasps


def closed(seed=0, counts=(6, 6), **options) -> sa.Held:
    """A held target of random arms."""
    rng = np.random.default_rng(seed)
    start, target, grasps = rough(several(rng, counts), rng)
    return sa.hold(start, target, grasps, limits=False, **options)


def roomy(seed=0, counts=(6, 6), tries=12) -> tuple[sa.Held, float]:
    """Of some light targets the one that moves best, and how far it does by 0.1 rad [m], [rad]."""
    found = []
    for i in range(tries):
        held = closed(1000 * seed + i, counts)
        light = debris(np.random.default_rng(i), 5.0, held.target.pose)
        held = replace(held, target=light)
        report = held.report()
        found.append((min(report.sigma[-1], report.distance), i, held))
    most, _, best = max(found)
    return best, 0.1 * most


def rates_for(cfg, target, twist, inner=None):
    """The spacecraft's twist (inertial axes) and the joint rates with which the target has a twist.

    Momentum and all grasps at once, as the equations stand; of redundant arms the least rates, or
    those next to `inner`.
    """
    A_b, A_q = sa.momentum_matrix(cfg)
    R = np.kron(np.eye(2), cfg.base.rotation.T)
    place, com = target.pose.translation, target.pose.act(target.com)
    v_cm = twist[:3] + np.cross(twist[3:], com - place)
    spin = target.pose.rotation @ target.inertia @ target.pose.rotation.T @ twist[3:]
    momentum = np.concatenate(
        (target.mass * v_cm, spin + np.cross(com - cfg.com, target.mass * v_cm))
    )
    twists = [
        np.concatenate((twist[:3] + np.cross(twist[3:], tip.translation - place), twist[3:]))
        for tip in cfg.tips
    ]
    wanted = np.concatenate((-momentum, *twists))
    B = np.linalg.solve(A_b, np.column_stack((A_q, momentum)))  # v_b = -B (dq, 1)
    J_b = cfg.J[:, :6] @ R
    J, x = cfg.J[:, 6:] - J_b @ B[:, :-1], wanted[6:] + J_b @ B[:, -1]
    inner = np.zeros(cfg.arm.n) if inner is None else inner
    dq = inner + np.linalg.lstsq(J, x - J @ inner)[0]
    return -B @ np.append(dq, 1.0), dq


def densely(carrying, motion, count):
    """Torques, and force and moment at each tip, by the equations of the closed chain."""
    way = motion.spline
    turns = RotationSpline(motion.t, Rotation.from_quat(motion.base[:, 3:]))
    found = []
    for t in np.linspace(motion.t[0], motion.t[-1], count):
        base = pin.SE3(turns(t).as_matrix(), np.zeros(3))
        cfg = motion.arm.at(way(t), base=base, momentum=motion.momentum[0])
        tau = sa.inverse_dynamics(cfg, way(t, 1), way(t, 2)).tau
        none = np.zeros((len(carrying.grasps), 6))
        v = generalized_velocity(cfg, way(t, 1))
        state = closed_state(carrying, cfg, v, tau, none)
        sizes = np.linalg.norm(state.wrenches.reshape(-1, 2, 3), axis=2)
        found.append(np.append(np.abs(state.tau), sizes))
    return np.array(found)
