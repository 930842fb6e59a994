"""Level reach: lines end where the spacecraft has turned too far; heavy buses reach farther."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_chain

import spacearm as sa

Q = np.array([-0.6, 1.4])
TILT = np.radians(0.5)


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


@pytest.fixture(scope="module")
def reach(arm):
    return sa.level_reach(arm.at(Q), np.radians(2.0), directions=24)


def test_lines_end_where_follow_has_turned_by_the_tilt(reach):
    cfg = reach.start()
    np.testing.assert_allclose(cfg.tip.translation, reach.tip, atol=1e-12)
    tilted = np.flatnonzero(reach.ended == 3)
    assert len(tilted) > 12
    for i in tilted[::6]:
        end = (reach.tip + reach.straight[i] * reach.direction[i])[:2]
        run = sa.follow(cfg, [end])
        assert run.arrived
        assert sa.reaction(run).angle.max() == pytest.approx(reach.tilt, rel=2e-3)


@pytest.mark.parametrize("seed", [504, 510, 522])
def test_no_line_of_a_random_arm_turns_it_farther(seed):
    n = 6 if seed == 510 else 3
    arm = load_text(random_chain(seed, n, ("revolute",)), task="pose" if n == 6 else "position")
    cfg = arm.at(np.random.default_rng(seed).uniform(-1.5, 1.5, n))
    reach = sa.level_reach(cfg, TILT, directions=12)
    tilted = np.flatnonzero(reach.ended == 3)[:4]
    for i in tilted:
        goal = cfg.tip.translation + reach.straight[i] * reach.direction[i]
        end = sa.follow(cfg, [pin.SE3(cfg.tip.rotation, goal) if n == 6 else goal])[-1]
        turn = np.linalg.norm(pin.log3(cfg.base.rotation.T @ end.base.rotation))
        assert TILT - 1e-5 < turn < TILT + 1e-6


def test_more_tilt_reaches_farther_and_a_margin_less(arm, reach):
    wider = sa.level_reach(arm.at(Q), np.radians(4.0), directions=24)
    assert (wider.straight >= reach.straight - 1e-9).all()
    careful = sa.level_reach(arm.at(Q), np.radians(4.0), directions=24, margin=np.radians(40.0))
    assert (careful.straight <= wider.straight + 1e-9).all()
    assert careful.volume < wider.volume


@pytest.mark.slow
def test_broken_lines_reach_more_and_follow_keeps_level_on_them(arm):
    small = np.radians(2.0)
    found = sa.level_reach(arm.at(Q), small, directions=90, planned=True)
    places = np.unique(np.round(found.point, 9), axis=0)
    straight = np.interp(
        np.arctan2(*(places - found.tip)[:, 1::-1].T) % (2 * np.pi),
        np.append(np.arange(90) * 2 * np.pi / 90, 2 * np.pi),
        np.append(found.straight, found.straight[0]),
    )
    beyond = np.linalg.norm(places - found.tip, axis=1) > straight + found.cell
    assert beyond.any()  # the attitude depends on the way
    assert (found.turn <= small).all()
    way = found.motion(places[beyond][0])
    assert way.arrived
    assert sa.reaction(way).angle.max() <= small * (1.0 + 1e-6)
    np.testing.assert_allclose(way.tip[-1, :3], places[beyond][0], atol=1e-8)
    with pytest.raises(sa.NoSolutionError, match="not among"):
        found.motion([50.0, 0.0, 0.0])


def test_of_spatial_arms_all_directions_of_space():
    arm = sa.load("mda6")
    q = np.radians([0.0, 60.0, -100.0, -50.0, 20.0, 0.0])
    found = sa.level_reach(arm.at(q), np.radians(0.5), directions=60)
    assert found.axis is None
    np.testing.assert_allclose(found.direction.mean(axis=0), 0.0, atol=0.02)
    i = int(np.flatnonzero(found.ended == 3)[0])
    cfg = found.start()
    goal = pin.SE3(cfg.tip.rotation, found.tip + found.straight[i] * found.direction[i])
    run = sa.follow(cfg, [goal])
    assert sa.reaction(run).angle.max() == pytest.approx(found.tilt, rel=5e-3)


def test_the_turn_falls_with_the_inertia_of_the_bus(arm):
    """For heavy buses w_0 = -D_q dq / I_0, so that the turn is as 1 / I_0."""
    masses = [4e4, 8e4]
    found = sa.level_envelope(arm.at(Q), [0.02], masses, directions=12, travel=0.05)
    assert found.turn[0] / found.turn[1] == pytest.approx(2.0 ** (5 / 3), rel=1e-2)
    linear = sa.level_envelope(
        arm.at(Q), [0.02], masses, directions=12, travel=0.05, same_density=False
    )
    assert linear.turn[0] / linear.turn[1] == pytest.approx(2.0, rel=1e-2)
    assert (found.followed == 1.0).all()
    light = sa.level_envelope(arm.at(Q), [0.02, 0.05], [20.0, 200.0], directions=12)
    assert (np.diff(light.mean, axis=1) > 0.0).all()
    assert (np.diff(light.mean, axis=0) > 0.0).all()


def test_bad_input(arm):
    with pytest.raises(sa.ConfigurationError, match="tilt is 0"):
        sa.level_reach(arm.at(Q), 0)
    with pytest.raises(sa.ConfigurationError, match="margin is -1"):
        sa.level_reach(arm.at(Q), 0.1, margin=-1)
    with pytest.raises(sa.UnsupportedError, match="not all linear rows"):
        sa.level_reach(sa.load("mda6").replace(task="orientation").at(np.zeros(6)), 0.1)
    with pytest.raises(sa.UnsupportedError, match="leave momentum out"):
        sa.level_reach(arm.at(Q, momentum=[0, 0, 0, 0, 0, 0.1]), 0.1)
    with pytest.raises(sa.ConfigurationError, match="is empty"):
        sa.level_envelope(arm.at(Q), [], [10.0])
    reach = sa.level_reach(arm.at(Q), 0.01, directions=4)
    with pytest.raises(sa.NoSolutionError, match="broken lines reach"):
        reach.motion(reach.tip)
