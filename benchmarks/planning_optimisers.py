"""The planner's curves by two optimisers: scipy's SLSQP, which it uses, and IPOPT.

    pip install casadi
    python benchmarks/planning_optimisers.py [FAMILY [NUMBER]]

Problems of `benchmarks/planning.py` are planned, and every curve that the planner has optimised on
the way is optimised by both from the same guess, with the same constraints, exact gradients and
number of iterations; IPOPT by casadi, with its limited-memory Hessian and a like tolerance.
"""

from __future__ import annotations

import sys
import time
import warnings

import casadi
import numpy as np
from planning import UndrawnError, draw

import spacearm as sa
from spacearm.planning.guesses import CLOSE
from spacearm.planning.optimiser import CurveOptimiser

NUMBER, TIMEOUT = 20, 10.0
SLACK = 1e-4
"""Largest violation of a margin at which a curve counts as found [rad]."""
OPTIONS = {
    "print_time": False,
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "hessian_approximation": "limited-memory",
        "tol": 1e-3,
        "constr_viol_tol": CLOSE,
        "acceptable_tol": 1e-2,
    },
}


class Matrix(casadi.Callback):
    """A matrix that is computed from x, the first of its arguments, for casadi.

    Args:
        name: Name of the function.
        sizes: Sizes of its arguments.
        shape: Shape of the matrix.
        value: The matrix at x.
        slope: Its derivative at x, that of a column.
    """

    def __init__(self, name, sizes, shape, value, slope=None):
        super().__init__()
        self.sizes, self.shape, self.value, self.slope = sizes, shape, value, slope
        self.construct(name, {})

    def get_n_in(self):
        """Return the number of arguments."""
        return len(self.sizes)

    def get_sparsity_in(self, i):
        """Return the form of an argument."""
        return casadi.Sparsity.dense(self.sizes[i], 1)

    def get_sparsity_out(self, _):
        """Return the form of the matrix."""
        return casadi.Sparsity.dense(*self.shape)

    def eval(self, x):
        """Return the matrix."""
        return [self.value(np.array(x[0])[:, 0])]

    def has_jacobian(self):
        """Whether the derivative is known."""
        return self.slope is not None

    def get_jacobian(self, name, *_):
        """Return the derivative, a function of x and the matrix."""
        rows, size = self.shape[0], self.sizes[0]
        self.jacobian = Matrix(name, (size, rows), (rows, size), self.slope)
        return self.jacobian


def by_ipopt(problem: CurveOptimiser, x: np.ndarray, iterations: int) -> np.ndarray:
    """Return the curve that IPOPT finds from a guess."""
    first = problem.values(x)
    equal, rows = len(first.end), len(first.end) + len(first.margins)
    cost = Matrix(
        "cost", (x.size,), (1, 1), lambda x: problem.cost(x)[0], lambda x: problem.cost(x)[1][None]
    )
    constraints = Matrix(
        "constraints", (x.size,), (rows, 1),
        lambda x: np.concatenate((problem.values(x).end, problem.values(x).margins)),
        lambda x: np.vstack((problem.values(x).d_end, problem.values(x).d_margins)),
    )  # fmt: skip
    symbol = casadi.MX.sym("x", x.size)
    program = {"x": symbol, "f": cost(symbol), "g": constraints(symbol)}
    options = {**OPTIONS, "ipopt": {**OPTIONS["ipopt"], "max_iter": iterations}}
    solve = casadi.nlpsol("solve", "ipopt", program, options)
    most = np.where(np.arange(rows) < equal, 0.0, np.inf)
    return np.array(solve(x0=x, lbg=np.zeros(rows), ubg=most)["x"])[:, 0]


def found(problem: CurveOptimiser, x: np.ndarray) -> bool:
    """Whether a curve arrives and keeps its margins."""
    at = problem.values(x)
    return bool(np.abs(at.end).max() < CLOSE and at.margins.min() > -SLACK)


def curves(family: str, number: int) -> list[tuple[CurveOptimiser, np.ndarray, int]]:
    """Return what the planner has optimised on problems of a family."""
    asked, own = [], CurveOptimiser.solve

    def noted(self, x, iterations=60):
        asked.append((self, x.copy(), iterations))
        return own(self, x, iterations)

    CurveOptimiser.solve = noted
    for i in range(number):
        try:
            start, goal, _, _, more = draw(family, i)
            limits = not family.startswith("planar")
            sa.plan(
                start,
                goal,
                constraints=sa.Constraints(limits=limits),
                search=sa.Search(timeout=TIMEOUT),
                **more,
            )
        except (UndrawnError, sa.NoSolutionError):
            continue
    CurveOptimiser.solve = own
    return asked


def report(family: str, number: int) -> None:
    """Print how often each optimiser finds a curve, how fast, and how long it is."""
    asked = curves(family, number)
    outcomes = {
        "SLSQP": lambda problem, x, iterations: problem.solve(x, iterations),
        "IPOPT": by_ipopt,
    }
    costs = {}
    for name, solve in outcomes.items():
        seconds, cost = [], []
        for problem, x, iterations in asked:
            problem._check_time = lambda: None
            problem._last = None
            began = time.perf_counter()
            result = solve(problem, x, iterations)
            seconds.append(time.perf_counter() - began)
            cost.append(problem.cost(result)[0] ** 0.5 if found(problem, result) else np.nan)
        costs[name] = np.array(cost)
        print(
            f"{family}, {name}: {np.isfinite(cost).sum()} of {len(asked)} curves found, median "
            f"{1e3 * np.median(seconds):.0f} ms, {sum(seconds):.1f} s in all"
        )
    both = np.isfinite(costs["SLSQP"]) & np.isfinite(costs["IPOPT"])
    if both.any():
        ratio = np.median(costs["IPOPT"][both] / costs["SLSQP"][both])
        print(f"  where both find one, IPOPT's is {ratio:.3f} times as long in the median")


if __name__ == "__main__":
    warnings.simplefilter("ignore", sa.ModelWarning)
    chosen, count = (*sys.argv[1:], "", "")[:2]
    for name in [chosen] if chosen else ["planar2", "mda6", "chaser7 pose", "random 6R"]:
        report(name, int(count or NUMBER))
