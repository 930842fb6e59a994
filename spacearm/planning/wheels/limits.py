"""Limits: what each wheel of a spacecraft can hold and give, and how a motion keeps within that."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, listed
from spacearm.model.arm import AT_REST, Configuration
from spacearm.model.wheels import rotor
from spacearm.motion.plant import WheelHold
from spacearm.planning.reactions.loads import Load
from spacearm.planning.reactions.majorants import ROOT

ROUNDING = 1e-9
"""Share of a momentum that is rounding."""
AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Wheels:
    """The wheels that hold an attitude.

    Attributes:
        names: What each is called in messages.
        axes: (3, w) unit vectors of their axes, spacecraft axes.
        torque: (w,) largest torque of each motor [N m].
        capacity: (w,) largest momentum that each holds [N m s].
        start: (w,) what each holds at the start [N m s].
    """

    names: tuple[str, ...]
    axes: Array
    torque: Array
    capacity: Array
    start: Array

    @classmethod
    def of(cls, cfg: Configuration, hold: WheelHold | None) -> Wheels:
        """Return the wheels of a spacecraft; three about its axes where none are described.

        Args:
            cfg: Where the plan begins, with the momentum that they hold and what each holds of it.
                If one is zero it follows from the other: each wheel's share by the pseudo-inverse
                of the axes.
            hold: Their limits; those of the description if None.

        Raises:
            ConfigurationError: They do not hold the momentum.
            UnsupportedError: A wheel is on a link that moves.
        """
        arm, count = cfg.arm, len(cfg.arm.wheels) or 3
        names, axes = tuple(f"about {axis}" for axis in AXES), np.eye(3)
        torque = capacity = np.full(count, np.inf)
        if arm.wheels:
            frames = [arm.model.frames[wheel.frame] for wheel in arm.wheels]
            for wheel, frame in zip(arm.wheels, frames, strict=True):
                if frame.parentJoint != ROOT:
                    raise UnsupportedError(
                        f"wheel {wheel.name!r} is on link {frame.name!r}, which moves with the "
                        "arm; plan with wheels on the spacecraft"
                    )
            names = tuple(repr(wheel.name) for wheel in arm.wheels)
            axes = np.column_stack(
                [f.placement.rotation @ w.axis for f, w in zip(frames, arm.wheels, strict=True)]
            )
            joints = [arm.tree.joints[wheel.name] for wheel in arm.wheels]
            torque = np.array([joint.effort for joint in joints])
            capacity = np.array([_most(joint.velocity, rotor(arm.tree, joint)) for joint in joints])
        if hold is not None:
            torque, capacity = np.full((2, count), [[hold.torque], [hold.capacity]])
        h = cfg.base.rotation.T @ cfg.momentum[3:]
        held = cfg.wheels if cfg.wheels.any() else np.linalg.pinv(axes) @ h
        h = h if h.any() else axes @ held
        if np.abs(axes @ held - h).max() > ROUNDING * max(np.abs(h).max(), 1.0):
            raise ConfigurationError(
                f"the wheels hold {(axes @ held).round(6).tolist()} N m s at the start and the "
                f"momentum is {h.round(6).tolist()} (spacecraft axes); an attitude that is held "
                "takes the two to be the same"
            )
        return cls(names, axes, torque, capacity, held)

    @classmethod
    def free(cls, cfg: Configuration, hold: WheelHold | None) -> Wheels:
        """Return the wheels of a spacecraft that turns, with what they hold.

        Raises:
            UnsupportedError: It has none, or one is on a link that moves.
        """
        if not cfg.arm.wheels:
            raise UnsupportedError(
                f"{cfg.arm.name} has no wheels to take up momentum; load it with wheels=[...], the "
                "names of joints"
            )
        return cls.of(replace(cfg, momentum=AT_REST), hold)

    @property
    def limited(self) -> bool:
        """Whether any of them has a limit."""
        return bool(np.isfinite([self.torque, self.capacity]).any())

    @cached_property
    def shares(self) -> Array:
        """(w, 3) share of each wheel in a momentum or torque, the pseudo-inverse of the axes."""
        return np.asarray(np.linalg.pinv(self.axes))

    def fastest(self, arm: Array) -> Array:
        """Return the factors (m,) on momenta (m, 3) of the arm at which a wheel is full."""
        spins = -arm @ self.shares.T
        room = self.capacity - np.sign(spins) * self.start
        found = np.full(spins.shape, np.inf)
        felt = np.abs(spins) > ROUNDING * np.abs(arm).max(initial=0.0)
        np.divide(np.maximum(room, 0.0), np.abs(spins), out=found, where=felt)
        return np.asarray(found.min(axis=1))

    def momenta(self, arm: Array) -> Array:
        """Return what each wheel holds (m, w) while the arm has momenta (m, 3), spacecraft axes.

        Each takes its share by the pseudo-inverse of the axes.

        Raises:
            UnsupportedError: They cannot hold it, having no axis along it.
        """
        share = self.shares
        left = arm - arm @ share.T @ self.axes.T
        if np.abs(left).max() > ROUNDING * np.abs(arm).max():
            raise UnsupportedError(
                f"the arm's momentum has a part across the axes of {listed(self.names)}, which "
                "they cannot take; add wheels about other axes"
            )
        return np.asarray(self.start - arm @ share.T)

    def slowdown(self, load: Load) -> tuple[float, str]:
        """Return how many times longer a motion must last within the limits, and what asks for it.

        Momentum falls with the duration, torque with its square. Bounds between the times of the
        load count.

        Raises:
            NoSolutionError: A wheel holds more than it can at the start.
        """
        rows = np.linalg.norm(self.shares, axis=1)
        spins = self.momenta(load.momentum) - self.start
        most, least = (spins.max(axis=0), spins.min(axis=0))
        torque = np.abs(load.torque @ self.shares.T).max(axis=0)
        found = [(0.0, "no wheel has a limit")]
        for i, name in enumerate(self.names):
            spare = rows[i] * load.beyond
            need = torque[i] + spare[1]
            story = f"wheel {name} gives {need:.4g} of at most {self.torque[i]:.4g} N m"
            found.append((float(np.sqrt(need / self.torque[i])), story))
            for sign, end in ((1.0, most[i]), (-1.0, -least[i])):
                swing, room = end + spare[0], self.capacity[i] - sign * self.start[i]
                story = (
                    f"wheel {name} comes to {self.start[i] + sign * swing:.4g} of at most "
                    f"{self.capacity[i]:.4g} N m s"
                )
                if room < 0.0 or (room == 0.0 and end > ROUNDING * self.capacity[i]):
                    raise NoSolutionError(
                        f"wheel {name} holds {self.start[i]:.4g} N m s at the start, of at most "
                        f"{self.capacity[i]:.4g}, and any motion brings more; unload it first"
                    )
                found.append((float(swing / room) if room else 0.0, story))
        return max(found)

    def story(self, load: Load) -> str:
        """Return what the wheels hold and give at most, and how that is known, in one sentence."""
        rows = np.linalg.norm(self.shares, axis=1)
        spins = np.abs(self.momenta(load.momentum)).max(axis=0) + rows * load.beyond[0]
        torques = np.abs(load.torque @ self.shares.T).max(axis=0)
        each = zip(self.names, spins, torques + rows * load.beyond[1], strict=True)
        words = [f"wheel {name} at most {h:.4g} N m s and {tau:.4g} N m" for name, h, tau in each]
        spare = [f"{largest:.2g}" for largest in rows.max() * load.beyond]
        return (
            f"{'; '.join(words)}: bounds between {len(load.t)} times included, {spare[0]} N m s "
            f"and {spare[1]} N m of it"
        )


def _most(rate: float, moment: float) -> float:
    """Return the momentum of a wheel at its largest rate; no limit of one without inertia."""
    return rate * moment if moment > 0.0 else np.inf
