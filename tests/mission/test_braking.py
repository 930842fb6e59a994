"""Braking: the shortest one that keeps all limits, by independent torques and for any limits."""

from types import SimpleNamespace

import numpy as np
import pytest

import spacearm as sa
from spacearm.mission.braking import BrakingTry, braked, shortest
from spacearm.planning.account import TimeUpError

UNBOUNDED = np.full(2, np.inf)


@pytest.mark.parametrize(
    ("least", "most", "expected"),
    [
        (0.0, 9.0, 1.0), (1.3, 9.0, 1.3), (5.0, 6.0, 5.0), (25.0, 99.0, 25.0),  # from 1 s on
        (0.0, 0.7, 0.5), (0.3, 0.7, 0.5), (0.3, 0.4, 0.3),  # 1 s leads too far
        (5.0, 4.9, None), (40.0, 99.0, None), (0.0, 0.01, None), (0.3, 0.2, None),
    ],
)  # fmt: skip
def test_the_shortest_braking_is_found_to_one_percent(least, most, expected):
    """Braking times from least to most are possible; a longer one leads too far."""

    def tried(duration: float) -> BrakingTry:
        fits = least <= duration <= most
        return BrakingTry(SimpleNamespace(T=duration) if fits else None, duration > most, "no way")

    if expected is None:
        with pytest.raises(sa.NoSolutionError, match="no way"):
            shortest(tried)
    else:
        assert expected <= shortest(tried).T <= 1.0101 * expected


def test_a_search_that_runs_out_of_time_returns_what_it_has():
    """It raises where it has none."""

    def tried(duration: float) -> BrakingTry:
        if duration not in (1.0, 2.0):
            raise TimeUpError
        fits = duration == 2.0
        return BrakingTry(SimpleNamespace(T=duration) if fits else None, False, "too short")

    def too_short(duration: float) -> BrakingTry:
        if duration > 2.0:
            raise TimeUpError
        return BrakingTry(None, False, "too short")

    assert shortest(tried).T == 2.0
    with pytest.raises(TimeUpError):
        shortest(too_short)


@pytest.mark.parametrize("share", [0.7, 0.05])
def test_braking_is_as_fast_as_torques_allow(share):
    """By inverse dynamics at times of its own; limits are shares of what 1 s takes."""
    start, rates = sa.load("planar2").at([-0.6, 1.4]), np.array([0.06, -0.09])
    mass, com = 2.0, (0.3, 0.0, 0.0)
    body = sa.Grasp(mass=mass, inertia=0.1 * np.eye(3), com=com)
    held = start.arm.grasp(mass=mass, inertia=0.1 * np.eye(3), com=com).at(start.q)

    def largest(duration: float) -> np.ndarray:
        s = np.linspace(0.0, 1.0, 101)
        torques = []
        for x in s:
            q = held.q + duration * (x - x**3 + 0.5 * x**4) * rates
            dq = (1.0 - 3.0 * x**2 + 2.0 * x**3) * rates
            ddq = 6.0 * (x**2 - x) / duration * rates
            torques.append(sa.inverse_dynamics(held.arm.at(q), dq, ddq).tau)
        return np.abs(torques).max(axis=0)

    efforts = share * largest(1.0)
    brake = braked(held, rates, body, False, efforts, UNBOUNDED)
    T = float(brake.t[-1])
    assert T > 1.0
    assert (largest(T) <= efforts).all()
    assert (largest(T) <= 1.0001 * brake.largest_torques).all()
    assert (brake.largest_torques <= efforts).all()
    assert (largest(T / 1.0101) > 0.995 * efforts).any()


def test_a_joint_near_its_limit_brakes_in_less_than_a_second():
    """From 0.01 rad before its limit at 0.1 rad/s: the way of 1 s is 0.05 rad."""
    arm = sa.load("planar2").replace(upper={"joint_2": 1.41})
    body = sa.Grasp(mass=1.0, inertia=0.1 * np.eye(3), com=(0.0, 0.0, 0.0))
    held = arm.grasp(mass=1.0, inertia=0.1 * np.eye(3), com=(0.0, 0.0, 0.0)).at([-0.6, 1.4])
    rates = np.array([0.0, 0.1])
    brake = braked(held, rates, body, True, np.full(2, 1e3), UNBOUNDED)
    assert brake.q[-1, 1] <= 1.41
    assert brake.q[-1, 1] == pytest.approx(1.4 + 0.05 * brake.t[-1], abs=1e-12)
    with pytest.raises(sa.NoSolutionError, match="joint limits"):
        braked(held, 100.0 * rates, body, True, np.full(2, 1e3), UNBOUNDED)
