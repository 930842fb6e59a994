"""Momentum budgets: the tip held, the spacecraft at rest, conservation, a clear no."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chains, chosen, load_text, random_chain, random_configuration
from helpers.replay import replay
from hypothesis import given, settings

import spacearm as sa

H = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5])


@pytest.fixture(scope="module")
def planar():
    return sa.momentum_budget(sa.load("planar2").at([-0.6, 1.4], momentum=H))


@pytest.mark.slow
@given(chains())
@settings(max_examples=5)
def test_with_the_joints_locked_all_turns_as_one_body(cfg):
    arm = cfg.arm.replace(task="position")
    if arm.n < 3:
        return
    h = np.array([0.0, 0.0, 0.0, 0.1, -0.2, 0.3])
    cfg = arm.at(cfg.q, base=cfg.base, momentum=h)
    found = sa.momentum_budget(cfg, horizon=1e-3, limits=False)
    arm_to_tip = cfg.tip.translation - cfg.com
    np.testing.assert_allclose(found.drift[3:], found.spin, atol=1e-12)
    np.testing.assert_allclose(found.drift[:3], np.cross(found.spin, arm_to_tip), atol=1e-9)
    A_b, _ = sa.momentum_matrix(cfg)
    np.testing.assert_allclose(A_b[3:, 3:] @ found.spin, h[3:], atol=1e-9)
    J = sa.generalized_jacobian(cfg)[:3]
    np.testing.assert_allclose(J @ found.rates, -found.drift[:3], atol=1e-6)


def test_the_tip_stays_while_it_is_held(planar):
    run = planar.holding
    assert planar.holds > 0.0
    np.testing.assert_allclose(run.tip[:, :2] - run.tip[0, :2], 0.0, atol=1e-7)
    assert np.abs(run.q[-1] - run.q[0]).max() > 0.1
    # the momentum of the sampled motion is that on board
    i = len(run) // 2
    dt = run.t[i + 1] - run.t[i - 1]
    dq = (run.q[i + 1] - run.q[i - 1]) / dt
    turn = pin.log3(run[i - 1].base.rotation.T @ run[i + 1].base.rotation) / dt
    A_b, A_q = sa.momentum_matrix(run[i])
    w = run[i].base.rotation @ turn
    h = A_b[3:, 3:] @ w + A_q[3:] @ dq
    np.testing.assert_allclose(h, H[3:], atol=5e-3 * 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 4, 14])
def test_the_tip_stays_where_the_motion_is_flown(seed):
    """Held up to 600 s, some to a singularity, where the joints are fastest; seeds that drifted."""
    n = 3 + seed % 6
    rng = chosen(seed)
    arm = load_text(random_chain(chosen(seed), n, ("revolute",)), tip="tip", task="position")
    h = np.concatenate((np.zeros(3), rng.normal(size=3) * 0.3))
    run = sa.momentum_budget(arm.at(rng.uniform(-1.5, 1.5, n), momentum=h), horizon=600).holding
    assert len(run) > 100
    end, _ = replay(run, momentum=h)
    np.testing.assert_allclose(end.tip.translation, run[0].tip.translation, rtol=0, atol=1e-5)


def test_it_ends_at_a_singularity_or_a_limit(planar):
    assert planar.ended in ("singularity", "joint limit")
    end = planar.holding[-1]
    if planar.ended == "singularity":
        assert sa.singularity(end).distance < np.radians(2.0)
    else:
        arm = end.arm
        assert min((arm.upper - end.q).min(), (end.q - arm.lower).min()) < 0.02


def test_twice_the_momentum_lasts_half_as_long(planar):
    cfg = planar.configuration
    double = sa.momentum_budget(cfg.arm.at(cfg.q, momentum=2 * H))
    assert double.holds == pytest.approx(planar.holds / 2, rel=1e-4)
    assert double.carries == pytest.approx(planar.carries / 2, rel=1e-4)
    np.testing.assert_allclose(double.rates, 2 * planar.rates, atol=1e-12)


def test_the_spacecraft_rests_while_the_arm_carries_the_momentum(planar):
    run = planar.carrying
    assert planar.carries > 0.0
    np.testing.assert_allclose(run.base[:, 3:], np.tile(run.base[0, 3:], (len(run), 1)), atol=1e-12)
    middle = len(run) // 2
    dq = (run.q[middle + 1] - run.q[middle]) / (run.t[middle + 1] - run.t[middle])
    between = run.arm.at(0.5 * (run.q[middle + 1] + run.q[middle]))
    np.testing.assert_allclose(
        sa.momentum_matrix(between).A_q[3:] @ dq, H[3:], rtol=1e-3, atol=1e-6
    )
    np.testing.assert_allclose(sa.reaction(run).momentum[2:-2, 2], 0.5, rtol=2e-3, atol=0)


def test_the_time_that_the_arm_carries_the_momentum_is_a_lower_bound(planar):
    """With rates that weigh the joints otherwise the arm carries the same momentum longer."""
    cfg, found = planar.configuration, planar.carries
    arm = cfg.arm
    assert f"at least {found:.4g} s" in planar.verdict

    def lasts(weights):
        q, t, h = cfg.q, 0.0, H[5]
        while t < 2.0 * found:
            D_q = sa.momentum_matrix(arm.at(q)).A_q[5]
            dq = weights * D_q * h / (weights * D_q @ D_q)
            dt = 2e-3 / np.abs(dq).max()
            q, t = q + dt * dq, t + dt
            if (q < arm.lower).any() or (q > arm.upper).any() or dt < 1e-6:
                break
        return t

    assert max(lasts(np.array([w, 1.0 - w])) for w in (0.02, 0.98)) > 1.02 * found


def turned_along(motion, h):
    """The turn of the spacecraft [rad] with momentum h, the joints moving along straight lines."""
    R, most = np.eye(3), 0.0
    for i, dt in enumerate(np.diff(motion.t)):
        dq = (motion.q[i + 1] - motion.q[i]) / dt
        for share in (0.25, 0.75):
            q = motion.q[i] + share * (motion.q[i + 1] - motion.q[i])
            base = pin.SE3(R @ motion[0].base.rotation, np.zeros(3))
            A_b, A_q = sa.momentum_matrix(motion.arm.at(q, base=base))
            R = pin.exp3(0.5 * dt * np.linalg.solve(A_b[3:, 3:], h - A_q[3:] @ dq)) @ R
        most = max(most, float(np.linalg.norm(pin.log3(R))))
    return most


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 5, 11, 22])
def test_the_spacecraft_rests_in_a_replay_as_long_as_claimed(seed):
    """Of random arms, most of which come to where D_q loses rank; there the motion ends."""
    arm = load_text(random_chain(seed, 3 + seed % 5), tip="tip")
    arm = arm if arm.n >= 6 else arm.replace(task="position")
    cfg, h = random_configuration(arm, seed), np.random.default_rng(seed).normal(size=3)
    cfg = arm.at(cfg.q, base=cfg.base, momentum=[0.0, 0.0, 0.0, *h])
    found = sa.momentum_budget(cfg, horizon=20.0, limits=False)
    run = found.carrying
    assert run.t[-1] == found.carries > 0.0
    assert turned_along(run, h) < np.radians(0.05)
    least = np.linalg.svd(sa.momentum_matrix(run[len(run) - 1]).A_q[3:], compute_uv=False)
    if found.carrying_ended == "cannot":
        assert least[2] < 5e-3 * least[0]  # it ends within some 0.01 rad of lost rank
        assert found.carries < 20.0
    else:
        assert (found.carrying_ended, found.carries) == ("horizon", 20.0)


def test_a_joint_limit_ends_the_rest_of_the_spacecraft_where_it_is_met(planar):
    arm, run = planar.configuration.arm, planar.carrying
    assert planar.carrying_ended == "joint limit"
    assert np.minimum(arm.upper - run.q, run.q - arm.lower).min(axis=1)[:-1].min() > 0.0
    room = np.minimum(arm.upper - run.q[-1], run.q[-1] - arm.lower)
    assert room.min() == pytest.approx(0.0, abs=1e-9)
    free = sa.momentum_budget(planar.configuration, horizon=2.0 * planar.carries, limits=False)
    i = int(room.argmin())
    passed = np.interp(planar.carries, free.carrying.t, free.carrying.q[:, i])
    assert passed == pytest.approx(run.q[-1, i], abs=1e-3)


def test_an_arm_that_cannot_carry_it_says_no():
    """A planar arm has no momentum about axes in its plane."""
    cfg = sa.load("planar2").at([-0.6, 1.4], momentum=[0.0, 0.0, 0.0, 0.2, 0.0, 0.0])
    found = sa.momentum_budget(cfg, horizon=10.0)
    assert found.carrying_ended == "cannot"
    assert found.carries == 0.0
    assert "cannot bring the spacecraft to rest" in found.verdict


def test_bad_input():
    arm, q = sa.load("planar2"), [-0.6, 1.4]
    with pytest.raises(sa.ConfigurationError, match="without a linear part"):
        sa.momentum_budget(arm.at(q, momentum=[1, 0, 0, 0, 0, 1]))
    with pytest.raises(sa.ConfigurationError, match="without a linear part"):
        sa.momentum_budget(arm.at(q))
    with pytest.raises(sa.ConfigurationError, match="horizon is 0"):
        sa.momentum_budget(arm.at(q, momentum=H), horizon=0)
    with pytest.raises(sa.UnsupportedError, match="2 of the 3 rows"):
        sa.momentum_budget(arm.replace(task="x y rz").at(q, momentum=H))


def test_progress_is_told_and_never_falls():
    told = []
    cfg = sa.load("planar2").at([-0.6, 1.4], momentum=H)
    sa.momentum_budget(cfg, horizon=20.0, progress=lambda *x: told.append(x))
    assert told == sorted(told)
    assert len(told) > 3
    assert told[-1] == (1000, 1000)
