"""The long runs (benchmarks/soak.py, on demand) tell memory that grows from one that is flat."""

import sys
import tracemalloc

import numpy as np
import pytest

if sys.platform != "linux":
    pytest.skip("soak.py reads /proc", allow_module_level=True)
from soak import soak


@pytest.fixture(autouse=True)
def _traced():
    tracemalloc.start()
    yield
    tracemalloc.stop()


@pytest.mark.slow
def test_an_array_kept_by_every_operation_is_too_much(capsys):
    kept = []
    assert not soak("leaks", 1000, lambda count: kept.extend(np.zeros(3) for _ in range(count)), {})
    assert "TOO MUCH, allowed are 132.0" in capsys.readouterr().out
    assert len(kept) == 11_000


@pytest.mark.slow
def test_arrays_that_are_let_go_are_not(capsys):
    assert soak("sums", 1000, lambda count: sum(np.zeros(3).sum() for _ in range(count)), {})
    assert "TOO MUCH" not in capsys.readouterr().out


@pytest.mark.slow
def test_other_meters_count_too():
    grown = iter(range(0, 11 * 8, 8))
    assert not soak("moves", 1, lambda _: None, {"browser": lambda: float(next(grown))})
