"""Random teleoperation by three servos: how near the singular set they come, and what they do.

    python benchmarks/servo.py [RUNS] [ARM...] [--dt SECONDS]
    python benchmarks/servo.py times [ARM...] [--dt SECONDS]

Each run is 60 s of smooth random twists in steps of 10 ms, or up to 0.1 s by `--dt`, from a random
posture more than 15 degrees away from the set. All three scale their rates to the same limits.

- servo: `sa.Servo`, with stop 5 and slow 15 degrees, limits of acceleration 2 rad/s^2.
- damped: damped least squares, `sa.DampedLeastSquares` with its own threshold and damping.
- halting: the twist is slowed from a condition number of 17 on and halts at 30, unless it falls.

Printed of each arm: the share of the commanded motion that is done; the nearest that any run comes
to the set, at any step and every 20 ms, by a search that knows nothing of the servo; of the servo
also whether any limit was exceeded; in which share of the steps that are told to be farther away
than `slow` the tip's motion, in the middle of the step, was off course by more than a degree, and
in which of those from which no singular posture is found so near, told or not; and how much too far
it tells the nearest singular posture to be at most, where one is nearer than `slow`, and in 95 of
100 places anywhere. The other two fly the first eight of the runs; there `NearestSearch` looks each
second, too, for what the servo tells.

The search along the runs: five times a second from random starts within 15 degrees, by Barzilai and
Borwein's steps, then from each step along the set from what was found beside it; and, where nothing
was found within `slow` and the direction was off, from the posture that the servo told.

`times` prints the processor time of a step of one run on one core, the least and the median, in
Python and in the C of `sa.to_c` (gcc -O2), and the most operations that a step in C may take.
"""

from __future__ import annotations

import ctypes
import os
import re
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

import spacearm as sa
from spacearm.equations import servo as ticks
from spacearm.equations.servo import Tick
from spacearm.mechanics.arm_kernels import WIDE, ArmKernel
from spacearm.mechanics.distance import linearise, project
from spacearm.model.joints import joint_scales
from spacearm.polynomial.newton import shortened
from spacearm.singularities.nearest import NearestSearch

ARMS = ("planar2", "planar3", "mda6", "ssrms", "chaser7", "cubesat_xarm")
DT, SECONDS = 0.01, 60.0
LOOK, REACH, STARTS, ON = 0.2, np.radians(15.0), 8, 1e-3
"""Time between two searches [s], how far [rad] and from how many places, ways at rest."""
RATE, ACCELERATION, WISHED = 0.5, 2.0, 0.1
OTHERS, TOGETHER = 8, 250
"""Runs of the other two, and those that fly side by side."""
PART = 0.02
"""Longest time between two postures that are searched from [s]."""
SLOWED, HALTED = 17.0, 30.0
DAMPED = sa.DampedLeastSquares(target=(0.0,))
DRIVER = """
#include <time.h>
#include "NAME.h"
void fly(int m, int n, int size, const double *twists, double *q, double *seconds);
void fly(int m, int n, int size, const double *twists, double *q, double *seconds)
{
    NAME_servo_memory memory;
    NAME_servo_seen seen = {0};
    NAME_servo_tick tick;
    struct timespec before, after;
    int i, j;
    NAME_servo_begin(q, &memory);
    seen.quaternion[3] = 1.0;
    seen.dt = DT;
    for (i = 0; i < m; i++) {
        for (j = 0; j < n; j++) seen.q[j] = q[j];
        for (j = 0; j < size; j++) seen.twist[j] = twists[i * size + j];
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &before);
        NAME_servo_step(&seen, &NAME_servo_nominal, &memory, &tick);
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &after);
        seconds[i] = after.tv_sec - before.tv_sec + 1e-9 * (after.tv_nsec - before.tv_nsec);
        for (j = 0; j < n; j++) q[j] += DT * tick.rates[j];
    }
}
"""


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


class Led:
    """`sa.Servo` over many runs side by side."""

    def __init__(self, arm: sa.SpaceArm) -> None:
        self.servo = sa.Servo(arm, rates=RATE, accelerations=ACCELERATION, frame="spacecraft")
        options = {"frame": "spacecraft", "keep_attitude": False}
        self.kernel = ArmKernel(
            [arm], "free-floating", ticks.flat_step, options, lanes=WIDE, fast=True
        )
        self.limits = {"limits": ticks.packed(self.servo.limits)}

    def step(
        self, Q: np.ndarray, twist: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Ticks (m, ...): rates, distances told, and the postures there; memories of the next."""
        m, n = Q.shape
        parts = (np.tile([0.0, 0, 0, 1], (m, 1)), twist, np.full((m, 1), DT), np.zeros((m, 6)))
        found = self.kernel({"given": np.concatenate((Q, *parts, memory), axis=1)}, self.limits)
        size = ticks.size(Tick, n, len(self.servo.arm.tips))
        return found[:, :size], found[:, size:]

    def starts(self, m: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Random postures (m, n) more than 15 degrees away from the set, and the memories there."""
        arm, rng, known = self.servo.arm, np.random.default_rng((0, seed)), []
        low, high = np.maximum(arm.lower, -2.0), np.minimum(arm.upper, 2.0)
        while len(known) < m:
            Q = rng.uniform(low, high, (2 * m, arm.n))
            memory = np.array([ticks.packed(ticks.unknowing(arm.n, q)) for q in Q])
            rest = np.zeros((2 * m, 6 * len(arm.tips)))
            for _ in range(ticks.SEARCH + 1):
                tick, memory = self.step(Q, rest, memory)
            far = np.flatnonzero(tick[:, arm.n] > np.radians(15.0))
            known += [(Q[i], memory[i]) for i in far]
        Q, memory = zip(*known[:m], strict=True)
        return np.array(Q), np.array(memory)

    def fly(
        self, Q: np.ndarray, memory: np.ndarray, twists: np.ndarray
    ) -> tuple[Flight, float, np.ndarray, np.ndarray]:
        """Fly: the flight, the largest excess, where it is off course, and what is told.

        Of each step and run that is how far the nearest posture is, and where.
        """
        arm, flight = self.servo.arm, Flight(self.servo.arm, Q)
        last, excess, off, told = 0.0 * Q, 0.0, [], []
        for twist in twists:
            tick, memory = self.step(flight.Q, twist, memory)
            dq = tick[:, : arm.n]
            told.append(tick[:, arm.n : 2 * arm.n + 1].copy())
            J, v = tasks(arm, flight.Q + 0.5 * DT * dq, twist)
            moved = (J @ dq[..., None])[..., 0]
            speed = np.linalg.norm(moved, axis=1)
            straight = np.cos(np.radians(1.0)) * speed * np.linalg.norm(v, axis=1)
            off.append((speed > 1e-6) & ((moved * v).sum(axis=1) < straight))
            flight.move(J, v, dq)
            beyond = [
                np.abs(dq) - RATE,
                np.abs(dq - last) - ACCELERATION * DT,
                flight.Q - arm.upper,
                arm.lower - flight.Q,
            ]
            excess, last = max(excess, *(part.max() for part in beyond)), dq
        return flight, excess, np.array(off), np.array(told)

    def one_by_one(self, q: np.ndarray, memory: np.ndarray, twists: np.ndarray) -> np.ndarray:
        """The last posture (n,) of a run that `Servo.step` flies."""
        servo = self.servo
        servo.memory = ticks.unpacked(ticks.Memory, memory, len(q), len(servo.arm.tips))
        for twist in twists:
            q = q + DT * servo.step((q, [0, 0, 0, 1]), twist, DT).rates
        return q


def searched(arm: sa.SpaceArm, q: np.ndarray) -> float:
    """How far the nearest singular posture is that is found from q (n,) [rad]."""
    found = NearestSearch(arm, "free-floating", q[None]).nearest()
    return np.inf if found is None else float(np.linalg.norm(found))


class Flight:
    """What a servo does: its postures, and the share of the motion that is done."""

    def __init__(self, arm: sa.SpaceArm, Q: np.ndarray) -> None:
        self.arm, self.Q, self.seen = arm, Q, [Q]
        self.done = self.asked = 0.0

    def move(self, J: np.ndarray, v: np.ndarray, dq: np.ndarray) -> None:
        """Take a step with task Jacobians (m, k, n), wishes (m, k) and rates (m, n)."""
        self.done += (v * (J @ dq[..., None])[..., 0]).sum()
        self.asked += (v * v).sum()
        parts, begun = self.parts(), self.Q
        self.Q = begun + DT * dq
        self.seen += [begun + i / parts * DT * dq for i in range(1, parts)] + [self.Q]

    @staticmethod
    def parts() -> int:
        """In how many parts a step is searched from."""
        return max(1, round(DT / PART))

    def distances(self) -> np.ndarray:
        """How far the set is that is found from each posture (steps, m) [rad]."""
        return np.transpose([near(self.arm, way) for way in np.swapaxes(self.seen, 0, 1)])


def near(arm: sa.SpaceArm, Q: np.ndarray) -> np.ndarray:
    """How far singular postures are that are found about the postures of a run (m, n) [rad]."""
    rng, (m, n) = np.random.default_rng(0), Q.shape
    every = max(1, round(LOOK * Flight.parts() / DT))
    looks = Q[::every]
    X = rng.normal(size=(len(looks), STARTS, n))
    X *= REACH / np.linalg.norm(X, axis=2, keepdims=True)
    X *= rng.uniform(size=(*X.shape[:2], 1)) ** (1.0 / n)
    X[:, 0] = 0.0
    X, far = along(arm, looks.repeat(STARTS, axis=0), X.reshape(-1, n), 16)
    best = np.arange(len(looks)), far.reshape(-1, STARTS).argmin(axis=1)
    beside = np.minimum((np.arange(m) + every // 2) // every, len(looks) - 1)
    points = looks / joint_scales(arm) + X.reshape(-1, STARTS, n)[best]
    return along(arm, Q, points[beside] - Q / joint_scales(arm), 3)[1]


def along(
    arm: sa.SpaceArm, Q: np.ndarray, X: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (m, n) after steps towards what is nearest to Q, and how far; inf off the set.

    The steps are Barzilai and Borwein's on the way to the set linearised at X.
    """
    share, before, went = np.full((len(X), 1), 0.7), np.zeros(X.shape), np.zeros(X.shape)
    for i in range(count + 1):
        seen = linearise(arm, Q + joint_scales(arm) * X, expected=10**6)
        way = np.nan_to_num(project(seen, X) - X, posinf=0.0, neginf=0.0)
        if i == count:
            break
        change = way - before
        if i:
            square = np.maximum((change * change).sum(axis=1), 1e-14)
            share = np.clip(-(went * change).sum(axis=1) / square, 0.02, 1.0)[:, None]
        before, went = way, share * shortened(way, 0.4)
        X = X + went
    on = np.linalg.norm(way, axis=1) < ON
    return X, np.where(on, np.linalg.norm(X, axis=1), np.inf)


def tasks(arm: sa.SpaceArm, Q: np.ndarray, twist: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Task Jacobians (m, k, n), spacecraft axes, and wishes (m, k), both scaled."""
    scale, rows = arm.task.scale, list(arm.task.indices)
    J = sa.generalized_jacobians(arm, Q)
    J = J[0] if isinstance(J, tuple) else J
    return scale * J[:, rows], scale[:, 0] * twist[:, rows]


def rival(arm: sa.SpaceArm, Q: np.ndarray, twists: np.ndarray, halts: bool) -> Flight:
    """Fly by one of the others."""
    flight, before = Flight(arm, Q), np.full(len(Q), np.inf)
    for twist in twists:
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
        flight.move(J, v, np.where(outward.any(axis=1, keepdims=True), 0.0, dq))
    return flight


def batch(name: str, first: int, runs: int) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Fly a batch of runs: sums, largest numbers; what the others do, in the first one."""
    arm, m = sa.load(name), min(TOGETHER, runs - first)
    led = Led(arm)
    Q, memory = led.starts(m, first)
    twists = wishes(arm, Q, first)
    flight, excess, off, nearest = led.fly(Q, memory, twists)
    parts, slow, told = flight.parts(), led.servo.limits.slow, nearest[..., 0]
    found = flight.distances()
    distance, closest = found[:-1:parts], found.min()
    i, j = np.nonzero(off & (distance > slow) & (told < slow))
    at = np.array(flight.seen[:-1:parts])[i, j]
    beside = along(arm, at, (nearest[i, j, 1:] - at) / joint_scales(arm), 100)[1]
    distance[i, j] = np.minimum(distance[i, j], beside)
    late = (np.minimum(told, np.pi) - np.where(distance < slow, distance, np.pi)).max()
    others = []
    if first == 0:
        apart = np.abs(led.one_by_one(Q[0], memory[0], twists[:, 0]) - flight.Q[0]).max()
        assert apart < 1e-9, f"{name}: {apart:g} rad off Servo.step"
        over = [
            told[i, j] - min(distance[i, j], searched(arm, flight.seen[parts * i][j]))
            for i in range(0, len(twists), round(1.0 / DT))
            for j in range(min(m, OTHERS))
        ]
        others = [float(np.degrees(np.quantile(over, 0.95)))]
        for halts in (False, True):
            other = rival(arm, Q[:OTHERS], twists[:, :OTHERS], halts)
            others += [other.done / other.asked, float(np.degrees(other.distances().min()))]
    most = [-np.degrees(closest), excess, np.degrees(late)]
    steps = [
        part for far in (told > slow, distance > slow) for part in ((off & far).sum(), far.sum())
    ]
    return np.array([flight.done, flight.asked, *steps]), np.array(most), others


def times(name: str) -> None:
    """Print what a step of one run takes, in Python and in C."""
    arm = sa.load(name)
    led = Led(arm)
    servo, (Q, _) = led.servo, led.starts(1, 0)
    twists, q = wishes(arm, Q, 0)[:, 0], Q[0]
    servo.memory = ticks.unknowing(arm.n, q)
    python, c = [], np.empty(len(twists))
    for twist in twists:
        begun = time.process_time()
        step = servo.step((q, [0, 0, 0, 1]), twist, DT)
        python.append(time.process_time() - begun)
        q = q + DT * step.rates
    with tempfile.TemporaryDirectory() as folder:
        header, source = sa.to_c(arm, folder, servo=servo)
        driver, library = Path(folder, "driver.c"), Path(folder, "servo.so")
        text = DRIVER.replace("NAME", header.stem).replace("DT", str(DT))
        driver.write_text(text, encoding="utf-8")
        flags = ["-std=c99", "-D_POSIX_C_SOURCE=199309L", "-O2", "-shared", "-fPIC"]
        subprocess.run(["gcc", *flags, source, driver, "-o", library, "-lm"], check=True)
        array = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
        fly = ctypes.CDLL(str(library)).fly
        fly.argtypes, fly.restype = [*[ctypes.c_int] * 3, *[array] * 3], None
        fly(*twists.shape[:1], arm.n, twists.shape[1], twists, Q[0], c)
        most = re.search(r"At most ([\d,]+) operations", header.read_text(encoding="utf-8"))[1]
    microseconds = (1e6 * f(x) for x in (python, c) for f in (np.min, np.median))
    words = "".join(f"{us:10.1f}" for us in microseconds)
    print(f"{name:14}{arm.n:6}{words}{most:>12}", flush=True)


if __name__ == "__main__":
    if "--dt" in sys.argv:
        DT = float(sys.argv.pop())
        sys.argv.pop()
    if sys.argv[1:2] == ["times"]:
        print(f"{'us':14}{'joints':>6}{'Python':>10}{'median':>10}{'C':>10}{'median':>10}"
              f"{'operations':>12}")  # fmt: skip
        for name in sys.argv[2:] or ARMS:
            times(name)
        sys.exit()
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    print(
        f"{'':14}{'servo':>6}{'nearest':>9}{'excess':>8}{'off':>9}{'':>9}{'too far':>8}{'':>7}"
        f"{'damped':>9}{'':>8}{'halting':>9}"
    )
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        flown = {
            name: [pool.submit(batch, name, first, runs) for first in range(0, runs, TOGETHER)]
            for name in sys.argv[2:] or ARMS
        }
        for name, batches in flown.items():
            sums, most, (others, *_) = zip(*(one.result() for one in batches), strict=True)
            done, asked, off, far, astray, away = np.sum(sums, axis=0)
            near_, excess, late = np.max(most, axis=0)
            words = [f"{done / asked:6.0%}{-near_:8.2f}°{excess:8.0e}{off / max(far, 1):9.4%}"]
            words += [f"{astray / max(away, 1):9.4%}"]
            words += [f"{late:7.1f}°{others[0]:6.1f}°"]
            words += [f"{others[i]:9.0%}{others[i + 1]:7.2f}°" for i in (1, 3)]
            print(f"{name:14}{''.join(words)}", flush=True)
