"""Configurations: checked input, read-only output, the sums of the bodies."""

import json

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import random_base, random_configuration, trees
from hypothesis import given

import spacearm as sa


@given(trees())
def test_cm_and_tip_are_those_of_the_bodies(cfg):
    model, data = cfg.arm.model, pin.Data(cfg.arm.model)
    pin.framesForwardKinematics(model, data, cfg.full)
    bodies = list(zip(list(data.oMi)[1:], list(model.inertias)[1:], strict=True))
    com = sum(I.mass * M.act(I.lever) for M, I in bodies) / sum(I.mass for _, I in bodies)
    assert np.allclose(cfg.com, com, atol=1e-12)
    assert cfg.tip.isApprox(data.oMf[cfg.arm.tip_frame], 1e-12)


@pytest.mark.parametrize(
    ("q", "message"),
    [
        (
            [1.0],
            r"q has shape \(1,\); planar2 needs \(2,\), one number for each of: joint_1, joint_2",
        ),
        ([[1.0, 2.0]], r"q has shape \(1, 2\)"),
        ([1.0, np.nan], "q of joint 'joint_2' is nan; give a finite number"),
        ([np.inf, 0.0], "q of joint 'joint_1' is inf"),
        (["a", "b"], r"q is \['a', 'b'\]; give numbers"),
        ([1.0, [2.0]], "q is .*; give numbers, in rows of one length"),
        (None, "q"),
    ],
)
def test_bad_q_is_named(q, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.load("planar2").at(q)


@pytest.mark.parametrize(
    ("base", "message"),
    [
        (np.eye(3), "base is a ndarray; give it as sa"),
        (pin.SE3(2 * np.eye(3), np.zeros(3)), "not a rotation matrix"),
        (pin.SE3(-np.eye(3), np.zeros(3)), "not a rotation matrix"),
        (pin.SE3(np.eye(3), np.array([np.nan, 0, 0])), "NaN, infinity"),
    ],
)
def test_bad_base_is_named(base, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.load("planar2").at([0, 0], base=base)


def test_nothing_in_a_configuration_can_be_changed():
    arm = sa.load("planar2")
    q, base = np.array([0.1, 0.2]), random_base(np.random.default_rng(0))
    cfg = arm.at(q, base=base)
    q[0] = 5.0
    base.translation = np.ones(3)
    assert cfg.q[0] == 0.1
    assert not np.allclose(cfg.base.translation, 1.0)
    for array in (cfg.q, cfg.com, cfg.A, cfg.J):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(AttributeError):
        cfg.q = q


def test_configurations_do_not_disturb_each_other():
    arm = sa.load("chaser7")
    first = random_configuration(arm, 1)
    A, J, com = first.A.copy(), first.J.copy(), first.com.copy()
    sa.singularity(random_configuration(arm, 2))
    assert np.array_equal(first.A, A)
    assert np.array_equal(first.J, J)
    assert np.array_equal(first.com, com)
    assert "chaser7" in repr(first)


def test_a_configuration_holds_its_momentum():
    h = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    cfg = sa.load("planar2").at([0.1, 0.2], momentum=h)
    assert cfg.momentum.tolist() == h
    assert not cfg.momentum.flags.writeable
    assert cfg.centred(np.ones(3)).momentum.tolist() == h
    with pytest.raises(sa.ConfigurationError, match=r"momentum is \[1, 2\]; give 6 finite numbers"):
        cfg.arm.at(cfg.q, momentum=[1, 2])


def test_a_configuration_is_plain_data():
    cfg = sa.load("planar2").at([0.1, 0.2], base=random_base(np.random.default_rng(0)))
    data = json.loads(json.dumps(cfg.to_dict(), allow_nan=False))
    names = ["arm", "joints", "q", "base", "tip", "com", "wheels", "momentum", "outside_limits"]
    assert list(data) == names
    assert (data["arm"], data["joints"]) == ("planar2", ["joint_1", "joint_2"])
    assert (data["q"], data["wheels"]) == ([0.1, 0.2], [])
    assert pin.XYZQUATToSE3(np.array(data["base"])).isApprox(cfg.base, 1e-14)
    assert pin.XYZQUATToSE3(np.array(data["tip"])).isApprox(cfg.tip, 1e-14)
    assert data["com"] == cfg.com.tolist()
    assert data["momentum"] == [0.0] * 6
    dual = sa.load("dual_ur5", tip=("left", "right"))
    assert np.shape(dual.at(np.zeros(dual.n)).to_dict()["tip"]) == (2, 7)
