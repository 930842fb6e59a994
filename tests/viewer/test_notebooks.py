"""The live page in the output of a notebook's cell, in a real browser."""

import contextlib
import re
import sys
import threading
import urllib.error
import urllib.request
import warnings
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace
from urllib.parse import urlsplit

import numpy as np
import pytest
from helpers.pages import Page

import spacearm as sa

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    from spacearm.viewer import server

SLIDER = ".joint:nth-child(1) input[type=range]"


@contextlib.contextmanager
def notebook(output):
    """The server of a page of this machine that shows the output of a cell."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            if self.path == "/":
                self.wfile.write(f"<!DOCTYPE html><body>{output}</body>".encode())

        def log_message(self, *_):
            pass

    host = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=host.serve_forever, daemon=True).start()
    try:
        yield host.server_port
    finally:
        host.shutdown()
        host.server_close()


@pytest.fixture
def viewer():
    viewer = sa.view(sa.load("planar2").at([0.3, 1.2]), open=False)
    viewer.serve()
    yield viewer
    viewer.close()


def live(page):
    """The frame of the live page, once it has taken the place of the scene."""
    page.page.wait_for_selector("iframe[srcdoc]", state="detached")
    frame = page.page.frame_locator("iframe[title='spacearm, live']")
    frame.locator("body[data-ready=yes]").wait_for(state="attached")
    return frame


def drag(page, frame, share):
    """Drags the first slider with the mouse to a share of its length."""
    slider = frame.locator(SLIDER)
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    middle = box["y"] + box["height"] / 2.0
    at = float(slider.input_value()) / 360.0 + 0.5
    page.page.mouse.move(box["x"] + at * box["width"], middle)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + share * box["width"], middle, steps=5)
    page.page.mouse.up()


def shown(frame):
    """The angle that stands beside the first slider [deg]."""
    return float(frame.locator(".joint:nth-child(1) input[type=number]").input_value())


def status(url):
    with contextlib.suppress(urllib.error.HTTPError), urllib.request.urlopen(url, timeout=60) as a:
        return a.status
    return 403


def test_a_scene_that_is_not_served_stands_in_the_notebook_by_itself():
    viewer = sa.view(sa.load("planar2"), open=False)
    text = viewer._repr_html_()
    assert "<script>" not in text
    assert 'srcdoc="' in text
    assert viewer.url is None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "chaser7"])
def test_where_frames_are_taken_out_a_picture_stays(browser, name):
    """As JupyterLab does with the outputs of a notebook that is not trusted."""
    arm = sa.load(name)
    text = re.sub(r"<iframe.*?</iframe>", "", sa.view(arm, open=False)._repr_html_(), flags=re.S)
    with notebook(text) as number:
        page = Page(browser, f"http://localhost:{number}/", 800, 600)
        image = page.page.locator("img")
        assert image.get_attribute("alt") == f"{name}, as it was when the cell ran"
        seen = image.evaluate(
            """async (image) => {
              await image.decode();
              const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight);
              const context = canvas.getContext("2d");
              context.drawImage(image, 0, 0);
              const [width, height] = [canvas.width, canvas.height];
              const { data } = context.getImageData(0, 0, width, height);
              const at = [...Array(width * height).keys()].filter((i) => data[4 * i + 3] > 127);
              const colours = new Set(at.map((i) => data[4 * i] >> 4));
              return [at.length / (width * height), colours.size, at.map((i) => i % width)
                .reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [width, 0])];
            }"""
        )
        page.close()
    share, colours, (left, right) = seen
    assert 0.02 < share < 0.7
    assert colours >= 3
    assert 0 < left < right < 639, "the whole robot is in the picture"
    assert right - left > 200


def test_a_notebook_gets_the_page_served_and_no_window_opened(monkeypatch):
    monkeypatch.setitem(
        sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=1))
    )
    monkeypatch.setattr("webbrowser.open", lambda _: pytest.fail("a window was opened"))
    shown = sa.view(sa.load("planar2"))
    try:
        token = urlsplit(shown.url).query.partition("=")[2]
        text = shown._repr_html_()
        assert token not in text, "others may read the notebook"
        (ticket,) = re.findall(r'live.src = "([^"]+)"', text)
        with urllib.request.urlopen(ticket, timeout=60) as answer:
            assert answer.url == shown.url
            framed = answer.headers["Content-Security-Policy"]
        hosts = {urlsplit(each).hostname for each in framed.split()[1:]}
        assert hosts == {"127.0.0.1", "localhost"}
        assert sa.view(sa.load("planar2"), open=False).url is None
    finally:
        shown.close()


def test_a_ticket_is_valid_for_a_while(viewer, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr(server, "PATIENCE", 0.0)
    viewer.open()
    assert status(opened[0]) == 403


def test_more_scenes_than_ports(monkeypatch):
    monkeypatch.setattr(server, "LAST_PORT", server.FIRST_PORT)
    shown = sa.view(sa.load("planar2"), open=False)
    try:
        assert status(shown.serve()) == 200
    finally:
        shown.close()


@pytest.mark.slow
def test_a_slider_in_the_cell_moves_what_python_has(browser, viewer):
    with notebook(viewer._repr_html_()) as number:
        page = Page(browser, f"http://localhost:{number}/", 1000, 640)
        frame = live(page)
        drag(page, frame, 0.25)
        page.until(lambda: np.degrees(viewer.q[0]) == pytest.approx(-90.0, abs=15.0))
        page.until(lambda: np.degrees(viewer.q[0]) == pytest.approx(shown(frame), abs=0.01))
        assert viewer.q[1] == 1.2

        # a notebook takes cells that are out of sight out of the page and puts them back
        page.page.evaluate(
            "() => { const b = document.querySelector('[id^=spacearm]'); b.remove();"
            " document.body.append(b); }"
        )
        frame = live(page)
        drag(page, frame, 0.75)
        page.until(lambda: np.degrees(viewer.q[0]) == pytest.approx(90.0, abs=15.0))
        page.until(lambda: np.degrees(viewer.q[0]) == pytest.approx(shown(frame), abs=0.01))

        page.page.reload()  # the invitation is used up: the scene as it was saved
        page.page.wait_for_timeout(1500)
        assert page.page.locator("iframe[srcdoc]").is_visible()
        assert not page.page.locator("iframe[title='spacearm, live']").is_visible()
        page.close()


@pytest.mark.slow
def test_a_page_of_another_host_keeps_the_scene(browser, viewer):
    with notebook(viewer._repr_html_()) as number:
        page = Page(browser, f"http://elsewhere.localhost:{number}/", 1000, 640)
        saved = page.page.frame_locator("iframe[srcdoc]")
        saved.locator("#model").wait_for()
        assert saved.locator("#model").text_content() == "planar2"
        assert page.page.locator("iframe[title='spacearm, live']").count() == 0
        assert page.errors == []

        page.page.evaluate(  # what asks for the page all the same does not get it into a frame
            "address => { const f = document.createElement('iframe'); f.src = address;"
            " document.body.append(f); }",
            viewer._server.invitation(),
        )
        page.until(lambda: any("frame-ancestors" in each for each in page.errors))
        page.close()
