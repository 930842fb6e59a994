"""Curves of common roots: of one polynomial of two angles, or of two polynomials of three.

The surface f = 0 is triangulated (`surface`); where g changes its sign along an edge of a triangle,
a curve crosses that edge. Crossings are moved onto both roots and joined, triangle by triangle.
Loops of the curve smaller than a triangle may be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.polynomial.jets import Chart, Jets
from spacearm.polynomial.level_set import lines, surface
from spacearm.polynomial.newton import shortened
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.univariate import wrap

Booleans = npt.NDArray[np.bool_]

STEPS = 30
"""Largest number of Gauss-Newton steps onto the curve."""
STRIDE = 0.05
"""Longest of them [rad]."""


def curves(
    polynomials: Sequence[TrigPolynomial],
    counts: Callable[[Array], Booleans],
    resolution: float = 0.0,
) -> list[Array]:
    """Trace the common roots.

    Args:
        polynomials: One or two.
        counts: Says which of the common roots (m, 3) of two polynomials count, (m,).
        resolution: Grids need not be finer than this [rad].

    Returns:
        Polylines (m, 2) or (m, 3), angles continuous along each.
    """
    if len(polynomials) == 1:
        return lines(polynomials[0], resolution)
    f, g = polynomials
    mesh = surface(f, resolution)
    if not len(mesh.triangles):
        return []
    positive = g(mesh.vertices) > 0.0
    edges = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    crossed = positive[edges[..., 0]] != positive[edges[..., 1]]
    cut = crossed.any(axis=1)  # two edges of each such triangle are crossed
    pairs = edges[cut][crossed[cut]]
    unique, number = np.unique(pairs, axis=0, return_inverse=True)
    ends = mesh.vertices[unique]
    middle = ends[:, 0] + 0.5 * wrap(ends[:, 1] - ends[:, 0])
    points = onto(polynomials, middle)
    links = number.reshape(-1, 2)
    links = links[counts(points)[links].all(axis=1)]
    return [_continuous(points[chain]) for chain in _chains(links)]


def onto(polynomials: Sequence[TrigPolynomial], points: Array) -> Array:
    """Move points (m, n) onto the common roots by the Gauss-Newton method."""
    turning = Chart.turning(points.shape[1])
    scaled = [Jets.of(f, turning) for f in polynomials]
    for _ in range(STEPS):
        jets = [f(points, 1) for f in scaled]
        values = np.stack([jet.value for jet in jets], axis=1)
        G = np.stack([jet.gradient for jet in jets], axis=1)
        step = -(np.linalg.pinv(G, rcond=1e-9) @ values[:, :, None])[:, :, 0]
        points = points + shortened(step, STRIDE)
        if np.abs(step).max(initial=0.0) < 1e-14:
            break
    return points


def _chains(links: npt.NDArray[np.intp]) -> list[list[int]]:
    """Join pairs of numbers to chains; a closed one ends where it begins."""
    neighbours: dict[int, list[int]] = {}
    for a, b in links.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    chains = []
    ends_first = sorted(neighbours, key=lambda i: len(neighbours[i]))
    for start in ends_first:
        chain = [start]
        while neighbours[chain[-1]]:
            here = chain[-1]
            after = neighbours[here].pop()
            neighbours[after].remove(here)
            chain.append(after)
        if len(chain) > 1:
            chains.append(chain)
    return chains


def _continuous(points: Array) -> Array:
    """Remove whole turns between neighbours."""
    steps = wrap(np.diff(points, axis=0))
    return np.concatenate((points[:1], points[0] + np.cumsum(steps, axis=0)))
