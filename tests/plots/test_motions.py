"""Plots of motions: labels that can be read, axes that do not distort."""

import numpy as np
import pinocchio as pin
import pytest

import spacearm as sa
from spacearm.plots.motions import FADES


@pytest.fixture(scope="module")
def figure():
    arm = sa.load("mda6")
    q = np.radians([0, 60, -100, -50, 30, 0])
    run = sa.simulate(arm.at(q), sa.JointPD(target=q + np.radians(10), kp=20, kd=20), 2.0)
    figure = sa.plot(run)
    figure.canvas.draw()
    return figure


def test_joints_are_named_in_a_legend_in_the_order_of_their_curves(figure):
    joints = next(axes for axes in figure.axes if axes.get_ylabel().startswith("joints"))
    names = [text.get_text() for text in joints.get_legend().get_texts()]
    assert names == list(sa.load("mda6").joint_names)
    assert [line.get_label() for line in joints.lines] == names


def test_every_singular_posture_of_figure_5_is_marked_and_counted():
    arm = sa.load("planar2")
    base = pin.SE3(pin.utils.rotate("z", np.radians(21)), np.zeros(3))
    law = sa.TransposedJacobian(target=(1.5, 1.5), kp=(5, 5), kd=(15, 15))
    run = sa.simulate(arm.at(np.radians([-57.936, 60.337]), base=base), law, 30.0)
    path, *others = sa.plot(run).axes
    (crosses,) = (line for line in path.lines if line.get_marker() == "x")
    count = len(run.singular_times)
    assert count > 3
    assert len(crosses.get_xdata()) == count
    assert f"singular ({count} times)" in [t.get_text() for t in path.get_legend().get_texts()]
    for axes in others:
        assert sum(line.get_linestyle() == ":" for line in axes.lines) == count


def test_the_tip_path_is_drawn_to_scale(figure):
    path = next(axes for axes in figure.axes if axes.name == "3d")
    spans = [np.ptp(limits) for limits in (path.get_xlim(), path.get_ylim(), path.get_zlim())]
    box = path._box_aspect
    np.testing.assert_allclose(spans / box, spans[0] / box[0], atol=0)


@pytest.mark.parametrize("target", [(1.5, 1.5), [1.5, 1.5, 0.0]])
def test_a_target_in_the_plane_has_two_or_three_components(target):
    arm = sa.load("planar2")
    run = sa.follow(arm.at([0.3, 1.2]), [(1.2, 1.0)])
    (star,) = (
        line for line in sa.plot(run, target=target).axes[0].lines if line.get_marker() == "*"
    )
    np.testing.assert_array_equal(star.get_xydata(), [(1.5, 1.5)])


def test_a_motion_that_is_singular_all_the_way():
    arm = sa.load("planar2")
    q, base = np.outer([0.3, 0.4, 0.5], [1.0, 0.0]), np.tile(np.eye(7)[6], (3, 1))
    run = sa.Motion(arm, [0.0, 1.0, 2.0], q, base, mode="fixed")  # stretched
    assert run.sigma_min.max() < 1e-15
    figure = sa.plot(run)
    (line,) = figure.axes[-1].lines
    assert not line.get_ydata().any()


def test_a_tilted_plane_is_drawn_as_a_flat_one():
    arm, tilt = sa.load("planar2"), pin.SE3(pin.exp3(np.array([1.1, -0.7, 0.0])), np.zeros(3))
    lines = []
    for base, mark in (
        (pin.SE3.Identity(), (1.2, 1.0, 0.0)),
        (tilt, tilt.act(np.array([1.2, 1, 0]))),
    ):
        figure = sa.plot(sa.follow(arm.at([0.3, 1.2], base=base), [(1.2, 1.0)]), target=mark)
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
    plan = sa.plan(arm.at(q), sa.Joints(q))
    with pytest.raises(sa.ConfigurationError, match=hint):
        sa.plot(plan, target=target)


def test_distances_are_in_degrees_up_to_where_they_tell_something(figure):
    axes = next(axes for axes in figure.axes if "singular" in axes.get_ylabel())
    assert axes.get_ylim() == (0.0, 45.0)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["0", "15", "30", "over 45"]


def test_a_few_postures_are_drawn_where_the_arm_was():
    arm = sa.load("planar2")
    followed = sa.follow(arm.at([0.3, 1.2]), [(1.2, 1.0)])
    sticks = [line for line in sa.plot(followed).axes[0].lines if len(line.get_xdata()) == 3]
    assert len(sticks) == len(FADES)
    for stick, at in ((sticks[0], 0), (sticks[-1], -1)):
        np.testing.assert_allclose(stick.get_xydata()[-1], followed.tip[at, :2], atol=1e-9)


@pytest.mark.slow
def test_wheels_are_drawn_with_what_they_hold():
    arm = sa.load("chaser7", wheels=["joint_7"])
    hold = sa.WheelHold(stiffness=40.0, damping=60.0)
    law = sa.JointPD(target=np.full(6, 0.35), kp=5.0, kd=15.0)
    run = sa.simulate(
        arm.at(np.full(6, 0.3), wheels=[0.7]),
        law,
        2.0,
        plant=sa.Plant(wheels=hold),
        integration=sa.Integration(dt=0.1),
    )
    drawn = [axes for axes in sa.plot(run).axes if axes.get_ylabel().startswith("wheels")]
    assert len(drawn) == 1
    np.testing.assert_array_equal(drawn[0].lines[0].get_ydata(), run.wheels[:, 0])


def test_a_flight_is_drawn_as_one_motion():
    arm, law = sa.load("planar2"), sa.JointPD(target=[0.5, 0.6], kp=4.0, kd=8.0)
    phases = [sa.Phase(law, 1.0, sa.Grasp(mass=3.0)), sa.Phase(law, 1.0)]
    flight = sa.simulate_phases(arm.at([0.3, 0.9]), phases)
    drawn = sa.plot(flight).axes[0]
    np.testing.assert_array_equal(drawn.lines[0].get_xdata(), flight.t)
