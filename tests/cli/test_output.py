"""What commands write, to terminals and into folders, whatever names the files hold."""

import json

import pytest
from helpers.arms import frame, joint, link, robot
from helpers.commands import spacearm
from matplotlib.text import Text

import spacearm as sa
from spacearm.cli.output import print_json

ODD = "a\x9b31m\x85b\u202ec\x7f"
"""Commands of terminals that XML allows in a name."""
TASK = ("--tip", "tip", "--task", "x y")


def odd_robot(folder, name="odd", part=""):
    """A planar arm of two joints, with a name and what all names of its parts end with."""
    path = folder / "robot.urdf"
    parts = (
        *(link(f"{one}{part}", 5.0) for one in ("bus", "upper", "lower")),
        joint(f"1{part}", f"bus{part}", f"upper{part}", xyz=(1, 0, 0)),
        joint(f"2{part}", f"upper{part}", f"lower{part}", xyz=(1, 0, 0)),
        frame("tip"),
        joint("hand", f"lower{part}", "tip", "fixed", xyz=(1, 0, 0)),
    )
    path.write_text(robot(*parts).replace('name="r"', f'name="{name}"', 1), encoding="utf-8")
    return path


def strings(data):
    """All texts in JSON data."""
    if isinstance(data, str):
        return [data]
    parts = data.values() if isinstance(data, dict) else data if isinstance(data, list) else []
    return [text for part in parts for text in strings(part)]


COMMANDS = {
    "map": ("--points", "5"),
    "workspace": ("--effort", "20"),
    "design": ("--vary", "base_inertia=1,2", "--effort", "20"),
    "simulate": ("0.3", "0.9", "--target", "0.3", "0.8", "--controller", "JointPD",
                 "--duration", "0.1"),
    "plan": ("0.3", "0.9", "--goal", "0.8", "0.8", "--with", "search.timeout=5"),
}  # fmt: skip
"""Those that draw a picture where none is asked for."""
NAMES = ("../../up", "{}/absolute", ".hidden", "-option", "x" * 400)


@pytest.mark.parametrize(
    ("command", "name"),
    [
        *(("map", name) for name in NAMES),
        *(pytest.param(command, NAMES[0], marks=pytest.mark.slow) for command in [*COMMANDS][1:]),
    ],
)
def test_a_robot_s_name_leads_nowhere(tmp_path, command, name):
    here = tmp_path / "there" / "here"
    here.mkdir(parents=True)
    robot_file = odd_robot(tmp_path, name.format(tmp_path))
    run = spacearm(command, robot_file, *COMMANDS[command], *TASK, cwd=here)
    assert run.returncode == 0, run.stderr
    (picture,) = here.iterdir()
    assert picture.name[0] not in ".-"
    assert sorted(p.name for p in tmp_path.rglob("*") if p.is_file()) == sorted(
        ("robot.urdf", picture.name)
    )


def test_json_escapes_what_is_not_seen(capsys):
    text = "".join(("a\u200b", "\ufeff", "\U000e0041", "\x9b", "b"))
    print_json({"name": text})
    said = capsys.readouterr().out
    assert said.replace("\n", "").isprintable()
    assert json.loads(said) == {"name": text}


@pytest.mark.parametrize(
    "words",
    [
        ("info", "FILE"), ("info", "FILE", "--json"), ("query", "FILE", "0.3", "0.9", *TASK),
        ("query", "FILE", "0.3", "0.9", *TASK, "--json"), ("query", "FILE", "0.3", "9", *TASK),
        ("query", "FILE", "0.3"), ("query", "FILE", "0.3", "0.9", "--tip", f"x{ODD}"),
        ("map", "FILE", "--points", "5", *TASK), ("workspace", "FILE", "--effort", "20", *TASK),
    ],
)  # fmt: skip
def test_names_do_not_command_the_terminal(tmp_path, words):
    path = odd_robot(tmp_path, f"odd{ODD}", ODD)
    run = spacearm(*(path if word == "FILE" else word for word in words), cwd=tmp_path)
    for text in (run.stdout, run.stderr):
        assert all(letter.isprintable() or letter == "\n" for letter in text), text
    if "--json" in words:
        assert f"1{ODD}" in "".join(
            strings(json.loads(run.stdout))
        )  # the name itself, in JSON's own escapes


@pytest.mark.slow
@pytest.mark.parametrize("name", ["\\$ $x_", "$a$", "$\\frac{1}{$"])
def test_names_are_no_formulas(tmp_path, name):
    path = odd_robot(tmp_path, name, name)
    arm = sa.load(path, tip="tip", task="x y")
    cfg = arm.at([0.3, 0.9])
    for thing in (arm, cfg, sa.singularity(cfg), sa.singular_map(arm, points=5)):
        sa.plot(thing).savefig(tmp_path / "picture.png")
    run = sa.simulate(arm.at([0.3, 0.9]), sa.JointPD([0.3, 0.8], 1, 1), 0.1)
    S = sa.singularity_polynomial(sa.load("mda6"))
    for result in (run, sa.workspace(arm, effort=20), sa.singular_set(arm), S):
        figure = sa.plot(result)
        figure.savefig(tmp_path / "picture.png")
        texts = figure.findobj(Text)
        assert result is S or name in "".join(text.get_text() for text in texts)
        powers = [t for t in texts if "mathdefault" in t.get_text() and t.get_visible()]
        assert all(text.get_parse_math() for text in powers)
