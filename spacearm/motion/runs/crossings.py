"""Events in the steps of runs: where functions of time and state cross zero.

All steps are searched at once: functions are evaluated at looks between which the joints move
little, and what crosses zero there is bracketed and bisected, all brackets side by side.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.equations.measures import distance
from spacearm.mechanics.nearness import FADING, tangent
from spacearm.model.scale import radians
from spacearm.motion.events import DOUBTFUL, LOOK, NEAR, ROUNDING, SHARPNESS, exact_distances
from spacearm.motion.runs.batch import Batch, Steps, Whole, event_values
from spacearm.motion.runs.wanted import WantedEvent

SHARE = 0.2
"""Share of the distance to the singular set that the joints may move until it is computed anew."""
SURE = 0.9
"""The same of an exact distance, which changes by no more than the joints move."""
FINE = 0.5
"""Motion between two looks near the singular set, as a share of `NEAR`: a passage is 2 wide."""
MOST = 1.0
"""Distances to the singular set from this on are not told apart [rad]."""
FEW = 256
"""Of so many steps the distance is computed at the ends of all at once."""
MANY = 1000
"""Configurations that a run looks from, about."""
ROUNDS = 400
"""Most evaluations of a search for a root."""


class Found(NamedTuple):
    """Events that were found.

    Attributes:
        run: (F,) numbers of the runs.
        which: (F,) numbers of the events.
        t: (F,) times [s].
        y: (F, states) states.
    """

    run: Whole
    which: Whole
    t: Array
    y: Array


class Brackets(NamedTuple):
    """Times within a step between which a function crosses zero.

    Attributes:
        step: (B,) numbers of the steps.
        a: (B,) times before.
        b: (B,) times after.
        at_a: (B,) values before.
        at_b: (B,) values after.
    """

    step: Whole
    a: Array
    b: Array
    at_a: Array
    at_b: Array

    def only(self, chosen: Any) -> Brackets:
        """Return some of them."""
        return Brackets(*(values[chosen] for values in self))


def _doubtful(far: Array) -> Any:
    """Tell where the exact distance decides, not that to first order."""
    return (far > NEAR / DOUBTFUL) & (far < DOUBTFUL * NEAR)


def _joined(parts: list[Brackets]) -> Brackets:
    """Return brackets one after the other."""
    columns: Any = zip(*parts, strict=True)
    return Brackets(*(np.concatenate(values) for values in columns))


class Crossings:
    """The search for events in the runs of a batch.

    Args:
        batch: The runs.
        wanted: The events that are looked for.
        exact: Whether the exact distance to the singular set counts, not that to first order.
    """

    def __init__(
        self,
        batch: Batch,
        wanted: list[WantedEvent],
        exact: bool,
    ) -> None:
        self.batch, self.wanted, self.exact = batch, wanted, exact
        self.near = [i for i, event in enumerate(wanted) if event.distance]
        self.plain = [i for i, event in enumerate(wanted) if not event.distance]
        self.falling = np.array([wanted[i].falling for i in self.plain], dtype=bool)
        m = len(batch)
        self.last: Array = np.zeros((m, len(self.plain)))
        self.clear, self.margin, self.seen = np.zeros(m), np.zeros(m), np.zeros((m, batch.n))
        self.radian = radians(batch.arms[0])

    def at_start(self) -> Found:
        """Return the events that are already so."""
        batch, every = self.batch, np.arange(len(self.batch))
        rows: list[tuple[Whole, Whole]] = []
        if self.plain:
            self.last = self.values(every, batch.t, batch.y)
            true = np.where(self.falling, self.last < 0.0, np.abs(self.last) <= ROUNDING)
            runs, which = np.nonzero(true)
            rows.append((runs, np.array(self.plain)[which]))
        for i in self.near:
            self._see(every, batch.y, *self.away(every, batch.y))
            runs = np.flatnonzero(self.clear < 0.0)
            rows.append((runs, np.full(len(runs), i)))
        run = np.concatenate([r for r, _ in rows]) if rows else np.zeros(0, np.int64)
        which = np.concatenate([w for _, w in rows]) if rows else np.zeros(0, np.int64)
        order = np.lexsort((which, run))
        return Found(run[order], which[order], batch.t[run[order]], batch.y[run[order]])

    def within(self, steps: Steps) -> Found:
        """Return the events in steps, in order, run by run."""
        parts: list[tuple[Brackets, Whole, Array]] = []
        if self.plain:
            found, column = self._looked(steps)
            parts.append((found, np.array(self.plain)[column], self._roots(steps, found, column)))
        for i in self.near:
            found = self._neared(steps)
            column = np.full(len(found.step), -1)
            parts.append((found, column + 1 + i, self._roots(steps, found, column)))
        if not parts:
            none = np.zeros(0, np.int64)
            return Found(none, none, np.zeros(0), np.zeros((0, self.batch.y.shape[1])))
        step = np.concatenate([found.step for found, _, _ in parts])
        which = np.concatenate([which for _, which, _ in parts])
        t = np.concatenate([t for _, _, t in parts])
        order = np.lexsort((which, t, steps.run[step]))
        step, which, t = step[order], which[order], t[order]
        return Found(steps.run[step], which, t, self.batch.states(steps, step, t))

    def values(self, runs: Whole, t: Array, y: Array) -> Array:
        """Compute the plain event functions (L, e)."""
        found: Array = self.batch.compute(event_values, runs, {"t": t, "y": y})
        return found

    def away(self, runs: Whole, y: Array, far: Array | None = None) -> tuple[Array, Array]:
        """Compute the distance to the singular set less `NEAR`, at most `MOST` of it.

        Args:
            runs: (L,) numbers of the runs.
            y: (L, states) states.
            far: (L,) the distance to first order, if it is known.

        Returns:
            (L,) it, and the joint motions (L,) that cannot change its sign.
        """
        far, share = self.far(runs, y) if far is None else far.copy(), np.full(len(runs), SHARE)
        if self.exact:
            doubtful = np.flatnonzero(_doubtful(far))
            share[doubtful] = SURE
            arms = self.batch.arms
            for arm in {arms[run]: None for run in runs[doubtful]}:
                mine = doubtful[[arms[run] is arm for run in runs[doubtful]]]
                q = y[mine, : self.batch.n]
                far[mine] = exact_distances(arm, self.batch.mode, q, np.ones(len(mine)))
        clear = np.minimum(far, MOST) - NEAR
        return clear, share * np.abs(clear)

    def far(self, runs: Whole, y: Array) -> Array:
        """Compute the distance (L,) to the singular set to first order."""
        arm, q = self.batch.arms[0], y[:, : self.batch.n]
        if arm.task.k > self.batch.n:
            return np.zeros(len(runs))
        if self.exact and len(set(self.batch.arms)) == 1:
            return tangent(arm, q, self.batch.mode, expected=MANY).distance
        found: Array = self.batch.compute(
            first_order, runs, {"q": q}, {"radians": self.radian}, outside=False
        )
        return found

    def _see(self, runs: Whole, y: Array, clear: Array, margin: Array) -> None:
        """Keep the distances of runs to the singular set."""
        self.clear[runs], self.margin[runs] = clear, margin
        self.seen[runs] = y[:, : self.batch.n]

    def _looked(self, steps: Steps) -> tuple[Brackets, Whole]:
        """Return where plain functions cross zero, and which."""
        n, nz = self.batch.n, len(self.batch.moving)
        moved = np.abs(steps.rows[:, 2 + nz : 2 + nz + n]).max(axis=1, initial=0.0)
        pieces = 1 + np.minimum(moved / LOOK, 1e6).astype(np.int64)
        step = np.repeat(np.arange(len(pieces)), pieces)
        number = np.arange(len(step)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        start, end = steps.start[step], steps.end[step]
        a = start + (end - start) * number / pieces[step]
        b = np.where(number + 1 == pieces[step], end,
                     start + (end - start) * (number + 1) / pieces[step])  # fmt: skip
        run = steps.run[step]
        now = self.values(run, b, self.batch.states(steps, step, b))
        before = np.empty_like(now)
        before[1:] = now[:-1]
        first = np.append(True, run[1:] != run[:-1])[: len(run)]
        before[first] = self.last[run[first]]
        last = np.append(run[1:] != run[:-1], True)[: len(run)]
        self.last[run[last]] = now[last]
        crossed = ((before > 0.0) & (now <= 0.0)) | ((before < 0.0) & (now >= 0.0))
        look, column = np.nonzero(np.where(self.falling, (before >= 0.0) & (now < 0.0), crossed))
        return Brackets(step[look], a[look], b[look], before[look, column],
                        now[look, column]), column  # fmt: skip

    def _neared(self, steps: Steps) -> Brackets:
        """Return where the distance to the singular set falls to `NEAR`.

        It is computed at the ends of steps, where the joints have moved by a share of the last
        distance since; what these leave in doubt is halved.
        """
        doubtful = self._coarse(steps)
        found: list[Brackets] = []
        n = self.batch.n
        q_a = self.batch.states(steps, doubtful.step, doubtful.a)[:, :n]
        q_b = self.batch.states(steps, doubtful.step, doubtful.b)[:, :n]
        while len(doubtful.step):
            falls = (doubtful.at_a >= 0.0) & (doubtful.at_b < 0.0)
            moved = self._norm(q_b - q_a)
            open_ = ~falls & (moved > FINE * NEAR)
            open_ &= moved > SHARE * (np.abs(doubtful.at_a) + np.abs(doubtful.at_b))
            found.append(doubtful.only(falls))
            left = doubtful.only(open_)
            mid = 0.5 * (left.a + left.b)
            y = self.batch.states(steps, left.step, mid)
            at = self.away(steps.run[left.step], y)[0]
            q_a = np.concatenate((q_a[open_], y[:, :n]))
            q_b = np.concatenate((y[:, :n], q_b[open_]))
            doubtful = _joined([left._replace(b=mid, at_b=at), left._replace(a=mid, at_a=at)])
        return _joined(found) if found else doubtful

    def _coarse(self, steps: Steps) -> Brackets:
        """Return the steps at whose ends the distance is computed, with it."""
        n, nz, runs = self.batch.n, len(self.batch.moving), np.unique(steps.run)
        begins = steps.rows[:, 2 : 2 + n]
        ends = begins + steps.rows[:, 2 + nz : 2 + nz + n]
        far = self.far(steps.run, ends) if len(ends) <= FEW else None
        if far is not None and not (self.exact and _doubtful(far).any()):
            first = np.searchsorted(steps.run, runs)
            last = np.searchsorted(steps.run, runs, side="right") - 1
            value, margin = self.away(steps.run, ends, far)
            before = np.append(0.0, value[:-1])[: len(value)]
            before[first] = self.clear[runs]
            self._see(runs, ends[last], value[last], margin[last])
            return Brackets(np.arange(len(value)), steps.start, steps.end, before, value)
        left, reached, parts = np.arange(len(ends)), np.full(len(self.batch), -1), []
        while True:
            run = steps.run[left]
            due = left[self._norm(ends[left] - self.seen[run]) >= self.margin[run]]
            run, index = np.unique(steps.run[due], return_index=True)
            if not len(run):
                break
            step = due[index]
            before = self._norm(begins[step] - self.seen[run])
            value, margin = self.away(run, ends[step], None if far is None else far[step])
            low = np.where(self.clear[run] > 0.0, np.maximum(self.clear[run] - before, 0.0),
                           self.clear[run])  # fmt: skip
            parts.append(Brackets(step, steps.start[step], steps.end[step], low, value))
            self._see(run, ends[step], value, margin)
            reached[:] = len(ends)
            reached[run] = step
            left = left[left > reached[steps.run[left]]]
        if not parts:
            none = np.zeros(0)
            return Brackets(np.zeros(0, np.int64), none, none, none, none)
        return _joined(parts)

    def _norm(self, dq: Array) -> Array:
        """Return the lengths of joint motions, per radian."""
        found: Array = np.sqrt(((dq / self.radian) ** 2).sum(axis=1))
        return found

    def _value(self, steps: Steps, step: Whole, column: Whole, t: Array) -> Array:
        """Compute single event functions in steps; column -1 is the distance."""
        runs, y, found = steps.run[step], self.batch.states(steps, step, t), np.empty(len(t))
        plain = column >= 0
        if plain.any():
            values = self.values(runs[plain], t[plain], y[plain])
            found[plain] = values[np.arange(len(values)), column[plain]]
        if not plain.all():
            found[~plain] = self.away(runs[~plain], y[~plain])[0]
        return found

    def _roots(self, steps: Steps, of: Brackets, column: Whole) -> Array:
        """Return the times (B,) at which functions cross zero, by Chandrupatla's method.

        Inverse quadratic interpolation where that is safe, else bisection: Chandrupatla, Adv. Eng.
        Softw. 28, 145 (1997), DOI 10.1016/S0965-9978(96)00051-8.
        """
        start, end, at_a, at_b = of[1:]
        side = np.where((at_a > 0.0) | ((at_a == 0.0) & (at_b < 0.0)), 1.0, -1.0)
        x, f = np.stack((end, start, start)), np.stack((at_b, at_a, at_a))
        with np.errstate(all="ignore"):
            share = np.nan_to_num(at_b / (at_b - at_a), nan=0.5)
        for _ in range(ROUNDS):
            tolerance = SHARPNESS * np.abs(x[0]) / np.maximum(np.abs(x[1] - x[0]), 1e-300)
            i = np.flatnonzero((tolerance < 1.0) & (f[0] != 0.0))
            if not len(i):
                break
            least = np.minimum(0.5 * tolerance[i], 0.5)
            t = x[0, i] + np.clip(share[i], least, 1.0 - least) * (x[1, i] - x[0, i])
            at = self._value(steps, of.step[i], column[i], t)
            same = (at * side[i] > 0.0) == (f[0, i] * side[i] > 0.0)
            for values, new in ((x, t), (f, at)):
                before, other, _ = values[:, i]
                values[:, i] = new, np.where(same, other, before), np.where(same, before, other)
            (x1, x2, x3), (f1, f2, f3) = x[:, i], f[:, i]
            with np.errstate(all="ignore"):
                xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
                curved = f1 / (f2 - f1) * f3 / (f2 - f3)
                curved += (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
            safe = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi) & np.isfinite(curved)
            share[i] = np.where(safe, curved, 0.5)
        found: Array = np.where(f[0] == 0.0, x[0], np.maximum(x[0], x[1]))
        return found


def first_order(xp: Any, tree: Any, p: Any, *, q: Any, radians: Any) -> Any:
    """Compute the distance to the singular set to first order."""
    return distance(xp, tree, p, q, FADING, radians)[0]
