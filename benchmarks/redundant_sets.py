"""What exact singular sets cost, of square and of redundant arms.

    python benchmarks/redundant_sets.py

Prints, best of several: the time to build the set, 2,000 samples and their worst sigma_min over
sigma_max, the nearest singular configuration, the proof that a segment is free, and the proof that
one through a singular configuration is not.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import spacearm as sa


def best(ask: Callable[[], Any], times: int = 15) -> tuple[Any, float]:
    """Return the answer and the shortest time [ms]."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        answer = ask()
        seconds.append(time.perf_counter() - start)
    return answer, 1e3 * min(seconds)


def arm(name: str) -> None:
    this = sa.load(name)
    start = time.perf_counter()
    found = sa.singular_set(this)
    built = 1e3 * (time.perf_counter() - start)
    Q, sampling = best(lambda: found.sample(2000, np.random.default_rng(0)))
    values = sa.evaluate(this, Q, ["condition"])["condition"]
    rng = np.random.default_rng(1)
    points = rng.uniform(-np.pi, np.pi, (20, this.n))
    found.nearest(points[0])
    nearest = np.median([best(lambda q=q: found.nearest(q), 3)[1] for q in points])
    segments = [(q, q + 0.3 * rng.normal(size=this.n)) for q in points]
    proofs = [best(lambda s=s: found.is_free(*s), 3) for s in segments]
    through, blocked = best(lambda: found.is_free(Q[0] - 0.1, Q[0] + 0.1))
    print(
        f"{name}: {found}; built in {built:.0f} ms; 2,000 samples {sampling:.1f} ms, worst "
        f"sigma_min / sigma_max {1 / values.min():.0e}; nearest {nearest:.0f} ms; "
        f"{sum(map(bool, (p for p, _ in proofs)))} of {len(proofs)} segments proven free, median "
        f"{np.median([ms for _, ms in proofs]):.1f} ms; one through the set: {through.verdict}, "
        f"{blocked:.1f} ms"
    )


if __name__ == "__main__":
    for name in ("planar2", "planar3", "mda6", "ets7", "chaser7", "servicer_panda"):
        arm(name)
