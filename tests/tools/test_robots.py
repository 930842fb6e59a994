"""The table of robots: what comes of each file, and what is never in it."""

import robots
from helpers.arms import frame, joint, link, robot, two_links

SDF = "<sdf version='1.9'><model name='m'><link name='a'/></model></sdf>"
IMPOSSIBLE = link("arm", inertia=[[1, 0, 0], [0, 1, 0], [0, 0, 3]])


def test_every_outcome_has_its_row(tmp_path, capsys):
    folder = tmp_path / "robots"
    folder.mkdir()
    (folder / "SOURCE.txt").write_text("someone/robots commit 0\n")
    texts = {
        "whole.urdf": robot(*two_links()),
        "arm.urdf": robot(frame("base"), link("arm"), joint("elbow", "base", "arm")),
        "odd.urdf": robot(link("bus", 50.0), IMPOSSIBLE, joint("elbow", "bus", "arm")),
        "still.sdf": SDF,
        "part.xml": "<mujocoinclude/>",
        "broken.urdf": "<robot>",
        "package.xml": "<package/>",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    assert robots.main([str(folder), "--count", str(folder)]) == 0
    said = capsys.readouterr().out
    counted, _, one_by_one = said.partition("## Results by file")
    rows = {
        line.split(" | ")[0]: line
        for line in one_by_one.splitlines()
        if line.startswith("| someone")
    }
    assert list(rows) == [
        f"| someone/robots: {name}"
        for name in ("arm.urdf", "broken.urdf", "odd.urdf", "still.sdf", "whole.urdf")
    ]
    whole, arm, odd, broken, still = (
        rows[f"| someone/robots: {name}"].split(" | ")[1:]
        for name in ("whole.urdf", "arm.urdf", "odd.urdf", "broken.urdf", "still.sdf")
    )
    assert whole[:4] == ["URDF", "1", "arm", "51"]
    assert arm[2:4] == ["arm", "1"]
    assert "on a bus of 200 kg" in arm[4]
    assert "check='warn'" in odd[4]
    assert broken[4].startswith("refused: is not XML")
    assert still[4].startswith("no movable joint")
    lines = [line for line in counted.splitlines() if line.startswith(("| source", "| all"))]
    words, numbers = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    outcomes = dict(zip(words[1:], map(int, numbers[1:]), strict=True))
    assert outcomes == {
        "files": 12,
        "answered": 4,
        "answered with an option": 2,
        "refused": 2,
        "no movable joint": 2,
        "part of another file": 2,
    }
    assert str(tmp_path) not in said


def test_space_robots_stand_first_with_the_command_that_loads_them(tmp_path, capsys, monkeypatch):
    (folder := tmp_path / "robots").mkdir()
    (folder / "SOURCE.txt").write_text("someone/robots commit 0\n")
    (folder / "odd.urdf").write_text(
        robot(link("bus", 50.0), IMPOSSIBLE, joint("elbow", "bus", "arm"))
    )
    monkeypatch.setattr(robots, "SPACE", {"an odd one": "robots: odd.urdf", "none": "no.urdf"})
    assert robots.main([str(folder)]) == 0
    (line,) = (ln for ln in capsys.readouterr().out.splitlines() if ln.startswith("| an odd one"))
    command = "`spacearm info odd.urdf --check warn`"
    assert line == f"| an odd one | someone/robots: odd.urdf | 1 | arm | 51 | {command} |"
