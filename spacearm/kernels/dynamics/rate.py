"""The rate of the state of a simulated arm, in compiled code."""

from __future__ import annotations

import math

from spacearm.kernels.dynamics import equations, masses
from spacearm.kernels.dynamics.calls import Entry, call, jump
from spacearm.kernels.dynamics.context import (
    DAMPING,
    EFFORT,
    FRICTION,
    RELAXED,
    SLIP,
    SPEED,
    STIFFNESS,
    Context,
    bodies_of,
    context_at,
    mat,
    moving_of,
    pushed_of,
    vec,
    wheel_of,
)
from spacearm.kernels.dynamics.masses import definite
from spacearm.kernels.dynamics.tips import lever, place_tip, turn_between
from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import (
    LARGEST_ANGLE,
    add,
    cross,
    dot,
    minus,
    part,
    put,
    read,
    read_rows,
    read_six,
    times,
    turn,
    turn_back,
)

NOT_RIGID = 2
"""Status of a state in which H* or D is not positive definite."""

SLOWING = 0.9
"""Share of its largest rate from which the torque that drives a joint falls, to zero there."""


@Entry
def rate(at: int, t: float, y_at: int, dy_at: int) -> int:
    """Compute the rate dy of a state y at time t; return a status, 0 if there is one."""
    x = context_at(at)
    jump(x.settle, at, t, y_at, 0)
    status = jump(x.torques, at, t, y_at, 0)
    if status:
        return int(status)
    return int(accelerations(x, t, vec(y_at, x.states), vec(dy_at, x.states)))


@part
def accelerations(x: Context, t: float, y: Numbers, dy: Numbers) -> int:
    """Compute the rate of a state under the torques that the controllers ask for."""
    n, b, m = x.n, bodies_of(x), moving_of(x)
    tau, joints, dq = vec(x._tau, n), mat(x._joints, 7, n), vec(x._dq, n)
    force, ddq, M = vec(x._force, n), vec(x._ddq, n), b[0].carried
    momenta, work = 2 * n + 7, 2 * n + 13
    equations.still(b, m)
    limit(x)
    dy[work], dy[work + 1] = 0.0, 0.0
    for j in range(n):
        give = -joints[STIFFNESS, j] * (y[j] - joints[RELAXED, j]) - joints[DAMPING, j] * dq[j]
        if joints[FRICTION, j] > 0.0:
            give -= joints[FRICTION, j] * math.tanh(dq[j] / joints[SLIP, j])
        dy[work] += tau[j] * dq[j]
        dy[work + 1] += give * dq[j]
        force[j] = tau[j] + give
        dy[j] = dq[j]
    for o in range(3):
        dy[2 * n + 4 + o] = y[momenta + o] / M if x.f > 0 else 0.0
        dy[momenta + o], dy[momenta + 3 + o] = 0.0, 0.0
    if x.wrench:
        status = jump(x.push, x.here, t, 0, dy.ctypes.data)
        if status:
            return int(status)
    spacecraft_rate(x, y)
    if x.wheels:
        status = jump(x.spin, x.here, t, y.ctypes.data, 0)
        if status:
            return int(status)
    jump(x.bias, x.here, float(x.f), 0, 0)
    solve(x)
    whole = m.whole[0]
    if not (whole.least > 0.0 and (x.f < 6 or definite(read_six(whole.L)))):
        return NOT_RIGID
    for j in range(n):
        dy[n + j] = ddq[j]
    dy[work + 2], dy[work + 3] = 0.0, 0.0
    if x.wrench or x.wheels:
        jump(x.balance, x.here, t, 0, dy.ctypes.data)
    turning(x, y, dy)
    return 0


@part
def limit(x: Context) -> None:
    """Cut the torques to what the joints can give at their rates."""
    tau, joints, dq = vec(x._tau, x.n), mat(x._joints, 7, x.n), vec(x._dq, x.n)
    for j in range(x.n):
        tau[j] = min(max(tau[j], -joints[EFFORT, j]), joints[EFFORT, j])
        if abs(dq[j]) > SLOWING * joints[SPEED, j] and tau[j] * dq[j] > 0.0:
            rest = (1.0 - abs(dq[j]) / joints[SPEED, j]) / (1.0 - SLOWING)
            tau[j] *= max(rest, 0.0)


@part
def solve(x: Context) -> None:
    """Solve H* ddq + c* = tau."""
    m = moving_of(x)
    equations.eliminate(bodies_of(x)[0].carried, x.f, m)
    equations.accelerate(m)


@Entry
def settle(at: int, _: float, y_at: int, __: int) -> int:
    """Place the bodies and tips in a state; compute masses and the connection."""
    x = context_at(at)
    y = vec(y_at, x.states)
    n, b, m, dq = x.n, bodies_of(x), moving_of(x), vec(x._dq, x.n)
    offsets, seen = vec(x._offsets, x.N), vec(x._seen, x.states)
    for j in range(n):
        dq[j] = y[n + j]
    for i in range(1, x.N + 1):
        q = b[i].gain * y[b[i].column] + offsets[i - 1]
        if abs(q) > LARGEST_ANGLE and not b[i].slides:
            q = math.atan2(math.sin(q), math.cos(q))
        m.angle[0, i - 1] = q
    attitude(x, y[2 * n], y[2 * n + 1], y[2 * n + 2], y[2 * n + 3])
    masses.configuration(b, m)
    equations.connect(m)
    com = vec(x._goal, 3)
    put(com, read(y[2 * n + 4 :]))
    if x.f == 0:
        put(com, add(read(x.base), turn(read_rows(x.R), read(m.whole[0].r_cm))))
    for i in range(x.tips):
        place_tip(x, i, com)
    for o in range(x.states):
        seen[o] = y[o]
    return 0


@part
def attitude(x: Context, a: float, b: float, c: float, n: float) -> None:
    """Compute the rotation (3, 3) of a quaternion of any length, equation (27)."""
    g, R = 2.0 / (a * a + b * b + c * c + n * n), x.R
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - g * (b * b + c * c), g * (a * b - c * n), g * (a * c + b * n)
    R[1, 0], R[1, 1], R[1, 2] = g * (a * b + c * n), 1.0 - g * (a * a + c * c), g * (b * c - a * n)
    R[2, 0], R[2, 1], R[2, 2] = g * (a * c - b * n), g * (b * c + a * n), 1.0 - g * (a * a + b * b)


@part
def spacecraft_rate(x: Context, y: Numbers) -> None:
    """Compute w_0 in spacecraft axes from the momentum, and what the wheels of each body hold."""
    n, m = x.n, moving_of(x)
    h, held = turn_back(read_rows(x.R), read(y[2 * n + 10 :])), 2 * n + 17
    put(m.body[0].w, (0.0, 0.0, 0.0))
    for i in range(x.wheels):
        wheel = wheel_of(x, i)
        d = m.body[wheel.body]
        own = times(y[held + i], turn(read_rows(d.R), read(wheel.axis)))
        put(d.held, add(read(d.held), own))
        h = minus(h, own)
    if x.f == 6:
        equations.angular_velocity(m, vec(x._dq, n), h)


@Entry
def spin(at: int, t: float, y_at: int, _: int) -> int:
    """Compute the torques of the wheels on the bodies that carry them.

    They are functions of time, or those of the law that holds: its torque on the spacecraft is
    -K phi - C w_0, phi the rotation vector from `level`. A wheel that holds all that it can takes
    no more.
    """
    x = context_at(at)
    y, m, held = vec(y_at, x.states), moving_of(x), 2 * x.n + 17
    status, given, phi = 0, vec(x._asked, x.wheels), (0.0, 0.0, 0.0)
    if x.motor:
        status = call(x.motor, t, x._seen, x._asked)
    if x.holds:
        phi = turn_between(x.level, x.R)  # inertial axes
    turned = turn_back(read_rows(x.R), phi)
    asked = add(times(x.stiffness, turned), times(x.damping, read(m.body[0].w)))
    for i in range(x.wheels):
        wheel = wheel_of(x, i)
        d, torque = m.body[wheel.body], dot(read(wheel.spread), asked)
        torque = min(max(torque, -wheel.torque), wheel.torque)
        full = abs(y[held + i]) >= wheel.capacity and torque * y[held + i] > 0.0
        wheel.rate = 0.0 if full else torque
        if x.motor:
            wheel.rate = given[i]
        axis = turn(read_rows(d.R), read(wheel.axis))
        put(d.turn, minus(read(d.turn), times(wheel.rate, axis)))
    return int(status)


@Entry
def push(at: int, t: float, _: int, dy_at: int) -> int:
    """Put external wrenches on the bodies, and the rates of momentum in the rate of the state."""
    x = context_at(at)
    dy, m, push = vec(dy_at, x.states), moving_of(x), mat(x._push, x.pushes, 6)
    status, momenta = call(x.wrench, t, x._seen, x._push), 2 * x.n + 7
    R = read_rows(x.R)
    for i in range(x.pushes):
        frame, w = pushed_of(x, i), push[i]
        d = m.body[frame.body]
        own = read_rows(d.R)
        F, N = read(w), read(w[3:])
        if frame.own:
            F, N = turn(read_rows(frame.R), F), turn(read_rows(frame.R), N)
            F, N = turn(own, F), turn(own, N)
        else:
            F, N = turn_back(R, F), turn_back(R, N)
        put(w, F)
        put(w[3:], N)
        put(d.push, add(read(d.push), F))
        put(d.turn, add(read(d.turn), add(N, cross(turn(own, read(frame.p)), F))))
        about_cm = add(N, cross(lever(m, frame), F))
        put(dy[momenta:], add(read(dy[momenta:]), turn(R, F)))
        put(dy[momenta + 3 :], add(read(dy[momenta + 3 :]), turn(R, about_cm)))
    return int(status)


@Entry
def balance(at: int, _: float, __: int, dy_at: int) -> int:
    """Put the powers of wrenches and wheels and the rates of the wheels in the rate."""
    x = context_at(at)
    n, m, b, dq, dy = x.n, moving_of(x), bodies_of(x), vec(x._dq, x.n), vec(dy_at, x.states)
    power, held, M = 2 * n + 15, 2 * n + 17, b[0].carried
    for i in range(x.wheels):
        wheel = wheel_of(x, i)
        d = m.body[wheel.body]
        dy[held + i] = wheel.rate
        dy[power + 1] -= wheel.rate * dot(turn(read_rows(d.R), read(wheel.axis)), read(d.w))
    if x.wrench == 0:
        return 0
    push, drift = mat(x._push, x.pushes, 6), (0.0, 0.0, 0.0)  # of the joints' motion alone
    if x.f > 0:
        drift = turn_back(read_rows(x.R), read(dy[2 * n + 4 :]))
        for j in range(n):
            drift = minus(drift, times(dq[j] / M, read(m.P[j])))
    for i in range(x.pushes):
        frame, w = pushed_of(x, i), push[i]
        e, body = lever(m, frame), frame.body
        v = add(drift, cross(read(m.body[0].w), e))
        dy[power] += dot(read(w), v) + dot(read(w[3:]), read(m.body[body].w))
        while body > 0:
            d = m.body[body]
            v = add(read(d.v), cross(read(d.u), e))
            dy[power] += dq[b[body].column] * dot(read(w), v)
            body = b[body].parent
    return 0


@part
def turning(x: Context, y: Numbers, dy: Numbers) -> None:
    """Compute the rate of the quaternion from w_0, equation (36)."""
    i = 2 * x.n
    e, n, w = read(y[i:]), y[i + 3], read(moving_of(x).body[0].w)
    put(dy[i:], times(0.5, add(times(n, w), cross(e, w))))
    dy[i + 3] = -0.5 * dot(e, w)
