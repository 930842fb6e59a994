"""Descriptions of closed chains: MJCF equalities, SDF joints that close a loop, links named."""

import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import chosen, planar_pair, random_base
from helpers.closed import debris, rough, several
from helpers.formats import about_cm, as_mjcf, as_sdf, numbers

import spacearm as sa

POSE = sa.Task("pose", length=1.0)
BOX = 30.0
"""Mass of what is held [kg]."""


def at(pose):
    x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
    return f'pos="{numbers(pose.translation)}" quat="{numbers([w, x, y, z])}"'


def loaded(text, folder, suffix, **options):
    path = folder / f"closed.{suffix}"
    path.write_text(text, encoding="utf-8")
    with pytest.warns(sa.ModelWarning, match="a chain is closed by .*: sa.hold"):
        return sa.load(path, task=POSE, **options)


#: Three slides and three hinges, by which a base floats as well.
SLIDES = "".join(
    f'<joint name="base_{kind}_{i}" type="{kind}" axis="{axis}"/>'
    for kind in ("slide", "hinge") for i, axis in enumerate(("1 0 0", "0 1 0", "0 0 1"))
)  # fmt: skip


def mjcf(arm, rng, grasps, equalities, freely="<freejoint/>", base="<freejoint/>"):
    """The arm, a box with a site for each grasp, and equalities."""
    sites = "".join(f'<site name="{tip}_at" {at(pose)}/>' for tip, pose in grasps.items())
    com, I = about_cm(debris(chosen(2), BOX).inertial)
    six = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
    box = (
        f'<body name="box">{freely}<inertial pos="{numbers(com)}" mass="{BOX}" '
        f'fullinertia="{numbers(six)}"/>{sites}</body>'
    )
    text = as_mjcf(arm.tree, rng, base).replace("</worldbody>", f"{box}</worldbody>")
    return text.replace("</equality>", f"{equalities}</equality>")


def welds(arm, points=""):
    pairs = ((f"{tip}_frame", f"{tip}_at") for tip in arm.tips)
    kinds = (("connect" if tip == points else "weld") for tip in arm.tips)
    return "".join(
        f'<{kind} site1="{a}" site2="{b}"/>' for kind, (a, b) in zip(kinds, pairs, strict=True)
    )


def in_mujoco(path, held):
    """The same file in MuJoCo, everything where it is held."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, q in zip(held.arm.joint_names, held.q, strict=True):
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if joint >= 0:
            data.qpos[model.jnt_qposadr[joint]] = q
    poses = {held.arm.tree.root: held.configuration.base}
    if "box" in [model.body(i).name for i in range(model.nbody)] and held.target:
        poses["box"] = held.target.pose
    for name, pose in poses.items():
        first = model.jnt_qposadr[model.body(name).jntadr[0]]
        xyzquat = pin.SE3ToXYZQUAT(pose)
        data.qpos[first : first + 7] = xyzquat[[0, 1, 2, 6, 3, 4, 5]]
    return model, data


def violation(path, held):
    """How far MuJoCo's own equalities are open."""
    model, data = in_mujoco(path, held)
    mujoco.mj_forward(model, data)
    return np.abs(data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]).max()


def same_as_by_grasps(arm, held, target):
    """Against the open arm, its hands where they are, and grasps given; returns the report."""
    joints = dict(zip(held.arm.joint_names, held.q, strict=True))
    cfg = arm.at([joints[name] for name in arm.joint_names], base=held.configuration.base)
    grasps = {t: target.pose.actInv(tip) for t, tip in zip(arm.tips, cfg.tips, strict=True)}
    other = sa.hold(cfg, target, grasps, limits=False).report()
    report = held.report()
    np.testing.assert_allclose(report.sigma, other.sigma, rtol=1e-6, atol=1e-8 * other.sigma[0])
    assert report.kind == other.kind
    return report


def test_a_free_body_welded_to_two_hands_is_their_target(tmp_path):
    rng = chosen(31)
    arm = several(rng, (6, 6)).replace(task=POSE)
    start, _, grasps = rough(arm, rng, off=0.1)
    closed = loaded(mjcf(arm, rng, grasps, welds(arm)), tmp_path, "xml")
    assert set(closed.joint_names) == set(arm.joint_names)
    order = [arm.joint_names.index(name) for name in closed.joint_names]
    held = sa.hold(closed.at(start.q[order], base=start.base), limits=False)
    assert held.closed
    assert held.target.mass == pytest.approx(BOX)
    assert violation(tmp_path / "closed.xml", held) < 1e-8
    same_as_by_grasps(arm, held, debris(chosen(2), BOX, held.target.pose))


def flown_in_mujoco(path, held, law, duration, step):
    """Joints and pose of the box in the end, forces at the welds and the gap, by steps of RK4.

    Its welds are springs with dampers, as stiff as the steps and the largest impedance allow.
    """
    model, data = in_mujoco(path, held)
    model.opt.gravity[:], model.opt.timestep = 0.0, step
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.eq_solref[:], model.eq_solimp[:] = (2.5 * step, 1.0), (0.9999, 0.9999, 1e-3, 0.5, 2.0)
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, n) for n in held.arm.joint_names]
    q, v = model.jnt_qposadr[ids], model.jnt_dofadr[ids]

    def push(_, data):
        data.qfrc_applied[v] = law(data.time, None, data.qvel[v])

    mujoco.set_mjcb_control(push)
    try:
        for _ in range(round(duration / step)):
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
    finally:
        mujoco.set_mjcb_control(None)
    force = np.linalg.norm(data.efc_force.reshape(-1, 6)[:, :3], axis=1)
    box = data.body("box")
    there = pin.SE3(box.xmat.reshape(3, 3), box.xpos)
    return data.qpos[q].copy(), there, force, np.abs(data.efc_pos).max()


def test_a_file_that_is_written_says_which_loops_it_lacks(tmp_path):
    rng = chosen(31)
    arm = several(rng, (6, 6)).replace(task=POSE)
    _, _, grasps = rough(arm, rng, off=0.1)
    closed = loaded(mjcf(arm, rng, grasps, welds(arm)), tmp_path, "xml")
    writers = {"urdf": closed.to_urdf}
    writers |= {"sdf": lambda path: sa.to_sdf(closed, path)}
    writers |= {"mjcf": lambda path: sa.to_mjcf(closed, path)}
    for suffix, write in writers.items():
        with pytest.warns(sa.ModelWarning, match="loops are not written: .*sa.hold"):
            write(tmp_path / f"open.{suffix}")


@pytest.mark.slow
def test_mujoco_moves_the_chain_of_its_own_file_alike(tmp_path):
    """The difference is that of MuJoCo's welds, which give way, and falls with its steps."""
    rng = chosen(36)
    arm = several(rng, (6, 6)).replace(task=POSE)
    start, _, grasps = rough(arm, rng, off=0.1)
    closed = loaded(mjcf(arm, rng, grasps, welds(arm)), tmp_path, "xml")
    order = [arm.joint_names.index(name) for name in closed.joint_names]
    held = sa.hold(closed.at(start.q[order], base=start.base), limits=False)
    j, scale = np.arange(arm.n), sa.generalized_inertia(held.configuration).diagonal()

    def law(t, _, dq):
        return scale * (0.2 * np.sin((1.0 + 0.2 * j) * t + j) - 0.1 * dq)

    run = held.simulate(law, 1.0, integration=sa.Integration(dt=0.25, rtol=1e-10))
    moved = np.abs(run.q[-1] - held.q).max()
    assert moved > 0.05
    ends = [flown_in_mujoco(tmp_path / "closed.xml", held, law, 1.0, h) for h in (2e-3, 5e-4)]
    off = [np.abs(q - run.q[-1]).max() / moved for q, *_ in ends]
    for difference, (*_, gap) in zip(off, ends, strict=True):
        assert difference < 1e4 * gap / moved
    assert off[1] < max(0.2 * off[0], 1e-8)
    assert run.gap.max() < 1e-3 * ends[1][-1]
    _, there, force, _ = ends[1]
    box = there.actInv(held.after(run).target.pose)
    np.testing.assert_allclose(box.homogeneous, np.eye(4), atol=1e-5 * moved)
    ours = [np.linalg.norm(run.grasps[tip][-1, :3]) for tip in held.arm.tips]
    np.testing.assert_allclose(force, ours, atol=0.01 * max(ours))


def test_hands_that_hold_each_other_move_as_with_any_target_between(tmp_path):
    rng = chosen(32)
    arm = several(rng, (6, 6)).replace(task=POSE)
    start, _, grasps = rough(arm, rng, off=0.1)
    step = grasps["t0"].inverse() * grasps["t1"]
    text = as_mjcf(arm.tree, chosen(1))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)

    def site(link):
        mine, body = data.site(f"{link}_frame"), data.body(link)
        there = pin.SE3(body.xmat.reshape(3, 3), body.xpos)
        return there.actInv(pin.SE3(mine.xmat.reshape(3, 3), mine.xpos))

    x, y, z, w = pin.Quaternion(
        (step := site("t0") * step * site("t1").inverse()).rotation
    ).coeffs()
    weld = (
        f'<weld name="grip" body1="t0" body2="t1" '
        f'relpose="{numbers([*step.translation, w, x, y, z])}"/>'
    )
    closed = loaded(text.replace("</equality>", f"{weld}</equality>"), tmp_path, "xml")
    order = [arm.joint_names.index(name) for name in closed.joint_names]
    held = sa.hold(closed.at(start.q[order], base=start.base), limits=False)
    assert violation(tmp_path / "closed.xml", held) < 1e-8
    report = same_as_by_grasps(arm, held, held.target)
    assert report.mobility == 6


def test_a_point_that_is_connected_is_a_ball_joint(tmp_path):
    rng = chosen(33)
    arm = several(rng, (6, 6)).replace(task=POSE)
    start, _, grasps = rough(arm, rng, off=0.1)
    closed = loaded(mjcf(arm, rng, grasps, welds(arm, points="t1")), tmp_path, "xml")
    assert closed.n == 15
    where = {**dict(zip(arm.joint_names, start.q, strict=True))}
    q = [where.get(name, 0.0) for name in closed.joint_names]
    held = sa.hold(closed.at(q, base=start.base), limits=False)
    assert violation(tmp_path / "closed.xml", held) < 1e-8
    report = held.report()
    assert report.mobility == 6
    assert report.internal.shape == (15, 3)


def test_hinges_that_lock_are_told_from_what_their_ball_joint_does(tmp_path):
    """An arm of three joints and a ball joint has none to spare where its hinges lock."""
    rng = chosen(37)
    arm = several(rng, (6, 3)).replace(task=POSE)
    start, _, grasps = rough(arm, rng, off=0.1)
    closed = loaded(mjcf(arm, rng, grasps, welds(arm, points="t1")), tmp_path, "xml")
    middle = [name for name in closed.joint_names if name.endswith("box_y")]
    where = {**dict(zip(arm.joint_names, start.q, strict=True)), middle[0]: np.pi / 2 - 1e-4}
    cfg = closed.at([where.get(name, 0.2) for name in closed.joint_names], base=start.base)
    box = sa.hold(closed.at(closed.home), limits=False).target.replace(pose=cfg.tips[0])
    hands = {tip: box.pose.actInv(pose) for tip, pose in zip(cfg.arm.tips, cfg.tips, strict=True)}
    report = sa.hold(cfg, box, hands, limits=False).report()
    assert report.distance < 0.01
    assert "stand for a ball joint and lock 0.00573° away" in report.verdict
    assert middle[0] in report.verdict
    # what is singular nearer, or much farther, is something else
    for other in (0.5e-4, 0.1):
        assert "ball joint" not in replace(report, distance=other, tolerance=1e-6).verdict


@pytest.mark.filterwarnings("ignore:.*joints .* are left out")
def test_a_hand_welded_to_the_world_holds_it(tmp_path):
    """With a free joint, and with slides and hinges that stand for it."""
    rng = chosen(34)
    arm = several(rng, (6, 6)).replace(task=POSE)
    start, _, grasps = rough(arm, rng, off=0.1)
    found = []
    for base in (SLIDES, "<freejoint/>"):
        text = mjcf(arm, chosen(35), grasps, welds(arm), freely="", base=base)
        closed = loaded(text, tmp_path, "xml")
        order = [arm.joint_names.index(name) for name in closed.joint_names]
        found.append(sa.hold(closed.at(start.q[order]), limits=False))
        assert found[-1].target is None
        assert found[-1].report().mode == "fixed"
    sliding, held = found
    assert violation(tmp_path / "closed.xml", held) < 1e-8
    np.testing.assert_allclose(sliding.q, held.q, atol=1e-8)
    off = sliding.configuration.base.actInv(held.configuration.base)
    np.testing.assert_allclose(off.homogeneous, np.eye(4), atol=1e-8)


@pytest.mark.parametrize(
    ("kind", "ends"),
    [("fixed", "<parent>{}</parent><child>{}</child>"),
     ("revolute", "<parent>{}</parent><child>{}</child>"),
     ("fixed", "<child>{}</child><parent>{}</parent>")],
)  # fmt: skip
def test_an_sdf_joint_that_closes_a_loop(kind, ends, tmp_path):
    """Frames of an SDF agree at zero: there the chain is closed."""
    rng = chosen(35)
    arm = several(rng, (6, 6)).replace(task=POSE)
    zero = arm.at(np.zeros(12))
    box = zero.base.inverse() * zero.tips[0] * random_base(rng)
    rpy = pin.rpy.matrixToRpy(box.rotation)
    text = as_sdf(arm.tree, rng)
    link = (
        f"<link name='box'><pose>{numbers([*box.translation, *rpy])}</pose><inertial>"
        f"<mass>{BOX}</mass></inertial></link>"
        f"<joint name='one' type='fixed'>{ends.format('t0', 'box')}</joint>"
        f"<joint name='two' type='{kind}'>{ends.format('t1', 'box')}"
        "<axis><xyz>0 0 1</xyz></axis></joint>"
    )
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*has no <inertia>.*")
        closed = loaded(text.replace("</model>", f"{link}</model>"), tmp_path, "sdf")
    assert closed.n == 12 + (kind == "revolute")
    floats = ends.startswith("<child>")
    assert closed.mass == pytest.approx(arm.mass + BOX * (not floats))
    q = rng.uniform(-0.1, 0.1, closed.n)
    held = sa.hold(closed.at(q), limits=False)
    assert held.closed
    assert held.report().mobility == 6
    assert held.target.mass == pytest.approx(BOX * floats)
    exact = sa.hold(closed.at(np.zeros(closed.n)), limits=False)
    np.testing.assert_array_equal(exact.q, 0.0)


def test_links_of_a_urdf_that_hold_each_other(tmp_path):
    path = planar_pair().to_urdf(tmp_path / "pair.urdf")
    with pytest.warns(sa.ModelWarning, match="a chain is closed by left = right"):
        closed = sa.load(path, tip={"left": "right"})
    assert closed.tips == ("left", "right")
    held = sa.hold(closed.at([2.0, -1.2, 1.1, 1.2]), limits=False)
    one, two = held.configuration.tips
    np.testing.assert_allclose(one.homogeneous, two.homogeneous, atol=1e-9)


LINK = '<inertial pos="{x} 0 0" mass="2" diaginertia=".1 .1 .1"/>'
FOUR_BAR = """
<mujoco><worldbody><body name="bus"><freejoint/><inertial pos="0 0 0" mass="90"
 diaginertia="9 9 9"/><body name="crank"><joint name="a" axis="0 0 1"/>{link}
 <body name="coupler" pos="1 0 0"><joint name="b" axis="0 0 1"/>{link}</body></body>
 <body name="rocker" pos="2 0 0"><joint name="c" axis="0 0 1"/>{link}</body></body></worldbody>
 <equality><{tie}/></equality></mujoco>
"""


@pytest.mark.parametrize(
    ("tie", "fault"),
    [
        ('connect name="pin" body1="coupler" body2="rocker" anchor="1 0 0"', "pin: a loop inside"),
        ('weld body1="coupler" body2="bus"', "coupler to bus: a loop through the spacecraft"),
    ],
)
def test_a_linkage_is_refused_unless_its_tip_is_named(tie, fault, tmp_path):
    path = tmp_path / "linkage.xml"
    path.write_text(FOUR_BAR.format(link=LINK.format(x=0.5), tie=tie), encoding="utf-8")
    with pytest.raises(sa.ModelError, match=f"{fault}.*tip=LINK.*loop open"):
        sa.load(path)
    with pytest.warns(sa.ModelWarning, match="the loop open"):
        arm = sa.load(path, tip="coupler")
    assert arm.n == 2
    with pytest.raises(sa.ConfigurationError, match="describes no closed chain"):
        sa.hold(planar_pair().at([0, 1, 0, 1]))


def test_fingers_that_a_loop_couples_are_held(tmp_path):
    """A gripper of four bars at the end of an arm: the loops of its fingers count for no tip."""
    finger = (
        '<body name="{0}_outer" pos="0 {1} 0.1"><joint name="{0}_outer" axis="1 0 0"/>{2}'
        '<body name="{0}_pad" pos="0 0 .03"><joint name="{0}_pad" axis="1 0 0"/>{2}</body></body>'
        '<body name="{0}_inner" pos="0 {3} 0.1"><joint name="{0}_inner" axis="1 0 0"/>{2}</body>'
    )
    light = '<inertial pos="0 0 .01" mass=".05" diaginertia="1e-5 1e-5 1e-5"/>'
    fingers = "".join(finger.format(f"{s}_finger", y, light, 0.5 * y) for s, y in
                      (("left", 0.04), ("right", -0.04)))  # fmt: skip
    inside = (
        f'<body name="hand" pos="0 0 .3"><joint name="wrist" axis="0 0 1"/>{{0}}{fingers}</body>'
    )
    for i in reversed(range(5)):
        axis = "1 0 0" if i % 2 else "0 1 0"
        inside = (
            f'<body name="l{i}" pos="0 0 .5"><joint name="j{i}" axis="{axis}"/>{{0}}{inside}</body>'
        )
    inertial = '<inertial pos="0 0 .2" mass="3" diaginertia=".1 .1 .1"/>'
    ties = "".join(
        f'<connect name="{s}_pin" body1="{s}_finger_pad" body2="{s}_finger_inner" anchor="0 0 0"/>'
        for s in ("left", "right")
    )
    text = (
        '<mujoco><worldbody><body name="bus"><freejoint/><inertial pos="0 0 0" mass="90" '
        f'diaginertia="9 9 9"/>{inside.replace("{0}", inertial)}</body></worldbody>'
        f"<equality>{ties}</equality></mujoco>"
    )
    (tmp_path / "gripper.xml").write_text(text, encoding="utf-8")
    with pytest.warns(sa.ModelWarning, match="the loop open: left_pin, right_pin"):
        arm = sa.load(tmp_path / "gripper.xml")
    assert arm.tip == "hand"
    assert arm.n == 6
