"""Rest motion: joints and wheels moved until the spacecraft rests and the tip arrives.

Joint positions and what the wheels hold are polynomials over time, from rest to rest: a ramp 10 u^3
- 15 u^4 + 6 u^5 and waves u^3 (1 - u)^3 T_k(2 u - 1), T_k Chebyshev's polynomials, whose first and
second derivatives vanish at both ends. Their heights are found by Newton's method, each step of
which is a linear program: the limits of joints and wheels are linear in the heights, so that they
hold while the ends are led to the goal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import numpy.typing as npt
from numpy.polynomial import Chebyshev, Polynomial
from scipy.optimize import linprog

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import placed
from spacearm.model.arm import Configuration
from spacearm.planning.account import SearchAccount
from spacearm.planning.many_curves import steered_attitudes
from spacearm.planning.optimiser import ARRIVED, Target
from spacearm.planning.reactions import Wheels

WAVES = 6
"""Number of waves of each joint and wheel."""
TIMES = np.sin(0.5 * np.pi * (np.arange(1, 32) / 32.0)) ** 2
"""Shares of the duration at which the limits are looked at: denser towards the ends."""
MARGIN = 0.98
"""Share of rates, torques and capacities that may be taken at these times."""
COARSE = 24
"""Steps of the motions whose ends give the derivative."""
TOGETHER = 16
"""Motions that are integrated between two looks at the clock."""
BENT = 1e-5
"""Height of a wave by which the end is differentiated, [rad], [m], or share of the momentum."""
STEPS = 40
"""Newton steps, at most."""
LONGEST, SHORTEST = 0.5, 1e-3
"""The largest of them in any height, likewise, and that below which the search ends."""
CLOSE = 1e-2
"""Residual from which on the least change comes first, which the limits allow for."""
STALLED, QUICK = 1.0 - 1e-6, 0.05
"""What the merit falls to at least in a step, and the error where the derivative is used again."""
MISS, OVER, BEND, SPIN = 300.0, 300.0, 0.1, 0.01
"""What a unit of the residual, of excess over the limits, and of a wave of joint or wheel costs."""


def _shapes() -> tuple[Polynomial, ...]:
    """Return the ramp and the waves over u, from 0 to 1; the first wave is 1 at its top."""
    u = Polynomial([0.0, 1.0])
    ramp, bell = u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 64.0 * u**3 * (1.0 - u) ** 3
    waves = [Chebyshev.basis(k, domain=(0.0, 1.0)).convert(kind=Polynomial) for k in range(WAVES)]
    return (ramp, *(bell * wave for wave in waves))


SHAPES = _shapes()
DERIVED = tuple(shape.deriv() for shape in SHAPES)


def shapes(u: Array, order: int = 0) -> Array:
    """Return ramp and waves (m, 1 + WAVES), or their first derivatives, at shares u (m,)."""
    return np.column_stack([shape(u) for shape in (SHAPES, DERIVED)[order]])


@dataclass(frozen=True)
class RestMotion:
    """A motion of joints and wheels.

    Attributes:
        start: (n + w,) joint positions [rad] or [m], and what each wheel holds [N m s].
        heights: (1 + WAVES, n + w) heights of ramps and waves.
        duration: How long it lasts [s].
    """

    start: Array
    heights: Array
    duration: float

    def changed(self, by: Array) -> RestMotion:
        """Return the motion with heights changed by (size,)."""
        return replace(self, heights=self.heights + by.reshape(self.heights.shape))

    def at(self, u: Array) -> Array:
        """Return positions and momenta (m, n + w) at shares of the duration (m,)."""
        return np.asarray(self.start + shapes(u) @ self.heights)

    def rates(self, u: Array) -> Array:
        """Return their rates (m, n + w), those of wheels their torques [N m]."""
        return np.asarray(shapes(u, 1) @ self.heights / self.duration)

    def extremes(self) -> tuple[Array, Array, Array]:
        """Return the least and the largest (n + w,) of each, and the largest rates, on the way."""
        found = [self._extremes(i) for i in range(len(self.start))]
        least, largest, rates = np.array(found).T
        return least, largest, rates

    def _extremes(self, i: int) -> tuple[float, float, float]:
        way = sum((h * shape for h, shape in zip(self.heights[:, i], SHAPES, strict=True)),
                  Polynomial([self.start[i]]))  # fmt: skip
        values, rates = _turning_values(way), _turning_values(way.deriv())
        return values.min(), values.max(), np.abs(rates).max() / self.duration


def _turning_values(p: Polynomial) -> Array:
    """Return the values of a polynomial at 0, at 1, and where its derivative vanishes between."""
    roots = p.deriv().roots()
    inside = roots.real[(np.abs(roots.imag) < 1e-6) & (roots.real > 0.0) & (roots.real < 1.0)]
    return np.asarray(p(np.concatenate((inside, [0.0, 1.0]))))


@dataclass(frozen=True)
class Bounds:
    """The limits of joints and wheels.

    Attributes:
        start: Configuration at the start.
        target: What has the joint limits.
        rates: (n,) largest joint rates [rad/s] or [m/s].
        wheels: The wheels.
    """

    start: Configuration
    target: Target
    rates: Array
    wheels: Wheels

    def excess(self, motion: RestMotion) -> float:
        """Return by how much limits are exceeded at worst, as a share of them."""
        used, bound, _ = self.use(motion)
        return float((used / bound).max(initial=0.0)) - 1.0

    def rows(self, motion: RestMotion) -> tuple[Array, Array]:
        """Return G and g of the limits G x <= g on heights x, each row over its bound."""
        lower, upper, rate = self._with_room
        at, rates = shapes(TIMES), shapes(TIMES, 1) / motion.duration
        blocks, rooms = [], []
        for i in range(len(motion.start)):
            one = np.eye(len(motion.start))[i]
            width = (upper[i] - lower[i]) / 2.0
            if np.isfinite(width):
                G = np.kron(at, one) / width
                blocks += [G, -G]
                rooms += [np.full(len(at), (upper[i] - motion.start[i]) / width),
                          np.full(len(at), (motion.start[i] - lower[i]) / width)]  # fmt: skip
            if np.isfinite(rate[i]):
                G = np.kron(rates, one) / rate[i]
                blocks += [G, -G]
                rooms += [np.ones(2 * len(at))]
        size = motion.heights.size
        if not blocks:
            return np.zeros((0, size)), np.zeros(0)
        return np.vstack(blocks), np.concatenate(rooms)

    def use(self, motion: RestMotion) -> tuple[Array, Array, list[str]]:
        """Return the extremes of a motion, the bounds that they have, and what they are."""
        arm = self.start.arm
        n = arm.n
        least, largest, rates = motion.extremes()
        lower, upper = self.target.lower, self.target.upper
        middle, width = 0.5 * (lower + upper), 0.5 * (upper - lower)
        bound = np.isfinite(width)
        off = np.maximum(largest[:n] - middle, middle - least[:n])[bound]
        names = [repr(name) for name in arm.joint_names]
        used = [off, rates[:n], np.maximum(np.abs(least[n:]), np.abs(largest[n:])), rates[n:]]
        most = [width[bound], self.rates, self.wheels.capacity, self.wheels.torque]
        words = [
            *(f"joint {name} goes beyond its limits" for name in np.array(names)[bound]),
            *(f"joint {name} moves at {x:.4g}" for name, x in zip(names, used[1], strict=True)),
            *(f"wheel {name} holds {x:.4g} of at most {most:.4g} N m s"
              for name, x, most in zip(self.wheels.names, used[2], most[2], strict=True)),
            *(f"wheel {name} gives {x:.4g} of at most {most:.4g} N m"
              for name, x, most in zip(self.wheels.names, used[3], most[3], strict=True)),
        ]  # fmt: skip
        return np.concatenate(used), np.concatenate(most), words

    def load(self, motion: RestMotion) -> str:
        """Return what the wheels hold and give at most, in one sentence."""
        w = len(self.wheels.names)
        words = self.use(motion)[2][-2 * w :]
        return f"{'; '.join(words)}: extremes of polynomials over time"

    @cached_property
    def _with_room(self) -> tuple[Array, Array, Array]:
        """(n + w,) least and largest values and largest rates, with some room."""
        capacity, target = MARGIN * self.wheels.capacity, self.target
        middle, width = 0.5 * (target.lower + target.upper), 0.5 * (target.upper - target.lower)
        with np.errstate(invalid="ignore"):
            lower = np.where(np.isfinite(width), middle - MARGIN * width, -np.inf)
            upper = np.where(np.isfinite(width), middle + MARGIN * width, np.inf)
        ends = [self.start.q] if target.q is None else [self.start.q, target.q]
        lower, upper = (
            np.minimum(lower, np.min(ends, axis=0)),
            np.maximum(upper, np.max(ends, axis=0)),
        )
        return (
            np.append(lower, np.minimum(-capacity, self.wheels.start)),
            np.append(upper, np.maximum(capacity, self.wheels.start)),
            MARGIN * np.append(self.rates, self.wheels.torque),
        )


@dataclass(frozen=True)
class Landing:
    """The search for a motion that ends at rest.

    Attributes:
        start: Configuration at the start, with the momentum.
        target: What the motion must achieve besides.
        bounds: What joints and wheels may do on the way.
        steps: Steps of the integration.
        bend: Whether joints may go aside from ramps; wheels may.
        account: The time that it may take.
    """

    start: Configuration
    target: Target
    bounds: Bounds
    steps: int
    bend: bool
    account: SearchAccount

    def landed(self, motion: RestMotion) -> RestMotion:
        """Return a motion near another that arrives within the limits of joints and wheels.

        Raises:
            NoSolutionError: None was found.
        """
        left, radius = self.residual(motion), LONGEST
        slope = self._slope(motion)
        for _ in range(STEPS):
            kept = self.bounds.excess(motion) <= 0.0
            if kept and np.linalg.norm(left) <= ARRIVED:
                return motion
            self.account.check_time()
            steps = [partial(self._step, motion, left, slope, radius)]
            if kept and np.linalg.norm(left) < CLOSE:
                steps.insert(0, partial(self._last, left, slope))
            for step in steps:
                tried = motion.changed(step())
                there = self.residual(tried)
                nearer = self._merit(tried, there) < STALLED * self._merit(motion, left)
                if nearer:
                    break
            if nearer:
                quickly = np.linalg.norm(there) < QUICK * np.linalg.norm(left)
                motion, left, radius = tried, there, min(LONGEST, 2.0 * radius)
                slope = slope if quickly else self._slope(motion)
            elif (radius := radius / 4.0) < SHORTEST:
                break
        raise NoSolutionError(self._failure(motion, left))

    def rows(self, motion: RestMotion) -> tuple[Array, list[Configuration]]:
        """Return shares of the duration (m,) and the configurations there."""
        u = np.linspace(0.0, 1.0, self.steps + 1)
        Q = motion.at(u)[:, : self._n]
        T = self._attitudes([motion], self.steps)[0]
        return u, [placed(self.start, q, R) for q, R in zip(Q, T, strict=True)]

    def residual(self, motion: RestMotion) -> Array:
        """Return how far the end is from the goal and, over all, the momentum left [1]."""
        return self._residuals([motion], self.steps)[0]

    def _merit(self, motion: RestMotion, left: Array) -> float:
        G, g = self.bounds.rows(motion)
        over = float((G @ motion.heights.ravel() - g).max(initial=0.0))
        return MISS * float(np.abs(left).sum()) + OVER * over

    def _step(self, motion: RestMotion, left: Array, slope: Array, radius: float) -> Array:
        """Return the change of the heights that leads nearest to the goal within a radius.

        Variables of the linear program: the new heights, their absolute values, what is left of
        each row of the residual on either side, and the excess over the limits.
        """
        x, free = motion.heights.ravel(), self._free
        G, g = self.bounds.rows(motion)
        N, k = int(free.sum()), len(left)
        unit = self._units[free]
        now = x[free] / unit
        A, S = (G * self._units)[:, free], (slope * self._units)[:, free]
        room = g - G[:, ~free] @ x[~free]
        one, none = np.eye(N), np.zeros
        sides = np.hstack((np.eye(k), -np.eye(k)))
        found = linprog(
            np.concatenate((none(N), self._costs, np.full(2 * k, MISS), [OVER])),
            A_ub=np.vstack((
                np.column_stack((A, none((len(A), N + 2 * k)), -np.ones(len(A)))),
                np.column_stack((one, -one, none((N, 2 * k + 1)))),
                np.column_stack((-one, -one, none((N, 2 * k + 1)))),
            )),
            b_ub=np.concatenate((room, none(2 * N))),
            A_eq=np.column_stack((S, none((k, N)), sides, none((k, 1)))),
            b_eq=S @ now - left,
            bounds=[
                *zip(now - radius, now + radius, strict=True), *[(0.0, None)] * (N + 2 * k + 1)
            ],
        )  # fmt: skip
        step = np.zeros(len(x))
        if found.x is not None:
            step[free] = (found.x[:N] - now) * unit
        return step

    def _last(self, left: Array, slope: Array) -> Array:
        """Return the least change of the heights that leads to the goal, limits left aside."""
        unit = self._units * self._free
        return np.linalg.lstsq(slope * unit, -left)[0] * unit

    def _failure(self, motion: RestMotion, left: Array) -> str:
        used, bound, words = self.bounds.use(motion)
        worst = int((used / bound).argmax())
        if used[worst] > bound[worst]:
            return f"in {motion.duration:.4g} s {words[worst]}"
        return f"in {motion.duration:.4g} s the end stays {np.linalg.norm(left):.1e} off"

    def _residuals(self, motions: list[RestMotion], steps: int) -> Array:
        """Return the residuals (p, k) of motions."""
        n, out = self._n, []
        for motion, T in zip(motions, self._attitudes(motions, steps)[:, -1], strict=True):
            end = motion.start + motion.heights[0]
            there = self.target.missed(self.start, placed(self.start, end[:n], T))
            still = (T.T @ self._h - self._wheels.axes @ end[n:]) / self._scale
            out.append(np.append(there, still))
        return np.array(out)

    def _slope(self, motion: RestMotion) -> Array:
        """Return the derivative (k, size) of the residual by the heights."""
        unit, places = self._units, np.flatnonzero(self._free)
        one = np.eye(len(unit))
        motions = [motion]
        motions += [motion.changed(BENT * unit[i] * one[i]) for i in places]
        steps = max(COARSE, self.steps // 2)
        parts = []
        for first in range(0, len(motions), TOGETHER):
            self.account.check_time()
            parts.append(self._residuals(motions[first : first + TOGETHER], steps))
        ends = np.vstack(parts)
        slope = np.zeros((ends.shape[1], len(unit)))
        slope[:, places] = (ends[1:] - ends[0]).T / (BENT * unit[places])
        return slope

    def _attitudes(self, motions: list[RestMotion], steps: int) -> Array:
        """Return the attitudes (p, m, 3, 3) along motions of the same duration."""
        n, u = self._n, np.linspace(0.0, 1.0, 2 * steps + 1)
        at = np.array([motion.at(u) for motion in motions])
        rates = np.array([motion.rates(u)[:, :n] for motion in motions])
        held = at[:, :, n:] @ self._wheels.axes.T
        T, t = self.start.base.rotation, motions[0].duration * u[::2]
        return steered_attitudes(self.start.arm, T, t, at[:, :, :n], rates, self._h, held)

    @property
    def _wheels(self) -> Wheels:
        return self.bounds.wheels

    @property
    def _h(self) -> Array:
        """(3,) angular momentum about the system CM, inertial axes [N m s]."""
        return self.start.momentum[3:]

    @cached_property
    def _scale(self) -> float:
        """Momentum that counts as one [N m s]."""
        held = float(np.abs(self._wheels.start).max())
        return max(float(np.linalg.norm(self._h)), held) or 1.0

    @cached_property
    def _units(self) -> Array:
        """(size,) unit of each height."""
        units = np.ones(self._n + self._w)
        units[self._n :] = self._scale
        return np.tile(units, 1 + WAVES)

    @cached_property
    def _free(self) -> npt.NDArray[np.bool_]:
        """(size,) whether a height may change; the joints' ramps do not where they have a goal."""
        free = np.ones((1 + WAVES, self._n + self._w), dtype=bool)
        free[0, : self._n] = self.target.q is None
        free[1:, : self._n] = self.bend
        return free.ravel()

    @cached_property
    def _costs(self) -> Array:
        """What a unit of each free height costs; ramps nothing."""
        each = np.append(np.full(self._n, BEND), np.full(self._w, SPIN))
        cost = np.outer(np.append(0.0, np.ones(WAVES)), each)
        return np.asarray(cost.ravel()[self._free])

    @property
    def _n(self) -> int:
        return self.start.arm.n

    @property
    def _w(self) -> int:
        return len(self._wheels.names)
