"""Braking: the joints of an arm that holds a target come to rest along a straight line.

The spacecraft turns with the joints and with the momentum of arm and target, which stays, or wheels
hold its attitude and take up that momentum.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

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
from spacearm.planning.account import TimeUpError
from spacearm.planning.many_curves import steered_attitudes
from spacearm.planning.reactions import Wheels, load_of
from spacearm.singularities.sets import prove_regular

#: Times of the braking that are tried until one suffices or leads too far [s].
LONGER = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
#: Times that are tried where 1 s leads too far [s].
SHORTER = (0.5, 0.25, 0.125, 0.0625, 0.03125)
#: Ratio of a braking time to one that is too short, below which it is not shortened further.
FINE = 1.01
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
            return np.asarray(self.peaks.bound[self.arm.n :].reshape(-1, 2).max(axis=0))
        return np.linalg.norm(self.wrench.reshape(-1, 2, 3), axis=2).max(axis=0)


AnyBraking = TypeVar("AnyBraking", bound=Braking)


@dataclass(frozen=True)
class BrakingTry(Generic[AnyBraking]):
    """What came of a braking time.

    Attributes:
        brake: The braking; None if it is not possible.
        too_long: Whether a longer one is not possible either, as it leads farther.
        why: Why it is not possible.
    """

    brake: AnyBraking | None
    too_long: bool
    why: str


def shortest(tried: Callable[[float], BrakingTry[AnyBraking]]) -> AnyBraking:
    """Return the shortest braking that is possible.

    Times are doubled from 1 s up to 32 s until one is possible or leads too far. Bisection then
    shortens it to within 1 % of a time that is too short. If 1 s leads too far, times are halved
    instead. So no braking is shorter than 1 s unless that leads too far.

    Args:
        tried: Returns the braking in a duration [s], or why it is not possible.

    Raises:
        NoSolutionError: None of the times tried is possible; says why.
        TimeUpError: The time is up, and none is found.
    """
    too_short, long = 0.0, math.inf
    for duration in LONGER:
        found = tried(duration)
        if found.brake is not None or found.too_long:
            long = duration
            break
        too_short = duration
    if too_short == 0.0 and found.too_long:
        for duration in SHORTER:
            found = tried(duration)
            if not found.too_long:
                break
            long = duration
        if found.brake is None and not found.too_long:
            too_short = duration
    best, why = found.brake, found.why
    while 0.0 < too_short < long / FINE < math.inf:
        middle = math.sqrt(too_short * long)
        try:
            found = tried(middle)
        except TimeUpError:
            if best is None:
                raise
            break
        why = found.why
        if found.brake is None and not found.too_long:
            too_short = middle
            continue
        long = middle
        if found.brake is not None:
            best = found.brake
    if best is None:
        raise NoSolutionError(why)
    return best


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
    """Return the shortest braking that keeps limits, torques and what the grapple bears.

    Torques and loads are kept at every instant: what counts are bounds, 0.5 % too large at most.

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
        TimeUpError: The time is up, and none is found.
    """
    if wheels is not None and (full := np.abs(wheels.start) > wheels.capacity).any():
        i = int(full.argmax())
        raise NoSolutionError(
            f"wheel {wheels.names[i]} would come to hold {wheels.start[i]:.4g} of at most "
            f"{wheels.capacity[i]:.4g} N m s"
        )
    request = StraightBraking(held, dq, body, limits, efforts, bears, wheels, check_time)
    brake = shortest(request.tried)
    assert brake.peaks is not None  # within the limits, otherwise loose
    try:
        peaks = load_peaks(brake, body, check_time)
    except TimeUpError:
        return brake
    peaks = peaks._replace(bound=np.minimum(peaks.bound, brake.peaks.bound))
    return replace(brake, peaks=peaks)


@dataclass(frozen=True)
class StraightBraking:
    """A braking that is asked for, as of `braked`."""

    held: Configuration
    dq: Array
    body: Grasp
    limits: bool
    efforts: Array
    bears: Array
    wheels: Wheels | None
    check_time: Callable[[], None] | None

    def tried(self, duration: float) -> BrakingTry[Braking]:
        """Return the braking in a duration [s], or why it is not possible."""
        if self.check_time is not None:
            self.check_time()
        arm, mode = self.held.arm, FLOATING if self.wheels is None else HELD
        s = np.linspace(0.0, 1.0, 2 * STEPS + 1)
        q = self.held.q + np.outer(duration * (s - s**3 + 0.5 * s**4), self.dq)
        if self.limits and outside(arm, q[-1]):
            why = f"braking in {duration:.3g} s leads beyond the joint limits"
            return BrakingTry(None, True, why)
        proof = prove_regular(arm, q[[0, -1]], mode=mode)
        if proof is not None and not proof.free:
            why = f"braking in {duration:.3g} s leads through a singular posture"
            return BrakingTry(None, True, why)
        rates = np.outer(1 - 3 * s**2 + 2 * s**3, self.dq)
        ddq = np.outer(6 * (s**2 - s), self.dq) / duration
        motion = _drifting(self.held, self.body, duration * s, q, rates, ddq, mode)
        if self._fits(motion):  # at the samples
            allowed = np.concatenate((self.efforts, self.bears))
            peaks = load_peaks(motion, self.body, self.check_time, allowed)
            motion = replace(motion, peaks=peaks)
        if not self._fits(motion):
            torque = float((motion.largest_torques / self.efforts).max())
            force, moment = motion.borne
            why = (
                f"braking in {duration:.3g} s takes {torque:.4g} times the torque of a joint, and "
                f"{force:.4g} N and {moment:.4g} N m of the grapple"
            )
            return BrakingTry(None, False, why)
        if self.wheels is None:
            return BrakingTry(motion, False, "")
        load = load_of(arm, motion.spline)
        slower, excess = self.wheels.slowdown(load)
        if slower > 1.0:
            return BrakingTry(None, False, f"braking in {duration:.3g} s {excess}")
        return BrakingTry(_with_wheels(motion, self.wheels, self.wheels.story(load)), False, "")

    def _fits(self, motion: Braking) -> bool:
        """Return whether torques and loads are at most those allowed."""
        torques = (motion.largest_torques <= self.efforts).all()
        return bool(torques and (motion.borne <= self.bears).all())


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
