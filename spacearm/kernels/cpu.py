"""Loops over blocks of configurations on the processor, `LANES` at a time."""

from __future__ import annotations

import numpy as np

from spacearm.kernels.floating import Bodies, Indices, Numbers, Work, generalized_jacobian, moving
from spacearm.kernels.lanes import LANES, SETTINGS, compiler, step
from spacearm.kernels.measures import measure
from spacearm.kernels.nearness import Nearness, distance
from spacearm.kernels.singular_values import bidiagonal
from spacearm.kernels.singular_vectors import Vectors
from spacearm.kernels.slopes import Slopes, turning

kernel = compiler(**SETTINGS, cache=True)
"""A function that is called from Python, compiled once and kept on disk."""


MOVING = moving(LANES)
TURNING = turning(LANES)
BIDIAGONAL = bidiagonal(LANES)


@step
def work(N: int, n: int) -> Work:
    """Allocate the work arrays of an arm of N joints with n rates."""
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
def nearness(bodies: int, n: int, rows: int) -> Nearness:
    """Allocate the work arrays of `distance` for n rates and so many rows of the normal space."""
    return Nearness(
        vectors=Vectors(
            z=np.empty((6, LANES)),
            y=np.empty((n, LANES)),
            plus=np.empty((6, LANES)),
            minus=np.empty((6, LANES)),
            along=np.empty((6, LANES)),
            t=np.empty((2, LANES)),
        ),
        slopes=Slopes(
            body=np.empty(bodies, TURNING),
            F=np.empty((6, LANES)),
            mu=np.empty((6, LANES)),
            h=np.empty((6, LANES)),
            I_mu=np.empty((6, LANES)),
        ),
        L=np.empty((rows, n + rows - 1, LANES)),
        t=np.empty((4, LANES)),
    )


@step
def fill(w: Work, q: Numbers, first: int) -> None:
    """Copy columns of q (N, m) into the lanes; lanes past its end repeat the first column."""
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
    """Compute the measures of m configurations.

    Args:
        b: The arm.
        tip: Body that the tip is fixed to.
        E: (3,) the tip in the frame of that body [m].
        n: Number of columns of its Jacobian.
        rows: (k,) task rows of the twist.
        scale: (k,) their factors.
        q: (N, m) joint positions [rad] or [m].
        condition: Whether to compute the condition number, which needs the largest singular value.
        values: (5, m) receives the measures, in the order of `QUANTITIES`.
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
def distances(
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
    """Compute the distance to the singular set and its normal space, to first order.

    Args:
        b: The arm.
        tip: Body that the tip is fixed to.
        E: (3,) the tip in the frame of that body [m].
        rows: (k,) task rows of the twist.
        scale: (k,) their factors.
        radian: (n,) what counts as a radian of each joint.
        fading: As of `nearness.distance`.
        q: (N, m) joint positions [rad] or [m].
        values: (2 + r n, m) receives distance, sigma_min and r orthonormal rows; see `way_out`.
    """
    m, n = q.shape[1], len(radian)
    w = work(q.shape[0], n)
    A, x, v = np.empty((n, 6, LANES)), np.empty(1, BIDIAGONAL), np.empty((len(values), LANES))
    d = nearness(len(b), n, n - len(rows) + 1)
    for first in range(0, m, LANES):
        fill(w, q, first)
        generalized_jacobian(b, tip, E, w)
        distance(b, tip, rows, scale, radian, fading, w, A, x[0], d, v)
        for i in range(len(values)):
            for l in range(min(LANES, m - first)):
                values[i, first + l] = v[i, l]


@step
def take_jacobians(w: Work, first: int, J: Numbers) -> None:
    """Copy the lanes of J* to J (m, 6, n), from configuration `first` on."""
    m, _, n = J.shape
    for l in range(min(LANES, m - first)):
        for x in range(6):
            for j in range(n):
                J[first + l, x, j] = w.J[j, x, l]


@step
def take_connections(
    b: Bodies, tip: int, w: Work, first: int, A: Numbers, r: Numbers, R: Numbers
) -> None:
    """Copy the lanes of the connection, the tip and its attitude; see `reactions`."""
    m, _, n = A.shape
    for l in range(min(LANES, m - first)):
        for x in range(3):
            r[first + l, x] = w.r_E[x, l]
            for y in range(3):
                R[first + l, x, y] = w.body[tip].R[x, y, l]
            for j in range(n):
                A[first + l, x, j] = w.J[j, 3 + x, l]
            for i in range(1, len(b)):
                if b[i].on_chain and not b[i].slides:
                    A[first + l, x, b[i].column] -= b[i].gain * w.body[i].R[x, 2, l]


@kernel
def jacobians(b: Bodies, tip: int, E: Numbers, q: Numbers, J: Numbers) -> None:
    """Compute the generalized Jacobians J (m, 6, n) of m configurations q (N, m)."""
    m, _, n = J.shape
    w = work(q.shape[0], n)
    for first in range(0, m, LANES):
        fill(w, q, first)
        generalized_jacobian(b, tip, E, w)
        take_jacobians(w, first, J)


@kernel
def reactions(
    b: Bodies, tip: int, E: Numbers, q: Numbers, J: Numbers, A: Numbers, r: Numbers, R: Numbers
) -> None:
    """Compute J*, the connection and the tip pose of m configurations, all in spacecraft axes.

    Args:
        b: The arm.
        tip: Body that the tip is fixed to.
        E: (3,) the tip in the frame of that body [m].
        q: (N, m) joint positions [rad] or [m].
        J: (m, 6, n) receives J*.
        A: (m, 3, n) receives the connection -D^-1 D_q of (33c).
        r: (m, 3) receives the tip from the system CM [m].
        R: (m, 3, 3) receives the attitude of body `tip`.
    """
    m, _, n = J.shape
    w = work(q.shape[0], n)
    for first in range(0, m, LANES):
        fill(w, q, first)
        generalized_jacobian(b, tip, E, w)
        take_jacobians(w, first, J)
        take_connections(b, tip, w, first, A, r, R)
