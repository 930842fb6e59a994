"""Braking: the joints of an arm that holds a target come to rest along a straight line.

The spacecraft turns with the joints and with the momentum of arm and target, which stays, or wheels
hold its attitude and take up that momentum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, replace

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.dynamics import momentum_and_torque
from spacearm.mechanics.floating import carried_along, placed, samples
from spacearm.mechanics.motion_bounds import Peaks
from spacearm.model.arguments import FLOATING, HELD, BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.flights import Grasp, held_loads, load_peaks
from spacearm.motion.motion import Drifting
from spacearm.planning.many_curves import steered_attitudes
from spacearm.planning.reactions import Wheels, load_of
from spacearm.singularities.sets import prove_regular

#: Durations of the braking that are tried [s].
BRAKES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
#: Steps in which the braking is integrated.
STEPS = 60


class Braking(Drifting):
    """The motion by which an arm that holds a target brings its joints to rest.

    Attributes:
        dq: (m, n) joint rates [rad/s] or [m/s].
        ddq: (m, n) joint accelerations [rad/s^2] or [m/s^2].
        torque: (m, n) joint torques [N m] or [N].
        wrench: (m, 6) what the grapple bears: force [N] and moment [N m] at the tip that move the
            target, tip axes.
        wheel_load: As of `Plan`.
        peaks: Bounds on torques and loads between the samples; None where there are none.
    """

    dq: Array = field(kw_only=True)
    ddq: Array = field(kw_only=True)
    torque: Array = field(kw_only=True)
    wrench: Array = field(kw_only=True)
    wheel_load: str = field(default="", kw_only=True)
    peaks: Peaks | None = field(default=None, kw_only=True, metadata={"in_file": False})

    @property
    def largest_torques(self) -> Array:
        """(n,) largest joint torques [N m] or [N]: bounds where there are some, else at samples."""
        if self.peaks is not None:
            return self.peaks.bound[: self.arm.n]
        return np.asarray(np.abs(self.torque).max(axis=0))

    @property
    def borne(self) -> Array:
        """(2,) the largest force [N] and the largest moment [N m] that the grapple bears.

        Bounds where there are some, else at the samples.
        """
        if self.peaks is not None:
            return self.peaks.bound[self.arm.n :]
        return np.linalg.norm(self.wrench.reshape(-1, 2, 3), axis=2).max(axis=0)


def braked(
    held: Configuration,
    dq: Array,
    body: Grasp,
    limits: bool,
    efforts: Array,
    bears: Array,
    wheels: Wheels | None = None,
    check_time: Callable[[], None] | None = None,
) -> Braking:
    """Return the shortest braking tried that keeps limits, torques and what the grapple bears.

    Args:
        held: The arm with what it holds, and the momentum of both.
        dq: (n,) joint rates at the beginning [rad/s] or [m/s].
        body: What it holds.
        limits: Whether joint limits count.
        efforts: (n,) largest torques of the joints [N m] or [N].
        bears: (2,) largest force [N] and moment [N m] that the grapple bears.
        wheels: The wheels that hold the attitude, with what they hold once the joints rest; the
            spacecraft floats if None.
        check_time: Called now and then; raises once the time is up.

    Raises:
        NoSolutionError: None of them does; says why.
    """
    arm, why = held.arm, ""
    if wheels is not None and (full := np.abs(wheels.start) > wheels.capacity).any():
        i = int(full.argmax())
        raise NoSolutionError(
            f"wheel {wheels.names[i]} would come to hold {wheels.start[i]:.4g} of at most "
            f"{wheels.capacity[i]:.4g} N m s"
        )
    mode = FLOATING if wheels is None else HELD
    for duration in BRAKES:
        if check_time is not None:
            check_time()
        s = np.linspace(0.0, 1.0, 2 * STEPS + 1)
        q = held.q + np.outer(duration * (s - s**3 + 0.5 * s**4), dq)
        if limits and outside(arm, q[-1]):
            why = f"braking in {duration:g} s leads beyond the joint limits"
            break
        rates, ddq = np.outer(1 - 3 * s**2 + 2 * s**3, dq), np.outer(6 * (s**2 - s), dq)
        motion = _drifting(held, body, duration * s, q, rates, ddq / duration, mode)
        proof = prove_regular(arm, q[[0, -1]], mode=mode)
        if proof is not None and not proof.free:
            why = f"braking in {duration:g} s leads through a singular posture"
            break
        fits = (motion.largest_torques <= efforts).all() and (motion.borne <= bears).all()
        if fits:
            motion = replace(motion, peaks=load_peaks(motion, body, check_time))
        torque = float((motion.largest_torques / efforts).max())
        force, moment = motion.borne
        why = (
            f"braking in {duration:g} s takes {torque:.3g} times the torque of a joint, and "
            f"{force:.3g} N and {moment:.3g} N m of the grapple"
        )
        if torque <= 1.0 and force <= bears[0] and moment <= bears[1]:
            if wheels is None:
                return motion
            load = load_of(arm, motion.spline)
            slower, excess = wheels.slowdown(load)
            if slower <= 1.0:
                return _with_wheels(motion, wheels, wheels.story(load))
            why = f"braking in {duration:g} s {excess}"
    raise NoSolutionError(why)


def outside(arm: SpaceArm, q: Array) -> bool:
    """Return whether joint positions (n,) are beyond the joint limits."""
    return bool(((q < arm.lower) | (q > arm.upper)).any())


def _drifting(
    start: Configuration, body: Grasp, t: Array, q: Array, dq: Array, ddq: Array, mode: BaseMode
) -> Braking:
    """Return the motion of the spacecraft with momentum while the joints move as given.

    Given are the rows, and times half way between.
    """
    arm, T, drift = start.arm, start.base.rotation, start.momentum[:3] / start.arm.mass
    rows, t = slice(None, None, 2), t[::2]
    turns = np.tile(T, (len(t), 1, 1))
    if mode == FLOATING:
        stored = np.tile(T.T @ start.stored[3:], (1, len(q), 1))
        turns = steered_attitudes(arm, T, t, q[None], dq[None], start.momentum[3:], stored)[0]
    q, dq, ddq = q[rows], dq[rows], ddq[rows]
    along = samples([placed(start, *row) for row in zip(q, turns, strict=True)])
    along["base"][:, :3] += np.outer(t, drift)
    none = np.zeros((len(t), 6))
    kept = carried_along(start, len(t))
    motion = Braking(
        arm, t, **along, mode=mode, dq=dq, ddq=ddq, torque=0.0 * q, wrench=none, **kept
    )
    loads = [held_loads(*row, body, mode) for row in zip(motion, dq, ddq, strict=True)]
    torque, wrench = (np.array(load) for load in zip(*loads, strict=True))
    return replace(motion, torque=torque, wrench=wrench)


def _with_wheels(motion: Braking, wheels: Wheels, story: str) -> Braking:
    """Return a motion with what the wheels hold that hold the attitude."""
    moving, _ = momentum_and_torque(motion.arm, motion.q, motion.dq, motion.ddq)
    held = wheels.momenta(moving)[:, : len(motion.arm.wheels)]
    return replace(motion, wheels=held, wheel_load=story)
