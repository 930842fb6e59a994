"""Workspaces and risk, drawn cut open."""

import warnings

import numpy as np
import pinocchio as pin
import pytest
import umsgpack
from helpers.pages import Page

import spacearm as sa

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    from spacearm.viewer.jobs import BackgroundJob
    from spacearm.viewer.layers import annulus, half_sphere


def drawn(viewer, layer):
    """Vertices (m, 3) of the meshes of a layer, by path."""
    found = {}
    for command in map(umsgpack.unpackb, viewer.window.commands()):
        if command["type"] == "set_object" and f"/spacearm/{layer}/" in command["path"]:
            (geometry,) = command["object"]["geometries"]
            array = geometry["data"]["attributes"]["position"]["array"].data
            found[command["path"]] = np.frombuffer(array, dtype=np.float32).reshape(-1, 3)
    return found


def area(vertices, faces):
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0


def test_rings_and_half_spheres_have_their_areas_and_face_the_viewer():
    view = np.array([0.3, -0.5, 0.7])
    vertices, faces = annulus(1.0, 2.0, view)
    assert area(vertices, faces) == pytest.approx(np.pi * (4.0 - 1.0), rel=2e-3)
    np.testing.assert_allclose(vertices @ view, 0.0, atol=1e-12)
    ball = half_sphere(2.0, view)
    assert area(ball.vertices, ball.faces) == pytest.approx(2.0 * np.pi * 4.0, rel=2e-3)
    assert (ball.vertices @ view < 1e-6).all(), "the half in front is cut away"


def test_a_plane_workspace_is_drawn_as_rings_of_its_radii_that_turn_with_the_arm():
    arm = sa.load("planar2")
    space = sa.workspace(arm)
    base = pin.SE3(pin.utils.rotate("x", 0.5), np.array([1.0, 2.0, 3.0]))
    viewer = sa.view(arm.at([0.3, 1.2], base=base), open=False)
    viewer.shells(space)
    rings = drawn(viewer, "shells")
    radii = {path: np.linalg.norm(points, axis=1) for path, points in rings.items()}
    for name, ranges in (("path dependent", space.pdw), ("path independent", space.piw)):
        for i, (low, high) in enumerate(ranges):
            R = next(r for path, r in radii.items() if path.endswith(f"{name}/ring_{i}"))
            np.testing.assert_allclose([R.min(), R.max()], [low, high], atol=1e-6)
    (pose,) = (
        command["matrix"]
        for command in map(umsgpack.unpackb, viewer.window.commands())
        if command["type"] == "set_transform" and command["path"].endswith("spacearm/shells")
    )
    pose = np.array(pose).reshape(4, 4).T
    np.testing.assert_allclose(pose[:3, 2], base.rotation[:, 2], atol=1e-12)
    np.testing.assert_allclose(pose[:3, 3], viewer.configuration.com, atol=1e-12)


def test_the_page_asks_for_what_can_be_computed(monkeypatch):
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)
    begun = []
    monkeypatch.setattr(BackgroundJob, "start", lambda _, *given: begun.append(given))
    viewer.handle({"do": "compute", "what": "risk"})
    name, function, _ = begun[0]
    assert (name, function.args) == ("risk", (viewer.session.arm,))
    for what in ("everything", None, ["risk"]):
        with pytest.raises(sa.ConfigurationError, match="unknown layer to compute"):
            viewer.handle({"do": "compute", "what": what})
    viewer.handle({"do": "spacecraft", "mode": "fixed"})
    with pytest.raises(sa.ConfigurationError, match="for floating spacecraft; choose that mode"):
        viewer.handle({"do": "compute", "what": "risk"})


@pytest.mark.slow
def test_shells_and_risk_are_computed_from_the_page_and_explained(browser, tmp_path):
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)
    page = Page(browser, viewer.serve(), width=1366, height=768).ready()
    page.page.click("[data-compute=shells]")
    page.wait_text("#legend", "path dependent: 0.351 to 0.554")
    page.page.wait_for_selector("#work[hidden]", state="attached")
    is_seen = """() => {
      const [words, panel] = ["legend", "rest"].map((id) =>
        document.getElementById(id).getBoundingClientRect());
      return words.top >= panel.top && words.bottom <= panel.bottom + 1; }"""
    page.page.wait_for_function(is_seen)
    page.page.click("[data-compute=risk]")
    page.wait_text("#legend", "postures within 5°")
    share = sa.risk_profile(sa.load("planar2")).share
    assert f"0 to {100 * np.nanmax(share):.3g} %" in page.text("#legend")
    (disc,) = drawn(viewer, "risk").values()
    farthest = sa.workspace(sa.load("planar2")).reachable[0, 1]
    assert np.linalg.norm(disc, axis=1).max() == pytest.approx(farthest, rel=1e-3)
    page.page.uncheck("[data-layer=risk]")
    page.page.wait_for_function("document.querySelectorAll('#legend .key').length === 2")
    assert page.errors == []
    page.close()
    saved = Page(browser, viewer.save(tmp_path / "shells.html").as_uri())
    saved.wait_text("#legend", "path independent")
    assert saved.errors == []
    saved.close()
    viewer.handle({"do": "arm", "robot": "planar3"})
    assert viewer.readout()["legend"] == []
    viewer.close()
