"""Turns of the spacecraft by 10 cm of hand travel, beside published figures.

    python benchmarks/level_reach.py

Published for an arm of 12.5 kg whose hand moved by 10 cm: 12.4, 0.62 and 0.021 degrees on buses of
30, 300 and 3,000 kg. The arm's data are not known; the arms here are the catalogue's UR5 and xArm7
with all link masses and inertias scaled to 12.5 kg, on solid cubes of the density that a cube of
0.3 m has at 30 kg (and one of three times the side), straight lines in 200 directions from a
posture with the elbow bent.
"""

from __future__ import annotations

import numpy as np

import spacearm as sa

PUBLISHED = {30.0: 12.4, 300.0: 0.62, 3000.0: 0.021}
MASS, TRAVEL = 12.5, 0.1
POSTURES = {
    "ur5": [0.0, -1.2, 1.6, -0.4, 1.57, 0.0],
    "xarm7": [0.0, -0.6, 0.0, 1.2, 0.0, 0.9, 0.0],
}


def on_a_cube(name: str, mass: float, side: float) -> sa.SpaceArm:
    """The arm, scaled to 12.5 kg, on the top face of a cube."""
    arm = sa.mount(name, sa.Bus(mass, size=(side, side, side)))
    share = MASS / (arm.mass - mass)
    links = {
        link: part.mass * share
        for link, part in arm.tree.links.items()
        if part is not None and part.mass > 0.0 and abs(part.mass - mass) > 1e-9
    }
    return arm.replace(link_mass=links)


if __name__ == "__main__":
    print(f"{'arm':8}{'bus [kg]':>10}{'side [m]':>10}{'median':>10}{'worst':>10}{'published':>11}")
    for name, q in POSTURES.items():
        for mass, published in PUBLISHED.items():
            side = 0.3 * (mass / 30.0) ** (1.0 / 3.0)
            arm = on_a_cube(name, mass, side)
            found = sa.level_envelope(
                arm.at(q), [0.1], [float(arm.model.inertias[1].mass)], travel=TRAVEL,
                directions=200, limits=False,
            )  # fmt: skip
            median, worst = np.degrees([found.turn[0], found.largest_turn[0]])
            print(f"{name:8}{mass:10.0f}{side:10.3f}{median:9.3f}°{worst:9.3f}°{published:10.3f}°")
