"""`spacearm hold`, as a user calls it, and the posture that it saves."""

import json
import re

import numpy as np
import pytest
from helpers.arms import planar_pair
from helpers.commands import answer, spacearm

import spacearm as sa

tomllib = pytest.importorskip("tomllib")

START = (0.4, -1.0, 1.5, 0.3, 0.5, 0.0) * 2
DEBRIS = """
body = {mass = 90, size = [0.4, 0.4, 0.4], name = "debris"}
pose = {xyz = [0.4, 0.0, 1.0]}
grapples.ring = {xyz = [0, 0, -0.2]}
"""
GRASPS = ("--grasp", "left=ring", "--grasp", "right=0,0,0.2,180,0,0", "--deg")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "debris.toml").write_text(DEBRIS)
    return tmp_path


@pytest.mark.slow
def test_two_arms_hold_a_target_and_others_read_the_posture(folder):
    words = ("hold", "dual_ur5", "--target", "debris.toml", *GRASPS, "--with", "exact=false")
    degrees = np.degrees(START)
    run = spacearm(*words, *degrees, "--save", "held.toml", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "dual_ur5 holding debris" in run.stdout
    assert "Not checked: collisions" in run.stdout
    assert (folder / "dual_ur5_held.png").stat().st_size > 5000
    again = spacearm(*words, "held.toml", "--json", cwd=folder)
    assert again.returncode == 0, again.stderr
    told = json.loads(again.stdout)
    assert set(told["grasps"]) == {"left", "right"}
    q = told["configuration"]["q"]
    arm = sa.load("dual_ur5", tip=["left", "right"])
    box = sa.Bus(90, size=(0.4,) * 3)
    debris = sa.Target(box, sa.pose((0.4, 0, 1)), grapples={"ring": sa.pose((0, 0, -0.2))})
    held = sa.hold(
        arm.at(START), debris, {"left": "ring", "right": sa.pose((0, 0, 0.2), (np.pi, 0, 0))}
    )
    np.testing.assert_allclose(q, held.q, rtol=0, atol=1e-9)
    assert told["distance"] == pytest.approx(held.report().distance, rel=1e-6)
    file = str(folder / "held.toml")
    asked = answer("query", "dual_ur5", file, "--tip", "left,right", "--first-order")
    np.testing.assert_allclose(asked["configuration"]["q"], q, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_a_hand_regrasps_and_the_posture_after_it_is_saved(folder):
    words = ("hold", "dual_ur5", "--target", "debris.toml", *GRASPS, "--with", "limits=false")
    more = ("tip=right", "grasp=[0, 0.05, 0.2, 3.14159265358979, 0, 0]", "approach=0.02",
            "constraints.collisions=false", "constraints.limits=false")  # fmt: skip
    asked = [word for one in more for word in ("--with", f"regrasp.{one}")]
    saved = ("--save", "after.toml")
    run = spacearm(*words, *np.degrees(START), *asked, *saved, cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "right regrasps while left holds on" in run.stdout
    assert "Not checked: collisions; forces at the grasps that hold" in run.stdout
    arm = sa.load("dual_ur5", tip=["left", "right"])
    posture = tomllib.loads((folder / "after.toml").read_text())["start"]["q"]
    left, right = arm.at(posture).tips
    ring, other = sa.pose((0, 0, -0.2)), sa.pose((0, 0.05, 0.2), (np.pi, 0, 0))
    there = (left * ring.inverse() * other).actInv(right)
    np.testing.assert_allclose(there.homogeneous, np.eye(4), atol=1e-8)


@pytest.mark.slow
def test_an_arm_holds_a_handrail(folder):
    arm = sa.load("chaser7")
    start = arm.at([0.2, 0.6, 0, 1.2, 0, 0.8, 0])
    place = start.tip.translation + np.array([0.1, 0.05, 0])
    words = ("--grasp", f"{arm.tip}={','.join(map(str, place))}", "--attitude", 0, 0, 0.3)
    run = spacearm("hold", "chaser7", *start.q, *words, "--save", "on.toml", "--json", cwd=folder)
    assert run.returncode == 0, run.stderr
    told = json.loads(run.stdout)
    assert told["mode"] == "fixed"
    cfg = arm.at(told["configuration"]["q"])
    near = answer("query", "chaser7", str(folder / "on.toml"), "--first-order")
    np.testing.assert_allclose(near["configuration"]["tip"][:3], place, atol=1e-9)
    np.testing.assert_allclose(near["configuration"]["q"], cfg.q, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ((), "dual_ur5 describes no closed chain; give --grasp TIP=FRAME for each tip"),
        (("--grasp", "lef=0,0,1"), "unknown link 'lef'"),
        (("--grasp", "left=1,2,x"), "'x' is not a number"),
        (("--grasp", "left=1,2"), "give 3 finite numbers"),
        (("--grasp", "left=ring"), "the fixed world has no named frames"),
        (("--grasp", "left=9,9,9", "--fixed"), "a tip stays .* let what is held move: no --fixed"),
    ],
)
def test_wrong_grasps_are_named(words, why):
    run = spacearm("hold", "dual_ur5", *START[:6], *words, "--json")
    assert run.returncode == 2
    assert re.search(why, run.stderr), run.stderr


def test_links_that_hold_each_other_need_no_grasps(folder):
    arm = planar_pair().to_urdf(folder / "pair.urdf")
    words = (
        "hold",
        arm,
        2.0,
        -1.2,
        1.1,
        1.2,
        "--tip",
        "left=right",
        "--with",
        "limits=false",
        "--json",
    )
    run = spacearm(*words, "--save", "closed.toml", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "a chain is closed by left = right: spacearm hold keeps it" in run.stderr
    assert set(json.loads(run.stdout)["grasps"]) == {"left", "right"}
