"""The notebooks as they are committed: stripped, readable as lessons, good as scripts too."""

import ast
import json
import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parent.parent / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LONGEST = 28
"""Lines of a code cell."""


def cells(path, kind):
    found = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in found if cell["cell_type"] == kind]


def test_the_course_is_whole():
    assert [path.name[:2] for path in NOTEBOOKS] == [f"{i:02d}" for i in range(1, 12)]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stripped(path):
    """jupyter nbconvert --clear-output --inplace notebooks/*.ipynb makes it so."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert set(notebook["metadata"]) <= {"kernelspec", "language_info"}
    for cell in notebook["cells"]:
        assert not cell["metadata"]
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_lessons_take_public_names_only(path):
    code = "\n".join(cells(path, "code"))
    assert not re.search(r"^(from|import) spacearm(?! as sa$)", code, re.MULTILINE)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_lesson_stands_in_the_readme_and_on_the_site(path):
    for page, folder in (("README.md", "notebooks/"), ("docs/index.md", "lessons/")):
        text = (FOLDER.parent / page).read_text(encoding="utf-8")
        assert f"{folder}{path.stem}" in text


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_lesson(path):
    text, code = cells(path, "markdown"), cells(path, "code")
    assert text[0].startswith(f"# {int(path.name[:2])} · ")
    assert "**Question.**" in text[0]
    assert text[-1].startswith("## Answer")
    assert max(len(cell.splitlines()) for cell in code) <= LONGEST


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs_as_a_script(path):
    """Plain Python, no magics; figures of sa.plot end their cell, pyplot shows its own."""
    code = cells(path, "code")
    for cell in code:
        ast.parse(cell)
        assert "savefig" not in cell
        assert "plt.close" not in cell
        last = cell.splitlines()[-1]
        if re.search(r"^figure = sa\.plot", cell, re.MULTILINE):
            assert last == "figure"
        if re.search(r"^(figure|_|axes).* = plt\.(subplots|figure)", cell, re.MULTILINE):
            assert last != "figure"
            assert not last.startswith("sa.plot(")
    assert any("sa.plot(" in cell for cell in code)
