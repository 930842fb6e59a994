"""Braking: the joints of an arm that holds a target come to rest along a straight line.

The spacecraft turns with the joints and with the momentum of arm and target, which stays.
"""

from __future__ import annotations

from dataclasses import field

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.dynamics import generalized_velocity, inverse_dynamics, spacecraft_twist
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.flights import Grasp
from spacearm.motion.motion import Motion, samples
from spacearm.singularities.sets import prove_regular

BRAKES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Durations of the braking that are tried [s]."""
STEPS = 60
"""Steps in which the braking is integrated."""


class Braking(Motion):
    """The motion by which an arm that holds a target brings its joints to rest.

    Attributes:
        dq: (m, n) joint rates [rad/s] or [m/s].
        ddq: (m, n) joint accelerations [rad/s^2] or [m/s^2].
        momentum: (m, 6) momentum of arm and target, as of `Trajectory`.
        torque: (m, n) joint torques [N m] or [N].
        wrench: (m, 6) what the grapple bears: force [N] and moment [N m] at the tip that move the
            target, tip axes.
    """

    dq: Array = field(kw_only=True)
    ddq: Array = field(kw_only=True)
    momentum: Array = field(kw_only=True)
    torque: Array = field(kw_only=True)
    wrench: Array = field(kw_only=True)

    @property
    def borne(self) -> Array:
        """(2,) the largest force [N] and the largest moment [N m] that the grapple bears."""
        return np.linalg.norm(self.wrench.reshape(-1, 2, 3), axis=2).max(axis=0)


def braked(
    held: Configuration, dq: Array, body: Grasp, limits: bool, efforts: Array, bears: Array
) -> Braking:
    """Return the shortest braking tried that keeps limits, torques and what the grapple bears.

    Args:
        held: The arm with what it holds, and the momentum of both.
        dq: (n,) joint rates at the beginning [rad/s] or [m/s].
        body: What it holds.
        limits: Whether joint limits count.
        efforts: (n,) largest torques of the joints [N m] or [N].
        bears: (2,) largest force [N] and moment [N m] that the grapple bears.

    Raises:
        NoSolutionError: None of them does; says why.
    """
    arm, why = held.arm, ""
    for duration in BRAKES:
        s = np.linspace(0.0, 1.0, STEPS + 1)
        q = held.q + np.outer(duration * (s - s**3 + 0.5 * s**4), dq)
        if limits and outside(arm, q[-1]):
            why = f"braking in {duration:g} s leads beyond the joint limits"
            break
        rates, ddq = np.outer(1 - 3 * s**2 + 2 * s**3, dq), np.outer(6 * (s**2 - s), dq)
        ddq /= duration
        motion = _drifting(held, body, duration * s, q, rates, ddq)
        proof = prove_regular(arm, q[[0, -1]])
        if proof is not None and not proof.free:
            why = f"braking in {duration:g} s leads through a singular posture"
            break
        torque = float((np.abs(motion.torque) / efforts).max())
        force, moment = motion.borne
        if torque <= 1.0 and force <= bears[0] and moment <= bears[1]:
            return motion
        why = (
            f"braking in {duration:g} s takes {torque:.3g} times the torque of a joint, and "
            f"{force:.3g} N and {moment:.3g} N m of the grapple"
        )
    raise NoSolutionError(why)


def outside(arm: SpaceArm, q: Array) -> bool:
    """Return whether joint positions (n,) are beyond the joint limits."""
    return bool(((q < arm.lower) | (q > arm.upper)).any())


def _drifting(
    start: Configuration, body: Grasp, t: Array, q: Array, dq: Array, ddq: Array
) -> Braking:
    """Return the motion of the spacecraft with momentum while the joints move as given."""
    arm, com, momentum = start.arm, start.com, start.momentum
    rows = [start]
    velocity = momentum[:3] / arm.mass
    for i in range(1, len(t)):
        h = t[i] - t[i - 1]
        before = rows[-1]
        w = spacecraft_twist(before, dq[i - 1])[3:]
        middle = arm.at(
            0.5 * (q[i] + q[i - 1]),
            base=pin.SE3(pin.exp3(0.5 * h * w) @ before.base.rotation, before.base.translation),
            momentum=momentum,
        )
        w = spacecraft_twist(middle, 0.5 * (dq[i] + dq[i - 1]))[3:]
        turned = pin.SE3(pin.exp3(h * w) @ before.base.rotation, np.zeros(3))
        there = arm.at(q[i], base=turned)
        turned.translation = com + t[i] * velocity - there.com
        rows.append(arm.at(q[i], base=turned, momentum=momentum))
    kept = np.tile(momentum, (len(t), 1))
    loads = [_loads(*row, body) for row in zip(rows, dq, ddq, strict=True)]
    torque, wrench = (np.array(load) for load in zip(*loads, strict=True))
    return Braking(
        arm, t, **samples(rows), dq=dq, ddq=ddq, momentum=kept, torque=torque, wrench=wrench
    )


def _loads(cfg: Configuration, dq: Array, ddq: Array, body: Grasp) -> tuple[Array, Array]:
    """Return the joint torques (n,) and the wrench (6,) that moves the body, tip axes."""
    arm, found, R = cfg.arm, inverse_dynamics(cfg, dq, ddq), cfg.base.rotation
    v = generalized_velocity(cfg, dq)
    a = (found.base_acceleration.reshape(2, 3) @ R).ravel()
    a[:3] -= np.cross(v[3:6], v[:3])  # from classical to spatial acceleration
    full, rate = (np.append(x[:6], arm.all_rates(y)) for x, y in ((v, dq), (a, ddq)))
    data = arm.borrow()
    pin.forwardKinematics(arm.model, data, cfg.full_at_origin, full, rate)
    w = pin.getFrameVelocity(arm.model, data, arm.tip_frame, pin.LOCAL).angular
    tip = pin.getFrameClassicalAcceleration(arm.model, data, arm.tip_frame, pin.LOCAL)
    arm.give_back(data)
    com, I = np.asarray(body.com), np.asarray(body.inertia)
    force = body.mass * (tip.linear + np.cross(tip.angular, com) + np.cross(w, np.cross(w, com)))
    moment = I @ tip.angular + np.cross(w, I @ w) + np.cross(com, force)
    return found.tau, np.concatenate((force, moment))


def largest_torques(motion: Motion, dq: Array, ddq: Array, momentum: Array) -> Array:
    """Return the largest torques (n,) of a motion [N m] or [N]."""
    rows = np.unique(np.linspace(0, len(motion) - 1, STEPS).astype(int))
    taus = [
        inverse_dynamics(motion[int(i)].with_momentum(momentum), dq[i], ddq[i]).tau for i in rows
    ]
    return np.abs(taus).max(axis=0)
