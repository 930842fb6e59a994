"""Postures in which several tips hold one target: closure, singular postures, the way out."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.arms import chosen, planar_pair, random_base
from helpers.closed import closed, debris, rates_for, rough, several
from scipy.optimize import brentq

import spacearm as sa
from spacearm.closure.closed_distances import nearest_closed
from spacearm.closure.closing import Closure, closed_motions
from spacearm.mechanics.jacobian import task_jacobian

MASSES = (1.0, 50.0, 5000.0)


def weighing(held, mass):
    """The same with a target of another mass."""
    rng = np.random.default_rng(int(mass))
    return replace(held, target=debris(rng, mass, held.target.pose))


def at_singular(held, mode="free-floating"):
    """The nearest singular posture along closure."""
    arm, cfg, target = held.arm, held.configuration, held.target
    closure = Closure(arm, tuple(held.grasps.values()), False, False)
    near = arm.at(nearest_closed(cfg, target, closure, mode))
    frame = near.tips[0] * held.grasps[arm.tips[0]].inverse()
    if target is not None:
        return sa.hold(near, target.replace(pose=frame), held.grasps, limits=False)
    return sa.hold(arm.at(near.q, base=frame.inverse()), None, held.grasps, limits=False)


@pytest.mark.parametrize("counts", [(6, 6), (7, 6), (3, 4), (6, 6, 6)])
def test_grasps_close_from_a_rough_start(counts):
    rng = np.random.default_rng(3)
    start, target, grasps = rough(several(rng, counts, ("revolute", "prismatic")), rng)
    held = sa.hold(start, target, grasps, limits=False)
    for tip, pose in zip(held.arm.tips, held.configuration.tips, strict=True):
        off = (held.target.pose * grasps[tip]).actInv(pose)
        np.testing.assert_allclose(off.homogeneous, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(
        held.configuration.base.homogeneous, start.base.homogeneous, atol=1e-12
    )
    assert held.target.mass == target.mass


def test_a_target_given_far_from_the_hands_is_reached_from_other_starts():
    rng = chosen(8)
    start, target, grasps = rough(several(rng, (6, 6)), rng, off=0.3)
    target = target.replace(pose=random_base(rng) * target.pose)
    held = sa.hold(start, target, grasps, limits=False)
    assert max(held.gap, held.turn) <= 1e-9
    kept = sa.hold(held.configuration, target, grasps, limits=False)
    np.testing.assert_array_equal(kept.q, held.q)
    np.testing.assert_allclose(
        kept.target.pose.homogeneous, held.target.pose.homogeneous, atol=1e-9
    )


@pytest.mark.parametrize("fixed", [False, True])
def test_what_is_fixed_stays_and_limits_hold(fixed):
    rng = np.random.default_rng(4)
    start, target, grasps = rough(several(rng, (6, 6)), rng, off=0.03)
    held = sa.hold(start, target, grasps, fixed=fixed)
    assert not held.configuration.outside_limits
    stays = np.allclose(held.target.pose.homogeneous, target.pose.homogeneous, rtol=0, atol=1e-12)
    assert stays == fixed


def test_closure_does_not_depend_on_where_the_spacecraft_is():
    rng = np.random.default_rng(5)
    start, target, grasps = rough(several(rng, (6, 6)), rng)
    by = random_base(rng)
    here = sa.hold(start, target, grasps, limits=False)
    there = sa.hold(
        start.arm.at(start.q, base=by * start.base),
        target.replace(pose=by * target.pose), grasps, limits=False,
    )  # fmt: skip
    np.testing.assert_allclose(there.q, here.q, atol=1e-7)
    reports = here.report(), there.report()
    np.testing.assert_allclose(reports[1].distance, reports[0].distance, rtol=1e-6, atol=0)
    assert reports[0].kind == reports[1].kind


def test_velocities_are_those_of_the_whole_system_of_equations():
    """Against section 13 solved as it stands: momentum and all grasps at once."""
    held = closed(6)
    cfg, target, n = held.configuration, held.target, held.arm.n
    motions = closed_motions(cfg, target, "free-floating")
    R = np.kron(np.eye(2), cfg.base.rotation.T)
    v_t = np.random.default_rng(1).normal(size=6)
    v_b, dq = rates_for(cfg, target, v_t)
    by = np.linalg.lstsq(motions.held, motions.rows @ v_t)[0]
    size = np.abs(np.append(v_b, dq)).max()
    np.testing.assert_allclose(motions.motions @ by, dq, atol=1e-9 * size)
    np.testing.assert_allclose(motions.spacecraft @ by, R @ v_b, atol=1e-9 * size)
    assert motions.motions.shape == (n, 6)


@pytest.mark.parametrize("seed", range(4))
def test_it_is_singular_where_the_free_hands_are_whatever_the_target_weighs(seed):
    """The least singular value of the target's map and det J* of the hands vanish together."""
    held = at_singular(closed(10 + seed))
    for mass in MASSES:
        report = weighing(held, mass).report()
        assert report.kind in ("dynamic", "kinematic")
        assert report.sigma[-1] < 1e-6 * report.sigma[0]
        assert report.lost.shape == (6, 1)
        assert report.internal.shape == (held.arm.n, 1)
    hands = np.linalg.svd(task_jacobian(held.configuration), compute_uv=False)
    assert hands[-1] < 1e-6 * hands[0]
    for mass in MASSES:
        report = weighing(closed(10 + seed), mass).report()
        assert report.kind == "regular"
        assert report.sigma[-1] > 1e-5 * report.sigma[0]


def section_13(cfg):
    """The rows of momentum and of both free hands, (18, 18) of two arms of six joints."""
    A_b, A_q = sa.momentum_matrix(cfg)
    R = np.kron(np.eye(2), cfg.base.rotation)
    return np.vstack((np.hstack((A_b, A_q)), np.hstack((cfg.J[:, :6] @ R.T, cfg.J[:, 6:]))))


def least_of_the_target(cfg, target):
    """Least over largest singular value of the twists that a held target can have.

    Over unit motions of spacecraft and joints in the null space of momentum and grasps.
    """
    place, com = target.pose.translation, target.pose.act(target.com)
    inertia = target.pose.rotation @ target.inertia @ target.pose.rotation.T
    columns = []
    for twist in np.eye(6):
        v, w = twist[:3], twist[3:]
        p = target.mass * (v + np.cross(w, com - place))
        grasps = [(*(v + np.cross(w, tip.translation - place)), *w) for tip in cfg.tips]
        columns.append([*p, *(inertia @ w + np.cross(com - cfg.com, p)), *np.negative(grasps).flat])
    whole = np.hstack((section_13(cfg), np.array(columns).T))
    rows = whole / np.linalg.norm(whole, axis=1)[:, None]
    motions = np.linalg.svd(rows)[2][len(rows) :]
    sigma = np.linalg.svd(motions[:, -6:], compute_uv=False)
    return sigma[-1] / sigma[0]


@pytest.mark.slow
def test_a_hundred_pairs_are_singular_where_section_13_says():
    """Zeros of the determinant along random lines of joints; what is held there, by its own null
    space: it loses a direction there and nowhere else, of 1 kg as of 5,000 kg."""
    rng, found = chosen(90), 0
    while found < 100:
        arm = several(rng, (6, 6))
        base, (a, b) = random_base(rng), rng.uniform(-np.pi, np.pi, (2, arm.n))

        def det(s, arm=arm, base=base, a=a, b=b):
            rows = section_13(arm.at(a + s * (b - a), base=base))
            return np.linalg.det(rows / np.linalg.norm(rows, axis=1)[:, None])

        shares = np.linspace(0.0, 1.0, 21)
        values = [det(s) for s in shares]
        falls = np.flatnonzero(np.diff(np.sign(values)))
        if not len(falls):
            continue
        found += 1
        at = brentq(det, *shares[falls[0] : falls[0] + 2], xtol=1e-15, rtol=1e-15)
        beside = shares[np.argmax(np.abs(values))]
        least = []
        for s in (at, beside):
            cfg = arm.at(a + s * (b - a), base=base)
            pose = cfg.tips[0] * random_base(rng)
            of_each = [least_of_the_target(cfg, debris(rng, mass, pose)) for mass in MASSES]
            least.append(of_each)
            if s == at:
                hands = {t: pose.actInv(tip) for t, tip in zip(arm.tips, cfg.tips, strict=True)}
                held = sa.hold(cfg, debris(rng, 50.0, pose), hands, limits=False)
                assert held.report().kind == "dynamic"
        assert max(least[0]) < 1e-9
        assert min(least[1]) > 1e3 * max(least[0])


def test_the_distance_to_first_order_is_that_of_the_posture_found_nearby():
    singular = at_singular(closed(20))
    cfg, away = singular.configuration, singular.report().away
    by = 0.01 / np.linalg.norm(away) * away
    near = sa.hold(cfg.arm.at(cfg.q + by, base=cfg.base), singular.target, singular.grasps,
                   limits=False)  # fmt: skip
    found = np.linalg.norm(at_singular(near).q - near.q)
    assert 0.001 < found <= 1.001 * np.linalg.norm(near.q - singular.q)
    np.testing.assert_allclose(near.report().distance, found, rtol=0.1, atol=0)


def test_internal_motions_leave_the_target_at_rest_and_the_grasps_closed():
    held = closed(21, (7, 7))
    report, cfg = held.report(), held.configuration
    assert report.internal.shape == (14, 2)
    for dq in report.internal.T:
        v_b = sa.base_velocity(cfg, dq)
        twists = cfg.J[:, :6] @ np.kron(np.eye(2), cfg.base.rotation.T) @ v_b + cfg.J[:, 6:] @ dq
        np.testing.assert_allclose(twists, 0.0, atol=1e-8)


def test_a_spacecraft_that_holds_handrails_moves_as_its_arms_allow():
    """Singular where the arms on a fixed base are; the tips stay, the spacecraft moves."""
    rng = np.random.default_rng(7)
    arm = several(rng, (6, 6))
    start = arm.at(rng.uniform(-1, 1, 12))
    rails = {
        tip: pose * sa.pose((0.05, 0, 0)) for tip, pose in zip(arm.tips, start.tips, strict=True)
    }
    held = sa.hold(start, None, rails, limits=False)
    cfg = held.configuration
    for tip, rail in zip(cfg.tips, rails.values(), strict=True):
        np.testing.assert_allclose(rail.actInv(tip).homogeneous, np.eye(4), atol=1e-9)
    motions = closed_motions(cfg, None, "fixed")
    still = cfg.J[:, :6] @ motions.spacecraft + cfg.J[:, 6:] @ motions.motions
    np.testing.assert_allclose(still, 0.0, atol=1e-9)
    report = at_singular(held, "fixed").report()
    assert report.kind == "kinematic"
    assert report.mode == "fixed"


def test_one_arm_on_a_handrail_is_held_where_it_is():
    arm = sa.load("chaser7")
    start = arm.at([0.2, 0.6, 0, 1.2, 0, 0.8, 0])
    held = sa.hold(start, None, {arm.tip: start.tip * sa.pose((0.1, 0.05, 0))}, fixed=True)
    np.testing.assert_allclose(held.configuration.base.homogeneous, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(held.configuration.tip.translation, start.tip.act(
        np.array([0.1, 0.05, 0])), atol=1e-9)  # fmt: skip
    fixed = sa.singularity(held.configuration, mode="fixed")
    np.testing.assert_allclose(held.report().distance, fixed.distance, rtol=0.05, atol=0)


def test_planar_arms_of_two_links_hold_with_one_freedom():
    """A five-bar chain with the target as a rod: four joints less three equations of closure."""
    arm = planar_pair()
    start = arm.at([2.0, -1.2, 1.1, 1.2])
    rod = sa.Target(sa.Bus(5.0, size=(1, 0.1, 0.1)), sa.pose((0, 1.5, 0)))
    ends = {"left": sa.pose((-0.3, 0, 0)), "right": sa.pose((0.3, 0, 0))}
    held = sa.hold(start, rod, ends, limits=False)
    report = held.report()
    assert held.arm.task.rows == ("x", "y", "rz")
    assert report.mobility == 1
    assert report.available.shape == (3, 1)
    assert report.kind == "regular"


def test_grasps_out_of_reach_are_named_with_the_gap():
    arm = planar_pair()
    rod = sa.Target(sa.Bus(5.0, size=(9, 0.1, 0.1)), sa.pose((0, 1.5, 0)))
    ends = {"left": sa.pose((-4.5, 0, 0)), "right": sa.pose((4.5, 0, 0))}
    with pytest.raises(sa.NoSolutionError, match=r"a tip stays \S+ m .* off its grasp") as raised:
        sa.hold(arm.at([2.0, -1.2, 1.1, 1.2]), rod, ends)
    assert raised.value.best.gap > 1.0


@pytest.mark.parametrize(
    ("target", "grasps", "message"),
    [
        (True, {"left": sa.pose()}, "give {tip: frame} for each tip of .*left, right"),
        (True, {"left": "ring", "right": "rail"}, "unknown grapple .*'rail'.*ring"),
        (False, {"left": "ring", "right": sa.pose()}, "no named frames"),
        (True, {"left": sa.pose(), "right": [1, 2]}, "grasp of 'right'"),
    ],
)
def test_grasps_that_make_no_sense_are_named(target, grasps, message):
    rod = sa.Target(sa.Bus(5.0, size=(1, 1, 1)), grapples={"ring": sa.pose()}) if target else None
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.hold(planar_pair().at([0, 1, 0, 1]), rod, grasps)
