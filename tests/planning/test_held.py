"""Plans with the attitude held: wheels keep within their limits, as Pinocchio and runs have it."""

import json

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chosen, load_text, random_chain, random_tree, seeds, with_wheels
from helpers.commands import spacearm
from hypothesis import given, settings
from scipy.interpolate import CubicSpline

import spacearm as sa
from spacearm.mechanics.dynamics import momentum_and_torque
from spacearm.planning.reactions import load_of, momentum_bounds
from spacearm.planning.timing import flown_spline

Q0, GOAL = [0.3, 1.2], (0.9, 1.4)
HELD = {"mode": "attitude-controlled"}


@pytest.fixture(scope="module")
def arm():
    return load_text(with_wheels("planar2", (0, 0, 1)))


@pytest.fixture(scope="module")
def found(arm):
    return sa.plan(arm.at(Q0, wheels=[2.0]), GOAL, **HELD)


def whole_momentum(arm, plan, text, t):
    """Pinocchio's momentum about the CM of arm and wheels, these as joints that spin."""
    full = load_text(text, tip="tip", joints="all")
    names = list(full.joint_names)
    mine = [names.index(name) for name in arm.joint_names]
    wheels = [names.index(wheel.name) for wheel in arm.wheels]
    data, way = full.model.createData(), plan.spline
    spins = CubicSpline(plan.t, plan.wheels)
    h = []
    for time in t:
        q, v = np.zeros(full.n), np.zeros(6 + full.n)
        q[mine], v[6:][mine], v[6:][wheels] = way(time), way(time, 1), spins(time) / 0.01
        v_full = pin.computeCentroidalMap(full.model, data, full.at(q, base=plan[0].base).full)
        v[:3] = -plan[0].base.rotation.T @ (v_full[:3] @ v) / full.mass
        h.append(pin.computeCentroidalMomentum(
            full.model, data, full.at(q, base=plan[0].base).full, v).vector)  # fmt: skip
    return np.array(h)


def test_the_momentum_of_arm_and_wheels_is_constant(arm, found):
    """At the rows, where the wheels' momenta are given, by another model of the same robot."""
    h = whole_momentum(arm, found, with_wheels("planar2", (0, 0, 1), mark=""), found.t[1:-1])
    np.testing.assert_allclose(h[:, :3], 0.0, atol=1e-9)
    np.testing.assert_allclose(h[:, 3:], [[0.0, 0.0, 2.0]] * len(h), atol=1e-9)
    np.testing.assert_array_equal(found.momentum, [[0, 0, 0, 0, 0, 2.0]] * len(found))


def test_the_wheel_keeps_its_limits_at_every_instant_and_wastes_no_time(arm, found):
    times = np.random.default_rng(0).uniform(0.0, found.t[-1], 4000)
    way = found.spline
    h, tau = momentum_and_torque(arm, way(times), way(times, 1), way(times, 2))
    assert np.abs(2.0 - h[:, 2]).max() <= 3.0
    assert 0.98 * 0.5 < np.abs(tau[:, 2]).max() <= 0.5
    assert "'wheel_0' at most 2 N m s and 0.5 N m" in found.wheel_load
    reaction = sa.reaction(found)  # by inverse dynamics
    np.testing.assert_allclose(reaction.wheels[:, 2], found.wheels[:, 0], atol=1e-9)
    assert np.abs(reaction.torque[:, 2]).max() <= 0.5


def test_the_tip_arrives_and_the_attitude_stays(found):
    assert found.mode == "attitude-controlled"
    np.testing.assert_array_equal(found.base[:, 3:], [[0, 0, 0, 1]] * len(found))
    np.testing.assert_allclose(found.com, found.com[:1].repeat(len(found), 0), atol=1e-12)
    np.testing.assert_allclose(found.tip[-1, :2], GOAL, atol=5e-8)
    assert found.certificate.free
    assert found.apart


@pytest.mark.slow
def test_a_simulation_with_wheels_that_hold_keeps_to_the_plan(found):
    hold = sa.WheelHold(stiffness=2000, damping=1000, torque=0.7, capacity=3.0)
    run = sa.simulate(
        found[0],
        sa.Tracking(found),
        found.t[-1],
        plant=sa.Plant(wheels=hold),
        integration=sa.Integration(rtol=1e-4),
    )
    assert np.linalg.norm(run.tip[-1, :2] - GOAL) < 1e-3
    assert np.abs(run.base[:, 5]).max() < 1e-3
    held = np.interp(found.t, run.t, run.wheels[:, 0])
    np.testing.assert_allclose(held, found.wheels[:, 0], atol=0.01)
    assert not [event for event in run.events if event.kind == "wheel full"]


def test_too_short_a_duration_is_refused_with_the_one_that_it_takes(arm):
    with pytest.raises(sa.NoSolutionError, match=r"'wheel_0' gives .* this way takes") as refused:
        sa.plan(arm.at(Q0), GOAL, duration=3.0, **HELD)
    needed = float(str(refused.value).split("takes ")[1].split()[0])
    assert refused.value.best.mode == "attitude-controlled"
    plan = sa.plan(arm.at(Q0), GOAL, duration=1.001 * needed, **HELD)
    assert plan.t[-1] == 1.001 * needed
    with pytest.raises(sa.NoSolutionError, match="gives"):
        sa.plan(arm.at(Q0), GOAL, duration=0.99 * needed, **HELD)


def test_momentum_scales_with_the_duration_and_its_start_counts(arm):
    """With room for momentum alone: half the room takes twice the time."""
    hold = [sa.WheelHold(stiffness=0, damping=0, capacity=c) for c in (0.4, 0.2)]
    long, longer = (
        sa.plan(arm.at(Q0), GOAL, constraints=sa.Constraints(wheels=one), **HELD) for one in hold
    )
    assert longer.t[-1] == pytest.approx(2.0 * long.t[-1], rel=1e-9)
    filled = sa.plan(
        arm.at(Q0, wheels=[-0.2]), GOAL, constraints=sa.Constraints(wheels=hold[0]), **HELD
    )
    side = np.sign(long.wheels[np.abs(long.wheels).argmax(), 0])
    expected = longer.t[-1] if side < 0 else long.t[-1] * 0.4 / 0.6
    assert filled.t[-1] <= expected * (1.0 + 1e-6)


def test_wheels_that_are_full_are_refused(arm):
    with pytest.raises(sa.NoSolutionError, match="at the start, of at most 3, "):
        sa.plan(arm.at(Q0, wheels=[3.5]), GOAL, **HELD)


def test_a_cm_that_moves_on_is_met_at_the_stated_time(arm):
    plan = sa.plan(arm.at(Q0, momentum=[0.5, 0, 0, 0, 0, 1.0]), GOAL, **HELD)
    np.testing.assert_allclose(plan.tip[-1, :2], GOAL, atol=5e-8)
    moved = plan.t[-1] * 0.5 / arm.mass
    np.testing.assert_allclose(plan.com[-1] - plan.com[0], [moved, 0, 0], atol=1e-9)
    np.testing.assert_allclose(plan.wheels[0], 1.0, atol=1e-12)
    assert np.abs(sa.reaction(plan).torque).max() <= 0.5


def test_a_plan_with_wheels_is_kept_and_shown(arm, found, tmp_path):
    found.save(tmp_path / "p.npz")
    again = sa.Plan.load(tmp_path / "p.npz", arm)
    np.testing.assert_array_equal(again.wheels, found.wheels)
    assert again.wheel_load == found.wheel_load
    assert again[5].wheels == found.wheels[5]
    assert "wheel_0" in found._repr_html_()


def test_four_wheels_share_the_momentum_of_a_spatial_arm():
    axes = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]]) / np.sqrt(3)
    text = with_wheels(random_chain(3, 4, ("revolute",)), axes, torque=2.0)
    arm = load_text(text, tip="tip", task="position")
    turned = sa.pose((0.0, 0.0, 0.0), (0.3, -0.2, 0.5))
    goal = arm.at(np.full(4, 0.4), base=turned).centred(arm.at(np.zeros(4), base=turned).com).tip
    plan = sa.plan(arm.at(np.zeros(4), base=turned, wheels=[1, 2, 0, -1]), goal.translation, **HELD)
    np.testing.assert_allclose(plan.tip[-1, :3], goal.translation, atol=1e-7)
    mark = with_wheels(random_chain(3, 4, ("revolute",)), axes, mark="")
    h = whole_momentum(arm, plan, mark, plan.t[1:-1:10])
    np.testing.assert_allclose(h, plan.momentum[: len(h)], atol=1e-8)
    assert np.abs(plan.wheels).max() <= 3.0
    np.testing.assert_allclose(
        plan.momentum[0, 3:], turned.rotation @ axes.T @ [1, 2, 0, -1], atol=1e-12
    )


def test_a_spacecraft_without_wheels_has_three():
    arm = sa.load("planar2")
    hold = sa.WheelHold(stiffness=0, damping=0, torque=0.2, capacity=1.0)
    plan = sa.plan(
        arm.at(Q0, momentum=[0, 0, 0, 0, 0, -0.4]),
        GOAL,
        constraints=sa.Constraints(wheels=hold),
        **HELD,
    )
    seen = sa.reaction(plan)
    assert plan.wheels.shape == (len(plan), 0)
    assert np.abs(seen.wheels).max() <= 1.0
    assert 0.85 * 0.2 < np.abs(seen.torque).max() <= 0.2  # the largest is between rows
    np.testing.assert_allclose(seen.wheels[0], [0, 0, -0.4], atol=1e-12)


BAD = {
    "the wheels hold": ({"wheels": [1.0], "momentum": [0, 0, 0, 0, 0, 2.0]}, HELD),
    "attitude stays": ({}, {**HELD, "final_attitude": 0.3}),
    "wheels hold no attitude": (
        {},
        {"constraints": sa.Constraints(wheels=sa.WheelHold(stiffness=0, damping=0))},
    ),
    "unknown mode|no mode|mode": ({}, {"mode": "fixed"}),
    "one for each of": ({"wheels": [1.0, 2.0]}, HELD),
}


@pytest.mark.parametrize("words", BAD)
def test_what_makes_no_sense_is_refused(arm, words):
    held, asked = BAD[words]
    with pytest.raises(sa.ConfigurationError, match=words):
        sa.plan(arm.at(Q0, **held), GOAL, **asked)


def test_wheels_that_cannot_hold_the_attitude_are_refused():
    for axis, parent in (((1, 0, 0), "bus"), ((0, 0, 1), "link_1")):
        text = with_wheels(random_chain(chosen(1), 3, ("revolute",)), axis)
        text = text.replace('parent link="bus"/><child link="rotor_0', f'parent link="{parent}"/>'
                            '<child link="rotor_0')  # fmt: skip
        arm = load_text(text, tip="tip", task="position")
        with pytest.raises(sa.UnsupportedError, match=r"cannot take|moves with the arm"):
            sa.plan(
                arm.at(np.zeros(3)),
                sa.Joints(np.full(3, 0.1)),
                constraints=sa.Constraints(limits=False),
                **HELD,
            )


@given(seeds)
@settings(max_examples=15)
def test_the_bounds_hold_on_random_trees(seed):
    """Momenta between two times, and their derivatives, on any joints that move in any way."""
    arm = load_text(random_tree(seed, 4), tip="link_4", task="position", joints="all")
    rng = np.random.default_rng(seed)
    c, t = rng.normal(size=(6, arm.n)), np.linspace(-0.3, 0.3, 61)
    way = [np.polynomial.polynomial.polyder(c, k) for k in range(5)]
    values = [np.polynomial.polynomial.polyval(t, one).T for one in way]
    bounds = momentum_bounds(arm, np.abs(values).max(axis=1)[:, :, None])[:, 0]
    h, torque = momentum_and_torque(arm, *values[:3])
    h2 = np.gradient(torque, t, axis=0)[1:-1]
    h3 = np.diff(torque, 2, axis=0) / (t[1] - t[0]) ** 2
    for found, bound in zip((h, torque, h2, h3), bounds, strict=True):
        assert np.linalg.norm(found, axis=1).max() <= bound * (1.0 + 1e-6)
    np.testing.assert_allclose(np.gradient(h, t, axis=0)[1:-1], torque[1:-1],
                               atol=1e-2 * np.abs(torque).max())  # fmt: skip


def test_more_times_are_taken_where_the_margin_asks_for_them(arm):
    t = np.linspace(0.0, 2.0, 6)
    u = (t / 2.0)[:, None]
    q = np.array([0.3, 1.2]) + u**3 * (10 - 15 * u + 6 * u * u) * [0.5, -0.4]
    load = load_of(arm, flown_spline(t, q, np.zeros(2)))
    assert len(load.t) > 50
    assert load.beyond[0] < 0.1 * np.abs(load.momentum).max()
    known = load_of(arm, flown_spline(2.5 * t, q, np.zeros(2)))
    for found, stretched in zip(load.slowed(2.5), known, strict=True):
        np.testing.assert_allclose(found, stretched, atol=1e-9 * np.abs(stretched).max())


def test_the_command_plans_within_stated_limits(tmp_path):
    words = ("planar2", 0.3, 1.2, "--goal", 0.9, 1.4, "--with", "mode=attitude-controlled")
    limits = 'constraints.wheels={"torque": 0.2, "capacity": 1.0}'
    run = spacearm("plan", *words, "--with", limits, "--json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "0.2 N m" in json.loads(run.stdout)["wheel_load"]
