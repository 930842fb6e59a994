"""What `to_sdf` writes, read by Gazebo's reader (libsdformat) and computed by its engine (DART)."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from comparison import compared
from conventions import DART
from helpers.arms import load_text, random_tree

import spacearm as sa

dartpy = pytest.importorskip("dartpy", reason="pip install spacearm[against]")


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    """gazebo.cpp compiled."""
    if not (shutil.which("g++") and shutil.which("pkg-config")):
        pytest.skip("libsdformat is not there: no g++ with pkg-config")
    for version in range(15, 11, -1):
        flags = ["pkg-config", "--cflags", "--libs", f"sdformat{version}"]
        found = subprocess.run(flags, capture_output=True, text=True, check=False)
        if found.returncode == 0:
            program = tmp_path_factory.mktemp("gazebo") / "gazebo"
            source = str(Path(__file__).with_name("gazebo.cpp"))
            compiler = ["g++", "-std=c++17", source, *found.stdout.split(), "-o", str(program)]
            subprocess.run(compiler, check=True)
            return program
    pytest.skip("libsdformat is not there: Debian and Ubuntu have it as libsdformat-dev")


class Gazebo(DART):
    """The skeleton that Gazebo makes of a file, link by link and joint by joint."""

    def __init__(self, arm, lines):
        rows = [line.split() for line in lines]
        bodies = {row[1]: inertia(row[2:]) for row in rows if row[0] == "link"}
        joints = [row for row in rows if row[0] in MAKERS]
        robot = dartpy.dynamics.Skeleton("robot")
        root = next(iter(bodies))
        nodes = {root: robot.createFreeJointAndBodyNodePair()[1]}
        for kind, name, parent, child, lower, upper, *numbers in joints:
            assert parent in nodes
            what = properties(kind, name, numbers)
            _, node = getattr(robot, MAKERS[kind])(nodes[parent], what)
            nodes[child] = node
            j = arm.joint_names.index(name)
            limits = np.clip((arm.lower[j], arm.upper[j]), -1e16, 1e16)  # where SDF has none
            np.testing.assert_array_equal((float(lower), float(upper)), limits)
        for name, node in nodes.items():
            node.setName(name)
            node.setInertia(bodies[name])
        frames = {row[1]: (row[2], placement(row[3:])) for row in rows if row[0] == "frame"}
        self.ask(robot, arm, *frames.get(arm.tip, (arm.tip, pin.SE3.Identity())))


MAKERS = {
    "revolute": "createRevoluteJointAndBodyNodePair",
    "prismatic": "createPrismaticJointAndBodyNodePair",
}


def inertia(words):
    mass, *numbers = map(float, words)
    return dartpy.dynamics.Inertia(mass, numbers[:3], np.reshape(numbers[3:], (3, 3)))


def properties(kind, name, words):
    made = getattr(dartpy.dynamics, f"{kind.capitalize()}JointProperties")()
    made.mName, made.mAxis = name, [float(word) for word in words[:3]]
    made.mT_ParentBodyToJoint = dartpy.math.Isometry3(placement(words[3:]).homogeneous)
    return made


def placement(words):
    x, y, z, *wxyz = map(float, words)
    return pin.SE3(pin.Quaternion(*wxyz).toRotationMatrix(), np.array((x, y, z)))


def arms():
    trees = ((seed, random_tree(seed, 3 + seed % 6)) for seed in range(8))
    task = sa.Task("pose", length=1.0)
    return {
        **{name: sa.load(name) for name in ("planar2", "chaser7", "mda6", "dual_ur5")},
        "vispa": sa.mount("vispa", sa.Bus(mass=200, size=(1, 1, 1))),
        **{
            f"tree {seed}": load_text(text, tip="link_3", task=task, joints="all")
            for seed, text in trees
            if "mimic" not in text
        },
    }


@pytest.mark.slow
def test_gazebo_reads_and_moves_what_we_write(reader, tmp_path):
    for name, arm in arms().items():
        path = sa.to_sdf(arm, tmp_path / "robot.sdf")
        said = subprocess.run([reader, path], capture_output=True, text=True, check=True)
        assert not said.stderr
        for quantity, difference in compared(
            arm, lambda arm, said=said: Gazebo(arm, said.stdout.splitlines())
        ).items():
            assert difference < 1e-10, (name, quantity)
