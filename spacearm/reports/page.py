"""The page of a design report: HTML with everything inside it."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from spacearm.results import Description, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGEST_SVG = 400_000
"""Pictures that are larger as SVG are written as PNG [bytes]."""
DOTS = 150
"""Dots per inch of PNG pictures."""

STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, "Segoe UI", Helvetica, Arial, sans-serif; color: #1c232b;
  max-width: 60em; margin: 2em auto; padding: 0 1.5em; }
h1 { font-size: 1.8em; margin-bottom: 0.1em; }
h2 { font-size: 1.25em; margin-top: 2em; border-bottom: 1px solid #c8cfd6; padding-bottom: 0.2em; }
p.about { color: #5b6470; margin-top: 0; }
figure { margin: 1em 0; break-inside: avoid; }
figure img { max-width: 100%; height: auto; display: block; margin: 0 auto; }
figcaption { color: #5b6470; font-size: 0.92em; }
code { font: 0.86em/1.4 ui-monospace, Menlo, Consolas, monospace; background: #f1f3f5;
  padding: 0.15em 0.4em; border-radius: 3px; overflow-wrap: anywhere; }
p.command { margin: 0.3em 0 0; }
table { border-collapse: collapse; margin: 0.8em 0; font-size: 0.92em; break-inside: avoid; }
th, td { text-align: right; padding: 0.2em 0.9em 0.2em 0; font-variant-numeric: tabular-nums; }
th:first-child, td:first-child { text-align: left; }
th { border-bottom: 1px solid #c8cfd6; font-weight: 600; }
p.missing { color: #8a4b08; }
nav { font-size: 0.92em; }
nav a { margin-right: 1em; color: #0060a0; }
@page { margin: 18mm 15mm; }
@media print { body { font-size: 10.5pt; max-width: none; margin: 0; padding: 0; }
  nav { display: none; } h2 { break-after: avoid; } a { color: inherit; } }
"""


@dataclass
class Section:
    """A section of a report.

    Attributes:
        title: Its heading.
        blocks: Its content, HTML.
    """

    title: str
    blocks: list[str] = field(default_factory=list)

    @property
    def anchor(self) -> str:
        """Name by which the contents lead here."""
        return "".join(c if c.isalnum() else "-" for c in self.title.lower())

    def say(self, text: str, kind: str = "") -> None:
        """Add a paragraph; `kind` is its class."""
        name = f' class="{kind}"' if kind else ""
        self.blocks.append(f"<p{name}>{html.escape(text)}</p>")

    def show(self, said: Description, command: str = "") -> None:
        """Add a description, and the command that prints it."""
        self.blocks.append(said.to_html())
        self._command(command)

    def table(self, shown: Table, command: str = "") -> None:
        """Add a table, and the command that prints its numbers."""
        self.blocks.append(shown.to_html())
        self._command(command)

    def picture(self, drawn: Figure, caption: str, command: str) -> None:
        """Add a figure with its caption, and the command that draws it."""
        self.blocks.append(
            f'<figure><img src="{inside(drawn)}" alt="{html.escape(caption)}">'
            f"<figcaption>{html.escape(caption)}</figcaption></figure>"
        )
        self._command(command)

    def _command(self, command: str) -> None:
        if command:
            self.blocks.append(f'<p class="command"><code>{html.escape(command)}</code></p>')


def inside(drawn: Figure) -> str:
    """Return a figure as the address of an image that holds it."""
    kind, content = "svg+xml", _written(drawn, "svg")
    if len(content) > LARGEST_SVG:
        kind, content = "png", _written(drawn, "png")
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def _written(drawn: Figure, kind: str) -> bytes:
    buffer = io.BytesIO()
    metadata = {"Date": None} if kind == "svg" else {}
    drawn.savefig(buffer, format=kind, dpi=DOTS, metadata=metadata)
    return buffer.getvalue()


def page(title: str, about: str, sections: Sequence[Section]) -> str:
    """Return the whole page."""
    links = "".join(
        f'<a href="#{section.anchor}">{html.escape(section.title)}</a>' for section in sections
    )
    parts = "".join(
        f'<section id="{section.anchor}"><h2>{html.escape(section.title)}</h2>'
        f"{''.join(section.blocks)}</section>"
        for section in sections
    )
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head><body>"
        f'<h1>{html.escape(title)}</h1><p class="about">{html.escape(about)}</p>'
        f"<nav>{links}</nav>{parts}</body></html>\n"
    )
