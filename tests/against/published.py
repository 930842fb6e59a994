"""Published numbers, computed again.

    python tests/against/published.py

prints each number of the paper and of others as printed and as computed here. Papadopoulos &
Dubowsky (1993) round intermediate results; lesson 1 says where and why the last digits differ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from canadarm2 import left

import spacearm as sa

PAPER, LOOP = "Papadopoulos & Dubowsky 1993", "a floating Panda"
CANADARM2 = "Chen et al. 2014, Canadarm2"
FINGERS = 0.0825
"""Mass of a finger [kg] with which the Panda of example-robot-data has the published 17.587 kg."""


class Row(NamedTuple):
    """A published number.

    Attributes:
        source: Who printed it.
        what: What it is.
        unit: Its unit.
        published: As printed.
        computed: As computed here.
        within: Largest difference that rounding in print explains.
    """

    source: str
    what: str
    unit: str
    published: float
    computed: float
    within: float


def rows() -> list[Row]:
    """Compute all numbers."""
    return [*sets(), *paths(), *loop(), conditions()]


def sets() -> list[Row]:
    """Table I, figure 3 and the shells (44), (46), (47) of the paper."""
    arm = sa.load("planar2")
    links = np.linalg.norm(sa.barycentric(arm.at([0.1, 0.2])).virtual_manipulator.links, axis=1)
    root = np.degrees(sa.singular_set(arm).roots(np.radians([-65, 0]), "joint_2").angles)
    shells = sa.workspace(arm).pdw.ravel()
    found = [
        Row(PAPER, name, "m", printed, float(x), 6e-4)
        for name, printed, x in zip(
            ("alpha", "beta", "gamma"), (0.426, 0.894, 0.968), links, strict=True
        )
    ]
    nearest = float(root[np.abs(root + 11.41).argmin()])
    found.append(Row(PAPER, "figure 3: q2 where q1 is -65°", "°", -11.41, nearest, 5e-3))
    ends = ("R_min,1", "R_max,1", "R_min,2", "R_max,2")
    for name, printed, x in zip(ends, (0.352, 0.554, 1.436, 2.288), shells, strict=True):
        found.append(Row(PAPER, name, "m", printed, float(x), 1e-3))
    return found


def paths() -> list[Row]:
    """Figures 5 and 7 of the paper: the singularity on the way, and the way round it."""
    arm, start = sa.load("planar2"), np.radians([-57.936, 60.337])
    law = sa.TransposedJacobian(target=[1.5, 1.5], kp=5.0, kd=15.0)
    run = sa.simulate(arm.at(start, base=_centred(arm, start, 21.0)), law, 10.0)
    to_c = sa.follow(arm.at(start, base=_centred(arm, start, 20.94)), [(1.0, 0.0)])
    there = np.radians([-160.95, 117.3])
    base = _centred(arm, there, 73.63)
    to_b = sa.follow(arm.at(there, base=base), [(1.5, 1.5)], limits=False)
    first = Row(PAPER, "figure 5: singular after", "s", 5.0, float(run.events[0].t), 0.5)
    return [
        first,
        *_state(to_c, "figure 7, at C", (39.6, -134.2, 134.4), 0.05),
        *_state(to_b, "figure 7, at the target", (21.29, 7.57, 41.90), 0.35),
    ]


def loop() -> list[Row]:
    """The turn of a Panda without a bus, two of whose joints go round a loop once."""
    alone = next(info.path for info in sa.arms() if info.name == "panda")
    arm = sa.load(alone).replace(
        link_mass={"panda_leftfinger": FINGERS, "panda_rightfinger": FINGERS}
    )
    turns = [_turn(arm, steps) for steps in (100, 200)]
    turn = turns[1] + (turns[1] - turns[0]) / 3.0  # chords of the loop err by their square
    return [
        Row(LOOP, "mass", "kg", 17.587, arm.mass, 5e-4),
        Row(LOOP, "turn by a loop of joints 2 and 3", "°", 18.982, turn, 1e-3),
    ]


def conditions() -> Row:
    """How far singular configurations of Canadarm2 are from the conditions for its structure.

    Of 1,000 that are the same each time: where both conditions nearly hold, either is accurate only
    to the root of the accuracy of J*.
    """
    arm = sa.load("ssrms")
    rng = np.random.default_rng(0)
    Q = sa.singular_set(arm, mode="attitude-controlled").sample(1000, rng)
    worst = max(left(arm, q) for q in (Q + np.pi) % (2.0 * np.pi) - np.pi)
    return Row(CANADARM2, "farthest of 1,000 from its conditions", "", 0.0, worst, 1e-12)


def _turn(arm: sa.SpaceArm, steps: int) -> float:
    """Return by how much the loop turns the base [deg], with chords in its place."""
    phase = np.linspace(0.0, 2.0 * np.pi, steps + 1)
    Q = np.tile([0.0, -0.3, 0.0, -1.8, 0.0, 1.5, 0.0], (steps + 1, 1))
    Q[:, 1] += 0.6 * np.sin(phase)
    Q[:, 2] += 0.6 * (1.0 - np.cos(phase))
    cfg = arm.at(Q[0])
    for q in Q[1:]:
        cfg = sa.move(cfg, q)
    return float(np.degrees(np.linalg.norm(pin.log3(cfg.base.rotation))))


def _centred(arm: sa.SpaceArm, q: np.ndarray, degrees: float) -> pin.SE3:
    """Return the pose of the spacecraft at an attitude that puts the system CM at the origin."""
    turned = pin.SE3(pin.utils.rotate("z", np.radians(degrees)), np.zeros(3))
    return arm.at(q, base=turned).centred(np.zeros(3)).base


def _state(run: sa.Motion, where: str, printed: tuple[float, ...], within: float) -> list[Row]:
    """Return attitude and joint angles at the end of a motion, in one turn about zero."""
    angles = np.degrees([pin.log3(run[-1].base.rotation)[2], *run[-1].q])
    return [
        Row(PAPER, f"{where}: {name}", "°", each, float((x + 180.0) % 360.0 - 180.0), within)
        for name, each, x in zip(("attitude", "q1", "q2"), printed, angles, strict=True)
    ]


def table() -> str:
    """Return all rows as text."""
    lines = [f"{'':30} {'':38}{'published':>11}{'here':>11}"]
    for row in rows():
        numbers = f"{row.published:11g}{row.computed:11.3f} {row.unit}"
        lines.append(f"{row.source:30} {row.what:38}{numbers}".rstrip())
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
