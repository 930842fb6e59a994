"""Tips: found as an engineer would name them, whatever names, units and orders a file has."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import LIMIT, frame, joint, link, load_text, random_tree, robot, seeds, two_links
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import spacearm as sa
from spacearm.description import loops
from spacearm.description.grippers import is_finger, is_hand, tip_rank, words
from spacearm.description.tips import choose_tips
from spacearm.description.tree import Tree

NOWHERE = sa.arms()[0].path.parent  # a folder without an SRDF


def arm_of(n: int = 4, name: str = "l", bus: str = "bus", mass: float = 2.0) -> list[str]:
    """Links and joints of an arm on a bus, without the bus: names like l_1, j_l_1."""
    parts = []
    for i in range(1, n + 1):
        before = f"{name}_{i - 1}" if i > 1 else bus
        axis = [(0, 0, 1), (0, 1, 0), (1, 0, 0)][i % 3]
        parts += [
            link(f"{name}_{i}", mass, (0.1, 0, 0), 0.01 * np.eye(3)),
            joint(f"j_{name}_{i}", before, f"{name}_{i}", xyz=(0.4, 0, 0), axis=axis),
        ]
    return parts


def finger(name: str, palm: str, kind: str = "prismatic", inside: str = LIMIT, **pose) -> list[str]:
    """A light, short link with its CM beside its joint."""
    return [
        link(name, 0.05, (0.03, 0.01, 0), 1e-5 * np.eye(3)),
        joint(f"drive_{name}", palm, name, kind, inside=inside, **{"xyz": (0.05, 0, 0), **pose}),
    ]


def slide(lower: float, upper: float, more: str = "") -> str:
    return f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>{more}'


def fixed(name: str, parent: str, mass: float = 0.0, xyz=(0.1, 0, 0)) -> list[str]:
    body = link(name, mass, (0, 0, 0), 1e-3 * np.eye(3)) if mass else frame(name)
    return [body, joint(f"to_{name}", parent, name, "fixed", xyz)]


BUS = link("bus", 80.0)
ARM = (BUS, *arm_of())
MIMIC = '<mimic joint="drive_a" multiplier="-1"/>'


def found(*parts: str, **options) -> sa.SpaceArm:
    return load_text(robot(*parts), **options)


# --- frames ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "tip"),
    [
        (["flange", "tool0"], "tool0"),
        (["tool0", "flange"], "tool0"),
        (["ee_link", "camera_optical_frame"], "ee_link"),
        (["robot_hand", "robot_hand_tcp"], "robot_hand_tcp"),
        (["ee_arm_link", "bar_link", "ee_gripper_link"], "ee_gripper_link"),
        (["end_effector_link", "adapter_base"], "end_effector_link"),
        (["link_eef", "gripper_base_link", "link_tcp"], "link_tcp"),
        (["wristForceSensor", "leftPalm", "imuLink"], "leftPalm"),
        (["hand", "hand_force_torque", "HandTouchBack_frame"], "hand"),
        (["arm_tool_link", "ft_body", "probe"], "arm_tool_link"),
        (["grasp_frame", "bracket"], "grasp_frame"),
        (["mount", "plate"], "plate"),
        (["plate", "wrist_camera", "wrist_camera_optical_frame"], "l_4"),
    ],
)
def test_frames_of_the_last_body_are_told_by_their_names(names, tip):
    parts, before = [], "l_4"
    for name in names:
        parts += fixed(name, before)
        before = name
    assert found(*ARM, *parts).tip == tip


def test_frames_side_by_side():
    both = [*fixed("ee_link", "l_4"), *fixed("tool0", "l_4")]
    assert found(*ARM, *both).tip == "tool0"
    pads = [*fixed("pad_a", "l_4"), *fixed("pad_b", "l_4")]
    arm = found(*ARM, *pads)
    assert (arm.tip, arm.tip_reason) == ("l_4", "it is the last link before others branch")
    with pytest.raises(sa.ModelError, match="2 links could be the tip: tool_a, tool_b; choose"):
        found(*ARM, *fixed("tool_a", "l_4"), *fixed("tool_b", "l_4", xyz=(0.1, 0.05, 0)))


@pytest.mark.parametrize("rpy", [(0, 0, 0), (0, 1.57, 0)])
def test_twins_at_one_place_are_one_tip(rpy):
    kuka = [frame("r_ee_kuka"), joint("kuka", "l_4", "r_ee_kuka", "fixed", rpy=rpy)]
    twin = [frame("r_ee"), joint("twin", "l_4", "r_ee", "fixed")]
    arm = found(*ARM, *kuka, *twin)
    assert arm.tip == "r_ee"
    assert arm.tip_reason == "its name is one for tips, and 'r_ee_kuka' is at the same place"
    beside = [frame("r_ee"), joint("twin", "l_4", "r_ee", "fixed", xyz=(0.5, 0.001, 0))]
    with pytest.raises(sa.ModelError, match="2 links could be the tip: r_ee_kuka, r_ee; choose"):
        found(*ARM, *kuka, *beside)


def test_twins_on_two_arms_are_a_question_of_two():
    left = [frame("left_ee_b"), joint("lb", "left_3", "left_ee_b", "fixed")]
    left += [frame("left_ee"), joint("la", "left_3", "left_ee", "fixed")]
    right = [frame("right_ee"), joint("ra", "right_3", "right_ee", "fixed")]
    with pytest.raises(sa.ModelError, match="2 links could be the tip: left_ee, right_ee; choose"):
        found(BUS, *arm_of(3, "left"), *arm_of(3, "right"), *left, *right)


def test_fingers_that_are_fixed_are_no_tip():
    thumb = [*fixed("palm_thumb_1", "l_4"), *fixed("palm_thumb_2", "palm_thumb_1")]
    assert found(*ARM, *thumb, *fixed("palm_finger", "l_4")).tip == "l_4"
    base = fixed("mitt", "l_4")
    assert found(*ARM, *base, *fixed("finger_a", "mitt"), *fixed("finger_b", "mitt")).tip == "mitt"


def test_what_an_arm_carries_is_no_tip():
    satellite = [*fixed("satellite", "l_4", 500.0), *fixed("wing", "satellite", 20.0)]
    assert found(*ARM, *satellite).tip == "satellite"
    tile = [*fixed("link_ee", "l_4"), *fixed("link_ee_tile", "link_ee", 10.0)]
    assert found(*ARM, *tile).tip == "link_ee"
    tile[0] = link("link_ee", 0.0, inertia=np.zeros((3, 3)))
    assert found(*ARM, *tile).tip == "link_ee"


def test_words_of_names():
    assert words("gripperStator") == ("gripper", "stator")
    assert words("r2/left_leg/gripper/tip") == ("r", "left", "leg", "gripper", "tip")
    assert words("LeftTCP2") == ("left", "tcp")
    assert tip_rank("tool0") < tip_rank("grasp_link") < tip_rank("link_ee") < tip_rank("tip")
    for name in ("knee", "feet_link", "toolbox", "finger_tip", "ee_camera", "tree"):
        assert tip_rank(name) is None
    assert is_hand("panda_hand")
    assert not is_hand("handle")
    assert not is_hand("LeftGripperYawLink")
    assert tip_rank("left_index_tip") is None
    assert is_finger("leftfinger")
    assert not is_finger("middle_link")
    assert not is_finger("finger_base", common={"finger"})


# --- arms -----------------------------------------------------------------------------------


def test_the_arm_with_the_most_joints_is_taken_and_what_is_beside_it_held():
    wing = [link("wing", 3.0), joint("panel", "bus", "wing", inside=slide(0.2, 1.0))]
    arm = found(*ARM, *wing)
    assert (arm.n, arm.tip, dict(arm.held)) == (4, "l_4", {"panel": 0.2})


def test_an_arm_that_ends_in_a_tool_comes_before_a_longer_branch():
    mast = arm_of(5, "mast")
    arm = found(*ARM, *fixed("tool0", "l_4"), *mast)
    assert arm.tip == "tool0"
    assert arm.tip_reason == "its name is one for tips; other arms end in mast_5"
    antenna = [*arm_of(1, "antenna"), *fixed("antenna_tip", "antenna_1")]
    assert found(*ARM, *antenna).tip == "l_4"


def test_two_arms_are_a_question():
    parts = (BUS, *arm_of(3, "left"), *arm_of(3, "right"), *arm_of(2, "mast"))
    with pytest.raises(sa.ModelError) as error:
        found(*parts)
    assert re.search(
        r"2 links could be the tip: left_3, right_3; choose one with tip='left_3', "
        r"or several with tip=\('left_3', 'right_3'\); "
        "other arms end in mast_2",
        str(error.value),
    )
    both = found(*parts, tip=("left_3", "right_3"))
    assert (both.n, list(both.held)) == (6, ["j_mast_1", "j_mast_2"])


def test_wheels_are_no_arms():
    spun = [link("rw"), joint("reaction_wheel_1", "bus", "rw", "continuous")]
    with pytest.raises(sa.ModelError, match=r"nothing moves but wheels \(reaction_wheel_1\)"):
        found(BUS, *spun)
    assert found(BUS, *spun, *arm_of(1)).tip == "l_1"


def test_an_arm_without_mass_among_wheels_is_asked_for_its_density():
    wheel = [link("wheel"), joint("spin", "bus", "wheel")]
    shape = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
    arm = [f'<link name="arm">{shape}</link>', joint("elbow", "bus", "arm")]
    with (
        pytest.warns(sa.ModelWarning, match="'elbow' is held"),
        pytest.raises(sa.ModelError, match=r"without mass do not move \(arm\): density=2700"),
    ):
        found(BUS, *wheel, *arm)


def test_a_tip_among_very_many_joints_must_be_named():
    parts = [part for i in range(301) for part in arm_of(1, f"m{i}x")]
    with pytest.raises(sa.ModelError, match="301 movable joints are too many to look for a tip"):
        found(BUS, *parts)
    assert found(BUS, *parts, tip="m7x_1").n == 1


# --- grippers -------------------------------------------------------------------------------

GRIPPERS = {
    "two fingers, one mimics": [
        *finger("a", "l_4", inside=slide(0.01, 0.04), axis=(0, 1, 0)),
        *finger("b", "l_4", inside=slide(-0.04, -0.01, MIMIC), axis=(0, 1, 0)),
    ],
    "two that slide apart": [
        *finger("a", "l_4", inside=slide(0, 0.04), axis=(0, 1, 0)),
        *finger("b", "l_4", inside=slide(0, 0.04), axis=(0, -1, 0)),
    ],
    "two alike that turn": [
        *finger("a", "l_4", "revolute", axis=(0, 1, 0)),
        *finger("b", "l_4", "revolute", axis=(0, -1, 0)),
    ],
    "a linkage": [
        *finger("a", "l_4", "revolute", axis=(0, 1, 0)),
        *finger("a_2", "a", "revolute", slide(-1, 1, MIMIC), axis=(0, 1, 0)),
        *finger("b", "l_4", "revolute", slide(-1, 1, MIMIC), axis=(0, 1, 0)),
        *finger("c", "l_4", "continuous", MIMIC, axis=(0, 1, 0)),
    ],
    "three of two joints": [
        part
        for name in "abc"
        for part in (
            *finger(name, "l_4", "revolute", axis=(0, 1, 0)),
            *finger(f"{name}_2", name, "revolute", axis=(0, 1, 0)),
        )
    ],
    "a thumb by name": [
        *finger("thumb", "l_4", "revolute", axis=(0, 1, 0)),
        *finger("other", "l_4", "prismatic", slide(0, 0.05)),
    ],
    "two with limits that say nothing": [
        *finger("a", "l_4", inside=slide(-3, 3), axis=(0, 1, 0)),
        *finger("b", "l_4", inside=slide(-3, 3), axis=(0, -1, 0)),
    ],
    "one slides and one turns": [
        *finger("a", "l_4", inside=slide(0, 0.04), axis=(0, 1, 0)),
        *finger("b", "l_4", "revolute", axis=(0, -1, 0)),
    ],
    "a thumb of two joints and fingers of three": [
        part
        for name in ("p", "q", "r")
        for part in (
            *finger(name, "l_4", "revolute", xyz=(0.02, 0, 0), axis=(0, 1, 0)),
            *finger(f"{name}_2", name, "revolute", xyz=(0.02, 0, 0), axis=(0, 1, 0)),
            *(finger(f"{name}_3", f"{name}_2", xyz=(0.02, 0, 0)) if name != "p" else ()),
        )
    ],
    "a thumb of more joints than the fingers": [
        *finger("p", "l_4", "revolute", xyz=(0.02, 0, 0)),
        *finger("q", "l_4", "revolute", xyz=(0.02, 0.02, 0)),
        *finger("r", "l_4", "revolute", xyz=(0.02, -0.02, 0)),
        *finger("r_2", "r", "revolute", xyz=(0.05, 0, 0)),
    ],
    "two of two joints, as heavy as the arm": [
        part
        for name, y in (("a", 0.1), ("b", -0.1))
        for part in (
            link(name, 3.0, (0.05, 0, 0), 1e-2 * np.eye(3)),
            joint(f"drive_{name}", "l_4", name, xyz=(0.1, y, 0)),
            link(f"{name}_2", 0.5, (0.05, 0, 0), 1e-3 * np.eye(3)),
            joint(f"drive_{name}_2", name, f"{name}_2", xyz=(0.1, 0, 0)),
        )
    ],
    "fingertips that are named so": [
        part
        for name in "ab"
        for part in (
            *finger(name, "l_4", "revolute"),
            *fixed(f"{name}_tip", name, xyz=(0.02, 0, 0)),
        )
    ],
    "one jaw by its name": finger("moving_jaw", "l_4", "revolute", slide(-0.2, 2), axis=(0, 1, 0)),
    "one jaw that turns from zero to one side": finger("a", "l_4", "revolute", slide(-0.1, 1.5)),
    "one that slides across": finger("a", "l_4", inside=slide(0, 0.04), axis=(0, 1, 0)),
    "two that slide apart in a row": [
        *finger("a", "l_4", inside=slide(0, 0.04), axis=(0, 1, 0)),
        *finger(
            "b", "a", inside=slide(0, 0.1, MIMIC.replace("-1", "2")), axis=(0, -1, 0), xyz=(0, 0, 0)
        ),
    ],
    "one jaw by its joint, with limits that say nothing": [
        link("part", 0.05, (0.03, 0.01, 0), 1e-5 * np.eye(3)),
        joint("gripper", "l_4", "part", xyz=(0.05, 0, 0), axis=(0, 1, 0), inside=slide(-6.3, 6.3)),
    ],
    "one jaw by its joint": [
        link("part", 0.05, (0.03, 0.01, 0), 1e-5 * np.eye(3)),
        joint("gripper", "l_4", "part", xyz=(0.05, 0, 0), axis=(0, 1, 0), inside=slide(-0.2, 2)),
    ],
}


@pytest.mark.parametrize("gripper", GRIPPERS)
def test_fingers_are_held_and_never_the_tip(gripper):
    arm = found(*ARM, *GRIPPERS[gripper])
    assert (arm.n, arm.tip) == (4, "l_4")
    assert arm.joint_names == tuple(f"j_l_{i}" for i in range(1, 5))
    assert arm.tip_reason.startswith("it is the last link before the fingers ")
    assert list(arm.held) == [j.name for j in arm.whole.leading() if j.name.startswith(("d", "g"))]
    for name, value in arm.held.items():
        into = arm.whole.joints[name]
        assert value == np.clip(0.0, into.lower, into.upper)
    tool = found(*ARM, *GRIPPERS[gripper], *fixed("pinch_link", "l_4"))
    assert (tool.tip, tool.held) == ("pinch_link", arm.held)
    free = arm.replace(joints="all")
    assert (free.n, dict(free.held), free.tip) == (4 + len(arm.held), {}, "l_4")


@pytest.mark.parametrize("gripper", GRIPPERS)
def test_held_fingers_are_noted_and_may_be_chosen(gripper):
    arm = found(*ARM, *GRIPPERS[gripper])
    (note,) = arm.notes
    assert note.startswith("the fingers on 'l_4' are held (")
    assert all(name in note for name in arm.held)
    assert arm.replace(joints="all").notes == ()
    inside = arm.whole.joints[next(iter(arm.held))].child
    one = arm.replace(tip=inside)
    assert (one.tips, one.n) == ((inside,), 5)


MJCF_BODY = '<body name="{}" pos=".4 0 0">{}<inertial pos=".1 0 0" mass="{}" diaginertia="1 1 1"/>'
SDF_LINK = """<link name="{0}"><pose>{1} 0 0 0 0 0</pose>
<inertial><mass>{2}</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial></link>
<joint name="j_{0}" type="{3}"><parent>{4}</parent><child>{0}</child>
<axis><xyz>{5}</xyz></axis></joint>"""
CARRIED = (
    ("a", 2, "revolute", "0 1 0", "bus"),
    ("b", 2, "revolute", "1 0 0", "a"),
    ("c", 2, "revolute", "0 0 1", "b"),
    ("hand", 1, "fixed", "0 0 1", "c"),
    ("fa", 0.1, "prismatic", "0 1 0", "hand"),
    ("fb", 0.1, "prismatic", "0 -1 0", "hand"),
)
"""An arm whose palm carries two sliding fingers: name, mass, joint, axis, what carries it."""


def as_mjcf(name: str = "bus", mass: float = 80, kind: str = "free", axis: str = "0 0 1") -> str:
    """The body with what it carries, nested."""
    kinds = {"revolute": "hinge", "prismatic": "slide", "free": "free"}
    moves = f'<joint type="{kinds[kind]}" axis="{axis}"/>' if kind in kinds else ""
    inside = "".join(as_mjcf(*one) for *one, carrier in CARRIED if carrier == name)
    return f"{MJCF_BODY.format(name, moves, mass)}{inside}</body>"


def as_sdf() -> str:
    """The same, in a row."""
    ends = {"bus": 0.0}
    for name, _, _, _, carrier in CARRIED:
        ends[name] = ends[carrier] + (0.04 if name in ("fa", "fb") else 0.4)
    rows = (SDF_LINK.format(n, ends[n], m, k, c, axis) for n, m, k, axis, c in CARRIED)
    bus = SDF_LINK.partition("<joint")[0].format("bus", 0, 80)
    return f'<sdf version="1.9"><model name="m">{bus}{"".join(rows)}</model></sdf>'


@pytest.mark.parametrize("suffix", ["xml", "sdf"])
def test_fingers_are_held_in_every_format(suffix, tmp_path):
    mjcf = f"<mujoco><worldbody>{as_mjcf()}</worldbody></mujoco>"
    (tmp_path / f"arm.{suffix}").write_text(mjcf if suffix == "xml" else as_sdf())
    arm = sa.load(tmp_path / f"arm.{suffix}")
    assert (arm.n, arm.tip, len(arm.held)) == (3, "hand", 2)


def test_fingers_of_a_pinocchio_model_are_held():
    urdf = robot(*ARM, *GRIPPERS["two that slide apart"])
    arm = sa.load(pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer()))
    assert (arm.n, arm.tip, len(arm.held)) == (4, "l_4", 2)


@pytest.mark.parametrize("tag", ["visual", "collision"])
@pytest.mark.parametrize(("reach", "tip"), [(0.2, "l_5"), (0.1, "l_5"), (0.06, "x"), (0.0, "x")])
def test_a_jaw_is_told_by_the_finger_beside_it(tag, reach, tip):
    """Of a jaw of 0.1 m at the end of a palm that reaches so far along it; no name says a thing."""

    def box(length: float, y: float) -> str:
        at = f'<origin xyz="{length / 2} {y} 0"/>'
        return f'<{tag}>{at}<geometry><box size="{length} 0.01 0.01"/></geometry></{tag}>'

    jaw = [
        link("x", 0.05, (0.05, 0.02, 0), 1e-5 * np.eye(3), box(0.1, 0.01)),
        joint("y", "l_5", "x", xyz=(0.1, 0, 0), inside=slide(-0.7, 0.9)),
    ]
    palm = link("l_5", 0.4, (0.1, 0, 0), 1e-3 * np.eye(3), box(0.1 + reach, -0.02))
    arm = found(*ARM, palm, joint("j_5", "l_4", "l_5", xyz=(0.4, 0, 0)), *jaw)
    assert arm.tip == tip
    assert list(arm.held) == ["y"] * (tip == "l_5")


def test_a_jaw_beside_a_frame_for_a_tool():
    jaw = finger("part", "l_4", "revolute", slide(-0.9, 0.9), axis=(0, 1, 0))
    assert found(*ARM, *jaw).tip == "part"
    arm = found(*ARM, *jaw, *fixed("tcp", "l_4"))
    assert (arm.tip, list(arm.held)) == ("tcp", ["drive_part"])


WRISTS = {
    "a roll joint named after the gripper that it turns": (
        link("hand", 0.3, (0.05, 0, 0), 1e-3 * np.eye(3)),
        joint("gripper_joint", "l_4", "hand", xyz=(0.1, 0, 0), axis=(1, 0, 0)),
    ),
    "a roll joint of a word": (
        link("hand", 0.3, (0.05, 0.02, 0), 1e-3 * np.eye(3)),
        joint("gripper_roll", "l_4", "hand", xyz=(0.1, 0, 0), axis=(1, 0, 0), inside=slide(-1, 1)),
    ),
    "a short last joint": (
        link("last", 0.1, (0.02, 0.01, 0), 1e-4 * np.eye(3)),
        joint("j_5", "l_4", "last", xyz=(0.05, 0, 0), axis=(0, 1, 0)),
    ),
    "a last joint that mimics another": (
        link("last", 0.1, (0.02, 0.01, 0), 1e-4 * np.eye(3)),
        joint("j_5", "l_4", "last", inside=slide(-1, 1, '<mimic joint="j_l_3"/>')),
    ),
    "a short last joint that turns to both sides": finger("last", "l_4", inside=slide(-0.9, 0.9)),
    "a finger that curls": (
        *finger("a", "l_4", "revolute", slide(0, 1.5), axis=(0, 1, 0)),
        *finger("last", "a", "revolute", slide(0, 1.5), axis=(0, 1, 0)),
    ),
    "a plunger along the last link": (
        link("last", 0.05, (0.03, 0, 0), 1e-5 * np.eye(3)),
        joint(
            "j_5", "l_4", "last", "prismatic", (0.4, 0, 0), axis=(1, 0, 0), inside=slide(0, 0.05)
        ),
    ),
    "a stage that slides far across": finger("last", "l_4", inside=slide(0, 0.4), axis=(0, 1, 0)),
    "two stages that slide out together": [
        *finger("a", "l_4", inside=slide(0, 0.1), axis=(0, 1, 0)),
        *finger("last", "a", inside=slide(0, 0.1, MIMIC.replace("-1", "1")), axis=(0, 1, 0)),
    ],
    "a heavy bucket": (
        link("last", 3.0, (0.1, 0.1, 0), 0.01 * np.eye(3)),
        joint("j_5", "l_4", "last", xyz=(0.4, 0, 0), inside=slide(0, 2)),
    ),
    "a boom that slides out beside a frame": (
        *fixed("tool0", "l_4"),
        link("last", 0.1, (0.02, 0.01, 0), 1e-4 * np.eye(3)),
        joint("j_5", "l_4", "last", "prismatic", (0.05, 0, 0), inside=slide(0, 2)),
    ),
    "a wrist of two joints beside a camera": (
        *finger("camera", "l_4", "revolute"),
        *finger("pitch", "l_4", "revolute"),
        *finger("last", "pitch", "revolute", xyz=(0.1, 0, 0), axis=(1, 0, 0)),
    ),
    "a wrist beside a small antenna": (
        *finger("antenna", "l_4", "revolute"),
        *finger("last", "l_4", "revolute"),
        *fixed("tool0", "last"),
    ),
}


@pytest.mark.parametrize("wrist", WRISTS)
def test_a_wrist_is_no_jaw(wrist):
    arm = found(*ARM, *WRISTS[wrist])
    assert arm.tip in ("hand", "last", "tool0")


def test_a_wrist_that_turns_the_fixed_jaw_counts():
    fixed_jaw = [
        link("fixed_jaw", 0.1, (0.03, 0, 0), 1e-4 * np.eye(3)),
        joint("turn", "l_4", "fixed_jaw", xyz=(0.1, 0, 0), axis=(1, 0, 0)),
    ]
    moving = finger("moving_jaw", "fixed_jaw", "revolute", slide(-0.2, 2), axis=(0, 1, 0))
    arm = found(*ARM, *fixed_jaw, *moving)
    assert (arm.n, arm.tip, list(arm.held)) == (5, "fixed_jaw", ["drive_moving_jaw"])


BOOM = [link("boom", 300.0, (8, 0, 0)), joint("root", "bus", "boom")]


@pytest.mark.parametrize("n", [2, 3, 4, 7])
def test_two_small_arms_on_a_boom_are_no_fingers(n):
    arms = [*arm_of(n, "left", "boom"), *arm_of(n, "right", "boom")]
    with pytest.raises(sa.ModelError, match=f"2 links could be the tip: left_{n}, right_{n}"):
        found(BUS, *BOOM, *arms)


@pytest.mark.parametrize("n", [2, 3, 4])
@pytest.mark.parametrize("gripper", ["two that slide apart", "three of two joints"])
def test_two_arms_with_hands_on_a_long_torso_are_no_fingers(n, gripper):
    """Whatever they are called, and as light as they may be."""
    torso = [*BOOM, link("x"), joint("y", "boom", "x", axis=(0, 1, 0)), *arm_of(3, "t", "x")]
    arms = [*arm_of(n, "p", "t_3", 0.1), *arm_of(n, "q", "t_3", 0.1)]
    palms = (f"p_{n}", f"q_{n}")
    for palm in palms:
        for part in GRIPPERS[gripper]:
            own = re.sub(r'"(drive_)?([a-c](_2)?)"', rf'"\1\2_of_{palm}"', part)
            arms.append(own.replace('"l_4"', f'"{palm}"'))
    with pytest.raises(sa.ModelError, match=f"2 links could be the tip: {', '.join(palms)};"):
        found(BUS, *torso, *arms)
    both = found(BUS, *torso, *arms, tip=palms)
    assert (both.n, len(both.held)) == (5 + 2 * n, len(GRIPPERS[gripper]))


def test_a_hand_alone_is_a_question():
    with pytest.raises(sa.ModelError, match="2 links could be the tip: a, b"):
        found(BUS, *finger("a", "bus"), *finger("b", "bus", inside=slide(-1, 1, MIMIC)))


def test_an_arm_whose_every_joint_is_named_finger_is_an_arm():
    parts = [BUS]
    for i, before in ((1, "bus"), (2, "finger_1"), (3, "finger_2")):
        parts += [link(f"finger_{i}"), joint(f"finger_joint_{i}", before, f"finger_{i}")]
    assert found(*parts).n == 3


# --- invariance -----------------------------------------------------------------------------


def choice(tree: Tree) -> object:
    """The tip that is chosen, or the candidates."""
    try:
        return choose_tips(tree, NOWHERE, None).links
    except sa.ModelError as error:
        listed = re.search(r"could be the tip: (.*?); choose", str(error))
        return frozenset(listed.group(1).split(", ")) if listed else str(error)


def renamed(tree: Tree, rng: np.random.Generator) -> tuple[Tree, dict[str, str]]:
    """The tree with other names, in another order."""

    def mixed(names, letter):
        numbers = rng.permutation(len(names))
        return {name: f"{letter}{i}" for name, i in zip(names, numbers, strict=True)}

    links, joints = mixed(tree.links, "x"), mixed(tree.joints, "y")
    moved = [
        replace(
            j,
            name=joints[j.name],
            parent=links[j.parent],
            child=links[j.child],
            mimic=j.mimic and j.mimic._replace(leader=joints[j.mimic.leader]),
        )
        for j in tree.joints.values()
    ]
    order = rng.permutation(len(moved))
    names = rng.permutation(list(tree.links))
    return Tree(
        tree.name,
        links[tree.root],
        {links[name]: tree.links[name] for name in names},
        {moved[i].name: moved[i] for i in order},
    ), links


def scaled(tree: Tree, length: float, mass: float) -> Tree:
    """The tree in other units."""

    def shifted(pose: pin.SE3) -> pin.SE3:
        return pin.SE3(pose.rotation, length * pose.translation)

    def slid(j):
        factor = length if j.kind == "prismatic" else 1.0
        return replace(j, origin=shifted(j.origin), lower=factor * j.lower, upper=factor * j.upper)

    parts = {
        name: part and part._replace(mass=mass * part.mass, origin=shifted(part.origin))
        for name, part in tree.links.items()
    }
    return replace(tree, links=parts, joints={n: slid(j) for n, j in tree.joints.items()})


@st.composite
def trees(draw) -> Tree:
    """A random tree, now and then with a gripper of random size behind one of its links."""
    seed, n = draw(seeds), draw(st.integers(1, 7))
    rng = np.random.default_rng(seed)
    text = random_tree(seed, n)
    if draw(st.booleans()):
        palm, size = f"link_{rng.integers(1, n + 1)}", 10 ** rng.uniform(-3, 0)
        parts = []
        for side in ("p", "q"):
            mimic = '<mimic joint="k_p"/>' if side == "q" else ""
            I = 1e-3 * size * np.eye(3)
            com, limit = (0.3 * size, 0.1 * size, 0), slide(0, 0.2 * size)
            parts += [
                link(side, size, com, I),
                joint(f"k_{side}", palm, side, "prismatic", (size, 0, 0), inside=limit + mimic),
            ]
        text = text.replace("</robot>", "\n".join(parts) + "</robot>")
    return load_text(text, tip=f"link_{n}", task="x").whole


@given(trees(), seeds, st.floats(0.01, 100), st.floats(0.01, 100))
@settings(max_examples=40)
def test_names_order_and_units_do_not_matter(tree, seed, length, mass):
    chosen = choice(tree)
    other, names = renamed(tree, np.random.default_rng(seed))
    for same, back in ((other, names), (scaled(tree, length, mass), {n: n for n in tree.links})):
        again = choice(same)
        assert type(again) is type(chosen)
        assert {back[link] for link in chosen} == set(again)


def anything(rng: np.random.Generator, names) -> dict[str, str]:
    """Names without meaning in place of some, each of a few letters and a number."""
    made = ("".join(rng.choice(list("qwxzvk"), 4)) + str(i) for i in rng.permutation(len(names)))
    return dict(zip(names, made, strict=True))


@given(seeds, st.integers(2, 7), st.sampled_from(sorted(GRIPPERS)))
def test_random_arms_with_grippers_end_in_their_palms(seed, n, gripper):
    """Any chain of at least 2 joints with long links, any gripper behind it, whatever the names.

    Names that tell of a gripper by themselves are kept. A second, shorter arm and a panel are
    beside it.
    """
    assume(n > 2 or "as heavy as the arm" not in gripper)  # either could be the arm
    rng = np.random.default_rng(seed)
    parts = [BUS, *arm_of(4)[:2]]
    for i in range(2, n + 1):
        name = "l_4" if i == n else f"m_{i}"
        before = "l_1" if i == 2 else f"m_{i - 1}"
        axis = rng.normal(size=3)
        xyz = rng.uniform(0.45, 0.7) * np.eye(3)[rng.integers(3)]
        parts += [
            link(name, rng.uniform(1, 9), rng.uniform(-0.2, 0.2, 3)),
            joint(f"j_{i}", before, name, xyz=xyz, rpy=rng.uniform(-3, 3, 3), axis=axis),
        ]
    turned = f'rpy="{" ".join(map(str, rng.uniform(-3, 3, 3)))}"'
    hand = [frame("turned"), joint("to_turned", "l_4", "turned", "fixed", xyz=(0, 0, 0))]
    hand[1] = hand[1].replace('rpy="0.0 0.0 0.0"', turned)
    hand += [part.replace('"l_4"', '"turned"') for part in GRIPPERS[gripper]]
    text = robot(*parts, *hand, *arm_of(max(1, n // 2), "other"), *fixed("panel", "bus", 2.0))
    kept = re.findall(r'"([a-z_0-9]*(?:thumb|jaw|gripper)[a-z_0-9]*)"', text)
    names = sorted(set(re.findall(r'name="(\w+)"|(?:link|joint)="(\w+)"', text)))
    names = sorted({one or two for one, two in names} - {*kept, "r"})
    new = anything(rng, names)
    arm = load_text(re.sub(r'"(\w+)"', lambda m: f'"{new.get(m[1], m[1])}"', text))
    assert arm.n == n
    assert arm.whole.body_of[arm.tip] == new["l_4"]
    assert not {j.name for j in arm.whole.movable(arm.tip)} & arm.held.keys()


def test_the_way_to_a_link_is_summed_from_the_first_movable_joint_on():
    parts = (
        link("bus", 50.0), *(link(name) for name in "abcd"),
        joint("j0", "bus", "a", "fixed", xyz=(7, 0, 0)), joint("j1", "a", "b", xyz=(5, 0, 0)),
        joint("j2", "b", "c", "fixed", xyz=(0, 2, 0)), joint("j3", "c", "d", xyz=(0, 0, 1)),
    )  # fmt: skip
    tree = load_text(robot(*parts), tip="d").tree
    assert [tree.way_to(name) for name in "bcd"] == [0.0, 2.0, 3.0]


def test_without_loops_no_gripper_is_looked_for_to_find_a_closed_chain(monkeypatch):
    tree = load_text(robot(*two_links()), tip="arm").tree
    monkeypatch.setattr(loops, "fingers", None)
    assert loops.closed_chain(tree) is None
