"""Closure: postures in which all grasps are closed, and the velocities that keep them closed.

With T_i(q) the tips in the spacecraft's frame, X the frame of what is held there and F_i the
grasps in X, the chain is closed where T_i(q) = X F_i for every tip i. Nothing in it depends on
where the spacecraft is. A target moves with X; where the fixed world is held, the spacecraft does.

The tips i hold one target, whose twist is v_t, while momentum is zero (free components of v_b):

    A_b v_b + A_q dq + M_t v_t = 0,    J_b v_b + J_q dq = G v_t,

M_t the momentum of the target per twist, G the twists of the grasps. With N^T G = 0 the joint
rates that keep the grasps closed are those with N^T (J_b B + J_q) dq = 0, where v_b = B dq follows
from the momentum. They move the target by v_t = G^+ (J_b B + J_q) dq. Where the fixed world is
held it is the spacecraft that moves, by v_b, and J_q dq = -G v_b.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.mechanics.target import Target
from spacearm.model.arguments import BaseMode, free_components
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.model.joints import joint_scales
from spacearm.motion.goal import twist_between

#: Most steps, and the shares of each that are tried.
STEPS, SHARES = 50, 0.5 ** np.arange(8)
#: Longest step [rad], and what may be left open.
STRIDE, CLOSE = 0.5, 1e-14
#: Damping of the steps, by the square of what is open.
DAMPING = 1e-3
#: Share of the largest singular value up to which one is rounding: grasps close to that.
ROUNDING = 1e-9


class Closure(NamedTuple):
    """The equations T_i(q) = X F_i, spacecraft at the origin.

    Attributes:
        arm: The arm.
        grasps: F_i, in the order of its tips.
        fixed: Whether X stays.
        limits: Whether the joints stay within their limits.
    """

    arm: SpaceArm
    grasps: tuple[pin.SE3, ...]
    fixed: bool
    limits: bool

    def solved(self, q: Array, X: pin.SE3) -> tuple[Array, pin.SE3]:
        """Solve from joints q (n,) and the frame X on, by damped Gauss-Newton steps.

        Each step is the least that closes the linearised equations; joints at their limits stay.

        Returns:
            q and X, closed or as near to it as the equations led.
        """
        arm, length = self.arm, self.arm.task.length or 1.0
        unit = np.append(joint_scales(arm), np.repeat([length, 1.0], 3))
        low, high = np.full((2, len(unit)), [[-np.inf], [np.inf]])
        if self.limits:
            low[: arm.n] = (arm.lower - q) / unit[: arm.n]
            high[: arm.n] = (arm.upper - q) / unit[: arm.n]
        free = slice(arm.n if self.fixed else None)
        scale = np.tile(np.repeat([1.0 / length, 1.0], 3), len(self.grasps))

        def at(z: Array) -> tuple[Array, pin.SE3]:
            joints, move, turn = np.split(np.pad(z, (0, len(unit) - len(z))) * unit, [arm.n, -3])
            return q + joints, pin.SE3(pin.exp3(turn) @ X.rotation, X.translation + move)

        def gaps(z: Array) -> Array:
            there, frame = at(z)
            tips = kinematics(arm, there, pin.SE3.Identity()).tips
            pairs = zip(tips, self.grasps, strict=True)
            return scale * np.concatenate(
                [twist_between(frame * grasp, tip) for tip, grasp in pairs]
            )

        def slopes(z: Array) -> Array:
            there, frame = at(z)
            turning = np.eye(3) if self.fixed else pin.Jexp3(z[-3:]).T
            cfg, blocks = kinematics(arm, there, pin.SE3.Identity()), list[Array]()
            J = np.split(cfg.J[:, 6:], len(cfg.tips))
            for tip, grasp, rates in zip(cfg.tips, self.grasps, J, strict=True):
                wanted = frame * grasp
                R = tip.rotation @ wanted.rotation.T
                back, lever = pin.Jlog3(R).T, pin.skew(wanted.translation - frame.translation)
                linear = np.hstack((rates[:3], -np.eye(3), lever @ turning))
                turns = np.hstack((back @ rates[3:], np.zeros((3, 3)), -back @ R @ turning))
                blocks += [linear, turns]
            return (scale[:, None] * np.vstack(blocks) * unit)[:, free]

        z = np.clip(0.0, low, high)[free]
        r = gaps(z)
        for _ in range(STEPS):
            J, size = slopes(z), float(np.linalg.norm(r))
            if size <= CLOSE:
                break
            fall = -J.T @ r
            held = ((z <= low[free]) & (fall < 0.0)) | ((z >= high[free]) & (fall > 0.0))
            J[:, held] = 0.0
            damped = J @ J.T + DAMPING * min(size, 1.0) ** 2 * np.eye(len(r))
            step = -J.T @ np.linalg.lstsq(damped, r)[0]
            step *= min(1.0, STRIDE / float(np.linalg.norm(step) or 1.0))
            for share in SHARES:
                other = np.clip(z + share * step, low[free], high[free])
                if float(np.linalg.norm(left := gaps(other))) < (1.0 - share / 10.0) * size:
                    break
            else:
                break
            z, r = other, left
        return at(z)

    def gaps(self, q: Array, X: pin.SE3) -> Gaps:
        """Return how far tips are from their grasps at most, joints q (n,)."""
        tips = kinematics(self.arm, q.copy(), pin.SE3.Identity()).tips
        return Gaps.of(tips, X, self.grasps)


def placed(
    cfg: Configuration, target: Target | None, q: Array, X: pin.SE3
) -> tuple[Configuration, Target | None]:
    """Return what is held at X in the spacecraft's frame, the arm at q (n,).

    Args:
        cfg: Where the spacecraft is, which stays unless it is the fixed world that is held.
        target: The target; None if the tips hold the fixed world.
        q: Joint positions.
        X: Frame of what is held.
    """
    base = cfg.base if target else X.inverse()
    there = replace(kinematics(cfg.arm, q, base), momentum=cfg.momentum).with_wheels(cfg.wheels)
    return there, target and target.replace(pose=base * X)


class Gaps(NamedTuple):
    """How far tips are from their grasps at most: place [m] and angle [rad]."""

    gap: float
    turn: float

    @classmethod
    def of(cls, tips: Sequence[pin.SE3], frame: pin.SE3, grasps: Iterable[pin.SE3]) -> Gaps:
        """Return the gaps of tips that hold a frame by grasps in it."""
        off = [(frame * F).actInv(tip) for tip, F in zip(tips, grasps, strict=True)]
        return cls(
            max(float(np.linalg.norm(pose.translation)) for pose in off),
            max(float(np.linalg.norm(pin.log3(pose.rotation))) for pose in off),
        )


def anywhere(arm: SpaceArm, limits: bool, rng: np.random.Generator) -> Array:
    """Return random joint positions, within the limits or a turn."""
    half = np.pi * joint_scales(arm)
    bounded = np.isfinite(arm.lower) & np.isfinite(arm.upper) & limits
    low = np.where(bounded, arm.lower, -half)
    return rng.uniform(low, np.where(bounded, arm.upper, half))


def named(target: Target | None) -> str:
    """Return the name of what is held."""
    return "the fixed world" if target is None else target.name


class ClosedMotions(NamedTuple):
    """The joint motions that keep grasps closed, in radians, and what they do.

    K are the task's rows of all tips, k those of one; rows are along the task axes, linear ones
    divided by the task's length.

    Attributes:
        rows: (k, 6) the task's rows of a twist in inertial axes.
        grasps: (K, k) G, the twists of the grasps by that of what is held.
        motions: (n, p) orthonormal joint motions that keep the grasps closed.
        held: (k, p) twists of what is held that they bring.
        spacecraft: (6, p) twists of the spacecraft that they bring, spacecraft axes.
    """

    rows: Array
    grasps: Array
    motions: Array
    held: Array
    spacecraft: Array


def closed_motions(cfg: Configuration, target: Target | None, mode: BaseMode) -> ClosedMotions:
    """Compute the joint motions that keep grasps closed.

    Args:
        cfg: The configuration; all its tips hold the target.
        target: The target, where it is; None if the tips hold the fixed world.
        mode: What the spacecraft does; does not count where the fixed world is held.
    """
    task, R, f = cfg.arm.task, cfg.base.rotation, free_components(mode)
    J, A, unit = task.jacobian(cfg.J, R), cfg.A, joint_scales(cfg.arm)
    rows = replace(task, tips=1).jacobian(np.eye(6), R)
    back = np.linalg.pinv(rows)
    centre = cfg.base.translation if target is None else target.pose.translation
    G = task.jacobian(np.vstack([carried(tip.translation - centre) for tip in cfg.tips]), R) @ back
    if target is None:
        G, B = -G, A[:0, 6:]
    else:
        M = (target_momentum(target, cfg.com) @ back @ np.linalg.pinv(G))[:f]
        B = -np.linalg.solve(A[:f, :f] + M @ J[:, :f], A[:f, 6:] + M @ J[:, 6:])
    H = (J[:, : len(B)] @ B + J[:, 6:]) * unit
    N = np.linalg.svd(G)[0][:, G.shape[1] :]
    _, sigma, VT = np.linalg.svd(N.T @ H)
    floor = ROUNDING * float(np.linalg.norm(H, 2))
    Z = VT[int(np.count_nonzero(sigma > floor)) :].T
    T = np.linalg.pinv(G) @ H @ Z
    if target is None:
        turned = np.kron(np.eye(2), R.T)
        spacecraft = turned @ back @ T
    else:
        spacecraft = np.vstack((B * unit @ Z, np.zeros((6 - len(B), Z.shape[1]))))
    return ClosedMotions(rows, G, Z, T, spacecraft)


def carried(lever: Array) -> Array:
    """Return the twist (6, 6) of a point that a body carries, by that of the body's origin."""
    X = np.eye(6)
    X[:3, 3:] = -pin.skew(lever)
    return X


def target_momentum(target: Target, about: Array) -> Array:
    """Return the momentum (6, 6) of a target about a point, by the twist of its frame."""
    R = target.pose.rotation
    lever = R @ target.com
    linear = target.mass * carried(lever)[:3]
    angular = np.hstack((np.zeros((3, 3)), R @ target.inertia @ R.T))
    return np.vstack((linear, angular + pin.skew(target.pose.translation + lever - about) @ linear))
