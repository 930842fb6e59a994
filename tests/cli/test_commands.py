"""Commands for what Python has: nearest, path, capture, risk, convert; exit codes, help."""

import json
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.arms import chosen, joint, link, random_chain
from helpers.commands import answer, spacearm
from helpers.sweeps import STUDY

import spacearm as sa
from spacearm.cli.app import COMMANDS, command
from spacearm.cli.options import table_of
from spacearm.cli.output import SHARE, STEP_LIMIT, TIME_LIMIT, Done, working

MODULES = {f"spacearm.cli.{known.place.rpartition('.')[0]}" for known in COMMANDS.values()}
HOME = ("0", "60", "-100", "-50", "30", "0")


def test_nearest_is_what_query_finds():
    got = answer("nearest", "planar2", "--deg", 30, 40)
    report = answer("query", "planar2", "--deg", 30, 40)
    assert got["distance"] == pytest.approx(report["distance"], abs=1e-9)
    assert got["distance"] - 1.001e-4 <= got["distance_proven"] <= got["distance"]
    assert got["distance_proven"] == report["distance_proven"]
    assert sa.singularity(sa.load("planar2").at(got["nearest"])).kind == "dynamic"
    shown = spacearm("nearest", "planar2", "--deg", 30, 40).stdout
    said = "a singular posture found 31.7° away; none within 31.6°, proven"
    assert shown.startswith(f"planar2, free-floating: {said}")
    assert said in spacearm("query", "planar2", "--deg", 30, 40).stdout


def test_nearest_within_the_limits_is_inside_and_no_nearer():
    free, limited = (answer("nearest", "mda6", "--deg", *HOME, *x) for x in ((), ("--limits",)))
    arm = sa.load("mda6")
    assert limited["distance"] >= free["distance"] - 1e-6
    q = np.array(limited["nearest"])
    assert ((q >= arm.lower - 1e-9) & (q <= arm.upper + 1e-9)).all()
    assert limited["distance_proven"] >= 0.99 * limited["distance"]


def test_path_proves_or_names_the_singular_posture(tmp_path):
    free, through = tmp_path / "free.csv", tmp_path / "through.txt"
    free.write_text("0, 60\n20, 90\n")
    through.write_text("0 60\n0 -60\n")
    run = spacearm("path", "planar2", free, "--deg", "--fail-on-singular")
    assert (run.returncode, "meets no singularity: proven" in run.stdout) == (0, True)
    run = spacearm("path", "planar2", through, "--deg", "--fail-on-singular")
    assert run.returncode == 3
    assert "meets a singularity" in run.stdout
    got = answer("path", "planar2", through, "--deg")
    at = np.array(got["certificate"]["at"])
    assert abs(sa.singularity_polynomial(sa.load("planar2"))(at)) < 1e-9
    assert "Not checked: collisions" in run.stdout


@pytest.mark.slow
def test_path_proves_a_clearance_as_far_as_it_holds(tmp_path):
    path = tmp_path / "path.csv"
    path.write_text("-65 60\n-60 62\n", encoding="utf-8")
    asked = ("path", "planar2", path, "--deg", "--clearance")
    proof = answer(*asked, 5)["certificate"]
    assert proof["free"] is True
    assert proof["clearance"] == pytest.approx(np.radians(5.0))
    assert "no singular posture within 5°: proven" in spacearm(*asked, 5).stdout
    less = answer(*asked, 170)["certificate"]
    assert less["free"] is False
    Q = np.radians([[-65.0, 60.0], [-60.0, 62.0]])
    nearest = min(sa.singular_set(sa.load("planar2")).nearest(q).distance for q in Q)
    assert less["verdict"] == "near"
    assert 0.9 * nearest < less["clearance"] <= nearest
    assert abs(sa.singularity_polynomial(sa.load("planar2"))(np.array(less["at"]))) < 1e-9
    assert (
        "a singular posture is nearer than the clearance asked for" in spacearm(*asked, 170).stdout
    )


UNUSED = {
    "--mode": ("export", "planar2", "--output", "a.urdf", "--mode", "fixed"),
    "--servo": ("export", "planar2", "--output", "a.urdf", "--servo"),
    "--port": ("view", "planar2", "--save", "a.html", "--port", "7499"),
    "--no-open": ("view", "planar2", "--png", "a.png", "--no-open"),
    "--fly": ("view", "planar2", "--save", "a.html", "--fly"),
    "--topic": ("watch", "planar2", "states.jsonl", "--topic", "/joints"),
    "--samples": ("wheels", "planar2", "--motion", "a.npz", "--samples", "9"),
    "--near": ("wheels", "planar2", "--motion", "a.npz", "--near", "0.1"),
    "--seed": ("wheels", "planar2", "--motion", "a.npz", "--seed", "0"),
    "--fix joint_1": ("map", "planar3", "--axes", "q1", "q2", "--fix", "joint_1=0.3"),
    "--path": ("workspace", "mda6", "--path", "a.csv"),
    "--path FILE": ("workspace", "planar2", "--path", "a.csv", "--json"),
    "--dry-run": ("sweep", "study.toml", "--store", "a.zarr", "--status", "--dry-run"),
    "--workers": ("sweep", "study.toml", "--store", "a.zarr", "--status", "--workers", "2"),
}
"""Options that have no effect beside others."""


@pytest.mark.parametrize("option", UNUSED)
def test_an_option_without_an_effect_is_an_error(option, tmp_path):
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    code, _, err = spacearm(*UNUSED[option], cwd=tmp_path)
    named = option.removesuffix(" FILE")
    assert code == 2
    assert f"{named} is given and has no effect here: it works with" in err
    assert [path.name for path in tmp_path.iterdir()] == ["study.toml"]


def test_numbers_of_a_table_are_bounded(tmp_path):
    path = tmp_path / "far.csv"
    path.write_text("0.3,1.2\n0.3,-2e12\n")
    with pytest.raises(sa.ConfigurationError, match=r"line 2: -2e12 is too large"):
        table_of(path, "far.csv")


def test_path_takes_saved_motions_and_refuses_other_files(tmp_path):
    arm = sa.load("planar2")
    sa.plan(arm.at([0.3, 1.2]), sa.Joints([0.4, 1.3])).save(tmp_path / "plan.npz")
    assert answer("path", "planar2", tmp_path / "plan.npz")["certificate"]["free"]
    (tmp_path / "wrong.txt").write_text("1 2 3\n4 5 6\n")
    run = spacearm("path", "planar2", tmp_path / "wrong.txt")
    assert run.returncode == 2
    assert "2 lines of 3 numbers; give two lines or more, each with 2" in run.stderr


def test_capture_conserves_momentum():
    words = ("--mass", 100, "--velocity", 0.01, 0, 0, "--spin", 0, 0, 1, "--inertia", 9, 10, 11)
    got = answer("capture", "mda6", "--deg", *HOME, *words)
    np.testing.assert_allclose(got["momentum"][:3], [1.0, 0.0, 0.0], atol=1e-12)
    assert got["energy_lost"] > 0.0
    twist = (0.01, 0, 0, 0, 0, np.radians(1))
    cfg = sa.load("mda6").at(np.radians([0, 60, -100, -50, 30, 0]))
    same = sa.capture(cfg, twist, 100.0, np.diag([9.0, 10.0, 11.0]))
    np.testing.assert_allclose(got["dq"], same.dq, atol=1e-12)
    assert "°/s" in spacearm("capture", "mda6", "--deg", *HOME, *words).stdout


def test_risk_is_the_profile(tmp_path):
    words = ("risk", "planar2", "--bins", 4, "--samples", 2000)
    got = answer(*words)
    profile = sa.risk_profile(sa.load("planar2"), bins=4, samples=2000)
    np.testing.assert_array_equal(got["share"], profile.share)
    run = spacearm(*words, cwd=tmp_path)
    assert "share of 2,000 postures within 5° of a singular posture" in run.stdout
    assert (tmp_path / "planar2_risk.png").is_file()


def test_convert_writes_what_loads_to_the_same_arm(tmp_path):
    run = spacearm("convert", "mda6", "-o", tmp_path / "x.urdf")
    assert run.returncode == 0, run.stderr
    q = np.full(6, 0.3)
    J = [sa.generalized_jacobian(sa.load(m).at(q)) for m in ("mda6", tmp_path / "x.urdf")]
    np.testing.assert_allclose(*J, atol=1e-12)


def test_convert_makes_wheels_of_joints_which_every_command_then_knows(tmp_path):
    disc = link("disc", 3.0, inertia=np.diag([0.01, 0.01, 0.02]))
    limit = '<limit effort="0.2" velocity="300"/>'
    spin = joint("spin", "bus", "disc", "continuous", axis=(0, 0, 1), inside=limit)
    text = random_chain(chosen(1), 3).replace("</robot>", f"{disc}{spin}</robot>")
    (tmp_path / "a.urdf").write_text(text, encoding="utf-8")
    assert "--wheel JOINT" in spacearm("info", tmp_path / "a.urdf").stdout
    run = spacearm("convert", tmp_path / "a.urdf", "--wheel", "spin", "-o", tmp_path / "b.urdf")
    assert run.returncode == 0, run.stderr
    told = json.loads(spacearm("info", tmp_path / "b.urdf", "--json").stdout)["wheel_data"]
    assert [(w["name"], w["torque"], w["capacity"]) for w in told] == [("spin", 0.2, 6.0)]
    wrong = spacearm("convert", "planar2", "--wheel", "no", "-o", tmp_path / "c.urdf")
    assert wrong.returncode == 2
    assert "'no'" in wrong.stderr
    assert not (tmp_path / "c.urdf").exists()


WRITING = sorted(
    (name, option.opts[0], option.metavar)
    for name in COMMANDS
    for option in command(name).params
    if re.search(r"\bwrite\b|picture", option.help or "", re.IGNORECASE)
    and "PATH" in str(option.type).upper()
)


@pytest.mark.parametrize(("name", "option", "kinds"), WRITING)
def test_files_to_write_are_tested_before_anything_is_read(name, option, kinds, tmp_path):
    """The model does not exist, either: what is said first is what was tested first."""
    for kind in kinds.lower().split("|"):
        run = spacearm(name, "no_such_model", option, tmp_path / "none" / f"file.{kind}")
        assert run.returncode == 2
        why = "cannot be written: No such file or directory; name a file in a folder"
        assert f"file.{kind} {why}" in run.stderr
    run = spacearm(name, "no_such_model", option, tmp_path / "file.odd")
    assert run.returncode == 2
    assert "file.odd: " in run.stderr  # such a suffix is none of its kinds
    assert f".{kind}" in run.stderr


def test_all_options_that_write_are_known():
    known = {name for name, *_ in WRITING}
    assert known >= {"box", "convert", "map", "plan", "report", "view"}


def test_exit_codes_for_scripts():
    singular = ("query", "planar2", "--deg", -65, -11.41)
    assert spacearm(*singular).returncode == 0
    assert spacearm(*singular, "--fail-on-singular").returncode == 3
    assert spacearm("query", "planar2", "--deg", 30, 40, "--fail-on-singular").returncode == 0


@pytest.mark.parametrize("name", COMMANDS)
def test_short_help(name):
    run = spacearm(name, "-h")
    assert run.returncode == 0
    assert run.stdout == spacearm(name, "--help").stdout


#: Half of the options of the largest command describe the robot and are shared by all.
MOST_OPTIONS = 22


def test_no_command_has_too_many_options():
    for name in COMMANDS:
        options = {tuple(p.opts) for p in command(name).params if p.param_type_name == "option"}
        assert len(options) <= MOST_OPTIONS, name


def test_each_command_says_what_it_is_for():
    assert len({known.summary for known in COMMANDS.values()}) == len(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_summary_of_a_command_is_what_its_own_help_begins_with(name):
    summary = COMMANDS[name].summary
    assert " ".join(command(name).help.partition("\n\n")[0].split()) == summary
    assert len(summary) <= 64  # more is cut off in the list of 80 columns


def test_every_option_says_what_it_means():
    for name in COMMANDS:
        assert all(p.help for p in command(name).params), name


WITHOUT_DOCSTRINGS = {
    "one": [
        ["--help"],
        ["query", "--help"],
        ["simulate", "planar2", "0", "1", "--target", "1 1", "--with", "integration.rtol=a"],
    ],
    "all": [
        *([name, "--help"] for name in COMMANDS),
        ["query", "planar2", "0.3", "0.4", "--json"],
        ["nearest", "planar2", "0.3", "0.4"],
        ["query", "planar2", "--tolerance", "a"],
        ["box", "planar2", "--limits"],
        ["plan", "planar2", "0", "1", "--goal", "1 1", "--with", "duration=[1]"],
    ],
}
"""Command lines whose answer must not depend on docstrings."""


@pytest.mark.parametrize("cases", ["one", pytest.param("all", marks=pytest.mark.slow)])
def test_without_docstrings_the_command_line_is_the_same(cases):
    """PYTHONOPTIMIZE=2 drops docstrings and assertions, and changes no option, help or answer."""
    lines = WITHOUT_DOCSTRINGS[cases]
    code = "import json, sys; from helpers.commands import spacearm; "
    code += "print(json.dumps([spacearm(*words) for words in json.loads(sys.argv[1])]))"
    run = subprocess.run(
        [sys.executable, "-OO", "-c", code, json.dumps(lines)],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
    )
    for words, got in zip(lines, json.loads(run.stdout), strict=True):
        assert got == list(spacearm(*words)), words


def test_the_help_of_all_commands_imports_none_of_them():
    code = "import sys; from spacearm.cli.app import main; sys.argv[1:] = ['--help']; "
    code += "sys.exit = lambda _: print(*sys.modules); main()"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert all(f"\n  {name} " in run.stdout for name in COMMANDS)
    assert not {"numpy", "pinocchio", "rich", *MODULES} & set(run.stdout.splitlines()[-1].split())


@pytest.mark.slow
def test_the_shell_completes_commands_and_options():
    cases = (
        ("spacearm ne", 1, "nearest"),
        ("spacearm plan --g", 2, "--goal"),
        ("spacearm query mda", 2, "mda6"),
    )
    for words, number, expected in cases:
        env = os.environ | {
            "_SPACEARM_COMPLETE": "complete_bash",
            "COMP_WORDS": words,
            "COMP_CWORD": str(number),
        }
        command = [sys.executable, "-m", "spacearm"]
        run = subprocess.run(command, capture_output=True, text=True, env=env, check=False)
        assert run.stdout.split() == [expected], run.stderr


def test_joints_outside_their_limits_stand_in_the_headline_and_in_json():
    words = ("query", "mda6", 0, 60, -100, -50, 0, 0)
    first = spacearm(*words).stdout.splitlines()[0]
    assert first.endswith("outside its limits: joint_2, joint_3, joint_4")
    assert answer(*words)["configuration"]["outside_limits"] == ["joint_2", "joint_3", "joint_4"]
    inside = ("query", "mda6", "--deg", *HOME)
    assert "outside" not in spacearm(*inside).stdout
    assert answer(*inside)["configuration"]["outside_limits"] == []


@pytest.mark.slow
def test_the_plane_has_areas_and_the_free_workspace_is_not_computed_unasked(tmp_path, monkeypatch):
    flat = answer("workspace", "planar2")
    assert flat["areas"]["reachable"] == pytest.approx(np.pi * flat["reachable"][0][1] ** 2)
    assert "volumes" not in flat
    shown = spacearm("workspace", "planar2", cwd=tmp_path).stdout
    assert "area [m²]" in shown
    assert "volume" not in shown
    assert "\nfree" not in shown
    free = answer("workspace", "planar2", "--free")["free"]
    np.testing.assert_allclose(free, sa.workspace(sa.load("planar2")).free, atol=1e-12)

    def refuse(*_):
        raise AssertionError("computed unasked")

    monkeypatch.setattr("spacearm.workspaces.path_dependent.free_workspace", refuse)
    assert "free" not in answer("workspace", "planar2")


def test_what_takes_long_says_so_on_stderr(capsys, monkeypatch):
    monkeypatch.setattr("spacearm.cli.output.FIRST", 0.01)
    monkeypatch.setattr("spacearm.cli.output.EVERY", 0.01)
    import time

    with working("digging") as progress:
        time.sleep(0.1)
        progress(1.0, 4.0)
        time.sleep(0.2)
    lines = capsys.readouterr().err.splitlines()
    assert re.match(r"spacearm: digging: \d+ s so far", lines[0])
    assert re.search(r"digging: 25 %, \d+ s so far$", lines[-1])
    forms = {TIME_LIMIT: "time limit 60 s", STEP_LIMIT: "10 of at most 60 steps"}
    for form, said in forms.items():
        with working("digging", form=form) as progress:
            progress(10.0, 60.0)
            time.sleep(0.1)
        assert f": {said}, 0 s so far" in capsys.readouterr().err.splitlines()[-1]


def test_work_that_goes_on_is_never_at_100_percent():
    said = [Done(SHARE).text(SimpleNamespace(completed=x, total=3.0)) for x in (0.0, 1.0, 3.0)]
    assert said == ["0 %", "33 %", "99 %"]


@pytest.mark.parametrize(
    "words",
    [
        ("query", "planar2", 0.3, 1.2),
        ("query", "dual_ur5", "--tip", "left", "--mode", "fixed", *[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]),
        ("nearest", "planar2", 0.3, 1.2),
        ("nearest", "planar2", 0.3, 1.2, "--limits"),
        ("path", "planar2", "ways.csv"),
        ("reaction", "planar2", "--motion", "run.npz", "--json"),
        ("wheels", "planar2", "--motion", "run.npz", "--motion", "run.npz", "--json"),
        ("wheels", "planar2", "--tip-speed", 0.1, "--samples", 30, "--json"),
    ],
    ids=lambda words: " ".join(map(str, words[:3])),
)
def test_commands_tell_how_far_they_are(words, tmp_path, monkeypatch):
    """What is done grows, and what there is to do stays the same."""
    from spacearm.cli.output import Progress

    told = []

    def update(*_, completed, total):
        told.append((completed, total))

    monkeypatch.setattr(Progress, "update", update)
    rows = np.linspace((0.3, 0.9), (0.9, 1.0), 30)
    (tmp_path / "ways.csv").write_text("0.3 0.9\n1.9 2.7\n1.0 0.9\n")
    still = np.tile(np.eye(7)[6], (30, 1))
    sa.Motion(sa.load("planar2"), np.arange(30.0), rows, still).save(tmp_path / "run.npz")
    run = spacearm(*words, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    done = [share for share, _ in told]
    assert len({total for _, total in told}) == 1
    assert 0 < done[-1] <= told[0][1]
    assert done == sorted(done)


def test_ctrl_c_in_a_plan_keeps_the_best_attempt(monkeypatch):
    import spacearm.planning.methods as methods

    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setitem(methods.METHODS, "straight", interrupted)
    with pytest.raises(sa.StoppedError, match="straight: stopped by Ctrl-C") as caught:
        sa.plan(sa.load("planar2").at([0.3, 1.2]), (0.9, 1.4))
    assert isinstance(caught.value.best, sa.Plan)
    assert len(caught.value.best.tried) == 1


def test_json_is_strict_for_the_new_commands():
    for words in (("nearest", "planar2", 0.1, 0.2), ("capture", "planar2", 0, 1, "--mass", 5)):
        json.loads(spacearm(*words, "--json").stdout)


def test_names_of_models_and_of_arms_are_completed():
    from spacearm.cli.options import complete_model

    assert [name for name, _ in complete_model("planar")] == ["planar2", "planar3"]
    assert {info.name for info in (*sa.catalogue(), *sa.arms())} == dict(complete_model("")).keys()
    assert complete_model("folder/robot.urdf") == []


def test_attitudes_and_wheels_have_their_units(tmp_path):
    path = ("--corner", 1.2, 0.6, "--corner", 1.0, 0.9, "--samples", 16, "--output", "a.svg")
    for options, unit in (((), "rad"), (("--deg",), "°")):
        shown = spacearm("attitudes", "planar2", *path, *options, cwd=tmp_path).stdout
        assert "path of 0.3606 m" in shown
        assert re.search(rf"joint_2 +-?[\d.]+ ?{unit}", shown)
    words = ("--tip-speed", 0.1, "--samples", 30, "--output", "w.svg")
    shown = spacearm("wheels", "planar2", *words, cwd=tmp_path).stdout
    assert "about x [N m s]  about y [N m s]" in shown


def test_the_spin_of_a_point_mass_is_told_to_count_for_nothing():
    run = spacearm("capture", "planar2", 0.3, 1.2, "--mass", 5, "--spin", 0, 0, 1)
    assert "a point mass does not spin; --inertia gives" in run.stderr
    run = spacearm(
        "capture", "planar2", 0.3, 1.2, "--mass", 5, "--spin", 0, 0, 1, "--inertia", 1, 1, 1
    )
    assert run.stderr == ""
    assert "0 J lost" not in run.stdout


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (("plan", "planar2", 4, 0, "--goal", 1, 1), "--with constraints.limits=false ignores"),
        (
            ("plan", "planar2", 0.3, 1.2, "--goal", 9, 9, "--with", "search.timeout=1"),
            "spacearm workspace shows",
        ),
    ],
)
def test_remedies_are_options_of_the_command_line(words, remedy, tmp_path):
    said = spacearm(*words, cwd=tmp_path).stderr
    assert remedy in said
    assert not re.search(r"\w+=(False|True|\{)|\bsa\.|7 rows", said)
