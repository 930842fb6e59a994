"""The tips of an arm in compiled code: where they are, J*, singularities, goals and errors."""

from __future__ import annotations

import math

from spacearm.kernels.dynamics.calls import Entry, call, jump
from spacearm.kernels.dynamics.context import (
    TARGET,
    Context,
    bodies_of,
    context_at,
    cube,
    frame_of,
    law_of,
    mat,
    moving_of,
    vec,
    whole_numbers,
)
from spacearm.kernels.dynamics.decomposition import decompose, free_slope, null_space
from spacearm.kernels.dynamics.masses import Moving
from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import (
    Record,
    Vector,
    add,
    cross,
    minus,
    part,
    put,
    read,
    read_rows,
    step,
    turn,
)

INSTANT = 1e-6
"""Half the time over which the velocity of a moving target is taken [s]."""
DIFFERENCE = 1e-4
"""Displacement of the joints by which the derivatives of J* are taken [rad]."""
NOTHING, FADING = 1e-9, 0.3
"""Slopes below this share of the norm of J* are rounding; others as in `mechanics.nearness`."""
NO_RANK = 2.0**-48
"""Least singular values up to this share of the norm of J* are zero, as in `kernels.nearness`."""
UPSIDE_DOWN = 1e-9 - 1.0
"""Cosine of the tilt below which the smallest rotation to upright is not unique."""


@step
def lever(m: Moving, frame: Record) -> Vector:
    """Return a frame's origin from the system CM, spacecraft axes [m]."""
    k = m.body[frame.body]
    from_joint = turn(read_rows(k.R), read(frame.p))
    return add(minus(read(k.a), read(m.whole[0].r_cm)), from_joint)


@part
def place_tip(x: Context, i: int, com: Numbers) -> None:
    """Compute position [m] and attitude of a tip in the inertial frame, from the system CM."""
    m, frame = moving_of(x), frame_of(x, i)
    at, R = mat(x._at, x.tips, 3)[i], cube(x._turned, x.tips, 3, 3)[i]
    k = m.body[frame.body]
    put(at, add(read(com), turn(read_rows(x.R), lever(m, frame))))
    for o in range(3):
        for y in range(3):
            total = 0.0
            for a in range(3):
                inner = 0.0
                for c in range(3):
                    inner += k.R[a, c] * frame.R[c, y]
                total += x.R[o, a] * inner
            R[o, y] = total


@part
def jacobian(x: Context, tip: int, f: int, J: Numbers) -> None:
    """Compute J* (6, n) of a tip in spacecraft axes for a spacecraft with f free components."""
    b, m, frame, n = bodies_of(x), moving_of(x), frame_of(x, tip), x.n
    M = b[0].carried
    for j in range(n):
        for a in range(6):
            J[a, j] = 0.0
    e = lever(m, frame)
    i = frame.body
    while i > 0:
        d, j = m.body[i], b[i].column
        u, v = read(d.u), read(d.v)
        swung = cross(u, e)
        for a in range(3):
            J[a, j] += v[a] + swung[a]
            J[3 + a, j] += u[a]
        i = b[i].parent
    if f == 0:
        return
    for j in range(n):
        for a in range(3):
            J[a, j] -= m.P[j, a] / M
        if f == 6:
            X = read(m.X[j])
            swung = cross(X, e)
            for a in range(3):
                J[a, j] -= swung[a]
                J[3 + a, j] -= X[a]


@part
def arm_task(x: Context, W: Numbers) -> None:
    """Compute the task Jacobian (k, n) of the arm in the state that the bodies are placed in."""
    J, rows, scale = (
        mat(x._J, 6 * x.tips, x.n),
        whole_numbers(x._rows, 1, x.k)[0],
        vec(x._scale, x.k),
    )
    for tip in range(x.tips):
        jacobian(x, tip, x.f, J[6 * tip : 6 * tip + 6])
    for o in range(x.k):
        for j in range(x.n):
            W[o, j] = scale[o] * J[rows[o], j]


@part
def singular_distance(x: Context, t: float, y: Numbers) -> float:
    """Compute the distance to the singular set to first order [rad], as `mechanics.nearness` does.

    The derivatives of J* are central differences, so that every mode of the spacecraft, mimic
    joints and several tips are covered. The state must be placed, and is placed again at the end.
    """
    k, n = x.k, x.n
    if k > n:
        return 0.0
    W, U, sigma = mat(x._look, k, n), mat(x._look_U, k, k), vec(x._look_sigma, k)
    radian, at, L = vec(x._radian, n), vec(x._look_y, x.states), mat(x._look_L, n + 1, 2 * n)
    V = mat(x._look_V, n, n)
    per_radian(x, W, radian)
    norm = 0.0
    for i in range(k):
        for j in range(n):
            norm += W[i, j] ** 2
    norm = math.sqrt(norm)
    decompose(W, U, sigma)
    if not sigma[k - 1] > NO_RANK * norm:
        return 0.0
    for i in range(k):
        for j in range(n):
            V[i, j] = W[i, j] / sigma[i]
    least = sigma[k - 1]
    null_space(V, k)
    u = vec(x._look_u, k)
    for i in range(k):
        u[i] = U[i, k - 1]
    for o in range(x.states):
        at[o] = y[o]
    rows = n - k + 1
    for j in range(n):
        for i in range(rows):
            L[i, j] = 0.0
        for side in (1.0, -1.0):
            at[j] = y[j] + side * DIFFERENCE * radian[j]
            jump(x.settle, x.here, t, x._look_y, 0)
            per_radian(x, W, radian)
            for i in range(rows):  # of V: sigma_min's first, then the null space
                for a in range(k):
                    for c in range(n):
                        L[i, j] += 0.5 * side / DIFFERENCE * u[a] * W[a, c] * V[k - 1 + i, c]
        at[j] = y[j]
    jump(x.settle, x.here, t, y.ctypes.data, 0)
    slope = free_slope(L, rows, NOTHING * norm + FADING * least)
    return float(least / slope) if slope > NOTHING * norm else math.inf


@part
def per_radian(x: Context, W: Numbers, radian: Numbers) -> None:
    """Compute the task Jacobian (k, n) per radian of each joint."""
    arm_task(x, W)
    for i in range(x.k):
        for j in range(x.n):
            W[i, j] *= radian[j]


@part
def goal_axes(context: Context, axis: int) -> None:
    """Compute the goal axes (3, 3) as columns; the inertial ones, or tilted with an axis."""
    R, A = context.R, context.A
    for x in range(3):
        for y in range(3):
            A[x, y] = 1.0 if x == y else 0.0
    if axis < 0:
        return
    half = R[axis, axis] < UPSIDE_DOWN
    flip = (axis + 1) % 3  # the axis before the previous one is the next one
    sign = -1.0 if half else 1.0
    e = (sign * A[0, axis], sign * A[1, axis], sign * A[2, axis])
    to = (R[0, axis], R[1, axis], R[2, axis])
    x, y, z = cross(e, to)
    cosine = e[0] * to[0] + e[1] * to[1] + e[2] * to[2]
    rest = 1.0 + cosine if cosine > 0.0 else (x * x + y * y + z * z) / (1.0 - cosine)
    T = (
        (1.0 - (y * y + z * z) / rest, -z + x * y / rest, y + x * z / rest),
        (z + x * y / rest, 1.0 - (x * x + z * z) / rest, -x + y * z / rest),
        (-y + x * z / rest, x + y * z / rest, 1.0 - (x * x + y * y) / rest),
    )
    for column in range(3):
        turned = sign if column != flip else 1.0
        A[0, column] = turned * T[0][column]
        A[1, column] = turned * T[1][column]
        A[2, column] = turned * T[2][column]


@part
def task_rows(x: Context, law: Record, J: Numbers, into: Numbers) -> None:
    """Turn J (6, n) in spacecraft axes to the task rows of a law along the goal axes."""
    for i in range(law.k):
        z, kind = law.rows[i] % 3, 3 * (law.rows[i] // 3)
        a = (0.0, 0.0, 0.0)
        for y in range(3):
            a = (
                a[0] + x.A[y, z] * x.R[y, 0],
                a[1] + x.A[y, z] * x.R[y, 1],
                a[2] + x.A[y, z] * x.R[y, 2],
            )
        for j in range(x.n):
            into[i, j] = a[0] * J[kind, j] + a[1] * J[kind + 1, j] + a[2] * J[kind + 2, j]


@part
def turn_between(start: Numbers, end: Numbers) -> tuple[float, float, float]:
    """Return the rotation vector from one attitude (3, 3) to another, inertial axes [rad]."""
    # end start^T, as a quaternion by the largest of its four numbers
    d0 = end[0, 0] * start[0, 0] + end[0, 1] * start[0, 1] + end[0, 2] * start[0, 2]
    d1 = end[1, 0] * start[1, 0] + end[1, 1] * start[1, 1] + end[1, 2] * start[1, 2]
    d2 = end[2, 0] * start[2, 0] + end[2, 1] * start[2, 1] + end[2, 2] * start[2, 2]
    r01 = end[0, 0] * start[1, 0] + end[0, 1] * start[1, 1] + end[0, 2] * start[1, 2]
    r10 = end[1, 0] * start[0, 0] + end[1, 1] * start[0, 1] + end[1, 2] * start[0, 2]
    r02 = end[0, 0] * start[2, 0] + end[0, 1] * start[2, 1] + end[0, 2] * start[2, 2]
    r20 = end[2, 0] * start[0, 0] + end[2, 1] * start[0, 1] + end[2, 2] * start[0, 2]
    r12 = end[1, 0] * start[2, 0] + end[1, 1] * start[2, 1] + end[1, 2] * start[2, 2]
    r21 = end[2, 0] * start[1, 0] + end[2, 1] * start[1, 1] + end[2, 2] * start[1, 2]
    trace = d0 + d1 + d2
    if trace >= max(d0, d1, d2):
        n = 1.0 + trace
        x, y, z = r21 - r12, r02 - r20, r10 - r01
    elif d0 >= d1 and d0 >= d2:
        n = r21 - r12
        x, y, z = 1.0 + d0 - d1 - d2, r01 + r10, r02 + r20
    elif d1 >= d2:
        n = r02 - r20
        x, y, z = r01 + r10, 1.0 - d0 + d1 - d2, r12 + r21
    else:
        n = r10 - r01
        x, y, z = r02 + r20, r12 + r21, 1.0 - d0 - d1 + d2
    if n < 0.0:
        n, x, y, z = -n, -x, -y, -z
    e = math.sqrt(x * x + y * y + z * z)
    if e == 0.0:
        return (0.0, 0.0, 0.0)
    angle = 2.0 * math.atan2(e, n) / e
    return (angle * x, angle * y, angle * z)


@Entry
def aim(at: int, t: float, i: int, _: int) -> int:
    """Compute target minus tip in the task rows of law i, and the velocity of the target."""
    x = context_at(at)
    goal_axes(x, law_of(x, i).axis)
    law, run = law_of(x, i), mat(x._goal, 3, x.size)
    error, goal, status = mat(x._error, 2, 6), vec(x._goal, x.size), 0
    if law.moving:
        for row, when in ((0, t), (1, t - INSTANT), (2, t + INSTANT)):
            status |= call(law.moving, when, x._seen, x._goal + 8 * x.size * row)
    else:
        goal = cube(x._of_law, x.laws, 5, x.size)[i, TARGET]
    tip, there = mat(x._at, x.tips, 3)[law.tip], cube(x._turned, x.tips, 3, 3)[law.tip]
    gap, swing = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if law.pose:
        gap = turn_between(there, goal[3:12].reshape(3, 3))
        if law.moving:
            swing = turn_between(run[1, 3:12].reshape(3, 3), run[2, 3:12].reshape(3, 3))
    for o in range(law.k):
        z = law.rows[o] % 3
        e, v = 0.0, 0.0
        if law.rows[o] > 2:
            for y in range(3):
                e += x.A[y, z] * gap[y]
                v += x.A[y, z] * swing[y]
        elif law.pose:
            for y in range(3):
                e += x.A[y, z] * (goal[y] - tip[y])
                v += x.A[y, z] * (run[2, y] - run[1, y])
        else:
            e = goal[o]
            for y in range(3):
                e -= x.A[y, z] * tip[y]
            v = run[2, o] - run[1, o]
        error[0, o] = e
        error[1, o] = v / (2.0 * INSTANT) if law.moving else 0.0
    return int(status)
