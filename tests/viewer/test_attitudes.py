"""Feasible attitudes, computed for a path in the page and drawn around the spacecraft."""

import dataclasses
import warnings

import numpy as np
import pinocchio as pin
import pytest
import umsgpack
from helpers.pages import Page

import spacearm as sa

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    from spacearm.viewer.jobs import MOST_CORNERS, BackgroundJob
    from spacearm.viewer.layers import INNER, OUTER, patches, sector


def meshes(viewer):
    """Vertices (m, 3) and faces of the meshes of the layer, by path."""
    found = {}
    for command in map(umsgpack.unpackb, viewer.window.commands()):
        if command["type"] == "set_object" and "/spacearm/attitudes/" in command["path"]:
            data = command["object"]["geometries"][0].get("data")
            if data:
                array = data["attributes"]["position"]["array"].data
                points = np.frombuffer(array, dtype=np.float32).reshape(-1, 3)
                found[command["path"].split("attitudes/")[1]] = points
    return found


def pose_of(viewer, path):
    """The last pose (4, 4) of a node of the layer."""
    poses = [
        np.array(command["matrix"]).reshape(4, 4).T
        for command in map(umsgpack.unpackb, viewer.window.commands())
        if command["type"] == "set_transform" and command["path"].endswith(f"attitudes{path}")
    ]
    return poses[-1]


def area(vertices, faces):
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0


def angles(points):
    return np.unwrap(np.arctan2(points[:, 1], points[:, 0]))


def test_sectors_and_patches_have_their_areas():
    axes = np.eye(3)[[1, 2]]
    vertices, faces = sector(0.3, 1.8, axes)
    assert area(vertices, faces) == pytest.approx(0.75 * (OUTER**2 - INNER**2), rel=1e-3)
    np.testing.assert_allclose(vertices[:, 0], 0.0, atol=1e-12)
    directions = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, -0.8]])
    vertices, faces = patches(directions, 0.1)
    ten = 5.0 * np.sin(2.0 * np.pi / 10) * 0.01
    assert area(vertices, faces) == pytest.approx(2.0 * ten)
    np.testing.assert_allclose(vertices[faces[-1]] @ directions[1], 1.0, atol=1e-12)


@pytest.mark.slow
def test_a_ring_shows_the_intervals_and_the_attitude_now():
    arm = sa.load("planar2")
    q0 = np.radians([-57.936, 60.337])
    found = sa.feasible_attitudes(arm.at(q0), [(2.0, 0.0), (1.5, 1.5)], samples=180)
    viewer = sa.view(found, open=False)
    drawn = meshes(viewer)
    (interval,) = found.intervals
    on = angles(drawn["feasible/0"])
    np.testing.assert_allclose([on.min(), on.max()], interval, atol=1e-5)
    whole = sum(np.ptp(angles(points[: len(points) // 2])) for points in drawn.values())
    assert whole == pytest.approx(2.0 * np.pi)
    words = " ".join(key["words"] for key in viewer.readout()["legend"])
    assert "57.33" in words
    assert "to 65.1" in words
    assert f"{found.share:.2%} of the attitudes" in words
    assert "at zero momentum" in words
    base = pin.SE3(pin.utils.rotate("z", 2.0), np.array([0.3, 0.4, 0.0]))
    viewer.show([0.3, 1.2], base=base)
    np.testing.assert_allclose(
        pose_of(viewer, "/now/end")[:3, 3] / np.linalg.norm(pose_of(viewer, "/now/end")[:3, 3]),
        base.rotation[:, 0],
        atol=1e-12,
    )
    middle = base.act(arm.model.inertias[1].lever)
    np.testing.assert_allclose(pose_of(viewer, "")[:3, 3], middle, atol=1e-12)
    none = dataclasses.replace(
        found, intervals=np.empty((0, 2)), ball=None, ended=np.ones_like(found.ended)
    )
    viewer.attitudes(none)
    assert list(meshes(viewer)) == ["not/0"]
    words = " ".join(key["words"] for key in viewer.readout()["legend"])
    assert f"singularity: {len(none.ended)}" in words


@pytest.mark.slow
def test_directions_have_the_share_of_their_rolls(attitudes):
    directions, shares = attitudes.by_direction
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-12)
    assert shares.mean() == pytest.approx(attitudes.share)
    viewer = sa.view(attitudes, open=False)
    points = meshes(viewer)["sphere"]
    middles = points[:: len(points) // len(directions)]
    size = OUTER * viewer._stage.scene.size
    np.testing.assert_allclose(middles, size * directions, atol=1e-5 * size)
    assert "of the rolls" in viewer.readout()["legend"][0]["words"]
    planar = dataclasses.replace(attitudes, axis=2)
    with pytest.raises(sa.UnsupportedError, match="about one axis only"):
        _ = planar.by_direction


@pytest.mark.slow
def test_the_sphere_is_not_inside_the_spacecraft(attitudes):
    arm = sa.load("servicer_ur5")
    viewer = sa.view(arm, open=False)
    viewer.attitudes(dataclasses.replace(attitudes, arm=arm))
    (body,) = arm.tree.visuals[arm.tree.root].visual
    corner = np.linalg.norm(body.geometry.size) / 2.0
    assert OUTER * viewer._stage.scene.size < corner, "or this shows nothing"
    assert np.linalg.norm(meshes(viewer)["sphere"], axis=1).max() > corner


@pytest.mark.parametrize("spin", [0.0, 0.5])
def test_the_page_says_that_momentum_of_the_motion_does_not_count(spin):
    """Attitudes are tried at zero momentum, whatever motion gives the path."""
    arm = sa.load("planar2")
    run = sa.simulate(
        arm.at([0.3, 1.2], momentum=[0, 0, 0, 0, 0, spin]), lambda *_: np.zeros(2), 0.1
    )
    assert sa.view(run, open=False).about()["motion"]["momentum"] is bool(spin)


@pytest.fixture(scope="module")
def attitudes():
    """Few attitudes of a spatial arm, for a short line."""
    arm = sa.load("mda6")
    cfg = arm.at(np.full(6, 0.4))
    start = pin.SE3(cfg.tip.rotation, cfg.tip.translation - cfg.com)
    end = pin.SE3(start.rotation, 0.9 * start.translation)
    return sa.feasible_attitudes(cfg, [start, end], samples=72, refine=0)


def test_the_page_asks_for_the_attitudes_of_a_line_or_of_a_motion(monkeypatch):
    arm = sa.load("planar2")
    viewer = sa.view(arm.at([0.3, 1.2]), open=False)
    begun = []
    monkeypatch.setattr(BackgroundJob, "start", lambda _, *given: begun.append(given))
    ask = {"do": "compute", "what": "attitudes"}
    for path, why in (
        ("goal", "there is no goal"), ("motion", "there is no motion"), ("round", "unknown path"),
    ):  # fmt: skip
        with pytest.raises(sa.ConfigurationError, match=why):
            viewer.handle({**ask, "path": path})
    viewer.handle({"do": "goal", "position": [1.0, 1.0, 0.0]})
    viewer.handle({**ask, "path": "goal"})
    name, function, _ = begun[0]
    of, (start, end) = function.args
    cfg = viewer.configuration
    assert (name, of.arm) == ("attitudes", arm)
    np.testing.assert_array_equal(of.q, cfg.q)
    np.testing.assert_allclose(start.translation, cfg.tip.translation - cfg.com, atol=1e-12)
    np.testing.assert_allclose(end.translation, np.array([1.0, 1.0, 0.0]) - cfg.com, atol=1e-12)
    viewer.handle({"do": "spacecraft", "mode": "fixed"})
    with pytest.raises(sa.ConfigurationError, match="for floating spacecraft"):
        viewer.handle({**ask, "path": "goal"})


def test_a_motion_is_feasible_from_where_it_begins(monkeypatch):
    arm = sa.load("planar2")
    cfg = arm.at([0.3, 1.2])
    goal = cfg.tip.translation - np.array([0.2, -0.1, 0.0])
    run = sa.follow(cfg, [goal[:2]], speed=0.1)
    viewer = sa.view(run, open=False)
    begun = []
    monkeypatch.setattr(BackgroundJob, "start", lambda _, *given: begun.append(given))
    viewer.handle({"do": "compute", "what": "attitudes", "path": "motion"})
    start, path = begun[0][1].args
    assert len(path) <= MOST_CORNERS
    found = sa.feasible_attitudes(start, path, samples=90)
    assert any(low <= 0.0 <= high for low, high in found.intervals)


@pytest.mark.slow
def test_attitudes_are_computed_from_the_page(browser, tmp_path):
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)
    page = Page(browser, viewer.serve(), width=1366, height=768).ready()
    assert page.page.is_disabled("[data-compute=attitudes]")
    tip = viewer.configuration.tip.translation
    viewer.handle({"do": "goal", "position": [tip[0] - 0.3, tip[1] + 0.1, 0.0]})
    viewer.show([0.3, 1.2])
    page.page.click("[data-compute=attitudes]:enabled")
    page.wait_text("#legend", "the path of 0.3162 m can be followed at zero momentum")
    assert page.page.is_disabled("#attitudepath option[value=motion]")
    page.wait_visible("attitudes")
    assert page.errors == []
    page.close()
    saved = Page(browser, viewer.save(tmp_path / "attitudes.html").as_uri())
    saved.wait_text("#legend", "x axis now")
    assert saved.errors == []
    saved.close()
    viewer.close()
