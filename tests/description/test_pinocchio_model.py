"""Models of Pinocchio: its kinds of joints, its geometry, what is refused."""

from importlib.metadata import distribution

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_base, random_chain, random_inertia

import spacearm as sa
from spacearm.description.shapes import Box, Cylinder, Mesh, Sphere

ROBOTS = "cmeel.prefix/share/example-robot-data/robots"
HERE = pin.SE3.Identity()
TASK = sa.Task("pose", length=1.0)


def model_with(joint, free=True, seed=0):
    """A body behind one joint on a spacecraft, both with random inertias; its tip is `end`."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    model.name = "m"
    root = 0
    if free:
        root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(
        root, pin.Inertia(50.0, rng.normal(size=3), random_inertia(rng, 50.0)), HERE
    )
    model.addBodyFrame("bus", root, pin.SE3.Identity(), 0)
    at = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    arm = model.addJoint(root, joint, at, "j")
    model.appendBodyToJoint(
        arm, pin.Inertia(5.0, rng.normal(size=3), random_inertia(rng, 5.0)), HERE
    )
    model.addBodyFrame("arm", arm, pin.SE3.Identity(), 0)
    model.addBodyFrame("end", arm, pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)), 0)
    return model


def composite():
    joint = pin.JointModelComposite(2)
    joint.addJoint(pin.JointModelRX(), pin.SE3(pin.utils.rotate("y", 0.4), np.array([1.0, 2, 3])))
    joint.addJoint(pin.JointModelPZ(), pin.SE3(pin.utils.rotate("x", 0.3), np.array([0.3, 0, 1])))
    return joint


AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
KINDS = {
    "RY": pin.JointModelRY(),
    "PX": pin.JointModelPX(),
    "RUBZ": pin.JointModelRUBZ(),
    "RevoluteUnaligned": pin.JointModelRevoluteUnaligned(AXIS),
    "PrismaticUnaligned": pin.JointModelPrismaticUnaligned(AXIS),
    "Spherical": pin.JointModelSpherical(),
    "SphericalZYX": pin.JointModelSphericalZYX(),
    "Planar": pin.JointModelPlanar(),
    "Translation": pin.JointModelTranslation(),
    "Universal": pin.JointModelUniversal(np.array([0.0, 0, 1]), np.array([0.0, 1, 0])),
    "Composite": composite(),
}


@pytest.mark.filterwarnings("ignore:.*ball joint j is taken as three hinges")
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_joint_is_that_of_pinocchio(kind):
    """The tip, the CM and J* (from Pinocchio's own matrices) at a random configuration."""
    model = model_with(KINDS[kind])
    arm = sa.load(model, tip="end", task=TASK)
    rng = np.random.default_rng(1)
    q, base = rng.uniform(-1, 1, arm.n), random_base(rng)
    named = dict(zip(arm.joint_names, q, strict=True))
    values = [value for _, value in sorted(named.items(), key=lambda item: order(kind, item[0]))]
    full = np.concatenate((pin.SE3ToXYZQUAT(base), in_pinocchio(kind, values)))
    data = model.createData()
    A = pin.computeCentroidalMap(model, data, full).copy()
    frame = model.getFrameId("end")
    J = pin.computeFrameJacobian(model, data, full, frame, pin.LOCAL_WORLD_ALIGNED)
    pin.framesForwardKinematics(model, data, full)
    cfg = arm.at(q, base=base)
    assert cfg.tip.isApprox(data.oMf[frame], 1e-12)
    np.testing.assert_allclose(cfg.com, pin.centerOfMass(model, data, full), atol=1e-13)
    theirs = J[:, 6:] - J[:, :6] @ np.linalg.solve(A[:, :6], A[:, 6:])
    ours = sa.generalized_jacobian(cfg)
    if kind in ("Spherical", "SphericalZYX", "Planar"):  # the same range, in other coordinates
        rank = np.linalg.matrix_rank(np.hstack((ours, theirs)), tol=1e-9)
        assert rank == arm.n == np.linalg.matrix_rank(ours, tol=1e-9)
    else:
        np.testing.assert_allclose(ours, theirs, atol=1e-12)


def order(kind, name):
    return "zyx".index(name[-1]) if kind == "SphericalZYX" else name


def in_pinocchio(kind, values):
    """The coordinates that Pinocchio has for ours."""
    if kind == "RUBZ":
        return [np.cos(values[0]), np.sin(values[0])]
    if kind == "Planar":
        return [values[0], values[1], np.cos(values[2]), np.sin(values[2])]
    if kind == "Spherical":
        turns = [pin.utils.rotate(axis, angle) for axis, angle in zip("xyz", values, strict=True)]
        return pin.Quaternion(turns[0] @ turns[1] @ turns[2]).coeffs()
    return values


@pytest.mark.parametrize(
    "joint",
    [pin.JointModelHelicalUnaligned(AXIS, 0.1), pin.JointModelHX(0.1), pin.JointModelEllipsoid()],
)
def test_joints_that_cannot_be_described_are_refused(joint):
    with pytest.raises(sa.ModelError, match=r"m: joint 'j' is of the type JointModel.*replace it"):
        sa.load(model_with(joint), tip="end")


def test_a_free_flyer_below_another_joint_is_refused():
    model = model_with(pin.JointModelRX())
    model.addJoint(2, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "loose")
    with pytest.raises(sa.ModelError, match="joint 'loose' is of the type JointModelFreeFlyer"):
        sa.load(model, tip="end")


def test_a_fixed_base_floats_and_an_arm_alone_is_mounted():
    fixed, free = (sa.load(model_with(pin.JointModelRY(), f), tip="end", task=TASK) for f in (0, 1))
    J, K = (sa.generalized_jacobian(arm.at([0.4])) for arm in (fixed, free))
    np.testing.assert_allclose(J, K, atol=1e-14)
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "j")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.ones(3), np.eye(3)), HERE)
    with pytest.raises(sa.ModelError, match=r"'universe', the root link, has no mass.*sa.mount"):
        sa.load(model)
    assert sa.mount(model, sa.Bus(mass=9.0, size=(1, 1, 1))).n == 1


def test_limits_are_those_of_the_model():
    model = pin.buildModelFromXML(random_chain(3, 4), pin.JointModelFreeFlyer())
    arm, urdf = sa.load(model), load_text(random_chain(3, 4))
    np.testing.assert_array_equal([arm.lower, arm.upper], [urdf.lower, urdf.upper])
    for name in arm.joint_names:
        ours, theirs = arm.tree.joints[name], urdf.tree.joints[name]
        assert (ours.kind, ours.velocity, ours.effort) == (
            theirs.kind,
            theirs.velocity,
            theirs.effort,
        )


def test_zero_rates_and_efforts_are_none_and_noted():
    model = pin.buildModelFromXML(random_chain(3, 4), pin.JointModelFreeFlyer())
    model.effortLimit[6:] = model.velocityLimit[6:] = 0.0
    arm = sa.load(model)
    joints = [arm.tree.joints[name] for name in arm.joint_names]
    assert {(joint.velocity, joint.effort) for joint in joints} == {(np.inf, np.inf)}
    assert len(arm.notes) == 2 * arm.n


def test_links_keep_their_masses_and_their_chain_of_fixed_joints():
    folder = distribution("example-robot-data").locate_file(ROBOTS)
    path = f"{folder}/panda_description/urdf/panda.urdf"
    locked = {"panda_finger_joint1": 0.0}
    model = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer(), mimic=True)
    ours = sa.load(model, tip="panda_hand_tcp", locked=locked)
    theirs = sa.load(path, tip="panda_hand_tcp", locked=locked)
    masses = [
        {name: part.mass for name, part in arm.tree.links.items() if part and part.mass}
        for arm in (ours, theirs)
    ]
    assert masses[0] == pytest.approx(masses[1], rel=1e-12)
    chains = [[joint.child for joint in arm.tree.chain("panda_hand_tcp")] for arm in (ours, theirs)]
    assert chains[0] == chains[1]
    q = np.linspace(-1, 1, ours.n)
    J, K = (sa.generalized_jacobian(arm.at(q)) for arm in (ours, theirs))
    np.testing.assert_allclose(J, K, atol=1e-12)


def test_a_robot_wrapper_brings_its_shapes(tmp_path):
    shapes = (
        "<{0}><origin xyz='0 0 1'/><geometry><box size='1 2 3'/></geometry></{0}>"
        "<{0}><geometry><sphere radius='2'/></geometry></{0}>"
        "<{0}><geometry><cylinder radius='1' length='3'/></geometry></{0}>"
    )
    text = random_chain(1, 2)
    inside = shapes.format("visual") + shapes.format("collision")
    path = tmp_path / "r.urdf"
    path.write_text(text.replace("</inertial></link>", f"</inertial>{inside}</link>", 1))
    robot = pin.RobotWrapper.BuildFromURDF(str(path), [], pin.JointModelFreeFlyer())
    arm = sa.load(robot)
    assert arm.name == "r"
    for drawn in arm.tree.visuals["bus"][:2]:
        found = {type(shape.geometry): shape for shape in drawn}
        assert found[Box].geometry == Box((1.0, 2.0, 3.0))
        np.testing.assert_allclose(found[Box].pose.translation, [0, 0, 1], atol=1e-12)
        assert found[Sphere].geometry == Sphere(2.0)
        assert found[Cylinder].geometry == Cylinder(1.0, 3.0)


def test_meshes_of_a_robot_wrapper_are_files():
    folder = distribution("example-robot-data").locate_file(ROBOTS)
    path = f"{folder}/panda_description/urdf/panda.urdf"
    robot = pin.RobotWrapper.BuildFromURDF(path, [f"{folder}/../.."])
    arm = sa.load(robot, tip="panda_hand_tcp")
    mesh = arm.tree.visuals["panda_link1"].visual[0].geometry
    assert isinstance(mesh, Mesh)
    assert mesh.file.is_file()


def test_what_is_no_robot():
    for thing in (3.5, object(), pin.SE3.Identity()):
        with pytest.raises(sa.ConfigurationError, match=r"source is .*; give a text or a path"):
            sa.load(thing)
    with pytest.raises(sa.ModelError, match="no joint can move"):
        sa.load(pin.Model())
