"""The curve of states along which the tip follows one segment of a path; see `following`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.compiler import numbers
from spacearm.equations.laws import quaternion_rate
from spacearm.errors import NoSolutionError
from spacearm.mechanics.dynamics import spacecraft_twist
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, kinematics
from spacearm.motion.events import (
    CLOSE,
    Event,
    EventFinder,
    EventFunction,
    clear_of_singularities,
    limit_functions,
    with_nearest,
)
from spacearm.motion.goal import goal_axes, goal_rows, twist_between
from spacearm.motion.tip_path import Segment

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver

RETURN = 10.0
"""Rate at which the tip returns to its path from rounding errors [1/m]."""
RTOL, ATOL = 1e-10, 1e-11
SPACING = 0.02
"""Largest distance between outputs along the curve in (q, s) [rad], [m]."""


class TipCurve:
    """The curve of states (q, attitude quaternion, s) along which the tip follows one segment.

    Args:
        cfg: Configuration at its start.
        segment: The segment.
        mode: What the spacecraft does.
        limits: Whether joint limits end it.
    """

    def __init__(self, cfg: Configuration, segment: Segment, mode: BaseMode, limits: bool) -> None:
        self.arm, self.start, self.segment = cfg.arm, cfg, segment
        self.mode, self.limits = mode, limits
        self.square = self.arm.task.k == self.arm.n
        self.sense = np.sign(self.determinant(state_of(cfg, 0.0))) if self.square else 1.0

    def configuration(self, y: Array) -> Configuration:
        """Return the configuration in a state; the system CM stays, or the spacecraft if fixed."""
        n = self.arm.n
        if self.mode == "fixed":
            return self.arm.at(y[:n], base=self.start.base)
        attitude = pin.Quaternion(y[n : n + 4] / np.linalg.norm(y[n : n + 4]))
        turned = kinematics(self.arm, y[:n].copy(), pin.SE3(attitude, np.zeros(3)))
        return turned.centred(self.start.com)

    def jacobian(self, cfg: Configuration) -> Array:
        """Return the rows (k, n) of J* that the task names."""
        return goal_rows(cfg, generalized_jacobian(cfg, mode=self.mode))

    def determinant(self, y: Array) -> float:
        """Return det J*, which has opposite signs on the two sides of a singularity."""
        return float(np.linalg.det(self.jacobian(self.configuration(y))))

    def room(self, y: Array) -> float:
        """Return the distance to the singular set, less what counts as singular [rad]."""
        cfg = self.configuration(y)
        return clear_of_singularities(cfg, self.mode, goal_axes(cfg))

    def tangent(self, cfg: Configuration, s: float) -> Array:
        """Return the unit vector (dq, ds) along the curve.

        Of a redundant arm the joint rates are the least; of others ds changes its sign with det J*,
        so that the curve goes on beyond a singularity, back along the path.
        """
        J = self.jacobian(cfg)
        back = RETURN * twist_between(cfg.tip, self.segment.pose(s))
        x = goal_rows(cfg, self.segment.twist(s) + back)
        if not self.square:
            along = np.append(np.linalg.pinv(J) @ x, 1.0)
            return along / np.linalg.norm(along)
        along = np.linalg.svd(np.column_stack((J, -x)))[2][-1]
        return along * self.sense * np.sign(np.linalg.det(J)) * np.sign(along[-1])

    def rate(self, _: float, y: Array) -> Array:
        """Return the derivative of the state with respect to the length of the curve."""
        cfg = self.configuration(y)
        along = self.tangent(cfg, float(y[-1]))
        dq, ds = along[:-1], along[-1]
        w = spacecraft_twist(cfg, dq, self.mode)[3:] @ cfg.base.rotation
        turning = quaternion_rate(numbers, y[-5:-1], w)
        return np.concatenate((dq, turning, [ds]))

    def end_functions(self) -> list[EventFunction]:
        """Return the functions whose roots end the segment."""
        singular = EventFunction("singularity", f", {CLOSE}", lambda _, y: self.room(y), True)
        if self.square:
            singular = EventFunction("singularity", "", lambda _, y: self.determinant(y), False)
        length = self.segment.length
        arrived = EventFunction("arrived", "", lambda _, y: length - float(y[-1]), True)
        return [singular, arrived, *(limit_functions(self.arm) if self.limits else [])]

    def integrate(self, progress: Callable[[float, float], object] | None) -> tuple[Array, Event]:
        """Return the states (m, n + 5) up to the end, and the event that ends the segment.

        Raises:
            NoSolutionError: The integrator fails.
        """
        from scipy import integrate  # slow to import

        y0 = state_of(self.start, 0.0)
        method: Callable[..., OdeSolver] = integrate.DOP853
        solver = method(self.rate, 0.0, y0, np.inf, rtol=RTOL, atol=ATOL)
        finder = EventFinder(self.end_functions(), self.arm.n, 0.0, y0)
        states: list[Array] = []
        while True:
            if failure := solver.step():
                raise NoSolutionError(f"{self.arm.name}: the path cannot be followed: {failure}")
            if progress:
                progress(float(solver.y[-1]), self.segment.length)
            piece, end = solver.dense_output(), solver.t
            found = finder.in_step(piece, end)
            if found:
                end = found[0].t
            steps = 1 + int((end - solver.t_old) / SPACING)
            states.append(piece(np.linspace(solver.t_old, end, steps + 1)[1:]).T)
            if found:
                return np.vstack(states), with_nearest(found[0], self.arm, self.mode)


def state_of(cfg: Configuration, s: float) -> Array:
    """Return the state (q, attitude quaternion, s)."""
    return np.concatenate((cfg.q, pin.SE3ToXYZQUAT(cfg.base)[3:], [s]))
