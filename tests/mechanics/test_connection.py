"""J*, the connection and turns of many configurations, against Pinocchio and differences."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, one_to_eight, random_tree, seeds
from hypothesis import given, settings
from scipy.integrate import solve_ivp

import spacearm as sa
from spacearm.compiler import numbers
from spacearm.equations import turns
from spacearm.equations.turns import GAUSS
from spacearm.mechanics.arm_kernels import parameters_of, structure_of
from spacearm.mechanics.floating import chained, reactions, turns_and_effects, turns_of_spacecraft


def whole_tree(seed, n):
    task = sa.Task("pose", length=1.0)
    return load_text(random_tree(seed, n), tip=f"link_{n}", task=task, joints="all")


@pytest.mark.slow
@given(seeds, one_to_eight)
def test_reactions_on_random_trees(seed, n):
    arm = whole_tree(seed, n)
    Q = np.random.default_rng(seed).uniform(-4, 4, (9, arm.n))
    at = reactions(arm, Q)
    for i, q in enumerate(Q):
        cfg = arm.at(q)
        J = sa.generalized_jacobian(cfg)
        np.testing.assert_allclose(at.J[i], J, atol=1e-12 * abs(J).max())
        turned = np.array([sa.base_velocity(cfg, dq)[3:] for dq in np.eye(arm.n)]).T
        np.testing.assert_allclose(at.A[i], turned, atol=1e-12)
        np.testing.assert_allclose(at.r[i], cfg.tip.translation - cfg.com, atol=1e-12)
        np.testing.assert_allclose(at.R[i], cfg.tip.rotation, atol=1e-12)


@pytest.mark.slow
@given(seeds, one_to_eight)
@settings(max_examples=6)
def test_what_a_curve_does_to_a_turn_agrees_with_differences(seed, n):
    """Central differences of the turn by each joint position and rate at the Gauss points."""
    arm, rng, step = whole_tree(seed, n), np.random.default_rng(seed), 1e-5
    Q, rates = rng.uniform(-3, 3, (3, 2, arm.n)), rng.normal(size=(3, 2, arm.n))
    h = np.array([0.0, 0.1, 0.7])
    at = turns_and_effects(arm, Q, rates, h)
    np.testing.assert_allclose(at.T, turns_of_spacecraft(arm, Q, rates, h), atol=1e-13)
    for i, reached in enumerate(reactions(arm, Q[:, 1])[1:]):
        np.testing.assert_allclose(at[3 + i], reached, atol=1e-12)
    for point in range(2):
        np.testing.assert_allclose(at.J[:, point], reactions(arm, Q[:, point]).J, atol=1e-12)
        for j in range(arm.n):
            change = np.zeros((2, arm.n))
            change[point, j] = step
            for which, by in enumerate(((change, 0.0), (0.0, change))):
                after, before = (
                    turns_of_spacecraft(arm, Q + sign * by[0], rates + sign * by[1], h)
                    for sign in (1.0, -1.0)
                )
                turned = [pin.log3(b.T @ a) for b, a in zip(before, after, strict=True)]
                found = at.effects[:, point, which, :, j]
                size = max(1.0, np.abs(at.effects).max())
                np.testing.assert_allclose(found, np.array(turned) / (2 * step), atol=1e-6 * size)


@given(seeds, one_to_eight)
@settings(max_examples=10)
def test_turns_agree_with_an_integration_of_momentum(seed, n):
    """SciPy integrates T' = T [A q']x with A of `base_velocity`."""
    arm, rng = whole_tree(seed, n), np.random.default_rng(seed)
    q, dq = rng.uniform(-3, 3, arm.n), rng.normal(size=arm.n)

    def rate(s, y):
        w = sa.base_velocity(arm.at(q + s * dq), dq)[3:]
        return (y.reshape(3, 3) @ pin.skew(w)).ravel()

    end = solve_ivp(rate, (0, 1), np.eye(3).ravel(), "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    errors = []
    for m in (40, 80):
        s = np.add.outer(np.arange(m), GAUSS) / m
        nodes, rates = q + s[..., None] * dq, np.tile(dq, (m, 2, 1))
        T = chained(turns_of_spacecraft(arm, nodes, rates, np.full(m, 1.0 / m)))
        errors.append(np.abs(T[-1] - end.reshape(3, 3)).max())
    assert errors[1] < max(errors[0] / 10.0, 1e-10)
    assert errors[1] < 1e-4


@pytest.mark.parametrize("name", ["planar2", "chaser7"])
def test_numbers_and_machine_code_agree(name):
    arm, rng = sa.load(name), np.random.default_rng(0)
    Q, rates = rng.uniform(-3, 3, (2, arm.n)), rng.normal(size=(2, arm.n))
    found = turns_and_effects(arm, Q[None], rates[None], np.array([0.3]))
    tree, p = structure_of(arm), parameters_of(arm)
    by_numbers = turns.turn_and_effects(numbers, tree, p, Q, rates, 0.3)
    for one, other in zip(found, by_numbers, strict=True):
        np.testing.assert_allclose(one[0], other, atol=1e-12 * max(1.0, np.abs(other).max()))


def test_products_of_rotations():
    for m in (1, 2, 5, 16):
        T = np.array([pin.exp3(v) for v in np.random.default_rng(m).normal(size=(m, 3))])
        product, found = np.eye(3), chained(T)
        for one, all_before in zip(T, found, strict=True):
            product = product @ one
            np.testing.assert_allclose(all_before, product, atol=1e-14)
