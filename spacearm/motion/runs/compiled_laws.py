"""Controllers in the memory of the compiled integrator, and calls of those in Python."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, finite
from spacearm.errors import ConfigurationError
from spacearm.kernels.dynamics import calls, context, laws
from spacearm.kernels.dynamics.context import carray
from spacearm.kernels.dynamics.memory import Memory
from spacearm.model.joints import joint_vector
from spacearm.model.mode import free_components
from spacearm.motion.controllers import (
    Controller,
    DampedLeastSquares,
    JointPD,
    RateLaw,
    Reactionless,
    ResolvedRate,
    TipLaw,
    TransposedJacobian,
    gains,
)
from spacearm.motion.goal import goal_normal
from spacearm.motion.plant import Plant
from spacearm.singularities.report import NO_INVERSE

KINDS: dict[type, int] = {
    JointPD: laws.JOINT_PD,
    TransposedJacobian: laws.TRANSPOSED,
    ResolvedRate: laws.RESOLVED,
    DampedLeastSquares: laws.DAMPED,
    Reactionless: laws.REACTIONLESS,
}
"""The laws that are compiled; laws derived from them are called in Python."""


class Seen(NamedTuple):
    """What a controller compiled by numba sees of the configuration.

    Attributes:
        q: (n,) joint positions [rad] or [m].
        attitude: (3, 3) attitude of the spacecraft, inertial axes.
        tip: (3,) position of the tip [m].
        tip_attitude: (3, 3) attitude of the tip.
        jacobian: (6, n) generalized Jacobian, rows [linear; angular], inertial axes.
    """

    q: Array
    attitude: Array
    tip: Array
    tip_attitude: Array
    jacobian: Array


class Calls:
    """The functions outside that a run calls, and the error that the last call raised.

    After an error the integrator tries shorter steps, so that the run gets as near to it as it can;
    an interrupt ends the run at once.

    Args:
        plant: The plant.
        reads: Size of what they read.
    """

    def __init__(self, plant: Plant, reads: int) -> None:
        self.plant, self.reads = plant, reads
        self.kept: list[Any] = []
        self.error: BaseException | None = None

    def outside(self, function: Callable[[float, Array, Array], None], writes: int) -> int:
        """Return the address of a function (t, x, out) in Python, whose errors are kept."""

        def run(t: float, x: Array, out: Array) -> bool:
            if self.error is not None and not isinstance(self.error, Exception):
                return True
            self.error = None
            try:
                function(t, x, out)
            except BaseException as error:
                self.error = error
            return self.error is not None

        self.kept.append(calls.outside(run, self.reads, writes))
        return calls.address(self.kept[-1])

    def compiled(self, source: str, function: Any, **sizes: int) -> int:
        """Return the address of a function (t, x, out) that calls one of numba's."""
        self.kept.append(_compiled(source, function, tuple(sizes.items())))
        return calls.address(self.kept[-1])


@lru_cache(maxsize=64)
def _compiled(source: str, function: Any, sizes: tuple[tuple[str, int], ...]) -> Any:
    """Compile a function (t, x, out) that calls one of numba's."""
    scope: dict[str, Any] = {"carray": carray, "function": function, "Seen": Seen, **dict(sizes)}
    exec(textwrap.dedent(source), scope)
    return calls.compiled(scope["run"])


TARGET = """
    def run(t, x, out):
        goal = function(t)
        values = carray(out, (size,))
        for i in range(size):
            values[i] = goal[i]
        return 0
"""
CONTROLLER = """
    def run(t, x, out):
        seen = carray(x, (reads,))
        at = seen[states:]
        cfg = Seen(seen[:n], at[:9].reshape(3, 3), at[9:12], at[12:21].reshape(3, 3),
                   at[21 : 21 + 6 * n].reshape(6, n))
        tau = function(t, cfg, seen[n : 2 * n])
        values = carray(out, (n,))
        for i in range(n):
            values[i] = tau[i]
            if not abs(values[i]) <= 1e12:
                return 3
        return 0
"""


def put_law(
    plant: Plant, m: Memory, i: int, tip: int, controller: Controller, outside: Calls
) -> None:
    """Put a controller in the memory of a run."""
    arm, n = plant.arm, plant.arm.n
    law, numbers = m["law"][i], m["of_law"][i]
    law["tip"], law["kind"] = max(tip, 0), KINDS.get(type(controller), laws.OUTSIDE)
    law["axis"], law["least"] = -1, NO_INVERSE
    law["entry"] = laws.LAWS[int(law["kind"])].address
    numbers[context.ACTS] = 1.0
    if tip >= 0 and len(arm.tips) > 1:
        numbers[context.ACTS, :n] = joints_of(plant, tip)
    if type(controller) not in KINDS:
        states = len(m["y"])
        law["pose"] = hasattr(controller, "py_func")
        law["call"] = (
            outside.compiled(CONTROLLER, controller, n=n, states=states, reads=len(m["seen"]))
            if law["pose"]
            else outside.outside(_torques_of(plant, controller), n)
        )
        return
    target: Any = getattr(controller, "target", None)
    if isinstance(controller, JointPD):
        numbers[context.KP, :n] = gains(controller.kp, n, "kp")
        numbers[context.KD, :n] = gains(controller.kd, n, "kd")
        if hasattr(target, "py_func"):
            law["moving"] = outside.compiled(TARGET, target, size=n)
        elif callable(target):
            law["moving"] = outside.outside(_joint_target(plant, target), n)
        else:
            numbers[context.TARGET, :n] = joint_vector(arm, target, "target")
        return
    assert isinstance(controller, TipLaw)
    _put_tip_law(plant, m, i, controller, outside)


def _put_tip_law(plant: Plant, m: Memory, i: int, controller: TipLaw, outside: Calls) -> None:
    """Put a law that leads a tip in the memory of a run."""
    arm, task = plant.arm, plant.arm.task
    law, numbers, k = m["law"][i], m["of_law"][i], len(task.rows)
    law["f"], law["k"] = free_components(controller.mode), k
    law["rows"][:k], law["scale"][:k] = task.indices[:k], task.scale[:k, 0]
    normal = goal_normal(arm)
    law["axis"] = -1 if normal is None else normal
    if isinstance(controller, TransposedJacobian):
        numbers[context.KP, :k] = gains(controller.kp, k, "kp")
        numbers[context.KD, :k] = gains(controller.kd, k, "kd")
    if isinstance(controller, RateLaw):
        numbers[context.KP, :k] = gains(controller.gain, k, "gain")
        law["servo"] = controller.servo
    if isinstance(controller, DampedLeastSquares):
        law["damping"], law["threshold"] = controller.damping, controller.threshold
    if isinstance(controller, ResolvedRate) and controller.rest is not None:
        law["rests"] = 1
        numbers[context.REST, : arm.n] = joint_vector(arm, controller.rest, "rest")
    first: Any = controller.goal(0.0)
    law["pose"] = isinstance(first, pin.SE3)
    size = 12 if law["pose"] else k
    write = _goal_writer(plant, bool(law["pose"]))
    write(first, numbers[context.TARGET, :size])
    if hasattr(controller.target, "py_func"):
        law["moving"] = outside.compiled(TARGET, controller.target, size=size)
    elif callable(controller.target):
        target = controller.target
        law["moving"] = outside.outside(lambda t, _, out: write(target(t), out), size)


def _goal_writer(plant: Plant, pose: bool) -> Callable[[Any, Array], None]:
    """Return the function that writes a goal as numbers, checked."""
    from spacearm.model.frames import sound_pose

    task = plant.arm.task
    k = len(task.rows)

    def write(goal: Any, out: Array) -> None:
        if isinstance(goal, pin.SE3) != pose:
            raise ConfigurationError(
                "target is a pose at one time and a point at another; give one kind only"
            )
        if pose:
            placed = sound_pose(goal, "target")
            out[:3], out[3:12] = placed.translation, placed.rotation.ravel()
            return
        if max(task.indices[:k]) > 2:
            raise ConfigurationError(f"target is {goal!r}; the task {task.names!r} takes a pin.SE3")
        meaning = f"[m], one for each row of the task {task.names!r}, or a pin.SE3"
        out[:k] = finite(goal, (k,), "target", meaning)

    return write


def _joint_target(
    plant: Plant, target: Callable[[float], npt.ArrayLike]
) -> Callable[[float, Array, Array], None]:
    """Return the function that writes a moving target of the joints."""

    def write(t: float, _: Array, out: Array) -> None:
        out[:] = joint_vector(plant.arm, target(t), "target")

    return write


def _torques_of(plant: Plant, controller: Controller) -> Callable[[float, Array, Array], None]:
    """Return the function that writes the torques of a controller in Python, checked."""
    n = plant.arm.n

    def write(t: float, y: Array, out: Array) -> None:
        cfg = plant.configuration(y[: len(y) - 30 - 6 * n])
        tau = controller(t, cfg, y[n : 2 * n])
        out[:] = joint_vector(plant.arm, tau, "the controller's torque")

    return write


def joints_of(plant: Plant, tip: int) -> Array:
    """Return (n,) 1 for the joints that move a tip, else 0."""
    arm, model = plant.arm, plant.arm.model
    chain = [int(i) for i in model.supports[model.frames[arm.tip_frames[tip]].parentJoint]]
    rows = [i - 2 for i in chain if i > 1]
    coupling = np.eye(arm.n) if arm.coupling is None else arm.coupling
    return np.asarray((np.abs(coupling[rows]).sum(axis=0) > 0.0) * 1.0)
