"""What is certified about each range of a workspace.

Three quantities decide it, each compared with what counts as certified: by how much the reachable
distances may be wider than those that are attained, by how much a singular posture may lie outside
the path dependent ranges, and how wide the parts of these ranges are at which no posture is proven
to be singular.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np

from spacearm.arrays import Array, named

Bounds = Literal["certified", "lower bound", "upper bound", "estimate", "sampled"]

#: What each word says, for a reader of the printed form.
MEANING: dict[Bounds, str] = {
    "certified": "both ends are certified, up to the error",
    "lower bound": "each distance of the range is attained; the true range may be wider",
    "upper bound": "found by search; no distance beyond the range, the true one may be narrower",
    "estimate": "found by search; the true range may be wider or narrower",
    "sampled": "from singular postures that a search found; it may have missed others",
}


class RangeStatement(NamedTuple):
    """What is certified about one range of distances.

    Attributes:
        workspace: "reachable", "path dependent" or "path independent".
        radius: (2,) the range [m]; (0,) if the workspace is empty.
        bounds: "certified": both ends, up to `error`. "lower bound": each distance of the range
            belongs to the workspace, others may too. "upper bound": no other distance does.
            "estimate": found by search, neither is certified. "sampled": from samples.
        error: Largest distance by which an end may be off, or a part inside may not belong [m]; NaN
            if unknown.
    """

    workspace: Literal["reachable", "path dependent", "path independent"]
    radius: Array
    bounds: Bounds
    error: float

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return named(self)


def statements(
    reachable: Array,
    pdw: Array,
    piw: Array,
    *,
    beyond: float,
    outside: float,
    uncovered: Array,
    certified: float,
    sampled: bool = False,
) -> tuple[RangeStatement, ...]:
    """State what is certified about each range.

    Args:
        reachable: (1, 2) reachable distances, attained at both ends [m].
        pdw: (k, 2) path dependent distances [m].
        piw: (l, 2) path independent distances [m].
        beyond: By how much reachable distances may lie outside of `reachable` [m].
        outside: By how much the distance of a singular posture may lie outside of `pdw` [m].
        uncovered: (k,) width of the widest part of each range of `pdw` at which no posture is
            proven to be singular [m].
        certified: Errors up to this count as certified [m].
        sampled: Whether `pdw` is sampled.
    """

    def of_one(complete: bool, attained: bool) -> Bounds:
        if sampled:
            return "sampled"
        if complete and attained:
            return "certified"
        if attained:
            return "lower bound"
        return "upper bound" if complete else "estimate"

    def radii(ranges: Array) -> list[Array]:
        return list(ranges) or [np.empty(0)]

    widest = float(np.max(uncovered, initial=0.0))
    complete = outside <= certified
    reached: Bounds = "certified" if beyond <= certified else "lower bound"
    found = [RangeStatement("reachable", r, reached, beyond) for r in radii(reachable)]
    for i, radius in enumerate(radii(pdw)):
        own = float(uncovered[i]) if len(pdw) else 0.0
        bounds = of_one(complete, own <= certified)
        found.append(RangeStatement("path dependent", radius, bounds, max(outside, own)))
    for radius in radii(piw):
        bounds = of_one(widest <= certified and beyond <= certified, complete)
        error = max(outside, widest, beyond)
        found.append(RangeStatement("path independent", radius, bounds, error))
    return tuple(found)
