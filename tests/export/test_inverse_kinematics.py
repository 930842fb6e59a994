"""Tasks, constraints and barriers: their matrices, and pink's solver where it is installed."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_base, random_chain, random_tree

import spacearm as sa


def seen(cfg):
    """A configuration as pink has it."""
    return SimpleNamespace(q=cfg.full)


def displaced(cfg, v):
    return SimpleNamespace(q=pin.integrate(cfg.arm.model, cfg.full, v))


def random(seed, **options):
    rng = np.random.default_rng(seed)
    arm = load_text(random_chain(seed, 4), tip="tip", **options)
    return arm.at(rng.uniform(-2, 2, arm.n), base=random_base(rng)), rng


@pytest.mark.parametrize("seed", range(3))
def test_momentum_is_conserved(seed):
    cfg, rng = random(seed)
    A = sa.MomentumConservation(cfg.arm).compute_jacobian(seen(cfg))
    dq = rng.normal(size=cfg.arm.n)
    v = np.concatenate((-A[:, 6:] @ dq, dq))
    np.testing.assert_allclose(cfg.A @ v, 0.0, atol=1e-11 * np.abs(cfg.A).max())
    turned = cfg.base.rotation @ v[3:6]
    np.testing.assert_allclose(turned, sa.base_velocity(cfg, dq)[3:], atol=1e-12)


@pytest.mark.parametrize("task", ["pose", "position", "x y z rx"])
def test_the_jacobian_is_the_derivative_of_the_error(task):
    """Along motions without momentum, near the target."""
    cfg, rng = random(5, task=sa.Task(task, length=None if task == "position" else 1.0))
    goal = sa.GeneralizedJacobianTask(cfg.arm, cfg.tip)
    follow = sa.MomentumConservation(cfg.arm).compute_jacobian(seen(cfg))[:, 6:]
    for _ in range(3):
        dq, h = rng.normal(size=cfg.arm.n), 1e-6
        v = np.concatenate((-follow @ dq, dq))
        ends = [goal.compute_error(displaced(cfg, s * h * v)) for s in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * h)
        wanted = goal.compute_jacobian(seen(cfg)) @ v
        if task != "x y z rx":  # whose axes turn with the spacecraft
            np.testing.assert_allclose(slope, wanted, atol=1e-7)


def test_a_step_reaches_a_near_target():
    cfg, _ = random(7, task="position")
    target = cfg.tip
    target.translation += [1e-4, -2e-4, 1e-4]
    goal = sa.GeneralizedJacobianTask(cfg.arm, target)
    H, c = goal.compute_qp_objective(seen(cfg))
    dq = np.linalg.lstsq(H[6:, 6:], -c[6:], rcond=1e-12)[0]
    reached = sa.move(cfg, cfg.q + dq)
    np.testing.assert_allclose(reached.tip.translation, target.translation, atol=1e-6)


@pytest.mark.parametrize("name", ["planar2", "chaser7"])
def test_near_the_set_the_gradient_is_that_of_the_distance(name):
    arm = sa.load(name)
    singular = sa.singular_set(arm).sample(3, np.random.default_rng(1))
    barrier = sa.SingularityBarrier(arm, 0.05)
    for q in singular:
        away = sa.evaluate(arm, [q + 1e-3], ["away"])["away"][0]
        cfg, h = arm.at(q + 0.02 * away), 1e-6
        slope = barrier.compute_jacobian(seen(cfg))[0, 6:]
        ends = [barrier.compute_barrier(seen(arm.at(cfg.q + s * h * slope)))[0] for s in (1, -1)]
        assert np.linalg.norm(slope) == pytest.approx(1.0, abs=1e-9)
        assert (ends[0] - ends[1]) / (2 * h) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("name", ["planar2", "mda6"])
def test_at_the_set_the_gradient_is_along_that_of_S(name):
    arm = sa.load(name)
    S, barrier = sa.singularity_polynomial(arm), sa.SingularityBarrier(arm, 0.05)
    for q in sa.singular_set(arm).sample(5, np.random.default_rng(2)):
        along = S.gradient(q) / np.linalg.norm(S.gradient(q))
        slope = barrier.compute_jacobian(seen(arm.at(q + 1e-5 * along)))[0, 6:]
        np.testing.assert_allclose(slope, along, atol=1e-3)


def test_the_barrier_is_an_inequality():
    cfg = sa.load("planar2").at([0.3, 0.4])
    barrier = sa.SingularityBarrier(cfg.arm, 0.05, gain=3.0)
    G, h = barrier.compute_qp_inequalities(seen(cfg), dt=0.1)
    distance = sa.singularity(cfg).distance
    assert h[0] == pytest.approx(3.0 * (distance - 0.05))
    assert G.shape == (1, 8)
    assert not G[:, :6].any()
    H, c = barrier.compute_qp_objective(seen(cfg))
    assert not H.any()
    assert not c.any()


def test_what_does_not_fit_is_refused():
    arm = sa.load("planar2")
    with pytest.raises(sa.ConfigurationError, match=r"arm\.model"):
        sa.MomentumConservation(arm).compute_jacobian(SimpleNamespace(q=np.zeros(3)))
    with pytest.raises(sa.ConfigurationError, match="margin is 0"):
        sa.SingularityBarrier(arm, 0)
    mimic = next(
        arm
        for seed in range(50)
        if (arm := load_text(random_tree(seed, 4), tip="link_4", joints="all", task="x")).coupling
        is not None
    )
    with pytest.raises(sa.UnsupportedError, match="mimic"):
        sa.MomentumConservation(mimic)


def test_pink_solves_with_them():
    pink = pytest.importorskip("pink", reason="pip install 'spacearm[pink]'")
    arm = sa.load("planar2")
    cfg = arm.at([0.5, 1.0])
    configuration = pink.Configuration(arm.model, arm.model.createData(), cfg.full)
    target = cfg.tip
    target.translation += [0.1, 0.1, 0.0]
    goal = sa.GeneralizedJacobianTask(arm, target, gain=0.2)
    barrier = sa.SingularityBarrier(arm, 0.05)
    for _ in range(60):
        v = pink.solve_ik(
            configuration, [goal], 0.1, solver="daqp", limits=[], barriers=[barrier],
            constraints=[sa.MomentumConservation(arm)], safety_break=False,
        )  # fmt: skip
        configuration.integrate_inplace(v, 0.1)
    np.testing.assert_allclose(goal.compute_error(configuration), 0.0, atol=1e-4)
    com = goal.configuration(configuration).com
    np.testing.assert_allclose(com, cfg.com, atol=2e-3)  # of steps of Euler's method
