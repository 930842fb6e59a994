"""Arrival: a joint motion bent and stretched until the tip arrives with momentum on board."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import placed
from spacearm.model.arm import Configuration
from spacearm.planning.drift.drifting import drifting_attitudes
from spacearm.planning.optimiser import ARRIVED, CurveOptimiser, Target
from spacearm.planning.timing import eased

WAVES = 4
"""Number of waves 1 - cos(2 pi k u) by which a motion is bent."""
COARSE = 30
"""Rows of the motions whose ends give the derivative."""
BENT = 1e-4
"""Height of a wave by which the end is differentiated [rad] or [m]."""
KEPT = 0.1
"""Fall of the error with which a derivative is used again."""
STEPS = 30
"""Newton steps, at most."""
LONGEST = 0.3
"""Longest of them, in every height [rad] or [m]."""


@dataclass(frozen=True)
class Arrival:
    """The search for a motion that arrives at a stated time in spite of momentum.

    Attributes:
        start: Configuration at the start.
        target: What the motion must achieve.
        t: (m,) times of the rows [s].
        h: (3,) angular momentum about the system CM, which stays where it is [N m s].
    """

    start: Configuration
    target: Target
    t: Array
    h: Array

    def bent(self, Q: Array) -> list[Configuration]:
        """Return the configurations of a motion near joint positions (m, n) that arrives.

        Newton's method on the heights of waves and of a ramp that moves the end; of all corrections
        the one of least squares.

        Raises:
            NoSolutionError: It does not converge; carries the last motion.
        """
        shapes = self._shapes(self.t)
        height = np.zeros((shapes.shape[1], Q.shape[1]))
        rows = self.rows(Q)
        left = self.residual(rows[-1])
        slope = None
        for _ in range(STEPS):
            if np.linalg.norm(left) <= ARRIVED:
                return rows
            slope = self._slope(Q + shapes @ height) if slope is None else slope
            full = np.linalg.lstsq(slope, left)[0]
            full *= min(1.0, LONGEST / np.abs(full).max())
            for share in (1.0, 0.5, 0.25, 0.1):
                tried = height - share * full.reshape(height.shape)
                there = self.rows(Q + shapes @ tried)
                fall = np.linalg.norm(self.residual(there[-1])) / np.linalg.norm(left)
                if fall < 1.0:
                    break
            else:
                break
            slope = slope if fall < KEPT else None
            height, rows, left = tried, there, self.residual(there[-1])
        raise NoSolutionError(
            f"with this momentum the end stays {np.linalg.norm(left):.1e} off", rows
        )

    def rows(self, Q: Array) -> list[Configuration]:
        """Return the configurations along joint positions (m, n)."""
        T = self._attitudes(self.t, Q[None])[0]
        return [placed(self.start, q, R) for q, R in zip(Q, T, strict=True)]

    def residual(self, cfg: Configuration) -> Array:
        """Return the difference between the target and the end of a motion."""
        return self._judge.residual(cfg)

    @cached_property
    def _judge(self) -> CurveOptimiser:
        return CurveOptimiser(self.start, self.target, 1)

    def _slope(self, Q: Array) -> Array:
        """Return the derivative of the residual by all heights, from motions of few rows."""
        few = np.linspace(self.t[0], self.t[-1], COARSE + 1)
        coarse = np.column_stack([np.interp(few, self.t, q) for q in Q.T])
        shapes = self._shapes(few)
        n, size = Q.shape[1], shapes.shape[1] * Q.shape[1]
        heights = BENT * np.vstack((np.zeros(size), np.eye(size))).reshape(size + 1, -1, n)
        each = coarse + shapes @ heights
        T = self._attitudes(few, each)[:, -1]
        ends = [self.residual(placed(self.start, q[-1], R)) for q, R in zip(each, T, strict=True)]
        return np.column_stack([(end - ends[0]) / BENT for end in ends[1:]])

    def _attitudes(self, t: Array, Q: Array) -> Array:
        T = self.start.base.rotation
        return drifting_attitudes(self.start.arm, T, t, Q, self.h, T.T @ self.start.stored[3:])

    def _shapes(self, t: Array) -> Array:
        """Return the ramp, unless the joints have a goal, and the waves (m, shapes) at times."""
        u = (t - t[0]) / (t[-1] - t[0])
        waves = 1.0 - np.cos(2.0 * np.pi * np.outer(u, np.arange(1, WAVES + 1)))
        return waves if self.target.q is not None else np.column_stack((eased(u), waves))
