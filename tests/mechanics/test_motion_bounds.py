"""Bounds on torques and payload loads between the samples of a motion: they hold, and are near."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import joint, link, load_text, random_tree, robot
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly

import spacearm as sa
from spacearm.mechanics.motion_bounds import OnBoard, bounded_peaks, load_bends
from spacearm.motion.flights import Grasp, held_loads, load_peaks
from spacearm.motion.motion import Motion

seeds = st.integers(0, 10**6)


def quintic(rng, n, duration=0.6):
    """Joint positions as one polynomial of degree 5."""
    return PPoly(rng.normal(size=(6, 1, n)), np.array([0.0, duration]))


def bends_and_bounds(start, rng, mode="free-floating", h=1e-3):
    """Second derivatives of the torques over 20 steps, by differences, and the bounds on them.

    The joints follow a random quintic; the attitude is integrated beside them.
    """
    arm, way, t = start.arm, quintic(rng, start.arm.n), np.arange(21) * h
    turn, taus = start.base.rotation, []
    for one in t:
        cfg = arm.at(way(one), base=pin.SE3(turn, np.zeros(3)), momentum=start.momentum)
        cfg = cfg.with_wheels(start.wheels) if start.wheels.any() else cfg
        found = sa.inverse_dynamics(cfg, way(one, 1), way(one, 2), mode=mode)
        taus.append(found.tau)
        turn = pin.exp3(h * (found.twist[3:] + 0.5 * h * found.base_acceleration[3:])) @ turn
    bends = np.abs(np.diff(taus, 2, axis=0)).max(axis=0) / h**2
    bound = load_bends(arm, mode, way, t[:1], t[-1:], OnBoard.of(start))[0, : arm.n]
    return bends, bound


@pytest.mark.parametrize("mode", ["free-floating", "attitude-controlled", "fixed"])
@given(seed=seeds)
@settings(max_examples=3, deadline=None)
def test_second_derivatives_of_torques_are_within_their_bounds(seed, mode):
    """On random trees, with momentum on board."""
    arm = load_text(random_tree(seed, 4), tip="link_4", task="position", joints="all")
    rng = np.random.default_rng(seed)
    momentum = np.append(np.zeros(3), rng.normal(size=3)) if mode == "free-floating" else None
    bends, bound = bends_and_bounds(arm.at(np.zeros(arm.n), momentum=momentum), rng, mode)
    assert (bends <= bound * (1.0 + 1e-6) + 1e-4).all()


def planar_text(*more):
    """A planar arm whose spacecraft turns far more easily about x than about y and z."""
    inertia = np.diag((0.02, 0.02, 0.03))
    return robot(
        link("bus", 10.0, inertia=np.diag((0.5, 25.0, 25.0))),
        link("one", 1.0, com=(0.4, 0, 0), inertia=inertia),
        link("two", 1.0, com=(0.4, 0, 0), inertia=inertia),
        joint("joint_1", "bus", "one", "revolute", (0.5, 0, 0)),
        joint("joint_2", "one", "two", "revolute", (0.8, 0, 0)),
        *more,
    )


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_bounds_of_a_planar_arm_hold_for_momentum_across_its_plane(axis):
    """Its joints turn the spacecraft about the normal alone; such momentum turns it otherwise."""
    arm = load_text(planar_text(), tip="two", task="x y", joints="all")
    momentum = np.zeros(6)
    momentum[3 + axis] = 40.0
    bends, bound = bends_and_bounds(arm.at([0.3, 0.5], momentum=momentum), np.random.default_rng(0))
    assert (bends <= bound * (1.0 + 1e-6) + 1e-4).all()


def test_bounds_hold_for_wheels_on_links_whose_momenta_cancel_at_the_start():
    """They do so no longer once a joint has turned."""
    wheels = [
        link(f"rotor_{name}", 0.1, inertia=0.01 * np.eye(3))
        + joint(
            f"wheel_{name}", name, f"rotor_{name}", "continuous", axis=(1, 0, 0), inside="<wheel/>"
        )
        for name in ("one", "two")
    ]
    arm = load_text(planar_text(*wheels), tip="two", task="x y", joints="all")
    start = arm.at([0.0, 0.0]).with_wheels([200.0, -200.0])
    assert not start.stored.any()
    bends, bound = bends_and_bounds(start, np.random.default_rng(1))
    assert (bends <= bound * (1.0 + 1e-6) + 1e-4).all()


def test_a_peak_between_two_times_is_found_and_bounded():
    """Of a sine of which no sample is near a peak, and of one that is constant."""
    t = np.array([0.0, 1.0, 2.0])

    def values(at):
        return np.column_stack((np.sin(2.0 * np.pi * at), np.full(len(at), 3.0)))

    def bends(begin, _):
        return np.tile((4.0 * np.pi**2, 0.0), (len(begin), 1))

    peaks = bounded_peaks(values, bends, t, margin=1e-3)
    np.testing.assert_allclose(peaks.found, (1.0, 3.0), rtol=1e-3, atol=0)
    assert (peaks.bound >= (1.0, 3.0)).all()
    np.testing.assert_allclose(peaks.bound, (1.0, 3.0), rtol=1e-3, atol=0)
    assert np.abs(np.sin(2.0 * np.pi * peaks.t[0])) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_torques_and_loads_of_a_motion_with_a_payload_are_bounded(seed):
    """Twenty times as finely sampled they are no larger, and the bounds exceed them by under 2 %.

    The payload has an inertia and a CM off the tip.
    """
    rng = np.random.default_rng(seed)
    body = Grasp(mass=3.0, inertia=np.diag((0.2, 0.3, 0.4)), com=(0.1, 0.05, 0.2))
    arm = sa.load("ets7").grasp(body.mass, body.inertia, body.com)
    t = np.linspace(0.0, 2.0, 6)
    q = 0.5 * rng.normal(size=arm.n) + 0.1 * rng.normal(size=(6, arm.n))
    motion = Motion(arm, t, q, np.tile((0.0,) * 6 + (1.0,), (6, 1)))
    peaks = load_peaks(motion, body)
    way = motion.spline
    loads = []
    for one in np.linspace(0.0, 2.0, 101):
        tau, wrench = held_loads(arm.at(way(one)), way(one, 1), way(one, 2), body)
        size = np.linalg.norm(wrench.reshape(2, 3), axis=1)
        loads.append(np.append(np.abs(tau), size))
    largest = np.max(loads, axis=0)
    assert (largest <= peaks.bound * (1.0 + 1e-12)).all()
    assert (peaks.bound <= 1.02 * peaks.found).all()
    assert (peaks.found >= largest * 0.98).all()
