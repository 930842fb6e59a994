"""C code, compiled and called."""

import ctypes
import subprocess
import sys
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chosen, load_text, random_chain, random_tree
from helpers.c_compiler import COMPILER, NUMBERS, STRICT, compiled_code

import spacearm as sa
from spacearm.mechanics.arm_kernels import parameters_of
from spacearm.mechanics.distance import rank_distances_of
from spacearm.mechanics.jacobian import matrix_derivatives, task_jacobian, task_jacobian_derivative
from spacearm.model.joints import joint_scales


class Library:
    """The functions of an arm, written, compiled and loaded."""

    def __init__(self, arm, folder, **options):
        header, source = sa.to_c(arm, folder, **options)
        shared = folder / "arm.so"
        command = [COMPILER, *STRICT, "-shared", "-fPIC", source, "-o", shared, "-lm"]
        subprocess.run(command, check=True)
        self.arm, self.name, self.library = arm, header.stem, ctypes.CDLL(str(shared))

    def call(self, name, *arrays, returns=None):
        function = getattr(self.library, f"{self.name}_{name}")
        function.restype = returns
        function.argtypes = [NUMBERS] * len(arrays)
        return function(*(np.asarray(array, dtype=float) for array in arrays))

    def jacobian(self, q):
        self.call("jacobian", q, J := np.empty((6 * len(self.arm.tips), self.arm.n)))
        return J

    def S(self, q):
        return self.call("singularity", q, returns=ctypes.c_double)

    def gradient(self, q):
        g = np.empty(self.arm.n)
        assert self.call("singularity_gradient", q, g, returns=ctypes.c_double) == self.S(q)
        return g

    def matrix(self, name, rows, *given):
        self.call(name, *given, out := np.empty((rows, self.arm.n)))
        return out

    def assert_dynamics(self, q, mode="free-floating"):
        """Momentum, connection and accelerations against those of the package."""
        cfg, (dq, tau) = self.arm.at(q), np.random.default_rng(1).normal(size=(2, self.arm.n))
        wanted = cfg.A[:, 6:]
        found = self.matrix("momentum", 6, q)
        np.testing.assert_allclose(found, wanted, atol=1e-12 * np.abs(wanted).max())
        if mode == "free-floating":
            wanted = -np.linalg.solve(cfg.A[3:, 3:6], cfg.A[3:, 6:])
            found = self.matrix("connection", 3, q)
            np.testing.assert_allclose(found, wanted, atol=1e-12 * np.abs(wanted).max())
        wanted = sa.forward_dynamics(cfg, dq, tau, mode=mode).ddq
        rounding = 1e-12 + 1e-15 * np.linalg.cond(sa.generalized_inertia(cfg, mode=mode))
        found = self.matrix("forward_dynamics", 1, q, dq, tau)[0]
        np.testing.assert_allclose(found, wanted, atol=rounding * np.abs(wanted).max())

    def assert_distance(self, q, mode="free-floating"):
        """The distance to first order and the way out against those by Pinocchio."""
        cfg = self.arm.at(q)
        J, dJ = task_jacobian(cfg, mode=mode), task_jacobian_derivative(cfg, mode=mode)
        wanted = rank_distances_of(self.arm, J, dJ)
        away = np.empty(self.arm.n)
        distance = self.call("distance", q, away, returns=ctypes.c_double)
        assert distance == pytest.approx(wanted.distances[-1], rel=1e-8, abs=1e-12)
        np.testing.assert_allclose(away, joint_scales(self.arm) * wanted.rows[0], atol=1e-8)

    def bounds(self, q):
        self.call("sigma_min", q, lower := np.empty(1), upper := np.empty(1))
        return lower[0], upper[0]


def exact_gradient(cfg, S):
    """Of det(D)^2 det(J J^T), from the derivatives of A and J* that the package has."""
    arm, J, dJ = cfg.arm, task_jacobian(cfg), task_jacobian_derivative(cfg)
    dA, _ = matrix_derivatives(arm, cfg.full_at_origin)  # about the point where the CM was
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
        library.assert_dynamics(q)
        library.assert_distance(q)
    on_it = sa.singular_set(arm).nearest([1.0, 0.5]).q
    lower, upper = library.bounds(on_it)
    assert lower == 0.0
    assert upper < 1e-12
    assert library.call("distance", on_it, np.empty(2), returns=ctypes.c_double) < 1e-12


@compiled_code
@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 2))])
def test_random_redundant_arms(seed, tmp_path):
    kinds = ("revolute", "prismatic") if seed else ("revolute",)
    arm = load_text(random_chain(seed, 5, kinds), tip="tip", task="position")
    library, rng = Library(arm, tmp_path), np.random.default_rng(seed)
    for q in rng.uniform(-2, 2, (20, arm.n)):
        cfg = arm.at(q)
        J = sa.generalized_jacobian(cfg)
        np.testing.assert_allclose(library.jacobian(q), J, atol=1e-12 * np.abs(J).max())
        assert_bounds(library, q)
        library.assert_dynamics(q)
        library.assert_distance(q)
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
        library.assert_dynamics(q)
        library.assert_distance(q)
    if arm.n == arm.task.k:
        S = sa.singularity_polynomial(arm)
        factor = library.S(q) / S(q)
        size = np.abs(factor * S.gradient(q)).max()
        np.testing.assert_allclose(library.gradient(q), factor * S.gradient(q), atol=1e-9 * size)
        singular = sa.singular_set(arm).sample(20, np.random.default_rng(0))
        assert all(library.bounds(q)[1] < 1e-9 for q in singular)


@compiled_code
def test_two_tips(tmp_path):
    arm = load_text(random_tree(chosen(7), 5), tip=("link_2", "link_5"), task="x z", joints="all")
    library, q = Library(arm, tmp_path), np.linspace(-1, 1, arm.n)
    J = sa.generalized_jacobian(arm.at(q))
    np.testing.assert_allclose(library.jacobian(q), J, atol=1e-13)
    assert_bounds(library, q)
    library.assert_dynamics(q)
    library.assert_distance(q)


@compiled_code
def test_fewer_joints_than_rows(tmp_path):
    arm = load_text(random_tree(3, 3), tip="link_3", task=sa.Task("pose", length=1.0))
    assert arm.n < 6
    library, q = Library(arm, tmp_path, mode="attitude-controlled"), np.full(arm.n, 0.3)
    J = sa.generalized_jacobian(arm.at(q), mode="attitude-controlled")
    np.testing.assert_allclose(library.jacobian(q), J, atol=1e-13)
    library.assert_dynamics(q, mode="attitude-controlled")
    library.assert_distance(q, mode="attitude-controlled")
    assert library.S(q) == 0.0
    assert library.bounds(q) == (0.0, 0.0)


def structure(numbers, names):
    """The struct of the parameters, filled."""
    arrays = {name: np.ascontiguousarray(getattr(numbers, name)) for name in names}
    fields = [(name, ctypes.c_double * array.size) for name, array in arrays.items()]
    made = type("Struct", (ctypes.Structure,), {"_fields_": fields})
    return made(
        *(field(*array.ravel()) for (_, field), array in zip(fields, arrays.values(), strict=True))
    )


@compiled_code
@pytest.mark.parametrize(
    ("name", "task"),
    [("planar2", "x y"), pytest.param("chaser7", "position", marks=pytest.mark.slow)],
)
def test_masses_and_mounts_in_a_struct(name, task, tmp_path):
    """S, J* and the gradient by the parameters, against arms with other masses and mounts."""
    arm = sa.load(name, task=task)
    names = ("masses", "joint_positions")
    (tmp_path / "plain").mkdir()
    plain = Library(arm, tmp_path / "plain")
    library, q = Library(arm, tmp_path, parameters=names), np.linspace(-0.7, 0.9, arm.n)
    nominal = structure(parameters_of(arm), names)
    own = bytes(type(nominal).in_dll(library.library, f"{library.name}_nominal"))
    assert own == bytes(nominal)

    def S(p, gradient=None):
        which = "_by_parameters" if gradient else ""
        function = getattr(library.library, f"{library.name}_singularity{which}")
        function.restype = ctypes.c_double
        pointers = (ctypes.byref(x) for x in (p, gradient) if x)
        return function(q.ctypes, *pointers)

    assert S(nominal) == pytest.approx(plain.S(q), rel=1e-13)
    gradient = type(nominal)()
    assert S(nominal, gradient) == S(nominal)
    h, bus = 1e-4, arm.model.inertias[1]

    def heavier(d):
        return arm.replace(base_mass=bus.mass + d, base_inertia=bus.inertia)

    def moved(d, axis):
        mount = arm.mount
        mount.translation = mount.translation + d * np.eye(3)[axis]
        return arm.replace(mount=mount)

    changes = [(gradient.joint_positions[axis], partial(moved, axis=axis)) for axis in (0, 1)]
    changes.append((gradient.masses[0], heavier))
    for slope, changed in changes:
        pair = [structure(parameters_of(changed(d)), names) for d in (h, -h)]
        assert slope == pytest.approx((S(pair[0]) - S(pair[1])) / (2 * h), rel=1e-6)
    J = np.empty((6, arm.n))
    jacobian = getattr(library.library, f"{library.name}_jacobian")
    jacobian(q.ctypes, ctypes.byref(structure(parameters_of(moved(0.1, 0)), names)), J.ctypes)
    wanted = sa.generalized_jacobian(moved(0.1, 0).at(q))
    np.testing.assert_allclose(J, wanted, atol=1e-12 * np.abs(wanted).max())


def test_names_are_those_of_c(tmp_path):
    text = random_chain(1, 2).replace('name="r"', 'name="7 */ arms"')
    header, source = sa.to_c(load_text(text, tip="tip", task="x y"), tmp_path)
    assert header.stem.isidentifier()
    assert header.stem.isascii()
    assert header.read_text().count("*/") == header.read_text().count("/*")
    assert "malloc" not in source.read_text()


def test_header_and_source_are_both_new_or_both_old(tmp_path):
    """No file may be as long as the source, as on a full disk."""
    header, source = sa.to_c(sa.load("planar2"), tmp_path)
    header_size, source_size = header.stat().st_size, source.stat().st_size
    assert header_size < source_size
    script = f"""
import resource, spacearm as sa
from pathlib import Path
limit = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
arm, folder = sa.load("planar2"), Path({str(tmp_path)!r})
resource.setrlimit(resource.RLIMIT_FSIZE, ({source_size - 1}, limit))
for old in (b"old", None):
    for path in folder.iterdir():
        path.write_bytes(old) if old else path.unlink()
    try:
        sa.to_c(arm, folder)
    except sa.SpaceArmError as error:
        print(error)
    print([(path.suffix, path.read_bytes()) for path in sorted(folder.iterdir())])
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    error = f"{source} cannot be written: File too large"
    assert run.stdout.splitlines() == [error, "[('.c', b'old'), ('.h', b'old')]", error, "[]"], run
