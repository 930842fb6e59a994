"""What the hand holds: minors of J* times det(A_b) stay the same for full pose tasks."""

from itertools import combinations

import numpy as np
import pytest
from helpers.arms import load_text, random_chain, random_configuration, random_inertia

import spacearm as sa
from spacearm.singularities.immaterial_masses import immaterial_links
from spacearm.singularities.polynomials import minors_of

MODES = ("free-floating", "attitude-controlled", "fixed")


def minors(cfg, mode):
    """All maximal minors of J*, times the determinant of the rows of A that count."""
    J = sa.generalized_jacobian(cfg, mode=mode)[cfg.arm.task.indices]
    values = [np.linalg.det(J[:, list(C)]) for C in combinations(range(cfg.arm.n), cfg.arm.task.k)]
    free = {"free-floating": 6, "attitude-controlled": 3, "fixed": 0}[mode]
    return np.array(values) * np.linalg.det(sa.momentum_matrix(cfg).A_b[:free, :free])


def loaded(arm, seed):
    """The arm with a random heavy body in its hand, CM and axes anywhere."""
    rng = np.random.default_rng(seed)
    mass = 10 ** rng.uniform(1, 3)
    return arm.grasp(mass, random_inertia(rng, mass), rng.normal(size=3))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("seed", "n"), [(0, 6), (1, 7), pytest.param(2, 8, marks=pytest.mark.slow)]
)
def test_minors_of_a_full_pose_do_not_depend_on_the_payload(seed, n, mode):
    kinds = ("revolute", "revolute", "revolute", "prismatic")  # of four slides one is idle
    arm = load_text(random_chain(seed, n, kinds), tip="tip", task="pose")
    other = loaded(arm, seed)
    heavier = arm.on(arm.whole.with_mass(f"link_{n}", 300.0))
    assert sa.singular_set(arm, mode=mode).any_payload
    for number in range(3):
        q = random_configuration(arm, number).q
        wanted = minors(arm.at(q), mode)
        for changed in (other, heavier):
            got = minors(changed.at(q), mode)
            np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("task", ["position", "x y z rx ry", "orientation"])
def test_other_tasks_say_that_the_payload_matters_and_it_does(task, mode):
    n = len(sa.Task(task).rows)
    arm = load_text(random_chain(5, n), tip="tip", task=task)
    found, other = sa.singular_set(arm, mode=mode), loaded(arm, 5)
    assert found.any_payload == (mode == "fixed")
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (4, n))
    ratios = np.ravel([minors(other.at(q), mode) / minors(arm.at(q), mode) for q in Q])
    same = np.ptp(ratios) <= 1e-9 * np.abs(ratios).max()
    # held in attitude, "orientation" does not ask for the momentum at all
    assert same == (mode == "fixed" or (mode == "attitude-controlled" and task == "orientation"))
    assert "any payload" in repr(found.describe()) or "of this payload" in str(found.describe())


@pytest.mark.parametrize("name", ["mda6", "chaser7"])
def test_members_of_the_set_stay_singular_with_500_kg_in_the_hand(name):
    arm = sa.load(name)
    Q = sa.singular_set(arm).sample(20, np.random.default_rng(0))
    heavy = arm.replace(payload=500.0)
    sigma = sa.evaluate(heavy, Q, ("sigma_min",))["sigma_min"]
    regular = np.random.default_rng(1).uniform(-np.pi, np.pi, (20, arm.n))
    before, after = (
        np.median(sa.evaluate(one, regular, ("sigma_min",))["sigma_min"]) for one in (arm, heavy)
    )
    assert sigma.max() < 1e-10 * before
    assert after < 0.8 * before  # the set stands still, sigma_min falls


def test_planar_arms_with_x_y_rz_hold_any_body_in_their_plane():
    arm = sa.load("planar3")
    found = sa.singular_set(arm)
    height = arm.at(np.zeros(3)).tip.translation[2]
    within = arm.grasp(40.0, np.diag([1.0, 2.0, 3.0]), (0.3, 0.2, -height))
    q = np.array([0.3, 1.1, -0.7])
    S = [minors_in_plane(one.at(q)) for one in (arm, within)]
    assert found.any_payload
    assert sa.singular_set(within).any_payload
    assert S[1] == pytest.approx(S[0], rel=1e-10)
    beside = arm.grasp(40.0, None, (0.0, 0.0, 1.0))
    assert not sa.singular_set(beside).any_payload


def minors_in_plane(cfg):
    """det(J*) of x, y, rz times the inertia about the normal of the plane and the masses."""
    J, A = sa.generalized_jacobian(cfg), sa.momentum_matrix(cfg).A_b
    rows = [0, 1, 5]
    return np.linalg.det(J[rows]) * np.linalg.det(A[np.ix_(rows, rows)])


def test_last_links_of_several_arms_do_not_matter():
    arm = sa.load("dual_ur5", tip=("left", "right"))
    links = immaterial_links(arm, "free-floating")
    assert links == ("left_wrist_3_link", "right_wrist_3_link")
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, arm.n)
    wanted = minors(arm.at(q), "free-floating")
    whole = arm.whole
    for link in links:
        whole = whole.with_mass(link, 80.0)
    got = minors(arm.on(whole).at(q), "free-floating")
    np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-12)


# --- uncertain arms -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mda6():
    return sa.load("mda6")


def last_link(arm):
    return sa.singular_set(arm).any_mass[0]


def test_proofs_hold_whatever_the_last_link_weighs(mda6):
    last = last_link(mda6)
    spread = {last: {"mass": (0.01, 900.0), "com": 0.5, "inertia": 0.5}}
    about, q = sa.uncertain(mda6, spread), np.radians([20, 60, -100, -50, 30, 0])
    path = np.array([q, q + 0.2])
    proof = sa.is_free_for_all(about, path)
    assert proof.free
    assert len(proof.immaterial) == 5
    signs = {
        np.sign(np.linalg.det(sa.generalized_jacobian(about.realise(t).at(x))))
        for t in about.sample(20, np.random.default_rng(0))
        for x in path
    }
    assert len(signs) == 1
    near = sa.distance_range(about, q)
    assert near.low == near.nominal == near.high
    assert near.immaterial == proof.immaterial
    assert last in str(near.describe())


def test_a_path_through_the_set_is_singular_whatever_the_last_link_weighs(mda6):
    at = sa.singular_set(mda6).sample(1, np.random.default_rng(2))[0]
    step = np.zeros(6)
    step[2] = 0.02
    about = sa.uncertain(mda6, {last_link(mda6): {"mass": (1.0, 500.0)}})
    found = sa.is_free_for_all(about, [at - step, at + step])
    assert found.verdict == "singular"
    heavy = about.realise([1.0])
    assert sa.singularity(heavy.at(found.at)).distance < 1e-6


def test_numbers_of_other_links_stay_beside_those_of_the_last():
    arm = sa.load("planar3")
    last = last_link(arm)
    first = next(link for link in arm.whole.massive() if link not in sa.singular_set(arm).any_mass)
    about = sa.uncertain(arm, {first: {"mass": 0.1}, last: {"mass": 0.5}})
    assert [p.link for p in about.relevant().parameters] == [first]
    tilting = sa.uncertain(arm, {first: {"mass": 0.1}, last: {"com": 0.1}})
    assert tilting.relevant() is tilting  # leaves the plane
    positions = sa.uncertain(sa.load("planar3", task="x y"), {last: {"mass": 0.5}})
    assert positions.relevant().parameters == positions.parameters


def test_links_without_mass_have_none_to_change():
    arm = sa.load("dual_ur5")
    idle = next(name for name in arm.whole.links if name not in arm.whole.massive())
    with pytest.raises(sa.ModelError, match="has no mass"):
        arm.whole.with_mass(idle, 1.0)


@pytest.mark.parametrize("mode", ["free-floating", "attitude-controlled"])
def test_polynomials_are_kept_for_another_payload_and_for_nothing_else(mode):
    arm = load_text(random_chain(5, 7), task="pose")
    kept = minors_of(arm, mode)
    assert minors_of(arm.replace(payload=70.0), mode) is kept
    assert minors_of(arm.grasp(9.0, np.eye(3), (0.1, 0.2, 0.3)), mode) is kept
    other = "fixed" if mode == "free-floating" else "free-floating"
    assert minors_of(arm, other) is not kept
    for changed in (
        arm.replace(base_mass=2.0 * arm.mass),
        arm.replace(task="position", payload=70.0),
        load_text(random_chain(6, 7), task="pose"),
    ):
        assert minors_of(changed, mode) is not kept
    square = load_text(random_chain(5, 3), task="position")
    heavy = square.grasp(70.0, 20.0 * np.eye(3), (0.5, 0.2, 0.3))
    S, other = (sa.singularity_polynomial(one, mode=mode) for one in (square, heavy))
    assert S is not other
    q = sa.singular_set(heavy, mode=mode).nearest([0.4, -0.3, 1.1]).q
    assert sa.singularity(heavy.at(q), mode=mode).rank == 2
    assert abs(S(q[None])[0]) > 1e-6 * S.scale  # another set


def test_boxes_saved_for_one_payload_are_those_of_another(tmp_path):
    arm = sa.load("planar3")
    boxes = sa.free_boxes(arm, share=0.2)
    boxes.save(tmp_path / "boxes.npz")
    height = arm.at(np.zeros(3)).tip.translation[2]
    within = arm.grasp(40.0, np.diag([1.0, 2.0, 3.0]), (0.3, 0.2, -height))
    again = sa.FreeBoxes.load(tmp_path / "boxes.npz", within, boxes.mode)
    np.testing.assert_array_equal(again.cells.low, boxes.cells.low)
    beside = arm.grasp(40.0, None, (0.0, 0.0, 1.0))
    with pytest.raises(sa.StoreError, match="another"):
        sa.FreeBoxes.load(tmp_path / "boxes.npz", beside, boxes.mode)


HANDS = {
    "planar": (lambda: sa.load("planar3"), "any payload"),
    "position": (lambda: load_text(random_chain(2, 3), task="position"), "this payload"),
    "pose": (lambda: load_text(random_chain(2, 6), task="pose"), "any payload"),
}


@pytest.mark.parametrize(
    "hand", ["planar", "position", pytest.param("pose", marks=pytest.mark.slow)]
)
def test_results_say_for_which_payload_they_hold(hand):
    make, words = HANDS[hand]
    arm = make()
    q = np.clip(np.linspace(-0.5, 0.9, arm.n), arm.lower, arm.upper)
    near = sa.singular_set(arm).nearest(q)
    here = sa.Constraints(collisions=False)
    told = [near, sa.singularity(arm.at(q), exact=True)]
    told += [sa.plan(arm.at(q), sa.Joints(q + 0.01), constraints=here), sa.free_box(arm.at(q))]
    for result in told:
        assert words in " ".join(result.describe().notes)
