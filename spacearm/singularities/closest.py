"""The singular configuration nearest to a given one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.polynomial.jets import Jets
from spacearm.polynomial.nearest import branch_and_bound, nearest_root
from spacearm.polynomial.univariate import wrap
from spacearm.singularities.rank_loss import is_singular

KEPT = 40
"""Nearest members from which a nearer one is sought."""
AROUND = 16
"""Points about the configuration, members or not, from which one is sought too."""
GLOBAL_DIMENSION = 3
"""Up to this many joints the nearest root of one polynomial is proven."""


def nearest_singular(
    arm: SpaceArm,
    mode: BaseMode,
    minors: Sequence[Jets],
    q: Array,
    members: Array,
    relevant: Sequence[int],
    limits: bool,
) -> tuple[Array, float]:
    """Find the singular configuration nearest to q.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        minors: Minors whose common roots are the set.
        q: (n,) configuration.
        members: (m, n) members of the set from which the search starts.
        relevant: Numbers of the joints that the set depends on.
        limits: Whether only configurations within the joint limits count.

    Returns:
        (n,) configuration and its distance [rad], or [rad, m] with sliding joints.

    Raises:
        NoSolutionError: None was found.
    """
    low = arm.lower if limits else np.full(arm.n, -np.inf)
    high = arm.upper if limits else np.full(arm.n, np.inf)
    idle = [j for j in range(arm.n) if j not in relevant]
    rng = np.random.default_rng(1)
    spread = np.append(0.0, np.geomspace(0.05, 2.0, AROUND - 1))[:, None]
    around = np.clip(q + spread * rng.uniform(-1.0, 1.0, (AROUND, arm.n)), low, high)
    if limits:
        turns = np.ceil((low - members) / (2.0 * np.pi))
        turned = ~arm.slides & np.isfinite(turns)
        members = np.where(turned, members + 2.0 * np.pi * np.where(turned, turns, 0.0), members)
        members[:, idle] = np.clip(q, low, high)[idle]
        members = members[((members >= low) & (members <= high)).all(axis=1)]
    else:
        members = np.where(arm.slides, members, q + wrap(members - q))
        members[:, idle] = q[idle]
    nearest = np.argsort(np.linalg.norm(members - q, axis=1))[:KEPT]
    starts = np.concatenate((members[nearest], around))

    def singular(at: Array) -> bool:
        return len(minors) == 1 or is_singular(arm, at, mode)

    best = nearest_root(minors, q, starts, low, high, singular)
    if len(minors) == 1 and not (limits or arm.slides.any()):
        best = _proven(minors[0], q, relevant, best)
    if best is None:
        raise NoSolutionError(f"{arm.name}: no singular configuration was found")
    return q + best, float(np.linalg.norm(best))


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
