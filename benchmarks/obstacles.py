"""Plans among obstacles: made with the base held, and by spacearm, replayed with it floating.

    python benchmarks/obstacles.py [NUMBER [BUS MASS [TIMEOUT]]]

A UR5 on a cubic bus of 200 kg, among boxes that float in its reach. The planner with the base held
is RRT-Connect (Kuffner & LaValle 2000) with shortcuts, in joint space; its plans are proven free
for a base that does not move. They are then run with the spacecraft reacting, and checked again.
spacearm plans from the same start to the pose at which the held tip would have arrived.
"""

from __future__ import annotations

import os
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import spacearm as sa
from spacearm.collisions.separation import Collisions
from spacearm.collisions.swept_motion import Recorded
from spacearm.mechanics.floating import walk
from spacearm.planning.timing import largest_rates, rest_to_rest_times

NUMBER, BUS, TIMEOUT = 40, 200.0, 60.0
EDGE = 0.8
BOXES = 5
STEP = 0.1
"""Joint motion between two checks of the tree [rad]."""
NODES = 4000


class Outcome(NamedTuple):
    """What came of one problem."""

    held: bool
    meets: str
    miss: float
    planned: str
    seconds: float
    nearest: float


def arm_on(bus: float) -> sa.SpaceArm:
    return sa.mount("ur5", sa.Bus(bus, size=(EDGE, EDGE, EDGE)))


def still(arm: sa.SpaceArm, path: np.ndarray) -> sa.Motion:
    """The motion with the base held."""
    base = np.tile(np.eye(7)[6], (len(path), 1))
    return sa.Motion(arm, rest_to_rest_times(path, largest_rates(arm)), path, base, mode="fixed")


def floating(arm: sa.SpaceArm, path: np.ndarray) -> sa.Motion:
    """The same joint motion with the base reacting."""
    rows = walk(arm.at(path[0]), path)
    base = np.array([pin.SE3ToXYZQUAT(cfg.base) for cfg in rows])
    return sa.Motion(arm, rest_to_rest_times(path, largest_rates(arm)), path, base)


class Tree:
    """RRT-Connect between two postures, the base held."""

    def __init__(self, arm: sa.SpaceArm, obstacles: list[sa.Obstacle], rng: np.random.Generator):
        self.arm, self.rng, self.bodies = arm, rng, Collisions(arm, obstacles)
        self.low, self.high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)

    def apart(self, q: np.ndarray) -> bool:
        """Whether a posture keeps a centimetre from everything."""
        course = Recorded(still(self.arm, q[None]))
        return bool((self.bodies.margins(course, 0.0) > 0.01).all())

    def free(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether postures between two do."""
        m = int(np.abs(b - a).max() / STEP) + 2
        return all(self.apart(q) for q in a + np.linspace(0, 1, m)[1:, None] * (b - a))

    def extend(self, nodes: list, parents: list, to: np.ndarray) -> bool:
        """Grow towards a posture as far as it is free; whether it is reached."""
        near = int(np.argmin([np.abs(q - to).max() for q in nodes]))
        while True:
            step = to - nodes[near]
            there = nodes[near] + step * min(1.0, 2 * STEP / max(np.abs(step).max(), 1e-12))
            if not self.free(nodes[near], there):
                return False
            nodes.append(there)
            parents.append(near)
            near = len(nodes) - 1
            if np.allclose(there, to):
                return True

    def path(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
        """A path between two postures, shortened; None if none is found."""
        trees = [([start], [-1]), ([goal], [-1])]
        for i in range(NODES):
            a, b = trees[i % 2], trees[1 - i % 2]
            self.extend(*a, self.rng.uniform(self.low, self.high))
            if self.extend(*b, a[0][-1]):
                ways = [self.back(*tree) for tree in (trees[0], trees[1])]
                return self.shorter(np.vstack((ways[0][::-1], ways[1][1:])))
        return None

    def back(self, nodes: list, parents: list) -> list:
        """The way from the last node to the root."""
        i, way = len(nodes) - 1, []
        while i >= 0:
            way.append(nodes[i])
            i = parents[i]
        return way

    def shorter(self, path: np.ndarray) -> np.ndarray:
        """A path with shortcuts, in rows."""
        for _ in range(100):
            i, j = np.sort(self.rng.integers(0, len(path), 2))
            if j > i + 1 and self.free(path[i], path[j]):
                path = np.vstack((path[: i + 1], path[j:]))
        fine = [path[:1]]
        for a, b in pairwise(path):
            m = int(np.abs(b - a).max() / 0.02) + 1
            fine.append(a + np.linspace(0, 1, m + 1)[1:, None] * (b - a))
        return np.vstack(fine)


def problem(arm: sa.SpaceArm, seed: int) -> tuple[np.ndarray, list[sa.Obstacle], np.ndarray] | None:
    """A start, boxes clear of it, and a path proven free with the base held; None if none."""
    rng = np.random.default_rng((1993, seed))
    lone = Tree(arm, [], rng)
    while True:
        start, goal = (rng.uniform(lone.low, lone.high) for _ in range(2))
        if lone.apart(start) and lone.apart(goal) and sa.singularity(arm.at(start)).distance > 0.1:
            break
    top = arm.mount.translation
    boxes: list[sa.Obstacle] = []
    while len(boxes) < BOXES:
        place = top + rng.uniform(-0.9, 0.9, 3) * (1, 1, 0.5) + (0, 0, 0.45)
        turn = pin.Quaternion(*(x := rng.normal(size=4)) / np.linalg.norm(x)).matrix()
        box = sa.Obstacle.box(
            rng.uniform(0.1, 0.3, 3), pin.SE3(turn, place), name=f"box {len(boxes)}"
        )
        tree = Tree(arm, [box], rng)
        if tree.apart(start) and tree.apart(goal):
            boxes.append(box)
    path = Tree(arm, boxes, rng).path(start, goal)
    if path is None or not sa.collision_check(still(arm, path), boxes).apart:
        return None
    return start, boxes, path


def solve(seed: int, bus: float, timeout: float) -> Outcome:
    arm = arm_on(bus)
    found = problem(arm, seed)
    if found is None:
        return Outcome(False, "", np.nan, "", 0.0, np.nan)
    start, boxes, path = found
    held, real = still(arm, path), floating(arm, path)
    report = sa.collision_check(real, boxes)
    meets = "" if report.contact is None else " and ".join(report.contact.links)
    miss = float(np.linalg.norm(held.tip[-1, :3] - real.tip[-1, :3]))
    begun = time.perf_counter()
    try:
        plan = sa.plan(
            arm.at(start),
            pin.XYZQUATToSE3(held.tip[-1]),
            constraints=sa.Constraints(obstacles=boxes),
            search=sa.Search(timeout=timeout),
        )
    except sa.NoSolutionError as error:
        reason = str(error).split(". ")[1]
        return Outcome(True, meets, miss, f"fails: {reason}", time.perf_counter() - begun, np.nan)
    seconds = time.perf_counter() - begun
    true = floating(arm, plan.q)
    return Outcome(
        True,
        meets,
        miss,
        plan.method,
        seconds,
        float(sa.collision_check(true, boxes).distance.min()),
    )


def main(number: int, bus: float, timeout: float) -> None:
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        seeds = range(2 * number)
        for outcome in pool.map(solve, seeds, [bus] * len(seeds), [timeout] * len(seeds)):
            if outcome.held and len(outcomes) < number:
                outcomes.append(outcome)
    meet = [o for o in outcomes if o.meets]
    print(
        f"UR5 on a bus of {bus:g} kg, {BOXES} boxes: {len(outcomes)} plans made with the base held"
    )
    print(f"  {len(meet)} of them meet something once the base reacts")
    print(f"  their tips end {np.median([o.miss for o in outcomes]):.3f} m off in the median")
    solved = [o for o in outcomes if not o.planned.startswith("fails")]
    print(f"spacearm: {len(solved)} of {len(outcomes)} problems solved in {timeout:g} s at most")
    if solved:
        contacts = sum(o.nearest < 0.0 for o in solved)
        print(f"  {contacts} of its plans meet something when replayed with the base reacting")
        print(f"  median {np.median([o.seconds for o in solved]):.1f} s")
    for i, o in enumerate(outcomes):
        if o.planned.startswith("fails"):
            print(f"  problem {i}: {o.planned}")


if __name__ == "__main__":
    warnings.simplefilter("ignore", sa.ModelWarning)
    given = [float(word) for word in sys.argv[1:]]
    main(int(given[0]) if given else NUMBER, *(given[1:] + [BUS, TIMEOUT][len(given[1:]) :]))
