"""Kernels as they are called: shapes, threads, processes."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from helpers.kernels import NUMBERS, TABLES, close, in_process, kernel

from spacearm.compiler.kernel import compiled


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
def test_any_number_of_rows(lanes):
    k, rng = kernel(lanes), np.random.default_rng(0)
    for m in (0, 1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 100, 1001):
        x, y = rng.uniform(-3, 3, (m, 3)), rng.uniform(-1, 5, m)
        for threads in (1, 2, 7):
            close(k({"x": x, "y": y}, NUMBERS, TABLES, threads=threads), x, y)


def test_arguments_need_not_lie_in_order():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-3, 3, (3, 18)).T[::2], rng.uniform(-1, 5, 9)[::-1]
    close(kernel()({"x": x, "y": y}, NUMBERS, TABLES), x, y)
    whole = np.arange(27).reshape(9, 3)
    close(kernel()({"x": whole, "y": y}, {"u": [1, -2, 0.5]}, TABLES), whole, y)


def test_outputs_are_written_where_they_are_wanted():
    x, y = np.ones((5, 3)), np.arange(5.0)
    place = np.full((5, 2), np.nan)
    found = kernel()({"x": x, "y": y}, NUMBERS, TABLES, out=[None, place])
    assert found[1] is place
    close(found, x, y)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"inputs": {"x": np.ones((5, 3))}}, "y is not given"),
        ({"inputs": {"x": np.ones((5, 2)), "y": np.ones(5)}}, r"x: \(5, 2\) is not \(m, 3\)"),
        ({"inputs": {"x": np.ones((5, 3)), "y": np.ones(4)}}, "y has 4 rows, not 5"),
        ({"inputs": {"x": np.ones((5, 3)), "y": 1.0}}, r"y: \(1,\)|y has 1 rows, not 5"),
        ({"numbers": None}, "u is not given"),
        ({"numbers": {"u": 1.0}}, r"u: \(\) is not \(3,\)"),
        ({"tables": {"t": np.ones((4, 3))}}, r"t: \(4, 3\) is not \(m, 2\)"),
        ({"tables": {"t": np.ones((0, 2))}}, "t has no rows"),
        ({"out": [np.empty(4)]}, r"out\[0\]"),
        ({"out": [np.empty(5, dtype=np.float32)]}, r"out\[0\]: float32"),
        ({"out": [np.empty(10)[::2]]}, "C-contiguous"),
        ({"out": [None] * 5}, "5 arrays for 4 outputs"),
    ],
)
def test_wrong_arguments_are_named(change, message):
    arguments = {"inputs": {"x": np.ones((5, 3)), "y": np.ones(5)}, "numbers": NUMBERS,
                 "tables": TABLES}  # fmt: skip
    with pytest.raises(ValueError, match=message):
        kernel()(**(arguments | change))


def test_threads_compile_and_call_at_once():
    x, y = np.ones((50, 3)), np.arange(50.0)
    with ThreadPoolExecutor(6) as pool:
        made = [pool.submit(kernel, lanes) for lanes in (1, 2, 4, 8, 4, 2)]
        kernels = [future.result() for future in made]
        calls = [pool.submit(k, {"x": x, "y": y}, NUMBERS, TABLES, threads=2)
                 for k in kernels * 10]  # fmt: skip
        for call in calls:
            close(call.result(), x, y)


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_processes_compile_at_once(method, tmp_path, monkeypatch):
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} here")
    monkeypatch.setenv("SPACEARM_CACHE", str(tmp_path))
    kernel(2)
    with ProcessPoolExecutor(3, multiprocessing.get_context(method)) as pool:
        assert [*pool.map(in_process, range(6))] == [*range(6)]
    assert len([*(tmp_path / "code").iterdir()]) == 2


@pytest.mark.parametrize("threads", [1, 3])
def test_what_runs_long_is_compiled_for_speed_as_it_runs(threads, monkeypatch, tmp_path):
    monkeypatch.setenv("SPACEARM_CACHE", str(tmp_path))
    k, x = kernel(), np.random.default_rng(0).uniform(-3, 3, (50_000, 3))
    assert len(k._codes) == 1
    for _ in range(200):
        close(k({"x": x, "y": x[:, 0]}, NUMBERS, TABLES, threads=threads), x, x[:, 0])
        if len(k._codes) == 2:
            break
    assert len(k._codes) == 2
    assert len([*(tmp_path / "code").iterdir()]) == 2
    assert len(kernel()._codes) == 1
    assert kernel()._left is None  # what was compiled for speed is taken at once


def test_without_inputs_there_is_one_row():
    found = compiled(lambda u: u * 2.0, {}, {"u": (2,)})({}, {"u": [1.0, 2.0]})
    np.testing.assert_array_equal(found, [[2.0, 4.0]])


def test_constants_and_empty_arrays_are_returned():
    one, none, x = compiled(lambda x, e: (np.ones((2, 2)), e, x), {"x": (), "e": (0,)}, lanes=4)(
        {"x": np.arange(3.0), "e": np.empty((3, 0))}
    )
    np.testing.assert_array_equal(one, np.ones((3, 2, 2)))
    assert none.shape == (3, 0)
    np.testing.assert_array_equal(x, np.arange(3.0))


def test_shared_numbers_may_change_in_place():
    k, u = compiled(lambda x, u: x * (3.0 * u), {"x": ()}, {"u": ()}), np.array(1.0)
    x = np.arange(5.0)
    for value in (1.0, 2.0, 2.0, 0.0, -0.0, 1.0):
        u[...] = value
        found = k({"x": x}, {"u": u})
        np.testing.assert_array_equal(found, x * (3.0 * value))
        np.testing.assert_array_equal(np.signbit(found[1:]), np.full(4, np.signbit(value)))
