"""The tip pulled by a pointer."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import joint, link, load_text, robot
from helpers.pages import Page

import spacearm as sa
from spacearm.viewer.session import HeldSession, Session


def pulled(session, shift, turn=(0, 0, 0), grip=1):
    session.handle({"do": "grab", "grip": grip, "shift": list(shift), "turn": list(turn)})
    return session


@pytest.mark.parametrize("mode", ["posture", "free-floating"])
@pytest.mark.parametrize(
    ("name", "shift"), [("planar2", [-0.2, -0.1, 0]), ("mda6", [0.1, 0.2, -0.1])]
)
def test_the_tip_goes_where_it_is_pulled_to_and_the_spacecraft_reacts(name, shift, mode):
    arm = sa.load(name)
    session = Session(arm, arm.at(np.full(arm.n, 0.7)))
    session.handle({"do": "mode", "mode": mode})
    before = session.cfg
    pulled(session, shift)
    assert session.blocked == ""
    reached = session.cfg.tip.translation - before.tip.translation
    np.testing.assert_allclose(reached, shift, atol=1e-3 * np.linalg.norm(shift) + 1e-3)
    if mode == "posture":
        assert session.cfg.base.isApprox(before.base)
    else:
        np.testing.assert_allclose(session.cfg.com, before.com, atol=1e-9)
        assert not session.cfg.base.isApprox(before.base, 1e-4)


def test_a_ring_turns_the_tip_in_place():
    arm = sa.load("mda6")
    session = Session(arm, arm.at(np.full(6, 0.7)))
    session.handle({"do": "mode", "mode": "free-floating"})
    before = session.cfg.tip
    pulled(session, np.zeros(3), [0.0, 0.0, 0.2])
    assert session.blocked == ""
    np.testing.assert_allclose(session.cfg.tip.translation, before.translation, atol=5e-3)
    turned = pin.log3(session.cfg.tip.rotation @ before.rotation.T)
    np.testing.assert_allclose(turned, [0, 0, 0.2], atol=5e-3)


def test_pulls_of_one_grip_start_at_one_place():
    arm = sa.load("planar2")
    session = Session(arm, arm.at([0.3, 1.2]))
    start = session.cfg.tip.translation
    for share in (0.2, 0.6, 1.0):
        pulled(session, [-0.2 * share, 0.1 * share, 0])
    np.testing.assert_allclose(session.cfg.tip.translation - start, [-0.2, 0.1, 0], atol=1e-3)
    pulled(session, [0.2, -0.1, 0], grip=2)
    np.testing.assert_allclose(session.cfg.tip.translation, start, atol=2e-3)


def test_a_tip_that_cannot_follow_slides_along_what_is_left_and_says_so():
    """Out of reach the arm points to the goal: the nearest point that the tip comes to."""
    arm = sa.load("planar2")
    session = Session(arm, arm.at(np.radians([20, -30])))
    pulled(session, [3.0, 0.5, 0])
    assert "in this direction it has no motion left" in session.blocked
    assert session.readout()["blocked"] == session.blocked
    shoulder, tip = np.array([0.5, 0]), session.cfg.tip.translation[:2]
    goal = arm.at(np.radians([20, -30])).tip.translation[:2] + np.array([3.0, 0.5])
    straight = (goal - shoulder) / np.linalg.norm(goal - shoulder)
    np.testing.assert_allclose(tip, shoulder + 2.0 * straight, atol=0.02)
    assert pulled(session, [0.0, 0.0, 0]).blocked == ""
    session.handle({"do": "home"})
    assert session.blocked == ""


def test_joints_stop_at_the_ends_of_their_ranges():
    arm = sa.load("mda6")
    session = Session(arm, arm.at([0.0, 0.05, 0.7, 0.7, 0.7, 0.7]))
    pulled(session, [0.0, 0.0, -3.0])
    lower, upper = session.range
    assert (session.cfg.q >= lower).all()
    assert (session.cfg.q <= upper).all()
    assert session.blocked


def test_a_blocked_tip_names_what_the_spacecraft_does():
    arm = sa.load("planar2")
    session = Session(arm, arm.at(np.radians([20, -30])))
    pulled(session, [3.0, 0.5, 0])
    assert session.blocked.endswith("while the spacecraft keeps the attitude shown")
    session.handle({"do": "mode", "mode": "free-floating"})
    pulled(session, [3.0, 0.5, 0], grip=2)
    assert session.blocked.endswith("while the spacecraft is free-floating")
    session.handle({"do": "spacecraft", "mode": "attitude-controlled"})
    pulled(session, [3.0, 0.5, 0], grip=3)
    assert session.blocked.endswith("while the spacecraft is attitude-controlled")


def panel_in_two_hands(target=True):
    arm = sa.load("dual_ur5", tip=["left", "right"])
    panel = sa.Target(sa.Bus(90, size=(0.1, 1.0, 0.5), name="panel"), sa.pose((0.7, 0, 0.9)))
    sides, forward = (("left", 0.35), ("right", -0.35)), (0, np.pi / 2, 0)
    handles = {tip: sa.pose((-0.15, y, 0), forward) for tip, y in sides}
    held = sa.hold(arm.at([-0.2, -1.4, 1.4, 0, 1.4, -1.6] * 2), panel, handles, fixed=True)
    if target:
        return held
    rails = dict(zip(arm.tips, held.configuration.tips, strict=True))
    return sa.hold(held.configuration, None, rails)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["posture", "free-floating"])
def test_what_two_hands_hold_is_dragged_and_its_grasps_stay_closed(mode):
    held = panel_in_two_hands()
    session = HeldSession(held)
    assert session.about()["task"] == list(held.arm.task.rows)
    assert np.array(session.readout()["directions"]).shape == (6, 6)
    np.testing.assert_allclose(session.report.sigma, held.report().sigma, rtol=1e-9, atol=0)
    session.handle({"do": "mode", "mode": mode})
    com, before = session.cfg.com, session.place(session.cfg)
    pulled(session, (-0.1, 0.05, 0.05), (0, 0, 0.1))
    assert session.blocked == ""
    after = session.place(session.cfg)
    np.testing.assert_allclose(
        after.translation - before.translation, (-0.1, 0.05, 0.05), atol=2e-3
    )
    assert (np.abs(session.cfg.com - com).max() < 1e-9) == (mode == "free-floating")
    pulled(session, (3, 0, 0), grip=2)
    assert "no motion left" in session.blocked
    wanted = float(session.cfg.q[2]) + 0.2
    session.handle({"do": "joint", "index": 2, "value": wanted})
    if not session.blocked:
        assert session.cfg.q[2] == pytest.approx(wanted, abs=1e-4)
    session.handle({"do": "random"})
    assert session.held.closed
    session.handle({"do": "home"})
    np.testing.assert_allclose(session.cfg.q, held.q, atol=1e-9)
    session.handle({"do": "nearest"})
    assert "along closure" in session.note
    assert session.report.kind != "regular"
    assert session.held.closed
    sa.view(held, open=False).draw()


def test_the_page_and_the_report_call_a_singular_closure_alike():
    """Two planar arms of three joints, all on one line: only squeezing along it takes no torque."""
    parts = [link("bus", 40.0, (0, 0.3, 0))]
    for side, x in (("left", -0.5), ("right", 0.5)):
        names = ["bus", *(f"{side}_{i}" for i in range(3))]
        parts += [link(name, 4.0, (x, 0, 0)) for name in names[1:]]
        for i, pair in enumerate(pairwise(names)):
            parts.append(joint(f"{side}_j{i}", *pair, "continuous", (x + x * (i > 0), 0, 0)))
        parts += [f'<link name="{side}"/>', joint(side, names[-1], side, "fixed", (2 * x, 0, 0))]
    start = load_text(robot(*parts), tip=["left", "right"]).at(np.zeros(6))
    box = sa.Target(sa.Bus(5, size=(0.4, 0.4, 0.4)))
    held = sa.hold(start, box, dict(zip(start.arm.tips, start.tips, strict=True)))
    assert held.report().kind == "closure"
    assert HeldSession(held).readout()["kind"] == "closure"


@pytest.mark.slow
def test_the_page_plans_with_what_is_held():
    held = panel_in_two_hands()
    viewer = sa.view(held, open=False)
    from spacearm.viewer.jobs import lead_to  # after meshcat, which imports what is deprecated

    goal = held.target.pose * sa.pose((-0.05, 0, 0))
    plan = lead_to(held, goal, (), lambda *_: None)
    viewer._finished("plan", plan)
    assert viewer.about()["motion"]["span"][1] == plan.t[-1]
    viewer.handle({"do": "time", "t": float(plan.t[-1])})
    place = viewer.session.place(viewer.configuration)
    np.testing.assert_allclose(place.homogeneous, goal.homogeneous, atol=1e-6)


def test_of_hands_on_rails_the_spacecraft_is_dragged():
    session = HeldSession(panel_in_two_hands(target=False))
    before = session.cfg.base
    pulled(session, (0.05, 0.02, 0.05), (0, 0, 0.1))
    moved = session.cfg.base.translation - before.translation
    np.testing.assert_allclose(moved, (0.05, 0.02, 0.05), atol=1e-3)
    assert session.held.closed
    with pytest.raises(sa.ConfigurationError, match="drag the spacecraft"):
        session.handle({"do": "attitude", "rpy": [0, 0, 1]})


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ({}, "grip is 'None'"),
        ({"grip": 1, "shift": [1, 2]}, "shift is .* give 3 numbers"),
        ({"grip": 1, "shift": "abc"}, "shift is 'abc'"),
        ({"grip": 1, "turn": [0, 0, float("inf")]}, "turn is 'inf'"),
        ({"grip": 1, "shift": [1, 2, None]}, "shift is 'None'"),
    ],
)
def test_malformed_pulls_are_refused_and_change_nothing(message, error):
    arm = sa.load("planar2")
    session = Session(arm, arm.at([0.3, 1.2]))
    with pytest.raises(sa.ConfigurationError, match=error):
        session.handle({"do": "grab", **message})
    assert session.cfg.q.tolist() == [0.3, 1.2]


@pytest.mark.slow
def test_the_handle_is_dragged_and_turns_red_where_the_tip_cannot_follow(browser):
    viewer = sa.view(sa.load("planar2").at(np.radians([20, -60])), open=False)
    page = Page(browser, viewer.serve(), width=1366, height=768).ready()
    page.page.check("[name=mode][value=free-floating]")
    page.until(lambda: viewer.session.mode == "free-floating")
    box = page.page.locator("#grab circle").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    before, com = viewer.session.cfg.tip.translation, viewer.session.cfg.com
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x - 30, y - 20, steps=5)

    def is_under_the_pointer():
        now = page.page.locator("#grab circle").bounding_box()
        return max(abs(now["x"] - box["x"] + 30), abs(now["y"] - box["y"] + 20)) < 4

    page.until(is_under_the_pointer)
    after = viewer.session.cfg.tip.translation
    assert after[0] < before[0] - 0.02
    assert after[1] > before[1] + 0.02
    assert after[2] == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(viewer.session.cfg.com, com, atol=1e-9)
    page.page.mouse.move(x + 500, y, steps=5)
    page.wait_text("#blocked", "cannot follow")
    page.until(lambda: "blocked" in page.page.get_attribute("#grab", "class"))
    page.page.mouse.move(x - 30, y - 20, steps=5)
    page.page.wait_for_function("document.querySelector('#blocked').textContent === ''")
    page.page.mouse.up()
    page.page.focus("#grab circle")
    was = viewer.session.cfg.tip.translation
    page.page.keyboard.press("ArrowLeft")
    page.until(lambda: viewer.session.cfg.tip.translation[0] < was[0])
    assert page.errors == []
    page.close()
    viewer.close()


@pytest.mark.slow
def test_both_arms_follow_what_is_dragged_in_the_page(browser):
    viewer = sa.view(panel_in_two_hands(), open=False)
    page = Page(browser, viewer.serve(), width=1366, height=768).ready()
    session = viewer.session
    before = session.place(session.cfg)
    box = page.page.locator("#grab circle").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x - 20, y - 10, steps=4)

    def moved():
        return np.linalg.norm(session.place(session.cfg).translation - before.translation)

    page.until(lambda: moved() > 0.02)
    page.page.mouse.up()
    assert session.held.closed
    assert page.page.text_content("#directions")
    page.wait_text("#distance", "none found")
    assert not page.page.text_content("#error")
    assert page.errors == []
    page.close()
    viewer.close()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*no visuals:spacearm.ModelWarning")
def test_a_ring_turns_red_where_the_tip_cannot_follow(browser):
    inside = '<limit lower="-0.2" upper="0.2" effort="1" velocity="1"/>'
    hinge = joint("elbow", "bus", "arm", axis=(0, 1, 0), inside=inside)
    arm = load_text(robot(link("bus", 50.0), link("arm"), hinge), task="ry")
    viewer = sa.view(arm.at([0.0]), open=False)
    page = Page(browser, viewer.serve(), width=1366, height=768).ready()
    assert page.page.locator("#grab circle").count() == 0
    page.page.focus("#grab polyline")

    def is_pressed_until(text):
        page.page.keyboard.press("ArrowLeft")
        return text in page.text("#blocked")

    page.until(lambda: is_pressed_until("elbow is at the end of its range"))
    red = "getComputedStyle(document.querySelector('#grab polyline')).stroke"
    page.until(lambda: page.page.evaluate(red) == "rgb(227, 20, 47)")
    page.page.keyboard.press("ArrowRight")
    page.page.wait_for_function("document.querySelector('#blocked').textContent === ''")
    page.until(lambda: page.page.evaluate(red) != "rgb(227, 20, 47)")
    assert page.errors == []
    page.close()
    viewer.close()


@pytest.mark.slow
def test_the_robot_is_in_view_after_the_tip_was_let_go(browser):
    viewer = sa.view(sa.load("mda6"), open=False)
    page = Page(browser, viewer.serve(), width=1366, height=768).ready()
    farthest = """() => {
      const { viewer, points } = window.spacearm;
      viewer.camera.updateMatrixWorld();
      return Math.max(...points().map((p) => p.project(viewer.camera))
        .map((p) => Math.max(Math.abs(p.x), Math.abs(p.y)))); }"""
    box = page.page.locator("#grab circle").bounding_box()
    page.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.page.mouse.down()
    page.page.mouse.move(900, 20, steps=8)
    page.until(lambda: page.page.evaluate(farthest) > 1.05)
    page.page.mouse.up()
    page.until(lambda: page.page.evaluate(farthest) <= 1.0)
    assert page.errors == []
    page.close()
    viewer.close()


def test_a_tip_without_any_motion_along_its_task_is_said_to_be_singular():
    """The Jacobian is zero there: no step leads anywhere, and none divides by it."""
    parts = (link("bus", 50.0), link("upper"), link("tip", 0.1))
    parts += (joint("1", "bus", "upper"), joint("2", "upper", "tip", "fixed", (1, 0, 0)))
    arm = load_text(robot(*parts), tip="tip", task="x")
    session = Session(arm, arm.at([0.0]))
    session.handle({"do": "mode", "mode": "posture"})
    assert np.abs(session.jacobian(session.cfg)).max() == 0.0
    assert "the posture is singular" in pulled(session, (0.3, 0.0, 0.0)).blocked
