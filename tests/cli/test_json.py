"""What commands print with --json: every field is documented, and a name means one thing."""

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.arms import with_wheels
from helpers.commands import spacearm

import spacearm as sa

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "json.md"
CM = ("0.3", "1.2")
LAW = (0.3, 0.9, "--target", 0.3, 0.8, "--controller", "JointPD", "--duration", 0.2)
OBSTACLES = [
    word
    for solid in ("sphere:0,0,9:0.1", "box:0,0,9:0.1", "cylinder:0,0,9:0.1,0.2")
    for word in ("--obstacle", solid)
]
DEBRIS = """
body = {name = "debris", mass = 60, size = [0.6, 0.6, 0.8]}
pose = {xyz = [5.0, 0.25, -0.75], rpy = [0.1, 0.2, 0]}
twist = [0, 0.002, 0, 0.02, 0.03, 0.02]
grapples.side = {xyz = [-0.35, 0, 0], rpy = [0, 1.5707963, 0]}
"""
CAUGHT = (0, 0.6, 0, 1.2, 0, 0.8, 0, "--target", "debris.toml")
COMMANDS = {
    "models": (),
    "info": ("mda6",),
    "query": ("planar2", *CM),
    "nearest": ("planar2", *CM),
    "box": ("planar2", *CM),
    "boxes": ("planar2", *CM, "--to", "0.5,1.5", "--share", 0.9),
    "path": ("planar2", "run.npz"),
    "map": ("planar2", "--points", 3),
    "workspace": ("planar2", "--free"),
    "risk": ("planar2", "--samples", 60),
    "design": ("planar2", "--vary", "base_inertia=2"),
    "capture": ("planar2", *CM, "--mass", 5),
    "simulate": ("planar2", *LAW, "--with", "plant.limits=true"),
    "plan": ("planar2", *CM, "--goal", 0.9, 1.4, *OBSTACLES),
    "follow": ("planar2", *CM, "--path", "corners.csv"),
    "catch": ("chaser7", *CAUGHT, "--window", "20,20", "--with", "wanted=1"),
    "hold": ("chaser7", *CAUGHT, "--grasp", "tip=side", "--with", "exact=false"),
    "detumble": (
        "wheels.urdf",
        *CM,
        "--goal",
        1.2,
        0.9,
        *OBSTACLES,
        "--with",
        "start.momentum=[0, 0, 0, 0, 0, 0.2]",
        "--with",
        'constraints.wheels={"torque": 2.0, "capacity": 9.0}',
    ),
    "attitudes": ("planar2", "--corner", 1.2, 0.6, "--corner", 1.0, 0.9, "--samples", 16),
    "identify": ("planar2", "--motion", "held.csv"),
    "reaction": ("planar2", "--motion", "run.npz"),
    "wheels": ("planar2", "--motion", "run.npz"),
    "watch": ("planar2", "states.jsonl"),
}
SPATIAL = ("ets7", "--task", "position", *(
    word for joint in "456" for word in ("--lock", f"joint_{joint}=0.3")
))  # fmt: skip
MORE = {
    "design": (*SPATIAL, "--vary", "base_inertia=2"),
    "workspace": (*SPATIAL, "--mode", "fixed"),
    "simulate": ("planar2", "--deg", -57.936, 60.337, "--attitude", 0, 0, 21, "--with",
                 "origin=cm", "--target", 1.5, 1.5, "--with", "stop=singularity"),
}  # fmt: skip
"""What has in it what the others have not: volumes, events."""
NUMBERED = {"percentiles", "held", "parameters", "joints_of", "recipe", "grasps", "grapples"}
"""Objects whose keys are data: names of joints, of parameters, percentages."""


def documented():
    """The rows of the page: {object: {field: (unit, meaning, commands)}}, "" of the answers."""
    fields, at = {"": {}}, ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("## `"):
            names = re.findall(r"`(\w+)`", line)
            at = names[0]
            fields[at] = {}
            for other in names[1:]:
                fields[other] = fields[at]
        elif line.startswith("| `"):
            name, unit, meaning, *commands = (x.strip() for x in line.strip("| ").split(" | "))
            assert name.strip("`") not in fields[at], f"{name} stands twice"
            fields[at][name.strip("`")] = (unit, meaning, " ".join(commands).split(", "))
    return fields


def found(data, inside=""):
    """All (object, field) of an answer; entries of lists count as their list."""
    if isinstance(data, list):
        return set().union(*(found(entry, inside) for entry in data))
    if not isinstance(data, dict) or inside in NUMBERED:
        return set()
    return {(inside, name) for name in data}.union(*(found(v, k) for k, v in data.items()))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    here = tmp_path_factory.mktemp("json")
    sa.Motion(
        sa.load("planar2"), [0.0, 1.0], [[0.3, 0.9], [0.35, 1.0]], np.tile(np.eye(7)[6], (2, 1))
    ).save(here / "run.npz")
    held = sa.load("planar2").grasp(3.0, 0.4 * np.eye(3), (0.1, 0.2, 0)).at([0.3, 1.2])
    law, coarse = sa.JointPD([1.0, 0.2], kp=5, kd=5), sa.Integration(dt=0.1)
    sa.write_motion(sa.simulate(held, law, 5.0, integration=coarse), here / "held.csv")
    text = with_wheels("planar2", (0, 0, 1))
    (here / "corners.csv").write_text("t,x,y\n2,1.2,1.2\n4,1.0,1.1\n", encoding="utf-8")
    (here / "states.jsonl").write_text('{"t": 0.1, "q": [0.3, 1.2]}\n', encoding="utf-8")
    (here / "debris.toml").write_text(DEBRIS, encoding="utf-8")
    (here / "wheels.urdf").write_text(text, encoding="utf-8")
    return here


@pytest.fixture(scope="module")
def told_by(folder):
    """What all fields are that a command answers with, run once."""

    @cache
    def told(command, more=False):
        plain = ("models", "info", "query", "nearest", "box", "path", "capture", "watch")
        drawn = () if command in plain else ("--output", "p.svg")
        words = (MORE if more else COMMANDS)[command]
        run = spacearm(command, *words, "--json", *drawn, cwd=folder)
        assert run.returncode == 0, run.stderr
        return found(json.loads(run.stdout))

    return told


@pytest.mark.parametrize(
    "command",
    [pytest.param(c, marks=[pytest.mark.slow] * (c in ("catch", "detumble"))) for c in COMMANDS],
)
def test_every_field_stands_on_the_page_with_its_unit(command, told_by):
    page, told = documented(), told_by(command)
    missing = {(o, f) for o, f in told if f not in page.get(o, {})}
    assert not missing
    for inside, name in told:
        unit, meaning, commands = page[inside][name]
        assert unit
        assert meaning
        if not inside:
            assert command in commands, f"{name}: add {command}"
    stale = {f for f, (_, _, commands) in page[""].items() if command in commands}
    assert stale <= {f for o, f in told if not o}


@pytest.mark.slow
def test_every_field_of_the_page_is_answered(told_by):
    """Lists of objects too: an empty one would show none of their fields."""
    told = set().union(*map(told_by, COMMANDS), *(told_by(command, True) for command in MORE))
    assert {(o, f) for o, fields in documented().items() for f in fields} <= told


def test_the_page_names_every_command_that_has_json():
    from spacearm.cli.app import COMMANDS as ALL

    having = {n for n in ALL if re.search(r"^ +--json ", spacearm(n, "--help").stdout, re.M)}
    assert having == set(COMMANDS)
    assert {c for row in documented()[""].values() for c in row[2]} == having


def test_a_map_that_is_read_in_another_program(folder):
    """Names of one thing agree: what a query calls distance, a map and a search call so too."""
    query = json.loads(spacearm("query", "planar2", *CM, "--json").stdout)
    near = json.loads(spacearm("nearest", "planar2", *CM, "--json").stdout)
    np.testing.assert_allclose(query["distance"], near["distance"], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(query["nearest"], near["nearest"], atol=1e-9)
    whole = json.loads(spacearm("workspace", "planar2", "--json", cwd=folder).stdout)
    design = json.loads(
        spacearm("design", "planar2", "--vary", "base_inertia=1", "--json", cwd=folder).stdout
    )["designs"][0]
    for name in ("pdw", "fraction"):
        np.testing.assert_allclose(design[name], whole[name], atol=1e-9)
    assert design["areas"]["piw"] == pytest.approx(whole["areas"]["piw"])
    assert 0.0 < design["near_share"] < 1.0  # tells designs apart whose fractions are all 0
    assert 0.0 < design["near_error"] < 0.01
