"""The kernels on an NVIDIA graphics card: one configuration, one lane, for each thread."""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np

from spacearm.kernels.floating import Bodies, Indices, Numbers, Work, generalized_jacobian, moving
from spacearm.kernels.measures import measure
from spacearm.kernels.nearness import Nearness, distance
from spacearm.kernels.singular_values import bidiagonal
from spacearm.kernels.singular_vectors import Vectors
from spacearm.kernels.slopes import Slopes, turning

cuda: Any = import_module("numba.cuda")  # typed in part only

MOVING = moving(1)
TURNING = turning(1)
BIDIAGONAL = bidiagonal(1)

THREADS = 128
"""Threads per block."""


def launched(kernel: Any, *arguments: Any) -> None:
    """Run a kernel with arrays of this machine's memory; the last one, (r, m), receives values."""
    *given, values = arguments
    result = cuda.device_array(values.shape)
    there = [cuda.to_device(x) if isinstance(x, np.ndarray) else x for x in given]
    kernel[-(-values.shape[1] // THREADS), THREADS](*there, result)
    result.copy_to_host(values)


@lru_cache(maxsize=16)
def measures(N: int, n: int) -> Any:
    """Compile the kernel `cpu.measures` for arms of N joints with n rates, the sizes of its arrays.

    It does not take n.
    """
    bodies = N + 1

    @cuda.jit
    def kernel(
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

    return kernel


@lru_cache(maxsize=16)
def distances(N: int, n: int, r: int) -> Any:
    """Compile the kernel `cpu.distances` for arms of N joints with n rates, for up to r rows."""
    bodies = N + 1

    @cuda.jit
    def kernel(
        b: Bodies,
        tip: int,
        E: Numbers,
        rows: Indices,
        scale: Numbers,
        radian: Numbers,
        fading: float,
        q: Numbers,
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
        d = Nearness(
            Vectors(
                cuda.local.array((6, 1), np.float64),
                cuda.local.array((n, 1), np.float64),
                cuda.local.array((6, 1), np.float64),
                cuda.local.array((6, 1), np.float64),
                cuda.local.array((6, 1), np.float64),
                cuda.local.array((2, 1), np.float64),
            ),
            Slopes(
                cuda.local.array(bodies, TURNING),
                cuda.local.array((6, 1), np.float64),
                cuda.local.array((6, 1), np.float64),
                cuda.local.array((6, 1), np.float64),
                cuda.local.array((6, 1), np.float64),
            ),
            cuda.local.array((r, n + r - 1, 1), np.float64),
            cuda.local.array((4, 1), np.float64),
        )
        A = cuda.local.array((n, 6, 1), np.float64)
        x = cuda.local.array(1, BIDIAGONAL)
        v = cuda.local.array((2 + r * n, 1), np.float64)
        for joint in range(N):
            w.body[joint + 1].q[0] = q[joint, i]
        generalized_jacobian(b, tip, E, w)
        distance(b, tip, rows, scale, radian, fading, w, A, x[0], d, v[: values.shape[0]])
        for row in range(values.shape[0]):
            values[row, i] = v[row, 0]

    return kernel
