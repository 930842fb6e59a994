"""Bounds on torques and on what hands give a shared target, between the samples of a motion."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.closed import densely, rough, several

import spacearm as sa
from spacearm.closure.shared_loads import LOOSE, least_shares, shared_peaks
from spacearm.closure.target_paths import TargetCurve
from spacearm.mission.two_hands import closed_braking, stopping
from spacearm.model.arm import kinematics
from spacearm.motion import following

FREE = "free-floating"


def braking(seed, counts, duration=1.0):
    """The braking of random arms that hold a random target, with momentum on board."""
    rng = np.random.default_rng(seed)
    start, target, grasps = rough(several(rng, counts), rng, mass=30.0)
    held = sa.hold(start, target, grasps, limits=False)
    carrying, momentum = held.carrying, rng.normal(size=6) * [0, 0, 0, 2, 2, 2]
    pose = kinematics(carrying.of_target, held.q, pin.SE3.Identity()).tip
    way = stopping(pose, 0.1 * duration * rng.normal(size=6))
    led, last, _ = following.rows_along(
        carrying.start.with_momentum(duration * momentum),
        [way],
        1.0,
        lambda at, piece: TargetCurve(carrying, at, piece, FREE, False, "spacecraft"),
        lambda *_: None,
    )
    assert last.kind == "arrived"
    moving = carrying.start.with_momentum(momentum)
    carrying.start = moving
    return carrying, closed_braking(carrying, led, duration, carrying.search(FREE), 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "counts"), [(1, (6, 6)), (3, (6, 7, 6))])
def test_what_hands_give_and_torques_are_within_their_bounds_at_every_instant(seed, counts):
    carrying, motion = braking(seed, counts)
    n, dense = motion.arm.n, densely(carrying, motion, 1500)
    most = dense.max(axis=0)
    peaks = shared_peaks(motion, carrying, margin=LOOSE)
    assert peaks.bound.shape == (dense.shape[1],)
    assert (dense <= peaks.bound * (1.0 + 1e-5)).all()
    for i, bound in enumerate(peaks.bound):
        group = most[:n] if i < n else most[n + (i - n) % 2 :: 2]
        assert bound <= most[i] + (LOOSE + 1e-3) * group.max()
    within = np.where(np.arange(len(most)) == 0, 1.01 * most, 100.0 * most)
    bound = shared_peaks(motion, carrying, allowed=within).bound
    assert (dense <= bound * (1.0 + 1e-5)).all()
    assert (bound <= np.maximum(within, most + 6e-3 * most[:n].max())).all()
    samples = np.hstack((np.abs(motion.torque), np.linalg.norm(
        motion.wrench.reshape(len(motion), -1, 3), axis=2)))  # fmt: skip
    assert (peaks.bound >= samples.max(axis=0) * (1.0 - 1e-6)).all()


def test_shares_move_the_body_and_no_other_wrenches_that_do_so_are_less():
    rng = np.random.default_rng(0)
    levers, length = rng.normal(size=(3, 3)), 0.4
    shares = least_shares(levers, length)
    W = rng.normal(size=6)

    def total(w):
        force, moment = w.reshape(-1, 2, 3)[:, 0], w.reshape(-1, 2, 3)[:, 1]
        return np.append(force.sum(axis=0), (moment + np.cross(levers, force)).sum(axis=0))

    def size(w):
        return np.linalg.norm(w.reshape(-1, 2, 3) / [[[1.0], [length]]])

    least = shares @ W
    np.testing.assert_allclose(total(least), W, atol=1e-12)
    for _ in range(20):
        other = rng.normal(size=18)
        other += shares @ (W - total(other))
        np.testing.assert_allclose(total(other), W, atol=1e-12)
        assert size(other) >= size(least)
