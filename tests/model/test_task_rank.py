"""Tasks that an arm can never do: said with rows and remedy, refused where they mean nothing."""

import math
import warnings
from itertools import combinations

import numpy as np
import pytest
from helpers.arms import frame, joint, link, load_text, random_chain, random_tree, robot
from helpers.commands import answer, spacearm
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa
from spacearm.model.arguments import impossible
from spacearm.model.task import ROWS
from spacearm.viewer.readouts import readout

MODES = ("free-floating", "attitude-controlled", "fixed")


def chain(*joints, tip=(0.5, 0, 0), com=(0.25, 0.01, 0.02)) -> str:
    """An arm of joints (kind, axis), half a metre apart."""
    elements, parent = [link("bus", 50.0, inertia=np.diag([8.0, 9.0, 10.0]))], "bus"
    for i, (kind, axis) in enumerate(joints, 1):
        elements += [link(f"l{i}", 2.0, com=com, inertia=np.diag([0.2, 0.3, 0.4]))]
        elements += [joint(f"j{i}", parent, f"l{i}", kind, axis=axis)]
        parent = f"l{i}"
    return robot(*elements, frame("end"), joint("fix", parent, "end", "fixed", tip))


X, Y, Z = np.eye(3)
TURN, SLIDE = "revolute", "prismatic"
PAN_TILT = chain((TURN, Z), (TURN, Y))
PLANAR = chain((TURN, Z), (TURN, Z), (TURN, Z), com=(0.25, 0, 0))


def ranks(arm: sa.SpaceArm, mode: str) -> int:
    """The largest rank of J* at random postures, by Pinocchio's matrices."""
    Q = np.random.default_rng(5).uniform(-2.0, 2.0, (4, arm.n))
    rows = [ROWS.index(row) for row in arm.task.rows]  # of the spacecraft, whose attitude is 1
    J = [sa.generalized_jacobian(arm.at(q), mode=mode)[rows] for q in Q]
    return max(int(np.linalg.matrix_rank(one, tol=1e-9)) for one in J)


@given(st.integers(0, 10**6), st.integers(1, 7), st.sampled_from(["chain", "tree"]), st.data())
def test_a_task_is_impossible_where_the_jacobian_never_has_full_rank(seed, n, kind, data):
    count = data.draw(st.integers(1, 6))
    rows = data.draw(st.permutations(ROWS))[:count]
    make = random_chain if kind == "chain" else random_tree
    options = {"tip": "tip"} if kind == "chain" else {"tip": f"link_{n}"}
    arm = load_text(make(seed, n), task=sa.Task(" ".join(rows), length=_length(rows)), **options)
    for mode in MODES:
        assert bool(impossible(arm, mode)) == (ranks(arm, mode) < arm.task.k)


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        PAN_TILT,
        PLANAR,
        chain((TURN, Z), (TURN, Y), (TURN, X), com=(0.25, 0, 0)),  # the tip is on the last axis
        chain((SLIDE, X), (SLIDE, Y)),
        chain((SLIDE, Z)),
        chain((TURN, (0, 0.6, 0.8)), (TURN, (0, 0.6, 0.8)), (TURN, (0, 0.6, 0.8))),
    ],
)
def test_special_arms_are_told_apart_as_random_ones(text):
    read = load_text(text, task="z")
    for count in (1, 2, 3, 6):
        for rows in combinations(ROWS, count):
            arm = read.replace(task=sa.Task(" ".join(rows), length=_length(rows)))
            for mode in MODES:
                fault = impossible(arm, mode)
                assert bool(fault) == (ranks(arm, mode) < count)
                for other in fault.partition("; ")[2].split("'")[1::2]:
                    assert not impossible(arm.replace(task=other), mode)


def _length(rows):
    """The length of a mixed task."""
    return 1.0 if {len(row) for row in rows} == {1, 2} else None


@pytest.mark.parametrize(
    ("text", "task"),
    [
        (PLANAR, "x y rz"),
        (chain((SLIDE, Z)), "z"),  # x and y move by the reaction only
        (chain((SLIDE, X), (SLIDE, Z)), "x z"),
        (chain((TURN, Z), com=(0, 0, 0), tip=(0, 0, 0)), "rz"),
    ],
)
def test_the_default_is_a_task_that_the_arm_can_do(text, task):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm = load_text(text)
    assert arm.task.names == task
    assert not impossible(arm, "free-floating")


def test_where_there_is_doubt_the_load_says_so_once():
    with pytest.warns(
        sa.ModelWarning, match="2 joints can move only 2 of the 3 rows x y z"
    ) as told:
        arm = load_text(PAN_TILT)
    assert len([one for one in told if "impossible" in str(one.message)]) == 1
    assert "task='x y' or task='x z' or task='y z' would do" in arm.notes[-1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not arm.replace(task="x z").notes


def test_the_verdict_names_rows_and_remedy():
    arm = load_text(PLANAR, task="position")
    report = sa.singularity(arm.at([0.3, 0.4, 0.5]), exact=True)
    assert report.verdict == arm.notes[-1] == report.impossible
    assert "singular set" not in " ".join(report.describe().notes)  # all postures are singular
    assert "row z never moves; task='x y' would do" in report.verdict
    assert report.to_dict()["impossible"] == readout(report)["impossible"] == report.impossible
    assert report.distance == 0.0
    possible = sa.singularity(arm.replace(task="x y").at([0.3, 0.4, 0.5]))
    assert possible.impossible == ""
    assert possible.kind == "regular"


def test_what_the_tip_can_do_depends_on_what_the_spacecraft_does():
    """A wrist that turns about the tip moves it by the reaction of the spacecraft alone."""
    arm = load_text(chain((TURN, Z), (TURN, Y), (TURN, X), com=(0.25, 0, 0)))
    cfg = arm.at([0.3, 0.4, 0.5])
    assert arm.notes == ()
    assert sa.singularity(cfg).impossible == ""
    assert "only 2 of the 3 rows" in sa.singularity(cfg, mode="fixed").verdict


@pytest.mark.parametrize(
    "ask",
    [
        sa.singular_set,
        sa.singular_map,
        sa.workspace,
        sa.risk_profile,
        sa.pose_risk,
        lambda arm: sa.plan(arm.at([0.3, 0.4]), [0.5, 0.1, 0.2]),
        lambda arm: sa.free_box(arm.at([0.3, 0.4])),
        lambda arm: sa.follow(arm.at([0.3, 0.4]), np.zeros((3, 3))),
    ],
)
def test_questions_without_meaning_are_refused(ask):
    arm = load_text(PAN_TILT)
    with pytest.raises(sa.UnsupportedError, match=r"'position' is impossible .* task='x y'"):
        ask(arm)


def test_on_the_command_line_the_remedy_is_an_option(tmp_path):
    path = tmp_path / "pan_tilt.urdf"
    path.write_text(PAN_TILT)
    run = spacearm("query", path, 0.3, 0.4)
    said = " ".join(run.stdout.split())
    assert "the task 'position' is impossible at every posture" in said
    assert "--task 'x y'" in said
    assert "--task 'x y'" in run.stderr
    assert "impossible" not in spacearm("query", path, 0.3, 0.4, "--task", "x y").stderr
    assert answer("query", path, 0.3, 0.4, "--task", "x y")["kind"] == "regular"
    refused = spacearm("path", path, _postures(tmp_path))
    assert refused.returncode == 2
    assert "impossible at every posture" in refused.stderr
    assert math.isfinite(answer("nearest", path, 0.3, 0.4, "--task", "x y")["distance"])


def _postures(folder):
    path = folder / "way.txt"
    path.write_text("0.3 0.4\n0.5 0.6\n")
    return path


def test_two_tips_on_one_arm_cannot_go_everywhere():
    """Both tips on one chain of six joints: twelve rows of which six are independent."""
    arm = load_text(random_chain(3, 6), tip=("link_5", "tip"), task="pose")
    assert "6 joints can move only 6 of the 12 rows x y z rx ry rz of all tips" in arm.notes[-1]
    assert not arm.replace(task="position").fault_of_task()
