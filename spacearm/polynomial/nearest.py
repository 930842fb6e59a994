"""The common root of polynomials that is nearest to a point.

From many starts at once, each step goes to the point nearest to the origin on the linearised
equations; the best are then polished by Newton's method on the Lagrange equations

    o + lambda G = 0,   m(q + o) = 0

for the offset o from the point, G the gradients of the polynomials m. Joints at a bound of a box
are held there as long as that makes the distance shorter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.polynomial.jets import Chart, Jet, Jets
from spacearm.polynomial.newton import shortened
from spacearm.polynomial.trig import NOISE, TrigPolynomial

Booleans = npt.NDArray[np.bool_]

GAP = 1e-4
"""Branch and bound proves that no root is nearer than the one found by more than this [rad]; the
one found is exact to rounding."""
DESCENT = 12
"""Steps towards the point on the linearised equations."""
POLISHED = 24
"""Number of candidates that Newton's method polishes."""
STEPS = 12
"""Newton steps."""
CONVERGED = 1e-13
"""Length of the step after which a candidate is finished [rad, m]."""
PRUNED_AFTER, PRUNED = 3, 6
"""Steps after which only the nearest candidates are polished further, and how many."""
EXACT, ROUGH = 1e-8, 1e-2
"""How close a point is to a root: one that is found, and one after these steps [rad, m]."""
STRIDE = 0.5
"""Longest step [rad, m]."""
TINY = 1e-300
"""Keeps matrices of zeros solvable."""
APART = 0.05
"""Candidates nearer to each other than this are one [rad, m]."""


def nearest_root(
    minors: Sequence[Jets],
    q: Array,
    starts: Array,
    low: Array,
    high: Array,
    counts: Callable[[Array, float], bool] | None = None,
) -> Array | None:
    """Find the common root in the box that is nearest to q, among those reached from starts.

    Args:
        minors: The polynomials.
        q: (n,) point.
        starts: (m, n) starts; (0, n) if there are none.
        low: (n,) lower corner of the box, -inf without limits.
        high: (n,) upper corner.
        counts: Decides whether a common root counts, from a point (n,) this close to it; all do if
            None.

    Returns:
        (n,) offset of the root from q; None if none was found.
    """
    candidates = starts[_sound(minors, starts, low, high)] - q
    X = _distinct(_descended(minors, starts, q, low, high), q)
    X = _polished(minors, X, q, low, high, counts)
    polished = X[_sound(minors, X, low, high)] - q
    both = np.concatenate((candidates, polished))
    order = np.argsort(np.linalg.norm(both, axis=1))
    return next((both[i] for i in order if not counts or counts(q + both[i], EXACT)), None)


def _polished(
    minors: Sequence[Jets],
    X: Array,
    q: Array,
    low: Array,
    high: Array,
    counts: Callable[[Array, float], bool] | None,
) -> Array:
    """Take Newton steps on the Lagrange equations, each row until it has converged."""
    X = X.copy()
    multipliers: Array = np.zeros((len(X), len(minors)))
    moving = np.arange(len(X))
    for i in range(STEPS):
        x, lagrange = X[moving], multipliers[moving]
        jets = [minor(x, 2) for minor in minors]
        if i == 0:
            lagrange = _multipliers(jets, x - q)
        held = _held(jets, x, q, low, high, lagrange)
        step, multipliers[moving] = _newton(jets, x - q, lagrange, held)
        X[moving] = np.clip(x + shortened(step, STRIDE), low, high)
        moving = moving[np.linalg.norm(step, axis=1) > CONVERGED]
        if i == PRUNED_AFTER:
            best = [j for j in moving if not counts or counts(X[j], ROUGH)]
            distance = np.linalg.norm(X[best] - q, axis=1)
            moving = np.array(best, dtype=np.intp)[np.argsort(distance)[:PRUNED]]
        if not len(moving):
            break
    return X


def _held(
    jets: Sequence[Jet], X: Array, q: Array, low: Array, high: Array, multipliers: Array
) -> Booleans:
    """Return which coordinates (m, n) stay at a bound: to move inside would not bring X nearer."""
    slope = X - q + (multipliers[:, None] @ _values(jets)[1])[:, 0]
    return ((low >= X) & (slope >= 0.0)) | ((high <= X) & (slope <= 0.0))


def _values(jets: Sequence[Jet]) -> tuple[Array, Array]:
    """Stack values (m, c) and gradients (m, c, n)."""
    return np.stack([j.value for j in jets], 1), np.stack([j.gradient for j in jets], 1)


def _sound(minors: Sequence[Jets], X: Array, low: Array, high: Array) -> Booleans:
    """Return which points are common roots to rounding, in the box."""
    inside = ((low <= X) & (high >= X)).all(axis=1)
    largest = float(np.abs(X).max(initial=0.0))
    zero = [np.abs(m(X).value) <= max(m.noise(largest), NOISE * m.scale) for m in minors]
    return np.logical_and.reduce([*zero, inside])


def _descended(minors: Sequence[Jets], X: Array, q: Array, low: Array, high: Array) -> Array:
    """Move points (m, n) along the roots towards q; steps are kept if they bring them nearer.

    What must fall is the distance from q and twice that from the roots, to first order.
    """
    aim, merit = _aims(minors, X, q, low, high)
    share = np.ones(len(X))
    for _ in range(DESCENT):
        tried = np.clip(X + share[:, None] * shortened(aim - X, STRIDE), low, high)
        new_aim, new_merit = _aims(minors, tried, q, low, high)
        better = new_merit < merit
        X = np.where(better[:, None], tried, X)
        aim = np.where(better[:, None], new_aim, aim)
        merit = np.where(better, new_merit, merit)
        share = np.where(better, np.minimum(2.0 * share, 1.0), share / 4.0)
    return X


def _aims(
    minors: Sequence[Jets], X: Array, q: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Compute the points nearest to q on the equations linearised at X, within the box.

    Returns:
        The points (m, n), and the merit (m,) of X itself: its distance from q and twice that from
        the linearised equations.
    """
    value, G = _values([minor(X, 1) for minor in minors])
    off = np.linalg.norm(_least(G, value), axis=1)
    wanted = (G @ (X - q)[:, :, None])[:, :, 0] - value
    free = np.ones_like(X)
    offset = np.zeros_like(X)
    for _ in range(3):
        rest = wanted - (G @ (offset * (1.0 - free))[:, :, None])[:, :, 0]
        offset = np.where(free > 0.0, _least(G * free[:, None], rest), offset)
        over = (q + offset < low) | (q + offset > high)
        if not over.any():
            break
        offset = np.clip(q + offset, low, high) - q
        free[over] = 0.0
    return q + offset, np.linalg.norm(X - q, axis=1) + 2.0 * off


def _least(G: Array, wanted: Array) -> Array:
    """Return the shortest x (m, n) with G x = wanted, G (m, c, n) and wanted (m, c)."""
    gram = G @ G.swapaxes(1, 2)
    size = 1e-14 * np.trace(gram, axis1=1, axis2=2) + TINY
    gram += size[:, None, None] * np.eye(G.shape[1])
    return np.asarray((G.swapaxes(1, 2) @ np.linalg.solve(gram, wanted[:, :, None]))[:, :, 0])


def _distinct(X: Array, q: Array) -> Array:
    """Return the nearest points that lie apart."""
    chosen: list[Array] = []
    for x in X[np.argsort(np.linalg.norm(X - q, axis=1))]:
        if all(np.abs(x - other).max() > APART for other in chosen):
            chosen.append(x)
        if len(chosen) == POLISHED:
            break
    return np.array(chosen).reshape(-1, X.shape[1])


def _multipliers(jets: Sequence[Jet], offset: Array) -> Array:
    """Estimate the multipliers by least squares."""
    G = _values(jets)[1]
    return np.asarray(-(np.linalg.pinv(G.swapaxes(1, 2), rcond=1e-12) @ offset[:, :, None])[..., 0])


def _newton(
    jets: Sequence[Jet], offset: Array, multipliers: Array, held: Booleans
) -> tuple[Array, Array]:
    """Take a Newton step on the Lagrange equations; held coordinates stay."""
    value, G = _values(jets)
    m, c, n = G.shape
    K, r = np.zeros((m, n + c, n + c)), np.zeros((m, n + c))
    K[:, :n, :n] = np.eye(n)
    for i, jet in enumerate(jets):
        K[:, :n, :n] += multipliers[:, i, None, None] * jet.hessian
    K[:, :n, n:], K[:, n:, :n] = G.swapaxes(1, 2), G
    r[:, :n] = offset + (multipliers[:, None] @ G)[:, 0]
    r[:, n:] = value
    row, column = np.nonzero(held)
    K[row, column], K[row, :, column] = 0.0, 0.0
    K[row, column, column], r[row, column] = 1.0, 0.0
    try:
        step = -np.linalg.solve(K, r[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        step = -(np.linalg.pinv(K, rcond=1e-13) @ r[:, :, None])[:, :, 0]
    return step[:, :n], multipliers + step[:, n:]


def branch_and_bound(S: TrigPolynomial, best: Array | None) -> Array | None:
    """Find the root nearest to the origin by halving the boxes that may hold a nearer one.

    Args:
        S: The polynomial of up to three angles.
        best: (n,) the best root known, or None.
    """
    jets = Jets(S, Chart.turning(S.n))
    corners = np.array(list(product((-1.0, 1.0), repeat=S.n)))
    origin, anywhere = np.zeros(S.n), np.full(S.n, np.inf)
    centres, half = np.zeros((1, S.n)), np.pi
    while len(centres) and half > GAP / 2.0:
        half /= 2.0
        centres = (centres[:, None] + half * corners).reshape(-1, S.n)
        bound = np.inf if best is None else float(np.linalg.norm(best))
        distance = np.linalg.norm(np.maximum(np.abs(centres) - half, 0.0), axis=1)
        centres = centres[distance < bound - GAP]
        centres = centres[S.sign(centres, np.full_like(centres, half)) == 0]
        starts = centres[np.argsort(np.linalg.norm(centres, axis=1))[:4]]
        found = nearest_root([jets], origin, starts, -anywhere, anywhere)
        if found is not None and np.linalg.norm(found) < bound:
            best = found
    return best
