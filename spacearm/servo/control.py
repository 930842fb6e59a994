"""The servo as a controller of simulations."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spacearm.arrays import Array, ArrayLike, finite, positive, within
from spacearm.equations.servo import SHORTEST
from spacearm.errors import ConfigurationError
from spacearm.mechanics.dynamics import inverse_dynamics
from spacearm.model.arm import Configuration
from spacearm.motion.controllers import Law
from spacearm.servo.servo import Servo, ServoStep
from spacearm.signatures import checked

#: Share of a period by which times of a sampled controller may be off.
SAME = 1e-6


@checked
@dataclass(frozen=True, kw_only=True)
class ServoControl(Law):
    """A servo in the loop of `simulate`: inverse dynamics makes the joints take up its rates.

    It has a state, so it must be sampled: `sampling=sa.Sampling(period=control.period)`.

    Attributes:
        servo: The servo.
        twist: The commanded twist, as `Servo.step` takes it, or a function of (t, cfg) that gives
            it.
        period: Time between two steps [s], no longer than a step of the servo may be.
        gain: Rate at which the joints take up their rates [1/s], at most 1 / period.

    Raises:
        ConfigurationError: twist is not finite or has the wrong shape; period or gain is not
            positive, or too large; or, when it is called, the times are not those of a controller
            sampled with its period.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> control = sa.ServoControl(servo=sa.Servo(arm, rates=0.5), twist=[0.1, 0.0])
        >>> run = sa.simulate(arm.at([0.3, 1.2]), control, 1.0, sampling=sa.Sampling(period=0.01))
        >>> [step.halted for step in control.steps[-1:]]
        ['']
    """

    servo: Servo
    twist: ArrayLike | Callable[[float, Configuration], ArrayLike]
    period: float = 0.01
    gain: float = 20.0
    _taken: deque[tuple[bytes, ServoStep]] = field(default_factory=deque, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not callable(self.twist):
            twists = self.servo.tip_twists(self.twist)
            finite(twists, twists.shape, "twist", "[m/s], [rad/s]")
        longest = float(self.servo.limits.longest)
        within(self.period, "period", SHORTEST, longest, "the time of a step of the servo [s],")
        if positive(self.gain, "gain", "gain [1/s]") * self.period > 1.0 + SAME:
            raise ConfigurationError(
                f"gain is {self.gain:g} 1/s, by which joints overshoot in a period of "
                f"{self.period:g} s; give at most {1.0 / self.period:g}"
            )

    @property
    def steps(self) -> list[ServoStep]:
        """The steps of the last run, a period apart."""
        return [step for _, step in self._taken]

    def __call__(self, t: float, cfg: Configuration, dq: Array) -> Array:
        """Return the torques (n,) [N m] or forces [N]."""
        number = round(t / self.period)
        if abs(t - number * self.period) > SAME * self.period:
            raise ConfigurationError(
                f"a ServoControl with the period {self.period:g} s is called at {t:g} s; simulate "
                f"with sampling=sa.Sampling(period={self.period:g})"
            )
        taken, here = self._taken, cfg.q.tobytes()
        if number != len(taken) - 1 or taken[-1][0] != here:  # lanes ask for the same side by side
            if number != len(taken) or number == 0:
                self.servo.start(cfg)
                taken.clear()
            wished = self.twist(t, cfg) if callable(self.twist) else self.twist
            taken.append((here, self.servo.step(cfg, wished, self.period)))
        rates = taken[-1][1].rates
        return inverse_dynamics(cfg, dq, self.gain * (rates - dq), mode=self.servo.mode).tau

    def error(self, _: float, cfg: Configuration) -> Array:
        """Return inf: there is no target to arrive at."""
        return np.full(cfg.arm.n, np.inf)

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return {"servo": self.servo.to_dict(), "period": self.period, "gain": self.gain}
