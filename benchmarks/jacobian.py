"""Microseconds for one generalized Jacobian, side by side in one process.

    python benchmarks/jacobian.py [MODEL]        # default: chaser7

Every contender goes from a numpy vector q to the (6, n) generalized Jacobian, for new q at each
call. Rows: the median over rounds that visit the contenders in turn; ratio to bare Pinocchio.
SPART's equations take part where spartpy is installed (pip install spartpy intel-openmp).
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin

import spacearm as sa

ROUNDS, CALLS = 15, 400


def contenders(arm: sa.SpaceArm) -> dict[str, Callable[[np.ndarray], object]]:
    model, data, tip = arm.model, arm.model.createData(), arm.tip_frame
    at_origin = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])

    def bare(q: np.ndarray) -> np.ndarray:
        full = np.concatenate((at_origin, q))
        A = pin.computeCentroidalMap(model, data, full)
        J = pin.computeFrameJacobian(model, data, full, tip, pin.LOCAL_WORLD_ALIGNED)
        return J[:, 6:] - J[:, :6] @ np.linalg.solve(A[:, :6], A[:, 6:])

    found: dict[str, Callable[[np.ndarray], object]] = {
        "bare Pinocchio + numpy": bare,
        "spacearm, centroidal": lambda q: sa.generalized_jacobian(arm.at(q)),
        "spacearm, barycentric": lambda q: sa.barycentric(arm.at(q)).generalized_jacobian(),
        "spacearm, full report": lambda q: sa.singularity(arm.at(q)),
    }
    try:
        found["SPART's equations, spartpy"] = spart(arm)
    except ImportError as error:
        print(f"spartpy takes no part: {error}")
    return found


def spart(arm: sa.SpaceArm) -> Callable[[np.ndarray], np.ndarray]:
    """J* from spartpy's kinematics: it has no Jacobian itself, so numpy assembles what it gives.

    SPART orders twists [angular; linear]; here the rows are put in spacearm's order.
    """
    model = importlib.import_module("SPARTpy").SPART(str(arm.path))
    robot, origin, attitude = model.robot, np.zeros(3), np.eye(3)
    n, moving = robot.n_links_joints, [j.q_id > 0 for j in robot.joints]
    masses = [link.mass for link in robot.links]

    def generalized_jacobian(q: np.ndarray) -> np.ndarray:
        _, RL, _, rL, e, g = model.kinematics(attitude, origin, q)
        Bij, Bi0, P0, pm = model.diff_kinematics(attitude, origin, rL, e, g)
        I0, Im = model.i_i(attitude, RL)
        M = np.zeros((n, 6, 6))
        M[:, :3, :3] = Im
        M[:, 3:, 3:] = np.multiply.outer(masses, np.eye(3))
        M0 = np.zeros((6, 6))
        M0[:3, :3], M0[3:, 3:] = I0, robot.base_link_mass * np.eye(3)
        J_0 = Bi0 @ P0  # (n, 6, 6) twists of the links per spacecraft twist
        J_m = np.tril(np.ones((n, n)))[:, None, :] * np.einsum("ijab,bj->iaj", Bij, pm)
        H_0 = P0.T @ M0 @ P0 + np.einsum("iab,iac,icd->bd", J_0, M, J_0)
        H_0m = np.einsum("iab,iac,icj->bj", J_0, M, J_m)
        J_star = (J_m[-1] - J_0[-1] @ np.linalg.solve(H_0, H_0m))[:, moving]
        return np.vstack((J_star[3:], J_star[:3]))

    return generalized_jacobian


def main() -> None:
    arm = sa.load(sys.argv[1] if len(sys.argv) > 1 else "chaser7")
    rng = np.random.default_rng(0)
    calls = contenders(arm)
    q = rng.uniform(-np.pi, np.pi, arm.n)
    wanted = sa.generalized_jacobian(arm.at(q))
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(ROUNDS):
        for name, call in calls.items():
            Q = rng.uniform(-np.pi, np.pi, (CALLS, arm.n))
            start = time.perf_counter()
            for row in Q:
                call(row)
            times[name].append((time.perf_counter() - start) / CALLS * 1e6)
    medians = {name: float(np.median(samples)) for name, samples in times.items()}
    bare = medians["bare Pinocchio + numpy"]
    print(f"one generalized Jacobian, {arm.name}, {arm.n} joints")
    print(f"{'':28}{'us':>9}{'ratio':>9}{'difference':>14}")
    for name, microseconds in medians.items():
        result = calls[name](q)
        J = result.jacobian if isinstance(result, sa.SingularityReport) else result
        difference = np.abs(J - wanted).max() / np.abs(wanted).max() if J is result else np.nan
        print(f"{name:28}{microseconds:9.1f}{microseconds / bare:9.2f}{difference:14.1e}")


if __name__ == "__main__":
    main()
