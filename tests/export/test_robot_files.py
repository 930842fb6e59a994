"""MJCF and SDF: what MuJoCo and Drake make of them moves like the arm, and `load` reads them."""

import warnings

import numpy as np
import pytest
from helpers.arms import load_text, random_chain, random_tree, seeds
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree
from lxml.builder import E

import spacearm as sa


def tree_arm(seed, n):
    task = sa.Task("pose", length=1.0)
    return load_text(random_tree(seed, n), tip=f"link_{n}", task=task, joints="all")


def loaded(path, arm):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sa.load(path, tip=arm.tip, task=arm.task, joints="all")


def assert_the_same(twin, arm, seed):
    q = np.random.default_rng(seed).uniform(-2, 2, arm.n)
    order = [arm.joint_names.index(name) for name in twin.joint_names]
    J = sa.generalized_jacobian(arm.at(q))[:, order]
    assert_close(sa.generalized_jacobian(twin.at(q[order])), J)
    np.testing.assert_allclose(twin.lower, arm.lower[order], atol=1e-12)
    np.testing.assert_allclose(twin.upper, arm.upper[order], atol=1e-12)
    np.testing.assert_array_equal(rate_limits(twin), rate_limits(arm)[order])


def rate_limits(arm):
    return np.array([arm.tree.joints[name].velocity for name in arm.joint_names])


def assert_close(J, wanted, rtol=1e-12):
    np.testing.assert_allclose(J, wanted, rtol=0, atol=rtol * max(1.0, np.abs(wanted).max()))


@settings(max_examples=15)
@given(seeds, st.integers(1, 6))
def test_load_reads_them_again(tmp_path_factory, seed, n):
    pytest.importorskip("mujoco")
    folder, arm = tmp_path_factory.mktemp("files"), tree_arm(seed, n)
    assert_the_same(loaded(sa.to_sdf(arm, folder / "robot.sdf"), arm), arm, seed)
    assert_the_same(loaded(sa.to_mjcf(arm, folder / "robot.xml"), arm), arm, seed)


def in_mujoco(path, arm, q):
    """J* from MuJoCo's own mass matrix and Jacobian."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, value in zip(arm.joint_names, q, strict=True):
        data.qpos[model.joint(name).qposadr] = value
    mujoco.mj_forward(model, data)
    M, J = np.zeros((model.nv, model.nv)), np.zeros((6, model.nv))
    mujoco.mj_fullM(model, data, M)
    mujoco.mj_jacSite(model, data, J[:3], J[3:], model.site(arm.tip).id)
    dofs = [model.joint(name).dofadr[0] for name in arm.joint_names]
    return J[:, dofs] - J[:, :6] @ np.linalg.solve(M[:6, :6], M[:6, dofs])


@settings(max_examples=15)
@given(seeds, st.integers(1, 7))
def test_mujoco_has_the_same_jacobian(tmp_path_factory, seed, n):
    path = tmp_path_factory.mktemp("mujoco") / "robot.xml"
    arm = load_text(random_chain(seed, n, ("revolute", "prismatic")), tip="tip", task="x")
    q = np.random.default_rng(seed).uniform(-2, 2, n)
    J = in_mujoco(sa.to_mjcf(arm, path), arm, q)
    assert_close(J, sa.generalized_jacobian(arm.at(q)), 1e-11)


def test_any_arm_on_any_bus_runs_in_mujoco(tmp_path):
    arm = sa.mount("vispa", sa.Bus(mass=200, size=(1, 1, 1)))
    q = np.linspace(-0.5, 0.7, arm.n)
    J = in_mujoco(sa.to_mjcf(arm, tmp_path / "robot.xml"), arm, q)
    assert_close(J, sa.generalized_jacobian(arm.at(q)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "chaser7", "mda6"])
def test_drake_has_the_same_jacobian(name, tmp_path):
    multibody = pytest.importorskip("pydrake.multibody.plant")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.tree import JacobianWrtVariable

    arm = sa.load(name)
    plant = multibody.MultibodyPlant(0.0)
    (robot,) = Parser(plant).AddModels(str(sa.to_sdf(arm, tmp_path / "robot.sdf")))
    plant.Finalize()
    context, q = plant.CreateDefaultContext(), np.linspace(-0.5, 0.7, arm.n)
    joints = [plant.GetJointByName(name, robot) for name in arm.joint_names]
    for joint, value in zip(joints, q, strict=True):
        joint.set_angle(context, value)
    world = plant.world_frame()
    J = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, plant.GetFrameByName(arm.tip), np.zeros(3), world, world
    )
    J, M = np.vstack((J[3:], J[:3])), plant.CalcMassMatrix(context)
    dofs = [joint.velocity_start() for joint in joints]
    base = sorted(set(range(plant.num_velocities())) - set(dofs))
    found = J[:, dofs] - J[:, base] @ np.linalg.solve(M[np.ix_(base, base)], M[np.ix_(base, dofs)])
    assert_close(found, sa.generalized_jacobian(arm.at(q)), 1e-11)


def test_joints_that_are_held_are_fixed(tmp_path):
    arm = load_text(random_chain(3, 4), tip="tip", task="x y").replace(locked={"joint_2": 0.4})
    twin = loaded(sa.to_sdf(arm, tmp_path / "robot.sdf"), arm)
    assert twin.joint_names == arm.joint_names
    assert_the_same(twin, arm, 0)


def massless():
    """A chain whose link_1 has a shape and no mass, as between the axes of a universal joint."""
    robot = etree.fromstring(random_chain(3, 2))
    (link,) = robot.xpath("link[@name='link_1']")
    etree.strip_elements(link, "inertial")
    link.append(E.visual(E.geometry(E.box(size="1 1 1"))))
    with pytest.warns(sa.ModelWarning, match="taken as massless: 'link_1'"):
        return load_text(etree.tostring(robot, encoding="unicode"), tip="tip", task="x")


def test_what_has_no_mass_gets_none(tmp_path):
    """Of SDF 1 kg is the default, and MuJoCo would take the volume of the shape."""
    mujoco, arm = pytest.importorskip("mujoco"), massless()
    twin = loaded(sa.to_sdf(arm, tmp_path / "robot.sdf"), arm)
    assert twin.mass == pytest.approx(arm.mass, rel=1e-14)
    assert_the_same(twin, arm, 0)
    path = sa.to_mjcf(arm, tmp_path / "robot.xml")
    with pytest.raises(ValueError, match=r"mass and inertia of moving bodies(.|\n)*link_1"):
        mujoco.MjModel.from_xml_path(str(path))


def test_parts_of_a_link_have_names_of_their_own(tmp_path):
    root = etree.parse(sa.to_sdf(sa.load("planar2"), tmp_path / "robot.sdf")).getroot()
    for parent in root.iter():
        names = [child.get("name") for child in parent if child.get("name")]
        assert len(names) == len(set(names))
    assert root.get("version") == "1.7"
