"""Units of meshes: masses, collisions and drawings of a mesh are those of the body in metres."""

import itertools
import re
import warnings

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from helpers.arms import joint, link, robot

import spacearm as sa
from spacearm.cli.questions import constraints_of, question, target_of
from spacearm.cli.wording import in_own_words
from spacearm.description.readers import formats
from spacearm.description.readers.source import Reading
from spacearm.description.shapes import lying, mesh_bounds, read_mesh

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of meshcat's server
    from spacearm.viewer.shapes import shapes

EDGES = np.array([0.1, 0.2, 0.3])
BUS = link("bus", 50.0, inside='<visual><geometry><sphere radius="0.05"/></geometry></visual>')


def collada(path, unit=None, up="Z_UP", metre=1.0, mesh=None):
    """Write a mesh, or a box of `EDGES` in a unit; None for a file that names none."""
    mesh = trimesh.creation.box(EDGES / metre) if mesh is None else mesh
    text = mesh.export(file_type="dae").decode()
    said = "" if unit is None else f'<unit name="u" meter="{unit}"/>'
    asset, count = re.subn(r"<up_axis>\w+</up_axis>", f"{said}<up_axis>{up}</up_axis>", text)
    assert count == 1
    path.write_text(asset)


def arm_of(tmp_path, mesh, **options):
    """Return an arm of one link, a mesh, whose mass comes from its density."""
    geometry = f"<geometry>{mesh}</geometry>"
    shape = f"<collision>{geometry}</collision><visual>{geometry}</visual>"
    path = tmp_path / "robot.urdf"
    path.write_text(robot(BUS, f'<link name="arm">{shape}</link>', joint("elbow", "bus", "arm")))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sa.ModelWarning)
        return sa.load(path, density=1000.0, **options)


@pytest.mark.parametrize(
    ("unit", "metre"),
    [(None, 1.0), ("1", 1.0), ("0.001", 0.001), ("0.01", 0.01), ("0.0254", 0.0254)],
)
@pytest.mark.parametrize("up", ["X_UP", "Y_UP", "Z_UP"])
def test_collada_units_count_everywhere_and_up_axes_nowhere(unit, metre, up, tmp_path):
    collada(tmp_path / "box.dae", unit, up, metre)
    arm = arm_of(tmp_path, '<mesh filename="box.dae"/>')
    told = [note for note in arm.notes if note.startswith("the up axes of meshes are ignored")]
    assert [note.partition(": ")[2].partition(";")[0] for note in told] == (
        [] if up == "Z_UP" else [f"'box.dae' ({up})"]
    )
    body = arm.model.inertias[2]
    assert body.mass == pytest.approx(6.0, rel=1e-6)
    assert np.allclose(body.inertia, np.diag([0.13, 0.10, 0.05]) / 2, rtol=1e-6)
    drawn = next(shape for shape in shapes(arm) if shape.link == "arm")
    corners = np.asarray(drawn.geometry.vertices) @ drawn.pose[:3, :3].T
    assert np.allclose(np.ptp(corners, axis=0), EDGES, rtol=1e-6)
    for axis, edge in enumerate(EDGES):
        at = np.array([0.5, 0.0, 0.0]) + (edge / 2 + 1.02) * np.eye(3)[axis]
        ball = sa.Obstacle.sphere(1.0, pin.SE3(np.eye(3), at))
        report = sa.collision_check(arm.at([0.0]), ball)
        assert report.apart
        assert report.distance[0] == pytest.approx(0.02, abs=1e-6)


#: Coordinates in a file, of what lies to the right, up and towards the viewer, as COLLADA says.
FRAMES = {
    "X_UP": lambda right, up, near: (up, -right, near),
    "Y_UP": lambda right, up, near: (right, up, near),
    "Z_UP": lambda right, up, near: (right, -near, up),
}


def seen(arm):
    """What physics, collisions and drawings make of the arm of one link."""
    body, ball = arm.model.inertias[2], sa.Obstacle.sphere(0.1, sa.pose((0.3, 0.7, 0.9)))
    (drawn,) = (shape for shape in shapes(arm) if shape.link == "arm")
    corners = np.asarray(drawn.geometry.vertices) @ drawn.pose[:3, :3].T + drawn.pose[:3, 3]
    triangles = arm.tree.visuals["arm"].visual[0].triangles().reshape(-1, 3)
    both = (points[np.lexsort(points.round(6).T)] for points in (corners, triangles))
    distance = sa.collision_check(arm.at([0.0]), ball).distance
    return [distance, [body.mass], body.lever, body.inertia, *both]


@pytest.mark.parametrize("scale", ["1 1 1", "1 2 -3"])
def test_up_axes_count_everywhere_if_they_are_to(scale, tmp_path):
    """The same body in three frames is one, in the file that is written too."""
    body = np.array([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.2, 0.0), (0.02, 0.03, 0.3)])
    found, mesh = {}, f'<mesh filename="body.dae" scale="{scale}"/>'
    for up, frame in FRAMES.items():
        hull = trimesh.convex.convex_hull(np.column_stack(frame(*body.T)))
        collada(tmp_path / "body.dae", up=up, mesh=hull)
        arm = arm_of(tmp_path, mesh, up_axes=True)
        (told,) = [note for note in arm.notes if "up axes" in note] or [None]
        assert (
            told == (f"meshes are turned by their up axes: 'body.dae' ({up})", None)[up[0] == "Z"]
        )
        as_written = seen(arm_of(tmp_path, mesh))
        found[up] = seen(arm)
        for one, turned in zip(found[up], as_written, strict=True):
            if up != "Z_UP" and np.size(one) > 1:
                assert not np.allclose(one, turned, rtol=0.01, atol=0.01 * np.abs(one).max())
        files = arm.to_urdf(tmp_path / "written.urdf"), sa.to_sdf(arm, tmp_path / "written.sdf")
        for path, again in zip(files, (True, False), strict=True):  # which turns nothing twice
            written = sa.load(path, tip="arm", up_axes=again)
            (said,) = [note for note in written.notes if "up axes" in note] or [None]
            assert said is None if up == "Z_UP" else "are turned by" in said
            for one, other in zip(found[up], seen(written), strict=True):
                np.testing.assert_allclose(one, other, rtol=0, atol=1e-6 * np.abs(one).max())
    for up in ("X_UP", "Y_UP"):
        for one, other in zip(found[up], found["Z_UP"], strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-6 * np.abs(one).max())


OBSTACLES = {
    "a mesh": "obstacles = [{mesh = 'body.dae', up_axes = true}]",
    "a robot": "obstacles = [{robot = 'robot.urdf', up_axes = true}]",
    "a target": "body = 'target.urdf'\nup_axes = true",
}


@pytest.mark.parametrize("kind", OBSTACLES)
def test_obstacles_and_targets_say_and_take_up_axes(kind, tmp_path, monkeypatch):
    """In the file of a question, where a user finds the option that the warning names."""
    monkeypatch.chdir(tmp_path)
    at = '<collision><geometry><mesh filename="body.dae"/></geometry></collision>'
    (tmp_path / "robot.urdf").write_text(
        robot(link("bus", 50.0), link("arm", 2.0, inside=at), joint("elbow", "bus", "arm"))
    )
    (tmp_path / "target.urdf").write_text(robot(link("hull", 50.0, inside=at)))
    body = np.array([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.2, 0.0), (0.02, 0.03, 0.3)])
    ball, found = sa.Obstacle.sphere(0.1, sa.pose((0.3, 0.7, 0.9))), {}
    for (up, frame), turned in itertools.product(FRAMES.items(), (True, False)):
        mesh = trimesh.convex.convex_hull(np.column_stack(frame(*body.T)))
        collada(tmp_path / "body.dae", up=up, mesh=mesh)
        (tmp_path / "asked.toml").write_text(OBSTACLES[kind].replace("true", str(turned).lower()))
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", sa.ModelWarning)
            if kind == "a target":
                target = target_of(tmp_path / "asked.toml").replace(pose=sa.pose((0, 0, 0)))
                thing = sa.Obstacle.of_target(target)
            else:
                (thing,) = constraints_of(question(["asked.toml"], "obstacles")).obstacles
        said = [in_own_words(str(each.message)) for each in told]
        assert len(said) == (up != "Z_UP" and not turned)
        assert all(f"'body.dae' ({up}); " in text and "up_axes = true" in text for text in said)
        (part,), (pose,) = thing.parts[-1:], thing.poses(0.0)[-1:]
        round_one = coal.CollisionObject(ball.parts[0].shape, ball.pose)
        ways = coal.DistanceRequest(), coal.DistanceResult()
        solid = coal.CollisionObject(part.shape, pose)
        found[up, turned] = coal.distance(round_one, solid, *ways)
    right = found.pop(("Z_UP", True))
    for (up, turned), gap in found.items():
        assert (abs(gap - right) < 1e-6) == (turned or up == "Z_UP")


def test_no_mesh_of_the_catalogue_states_another_up_axis_than_z():
    """So its arms are mounted alike with `up_axes` and without."""
    for info in sa.arms():
        tree = formats.read(info.path, Reading(spacecraft=False, known=True))
        assert not lying(tree.visuals.values())


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "inf", "inch"])
def test_a_unit_that_is_no_length_is_refused(unit, tmp_path):
    collada(tmp_path / "box.dae", unit)
    with pytest.raises(sa.ModelError, match=r"'box\.dae' cannot be read"):
        read_mesh(tmp_path / "box.dae")


def test_meshes_in_millimetres_are_implausible(tmp_path):
    trimesh.creation.box(EDGES * 1000.0).export(tmp_path / "box.stl")
    arm = arm_of(tmp_path, '<mesh filename="box.stl"/>')
    told = [note for note in arm.notes if "as if in millimetres" in note]
    assert len(told) == 1
    assert "link 'arm' has 6e+09 kg by its shapes" in told[0]
    assert "the robot is 1 m long" in told[0]
    right = arm_of(tmp_path, '<mesh filename="box.stl" scale="0.001 0.001 0.001"/>')
    assert not [note for note in right.notes if "as if" in note]


def drawn_by(tmp_path, tag, geometry, at="0 0 0"):
    """Load an arm of one link of 2 kg with a shape for drawings or collisions only."""
    shape = f'<{tag}><origin xyz="{at}"/><geometry>{geometry}</geometry></{tag}>'
    path = tmp_path / "robot.urdf"
    path.write_text(robot(BUS, link("arm", 2.0, inside=shape), joint("elbow", "bus", "arm")))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sa.ModelWarning)
        return [note for note in sa.load(path).notes if "as if in millimetres" in note]


@pytest.mark.parametrize(
    "suffix", [".stl", ".obj", ".STL", ".ascii.stl", ".dae", ".ply", ".ascii.ply", ".glb"]
)
@pytest.mark.parametrize("tag", ["visual", "collision"])
def test_shapes_in_millimetres_are_implausible_too(suffix, tag, tmp_path):
    mesh = trimesh.creation.box(EDGES * 1000.0)
    kind = "stl_ascii" if suffix == ".ascii.stl" else suffix.rpartition(".")[2].lower()
    encoding = {"encoding": "ascii"} if suffix == ".ascii.ply" else {}
    mesh.export(tmp_path / f"box{suffix}", file_type=kind, **encoding)
    told = drawn_by(tmp_path, tag, f'<mesh filename="box{suffix}"/>')
    assert len(told) == 1
    reach = np.linalg.norm(EDGES) * 500.0
    assert f"shapes of 'arm' reach {reach:.4g} m from the frame" in told[0]
    scaled = f'<mesh filename="box{suffix}" scale="0.001 0.001 0.001"/>'
    assert drawn_by(tmp_path, tag, scaled) == []


def test_primitives_in_millimetres_are_implausible_and_wide_panels_are_not(tmp_path):
    assert drawn_by(tmp_path, "visual", '<box size="300 200 100"/>')
    assert drawn_by(tmp_path, "collision", '<cylinder radius="0.1" length="0.2"/>', "400 0 0")
    assert not drawn_by(tmp_path, "visual", '<box size="30 2 0.02"/>')


def test_text_of_any_length_and_collada_in_metres_are_told_apart(tmp_path):
    big = trimesh.creation.icosphere(6, radius=500.0)
    big.export(tmp_path / "big.obj", digits=16)
    assert (tmp_path / "big.obj").stat().st_size > 3e6
    assert drawn_by(tmp_path, "visual", '<mesh filename="big.obj"/>')
    collada(tmp_path / "box.dae", "0.001", metre=0.001)
    assert not drawn_by(tmp_path, "visual", '<mesh filename="box.dae"/>')
    collada(tmp_path / "box.dae", metre=0.001)
    assert drawn_by(tmp_path, "visual", '<mesh filename="box.dae"/>')


@pytest.mark.parametrize("kind", ["glb", "gltf", "embedded"])
def test_the_y_axis_of_gltf_becomes_z(kind, tmp_path):
    box = trimesh.Scene(trimesh.creation.box(EDGES))  # as glTF: the second edge is up
    options = {} if kind == "glb" else {"merge_buffers": True, "embed_buffers": kind == "embedded"}
    written = box.export(file_type="glb" if kind == "glb" else "gltf", **options)
    files = written if isinstance(written, dict) else {"box.glb": written}
    name = next(name for name in files if name.endswith(("glb", "gltf")))
    if kind == "gltf":
        (numbers,) = (file for file in files if file != name)
        files["my box.bin"] = files.pop(numbers)
        files[name] = files[name].replace(numbers.encode(), b"my%20box.bin")
    for file, content in files.items():
        (tmp_path / file).write_bytes(content)
    assert len(files) == 1 + (kind == "gltf")
    body = arm_of(tmp_path, f'<mesh filename="{name}"/>').model.inertias[2]
    x, y, z = EDGES[[0, 2, 1]]
    moments = np.array([y * y + z * z, x * x + z * z, x * x + y * y]) / 12
    np.testing.assert_allclose(body.inertia, body.mass * np.diag(moments), rtol=1e-6, atol=1e-9)
    corner = trimesh.Trimesh(np.vstack((np.zeros(3), np.eye(3))), [[1, 2, 3], [0, 2, 1]])
    corner.export(tmp_path / "corner.glb")
    found = np.asarray(read_mesh(tmp_path / "corner.glb").vertices)
    for point in ([1, 0, 0], [0, 0, 1], [0, -1, 0]):
        assert np.isclose(found, point).all(axis=1).any()


def test_bounds_are_those_of_the_mesh_and_follow_the_file(tmp_path):
    rng = np.random.default_rng(0)
    kinds = ((".stl", "stl"), (".obj", "obj"), (".stl", "stl_ascii"), (".ply", "ply"))
    for kind, file_type in (*kinds, (".glb", "glb"), (".dae", "dae")):
        for factor in (1.0, 3.0):
            path = tmp_path / f"cloud{kind}"
            trimesh.convex.convex_hull(factor * rng.normal(size=(40, 3))).export(path, file_type)
            points = np.asarray(read_mesh(path).vertices)
            np.testing.assert_allclose(
                mesh_bounds(path), [points.min(axis=0), points.max(axis=0)], atol=1e-7
            )
    (tmp_path / "broken.stl").write_bytes(b"solid broken\\nvertex one two three")
    assert mesh_bounds(tmp_path / "broken.stl") is None
    assert mesh_bounds(tmp_path / "nowhere.obj") is None
