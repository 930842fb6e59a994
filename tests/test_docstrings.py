"""Docstrings: sections complete, examples that run."""

import ast
import doctest
import inspect
import re
import textwrap

import pytest

import spacearm as sa

SECTION = re.compile(r"^(Args|Returns|Raises|Warns|Example|Attributes|Yields):$", re.MULTILINE)
FREE = {"self", "cls"}
SLOW = {
    "catch",
    "design.optimise_mount",
    "design.workspaces",
    "design_report",
    "fly_many",
    "free_box_for_all",
    "plan",
    "plot",
    "robust_plan",
    "simulate",
    "simulate_many",
    "sweep",
    "to_jax",
    "view",
}
"""Whose examples take over a second."""
NEEDS = {"sweep": "zarr", "to_casadi": "casadi", "to_jax": "jax", "to_mjcf": "mujoco"}
"""Whose examples take a package that the plain install does not bring."""


def public_functions():
    """Every public function by name, those of public modules such as sa.design too."""
    for name in sa.__all__:
        thing = getattr(sa, name)
        if inspect.isroutine(thing):
            yield name, thing
        if inspect.ismodule(thing):
            parts = ((f"{name}.{part}", getattr(thing, part)) for part in thing.__all__)
            yield from ((part, thing) for part, thing in parts if inspect.isroutine(thing))


def public_methods():
    """Every method that the public classes define, as CLASS.METHOD."""
    for name in sa.__all__:
        if inspect.isclass(kind := getattr(sa, name)):
            for part, method in vars(kind).items():
                method = getattr(method, "__func__", method)
                if inspect.isfunction(method) and not part.startswith("_"):
                    yield f"{name}.{part}", method


FUNCTIONS = dict(public_functions())
METHODS = dict(public_methods())


def sections(thing):
    """The sections of a docstring by their heads."""
    _, *parts = SECTION.split(inspect.getdoc(thing) or "")
    return dict(zip(parts[::2], parts[1::2], strict=True))


def entries(section):
    """The names that a section lists."""
    return set(re.findall(r"^ {4}\*{0,2}(\w+)(?: \(.*\))?:", section, re.MULTILINE))


def raised(function):
    """The exceptions that the body of a function raises itself."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    calls = (node.exc for node in ast.walk(tree) if isinstance(node, ast.Raise))
    return {
        call.func.id for call in calls if isinstance(call, ast.Call) and hasattr(call.func, "id")
    }


def test_there_are_functions_to_look_at():
    assert len(FUNCTIONS) > 35
    assert {"load", "design.vary", "plan"} <= set(FUNCTIONS)


def test_arguments_are_those_of_the_signature():
    for name, function in (FUNCTIONS | METHODS).items():
        parameters = set(inspect.signature(function).parameters) - FREE
        told = entries(sections(function).get("Args", ""))
        assert told == parameters or (name in METHODS and not told), name


def test_what_is_returned_is_told():
    for name, function in FUNCTIONS.items():
        assert sections(function).get("Returns", "").strip(), name


def test_what_is_raised_is_told_and_public():
    for name, function in (FUNCTIONS | METHODS).items():
        told = entries(sections(function).get("Raises", ""))
        told |= set(re.findall(r"^Raise (\w+):", inspect.getdoc(function) or ""))
        assert raised(function) <= told, name
        ours = (sa.SpaceArmError, sa.StoppedError)
        assert all(issubclass(getattr(sa, error), ours) for error in told), name


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n in SLOW)) for n in FUNCTIONS]
)
def test_every_function_has_an_example_that_runs(name, tmp_path, monkeypatch):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    monkeypatch.chdir(tmp_path)
    (example,) = doctest.DocTestFinder(recurse=False).find(FUNCTIONS[name], name, globs={})
    runner, said = doctest.DocTestRunner(), []
    runner.run(example, out=said.append)
    assert runner.summarize(verbose=False).attempted
    assert not said, "".join(said)
