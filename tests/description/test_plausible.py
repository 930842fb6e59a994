"""Numbers that no spacecraft has are warned of on loading and by info."""

import numpy as np
import pytest
from helpers.arms import joint, link, robot
from helpers.commands import spacearm

import spacearm as sa


def heavy_turn(mass, inertia):
    return (
        f'<link name="arm"><inertial><mass value="{mass}"/><inertia ixx="{inertia}" '
        f'iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def test_an_inertia_in_other_units(tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(robot(link("bus", 50.0), heavy_turn(1.0, 1e5), joint("elbow", "bus", "arm")))
    with pytest.warns(sa.ModelWarning, match=r"'arm' of 1 kg has an inertia of 1e\+05 kg m\^2"):
        arm = sa.load(path)
    assert "as if its mass were 316.2 m from its CM" in arm.notes[-1]
    assert "note: body 'arm' of 1 kg" in spacearm("info", path).stdout


def test_lengths_in_millimetres(tmp_path):
    path = tmp_path / "r.urdf"
    parts = (link("bus", 50.0), link("arm"), joint("elbow", "bus", "arm", xyz=(500, 0, 0)))
    path.write_text(robot(*parts))
    with pytest.warns(sa.ModelWarning, match="'elbow' is 500 m from .* millimetres"):
        sa.load(path)


def test_a_bus_of_a_kilometre_and_one_of_feathers():
    with pytest.warns(sa.ModelWarning, match="the bus is 1000 m long"):
        bus = sa.Bus(mass=500, size=(1000, 1, 1))
    assert any("1000 m long" in note for note in sa.mount("ur5", bus).notes)
    with pytest.warns(sa.ModelWarning, match=r"density of 0.0005 kg/m\^3"):
        sa.Bus(mass=0.5, size=(10, 10, 10))
    with pytest.warns(sa.ModelWarning, match="775 m|774.6 m"):
        sa.Bus(mass=1, inertia=np.eye(3) * 1e5)


@pytest.mark.parametrize("info", [*sa.catalogue()], ids=lambda info: info.name)
def test_the_catalogue_is_plausible(info):
    notes = sa.load(info.name).notes
    found = [note for note in notes if "as if" in note or "density" in note]
    assert len(found) == (info.name == "ssrms"), found  # it is an arm alone


def test_a_station_is_no_mistake():
    """The ISS: 420 t, 109 m long, 1e8 kg m^2."""
    sa.Bus(mass=420e3, size=(109, 73, 20))
    sa.Bus(mass=420e3, inertia=np.diag([1.28e8, 1.07e8, 2.01e8]))
