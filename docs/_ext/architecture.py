"""The house drawn from its imports: folders as boxes in layers, arrows to what they import."""

from __future__ import annotations

import ast
from functools import cache
from html import escape
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "spacearm"
WIDTH, HEIGHT, GAP = 132, 40, 26
"""Size of a box, and the space between boxes [px]."""


@cache
def imports(package: Path = PACKAGE) -> dict[str, set[str]]:
    """Return which folders each folder of the package imports."""
    found: dict[str, set[str]] = {}
    for path in package.rglob("*.py"):
        owner = _folder(path.relative_to(package).parts)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("spacearm."):
                other = _folder((*(node.module or "").split(".")[1:], ""))
                if owner and other and owner != other:
                    found.setdefault(owner, set()).add(other)
    return found


def _folder(parts: tuple[str, ...]) -> str:
    """Return the folder that a module belongs to; modules at the root belong to none."""
    return parts[0] if len(parts) > 1 and (PACKAGE / parts[0]).is_dir() else ""


def layers(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the folders in layers: each imports from layers after its own only."""
    names = set(graph) | set().union(*graph.values())
    depth: dict[str, int] = {}

    def below(name: str) -> int:
        if name not in depth:
            depth[name] = 1 + max((below(other) for other in graph.get(name, ())), default=-1)
        return depth[name]

    height = max(map(below, names))
    return [sorted(n for n in names if depth[n] == height - i) for i in range(height + 1)]


def drawing() -> str:
    """Return the drawing as SVG; an arrow that others imply is left out."""
    graph = imports()
    rows = layers(graph)
    across = max(map(len, rows)) * (WIDTH + GAP) + GAP
    at = {
        name: (
            across / 2 + (j - (len(row) - 1) / 2) * (WIDTH + GAP),
            GAP + i * (HEIGHT + GAP) + HEIGHT / 2,
        )
        for i, row in enumerate(rows)
        for j, name in enumerate(row)
    }
    reach = {name: _reached(graph, name) for name in at}
    lines = []
    for name, others in sorted(graph.items()):
        for other in sorted(others):
            if not any(other in reach[between] for between in others - {other}):
                (x1, y1), (x2, y2) = at[name], at[other]
                lines.append(
                    f'<path d="M{x1:.0f} {y1 + HEIGHT / 2:.0f} L{x2:.0f} {y2 - HEIGHT / 2:.0f}"/>'
                )
    boxes = [
        f'<g transform="translate({x - WIDTH / 2:.0f} {y - HEIGHT / 2:.0f})">'
        f'<rect width="{WIDTH}" height="{HEIGHT}" rx="6"/>'
        f'<text x="{WIDTH / 2}" y="{HEIGHT / 2 + 5}">{escape(name)}</text></g>'
        for name, (x, y) in at.items()
    ]
    tall = GAP + len(rows) * (HEIGHT + GAP)
    style = (
        "path{stroke:#8a94a0;stroke-width:1.5;fill:none;marker-end:url(#tip)}"
        "rect{fill:#f3ead3;stroke:#5b6470}text{font:14px sans-serif;text-anchor:middle;fill:#222}"
    )
    tip = (
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path d="M0 0 L8 4 L0 8 z" style="fill:#8a94a0"/></marker>'
        "</defs>"
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {across} {tall}" width="{across}">'
        f"<style>{style}</style>{tip}{''.join(lines)}{''.join(boxes)}</svg>\n"
    )


def _reached(graph: dict[str, set[str]], name: str) -> set[str]:
    """Return all folders that a folder imports, directly or not."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        new = graph.get(waiting.pop(), set()) - found
        found |= new
        waiting += new
    return found


def folders() -> str:
    """Return a table of the modules of each folder with the first line of their docstrings."""
    text = []
    for row in layers(imports()):
        for folder in row:
            text += [f"### {folder}", "", "| module | what it holds |", "|---|---|"]
            for path in sorted((PACKAGE / folder).rglob("*.py")):
                if path.name != "__init__.py":
                    said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
                    name = path.relative_to(PACKAGE / folder).with_suffix("").as_posix()
                    text.append(
                        f"| `{name}` | {said.splitlines()[0].replace('|', chr(92) + '|')} |"
                    )
            text.append("")
    return "\n".join(text)
