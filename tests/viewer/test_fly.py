"""The tip led by hand: the servo behind the page, the flight kept as a motion, the page's keys."""

import numpy as np
import pytest
from helpers.pages import Page

import spacearm as sa
from spacearm.viewer.session import Session

TWIST = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]


def fly(session, twist=TWIST, dt=0.05, frame="inertial"):
    session.handle({"do": "fly", "twist": twist, "dt": dt, "frame": frame})


@pytest.mark.parametrize("mode", ["free-floating", "attitude-controlled", "fixed"])
def test_the_tip_goes_where_it_is_led_and_the_spacecraft_reacts(mode):
    cfg = sa.load("planar2").at(np.radians([20.0, 80.0]))
    session = Session(cfg.arm, cfg)
    session.handle({"do": "spacecraft", "mode": mode})
    for _ in range(20):
        fly(session)
    gone = session.cfg.tip.translation - cfg.tip.translation
    np.testing.assert_allclose(gone[1:], 0.0, rtol=0, atol=1e-3)
    assert 0.08 < gone[0] <= 0.1 + 1e-9
    turned = np.abs(session.cfg.base.rotation - cfg.base.rotation).max()
    assert (turned > 1e-4) == (mode == "free-floating")


def test_what_is_slowed_and_lost_is_told_and_the_flight_becomes_a_motion():
    cfg = sa.load("planar2").at(np.radians([20.0, 40.0]))
    session = Session(cfg.arm, cfg)
    assert session.readout()["flight"] is None
    told = []
    for _ in range(120):
        fly(session, [0.2, 0.0, 0.0, 0.0, 0.0, 0.0], 0.1)
        told.append(session.readout())
    assert "lost direction" in told[-1]["flight"]["slowed"]
    assert told[-1]["flight"]["done"] < 0.9
    assert told[-1]["distance"] >= np.radians(5.0)
    motion = session.landed()
    np.testing.assert_array_equal(motion.q[0], cfg.q)
    np.testing.assert_array_equal(motion.q[-1], session.cfg.q)
    np.testing.assert_allclose(motion.t[-1], 12.0, rtol=0, atol=1e-9)
    assert session.landed() is None


def test_axes_are_changed_in_flight_and_the_motion_goes_on():
    cfg = sa.load("planar2").at(np.radians([20.0, 80.0]), base=sa.pose(rpy=(0.0, 0.0, 0.7)))
    session, lost = Session(cfg.arm, cfg), []
    for frame in ("inertial", "spacecraft", "tip"):
        before = session.cfg
        R = {"spacecraft": before.base.rotation, "tip": before.tip.rotation}.get(frame, np.eye(3))
        for _ in range(10):
            fly(session, np.concatenate((R.T @ [0.05, 0.0, 0.0], np.zeros(3))).tolist(), 0.1, frame)
        gone = session.cfg.tip.translation - before.tip.translation
        np.testing.assert_allclose(gone / np.linalg.norm(gone), [1.0, 0.0, 0.0], atol=0.1)
        R = {"spacecraft": session.cfg.base.rotation, "tip": session.cfg.tip.rotation}.get(frame, R)
        lost.append(R @ session.readout()["flight"]["lost"][:3])
    np.testing.assert_allclose(lost, lost[:1] * 3, rtol=0, atol=0.3)
    motion = session.landed()
    np.testing.assert_array_equal(motion.q[0], cfg.q)
    np.testing.assert_allclose(motion.t[-1], 3.0, rtol=0, atol=1e-9)


def test_it_begins_anew_where_the_arm_was_moved_otherwise():
    cfg = sa.load("planar2").at([0.3, 1.2])
    session = Session(cfg.arm, cfg)
    fly(session)
    session.handle({"do": "joint", "index": 0, "value": 0.5})
    fly(session)
    np.testing.assert_allclose(session.landed().q[0], [0.5, session.cfg.q[1]], rtol=0, atol=0.02)


@pytest.mark.parametrize(
    "message",
    [
        {"twist": [0.1], "dt": 0.1, "frame": "tip"},
        {"twist": [np.nan] * 6, "dt": 0.1, "frame": "tip"},
        {"twist": TWIST, "dt": "long", "frame": "tip"},
        {"twist": TWIST, "dt": 0.1, "frame": "moon"},
        {},
    ],
)
def test_what_a_page_may_not_ask_is_refused_and_moves_nothing(message):
    cfg = sa.load("planar2").at([0.3, 1.2])
    session = Session(cfg.arm, cfg)
    with pytest.raises(sa.ConfigurationError):
        session.handle({"do": "fly", **message})
    assert session.cfg is cfg


@pytest.mark.slow
def test_keys_lead_the_tip_and_the_end_is_a_motion(browser):
    cfg = sa.load("planar2").at(np.radians([20.0, 60.0]))
    viewer = sa.view(cfg, open=False)
    viewer.session.fly = True
    page = Page(browser, viewer.serve(), width=1300, height=800).ready()
    assert page.text("#fly") == "End"
    page.page.keyboard.down("w")
    page.until(lambda: viewer.configuration.tip.translation[0] > cfg.tip.translation[0] + 0.05)
    page.wait_text("#flown", "Free")
    page.until(lambda: "Slowed" in page.text("#flown"))
    page.page.keyboard.up("w")
    page.page.click("#fly")
    page.page.wait_for_selector("#motion:not([hidden])")
    assert page.errors == []
    page.close()
    viewer.close()


@pytest.mark.slow
def test_a_gamepad_that_is_pulled_out_in_flight_brings_the_tip_to_rest_and_keys_go_on(browser):
    cfg = sa.load("planar2").at(np.radians([20.0, 60.0]))
    viewer = sa.view(cfg, open=False)
    viewer.session.fly = True
    page = Page(browser, viewer.serve(), width=1300, height=800).ready()
    plug = """([event, axes, connected]) => {
        navigator.getGamepads = () => [{axes, buttons: [], connected}];
        window.dispatchEvent(new Event(event));
    }"""

    def forward():
        return viewer.configuration.tip.translation[0] - cfg.tip.translation[0]

    page.page.evaluate(plug, ["gamepadconnected", [0.0, -1.0], True])
    page.until(lambda: forward() > 0.02)
    page.page.evaluate(plug, ["gamepaddisconnected", [0.0, -1.0], False])  # as it was at last
    page.wait_text("#flown", "disconnected")
    page.until(lambda: not viewer.session.readout()["flight"]["moving"])
    assert "disconnected" in page.text("#flown")
    rests = forward()
    page.page.wait_for_timeout(300)
    assert forward() == rests
    page.page.keyboard.down("s")
    page.until(lambda: forward() < rests - 0.01)
    assert "disconnected" not in page.text("#flown")
    page.page.keyboard.up("s")
    assert page.errors == []
    page.close()
    viewer.close()


@pytest.mark.slow
def test_a_stick_leads_the_tip_and_with_a_shoulder_button_turns_it(browser):
    cfg = sa.load("planar3").at(np.radians([20.0, 60.0, 60.0]))
    viewer = sa.view(cfg, open=False)
    viewer.session.fly = True
    page = Page(browser, viewer.serve(), width=1300, height=800).ready()

    def pad(axes, *pressed):
        held = [{"pressed": i in pressed} for i in range(6)]
        given = [None, {"axes": axes, "buttons": held}]  # the first place is of one pulled out
        page.page.evaluate("pads => { navigator.getGamepads = () => pads; }", given)

    def gone(since):
        here = viewer.configuration.tip
        turned = here.rotation @ since.rotation.T
        return here.translation - since.translation, np.arctan2(turned[1, 0], turned[0, 0])

    def rested():
        pad([0.05, -0.1, 0.0, 0.1])  # a stick that rests is never quite at zero
        last = None
        while last is None or not np.array_equal(viewer.configuration.q, last):
            last = viewer.configuration.q
            page.page.wait_for_timeout(1000)
        return viewer.configuration.tip

    pad([0.0, -1.0, 0.0, 0.0])
    page.until(lambda: gone(cfg.tip)[0][0] > 0.05, 120.0)
    here = rested()
    way, angle = gone(cfg.tip)
    assert max(abs(way[1]), abs(angle)) < 0.1 * way[0]
    pad([0.0, 0.0, 0.0, -1.0], 5)
    page.until(lambda: gone(here)[1] > 0.05, 120.0)
    rested()
    way, angle = gone(here)
    assert np.linalg.norm(way) < 0.1 * angle
    page.page.click("#fly")
    page.page.wait_for_selector("#motion:not([hidden])")
    assert page.errors == []
    page.close()
    viewer.close()
