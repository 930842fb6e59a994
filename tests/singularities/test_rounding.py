"""Error bars hold against 50-digit arithmetic, and are not vacuous."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from helpers import arms, precise
from helpers.arms import random_base
from ill_conditioned import CATALOGUE, FAMILIES, coaxial_rods, measured, out_and_back, samples

import spacearm as sa

pytestmark = pytest.mark.filterwarnings("ignore::spacearm.errors.ModelWarning")  # frames far out


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_the_error_is_within_the_bar(family):
    results = [measured(*sample) for sample in samples(family, 24)]
    for result in results:
        assert result.error <= result.bar
        assert result.share <= 1.0
    assert max(result.share for result in results) > 1e-3  # bars a thousand times shorter fail


@pytest.mark.slow
def test_bars_count_from_the_numbers_of_the_urdf():
    """Its roll, pitch and yaw are rounded too where they become rotation matrices."""
    for seed in range(12):
        text, rng = out_and_back(np.random.default_rng(seed)), np.random.default_rng(seed)
        arm = arms.load_text(text, tip="tip", task="position")
        cfg = arm.at(rng.uniform(-3, 3, arm.n))
        result = measured(cfg, tree=precise.as_written(arm.tree, text))
        assert result.error <= result.bar
        assert result.share <= 1.0


@pytest.mark.parametrize("kind", ["prismatic", "continuous"])
def test_what_a_joint_was_locked_at_is_in_the_bars(kind):
    """J* of the arm with a joint locked is that of the whole arm less a column."""
    rng, axis = np.random.default_rng(0), np.array([1.0, 2.0, 3.0])
    out = 1e6 * axis if kind == "prismatic" else np.zeros(3)  # slides back to the start
    whole = three_joints(rng, arms.joint("joint_2", "link_1", "link_2", kind, out, axis=axis))
    for q in rng.uniform(-3, 3, (4, 3)):
        q[1] -= 1e6 * np.linalg.norm(axis)
        exact = precise.generalized_jacobian(whole.at(q))
        cfg = whole.replace(locked={"joint_2": q[1]}).at(q[[0, 2]])
        errors = np.array(exact.tolist())[:, [0, 2]] - sa.generalized_jacobian(cfg)
        assert (np.abs(errors) <= sa.error_bars(cfg).jacobian).all()


@pytest.mark.parametrize("kind", ["prismatic", "continuous"])
def test_the_sum_that_a_mimic_joint_is_at_is_in_the_bars(kind):
    """A million times another, less a million: what is left has six digits less."""
    rng = np.random.default_rng(0)
    follows = '<mimic joint="joint_1" multiplier="1e6" offset="-1e6"/>'
    options = {"rpy": (1, 2, 3), "axis": (1, 2, 3), "inside": arms.LIMIT + follows}
    arm = three_joints(rng, arms.joint("joint_2", "link_1", "link_2", kind, **options))
    for q in rng.uniform(-3, 3, (4, 2)):
        q[0] = 1.0 + 1e-6 * q[0]
        assert measured(arm.at(q)).share <= 1.0


def three_joints(rng, second: str) -> sa.SpaceArm:
    links = [arms.random_link(rng, f"link_{i}") for i in range(4)]
    first = arms.random_joint(rng, "joint_1", "link_0", "link_1")
    third = arms.random_joint(rng, "joint_3", "link_2", "link_3")
    return arms.load_text(arms.robot(*links, first, second, third), tip="link_3", task="position")


@pytest.mark.slow
def test_inertias_that_turn_are_in_the_bars():
    """Of rods turned about their own axis next to nothing is left beside what is rounded."""
    for seed in range(80):
        rng = np.random.default_rng(seed)
        arm = coaxial_rods(rng)
        assert measured(arm.at(rng.uniform(-3, 3, arm.n))).share <= 1.0


LOADS = {
    "its momentum": {"mode": "attitude-controlled", "mass": 100.0},
    "its lever arm": {
        "carrier": "bus",
        "mass": 1.0,
        "place": 100.0,
        "bus": (1e4, 0.0, 1e4),
        "links": 1e4,
    },
    "the CM's lever arm": {"mass": 100.0, "place": 0.01, "bus": (100.0, 1e3, 5e7)},
    "the CM's lever arm, sliding": {"kind": "prismatic", "mass": 100.0, "bus": (1e4, 10.0, 1e10)},
    "the tip's lever arm, sliding": {"kind": "prismatic", "mass": 1e-6, "tip": "load"},
}


@pytest.mark.slow
@pytest.mark.parametrize("needed", LOADS)
def test_a_load_with_a_long_way_to_it_is_in_the_bars(needed):
    for seed in range(10):
        result = measured(*loaded(np.random.default_rng(seed), **LOADS[needed]))
        assert result.error <= result.bar
        assert result.share <= 1.0


def loaded(
    rng,
    mass,
    carrier="link_1",
    kind="continuous",
    place=0.1,
    bus=(10.0, 0.0, 0.1),
    links=0.1,
    mode="free-floating",
    tip="link_3",
):
    """An arm with a load at a place [m], by a frame 1e6 m away, on a bus of a mass, CM, inertia."""
    to_CM, to_load, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(3, 3)))
    out, rpy = rng.normal(size=3) * 1e6, rng.uniform(-3, 3, 3)
    back = pin.rpy.rpyToMatrix(rpy).T @ (place * to_load - out)
    elements = [
        arms.link("bus", bus[0], bus[1] * to_CM, bus[2] * np.eye(3)),
        *(arms.link(f"link_{i}", 0.1, inertia=links * np.eye(3)) for i in (1, 2, 3)),
        arms.link("load", mass, inertia=0.01 * np.eye(3)),
        arms.joint("joint_1", "bus", "link_1", kind, np.zeros(3), axis=axis),
        arms.random_joint(rng, "joint_2", "link_1", "link_2"),
        arms.random_joint(rng, "joint_3", "link_2", "link_3"),
        arms.frame("away"),
        arms.joint("out", carrier, "away", "fixed", out, rpy),
        arms.joint("back", "away", "load", "fixed", back),
    ]
    arm = arms.load_text(arms.robot(*elements), tip=tip, task="position", joints="all")
    return arm.at(rng.uniform(-3, 3, 3)), mode


@pytest.mark.parametrize("rpy", [(0, 0, 2.3), (2.3, 2.3, 2.3)])
def test_rotations_that_are_off_by_the_same_are_in_the_bars(rpy):
    """Three hundred fixed frames, each turned by rotations whose rounding errors add up."""
    frames = ["arm", *(f"frame_{i}" for i in range(300))]
    turned = {"kind": "fixed", "xyz": np.zeros(3), "rpy": rpy}
    elements = [arms.joint(f"to_{b}", a, b, **turned) for a, b in pairwise(frames)]
    hand = arms.joint("hand", frames[-1], "tip", "fixed", (1, 0, 0))
    links = [arms.frame(name) for name in (*frames[1:], "tip")]
    text = arms.robot(*arms.two_links(), *links, *elements, hand)
    arm = arms.load_text(text, tip="tip", task="position")
    result = measured(arm.at([0.3]), "fixed", precise.as_written(arm.tree, text))
    assert result.share <= 1.0


@pytest.mark.slow
def test_masses_that_sums_lose_are_in_the_bars():
    """A thousand pebbles on a spacecraft, each under half of its mass's last digit."""
    pebbles = [f"pebble_{i}" for i in range(1000)]
    fixed = {"kind": "fixed", "xyz": np.zeros(3)}
    arm = arms.load_text(
        arms.robot(
            arms.link("bus", 2e4),
            arms.link("arm", 2e4, com=(2, 0, 0)),
            arms.joint("elbow", "bus", "arm"),
            *(arms.link(name, 1.7e-12, inertia=1e-20 * np.eye(3)) for name in pebbles),
            *(arms.joint(f"on_{name}", "bus", name, **fixed) for name in pebbles),
        ),
        tip="arm",
        task="position",
    )
    assert measured(arm.at([0.3]), "attitude-controlled").share <= 1.0


@pytest.mark.parametrize("name", CATALOGUE)
def test_thirteen_digits_are_left_of_the_catalogue(name):
    arm = sa.load(name)
    for seed in range(10):
        cfg = arm.at(np.random.default_rng(seed).uniform(-3, 3, arm.n))
        sigma = sa.singularity(cfg).sigma
        assert sa.error_bars(cfg).sigma < 1e-12 * sigma[0]


def test_bars_show_the_digits_that_a_payload_takes():
    """sigma_min of 4e-10 with an error of 5e-9: the bar says that it may be zero."""
    arm = sa.load("planar3").replace(payload=1.6990e9)
    found = [measured(arm.at(q)) for q in np.random.default_rng(0).uniform(-3, 3, (8, 3))]
    assert max(result.error / result.sigma_min for result in found) > 0.1
    assert all(result.error <= result.bar for result in found)


def test_an_exact_zero_is_within_the_bar():
    for q in ((0.0, 0.0), (0.7, 0.0)):
        cfg = sa.load("planar2").at(q)
        exact = precise.singular_values(cfg, precise.generalized_jacobian(cfg, mode="fixed"))
        assert abs(exact[-1]) < 1e-45
        assert sa.singularity(cfg, mode="fixed").sigma_min <= sa.error_bars(cfg, mode="fixed").sigma


@pytest.mark.parametrize("name", CATALOGUE)
def test_bars_hold_at_every_attitude(name):
    """Also 1e-4 rad from the spacecraft upside down, where the task axes of a plane turn over."""
    arm = sa.load(name)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        q, w = rng.uniform(-3, 3, arm.n), np.append(rng.normal(size=2), 0.0)
        here = arm.at(q)
        exact = precise.singular_values(here, precise.generalized_jacobian(here))
        upside_down = pin.SE3(pin.exp3(w * (np.pi - 1e-4) / np.linalg.norm(w)), np.zeros(3))
        for base in (random_base(rng), upside_down):
            cfg = arm.at(q, base=base)
            errors = np.array([float(s) for s in exact]) - sa.singularity(cfg).sigma
            assert np.abs(errors).max() <= sa.error_bars(cfg).sigma


def test_bars_are_infinite_where_nothing_can_be_trusted():
    """An arm mounted 1e9 m from the spacecraft's frame: its inertia drowns in rounding."""
    far = pin.SE3(np.eye(3), np.array([1e9, 0.0, 0.0]))
    cfg = sa.load("mda6").replace(mount=far).at(np.full(6, 0.3))
    bars = sa.error_bars(cfg)
    assert np.isinf(bars.sigma)
    assert np.isinf(bars.jacobian).all()
    assert bars.jacobian.shape == (6, 6)
    assert np.isfinite(sa.error_bars(cfg, mode="fixed").sigma)


def test_bars_grow_without_limit_to_where_they_are_infinite():
    """Mounted further and further from the spacecraft's frame, up to where A_b is uncertain."""

    def bar(distance):
        far = pin.SE3(np.eye(3), np.array([distance, 0.0, 0.0]))
        return sa.error_bars(arm.replace(mount=far).at(np.full(6, 0.3))).sigma

    arm, finite, infinite = sa.load("mda6"), 1.0, 1e9
    for _ in range(40):
        middle = (finite + infinite) / 2.0
        finite, infinite = (finite, middle) if np.isinf(bar(middle)) else (middle, infinite)
    assert bar(finite) > 1e4 * bar(0.9 * finite)


def test_several_tips_have_the_bars_of_each():
    both = sa.load("dual_ur5", tip=("left", "right"), task="position")
    q = np.linspace(-1, 1, both.n)
    bars = sa.error_bars(both.at(q))
    assert bars.jacobian.shape == (12, both.n)
    for tip, rows in (("left", bars.jacobian[:6]), ("right", bars.jacobian[6:])):
        one = sa.error_bars(both.replace(tip=tip, joints="all").at(q))
        np.testing.assert_array_equal(rows, one.jacobian)
        assert bars.sigma >= one.sigma


def test_a_wrong_base_is_named():
    with pytest.raises(sa.ConfigurationError, match="free-floating"):
        sa.error_bars(sa.load("planar2").at([0.1, 0.2]), mode="free")
