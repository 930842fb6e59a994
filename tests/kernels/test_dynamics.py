"""The compiled equations of motion beside Pinocchio's, laws beside Python's, integrators."""

import numba
import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_base, random_tree, seeds, trees
from hypothesis import given, settings
from hypothesis import strategies as st

import spacearm as sa
from spacearm.kernels.dynamics import advance, calls, events
from spacearm.kernels.dynamics.decomposition import decompose, determinant
from spacearm.mechanics.nearness import distance_at
from spacearm.motion.events import clear_of_singularities
from spacearm.motion.plant import Plant
from spacearm.motion.runs.compiled import memory, put_state
from spacearm.motion.runs.run import Run

FEW = settings(max_examples=25)
MODES = ("free-floating", "attitude-controlled", "fixed")


def rate_of(cfg, dq, momentum, mode, law, **acts):
    """The rate of the state, from compiled code, and the torques of the law."""
    plant = Plant(cfg.arm, mode, cfg, **acts)
    m, outside = memory(plant, {-1: law}, np.zeros(1), [])
    put_state(plant, m, dq, np.asarray(momentum, dtype=float))
    assert advance.sample(m.here) == 0
    tau = m["tau"].copy()
    assert advance.resume(m.here) == advance.GOES_ON
    assert outside.error is None
    return m["f_y"].copy(), tau


class Push:
    """A law that always gives the same torques, in Python."""

    def __init__(self, tau):
        self.tau = tau

    def __call__(self, *_):
        return self.tau


# --- equations ------------------------------------------------------------------------------


@FEW
@given(trees(), seeds, st.sampled_from(MODES))
def test_accelerations_are_those_of_pinocchio(cfg, seed, mode):
    """Any tree, sliding and mimic joints, momentum, wrenches."""
    rng, n = np.random.default_rng(seed), cfg.arm.n
    dq, tau, h = rng.normal(size=n), rng.normal(size=n), rng.normal(size=6)
    h = np.zeros(6) if mode == "fixed" else h
    link = str(rng.choice(list(cfg.arm.tree.links)))
    wrench = {link: rng.normal(size=6)}
    f, _ = rate_of(cfg, dq, h, mode, Push(tau), wrenches=wrench)
    known = sa.forward_dynamics(cfg, dq, tau, mode=mode, momentum=h, wrenches=wrench)
    size = np.abs(known.ddq).max() + 1.0
    np.testing.assert_allclose(f[n : 2 * n], known.ddq, atol=1e-10 * size)
    np.testing.assert_array_equal(f[:n], dq)


@FEW
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
    f, _ = rate_of(cfg, dq, cfg.A @ v, "free-floating", Push(tau))
    np.testing.assert_allclose(f[arm.n : 2 * arm.n], a[6:], atol=1e-10 * (np.abs(a).max() + 1.0))
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
    f, _ = rate_of(cfg, dq, h, "free-floating", Push(tau))
    known = sa.forward_dynamics(cfg, dq, tau, momentum=h)
    np.testing.assert_allclose(f[6:12], known.ddq, rtol=1e-10, atol=1e-10)


def test_angles_of_many_turns_are_the_same_angles():
    arm = sa.load("planar3")
    q, dq, tau = np.array([0.3, 0.4, -0.5]), np.array([0.1, 0.2, -0.3]), np.array([1.0, -1.0, 0.5])
    near, _ = rate_of(arm.at(q), dq, np.zeros(6), "free-floating", Push(tau))
    far = q + 2.0 * np.pi * np.array([30_000, 0, -30_000])
    there, _ = rate_of(arm.at(far), dq, np.zeros(6), "free-floating", Push(tau))
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
        f, _ = rate_of(cfg, dq, np.zeros(6), "free-floating", Push(tau))
        np.testing.assert_allclose(f[n : 2 * n], a, atol=1e-13 * np.abs(a).max())


@FEW
@given(trees(), st.sampled_from(MODES))
def test_the_distance_to_the_singular_set_is_that_of_the_report(cfg, mode):
    """Central differences of J* beside its exact derivatives; any tree, task and mode."""
    arm = cfg.arm
    m, _ = memory(Plant(arm, mode, cfg), {-1: Push(np.zeros(arm.n))}, np.zeros(1),
                  [{"kind": events.SINGULAR, "falling": True, "stops": False}])  # fmt: skip
    put_state(Plant(arm, mode, cfg), m, np.zeros(arm.n), np.zeros(6))
    m.context["end"], m.context["rtol"], m.context["atol"] = 1.0, 1e-6, 1e-8
    advance.initiate(m.here)
    known = min(distance_at(cfg, mode), 1.0)
    assert m["event"]["last"][0] == pytest.approx(known, rel=1e-6, abs=1e-9)


# --- laws -----------------------------------------------------------------------------------


@pytest.mark.parametrize("law_mode", MODES)
@pytest.mark.parametrize("name", ["planar3", "mda6", "chaser7"])
def test_the_compiled_laws_are_those_in_python(name, law_mode):
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
            _, tau = rate_of(cfg, dq, rng.normal(size=6), "free-floating", law)
            size = np.abs(known).max() + 1.0
            np.testing.assert_allclose(tau, known, atol=1e-9 * size, err_msg=f"{task} {law!r}")


# --- linear algebra -------------------------------------------------------------------------


@FEW
@given(seeds, st.integers(1, 6), st.integers(1, 8))
def test_decompositions_are_those_of_lapack(seed, k, m):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(k, m)) * 10.0 ** rng.uniform(-6, 6, (k, 1))
    W, U, sigma = A.copy(), np.zeros((k, k)), np.zeros(k)
    decomposed(W, U, sigma)
    known = np.linalg.svd(A, compute_uv=False)
    np.testing.assert_allclose(sigma[: min(k, m)], known, atol=1e-13 * known[0])
    np.testing.assert_allclose(U @ W, A, atol=1e-13 * known[0])
    np.testing.assert_allclose(U.T @ U, np.eye(k), atol=1e-13)
    if k == m:
        lengths = np.linalg.norm(A, axis=1)
        det = determined(A.copy())
        assert det == pytest.approx(np.linalg.det(A / lengths[:, None]), abs=1e-12)


@numba.njit
def decomposed(W, U, sigma):
    decompose(W, U, sigma)


@numba.njit
def determined(A):
    return determinant(A)


# --- integrators ----------------------------------------------------------------------------


def oscillator(q, kp):
    """One joint on a fixed spacecraft and a spring: q = q0 cos(w t)."""
    arm = sa.load("planar2", locked={"joint_2": 0.3})
    H = sa.generalized_inertia(arm.at([q]), mode="fixed")[0, 0]
    return arm, np.sqrt(kp / H)


def error_of_a_step(arm, q0, dq, law, h, method, mode="free-floating"):
    run = Run(Plant(arm, mode, arm.at(q0)), {-1: law}, np.zeros(0), h, (), (), 1.0)
    rtol = 1e-9 if method == "Radau" else 1e6
    run.begin(dq, np.zeros(6), rtol, 1e6, "auto" if method == "RKC" else method)
    run.x["implicit"] = method != "DOP853"
    advance.initiate(run.memory.here)
    run.x["step"] = h
    run.advance(float(h))
    assert run.steps == 1
    fine = {"rtol": 1e-13, "atol": 1e-15, "method": "DOP853", "dt": h, "events": ()}
    known = sa.simulate(arm, q0, law, h, dq0=dq, mode=mode, **fine)
    return np.abs(run.memory["y"][: arm.n] - known.q[-1]).max()


def test_the_order_of_dop853():
    """The error of one step falls by the order and one, over a range of steps."""
    arm, steps = sa.load("planar2"), np.geomspace(0.2, 0.8, 7)
    law, q0, dq = sa.JointPD([0.5, 0.2], kp=2.0, kd=0.1), np.array([0.3, 0.9]), [0.5, -0.8]
    errors = [error_of_a_step(arm, q0, np.array(dq), law, h, "DOP853") for h in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(9.0, abs=0.8)


@pytest.mark.slow
def test_the_order_of_rkc():
    arm, steps = sa.load("planar2"), np.geomspace(0.01, 0.1, 5)
    law, q0, dq = sa.JointPD([0.5, 0.2], kp=2.0, kd=0.1), np.array([0.3, 0.9]), [0.5, -0.8]
    errors = [error_of_a_step(arm, q0, np.array(dq), law, h, "RKC") for h in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(3.0, abs=0.3)


@pytest.mark.slow
def test_the_order_of_radau():
    """Of a linear equation, where Newton's iteration is exact."""
    arm, w = oscillator(0.5, 20.0)
    law, steps = sa.JointPD(target=[0.0], kp=20.0, kd=0.0), np.array([0.4, 0.2]) / w
    dq = np.array([0.3 * w])
    errors = [error_of_a_step(arm, [0.5], dq, law, h, "Radau", "fixed") for h in steps]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6.0, abs=0.5)


@pytest.mark.parametrize("method", ["auto", "DOP853", "Radau"])
def test_an_oscillator_keeps_its_closed_form(method):
    arm, w = oscillator(0.5, 20.0)
    law = sa.JointPD(target=[0.0], kp=20.0, kd=0.0)
    run = sa.simulate(arm, [0.5], law, 10.0, mode="fixed", method=method, rtol=1e-9, atol=1e-11)
    error = np.abs(run.q[:, 0] - 0.5 * np.cos(w * run.t)).max()
    assert error < (1e-7 if method != "Radau" else 1e-5)


def test_an_event_is_found_to_a_nanosecond():
    arm, w = oscillator(0.5, 20.0)
    law = sa.JointPD(target=[0.0], kp=20.0, kd=0.0)
    run = sa.simulate(
        arm, [0.5], law, 5.0, mode="fixed", events=["target"], stop=["target"], reach=0.1,
        rtol=1e-11, atol=1e-13,
    )  # fmt: skip
    assert run.events[0].t == pytest.approx(np.arccos(0.1 / 0.5) / w, abs=1e-9)
    assert run.t[-1] == run.events[0].t


@pytest.mark.slow
def test_a_stiff_run_goes_over_to_radau_and_a_soft_one_does_not():
    arm = sa.load("planar2")
    for kd, implicit in ((3e3, True), (2.0, False)):
        plant = Plant(arm, "free-floating", arm.at([0.1, 0.2]))
        law = sa.JointPD(target=[0.3, 0.1], kp=kd, kd=kd)
        run = Run(plant, {-1: law}, np.zeros(0), 20.0, (), (), 1e-3)
        run.begin(np.zeros(2), np.zeros(6), 1e-6, 1e-8, "auto")
        run.advance(20.0)
        assert run.ended == "duration"
        assert bool(run.x["implicit"]) == implicit
        np.testing.assert_allclose(run.memory["y"][:2], [0.3, 0.1], atol=1e-3)


def test_a_redundant_arm_meets_the_singular_set_when_its_distance_says_so():
    """Between looks at the distance, which costs many rates, nothing is missed."""
    arm, q0 = sa.load("planar3", task="x y"), np.array([0.2, 0.6, -0.4])
    beyond = q0 + 1.3 * (sa.singular_set(arm).nearest(q0)[0] - q0)

    def law(_, cfg, dq):
        return sa.inverse_dynamics(cfg, dq, beyond - cfg.q - 2.0 * dq).tau

    run = sa.simulate(arm, q0, law, 4.0, dt=0.05, rtol=1e-6, events=["singularity"])
    clear = np.array([clear_of_singularities(arm.at(q), "free-floating") for q in run.q])
    fell = int(np.argmax(clear < 0.0))
    assert [event.kind for event in run.events] == ["singularity"]
    assert run.t[fell - 1] <= run.events[0].t <= run.t[fell]
    there = clear_of_singularities(arm.at(run.events[0].q), "free-floating")
    assert there == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize(("kd", "mild"), [(30.0, True), (1e4, False)])
def test_a_loose_stiff_run_takes_rkc_unless_that_needs_many_stages(kd, mild):
    arm = sa.load("planar2")
    law = sa.JointPD(target=lambda t: [0.3 * np.sin(0.2 * t), 0.1], kp=kd, kd=kd)
    run = Run(Plant(arm, "free-floating", arm.at([0.1, 0.2])), {-1: law},
              np.arange(0.0, 40.0, 0.1), 40.0, (), (), 1e-3)  # fmt: skip
    run.begin(np.zeros(2), np.zeros(6), 1e-2, 1e-4, "auto")
    run.advance(40.0)
    assert run.ended == "duration"
    assert bool(run.x["implicit"])
    assert bool(run.x["mild"]) == mild
    known = sa.simulate(arm, [0.1, 0.2], law, 40.0, dt=0.1, events=(), method="Radau")
    found = run.trajectory()
    np.testing.assert_allclose(found.q[:-1], known.q[: len(found.t) - 1], atol=3e-3)
    np.testing.assert_allclose(found.momentum, 0.0, atol=1e-12)


@pytest.mark.parametrize("case", ["joints", "moving", "pose", "wrench"])
def test_the_implicit_steps_leave_out_only_columns_that_do_not_count(case):
    """The same end, whether all columns of the Jacobian are computed or those that count."""
    arm = sa.load("planar2")
    point = arm.at([0.5, 1.2]).tip.translation[:2]
    law = (
        sa.TransposedJacobian(target=point, kp=20.0, kd=50.0)
        if case == "pose"
        else sa.JointPD(target=[0.3, 0.1], kp=20.0, kd=50.0)
    )
    wrench = {arm.tree.root: np.array([0.1, 0.2, 0.0, 0.0, 0.0, 0.3])}
    acts = {"wrenches": wrench} if case == "wrench" else {}
    momentum = np.array([0.3, 0.1, 0.0, 0.0, 0.0, 0.5]) if case == "moving" else np.zeros(6)
    plant, ends, rates = Plant(arm, "free-floating", arm.at([0.3, 1.1]), **acts), [], []
    for whole in (False, True):
        run = Run(plant, {-1: law}, np.zeros(0), 5.0, (), (), 1e-3)
        run.begin(np.zeros(2), momentum, 1e-8, 1e-10, "Radau")
        if whole:
            run.x["coupled"] = len(run.memory["y"])
        run.advance(5.0)
        assert run.ended == "duration"
        ends.append(run.memory["y"].copy())
        rates.append(int(run.x["rates"]))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)
    assert rates[0] <= rates[1]


def test_functions_outside_are_called_by_address():
    def twice(_, x, out):
        out[:] = 2.0 * x

    kept = calls.outside(twice, 2, 2)
    x, out = np.array([1.0, 2.0]), np.zeros(2)
    assert kept(0.5, x.ctypes.data, out.ctypes.data) == 0
    np.testing.assert_array_equal(out, [2.0, 4.0])
    assert calls.address(kept) > 0
    assert calls.address(None) == 0


def test_a_random_tree_moves_as_scipy_integrates_it():
    """Our rate, another's integrator: scipy's DOP853."""
    from scipy.integrate import solve_ivp

    arm = load_text(random_tree(5, 5), tip="link_3", task=sa.Task("pose", length=1.0))
    q0, kp = np.linspace(-0.5, 0.5, arm.n), 3.0
    law = sa.JointPD(target=np.zeros(arm.n), kp=kp, kd=1.0)
    run = sa.simulate(arm, q0, law, 2.0, rtol=1e-10, atol=1e-12, events=())

    def rate(_, y):
        cfg, dq = arm.at(y[: arm.n]), y[arm.n :]
        return np.concatenate((dq, sa.forward_dynamics(cfg, dq, law(0.0, cfg, dq)).ddq))

    start = np.concatenate((q0, np.zeros(arm.n)))
    known = solve_ivp(rate, (0.0, 2.0), start, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(run.q[-1], known[: arm.n], atol=1e-8)
    np.testing.assert_allclose(run.dq[-1], known[arm.n :], atol=1e-8)
