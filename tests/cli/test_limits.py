"""What the command line says of numbers beyond all use, and of what the system does not give."""

import sys
import threading

import pytest
from helpers.commands import complaints, in_a_process, spacearm

import spacearm as sa
from spacearm.compiler import machine

START = ("simulate", "planar2", "0.3", "1.2", "--target", "0.9", "1.4", "--duration", "1", "--json")
PLAN = ("plan", "planar2", "0.3", "1.2", "--goal", "0.9", "1.4", "--json")
WHOLE = "1" + "0" * 400
"""A whole number beyond all floats, as TOML may have it."""


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("design", "planar2", "--vary", f"base_inertia=1:2:{10**12}"), ("base_inertia", "1 to")),
        (("design", "planar2", "--vary", f"base_inertia=1:2:{WHOLE}"), ("base_inertia", "1 to")),
        ((*START, "--with", "integration.dt=1e-300"), ("dt is 1e-300", "from 1e-12")),
        ((*START, "--with", "integration.dt=1e-10"), ("dt is 1e-10", "at most 1,000,000 steps")),
        ((*START, "--with", f"integration.dt={WHOLE}"), ("dt is",)),
        ((*START, "--with", f"integration.rtol={WHOLE}"), ("rtol is",)),
        ((*START, "--with", "sampling.period=1e-300"), ("period is",)),
        (("boxes", "planar2", "--most", str(10**30)), ("most is", "10,000,000")),
        (("boxes", "planar2", "--most", "1e30"), ("most", "10,000,000")),
        (("risk", "planar2", "--samples", str(10**30)), ("samples is", "10,000,000")),
        (("risk", "planar2", "--samples", "1e30"), ("samples", "10,000,000")),
        (("risk", "planar2", "--bins", "1e30"), ("bins", "10,000,000")),
        (("map", "planar2", "--points", "1e30"), ("points", "2001")),
        (("wheels", "planar2", "--tip-speed", "0.1", "--samples", "1e30"), ("samples", "10,000")),
        (("box", "planar2", "0.3", "1.2", "--clearance", "1e308"), ("clearance is 1e+308",)),
        ((*PLAN, "--with", f"search.timeout={WHOLE}"), ("timeout is",)),
        ((*PLAN, "--with", f"duration={WHOLE}"), ("duration is",)),
    ],
)
def test_counts_and_spacings_beyond_all_use_are_refused_with_their_bound(words, parts):
    run = spacearm(*words)
    assert run.returncode == 2, run
    assert len(complaints(run)) == 1
    assert all(part in run.stderr for part in parts), run.stderr


def test_a_count_may_be_written_as_a_power_of_ten():
    digits, *others = (
        spacearm("risk", "planar2", "--bins", "2", *samples, "--json")
        for samples in (("--samples", "1000"), ("--samples", "1e3"), ("--samples=1e3",))
    )
    assert digits.returncode == 0
    assert [run.stdout for run in others] == [digits.stdout] * 2


@pytest.mark.parametrize("seconds", ["x", "1e9", "9" * 30])
def test_a_date_of_pictures_that_is_none_is_named(seconds, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", seconds)
    run = spacearm("map", "planar2", "--points", "5", "--output", tmp_path / "map.svg")
    assert run.returncode == 2
    assert f"SOURCE_DATE_EPOCH is '{seconds}'" in run.stderr
    assert not list(tmp_path.iterdir())
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert spacearm("map", "planar2", "--points", "5", "--output", tmp_path / "map.svg")[0] == 0


def test_threads_that_cannot_be_started_are_named_and_not_the_output(monkeypatch):
    def start(_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    run = spacearm("risk", "planar2", "--samples", "100000", "--bins", "2", "--json")
    assert run.returncode == 1
    assert "a thread cannot be started" in run.stderr
    assert "output" not in run.stderr
    assert len(complaints(run)) == 1


def test_a_compiler_that_cannot_be_loaded_is_named_and_not_the_output(monkeypatch):
    machine._llvm.cache_clear()
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    try:
        run = spacearm("query", "planar3", "0.3", "1.2", "0.1", "--json")
    finally:
        machine._llvm.cache_clear()
    assert run.returncode == 1
    assert "llvmlite" in run.stderr
    assert "output" not in run.stderr


@pytest.mark.parametrize(("error", "said"), [((), "memory; "), (("3 GB",), "memory (3 GB); ")])
def test_a_lack_of_memory_is_told_with_what_is_known_of_it(error, said, monkeypatch):
    def full(*_, **__):
        raise MemoryError(*error)

    monkeypatch.setattr(sa, "singularity", full)
    run = spacearm("query", "planar2", "0.3", "1.2")
    assert run.returncode == 1
    assert f"there is not enough {said}" in run.stderr


@pytest.mark.slow
def test_what_a_limit_of_memory_leaves_no_room_for_is_named():
    """350 MB hold Python and its libraries, and not LLVM."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_AS)
    try:
        resource.setrlimit(resource.RLIMIT_AS, (350_000_000, before[1]))
        run = in_a_process("query", "planar2", "0.3", "1.2", OPENBLAS_NUM_THREADS="1")
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    assert run.returncode in (0, 1)
    assert "Traceback" not in run.stderr
    assert "output" not in run.stderr
