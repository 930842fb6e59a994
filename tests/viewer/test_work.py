"""What the page has computed in processes of their own: plans and workspaces."""

import contextlib
import io
import os
import pickle
import threading
import time
import warnings
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from helpers.pages import Page

import spacearm as sa
from spacearm import processes
from spacearm.description.shapes import faces
from spacearm.viewer.session import Session

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    from spacearm.viewer.jobs import BackgroundJob, plan_to

TURNED = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.4])), np.zeros(3))


def answers(function, *given):
    """What a worker answers, without its process."""
    told = io.BytesIO()
    processes.answer(pickle.dumps((partial(function, *given), True)), told)
    told.seek(0)
    found = []
    with contextlib.suppress(EOFError):
        while True:
            found.append(pickle.load(told))
    return found


def background():
    """A background job, and a list of what is finished."""
    finished = []
    job = BackgroundJob(threading.RLock(), lambda: None, lambda *done: finished.append(done))
    return job, finished


def wait(condition, seconds=300.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def gone(pid):
    """Whether a process has ended, and its parent knows."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


@pytest.mark.slow
def test_a_worker_answers_with_a_plan_or_the_reason_why_there_is_none():
    arm = sa.load("planar2")
    cfg = arm.at([0.3, 1.2])
    goal = pin.SE3(np.eye(3), np.array([0.9, 1.4, 0.0]))
    *_, (kind, plan) = answers(plan_to, cfg, goal, ())
    assert kind == "done"
    np.testing.assert_allclose(plan[-1].tip.translation[:2], goal.translation[:2], atol=1e-6)
    far = pin.SE3(np.eye(3), np.array([9.0, 0.0, 0.0]))
    *_, (kind, why) = answers(plan_to, cfg, far, ())
    with pytest.raises(sa.NoSolutionError) as same:
        sa.plan(cfg, far)
    assert (kind, type(why), str(why)) == ("failed", sa.ImpossibleError, str(same.value))


def test_the_goal_is_the_tip_until_it_is_told_otherwise():
    arm = sa.load("planar2")
    session = Session(arm, arm.at([0.3, 1.2]))
    assert session.readout()["goal"] is None
    session.handle({"do": "goal"})
    assert session.goal.isApprox(session.cfg.tip)
    session.handle({"do": "goal", "position": [1, 2, 0], "rpy": [0, 0, 0.5]})
    told = session.readout()["goal"]
    np.testing.assert_allclose(told["position"], [1, 2, 0], atol=1e-12)
    np.testing.assert_allclose(told["rpy"], [0, 0, 0.5], atol=1e-15)
    for bad in ({"position": [1, 2]}, {"rpy": "north"}, {"position": [1, 2, None]}):
        with pytest.raises(sa.ConfigurationError, match="is"):
            session.handle({"do": "goal", **bad})
    assert session.readout()["goal"] == told


def test_a_plan_needs_a_goal_and_a_page_has_one_job_at_a_time(monkeypatch):
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)
    with pytest.raises(sa.ConfigurationError, match="there is no goal"):
        viewer.handle({"do": "plan"})
    begun, page = [], object()

    class Asleep:
        def __init__(self):
            self.killed = threading.Event()
            begun.append(self)

        def call(self, _, progress):
            progress(1.0, 4.0)
            self.killed.wait()
            raise processes.WorkerLostError

        def kill(self):
            self.killed.set()
            begun.clear()

        def end(self):
            pass

    monkeypatch.setattr("spacearm.viewer.jobs.Process", Asleep)
    viewer.handle({"do": "goal"})
    viewer.handle({"do": "plan"}, page)
    wait(lambda: viewer.readout()["task"] == ["plan", "planning", 1.0, 4.0])
    with pytest.raises(sa.ConfigurationError, match="planning is under way; cancel it first"):
        viewer.handle({"do": "plan"}, page)
    viewer.left(object())
    assert begun, "another page was closed"
    viewer.left(page)
    assert (begun, viewer.readout()["task"]) == ([], None)
    viewer.handle({"do": "plan"}, page)
    viewer.handle({"do": "arm", "robot": "planar3"})
    assert begun == []


def test_obstacles_are_solid_and_count(monkeypatch):
    block = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], dtype=float)
    a, b, c = faces(block).transpose(1, 0, 2)
    volume = np.einsum("mi,mi->m", a, np.cross(b, c)).sum() / 6.0
    assert volume == pytest.approx(6.0), "all faces look outwards"
    arm = sa.load("planar2")
    box = sa.Obstacle.box(0.4, pin.SE3(np.eye(3), np.array([0.5, 2.5, 0.0])), name="box")
    viewer = sa.view(arm.at([0.3, 1.2]), obstacles=box, open=False)
    begun = []
    monkeypatch.setattr(BackgroundJob, "start", lambda _, *given: begun.append(given))
    viewer.handle({"do": "goal"})
    viewer.handle({"do": "plan"})
    assert begun[0][1].args[-1] == (box,)


def test_code_after_a_plan_makes_the_plan_until_the_arm_is_moved(monkeypatch):
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2], base=TURNED), open=False)
    monkeypatch.setattr(BackgroundJob, "start", lambda *_: None)
    viewer.handle({"do": "goal", "position": [1.4, 0.9, 0.0]})
    start, goal = viewer.configuration, viewer.session.goal
    viewer.handle({"do": "plan"})
    viewer.handle({"do": "joints", "indices": [0], "values": [0.5]})
    found = sa.plan(start, goal)
    viewer._finished("plan", found)
    made = {}
    exec(viewer.readout()["python"], made)
    np.testing.assert_allclose(made["plan"].q[[0, -1]], found.q[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(made["plan"].base[-1], found.base[-1], atol=1e-9)
    viewer.handle({"do": "joints", "indices": [0], "values": [0.1]})
    code = viewer.readout()["python"]
    assert "sa.plan" not in code
    assert repr(viewer.q.tolist()) in code


@pytest.mark.slow
def test_processes_end_with_their_job_and_are_cancelled():
    arm = sa.load("planar2")
    one, finished = background()
    one.start("risk", partial(sa.risk_profile, arm), None)
    pid = one.process.pid
    wait(lambda: finished)
    ((name, profile),) = finished
    assert name == "risk"
    np.testing.assert_array_equal(profile.share, sa.risk_profile(arm).share)
    wait(lambda: gone(pid))
    far = sa.load("mda6")
    one.start("shells", partial(sa.workspace, far), None)
    pid = one.process.pid
    wait(lambda: one.readout()["task"][-1] > 0.0)
    one.cancel()
    assert one.readout() == {"task": None, "failure": None}
    wait(lambda: gone(pid), 5.0)
    one.start("shells", partial(sa.workspace, far), None)
    os.kill(one.process.pid, 9)
    wait(lambda: one.failure)
    assert one.failure == ("shells", "its worker process was ended by signal 9")
    assert len(finished) == 1


@pytest.mark.slow
def test_a_plan_is_made_to_a_picked_goal_and_played(browser):
    viewer = sa.view(sa.load("planar2").at(np.radians([20, -60])), open=False)
    page = Page(browser, viewer.serve(), width=1366, height=768).ready()
    assert page.page.is_disabled("#plan")
    tip = page.page.locator("#grab circle").bounding_box()
    page.page.click("#goalpick")
    page.page.mouse.click(tip["x"] - 50, tip["y"] - 40)
    page.page.wait_for_selector("#plan:enabled")
    goal = viewer.session.goal.translation
    assert goal[0] < viewer.session.cfg.tip.translation[0]
    assert page.page.is_hidden("#goalangles")
    page.page.click("#plan")
    page.page.wait_for_selector("#work:not([hidden])")
    page.move(0, 25)  # the page goes on meanwhile
    page.wait_text("#story", "Plan,")
    page.wait_text("#described table:last-child", "arrives")
    page.page.wait_for_selector("#work[hidden]", state="attached")
    assert viewer.q == pytest.approx(np.radians([20, -60])), "it starts where it was asked for"
    page.page.select_option("#speed", "10")
    page.page.click("#motion button")
    page.page.wait_for_function("document.querySelector('#motion button').textContent === 'Play'")
    page.until(lambda: np.allclose(viewer.session.cfg.tip.translation, goal, atol=1e-4))
    x = "#goalplace label:nth-of-type(1) input"
    page.page.fill(x, "9")
    page.page.press(x, "Enter")
    wait(lambda: viewer.session.goal.translation[0] == 9.0)
    page.page.click("#plan")
    page.wait_text("#planfailure", "the tip of planar2 comes no farther")
    assert page.errors == []
    page.close()
    viewer.close()


@pytest.mark.slow
def test_proven_ranges_are_told_with_whether_the_posture_is_in_them():
    arm = sa.load("planar2")
    viewer = sa.view(arm.at([0.3, 1.2]), open=False)
    assert viewer.readout()["box"] is None
    viewer.handle({"do": "compute", "what": "ranges"})
    wait(lambda: viewer.readout()["task"] is None)
    box = sa.free_box(arm.at([0.3, 1.2]))
    told = viewer.readout()["box"]
    low, high = np.array(told["ranges"]).T
    np.testing.assert_allclose(low, np.maximum(box.lower, viewer.session.range[0]), atol=1e-12)
    np.testing.assert_allclose(high, np.minimum(box.upper, viewer.session.range[1]), atol=1e-12)
    assert told["holds"]
    viewer.show([0.3, -1.2])
    assert not viewer.readout()["box"]["holds"]
    viewer.handle({"do": "spacecraft", "mode": "fixed"})
    assert viewer.readout()["box"] is None, "another set is singular then"


@pytest.mark.slow
def test_proven_ranges_are_marked_on_sliders(browser):
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)
    page = Page(browser, viewer.serve(), width=1366, height=768).ready()
    page.page.click("[data-compute=ranges]")
    page.wait_text("#ranges", "This posture is in them")
    strips = page.page.locator("#joints .free")
    rails = page.page.locator("#joints .rail")
    boxes = [(strips.nth(j).bounding_box(), rails.nth(j).bounding_box()) for j in (0, 1)]
    assert boxes[0][0]["width"] > 0.85 * boxes[0][1]["width"], "joint_1 turns freely"
    assert boxes[1][0]["x"] > boxes[1][1]["x"] + 0.45 * boxes[1][1]["width"], "joint_2 is positive"
    viewer.show([0.3, 0.05])
    page.wait_text("#ranges", "This posture is outside")
    page.page.click("[data-compute=ranges]")
    page.wait_text("#ranges", "This posture is in them")
    assert page.errors == []
    page.close()
    viewer.close()


@pytest.mark.slow
def test_cancel_and_a_closed_tab_end_the_process(browser):
    arm = sa.load("mda6")
    viewer = sa.view(arm.at(np.full(6, 0.4)), open=False)
    viewer.handle({"do": "goal", "position": [0.1, 0.1, -0.6], "rpy": [1.0, 2.0, 3.0]})
    for way in ("cancel", "close"):
        page = Page(browser, viewer.serve(), width=1366, height=768).ready()
        page.page.click("#plan")
        page.wait_text("#work span", "of at most 60 s")
        pid = viewer._job.process.pid
        if way == "cancel":
            page.page.click("#cancel")
            page.page.wait_for_selector("#work[hidden]", state="attached")
        page.close()
        wait(lambda pid=pid: gone(pid), 5.0)
        assert viewer.readout()["task"] is None
    viewer.close()
