"""Loading: tip, task, locked joints, branches, mimic joints, roots, replacing."""

import copy
import json
import pickle

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import (
    LIMIT,
    frame,
    joint,
    link,
    load_text,
    random_chain,
    random_configuration,
    random_tree,
    robot,
    seeds,
    two_links,
)
from hypothesis import given
from hypothesis import strategies as st

import spacearm as sa

BUS, ARM, ELBOW = two_links()
HAND = (link("hand"), joint("wrist", "arm", "hand"))


def test_tip_is_the_only_leaf_or_the_farthest():
    panel = (link("panel"), joint("wing", "bus", "panel"))
    assert load_text(robot(BUS, ARM, ELBOW)).tip == "arm"
    assert load_text(robot(BUS, ARM, ELBOW, *HAND, *panel)).tip == "hand"
    tool = (frame("tool"), joint("bolt", "hand", "tool", "fixed"))
    assert load_text(robot(BUS, ARM, ELBOW, *HAND, *panel, *tool)).tip == "tool"


def test_ambiguous_tip_lists_the_candidates():
    text = robot(BUS, ARM, ELBOW, link("left"), joint("elbow_2", "bus", "left"))
    with pytest.raises(sa.ModelError, match="2 links could be the tip: arm, left; choose one"):
        load_text(text)
    assert load_text(text, tip="left").tip == "left"


def test_unknown_names_list_the_valid_ones_nearest_first():
    text = robot(BUS, ARM, ELBOW, *HAND)
    with pytest.raises(sa.ConfigurationError, match=r"unknown link 'hnd'; valid.*: hand, "):
        load_text(text, tip="hnd")
    with pytest.raises(sa.ConfigurationError, match=r"'bus' is part of the spacecraft.*arm, hand"):
        load_text(text, tip="bus")
    with pytest.raises(sa.ConfigurationError, match=r"movable joint 'rist'.*: wrist, elbow"):
        load_text(text, locked={"rist": 0.0})
    with pytest.raises(sa.ConfigurationError, match="joint 'wrist' at nan"):
        load_text(text, locked={"wrist": np.nan})
    with pytest.raises(sa.ConfigurationError, match="unknown task row 'rw'"):
        load_text(text, task="x rw")
    with pytest.raises(
        sa.ModelError, match="unknown model 'planar'; valid, nearest first: planar2"
    ):
        sa.load("planar")


@pytest.mark.parametrize(
    ("n", "axis", "task"),
    [
        (2, (0, 0, 1), "x y"),
        (2, (0, -1, 0), "x z"),
        (3, (0, 0, 1), "x y rz"),
        (4, (1, 0, 0), "y z rx"),
    ],
)
def test_planar_arms_get_the_rows_of_their_plane(n, axis, task):
    elements, along = [BUS], np.roll(axis, 1)
    for i in range(n):
        parent = f"l{i - 1}" if i else "bus"
        elements += [link(f"l{i}", com=0.2 * along)]
        elements += [joint(f"j{i}", parent, f"l{i}", axis=axis, xyz=0.5 * along)]
    assert load_text(robot(*elements)).task.names == task


@pytest.mark.parametrize(
    ("n", "task"), [(3, "position"), (5, "position"), (6, "pose"), (8, "pose")]
)
def test_spatial_arms_get_position_or_pose(n, task):
    arm = load_text(random_chain(n, n), tip="tip")
    assert arm.task.names == task
    chain = [arm.tree.joints[name] for name in arm.joint_names][1:]
    chain.append(arm.tree.joints["tip_joint"])
    length = sum(np.linalg.norm(joint.origin.translation) for joint in chain)
    assert arm.task.length == (pytest.approx(length) if task == "pose" else None)


def test_task_can_be_overridden():
    arm = sa.load("planar2", task=sa.Task("x rz", length=2.0))
    assert (arm.task.rows, arm.task.length) == (("x", "rz"), 2.0)
    assert arm.replace(task="y").task.rows == ("y",)


def test_a_mixed_task_needs_a_length():
    text = robot(BUS, ARM, joint("elbow", "bus", "arm", axis=(0, 0, 1)))
    with pytest.raises(sa.ModelError, match=r"no length to scale.*Task\('pose', length="):
        load_text(text, task="pose")


@given(seeds, st.integers(2, 8))
def test_locking_is_welding(seed, n):
    text = random_tree(seed, n)
    free = load_text(text, tip=f"link_{n}", task="position", joints="all")
    cfg = random_configuration(free, seed)
    into = free.tree.joints[f"joint_{n}"]
    keep = {into.name, *([into.mimic.leader] if into.mimic else [])}
    locked = {name: q for name, q in zip(free.joint_names, cfg.q, strict=True) if name not in keep}
    welded = load_text(text, tip=f"link_{n}", task="position", joints="all", locked=locked)
    columns = [i for i, name in enumerate(free.joint_names) if name not in locked]
    assert welded.joint_names == tuple(free.joint_names[i] for i in columns)
    other = welded.at(cfg.q[columns], base=cfg.base)
    assert other.tip.isApprox(cfg.tip, 1e-10)
    assert np.allclose(other.com, cfg.com, atol=1e-11)
    J, K = sa.generalized_jacobian(cfg)[:, columns], sa.generalized_jacobian(other)
    assert np.abs(J - K).max() < 1e-10 * (1.0 + np.abs(J).max())


def test_locking_all_side_joints_is_the_arm_on_the_lumped_body():
    panel = link("panel", 3.0, (0.1, 1, 0), np.diag([2.0, 1.0, 2.5]))
    wing = {"xyz": (0, 0.4, 0), "rpy": (0.1, 0.2, 0.3), "axis": (0, 1, 0)}
    side = robot(BUS, ARM, ELBOW, *HAND, panel, joint("wing", "bus", "panel", **wing))
    weld = robot(BUS, ARM, ELBOW, *HAND, panel, joint("wing", "bus", "panel", "fixed", **wing))
    locked, welded = load_text(side, locked={"wing": 0.0}), load_text(weld, tip="hand")
    q = [0.3, -1.0]
    assert np.array_equal(locked.at(q).A, welded.at(q).A)
    assert np.array_equal(locked.at(q).J, welded.at(q).J)


def test_mimic_joints_are_followed():
    text = robot(
        BUS, ARM, ELBOW, link("hand"), link("plate"),
        joint("wrist", "arm", "hand", inside='<mimic joint="elbow" multiplier="-2" offset="0.5"/>'),
        joint("last", "hand", "plate", inside='<mimic joint="wrist" multiplier="3"/>'),
    )  # fmt: skip
    with pytest.warns(sa.ModelWarning):
        arm = load_text(text)
    assert (arm.n, arm.joint_names) == (1, ("elbow",))
    angle = 0.2
    total = angle + (0.5 - 2 * angle) + 3 * (0.5 - 2 * angle)
    assert np.allclose(arm.at([angle]).tip.rotation, pin.utils.rotate("z", total))
    with pytest.warns(sa.ModelWarning), pytest.raises(sa.ModelError, match="no joint can move"):
        load_text(text, locked={"elbow": 0.0})


def test_massless_root_on_the_real_bus():
    text = robot(frame("world"), joint("weld", "world", "bus", "fixed", (1, 2, 3), (0.3, 0, 0)),
                 BUS, ARM, ELBOW)  # fmt: skip
    arm, plain = load_text(text), load_text(robot(BUS, ARM, ELBOW))
    weld = arm.tree.joints["weld"].origin
    cfg, other = arm.at([0.4]), plain.at([0.4], base=weld)
    assert np.allclose(cfg.com, other.com)
    assert np.allclose(sa.generalized_jacobian(cfg), sa.generalized_jacobian(other), atol=1e-14)


def test_all_joints_locked_is_an_error():
    with pytest.raises(sa.ModelError, match="no joint can move"):
        load_text(robot(BUS, ARM, ELBOW), locked={"elbow": 0.0})


def test_replace_gives_a_new_arm_and_leaves_the_old():
    arm = sa.load("planar2")
    mass, J = arm.mass, sa.generalized_jacobian(arm.at([0.3, 0.4]))
    heavy = arm.replace(base_mass=400.0)
    assert heavy.mass == pytest.approx(mass + 360.0)
    bus = arm.model.inertias[1]
    grown = heavy.model.inertias[1].inertia  # of a body of the same shape
    assert np.allclose(grown, 400.0 / bus.mass * bus.inertia, rtol=1e-12)
    dense = arm.replace(base_mass=400.0, base_inertia=bus.inertia)
    assert np.allclose(dense.model.inertias[1].inertia, bus.inertia, rtol=1e-12)
    stiff = arm.replace(base_inertia=10 * arm.model.inertias[1].inertia)
    assert np.allclose(stiff.model.inertias[1].inertia, 10 * arm.model.inertias[1].inertia)
    moved = arm.replace(mount=pin.SE3(np.eye(3), np.array([0.0, 0.2, 0.0])))
    assert np.allclose(moved.at([0, 0]).tip.translation, [2.0, 0.2, 0.0])
    assert arm.replace(tip="link_1").at([0]).tip.translation[0] == pytest.approx(0.5)
    assert arm.mass == mass
    assert np.array_equal(sa.generalized_jacobian(arm.at([0.3, 0.4])), J)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"base_mass": 0.0}, "base_mass is 0 kg; give a positive"),
        ({"base_mass": np.nan}, "base_mass is nan kg"),
        ({"base_inertia": np.diag([1.0, 1.0, 3.0])}, "triangle inequality"),
        ({"base_inertia": [1, 2, 3]}, r"symmetric \(3, 3\) matrix"),
        ({"base_inertia": [[1, 1, 0], [0, 1, 0], [0, 0, 1]]}, r"symmetric \(3, 3\) matrix"),
    ],
)
def test_replace_refuses_impossible_spacecraft(change, message):
    with pytest.raises(sa.ModelError, match=message):
        sa.load("planar2").replace(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mount": np.eye(3)}, "mount is a ndarray; give a pose: sa.pose"),
        ({"mount": pin.SE3(2 * np.eye(3), np.zeros(3))}, "mount.rotation is not a rotation"),
        ({"mount": pin.SE3(np.eye(3), np.full(3, np.nan))}, "mount holds NaN"),
        ({"task": 3}, "task is 3; give a text or sa.Task"),
        ({"task": ""}, "must name at least one row"),
        ({"task": sa.Task("x y", None), "tip": ""}, "unknown link ''"),
    ],
)
def test_replace_refuses_what_is_no_mount_task_or_tip(change, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.load("planar2").replace(**change)


@pytest.mark.parametrize(
    ("locked", "message"),
    [
        ({"joint_1": "a"}, "locked is .*; give a mapping {name: a number}"),
        (["joint_1"], r"locked is \['joint_1'\]; give a mapping"),
    ],
)
def test_locked_is_checked(locked, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        sa.load("planar2", locked=locked)


def test_locking_a_follower_names_its_leader():
    inside = f'{LIMIT}<mimic joint="elbow"/>'
    text = robot(BUS, ARM, ELBOW, link("hand"), joint("wrist", "arm", "hand", inside=inside))
    with pytest.raises(sa.ConfigurationError, match="'wrist' mimics 'elbow'; lock that one"):
        load_text(text, locked={"wrist": 0.0})


def test_another_tip_gets_a_task_and_a_length_of_its_own():
    arm = sa.load("mda6")
    assert sa.load("mda6", tip="link_3").task.names == "position"
    assert arm.replace(tip="link_3").task.names == "position"
    asked = sa.load("mda6", task="pose")
    inner = asked.replace(tip="link_3").task
    assert inner == sa.load("mda6", tip="link_3", task="pose").task
    assert inner.length < asked.task.length
    assert arm.replace(base_mass=900.0).task == arm.task


@pytest.mark.parametrize(
    ("model", "change"),
    [
        ("mda6", {"locked": {"joint_6": 0.0}}),
        ("planar3", {"locked": {"joint_3": 0.3}}),
        ("mda6", {"wheels": ["joint_6"]}),
    ],
)
def test_replace_chooses_a_task_as_load_does(model, change):
    arm = sa.load(model)
    assert arm.replace(**change).task == sa.load(model, **change).task != arm.task
    assert arm.replace(base_mass=900.0).replace(**change).task == sa.load(model, **change).task
    assert arm.grasp(3.0).replace(**change).task == sa.load(model, **change).task
    asked = sa.load(model, task="x y")
    assert asked.replace(**change).task.names == "x y"


def test_an_arm_turned_over_works_in_another_plane():
    upright = pin.SE3(pin.utils.rotate("x", np.pi / 2), np.array([0.5, 0.0, 0.0]))
    assert sa.load("planar2").replace(mount=upright).task.names == "x z"


def test_units_of_singular_values():
    assert sa.load("planar2").sigma_unit == "m/rad"
    assert sa.load("mda6").sigma_unit == "1/rad"
    assert sa.load("mda6", task="orientation").sigma_unit == "rad/rad"
    sliding = load_text(robot(*two_links(kind="prismatic")), task="z")
    assert sliding.sigma_unit == "m/m"
    both = load_text(robot(BUS, ARM, ELBOW, link("h"), joint("w", "arm", "h", "prismatic")))
    assert both.sigma_unit == "m/(rad or m)"


def test_results_are_read_only_and_turn_into_plain_data():
    cfg = sa.load("planar2").at([0.1, 0.2])
    report, b = sa.singularity(cfg), sa.barycentric(cfg)
    for array in (report.sigma, report.lost, b.D, b.virtual_manipulator.links):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        sa.momentum_matrix(cfg).A_b[0] = 0.0
    for result in (report, b, b.virtual_manipulator, sa.momentum_matrix(cfg), sa.catalogue()[0]):
        json.dumps(result.to_dict())
        assert "object at 0x" not in repr(result)
    cfg.base.translation = np.ones(3)
    cfg.tip.translation = np.ones(3)
    assert not cfg.base.translation.any()


def test_arms_and_configurations_travel_between_processes():
    arm = sa.load("mda6")
    arm.at(np.zeros(6))
    for twin in (pickle.loads(pickle.dumps(arm)), copy.deepcopy(arm)):
        q = np.linspace(-1, 1, 6)
        assert np.array_equal(
            sa.generalized_jacobian(twin.at(q)), sa.generalized_jacobian(arm.at(q))
        )
    assert "6 joints" in repr(arm)


def test_an_arm_never_changes():
    arm = sa.load("planar2")
    with pytest.raises(AttributeError):
        arm.tip = "link_1"
    with pytest.raises(ValueError, match="read-only"):
        arm.lower[0] = 0.0


def test_an_arm_is_plain_data():
    rotor = (link("rotor"), joint("spin", "bus", "rotor"))
    with pytest.warns(sa.ModelWarning, match="no limits on elbow"):
        arm = load_text(
            robot(*two_links(inside=""), *HAND, *rotor), tip="hand", task="pose", wheels=["spin"]
        )
    data = json.loads(json.dumps(arm.to_dict(), allow_nan=False))
    assert (data["name"], data["n"], data["mass"], data["tip_link"]) == ("r", 2, 53.0, "hand")
    assert data["task"] == {"rows": list(arm.task.rows), "length": arm.task.length, "tips": 1}
    assert [body["link"] for body in data["bodies"]] == ["bus + rotor", "arm", "hand"]
    assert sum(body["mass"] for body in data["bodies"]) == arm.mass
    elbow, wrist = data["joint_data"]
    assert (elbow["lower"], elbow["effort"], elbow["mimic"]) == (None, None, None)
    assert (wrist["lower"], wrist["upper"], wrist["parent"]) == (-3, 3, "arm")
    assert data["wheel_data"] == [
        {"name": "spin", "frame": arm.wheels[0].frame, "axis": [0, 0, 1]}
        | {"torque": 10.0, "capacity": 1.0}
    ]
    assert data["cm_at_zero"] == arm.at([0, 0]).com.tolist()
    assert sa.load("dual_ur5", tip=("left", "right")).to_dict()["tip_link"] == ["left", "right"]


def test_lengths_that_are_described_are_those_that_replace_takes():
    arm = sa.load("planar2")
    longer = arm.replace(link_length={"link_1": 1.7}).describe().tables[1]
    assert [row[-1] for row in longer.rows] == [None, pytest.approx(1.7), pytest.approx(1.0)]
