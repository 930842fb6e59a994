"""What a workspace states about each of its ranges."""

import json

import numpy as np
from helpers.arms import joint, link, load_text, robot, two_links
from helpers.commands import answer

import spacearm as sa
from spacearm.workspaces.statements import MEANING, statements


def stated(outside, uncovered, beyond=0.0, **options):
    """What is stated of a reachable, one path dependent and one path independent range."""
    found = statements(
        np.array([[0.0, 3.0]]),
        np.array([[1.0, 3.0]]),
        np.array([[0.0, 1.0]]),
        beyond=beyond,
        outside=outside,
        uncovered=np.array([uncovered]),
        certified=1e-6,
        **options,
    )
    return [one.bounds for one in found[1:]], max(one.error for one in found)


def test_a_range_is_certified_where_both_of_its_sides_are():
    assert stated(1e-9, 1e-9) == (["certified", "certified"], 1e-9)


def test_singular_postures_that_may_be_missing_widen_one_workspace_and_narrow_the_other():
    assert stated(0.5, 1e-9) == (["lower bound", "upper bound"], 0.5)


def test_distances_that_may_have_no_singular_posture_do_the_contrary():
    assert stated(1e-9, 0.3) == (["upper bound", "lower bound"], 0.3)


def test_distances_that_may_be_reachable_beyond_the_range_narrow_what_is_said_of_the_independent():
    """Postures out there may be singular or not: the path independent workspace may go on."""
    assert stated(1e-9, 1e-9, beyond=0.1) == (["certified", "lower bound"], 0.1)
    assert stated(1e-9, 1e-9, beyond=np.nan)[0] == ["certified", "lower bound"]
    assert stated(np.nan, 1e-9, beyond=np.nan)[0] == ["lower bound", "estimate"]


def test_ranges_of_a_search_and_of_a_sample_are_named_as_such():
    assert stated(0.5, 0.3) == (["estimate", "estimate"], 0.5)
    assert stated(1e-9, 1e-9, sampled=True) == (["sampled", "sampled"], 1e-9)
    unknown = np.nan
    assert stated(unknown, unknown)[0] == ["estimate", "estimate"]


def test_each_range_has_its_statement_in_all_forms():
    found = sa.workspace(sa.load("planar2"))
    ranges = np.concatenate((found.reachable, found.pdw, found.piw))
    np.testing.assert_array_equal([one.radius for one in found.statements], ranges)
    assert {one.bounds for one in found.statements} == {"certified"}
    told = found.to_dict()["statements"]
    assert [one["radius"] for one in told] == ranges.tolist()
    assert answer("workspace", "planar2", "--json")["statements"] == told
    table = found.describe().parts[0]
    assert [row[-1] for row in table.body("rad")] == ["certified to 1e-09 m"] * len(ranges)


def test_an_empty_workspace_has_a_statement_too():
    text = robot(*two_links(), link("hand"), joint("last", "arm", "hand"))
    found = sa.workspace(load_text(text, task="x"), effort=500)
    by_workspace = {one.workspace: one for one in found.statements}
    for name, ranges in (("path dependent", found.pdw), ("path independent", found.piw)):
        assert (len(by_workspace[name].radius) == 0) == (len(ranges) == 0)
        assert by_workspace[name].bounds == "sampled"
    assert any("sampled" in note for note in found.describe().notes)
    json.dumps(found.to_dict())


def test_every_word_is_explained():
    assert set(MEANING) == {"certified", "lower bound", "upper bound", "estimate", "sampled"}
