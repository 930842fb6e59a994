"""Files of motions: what other programs read is the motion."""

import json

import numpy as np
import pytest
import xarray as xr
from scipy.io import loadmat

import spacearm as sa


@pytest.fixture(scope="module")
def way():
    return sa.follow(sa.load("planar2"), [0.3, 1.2], [(1.5, 1.2)])


def test_a_table(way, tmp_path):
    path = sa.write_motion(way, tmp_path / "way.csv")
    heads = path.read_text().splitlines()[0].split(",")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert table.shape == (len(way), len(heads))
    for name, values in (("t [s]", way.t), ("q joint_2 [rad]", way.q[:, 1])):
        np.testing.assert_array_equal(table[:, heads.index(name)], values)
    np.testing.assert_array_equal(table[:, heads.index("tip qw [1]")], way.tip[:, 6])


def test_matlab(way, tmp_path):
    found = loadmat(sa.write_motion(way, tmp_path / "way.mat"), simplify_cells=True)
    np.testing.assert_array_equal(found["q"], way.q)
    np.testing.assert_array_equal(found["base"], way.base)
    assert list(found["joint"]) == list(way.arm.joint_names)
    assert "rad" in found["units"]["q"]


def test_a_joint_trajectory(way, tmp_path):
    message = json.loads(sa.write_motion(way, tmp_path / "way.json").read_text())
    assert message["joint_names"] == list(way.arm.joint_names)
    assert len(message["points"]) == len(way)
    last = message["points"][-1]
    time = last["time_from_start"]
    assert 0 <= time["nanosec"] < 10**9
    assert time["sec"] + 1e-9 * time["nanosec"] == pytest.approx(way.t[-1] - way.t[0], abs=1e-9)
    assert last["positions"] == way.q[-1].tolist()
    assert last["velocities"] == way.dq[-1].tolist()


def test_netcdf(way, tmp_path):
    with xr.open_dataset(sa.write_motion(way, tmp_path / "way.nc")) as found:
        np.testing.assert_array_equal(found["q"].values, way.q)
        assert found.attrs["arm"] == "planar2"


def test_other_suffixes_and_things_are_refused(way, tmp_path):
    with pytest.raises(sa.ConfigurationError, match=r"\.xls"):
        sa.write_motion(way, tmp_path / "way.xls")
    with pytest.raises(sa.UnsupportedError, match="no motion"):
        sa.write_motion(way.arm, tmp_path / "way.csv")
