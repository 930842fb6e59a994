"""The house: folders, sizes and names (its layers: see pyproject.toml)."""

import ast
import inspect
import pydoc
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

import spacearm as sa

HOUSE = Path(__file__).resolve().parents[1] / "spacearm"
MODULES = sorted(HOUSE.rglob("*.py"))
FOLDERS = sorted({path.parent for path in MODULES} - {HOUSE})
NESTED = {"description/readers", "planning/strategies"}
"""Folders in folders: each an idea of its own."""
MOST_PARAMETERS, MOST_IMPORTS = 12, 0.09
"""How many there may be; of imports the share of the lines of code."""


def named(path):
    return path.relative_to(HOUSE).as_posix()


@cache
def tree_of(path):
    """The syntax tree of a module."""
    return ast.parse(path.read_text(encoding="utf-8"))


def parts(tree):
    """The docstrings and the imports in a syntax tree, as sets of line numbers."""
    documented, imported = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            imported.update(range(node.lineno, node.end_lineno + 1))
        elif isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module) and node.body:
            first = node.body[0]
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                documented.update(range(first.lineno, first.end_lineno + 1))
    return documented, imported


def test_a_module_is_one_idea():
    for path in MODULES:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 700, named(path)


def test_there_are_few_imports():
    code = imports = 0
    for path in MODULES:
        text = path.read_text(encoding="utf-8")
        documented, imported = parts(tree_of(path))
        lines = enumerate(text.splitlines(), 1)
        counted = {i for i, line in lines if line.strip() and not line.strip().startswith("#")}
        code += len(counted - documented)
        imports += len(counted & imported)
    assert imports <= MOST_IMPORTS * code


def test_no_name_of_a_module_stands_more_than_twice():
    names = Counter(path.name for path in MODULES if path.name != "__init__.py")
    assert [name for name, count in names.items() if count > 2] == []


def test_a_folder_in_a_folder_is_an_idea_of_its_own():
    assert {named(folder) for folder in FOLDERS if folder.parent != HOUSE} <= NESTED


def test_functions_have_few_parameters():
    for path in MODULES:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                count = len(node.args.posonlyargs + node.args.args + node.args.kwonlyargs)
                assert count <= MOST_PARAMETERS, f"{named(path)}: {node.name}"


@pytest.mark.parametrize("folder", FOLDERS, ids=named)
def test_a_folder_is_small_and_its_init_a_docstring(folder):
    modules = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
    assert len(modules) <= 14
    tree = tree_of(folder / "__init__.py")
    assert ast.get_docstring(tree)
    assert len(tree.body) == 1


def test_the_root_holds_eight_modules_at_most():
    assert len(list(HOUSE.glob("*.py"))) <= 8


def test_no_module_hides_behind_a_public_function():
    functions = {name for name in sa.__all__ if inspect.isroutine(getattr(sa, name))}
    stems = {path.stem for path in MODULES} | {folder.name for folder in FOLDERS}
    assert not functions & stems
    assert "utils" not in stems


def test_every_module_says_what_it_is():
    for path in MODULES:
        assert ast.get_docstring(tree_of(path)), named(path)


def test_what_constants_mean_stands_above_them():
    for path in MODULES:
        for statement in tree_of(path).body[1:]:
            said = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
            assert not said, f"{named(path)}, line {statement.lineno}: say it above, after #:"


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


def test_each_comparison_states_its_tolerance_near_zero():
    """A relative tolerance says nothing of zeros: `atol=0` stands where none can be."""
    for path in sorted(HOUSE.parent.joinpath("tests").rglob("*.py")):
        for call in ast.walk(tree_of(path)):
            name = getattr(call.func, "attr", None) if isinstance(call, ast.Call) else None
            if name == "assert_allclose":
                stated = {keyword.arg for keyword in call.keywords}
                assert "atol" in stated, f"{path.name}, line {call.lineno}: give atol="
