"""Integration beside SciPy's integrators, closed forms, and the orders of the methods."""

import numpy as np
import pytest
from scipy.integrate import DOP853, solve_ivp

from spacearm.compiler import numbers, symbols
from spacearm.compiler.kernel import compiled
from spacearm.equations import integration, tableaus
from spacearm.equations.integration import CHANGES, COLLAPSED, FAILED, FINISHED, Problem, RunState
from spacearm.equations.linear_algebra import factors, substitute


def van_der_pol(xp, mu):
    return lambda _, y: xp.stack([y[1], mu * ((1.0 - y[0] ** 2) * y[1] - y[0])])


def kepler(xp, _=None):
    def rate(_, y):
        cube = (y[0] ** 2 + y[1] ** 2) ** 1.5
        return xp.stack([y[2], y[3], -y[0] / cube, -y[1] / cube])

    return rate


def driven(xp, stiffness):
    """y = cos(t) attracts all solutions: Prothero & Robinson's problem."""
    return lambda t, y: xp.stack([stiffness * (y[0] - xp.cos(t)) - xp.sin(t)])


def square_root(xp, _=None):
    """There is no rate beyond t = 1."""
    return lambda t, y: xp.stack([xp.sqrt(1.0 - t) + 0.0 * y[0]])


def kernel(problem, make, N, *, most=40, implicit=False, switches=0.0, pairs=0, lanes=None):
    """The integrator as machine code."""
    rtol, atol = problem

    def run(t, y, h, end, stiff, holdoff, eigenvalue, constant):
        start = RunState(t, y, h, 0.0, stiff, holdoff, eigenvalue)
        now, rows = integration.advance(
            symbols, make(symbols, constant), Problem(rtol, atol, N, pairs), start, end,
            most=most, implicit=implicit, switches=switches,
        )  # fmt: skip
        return *now, rows

    names = ("t", "h", "end", "stiff", "holdoff", "eigenvalue", "constant")
    return compiled(run, {"y": (N,)} | dict.fromkeys(names, ()), lanes=lanes)


def integrated(code, y0, end, constant=0.0, calls=10_000):
    """Run lanes to the end; return where they stand and the accepted steps of each."""
    m = len(y0)
    zero = np.zeros(m)
    state = {"t": zero, "y": y0, "h": zero, "stiff": zero, "holdoff": zero, "eigenvalue": zero}
    given = {"end": zero + end, "constant": zero + constant}
    kept = [[] for _ in range(m)]
    status = zero
    for _ in range(calls):
        *now, rows = code(state | given)
        now = RunState(*now)
        for i in np.flatnonzero(status == 0):
            mine = rows[i, : int(now.turns[i])]
            kept[i].append(mine[mine[:, 1] > 0.0])
        status = now.status
        state = {name: getattr(now, name) for name in state}
        if (status != 0).all():
            break
    return now, [np.concatenate(parts) for parts in kept]


def dense(rows, t):
    """The states at times."""
    i = np.clip(np.searchsorted(rows[:, 0], t, side="right") - 1, 0, None)
    return states(rows[i], t)


def states(rows, t):
    """The states at times within steps."""
    return np.array([integration.state_of(row, time) for row, time in zip(rows, t, strict=True)])


STARTS = np.array(
    [[1, 0, 0, 1.0], [1, 0, 0, 0.8], [1, 0, 0, 1.2], [0.5, 0.1, 0, 1.3], [1, 1, -1, 0]]
)


@pytest.mark.parametrize(("implicit", "rtol"), [(False, 1e-10), (True, 1e-7)])
def test_orbits_are_those_of_scipy(implicit, rtol):
    """Five lanes of different length, at their ends and between their steps."""
    code = kernel((rtol, 1e-2 * rtol), kepler, 4, implicit=implicit, pairs=2)
    now, steps = integrated(code, STARTS, 15.0)
    assert (now.status == FINISHED).all()
    assert (now.t == 15.0).all()
    t = np.linspace(0.0, 15.0, 333)
    for i, y0 in enumerate(STARTS):
        known = solve_ivp(
            kepler(np), (0, 15.0), y0, method="DOP853", rtol=1e-13, atol=1e-14, dense_output=True
        )
        np.testing.assert_allclose(now.y[i], known.y[:, -1], atol=3e4 * rtol)
        np.testing.assert_allclose(dense(steps[i], t), known.sol(t).T, atol=3e4 * rtol)
        assert steps[i][:, 1].sum() == pytest.approx(15.0, rel=1e-12)


def test_steps_are_those_of_scipy():
    """DOP853 with the same first step takes the same steps: tableau, error and control."""
    known = DOP853(lambda t, y: van_der_pol(np, 2.0)(t, y), 0.0, [2.0, 0.0], 30.0,
                   rtol=1e-9, atol=1e-11, first_step=0.01)  # fmt: skip
    times = [0.0]
    while known.status == "running":
        known.step()
        times.append(known.t)
    start = RunState(0.0, np.array([2.0, 0.0]), 0.01, 0.0, 0.0, 0.0, 0.0)
    now, rows = integration.advance(
        numbers, van_der_pol(numbers, 2.0), Problem(1e-9, 1e-11, 2), start, 30.0, most=1000
    )
    rows = rows[rows[:, 1] > 0.0]
    np.testing.assert_allclose(rows[:, 0], times[:-1], rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(now.y, known.y, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("implicit", [False, True])
def test_machine_code_does_what_numpy_does(implicit):
    code = kernel((1e-6, 1e-8), van_der_pol, 2, most=60, implicit=implicit)
    start = np.array([[2.0, 0.0]])
    now, steps = integrated(code, start, 4.0, constant=3.0)
    begin = RunState(0.0, start[0], 0.0, 0.0, 0.0, 0.0, 0.0)
    known, rows = integration.advance(
        numbers, van_der_pol(numbers, 3.0), Problem(1e-6, 1e-8, 2), begin, 4.0, most=1000,
        implicit=implicit,
    )  # fmt: skip
    assert len(steps[0]) == int((rows[:, 1] > 0).sum())
    np.testing.assert_allclose(now.y[0], known.y, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("stiffness", [-1e2, -1e4, -1e6])
def test_stiff_equations_take_few_implicit_steps(stiffness):
    code = kernel((1e-6, 1e-8), driven, 1, implicit=True)
    now, steps = integrated(code, np.array([[1.0], [2.0]]), 10.0, constant=stiffness)
    np.testing.assert_allclose(now.y[:, 0], np.cos(10.0), atol=1e-5)
    assert max(len(rows) for rows in steps) < 200
    t = np.linspace(1.0, 10.0, 200)
    np.testing.assert_allclose(dense(steps[0], t)[:, 0], np.cos(t), atol=1e-4)


def test_van_der_pol_s_oscillator_with_a_large_constant():
    code = kernel((1e-7, 1e-9), van_der_pol, 2, implicit=True)
    now, _ = integrated(code, np.array([[2.0, 0.0]]), 3.0, constant=1e3)
    known = solve_ivp(
        lambda t, y: van_der_pol(np, 1e3)(t, y), (0, 3.0), [2.0, 0.0], method="Radau",
        rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    np.testing.assert_allclose(now.y[0], known.y[:, -1], atol=1e-5)


def test_explicit_steps_that_stability_limits_ask_for_the_other_method():
    code = kernel((1e-6, 1e-8), driven, 1, switches=1.0)
    stiff, _ = integrated(code, np.array([[1.0]]), 10.0, constant=-1e4)
    assert stiff.status[0] == CHANGES
    assert stiff.eigenvalue[0] == pytest.approx(1e4, rel=0.2)
    soft, _ = integrated(code, np.array([[1.0]]), 10.0, constant=-1.0)
    assert soft.status[0] == FINISHED


def test_implicit_steps_that_are_dear_ask_for_the_other_method():
    code = kernel((1e-10, 1e-12), kepler, 4, implicit=True, switches=1.0)
    one = np.ones(1)
    given = {"t": 0 * one, "y": STARTS[:1], "h": 0 * one, "end": 20.0 * one, "stiff": 0 * one,
             "holdoff": 0 * one, "eigenvalue": one, "constant": one}  # fmt: skip
    assert code(given)[3][0] == CHANGES


@pytest.mark.parametrize("implicit", [False, True])
def test_where_there_is_no_rate_a_run_ends_at_the_last_state(implicit):
    code = kernel((1e-6, 1e-8), square_root, 1, implicit=implicit)
    now, _ = integrated(code, np.zeros((3, 1)), np.array([2.0, 0.5, 2.0]))
    assert now.status.tolist() == [FAILED, FINISHED, FAILED]
    assert 1.0 - 1e-6 < now.t[0] <= 1.0
    np.testing.assert_allclose(now.y[0], 2.0 / 3.0, atol=1e-5)
    at_once, _ = integrated(code, np.zeros((1, 1)), 2.0, calls=1)
    late = code({"t": [1.5], "y": [[0.0]], "h": [0.0], "end": [2.0], "stiff": [0.0],
                 "holdoff": [0.0], "eigenvalue": [0.0], "constant": [0.0]})  # fmt: skip
    assert late[3][0] == FAILED
    assert late[0][0] == 1.5
    assert at_once.t[0] > 0.0


def test_a_solution_that_grows_beyond_all_bounds_makes_the_step_collapse():
    code = kernel((1e-6, 1e-8), lambda *_: lambda _, y: y * y, 1)
    now, _ = integrated(code, np.array([[1.0]]), 2.0)
    assert now.status[0] in (COLLAPSED, FAILED)
    assert now.t[0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("implicit", "order"), [(False, 8), (True, 5)])
def test_the_orders_of_the_methods(implicit, order):
    """The error of one step falls by the order and one."""
    problem, y0 = Problem(1e6, 1e6, 4, 2), STARTS[3]
    take = integration.implicit_step if implicit else integration.explicit_step
    rate = kepler(numbers)
    steps = np.geomspace(0.02, 0.08, 5) if implicit else np.geomspace(0.1, 0.2, 5)
    errors = []
    for h in steps:
        known = solve_ivp(rate, (0, h), y0, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
        found = take(numbers, rate, problem, 0.0, y0, rate(0.0, y0), h)
        errors.append(np.abs(found.y - known).max())
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(order + 1, abs=0.8)


@pytest.mark.parametrize(("implicit", "order"), [(False, 7), (True, 4)])
def test_the_orders_of_dense_output(implicit, order):
    problem, y0 = Problem(1e6, 1e6, 4, 2), STARTS[3]
    take = integration.implicit_step if implicit else integration.explicit_step
    rate = kepler(numbers)
    steps = np.geomspace(0.02, 0.08, 5) if implicit else np.geomspace(0.1, 0.25, 5)
    errors = []
    for h in steps:
        step = take(numbers, rate, problem, 0.0, y0, rate(0.0, y0), h)
        row = np.concatenate(([0.0, h], y0, step.curves.ravel()))
        t = h * np.array([0.3, 0.6])
        found = states(np.tile(row, (2, 1)), t)
        fine = [solve_ivp(rate, (0, s), y0, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
                for s in t]  # fmt: skip
        errors.append(np.abs(found - fine).max())
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope > order + 0.2


def test_dense_output_joins_the_ends_of_steps():
    code = kernel((1e-8, 1e-10), kepler, 4)
    _, (rows,) = integrated(code, STARTS[:1], 10.0)
    ends = states(rows[:-1], rows[1:, 0])
    np.testing.assert_allclose(ends, rows[1:, 2:6], atol=1e-13)


def test_the_tableau_of_dop853_meets_its_conditions():
    """Sums of rows are times; quadrature conditions up to order 8; the errors are of order 5, 3."""
    for row, c in zip(tableaus.A[1:] + tableaus.A_DENSE, tableaus.C[1:12] + tableaus.C[13:],
                      strict=True):  # fmt: skip
        assert sum(row) == pytest.approx(c, abs=1e-13)
    b, c = np.array(tableaus.B), np.array(tableaus.C[:12])
    for k in range(1, 9):
        assert b @ c ** (k - 1) == pytest.approx(1.0 / k, abs=1e-13)
    for error, order in ((tableaus.E5, 5), (tableaus.E3, 3)):
        e = np.zeros(12)
        e[: len(error)] = error
        for k in range(1, order + 1):
            assert e @ c ** (k - 1) == pytest.approx(0.0, abs=1e-13)
        assert abs(e @ c**order) > 1e-6


def test_lines_of_numbers_are_solved_with_pivots():
    rng = np.random.default_rng(0)
    for n in (1, 2, 5, 8):
        for _ in range(20):
            A, b = rng.normal(size=(n, n)), rng.normal(size=n)
            A[0, 0] = 0.0 if n > 1 else 1.0
            x = substitute(numbers, factors(numbers, A), b)
            np.testing.assert_allclose(A @ x, b, atol=1e-10)
