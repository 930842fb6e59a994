"""How much of the distance to the singular set is proven, and how long it takes by the clock.

Usage: python benchmarks/proven_distance.py
       python benchmarks/proven_distance.py boxes [ARM ...]   # free boxes within the limits
"""

import sys
import time

import numpy as np
from planning import random_arm

import spacearm as sa

POSTURES, BOXES = 20, 10
NAMES = ("planar3", "mda6", "ets7", "servicer_ur5", "chaser7", "ssrms", "tecsas")


def boxes() -> None:
    for name in sys.argv[2:] or ("mda6", "chaser7"):
        rng = np.random.default_rng(0)
        arm, spent, clock, gaps, undecided = sa.load(name), [], [], [0.0], 0
        low, high = np.clip((arm.lower, arm.upper), -np.pi, np.pi)
        for q in rng.uniform(low, high, (BOXES, arm.n)):
            begun = time.process_time(), time.perf_counter()
            box = sa.free_box(arm.at(q))
            spent.append(time.process_time() - begun[0])
            clock.append(time.perf_counter() - begun[1])
            for side, stop in enumerate(box.stops):
                j, undecided = side // 2, undecided + (stop.why == "undecided")
                if stop.why == "singular":
                    end = box.upper[j] if side % 2 else box.lower[j]
                    gaps.append(abs(stop.at[j] - end) / (box.upper[j] - box.lower[j]))
        print(
            f"{name}: box {np.median(spent):.1f} s of the processor in the median, at most "
            f"{max(spent):.1f} s; clock {np.median(clock):.1f} s, at most {max(clock):.1f} s; "
            f"{undecided} of {2 * arm.n * BOXES} sides undecided; singular postures shown within "
            f"{100 * max(gaps):.2f} % of the width",
            flush=True,
        )


def main() -> None:
    rng = np.random.default_rng(0)
    arms = {name: [sa.load(name)] for name in NAMES}
    arms["random 8R"] = [random_arm(False, 8, seed) for seed in range(10)]
    for name, every in arms.items():
        shares, seconds = [], []
        for found in map(sa.singular_set, every):
            points = rng.uniform(-np.pi, np.pi, (POSTURES // len(every) + 1, found.arm.n))
            found.nearest(points[0])  # fits and compiles
            for q in points[1:]:
                begun = time.perf_counter()
                near = found.nearest(q)
                seconds.append(time.perf_counter() - begun)
                shares.append(near.distance_proven / near.distance)
        share, own = np.array(shares), np.array(seconds)
        print(
            f"{name}: search and proof {1e3 * np.median(own):.0f} ms, at most {own.max():.2f} s; "
            f"proven {100 * np.median(share):.2f} % in the median, {100 * share.min():.0f} % or "
            f"more in all, 89.9 % or more in {np.count_nonzero(share >= 0.899)} of {POSTURES}"
        )


if __name__ == "__main__":
    boxes() if "boxes" in sys.argv else main()
