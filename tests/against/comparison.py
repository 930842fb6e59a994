"""spacearm beside the engines that are installed.

python tests/against/comparison.py             # the table of docs/validation.md
python tests/against/comparison.py --engines   # which ones; 1 if one that should be is not
"""

from __future__ import annotations

import importlib
import platform
import sys
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

import numpy as np
from conventions import DISTRIBUTIONS, ENGINES, MODULES, Answers, Spacearm, State, branches

sys.path.append(str(Path(__file__).parents[1]))
from helpers.arms import frame, joint, load_text, random_base, random_chain, random_tree

import spacearm as sa

STATES = 5
TREES = 12


UNLIKE = {
    ("MuJoCo", "ets7"): "refuses the published inertia of link 5, which no rigid body has",
    ("Drake", "ets7"): "replaces the published inertia of link 5, which no rigid body has",
    ("MuJoCo", "tecsas"): "refuses published inertias of links, which no rigid body has",
    ("Drake", "tecsas"): "replaces published inertias of links, which no rigid body has",
}
"""What is not compared, and why."""


def subjects() -> dict[str, sa.SpaceArm]:
    """Catalogue models, one tip each, random chains, and random trees.

    The trees have all kinds of joints but mimic ones, which the engines understand otherwise: where
    fingers mimic each other they are locked.
    """
    whole = (sa.load(info.name, joints="all") for info in sa.catalogue())
    catalogue = {
        arm.name: arm
        if arm.coupling is None
        else arm.replace(locked=arm.replace(joints="tip").held)
        for arm in whole
    }
    chains = {f"chain {i}": load_text(random_chain(i, 2 + i), tip="tip") for i in range(7)}
    texts = ((seed, random_tree(seed, 3 + seed % 6)) for seed in range(200))
    hand = frame("tip") + joint("hand", "link_3", "tip", "fixed", (0.2, -0.1, 0.3), (0.1, 0.2, 0.3))
    trees = {
        f"tree {seed}": load_text(
            text.replace("</robot>", f"{hand}</robot>"), tip="tip", joints="all"
        )
        for seed, text in texts
        if "mimic" not in text
    }
    return catalogue | chains | dict(list(trees.items())[:TREES])


def states(arm, count=STATES):
    rng = np.random.default_rng(arm.n)
    for _ in range(count):
        cfg = arm.at(rng.uniform(-2, 2, arm.n), base=random_base(rng))
        yield State(cfg, rng.normal(size=6 + arm.n), rng.normal(size=arm.n) * 5)


def relative(ours, theirs, *parts):
    """Largest difference over the largest value, of each part of the rows."""
    cuts = [0, *parts, len(ours)]
    differences = [0.0]
    for start, end in pairwise(cuts):
        if end > start:
            scale = np.abs(ours[start:end]).max()
            differences.append(np.abs(ours[start:end] - theirs[start:end]).max() / scale)
    return float(np.max(differences))  # NaN if one is


def differences(ours: Answers, theirs: Answers) -> dict[str, float]:
    """Relative ones, linear and angular parts apart; M in units of its diagonal.

    Raises:
        ValueError: A number of either is not finite.
    """
    for whose, answers in (("our", ours), ("their", theirs)):
        if bad := [name for name, x in answers._asdict().items() if not np.isfinite(x).all()]:
            raise ValueError(f"{whose} {', '.join(bad)}: not finite")
    d = np.sqrt(np.diag(ours.mass_matrix))
    scaled = np.abs(ours.mass_matrix - theirs.mass_matrix) / np.outer(d, d)
    return {
        "positions of CM and tip": max(
            relative(ours.com, theirs.com), relative(ours.tip, theirs.tip)
        ),
        "Jacobian": relative(ours.jacobian, theirs.jacobian, 3),
        "mass matrix": float(scaled.max()),
        "momentum": relative(ours.momentum, theirs.momentum, 3),
        "generalized Jacobian": relative(ours.generalized_jacobian, theirs.generalized_jacobian, 3),
        "accelerations": relative(ours.acceleration, theirs.acceleration, 3, 6),
    }


def compared(arm, engine):
    """The largest difference of each quantity."""
    there, here = engine(arm), Spacearm()
    found = [differences(here(state), there(state)) for state in states(arm)]
    return {quantity: max(each[quantity] for each in found) for quantity in found[0]}


def suits(engine: str, name: str, arm) -> bool:
    """Whether the engine can be asked about the arm."""
    return (engine, name) not in UNLIKE and not (engine == "SPART" and branches(arm))


def installed() -> list[str]:
    """The engines that can be imported; why the others cannot is printed."""
    found = []
    for name, module in MODULES.items():
        try:
            importlib.import_module(module)
        except ImportError as error:
            print(f"{name} is not compared: {error}")
        else:
            found.append(name)
    return found


def main(words: list[str]) -> int:
    """Prints the table, or the engines; 1 if one of those is missing on Linux, x86-64."""
    engines = installed()
    if words == ["--engines"]:
        print("compared:", *(f"{name} {version(DISTRIBUTIONS[name])}" for name in engines))
        everywhere = (sys.platform, platform.machine()) == ("linux", "x86_64")
        return 1 if everywhere and len(engines) < len(ENGINES) else 0
    arms = subjects()
    table: dict[str, dict[str, float]] = {}
    asked: dict[str, int] = {}
    for name, engine in ((name, ENGINES[name]) for name in engines):
        for label, arm in arms.items():
            if suits(name, label, arm):
                asked[name] = asked.get(name, 0) + 1
                for quantity, value in compared(arm, engine).items():
                    row = table.setdefault(quantity, {})
                    row[name] = max(row.get(name, 0.0), value)
    versions = {name: version(DISTRIBUTIONS[name]) for name in asked}
    print("| quantity |", " | ".join(f"{name} {versions[name]}" for name in asked), "|")
    print("|---|" + "---|" * len(asked))
    print("| arms compared |", " | ".join(str(asked[name]) for name in asked), "|")
    for quantity, row in table.items():
        print(f"| {quantity} |", " | ".join(f"{row[name]:.0e}" for name in asked), "|")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
