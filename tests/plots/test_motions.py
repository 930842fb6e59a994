"""Plots of motions: labels that can be read, axes that do not distort."""

import numpy as np
import pinocchio as pin
import pytest

import spacearm as sa
from spacearm.plots.motions import LABEL, draw_motion


@pytest.fixture(scope="module")
def figure():
    arm = sa.load("mda6")
    q = np.radians([0, 60, -100, -50, 30, 0])
    run = sa.simulate(arm, q, sa.JointPD(target=q + np.radians(10), kp=20, kd=20), 2.0)
    figure = draw_motion(run)
    figure.canvas.draw()
    return figure


def test_labels_stand_apart_in_the_order_of_their_curves(figure):
    joints = next(axes for axes in figure.axes if axes.get_ylabel().startswith("joints"))
    labels = {text.get_text(): text.xy[1] for text in joints.texts}
    assert sorted(labels) == [f"q{i}" for i in range(1, 7)]
    at = np.sort(list(labels.values()))
    assert np.diff(at).min() >= 0.999 * LABEL * np.ptp(joints.get_ylim())
    ends = [line.get_ydata()[-1] for line in joints.lines]
    names = [f"q{i + 1}" for i in np.argsort(ends)]
    assert sorted(labels, key=labels.get) == names


def test_the_tip_path_is_drawn_to_scale(figure):
    path = next(axes for axes in figure.axes if axes.name == "3d")
    spans = [np.ptp(limits) for limits in (path.get_xlim(), path.get_ylim(), path.get_zlim())]
    box = path._box_aspect
    np.testing.assert_allclose(spans / box, spans[0] / box[0])


@pytest.mark.parametrize("target", [(1.5, 1.5), [1.5, 1.5, 0.0]])
def test_a_target_in_the_plane_has_two_or_three_components(target):
    arm = sa.load("planar2")
    run = sa.follow(arm, [0.3, 1.2], [(1.2, 1.0)])
    (star,) = (line for line in draw_motion(run, target).axes[0].lines if line.get_marker() == "*")
    np.testing.assert_array_equal(star.get_xydata(), [(1.5, 1.5)])


def test_a_motion_that_is_singular_all_the_way():
    arm = sa.load("planar2")
    q, base = np.outer([0.3, 0.4, 0.5], [1.0, 0.0]), np.tile(np.eye(7)[6], (3, 1))
    run = sa.Motion(arm, [0.0, 1.0, 2.0], q, base, mode="fixed")  # stretched
    assert run.sigma_min.max() < 1e-15
    figure = draw_motion(run)
    (line,) = figure.axes[-1].lines
    assert not line.get_ydata().any()


def test_a_tilted_plane_is_drawn_as_a_flat_one():
    arm, tilt = sa.load("planar2"), pin.SE3(pin.exp3(np.array([1.1, -0.7, 0.0])), np.zeros(3))
    lines = []
    for base, mark in (
        (pin.SE3.Identity(), (1.2, 1.0, 0.0)),
        (tilt, tilt.act(np.array([1.2, 1, 0]))),
    ):
        figure = draw_motion(sa.follow(arm, [0.3, 1.2], [(1.2, 1.0)], base=base), mark)
        path, attitude, *_ = figure.axes
        lines.append([line.get_xydata() for line in (*path.lines, *attitude.lines)])
    for flat, tilted in zip(*lines, strict=True):
        np.testing.assert_allclose(tilted[[0, -1]], flat[[0, -1]], atol=1e-5)


@pytest.mark.parametrize(
    ("name", "target", "hint"),
    [
        ("planar2", [1.0], "2 in the plane"),
        ("planar2", [1.0, np.nan], "2 in the plane"),
        ("planar2", "here", "2 in the plane"),
        ("mda6", [1.0, 1.0], r"3 finite numbers \[m\]$"),
    ],
)
def test_a_target_that_cannot_be_marked(name, target, hint):
    arm = sa.load(name)
    q = np.full(arm.n, 0.3)
    plan = sa.plan(arm, q, sa.Joints(q))
    with pytest.raises(sa.ConfigurationError, match=hint):
        draw_motion(plan, target)


def test_distances_are_in_degrees_up_to_where_they_tell_something(figure):
    axes = next(axes for axes in figure.axes if "singular" in axes.get_ylabel())
    assert axes.get_ylim() == (0.0, 45.0)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["0", "15", "30", "over 45"]
