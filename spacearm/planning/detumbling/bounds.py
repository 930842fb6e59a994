"""Bounds: what joints and wheels may do on the way, and how much of it a course takes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spacearm.arrays import Array
from spacearm.model.arm import Configuration
from spacearm.planning.detumbling.course import Course, shapes
from spacearm.planning.optimiser import Target
from spacearm.planning.wheels.limits import Wheels

TIMES = np.sin(0.5 * np.pi * (np.arange(1, 32) / 32.0)) ** 2
"""Shares of the duration at which the limits are looked at: denser towards the ends."""
MARGIN = 0.98
"""Share of rates, torques and capacities that may be taken at these times."""


@dataclass(frozen=True)
class Bounds:
    """The limits of joints and wheels.

    Attributes:
        start: Configuration at the start.
        target: What has the joint limits.
        rates: (n,) largest joint rates [rad/s] or [m/s].
        wheels: The wheels.
    """

    start: Configuration
    target: Target
    rates: Array
    wheels: Wheels

    def excess(self, course: Course) -> float:
        """Return by how much limits are exceeded at worst, as a share of them."""
        used, bound, _ = self.use(course)
        return float((used / bound).max(initial=0.0)) - 1.0

    def rows(self, course: Course) -> tuple[Array, Array]:
        """Return G and g of the limits G x <= g on heights x, each row over its bound."""
        lower, upper, rate = self._with_room
        at, rates = shapes(TIMES), shapes(TIMES, 1) / course.duration
        blocks, rooms = [], []
        for i in range(len(course.start)):
            one = np.eye(len(course.start))[i]
            width = (upper[i] - lower[i]) / 2.0
            if np.isfinite(width):
                G = np.kron(at, one) / width
                blocks += [G, -G]
                rooms += [np.full(len(at), (upper[i] - course.start[i]) / width),
                          np.full(len(at), (course.start[i] - lower[i]) / width)]  # fmt: skip
            if np.isfinite(rate[i]):
                G = np.kron(rates, one) / rate[i]
                blocks += [G, -G]
                rooms += [np.ones(2 * len(at))]
        size = course.heights.size
        if not blocks:
            return np.zeros((0, size)), np.zeros(0)
        return np.vstack(blocks), np.concatenate(rooms)

    def use(self, course: Course) -> tuple[Array, Array, list[str]]:
        """Return the extremes of a course, the bounds that they have, and what they are."""
        arm = self.start.arm
        n = arm.n
        least, largest, rates = course.extremes()
        lower, upper = self.target.lower, self.target.upper
        middle, width = 0.5 * (lower + upper), 0.5 * (upper - lower)
        bound = np.isfinite(width)
        off = np.maximum(largest[:n] - middle, middle - least[:n])[bound]
        names = [repr(name) for name in arm.joint_names]
        used = [off, rates[:n], np.maximum(np.abs(least[n:]), np.abs(largest[n:])), rates[n:]]
        most = [width[bound], self.rates, self.wheels.capacity, self.wheels.torque]
        words = [
            *(f"joint {name} goes beyond its limits" for name in np.array(names)[bound]),
            *(f"joint {name} moves at {x:.4g}" for name, x in zip(names, used[1], strict=True)),
            *(f"wheel {name} holds {x:.4g} of at most {most:.4g} N m s"
              for name, x, most in zip(self.wheels.names, used[2], most[2], strict=True)),
            *(f"wheel {name} gives {x:.4g} of at most {most:.4g} N m"
              for name, x, most in zip(self.wheels.names, used[3], most[3], strict=True)),
        ]  # fmt: skip
        return np.concatenate(used), np.concatenate(most), words

    def load(self, course: Course) -> str:
        """Return what the wheels hold and give at most, in one sentence."""
        w = len(self.wheels.names)
        words = self.use(course)[2][-2 * w :]
        return f"{'; '.join(words)}: extremes of polynomials over time"

    @cached_property
    def _with_room(self) -> tuple[Array, Array, Array]:
        """(n + w,) least and largest values and largest rates, with some room."""
        capacity, target = MARGIN * self.wheels.capacity, self.target
        middle, width = 0.5 * (target.lower + target.upper), 0.5 * (target.upper - target.lower)
        with np.errstate(invalid="ignore"):
            lower = np.where(np.isfinite(width), middle - MARGIN * width, -np.inf)
            upper = np.where(np.isfinite(width), middle + MARGIN * width, np.inf)
        ends = [self.start.q] if target.q is None else [self.start.q, target.q]
        lower, upper = (
            np.minimum(lower, np.min(ends, axis=0)),
            np.maximum(upper, np.max(ends, axis=0)),
        )
        rate = MARGIN * self.rates
        return (
            np.append(lower, np.minimum(-capacity, self.wheels.start)),
            np.append(upper, np.maximum(capacity, self.wheels.start)),
            np.append(rate, MARGIN * self.wheels.torque),
        )
