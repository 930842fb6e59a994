"""Progress of calls from Python: what takes long is shown on a terminal, once, and taken away."""

import io
import sys
import threading
import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

import spacearm as sa
from spacearm import signatures
from spacearm.signatures import checked

ARM = sa.load("planar2")
Q = np.zeros((4, 2))


class Terminal(io.StringIO):
    """What is written to a terminal."""

    def isatty(self):
        return True


@pytest.fixture
def watch(monkeypatch):
    """A watch of this test, impatient."""
    monkeypatch.setattr(signatures, "PATIENCE", 0.1)
    monkeypatch.setattr(signatures, "LOOK", 0.02)
    own = signatures.Watch()
    monkeypatch.setattr(signatures, "WATCH", own)
    return own


@checked
def slow(until: Callable[[], bool], *, progress=None):
    """Wait until something is so, for a minute at most."""
    sa.evaluate(ARM, Q, quantities=("distance",))  # within it, and not shown
    if progress:
        progress(1, 4)
    ends = time.monotonic() + 60.0
    while not until() and time.monotonic() < ends:
        time.sleep(0.01)


def test_a_terminal_shows_what_takes_long_until_it_is_done(watch, monkeypatch):
    shown = Terminal()
    monkeypatch.setattr("sys.stderr", shown)
    slow(lambda: "25%" in shown.getvalue())
    line = shown.getvalue().split("\r")
    assert line[1].startswith("sa.slow: 0 s, 25%")
    assert line[-1] == ""
    assert line[-2].isspace()
    assert len(line[-2]) >= len(line[1])
    assert "evaluate" not in shown.getvalue()
    assert watch.call is None


def test_what_is_quick_is_not_shown_nor_is_anything_where_nobody_looks(watch, monkeypatch):
    shown = Terminal()
    monkeypatch.setattr("sys.stderr", shown)
    monkeypatch.setattr(signatures, "PATIENCE", 60.0)
    slow(lambda: True)
    assert not shown.getvalue()
    monkeypatch.setattr("sys.stderr", io.StringIO())
    assert not watch.idle()


def test_a_notebook_shows_it_below_the_cell_that_calls(watch, monkeypatch):
    """Threads write to the cell in which they began: each cell has one of its own."""
    shown, cells = [], []

    def publish(data, *, transient, update):
        shown.append((data["text/html"], transient["display_id"], update))
        cells.append(threading.current_thread())

    monkeypatch.setitem(
        sys.modules, "IPython.display", SimpleNamespace(publish_display_data=publish)
    )
    for cell in ("a", "b"):
        shown.clear()
        notebook = io.StringIO()
        notebook.parent_header = {"msg_id": cell}
        monkeypatch.setattr("sys.stderr", notebook)
        slow(lambda: any("25%" in line for line, _, _ in shown))
        lines, names, updates = zip(*shown, strict=True)
        assert lines[0].startswith("sa.slow: 0 s, 25%")
        assert lines[-1] == ""
        assert len(set(names)) == 1
        assert updates == (False, *[True] * (len(shown) - 1))
        assert not notebook.getvalue()
    assert len(set(cells)) == 2
    assert watch.call is None


def test_an_error_ends_the_line(watch, monkeypatch):
    monkeypatch.setattr("sys.stderr", Terminal())
    with pytest.raises(sa.ConfigurationError, match="until"):
        slow("long")
    with pytest.raises(ZeroDivisionError):
        slow(lambda: 1 / 0 > 1)
    assert watch.idle()


@pytest.mark.usefixtures("watch")
def test_progress_that_is_asked_for_goes_where_it_is_wanted(monkeypatch):
    monkeypatch.setattr("sys.stderr", Terminal())
    heard = []
    slow(lambda: True, progress=lambda *told: heard.append(told))
    assert heard == [(1, 4)]
