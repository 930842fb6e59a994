"""Exact singular sets of redundant arms and of arms with sliding joints, against searches."""

import numpy as np
import pytest
from helpers.arms import frame, joint, load_text, random_chain, random_link, robot, seeds
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

import spacearm as sa
from spacearm.mechanics.distance import is_singular, lose_rank
from spacearm.model.joints import joint_scales
from spacearm.polynomial.triangle import Triangle, find_triangle, share_root
from spacearm.polynomial.tubes import straight
from spacearm.singularities.polynomials import minors_of
from spacearm.singularities.sets import prove_regular, prove_way

MODES = ["free-floating", "attitude-controlled", "fixed"]
FOLD = 2e-3
"""Solutions near a fold of the set are as accurate as the root of the accuracy of the search."""


def sigma_ratio(arm, q, mode="free-floating"):
    J = arm.task.jacobian(sa.generalized_jacobian(arm.at(q), mode=mode), np.eye(3))
    sigma = np.linalg.svd(J, compute_uv=False)
    return sigma[-1] / sigma[0]


def chain(seed, n, task="pose", kinds=None):
    """A random spatial chain; the kinds of its joints in order, revolute if None."""
    if kinds is None:
        return load_text(random_chain(seed, n, ("revolute",)), tip="tip", task=task)
    rng = np.random.default_rng(seed)
    names = ["bus", *(f"link_{i}" for i in range(1, n + 1))]
    elements = [random_link(rng, "bus", 10 ** rng.uniform(1, 3))]
    elements += [random_link(rng, name) for name in names[1:]]
    for i, kind in enumerate(kinds, start=1):
        pose = {"xyz": rng.normal(size=3) * 0.6, "rpy": rng.uniform(-np.pi, np.pi, 3)}
        limit = '<limit lower="-0.4" upper="0.9" effort="10" velocity="1"/>'
        inside = {"inside": limit} if kind == "prismatic" else {}
        elements.append(
            joint(
                f"joint_{i}",
                names[i - 1],
                names[i],
                kind,
                axis=rng.normal(size=3),
                **pose,
                **inside,
            )
        )
    elements += [frame("tip"), joint("tip_joint", names[-1], "tip", "fixed", rng.normal(size=3))]
    return load_text(robot(*elements), tip="tip", task=task)


def offsets(arm, Q, q):
    """(m, n) differences of joint positions, without whole turns."""
    return np.where(arm.slides, Q - q, np.angle(np.exp(1j * (Q - q))))


def holds(found, q):
    """Whether the triangle gives q, on one of its sheets."""
    angles = found.chart.angles(q)[None]
    solved = [found.triangle.solve(angles, sheet=s) for s in (None, *found.triangle.sheets)]
    Q = found.chart.positions(np.concatenate(solved))
    return bool((np.abs(offsets(found.arm, Q, q)).max(axis=1) < FOLD).any())


def searched(found, rng, m):
    """Singular configurations from the Gauss-Newton method on J*, within the chart."""
    Q = found.chart.positions(rng.uniform(-np.pi, np.pi, (m, found.arm.n)))
    ends = [lose_rank(found.arm, q, found.mode) for q in Q]
    return [q for q in ends if q is not None and np.isfinite(found.chart.angles(q)).all()]


# --- samples are singular, and nothing is missed --------------------------------------------


@pytest.mark.slow
@given(seeds, st.sampled_from([6, 7, 8]), st.sampled_from(MODES))
@settings(max_examples=12)
def test_every_sample_is_singular_and_every_singularity_found_is_on_the_set(seed, n, mode):
    arm = chain(seed, n)
    found = sa.singular_set(arm, mode=mode)
    assert found.complete
    assert found.codimension == n - 5
    rng = np.random.default_rng(seed)
    Q = found.sample(200, rng)
    assert Q.shape == (200, n)
    assert max(sigma_ratio(arm, q, mode) for q in Q) < 1e-9
    ends = searched(found, rng, 10)
    assert ends
    assert all(holds(found, q) for q in ends)


@pytest.mark.slow
def test_two_hundred_and_forty_searches_end_on_the_set_of_chaser7_and_random_arms():
    rng = np.random.default_rng(240)
    ends = 0
    for arm in (sa.load("chaser7"), chain(1, 7), chain(2, 8)):
        found = sa.singular_set(arm)
        mine = searched(found, rng, 80)
        ends += len(mine)
        assert all(holds(found, q) for q in mine)
    assert ends == 240


def test_chaser7_has_an_exact_set():
    arm = sa.load("chaser7")
    found = sa.singular_set(arm)
    assert found.complete
    assert [f.degrees for f in found.triangle.polynomials] == [
        (0, 4, 3, 2, 1, 0, 0),
        (0, 4, 3, 2, 1, 1, 0),
    ]
    assert found.triangle.joints == (4, 5)
    assert found.relevant == (1, 2, 3, 4, 5)
    assert (found.codimension, found.dimension) == (2, 3)
    rng = np.random.default_rng(7)
    Q = found.sample(300, rng)
    again = found.sample(300, np.random.default_rng(7))  # sums may be compiled meanwhile
    np.testing.assert_allclose(again, Q, atol=1e-12)
    assert max(sigma_ratio(arm, q) for q in Q[:60]) < 1e-12
    assert all(holds(found, q) for q in searched(found, rng, 6))
    assert len(found.sample(0)) == 0
    q = Q[0]
    both = found.solve(q + np.array([0, 0, 0, 0, 1, 1, 0]))  # joints that follow do not matter
    assert np.abs(offsets(arm, both, q)).max(axis=1).min() < 1e-9
    assert np.allclose(both[:, [0, 1, 2, 3, 6]], q[[0, 1, 2, 3, 6]])
    for j in (4, 5, "joint_6"):
        roots = found.roots(q, j)
        number = j if isinstance(j, int) else 5
        assert np.abs(np.angle(np.exp(1j * (roots.angles - q[number])))).min() < 1e-9
    assert not len(found.roots(rng.uniform(-3, 3, 7), 4).angles)
    with pytest.raises(sa.UnsupportedError, match="have a singularity polynomial"):
        _ = found.S
    with pytest.raises(sa.UnsupportedError, match="dimension 1 is one over 3 joints, not 5"):
        found.curves()


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_planar_arms_with_a_redundant_joint(mode):
    """ "x y" with three joints: two linear equations in (cos q3, sin q3) if the arm floats."""
    arm = sa.load("planar3", task="x y")
    found = sa.singular_set(arm, mode=mode)
    assert found.complete
    rng = np.random.default_rng(3)
    Q = found.sample(100, rng)
    assert max(sigma_ratio(arm, q, mode) for q in Q) < 1e-9
    assert all(holds(found, q) for q in searched(found, rng, 20))
    if found.dimension == 0:  # q2 and q3 are 0 or 180 degrees
        assert len(np.unique(np.round(np.abs(Q[:, 1:]), 9))) == 2
        return
    points = np.concatenate(found.curves())
    for q in Q[:20]:
        assert np.abs(offsets(arm, points, q))[:, found.relevant].max(axis=1).min() < 0.08
    for q in points[:: len(points) // 20]:
        assert sigma_ratio(arm, q, mode) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("n", [3, 4, 5])
def test_planar_arms_that_turn_the_tip(n):
    arm = load_text(planar_chain(n), tip="tip", task="x y rz")
    found = sa.singular_set(arm)
    assert found.complete
    assert found.codimension == n - 2
    rng = np.random.default_rng(n)
    assert max(sigma_ratio(arm, q) for q in found.sample(50, rng)) < 1e-9
    assert all(holds(found, q) for q in searched(found, rng, 10))


def planar_chain(n):
    """n links in the plane, their CMs beside the line between the joints."""
    rng = np.random.default_rng(n)
    names = ["bus", *(f"link_{i}" for i in range(1, n + 1))]
    flat = [np.append(rng.normal(size=2) * 0.3, 0.0) for _ in names]
    elements = [
        f'<link name="{name}"><inertial><origin xyz="{com[0]} {com[1]} 0"/><mass value="{mass}"/>'
        f'<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for name, com, mass in zip(names, flat, [40.0, *rng.uniform(2, 6, n)], strict=True)
    ]
    elements += [
        joint(f"joint_{i}", names[i - 1], names[i], "continuous", xyz=(0.6, 0.1, 0), inside="")
        for i in range(1, n + 1)
    ]
    elements += [frame("tip"), joint("tip_joint", names[-1], "tip", "fixed", (0.5, 0, 0))]
    return robot(*elements)


@pytest.mark.slow
@pytest.mark.parametrize("slides", [(0,), (1,), (2,), (3,), (6,), (0, 3), (1, 6)])
def test_sliding_joints_among_the_first_four_and_the_last(slides):
    kinds = ["prismatic" if j in slides else "revolute" for j in range(7)]
    arm = chain(11, 7, kinds=kinds)
    found = sa.singular_set(arm)
    assert found.complete
    rng = np.random.default_rng(5)
    Q = found.sample(60, rng)
    assert max(sigma_ratio(arm, q) for q in Q) < 1e-9
    for j in slides:
        assert (Q[:, j] >= -0.4).all()
        assert (Q[:, j] <= 0.9).all()
    assert all(holds(found, q) for q in searched(found, rng, 25))


def sliding(seed, kinds):
    """The set of a spatial chain of revolute (R) and prismatic joints (P), held in attitude."""
    names = {"R": "revolute", "P": "prismatic"}
    arm = chain(seed, len(kinds), "x y rz", [names[kind] for kind in kinds])
    return sa.singular_set(arm, mode="attitude-controlled")


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "kinds"), [(34, "RPRPR"), (57, "PRPRR"), (58, "RPRRP")])
def test_roots_of_the_minors_that_are_not_singular_are_left_out(seed, kinds):
    """The columns that the minors share are dependent there, and the others make up for it."""
    found = sliding(seed, kinds)
    assert found.complete
    Q = found.sample(100, np.random.default_rng(0))
    solved = np.concatenate([found.solve(q) for q in Q[:10]])
    for q in (*Q, *solved):
        assert sigma_ratio(found.arm, q, "attitude-controlled") < 1e-8


@pytest.mark.slow
def test_a_set_beyond_the_sliding_joints_ranges_is_empty():
    found = sliding(33, "RPPRP")
    assert found.complete
    with pytest.raises(sa.NoSolutionError, match="empty or very small"):
        found.sample(1)


@pytest.mark.slow
def test_a_square_arm_with_a_sliding_joint():
    arm = chain(4, 3, "position", ["revolute", "prismatic", "revolute"])
    found = sa.singular_set(arm)
    assert found.complete
    rng = np.random.default_rng(5)
    Q = found.sample(60, rng)
    assert max(sigma_ratio(arm, q) for q in Q) < 1e-9
    assert all(holds(found, q) for q in searched(found, rng, 20))
    t = np.linspace(-0.4, 0.9, 400)
    q = np.array([0.3, 0.0, 1.0])
    line = np.tile(q, (len(t), 1))
    line[:, 1] = t
    values = [sa.singularity(arm.at(row)).determinant for row in line]
    crossings = np.flatnonzero(np.diff(np.sign(values)))
    roots = found.roots(q, "joint_2").angles
    assert len(crossings) <= len(roots)
    for i in crossings:
        assert ((roots >= t[i]) & (roots <= t[i + 1])).any()
    with pytest.raises(sa.ConfigurationError, match=r"'joint_2' is 3; the set is known from -0.4"):
        found.roots([0.3, 3.0, 1.0], 0)
    near = found.nearest(q)
    nearest, distance = near.q, near.distance
    assert sigma_ratio(arm, nearest) < 1e-9
    assert np.linalg.norm((nearest - q) / joint_scales(arm)) == pytest.approx(distance)
    dense = offsets(arm, found.sample(20_000, rng), q) / joint_scales(arm)
    assert distance <= np.linalg.norm(dense, axis=1).min() + 1e-9


@pytest.mark.parametrize("mode", ["attitude-controlled", "fixed"])
def test_sheets_that_do_not_depend_on_the_eliminated_joint_are_sampled(mode):
    """The elbow of ets7: its sheet is the same for every angle of the wrist."""
    arm = sa.load("ets7")
    found = sa.singular_set(arm, mode=mode)
    rng = np.random.default_rng(1)
    assert found.triangle.sheets
    Q = found.sample(4000, rng)
    assert max(sigma_ratio(arm, q, mode) for q in Q[:100]) < 1e-9
    ends = searched(found, rng, 12)
    assert all(holds(found, q) for q in ends)
    reach = [
        np.linalg.norm(offsets(arm, Q, q)[:, list(found.relevant)], axis=1).min() for q in ends
    ]
    assert max(reach) < 0.8  # random points of the set lie near samples, on all sheets


@pytest.mark.parametrize("seed", [7, 10])
def test_samples_cover_parts_that_hardly_depend_on_the_solved_joint(seed):
    """Attitude-controlled: S depends on two joints, in parts hardly on the one solved for."""
    arm = chain(seed, 3, "position")
    found = sa.singular_set(arm, mode="attitude-controlled")
    Q = found.sample(3000, np.random.default_rng(0))[:, found.relevant]
    curves = np.concatenate(found.curves())[:, found.relevant]
    apart = np.angle(np.exp(1j * (curves[::5, None] - Q)))
    assert np.linalg.norm(apart, axis=2).min(axis=1).max() < 0.1
    one = found.sample(1, np.random.default_rng(0))
    assert one.shape == (1, 3)


def test_arms_of_special_build_get_a_search_and_a_proof_all_the_same():
    """A fixed Panda: an elbow of its own codimension, shoulder and wrist with common centres."""
    arm = sa.load("servicer_panda")
    found = sa.singular_set(arm, mode="fixed")
    assert isinstance(found, sa.FoundSet)
    assert not found.complete
    assert "by search" in repr(found)
    Q = found.sample(3, np.random.default_rng(0))
    assert max(sigma_ratio(arm, q, "fixed") for q in Q) < 1e-9
    assert not found.is_free(Q[0] - 0.01, Q[0] + 0.01)
    regular = np.array([0.3, 0.5, -0.4, -1.5, 0.6, 1.4, 0.2])
    assert found.is_free(regular, regular + 0.05)
    with pytest.raises(sa.UnsupportedError, match=r"joint by joint.*only \.sample"):
        found.curves()


# --- empty sets -----------------------------------------------------------------------------


def test_an_empty_set_says_so():
    arm = load_text(random_chain(1, 1, ("revolute",)), tip="tip", task="rz")
    found = sa.singular_set(arm, mode="fixed")
    with pytest.raises(sa.NoSolutionError, match=r"none of .* lines meets the singular set"):
        found.sample(3)
    assert len(found.sample(0)) == 0
    assert found.is_free([0.0], [3.0])


# --- nearest --------------------------------------------------------------------------------


def independent_distance(found, q, rng, starts, low=None, high=None):
    """The distance of the best singular configuration of sequential quadratic programming."""
    equations = [
        {
            "type": "eq",
            "fun": lambda x, f=f: 100 * f(x) / f.scale,
            "jac": lambda x, f=f: 100 * f.gradient(x) / f.scale,
        }
        for f in found.triangle.equations
    ]
    best = np.inf
    for _ in range(starts):
        start = q + rng.normal(size=len(q)) * rng.choice([0.1, 0.3, 1.0, 2.0])
        bounds = None if low is None else list(zip(low, high, strict=True))
        result = minimize(
            lambda x: 0.5 * (x - q) @ (x - q),
            start if low is None else np.clip(start, low, high),
            jac=lambda x: x - q,
            constraints=equations,
            bounds=bounds,
            method="SLSQP",
            options={"maxiter": 150, "ftol": 1e-12},
        )
        on_set = all(abs(f(result.x)) < 1e-9 * f.scale for f in found.triangle.equations)
        if on_set and is_singular(found.arm, result.x, found.mode):
            best = min(best, float(np.linalg.norm(result.x - q)))
    return best


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mda6", "ets7", "chaser7"])
def test_no_independent_search_finds_a_nearer_one(name):
    arm = sa.load(name)
    found = sa.singular_set(arm)
    rng = np.random.default_rng(11)
    for q in rng.uniform(-np.pi, np.pi, (12, arm.n)):
        near = found.nearest(q)
        nearest, distance = near.q, near.distance
        assert sigma_ratio(arm, nearest) < 1e-9
        assert np.linalg.norm(nearest - q) == pytest.approx(distance)
        assert distance <= independent_distance(found, q, rng, 12) + 1e-7


@pytest.mark.slow
def test_nearest_of_chaser7_is_nearer_than_any_sample_and_a_short_search():
    arm = sa.load("chaser7")
    found = sa.singular_set(arm)
    rng = np.random.default_rng(12)
    Q = found.sample(20_000, rng)
    for q in rng.uniform(-np.pi, np.pi, (3, 7)):
        near = found.nearest(q)
        nearest, distance = near.q, near.distance
        assert sigma_ratio(arm, nearest) < 1e-9
        assert distance <= np.linalg.norm(offsets(arm, Q, q), axis=1).min()
        assert distance <= independent_distance(found, q, rng, 4) + 1e-7


def test_nearest_within_limits():
    arm = sa.load("mda6")
    found = sa.singular_set(arm)
    rng = np.random.default_rng(13)
    for q in rng.uniform(arm.lower, arm.upper, (3, 6)):
        near = found.nearest(q, limits=True)
        nearest, distance = near.q, near.distance
        assert (nearest >= arm.lower).all()
        assert (nearest <= arm.upper).all()
        assert sigma_ratio(arm, nearest) < 1e-9
        assert np.linalg.norm(nearest - q) == pytest.approx(distance)
        assert distance >= found.nearest(q).distance - 1e-9
        best = independent_distance(found, q, rng, 4, arm.lower, arm.upper)
        assert distance <= best + 1e-7


@pytest.mark.slow
def test_nearest_of_a_searched_set_is_a_stationary_point():
    arm = chain(2, 4, "position")
    found = sa.singular_set(arm)
    assert isinstance(found, sa.FoundSet)
    rng = np.random.default_rng(0)
    for q in rng.uniform(-np.pi, np.pi, (2, 4)):
        near = found.nearest(q)
        nearest, distance = near.q, near.distance
        assert sigma_ratio(arm, nearest) < 1e-9
        assert np.linalg.norm(nearest - q) == pytest.approx(distance)
        for _ in range(20):  # other members about it are no nearer
            other = lose_rank(arm, nearest + 0.05 * rng.normal(size=4), "free-floating")
            assert other is None or np.linalg.norm(offsets(arm, other, q)) >= distance - 1e-7


# --- proofs ---------------------------------------------------------------------------------


@pytest.mark.slow
@given(seeds, st.sampled_from([7, 8]), st.sampled_from(["free-floating", "fixed"]))
@settings(max_examples=6)
def test_segments_through_the_set_are_never_free_and_others_are(seed, n, mode):
    arm = chain(seed, n)
    found = sa.singular_set(arm, mode=mode)
    rng = np.random.default_rng(seed)
    for q in found.sample(6, rng):
        direction = rng.normal(size=n)
        q0, q1 = q - rng.uniform(0, 1) * direction, q + rng.uniform(0, 1) * direction
        proof = found.is_free(q0, q1)
        assert not proof
        assert np.abs(proof.at - q).max() < 1e-6 * max(1.0, np.abs(direction).max())
    dense = np.linspace(0, 1, 400)[:, None]
    for q0, q1 in rng.uniform(-np.pi, np.pi, (6, 2, n)):
        assert found.is_free(q0, q1)  # a random segment misses a set of codimension two
        least = min(sigma_ratio(arm, q, mode) for q in q0 + dense * (q1 - q0))
        assert least > 1e-12


def test_proofs_for_chaser7():
    arm = sa.load("chaser7")
    found = sa.singular_set(arm)
    rng = np.random.default_rng(4)
    for q in found.sample(4, rng):
        direction = rng.normal(size=7)
        through = found.is_free(q - direction, q + 0.7 * direction)
        assert not through
        assert through.verdict in ("singular", "undecided")
        assert np.abs(through.at - q).max() < 1e-6
        ends = found.is_free(q, q + direction)  # begins on the set
        assert not ends
        assert np.abs(ends.at - q).max() < 1e-6
        backwards = found.is_free(q + direction, q)
        assert not backwards
        assert np.abs(backwards.at - q).max() < 1e-6
        beside = q + 1e-4 * direction
        across = rng.normal(size=7)
        near = found.is_free(beside - across, beside + across)
        least = sigma_ratio(arm, beside)
        assert near.verdict == "free" or least < 1e-8
    path = rng.uniform(-1, 1, (5, 7))
    proof = found.clearance(path)
    assert proof
    assert 0 < proof.margin < 1
    assert found.clearance(path[0])


def test_only_what_lies_within_the_limits_counts():
    arm = sa.load("mda6")
    found = sa.singular_set(arm)
    q = found.sample(500, np.random.default_rng(0))
    beyond = q[(q[:, 1] < -0.5)][0]  # joint 2 goes from 0 on
    step = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
    assert not found.is_free(beyond - step, beyond + step)
    assert found.is_free(beyond - step, beyond + step, limits=True)
    inside = q[((q > arm.lower + 0.1) & (q < arm.upper - 0.1)).all(axis=1)][0]
    assert not found.is_free(inside - step, inside + step, limits=True)
    through = found.clearance([beyond, inside - step, inside + step], limits=True)
    assert not through
    assert through.segment in (0, 1)


@pytest.mark.parametrize(("task", "n"), [("position", 4), ("orientation", 4)])
def test_searched_sets_have_proofs(task, n):
    arm = chain(6, n, task)
    found = sa.singular_set(arm)
    rng = np.random.default_rng(1)
    assert not found.complete
    for q in found.sample(3, rng):
        direction = rng.normal(size=n)
        assert not found.is_free(q - direction, q + direction)
    proofs = [found.is_free(*rng.uniform(-np.pi, np.pi, (2, n))) for _ in range(5)]
    assert all(proofs)


def test_plans_of_redundant_arms_are_proven():
    arm = sa.load("chaser7")
    q0 = np.array([0.1, 0.9, 0.2, 1.3, -0.4, 0.8, 0.3])
    plan = sa.plan(arm.at(q0), sa.Joints(q0 + 0.1), search=sa.Search(timeout=30))
    assert plan.certificate
    assert plan.certificate.verdict == "free"
    followed = sa.follow(arm.at(q0), [arm.at(q0).tip, arm.at(q0 + 0.02).tip])
    assert followed.certificate


# --- pictures -------------------------------------------------------------------------------


def test_curves_of_a_redundant_arm_over_three_joints():
    arm = sa.load("chaser7")
    found = sa.singular_set(arm)
    q = np.array([0.0, 0.4, -0.5, 0.3, 1.0, 2.0, 0.1])
    curves = found.curves(joints=["q4", "q5", "q6"], q=q)
    assert curves
    points = np.concatenate(curves)
    assert np.allclose(points[:, [0, 1, 2, 6]], q[[0, 1, 2, 6]])
    for row in points[:: len(points) // 25]:
        assert sigma_ratio(arm, row) < 1e-9
    for t in np.linspace(-3, 3, 12):  # every solution of the triangle lies on a curve
        q[3] = t
        for row in found.solve(q):
            assert np.abs(offsets(arm, points, row)).max(axis=1).min() < 0.2


@pytest.mark.slow
def test_slices_of_a_square_arm():
    found = sa.singular_set(sa.load("mda6"))
    q = np.array([0.2, 1.0, -1.0, 0.4, 0.3, 0.0])
    for curve in found.curves(joints=["q3", "q5"], q=q):
        assert (np.abs(found.S(curve)) < 1e-11 * found.S.scale).all()
        assert np.allclose(curve[:, [0, 1, 3, 5]], q[[0, 1, 3, 5]])
    mesh = found.surface(joints=[2, 3, 4], q=q)
    rows = np.tile(q, (len(mesh.vertices), 1))
    rows[:, 2:5] = mesh.vertices
    assert (np.abs(found.S(rows)) < 1e-11 * found.S.scale).all()


# --- triangles ------------------------------------------------------------------------------


def test_triangles_are_found_where_there_are_some():
    pose = [(4, 4, 3, 2, 1, 0, 0), (4, 4, 3, 2, 1, 1, 0)]
    assert find_triangle(pose) == ((0, 1), (4, 5))
    assert find_triangle(pose[::-1]) == ((1, 0), (4, 5))
    assert find_triangle([(4, 4, 4, 3), (4, 4, 4, 3)]) is None
    assert find_triangle([(1, 0), (0, 2)]) == ((0, 1), (0, 1))


@given(seeds)
def test_common_factors_are_found(seed):
    rng = np.random.default_rng(seed)
    p, r, s = (rng.normal(size=3) + 1j * rng.normal(size=3) for _ in range(3))
    alike = np.stack((np.convolve(p, r), np.convolve(p, s)), axis=1)
    assert share_root(alike)
    assert not share_root(np.stack((np.convolve(r, r), np.convolve(s, s)), axis=1))
    assert not share_root(np.zeros((3, 2)))


def test_a_polynomial_that_vanishes_along_a_whole_sheet():
    """sin q1 cos q2: the sheet sin q1 = 0 does not depend on q2."""
    c = np.zeros((3, 3), complex)
    c[0, [0, 2]], c[2, [0, 2]] = 0.25j, -0.25j
    triangle = Triangle((sa.TrigPolynomial(c),), (1,))
    assert triangle.sheets == (0,)
    Q = np.random.default_rng(0).uniform(-3, 3, (50, 2))
    main, sheet = triangle.solve(Q), triangle.solve(Q, sheet=0)
    assert np.allclose(np.cos(main[:, 1]), 0, atol=1e-12)
    assert np.allclose(np.sin(sheet[:, 0]), 0, atol=1e-12)
    assert len(main) == len(sheet) == 100


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "task"), [(0, "pose"), (3, "pose"), (1, "position")])
def test_a_few_minors_prove_what_all_of_them_do(seed, task):
    arm = chain(seed, 7, task) if task == "pose" else chain(seed, 5, task)
    rng, few = np.random.default_rng(seed), minors_of(arm, "free-floating").few
    assert len(few) >= arm.n - arm.task.k + 1
    for _ in range(3):
        path = rng.uniform(-np.pi, np.pi, arm.n) + np.outer([0.0, 0.5, 1.0], rng.normal(size=arm.n))
        proof = prove_regular(arm, path)
        assert proof.free
        assert sa.singular_set(arm).clearance(path).free
        for q in path[0] + np.linspace(0.0, 1.0, 50)[:, None] * (path[1] - path[0]):
            assert sigma_ratio(arm, q) > 0.0


@pytest.mark.slow
def test_where_few_minors_vanish_the_others_decide():
    """Few of them vanish where the columns that they have in common are dependent."""
    arm = chain(0, 7)
    q = sa.singular_set(arm).sample(1, np.random.default_rng(0))[0]
    proof = prove_regular(arm, q + np.outer([-0.3, 0.3], np.ones(7)))
    assert not proof.free
    np.testing.assert_allclose(proof.at, q, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("n", "task"), [(6, "position"), (7, "position"), (8, "pose")])
def test_paths_of_arms_with_millions_of_coefficients_are_proven_free(n, task):
    """By the smallest minors: free where sigma_min is not small, never through a singular one."""
    arm = chain(5, n, task)
    assert minors_of(arm, "free-floating").size > 5e6
    found, rng = sa.singular_set(arm), np.random.default_rng(n)
    way = np.vstack((np.zeros(n), rng.uniform(-1.0, 1.0, n)))
    assert found.is_free(way)
    assert min(sigma_ratio(arm, way[0] + s * way[1]) for s in np.linspace(0.0, 1.0, 50)) > 1e-6
    singular = lose_rank(arm, rng.uniform(-np.pi, np.pi, n), "free-floating")
    step = 0.2 * rng.normal(size=n)
    through = np.vstack((singular - step, singular, singular + step))
    proof = found.clearance(through)
    assert not proof.free
    np.testing.assert_allclose(proof.at, singular, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "n"), [(6, 8), (1, 9)])
def test_paths_of_arms_with_larger_minors_are_proven_free_by_momenta(seed, n):
    arm, rng = chain(seed, n, "position"), np.random.default_rng(seed)
    found = sa.singular_set(arm)
    for _ in range(3):
        way = rng.uniform(-1.0, 1.0, n) + np.outer([0.0, 0.5, 1.0], rng.normal(size=n))
        proof = found.clearance(way)
        assert proof.free
        assert found.clearance(way, limits=True).free
        Q = [way[0] + s * (way[1] - way[0]) for s in np.linspace(0.0, 1.0, 50)]
        assert min(sigma_ratio(arm, q) for q in Q) > 0.0
    singular = lose_rank(arm, rng.uniform(-np.pi, np.pi, n), "free-floating")
    step = 0.2 * rng.normal(size=n)
    through = found.clearance([singular - 2 * step, singular - step, singular + step])
    assert through.verdict == "undecided"
    assert through.segment == 1
    np.testing.assert_allclose(through.at, singular, atol=1e-3 * np.abs(step).max() * 2)
    assert prove_way(arm, "free-floating", straight(way), 0.1).clearance == 0.0


@pytest.mark.slow
def test_minors_that_are_mostly_rounding_leave_the_others_to_prove():
    """With 500 kg in the hand minors without the last joint are a million times as small."""
    arm = sa.load("chaser7", task="position").replace(payload=500.0)
    q = np.array([0.3, 0.8, -1.1, 0.4, 0.7, 0.2, 0.5])
    found = sa.singular_set(arm)
    assert isinstance(found, sa.FoundSet)
    assert found.is_free(q, q + 0.2)
    near = found.nearest(q)
    assert near.distance == sa.singularity(arm.at(q), exact=True).distance
    assert near.distance_proven > 0.2 * near.distance
    assert sa.connected(arm.at(q), arm.at(q + 0.2)).answer == "yes"
    box = sa.free_box(arm.at(q), within=(q - 0.1, q + 0.1))
    assert box.contains(q + np.linspace(-0.1, 0.1, 5)[:, None])


def test_a_clearance_that_no_minors_prove_is_refused():
    arm = chain(6, 8, "position")
    with pytest.raises(sa.UnsupportedError, match="could prove a clearance"):
        sa.singular_set(arm).is_free(np.zeros((2, 8)), clearance=0.1)
