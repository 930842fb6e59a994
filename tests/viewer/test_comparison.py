"""Two motions in step."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.pages import Page

import spacearm as sa
from spacearm.viewer.motions import account, compared


def floating(times=(0.0, 1.0, 2.0)):
    """A joint motion with the spacecraft floating."""
    cfgs = [sa.load("planar2").at(np.radians([-65, 40]))]
    for q in ([-65, -40], [-20, -90]):
        cfgs.append(sa.move(cfgs[-1], np.radians(q)))
    q, base = [c.q for c in cfgs], [c.base for c in cfgs]
    return sa.Motion.of(SimpleNamespace(arm=cfgs[0].arm, t=np.array(times), q=q, base=base))


def test_the_spacecraft_does_what_is_asked_under_the_same_joint_motion():
    motion = floating()
    again = compared(motion, "free-floating").motion
    np.testing.assert_allclose(again.base, motion.base, atol=1e-12)
    still = compared(motion, "fixed").motion
    assert (still.base == motion.base[0]).all()
    held = compared(motion, "attitude-controlled").motion
    np.testing.assert_allclose(held.base[:, 3:], np.tile(motion.base[0, 3:], (3, 1)), atol=1e-12)
    np.testing.assert_allclose(held.com, np.tile(motion.com[0], (3, 1)), atol=1e-12)
    for other in (again, still, held):
        np.testing.assert_array_equal(other.q, motion.q)
    with pytest.raises(sa.ConfigurationError, match="unknown comparison 'flying'"):
        compared(motion, "flying")


def test_curves_of_both_motions_share_their_times():
    motion = floating()
    told = account(motion, compared(motion, floating((0.5, 1.5, 3.0))))
    assert told["t"] == [0.0, 0.5, 1.0, 1.5, 2.0, 3.0]
    assert told["span"] == [0.0, 3.0]
    joints = next(group for group in told["curves"] if group["name"] == "joints")
    np.testing.assert_allclose(joints["values"][1][:5], [40, 0, -40, -65, -90], atol=1e-12)
    assert joints["values"][1][5] is None, "it has ended by then"
    assert joints["beside"]["values"][1][0] is None, "it has not begun yet"
    np.testing.assert_allclose(joints["beside"]["values"][1][1:4], [40, 0, -40], atol=1e-12)
    json.dumps(told, allow_nan=False)


def test_what_is_given_is_compared_and_the_page_can_ask_for_another_way():
    motion = floating()
    viewer = sa.view(motion, compare=floating((0.0, 2.0, 4.0)), open=False)
    told = viewer.about()["motion"]
    assert (told["compared"], told["ways"]["spacecraft fixed"]) == (
        "Motion, free-floating: 4 s",
        "fixed",
    )
    assert told["ways"][told["compared"]] == "given"
    before = viewer.readout()["played"]
    for way, name in (("fixed", "spacecraft fixed"), ("", None), ("given", told["compared"])):
        viewer.handle({"do": "compare", "with": way})
        assert viewer.handle({"do": "motion"})["motion"]["compared"] == name
    assert viewer.readout()["played"] == before + 3
    with pytest.raises(sa.ConfigurationError, match="unknown comparison"):
        viewer.handle({"do": "compare", "with": ["fixed"]})
    with pytest.raises(sa.ConfigurationError, match="no motion to compare; view one"):
        sa.view(motion.arm, compare="fixed", open=False)


@pytest.mark.slow
def test_a_ghost_and_dashed_curves_show_the_other_motion(browser, tmp_path):
    viewer = sa.view(floating(), compare="fixed", open=False)
    place = (
        "window.spacearm.viewer.scene_tree.find(['spacearm', 'comparison', 'tip'])"
        ".object.position.toArray()"
    )
    there = compared(floating(), "fixed").motion.at(1.0).tip.translation
    live, saved = viewer.serve(), viewer.save(tmp_path / "two.html").as_uri()
    for url in (live, saved):
        page = Page(browser, url, width=1366, height=768)
        page.wait_text("#story", "Dashed, and the blue ghost: spacecraft fixed.")
        page.page.select_option("#curves", "0")
        assert page.page.locator(".u-legend .u-series").count() == 5
        page.seek(1.0)
        page.until(lambda page=page: np.allclose(page.page.evaluate(place), there, atol=2e-3))
        if url == live:
            page.page.select_option("#compare", "attitude-controlled")
            page.wait_text("#story", "attitude held")
            assert page.text("#motion output") == "1.00 s"
            page.page.select_option("#compare", "")
            page.page.wait_for_function(
                "!document.querySelector('#story').textContent.includes('Dashed')"
            )
            assert page.page.locator(".u-legend .u-series").count() == 3
        assert page.errors == []
        page.close()
    viewer.close()
