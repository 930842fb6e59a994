"""Collisions: contacts are found, freedom is proven, and plans keep bodies apart."""

import zipfile
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from helpers.arms import LIMIT, chosen, frame, joint, link, load_text, numbers, random_chain, robot
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa
from spacearm.collisions.separation import Collisions
from spacearm.description.shapes import Shape, Sphere, Visuals, read_mesh
from spacearm.model.arm import SpaceArm

ALONG_X = 'rpy="0 1.5707963267948966 0"'


def solid(geometry, xyz=(0, 0, 0), extra=""):
    return (
        f'<collision><origin xyz="{numbers(xyz)}" {extra}/><geometry>{geometry}</geometry>'
        "</collision>"
    )


def boxy(folder, hull='<box size="1 1 1"/>', third=False, inside=LIMIT):
    """Planar arm on a box: cylinders as links, half a metre and more from the box's face."""
    bar = solid('<cylinder radius="0.05" length="0.7"/>', (0.4, 0, 0), ALONG_X)
    names = ["l1", "l2", "l3"][: 3 if third else 2]
    parts = [link("hull", 50.0, inertia=10 * np.eye(3), inside=solid(hull))]
    parts += [link(name, 5.0, (0.4, 0, 0), 0.5 * np.eye(3), bar) for name in names]
    parts += [
        joint(f"j{i}", parent, child, xyz=(0.6 if i == 0 else 0.8, 0, 0), inside=inside)
        for i, (parent, child) in enumerate(zip(["hull", *names], names, strict=False))
    ]
    parts += [frame("tip"), joint("jt", names[-1], "tip", "fixed", (0.8, 0, 0))]
    path = folder / "boxy.urdf"
    path.write_text(robot(*parts))
    return sa.load(path)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return boxy(tmp_path_factory.mktemp("boxy"))


@pytest.fixture(scope="module")
def bodies(arm):
    return Collisions(arm)


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    return Collisions(boxy(tmp_path_factory.mktemp("three"), third=True))


def test_a_distance_in_closed_form(bodies):
    """Only the outer link may meet the hull; stretched, its bar begins 0.95 m from the face."""
    np.testing.assert_allclose(bodies.distances(np.zeros(2)), [0.95], atol=1e-6)


def test_links_without_shapes_are_not_checked_and_the_plan_says_so(tmp_path):
    path = tmp_path / "bare.urdf"
    path.write_text(
        robot(link("hull", 50.0), link("l1", 5.0), link("l2", 5.0), frame("tip"),
              joint("j1", "hull", "l1"), joint("j2", "l1", "l2", xyz=(1, 0, 0)),
              joint("jt", "l2", "tip", "fixed", (1, 0, 0)))
    )  # fmt: skip
    arm = sa.load(path)
    free = Collisions(arm)
    assert not free
    assert free.contact(np.zeros((1, 2))) is None
    plan = sa.plan(arm.at([0.3, 1.0]), sa.Joints([0.5, 1.2]))
    assert plan.apart is None
    assert plan.checked == "collisions NOT checked: the description gives the links no shapes"
    assert "NOT checked" in plan.story


def test_visuals_stand_in_for_missing_collision_geometry(arm, bodies, tmp_path):
    """The same robot with <visual> in place of <collision> keeps the same distances."""
    path = tmp_path / "drawn.urdf"
    path.write_text(arm.path.read_text().replace("collision>", "visual>"))
    drawn = sa.load(path)
    for q in np.random.default_rng(0).uniform(-3, 3, (20, 2)):
        np.testing.assert_allclose(Collisions(drawn).distances(q), bodies.distances(q), atol=1e-12)
    plan = sa.plan(drawn.at([0.3, 1.0]), sa.Joints([0.5, 1.2]))
    assert plan.checked == "collisions checked: by their visuals hull, l1, l2"
    assert plan.apart


def test_a_flat_visual_counts_as_the_box_around_it(tmp_path):
    (tmp_path / "flat.obj").write_text(MESHES["flat.obj"].replace("1 1 0", "0.5 1 0"))
    text = boxy(tmp_path).path.read_text()
    panel = '<visual><geometry><mesh filename="flat.obj"/></geometry></visual>'
    first = text.index("<collision>")
    last = text.index("</collision>") + len("</collision>")
    (tmp_path / "panel.urdf").write_text(text[:first] + panel + text[last:])
    drawn = Collisions(sa.load(tmp_path / "panel.urdf"))
    assert "by their visuals hull" in drawn.account
    # joint 1 at x = 0.6, the bar of the outer link from 0.6 + 0.8 + 0.05 on, the panel up to x = 1
    np.testing.assert_allclose(drawn.distances(np.zeros(2)), [0.45], atol=2e-3)


def test_a_bus_of_unknown_shape_is_not_checked():
    bus = sa.Bus(100.0, inertia=20.0 * np.eye(3))
    assert "NOT checked: links without shapes: bus" in Collisions(sa.mount("vispa", bus)).account


@pytest.mark.parametrize("name", [model.name for model in sa.catalogue()])
def test_catalogue_robots_have_collision_bodies_and_a_posture_without_contact(name):
    bodies = Collisions(sa.load(name))
    assert "by their visuals" not in bodies.account
    assert "NOT" not in bodies.account
    low, high = (np.clip(x, -np.pi, np.pi) for x in (bodies.arm.lower, bodies.arm.upper))
    Q = np.random.default_rng(0).uniform(low, high, (200, bodies.arm.n))
    assert any(bodies.contact(q[None]) is None for q in Q)


@pytest.mark.slow
def test_mda6_does_not_reach_into_its_spacecraft():
    """The tip 0.2 m above the middle of a box of 2.6 m: a plan without collisions gets there."""
    arm, q0 = sa.load("mda6"), np.radians([0, 60, -100, -50, 30, 0])
    inside = sa.plan(
        arm.at(q0),
        sa.Joints(np.radians([0, 100, -170, -50, 30, 0])),
        constraints=sa.Constraints(collisions=False),
    )
    assert Collisions(arm).contact(inside.q) is not None
    assert inside.checked == "collisions NOT checked (collisions=False)"


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), min_size=1, max_size=3))
def test_contact_or_proof_as_dense_sampling_has_it(bodies, path):
    path = np.array(path)
    dense = [a + (b - a) * s for a, b in pairwise(path) for s in np.linspace(0, 1, 60)]
    least = min(bodies.distances(q).min() for q in (*path, *dense))
    contact = bodies.contact(path)
    if least <= 0.0:
        assert contact is not None
        assert contact.links == ("hull", "l2")
        assert bodies.distances(contact.q).min() < 2e-3
    elif least > 0.02:
        assert contact is None


@given(st.integers(0, 10**6))
def test_no_joint_motion_outruns_its_bound(three, seed):
    """|d(q + dq) - d(q)| <= gain |dq|, which the proof rests on."""
    rng = np.random.default_rng(seed)
    q, dq = rng.uniform(-3, 3, 3), rng.normal(size=3) * 10 ** rng.uniform(-3, 0)
    change = np.abs(three.distances(q + dq) - three.distances(q))
    assert (change <= three.gains(np.array([q, q + dq])) @ np.abs(dq) + 1e-6).all()


def test_a_mesh_counts_as_its_convex_hull(tmp_path, bodies):
    cube = trimesh.creation.box((1000, 1000, 1000))
    cube.export(tmp_path / "cube.stl")
    mesh = Collisions(boxy(tmp_path, '<mesh filename="cube.stl" scale="0.001 0.001 0.001"/>'))
    for q in np.random.default_rng(0).uniform(-3, 3, (20, 2)):
        expected = bodies.distances(q)
        if expected > 0.0:
            np.testing.assert_allclose(mesh.distances(q), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("start", "goal"), [((1.8, 0.9), (0.45, 2.65)), ((0.4, 2.68), (1.54, 1.93))]
)
def test_plans_go_around_the_spacecraft(arm, bodies, start, goal):
    assert bodies.contact(np.array([start, goal])) is not None
    plan = sa.plan(arm.at(start), sa.Joints(goal))
    assert plan.apart
    np.testing.assert_allclose(plan.q[-1], goal, atol=1e-8)
    dense = [a + (b - a) * s for a, b in pairwise(plan.q) for s in (0.25, 0.5, 0.75)]
    assert min(bodies.distances(q).min() for q in (*plan.q, *dense)) > 0.0


def test_a_start_in_collision(arm):
    q = np.array([1.2, 3.0])
    with pytest.raises(sa.NoSolutionError, match="start is in collision: 'hull' meets 'l2'"):
        sa.plan(arm.at(q), sa.Joints([0.5, 0.5]))
    assert sa.plan(
        arm.at(q), sa.Joints([1.1, 2.5]), constraints=sa.Constraints(collisions=False)
    ).q[-1] == pytest.approx([1.1, 2.5])


def test_a_goal_in_collision(arm):
    with pytest.raises(sa.NoSolutionError, match="goal is in collision: 'hull' meets 'l2'"):
        sa.plan(arm.at([0.3, 1.0]), sa.Joints([1.2, 3.0]))


@pytest.mark.parametrize("geometry", ["<cone/>", ""])
def test_a_geometry_of_no_known_kind(tmp_path, geometry):
    arm = boxy(tmp_path, geometry)
    with pytest.raises(sa.ModelError, match=r"'hull' has a collision .* collisions=False"):
        sa.plan(arm.at([0.3, 1.0]), sa.Joints([0.5, 1.2]))
    assert sa.plan(
        arm.at([0.3, 1.0]), sa.Joints([0.5, 1.2]), constraints=sa.Constraints(collisions=False)
    )


SIZES = [
    '<box size="-2 -2 -2"/>', '<box size="1 0 1"/>', '<sphere radius="-1"/>',
    '<cylinder radius="-1" length="1"/>', '<cylinder radius="1" length="0"/>',
]  # fmt: skip


@pytest.mark.parametrize("geometry", SIZES)
def test_sizes_that_no_body_has_are_no_proof(tmp_path, geometry):
    """coal takes them, and finds such bodies far from everything."""
    with pytest.raises(sa.ModelError, match=r"hull.* has .*; give positive lengths"):
        Collisions(boxy(tmp_path, geometry))


@pytest.mark.parametrize("sphere", [-1.0, 0.0])
def test_sizes_that_no_body_has_are_no_proof_in_any_format(arm, sphere):
    """Readers of other formats take them as they are; the check does not."""
    shape = Shape(pin.SE3.Identity(), Sphere(sphere))
    visuals = {**arm.tree.visuals, "hull": Visuals(collision=(shape,))}
    other = SpaceArm.of(replace(arm.tree, visuals=visuals), arm.path)
    with pytest.raises(sa.ModelError, match=r"'hull' has a collision .*; give positive lengths"):
        Collisions(other)


MESHES = {
    "box.stl": "",
    "flat.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 3 4\n",
    "vast.obj": "v 1e308 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1e300\nf 1 2 3\nf 1 2 4\nf 2 3 4\n",
    "large.obj": "v 2 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 2 3 4\n",
    "nan.obj": "v nan 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 2 3 4\n",
    "bare.obj": "v 0 0 0\nv 1 0 0\n",
    "box.zip": "",
    "zipped.dae": "",
    "text.urdf": "<robot/>",
    "broken.glb": "glTF",
}


NODES = "".join(
    f'<node id="n{i + 1}"><instance_node url="#n{i}"/><instance_node url="#n{i}"/></node>'
    for i in range(60)
)
ENTITIES = "".join(f'<!ENTITY e{i + 1} "{f"&e{i};" * 10}">' for i in range(30))
MESHES |= {
    "many.dae": f'<COLLADA xmlns="c"><library_nodes><node id="n0"/>{NODES}</library_nodes>'
    '<library_visual_scenes><visual_scene id="s"><node><instance_node url="#n60"/></node>'
    '</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>'
    "</COLLADA>",
    "round.dae": '<COLLADA xmlns="c"><library_nodes><node id="n"><instance_node url="#n"/></node>'
    '</library_nodes><library_visual_scenes><visual_scene id="s"><node><instance_node url="#n"/>'
    "</node></visual_scene></library_visual_scenes>"
    '<scene><instance_visual_scene url="#s"/></scene></COLLADA>',
    "entities.dae": f'<!DOCTYPE c [<!ENTITY e0 "e">{ENTITIES}]><COLLADA>&e30;</COLLADA>',
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "scale", "message"),
    [
        ("box.stl", "1 1 0", "is flat"),
        ("box.stl", "0 0 0", "is flat"),
        ("box.stl", "1e12 1e-12 1", "is flat"),
        ("large.obj", "1e12 1 1", "is larger than 1e"),
        ("box.stl", "1e12 1e12 1e13", "3 finite numbers up to 1e"),
        ("flat.obj", "1 1 1", "is flat"),
        ("vast.obj", "1 1 1", "not finite or beyond"),
        ("nan.obj", "1 1 1", "not finite or beyond"),
        ("bare.obj", "1 1 1", "'bare.obj' cannot be read"),
        ("box.zip", "1 1 1", "'box.zip' cannot be read .give one of .stl"),
        ("zipped.dae", "1 1 1", "'zipped.dae' cannot be read .it is an archive"),
        ("many.dae", "1 1 1", "'many.dae' cannot be read .it places more than 10,000 nodes"),
        ("round.dae", "1 1 1", "'round.dae' cannot be read .its nodes are nested too deeply"),
        ("entities.dae", "1 1 1", "'entities.dae' cannot be read .it declares a DOCTYPE"),
        ("text.urdf", "1 1 1", "'text.urdf' cannot be read .give one of .stl"),
        ("broken.glb", "1 1 1", "'broken.glb' cannot be read"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*shapes of 'hull' reach")
def test_meshes_without_a_hull_are_named(tmp_path, name, scale, message):
    (tmp_path / name).write_text(MESHES[name])
    if name == "box.stl":
        trimesh.creation.box().export(tmp_path / name)
    if name in ("box.zip", "zipped.dae"):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            archive.writestr("box.obj", MESHES["vast.obj"])
    arm = boxy(tmp_path, f'<mesh filename="{name}" scale="{scale}"/>')
    with pytest.raises(sa.ModelError, match=message):
        sa.plan(arm.at([0.3, 1.0]), sa.Joints([0.5, 1.2]))
    assert sa.plan(
        arm.at([0.3, 1.0]), sa.Joints([0.5, 1.2]), constraints=sa.Constraints(collisions=False)
    )


def test_a_corner_with_more_neighbours_than_coal_counts(tmp_path):
    trimesh.creation.cone(1.0, 2.0, sections=600).export(tmp_path / "cone.stl")
    with pytest.raises(sa.ModelError, match="has too many corners for coal"):
        Collisions(boxy(tmp_path, '<mesh filename="cone.stl"/>'))


@pytest.mark.parametrize("shape", ["box", "icosphere", "cylinder"])
def test_the_hull_of_a_mesh_is_as_far_away_as_the_body(tmp_path, shape):
    """Mirrored and stretched too: along x, of the hull's nearest point."""
    mesh = getattr(trimesh.creation, shape)(**SHAPES[shape])
    mesh.export(tmp_path / "body.ply")
    for scale in ("0.5 1 1", "-0.5 1 1"):
        bodies = Collisions(boxy(tmp_path, f'<mesh filename="body.ply" scale="{scale}"/>'))
        expected = 0.6 + 0.8 + 0.05 - 0.5 * mesh.vertices[:, 0].max()
        np.testing.assert_allclose(bodies.distances(np.zeros(2)), [expected], atol=1e-5)


SHAPES = {
    "box": {"extents": (1, 1, 1)},
    "icosphere": {"radius": 0.5},
    "cylinder": {"radius": 0.5, "height": 1.0, "sections": 64},
}


# --- slides, locks, branches ----------------------------------------------------------------


def telescope(folder, slide, follower="", hull=(4.4, 2.4, 0)):
    """A turning joint, a slide on it, a ball at its end; a ball of the hull in its way."""
    ball = solid('<sphere radius="0.1"/>')
    parts = [
        link("hull", 50.0, inertia=10 * np.eye(3), inside=solid('<sphere radius="0.1"/>', hull)),
        link("boom", 5.0), link("slider", 5.0, inside="" if follower else ball),
        joint("j1", "hull", "boom", xyz=(0, 0, 0)),
        joint("j2", "boom", "slider", "prismatic", (0, 0, 0), axis=(1, 0, 0), inside=slide),
    ]  # fmt: skip
    if follower:
        parts += [
            link("end", 1.0, inside=ball),
            joint("j3", "slider", "end", "prismatic", (0, 0, 0), axis=(1, 0, 0), inside=follower),
        ]
    path = folder / "telescope.urdf"
    path.write_text(robot(*parts))
    return sa.load(path, tip="end" if follower else "slider", task="x y")


@pytest.mark.parametrize(
    ("slide", "follower", "out"),
    [
        ('<limit lower="0" upper="0.1" effort="1" velocity="1"/>', "", 5.0),
        ('<limit effort="1" velocity="1"/>', "", 5.0),
        (
            '<limit lower="0" upper="5" effort="1" velocity="1"/>',
            '<limit lower="0" upper="0.1" effort="1" velocity="1"/>'
            '<mimic joint="j2" multiplier="3"/>',
            1.25,
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:.*no limits on:spacearm.ModelWarning")
def test_slides_reach_as_far_as_they_are_out(tmp_path, slide, follower, out):
    bodies = Collisions(telescope(tmp_path, slide, follower))
    path = np.array([[-1.0, out], [1.0, out]])
    contact = bodies.contact(path)
    assert contact is not None
    assert contact.q[0] == pytest.approx(np.arctan2(2.4, 4.4), abs=0.06)
    assert bodies.contact(path - [2.0, 0.0]) is None


def test_a_locked_joint_does_not_join_the_links_beyond_it(tmp_path):
    """Links that no joint of the URDF connects are watched, also where a lock makes them one."""
    arm = boxy(tmp_path)
    locked = Collisions(sa.load(arm.path, locked={"j0": 1.2}))
    assert locked.contact(np.array([[3.0]])).links == ("hull", "l2")
    np.testing.assert_allclose(
        locked.distances(np.array([2.0])),
        Collisions(arm).distances(np.array([1.2, 2.0])),
        atol=1e-12,
    )


def test_what_a_reader_of_meshes_grumbles_about_is_not_logged(tmp_path, caplog):
    text = trimesh.creation.box().export(file_type="stl_ascii")
    path = tmp_path / "box.stl"
    path.write_text(text.replace("facet normal", "facet normal there"))
    assert len(read_mesh(path).faces) == 12
    assert not caplog.records


def test_a_missing_mesh_is_no_proof(tmp_path):
    with pytest.warns(sa.ModelWarning, match="meshes not found"):
        arm = boxy(tmp_path, '<mesh filename="nowhere.stl"/>')
    plan = sa.plan(arm.at([0.3, 1.0]), sa.Joints([0.5, 1.2]))
    assert plan.checked.endswith("NOT checked: links without shapes: hull")
    assert plan.story.endswith("; NOT checked: links without shapes: hull")
    assert plan.describe().verdict.endswith("; NOT checked: links without shapes: hull")


def test_the_verdict_names_the_links_that_were_not_checked(arm):
    mounted = sa.mount("vispa", sa.Bus(100.0, inertia=20.0 * np.eye(3)))
    report = sa.collision_check(mounted.at(np.zeros(mounted.n)))
    assert report.unchecked == ("bus",)
    assert report.describe().verdict == report.story
    assert report.apart
    assert "NOT checked: links without shapes: bus" in report.story
    whole = sa.collision_check(arm.at(np.zeros(2)))
    assert whole.apart
    with pytest.raises(sa.UnsupportedError, match="has no shapes that could meet; give its links"):
        sa.collision_check(load_text(random_chain(1, 2), task="x").at([0.1, 0.2]))


@pytest.mark.slow
def test_an_arm_of_too_many_shapes_is_refused_before_its_pairs_are_listed():
    """Their number grows as the square: 10^8 pairs of 20,000 shapes."""
    shape = '<visual><origin xyz="{} 0 0"/><geometry><sphere radius="0.1"/></geometry></visual>'
    shapes = "".join(shape.format(1e-5 * i) for i in range(20_000))
    text = random_chain(chosen(0), 2).replace('<link name="bus">', f'<link name="bus">{shapes}')
    arm = load_text(text)
    with pytest.raises(sa.UnsupportedError, match=r"at most 1,000.*collisions=False"):
        sa.collision_check(arm.at([0.1, 0.2]))
    with pytest.warns(sa.ModelWarning, match="drawn as plain bodies"):
        viewer = sa.view(arm.at([0.1, 0.2]), open=False)
    assert viewer.about()["contacts"].startswith("collisions not checked")


def test_distances_do_not_depend_on_what_was_asked_before():
    bodies, Q = Collisions(sa.load("mda6")), np.random.default_rng(0).uniform(-2, 2, (10, 6))
    first = bodies.distances(Q[0])
    for q in Q:
        bodies.distances(q)
    np.testing.assert_array_equal(bodies.distances(Q[0]), first)
