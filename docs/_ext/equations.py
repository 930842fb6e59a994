"""The table from equation numbers of the 1993 paper to the lines that compute and check them.

Read off the package and its tests: docstrings cite "equation (35)", lines of formulas end in
"# (12)".
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import spacearm as sa

ROOT = Path(__file__).resolve().parents[2]
MEANING = {
    "1": "tip twist by J*",
    "2": "positions of the bodies' CMs",
    "3": "position of the tip",
    "4": "neighbouring CMs",
    "5": "CMs about the system CM",
    "7": "mass distribution mu",
    "8": "barycentres c",
    "9": "barycentric vectors c*, r*, l*",
    "10": "their weighted sum is zero",
    "11": "CMs from barycentric vectors",
    "12": "selection law v_ik",
    "20": "angular momentum",
    "21": "D_ij for i < j",
    "22": "D_ij for i = j",
    "23": "D_ij for i > j",
    "27": "attitude of the spacecraft T_0",
    "28": "Euler parameters",
    "29": "T_0 from Euler parameters",
    "30": "angular velocities of the bodies",
    "31": "F_j",
    "33c": "angular momentum is zero: the spacecraft's rate",
    "34a": "J_11, J_12, J_22",
    "34b": "D_j, D, D_q",
    "35": "the generalized Jacobian J*",
    "36": "rates of the Euler parameters",
    "37": "a configuration is singular: det J* = 0",
    "39b": "J* of the planar example",
    "41": "the singular set of the planar example",
    "42": "transposed Jacobian control",
    "43": "distance R of the tip from the system CM",
    "44": "shells of the path dependent workspace",
    "45": "R of the planar example",
    "46": "path dependent workspace",
    "47": "path independent workspace",
}
"""What each equation says."""
NUMBER = r"\((\d{1,2}[a-c]?)\)"
CITED = re.compile(rf"equations?\s+((?:{NUMBER}(?:\s*(?:,|and|to|-|,\s*and)\s*)?)+)")
FORMULA = re.compile(rf"(?:#\s*|,\s){NUMBER}(?:\.?\"\"\")?\.?\s*$")
SHOWN = {*sa._HOMES.values(), "spacearm.workspaces.design"}
"""Modules whose source stands in the site."""


class Citation(NamedTuple):
    """One place that computes, checks or cites an equation.

    Attributes:
        equation: Its number in the paper.
        module: Name of the module, of the package or of the tests.
        owner: The function or class around the line; empty for a module.
        line: Line in the file, from 1.
    """

    equation: str
    module: str
    owner: str
    line: int


def citations(folder: str = "spacearm") -> list[Citation]:
    """Return all citations of the package or of "tests", in the order of the equations."""
    found = [c for path in sorted((ROOT / folder).rglob("*.py")) for c in _cited_in(path)]
    return sorted(set(found), key=lambda c: (int(re.sub(r"\D", "", c.equation)), c))


def _cited_in(path: Path) -> Iterator[Citation]:
    """Yield the citations of one file."""
    text = path.read_text(encoding="utf-8")
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    owners = _owners(ast.parse(text))
    for match in CITED.finditer(text):
        yield from _numbers(match.group(1), module, text.count("\n", 0, match.start()) + 1, owners)
    for line, content in enumerate(text.splitlines(), 1):
        if match := FORMULA.search(content):
            yield from _numbers(match.group(0), module, line, owners)


def _numbers(
    text: str, module: str, line: int, owners: list[tuple[int, int, str]]
) -> Iterator[Citation]:
    """Yield the equations that a citation names, ranges such as (2)-(35) by their ends."""
    around = [name for first, last, name in owners if first <= line <= last]
    for number in re.findall(NUMBER, text):
        yield Citation(number, module, around[-1] if around else "", line)


def _owners(tree: ast.AST, prefix: str = "") -> list[tuple[int, int, str]]:
    """Return first line, last line and name of all functions and classes, outer ones first."""
    found: list[tuple[int, int, str]] = []
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            name = f"{prefix}{node.name}"
            found += [(node.lineno, node.end_lineno or node.lineno, name)]
            found += _owners(node, f"{name}.")
    return found


def table() -> str:
    """Return the table as Markdown."""
    code, tests = citations(), citations("tests")
    rows = ["| equation | what it says | where |", "|---|---|---|"]
    for number, meaning in MEANING.items():
        where = _places(c for c in code if c.equation == number)
        where += [f"checked: {p}" for p in _places(c for c in tests if c.equation == number)]
        rows.append(f"| ({number}) | {meaning} | {'<br>'.join(where)} |")
    return "\n".join(rows) + "\n"


def _places(found: Iterable[Citation]) -> list[str]:
    """Return where an equation stands, a function with all its lines each."""
    places = []
    for (module, owner), same in groupby(found, key=lambda c: (c.module, c.owner)):
        lines = [str(c.line) for c in same]
        name = f"<code>{module.removeprefix('spacearm.')}</code>"
        if module in SHOWN:
            page = f"../_modules/{module.replace('.', '/')}.html"
            anchor = f"#{owner}" if owner in sa.__all__ else ""
            name = f'<a href="{page}{anchor}">{name}</a>'
        at = f"line{'s' * (len(lines) > 1)} {', '.join(lines)}"
        places.append(f"{name} {at}" + (f", <code>{owner}</code>" if owner else ""))
    return places


if __name__ == "__main__":
    print(table())
