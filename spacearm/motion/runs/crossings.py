"""Events in the steps of runs: where functions of time and state cross zero.

All steps are searched at once: functions are evaluated at looks between which the joints move
little, and what crosses zero there is bracketed and bisected, all brackets side by side.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.equations.integration import state_of
from spacearm.equations.measures import nearest
from spacearm.equations.plant import crossing
from spacearm.mechanics.arm_kernels import WIDE
from spacearm.mechanics.distance import FADING
from spacearm.model.joints import joint_scales
from spacearm.motion.events import DOUBTFUL, LOOK, NEAR, ROUNDING, SHARPNESS
from spacearm.motion.runs.batch import Batch, Steps, Whole
from spacearm.motion.runs.setup import WantedEvent
from spacearm.singularities.nearest import settled_each

SHARE = 0.2
"""Share of the distance to the singular set that the joints may move until it is computed anew."""
FINE = 0.5
"""Motion between two looks near the singular set, as a share of `NEAR`: a passage is 2 wide."""
MOST = 1.0
"""Distances to the singular set from this on are not told apart [rad]."""
LOOKS, AT_REST = 40, 1e-13
"""Most looks at the singular set until its nearest point rests, and how it then moves [rad]."""


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
    """Times within steps between which functions cross zero.

    Attributes:
        step: (B,) numbers of the steps.
        which: (B,) numbers of the events.
        a: (B,) times before.
        b: (B,) times after.
        at_a: (B,) values before.
        at_b: (B,) values after.
    """

    step: Whole
    which: Whole
    a: Array
    b: Array
    at_a: Array
    at_b: Array

    def only(self, chosen: Any) -> Brackets:
        """Return some of them."""
        return Brackets(*(values[chosen] for values in self))


def _joined(parts: list[Brackets]) -> Brackets:
    """Return brackets one after the other."""
    columns: Any = zip(*parts, strict=True)
    return Brackets(*(np.concatenate(values) for values in columns))


def _before(values: Array, last: Array, run: Whole) -> Array:
    """Return the values before each of others, which runs have one after the other.

    Args:
        values: (L, ...) the values.
        last: (m, ...) those before the first of each run; the last ones are kept in it.
        run: (L,) numbers of the runs.
    """
    before = np.roll(values, 1, axis=0)
    first = np.flatnonzero(np.append(True, run[1:] != run[:-1])[: len(run)])
    before[first] = last[run[first]]
    last[run[first - 1]] = values[first - 1]  # the last of all stands before the first
    return before


class Crossings:
    """The search for events in the runs of a batch.

    Args:
        batch: The runs.
        wanted: The events that are looked for.
        exact: Whether the exact distance to the singular set counts, not that to first order.
    """

    def __init__(self, batch: Batch, wanted: list[WantedEvent], exact: bool) -> None:
        self.batch = batch
        self.distance = np.array([event.root is None for event in wanted], dtype=bool)
        self.plain, self.near = (np.flatnonzero(self.distance == near) for near in (False, True))
        self.falling = np.array([wanted[i].falling for i in self.plain], dtype=bool)
        self.radian = joint_scales(batch.arms[0])
        between = (NEAR / DOUBTFUL, DOUBTFUL * NEAR) if exact else (np.inf, 0.0)
        self.numbers: dict[str, Array | float] = {
            "fading": FADING, "radians": self.radian, "between": np.array(between), "rest": AT_REST,
        }  # fmt: skip
        self.last: Array = np.zeros((len(batch), len(self.plain)))
        self.clear: Array = np.zeros(len(batch))

    def at_start(self) -> Found:
        """Return the events that are already so."""
        batch, steps = self.batch, self.batch.standing()
        true = np.zeros((len(batch), len(self.distance)), dtype=bool)
        if len(self.plain):
            self.last = batch.event_values(steps, steps.run, steps.end)
            low = np.abs(self.last) <= ROUNDING
            true[:, self.plain] = np.where(self.falling, self.last < 0.0, low)
        if len(self.near):
            self.clear = self.away(steps.run, batch.y[:, : batch.n])
            true[:, self.near] = self.clear[:, None] < 0.0
        run, which = np.nonzero(true)
        return Found(run, which, batch.t[run], batch.y[run])

    def within(self, steps: Steps) -> Found:
        """Return the events in steps, in order, run by run."""
        parts = [self._looked(steps)] if len(self.plain) else []
        found = _joined([*parts, self._neared(steps)] if len(self.near) else parts)
        t = self._roots(steps, found)
        order = np.lexsort((found.which, t, steps.run[found.step]))
        step, t = found.step[order], t[order]
        y = self.batch.states(steps, step, t)
        return Found(steps.run[step], found.which[order], t, y)

    def away(self, runs: Whole, q: Array) -> Array:
        """Compute the distance (L,) to the singular set less `NEAR`, at most `MOST` of it.

        Args:
            runs: (L,) numbers of the runs.
            q: (L, n) joint positions.
        """
        found: Array = np.minimum(self.nearest(runs, q)[0], MOST) - NEAR
        return found

    def nearest(self, runs: Whole, q: Array) -> tuple[Array, Array]:
        """Compute the distance (L,) to the singular set, and where it is nearest.

        Args:
            runs: (L,) numbers of the runs.
            q: (L, n) joint positions.

        Returns:
            The distance, to first order where that decides; elsewhere the offsets (L, n) of the
            nearest points in radians, NaN if there is none.
        """
        batch, arms = self.batch, self.batch.arms
        if arms[0].task.k > batch.n:
            return np.zeros(len(q)), np.zeros_like(q)
        found = batch.compute(
            nearest, runs, {"q": q}, self.numbers, lanes=WIDE, acts=False, most=LOOKS
        )
        far, moved, offset = found[:, 0], found[:, 1], found[:, 2:]
        left = np.flatnonzero(~(moved <= AT_REST))
        for arm in {arms[run]: None for run in runs[left]}:
            mine = left[[arms[run] is arm for run in runs[left]]]
            offset[mine] = settled_each(arm, batch.mode, q[mine])
            exact = np.linalg.norm(offset[mine], axis=1)
            far[mine] = np.where(np.isnan(exact), MOST, exact)
        return far, offset

    def _looked(self, steps: Steps) -> Brackets:
        """Return where plain functions cross zero."""
        joints = slice(0, self.batch.n)
        moved = np.abs(self.batch.changes(steps, joints)).max(axis=1, initial=0.0)
        pieces = 1 + np.minimum(moved / LOOK, 1e6).astype(np.int64)
        step = np.repeat(np.arange(len(pieces)), pieces)
        number = np.arange(len(step)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        start, length = steps.start[step], (steps.end - steps.start)[step]
        a = start + length * number / pieces[step]
        b = np.where(number + 1 == pieces[step], steps.end[step],
                     start + length * (number + 1) / pieces[step])  # fmt: skip
        now = self.batch.event_values(steps, step, b)
        before = _before(now, self.last, steps.run[step])
        crossed = ((before > 0.0) & (now <= 0.0)) | ((before < 0.0) & (now >= 0.0))
        look, which = np.nonzero(np.where(self.falling, (before >= 0.0) & (now < 0.0), crossed))
        return Brackets(step[look], self.plain[which], a[look], b[look], before[look, which],
                        now[look, which])  # fmt: skip

    def _neared(self, steps: Steps) -> Brackets:
        """Return where the distance to the singular set falls to `NEAR`.

        It is computed at the ends of steps; what these leave in doubt is halved.
        """
        every, joints = np.arange(len(steps.run)), slice(0, self.batch.n)
        q_a = self.batch.begins(steps, joints)
        q_b = q_a + self.batch.changes(steps, joints)
        value = self.away(steps.run, q_b)
        before, which = _before(value, self.clear, steps.run), np.repeat(self.near, len(every))
        doubtful = Brackets(every, which, steps.start, steps.end, before, value)
        found = []
        while True:
            falls = (doubtful.at_a >= 0.0) & (doubtful.at_b < 0.0)
            found.append(doubtful.only(falls))
            moved = np.linalg.norm((q_b - q_a) / self.radian, axis=1)
            open_ = ~falls & (moved > FINE * NEAR)
            open_ &= moved > SHARE * (np.abs(doubtful.at_a) + np.abs(doubtful.at_b))
            if not open_.any():
                return _joined(found)
            left = doubtful.only(open_)
            mid = 0.5 * (left.a + left.b)
            q = self.batch.states(steps, left.step, mid)[:, joints]
            at = self.away(steps.run[left.step], q)
            q_a, q_b = np.concatenate((q_a[open_], q)), np.concatenate((q, q_b[open_]))
            doubtful = _joined([left._replace(b=mid, at_b=at), left._replace(a=mid, at_a=at)])

    def _roots(self, steps: Steps, of: Brackets) -> Array:
        """Return the times (B,) at which functions cross zero."""
        near, found = self.distance[of.which], of.b.copy()
        bracket = np.column_stack(of[2:])
        if not near.all():
            which = np.searchsorted(self.plain, of.which[~near])
            found[~near] = self.batch.roots(steps, of.step[~near], which, bracket[~near])
        if near.any():
            step = of.step[near]
            inputs = {"i": steps.row[step].astype(float), "bracket": bracket[near]}
            found[near] = self.batch.compute(
                nearing, steps.run[step], inputs, self.numbers, steps.rows, lanes=WIDE, acts=False,
                most=LOOKS,
            )  # fmt: skip
        return found


def nearing(
    xp: Any, tree: Any, p: Any, *, i: Any, bracket: Any, rows: Any, most: int, **numbers: Any
) -> Any:
    """Compute when the distance to the singular set falls to `NEAR` in step i of rows.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        p: Its numbers.
        i: The number of the row.
        bracket: (4,) times before and after, and the values there.
        rows: The rows.
        most: As of `nearest`.
        numbers: As of `nearest`.
    """

    def value(t: Any) -> Any:
        q = state_of(xp.row(rows, i), t)[: tree.n]
        return nearest(xp, tree, p, q=q, most=most, **numbers)[0] - NEAR

    return crossing(xp, value, bracket, SHARPNESS)
