"""Examples are run when the site is built, so here only that they are short and all are shown."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def text(path):
    return path.read_text(encoding="utf-8")


def test_the_page_shows_every_example():
    page = text(ROOT / "docs" / "examples.md")
    shown = re.findall(r"^```\{literalinclude\} \.\./examples/(\w+)\.py$", page, re.MULTILINE)
    assert sorted(shown) == [path.stem for path in EXAMPLES]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short(path):
    assert len(text(path).splitlines()) <= 110
    assert ast.get_docstring(ast.parse(text(path)))
