"""The house: folders, sizes and names (its layers: see pyproject.toml)."""

import ast
import inspect
import pydoc
from pathlib import Path

import pytest

import spacearm as sa

HOUSE = Path(__file__).resolve().parents[1] / "spacearm"
MODULES = sorted(HOUSE.rglob("*.py"))
FOLDERS = sorted({path.parent for path in MODULES} - {HOUSE})


def named(path):
    return path.relative_to(HOUSE).as_posix()


@pytest.mark.parametrize("path", MODULES, ids=named)
def test_a_module_is_short(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 700


@pytest.mark.parametrize("folder", FOLDERS, ids=named)
def test_a_folder_is_small_and_its_init_a_docstring(folder):
    modules = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
    assert len(modules) <= 14
    tree = ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))
    assert ast.get_docstring(tree)
    assert len(tree.body) == 1


def test_the_root_holds_seven_modules_at_most():
    assert len(list(HOUSE.glob("*.py"))) <= 7


def test_no_module_hides_behind_a_public_function():
    functions = {name for name in sa.__all__ if inspect.isroutine(getattr(sa, name))}
    stems = {path.stem for path in MODULES} | {folder.name for folder in FOLDERS}
    assert not functions & stems
    assert "utils" not in stems


def test_every_module_says_what_it_is():
    for path in MODULES:
        assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), named(path)


def test_the_package_shows_its_public_names_and_nothing_else():
    assert dir(sa) == sorted(sa.__all__)
    page = pydoc.plain(pydoc.render_doc(sa))
    for name in set(sa.__all__) - {"__version__"}:
        assert name in page
    for folder in FOLDERS:
        assert f"\n    {folder.name}\n" not in page, "help(sa) lists a folder"


def test_the_tests_mirror_the_package():
    tests = HOUSE.parent / "tests"
    for path in tests.glob("*/test_*.py"):
        assert (HOUSE / path.parent.name).is_dir() or path.parent.name in ("tools", "against"), path
