"""Plots of postures: what is drawn is where the arm is, and what its tip can do."""

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import spacearm as sa
from spacearm.description.bus import solid_box
from spacearm.description.shapes import MANY_TRIANGLES, Box, Shape
from spacearm.plots.configurations import SECONDS, draw_posture, draw_velocities
from spacearm.plots.style import GREEN
from spacearm.plots.triangles import solids, tinted

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


def placed_visuals(cfg):
    """Return the points of all visuals of a configuration, each shape's in inertial axes [m]."""
    model, data = cfg.arm.model, pin.Data(cfg.arm.model)
    pin.framesForwardKinematics(model, data, cfg.full)
    return [
        np.array([data.oMf[model.getFrameId(link)].act(x) for x in shape.points()])
        for link, drawn in cfg.arm.tree.visuals.items()
        for shape in drawn.visual
    ]


def extents(points):
    return np.ravel((points.min(axis=0), points.max(axis=0))).round(6).tolist()


def data_extents(axes):
    spans = (axes.xy_dataLim.intervalx, axes.xy_dataLim.intervaly, axes.zz_dataLim.intervalx)
    return np.transpose(spans).ravel()


def described(folder, visual):
    """Write an arm whose links have one visual each, none if empty, and load it."""
    inertia = '<inertia ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"/>'
    links = "".join(
        f'<link name="{name}"><inertial><mass value="{m}"/>{inertia.format(m)}</inertial>'
        f"{visual}</link>"
        for name, m in (("hull", 30.0), ("boom", 3.0), ("hand", 2.0))
    )
    joints = "".join(
        f'<joint name="{child}_joint" type="revolute"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="0.7 0 0.2"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
        for parent, child, axis in (("hull", "boom", "0 0 1"), ("boom", "hand", "0 1 0"))
    )
    path = folder / "drawn.urdf"
    path.write_text(f'<robot name="drawn">{links}{joints}</robot>')
    return sa.load(path, tip="hand", task="x y")


@pytest.mark.parametrize("name", ["planar2", "planar3"])
def test_all_bodies_of_a_planar_arm_are_drawn_as_their_visuals_at_their_size(axes, name):
    arm = sa.load(name)
    cfg = arm.at(np.full(arm.n, 0.4), base=TURNED)
    draw_posture(axes, cfg)
    drawn = sorted(extents(patch.get_path().vertices) for patch in axes.patches)
    wanted = sorted(extents(points[:, :2]) for points in placed_visuals(cfg))
    np.testing.assert_allclose(drawn, wanted, atol=1e-6)


BOX = '<visual><origin xyz="0.3 0 0"/><geometry><box size="0.6 0.2 0.1"/></geometry></visual>'
ROUND = '<visual><geometry><cylinder radius="0.1" length="0.9"/></geometry></visual>'


@pytest.mark.slow
@pytest.mark.parametrize("source", ["servicer_ur5", "ssrms", "ets7", BOX, ROUND])
def test_all_bodies_of_a_spatial_arm_are_drawn_as_their_visuals_at_their_size(source, tmp_path):
    arm = described(tmp_path, source) if source.startswith("<") else sa.load(source)
    cfg = arm.at(np.clip(np.full(arm.n, 0.4), arm.lower, arm.upper), base=TURNED)
    axes = sa.plot(cfg).axes[0]
    wanted = np.vstack(placed_visuals(cfg))
    assert len(axes.collections) == 1
    lines = np.hstack([line.get_data_3d() for line in axes.lines]).T
    size = np.ptp(wanted, axis=0).max()
    shown = extents(np.vstack((wanted, lines)))
    np.testing.assert_allclose(data_extents(axes), shown, atol=0.01 * size)
    lower, upper = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()]).T
    assert (lower <= wanted.min(axis=0)).all()
    assert (upper >= wanted.max(axis=0)).all()
    assert "without visuals" not in axes.get_title()


def test_bodies_without_visuals_are_lines_and_the_box_of_the_inertia_and_the_title_says_so(
    tmp_path,
):
    arm = described(tmp_path, "")
    cfg = arm.at([0.3, 0.4])
    axes = sa.plot(cfg).axes[0]
    note = "without visuals, drawn as the box of its inertia and lines (2 of 2 links)"
    assert note in axes.get_title().replace("\n", " ")
    body = arm.model.inertias[1]
    rotation, edges = solid_box(body.mass, body.inertia)
    box = Shape(pin.SE3(rotation, body.lever), Box(tuple(edges))).points()
    lines = np.hstack([line.get_data_3d() for line in axes.lines]).T
    np.testing.assert_allclose(data_extents(axes), extents(np.vstack((box, lines))), atol=1e-6)
    thick = [line for line in axes.lines if line.get_linewidth() > 4]
    assert len(thick) == 2


def test_what_collides_is_drawn_where_there_are_no_visuals(tmp_path):
    seen, collides = (
        sa.plot(described(tmp_path, BOX.replace("visual", tag)).at([0.3, 0.4])).axes[0]
        for tag in ("visual", "collision")
    )
    assert seen.get_title() == collides.get_title()
    np.testing.assert_array_equal(data_extents(seen), data_extents(collides))


def test_meshes_of_few_or_flat_triangles_are_drawn(tmp_path):
    corners = {"one.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"}
    corners["flat.obj"] = corners["one.obj"] + "v 1 1 0\nf 2 3 4\n"
    for name, text in corners.items():
        (tmp_path / name).write_text(text)
        arm = described(
            tmp_path, f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        )
        figure = sa.plot(arm.at([0.3, 0.4]))
        figure.canvas.draw()
        assert len(figure.axes[0].collections[0].get_facecolor()) > 3


FORK = [((0.0, 0.0), (0.2, 0.6)), ((0.2, 0.0), (0.6, 0.2)), ((0.2, 0.4), (0.6, 0.6))]
"""Rectangles in the plane: a base and two tines, with nothing between these."""


@pytest.fixture
def fork(tmp_path):
    """Return an arm in a plane whose links are forks 0.1 m thick, a mesh each."""
    parts = [
        trimesh.creation.box(bounds=[(*low, -0.05), (*high, 0.05)]).subdivide().subdivide()
        for low, high in FORK
    ]
    trimesh.util.concatenate(parts).export(tmp_path / "fork.stl")
    mesh = '<visual><geometry><mesh filename="fork.stl" scale="1 -1 1"/></geometry></visual>'
    described(tmp_path, mesh)
    path = tmp_path / "drawn.urdf"
    path.write_text(path.read_text().replace('"0 1 0"', '"0 0 1"'))
    return sa.load(path, tip="hand", task="x y")


def test_what_is_between_the_tines_of_a_mesh_is_not_drawn(fork, axes):
    cfg = fork.at([0.3, 0.4])
    draw_posture(axes, cfg)
    model, data = fork.model, pin.Data(fork.model)
    pin.framesForwardKinematics(model, data, cfg.full)
    for link, patch in zip(("hull", "boom", "hand"), axes.patches, strict=True):
        pose = data.oMf[model.getFrameId(link)]
        for x, y, drawn in ((0.1, -0.3, True), (0.4, -0.5, True), (0.4, -0.3, False)):
            assert patch.get_path().contains_point(pose.act(np.array([x, y, 0.0]))[:2]) == drawn
    triangles = np.concatenate([solid.triangles for solid in solids(fork) if solid.link == "hand"])
    centres = triangles.mean(axis=1)
    inside = (centres[:, 0] > 0.21) & (centres[:, 1] < -0.21) & (centres[:, 1] > -0.39)
    assert len(triangles) > 100
    assert not inside.any()
    outward = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    volume = np.einsum("ij,ij->i", triangles[:, 0], outward).sum() / 6.0
    assert volume == pytest.approx(0.1 * (0.2 * 0.6 + 2 * 0.4 * 0.2), rel=1e-6)


def test_a_fine_mesh_is_drawn_without_its_smallest_details(tmp_path):
    trimesh.creation.icosphere(subdivisions=5, radius=0.3).export(tmp_path / "ball.stl")
    arm = described(tmp_path, '<visual><geometry><mesh filename="ball.stl"/></geometry></visual>')
    for solid in solids(arm):
        assert 100 <= len(solid.triangles) <= MANY_TRIANGLES
        radii = np.linalg.norm(solid.triangles, axis=2)
        np.testing.assert_allclose(radii, 0.3, rtol=0.1, atol=0.0)


def test_a_body_that_the_tip_has_grasped_is_drawn_where_it_is(axes):
    arm = sa.load("planar2").grasp(6.0, np.eye(3), com=(1.0, 0.0, 0.0))
    cfg = arm.at([0.3, 0.4], base=TURNED)
    draw_posture(axes, cfg)
    edge = np.sqrt(6.0 * 1.0 / 6.0)  # a cube of 6 kg with 1 kg m^2 about each axis
    held = next(p for p in axes.patches if to_rgb(p.get_facecolor()) == tinted(GREEN))
    corners = (
        cfg.tip.rotation.T[:2, :2] @ (held.get_path().vertices - cfg.tip.act(np.eye(3)[0])[:2]).T
    )
    np.testing.assert_allclose(np.abs(corners), 0.5 * edge, atol=1e-6)


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
