"""Shells of larger arms: from a sample of singular configurations, each bound then optimised."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spacearm.arrays import Array
from spacearm.mechanics.blocks import Progress
from spacearm.singularities.exact_set import ExactSet
from spacearm.singularities.polynomial import distances, radius_squared
from spacearm.workspaces.box import Box
from spacearm.workspaces.shells import STARTS, Shell, shell_about

GAP_SHARE = 1 / 300
"""Share of the range of R, empty of a large sample, that separates two shells."""
AT_AN_END = 1e-7
"""Share of the scale of S below which an end of the reachable workspace is singular."""
BATCH = 4096
"""Lines that are drawn at a time."""
NEGLIGIBLE = 1e-9
"""Distance by which a piece may stand out of a shell that counts as holding it [m]."""


class Searches:
    """The searches for bounds, two times `STARTS` a shell, counted for whoever waits.

    Attributes:
        done: Number of searches done.
        total: Number of searches, as far as it is known.

    Args:
        progress: Called as progress(done, total) before each of them.
    """

    def __init__(self, progress: Progress | None) -> None:
        self.done, self.total, self._progress = 0, 4 * STARTS, progress

    def expect(self, shells: int) -> None:
        """Take note of how many shells are left."""
        self.total = self.done + 2 * STARTS * shells

    def step(self) -> None:
        """Report one more search."""
        if self._progress:
            self._progress(min(self.done, self.total), self.total)
        self.done += 1


def found_shells(
    found: ExactSet,
    box: Box,
    effort: int,
    rng: np.random.Generator,
    ends: Array,
    searches: Searches,
    keep: Callable[[list[Shell]], object],
) -> list[Shell]:
    """Find shells from a sample of `effort` singular configurations, each bound then optimised.

    Where R is stationary the tip has lost the direction of R: the `ends` (2, n) of the reachable
    workspace are singular, unless limits or R = 0 make them regular, and belong to the first and
    the last piece of the sample. A sample that is sparse falls into more pieces than there are
    shells: those that lie within the shell of a larger one are not searched.

    `keep` is given the shells as they are known so far, at first those of the sample.
    """
    R2, equations = radius_squared(found.arm, mode=found.mode), found.triangle.equations
    low, high = distances(found.arm, ends, found.mode)
    within = (float(low), float(high))
    values = [np.abs(f(ends)) / f.scale for f in equations]
    stationary = ends[np.max(values, axis=0) <= AT_AN_END]
    Q = members(found, box, effort, rng)
    if not len(Q):
        return []
    Q = Q[np.argsort(R2(Q))]
    R = np.sqrt(np.maximum(R2(Q), 0.0))
    parted = np.flatnonzero(np.diff(R) > GAP_SHARE * (R[-1] - R[0]) + 1e-9) + 1
    pieces = np.split(Q, parted)
    for end in stationary:
        i = 0 if R2(end[None])[0] < R2(Q[:1])[0] else -1
        pieces[i] = np.vstack((pieces[i], end))
    sampled = [_sampled(piece, R2(piece), i) for i, piece in enumerate(pieces)]
    shells: list[Shell] = []
    left = sorted(sampled, key=lambda shell: -len(pieces[shell.component]))
    while left:
        keep([*shells, *left])
        searches.expect(len(left))
        i = left[0].component
        shells.append(
            shell_about(
                found.arm,
                found.mode,
                equations,
                pieces[i],
                box,
                i,
                step=searches.step,
                within=within,
                counts=lambda q: bool(found.are_singular(q[None])[0]),
            )
        )
        left = [part for part in left[1:] if not _holds(shells[-1], part)]
    return shells


def members(found: ExactSet, box: Box, m: int, rng: np.random.Generator) -> Array:
    """Return some of the singular configurations in the box, (r, n): of m in all, or on m lines.

    Within limits the joints that do not follow from others are drawn there: of the whole torus a
    box of six joints may be a millionth.
    """
    kept, lines, met = [np.empty((0, found.arm.n))], 0, 0
    while lines < m and met < m:
        drawn = rng.uniform(box.low, box.high, (min(BATCH, m - lines), found.arm.n))
        Q = box.fold(found.having(drawn))
        kept.append(Q[box.holds(Q)])
        lines, met = lines + len(drawn), met + len(Q)
    return np.concatenate(kept)


def _sampled(Q: Array, R2: Array, number: int) -> Shell:
    """Return the shell of a piece as far as its sample (m, n), with squared distances, reaches."""
    at = [int(R2.argmin()), int(R2.argmax())]
    return Shell(np.sqrt(np.maximum(R2[at], 0.0)), Q[at], number)


def _holds(shell: Shell, part: Shell) -> bool:
    """Tell whether one shell holds another."""
    low, high = shell.radius
    return bool(low - NEGLIGIBLE <= part.radius[0] and part.radius[1] <= high + NEGLIGIBLE)
