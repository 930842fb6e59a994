"""Blocks of configurations on the processor, lane by lane."""

from __future__ import annotations

import numpy as np

from spacearm.kernels.floating import Bodies, Indices, Numbers, Work, generalized_jacobian, moving
from spacearm.kernels.lanes import LANES, SETTINGS, compiler, step
from spacearm.kernels.measures import measure
from spacearm.kernels.singular_values import bidiagonal

kernel = compiler(**SETTINGS, cache=True)
"""A function that is called from Python, compiled once and kept on disk."""


MOVING = moving(LANES)
BIDIAGONAL = bidiagonal(LANES)


@step
def work(N: int, n: int) -> Work:
    """Lanes for an arm of N joints with n rates."""
    return Work(
        body=np.empty(N + 1, MOVING),
        sin=np.empty(LANES),
        cos=np.empty(LANES),
        r_cm=np.empty((3, LANES)),
        r_E=np.empty((3, LANES)),
        L=np.empty((6, LANES)),
        J=np.empty((n, 6, LANES)),
    )


@step
def fill(w: Work, q: Numbers, first: int) -> None:
    """Lanes from the columns of q (N, m); those past its end repeat the first."""
    there = min(LANES, q.shape[1] - first)
    for i in range(q.shape[0]):
        for l in range(there):
            w.body[i + 1].q[l] = q[i, first + l]
        for l in range(there, LANES):
            w.body[i + 1].q[l] = q[i, first]


@kernel
def measures(
    b: Bodies,
    tip: int,
    E: Numbers,
    n: int,
    rows: Indices,
    scale: Numbers,
    q: Numbers,
    condition: bool,
    values: Numbers,
) -> None:
    """The measures of m configurations.

    Args:
        b: The arm.
        tip: Body that the tip is fixed to.
        E: (3,) the tip in the frame of that body [m].
        n: Number of columns of its Jacobian.
        rows: (k,) rows of the twist that count.
        scale: (k,) their factors.
        q: (N, m) joint positions [rad] or [m].
        condition: Whether the condition is wanted; it costs the greatest singular value.
        values: (5, m) takes the measures, in the order of MEASURES.
    """
    m = q.shape[1]
    w = work(q.shape[0], n)
    A, x, v = np.empty((n, 6, LANES)), np.empty(1, BIDIAGONAL), np.empty((5, LANES))
    for first in range(0, m, LANES):
        fill(w, q, first)
        generalized_jacobian(b, tip, E, w)
        measure(w, rows, scale, condition, A, x[0], v)
        for i in range(5):
            for l in range(min(LANES, m - first)):
                values[i, first + l] = v[i, l]


@kernel
def jacobians(b: Bodies, tip: int, E: Numbers, q: Numbers, J: Numbers) -> None:
    """J (m, 6, n) takes the generalized Jacobians of m configurations q (N, m)."""
    m, _, n = J.shape
    w = work(q.shape[0], n)
    for first in range(0, m, LANES):
        fill(w, q, first)
        generalized_jacobian(b, tip, E, w)
        for l in range(min(LANES, m - first)):
            for x in range(6):
                for j in range(n):
                    J[first + l, x, j] = w.J[j, x, l]


@kernel
def reactions(
    b: Bodies, tip: int, E: Numbers, q: Numbers, J: Numbers, A: Numbers, r: Numbers, R: Numbers
) -> None:
    """How m configurations q (N, m) react, all in spacecraft axes.

    Args:
        b: The arm.
        tip: Body that the tip is fixed to.
        E: (3,) the tip in the frame of that body [m].
        q: (N, m) joint positions [rad] or [m].
        J: (m, 6, n) takes J*.
        A: (m, 3, n) takes the connection -D^-1 D_q of (33c): what turns the spacecraft.
        r: (m, 3) takes the tip from the system CM [m].
        R: (m, 3, 3) takes the attitude of body `tip`.
    """
    m, _, n = J.shape
    w = work(q.shape[0], n)
    for first in range(0, m, LANES):
        fill(w, q, first)
        generalized_jacobian(b, tip, E, w)
        for l in range(min(LANES, m - first)):
            for x in range(3):
                r[first + l, x] = w.r_E[x, l]
                for y in range(3):
                    R[first + l, x, y] = w.body[tip].R[x, y, l]
                for j in range(n):
                    J[first + l, x, j] = w.J[j, x, l]
                    J[first + l, 3 + x, j] = A[first + l, x, j] = w.J[j, 3 + x, l]
                for i in range(1, len(b)):
                    if b[i].on_chain and not b[i].slides:
                        A[first + l, x, b[i].column] -= b[i].gain * w.body[i].R[x, 2, l]
