"""What proven workspaces and design sweeps cost.

    python benchmarks/workspace.py

Prints the time to shells that are proven to 1e-9 m for planar2 and planar3 (polynomials fitted
anew), the shells and risk profiles found for mda6 and ets7 with how far they move when the effort
doubles, and the cost of a 30 x 30 design sweep of planar2.
"""

from __future__ import annotations

import time

import numpy as np

import spacearm as sa


def proven() -> None:
    for name in ("planar2", "planar3"):
        best = np.inf
        for _ in range(3):
            arm = sa.load(name)  # a new arm has no polynomials yet
            start = time.perf_counter()
            result = sa.workspace(arm)
            best = min(best, time.perf_counter() - start)
        print(f"{name}: {result.kind} to {result.gap:.0e} m in {best:.2f} s")
        print(f"  PDW {result.pdw.tolist()} m")


def found() -> None:
    for name in ("mda6", "ets7"):
        arm = sa.load(name)
        start = time.perf_counter()
        result = sa.workspace(arm)
        profile = result.profile()
        seconds = time.perf_counter() - start
        twice = sa.workspace(arm, effort=2 * result.effort)
        moved = abs(twice.pdw - result.pdw).max()
        print(
            f"{name}: {result.kind} with {result.effort:,} configurations, with its profile "
            f"{seconds:.1f} s; PDW {result.pdw.tolist()} m; twice the effort moves it {moved:.0e} m"
        )
        print(f"  {profile!r}")


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
    found()
    sweep()
