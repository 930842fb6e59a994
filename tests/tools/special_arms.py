"""Compare nearest singular postures of arms of special build with those of an independent search.

    python tests/tools/special_arms.py 500
    python tests/tools/special_arms.py 500 --seed 7 --workers 2 --postures 3

Arms have 2 to 7 joints with parallel, crossing and coincident axes, offsets that are zero or tiny,
links of 10 g to 100 kg and spacecraft of 1 kg to 100 t, and any task that they can do. The judge
shares nothing with the package: it has its own J*, in NumPy, from the numbers that the description
is written from. It looks for sign changes of det(J*) and for least values of sigma_min along lines
through the posture, and goes from there along the singular set to the nearest point.

Listed are postures where `sa.singularity(..., exact=True)` finds none and the judge does, where it
finds one that is more than 1 % farther, or one that the judge does not confirm as singular. If
there are any, the script ends with status 1.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from helpers.arms import chosen, frame, joint, link, load_text, robot

import spacearm as sa

TASKS: dict[int, tuple[str, ...]] = {
    1: ("x", "y", "z", "rz", "rx"),
    2: ("x y", "y z", "rx ry", "z rz", "x rx"),
    3: ("position", "orientation", "x y rz", "x z ry", "x rx ry"),
    4: ("x y z rz", "x y rx ry", "z rx ry rz"),
    5: ("x y z rx ry", "x y rx ry rz"),
    6: ("pose",),
}
"""Tasks by their number of rows."""
ROWS = ("x", "y", "z", "rx", "ry", "rz")
SLOPES = (1e-7, 0.03)
"""Shares of the largest slope up to which others are none, in turn: some vanish on the set."""
POSSIBLE = 1e-11
"""Share of sigma_max that sigma_min is at least at some postures where a task is possible."""
FARTHER = 0.01
"""Share by which a posture found may be farther than the judge's."""
LANDED = 1e-12
"""Share of the largest norm of J* up to which sigma_min is zero."""


@dataclass(frozen=True)
class Build:
    """The numbers of a free-floating serial arm, link 0 is the spacecraft.

    Attributes:
        mass: (n + 1,) masses [kg].
        com: (n + 1, 3) centres of mass in the links' frames [m].
        inertia: (n + 1, 3, 3) inertias about them [kg m^2].
        place: (n, 3) where joint i is in the frame of link i [m].
        axis: (n, 3) unit axes.
        tip: (3,) the tip in the last link's frame [m].
        task: The task.
    """

    mass: np.ndarray
    com: np.ndarray
    inertia: np.ndarray
    place: np.ndarray
    axis: np.ndarray
    tip: np.ndarray
    task: str

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.axis)

    def loaded(self) -> sa.SpaceArm:
        """Return the arm as the package reads it."""
        names = ["bus", *(f"link_{i}" for i in range(1, self.n + 1))]
        elements = [
            link(name, repr(float(self.mass[i])), self.com[i], self.inertia[i])
            for i, name in enumerate(names)
        ]
        elements += [
            joint(f"j{i + 1}", names[i], names[i + 1], xyz=self.place[i], axis=self.axis[i])
            for i in range(self.n)
        ]
        elements += [frame("tip"), joint("end", names[-1], "tip", "fixed", xyz=self.tip)]
        return load_text(robot(*elements), tip="tip", task=sa.Task(self.task, length=self.length))

    @property
    def rows(self) -> list[int]:
        """Rows of the twist that the task counts."""
        words = self.task.replace("pose", "x y z rx ry rz").replace("position", "x y z")
        return [ROWS.index(word) for word in words.replace("orientation", "rx ry rz").split()]

    @property
    def length(self) -> float | None:
        """What divides the linear rows of a mixed task [m]; None of others."""
        mixed = min(self.rows) < 3 <= max(self.rows)
        return 1.0 if mixed else None

    def jacobians(self, Q: np.ndarray) -> np.ndarray:
        """Compute J* (m, k, n) at Q (m, n): zero momentum, spacecraft axes.

        The joints move the links with the spacecraft held; then everything is shifted and turned
        so that the momentum is zero.
        """
        m, n = Q.shape
        R, r = np.tile(np.eye(3), (m, 1, 1)), np.zeros((m, 3))
        axes, hinges = np.empty((2, m, n, 3))
        turns, centres = np.empty((n + 1, m, 3, 3)), np.empty((n + 1, m, 3))
        turns[0], centres[0] = R, self.com[0]
        for i in range(n):
            r = r + R @ self.place[i]
            axes[:, i], hinges[:, i] = R @ self.axis[i], r
            R = R @ rotations(self.axis[i], Q[:, i])
            turns[i + 1], centres[i + 1] = R, r + R @ self.com[i + 1]
        tip = r + R @ self.tip
        total = self.mass.sum()
        middle = np.tensordot(self.mass, centres, axes=1) / total
        D, H, P = np.zeros((m, 3, 3)), np.zeros((m, 3, n)), np.zeros((m, 3, n))
        for b in range(n + 1):
            I = turns[b] @ self.inertia[b] @ turns[b].swapaxes(1, 2)
            arm = centres[b] - middle
            square = (arm * arm).sum(axis=1)[:, None, None] * np.eye(3)
            D += I + self.mass[b] * (square - arm[:, :, None] * arm[:, None, :])
            for i in range(b):
                v = np.cross(axes[:, i], centres[b] - hinges[:, i])
                P[:, :, i] += self.mass[b] * v
                H[:, :, i] += (I @ axes[:, i, :, None])[..., 0] + self.mass[b] * np.cross(arm, v)
        w = -np.linalg.solve(D, H)
        lever = tip - middle
        linear = np.cross(axes, tip[:, None] - hinges).swapaxes(1, 2) - P / total
        linear = linear + np.cross(w, lever[:, :, None], axis=1)
        J = np.concatenate((linear / (self.length or 1.0), axes.swapaxes(1, 2) + w), axis=1)
        return J[:, self.rows]


def rotations(axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the rotations (m, 3, 3) about an axis, by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + s * K + (1.0 - c) * (K @ K)


def special_build(rng: np.random.Generator) -> Build:
    """Draw an arm whose axes are parallel, crossing or coincident more often than not."""
    n = int(rng.choice((2, 3, 4, 5, 6, 7), p=(0.15, 0.25, 0.2, 0.15, 0.15, 0.1)))
    k = n if rng.uniform() < 0.65 else int(rng.integers(1, n + 1))
    axis = np.empty((n, 3))
    place, com = np.empty((n, 3)), np.zeros((n + 1, 3))
    before = np.eye(3)[rng.integers(3)]
    flat = rng.uniform() < 0.2
    for i in range(n):
        parallel = flat or rng.uniform() < 0.45
        axis[i] = before if parallel else np.eye(3)[rng.integers(3)]
        if not flat and rng.uniform() < 0.08:
            axis[i] = rng.normal(size=3)
            axis[i] /= np.linalg.norm(axis[i])
        size = float(rng.choice((0.3, 1.0, 3.0)))
        kinds = (
            np.zeros(3),
            size * before,
            size * axis[i],
            size * np.eye(3)[rng.integers(3)],
            1e-3 * np.eye(3)[rng.integers(3)],
            size * rng.normal(size=3),
        )
        place[i] = kinds[int(rng.choice(6, p=(0.25, 0.15, 0.1, 0.3, 0.05, 0.15)))]
        before = axis[i]
    tip = np.eye(3)[rng.integers(3)] * float(rng.choice((0.0, 0.1, 1.0), p=(0.1, 0.2, 0.7)))
    mass = np.append(10.0 ** rng.uniform(0.0, 5.0), 10.0 ** rng.uniform(-2.0, 2.0, n))
    ends = np.vstack((place[1:], tip))
    inertia = np.empty((n + 1, 3, 3))
    width = float(rng.choice((0.3, 1.0, 3.0)))
    inertia[0] = mass[0] / 6.0 * width**2 * np.eye(3)
    for i in range(n):
        com[i + 1] = float(rng.choice((0.0, 0.5))) * ends[i]
        if rng.uniform() < 0.2:
            com[i + 1] += 0.2 * rng.normal(size=3)
        long = ends[i] @ ends[i] * np.eye(3) - np.outer(ends[i], ends[i])
        radius = float(rng.choice((0.02, 0.2)))
        inertia[i + 1] = mass[i + 1] * (long / 12.0 + 0.4 * radius**2 * np.eye(3))
    for rows in (k, k, k, k - 1, k - 1, *range(k - 2, 0, -1)):
        task = str(rng.choice(TASKS[min(max(rows, 1), 6)]))
        build = Build(mass, com, inertia, place, axis, tip, task)
        sigma = np.linalg.svd(build.jacobians(rng.uniform(-3, 3, (8, n))), compute_uv=False)
        if (sigma[:, -1] > POSSIBLE * sigma[:, 0]).any():
            break
    return build


class Judge:
    """The search for the nearest singular posture that shares nothing with the package.

    Args:
        build: The arm.
        q: (n,) the posture.
        rng: Draws the lines.
    """

    lines, points, starts, steps, landing = 100, 65, 48, 26, 10

    def __init__(self, build: Build, q: np.ndarray, rng: np.random.Generator) -> None:
        self.build, self.q, self.rng = build, q, rng
        self.k = len(build.rows)
        anywhere = build.jacobians(rng.uniform(-np.pi, np.pi, (16, build.n)))
        self.size = float(np.linalg.norm(anywhere, axis=(1, 2)).max())

    def linearised(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return values (m, r) that vanish together on the set and their slopes (m, r, n).

        They are the entries of u^T J [v, null space], with u and v those of the least singular
        value where they are computed, so that all but the first are zero there. Slopes are central
        differences.
        """
        m, n = X.shape
        h = 1e-6
        nudged = X[:, None] + h * np.concatenate((np.zeros((1, n)), np.eye(n), -np.eye(n)))
        J = self.build.jacobians((self.q + nudged).reshape(-1, n)).reshape(m, 2 * n + 1, self.k, n)
        U, sigma, VT = np.linalg.svd(J[:, 0])
        u, V = U[:, :, -1], VT[:, self.k - 1 :]
        dJ = (J[:, 1 : n + 1] - J[:, n + 1 :]) / (2.0 * h)
        slopes = np.einsum("ma,mjab,mrb->mrj", u, dJ, V)
        values = np.zeros(slopes.shape[:2])
        values[:, 0] = sigma[:, -1]
        return values, slopes

    def sigma(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return sigma_min (m,), and det(J*) of square arms; else ones."""
        J = self.build.jacobians(self.q + X)
        det = np.linalg.det(J) if self.k == self.build.n else np.ones(len(X))
        return np.linalg.svd(J, compute_uv=False)[:, -1], det

    def crossings(self, reach: float) -> np.ndarray:
        """Return where det(J*) changes its sign along lines, and where sigma_min is least."""
        n = self.build.n
        ways = self.rng.normal(size=(self.lines, n))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        _, slopes = self.linearised(np.zeros((1, n)))
        g = slopes[0, 0]
        if np.linalg.norm(g) > 0.0:
            ways = np.vstack((ways, g / np.linalg.norm(g)))
        ways = np.vstack((ways, np.eye(n)))
        s = np.linspace(-reach, reach, 2 * self.points - 1)
        X = ways[:, None] * s[:, None]
        sigma, det = (x.reshape(len(ways), -1) for x in self.sigma(X.reshape(-1, n)))
        found = []
        for i, j in zip(*np.nonzero(np.sign(det[:, 1:]) != np.sign(det[:, :-1])), strict=True):
            share = abs(det[i, j]) / max(abs(det[i, j]) + abs(det[i, j + 1]), 1e-300)
            found.append(ways[i] * (s[j] + share * (s[j + 1] - s[j])))
        least = (sigma[:, 1:-1] <= sigma[:, :-2]) & (sigma[:, 1:-1] <= sigma[:, 2:])
        found += [ways[i] * s[j + 1] for i, j in zip(*np.nonzero(least), strict=True)]
        starts = np.array(found).reshape(-1, n)
        return starts[np.argsort(np.linalg.norm(starts, axis=1))][: self.starts]

    def nearest(self) -> tuple[float, np.ndarray]:
        """Return the distance of the nearest singular posture found, and its offset; inf if none.

        The offsets of the lines go to the nearest point of the set linearised where they are, by
        steps that grow shorter where they do not come to rest; then onto the set.
        """
        n = self.build.n
        best, where = np.inf, np.zeros(n)
        for reach in (0.1, 0.5, 1.5, 3.0):
            for share in SLOPES[: 1 if self.k == n else None]:
                X = self.crossings(min(reach, 1.05 * best))
                for x in self.visited(X, share):
                    distance = float(np.linalg.norm(x))
                    if distance < best:
                        best, where = distance, x
            if best < reach:
                break
        return best, where

    def visited(self, X: np.ndarray, share: float) -> np.ndarray:
        """Return what is singular of the offsets that descents from X (m, n) pass.

        Args:
            X: The starts.
            share: Slopes that are a smaller share of the largest one are not equations.
        """
        found = [np.empty((0, X.shape[1]))]
        longest, before = np.full(len(X), 0.3), np.zeros_like(X)
        for step in range(self.steps + self.landing if len(X) else 0):
            values, slopes = self.linearised(X)
            wanted = -values
            if step < self.steps:
                wanted = wanted + np.einsum("mrn,mn->mr", slopes, X)
            way = (np.linalg.pinv(slopes, rcond=share) @ wanted[:, :, None])[..., 0]
            if step < self.steps:
                way = way - X
            size = np.linalg.norm(way, axis=1)
            turned = (way * before).sum(axis=1) < 0.0
            longest = np.where(turned, 0.6 * longest, 1.05 * longest)
            X = X + way * np.minimum(1.0, longest / np.maximum(size, 1e-300))[:, None]
            before = way
            if step % 4 == 3:
                found.append(X[self.on_set(X)])
        return np.concatenate(found)

    def on_set(self, X: np.ndarray) -> np.ndarray:
        """Tell at which offsets (m, n) sigma_min is zero within rounding."""
        J = self.build.jacobians(self.q + X)
        return np.linalg.svd(J, compute_uv=False)[:, -1] <= LANDED * self.size


class Case(NamedTuple):
    """What came of one posture."""

    seed: int
    task: str
    n: int
    q: np.ndarray
    found: float | None
    judged: float
    proven: float
    to_first_order: float
    confirmed: bool
    said: str

    @property
    def fault(self) -> str:
        """What is wrong with what the package found; empty if nothing."""
        if self.found is None:
            return "none found" if np.isfinite(self.judged) else ""
        if not self.confirmed:
            return "not singular"
        if self.proven > self.judged * (1.0 + 1e-6) + 1e-9:
            return "false proof"
        far = self.found > self.judged * (1.0 + FARTHER) + 1e-7
        return "farther" if far else ""


def judged(seed: int, postures: int) -> list[Case]:
    """Compare the postures of one arm; an arm that can never do its task has none."""
    rng = chosen(seed)
    build = special_build(rng)
    arm = build.loaded()
    Q = rng.uniform(-np.pi, np.pi, (postures, build.n))
    cases = []
    for q in Q:
        report = sa.singularity(arm.at(q), exact=True)
        if report.impossible:
            break
        judge = Judge(build, q, rng)
        distance, _ = judge.nearest()
        found, confirmed = None, True
        if report.nearest is not None:
            found = report.distance
            confirmed = bool(judge.on_set((report.nearest - q)[None])[0]) or found == 0.0
        estimate = sa.singularity(arm.at(q)).distance
        facts = found, distance, report.distance_proven, estimate, confirmed, report.verdict
        cases.append(Case(seed, build.task, build.n, q, *facts))
    return cases


def main() -> int:
    """Compare many arms and list what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("arms", type=int)
    parser.add_argument("--seed", type=int, default=0, help="seed of the first arm")
    parser.add_argument("--postures", type=int, default=3)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    args = parser.parse_args()
    seeds = range(args.seed, args.seed + args.arms)
    cases: list[Case] = []
    arms = 0
    with ProcessPoolExecutor(args.workers) as pool:
        for some in pool.map(judged, seeds, [args.postures] * args.arms):
            arms += bool(some)
            cases += some
            for case in some:
                if case.fault:
                    found = "none" if case.found is None else f"{case.found:.6g}"
                    print(
                        f"arm {case.seed} ({case.n} joints, {case.task}): {case.fault}: found "
                        f"{found}, judged {case.judged:.6g}, to first order "
                        f"{case.to_first_order:.3g}, proven {case.proven:.4g}: {case.said}",
                        flush=True,
                    )
    wrong = sum(bool(case.fault) for case in cases)
    nearer = sum(case.found is not None and case.found < 0.99 * case.judged for case in cases)
    print(
        f"{arms} arms that can do their task, {len(cases)} postures: {wrong} wrong; the judge "
        f"found none as near in {nearer}"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
