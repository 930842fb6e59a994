"""Distance to the singular set to first order, the compiled twin of `mechanics.nearness`.

The columns of J are taken per radian, so that sliding joints are measured as turning ones are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from spacearm.kernels.floating import Bodies, Indices, Numbers, Work
from spacearm.kernels.lanes import Lanes, merged, step
from spacearm.kernels.singular_values import Bidiagonal, bidiagonalise
from spacearm.kernels.singular_vectors import (
    Vectors,
    back_from_left,
    back_from_right,
    singular_vectors,
)
from spacearm.kernels.slopes import Slopes, joint_axes, slopes, wrench

NOTHING, ROUNDED, FADING = 1e-12, 1e-9, 0.3
"""As in `mechanics.nearness`."""
ZERO = 2.0**-48
"""Least singular values up to this share of the norm of J are zero."""


class Nearness(NamedTuple):
    """Work arrays, by lanes.

    Attributes:
        vectors: Singular vectors.
        slopes: Derivatives.
        L: (n - k + 1, 2 n - k, lanes) derivatives of sigma_min, then of u^T J v_0, orthonormal at
            last; n - k columns more than there are joints.
        t: (4, lanes) scratch.
    """

    vectors: Vectors
    slopes: Slopes
    L: Lanes
    t: Lanes


@merged
def distance(
    b: Bodies,
    tip: int,
    rows: Indices,
    scale: Numbers,
    radian: Numbers,
    fading: float,
    w: Work,
    A: Lanes,
    x: Bidiagonal,
    d: Nearness,
    values: Lanes,
) -> None:
    """Compute the distance and the normal space of the singular set.

    Args:
        b: The arm.
        tip: Body that the tip is fixed to.
        rows: (k,) task rows of the twist.
        scale: (k,) their factors.
        radian: (n,) what counts as a radian of each joint.
        fading: Slopes below this times sigma_min are no equations [1/rad].
        w: Work arrays that hold J, r_E and the bodies.
        A: (n, 6, lanes) scratch.
        x: Scratch.
        d: Scratch.
        values: (2 + r n, lanes) receives distance, sigma_min and r rows; see `way_out`.
    """
    n, k, lanes = w.J.shape[0], len(rows), values.shape[1]
    norm, sigma = d.t[2], d.t[3]
    for l in range(lanes):
        norm[l] = 0.0
    for j in range(n):
        for i in range(k):
            for l in range(lanes):
                A[j, i, l] = scale[i] * radian[j] * w.J[j, rows[i], l]
                norm[l] += A[j, i, l] * A[j, i, l]
    for l in range(lanes):
        norm[l] = math.sqrt(norm[l])
    bidiagonalise(A, k, d.t[:2], x)
    singular_vectors(k, x, d.vectors)
    for l in range(lanes):
        sigma[l] = math.sqrt(x.least[l])
    back_from_right(A, k, d.vectors)
    wrench(rows, scale, d.vectors.z, b[0].carried, w, d.slopes)
    joint_axes(b, w, d.slopes)
    for r in range(n - k + 1):
        if r > 0:
            for j in range(n):
                for l in range(lanes):
                    d.vectors.y[j, l] = 1.0 if j == k - 1 + r else 0.0
        back_from_left(A, k, d.vectors)
        for j in range(n):
            for l in range(lanes):
                d.vectors.y[j, l] *= radian[j]
        slopes(b, tip, w, d.slopes, d.vectors.y, d.L[r, :n])
    way_out(n - k + 1, radian, fading, d, norm, sigma, values)


@step
def way_out(
    rows: int,
    radian: Numbers,
    fading: float,
    d: Nearness,
    norm: Lanes,
    sigma: Lanes,
    values: Lanes,
) -> None:
    """Compute the distance and orthonormal rows L, by Gram and Schmidt's method.

    The first row leads away from the set; all of them span its normal space, to first order. The
    others are padded with lambda, so that those that it outweighs count less: see `_one` of
    `mechanics.nearness`.

    Args:
        rows: Number of rows.
        radian: (n,) what counts as a radian of each joint.
        fading: As of `distance`.
        d: Work arrays that hold L.
        norm: (lanes,) norm of J per radian.
        sigma: (lanes,) sigma_min.
        values: (2 + r n, lanes) receives distance, sigma_min and the first r rows, per radian.
    """
    n, lanes, length = len(radian), norm.shape[0], d.t[1]
    for r in range(rows):
        for j in range(n):
            for l in range(lanes):
                d.L[r, j, l] *= radian[j]
        for o in range(n, d.L.shape[1]):
            for l in range(lanes):
                pad = ROUNDED * norm[l] + fading * sigma[l]
                d.L[r, o, l] = pad if o == n + r - 1 else 0.0
    for r in range(1, rows + 1):
        row = r % rows  # the gradient comes last
        for _ in range(2):  # twice is enough
            for i in range(1, r):
                project(d.L[i], d.L[row], d.t[0])
        size(d.L[row], length)
        if row > 0:
            for l in range(lanes):
                share = 1.0 / length[l] if length[l] > 0.0 else 0.0
                for j in range(d.L.shape[1]):
                    d.L[row, j, l] *= share
    way = d.t[0]
    size(d.L[0, :n], way)
    for l in range(lanes):
        sound = length[l] > NOTHING * norm[l]
        share = 1.0 / way[l] if sound else 0.0
        for j in range(n):
            d.L[0, j, l] *= share
        none = math.inf if sigma[l] > ZERO * norm[l] else 0.0 * sigma[l]
        far = sigma[l] * way[l] / (length[l] * length[l]) if sound else none
        values[0, l] = far if none > 0.0 else none
        values[1, l] = sigma[l]
    for r in range(1, rows):
        project(d.L[0, :n], d.L[r, :n], d.t[0])
    for x in range(2, values.shape[0]):
        r, j = divmod(x - 2, n)
        for l in range(lanes):
            values[x, l] = d.L[r, j, l]


@step
def size(x: Lanes, t: Lanes) -> None:
    """Compute the length t of x."""
    product(x, x, t)
    for l in range(t.shape[0]):
        t[l] = math.sqrt(t[l])


@step
def project(along: Lanes, x: Lanes, t: Lanes) -> None:
    """Take the component along a unit vector, or zero, out of x; t is scratch."""
    product(along, x, t)
    for j in range(x.shape[0]):
        for l in range(t.shape[0]):
            x[j, l] -= t[l] * along[j, l]


@step
def product(x: Lanes, y: Lanes, t: Lanes) -> None:
    """Compute the scalar product t of x and y."""
    for l in range(t.shape[0]):
        t[l] = 0.0
    for j in range(x.shape[0]):
        for l in range(t.shape[0]):
            t[l] += x[j, l] * y[j, l]
