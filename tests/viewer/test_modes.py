"""What the spacecraft does, chosen in the page."""

import numpy as np
import pytest
from helpers.pages import Page

import spacearm as sa
from spacearm.viewer.readouts import FAR, SHARES, joint_map
from spacearm.viewer.session import Session

HELD = ("attitude-controlled", "fixed")


def session(mode, name="planar3"):
    arm = sa.load(name)
    made = Session(arm, arm.at(np.linspace(0.3, 1.2, arm.n)))
    made.handle({"do": "spacecraft", "mode": mode})
    return made


@pytest.mark.parametrize("mode", HELD)
def test_readouts_motions_and_pulls_are_those_of_the_mode(mode):
    shown = session(mode)
    before = shown.cfg
    expected = sa.singularity(before, mode=mode, exact=True)
    assert shown.readout()["sigma_min"] == expected.sigma_min
    assert shown.readout()["distance"] == pytest.approx(expected.distance, rel=1e-9, abs=1e-12)
    assert expected.sigma_min != sa.singularity(before).sigma_min
    names = {}
    exec(shown.readout()["python"], names)
    assert names["report"].sigma_min == pytest.approx(expected.sigma_min)
    shown.handle({"do": "joint", "index": 0, "value": 1.0})
    shown.handle({"do": "grab", "grip": 1, "shift": [-0.05, 0.02, 0]})
    np.testing.assert_allclose(
        shown.cfg.tip.translation[:2] - shown._grabbed.translation[:2], [-0.05, 0.02], atol=2e-3
    )
    np.testing.assert_allclose(shown.cfg.base.rotation, before.base.rotation, atol=1e-12)
    if mode == "fixed":
        assert shown.cfg.base == before.base
    else:
        np.testing.assert_allclose(shown.cfg.com, before.com, atol=1e-12)
    shown.handle({"do": "nearest"})
    assert shown.report.sigma_min < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("mode", HELD)
def test_the_map_has_distances_and_singular_curves_of_the_mode(mode):
    cfg = session(mode).cfg
    told = joint_map(cfg, [1, 2], mode)
    angles = np.linspace(-np.pi, np.pi, len(told["shares"]))
    for i, j in ((5, 11), (40, 23), (52, 60)):
        q = cfg.q.copy()
        q[[1, 2]] = angles[[i, j]]
        distance = sa.singularity(cfg.arm.at(q), mode=mode).distance
        share = SHARES * min(distance / FAR, 1.0)
        assert told["shares"][j][i] == pytest.approx(share, abs=0.51)
    for x, y in (curve[len(curve) // 2] for curve in told["curves"]):
        q = cfg.q.copy()
        q[[1, 2]] = x, y
        assert sa.singularity(cfg.arm.at(q), mode=mode).distance < 1e-3
    assert len(joint_map(cfg, None, mode)["joints"]) == 2
    redundant = joint_map(sa.load("chaser7").at(np.full(7, 0.3)), [1, 2], mode)
    assert redundant["curves"] is None
    assert 0 <= np.min(redundant["shares"]) < np.max(redundant["shares"]) <= SHARES
    with pytest.raises(sa.ConfigurationError, match="two different revolute joints"):
        joint_map(cfg, [1, 1], mode)


def test_unknown_modes_are_refused_and_an_arm_keeps_its_mode():
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)
    for mode in ("fast", None, ["fixed"]):
        with pytest.raises(sa.ConfigurationError, match="unknown mode"):
            viewer.handle({"do": "spacecraft", "mode": mode})
    viewer.handle({"do": "spacecraft", "mode": "fixed"})
    viewer.handle({"do": "arm", "robot": "planar3"})
    assert viewer.readout()["spacecraft"] == "fixed"
    assert viewer.session.report.mode == "fixed"


@pytest.mark.slow
def test_the_mode_is_chosen_in_the_page(browser):
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)
    page = Page(browser, viewer.serve(), width=1366, height=768).ready()
    page.page.click("#choices summary")
    page.page.select_option("#spacecraft", "fixed")
    page.wait_text("#mapnote", "Spacecraft fixed")
    assert page.page.eval_on_selector("#modes", "box => box.disabled")
    assert viewer.session.report.mode == "fixed"
    page.page.reload()
    page.ready()
    page.page.wait_for_function("document.querySelector('#spacecraft').value === 'fixed'")
    assert page.errors == []
    page.close()
    viewer.close()
