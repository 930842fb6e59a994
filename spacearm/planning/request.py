"""What is asked of the planner: the constraints that a plan keeps, and how it is searched for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, finite, plain, positive, whole
from spacearm.collisions.obstacles import Obstacle
from spacearm.errors import ConfigurationError, unknown
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion
from spacearm.motion.plant import WheelHold
from spacearm.planning.timing import largest_rates

Progress: TypeAlias = Callable[[float, float], object]
"""Called now and then as progress(done, total); of a search both are times [s]."""

FARTHEST = 1.0
"""Largest clearance [rad]: the distance to the singular set is too rough beyond."""
METHODS = ("auto", "straight", "joint space", "cycles", "attitude first", "tree")


@dataclass(frozen=True, kw_only=True, eq=False)
class Constraints:
    """What must hold on the way of a plan.

    Attributes:
        limits: Whether the joint limits hold.
        collisions: Whether the spacecraft and the links must not meet. Links count with their
            collision geometry, or their visuals where they have none; meshes as convex hulls.
            Bodies on both sides of one joint may touch. `Plan.checked` says what was checked.
        obstacles: What the spacecraft and the links must not meet besides, in the inertial frame,
            as the base of the start and poses as goals are: `Obstacle.box`, `.sphere`, `.cylinder`,
            `.mesh` and `.robot`, and configurations or motions of other robots; one or several.
            Those that move begin with the plan. That none is met is proven for the motion with the
            spacecraft turning as it does.
        clearance: How far from the singular set the motion stays at least [rad], to first order as
            in `singularity`, from 0 to 1; if None, 0.1 degrees, but no more than half of what the
            start has.
        keep_attitude: Largest turn of the floating spacecraft on the way [rad], proven between the
            rows too; joints of another arm, if they count, move so as to keep it. None for any.
        rates: Largest joint rates [rad/s] or [m/s], one number or (n,); if None those of the
            description, and 0.5 where it gives none.
        wheels: Limits of each wheel that holds the attitude or detumbles; if None those of the
            description, `effort` and `velocity` times its moment of inertia. A spacecraft without
            wheels in its description is held by three, about its axes.

    Raises:
        ConfigurationError: A value does not make sense.
    """

    limits: bool = True
    collisions: bool = True
    obstacles: Obstacle | Configuration | Motion | Sequence[Obstacle | Configuration | Motion] = ()
    clearance: float | None = None
    keep_attitude: float | None = None
    rates: npt.ArrayLike | None = None
    wheels: WheelHold | None = None

    def __post_init__(self) -> None:
        least = self.clearance
        if least is not None and not (isinstance(least, Real) and 0.0 <= least <= FARTHEST):
            raise ConfigurationError(
                f"clearance is {least!r}; give an angle from 0 to {FARTHEST:g} rad"
            )
        if self.keep_attitude is not None:
            positive(self.keep_attitude, "keep_attitude", "angle [rad]")
        none = isinstance(self.obstacles, Sequence) and not self.obstacles
        if not self.collisions and not none:
            raise ConfigurationError("obstacles count as collisions do; leave out collisions=False")

    def joint_rates(self, arm: SpaceArm) -> Array:
        """Return the largest rates of the joints of an arm (n,) [rad/s] or [m/s].

        Raises:
            ConfigurationError: They are no positive numbers, one or one per joint.
        """
        if self.rates is None:
            return largest_rates(arm)
        shape = (arm.n,) if np.iterable(self.rates) else ()
        rates = finite(self.rates, shape, "rates", "(the largest one, for all joints or for each)")
        if not (rates > 0.0).all():
            raise ConfigurationError(f"rates is {self.rates!r}; give positive numbers")
        return np.broadcast_to(rates, arm.n)

    def to_dict(self) -> dict[str, Any]:
        """Return the constraints as plain data."""
        return {name: plain(value) for name, value in vars(self).items()}


@dataclass(frozen=True, kw_only=True)
class Search:
    """How a plan is searched for.

    Attributes:
        seed: Seed of the random first guesses; the same seed gives the same plan, if it is found
            in time.
        timeout: Time after which the search is given up [s]. Until then it goes on with other first
            guesses.
        method: "auto", or one of the methods of `plan`.
        progress: Called now and then as progress(t, timeout), both in s.

    Raises:
        ConfigurationError: A value does not make sense.
    """

    seed: int = 0
    timeout: float = 60.0
    method: str = "auto"
    progress: Progress | None = None

    def __post_init__(self) -> None:
        whole(self.seed, "seed", 0)
        if not isinstance(self.timeout, Real) or not self.timeout > 0.0:
            raise ConfigurationError(f"timeout is {self.timeout!r}; give a positive time [s]")
        if self.method not in METHODS:
            raise ConfigurationError(unknown("method", self.method, METHODS))

    def to_dict(self) -> dict[str, Any]:
        """Return seed, timeout and method as plain data."""
        return {name: plain(value) for name, value in vars(self).items() if name != "progress"}
