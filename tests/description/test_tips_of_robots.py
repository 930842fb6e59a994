"""Tips of robots that nobody here described: those of example-robot-data."""

import re
import warnings

import pytest

import spacearm as sa

ROBOTS = next(arm.path for arm in sa.arms() if arm.name == "ur5").parents[2]
SERVICER = sa.Bus(mass=200, size=(1, 1, 1))

FOUND = {
    "ur_description/urdf/ur5_robot.urdf": (6, "tool0", 0),
    "ur_description/urdf/ur3_gripper.urdf": (6, "tool0", 0),
    "panda_description/urdf/panda.urdf": (7, "panda_hand_tcp", 1),
    "kinova_description/robots/kinova.urdf": (6, "j2s6s200_end_effector", 0),
    "xarm_description/urdf/xarm7.urdf": (7, "link_eef", 0),
    "z1_description/urdf/z1.urdf": (6, "gripperStator", 1),
    "b1_description/urdf/b1-z1.urdf": (6, "gripperStator", 13),
    "so_arm_description/urdf/so100.urdf": (5, "gripper", 1),
    "so_arm_description/urdf/so101.urdf": (5, "gripper_frame_link", 1),
    "anymal_b_simple_description/robots/anymal-kinova.urdf": (6, "j2s6s200_end_effector", 12),
    "borinot_description/urdf/borinot_flying_arm_2.urdf": (2, "flying_arm_2__ee", 0),
    "asr_twodof_description/urdf/TwoDofs.urdf": (2, "Tip", 0),
    "finger_edu_description/robots/finger_edu.urdf": (3, "finger_tip_link", 0),
    "talos_data/robots/talos_left_arm.urdf": (6, "wrist_left_ft_tool_link", 1),
    "tiago_description/robots/tiago_no_hand.urdf": (8, "wrist_ft_tool_link", 4),
    "tiago_description/robots/tiago.urdf": (8, "hand_tool_link", 40),
}
"""Joints that count, tip, and joints that are held."""

ASKED = {
    "baxter_description/urdf/baxter.urdf": ("left_gripper", "right_gripper"),
    "tiago_pro_description/robots/tiago_pro.urdf": ("arm_left_tool_link", "arm_right_tool_link"),
    "alex_description/urdf/alex_sake_hands.urdf": ("LeftSakePalmLink", "RightSakePalmLink"),
    "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf": (
        "left_hand_palm_link", "right_hand_palm_link",
    ),
    "talos_data/robots/talos_full_v2.urdf": (
        "wrist_left_ft_tool_link", "wrist_right_ft_tool_link",
    ),
    "icub_description/robots/icub.urdf": ("l_hand", "r_hand"),
    "solo_description/robots/solo12.urdf": ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
    "allegro_hand_description/urdf/allegro_left_hand.urdf": (
        "link_11.0_tip", "link_15.0_tip", "link_3.0_tip", "link_7.0_tip",
    ),
}  # fmt: skip
"""Links that could be the tip."""


def load(robot: str, **options) -> sa.SpaceArm:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sa.ModelWarning)
        return sa.load(ROBOTS / robot, check="accept", **options)


@pytest.mark.slow
@pytest.mark.parametrize("robot", FOUND)
def test_the_tip_is_the_one_that_an_engineer_names(robot):
    n, tip, held = FOUND[robot]
    arm = load(robot)
    assert (arm.n, arm.tip, len(arm.held)) == (n, tip, held)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ASKED)
def test_several_limbs_are_a_question(robot):
    with pytest.raises(sa.ModelError, match="links could be the tip") as error:
        load(robot)
    listed = re.search(r"could be the tip: (.*?); choose", str(error.value)).group(1)
    assert tuple(sorted(listed.split(", "))) == ASKED[robot]
    arm = load(robot, tip=ASKED[robot])
    assert arm.tips == ASKED[robot]
    assert arm.n == len(arm.joint_names)


@pytest.mark.slow
def test_arms_of_the_catalogue_have_the_tips_that_are_found():
    for info in sa.arms():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sa.ModelWarning)
            known, found = sa.mount(info.name, SERVICER), sa.mount(info.path, SERVICER, name="arm")
        assert [note for note in found.notes if note.startswith("the tip of arm is ")] != []
        assert any(f"the tip of arm is '{info.tip}': " in note for note in found.notes), info.name
        assert (known.n, len(known.held)) == (found.n, len(found.held))
