"""Links of the built pages: they lead somewhere, and nothing is loaded from outside.

Checked without a connection: links to other pages and their anchors are followed, links to the
world are held to their form.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import unquote, urlsplit

from lxml import etree, html

OUTSIDE = re.compile(r"https://[a-z0-9-]+(\.[a-z0-9-]+)+(/\S*)?|mailto:\S+@\S+")
"""Form of a link to the world."""
LOADING = {"script", "img", "iframe", "source", "video", "audio", "embed", "input", "track"}
"""Elements that load what their src names; of links those with an rel of these:"""
RELS = {"stylesheet", "icon", "preload", "prefetch", "modulepreload", "manifest", "preconnect"}
IN_CSS = re.compile(r"(?:@import\s+|url\(\s*)[\"']?(?!data:)((?:https?:)?//[^\"')\s]+)")


class Page:
    """What a page names, leads to and loads.

    Attributes:
        anchors: Its ids and names.
        links: What its links lead to.
        loads: What is loaded with it.
    """

    def __init__(self, text: str) -> None:
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = IN_CSS.findall(
            "".join(re.findall(r"<style.*?</style>", text, re.S))
        )
        parsed = html.document_fromstring(text, html.HTMLParser(huge_tree=True))
        for element in parsed.iter(etree.Element):
            self._note(element.tag, element.attrib)

    def _note(self, tag: str, given: Mapping[str, str]) -> None:
        """Note ids, links and what an element loads."""
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if tag in LOADING and "src" in given:
            self.loads.append(given["src"])
        if tag == "link" and RELS & set(given.get("rel", "").split()):
            self.loads.append(given.get("href", ""))
        self.loads += [part.split()[0] for part in given.get("srcset", "").split(",") if part]
        self.loads += IN_CSS.findall(given.get("style", ""))
        if "srcdoc" in given:
            self.loads += Page(given["srcdoc"]).loads


def faults(folder: Path) -> list[str]:
    """Return what is wrong with the links of all pages in a folder, one sentence each."""
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in folder.rglob("*.html")}
    found = []
    for path, page in sorted(pages.items()):
        said = [_fault_of_link(link, path, pages) for link in page.links]
        said += [_fault_of_load(load, path) for load in page.loads]
        found += [f"{path.relative_to(folder)}: {fault}" for fault in dict.fromkeys(said) if fault]
    for path in sorted(folder.rglob("*.css")):
        outside = IN_CSS.findall(path.read_text(encoding="utf-8"))
        found += [f"{path.relative_to(folder)}: loads {url}" for url in outside]
    return found


def _fault_of_link(link: str, path: Path, pages: dict[Path, Page]) -> str:
    """Say what is wrong with a link; nothing if it is sound."""
    if urlsplit(link).scheme:
        return "" if OUTSIDE.fullmatch(link) else f"links to {link}, which has no form of a link"
    name, _, anchor = link.partition("#")
    target = (path.parent / unquote(name.split("?")[0])).resolve() if name else path
    if not target.is_file():
        return f"links to {link}, which is not there"
    if anchor and target in pages and unquote(anchor) not in pages[target].anchors:
        return f"links to {link}, which has no such anchor"
    return ""


def _fault_of_load(load: str, path: Path) -> str:
    """Say what is wrong with what is loaded; nothing if it stands beside the page."""
    parts = urlsplit(load)
    if parts.scheme in ("data", "blob") or load in ("", "about:blank"):
        return ""
    if parts.scheme or parts.netloc:
        return f"loads {load} from outside"
    there = (path.parent / unquote(parts.path)).is_file()
    return "" if there else f"loads {load}, which is not there"


def check(app, error) -> None:
    """Warn of all faults at the end of a build."""
    from sphinx.util import logging

    if error is None and app.builder.format == "html":
        for fault in faults(Path(app.outdir).resolve()):
            logging.getLogger(__name__).warning(fault)
