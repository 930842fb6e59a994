"""Tip names: what the names of links and joints say about tips, grippers and fingers.

Names are read word by word: "gripperStator", "hand_tcp" and "tool0" are "gripper stator",
"hand tcp" and "tool 0". Words that all links or all joints of a robot share say nothing.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable

WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")

TIPS: tuple[frozenset[str], ...] = (
    frozenset({"tcp"}),
    frozenset({"tool", "tooltip"}),
    frozenset({"grasp", "grasping", "pinch"}),
    frozenset({"ee", "eef", "eff", "effector", "endeffector", "endpoint"}),
    frozenset({"tip"}),
)
"""Words of frames that tell where a tool works, the surest first."""
HANDS = frozenset({"flange", "attachment", "hand", "palm", "gripper", "grip", "grapple"})
"""Words of what a tool is fastened to, or of a hand as a whole."""
FINGERS = re.compile(r"finger|thumb|jaw|claw|knuckle|phalanx|pincer")
"""Words of what moves in a gripper, which may be run together with others."""
DIGITS = frozenset({"index", "middle", "ring", "little", "pinky", "pinkie"})
"""Words of fingers beside a thumb; alone they say nothing, but no tip of an arm has them."""
GRASPS = frozenset({"gripper", "grip", "grasp", "grasping", "pinch"})
"""Words of joints that open and close a gripper, unless the joint turns a wrist."""
WHEELS = frozenset({"wheel", "wheels", "rw", "flywheel", "rotor", "propeller", "caster"})
"""Words of what turns and is no arm."""
WRISTS = frozenset(
    {"wrist", "roll", "pitch", "yaw", "rotate", "rotation", "pan", "tilt", "twist", "swivel"}
)
SENSORS = re.compile(
    r"camera|optical|imu|sensor|laser|lidar|rgb|depth|infra|marker|led$|range$|accelero|gyro|"
    r"visual|collision"
)
"""Words of frames that only measure or draw."""


def words(name: str) -> tuple[str, ...]:
    """Return the words of a name, in small letters."""
    return tuple(word.lower() for word in WORD.findall(name))


def shared(names: Iterable[str]) -> frozenset[str]:
    """Return the words that all of two or more names have."""
    sets = [frozenset(words(name)) for name in names]
    return frozenset.intersection(*sets) if len(sets) > 1 else frozenset()


def tip_rank(name: str, common: Collection[str] = ()) -> int | None:
    """Return how surely a link is named as a tip, 0 the surest; None if it is not."""
    said = set(words(name)) - set(common)
    if said & DIGITS or measures(name) or is_finger(name, common):
        return None
    return next((rank for rank, among in enumerate(TIPS) if said & among), None)


def is_hand(name: str, common: Collection[str] = ()) -> bool:
    """Whether a link is named as a hand or as what a tool is fastened to."""
    said = set(words(name)) - set(common)
    other = said & WRISTS or measures(name) or is_finger(name, common)
    return bool(said & HANDS) and not other


def is_finger(name: str, common: Collection[str] = ()) -> bool:
    """Whether a link or joint is named as a part that moves in a gripper."""
    return any(FINGERS.search(word) for word in set(words(name)) - set(common))


def grasps(name: str, common: Collection[str] = ()) -> bool:
    """Whether a joint is named as one that opens and closes a gripper."""
    said = set(words(name)) - set(common)
    return bool(said & GRASPS) and not said & WRISTS


def is_wheel(*names: str) -> bool:
    """Whether a joint or what it moves is named as a wheel."""
    return any(WHEELS.intersection(words(name)) for name in names)


def measures(name: str) -> bool:
    """Whether a link is named as a sensor or as something that is only drawn."""
    return any(SENSORS.search(word) for word in words(name))
