"""The kernels on an NVIDIA graphics card: one configuration, one lane, for each thread."""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np

from spacearm.kernels.floating import Bodies, Indices, Numbers, Work, generalized_jacobian, moving
from spacearm.kernels.measures import measure
from spacearm.kernels.singular_values import bidiagonal

cuda: Any = import_module("numba.cuda")  # typed in part only

MOVING = moving(1)
BIDIAGONAL = bidiagonal(1)

THREADS = 128
"""Threads per block."""


@lru_cache(maxsize=16)
def kernel(N: int, n: int) -> Any:
    """Compile the kernel `measures` for arms of N joints with n rates, the sizes of its arrays.

    Its arguments are those of `cpu.measures`, without n, all arrays in the card's memory.
    """
    bodies = N + 1

    @cuda.jit
    def measures(
        b: Bodies,
        tip: int,
        E: Numbers,
        rows: Indices,
        scale: Numbers,
        q: Numbers,
        condition: bool,
        values: Numbers,
    ) -> None:
        i = cuda.grid(1)
        if i >= q.shape[1]:
            return
        w = Work(
            cuda.local.array(bodies, MOVING),
            cuda.local.array(1, np.float64),
            cuda.local.array(1, np.float64),
            cuda.local.array((3, 1), np.float64),
            cuda.local.array((3, 1), np.float64),
            cuda.local.array((6, 1), np.float64),
            cuda.local.array((n, 6, 1), np.float64),
        )
        A = cuda.local.array((n, 6, 1), np.float64)
        x = cuda.local.array(1, BIDIAGONAL)
        v = cuda.local.array((5, 1), np.float64)
        for joint in range(N):
            w.body[joint + 1].q[0] = q[joint, i]
        generalized_jacobian(b, tip, E, w)
        measure(w, rows, scale, condition, A, x[0], v)
        for quantity in range(5):
            values[quantity, i] = v[quantity, 0]

    return measures
