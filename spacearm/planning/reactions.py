"""Reactions: what a joint motion does to its spacecraft, bounded between the rows too.

The attitude held, the angular momentum of the moving arm about the system CM is

    h = sum_k (m_k r_k x r_k' + R_k I_k R_k^T w_k) - M r_cm x r_cm',

r_k the CM of body k, R_k its rotation and w_k its angular velocity, seen from the spacecraft.
Wheels take it and its derivative up, each its share. Both are computed at the rows and at times
between. Between two times t apart a quantity differs from the straight line through its values by
at most t^2 / 8 times the bound on its second derivative.

These bounds are those of `mechanics.motion_bounds`.

A floating spacecraft turns instead. On a segment of joint motion dq, s from 0 to 1, D w_0 = -h. The
inertia D of the system is at least that of the spacecraft alone, I_0, as a rigid system has no less
energy than one of its bodies. Hence |w_0| <= |h| / min I_0, and h changes by at most b s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.interpolate import PPoly

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, listed
from spacearm.mechanics.dynamics import momentum_and_torque
from spacearm.mechanics.jacobian import turning_axes
from spacearm.mechanics.motion_bounds import ROOT, joint_bounds, momentum_bounds
from spacearm.model.arm import AT_REST, Configuration, SpaceArm, kinematics
from spacearm.model.wheels import axes_of
from spacearm.motion.plant import WheelHold

#: Parts of the time between two rows, tried in order.
DIVIDED = (1, 2, 4, 8, 16)
#: Share of the largest momentum and torque up to which they may be larger between the times.
MARGIN = 0.01


class Load(NamedTuple):
    """Momentum of the arm about the system CM and its derivative, spacecraft axes.

    Attributes:
        t: (p,) times [s].
        momentum: (p, 3) D_q dq [N m s].
        torque: (p, 3) its derivative [N m].
        beyond: (2,) how far momentum [N m s] and torque [N m] may be from the straight line between
            two times, as lengths.
    """

    t: Array
    momentum: Array
    torque: Array
    beyond: Array

    def slowed(self, times: float) -> Load:
        """Return the load of the same way, evenly slowed down to last so many times as long."""
        share = 1.0 / np.array([times, times**2])
        return Load(
            self.t * times, self.momentum * share[0], self.torque * share[1], self.beyond * share
        )


def load_of(arm: SpaceArm, way: PPoly) -> Load:
    """Return the load of a motion, at as many times as `MARGIN` takes.

    Args:
        arm: The arm.
        way: Its joint positions (n,) over time, the knots at its rows.
    """
    t = way.x
    largest = [np.linalg.norm(x, axis=1).max() for x in _loads_at(arm, way, t)]
    for parts in DIVIDED:
        at, beyond = _divided(arm, way, t, parts)
        if (beyond <= MARGIN * np.array(largest)).all():
            break
    return Load(at, *_loads_at(arm, way, at), beyond)


def _loads_at(arm: SpaceArm, way: PPoly, t: Array) -> tuple[Array, Array]:
    """Return momentum and torque (p, 3) at times t (p,) of a motion."""
    return momentum_and_torque(arm, way(t), way(t, 1), way(t, 2))


def _divided(arm: SpaceArm, way: PPoly, t: Array, parts: int) -> tuple[Array, Array]:
    """Divide the times between the rows' times t (m,); return all, and `Load.beyond` for them."""
    width = np.diff(t) / parts
    begin = (t[:-1, None] + np.arange(parts) * width[:, None]).ravel()
    h = np.repeat(width, parts)
    bounds = momentum_bounds(arm, joint_bounds(way, begin, h))
    return np.append(begin, t[-1]), (h**2 / 8.0 * bounds[2:]).max(axis=1)


def largest_turn(rows: Sequence[Configuration]) -> float:
    """Return the largest turn of a spacecraft from its attitude in the first row [rad].

    Between two rows it is at most what is added to the larger of theirs.
    """
    arm, T = rows[0].arm, rows[0].base.rotation
    at_rows = np.array([np.linalg.norm(pin.log3(T.T @ cfg.base.rotation)) for cfg in rows])
    if len(rows) == 1:
        return 0.0
    Q = np.array([cfg.q for cfg in rows])
    dq = np.diff(Q, axis=0)
    ends = [momentum_and_torque(arm, q, dq, np.zeros_like(dq))[0] for q in (Q[:-1], Q[1:])]
    h = np.linalg.norm(ends, axis=2).max(axis=0)
    far = np.maximum(np.abs(Q[:-1]), np.abs(Q[1:]))
    still = np.zeros_like(dq)
    bounds = momentum_bounds(arm, np.array([far, np.abs(dq), still]).swapaxes(1, 2))
    axes = list(turning_axes(arm))
    least = np.linalg.eigvalsh(arm.model.inertias[ROOT].inertia[np.ix_(axes, axes)])[0]
    between = (0.5 * h + 0.125 * bounds[1]) / least
    return float((np.maximum(at_rows[:-1], at_rows[1:]) + between).max())


#: Moment of inertia of a spacecraft that does not turn, over what the system has.
BOUNDLESS = 1e9


@lru_cache(maxsize=16)
def boundless(arm: SpaceArm, mass: float | None = None) -> SpaceArm:
    """Return an arm on a spacecraft that no joint motion turns, of the same mass and CM.

    With `mass` it has that one [kg].
    """
    system = kinematics(arm, np.clip(np.zeros(arm.n), arm.lower, arm.upper), pin.SE3.Identity())
    largest = BOUNDLESS * float(np.linalg.norm(system.A[3:, 3:6], 2))
    body = arm.whole.bodies[arm.whole.root]
    heavy = body._replace(mass=mass or body.mass, inertia=largest * np.eye(3))
    tree = arm.whole.with_spacecraft(arm.mass, np.eye(3))  # one link in place of all of its own
    return arm.on(replace(tree, links={**tree.links, tree.root: heavy}))


#: Share of a momentum that is rounding.
ROUNDING = 1e-9
#: Names of the wheels of a spacecraft that has none in its description.
THREE = ("about x", "about y", "about z")


@dataclass(frozen=True, eq=False)
class Wheels:
    """The wheels that hold an attitude.

    Attributes:
        names: What each is called in messages.
        axes: (3, w) unit vectors of their axes, spacecraft axes.
        torque: (w,) largest torque of each motor [N m].
        capacity: (w,) largest momentum that each holds [N m s].
        start: (w,) what each holds at the start [N m s].
    """

    names: tuple[str, ...]
    axes: Array
    torque: Array
    capacity: Array
    start: Array

    @classmethod
    def of(cls, cfg: Configuration, hold: WheelHold | None) -> Wheels:
        """Return the wheels of a spacecraft; three about its axes where none are described.

        Args:
            cfg: Where the plan begins, with the momentum that they hold and what each holds of it.
                If one is zero it follows from the other: each wheel's share by the pseudo-inverse
                of the axes.
            hold: Their limits; those of the description if None.

        Raises:
            ConfigurationError: They do not hold the momentum.
            UnsupportedError: A wheel is on a link that moves.
        """
        arm, count = cfg.arm, len(cfg.arm.wheels) or 3
        names = tuple(repr(wheel.name) for wheel in arm.wheels) or THREE
        axes = axes_of(arm.model, arm.wheels) if arm.wheels else np.eye(3)
        torque, capacity = np.full((2, count), np.inf)
        if arm.wheels:
            torque, capacity = np.array([(w.torque, w.capacity) for w in arm.wheels]).T
        if hold is not None:
            torque, capacity = np.full((2, count), [[hold.torque], [hold.capacity]])
        h = cfg.base.rotation.T @ cfg.momentum[3:]
        held = cfg.wheels if cfg.wheels.any() else np.linalg.pinv(axes) @ h
        h = h if h.any() else axes @ held
        if np.abs(axes @ held - h).max() > ROUNDING * max(np.abs(h).max(), 1.0):
            raise ConfigurationError(
                f"the wheels hold {(axes @ held).round(6).tolist()} N m s at the start and the "
                f"momentum is {h.round(6).tolist()} (spacecraft axes); an attitude that is held "
                "takes the two to be the same"
            )
        return cls(names, axes, torque, capacity, held)

    @classmethod
    def free(cls, cfg: Configuration, hold: WheelHold | None) -> Wheels:
        """Return the wheels of a spacecraft that turns, with what they hold.

        Raises:
            UnsupportedError: It has none, or one is on a link that moves.
        """
        if not cfg.arm.wheels:
            raise UnsupportedError(
                f"{cfg.arm.name} has no wheels to take up momentum; name their joints by "
                "wheels=[...]"
            )
        return cls.of(replace(cfg, momentum=AT_REST), hold)

    @cached_property
    def shares(self) -> Array:
        """(w, 3) share of each wheel in a momentum or torque, the pseudo-inverse of the axes."""
        return np.asarray(np.linalg.pinv(self.axes))

    def fastest(self, arm: Array) -> Array:
        """Return the factors (m,) on momenta (m, 3) of the arm at which a wheel is full."""
        spins = -arm @ self.shares.T
        room = self.capacity - np.sign(spins) * self.start
        found = np.full(spins.shape, np.inf)
        felt = np.abs(spins) > ROUNDING * np.abs(arm).max(initial=0.0)
        np.divide(np.maximum(room, 0.0), np.abs(spins), out=found, where=felt)
        return np.asarray(found.min(axis=1))

    def momenta(self, arm: Array) -> Array:
        """Return what each wheel holds (m, w) while the arm has momenta (m, 3), spacecraft axes.

        Each takes its share by the pseudo-inverse of the axes.

        Raises:
            UnsupportedError: They cannot hold it, having no axis along it.
        """
        share = self.shares
        left = arm - arm @ share.T @ self.axes.T
        if np.abs(left).max() > ROUNDING * np.abs(arm).max():
            raise UnsupportedError(
                f"the arm's momentum has a part across the axes of {listed(self.names)}, which "
                "they cannot take; add wheels about other axes"
            )
        return np.asarray(self.start - arm @ share.T)

    def slowdown(self, load: Load) -> tuple[float, str]:
        """Return how many times longer a motion must last within the limits, and what asks for it.

        Momentum falls with the duration, torque with its square. Bounds between the times of the
        load count.

        Raises:
            NoSolutionError: A wheel holds more than it can at the start.
        """
        swing, torque, (spare, _) = self._taken(load)
        found = [(0.0, "no wheel has a limit")]
        for i, name in enumerate(self.names):
            story = f"wheel {name} gives {torque[i]:.4g} of at most {self.torque[i]:.4g} N m"
            found.append((float(np.sqrt(torque[i] / self.torque[i])), story))
            for sign, most in zip((1.0, -1.0), swing[:, i], strict=True):
                held, room = self.start[i], self.capacity[i] - sign * self.start[i]
                story = (
                    f"wheel {name} comes to {held + sign * most:.4g} of at most "
                    f"{self.capacity[i]:.4g} N m s"
                )
                still = most - spare[i] <= ROUNDING * self.capacity[i]
                if room < 0.0 or (room == 0.0 and not still):
                    raise NoSolutionError(
                        f"wheel {name} holds {held:.4g} N m s at the start, of at most "
                        f"{self.capacity[i]:.4g}, and any motion brings more; unload it first"
                    )
                found.append((float(most / room) if room else 0.0, story))
        return max(found)

    def story(self, load: Load) -> str:
        """Return what the wheels hold and give at most, and how that is known, in one sentence."""
        swing, torque, spare = self._taken(load)
        held = np.maximum(swing[0] + self.start, swing[1] - self.start)
        each = zip(self.names, held, torque, strict=True)
        words = [f"wheel {name} at most {h:.4g} N m s and {tau:.4g} N m" for name, h, tau in each]
        h, tau = spare.max(axis=1)
        return (
            f"{'; '.join(words)}: bounds between {len(load.t)} times included, {h:.2g} N m s and "
            f"{tau:.2g} N m of it"
        )

    def _taken(self, load: Load) -> tuple[Array, Array, Array]:
        """Return what wheels take of a load at most, bounds between its times included.

        Returns:
            (2, w) largest momenta on either side [N m s]; (w,) largest torques [N m]; (2, w) how
            much of momenta and torques is for the times between.
        """
        spare = np.outer(load.beyond, np.linalg.norm(self.shares, axis=1))
        taken = self.momenta(load.momentum) - self.start
        swing = np.array([taken.max(axis=0), -taken.min(axis=0)]) + spare[0]
        torque = np.abs(load.torque @ self.shares.T).max(axis=0) + spare[1]
        return swing, torque, spare
