"""Free memory, and what is refused before it is allocated."""

import importlib
import math
import tracemalloc

import numpy as np
import pytest
from helpers.memory import run_within

import spacearm as sa
from spacearm import processes
from spacearm.mechanics.batch import results_for
from spacearm.polynomial.trig import interpolants
from spacearm.singularities.sets import FoundSet

resource = pytest.importorskip("resource")


def test_free_memory_is_what_the_limit_of_address_space_leaves():
    said, _ = run_within(
        0.5, "from spacearm import processes; print(processes.free_memory() / 1e6)"
    )
    assert 0.0 < float(said) < 500.0
    assert processes.free_memory() > 0.0


def test_free_memory_is_what_a_container_leaves(tmp_path, monkeypatch):
    proc, groups = tmp_path / "proc", tmp_path / "cgroup"
    inner = groups / "outer" / "inner"
    inner.mkdir(parents=True)
    (proc / "self").mkdir(parents=True)
    monkeypatch.setattr(processes, "PROC", proc)
    monkeypatch.setattr(processes, "CGROUPS", groups)
    (proc / "meminfo").write_text("MemTotal: 9000000 kB\nMemAvailable: 4000000 kB\n")
    (proc / "self" / "cgroup").write_text("0::/outer/inner\n")
    assert processes.free_memory() == 4000000 * 1024
    (groups / "outer" / "memory.max").write_text("3000000000\n")
    (groups / "outer" / "memory.current").write_text("2500000000\n")
    (inner / "memory.max").write_text("max\n")
    (inner / "memory.current").write_text("2000000000\n")
    assert processes.free_memory() == 5e8
    (groups / "outer" / "memory.stat").write_text("anon 7\ninactive_file 200000000\n")
    assert processes.free_memory() == 7e8
    version1 = groups / "memory" / "job"
    version1.mkdir(parents=True)
    (version1 / "memory.limit_in_bytes").write_text("600000000\n")
    (version1 / "memory.usage_in_bytes").write_text("500000000\n")
    (proc / "self" / "cgroup").write_text("9:cpu:/job\n5:memory:/job\n")
    assert processes.free_memory() == 1e8


def test_what_needs_more_than_is_free_is_refused_with_need_and_remedy(monkeypatch):
    monkeypatch.setattr(processes, "free_memory", lambda: 1e9)
    processes.check_memory(7e8, "a map", "use fewer cells")
    with pytest.raises(sa.SpaceArmError, match=r"a map needs 9 GB .* 0\.8 GB .*; use fewer cells"):
        processes.check_memory(9e9, "a map", "use fewer cells")
    with pytest.raises(sa.SpaceArmError, match="needs inf GB"):
        processes.check_memory(math.inf, "a map", "use fewer cells")


@pytest.mark.parametrize(("text", "found"), [("", 1e9), ("4", 4e9), (" 0.5 ", 5e8)])
def test_the_limit_of_a_reader_is_that_of_the_environment(monkeypatch, text, found):
    monkeypatch.setenv("SPACEARM_MEMORY", text)
    assert processes.memory_limit() == found


def test_where_the_system_sets_no_limit_a_file_is_read_without_one(monkeypatch):
    """As macOS, where each process has more address space than the limit."""

    def refuse(*_):
        raise ValueError("current limit exceeds maximum limit")

    monkeypatch.setattr(resource, "setrlimit", refuse)
    assert processes._limited(1e9, lambda: "read") == "read"


@pytest.mark.parametrize("text", ["0", "-1", "inf", "nan", "1e999", "much", "1 GB"])
def test_a_limit_that_is_no_number_of_gigabytes_is_refused(monkeypatch, text):
    monkeypatch.setenv("SPACEARM_MEMORY", text)
    with pytest.raises(sa.ConfigurationError, match=r"SPACEARM_MEMORY is .*positive number of GB"):
        processes.memory_limit()


def searches():
    """Searches with arguments for which they need much memory, and their remedies."""
    arm = sa.load("planar2")
    start = arm.at([-0.6, 1.4])
    rows = np.broadcast_to(np.zeros(2), (4_000_000, 2))
    S = sa.singularity_polynomial(arm)
    box_graph = importlib.import_module("spacearm.singularities.box_graph")
    cells = box_graph.Cells(
        np.zeros((1, 2)), np.ones((1, 2)), np.full(1, -1), np.zeros(1, dtype=bool)
    )
    return {
        "grid": (lambda: S.grid((3000, 3000)), "on_grid"),
        "rows": (lambda: results_for(None, (len(rows), 6, 2), "out"), "fewer rows"),
        "samples": (lambda: sa.risk_profile(arm, samples=10_000_000), "fewer samples"),
        "boxes": (lambda: box_graph._with_room(cells, 10_000_000), "fewer boxes"),
        "a fit": (
            lambda: interpolants(lambda Q: np.zeros((len(Q), 9)), np.full((2, 9), 300)),
            "lock joints",
        ),
        "a map": (lambda: sa.singular_map(arm, points=2001), "fewer points"),
        "found": (lambda: FoundSet(arm, "free-floating").sample(1_000_000), "take fewer"),
        "drawn": (lambda: sa.singular_set(arm).sample(1_000_000), "take fewer"),
        "poses": (
            lambda: sa.pose_risk(arm, poses=1_000_000, neighbours=1000, samples=1_000_000),
            "fewer of either",
        ),
        "shares": (
            lambda: sa.uncertain(arm, {"link_2": {"mass": 0.05, "com": 0.1}}).sample(
                1_000_000, np.random.default_rng(0)
            ),
            "fewer samples",
        ),
        "directions": (
            lambda: sa.level_reach(start, 0.1, directions=1_000_000),
            "fewer directions",
        ),
        "attitudes": (
            lambda: sa.feasible_attitudes(start, [(2.0, 0.0), (1.5, 1.5)], samples=1_000_000),
            "fewer samples",
        ),
    }


CASES = ["grid", "rows", "samples", "boxes", "a fit", "a map", "found", "drawn", "poses", "shares"]


@pytest.mark.parametrize("case", [*CASES, "directions", "attitudes"])
def test_searches_ask_for_memory_before_they_allocate_it(case, monkeypatch):
    search, remedy = searches()[case]
    monkeypatch.setattr(processes, "free_memory", lambda: 6e7)
    with pytest.raises(sa.SpaceArmError):  # imports modules and compiles kernels
        search()
    tracemalloc.start()
    with pytest.raises(sa.SpaceArmError, match=r"needs .* GB of memory, and 0\.048 GB") as caught:
        search()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert remedy in str(caught.value)
    assert peak < 1e7
