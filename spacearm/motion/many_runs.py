"""Many simulations of one arm: dispersions of starts, laws, momenta and payloads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import local
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, finite, positive, whole
from spacearm.errors import ConfigurationError
from spacearm.kernels.processors import processors
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.frames import PoseLike
from spacearm.model.mode import BaseMode
from spacearm.motion.controllers import Controller, check_controller
from spacearm.motion.events import EVENTS
from spacearm.motion.goal import Origin, started
from spacearm.motion.plant import Plant

if TYPE_CHECKING:
    import xarray as xr

FAILURES = ("controller failed", "equations failed", "step collapsed")
"""Ends of runs that are no results."""
LOOKS = 200
"""Outputs of a run over which the least sigma_min and the largest turn are taken."""
PIECE = 16
"""Runs that a thread does between two reports."""
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

    Each run is the one that `simulate` makes of the same arguments. Laws of `sa` and functions
    compiled by numba run in parallel; a controller in Python holds the others up.

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
        "controller failed", "equations failed" or "step collapsed" in `ended`.

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

    from spacearm.motion.runs.run import Run  # imports numba

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
    plants = [Plant(arm, mode, started(arm.at(q0[0], base=base), origin), limits=tuple(limits))]
    found: dict[str, npt.NDArray[Any]] = {
        "success": np.zeros(m, bool),
        **{name: np.full(m, np.nan) for name in UNITS},
        "q": np.full((m, arm.n), np.nan),
        "dq": np.full((m, arm.n), np.nan),
        "base": np.full((m, 7), np.nan),
        "ended": np.full(m, "", dtype=object),
    }
    mine = local()

    def one(i: int) -> None:
        law = {-1: laws[i % len(laws)]}
        plant = replace(plants[0], arm=arms[i], start=started(arms[i].at(q0[i], base=base), origin))
        if not hasattr(mine, "run"):
            mine.run = Run(plant, law, looks, duration, events, stop, reach)
        run: Run = mine.run
        run.again(plant, law, dq0[i], h[i], (rtol, atol), method)
        run.advance(duration)
        for name, value in run.summary(distance).items():
            found[name][i] = value

    def piece(first: int) -> int:
        last = min(first + PIECE, m)
        for i in range(first, last):
            one(i)
        return last

    workers = processors() if threads is None else whole(threads, "threads", 1)
    one(0)  # what is wrong with the arguments is wrong at once; compiles
    with ThreadPoolExecutor(workers) as pool:
        for done in pool.map(piece, range(0, m, PIECE)):
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
    }
    return xr.Dataset(data, {"joint": list(arm.joint_names)}, attrs)


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
