"""The site: its table of equations, its links, and what its pages load."""

import re
import shutil
from pathlib import Path

import equations
import generated
import links
import pytest

import spacearm as sa

BUILT = Path(__file__).resolve().parents[1] / "docs" / "_build" / "html"


@pytest.mark.slow
def test_every_equation_of_the_table_stands_somewhere():
    found = {c.equation for folder in ("spacearm", "tests") for c in equations.citations(folder)}
    assert set(equations.MEANING) <= found
    assert {"12", "35", "42"} <= {c.equation for c in equations.citations()}


def test_every_cited_equation_is_in_the_table():
    assert {c.equation for c in equations.citations()} <= set(equations.MEANING)


@pytest.mark.slow
def test_cited_lines_name_their_equation():
    for cited in equations.citations():
        path = equations.ROOT / (cited.module.replace(".", "/") + ".py")
        lines = path.read_text(encoding="utf-8").splitlines()
        assert "(" in " ".join(lines[cited.line - 1 : cited.line + 3])
        assert f"({cited.equation})" in " ".join(lines[cited.line - 1 : cited.line + 3])


@pytest.mark.slow
def test_the_reference_has_a_page_for_every_public_name(tmp_path):
    generated.write(tmp_path)
    pages = "".join(page.read_text(encoding="utf-8") for page in (tmp_path / "api").glob("*.md"))
    told = set(re.findall(r"^\.\. (?:auto\w+|py:module):: (?:spacearm\.)?(\S+)$", pages, re.M))
    assert set(sa.__all__) - {"__version__"} <= told
    listed = (equations.ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    assert all(f"../api/{page.stem}\n" in listed for page in (tmp_path / "api").glob("*.md"))


FAULTY = """<html><head><link rel="stylesheet" href="https://a.example.org/x.css">
<style>@import "https://b.example.org/y.css";</style></head><body id="top">
<a href="#bottom">1</a><a href="nowhere.html">2</a><a href="http://c.example.org">3</a>
<a href="https://d.example.org/a b">4</a><img src="//e.example.org/z.png"><img src="gone.png">
<iframe srcdoc="&lt;script src='https://f.example.org/g.js'&gt;&lt;/script&gt;"></iframe>
<a href="#top">sound</a><a href="https://g.example.org/h?i=1#j">sound</a>
<a href="page.html#top">sound</a><img src="data:image/png;base64,AA"></body></html>"""


def test_faults_of_links_are_found(tmp_path):
    (tmp_path / "page.html").write_text(FAULTY)
    (tmp_path / "style.css").write_text("p {background: url('https://h.example.org/i.png')}")
    found = "\n".join(links.faults(tmp_path))
    for fault in ("#bottom", "nowhere.html", "http://c.", "/a b", "gone.png"):
        assert fault in found
    for host in "abefh":
        assert f"{host}.example.org" in found
    assert "g.example.org/h" not in found
    assert "sound" not in found
    assert len(found.splitlines()) == 10


@pytest.mark.slow
def test_no_lesson_shows_a_picture_twice():
    """As a notebook does that draws the value of a cell and pyplot's figures."""
    lessons = sorted((BUILT / "lessons").glob("*.html"))
    if not lessons:
        pytest.skip("the site is not built: python -m sphinx -W docs docs/_build/html")
    for page in lessons:
        text = page.read_text(encoding="utf-8")
        pictures = re.findall(r'<img [^>]*src="[^"]*_images/([0-9a-f]{32,}\.png)"', text)
        assert pictures, page.name
        assert len(pictures) == len(set(pictures)), page.name


@pytest.mark.slow
def test_pages_in_a_browser_load_nothing_from_outside_and_fit():
    """On the site as `python -m sphinx -W docs docs/_build/html` builds it, wide and narrow."""
    pages = [page for page in sorted(BUILT.rglob("*.html")) if "_modules" not in page.parts]
    if not pages:
        pytest.skip("the site is not built: python -m sphinx -W docs docs/_build/html")
    from playwright.sync_api import sync_playwright

    local = ("file:", "data:", "blob:", "about:")
    with sync_playwright() as playwright:
        flags = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
        page = browser.new_page()
        page.set_default_timeout(120_000)
        outside, wide, errors = [], [], []
        page.on("request", lambda r: r.url.startswith(local) or outside.append(r.url))
        page.on("pageerror", lambda error: errors.append(f"{page.url}: {error}"))
        for path in pages:
            page.set_viewport_size({"width": 390, "height": 900})  # narrowed, a page is wide first
            page.goto(path.as_uri())
            for width in (390, 1280):
                page.set_viewport_size({"width": width, "height": 900})
                if page.evaluate("document.documentElement.scrollWidth") > width:
                    wide.append((path.relative_to(BUILT).as_posix(), width))
        browser.close()
    assert not outside
    assert not errors
    assert not wide
