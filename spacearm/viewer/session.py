"""Session: what the panel's messages do to the configuration, and what the panel shows of it.

No browser and no drawing here: messages are plain dictionaries from JSON, answers too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.catalogue import catalogue
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, unknown
from spacearm.mechanics.floating import move
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.singularities.report import SingularityReport, singularity
from spacearm.singularities.sets import singular_set

MODES = ("posture", "free-floating")
FARTHEST = 25.0
"""How far from home a slider reaches [rad] or [m]: four turns, or 25 m."""
LONGEST = 4.0 * FARTHEST
"""The longest joint motion on which the spacecraft is followed: it takes a fraction of a second."""


class Session:
    """The configuration that is shown, and the two ways of moving it.

    Attributes:
        arm: The arm.
        cfg: The configuration now.
        report: Its singularity report.
        mode: "posture": the attitude is held while joints move; "free-floating": the spacecraft
            turns as momentum conservation demands.
    """

    def __init__(self, arm: SpaceArm, cfg: Configuration) -> None:
        self.arm = arm
        self.mode = "posture"
        self._rng = np.random.default_rng()
        self._handlers: dict[str, Callable[[dict[str, Any]], None]] = {
            "joint": self._joint,
            "attitude": self._attitude,
            "mode": self._mode,
            "home": lambda _: self._home(),
            "nearest": lambda _: self._nearest(),
            "random": lambda _: self.go(self._rng.uniform(*self.range)),
        }
        self.show(cfg)

    def show(self, cfg: Configuration) -> None:
        """Takes over a configuration."""
        self.cfg = cfg
        self.report: SingularityReport = singularity(cfg)

    def go(self, q: Array) -> None:
        """Moves the joints straight to q; in free-floating mode the spacecraft reacts.

        Raises:
            ConfigurationError: The way there is too long to follow the spacecraft on it.
        """
        if self.mode == "posture":
            self.show(self.arm.at(q, base=self.cfg.base))
            return
        way = np.abs(q - self.cfg.q).max()
        if way > LONGEST:
            raise ConfigurationError(
                f"a joint would move by {way:.4g} rad or m; the spacecraft is followed over at "
                f"most {LONGEST:g}: switch to posture"
            )
        self.show(move(self.cfg, q))

    @property
    def home(self) -> Array:
        """(n,) the joints at zero, or at the limit nearest to it."""
        return np.clip(np.zeros(self.arm.n), self.arm.lower, self.arm.upper)

    @property
    def range(self) -> tuple[Array, Array]:
        """Ends of the sliders: the joint limits, but no more than `FARTHEST` from home.

        Half a turn or a metre where there are no limits.
        """
        free = np.where(self.arm.slides, 1.0, math.pi)
        lower, upper = self.arm.lower, self.arm.upper
        return (
            np.where(np.isfinite(lower), np.maximum(lower, self.home - FARTHEST), -free),
            np.where(np.isfinite(upper), np.minimum(upper, self.home + FARTHEST), free),
        )

    def handle(self, message: object) -> None:
        """Does what a message of the panel asks.

        Raises:
            ConfigurationError: The message is not one that the panel may send.
        """
        kind = message.get("do") if isinstance(message, dict) else message
        if not isinstance(message, dict) or str(kind) not in self._handlers:
            raise ConfigurationError(unknown("message", str(kind)[:40], self._handlers))
        self._handlers[str(kind)](message)

    def _joint(self, message: dict[str, Any]) -> None:
        index, value = message.get("index"), finite(message.get("value"), "value")
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < self.arm.n:
            raise ConfigurationError(f"joint index is {index!r}; give 0 to {self.arm.n - 1}")
        lower, upper = (end[index] for end in self.range)
        slack = 1e-6 * (upper - lower)  # a slider's end is rounded
        if not lower - slack <= value <= upper + slack:
            raise ConfigurationError(
                f"{self.arm.joint_names[index]} at {value:.6g} is outside its range "
                f"({lower:.6g} to {upper:.6g})"
            )
        q = self.cfg.q.copy()
        q[index] = value
        self.go(q)

    def _attitude(self, message: dict[str, Any]) -> None:
        rpy = message.get("rpy")
        if not isinstance(rpy, list) or len(rpy) != 3:
            raise ConfigurationError(f"attitude is {rpy!r}; give [roll, pitch, yaw]")
        R = pin.rpy.rpyToMatrix(np.array([finite(angle, "attitude") for angle in rpy]))
        self.show(self.arm.at(self.cfg.q, base=pin.SE3(R, self.cfg.base.translation)))

    def _mode(self, message: dict[str, Any]) -> None:
        mode = str(message.get("mode"))
        if mode not in MODES:
            raise ConfigurationError(unknown("mode", mode[:40], MODES))
        self.mode = mode

    def _home(self) -> None:
        """The joints at home; in posture mode the attitude too."""
        if self.mode == "posture":
            self.show(self.arm.at(self.home))
        else:
            self.go(self.home)

    def _nearest(self) -> None:
        """The nearest singular configuration in joint space, inside the limits or not."""
        try:
            self.go(singular_set(self.arm).nearest(self.cfg.q)[0])
        except (UnsupportedError, NoSolutionError) as error:
            raise ConfigurationError(str(error)) from None

    def about(self) -> dict[str, Any]:
        """What the panel needs once."""
        lower, upper = self.range
        joints = [self.arm.tree.joints[name] for name in self.arm.joint_names]
        return {
            "model": self.arm.name,
            "task": list(self.arm.task.rows),
            "unit": self.arm.sigma_unit,
            "joints": [
                {"name": j.name, "angle": j.kind != "prismatic", "lower": lo, "upper": hi}
                for j, lo, hi in zip(joints, lower.tolist(), upper.tolist(), strict=True)
            ],
        }

    def readout(self) -> dict[str, Any]:
        """What the panel shows of the configuration."""
        cfg, report = self.cfg, self.report
        rpy = pin.rpy.matrixToRpy(cfg.base.rotation)
        return {
            "mode": self.mode,
            "q": cfg.q.tolist(),
            "attitude": rpy.tolist(),
            "sigma": report.sigma.tolist(),
            "sigma_min": report.sigma_min,
            "condition": report.condition if math.isfinite(report.condition) else None,
            "kind": report.kind,
            "rank": report.rank,
            "radius": float(np.linalg.norm(cfg.tip.translation - cfg.com)),
            "tip": cfg.tip.translation.tolist(),
            "python": self.as_python(),
        }

    def as_python(self) -> str:
        """The configuration as Python code."""
        cfg = self.cfg
        pose = ", ".join(repr(float(x)) for x in pin.SE3ToXYZQUAT(cfg.base))
        known = {info.name for info in catalogue()}
        source = self.arm.name if self.arm.name in known else str(self.arm.path)
        written = "" if self.arm.name in known or self.arm.path.is_file() else "  # by arm.to_urdf"
        return (
            "import numpy as np\nimport pinocchio as pin\nimport spacearm as sa\n\n"
            f"arm = sa.load({source!r}, tip={self.arm.tip!r}, task={self.arm.task.names!r})"
            f"{written}\n"
            f"base = pin.XYZQUATToSE3(np.array([{pose}]))\n"
            f"cfg = arm.at({cfg.q.tolist()!r}, base=base)\n"
        )


LARGEST = 1e12
"""No angle or length that a person enters is larger."""


def finite(value: object, what: str) -> float:
    """A number out of a message, or an error that names it."""
    if isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= LARGEST:
        return float(value)
    raise ConfigurationError(f"{what} is {str(value)[:40]!r}; give a finite number")
