"""Arms of a study: which of their joints count."""

import pytest

import spacearm as sa
from spacearm.sweeps.study import fingerprint, read_arms
from spacearm.sweeps.toml import parse

pytest.importorskip("tomllib")  # Python 3.10 has none


def read(tmp_path, joints: str) -> sa.SpaceArm:
    text = f'arms = [{{source = "dual_ur5", {joints}}}]'
    return read_arms(parse(text), tmp_path)["dual_ur5"]


def test_joints_of_a_study_count_as_those_of_load(tmp_path):
    alone, whole = read(tmp_path, 'tip = "left"'), read(tmp_path, 'joints = "all"')
    assert (alone.n, whole.n) == (6, 12)
    assert read(tmp_path, 'joints = ["right_elbow_joint"]').n == 7
    assert fingerprint(alone) == fingerprint(sa.load("dual_ur5")) != fingerprint(whole)
    with pytest.raises(sa.ConfigurationError, match="joints is 'some'"):
        read(tmp_path, 'joints = "some"')
