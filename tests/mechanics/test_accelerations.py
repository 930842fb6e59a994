"""Forward dynamics of many states: against Pinocchio's articulated bodies and one at a time."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_chain, random_tree, same_accelerations, seeds
from helpers.wheels import WHEELS, with_wheels
from hypothesis import given, settings
from hypothesis import strategies as st

import spacearm as sa
from spacearm.mechanics.batch import BLOCK

MODES = ("free-floating", "attitude-controlled", "fixed")
FEW = 50
MANY = FEW + 14  # takes the compiled path, with lanes left over


def states(arm, m, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, 2, (m, arm.n)), *rng.normal(size=(2, m, arm.n)), rng.normal(size=(m, 6))


def tree(seed, n=5):
    return load_text(random_tree(seed, n), tip="link_1", task="x", joints="all")


@pytest.mark.slow
@settings(max_examples=15)
@given(seeds, st.integers(1, 8))
def test_those_of_the_full_system_by_aba(seed, n):
    """No reduced form and no momentum assumed: Pinocchio's articulated bodies, 6 + n of them."""
    arm = load_text(random_chain(seed, n, ("revolute", "prismatic")), tip="tip", task="x")
    Q, dQ, tau, twists = states(arm, MANY, seed)
    model, data = arm.model, arm.model.createData()
    momenta, wanted = np.zeros((MANY, 6)), np.zeros_like(Q)
    for i in range(MANY):
        cfg, v = arm.at(Q[i]), np.append(twists[i], dQ[i])
        momenta[i] = cfg.A @ v
        wanted[i] = pin.aba(model, data, cfg.full, v, np.append(np.zeros(6), tau[i]))[6:]
    found = sa.joint_accelerations(arm, Q, dQ, tau, momentum=momenta)
    for i in range(MANY):
        same_accelerations(arm.at(Q[i]), found[i], wanted[i], tau[i])


@pytest.mark.slow
@settings(max_examples=15)
@given(seeds, st.sampled_from(MODES))
def test_those_of_one_state_at_a_time(seed, mode):
    """Any tree, sliding and mimic joints; and what small batches compute without the compiler."""
    arm = tree(seed)
    Q, dQ, tau, h = states(arm, MANY, seed)
    found = sa.joint_accelerations(arm, Q, dQ, tau, mode=mode, momentum=h)
    few = sa.joint_accelerations(arm, Q[:3], dQ[:3], tau[:3], mode=mode, momentum=h[:3])
    for i in range(0, MANY, 9):
        one = sa.forward_dynamics(arm.at(Q[i], momentum=h[i]), dQ[i], tau[i], mode=mode).ddq
        same_accelerations(arm.at(Q[i]), found[i], one, tau[i], mode)
    for i in range(3):
        same_accelerations(arm.at(Q[i]), few[i], found[i], tau[i], mode)


@settings(max_examples=15)
@given(seeds, st.sampled_from(MODES))
def test_wheels_that_hold_momentum_and_wrenches(seed, mode):
    """Wheels on the spacecraft and on a link, wrenches on both; against one state at a time."""
    arm = load_text(with_wheels(seed), tip="tip", task="x", wheels=WHEELS)
    Q, dQ, tau, h = states(arm, MANY, seed)
    rng = np.random.default_rng(seed)
    wheels, pushed, pulled = (
        rng.normal(size=(MANY, 3)),
        rng.normal(size=6),
        rng.normal(size=h.shape),
    )

    def many(of):
        return sa.joint_accelerations(
            arm, Q[of], dQ[of], tau[of], mode=mode, momentum=h[of], wheels=wheels[of],
            wrenches={"bus": pushed, "link_2": pulled[of]},
        )  # fmt: skip

    found = many(slice(None))
    few = many(slice(3))
    for i in range(0, MANY, 9):
        cfg = arm.at(Q[i], wheels=wheels[i], momentum=h[i])
        one = sa.forward_dynamics(
            cfg, dQ[i], tau[i], mode=mode,
            wrenches={"bus": pushed, "link_2": pulled[i]},
        )  # fmt: skip
        same_accelerations(cfg, found[i], one.ddq, tau[i], mode)
    for i in range(3):
        same_accelerations(arm.at(Q[i]), few[i], found[i], tau[i], mode)


@pytest.mark.parametrize("name", ["mda6", "chaser7", "dual_ur5"])
def test_models_of_the_catalogue(name):
    arm = sa.load(name)
    if name == "dual_ur5":
        arm = arm.replace(tip=("left_tool0", "right_tool0"))
    Q, dQ, tau, h = states(arm, MANY)
    found = sa.joint_accelerations(arm, Q, dQ, tau, momentum=h[0])
    for i in range(0, MANY, 13):
        ddq = sa.forward_dynamics(arm.at(Q[i], momentum=h[0]), dQ[i], tau[i]).ddq
        same_accelerations(arm.at(Q[i]), found[i], ddq, tau[i])


def test_blocks_threads_and_memory_order():
    arm = sa.load("planar2")
    m = 2 * BLOCK + 7
    Q, dQ, tau, _ = states(arm, m)
    seen = []
    out = np.empty((m, 2))
    found = sa.joint_accelerations(
        arm, np.asfortranarray(Q), dQ, tau.astype(np.float32), out=out, threads=2,
        progress=lambda *x: seen.append(x),
    )  # fmt: skip
    assert found is out
    assert seen[-1] == (m, m)
    last = sa.joint_accelerations(arm, Q[-FEW:], dQ[-FEW:], tau[-FEW:].astype(np.float32))
    np.testing.assert_array_equal(found[-FEW:], last)


@pytest.mark.parametrize("m", [3, MANY])
def test_rows_without_numbers(m):
    arm = sa.load("planar2")
    Q, dQ, tau, _ = states(arm, m)
    Q[0, 0], dQ[1, 1], tau[2, 0] = np.nan, np.inf, -np.inf
    found = sa.joint_accelerations(arm, Q, dQ, tau)
    np.testing.assert_array_equal(np.isnan(found).any(axis=1), np.arange(m) < 3)
    assert sa.joint_accelerations(arm, [], [], []).shape == (0, 2)


@pytest.mark.parametrize("m", [3, MANY])
@pytest.mark.parametrize("izz", [("0.25", "-3"), ("6.667", "-30")], ids=["of a link", "of the bus"])
def test_states_whose_mass_matrix_is_not_positive_definite(m, izz):
    """A link's makes H* wrong, that of the spacecraft the locked inertia D."""
    text = sa.load("planar2").path.read_text(encoding="utf-8")
    text = text.replace(*(f'izz="{value}"' for value in izz))
    arm = load_text(text, tip="tip", task="x y", check="accept")
    still = np.full((m, 2), 0.3)
    assert np.isnan(sa.joint_accelerations(arm, still, still, still)).all()
    with pytest.raises(sa.NoSolutionError, match=r"at t = 0 s, .* is not positive definite"):
        sa.simulate(arm.at([0.3, 0.3]), sa.JointPD(target=[0.5, 0.5], kp=1, kd=1), 0.1)
    law = sa.JointPD(target=[0.5, 0.5], kp=1, kd=1)
    assert sa.simulate_many(arm.at([0.3, 0.3]), law, 0.1).ended.item() == "equations failed"


def test_large_angles_are_turns():
    arm = sa.load("planar2")
    Q, dQ, tau, _ = states(arm, MANY)
    turned = sa.joint_accelerations(arm, Q + 2e5 * np.pi, dQ, tau)
    wanted = sa.joint_accelerations(arm, Q, dQ, tau)
    size = np.abs(wanted).max(axis=1, keepdims=True) + 1.0
    np.testing.assert_allclose(turned / size, wanted / size, rtol=0, atol=1e-9)


def test_what_is_refused():
    arm, Q = sa.load("planar2"), np.zeros((3, 2))
    for changed, said in (
        ({"dQ": np.zeros((3, 3))}, "dQ has shape"),
        ({"tau": np.zeros((2, 2))}, "tau has 2 rows and Q 3"),
        ({"Q": ["a"]}, r"Q is \['a'\]; give numbers"),
        ({"momentum": np.zeros(3)}, "momentum has shape"),
        ({"momentum": "h"}, "momentum is 'h'; give numbers"),
        ({"wheels": [1.0]}, r"wheels has shape \(1,\), not \(0,\)"),
        ({"wrenches": {"arm": np.zeros(6)}}, "unknown link 'arm'"),
        ({"wrenches": {"tip": np.zeros(5)}}, "the wrench on 'tip' has shape"),
        ({"mode": "free"}, "mode 'free'"),
        ({"out": np.zeros((3, 3))}, "out is"),
    ):
        given = {"Q": Q, "dQ": Q, "tau": Q} | changed
        with pytest.raises(sa.ConfigurationError, match=said):
            sa.joint_accelerations(arm, **given)
