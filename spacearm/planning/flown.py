"""Flown: the turn of the spacecraft along the spline that `Tracking` flies through a plan's rows.

Between its rows a plan is searched for along straight lines; splines through the same rows turn a
floating spacecraft by a little more or less. So every plan is bent until it arrives as flown.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.equations.turns import GAUSS
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import chained, turns_of_spacecraft
from spacearm.model.arm import Configuration
from spacearm.planning.many_curves import Indices, steered_attitudes
from spacearm.planning.timing import rest_to_rest_spline, smooth

FINE, FEWEST = 0.01, 800
"""Largest motion of a joint, and turn by the momentum, in one step of the integration [rad] or [m];
least number of all steps."""
SHAPES = 2
"""Waves 1 - cos(2 pi k s) of each joint by which rows are bent, s the share of their way."""
BENT = 1e-4
"""Height of a wave by which the end is differentiated [rad] or [m]."""
TURNED = 1e-9
"""Error of the attitude at the end that counts as none [rad]."""
STEPS = 8
"""Newton steps, at most."""
SLACK = 1e-3
"""Joints that come nearer to their limits are not bent [rad] or [m]."""


@dataclass(frozen=True)
class FlownRows:
    """Rows that a floating arm passes along quintic splines, its wheels likewise.

    Attributes:
        start: Configuration at the first row, with the momentum and what the wheels hold of it.
        t: (m,) times [s].
        q: (m, n) joint positions.
        wheels: (m, w) what the wheels hold [N m s].
    """

    start: Configuration
    t: Array
    q: Array
    wheels: Array

    def attitudes(self, parts: int = 1) -> Array:
        """Return the attitudes (m, 3, 3) of the spacecraft at the rows, to about 1e-9 rad.

        Args:
            parts: How many times finer than that the integration is.
        """
        start, t, h = self.start, self.t, self.start.momentum[3:]
        steps = parts * self._steps
        at_rows = np.append(0, np.cumsum(steps))
        length = np.repeat(np.diff(t) / steps, steps)
        number = np.arange(at_rows[-1]) - np.repeat(at_rows[:-1], steps)
        begin = np.repeat(t[:-1], steps) + number * length
        T, q = start.base.rotation, rest_to_rest_spline(t, self.q)
        if not h.any() and not self.wheels.any():
            at = begin[:, None] + GAUSS * length[:, None]
            turns = chained(turns_of_spacecraft(start.arm, q(at), q(at, 1), length))
            return np.asarray(T @ np.concatenate((np.eye(3)[None], turns))[at_rows])
        times = np.append(np.column_stack((begin, begin + 0.5 * length)).ravel(), t[-1])
        held = np.tile(T.T @ start.stored[3:], (len(times), 1))
        if np.ptp(self.wheels, axis=0).any():
            axes = np.column_stack([wheel.axis for wheel in start.arm.wheels])
            held = smooth(t, self.wheels)(times) @ axes.T
        found = steered_attitudes(
            start.arm, T, times[::2], q(times)[None], q(times, 1)[None], h, held[None]
        )
        return np.asarray(found[0, at_rows])

    def landed(self, attitude: Array) -> FlownRows:
        """Return rows bent a little, so that the spacecraft ends with an attitude (3, 3).

        Joint positions at both ends stay, so that tips end where they should, too. Newton's method
        on the heights of smooth waves; of all corrections the one of least squares.

        Raises:
            NoSolutionError: It does not converge.
        """
        arm, q = self.start.arm, self.q
        way = np.linalg.norm(np.diff(q, axis=0), axis=1)
        share = np.append(0.0, np.cumsum(way)) / max(float(way.sum()), 1e-300)
        waves = 1.0 - np.cos(2.0 * np.pi * share[:, None] * np.arange(1, SHAPES + 1))
        room = np.minimum(q - arm.lower, arm.upper - q).min(axis=0)
        far = (room > SLACK) | (room < 0.0)
        bends = np.eye(arm.n)[far | ~far.any()]
        shapes = np.einsum("ms,jn->sjmn", waves, bends).reshape(-1, *q.shape)

        def left(rows: FlownRows) -> Array:
            return pin.log3(attitude.T @ rows.attitudes()[-1])

        rows, miss = self, left(self)
        if np.linalg.norm(miss) <= TURNED:
            return rows
        slope = [(left(replace(self, q=q + BENT * shape)) - miss) / BENT for shape in shapes]
        for _ in range(STEPS):
            height = np.linalg.lstsq(np.column_stack(slope), miss, rcond=1e-6)[0]
            rows = replace(rows, q=rows.q - np.tensordot(height, shapes, axes=1))
            miss = left(rows)
            if np.linalg.norm(miss) <= TURNED:
                return rows
        off = np.linalg.norm(miss)
        raise NoSolutionError(f"flown as a spline through its rows the motion ends {off:.1e} off")

    @property
    def _steps(self) -> Indices:
        """Steps (m - 1,) of the integration from row to row."""
        dt = np.diff(self.t)
        spin = np.linalg.norm(np.linalg.solve(self.start.A[3:, 3:6], self.start.momentum[3:]))
        turned = np.maximum(np.abs(np.diff(self.q, axis=0)).max(axis=1), spin * dt)
        return np.ceil(np.maximum(turned / FINE, dt / self.t[-1] * FEWEST)).astype(int)
