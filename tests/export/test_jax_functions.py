"""Functions of JAX: agreement, derivatives, batches."""

import numpy as np
import pytest
from helpers.arms import load_text, random_chain

import spacearm as sa
from spacearm.equations.measures import singularity
from spacearm.export.functions import EQUATIONS, structure_in
from spacearm.mechanics.arm_kernels import parameters_of

jax = pytest.importorskip("jax", reason="pip install 'spacearm[jax]'")
FUNCTIONS = (*EQUATIONS, "S_gradient")


@pytest.fixture(autouse=True)
def doubles():
    jax.config.update("jax_enable_x64", True)


def compared(arm):
    """All functions against CasADi's or, where there is none, the package's Jacobian."""
    casadi = pytest.importorskip("casadi")
    assert casadi
    mine, theirs = sa.to_jax(arm), sa.to_casadi(arm)
    rng = np.random.default_rng(0)
    for name in FUNCTIONS:
        given = rng.uniform(-2, 2, (3 if name == "forward_dynamics" else 1, arm.n))
        value = np.asarray(getattr(mine, name)(*given))
        wanted = getattr(theirs, name)(*given).full().reshape(value.shape)
        np.testing.assert_allclose(value, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.slow
def test_the_planar_example():
    arm, q = sa.load("planar2"), np.array([0.3, 1.2])
    fly = sa.to_jax(arm)
    np.testing.assert_allclose(fly.jacobian(q), sa.generalized_jacobian(arm.at(q)), atol=1e-14)
    gradient, S = np.asarray(fly.S_gradient(q)), sa.singularity_polynomial(arm)
    factor = fly.S(q) / S(q)
    np.testing.assert_allclose(gradient, factor * S.gradient(q), rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_batches_are_mapped():
    arm = sa.load("planar2")
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (60, 2))
    J = jax.vmap(sa.to_jax(arm).jacobian)(Q)
    np.testing.assert_allclose(J, sa.generalized_jacobians(arm, Q), atol=1e-13)


@pytest.mark.slow
def test_derivatives_by_a_mass():
    """Of the tip's Jacobian by the mass of the spacecraft, against arms with other masses."""
    arm, q, h = sa.load("planar2"), np.array([0.3, 1.2]), 1e-4
    fly = sa.to_jax(arm)
    J = jax.jacobian(fly.jacobian, argnums=1)(q, fly.parameters).masses[..., 0]
    bus = arm.model.inertias[1]
    more, less = (
        arm.replace(base_mass=bus.mass + d, base_inertia=bus.inertia).at(q) for d in (h, -h)
    )
    more, less = sa.generalized_jacobian(more), sa.generalized_jacobian(less)
    np.testing.assert_allclose(J, (more - less) / (2 * h), atol=1e-9)


@pytest.mark.slow
def test_derivatives_by_a_mount():
    arm, q, h = sa.load("planar2"), np.array([0.3, 1.2]), 1e-5
    fly = sa.to_jax(arm)
    S = jax.grad(fly.S, argnums=1)(q, fly.parameters).joint_positions[0]

    def moved(d):
        mount = arm.mount
        mount.translation = mount.translation + np.array([d, 0.0, 0.0])
        moved = arm.replace(mount=mount)
        tree = structure_in(moved, "free-floating")
        return float(singularity(np, tree, parameters_of(moved), q))

    assert S[0] == pytest.approx((moved(h) - moved(-h)) / (2 * h), rel=1e-7)


def test_32_bits_are_refused():
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(sa.UnsupportedError, match="jax_enable_x64"):
        sa.to_jax(sa.load("planar2"))


@pytest.mark.slow
def test_all_functions():
    compared(sa.load("chaser7"))


@pytest.mark.slow
def test_all_functions_with_sliding_joints():
    arm = load_text(random_chain(11, 4, ("revolute", "prismatic")), tip="tip", task="position")
    assert arm.slides.any()
    compared(arm)
