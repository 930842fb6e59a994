"""Pages that are made from the package: names, equations, conventions, architecture."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from pathlib import Path

import architecture
import equations
from typer.testing import CliRunner

import spacearm as sa
from spacearm.cli.app import COMMANDS, application

TITLES = {
    "load": "Loading arms",
    "query": "Querying postures",
    "dynamics": "Momentum and dynamics",
    "sets": "Singular sets",
    "workspaces": "Workspaces and design",
    "motion": "Motions in time",
    "servo": "Servo",
    "planning": "Planning",
    "mission": "Mission design",
    "uncertainty": "Uncertain arms",
    "sweeps": "Sweeps",
    "export": "Export and files",
    "show": "Plots and the page",
    "errors": "Errors",
}
"""Titles of the pages of the reference by the groups of `help(spacearm)`."""


def write(docs: Path) -> None:
    """Write all generated pages and parts."""
    groups, conventions = _tables()
    parts = {
        "generated/equations.md": equations.table(),
        "generated/conventions.md": _table(conventions, ("thing", "convention")),
        "generated/layers.svg": architecture.drawing(),
        "generated/folders.md": architecture.folders(),
        "generated/names.md": _index(groups),
        "generated/commands.md": _commands(),
    }
    for group, names in groups:
        parts[f"api/{group}.md"] = _page(TITLES.get(group, group.capitalize()), names.split())
    for name, text in parts.items():
        path = docs / name
        path.parent.mkdir(exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def _tables() -> list[list[tuple[str, str]]]:
    """Return the two tables of the package docstring as rows of two cells."""
    tables: list[list[tuple[str, str]]] = []
    inside = False
    for line in (inspect.getdoc(sa) or "").splitlines():
        if line.startswith("==="):
            inside = not inside
            if inside:
                tables.append([])
        elif inside and line.startswith(" "):
            first, more = tables[-1][-1]
            tables[-1][-1] = (first, f"{more} {line.strip()}")
        elif inside:
            first, _, more = line.partition(" ")
            tables[-1].append((first, more.strip()))
    return tables


def _table(rows: Iterable[tuple[str, str]], heads: tuple[str, str]) -> str:
    """Return a table of two columns as Markdown."""
    lines = [f"| {heads[0]} | {heads[1]} |", "|---|---|"]
    return "\n".join(lines + [f"| {a} | {b} |" for a, b in rows]) + "\n"


def _index(groups: list[tuple[str, str]]) -> str:
    """Return a table of all public names with their summaries, group by group."""
    text = []
    for group, names in groups:
        rows = [
            (f"{{py:obj}}`{n} <spacearm.{n}>`", _summary(getattr(sa, n))) for n in names.split()
        ]
        title = TITLES.get(group, group.capitalize())
        text += [f"## [{title}](../api/{group}.md)", "", _table(rows, ("name", "what it is for"))]
    return "\n".join(text)


def _commands() -> str:
    """Return what every command says with --help."""
    runner, text = CliRunner(), []
    for name in COMMANDS:
        asked = [name, "--help"]
        said = runner.invoke(application(), asked, prog_name="spacearm", env={"COLUMNS": "88"})
        text += [f"## spacearm {name}", "", "```text", said.output.strip(), "```", ""]
    return "\n".join(text)


def _summary(thing: object) -> str:
    """Return the first line of a docstring."""
    return (inspect.getdoc(thing) or "").splitlines()[0].replace("|", "\\|")


def _page(title: str, names: list[str]) -> str:
    """Return the page of one group: functions and classes as their docstrings describe them."""
    text = [f"# {title}", "", "```{eval-rst}", ".. currentmodule:: spacearm", ""]
    for name in sorted(names, key=lambda name: name[0].isupper()):
        thing = getattr(sa, name)
        if inspect.ismodule(thing):
            text += [f".. py:module:: spacearm.{name}", "", _summary(thing), ""]
            text += [".. currentmodule:: spacearm", ""]
            for part in thing.__all__:
                text += [f".. auto{_kind(getattr(thing, part))}:: spacearm.{name}.{part}", ""]
        else:
            text += [f".. auto{_kind(thing)}:: {name}", ""]
    return "\n".join([*text, "```", ""])


def _kind(thing: object) -> str:
    """Return the directive that describes a thing."""
    if inspect.isclass(thing):
        return "exception" if issubclass(thing, (Exception, Warning)) else "class"
    return "function"
