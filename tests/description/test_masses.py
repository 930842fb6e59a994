"""Mass data as published: what is repaired, left out or refused, and that it is said."""

import numpy as np
import pytest
from helpers.arms import frame, joint, link, load_text, random_inertia, robot, seeds, two_links
from hypothesis import given

import spacearm as sa

BUS = link("bus", 50.0, inertia=np.diag([9.0, 8.0, 7.0]))
ARM = link("arm", 3.0, com=(0.4, 0.0, 0.1), inertia=np.diag([0.2, 0.3, 0.4]))
TOOL = link("tool", 1.0, com=(0.2, 0.1, 0.0), inertia=np.diag([0.02, 0.03, 0.04]))
ELBOW = joint("elbow", "bus", "arm")


def jacobian(arm, q):
    return sa.generalized_jacobian(arm.at(q))


def universal(cross):
    """An arm with a universal joint, whose cross has the mass properties given, or none."""
    return robot(
        BUS,
        ARM,
        cross,
        TOOL,
        ELBOW,
        joint("pitch", "arm", "cross", axis=(0, 1, 0)),
        joint("yaw", "cross", "tool", xyz=(0, 0, 0), axis=(0, 0, 1)),
    )


# --- links without mass ---------------------------------------------------------------------


def test_a_massless_link_between_joints_is_the_limit_of_a_light_one():
    with pytest.warns(sa.ModelWarning, match="without mass are taken as massless: 'cross'"):
        arm = load_text(universal(frame("cross")))
    q = [0.3, -0.7, 0.5]
    errors = []
    for mass in (1e-2, 1e-3):
        light = load_text(universal(link("cross", mass, inertia=mass * np.eye(3) / 10)))
        errors.append(np.abs(jacobian(light, q) - jacobian(arm, q)).max())
    assert errors[1] == pytest.approx(errors[0] / 10, rel=0.05)  # proportional to the mass
    assert errors[1] < 1e-4
    assert "massless: 'cross'" in arm.notes[0]


def test_forward_dynamics_with_a_massless_link_obey_inverse_dynamics():
    with pytest.warns(sa.ModelWarning, match="massless"):
        arm = load_text(universal(frame("cross")))
    dq, torque = np.array([0.1, 0.2, -0.3]), np.array([0.5, -0.2, 0.1])
    motion = sa.forward_dynamics(arm.at([0.3, -0.7, 0.5]), dq, torque)
    assert np.isfinite(motion.ddq).all()


@pytest.mark.parametrize("wheel", [frame("wheel"), link("wheel", 0.0, inertia=np.zeros((3, 3)))])
def test_movable_leaves_without_mass_are_held(wheel):
    text = robot(BUS, ARM, ELBOW, wheel, joint("spin", "bus", "wheel"))
    with pytest.warns(sa.ModelWarning, match=r"'wheel' has no mass and.*'spin' is held"):
        arm = load_text(text)
    assert arm.joint_names == ("elbow",)
    alone = load_text(robot(BUS, ARM, ELBOW))
    assert np.array_equal(jacobian(arm, [0.4]), jacobian(alone, [0.4]))
    assert load_text(text, check="accept", tip="arm", joints="all").n == 2


def test_a_chain_of_massless_leaves_is_held_within_its_limits():
    limit = '<limit lower="0.5" upper="1" effort="1" velocity="1"/>'
    chain = (joint("a", "bus", "a"), joint("b", "a", "b", inside=limit))
    with pytest.warns(sa.ModelWarning) as caught:
        arm = load_text(robot(BUS, ARM, ELBOW, frame("a"), frame("b"), *chain))
    assert len(caught) == 2
    assert arm.joint_names == ("elbow",)
    assert arm.tree.joints["b"].kind == "fixed"
    yaw = arm.tree.joints["b"].origin.rotation
    assert yaw[1, 0] == pytest.approx(np.sin(0.5))


def test_a_massless_leaf_that_leads_a_massive_one_moves():
    follows = '<limit lower="-1" upper="1" effort="1" velocity="1"/><mimic joint="a"/>'
    text = robot(
        BUS,
        frame("a"),
        TOOL,
        joint("a", "bus", "a"),
        joint("b", "bus", "tool", inside=follows),
    )
    with pytest.warns(sa.ModelWarning, match="massless: 'a'"):
        assert load_text(text, tip="tool").joint_names == ("a",)


def test_joints_that_share_one_body_beyond_its_freedoms_are_refused():
    names = [f"l{i}" for i in range(1, 8)]
    axes = np.random.default_rng(1).normal(size=(8, 3))
    joints = [
        joint(f"j{i}", a, b, xyz=axes[i - 1], axis=axes[i])
        for i, (a, b) in enumerate(zip(["bus", *names], [*names, "tool"], strict=False))
    ]
    text = robot(BUS, *map(frame, names), TOOL, *joints[:7], joint("end", "l7", "tool", "fixed"))
    with pytest.raises(sa.ModelError, match=r"a motion of .* moves no mass.*for 'l1', 'l2'"):
        load_text(text)
    six = robot(BUS, *map(frame, names[:6]), TOOL, *joints[:6], joint("end", "l6", "tool", "fixed"))
    with pytest.warns(sa.ModelWarning, match="massless: 'l1'"):
        assert load_text(six).n == 6


def test_two_joints_on_one_axis_with_nothing_between_are_refused():
    text = robot(
        BUS,
        frame("hub"),
        ARM,
        joint("first", "bus", "hub"),
        joint("second", "hub", "arm", xyz=(0, 0, 0.2)),
    )
    with pytest.raises(sa.ModelError, match=r"a motion of 'first', 'second' moves no mass"):
        load_text(text)
    with pytest.warns(sa.ModelWarning, match="'first', 'second' moves no mass"):
        arm = load_text(text, check="warn")
    assert np.isfinite(sa.singularity(arm.at([0.1, 0.2])).sigma).all()


def test_an_arm_alone_is_told_to_be_mounted(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(robot(frame("base"), ARM, joint("elbow", "base", "arm")))
    with pytest.raises(sa.ModelError, match=r"as if this were an arm alone; mount it: sa\.mount\("):
        sa.load(path)
    assert sa.mount(path, sa.Bus(mass=9, size=(1, 1, 1))).mass == 12.0


def test_a_frame_that_carries_nothing_is_no_arm_to_be_mounted():
    text = robot(frame("base"), frame("arm"), joint("weld", "base", "arm", "fixed"))
    with pytest.raises(sa.ModelError, match="'base' has no mass, and no joint can move; describe"):
        load_text(text)


def test_a_world_that_the_spacecraft_floats_in_is_left_out():
    plain = load_text(robot(BUS, ARM, ELBOW))
    for kind in ("floating", "planar"):
        world = robot(frame("world"), BUS, ARM, ELBOW, joint("free", "world", "bus", kind))
        with pytest.warns(sa.ModelWarning, match=f"'free' of type '{kind}' and 'world'"):
            arm = load_text(world)
        assert arm.tree.root == "bus"
        assert np.array_equal(jacobian(arm, [0.4]), jacobian(plain, [0.4]))


# --- impossible inertias ----------------------------------------------------------------------


def test_a_fault_of_a_link_does_not_matter_in_a_sound_body():
    plate = link("plate", 0.1, inertia=np.diag([0.0, 0.0, 1e-3]))
    text = robot(BUS, ARM, plate, ELBOW, joint("glue", "arm", "plate", "fixed"))
    with pytest.warns(sa.ModelWarning, match=r"'plate' has an inertia that is not.*the body it is"):
        arm = load_text(text, tip="arm")
    parts = [arm.tree.links[name].spatial() for name in ("arm", "plate")]
    placement = arm.tree.joints["glue"].origin
    assert arm.model.inertias[2].isApprox(parts[0] + placement.act(parts[1]), 1e-12)


def test_slender_rods_are_accepted_where_nothing_turns_about_them():
    rod = link("arm", 2.0, com=(0.5, 0, 0), inertia=np.diag([0.0, 0.1, 0.1]))
    ball = link("arm", 2.0, com=(0.5, 0, 0), inertia=np.zeros((3, 3)))
    for body in (rod, ball):
        with pytest.warns(sa.ModelWarning, match="without inertia about some axis.*thin: 'arm'"):
            arm = load_text(robot(BUS, body, joint("elbow", "bus", "arm", axis=(0, 1, 0))))
        assert np.isfinite(jacobian(arm, [0.4])).all()
    with pytest.raises(sa.ModelError, match="a motion of 'elbow' moves no mass"):
        load_text(robot(BUS, rod, joint("elbow", "bus", "arm", axis=(1, 0, 0))))


# --- planar systems -------------------------------------------------------------------------


def planar(moments, axes="z"):
    """Two links in the plane, with (3, 3) inertias made of moments about the normal."""
    bodies = [
        link(name, mass, com=(0.3, 0.0, 0.0), inertia=inertia)
        for name, mass, inertia in zip(("bus", "a", "b"), (13.0, 2.0, 3.0), moments, strict=True)
    ]
    axis = {"z": (0, 0, 1), "x": (1, 0, 0)}[axes]
    joints = (joint("j1", "bus", "a", axis=axis), joint("j2", "a", "b", axis=axis))
    return robot(*bodies, *joints)


def test_inertia_about_the_normal_is_enough_in_the_plane():
    about_z = [np.diag([0.0, 0.0, I]) for I in (0.3, 0.1, 0.2)]
    with pytest.warns(sa.ModelWarning, match="planar system: of 'bus', 'a', 'b' only the moment"):
        flat = load_text(planar(about_z))
    rng = np.random.default_rng(0)
    whole = load_text(planar([np.diag([*rng.uniform(1.0, 1.1, 2), I[2, 2]]) for I in about_z]))
    for q in rng.uniform(-3, 3, (5, 2)):
        a, b = jacobian(flat, q), jacobian(whole, q)
        assert np.allclose(a[[0, 1, 5]], b[[0, 1, 5]], atol=1e-13)
        assert np.allclose(a[[2, 3, 4]], 0.0, atol=1e-13)


def test_inertia_about_one_axis_is_not_enough_in_space():
    flat = [np.diag([0.0, 0.0, I]) for I in (0.3, 0.1, 0.2)]
    with pytest.raises(sa.ModelError, match="'bus' has an inertia that is not positive definite"):
        load_text(planar(flat, axes="x"))


def test_a_planar_system_has_its_centres_of_mass_in_one_plane():
    flat = [np.diag([0.0, 0.0, I]) for I in (0.3, 0.1, 0.2)]
    raised = planar(flat).replace('xyz="0.3 0.0 0.0"', 'xyz="0.3 0.0 0.4"', 1)
    with pytest.raises(sa.ModelError, match="not positive definite"):
        load_text(raised)


# --- density --------------------------------------------------------------------------------


def shaped(geometry, tag="collision", pose=""):
    return f'<link name="arm"><{tag}>{pose}<geometry>{geometry}</geometry></{tag}></link>'


SHAPES = {
    "box": ('<box size="0.1 0.2 0.3"/>', 0.006, np.array([0.13, 0.10, 0.05]) / 12),
    "sphere": ('<sphere radius="0.2"/>', 4 / 3 * np.pi * 0.008, np.full(3, 0.4 * 0.04)),
    "capsule": (  # a cylinder, and two half balls with their centres of mass at 3/8 r
        '<capsule radius="0.1" length="0.6"/>',
        np.pi * (0.006 + 4 / 3000),
        np.array(
            [
                *[
                    (0.006 * (0.0025 + 0.03) + 4 / 3000 * (0.4 * 0.01 + 0.09 + 2 * 0.3 * 0.0375))
                    / (0.006 + 4 / 3000)
                ]
                * 2,
                (0.006 * 0.005 + 4 / 3000 * 0.004) / (0.006 + 4 / 3000),
            ]
        ),
    ),
    "cylinder": (
        '<cylinder radius="0.1" length="0.6"/>',
        np.pi * 0.006,
        np.array([0.0025 + 0.03, 0.0025 + 0.03, 0.005]),
    ),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("tag", ["collision", "visual"])
def test_density_gives_links_the_inertia_of_their_shapes(shape, tag):
    geometry, volume, moments = SHAPES[shape]
    pose = '<origin xyz="0.5 0.1 0"/>'
    text = robot(BUS, shaped(geometry, tag, pose), ELBOW)
    with pytest.warns(sa.ModelWarning, match=r"density 2700 kg/m.3 gives mass.*'arm'"):
        arm = load_text(text, density=2700)
    body = arm.model.inertias[2]
    assert body.mass == pytest.approx(2700 * volume)
    assert np.allclose(body.lever, (0.5, 0.1, 0))
    assert np.allclose(body.inertia, 2700 * volume * np.diag(moments), rtol=1e-9)
    assert arm.model.inertias[1].mass == 50.0  # what has mass keeps it


@pytest.mark.parametrize("open_mesh", [False, True])
def test_density_of_meshes(open_mesh, tmp_path):
    import trimesh

    mesh = trimesh.creation.box((100.0, 200.0, 300.0))
    if open_mesh:
        mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(tmp_path / "box.stl")
    geometry = '<mesh filename="box.stl" scale="0.001 0.001 0.001"/>'
    path = tmp_path / "robot.urdf"
    path.write_text(robot(BUS, shaped(geometry), ELBOW))
    with pytest.warns(sa.ModelWarning) as notes:
        body = sa.load(path, density=1000).model.inertias[2]
    said = " ".join(str(note.message) for note in notes)
    assert "gives mass" in said
    assert ("'arm' are not closed" in said) == open_mesh
    assert body.mass == pytest.approx(6.0, rel=1e-5)
    assert np.allclose(body.inertia, np.diag([0.13, 0.10, 0.05]) / 2, rtol=1e-5)


def test_a_mirrored_mesh_weighs_as_much_as_its_image(tmp_path):
    """A negative scale turns its triangles inside out; it is as solid as before, not a hull."""
    import trimesh

    trimesh.creation.annulus(0.05, 0.1, 0.2).export(tmp_path / "tube.stl")
    masses = []
    for scale in ("1 1 1", "-1 1 1"):
        path = tmp_path / "robot.urdf"
        path.write_text(robot(BUS, shaped(f'<mesh filename="tube.stl" scale="{scale}"/>'), ELBOW))
        with pytest.warns(sa.ModelWarning, match="gives mass"):
            masses.append(sa.load(path, density=1000).model.inertias[2].mass)
    assert masses[1] == pytest.approx(masses[0], rel=1e-6)
    assert masses[0] == pytest.approx(1000.0 * np.pi * 0.2 * (0.1**2 - 0.05**2), rel=0.02)


def test_a_mass_of_next_to_nothing_is_none():
    tool = link("tool", 4.2e-15), joint("mounted", "arm", "tool", kind="fixed")
    with pytest.warns(sa.ModelWarning, match=r"'tool' \(line 6\) is 4.2e-15 kg: taken as massless"):
        arm = load_text(robot(*two_links(), *tool))
    assert arm.tip == "tool"
    assert arm.mass == pytest.approx(51.0, rel=1e-12)


def test_density_of_nothing():
    missing = shaped('<mesh filename="nowhere.stl"/>').replace("arm", "tool")
    text = robot(BUS, ARM, ELBOW, missing, joint("end", "arm", "tool", "fixed"))
    with pytest.warns(sa.ModelWarning) as caught:
        load_text(text, density=1000)
    assert any("gives no mass to 'tool'" in str(one.message) for one in caught)
    bare = robot(BUS, missing, joint("elbow", "bus", "tool"))
    with pytest.warns(sa.ModelWarning), pytest.raises(sa.ModelError, match="or the mesh files of"):
        load_text(bare, density=1000)
    for wrong in (0, -1, np.nan):
        with pytest.raises(sa.ConfigurationError, match=r"density is .*give a positive density"):
            load_text(text, density=wrong)


def test_an_arm_on_a_light_foot_is_noted():
    foot = link("foot", 0.5)
    arm = load_text(robot(foot, ARM, joint("elbow", "foot", "arm")))
    assert "has 0.5 kg, and what moves on it 3 kg, as if this were an arm alone" in arm.notes[0]


# --- notes ----------------------------------------------------------------------------------


def test_notes_say_what_warnings_say_and_stay_with_the_arm():
    with pytest.warns(sa.ModelWarning) as caught:
        arm = load_text(robot(*two_links(inside="")))
    assert [str(one.message).partition(": ")[2] for one in caught] == list(arm.notes)
    assert arm.replace(payload=1.0).notes == arm.notes
    assert arm.grasp(3.0).notes == arm.notes
    assert arm.to_dict()["notes"] == list(arm.notes)


@given(seeds)
def test_a_massless_link_changes_nothing_but_its_own_mass(seed):
    """Momentum with a massless link is that of the bodies that are left, at their own twists."""
    rng = np.random.default_rng(seed)
    tool = link("tool", 1.0, rng.normal(size=3) * 0.3, random_inertia(rng, 1.0))
    text = universal(frame("cross")).replace(TOOL, tool)
    with pytest.warns(sa.ModelWarning, match="massless"):
        arm = load_text(text)
    q, dq = rng.uniform(-2, 2, (2, 3))
    h = 1e-6
    ahead, behind = (arm.at(q + s * h * dq) for s in (1, -1))
    rate = (ahead.com - behind.com) / (2 * h)
    A_q = sa.momentum_matrix(arm.at(q)).A_q
    assert np.allclose(A_q[:3] @ dq, arm.mass * rate, atol=1e-7)
