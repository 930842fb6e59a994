"""How far the tip can go with a level spacecraft, over the mass of the bus and the turn allowed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spacearm.arrays import Array, Progress, Result, positive
from spacearm.errors import ConfigurationError
from spacearm.mission.level import level_reach, level_start
from spacearm.model.arguments import of_configuration
from spacearm.model.arm import Configuration, SpaceArm


@dataclass(frozen=True, eq=False, repr=False)
class LevelEnvelope(Result):
    """How far the tip can go with a level spacecraft, over bus masses (b,) and turns (t,).

    Attributes:
        arm: The arm; its own bus is replaced.
        base_mass: (b,) masses of the spacecraft [kg].
        tilt: (t,) largest turns of the spacecraft [rad].
        least: (b, t) how far the tip can go in the worst direction [m].
        mean: (b, t) how far it can go on average over all directions [m].
        volume: (b, t) volume that straight lines reach [m^3]; of planar arms the area [m^2].
        travel: Length of the lines for the following [m].
        turn: (b,) median turn of the spacecraft by lines of this length in all directions [rad];
            NaN where none can be followed.
        largest_turn: (b,) the largest of them [rad].
        followed: (b,) share of the directions in which they can be followed.
        same_density: Whether the inertia of the bus grows as mass^(5/3), else as the mass.
    """

    arm: SpaceArm
    base_mass: Array
    tilt: Array
    least: Array
    mean: Array
    volume: Array
    travel: float
    turn: Array
    largest_turn: Array
    followed: Array
    same_density: bool

    def __repr__(self) -> str:
        turns = ", ".join(
            f"{np.degrees(turn):.3g}° at {mass:g} kg"
            for turn, mass in zip(self.turn, self.base_mass, strict=True)
        )
        return (
            f"LevelEnvelope({self.arm.name}: {self.travel:g} m of the tip turn the bus by {turns})"
        )


@of_configuration
def level_envelope(
    start: Configuration,
    tilts: Sequence[float],
    base_masses: Sequence[float],
    *,
    travel: float = 0.1,
    same_density: bool = True,
    directions: int | None = None,
    limits: bool = True,
    progress: Progress | None = None,
) -> LevelEnvelope:
    """Compute how far the tip can go over the mass of the bus and the turn allowed.

    Args:
        start: As in `level_reach`; the mass of its bus is replaced.
        tilts: Largest turns of the spacecraft [rad].
        base_masses: Masses of the spacecraft [kg].
        travel: Length of a straight line of the tip whose turn is computed as well [m].
        same_density: Whether the inertia of the bus grows as mass^(5/3), as that of larger buses
            of one shape and density; else it grows as the mass. The mount stays where it is.
        directions: As in `level_reach`.
        limits: As in `level_reach`.
        progress: Called as progress(done, masses).

    Returns:
        Reach over bus masses and turns, and the turn by lines of the length `travel`.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The task does not fit, or there is momentum.

    Example:
        >>> import spacearm as sa
        >>> start = sa.load("planar2").at([-0.6, 1.4])
        >>> light, heavy = sa.level_envelope(start, [0.02], [30.0, 300.0]).turn
        >>> bool(heavy < 0.1 * light)
        True
    """
    from spacearm.mission.growth import Line, shoot

    travel = positive(travel, "travel", "length [m]")
    masses: Array = np.array([positive(m, "base_masses", "mass [kg]") for m in base_masses])
    angles: Array = np.array([positive(t, "tilts", "angle [rad]") for t in tilts])
    if not (len(masses) and len(angles)):
        raise ConfigurationError("tilts or base_masses is empty; give one value or several")
    arm = start.arm
    bus = arm.model.inertias[1]
    level_start(start)
    shape = (len(masses), len(angles))
    least, mean, volume = np.empty(shape), np.empty(shape), np.empty(shape)
    turn, largest, followed = (np.full(len(masses), np.nan) for _ in range(3))
    for i, mass in enumerate(masses):
        ratio = mass / bus.mass
        inertia = bus.inertia * ratio ** (5.0 / 3.0 if same_density else 1.0)
        heavier = arm.replace(base_mass=float(mass), base_inertia=inertia)
        begin = heavier.at(start.q, base=start.base)
        for j, tilt in enumerate(angles):
            found = level_reach(begin, float(tilt), directions=directions, limits=limits)
            least[i, j], mean[i, j] = found.straight.min(), found.straight.mean()
            volume[i, j] = found.volume
        level = Line(begin.centred(np.zeros(3)), np.pi, 0.0, limits)
        led = shoot(level, found.direction, travel, None)
        arrived = led.ended == 0
        followed[i] = arrived.mean()
        if arrived.any():
            turn[i], largest[i] = np.median(led.tilt[arrived]), led.tilt[arrived].max()
        if progress:
            progress(i + 1, len(masses))
    return LevelEnvelope(
        arm, masses, angles, least, mean, volume, travel, turn, largest, followed, same_density
    )
