"""Robots that nobody here wrote: joints, tip and mass as their makers' files and sheets say.

Masses are sums of the <mass> of each file, typed here; MuJoCo's own where geoms have a density.
"""

import os
import warnings
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import spacearm as sa

pytestmark = pytest.mark.slow
BUS = sa.Bus(mass=200.0, size=(1, 1, 1))
KUKA = "kuka_description/kuka_"
GRIPPER = (
    0.001 + 0.034199 + 0.001 + 2 * 0.016246 + 0.001
)  # ee_arm to ee_gripper of the smaller arms
RTB = {
    f"{KUKA}kr16/urdf/kr16_2.urdf": (6, "tool0", 14.0),
    f"{KUKA}kr120/urdf/kr120r2500pro.urdf": (6, "tool0", 14.0),
    f"{KUKA}kr210/urdf/kr210l150.urdf": (6, "tool0", 4879.2654),
    "trossen_descriptions/urdf/px150.urdf.xacro": (
        5,
        "/ee_gripper_link",
        0.766173 + 0.287601 + 0.338081 + 0.226542 + 0.084957 + 0.072885 + 0.00434 + GRIPPER,
    ),
    "trossen_descriptions/urdf/wx250s.urdf.xacro": (
        6,
        "/ee_gripper_link",
        0.538736 + 0.480879 + 0.430811 + 0.234589 + 0.220991 + 0.084957 + 0.072885 + 0.00434
        + GRIPPER,
    ),
    "trossen_descriptions/urdf/vx300s.urdf.xacro": (
        6,
        "/ee_gripper_link",
        0.969034 + 0.798614 + 0.792592 + 0.322228 + 0.414823 + 0.115395 + 0.097666 + 0.001
        + 0.008009 + 0.150986 + 0.001 + 2 * 0.034796 + 0.001,
    ),
}  # fmt: skip
"""Files of rtb-data: number of joints, tip and mass [kg]; Interbotix' arms have 5 and 6 joints."""
EXAMPLES = {
    "ur_description/urdf/ur5_robot.urdf": (6, "tool0", 20.9939),
    "ur_description/urdf/ur10_robot.urdf": (6, "tool0", 32.7),
    "panda_description/urdf/panda.urdf": (7, "panda_hand_tcp", 17.451902),
    "xarm_description/urdf/xarm7.urdf": (7, "link_eef", 11.31706),
    "kinova_description/robots/kinova.urdf": (6, "j2s6s200_end_effector", 4.83784),
}
"""Files of example-robot-data."""
MENAGERIE = {
    "universal_robots_ur5e": (6, None, 4.0 + 3.7 + 8.393 + 2.275 + 2 * 1.219 + 0.1889),
    "franka_emika_panda": (7, "hand", 17.451902),
    "kuka_iiwa_14": (7, None, None),
}
"""Robots of MuJoCo Menagerie; None where nothing is claimed."""


def folder_of(package, within):
    """The folder of robots of an installed package; without it the test is skipped."""
    try:
        return Path(str(distribution(package).locate_file(within)))
    except PackageNotFoundError:
        pytest.skip(f"{package} is not installed: pip install 'spacearm[robots]'")


def loaded(path):
    """The arm, its tip, and its mass without the bus that an arm alone is mounted on."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            arm = sa.load(path)
        except sa.ModelError as error:
            if "sa.mount(" not in str(error):  # what it is told to do
                raise
            arm = sa.mount(path, BUS)
            return arm, arm.tip, arm.mass - BUS.mass
    return arm, arm.tip, arm.mass


def check(path, n, tip, mass):
    arm, found, own = loaded(path)
    assert arm.n == n
    if mass is not None:
        assert own == pytest.approx(mass, rel=1e-6)
    if tip is not None:
        assert found == tip
    report = sa.singularity(arm.at(0.4 * np.ones(n)))
    assert np.isfinite(report.sigma).all()


@pytest.mark.parametrize("file", RTB)
def test_robots_of_rtb_data(file):
    check(folder_of("rtb-data", "rtbdata/xacro") / file, *RTB[file])


@pytest.mark.parametrize("file", EXAMPLES)
def test_robots_of_example_robot_data(file):
    robots = folder_of("example-robot-data", "cmeel.prefix/share/example-robot-data/robots")
    check(robots / file, *EXAMPLES[file])


@pytest.mark.parametrize("name", MENAGERIE)
def test_robots_of_mujoco_menagerie(name):
    """They are downloaded by a command of their own, `mujoco-menagerie prefetch`: never here."""
    if not find_spec("mujoco_menagerie"):
        pytest.skip("mujoco-menagerie is not installed: pip install 'spacearm[robots]'")
    import mujoco_menagerie as menagerie
    from mujoco_menagerie import Cache

    robot, cache = menagerie.get(name), Cache()
    if "MENAGERIE_ROOT" not in os.environ and not cache.is_cached(robot):
        pytest.skip(f"{name} is not downloaded: mujoco-menagerie prefetch {name}")
    check(robot.xml(robot.default_model), *MENAGERIE[name])


def test_the_arm_of_gymnasium():
    """Pusher: an arm like one of PR2's, its mass from the density of its geoms."""
    import mujoco

    path = folder_of("gymnasium", "gymnasium/envs/mujoco/assets") / "pusher_v5.xml"
    model = mujoco.MjModel.from_xml_path(str(path))
    arm, _, mass = loaded(path)
    assert arm.n == 7
    assert mass == pytest.approx(model.body("r_shoulder_pan_link").subtreemass[0], rel=1e-12)
