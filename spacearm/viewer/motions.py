"""Motions: what a motion is compared with, and what stands beside it as plain data for JSON."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, UnsupportedError, unknown
from spacearm.mechanics.floating import move, placed
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration
from spacearm.motion.motion import Motion, samples
from spacearm.viewer.readouts import short_names

WORDS: dict[BaseMode, str] = {
    "free-floating": "spacecraft floating",
    "attitude-controlled": "attitude held",
    "fixed": "spacecraft fixed",
}
"""What the spacecraft may do while its joints move as they did, in words."""
MOST_ROWS = 400
"""Rows of a motion that is made for comparison; joints move straight between them."""


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
    mode = next((mode for mode in WORDS if mode == other), None)
    if getattr(motion, "flight", None) is not None:
        raise UnsupportedError(
            "the arm of a flight grasps and releases bodies; give the motion to compare it with"
        )
    if mode is None:
        raise ConfigurationError(unknown("comparison", other[:40], tuple(WORDS)))
    return Comparison(WORDS[mode], _reacting(motion, mode))


def moved(cfg: Configuration, q: Array, mode: BaseMode) -> Configuration:
    """Return a configuration after the joints have moved straight to q (n,) in a mode."""
    if mode == "free-floating":
        return move(cfg, q)
    if mode == "attitude-controlled":
        return placed(cfg, q, cfg.base.rotation)
    return cfg.arm.at(q, base=cfg.base)


def _reacting(motion: Motion, mode: BaseMode) -> Motion:
    """Return the same joint motion from the same start with another spacecraft."""
    rows = np.linspace(0, len(motion) - 1, min(len(motion), MOST_ROWS)).round().astype(int)
    cfgs = [motion[0]]
    for q in motion.q[rows[1:]]:
        cfgs.append(moved(cfgs[-1], q, mode))
    return Motion(motion.arm, motion.t[rows], **samples(cfgs), mode=mode)


MOST_SAMPLES = 600
"""Largest number of samples of a curve; more than a screen shows."""


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
        data = {"name": self.name, "unit": self.unit, "labels": self.labels}
        told: dict[str, Any] = {**data, "values": _columns(self.values)}
        if beside is not None:
            told["beside"] = {"labels": beside.labels, "values": _columns(beside.values)}
        return told


def account(motion: Motion, other: Comparison | None = None) -> dict[str, Any]:
    """Return span, events and curves of a motion, where it ends, and whether it has momentum.

    Args:
        motion: The motion.
        other: The motion that it is compared with.
    """
    told = {
        "story": f"{type(motion).__name__}, {motion.story}",
        "events": _events(motion),
        "compared": None if other is None else other.name,
        "momentum": bool(np.any(getattr(motion, "momentum", 0.0))),
    }
    t, own = _sampled(motion)
    if other is None:
        curves = [group.plain(None) for group in own]
        return {**told, "span": [float(t[0]), float(t[-1])], "t": t.tolist(), "curves": curves}
    known, second = _sampled(other.motion)
    times = np.union1d(t, known)
    beside = {(group.name, group.unit): group.at(times, known) for group in second}
    curves = [group.at(times, t).plain(beside.get((group.name, group.unit))) for group in own]
    return {
        **told,
        "span": [float(times[0]), float(times[-1])],
        "t": times.tolist(),
        "curves": curves,
    }


def _sampled(motion: Motion) -> tuple[Array, list[Curves]]:
    """Return times of a motion and its curves at them."""
    rows = np.linspace(0, len(motion) - 1, min(len(motion), MOST_SAMPLES)).round().astype(int)
    rows = np.unique(rows)
    return motion.t[rows], _curves(motion, rows)


def _events(motion: Motion) -> list[dict[str, Any]]:
    """Return what happened on the way."""
    found = getattr(motion, "events", ())
    return [{"t": float(e.t), "kind": e.kind, "detail": e.detail} for e in found]


def _curves(motion: Motion, rows: Array) -> list[Curves]:
    """Return the curves of a motion at some of its samples."""
    arm, names = motion.arm, short_names(motion.arm.joint_names)
    turning, sliding = np.flatnonzero(~arm.slides), np.flatnonzero(arm.slides)
    q = motion.q[rows]
    groups: list[Curves] = []
    if len(turning):
        groups.append(Curves("joints", "°", [names[j] for j in turning], np.degrees(q[:, turning])))
    if len(sliding):
        groups.append(Curves("sliding joints", "m", [names[j] for j in sliding], q[:, sliding]))
    rpy = [pin.rpy.matrixToRpy(pin.Quaternion(row).toRotationMatrix())
           for row in motion.base[rows, 3:]]  # fmt: skip
    turned = np.degrees(np.unwrap(rpy, axis=0))
    groups.append(Curves("attitude", "°", ["roll", "pitch", "yaw"], turned))
    distance = np.degrees(motion.distance[rows])[:, None]
    groups.append(Curves("distance", "°", ["to a singular posture"], distance))
    groups.append(Curves("sigma_min", arm.sigma_unit, ["sigma_min"], motion.sigma_min[rows, None]))
    if len(arm.tips) == 1:
        tip, com = motion.tip[rows, :3], motion.com[rows]
        groups.append(Curves("tip", "m", ["x", "y", "z"], tip))
        radius = np.linalg.norm(tip - com, axis=1)[:, None]
        groups.append(Curves("R from the CM", "m", ["R"], radius))
    if (torque := getattr(motion, "torque", None)) is not None:
        groups.append(Curves("torques", "N m" if not len(sliding) else "N m or N", names,
                             torque[rows]))  # fmt: skip
    if arm.wheels and (wheels := getattr(motion, "wheels", None)) is not None:
        groups.append(Curves("wheels", "N m s", [wheel.name for wheel in arm.wheels], wheels[rows]))
    pushes: dict[str, Array] = dict(getattr(motion, "wrenches", {}))
    for link, short in zip(pushes, short_names(list(pushes)), strict=True):
        for what, unit, part in (("force", "N", slice(3)), ("torque", "N m", slice(3, 6))):
            if pushes[link][:, part].any():
                values = pushes[link][rows, part]
                groups.append(Curves(f"{what} on {short}", unit, ["x", "y", "z"], values))
    return groups


def _columns(values: Array) -> list[list[float | None]]:
    """Return columns for JSON, which has no numbers that are not finite."""
    return [[float(x) if np.isfinite(x) else None for x in column] for column in values.T]
