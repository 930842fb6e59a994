"""Leading of tips: against Pinocchio, LAPACK and the same equations run over numbers."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chosen, seeds
from hypothesis import given
from scipy.spatial.transform import Rotation

import spacearm as sa
from spacearm.compiler import numbers
from spacearm.equations import lines
from spacearm.mechanics.arm_kernels import parameters_of, structure_of
from spacearm.mechanics.distance import linearise_singly
from spacearm.motion.following import segments
from spacearm.motion.leading import Settings, _numbers, lead_all, lead_with_stops, table_of


@given(seeds)
def test_least_solutions(seed):
    rng = np.random.default_rng(seed)
    k = int(rng.integers(1, 7))
    n = k + int(rng.integers(0, 3))
    J, x = rng.normal(size=(k, n)), rng.normal(size=k)
    dq, sign = lines.least_solution(numbers, J, x)
    np.testing.assert_allclose(dq, np.linalg.pinv(J) @ x, rtol=1e-9, atol=1e-9)
    if k == n:
        assert sign == np.sign(np.linalg.det(J))


@pytest.mark.parametrize("name", ["planar2", "mda6", "chaser7"])
def test_the_tangent_keeps_momentum_and_path(name):
    """Central differences of Pinocchio's poses along it: the tip moves as the path says, D w + D_q
    dq = h, and the curve has length 1 in (q, s)."""
    arm, rng = sa.load(name), np.random.default_rng(4)
    n, step = arm.n, 1e-6
    q, turn = rng.uniform(-1.0, 1.0, n), Rotation.random(random_state=3)
    if name == "planar2":
        turn = Rotation.from_rotvec([0.0, 0.0, 0.7])
    momentum = np.array([0.0, 0.0, 0.6]) if name == "planar2" else np.array([0.3, -0.2, 0.6])

    def at(y):
        attitude = pin.Quaternion(y[n : n + 4]).normalized().matrix()
        return arm.at(y[:n], base=pin.SE3(attitude, np.zeros(3))).centred(np.zeros(3))

    y = np.concatenate((q, turn.as_quat(), [0.2]))
    cfg, twist = at(y), rng.normal(size=6)
    path = cfg.tip.translation, cfg.tip.rotation, twist[:3], twist[3:]
    k, sign = lines.tangent(
        numbers, structure_of(arm), parameters_of(arm), y, path, 10.0, 0.0, momentum
    )
    assert np.append(k[:n], k[-1]) @ np.append(k[:n], k[-1]) == pytest.approx(1.0)
    assert y[n : n + 4] @ k[n : n + 4] == pytest.approx(0.0, abs=1e-14)
    after, before = at(y + step * k), at(y - step * k)
    moved = (after.tip.translation - before.tip.translation) / (2 * step)
    turned = pin.log3(after.tip.rotation @ before.tip.rotation.T) / (2 * step)
    rows = list(arm.task.indices)
    found = np.concatenate((moved, turned))[rows]
    np.testing.assert_allclose(found, k[-1] * twist[rows], atol=1e-7)
    w = pin.log3(before.base.rotation.T @ after.base.rotation) / (2 * step)
    A = cfg.A[3:]
    h = A[:, 3:6] @ w + A[:, 6:] @ k[:n]
    np.testing.assert_allclose(h, k[-1] * momentum, atol=1e-6)
    if arm.task.k == n:
        J = sa.generalized_jacobian(cfg)[rows]
        assert sign == np.sign(np.linalg.det(J))


@pytest.mark.parametrize("name", ["planar2", "mda6"])
def test_numbers_and_machine_code_lead_alike(name):
    arm = sa.load(name)
    q = np.radians([-40.0, 70.0] if name == "planar2" else [0.0, 60.0, -100.0, -50.0, 20.0, 0.0])
    cfg = arm.at(q).centred(np.zeros(3))
    tip = cfg.tip
    middle = pin.SE3(tip.rotation, tip.translation + np.array([0.1, 0.1, 0.0]))
    goal = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.3])) @ tip.rotation, tip.translation)
    corners = [c.translation[:2] for c in (middle, goal)] if arm.n == 2 else [middle, goal]
    table = table_of([segments(cfg, corners, None)])
    how, attitude = Settings(), np.array([0.0, 0.0, 0.0, 1.0])
    led = lead_all(arm, q[None], attitude[None], table, settings=how)
    with np.errstate(all="ignore"):
        ends = lines.lead(
            numbers, structure_of(arm), parameters_of(arm), q, attitude, attitude,
            np.array([0.0, 1.0, table.pieces[-1, 1]]), table.pieces, table.intervals, 1000,
            **_numbers(arm, how, np.inf),
        )  # fmt: skip
    assert ends[2][0] == lines.ARRIVED == led.ended[0]
    assert ends[2][6] == led.steps[0]
    np.testing.assert_allclose(ends[0], led.q[0], atol=1e-10)
    np.testing.assert_allclose(ends[1], led.attitude[0], atol=1e-10)
    np.testing.assert_allclose(
        ends[2][1:6], (led.s[0], led.distance[0], led.where[0], led.slack[0], led.tilt[0]),
        atol=1e-9,
    )  # fmt: skip


@pytest.mark.parametrize("name", ["mda6", "chaser7"])
def test_the_tip_stays_on_its_path_and_the_spacecraft_turns_as_with_the_joints(name):
    arm = sa.load(name)
    q = np.array([0.0, 0.6, 0.2, -1.2, 0.1, 0.8, 0.0])[: arm.n]
    cfg = arm.at(q).centred(np.zeros(3))
    turn = pin.exp3(np.array([0.1, -0.2, 0.15]))
    goal = pin.SE3(turn @ cfg.tip.rotation, cfg.tip.translation + np.array([-0.1, 0.1, 0.1]))
    (line,) = segments(cfg, [goal], None)
    stops = 40
    led, rows = lead_with_stops(
        arm, q, np.eye(4)[3], table_of([[line]]), stops, Settings(tolerance=1e-10)
    )
    assert led.ended[0] == 0
    assert len(rows) == stops
    np.testing.assert_allclose(rows[-1], led.q[0], atol=1e-14)
    there, tilt = cfg, 0.0  # the attitude follows from the joints alone: by `move` between stops
    for i, row in enumerate(rows):
        there = sa.move(there, row)
        tilt = max(tilt, np.linalg.norm(pin.log3(there.base.rotation)))
        wanted = line.pose((i + 1) * line.length / stops)
        np.testing.assert_allclose(there.tip.translation, wanted.translation, atol=1e-4)
        assert np.linalg.norm(pin.log3(there.tip.rotation.T @ wanted.rotation)) < 1e-4
    end = Rotation.from_quat(led.attitude[0]).as_matrix()
    exact = arm.at(led.q[0], base=pin.SE3(end, np.zeros(3))).centred(np.zeros(3))
    np.testing.assert_allclose(exact.tip.translation, goal.translation, atol=1e-9)
    assert np.linalg.norm(pin.log3(exact.tip.rotation.T @ goal.rotation)) < 1e-9
    assert np.linalg.norm(pin.log3(end.T @ there.base.rotation)) < 1e-4
    assert led.tilt[0] == pytest.approx(tilt, rel=1e-3)


def test_the_least_distance_is_found_between_steps():
    """The reference's, at many points of a path whose middle is nearest to the singular set."""
    arm, rng = sa.load("planar2"), chosen(31)
    q = rng.uniform(-2.0, 2.0, 2)
    cfg = arm.at(q).centred(np.zeros(3))
    goal = cfg.tip.translation[:2] + 0.5 * rng.normal(size=2)
    table, how = table_of([segments(cfg, [goal], None)]), Settings(limits=False)
    led = lead_all(arm, q[None], np.eye(4)[3:], table, settings=how)
    _, rows = lead_with_stops(arm, q, np.eye(4)[3], table, 400, how)
    found = linearise_singly(arm, rows, "free-floating").distance
    assert 40 < found.argmin() < 360
    assert led.distance[0] == pytest.approx(found.min(), rel=2e-4)


def test_paths_are_met_between_their_knots():
    arm = sa.load("mda6")
    cfg = arm.at(np.array([0.0, 0.6, 0.2, -1.2, 0.1, 0.8])).centred(np.zeros(3))
    tip = cfg.tip

    def arc(s):
        turn = pin.exp3(np.array([0.3 * s, 0.1 * s * s, 0.2]) * min(s, 1.0))
        shift = np.array([0.3 * np.sin(s), 0.3 - 0.3 * np.cos(s), 0.1 * s])
        return pin.SE3(turn @ tip.rotation, tip.translation + shift)

    goal = pin.SE3(pin.exp3(np.array([2.0, 1.0, -2.5])) @ tip.rotation, tip.translation + 0.3)
    for pieces, exact in ((segments(cfg, [goal], None), 1e-13), (segments(cfg, arc, 0.8), 1e-7)):
        table, path = table_of([pieces]), pieces[-1]
        for s in np.linspace(0.0, path.length, 23):
            R, x = path.pose(s).rotation, path.pose(s).translation
            place, attitude, v, w = lines.at_length(
                numbers, table.pieces, table.intervals, len(pieces) - 1, s + table.pieces[-1, 0]
            )
            np.testing.assert_allclose(place, x, atol=exact)
            np.testing.assert_allclose(attitude, R, atol=exact)
            np.testing.assert_allclose(np.append(v, w), path.twist(s), atol=1e4 * exact)
