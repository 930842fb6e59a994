"""What the singularity polynomial costs, and what it gives for that.

    python benchmarks/singular_map.py

Prints: the complete map of planar3 beside published maps of a planar 3-joint arm (225 s by Taylor
models, 3,300 s by intervals; those ran on other machines); the fits of S and of minors; 100,000
explicit singular configurations of mda6 and ets7; values of S a second on dense grids, in blocks
and written to memory, beside a loop over Pinocchio's determinant; the roots along a million lines;
time and memory as n grows; and how often the search for the nearest singular configuration of a
6-joint arm is beaten by one from 200,000 points of the set.
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

import spacearm as sa
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.singularities.polynomials import minor_polynomials

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
from helpers.arms import load_text, random_chain  # random spatial arms


def fresh(arm: sa.SpaceArm) -> TrigPolynomial:
    (S,) = minor_polynomials(arm, [range(arm.n)])
    return S


def least_time(do: Callable[[], object], repeats: int = 5) -> float:
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        do()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def fits() -> None:
    for name in ("planar2", "mda6", "ets7"):
        arm = sa.load(name)
        S = fresh(arm)
        print(
            f"fit of {name}: {1e3 * least_time(lambda arm=arm: fresh(arm)):.1f} ms, degrees "
            f"{S.degrees}, rounding up to {S.noise() / S.scale:.1e} of the scale"
        )
    arm = sa.load("chaser7")
    two = [(0, 1, 2, 3, 4, j) for j in (5, 6)]
    print(f"two minors of chaser7: {1e3 * least_time(lambda: minor_polynomials(arm, two)):.1f} ms")


def million_lines() -> None:
    for name in ("mda6", "ets7"):
        S = fresh(sa.load(name))
        Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (1_000_000, 6))
        seconds = least_time(lambda S=S, Q=Q: S.roots_along(Q, 4), 3)
        print(f"roots of {name} along a million lines: {seconds:.2f} s")


def planar3() -> None:
    arm = sa.load("planar3")
    start = time.perf_counter()
    curves = sa.singular_set(arm).curves()
    seconds = time.perf_counter() - start
    print(f"complete map of planar3: {seconds:.3f} s, {len(curves)} closed curves")
    for published in (225, 3300):
        print(f"  published, another machine: {published} s, {published / seconds:.0f} times that")


def explicit() -> None:
    for name in ("mda6", "ets7"):
        arm = sa.load(name)
        rng = np.random.default_rng(0)
        start = time.perf_counter()
        found = sa.singular_set(arm)
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
    S = fresh(arm)
    shape = (40, 40, 40, 40, 40, 1)
    values = int(np.prod(shape))
    for what, do in (
        ("computed", lambda *_: None),
        ("computed and negative ones counted", lambda block, _: np.count_nonzero(block < 0.0)),
        ("computed and their least found", lambda block, _: block.min()),
    ):
        for threads in (1, 2):
            seconds = least_time(
                lambda do=do, threads=threads: S.on_grid(shape, do, threads=threads)
            )
            print(
                f"S of mda6 on a grid of {values:,}, {what}, {threads} thread(s): "
                f"{1e-9 * values / seconds:.2f} billion values a second"
            )
    out = np.zeros(shape, dtype=np.float32)
    seconds = least_time(lambda: S.grid(shape, out=out), 3)
    print(f"  written to memory as float32: {1e-9 * values / seconds:.2f} billion")
    model, data, base = arm.model, arm.model.createData(), np.array([0, 0, 0, 0, 0, 0, 1.0])
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (5000, arm.n))
    start = time.perf_counter()
    for q in Q:
        full = np.concatenate((base, q))
        A = pin.computeCentroidalMap(model, data, full)
        J = pin.computeFrameJacobian(model, data, full, arm.tip_frame, pin.LOCAL_WORLD_ALIGNED)
        np.linalg.det(J[:, 6:] - J[:, :6] @ np.linalg.solve(A[:, :6], A[:, 6:]))
    a_loop = (time.perf_counter() - start) / len(Q)
    print(f"  a loop over Pinocchio: {1e-6 / a_loop:.3f} million a second")


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


def nearest(name: str) -> None:
    found = sa.singular_set(sa.load(name))
    rng = np.random.default_rng(5)
    sample = found.sample(200_000, rng)
    beaten, seconds, points = 0, 0.0, rng.uniform(-np.pi, np.pi, (40, sample.shape[1]))
    found.nearest(points[0])  # compiles, once
    for q in points:
        start = time.perf_counter()
        distance = found.nearest(q).distance
        seconds += time.perf_counter() - start
        offsets = np.angle(np.exp(1j * (sample - q)))
        closest = offsets[np.argsort(np.linalg.norm(offsets, axis=1))[:20]]
        polished = min(refined(found, q, offset) for offset in closest)
        beaten += polished < distance - 1e-6
    print(
        f"nearest singular configuration of {name}: {1e3 * seconds / len(points):.0f} ms each, "
        f"beaten by SLSQP from the nearest 20 of 200,000 points of the set in {beaten} of "
        f"{len(points)} cases"
    )


def refined(found: sa.SingularSet, q: np.ndarray, start: np.ndarray) -> float:
    """Return the least distance of common roots of the minors to which SLSQP comes from one."""
    equations = found.triangle.equations
    result = minimize(
        lambda x: x @ x,
        start,
        jac=lambda x: 2.0 * x,
        constraints={
            "type": "eq",
            "fun": lambda x: [1e3 * f(q + x) / f.scale for f in equations],
            "jac": lambda x: [1e3 * f.gradient(q + x) / f.scale for f in equations],
        },
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-14},
    )
    there = found.are_singular((q + result.x)[None])[0]
    near = all(abs(f(q + result.x)) < 1e-12 * f.scale for f in equations)
    return float(np.linalg.norm(result.x)) if there and near else np.inf


if __name__ == "__main__":
    planar3()
    fits()
    explicit()
    dense_grid()
    million_lines()
    growth()
    nearest("mda6")
    nearest("chaser7")
