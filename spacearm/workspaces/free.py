"""The free workspace of Vafa & Dubowsky: points that the tip reaches at every spacecraft attitude.

In spacecraft axes the tip stands at p(q) from the system CM, p a trigonometric polynomial of degree
one in each joint. A point at distance R from the CM is reached at every attitude if the whole
sphere of radius R (for planar arms the circle) is in the image of p. This can change with R only
where a critical value of p has an extreme distance, so one test decides between these radii.
"""

from __future__ import annotations

import numpy as np
import scipy

from spacearm.arrays import Array, Booleans
from spacearm.mechanics.batch import tips_from_centre
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.frames import evenly_spread
from spacearm.polynomial.newton import shortened
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.singularities.polynomials import fitting
from spacearm.singularities.sets import singular_set
from spacearm.workspaces.extent import Box
from spacearm.workspaces.shells import merged

#: Configurations from which the search for a point starts.
SAMPLE = 20_000
#: Test points on a circle or sphere.
DIRECTIONS = {2: 720, 3: 500}
#: Number of test points, those farthest from the sample, that are tried first.
HARDEST = 24
#: Starts for each point: the configurations with the nearest tips.
NEIGHBOURS = 6
#: Newton steps from each start.
STEPS = 30
#: Longest Newton step [rad].
STRIDE = 0.3
#: Largest miss of a reached point, as a share of the largest distance.
REACHED = 1e-9
#: Number of radii tried where no critical radii are known.
SCAN = 48
#: Accuracy of the bounds between them, as a share of the largest radius.
SHARPNESS = 1e-4


def free_workspace(arm: SpaceArm, mode: BaseMode, limits: bool, reachable: Array) -> Array:
    """Compute the radii (k, 2) of the free workspace within the reachable ones (2,) [m]."""
    box = Box.of(arm.lower, arm.upper, limits)
    reach = Reach(arm, mode, box, np.random.default_rng(0))
    low, high = (float(R) for R in reachable)
    critical = None
    if arm.n == len(reach.rows) and not box.limited:
        rows = " ".join("xyz"[i] for i in reach.rows)
        held: BaseMode = "fixed" if mode == "fixed" else "attitude-controlled"
        found = singular_set(arm.replace(task=rows), mode=held)
        if found.complete:
            critical = [float(R) for piece in found.components() for R in piece.radius]
    return free_radii(reach, low, high, critical)


class Reach:
    """Test of which points, in spacecraft axes from the system CM, the tip can reach.

    Args:
        arm: The arm.
        mode: What the spacecraft does; for a fixed one points are relative to its own CM.
        box: Range of the joints.
        rng: Random numbers for the sample.
    """

    def __init__(self, arm: SpaceArm, mode: BaseMode, box: Box, rng: np.random.Generator) -> None:

        normal = arm.tree.plane_normal()
        self.rows = [i for i in range(3) if i != normal]
        with fitting(arm, "the position of the tip from the system CM"):
            self.p = TrigPolynomial.fit_each(
                lambda Q: tips_from_centre(arm, Q, mode)[:, self.rows], arm.n
            )
        self.box = box
        self.Q = rng.uniform(box.low, box.high, (SAMPLE, arm.n))
        self.tips = self._position(self.Q)
        self.tree = scipy.spatial.KDTree(self.tips)
        self.size = float(np.linalg.norm(self.tips, axis=1).max())
        self.directions = _directions(len(self.rows))

    def everywhere(self, R: float) -> bool:
        """Check whether all points at distance R can be reached."""
        targets = R * self.directions
        order = np.argsort(self.tree.query(targets)[0])[::-1]
        hardest, others = targets[order[:HARDEST]], targets[order[HARDEST:]]
        return bool(self.reached(hardest).all() and self.reached(others).all())

    def reached(self, targets: Array) -> Booleans:
        """Check which points (m, d) can be reached, by Newton's method from near tips."""
        found = np.zeros(len(targets), dtype=bool)
        _, near = self.tree.query(targets, k=NEIGHBOURS)
        for column in np.asarray(near).T:
            left = np.flatnonzero(~found)
            if not len(left):
                break
            found[left] = self._solve(targets[left], self.Q[column[left]])
        return found

    def _solve(self, targets: Array, Q: Array) -> Booleans:
        """Check which points (m, d) are reached from configurations Q (m, n)."""
        for _ in range(STEPS):
            miss = targets - self._position(Q)
            J = np.stack([p.gradient(Q) for p in self.p], axis=1)
            damped = J @ J.swapaxes(1, 2) + 1e-12 * self.size**2 * np.eye(len(self.rows))
            step = np.einsum("mij,mi->mj", J, np.linalg.solve(damped, miss[..., None])[..., 0])
            Q = Q + shortened(step, STRIDE)
            if self.box.limited:
                Q = np.clip(Q, self.box.low, self.box.high)
        return np.linalg.norm(targets - self._position(Q), axis=1) <= REACHED * self.size

    def _position(self, Q: Array) -> Array:
        """Evaluate the tip (m, d) at configurations (m, n)."""
        return np.stack([p(Q) for p in self.p], axis=1)


def free_radii(reach: Reach, low: float, high: float, critical: list[float] | None) -> Array:
    """Find the intervals of radius (k, 2) at which every point can be reached [m].

    Args:
        reach: The test.
        low: Least distance of the tip from the system CM [m].
        high: Largest.
        critical: Radii at which alone the answer may change; None if they are not known, for arms
            with more joints than the position has components: the bounds are then found by
            bisection.
    """
    edges: Array
    if critical is None:
        edges = np.linspace(low, high, SCAN + 1)
    else:
        inside = [R for R in critical if low < R < high]
        edges = np.unique([low, *inside, high])
    middles = 0.5 * (edges[:-1] + edges[1:])
    free = [reach.everywhere(float(R)) for R in middles]
    if critical is None:
        edges = _sharpened(reach, edges, middles, free, SHARPNESS * high)
    spans = np.stack((edges[:-1], edges[1:]), axis=1)
    return merged(list(spans[free]))


def _sharpened(reach: Reach, edges: Array, middles: Array, free: list[bool], width: float) -> Array:
    """Move the edges between free and other spans to where the answer changes, by bisection."""
    edges = np.array(edges, dtype=np.float64)
    for i in range(1, len(free)):
        if free[i] != free[i - 1]:
            low, high = middles[i - 1], middles[i]
            while high - low > width:
                R = 0.5 * (low + high)
                low, high = (R, high) if reach.everywhere(R) == free[i - 1] else (low, R)
            edges[i] = low if free[i - 1] else high
    return edges


def _directions(dimension: int) -> Array:
    """Return directions (m, d), evenly spread on the circle or the sphere."""
    m = DIRECTIONS[dimension]
    if dimension == 3:
        return evenly_spread(m)
    angle = 2.0 * np.pi * (np.arange(m) + 0.5) / m
    return np.stack((np.cos(angle), np.sin(angle)), axis=1)
