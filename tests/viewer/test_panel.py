"""What stands beside the drawing, without a browser."""

import json
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.arms import chosen, joint, link, load_text, random_chain

import spacearm as sa
from spacearm.results import short_names
from spacearm.viewer.motions import account
from spacearm.viewer.readouts import about, joint_map, joints, readout

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    from spacearm.viewer.layers import SQUARES, Grid, grid_lines, step_of
    from spacearm.viewer.shapes import distance_colors, tube


class Run(sa.Motion):
    """A motion with torques and an event."""

    torque = np.array([[1.0, 2.0], [3.0, np.inf]])
    events = (SimpleNamespace(t=0.5, kind="joint limit", detail="joint_1"),)


@pytest.mark.parametrize(
    ("names", "short"),
    [
        (["vispa_joint_1", "vispa_joint_2"], ["joint_1", "joint_2"]),
        (["ur5_elbow_joint", "ur5_wrist_1_joint"], ["elbow", "wrist_1"]),
        (["left/a", "left/b"], ["a", "b"]),
        (["arm_1", "arm_10"], ["arm_1", "arm_10"]),
        (["a_joint", "b"], ["a_joint", "b"]),
        (["only_one"], ["only_one"]),
        (["x_", "x_y"], ["x", "x_y"]),
        ([], []),
    ],
)
def test_labels_drop_what_all_names_share(names, short):
    assert short_names(names) == short


@pytest.mark.parametrize("name", ["vispa_cubesat", "dual_ur5", "servicer_ur5"])
def test_labels_stay_apart_and_are_part_of_the_names(name):
    names = sa.load(name).joint_names
    short = short_names(names)
    assert len(set(short)) == len(names)
    assert all(label in whole for label, whole in zip(short, names, strict=True))


def test_wheels_are_listed_with_axis_torque_and_capacity():
    wheel = link("disc", 1.0, inertia=np.diag([1.0, 1.0, 2.0]))
    limit = '<limit effort="0.5" velocity="30"/>'
    spun = joint("spin", "bus", "disc", "continuous", axis=(0, 0, 1), inside=limit)
    text = random_chain(chosen(0), 2).replace("</robot>", f"{wheel}{spun}</robot>")
    told = about(load_text(text, wheels=["spin"]))["wheels"]
    assert told["rows"] == [["spin", "bus", "(0, 0, 1)", "0.5", "60"]]
    assert told["head"][-2:] == ["torque [N m]", "capacity [N m s]"]
    assert about(sa.load("planar2"))["wheels"]["rows"] == []


def test_a_posture_near_the_singular_set_is_near_whatever_its_condition():
    arm = sa.load("servicer_ur5")
    report = sa.singularity(arm.at(np.zeros(arm.n)))
    assert report.kind == "regular"
    assert readout(report)["near"]
    far = sa.singularity(sa.load("planar2").at([0.3, 1.2]))
    assert not readout(far)["near"]


def test_the_panel_has_what_the_command_line_prints():
    arm = sa.load("planar2")
    report = sa.singularity(arm.at(np.radians([-65, -11.41])))
    shown = readout(report)
    assert about(arm)["tip"] == arm.tip
    np.testing.assert_allclose(shown["directions"][-1], report.lost[:, 0], atol=1e-12)
    np.testing.assert_allclose(shown["gradient"], report.gradient, atol=1e-12)
    assert json.loads(json.dumps(shown, allow_nan=False)) == shown


def test_the_way_out_and_the_limits_have_the_labels_of_the_sliders():
    arm = sa.load("vispa_cubesat")
    q = np.clip(np.full(arm.n, 0.3), arm.lower, arm.upper)
    told = readout(sa.singularity(arm.at(q)))
    labels = short_names(arm.joint_names)
    assert all(part.rpartition(" ")[0] in labels for part in told["away"].split(", "))
    whole = sa.singularity(arm.at(q)).way_out
    assert told["away"] == whole.replace("vispa_", "")
    with pytest.warns(sa.ModelWarning, match="outside its limits"):
        beyond = arm.at(np.where(np.arange(arm.n) == 1, arm.upper + 0.1, q))
    assert readout(sa.singularity(beyond))["outside"] == [labels[1]]


def test_bodies_that_meet_are_named():
    arm = sa.load("mda6")
    inside = arm.at([0.8, 0.8, -2.7, -2.9, 1.9, 2.5])
    assert readout(sa.singularity(arm.at(np.full(6, 0.4))))["contacts"] == []
    assert ["spacecraft", "link_5"] in readout(sa.singularity(inside))["contacts"]
    assert not sa.collision_check(inside).apart


def test_joints_have_ranges_and_kinds():
    arm = sa.load("planar2")
    rows = joints(arm, arm.lower, arm.upper)
    assert [row["name"] for row in rows] == list(arm.joint_names)
    assert all(row["angle"] and row["lower"] < row["upper"] for row in rows)


def test_a_motion_has_curves_in_degrees_and_its_events():
    arm = sa.load("planar2")
    base = np.tile([0, 0, 0, 0, 0, 0, 1.0], (2, 1))
    told = account(Run(arm, np.array([0.0, 2.0]), np.array([[0.3, 1.2], [0.5, 1.0]]), base))
    curves = {curve["name"]: curve for curve in told["curves"]}
    shown = {"joints", "attitude", "distance", "sigma_min", "tip", "R from the CM", "torques"}
    assert set(curves) == shown
    first = [column[0] for column in curves["joints"]["values"]]
    np.testing.assert_allclose(first, np.degrees([0.3, 1.2]), atol=1e-12)
    assert all(len(column) == len(told["t"]) for c in told["curves"] for column in c["values"])
    assert told["events"] == [{"t": 0.5, "kind": "joint limit", "detail": "joint_1"}]
    joints = told["described"]["tables"][0]
    assert joints["head"][:3] == ["joint", "start", "end"]
    assert joints["rows"][1][1] == "68.755° (1.2 rad)"
    json.dumps(told, allow_nan=False)


def test_paths_are_tubes_coloured_by_the_distance():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]])
    colors = distance_colors(np.array([-1.0, 0.0, 0.5, 1.0, np.inf]))
    assert (colors[0] == colors[1]).all()
    assert (colors[3] == colors[4]).all()
    mesh = tube(points, colors, 0.1)
    rings = mesh.vertices.reshape(len(points), -1, 3)
    np.testing.assert_allclose(
        np.linalg.norm(rings - points[:, None], axis=2), 0.1, rtol=1e-4, atol=0
    )
    assert mesh.faces.max() == len(mesh.vertices) - 1


def test_the_map_is_that_of_the_other_joints_and_its_curves_are_singular():
    arm = sa.load("planar3")
    cfg = arm.at([0.3, 1.2, -0.7])
    told = joint_map(cfg, [2, 0])
    expected = sa.singular_map(arm, (arm.joint_names[2], arm.joint_names[0]), cfg.q, points=61)
    assert told["joints"] == [2, 0]
    np.testing.assert_allclose(
        np.array(told["shares"]),
        np.clip(expected.distance.T / np.radians(30), 0, 1) * 100,
        atol=0.51,
    )
    square = sa.load("mda6")
    told = joint_map(square.at(np.full(6, 0.4)), None)
    for x, y in (curve[len(curve) // 2] for curve in told["curves"]):
        q = np.full(6, 0.4)
        q[told["joints"]] = x, y
        assert sa.singularity(square.at(q)).distance < 1e-3
    json.dumps(told, allow_nan=False)


@pytest.mark.slow
def test_curves_that_cross_take_no_finer_grid_than_the_page_shows():
    """Lines that cross at a small angle part corners of a square on grids of any fineness."""
    arm, q = sa.load("mda6"), np.array([0.3, 0.4, 1.4, -0.9, 0.7, 0.2])
    found = sa.singular_set(arm, mode="fixed")
    fine, coarse = found.curves([1, 2], q), found.curves([1, 2], q, resolution=np.radians(1.0))
    assert sum(map(len, coarse)) < sum(map(len, fine)) / 4
    for curve in coarse:
        assert sa.singularity(arm.at(curve[len(curve) // 3]), mode="fixed").distance < 1e-6


@pytest.mark.parametrize("joints", [[0], "ab", [0, 9], [0, True], [0, -1], [1, 1], {}])
def test_a_map_of_other_joints_is_refused(joints):
    with pytest.raises(sa.ConfigurationError, match="joint"):
        joint_map(sa.load("planar2").at([0.3, 1.2]), joints)


@pytest.mark.parametrize(
    ("size", "step"), [(1.0, 0.5), (1.2, 0.5), (4.0, 2.0), (0.03, 0.01), (4000.0, 2000.0)]
)
def test_a_grid_has_squares_of_a_round_length_in_its_plane(size, step):
    assert step_of(size) == pytest.approx(step)
    lines = grid_lines(Grid.of(size, 1, 0.7))
    assert (lines[:, 1] == 0.7).all()
    assert len(lines) == 4 * (SQUARES + 1)
    lengths = np.linalg.norm(lines[1::2] - lines[::2], axis=1)
    np.testing.assert_allclose(lengths, SQUARES * step, atol=1e-12)
    across = np.unique(lines[: 2 * (SQUARES + 1), 0])
    np.testing.assert_allclose(np.diff(across), step, atol=1e-12)
