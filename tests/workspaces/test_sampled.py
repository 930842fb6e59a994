"""Workspaces of redundant arms and of arms with sliding or mimic joints."""

import json

import numpy as np
import pytest
from helpers.arms import LIMIT, chosen, joint, link, load_text, random_chain, robot, two_links
from helpers.commands import spacearm

import spacearm as sa
from spacearm.mechanics.batch import tips_from_centre
from spacearm.mechanics.distance import lose_rank
from spacearm.polynomial.branch_and_bound import enclose
from spacearm.singularities.polynomials import radius_squared
from spacearm.workspaces.extent import largest_distance
from spacearm.workspaces.sampled import SingularSampler

RAIL = '<limit lower="0.2" upper="0.9" effort="1" velocity="1"/>'
SLIDING = joint("last", "arm", "hand", "prismatic", axis=(1, 0, 0), inside=RAIL)
MIMIC = joint("last", "arm", "hand", inside=f'{LIMIT}<mimic joint="elbow"/>')
FEW = 2000


def arm_with(last, task):
    return load_text(robot(*two_links(), link("hand"), last), task=task)


@pytest.fixture(scope="module")
def sliding():
    return sa.workspace(arm_with(SLIDING, "x y"), effort=FEW)


def distance_of(cfg):
    return float(np.linalg.norm(cfg.tip.translation - cfg.com))


def outside(radii, ranges):
    """By how much distances lie outside ranges (k, 2), zero inside."""
    over = np.maximum(ranges[:, :1] - radii, radii - ranges[:, 1:])
    return np.maximum(over.min(axis=0), 0.0)


def share_of_sigma(arm, q):
    """Least singular value of J*, by Pinocchio, as a share of the largest."""
    J = sa.generalized_jacobian(arm.at(q))
    sigma = np.linalg.svd(J[arm.task.indices], compute_uv=False)
    return sigma[-1] / sigma[0]


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["free-floating", "fixed"])
def test_three_joints_in_the_plane_are_certified(mode):
    """A search without polynomials finds nothing singular outside, and comes near each end."""
    arm = sa.load("planar3", task="x y")
    found = sa.workspace(arm, mode=mode)
    assert found.kind == "certified"
    assert found.gap <= 1e-8
    np.testing.assert_allclose(found.covered, found.pdw, atol=1e-8)
    rng = chosen(1)
    searched = [lose_rank(arm, q, mode) for q in rng.uniform(-np.pi, np.pi, (400, 3))]
    postures = np.array([q for q in searched if q is not None])
    assert len(postures) > 200
    R = np.linalg.norm(tips_from_centre(arm, postures, mode), axis=1)
    assert outside(R, found.pdw).max() <= 1e-8
    for low, high in found.pdw:
        inside = R[(low - 1e-8 <= R) & (high + 1e-8 >= R)]
        assert inside.min() < low + 0.1 * (high - low)
        assert inside.max() > high - 0.1 * (high - low)
    for shell in found.shells:
        for q in shell.at:
            J = sa.generalized_jacobian(arm.at(q), mode=mode)[arm.task.indices]
            assert np.linalg.svd(J, compute_uv=False)[-1] < 1e-9


@pytest.mark.slow
def test_a_proof_over_two_equations_refuses_shells_that_are_too_small():
    arm = sa.load("planar3", task="x y")
    equations = sa.singular_set(arm).triangle.equations
    R2, low, high = radius_squared(arm), np.full(3, -np.pi), np.full(3, np.pi)
    good = sa.workspace(arm).pdw ** 2
    assert len(equations) == 2
    assert enclose(R2, equations, good, low, high, 1e-9).outside is None
    for at in ((0, 1), (1, 0), (1, 1)):
        small = good.copy()
        small[at] += 1e-6 if at[1] == 0 else -1e-6
        proof = enclose(R2, equations, small, low, high, 1e-9)
        assert proof.gap >= 0.9e-6


def test_a_sliding_joint_has_the_distances_at_which_the_determinant_vanishes(sliding):
    """On a grid of both joints, where det J* by Pinocchio changes its sign."""
    arm, found = sliding.arm, sliding
    assert found.kind == "sampled"
    turns = np.linspace(-3.1, 3.17, 60)  # not symmetric: no root is a point of the grid
    rail = np.linspace(0.2, 0.9, 15)
    grid = np.array([[(q1, s) for s in rail] for q1 in turns])
    J = np.array([[sa.generalized_jacobian(arm.at(q)) for q in row] for row in grid])
    det = np.linalg.det(J[:, :, arm.task.indices])
    roots = []
    for Q, S in ((grid, det), (grid.swapaxes(0, 1), det.T)):
        crossed = S[:-1] * S[1:] < 0.0
        share = (S[:-1] / (S[:-1] - S[1:]))[crossed][:, None]
        roots += list(Q[:-1][crossed] + share * (Q[1:] - Q[:-1])[crossed])
    R = np.linalg.norm(tips_from_centre(arm, np.array(roots), "free-floating"), axis=1)
    assert len(R) >= 8
    assert outside(R, found.pdw).max() < 5e-3  # the step of the grid
    assert R.min() == pytest.approx(found.pdw[0, 0], abs=0.05)
    assert R.max() == pytest.approx(found.pdw[-1, 1], abs=0.05)


@pytest.mark.parametrize(
    ("last", "task"),
    [(SLIDING, "x y"), (MIMIC, "x"), (joint("last", "arm", "hand"), "x")],
)
def test_sampled_configurations_are_singular_and_stand_where_they_are_said_to(last, task):
    arm = arm_with(last, task)
    found = sa.workspace(arm, effort=FEW)
    assert found.kind == "sampled"
    assert len(found.configurations)
    for q in (*found.configurations[::400], *(q for shell in found.shells for q in shell.at)):
        J = sa.generalized_jacobian(arm.at(q))[arm.task.indices]
        assert np.linalg.svd(J, compute_uv=False)[-1] < 1e-9
        assert outside(np.array([distance_of(arm.at(q))]), found.pdw)[0] < 1e-9
    assert found.resolution <= found.reachable[0, 1] / 300
    assert (found.pdw[:, 0] >= found.reachable[0, 0] - 1e-6).all()
    assert (found.pdw[:, 1] <= found.reachable[0, 1] + 1e-6).all()
    assert found.gap >= max(found.pdw[0, 0], found.reachable[0, 1] - found.pdw[-1, 1])
    assert "not certified" in str(found.describe())
    assert "configurations" not in found.to_dict()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options"),
    [("chaser7", {}), ("mda6", {}), ("mda6", {"locked": {"joint_4": 0.0, "joint_5": 0.3}})],
)
def test_position_tasks_have_the_distances_that_another_search_finds(name, options):
    """`FoundSet.sample` searches one at a time, with other equations and from other starts."""
    arm = sa.load(name, task="position", **options)
    found = sa.workspace(arm)
    assert found.kind == "sampled"
    others = sa.singular_set(arm).sample(60, chosen(7))
    R = np.linalg.norm(tips_from_centre(arm, others, "free-floating"), axis=1)
    assert outside(R, found.pdw).max() <= found.resolution
    again = sa.workspace(arm, seed=5)
    for radii in (found.pdw, again.pdw):
        bound = found.resolution + again.resolution
        assert outside(radii.ravel(), found.pdw).max() <= bound
        assert outside(radii.ravel(), again.pdw).max() <= bound


@pytest.mark.slow
def test_the_outermost_distance_is_singular_without_limits():
    """Section 6 of the theory: there the tip has lost the direction of R."""
    arm = sa.load("mda6", task="position", locked={"joint_4": 0.0, "joint_5": 0.3})
    found = sa.workspace(arm, effort=FEW)
    assert found.pdw[-1, 1] == pytest.approx(found.reachable[0, 1], abs=1e-6)
    assert share_of_sigma(arm, found.shells[-1].at[1]) < 1e-9


def test_limits_leave_out_what_is_beyond_them(sliding):
    arm, whole = sliding.arm, sliding
    lower, upper = [0.5, 0.2], [1.5, 0.4]
    narrow = arm.replace(lower=lower, upper=upper)
    found = sa.workspace(narrow, limits=True, effort=FEW)
    for q in found.configurations[::100]:
        assert (np.array(lower) - 1e-9 <= q).all()
        assert (np.array(upper) + 1e-9 >= q).all()
    assert found.reachable[0, 1] <= whole.reachable[0, 1] + 1e-9
    assert outside(found.pdw.ravel(), whole.pdw).max(initial=0.0) <= whole.resolution


def test_a_point_at_a_sampled_distance_is_path_dependent_with_a_singular_configuration(sliding):
    arm, found = sliding.arm, sliding
    point = np.array([0.6, 0.8]) * found.pdw[0].mean()
    region = found.regions(point)
    assert region.kind == "path dependent"
    (cfg,) = region.singular
    np.testing.assert_allclose((cfg.tip.translation - cfg.com)[:2], point, atol=1e-8)
    assert share_of_sigma(arm, cfg.q) < 1e-9
    assert found.regions((99.0, 0.0)).kind == "unreachable"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2, 3])
def test_the_bound_of_the_reach_with_sliding_joints_is_just_above_it(seed):
    text = random_chain(seed, 5, ("revolute", "revolute", "prismatic"))
    arm = load_text(text, tip="tip", task="position")
    assert arm.slides.any()
    search = SingularSampler(arm, "free-floating", False, chosen(seed), lambda _: None)
    search.find_reach()
    largest = search.reach[0][1]
    bound = largest_distance(arm, "free-floating", (search.low, search.high))
    assert largest - 1e-9 <= bound <= largest * (1.0 + 1e-5)


def test_free_workspaces_need_revolute_joints(sliding):
    with pytest.raises(sa.UnsupportedError, match="revolute"):
        sliding.free  # noqa: B018


def test_ctrl_c_returns_the_workspace_so_far():
    def stop(*_):
        raise KeyboardInterrupt

    with pytest.raises(sa.StoppedError) as caught:
        sa.workspace(arm_with(MIMIC, "x"), effort=FEW, progress=stop)
    assert caught.value.best.kind == "stopped"
    assert np.isnan(caught.value.best.gap)


def test_bands_of_shells_need_certified_ones():
    about = sa.uncertain(arm_with(joint("last", "arm", "hand"), "x"), {"hand": {"mass": 0.1}})
    with pytest.raises(sa.UnsupportedError, match="sampled"):
        sa.shell_bands(about, samples=1)


@pytest.mark.slow
def test_designs_of_redundant_arms_say_what_each_number_is():
    arm = arm_with(joint("last", "arm", "hand"), "x")
    result = sa.design.workspaces(arm, {"base_mass": [50, 500]}, effort=FEW, risk_bins=1)
    assert result["bounds"].values.tolist() == ["sampled", "sampled"]
    assert np.isfinite(result["near_share"].values).all()
    assert np.isfinite(result["near_error"].values).all()
    for mass in (50, 500):
        alone = sa.workspace(sa.design.vary(arm, {"base_mass": mass}), effort=FEW)
        here = result.sel(base_mass=mass)
        np.testing.assert_allclose(here["pdw"].dropna("shell"), alone.pdw, atol=1e-12)
        assert float(here["gap"]) == alone.gap
        assert float(here["resolution"]) == alone.resolution


@pytest.mark.slow
def test_command_designs_a_redundant_arm(tmp_path):
    options = ("--task", "position", "--vary", "base_mass=1000", "--effort", "2000")
    done = spacearm("design", "chaser7", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "sampled, resolution" in done.stdout
    assert "found by search" in done.stdout
    told = json.loads(spacearm("design", "chaser7", *options, "--json", cwd=tmp_path).stdout)
    (design,) = told["designs"]
    assert design["bounds"] == "sampled"
    assert design["near_error"] >= 0.0
