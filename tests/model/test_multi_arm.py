"""Several arms on one spacecraft: each tip by itself, several stacked, others prescribed."""

import warnings

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import (
    load_text,
    moved,
    planar_pair,
    random_base,
    random_tree,
    seeds,
)
from hypothesis import given

import spacearm as sa

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    import spacearm.viewer.viewer

SERVICER = sa.Bus(mass=200, size=(1, 1, 1))
LEFT, RIGHT = (pin.SE3(np.eye(3), np.array([0, y, 0.5])) for y in (0.3, -0.3))
BASES = ("free-floating", "attitude-controlled", "fixed")


def dual(seed=1, tip=("left", "right")) -> sa.Configuration:
    rng = np.random.default_rng(seed)
    return sa.load("dual_ur5", tip=tip, joints="all").at(
        rng.uniform(-3, 3, 12), base=random_base(rng)
    )


@given(seeds)
def test_stacked_rows_are_the_single_ones(seed):
    rng = np.random.default_rng(seed)
    text = random_tree(seed, 5)
    tips = ("link_5", "link_2", "link_4")
    both = load_text(text, tip=tips, task=sa.Task("x z ry", 0.7), joints="all")
    q, base = rng.uniform(-3, 3, both.n), random_base(rng)
    dq, h = rng.normal(size=both.n), rng.normal(size=6)
    cfg = both.at(q, base=base)
    stack = {mode: sa.generalized_jacobian(cfg, mode=mode) for mode in BASES}
    report = sa.singularity(cfg)
    for i, tip in enumerate(tips):
        rows, one = slice(6 * i, 6 * i + 6), both.replace(tip=tip).at(q, base=base)
        for mode in BASES:
            np.testing.assert_array_equal(
                stack[mode][rows], sa.generalized_jacobian(one, mode=mode)
            )
        for of in (
            sa.generalized_jacobian_derivative,
            lambda c: sa.generalized_jacobian_rate(c.with_momentum(h), dq),
        ):
            np.testing.assert_allclose(of(cfg)[..., rows, :], of(one), atol=1e-12)
        alone = sa.singularity(one).jacobian
        np.testing.assert_allclose(report.jacobian[3 * i : 3 * i + 3], alone, atol=1e-12)
        assert cfg.tips[i].isApprox(one.tip)
    assert report.jacobian.shape == (9, both.n)


def test_the_report_of_two_tips_is_that_of_the_stack():
    cfg = dual()
    report = sa.singularity(cfg)
    assert (report.rank, cfg.arm.task.k, report.available.shape) == (12, 12, (12, 12))
    assert report.determinant == pytest.approx(np.prod(report.sigma) * np.sign(report.determinant))
    h = 1e-6
    slopes = [
        (sa.singularity(cfg.arm.at(cfg.q + h * e)).sigma_min
         - sa.singularity(cfg.arm.at(cfg.q - h * e)).sigma_min) / (2 * h)
        for e in np.eye(12)
    ]  # fmt: skip
    np.testing.assert_allclose(report.gradient, slopes, atol=1e-6)


@pytest.mark.parametrize("base", BASES)
def test_the_second_arm_locked_is_a_single_arm_with_its_mass_lumped(base):
    cfg = dual(2, "left")
    q_left, q_right = cfg.q[:6], cfg.q[6:]
    J = sa.generalized_jacobian(cfg, mode=base)[:, :6]
    names = cfg.arm.joint_names[6:]
    locked = cfg.arm.replace(locked=dict(zip(names, q_right, strict=True)))
    other = sa.mount("ur5", SERVICER, at=RIGHT).at(q_right)
    data = other.arm.model.createData()
    pin.ccrba(other.arm.model, data, other.full, np.zeros(12))
    lump = sa.Bus(mass=data.Ig.mass, inertia=data.Ig.inertia, com=other.com)
    single = sa.mount("ur5", lump, at=LEFT, name="left")
    rest = sa.prescribed_motion(cfg, dict.fromkeys(names, 0.0), mode=base)
    for found in (
        sa.generalized_jacobian(locked.at(q_left, base=cfg.base), mode=base),
        sa.generalized_jacobian(single.at(q_left, base=cfg.base), mode=base),
        rest.jacobian,
    ):
        np.testing.assert_allclose(found, J, atol=1e-12)
    assert rest.joints == locked.joint_names
    assert not rest.drift.any()


@given(seeds)
def test_prescribed_rates_and_momentum_move_the_tip_as_differences_do(seed):
    rng = np.random.default_rng(seed)
    arm = load_text(random_tree(seed, 5), tip="link_5", task="position", joints="all")
    cfg = arm.at(rng.uniform(-3, 3, arm.n), base=random_base(rng))
    dq, h = rng.normal(size=arm.n), rng.normal(size=6)
    cfg = cfg.with_momentum(h)
    v_b, step = sa.base_velocity(cfg, dq), 1e-6
    ends = [moved(cfg, dq, v_b, t).tip for t in (-step, step)]
    linear = (ends[1].translation - ends[0].translation) / (2 * step)
    angular = pin.log3(ends[1].rotation @ ends[0].rotation.T) / (2 * step)
    for free in (0, arm.n // 2, arm.n):
        rates = dict(zip(arm.joint_names[free:], dq[free:], strict=True))
        motion = sa.prescribed_motion(cfg, rates)
        assert motion.joints == arm.joint_names[:free]
        found = motion.jacobian @ dq[:free] + motion.drift
        atol = 1e-7 * (1 + np.abs(found).max())
        np.testing.assert_allclose(found, [*linear, *angular], atol=atol)


def test_prescribed_rates_are_checked():
    cfg = dual()
    with pytest.raises(sa.ConfigurationError, match="rates: unknown joint 'elbow'"):
        sa.prescribed_motion(cfg, {"elbow": 1.0})
    with pytest.raises(sa.ConfigurationError, match=r"the rate of joint .* is nan"):
        sa.prescribed_motion(cfg, {cfg.arm.joint_names[3]: np.nan})
    assert sa.prescribed_motion(cfg, {}).jacobian.shape == (12, 12)


def test_the_singular_set_of_two_planar_arms_is_exact():
    arm = planar_pair()
    assert (arm.n, arm.task.k, arm.task.names) == (4, 4, "x y")
    found = sa.singular_set(arm)
    assert found.complete
    for q in found.sample(50, np.random.default_rng(3)):
        assert sa.singularity(arm.at(q)).sigma_min < 1e-9
    heavy = planar_pair().replace(base_mass=40e9, base_inertia=6e9 * np.eye(3))
    elbows = sa.singular_set(heavy).sample(50, np.random.default_rng(3))[:, [1, 3]]
    assert np.abs(np.sin(elbows)).min(axis=1).max() < 1e-6


REFUSED = {
    "barycentric": lambda c: sa.barycentric(c),
    "evaluate": lambda c: sa.evaluate(c.arm, [c.q]),
    "evaluate, compiled": lambda c: sa.evaluate(c.arm, np.zeros((100, 12))),
    "generalized_jacobians": lambda c: sa.generalized_jacobians(c.arm, [c.q]),
    "risk": lambda c: sa.risk_profile(c.arm),
    "simulate": lambda c: sa.simulate(c, sa.JointPD(target=c.q, kp=1, kd=1), 1.0),
    "follow": lambda c: sa.follow(c, [c.tips[0]]),
    "plan": lambda c: sa.plan(c, sa.Joints(c.q + 0.1)),
    "grasp": lambda c: c.arm.grasp(1.0),
    "capture": lambda c: sa.capture(c, np.zeros(6), 1.0),
    "payload": lambda c: c.arm.replace(payload=1.0),
    "mount": lambda c: c.arm.mount,
    "the tip": lambda c: c.tip,
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_about_one_tip_says_so(what):
    with pytest.raises(sa.UnsupportedError, match=r"dual_ur5 has the tips left, right.*tip='left'"):
        REFUSED[what](dual())


def test_what_no_memory_could_hold_says_so():
    for feature in (sa.singular_set, sa.workspace, sa.singularity_polynomial):
        with pytest.raises(sa.UnsupportedError, match=r"degrees \(4, 4, 3.*lock joints"):
            feature(dual().arm)


def test_tips_are_chosen_with_care():
    arm = sa.load("dual_ur5")
    assert arm.tips == ("left",)
    assert repr(arm.replace(tip=("right", "left"))).count("tip 'right', 'left'")
    assert arm.replace(tip=("left", "right")).replace(tip="right").tip == "right"
    assert arm.replace(tip=("left", "right")).replace(base_mass=300.0).tips == ("left", "right")
    for tips in ((), ("left", "left")):
        with pytest.raises(sa.ConfigurationError, match="name one link or several different"):
            arm.replace(tip=tips)
    with pytest.raises(sa.ConfigurationError, match="unknown link 'middle'"):
        arm.replace(tip=("left", "middle"))
