"""Runs from their start to their end: steps, outputs, events, and results."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Integers
from spacearm.equations.integration import COLLAPSED, FAILED, FINISHED, RUNNING, state_of
from spacearm.equations.measures import measures, nearest
from spacearm.equations.plant import (
    Observed,
    Parts,
    crossing,
    observe,
    torques,
    wheel_friction,
    wheel_torques,
)
from spacearm.errors import NoSolutionError, SpaceArmError
from spacearm.mechanics import distance
from spacearm.mechanics.arm_kernels import WIDE
from spacearm.mechanics.distance import FADING
from spacearm.mechanics.dynamics import forward_dynamics
from spacearm.mechanics.jacobian import drift_of
from spacearm.model.arguments import free_components
from spacearm.model.joints import joint_scales
from spacearm.motion import events
from spacearm.motion.batch import Batch, Steps
from spacearm.motion.controllers import Controller
from spacearm.motion.motion import Trajectory
from spacearm.motion.plant import Integration, Sampling
from spacearm.motion.system import Prepared, System, WantedEvent, motor_loads
from spacearm.singularities.nearest import local_offsets

#: Share of the distance to the singular set that the joints may move until it is computed anew.
SHARE = 0.2
#: Motion between two looks near the singular set, as a share of `NEAR`: a passage is 2 wide.
FINE = 0.5
#: Distances to the singular set from this on are not distinguished [rad].
MOST = 1.0
#: Most looks at the singular set until its nearest point rests, and how it then moves [rad].
LOOKS, AT_REST = 40, 1e-13


class Found(NamedTuple):
    """Events that were found.

    Attributes:
        run: (F,) numbers of the runs.
        which: (F,) numbers of the events.
        t: (F,) times [s].
        y: (F, states) states.
    """

    run: Integers
    which: Integers
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

    step: Integers
    which: Integers
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


def _before(values: Array, last: Array, run: Integers) -> Array:
    """Return the values before each of others, which runs have one after the other.

    Args:
        values: (L, ...) the values.
        last: (m, ...) those before the first of each run; the last ones are kept in it.
        run: (L,) numbers of the runs.
    """
    before = np.concatenate((values[-1:], values[:-1]))
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

    def __init__(self, batch: Batch, wanted: Sequence[WantedEvent], exact: bool) -> None:
        self.batch = batch
        self.distance = np.array([event.root is None for event in wanted], dtype=bool)
        self.plain, self.near = (np.flatnonzero(self.distance == near) for near in (False, True))
        self.falling = np.array([one.falling for one in wanted if one.root is not None], dtype=bool)
        self.moving = np.array([one.moving for one in wanted], dtype=np.bool_)
        self.radian = joint_scales(batch.arms[0])
        between = (
            (events.NEAR / events.DOUBTFUL, events.DOUBTFUL * events.NEAR)
            if exact
            else (np.inf, 0.0)
        )
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
            low = np.abs(self.last) <= events.ROUNDING
            true[:, self.plain] = np.where(self.falling, self.last < 0.0, low)
        if len(self.near):
            self.clear = self.away(steps.run, batch.y[:, : batch.n])
            true[:, self.near] = self.clear[:, None] < 0.0
        run, which = np.nonzero(true & ~self.moving)
        return Found(run, which, batch.t[run], batch.y[run])

    def within(self, steps: Steps) -> Found:
        """Return the events in steps, in order, run by run."""
        parts = [self._looked(steps)] if len(self.plain) else []
        found = _joined([*parts, self._neared(steps)] if len(self.near) else parts)
        if not len(found.step):
            return Found(found.step, found.which, found.a, self.batch.y[found.step])
        t = self._roots(steps, found)
        order = np.lexsort((found.which, t, steps.run[found.step]))
        step, t = found.step[order], t[order]
        y = self.batch.states(steps, step, t)
        return Found(steps.run[step], found.which[order], t, y)

    def away(self, runs: Integers, q: Array) -> Array:
        """Compute the distance (L,) to the singular set less `NEAR`, at most `MOST` of it.

        Args:
            runs: (L,) numbers of the runs.
            q: (L, n) joint positions.
        """
        return np.minimum(self.nearest(runs, q)[0], MOST) - events.NEAR

    def nearest(self, runs: Integers, q: Array) -> tuple[Array, Array]:
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
            offset[mine] = local_offsets(arm, batch.mode, q[mine])
            exact = np.linalg.norm(offset[mine], axis=1)
            far[mine] = np.where(np.isnan(exact), MOST, exact)
        return far, offset

    def _looked(self, steps: Steps) -> Brackets:
        """Return where plain functions cross zero."""
        joints = slice(0, self.batch.n)
        moved = np.abs(self.batch.changes(steps, joints)).max(axis=1, initial=0.0)
        pieces = 1 + np.minimum(moved / events.LOOK, 1e6).astype(np.int64)
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
            open_ = ~falls & (moved > FINE * events.NEAR)
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
        return nearest(xp, tree, p, q=q, most=most, **numbers)[0] - events.NEAR

    return crossing(xp, value, bracket, events.SHARPNESS)


#: Samples of a controller of fixed rate between two reports of progress.
REPORT = 50
#: Share of the period of a controller up to which two instants are the same but for rounding.
SAME = 1e-9
#: How far beyond the last state it is looked for what failed [s].
PROBES = np.append(0.0, np.geomspace(1e-15, 1e-3, 13))

Progress = Callable[[float, float], object] | None


class Sensors:
    """What a sampled controller is given of the states of runs.

    Args:
        sampling: With the noise.
        runs: The numbers of the runs, each with a noise of its own.
        at: Where the parts of a state stand.
    """

    def __init__(self, sampling: Sampling, runs: Sequence[int], at: Parts) -> None:
        self.noise, self.gyro = np.split(sampling.noise(at.q.stop), [-3])
        self.at = at
        self.random = [np.random.default_rng(sampling.seed + run) for run in runs]

    def measured(self, runs: Integers, y: Array) -> Array:
        """Return states (r, states) with noise, those of some of the runs."""
        if not self.noise.any():
            return y
        n, seen = self.at.q.stop, y.copy()
        off = self.noise * [self.random[run].normal(size=2 * n + 3) for run in runs]
        seen[:, self.at.q] += off[:, :n]
        seen[:, self.at.dq] += off[:, n : 2 * n]
        for row, turn in zip(seen, off[:, 2 * n :], strict=True):
            attitude = pin.Quaternion(row[self.at.attitude]) * pin.Quaternion(pin.exp3(turn))
            row[self.at.attitude] = attitude.coeffs()
        return seen

    def gyro_errors(self, runs: Integers) -> Array:
        """Return the errors (r, 3) of measured angular velocities, those of some of the runs."""
        if not self.gyro.any():
            return np.zeros((len(runs), 3))
        return self.gyro * [self.random[run].normal(size=3) for run in runs]


class Runs:
    """Runs of one kind, side by side.

    Args:
        systems: What is simulated, of each run; arms of one structure.
        prepared: Their numbers and functions; all of one setup.
        t: (o,) times of the outputs, the end left out [s].
        duration: The end [s].
        how: Tolerances and method.
        numbers: Their numbers, of the noise of sensors; from 0 on if None.
        recorded: Whether trajectories are asked for: the torques of sampled laws are kept then.
    """

    def __init__(
        self,
        systems: Sequence[System],
        prepared: Sequence[Prepared],
        t: Array,
        duration: float,
        how: Integration,
        numbers: Sequence[int] | None = None,
        *,
        recorded: bool = True,
    ) -> None:
        m, first = len(systems), systems[0]
        self.numbers = range(m) if numbers is None else numbers
        self.systems, self.times, self.duration = systems, t, duration
        self.batch = Batch(systems, prepared, how)
        self.wanted, self.called = prepared[0].wanted, prepared[0].notes
        self.batch.dense = bool(self.wanted) or len(t) > 1
        self.exact = events.is_exact(first.arm)
        self.crossings = Crossings(self.batch, self.wanted, self.exact)
        self.outputs = np.repeat(self.batch.y[:, None], len(t) + 1, axis=1)
        self.written = np.zeros(m, np.int64)
        self.at = first.parts
        self.events: list[list[events.Event]] = [[] for _ in range(m)]
        self.recorded = recorded
        self.torques: list[tuple[float, Array]] = []
        self.memory = np.array([system.memory for system in systems])
        self.ended, self.fault = ["duration"] * m, [""] * m
        self._begun = False

    def _begin(self) -> None:
        """Note the events and the output of the start."""
        self._begun = True
        if len(self.times) and self.times[0] <= 0.0:
            self.outputs[:, 0], self.written[:] = self.batch.y, 1
        if self.wanted:
            self._note(self.crossings.at_start(), None)

    def advance(self, end: float, progress: Progress = None) -> None:
        """Go on to a time, or to what ends the runs before."""
        batch = self.batch
        try:
            if not self._begun:
                self._begin()
            for steps in batch.advance(end):
                if self.wanted and len(steps.run):
                    self._note(self.crossings.within(steps), steps)
                self._write(steps)
                if progress:
                    going = np.isin(batch.status, (RUNNING, FINISHED))
                    progress(float(np.where(going, batch.t, self.duration).mean()), self.duration)
        except KeyboardInterrupt:
            self._interrupt()
        if batch.outside.interrupted:
            self._interrupt()
        for run in np.flatnonzero((batch.status == FAILED) | (batch.status == COLLAPSED)):
            if not self.fault[run] and self.ended[run] == "duration":
                self._fail(int(run))

    def _interrupt(self) -> None:
        self.ended = ["interrupted" if e == "duration" else e for e in self.ended]

    def advance_sampled(self, end: float, sampling: Sampling, progress: Progress) -> None:
        """Go on with torques that are sampled, act after a delay and are then held."""
        batch, period, k, t = self.batch, sampling.period, 0, 0.0
        hold = self.systems[0].hold
        wheels = len(self.systems[0].arm.wheels) if hold and hold.sampled else 0
        batch.held = np.zeros((len(batch), batch.n + wheels))
        sensors = Sensors(sampling, self.numbers, self.at)
        waiting: deque[tuple[float, Array]] = deque()
        while t < end and len(going := np.flatnonzero(np.array(self.ended) == "duration")):
            due = waiting[0][0] if waiting else np.inf
            until = min(k * period, due, end)
            if until > t + SAME * period:
                batch.stiff[:] = 0.0
                self.advance(until, progress if k % REPORT == 0 else None)
                going = np.flatnonzero(np.array(self.ended) == "duration")
            t = until
            if k * period <= t + SAME * period and t < end and len(going):
                tau = np.zeros_like(batch.held)
                seen = {"t": batch.t[going], "y": sensors.measured(going, batch.y[going])}
                if self.memory.size:
                    seen["memory"] = self.memory[going]
                asked = batch.compute(torques, going, seen)
                for run in going[~np.isfinite(asked).all(axis=1)]:
                    batch.status[run] = FAILED
                    self._fail(int(run))
                tau[going, : batch.n], self.memory[going] = np.split(asked, [batch.n], axis=1)
                if hold and hold.sampled:
                    there = {"t": batch.t[going], "y": batch.y[going], "measured": seen["y"]}
                    there["gyro"] = sensors.gyro_errors(going)
                    turning = batch.compute(wheel_torques, going, there)
                    tau[going, batch.n :] = hold.quantised(turning)
                waiting.append((k * period + sampling.delay, tau))
                k += 1
            while waiting and waiting[0][0] <= t + SAME * period:
                _, batch.held = waiting.popleft()
                if self.recorded:
                    self.torques.append((t, batch.held))

    def _note(self, found: Found, steps: Steps | None) -> None:
        """Note events in the order of their times; end the runs that some of them stop."""
        for run, which, t, y in zip(*found, strict=True):
            if self.ended[run] != "duration":
                continue
            wanted = self.wanted[which]
            q = y[: self.batch.n].copy()
            near = None
            if len(self.systems) == 1 and wanted.root is None and self.exact:
                offset = self.crossings.nearest(np.array([run]), q[None])[1][0]
                near = None if np.isnan(offset).any() else q + self.crossings.radian * offset
            self.events[run].append(events.Event(float(t), wanted.kind, q, wanted.detail, near))
            if wanted.stops:
                self.ended[run] = wanted.kind
                self.batch.stop(int(run), float(t), y, steps)

    def _write(self, steps: Steps) -> None:
        """Write the states at the output times in steps, up to the ends of their runs."""
        first = np.searchsorted(self.times, steps.start, side="right")
        last = np.searchsorted(self.times, np.minimum(steps.end, self.batch.t[steps.run]), "right")
        count = np.maximum(last - first, 0)
        step = np.repeat(np.arange(len(count)), count)
        output = np.arange(len(step)) - np.repeat(np.cumsum(count) - count - first, count)
        run = steps.run[step]
        self.outputs[run, output] = self.batch.states(steps, step, self.times[output])
        np.maximum.at(self.written, steps.run, last)

    def _fail(self, run: int) -> None:
        """Note why the integrator stopped a run."""
        batch = self.batch
        t, y = float(batch.t[run]), batch.y[run]
        if batch.status[run] == COLLAPSED:
            self.ended[run] = "step collapsed"
            self.fault[run] = (
                f"the step size collapsed at t = {t:.6g} s: the torques jump or are too stiff; "
                "smooth them or lower the gains"
            )
            return
        self.ended[run], error = self._failure(run, t, y)
        if isinstance(error, KeyboardInterrupt):
            self.ended[run] = "interrupted"
        elif isinstance(error, SpaceArmError):
            q = ", ".join(f"{x:.6g}" for x in y[: batch.n])
            self.fault[run] = f"at t = {t:.6g} s, q = ({q}): {error}"
        else:
            raise error

    def _failure(self, run: int, t: float, y: Array) -> tuple[str, BaseException]:
        """Return what fails right beyond a state, a law or the equations, and its error."""
        failed, n, system = "controller failed", self.batch.n, self.systems[run]
        if error := self.batch.outside.errors[run]:
            return failed, error
        dq = y[n : 2 * n]
        for ahead in PROBES:
            there = y.copy()
            there[:n] += ahead * dq
            cfg = system.configuration(there)
            try:
                for law, memory in self._remembering(run):
                    law(t + ahead, cfg, dq, *memory)
            except SpaceArmError as error:
                return failed, error
        try:
            forward_dynamics(system.configuration(y), dq, np.zeros(n), mode=system.mode)
        except SpaceArmError as error:
            return "equations failed", error
        what = "torque or memory" if self.memory.size else "torque"
        return failed, NoSolutionError(f"the controller's {what} is not finite", None)

    def _remembering(self, run: int) -> Iterator[tuple[Controller, list[Array]]]:
        """Return the laws of a run, each with its memory if it has one."""
        system, first = self.systems[run], 0
        for law, start in zip(system.controllers.values(), system.memories, strict=True):
            last = first + len(start)
            yield law, [self.memory[run, first:last].copy()] if len(start) else []
            first = last

    def finish(self) -> None:
        """Write the ends as the last outputs."""
        every, last = np.arange(len(self.batch)), self.written - 1
        times = np.append(self.times, np.inf)
        more = (last < 0) | (times[np.maximum(last, 0)] < self.batch.t)
        self.written[more] += 1
        self.outputs[every[more], self.written[more] - 1] = self.batch.y[more]

    def _times(self, run: int) -> Array:
        """Return the times of all outputs of a run."""
        return np.append(self.times[: self.written[run] - 1], self.batch.t[run])

    def trajectory(self, run: int = 0) -> Trajectory:
        """Return the trajectory of a run so far."""
        self.finish()
        batch, system, at = self.batch, self.systems[run], self.at
        t, Y = self._times(run), self.outputs[run, : self.written[run]]
        given = {"t": t, "y": Y}
        if batch.held is not None:
            times = np.array([time for time, _ in self.torques])
            before = np.zeros(batch.held.shape[1])
            held = np.array([before, *(tau[run] for _, tau in self.torques)])
            given["held"] = held[np.searchsorted(times, t, side="right")]
        seen = Observed(*batch.compute(observe, np.full(len(t), run, np.int64), given))
        base, kept = seen.base, seen.momentum
        friction = wheel_friction(np, Y[:, at.wheels], system.plant.friction_of_wheels.numbers)
        wheel_torque = seen.spin - friction
        if system.mode == "fixed":
            base = np.tile(base[0], (len(t), 1))
        impulse, free = Y[:, at.momentum] - Y[0, at.momentum], free_components(system.mode)
        kept[:, :free] += (Y[0, at.momentum] - kept[0])[:free]  # as it was given, not rounded
        self.drift = drift_of(kept, impulse, seen.brought, free)
        works = Y[:, at.works]
        return Trajectory(
            arm=system.arm,
            mode=system.mode,
            t=t,
            q=(q := Y[:, at.q]),
            dq=Y[:, at.dq].copy(),
            base=base,
            ddq=seen.ddq,
            torque=seen.torque,
            momentum=kept,
            impulse=impulse,
            wrenches=system.acting(t, q, base) if system.plant.pushed else {},
            wheels=Y[:, at.wheels].copy(),
            wheel_torque=wheel_torque,
            wheel_friction=friction,
            energy=seen.energy,
            work=works[:, 0].copy(),
            other_work=works[:, 1:].sum(axis=1),
            exchanged=float(batch.exchanged[run]),
            motors=motor_loads(system, t, Y[:, at.dq], seen.torque, wheel_torque),
            events=tuple(self.events[run]),
            ended=self.ended[run],
            called=self.called,
        )

    def summary(self, distance: bool) -> dict[str, Any]:
        """Return what `simulate_many` keeps of the runs, with the `distance` or without."""
        self.finish()
        batch, n, at, m = self.batch, self.batch.n, self.at, len(self.batch)
        every, last = np.arange(m), self.written - 1
        number = np.arange(self.outputs.shape[1])
        used = number <= last[:, None]
        runs = np.nonzero(used)[0]
        sigma, turn = np.full(used.shape, np.inf), np.zeros(used.shape)
        q = {"q": self.outputs[used][:, :n]}
        (sigma[used],) = batch.compute(measures, runs, q, acts=False, names=("sigma_min",))
        attitude = self.outputs[:, :, at.attitude]
        unit = attitude / np.linalg.norm(attitude, axis=2, keepdims=True)
        cosine = np.abs((unit * unit[:, :1]).sum(axis=2))
        turn[used] = 2.0 * np.arccos(np.minimum(cosine[used], 1.0))
        ends = np.stack((self.outputs[:, 0], self.outputs[every, last]), axis=1)
        t = np.stack((np.zeros(m), batch.t), axis=1)
        given = {"t": t.ravel(), "y": ends.reshape(2 * m, -1)}
        if batch.held is not None:
            given["held"] = np.zeros((2 * m, batch.held.shape[1]))  # the energy needs no torques
        seen = Observed(*batch.compute(observe, np.repeat(every, 2), given))
        energy, works = seen.energy.reshape(m, 2), ends[:, 1, at.works].sum(axis=1)
        turnover = energy.max(axis=1) + batch.exchanged
        off = np.abs(energy[:, 1] - energy[:, 0] - works)
        first = {kind: [min((e.t for e in found if e.kind == kind), default=np.nan)
                        for found in self.events] for kind in events.EVENTS}  # fmt: skip
        target = np.array(first["target"])
        return {
            "success": ~np.isnan(target),
            "time_to_target": target,
            "first_singularity": np.array(first["singularity"]),
            "sigma_min": sigma.min(axis=1),
            "turn": turn.max(axis=1),
            "distance": self._least_distances(used) if distance else np.full(m, np.nan),
            "t": batch.t,
            "ended": np.array(self.ended, dtype=object),
            "imbalance": np.divide(off, turnover, out=np.zeros(m), where=turnover > 0.0),
            "q": ends[:, 1, at.q],
            "dq": ends[:, 1, at.dq],
            "base": seen.base[1::2],
        }

    def _least_distances(self, used: Any) -> Array:
        """Return the least distance of all outputs of each run from the singular set [rad]."""
        found, arms = np.full(used.shape, np.inf), self.batch.arms
        for arm in dict.fromkeys(arms):
            mine = used & np.array([other is arm for other in arms])[:, None]
            Q = self.outputs[mine][:, : arm.n]
            found[mine] = distance.distances(arm, Q, self.systems[0].mode)[0]
        return found.min(axis=1)
