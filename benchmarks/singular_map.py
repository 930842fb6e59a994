"""What the singularity polynomial costs, and what it gives for that.

    python benchmarks/singular_map.py

Prints: the complete map of planar3 beside published maps of a planar 3-joint arm (225 s by Taylor
models, 3,300 s by intervals; those ran on other machines); 100,000 explicit singular
configurations of mda6 and ets7; values of S a second on a dense grid beside a loop over Pinocchio's
determinant; time and memory as n grows; and how often the search for the nearest singular
configuration of a 6-joint arm is beaten by one from 200,000 points of the set.
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pinocchio as pin

import spacearm as sa
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.singularities.polynomial import singularity_polynomial

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
from helpers.arms import load_text, random_chain  # random spatial arms


def fresh(arm: sa.SpaceArm) -> TrigPolynomial:
    return singularity_polynomial.__wrapped__(arm)


def planar3() -> None:
    arm = sa.load("planar3")
    start = time.perf_counter()
    curves = sa.SingularSet(arm, fresh(arm)).curves()
    seconds = time.perf_counter() - start
    print(f"complete map of planar3: {seconds:.3f} s, {len(curves)} closed curves")
    for published in (225, 3300):
        print(f"  published, another machine: {published} s, {published / seconds:.0f} times that")


def explicit() -> None:
    for name in ("mda6", "ets7"):
        arm = sa.load(name)
        rng = np.random.default_rng(0)
        start = time.perf_counter()
        found = sa.SingularSet(arm, fresh(arm))
        fitted = time.perf_counter() - start
        Q = found.sample(100_000, rng)
        seconds = time.perf_counter() - start
        everywhere = rng.uniform(-np.pi, np.pi, (1000, arm.n))
        median = np.median([sa.singularity(arm.at(q)).sigma_min for q in everywhere])
        worst = max(sa.singularity(arm.at(q)).sigma_min for q in Q[::20])
        print(
            f"{name}: degrees {found.S.degrees}, fit {fitted:.2f} s, with 100,000 singular "
            f"configurations {seconds:.2f} s; worst sigma_min of every 20th {worst / median:.0e} "
            "of the median"
        )


def dense_grid() -> None:
    arm = sa.load("mda6")
    S = sa.singularity_polynomial(arm)
    shape = (48, 48, 48, 16, 8, 1)
    start = time.perf_counter()
    S.grid(shape)
    a_value = (time.perf_counter() - start) / np.prod(shape)
    model, data, base = arm.model, arm.model.createData(), np.array([0, 0, 0, 0, 0, 0, 1.0])
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (5000, arm.n))
    start = time.perf_counter()
    for q in Q:
        full = np.concatenate((base, q))
        A = pin.computeCentroidalMap(model, data, full)
        J = pin.computeFrameJacobian(model, data, full, arm.tip_frame, pin.LOCAL_WORLD_ALIGNED)
        np.linalg.det(J[:, 6:] - J[:, :6] @ np.linalg.solve(A[:, :6], A[:, 6:]))
    a_loop = (time.perf_counter() - start) / len(Q)
    print(
        f"S of mda6 on a grid of {np.prod(shape):,}: {1e-6 / a_value:.1f} million values a second; "
        f"a loop over Pinocchio: {1e-6 / a_loop:.3f} million; ratio {a_loop / a_value:.0f}"
    )


def growth() -> None:
    print("n  degrees              coefficients  fit [s]  peak memory [MB]")
    tasks = ["x ry", "position", "x y z rx", "x y z rx ry", "pose"]
    for n, task in enumerate(tasks, start=2):
        arm = load_text(random_chain(1, n, ("revolute",)), tip="tip", task=task)
        start = time.perf_counter()
        S = fresh(arm)
        seconds = time.perf_counter() - start
        tracemalloc.start()
        fresh(arm)
        peak = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
        print(f"{n}  {S.degrees!s:20} {S.coefficients.size:12} {seconds:8.3f} {peak:17.1f}")


def nearest() -> None:
    found = sa.singular_set(sa.load("mda6"))
    rng = np.random.default_rng(5)
    sample = found.sample(200_000, rng)
    beaten, seconds, points = 0, 0.0, rng.uniform(-np.pi, np.pi, (40, 6))
    for q in points:
        start = time.perf_counter()
        _, distance = found.nearest(q)
        seconds += time.perf_counter() - start
        offsets = np.angle(np.exp(1j * (sample - q)))
        closest = q + offsets[np.argsort(np.linalg.norm(offsets, axis=1))[:20]]
        polished = min(refined(found, q, c) for c in closest)
        beaten += polished < distance - 1e-6
    print(
        f"nearest singular configuration of mda6: {seconds / len(points):.2f} s each, beaten by a "
        f"search from 200,000 points of the set in {beaten} of {len(points)} cases"
    )


def refined(found: sa.SingularSet, q: np.ndarray, start: np.ndarray) -> float:
    from spacearm.polynomial.newton import HalfSquare, stationary

    S = found.S.shifted(q)
    offset = stationary(HalfSquare(), S, start - q, 0.5)
    return float(np.linalg.norm(offset)) if abs(S(offset)) <= 1e-12 * S.scale else np.inf


if __name__ == "__main__":
    planar3()
    explicit()
    dense_grid()
    growth()
    nearest()
