"""SRDF: what a semantic description beside a robot file says about its tip."""

import pytest
from helpers.arms import frame, joint, link, robot

import spacearm as sa

LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
ROBOT = robot(
    link("bus", 80.0),
    link("arm"), joint("shoulder", "bus", "arm"),
    link("wrist"), joint("elbow", "arm", "wrist"),
    link("hand", 0.5), joint("roll", "wrist", "hand", axis=(1, 0, 0)),
    frame("tool0"), joint("bolt", "hand", "tool0", "fixed"),
    link("jaw", 0.05, (0.03, 0.02, 0)),
    joint("gripper", "hand", "jaw", xyz=(0.1, 0, 0), inside=LIMIT),
    link("mast"), joint("mast_1", "bus", "mast"),
    link("head"), joint("mast_2", "mast", "head"),
    link("eye"), joint("mast_3", "head", "eye"),
)  # fmt: skip


def chain(tip: str) -> str:
    return f'<group name="arm"><chain base_link="bus" tip_link="{tip}"/></group>'


def effector(link: str) -> str:
    return f'<end_effector name="ee" parent_link="{link}" group="hand"/>'


def srdf(*elements: str, name: str = "r") -> str:
    return f'<?xml version="1.0"?><robot name="{name}">{"".join(elements)}</robot>'


def tip(tmp_path, text: str, where: str = "robot/srdf/r.srdf") -> tuple[str, str]:
    """The tip of the robot with an SRDF, and why it is the tip."""
    for name, content in (("robot/urdf/r.urdf", ROBOT), (where, text)):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content)
    arm = sa.load(tmp_path / "robot/urdf/r.urdf")
    return arm.tip, arm.tip_reason


@pytest.mark.parametrize(
    "where",
    [
        "robot/urdf/r.srdf",
        "robot/urdf/other_name.srdf",
        "robot/srdf/r.srdf",
        "robot/config/r.srdf",
        "robot_moveit_config/config/r.srdf",
        "robot_moveit_config/srdf/r.srdf",
        "robot/robot_moveit_config/config/r.srdf",
    ],
)
def test_it_is_found_where_packages_have_it(tmp_path, where):
    found = tip(tmp_path, srdf(chain("wrist")), where)
    assert found == ("wrist", f"{where.split('/')[-1]} names it; other arms end in eye")


@pytest.mark.parametrize(
    ("elements", "expected"),
    [
        ((chain("hand"),), "hand"),
        ((effector("hand"),), "hand"),
        ((effector("hand"), chain("tool0")), "tool0"),
        ((chain("tool0"), chain("head")), "tool0"),
        ((chain("wrist"), chain("head")), "wrist"),
        ((chain("arm"), chain("eye")), "eye"),
        ((chain("bus"), chain("hand")), "hand"),
    ],
)
def test_chains_and_end_effectors_name_tips(tmp_path, elements, expected):
    if expected == "wrist":  # two joints each
        with pytest.raises(sa.ModelError, match="2 links could be the tip: wrist, head"):
            tip(tmp_path, srdf(*elements))
    else:
        assert tip(tmp_path, srdf(*elements))[0] == expected


def test_a_jaw_stands_for_its_palm(tmp_path):
    found = tip(tmp_path, srdf(chain("jaw")))
    assert found[0] == "tool0"
    assert found[1].startswith("r.srdf names 'jaw', a part that moves in its gripper; other")


@pytest.mark.parametrize(
    "text",
    [
        srdf(chain("wrist"), name="another"),
        srdf(chain("no_such_link")),
        srdf(chain("bus")),
        srdf('<group name="arm"><joint name="elbow"/></group>'),
        srdf(),
        "no XML",
        "",
        "<sdf/>",
        '<!DOCTYPE r [<!ENTITY x "wrist">]>' + srdf(chain("&x;"))[21:],
    ],
)
def test_one_that_says_nothing_is_ignored(tmp_path, text):
    assert tip(tmp_path, text) == ("tool0", "its name is one for tips; other arms end in eye")


def test_the_one_with_the_name_of_the_file_comes_first(tmp_path):
    (tmp_path / "robot/srdf").mkdir(parents=True)
    (tmp_path / "robot/srdf/a.srdf").write_text(srdf(chain("hand")))
    assert tip(tmp_path, srdf(chain("wrist")))[0] == "wrist"


def test_the_file_itself_and_the_caller_come_before_it(tmp_path):
    assert tip(tmp_path, srdf(chain("wrist")))[0] == "wrist"
    path = tmp_path / "robot/urdf/r.urdf"
    assert sa.load(path, tip="head").tip_reason == "it was asked for"
    path.write_text(ROBOT.replace("<link", '<tip link="hand"/><link', 1))
    arm = sa.load(path)
    assert (arm.tip, arm.tip_reason) == ("hand", "the model names it")


def test_joints_that_do_not_count_rest_where_the_state_home_has_them(tmp_path):
    state = '<group_state name="%s" group="g">%s</group_state>'
    at = '<joint name="%s" value="%s"/>'
    text = srdf(
        chain("wrist"),
        state % ("ready", at % ("mast_1", 0.9)),
        state % ("home", at % ("mast_1", 0.3) + at % ("shoulder", "-0.2") + at % ("nowhere", 1)),
        state % ("Home", at % ("gripper", 7) + at % ("mast_2", "high") + at % ("mast_3", "nan")),
    )
    tip(tmp_path, text)
    arm = sa.load(tmp_path / "robot/urdf/r.urdf")
    assert arm.held == {"gripper": 0.0, "roll": 0.0, "mast_1": 0.3, "mast_2": 0.0, "mast_3": 0.0}
    assert arm.home.tolist() == [-0.2, 0.0]
    own = ROBOT.replace(
        'name="mast_1" type="revolute">', 'name="mast_1" type="revolute"><home value="0.1"/>'
    )
    assert own != ROBOT
    (tmp_path / "robot/urdf/r.urdf").write_text(own)
    assert sa.load(tmp_path / "robot/urdf/r.urdf").held["mast_1"] == 0.1
