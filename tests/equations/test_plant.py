"""The equations of motion beside Pinocchio's, and the laws beside the controllers in Python."""

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_base, random_tree, same_accelerations, seeds, trees
from helpers.wheels import WHEELS, with_wheels
from hypothesis import given, settings
from hypothesis import strategies as st

import spacearm as sa
from spacearm.compiler import numbers
from spacearm.equations import plant as equations
from spacearm.mechanics.arm_kernels import ArmKernel, parameters_of, structure_of
from spacearm.motion.plant import PassiveJoint
from spacearm.motion.system import System, WantedEvent, prepared

MODES = ("free-floating", "attitude-controlled", "fixed")


class Run:
    """A plant with a law in the state at its start, by NumPy and compiled."""

    def __init__(self, cfg, dq, momentum, mode, law, events=(), trace=True, **acts):
        start = replace(cfg, momentum=np.asarray(momentum, dtype=float))
        self.system = System(start, mode, sa.Plant(**acts), {-1: law}, dq)
        self.prepared = prepared(self.system, events, trace=trace)
        self.y = self.system.state

    def by_numpy(self, function, t=0.0):
        arm, known = self.system.arm, self.prepared
        calls = {
            name: lambda seen, f=f: np.concatenate(([0.0], np.ravel(f(seen[0], seen[1:]))))
            for name, f in known.outside.items()
        }
        tree, p = structure_of(arm, self.system.mode), parameters_of(arm)
        with np.errstate(all="ignore"):
            return function(numbers, tree, p, t, self.y, known.laws, known.plant,
                            setup=known.setup, **calls)  # fmt: skip

    def compiled(self, function, t=0.0):
        arm, known = self.system.arm, self.prepared
        kernel = ArmKernel(
            [arm], self.system.mode, function, {"setup": known.setup},
            outside=dict(known.setup.called(arm.n)),
        )  # fmt: skip

        def outside(f, count):
            def call(_, seen, out):
                size = 1 if not f.startswith(("law", "event")) else 1 + len(self.y)
                seen = np.ctypeslib.as_array(seen, (size,))
                out[0] = 0.0
                np.ctypeslib.as_array(out, (1 + count,))[1:] = known.outside[f](seen[0], seen[1:])

            return call

        calls = {name: outside(name, count) for name, count in known.setup.called(arm.n)}
        found = kernel(
            {"t": np.array([t]), "y": self.y[None]},
            {"laws": known.laws, "plant": known.plant}, outside=calls,
        )  # fmt: skip
        return [values[0] for values in found] if isinstance(found, tuple) else found[0]

    def rate(self, t=0.0):
        """The rate of the state, the same by NumPy and compiled."""
        found, known = (
            self.compiled(equations.state_rate, t),
            self.by_numpy(equations.state_rate, t),
        )
        size = np.abs(known).max(initial=1.0)
        np.testing.assert_allclose(found, known, rtol=1e-9, atol=1e-11 * size)
        return known

    def torques(self, t=0.0):
        known = self.by_numpy(equations.torques, t)
        found = self.compiled(equations.torques, t)
        size = np.abs(known).max(initial=1.0)
        np.testing.assert_allclose(found, known, rtol=1e-9, atol=1e-9 * size)
        return known


class Push:
    """A law that always gives the same torques, in Python."""

    def __init__(self, tau):
        self.tau = tau

    def __call__(self, *_):
        return self.tau


# --- equations ------------------------------------------------------------------------------


@given(trees(), seeds, st.sampled_from(MODES))
def test_accelerations_are_those_of_pinocchio(cfg, seed, mode):
    """Any tree, sliding and mimic joints, momentum, wrenches."""
    rng, n = np.random.default_rng(seed), cfg.arm.n
    dq, tau, h = rng.normal(size=n), rng.normal(size=n), rng.normal(size=6)
    h = np.zeros(6) if mode == "fixed" else h
    link = str(rng.choice(list(cfg.arm.tree.links)))
    wrench = {link: rng.normal(size=6)}
    run = Run(cfg, dq, h, mode, Push(tau), wrenches=wrench)
    f = run.by_numpy(equations.state_rate)
    known = sa.forward_dynamics(cfg.with_momentum(h), dq, tau, mode=mode, wrenches=wrench)
    same_accelerations(cfg, f[n : 2 * n], known.ddq, tau, mode)
    np.testing.assert_array_equal(f[:n], dq)


@settings(max_examples=5)
@given(seeds, st.sampled_from(MODES))
def test_compiled_rates_with_wheels_and_thrusters(seed, mode):
    """Wheels on the spacecraft and on a link, wrenches along link and inertial axes."""
    arm = load_text(with_wheels(seed), tip="tip", task="x", wheels=WHEELS)
    rng = np.random.default_rng(seed)
    cfg = arm.at(rng.uniform(-2, 2, 3), base=random_base(rng), wheels=rng.normal(size=3))
    dq, tau, h = rng.normal(size=3), rng.normal(size=3), rng.normal(size=6)
    h = np.zeros(6) if mode == "fixed" else h
    own, inertial = rng.normal(size=(2, 6))
    acts = {"wrenches": {"bus": inertial}, "thrusters": {"link_2": lambda _: own}}
    run = Run(cfg, dq, h, mode, Push(tau), **acts)
    f = run.rate()
    data = arm.model.createData()
    pin.framesForwardKinematics(arm.model, data, cfg.full)
    R = data.oMf[arm.model.getFrameId("link_2", pin.BODY)].rotation
    turned = np.concatenate((R @ own[:3], R @ own[3:]))
    wrenches = {"bus": inertial, "link_2": turned}
    known = sa.forward_dynamics(cfg.with_momentum(h), dq, tau, mode=mode, wrenches=wrenches)
    same_accelerations(cfg, f[3:6], known.ddq, tau, mode)


@given(trees(), seeds)
def test_accelerations_are_those_of_the_full_system_by_aba(cfg, seed):
    """No reduced form, no momentum assumed: Pinocchio's articulated bodies, 6 + n of them."""
    rng, arm = np.random.default_rng(seed), cfg.arm
    if arm.coupling is not None:
        return  # aba has no mimic joints
    dq, tau, v_b = rng.normal(size=arm.n), rng.normal(size=arm.n), rng.normal(size=6)
    v = np.concatenate((v_b, dq))
    model, data = arm.model, arm.model.createData()
    a = pin.aba(model, data, cfg.full, v, np.concatenate((np.zeros(6), tau)))
    f = Run(cfg, dq, cfg.A @ v, "free-floating", Push(tau)).by_numpy(equations.state_rate)
    same_accelerations(cfg, f[arm.n : 2 * arm.n], a[6:], tau)
    quaternion = pin.SE3ToXYZQUAT(cfg.base)[3:]
    turned = f[2 * arm.n : 2 * arm.n + 4]
    e, n = quaternion[:3], quaternion[3]
    w = v_b[3:]  # spacecraft axes
    np.testing.assert_allclose(turned[:3], 0.5 * (n * w + np.cross(e, w)), atol=1e-10)
    np.testing.assert_allclose(turned[3], -0.5 * e @ w, atol=1e-10)


def test_wheels_that_hold_momentum_turn_the_spacecraft():
    arm = sa.load("chaser7", wheels=["joint_7"])
    rng = np.random.default_rng(3)
    cfg = arm.at(rng.normal(size=6), base=random_base(rng), wheels=[2.5])
    dq, tau, h = rng.normal(size=6), rng.normal(size=6), rng.normal(size=6)
    f = Run(cfg, dq, h, "free-floating", Push(tau)).rate()
    known = sa.forward_dynamics(cfg.with_momentum(h), dq, tau)
    np.testing.assert_allclose(f[6:12], known.ddq, rtol=1e-10, atol=1e-10)


def test_angles_of_many_turns_are_the_same_angles():
    arm = sa.load("planar3")
    q, dq, tau = np.array([0.3, 0.4, -0.5]), np.array([0.1, 0.2, -0.3]), np.array([1.0, -1.0, 0.5])
    near = Run(arm.at(q), dq, np.zeros(6), "free-floating", Push(tau)).rate()
    far = q + 2.0 * np.pi * np.array([30_000, 0, -30_000])
    there = Run(arm.at(far), dq, np.zeros(6), "free-floating", Push(tau)).rate()
    np.testing.assert_allclose(there[3:6], near[3:6], atol=1e-9)


@pytest.mark.parametrize("name", ["chaser7", "planar3", "ets7"])
def test_light_wrists_far_from_the_system_cm_keep_their_digits(name):
    """Pinocchio's ABA sees each joint from its own body; moments about the CM lose digits."""
    arm, rng = sa.load(name), np.random.default_rng(5)
    model, data, n = arm.model, arm.model.createData(), arm.n
    for _ in range(20):
        cfg = arm.at(rng.uniform(-3, 3, n))
        dq, tau = rng.normal(size=n), rng.normal(size=n)
        v = np.concatenate((np.linalg.solve(cfg.A[:, :6], -cfg.A[:, 6:] @ dq), dq))
        a = pin.aba(model, data, cfg.full, v, np.concatenate((np.zeros(6), tau)))[6:]
        f = Run(cfg, dq, np.zeros(6), "free-floating", Push(tau)).by_numpy(equations.state_rate)
        np.testing.assert_allclose(f[n : 2 * n], a, atol=1e-13 * np.abs(a).max())


@given(trees(), seeds, st.sampled_from(MODES))
def test_power_is_the_rate_of_the_energy(cfg, seed, mode):
    """Springs, friction and a wrench: differences of what `observe` reports along the rate."""
    rng, n = np.random.default_rng(seed), cfg.arm.n
    dq, tau = rng.normal(size=n), rng.normal(size=n)
    h = np.zeros(6) if mode == "fixed" else rng.normal(size=6)
    passive = {cfg.arm.joint_names[0]: PassiveJoint(2.0, 0.3, 0.7, 0.2, 0.1)}
    link = str(rng.choice(list(cfg.arm.tree.links)))
    run = Run(cfg, dq, h, mode, Push(tau), passive=passive, wrenches={link: rng.normal(size=6)})
    rate, y, step = run.by_numpy(equations.state_rate), run.y, 1e-5
    seen = []
    for sign in (1.0, -1.0):
        run.y = y + sign * step * rate
        seen.append(run.by_numpy(equations.observe))
    power = (seen[0].energy - seen[1].energy) / (2.0 * step)
    force = (seen[0].momentum - seen[1].momentum) / (2.0 * step)
    works = rate[2 * n + 13 : 2 * n + 17]
    size = np.abs(works).max() + abs(power) + np.abs(dq).max() ** 3
    assert power == pytest.approx(works.sum(), abs=1e-5 * size)
    np.testing.assert_allclose(  # momentum changes by the wrench alone
        force[: {"fixed": 0, "attitude-controlled": 3}.get(mode, 6)],
        rate[2 * n + 7 : 2 * n + 13][: {"fixed": 0, "attitude-controlled": 3}.get(mode, 6)],
        atol=1e-5 * size,
    )


@pytest.mark.parametrize("mode", MODES)
def test_what_is_observed_is_what_mechanics_computes(mode):
    arm, rng = sa.load("mda6"), np.random.default_rng(2)
    cfg = arm.at(rng.uniform(-1, 1, 6), base=random_base(rng))
    dq = rng.normal(size=6)
    h = np.zeros(6) if mode == "fixed" else rng.normal(size=6)
    run = Run(cfg, dq, h, mode, Push(np.arange(6.0)))
    seen = run.by_numpy(equations.observe)
    for found, known in zip(run.compiled(equations.observe), seen, strict=True):
        np.testing.assert_allclose(found, known, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(seen.torque, np.arange(6.0), atol=1e-12)
    moved = sa.forward_dynamics(cfg.with_momentum(h), dq, np.arange(6.0), mode=mode)
    np.testing.assert_allclose(seen.ddq, moved.ddq, atol=1e-10 * np.abs(moved.ddq).max())
    np.testing.assert_allclose(seen.base[:3], cfg.base.translation, atol=1e-12)
    turned = pin.XYZQUATToSE3(seen.base).rotation
    np.testing.assert_allclose(turned, cfg.base.rotation, atol=1e-12)
    energy = sa.kinetic_energy(cfg.with_momentum(h), dq, mode=mode)
    assert seen.energy == pytest.approx(energy, rel=1e-11)
    np.testing.assert_allclose(seen.brought, cfg.A[:, 6:] @ dq, atol=1e-11)
    kept = {"free-floating": 6, "attitude-controlled": 3, "fixed": 0}[mode]
    np.testing.assert_allclose(seen.momentum[:kept], h[:kept], atol=1e-11)


# --- laws -----------------------------------------------------------------------------------


@pytest.mark.parametrize("law_mode", MODES)
@pytest.mark.parametrize(
    "name", ["planar3", "mda6", pytest.param("chaser7", marks=pytest.mark.slow)]
)
def test_the_laws_are_those_in_python(name, law_mode):
    rng = np.random.default_rng(1)
    for task in ("pose", "position") if name != "planar3" else ("x y rz", "x y"):
        arm = sa.load(name, task=sa.Task(task))
        base = random_base(rng)
        if name == "planar3":
            base = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.7])), np.array([0.3, -0.2, 0.0]))
        cfg = arm.at(rng.uniform(-1, 1, arm.n), base=base)
        dq = rng.normal(size=arm.n)
        goal = pin.SE3(pin.exp3(rng.normal(size=3) * 0.1), rng.normal(size=3) * 0.1) * cfg.tip
        if name == "planar3":
            goal = pin.SE3(pin.exp3(np.array([0, 0, 0.2])), np.array([0.1, 0.2, 0])) * cfg.tip
        laws = [
            sa.JointPD(target=rng.normal(size=arm.n), kp=3.0, kd=np.arange(1.0, arm.n + 1)),
            sa.JointPD(target=lambda t, n=arm.n: np.full(n, 0.3 + t), kp=3.0, kd=2.0),
            sa.TransposedJacobian(target=goal, kp=2.0, kd=5.0, mode=law_mode),
            sa.TransposedJacobian(
                target=lambda t, g=goal: pin.SE3(pin.exp3(np.array([0, 0, t])), np.full(3, t)) * g,
                kp=2.0, kd=5.0, mode=law_mode,
            ),
            sa.ResolvedRate(target=goal, gain=0.7, mode=law_mode, rest=np.full(arm.n, 0.2)),
            sa.DampedLeastSquares(target=goal, threshold=2.0, mode=law_mode),
            sa.Reactionless(target=goal, mode=law_mode),
        ]  # fmt: skip
        for law in laws:
            try:
                known = law(0.0, cfg, dq)
            except sa.UnsupportedError:
                continue  # no reactionless motion
            tau = Run(cfg, dq, rng.normal(size=6), "free-floating", law).torques()
            size = np.abs(known).max() + 1.0
            np.testing.assert_allclose(tau, known, atol=1e-9 * size, err_msg=f"{task} {law!r}")


def test_goal_axes_tilt_with_the_plane_of_a_planar_arm():
    arm, rng = sa.load("planar2"), np.random.default_rng(4)
    for _ in range(5):
        cfg = arm.at([0.4, 0.8], base=random_base(rng))
        law = sa.TransposedJacobian(target=(0.5, 0.2), kp=2.0, kd=1.0)
        known = law(0.0, cfg, np.array([0.1, -0.2]))
        run = Run(cfg, np.array([0.1, -0.2]), np.zeros(6), "free-floating", law)
        np.testing.assert_allclose(run.torques(), known, atol=1e-11)


# --- users' functions -----------------------------------------------------------------------


class Formula:
    """A law of plain array code."""

    def __init__(self, gain):
        self.gain = gain

    def __call__(self, t, cfg, dq):
        out = -self.gain * (cfg.q - 0.3 * np.sin(t)) - np.where(np.abs(dq) > 0.1, dq, 0.0)
        out = out + cfg.tip.translation[0] + np.clip(cfg.base.rotation[0, 1], -0.5, 0.5)
        J = sa.generalized_jacobian(cfg, mode="fixed")[:2]
        out = out + J.T @ (np.array([0.3, 0.2]) - cfg.tips[0].translation[:2])
        for j in range(2):
            J[0, j] = math.cos(t) * cfg.q[j]
        out = out + J[0]
        return out + sa.inverse_dynamics(cfg, dq, 0.1 * cfg.com[:2]).tau


class Counter:
    """A law that keeps something."""

    def __init__(self):
        self.calls = 0

    def __call__(self, _, cfg, __):
        self.calls += 1
        return -cfg.q


def test_users_laws_of_plain_array_code_are_traced():
    arm, rng = sa.load("planar2"), np.random.default_rng(0)
    cfg, dq = arm.at([0.3, 1.1], base=random_base(rng)), np.array([0.3, -0.05])
    law = Formula(2.0)
    run = Run(cfg, dq, np.zeros(6), "free-floating", law)
    assert not run.prepared.outside
    assert not run.prepared.notes
    np.testing.assert_allclose(run.torques(0.7), law(0.7, cfg, dq), rtol=1e-12, atol=1e-12)
    called = Run(cfg, dq, np.zeros(6), "free-floating", law, trace=False)
    assert list(called.prepared.outside) == ["law0"]
    np.testing.assert_allclose(called.torques(0.7), law(0.7, cfg, dq), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(called.rate(0.7), run.rate(0.7), rtol=1e-10, atol=1e-12)


def branching(t, cfg, dq):
    return -cfg.q if t > 1.0 else -dq


def by_mechanics(_, cfg, dq):
    return sa.base_velocity(cfg, dq)[:2]


def by_numbers(_, cfg, __):
    return [float(x) for x in -cfg.q]


def of_a_wrong_shape(_, cfg, __):
    return np.append(cfg.q, 0.0)


SEEN = np.zeros(1)


def into_an_array(t, cfg, _):
    seen = SEEN
    seen[0] = t
    return -cfg.q


def into_its_arguments(_, cfg, dq):
    dq[1] = cfg.q[1]
    return -cfg.q - dq


@pytest.mark.parametrize(
    ("law", "why"),
    [
        (Counter(), "it sets calls"),
        (branching, "not known while a function is traced"),
        (by_mechanics, "ConfigurationError"),
        (by_numbers, "has no value"),
        (of_a_wrong_shape, "has shape"),
        (into_an_array, "it changes what it is made of"),
    ],
)
def test_other_laws_are_called_and_the_run_says_why(law, why):
    arm = sa.load("planar2")
    known = prepared(System(arm.at([0.3, 1.1]), controllers={-1: law}))
    assert list(known.outside) == ["law0"]
    assert why in known.notes[0]
    assert known.notes[0].startswith("the controller")
    if isinstance(law, Counter):
        assert law.calls == 0


def test_a_law_may_write_into_its_arguments():
    """They are its own: the state stays what it is."""
    arm = sa.load("planar2")
    cfg, dq = arm.at([0.3, 1.1]), np.array([0.3, -0.05])
    run = Run(cfg, dq, np.zeros(6), "free-floating", into_its_arguments)
    assert not run.prepared.outside
    np.testing.assert_allclose(run.torques(), [-0.6, -2.2], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(run.rate()[:2], dq, rtol=1e-12, atol=1e-12)
    called = Run(cfg, dq, np.zeros(6), "free-floating", into_its_arguments, trace=False)
    np.testing.assert_allclose(called.rate(), run.rate(), rtol=1e-12, atol=1e-14)


def test_a_law_that_has_changed_is_another_one():
    arm = sa.load("planar2")
    law, start = Formula(2.0), arm.at([0.3, 1.1])

    def setup(law):
        return prepared(System(start, controllers={-1: law})).setup

    first, again = setup(law), setup(law)
    assert first == again
    assert hash(first) == hash(again)
    law.gain = 3.0
    assert setup(law) != first

    def made(gain):
        return lambda t, cfg, dq: gain * (np.sin(t) - cfg.q) - dq

    one, same, other = (setup(made(gain)) for gain in (1.0, 1.0, 2.0))
    assert one == same != other


def test_moving_targets_and_wrenches_are_traced():
    arm = sa.load("planar2")
    cfg = arm.at([0.3, 1.1])
    law = sa.JointPD(target=lambda t: 0.4 * np.sin(0.3 * t) * np.ones(2), kp=2.0, kd=1.0)
    wrench = {arm.tree.root: lambda t: [np.cos(t), 0.0, 0.0, 0.0, 0.0, 0.1 * t]}
    run = Run(cfg, np.zeros(2), np.zeros(6), "free-floating", law, wrenches=wrench)
    assert not run.prepared.outside
    called = Run(cfg, np.zeros(2), np.zeros(6), "free-floating", law, wrenches=wrench, trace=False)
    assert sorted(called.prepared.outside) == ["target0", "wrench0"]
    np.testing.assert_allclose(run.rate(1.3), called.rate(1.3), rtol=1e-12, atol=1e-13)


# --- events ---------------------------------------------------------------------------------


def test_event_functions():
    arm = sa.load("planar2")
    cfg = arm.at([0.3, 1.1])
    law = sa.JointPD(target=[0.5, 1.0], kp=2.0, kd=1.0)
    events = [
        WantedEvent(equations.Event("determinant")),
        WantedEvent(equations.Event("upper", 1), 1.5),
        WantedEvent(equations.Event("lower", 0), -1.0),
        WantedEvent(equations.Event("target", 0), 1e-3),
        WantedEvent(equations.Event("own"), 0.25, lambda t, cfg: t + cfg.q[1]),
    ]
    run = Run(cfg, np.zeros(2), np.zeros(6), "free-floating", law, events)
    found = run.by_numpy(equations.event_values, 0.2)
    J = sa.generalized_jacobian(cfg)[:2]
    det = np.linalg.det(J / np.linalg.norm(J, axis=1, keepdims=True))
    miss = np.hypot(0.2, 0.1) - 1e-3
    np.testing.assert_allclose(found, [det, 0.4, 1.3, miss, 1.05], atol=1e-13)
    np.testing.assert_allclose(run.compiled(equations.event_values, 0.2), found, atol=1e-13)


def test_tasks_with_more_rows_than_joints():
    """No right inverse: resolved rates are none, damped ones go on."""
    arm = load_text(random_tree(5, 5), tip="link_3", task=sa.Task("pose", length=1.0))
    cfg, dq = arm.at(np.full(arm.n, 0.3)), np.full(arm.n, 0.1)
    assert arm.n < 6
    goal = arm.at(np.zeros(arm.n)).tip
    law = sa.DampedLeastSquares(target=goal)
    found = Run(cfg, dq, np.zeros(6), "free-floating", law).torques()
    np.testing.assert_allclose(found, law(0.0, cfg, dq), rtol=1e-9, atol=1e-9)
    resolved = Run(cfg, dq, np.zeros(6), "free-floating", sa.ResolvedRate(target=goal))
    assert np.isnan(resolved.by_numpy(equations.torques)).all()
    assert np.isnan(resolved.compiled(equations.state_rate)[arm.n : 2 * arm.n]).all()
