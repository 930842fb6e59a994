"""Uncertain arms: polynomials in the parameters, proofs against a million samples, shells."""

import numpy as np
import pytest
from helpers.arms import load_text, random_chain
from scipy.stats import norm, uniform

import spacearm as sa
from spacearm.uncertainty.family import family_of

SPREAD = {"link_1": {"mass": 0.2, "inertia": 0.1}, "link_2": {"mass": (2.0, 4.0)}}


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


@pytest.fixture(scope="module")
def about(arm):
    return sa.uncertain(arm, SPREAD)


def signs_of_samples(about, path, m, seed=0):
    """The signs of det J* (with the sign of S) for random arms at random places of a path."""
    family = family_of(about)
    rng = np.random.default_rng(seed)
    shares = about.sample(m, rng)
    i, s = rng.integers(0, len(path) - 1, 100), rng.uniform(size=100)
    places = path[i] + s[:, None] * (path[i + 1] - path[i])
    return np.concatenate([np.sign(family(q, shares)) for q in places])


# --- the arms -------------------------------------------------------------------------------


def test_the_middle_of_symmetric_intervals_is_the_arm_as_described(arm):
    about = sa.uncertain(arm, {"link_1": {"mass": 0.2, "inertia": 0.1, "com": 0.05}})
    middle = about.realise(np.full(5, 0.5))
    q = [0.3, 0.8]
    np.testing.assert_allclose(
        sa.generalized_jacobian(middle.at(q)), sa.generalized_jacobian(arm.at(q)), atol=1e-13
    )


def test_values_go_where_they_belong(arm, about):
    masses = {p.name: p for p in about.parameters}
    assert masses["mass of link_2"].low == 2.0
    assert masses["mass of link_1"].high == pytest.approx(1.2 * arm.tree.links["link_1"].mass)
    light, heavy = about.realise([0, 0, 0]), about.realise([1, 1, 1])
    part, other = light.tree.links["link_1"], heavy.tree.links["link_1"]
    assert other.mass / part.mass == pytest.approx(1.2 / 0.8)
    ratio = other.inertia[2, 2] / part.inertia[2, 2]
    assert ratio == pytest.approx(1.2 / 0.8 * 1.1 / 0.9)
    shifted = sa.uncertain(arm, {"link_1": {"com": [0.02, 0, 0]}}).realise([1.0])
    assert shifted.tree.links["link_1"].origin.translation[0] == pytest.approx(
        arm.tree.links["link_1"].origin.translation[0] + 0.02
    )


def test_distributions_are_drawn_from_and_proofs_cover_their_interval(arm):
    laws = {"mass": norm(4.0, 0.2), "com": [norm(0.0, 0.01), 0, 0.02], "inertia": uniform(0.9, 0.2)}
    about = sa.uncertain(arm, {"link_1": laws})
    found = {p.name: p for p in about.parameters}
    assert found["mass of link_1"].low == pytest.approx(3.4, abs=1e-4)
    assert found["mass of link_1"].high == pytest.approx(4.6, abs=1e-4)
    assert found["inertia of link_1"].low == pytest.approx(0.9003, abs=1e-4)
    assert [p.kind for p in about.parameters] == ["mass", "com x", "com z", "inertia"]
    shares = about.sample(20_000, np.random.default_rng(0))
    assert shares.min() >= 0.0
    assert shares.max() <= 1.0
    values = about.values(shares)
    np.testing.assert_allclose(values[:, :2].mean(axis=0), [4.0, 0.0], atol=0.005)
    np.testing.assert_allclose(values[:, :2].std(axis=0), [0.2, 0.01], rtol=0.03, atol=0)
    assert np.percentile(values[:, 3], 25) == pytest.approx(0.95, abs=0.005)
    q = np.radians([-65, 30])
    near = sa.distance_range(sa.uncertain(arm, {"link_1": {"mass": norm(4.0, 0.2)}}), q, samples=40)
    assert near.low <= near.percentile(5) < near.percentile(95) <= near.high
    assert (near.random, near.tried) == (40, 42)


@pytest.mark.parametrize(
    ("spread", "message"),
    [
        ({"mass": norm(0.0, 1.0)}, "mass of link_1 has a distribution from -3 to 3"),
        ({"inertia": norm(1.0, np.nan)}, "inertia of link_1 has a distribution from nan"),
        ({"com": [norm(0.0, 1.0), 0.0]}, "com of link_1"),
    ],
)
def test_distributions_that_make_no_sense_are_refused(arm, spread, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.uncertain(arm, {"link_1": spread})


# --- the polynomials ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["mass", "inertia", "com"])
def test_the_family_is_the_determinant_of_every_arm(arm, kind):
    """Up to a positive factor of each arm: the ratio at two postures is that of det(A_b) det J*."""
    about = sa.uncertain(arm, {"link_1": {kind: 0.1}, "link_2": {kind: 0.05}})
    if kind == "com":
        about = sa.uncertain(arm, {"link_1": {"com": [0.1, 0.0, 0.0]}})
    family, rng = family_of(about), np.random.default_rng(3)
    for t in about.sample(5, rng):
        one = about.realise(t)
        q = rng.uniform(-np.pi, np.pi, (2, 2))
        S = [
            np.linalg.det(sa.generalized_jacobian(one.at(x))[:2])
            * sa.momentum_matrix(one.at(x)).A_b[5, 5]
            for x in q
        ]
        got = [family(x, t[None])[0] for x in q]
        assert got[0] / got[1] == pytest.approx(S[0] / S[1], rel=1e-9)


def test_values_lie_between_the_bernstein_coefficients_and_corners_are_attained(about):
    family, rng = family_of(about), np.random.default_rng(0)
    for q in rng.uniform(-np.pi, np.pi, (20, 2)):
        values = family(q, about.sample(2000, rng))
        bounds = [f(q) for f in family.control]
        slack = 1e-12 * family.control[0].scale
        assert min(bounds) - slack <= values.min() <= values.max() <= max(bounds) + slack
        numbers, corners = family.corners()
        np.testing.assert_allclose(
            family(q, corners), [bounds[i] for i in numbers], rtol=1e-9, atol=slack
        )
        left, right = family.halves(0)
        inside = about.sample(50, rng)
        for half, share in ((left, 0.5 * inside[:, 0]), (right, 0.5 + 0.5 * inside[:, 0])):
            at = np.column_stack((share, inside[:, 1:]))
            np.testing.assert_allclose(half(q, at), family(q, at), rtol=1e-9, atol=slack)


# --- proofs ---------------------------------------------------------------------------------


def test_a_proof_holds_for_a_million_samples(about):
    path = np.radians([[-65.0, 40.0], [0.0, 60.0], [60.0, 90.0]])
    proof = sa.is_free_for_all(about, path)
    assert proof.free
    assert proof.verdict == "free"
    signs = signs_of_samples(about, path, 10_000)  # of 100 places each
    assert len(signs) == 1_000_000
    assert len(set(signs)) == 1


def test_a_counterexample_is_one(arm, about):
    """A path that is free for the arm as described, and not for others."""
    nominal = sa.singular_set(arm)
    near = np.radians([[-65.0, -11.0], [-64.0, -10.9]])
    assert nominal.is_free(*near)
    verdict = sa.is_free_for_all(about, near)
    assert not verdict.free
    assert verdict.verdict == "singular"
    shares = [(verdict.values[p.name] - p.low) / (p.high - p.low) for p in about.parameters]
    there = about.realise(np.clip(shares, 0.0, 1.0))
    assert sa.singularity(there.at(verdict.at)).distance < 1e-6
    signs = signs_of_samples(about, near, 10_000)
    assert set(signs) == {-1.0, 1.0}


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 2))])
def test_proofs_of_random_spatial_arms(seed):
    arm = load_text(random_chain(seed, 3), tip="tip", task="position")
    about = sa.uncertain(arm, {"link_3": {"mass": 0.3}, "bus": {"inertia": 0.2}})
    rng = np.random.default_rng(seed)
    for _ in range(4):
        start = rng.uniform(-np.pi, np.pi, 3)
        path = np.array([start, start + rng.uniform(-0.3, 0.3, 3)])
        verdict = sa.is_free_for_all(about, path)
        signs = set(signs_of_samples(about, path, 500))
        if verdict.free:
            assert len(signs) == 1
        if len(signs) == 2:
            assert verdict.verdict == "singular"


def test_certainty_is_a_narrow_interval(arm):
    almost = sa.uncertain(arm, {"link_2": {"mass": 1e-9}})
    S = sa.singular_set(arm)
    rng = np.random.default_rng(5)
    for _ in range(6):
        path = rng.uniform(-np.pi, np.pi, (2, 2))
        assert sa.is_free_for_all(almost, path).free == bool(S.is_free(*path))


# --- distances, shells, plans ---------------------------------------------------------------


def test_the_range_of_the_distance_holds_that_of_the_arm(arm, about):
    q = np.radians([-65.0, 30.0])
    found = sa.distance_range(about, q, samples=30)
    assert found.low <= found.nominal <= found.high
    assert found.nominal == pytest.approx(sa.singularity(arm.at(q)).distance)
    shares = [(found.least[p.name] - p.low) / (p.high - p.low) for p in about.parameters]
    worst = about.realise(np.clip(shares, 0, 1))
    assert sa.singularity(worst.at(q)).distance == pytest.approx(found.low)
    narrow = sa.uncertain(arm, {"link_1": {"mass": 0.02}})
    less = sa.distance_range(narrow, q, samples=30)
    assert less.high - less.low < found.high - found.low


def test_the_range_begins_at_zero_where_one_of_the_arms_is_singular(arm):
    """The determinant changes its sign between two arms; the singular one between is named."""
    about = sa.uncertain(arm, {"link_1": {"mass": 0.1}, "link_2": {"mass": 0.1}})
    posture = sa.singularity(arm.at(np.radians([-65.0, 30.0])), exact=True).nearest
    singular = 0
    for offset in np.radians([-3.0, -0.6, -0.25, 0.2, 0.35, 3.0]):
        q = posture + np.array([0.0, offset])
        signs = {
            np.sign(sa.singularity(about.realise([a, b]).at(q)).determinant)
            for a in np.linspace(0.0, 1.0, 9)
            for b in np.linspace(0.0, 1.0, 9)
        }
        found = sa.distance_range(about, q, samples=3)
        assert found.singular == (found.low == 0.0) == (len(signs) == 2)
        if found.singular:
            singular += 1
            assert found.distances.min() > 0.0
            shares = [(found.least[p.name] - p.low) / (p.high - p.low) for p in about.parameters]
            assert sa.singularity(about.realise(shares).at(q)).distance < 1e-9
            assert found.describe().verdict.startswith("0°, an arm between is singular,")
        else:
            assert "to first order" in found.describe().verdict
    assert 1 <= singular <= 4


def test_shells_become_bands_around_those_of_the_arm(arm):
    about = sa.uncertain(arm, {"link_2": {"mass": 0.1}})
    bands = sa.shell_bands(about, samples=4)
    pdw = sa.workspace(arm).pdw
    assert ((bands.low[:, 0] <= pdw[:, 0]) & (pdw[:, 0] <= bands.low[:, 1])).all()
    assert ((bands.high[:, 0] <= pdw[:, 1]) & (pdw[:, 1] <= bands.high[:, 1])).all()
    assert (np.diff(bands.low, axis=1) > 0.0).all()
    assert np.diff(bands.always).sum() < np.diff(pdw).sum() < np.diff(bands.sometimes).sum()


@pytest.mark.slow
def test_a_robust_plan_is_free_for_every_arm(about):
    plan, proof = sa.robust_plan(about, about.arm.at([0.3, 1.2]), sa.Joints([0.6, 0.9]))
    assert proof.free
    assert len(set(signs_of_samples(about, plan.q, 1000))) == 1


def test_bad_input(arm, about):
    with pytest.raises(sa.ModelError, match="'nothing' has no mass"):
        sa.uncertain(arm, {"nothing": {"mass": 0.1}})
    with pytest.raises(sa.ConfigurationError, match="kind"):
        sa.uncertain(arm, {"link_1": {"colour": 0.1}})
    with pytest.raises(sa.ConfigurationError, match="mass of link_1 is 2"):
        sa.uncertain(arm, {"link_1": {"mass": 2}})
    with pytest.raises(sa.ConfigurationError, match="growing bounds"):
        sa.uncertain(arm, {"link_1": {"mass": (3.0, 2.0)}})
    with pytest.raises(sa.ConfigurationError, match="nothing is uncertain"):
        sa.uncertain(arm, {})
    with pytest.raises(sa.ConfigurationError, match="shares is"):
        about.realise([0.0, 2.0, 0.0])
    redundant = sa.load("planar3", task="x y")
    unsure = sa.uncertain(redundant, {redundant.tree.massive()[-1]: {"mass": 0.1}})
    with pytest.raises(sa.UnsupportedError, match="redundant"):
        sa.is_free_for_all(unsure, np.zeros((2, 3)))


def test_what_takes_long_reports_how_far_it_is(about):
    seen = {"range": [], "proof": [], "bands": []}

    def tell(name):
        return lambda done, total: seen[name].append(done / total)

    q = np.radians([-65.0, 30.0])
    sa.distance_range(about, q, samples=5, progress=tell("range"))
    assert sa.is_free_for_all(about, np.array([q, q + 0.1]), progress=tell("proof")).free
    sa.shell_bands(about, samples=2, progress=tell("bands"))
    for shares in seen.values():
        assert shares == sorted(shares)
        assert shares[-1] == pytest.approx(1.0)
