"""The command line in odd surroundings: streams that are closed, settings, interrupts."""

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import pytest
from helpers.commands import complaints, in_a_process, spacearm

import spacearm as sa
from spacearm.cli.app import main

QUERY = (sys.executable, "-m", "spacearm", "query", "planar2", "0", "1")


@pytest.mark.slow
@pytest.mark.parametrize("closed", [">&- 2>&-", ">&-", "2>&-", "<&-", "<&- >&- 2>&-"])
def test_streams_that_are_closed(tmp_path, closed):
    words = [*QUERY[:3], "map", "planar2", "--points", "5", "--output", str(tmp_path / "map.svg")]
    run = subprocess.run(
        ["sh", "-c", f'exec "$@" {closed}', "sh", *words], capture_output=True, text=True
    )
    assert (run.returncode, complaints(run)) == (0, [])
    text = (tmp_path / "map.svg").read_text()
    assert text.startswith("<?xml")
    assert "wrote" not in text


@pytest.mark.slow
def test_a_backend_that_does_not_exist(tmp_path):
    run = in_a_process("map", "planar2", "--points", "5", MPLBACKEND="nonsense", cwd=tmp_path)
    assert (run.returncode, complaints(run)) == (0, [])
    code = "import spacearm as sa; sa.plot(sa.load('planar2'))"
    env = os.environ | {"MPLBACKEND": "nonsense"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    assert "ConfigurationError: MPLBACKEND names no backend" in done.stderr


@pytest.mark.slow  # Python compiles all modules anew
@pytest.mark.parametrize(
    "words", [("--help",), ("query", "planar2", "0", "1", "--first-order"), ("map", "--help")]
)
def test_python_without_docstrings_and_asserts(words):
    run = in_a_process(*words, PYTHONOPTIMIZE="2")
    assert run.returncode == 0
    assert complaints(run) == []


@pytest.mark.slow
def test_the_view_where_warnings_are_errors(tmp_path):
    words = [sys.executable, "-W", "error", *QUERY[1:3], "view", "planar2", "--save", "page.html"]
    run = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
    assert (run.returncode, complaints(run)) == (0, [])
    assert (tmp_path / "page.html").stat().st_size > 800_000


@pytest.mark.slow
@pytest.mark.parametrize("after", [0.02, 0.1, 0.3, 0.6, 1.0, 2.0])
@pytest.mark.parametrize("words", [("map", "mda6", "--points", "1001"), ("workspace", "mda6")])
def test_an_interrupt_at_any_time_gives_no_traceback(tmp_path, after, words):
    process = subprocess.Popen(
        [*QUERY[:3], *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        cwd=tmp_path,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    time.sleep(after)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=300)
    assert process.returncode in (0, 130, -signal.SIGINT) or "spacearm/" not in err
    assert "__main__.py" not in err  # what comes before is Python's own start


@pytest.mark.parametrize("words", [("map", "mda6"), ("risk", "planar2"), ("query", "planar2")])
def test_an_interrupt_before_there_is_anything_to_keep_is_said(monkeypatch, capsys, words):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("spacearm.load", interrupted)
    monkeypatch.setattr(sys, "argv", ["spacearm", *words])
    with pytest.raises(SystemExit, match="130"):
        main()
    assert capsys.readouterr().err == "spacearm: stopped\n"


def test_an_interrupt_while_a_class_is_made_is_said(monkeypatch, capsys):
    """Python before 3.12 raises a RuntimeError of it."""

    class Interrupted:
        def __set_name__(self, *_):
            raise KeyboardInterrupt

    def load(*_, **__):
        type("Arm", (), {"field": Interrupted()})

    monkeypatch.setattr("spacearm.load", load)
    monkeypatch.setattr(sys, "argv", ["spacearm", "query", "planar2"])
    with pytest.raises(SystemExit, match="130"):
        importlib.import_module("spacearm.__main__").main()
    assert capsys.readouterr().err == "spacearm: stopped\n"


def test_an_interrupt_that_an_import_swallows_ends_the_view(monkeypatch):
    """As trimesh does, which is imported when a scene is made."""
    served = []

    def swallows(*_, **__):
        with suppress(BaseException):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("spacearm.cli.views.show", swallows)
    monkeypatch.setattr("spacearm.cli.views.serve_until_interrupted", lambda *_: served.append(1))
    monkeypatch.setattr(sys, "argv", ["spacearm", "view", "planar2"])
    with pytest.raises(SystemExit) as end:
        main()
    assert (end.value.code, served) == (130, [])


def stopped_after(blocks, size, monkeypatch):
    """Have Ctrl-C come after some blocks of configurations."""
    module = importlib.import_module("spacearm.mechanics.batch")
    before, reports = module.fill, []

    def interrupted(results, rows, compute, threads, progress):
        def tell(done, total):
            progress(done, total)
            reports.append(done)
            if len(reports) == blocks:
                raise KeyboardInterrupt

        def slowly(rows, places):
            time.sleep(0.01)
            return compute(rows, places)

        if progress is None:  # not what is waited for
            before(results, rows, compute, threads, progress)
        else:
            before(results, rows, slowly, threads, tell)

    for user in ("spacearm.mechanics.batch", "spacearm.singularities.risk"):
        monkeypatch.setattr(importlib.import_module(user), "fill", interrupted)
    monkeypatch.setattr(module, "BLOCK", size)


def test_ctrl_c_in_a_map_keeps_the_postures_done(tmp_path, monkeypatch):
    stopped_after(1, 50, monkeypatch)
    words = ("map", "planar2", "--points", 31, "--output", "map.svg", "--npz", "map.npz")
    run = spacearm(*words, cwd=tmp_path)
    assert run.returncode == 130
    assert "of 961 postures done; the results so far are kept" in run.stderr
    assert (tmp_path / "map.svg").read_text().endswith("</svg>\n")
    distance = np.load(tmp_path / "map.npz")["distance"]
    assert 0 < np.isnan(distance).sum() < 961
    whole = sa.singular_map(sa.load("planar2"), points=31).distance
    done = ~np.isnan(distance)
    np.testing.assert_array_equal(distance[done], whole[done])


def test_ctrl_c_in_a_risk_keeps_the_sample(tmp_path, monkeypatch):
    stopped_after(2, 500, monkeypatch)
    run = spacearm("risk", "planar2", "--samples", 9000, "--json", cwd=tmp_path)
    assert run.returncode == 130
    assert "of 9,000 postures done" in run.stderr
    assert 1000 <= sum(json.loads(run.stdout)["count"]) < 9000


def test_ctrl_c_in_a_workspace_keeps_what_is_attained(tmp_path, monkeypatch):
    whole = sa.workspace(sa.load("planar2"))

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("spacearm.workspaces.shells.ShellSearch.exact", interrupted)
    run = spacearm("workspace", "planar2", "--json", cwd=tmp_path)
    assert run.returncode == 130
    assert "stopped: shells may be missing" in run.stderr
    kept = json.loads(run.stdout)
    assert (kept["bounds"], kept["pdw"], kept["gap"]) == ("stopped", [], None)
    np.testing.assert_allclose(kept["reachable"], whole.reachable, atol=1e-6)
    drawn = spacearm("workspace", "planar2", cwd=tmp_path)
    assert "from the system CM (stopped)" in drawn.stdout
    assert (tmp_path / "planar2_workspace.png").read_bytes().endswith(b"IEND\xaeB`\x82")


def test_a_design_that_was_stopped_is_not_done(tmp_path, monkeypatch):
    """The workspace that stopped does not count as one: the rest of the grid stays empty."""
    designs = importlib.import_module("spacearm.workspaces.design")
    before, seen = designs.workspace, []

    def second(*given, **options):
        seen.append(1)
        if len(seen) == 2:
            raise sa.StoppedError("some shells", None)
        return before(*given, **options)

    monkeypatch.setattr(designs, "workspace", second)
    run = spacearm("design", "planar2", "--vary", "base_inertia=1:3:3", cwd=tmp_path)
    assert run.returncode == 130
    assert "stopped: 1 of 3 designs done; the results so far are kept" in run.stderr
    assert run.stdout.count("%") == 3  # path independent, near a singular posture, its error
    assert "base_inertia: its mass stays" in run.stdout


def test_a_plan_that_was_stopped_is_saved_as_far_as_it_came(tmp_path, monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setitem(
        importlib.import_module("spacearm.planning.methods").METHODS, "straight", interrupted
    )
    words = (0.3, 1.2, "--goal", 0.9, 1.4, "--save", "plan.npz")
    run = spacearm("plan", "planar2", *words, cwd=tmp_path)
    assert run.returncode == 130
    assert "wrote plan.npz: the best attempt, which does not arrive" in run.stderr
    assert "straight: stopped by Ctrl-C" in run.stderr
    assert isinstance(sa.Motion.load(tmp_path / "plan.npz", sa.load("planar2")), sa.Plan)


@pytest.mark.slow
def test_a_run_that_was_stopped_says_how_far_it_came(tmp_path, monkeypatch):
    simulate = sa.simulate

    def interrupted(*_, **options):
        def tell(*_):
            raise KeyboardInterrupt

        return simulate(*_, **(options | {"progress": tell}))

    monkeypatch.setattr("spacearm.simulate", interrupted)
    words = (0.3, 0.9, "--target", 0.3, 0.8, "--controller", "JointPD", "--duration", 50)
    run = spacearm("simulate", "planar2", *words, "--save", "run.npz", cwd=tmp_path)
    assert run.returncode == 130
    assert "of 50 s simulated; the results so far are kept" in run.stderr
    assert sa.Motion.load(tmp_path / "run.npz", sa.load("planar2")).ended == "interrupted"


@pytest.mark.slow
def test_effort_counts_where_it_says(tmp_path, monkeypatch):
    run = spacearm("workspace", "planar2", "--effort", 50, cwd=tmp_path)
    assert "--effort has no effect: the bounds of this arm are proven" in run.stderr
    monkeypatch.setattr("spacearm.workspaces.shells.STARTS", 1)
    words = ("workspace", "mda6", "--effort", 300, "--json")
    few = json.loads(spacearm(*words, cwd=tmp_path).stdout)
    assert few["effort"] == 300
