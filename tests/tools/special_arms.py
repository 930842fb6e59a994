"""Compare nearest singular postures of arms of special build with those of an independent search.

    python tests/tools/special_arms.py 500
    python tests/tools/special_arms.py 500 --seed 7 --workers 2 --postures 3 --log arms.jsonl

Arms of even seeds have 2 to 7 joints, with parallel, crossing and coincident axes, offsets that are
zero or tiny, links of 10 g to 100 kg, spacecraft of 1 kg to 100 t, and any task that they can do.
Arms of odd seeds are redundant, of 3 to 8 joints: planar ones, ones with spherical shoulders and
wrists, and others. The base floats or its attitude is controlled. In about a third of the cases
only postures within the joint limits are searched. The other search, `independent_search` in
tests/helpers, computes its own J*, in NumPy, from the numbers that the URDF file is written from.

Contradictions are postures where the package finds none and the other search does, where it finds
one that is farther, or one that is not singular, or proves a distance that is too long; where it
says kinematic of a dynamic singularity or the other way round, or finds a task impossible that is
not. Each is listed, and one ends the script with status 1. With a log, a run that was stopped is
continued.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from helpers.arms import chosen
from helpers.independent_search import IndependentSearch
from helpers.numeric_arm import Mode, NumericArm

import spacearm as sa

TASKS: dict[int, tuple[str, ...]] = {
    1: ("x", "y", "z", "rz", "rx"),
    2: ("x y", "y z", "rx ry", "z rz", "x rx"),
    3: ("position", "orientation", "x y rz", "x z ry", "x rx ry"),
    4: ("x y z rz", "x y rx ry", "z rx ry rz"),
    5: ("x y z rx ry", "x y rx ry rz"),
    6: ("pose",),
}
"""Tasks by their number of components."""
PLANAR = {1: ("x", "rz"), 2: ("x y", "x rz"), 3: ("x y rz",)}
"""Tasks of arms whose axes are parallel to z."""
POSSIBLE = 1e-11
"""Share of sigma_max that sigma_min is at least at some postures where a task is possible."""
FARTHER = 1e-4
"""Share by which a posture found may be farther than that of the other search, whose sigma_min is
zero only within rounding: where slopes vanish too, the posture is known to fewer digits."""
WITHIN_ROUNDING = 1e-12
"""Share of |J*| up to which sigma_min may be its rounding: a posture counts as singular."""
NEAR, APART = 1e-6, 1e-3
"""Distances to a set, to first order, up to which a posture is on it and from which it is not."""
EYE = np.eye(3)


def special_arm(rng: np.random.Generator) -> NumericArm:
    """Draw an arm whose axes are parallel, crossing or coincident more often than not."""
    n = int(rng.choice((2, 3, 4, 5, 6, 7), p=(0.15, 0.25, 0.2, 0.15, 0.15, 0.1)))
    k = n if rng.uniform() < 0.65 else int(rng.integers(1, n + 1))
    axis = np.empty((n, 3))
    place = np.empty((n, 3))
    before = EYE[rng.integers(3)]
    flat = rng.uniform() < 0.2
    for i in range(n):
        parallel = flat or rng.uniform() < 0.45
        axis[i] = before if parallel else EYE[rng.integers(3)]
        if not flat and rng.uniform() < 0.08:
            axis[i] = rng.normal(size=3)
            axis[i] /= np.linalg.norm(axis[i])
        size = float(rng.choice((0.3, 1.0, 3.0)))
        kinds = (
            np.zeros(3),
            size * before,
            size * axis[i],
            size * EYE[rng.integers(3)],
            1e-3 * EYE[rng.integers(3)],
            size * rng.normal(size=3),
        )
        place[i] = kinds[int(rng.choice(6, p=(0.25, 0.15, 0.1, 0.3, 0.05, 0.15)))]
        before = axis[i]
    tip = EYE[rng.integers(3)] * float(rng.choice((0.0, 0.1, 1.0), p=(0.1, 0.2, 0.7)))
    return with_task(rng, with_bodies(rng, axis, place, tip), k, TASKS)


def redundant_arm(rng: np.random.Generator) -> NumericArm:
    """Draw an arm of more joints than task components: planar, with spherical joints, or any."""
    kind = rng.choice(("planar", "spherical", "any"), p=(0.3, 0.35, 0.35))
    if kind == "planar":
        n = int(rng.integers(3, 6))
        axis, place = np.tile(EYE[2], (n, 1)), np.zeros((n, 3))
        place[:, 0] = rng.choice((0.0, 0.3, 1.0, 2.0), n, p=(0.15, 0.3, 0.4, 0.15))
        tip = EYE[0] * float(rng.choice((0.1, 1.0)))
        least = min(n - 1, 3)
        return with_task(rng, with_bodies(rng, axis, place, tip), least, PLANAR)
    n = int(rng.integers(4, 9))
    numbers = rng.integers(3, size=n)
    for i in range(1, n):  # neighbours cross rather than being parallel
        if numbers[i] == numbers[i - 1] and rng.uniform() < 0.7:
            numbers[i] = (numbers[i] + rng.integers(1, 3)) % 3
    axis = EYE[numbers]
    size = rng.choice((0.3, 1.0, 3.0), n)
    if kind == "spherical":  # links between some of the joints alone
        long = rng.uniform(size=n) < 0.35
        place = np.where(long[:, None], size[:, None] * axis, 0.0)
    else:
        some = rng.choice(4, n, p=(0.3, 0.4, 0.1, 0.2))
        ways = np.stack((np.zeros((n, 3)), EYE[rng.integers(3, size=n)], 1e-3 * axis, axis), axis=1)
        place = size[:, None] * ways[np.arange(n), some]
    tip = EYE[rng.integers(3)] * float(rng.choice((0.0, 0.1, 1.0), p=(0.1, 0.2, 0.7)))
    k = min(n - 1, int(rng.choice((1, 2, 3, 4, 5, 6), p=(0.05, 0.1, 0.25, 0.1, 0.15, 0.35))))
    return with_task(rng, with_bodies(rng, axis, place, tip), k, TASKS)


def with_bodies(
    rng: np.random.Generator, axis: np.ndarray, place: np.ndarray, tip: np.ndarray
) -> NumericArm:
    """Draw the masses of an arm, which has no task yet."""
    n = len(axis)
    mass = np.append(10.0 ** rng.uniform(0.0, 5.0), 10.0 ** rng.uniform(-2.0, 2.0, n))
    ends = np.vstack((place[1:], tip))
    com, inertia = np.zeros((n + 1, 3)), np.empty((n + 1, 3, 3))
    width = float(rng.choice((0.3, 1.0, 3.0)))
    inertia[0] = mass[0] / 6.0 * width**2 * EYE
    for i in range(n):
        com[i + 1] = float(rng.choice((0.0, 0.5))) * ends[i]
        if rng.uniform() < 0.2:
            com[i + 1] += 0.2 * rng.normal(size=3)
        long = ends[i] @ ends[i] * EYE - np.outer(ends[i], ends[i])
        radius = float(rng.choice((0.02, 0.2)))
        inertia[i + 1] = mass[i + 1] * (long / 12.0 + 0.4 * radius**2 * EYE)
    limit = np.full(n, 3.0)
    return NumericArm(mass, com, inertia, place, axis, tip, "", -limit, limit)


def with_task(
    rng: np.random.Generator, arm: NumericArm, k: int, tasks: dict[int, tuple[str, ...]]
) -> NumericArm:
    """Draw a task of k components, or fewer where the arm can do no such task."""
    for rows in (k, k, k, k - 1, k - 1, *range(k - 2, 0, -1)):
        arm = replace(arm, task=str(rng.choice(tasks[min(max(rows, 1), max(tasks))])))
        sigma = np.linalg.svd(arm.jacobians(rng.uniform(-3, 3, (8, arm.n))), compute_uv=False)
        if (sigma[:, -1] > POSSIBLE * sigma[:, 0]).any():
            break
    return arm


def arm_of(seed: int, rng: np.random.Generator) -> NumericArm:
    """Draw the arm of a seed, with joint limits about any posture."""
    arm = redundant_arm(rng) if seed % 2 else special_arm(rng)
    middle, half = rng.uniform(-1.5, 1.5, arm.n), rng.uniform(0.2, 1.5, arm.n)
    return replace(arm, lower=middle - half, upper=middle + half)


@dataclass(frozen=True)
class Case:
    """One posture, and the nearest singular ones that both searches found.

    Attributes:
        seed: Seed of the arm.
        joints: Number of its joints.
        rows: Number of its task's components.
        task: Its task.
        mode: What the spacecraft does.
        limits: Whether joint limits count.
        q: The posture.
        found: Distance found by the package [rad]; inf if it found none.
        other: Distance found by the other search [rad]; inf if it found none.
        certified: Distance within which the package proves that none is [rad].
        estimate: Distance to first order [rad].
        faults: What is wrong with the posture found.
        verdict: What the package says.
    """

    seed: int
    joints: int
    rows: int
    task: str
    mode: Mode
    limits: bool
    q: tuple[float, ...]
    found: float
    other: float
    certified: float
    estimate: float
    faults: tuple[str, ...]
    verdict: str

    @property
    def false(self) -> tuple[str, ...]:
        """What the package says and is not so; empty if nothing."""
        told = list(self.faults)
        if self.certified > self.other * (1.0 + FARTHER) + 1e-9:
            told.append("false proof")
        return tuple(told)

    @property
    def missed(self) -> tuple[str, ...]:
        """Whether the search of the package missed a nearer posture, which it does not rule out."""
        if np.isinf(self.found) and np.isfinite(self.other):
            return ("none found",)
        return ("farther",) if self.found > self.other * (1.0 + FARTHER) + 1e-7 else ()

    @property
    def contradictions(self) -> tuple[str, ...]:
        """What the other search contradicts; empty if nothing."""
        return (*self.false, *self.missed)

    def __str__(self) -> str:
        limits = ", within limits" * self.limits
        return (
            f"arm {self.seed} ({self.joints} joints, {self.task}, {self.mode}{limits}): "
            f"{', '.join(self.contradictions)}: found {self.found:.6g}, other search "
            f"{self.other:.6g}, to first order {self.estimate:.3g}, certified "
            f"{self.certified:.4g}: {self.verdict}"
        )


def compared(seed: int, postures: int) -> list[Case]:
    """Compare the postures of one arm; an arm that can never do its task has none, or a fault."""
    rng = chosen(seed)
    arm = arm_of(seed, rng)
    loaded = arm.loaded()
    warnings.simplefilter("ignore", sa.ModelWarning)  # postures outside the limits are meant
    cases = []
    for _ in range(postures):
        mode: Mode = "free-floating" if rng.uniform() < 0.65 else "attitude-controlled"
        limits = bool(rng.uniform() < 0.35)
        q = rng.uniform(arm.lower, arm.upper) if limits else rng.uniform(-np.pi, np.pi, arm.n)
        search = IndependentSearch(arm, q, rng, mode, limits)
        report = sa.singularity(loaded.at(q), mode=mode)
        if report.impossible:
            if search.possible:
                fault = ("possible after all",)
                facts = np.inf, np.inf, 0.0, report.distance, fault, report.verdict
                cases.append(Case(seed, *_about(search), *facts))
            continue
        cases.append(_case(seed, loaded, search, report))
    return cases


def _case(
    seed: int, loaded: sa.SpaceArm, search: IndependentSearch, estimate: sa.SingularityReport
) -> Case:
    """Compare one posture."""
    q, mode, limits = search.q, search.mode, search.limits
    found, certified, nearest = np.inf, 0.0, None
    if limits:
        try:
            near = sa.singular_set(loaded, mode=mode).nearest(q, limits=True)
        except sa.NoSolutionError as error:
            verdict = str(error)
        else:
            nearest, found, certified = near.q, near.distance, near.distance_proven
            verdict = near.describe().verdict
    else:
        report = sa.singularity(loaded.at(q), mode=mode, exact=True)
        nearest, certified, verdict = report.nearest, report.distance_proven, report.verdict
        found = np.inf if nearest is None else report.distance
    faults = [] if nearest is None else list(_faults(loaded, search, nearest, found))
    other, _ = search.nearest()
    facts = found, other, certified, estimate.distance, tuple(faults), verdict
    return Case(seed, *_about(search), *facts)


def _about(search: IndependentSearch) -> tuple[int, int, str, Mode, bool, tuple[float, ...]]:
    """Return the number of joints and components, the task, the mode, limits and the posture."""
    arm, q = search.arm, tuple(search.q.tolist())
    return arm.n, len(arm.rows), arm.task, search.mode, search.limits, q


def _faults(
    loaded: sa.SpaceArm, search: IndependentSearch, nearest: np.ndarray, found: float
) -> Iterable[str]:
    """Yield what is wrong with a singular posture that the package found."""
    x, mode = nearest - search.q, search.mode
    if abs(np.linalg.norm(x) - found) > 1e-9:
        yield "another distance"
    if (search.within(x) != x).any() and np.abs(search.within(x) - x).max() > 1e-9:
        yield "outside its limits"
    if distance_to_set(search, x) > NEAR:
        yield "not singular"
        return
    report = sa.singularity(loaded.at(nearest), mode=mode)
    away = distance_to_set(replace(search, mode="fixed"), x)
    if report.kind == "regular":
        yield "called regular"
    elif report.kind == "dynamic" and away < NEAR:
        yield "kinematic after all"
    elif report.kind == "kinematic" and away > APART:
        yield "dynamic after all"


def distance_to_set(search: IndependentSearch, x: np.ndarray) -> float:
    """Return how far the set is from an offset (n,); zero on it, inf if it is not reached."""
    size = np.linalg.norm(search.arm.jacobians((search.q + x)[None], search.mode)[0])
    if search.sigma(x[None])[0][0] <= WITHIN_ROUNDING * size:
        return 0.0
    ends = replace(search, limits=False).landed(x[None])
    return float(np.linalg.norm(ends - x, axis=1).min()) if len(ends) else np.inf


def main() -> int:
    """Compare many arms and list the contradictions."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("arms", type=int)
    parser.add_argument("--seed", type=int, default=0, help="seed of the first arm")
    parser.add_argument("--postures", type=int, default=2)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument(
        "--log", type=Path, help="file that the arms done are read from and added to"
    )
    args = parser.parse_args()
    done = logged(args.log)
    cases = [case for seed in sorted(done) for case in done[seed]]
    seeds = [seed for seed in range(args.seed, args.seed + args.arms) if seed not in done]
    with ProcessPoolExecutor(args.workers) as pool:
        jobs = {pool.submit(compared, seed, args.postures): seed for seed in seeds}
        for job in as_completed(jobs):
            done[jobs[job]] = some = job.result()
            cases += some
            if args.log:
                line = {"seed": jobs[job], "cases": [asdict(case) for case in some]}
                with args.log.open("a", encoding="utf-8") as log:
                    log.write(json.dumps(line) + "\n")
            for case in some:
                if case.contradictions:
                    print(case, flush=True)
    print(summary(done))
    return int(any(case.contradictions for case in cases))


def logged(log: Path | None) -> dict[int, list[Case]]:
    """Return the cases of the arms in a log, by their seeds."""
    if log is None or not log.exists():
        return {}
    lines = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    return {line["seed"]: [Case(**case) for case in line["cases"]] for line in lines}


def summary(done: dict[int, list[Case]]) -> str:
    """Say how many were compared, what was contradicted and which search found nearer ones."""
    cases = [case for some in done.values() for case in some]
    arms = sum(bool(some) for some in done.values())
    counts = Counter(word for case in cases for word in case.contradictions)
    wrong = sum(bool(case.contradictions) for case in cases)
    listed = ", ".join(f"{word}: {count}" for word, count in counts.most_common())
    both = [case for case in cases if np.isfinite(case.found) and np.isfinite(case.other)]
    nearer = [case.found / case.other for case in both if "farther" in case.contradictions]
    missed = [case for case in cases if case.found < case.other * (1.0 - FARTHER) - 1e-7]
    neither = sum(np.isinf(case.found) and np.isinf(case.other) for case in cases)
    distances = np.degrees([case.found for case in both])
    redundant = sum(case.joints > case.rows for case in cases)
    return (
        f"{arms} arms, {len(cases)} postures ({redundant} of redundant arms, "
        f"{sum(case.limits for case in cases)} within limits, "
        f"{sum(case.mode != 'free-floating' for case in cases)} attitude-controlled): "
        f"{wrong} contradictions{f' ({listed})' if listed else ''}; the other search found nearer "
        f"ones in {len(nearer)}{f', the median {np.median(nearer):.4g} times' if nearer else ''}; "
        f"the package in {len(missed)}; neither found one in {neither}; median distance "
        f"{np.median(distances) if len(distances) else np.nan:.3g}°"
    )


if __name__ == "__main__":
    raise SystemExit(main())
