"""Random teleoperation by three servos: how near the singular set they come, and what they do.

    python benchmarks/servo.py [RUNS] [ARM...]

Each run is 60 s of smooth random twists in steps of 10 ms, from a random posture more than 15
degrees away from the set. All three scale their rates to the same limits.

- servo: `sa.Servo`, with stop 5 and slow 15 degrees, limits of acceleration 2 rad/s^2.
- damped: damped least squares, `sa.DampedLeastSquares` with its own threshold and damping.
- halting: the twist is slowed from a condition number of 17 on and halts at 30, unless it falls.

Printed of each arm: the share of the commanded motion that is done; the nearest that any run comes
to the set, searched anew along each run by `NearestSearch`, which knows nothing of the servo; of
the servo also whether any limit was exceeded, and in which share of the steps farther away than
`slow` the direction was off by more than a degree. The other two fly the first eight of the runs.

The postures that are searched are four a second, but those that cannot be the nearest: the distance
falls by no more than the way in joint space.
"""

from __future__ import annotations

import os
import sys
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import spacearm as sa
from spacearm.equations import servo as ticks
from spacearm.equations.servo import Tick
from spacearm.mechanics.arm_kernels import WIDE, ArmKernel
from spacearm.model.joints import joint_scales
from spacearm.singularities.nearest import NearestSearch

ARMS = ("planar2", "planar3", "mda6", "ssrms", "chaser7", "cubesat_xarm")
DT, SECONDS, LOOKS = 0.01, 60.0, 0.25
RATE, ACCELERATION, WISHED = 0.5, 2.0, 0.1
OTHERS, TOGETHER = 8, 100
"""Runs of the other two, and those that fly side by side."""
SLOWED, HALTED = 17.0, 30.0
DAMPED = sa.DampedLeastSquares(target=(0.0,))


def wishes(arm: sa.SpaceArm, Q: np.ndarray, seed: int) -> np.ndarray:
    """Smooth twists (steps, m, 6 tips) from postures Q (m, n): sums of four slow sines.

    Of a size that takes a joint rate of `WISHED` at the median posture.
    """
    rng, (m, _), size = np.random.default_rng((1, seed)), Q.shape, 6 * len(arm.tips)
    length = max(map(arm.tree.way_to, arm.tips))
    A = rng.normal(size=(4, m, size)) * np.where(np.arange(size) % 6 < 3, length, 1.0)
    W, P = rng.uniform(0.05, 0.8, (4, m, 1)), rng.uniform(0.0, 6.0, (4, m, 1))
    J, v = tasks(arm, Q, A[0])
    rates = (np.linalg.pinv(J) @ v[..., None])[..., 0]
    A *= WISHED / np.median(np.abs(rates).max(axis=1))
    t = DT * np.arange(round(SECONDS / DT))[:, None, None]
    return np.array(sum(a * np.sin(w * t + p) for a, w, p in zip(A, W, P, strict=True)))


def starts(arm: sa.SpaceArm, m: int, seed: int) -> np.ndarray:
    """Random postures (m, n) within the limits and more than 15 degrees away from the set."""
    rng, found = np.random.default_rng((0, seed)), []
    while len(found) < m:
        q = rng.uniform(np.maximum(arm.lower, -2.0), np.minimum(arm.upper, 2.0))
        if searched(arm, q) > np.radians(15.0):
            found.append(q)
    return np.array(found)


def searched(arm: sa.SpaceArm, q: np.ndarray) -> float:
    """How far the nearest singular posture is that is found from q (n,) [rad]."""
    found = NearestSearch(arm, "free-floating", q[None]).nearest()
    return np.inf if found is None else float(np.linalg.norm(found))


class Flight:
    """What a servo does: postures as they are looked at, and the share of the motion done."""

    def __init__(self, arm: sa.SpaceArm, Q: np.ndarray) -> None:
        self.arm, self.Q, self.seen = arm, Q, [Q]
        self.done = self.asked = 0.0

    def move(self, i: int, J: np.ndarray, v: np.ndarray, dq: np.ndarray) -> None:
        """Take a step with task Jacobians (m, k, n), wishes (m, k) and rates (m, n)."""
        self.done += (v * (J @ dq[..., None])[..., 0]).sum()
        self.asked += (v * v).sum()
        self.Q = self.Q + DT * dq
        if (i + 1) % round(LOOKS / DT) == 0:
            self.seen.append(self.Q)

    def closest(self) -> float:
        """The nearest of all [rad], searched anew."""
        best = np.inf
        for way in np.array(self.seen).swapaxes(0, 1):
            x, open_ = way / joint_scales(self.arm), [(0, len(way))]
            while open_:
                low, high = open_.pop()
                i = (low + high) // 2
                distance = searched(self.arm, way[i])
                best = min(best, distance)
                left = np.linalg.norm(x[low:high] - x[i], axis=1) > distance - best
                before, after = np.flatnonzero(left[: i - low]), np.flatnonzero(left[i - low :])
                if before.size:
                    open_.append((low, low + before[-1] + 1))
                if after.size:
                    open_.append((i + after[0], high))
        return best


def tasks(arm: sa.SpaceArm, Q: np.ndarray, twist: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Task Jacobians (m, k, n), spacecraft axes, and wishes (m, k), both scaled."""
    scale, rows = arm.task.scale, list(arm.task.indices)
    J = sa.generalized_jacobians(arm, Q)
    J = J[0] if isinstance(J, tuple) else J
    return scale * J[:, rows], scale[:, 0] * twist[:, rows]


def rival(arm: sa.SpaceArm, Q: np.ndarray, twists: np.ndarray, halts: bool) -> Flight:
    """Fly by one of the others."""
    flight, before = Flight(arm, Q), np.full(len(Q), np.inf)
    for i, twist in enumerate(twists):
        J, v = tasks(arm, flight.Q, twist)
        U, s, VT = np.linalg.svd(J, full_matrices=False)
        along = (U.swapaxes(1, 2) @ v[..., None])[..., 0]
        if halts:
            condition = s[:, 0] / np.maximum(s[:, -1], 1e-300)
            share = np.clip((HALTED - condition) / (HALTED - SLOWED), 0.0, 1.0)
            share, before = np.where(condition < before, np.maximum(share, 0.1), share), condition
            gain = share[:, None] / np.maximum(s, 1e-12)
        else:
            near = np.minimum(s[:, -1:] / DAMPED.threshold, 1.0)
            gain = s / (s * s + DAMPED.damping**2 * (1.0 - near * near))
        dq = (VT.swapaxes(1, 2) @ (gain * along)[..., None])[..., 0]
        dq /= np.maximum(1.0, np.abs(dq).max(axis=1, keepdims=True) / RATE)
        outward = ((dq > 0.0) & (flight.Q + DT * dq > arm.upper)) | (
            (dq < 0.0) & (flight.Q + DT * dq < arm.lower)
        )
        flight.move(i, J, v, np.where(outward.any(axis=1, keepdims=True), 0.0, dq))
    return flight


def led(arm: sa.SpaceArm, Q: np.ndarray, twists: np.ndarray) -> tuple[Flight, float, int, int]:
    """Fly by the servo; also the largest excess of a limit, the steps off course and far away."""
    servo, (m, n), tips = (
        sa.Servo(arm, rates=RATE, accelerations=ACCELERATION),
        Q.shape,
        len(arm.tips),
    )
    options = {"frame": "spacecraft", "keep_attitude": False}
    kernel = ArmKernel([arm], "free-floating", ticks.flat_step, options, lanes=WIDE, fast=True)
    known, limits = [], {"limits": ticks.packed(servo.limits)}
    for q in Q:
        servo.start((q, [0, 0, 0, 1]))
        known.append(ticks.packed(servo.memory))
    memory, last = np.array(known), np.zeros((m, n))
    flight, excess, off, far, size = Flight(arm, Q), 0.0, 0, 0, ticks.size(Tick, n, tips)
    for i, twist in enumerate(twists):
        seen = [
            flight.Q,
            np.tile([0.0, 0, 0, 1], (m, 1)),
            twist,
            np.full((m, 1), DT),
            np.zeros((m, 6)),
        ]
        found = kernel({"given": np.concatenate((*seen, memory), axis=1)}, limits)
        dq, distance, memory = found[:, :n], found[:, n], found[:, size:]
        J, v = tasks(arm, flight.Q, twist)
        moved = (J @ dq[..., None])[..., 0]
        cosine = (moved * v).sum(axis=1) / (
            np.linalg.norm(moved, axis=1) * np.linalg.norm(v, axis=1) + 1e-300
        )
        away = distance > servo.limits.slow
        off, far = (
            off
            + (
                away & (cosine < np.cos(np.radians(1.0))) & (np.linalg.norm(moved, axis=1) > 1e-6)
            ).sum(),
            far + away.sum(),
        )
        flight.move(i, J, v, dq)
        beyond = [
            np.abs(dq) - RATE,
            np.abs(dq - last) - ACCELERATION * DT,
            flight.Q - arm.upper,
            arm.lower - flight.Q,
        ]
        excess, last = max(excess, *(part.max() for part in beyond)), dq
    return flight, excess, off, far


def batch(name: str, first: int, runs: int) -> tuple[np.ndarray, list[float]]:
    """Fly a batch of runs: (6,) sums, minus the nearest, the excess; what the others do."""
    arm, m = sa.load(name), min(TOGETHER, runs - first)
    Q = starts(arm, m, first)
    twists = wishes(arm, Q, first)
    flight, excess, off, far = led(arm, Q, twists)
    others = []
    for halts in (False, True) if first == 0 else ():
        other = rival(arm, Q[:OTHERS], twists[:, :OTHERS], halts)
        others += [other.done / other.asked, np.degrees(other.closest())]
    near = np.degrees(flight.closest())
    return np.array([flight.done, flight.asked, off, far, -near, excess]), others


if __name__ == "__main__":
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    print(f"{'':14}{'servo':>8}{'':>9}{'excess':>10}{'off':>10}{'damped':>9}{'':>9}{'halting':>9}")
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        flown = {
            name: [pool.submit(batch, name, first, runs) for first in range(0, runs, TOGETHER)]
            for name in sys.argv[2:] or ARMS
        }
        for name, batches in flown.items():
            sums, (others, *_) = zip(*(one.result() for one in batches), strict=True)
            done, asked, off, far = np.sum(sums, axis=0)[:4]
            near, excess = np.max(sums, axis=0)[4:] * (-1.0, 1.0)
            words = [f"{done / asked:8.0%}{near:8.2f}°{excess:10.0e}{off / max(far, 1):10.4%}"]
            words += [f"{others[i]:9.0%}{others[i + 1]:8.2f}°" for i in (0, 2)]
            print(f"{name:14}{''.join(words)}", flush=True)
