"""Catching: how many random targets with a known catch are caught, in what time, and how exactly.

The known catch is drawn first: a straight joint motion to a random posture, where the tip is at
the stand-off of a tumbling target; the target is what it must be then, its motion run backwards.
Kept are those of which that way, the approach from its end and braking keep all that `sa.catch`
asks for: limits, and nothing singular or met. `sa.catch` is given the target and a window alone,
and its catch is replayed by what shares nothing with it: joint splines, Pinocchio's momentum
matrices and DOP853 for the spacecraft, and for the target Euler's equations.

    python benchmarks/catching.py [targets of each arm] [arm ...] [--workers N]
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pinocchio as pin
from planning import random_arm
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import spacearm as sa
from spacearm.mission.approaching import Approach

APPROACH, CLOSING = 0.2, 0.05
WINDOW = (10.0, 120.0)
TIMEOUT = 600.0
"""Time for each target [s]: processor time is what is reported of a machine that others use."""
ROOM = 0.2
"""Distance from the joint limits at which a known catch begins to close in [rad]."""
STARTS = {
    "chaser7": [0.0, 0.6, 0.0, 1.2, 0.0, 0.8, 0.0],
    "servicer_ur5": [0.0, -1.2, 1.6, -0.4, 1.2, 0.0],
}


def still(cfg: sa.Configuration) -> sa.Motion:
    """Return a motion that stays where it is."""
    return sa.Motion(cfg.arm, [0.0, 1.0], [cfg.q] * 2, [pin.SE3ToXYZQUAT(cfg.base)] * 2)


def known(start: sa.Configuration, rng: np.random.Generator) -> sa.Target | None:
    """Return a target with a known catch, None where the one drawn keeps no limits."""
    arm = start.arm
    q = np.clip(start.q + rng.uniform(-1.2, 1.2, arm.n), arm.lower + ROOM, arm.upper - ROOM)
    begin, rates = rng.uniform(20.0, 90.0), sa.Constraints().joint_rates(arm)
    lasts = 2.0 * float(np.max(np.abs(q - start.q) / rates)) + 1.0
    there = sa.move(start, q)
    if lasts > begin or sa.singularity(there).distance < np.radians(5.0):
        return None
    mass = rng.uniform(20.0, 150.0)
    size = (mass / 200.0) ** (1 / 3) * rng.uniform(0.7, 1.3, 3)
    ring = sa.pose((0.0, 0.0, -size[2] / 2))
    w, v = (x / np.linalg.norm(x) for x in rng.normal(size=(2, 3)))
    w, v = w * np.radians(rng.uniform(0.5, 5.0)), v * rng.uniform(0.0, 0.02)
    place = there.tip * sa.pose((0.0, 0.0, APPROACH)) * ring.inverse()
    bus = sa.Bus(mass, size=tuple(size), name="debris")
    met = sa.Target(bus, place, twist=(*v, *w), grapples={"ring": ring})
    before = met.at(-begin)
    target = met.replace(pose=before.pose, twist=before.twist)
    if not stepped(there, met, rates):
        return None
    asked = (APPROACH, CLOSING, None, (np.inf, np.inf), sa.Constraints(), "free-floating")
    known = Approach.of(start, target, None, WINDOW, *asked)
    contact = begin + sum(known.duration)
    try:
        known.check_start()
        known.attempt(contact, "ring", iter([sa.Joints(q)]), sa.Search(), 0.0)
    except sa.SpaceArmError:
        return None
    return target


def stepped(cfg: sa.Configuration, met: sa.Target, rates: np.ndarray) -> bool:
    """Return whether rough steps to contact keep about the limits: most draws do not."""
    arm, join = cfg.arm, APPROACH / CLOSING
    clock, first = np.linspace(0.0, 2.0 * join, 21), cfg.tip
    for s in clock[1:]:
        away = APPROACH * (1.0 - ease((s - join) / join))
        goal = met.at(s, "ring").pose * sa.pose((0.0, 0.0, -away))
        b = ease(s / join)
        turn = pin.exp3(b * pin.log3(goal.rotation @ first.rotation.T)) @ first.rotation
        turn = pin.log3(turn @ cfg.tip.rotation.T)
        way = (1 - b) * first.translation + b * goal.translation - cfg.tip.translation
        dq = np.linalg.pinv(sa.generalized_jacobian(cfg)) @ np.concatenate((way, turn))
        q = cfg.q + dq
        beyond = (q < arm.lower) | (q > arm.upper)
        if (np.abs(dq) > 1.5 * clock[1] * rates).any() or beyond.any():
            return False
        cfg = sa.move(cfg, q)
    return True


def ease(u: float) -> float:
    """Return a share of a way, at rest at both its ends."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 + u * (6.0 * u - 15.0))


def replayed(catch: sa.Catch) -> np.ndarray:
    """Return how far tip and frame are apart at contact [m], [rad], [m/s], [rad/s]."""
    arm, com = catch.arm, catch.plan[0].com

    def moved(T: pin.SE3, motion: sa.Motion) -> pin.SE3:
        way = CubicSpline(motion.t, motion.q) if motion is catch.chase else motion.spline

        def rate(t: float, x: np.ndarray) -> np.ndarray:
            turn = pin.Quaternion(x / np.linalg.norm(x))
            cfg = arm.at(way(t), base=pin.SE3(turn, np.zeros(3))).centred(com)
            A_b, A_q = sa.momentum_matrix(cfg)
            w = -np.linalg.solve(A_b, A_q @ way(t, 1))[3:]
            return 0.5 * (pin.Quaternion(0.0, *w) * turn).coeffs()

        x = pin.Quaternion(T.rotation).coeffs()
        run = solve_ivp(rate, motion.t[[0, -1]], x, "DOP853", rtol=1e-9, atol=1e-11)
        return pin.SE3(pin.Quaternion(run.y[:, -1]).normalized(), np.zeros(3))

    T = moved(moved(catch.plan[0].base, catch.plan), catch.chase)
    end = arm.at(catch.chase.q[-1], base=T).centred(com)
    target = catch.target
    I = target.inertia

    def tumble(_: float, y: np.ndarray) -> np.ndarray:
        turn, w = pin.Quaternion(y[:4] / np.linalg.norm(y[:4])), y[4:]
        spin = 0.5 * (turn * pin.Quaternion(0.0, *w)).coeffs()
        return np.concatenate((spin, np.linalg.solve(I, np.cross(I @ w, w))))

    R0, w0 = target.pose.rotation, target.twist[3:]
    y0 = np.concatenate((pin.Quaternion(R0).coeffs(), R0.T @ w0))
    y = solve_ivp(tumble, (0.0, catch.t), y0, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    R = pin.Quaternion(y[:4]).normalized().matrix()
    v = target.twist[:3] + np.cross(w0, R0 @ target.com)
    cm = target.pose.translation + R0 @ target.com + catch.t * v
    local = target.frame(catch.grapple)
    lever, w = R @ (local.translation - target.com), R @ y[4:]
    off = end.tip.actInv(pin.SE3(R @ local.rotation, cm + lever))
    slip = sa.generalized_jacobian(end) @ catch.chase.dq[-1]
    slip -= np.concatenate((v + np.cross(w, lever), w))
    parts = (off.translation, pin.log3(off.rotation), slip[:3], slip[3:])
    return np.array([np.linalg.norm(part) for part in parts])


def start_of(name: str) -> sa.Configuration:
    """Return where an arm starts: from a posture that is named, or a regular one that is drawn."""
    arm = random_arm(False, 7, 1).replace(base_mass=200.0) if name == "7R" else sa.load(name)
    rng = np.random.default_rng(0)
    q = STARTS.get(name)
    while q is None:
        x = rng.uniform(-1.0, 1.0, arm.n) * np.minimum(1.5, arm.upper)
        far = sa.singularity(arm.at(x)).distance > 0.2
        q = x if far and not sa.collision_check(still(arm.at(x))).contact else None
    return arm.at(q)


def caught(name: str, number: int) -> tuple[int, float, float, np.ndarray | None]:
    """Draw a target with a known catch; return draws, times [s] and what the replay says of it."""
    start, rng, drawn = start_of(name), np.random.default_rng(number), 1
    while (target := known(start, rng)) is None:
        drawn += 1
    search = sa.Search(seed=number, timeout=TIMEOUT)
    begun, used = time.perf_counter(), time.process_time()
    try:
        catch = sa.catch(start, target, window=WINDOW, search=search)
    except sa.NoSolutionError as error:
        told = "\n    ".join(f"{c.t:.4g}: {c.story[:180]}" for c in error.best)
        print(f"  {name} {number}: known, not caught\n    {told}", flush=True)
        return drawn, np.inf, np.inf, None
    took, own, missed = time.perf_counter() - begun, time.process_time() - used, replayed(catch)
    print(
        f"  {name} {number}: {took:.1f} s ({own:.1f} s of a processor), contact at "
        f"{catch.t:.1f} s, {np.degrees(catch.distance_proven):.1f} deg, {missed}",
        flush=True,
    )
    return drawn, took, own, missed


def main(count: int, workers: int, names: list[str]) -> None:
    """Print the figures of each arm."""
    for name in names:
        with ProcessPoolExecutor(workers) as pool:
            runs = list(pool.map(caught, [name] * count, range(count)))
        took = [run[1:3] for run in runs]
        missed = [run[3] for run in runs if run[3] is not None]
        drawn = sum(run[0] for run in runs)
        (half, own), (most, all_own) = np.quantile(took, [0.5, 0.9], axis=0, method="higher")
        print(f"{name}: {len(missed)} of {count} with a known catch are caught, {drawn} drawn")
        print(f"  median {half:.3g} s ({own:.3g} s of a processor),", end=" ")
        print(f"nine of ten in {most:.3g} s ({all_own:.3g} s)")
        off, turn, slip, spin = np.max(missed, axis=0)
        print(f"  at contact {off:.1e} m and {np.degrees(turn):.1e} deg off,", end=" ")
        print(f"{slip:.1e} m/s and {spin:.1e} rad/s too fast")


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("count", type=int, nargs="?", default=100, help="targets of each arm")
    asked.add_argument("arms", nargs="*", default=["chaser7", "servicer_ur5", "7R"])
    asked.add_argument("--workers", type=int, default=1, help="targets at a time")
    given = asked.parse_args()
    main(given.count, given.workers, given.arms)
