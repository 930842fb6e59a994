"""The command `spacearm simulate`, from outside."""

import errno
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.commands import spacearm

import spacearm as sa
from spacearm.cli.app import main
from spacearm.cli.output import save_phases
from spacearm.cli.wording import join_numbers
from spacearm.sweeps.motion_tables import read_phases
from spacearm.sweeps.toml import parse

FIGURE_5 = ["planar2", "--deg", -57.936, 60.337, "--attitude", 0, 0, 21]
FIGURE_5 += ["--target", 1.5, 1.5, "--with", "origin=cm"]


def run(*words, cwd):
    return spacearm("simulate", *words, cwd=cwd)


@pytest.mark.slow
def test_figures_5_and_6(tmp_path):
    done = run(*FIGURE_5, "--duration", 200, "--save", "run.npz", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "singularity  4.8894" in done.stdout
    assert "(1.3944, 1.2554, 0) m" in done.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["planar2_simulation.png", "run.npz"]
    kept = sa.Trajectory.load(tmp_path / "run.npz", sa.load("planar2"))
    np.testing.assert_allclose(kept.tip[0, :2], (2, 0), atol=1e-4)
    figure = sa.plot(kept, target=(1.5, 1.5))
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == [
        "y [m]",
        "attitude\n[deg]",
        "joints\n[deg]",
        "to a singular\nposture found [deg]",
    ]
    names = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert names[:3] == ["tip", "start", "end"]
    assert names[3].startswith("singular (")
    assert names[4] == "target"


@pytest.mark.parametrize(
    ("command", "words"), [("follow", "--path path.csv"), ("simulate", "--target 1.2,0.9")]
)
def test_the_mode_is_an_option_that_wins(command, words, tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr(sa, command, lambda *_, **options: given.append(options) or sys.exit())
    monkeypatch.chdir(tmp_path)
    (tmp_path / "path.csv").write_text("1.2,0.9\n")
    words = f"spacearm {command} planar2 0.3 0.8 {words}"
    for more in ("", "--with mode=fixed", "--mode fixed", "--mode fixed --with mode=free-floating"):
        monkeypatch.setattr(sys, "argv", f"{words} {more}".split())
        with pytest.raises(SystemExit):
            main()
    assert [options.get("mode") for options in given] == [None, "fixed", "fixed", "fixed"]


@pytest.mark.parametrize(
    ("command", "message"), [("plan", "mode 'fixed'"), ("detumble", "'--mode' is not an option")]
)
def test_the_mode_of_plans(command, message, capsys, monkeypatch):
    """Wheels of a detumbling motion hold at its end: it has no mode."""
    words = f"spacearm {command} planar2 0.3 0.8 --goal 1.2,0.9 --mode fixed"
    monkeypatch.setattr(sys, "argv", words.split())
    with pytest.raises(SystemExit):
        main()
    assert message in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        "planar2 0.3 0.8 --target 1.2 0.9 --controller ResolvedRate",
        "planar2 0.3 0.8 --target 1.2 0.9 --controller DampedLeastSquares",
        "planar3 0.3 0.8 -0.5 --target 1.2 0.9 1.0 --with controller.kp=[5,5,2]",
        "planar3 0.3 0.8 -0.5 --target 1.2,0.9 --controller Reactionless --task x,y",
        "chaser7 0 1 0 1 0 1 0 --target 0 .9 0 .8 0 .7 0 --controller JointPD",
        "planar2 0.3 0.8 --target 1.2 0.9 --with controller.mode=fixed --with mode=fixed",
        "planar2 0.3 0.8 --target 1.2 --task x --controller DampedLeastSquares",
    ],
)
def test_every_law_as_json(tmp_path, words):
    done = run(*words.split(), "--duration", 2, "--json", "--output", "motion.svg", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    data = json.loads(done.stdout)
    assert data["ended"] == "duration"
    assert data["t"][-1] == 2.0
    assert data["imbalance"] < 1e-4
    assert (tmp_path / "motion.svg").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("0.1", "--target", "1", "1"), "1 joint value given"),
        (("0.1", "x", "--target", "1", "1"), "'x' is not a number"),
        (("0.1", "0.2", "--target", "1"), "takes 2: x y"),
        (("0.1", "0.2", "--target", "9", "9"), "spacearm workspace"),
        (("0.1", "0.2", "--target", "1", "1", "--with", "controller.kp=NaN"), "kp"),
        (("0.1", "0.2", "--target", "1", "1", "--with", "controller.kp=[1,2,3]"), "kp"),
        (("0.1", "0.2", "--target", "1", "1", "--with", "stop=crash"), "'crash'"),
        (("0.1", "0.2", "--target", "1", "1", "--output", "a.gif"), "'.gif'"),
        (("--target", "1", "1"), "0 joint values given"),
        (("0.1", "0.2"), "there is no target"),
        (("0.1", "0.2", "--with", "no.toml"), "no.toml cannot be read"),
        (("0.1", "0.2", "--target", "1", "1", "--with", "phases=[{}]"), "phases and --target"),
        (("0.1", "0.2", "--target", "1", "1", "--with", "plan.limits=1"), "unknown key 'plan'"),
        (("0.1", "0.2", "--target", "1", "1", "--with", "dq=[1]"), "dq"),
    ],
)
def test_bad_input(tmp_path, words, message):
    done = run("planar2", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


FLIGHT = """
[[phases]]
duration = 4
controller = {law = "JointPD", target = [0.5, 0.6], kp = 4, kd = 8}
integration.dt = 0.1
then.grasp = {mass = 3.0, twist = [0.05, -0.08, 0, 0, 0, 0.3]}

[[phases]]
duration = 3
controller = {law = "TransposedJacobian", target = [1.2, 0.9], kp = [5, 5], kd = 15}
sampling.period = 0.1
integration.dt = 0.1
then = "release"
[phases.plant]
wrenches.spacecraft = {times = [0, 1], values = [[0, 2, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]]}
passive.q1 = {damping = 0.5}

[[phases]]
duration = 1
controller = {law = "DampedLeastSquares", target = [1.2, 0.9], damping = 0.2}
integration.dt = 0.1
"""


@pytest.mark.slow
def test_phases_from_a_file_keep_the_momentum(tmp_path):
    pytest.importorskip("tomllib")
    (tmp_path / "flight.toml").write_text(FLIGHT, encoding="utf-8")
    words = ("planar2", 0.3, 0.9, "--with", "dq=[0.1, 0]", "--with", "flight.toml")
    done = run(*words, "--save", "run.npz", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "grasp" in done.stdout
    assert "release  7.0000" in done.stdout
    arm = sa.load("planar2")
    first, _, last = (sa.Motion.load(tmp_path / f"run_{i}.npz", arm) for i in range(3))
    np.testing.assert_allclose(first.dq[0], [0.1, 0.0], atol=1e-9)
    assert last.arm.n == 2
    data = json.loads(run(*words, "--json", cwd=tmp_path).stdout)
    assert data["begins"] == [0.0, 4.0, 7.0]
    before, held, after = (np.array(phase["momentum"]) for phase in data["phases"])
    brought = 3.0 * np.array([0.05, -0.08])
    np.testing.assert_allclose(held[0, :2] - before[-1, :2], brought, atol=1e-9)
    np.testing.assert_allclose(held[-1, :2] - held[0, :2], [0.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(after[-1], after[0], atol=1e-9)


def test_the_files_of_phases_are_all_new_or_all_as_they_were(tmp_path, monkeypatch):
    motion = sa.Motion(sa.load("planar2"), [0.0, 1.0], np.zeros((2, 2)), np.eye(7)[[6, 6]])
    flight = SimpleNamespace(phases=[motion, motion, motion])
    old = {tmp_path / f"run_{i}.npz": b"old" for i in range(2)}
    for path, content in old.items():
        path.write_bytes(content)
    replace, made = Path.replace, []

    def replace_two(*paths):
        made.append(paths)
        if len(made) == 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        return replace(*paths)

    monkeypatch.setattr(Path, "replace", replace_two)
    with pytest.raises(sa.SpaceArmError, match=r"run_2.npz cannot be written: No space left"):
        save_phases(flight, tmp_path / "run.npz")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == old
    assert len(save_phases(flight, tmp_path / "run.npz")) == 3
    for path in tmp_path.iterdir():
        np.testing.assert_array_equal(sa.Motion.load(path, motion.arm).t, motion.t)


@pytest.mark.slow
def test_phases_are_played(monkeypatch, tmp_path):
    pytest.importorskip("tomllib")
    shown = []
    monkeypatch.setattr("spacearm.cli.output.serve_until_interrupted", shown.append)
    text = PD + "then.grasp = {mass = 1.0}\n" + PD.replace("duration = 1", "duration = 0.1")
    (tmp_path / "flight.toml").write_text(text, encoding="utf-8")
    done = run("planar2", 0.3, 0.9, "--with", "flight.toml", "--view", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "grasp" in done.stdout
    assert shown[0].about()["motion"]["span"] == pytest.approx([0.0, 1.1])


PD = """
[[phases]]
duration = 1
controller = {law = "JointPD", target = [0.3, 0.9], kp = 1, kd = 1}
"""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("phases = []", "give one or more tables [[phases]]"),
        ("phases = 3", "give one or more tables [[phases]]"),
        ("[[phases]]\nduration = 1\nspeed = 2", "unknown key 'speed'"),
        (
            "[[phases]]\nduration = 1\ncontroller = {law = 'pd', target = [1, 1]}",
            "unknown law 'pd'",
        ),
        (
            "[[phases]]\nduration = 1\ncontroller = {law = 'JointPD', target = [1, 1], gain = 1}",
            "unknown key 'gain'",
        ),
        ("[[phases]]\ncontroller = {target = [1, 1]}", "law is 'missing'"),
        (PD.replace("duration = 1", ""), "duration is 'missing'"),
        ("phases = [", "flight.toml is not TOML"),
        (PD + "plant.wheels = {stiffness = 1}", "damping is 'missing'"),
        (PD + "plant.wheels = 3", "make it a table"),
        (PD + "then = 'go'", '"release"'),
        (PD + "then = {grasp = {inertia = 1}}", "mass is 'missing'"),
        (PD + "plant.wrenches.spacecraft = {times = [0], values = [[1, 2]]}", "6 numbers"),
        (PD + "plant.wrenches.spacecraft = {times = [1, 0], values = [[1], [2]]}", "increasing"),
    ],
)
def test_a_bad_file_of_phases_is_refused(tmp_path, text, message):
    pytest.importorskip("tomllib")
    (tmp_path / "flight.toml").write_text(text, encoding="utf-8")
    done = run("planar2", 0.3, 0.9, "--with", "flight.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


def test_each_of_two_tips_may_have_a_law():
    pytest.importorskip("tomllib")
    law = "{law = 'JointPD', kp = 20, kd = 30, target = [" + "0.1," * 12 + "]}"
    arm = sa.load("dual_ur5", tip=("left", "right"))
    text = f"[[phases]]\nduration = 2\ncontroller = {{left = {law}, right = {law}}}"
    phase = read_phases(parse(text), arm)[0]
    assert isinstance(phase.controller, dict)
    assert set(phase.controller) == {"left", "right"}


def test_the_last_of_what_is_given_counts(tmp_path):
    pytest.importorskip("tomllib")
    (tmp_path / "run.toml").write_text(
        "duration = 3\n[controller]\nlaw = 'JointPD'\ntarget = [0.5, 1.0]\n"
        "[start]\nq = [0.3, 1.2]\n[integration]\nrtol = 1e-6\n",
        encoding="utf-8",
    )
    more = ("--with", "run.toml", "--with", "integration.dt=0.5", "--duration", 2, "--json")
    data = json.loads(run("planar2", *more, cwd=tmp_path).stdout)
    assert data["t"] == [0.0, 0.5, 1.0, 1.5, 2.0]
    law, how = sa.JointPD(target=[0.5, 1.0], kp=5, kd=15), sa.Integration(rtol=1e-6, dt=0.5)
    start = sa.load("planar2").at([0.3, 1.2])
    assert data["q"] == sa.simulate(start, law, 2.0, integration=how).q.tolist()


def test_numbers_after_an_option_belong_to_it():
    words = [
        "simulate",
        "planar2",
        "--corner",
        "-5.2",
        "1e-3",
        "--deg",
        "--target",
        "1",
        "--tip",
        "2",
    ]
    assert join_numbers(words) == [
        "simulate", "planar2", "--corner", "-5.2 1e-3", "--deg", "--target", "1", "--tip", "2"
    ]  # fmt: skip


def test_a_name_that_cannot_be_saved_is_refused_before_the_work(tmp_path):
    done = run(*FIGURE_5, "--duration", 1e6, "--save", "run.csv", cwd=tmp_path)
    assert done.returncode == 2
    assert "saved whole as .npz" in done.stderr


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A folder with a plan of planar2 in a file."""
    folder = tmp_path_factory.mktemp("planned")
    sa.plan(sa.load("planar2").at([0.3, 1.2]), (0.9, 1.4)).save(folder / "plan.npz")
    return folder


@pytest.mark.slow
def test_a_saved_plan_is_tracked_and_other_laws_go_to_its_end(planned):
    plan = sa.Plan.load(planned / "plan.npz", sa.load("planar2"))
    words = ["planar2", "--motion", "plan.npz", "--save", "run.npz", "--json"]
    for law, lasts in ((None, plan.t[-1]), ("JointPD", 90.0), ("TransposedJacobian", 90.0)):
        more = [] if law is None else ["--controller", law, "--duration", lasts]
        done = run(*words, *more, cwd=planned)
        assert done.returncode == 0, done.stderr
        kept = sa.Trajectory.load(planned / "run.npz", plan.arm)
        assert kept.t[-1] == pytest.approx(lasts)
        np.testing.assert_array_equal(kept.q[0], plan.q[0])
        if law == "JointPD":  # another base motion on the way: the same joints, another tip
            np.testing.assert_allclose(kept.q[-1], plan.q[-1], atol=2e-3)
        else:
            np.testing.assert_allclose(kept.tip[-1, :3], plan.tip[-1, :3], atol=2e-3)
        if law is None:
            middle = kept.at(0.5 * plan.t[-1])
            np.testing.assert_allclose(middle.q, plan.at(0.5 * plan.t[-1]).q, atol=1e-4)
    both = run(*words, "--target", "1,1", cwd=planned)
    assert both.returncode == 2
    assert "--target" in both.stderr
    assert "--motion" in both.stderr


@pytest.mark.slow
def test_robots_and_motions_are_exported_by_the_suffix(planned):
    arm = sa.load("planar2")
    for name in ("arm.urdf", "arm.xml", "arm.sdf"):
        done = spacearm("export", "planar2", "-o", name, cwd=planned)
        assert done.returncode == 0, done.stderr
        again = sa.load(planned / name, tip=arm.tips[0], task="x y")
        J = sa.generalized_jacobian(again.at([0.3, 1.2]))
        np.testing.assert_allclose(J, sa.generalized_jacobian(arm.at([0.3, 1.2])), atol=1e-9)
    code = spacearm("export", "planar2", "--c-code", "code", cwd=planned)
    assert code.returncode == 0, code.stderr
    assert sorted(path.name for path in (planned / "code").iterdir()) == ["planar2.c", "planar2.h"]
    way = spacearm("export", "planar2", "--motion", "plan.npz", "-o", "way.csv", cwd=planned)
    assert way.returncode == 0, way.stderr
    assert (planned / "way.csv").is_file()
    wrong = spacearm("export", "planar2", "-o", "arm.csv", cwd=planned)
    assert wrong.returncode == 2
    assert ".csv" in wrong.stderr


@pytest.mark.slow
def test_an_exported_zarr_store_replaces_an_older_one_and_no_other_folder(planned):
    pytest.importorskip("zarr")
    (planned / "notes.zarr").mkdir()
    for name, code in (("way.zarr", 0), ("way.zarr", 0), ("notes.zarr", 2)):
        done = spacearm("export", "planar2", "--motion", "plan.npz", "-o", name, cwd=planned)
        assert done.returncode == code, done.stderr


@pytest.mark.parametrize(
    "words", [("--c-code", "code", "--motion", "plan.npz"), ("-o", "arm.xml", "--servo")]
)
def test_options_that_an_export_would_pass_over_are_refused(words, tmp_path):
    done = spacearm("export", "planar2", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert "--c-code" in done.stderr
    assert not [*tmp_path.iterdir()]
