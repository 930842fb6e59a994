"""The archive of benchmark results (benchmarks/archive.py): what is written, and its plot."""

import json

import archive
import matplotlib.image
import numpy as np
import pytest

import spacearm as sa


def test_a_run_is_archived_with_its_machine(tmp_path):
    path = archive.archive(tmp_path / "results", lambda: {"a Jacobian [us]": 3.0})
    run = json.loads(path.read_text())
    assert path.name.startswith(sa.__version__)
    assert run["figures"] == {"a Jacobian [us]": 3.0}
    assert run["machine"]["cores"] >= 1
    assert set(run["machine"]["packages"]) == set(archive.PEERS)


def test_runs_of_several_machines_and_figures_are_drawn(tmp_path):
    names = {"a.json": ("2027-01-02", "one", {"x [us]": 2.0}), "b.json": ("2027-01-01", "two", {})}
    for name, (date, processor, figures) in names.items():
        run = {"version": "9", "date": date, "machine": {"processor": processor}}
        run["figures"] = {"y [ms]": 5.0} | figures
        (tmp_path / name).write_text(json.dumps(run))
    picture = matplotlib.image.imread(archive.draw(tmp_path))
    assert picture.shape[1] == 8 * 120
    assert np.ptp(picture) > 0.5


@pytest.mark.parametrize("per", [1, 10])
def test_the_shortest_run_counts_and_the_first_do_not(monkeypatch, per):
    ticks = iter([0.0, 0.0, 0.5, 5.0, 10.0, 12.0, 20.0, 24.0, 30.0, 37.0, 40.0, 48.0, 50.0, 56.0])
    monkeypatch.setattr(archive.time, "perf_counter", lambda: next(ticks))
    calls = []
    assert archive.shortest(lambda: calls.append(1), per, 1e3) == 2e3 / per
    assert len(calls) == 2 + archive.ROUNDS
