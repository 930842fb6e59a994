"""Motions: flown by hand, compared, and what stands beside them as plain data for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Integers
from spacearm.equations.servo import Frame
from spacearm.errors import UnsupportedError, require_known
from spacearm.mechanics.floating import move, placed, samples
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration
from spacearm.model.joints import joint_scales
from spacearm.motion.flights import Flight
from spacearm.motion.motion import Motion
from spacearm.results import short_names
from spacearm.servo.servo import Servo, ServoStep

#: What the spacecraft may do while its joints move as they did, in words.
WORDS: dict[BaseMode, str] = {
    "free-floating": "spacecraft floating",
    "attitude-controlled": "attitude held",
    "fixed": "spacecraft fixed",
}
#: Rows of a motion that is made for comparison; joints move straight between them.
MOST_ROWS = 400


class Comparison(NamedTuple):
    """A motion to be played in step with another.

    Attributes:
        name: What it is called beside the curves.
        motion: The motion.
    """

    name: str
    motion: Motion


def compared(motion: Motion, other: Any) -> Comparison:
    """Return what a motion is compared with.

    Args:
        motion: The motion.
        other: Another one, or a mode: the same joint motion, from the same start and without
            momentum, while the spacecraft does that.

    Raises:
        ConfigurationError: It is neither.
        UnsupportedError: The wheels hold momentum, or the motion is that of a flight.
    """
    if not isinstance(other, str):
        second = Motion.of(other)
        return Comparison(f"{type(second).__name__}, {second.story}", second)
    if isinstance(motion, Flight):
        raise UnsupportedError(
            "the arm of a flight grasps and releases bodies; give the motion to compare it with"
        )
    mode = mode_named(other, "comparison")
    cfgs, rows = [motion[0]], some(len(motion), MOST_ROWS)
    for q in motion.q[rows[1:]]:
        cfgs.append(moved(cfgs[-1], q, mode))
    return Comparison(WORDS[mode], Motion(motion.arm, motion.t[rows], **samples(cfgs), mode=mode))


def mode_named(value: object, what: str = "mode") -> BaseMode:
    """Return a mode of the spacecraft out of a message.

    Raises:
        ConfigurationError: There is none of that name; calls it by `what`.
    """
    require_known(what, str(value)[:40], WORDS)
    return next(mode for mode in WORDS if mode == str(value))


def moved(cfg: Configuration, q: Array, mode: BaseMode) -> Configuration:
    """Return a configuration after the joints have moved straight to q (n,) in a mode."""
    if mode == "free-floating":
        return move(cfg, q)
    if mode == "attitude-controlled":
        return placed(cfg, q, cfg.base.rotation)
    return cfg.arm.at(q, base=cfg.base)


#: Longest time of a step of a flight by hand, and of what one message flies [s].
TICK, PAUSE = 0.02, 0.1
#: Largest joint rates [rad/s] and accelerations [rad/s^2] of a flight by hand, in radians.
RATE, PUSH = 1.0, 4.0


class HandFlight:
    """A flight of the tip by hand: a servo moves the arm, and its way is kept.

    Args:
        cfg: Where it begins.
        mode: What the spacecraft does.

    Attributes:
        cfg: Where the arm is.
        step: The last step of the servo; None before the first.
        lost: (6,) direction of the tip's twist that is being lost, in the axes of the wish.

    Raises:
        UnsupportedError: A servo cannot lead the arm.
    """

    def __init__(self, cfg: Configuration, mode: BaseMode) -> None:
        arm, radian = cfg.arm, joint_scales(cfg.arm)
        speed = np.array([arm.tree.joints[name].velocity for name in arm.joint_names])
        self.servo = Servo(
            arm, mode=mode, rates=np.minimum(speed, RATE * radian), accelerations=PUSH * radian
        )
        self.servo.start(cfg)
        self.cfg, self.lost = cfg, np.zeros(6)
        self.step: ServoStep | None = None
        self._way: list[tuple[float, Configuration]] = [(0.0, cfg)]

    def fly(self, twist: Array, seconds: float, frame: Frame) -> ServoStep:
        """Fly so long with a twist (6,) of the tip in axes of a frame; return the last step."""
        t = self._way[-1][0]
        count = max(1, math.ceil(min(seconds, PAUSE) / TICK))
        dt = min(seconds, PAUSE) / count
        for _ in range(count):
            R = {"inertial": np.eye(3), "spacecraft": self.cfg.base.rotation,
                 "tip": self.cfg.tip.rotation}[frame]  # fmt: skip
            step = self.servo.step(self.cfg, (twist.reshape(2, 3) @ R.T).ravel(), dt)
            self.lost = (step.lost.reshape(2, 3) @ R).ravel()
            self.cfg = moved(self.cfg, self.cfg.q + dt * step.rates, self.servo.mode)
            self.step, t = step, t + dt
            self._way.append((t, self.cfg))
        return step

    @property
    def motion(self) -> Motion | None:
        """The way so far; None if the arm has not moved."""
        if not any((cfg.q != self._way[0][1].q).any() for _, cfg in self._way):
            return None
        t, cfgs = zip(*self._way, strict=True)
        return Motion(self.cfg.arm, np.array(t), **samples(list(cfgs)), mode=self.servo.mode)


def some(count: int, most: int) -> Integers:
    """Return the numbers of at most so many of the rows of a motion, evenly spread."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)


#: Largest number of samples of a curve; more than a screen shows.
MOST_SAMPLES = 600


class Curves(NamedTuple):
    """Curves of a motion that share an axis.

    Attributes:
        name: What they show.
        unit: Its unit.
        labels: k names.
        values: (m, k), in degrees where they are angles.
    """

    name: str
    unit: str
    labels: list[str]
    values: Array

    def at(self, times: Array, known: Array) -> Curves:
        """Return the curves at other times, linear in between; NaN outside of the known ones."""
        columns = [np.interp(times, known, column, np.nan, np.nan) for column in self.values.T]
        return self._replace(values=np.array(columns).T)

    def plain(self, beside: Curves | None) -> dict[str, Any]:
        """Return plain data, with curves of another motion; values that are not finite are None."""
        told = {**self._asdict(), "values": _columns(self.values)}
        if beside is not None:
            told["beside"] = {"labels": beside.labels, "values": _columns(beside.values)}
        return told


def account(motion: Motion, other: Comparison | None = None) -> dict[str, Any]:
    """Return span, events and curves of a motion, where it ends, and whether it has momentum.

    Args:
        motion: The motion.
        other: The motion that it is compared with.
    """
    t, curves = _sampled(motion)
    beside: dict[tuple[str, str], Curves] = {}
    if other is not None:
        own, (known, second) = t, _sampled(other.motion)
        t = np.union1d(own, known)
        curves = [group.at(t, own) for group in curves]
        beside = {(group.name, group.unit): group.at(t, known) for group in second}
    return {
        "story": f"{type(motion).__name__}, {motion.story}",
        "described": _described(motion),
        "events": [
            {"t": float(event.t), "kind": event.kind, "detail": event.detail}
            for event in getattr(motion, "events", ())
        ],
        "compared": None if other is None else other.name,
        "momentum": bool(np.any(getattr(motion, "momentum", 0.0))),
        "span": [float(t[0]), float(t[-1])],
        "t": t.tolist(),
        "curves": [group.plain(beside.get((group.name, group.unit))) for group in curves],
    }


@lru_cache(maxsize=2)
def _described(motion: Motion) -> dict[str, Any]:
    """Return notes and tables of the description of a motion, as texts."""
    said = motion.describe()
    tables = [
        {"title": t.title, "head": t.head("both"), "rows": t.body("both")} for t in said.parts
    ]
    notes = [said.headline, *said.notes, said.limits]
    return {"notes": [*filter(None, notes)], "tables": tables}


def _sampled(motion: Motion) -> tuple[Array, list[Curves]]:
    """Return times of a motion and its curves at them."""
    rows = some(len(motion), MOST_SAMPLES)
    return motion.t[rows], list(_curves(motion, rows))


def _curves(motion: Motion, rows: Integers) -> Iterator[Curves]:
    """Yield the curves of a motion at some of its samples."""
    arm, names, q = motion.arm, short_names(motion.arm.joint_names), motion.q[rows]
    turning, sliding = np.flatnonzero(~arm.slides), np.flatnonzero(arm.slides)
    if len(turning):
        yield Curves("joints", "°", [names[j] for j in turning], np.degrees(q[:, turning]))
    if len(sliding):
        yield Curves("sliding joints", "m", [names[j] for j in sliding], q[:, sliding])
    turns = [pin.Quaternion(row).toRotationMatrix() for row in motion.base[rows, 3:]]
    rpy = np.unwrap([pin.rpy.matrixToRpy(R) for R in turns], axis=0)
    yield Curves("attitude", "°", ["roll", "pitch", "yaw"], np.degrees(rpy))
    distance = np.degrees(motion.distance[rows, None])
    yield Curves("distance", "°", ["to a singular posture found"], distance)
    yield Curves("sigma_min", arm.sigma_unit, ["sigma_min"], motion.sigma_min[rows, None])
    if len(arm.tips) == 1:
        tip = motion.tip[rows, :3]
        yield Curves("tip", "m", ["x", "y", "z"], tip)
        radius = np.linalg.norm(tip - motion.com[rows], axis=1)
        yield Curves("R from the CM", "m", ["R"], radius[:, None])
    if (torque := getattr(motion, "torque", None)) is not None:
        yield Curves("torques", "N m or N" if len(sliding) else "N m", names, torque[rows])
    spins = (("wheels", "N m s", "wheels"), ("wheel torques", "N m", "wheel_torque"))
    for what, unit, name in spins if arm.wheels else ():
        if (load := getattr(motion, name, None)) is not None:
            yield Curves(what, unit, [wheel.name for wheel in arm.wheels], load[rows])
    pushes: dict[str, Array] = dict(getattr(motion, "wrenches", {}))
    for link, short in zip(pushes, short_names(list(pushes)), strict=True):
        for what, unit, part in (("force", "N", slice(3)), ("torque", "N m", slice(3, 6))):
            if pushes[link][:, part].any():
                values = pushes[link][rows, part]
                yield Curves(f"{what} on {short}", unit, ["x", "y", "z"], values)


def _columns(values: Array) -> list[list[float | None]]:
    """Return columns for JSON, which has no numbers that are not finite."""
    return [[float(x) if np.isfinite(x) else None for x in column] for column in values.T]
