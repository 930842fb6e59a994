"""Singular configurations near a given one: the nearest, and one by the Gauss-Newton method.

Offsets x from the configuration count in radians of each joint (`joint_scales`), so that |x| is the
distance. Each step of a descent goes to the point T(x) nearest to the configuration on the singular
set linearised at x (`nearness.foot`). Nearest points are fixed points of T. The best ends are then
moved onto the set and along it, by Newton's method on T(x) = x, its derivatives taken as
differences, or by shorter steps towards T(x) where that is no nearer.

J* itself and its derivative are all that this takes, so it works for every arm, and nothing is
found that is not singular. That nothing nearer is missed is proven only by `nearest_root`, for
sets with one equation in up to three joints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, Progress
from spacearm.errors import NoSolutionError
from spacearm.mechanics.distance import Tangent, foot, nearness, tangent
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.polynomial.branch_and_bound import nearest_root
from spacearm.polynomial.newton import shortened
from spacearm.polynomial.trig import TrigPolynomial

Booleans = npt.NDArray[np.bool_]

GLOBAL_DIMENSION = 3
"""Up to this many joints the nearest root of one polynomial is proven."""
STARTS = 128, 96
"""Starts within reach of the configuration, and within that of the best found so far."""
REACH, BEYOND = 2.0, 1.2
"""That reach [rad]; the share of the best distance in which others are looked for."""
STEPS = 8
"""Steps of each descent."""
WEIGHT = 20.0
"""What a radian from the set counts. Less leads into valleys of sigma_min that seem to reach it."""
LANDING, BACK = 10, 4
"""Steps onto the set from the ends, and after each move along it."""
ENDS = 12
"""Ends that are moved along the set, as long as they lie apart."""
APART = 0.05
"""Ends nearer to each other than this are one [rad]."""
SETTLING, PRUNED_AFTER, PRUNED = 20, 3, 5
"""Steps along the set; after how many only the nearest are moved further, and how many."""
SHARES = np.array([1.0, 0.3, 0.1, 0.03, 0.01, 0.003])
"""Shares of the way to T(x) that are tried where Newton's method comes no nearer."""
STRIDE, NUDGE = 0.5, 1e-5
"""Longest step, and that of the differences [rad]."""
NEARBY = 0.02
"""So near to T(x) Newton's method is tried alone first [rad]."""
LANDED = 1e-9
"""Steps onto the set that are no longer end the way there: the next would be of the order of their
square [rad]."""
LOOKS = 100
"""Configurations that are looked from until one has settled, about."""
THERE, FAR = 1e-8, 10.0
"""Distance of the set from singular configurations, and where it is nowhere in sight [rad]."""
RESTING = 1e-13
"""Offsets that come nearer by less than this are at rest [rad]."""


def nearest_singular(
    arm: SpaceArm,
    mode: BaseMode,
    q: Array,
    limits: bool = False,
    S: TrigPolynomial | None = None,
    progress: Progress | None = None,
) -> tuple[Array, float]:
    """Find the singular configuration nearest to q.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        q: (n,) configuration.
        limits: Whether only configurations within the joint limits count.
        S: The polynomial of all n joint angles that vanishes on the set and nowhere else, to prove
            that none is nearer.
        progress: Called as progress(done, most), in looks at the set.

    Returns:
        (n,) configuration and its distance [rad], sliding joints in units of `joint_scales`.

    Raises:
        NoSolutionError: None was found.
    """
    unit = joint_scales(arm)
    low = (arm.lower - q) / unit if limits else np.full(arm.n, -np.inf)
    high = (arm.upper - q) / unit if limits else np.full(arm.n, np.inf)
    look = looking(arm, mode, q)
    if progress:
        look = _counted(look, _most(arm.n), progress)
    search = Search(look, low, high)
    best = search.nearest()
    if S is not None and not limits:
        best = _proven(S, q, best, search)
    if best is None:
        raise NoSolutionError(f"{arm.name}: no singular configuration was found")
    return q + unit * best, float(np.linalg.norm(best))


def looking(arm: SpaceArm, mode: BaseMode, q: Array) -> Callable[[Array], Tangent]:
    """Return how the set looks from offsets (m, n)."""
    unit = joint_scales(arm)
    return lambda X: tangent(arm, q + unit * X, mode, expected=LOOKS)


def settled_each(arm: SpaceArm, mode: BaseMode, Q: Array) -> Array:
    """Return the offsets (m, n) of the set that are reached along it from Q (m, n); NaN if none is.

    What `Search.settled` does from one configuration, of many side by side.
    """
    m, n = Q.shape

    def search(rows: npt.NDArray[np.intp]) -> Search:
        """Return a search from some of the configurations."""

        def look(X: Array) -> Tangent:
            start = np.repeat(Q[rows], len(X) // len(rows), axis=0)
            return tangent(arm, start + unit * X, mode, expected=LOOKS * m)

        return Search(look, np.full(n, -np.inf), np.full(n, np.inf))

    unit = joint_scales(arm)
    every = np.arange(m)
    X: Array = np.zeros((m, n))
    if not m:
        return X
    whole, moving = search(every), every
    X = whole.onto(X, LANDING)
    for _ in range(SETTLING):
        X[moving], _, rests = search(moving)._moved(X[moving])
        moving = moving[~rests]
        if not moving.size:
            break
    X = whole.onto(X, 2)
    X[whole.look(X).distance > THERE] = np.nan
    return X


def _counted(
    look: Callable[[Array], Tangent], most: int, progress: Progress
) -> Callable[[Array], Tangent]:
    """Return `look` that tells how often it has looked; branch and bound is beyond `most`."""
    done = 0

    def counted(X: Array) -> Tangent:
        nonlocal done
        seen = look(X)
        done = min(done + len(X), most)
        progress(done, most)
        return seen

    return counted


def _most(n: int) -> int:
    """Return how many looks descents and settling take if no end rests early."""
    moves = (PRUNED_AFTER + 1) * ENDS + (SETTLING - PRUNED_AFTER - 1) * min(PRUNED, ENDS)
    each = 2 * n + 1 + (BACK + 1) * (1 + len(SHARES))
    return (STEPS + LANDING + 2) * sum(STARTS) + moves * each + 3 * ENDS


@dataclass(frozen=True)
class Search:
    """A search for the offset nearest to the origin at which J* loses rank.

    Attributes:
        look: Returns how the set looks from offsets (m, n).
        low: (n,) least offsets.
        high: (n,) largest offsets.
    """

    look: Callable[[Array], Tangent]
    low: Array
    high: Array

    def nearest(self) -> Array | None:
        """Return the best offset (n,) of descents from starts about the origin, or None."""
        rng, reach = np.random.default_rng(0), REACH
        ends = []
        for m in STARTS:
            X, merit = self.descended(self.within(_ball(rng, m, len(self.low), reach)))
            ends.append(X)
            reach = min(reach, BEYOND * float(merit.min()))
        return self.settled(np.concatenate(ends))

    def within(self, X: Array) -> Array:
        """Move offsets (m, n) into the limits."""
        return np.clip(X, self.low, self.high)

    def foot(self, X: Array) -> tuple[Array, Array, Tangent]:
        """Compute T(x) (m, n), the merit (m,) of X (m, n) itself, and how the set looks from there.

        The merit is the distance from the origin and `WEIGHT` times that from the set.
        """
        seen = self.look(X)
        seen = seen._replace(distance=np.where(np.isfinite(seen.distance), seen.distance, FAR))
        target = foot(seen, X)
        if np.isfinite(self.low).any() or np.isfinite(self.high).any():
            target = self._foot_within(seen, X)
        return target, np.linalg.norm(X, axis=1) + WEIGHT * seen.distance, seen

    def _foot_within(self, seen: Tangent, X: Array) -> Array:
        """Compute the points nearest to the origin on the set as it looks from X, in the limits."""
        wanted = (seen.rows @ X[:, :, None])[..., 0]
        wanted[:, 0] -= seen.distance
        free, offset = np.ones_like(X), np.zeros_like(X)
        for _ in range(len(self.low)):
            rest = wanted - (seen.rows @ (offset * (1.0 - free))[:, :, None])[..., 0]
            rows = seen.rows * free[:, None]
            least = (np.linalg.pinv(rows, rcond=1e-9) @ rest[:, :, None])[..., 0]
            offset = np.where(free > 0.0, least, offset)
            over = ((offset < self.low) | (offset > self.high)) & (free > 0.0)
            offset = self.within(offset)
            if not over.any():
                break
            free[over] = 0.0
        return offset

    def onto(self, X: Array, steps: int) -> Array:
        """Move offsets (m, n) onto the set, by the Gauss-Newton method."""
        for _ in range(steps):
            seen = self.look(X)
            stride = np.where(np.isfinite(seen.distance), np.minimum(seen.distance, STRIDE), 0.0)
            X = self.within(X - stride[:, None] * seen.rows[:, 0])
            if (stride <= LANDED).all():
                break
        return X

    def descended(self, X: Array) -> tuple[Array, Array]:
        """Descend from X (m, n), by steps that are shortened where the merit does not fall.

        Returns:
            The ends (m, n), and their merits.
        """
        target, merit, _ = self.foot(X)
        share = np.ones(len(X))
        for _ in range(STEPS):
            tried = self.within(X + share[:, None] * shortened(target - X, STRIDE))
            new_target, new_merit, _ = self.foot(tried)
            better = new_merit < merit
            X = np.where(better[:, None], tried, X)
            target = np.where(better[:, None], new_target, target)
            merit = np.where(better, new_merit, merit)
            share = np.where(better, np.minimum(2.0 * share, 1.0), share / 4.0)
        return X, merit

    def settled(self, X: Array) -> Array | None:
        """Return the nearest offset (n,) of the set that is reached along it from X, or None."""
        X = self.onto(X, LANDING)
        X = _apart(X, self.foot(X)[1], ENDS)
        merit, moving = np.full(len(X), np.inf), np.arange(len(X))
        for i in range(SETTLING):
            X[moving], merit[moving], rests = self._moved(X[moving])
            moving = moving[~rests]
            if i == PRUNED_AFTER:
                moving = moving[merit[moving] <= np.sort(merit)[:PRUNED][-1]]
            if not moving.size:
                break
        X = self.onto(X, 2)
        X = X[self.look(X).distance <= THERE]
        return X[np.argmin(np.linalg.norm(X, axis=1))] if len(X) else None

    def _moved(self, X: Array) -> tuple[Array, Array, Booleans]:
        """Move offsets (m, n) along the set; returns their merits and which are at rest, too."""
        m, n = X.shape
        nudges = NUDGE * np.concatenate((np.zeros((1, n)), np.eye(n), -np.eye(n)))
        target, merit, _ = self.foot((X[:, None] + nudges).reshape(-1, n))
        target, merit = target.reshape(m, -1, n), merit.reshape(m, -1)[:, 0]
        slopes = (target[:, 1 : n + 1] - target[:, n + 1 :]).swapaxes(1, 2) / (2.0 * NUDGE)
        way = target[:, 0] - X
        size = np.linalg.norm(way, axis=1)
        newton = (np.linalg.pinv(np.eye(n) - slopes) @ way[:, :, None])[..., 0]
        moved = np.zeros(m, dtype=bool)
        steps = np.concatenate(
            (shortened(newton, STRIDE)[:, None], SHARES[:, None] * shortened(way, STRIDE)[:, None]),
            axis=1,
        )
        goes = size**2 > RESTING * np.linalg.norm(X, axis=1)  # else the merit cannot fall by more
        alone = (size[goes] < NEARBY).all()
        for count in (1, 1 + len(SHARES)) if alone else (1 + len(SHARES),):
            if not goes.any():
                break
            tried = self.onto((X[:, None] + steps[:, :count]).reshape(-1, n), BACK)
            merits = self.foot(tried)[1].reshape(m, -1)
            best = np.arange(m), merits.argmin(axis=1)
            better = goes & (merits[best] < merit - RESTING)
            X = np.where(better[:, None], tried.reshape(m, -1, n)[best], X)
            merit = np.where(better, merits[best], merit)
            moved |= better
            goes &= ~better
        return X, merit, ~moved


def _ball(rng: np.random.Generator, m: int, n: int, reach: float) -> Array:
    """Return the origin and offsets (m, n) that are uniform in a ball about it."""
    ways = rng.normal(size=(m, n))
    ways *= reach * rng.uniform(size=(m, 1)) ** (1.0 / n) / np.linalg.norm(ways, axis=1)[:, None]
    ways[0] = 0.0
    return ways


def _apart(X: Array, merit: Array, most: int) -> Array:
    """Return the best of offsets (m, n) that lie apart."""
    chosen: list[Array] = []
    for x in X[np.argsort(merit)]:
        if all(np.abs(x - other).max() > APART for other in chosen):
            chosen.append(x)
        if len(chosen) == most:
            break
    return np.array(chosen)


def _proven(S: TrigPolynomial, q: Array, best: Array | None, search: Search) -> Array | None:
    """Improve an offset from q by branch and bound, if few joints matter."""
    chosen = [j for j, degree in enumerate(S.degrees) if degree]
    if not 0 < len(chosen) <= GLOBAL_DIMENSION:
        return best
    others = {j: float(q[j]) for j in range(S.n) if j not in chosen}
    centred = (S.fix(others) if others else S).shifted(q[chosen])

    def whole(X: Array) -> Array:
        full = np.zeros((len(X), S.n))
        full[:, chosen] = X
        return full

    def improve(X: Array) -> Array | None:
        found = search.settled(search.descended(whole(X))[0])
        return None if found is None else found[chosen]

    found = nearest_root(centred, None if best is None else best[chosen], improve)
    return None if found is None else whole(found[None])[0]


LOST = 1e-10
"""A matrix has lost rank if its least singular value is below this share of the largest norm of it
met during the iteration."""
AT_A_ROOT = 1e-8
"""sigma_min over sigma_max below which a root of the minors is a singular configuration."""
RANK_STEPS = 60
"""Largest number of Gauss-Newton steps."""
RANK_STRIDE = 0.3
"""Longest step [rad, m]."""


def lose_rank(
    arm: SpaceArm, q: Array, mode: BaseMode, columns: tuple[int, ...] | None = None
) -> Array | None:
    """Find a configuration near q (n,) at which J* loses rank, or None.

    Args:
        arm: The arm.
        q: (n,) start.
        mode: What the spacecraft does.
        columns: The columns of J* that count; all if None.
    """
    if columns == ():
        return None
    chosen = slice(None) if columns is None else list(columns)
    most, found, before = 0.0, False, q
    for _ in range(RANK_STEPS):
        cfg = arm.at(q)
        J = task_jacobian(cfg, mode=mode)[:, chosen]
        dJ = task_jacobian_derivative(cfg, mode=mode)[:, :, chosen]
        wide = J.shape[1] >= len(J)
        near = nearness(J, dJ) if wide else nearness(J.T, dJ.swapaxes(1, 2))
        most = max(most, float(np.linalg.norm(J)))
        if found:  # a step further, to all digits
            return q if near.sigma <= LOST * most else before
        if np.isinf(near.distances[-1]):
            return None
        found, before = near.sigma <= LOST * most, q
        q = q - min(float(near.distances[-1]), RANK_STRIDE) * near.away
    return None


def is_singular(
    arm: SpaceArm,
    q: Array,
    mode: BaseMode,
    columns: tuple[int, ...] | None = None,
    *,
    tolerance: float = AT_A_ROOT,
) -> bool:
    """Check whether J*, or some of its columns, have lost rank at a root of the minors q (n,).

    Args:
        arm: The arm.
        q: (n,) a root of minors, accurate to some ten digits as a rule.
        mode: What the spacecraft does.
        columns: The columns of J* that count; all if None.
        tolerance: Share of the largest singular value below which the least one counts as zero.
    """
    if columns == ():  # of a task of one row: no columns are never dependent
        return False
    J = task_jacobian(arm.at(q), mode=mode)
    sigma = np.linalg.svd(J if columns is None else J[:, list(columns)], compute_uv=False)
    return bool(sigma[-1] <= tolerance * sigma[0])


def nearest_about(arm: SpaceArm, mode: BaseMode, q: Array) -> tuple[Array, float] | None:
    """Return the singular configuration (n,) nearest to q (n,) that lies about, and its distance.

    Where the set is near, its foot to first order lies by its nearest point. Then the last part of
    `closest.Search` is enough, which moves one point along the set until it rests. The distance is
    in radians, sliding joints in units of `joint_scales`; None if none lies about.
    """
    search = Search(looking(arm, mode, q), np.full(arm.n, -np.inf), np.full(arm.n, np.inf))
    offset = search.settled(np.zeros((1, arm.n)))
    if offset is None:
        return None
    return q + joint_scales(arm) * offset, float(np.linalg.norm(offset))
