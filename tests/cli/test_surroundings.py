"""The command line in odd surroundings: streams that are closed, settings, interrupts."""

import os
import signal
import subprocess
import sys
import time

import pytest
from helpers.commands import in_a_process

QUERY = (sys.executable, "-m", "spacearm", "query", "planar2", "0", "1")


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_streams_that_are_closed(tmp_path, closed):
    words = [*QUERY[:3], "map", "planar2", "--points", "5", "--output", str(tmp_path / "map.svg")]
    run = subprocess.run(
        ["sh", "-c", f'exec "$@" {closed}', "sh", *words], capture_output=True, text=True
    )
    assert (run.returncode, run.stderr) == (0, "")
    text = (tmp_path / "map.svg").read_text()
    assert text.startswith("<?xml")
    assert "wrote" not in text


def test_a_backend_that_does_not_exist(tmp_path):
    run = in_a_process("map", "planar2", "--points", "5", MPLBACKEND="nonsense", cwd=tmp_path)
    assert (run.returncode, run.stderr) == (0, "")
    code = "import spacearm as sa; sa.plot(sa.load('planar2'))"
    env = os.environ | {"MPLBACKEND": "nonsense"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    assert "ConfigurationError: MPLBACKEND names no backend" in done.stderr


@pytest.mark.slow  # Python compiles all modules anew
@pytest.mark.parametrize("words", [("--help",), ("query", "planar2", "0", "1"), ("map", "--help")])
def test_python_without_docstrings_and_asserts(words):
    run = in_a_process(*words, PYTHONOPTIMIZE="2")
    assert run.returncode == 0
    told = run.stderr.splitlines()  # kernels without docstrings are others
    assert all(line.startswith("spacearm: compiling once") for line in told), told


def test_the_view_where_warnings_are_errors(tmp_path):
    words = [sys.executable, "-W", "error", *QUERY[1:3], "view", "planar2", "--save", "page.html"]
    run = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
    assert (run.returncode, run.stderr) == (0, "")
    assert (tmp_path / "page.html").stat().st_size > 800_000


@pytest.mark.slow
@pytest.mark.parametrize("after", [0.02, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0])
@pytest.mark.parametrize("words", [("map", "mda6", "--points", "1001"), ("workspace", "mda6")])
def test_an_interrupt_at_any_time_gives_no_traceback(tmp_path, after, words):
    process = subprocess.Popen(
        [*QUERY[:3], *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        cwd=tmp_path,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    time.sleep(after)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode in (0, 130, -signal.SIGINT) or "spacearm/" not in err
    assert "__main__.py" not in err  # what comes before is Python's own start
