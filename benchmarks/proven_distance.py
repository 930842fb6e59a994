"""How much of the distance to the singular set is proven, and in which processor time.

Usage: python benchmarks/proven_distance.py
"""

import time

import numpy as np
import spacearm as sa

POSTURES = 20


def main() -> None:
    rng = np.random.default_rng(0)
    for name in ("planar3", "mda6", "ets7", "servicer_ur5", "chaser7", "ssrms", "tecsas"):
        found, shares, seconds = sa.singular_set(sa.load(name)), [], []
        points = rng.uniform(-np.pi, np.pi, (POSTURES + 1, found.arm.n))
        for q in points:
            begun = time.process_time()
            near = found.nearest(q)
            seconds.append(time.process_time() - begun)
            shares.append(near.distance_proven / near.distance)
        share, own = np.array(shares[1:]), np.array(seconds[1:])  # the first one compiles
        print(
            f"{name}: search and proof {1e3 * np.median(own):.0f} ms, at most {own.max():.2f} s; "
            f"proven {100 * np.median(share):.2f} % in the median, at least {100 * share.min():.0f} %, "
            f"90 % or more in {np.count_nonzero(share >= 0.9)} of {POSTURES}"
        )


if __name__ == "__main__":
    main()
