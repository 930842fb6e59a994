"""Labels of figures: they do not touch each other, and stay in the figure."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.labels import outside, touching

import spacearm as sa
from spacearm.plots.style import annotate, axes_for, entitle, figure, style

LONG = "a_servicer_with_a_name_that_is_longer_than_most_titles_are"


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize(
    "place",
    [(0.5, 0.5), (1.0, 1.0), *(pytest.param((x, 0.0), marks=pytest.mark.slow) for x in (0.0, 1.0))],
)
def test_many_labels_of_one_place_stand_beside_each_other_within_the_axes(
    spatial, place, monkeypatch
):
    axes = axes_for(None, 6.0, 5.0, spatial=spatial)
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="x [m]", ylabel="y [m]", title="labels")
    for i in range(9):
        annotate(axes, f"label {i}", np.array([*place, 0.5][: 2 + spatial]), "black")
    assert not touching(axes.figure, monkeypatch)
    assert not outside(axes.figure, monkeypatch)


def test_labels_keep_away_from_legends(monkeypatch):
    axes = axes_for(None, 4.0, 3.0)
    axes.plot([0, 1], [0, 1], label="a curve with a long name")
    axes.legend(loc="center")
    annotate(axes, "here", np.array([0.5, 0.5]), "black")
    assert not touching(axes.figure, monkeypatch)


def test_texts_that_touch_are_found(monkeypatch):
    axes = figure(4.0, 3.0).add_subplot()
    axes.set_axis_off()
    for place, turn in (((0.2, 0.5), 0), ((0.22, 0.5), 0), ((0.7, 0.5), 45), ((0.7, 0.62), 45)):
        axes.text(*place, "word", rotation=turn, ha="center", va="center")
    assert touching(axes.figure, monkeypatch) == [("word", "word")]
    axes.figure.text(1.4, 0.5, "gone")
    assert outside(axes.figure, monkeypatch) == ["gone"]


def test_titles_are_folded_to_the_width_of_their_axes(monkeypatch):
    with style():
        left, right = figure(8.0, 3.0).subplots(1, 2)
        entitle(left, LONG.replace("_", " "))
        entitle(right, f"{LONG}: more words\nanother line")
    assert right.get_title(loc="left").endswith("\nanother line")
    assert not touching(left.figure, monkeypatch)
    assert not outside(left.figure, monkeypatch)


@pytest.mark.slow
def test_a_plan_has_room_for_the_numbers_of_axes_of_one_scale(monkeypatch):
    """Equal scales move the limits, so that other numbers stand at the axes than were laid out."""
    start = sa.load("planar2").at(np.radians([100.0, 90.0]))
    assert not outside(sa.plot(sa.plan(start, [1.2, 0.9])), monkeypatch)


def test_what_a_stranger_found_touching_empty_or_about_nothing(monkeypatch):
    arm = sa.load("planar2")
    way = sa.follow(arm.at([0.3, 1.2]), [(1.5, 1.2)])
    known = sa.plot(sa.identify(way))
    known.set_dpi(70)
    assert not touching(known, monkeypatch)
    (axes,) = sa.plot(sa.size_wheels(arm, way)).axes  # one motion: from none to all of it
    heights = [line.get_ydata() for line in axes.lines if line.get_label().startswith("about")]
    assert all(list(y) == [0.0, 100.0] for y in heights)
    mapped = sa.singular_map(sa.load("planar3"), ("joint_1", "joint_2"), [0.1, 0.2, 0.3], 3)
    assert "others" not in sa.plot(mapped).axes[0].get_title(loc="left")  # there are none


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "bend"), [("planar3", 1.1), ("ets7", 0.0), ("servicer_panda", 1.1)]
)
def test_labels_of_arms_with_long_names_do_not_touch(name, bend, monkeypatch, tmp_path):
    path = tmp_path / f"{LONG}.urdf"
    robot = sa.load(name).to_urdf(path).read_text()
    path.write_text(robot.replace(f'name="{name}"', f'name="{LONG}"', 1))
    arm = sa.load(path, task=sa.load(name).task, check="accept")
    assert arm.name == LONG
    q = np.clip(np.full(arm.n, bend), arm.lower, arm.upper)
    cfg = arm.at(q, base=pin.SE3(pin.exp3(np.array([0.0, 0.0, bend])), np.zeros(3)))
    law = sa.JointPD(target=q + 0.1, kp=5.0, kd=9.0)
    run = sa.simulate(cfg, law, 0.2)
    for thing in (
        cfg,
        sa.singularity(cfg),
        sa.barycentric(cfg),
        run,
        sa.reaction(run),
        sa.error_bars(cfg),
        sa.momentum_matrix(cfg),
        sa.capture(cfg, [0.0, 0.0, 0.1, 0.0, 0.0, 0.1], 5.0, np.eye(3)),
        sa.forward_dynamics(cfg, np.zeros(arm.n), np.ones(arm.n)),
    ):
        drawn = sa.plot(thing)
        kind = type(thing).__name__
        assert not touching(drawn, monkeypatch), kind
        assert not outside(drawn, monkeypatch), kind


@pytest.mark.parametrize("length", [300, 5000])
def test_names_that_are_too_long_are_shortened_in_figures(length, tmp_path):
    text = sa.load("planar2").path.read_text(encoding="utf-8")
    for name in ('name="planar2"', '"joint_1"', '"joint_2"'):
        text = text.replace(name, f'{name[:-1]}{"a" * length}"')
    path = tmp_path / "long.urdf"
    path.write_text(text, encoding="utf-8")
    figure = sa.plot(sa.singular_map(sa.load(path), points=5))
    figure.canvas.draw()  # a warning of Matplotlib is an error here
    shown = [axis.get_label().get_text() for axis in (figure.axes[0].xaxis, figure.axes[0].yaxis)]
    assert max(map(len, shown)) < 80
