"""Simulated seconds per second: spacearm beside SPART's equations (spartpy) and MuJoCo.

    python benchmarks/simulation.py

An arm swings after a moving joint target by the law of `JointPD`, with gains that let every joint
settle at 0.5 rad/s, critically damped for the inertia that it feels at the start. spartpy's
right-hand side goes through the same integrator with the same tolerances; MuJoCo takes Runge-Kutta
steps that lose no more than that. Peers take part where they are installed (pip
install spartpy intel-openmp mujoco).
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

import spacearm as sa

DURATION = 60.0
RTOL, ATOL = 1e-8, 1e-10
ROUNDS = 5
STEPS = {"planar2": 0.1, "chaser7": 0.01}
"""Steps of MuJoCo [s]."""

Run = Callable[[], np.ndarray]
"""Simulates and returns the joint positions at the end of the duration."""


def spart(arm: sa.SpaceArm, q0: np.ndarray, law: sa.JointPD) -> Run:
    model = importlib.import_module("SPARTpy").SPART(str(arm.path))
    n, still = arm.n, np.zeros(6)
    kp, kd = np.asarray(law.kp), np.asarray(law.kd)
    origin = np.zeros(3)
    _, y0, _ = model.space_robot_ode_input(0.0, np.eye(3), origin, still, q0, 0 * q0, still, 0 * q0)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        q, dq = y[18 : 18 + n], y[18 + n :]
        tau = np.concatenate((still, kp * (law.target(t) - q) - kd * dq))
        return np.ravel(model.space_robot_ode(t, y, tau))

    def run() -> np.ndarray:
        end = solve_ivp(rate, (0, DURATION), y0, method="LSODA", rtol=RTOL, atol=ATOL)
        return end.y[18 : 18 + n, -1]

    return run


def mujoco_steps(arm: sa.SpaceArm, q0: np.ndarray, law: sa.JointPD) -> Run:
    mujoco = importlib.import_module("mujoco")
    options = '<mujoco><compiler fusestatic="false" balanceinertia="true"/></mujoco></robot>'
    spec = mujoco.MjSpec.from_string(arm.path.read_text().replace("</robot>", options))
    spec.worldbody.first_body().add_freejoint()
    spec.option.gravity[:] = 0.0
    spec.option.timestep = STEPS[arm.name]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model = spec.compile()
    kp, kd = np.asarray(law.kp), np.asarray(law.kd)

    def push(_: object, data: object) -> None:
        data.qfrc_applied[6:] = kp * (law.target(data.time) - data.qpos[7:]) - kd * data.qvel[6:]

    def run() -> np.ndarray:
        data = mujoco.MjData(model)
        data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *q0]
        mujoco.set_mjcb_control(push)
        for _ in range(round(DURATION / STEPS[arm.name])):
            mujoco.mj_step(model, data)
        mujoco.set_mjcb_control(None)
        return data.qpos[7:].copy()

    return run


def compare(name: str) -> None:
    arm = sa.load(name)
    q0 = np.full(arm.n, 0.3)
    H = np.diag(sa.generalized_inertia(arm.at(q0)))
    phase = np.arange(arm.n)
    law = sa.JointPD(target=lambda t: 0.4 * np.sin(0.2 * t + phase), kp=0.25 * H, kd=H)
    runs: dict[str, Run] = {
        "spacearm.simulate": lambda: sa.simulate(
            arm, q0, law, DURATION, rtol=RTOL, atol=ATOL, dt=0.2
        ).q[-1]
    }
    for label, peer in (
        ("SPART's equations, spartpy, LSODA", spart),
        (f"MuJoCo, RK4 steps of {STEPS[name]:g} s", mujoco_steps),
    ):
        try:
            runs[label] = peer(arm, q0, law)
        except (ImportError, OSError, RuntimeError, ValueError) as missing:
            print(f"{name}: {label} left out: {missing}")
    exact = sa.simulate(
        arm, q0, law, DURATION, rtol=1e-12, atol=1e-14, dt=DURATION, method="DOP853", events=()
    ).q[-1]
    ours = 0.0
    print(f"\n{name}, {DURATION:g} s under JointPD, rtol {RTOL:g}")
    print(f"{'':38}{'simulated s per s':>18}{'spacearm is':>14}{'error [rad]':>14}")
    for label, run in runs.items():
        off = np.abs(run() - exact).max()
        seconds = []
        for _ in range(ROUNDS):
            start = time.perf_counter()
            run()
            seconds.append(time.perf_counter() - start)
        pace = DURATION / min(seconds)
        ours = ours or pace
        print(f"{label:38}{pace:18.0f}{ours / pace:13.2f}x{off:14.1e}")


if __name__ == "__main__":
    for model in ("planar2", "chaser7"):
        compare(model)
