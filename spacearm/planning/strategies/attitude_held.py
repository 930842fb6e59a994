"""Attitude held: a plan for a spacecraft whose attitude wheels hold.

A held spacecraft moves as one of boundless moment of inertia would: D^-1 D_q dq is zero, and J* is
the Jacobian of the held arm. So unknowns and equations are those of the plan sought for such a
spacecraft, which is then timed, evenly. Bounds: what each wheel holds and gives at every instant;
momentum falls with the duration, torque with its square.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, NoSolutionError
from spacearm.mechanics.dynamics import momentum_and_torque
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.planning.reactions import Wheels, boundless, load_of
from spacearm.planning.request import PlanRequest
from spacearm.planning.result import Plan
from spacearm.planning.strategies.drift import stretched
from spacearm.planning.timing import flown_spline

#: Durations tried where the way depends on them, the room of the next, and that for rounding.
TRIES, SLACK, ROUND_UP = 4, 1.05, 1.0 + 1e-9


def attitude_held(request: PlanRequest, floating: Callable[[PlanRequest], Plan]) -> Plan:
    """Return a plan with the attitude held as at the start.

    Args:
        request: What is asked; the wheels hold the angular momentum of its start.
        floating: Plans for a spacecraft that floats.

    Raises:
        ConfigurationError: An attitude is asked for, or the wheels do not hold the momentum.
        NoSolutionError: There is none, or the wheels cannot hold it in time.
    """
    if request.final_attitude is not None:
        raise ConfigurationError("final_attitude is of no use: the attitude stays what it is")
    cfg, duration = request.start, request.duration
    wheels = Wheels.of(cfg, request.constraints.wheels)
    timed = bool(cfg.momentum[:3].any()) or request.final_twist is not None
    momentum = np.append(cfg.momentum[:3], np.zeros(3))
    start = boundless(cfg.arm).at(cfg.q, base=cfg.base, momentum=momentum)
    lasts, why = duration, ""
    for _ in range(TRIES):
        try:
            found = floating(replace(request, start=start, held=cfg.arm, duration=lasts))
        except NoSolutionError as error:
            best = error.best
            if isinstance(best, Plan):
                best = _held(cfg, best, wheels)
            raise NoSolutionError("; ".join(filter(None, (str(error), why))), best) from None
        if len(found) == 1:
            return _held(cfg, found, wheels)
        load = load_of(cfg.arm, found.spline)
        slower, why = wheels.slowdown(load)
        needed = float(found.t[-1]) * slower
        if slower > 1.0 and duration is not None:
            raise NoSolutionError(
                f"{cfg.arm.name}: in {duration:.4g} s {why}; within the limits of the wheels this "
                f"way takes {needed:.4g} s, {needed - duration:.4g} s more",
                _held(cfg, found, wheels),
            )
        if slower > 1.0 and not timed:
            found = stretched(found, needed * ROUND_UP, request.account)
            load = load.slowed(slower * ROUND_UP)
        if slower <= 1.0 or not timed:
            return replace(_held(cfg, found, wheels), wheel_load=wheels.story(load))
        slower = slower**2 if request.final_twist is not None else slower  # as 1 / t: rates stay
        lasts = SLACK * float(found.t[-1]) * slower
    raise NoSolutionError(
        f"{cfg.arm.name}: {why} along each of the {TRIES} ways found; give a longer duration",
        _held(cfg, found, wheels),
    )


def slowed(arm: SpaceArm, t: Array, q: Array, wheels: Wheels) -> dict[str, Any]:
    """Return times at which wheels keep their limits, and what they hold then, as a plan has it.

    Args:
        arm: The arm, its attitude held.
        t: (m,) times of the rows [s], which are stretched where they must.
        q: (m, n) joint positions.
        wheels: The wheels.
    """
    still = np.zeros(arm.n)
    load = load_of(arm, flown_spline(t, q, still))
    slower, _ = wheels.slowdown(load)
    if slower > 1.0:
        t, load = t * slower * ROUND_UP, load.slowed(slower * ROUND_UP)
    way = flown_spline(t, q, still)
    moving, _ = momentum_and_torque(arm, q, way(t, 1), way(t, 2))
    spins = wheels.momenta(moving)[:, : len(arm.wheels)]
    return {"t": t, "wheels": spins, "wheel_load": wheels.story(load)}


def _held(cfg: Configuration, found: Plan, wheels: Wheels) -> Plan:
    """Return the plan of the arm itself, its attitude that of the start."""
    arm, attitude = cfg.arm, pin.SE3(cfg.base.rotation, np.zeros(3))
    rows = [
        kinematics(arm, q, attitude.copy(), com) for q, com in zip(found.q, found.com, strict=True)
    ]
    total = np.append(cfg.momentum[:3], attitude.rotation @ wheels.axes @ wheels.start)
    moving, _ = momentum_and_torque(arm, found.q, found.dq, found.ddq)
    return replace(
        found,
        arm=arm,
        mode="attitude-controlled",
        base=np.array([pin.SE3ToXYZQUAT(row.base) for row in rows]),
        momentum=np.tile(total, (len(rows), 1)),
        wheels=wheels.momenta(moving)[:, : len(arm.wheels)],
    )
