"""Arms whose masses, inertias and centres of mass are known in intervals, or as distributions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, finite, generator, number_of, shape_of, whole
from spacearm.description.bodies import Inertial
from spacearm.errors import ConfigurationError, require_known
from spacearm.model.arguments import FLOATING
from spacearm.model.arm import SpaceArm
from spacearm.processes import check_memory
from spacearm.results import Described, Description, Table
from spacearm.signatures import checked, shown
from spacearm.singularities.immaterial_masses import immaterial_links

KINDS = ("mass", "inertia", "com")
#: Probability beyond each end of the interval of a distribution: three standard deviations.
TAIL = 0.00135
#: What is uncertain of a link, by kind; see `uncertain`.
Spread: TypeAlias = Mapping[str, Any]


class Parameter(NamedTuple):
    """A number that is known in an interval, or as a distribution.

    Attributes:
        link: Name of the link.
        kind: "mass" [kg], "inertia" (factor) or "com x", "com y", "com z" (shift [m]).
        low: Least value.
        high: Largest value.
        law: The distribution, as scipy.stats has it; None where any value is as likely. Its
            interval holds all but 0.135 per cent at each end.
    """

    link: str
    kind: str
    low: float
    high: float
    law: Any = None

    @property
    def name(self) -> str:
        """Link and kind in one word or two."""
        return f"{self.kind} of {self.link}"


@checked
@dataclass(frozen=True, eq=False, repr=False)
class UncertainArm(Described):
    """An arm whose masses, inertias and centres of mass are known in intervals only.

    Made by `uncertain`. The inertia of a link grows with its mass in proportion, and with
    its own factor besides.

    Attributes:
        arm: The arm as described.
        parameters: The numbers that are uncertain; any combination of values is possible.
    """

    arm: SpaceArm
    parameters: tuple[Parameter, ...]

    def realise(self, shares: ArrayLike) -> SpaceArm:
        """Return the arm with values from the intervals.

        Args:
            shares: (p,) where in its interval each parameter lies, from 0 (least) to 1 (largest).

        Raises:
            ConfigurationError: They are not p numbers from 0 to 1.
        """
        p = len(self.parameters)
        at = finite(shares, (p,), "shares", "from 0 to 1, one for each parameter")
        if (at < 0.0).any() or (at > 1.0).any():
            raise ConfigurationError(f"shares is {at.tolist()}; give numbers from 0 to 1")
        links = dict(self.arm.whole.links)
        for parameter, value in zip(self.parameters, self.values(at), strict=True):
            part = links[parameter.link]
            if part is not None:  # `uncertain` has seen to it
                links[parameter.link] = _changed(part, parameter.kind, float(value))
        whole = replace(self.arm.whole, links=links)
        return self.arm.on(whole)

    def relevant(self) -> UncertainArm:
        """Return the same without the numbers on which no singular configuration depends.

        These are all of the links that move as one body with the tip, where the task has all rows
        of the tip's twist (`SingularSet.any_mass`). They stay as described. In the plane they are
        left out only if no value of any number makes the arm leave its plane.
        """
        links = immaterial_links(self.arm, FLOATING)
        if links and len({i % 6 for i in self.arm.task.indices}) < 6:
            p = len(self.parameters)
            ends = np.full((2, p, p), 0.5)
            ends[:, range(p), range(p)] = [[0.0], [1.0]]
            if not all(immaterial_links(self.realise(t), FLOATING) for t in ends.reshape(-1, p)):
                return self
        return replace(self, parameters=tuple(p for p in self.parameters if p.link not in links))

    def beside(self, other: UncertainArm) -> tuple[str, ...]:
        """Return the names of the numbers that are uncertain here and not in another."""
        return tuple(p.name for p in self.parameters if p not in other.parameters)

    def values(self, shares: Array) -> Array:
        """Return the values (..., p) at shares (..., p) of the intervals."""
        low = np.array([parameter.low for parameter in self.parameters])
        high = np.array([parameter.high for parameter in self.parameters])
        return np.asarray(low + (high - low) * shares)

    def named(self, shares: Array) -> dict[str, float]:
        """Return the values at shares by name.

        Args:
            shares: (p,) of the intervals, from 0 to 1.

        Raises:
            ConfigurationError: There is not one for each parameter.
        """
        values = self.values(finite(shares, (len(self.parameters),), "shares")).tolist()
        names = [parameter.name for parameter in self.parameters]
        return dict(zip(names, values, strict=True))

    def corners(self) -> Array:
        """Return the corners (2^p, p) of the box of all values, as shares."""
        return np.array(list(product((0.0, 1.0), repeat=len(self.parameters))))

    def sample(self, m: int, rng: np.random.Generator) -> Array:
        """Return random shares (m, p), uniform where there is no distribution."""
        shape = (whole(m, "m", 0), len(self.parameters))
        need = 3 * 8.0 * math.prod(shape)  # the shares, those beside the corners, and the values
        what = f"{shape[0]:,} samples of {shape[1]:,} uncertain parameters"
        check_memory(need, what, "use fewer samples")
        shares = rng.uniform(size=shape)
        for column, p in zip(shares.T, self.parameters, strict=True):
            if p.law is not None:
                values = p.law.ppf(TAIL + (1.0 - 2.0 * TAIL) * column)
                column[:] = np.clip((values - p.low) / (p.high - p.low), 0.0, 1.0)
        return shares

    def tried(self, samples: int, seed: int, corners: int) -> Array:
        """Return random shares, and all corners where there are at most so many parameters."""
        shares = self.sample(whole(samples, "samples", 1), generator(seed))
        few = len(self.parameters) <= corners
        return np.vstack((shares, self.corners())) if few else shares

    def to_dict(self) -> dict[str, Any]:
        """Return the arm's name and the intervals by name as plain JSON data."""
        return {
            "arm": self.arm.name,
            "parameters": {p.name: [float(p.low), float(p.high)] for p in self.parameters},
        }

    def describe(self) -> Description:
        """Describe the intervals."""
        parts = ", ".join(f"{p.name} {p.low:.4g} to {p.high:.4g}" for p in self.parameters)
        rows = [
            (p.name, p.low, p.high, "an interval" if p.law is None else "a distribution")
            for p in self.parameters
        ]
        columns = ("number [kg], [m] or a factor", "from", "to", "known as")
        return Description(title=self.arm.name, verdict=parts, tables=[Table(columns, rows)])


@checked
def uncertain(arm: SpaceArm, spread: Mapping[str, Spread]) -> UncertainArm:
    """Return an arm whose masses, inertias and centres of mass are known in intervals only.

    Args:
        arm: The arm as described; hold a captured target first, by `SpaceArm.grasp`.
        spread: What is uncertain, by link, such as {"link_2":{"mass":0.05}}. "mass" and "inertia"
            are a share up or down (0.05 is 5 per cent) or a pair of bounds ([kg], factors of the
            inertia). "com" is a distance up or down each axis of the link [m], or three of them.

    Returns:
        The arm with its uncertain numbers.

    Raises:
        ConfigurationError: Nothing is uncertain, or a kind or an interval makes no sense.
        ModelError: A link does not exist or has no mass.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> sa.uncertain(arm, {"link_2": {"mass": 0.1}})
        UncertainArm(planar2: mass of link_2 2.7 to 3.3)
    """
    found = []
    for link, kinds in spread.items():
        part = arm.whole.with_a_mass(link)
        for kind, value in kinds.items():
            require_known("kind", kind, KINDS, f"{link}: ")
            if kind == "com":
                found += _shifts(value, link)
            elif hasattr(value, "ppf"):
                found.append(_distributed(value, kind, link))
            else:
                about = part.mass if kind == "mass" else 1.0
                found.append(Parameter(link, kind, *_interval(value, about, kind, link)))
    if not found:
        raise ConfigurationError("nothing is uncertain; give, for instance, {link: {'mass': 0.05}}")
    return UncertainArm(arm, tuple(found))


def _shifts(value: Any, link: str) -> list[Parameter]:
    """Return the shifts of a CM along the axes."""
    parts = value if np.iterable(value) else [value] * 3
    laws = [hasattr(part, "ppf") for part in parts]
    numbers = [0.0 if law else part for part, law in zip(parts, laws, strict=True)]
    sizes = np.abs(finite(numbers, (3,), f"com of {link}", "[m], or distributions"))
    return [
        _distributed(part, f"com {axis}", link)
        if law
        else Parameter(link, f"com {axis}", -float(size), float(size))
        for axis, part, law, size in zip("xyz", parts, laws, sizes, strict=True)
        if law or size
    ]


def _distributed(law: Any, kind: str, link: str) -> Parameter:
    """Return a parameter with a distribution.

    Raises:
        ConfigurationError: It has no interval, or one with masses or factors that are not positive.
    """
    low, high = (float(law.ppf(p)) for p in (TAIL, 1.0 - TAIL))
    least = -np.inf if kind.startswith("com") else 0.0
    if not (np.isfinite([low, high]).all() and least < low < high):
        raise ConfigurationError(
            f"{kind} of {link} has a distribution from {low:.4g} to {high:.4g}; give one of "
            "scipy.stats whose interval is finite and, but for shifts, positive"
        )
    return Parameter(link, kind, low, high, law)


def _interval(value: object, about: float, kind: str, link: str) -> tuple[float, float]:
    """Return the bounds of a mass [kg] or of a factor of the inertia."""
    share = number_of(value)
    if 0.0 < share < 1.0:
        return about * (1.0 - share), about * (1.0 + share)
    if shape_of(value) == (2,):
        low, high = finite(value, (2,), f"{kind} of {link}")
        if 0.0 < low < high:
            return float(low), float(high)
    raise ConfigurationError(
        f"{kind} of {link} is {shown(value)}; give a share between 0 and 1, or a pair of positive, "
        "increasing bounds"
    )


def _changed(part: Inertial, kind: str, value: float) -> Inertial:
    """Return a link with another mass [kg], a factor of its inertia or a shift of its CM [m]."""
    if kind == "mass":
        return Inertial(value, part.origin, part.inertia * (value / part.mass))
    if kind == "inertia":
        return part._replace(inertia=part.inertia * value)
    shift = value * np.eye(3)["xyz".index(kind[-1])]
    return part._replace(origin=pin.SE3(part.origin.rotation, part.origin.translation + shift))
