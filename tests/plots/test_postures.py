"""Plots of postures: what is drawn is where the arm is, and what its tip can do."""

import numpy as np
import pinocchio as pin
import pytest
from matplotlib.figure import Figure

import spacearm as sa
from spacearm.description.bus import solid_box
from spacearm.description.shapes import Box, Cylinder, Shape, Sphere
from spacearm.plots.configurations import SECONDS, draw_posture, draw_velocities

TURNED = pin.SE3(pin.utils.rotate("z", 0.7), np.array([1.0, -2.0, 0.0]))


@pytest.fixture
def axes():
    return Figure().subplots()


@pytest.mark.parametrize("name", ["planar2", "planar3"])
def test_the_arm_is_drawn_where_it_is(axes, name):
    cfg = sa.load(name).at(np.full(int(name[-1]), 0.4), base=TURNED)
    draw_posture(axes, cfg)
    arm, com = (line.get_xydata() for line in axes.lines)
    np.testing.assert_allclose(arm[0], TURNED.act(cfg.arm.mount.translation)[:2], atol=1e-12)
    np.testing.assert_allclose(arm[-1], cfg.tip.translation[:2], atol=1e-12)
    np.testing.assert_allclose(com[0], cfg.com[:2], atol=1e-12)
    assert len(arm) == cfg.arm.n + 1


@pytest.mark.parametrize("name", ["planar2", "planar3"])
def test_a_planar_spacecraft_is_drawn_as_its_visuals_at_their_size(axes, name):
    arm = sa.load(name)
    draw_posture(axes, arm.at(np.full(arm.n, 0.4), base=TURNED))
    visuals = arm.tree.visuals[arm.tree.root].visual
    for patch, shape in zip(axes.patches, visuals, strict=True):
        corners = (shape.points() - shape.pose.translation) @ shape.pose.rotation
        np.testing.assert_allclose(
            np.ptp(corners, axis=0), sizes(shape.geometry), rtol=1e-9, atol=1e-9
        )
        flat = TURNED.rotation.T @ np.c_[patch.get_xy(), np.zeros(len(patch.get_xy()))].T
        drawn = flat[:2].T - (TURNED.rotation.T @ TURNED.translation)[:2]
        np.testing.assert_allclose(drawn.max(axis=0), shape.points().max(axis=0)[:2], atol=1e-9)
        np.testing.assert_allclose(drawn.min(axis=0), shape.points().min(axis=0)[:2], atol=1e-9)


def sizes(geometry):
    """Return the edges of the box around a primitive [m]."""
    match geometry:
        case Box(size):
            return size
        case Sphere(radius):
            return (2.0 * radius,) * 3
        case Cylinder(radius, length):
            return (2.0 * radius, 2.0 * radius, length)


@pytest.mark.parametrize("name", ["servicer_ur5", "ssrms", "ets7"])
def test_the_axes_hold_the_whole_of_a_spatial_spacecraft(name):
    arm = sa.load(name)
    axes = sa.plot(arm.at(np.clip(np.full(arm.n, 0.4), arm.lower, arm.upper))).axes[0]
    visuals = arm.tree.visuals.get(arm.tree.root)
    if visuals and visuals.visual:
        wanted = np.vstack([shape.points() for shape in visuals.visual])
    else:
        body = arm.model.inertias[1]
        rotation, edges = solid_box(body.mass, body.inertia)
        wanted = Shape(pin.SE3(rotation, body.lever), Box(tuple(edges))).points()
    lower, upper = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()]).T
    assert (lower <= wanted.min(axis=0)).all()
    assert (upper >= wanted.max(axis=0)).all()


def test_the_ellipse_has_the_singular_values_as_axes(axes):
    cfg = sa.load("planar2").at([0.3, 1.1], base=TURNED)
    draw_velocities(axes, cfg)
    from_tip = axes.lines[0].get_xydata() - cfg.tip.translation[:2]
    far = np.linalg.norm(from_tip, axis=1) / SECONDS
    np.testing.assert_allclose([far.max(), far.min()], sa.singularity(cfg).sigma, rtol=1e-3, atol=0)
    inverse = np.linalg.inv(sa.generalized_jacobian(cfg)[:2])
    np.testing.assert_allclose(np.linalg.norm(inverse @ from_tip.T, axis=0), SECONDS, atol=1e-12)


def test_the_lost_direction_is_named(axes):
    draw_velocities(axes, sa.load("planar2").at(np.radians([-65, -11.4108])))
    assert any("no motion" in text.get_text() for text in axes.texts)


def test_the_virtual_manipulator_ends_at_the_tip(axes):
    cfg = sa.load("planar2").at([0.3, 1.1], base=TURNED)
    sa.plot(sa.barycentric(cfg).virtual_manipulator, ax=axes)
    chain = axes.lines[0].get_xydata()
    assert len(chain) == cfg.arm.n + 2
    np.testing.assert_allclose(chain[0], cfg.com[:2], atol=1e-12)
    np.testing.assert_allclose(chain[-1], cfg.tip.translation[:2], atol=1e-12)


def test_the_system_cm_is_the_mean_of_the_bodies_cms(axes):
    cfg = sa.load("planar2").at([0.3, 1.1], base=TURNED)
    sa.plot(sa.barycentric(cfg), ax=axes, chain=False)
    masses = np.array([40.0, 4.0, 3.0])
    np.testing.assert_allclose(
        masses @ axes.lines[0].get_xydata() / masses.sum(), cfg.com[:2], atol=1e-12
    )


def test_arms_that_are_not_planar_are_refused(axes):
    cfg = sa.load("mda6").at(np.zeros(6))
    for draw in (draw_posture, draw_velocities):
        with pytest.raises(sa.UnsupportedError, match=r"does not move in a plane; use sa\.view"):
            draw(axes, cfg)
    with pytest.raises(sa.UnsupportedError, match="tip velocities are drawn for the task 'x y'"):
        draw_velocities(axes, sa.load("planar3").at([0.1, 0.2, 0.3]))
