"""Simulation: a floating arm under joint torques, in time.

The state that is integrated is the reduced one: joint positions and rates, the spacecraft's
attitude as a unit quaternion, and what changes under wrenches and wheels only: momentum and the
system CM. The work of the torques is integrated beside it, so that every trajectory has a balance
of its energy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from threading import Event
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from spacearm.arrays import MOST_THREADS, Array, ArrayLike, finite, positive, shape_of, steps, whole
from spacearm.compiler.machine import processors
from spacearm.errors import ConfigurationError, NoSolutionError, require_known
from spacearm.mechanics.arm_kernels import structure_of
from spacearm.model.arguments import BaseMode, free_components
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.joints import joint_vector
from spacearm.motion.controllers import Controller, Laws, Tracking, check_target
from spacearm.motion.goal import Origin, started
from spacearm.motion.motion import Trajectory
from spacearm.motion.motion_file import Quantity
from spacearm.motion.plant import Integration, Plant, Sampling
from spacearm.motion.run import Progress, Runs
from spacearm.motion.system import Prepared, System, prepared, wanted_events
from spacearm.processes import Threads
from spacearm.signatures import checked

if TYPE_CHECKING:
    import xarray as xr

#: What is kept of runs.
Collected = TypeVar("Collected")
#: How many times `rtol` the balances of energy and momentum may be off.
AUDIT = 1e4
#: How many times `atol` [J] that of energy may be off besides: all there is near rest.
STILL = 1e2


@checked
def simulate(
    start: Configuration,
    controller: Laws,
    duration: float,
    *,
    dq: ArrayLike | None = None,
    mode: BaseMode = "free-floating",
    origin: Origin = "spacecraft",
    plant: Plant = Plant(),
    sampling: Sampling | None = None,
    stop: Sequence[str] = (),
    integration: Integration = Integration(),
    progress: Progress = None,
) -> Trajectory:
    """Simulate an arm under the torques of a controller.

    Args:
        start: The configuration at the start: joint positions, pose of the spacecraft, what the
            wheels hold, and the momentum. Where the spacecraft's attitude is controlled only the
            linear momentum counts.
        controller: Called as controller(t, cfg, dq), returns (n,) torques [N m] or forces [N].
            Without `sampling` it is called at non-monotonic times, so it must be stateless. With
            `sampling` it may have a memory (m,): `memory0`, an array or a function of the start,
            and `update(t, cfg, dq, memory)`, which returns the next memory. It is then called as
            controller(t, cfg, dq, memory), and each run begins with `memory0`. Plain array code is
            compiled, other code is called in Python. For an arm with several tips: `sa.Tracking` of
            a motion of all joints, or a law for each tip by its name, which acts on the joints that
            move that tip.
        duration: How long [s].
        dq: (n,) joint rates at the start [rad/s] or [m/s]; zeros if None.
        mode: What the spacecraft does; see `generalized_jacobian`.
        origin: Origin of the inertial frame: with "spacecraft" where the pose of the start has it,
            so that poses of `SpaceArm.at` can be used as goals. With "cm" it is the system CM at
            the start, as for points of a `Workspace`, and the pose gives the attitude.
        plant: What else acts: wheels, wrenches, thrusters, springs and friction, motor limits.
        sampling: Period, delay and noise of a controller with a fixed rate, which holds its torques
            in between; None for one that acts continuously.
        stop: Events that end the run; see `Integration`.
        integration: Tolerances, spacing of the output, and the events to record.
        progress: Called now and then as progress(t, duration), both simulated time [s].

    Returns:
        The trajectory; after Ctrl-C, what there is of it, with `ended` "interrupted".

    Raises:
        ConfigurationError: An argument does not make sense, the target is out of reach, or a
            controller with a memory has no control period.
        UnsupportedError: The arm has several tips and one controller, or no wheels to hold.
        NoSolutionError: The controller gave no torques, the step collapsed, or the balance of
            energy or momentum is off: carries the trajectory so far, None before the first step.

    Example:
        >>> import spacearm as sa
        >>> law = sa.JointPD(target=[0.5, 1.0], kp=5, kd=9)
        >>> sa.simulate(sa.load("planar2").at([0.3, 1.2]), law, 5.0)
        Trajectory(planar2, free-floating: 5 s, 1001 times, ended by duration)
    """
    arm, duration = start.arm, positive(duration, "duration", "time [s]")
    rates = None if dq is None else joint_vector(arm, dq, "dq")
    system = System(started(start, origin), mode, plant, _by_tip(arm, controller), rates)
    if mode != "fixed" and not start.momentum[:3].any() and not plant.pushed and len(arm.tips) == 1:
        for one in system.controllers.values():
            check_target(one, system.start)
    _check_period([system], sampling)
    ready = prepared(system, wanted_events(system, integration, stop))
    run = Runs([system], [ready], integration.times(duration), duration, integration)
    _advance(run, duration, sampling, progress)
    fault = run.fault[0]
    if fault and run.batch.steps[0] == 0:
        raise NoSolutionError(f"{arm.name}: {fault}", None)
    result = run.trajectory()
    if fault:
        raise NoSolutionError(f"{arm.name}: {fault}", result)
    audit(result, run.drift, integration)
    return result


def _check_period(systems: Sequence[System], sampling: Sampling | None) -> None:
    """Refuse a law with a memory, or one of wheels that is sampled, that has no control period."""
    hold = systems[0].hold
    if sampling is None and hold is not None and hold.sampled:
        raise ConfigurationError(
            "the law of the wheels is sampled and has no control period; give "
            "sampling=sa.Sampling(period=...)"
        )
    for system in systems if sampling is None else ():
        for law, memory in zip(system.controllers.values(), system.memories, strict=True):
            if len(memory):
                raise ConfigurationError(
                    f"{type(law).__name__} has a memory, and a memory needs a control period; give "
                    "sampling=sa.Sampling(period=...)"
                )


def _advance(run: Runs, duration: float, sampling: Sampling | None, progress: Progress) -> None:
    """Go on to the end."""
    if sampling is None:
        run.advance(duration, progress)
    else:
        steps(duration, sampling.period, "period")
        run.advance_sampled(duration, sampling, progress)


def audit(result: Trajectory, drift: float, integration: Integration) -> None:
    """Check the balances of energy and momentum.

    Raises:
        NoSolutionError: One is off.
    """
    still = STILL * integration.atol / result.turnover if result.turnover > 0.0 else 0.0
    for what, off, more in (("energy", result.imbalance, still), ("momentum", drift, 0.0)):
        if off > AUDIT * integration.rtol + more:
            raise NoSolutionError(
                f"{result.arm.name}: the balance of {what} is off by {off:.1e} of what was "
                "exchanged; take smaller rtol and atol",
                result,
            )


def _by_tip(arm: SpaceArm, controller: Laws) -> dict[int, Controller]:
    """Return the controllers by the number of the tip that they lead, -1 for all joints."""
    laws: Any = controller
    if not isinstance(laws, Mapping):
        if not isinstance(controller, Tracking):  # which leads all joints, of whatever tips
            arm.require_one_tip()
        return {-1: laws}
    require_known("tip", laws, arm.tips)
    return {arm.tips.index(tip): law for tip, law in laws.items()}


#: What dispersions of many runs need.
COARSE = Integration(rtol=1e-6, atol=1e-8)
#: Ends of runs that are not results.
FAILURES = ("controller failed", "equations failed", "step collapsed")
#: Outputs of a run over which the least sigma_min and the largest turn are taken.
LOOKS = 200
#: Time between two reports of progress, where no runs end [s].
LOOK = 0.2
#: Runs side by side, between two reports.
PIECE = 256
#: So many functions of users are compiled; of more, all are called in Python.
KINDS = 8
#: Units of what is kept of each run.
UNITS = {
    "success": "1", "time_to_target": "s", "first_singularity": "s", "turn": "rad", "t": "s",
    "imbalance": "1", "base": "m, quaternion xyzw",
}  # fmt: skip


@checked
def simulate_many(
    starts: Configuration | Sequence[Configuration],
    controller: Laws | Sequence[Laws],
    duration: float,
    *,
    dq: ArrayLike | None = None,
    mode: BaseMode = "free-floating",
    plant: Plant = Plant(),
    sampling: Sampling | None = None,
    stop: Sequence[str] = (),
    distance: bool = False,
    integration: Integration = COARSE,
    threads: int | None = None,
    progress: Progress = None,
) -> xr.Dataset:
    """Simulate m runs of an arm, side by side on all processors.

    Each run is what `simulate` returns for the same arguments. Laws of `sa` and functions in plain
    array code run in parallel; controllers called in Python run one after the other. Not checked:
    torques and rates beyond the limits of the motors, unless the plant enforces them.

    Args:
        starts: m configurations of one arm, as in `simulate`, or of arms that differ by masses
            only, such as `arm.replace(payload=)`; one if all start alike. `Configuration.centred`
            puts the system CM at the origin.
        controller: As in `simulate`, for all runs; or m of them, with gains and targets of each.
        duration: How long each run is [s].
        dq: (m, n) or (n,) joint rates at the start [rad/s] or [m/s]; zeros if None.
        mode: As in `simulate`.
        plant: As in `simulate`, for all runs.
        sampling: As in `simulate`, with noise of its own for each run.
        stop: Which events end a run.
        distance: Whether to compute `distance` too; else it is NaN.
        integration: As in `simulate`, here with tolerances of 1e-6 and 1e-8; without `dt`.
        threads: Number of threads; one per available processor if None.
        progress: Called now and then as progress(done, m); parts of runs count.

    Returns:
        A dataset along "run": `success` (the target was reached), `time_to_target`,
        `first_singularity` (first time at which one was noted) [s], `sigma_min` (least), `turn`
        (largest turn of the spacecraft from its start [rad]) and `distance` (least distance to the
        singular set to first order [rad]) of 200 instants and the end. Of the end: `t` [s],
        `imbalance` (as `Trajectory.imbalance`), `ended`, `q`, `dq` and `base`. Of the start: `q0`.
        Times that do not exist are NaN. A run that fails does not end the others: it has
        "controller failed", "equations failed" or "step collapsed" in `ended`. The attribute
        `called` names the functions that were called in Python, and why.

    Raises:
        ConfigurationError: An argument does not make sense, or a controller with a memory has no
            control period.
        UnsupportedError: The arm has several tips and one controller, or no wheels to hold.

    Example:
        >>> import spacearm as sa
        >>> law = sa.JointPD(target=[0.5, 1.0], kp=5, kd=9)
        >>> arm = sa.load("planar2")
        >>> starts = [arm.at(q) for q in ([0.3, 1.2], [0.4, 1.1])]
        >>> ds = sa.simulate_many(starts, law, 1.0)
        >>> ds.turn.values.round(3)  # of the spacecraft [rad]
        array([0.026, 0.013])
    """
    import xarray as xr

    systems, duration = _systems(starts, controller, duration, dq, mode, plant)
    arm, m = systems[0].arm, len(systems)
    if integration.dt is not None:
        raise ConfigurationError("dt is given; simulate_many keeps no outputs, so leave it out")
    _check_sampling(systems, sampling)
    ready = _prepared_all(systems, stop, integration)
    looks = np.linspace(0.0, duration, LOOKS, endpoint=False)

    def summary(side: Runs) -> Mapping[str, npt.NDArray[Any]]:
        return side.summary(distance)

    sides = _side_by_side(
        systems, ready, looks, duration, integration, sampling, threads, progress, summary
    )
    found: dict[str, npt.NDArray[Any]] = {}
    for runs, told in sides:
        for name, values in told.items():
            every = np.empty((m, *values.shape[1:]), values.dtype)
            found.setdefault(name, every)[runs] = values
    found["q0"] = np.array([system.start.q for system in systems])
    columns = {"q": ("joint",), "dq": ("joint",), "q0": ("joint",), "base": ("pose",)}
    units = UNITS | _units_of_joints(arm)
    attributes = {name: {"units": unit} for name, unit in units.items()}
    data = {
        name: (("run", *columns.get(name, ())), values, attributes.get(name, {}))
        for name, values in found.items()
    }
    attrs = {"arm": arm.name, "base_mode": mode, "duration": duration}
    attrs |= {"rtol": integration.rtol, "atol": integration.atol}
    attrs["called"] = "; ".join(dict.fromkeys(note for one in ready for note in one.notes))
    return xr.Dataset(data, {"joint": list(arm.joint_names)}, attrs)


def trajectories_of(
    starts: Sequence[Configuration],
    controller: Laws,
    duration: float,
    *,
    dq: ArrayLike,
    mode: BaseMode,
    plant: Plant,
    sampling: Sampling | None,
    integration: Integration,
    progress: Progress = None,
) -> list[Trajectory]:
    """Simulate m runs of an arm side by side and return their trajectories.

    Args:
        starts: As of `simulate_many`.
        controller: As there, for all runs.
        duration: As there.
        dq: As there, (m, n).
        mode: As there.
        plant: As there.
        sampling: As there.
        integration: As in `simulate`.
        progress: As of `simulate_many`.

    Raises:
        SpaceArmError: As `simulate_many` raises. A run that fails does not end the others: its
            trajectory says so in `ended`.
    """
    systems, duration = _systems(starts, controller, duration, dq, mode, plant)
    _check_sampling(systems, sampling)
    ready = _prepared_all(systems, (), integration)
    looks = integration.times(duration)

    def trajectories(side: Runs) -> list[Trajectory]:
        return [side.trajectory(i) for i in range(len(side.systems))]

    sides = _side_by_side(
        systems,
        ready,
        looks,
        duration,
        integration,
        sampling,
        None,
        progress,
        trajectories,
        recorded=True,
    )
    found: dict[int, Trajectory] = {}
    for runs, motions in sides:
        found |= zip(runs, motions, strict=True)
    return [found[i] for i in range(len(systems))]


def _systems(
    starts: Configuration | Sequence[Configuration],
    controller: Laws | Sequence[Laws],
    duration: float,
    dq: ArrayLike | None,
    mode: BaseMode,
    plant: Plant,
) -> tuple[list[System], float]:
    """Return what is simulated in each of many runs, and for how long; see `simulate_many`."""
    free_components(mode)  # raises for one that does not exist
    one, each = isinstance(starts, Configuration), len(shape_of(dq)) == 2
    several = isinstance(controller, Sequence | np.ndarray) and not isinstance(controller, str)
    listed = [starts] if isinstance(starts, Configuration) else list(starts)
    laws: Any = controller if several else [controller]
    arm, duration = _arm_of(listed), positive(duration, "duration", "time [s]")
    given = (not one, len(listed)), (each, (*shape_of(dq), 0)[0]), (several, len(laws))
    sizes = [size for counts, size in given if counts]
    if len(set(sizes)) > 1 or 0 in sizes:
        raise ConfigurationError(
            f"starts, dq and controller are of {sizes} runs; give each once or as many "
            "times as the others"
        )
    m = max(sizes, default=1)
    shape = (m, arm.n) if each else (arm.n,)
    rates = np.broadcast_to(np.zeros(shape) if dq is None else finite(dq, shape, "dq"), (m, arm.n))
    systems = [
        System(listed[i % len(listed)], mode, plant, _by_tip(arm, laws[i % len(laws)]), rates[i])
        for i in range(m)
    ]
    return systems, duration


def _check_sampling(systems: Sequence[System], sampling: Sampling | None) -> None:
    """Refuse a sampling that makes no sense, and laws that need one and have none."""
    _check_period(systems, sampling)
    if sampling is not None:
        sampling.noise(systems[0].arm.n)  # raises for one that makes no sense


def _side_by_side(
    systems: Sequence[System],
    ready: Sequence[Prepared],
    looks: Array,
    duration: float,
    integration: Integration,
    sampling: Sampling | None,
    threads: int | None,
    progress: Progress,
    collect: Callable[[Runs], Collected],
    *,
    recorded: bool = False,
) -> Iterator[tuple[list[int], Collected]]:
    """Simulate runs on several threads; yield numbers of those that are done, and what is kept.

    Args:
        systems: What is simulated in each run.
        ready: The same for the equations.
        looks: Times of the outputs [s].
        duration: How long each run is [s].
        integration: How they are integrated.
        sampling: As of `simulate_many`.
        threads: As there.
        progress: As there.
        collect: Returns what is kept of runs that are done.
        recorded: As of `Runs`.
    """
    m, workers = len(systems), _workers(threads)
    pieces = list(_pieces(ready, min(PIECE, -(-m // workers))))
    shares, stopped = np.zeros(len(pieces)), Event()

    def simulated(k: int) -> Collected:
        runs = pieces[k]

        def tell(t: float, _: float) -> None:
            if stopped.is_set():
                raise KeyboardInterrupt
            shares[k] = len(runs) * t / duration

        mine, own = [systems[i] for i in runs], [ready[i] for i in runs]
        side = Runs(mine, own, looks, duration, integration, runs, recorded=recorded)
        _advance(side, duration, sampling, tell)
        shares[k] = len(runs)
        return collect(side)

    with Threads(workers) as pool:
        try:
            jobs = {pool.submit(simulated, k): runs for k, runs in enumerate(pieces)}
            while jobs:
                done, _ = wait(jobs, LOOK, FIRST_COMPLETED)
                for job in done:
                    yield jobs.pop(job), job.result()
                if progress:
                    progress(float(shares.sum()), m)
        finally:  # an interrupt ends the runs that go on, and those that have not begun
            stopped.set()
            pool.shutdown(wait=False, cancel_futures=True)


def _workers(threads: int | None) -> int:
    """Return how many threads simulate."""
    return processors() if threads is None else whole(threads, "threads", 1, MOST_THREADS)


def _units_of_joints(arm: SpaceArm) -> dict[str, str]:
    """Return the units that depend on how joints move; one for each joint where they differ."""
    position = Quantity("rad or m", "joint").unit_for(arm.slides)
    rate = Quantity("rad/s or m/s", "joint").unit_for(arm.slides)
    return {
        "q": position,
        "q0": position,
        "dq": rate,
        "sigma_min": arm.sigma_unit,
        "distance": arm.travel_unit,
    }


def _prepared_all(
    systems: Sequence[System], stop: Sequence[str], integration: Integration
) -> list[Prepared]:
    """Return what the equations take of each run; the same where the systems do not differ."""
    first = systems[0]
    laws = {tuple((tip, id(law)) for tip, law in one.controllers.items()) for one in systems}

    def ready(system: System) -> Prepared:
        wanted = wanted_events(system, integration, stop)
        return prepared(system, wanted, trace=len(laws) <= KINDS)

    known = ready(first)
    memories = {tuple(map(len, one.memories)) for one in systems}
    differ = len(laws) > 1 or any(one.arm is not first.arm for one in systems)
    differ = differ or len(memories) > 1
    if differ or known.outside or first.mode == "fixed" or first.hold:
        return [ready(system) for system in systems]
    return [known] * len(systems)


def _pieces(ready: Sequence[Prepared], size: int) -> Iterator[list[int]]:
    """Return the numbers of runs that go side by side: those of one setup, so many at most.

    Runs whose functions are called in Python go one by one: nothing is gained side by side.
    """
    setups: dict[Any, list[int]] = {}
    for i, one in enumerate(ready):
        setups.setdefault(one.setup, []).append(i)
    for runs in setups.values():
        size = 1 if ready[runs[0]].outside else size
        yield from (runs[at : at + size] for at in range(0, len(runs), size))


def _arm_of(starts: Sequence[Configuration]) -> SpaceArm:
    """Return the arm of all starts.

    Raises:
        ConfigurationError: There are none, or their arms differ by more than masses.
    """
    if not starts:
        raise ConfigurationError("starts is empty; give configurations: [arm.at(q) for q in Q0]")
    arm = starts[0].arm
    if any(structure_of(own) != structure_of(arm) for own in {cfg.arm for cfg in starts}):
        raise ConfigurationError("the starts are of several arms; give configurations of one arm")
    return arm
