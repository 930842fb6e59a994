"""Proof that curves run in the common roots of polynomials, along chains of points on them.

Between two points some joints y, as many as there are polynomials f, follow from the others z,
which move straight. Let m be the middle of the segment and A the inverse of df/dy there. Wherever z
is on the segment, the map y -> y - A f(z, y) takes a box about the straight line into itself if

    |A f| + |1 - A df/dy| rho < rho

there, rho the half width of the box, and contracts it: the box holds one root, which moves
continuously with z. The second derivatives at m, and bounds of the third everywhere, give both
terms. At the ends of
the segment the root is within |A f| / (1 - |1 - A df/dy|) of the chain. The bounds hold with z off
by more than that, so that the curves of neighbours that solve for different joints are connected.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.polynomial.jets import Jets
from spacearm.polynomial.trig import EPS, TrigPolynomial
from spacearm.polynomial.univariate import orders
from spacearm.workspaces.box import Box

ILL = 1e10
"""Condition of df/dy above which no proof is tried."""
CONTRACTS = 0.49
"""Largest |1 - A df/dy|; rho is at least twice |A f|."""
AT_LIMIT = 1e-7
"""Distance from a limit below which a joint is not solved for [rad]."""
SHORTEST = 1e-5
"""Segments shorter than this are not halved [rad]."""
MOST = 20_000
"""Largest number of segments of a chain."""
POLISH = 20
"""Newton steps by which the middle of a segment is moved to a root."""

CONVERGED = 1e-14
"""Values below which they end: less than rounding."""

Booleans = npt.NDArray[np.bool_]


class Equations:
    """Polynomials of scale 1 whose common roots count, within a box.

    Args:
        polynomials: The polynomials.
        box: Range of the joints.
    """

    def __init__(self, polynomials: Sequence[Jets], box: Box) -> None:
        whole = box.high - box.low >= 2.0 * np.pi
        self.low = np.where(whole, -np.inf, box.low)
        self.high = np.where(whole, np.inf, box.high)
        self.polynomials = polynomials
        self.third = np.array([_third(f.polynomial) for f in polynomials])
        self.degrees = np.array([max((1, *f.polynomial.degrees)) for f in polynomials])

    def __call__(self, Q: Array) -> tuple[Array, Array]:
        """Compute values (m, c) and derivatives (m, c, n) at Q (m, n)."""
        jets = [f(Q, 1) for f in self.polynomials]
        values = np.stack([jet.value for jet in jets], axis=1)
        return values, np.stack([jet.gradient for jet in jets], axis=1)

    def derivatives(self, Q: Array) -> tuple[Array, Array]:
        """Compute first (m, c, n) and second derivatives (m, c, n, n) at Q (m, n)."""
        jets = [f(Q, 2) for f in self.polynomials]
        first = np.stack([jet.gradient for jet in jets], axis=1)
        return first, np.stack([jet.hessian for jet in jets], axis=1)

    def values(self, Q: Array) -> Array:
        """Compute values (m, c) at Q (m, n)."""
        return np.stack([f(Q).value for f in self.polynomials], axis=1)

    def noise(self, largest: float) -> Array:
        """Bound the errors of values (c,) at angles up to `largest` [rad]."""
        return np.array([f.noise(largest) for f in self.polynomials])

    def free(self, Q: Array, margin: float = 1e-9) -> Booleans:
        """Return which joints are within the limits, not on them, (m, n)."""
        return np.asarray((self.low + margin < Q) & (self.high - margin > Q))

    def onto(self, Q: Array) -> Array:
        """Move points (m, n) into the box, then along their free joints onto the roots.

        By Newton's method.
        """
        Q = np.clip(Q, self.low, self.high)
        for _ in range(POLISH):
            values, slopes = self(Q)
            if np.abs(values).max(initial=0.0) < CONVERGED:
                break
            slopes = slopes * self.free(Q)[:, None]
            step = (np.linalg.pinv(slopes, rcond=1e-9) @ values[:, :, None])[..., 0]
            Q = np.clip(Q - step, self.low, self.high)
        return Q


class Tube(NamedTuple):
    """A curve in the common roots, proven: it passes by the points of a chain, in their order.

    Attributes:
        points: (m, n) the chain.
        error: Distance in each joint up to which the curve passes by each point [rad].
    """

    points: Array
    error: float


def tubes(f: Equations, chain: Array) -> list[Tube]:
    """Prove that a curve in the roots passes along a chain of points, (m, n), within the box.

    Segments are halved until each is proven. Where one cannot be the curve is cut in two.
    """
    points = np.clip(chain, f.low, f.high)  # joints that nothing depends on move straight
    proven = np.zeros(len(points) - 1, dtype=bool)
    error = np.zeros(len(points) - 1)
    hopeless = np.zeros(len(points) - 1, dtype=bool)
    while (open_ := np.flatnonzero(~proven & ~hopeless)).size and len(points) < MOST:
        proven[open_], error[open_] = _hold(f, points[open_], points[open_ + 1])
        open_ = open_[~proven[open_]]
        length = np.linalg.norm(points[open_ + 1] - points[open_], axis=1)
        straight = 0.5 * (points[open_] + points[open_ + 1])
        middle = f.onto(straight)
        bad = (length < SHORTEST) | (np.linalg.norm(middle - straight, axis=1) > 0.5 * length)
        hopeless[open_[bad]] = True
        open_, middle = open_[~bad], middle[~bad]
        points = np.insert(points, open_ + 1, middle, axis=0)
        proven, error, hopeless = (np.insert(a, open_ + 1, 0) for a in (proven, error, hopeless))
    cuts = np.flatnonzero(~proven)
    ends = np.concatenate(([-1], cuts, [len(proven)]))
    return [
        Tube(points[a + 1 : b + 1], float(error[a + 1 : b].max()))
        for a, b in itertools.pairwise(ends)
        if b - a > 1
    ]


def _hold(f: Equations, start: Array, end: Array) -> tuple[Booleans, Array]:
    """Check which segments (m, n) hold a curve, and how far its ends may be from theirs (m,)."""
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    slopes, second = f.derivatives(middle)
    low, high = np.minimum(start, end), np.maximum(start, end)
    noise = f.noise(float(np.abs((low, high)).max()) + 1.0)
    sizes = np.maximum(np.abs(f.values(start)), np.abs(f.values(end))) + noise
    margin = np.minimum(low - f.low, f.high - high)
    y = _pivots(np.where(margin[:, None] > AT_LIMIT, slopes, 0.0))
    own = np.take_along_axis(slopes, y[:, None], axis=2)
    condition = np.linalg.cond(own)
    sound = condition < ILL
    A = np.abs(np.linalg.inv(np.where(sound[:, None, None], own, np.eye(len(noise)))))
    error = 2.0 * (A @ sizes[:, :, None]).max(axis=(1, 2))
    slack = 2.0 * error
    noise_of_second = noise * f.degrees**2

    size = np.abs(half)
    bend = np.abs(np.einsum("ml,mcln,mn->mc", half, second, half))
    twist = np.einsum("cijk,mi,mj,mk->mc", f.third, size, size, size, optimize=True)
    sag = 0.5 * (bend + twist + noise_of_second * (size.sum(axis=1) ** 2)[:, None])
    reach = size + slack[:, None]
    around = np.abs(slopes) + _change(f, second, noise_of_second, reach)
    drift = slack[:, None] * around.sum(axis=2)
    Y = (A @ (sizes + sag + drift)[:, :, None]).max(axis=(1, 2))
    rho = np.maximum(2.0 * Y, slack)
    np.put_along_axis(reach, y, np.take_along_axis(reach, y, axis=1) + rho[:, None], axis=1)
    change = np.take_along_axis(_change(f, second, noise_of_second, reach), y[:, None], axis=2)
    change = change + (noise * f.degrees)[:, None]
    Z = (A @ change).sum(axis=2).max(axis=1) + EPS * condition
    inside = np.take_along_axis(margin, y, axis=1).min(axis=1) > rho
    return sound & (Z < CONTRACTS) & inside, error


def _change(f: Equations, second: Array, noise: Array, reach: Array) -> Array:
    """Bound the change of the first derivatives (m, c, n) up to `reach` (m, n) from the middle."""
    curvature = np.abs(second) + noise[:, None, None]
    curvature += 0.5 * np.einsum("cijk,mk->mcij", f.third, reach, optimize=True)
    return np.asarray(np.einsum("mcij,mj->mci", curvature, reach))


def _third(f: TrigPolynomial) -> Array:
    """Bound the third derivatives (n, n, n) everywhere."""
    k = np.abs(np.array(np.meshgrid(*map(orders, f.degrees), indexing="ij"))).reshape(f.n, -1)
    return np.einsum("a,ia,ja,ka->ijk", np.abs(f.coefficients).ravel(), k, k, k, optimize=True)


def _pivots(slopes: Array) -> npt.NDArray[np.intp]:
    """Choose the joints (m, c) to solve for: columns (m, c, n), each far from those before."""
    left, chosen = slopes.copy(), []
    for _ in range(slopes.shape[1]):
        j = np.linalg.norm(left, axis=1).argmax(axis=1)
        column = np.take_along_axis(left, j[:, None, None], axis=2)
        unit = column / np.maximum(np.linalg.norm(column, axis=1, keepdims=True), 1e-300)
        left = left - unit @ (unit.swapaxes(1, 2) @ left)
        chosen.append(j)
    return np.stack(chosen, axis=1)
