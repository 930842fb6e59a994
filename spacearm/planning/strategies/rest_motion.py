"""Rest motion: joints and wheels moved until the spacecraft rests and the tip arrives.

Joint positions and what the wheels hold are polynomials over time, from rest to rest: a ramp 10 u^3
- 15 u^4 + 6 u^5 and waves u^3 (1 - u)^3 T_k(2 u - 1), T_k Chebyshev's polynomials, whose first and
second derivatives vanish at both ends. Their heights are found by Newton's method, each step of
which is a linear program. The limits of joints and wheels are linear in the heights, so that they
hold while the ends are led to the goal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from scipy.optimize import linprog

from spacearm.arrays import Array, Booleans
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import placed
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.planning.account import SearchAccount
from spacearm.planning.many_curves import steered_attitudes
from spacearm.planning.optimiser import ARRIVED, Target
from spacearm.planning.reactions import Wheels

#: Number of waves of each joint and wheel.
WAVES = 6
#: Shares of the duration at which the limits are looked at: denser towards the ends.
TIMES = np.sin(0.5 * np.pi * (np.arange(1, 32) / 32.0)) ** 2
#: Share of rates, torques and capacities that may be taken at these times.
MARGIN = 0.98
#: Steps of the motions whose ends give the derivative.
COARSE = 24
#: Motions that are integrated between two looks at the clock.
TOGETHER = 16
#: Height of a wave by which the end is differentiated, [rad], [m], or share of the momentum.
BENT = 1e-5
#: Newton steps, at most.
STEPS = 40
#: The largest of them in any height, likewise, and that below which the search ends.
LONGEST, SHORTEST = 0.5, 1e-3
#: Residual from which on the least change comes first, which the limits allow for.
CLOSE = 1e-2
#: What the merit falls to at least in a step, and the error where the derivative is used again.
STALLED, QUICK = 1.0 - 1e-6, 0.05
#: What a unit of the residual, of excess over the limits, and of a wave of joint or wheel costs.
MISS, OVER, BEND, SPIN = 300.0, 300.0, 0.1, 0.01


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
    """The limits of joints and wheels, joints first.

    Attributes:
        arm: The arm.
        target: What has the joint limits.
        rates: (n,) largest joint rates [rad/s] or [m/s].
        wheels: The wheels.
    """

    arm: SpaceArm
    target: Target
    rates: Array
    wheels: Wheels

    def excess(self, motion: RestMotion) -> float:
        """Return by how much limits are exceeded at worst, as a share of them."""
        used, bound, _ = self.use(motion)
        return float((used / bound).max(initial=0.0)) - 1.0

    def rows(self, motion: RestMotion) -> tuple[Array, Array]:
        """Return G and g of the limits G x <= g on heights x, each row over its bound.

        There is some room, but start and goal are within the limits.
        """
        middle, width, most = self._limits
        start, goal = motion.start, motion.start.copy()
        if self.target.q is not None:
            goal[: self.arm.n] = self.target.q
        lower = np.minimum(middle - MARGIN * width, np.minimum(start, goal))
        upper = np.maximum(middle + MARGIN * width, np.maximum(start, goal))
        at, rates = shapes(TIMES), shapes(TIMES, 1) / motion.duration
        blocks, rooms = [np.zeros((0, motion.heights.size))], [np.zeros(0)]
        for i, one in enumerate(np.eye(len(start))):
            half, rate = (upper[i] - lower[i]) / 2.0, MARGIN * most[i]
            if np.isfinite(half):
                G = np.kron(at, one) / half
                blocks += [G, -G]
                room = np.array([upper[i] - start[i], start[i] - lower[i]]) / half
                rooms += [np.repeat(room, len(at))]
            if np.isfinite(rate):
                G = np.kron(rates, one) / rate
                blocks += [G, -G]
                rooms += [np.ones(2 * len(at))]
        return np.vstack(blocks), np.concatenate(rooms)

    def use(self, motion: RestMotion) -> tuple[Array, Array, list[str]]:
        """Return the extremes of a motion, the bounds that they have, and what they are."""
        n, joints = self.arm.n, self.arm.joint_names
        middle, width, most = self._limits
        least, largest, rates = motion.extremes()
        far = np.maximum(largest - middle, middle - least)
        words = [f"joint {name!r} goes beyond its limits" for name in joints]
        words += self._of_wheels("holds", far[n:], width[n:], "N m s")
        words += [
            f"joint {name!r} moves at {x:.4g}" for name, x in zip(joints, rates[:n], strict=True)
        ]
        words += self._of_wheels("gives", rates[n:], most[n:], "N m")
        return np.append(far, rates), np.append(width, most), words

    def _of_wheels(self, does: str, used: Array, most: Array, unit: str) -> list[str]:
        each = zip(self.wheels.names, used, most, strict=True)
        return [f"wheel {name} {does} {x:.4g} of at most {y:.4g} {unit}" for name, x, y in each]

    def load(self, motion: RestMotion) -> str:
        """Return what the wheels hold and give at most, in one sentence."""
        words = [word for word in self.use(motion)[2] if word.startswith("wheel")]
        return f"{'; '.join(words)}: extremes of polynomials over time"

    @cached_property
    def _limits(self) -> tuple[Array, Array, Array]:
        """(n + w,) middle and half width of what values may be, and the largest rates."""
        lower = np.append(self.target.lower, -self.wheels.capacity)
        upper = np.append(self.target.upper, self.wheels.capacity)
        width = 0.5 * (upper - lower)
        with np.errstate(invalid="ignore"):
            middle = np.where(np.isfinite(width), 0.5 * (lower + upper), 0.0)
        return middle, width, np.append(self.rates, self.wheels.torque)


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
        n, axes, out = self._n, self.bounds.wheels.axes, []
        for motion, T in zip(motions, self._attitudes(motions, steps)[:, -1], strict=True):
            end = motion.start + motion.heights[0]
            there = self.target.missed(self.start, placed(self.start, end[:n], T))
            still = (T.T @ self.start.momentum[3:] - axes @ end[n:]) / self._scale
            out.append(np.append(there, still))
        return np.array(out)

    def _slope(self, motion: RestMotion) -> Array:
        """Return the derivative (k, size) of the residual by the heights."""
        unit, places, one = self._units, np.flatnonzero(self._free), np.eye(len(self._units))
        motions = [motion, *(motion.changed(BENT * unit[i] * one[i]) for i in places)]
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
        held = at[:, :, n:] @ self.bounds.wheels.axes.T
        start, t = self.start, motions[0].duration * u[::2]
        T, h = start.base.rotation, start.momentum[3:]
        return steered_attitudes(start.arm, T, t, at[:, :, :n], rates, h, held)

    @cached_property
    def _scale(self) -> float:
        """Momentum that counts as one [N m s]."""
        held = float(np.abs(self.bounds.wheels.start).max())
        return max(float(np.linalg.norm(self.start.momentum[3:])), held) or 1.0

    @cached_property
    def _units(self) -> Array:
        """(size,) unit of each height."""
        w = len(self.bounds.wheels.names)
        return np.tile(np.repeat((1.0, self._scale), (self._n, w)), 1 + WAVES)

    @cached_property
    def _free(self) -> Booleans:
        """(size,) whether a height may change; the joints' ramps do not where they have a goal."""
        free = np.ones((1 + WAVES, len(self._units) // (1 + WAVES)), dtype=bool)
        free[0, : self._n] = self.target.q is None
        free[1:, : self._n] = self.bend
        return free.ravel()

    @cached_property
    def _costs(self) -> Array:
        """What a unit of each free height costs; ramps nothing."""
        w = len(self.bounds.wheels.names)
        waves = np.tile(np.repeat((BEND, SPIN), (self._n, w)), WAVES)
        return np.append(np.zeros(self._n + w), waves)[self._free]

    @property
    def _n(self) -> int:
        return self.start.arm.n
