"""Every result has a `to_dict` of plain JSON data."""

import inspect
import json
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from helpers.sweeps import STUDY

import spacearm as sa
from spacearm.arrays import plain

PLAIN = (dict, list, str, int, float, bool, type(None))


@cache
def arm():
    return sa.load("planar2")


def configuration():
    return arm().at([0.3, 0.4], base=pin.SE3.Random())


@cache
def singular_set():
    return sa.singular_set(arm())


@cache
def workspace():
    return sa.workspace(arm())


@cache
def barycentric():
    return sa.barycentric(configuration())


def grasp():
    return sa.capture(configuration(), np.ones(6), 2.0, np.eye(3))


def motion():
    return sa.Motion(arm(), [0.0, 1.0], [[0.1, 0.2], [0.3, 0.4]], np.tile(np.eye(7)[6], (2, 1)))


def run():
    law = sa.JointPD(target=[0.2, 0.3], kp=5.0, kd=9.0)
    return sa.simulate(arm().at([0.1, 0.2]), law, 0.5, integration=sa.Integration(events=()))


@cache
def unsure():
    return sa.uncertain(arm(), {"link_2": {"mass": 0.05}})


@cache
def plan():
    return sa.plan(arm().at([0.3, 1.2]), sa.Joints([0.4, 1.3]))


@cache
def flight():
    law = sa.JointPD(target=[0.2, 0.3], kp=5.0, kd=9.0)
    phases = [sa.Phase(law, 0.2, sa.Grasp(mass=2.0)), sa.Phase(law, 0.2, sa.Release())]
    return sa.simulate_phases(arm().at([0.1, 0.2]), phases)


RESULTS = {
    "ArmInfo": lambda: sa.arms()[0],
    "Attempt": lambda: plan().tried[0],
    "Barycentric": barycentric,
    "Bus": lambda: sa.Bus(12.0, size=(0.1, 0.2, 0.3)),
    "Capture": grasp,
    "Certificate": lambda: singular_set().is_free([0.1, 0.2], [0.2, 0.3]),
    "Certificate of a singularity": lambda: singular_set().is_free([0.1, -2.0], [0.1, 2.0]),
    "CollisionReport": lambda: sa.collision_check(configuration(), sa.Obstacle.sphere(9.0)),
    "Component": lambda: singular_set().components()[0],
    "Configuration": configuration,
    "Constraints": lambda: sa.Constraints(rates=[0.1, 0.2], obstacles=sa.Obstacle.sphere(1.0)),
    "DampedLeastSquares": lambda: sa.DampedLeastSquares(target=(1.0, 1.0)),
    "DistanceRange": lambda: sa.distance_range(unsure(), [0.3, 0.4], samples=2),
    "Dynamics": lambda: sa.forward_dynamics(configuration(), [0.1, 0.2], [1.0, 0.0]),
    "ErrorBars": lambda: sa.error_bars(configuration()),
    "Event": lambda: sa.Event(1.0, "target", np.zeros(2), "error 0.001"),
    "Followed": lambda: sa.follow(arm().at([0.3, 1.2]), [(1.5, 1.2)]),
    "FeasibleAttitudes": lambda: sa.feasible_attitudes(
        arm().at([0, 1]), [(1.5, 0.2), (1.5, 0.5)], all_branches=True, samples=16
    ),
    "FoundSet": lambda: sa.singular_set(sa.load("servicer_panda"), mode="fixed"),
    "JointPD": lambda: sa.JointPD(target=lambda t: [t, t], kp=5.0, kd=9.0),
    "Joints": lambda: sa.Joints([0.1, 0.2]),
    "ModelInfo": lambda: sa.catalogue()[0],
    "MomentumMatrix": lambda: sa.momentum_matrix(configuration()),
    "LevelEnvelope": lambda: sa.level_envelope(arm().at([-0.6, 1.4]), [0.02], [30.0], directions=8),
    "LevelReach": lambda: sa.level_reach(arm().at([-0.6, 1.4]), 0.02, directions=8),
    "MomentumBudget": lambda: sa.momentum_budget(
        arm().at([-0.6, 1.4], momentum=[0, 0, 0, 0, 0, 1])
    ),
    "Mounted": lambda: sa.design.optimise_mount(arm(), {"mount_x": (0.4, 0.5)}, most=2),
    "Motion": motion,
    "Obstacle": lambda: sa.Obstacle.robot(motion(), margin=0.1),
    "Plan": plan,
    "PoseRisk": lambda: sa.pose_risk(arm(), poses=3, neighbours=2, samples=50),
    "PrescribedMotion": lambda: sa.prescribed_motion(configuration(), {"joint_1": 0.1}),
    "Reaction": lambda: sa.reaction(motion()),
    "Reactionless": lambda: sa.Reactionless(target=(1.0, 1.0)),
    "Region": lambda: workspace().regions([2.0, 0.0]),
    "ResolvedRate": lambda: sa.ResolvedRate(target=pin.SE3.Random()),
    "RiskProfile": lambda: sa.risk_profile(arm(), bins=3, samples=100),
    "RiskProfile of empty classes": lambda: sa.risk_profile(arm(), bins=[9.0, 10.0], samples=9),
    "Roots": lambda: singular_set().roots([0.1, 0.2]),
    "RobustCertificate": lambda: sa.is_free_for_all(unsure(), [[0.1, 0.2], [0.3, 0.4]]),
    "RobustCertificate of a singularity": lambda: sa.is_free_for_all(
        unsure(), [[0.1, -2.0], [0.1, 2.0]]
    ),
    "Shell": lambda: workspace().shells[0],
    "ShellBands": lambda: sa.shell_bands(unsure(), samples=1),
    "SingularMap": lambda: sa.singular_map(arm(), points=5),
    "SingularSet": singular_set,
    "Search": lambda: sa.Search(seed=1),
    "SingularityReport": lambda: sa.singularity(configuration()),
    "SpaceArm": arm,
    "Study": lambda: sa.Study.parse(STUDY),
    "Task": lambda: arm().task,
    "Trajectory": run,
    "TransposedJacobian": lambda: sa.TransposedJacobian(target=(1.0, 1.0), kp=5.0, kd=9.0),
    "Flight": flight,
    "GeneralizedJacobianTask": lambda: sa.GeneralizedJacobianTask(arm(), pin.SE3.Random()),
    "MomentumConservation": lambda: sa.MomentumConservation(arm()),
    "SingularityBarrier": lambda: sa.SingularityBarrier(arm(), 0.1),
    "Grasp": lambda: sa.Grasp(mass=2.0, inertia=np.eye(3)),
    "Phase": lambda: sa.Phase(lambda _t, q, _dq: 0.0 * q, 1.0, sa.Release(), stop=["target"]),
    "Release": lambda: sa.Release(),
    "Integration": lambda: sa.Integration(rtol=1e-6, events=("target",)),
    "PassiveJoint": lambda: sa.PassiveJoint(damping=0.1),
    "TrigPolynomial": lambda: sa.singularity_polynomial(arm()),
    "UncertainArm": lambda: unsure(),
    "VirtualManipulator": lambda: barycentric().virtual_manipulator,
    "WheelSizing": lambda: sa.size_wheels(arm(), tip_speed=0.1, samples=20),
    "Tracking": lambda: sa.Tracking(motion()),
    "Plant": lambda: sa.Plant(wrenches={"bus": lambda t: [t, 0.0, 0.0, 0.0, 0.0, 0.0]}),
    "WheelHold": lambda: sa.WheelHold(stiffness=1.0, damping=2.0, torque=0.1, capacity=5.0),
    "Workspace": workspace,
}


def assert_plain(value):
    """Of exactly the types that JSON has: no numpy scalars, which are floats and ints too."""
    assert type(value) in PLAIN
    if isinstance(value, dict):
        assert all(type(key) is str for key in value)
        value = list(value.values())
    if isinstance(value, list):
        for entry in value:
            assert_plain(entry)


def test_every_public_class_is_here():
    classes = {n: c for n in sa.__all__ if inspect.isclass(c := getattr(sa, n))}
    results = {n for n, c in classes.items() if not issubclass(c, BaseException)}
    assert results <= set(RESULTS)


@pytest.mark.parametrize("name", RESULTS)
def test_results_are_plain_data(name):
    data = RESULTS[name]().to_dict()
    assert isinstance(data, dict)
    assert_plain(data)
    assert json.loads(json.dumps(data)).keys() == data.keys()


def test_arms_are_told_by_name_poses_by_seven_numbers():
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, np.pi), np.array([1.0, 2.0, 3.0]))
    told = plain({"arm": arm(), 1: (pose, np.float64("nan"), 1j)})
    assert told["arm"] == "planar2"
    np.testing.assert_allclose(told["1"][0], [1, 2, 3, 0, 0, 1, 0], atol=1e-12)
    assert np.isnan(told["1"][1])
    assert told["1"][2] == [0.0, 1.0]
    with pytest.raises(TypeError, match="a object has no form as plain data"):
        plain(object())


def test_coefficients_of_a_polynomial_are_real_and_imaginary_parts():
    S = sa.singularity_polynomial(arm())
    data = S.to_dict()
    assert data["degrees"] == [2, 1]
    pairs = np.array(data["coefficients"])
    np.testing.assert_array_equal(pairs[..., 0] + 1j * pairs[..., 1], S.coefficients)
