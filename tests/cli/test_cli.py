"""The command line, from outside: output, exit codes, one line for bad input."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.arms import frame, joint, link, robot, two_links
from helpers.commands import answer, complaints, in_a_process, spacearm

import spacearm as sa


def test_the_main_job():
    run = in_a_process("query", "planar2", "--deg", "-65", "-11.41")
    assert run.stdout == spacearm("query", "planar2", "--deg", "-65", "-11.41").stdout
    assert run.returncode == 0
    assert complaints(run) == []
    for words in ("dynamic singularity", "-65°", "sigma_min", "m/rad", "lost", "available"):
        assert words in run.stdout


@pytest.mark.parametrize(
    "words", [("--deg", "-65", "-11.41"), ("-65", "-11.41", "--deg"), ("-65", "--deg", "-11.41")]
)
def test_options_and_negative_numbers_in_any_order(words):
    assert answer("query", "planar2", *words)["kind"] == "dynamic"


def test_the_verdict_comes_first_and_says_how_to_get_away():
    first, second, third, *_ = spacearm("query", "planar2", "--deg", 30, 40).stdout.splitlines()
    assert first == (
        "planar2, free-floating: regular: a singular posture found 31.7° away; "
        "none within 31.6°, proven"
    )
    assert second == "To get away, per degree: joint_2 +0.99°"
    assert third.startswith("Distance to the singular set")
    assert "about 28° away" in spacearm("query", "planar2", "--deg", 10, 30, "--first-order").stdout
    words = spacearm("query", "planar2", "--deg", -65, -11.41).stdout.splitlines()[0]
    assert "dynamic singularity: a singular posture found 0.000802° away;" in words


def test_tolerance_is_an_angle():
    posture = ("query", "planar2", "--deg", "-65", "-11.4")
    assert answer(*posture, "--tolerance", "0.01")["kind"] == "regular"
    assert answer(*posture, "--tolerance", "0.02")["kind"] == "dynamic"
    assert answer("query", "planar2", "0.3", "0.4", "--tolerance", "1")["tolerance"] == 1.0


def test_json_is_the_report():
    got = answer("query", "planar2", "-1e-1", "-.5")
    report = sa.singularity(sa.load("planar2").at([-0.1, -0.5]), exact=True)
    assert got["configuration"]["q"] == [-0.1, -0.5]
    assert got == report.to_dict()
    assert got["nearest"] == list(report.nearest)
    estimate = answer("query", "planar2", "-1e-1", "-.5", "--first-order")
    assert estimate["distance"] == report.distances[-1]
    assert estimate["nearest"] is None
    assert got["sigma"] == list(report.sigma)
    assert got["gradient"] == list(report.gradient)
    assert got["jacobian"] == report.jacobian.tolist()


def test_infinite_condition_is_null_in_json():
    assert answer("query", "planar2", "0", "0", "--task", "pose")["condition"] is None


def test_attitude_task_tip_lock_and_base():
    turned = answer("query", "planar2", "--deg", "0", "0", "--attitude", "0", "0", "-90")
    assert np.allclose(turned["configuration"]["tip"][:3], [0, -2.5, 0])
    assert answer("query", "planar2", "0.1", "0.2", "--task", "x")["task"]["rows"] == ["x"]
    assert answer("query", "planar2", "0", "--tip", "link_1")["configuration"]["tip"][0] == 0.5
    locked = answer("query", "mda6", "0", "1", "0", "0", "--deg", "--lock", "joint_3=-90",
                    "--lock", "joint_6=0")  # fmt: skip
    assert locked["configuration"]["joints"] == ["joint_1", "joint_2", "joint_4", "joint_5"]
    held = answer("query", "planar2", "--deg", "-65", "-11.41", "--mode", "attitude-controlled")
    assert held["kind"] == "regular"
    assert answer("query", "mda6", *"010101", "--task", "/2")["length"] == 2.0


def test_lock_takes_degrees_with_deg():
    a = answer("query", "planar2", "--deg", "10", "--lock", "joint_2=90")
    b = answer("query", "planar2", str(np.radians(10)), "--lock", f"joint_2={np.pi / 2}")
    assert np.allclose(a["configuration"]["tip"], b["configuration"]["tip"])


def test_models_are_listed_without_the_package_of_robots(monkeypatch):
    whole = sa.load

    def load(name):
        if name == "servicer_ur5":
            raise sa.ModelError("no example-robot-data/ur_description of ur5")
        return whole(name)

    monkeypatch.setattr(sa, "load", load)
    masses = {entry["name"]: entry["spacecraft_mass"] for entry in answer("models")}
    assert masses["planar2"] == 40
    assert masses["servicer_ur5"] is None


def test_models_and_info():
    run = spacearm("models")
    assert run.returncode == 0
    assert all(info.name in run.stdout for info in sa.catalogue())
    assert [entry["name"] for entry in answer("models")] == [i.name for i in sa.catalogue()]
    run = spacearm("info", "planar2", "--deg")
    assert run.returncode == 0
    for words in ("47 kg", "joint_1", "180°", "spacecraft", "tip", "system CM"):
        assert words in run.stdout
    facts = answer("info", "planar2")
    assert [body["mass"] for body in facts["bodies"]] == [40, 4, 3]


def test_help_and_version():
    assert "query" in spacearm().stdout
    assert "query" in spacearm("--help").stdout
    assert spacearm("--version").stdout.strip() == f"spacearm {sa.__version__}"
    assert "--attitude" in spacearm("query", "--help").stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("query", "planar2"), "0 joint values given; planar2 needs 2: joint_1, joint_2; give"),
        (("path", "planar2", "no.csv"), "no.csv cannot be read: no such file; check the path"),
        (("query", "planar2", "1", "2", "3"), "3 joint values given"),
        (("query", "planar2", "1", "x"), "'x' is not a number"),
        (("query", "planar2", "1", "nan"), "q of joint 'joint_2' is nan"),
        (("query", "planar2", "1", "--", "-inf"), "q of joint 'joint_2' is -inf"),
        (("query", "planar2", "1", "2", "--dge"), "'--dge' is not an option"),
        (("boxes", "planar2", "-o", "b.png"), "a picture is --output FILE"),
        (("plan", "planar2", "1", "2", "--goal", "1", "1", "--with", "constraints.limits=False"),
         "limits is 'False'; give true or false, as TOML and JSON write them"),
        (("query", "planar", "1", "2"), "unknown model 'planar'; valid, nearest first: planar2"),
        (("query", "nowhere.urdf", "1"), "nowhere.urdf: no such file"),
        (("query", "planar2", "1", "2", "--tip", "hand"), "--tip: unknown link 'hand'"),
        (("info", "planar2", "--joints", "hand"), "--joints: unknown movable joint 'hand'"),
        (("query", "planar2", "1", "2", "--task", "w"), "unknown task row 'w'"),
        (("query", "planar2", "1", "2", "--attitude", "1"), "--attitude"),
        (("query", "planar2", "1", "2", "--attitude", "1", "nan", "0"), "3 finite numbers"),
        (("query", "planar2", "1", "--lock", "joint_2"), "give JOINT=VALUE"),
        (("query", "planar2", *["--lock", "joint_2=1"] * 2), "'joint_2=1': joint_2 is given twice"),
        (("query", "planar2", "1", "--lock", "joint=1"), "--lock: unknown movable joint"),
        (("query", "planar2", "1", "--wheel", "joint"), "--wheel: unknown turning joint"),
        (("query", "planar2", "1", "2", "--mode", "free"), "free"),
        (("query", "planar2", "1", "2", "--tolerance", "4"), "tolerance is 4"),
        (("query", "planar2", "1", "2", "--tolerance", "x"), "--tolerance"),
        (("query", "planar2", "1", "2", "--task", "/3"), "would scale nothing"),
        (("query", "planar2", "1", "2", "--tip", ""), "unknown link ''"),
        (("query", "planar2", "1", "2", "--check", "no"), "unknown check 'no'"),
        (("plan", "planar2", "1", "2", "--goal", "1"), "--goal has 1 number; the task of planar2"),
        (("risk", "planar2", "--samples", "a"), "'a' is not a valid number; see --help"),
        (("sweep", "a.toml", "-o", "b"), "'-o' is not an option here; see --help"),
        (("wheels", "planar2"), "give --motion or --tip-speed, one of them"),
        (("query",), "MODEL'; see --help"),
        (("dance",), "dance'; see --help"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_exit_code_2(words, message):
    run = spacearm(*words)
    assert run.returncode == 2
    assert run.stdout == ""
    assert run.stderr.startswith("spacearm: error: ")
    assert len(run.stderr.splitlines()) == 1
    assert message in run.stderr


def test_warnings_are_one_line_on_stderr(tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(robot(*two_links(inside="")))
    run = spacearm("query", path, "0.1", "--json")
    assert run.returncode == 0
    assert json.loads(run.stdout)["configuration"]["q"] == [0.1]
    assert run.stderr.startswith("spacearm: warning: ")
    assert len(run.stderr.splitlines()) == 1


def test_markup_in_names_is_printed_as_it_is(tmp_path):
    path = tmp_path / "r.urdf"
    elements = (link("[red]bus", 50.0), link("a[/]"), joint("[bold]j", "[red]bus", "a[/]"))
    path.write_text(robot(*elements))
    for words in (("info", path), ("query", path, "0.5")):
        run = spacearm(*words)
        assert run.returncode == 0, run.stderr
        assert "[bold]j" in run.stdout


@pytest.mark.slow
def test_nothing_is_cut_off_in_a_narrow_terminal_or_a_pipe():
    for columns in ("30", "200"):
        run = in_a_process("query", "mda6", "--deg", 0, 60, -100, -50, 0, 0, COLUMNS=columns)
        assert "…" not in run.stdout
        assert "-0.003313" in run.stdout


def test_names_that_look_like_emoji_stay(tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(robot(link(":smile:", 50.0), link("a"), joint("j", ":smile:", "a")))
    assert ":smile:" in spacearm("info", path).stdout


@pytest.mark.slow
def test_a_terminal_without_the_letters_and_a_full_disk():
    run = in_a_process("info", "mda6", "--deg", PYTHONIOENCODING="ascii")
    assert run.returncode == 0
    assert "mda6" in run.stdout
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "spacearm", "models"]
        run = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert run.returncode == 1
    assert run.stderr.startswith("spacearm: error: cannot write the output")
    assert len(run.stderr.splitlines()) == 1


def test_locks_and_lengths_count_when_the_arm_is_loaded(tmp_path):
    path = tmp_path / "two.urdf"
    other = (link("other"), joint("elbow_2", "bus", "other"))
    path.write_text(robot(*two_links(), *other))
    assert answer("query", path, "0.1", "--lock", "elbow_2=0")["configuration"]["joints"] == [
        "elbow"
    ]
    task = ("--tip", "arm", "--task", "pose/1")
    assert answer("query", path, "0", *task)["length"] == 1.0
    for joints in ("all", "elbow_2", "elbow,elbow_2"):
        assert answer("query", path, "0", "0", "--joints", joints, *task)["length"] == 1.0


def test_help_keeps_its_units():
    assert "Joint values [rad], with --deg in degrees" in spacearm("query", "--help").stdout


def test_the_body_is_named_by_its_mass_not_by_a_massless_root(tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(robot(frame("world"), joint("weld", "world", "bus", "fixed"), *two_links()))
    assert [body["link"] for body in answer("info", path)["bodies"]] == ["bus", "arm"]


def test_a_value_at_its_limit_is_inside():
    for words in (("planar2", 180, -180), ("mda6", 0, 60, -170, 0, 0, 180)):
        assert "outside" not in spacearm("query", "--deg", *words).stdout


def test_a_value_outside_its_limits_is_marked():
    assert "outside its limits" in spacearm("query", "planar2", "4", "0").stdout


def test_info_says_what_was_chosen_why_and_how_to_choose_otherwise(tmp_path):
    path = tmp_path / "two.urdf"
    wing = (link("wing"), joint("panel", "bus", "wing"))
    path.write_text(robot(*two_links(), *wing, frame("tcp"), joint("t", "arm", "tcp", "fixed")))
    out = spacearm("info", path).stdout
    said = r"tip +tcp \(its name is one for tips; other arms end in wing\); another one: --tip"
    assert re.search(said, out)
    assert "Held joints (to make them count: --joints all, or their names; " in out
    assert re.search(r"panel +revolute +wing +0 rad", out)
    assert out.startswith("r: 1 joint, ")
    locked = spacearm("info", path, "--joints", "all", "--lock", "panel=0.5").stdout
    assert re.search(r"Locked joints\n.*\npanel +revolute +wing +0.5 rad", locked)
    assert "Held" not in locked
    other = answer("info", path, "--tip", "wing")
    assert (other["held"], other["tip_reason"]) == ({"elbow": 0.0}, "it was asked for")
    path.write_text(robot(*two_links(), *wing))
    asked = spacearm("query", path, "0")
    assert asked.returncode == 2
    assert "2 links could be the tip: arm, wing" in asked.stderr
    assert "choose one with --tip arm, or several with --tip arm," in asked.stderr
