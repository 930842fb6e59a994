"""Closed chains for the tests: random arms on one spacecraft that hold one target."""

from __future__ import annotations

import spacearm as sa
from helpers.arms import (
    frame,
    joint,
    load_text,
    random_base,
    random_joint,
    random_link,
    robot,
)


def several(rng, counts, kinds=("revolute",)) -> sa.SpaceArm:
    """Random arms of so many joints each on one spacecraft; their tips are t0, t1, ..."""
    parts = [random_link(rng, "bus", 10 ** rng.uniform(1, 3))]
    for side, n in enumerate(counts):
        parent = "bus"
        for i in range(n):
            name = f"l{side}_{i}"
            parts += [random_link(rng, name)]
            parts += [random_joint(rng, f"j{side}_{i}", parent, name, kinds)]
            parent = name
        parts += [frame(f"t{side}")]
        parts += [joint(f"f{side}", parent, f"t{side}", "fixed", rng.normal(size=3) * 0.5)]
    return load_text(robot(*parts), tip=[f"t{side}" for side in range(len(counts))])


def debris(rng, mass=None, pose=None) -> sa.Target:
    """A random body."""
    mass = 10 ** rng.uniform(0, 3.7) if mass is None else mass
    bus = sa.Bus(
        mass, size=rng.uniform(0.5, 2.0, 3) * mass ** (1 / 3) / 8, com=rng.normal(size=3) / 9
    )
    return sa.Target(bus, random_base(rng) if pose is None else pose)


def rough(arm, rng, mass=None, off=0.15):
    """A rough start, a target, and grasps that some posture near by closes."""
    q = rng.uniform(-1.5, 1.5, arm.n)
    closed = arm.at(q, base=random_base(rng))
    target = debris(rng, mass, closed.tips[0] * random_base(rng))
    grasps = {
        tip: target.pose.actInv(pose) for tip, pose in zip(arm.tips, closed.tips, strict=True)
    }
    start = arm.at(q + rng.uniform(-off, off, arm.n), base=closed.base)
    return start, target, grasps
