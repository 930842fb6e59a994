"""The command `spacearm simulate`, from outside."""

import json

import numpy as np
import pytest
from helpers.commands import spacearm
from spacearm.cli.motions.flights import fly, read_phases

import spacearm as sa
from spacearm.cli.wording import join_numbers

FIGURE_5 = ["planar2", "--deg", "--q0", -57.936, 60.337, "--attitude", 0, 0, 21]
FIGURE_5 += ["--target", 1.5, 1.5, "--origin", "cm"]


def run(*words, cwd):
    return spacearm("simulate", *words, cwd=cwd)


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
    assert labels == ["y [m]", "attitude\n[deg]", "joints\n[deg]", "to a singular\nposture [deg]"]
    names = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert names[:3] == ["tip", "start", "end"]
    assert names[3].startswith("singular (")
    assert names[4] == "target"


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        "planar2 --q0 0.3 0.8 --target 1.2 0.9 --controller resolved",
        "planar2 --q0 0.3 0.8 --target 1.2 0.9 --controller damped",
        "planar3 --q0 0.3 0.8 -0.5 --target 1.2 0.9 1.0 --kp 5 5 2 --kd 10 10 4",
        "planar3 --q0 0.3 0.8 -0.5 --target 1.2,0.9 --controller reactionless --task x,y",
        "chaser7 --q0 0 1 0 1 0 1 0 --target 0 .9 0 .8 0 .7 0 --controller joints",
        "planar2 --q0 0.3 0.8 --target 1.2 0.9 --earthbound --mode attitude-controlled",
        "planar2 --q0 0.3 0.8 --target 1.2 --task x --controller damped",
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
        (("--q0", "0.1", "--target", "1", "1"), "1 joint values given"),
        (("--q0", "0.1 x", "--target", "1", "1"), "'x' is no number"),
        (("--q0", "0.1", "0.2", "--target", "1"), "takes 2: x y"),
        (("--q0", "0.1", "0.2", "--target", "9", "9"), "spacearm workspace"),
        (("--q0", "0.1", "0.2", "--target", "1", "1", "--kp", "nan"), "--kp is 'nan'"),
        (("--q0", "0.1", "0.2", "--target", "1", "1", "--kp", "1 2 3"), "kp"),
        (("--q0", "0.1", "0.2", "--target", "1", "1", "--stop", "crash"), "'crash'"),
        (("--q0", "0.1", "0.2", "--target", "1", "1", "--output", "a.gif"), "'.gif'"),
        (("--target", "1", "1"), "--q0"),
        (("--q0", "0.1", "0.2"), "neither --target nor --phases"),
        (("--q0", "0.1", "0.2", "--phases", "no.toml"), "no.toml cannot be read"),
        (("--q0", "0.1", "0.2", "--phases", "no.toml", "--dt", "1"), "--phases and --dt"),
        (("--q0", "0.1", "0.2", "--target", "1", "1", "--dq0", "1"), "1 joint values given"),
    ],
)
def test_bad_input(tmp_path, words, message):
    done = run("planar2", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


FLIGHT = """
[[phase]]
law = "joints"
target = [0.5, 0.6]
kp = 4
kd = 8
duration = 4
dt = 0.1
grasp = {mass = 3.0, twist = [0.05, -0.08, 0, 0, 0, 0.3]}

[[phase]]
target = [1.2, 0.9]
kp = [5, 5]
kd = 15
duration = 3
period = 0.1
dt = 0.1
wrenches.spacecraft = {times = [0, 1], values = [[0, 2, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]]}
passive.q1 = {damping = 0.5}
release = true

[[phase]]
law = "damped"
target = [1.2, 0.9]
damping = 0.2
duration = 1
dt = 0.1
"""


@pytest.mark.slow
def test_phases_from_a_file_keep_the_momentum(tmp_path):
    pytest.importorskip("tomllib")
    (tmp_path / "flight.toml").write_text(FLIGHT, encoding="utf-8")
    words = ("planar2", "--q0", 0.3, 0.9, "--dq0", 0.1, 0, "--phases", "flight.toml")
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


def test_phases_are_played(monkeypatch, capsys):
    shown = []
    monkeypatch.setattr("spacearm.cli.views.serve_until_interrupted", shown.append)
    arm, law = sa.load("planar2"), sa.JointPD(target=[0.3, 0.9], kp=1.0, kd=1.0)
    phases = [sa.Phase(law, 0.2, sa.Grasp(mass=1.0)), sa.Phase(law, 0.1)]
    rest = (None, None, None)  # rates, files
    assert fly(arm.at([0.3, 0.9]), phases, *rest, view=True, as_json=False) == 0
    assert "grasp" in capsys.readouterr().out
    assert shown[0].about()["motion"]["span"] == pytest.approx([0.0, 0.3])


PD = "[[phase]]\nduration = 1\nlaw = 'joints'\ntarget = [0.3, 0.9]\nkp = 1\nkd = 1\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "give one or more tables [[phase]]"),
        ("[[phase]]\nduration = 1\nspeed = 2", "unknown key 'speed'"),
        ("[[phase]]\nduration = 1\nlaw = 'pd'\ntarget = [1, 1]", "unknown law 'pd'"),
        ("[[phase]]\nduration = 1\nlaw = 'joints'\ntarget = [1, 1]", "joints needs kp and kd"),
        ("[[phase]]\nduration = 1\ntarget = [1, 1]\ngain = 1", "transposed takes kp, kd"),
        ("[[phase]]\ntarget = [1, 1]\nkp = 1\nkd = 1", "duration is 'missing'"),
        ("phase = [", "flight.toml is not TOML"),
        (PD + "wheels = {stiffness = 1}", "damping is 'missing'"),
        (PD + "tips = {}", "leave it out"),
        ("[[phase]]\nduration = 1\ntips = {}", "a table for each tip"),
        (PD + "earthbound = true", "joints sees no Jacobian"),
        (PD + "grasp = {mass = 1}\nrelease = true", "add a phase"),
        (PD + "wrenches.spacecraft = {times = [0], values = [[1, 2]]}", "give 6 numbers each"),
        (PD + "wrenches.spacecraft = {times = [1, 0], values = [[1], [2]]}", "growing times"),
    ],
)
def test_a_bad_file_of_phases_is_refused(tmp_path, text, message):
    pytest.importorskip("tomllib")
    (tmp_path / "flight.toml").write_text(text, encoding="utf-8")
    with pytest.raises(sa.ConfigurationError) as refused:
        read_phases(tmp_path / "flight.toml", sa.load("planar2"))
    assert message in str(refused.value)


def test_each_of_two_tips_may_have_a_law(tmp_path):
    pytest.importorskip("tomllib")
    laws = "law = 'joints'\nkp = 20\nkd = 30\ntarget = [" + "0.1," * 12 + "]\n"
    text = f"[[phase]]\nduration = 2\n[phase.tips.left]\n{laws}[phase.tips.right]\n{laws}"
    (tmp_path / "flight.toml").write_text(text, encoding="utf-8")
    arm = sa.load("dual_ur5", tip=("left", "right"))
    phase = read_phases(tmp_path / "flight.toml", arm)[0]
    assert isinstance(phase.controller, dict)
    assert set(phase.controller) == {"left", "right"}


def test_numbers_after_an_option_belong_to_it():
    words = [
        "simulate",
        "planar2",
        "--q0",
        "-5.2",
        "1e-3",
        "--deg",
        "--target",
        "1",
        "--tip",
        "2",
    ]
    assert join_numbers(words) == [
        "simulate", "planar2", "--q0", "-5.2 1e-3", "--deg", "--target", "1", "--tip", "2"
    ]  # fmt: skip


def test_a_name_that_cannot_be_saved_is_refused_before_the_work(tmp_path):
    done = run(*FIGURE_5, "--duration", 1e6, "--save", "run.csv", cwd=tmp_path)
    assert done.returncode == 2
    assert "saved whole as .npz" in done.stderr
