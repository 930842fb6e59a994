"""Shells of the path dependent workspace of an arm that is known in intervals only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, Result, whole
from spacearm.uncertainty.intervals import UncertainArm
from spacearm.workspaces.path_dependent import workspace


@dataclass(frozen=True, eq=False, repr=False)
class ShellBands(Result):
    """The path dependent workspace over all arms tried.

    Attributes:
        low: (k, 2) inner bound of each shell, its least and largest value [m].
        high: (k, 2) outer bound of each shell, likewise [m].
        always: (a, 2) distances from the system CM that are path dependent for all arms tried [m].
        sometimes: (b, 2) those that are for some [m].
        tried: Number of arms tried.
    """

    low: Array
    high: Array
    always: Array
    sometimes: Array
    tried: int

    def __repr__(self) -> str:
        bands = ", ".join(
            f"{a:.4f}..{b:.4f} to {c:.4f}..{d:.4f} m"
            for (a, b), (c, d) in zip(self.low, self.high, strict=True)
        )
        return f"ShellBands({bands or 'shells of different number'}; {self.tried} arms)"


def shell_bands(uncertain: UncertainArm, *, samples: int = 50, seed: int = 0) -> ShellBands:
    """Compute the bands in which the shells of the path dependent workspace lie.

    Each arm's shells are computed as by `workspace`; the bands are those of the arms tried.

    Args:
        uncertain: An arm with as many revolute joints as its task has rows.
        samples: Number of random arms; the corners of up to 5 parameters are tried besides.
        seed: Of these.

    Returns:
        The bands, and what is path dependent for all arms tried and for some.

    Raises:
        UnsupportedError: The arm has no shells; see `workspace`.

    Example:
        >>> import spacearm as sa
        >>> about = sa.uncertain(sa.load("planar2"), {"link_2": {"mass": 0.1}})
        >>> len(sa.shell_bands(about, samples=1).low)
        2
    """
    shares = uncertain.sample(whole(samples, "samples", 1), np.random.default_rng(seed))
    if len(uncertain.parameters) <= 5:
        shares = np.vstack((shares, uncertain.corners()))
    found = [workspace(uncertain.arm).pdw]
    found += [workspace(uncertain.realise(t)).pdw for t in shares]
    numbers = {len(pdw) for pdw in found}
    bounds: Any = np.array(found) if len(numbers) == 1 else np.zeros((1, 0, 2))
    low = np.stack((bounds[:, :, 0].min(axis=0), bounds[:, :, 0].max(axis=0)), axis=1)
    high = np.stack((bounds[:, :, 1].min(axis=0), bounds[:, :, 1].max(axis=0)), axis=1)
    edges = np.unique(np.concatenate([pdw.ravel() for pdw in found]))
    middles = 0.5 * (edges[:-1] + edges[1:])
    held = np.array([[any(a <= R <= b for a, b in pdw) for R in middles] for pdw in found])
    held = held.reshape(len(found), len(middles))
    return ShellBands(
        low=low,
        high=high,
        always=_runs(edges, np.asarray(held.all(axis=0))),
        sometimes=_runs(edges, np.asarray(held.any(axis=0))),
        tried=len(found),
    )


def _runs(edges: Array, inside: npt.NDArray[np.bool_]) -> Array:
    """Return the ranges (k, 2) of neighbouring intervals that are inside."""
    steps = np.diff(np.concatenate(([0], inside.astype(int), [0])))
    return np.stack((edges[np.flatnonzero(steps == 1)], edges[np.flatnonzero(steps == -1)]), axis=1)
