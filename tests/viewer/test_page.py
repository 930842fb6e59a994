"""The page's looks and manners in a real browser."""

import itertools
import re
import threading
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.arms import frame, joint, robot, two_links
from helpers.pages import Page

import spacearm as sa

SIZES = [(1366, 768), (1920, 1080), (390, 844)]


def opened(browser, thing, **options):
    """A viewer and its page."""
    viewer = sa.view(thing, open=False)
    return viewer, Page(browser, viewer.serve(), **options).ready()


def shut(viewer, *pages):
    for page in pages:
        assert page.errors == []
        page.close()
    viewer.close()


def outside(page):
    """How far what is framed lies outside the picture: up to 1 it is inside."""
    return page.page.evaluate(
        """() => {
          const { viewer, points } = window.spacearm;
          viewer.camera.updateMatrixWorld();
          return Math.max(...points().map((p) => p.project(viewer.camera))
            .map((p) => Math.max(Math.abs(p.x), Math.abs(p.y))));
        }"""
    )


def top(page, selector):
    return page.page.eval_on_selector(selector, "node => node.getBoundingClientRect().top")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "vispa_cubesat"])
def test_the_whole_robot_is_in_view_at_every_size(browser, name):
    viewer = sa.view(sa.load(name), open=False)
    viewer.serve()
    pages = [Page(browser, viewer.url, *size).ready() for size in SIZES]
    for page in pages:
        assert 0.5 < outside(page) <= 0.95
        page.page.set_viewport_size({"width": 800, "height": 700})
        page.until(lambda page=page: outside(page) <= 0.95)
        for view in ("front", "side", "top", "3-D"):
            page.page.click(f"[data-view='{view}']")
            assert outside(page) <= 0.95
    pages[0].page.bring_to_front()
    viewer.show(np.full(viewer.session.arm.n, 1.5))
    pages[0].until(lambda: outside(pages[0]) <= 1.0)
    shut(viewer, *pages)


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_the_way_out_and_the_angles_are_seen_whole(browser, size):
    q = np.radians([-2.32, -25.17, -88.0, 117.3, 73.39, 170.19])
    arm = sa.load("servicer_ur5")
    viewer, page = opened(browser, arm.at(q), width=size[0], height=size[1])
    assert "shoulder_lift" in page.text("#away")
    viewer.show([*q[:5], q[5] + 2.0 * np.pi])  # one line more: outside its limits
    page.wait_text("#outside", "wrist_3")
    cut = page.page.eval_on_selector_all(
        "#messages, .joint input[type=number], #attitude input",
        "all => all.filter((n) => n.scrollHeight > n.clientHeight + 1"
        " || n.scrollWidth > n.clientWidth + 1).map((n) => n.outerHTML)",
    )
    assert cut == []
    shut(viewer, page)


@pytest.mark.slow
def test_joint_names_are_told_apart(browser):
    arm = sa.mount("vispa", sa.Bus(20.0, size=(0.3, 0.3, 0.3)), name="vispa")
    viewer, page = opened(browser, arm, width=1366, height=768)
    names = page.page.eval_on_selector_all(
        ".joint .name",
        "all => all.map((n) => [n.textContent, n.title, n.scrollWidth, n.clientWidth])",
    )
    assert len({text for text, *_ in names}) == 6
    for text, title, needed, there in names:
        assert title.startswith("vispa_" + text)
        assert needed <= there
    shut(viewer, page)


@pytest.mark.slow
def test_what_cannot_be_is_refused_beside_the_box_and_moves_nothing(browser):
    viewer, page = opened(browser, sa.load("planar2").at(np.radians([30, 40])))
    box = ".joint:nth-child(1) input[type=number]"
    for given, words in [
        ("300", "300° is outside its range, -180° to 180°"),
        ("", "give a number"),
    ]:
        page.page.fill(box, given)
        page.page.press(box, "Enter")
        page.wait_text(".joint .refusal", words)
        assert page.page.input_value(box) == "30.00"
        assert viewer.session.cfg.q[0] == pytest.approx(np.radians(30))
    roll = "#attitude label:nth-child(1) input"
    page.page.fill(roll, "")
    page.page.press(roll, "Enter")
    page.wait_text("#attitude .refusal", "give an angle")
    assert page.page.input_value(roll) == "0.00"
    page.move(0, 20)
    assert page.text(".joint .refusal") == ""
    shut(viewer, page)


@pytest.mark.slow
def test_the_layout_stays_while_the_verdict_changes(browser):
    viewer, page = opened(
        browser, sa.load("planar2").at(np.radians([-65, -40])), width=1366, height=768
    )
    places = []
    for degrees in (-40, -11.41, -14, 120):
        page.move(1, degrees)
        places.append(top(page, ".joint:nth-child(2)"))
    assert len(set(places)) == 1
    page.page.eval_on_selector("#rest", "box => box.scrollTo(0, 1e4)")
    assert page.page.is_visible("#distance")
    assert page.page.is_visible("#kind")
    shut(viewer, page)


@pytest.mark.slow
def test_near_singular_postures_do_not_look_regular(browser):
    arm = sa.load("servicer_ur5")
    viewer, page = opened(browser, arm.at(np.zeros(arm.n)))
    assert page.text("#kind") == "near singular"
    near = page.page.eval_on_selector("#kind", "node => getComputedStyle(node).color")
    shut(viewer, page)
    viewer, page = opened(browser, sa.load("planar2").at([0.3, 1.2]))
    assert page.page.eval_on_selector("#kind", "node => getComputedStyle(node).color") != near
    shut(viewer, page)


@pytest.mark.slow
def test_the_panel_names_tip_directions_gradient_and_contacts(browser):
    viewer, page = opened(browser, sa.load("planar2").at(np.radians([-65, -11.41])))
    assert page.text("#tipname") == "tip"
    assert page.page.locator("#directions tbody tr").count() == 2
    lost = page.page.locator("#directions tr.lost td").all_text_contents()
    np.testing.assert_allclose(
        [float(x) for x in lost], viewer.session.report.lost[:, 0].round(2), atol=1e-12
    )
    assert page.page.locator("#gradient tbody tr").count() == 2
    assert page.text("#contacts") == ""
    shut(viewer, page)
    viewer, page = opened(browser, sa.load("mda6").at([0.8, 0.8, -2.7, -2.9, 1.9, 2.5]))
    assert page.text("#contacts").startswith("Bodies meet: spacecraft – link_4")
    page.page.set_viewport_size({"width": 1366, "height": 768})
    page.page.click("text=Directions, lost and available")
    width, there = page.page.eval_on_selector(
        "#directions", "node => [node.scrollWidth, node.clientWidth]"
    )
    assert width <= there, "six rows of the task are seen whole"
    shut(viewer, page)


@pytest.mark.slow
def test_rounding_noise_is_not_shown(browser):
    viewer, page = opened(browser, sa.load("planar2").at([-1e-17, 0.0]))
    viewer.show([-1e-17, 6e-18])
    page.wait_text("#tip", "2.500, 0.000, 0.000")
    panel = page.page.inner_text("#panel")
    values = page.page.eval_on_selector_all(
        "#panel input[type=number]", "all => all.map(x => x.value)"
    )
    spoken = page.page.eval_on_selector_all(
        ".joint input[type=range]", "all => all.map(x => x.getAttribute('aria-valuetext'))"
    )
    for text in (panel, *values, *spoken):
        assert "-0.0" not in text
        assert not re.search(r"\de-", text)  # no powers of ten
    assert spoken == ["0.00 degrees", "0.00 degrees"]
    assert page.text("#sigma_min") == "0 m/rad"
    shut(viewer, page)


@pytest.mark.slow
def test_the_nearest_singularity_says_how_far_it_was(browser):
    viewer, page = opened(browser, sa.load("planar2").at(np.radians([-65, -40])))
    page.page.click("[data-do=nearest]")
    page.wait_text("#note", "went ")
    assert "joint_2 +" in page.text("#note")
    assert page.page.locator("[aria-busy]").count() == 0
    page.move(0, 10)
    assert page.text("#note") == ""
    shut(viewer, page)


@pytest.mark.slow
def test_without_webgl_the_panel_works_and_says_why_nothing_is_drawn(browser):
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)
    context = browser.new_context()
    context.set_default_timeout(120_000)
    context.add_init_script(
        "const get = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {"
        "  return kind.includes('webgl') ? null : get.call(this, kind, ...rest); };"
    )
    page = context.new_page()
    page.goto(viewer.serve())
    page.wait_for_selector("body[data-ready=yes]", state="attached")
    assert "does not draw in 3-D" in page.text_content("#scene")
    assert page.text_content("#kind") == "regular"
    page.click("[data-do=home]")
    page.wait_for_function("document.querySelector('#kind').textContent.includes('kinematic')")
    context.close()
    viewer.close()


def luminance(colour):
    channels = np.array([int(x) for x in colour[colour.index("(") + 1 : -1].split(",")[:3]]) / 255
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def contrast(a, b):
    low, high = sorted([luminance(a), luminance(b)])
    return (high + 0.05) / (low + 0.05)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast_is_enough(browser, scheme):
    viewer, page = opened(browser, sa.load("planar2").at([0.3, 1.2]), color_scheme=scheme)
    style = "(node, name) => getComputedStyle(node)[name]"
    ground = page.page.eval_on_selector("body", style, "backgroundColor")
    for selector in ("#model", "#kind", "dt", "#meaning", "#away", "legend", "button"):
        assert contrast(page.page.eval_on_selector(selector, style, "color"), ground) >= 4.5
    for selector in (".joint input[type=number]", "button"):
        assert contrast(page.page.eval_on_selector(selector, style, "borderTopColor"), ground) >= 3
    shut(viewer, page)


@pytest.mark.slow
def test_every_control_has_a_name_and_can_be_reached_by_keyboard(browser):
    viewer, page = opened(browser, sa.load("planar2").at([0.3, 1.2]), width=1366, height=768)
    names = page.page.eval_on_selector_all(
        "button, input, select, summary",
        "all => all.filter(x => x.checkVisibility()).map(x => x.getAttribute('aria-label') "
        "|| x.labels?.[0]?.textContent.trim() || x.textContent.trim())",
    )
    assert all(names)
    seen = set()
    for _ in range(len(names) + 3):
        page.page.keyboard.press("Tab")
        seen.add(page.page.evaluate("document.activeElement.outerHTML"))
    assert len(seen) >= len(names) - 2  # of radio buttons one is reached, arrows lead to the other
    shut(viewer, page)


@pytest.mark.slow
def test_every_control_and_readout_is_explained_where_the_pointer_rests(browser):
    arm = sa.load("planar2")
    motion = SimpleNamespace(arm=arm, t=[0, 1], q=[[0, 0.5], [1, 1]], base=[np.eye(7)[6]] * 2)
    viewer, page = opened(browser, motion, width=1366, height=768)
    bare = """all => all.filter((x) => x.checkVisibility() && !x.closest("[title]")?.title
      && !x.querySelector("title")).map((x) => x.outerHTML)"""
    told = "button, input, select, summary, dt, output, #grab > [tabindex], [role=meter], .badge"
    assert page.page.eval_on_selector_all(told, bare) == []
    scale = page.page.locator("#scale").bounding_box()
    at = [scale["x"] + scale["width"] / 2, scale["y"] + scale["height"] / 2]
    assert page.page.evaluate("([x, y]) => document.elementFromPoint(x, y).id", at) == "scale"
    shut(viewer, page)


@pytest.mark.slow
def test_the_page_says_what_it_waits_for(browser):
    viewer, page = opened(browser, sa.load("planar3"), width=1366, height=768)
    told, go = viewer.handle, threading.Event()

    def slow(message, client=None):
        if message["do"] == "map":
            go.wait(30.0)  # as where equations are compiled
        return told(message, client)

    viewer.handle = slow
    page.page.select_option("#map-x", "2")
    page.page.wait_for_selector("#waiting", state="visible")
    assert page.text("#waiting").startswith("Computing the map")
    go.set()
    page.page.wait_for_selector("#waiting", state="hidden")
    shut(viewer, page)


@pytest.mark.slow
def test_on_a_phone_the_panel_folds_away(browser):
    viewer, page = opened(browser, sa.load("planar2").at([0.3, 1.2]), width=390, height=844)
    assert page.page.evaluate("document.documentElement.scrollWidth") <= 390
    tops = page.page.eval_on_selector_all(
        "#view button", "all => all.map((x) => x.getBoundingClientRect().top)"
    )
    assert len(tops) == 7
    assert len(set(tops)) == 1, "the buttons stand in one row"
    page.page.evaluate("window.scrollTo(0, 1e4)")
    assert page.page.is_visible("#distance")
    assert 0 <= top(page, "#kind") < 844
    assert top(page, "#scene") == 0
    page.page.evaluate("window.scrollTo(0, 0)")
    page.page.click("#fold")
    assert not page.page.is_visible("#panel")
    assert page.page.get_attribute("#fold", "aria-expanded") == "false"
    page.until(lambda: outside(page) <= 0.95)
    page.page.click("#fold")
    assert page.page.is_visible("#panel")
    shut(viewer, page)


def box(page, selector):
    """Left, top, right and bottom of an element [px]; None of one that is hidden."""
    at = page.page.locator(selector).bounding_box()
    return at and (at["x"], at["y"], at["x"] + at["width"], at["y"] + at["height"])


def apart(one, other):
    return one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]


BUSY = """for (const id of ["work", "waiting"]) {
  const shown = document.getElementById(id);
  shown.hidden = false;
  (shown.querySelector("span") ?? shown).textContent = "planning: at most 60 s more";
}"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 900, 800, 640, 390])
def test_neither_map_nor_toolbar_hides_the_tip_at_any_width(browser, width):
    """Opened so wide, or narrowed to it; after a step to the nearest singular posture too."""
    viewer, page = opened(browser, sa.load("mda6").at(np.full(6, 0.5)), width=width, height=700)
    narrowed = Page(browser, viewer.serve(), width=1400, height=700).ready()
    assert narrowed.page.get_attribute("#mapfold", "aria-expanded") == "true"
    narrowed.page.set_viewport_size({"width": width, "height": 700})
    if page.page.get_attribute("#mapfold", "aria-expanded") == "false":
        page.page.click("#mapfold")
    for shown in (page, narrowed):
        shown.page.bring_to_front()
        for _ in range(2):
            shown.until(lambda shown=shown: outside(shown) <= 0.95)
            shown.page.evaluate("window.scrollTo(0, 0)")
            drawing, tip = box(shown, "#drawing"), box(shown, "#grab circle")
            assert apart(drawing, box(shown, "#map"))
            assert apart(drawing, box(shown, "#panel"))
            assert not apart(drawing, tip)
            buttons = shown.page.locator("#view button:visible")
            for i in range(buttons.count()):
                button = buttons.nth(i).bounding_box()
                assert drawing[0] <= button["x"]
                assert button["x"] + button["width"] <= drawing[2]
                assert button["y"] + button["height"] <= tip[1]
            shown.page.evaluate(BUSY)
            marks = ["#work", "#waiting", "#scale", "#squares", "#compass"]
            boxes = [at for mark in marks if (at := box(shown, mark))]
            assert all(apart(*pair) for pair in itertools.combinations(boxes, 2))
            shown.page.evaluate(BUSY.replace("false", "true"))
            if shown is narrowed:
                break
            shown.page.click("[data-do='nearest']")
            shown.until(lambda shown=shown: "singularity" in shown.text("#kind"))
    shut(viewer, page, narrowed)


@pytest.mark.slow
def test_a_tap_explains_a_symbol_and_a_control_works(browser):
    viewer, page = opened(
        browser, sa.load("planar2").at([0.3, 1.2]), width=390, height=844, has_touch=True
    )
    symbol = page.page.locator("dt", has_text="R from the CM")
    symbol.tap()
    assert page.text("#explanation") == symbol.get_attribute("title")
    assert page.page.is_visible("#explanation")
    box = page.page.locator("#explanation").bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 390
    page.page.locator("#fold").tap()
    assert not page.page.is_visible("#explanation")
    assert not page.page.is_visible("#panel")
    assert page.text("#squares") == "grid 0.5 m"
    shut(viewer, page)


@pytest.mark.slow
def test_names_are_text_wherever_they_stand(browser, tmp_path):
    arm = sa.load("planar2")
    bad = "<img src=x onerror=alert(1)>"
    motion = SimpleNamespace(arm=arm, t=[0, 1], q=[[0, 0.5], [1, 1]], base=[np.eye(7)[6]] * 2)
    viewer = sa.view(motion, open=False)
    told = viewer.about

    def renamed():
        about = told()
        about["model"] = about["tip"] = about["joints"][0]["label"] = bad
        about["joints"][0]["name"] = about["contacts"] = about["motion"]["story"] = bad
        about["motion"]["events"] = [{"t": 0.5, "kind": bad, "detail": bad}]
        about["motion"]["curves"][1]["labels"] = [bad] * 3
        about["motion"]["curves"][1]["name"] = bad
        return about

    viewer.about = renamed
    for url in (viewer.serve(), viewer.save(tmp_path / "bad.html").as_uri()):
        page = Page(browser, url)
        page.page.wait_for_function("document.querySelector('#model').textContent.includes('img')")
        page.page.select_option("#curves", "1")
        page.page.wait_for_timeout(300)
        assert page.page.locator("img").count() == 0
        assert page.errors == []
        page.close()
    viewer.close()


@pytest.mark.slow
def test_a_motion_has_speed_loop_events_curves_goal_and_the_space_bar(browser, tmp_path):
    arm = sa.load("planar2")
    q = np.radians([[-65, 40], [-65, -40], [-20, -90]])
    base = np.tile([0, 0, 0, 0, 0, 0, 1.0], (3, 1))
    motion = sa.Motion(arm, np.array([0.0, 1.0, 2.0]), q, base)
    object.__setattr__(motion, "events", (SimpleNamespace(t=0.5, kind="target", detail="here"),))
    viewer = sa.view(motion, open=False)
    for url in (viewer.serve(), viewer.save(tmp_path / "motion.html").as_uri()):
        page = Page(browser, url, width=1366, height=768)
        page.page.wait_for_selector("#events button")
        assert page.visible("goal")
        page.until(lambda page=page: outside(page) <= 0.95)
        page.page.click("#events button")
        page.wait_text("#motion output", "0.50 s")
        assert page.page.locator("#chart canvas").count() == 1
        page.page.select_option("#curves", "0")
        page.wait_text(".u-legend", "joint_2")
        page.page.select_option("#speed", "10")
        page.page.locator("#loop").check()
        page.page.evaluate("document.activeElement.blur()")
        page.page.keyboard.press("Space")
        page.wait_text("#motion button", "Pause")
        page.page.wait_for_timeout(700)
        assert page.text("#motion button") == "Pause", "the loop goes on after the end"
        page.page.keyboard.press("Space")
        page.wait_text("#motion button", "Play")
        page.page.locator("#loop").uncheck()
        page.seek(2.0)
        page.wait_text("#distance", "°")
        assert page.errors == []
        page.close()
    viewer.close()


@pytest.mark.slow
def test_a_saved_page_has_name_values_and_joints(browser, tmp_path):
    viewer = sa.view(sa.load("planar2").at(np.radians([-65, -11.41])), open=False)
    page = Page(browser, viewer.save(tmp_path / "a.html").as_uri(), width=900, height=600)
    assert page.text("#model") == "planar2"
    assert page.text("#kind") == "dynamic singularity"
    assert page.page.locator(".joint output").all_text_contents() == ["-65.00", "-11.41"]
    assert page.page.locator("#directions tr.lost").count() == 1
    assert not page.page.is_visible("#attitude")
    assert outside(page) <= 0.95
    shut(viewer, page)


@pytest.mark.slow
def test_short_names_leave_room_for_the_sliders(browser):
    """In the output of a cell, too, where the panel is at its narrowest."""
    viewer, page = opened(browser, sa.load("chaser7"), width=950, height=560)
    sliders = page.page.eval_on_selector_all(
        ".joint input[type=range]", "all => all.map((x) => x.getBoundingClientRect())"
    )
    assert all(box["width"] > 100 for box in sliders)
    assert len({(box["left"], box["right"]) for box in sliders}) == 1, "they stand in a column"
    shut(viewer, page)


@pytest.mark.slow
def test_the_posture_is_dragged_on_the_map_which_follows_the_other_joints(browser):
    viewer, page = opened(browser, sa.load("planar3").at([0.3, 1.2, 0.7]), width=1366, height=768)
    page.page.wait_for_function("document.querySelector('#mapnote').textContent !== ''")
    picture = "document.querySelector('#mapcanvas').toDataURL()"
    page.page.wait_for_timeout(200)
    kept = "document.querySelector('#mapcanvas').getContext('2d').getContextAttributes()"
    assert page.page.evaluate(kept)["willReadFrequently"], "else it waits for the drawing"
    before = page.page.evaluate(picture)
    free = [i for i in range(3) if str(i) not in page.page.eval_on_selector_all(
        "#map select", "all => all.map(x => x.value)")]  # fmt: skip
    page.move(free[0], 75)
    page.page.wait_for_function(f"before => {picture} !== before", arg=before)
    chosen = [int(page.page.input_value(f"#map-{axis}")) for axis in "xy"]
    box = page.page.locator("#mapcanvas").bounding_box()
    left, right, top_, bottom = 34, 8, 8, 22
    width, height = box["width"] - left - right, box["height"] - top_ - bottom
    page.page.mouse.move(box["x"] + left + 0.5 * width, box["y"] + top_ + 0.5 * height)
    page.page.mouse.down()
    for share in (0.55, 0.6, 0.75):
        page.page.mouse.move(box["x"] + left + share * width, box["y"] + top_ + 0.25 * height)
    page.page.mouse.up()
    numbers = page.page.locator(".joint input[type=number]")
    page.page.wait_for_function(
        "i => Math.abs(document.querySelectorAll('.joint input[type=number]')[i].value - 90) < 2",
        arg=chosen[0],
    )
    assert float(numbers.nth(chosen[1]).input_value()) == pytest.approx(90, abs=2)
    assert float(numbers.nth(free[0]).input_value()) == 75
    was = viewer.session.cfg.q[chosen[0]]
    page.page.focus("#mapcanvas")
    page.page.keyboard.press("Shift+ArrowLeft")
    wanted = pytest.approx(was - np.radians(10), abs=1e-6)
    page.until(lambda: viewer.session.cfg.q[chosen[0]] == wanted)
    shut(viewer, page)


@pytest.mark.slow
def test_the_drawing_is_kept_as_a_picture_and_a_motion_as_a_video(browser, tmp_path):
    base = np.tile([0, 0, 0, 0, 0, 0, 1.0], (2, 1))
    motion = sa.Motion(sa.load("planar2"), np.array([0, 0.5]), np.array([[0.3, 1.2], [0, 1]]), base)
    viewer = sa.view(motion, open=False)
    for url in (viewer.serve(), viewer.save(tmp_path / "motion.html").as_uri()):
        page = Page(browser, url, width=700, height=700)
        page.page.wait_for_selector("#motion:not([hidden])")
        page.page.wait_for_timeout(300)
        for button, name, start in (
            ("#shot", "planar2.png", b"\x89PNG"),
            ("#film", "planar2.webm", b"\x1aE\xdf\xa3"),
        ):
            with page.page.expect_download() as kept:
                page.page.click(button)
            assert kept.value.suggested_filename == name
            kept.value.save_as(tmp_path / name)
            assert (tmp_path / name).read_bytes().startswith(start)
            assert (tmp_path / name).stat().st_size > 2_000
        page.page.wait_for_selector("#film:not([aria-busy])")
        with page.page.expect_download() as kept:
            page.page.click("#frames")
        kept.value.save_as(tmp_path / "frames.zip")
        with zipfile.ZipFile(tmp_path / "frames.zip") as archive:
            assert archive.testzip() is None
            assert archive.namelist() == [f"planar2_{i:04}.png" for i in range(1, 17)]
            pictures = [archive.read(name) for name in archive.namelist()]
        assert all(picture.startswith(b"\x89PNG") for picture in pictures)
        assert len(set(pictures)) == 16, "each is of another time"
        assert page.errors == []
        page.close()
    viewer.close()


@pytest.mark.slow
def test_python_reads_what_the_page_has_moved(browser):
    viewer, page = opened(browser, sa.load("planar2").at([0.3, 1.2]))
    page.move(0, 45)
    assert viewer.q == pytest.approx([np.radians(45), 1.2])
    assert viewer.configuration.q == pytest.approx(viewer.q)
    viewer.q[0] = 9.0
    assert viewer.q[0] == pytest.approx(np.radians(45))
    shut(viewer, page)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
def test_arm_tip_and_file_are_chosen_in_the_page_and_every_client_follows(browser, tmp_path):
    viewer, page = opened(browser, sa.load("planar2").at([0.3, 1.2]), width=1366, height=768)
    other = Page(browser, viewer.url).ready()
    page.page.click("#choices summary")
    page.page.select_option("#robot", "mda6")
    for each in (page, other):
        each.wait_text("#model", "mda6")
        each.ready()
        assert each.page.locator(".joint").count() == 6
    path = tmp_path / "<b>bold<b>.urdf"
    bus, arm, elbow = two_links()
    path.write_text(robot(bus, arm, elbow, frame("tip"), joint("end", "arm", "tip", "fixed")))
    page.page.click("#choices summary")
    page.page.set_input_files("#file", path)
    page.page.wait_for_function("document.querySelectorAll('.joint').length === 1")
    page.ready()
    (tmp_path / "bad.urdf").write_text("<robot><link/></robot>")
    page.page.evaluate(
        """() => {
          const data = new DataTransfer();
          data.items.add(new File(["<robot><link/></robot>"], "bad.urdf"));
          document.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true }));
        }"""
    )
    page.page.wait_for_function("document.querySelector('#error').textContent !== ''")
    assert page.page.locator(".joint").count() == 1
    for letter, count, size in (("x", 3_000_000, 3_000_000), ("\\u0001", 1_000_000, 6_000_002)):
        page.page.evaluate(
            f"""() => {{
              const data = new DataTransfer();
              data.items.add(new File(['{letter}'.repeat({count})], "<img src=x>.urdf"));
              document.dispatchEvent(new DragEvent("drop", {{ dataTransfer: data }}));
            }}"""
        )
        page.wait_text("#error", f"<img src=x>.urdf takes {size} bytes")
    shut(viewer, page, other)


@pytest.mark.slow
def test_an_address_brings_the_posture_back(browser):
    viewer, page = opened(
        browser,
        sa.load("planar2").at([0.3, 1.2]),
        permissions=["clipboard-read", "clipboard-write"],
    )
    page.page.click("#choices summary")
    page.page.click("#link")
    page.wait_text("#link", "Copied")
    address = page.page.evaluate("navigator.clipboard.readText()")
    viewer.show([-1.0, -1.0])
    again = Page(browser, address).ready()
    again.page.wait_for_function(
        "document.querySelector('.joint input[type=number]').value === '17.19'"
    )
    assert viewer.q == pytest.approx([0.3, 1.2])
    assert "#" not in again.page.url
    viewer.handle({"do": "arm", "robot": "planar3"})
    third = Page(browser, address)
    third.wait_text("#model", "planar2")  # the address names its arm, too
    third.until(lambda: len(viewer.q) == 2 and viewer.q == pytest.approx([0.3, 1.2]))
    third.ready()
    assert "#" not in third.page.url
    shut(viewer, page, again, third)


@pytest.mark.slow
def test_a_saved_motion_shows_the_values_of_its_time(browser, tmp_path):
    arm, q = sa.load("planar2"), np.radians([[-65, -30], [-65, -11.41], [-65, 20]])
    base = np.tile([0, 0, 0, 0, 0, 0, 1.0], (3, 1))
    motion = sa.Motion(arm, np.array([0.0, 1.0, 2.0]), q, base)
    viewer = sa.view(motion, open=False)
    page = Page(browser, viewer.save(tmp_path / "m.html").as_uri(), width=1300, height=700)
    page.page.wait_for_selector("#motion:not([hidden])")
    assert page.page.is_visible("#away")
    for t, kind in ((0.0, "regular"), (1.0, "singular"), (2.0, "regular")):
        page.seek(t)
        cfg = motion.at(t)
        assert page.text("#kind") == kind
        tip = [float(x) for x in page.text("#tip").removesuffix(" m").split(",")]
        np.testing.assert_allclose(tip, cfg.tip.translation, atol=6e-4)
        radius = float(page.text("#radius").removesuffix(" m"))
        assert radius == pytest.approx(np.linalg.norm(cfg.tip.translation - cfg.com), abs=1e-3)
        assert (
            page.page.locator(".joint output").nth(1).text_content()
            == f"{np.degrees(cfg.q[1]):.2f}"
        )
        place = [f"{angle:.1f}°" for angle in np.degrees(cfg.q)]
        page.page.wait_for_selector(
            "".join(f'#mapcanvas[aria-valuetext*="{x}"]' for x in place), state="attached"
        )
    assert page.errors == []
    assert not page.page.is_visible("#away"), "it is known for the start alone"
    shut(viewer, page)


@pytest.mark.slow
def test_numbers_stand_on_the_lines_of_the_grid(browser, tmp_path):
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)
    under = """
      [...document.querySelectorAll("#ticks text")].map((text) => {
        const { THREE } = MeshCat, { camera } = window.spacearm.viewer;
        const { clientWidth: w, clientHeight: h } = text.closest("svg").parentElement;
        const [x, y] = ["x", "y"].map((name) => Number(text.getAttribute(name)));
        const ray = new THREE.Raycaster();
        ray.setFromCamera(new THREE.Vector2(2 * x / w - 1, 1 - 2 * y / h), camera);
        const up = new THREE.Plane(new THREE.Vector3(0, 1, 0), 0);
        const point = ray.ray.intersectPlane(up, new THREE.Vector3());
        return [text.textContent, point.x, -point.z];
      })"""
    live, saved = viewer.serve(), viewer.save(tmp_path / "grid.html").as_uri()
    for url in (live, saved):
        page = Page(browser, url, width=1366, height=768)
        page.page.wait_for_selector("#ticks text", state="attached")
        page.page.click("[data-view=top]")
        found = page.page.evaluate(under)
        assert {words[0] for words, *_ in found} == {"x", "y"}
        for words, x, y in found:
            axis, value, unit = words.split()
            assert unit == "m"
            assert (x if axis == "x" else y) == pytest.approx(float(value), abs=0.15)
        page.page.uncheck("[data-layer=grid]")
        assert page.page.is_hidden("#ticks")
        page.page.check("[data-layer=grid]")
        assert page.errors == []
        page.close()
    viewer.close()


@pytest.mark.slow
def test_the_robot_is_framed_below_the_buttons_on_a_phone(browser):
    viewer = sa.view(sa.load("vispa_cubesat"), open=False)
    page = Page(browser, viewer.serve(), width=390, height=844).ready()
    highest = page.page.evaluate(
        """() => {
          const { camera } = window.spacearm.viewer;
          const { height } = document.querySelector("#scene").getBoundingClientRect();
          const ups = window.spacearm.points().map((p) => p.clone().project(camera).y);
          return ((1 - Math.max(...ups)) / 2) * height;
        }"""
    )
    bar = page.page.locator("#view").bounding_box()
    scene = page.page.locator("#scene").bounding_box()
    assert highest > bar["y"] + bar["height"] - scene["y"] - 1.0
    assert page.errors == []
    page.close()
    viewer.close()
