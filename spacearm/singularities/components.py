"""Connected components of singular sets, and the range of R on each."""

from __future__ import annotations

import operator

import numpy as np

from spacearm.arrays import Array
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.polynomial.level_set import Mesh
from spacearm.polynomial.newton import extreme
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.singularities.abstract_set import Component
from spacearm.singularities.polynomial import distances, radius_squared

TURNS = 24
"""Values of a joint that S does not depend on, from which extremes of R are searched."""


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
    starts = points
    for j in (j for j in range(arm.n) if not S.degrees[j]):
        starts = starts.repeat(TURNS, axis=0)
        starts[:, j] = np.tile(2.0 * np.pi * np.arange(TURNS) / TURNS, len(starts) // TURNS)
    values = R2(starts)
    low, high = (
        extreme(R2, S, starts[pick(values)], better)
        for pick, better in ((np.argmin, operator.lt), (np.argmax, operator.gt))
    )
    at = np.array([low, high])
    return Component(points, distances(arm, at, mode), at)
