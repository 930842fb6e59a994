"""Arms of so many joints that their equations are not compiled: computed singly, or refused."""

import os
import subprocess
import sys

import numpy as np
import pytest
from helpers.arms import load_text
from helpers.long_arms import in_a_row
from helpers.memory import END

import spacearm as sa
from spacearm.compiler import expressions
from spacearm.mechanics import arm_kernels
from spacearm.mechanics.arm_kernels import ArmKernel
from spacearm.mechanics.distance import linearise, seconds_of_linearising
from spacearm.singularities import nearest
from spacearm.singularities.nearest import NearestSearch, SearchEffort, distances_found, effort_of


@pytest.fixture
def nothing_is_compiled(monkeypatch):
    arm_kernels._compiled.cache_clear()
    effort_of.cache_clear()
    monkeypatch.setattr(expressions, "LONGEST", 10)
    yield
    arm_kernels._compiled.cache_clear()
    effort_of.cache_clear()


def computed(arm, Q):
    rates = np.full_like(Q, 0.1)
    return [
        *sa.evaluate(arm, Q, ["sigma_min", "condition", "distance"]).values(),
        sa.generalized_jacobians(arm, Q),
        sa.joint_accelerations(arm, Q, rates, Q),
        *linearise(arm, Q)[:2],
    ]


@pytest.mark.usefixtures("nothing_is_compiled")
def test_what_is_not_compiled_is_computed_singly(monkeypatch):
    arm, Q = sa.load("chaser7"), np.random.default_rng(0).uniform(-2, 2, (12, 7))
    singly = computed(arm, Q)
    monkeypatch.undo()
    arm_kernels._compiled.cache_clear()
    for a, b in zip(singly, computed(arm, Q), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9)


@pytest.mark.usefixtures("nothing_is_compiled")
def test_what_nothing_else_computes_is_refused_with_the_bound():
    kernel = ArmKernel([sa.load("planar2")], "free-floating", sines)
    for _ in range(2):
        with pytest.raises(sa.UnsupportedError, match=r"2 joints .*more than 10 operations.*lock"):
            kernel({"q": np.zeros((3, 2))})


def sines(xp, _tree, _parameters, q):
    return xp.stack([xp.sin(q[0] * i) for i in range(20)])


def test_what_is_compiled_is_searched_with_all_starts():
    assert effort_of(sa.load("planar2"), "free-floating", 100, 1) == SearchEffort()


@pytest.mark.usefixtures("nothing_is_compiled")
@pytest.mark.parametrize("n", [10, 40, 100, 200])
def test_a_search_takes_as_many_steps_as_its_time_allows(n):
    arm = load_text(in_a_row(n))
    effort = effort_of(arm, "free-floating", 100, 1)
    seconds = seconds_of_linearising(arm, "free-floating", 100)
    assert effort.linearised(n) * seconds < 3.0 * nearest.PATIENCE
    assert min(effort.starts) >= 1
    shared = effort_of(arm, "free-floating", 100, 10)
    assert shared.linearised(n) <= effort.linearised(n)


@pytest.mark.slow
@pytest.mark.usefixtures("nothing_is_compiled")
def test_a_search_of_few_starts_finds_a_singular_posture(monkeypatch):
    monkeypatch.setattr(nearest, "PATIENCE", 0.3)
    arm, counted = load_text(in_a_row(12)), list[int]()
    q = 0.3 * np.sin(1.0 + np.arange(12))
    search = NearestSearch(arm, "free-floating", q[None], linearised=counted.append)
    assert search.effort.starts < SearchEffort().starts
    found = search.nearest()
    assert sum(counted) < 2 * search.effort.linearised(12)
    assert sa.singularity(arm.at(q + found)).distance < 1e-6
    (alone,) = distances_found(arm, "free-floating", q[None])
    assert alone == pytest.approx(np.linalg.norm(found), rel=0.2)


#: Argument: a file. Prints the largest memory of the process in MB.
QUERY = (
    """
import resource, sys
import numpy as np
from spacearm.cli.app import main
n = int(sys.argv[2])
angles = [f"{x:.3f}" for x in 0.3 * np.sin(1.0 + np.arange(n))]
sys.argv = ["spacearm", "query", sys.argv[1], "--", *angles]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
"""
    + END
)


@pytest.mark.slow
@pytest.mark.parametrize("n", [40, 80, 100])
def test_a_query_of_a_long_arm_answers_in_little_memory(n, tmp_path):
    path = tmp_path / "long.urdf"
    path.write_text(in_a_row(n), encoding="utf-8")
    environment = os.environ | {"SPACEARM_CACHE": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", QUERY, str(path), str(n)],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "regular: " in done.stdout
    assert int(done.stdout.split()[-1]) < 1000


@pytest.mark.slow
def test_a_hundred_joints_in_a_row_answer():
    arm = load_text(in_a_row(100))
    q = 0.3 * np.sin(1.0 + np.arange(100))
    report = sa.singularity(arm.at(q))
    assert report.sigma_min > 0.0
    found = sa.evaluate(arm, [q, q], "sigma_min")["sigma_min"]
    np.testing.assert_allclose(found, report.sigma_min, rtol=1e-9, atol=1e-12)
