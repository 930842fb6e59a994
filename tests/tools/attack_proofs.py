"""Try to contradict proven distances and clearances of random arms.

    python tests/tools/attack_proofs.py 1000          # proofs
    python tests/tools/attack_proofs.py 1000 --seed 7 --workers 4

Arms have 2 to 7 joints, as many as their task has rows or more; they are spatial or planar, turn or
slide, on heavy and light spacecraft that float, hold their attitude or are fixed. Proven are
distances of postures, of postures within the joint limits, and clearances of paths. Each proof is
attacked by descents on J* alone: from starts within what is proven free to where J* loses rank, and
along the set towards the posture. A singular posture within it is a contradiction. One that is
nearer to the border than a millionth counts by the least singular value of J* to 50 digits, of
which the rest of the way follows. Each arm has a seed of its own, and arms count in the order of
their seeds: the totals are the same for any number of workers. A contradiction ends with status 1.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from collections import Counter, deque
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import mpmath as mp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from helpers import precise
from helpers.arms import frame, joint, link, load_text, random_chain, random_link, robot

import spacearm as sa
from spacearm.mechanics.distance import linearise
from spacearm.model.joints import joint_scales
from spacearm.processes import ONE_THREAD

SPATIAL = {2: ("x y",), 3: ("position", "x y"), 4: ("position",), 5: ("x y z rx ry", "position")}
SPATIAL |= {6: ("pose",), 7: ("pose",)}
PLANAR = {2: ("x y",), 3: ("x y rz", "x y"), 4: ("x y rz",)}
MODES = ("free-floating", "free-floating", "attitude-controlled", "fixed")
EACH, STARTS, STEPS = 20, 48, 14
"""Proofs of an arm; starts of an attack; steps of a descent, and along the set."""
LANDED, CLOSE = 1e-7, 1e-6
"""Distance to the set of a descent that has arrived; share of the proven distance that is near."""


class Attacked(NamedTuple):
    """What came of an arm: its kind, proofs, proofs that failed, contradictions, near ones."""

    kind: str
    proofs: int = 0
    none: int = 0
    wrong: int = 0
    near: int = 0


def planar_chain(rng: np.random.Generator, n: int) -> str:
    """A random arm in the plane."""
    elements = [link("bus", 10 ** rng.uniform(0, 3), inertia=10 ** rng.uniform(0, 2) * np.eye(3))]
    for i in range(1, n + 1):
        com = [*rng.normal(size=2) * 0.4, 0.0]
        heavy = 10 ** rng.uniform(-0.5, 1.5)
        elements.append(link(f"link_{i}", heavy, com, heavy * rng.uniform(0.01, 0.3) * np.eye(3)))
        before, place = "bus" if i == 1 else f"link_{i - 1}", [*rng.normal(size=2) * 0.6, 0.0]
        elements.append(joint(f"joint_{i}", before, f"link_{i}", xyz=place))
    elements += [frame("tip"), joint("end", f"link_{n}", "tip", "fixed", xyz=(0.7, 0.1, 0))]
    return robot(*elements)


def random_arm(rng: np.random.Generator) -> tuple[str, sa.SpaceArm]:
    """Draw an arm; small ones more often."""
    if rng.uniform() < 0.2:
        n = int(rng.integers(2, 5))
        return "planar", load_text(planar_chain(rng, n), task=str(rng.choice(PLANAR[n])))
    n = int(rng.choice((2, 3, 4, 5, 6, 7), p=(0.17, 0.25, 0.2, 0.13, 0.2, 0.05)))
    slides = n < 6 and rng.uniform() < 0.3
    text = random_chain(rng, n, ("revolute", "prismatic") if slides else ("revolute",))
    if light := rng.uniform() < 0.2:
        start, end = text.index('<link name="bus">'), text.index('<link name="link_1">')
        text = text[:start] + random_link(rng, "bus", 10 ** rng.uniform(-1, 0)) + text[end:]
    arm = load_text(text, task=str(rng.choice(SPATIAL[n])))
    kind = "square" if n == arm.task.k else "redundant"
    return ", ".join([kind, *["sliding"] * slides, *["light"] * light]), arm


class Attack:
    """The search for a singular posture nearer to a path (m, n) than is proven.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        path: Its rows; one of a posture.
        ends: (2, n) least and largest positions that count.
        proven: The distance.
    """

    def __init__(self, arm, mode, path, ends, proven: float) -> None:
        self.arm, self.mode, self.proven, self.unit = arm, mode, proven, joint_scales(arm)
        self.rows, self.ends = path / self.unit, ends / self.unit

    def feet(self, X: np.ndarray) -> np.ndarray:
        """The nearest points of the path, (m, n)."""
        best, least = np.tile(self.rows[0], (len(X), 1)), np.full(len(X), np.inf)
        for a, b in zip(self.rows[:-1], self.rows[1:], strict=True):
            t = np.clip((X - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0.0, 1.0)
            foot = a + t[:, None] * (b - a)
            away = np.linalg.norm(X - foot, axis=1)
            best, least = np.where((away < least)[:, None], foot, best), np.minimum(away, least)
        return best

    def distances(self, X: np.ndarray) -> np.ndarray:
        return np.linalg.norm(X - self.feet(X), axis=1)

    def starts(self, rng: np.random.Generator) -> np.ndarray:
        """Points within what is proven, every other one near its border."""
        way = rng.normal(size=(STARTS, self.arm.n))
        share = np.where(np.arange(STARTS) % 2, 0.97, rng.uniform(size=STARTS))
        way *= (self.proven * share / np.linalg.norm(way, axis=1))[:, None]
        return np.clip(self.rows[rng.integers(len(self.rows), size=STARTS)] + way, *self.ends)

    def landed(self, X: np.ndarray, steps: int, along: float = 0.0) -> np.ndarray:
        """Steps to the linearised set, and along it towards the path."""
        for _ in range(steps):
            distance, _, rows = linearise(self.arm, self.unit * X, self.mode, expected=10**5)
            distance = np.minimum(np.nan_to_num(distance, posinf=0.0), 0.2)
            if along:
                pull = self.feet(X) - X
                across = np.linalg.pinv(rows) @ (rows @ pull[:, :, None])
                X = X + along * (pull - across[:, :, 0])
            X = np.clip(X - distance[:, None] * rows[:, 0], *self.ends)
        return X

    def run(self, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        """The singular posture found that is nearest, and how far it is."""
        X = self.landed(self.starts(rng), STEPS)
        best = X[np.argsort(self.distances(X))[: STARTS // 4]]
        X = np.vstack((X, self.landed(self.landed(best, STEPS, 0.3), 5)))
        left = linearise(self.arm, self.unit * X, self.mode, expected=10**5).distance
        X = X[left < LANDED]
        if not len(X):
            return self.rows[0], np.inf
        x = X[np.argmin(self.distances(X))]
        return self.unit * x, float(self.distances(x[None])[0])


def left_over(arm, q: np.ndarray, mode: str) -> float:
    """How far the set is from a posture that is singular to rounding, by 50 digits [rad]."""
    mp.mp.dps = 50
    cfg = arm.at(q)
    sigma = precise.singular_values(cfg, precise.generalized_jacobian(cfg, mode))[-1]
    near = linearise(arm, q[None], mode)
    slope = float(near.sigma[0] / near.distance[0]) if near.distance[0] else np.inf
    return 2.0 * float(sigma) / slope if np.isfinite(slope) else 0.0


def attack(seed: int) -> Attacked:
    """Prove distances of one random arm, and attack each."""
    rng = np.random.default_rng(seed)
    kind, arm = random_arm(rng)
    mode = MODES[rng.integers(len(MODES))]
    try:
        found = sa.singular_set(arm, mode=mode)
    except sa.UnsupportedError:  # the arm can never do the task
        return Attacked(kind)
    proofs = none = wrong = close = 0
    for i in range(EACH):
        q = np.clip(rng.uniform(-np.pi, np.pi, arm.n), arm.lower, arm.upper)
        limits, path = i % 4 == 1, q[None]
        if i % 4 == 2:
            path = np.clip(q + rng.uniform(-0.3, 0.3, (3, arm.n)), arm.lower, arm.upper)
        try:
            near = found.nearest(path if len(path) > 1 else q, limits=limits)
        except sa.NoSolutionError:
            near = None
        if near is None or not near.distance_proven:
            none += 1
            continue
        proofs += 1
        proven = near.distance_proven
        ends = np.array((arm.lower, arm.upper) if limits else np.outer((-9e9, 9e9), np.ones(arm.n)))
        at, away = Attack(arm, mode, path, ends, proven).run(rng)
        if away >= proven:
            continue
        certain = away < proven * (1.0 - CLOSE) or away + left_over(arm, at, mode) < proven
        wrong, close = wrong + certain, close + (not certain)
        if certain:
            print(
                f"\ncontradiction: seed {seed}, {kind}, {arm.task.names}, {mode}, proof {i}: "
                f"path {path.tolist()}, at {at.tolist()}, {away!r} < {proven!r}",
                flush=True,
            )
    return Attacked(kind, proofs, none, wrong, close)


def main() -> int:
    """Attack as many proofs as asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("proofs", type=int, help="how many")
    parser.add_argument("--seed", type=int, default=0, help="of the first arm")
    parser.add_argument(
        "--workers",
        type=int,
        default=os.cpu_count(),
        help="processes; all cores if left out",
    )
    asked = parser.parse_args()
    os.environ.update(ONE_THREAD)
    total, arms, kinds = np.zeros(4, dtype=int), 0, Counter[str]()
    began = time.monotonic()
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(asked.workers, spawn) as pool:
        ahead = 4 * asked.workers  # arms of which the first is waited for
        waiting = deque(pool.submit(attack, asked.seed + i) for i in range(ahead))
        while total[0] < asked.proofs:
            result, arms = waiting.popleft().result(), arms + 1
            waiting.append(pool.submit(attack, asked.seed + ahead + arms - 1))
            total += result[1:]
            kinds[result.kind] += result.proofs
            print(
                f"\r{total[0]:,} of {asked.proofs:,} proofs, {arms:,} arms, {total[2]:,} "
                f"contradictions, {time.monotonic() - began:,.0f} s",
                end="",
                file=sys.stderr,
            )
        pool.shutdown(wait=False, cancel_futures=True)
    proofs, none, wrong, close = total.tolist()
    print(
        f"\n{proofs:,} proofs of {arms:,} arms, {wrong:,} contradictions; {close:,} singular "
        f"postures at the border, not within; {none:,} questions without a proof; "
        f"{time.monotonic() - began:,.0f} s on {asked.workers:,} workers"
    )
    print("; ".join(f"{kind} {number:,}" for kind, number in sorted(kinds.items())))
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
