"""The view in a real browser: Debian's chromium, headless, driven by playwright."""

import math
import re
import struct
import subprocess
import sys
import zipfile
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import frame, joint, link, robot, two_links
from helpers.pages import Page

import spacearm as sa
from spacearm.description.model_catalogue import models_folder

MISSING_MESH = '<visual><geometry><mesh filename="no.stl"/></geometry></visual>'


@pytest.fixture
def viewer():
    viewer = sa.view(sa.load("planar2").at(np.radians([-65, -40])), open=False)
    viewer.serve()
    yield viewer
    viewer.close()


@pytest.fixture
def page(browser, viewer):
    page = Page(browser, viewer.url).ready()
    yield page
    page.close()


@pytest.mark.slow
def test_the_page_needs_nothing_from_elsewhere_and_logs_no_error(page, viewer):
    page.until(lambda: page.colours() > 12)
    assert page.errors == []
    assert all(url.startswith((viewer.url.partition("?")[0], "data:")) for url in page.requests)
    assert page.text("#model") == "planar2"
    assert page.text("#kind") == "regular"


@pytest.mark.slow
def test_the_mode_in_which_the_posture_is_judged_stands_beside_the_distance(page, viewer):
    assert page.text("#judged") == "(free-floating)"
    viewer.session.handle({"do": "spacecraft", "mode": "attitude-controlled"})
    page.move(1, 20.0)
    page.wait_text("#judged", "(attitude-controlled)")
    assert viewer.session.report.mode == "attitude-controlled"


@pytest.mark.slow
def test_a_slider_at_the_singularity_shows_dynamic_and_the_arrow(page, viewer):
    assert not page.visible("directions", "lost")
    page.move(1, -11.41)
    page.wait_text("#kind", "dynamic")
    page.wait_visible("directions", "lost")
    page.wait_visible("directions", "line")
    assert page.text("#rank") == "1 of 2"
    assert "m/rad" in page.text("#sigma_min")
    assert viewer.session.cfg.q[1] == pytest.approx(np.radians(-11.41), abs=1e-6)
    page.move(1, -40)
    page.wait_visible("directions", "lost", wanted=False)


@pytest.mark.slow
def test_floating_turns_the_attitude_by_the_momentum_integral(page, viewer):
    page.page.check("[name=mode][value=free-floating]")
    start = viewer.session.cfg
    path = [(0, 120), (1, 150), (0, -65), (1, -40)]
    expected, q = start, np.degrees(start.q)
    for index, degrees in path:
        page.move(index, degrees)
        q[index] = degrees
        expected = sa.move(expected, np.radians(q))
    yaw = np.degrees(pin.rpy.matrixToRpy(expected.base.rotation)[2])
    assert abs(yaw) > 1.0, "a closed loop leaves the attitude changed"
    shown = float(page.page.input_value("#attitude label:nth-child(3) input"))
    assert shown == pytest.approx(yaw, abs=0.006)


@pytest.mark.slow
def test_number_fields_keyboard_and_errors(page):
    field = ".joint:nth-child(1) input[type=number]"
    page.page.fill(field, "30")
    page.page.press(field, "Enter")
    page.wait_text("#tip", "2.351")
    page.page.fill(field, "300")
    page.page.press(field, "Enter")
    page.wait_text(".joint .refusal", "300° is outside its range, -180° to 180°")
    assert page.page.input_value(field) == "30.00"
    page.page.focus(".joint:nth-child(1) input[type=range]")
    before = page.text("#tip")
    page.page.keyboard.press("ArrowRight")
    page.page.wait_for_function(
        "before => document.querySelector('#tip').textContent !== before", arg=before
    )
    page.page.focus("[data-do=home]")
    page.page.keyboard.press("Enter")
    page.wait_text("#kind", "kinematic")
    assert page.errors == []


@pytest.mark.slow
def test_layers_can_be_switched(page):
    page.page.uncheck("[data-layer=ellipsoid]")
    page.wait_visible("ellipsoid", wanted=False)
    page.page.check("[data-layer=ellipsoid]")
    page.wait_visible("ellipsoid")


@pytest.mark.slow
def test_reload_second_tab_and_closed_tab(browser, page, viewer):
    page.move(0, 33)
    page.page.reload()
    page.ready()
    page.page.wait_for_function(
        "() => document.querySelector('.joint input[type=number]').value === '33.00'"
    )
    other = Page(browser, viewer.url).ready()
    other.move(0, -20)
    page.page.wait_for_function(
        "() => document.querySelector('.joint input[type=number]').value === '-20.00'"
    )
    other.close()
    page.move(0, 10)
    assert page.errors == []


@pytest.mark.slow
def test_a_saved_page_opens_offline_and_shows_the_arm(browser, viewer, tmp_path):
    viewer.show(np.radians([-65, -11.41]))
    path = viewer.save(tmp_path / "scene.html")
    saved = Page(browser, path.as_uri(), offline=True)
    assert saved.visible("directions", "lost")
    saved.until(lambda: saved.colours() > 12)
    saved.page.uncheck("[data-layer=bodies]")
    assert not saved.visible("bodies")
    assert saved.errors == []
    assert [url for url in saved.requests if not url.startswith(("file:", "data:"))] == []
    saved.close()


@pytest.mark.slow
def test_a_saved_page_of_a_robot_with_a_hostile_name_works(browser, tmp_path):
    text = (models_folder() / "planar2.urdf").read_text(encoding="utf-8")
    path = tmp_path / "robot.urdf"
    path.write_text(text.replace('name="planar2"', 'name="&lt;!--&lt;script&gt;"', 1))
    arm = sa.load(path, tip="tip", task="x y")
    assert arm.name == "<!--<script>"
    viewer = sa.view(arm.at([0.3, 1.2]), open=False)
    saved = Page(browser, viewer.save(tmp_path / "page.html").as_uri(), offline=True)
    saved.until(lambda: saved.colours() > 12)
    assert saved.errors == []
    assert arm.name in saved.text("body")
    saved.close()


def motion():
    arm = sa.load("planar2")
    cfgs = [arm.at(np.radians([-65, 40]))]
    for q2 in (20, 0, -11.41, -40):
        cfgs.append(sa.move(cfgs[-1], np.radians([-65, q2])))
    q, base = [c.q for c in cfgs], [c.base for c in cfgs]
    return SimpleNamespace(arm=arm, t=np.arange(5) / 2, q=q, base=base)


def position(page, name):
    return np.array(
        page.page.evaluate(
            "name => window.spacearm.viewer.scene_tree.find(['spacearm', 'bodies', name])"
            ".object.position.toArray()",
            name,
        )
    )


@pytest.mark.slow
def test_a_motion_plays_live_and_from_a_file(browser, tmp_path):
    viewer = sa.view(motion(), open=False)
    wanted = sa.Motion.of(motion()).at(1.25)
    elbow = wanted.arm.replace(tip="link_2").at(wanted.q, base=wanted.base).tip.translation
    live = Page(browser, viewer.serve()).ready()
    live.seek(1.25)
    live.until(lambda: np.allclose(position(live, "link_2"), elbow, atol=1e-6))
    live.page.click("#motion button")
    live.wait_text("#motion output", "2.00 s")
    live.close()
    viewer.close()

    saved = Page(browser, viewer.save(tmp_path / "motion.html").as_uri(), offline=True)
    saved.seek(1.25)
    assert np.allclose(position(saved, "link_2"), elbow, atol=2e-3)  # between frames of 1/15 s
    for t in np.linspace(*viewer._stage.span, 7):
        saved.seek(float(t))
        assert saved.page.evaluate(FARTHEST) < 1.0, f"in view at {t} s"
    assert saved.errors == []
    saved.close()


FARTHEST = """() => {
  const { viewer, points } = window.spacearm;
  return Math.max(...points().map((p) => p.project(viewer.camera))
    .map((p) => Math.max(Math.abs(p.x), Math.abs(p.y))));
}"""


FRAMES = """() => new Promise((done) => {
  const [seen, time] = [[], document.querySelector("#motion input")];
  const look = () => {
    const { x, y, z } = window.spacearm.viewer.scene_tree.find(["spacearm", "bodies", "link_2"])
      .object.position;
    seen.push([Number(time.value), x, y, z]);
    if (Number(time.value) < 2) requestAnimationFrame(look);
    else done(seen);
  };
  look();
})"""


COUNT = """() => {
  window.asked = 0;
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (message) {
    window.asked += 1;
    send.call(this, message);
  };
}"""


@pytest.mark.slow
def test_in_play_every_frame_of_the_browser_shows_its_own_posture(browser):
    """The server answers for some of them; between those the page moves the arm by itself."""
    shown = sa.Motion.of(motion())
    viewer = sa.view(motion(), open=False)
    page = Page(browser, viewer.serve()).ready()
    page.page.click("#motion button")
    page.wait_text("#motion output", "2.00 s")  # the poses are there from now on
    page.page.evaluate(COUNT)
    page.page.click("#motion button")
    seen = np.array(page.page.evaluate(FRAMES))
    for t, *place in seen[seen[:, 0] > 0.0]:
        cfg = shown.at(t)
        elbow = cfg.arm.replace(tip="link_2").at(cfg.q, base=cfg.base).tip.translation
        np.testing.assert_allclose(place, elbow, atol=2e-3)
    frames = len(np.unique(seen[:, 0]))
    if frames > 30:  # in 2 s; a busy machine that draws fewer asks for each
        assert frames > 1.2 * page.page.evaluate("window.asked")
    page.wait_text("#motion button", "Play")
    page.until(lambda: np.allclose(viewer.q, shown.q[-1], atol=1e-12))
    assert page.errors == []
    page.close()
    viewer.close()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
@pytest.mark.parametrize("inside", ["", MISSING_MESH])
def test_links_without_a_drawing_still_show_a_scene(browser, tmp_path, inside):
    path = tmp_path / "plain.urdf"
    bus, _, elbow = two_links()
    tip = (frame("tip"), joint("end", "arm", "tip", "fixed"))
    path.write_text(robot(bus, link("arm", inside=inside), elbow, *tip))
    viewer = sa.view(sa.load(path), open=False)
    page = Page(browser, viewer.serve()).ready()
    page.until(lambda: page.colours() > 12)
    missing = page.page.locator("#missing")
    assert missing.is_visible() is bool(inside)
    if inside:
        assert missing.text_content() == "Not drawn, mesh files not foundno.stl"
    page.close()
    viewer.close()


@pytest.mark.slow
def test_a_picture_is_rendered(viewer, tmp_path):
    path = viewer.png(tmp_path / "scene.png", size=(400, 300))
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 5_000


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_motion_is_kept_as_pictures_without_a_page(tmp_path):
    viewer = sa.view(motion(), open=False)
    told, target = [], tmp_path / "motion.zip"

    def tell(done, total):
        (partial,) = tmp_path.iterdir()
        assert partial != target, "it is there once it is whole"
        told.append((done, total))

    path = viewer.frames(target, size=(400, 300), per_second=2.0, progress=tell)
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        pictures = [archive.read(name) for name in names]
    first, last = viewer._stage.span
    assert len(names) == math.ceil(2.0 * (last - first)) + 1
    assert names[0] == "planar2_0001.png"
    assert [done for done, _ in told] == list(range(1, len(names) + 1))
    assert {total for _, total in told} == {len(names)}
    for picture in pictures:
        assert picture.startswith(b"\x89PNG")
        assert struct.unpack(">II", picture[16:24]) == (400, 300)
    assert len(set(pictures)) == len(pictures), "each is of another time"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("kind", ["gif", "mp4", "webm"])
def test_a_motion_is_kept_as_a_video_as_long_as_the_motion(tmp_path, kind):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    viewer = sa.view(motion(), open=False)
    first, last = viewer._stage.span
    told = []
    path = viewer.video(
        tmp_path / f"run.{kind}", (320, 240), 4.0, lambda done, total: told.append((done, total))
    )
    count = told[-1][1]
    assert [done for done, _ in told] == list(range(1, count + 1))
    read = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo"]
    run = subprocess.run([*read, "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
    size = 320 * 240 * 3
    pictures = [run.stdout[i : i + size] for i in range(0, len(run.stdout), size)]
    rate = float(re.search(rb"320x240.*?([\d.]+) fps", run.stderr)[1])
    assert len(pictures) == count
    assert len(pictures) / rate == pytest.approx(last - first, abs=1.5 / 4.0)
    assert pictures[0] != pictures[-1]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_gif_has_a_legend_in_the_colours_of_the_layers(tmp_path):
    from spacearm.viewer.layers import LAYERS

    image = pytest.importorskip("PIL.Image")
    viewer = sa.view(motion(), open=False)
    viewer._stage.show_layer("ellipsoid", False)
    path = viewer.video(tmp_path / "run.gif", (900, 600), 0.5)
    with image.open(path) as film:
        film.seek(film.n_frames - 1)
        corner = np.array(film.convert("RGB"), dtype=int)[:250, 13:39]

    def rows(layer):
        color = [int(LAYERS[layer][i : i + 2], 16) for i in (1, 3, 5)]
        return int((np.abs(corner - color).max(axis=2) <= 2).all(axis=1).sum())

    assert min(rows(layer) for layer in ("centre of mass", "virtual manipulator", "trace")) >= 10
    assert rows("ellipsoid") == rows("bodies") == 0, "it is hidden; bodies explain themselves"


@pytest.mark.parametrize(
    ("name", "options", "why"),
    [
        ("run.avi", {}, r"not a video; use \.gif, \.mp4, \.webm"),
        ("run.mp4", {"size": (321, 240)}, "even numbers"),
        ("run.gif", {"per_second": 60.0}, "at most 50"),
        ("run.mp4", {"per_second": 0.0}, "per_second"),
    ],
)
def test_what_is_no_video_is_refused_before_anything_is_drawn(tmp_path, name, options, why):
    with pytest.raises(sa.ConfigurationError, match=why):
        sa.view(motion(), open=False).video(tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def test_a_video_without_an_encoder_names_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(sa.UnsupportedError, match=r"pip install 'spacearm\[video\]'"):
        sa.view(motion(), open=False).video(tmp_path / "run.mp4")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("per_second", "why"), [(0.0, "per_second"), (1e6, "at most 3000")])
def test_too_many_pictures_and_none_are_refused(tmp_path, per_second, why):
    with pytest.raises(sa.ConfigurationError, match=why):
        sa.view(motion(), open=False).frames(tmp_path / "motion.zip", per_second=per_second)
    with pytest.raises(sa.ConfigurationError, match="there is no motion"):
        sa.view(sa.load("planar2"), open=False).frames(tmp_path / "motion.zip")


@pytest.mark.slow
def test_a_tab_that_outlives_its_server_shows_nothing_of_the_next_one(browser):
    """Another robot's server takes the port: the tab says that its own has ended."""
    first = sa.view(sa.load("planar2"), open=False)
    page = Page(browser, first.serve()).ready()
    port = int(first.url.partition("/?")[0].rpartition(":")[2])
    first.close()
    page.page.wait_for_function("document.querySelector('#kind').textContent == 'disconnected'")
    other = sa.view(sa.load("planar3"), open=False)
    other.serve(port)
    try:
        page.page.wait_for_selector("#ended")
        assert "This view has ended" in page.text("#ended")
        assert "planar3" not in page.page.content()
    finally:
        other.close()


@pytest.mark.slow
def test_a_ticket_leads_to_the_page(browser, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    viewer = sa.view(sa.load("planar2"))
    try:
        page = Page(browser, opened[0]).ready()
        assert page.page.url == viewer.url
        page.page.reload()
        page.ready()
    finally:
        viewer.close()
