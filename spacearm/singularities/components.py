"""Connected components of singular sets, and the range of R on each."""

from __future__ import annotations

import numpy as np

from spacearm.arrays import Array
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.polynomial.level_set import Mesh
from spacearm.polynomial.newton import bounded_extreme
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.singularities.abstract_set import Component
from spacearm.singularities.polynomial import distances, radius_squared

TURNS = 96
"""Values of a joint that S does not depend on, from which extremes of R are searched."""
STARTS, APART = 4, 0.5
"""Number of points from which each is then searched, the best ones so far apart [rad]; on curves,
whose points lie close together, one does."""


def connected(mesh: Mesh) -> list[Array]:
    """Return the vertices (m, 3) of each connected piece of a mesh."""
    from scipy.sparse import csr_array  # slow to import
    from scipy.sparse.csgraph import connected_components

    edges = (mesh.triangles[:, [0, 1, 2]].ravel(), mesh.triangles[:, [1, 2, 0]].ravel())
    m = len(mesh.vertices)
    graph = csr_array((np.ones(len(edges[0])), edges), shape=(m, m))
    number, labels = connected_components(graph, directed=False)
    return [mesh.vertices[labels == i] for i in range(number)]


def component(arm: SpaceArm, mode: BaseMode, S: TrigPolynomial, points: Array) -> Component:
    """Find the range of R over points (m, n) of a component and over joints that do not matter."""
    R2 = radius_squared(arm, mode=mode)
    starts, free = points, [j for j in range(arm.n) if not S.degrees[j]]
    for j in free:
        starts = starts.repeat(TURNS, axis=0)
        starts[:, j] = np.tile(2.0 * np.pi * np.arange(TURNS) / TURNS, len(starts) // TURNS)
    order, count = np.argsort(R2(starts)), STARTS if arm.n > 2 else 1
    low = _best(R2, S, starts[order], 1.0, count)
    high = _best(R2, S, starts[order[::-1]], -1.0, count)
    at = np.array([low, high])
    return Component(points, distances(arm, at, mode), at)


def _best(F: TrigPolynomial, S: TrigPolynomial, starts: Array, sign: float, count: int) -> Array:
    """Return the configuration with the least sign * F on S = 0 near some starts, best first."""
    best = starts[0]
    for _ in range(count):
        found = bounded_extreme(F, (S,), starts[0], sign)
        if sign * F(found) < sign * F(best):
            best = found
        if count > 1:
            turn = np.abs(np.angle(np.exp(1j * (starts - starts[0]))))
            starts = starts[turn.max(axis=1) > APART]
        if not len(starts):
            break
    return best
