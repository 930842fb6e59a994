"""Numbers of files that are out of range: colours to 255, lengths that are next to nothing."""

import contextlib
import re
import warnings

import mujoco
import numpy as np
import pytest
from helpers.arms import joint, link, load_text, robot

import spacearm as sa
from spacearm.mechanics.jacobian import solve_locked

INERTIA = "<inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>"


def urdf(rgba):
    colour = f'<material name="m"><color rgba="{rgba}"/></material>'
    box = '<geometry><box size="1 2 3"/></geometry>'
    arm = link("arm", inside=f"<visual>{box}{colour}</visual>")
    return robot(link("bus", 50.0), arm, joint("elbow", "bus", "arm"))


def sdf(rgba):
    part = f"<link name='{{}}'><inertial><mass>{{}}</mass>{INERTIA}</inertial>{{}}</link>"
    box = "<geometry><box><size>1 2 3</size></box></geometry>"
    colour = f"<visual name='v'>{box}<material><diffuse>{rgba}</diffuse></material></visual>"
    hinge = "<parent>bus</parent><child>arm</child><axis><xyz>0 0 1</xyz></axis>"
    links = part.format("bus", 50, "") + part.format("arm", 1, colour)
    elbow = f"<joint name='elbow' type='revolute'>{hinge}</joint>"
    return f"<sdf version='1.9'><model name='m'>{links}{elbow}</model></sdf>"


def mjcf(rgba):
    arm = f"<body name='arm'><joint/><geom type='box' size='1 2 3' rgba='{rgba}'/></body>"
    bus = f"<body name='bus'><freejoint/><geom size='9'/>{arm}</body>"
    return f"<mujoco><worldbody>{bus}</worldbody></mujoco>"


@pytest.mark.parametrize(("write", "suffix"), [(urdf, "urdf"), (sdf, "sdf"), (mjcf, "xml")])
@pytest.mark.parametrize(
    ("rgba", "said", "colour"),
    [
        ("255 0 0 1", "from 0 to 255.*: 255 0 0 1", (1.0, 0.0, 0.0, 1.0)),
        ("51 102 255 255", "from 0 to 255.*: 51 102 255 255", (0.2, 0.4, 1.0, 1.0)),
        ("0 1 0.5 1", "", (0.0, 1.0, 0.5, 1.0)),
        ("1.5 0 0 1", "left out: 1.5 0 0 1", None),
        ("-1 0 0 1", "left out: -1 0 0 1", None),
        ("256 0 0 1", "left out: 256 0 0 1", None),
        ("1 0 0 1e9", "left out: 1 0 0 1e.09", None),
    ],
)
def test_colours(write, suffix, rgba, said, colour, tmp_path):
    path = tmp_path / f"robot.{suffix}"
    path.write_text(write(rgba))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        arm = sa.load(path)
    told = [str(w.message) for w in caught if "colours" in str(w.message)]
    assert len(told) == bool(said)
    assert all(re.search(said, text) for text in told)
    found = arm.tree.visuals["arm"].visual[0].rgba
    assert found == colour or found == pytest.approx(colour)


@pytest.mark.parametrize("length", [1e-101, 1e-160, 1e-300, 5e-324])
def test_lengths_next_to_nothing_are_zero(length, tmp_path):
    def described(length):
        at = {"xyz": (length, 0.3, 0.0)}
        links = link("bus", 50.0, com=(0.0, length, 0.0)), link("arm"), link("hand")
        return robot(
            *links, joint("elbow", "bus", "arm", **at), joint("wrist", "arm", "hand", **at)
        )

    path = tmp_path / "robot.urdf"
    path.write_text(described(length))
    with pytest.warns(sa.ModelWarning, match=r"lengths below 1e-100 m .* of joint 'elbow'"):
        arm = sa.load(path, task="x y")
    path.write_text(described(0.0))
    q = [0.3, 0.7]
    same = sa.load(path, task="x y").at(q)
    np.testing.assert_array_equal(sa.generalized_jacobian(arm.at(q)), sa.generalized_jacobian(same))


def test_an_arm_of_lengths_next_to_nothing_is_read_and_moves_no_tip(tmp_path):
    at = {"xyz": (1e-160, 0.0, 0.0)}
    links = link("bus", 50.0), link("arm"), link("hand")
    path = tmp_path / "robot.urdf"
    path.write_text(
        robot(*links, joint("elbow", "bus", "arm", **at), joint("wrist", "arm", "hand", **at))
    )
    for length in ("1e-160", "1e-80"):
        path.write_text(path.read_text().replace("1e-160", length))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            sa.load(path, task="x y")
        assert any("rows x y never move" in str(w.message) for w in caught)


def test_mujoco_has_the_length_too(tmp_path):
    """The tree is that of all formats, also of those that others read."""
    path = tmp_path / "robot.xml"
    path.write_text(
        mjcf("1 0 0 1").replace("<body name='arm'>", "<body name='arm' pos='1e-160 0 1'>")
    )
    assert mujoco.MjModel.from_xml_path(str(path)).body_pos[2, 0] == 1e-160
    with pytest.warns(sa.ModelWarning, match="lengths below"):
        arm = sa.load(path)
    assert arm.tree.chain("arm")[0].origin.translation[0] == 0.0


@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
def test_an_inertia_that_rounding_makes_singular_is_named():
    """The bus is a point of 1e-12 kg, a million kilometres and more from its own frame."""
    place = '<origin xyz="1e12 0 1e12"/>'
    tiny = '<inertia ixx="1e-30" iyy="1e-30" izz="1e-30" ixy="0" ixz="0" iyz="0"/>'
    bus = f'<link name="bus"><inertial>{place}<mass value="1e-12"/>{tiny}</inertial></link>'
    arm = f'<link name="arm"><inertial><mass value="1e-9"/>{tiny}</inertial></link>'
    cfg = load_text(robot(bus, arm, joint("elbow", "bus", "arm", xyz=(0, 0, 0)))).at([0.1])
    calls = (
        lambda: sa.base_velocity(cfg, [1.0]),
        lambda: sa.generalized_jacobian(cfg),
        lambda: sa.generalized_jacobian_derivative(cfg),
        lambda: sa.error_bars(cfg),
        lambda: sa.move(cfg, [1.0]),
    )
    for call in calls:
        with contextlib.suppress(sa.ModelError):  # where no pivot happens to be zero it answers
            call()
    with pytest.raises(sa.ModelError, match="singular within rounding"):
        solve_locked(np.outer([1.0, 2.0, 3.0], [0.0, 0.0, 0.0]), np.ones(3))
