"""Limits along a simulation: every one is checked at all samples, and the verdict says so."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from helpers.arms import load_text, with_wheels

import spacearm as sa
from spacearm.mission.kept_limits import CatchLimits, with_checks
from spacearm.planning.reactions import Wheels

LAW = sa.JointPD(target=[0.6, 0.8], kp=8.0, kd=4.0)
HOW = sa.Integration(dt=0.01)
NONE = CatchLimits(
    rates=np.full(2, np.inf),
    torques=np.full(2, np.inf),
    loads=np.full(2, np.inf),
    positions=False,
    clearance=None,
    wheels=None,
)


@pytest.fixture(scope="module")
def flight() -> sa.Flight:
    """An arm that grasps a body at rest beside it and moves on with it."""
    body = sa.Grasp(mass=2.0, inertia=0.1 * np.eye(3))
    phases = [
        sa.Phase(LAW, 0.5, body, name="empty", integration=HOW),
        sa.Phase(LAW, 0.5, name="holding", integration=HOW),
    ]
    return sa.simulate_phases(sa.load("planar2").at([0.3, 1.0]), phases)


def recorded(flight, name) -> np.ndarray:
    return np.abs(np.concatenate([getattr(run, name) for run in flight.phases]))


def test_a_flight_within_its_limits_says_so(flight):
    torques = 1.001 * recorded(flight, "torque").max(axis=0)
    found = with_checks(flight, replace(NONE, torques=torques))
    assert not found.exceeded
    assert "all 2 limits kept" in found.describe().verdict
    assert found.describe().tone == "good"
    for check, most in zip(found.limits, torques, strict=True):
        assert check.value == pytest.approx(most / 1.001, rel=1e-6)
        assert check.allowed == most
    assert [event.kind for event in found.events] == ["grasp"]


@pytest.mark.parametrize("what", ["torques", "rates", "loads", "clearance"])
def test_what_exceeds_a_limit_is_an_event_with_time_and_value(flight, what):
    """Half of the largest that was recorded, wherever that is; of the clearance twice the least."""
    if what == "clearance":
        least = min(run.distance.min() for run in flight.phases)
        limits, most, count = replace(NONE, clearance=2.0 * least), least, 1
        quantity = np.concatenate([run.distance for run in flight.phases])
        over = quantity < 2.0 * least
    else:
        quantity = {
            "torques": lambda: recorded(flight, "torque"),
            "rates": lambda: recorded(flight, "dq"),
            "loads": lambda: np.linalg.norm(
                np.concatenate([flight.phase_wrenches(i) for i in range(2)]).reshape(-1, 2, 3),
                axis=2,
            ),
        }[what]()
        most, count = quantity.max(axis=0), 2
        limits = replace(NONE, **{what: 0.5 * most})
        over = quantity > 0.5 * most
        most, over = most[0], over[:, 0]
    times = np.concatenate([b + run.t for b, run in zip(flight.begins, flight.phases, strict=True)])
    found = with_checks(flight, limits)
    events = [event for event in found.events if event.kind == "limit exceeded"]
    assert len(found.exceeded) == len(events) == count
    check = found.exceeded[0]
    assert check.value == pytest.approx(most, rel=1e-2)
    first = int(over.argmax())
    assert times[max(first - 1, 0)] - 1e-12 <= check.exceeded <= times[first] + 1e-12
    assert check.exceeded in [event.t for event in events]
    assert any(f"{check.value:.4g} {check.unit}" in event.detail for event in events)
    told = found.describe()
    assert told.tone == "bad"
    assert f"{count} of {len(found.limits)} limits EXCEEDED" in told.verdict
    assert check.limit in told.verdict
    assert all(a.t <= b.t for a, b in pairwise(found.events))
    assert found.to_dict()["limits"][0]["limit"] == found.limits[0].limit


def test_the_load_just_after_a_grasp_counts(flight):
    """A phase begins with it; the joined motion has no sample of its own there."""
    wrench = flight.phase_wrenches(1)[0, :3]
    loads = np.array([0.999 * np.linalg.norm(wrench), np.inf])
    (check,) = with_checks(flight, replace(NONE, loads=loads)).limits
    assert check.exceeded == pytest.approx(0.5)


def test_a_peak_between_two_samples_counts(flight):
    """Coarsely recorded, the largest rate is that of the fine record."""
    phases = [sa.Phase(LAW, 1.0, integration=sa.Integration(dt=0.02))]
    fine = [sa.Phase(LAW, 1.0, integration=sa.Integration(dt=0.002))]
    start = flight.phases[0][0]
    coarse, dense = (sa.simulate_phases(start, one) for one in (phases, fine))
    limits = replace(NONE, rates=np.full(2, 10.0))
    checks = (with_checks(one, limits).limits for one in (coarse, dense))
    sampled = recorded(coarse, "dq").max(axis=0)
    for a, b, at_samples in zip(*checks, sampled, strict=True):
        assert a.value >= at_samples
        assert a.value == pytest.approx(b.value, rel=1e-3)


def test_wheels_and_joint_ranges_count():
    """Torque and momentum of a wheel, and a joint that is led out of its range."""
    arm = load_text(with_wheels("planar2", np.eye(3)[2:], torque=0.5, rate=100.0))
    start = arm.at([0.3, 1.0])
    hold = sa.WheelHold(stiffness=1.0, damping=4.0, torque=0.5)
    flight = sa.simulate_phases(
        start, [sa.Phase(LAW, 1.0, plant=sa.Plant(wheels=hold), integration=HOW)]
    )
    wheels = Wheels.free(start, None)
    torque, momentum = (recorded(flight, name).max() for name in ("wheel_torque", "wheels"))
    weak = replace(wheels, torque=np.array([0.5 * torque]), capacity=np.array([2.0 * momentum]))
    found = with_checks(flight, replace(NONE, wheels=weak, positions=True))
    assert [check.limit for check in found.exceeded] == [f"torque of wheel {arm.wheels[0].name}"]
    middle = [check for check in found.limits if "middle of its range" in check.limit]
    assert len(middle) == np.isfinite(arm.upper - arm.lower).sum()


@pytest.mark.parametrize("side", ["upper", "lower"])
def test_a_joint_with_one_limit_is_checked(side):
    """The law drives joint_2 from 1.0 to about 0.8 rad; the other joint has no limit."""
    free = np.full(2, np.inf)
    ends = {"lower": -free, "upper": free.copy()}
    ends[side] = ends[side].copy()
    ends[side][1] = 0.95
    arm = sa.load("planar2").replace(**ends)
    law = sa.JointPD(target=[0.3, 0.8], kp=20.0, kd=20.0)
    flight = sa.simulate_phases(arm.at([0.3, 1.0]), [sa.Phase(law, 3.0, integration=HOW)])
    found = with_checks(flight, replace(NONE, positions=True))
    (check,) = found.limits
    off = flight.q[:, 1] - 0.95 if side == "upper" else 0.95 - flight.q[:, 1]
    assert check.value == pytest.approx(off.max(), abs=1e-4)
    assert check.limit.startswith(arm.joint_names[1])
    assert found.exceeded == (check,)


def test_a_clearance_has_a_time_at_which_it_is_exceeded_first(flight):
    """It is infinite before, where no singular posture was found."""
    short = sa.simulate_phases(flight.phases[0][0], [sa.Phase(LAW, 0.1, integration=HOW)])
    (run,) = short.phases
    distance = np.full(len(run), np.inf)
    distance[5:] = 0.2
    vars(run)["distance"] = distance
    (check,) = with_checks(short, replace(NONE, clearance=0.5)).limits
    assert check.exceeded == pytest.approx(run.t[5])
