"""C code, compiled and called."""

import ctypes
import shutil
import subprocess

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_chain, random_tree

import spacearm as sa
from spacearm.export.expressions import Tape
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.mechanics.momentum import momentum_derivatives

COMPILER = shutil.which("gcc")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
NUMBERS = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")

compiled_code = pytest.mark.skipif(COMPILER is None, reason="gcc is not installed")


class Library:
    """The functions of an arm, written, compiled and loaded."""

    def __init__(self, arm, folder, **options):
        header, source = sa.to_c(arm, folder, **options)
        shared = folder / "arm.so"
        command = [COMPILER, *STRICT, "-shared", "-fPIC", source, "-o", shared, "-lm"]
        subprocess.run(command, check=True)
        self.arm, self.name, self.library = arm, header.stem, ctypes.CDLL(str(shared))

    def call(self, name, q, *outputs, returns=None):
        function = getattr(self.library, f"{self.name}_{name}")
        function.restype = returns
        function.argtypes = [NUMBERS] * (1 + len(outputs))
        return function(np.array(q, dtype=float), *outputs)

    def jacobian(self, q):
        self.call("jacobian", q, J := np.empty((6 * len(self.arm.tips), self.arm.n)))
        return J

    def S(self, q):
        return self.call("singularity", q, returns=ctypes.c_double)

    def gradient(self, q):
        g = np.empty(self.arm.n)
        assert self.call("singularity_gradient", q, g, returns=ctypes.c_double) == self.S(q)
        return g

    def bounds(self, q):
        self.call("sigma_min", q, lower := np.empty(1), upper := np.empty(1))
        return lower[0], upper[0]


def exact_gradient(cfg, S):
    """Of det(D)^2 det(J J^T), from the derivatives of A and J* that the package has."""
    arm, J, dJ = cfg.arm, task_jacobian(cfg), task_jacobian_derivative(cfg)
    dA = momentum_derivatives(arm, cfg.full_at_origin)  # about the point where the CM was
    dD = dA[:, 3:, 3:6] - [pin.skew(r) @ cfg.A[:3, 3:6] for r in cfg.A[:3, 6:].T / arm.mass]
    inertia = np.einsum("ij,aji->a", np.linalg.inv(cfg.A[3:, 3:6]), dD)
    return 2 * S * (inertia + np.einsum("ij,aji->a", np.linalg.pinv(J), dJ))


def assert_bounds(library, q):
    J = task_jacobian(library.arm.at(q))
    sigma = np.linalg.svd(J, compute_uv=False)[-1]
    lower, upper = library.bounds(q)
    assert lower <= sigma <= upper
    rounding = 1e-11 * np.linalg.norm(J)
    assert upper - lower <= 1e-3 * sigma + rounding


@compiled_code
def test_the_planar_example(tmp_path):
    arm = sa.load("planar2")
    library, S = Library(arm, tmp_path), sa.singularity_polynomial(arm)
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (50, 2))
    factor = library.S(Q[0]) / S(Q[0])
    for q in Q:
        J = sa.generalized_jacobian(arm.at(q))
        np.testing.assert_allclose(library.jacobian(q), J, atol=1e-13)
        np.testing.assert_allclose(library.S(q), factor * S(q), atol=1e-12 * S.scale)
        np.testing.assert_allclose(library.gradient(q), factor * S.gradient(q), atol=1e-11)
        assert_bounds(library, q)
    lower, upper = library.bounds(sa.singular_set(arm).nearest([1.0, 0.5])[0])
    assert lower == 0.0
    assert upper < 1e-12


@compiled_code
@pytest.mark.parametrize("seed", range(3))
def test_random_redundant_arms(seed, tmp_path):
    kinds = ("revolute", "prismatic") if seed else ("revolute",)
    arm = load_text(random_chain(seed, 5, kinds), tip="tip", task="position")
    library, rng = Library(arm, tmp_path), np.random.default_rng(seed)
    for q in rng.uniform(-2, 2, (20, arm.n)):
        cfg = arm.at(q)
        J = sa.generalized_jacobian(cfg)
        np.testing.assert_allclose(library.jacobian(q), J, atol=1e-12 * np.abs(J).max())
        assert_bounds(library, q)
        wanted = exact_gradient(cfg, library.S(q))
        np.testing.assert_allclose(library.gradient(q), wanted, atol=1e-9 * np.abs(wanted).max())


@compiled_code
@pytest.mark.slow
@pytest.mark.parametrize("name", ["chaser7", "mda6"])
def test_arms_of_the_catalogue(name, tmp_path):
    arm = sa.load(name)
    library = Library(arm, tmp_path)
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (200, arm.n)):
        J = sa.generalized_jacobian(arm.at(q))
        np.testing.assert_allclose(library.jacobian(q), J, atol=1e-12 * np.abs(J).max())
        assert_bounds(library, q)
    if arm.n == arm.task.k:
        S = sa.singularity_polynomial(arm)
        factor = library.S(q) / S(q)
        size = np.abs(factor * S.gradient(q)).max()
        np.testing.assert_allclose(library.gradient(q), factor * S.gradient(q), atol=1e-9 * size)
        singular = sa.singular_set(arm).sample(20, np.random.default_rng(0))
        assert all(library.bounds(q)[1] < 1e-9 for q in singular)


@compiled_code
def test_two_tips(tmp_path):
    arm = load_text(random_tree(7, 5), tip=("link_2", "link_5"), task="x z", joints="all")
    library, q = Library(arm, tmp_path), np.linspace(-1, 1, arm.n)
    J = sa.generalized_jacobian(arm.at(q))
    np.testing.assert_allclose(library.jacobian(q), J, atol=1e-13)
    assert_bounds(library, q)


@compiled_code
def test_fewer_joints_than_rows(tmp_path):
    arm = load_text(random_tree(3, 3), tip="link_3", task=sa.Task("pose", length=1.0))
    assert arm.n < 6
    library, q = Library(arm, tmp_path, mode="attitude-controlled"), np.full(arm.n, 0.3)
    J = sa.generalized_jacobian(arm.at(q), mode="attitude-controlled")
    np.testing.assert_allclose(library.jacobian(q), J, atol=1e-13)
    assert library.S(q) == 0.0
    assert library.bounds(q) == (0.0, 0.0)


def test_names_are_those_of_c(tmp_path):
    text = random_chain(1, 2).replace('name="r"', 'name="7 */ arms"')
    header, source = sa.to_c(load_text(text, tip="tip", task="x y"), tmp_path)
    assert header.stem.isidentifier()
    assert header.stem.isascii()
    assert header.read_text().count("*/") == header.read_text().count("/*")
    assert "malloc" not in source.read_text()


def test_expressions_are_folded_and_kept_once():
    tape = Tape()
    x, y = tape.variable("x"), tape.variable("y")
    assert x * 0.0 == 0.0
    assert x * 1.0 is x
    assert x + 0.0 is x
    assert tape.negative(-x) is x
    assert x * y is y * x
    assert x + -y is x - y
    assert x - x == 0.0
    assert 0.0 - x is -x
    assert x / 2.0 is 0.5 * x


def test_derivatives_of_every_operation():
    tape = Tape()
    x, y = tape.variable("x"), tape.variable("y")
    f = (x * y - 2.0 * x.sin()) / (3.0 + y.cos()) + 1.0 / x - -y

    def value(e, at):
        if not hasattr(e, "operation"):
            return e
        a, b = (*(value(o, at) for o in e.operands), None, None)[:2]
        compute = {
            "var": lambda: at[e.name], "sin": lambda: np.sin(a), "cos": lambda: np.cos(a),
            "neg": lambda: -a, "add": lambda: a + b, "sub": lambda: a - b,
            "mul": lambda: a * b, "div": lambda: a / b,
        }  # fmt: skip
        return compute[e.operation]()

    here = {"x": 0.7 + 0.0j, "y": 1.3 + 0.0j}
    for e, name in zip(tape.gradient(f, [x, y]), "xy", strict=True):
        step = here | {name: here[name] + 1e-20j}  # complex step: no cancellation
        assert value(e, here).real == pytest.approx(value(f, step).imag / 1e-20, rel=1e-13)
