"""Braking: the joints of an arm that holds a target come to rest along a straight line.

The spacecraft turns with the joints and with the momentum of arm and target, which stays.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.dynamics import inverse_dynamics, spacecraft_twist
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion, samples
from spacearm.singularities.sets import prove_regular

BRAKES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Durations of the braking that are tried [s]."""
STEPS = 60
"""Steps in which the braking is integrated."""


@dataclass(frozen=True, eq=False, repr=False)
class Braking(Motion):
    """The motion by which an arm that holds a target brings its joints to rest.

    Attributes:
        dq: (m, n) joint rates [rad/s] or [m/s].
        ddq: (m, n) joint accelerations [rad/s^2] or [m/s^2].
        momentum: (m, 6) momentum of arm and target, as of `Trajectory`.
    """

    dq: Array = field(kw_only=True)
    ddq: Array = field(kw_only=True)
    momentum: Array = field(kw_only=True)


def braked(held: Configuration, dq: Array, limits: bool, efforts: Array) -> tuple[Braking, Array]:
    """Return the shortest braking tried that keeps limits and torques, and its largest torques.

    Args:
        held: The arm with what it holds, and the momentum of both.
        dq: (n,) joint rates at the beginning [rad/s] or [m/s].
        limits: Whether joint limits count.
        efforts: (n,) largest torques of the joints [N m] or [N].

    Raises:
        NoSolutionError: None of them does; says why.
    """
    arm, momentum, why = held.arm, held.momentum, ""
    for duration in BRAKES:
        s = np.linspace(0.0, 1.0, STEPS + 1)
        q = held.q + np.outer(duration * (s - s**3 + 0.5 * s**4), dq)
        if limits and outside(arm, q[-1]):
            why = f"braking in {duration:g} s leads beyond the joint limits"
            break
        rates, ddq = np.outer(1 - 3 * s**2 + 2 * s**3, dq), np.outer(6 * (s**2 - s), dq)
        ddq /= duration
        motion = _drifting(held, momentum, duration * s, q, rates, ddq)
        torque = largest_torques(motion, rates, ddq, momentum)
        proof = prove_regular(arm, q[[0, -1]])
        if proof is not None and not proof.free:
            why = f"braking in {duration:g} s leads through a singular posture"
            break
        if (torque <= efforts).all():
            return motion, torque
        most = float((torque / efforts).max())
        why = f"braking in {duration:g} s takes {most:.3g} times the torque"
    raise NoSolutionError(why)


def outside(arm: SpaceArm, q: Array) -> bool:
    """Return whether joint positions (n,) are beyond the joint limits."""
    return bool(((q < arm.lower) | (q > arm.upper)).any())


def _drifting(
    start: Configuration, momentum: Array, t: Array, q: Array, dq: Array, ddq: Array
) -> Braking:
    """Return the motion of the spacecraft with momentum while the joints move as given."""
    arm, com = start.arm, start.com
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
    return Braking(arm, t, **samples(rows), dq=dq, ddq=ddq, momentum=kept)


def largest_torques(motion: Motion, dq: Array, ddq: Array, momentum: Array) -> Array:
    """Return the largest torques (n,) of a motion [N m] or [N]."""
    rows = np.unique(np.linspace(0, len(motion) - 1, STEPS).astype(int))
    taus = [
        inverse_dynamics(motion[int(i)].with_momentum(momentum), dq[i], ddq[i]).tau for i in rows
    ]
    return np.abs(taus).max(axis=0)
