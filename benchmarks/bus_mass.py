"""Shares of postures near a singular one, over the mass of the spacecraft.

    python benchmarks/bus_mass.py

Of arms of the catalogue, and of arms on a tug of 120 to 450 kg. The inertia of the spacecraft grows
with its mass. Prints which postures are within 5 degrees of a singular one, how many of them are
within 5 degrees of one of the arm on a fixed base too (kinematic), and the standard error.
"""

from __future__ import annotations

import spacearm as sa

MODELS = ("planar2", "planar3", "mda6", "ets7", "chaser7", "ssrms", "tecsas")
TUGS = ("ur5", "vispa", "xarm7")
SHARES = (0.25, 1.0, 16.0, 256.0)


def show(name: str, arm: sa.SpaceArm, masses: list[float]) -> None:
    """Print the shares of an arm on spacecraft of some masses [kg], and on a fixed base."""
    for mass in masses:
        heavy = sa.design.vary(arm, {"base_mass": mass})
        found = sa.risk_profile(heavy, samples=20_000, bins=1)
        print(
            f"{name:14}{mass:>10,.0f} kg{found.overall:9.2%}{found.overall_dynamic:9.2%}"
            f"{found.overall_kinematic:10.2%}{found.overall_error:9.2%}"
        )
    fixed = sa.risk_profile(arm, mode="fixed", samples=20_000, bins=1)
    print(f"{name:14}{'fixed':>13}{fixed.overall:9.2%}{0.0:9.2%}{fixed.overall:10.2%}")


if __name__ == "__main__":
    print(f"{'':14}{'':13}{'near':>9}{'dynamic':>9}{'kinematic':>10}{'error':>9}")
    for model in MODELS:
        arm = sa.load(model)
        mass = float(arm.model.inertias[1].mass)
        show(model, arm, [share * mass for share in SHARES])
    for model in TUGS:
        tug = sa.Bus(120.0, size=(0.8, 0.8, 0.8))
        show(f"{model} on a tug", sa.mount(model, tug), [120.0, 240.0, 450.0, 7200.0])
