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
        spart = importlib.import_module("SPARTpy")
    except ImportError as error:
        print(f"spartpy takes no part: {error}")
    else:
        found["spartpy, H and Jacobians"] = spart_contender(spart, arm)
    return found


def spart_contender(spart: object, arm: sa.SpaceArm) -> Callable[[np.ndarray], object]:
    raise NotImplementedError
