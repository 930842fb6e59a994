"""Any result with a posture can be shown; what has none is refused with a list of what can."""

import json
import warnings
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
import trimesh
import umsgpack
from helpers.arms import joint, link, load_text, robot, two_links, with_wheels
from helpers.catching import caught
from helpers.closed import roomy

import spacearm as sa
from spacearm.description.bodies import Inertial

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    from spacearm.description.shapes import coarsened
    from spacearm.viewer.layers import ellipsoid
    from spacearm.viewer.session import Session
    from spacearm.viewer.shapes import shapes
    from spacearm.viewer.stage import AMBER, AXES, CYAN, MAGENTA, PINK
    from spacearm.viewer.window import PAGE, Key, json_in_html

Q = [0.3, 1.2]
COLOUR_BLIND = {  # Machado, Oliveira & Fernandes 2009, severity 1, on linear RGB
    "protan": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deutan": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritan": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}
TO_XYZ = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]


@pytest.fixture(scope="module")
def arm():
    return sa.load("planar2")


def shown(thing):
    return sa.view(thing, open=False).session


@pytest.mark.parametrize("name", ["planar2", "mda6", "vispa_cubesat"])
def test_an_arm_opens_well_away_from_singularities(name):
    first, second = (shown(sa.load(name)) for _ in range(2))
    assert first.report.kind == "regular"
    assert first.report.distance > np.radians(5)
    assert not first.cfg.outside_limits
    room = np.minimum(first.cfg.q - first.arm.lower, first.arm.upper - first.cfg.q)
    assert (room > 0.0).all(), "the tip can be pulled all around"
    assert first.cfg.q.tolist() == second.cfg.q.tolist()
    assert shown(first.arm.at(np.zeros(first.arm.n))).cfg.q.tolist() == [0] * first.arm.n


def test_an_arm_stands_where_it_is_asked_to(arm):
    pose = pin.SE3(pin.utils.rotate("z", 0.4), np.array([1.0, 2.0, 0.0]))
    session = shown(arm.at(Q, base=pose))
    assert session.cfg.q.tolist() == Q
    assert session.cfg.base.isApprox(pose)


def test_a_configuration_and_results_that_have_one(arm):
    cfg = arm.at(Q, base=pin.SE3(pin.utils.rotate("z", 0.4), np.zeros(3)))
    assert shown(cfg).cfg is cfg
    capture = sa.capture(cfg, np.zeros(6), 2.0)
    assert shown(capture).cfg is capture.configuration
    assert shown(SimpleNamespace(configuration=cfg)).cfg is cfg


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*drawn as plain bodies")
def test_what_is_held_is_drawn_and_led_with_the_hands(tmp_path):
    held, far = roomy(tries=1)
    for thing in (held, held.report()):
        session = shown(thing)
        np.testing.assert_allclose(session.cfg.q, held.q, atol=1e-9)
        assert session.arm.mass == pytest.approx(held.arm.mass + held.target.mass)
        # singular where the closed chain is: the free hands' J* of both
        theirs = sa.singularity(held.configuration)
        assert session.report.kind == theirs.kind
        assert "tip=['t0', 't1']" in session.readout()["python"]
        assert session.about()["tip"] == "t0, t1"
    law, brief = sa.JointPD(held.q, kp=0.1, kd=0.1), sa.Integration(dt=0.05)
    goal = [held.target.pose * sa.pose((0.2 * far, 0, 0))]
    led = held.follow(goal, limits=False)
    for motion in (led, held.simulate(law, 0.1, integration=brief)):
        viewer = sa.view(motion, open=False)
        viewer.save(tmp_path / "held.html")
        assert (tmp_path / "held.html").stat().st_size > 1e5
    rails = dict(zip(held.arm.tips, held.configuration.tips, strict=True))
    fixed = sa.hold(held.configuration, None, rails, limits=False)
    assert shown(fixed).arm.mass == held.arm.mass


@pytest.mark.slow
def test_motions_are_played(arm):
    plan = sa.plan(arm.at(Q), sa.Joints([0.5, 1.0]))
    followed = sa.follow(arm.at(Q), [arm.at(Q).tip.translation[:2] + np.array([0.0, 0.05])])
    trajectory = sa.simulate(arm.at(Q), sa.JointPD([0.5, 1.0], kp=50.0, kd=50.0), 0.2)
    for thing in (plan, followed, trajectory, sa.Motion.of(plan)):
        viewer = sa.view(thing, open=False)
        np.testing.assert_allclose(viewer.session.cfg.q, Q, atol=1e-12)
        assert viewer.about()["motion"]["span"] == [0.0, float(thing.t[-1])]


@pytest.mark.slow
def test_a_flight_is_played_with_what_it_holds(arm):
    law = sa.JointPD([0.5, 1.0], kp=5.0, kd=5.0)
    body = sa.Grasp(mass=20.0, inertia=np.diag([2.0, 3.0, 4.0]), com=(0.3, 0.1, 0.0))
    phases = [sa.Phase(law, 0.2, body), sa.Phase(law, 0.1), sa.Phase(law, 0.1, sa.Release()),
              sa.Phase(law, 0.1)]  # fmt: skip
    flight = sa.simulate_phases(arm.at(Q), phases)
    viewer = sa.view(flight, open=False)
    motion = viewer.about()["motion"]
    assert motion["span"] == pytest.approx([0.0, 0.5])
    assert [(e["kind"], round(e["t"], 9)) for e in motion["events"]] == [
        ("grasp", 0.2), ("release", 0.4),
    ]  # fmt: skip
    for t in (0.1, 0.3, 0.45):
        viewer.handle({"do": "time", "t": t})
        viewer.draw()
        shown, known = viewer.session.cfg, flight.at(t)
        np.testing.assert_allclose(shown.com, known.com, atol=1e-12)
        assert shown.arm.mass == pytest.approx(arm.mass + (20.0 if t == 0.3 else 0.0))
        node = ("spacearm", "bodies", "held", "1", "payload")
        scene = {key: umsgpack.unpackb(data) for key, data in viewer.window._scene.items()}
        assert scene[Key(node, "visible")]["value"] is (t == 0.3)
        if t == 0.3:
            placed = np.reshape(scene[Key(node, "set_transform")]["matrix"], (4, 4)).T
            np.testing.assert_allclose(
                placed[:3, 3], shown.tip.act(np.array([0.3, 0.1, 0.0])), atol=1e-12
            )
    held = {key.path[3] for key in scene if key.path[:3] == node[:3]}
    assert held == {"1"}
    assert len(viewer.html()) > 1000
    viewer.compare(flight)
    viewer.handle({"do": "time", "t": 0.3})
    viewer.draw()
    assert list(viewer.about()["motion"]["ways"].values()) == ["given"]
    with pytest.raises(sa.UnsupportedError, match="grasps and releases bodies"):
        viewer.compare("fixed")


@pytest.mark.slow
def test_what_wheels_take_up_after_a_grasp_is_played():
    """Their arrows and curves: what they hold, and the torque that they give."""
    arm = load_text(with_wheels("planar2", np.eye(3)[2:], torque=0.5, rate=400.0), task="x y")
    law, damper = sa.JointPD(Q, kp=5.0, kd=5.0), sa.WheelHold(stiffness=0.0, damping=20.0)
    twist = (0.0, 0.0, 0.0, 0.0, 0.0, 0.3)
    body = sa.Grasp(mass=20.0, inertia=np.diag([2.0, 3.0, 4.0]), twist=twist)
    phases = [sa.Phase(law, 0.1, body), sa.Phase(law, 0.5, plant=sa.Plant(wheels=damper))]
    flight = sa.simulate_phases(arm.at(Q), phases)
    viewer = sa.view(flight, open=False)
    told = viewer.about()["motion"]
    curves = {curve["name"]: curve for curve in told["curves"]}
    for name, load in (("wheels", flight.wheels), ("wheel torques", flight.wheel_torque)):
        known = np.interp(told["t"], flight.t, load[:, 0])
        np.testing.assert_allclose(curves[name]["values"][0], known, atol=1e-3 * abs(load).max())
        assert abs(load).max() > 0.0
    scale = []
    for t in (0.3, 0.6):
        viewer.handle({"do": "time", "t": t})
        viewer.draw()
        scene = {key: umsgpack.unpackb(data) for key, data in viewer.window._scene.items()}
        node = Key(("spacearm", "wheels", "0", "arrow"), "set_transform")
        arrow = np.reshape(scene[node]["matrix"], (4, 4)).T
        held = np.interp(t, flight.t, flight.wheels[:, 0])
        scale.append(np.linalg.norm(arrow[:3, 1]) / abs(held))
    assert scale[0] == pytest.approx(scale[1], rel=1e-3)


def test_what_is_held_is_drawn_with_its_inertia():
    rng = np.random.default_rng(0)
    R, a = pin.exp3(rng.normal(size=3)), np.array([0.3, 0.5, 0.9])
    moments = 7.0 / 5.0 * ((a @ a) - a * a)
    body = Inertial(7.0, pin.SE3(pin.exp3(rng.normal(size=3)), a), R @ np.diag(moments) @ R.T)
    shape = ellipsoid(body, 0.01)
    points = shape[:3, :3] @ shape[:3, :3].T  # axes in the frame of the link
    turned = body.origin.rotation @ R
    np.testing.assert_allclose(points, turned @ np.diag(a * a) @ turned.T, atol=1e-12)
    np.testing.assert_array_equal(shape[:3, 3], a)
    point = ellipsoid(body._replace(inertia=np.zeros((3, 3))), 0.01)[:3, :3]
    np.testing.assert_allclose(point @ point.T, 1e-4 * np.eye(3), atol=1e-18)


def test_a_workspace_shows_its_shells_around_the_posture_asked_for(arm):
    viewer = sa.view(arm.at(Q), open=False)
    viewer.shells(sa.workspace(arm))
    assert viewer.session.cfg.q.tolist() == Q
    words = [key["words"] for key in viewer.readout()["legend"]]
    assert words[0].startswith("path dependent: 0.351 to 0.554, 1.436 to 2.287 m from the CM")


@pytest.mark.parametrize("name", ["planar2", "chaser7"])
def test_a_singular_set_shows_the_posture_nearest_to_home(name):
    arm = sa.load(name)
    found = sa.singular_set(arm)
    session = shown(found)
    home = np.clip(np.zeros(arm.n), arm.lower, arm.upper)
    assert session.report.kind != "regular"
    np.testing.assert_allclose(session.cfg.q, found.nearest(home).q, atol=1e-12)


def test_a_region_shows_its_first_singular_configuration(arm):
    space = sa.workspace(arm)
    (low, high) = space.pdw[0]
    region = space.regions([(low + high) / 2.0, 0.0])
    assert shown(region).cfg is region.singular[0]
    with pytest.raises(sa.ConfigurationError, match="region is unreachable and has no singular"):
        shown(space.regions([1e3, 0.0]))


@pytest.mark.parametrize("thing", ["planar2", None, 3, [1, 2], SimpleNamespace(arm=None)])
def test_what_has_no_posture_is_refused(thing):
    message = (
        f"an? {type(thing).__name__} cannot be shown; give a SpaceArm, a Configuration, a motion "
        r"\(with arm, t, q and base\), a Workspace, a singular set, feasible attitudes, "
        r"a Catch, a Held or its report, a Region, a result with a conf"
    )
    with pytest.raises(sa.ConfigurationError, match=message):
        shown(thing)


def test_a_motion_with_faults_is_refused(arm):
    base = [pin.SE3.Identity()] * 2
    with pytest.raises(sa.ConfigurationError, match="motion: q is"):
        shown(SimpleNamespace(arm=arm, t=[0, 1], q=[[0.0]], base=base))


def test_random_postures_can_be_repeated(arm):
    first, second = (Session(arm, arm.at(Q)) for _ in range(2))
    for session in (first, second):
        session.handle({"do": "random"})
    assert first.cfg.q.tolist() == second.cfg.q.tolist() != Q
    first.handle({"do": "random"})
    assert first.cfg.q.tolist() != second.cfg.q.tolist()


@pytest.mark.parametrize(
    ("visual", "message"),
    [
        ("<geometry><cone/></geometry>", "'arm' has a visual without a known geometry"),
        ('<geometry><box size="1"/></geometry>', r"has size='1'; give 3 finite .*not drawn"),
        ('<origin rpy="x"/><geometry><box size="1 1 1"/></geometry>', "has rpy='x'"),
    ],
)
def test_a_visual_with_a_fault_gives_a_warning_and_a_scene(tmp_path, visual, message):
    box = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
    parts = [link("bus", 50.0, inside=box), link("arm", inside=f"<visual>{visual}</visual>")]
    path = tmp_path / "r.urdf"
    path.write_text(robot(*parts, two_links()[2], link("end"), joint("e", "arm", "end", "fixed")))
    arm = sa.load(path)
    with pytest.warns(sa.ModelWarning, match=message) as caught:
        drawn = shapes(arm)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert {shape.link for shape in drawn} == {"bus", "arm"}


def test_meshes_lose_no_more_than_the_size_of_a_cell():
    ball = trimesh.creation.icosphere(subdivisions=5)
    coarse = coarsened(ball, 0.1)
    assert 100 <= len(coarse.faces) < 0.3 * len(ball.faces)
    radii = np.linalg.norm(coarse.vertices, axis=1)
    np.testing.assert_allclose(radii, 1.0, atol=0.1)
    assert coarse.area == pytest.approx(ball.area, rel=0.1)
    assert coarsened(ball, 10.0) is ball, "nothing would be left"
    box = trimesh.creation.box()
    assert coarsened(box, 1e-3) is box


def lab(color, eye):
    """A colour as an eye sees it, in CIELAB."""
    rgb = np.array([color >> 16, color >> 8 & 255, color & 255]) / 255.0
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(COLOUR_BLIND[eye]) @ linear, 0.0, 1.0)
    xyz = np.array(TO_XYZ) @ seen / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("eye", COLOUR_BLIND)
def test_colour_blind_people_tell_axes_directions_and_ellipsoid_apart(eye):
    colors = [lab(color, eye) for color in (*AXES, MAGENTA, PINK, AMBER, CYAN)]
    for i, one in enumerate(colors):
        for other in colors[:i]:
            assert np.linalg.norm(one - other) > 12.0, "2.3 is just noticed"


def test_rings_and_compass_have_the_colours_of_the_axes():
    for name in ("grab.js", "page.css"):
        for color in AXES[:2]:
            assert f"#{color:06x}" in (PAGE / name).read_text()


@pytest.mark.slow
def test_a_catch_plays_with_its_target_in_the_hand_from_contact_on():
    """The drawn target is where it tumbles, and then where the tip carries it."""
    catch = caught()
    viewer = sa.view(catch, open=False)
    motion, stage = viewer.session, viewer._stage
    assert "target" not in stage.hidden
    nodes = stage.poses()["nodes"]
    assert "/spacearm/target" in nodes
    assert not stage._loads._held  # its own shapes are drawn, no ellipsoid
    held = catch.chase[-1].tip.actInv(catch.target.at(catch.t).pose)
    sent = []
    stage.scene.root["target"].window.send = sent.append
    for t in (0.0, catch.t - 0.5, catch.t + 0.2):
        stage.seek(t)
        sent.clear()
        stage.draw()
        matrix = next(
            m["matrix"]
            for m in (one.lower() for one in sent)
            if m["type"] == "set_transform" and m["path"].endswith("/target")
        )
        pose = np.reshape(matrix, (4, 4)).T
        wanted = catch.target.at(t).pose if t < catch.t else motion.cfg.tip * held
        np.testing.assert_allclose(pose, wanted.homogeneous, rtol=0, atol=1e-9)
    assert motion.cfg.arm.mass == pytest.approx(catch.arm.mass + catch.target.mass)


HOSTILE = "<!--<script>&\u2028\u2029'\"</script>"


def test_no_name_ends_or_begins_a_script_of_a_page():
    """`<!--<script>` in a script makes a browser take all that follows for one."""
    assert json.loads(json_in_html({"name": HOSTILE})) == {"name": HOSTILE}
    assert not set("<>&\u2028\u2029") & set(json_in_html([HOSTILE]))


def test_a_saved_page_holds_no_name_as_it_is(tmp_path):
    text = robot(*two_links()).replace('name="r"', 'name="&lt;!--&lt;script&gt;"')
    arm = load_text(text, tip="arm", task="x y")
    with pytest.warns(sa.ModelWarning, match="no visuals"):
        viewer = sa.view(arm.at([0.3]), open=False)
    page = viewer.save(tmp_path / "page.html").read_text("utf-8")
    assert "!--" in arm.name
    assert "<!--<script>" not in page
