"""A run of the compiled integrator: begun, advanced, and what came of it. Imports numba."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError, SpaceArmError
from spacearm.kernels.dynamics import advance as steps
from spacearm.kernels.dynamics import laws, observe
from spacearm.mechanics import compiled, nearness
from spacearm.mechanics.compiled import all_bodies
from spacearm.mechanics.dynamics import forward_dynamics
from spacearm.model.configuration import Configuration
from spacearm.model.mode import free_components
from spacearm.motion.controllers import Controller
from spacearm.motion.events import EVENTS, Event, with_nearest
from spacearm.motion.plant import Plant
from spacearm.motion.runs.compiled import memory, put_state, put_stiff
from spacearm.motion.runs.compiled_events import compiled_events
from spacearm.motion.runs.compiled_laws import put_law
from spacearm.motion.trajectory import Trajectory

REPORT, BLOCK = 50, 2000
"""Steps between two reports of progress, with functions in Python and without."""
LOOSE = 1e-2
"""Relative tolerances from which RKC, of order 2, comes before Radau."""

Progress = Callable[[float, float], object] | None


class Run:
    """A run.

    Args:
        plant: What is simulated.
        controllers: As in `motion.runs.compiled.memory`.
        t: (m,) times of the outputs, the end left out [s].
        duration: The end [s].
        events: Kinds of events to note.
        stop: Kinds of events that end the run.
        reach: The distance at which the target counts as reached.
    """

    def __init__(
        self,
        plant: Plant,
        controllers: Mapping[int, Controller],
        t: Array,
        duration: float,
        events: Sequence[str],
        stop: Sequence[str],
        reach: float,
    ) -> None:
        self.plant, self.controllers, self.duration = plant, controllers, duration
        self.looked_for = compiled_events(plant.arm, plant.mode, {*events, *stop}, stop, reach,
                                          controllers, plant.hold is not None)  # fmt: skip
        self.times = np.append(t, np.inf)
        records = [event.record for event in self.looked_for]
        self.memory, self.outside = memory(plant, controllers, self.times, records)
        self._put_functions()
        self.x: Any = self.memory.context
        self.events: list[Event] = []
        self.torques: list[tuple[float, Array]] = []
        self.ended, self.fault = "duration", ""

    def begin(self, dq: Array, momentum: Array, rtol: float, atol: float, method: str) -> None:
        """Begin at t = 0."""
        x = self.x
        put_state(self.plant, self.memory, dq, momentum)
        x["rtol"], x["atol"], x["end"] = rtol, atol, self.duration
        x["switches"], x["implicit"], x["implicit_step"] = method == "auto", method == "Radau", 0
        x["mild"] = method == "auto" and rtol >= LOOSE

    def again(
        self,
        plant: Plant,
        controllers: Mapping[int, Controller],
        dq: Array,
        momentum: Array,
        tolerances: tuple[float, float],
        method: str,
    ) -> None:
        """Begin another run in the same memory, with controllers of the same kinds."""
        self.memory.restart()
        if plant.arm is not self.plant.arm:
            self.memory["b"][:] = all_bodies(plant.arm)
        if controllers != self.controllers:
            self.outside.kept.clear()
            for i, (tip, controller) in enumerate(controllers.items()):
                self.memory["of_law"][i] = 0.0
                put_law(plant, self.memory, i, tip, controller, self.outside)
            self._put_functions()
        self.plant, self.controllers = plant, controllers
        self.outside.plant, self.outside.error = plant, None
        self.memory["t_out"][:] = self.times
        self.events, self.torques, self.ended, self.fault = [], [], "duration", ""
        self.begin(dq, momentum, *tolerances, method)

    def _put_functions(self) -> None:
        """Put the events that Python computes in the memory."""
        for i, event in enumerate(self.looked_for):
            if event.function is not None:
                value = partial(_put_value, event.function, self)
                self.memory["event"][i]["call"] = self.outside.outside(value, 1)

    @property
    def steps(self) -> int:
        """Number of steps so far."""
        return int(self.x["steps"])

    def advance(self, end: float, progress: Progress = None) -> None:
        """Go on to a time, or to what ends the run before."""
        x, here, block = self.x, self.memory.here, REPORT if self.outside.kept else BLOCK
        try:
            if x["step"] == 0.0:
                x["end"] = self.duration
                self.check(steps.initiate(here))
            x["end"] = end
            while self.ended == "duration":
                why = steps.advance(here, block)
                self.take()
                self.check(why)
                if why == steps.FINISHED:
                    return
                if why == steps.STIFF_NOW:
                    put_stiff(x)
                if progress:
                    progress(float(x["t"]), self.duration)
        except KeyboardInterrupt:
            self.ended = "interrupted"

    def advance_sampled(self, end: float, period: float, delay: float, progress: Progress) -> None:
        """Go on with torques that are sampled and held."""
        x, m, k = self.x, self.memory, 0
        while self.ended == "duration" and k * period < end:
            x["torques"] = laws.torques.address
            if steps.sample(m.here):
                self.check(steps.NO_RATE)
                return
            tau = m["tau"].copy()
            x["torques"] = laws.held.address
            for until in (k * period + delay, (k + 1) * period):
                if until > x["t"] and self.ended == "duration":
                    if x["step"] > 0.0:
                        self.check(steps.resume(m.here))
                    self.advance(min(until, end), progress if k % REPORT == 0 else None)
                if until == k * period + delay:
                    m["held"][:] = tau
                    self.torques.append((float(until), tau))
            k += 1

    def take(self) -> None:
        """Take the events that were found."""
        m, x = self.memory, self.x
        for i in range(int(x["happened"])):
            event, found = self.looked_for[int(m["found"][i]["which"])], m["found"][i]
            happened = Event(float(found["t"]), event.kind, m["q_found"][i].copy(), event.detail)
            self.events.append(with_nearest(happened, self.plant.arm, self.plant.mode))
        if x["stopped"] >= 0:
            self.ended = self.events[-1].kind
        x["happened"] = 0

    def check(self, why: int) -> None:
        """Note why the integrator stopped, if that is an error."""
        t = float(self.x["t"])
        if why == steps.NO_STEP:
            self.ended, self.fault = "step collapsed", (
                f"the step collapsed at t = {t:.6g} s: the torques jump or are too stiff; smooth "
                "them or lower the gains"
            )  # fmt: skip
        elif why == steps.NO_RATE:
            self.ended, error = self._failure(t)
            if isinstance(error, KeyboardInterrupt):
                self.ended = "interrupted"
                return
            if not isinstance(error, SpaceArmError):
                raise error
            q = ", ".join(f"{x:.6g}" for x in self.memory["seen"][: self.plant.arm.n])
            self.fault = f"at t = {t:.6g} s, q = ({q}): {error}"

    def _failure(self, t: float) -> tuple[str, BaseException]:
        """Return what failed in the last state, a law or the equations of motion, and its error."""
        failed, n, y = "controller failed", self.plant.arm.n, self.memory["seen"]
        if self.outside.error:
            return failed, self.outside.error
        cfg, dq = self.plant.configuration(y[: len(self.memory["y"])]), y[n : 2 * n].copy()
        try:
            for law in (law for law in self.controllers.values() if not hasattr(law, "py_func")):
                law(t, cfg, dq)
            failed = "equations failed"
            forward_dynamics(cfg, dq, np.zeros(n), mode=self.plant.mode)
        except SpaceArmError as error:
            return failed, error
        return "controller failed", NoSolutionError("the controller's torque is not finite", None)

    def finish(self) -> int:
        """Write the end as the last output; return the number of outputs."""
        m, x = self.memory, self.x
        last = int(x["written"])
        if last == 0 or m["t_out"][last - 1] < x["t"]:
            m["t_out"][last], m["y_out"][last] = x["t"], m["y"]
            last += 1
        x["written"], m["t_out"][last:] = last, np.inf
        return last

    def summary(self, distance: bool) -> dict[str, Any]:
        """Return what `simulate_many` keeps of a run, with the `distance` or without."""
        self.finish()
        m, x, n, result = self.memory, self.x, self.plant.arm.n, np.empty(2)
        observe.survey(m.here, result)
        least = self._least_distance() if distance else np.nan
        first, last = 0, int(x["written"]) - 1  # of all outputs two are looked at in detail
        m["y_out"][1], m["t_out"][1] = m["y_out"][last], m["t_out"][last]
        x["written"] = min(last, 1) + 1
        observe.observe(m.here)
        seen, y = m["observed"][:2, n:], m["y_out"][min(last, 1)]
        energy = seen[[first, min(last, 1)], observe.ENERGY]
        turnover = float(energy.max() + x["exchanged"])
        off = abs(energy[1] - energy[0] - y[2 * n + 13 : 2 * n + 17].sum())
        times = {kind: [e.t for e in self.events if e.kind == kind] for kind in EVENTS}
        return {
            "success": bool(times["target"]),
            "time_to_target": min(times["target"], default=np.nan),
            "first_singularity": min(times["singularity"], default=np.nan),
            "sigma_min": result[0],
            "turn": result[1],
            "distance": least,
            "t": float(x["t"]),
            "ended": self.ended,
            "imbalance": off / turnover if turnover > 0.0 else 0.0,
            "q": y[:n],
            "dq": y[n : 2 * n],
            "base": seen[min(last, 1), : observe.MOMENTUM],
        }

    def _least_distance(self) -> float:
        """Return the least distance of all outputs from the singular set [rad]."""
        arm, mode = self.plant.arm, self.plant.mode
        tangent = compiled.tangent if len(arm.tips) == 1 else nearness.tangent
        Q = self.memory["y_out"][: int(self.x["written"]), : arm.n]
        distances, _ = nearness.refined(
            arm, Q, tangent(arm, Q, mode), lambda Q, fading: tangent(arm, Q, mode, fading)
        )
        return float(distances.min())

    def trajectory(self) -> Trajectory:
        """Return the trajectory so far."""
        m, x, n, last = self.memory, self.x, self.plant.arm.n, self.finish()
        observe.observe(m.here)
        Y, seen, t = m["y_out"][:last], m["observed"][:last, n:], m["t_out"][:last].copy()
        torque = m["observed"][:last, :n].copy()
        if self.torques:
            times = np.array([time for time, _ in self.torques])
            held = np.vstack((np.zeros(n), [tau for _, tau in self.torques]))
            torque = held[np.searchsorted(times, t, side="right")]
        kept, base = seen[:, observe.MOMENTUM : observe.BROUGHT], seen[:, : observe.MOMENTUM].copy()
        impulse, brought = Y[:, 2 * n + 7 : 2 * n + 13], seen[:, observe.BROUGHT : observe.ENERGY]
        self.drift = drift_of(kept, impulse - impulse[0], brought, free_components(self.plant.mode))
        if self.plant.mode == "fixed":
            base[:] = base[0]
        works = Y[:, 2 * n + 13 : 2 * n + 17]
        return Trajectory(
            arm=self.plant.arm,
            mode=self.plant.mode,
            t=t,
            q=(q := Y[:, :n].copy()),
            dq=Y[:, n : 2 * n].copy(),
            base=base,
            torque=torque,
            momentum=kept.copy(),
            impulse=impulse - impulse[0],
            wrenches=self.plant.acting(t, q, base) if self.plant.pushed else {},
            wheels=Y[:, 2 * n + 17 :].copy(),
            energy=seen[:, observe.ENERGY].copy(),
            work=works[:, 0].copy(),
            other_work=works[:, 1:].sum(axis=1),
            exchanged=float(x["exchanged"]),
            events=tuple(self.events),
            ended=self.ended,
        )


def drift_of(momentum: Array, impulse: Array, brought: Array, f: int) -> float:
    """Return the change of the momentum that is kept, over what the joints alone brought."""
    change = np.abs((momentum - impulse - momentum[0])[:, :f]).max(initial=0.0)
    most = max(np.abs(brought[:, :f]).max(initial=0.0), np.abs(momentum[0, :f]).max(initial=0.0),
               np.abs(impulse[:, :f]).max(initial=0.0))  # fmt: skip
    return float(change / most) if most > 0.0 else 0.0


def _put_value(
    function: Callable[[float, Configuration], float], run: Run, t: float, y: Array, out: Array
) -> None:
    """Put the value of an event in Python at a state y of a run."""
    out[0] = function(t, run.plant.configuration(y[: len(run.memory["y"])]))
