"""Every result has a `to_dict` of plain JSON data, and a description that is shown everywhere."""

import copy
import inspect
import json
import pickle
from functools import cache
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import planar_pair
from helpers.catching import caught, flown
from helpers.closed import roomy
from helpers.sweeps import STUDY

import spacearm as sa
from spacearm.arrays import plain
from spacearm.cli.output import print_description, print_json
from spacearm.plots.report_page import ReportSection
from spacearm.results import (
    Column,
    Described,
    Description,
    Measure,
    Result,
    Table,
    joint_measures,
    short_names,
    text,
)

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
def held():
    ends = {"left": sa.pose((-0.3, 0, 0)), "right": sa.pose((0.3, 0, 0))}
    rod = sa.Target(sa.Bus(5.0, size=(1, 0.1, 0.1)), sa.pose((0, 1.5, 0)))
    return sa.hold(planar_pair().at([2.0, -1.2, 1.1, 1.2]), rod, ends)


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


def led_target():
    target, far = roomy(tries=1)
    return target.follow([target.target.pose * sa.pose((0.2 * far, 0, 0))], limits=False)


def planned_target():
    target, far = roomy(tries=1)
    return target.plan(
        target.target.pose * sa.pose((0.2 * far, 0, 0)), constraints=sa.Constraints(limits=False)
    )


def regrasp():
    target, _ = roomy(1, tries=1)
    tip, free = target.arm.tips[0], sa.Constraints(limits=False)
    return target.regrasp(tip, target.grasps[tip], approach=0.02, constraints=free)


def run_of_target():
    target, _ = roomy(tries=1)
    law = sa.JointPD(target.q, kp=0.1, kd=0.1)
    return target.simulate(law, 0.1, integration=sa.Integration(dt=0.05))


def identified():
    holding = arm().grasp(2.0, 0.1 * np.eye(3)).at([0.3, 1.2])
    law, coarse = sa.JointPD([0.9, 0.4], kp=5.0, kd=9.0), sa.Integration(dt=0.1)
    return sa.identify(sa.simulate(holding, law, 2.0, integration=coarse), arm())


RESULTS = {
    "ArmInfo": lambda: sa.arms()[0],
    "Attempt": lambda: plan().tried[0],
    "Barycentric": barycentric,
    "Bus": lambda: sa.Bus(12.0, size=(0.1, 0.2, 0.3)),
    "Capture": grasp,
    "CaptureEnvelope": lambda: sa.CaptureEnvelope(place=0.1),
    "Catch": caught,
    "CatchRuns": flown,
    "Certificate": lambda: singular_set().is_free([0.1, 0.2], [0.2, 0.3]),
    "Certificate of a singularity": lambda: singular_set().is_free([0.1, -2.0], [0.1, 2.0]),
    "CollisionReport": lambda: sa.collision_check(configuration(), sa.Obstacle.sphere(9.0)),
    "Component": lambda: singular_set().components()[0],
    "Configuration": configuration,
    "Constraints": lambda: sa.Constraints(rates=[0.1, 0.2], obstacles=sa.Obstacle.sphere(1.0)),
    "DampedLeastSquares": lambda: sa.DampedLeastSquares(target=(1.0, 1.0)),
    "DistanceRange": lambda: sa.distance_range(unsure(), [0.3, 0.4], samples=2),
    "Dynamics": lambda: sa.forward_dynamics(configuration(), [0.1, 0.2], [1.0, 0.0]),
    "Connection": lambda: sa.connected(arm().at([0.3, 1.2]), arm().at([0.4, 1.3])),
    "ErrorBars": lambda: sa.error_bars(configuration()),
    "Event": lambda: sa.Event(1.0, "target", np.zeros(2), "error 0.001"),
    "Followed": lambda: sa.follow(arm().at([0.3, 1.2]), [(1.5, 1.2)]),
    "FollowedTarget": led_target,
    "FeasibleAttitudes": lambda: sa.feasible_attitudes(
        arm().at([0, 1]), [(1.5, 0.2), (1.5, 0.5)], all_branches=True, samples=16
    ),
    "FoundSet": lambda: sa.singular_set(sa.load("servicer_panda"), mode="fixed"),
    "Held": held,
    "ClosedMap": lambda: held().map(points=3),
    "HeldReport": lambda: held().report(),
    "FreeBox": lambda: sa.free_box(arm().at([0.3, 1.2])),
    "FreeBox of uncertain arms": lambda: sa.free_box_for_all(unsure(), arm().at([0.3, 1.2])),
    "FreeBoxes": lambda: sa.free_boxes(arm(), share=0.5),
    "Identified": identified,
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
    "Regrasp": regrasp,
    "Region": lambda: workspace().regions([2.0, 0.0]),
    "ResolvedRate": lambda: sa.ResolvedRate(target=pin.SE3.Random()),
    "RiskProfile": lambda: sa.risk_profile(arm(), bins=3, samples=100),
    "RiskProfile of empty classes": lambda: sa.risk_profile(arm(), bins=[9.0, 10.0], samples=9),
    "NearestSingular": lambda: singular_set().nearest([0.3, 0.4]),
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
    "Servo": lambda: sa.Servo(arm(), accelerations=1.0),
    "ServoControl": lambda: sa.ServoControl(servo=sa.Servo(arm()), twist=[0.1, 0.0]),
    "ServoStep": lambda: sa.Servo(arm()).step(configuration(), [0.1, 0.0], 0.01),
    "SingularityReport": lambda: sa.singularity(configuration()),
    "SpaceArm": arm,
    "Study": lambda: sa.Study.parse(STUDY),
    "Task": lambda: arm().task,
    "TargetPlan": planned_target,
    "TargetRun": run_of_target,
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
    "Sampling": lambda: sa.Sampling(period=0.1, delay=0.02, rate_noise=[0.1, 0.2]),
    "PassiveJoint": lambda: sa.PassiveJoint(damping=0.1),
    "WheelFriction": lambda: sa.WheelFriction(viscous=1e-3, dry=1e-3),
    "TrigPolynomial": lambda: sa.singularity_polynomial(arm()),
    "Target": lambda: sa.Target(sa.Bus(9.0, size=(1, 1, 1)), grapples={"ring": sa.pose()}),
    "UncertainArm": lambda: unsure(),
    "VirtualManipulator": lambda: barycentric().virtual_manipulator,
    "WheelSizing": lambda: sa.size_wheels(arm(), tip_speed=0.1, samples=20),
    "TargetErrors": lambda: sa.TargetErrors(place=0.1),
    "Tracking": lambda: sa.Tracking(motion()),
    "Plant": lambda: sa.Plant(wrenches={"bus": lambda t: [t, 0.0, 0.0, 0.0, 0.0, 0.0]}),
    "WheelHold": lambda: sa.WheelHold(stiffness=1.0, damping=2.0, torque=0.1, capacity=5.0),
    "Watched": lambda: next(sa.Servo(arm()).watch([{"t": 0.0, "q": [0.3, 1.2]}])),
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
def test_results_are_plain_data_and_described(name):
    thing = RESULTS[name]()
    data = thing.to_dict()
    assert isinstance(data, dict)
    assert_plain(data)
    assert json.loads(json.dumps(data, allow_nan=False)).keys() == data.keys()
    if isinstance(thing, Described):
        said = thing.describe()
        assert said.title
        left = thing.not_checked if isinstance(thing, Result) else ""
        assert said.not_checked == left == data.get("not_checked", "")
        assert said.verdict or said.tables
        assert repr(thing).startswith(type(thing).__name__)
        print_description(said)
        root = ElementTree.fromstring(thing._repr_html_())
        assert root.find("strong").text
        for part in root.iter("table"):
            assert len({len(row) for row in part.iter("tr")}) == 1


LOCAL = {"JointPD": "target", "Phase": "controller", "Plant": "wrenches of 'bus'"}
"""Those of `RESULTS` that hold a function which no other process finds, and where."""


@pytest.mark.parametrize("name", RESULTS)
def test_results_are_pickled_and_copied_and_their_arrays_stay_read_only(name):
    thing = RESULTS[name]()
    copies = [copy.copy(thing), copy.deepcopy(thing)]
    if name in LOCAL:
        with pytest.raises(sa.ConfigurationError, match=LOCAL[name]):
            pickle.dumps(thing)
    else:
        copies.append(pickle.loads(pickle.dumps(thing)))
    for other in copies:
        assert type(other) is type(thing)
        assert other.to_dict().keys() == thing.to_dict().keys()
        for part, value in getattr(thing, "__dict__", {}).items():
            if isinstance(value, np.ndarray) and not value.flags.writeable:
                assert not vars(other)[part].flags.writeable


def test_grapple_frames_of_a_target_stay_through_a_pickle():
    target = RESULTS["Target"]()
    again = pickle.loads(pickle.dumps(target))
    assert again.to_dict() == target.to_dict()
    with pytest.raises(TypeError):
        again.grapples["ring"] = sa.pose()


def test_arms_are_told_by_name_poses_by_seven_numbers():
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, np.pi), np.array([1.0, 2.0, 3.0]))
    told = plain({"arm": arm(), 1: (pose, np.float64("nan"), 1j)})
    assert told["arm"] == "planar2"
    np.testing.assert_allclose(told["1"][0], [1, 2, 3, 0, 0, 1, 0], atol=1e-12)
    assert told["1"][1] is None
    assert told["1"][2] == [0.0, 1.0]
    with pytest.raises(TypeError, match="a object cannot be written as plain data"):
        plain(object())


@pytest.mark.parametrize(
    "value", [np.inf, -np.inf, np.nan, np.float32("nan"), np.longdouble("inf")]
)
def test_numbers_that_json_lacks_are_none(value):
    assert plain(value) is None
    assert plain([np.array([1.0, value]), complex(1.0, value)]) == [[1.0, None], [1.0, None]]


def test_a_limit_that_a_law_does_not_have_is_none():
    assert sa.JointPD([0.5, 1.0], 5.0, 9.0).to_dict()["limit"] is None
    hold = sa.WheelHold(stiffness=1.0, damping=2.0, torque=np.inf, capacity=np.inf)
    assert (hold.to_dict()["torque"], hold.to_dict()["capacity"]) == (None, None)


def test_coefficients_of_a_polynomial_are_real_and_imaginary_parts():
    S = sa.singularity_polynomial(arm())
    data = S.to_dict()
    assert data["degrees"] == [2, 1]
    pairs = np.array(data["coefficients"])
    np.testing.assert_array_equal(pairs[..., 0] + 1j * pairs[..., 1], S.coefficients)


GIVEN = {"CaptureEnvelope", "TargetErrors",
    "Bus", "Constraints", "DampedLeastSquares", "GeneralizedJacobianTask", "Grasp", "Integration",
    "JointPD", "Joints", "MomentumConservation", "Obstacle", "PassiveJoint", "Phase", "Plant",
    "Reactionless", "Release", "ResolvedRate", "Sampling", "Search", "Servo", "ServoControl",
    "SingularityBarrier", "Study", "Task", "Tracking", "TransposedJacobian", "WheelFriction",
    "WheelHold",
}  # fmt: skip
ROWS = {"ArmInfo", "Attempt", "Configuration", "Event", "ModelInfo"}
"""What a caller gives, and what stands in the tables of others, has no description of its own."""


def test_every_result_has_a_description():
    without = {n for n in sa.__all__ if inspect.isclass(c := getattr(sa, n))
               and not issubclass(c, BaseException) and not hasattr(c, "describe")}  # fmt: skip
    assert without == GIVEN | ROWS


def test_a_class_without_a_description_is_not_made():
    class Mute(Described):
        pass

    with pytest.raises(TypeError, match="abstract"):
        Mute()


HOSTILE = """<robot name="a&lt;script&gt;b">
  <link name="base"><inertial><mass value="9"/>
    <inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="&lt;b&gt;&amp;&quot;tip"><inertial><mass value="2"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="&lt;img src=x&gt;" type="prismatic"><parent link="base"/>
    <child link="&lt;b&gt;&amp;&quot;tip"/><axis xyz="0 0 1"/>
    <limit lower="-0.25" upper="0.5" velocity="1" effort="1"/></joint>
</robot>"""


def cells(thing):
    """The rows of all tables of a thing, as texts; the HTML must be well formed."""
    root = ElementTree.fromstring(thing._repr_html_())
    return [[cell.text or "" for cell in row] for row in root.iter("tr")]


def test_names_of_a_file_are_text_and_no_markup(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(HOSTILE)
    arm = sa.load(path, task="z")
    for thing in (arm, sa.singularity(arm.at([0.1]))):
        assert {e.tag for e in ElementTree.fromstring(thing._repr_html_()).iter()} <= {
            "div", "strong", "table", "tr", "th", "td"
        }  # fmt: skip
        assert any("<img src=x>" in cell for row in cells(thing) for cell in row)
    assert ["<img src=x>", "-0.25 m", "0.5 m"] in [row[:3] for row in cells(arm)]


def test_a_report_shows_the_posture_the_way_out_and_the_lost_direction():
    report = sa.singularity(sa.load("planar2").at(np.radians([-65, -11.41])), exact=True)
    rows = cells(report)
    (joint,) = (row for row in rows if row[0] == "joint_2")
    assert joint[1].startswith("-11.41°")
    np.testing.assert_allclose(float(joint[2].split("°")[0]), -11.411, atol=1e-3)  # nearest
    (note,) = (note for note in report.describe().notes if note.startswith("To get away"))
    assert "joint_2" in note
    (lost,) = (row for row in rows if row[0] == "lost")
    np.testing.assert_allclose(np.array(lost[2:], float), report.lost[:, 0], atol=1e-4)


def test_a_plan_shows_what_was_tried_and_how_it_moves():
    plan = RESULTS["Plan"]()
    rows = cells(plan)
    assert [row[0] for row in rows[-len(plan.tried) :]] == [a.method for a in plan.tried]
    (joint,) = (row for row in rows if row[0] == "joint_1")
    both = joint_measures(plan.q[[0, -1], 0], [False, False])
    assert joint[1:3] == [text(value, "both") for value in both]


def test_values_have_units_and_a_limit_that_is_none_says_so():
    angle, length, none = joint_measures([np.pi, 0.125, -np.inf], [False, True, True])
    assert text(angle, "both") == "180° (3.1416 rad)"
    assert (text(angle, "deg"), text(angle, "rad")) == ("180°", "3.1416 rad")
    assert text(length, "both") == "0.125 m"
    assert text(none, "deg") == "none"
    assert text(Measure(np.array([1.0, 1e-17]), "rad/s"), "deg") == "(57.296, 0)°/s"
    assert Table.facts({"a<b": np.array([1.0, 2.5])}).to_html() == (
        "<table><tr><td>a&lt;b</td><td>(1, 2.5)</td></tr></table>"
    )


class Slosh(Result):
    """A made-up result: how much fuel moves in the tank while the arm does."""

    arm: sa.SpaceArm
    t: np.ndarray
    turn: np.ndarray

    not_checked = "vapour"

    def describe(self):
        rows = list(zip(self.t, self.turn, strict=True))
        return Description(
            title=self.arm.name,
            verdict="the fuel <stays> in its tank",
            tone="good",
            notes=["a made-up result"],
            tables=[Table((Column("time", "s", ".2f"), Column("turn of the fuel", "rad")), rows)],
            events=Table(("event", Column("time", "s")), [("splash", 0.5)]),
        )


def test_a_description_is_all_that_a_new_result_class_needs(capsys):
    slosh = Slosh(arm(), np.array([0.0, 0.5]), np.radians([10.0, 20.0]))
    assert repr(slosh) == "Slosh(planar2: the fuel <stays> in its tank)"
    told = {"arm": "planar2", "t": [0.0, 0.5], "turn": slosh.turn.tolist()}
    assert slosh.to_dict() == told | {"not_checked": "vapour"}
    assert_plain(slosh.describe().to_dict())

    print_description(slosh.describe(), deg=True)
    assert [line.rstrip() for line in capsys.readouterr().out.splitlines()] == [
        "planar2: the fuel <stays> in its tank",
        "a made-up result",
        "time [s]  turn of the fuel [°]",
        "0.00      10",
        "0.50      20",
        "",
        "Events",
        "event   time [s]",
        "splash  0.5",
        "Not checked: vapour.",
    ]
    print_json(slosh.to_dict())
    assert json.loads(capsys.readouterr().out) == slosh.to_dict()

    assert [head for head, *_ in cells(slosh)] == ["time [s]", "0.00", "0.50", "event", "splash"]
    html = slosh._repr_html_()
    assert "the fuel &lt;stays&gt; in its tank" in html
    section = ReportSection("Fuel")
    section.show(slosh.describe())
    assert "the fuel &lt;stays&gt; in its tank" in "".join(section.blocks)
    assert slosh.describe().tables[0].to_html() in "".join(section.blocks)


def test_the_first_events_are_shown():
    times = [(float(t),) for t in range(25)]
    (shown,) = Description(title="run", events=Table(("time",), times)).parts
    assert shown.title == "Events, the first 10 of 25"
    assert len(shown.rows) == 10
    (none,) = Description(title="run", events=Table(("time",), [])).parts
    assert none.title == "Events: none"


def test_names_of_any_length_are_shortened_where_people_read_them(tmp_path):
    long = "n" * 10**5 + "_" + "x" * 10**5
    text = sa.load("planar2").path.read_text()
    for name in ("joint_1", "joint_2", "link_1", "link_2", "spacecraft", "planar2"):
        text = text.replace(f'"{name}"', f'"{long}{name}"')
    (tmp_path / "long.urdf").write_text(text)
    arm = sa.load(tmp_path / "long.urdf")
    motion = sa.Motion(arm, [0.0, 1.0], [[0.3, 1.2], [0.3, 1.3]], np.tile(np.eye(7)[6], (2, 1)))
    for result in (arm, sa.singularity(arm.at([0.3, 1.2])), motion, sa.reaction(motion)):
        assert len(result._repr_html_()) < 50_000
        assert len(repr(result)) < 5_000
    assert max(map(len, short_names(arm.joint_names))) < 100
    assert arm.to_dict()["name"] == f"{long}planar2"
