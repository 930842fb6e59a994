"""Functions of CasADi: agreement, exact gradients, code."""

import numpy as np
import pytest
from helpers.arms import load_text, random_chain, seeds
from hypothesis import given, settings

import spacearm as sa

casadi = pytest.importorskip("casadi", reason="pip install 'spacearm[casadi]'")


def assert_same(value, wanted, rtol=1e-12):
    np.testing.assert_allclose(value, wanted, rtol=0.0, atol=rtol * np.abs(wanted).max())


@settings(max_examples=3)
@given(seeds)
def test_the_same_functions(seed):
    rng = np.random.default_rng(seed)
    kinds = ("revolute", "prismatic")
    arm = load_text(random_chain(seed, int(rng.integers(2, 5)), kinds), tip="tip", task="x z")
    q, dq, tau = rng.uniform(-2, 2, (3, arm.n))
    fly, cfg = sa.to_casadi(arm), arm.at(q)
    assert_same(fly.jacobian(q).full(), sa.generalized_jacobian(cfg))
    H = sa.generalized_inertia(cfg)
    assert_same(fly.generalized_inertia(q).full(), H)
    ddq = sa.forward_dynamics(cfg, dq, tau).ddq
    assert_same(
        fly.forward_dynamics(q, dq, tau).full()[:, 0], ddq, 1e-12 + 1e-15 * np.linalg.cond(H)
    )
    assert_same(fly.base_inertia(q).full(), cfg.A[3:, 3:6])
    assert_same(fly.tip_position(q).full()[:, 0], cfg.tip.translation - cfg.com)


@pytest.mark.parametrize(("name", "n", "task"), [("planar2", 2, ""), ("", 3, "position")])
def test_the_gradient_is_that_of_the_polynomial(name, n, task):
    arm = sa.load(name) if name else load_text(random_chain(5, n), tip="tip", task=task)
    S, fly = sa.singularity_polynomial(arm), sa.to_casadi(arm)
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (20, n))
    factor = fly.S(Q[0]).full()[0, 0] / S(Q[0])
    for q in Q:
        wanted = factor * S.gradient(q)
        np.testing.assert_allclose(
            fly.S_gradient(q).full()[:, 0], wanted, rtol=0, atol=1e-11 * abs(factor) * S.scale
        )


def test_the_functions_write_c(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sa.to_casadi(sa.load("planar2")).S_gradient.generate("gradient.c")
    assert "sin(" in (tmp_path / "gradient.c").read_text()


def test_derivatives_by_masses_and_a_mount():
    """Against arms with other masses and mounts."""
    arm, q, h = sa.load("planar2"), np.array([0.3, 1.2]), 1e-4
    fly = sa.to_casadi(arm, parameters=("joint_positions", "masses"))
    assert list(fly.parameters) == ["joint_positions", "masses"]
    positions, masses = (casadi.SX.sym(name, *x.shape) for name, x in fly.parameters.items())
    J = fly.jacobian(q, positions, masses)
    own = fly.parameters.values()
    assert_same(fly.jacobian(q, *own).full(), sa.generalized_jacobian(arm.at(q)))

    def slope(symbol, changed):
        by = casadi.Function("by", [positions, masses], [casadi.jacobian(J, symbol)])
        found = by(*own).full().reshape(J.shape, order="F")
        more, less = (sa.generalized_jacobian(changed(d).at(q)) for d in (h, -h))
        np.testing.assert_allclose(found, (more - less) / (2 * h), atol=1e-8)
        assert np.abs(found).max() > 1e-4

    def shifted(d):
        mount = arm.mount
        mount.translation = mount.translation + np.array([d, 0.0, 0.0])
        return arm.replace(mount=mount)

    bus = arm.model.inertias[1]
    slope(masses[0], lambda d: arm.replace(base_mass=bus.mass + d, base_inertia=bus.inertia))
    slope(positions[0, 0], shifted)


def test_parameters_that_are_none_are_named():
    with pytest.raises(sa.ConfigurationError, match=r"parameter 'mass'.*masses"):
        sa.to_casadi(sa.load("planar2"), parameters=("mass",))
