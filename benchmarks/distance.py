"""Distances to the singular set of many configurations: what they cost beside sigma_min.

    python benchmarks/distance.py [closed]

With "closed": of 100 random postures in which both hands of dual_ur5 hold one target, how long the
first-order estimate of the distance along closure is as a share of the distance that a search
finds. Else prints microseconds a configuration on one thread for sigma_min, and for the distance
with its gradient; a finite difference of sigma_min by every joint, which the derivative saves; and
how far the distances are from those of `singularity`, computed one by one without compiled code.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import spacearm as sa

ARMS = ("planar2", "planar3", "mda6", "chaser7")
ROUNDS = 5


def seconds(arm: sa.SpaceArm, Q: np.ndarray, quantities: tuple[str, ...]) -> float:
    """The shortest of several runs [s]; the first, which may compile, does not count."""
    sa.evaluate(arm, Q[:100], quantities)
    took = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        sa.evaluate(arm, Q, quantities, threads=1)
        took.append(time.perf_counter() - start)
    return min(took)


def closed_chains() -> None:
    """Print how wrong first-order estimates along closure are, by their size."""
    arm = sa.load("dual_ur5", tip=["left", "right"])
    rng, estimates, found = np.random.default_rng(0), [], []
    while len(found) < 100:
        start = arm.at(rng.uniform(-np.pi, np.pi, arm.n))
        left, right = start.tips
        target = sa.Target(sa.Bus(100, size=(1, 1, 1)), left)
        grasps = {"left": sa.pose(), "right": left.actInv(right)}
        held = sa.hold(start, target, grasps, limits=False)
        estimates.append(held.report().distance)
        search = held.carrying.search("free-floating")
        found.append(search.look(held.configuration, held.target))
    known = np.isfinite(found)
    print(f"a search finds a singular posture from {known.sum()} of {len(known)} postures")
    print(f"{'estimate [rad]':16}{'postures':>10}{'least':>8}{'median':>8}{'largest':>9}")
    estimate = np.array(estimates)[known]
    ratio = estimate / np.array(found)[known]
    for low, high in ((0.0, 0.1), (0.1, 0.3), (0.3, 1.0), (1.0, np.inf)):
        some = ratio[(estimate > low) & (estimate <= high)]
        if len(some):
            least, median, largest = np.percentile(some, [0, 50, 100])
            name = f"{low:g} to {high:g}"
            print(f"{name:16}{len(some):10}{least:8.2f}{median:8.2f}{largest:9.2f}")


def single_arms() -> None:
    """Print what sigma_min and the distance cost."""
    print(f"{'':10}{'sigma_min':>12}{'distance':>12}{'ratio':>8}{'differences':>14}{'error':>12}")
    for name in ARMS:
        arm = sa.load(name)
        Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (200_000, arm.n))
        one = seconds(arm, Q, ("sigma_min",)) / len(Q)
        both = seconds(arm, Q, ("distance", "away")) / len(Q)
        found = sa.evaluate(arm, Q[:100], ("distance",))["distance"]
        alone = np.array([sa.singularity(arm.at(q)).distance for q in Q[:100]])
        print(
            f"{name:10}{1e6 * one:9.3f} us{1e6 * both:9.3f} us{both / one:8.2f}"
            f"{1e6 * 2 * arm.n * one:11.3f} us{abs(alone / found - 1.0).max():12.0e}"
        )


if __name__ == "__main__":
    closed_chains() if sys.argv[1:] == ["closed"] else single_arms()
