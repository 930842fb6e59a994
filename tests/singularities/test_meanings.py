"""One question, one number: how far the nearest singular posture is, wherever it is asked."""

import json

import numpy as np
import pytest
from helpers.arms import chosen, load_text, random_chain
from helpers.commands import spacearm

import spacearm as sa
from spacearm.singularities import nearest
from spacearm.singularities.nearest import distances_found
from spacearm.viewer.session import Session

KINDS = ("revolute", "prismatic")
PLACES = {
    "planar2": lambda: sa.load("planar2"),
    "mda6": lambda: sa.load("mda6"),
    "chaser7": lambda: sa.load("chaser7"),
    "two tips": lambda: sa.load("dual_ur5", tip=("left", "right"), task="position"),
    "six joints": lambda: load_text(random_chain(11, 6), tip="tip"),
    "some slide": lambda: load_text(random_chain(chosen(5), 6, KINDS), tip="tip"),
    "x y of three": lambda: sa.load("planar3", task="x y"),
}
"""Arms; those of random chains are in no catalogue."""
LARGE = ("chaser7", "two tips", "some slide")
SOME_SLOW = [
    pytest.param(name, marks=pytest.mark.slow) if name in LARGE else name for name in PLACES
]


def same(value):
    return pytest.approx(value, rel=1e-6, abs=1e-8)


def answers(arm, q, mode="free-floating"):
    """How far the nearest singular posture is [rad], as each part of the package has it."""
    said = {
        "nearest": sa.singular_set(arm, mode=mode).nearest(q).distance,
        "singularity": sa.singularity(arm.at(q), mode=mode, exact=True).distance,
    }
    if mode == "free-floating":
        about = sa.uncertain(arm, {arm.whole.massive()[0]: {"mass": 1e-9}})
        said["range"] = sa.distance_range(about, q, samples=1).nominal
    if len(arm.tips) == 1:
        page = Session(arm, arm.at(q))
        page.handle({"do": "spacecraft", "mode": mode})
        said["page"] = page.readout()["distance"]
    return said


@pytest.mark.parametrize("name", SOME_SLOW)
@pytest.mark.parametrize("mode", ["free-floating", "attitude-controlled"])
def test_every_part_says_the_same(name, mode):
    arm, rng = PLACES[name](), np.random.default_rng(3)
    Q = rng.uniform(-1.5, 1.5, (3, arm.n)) * np.where(arm.slides, 0.1, 1.0)
    along = distances_found(arm, mode, Q)
    for q, found in zip(Q, along, strict=True):
        said = answers(arm, q, mode)
        assert said == dict.fromkeys(said, same(found))


def test_far_away_no_part_says_that_it_is_farther(tmp_path):
    """To first order nothing is known there: the estimate is many times the distance."""
    arm = sa.load("planar2")
    q = np.radians([0.0, 103.15])
    found = sa.singular_set(arm).nearest(q)
    assert np.radians(74.9) < found.distance_proven <= found.distance < np.radians(75.1)
    hint = sa.singularity(arm.at(q))
    assert hint.distance > 5.0 * found.distance
    assert "first-order estimate is above 90°" in hint.verdict
    assert sa.evaluate(arm, q[None], ["distance"])["distance"][0] == same(hint.distance)

    motion = sa.plan(arm.at(q), sa.Joints(q + 0.02))
    assert motion.distance[0] == same(found.distance)
    rows = {row[0]: row[1] for row in motion.describe().tables[1].rows}
    assert rows["distance of a singular posture found"].value == same(found.distance)
    assert "found 7" in motion.clear
    assert motion.nearest.distance <= found.distance * (1.0 + 1e-9)
    axes = sa.plot(motion).axes[-1]
    assert axes.get_ylabel() == "to a singular\nposture found [deg]"

    said = answers(arm, q)
    assert said == dict.fromkeys(said, same(found.distance))
    degrees = [str(x) for x in np.degrees(q)]
    told = json.loads(spacearm("query", "planar2", "--json", "--deg", *degrees).stdout)
    assert told["distance"] == same(found.distance)
    path = tmp_path / "path.csv"
    path.write_text(" ".join(degrees) + "\n0 1\n", encoding="utf-8")
    told = json.loads(spacearm("path", "planar2", path, "--json", "--deg").stdout)
    assert told["distance"][0] == same(found.distance)


@pytest.mark.parametrize("name", SOME_SLOW)
def test_along_a_motion_every_row_has_the_distance_of_its_posture(name):
    arm, rng = PLACES[name](), np.random.default_rng(4)
    ends = rng.uniform(-1.0, 1.0, (2, arm.n)) * np.where(arm.slides, 0.1, 1.0)
    Q = ends[0] + np.linspace(0.0, 1.0, 41)[:, None] ** 2 * (ends[1] - ends[0])
    along = distances_found(arm, "free-floating", Q)
    each = [sa.singularity(arm.at(q), exact=True) for q in (*Q[::6], Q[-1])]
    found = np.array([report.distance for report in each])
    assert (along[[0, -1]] <= found[[0, -1]] * (1 + 1e-6)).all()  # rows that are searched anew
    if len(arm.tips) == 1:  # with 12 joints a row that is not may be told more
        assert (along[::6] <= found[:-1] * (1 + 1e-6)).all()
    assert (along[::6] >= np.array([report.distance_proven for report in each[:-1]])).all()
    steps = np.linalg.norm(np.diff(Q, axis=0) / sa.singularity(arm.at(Q[0])).radian, axis=1)
    assert (np.abs(np.diff(along)) <= steps * (1 + 1e-6)).all()  # no distance changes faster


def test_rows_of_a_long_motion_that_are_not_searched_have_upper_bounds(monkeypatch):
    """A singular posture is at the distance of each row; those of the least ones are searched."""
    arm = sa.load("planar2")
    t = np.linspace(0.0, 1.0, 201)
    Q = np.column_stack((0.3 + t, 0.9 + 0.4 * np.sin(9.0 * t)))
    exact = distances_found(arm, "free-floating", Q)
    monkeypatch.setattr(nearest, "MOST_SETTLED", 40)
    told = []
    along = distances_found(arm, "free-floating", Q, progress=lambda *done: told.append(done))
    assert (along >= exact * (1.0 - 1e-6)).all()
    assert (along <= exact + np.linalg.norm(np.diff(Q, axis=0), axis=1).sum() / 37.0).all()
    assert along.min() == same(exact.min())
    assert along.argmin() == exact.argmin()
    assert told == sorted(told)
    assert told[-1] == (1000, 1000)


def test_where_the_task_can_never_be_done_the_distance_is_zero():
    arm = sa.load("planar2", task="x y rz")
    assert (distances_found(arm, "free-floating", np.zeros((3, 2))) == 0.0).all()
