"""Joint rates against the singular value decompositions of LAPACK, by NumPy and compiled."""

import numpy as np
import pytest
from helpers.arms import seeds
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from spacearm.compiler import numbers, symbols
from spacearm.compiler.kernel import compiled
from spacearm.equations.laws import (
    damped_rates,
    reactionless_rates,
    resolved_rates,
    rotation_vector,
)

LEAST = 1e-9


def by_numpy(function, *arguments):
    with np.errstate(all="ignore"):
        return function(numbers, *arguments)


def by_machine(function, **arguments):
    """The same by machine code; arguments that are arrays are inputs."""
    inputs = {name: np.shape(a) for name, a in arguments.items() if isinstance(a, np.ndarray)}
    known = {name: a for name, a in arguments.items() if name not in inputs}
    kernel = compiled(lambda **given: function(symbols, **given, **known), inputs)
    return kernel({name: arguments[name][None] for name in inputs})[0]


def matrix(rng, k, n):
    """Rows of very different lengths; now and then two are the same."""
    J = rng.normal(size=(k, n)) * 10.0 ** rng.uniform(-2, 2, (k, 1))
    if k > 1 and rng.random() < 0.2:
        J[0] = J[1]
    return J


def damped(J, wanted, damping, threshold):
    U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
    nearness = min(sigma[-1] / threshold, 1.0)
    size = sigma**2 + damping**2 * (1.0 - nearness**2)
    return Vt.T @ (sigma / size * (U.T @ wanted))


@given(seeds)
def test_rotation_vectors_of_small_and_large_turns(seed):
    rng = np.random.default_rng(seed)
    start, axis = Rotation.random(random_state=rng), rng.normal(size=3)
    angle = rng.choice((0.0, 1e-9, 1e-3, 1.0, 2.5, np.pi - 1e-6)) * rng.choice((-1.0, 1.0))
    turn = angle * axis / np.linalg.norm(axis)
    end = Rotation.from_rotvec(turn) * start
    found = rotation_vector(numbers, start.as_matrix(), end.as_matrix())
    np.testing.assert_allclose(found, turn, rtol=0.0, atol=1e-14)


@given(seeds, st.integers(1, 6), st.integers(1, 8))
def test_damped_rates(seed, k, n):
    rng = np.random.default_rng(seed)
    J, wanted = matrix(rng, k, n), rng.normal(size=k)
    size = np.linalg.norm(J)
    damping, threshold = 0.1 * size, 10.0 ** rng.uniform(-2, 1) * size
    known = damped(J, wanted, damping, threshold)
    found = by_numpy(damped_rates, J, wanted, damping, threshold)
    np.testing.assert_allclose(found, known, atol=1e-10 * np.abs(known).max())


@given(seeds, st.integers(1, 6), st.integers(0, 3))
def test_resolved_rates(seed, k, more):
    rng = np.random.default_rng(seed)
    n = k + more
    J, wanted, rest = matrix(rng, k, n), rng.normal(size=k), rng.normal(size=n)
    found = by_numpy(resolved_rates, J, wanted, LEAST, rest, 0.3)
    sigma = np.linalg.svd(J, compute_uv=False)
    if sigma[-1] <= LEAST * sigma[0]:
        assert np.isnan(found).all()
        return
    inverse = np.linalg.pinv(J)
    known = inverse @ wanted + 0.3 * (rest - inverse @ (J @ rest))
    size = np.abs(known).max() * sigma[0] / sigma[-1]
    np.testing.assert_allclose(found, known, atol=1e-13 * size)
    np.testing.assert_allclose(J @ found, wanted, atol=1e-12 * sigma[0] * np.abs(known).max())


@given(seeds, st.integers(1, 6), st.integers(4, 8), st.integers(1, 3))
def test_reactionless_rates(seed, k, n, rank):
    rng = np.random.default_rng(seed)
    J, wanted = matrix(rng, k, n), rng.normal(size=k)
    D_q = rng.normal(size=(3, rank)) @ rng.normal(size=(rank, n))
    size = np.linalg.norm(J)
    N = np.linalg.svd(D_q)[2][rank:].T
    known = N @ damped(J @ N, wanted, 0.1 * size, 0.3 * size)
    found = by_numpy(reactionless_rates, J, D_q, rank, LEAST, wanted, 0.1 * size, 0.3 * size)
    np.testing.assert_allclose(found, known, atol=1e-10 * np.abs(known).max())
    np.testing.assert_allclose(D_q @ found, 0.0, atol=1e-11 * np.abs(known).max())


@pytest.mark.parametrize(("k", "n"), [(2, 2), (3, 7), (6, 6), (4, 2), (1, 1)])
def test_machine_code_gives_the_same(k, n):
    rng = np.random.default_rng(k)
    J, wanted = rng.normal(size=(k, n)), rng.normal(size=k)
    known = by_numpy(damped_rates, J, wanted, 0.3, 2.0)
    found = by_machine(damped_rates, J=J, wanted=wanted, damping=0.3, threshold=2.0)
    np.testing.assert_allclose(found, known, rtol=1e-10, atol=1e-12)
    known = by_numpy(resolved_rates, J, wanted, LEAST)
    found = by_machine(resolved_rates, J=J, wanted=wanted, least=LEAST)
    np.testing.assert_allclose(found, known, rtol=1e-9, atol=1e-11)
    if n > 3:
        D_q = rng.normal(size=(3, n))
        known = by_numpy(reactionless_rates, J, D_q, 3, LEAST, wanted, 0.3, 2.0)
        found = by_machine(reactionless_rates, J=J, D_q=D_q, wanted=wanted, rank=3, least=LEAST,
                           damping=0.3, threshold=2.0)  # fmt: skip
        np.testing.assert_allclose(found, known, rtol=1e-9, atol=1e-11)


def test_no_reactionless_motion_is_left():
    J, D_q, wanted = np.eye(3), np.eye(3), np.ones(3)
    found = by_numpy(reactionless_rates, J, D_q, 3, LEAST, wanted, 0.1, 0.1)
    assert np.isnan(found).all()
