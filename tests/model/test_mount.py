"""Arms on buses: what is bolted together is the sum of its parts, and survives being written."""

import pickle
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import (
    frame,
    joint,
    link,
    load_text,
    random_base,
    random_chain,
    random_inertia,
    random_tree,
    robot,
    seeds,
    two_links,
)
from hypothesis import given
from scipy.spatial.transform import Rotation

import spacearm as sa
from spacearm.description.readers import formats

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    from spacearm.viewer.shapes import shapes

FLAT = np.diag([1.0, 1.0, 3.0])
ARMS = [info.name for info in sa.arms()]
SERVICER = sa.Bus(mass=200, size=(1, 1, 1))
ON_TOP = pin.SE3(np.eye(3), np.array([0, 0, 0.5]))
LEFT, RIGHT = (pin.SE3(np.eye(3), np.array([0, y, 0.5])) for y in (0.3, -0.3))


def saved(text: str, folder, name="arm.urdf") -> Path:
    path = Path(folder) / name
    path.write_text(text, encoding="utf-8")
    return path


def same(a: sa.SpaceArm, b: sa.SpaceArm, seed=0, tolerance=1e-12) -> None:
    """Mass, CM, momentum matrix (and with it the inertia) and J* are equal."""
    rng = np.random.default_rng(seed)
    q, base = rng.uniform(-np.pi, np.pi, a.n), random_base(rng)
    x, y = a.at(q, base=base), b.at(q, base=base)
    assert a.joint_names == b.joint_names
    for u, v in [
        (a.mass, b.mass),
        (x.com, y.com),
        (x.A, y.A),
        (sa.generalized_jacobian(x), sa.generalized_jacobian(y)),
        (np.array(a.lower), np.array(b.lower)),
        (np.array(a.upper), np.array(b.upper)),
    ]:
        finite = np.isfinite(v)
        assert (np.isfinite(u) == finite).all()
        scale = np.abs(np.where(finite, v, 0.0)).max()
        np.testing.assert_allclose(u, v, atol=tolerance * max(scale, 1.0), rtol=0)


def rewritten(arm: sa.SpaceArm, **options) -> sa.SpaceArm:
    with tempfile.TemporaryDirectory() as folder:
        return sa.load(arm.to_urdf(Path(folder) / "whole.urdf"), **options)


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_every_arm_mounts_answers_and_is_drawn_with_its_own_meshes(name):
    arm = sa.mount(name, SERVICER, at=ON_TOP)
    report = sa.singularity(arm.at(np.full(arm.n, 0.3)))
    assert report.kind == "regular"
    assert arm.n == len(report.gradient)
    assert arm.tip == next(info.tip for info in sa.arms() if info.name == name)
    assert name in arm.tree.links
    same(arm, rewritten(arm))
    drawn = shapes(arm)
    kinds = [(shape.link, type(shape.geometry).__name__) for shape in drawn]
    assert ("bus", "Box") in kinds
    assert name == "vispa" or [kind for _, kind in kinds].count("TriangularMeshGeometry") >= arm.n
    assert sa.view(arm, open=False).session.report.sigma_min > 0.0


@pytest.mark.parametrize("name", ARMS)
def test_the_written_urdf_is_for_everyone(name, tmp_path):
    """Pinocchio's own reader makes the same system of it."""
    arm = sa.mount(name, SERVICER, at=ON_TOP)
    path = arm.to_urdf(tmp_path / "whole.urdf")
    theirs = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    q = np.random.default_rng(1).uniform(-1, 1, arm.n)
    full, values = pin.neutral(theirs), dict(zip(arm.joint_names, q, strict=True))
    for name, value in values.items():
        joint = theirs.joints[theirs.getJointId(name)]
        circle = [np.cos(value), np.sin(value)]
        full[joint.idx_q : joint.idx_q + joint.nq] = circle if joint.nq == 2 else value
    assert set(arm.held.values()) <= {0.0}
    columns = [theirs.joints[theirs.getJointId(name)].idx_v for name in values]
    A = pin.computeCentroidalMap(theirs, theirs.createData(), full)[:, [*range(6), *columns]]
    np.testing.assert_allclose(arm.at(q).A, A, atol=1e-12 * np.abs(A).max())


def test_a_bus_is_a_solid_box_unless_its_inertia_is_given():
    box = sa.Bus(mass=12, size=(0.1, 0.2, 0.3), com=(0, 0, 0.02))
    base = sa.mount("vispa", box, pin.SE3.Identity())
    alone = sa.Bus(12, size=(0.1, 0.2, 0.3), com=(0, 0, 0.02)).tree().links["bus"]
    assert np.allclose(np.diag(alone.inertia), [0.13, 0.10, 0.05])
    assert np.allclose(alone.origin.translation, [0, 0, 0.02])
    I = np.array([[3.0, 0.2, 0.1], [0.2, 4.0, 0.3], [0.1, 0.3, 5.0]])
    other = sa.mount("vispa", sa.Bus(mass=12, inertia=I, com=(0, 0, 0.02)))
    grown = other.model.inertias[1].inertia - base.model.inertias[1].inertia
    np.testing.assert_allclose(grown, I - alone.inertia, atol=1e-13)
    same(other, rewritten(other))


def test_the_box_drawn_for_an_inertia_has_it():
    I = random_inertia(np.random.default_rng(3), 12.0)
    (shape,) = [s for s in shapes(sa.mount("vispa", sa.Bus(mass=12, inertia=I))) if s.link == "bus"]
    edges = np.array(shape.geometry.lengths)
    box = 12.0 / 12.0 * np.diag((edges**2).sum() - edges**2)
    R = shape.pose[:3, :3]
    np.testing.assert_allclose(R @ box @ R.T, I, atol=1e-9)


@pytest.mark.parametrize(
    ("bus", "message"),
    [
        ({"mass": 0, "size": (1, 1, 1)}, "mass is 0 kg; give a positive mass"),
        ({"mass": -3, "size": (1, 1, 1)}, "mass is -3 kg"),
        ({"mass": np.nan, "size": (1, 1, 1)}, "mass is nan kg"),
        ({"mass": "heavy", "size": (1, 1, 1)}, "mass is 'heavy'; give a number"),
        ({"mass": 1, "size": (1, 0, 1)}, r"size of the bus is \(1, 0, 1\); give three positive"),
        ({"mass": 1, "size": (1, 1)}, "three positive lengths"),
        ({"mass": 1, "size": "big"}, "three positive lengths"),
        ({"mass": 1, "size": (1, np.inf, 1)}, "three positive lengths"),
        ({"mass": 1}, "needs a size .* or an inertia"),
        ({"mass": 1, "inertia": np.zeros((3, 3))}, "inertia of the bus is zero"),
        ({"mass": 1, "inertia": FLAT}, "triangle inequality"),
        ({"mass": 1, "inertia": [1, 2, 3]}, r"symmetric \(3, 3\) matrix"),
        ({"mass": 1, "size": (1, 1, 1), "com": (0, 0)}, "com is"),
    ],
)
def test_a_bus_that_cannot_be_is_refused(bus, message):
    with pytest.raises((sa.ModelError, sa.ConfigurationError), match=message):
        sa.Bus(**bus)


@pytest.mark.filterwarnings("ignore:.*density:spacearm.errors.ModelWarning")
@given(seeds)
def test_mounting_is_what_pinocchio_appends(seed):
    """A random arm on a random bus, against pin.appendModel."""
    rng = np.random.default_rng(seed)
    text, n = random_chain(seed, 5, ("revolute", "prismatic")), 5
    at = random_base(rng)
    bus = sa.Bus(mass=30, inertia=random_inertia(rng, 30), com=rng.normal(size=3))
    with tempfile.TemporaryDirectory() as folder:
        arm = sa.mount(saved(text, folder), bus, at=at, name="a")
    free = pin.Model()
    free.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    free.appendBodyToJoint(1, bus.tree().links["bus"].spatial(), pin.SE3.Identity())
    spot = free.addFrame(pin.Frame("spot", 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    whole = pin.appendModel(free, pin.buildModelFromXML(text), spot, at)
    assert arm.joint_names == tuple(f"a_{name}" for name in list(whole.names)[2:])
    q = rng.uniform(-np.pi, np.pi, n)
    full = np.concatenate(([0, 0, 0, 0, 0, 0, 1], q))
    data = whole.createData()
    A = pin.computeCentroidalMap(whole, data, full)
    cfg = arm.at(q)
    np.testing.assert_allclose(cfg.A, A, atol=1e-12 * np.abs(A).max())
    tip = pin.updateFramePlacement(whole, data, whole.getFrameId("tip"))
    assert cfg.tip.isApprox(tip, 1e-12)


@given(seeds)
def test_a_written_tree_is_read_to_the_same_numbers(seed):
    """Any joints, mimic joints among them, limits, some joints locked, masses changed."""
    rng = np.random.default_rng(seed)
    arm = load_text(random_tree(seed, 6), tip="link_6", task="position", joints="all")
    arm = arm.replace(base_mass=77.0, payload=2.0)
    on_the_way = [joint.name for joint in arm.tree.chain("link_6")] + ["joint_1"]  # it is mimicked
    if beside := [name for name in arm.joint_names if name not in on_the_way]:
        arm = arm.replace(locked={beside[0]: rng.normal()})
    same(arm, rewritten(arm, joints="all"), seed)
    same(arm.replace(joints="tip"), rewritten(arm), seed)


def test_gimbal_lock_and_half_turns_are_written_exactly():
    turns = [(np.pi, -np.pi / 2, 0), (0.3, np.pi / 2, 0.4), (0, np.pi, 0), (np.pi, 0, np.pi)]
    for rpy in turns:
        arm = load_text(robot(*two_links(rpy=rpy)))
        same(arm, rewritten(arm))


def test_unlimited_joints_stay_unlimited():
    slide = robot(*two_links(kind="prismatic", inside=""))
    for text in (robot(*two_links(inside="")), slide):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sa.ModelWarning)
            arm = load_text(text)
            same(arm, rewritten(arm))
    assert load_text(robot(*two_links(kind="continuous"))).upper[0] == np.inf


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("limits", [(-1.0, np.inf), (-np.inf, 1.0), (0.0, np.inf)])
def test_limits_on_one_side_stay_on_one_side(kind, limits):
    inside = '<limit lower="{}" upper="{}"/>'.format(*limits)
    arm = load_text(robot(*two_links(kind=kind, inside=inside)))
    again = rewritten(arm)
    same(arm, again)
    assert (again.lower[0], again.upper[0]) == limits


def test_the_order_of_mounting_does_not_matter():
    a = sa.mount("ur5", sa.mount("z1", SERVICER, at=LEFT, name="left"), at=RIGHT, name="right")
    b = sa.mount("z1", sa.mount("ur5", SERVICER, at=RIGHT, name="right"), at=LEFT, name="left")
    assert (a.tip, b.tip) == ("right_tool0", "left_gripperStator")
    for tip in ("left", "right", ("left", "right")):
        same(a.replace(tip=tip), b.replace(tip=tip))


def test_three_arms_of_one_kind_get_names_of_their_own():
    arm = SERVICER
    for angle in (0.0, 2.0, 4.0):
        turn = pin.SE3(pin.rpy.rpyToMatrix(0, 0, angle), np.zeros(3))
        arm = sa.mount("xarm7", arm, at=turn * pin.SE3(np.eye(3), np.array([0.3, 0, 0.5])))
    assert (arm.n, len(arm.held)) == (7, 14)
    assert arm.tip == "xarm7_3_link_eef"
    same(arm, rewritten(arm))
    three = arm.replace(tip=("xarm7", "xarm7_2", "xarm7_3"))
    assert len(set(three.joint_names)) == three.n == 21
    assert {name.rpartition("joint")[0] for name in three.joint_names} == {
        "",
        "xarm7_2_",
        "xarm7_3_",
    }
    assert [note.partition(":")[0] for note in arm.notes] == [
        f"all names of xarm7_{k} start with 'xarm7_{k}_'" for k in (2, 3)
    ]
    assert not three.held
    tips = three.at(np.zeros(21)).tips
    assert np.ptp([np.linalg.norm(tip.translation) for tip in tips]) < 1e-12


@pytest.mark.parametrize(
    ("hull", "name", "joints", "tip"),
    [
        ("hull", None, ("elbow", "wrist"), "tool"),
        ("base", None, ("elbow", "wrist"), "tool"),  # of the arm's base, whose names are others
        ("wrist", None, ("r_elbow", "r_wrist"), "r_tool"),
        ("hull", "left", ("left_elbow", "left_wrist"), "left_tool"),
    ],
)
def test_what_moves_keeps_its_names_unless_one_is_taken_or_the_arm_is_named(
    hull, name, joints, tip, tmp_path
):
    parts = (frame("world"), link("base"), joint("hold", "world", "base", "fixed"), link("upper"))
    hand = (link("tool"), joint("elbow", "base", "upper"), joint("wrist", "upper", "tool"))
    path = saved(robot(*parts, *hand), tmp_path)
    bus = sa.Bus(mass=90, size=(1, 1, 1), name=hull)
    arm = sa.mount(path, bus, name=name, locked={"wrist": 0.3} if name else None, tip="tool")
    assert (*arm.joint_names, *joints[arm.n :]) == joints
    assert arm.tip == tip
    start = f"{name or 'r'}_"
    assert {f"{start}world", f"{start}base", start[:-1]} < arm.whole.links.keys()
    assert f"{start}hold" in arm.whole.joints
    told = f"all names of r start with 'r_': {hull} has a 'wrist' already"
    assert (told in arm.notes) == (hull == "wrist")
    assert arm.whole.frames[tip].isApprox(arm.whole.frames[start[:-1]])


def test_an_arm_whose_own_parts_have_its_name_is_numbered(tmp_path):
    """The frame with the arm's name, and its base, get names that none of its links has."""
    for own in ("r", "r_base"):
        path = saved(robot(link("base"), link(own), joint("elbow", "base", own)), tmp_path)
        arm = sa.mount(path, SERVICER)
        assert (arm.tip, arm.joint_names) == (own, ("elbow",))
        assert {own, "r_2", "r_2_base"} < arm.whole.links.keys()


def test_names_that_are_taken_are_refused():
    arm = sa.mount("vispa", SERVICER, name="left")
    with pytest.raises(sa.ModelError, match="names that start with 'left' already"):
        sa.mount("vispa", arm, name="left")
    with pytest.raises(sa.ModelError, match="'bus' already"):
        sa.mount("vispa", SERVICER, name="bus")
    with pytest.raises(sa.ModelError, match="give it as text"):
        sa.mount("vispa", SERVICER, name="")


BUSES = {
    "bus.urdf": robot(link("hull", 80.0, inertia=np.diag([7.0, 8.0, 9.0]))),
    "bus.xml": """<mujoco><worldbody><body name="hull">{}<inertial pos="0 0 0" mass="80"
        diaginertia="7 8 9"/></body></worldbody></mujoco>""",
    "bus.sdf": """<sdf version="1.9"><model name="r"><link name="hull"><inertial><mass>80</mass>
        <inertia><ixx>7</ixx><iyy>8</iyy><izz>9</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial>
        </link></model></sdf>""",
}


@pytest.mark.parametrize("base", ["", "<freejoint/>"])
@pytest.mark.parametrize("name", BUSES)
def test_a_bus_without_joints_from_a_file_of_any_format(name, base, tmp_path):
    path = saved(BUSES[name].format(base), tmp_path, name)
    reference = sa.mount("vispa", sa.Bus(mass=80, inertia=np.diag([7, 8, 9]), name="hull"), ON_TOP)
    same(sa.mount("vispa", path, at=ON_TOP), reference)
    with pytest.raises(sa.ModelError, match=r"no joint can move"):
        sa.load(path)


def test_a_bus_without_joints_of_pinocchio(tmp_path):
    path = saved(BUSES["bus.urdf"], tmp_path, "bus.urdf")
    bus = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    same(sa.mount("vispa", bus, ON_TOP), sa.mount("vispa", path, ON_TOP))


def test_a_bus_with_panels_from_its_own_urdf(tmp_path):
    """Panels are held at zero, or count if they are to; locked ones are part of the bus."""
    wing = link("wing", 3.0, (0, 0.5, 0), np.diag([0.3, 0.1, 0.3]))
    text = robot(link("hull", 80.0), wing, joint("panel", "hull", "wing", axis=(0, 1, 0)))
    path = saved(text, tmp_path, "hull.urdf")
    arm = sa.mount("vispa", path, at=ON_TOP)
    assert (arm.n, arm.tip, dict(arm.held)) == (6, "tip", {"panel": 0.0})
    free = sa.mount("vispa", path, at=ON_TOP).replace(joints=["panel"])
    assert (free.n, free.joint_names[0], dict(free.held)) == (7, "panel", {})
    locked = arm.replace(locked={"panel": 0.4})
    assert (locked.n, dict(locked.held)) == (6, {})
    q = np.linspace(-1, 1, 6)
    same(arm, free.replace(locked={"panel": 0.0}))
    a, b = free.at([0.4, *q]), locked.at(q)
    np.testing.assert_allclose(a.A[:, 7:], b.A[:, 6:], atol=1e-12)
    np.testing.assert_allclose(a.com, b.com, atol=1e-13)
    same(locked, rewritten(locked))


def test_an_arm_alone_is_no_spacecraft(tmp_path):
    with pytest.raises(sa.ModelError, match=r"vispa is an arm without a spacecraft; mount it"):
        sa.load("vispa")
    with pytest.raises(sa.ModelError, match="unknown arm 'ur6'; valid, nearest first: ur5"):
        sa.mount("ur6", SERVICER)
    with pytest.raises(sa.ModelError, match="no such file"):
        sa.mount(tmp_path / "nowhere.urdf", SERVICER)
    with pytest.raises(sa.ConfigurationError, match="at is a tuple; give it as sa"):
        sa.mount("vispa", SERVICER, at=(0, 0, 1))
    massless = robot(frame("world"), link("arm"), joint("elbow", "world", "arm"))
    assert sa.mount(saved(massless, tmp_path), SERVICER).n == 1


@pytest.mark.parametrize("fixed", ["", frame("tool") + joint("bolt", "block", "tool", "fixed")])
def test_a_body_without_joints_is_no_arm(fixed, tmp_path):
    path = saved(robot(link("block"), fixed), tmp_path)
    with pytest.raises(sa.ModelError, match=r"no joint can move; an arm needs"):
        sa.mount(path, SERVICER)


def test_robots_whose_package_is_not_installed_say_so(monkeypatch):
    from spacearm.description import model_catalogue as catalogue

    missing = sa.arms()[1]._replace(path=Path("nowhere.urdf"))
    monkeypatch.setattr(catalogue, "arms_by_name", lambda: {"ur5": missing})
    with pytest.raises(sa.ModelError, match="pip install 'example-robot-data"):
        sa.mount("ur5", SERVICER)


def test_visuals_travel_with_the_arm(tmp_path):
    """Materials of one name in two colours, and mesh files, in a written file elsewhere."""
    pytest.importorskip("trimesh").creation.box().export(tmp_path / "part.stl")
    visual = (
        '<visual><geometry><mesh filename="part.stl"/></geometry><material name="paint"/></visual>'
    )
    files = []
    for i, color in enumerate(("1 0 0 1", "0 0 1 1")):
        paint = f'<material name="paint"><color rgba="{color}"/></material>'
        text = robot(paint, link("base"), link("arm", inside=visual), joint("j", "base", "arm"))
        files.append(saved(text, tmp_path, f"{i}.urdf"))
    arm = sa.mount(files[1], sa.mount(files[0], SERVICER, name="a"), name="b")
    (tmp_path / "elsewhere").mkdir()
    again = sa.load(arm.to_urdf(tmp_path / "elsewhere" / "whole.urdf"))
    for one in (arm, again, pickle.loads(pickle.dumps(arm))):
        colors = {shape.link: shape.color for shape in shapes(one)}
        assert colors["a_arm"] == (1, 0, 0, 1)
        assert colors["b_arm"] == (0, 0, 1, 1)


def test_the_file_names_its_tips(tmp_path):
    dual = sa.load("dual_ur5", tip=("right", "left"))
    path = dual.to_urdf(tmp_path / "dual.urdf")
    assert sa.load(path).tips == ("right", "left")
    assert sa.load(path, tip="left").tip == "left"
    bad = path.read_text().replace('<tip link="right"/>', '<tip link="rigth"/>')
    with pytest.raises(sa.ModelError, match="tip: unknown link 'rigth'; valid, nearest first: ri"):
        sa.load(saved(bad, tmp_path, "bad.urdf"))
    with pytest.raises(sa.SpaceArmError, match="cannot be written"):
        dual.to_urdf(tmp_path / "nowhere" / "dual.urdf")


def test_point_masses_on_bodies_can_be_read(tmp_path):
    arm = sa.load("planar2").replace(payload=3.0)
    same(arm, rewritten(arm))
    text = robot(link("bus", 50.0), link("arm", inertia=np.zeros((3, 3))), joint("e", "bus", "arm"))
    with pytest.raises(sa.ModelError, match="a motion of 'e' moves no mass"):
        formats.read(saved(text, tmp_path))


def test_an_arm_stands_on_the_top_face_of_a_bus_with_a_size():
    bus = sa.Bus(mass=12, size=(0.1, 0.2, 0.3), com=(0.01, 0, 0.02))
    at = pin.SE3(np.eye(3), np.array([0.01, 0.0, 0.17]))
    on, same_place = sa.mount("vispa", bus), sa.mount("vispa", bus, at)
    assert on.mount.isApprox(same_place.mount)
    assert sa.mount("vispa", bus, at.homogeneous).mount.isApprox(on.mount)
    inertia_only = sa.Bus(mass=12, inertia=np.eye(3))
    inside = sa.mount("vispa", inertia_only)
    assert inside.mount.isApprox(sa.mount("vispa", inertia_only, pin.SE3.Identity()).mount)


@pytest.mark.slow
def test_poses_are_matrices_too():
    arm, q = sa.load("mda6"), np.full(6, 0.3)
    base = pin.SE3(pin.utils.rotate("x", 0.4), np.array([1.0, 2.0, 3.0]))
    assert arm.at(q, base=base.homogeneous).tip.isApprox(arm.at(q, base=base).tip)
    goal = sa.move(arm.at(q), [0.05] * 6).tip
    ends = [sa.follow(arm.at(q), [g])[-1].q for g in (goal, goal.homogeneous)]
    np.testing.assert_array_equal(*ends)
    with pytest.raises(sa.ConfigurationError, match="has the last row"):
        arm.at(q, base=np.ones((4, 4)))
    with pytest.raises(sa.ConfigurationError, match=r"as pin\.SE3.* or as a \(4, 4\)"):
        arm.at(q, base=np.eye(3))


def test_a_pose_of_position_and_turns():
    pose = sa.pose(xyz=(0.1, -0.2, 0.3), rpy=(0.4, -0.5, 0.6))
    turns = Rotation.from_euler("xyz", (0.4, -0.5, 0.6)).as_matrix()  # fixed axes, as in a URDF
    np.testing.assert_allclose(pose.rotation, turns, atol=1e-15)
    np.testing.assert_array_equal(pose.translation, (0.1, -0.2, 0.3))
    assert sa.pose() == pin.SE3.Identity()
    with pytest.raises(sa.ConfigurationError, match="rpy"):
        sa.pose(rpy=(0.0, 0.0))
    with pytest.raises(sa.ConfigurationError, match=r"sa\.pose\(xyz="):
        sa.mount("vispa", sa.Bus(mass=200.0, size=(1.0, 1.0, 1.0)), at=[0.0, 0.0, 1.0])
