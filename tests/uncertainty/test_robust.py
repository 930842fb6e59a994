"""Uncertain arms: polynomials in the parameters, proofs against a million samples, shells."""

import numpy as np
import pytest
from helpers.arms import chosen, load_text, random_chain
from scipy.stats import norm, uniform

import spacearm as sa
from spacearm.polynomial.tubes import straight
from spacearm.singularities.regularity import Momenta, Pieces

SPREAD = {"link_1": {"mass": 0.2, "inertia": 0.1}, "link_2": {"mass": (2.0, 4.0)}}


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


@pytest.fixture(scope="module")
def about(arm):
    return sa.uncertain(arm, SPREAD)


def signs_of_samples(about, path, m, seed=0):
    """The signs of det(J*) for random arms, half of them corners, at random places of a path."""
    rng = np.random.default_rng(seed)
    i, s = rng.integers(0, len(path) - 1, 100), rng.uniform(size=100)
    places = path[i] + s[:, None] * (path[i + 1] - path[i])
    shares = about.sample(m, rng)
    shares[::2] = shares[::2].round()
    arms = (about.realise(t) for t in shares)
    values = [sa.evaluate(arm, places, ["determinant"])["determinant"] for arm in arms]
    return np.sign(np.concatenate(values))


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


# --- the enclosures -------------------------------------------------------------------------


SLIDING = ("revolute", "prismatic")
SPREADS = {
    "masses": lambda arm: {link: {"mass": 0.2} for link in arm.whole.massive()},
    "one of each kind": lambda arm: {
        arm.whole.massive()[0]: {"mass": 0.1, "inertia": 0.2, "com": [0.05, 0.02, 0.03]},
        arm.whole.massive()[1]: {"com": 0.05},
    },
}
ARMS = {
    "planar2": lambda: sa.load("planar2"),
    "mda6": lambda: sa.load("mda6"),
    "position": lambda: load_text(random_chain(3, 3), tip="tip", task="position"),
    "seven joints": lambda: load_text(random_chain(2, 7), tip="tip"),
    "slides that stay": lambda: load_text(random_chain(5, 6, SLIDING), tip="tip"),
}


@pytest.mark.slow
@pytest.mark.parametrize("bow", [0.0, 0.01])
@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize("name", ARMS)
def test_matrices_of_random_arms_lie_in_their_enclosures(name, spread, bow):
    """M X - 1 of corners of the box and random places of straight lines and curves."""
    arm, rng = ARMS[name](), np.random.default_rng(7)
    about = sa.uncertain(arm, SPREADS[spread](arm))
    rows = rng.uniform(-2.0, 2.0, (1, arm.n)) + np.array([[0.0], [1.0]]) * 0.2 * ~arm.slides
    way = rows[0] + np.linspace(0.0, 1.0, 5)[:, None] * (rows[1] - rows[0])
    way[1:4] += bow * rng.normal(size=(3, arm.n)) * ~arm.slides
    momenta = Momenta(about, way[None] if bow else straight(rows))
    low = rng.uniform(0.0, 0.5, (4, len(about.parameters)))
    begin = np.array([0.0, 0.25, 0.5, 0.75])
    pieces = Pieces(begin, begin + 0.25, low, low + rng.uniform(0.0, 0.5, low.shape))
    found = momenta.enclosure(pieces)
    X, R = np.linalg.pinv(found.middle), found.parts.sum(axis=0)
    tight = 0.0
    for i in range(4):
        ends = np.array([pieces.low[i], pieces.high[i]])
        for _ in range(20):
            inside = ends[0] + rng.uniform(size=low.shape[1]).round() * (ends[1] - ends[0])
            q = momenta.position(begin[i : i + 1] + 0.25 * rng.choice([0.0, 0.1, 0.5, 1.0]))
            M = momenta.matrices(about.realise(inside), q)[0]
            assert (np.abs(M) <= momenta.bound).all()
            off = np.abs(M @ X[i] - np.eye(len(M)))
            assert (off <= R[i]).all()
            tight = max(tight, float((off.sum(axis=1) / R[i].sum(axis=1)).max()))
    assert tight > (0.02 if bow else 0.2)  # no bound that holds whatever M is


@pytest.mark.parametrize("name", ["planar2", "mda6", "position"])
def test_determinants_are_those_of_every_arm(name):
    """Up to a factor of each arm: the ratio at two postures is that of det(A_b) det(J*)."""
    arm, rng = ARMS[name](), np.random.default_rng(3)
    about = sa.uncertain(arm, {arm.whole.massive()[1]: {"mass": 0.3, "inertia": 0.2}})
    Q = rng.uniform(-2.0, 2.0, (2, arm.n))
    for t in about.sample(5, rng):
        one = about.realise(t)
        S = [
            np.linalg.det(sa.momentum_matrix(one.at(q)).A_b) * sa.singularity(one.at(q)).determinant
            for q in Q
        ]
        got = np.linalg.det(Momenta(about, straight(Q)).matrices(one, Q))
        assert got[0] / got[1] == pytest.approx(S[0] / S[1], rel=1e-9)


# --- proofs ---------------------------------------------------------------------------------


def test_a_proof_holds_for_many_samples(about):
    path = np.radians([[-65.0, 40.0], [0.0, 60.0], [60.0, 90.0]])
    proof = sa.is_free_for_all(about, path)
    assert proof.free
    assert proof.verdict == "free"
    assert len(set(signs_of_samples(about, path, 500))) == 1


@pytest.mark.slow
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
    assert set(signs_of_samples(about, near, 1000)) == {-1.0, 1.0}


@pytest.mark.parametrize(
    ("seed", "n"),
    [
        pytest.param(seed, n, marks=[] if (seed, n) == (0, 6) else pytest.mark.slow)
        for seed in range(3)
        for n in (3, 6)
    ],
)
def test_proofs_of_random_spatial_arms(seed, n):
    """All masses, and the first inertia and CM: more than six numbers of six joints."""
    arm = load_text(random_chain(seed, n), tip="tip", task="position" if n == 3 else "pose")
    links = arm.whole.massive()
    spread = {link: {"mass": 0.1} for link in links} | {links[0]: {"mass": 0.2, "inertia": 0.1}}
    about, rng, verdicts = sa.uncertain(arm, spread), np.random.default_rng(seed), []
    for _ in range(6):
        start = rng.uniform(-np.pi, np.pi, n)
        path = np.array([start, start + rng.uniform(-0.3, 0.3, n)])
        found = sa.is_free_for_all(about, path)
        signs = set(signs_of_samples(about, path, 100))
        verdicts.append(found.verdict)
        if found.free:
            assert len(signs) == 1
        if len(signs) == 2:
            assert found.verdict == "singular"
        if found.verdict == "singular":
            values = [found.values.get(p.name, p.low) for p in about.parameters]
            shares = [
                (v - p.low) / (p.high - p.low)
                for v, p in zip(values, about.parameters, strict=True)
            ]
            there = about.realise(np.clip(shares, 0.0, 1.0))
            assert sa.singularity(there.at(found.at)).distance < 1e-6
            on = (found.at - path[0]) / (path[1] - path[0])
            np.testing.assert_allclose(on, on[0], atol=1e-9)
    assert "free" in verdicts


@pytest.mark.slow
def test_redundant_arms_are_proven_too():
    arm, rng = sa.load("chaser7"), np.random.default_rng(1)
    about = sa.uncertain(arm, {link: {"mass": 0.05} for link in arm.whole.massive()})
    assert len(about.relevant().parameters) > 6
    found = sa.singular_set(arm)
    for q in rng.uniform(-1.0, 1.0, (3, 7)):
        path = np.array([q, q + 0.1])
        assert sa.is_free_for_all(about, path).free
    through = found.nearest(q).q
    assert sa.is_free_for_all(about, [through - 0.01, through + 0.01]).verdict == "undecided"


def test_progress_is_told_and_ends(about):
    told = []
    sa.is_free_for_all(
        about, np.radians([[-65.0, 40.0], [60.0, 90.0]]), progress=lambda *x: told.append(x)
    )
    assert told
    assert told[-1][0] == told[-1][1]
    told.clear()
    sa.distance_range(about, [0.3, 1.0], samples=5, progress=lambda *x: told.append(x))
    assert told == [(i, 13) for i in range(1, 14)]


def test_certainty_is_a_narrow_interval(arm):
    almost = sa.uncertain(arm, {"link_2": {"mass": 1e-9}})
    S = sa.singular_set(arm)
    rng = np.random.default_rng(5)
    for _ in range(6):
        path = rng.uniform(-np.pi, np.pi, (2, 2))
        assert sa.is_free_for_all(almost, path).free == bool(S.is_free(*path))


# --- distances, shells, plans ---------------------------------------------------------------


@pytest.mark.slow
def test_the_range_of_the_distance_holds_that_of_the_arm(arm, about):
    q = np.radians([-65.0, 30.0])
    found = sa.distance_range(about, q, samples=30)
    assert found.low <= found.nominal <= found.high
    assert found.nominal == pytest.approx(sa.singular_set(arm).nearest(q).distance, rel=1e-9)
    assert found.regular
    assert "ruled out, proven" in found.describe().verdict
    shares = [(found.least[p.name] - p.low) / (p.high - p.low) for p in about.parameters]
    worst = about.realise(np.clip(shares, 0, 1))
    near = sa.singular_set(worst).nearest(q)
    assert near.distance == pytest.approx(found.low, rel=1e-6)
    assert near.distance_proven > 0.0
    narrow = sa.uncertain(arm, {"link_1": {"mass": 0.02}})
    less = sa.distance_range(narrow, q, samples=30)
    assert less.high - less.low < found.high - found.low


@pytest.mark.slow
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
            assert "one of the arms is singular" in found.describe().verdict
        assert found.singular != found.regular
    assert 1 <= singular <= 4


@pytest.mark.slow
def test_an_arm_that_slides_may_be_singular_at_the_posture_itself():
    """Not the arm as described, but one of the others."""
    arm = load_text(random_chain(chosen(50031), 3, SLIDING), tip="tip", task="position")
    about = sa.uncertain(arm, {link: {"mass": 0.1} for link in arm.whole.massive()})
    low, high = np.array([[0.0, 0.0, 1.0], [0.3, 0.3, 1.0]])
    before, after = (sa.singularity(arm.at(q)).determinant for q in (low, high))
    assert before * after < 0.0
    q = low + before / (before - after) * (high - low)
    assert sa.singularity(arm.at(q)).distance > 0.0
    found = sa.distance_range(about, q, samples=1)
    assert found.singular
    assert found.low == 0.0
    shares = [(found.least[p.name] - p.low) / (p.high - p.low) for p in about.parameters]
    worst = sa.singularity(about.realise(np.clip(shares, 0.0, 1.0)).at(q))
    assert worst.sigma_min < 1e-9 * worst.sigma[0]
    assert sa.distance_range(about, low - 1.0, samples=1).regular


@pytest.mark.slow
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
    flown = np.einsum("a,man->mn", [1, 5, 10, 10, 5, 1], plan.control_points) / 32.0  # middles
    assert len(set(signs_of_samples(about, np.vstack((plan.q, flown)), 1000))) == 1


def test_bad_input(arm, about):
    with pytest.raises(sa.ModelError, match="unknown link 'link_3'; valid, nearest first: link_"):
        sa.uncertain(arm, {"link_3": {"mass": 0.1}})
    with pytest.raises(sa.ConfigurationError, match="kind"):
        sa.uncertain(arm, {"link_1": {"colour": 0.1}})
    with pytest.raises(sa.ConfigurationError, match="mass of link_1 is 2"):
        sa.uncertain(arm, {"link_1": {"mass": 2}})
    with pytest.raises(sa.ConfigurationError, match="increasing bounds"):
        sa.uncertain(arm, {"link_1": {"mass": (3.0, 2.0)}})
    with pytest.raises(sa.ConfigurationError, match="nothing is uncertain"):
        sa.uncertain(arm, {})
    with pytest.raises(sa.ConfigurationError, match="shares is"):
        about.realise([0.0, 2.0, 0.0])
    sliding = load_text(random_chain(chosen(5), 6, ("revolute", "prismatic")), tip="tip")
    unsure = sa.uncertain(sliding, {sliding.whole.massive()[0]: {"mass": 0.1}})
    with pytest.raises(sa.UnsupportedError, match="sliding"):
        sa.is_free_for_all(unsure, [np.zeros(6), np.ones(6)])
    never = sa.uncertain(sa.load("planar2", task="x y rz"), {"link_1": {"mass": 0.1}})
    with pytest.raises(sa.UnsupportedError):
        sa.is_free_for_all(never, np.zeros((2, 2)))


@pytest.mark.parametrize("timeout", [1e-9, 3600.0])
def test_the_time_of_a_robust_plan_is_that_of_all_its_plans(timeout, monkeypatch):
    """It says how many clearances were tried, and names the time where that ended the search."""
    arm = sa.load("planar2")
    about = sa.uncertain(arm, {"link_1": {"mass": 0.1}})
    monkeypatch.setattr("spacearm.uncertainty.robust.is_free_for_all", lambda *_, **__: False)
    words = r"7 of 7 clearances were tried\)"
    if timeout < 1.0:
        words = r"timeout = 1e-09 s, when 0 of 7 clearances were tried; give a longer timeout"
    monkeypatch.setattr("spacearm.uncertainty.robust.CLEARANCES", (0.1,) * 7)
    with pytest.raises(sa.NoSolutionError, match=words):
        sa.robust_plan(
            about, arm.at([0.3, 1.2]), sa.Joints([0.4, 1.1]), search=sa.Search(timeout=timeout)
        )
