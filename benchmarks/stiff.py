"""Work and precision of stiff runs: Rodas5P beside DOP853 and scipy's Radau.

    python benchmarks/stiff.py                     # tables of error and processor time
    python benchmarks/stiff.py stiff.png           # the same, drawn

Errors are the largest of joint positions and rates at twenty times, against DOP853 at rtol 1e-12;
each method goes through rtol 1e-3 to 1e-10. Times are of the whole call when all is compiled.
scipy's Radau integrates the rates of `sa.forward_dynamics`, one state at a time.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import spacearm as sa

RTOLS = tuple(10.0**-k for k in range(3, 11))
WANTED = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
"""Errors that are compared at [rad], [rad/s]."""
METHODS = ("auto", "Rodas5P", "DOP853", "scipy's Radau")
WARM, LONG = 4.0, 0.5
"""Processor time for compiling; finer tolerances than one that takes longer are left out [s]."""
Case = tuple[str, sa.SpaceArm, np.ndarray, Any, float, dict[str, Any]]


def cases() -> Iterator[Case]:
    arm = sa.load("planar2")
    law: Any = sa.JointPD(target=[0.5, 1.0], kp=200.0, kd=2000.0)
    yield "planar2, stiff JointPD", arm, np.array([0.1, 0.2]), law, 40.0, {}
    law = sa.JointPD(target=[0.5, 0.6], kp=4.0, kd=8.0)
    friction = {name: sa.PassiveJoint(friction=0.5, slip=1e-4) for name in arm.joint_names}
    yield "planar2, friction", arm, np.array([0.3, 0.9]), law, 40.0, sa.Plant(passive=friction)
    arm, q0 = sa.load("chaser7"), np.full(7, 0.3)
    H = np.diag(sa.generalized_inertia(arm.at(q0)))
    goal = [0.4, -0.2, 0.6, 0.1, 0.3, -0.3, 0.2]
    law = sa.JointPD(target=goal, kp=10.0 * H, kd=100.0 * H)
    yield "chaser7, stiff JointPD", arm, q0, law, 60.0, {}
    law = sa.TransposedJacobian(target=arm.at(q0 + 0.2).tip, kp=5.0, kd=15.0)
    yield "chaser7, TransposedJacobian", arm, q0, law, 60.0, {}


def run(case: Case, method: str, rtol: float) -> np.ndarray:
    """Return joint positions and rates at twenty times."""
    _, arm, q0, law, duration, acts = case
    found = sa.simulate(
        arm.at(q0),
        law,
        duration,
        integration=sa.Integration(
            rtol=rtol, atol=1e-2 * rtol, dt=duration / 20, events=(), method=method
        ),
        plant=acts,
    )
    return np.hstack((found.q, found.dq))


def by_scipy(case: Case, rtol: float) -> np.ndarray:
    """The same of a run of joint laws alone, whose rates are those of positions and rates."""
    _, arm, q0, law, duration, acts = case
    n = arm.n
    if acts or not isinstance(law, sa.JointPD):
        raise sa.UnsupportedError("only joint laws without friction")

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        tau = law(t, arm.at(y[:n]), y[n:])
        return np.append(y[n:], sa.forward_dynamics(arm.at(y[:n]), y[n:], tau).ddq)

    times = np.linspace(0.0, duration, 21)
    y0 = np.append(q0, np.zeros(n))
    run = solve_ivp(rate, (0.0, duration), y0, "Radau", times, rtol=rtol, atol=1e-2 * rtol)
    return run.y.T


def curve(case: Case, method: str, exact: np.ndarray) -> list[tuple[float, float]]:
    """Error and processor time [s] of each tolerance."""
    found = []
    for rtol in RTOLS:
        seconds, warm = np.inf, rtol == RTOLS[0]
        begun = time.process_time()
        for _ in range(400):
            start = time.process_time()
            try:
                y = by_scipy(case, rtol) if method not in METHODS[:3] else run(case, method, rtol)
            except sa.SpaceArmError:
                return found
            now = time.process_time()
            seconds = min(seconds, now - start)
            if now - start > LONG or now - begun > (WARM if warm else LONG):
                break
        found.append((float(np.abs(y - exact).max()), seconds))
        if seconds > LONG:
            break
    return found


def compare(case: Case) -> dict[str, list[tuple[float, float]]]:
    """Print a table; return errors and times of each method."""
    exact = run(case, "DOP853", 1e-12)
    curves = {method: curve(case, method, exact) for method in METHODS}
    print(f"\n{case[0]}, {case[4]:g} s: processor time [ms]")
    print(f"{'error up to':24}" + "".join(f"{wanted:>9.0e}" for wanted in WANTED))
    for method, found in curves.items():
        if not found:
            continue  # scipy takes joint laws alone
        least = [min((s for off, s in found if off <= w), default=np.nan) for w in WANTED]
        shown = (f"{1e3 * s:9.2f}" if s == s else f"{'-':>9}" for s in least)
        print(f"{method:24}" + "".join(shown), flush=True)
    return curves


def draw(tables: dict[str, dict[str, list[tuple[float, float]]]], path: str) -> None:
    from matplotlib import pyplot as plt

    _, axes = plt.subplots(1, len(tables), figsize=(4 * len(tables), 4), layout="constrained")
    for ax, (name, curves) in zip(axes, tables.items(), strict=True):
        for method, found in curves.items():
            if found:
                off, seconds = np.array(found).T
                ax.loglog(1e3 * seconds, off, marker="o", label=method)
        ax.set(title=name, xlabel="processor time [ms]")
    axes[0].set_ylabel("largest error [rad], [rad/s]")
    axes[0].legend()
    plt.savefig(path)


if __name__ == "__main__":
    found = {case[0]: compare(case) for case in cases()}
    if sys.argv[1:]:
        draw(found, sys.argv[1])
