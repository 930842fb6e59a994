"""Forward dynamics of many states of a floating arm, beside loops over Pinocchio and MuJoCo.

    python benchmarks/accelerations.py [MODEL ...]        # default: planar2 mda6 chaser7

Prints microseconds a state, ratios, and the largest relative difference of the accelerations, for
`sa.joint_accelerations` on one thread and on two, `pinocchio.aba`, and MuJoCo's `mj_forward`
without limits and contacts. The spacecraft is free in all of them, at rest as a whole. The loops
are in Python; what they do besides calling the engine is a copy of the state.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

import spacearm as sa

M, ROUNDS = 65536, 7
Loop = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Called with positions, velocities and torques of the joints (m, n), returns accelerations."""


def by_pinocchio(arm: sa.SpaceArm, twists: np.ndarray) -> Loop:
    model, data, n = arm.model, arm.model.createData(), arm.n
    full, v, forces = arm.at(np.zeros(n)).full.copy(), np.zeros(6 + n), np.zeros(6 + n)

    def loop(Q: np.ndarray, dQ: np.ndarray, tau: np.ndarray) -> np.ndarray:
        out = np.empty_like(Q)
        for i in range(len(Q)):
            full[7:], v[:6], v[6:], forces[6:] = Q[i], twists[i], dQ[i], tau[i]
            out[i] = pin.aba(model, data, full, v, forces)[6:]
        return out

    return loop


def by_mujoco(arm: sa.SpaceArm, twists: np.ndarray) -> Loop:
    mujoco = importlib.import_module("mujoco")
    with tempfile.TemporaryDirectory() as folder:
        model = mujoco.MjModel.from_xml_path(str(sa.to_mjcf(arm, Path(folder) / "arm.xml")))
    bits = mujoco.mjtDisableBit
    model.opt.disableflags |= bits.mjDSBL_LIMIT | bits.mjDSBL_CONTACT
    data, forward = mujoco.MjData(model), mujoco.mj_forward
    positions, rates, applied, found = data.qpos, data.qvel, data.qfrc_applied, data.qacc

    def loop(Q: np.ndarray, dQ: np.ndarray, tau: np.ndarray) -> np.ndarray:
        out = np.empty_like(Q)
        for i in range(len(Q)):
            positions[7:], rates[:6], rates[6:], applied[6:] = Q[i], twists[i], dQ[i], tau[i]
            forward(model, data)
            out[i] = found[6:]
        return out

    return loop


def best(work: Loop, states: tuple[np.ndarray, ...]) -> tuple[float, np.ndarray]:
    """The shortest of several runs [s], the first not counted, and what it returned."""
    found, took = work(*states), []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        found = work(*states)
        took.append(time.perf_counter() - start)
    return min(took), found


def main(name: str) -> None:
    arm, rng = sa.load(name), np.random.default_rng(0)
    Q, dQ, tau = rng.uniform(-2, 2, (M, arm.n)), *rng.normal(size=(2, M, arm.n))
    twists = np.array([sa.base_velocity(arm.at(q), dq) for q, dq in zip(Q, dQ, strict=True)])
    rows: dict[str, Loop] = {
        f"sa.joint_accelerations, {threads} thread{'s' * (threads > 1)}": (
            lambda *states, threads=threads: sa.joint_accelerations(arm, *states, threads=threads)
        )
        for threads in (1, 2)
    }
    rows["Python loop over pinocchio.aba"] = by_pinocchio(arm, twists)
    try:
        rows["Python loop over MuJoCo's mj_forward"] = by_mujoco(arm, twists)
    except ImportError as error:
        print(f"MuJoCo is not compared: {error}")
    print(f"\n{name}, {arm.n} joints\n{'':38}{'us':>8}{'ratio':>8}{'difference':>12}")
    first, known = best(next(iter(rows.values())), (Q, dQ, tau))
    size = np.abs(known).max(axis=1, keepdims=True)
    for label, work in rows.items():
        took, found = best(work, (Q, dQ, tau))
        difference = np.abs((found - known) / size).max()
        print(f"{label:38}{1e6 * took / M:8.3f}{took / first:8.2f}{difference:12.0e}")


if __name__ == "__main__":
    for model in sys.argv[1:] or ("planar2", "mda6", "chaser7"):
        main(model)
