"""Every example runs, and the page of examples shows it."""

import ast
import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PACKAGES = {"casadi": "casadi", "cluster": "distributed", "jax": "jax", "pink": "pink"}
"""What to look for before an example that takes an extra runs."""


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


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(path, tmp_path, monkeypatch, capsys):
    for extra in re.findall(r'pip install "spacearm\[(\w+)\]"', text(path)):
        pytest.importorskip(PACKAGES[extra])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out
