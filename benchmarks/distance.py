"""Distances to the singular set of many configurations: what they cost beside sigma_min.

    python benchmarks/distance.py

Prints microseconds a configuration on one thread for sigma_min, and for the distance with its
gradient; a finite difference of sigma_min by every joint, which the derivative saves; and how
far the distances are from those of `singularity`, computed one by one without compiled code.
"""

from __future__ import annotations

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


if __name__ == "__main__":
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
