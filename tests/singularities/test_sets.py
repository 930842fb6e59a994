"""The singularity polynomial and the singular set."""

import numpy as np
import pytest
from helpers import reference
from helpers.arms import (
    frame,
    joint,
    link,
    load_text,
    random_chain,
    random_inertia,
    robot,
    seeds,
    two_links,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree
from scipy.optimize import minimize

import spacearm as sa
from spacearm.polynomial import level_set
from spacearm.singularities.polynomials import radius_squared


def task_determinant(arm, q):
    return sa.singularity(arm.at(q)).determinant


def sigma_ratio(arm, q):
    sigma = sa.singularity(arm.at(q)).sigma
    return sigma[-1] / sigma[0]


def square_arm(seed, n):
    """A random spatial arm with a square task of n rows."""
    task = {2: "x ry", 3: "position", 4: "x y z rx", 5: "x y z rx ry", 6: "pose"}[n]
    return load_text(random_chain(seed, n, ("revolute",)), tip="tip", task=task)


# --- the polynomial -------------------------------------------------------------------------


def test_planar2_is_equation_41():
    S = sa.singularity_polynomial(sa.load("planar2"))
    assert S.degrees == (2, 1)
    Q = np.random.default_rng(41).uniform(-np.pi, np.pi, (1000, 2))
    wanted = reference.planar_singularity(*Q.T)
    factor = S(Q) @ wanted / (wanted @ wanted)
    assert np.abs(S(Q) - factor * wanted).max() < 1e-13 * np.abs(S(Q)).max()


@pytest.mark.slow
@given(seeds, st.integers(2, 5))
@settings(max_examples=20)
def test_it_is_the_determinant_of_the_whole_system(seed, n):
    """S = det [A_b A_q; J_b J_q] with the task's rows of J, up to a constant factor."""
    arm = square_arm(seed, n)
    S = sa.singularity_polynomial(arm)
    Q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (6, n))
    cfgs = [arm.at(q) for q in Q]
    whole = [np.vstack((c.A / arm.mass, arm.task.jacobian(c.J, np.eye(3)))) for c in cfgs]
    det, values = np.linalg.det(whole), S(Q)
    factor = values @ det / (det @ det)
    assert np.abs(values - factor * det).max() < 1e-9 * S.scale


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_degrees_of_a_full_pose_are_those_of_the_tip_rooted_form(seed):
    S = sa.singularity_polynomial(square_arm(seed, 6))
    assert S.degrees == (4, 4, 3, 2, 1, 0)


def with_inertia(text, name, mass, inertia):
    """The URDF text with the inertia of one link replaced."""
    start = text.index(f'<link name="{name}">')
    end = text.index("</link>", start)
    com = text[text.index('xyz="', start) + 5 :].split('"')[0].split()
    return (
        text[:start]
        + link(name, mass, [float(x) for x in com], inertia)[: -len("</link>")]
        + text[end:]
    )


def test_the_last_bodys_inertia_does_not_move_the_set_and_the_spacecrafts_does():
    text, rng = random_chain(11, 6, ("revolute",)), np.random.default_rng(11)
    arm = load_text(text, tip="tip")
    Q = sa.singular_set(arm).sample(20, rng)
    last = arm.tree.links["link_6"].mass
    heavier = load_text(with_inertia(text, "link_6", last, random_inertia(rng, 50.0)), tip="tip")
    assert max(sigma_ratio(heavier, q) for q in Q) < 1e-10
    stiff = arm.replace(base_inertia=3 * arm.model.inertias[1].inertia)
    assert max(sigma_ratio(stiff, q) for q in Q) > 1e-6


@pytest.mark.parametrize(
    ("arm", "message"),
    [
        (lambda: sa.load("chaser7"), r"7 joints for 6 task rows .*lock 1 joint.*'joint_7': 0.0"),
        (
            lambda: sa.load("planar2", task="pose"),
            r"impossible at every posture: rows z rx ry never .*'x y'",
        ),
        (lambda: sa.load("planar2", task="z rx"), "is impossible at every posture"),
        (
            lambda: load_text(robot(*two_links(kind="prismatic")), task="x"),
            r"joint elbow is prismatic, .* in its position; lock it: locked=\{",
        ),
        (
            lambda: load_text(random_chain(1, 2, ("prismatic",)), tip="tip", task="x y"),
            r"joints joint_1, joint_2 are prismatic, .* in their positions; lock them: locked=\{",
        ),
    ],
)
def test_arms_without_a_polynomial_are_told_why(arm, message):
    with pytest.raises(sa.UnsupportedError, match=message):
        sa.singularity_polynomial(arm())


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_tip_on_the_last_axis_makes_a_task_of_positions_impossible(seed):
    """The last column is rounding, and so is the determinant: no polynomial can be fitted."""
    text = etree.fromstring(random_chain(seed, 3, ("revolute",)).encode())
    axis = np.array(text.find("joint[@name='joint_3']/axis").get("xyz").split(), dtype=float)
    text.find("joint[@name='tip_joint']/origin").set("xyz", "{} {} {}".format(*0.7 * axis))
    arm = load_text(etree.tostring(text).decode(), tip="tip", task="position")
    with pytest.raises(sa.UnsupportedError, match="is impossible at every posture"):
        sa.singular_set(arm, mode="fixed")
    assert sa.singular_set(arm).sample(5).shape == (5, 3)  # a spacecraft that floats moves with it


def test_locked_joints_reduce_n():
    arm = sa.load("chaser7", locked={"joint_3": 0.4})
    S = sa.singularity_polynomial(arm)
    assert S.n == 6
    Q = sa.singular_set(arm).sample(50, np.random.default_rng(0))
    assert max(sigma_ratio(arm, q) for q in Q) < 1e-10


@pytest.mark.slow
def test_parallel_and_intersecting_axes_and_light_links():
    """mda6 has parallel axes; links of a millionth of the spacecraft's mass are no obstacle."""
    text = random_chain(5, 6, ("revolute",))
    rng = np.random.default_rng(5)
    for i in (2, 4, 6):
        text = with_inertia(text, f"link_{i}", 1e-6, random_inertia(rng, 1e-6))
    for arm in (sa.load("mda6"), sa.load("ets7"), load_text(text, tip="tip")):
        Q = sa.singular_set(arm).sample(80, rng)
        everywhere = rng.uniform(-np.pi, np.pi, (80, 6))
        median = np.median([sa.singularity(arm.at(q)).sigma_min for q in everywhere])
        worst = max(sa.singularity(arm.at(q)).sigma_min for q in Q)
        assert worst < 1e-10 * median


def scaled(text, mass, length):
    """A URDF text with all masses and lengths multiplied."""
    root = etree.fromstring(text.encode())
    for element in root.iter("mass", "inertia", "origin"):
        for name, value in element.attrib.items():
            factor = {"value": mass, "xyz": length, "rpy": 1.0}.get(name, mass * length**2)
            element.set(name, " ".join(repr(float(word) * factor) for word in value.split()))
    return etree.tostring(root).decode()


@pytest.mark.filterwarnings("ignore::spacearm.errors.ModelWarning")  # what no spacecraft is
@pytest.mark.parametrize(("mass", "length"), [(1e-9, 1.0), (1.0, 1e-60), (1e5, 1e2), (1e-8, 1e4)])
def test_tiny_and_huge_arms_have_the_same_set(mass, length):
    """Coefficients must not leave the range of floating-point numbers."""
    text = random_chain(21, 3, ("revolute",))
    arm = load_text(text, tip="tip", task="position")
    other = load_text(scaled(text, mass, length), tip="tip", task="position")
    S, T = sa.singularity_polynomial(arm), sa.singularity_polynomial(other)
    assert S.degrees == T.degrees
    assert np.allclose(S.coefficients / S.scale, T.coefficients / T.scale, atol=1e-12)


@pytest.mark.slow
def test_a_hundred_thousand_explicit_singular_configurations():
    arm = sa.load("mda6")
    rng = np.random.default_rng(100_000)
    Q = sa.singular_set(arm).sample(100_000, rng)
    everywhere = rng.uniform(-np.pi, np.pi, (2000, 6))
    worst, median = (
        reduce_(np.linalg.svd(jacobians(arm, rows), compute_uv=False)[:, -1])
        for rows, reduce_ in ((Q[::10], np.max), (everywhere, np.median))
    )
    assert worst < 1e-10 * median


def jacobians(arm, Q):
    """(m, k, n) task Jacobians, one by one."""
    task = arm.task
    return np.array([task.jacobian(sa.generalized_jacobian(arm.at(q)), np.eye(3)) for q in Q])


# --- completeness ---------------------------------------------------------------------------


@pytest.mark.slow
@given(seeds, st.integers(2, 6))
@settings(max_examples=15)
def test_every_sign_change_along_a_joint_is_a_root_and_every_root_is_singular(seed, n):
    arm = square_arm(seed, n)
    found = sa.singular_set(arm)
    rng = np.random.default_rng(seed)
    q, j = rng.uniform(-np.pi, np.pi, n), int(rng.integers(n))
    t = np.linspace(-np.pi, np.pi, 181)
    line = np.tile(q, (len(t), 1))
    line[:, j] = t
    values = np.array([task_determinant(arm, row) for row in line])
    roots = found.roots(q, j)
    if roots.everywhere:
        return
    real = np.abs(values) > 1e-9 * np.abs(values).max()
    for i in range(len(t) - 1):
        if real[i] and real[i + 1] and values[i] * values[i + 1] < 0:
            assert ((roots.angles >= t[i]) & (roots.angles <= t[i + 1])).any()
    for root in roots.angles:
        q[j] = root
        assert sigma_ratio(arm, q) < 1e-7


@pytest.mark.slow
@given(seeds, st.integers(3, 6), st.integers(2, 3))
@settings(max_examples=12)
def test_every_sign_change_of_a_slice_is_a_root(seed, n, dimension):
    """On a grid over 2 or 3 random joints, by the determinant, along every one of them."""
    arm = square_arm(seed, n)
    S = sa.singularity_polynomial(arm)
    rng = np.random.default_rng(seed)
    chosen = rng.choice(n, dimension, replace=False)
    N = 24 if dimension == 2 else 9
    t = np.linspace(-np.pi, np.pi, N)
    grid = np.stack(np.meshgrid(*[t] * dimension, indexing="ij"), axis=-1)
    Q = np.tile(rng.uniform(-np.pi, np.pi, n), (*grid.shape[:-1], 1))
    Q[..., chosen] = grid
    det = np.linalg.det(jacobians(arm, Q.reshape(-1, n))).reshape(grid.shape[:-1])
    sure = np.abs(det) > 1e-9 * np.abs(det).max()
    for axis, joint_number in enumerate(chosen):
        lines = np.moveaxis(Q, axis, 0)[0].reshape(-1, n)
        values, certain = (np.moveaxis(a, axis, 0).reshape(N, -1) for a in (det, sure))
        roots = S.roots_along(lines, int(joint_number))
        changes = (values[1:] * values[:-1] < 0) & certain[1:] & certain[:-1]
        for step, line in np.argwhere(changes):
            assert ((roots[line] >= t[step]) & (roots[line] <= t[step + 1])).any()


@pytest.mark.slow
@given(seeds)
@settings(max_examples=10)
def test_curves_of_a_slice_hold_every_sign_change_of_a_grid(seed):
    """Two random joints of a random arm: the curves separate what the determinant separates."""
    rng = np.random.default_rng(seed)
    arm = square_arm(seed, 3)
    joint_number = int(rng.integers(3))
    S = sa.singularity_polynomial(arm).fix({joint_number: rng.uniform(-np.pi, np.pi)})
    curves = level_set.lines(S)
    points = np.concatenate(curves) if curves else np.empty((0, 2))
    assert (np.abs(S(points)) < 1e-12 * S.scale).all() if len(points) else True
    N = 60
    t = 2 * np.pi * np.arange(N) / N
    grid = np.stack(np.meshgrid(t, t, indexing="ij"), axis=-1).reshape(-1, 2)
    signs = np.sign(S(grid)).reshape(N, N)
    for axis in (0, 1):
        changes = np.argwhere(signs * np.roll(signs, -1, axis=axis) < 0)
        for index in changes[:: max(1, len(changes) // 40)]:
            middle = (index + 0.5 * np.eye(2)[axis]) * 2 * np.pi / N
            gaps = np.abs(np.angle(np.exp(1j * (points - middle)))).max(axis=1)
            assert gaps.min() < 2 * np.pi / N


@pytest.mark.parametrize("name", ["planar2", "planar3"])
def test_curves_are_whole_and_closed(name):
    found = sa.singular_set(sa.load(name))
    curves = found.curves()
    assert len(curves) == 2
    for curve in curves:
        assert (np.abs(found.S(curve)) < 1e-12 * found.S.scale).all()
        turns = (curve[-1] - curve[0]) / (2 * np.pi)
        assert np.allclose(turns, np.round(turns), atol=1e-9)
        assert abs(turns[0]) == pytest.approx(1)  # each goes once round joint 1
        assert (np.abs(np.diff(curve, axis=0)).max(axis=1) < 0.1).all()


def test_small_islands_are_not_missed():
    """cos q1 + cos q2 = 1.9999: one oval a hundredth of a radian wide."""
    c = np.zeros((3, 3), complex)
    c[0, 1] = c[2, 1] = c[1, 0] = c[1, 2] = 0.5
    c[1, 1] = -1.9999
    (oval,) = level_set.lines(sa.TrigPolynomial(c))
    offset = np.angle(np.exp(1j * oval))
    assert np.linalg.norm(offset, axis=1).max() == pytest.approx(np.sqrt(2e-4), rel=1e-2)
    assert np.allclose(oval[0], oval[-1], atol=1e-9)


def test_shells_of_planar2_from_its_components():
    """Equations (46) and (47) of the paper, to the digits of theory."""
    components = sa.singular_set(sa.load("planar2")).components()
    shells = sorted(tuple(component.radius) for component in components)
    assert shells[0] == pytest.approx((0.3510638, 0.5536773), abs=5e-8)
    assert shells[1] == pytest.approx((1.4361702, 2.2872340), abs=5e-8)
    inner = min(components, key=lambda component: component.radius[0])
    widest = np.degrees(np.angle(np.exp(1j * inner.at[1])))
    assert np.abs(widest) == pytest.approx([81.7116, 172.1288], abs=1e-4)


@pytest.mark.slow
def test_ranges_of_components_are_those_that_are_proven():
    """The workspace's bounds are proven by boxes; a search that ends early falls short of them."""
    arm = square_arm(19, 3)
    components, proven = sa.singular_set(arm).components(), sa.workspace(arm)
    assert proven.kind == "certified"
    low = min(component.radius[0] for component in components)
    high = max(component.radius[1] for component in components)
    assert low == pytest.approx(min(end for end, _ in proven.pdw), abs=1e-6)
    assert high == pytest.approx(max(end for _, end in proven.pdw), abs=1e-6)
    for component in components:
        R = [np.linalg.norm((c := arm.at(q)).tip.translation - c.com) for q in component.at]
        np.testing.assert_allclose(R, component.radius, atol=1e-9)
        assert (np.abs(sa.singular_set(arm).S(component.at)) < 1e-9).all()


@pytest.mark.slow
def test_surface_is_a_closed_mesh_on_the_set(monkeypatch):
    arm = square_arm(19, 3)
    found = sa.singular_set(arm)
    mesh = found.surface()
    monkeypatch.setattr(type(found), "surface", lambda _: mesh)  # once is enough
    assert (np.abs(found.S(mesh.vertices)) < 1e-12 * found.S.scale).all()
    edges = np.sort(np.vstack([mesh.triangles[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert (count == 2).all()
    for component in found.components():
        sample = component.points[:: max(1, len(component.points) // 200)]
        R = [np.linalg.norm((c := arm.at(q)).tip.translation - c.com) for q in sample]
        assert component.radius[0] - 1e-9 <= min(R)
        assert max(R) <= component.radius[1] + 1e-9
    with pytest.raises(sa.UnsupportedError, match=r"over 2 joints, not 3; name 2"):
        found.curves()


def test_sample_covers_the_set_and_repeats_with_its_seed():
    found = sa.singular_set(sa.load("planar2"))
    Q = found.sample(500, np.random.default_rng(1))
    again = found.sample(500, np.random.default_rng(1))  # sums may be compiled meanwhile
    np.testing.assert_allclose(again, Q, atol=1e-12)
    assert (np.abs(found.S(Q)) < 1e-12 * found.S.scale).all()
    bins = np.histogram(Q[:, 0], bins=12, range=(-np.pi, np.pi))[0]
    assert bins.min() > 15
    assert len(found.sample(0)) == 0


# --- certificates ---------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "segments"), [("planar2", 2000), ("planar3", 1000), ("mda6", 600)]
)
def test_certificates_against_a_dense_scan(name, segments):
    """Random segments: free ones have no sign change, blocked ones a singularity."""
    found = sa.singular_set(sa.load(name))
    rng = np.random.default_rng(7)
    t = np.linspace(0, 1, 200)[:, None]
    free = 0
    for _ in range(segments):
        q0, q1 = rng.uniform(-np.pi, np.pi, (2, found.S.n))
        q1 = q0 + rng.uniform(0.05, 0.6) * (q1 - q0)
        certificate = found.is_free(q0, q1)
        values = found.S(q0 + t * (q1 - q0))
        if certificate:
            free += 1
            assert (values > 0).all() or (values < 0).all()
        else:
            assert abs(found.S(certificate.at)) < 1e-12 * found.S.scale
            passed = values[: 1 + int(199 * progress(certificate.at, q0, q1))]
            assert (passed > -1e-12 * found.S.scale).all() or (passed < 1e-12 * found.S.scale).all()
    assert segments // 10 < free < segments


def progress(at, q0, q1):
    return float((at - q0) @ (q1 - q0) / ((q1 - q0) @ (q1 - q0))) - 1e-9


def test_clearance_of_a_path_names_the_segment():
    found = sa.singular_set(sa.load("planar2"))
    path = np.radians([[0, 60], [30, 90], [60, 60], [60, -60]])
    certificate = found.clearance(path)
    assert not certificate.free
    assert certificate.segment == 2
    assert abs(found.S(certificate.at)) < 1e-12 * found.S.scale
    good = found.clearance(path[:3])
    assert good
    assert good.at is None
    assert 0 < good.margin < 1
    assert found.clearance(path[0])
    on_the_set = found.sample(1, np.random.default_rng(0))
    assert not found.clearance(on_the_set)
    with pytest.raises(sa.ConfigurationError, match="path"):
        found.clearance([[1, 2, 3]])


def test_a_segment_that_only_touches_is_blocked():
    c = np.array([-0.5, 1, -0.5], complex)  # 1 - cos q: touches zero at 0
    from spacearm.polynomial.certificate import certify
    from spacearm.polynomial.jets import Chart, Jets

    touch = certify([Jets(sa.TrigPolynomial(c), Chart.turning(1))], np.array([[-1.0], [1.0]]))
    assert not touch
    assert abs(touch.at[0]) < 1e-5


# --- nearest --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "planar3"])
def test_nearest_is_global(name):
    found = sa.singular_set(sa.load(name))
    rng = np.random.default_rng(2)
    points = np.concatenate(found.curves())
    for q in rng.uniform(-np.pi, np.pi, (10, found.S.n)):
        near = found.nearest(q)
        nearest, distance = near.q, near.distance
        assert abs(found.S(nearest)) < 1e-12 * found.S.scale
        assert np.linalg.norm(nearest - q) == pytest.approx(distance)
        relevant = list(found.relevant)
        offsets = np.angle(np.exp(1j * (points - q)))[:, relevant]
        assert distance <= np.linalg.norm(offsets, axis=1).min() + 1e-9


@pytest.mark.slow
def test_nearest_beside_a_valley_of_sigma_min_that_leads_nowhere():
    """sigma_min becomes small there and does not vanish; the set seems near and is far."""
    arm = sa.load("mda6")
    found = sa.singular_set(arm)
    valley = np.array([0.4881274, 1.8919902, 2.7440739, -2.6875366, -0.0001708, 1.5337097])
    rng = np.random.default_rng(0)
    for q in (valley, *(valley + 0.05 * rng.normal(size=(4, 6)))):
        distance = found.nearest(q).distance
        others = [_by_slsqp(found.S, q, 0.3 * rng.normal(size=6)) for _ in range(4)]
        assert distance <= min(others) + 1e-6


def _by_slsqp(S, q, start) -> float:
    """Return the distance of a root of S to which SLSQP comes from an offset, inf if to none."""
    unit = S.scale * 1e-3
    found = minimize(
        lambda x: x @ x,
        start,
        jac=lambda x: 2.0 * x,
        constraints={
            "type": "eq",
            "fun": lambda x: S(q + x) / unit,
            "jac": lambda x: S.gradient(q + x) / unit,
        },
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-14},
    )
    return float(np.linalg.norm(found.x)) if abs(S(q + found.x)) < 1e-9 * unit else np.inf


@pytest.mark.slow
def test_nearest_of_a_spatial_arm_beats_a_blind_search():
    found = sa.singular_set(sa.load("mda6"))
    rng = np.random.default_rng(3)
    sample = found.sample(20_000, rng)
    for q in rng.uniform(-np.pi, np.pi, (3, 6)):
        near = found.nearest(q)
        nearest, distance = near.q, near.distance
        assert abs(found.S(nearest)) < 1e-12 * found.S.scale
        offsets = np.angle(np.exp(1j * (sample - q)))
        assert distance <= np.linalg.norm(offsets, axis=1).min() + 1e-9


# --- redundant arms -------------------------------------------------------------------------


def test_a_whole_turn_of_a_joint_that_another_follows_is_none():
    half = '<mimic joint="elbow" multiplier="0.5"/>'
    hand = (link("hand"), joint("wrist", "arm", "hand", "continuous", inside=half))
    arm = load_text(robot(*two_links(), *hand), task="x")
    found = sa.singular_set(arm)
    for q in np.linspace(-6.0, 6.0, 9):
        near = found.nearest([q])
        nearest, distance = near.q, near.distance
        assert sa.singularity(arm.at(nearest)).sigma_min <= 1e-10  # its Jacobian is one number
        assert abs(nearest[0] - q) == pytest.approx(distance)


def test_redundant_arms_lose_rank_where_all_maximal_minors_vanish():
    arm = sa.load("chaser7")
    found = sa.singular_set(arm).sample(3, np.random.default_rng(1))
    sizes = []
    for q in (*np.random.default_rng(2).uniform(-3, 3, (3, arm.n)), *found):
        cfg = arm.at(q)
        whole = np.vstack((cfg.A, cfg.J))
        minors = [np.linalg.det(np.delete(whole, j, axis=1)) for j in range(6, 6 + arm.n)]
        J_star = sa.generalized_jacobian(cfg)
        squares = np.linalg.det(J_star @ J_star.T) * np.linalg.det(cfg.A[:, :6]) ** 2
        sizes.append(np.square(minors).sum())
        assert sizes[-1] == pytest.approx(squares, rel=1e-7, abs=1e-12 * sizes[0])
    assert max(sizes[3:]) < 1e-15 * min(sizes[:3])


def test_joints_are_named_or_numbered():
    found = sa.singular_set(sa.load("planar2"))
    by_name, by_number = found.roots([0.1, 0.2], "joint_1"), found.roots([0.1, 0.2], 0)
    assert np.array_equal(by_name.angles, by_number.angles)
    assert "degrees (2, 1)" in repr(found)
    for bad in ("elbow", 2, -1):
        with pytest.raises(sa.ConfigurationError, match="joint"):
            found.roots([0, 0], bad)


# --- one interface, one fit -----------------------------------------------------------------


def test_a_polynomial_is_fitted_once_however_its_mode_is_spelled(monkeypatch):
    """Also by the sets, maps and workspaces that need it."""
    arm, fits = sa.load("planar2").replace(base_mass=41.25), []  # none has been fitted before
    fit_each = sa.TrigPolynomial.fit_each.__func__

    def counted(cls, *args, **options):
        fits.append(args)
        return fit_each(cls, *args, **options)

    monkeypatch.setattr(sa.TrigPolynomial, "fit_each", classmethod(counted))
    S = sa.singularity_polynomial(arm)
    assert sa.singularity_polynomial(arm, mode="free-floating") is S
    assert sa.singularity_polynomial(arm=arm, mode="free-floating") is S
    assert sa.singular_set(arm).S is S
    sa.singular_map(arm, points=3)
    assert len(fits) == 1
    R2 = radius_squared(arm)
    assert radius_squared(arm, mode="free-floating") is R2
    assert radius_squared(arm=arm, mode="free-floating") is R2
    assert len(fits) == 2
    sa.workspace(arm)
    assert len(fits) == 2
    assert sa.singularity_polynomial(arm, mode="fixed") is not S


def test_a_searched_set_says_why_it_has_no_more():
    half = '<mimic joint="elbow" multiplier="0.5"/>'
    hand = (link("hand"), joint("wrist", "arm", "hand", "continuous", inside=half))
    mimicking = load_text(robot(*two_links(), *hand), task="x")
    redundant = load_text(random_chain(2, 4, ("revolute",)), tip="tip", task="position")
    for arm, why in ((mimicking, "joints that mimic"), (redundant, "4 joints for 3 task rows")):
        found = sa.singular_set(arm)
        assert isinstance(found, sa.SingularSet)
        assert isinstance(found, sa.FoundSet)
        assert not found.complete
        q = np.zeros(found.arm.n)
        for name in ("S", "relevant", "dimension"):
            with pytest.raises(sa.UnsupportedError, match=why + r".*only \.sample, \.nearest"):
                getattr(found, name)
        for ask in (found.roots, found.solve, found.curves, found.surface, found.components):
            with pytest.raises(sa.UnsupportedError, match=why + r".*only \.sample, \.nearest"):
                ask(q)
        assert found.to_dict()["complete"] is False
    with pytest.raises(sa.UnsupportedError, match="joints mimic others"):
        sa.singular_set(mimicking, mode="fixed").is_free([0.0], [1.0])


def test_paths_of_arms_with_mimic_joints_are_proven_free():
    """One joint that another follows half as far: stretched out, the hand cannot move along x."""
    half = '<mimic joint="elbow" multiplier="0.5"/>'
    hand = (link("hand"), joint("wrist", "arm", "hand", "continuous", inside=half))
    arm = load_text(robot(*two_links(), *hand), task="x")
    found = sa.singular_set(arm)
    for ends in ([-3.0, -1e-3], [1e-3, 2.5]):
        assert found.is_free(*np.array(ends)[:, None])
    through = found.is_free([-0.4], [0.7])
    assert through.verdict == "singular"
    np.testing.assert_allclose(through.at, 0.0, atol=1e-9)
    assert through.segment == 0


@pytest.mark.slow
def test_a_search_that_finds_nothing_ends_soon_and_says_why():
    """Where one row loses rank all 7 rates of turn vanish at once: nowhere, as a rule."""
    arm = load_text(random_chain(0, 7, ("revolute",)), tip="tip", task="rz")
    with pytest.raises(sa.NoSolutionError, match=r"0 of 50 .* from 100 starts.* 7 equations in 7"):
        sa.singular_set(arm).sample(50)


def test_an_exact_set_is_complete():
    found = sa.singular_set(sa.load("planar2"))
    assert isinstance(found, sa.SingularSet)
    assert not isinstance(found, sa.FoundSet)
    assert found.complete


def heavy_end(mass):
    """A spatial 3R arm on a light spacecraft, whose last link is heavy: the tip hardly moves."""
    links = (link("bus", 1.0), link("a"), link("b"), link("end", mass), frame("tip"))
    joints = (
        joint("j1", "bus", "a", axis=(0, 0, 1)),
        joint("j2", "a", "b", axis=(0, 1, 0)),
        joint("j3", "b", "end", axis=(1, 0, 0), xyz=(0.3, 0.2, 0.1)),
        joint("fixed", "end", "tip", "fixed", (0.1, 0.2, 0.3)),
    )
    return load_text(robot(*links, *joints), tip="tip", task="x y z")


def test_a_determinant_lost_in_rounding_leaves_a_set_that_is_searched():
    assert sa.singular_set(heavy_end(1e5)).complete
    arm = heavy_end(1e9)
    found = sa.singular_set(arm)
    assert not found.complete
    assert found.sample(2).shape == (2, 3)
    path = [[0.3, 0.4, 0.5], [0.35, 0.4, 0.5]]
    assert found.clearance(path).verdict != "free"
    lost = r"r.*determinant of J\*.*'x y z'.*lost in rounding.*1 to 1e\+09 kg; check masses"
    with pytest.raises(sa.UnsupportedError, match=lost):
        sa.singularity_polynomial(arm)
    with pytest.raises(sa.UnsupportedError, match=lost):
        found.components()
    assert sa.workspace(arm, effort=200).kind == "sampled"


def test_the_distance_of_the_tip_is_no_polynomial_of_a_slide():
    slide = joint("rail", "arm", "end", "prismatic")
    arm = load_text(robot(*two_links(), link("end"), slide), tip="end", task="x y")
    with pytest.raises(sa.UnsupportedError, match=r"r: the distance of the tip.*locked="):
        radius_squared(arm)
