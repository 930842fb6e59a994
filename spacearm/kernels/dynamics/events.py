"""Events in compiled code: functions of time and state, and the search for their roots."""

from __future__ import annotations

import math

from spacearm.kernels.dynamics.calls import Entry, call, jump
from spacearm.kernels.dynamics.context import (
    ROOM,
    TARGET,
    Context,
    context_at,
    cube,
    event_of,
    found_of,
    law_of,
    mat,
    vec,
    wheel_of,
)
from spacearm.kernels.dynamics.decomposition import determinant
from spacearm.kernels.dynamics.laws import JOINT_PD
from spacearm.kernels.dynamics.methods.runge_kutta import explicit_state
from spacearm.kernels.dynamics.tips import arm_task, singular_distance
from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import part

DETERMINANT, SINGULAR, UPPER, LOWER, NEAR, FULL, FUNCTION = range(7)
"""Kinds: det J* (rows of length 1), distance to the singular set less `bound`, `bound` less
q_index, q_index less `bound`, distance to the target of law `index` less `bound`, capacity of wheel
`index` less what it holds, a function outside."""

LOOK = 0.05
"""Largest joint motion [rad] or [m] between two looks."""
ZERO = 1e-12
"""Values of an event function below this are zero at the start."""
SHARPNESS = 1e-14
"""Tolerance of the time of an event, as a share of the largest time."""
BISECTIONS = 200
SHARE = 0.2
"""Share of the distance to the singular set that the joints may move until it is computed anew."""
CLOSE = 10.0
"""How many times the joint motion of a step the set must be away for looks to be far apart."""
DOUBTFUL = 2.0
"""By what factor from the bound a distance to first order decides; nearer to the bound a function
outside, if there is one, computes the exact distance."""
MOST = 1.0
"""Distances to the singular set from this on are not told apart [rad]."""


@part
def values(x: Context, t: float, y: Numbers) -> None:
    """Compute the event functions in a state, as their `now`."""
    settled = False
    for i in range(x.events):
        event = event_of(x, i)
        if event.kind == SINGULAR and stands(x, y, event.now):
            continue
        if not settled and event.kind in (DETERMINANT, SINGULAR, NEAR, FUNCTION):
            jump(x.settle, x.here, t, y.ctypes.data, 0)
            settled = True
        jump(event.entry, x.here, t, y.ctypes.data, i)


@Entry
def bound(at: int, t: float, y_at: int, i: int) -> int:
    """Compute event function i: a limit of a joint or wheel, or a function outside."""
    x = context_at(at)
    event, y, out = event_of(x, i), vec(y_at, x.states), vec(x._goal, 1)
    if event.kind == UPPER:
        event.now = event.bound - y[event.index]
    elif event.kind == LOWER:
        event.now = y[event.index] - event.bound
    elif event.kind == FULL:
        event.now = wheel_of(x, event.index).capacity - abs(y[2 * x.n + 17 + event.index])
    else:
        call(event.call, t, x._seen, x._goal)
        event.now = out[0] - event.bound
    return 0


@Entry
def near(at: int, t: float, y_at: int, i: int) -> int:
    """Compute event function i: the distance to the target of a law."""
    x = context_at(at)
    event = event_of(x, i)
    event.now = distance(x, t, vec(y_at, x.states), event.index) - event.bound
    return 0


@part
def stands(x: Context, y: Numbers, clear: float) -> bool:
    """Tell whether joints moved much less than the last distance: they cannot have met the set."""
    there, radian, moved = vec(x._look_q, x.n), vec(x._radian, x.n), 0.0
    for j in range(x.n):
        moved += ((y[j] - there[j]) / radian[j]) ** 2
    return bool(x.looked and math.sqrt(moved) < SHARE * clear)


@Entry
def singular(at: int, t: float, y_at: int, i: int) -> int:
    """Compute event function i: the distance to the singular set."""
    x = context_at(at)
    event, y, there = event_of(x, i), vec(y_at, x.states), vec(x._look_q, x.n)
    away = singular_distance(x, t, y)
    if event.call and event.bound / DOUBTFUL < away < DOUBTFUL * event.bound:
        call(event.call, t, x._seen, x._goal)
        away = vec(x._goal, 1)[0]
    event.now = min(away, MOST) - event.bound
    x.looked = 1
    for j in range(x.n):
        there[j] = y[j]
    return 0


@Entry
def vanishing(at: int, _: float, __: int, i: int) -> int:
    """Compute event function i: the determinant of J*."""
    x = context_at(at)
    W = mat(x._look, x.k, x.n)
    arm_task(x, W)
    event_of(x, i).now = determinant(W)
    return 0


VALUES = {
    DETERMINANT: vanishing, SINGULAR: singular, UPPER: bound, LOWER: bound,
    NEAR: near, FULL: bound, FUNCTION: bound,
}  # fmt: skip
"""The functions of the kinds, in a state which the bodies have been placed in if need be."""


@part
def distance(x: Context, t: float, y: Numbers, i: int) -> float:
    """Compute the distance to the target of a law."""
    law, error, total = law_of(x, i), mat(x._error, 2, 6), 0.0
    if law.kind == JOINT_PD:
        goal = cube(x._of_law, x.laws, 5, x.size)[i, TARGET]
        if law.moving:
            call(law.moving, t, x._seen, x._goal)
            goal = vec(x._goal, x.size)
        for j in range(x.n):
            total += (goal[j] - y[j]) ** 2
        return math.sqrt(total)
    jump(x.aim, x.here, t, i, 0)
    for o in range(law.k):
        total += error[0, o] ** 2
    return math.sqrt(total)


@part
def state_at(x: Context, t: float) -> None:
    """Compute the state at a time within the last step, in `mid`."""
    y, mid = vec(x._y, x.states), vec(x._mid, x.states)
    if t == x.t:
        for o in range(x.states):
            mid[o] = y[o]
    elif x.cubic:
        jump(x.implicit_state, x.here, t, 0, 0)
    else:
        if x.dense == 0:
            jump(x.polynomial, x.here, 0.0, 0, 0)
        explicit_state(x, t, mid)


@part
def begin(x: Context) -> None:
    """Note the events that are already so at the start."""
    y = vec(x._y, x.states)
    values(x, x.t, y)
    for i in range(x.events):
        event = event_of(x, i)
        event.last = event.now
        if event.now < 0.0 if event.falling else abs(event.now) <= ZERO:
            note(x, x.t, i, y)
    sort(x, 0)


@Entry
def look(at: int, _: float, end_of_step: int, ___: int) -> int:
    """Note the events of the last step, in order, up to the first that ends the run.

    With end_of_step 0 note those that are already so at the start. Then write the outputs.
    """
    x = context_at(at)
    if end_of_step == 0:
        begin(x)
    elif x.events:
        search(x)
    output(x, found_of(x, x.stopped).t if x.stopped >= 0 else x.t)
    return 0


@part
def search(x: Context) -> None:
    """Search the last step for events."""
    y, before, mid = vec(x._y, x.states), vec(x._before, x.states), vec(x._mid, x.states)
    moved, start, look = 0.0, x.began, LOOK
    for j in range(x.n):
        moved = max(moved, abs(y[j] - before[j]))
    for i in range(x.events):
        event = event_of(x, i)
        if event.kind == SINGULAR and event.last < CLOSE * moved:
            look = 0.5 * event.bound  # a passage is two bounds wide
    pieces = 1 + int(moved / look)
    for piece in range(1, pieces + 1):
        end = x.t if piece == pieces else x.began + (x.t - x.began) * piece / pieces
        state_at(x, end)
        values(x, end, mid)
        first = x.happened
        for i in range(x.events):
            event = event_of(x, i)
            last, now = event.last, event.now
            crossed = (last > 0.0 and now <= 0.0) or (last < 0.0 and now >= 0.0)
            happened = last >= 0.0 and now < 0.0 if event.falling else crossed
            if happened and x.happened < ROOM:
                at = root(x, i, start, end, last, now)
                event.now = now
                state_at(x, at)
                note(x, at, i, mid)
            event.last = now
        sort(x, first)
        if x.stopped >= 0:
            return
        start = end


@part
def sort(x: Context, first: int) -> None:
    """Put the events from `first` on in order; drop those after one that ends the run."""
    q = mat(x._q_found, ROOM, x.n)
    for i in range(first + 1, x.happened):
        j = i
        while j > first and found_of(x, j).t < found_of(x, j - 1).t:
            one, other = found_of(x, j), found_of(x, j - 1)
            one.t, other.t = other.t, one.t
            one.which, other.which = other.which, one.which
            for o in range(x.n):
                q[j, o], q[j - 1, o] = q[j - 1, o], q[j, o]
            j -= 1
    for i in range(first, x.happened):
        if event_of(x, found_of(x, i).which).stops:
            x.stopped, x.happened = i, i + 1
            return


@part
def note(x: Context, t: float, which: int, y: Numbers) -> None:
    """Keep an event."""
    event, q = found_of(x, x.happened), mat(x._q_found, ROOM, x.n)
    event.t, event.which = t, which
    for j in range(x.n):
        q[x.happened, j] = y[j]
    x.happened += 1


@part
def root(x: Context, i: int, a: float, b: float, at_a: float, at_b: float) -> float:
    """Return the time in [a, b] at which an event function crosses zero, by secants.

    A secant that does not halve the bracket is followed by a bisection.
    """
    tolerance, event = SHARPNESS * abs(b), event_of(x, i)
    for _ in range(BISECTIONS):
        width = b - a
        for secant in (True, False):
            if b - a <= tolerance or at_b == 0.0:
                return b
            t = (a * at_b - b * at_a) / (at_b - at_a) if secant else 0.5 * (a + b)
            t = min(max(t, a + 0.5 * tolerance), b - 0.5 * tolerance)
            state_at(x, t)
            jump(x.settle, x.here, t, x._mid, 0)
            jump(event.entry, x.here, t, x._mid, i)
            at = event.now
            if at != 0.0 and (at > 0.0) == (at_a > 0.0):
                a, at_a = t, at
            else:
                b, at_b = t, at
            if b - a <= 0.5 * width:
                break
    return b


@part
def output(x: Context, end: float) -> None:
    """Write the states at the output times of the last step up to `end`."""
    t, Y = vec(x._t_out, x.outputs), mat(x._y_out, x.outputs, x.states)
    mid = vec(x._mid, x.states)
    while x.written < x.outputs and t[x.written] <= end:
        state_at(x, t[x.written])
        for o in range(x.states):
            Y[x.written, o] = mid[o]
        x.written += 1
