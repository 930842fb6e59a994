"""What proven workspaces and design sweeps cost.

    python benchmarks/workspace.py

Prints the time to proven shells (polynomials fitted anew), the risk profiles of spatial arms and
the cost of a 30 x 30 design sweep of planar2.
"""

from __future__ import annotations

import time

import numpy as np

import spacearm as sa

PLANAR = ("planar2", "planar3")
SPATIAL = ("mda6", "ets7", "chaser7", "servicer_panda", "servicer_ur5")


def proven() -> None:
    sa.workspace(sa.load("planar2"))  # compiles
    for name in (*PLANAR, *SPATIAL):
        best = np.inf
        for _ in range(3):
            arm = sa.load(name)  # a new arm has no polynomials yet
            start = time.perf_counter()
            result = sa.workspace(arm)
            best = min(best, time.perf_counter() - start)
        curves = f"{len(result.proof)} curves with {sum(map(len, result.proof))} points"
        print(f"{name}: {result.kind}, proven to {result.gap:.1g} m in {best:.2f} s; {curves}")
        print(f"  PDW {result.pdw.tolist()} m")


def profiles() -> None:
    for name in ("mda6", "ets7"):
        start = time.perf_counter()
        profile = sa.risk_profile(sa.load(name))
        print(f"{name}: {profile!r} in {time.perf_counter() - start:.1f} s")


def sweep() -> None:
    grid = {"base_inertia": np.linspace(1, 20, 30), "mount_x": np.linspace(0, 0.8, 30)}
    start = time.perf_counter()
    result = sa.design.workspaces(sa.load("planar2"), grid)
    seconds = time.perf_counter() - start
    print(f"30 x 30 designs of planar2: {seconds:.0f} s, {1e3 * seconds / 900:.0f} ms each")
    print(f"  path independent share {float(result.fraction.min()):.2%} to "
          f"{float(result.fraction.max()):.2%}")  # fmt: skip


if __name__ == "__main__":
    proven()
    profiles()
    sweep()
