"""Files of motions: what other programs read is the motion."""

import json
import sys

import numpy as np
import pytest
import xarray as xr
from scipy.io import loadmat

import spacearm as sa


@pytest.fixture(scope="module")
def way():
    return sa.follow(sa.load("planar2").at([0.3, 1.2]), [(1.5, 1.2)])


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


@pytest.fixture(scope="module")
def pushed():
    law = sa.JointPD(target=[0.5, 0.6], kp=4.0, kd=8.0)
    push = {"spacecraft": lambda t: [t, 0, 0, 0, 0, 1], "link_2": [0, 2, 0, 0, 0, 0]}
    return sa.simulate(
        sa.load("planar2").at([0.3, 0.9]),
        law,
        0.5,
        plant=sa.Plant(wrenches=push),
        integration=sa.Integration(dt=0.01),
    )


def test_wrenches_of_each_link(pushed, tmp_path):
    path = sa.write_motion(pushed, tmp_path / "run.csv")
    heads = path.read_text().splitlines()[0].split(",")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert table.shape[1] == len(heads) == len(set(heads))
    column = heads.index("wrenches spacecraft px [N; N m]")
    np.testing.assert_array_equal(table[:, column], pushed.wrenches["spacecraft"][:, 0])
    with xr.open_dataset(sa.write_motion(pushed, tmp_path / "run.nc")) as found:
        np.testing.assert_array_equal(
            found.wrenches.sel(link="link_2").values, pushed.wrenches["link_2"]
        )
    found = loadmat(sa.write_motion(pushed, tmp_path / "run.mat"), simplify_cells=True)
    assert list(found["link"]) == ["spacecraft", "link_2"]
    np.testing.assert_array_equal(found["wrenches"][:, 1], pushed.wrenches["link_2"])


def test_a_saved_trajectory_is_loaded_with_its_wrenches(pushed, tmp_path):
    pushed.save(tmp_path / "run.npz")
    again = sa.Trajectory.load(tmp_path / "run.npz", pushed.arm)
    xr.testing.assert_identical(again.to_xarray(), pushed.to_xarray())
    assert [*again.wrenches] == ["spacecraft", "link_2"]


def test_zarr(way, tmp_path):
    pytest.importorskip("zarr", reason="needs Python 3.11")
    path = sa.write_motion(way, tmp_path / "way.zarr")
    sa.write_motion(way, path)  # in its place
    with xr.open_zarr(path) as found:
        xr.testing.assert_identical(found.load(), way.to_xarray())
    assert [entry.name for entry in tmp_path.iterdir()] == ["way.zarr"]
    (other := tmp_path / "other.zarr").mkdir()
    (other / "letters").touch()
    with pytest.raises(sa.SpaceArmError, match="something else"):
        sa.write_motion(way, other)
    assert (other / "letters").exists()


def test_suffixes_in_capitals_are_those_in_small_letters(way, tmp_path):
    small, large = (sa.write_motion(way, tmp_path / name) for name in ("way.csv", "WAY.CSV"))
    assert small.read_bytes() == large.read_bytes()
    pytest.importorskip("zarr", reason="needs Python 3.11")
    store = sa.write_motion(way, tmp_path / "WAY.ZARR")
    assert sa.write_motion(way, store) == store  # replaced, as one of its kind
    with xr.open_zarr(store) as found:
        np.testing.assert_allclose(found["q"], way.q, atol=0)


def test_a_bag_of_ros_messages(pushed, tmp_path):
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    run = pushed
    path = sa.write_motion(run, tmp_path / "run.mcap")
    found = {}
    with path.open("rb") as file:
        bag = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        assert bag.get_header().profile == "ros2"
        for _, channel, raw, message in bag.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((raw.log_time, message))
    times = [time for time, _ in found["/joint_states"]]
    np.testing.assert_allclose(np.array(times) * 1e-9, run.t, atol=1e-9)
    states, placed = ([message for _, message in found[x]] for x in ("/joint_states", "/tf"))
    np.testing.assert_array_equal([state.position for state in states], run.q)
    np.testing.assert_array_equal([state.velocity for state in states], run.dq)
    np.testing.assert_array_equal([state.effort for state in states], run.torque)
    assert list(states[0].name) == list(run.arm.joint_names)
    stamp = states[-1].header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == times[-1]
    for message, pose in zip(placed, run.base, strict=True):
        (spacecraft,) = message.transforms
        assert (spacecraft.header.frame_id, spacecraft.child_frame_id) == ("world", "spacecraft")
        at, turn = spacecraft.transform.translation, spacecraft.transform.rotation
        assert (at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w) == tuple(pose)
    np.testing.assert_array_equal([x.data for _, x in found["/sigma_min"]], run.sigma_min)
    np.testing.assert_array_equal([x.data for _, x in found["/momentum"]], run.momentum)
    rows = np.reshape([x.data for _, x in found["/wrenches"]], (-1, 2, 6))
    np.testing.assert_array_equal(rows[:, 1], run.wrenches["link_2"])
    dims = found["/wrenches"][0][1].layout.dim
    assert [(dim.label, dim.size, dim.stride) for dim in dims] == [
        ("link", 2, 12), ("component", 6, 6),
    ]  # fmt: skip
    assert set(found) == {"/joint_states", "/tf"} | {
        f"/{name}" for name in run.to_xarray() if name not in ("q", "dq", "base", "torque")
    }


@pytest.mark.parametrize(("suffix", "module", "extra"), [
    (".mcap", "mcap_ros2.writer", "mcap"), (".zarr", "zarr", "sweep"),
])  # fmt: skip
def test_a_missing_extra_is_named(way, tmp_path, monkeypatch, suffix, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(sa.UnsupportedError, match=rf"pip install 'spacearm\[{extra}\]'"):
        sa.write_motion(way, tmp_path / f"way{suffix}")


def test_other_suffixes_and_things_are_refused(way, tmp_path):
    with pytest.raises(sa.ConfigurationError, match=r"\.xls"):
        sa.write_motion(way, tmp_path / "way.xls")
    with pytest.raises(sa.ConfigurationError, match="motion is a SpaceArm; give a motion"):
        sa.write_motion(way.arm, tmp_path / "way.csv")
