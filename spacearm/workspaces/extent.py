"""The least and the largest distance of a chain's tip from the system CM in a box, proven.

Branch and bound over the joints: `kernels.reach` has the bounds of a box.
"""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array
from spacearm.kernels.reach.chain import Chain
from spacearm.kernels.reach.search import lowest
from spacearm.mechanics.compiled import bodies
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.workspaces.box import Box
from spacearm.workspaces.outermost import constant_vectors, largest_distance

NEAR = 1e-5
"""Share of the largest distance up to which a bound comes near to what is attained."""
ROUNDING = 1e-13
"""Share of the length of the arm that rounding adds for each joint."""
MOST = 1_000_000
"""Largest number of boxes."""


def least_distance(arm: SpaceArm, mode: BaseMode, box: Box, known: Array) -> float:
    """Bound the distance of the tip from the system CM in a box, from below [m].

    0 where joints beside the way to the tip matter too.

    Args:
        arm: An arm of revolute joints, none of which mimics another.
        mode: What the spacecraft does.
        box: Range of the joints.
        known: (2,) distances that are attained; the bound need not be nearer to the first than
            `NEAR` times the second [m].
    """
    chain = chain_of(arm, mode)
    if chain is None or known[0] <= 0.0:
        return 0.0
    least = lowest(chain, box.low, box.high, True, float(known[0]), float(NEAR * known[1]), MOST)
    return max(least - _rounding(chain), 0.0)


def largest_distance_within(arm: SpaceArm, mode: BaseMode, box: Box, known: Array) -> float:
    """Bound the distance of the tip from the system CM in a box, from above [m].

    That of the whole torus where joints beside the way to the tip matter too. Arguments as of
    `least_distance`, near the second distance here.
    """
    whole = largest_distance(arm, mode)
    chain = chain_of(arm, mode)
    slack = float(NEAR * known[1])
    if chain is None or not box.limited or whole <= known[1] + slack:
        return whole
    least = lowest(chain, box.low, box.high, False, -float(known[1]), slack, MOST)
    return min(whole, _rounding(chain) - least)


def chain_of(arm: SpaceArm, mode: BaseMode) -> Chain | None:
    """Return the constants of an arm whose joints all lead to the tip, else None."""
    b, tip_body, tip = bodies(arm, mode)
    n = len(b) - 1
    if tip_body != n or any(b[k]["parent"] != k - 1 for k in range(1, n + 1)):
        return None
    E, middle = np.array(b["E"]), n // 2
    own = np.array(constant_vectors(b, tip_body, tip), dtype=np.float64)
    rho = np.zeros(n)
    inner = [E[k].T @ own[k - 1] for k in range(1, middle + 1)]
    rho[:middle] = _radii(inner, [abs(E[k][2, 2]) for k in range(2, middle + 1)])
    outer = list(range(n, middle, -1))
    rho[middle:] = _radii([own[k] for k in outer], [abs(E[k][2, 2]) for k in outer[:-1]])[::-1]
    rho[rho < ROUNDING * np.linalg.norm(own, axis=1).sum()] = 0.0
    return Chain(E, own, rho, middle)


def _radii(vectors: list[Array], cosines: list[float]) -> list[float]:
    """Bound how far from each axis the sum of the vectors so far can be, each in axes of its joint.

    `cosines` are those of the angles between one axis and the next.
    """
    radii, radius, length = [], 0.0, 0.0
    for v, cosine in zip(vectors, (1.0, *cosines), strict=False):
        tilted = radius + np.sqrt(max(1.0 - cosine**2, 0.0)) * length
        radius = float(np.hypot(v[0], v[1]) + min(length, tilted))
        length += float(np.linalg.norm(v))
        radii.append(radius)
    return radii


def _rounding(chain: Chain) -> float:
    """Bound what rounding adds [m]."""
    return ROUNDING * len(chain.rho) * float(np.linalg.norm(chain.b, axis=1).sum())
