"""Try to contradict proven distances: random arms, a proof for each posture, searches within it.

    python tests/tools/attack_proofs.py 1000          # proofs
    python tests/tools/attack_proofs.py 1000 --seed 7

Each search follows J* alone, from random starts within the proven distance, to where it loses rank.
A singular posture nearer than was proven is a contradiction.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from helpers.arms import load_text, random_chain

import spacearm as sa
from spacearm.model.joints import joint_scales
from spacearm.singularities.nearest import lose_rank

TASKS = {2: ("x y", "x"), 3: ("position", "x y"), 4: ("position",), 5: ("x y z rx ry", "position")}
MODES = ("free-floating", "attitude-controlled", "fixed")
KINDS = (("revolute",), ("revolute", "prismatic"))
EACH, STARTS = 10, 20
"""Postures of an arm, and searches from each."""


def attack(seed: int) -> tuple[int, int, int]:
    """Prove distances of one random arm; return how many, how many fail, and contradictions."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    task, mode = str(rng.choice(TASKS[n])), MODES[rng.integers(3)]
    arm = load_text(random_chain(seed, n, KINDS[rng.integers(2)]), task=task)
    unit, proofs, none, wrong = joint_scales(arm), 0, 0, 0
    try:
        found = sa.singular_set(arm, mode=mode)
    except sa.UnsupportedError:  # the arm can never do the task
        return 0, 0, 0
    for _ in range(EACH):
        q = np.clip(rng.uniform(-np.pi, np.pi, n), arm.lower, arm.upper)
        try:
            near = found.nearest(q)
        except sa.NoSolutionError:
            none += 1
            continue
        proofs += near.distance_proven > 0.0
        none += near.distance_proven == 0.0
        for _ in range(STARTS):
            way = rng.normal(size=n)
            way *= near.distance_proven * rng.uniform() / np.linalg.norm(way)
            other = lose_rank(arm, q + unit * way, mode)
            if other is not None:
                nearer = np.linalg.norm((other - q) / unit) < near.distance_proven * (1.0 - 1e-9)
                wrong += nearer
                if nearer:
                    print(f"contradiction: seed {seed}, {task}, {mode}, q {q.tolist()}")
    return proofs, none, wrong


def main() -> int:
    """Attack as many proofs as asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("proofs", type=int, help="how many")
    parser.add_argument("--seed", type=int, default=0, help="of the first arm")
    asked = parser.parse_args()
    seed, total, began = asked.seed, np.zeros(3, dtype=int), time.process_time()
    while total[0] < asked.proofs:
        total += attack(seed)
        seed += 1
        print(f"\r{total[0]:,} of {asked.proofs:,}", end="", file=sys.stderr)
    proofs, none, wrong = total.tolist()
    took = time.process_time() - began
    print(
        f"\n{proofs:,} proofs of {seed - asked.seed:,} arms, {wrong:,} contradictions; "
        f"{none:,} postures without a proof; {took:.0f} s"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
