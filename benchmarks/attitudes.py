"""Attitudes from which a path can be followed: how many a second.

    python benchmarks/attitudes.py

Follows a straight path of mda6 (0.54 m) from 10,000 attitudes spread evenly over all rotations,
those whose start is within reach, and prints the best time of several; then the whole surveys of
figure 5's path of planar2 and of the path of mda6.
"""

from __future__ import annotations

import time

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import spacearm as sa
from spacearm.mission.attitude_search import HeldTip
from spacearm.motion.following import segments
from spacearm.motion.leading import Settings, lead_all, table_of

ROUNDS = 5
NUMBER = 10_000


def timed(work):
    """The result, and the shortest of several runs [s]."""
    took = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        result = work()
        took.append(time.perf_counter() - start)
    return result, min(took)


if __name__ == "__main__":
    planar, A = sa.load("planar2"), np.radians([-57.936, 60.337])
    line = [(2.0, 0.0), (1.5, 1.5)]
    base = pin.SE3(pin.exp3(np.array([0.0, 0.0, np.radians(21.0)])), np.zeros(3))
    ring, took = timed(lambda: sa.feasible_attitudes(planar.at(A, base=base), line))
    print(f"{ring}\n  {len(ring.ended)} attitudes, {took:.2f} s")

    arm = sa.load("mda6")
    q0 = np.radians([0.0, 60.0, -100.0, -50.0, 20.0, 0.0])
    home = arm.at(q0).centred(np.zeros(3)).tip
    away = pin.SE3(home.rotation, home.translation + np.array([-0.3, 0.4, 0.2]))
    cfg = arm.at(q0).centred(np.zeros(3))
    table = table_of([segments(cfg, [away], None)])
    attitude = Rotation.random(4 * NUMBER, random_state=0).as_quat()
    near = np.argsort(-np.abs(attitude[:, 3]))  # those nearest to q0's first
    q = HeldTip(arm, home).branch(attitude[near], q0, np.array([0.0, 0.0, 0.0, 1.0]), 0.3)
    there = np.flatnonzero(np.isfinite(q[:, 0]))[:NUMBER]
    led, took = timed(
        lambda: lead_all(arm, q[there], attitude[near][there], table, None, Settings())
    )
    print(
        f"mda6: {len(there)} attitudes in {took:.2f} s, {led.steps.mean():.0f} steps each, "
        f"{(led.ended == 0).mean():.0%} arrive"
    )
    sphere, took = timed(lambda: sa.feasible_attitudes(arm.at(q0), [home, away]))
    print(f"{sphere}\n  {len(sphere.ended)} attitudes, {took:.2f} s")
