"""Simulated seconds per second at every accuracy: spacearm beside MuJoCo and Drake.

    python benchmarks/simulation.py                # work-precision tables, then the 10,000 runs
    python benchmarks/simulation.py many           # 10,000 runs of 60 s of chaser7
    python benchmarks/simulation.py first          # the first run, with and without a cache

An arm swings for a minute under `JointPD` after a moving target of its joints, with gains that let
every joint settle critically damped at 0.5 rad/s, and under `TransposedJacobian` (42) to a point or
pose. Errors are those of the joint positions at the end, against rtol 1e-13. spacearm goes through
its tolerances, MuJoCo (RK4 and implicitfast) and Drake through their steps and accuracies. MuJoCo's
law is a Python callback; "law free" is the pace of its own steps in C without any law, at the steps
that the law took, which no law can beat.
Peers take part where they are installed (pip install mujoco drake).
"""

from __future__ import annotations

import importlib
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator

import numpy as np

import spacearm as sa

DURATION = 60.0
ROUNDS = 5
WARM = 4.0
"""For so long spacearm runs first, until its code is compiled for speed [s]."""
SLOW = 3.0
"""A run that takes longer ends the search [s]."""
WANTED = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
"""Errors that are compared at [rad]."""
STEPS = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
RTOLS = tuple(10.0**-k for k in range(2, 12))

Run = Callable[[], np.ndarray]
"""Simulates and returns the joint positions at the end of the duration."""


def joint_law(arm: sa.SpaceArm, q0: np.ndarray) -> sa.JointPD:
    H = np.diag(sa.generalized_inertia(arm.at(q0)))
    n = arm.n

    def target(t: float) -> np.ndarray:
        return 0.4 * np.sin(0.2 * t + np.arange(n))

    return sa.JointPD(target=target, kp=0.25 * H, kd=H)


def tip_law(arm: sa.SpaceArm, q0: np.ndarray) -> sa.TransposedJacobian:
    there = arm.at(q0 + 0.2).tip
    goal = there.translation[:2] if arm.task.k == 2 else there
    return sa.TransposedJacobian(target=goal, kp=5.0, kd=15.0)


def ours(arm: sa.SpaceArm, q0: np.ndarray, law: object) -> Iterator[tuple[str, Run]]:
    for rtol in RTOLS:
        yield (
            f"rtol {rtol:g}",
            lambda rtol=rtol: sa.simulate(
                arm.at(q0),
                law,
                DURATION,
                integration=sa.Integration(rtol=rtol, atol=1e-2 * rtol, dt=DURATION, events=()),
            ).q[-1],
        )


def mujoco_runs(
    arm: sa.SpaceArm, q0: np.ndarray, law: object, integrator: str, calls: bool
) -> Iterator[tuple[str, Run]]:
    mujoco = importlib.import_module("mujoco")
    options = '<mujoco><compiler fusestatic="false" balanceinertia="true"/></mujoco></robot>'
    spec = mujoco.MjSpec.from_string(arm.path.read_text().replace("</robot>", options))
    spec.worldbody.first_body().add_freejoint()
    spec.option.gravity[:] = 0.0
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT

    def push(_: object, data: object) -> None:
        dq = data.qvel[6:]
        if isinstance(law, sa.JointPD):
            data.qfrc_applied[6:] = law.kp * (law.target(data.time) - data.qpos[7:]) - law.kd * dq
        else:
            w, x, y, z = data.qpos[3:7]
            base = sa_pose(data.qpos[:3], (x, y, z, w))
            data.qfrc_applied[6:] = law(data.time, arm.at(data.qpos[7:], base=base), dq)

    def run(step: float) -> np.ndarray:
        spec.option.timestep = step
        model = spec.compile()
        data = mujoco.MjData(model)
        data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *q0]
        try:
            mujoco.set_mjcb_control(push if calls else None)
            mujoco.mj_step(model, data, round(DURATION / step))
        finally:
            mujoco.set_mjcb_control(None)
        return data.qpos[7:].copy()

    for step in STEPS:
        yield f"steps of {step:g} s", lambda step=step: run(step)


def sa_pose(p: np.ndarray, quaternion: tuple[float, ...]) -> object:
    pin = importlib.import_module("pinocchio")
    return pin.SE3(pin.Quaternion(np.array(quaternion)).normalized(), np.array(p))


def drake_runs(arm: sa.SpaceArm, q0: np.ndarray, law: object) -> Iterator[tuple[str, Run]]:
    drake = importlib.import_module("pydrake.all")

    class Law(drake.LeafSystem):  # type: ignore[misc, name-defined]
        def __init__(self, plant: object) -> None:
            super().__init__()
            self.plant, size = plant, plant.num_multibody_states()
            self.DeclareVectorInputPort("state", size)
            self.DeclareVectorOutputPort("force", plant.num_velocities(), self.force)

        def force(self, context: object, output: object) -> None:
            x, n = self.get_input_port().Eval(context), arm.n
            nq = self.plant.num_positions()
            q, dq = x[nq - n : nq], x[-n:]
            tau = law.kp * (law.target(context.get_time()) - q) - law.kd * dq
            output.SetFromVector(np.concatenate((np.zeros(6), tau)))

    def run(accuracy: float) -> np.ndarray:
        builder = drake.DiagramBuilder()
        plant = builder.AddSystem(drake.MultibodyPlant(0.0))
        drake.Parser(plant).AddModels(str(arm.path))
        plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
        plant.Finalize()
        control = builder.AddSystem(Law(plant))
        builder.Connect(plant.get_state_output_port(), control.get_input_port())
        builder.Connect(control.get_output_port(), plant.get_applied_generalized_force_input_port())
        simulator = drake.Simulator(builder.Build())
        drake.ResetIntegratorFromFlags(simulator, "runge_kutta3", 0.1)
        simulator.get_mutable_integrator().set_target_accuracy(accuracy)
        context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        q = plant.GetPositions(context)
        q[-arm.n :] = q0
        plant.SetPositions(context, q)
        simulator.AdvanceTo(DURATION)
        return plant.GetPositions(context)[-arm.n :].copy()

    if isinstance(law, sa.JointPD):
        for accuracy in RTOLS:
            yield f"accuracy {accuracy:g}", lambda accuracy=accuracy: run(accuracy)


def best(runs: Iterator[tuple[str, Run]], exact: np.ndarray) -> list[tuple[float, float]]:
    """Error and simulated seconds per second of each setting."""
    found = []
    for _, run in runs:
        try:
            off = float(np.abs(run() - exact).max())
        except (sa.SpaceArmError, RuntimeError, ValueError):
            continue  # unstable
        seconds = []
        for _ in range(ROUNDS if off < 1.0 else 1):
            start = time.perf_counter()
            run()
            seconds.append(time.perf_counter() - start)
            if sum(seconds) > 1.0:
                break
        found.append((off, DURATION / min(seconds)))
        if off < 0.3 * WANTED[-1] or seconds[0] > SLOW:
            break  # finer settings are slower, and no more accurate than is asked for
    return found


def pace_at(found: list[tuple[float, float]], wanted: float) -> float:
    """The fastest setting whose error is no larger; 0 if none is."""
    return max((pace for off, pace in found if off <= wanted), default=0.0)


def compare(name: str) -> None:
    arm = sa.load(name)
    q0 = np.full(arm.n, 0.3)
    for make in (joint_law, tip_law):
        law = make(arm, q0)
        exact = sa.simulate(
            arm.at(q0),
            law,
            DURATION,
            integration=sa.Integration(
                rtol=1e-13, atol=1e-15, dt=DURATION, events=(), method="DOP853"
            ),
        ).q[-1]

        begun = time.perf_counter()
        while time.perf_counter() - begun < WARM:
            for _, run in ours(arm, q0, law):
                run()

        def in_python(*state: object, law: object = law) -> np.ndarray:
            return law(*state)

        table = {"spacearm": best(ours(arm, q0, law), exact)}
        table["spacearm, law in Python"] = best(
            (run for k, run in enumerate(ours(arm, q0, in_python)) if k in (1, 4, 7)), exact
        )
        peers: dict[str, Callable[[], Iterator[tuple[str, Run]]]] = {
            "MuJoCo, RK4": lambda law=law: mujoco_runs(arm, q0, law, "RK4", True),
            "MuJoCo, implicitfast": lambda law=law: mujoco_runs(arm, q0, law, "IMPLICITFAST", True),
            "Drake, RK3": lambda law=law: drake_runs(arm, q0, law),
        }
        for label, peer in peers.items():
            try:
                table[label] = best(peer(), exact)
            except (ImportError, OSError) as missing:
                print(f"{name}: {label} left out: {missing}")
        if "MuJoCo, RK4" in table:
            for label, integrator in (("RK4", "RK4"), ("implicitfast", "IMPLICITFAST")):
                alone = best(mujoco_runs(arm, q0, law, integrator, False), exact)
                priced = zip(table[f"MuJoCo, {label}"], alone, strict=False)
                table[f"MuJoCo, {label}, law free"] = [
                    (off, pace) for (off, _), (_, pace) in priced
                ]
        print(f"\n{name}, {DURATION:g} s under {type(law).__name__}: simulated seconds a second")
        print(f"{'error up to [rad]':34}" + "".join(f"{wanted:>10.0e}" for wanted in WANTED))
        for label, found in table.items():
            paces = [pace_at(found, wanted) for wanted in WANTED]
            print(f"{label:34}" + "".join(f"{p:10.0f}" if p else f"{'-':>10}" for p in paces))
        own = [pace_at(table["spacearm"], w) for w in WANTED]
        for what, chosen in (
            ("spacearm over MuJoCo", [m for m in table if "MuJoCo" in m and "free" not in m]),
            ("spacearm over MuJoCo, law free", [m for m in table if "free" in m]),
        ):
            peer = [max((pace_at(table[m], w) for m in chosen), default=0.0) for w in WANTED]
            ratios = [x / y if y else math.inf for x, y in zip(own, peer, strict=True)]
            print(f"{what:34}" + "".join(f"{r:9.1f}x" for r in ratios), flush=True)


def many(runs: int = 10_000) -> None:
    arm, rng = sa.load("chaser7"), np.random.default_rng(0)
    q0 = np.full(7, 0.3)
    H = np.diag(sa.generalized_inertia(arm.at(q0)))
    law = sa.JointPD(target=[0.4, -0.2, 0.6, 0.1, 0.3, -0.3, 0.2], kp=0.25 * H, kd=H)
    Q0 = q0 + rng.normal(scale=0.05, size=(runs, 7))
    sa.simulate_many([arm.at(q) for q in Q0[:2]], law, DURATION)
    start = time.perf_counter()
    found = sa.simulate_many([arm.at(q) for q in Q0], law, DURATION)
    seconds = time.perf_counter() - start
    print(f"{runs:,} runs of {DURATION:g} s of chaser7 under JointPD: {seconds:.0f} s")
    print(f"  largest imbalance of energy {float(found.imbalance.max()):.1e}")


def first() -> None:
    """Simulate in a process that finds no compiled code, and in one that finds it."""
    run = (
        "import time; import spacearm as sa; arm = sa.load('planar2'); start = time.perf_counter();"
        "sa.simulate(arm.at([0.1, 0.4]), sa.JointPD(target=[0.1, 0.5], kp=1.0, kd=1.0), 0.1);"
        "print(f'{time.perf_counter() - start:.1f} s, of processor time with all imports '"
        "f'{time.process_time():.1f} s')"
    )
    with tempfile.TemporaryDirectory() as kept:
        for what in ("compiling", "compiled"):
            done = subprocess.run(
                [sys.executable, "-c", run],
                env=os.environ | {"SPACEARM_CACHE": kept},
                capture_output=True,
                text=True,
                check=True,
            )
            print(f"first run in a process, {what}: {done.stdout.strip()}", flush=True)


if __name__ == "__main__":
    if sys.argv[1:] == ["many"]:
        many()
    elif sys.argv[1:] == ["first"]:
        first()
    else:
        began = time.perf_counter()
        for model in sys.argv[1:] or ("planar2", "chaser7"):
            compare(model)
        if not sys.argv[1:]:
            many()
            print(f"all of this took {time.perf_counter() - began:.0f} s")
