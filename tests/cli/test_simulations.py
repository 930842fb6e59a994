"""The command `spacearm simulate`, from outside."""

import json

import numpy as np
import pytest
from helpers.commands import spacearm

import spacearm as sa
from spacearm.cli.options import join_numbers

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
    ],
)
def test_bad_input(tmp_path, words, message):
    done = run("planar2", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


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
