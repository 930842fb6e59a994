"""What a quantity of a study is: arrays, their axes, and how a chunk of them is computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from spacearm.arrays import Array
from spacearm.model.arm import SpaceArm
from spacearm.sweeps.tiles import Box, Shape


class Variable(NamedTuple):
    """One array of the result.

    Attributes:
        attrs: What is known of it, its unit first of all.
        dims: Its axes after those of the designs and of the quantity's grid.
        shape: Their lengths.
        dtype: Of its numbers.
    """

    attrs: Mapping[str, str]
    dims: tuple[str, ...] = ()
    shape: Shape = ()
    dtype: str = "float64"


class Quantity(Protocol):
    """One quantity of a study.

    Attributes:
        variables: The arrays that it fills, by name.
        coords: Labels of its axes, with their attributes.
        dims: Its own axes, which chunks divide.
        shape: Their lengths.
        tile: Shape of a chunk along them.
    """

    variables: Mapping[str, Variable]
    coords: Mapping[str, tuple[Array, Mapping[str, Any]]]
    dims: tuple[str, ...] = ()
    shape: Shape = ()
    tile: Shape = ()

    def compute(self, arm: SpaceArm, box: Box, seed: Sequence[int]) -> Mapping[str, Any]:
        """Compute the numbers of one chunk, by variable.

        Args:
            arm: The design.
            box: The part of the quantity's grid.
            seed: Seed of the study and number of the design.
        """
