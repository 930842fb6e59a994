"""Runs of one kind side by side, stepped by machine code: one or many.

The steps are kept as rows; outputs and events are looked for in them afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.equations import integration
from spacearm.equations import plant as equations
from spacearm.equations.integration import (
    CHANGES,
    COLLAPSED,
    FINISHED,
    PATIENCE,
    RUNNING,
    STABLE,
)
from spacearm.mechanics.many import arms_kernel
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.motion.runs.outside import Outside
from spacearm.motion.runs.setup import Prepared

STEPS = 64
"""Steps of a call of the integrator."""
SLOW, PACE = 1e-5, 1000
"""The step has collapsed when `PACE` of them are shorter than `SLOW` in the mean [s]."""
Whole = npt.NDArray[np.int64]
ENDED = 10
"""Status of a run that an event ended."""


class Steps(NamedTuple):
    """Accepted steps, those of one run one after the other.

    Attributes:
        run: (K,) numbers of their runs.
        start: (K,) times at which they begin [s].
        end: (K,) times at which they end [s].
        rows: (K, 2 + 8 N) as `integration.advance` keeps them, of what is integrated.
    """

    run: Whole
    start: Array
    end: Array
    rows: Array


@lru_cache(maxsize=64)
def integrated(setup: equations.Setup, n: int, mode: BaseMode) -> tuple[int, ...]:
    """Return which components of the state change at all; the works are the last."""
    at = equations.parts(n, len(setup.wheels))
    found = [*_numbers(at.q), *_numbers(at.dq)]
    if mode == "free-floating":
        found += _numbers(at.attitude)
    if mode != "fixed":
        found += _numbers(at.com)
    if setup.pushed:
        found += _numbers(at.momentum)
    turned = setup.holds or setup.motors is not None
    if setup.wheels and turned:
        found += _numbers(at.wheels)
    wanted = (True, bool(setup.passive), bool(setup.pushed), bool(setup.wheels and turned))
    return (*found, *(i for i, used in zip(_numbers(at.works), wanted, strict=True) if used))


def _numbers(of: slice) -> list[int]:
    return list(range(of.start, of.stop))


def advanced(
    xp: Any, tree: Any, p: Any, *, t: Any, y: Any, h: Any, end: Any, stiff: Any, calm: Any,
    eigenvalue: Any, laws: Any, plant: Any, tolerances: Any, setup: equations.Setup, most: int,
    implicit: bool, dense: bool, coupled: int, held: Any = None, **calls: Any,
) -> Any:  # fmt: skip
    """Take steps of runs; see `integration.advance`. Compiled for the lanes."""
    moving = integrated(setup, tree.n, tree.mode)
    place = {i: k for k, i in enumerate(moving)}

    def rate(t: Any, z: Any) -> Any:
        whole = xp.stack([z[place[i]] if i in place else y[i] for i in range(len(y))])
        given = {} if held is None else {"held": held}
        dy = equations.state_rate(
            xp, tree, p, t, whole, laws, plant, setup=setup, calls=calls, **given
        )
        return dy[np.array(moving)]

    problem = integration.Problem(
        tolerances[0], tolerances[1], 2 * tree.n + 5, tree.n, min(coupled, len(moving))
    )
    start = integration.Progress(t, y[np.array(moving)], h, 0.0, stiff, calm, eigenvalue)
    now, rows = integration.advance(
        xp, rate, problem, start, end, most=most, implicit=implicit, switches=tolerances[2],
        dense=dense,
    )  # fmt: skip
    return *now, rows


def torqued(xp: Any, tree: Any, p: Any, *, t: Any, y: Any, laws: Any, plant: Any,
            setup: equations.Setup, **calls: Any) -> Any:  # fmt: skip
    """Compute the torques (n,) that controllers ask for."""
    return equations.torques(xp, tree, p, t, y, laws, plant, setup=setup, calls=calls)


def observed(xp: Any, tree: Any, p: Any, *, t: Any, y: Any, laws: Any, plant: Any,
             setup: equations.Setup, **calls: Any) -> Any:  # fmt: skip
    """Compute what is reported of a state; see `equations.plant.observe`."""
    return equations.observe(xp, tree, p, t, y, laws, plant, setup=setup, calls=calls)


def event_values(xp: Any, tree: Any, p: Any, *, t: Any, y: Any, laws: Any, plant: Any,
                 setup: equations.Setup, **calls: Any) -> Any:  # fmt: skip
    """Compute the event functions (e,) in a state."""
    return equations.event_values(xp, tree, p, t, y, laws, plant, setup=setup, calls=calls)


def within(xp: Any, _tree: Any, _p: Any, *, i: Any, t: Any, rows: Any) -> Any:
    """Compute what is integrated at a time in step i of rows."""
    return integration.state_of(xp.row(rows, i), t)


class Batch:
    """Runs of one kind.

    Args:
        arms: The arm of each run; all of one structure.
        mode: What the spacecraft does.
        prepared: The numbers and functions of each run; all of one setup.
        y: (m, states) the states at the start.
        coupled: How many leading components of the state rates depend on.
        rtol: Relative tolerance of each step.
        atol: Absolute one.
        method: "auto", "DOP853" or "Rodas5P".

    Attributes:
        dense: Whether states within steps are wanted.
    """

    def __init__(
        self,
        arms: Sequence[SpaceArm],
        mode: BaseMode,
        prepared: Sequence[Prepared],
        y: Array,
        coupled: int,
        tolerances: tuple[float, float],
        method: str,
    ) -> None:
        m = len(y)
        self.arms, self.mode, self.setup = arms, mode, prepared[0].setup
        self.n = arms[0].n
        self.laws = np.array([p.laws for p in prepared]).reshape(m, -1)
        self.plant = np.array([p.plant for p in prepared]).reshape(m, -1)
        self.outside = Outside([p.outside for p in prepared])
        self.moving = np.array(integrated(self.setup, self.n, mode))
        at = equations.parts(self.n, len(self.setup.wheels))
        self.coupled = int(((self.moving < coupled) & ~_within(self.moving, at.works)).sum())
        self.works = at.works
        self.tolerances = np.array([*tolerances, float(method == "auto")])
        self.t, self.y = np.zeros(m), y.copy()
        self.h, self.stiff, self.calm, self.eigenvalue = np.zeros((4, m))
        self.status = np.full(m, RUNNING)
        self.implicit = np.full(m, method == "Rodas5P")
        self.patience = np.full(m, float(PATIENCE))
        self.steps, self.exchanged = np.zeros(m, np.int64), np.zeros(m)
        self._marks = np.zeros((2, m))
        self.held: Array | None = None
        self.dense = True
        whole = {f"law{i}" for i, law in enumerate(self.setup.laws) if law.kind == "own"}
        whole |= {f"event{i}" for i in range(len(self.setup.events))}
        states = y.shape[1]
        self._given = {name: 1 + states * (name in whole) for name, _ in self.setup.called(self.n)}

    def __len__(self) -> int:
        return len(self.t)

    def compute(
        self,
        function: Callable[..., Any],
        runs: Whole,
        inputs: Mapping[str, Array],
        numbers: Mapping[str, Array] | None = None,
        *,
        lanes: int | None = None,
        outside: bool = True,
        **options: Any,
    ) -> Any:
        """Compute a function of this module for lanes of some runs; compiled when first needed.

        Args:
            function: The function.
            runs: (lanes,) numbers of the runs.
            inputs: What it takes besides the numbers of the laws and of the plant, by name.
            numbers: What all lanes share.
            lanes: Number of lanes side by side; one if functions outside are called.
            outside: Whether it takes numbers and functions of laws and plant.
            options: What is known while tracing.
        """
        inputs, shared = dict(inputs), dict(numbers or {})
        calls: dict[str, int] = {}
        if outside:
            setup = self.setup if function is event_values else self.setup._replace(events=())
            left_out = len(self.setup.events) - len(setup.events)
            plant = self.plant[:, : self.plant.shape[1] - left_out]
            for name, values in (("laws", self.laws), ("plant", plant)):
                if (values == values[0]).all():
                    shared[name] = values[0]
                else:
                    inputs[name] = values[runs]
            calls = dict(setup.called(self.n))
            options = {"setup": setup, **options}
        kernel = arms_kernel(
            self.arms, self.mode, function,
            tuple((name, values.shape[1:]) for name, values in inputs.items()),
            tuple((name, np.shape(values)) for name, values in shared.items()),
            outside=tuple(calls.items()), options=tuple(options.items()),
            lanes=1 if calls else lanes,
        )  # fmt: skip
        called = self.outside.called(runs, calls, self._given)
        return kernel(inputs, shared, {}, called, lanes_of=runs)

    def advance(self, end: float) -> Iterator[Steps]:
        """Go on to a time, or to what ends the runs before; yield the steps in turn.

        Between two of them runs may be ended by setting their status.
        """
        self.status[(self.status == FINISHED) & (self.t < end)] = RUNNING
        while True:
            for implicit in (False, True):
                runs = np.flatnonzero((self.status == RUNNING) & (self.implicit == implicit))
                if len(runs):
                    steps = self._advance(runs, end, implicit)
                    yield steps
                    self._check_pace(runs)
            if self.outside.interrupted or not (self.status == RUNNING).any():
                return

    def _advance(self, runs: Whole, end: float, implicit: bool) -> Steps:
        """Take steps of some runs that go on."""
        inputs = {
            "t": self.t[runs], "y": self.y[runs], "h": self.h[runs],
            "end": np.full(len(runs), end), "stiff": self.stiff[runs], "calm": self.calm[runs],
            "eigenvalue": self.eigenvalue[runs],
        }  # fmt: skip
        if self.held is not None:
            inputs["held"] = self.held[runs]
        t, z, h, status, stiff, calm, eigenvalue, turns, rows = self.compute(
            advanced, runs, inputs, {"tolerances": self.tolerances}, most=STEPS, implicit=implicit,
            dense=implicit or self.dense, coupled=self.coupled, lanes=1 if len(self) == 1 else None,
        )  # fmt: skip
        self.t[runs], self.h[runs], self.status[runs] = t, h, status
        self.y[np.ix_(runs, self.moving)] = z
        self.stiff[runs], self.calm[runs], self.eigenvalue[runs] = stiff, calm, eigenvalue
        self._change(runs[status == CHANGES])
        written = np.arange(STEPS) < turns[:, None]
        lane, turn = np.nonzero(written & (rows[:, :, 1] > 0.0))
        kept = rows[lane, turn]
        last = np.append(lane[1:] != lane[:-1], True)[: len(lane)]
        ends = np.where(last, t[lane], np.append(kept[1:, 0], 0.0)[: len(lane)])
        found = Steps(runs[lane], kept[:, 0].copy(), ends, kept)
        np.add.at(self.steps, found.run, 1)
        first = 2 + len(self.moving)
        works = int((~_within(self.moving, self.works)).sum())
        gone = np.abs(kept[:, first + works : first + len(self.moving)]).sum(axis=1)
        np.add.at(self.exchanged, found.run, gone)
        return found

    def _change(self, runs: Whole) -> None:
        """Go over to the other method: from stiff steps, and back, each time for longer."""
        self.status[runs] = RUNNING
        self.stiff[runs] = 0.0
        back = runs[self.implicit[runs]]
        self.calm[back] = self.patience[back]
        self.patience[back] = np.minimum(2.0 * self.patience[back], 100.0 * PATIENCE)
        limited = back[self.eigenvalue[back] > 0.0]
        self.h[limited] = np.minimum(self.h[limited], STABLE / self.eigenvalue[limited])
        self.implicit[runs] = ~self.implicit[runs]

    def _check_pace(self, runs: Whole) -> None:
        """Stop runs whose steps have become too short."""
        due = runs[self.steps[runs] - self._marks[0, runs] >= PACE]
        slow = due[self.t[due] - self._marks[1, due] < PACE * SLOW]
        self.status[slow[self.status[slow] == RUNNING]] = COLLAPSED
        self._marks[0, due], self._marks[1, due] = self.steps[due], self.t[due]

    def whole(self, runs: Whole, z: Array) -> Array:
        """Return the states (L, states) of some runs from what is integrated."""
        y = self.y[runs]
        y[:, self.moving] = z
        return y

    def states(self, steps: Steps, i: Whole, t: Array) -> Array:
        """Return the states (L, states) at times t (L,) within steps i (L,)."""
        if not len(i):
            return self.y[:0]
        kernel = arms_kernel(
            self.arms[:1], self.mode, within, (("i", ()), ("t", ())),
            tables=(("rows", steps.rows.shape[1]),),
        )  # fmt: skip
        z = kernel({"i": i.astype(float), "t": t}, {}, {"rows": steps.rows})
        return self.whole(steps.run[i], z)

    def stop(self, run: int, t: float, y: Array, steps: Steps | None) -> None:
        """End a run at an event in one of these steps, or at the start, where its state is y."""
        if steps is not None:
            mine = np.flatnonzero((steps.run == run) & (steps.end >= t))
            works, nz = _within(self.moving, self.works), len(self.moving)
            for k in mine:
                begun = steps.rows[k, 2 : 2 + nz][works]
                whole = np.abs(steps.rows[k, 2 + nz : 2 + 2 * nz][works]).sum()
                part = np.abs(y[self.moving][works] - begun).sum() if steps.start[k] <= t else 0.0
                self.exchanged[run] += part - whole
            self.steps[run] -= int((steps.start[mine] > t).sum())
        self.t[run], self.y[run], self.status[run] = t, y, ENDED


def _within(numbers: Array, of: slice) -> npt.NDArray[np.bool_]:
    found: npt.NDArray[np.bool_] = (numbers >= of.start) & (numbers < of.stop)
    return found
