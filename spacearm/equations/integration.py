"""Adaptive integration of dy/dt = f(t, y): DOP853, and Rodas5P where the equations are stiff.

Steps are plain functions of arrays, run by NumPy or traced. `advance` takes many of them and keeps
each as a row, [beginning, length, state (N), coefficients (7, N)]; lengths of rejected steps are 0.
`state_of` evaluates such rows: outputs and events are looked for afterwards. A rate that is not a
number means that there is none; steps are then made shorter.

Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, 2nd ed. (1993), section II.10,
with its control of the step and test for stiffness; Hairer & Wanner, II, 2nd ed. (1996), sections
IV.2 and IV.7; Steinebach, BIT Numer. Math. 63, 27 (2023), DOI 10.1007/s10543-023-00967-x.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from spacearm.equations import tableaus as of
from spacearm.equations.linear_algebra import factors, substitute

#: Coefficients of the dense output of a step, for each component.
CURVES = 7
#: Status of a run: it goes on, is at its end, has no rate, takes steps that vanish, or wants the
#: other method.
RUNNING, FINISHED, FAILED, COLLAPSED, CHANGES = range(5)
#: The next step is this share of the one that would just do, between these times the last.
SAFETY, LEAST, MOST = 0.9, 0.2, 10.0
#: Step times eigenvalue beyond which DOP853 is unstable; steps near it look stiff.
STABLE = 6.1
#: Steps that look stiff, nearly in a row, until DOP853 gives up; steps of Rodas5P that DOP853 could
#: have taken as cheaply until it comes back.
STIFF, TRIAL = 15, 20
#: Steps of DOP853 after its return until stiffness counts again.
HOLDOFF = 500
ROUNDING = 2.0**-52
#: Components up to this are differentiated as if they were of this size.
SMALL = 1e-3

#: Called as rate(t, y), returns dy (N,).
Rate = Callable[[Any, Any], Any]


class Problem(NamedTuple):
    """What the methods know of the equations.

    Attributes:
        rtol: Relative tolerance of each step.
        atol: Absolute one.
        counted: Number of components that errors are averaged over.
        pairs: Number n of leading components whose rates are the n components after them.
        coupled: Number of leading components that rates depend on; N if None.
        plain: The rate as it is traced again to share its parts; as it is called if None.
    """

    rtol: Any
    atol: Any
    counted: int
    pairs: int = 0
    coupled: int | None = None
    plain: Any = None


class Step(NamedTuple):
    """A step that is tried.

    Attributes:
        y: (N,) the state at its end.
        dy: (N,) the rate there.
        error: Its error as a share of what is allowed; not a number where there is no rate.
        curves: (7, N) coefficients of its dense output; see `state_of`.
        eigenvalue: Estimate of the largest eigenvalue, 0 where there is none [1/s].
    """

    y: Any
    dy: Any
    error: Any
    curves: Any
    eigenvalue: Any


class RunState(NamedTuple):
    """Where a run stands.

    Attributes:
        t: Time.
        y: (N,) state.
        h: Length of the next step; 0 if none was chosen.
        status: One of RUNNING, FINISHED, FAILED, COLLAPSED, CHANGES.
        stiff: Steps that count for a change of the method.
        holdoff: Steps until stiffness counts.
        eigenvalue: The one that limited steps of DOP853 last [1/s].
        turns: Number of rows that were written.
    """

    t: Any
    y: Any
    h: Any
    status: Any
    stiff: Any
    holdoff: Any
    eigenvalue: Any
    turns: Any = 0.0


def weighted_sum(weights: Sequence[float], stages: Sequence[Any]) -> Any:
    """Compute a weighted sum of stages."""
    pairs = zip(weights, stages, strict=False)
    return sum((weight * stage for weight, stage in pairs if weight != 0.0), 0.0)


def _norm(xp: Any, problem: Problem, y: Any, other: Any, error: Any) -> Any:
    """Compute the sum of squares of an error as shares of what is allowed."""
    scale = problem.atol + problem.rtol * xp.maximum(xp.absolute(y), xp.absolute(other))
    return ((error / scale) ** 2).sum()


def explicit_step(
    xp: Any, rate: Rate, problem: Problem, t: Any, y: Any, dy: Any, h: Any, dense: bool = True
) -> Step:
    """Take a step of DOP853 from a state y (N,) with the rate dy."""
    K = [dy]
    for a, c in zip(of.A[1:], of.C[1:], strict=False):
        last = y + h * weighted_sum(a, K)
        K.append(rate(t + c * h, last))
    end = y + h * weighted_sum(of.B, K)
    K.append(rate(t + h, end))
    fifth = _norm(xp, problem, y, end, weighted_sum(of.E5, K))
    both = fifth + 0.01 * _norm(xp, problem, y, end, weighted_sum(of.E3, K))
    some = xp.where(both > 0.0, both, 1.0)
    error = h * fifth / xp.sqrt(some * problem.counted)
    changed, apart = ((K[12] - K[11]) ** 2).sum(), ((end - last) ** 2).sum()
    eigenvalue = xp.sqrt(changed / xp.where(apart > 0.0, apart, np.inf))
    curves = [end - y]
    if dense:
        for a, c in zip(of.A_DENSE, of.C[13:], strict=True):
            K.append(rate(t + c * h, y + h * weighted_sum(a, K)))
        curves += [h * dy - curves[0], 2.0 * curves[0] - h * (K[12] + dy)]
        curves += [h * weighted_sum(d, K) for d in of.D]
    else:
        curves += [0.0 * y] * (CURVES - 1)
    error = error + 0.0 * K[12].sum()  # no number where there is no rate at the end
    return Step(end, K[12], error, xp.stack(curves), eigenvalue)


def _derivatives(xp: Any, rate: Rate, problem: Problem, t: Any, y: Any, dy: Any) -> tuple[Any, Any]:
    """Compute the Jacobian (N - n, m), without pairs, and the slope (N,) by time, by differences.

    What depends on the first n components alone is computed once for all columns after theirs.
    """
    n, m = problem.pairs, len(y) if problem.coupled is None else problem.coupled
    x = xp.concatenate([xp.stack([t]), y[:m]])
    size = np.sqrt(ROUNDING) * xp.maximum(xp.absolute(x), np.array([1.0] + m * [SMALL]))

    def column(of: Rate, move: Any) -> Any:
        there = x + move
        found = of(there[0], xp.concatenate([there[1:], y[m:]]))
        return (found - dy) / (there - x).sum()  # as it was rounded

    def turn(_: Any, direction: Any, columns: Any) -> Any:
        move = size * xp.concatenate([direction[:1], np.zeros(n), direction[1:]])
        following = xp.concatenate([direction[-1:], direction[:-1]])
        return following, xp.concatenate([columns[1:], column(problem.plain or rate, move)[None]])

    count = 1 + m - n
    _, rest = xp.repeat(count, turn, np.eye(count)[0], np.zeros((count, len(y))))
    first = [column(rate, size * np.eye(1 + m)[1 + j])[n:] for j in range(n)]
    return xp.stack([*first, *rest[1:, n:]]).T, rest[0]


def implicit_step(
    xp: Any, rate: Rate, problem: Problem, t: Any, y: Any, dy: Any, h: Any, _: bool = True
) -> Step:
    """Take a step of Rodas5P from a state y (N,) with the rate dy; derivatives by differences.

    What its dense output leaves of the equations in the middle counts as an error, too.
    """
    N, n = len(y), problem.pairs
    m = N if problem.coupled is None else problem.coupled
    shift = 1.0 / (of.GAMMA * h)
    J, slope = _derivatives(xp, rate, problem, t, y, dy)
    A = shift * np.eye(m - n) - J[: m - n, n:]
    if n:
        A = A - xp.concatenate([J[: m - n, :n] / shift, np.zeros((m - n, m - 2 * n))], axis=1)
    LU = factors(xp, A)

    def solved(b: Any) -> Any:
        """Solve (shift 1 - J) z = b."""
        right = b[n:m] + (J[: m - n, :n] @ b[:n]) / shift if n else b[:m]
        z = substitute(xp, LU, right)
        if n:
            z = xp.concatenate([(b[:n] + z[:n]) / shift, z])
        return xp.concatenate([z, (b[m:] + J[m - n :] @ z) / shift]) if m < N else z

    U: list[Any] = []
    at, f = y, dy
    for i in range(8):
        if i > 0:
            at = at + U[-1] if i > 5 else y + weighted_sum(of.SHARES[i], U)
            f = rate(t + of.TIMES[i] * h, at)
        right = f + h * of.SLOPES[i] * slope
        U.append(solved(right + weighted_sum(of.COUPLINGS[i], U) / h if i else right))
    end = at + U[7]
    k = [weighted_sum(curve, U) for curve in of.CURVES]
    middle = 0.5 * (y + end + 0.5 * (k[0] + 0.5 * (k[1] + 0.5 * k[2])))
    slope = (end - y + 0.25 * (k[1] + k[2])) / h
    between = solved(rate(t + 0.5 * h, middle) - slope)  # how far the dense output is off
    squares = _norm(xp, problem, y, end, U[7]) + _norm(xp, problem, y, end, between)
    after = rate(t + h, end)
    error = xp.sqrt(squares / problem.counted) + 0.0 * after.sum()
    none = 0.0 * y
    curves = [end - y, k[0], k[1] + k[2], -k[2], none, none, none]
    return Step(end, after, error, xp.stack(curves), 0.0 * h)


def state_of(row: Any, t: Any) -> Any:
    """Evaluate the dense output of a step: the state (N,) at a time.

    Args:
        row: (2 + 8 N,) the step, as `advance` keeps it.
        t: The time.
    """
    y, *curves = row[2:].reshape(1 + CURVES, -1)
    share = (t - row[0]) / row[1]
    found = share * curves[-1]
    for i in range(1, CURVES):
        found = (found + curves[CURVES - 1 - i]) * (share if i % 2 == 0 else 1.0 - share)
    return found + y


def first_step(xp: Any, rate: Rate, problem: Problem, t: Any, y: Any, dy: Any, end: Any) -> Any:
    """Choose the first step: Hairer, Norsett & Wanner I, section II.4."""
    zero = 0.0 * y
    d0 = xp.sqrt(_norm(xp, problem, y, zero, y) / problem.counted)
    d1 = xp.sqrt(_norm(xp, problem, y, zero, dy) / problem.counted)
    small = xp.logical_or(d0 < 1e-5, d1 < 1e-5)
    h = xp.where(small, 1e-6, 0.01 * d0 / xp.where(small, 1.0, d1))
    h = xp.minimum(h, end - t)
    other = rate(t + h, y + h * dy)
    d2 = xp.sqrt(_norm(xp, problem, y, zero, other - dy) / problem.counted) / h
    d2 = xp.where(d2 <= d2, d2, 0.0)
    most = xp.maximum(d1, d2)
    flat = most <= 1e-15
    next_one = xp.sqrt(xp.sqrt(xp.sqrt(0.01 / xp.where(flat, 1.0, most))))
    return xp.minimum(100.0 * h, xp.where(flat, xp.maximum(1e-6, 1e-3 * h), next_one))


def advance(
    xp: Any, rate: Rate, problem: Problem, start: RunState, end: Any, *, most: int,
    implicit: bool = False, switches: Any = 0.0, dense: bool = True,
) -> tuple[RunState, Any]:  # fmt: skip
    """Take up to `most` steps, rejected ones included, towards the time `end`.

    Args:
        xp: The array library.
        rate: The rate.
        problem: Tolerances and structure.
        start: Where the run stands; its status is not looked at.
        end: When to stop.
        most: Number of steps.
        implicit: Whether Rodas5P takes them.
        switches: 1 if the method may change, else 0.
        dense: Whether states within steps are wanted; without, only those at their ends are right.

    Returns:
        Where the run stands now, and (most, 2 + 8 N) rows of the steps, as many as it has turns.
    """
    problem = problem._replace(plain=rate)
    rate = xp.procedure(rate)
    take, order = (implicit_step, 5.0) if implicit else (explicit_step, 8.0)
    m = len(start.y) if problem.coupled is None else problem.coupled
    worth = (m + 12) / 14  # steps of DOP853 that cost as much as one of Rodas5P
    dy = rate(start.t, start.y)
    total = dy.sum()
    status = xp.where(start.t < end, 0.0, float(FINISHED))
    status = xp.where(xp.less_equal(total, total), status, float(FAILED))
    first = first_step(xp, rate, problem, start.t, start.y, dy, end)
    h = xp.where(start.h > 0.0, start.h, first)

    def step(t: Any, y: Any, dy: Any, h: Any, ceiling: Any, status: Any, stiff: Any, holdoff: Any,
             eigenvalue: Any, turns: Any) -> Any:  # fmt: skip
        goes, last = status <= 0.0, end - t <= h
        taken = xp.minimum(h, end - t)
        found = take(xp, rate, problem, t, y, dy, taken, dense)
        good = found.error < 1.0
        known = found.error <= found.error
        positive = xp.maximum(xp.where(known, found.error, 1.0), 1e-30)
        factor = xp.maximum(SAFETY * positive ** (-1.0 / order), LEAST)
        factor = xp.where(known, xp.minimum(factor, ceiling), LEAST)
        least = 10.0 * ROUNDING * xp.absolute(t) + 1e-300
        next_h = taken * factor
        next_h = xp.where(xp.logical_and(good, last), xp.maximum(next_h, h), next_h)
        lost = xp.logical_and(xp.logical_not(known), taken < 1e3 * least)
        vanished = xp.logical_and(xp.logical_not(good), next_h < least)
        status = xp.where(xp.logical_and(good, last), float(FINISHED), status)
        status = xp.where(vanished, float(COLLAPSED), status)
        status = xp.where(lost, float(FAILED), status)
        if implicit:
            dear = xp.logical_and(eigenvalue > 0.0, h * eigenvalue > worth * STABLE)
            cheap = xp.logical_and(good, xp.logical_not(dear))
            now = xp.where(cheap, stiff + 1.0, xp.where(good, 0.0, stiff))
            changes = now >= TRIAL
        else:
            limited = taken * found.eigenvalue > STABLE
            now = xp.where(limited, stiff + 1.0, xp.maximum(stiff - 0.5, 0.0))
            now = xp.where(xp.logical_and(good, holdoff <= 0.0), now, stiff)
            eigenvalue = xp.where(xp.logical_and(good, limited), found.eigenvalue, eigenvalue)
            holdoff = xp.where(good, xp.maximum(holdoff - 1.0, 0.0), holdoff)
            changes = now >= STIFF
        changes = xp.logical_and(changes, switches > 0.0)
        status = xp.where(xp.logical_and(changes, status <= 0.0), float(CHANGES), status)
        length = xp.where(xp.logical_and(good, goes), taken, 0.0)
        kept = xp.concatenate([xp.stack([t, length]), y, found.curves.reshape(-1)])
        t = xp.where(good, xp.where(last, end, t + taken), t)
        y = xp.where(good, found.y, y)
        dy = xp.where(good, found.dy, dy)
        ceiling = xp.where(good, MOST, 1.0)
        more = status <= 0.0
        return t, y, dy, next_h, ceiling, status, now, holdoff, eigenvalue, turns + 1.0, more, kept

    zero = 0.0 * start.t
    begun = (start.t, start.y, dy, h, zero + MOST, status, start.stiff + zero, start.holdoff + zero,
             start.eigenvalue + zero, zero)  # fmt: skip
    *found, rows = xp.while_any(step, *begun, most=most, keep=True)
    now = [xp.where(status <= 0.0, *both) for both in zip(found, begun, strict=True)]
    return RunState(now[0], now[1], now[3], *now[5:]), rows
