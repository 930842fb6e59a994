"""Many simulations of one arm: dispersions of starts, laws, momenta and payloads."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, finite, positive, whole
from spacearm.compiler.machine import processors
from spacearm.errors import ConfigurationError
from spacearm.model.arguments import BaseMode, of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.frames import PoseLike
from spacearm.motion.controllers import Controller, check_controller
from spacearm.motion.events import EVENTS
from spacearm.motion.goal import Origin, started
from spacearm.motion.plant import Plant
from spacearm.motion.runs.run import Runs
from spacearm.motion.runs.setup import (
    Prepared,
    WantedEvent,
    coupled,
    prepared,
    start_state,
    wanted_events,
)

if TYPE_CHECKING:
    import xarray as xr

FAILURES = ("controller failed", "equations failed", "step collapsed")
"""Ends of runs that are no results."""
LOOKS = 200
"""Outputs of a run over which the least sigma_min and the largest turn are taken."""
PIECE = 256
"""Runs side by side, between two reports."""
KINDS = 8
"""So many functions of users are compiled; of more, all are called in Python."""
UNITS = {
    "time_to_target": "s",
    "first_singularity": "s",
    "sigma_min": "as in sa.singularity",
    "turn": "rad",
    "distance": "rad",
    "t": "s",
    "imbalance": "1",
}
"""Numbers that are kept of each run, and their units."""


@of_arm
def simulate_many(
    arm: SpaceArm,
    Q0: npt.ArrayLike,
    controller: Controller | Sequence[Controller],
    duration: float,
    *,
    base: PoseLike | None = None,
    origin: Origin = "spacecraft",
    dQ0: npt.ArrayLike | None = None,
    momentum: npt.ArrayLike | None = None,
    payload: npt.ArrayLike | None = None,
    mode: BaseMode = "free-floating",
    limits: Sequence[str] = (),
    rtol: float = 1e-6,
    atol: float = 1e-8,
    events: Sequence[str] = EVENTS,
    stop: Sequence[str] = (),
    reach: float = 1e-3,
    method: str = "auto",
    distance: bool = False,
    threads: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> xr.Dataset:
    """Simulate m runs of an arm, side by side on all processors.

    Each run is the one that `simulate` makes of the same arguments. Laws of `sa` and functions of
    plain array code run in parallel; a controller called in Python holds the others up.

    Args:
        arm: The arm.
        Q0: (m, n) joint positions at the start [rad] or [m]; (n,) if all are the same.
        controller: The controller of all runs, or m of one kind: with their own gains and targets.
        duration: How long each run is [s].
        base: As in `simulate`, for all runs.
        origin: As in `simulate`; each run has its own system CM.
        dQ0: (m, n) or (n,) joint rates at the start; zeros if None.
        momentum: (m, 6) or (6,) as in `simulate`; zero if None.
        payload: (m,) point masses held at the tip [kg], as in `SpaceArm.replace`; none if None.
        mode: As in `simulate`.
        limits: As in `simulate`.
        rtol: Relative tolerance of each step.
        atol: Absolute one.
        events: What to note.
        stop: Which of them end a run.
        reach: How near the target is reached.
        method: The integrator.
        distance: Whether `distance` is wanted too; it is NaN if not.
        threads: Number of threads; one per available processor if None.
        progress: Called as progress(done, m) now and then.

    Returns:
        A dataset along "run": `success` (the target was reached), `time_to_target`,
        `first_singularity` (first time at which one was noted) [s], `sigma_min` (least), `turn`
        (largest turn of the spacecraft from its start [rad]) and `distance` (least distance to the
        singular set to first order [rad]) of 200 instants and the end, `t` (end [s]), `imbalance`
        (as `Trajectory.imbalance`, of the end), `ended`, `q0`, and `q`, `dq` and `base` at the end.
        Times that there are not are NaN. A run that fails does not end the others: it has
        "controller failed", "equations failed" or "step collapsed" in `ended`. The attribute
        `called` names the functions that were called in Python, and why.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The arm has several tips.

    Example:
        >>> import spacearm as sa
        >>> law = sa.JointPD(target=[0.5, 1.0], kp=5, kd=9)
        >>> starts = [[0.3, 1.2], [0.4, 1.1]]
        >>> ds = sa.simulate_many(sa.load("planar2"), starts, law, 1.0)
        >>> ds.turn.values.round(3)  # of the spacecraft [rad]
        array([0.026, 0.013])
    """
    import xarray as xr

    arm.require_one_tip()
    duration = positive(duration, "duration", "time [s]")
    if isinstance(controller, str) or not isinstance(controller, Sequence):
        check_controller(controller)
    laws = [controller] if callable(controller) else list(controller)
    for law in laws:
        check_controller(law)
    given = {"Q0": (Q0, arm.n), "dQ0": (dQ0, arm.n), "momentum": (momentum, 6)}
    m = _number_of_runs([x for x, _ in given.values()], payload, laws, callable(controller))
    q0, dq0, h = (_rows(x, m, size, name) for name, (x, size) in given.items())
    arms = _with_payloads(arm, payload, m)
    looks = np.linspace(0.0, duration, LOOKS, endpoint=False)
    found: dict[str, npt.NDArray[Any]] = {
        "success": np.zeros(m, bool),
        **{name: np.full(m, np.nan) for name in UNITS},
        "q": np.full((m, arm.n), np.nan),
        "dq": np.full((m, arm.n), np.nan),
        "base": np.full((m, 7), np.nan),
        "ended": np.full(m, "", dtype=object),
    }
    called: dict[str, None] = {}
    plants = [Plant(arm, mode, started(arms[0].at(q0[0], base=base), origin), limits=tuple(limits))]
    starts = _starts(plants[0], laws, arms, (events, stop, reach))

    def piece(runs: Sequence[int]) -> int:
        mine = [
            replace(plants[0], arm=arms[i], start=started(arms[i].at(q0[i], base=base), origin))
            for i in runs
        ]
        ready = [starts(plant, i) for plant, i in zip(mine, runs, strict=True)]
        setup, numbers = ready[0][1].setup, [one for _, one in ready]
        y = [start_state(plant, dq0[i], h[i]) for plant, i in zip(mine, runs, strict=True)]
        needs = max(coupled(plant, setup, h[i]) for plant, i in zip(mine, runs, strict=True))
        side = Runs(
            mine, [{-1: laws[i % len(laws)]} for i in runs], numbers, np.array(y), needs, looks,
            duration, ready[0][0], (rtol, atol), method,
        )  # fmt: skip
        side.advance(duration)
        called.update(dict.fromkeys(side.called))
        for name, values in side.summary(distance).items():
            found[name][runs] = values
        return len(runs)

    workers = processors() if threads is None else whole(threads, "threads", 1)
    size, done = min(PIECE, -(-m // workers)), 0
    with ThreadPoolExecutor(workers) as pool:
        for count in pool.map(piece, _pieces(plants[0], starts, m, len(laws), size)):
            done += count
            if progress:
                progress(done, m)
    joint, pose = ("run", "joint"), ("run", "pose")
    data: dict[str, Any] = {name: ("run", found[name], {"units": u}) for name, u in UNITS.items()}
    data |= {name: ("run", found[name]) for name in ("success", "ended")}
    data |= {name: (joint, found[name]) for name in ("q", "dq")}
    data |= {"q0": (joint, q0), "base": (pose, found["base"], {"units": "m, quaternion xyzw"})}
    attrs = {
        "arm": arm.name,
        "base_mode": mode,
        "origin": origin,
        "duration": duration,
        "rtol": rtol,
        "atol": atol,
        "called": "; ".join(called),
    }
    return xr.Dataset(data, {"joint": list(arm.joint_names)}, attrs)


Starts = Callable[[Plant, int], tuple[list[WantedEvent], Prepared]]
"""The events that a run looks for, and its numbers and functions."""


def _starts(
    first: Plant, laws: Sequence[Controller], arms: Sequence[SpaceArm], looked_for: Any
) -> Starts:
    """Return what prepares a run by its number; once for all where they do not differ."""
    events, stop, reach = looked_for

    def start(plant: Plant, i: int, trace: bool = True) -> tuple[list[WantedEvent], Prepared]:
        own = {-1: laws[i % len(laws)]}
        kinds = dict.fromkeys((*events, *stop))
        wanted = wanted_events(plant.arm, plant.mode, kinds, stop, reach, own, None)
        return wanted, prepared(plant, own, wanted, trace=trace)

    known: tuple[list[WantedEvent], Prepared] | None = start(first, 0)
    assert known is not None
    if known[1].outside or len({id(arm) for arm in arms}) > 1 or first.mode == "fixed":
        known = None
    several = len({id(law) for law in laws}) > 1
    trace = not several or len(laws) <= KINDS
    return lambda plant, i: start(plant, i, trace) if known is None or several else known


def _pieces(first: Plant, starts: Starts, m: int, laws: int, size: int) -> Iterator[list[int]]:
    """Return the numbers of runs that go side by side: those of one setup, so many at most."""
    setups: dict[Any, list[int]] = {}
    if laws == 1:
        setups[None] = list(range(m))
    for i in range(m if laws > 1 else 0):
        setups.setdefault(starts(first, i)[1].setup, []).append(i)
    for runs in setups.values():
        yield from (runs[at : at + size] for at in range(0, len(runs), size))


def _number_of_runs(
    values: Sequence[Any], payload: npt.ArrayLike | None, laws: Sequence[Any], shared: bool
) -> int:
    """Return the number of runs that the arguments are of.

    Raises:
        ConfigurationError: They are of different numbers, or the laws of different kinds.
    """
    sizes = [len(x) for x in values if x is not None and np.ndim(x) == 2]
    sizes += [np.size(payload)] if payload is not None else []
    sizes += [] if shared else [len(laws)]
    if len(set(sizes)) > 1 or 0 in sizes or len({type(law) for law in laws}) != 1:
        raise ConfigurationError(
            f"Q0, dQ0, momentum, payload and controller are of {sizes} runs; give each once or as "
            "many times as the others, and controllers of one kind"
        )
    return sizes[0] if sizes else 1


def _rows(values: npt.ArrayLike | None, m: int, size: int, name: str) -> Array:
    """Return (m, size) numbers, checked; one row for all, or zeros if None."""
    if values is None:
        return np.zeros((m, size))
    if np.ndim(values) == 2:
        return finite(values, (m, size), name)
    return np.tile(finite(values, (size,), name), (m, 1))


def _with_payloads(arm: SpaceArm, payload: npt.ArrayLike | None, m: int) -> Sequence[SpaceArm]:
    """Return the arm of each run."""
    if payload is None:
        return [arm] * m
    masses = finite(payload, (m,), "payload", "[kg], one for each run")
    kinds = {mass: arm.replace(payload=mass) if mass > 0.0 else arm for mass in set(masses)}
    if min(kinds) < 0.0:
        raise ConfigurationError(f"payload has {min(kinds):g} kg; give masses from 0 on")
    return [kinds[mass] for mass in masses]
