"""Dispersions of a catch: how many catches succeed where the target is not quite as planned."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import LARGEST, Array, Parameters, generator, plain, positive, whole, within
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.dynamics import generalized_velocity, spacecraft_twist
from spacearm.mechanics.target import Target
from spacearm.mission.catch_report import Catch, grasp_of
from spacearm.mission.kept_limits import with_checks
from spacearm.model.arguments import HELD
from spacearm.model.arm import Configuration
from spacearm.motion.controllers import Tracking
from spacearm.motion.events import Event
from spacearm.motion.flights import Flight, Grasp, LimitCheck
from spacearm.motion.motion import Motion, Trajectory
from spacearm.motion.plant import Integration, Plant, Sampling
from spacearm.motion.simulation import COARSE, trajectories_of
from spacearm.processes import check_memory
from spacearm.results import Cell, Column, Description, Measure, Result, Table
from spacearm.signatures import checked

#: What an envelope bounds, and a run is measured by.
MISSES = ("place", "turn", "velocity", "rate")
#: Samples of each phase at which limits are checked; the peak between them is that of a parabola.
SAMPLES = 200
#: Numbers that a run keeps for each sample, and for each sample and joint, as measured.
EACH_SAMPLE, EACH_JOINT = 16, 5
#: The phases, as of `Catch.fly`.
PHASES = ("approach", "closing in", "braking")


@checked
@dataclass(frozen=True, kw_only=True)
class TargetErrors(Parameters):
    """How wrong the estimate is with which a catch was planned.

    Errors of pose and twist are those of the estimate at time 0, normally distributed along all
    axes alike; the values are the root mean square of their length. Masses are uniformly
    distributed.

    Attributes:
        mass: Largest error of the mass, as a share.
        inertia: The same of the inertia about its CM, by a factor of its own.
        place: Error of the position of its CM [m].
        turn: Error of its attitude [rad].
        velocity: Error of the velocity of its CM [m/s].
        rate: Error of its angular velocity [rad/s].
        delay: Age of the estimate that is taken as that of time 0 [s].
    """

    mass: float = 0.2
    inertia: float = 0.2
    place: float = 0.01
    turn: float = float(np.radians(1.0))
    velocity: float = 5e-4
    rate: float = 5e-4
    delay: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            within(value, name, 0.0, LARGEST)
        for name in ("mass", "inertia"):
            if getattr(self, name) >= 1.0:
                raise ConfigurationError(f"{name} is {getattr(self, name)}; give a share below 1")

    def sample(self, target: Target, rng: np.random.Generator) -> Target:
        """Draw a target from these errors.

        Args:
            target: The estimated target.
            rng: Random numbers.
        """
        mass, inertia = 1.0 + np.array([self.mass, self.inertia]) * rng.uniform(-1.0, 1.0, 2)
        place, turn, velocity, rate = rng.normal(size=(4, 3)) / np.sqrt(3.0)
        seen = target.at(self.delay)
        R, w = pin.exp3(self.turn * turn) @ seen.pose.rotation, seen.twist[3:] + self.rate * rate
        com = seen.pose.act(target.com) + self.place * place
        lever = R @ target.com
        v = seen.twist[:3] + np.cross(seen.twist[3:], seen.pose.rotation @ target.com)
        v = v + self.velocity * velocity - np.cross(w, lever)
        there = pin.SE3(R, com - lever)
        moved = target.replace(pose=there, twist=np.concatenate((v, w)))
        return moved.scaled(float(mass), float(inertia))


@checked
@dataclass(frozen=True, kw_only=True)
class CaptureEnvelope(Parameters):
    """What a gripper tolerates at contact, between the tip and the grapple frame.

    Attributes:
        place: Largest distance [m].
        turn: Largest angle [rad].
        velocity: Largest relative velocity [m/s].
        rate: Largest relative angular velocity [rad/s].
    """

    place: float = 0.03
    turn: float = float(np.radians(3.0))
    velocity: float = 0.02
    rate: float = float(np.radians(2.0))

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            positive(value, name)


class CatchRuns(Result, kw_only=True):
    """Runs of a catch with targets that differ from the planned one, from `sa.fly_many`.

    Attributes:
        catch: The catch.
        envelope: What counts as caught.
        place: (m,) distance of the tip from the grapple frame at contact [m].
        turn: (m,) angle between them [rad].
        velocity: (m,) relative velocity there [m/s].
        rate: (m,) relative angular velocity [rad/s].
        caught: (m,) whether all four are within the envelope.
        energy_lost: (m,) energy that the impact takes [J]; NaN where not caught.
        impulse: (m,) linear impulse on the tip [N s]; NaN where not caught.
        dq: (m,) largest joint rate once the braking has ended [rad/s] or [m/s]; NaN likewise.
        tumble: (m,) rate at which the spacecraft then turns [rad/s]; NaN likewise.
        ended: (m,) how each run ended: "missed", "duration", or what failed.
        masses: (m,) mass of each target [kg].
        limits: The limits of the catch in each run, as `Flight.limits` has them: each with its
            largest value, and when it is exceeded.
        events: The events "limit exceeded" of each run, each with its time and value.
    """

    catch: Catch
    envelope: CaptureEnvelope
    place: Array
    turn: Array
    velocity: Array
    rate: Array
    caught: Any
    energy_lost: Array
    impulse: Array
    dq: Array
    tumble: Array
    ended: tuple[str, ...]
    masses: Array
    limits: tuple[tuple[LimitCheck, ...], ...]
    events: tuple[tuple[Event, ...], ...]

    @property
    def kept(self) -> Any:
        """(m,) whether each run keeps all limits of the catch."""
        return np.array([all(check.exceeded is None for check in run) for run in self.limits])

    @property
    def exceeded(self) -> dict[str, int]:
        """The number of runs that exceed each limit, by its name; limits that all keep left out."""
        names = [check.limit for run in self.limits for check in run if check.exceeded is not None]
        return {name: names.count(name) for name in dict.fromkeys(names)}

    @property
    def share(self) -> float:
        """Share of the runs that are caught."""
        return float(np.mean(self.caught))

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of 95 % of the share, of Clopper and Pearson."""
        from scipy.stats import binomtest  # slow to import

        found = binomtest(int(np.sum(self.caught)), len(self.caught)).proportion_ci(0.95)
        return float(found.low), float(found.high)

    @property
    def not_checked(self) -> str:
        """What the answer does not cover."""
        held = "; momentum and torque of the wheels that hold the attitude"
        return (
            "collisions; looks at the target after its first estimate; forces of the contact itself"
            f"{held * (self.catch.mode == HELD)}"
        )

    def describe(self) -> Description:
        """Describe the share, the misses by kind, and what the caught ones do."""
        m, low, high = len(self.caught), *self.interval
        rows = list[tuple[Cell, ...]]()
        for name, unit in zip(MISSES, ("m", "rad", "m/s", "rad/s"), strict=True):
            values, most = getattr(self, name), getattr(self.envelope, name)
            shown = [Measure(float(x), unit) for x in (*np.percentile(values, (50, 95)), most)]
            rows.append((name, *shown, f"{np.mean(values > most):.1%}"))
        units = {"energy_lost": "J", "impulse": "N s", "dq": "rad/s", "tumble": "rad/s"}
        words = ("energy lost", "impulse on the tip", "joint rate when braked", "angular rate then")
        after = list[tuple[Cell, ...]]()
        for (name, unit), word in zip(units.items(), words, strict=True):
            values = getattr(self, name)[self.caught]
            if len(values):
                found = np.nanpercentile(values, (50, 95, 100))
                after.append((word, *(Measure(float(x), unit) for x in found)))
        columns = (Column("at contact"), Column("median"), Column("95 %"), Column("envelope"),
                   Column("outside"))  # fmt: skip
        tables = [Table(columns, rows, "Tip and grapple frame")]
        if after:
            heads = (Column(""), Column("median"), Column("95 %"), Column("largest"))
            tables.append(Table(heads, after, "Of those caught"))
        over = int(np.sum(~self.kept))
        limits = f"; limits EXCEEDED in {over} of {m} runs" if over else "; all limits kept"
        return Description(
            title=f"{self.catch.arm.name} and {self.catch.target.name}, {m} runs",
            verdict=f"{self.share:.1%} caught ({low:.1%} to {high:.1%} with 95 % confidence)"
            f"{limits}",
            tone="good" if low >= 0.5 and not over else "caution",
            tables=[*tables, *self._limit_tables()],
        )

    def _limit_tables(self) -> list[Table]:
        """Return the table of limits with the worst value of all runs, if there are limits."""
        worst: dict[str, LimitCheck] = {}
        for check in (check for run in self.limits for check in run):
            known = worst.get(check.limit)
            worst[check.limit] = check if known is None else known.worse(check)
        over = self.exceeded
        rows = [
            (
                name,
                Measure(check.value, check.unit),
                Measure(check.allowed, check.unit),
                over.get(name, 0),
            )
            for name, check in worst.items()
        ]
        columns = ("limit", "worst value", "allowed", "runs that exceed it")
        return [Table(columns, rows, "Limits")] * bool(rows)

    def to_dict(self) -> dict[str, Any]:
        """Return share and interval, and all values of the runs; of the catch its time."""
        told = {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "catch"}
        told |= {"contact": self.catch.t, "share": self.share, "interval": self.interval}
        told |= {"kept": self.kept, "not_checked": self.not_checked}
        return {name: plain(value) for name, value in told.items()}


@checked
def fly_many(
    catch: Catch,
    errors: TargetErrors = TargetErrors(),
    envelope: CaptureEnvelope = CaptureEnvelope(),
    *,
    runs: int = 100,
    seed: int = 0,
    plant: Plant = Plant(),
    sampling: Sampling | None = None,
    rate: float | None = None,
    integration: Integration = COARSE,
    progress: Callable[[float, float], object] | None = None,
) -> CatchRuns:
    """Fly a catch many times, with targets that differ from the estimate it was planned with.

    The arm flies as planned, by `sa.Tracking`, and does not look at the target again. If the tip
    is within the envelope of the true grapple frame at contact, it grasps the target by a plastic
    impact. The joints are then braked by the law that was planned with the estimated target. Wheels
    do what the plant says. The limits of the catch are checked along each run as `Catch.fly` checks
    them: at 200 samples of each phase, with the peaks between them estimated by parabolas.

    Args:
        catch: The catch.
        errors: How wrong the estimate is.
        envelope: What counts as caught.
        runs: Number of runs.
        seed: Of the targets, and of the noise.
        plant: What else acts, as in `simulate`.
        sampling: Period, delay and noise of the joint controller; None for one that acts
            continuously, without noise.
        rate: Rate of `sa.Tracking` [1/s]. If None it is 5, or `sampling.tracking_rate` if that is
            less.
        integration: As in `simulate`, with tolerances of 1e-6 and 1e-8; `dt` is the spacing of the
            samples, a two-hundredth of each phase if None.
        progress: Called as progress(done, total) now and then.

    Returns:
        How the runs went, and the share that is caught.

    Raises:
        ConfigurationError: An argument does not make sense.
        NoSolutionError: The approach itself fails with this plant.
        UnsupportedError: Several tips catch.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> start = sa.load("chaser7").at([0, 0.6, 0, 1.2, 0, 0.8, 0])
        >>> debris = sa.Target(
        ...     sa.Bus(60, size=(0.8, 0.8, 1), name="debris"),
        ...     start.tip * sa.pose((0.1, 0, 0.8)),
        ...     grapples={"ring": sa.pose((0, 0, -0.5))},
        ... )
        >>> catch = sa.catch(start, debris, window=(10, 10))
        >>> found = sa.fly_many(catch, sa.TargetErrors(place=0.05), runs=8)
        >>> bool(found.share < 1.0)
        True
    """
    if len(catch.frames) > 1:
        raise UnsupportedError(
            "catch is one by several tips, whose flights are not dispersed; catch.fly(actual) "
            "flies it with one target that differs"
        )
    m, rng = whole(runs, "runs", 1), generator(seed)
    check_memory(
        8.0 * m * len(PHASES) * (SAMPLES + 1) * (EACH_SAMPLE + EACH_JOINT * catch.arm.n),
        f"{m:,} runs",
        "use fewer runs",
    )
    actual = [errors.sample(catch.target, rng) for _ in range(m)]
    stages = 3.0
    if rate is None:
        rate = min(Tracking.rate, math.inf if sampling is None else sampling.tracking_rate)

    def tell(stage: int) -> Callable[[float, float], object]:
        def told(done: float, total: float) -> None:
            if progress:
                progress((stage + done / total) * m / stages, m)

        return told

    def led(stage: int, starts: list[Configuration], motion: Motion, dq: Array) -> list[Trajectory]:
        """Return the runs that are led along a motion."""
        own, lasts = None, float(motion.t[-1])
        if sampling is not None:  # noise of its own for each run and each stage
            own = replace(sampling, seed=sampling.seed + stage * m)
        how = replace(integration, events=(), dt=integration.dt or lasts / SAMPLES)
        return trajectories_of(
            starts,
            Tracking(motion, rate),
            lasts,
            dq=dq,
            mode=catch.mode,
            plant=plant,
            sampling=own,
            progress=tell(stage),
            integration=how,
        )

    alike = sampling is None or not sampling.noise(catch.arm.n).any()
    k = 1 if alike else m
    begun = replace(catch.plan, t=catch.begin + catch.plan.t)
    reached = led(0, [catch.plan[0]] * k, begun, np.zeros((k, catch.arm.n)))
    closing = led(1, [run[-1] for run in reached], catch.chase, _last_rates(reached))
    failed = [run.ended for run in (*reached, *closing) if run.ended != "duration"]
    if failed:
        raise NoSolutionError(
            f"the approach of {catch.arm.name} fails: {failed[0]}, led with a rate of {rate:.3g} "
            "1/s; give another rate, a shorter period and delay, or a plant that disturbs less"
        )
    flown = [[reached[i % k], closing[i % k]] for i in range(m)]
    ends, dq = [runs[-1][-1] for runs in flown], _last_rates([runs[-1] for runs in flown])
    off = np.array([_off(catch, *one) for one in zip(actual, ends, dq, strict=True)])
    bounds = [getattr(envelope, name) for name in MISSES]
    caught = (off <= bounds).all(axis=1)
    grasped = np.flatnonzero(caught)
    after = np.full((m, 4), np.nan)
    words = np.full(m, "missed", dtype=object)
    starts, rates, bodies = [], [], dict[int, Grasp]()
    for i in grasped.tolist():
        bodies[i] = grasp_of(actual[i], catch.t, ends[i].tip)
        hit = bodies[i].impact(ends[i], dq[i], catch.mode)
        after[i, :2] = hit.energy_lost, np.linalg.norm(hit.impulse[:3])
        starts.append(hit.configuration)
        rates.append(hit.dq)
    if starts:
        for i, run in zip(
            grasped.tolist(), led(2, starts, catch.brake, np.array(rates)), strict=True
        ):
            words[i] = run.ended
            turning = spacecraft_twist(run[-1], run.dq[-1], catch.mode)[3:]
            after[i, 2:] = np.abs(run.dq[-1]).max(), np.linalg.norm(turning)
            flown[i].append(run)
    limits = list[tuple[LimitCheck, ...]]()
    events = list[tuple[Event, ...]]()
    for i, phases in enumerate(flown):
        flight = _checked(catch, phases, bodies.get(i))
        limits.append(flight.limits)
        events.append(flight.events)
    return CatchRuns(
        catch=catch,
        envelope=envelope,
        **dict(zip(MISSES, off.T.copy(), strict=True)),
        caught=caught,
        **dict(zip(("energy_lost", "impulse", "dq", "tumble"), after.T.copy(), strict=True)),
        ended=tuple(str(word) for word in words),
        masses=np.array([one.mass for one in actual]),
        limits=tuple(limits),
        events=tuple(events),
    )


def _last_rates(runs: list[Trajectory]) -> Array:
    """Return the joint rates (m, n) at the ends of runs."""
    return np.array([run.dq[-1] for run in runs])


def _checked(catch: Catch, runs: list[Trajectory], body: Grasp | None) -> Flight:
    """Return one run as a flight, with the limits of the catch checked.

    Args:
        catch: The catch.
        runs: The trajectories of its phases.
        body: What the hand holds in the last one; None where nothing was caught.
    """
    begins = np.cumsum([0.0, *(run.t[-1] for run in runs[:-1])]).tolist()
    held = [None, None, body][: len(runs)]
    flight = Flight.joined(runs, begins, (), (), PHASES[: len(runs)], held)
    return with_checks(flight, catch.limits)


def _off(catch: Catch, actual: Target, cfg: Configuration, dq: Array) -> Array:
    """Return how far the tip is off the true grapple frame at contact (4,); see `MISSES`."""
    frame = actual.at(catch.t, catch.frames[cfg.arm.tip])
    apart = cfg.tip.actInv(frame.pose)
    twist = cfg.J @ generalized_velocity(cfg, dq, catch.mode) - frame.twist
    parts = apart.translation, pin.log3(apart.rotation), twist[:3], twist[3:]
    return np.array([np.linalg.norm(part) for part in parts])
