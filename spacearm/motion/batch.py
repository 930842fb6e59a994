"""Runs of one kind side by side, stepped by machine code: one or many.

The steps are kept as rows; outputs and events are looked for in them afterwards.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from spacearm.arrays import Array, Booleans, Integers
from spacearm.equations import integration
from spacearm.equations import plant as equations
from spacearm.mechanics.arm_kernels import ArmKernel
from spacearm.model.arguments import BaseMode
from spacearm.motion.events import SHARPNESS
from spacearm.motion.plant import Integration
from spacearm.motion.system import Prepared, System

#: Steps of a call of the integrator.
STEPS = 128
#: The step has collapsed when `PACE` of them are shorter than `SLOW` in the mean [s].
SLOW, PACE = 1e-5, 1000
#: Status of a run that an event ended.
ENDED = 10
#: What is known of where a run stands besides its state.
NOW = tuple(name for name in integration.RunState._fields if name != "y")


class Method(NamedTuple):
    """How steps are taken, as `integration.advance` has it."""

    implicit: bool
    dense: bool
    coupled: int


class Steps(NamedTuple):
    """Accepted steps, those of one run one after the other.

    Attributes:
        run: (K,) numbers of their runs.
        start: (K,) times at which they begin [s].
        end: (K,) times at which they end [s].
        row: (K,) numbers of their rows.
        rows: (R, 2 + 8 N) as `integration.advance` keeps them, of what is integrated; written anew
            when the runs go on.
    """

    run: Integers
    start: Array
    end: Array
    row: Integers
    rows: Array


@lru_cache(maxsize=64)
def integrated(setup: equations.Setup, n: int, mode: BaseMode) -> tuple[int, ...]:
    """Return which components of the state change at all; the works are the last."""
    at = equations.parts(n, len(setup.wheels))
    turned = bool(setup.wheels) and (setup.holds or setup.drag or setup.motors is not None)
    changes = (
        (at.q, True), (at.dq, True), (at.attitude, mode == "free-floating"),
        (at.com, mode != "fixed"), (at.momentum, bool(setup.pushed)), (at.wheels, turned),
    )  # fmt: skip
    found = [i for part, used in changes if used for i in range(part.start, part.stop)]
    works = (True, setup.passive, bool(setup.pushed), turned)
    return (*found, *(at.works.start + i for i, used in enumerate(works) if used))


def advanced(
    xp: Any, tree: Any, p: Any, *, now: Any, y: Any, laws: Any, plant: Any, limits: Any,
    setup: equations.Setup, method: Method, held: Any = None, **calls: Any,
) -> Any:  # fmt: skip
    """Take steps of runs; see `integration.advance`. Compiled for the lanes.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        p: Its numbers.
        now: (7,) where the run stands, see `NOW`.
        y: (states,) its state.
        laws: The numbers of the laws.
        plant: The other numbers.
        limits: (4,) relative and absolute tolerance, 1 if the method may change, the end.
        setup: What else is known.
        method: How steps are taken.
        held: As in `equations.plant.state_rate`.
        calls: The functions outside.

    Returns:
        (7 + N,) where the run stands, and what is integrated; the rows of the steps.
    """
    moving = np.array(integrated(setup, tree.n, tree.mode))
    rtol, atol, switches, end = limits

    def rate(t: Any, z: Any) -> Any:
        whole = _whole(xp, z, y, moving)
        dy = equations.state_rate(
            xp, tree, p, t, whole, laws, plant, setup=setup, held=held, **calls
        )
        return dy[moving]

    counted, N = 2 * tree.n + 5, len(moving)
    problem = integration.Problem(rtol, atol, counted, tree.n, min(method.coupled, N))
    start = integration.RunState(y=y[moving], **dict(zip(NOW, now, strict=True)))
    found, rows = integration.advance(
        xp, rate, problem, start, end, most=STEPS, implicit=method.implicit,
        switches=switches, dense=method.dense,
    )  # fmt: skip
    reached = xp.stack([getattr(found, name) for name in NOW])
    return xp.concatenate([reached, found.y]), rows


def states_within(xp: Any, _tree: Any, _p: Any, *, i: Any, t: Any, rows: Any) -> Any:
    """Compute what is integrated at a time in step i of rows."""
    return integration.state_of(xp.row(rows, i), t)


def events_within(
    xp: Any, tree: Any, p: Any, *, i: Any, t: Any, y: Any, laws: Any, plant: Any, rows: Any,
    setup: equations.Setup, **calls: Any,
) -> Any:  # fmt: skip
    """Compute the event functions (e,) at a time in step i of rows."""
    moving = np.array(integrated(setup, tree.n, tree.mode))
    whole = _whole(xp, integration.state_of(xp.row(rows, i), t), y, moving)
    return equations.event_values(xp, tree, p, t, whole, laws, plant, setup=setup, **calls)


def roots_within(
    xp: Any, tree: Any, p: Any, *, i: Any, which: Any, bracket: Any, y: Any, laws: Any, plant: Any,
    rows: Any, setup: equations.Setup, **calls: Any,
) -> Any:  # fmt: skip
    """Compute when one event function crosses zero in step i of rows.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        p: Its numbers.
        i: The number of the row.
        which: The number of the function.
        bracket: (4,) times before and after, and the values there.
        y: (states,) the state, as far as it stays.
        laws: The numbers of the laws.
        plant: The other numbers.
        rows: The rows.
        setup: What else is known.
        calls: The functions outside.
    """

    def value(t: Any) -> Any:
        found = events_within(
            xp, tree, p, i=i, t=t, y=y, laws=laws, plant=plant, rows=rows, setup=setup, **calls
        )
        return sum(xp.where(xp.absolute(which - k) < 0.5, found[k], 0.0) for k in range(len(found)))

    return equations.crossing(xp, value, bracket, SHARPNESS)


def _whole(xp: Any, z: Any, y: Any, moving: Any) -> Any:
    """Return a state (states,) from what is integrated, and what stays."""
    place = {int(i): k for k, i in enumerate(moving)}
    return xp.stack([z[place[i]] if i in place else y[i] for i in range(len(y))])


class Batch:
    """Runs of one kind.

    Args:
        systems: What is simulated, of each run; arms of one structure.
        prepared: The numbers and functions of each run; all of one setup.
        how: Tolerances and method.

    Attributes:
        coupled: How many leading components of what is integrated its rate depends on.
        dense: Whether states within steps are wanted.
    """

    def __init__(
        self, systems: Sequence[System], prepared: Sequence[Prepared], how: Integration
    ) -> None:
        m, first, self.setup = len(systems), systems[0], prepared[0].setup
        self.arms, self.mode, self.n = [one.arm for one in systems], first.mode, first.arm.n
        self.moving, at = np.array(integrated(self.setup, self.n, self.mode)), first.parts
        works = (self.moving >= at.works.start) & (self.moving < at.works.stop)
        self.works = slice(int(works.argmax()), len(self.moving))
        most = max(one.coupled(self.setup) for one in systems)
        self.coupled = int((self.moving[: self.works.start] < most).sum())
        self.tolerances = how.rtol, how.atol, float(how.method == "auto")
        self.now, self.y = np.zeros((m, len(NOW))), np.array([one.state for one in systems])
        self.t, self.h, self.status, self.stiff, self.holdoff, self.eigenvalue, _ = self.now.T
        self.implicit = np.full(m, how.method == "Rodas5P")
        self.longest_holdoff = np.full(m, float(integration.HOLDOFF))
        self.steps, self.exchanged = np.zeros(m, np.int64), np.zeros(m)
        self._marks = np.zeros((2, m))
        self.held: Array | None = None
        self.dense = True
        self.outside = Outside(prepared, self.y.shape[1])
        self._compiled: dict[Any, _Compiled] = {}
        self._rows = np.empty((m, STEPS, 2 + 8 * len(self.moving)))
        self._laws = np.array([p.laws for p in prepared]).reshape(m, -1)
        self._plant = np.array([p.plant for p in prepared]).reshape(m, -1)

    @property
    def running(self) -> Booleans:
        """Whether each run goes on."""
        return self.status == integration.RUNNING

    def __len__(self) -> int:
        return len(self.t)

    def compute(
        self,
        function: Callable[..., Any], runs: Integers, inputs: Mapping[str, Array],
        numbers: Mapping[str, Array | float] | None = None, rows: Array | None = None, *,
        out: Sequence[Array | None] = (), lanes: int | None = None, acts: bool = True,
        **options: Any,
    ) -> Any:  # fmt: skip
        """Compute a function for lanes of some runs; compiled when first needed.

        Args:
            function: The function, of the arm and what follows.
            runs: (lanes,) numbers of the runs.
            inputs: What it takes of each lane besides the numbers of laws and plant, by name.
            numbers: What all lanes share.
            rows: A table of that name, if it takes one.
            out: Where to write what it returns.
            lanes: Number of lanes side by side; one if functions outside are called.
            acts: Whether it takes numbers and functions of laws and plant.
            options: What is known while tracing.
        """
        key = function, *options.values()
        tables = {} if rows is None else {"rows": rows}
        if (found := self._compiled.get(key)) is None:
            found = self._compiled[key] = self._compile(function, lanes, acts, options)
        inputs = {**inputs, **{name: values[runs] for name, values in found.each.items()}}
        called = self.outside.called(runs, found.calls) if found.calls else None
        shared = {**found.shared, **(numbers or {})}
        return found.kernel(inputs, shared, tables, runs, outside=called, out=out)

    def _compile(
        self, function: Callable[..., Any], lanes: int | None, acts: bool, options: dict[str, Any]
    ) -> _Compiled:
        """Return a function compiled, with the numbers of laws and plant that it takes."""
        shared: dict[str, Array] = {}
        each: dict[str, Array] = {}
        calls: dict[str, int] = {}
        if acts:
            watches = function in (events_within, roots_within)
            setup = self.setup if watches else self.setup._replace(events=())
            bounds = len(self.setup.events) - len(setup.events)
            plant = self._plant[:, : self._plant.shape[1] - bounds]
            for name, values in (("laws", self._laws), ("plant", plant)):
                same = len(self) == 1 or (values == values[0]).all()
                (shared if same else each)[name] = values[0] if same else values
            calls, options = dict(setup.called(self.n)), {"setup": setup, **options}
        arms = self.arms[:1] if function is states_within else self.arms
        kernel = ArmKernel(
            arms, self.mode, function, options, outside=calls, lanes=1 if calls else lanes
        )
        return _Compiled(kernel, calls, shared, each)

    def standing(self) -> Steps:
        """Return steps in which the runs stay where they are."""
        every, z = np.arange(len(self)), self.y[:, self.moving]
        rows = np.zeros((len(self), self._rows.shape[2]))
        rows[:, 1], rows[:, 2 : 2 + z.shape[1]] = 1.0, z
        return Steps(every, self.t.copy(), self.t.copy(), every, rows)

    def advance(self, end: float) -> Iterator[Steps]:
        """Go on to a time, or to what ends the runs before; yield the steps in turn.

        Between two of them runs may be ended by setting their status.
        """
        self.status[(self.status == integration.FINISHED) & (self.t < end)] = integration.RUNNING
        while True:
            for implicit in (False, True):
                runs = np.flatnonzero(self.running & (self.implicit == implicit))
                if len(runs):
                    steps = self._advance(runs, end, implicit)
                    yield steps
                    self._check_pace(runs)
            if self.outside.interrupted or not self.running.any():
                return

    def _advance(self, runs: Integers, end: float, implicit: bool) -> Steps:
        """Take steps of some runs that go on."""
        inputs = {"now": self.now[runs], "y": self.y[runs]}
        if self.held is not None:
            inputs["held"] = self.held[runs]
        written = self._rows[: len(runs)]
        found, _ = self.compute(
            advanced, runs, inputs, {"limits": np.array([*self.tolerances, end])},
            out=(None, written), lanes=1 if len(self) == 1 else None,
            method=Method(implicit, implicit or self.dense, self.coupled),
        )  # fmt: skip
        self.now[runs], self.y[runs[:, None], self.moving] = (
            found[:, : len(NOW)],
            found[:, len(NOW) :],
        )
        turns = found[:, len(NOW) - 1]
        if len(changing := runs[self.status[runs] == integration.CHANGES]):
            self._change(changing)
        lane, turn = np.nonzero((np.arange(STEPS) < turns[:, None]) & (written[:, :, 1] > 0.0))
        run, row, rows = runs[lane], lane * STEPS + turn, written.reshape(-1, written.shape[2])
        start = rows[row, 0]
        last = np.append(run[1:] != run[:-1], True)[: len(run)]
        ends = np.where(last, self.t[run], np.append(start[1:], 0.0)[: len(run)])
        steps = Steps(run, start, ends, row, rows)
        self.steps += np.bincount(run, minlength=len(self))
        gone = np.abs(self.changes(steps, self.works)).sum(axis=1)
        self.exchanged += np.bincount(run, gone, minlength=len(self))
        return steps

    def _change(self, runs: Integers) -> None:
        """Go over to the other method: from stiff steps, and back, each time for longer."""
        self.status[runs] = integration.RUNNING
        self.stiff[runs] = 0.0
        back = runs[self.implicit[runs]]
        self.holdoff[back] = self.longest_holdoff[back]
        self.longest_holdoff[back] = np.minimum(
            2.0 * self.longest_holdoff[back], 100.0 * integration.HOLDOFF
        )
        limited = back[self.eigenvalue[back] > 0.0]
        self.h[limited] = np.minimum(self.h[limited], integration.STABLE / self.eigenvalue[limited])
        self.implicit[runs] = ~self.implicit[runs]

    def _check_pace(self, runs: Integers) -> None:
        """Stop runs whose steps have become too short."""
        due = runs[self.steps[runs] - self._marks[0, runs] >= PACE]
        slow = due[self.t[due] - self._marks[1, due] < PACE * SLOW]
        self.status[slow[self.status[slow] == integration.RUNNING]] = integration.COLLAPSED
        self._marks[0, due], self._marks[1, due] = self.steps[due], self.t[due]

    def begins(self, steps: Steps, of: slice) -> Array:
        """Return some components (K, ...) of what is integrated at the beginnings of steps."""
        return steps.rows[:, 2 + of.start : 2 + of.stop][steps.row]

    def changes(self, steps: Steps, of: slice) -> Array:
        """Return by how much they change in the steps."""
        first = 2 + len(self.moving)
        return steps.rows[:, first + of.start : first + of.stop][steps.row]

    def states(self, steps: Steps, i: Integers, t: Array) -> Array:
        """Return the states (L, states) at times t (L,) within steps i (L,)."""
        y = self.y[steps.run[i]]
        if len(i):
            at = {"i": steps.row[i].astype(float), "t": t}
            y[:, self.moving] = self.compute(
                states_within, steps.run[i], at, rows=steps.rows, acts=False
            )
        return y

    def event_values(self, steps: Steps, i: Integers, t: Array) -> Array:
        """Return the event functions (L, e) at times t (L,) within steps i (L,)."""
        return self._of_events(events_within, steps, i, t=t)

    def roots(self, steps: Steps, i: Integers, which: Integers, bracket: Array) -> Array:
        """Return the times (L,) at which event functions cross zero; see `roots_within`."""
        return self._of_events(roots_within, steps, i, which=which.astype(float), bracket=bracket)

    def _of_events(
        self, function: Callable[..., Any], steps: Steps, i: Integers, **given: Array
    ) -> Array:
        """Compute a function of events within steps i (L,)."""
        runs = steps.run[i]
        inputs = {"i": steps.row[i].astype(float), "y": self.y[runs], **given}
        return self.compute(function, runs, inputs, rows=steps.rows)

    def stop(self, run: int, t: float, y: Array, steps: Steps | None) -> None:
        """End a run at an event in one of these steps, or at the start, where its state is y."""
        if steps is not None:
            mine = (steps.run == run) & (steps.end >= t)
            whole = np.abs(self.changes(steps, self.works)[mine]).sum(axis=1)
            begun = self.begins(steps, self.works)[mine]
            part = np.abs(y[self.moving][self.works] - begun).sum(axis=1)
            begins = steps.start[mine] <= t
            self.exchanged[run] += np.where(begins, part, 0.0).sum() - whole.sum()
            self.steps[run] -= int((~begins).sum())
        self.t[run], self.y[run], self.status[run] = t, y, ENDED


class _Compiled(NamedTuple):
    """A compiled function of runs.

    Attributes:
        kernel: The machine code.
        calls: The functions outside that it calls, and how many numbers each gives.
        shared: The numbers of laws and plant that all runs share.
        each: Those that each run has its own of.
    """

    kernel: ArmKernel
    calls: Mapping[str, int]
    shared: Mapping[str, Array]
    each: Mapping[str, Array]


class Outside:
    """The functions outside that runs call, and the error that the last call of each run raised.

    After an error the integrator tries shorter steps, so that the run gets as near to it as it can;
    an interrupt ends all runs at once.

    Args:
        prepared: The runs.
        states: Length of a state, which users' laws and events are given. Laws with a memory are
            given it after the state.
    """

    def __init__(self, prepared: Sequence[Prepared], states: int) -> None:
        setup, self.functions = prepared[0].setup, [one.outside for one in prepared]
        self.given = dict.fromkeys(self.functions[0], 1)
        self.given |= {f"event{i}": 1 + states for i in range(len(setup.events))}
        for i, law in enumerate(setup.laws):
            if law.kind == "own":
                self.given[law.name(i)] = 1 + states + law.memory
        self.errors: list[BaseException | None] = [None] * len(prepared)
        self.interrupted = False
        self._views: dict[tuple[int, int], Array] = {}

    def called(self, runs: Integers, counts: Mapping[str, int]) -> dict[str, Callable[..., None]]:
        """Return the functions as a kernel calls them whose lanes are of these runs.

        Args:
            runs: (lanes,) numbers of the runs.
            counts: How many numbers each gives.
        """
        return {name: self._of(name, runs, count) for name, count in counts.items()}

    def _of(self, name: str, runs: Integers, count: int) -> Callable[..., None]:

        def call(lane: int, values: Any, results: Any) -> None:
            given, out = self._view(values, self.given[name]), self._view(results, 1 + count)
            run = int(runs[lane])
            out[0] = 1.0
            if self.interrupted or not np.isfinite(given).all():  # what an error before has left
                return
            try:
                out[1:] = np.ravel(self.functions[run][name](float(given[0]), given[1:]))
            except BaseException as error:
                self.errors[run] = error
                self.interrupted = not isinstance(error, Exception)
                return
            self.errors[run] = None
            out[0] = 0.0

        return call

    def _view(self, pointer: Any, size: int) -> Array:
        """Return numbers at an address as an array."""
        key = ctypes.addressof(pointer.contents), size
        if key not in self._views:
            self._views[key] = np.ctypeslib.as_array(pointer, (size,))
        return self._views[key]
