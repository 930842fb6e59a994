"""Planning problems with known solutions: how many are solved, by what, how fast, how far.

    python benchmarks/planning.py [FAMILY [NUMBER [TIMEOUT]]]

Every problem is drawn from a motion: random waypoints in joint space, joined smoothly, within the
joint limits, clear of singularities and of contacts, as is proven. The goal is where the tip ends,
so that each problem has a solution, whose joint travel is the yardstick. Every plan is replayed by
an integrator that shares nothing with the planner: scipy's DOP853 on the momentum equation, along
the splines that are flown. Failures are listed with their numbers. In a family "... held" wheels
hold the attitude, in one "... final attitude" that at the end is stated. In a family "... any
attitude" only both ends are drawn: postures within the limits, the spacecraft turned by 40 to 180
degrees from one to the other, the pose of the tip as the goal; a proof that there is no way is an
answer. Times of the processor tell more where it is busy.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

import spacearm as sa
from spacearm.mechanics.distance import linearise
from spacearm.mechanics.floating import walk
from spacearm.singularities.sets import prove_regular

NUMBER, TIMEOUT = 100, 60.0
CLEAR = np.radians(2.0)
"""Least distance of the known motions to the singular set [rad]."""
LEAST = 1e-6
"""Least sigma_min of half of the postures of a random arm."""
SPREAD = 0.8
"""Standard deviation of a joint from one waypoint to the next [rad]."""
WAYPOINTS, SAMPLES = 3, 60
TRIES = 2000
"""Arms, and motions of each, that are drawn before a problem is left out."""
HELD, TURNED, ANY = "held", "final attitude", "any attitude"
"""How the names of families end whose attitude is held, or stated at the end, or of which only both
ends are drawn."""
TURN = np.radians((40.0, 180.0))
"""Turns of the spacecraft from one end to the other in families of any attitude [rad]."""
WHEELS = sa.WheelHold(stiffness=4000.0, damping=2000.0, torque=1.0, capacity=10.0)


def link(name: str, length: float, mass: float) -> str:
    """A slender rod along x."""
    across, along = 0.004 * mass, mass * length**2 / 12
    return (
        f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="{across}" iyy="{along}" izz="{along}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision><origin xyz="{length / 2} 0 0"/><geometry><box size="{0.8 * length} 0.08 '
        f'0.08"/></geometry></collision></link>'
    )


class UndrawnError(Exception):
    """No problem could be drawn."""


def random_arm(planar: bool, n: int, seed: int) -> sa.SpaceArm:
    """A random chain of which half of the postures are 5 degrees and more from a singular one.

    Chains with joints in one line are left out, whose J* has no inverse anywhere.
    """
    rng = np.random.default_rng((n, seed))
    for _ in range(TRIES):
        arm = random_chain(planar, n, rng)
        Q = rng.uniform(arm.lower, arm.upper, (200, n))
        at = sa.evaluate(arm, Q, ["distance", "sigma_min"])
        moves = np.median(at["sigma_min"]) > LEAST
        if moves and np.median(at["distance"]) > np.radians(5.0):
            return arm
    raise UndrawnError(f"{TRIES} random arms are nearly singular everywhere")


def random_chain(planar: bool, n: int, rng: np.random.Generator) -> sa.SpaceArm:
    """A chain of rods on a bus, with joint limits; its axes along z, or along any of x, y, z."""
    mass = float(rng.uniform(30.0, 300.0))
    parts = [
        f'<link name="bus"><inertial><mass value="{mass}"/><inertia ixx="{mass / 6}" '
        f'iyy="{mass / 6}" izz="{mass / 6}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    ]
    before, place = "bus", (0.6, 0.0, 0.0)
    for i in range(n):
        length = float(rng.uniform(0.3, 1.2)) if planar or i < n - 2 else 0.25
        axis = [0, 0, 1] if planar else np.roll([0, 0, 1], int(rng.integers(3))).tolist()
        limit = float(rng.uniform(1.2, 3.0))
        parts.append(link(f"link_{i}", length, float(rng.uniform(2.0, 10.0))))
        parts.append(
            f'<joint name="joint_{i}" type="revolute"><parent link="{before}"/>'
            f'<child link="link_{i}"/><origin xyz="{place[0]} {place[1]} {place[2]}"/>'
            f'<axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>'
            f'<limit lower="{-limit}" upper="{limit}" velocity="0.5" effort="50"/></joint>'
        )
        before, place = f"link_{i}", (length, 0.0, 0.0)
    parts.append(
        f'<link name="tip"/><joint name="to_tip" type="fixed"><parent link="{before}"/>'
        f'<child link="tip"/><origin xyz="{place[0]} 0 0"/></joint>'
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "random.urdf"
        path.write_text(f'<robot name="random_{n}r">{"".join(parts)}</robot>')
        return sa.load(path, task="x y rz" if planar else "pose")


@cache
def mounted(name: str, mass: float) -> sa.SpaceArm:
    edge = (mass / 400.0) ** (1.0 / 3.0)
    return sa.mount(name, sa.Bus(mass, size=(edge, edge, edge)))


loaded = cache(sa.load)
FAMILIES: dict[str, Callable[[int], sa.SpaceArm]] = {
    "planar2": lambda _: loaded("planar2", task="x y"),
    "planar3": lambda _: loaded("planar3", task="x y rz"),
    "mda6": lambda _: loaded("mda6"),
    "chaser7 position": lambda _: loaded("chaser7", task="position"),
    "chaser7 pose": lambda _: loaded("chaser7"),
    "random planar 3R": partial(random_arm, True, 3),
    "random 6R": partial(random_arm, False, 6),
    "random 7R": partial(random_arm, False, 7),
    **{
        f"{name} on {mass} kg": lambda _, name=name, mass=mass: mounted(name, float(mass))
        for name in ("ur5", "xarm7")
        for mass in (15, 30, 100, 300)
    },
    "dual_ur5 left": lambda _: loaded("dual_ur5", tip="left"),
    "dual_ur5 right": lambda _: loaded("dual_ur5", tip="right"),
    "ssrms": lambda _: loaded("ssrms"),
    "ssrms position": lambda _: loaded("ssrms", task="position"),
    f"planar2 {TURNED}": lambda _: loaded("planar2", task="x y"),
    f"mda6 {TURNED}": lambda _: loaded("mda6"),
    f"mda6 {ANY}": lambda _: loaded("mda6"),
    f"chaser7 {ANY}": lambda _: loaded("chaser7"),
    f"random 6R {ANY}": partial(random_arm, False, 6),
    f"mda6 {HELD}": lambda _: loaded("mda6"),
    f"random 6R {HELD}": partial(random_arm, False, 6),
}


class Problem(NamedTuple):
    """A start, a goal, travel [rad] and end of what it was drawn from, what is asked.

    The travel is that of a known motion, or of the straight way between two ends.
    """

    start: sa.Configuration
    goal: object
    travel: float
    end: sa.Configuration
    asked: dict[str, object]


def free(arm: sa.SpaceArm, Q: np.ndarray, limited: bool, mode: str) -> bool:
    """Whether joint positions are within the limits, on one side and clear of the singular set."""
    if limited and ((arm.lower > Q) | (arm.upper < Q)).any():
        return False
    if mode == "free-floating":
        at = sa.evaluate(arm, Q, ["distance", "determinant"])
        distance, det = at["distance"], at["determinant"]
    else:
        J = [arm.task.jacobian(sa.generalized_jacobian(arm.at(q), mode=mode), np.eye(3)) for q in Q]
        distance = linearise(arm, Q, mode).distance
        det = np.linalg.det(J) if arm.n == arm.task.k else np.full(len(Q), np.nan)
    if distance.min() <= CLEAR or not (np.isnan(det).all() or (det * det[0] > 0).all()):
        return False
    proof = prove_regular(arm, Q, mode=mode)
    return proof is None or bool(proof)


def apart(rows: list[sa.Configuration]) -> bool:
    """Whether no bodies meet on a motion; where there are none to meet, they do not."""
    arm, base = rows[0].arm, np.array([pin.SE3ToXYZQUAT(cfg.base) for cfg in rows])
    motion = sa.Motion(arm, np.arange(len(rows)), np.array([cfg.q for cfg in rows]), base)
    try:
        return sa.collision_check(motion).apart
    except sa.UnsupportedError:
        return True


def draw(family: str, number: int) -> Problem:
    """Draw a problem; the same number gives the same problem.

    Raises:
        UndrawnError: No motion was found that is clear of everything.
    """
    rng = np.random.default_rng((1993, crc32(family.encode()), number))
    arm = FAMILIES[family](number)
    limited = not family.startswith("planar")  # as in the paper, those turn without limits
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    held = family.endswith(HELD)
    mode = "attitude-controlled" if held else "free-floating"
    if family.endswith(ANY):
        return between_ends(arm, low, high, rng)
    for _ in range(TRIES):
        corners = [rng.uniform(low, high)]
        for _ in range(WAYPOINTS):
            corners.append(corners[-1] + SPREAD * rng.normal(size=arm.n))
            while limited and ((corners[-1] < low) | (corners[-1] > high)).any():
                corners[-1] = corners[-2] + SPREAD * rng.normal(size=arm.n)
        Q = PchipInterpolator(np.arange(len(corners)), corners)(np.linspace(0, WAYPOINTS, SAMPLES))
        if not free(arm, Q, limited, mode):
            continue
        start = arm.at(Q[0], base=attitude(arm, rng))
        rows = walk(start, Q)
        if held:
            rows = [arm.at(q, base=start.base).centred(start.com) for q in Q]
        if apart(rows):
            break
    else:
        raise UndrawnError(f"{TRIES} motions meet limits, bodies or a singularity")
    tip = rows[-1].tip
    pose = max(arm.task.indices) > 2
    goal = tip if pose else tip.translation[arm.task.indices]
    asked: dict[str, object] = {"mode": mode} if held else {}
    if family.endswith(TURNED):
        asked = {"final_attitude": rows[-1].base}
    return Problem(start, goal, float(np.abs(np.diff(Q, axis=0)).sum()), rows[-1], asked)


def between_ends(
    arm: sa.SpaceArm, low: np.ndarray, high: np.ndarray, rng: np.random.Generator
) -> Problem:
    """Draw both ends of a problem, nothing between; they need not be connected."""
    ends: list[np.ndarray] = []
    while len(ends) < 2:
        q = rng.uniform(low, high)
        if free(arm, q[None], True, "free-floating") and apart([arm.at(q)]):
            ends.append(q)
    start = arm.at(ends[0], base=attitude(arm, rng))
    axis = rng.normal(size=3)
    turn = pin.exp3(rng.uniform(*TURN) * axis / np.linalg.norm(axis))
    end = arm.at(ends[1], base=pin.SE3(start.base.rotation @ turn, np.zeros(3)))
    end = end.centred(start.com)
    return Problem(start, end.tip, float(np.abs(ends[1] - ends[0]).sum()), end, {})


def attitude(arm: sa.SpaceArm, rng: np.random.Generator) -> pin.SE3:
    """Any attitude; about the normal for planar arms."""
    normal = arm.tree.plane_normal()
    if normal is None:
        quaternion = rng.normal(size=4)
        return pin.SE3(pin.Quaternion(quaternion / np.linalg.norm(quaternion)), np.zeros(3))
    return pin.SE3(pin.exp3(rng.uniform(-np.pi, np.pi) * np.eye(3)[normal]), np.zeros(3))


def replay(plan: sa.Plan, held: bool) -> sa.Configuration:
    """Where a motion ends when another integrator flies what `sa.Tracking` wants."""
    arm, start, wanted = plan.arm, plan[0], sa.Tracking(plan).wanted
    T = start.base.rotation

    def rate(t: float, T: np.ndarray) -> np.ndarray:
        q, dq, _ = wanted(t)
        return (T.reshape(3, 3) @ pin.skew(sa.base_velocity(arm.at(q), dq)[3:])).ravel()

    for times in () if held else pairwise(plan.t):
        end = solve_ivp(rate, times, T.ravel(), method="DOP853", rtol=1e-10, atol=1e-11)
        U, _, Vt = np.linalg.svd(end.y[:, -1].reshape(3, 3))
        T = U @ Vt
    return arm.at(plan.q[-1], base=pin.SE3(T, np.zeros(3))).centred(start.com)


LEFT_OUT, PROVEN = "left out", "proven impossible"


class Outcome(NamedTuple):
    """What came of one problem."""

    method: str
    seconds: float
    processor: float
    travel: float
    error: float
    reason: str


def solve(family: str, timeout: float, number: int) -> Outcome:
    warnings.simplefilter("ignore", sa.ModelWarning)
    try:
        start, goal, known, _, asked = draw(family, number)
    except UndrawnError as error:
        return Outcome(LEFT_OUT, np.nan, np.nan, np.nan, np.nan, str(error))
    began, worked = time.perf_counter(), time.process_time()
    plan, method, reason = None, "none", ""
    try:
        plan = sa.plan(
            start,
            goal,
            constraints=sa.Constraints(
                limits=not family.startswith("planar"), wheels=WHEELS if "mode" in asked else None
            ),
            search=sa.Search(timeout=timeout),
            **asked,
        )
    except sa.ImpossibleError as error:
        method, reason = PROVEN, str(error)
    except sa.NoSolutionError as error:
        reason = str(error)
    took = time.perf_counter() - began, time.process_time() - worked
    if plan is None:
        return Outcome(method, *took, np.nan, np.nan, reason)
    end, rows = replay(plan, family.endswith(HELD)), start.arm.task.indices
    if isinstance(goal, pin.SE3):
        turn = pin.log3(goal.rotation @ end.tip.rotation.T)
        error = np.concatenate((goal.translation - end.tip.translation, turn))[rows]
    else:
        error = goal - end.tip.translation[rows]
    if "final_attitude" in asked:
        wanted = asked["final_attitude"].rotation
        error = np.append(error, pin.log3(wanted @ end.base.rotation.T))
    return Outcome(plan.method, *took, plan.length / known, float(np.linalg.norm(error)), "")


def warm(family: str) -> None:
    """Compile the kernels in this process, which is not what is measured."""
    solve(family, 5.0, 10**6)


def report(family: str, number: int, timeout: float) -> None:
    warm(family)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        outcomes = list(pool.map(partial(solve, family, timeout), range(number)))
    drawn = [outcome for outcome in outcomes if outcome.method != LEFT_OUT]
    proven = sum(outcome.method == PROVEN for outcome in drawn)
    solved = [outcome for outcome in drawn if outcome.method not in ("none", PROVEN)]
    by = Counter(outcome.method for outcome in solved)
    methods = ", ".join(f"{name} {count / len(solved):.0%}" for name, count in by.most_common())
    share = (len(solved) + proven) / max(len(drawn), 1)
    print(
        f"{family}: {len(solved)} of {len(drawn)} arrive, {proven} are {PROVEN} ({share:.1%} "
        f"answered): {methods}"
    )
    if solved:
        seconds, processor = (
            [getattr(o, name) for o in drawn] for name in ("seconds", "processor")
        )
        print(
            f"  median {np.median(seconds):.2f} s, nine of ten within "
            f"{np.quantile(seconds, 0.9):.1f} s ({np.median(processor):.2f} s and "
            f"{np.quantile(processor, 0.9):.1f} s of processor time), joint travel "
            f"{np.median([o.travel for o in solved]):.2f} times the known, largest error under "
            f"replay {max(o.error for o in solved):.1e}",
            flush=True,
        )
    for i, outcome in enumerate(outcomes):
        if outcome.method == LEFT_OUT:
            print(f"  problem {i} left out: {outcome.reason}", flush=True)
        if outcome.method in ("none", PROVEN):
            print(f"  problem {i} ({outcome.seconds:.0f} s): {outcome.reason}", flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore", sa.ModelWarning)
    names = sys.argv[1:2] or FAMILIES
    for name in names:
        if name not in FAMILIES:
            sys.exit(f"no family {name!r}; families: {', '.join(FAMILIES)}")
        report(
            name,
            int(sys.argv[2]) if len(sys.argv) > 2 else NUMBER,
            float(sys.argv[3]) if len(sys.argv) > 3 else TIMEOUT,
        )
