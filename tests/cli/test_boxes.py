"""`spacearm box` and `boxes`: the same as in Python, of postures and motions, and their files."""

import json

import numpy as np
import pytest
import tomllib
from helpers.commands import spacearm

import spacearm as sa


def test_the_box_of_a_posture_is_that_of_python(tmp_path):
    words = ("box", "planar2", "--deg", 20, 60, "--widest", "joint_2", "--clearance", 3)
    run = spacearm(*words, "--save", "box.toml", "--save", "limited.urdf", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "no posture in these joint ranges is singular, proven" in " ".join(run.stdout.split())
    arm = sa.load("planar2")
    cfg = arm.at(np.radians([20, 60]))
    box = sa.free_box(cfg, joints=["joint_2"], clearance=np.radians(3))
    written = tomllib.loads((tmp_path / "box.toml").read_text(encoding="utf-8"))
    np.testing.assert_allclose(
        list(written["ranges"].values()), list(box.ranges.values()), atol=1e-12
    )
    np.testing.assert_allclose(sa.load(tmp_path / "limited.urdf").upper, box.upper, atol=1e-12)


@pytest.mark.slow
def test_the_box_for_all_masses_is_in_that_of_the_arm_described():
    words = ("--deg", 20, 60, "--uncertain", "link_1=0.1", "--no-limits", "--json")
    run = spacearm("box", "planar2", *words)
    assert run.returncode == 0, run.stderr
    told, box = json.loads(run.stdout), sa.free_box(sa.load("planar2").at(np.radians([20, 60])))
    assert told["uncertain"] == {"mass of link_1": pytest.approx([3.6, 4.4])}
    slack = 0.01 * (box.upper - box.lower)[1]
    assert box.lower[1] - slack < told["lower"][1] < np.radians(60) < told["upper"][1]
    assert told["upper"][1] < box.upper[1] + slack


def test_the_box_of_a_motion_holds_it(tmp_path):
    arm = sa.load("planar2")
    motion = sa.follow(arm.at([0.3, 1.2]), [arm.at([0.5, 1.5]).tip])
    motion.save(tmp_path / "run.npz")
    run = spacearm("box", "planar2", "--motion", "run.npz", "--no-limits", "--json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    told = json.loads(run.stdout)
    lower, upper = (np.array(told[side], dtype=np.float64) for side in ("lower", "upper"))
    assert not (motion.q < lower).any()
    assert not (motion.q > upper).any()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("0.3", "1.2", "--motion", "run.npz"), "give one of them"),
        (("0.3", "1.2", "--at-least", "3.1"), "asked for"),
        (("0.3", "1.2", "--widest", "elbow"), "elbow"),
        (("0.3", "1.2", "--uncertain", "link_1"), "LINK[:KIND]=SPREAD"),
        (("0.3", "1.2", "--uncertain", "link_9=0.1"), "link_9"),
        (("0.3", "1.2", "--uncertain", "link_1=0.1", "--mode", "fixed"), "leave out --mode"),
    ],
)
def test_what_makes_no_sense_is_said(words, said):
    run = spacearm("box", "planar2", *words)
    assert run.returncode != 0
    assert said in " ".join(run.stderr.split())


def test_a_way_through_boxes_is_proven_by_path_and_a_run_goes_on_from_its_file(tmp_path):
    words = ("boxes", "planar2", "--deg", 20, 60, "--to", "100,50", "--way", "way.csv")
    run = spacearm(*words, "--keep", "boxes.npz", "--share", 0.9, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "planar2_boxes.png").is_file()
    way = np.loadtxt(tmp_path / "way.csv", delimiter=",")
    np.testing.assert_allclose(way[[0, -1]], np.radians([[20, 60], [100, 50]]), atol=1e-12)
    proof = spacearm("path", "planar2", "way.csv", cwd=tmp_path)
    assert "meets no singularity: proven" in proof.stdout
    more = spacearm("boxes", "planar2", "--keep", "boxes.npz", "--json", cwd=tmp_path)
    arm = sa.load("planar2")
    kept = sa.FreeBoxes.load(tmp_path / "boxes.npz", arm, "free-floating")
    assert json.loads(more.stdout)["covered_share"] == kept.share > 0.98
    words = ("planar2", 0.3, 1.2, "--goal", 0.9, 1.4, "--with", "search.method=boxes")
    plan = spacearm("plan", *words, "--with", "search.boxes=boxes.npz", "--json", cwd=tmp_path)
    assert json.loads(plan.stdout)["method"] == "boxes"
    without = spacearm("plan", *words)
    assert "--with search.boxes=FILE, as spacearm boxes --keep FILE" in " ".join(
        without.stderr.split()
    )
    other = spacearm("boxes", "mda6", "--keep", "boxes.npz", cwd=tmp_path)
    assert other.returncode == 2
    assert "has the boxes of planar2" in other.stderr
    alone = spacearm("boxes", "planar2", "0.3", "1.2")
    assert "for a way" in alone.stderr
