"""The singular configuration nearest to a given one, and members of a set about it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.polynomial.jets import Chart, Jets
from spacearm.polynomial.nearest import branch_and_bound, nearest_root
from spacearm.polynomial.triangle import Triangle
from spacearm.polynomial.univariate import wrap
from spacearm.singularities.rank_loss import is_singular

KEPT = 40
"""Nearest members from which a nearer one is sought."""
AROUND = 12
"""Points about the configuration, members or not, from which one is sought too."""
GLOBAL_DIMENSION = 3
"""Up to this many joints the nearest root of one polynomial is proven."""
STARTS, FEW_STARTS = 384, 32
"""Lines about a configuration on which the nearest member is sought: along the joint of the
triangle and along other joints."""


def nearest_singular(
    arm: SpaceArm,
    mode: BaseMode,
    families: Sequence[Sequence[Jets]],
    q: Array,
    about: Callable[[float], Array],
    relevant: Sequence[int],
    limits: bool,
) -> tuple[Array, float]:
    """Find the singular configuration nearest to q.

    Members with free joints anywhere bound the distance; others are then drawn within that
    distance, since no other free joints belong to a nearer one. From the nearest of these, and from
    points that are no members, roots of the minors are found whose distance is stationary.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        families: Minors whose common roots hold the set. Where the columns that the minors of one
            family share are dependent, they have common roots that are no members, and members are
            better found by another family.
        q: (n,) configuration.
        about: Draws members of the set (m, n) with free joints up to a distance from q.
        relevant: Numbers of the joints that the set depends on.
        limits: Whether only configurations within the joint limits count.

    Returns:
        (n,) configuration and its distance [rad], or [rad, m] with sliding joints.

    Raises:
        NoSolutionError: None was found.
    """
    low = arm.lower if limits else np.full(arm.n, -np.inf)
    high = arm.upper if limits else np.full(arm.n, np.inf)
    within = np.clip(q, low, high)
    idle = [j for j in range(arm.n) if j not in relevant]

    def members(distance: float) -> Array:
        found = np.where(arm.slides, M := about(distance), _turned(M, q, low, high))
        found[:, idle] = within[idle]
        return found[((found >= low) & (found <= high)).all(axis=1)]

    far = members(np.inf)
    bound = float(np.linalg.norm(far - q, axis=1).min(initial=np.pi))
    every = np.concatenate((far, members(bound)))
    nearest = np.argsort(np.linalg.norm(every - q, axis=1))[:KEPT]
    rng = np.random.default_rng(1)
    spread = bound * np.linspace(0.0, 1.0, AROUND)[:, None]
    around = np.clip(q + spread * rng.uniform(-1.0, 1.0, (AROUND, arm.n)), low, high)

    def singular(at: Array, closeness: float) -> bool:
        return is_singular(arm, at, mode, tolerance=closeness)

    starts = np.concatenate((every[nearest], around))
    one = len(families[0]) == 1
    found = [
        nearest_root(minors, q, starts, low, high, None if one else singular) for minors in families
    ]
    best = min((x for x in found if x is not None), key=np.linalg.norm, default=None)
    if one and not (limits or arm.slides.any()):
        best = _proven(families[0][0], q, relevant, best)
    if best is None:
        raise NoSolutionError(f"{arm.name}: no singular configuration was found")
    return q + best, float(np.linalg.norm(best))


def _turned(members: Array, q: Array, low: Array, high: Array) -> Array:
    """Move angles (m, n) by whole turns next to q, and then into the limits if they can be."""
    near = q + wrap(members - q)
    up = np.maximum(np.ceil((low - near) / (2.0 * np.pi)), 0.0)
    down = np.maximum(np.ceil((near - high) / (2.0 * np.pi)), 0.0)
    return near + 2.0 * np.pi * (up - down)


def _proven(minor: Jets, q: Array, relevant: Sequence[int], best: Array | None) -> Array | None:
    """Improve an offset from q by branch and bound, if few joints matter."""
    if not 0 < len(relevant) <= GLOBAL_DIMENSION:
        return best
    S, chosen = minor.polynomial, list(relevant)
    others = {j: float(q[j]) for j in range(S.n) if j not in relevant}
    centred = (S.fix(others) if others else S).shifted(q[chosen])
    found = branch_and_bound(centred, None if best is None else best[chosen])
    if found is None:
        return None
    offset = np.zeros(S.n)
    offset[chosen] = found
    return offset


def members(triangle: Triangle, chart: Chart, angles: Array) -> Array:
    """Return the members (r, n) that have the free angles of rows (m, n), of all sheets."""
    sheets = [triangle.solve(angles, sheet=sheet) for sheet in (None, *triangle.sheets)]
    return proper(chart, np.concatenate(sheets))


def proper(chart: Chart, angles: Array) -> Array:
    """Return the positions of angles (m, n), without the second angle of a sliding joint."""
    return chart.positions(angles[(angles[:, chart.slides] >= 0.0).all(axis=1)])


def members_about(triangle: Triangle, chart: Chart, q: Array, distance: float) -> Array:
    """Return members (r, n) whose free joints are up to a distance from q (n,)."""
    rng = np.random.default_rng(0)
    low, high = chart.centre - chart.half, chart.centre + chart.half
    free = [j for j in triangle.relevant if j not in triangle.joints]
    ways = rng.normal(size=(STARTS, len(free)))
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-300)
    lengths = rng.uniform(0.0, 1.0, (STARTS, 1)) ** (1.0 / max(len(free), 1))
    Q = np.tile(q, (STARTS, 1))
    Q[:, free] += min(distance, np.pi) * lengths * ways
    angles = chart.angles(np.where(chart.slides, np.clip(Q, low, high), Q))
    found = [members(triangle, chart, angles)]
    if len(triangle.equations) == 1 and distance < np.inf:  # along other joints one may be nearer
        f = triangle.polynomials[0]
        for j in (j for j in triangle.relevant if j != triangle.joints[0]):
            found.append(proper(chart, Triangle((f,), (j,)).solve(angles[:FEW_STARTS])))
    return np.concatenate(found)
