"""Session: the configuration on show, moved by the panel's messages and read out for the panel.

It knows no browser and no drawing: messages and answers are plain dictionaries for JSON.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, unknown
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.singularities.report import SingularityReport, angle, singularity
from spacearm.viewer.panel import readouts
from spacearm.viewer.panel.choices import Origin
from spacearm.viewer.panel.comparison import WORDS, moved
from spacearm.viewer.panel.grab import pulled
from spacearm.viewer.panel.numbers import number, numbers, placement, vector

MODES = ("posture", "free-floating")
FARTHEST = 25.0
"""Largest reach of a slider from home [rad] or [m]: four turns, or 25 m."""
LONGEST = 4.0 * FARTHEST
"""Longest joint motion on which the reaction of the spacecraft is integrated [rad] or [m]."""


class Session:
    """The configuration on show, and the two ways of moving it.

    Attributes:
        arm: The arm.
        cfg: The configuration on show.
        report: Its singularity report.
        origin: Where it comes from.
        mode: "posture": the attitude stays while joints move; "free-floating": the spacecraft turns
            as momentum conservation demands.
        spacecraft: What the spacecraft does, which decides what is singular. Unless it is
            "free-floating", it decides how the spacecraft moves, too.
        note: What the last request did, in one line; empty if there is nothing to say.
        goal: Pose of the tip to plan to; None if there is none.
        blocked: Why the tip did not follow the last pull; empty if it did.
    """

    def __init__(self, arm: SpaceArm, cfg: Configuration, origin: Origin | None = None) -> None:
        self.arm = arm
        self.origin = origin or Origin.of(arm)
        self.mode = "posture"
        self.spacecraft: BaseMode = "free-floating"
        self.note = ""
        self.blocked = ""
        self.goal: pin.SE3 | None = None
        self._grip = 0.0
        self._grabbed: pin.SE3 | None = None
        self._rng = np.random.default_rng(0)
        self._handlers: dict[str, Callable[[dict[str, Any]], None]] = {
            "joint": self._joint,
            "joints": self._joints,
            "grab": self._grab,
            "goal": self._goal,
            "attitude": self._attitude,
            "posture": self._posture,
            "mode": self._mode,
            "spacecraft": self._spacecraft,
            "home": lambda _: self._home(),
            "nearest": lambda _: self._nearest(),
            "random": lambda _: self.go(self._rng.uniform(*self.range)),
        }
        self.show(cfg)

    def show(self, cfg: Configuration) -> None:
        """Show a configuration."""
        self.cfg = cfg
        self.report: SingularityReport = singularity(cfg, mode=self.spacecraft)

    def go(self, q: Array) -> None:
        """Move the joints straight to q (n,); in free-floating mode the spacecraft reacts.

        Raises:
            ConfigurationError: The motion is too long to integrate the reaction.
        """
        if self._moves != "free-floating":
            self.show(moved(self.cfg, q, self._moves))
            return
        way = np.abs(q - self.cfg.q).max()
        if way > LONGEST:
            raise ConfigurationError(
                f"a joint would move by {way:.4g} rad or m; the spacecraft is followed over at "
                f"most {LONGEST:g}: switch to posture"
            )
        self.show(moved(self.cfg, q, "free-floating"))

    @property
    def home(self) -> Array:
        """(n,) joint positions: zeros, or the limits nearest to them."""
        return np.clip(np.zeros(self.arm.n), self.arm.lower, self.arm.upper)

    @property
    def range(self) -> tuple[Array, Array]:
        """Ends of the sliders: the joint limits, at most `FARTHEST` from home.

        Half a turn or a metre where there are no limits.
        """
        free = np.where(self.arm.slides, 1.0, math.pi)
        lower, upper = self.arm.lower, self.arm.upper
        return (
            np.where(np.isfinite(lower), np.maximum(lower, self.home - FARTHEST), -free),
            np.where(np.isfinite(upper), np.minimum(upper, self.home + FARTHEST), free),
        )

    def handle(self, message: object) -> None:
        """Do what a message of the panel asks.

        Raises:
            ConfigurationError: The message is unknown, or a value in it is not valid.
        """
        kind = message.get("do") if isinstance(message, dict) else message
        if not isinstance(message, dict) or str(kind) not in self._handlers:
            raise ConfigurationError(unknown("message", str(kind)[:40], self._handlers))
        self.note = self.blocked = ""
        self._handlers[str(kind)](message)

    def _joint(self, message: dict[str, Any]) -> None:
        self._move([message.get("index")], [message.get("value")])

    def _joints(self, message: dict[str, Any]) -> None:
        indices, values = message.get("indices"), message.get("values")
        if not (isinstance(indices, list) and isinstance(values, list)):
            raise ConfigurationError("joints: give lists of indices and values")
        if len(indices) != len(values) or len(indices) > self.arm.n:
            raise ConfigurationError(
                f"joints: {len(indices)} indices and {len(values)} values; give a value for each"
            )
        self._move(indices, values)

    def _move(self, indices: Sequence[object], values: Sequence[object]) -> None:
        q = self.cfg.q.copy()
        for index, given in zip(indices, values, strict=True):
            value = number(given, "value")
            if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(q):
                raise ConfigurationError(f"joint index is {index!r}; give 0 to {len(q) - 1}")
            q[index] = self._within(index, value)
        self.go(q)

    def _within(self, index: int, value: float) -> float:
        """Return a joint position; an error if it is outside the range of its slider."""
        lower, upper = (end[index] for end in self.range)
        slack = 1e-6 * (upper - lower)  # a slider's end is rounded
        if not lower - slack <= value <= upper + slack:
            kind = "prismatic" if self.arm.slides[index] else "revolute"
            at, low, high = (readouts.joint_value(x, kind) for x in (value, lower, upper))
            name = self.arm.joint_names[index]
            raise ConfigurationError(f"{name} at {at} is outside its range ({low} to {high})")
        return value

    def _grab(self, message: dict[str, Any]) -> None:
        """Pull the tip by a shift [m] and a turn [rad] from where it was grabbed."""
        grip = number(message.get("grip"), "grip")
        if grip != self._grip or self._grabbed is None:
            self._grip, self._grabbed = grip, self.cfg.tip
        shift, turn = (vector(message.get(name), name) for name in ("shift", "turn"))
        grabbed = self._grabbed
        goal = pin.SE3(pin.exp3(turn) @ grabbed.rotation, grabbed.translation + shift)
        found = pulled(self.cfg, goal, self._moves, self._moved, self.range)
        self.blocked = found.blocked
        self.show(found.cfg)

    def _goal(self, message: dict[str, Any]) -> None:
        """Set the goal of plans: the tip's pose, with a position and an attitude if given."""
        goal = self.cfg.tip.copy()
        if message.get("position") is not None:
            goal.translation = vector(message["position"], "position")
        if message.get("rpy") is not None:
            goal.rotation = pin.rpy.rpyToMatrix(vector(message["rpy"], "rpy"))
        self.goal = goal

    def _moved(self, cfg: Configuration, q: Array) -> Configuration:
        """Return a configuration after a short joint motion in the present mode."""
        return moved(cfg, q, self._moves)

    @property
    def _moves(self) -> BaseMode:
        """What the spacecraft does while joints move here; a posture is set by hand."""
        by_hand = self.spacecraft == "free-floating" and self.mode == "posture"
        return "fixed" if by_hand else self.spacecraft

    def _attitude(self, message: dict[str, Any]) -> None:
        rpy = message.get("rpy")
        if not isinstance(rpy, list) or len(rpy) != 3:
            raise ConfigurationError(f"attitude is {rpy!r}; give [roll, pitch, yaw]")
        R = pin.rpy.rpyToMatrix(np.array([number(angle, "attitude") for angle in rpy]))
        self.show(self.arm.at(self.cfg.q, base=pin.SE3(R, self.cfg.base.translation)))

    def _posture(self, message: dict[str, Any]) -> None:
        """Show joint positions and a pose of the spacecraft as they are told, in any mode."""
        q = numbers(message.get("q"), self.arm.n, "q")
        self.show(self.arm.at(q, base=placement(message.get("base"), "base")))

    def _mode(self, message: dict[str, Any]) -> None:
        mode = str(message.get("mode"))
        if mode not in MODES:
            raise ConfigurationError(unknown("mode", mode[:40], MODES))
        self.mode = mode

    def _spacecraft(self, message: dict[str, Any]) -> None:
        spacecraft = next((mode for mode in WORDS if mode == message.get("mode")), None)
        if spacecraft is None:
            raise ConfigurationError(unknown("mode", str(message.get("mode"))[:40], WORDS))
        self.spacecraft = spacecraft
        self.show(self.cfg)

    def _home(self) -> None:
        """Move the joints home; in posture mode turn the spacecraft back too."""
        if self.mode == "posture" and self.spacecraft == "free-floating":
            self.show(self.arm.at(self.home))
        else:
            self.go(self.home)

    def _nearest(self) -> None:
        """Go to the nearest singular configuration in joint space, inside the limits or not."""
        found = singularity(self.cfg, mode=self.spacecraft, exact=True)
        if found.nearest is None:
            raise ConfigurationError(f"{self.arm.name}: no singular configuration was found")
        if found.distance == 0.0:
            raise ConfigurationError(f"{self.arm.name} is singular here already")
        way = found.nearest - self.cfg.q
        self.go(found.nearest)
        self.note = f"went {angle(found.distance)}: {readouts.turns(self.arm, way)}"

    def about(self) -> dict[str, Any]:
        """Return what the panel needs once: model, task, unit and joints."""
        return {**readouts.about(self.arm), "joints": readouts.joints(self.arm, *self.range)}

    def readout(self) -> dict[str, Any]:
        """Return what the panel shows of the configuration."""
        said: dict[str, Any] = {"mode": self.mode, "note": self.note, "blocked": self.blocked}
        said |= {"spacecraft": self.spacecraft}
        said |= {"goal": None if self.goal is None else readouts.pose(self.goal)}
        source, _, locked, made, changed = self.origin
        code = readouts.as_python(self.cfg, source, locked, made)
        if changed:
            code = f"# without what was changed in Python: locked joints, masses, lengths\n{code}"
        if self.spacecraft != "free-floating":
            code += f"report = sa.singularity(cfg, mode={self.spacecraft!r})\n"
        return {**said, **readouts.readout(self.report), "python": code}
