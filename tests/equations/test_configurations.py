"""Equations of configurations against Pinocchio, the barycentric route and differences."""

import numpy as np
import pytest
from helpers.arms import chains, load_text, one_to_eight, random_tree, seeds
from hypothesis import assume, given
from hypothesis import strategies as st

import spacearm as sa
from spacearm.compiler import numbers, symbols
from spacearm.equations import kinematics, measures
from spacearm.equations.kinematics import posture
from spacearm.equations.linear_algebra import determinant, minors
from spacearm.equations.measures import distance
from spacearm.mechanics import batch
from spacearm.mechanics.arm_kernels import ArmKernel, parameters_of, structure_of
from spacearm.mechanics.distance import linearise_singly
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.model.joints import joint_scales

MODES = ("free-floating", "attitude-controlled", "fixed")


def of(cfg, mode="free-floating"):
    return structure_of(cfg.arm, mode), parameters_of(cfg.arm)


@given(chains())
def test_the_jacobian_is_that_of_the_barycentric_route(cfg):
    J = kinematics.jacobian(numbers, *of(cfg), cfg.q)
    R = cfg.base.rotation
    wanted = np.kron(np.eye(2), R.T) @ sa.barycentric(cfg).generalized_jacobian()
    np.testing.assert_allclose(J, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


@given(seeds, one_to_eight, st.sampled_from(("pose", "position", "x y")), st.sampled_from(MODES))
def test_the_distance_is_that_of_the_matrices(seed, n, task, mode):
    arm = load_text(random_tree(seed, n), tip=f"link_{n}", task=sa.Task(task, 0.7)
                    if task == "pose" else task, joints="all")  # fmt: skip
    assume(arm.n >= arm.task.k)
    cfg = arm.at(np.random.default_rng(seed).uniform(-3, 3, arm.n))
    near = linearise_singly(arm, cfg.q[None], mode)
    with np.errstate(all="ignore"):
        far, sigma, rows = distance(numbers, *of(cfg, mode), cfg.q, 0.3, joint_scales(arm))
    J = task_jacobian(cfg, mode=mode) * joint_scales(arm)
    assert sigma == pytest.approx(near.sigma[0], abs=1e-12 * np.linalg.norm(J))
    assume(1e-6 < near.distance[0] < 1e3)
    assert far == pytest.approx(near.distance[0], rel=1e-7)
    assert rows[0] == pytest.approx(near.rows[0, 0], abs=1e-6)
    assert rows.T @ rows == pytest.approx(near.rows[0].T @ near.rows[0], abs=1e-6)


@pytest.mark.parametrize("name", ["planar2", "mda6", "ets7"])
def test_the_way_out_is_the_gradient_of_sigma_min(name):
    """Of square tasks: distance = sigma_min / |g|, away = g / |g|, by differences of numpy's."""
    arm, h = sa.load(name), 1e-5
    for q in np.random.default_rng(0).uniform(-3, 3, (5, arm.n)):
        with np.errstate(divide="ignore", invalid="ignore"):
            far, sigma, rows = distance(numbers, *of(arm.at(q)), q, 0.3, joint_scales(arm))

        def least(q):
            return np.linalg.svd(task_jacobian(arm.at(q)), compute_uv=False)[-1]

        g = np.array([least(q + h * e) - least(q - h * e) for e in np.eye(arm.n)]) / (2.0 * h)
        assert sigma == pytest.approx(least(q), rel=1e-12)
        assert rows[0] == pytest.approx(g / np.linalg.norm(g), abs=1e-7)
        assert far == pytest.approx(sigma / np.linalg.norm(g), rel=1e-7)


@pytest.mark.slow
@given(seeds, st.integers(2, 6), st.integers(1, 2), st.sampled_from(MODES))
def test_slopes_are_the_gradients_that_both_libraries_take(seed, n, tips, mode):
    links = [f"link_{n - i}" for i in range(tips)]
    arm = load_text(random_tree(seed, n), tip=links, task=sa.Task("pose", 1.0), joints="all")
    rng = np.random.default_rng(seed)
    (q, dq), h = rng.normal(size=(2, arm.n)), rng.normal(size=6 * tips)

    def power(xp, tree, p, q):
        return xp.gradient(lambda q: h @ kinematics.jacobian(xp, tree, p, q) @ dq, q)

    tree, p = of(arm.at(q), mode)
    found = ArmKernel([arm], mode, power)({"q": q[None]})[0]
    (wanted,) = kinematics.slopes(numbers, tree, posture(numbers, tree, p, q), h, [dq])
    for gradient in (found, power(numbers, tree, p, q)):
        np.testing.assert_allclose(
            gradient, wanted, rtol=0, atol=1e-11 * (np.abs(wanted).max() + 1.0)
        )


@given(seeds, st.integers(3, 8), st.sampled_from(("pose", "position")))
def test_minors_seen_from_the_tip_are_those_of_the_jacobian(seed, n, task):
    """|det [B_f P_C]| = M^3 det D |det of the columns C of J*|."""
    task = sa.Task(task, 1.0) if task == "pose" else task
    arm = load_text(random_tree(seed, n), tip=f"link_{n}", task=task, joints="all")
    assume(arm.n >= arm.task.k)
    rng = np.random.default_rng(seed)
    cfg, C = arm.at(rng.uniform(-3, 3, arm.n)), rng.permutation(arm.n)[: arm.task.k]
    seen = measures.columns(numbers, *of(cfg), cfg.q)
    free = [i for i in range(6) if i not in arm.task.indices]
    found = seen[:, [*free, *(6 + C)]]
    bar = 1e-12 * np.linalg.norm(found, axis=0).prod()
    scale = cfg.A[0, 0] ** 3 * np.linalg.det(cfg.A[3:, 3:6])
    wanted = scale * np.linalg.det(task_jacobian(cfg)[:, C])
    assert abs(np.linalg.det(found)) == pytest.approx(abs(wanted), rel=1e-10, abs=bar)
    units = np.ones(6), np.ones(6 + arm.n)
    chosen = tuple(free) + tuple(int(6 + j) for j in C)
    value = measures.determinants(numbers, *of(cfg), cfg.q, *units, tuple(range(6)), (chosen,))
    assert value[0] == pytest.approx(np.linalg.det(found), abs=bar)


@pytest.mark.parametrize("mode", MODES)
def test_many_minors_are_few_minors(mode):
    arm = sa.load("chaser7")
    Q = np.random.default_rng(0).uniform(-3, 3, (40, 7))
    rows, columns = np.arange(6), 6 + np.array([range(6), [6, 5, 4, 3, 2, 1]])
    many = batch.minors(arm, Q, mode, rows, columns)
    few = np.concatenate([batch.minors(arm, q[None], mode, rows, columns) for q in Q])
    seen = batch.columns_seen(arm, Q, mode)[:, :, columns].swapaxes(1, 2)
    sizes = np.linalg.norm(seen, axis=2).prod(axis=2)
    assert (np.abs(many - few) <= 1e-14 * sizes).all()
    assert (np.abs(many - np.linalg.det(seen)) <= 1e-14 * sizes).all()


@given(seeds, st.integers(1, 6), st.integers(0, 2))
def test_chosen_minors_are_determinants(seed, k, more):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(k, k + more))
    chosen = [tuple(int(j) for j in rng.permutation(k + more)[:k]) for _ in range(3)]
    wanted = [np.linalg.det(A[:, columns]) for columns in chosen]
    assert minors(A, chosen) == pytest.approx(wanted, abs=1e-12)
    traced = minors(symbols.asarray(A), chosen)
    assert np.array(traced, dtype=float) == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("mode", MODES)
def test_tips_are_seen_from_the_centre(mode):
    arm = sa.load("mda6")
    for q in np.random.default_rng(0).uniform(-3, 3, (8, 6)):
        cfg = arm.at(q)
        body = arm.model.inertias[1].lever
        centre = cfg.base.act(body) if mode == "fixed" else cfg.com
        found = measures.tip_from_centre(numbers, *of(cfg, mode), q)
        assert found == pytest.approx(cfg.tip.translation - centre, abs=1e-13)


@pytest.mark.parametrize("n", [1, 4, 6, 7, 12, 18])
def test_determinants_of_any_size_have_their_sign(n):
    """The stacked J* of three arms has 18 rows; of rows exchanged it has the other sign."""
    rng = np.random.default_rng(n)
    A = np.roll(np.eye(n), 1, axis=0) + 0.1 * rng.normal(size=(n, n)) / n
    wanted = np.linalg.det(A)
    assert determinant(numbers, A) == pytest.approx(wanted, rel=1e-9)
    assert determinant(numbers, A[::-1]) == pytest.approx(np.linalg.det(A[::-1]), rel=1e-9)
    assert determinant(symbols, symbols.asarray(A)) == pytest.approx(wanted, rel=1e-9)
    A[:, n // 2] = 0.0  # a joint that moves nothing
    assert determinant(numbers, A) == pytest.approx(0.0, abs=1e-280)
    assert determinant(symbols, symbols.asarray(A)) == pytest.approx(0.0, abs=1e-280)
