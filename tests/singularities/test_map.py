"""Singular maps: numbers, pictures, the command."""

import json
import re

import numpy as np
import pytest
from helpers.commands import spacearm

import spacearm as sa


def test_a_map_is_sigma_min_with_the_curves_on_its_valleys():
    arm = sa.load("planar2")
    result = sa.singular_map(arm, points=61)
    assert result.joints == ("joint_1", "joint_2")
    i, j = 13, 40
    at = sa.singularity(arm.at([result.angles[i], result.angles[j]]))
    assert result.sigma_min[i, j] == pytest.approx(at.sigma_min, rel=1e-12)
    for curve in result.curves:
        for q in curve[::20]:
            assert sa.singularity(arm.at(q)).sigma_min < 1e-12
    swapped = sa.singular_map(arm, ("joint_2", "joint_1"), points=61)
    assert np.allclose(swapped.sigma_min, result.sigma_min.T)
    assert sa.singularity(arm.at(swapped.curves[0][5][::-1])).sigma_min < 1e-12


def test_redundant_arms_have_a_map_without_curves():
    result = sa.singular_map(sa.load("chaser7"), ("joint_2", "joint_4"), points=5)
    assert result.curves is None
    assert result.held["joint_1"] == 0.0


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (("joint_1", "elbow"), "unknown joint 'elbow'"),
        (("joint_1", "joint_1"), "named twice"),
    ],
)
def test_bad_joints_are_named(joints, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.singular_map(sa.load("planar2"), joints, points=3)


@pytest.mark.slow
def test_the_command_writes_pictures_and_numbers(tmp_path):
    for suffix, start in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")):
        path = tmp_path / f"map{suffix}"
        run = spacearm("map", "planar2", "--output", path, "--points", 21)
        assert run.returncode == 0, run.stderr
        assert re.search(r"singular curves +2\b", run.stdout)
        assert path.read_bytes().startswith(start)
    path = tmp_path / "map.npz"
    fix = ("--fix", "joint_4=-50", "--fix", "joint_5=20", "--axes", "joint_2", "joint_3")
    run = spacearm("map", "mda6", "--deg", *fix, "--points", 5, "--npz", path)
    assert run.returncode == 0, run.stderr
    with np.load(path) as data:
        held = dict(zip(data["held_joints"], data["held"], strict=True))
        assert held["joint_4"] == pytest.approx(np.radians(-50))
        assert data["sigma_min"].shape == (5, 5)
        assert "curve_0" in data
    numbered = ("--fix", "q4=-50", "--fix", "q5=20", "--axes", "q2", "q3")
    run = spacearm("map", "mda6", "--deg", *numbered, "--points", 5, "--json")
    assert json.loads(run.stdout)["held"]["joint_4"] == pytest.approx(np.radians(-50))
    run = spacearm("map", "planar2", "--points", 5, "--json")
    answer = json.loads(run.stdout)
    assert len(answer["curves"]) == 2
    assert answer["joints"] == ["joint_1", "joint_2"]
    assert {p.name for p in tmp_path.iterdir()} == {"map.png", "map.svg", "map.pdf", "map.npz"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--fix", "elbow=1"), "unknown joint 'elbow'"),
        (("--fix", "q3=1"), "unknown joint 'q3'"),
        (("--fix", "joint_1"), "give JOINT=VALUE"),
        (("--output", "map.bmp"), "unknown suffix '.bmp'"),
        (("--output", "/nowhere/map.png"), "cannot be written"),
        (("--axes", "joint_1", "x"), "unknown joint 'x'"),
        (("--points", "1"), "--points"),
    ],
)
def test_bad_input_is_one_line(words, message):
    run = spacearm("map", "planar2", "--points", "5", *words)
    assert run.returncode == 2
    assert message in run.stderr
    assert len(run.stderr.splitlines()) == 1
