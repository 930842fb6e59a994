"""`spacearm attitudes`, `reaction`, `wheels` and `report`, as a user calls them."""

import json
import re

import numpy as np
import pytest
from helpers.commands import answer, spacearm

import spacearm as sa

START = ("-57.936", "60.337", "--attitude", "0", "0", "21", "--deg")
PATH = ("--corner", "2", "0", "--corner", "1.5", "1.5")


def test_attitudes_of_figure_5(tmp_path):
    run = spacearm("attitudes", "planar2", *START, *PATH, "--samples", 90, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    (ends,) = re.findall(r"from \[°\] +to \[°\] *\n(\S+) +(\S+)", run.stdout)
    np.testing.assert_allclose([float(end) for end in ends], (57.33478, 65.15616), atol=6e-5)
    assert "Not checked: collisions" in run.stdout
    assert (tmp_path / "planar2_attitudes.png").stat().st_size > 5000
    got = answer("attitudes", "planar2", *START, *PATH, "--samples", "90", "--margin", "5")
    np.testing.assert_allclose(np.degrees(got["intervals"]), [[57.506, 65.156]], atol=1e-3)
    assert got["corners"] == [[2.0, 0.0], [1.5, 1.5]]
    wrong = spacearm("attitudes", "planar2", *PATH, "--with", "start.momentum=[1,2]")
    assert wrong.returncode == 2
    assert "momentum is [1, 2]; give 6 finite numbers" in wrong.stderr


def test_reaction_and_wheels(tmp_path):
    file = tmp_path / "way.npz"
    arm = sa.load("planar2")
    way = sa.follow(arm.at([0.3, 1.2]), [(1.5, 1.2)])
    way.save(file)
    run = spacearm("reaction", "planar2", "--motion", file, "--camera", "1,0,0", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert f"{np.degrees(sa.reaction(way).angle.max()):.4g}°" in run.stdout
    got = answer("reaction", "planar2", "--motion", str(file))
    assert got["largest_angle"] == pytest.approx(sa.reaction(way).angle.max())
    run = spacearm("wheels", "planar2", "--tip-speed", 0.1, "--samples", 50, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "left out" in run.stdout
    assert answer("wheels", "planar2", "--motion", str(file))["cases"] == "motions"
    assert spacearm("wheels", "planar2").returncode == 2


@pytest.mark.slow
def test_a_motion_is_shown_beside_another(tmp_path):
    arm = sa.load("planar2")
    for name, end in (("one", (1.5, 1.2)), ("two", (1.6, 1.0))):
        sa.follow(arm.at([0.3, 1.2]), [end]).save(tmp_path / f"{name}.npz")
    for other, name in (("two.npz", "Followed"), ("fixed", "spacecraft fixed")):
        words = ("--motion", "one.npz", "--compare", other, "--save", "page.html")
        run = spacearm("view", "planar2", *words, cwd=tmp_path)
        assert run.returncode == 0, run.stderr
        text = (tmp_path / "page.html").read_text(encoding="utf-8")
        (compared,) = re.findall(r'"compared": "([^"]*)"', text)
        assert compared.startswith(name)
    for words, why in (
        (("--motion", "one.npz", "--compare", "flying"), "flying is not a saved motion"),
        (("--compare", "fixed"), "there is no motion to compare; give --motion"),
        (("--video", "all.zip"), "there is no motion to take pictures of"),
        (("0.1", "0.2", "--motion", "one.npz"), "the motion has its own postures"),
    ):
        run = spacearm("view", "planar2", *words, "--save", "page.html", cwd=tmp_path)
        assert run.returncode != 0
        assert why in run.stderr


@pytest.mark.slow
@pytest.mark.parametrize("model", ["planar2"])
def test_a_report_is_one_page_with_the_command_of_every_figure(tmp_path, model):
    run = spacearm("report", model, "-65", "30", "--deg", "-o", "report.html", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    check_page(text)
    assert "spacearm query planar2 -1.13446 0.523599" in text  # in radians
    assert "--deg" not in text
    assert "spacearm wheels planar2 --tip-speed 0.1" in text
    for title in re.findall(r"<h2>(.*?)</h2>", text):
        begun = run.stderr.index(f"report: {title}: begun")
        assert run.stderr.index(f"report: {title}: done in ") > begun


@pytest.mark.slow
@pytest.mark.parametrize("model", ["mda6", "vispa_cubesat"])
def test_reports_of_larger_arms(tmp_path, model):
    run = spacearm("report", model, "-o", "report.html", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    check_page((tmp_path / "report.html").read_text(encoding="utf-8"))


def check_page(text):
    """Nothing is fetched from elsewhere, and every figure has its command."""
    assert text.startswith("<!doctype html>")
    assert not re.search(r'(src|href)="(?!data:|#)', text)
    figures = text.count("<figure>")
    assert figures >= 5
    assert len(re.findall(r'</figure><p class="command"><code>', text)) == figures
    for title in (
        "The arm",
        "Where it is singular",
        "Where nothing is singular",
        "Turning the spacecraft",
        "Wheels",
    ):
        assert f"<h2>{title}" in text
    assert "@media print" in text
    for command in re.findall(r"<code>python -c (.*?)</code>", text):
        assert "sa.plot(" in command


TARGET = """
pose = {xyz = [5.0, 0.25, -0.75], rpy = [0.1, 0.2, 0]}
twist = [0, 0.002, 0, 0.02, 0.03, 0.02]
[body]
name = "debris"
mass = 60
size = [0.6, 0.6, 0.8]
[grapples]
side = {xyz = [-0.35, 0, 0], rpy = [0, 1.5707963, 0]}
"""


@pytest.mark.slow
def test_a_tumbling_target_is_caught(tmp_path):
    (tmp_path / "debris.toml").write_text(TARGET)
    words = ("catch", "chaser7", 0, 0.6, 0, 1.2, 0, 0.8, 0, "--target", "debris.toml")
    how = (
        "--window",
        "20,20",
        "--save",
        "way.npz",
        "--with",
        "wanted=1",
        "--mode",
        "free-floating",
    )
    run = spacearm(*words, *how, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "chaser7 and debris: caught by side after 20 s" in run.stdout
    assert "largest rotation of the base" in run.stdout
    assert (tmp_path / "chaser7_catch.png").stat().st_size > 5000
    way = sa.Motion.load(tmp_path / "way.npz", sa.load("chaser7"))
    bus = sa.Bus(60, size=(0.6, 0.6, 0.8), name="debris")
    side = sa.pose((-0.35, 0, 0), (0, 1.5707963, 0))
    target = sa.Target(
        bus,
        sa.pose((5.0, 0.25, -0.75), (0.1, 0.2, 0)),
        twist=(0, 0.002, 0, 0.02, 0.03, 0.02),
        grapples={"side": side},
    )
    frame = target.at(20.0, "side").pose
    np.testing.assert_allclose(way[-1].tip.homogeneous, frame.homogeneous, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mass = 3", "unknown key 'mass'"),
        ('pose = {xyz = [1, 2, 3]}\nname = "debris"', "a Target needs it"),
        ('body = "none.urdf"', "none.urdf"),
        ("[body]\nmass = 60", "size"),
        ("[body]\nmass = 60\nsize = [1, 1, 1]\n[grapples]\na = {x = 1}", "unknown key 'x'"),
    ],
)
def test_mistakes_of_a_target_are_named(tmp_path, text, words):
    (tmp_path / "debris.toml").write_text(text)
    run = spacearm("catch", "planar2", 0.3, 1.2, "--target", "debris.toml", cwd=tmp_path)
    assert run.returncode == 2
    assert words in run.stderr


def test_the_mode_of_a_catch_is_an_option(tmp_path):
    """One that does not exist is an error of usage."""
    (tmp_path / "debris.toml").write_text(TARGET)
    words = ("catch", "chaser7", *[0] * 7, "--target", "debris.toml", "--window", "1,1")
    run = spacearm(*words, "--mode", "attitude-controlled", cwd=tmp_path)
    assert run.returncode != 0
    assert "earliest contact is after 9 s" in run.stderr
    wrong = spacearm(*words, "--mode", "sideways", cwd=tmp_path)
    assert wrong.returncode == 2
    assert "--mode" in wrong.stderr


def test_frames_of_several_tips_are_given_by_their_names(tmp_path):
    (tmp_path / "debris.toml").write_text(TARGET)
    words = ("catch", "dual_ur5", "--target", "debris.toml", "--grapple")
    run = spacearm(*words, "left=side", "--grapple", "left=side", *[0] * 12, cwd=tmp_path)
    assert run.returncode == 2
    assert "TIP=FRAME once for each tip" in run.stderr


def test_what_the_hand_holds_is_identified_from_a_table(tmp_path):
    """Positions, poses, rates and twists as measured; a missing column is named."""
    arm = sa.load("planar2")
    start = arm.grasp(3.0, 0.4 * np.eye(3), (0.1, 0.2, 0)).at([0.3, 1.2])
    law, coarse = sa.JointPD([1.0, 0.2], kp=5, kd=5), sa.Integration(dt=0.1)
    run = sa.simulate(start, law, 5.0, integration=coarse)
    twist = [sa.base_velocity(cfg, dq) for cfg, dq in zip(run, run.dq, strict=True)]
    heads = "t [s],q joint_1 [rad],q joint_2 [rad],dq joint_1 [rad/s],dq joint_2 [rad/s]"
    heads += "".join(f",base {x} [m]" for x in "xyz") + "".join(f",base q{x} [1]" for x in "xyzw")
    heads += "".join(f",twist v{x} [m/s]" for x in "xyz")
    heads += "".join(f",twist w{x} [rad/s]" for x in "xyz")
    rows = np.column_stack((run.t, run.q, run.dq, run.base, twist))
    np.savetxt(tmp_path / "held.csv", rows, delimiter=",", header=heads, comments="")
    said = spacearm("identify", "planar2", "--motion", "held.csv", "--json", cwd=tmp_path)
    assert said.returncode == 0, said.stderr
    assert json.loads(said.stdout)["held_mass"] == pytest.approx(3.0, rel=1e-5)
    np.savetxt(tmp_path / "bad.csv", rows[:, 1:], delimiter=",", header=heads[6:], comments="")
    bad = spacearm("identify", "planar2", "--motion", "bad.csv", cwd=tmp_path)
    assert bad.returncode == 2
    assert "no column 't [s]'" in bad.stderr
