"""`spacearm follow`: paths of the tip from CSV files, with times and without."""

import json

import numpy as np
import pytest
from helpers.commands import spacearm

import spacearm as sa

CORNERS = [(1.2, 1.25), (1.3, 1.2)]


@pytest.mark.slow
@pytest.mark.parametrize("times", [None, [2.0, 4.0]])
def test_the_file_gives_what_python_gives(tmp_path, times):
    rows = CORNERS if times is None else np.column_stack((times, CORNERS))
    text = "\n".join(",".join(map(str, row)) for row in np.asarray(rows).tolist())
    (tmp_path / "way.csv").write_text(text if times is None else f"t,x,y\n{text}\n")
    run = spacearm("follow", "planar2", 0.3, 1.2, "--path", "way.csv", "--json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    found = sa.follow(sa.load("planar2").at([0.3, 1.2]), CORNERS, times=times)
    told = json.loads(run.stdout)
    np.testing.assert_allclose(told["t"], found.t, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(told["q"], found.q, rtol=0.0, atol=1e-12)


def test_a_path_that_cannot_be_followed_ends_with_a_status_of_its_own(tmp_path):
    (tmp_path / "way.csv").write_text("9.0,0.0\n")
    run = spacearm("follow", "planar2", 0.3, 1.2, "--path", "way.csv", "--json", cwd=tmp_path)
    assert run.returncode == 3
    assert json.loads(run.stdout)["ended"] == "singularity"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1\n", "numbers in a row"),
        ("1,2\n1,2,3\n", "numbers in a row"),
        ("1,x\n2,3\n1,a\n", "'a'"),
        ("t;x;y\n0;1;2\n", "separate by commas"),
        ("", "way.csv has no rows of numbers"),
    ],
)
def test_files_that_are_no_path(tmp_path, text, message):
    (tmp_path / "way.csv").write_text(text)
    run = spacearm("follow", "planar2", 0.3, 1.2, "--path", "way.csv", cwd=tmp_path)
    assert run.returncode == 2
    assert message in run.stderr
