"""Random planning problems: how many are solved, by what, how fast, and whether they arrive.

    python benchmarks/planning.py [CASE [NUMBER]]

The problems stand in `planning.npz`, drawn once by `python benchmarks/planning.py draw`: a regular
start anywhere in joint space and attitude, a goal where the tip is at another such configuration
with the same system CM. The planar arms turn without limits, as in the paper. Every plan is
replayed by an integrator that shares nothing with the planner: scipy's DOP853 on the momentum
equation, straight from row to row. Failures are listed.
"""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import spacearm as sa

PROBLEMS = Path(__file__).with_name("planning.npz")
CASES = {
    "planar2": ("planar2", "x y"),
    "planar3": ("planar3", "x y rz"),
    "mda6": ("mda6", "pose"),
    "chaser7 position": ("chaser7", "position"),
    "chaser7 pose": ("chaser7", "pose"),
}
NUMBER = 500
REGULAR = 0.05
"""Starts have at least this share of the median sigma_min."""


def draw() -> None:
    """Draws the problems anew."""
    arrays = {}
    for case, (model, task) in CASES.items():
        arm, rng = sa.load(model, task=task), np.random.default_rng(1993)
        low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
        some = [sa.singularity(arm.at(q)).sigma_min for q in rng.uniform(low, high, (300, arm.n))]
        bound = REGULAR * np.median(some)
        rows = []
        while len(rows) < NUMBER:
            ends = [arm.at(rng.uniform(low, high), base=attitude(arm, rng)) for _ in range(2)]
            start, goal = (end.centred(np.zeros(3)) for end in ends)
            if sa.singularity(start).sigma_min > bound:
                poses = [pin.SE3ToXYZQUAT(pose) for pose in (start.base, goal.tip)]
                rows.append(np.concatenate((start.q, *poses)))
        arrays[case] = np.array(rows)
    np.savez_compressed(PROBLEMS, **arrays)


def attitude(arm: sa.SpaceArm, rng: np.random.Generator) -> pin.SE3:
    """Any attitude; about the normal for planar arms."""
    normal = arm.tree.plane_normal()
    if normal is None:
        quaternion = rng.normal(size=4)
        return pin.SE3(pin.Quaternion(quaternion / np.linalg.norm(quaternion)), np.zeros(3))
    return pin.SE3(pin.exp3(rng.uniform(-np.pi, np.pi) * np.eye(3)[normal]), np.zeros(3))


def replay(plan: sa.Plan) -> pin.SE3:
    """Where the tip ends when the rows are followed by another integrator."""
    arm, start = plan.arm, plan[0]
    T = start.base.rotation
    for q, dq in zip(plan.q[:-1], np.diff(plan.q, axis=0), strict=True):

        def rate(s: float, t: np.ndarray, q: np.ndarray = q, dq: np.ndarray = dq) -> np.ndarray:
            R = t.reshape(3, 3)
            w = sa.base_velocity(arm.at(q + s * dq), dq)[3:]  # spacecraft axes
            return (R @ pin.skew(w)).ravel()

        end = solve_ivp(rate, (0, 1), T.ravel(), method="DOP853", rtol=1e-11, atol=1e-12)
        T = end.y[:, -1].reshape(3, 3)
    U, _, Vt = np.linalg.svd(T)
    return arm.at(plan.q[-1], base=pin.SE3(U @ Vt, np.zeros(3))).centred(start.com).tip


class Outcome(NamedTuple):
    """What came of one problem."""

    method: str
    seconds: float
    travel: float
    error: float
    reason: str


def solve(case: str, row: np.ndarray) -> Outcome:
    model, task = CASES[case]
    arm = sa.load(model, task=task)
    q, base, tip = row[: arm.n], *(pin.XYZQUATToSE3(x) for x in (row[-14:-7], row[-7:]))
    goal = tip if max(arm.task.indices) > 2 else tip.translation[arm.task.indices]
    start = time.perf_counter()
    try:
        plan = sa.plan(
            arm, q, goal, base=base, limits=arm.tree.plane_normal() is None, seed=0, timeout=120.0
        )
    except sa.NoSolutionError as error:
        return Outcome("none", time.perf_counter() - start, np.nan, np.nan, str(error))
    seconds = time.perf_counter() - start
    end = replay(plan)
    turn = pin.log3(tip.rotation @ end.rotation.T)
    error = np.concatenate((tip.translation - end.translation, turn))[arm.task.indices]
    return Outcome(plan.method, seconds, plan.length, float(np.linalg.norm(error)), "")


def report(case: str, number: int) -> None:
    with np.load(PROBLEMS) as file:
        rows = file[case][:number]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        outcomes = list(pool.map(solve, [case] * len(rows), rows))
    solved = [outcome for outcome in outcomes if outcome.method != "none"]
    by = Counter(outcome.method for outcome in solved)
    methods = ", ".join(f"{name} {count / len(rows):.1%}" for name, count in by.most_common())
    print(f"{case}: {len(solved)} of {len(rows)} arrive ({len(solved) / len(rows):.1%}): {methods}")
    print(
        f"  median {np.median([o.seconds for o in outcomes]):.2f} s, joint travel "
        f"{np.median([o.travel for o in solved]):.3g} rad, largest error under replay "
        f"{max(o.error for o in solved):.1e}"
    )
    for i, outcome in enumerate(outcomes):
        if outcome.method == "none":
            print(f"  problem {i} ({outcome.seconds:.0f} s): {outcome.reason}")


if __name__ == "__main__":
    warnings.simplefilter("ignore", sa.ModelWarning)
    if sys.argv[1:] == ["draw"]:
        draw()
    else:
        for name in sys.argv[1:2] or CASES:
            report(name, int(sys.argv[2]) if len(sys.argv) > 2 else NUMBER)
