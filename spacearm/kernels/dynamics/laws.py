"""The built-in control laws, compiled: those of `spacearm.motion.controllers`, line by line."""

from __future__ import annotations

from spacearm.kernels.dynamics import equations
from spacearm.kernels.dynamics.calls import Entry, call, jump
from spacearm.kernels.dynamics.context import (
    ACTS,
    KD,
    KP,
    REST,
    TARGET,
    Context,
    bodies_of,
    context_at,
    cube,
    law_of,
    mat,
    moving_of,
    vec,
)
from spacearm.kernels.dynamics.decomposition import decompose
from spacearm.kernels.dynamics.tips import jacobian, task_rows
from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import add, dot, part, put, read, times

OUTSIDE, JOINT_PD, TRANSPOSED, RESOLVED, DAMPED, REACTIONLESS = range(6)
"""Kinds of laws."""
FAILED = 1
"""Status of a law that gives no torques."""


@Entry
def torques(at: int, t: float, y_at: int, _: int) -> int:
    """Compute the torques of all laws; return a status, 0 if there are torques."""
    x = context_at(at)
    tau, one, of_law = vec(x._tau, x.n), vec(x._one, x.n), cube(x._of_law, x.laws, 5, x.size)
    for j in range(x.n):
        tau[j] = 0.0
    for i in range(x.laws):
        status = jump(law_of(x, i).entry, x.here, t, y_at, i)
        if status:
            return int(status)
        for j in range(x.n):
            tau[j] += of_law[i, ACTS, j] * one[j]
    return 0


@Entry
def held(at: int, _: float, __: int, ___: int) -> int:
    """Take the torques that a controller of fixed rate gave last."""
    x = context_at(at)
    tau, kept = vec(x._tau, x.n), vec(x._held, x.n)
    for j in range(x.n):
        tau[j] = kept[j]
    return 0


@Entry
def outside(at: int, t: float, _: int, i: int) -> int:
    """Compute the torques of a law outside in `one`."""
    x = context_at(at)
    law = law_of(x, i)
    if law.pose:
        show(x, law.tip)
    return int(call(law.call, t, x._seen, x._one))


@Entry
def joint_pd(at: int, t: float, y_at: int, i: int) -> int:
    """Compute the torques of `JointPD` in `one`."""
    x = context_at(at)
    n, law, one, dq, y = x.n, law_of(x, i), vec(x._one, x.n), vec(x._dq, x.n), vec(y_at, x.n)
    of_law, status = cube(x._of_law, x.laws, 5, x.size)[i], 0
    goal = of_law[TARGET]
    if law.moving:
        status = call(law.moving, t, x._seen, x._goal)
        goal = vec(x._goal, x.size)
    for j in range(n):
        one[j] = of_law[KP, j] * (goal[j] - y[j]) - of_law[KD, j] * dq[j]
    return int(status)


@part
def task_of(x: Context, i: int) -> Numbers:
    """Return the task Jacobian of law i for the spacecraft that it assumes."""
    law, J, rows = law_of(x, i), mat(x._J, 6 * x.tips, x.n), mat(x._task, 6, x.n)
    J = J[6 * law.tip : 6 * law.tip + 6]
    jacobian(x, law.tip, law.f, J)
    task_rows(x, law, J, rows)
    return rows


@Entry
def transposed(at: int, t: float, _: int, i: int) -> int:
    """Compute the torques of `TransposedJacobian` in `one`, equation (42)."""
    x = context_at(at)
    n, law, one, dq, error = (
        x.n,
        law_of(x, i),
        vec(x._one, x.n),
        vec(x._dq, x.n),
        mat(x._error, 2, 6),
    )
    of_law, status = cube(x._of_law, x.laws, 5, x.size)[i], jump(x.aim, at, t, i, 0)
    if status:
        return int(status)
    rows = task_of(x, i)
    for j in range(n):
        one[j] = 0.0
    for o in range(law.k):
        speed = 0.0
        for j in range(n):
            speed += rows[o, j] * dq[j]
        push = of_law[KP, o] * error[0, o] + of_law[KD, o] * (error[1, o] - speed)
        for j in range(n):
            one[j] += rows[o, j] * push
    return 0


@part
def ask(x: Context, t: float, i: int) -> int:
    """Compute the task Jacobian of law i and the tip velocity that it asks for, in `error`."""
    law, error, of_law = law_of(x, i), mat(x._error, 2, 6), cube(x._of_law, x.laws, 5, x.size)
    status = jump(x.aim, x.here, t, i, 0)
    if status == 0:
        task_of(x, i)
        for o in range(law.k):
            error[1, o] += of_law[i, KP, o] * error[0, o]
    return int(status)


@part
def serve(x: Context, i: int) -> None:
    """Turn the joint rates in `one` to torques that make them so."""
    law, one, dq = law_of(x, i), vec(x._one, x.n), vec(x._dq, x.n)
    for j in range(x.n):
        one[j] = law.servo * (one[j] - dq[j])
    inverse(x, law.f)


@part
def show(x: Context, tip: int) -> None:
    """Write what functions outside see after the state: attitude, tip, J* in inertial axes."""
    seen, n = vec(x._seen, x.states + 30 + 6 * x.n), x.n
    at, turned = mat(x._at, x.tips, 3)[tip], cube(x._turned, x.tips, 3, 3)[tip]
    J, first = mat(x._J, 6 * x.tips, n)[6 * tip : 6 * tip + 6], x.states
    jacobian(x, tip, x.f, J)
    for o in range(3):
        seen[first + 9 + o] = at[o]
        for z in range(3):
            seen[first + 3 * o + z] = x.R[o, z]
            seen[first + 12 + 3 * o + z] = turned[o, z]
        for j in range(n):
            for kind in range(0, 6, 3):
                total = 0.0
                for z in range(3):
                    total += x.R[o, z] * J[kind + z, j]
                seen[first + 21 + (kind + o) * n + j] = total


@Entry
def resolved(at: int, t: float, y_at: int, i: int) -> int:
    """Compute the torques of `ResolvedRate` in `one`."""
    x = context_at(at)
    status = ask(x, t, i)
    if status:
        return int(status)
    y = vec(y_at, x.n)
    n, law, one = x.n, law_of(x, i), vec(x._one, x.n)
    k, of_law, asked_for = law.k, cube(x._of_law, x.laws, 5, x.size)[i], mat(x._error, 2, 6)[1]
    W, U, sigma = mat(x._task, k, n), x.U, x.sigma
    decompose(W, U, sigma)
    if k > n or sigma[k - 1] <= law.least * sigma[0]:
        return FAILED
    for j in range(n):
        one[j] = 0.0
    for o in range(k):
        asked = 0.0
        for z in range(k):
            asked += U[z, o] * asked_for[z]
        for j in range(n):
            one[j] += W[o, j] * asked / sigma[o] ** 2
    if law.rests:
        gain = 0.0
        for o in range(k):
            gain += of_law[KP, o] / k
        for j in range(n):
            one[j] += gain * (of_law[REST, j] - y[j])
        for o in range(k):
            seen = 0.0
            for j in range(n):
                seen += W[o, j] * (of_law[REST, j] - y[j])
            for j in range(n):
                one[j] -= gain * W[o, j] * seen / sigma[o] ** 2
    serve(x, i)
    return 0


@Entry
def damped(at: int, t: float, _: int, i: int) -> int:
    """Compute the torques of `DampedLeastSquares` or `Reactionless` in `one`."""
    x = context_at(at)
    status = ask(x, t, i)
    if status:
        return int(status)
    n, law, one, rank = x.n, law_of(x, i), vec(x._one, x.n), 0
    k, asked_for = law.k, mat(x._error, 2, 6)[1]
    W, U, sigma = mat(x._task, k, n), x.U, x.sigma
    if law.kind == REACTIONLESS:
        V, m = mat(x._V, 3, n), moving_of(x)
        for o in range(3):
            for j in range(n):
                V[o, j] = m.D_q[j, o]
        decompose(V, U, sigma)
        for o in range(3):
            rank += sigma[o] > law.least * sigma[0]
        if rank >= n:
            return FAILED
        for o in range(rank):  # leave out the motions that turn the spacecraft
            for z in range(k):
                seen = 0.0
                for j in range(n):
                    seen += W[z, j] * V[o, j]
                for j in range(n):
                    W[z, j] -= V[o, j] * seen / sigma[o] ** 2
    for o in range(k):
        for j in range(n):
            W[o, j] *= law.scale[o]
    decompose(W, U, sigma)
    most = min(k, n - rank)
    nearness = min(sigma[most - 1] / law.threshold, 1.0)
    damping = law.damping**2 * (1.0 - nearness**2)
    for j in range(n):
        one[j] = 0.0
    for o in range(most):
        asked = 0.0
        for z in range(k):
            asked += U[z, o] * law.scale[z] * asked_for[z]
        if sigma[o] ** 2 + damping > 0.0:
            for j in range(n):
                one[j] += W[o, j] * asked / (sigma[o] ** 2 + damping)
    serve(x, i)
    return 0


@part
def inverse(x: Context, f: int) -> None:
    """Turn joint accelerations in `one` to torques of an arm with zero momentum."""
    b, m, n, one, dq = bodies_of(x), moving_of(x), x.n, vec(x._one, x.n), vec(x._dq, x.n)
    tau, M = m.tau, b[0].carried
    equations.still(b, m)
    put(m.body[0].w, (0.0, 0.0, 0.0))
    if f == 6:
        equations.angular_velocity(m, dq, (0.0, 0.0, 0.0))
    jump(x.bias, x.here, float(f), 0, 0)
    P, turn = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for j in range(n):
        a = one[j]
        P, turn = add(P, times(a, read(m.P[j]))), add(turn, times(a, read(m.X[j])))
    for j in range(n):
        tau[j] = m.c[j]
        for k in range(n):
            tau[j] += m.H[j, k] * one[k]
        if f > 0:
            tau[j] -= dot(read(m.P[j]), P) / M
        if f == 6:
            tau[j] -= dot(read(m.D_q[j]), turn)
    for j in range(n):
        one[j] = tau[j]


@Entry
def bias(at: int, f: float, _: int, __: int) -> int:
    """Compute c*; see `equations.bias`."""
    x = context_at(at)
    equations.bias(bodies_of(x), int(f), moving_of(x), vec(x._dq, x.n))
    return 0


LAWS = {
    OUTSIDE: outside, JOINT_PD: joint_pd, TRANSPOSED: transposed,
    RESOLVED: resolved, DAMPED: damped, REACTIONLESS: damped,
}  # fmt: skip
"""The functions of the kinds."""
