"""Units of meshes: masses, collisions and drawings of a mesh are those of the body in metres."""

import re
import warnings

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from helpers.arms import joint, link, robot

import spacearm as sa
from spacearm.description.shapes import read_mesh

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of meshcat's server
    from spacearm.viewer.shapes import shapes

EDGES = np.array([0.1, 0.2, 0.3])
BUS = link("bus", 50.0, inside='<visual><geometry><sphere radius="0.05"/></geometry></visual>')


def collada(path, unit=None, up="Z_UP", metre=1.0):
    """Write a box of `EDGES` as a COLLADA file in a unit, None for a file that names none."""
    text = trimesh.creation.box(EDGES / metre).export(file_type="dae").decode()
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
