"""A plant and its controllers in the memory of the compiled integrator. Imports numba."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.kernels.dynamics import (
    context,
    laws,
    rate,
    tips,
)
from spacearm.kernels.dynamics import events as roots
from spacearm.kernels.dynamics.memory import Memory
from spacearm.kernels.dynamics.methods import chebyshev, radau, runge_kutta
from spacearm.mechanics.compiled import all_bodies, frame_on_body
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import free_components
from spacearm.model.scale import radians
from spacearm.motion.controllers import Controller, TipLaw
from spacearm.motion.plant import Plant
from spacearm.motion.runs.compiled_laws import Calls, put_law


def memory(
    plant: Plant,
    controllers: Mapping[int, Controller],
    outputs: Array,
    events: Sequence[Mapping[str, Any]],
) -> tuple[Memory, Calls]:
    """Return the memory of a run, and the functions outside that it calls.

    Args:
        plant: The plant.
        controllers: The controllers by the number of the tip that they lead; -1 for one that acts
            on all joints.
        outputs: (m,) times of the outputs [s].
        events: Fields of EVENT of each event that is looked for.
    """
    arm, n = plant.arm, plant.arm.n
    pushed = plant.pushed
    m = Memory(
        all_bodies(arm),
        n=n,
        tips=len(arm.tips),
        k=arm.task.k,
        wheels=len(arm.wheels),
        pushes=len(pushed),
        laws=len(controllers),
        size=max(n, 12),
        outputs=len(outputs),
        events=len(events),
    )
    x = m.context
    leads = any(isinstance(law, TipLaw) for law in controllers.values())
    wanted = ALWAYS | (AIM if leads else {})
    wanted |= (PUSHES if pushed else {}) | (WHEELS if arm.wheels else {})
    for name, entry in wanted.items():
        x[name] = entry.address
    x["f"], x["counted"], x["base"] = (
        free_components(plant.mode),
        2 * n + 5,
        plant.start.base.translation,
    )
    m["t_out"][:], m["offsets"][:] = outputs, arm.offsets
    m["radian"][:], m["tip"][:] = _of_arm(arm)
    m["rows"][:], m["scale"][:] = arm.task.indices, arm.task.scale[:, 0]
    for i, event in enumerate(events):
        for name, value in event.items():
            m["event"][i][name] = value
        m["event"][i]["entry"] = roots.VALUES[event["kind"]].address
    _put_joints(plant, m["joints"])
    _put_wheels(plant, m)
    outside = Calls(plant, len(m["seen"]))
    for i, (link, _, own) in enumerate(pushed):
        _put_frame(arm, m["pushed"][i], arm.model.getFrameId(link, pin.BODY))
        m["pushed"][i]["own"] = own
    if pushed:
        x["wrench"] = outside.outside(lambda t, _, out: plant.push(t, out), 6 * len(pushed))
    if plant.motors is not None:
        x["motor"] = outside.outside(lambda t, _, out: plant.spin(t, out), len(arm.wheels))
    for i, (tip, controller) in enumerate(controllers.items()):
        put_law(plant, m, i, tip, controller, outside)
    return m, outside


ALWAYS = {
    "settle": rate.settle,
    "rate": rate.rate,
    "bias": laws.bias,
    "torques": laws.torques,
    "look": roots.look,
    "explicit": runge_kutta.explicit_step,
    "polynomial": runge_kutta.explicit_polynomial,
}
"""The functions that compiled code calls by their addresses in a context."""
AIM = {"aim": tips.aim}
WHEELS = {"spin": rate.spin, "balance": rate.balance}
PUSHES = {"push": rate.push, "balance": rate.balance}
"""Those of laws that lead a tip, wheels and wrenches, compiled where they are wanted."""
RADAU = {"implicit_step": radau.implicit_step, "implicit_state": radau.implicit_state}
RKC = {**RADAU, "implicit_step": chebyshev.stabilised_step}  # the state is a cubic of both
"""Those of a method for stiff equations, likewise."""


def put_stiff(x: Any) -> None:
    """Put the functions of a method for stiff equations in a context."""
    for name, entry in (RKC if x["mild"] else RADAU).items():
        x[name] = entry.address


def put_state(plant: Plant, m: Memory, dq: Array, momentum: Array) -> None:
    """Put the state at the start in the memory of a run."""
    y, n, cfg = m["y"], plant.arm.n, plant.start
    m.context["coupled"] = _coupled(plant, m, momentum)
    y[:] = 0.0
    y[:n], y[n : 2 * n] = cfg.q, dq
    y[2 * n : 2 * n + 4] = pin.SE3ToXYZQUAT(cfg.base)[3:]
    y[2 * n + 4 : 2 * n + 7] = cfg.com
    y[2 * n + 7 : 2 * n + 13] = momentum
    y[2 * n + 17 :] = cfg.wheels


def _coupled(plant: Plant, m: Memory, momentum: Array) -> int:
    """Return how many leading components of the state its rate depends on.

    Without wrenches the momentum stays and the system CM moves evenly, whatever the arm does; the
    attitude counts where there is momentum, or a law that may look at it.
    """
    n = plant.arm.n
    if plant.arm.wheels:
        return len(m["y"])
    if plant.pushed:
        return 2 * n + 13
    joints_only = bool((m["law"]["kind"] == laws.JOINT_PD).all())
    if np.any(momentum[:3]):
        return 2 * n + 7
    return 2 * n if joints_only and not np.any(momentum) else 2 * n + 4


@lru_cache(maxsize=64)
def _of_arm(arm: SpaceArm) -> tuple[Array, npt.NDArray[np.void]]:
    """Return the motion of each joint that counts as a radian, and the tips."""
    tips = np.zeros(len(arm.tips), context.FRAME)
    for i, frame in enumerate(arm.tip_frames):
        _put_frame(arm, tips[i], frame)
    return radians(arm), tips


def _put_frame(arm: SpaceArm, record: Any, frame: int) -> None:
    on_body = frame_on_body(arm, frame)
    record["body"], record["p"], record["R"] = on_body


def _put_joints(plant: Plant, joints: Array) -> None:
    """Put springs, friction and limits in their rows."""
    arm = plant.arm
    joints[context.SLIP] = 1.0
    joints[[context.EFFORT, context.SPEED]] = np.inf
    if not plant.limits and not plant.passive:
        return
    for j, name in enumerate(arm.joint_names):
        joint = arm.tree.joints[name]
        if "effort" in plant.limits:
            joints[context.EFFORT, j] = joint.effort
        if "velocity" in plant.limits:
            joints[context.SPEED, j] = joint.velocity
        if passive := plant.passive.get(name, plant.passive.get(f"q{j + 1}")):
            joints[: context.EFFORT, j] = passive


def _put_wheels(plant: Plant, m: Memory) -> None:
    """Put the wheels and their law in the memory."""
    arm, x = plant.arm, m.context
    for i, wheel in enumerate(arm.wheels):
        on_body = frame_on_body(arm, wheel.frame)
        m["wheel"][i]["body"] = on_body.body
        m["wheel"][i]["axis"] = on_body.rotation @ wheel.axis
        m["wheel"][i]["torque"] = m["wheel"][i]["capacity"] = np.inf
    if plant.hold is None:
        return
    x["holds"], x["stiffness"], x["damping"] = 1, plant.hold.stiffness, plant.hold.damping
    x["level"] = plant.start.base.rotation
    m["wheel"]["torque"], m["wheel"]["capacity"] = plant.hold.torque, plant.hold.capacity
    on_bus = np.where(m["wheel"]["body"] == 0, 1.0, 0.0)[:, None]
    m["wheel"]["spread"] = np.linalg.pinv((m["wheel"]["axis"] * on_bus).T)
