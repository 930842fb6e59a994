"""Worker processes: calls one after the other, errors, and how they end."""

import gc
import os
import pickle
import subprocess
import sys
import threading
import time
from functools import partial

import pytest

import spacearm as sa
from spacearm.errors import unknown
from spacearm.processes import COMMAND, Process, WorkerError, WorkerLostError


@pytest.fixture
def process():
    process = Process()
    yield process
    process.end()


def test_calls_are_answered_one_after_the_other_with_results_and_errors(process):
    assert process.call(partial(unknown, "mode", "x", ["y"])).startswith("unknown mode 'x'")
    with pytest.raises(sa.ModelError) as here:
        sa.load("nowhere")
    with pytest.raises(sa.ModelError) as there:
        process.call(partial(sa.load, "nowhere"))
    assert str(there.value) == str(here.value)
    with pytest.raises(WorkerError, match="ValueError: invalid literal"):
        process.call(partial(int, "one"))
    with pytest.raises(WorkerError, match="cannot be sent to another process"):
        process.call(lambda: 0)
    assert process.call(partial(os.getpid)) == process.pid != os.getpid()


def test_progress_is_told(process):
    told = []
    found = process.call(
        partial(sa.risk_profile, sa.load("planar2")), lambda *now: told.append(now)
    )
    assert found.count.sum() > 0
    assert all(0.0 <= done <= total for done, total in told)
    assert told


def test_what_a_call_prints_is_no_answer(process):
    assert process.call(partial(print, "hello")) is None


def test_a_call_under_way_can_be_ended(process):
    threading.Timer(0.5, process.kill).start()
    with pytest.raises(WorkerLostError, match="its worker process was ended by signal 9"):
        process.call(partial(time.sleep, 60.0))


@pytest.mark.slow
def test_a_worker_takes_nothing_from_the_current_folder(tmp_path):
    for name in ("pickle", "json", "numpy", "spacearm"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('from the current folder')")
    found = os.pathsep.join(filter(None, sys.path))
    run = subprocess.run(
        COMMAND, cwd=tmp_path, env=os.environ | {"PYTHONPATH": found}, input="",
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.stderr == ""


def test_a_worker_whose_main_process_is_gone_says_nothing():
    worker = subprocess.Popen(
        COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    worker.stdout.close()
    pickle.dump(pickle.dumps((partial(os.getpid), False)), worker.stdin)
    worker.stdin.flush()
    assert worker.wait(timeout=300) == 1, "it ends, since nobody reads its answer"
    worker.stdin.close()
    assert worker.stderr.read() == b""
    worker.stderr.close()


def test_a_worker_ends_when_its_input_does_in_the_midst_of_a_call():
    worker = subprocess.Popen(COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    pickle.dump(pickle.dumps((partial(time.sleep, 600.0), False)), worker.stdin)
    worker.stdin.close()
    assert worker.wait(timeout=300) == 1
    worker.stdout.close()


@pytest.mark.slow
def test_a_worker_that_ended_before_it_was_asked_leaves_nothing_open(process):
    process.kill()
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    with pytest.raises(WorkerLostError, match="signal 9"):
        process.call(partial(os.getpid))
    assert process.end() == "signal 9"
    gc.collect()  # an open pipe would warn
