"""Workspaces: published radii, limits, and brute force from inside."""

import itertools
import json
import math
import os
import re
import signal
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import (
    chosen,
    frame,
    joint,
    link,
    load_text,
    random_inertia,
    robot,
    seeds,
)
from helpers.commands import spacearm
from hypothesis import given, settings

import spacearm as sa
from spacearm.polynomial.branch_and_bound import enclose
from spacearm.singularities.polynomials import radius_squared
from spacearm.singularities.risk import uniform
from spacearm.workspaces.extent import Box
from spacearm.workspaces.shells import ShellSearch, merged

ALPHA, BETA, GAMMA = 20 / 47, 42 / 47, 45.5 / 47
SHELLS = [[0.3510638, 0.5536773], [1.4361702, 2.2872340]]  # (46), (47)


@pytest.fixture(scope="module")
def planar2():
    return sa.workspace(sa.load("planar2"))


def inside(radii, outer, tolerance=1e-9):
    """Whether every interval of `radii` lies within one of `outer`."""
    return all(
        any(a - tolerance <= low and high <= b + tolerance for a, b in outer) for low, high in radii
    )


# --- the paper ------------------------------------------------------------------------------


def test_shells_of_the_paper(planar2):
    np.testing.assert_allclose(planar2.pdw, SHELLS, atol=6e-8)  # printed to 7 digits
    np.testing.assert_allclose(planar2.pdw[0, 0], ALPHA + BETA - GAMMA, atol=1e-9)
    np.testing.assert_allclose(planar2.pdw[1, 0], BETA + GAMMA - ALPHA, atol=1e-9)
    np.testing.assert_allclose(planar2.pdw[1, 1], ALPHA + BETA + GAMMA, atol=1e-9)
    np.testing.assert_allclose(planar2.reachable, [[0, ALPHA + BETA + GAMMA]], atol=1e-9)
    assert planar2.kind == "certified"
    assert planar2.gap <= 1e-9


def test_path_independent_is_the_rest(planar2):
    (a, b), (c, d) = planar2.pdw
    np.testing.assert_allclose(planar2.piw, [[0, a], [b, c]], atol=1e-12)
    assert planar2.reachable[0, 1] == pytest.approx(d, abs=1e-9)
    area = math.pi * (a**2 + c**2 - b**2)
    assert planar2.volumes["piw"] == pytest.approx(area)
    assert planar2.fraction == pytest.approx(area / (math.pi * d**2))


def test_free_workspace_of_the_paper(planar2):
    """|gamma - beta| <= |alpha - R| and alpha + R <= beta + gamma."""
    expected = [[0.0, ALPHA - (GAMMA - BETA)], [ALPHA + (GAMMA - BETA), BETA + GAMMA - ALPHA]]
    np.testing.assert_allclose(planar2.free, expected, atol=1e-7)
    np.testing.assert_allclose(planar2.free, [[0, 0.3510638], [0.5, 1.4361702]], atol=1e-7)


def test_bounds_are_attained_at_singular_configurations(planar2):
    for shell in planar2.shells:
        for R, q in zip(shell.radius, shell.at, strict=True):
            cfg = planar2.arm.at(q)
            assert np.linalg.norm(cfg.tip.translation - cfg.com) == pytest.approx(R, abs=1e-12)
            assert sa.singularity(cfg).sigma_min < 1e-12
    outer = planar2.shells[0]
    q = np.degrees(np.abs(np.angle(np.exp(1j * outer.at[1]))))
    np.testing.assert_allclose(q, [81.7116, 172.1288], atol=1e-3)  # 2.1 of the theory


@pytest.mark.parametrize("mode", ["attitude-controlled", "fixed"])
def test_a_held_spacecraft_leaves_kinematic_singularities_only(planar2, mode):
    held = sa.workspace(planar2.arm, mode=mode)
    for shell in held.shells:
        assert np.sin(shell.at[:, 1]) == pytest.approx(0.0, abs=1e-9)  # q2 = k pi
    if mode == "attitude-controlled":
        np.testing.assert_allclose(held.piw, planar2.free, atol=1e-7)
        assert held.volumes["piw"] > planar2.volumes["piw"]


def test_mounted_at_the_spacecraft_s_cm_all_is_path_independent():
    arm = sa.load("planar2").replace(mount=pin.SE3.Identity())
    result = sa.workspace(arm)
    assert result.fraction == pytest.approx(1.0, abs=1e-9)
    for low, high in result.pdw:
        assert high - low < 1e-9  # q2 = k pi: circles


@pytest.mark.slow
def test_a_larger_inertia_shrinks_the_path_dependent_workspace(planar2):
    """Section VI: monotonically toward the kinematic boundary."""
    kinematic = sa.workspace(planar2.arm, mode="attitude-controlled").volumes["pdw"]
    areas = [
        sa.workspace(sa.design.vary(planar2.arm, {"base_inertia": k})).volumes["pdw"]
        for k in (1, 2, 5, 100)
    ]
    assert all(a >= b - 1e-8 for a, b in itertools.pairwise(areas))
    assert areas[0] > areas[1]
    assert areas[-1] == pytest.approx(kinematic, abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("mount_x", [0.0, 0.1, 0.3, 0.5, 0.8])
@pytest.mark.parametrize("inertia", [1.0, 5.0])
def test_the_path_independent_workspace_lies_in_the_free_one(mount_x, inertia):
    """Section V, for arms whose reach from the first joint encloses the system CM."""
    arm = sa.design.vary(sa.load("planar2"), {"mount_x": mount_x, "base_inertia": inertia})
    result = sa.workspace(arm)
    assert len(result.piw)
    assert inside(result.piw, result.free, 1e-6)


def test_the_free_workspace_does_not_always_hold_the_path_independent_one():
    """A counterexample, by brute force: an arm too short to reach around the system CM.

    Seen from the spacecraft its tip has only some directions, so that nothing is free; but at some
    distances no configuration is singular: there the tip goes round by turning the ship.
    """
    arm = random_planar(chosen(6648))
    result = sa.workspace(arm)
    assert len(result.free) == 0
    low, high = result.piw[0] + (0.02, -0.02)
    assert high - low > 0.2
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (300_000, 2))
    values = sa.evaluate(arm, Q, ["sigma_min", "radius"])
    here = (values["radius"] > low) & (values["radius"] < high)
    assert values["sigma_min"][here].min() > 0.01 * np.median(values["sigma_min"])
    tips = [arm.at(q) for q in Q[here][:2000]]
    angles = [np.arctan2(*(c.tip.translation - c.com)[1::-1]) for c in tips]
    assert (np.histogram(angles, 18, (-np.pi, np.pi))[0] == 0).sum() > 6


# --- proof and brute force ------------------------------------------------------------------


def random_planar(seed):
    """A planar arm of two joints, task x y, or three, task x y rz."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 4))
    elements = [link("bus", 10 ** rng.uniform(0.5, 2), (*rng.normal(size=2) * 0.2, 0))]
    for i in range(1, n + 1):
        mass = 10 ** rng.uniform(-0.5, 1)
        I = np.diag(np.diag(random_inertia(rng, mass)))
        elements.append(link(f"l{i}", mass, (*rng.normal(size=2) * 0.3, 0), I))
        parent = f"l{i - 1}" if i > 1 else "bus"
        elements.append(joint(f"j{i}", parent, f"l{i}", xyz=(*rng.normal(size=2) * 0.6, 0)))
    elements.append(frame("tip"))
    elements.append(joint("jt", f"l{n}", "tip", "fixed", (*rng.normal(size=2) * 0.6, 0)))
    return load_text(robot(*elements), tip="tip", task="x y" if n == 2 else "x y rz")


@pytest.mark.slow
@settings(max_examples=8)
@given(seeds)
def test_no_singular_configuration_outside_certified_shells(seed):
    arm = random_planar(seed)
    result = sa.workspace(arm)
    assert result.kind == "certified"
    Q = sa.singular_set(arm).sample(5000, np.random.default_rng(seed))
    R = np.sqrt(np.maximum(radius_squared(arm)(Q), 0))
    gaps = np.maximum(result.pdw[:, :1] - R, R - result.pdw[:, 1:]).min(axis=0)
    assert gaps.max() <= max(result.gap, 1e-9) + 1e-7  # R of the sample, from R^2, is no better
    assert inside(result.pdw, result.reachable)


def test_planar3_against_ten_million_configurations():
    """Brute force finds no singularity outside the shells, and comes close to each bound."""
    arm = sa.load("planar3", task="x y rz")
    result = sa.workspace(arm)
    assert result.kind == "certified"
    N = 215  # 215^3 = 9,938,375
    angles = np.linspace(-np.pi, np.pi, N, endpoint=False)
    step = angles[1] - angles[0]
    S, R2 = sa.singularity_polynomial(arm), radius_squared(arm)
    grid = S.grid((N, N, 1))[:, :, 0]  # the last joint does not matter to S
    a, b = np.nonzero(np.sign(grid) != np.sign(np.roll(grid, -1, axis=1)))
    crossing = grid[a, b] / (grid[a, b] - grid[a, (b + 1) % N])
    q1, q2 = angles[a] - angles[0], angles[b] - angles[0] + crossing * step
    Q = np.stack([np.repeat(q1, N), np.repeat(q2, N), np.tile(angles, len(q1))], axis=1)
    R = np.sqrt(np.maximum(R2(Q), 0))
    slack = 2 * np.linalg.norm(R2.lipschitz) * step**2  # the crossing is linear in the cell
    for R_i in (R.min(), R.max()):
        assert (result.pdw[:, 0] - slack <= R_i).any()
        assert (result.pdw[:, 1] + slack >= R_i).any()
    assert R.max() == pytest.approx(result.pdw[-1, 1], abs=np.linalg.norm(R2.lipschitz) * step)
    assert R.min() == pytest.approx(result.pdw[0, 0], abs=np.linalg.norm(R2.lipschitz) * step)


@pytest.mark.slow
def test_a_proof_refuses_shells_that_are_too_small(planar2):
    S, R2 = sa.singularity_polynomial(planar2.arm), radius_squared(planar2.arm)
    low, high = np.full(2, -np.pi), np.full(2, np.pi)
    good = planar2.pdw**2
    assert enclose(R2, (S,), good, low, high, 1e-9).outside is None
    for at in ((0, 0), (0, 1), (1, 0), (1, 1)):
        small = good.copy()
        small[at] += 1e-6 if at[1] == 0 else -1e-6
        proof = enclose(R2, (S,), small, low, high, 1e-9)
        assert proof.outside is not None
        assert proof.gap >= 0.9e-6
    assert enclose(R2, (S,), good[:1], low, high, 1e-9).outside is not None


def test_a_missing_shell_is_found_by_the_proof(planar2):
    arm = planar2.arm
    box = Box.of(arm.lower, arm.upper, limits=False)
    S = sa.singularity_polynomial(arm)
    shells, gap = ShellSearch(arm, "free-floating", box).proven((S,), list(planar2.shells[:1]))
    np.testing.assert_allclose(merged([shell.radius for shell in shells]), planar2.pdw, atol=1e-9)
    assert gap <= 1e-9


# --- joint limits ---------------------------------------------------------------------------


def limited(lower, upper):
    """planar2 with other joint limits."""
    parts = sa.load("planar2").path.read_text().split("<limit ")
    ends = zip(parts[1:], lower, upper, strict=True)
    limits = [f'lower="{low}" upper="{high}" {rest}' for rest, low, high in ends]
    text = "<limit ".join((parts[0], *(re.sub(DOUBLE, r"\1", limit) for limit in limits)))
    return load_text(text, tip="tip", task="x y")


DOUBLE = r'^(lower="[^"]*" upper="[^"]*") lower="[^"]*" upper="[^"]*"'


@pytest.mark.slow
def test_joint_limits_leave_fewer_singular_configurations(planar2):
    arm = limited((-1.0, -0.5), (0.8, 1.0))
    np.testing.assert_allclose(arm.lower, (-1.0, -0.5), atol=1e-12)
    result, whole = sa.workspace(arm, limits=True), sa.workspace(arm)
    np.testing.assert_allclose(whole.pdw, planar2.pdw, atol=1e-9)
    assert inside(result.pdw, whole.pdw)
    assert inside(result.reachable, whole.reachable)
    Q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (200_000, 2))
    R = sa.evaluate(arm, Q, ["radius"])["radius"]
    assert result.reachable[0, 0] - 1e-9 <= R.min() <= result.reachable[0, 0] + 1e-2
    assert result.reachable[0, 1] - 1e-2 <= R.max() <= result.reachable[0, 1] + 1e-9
    curve = np.array([
        (q1, q2) for q1 in np.linspace(-1, 0.8, 2001)
        for q2 in sa.singular_set(arm).roots([q1, 0], 1).angles if -0.5 <= q2 <= 1.0
    ])  # fmt: skip
    R = np.sqrt(radius_squared(arm)(curve))
    np.testing.assert_allclose(result.pdw, [[R.min(), R.max()]], atol=1e-6)
    for shell in result.shells:
        assert (shell.at >= arm.lower - 1e-9).all()
        assert (shell.at <= arm.upper + 1e-9).all()


def test_short_pieces_within_the_limits_are_not_missed():
    """Limits cut a corner of a singular curve off, shorter than the step of its points."""
    arm = limited((-1.695, -0.495), (-0.131, 1.369))
    result = sa.workspace(arm, limits=True)
    q1 = np.linspace(-1.695, -0.131, 200_001)
    Q = np.stack((q1, np.zeros_like(q1)), axis=1)
    Q = Q.repeat(2, axis=0)
    Q[:, 1] = sa.singularity_polynomial(arm).roots_along(Q[::2], 1).ravel()
    R = np.sqrt(radius_squared(arm)(Q[(Q[:, 1] >= -0.495) & (Q[:, 1] <= 1.369)]))
    assert len(R)
    np.testing.assert_allclose(result.pdw, [[R.min(), R.max()]], atol=1e-6)
    assert result.kind == "certified"


@pytest.mark.slow
@given(seeds)
@settings(max_examples=10)
def test_no_singular_configuration_outside_certified_shells_within_limits(seed):
    rng = np.random.default_rng(seed)
    low = rng.uniform(-3.0, 2.0, 2)
    arm = limited(low, np.minimum(low + 10.0 ** rng.uniform(-1.0, 0.4, 2), 3.1))
    result = sa.workspace(arm, limits=True)
    assert result.kind == "found" or math.isfinite(result.gap)
    q1 = np.linspace(arm.lower[0], arm.upper[0], 20_001).repeat(2)
    Q = np.stack((q1, np.zeros_like(q1)), axis=1)
    Q[:, 1] = sa.singularity_polynomial(arm).roots_along(Q[::2], 1).ravel()
    Q = Q[(Q[:, 1] >= arm.lower[1]) & (Q[:, 1] <= arm.upper[1])]
    R = np.sqrt(radius_squared(arm)(Q))
    if result.kind == "certified":
        assert inside(np.stack((R, R), axis=1), result.pdw, 1e-6)


def test_limits_without_singularities_leave_all_path_independent():
    arm = limited((-0.3, 1.0), (0.3, 1.5))
    result = sa.workspace(arm, limits=True)
    assert result.pdw.shape == (0, 2)
    assert result.fraction == 1.0


def test_a_wrist_keeps_its_tip_at_one_distance():
    """All axes and all centres of mass in one point, the tip beside it: R is a constant."""
    axes = {"yaw": (0, 0, 1), "pitch": (0, 1, 0), "roll": (1, 0, 0)}
    bodies = ["bus", *axes]
    wrist = [link(name, 10.0 if name == "bus" else 1.0, (0, 0, 0)) for name in bodies]
    wrist += [
        joint(f"turn {name}", inner, name, xyz=(0, 0, 0), axis=axes[name])
        for inner, name in itertools.pairwise(bodies)
    ]
    tip = (frame("tip"), joint("jt", "roll", "tip", "fixed", (0.3, 0, 0)))
    arm = load_text(robot(*wrist, *tip), tip="tip", task="orientation")
    for limits in (False, True):
        result = sa.workspace(arm, limits=limits)
        np.testing.assert_allclose(result.reachable, [[0.3, 0.3]], atol=1e-9)
        np.testing.assert_allclose(result.pdw, [[0.3, 0.3]], atol=1e-9)
        assert len(result.piw) == 0
        assert result.fraction == 0.0


# --- points ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("point", "kind"),
    [
        ((0.1, 0.0), "path independent"),
        ((0.0, -0.4), "path dependent"),
        ((1.0, 0.0), "path independent"),  # C of figure 7
        ((1.5, 1.5), "path dependent"),  # the target of figures 5 and 6
        ((3.0, 0.0), "unreachable"),
        ((1.5, 1.5, 0.0), "path dependent"),
        ((1.5, 0.0, 1.0), "unreachable"),  # beside the plane
    ],
)
def test_what_can_happen_at_a_point(planar2, point, kind):
    region = planar2.regions(point)
    assert region.kind == kind
    assert bool(region.singular) == (kind == "path dependent")
    for cfg in region.singular:
        assert sa.singularity(cfg).sigma_min < 1e-9
        np.testing.assert_allclose(cfg.com, 0, atol=1e-12)
        np.testing.assert_allclose(cfg.tip.translation[: len(point)], point, atol=1e-8)


@pytest.mark.slow
def test_a_point_of_a_spatial_arm():
    result = sa.workspace(sa.load("mda6"), effort=20_000)
    region = result.regions((1.0, -2.0, 0.5))
    assert region.kind == "path dependent"
    cfg = region.singular[0]
    np.testing.assert_allclose(cfg.tip.translation - cfg.com, (1.0, -2.0, 0.5), atol=1e-7)
    assert sa.singularity(cfg).sigma_min < 1e-7


def test_a_planar_arm_may_carry_its_tip_high():
    """The tip 0.3 m over the plane of the joints; the system CM is somewhere between."""
    text = sa.load("planar2").path.read_text()
    head, tail = text.rsplit('<origin xyz="1 0 0"', 1)
    arm = load_text(f'{head}<origin xyz="1 0 0.3"{tail}')
    high = arm.at([0.3, 0.4]).tip.translation[2] - arm.at([0.3, 0.4]).com[2]
    result = sa.workspace(arm)
    region = result.regions((1.5, 1.5))
    assert pytest.approx(np.linalg.norm((1.5, 1.5, high))) == region.radius
    cfg = region.singular[0]
    np.testing.assert_allclose(cfg.tip.translation, (1.5, 1.5, high), atol=1e-8)
    assert result.regions((1.5, 1.5, high)).kind == "path dependent"
    assert result.regions((1.5, 1.5, 0.0)).kind == "unreachable"


@pytest.mark.parametrize("point", [(1.0,), (np.nan, 0.0), (0, 0, 0, 0), "here", [[1], [1, 2]]])
def test_bad_points(planar2, point):
    with pytest.raises(sa.ConfigurationError, match="point"):
        planar2.regions(point)


# --- larger arms, other arms ----------------------------------------------------------------


@pytest.mark.slow
def test_shells_do_not_move_with_the_effort():
    arm = sa.load("servicer_ur5")
    once, twice = sa.workspace(arm, effort=5_000), sa.workspace(arm, effort=10_000, seed=1)
    assert once.kind == twice.kind == "certified"
    assert once.pdw[0, 0] > 0.02  # a hole, proven
    np.testing.assert_allclose(once.pdw, twice.pdw, atol=once.gap + twice.gap)
    np.testing.assert_allclose(once.reachable, twice.reachable, atol=1e-6)


def test_workspace_as_data(planar2):
    data = planar2.to_dict()
    assert data["pdw"] == planar2.pdw.tolist()
    assert "PDW [0.3510638" in repr(planar2)
    with pytest.raises(ValueError, match="read-only"):
        planar2.pdw[0, 0] = 0.0


# --- risk -----------------------------------------------------------------------------------


def test_a_risk_profile_counts(planar2):
    """Against a count by hand."""
    profile = planar2.profile(samples=20_000, bins=10, sigma_min=0.2, seed=3)
    Q = chosen(3).uniform(-np.pi, np.pi, (20_000, 2))
    values = sa.evaluate(planar2.arm, Q, ["sigma_min", "radius"])
    for i in range(10):
        low, high = profile.edges[i : i + 2]
        here = (values["radius"] >= low) & (values["radius"] <= high)
        assert profile.count[i] == pytest.approx(here.sum(), abs=1)
        near = values["sigma_min"][here] <= 0.2
        assert profile.share[i] == pytest.approx(near.mean(), abs=1e-2)


def test_where_all_is_path_independent_the_risk_by_distance_vanishes(planar2):
    """Well inside the PIW no configuration is within a small joint distance of a singularity."""
    profile = planar2.profile(samples=100_000, distance=0.02, bins=40)
    a, b = planar2.piw[1]
    middle = (profile.edges[:-1] > a + 0.05) & (profile.edges[1:] < b - 0.05)
    assert middle.sum() > 5
    assert (profile.share[middle] == 0).all()
    outer = (profile.edges[:-1] > b) & (profile.edges[1:] < planar2.pdw[1, 1])
    assert (profile.share[outer] > 0).all()


def test_risk_takes_every_arm():
    profile = sa.risk_profile(sa.load("chaser7"), samples=5000, bins=8)
    assert profile.count.sum() == 5000
    again = sa.risk_profile(sa.load("chaser7"), samples=5000, bins=8)
    np.testing.assert_array_equal(profile.share, again.share)


def test_poses_of_near_singular_configurations_are_risky():
    """planar2: a pose is reached by few configurations, so that its own tells its risk."""
    arm = sa.load("planar2")
    found = sa.pose_risk(arm, poses=400, neighbours=20, sigma_min=0.1)
    assert ((found.share >= 0) & (found.share <= 1)).all()
    Q = chosen(0).uniform(-np.pi, np.pi, (20_000, 2))[:400]
    own = sa.evaluate(arm, Q, ["sigma_min"])["sigma_min"]
    cfgs = [arm.at(q) for q in Q]
    np.testing.assert_allclose(found.centre, [c.tip.actInv(c.com) for c in cfgs], atol=1e-12)
    assert found.share[own < 0.05].mean() > 0.6
    assert found.share[own > 0.2].mean() < 0.1


def test_poses_of_all_configurations_give_the_whole_share():
    """With all configurations as neighbours of each pose, each share is that of all."""
    arm = sa.load("planar2")
    found = sa.pose_risk(arm, poses=3, neighbours=500, samples=500, sigma_min=0.3)
    Q = chosen(0).uniform(-np.pi, np.pi, (500, 2))
    share = (sa.evaluate(arm, Q, ["sigma_min"])["sigma_min"] <= 0.3).mean()
    np.testing.assert_allclose(found.share, share, atol=1e-12)
    with pytest.raises(sa.ConfigurationError, match="fewer samples"):
        sa.pose_risk(arm, poses=10, samples=5)


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"bins": 0}, sa.ConfigurationError),
        ({"sigma_min": 0.1, "distance": 0.1}, sa.ConfigurationError),
    ],
)
def test_bad_risk(options, error):
    with pytest.raises(error):
        sa.risk_profile(sa.load("planar2"), **options)


def test_risks_are_those_of_the_mode():
    held = sa.workspace(sa.load("planar2"), mode="fixed")
    profile = held.profile(samples=2000, bins=4)
    assert profile.mode == "fixed"
    designs = sa.design.workspaces(held.arm, {"base_inertia": [1.0]}, mode="fixed", risk_bins=4)
    share = float(designs["near_share"][0])
    assert share == pytest.approx(profile.overall, abs=6.0 * profile.overall_error)
    floating = sa.risk_profile(held.arm, samples=2000, bins=4)
    assert floating.overall_kinematic < profile.overall


def test_the_centre_seen_from_the_tip_is_that_of_the_configurations():
    """By compiled equations, for every kind of joint."""
    for name in ("planar3", "mda6", "chaser7"):
        arm = sa.load(name)
        found = sa.pose_risk(arm, limits=True, poses=200, neighbours=3, samples=200, seed=5)
        Q = uniform(arm, True, 200, chosen(5))
        wanted = np.array([cfg.tip.actInv(cfg.com) for cfg in map(arm.at, Q)])
        np.testing.assert_allclose(found.centre, wanted, atol=1e-12 * np.abs(wanted).max())


# --- pictures -------------------------------------------------------------------------------


@pytest.mark.slow
def test_pictures_are_labelled(planar2):
    held = {"joint_4": 0.0, "joint_5": 0.3, "joint_6": 0.0}
    spatial = sa.workspace(sa.load("mda6", task="position", locked=held))
    profile = planar2.profile(samples=2_000)
    rings = sa.plot(planar2, path=np.array([[2.0, 0.0], [1.5, 1.5]]))
    texts = {text.get_text() for text in rings.axes[0].texts}
    assert {"path dependent", "path independent", "tip path", "0.3511", "2.287"} <= texts
    cut, curve = sa.plot(spatial, profile=profile).axes
    assert cut.get_zlabel() == "z [m]"
    for axes in (curve, sa.plot(profile).axes[0]):
        assert "[m]" in axes.get_xlabel()
        assert "[%]" in axes.get_ylabel()


# --- the command line -----------------------------------------------------------------------


def run(*arguments, cwd):
    return spacearm(*arguments, cwd=cwd)


def test_command_prints_and_draws(tmp_path):
    (tmp_path / "path.txt").write_text("2 0\n1.7 0.8\n1.5 1.5\n")
    done = run(
        "workspace", "planar2", "--path", "path.txt", "--output", "w.svg", "--free", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    for number in ("0.3510638", "0.5536773", "1.4361702", "2.2872340", "0.5000000", "35.92%"):
        assert number in done.stdout
    assert (
        "tip path" in (tmp_path / "w.svg").read_text() or (tmp_path / "w.svg").stat().st_size > 9e3
    )


@pytest.mark.slow
def test_command_shows_the_shells_in_the_browser(tmp_path):
    command = [sys.executable, "-u", "-m", "spacearm", "workspace", "planar2", "--view"]
    shown = subprocess.Popen(
        command,
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"BROWSER": "true"},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    for line in shown.stdout:
        if "http://127.0.0.1:" in line:
            break
    shown.send_signal(signal.SIGINT)
    _, errors = shown.communicate(timeout=300)
    assert shown.returncode == 0
    assert all("computing the workspace" in line for line in errors.splitlines())  # slow machines


def test_command_as_json(tmp_path):
    done = run("workspace", "planar2", "--json", "--mode", "attitude-controlled", cwd=tmp_path)
    data = json.loads(done.stdout)
    np.testing.assert_allclose(data["pdw"], [[0.3510638, 0.5], [1.4361702, 2.2872340]], atol=1e-7)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("planar2", "--path", "nothing.txt"), "nothing.txt"),
        (("planar2", "--output", "w.gif"), "gif"),
        (("planar2", "--effort", "0"), "--effort"),
    ],
)
def test_bad_commands(arguments, message, tmp_path):
    done = run("workspace", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "planar3", "mda6"])
def test_progress_never_falls_and_proofs_by_curves_count(name):
    shares = []
    sa.workspace(sa.load(name), effort=2000, progress=lambda done, of: shares.append(done / of))
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < shares[-1] <= 1.0
    if name == "mda6":  # too many joints for branch and bound: curves are proven
        assert shares[-1] > 0.5
