"""Joint motions of a floating spacecraft at zero momentum: how its attitude and position change.

The system CM stays at rest, and the attitude follows equation (33c), w_0 = -D^-1 D_q dq. In
spacecraft axes the right-hand side depends on q only. Along a straight segment of joint space the
attitude therefore obeys an ordinary differential equation in one variable, T' = T [w(s)]x.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, overload

import numpy as np
import pinocchio as pin
from scipy.interpolate import PPoly

from spacearm.arrays import Array, ArrayLike
from spacearm.equations import turns
from spacearm.equations.turns import GAUSS, magnus
from spacearm.errors import UnsupportedError
from spacearm.mechanics.arm_kernels import ArmKernel
from spacearm.mechanics.jacobian import solve_locked
from spacearm.model.arm import Configuration, SpaceArm, kinematics, still_wheels
from spacearm.model.joints import joint_vector
from spacearm.signatures import checked

#: Largest joint motion [rad] or [m] of one integration step along a segment.
STEP = 0.05
#: Number of times between two samples, the ends included, at which joint rates are compared: those
#: of a quintic are zero at five times only if it rests.
RATES = 5


@checked
def move(cfg: Configuration, q: ArrayLike) -> Configuration:
    """Return the configuration after the joints have moved straight from cfg.q to q.

    The spacecraft floats at zero momentum. Its attitude is integrated by the fourth-order Magnus
    method (see `equations.turns`), which stays on the rotation group. The error falls with the
    fourth power of `STEP`; it is below 1e-8 rad per radian of joint motion for the catalogue's
    models.

    Args:
        cfg: Where the motion starts.
        q: (n,) where the joints end [rad] or [m].

    Returns:
        The configuration at q, with the spacecraft where it then is.

    Raises:
        ConfigurationError: q has the wrong shape or is not finite.
        UnsupportedError: The system or a wheel holds momentum.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.move(cfg, [0.5, 1.0]).base.translation.round(4)
        array([ 0.0029, -0.0074,  0.    ])
    """
    _at_rest(cfg)
    arm = cfg.arm
    dq = joint_vector(arm, q, "q") - cfg.q
    steps = max(1, math.ceil(np.abs(dq).max() / STEP))
    T = cfg.base.rotation
    for step in range(steps):
        at = (arm.at(cfg.q + (step + s) / steps * dq).A[3:, 3:] for s in GAUSS)
        w1, w2 = (-solve_locked(A[:, :3], A[:, 3:] @ dq) for A in at)  # -D^-1 D_q dq
        T = T @ pin.exp3(magnus(np, w1, w2, 1.0 / steps))
    return placed(cfg, cfg.q + dq, T)


class Walk(Sequence[Configuration]):
    """The configurations along straight joint segments, as `move` after `move` does.

    Each of them is computed when it is first asked for.

    Attributes:
        q: (m, n) joint positions.

    Args:
        start: The first configuration.
        q: (m, n) the ends of the segments, the first of them start.q.
        T: (m, 3, 3) the attitudes there, as of `attitudes`.
    """

    def __init__(self, start: Configuration, q: Array, T: Array) -> None:
        self.q, self._T, self._known = q, T, {0: start}

    def __len__(self) -> int:
        return len(self.q)

    @property
    def bases(self) -> Array:
        """(m, 7) poses of the spacecraft, as of `bases`."""
        return bases(self._known[0], self.q, self._T)

    @overload
    def __getitem__(self, i: int) -> Configuration: ...

    @overload
    def __getitem__(self, i: slice) -> list[Configuration]: ...

    def __getitem__(self, i: int | slice) -> Configuration | list[Configuration]:
        if isinstance(i, slice):
            return [self[k] for k in range(len(self))[i]]
        if (k := range(len(self))[i]) not in self._known:
            self._known[k] = placed(self._known[0], self.q[k], self._T[k])
        return self._known[k]


def walk(start: Configuration, Q: Array) -> Walk:
    """Return the configurations along straight joint segments Q (m, n) that begin at start.q."""
    return Walk(start, Q, attitudes(start, Q))


def attitudes(start: Configuration, Q: Array) -> Array:
    """Return the attitudes (m, 3, 3) of the spacecraft in `walk`."""
    _at_rest(start)
    dq = np.diff(Q, axis=0)
    steps = np.maximum(1, np.ceil(np.abs(dq).max(axis=1) / STEP)).astype(int)
    segment, last = np.repeat(np.arange(len(dq)), steps), np.cumsum(steps)
    step = np.arange(len(segment)) - np.repeat(last - steps, steps)
    rates, h = np.repeat(dq[segment, None], 2, axis=1), 1.0 / steps[segment]
    nodes = Q[segment, None] + ((step[:, None] + GAUSS) * h[:, None])[..., None] * rates
    T = chained(turns_of_spacecraft(start.arm, nodes, rates, h))
    return start.base.rotation @ np.concatenate((np.eye(3)[None], T))[np.append(0, last)]


def attitudes_over_time(start: Configuration, joints: PPoly, t: Array) -> Array:
    """Compute the attitude of a free-floating base while the joints follow a curve over time.

    The total momentum h of `start` is conserved, and its wheels keep the momentum h_w that they
    hold: in spacecraft axes w_0 = D^-1 (T^T h - h_w - D_q dq), which is (33c) without momentum.
    The Euler parameters are integrated by equation (36) with the classical Runge-Kutta method of
    fourth order, in steps in which joints and base move by about `STEP` at most.

    Args:
        start: The configuration at t[0], with momentum and wheels.
        joints: Joint positions (n,) over time [rad] or [m].
        t: (m,) times [s], increasing; kinks of the curve are at these times only.

    Returns:
        (m, 3, 3) attitudes.
    """
    arm, h = start.arm, start.momentum[3:]
    stored = start.base.rotation.T @ start.stored[3:]
    span = np.diff(t)
    within = t[:-1, None] + span[:, None] * np.linspace(0.0, 1.0, RATES)
    moved = np.abs(joints(within, 1)).max(axis=(1, 2)) * span
    least = np.linalg.eigvalsh(momenta(arm, joints(t[:-1]))[0])[:, 0]
    size = np.linalg.norm(h) + np.linalg.norm(stored)
    spin = size / least if size > 0.0 else np.zeros(len(span))  # at least |D^-1 (T^T h - h_w)|
    steps = np.maximum(1, np.ceil(np.maximum(moved, spin * span) / STEP)).astype(int)
    last = np.cumsum(steps)
    intervals = zip(t[:-1], t[1:], steps, strict=True)
    a = np.concatenate([np.linspace(begin, end, n, endpoint=False) for begin, end, n in intervals])
    b = np.append(a[1:], t[-1])
    nodes = np.stack((a, 0.5 * (a + b), np.nextafter(b, a)), axis=1)  # before a kink, not after
    D, D_q = momenta(arm, joints(nodes).reshape(-1, arm.n))
    arm_momentum = D_q @ joints(nodes, 1).reshape(-1, arm.n, 1)
    inverse = solve_locked(D, np.eye(3)).reshape(-1, 3, 3, 3)
    held = (stored + arm_momentum[..., 0]).reshape(-1, 3, 3)
    quaternions = [pin.Quaternion(start.base.rotation).coeffs()]
    for invs, taken, width in zip(inverse, held, b - a, strict=True):

        def rate(node: int, x: Array) -> Array:
            R = pin.Quaternion(x).normalized().matrix()
            w = invs[node] @ (R.T @ h - taken[node])  # noqa: B023
            return 0.5 * np.append(np.cross(x[:3], w) + x[3] * w, -x[:3] @ w)  # (36)

        x = quaternions[-1]
        k1 = rate(0, x)
        k2 = rate(1, x + 0.5 * width * k1)
        k3 = rate(1, x + 0.5 * width * k2)
        k4 = rate(2, x + width * k3)
        x = x + width / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        quaternions.append(x / np.linalg.norm(x))
    return np.array([pin.Quaternion(quaternions[i]).matrix() for i in np.append(0, last)])


def placed(start: Configuration, q: Array, T: Array) -> Configuration:
    """Return the configuration at q (n,) and attitude T (3, 3) with the system CM of `start`."""
    attitude = pin.Quaternion(T).normalized().matrix()  # without the rounding of many products
    return kinematics(start.arm, q.copy(), pin.SE3(attitude, np.zeros(3)), start.com)


def bases(start: Configuration, Q: Array, T: Array) -> Array:
    """Return poses [position [m], quaternion] (m, 7) of the spacecraft in `placed`, at m rows."""
    arm, model = start.arm, start.arm.model
    data, full = arm.borrow(), np.zeros(model.nq)
    found = np.empty((len(Q), 7))
    for pose, q, attitude in zip(found, Q, T, strict=True):
        full[3:7] = pin.Quaternion(attitude).normalized().coeffs()
        full[7:] = arm.all_joints(q)
        pose[:3] = start.com - pin.centerOfMass(model, data, full, False)
        pose[3:] = full[3:7]
    arm.give_back(data)
    return found


def _at_rest(cfg: Configuration) -> None:
    """Refuse momentum, of the system or its wheels."""
    why = "the spacecraft then turns with time, not with the joints alone"
    still_wheels(cfg, why)
    if cfg.momentum.any():
        raise UnsupportedError(
            f"{cfg.arm.name} has momentum {cfg.momentum.tolist()}, and {why}; use sa.simulate, or "
            "leave momentum= out of arm.at"
        )


class Reactions(NamedTuple):
    """J*, the connection and the tip pose of m configurations, in spacecraft axes.

    Attributes:
        J: (m, 6, n) J* [m/rad], [1].
        A: (m, 3, n) the connection -D^-1 D_q of (33c): w_0 = A dq.
        r: (m, 3) the tip from the system CM [m].
        R: (m, 3, 3) attitude of the tip.
    """

    J: Array
    A: Array
    r: Array
    R: Array


class Turns(NamedTuple):
    """Turns of the spacecraft in m intervals, and how they depend on the curve of the joints.

    Attributes:
        T: (m, 3, 3) rotations from the axes at the end of each interval to those at its start.
        effects: (m, 2, 2, 3, n) how the axes at the end turn with q and with dq at each of its two
            Gauss points.
        J: (m, 2, 6, n) J* at these.
        A: (m, 3, n) the connection at the second.
        r: (m, 3) the tip from the system CM there [m].
        R: (m, 3, 3) attitude of the tip there.
    """

    T: Array
    effects: Array
    J: Array
    A: Array
    r: Array
    R: Array


def reactions(arm: SpaceArm, Q: Array) -> Reactions:
    """Compute J*, the connection and the pose of the first tip at Q (m, n)."""
    kernel = ArmKernel([arm], "free-floating", turns.reactions, rows=len(Q))
    return Reactions(*kernel({"q": Q}))


def momenta(arm: SpaceArm, Q: Array) -> tuple[Array, Array]:
    """Compute D (m, 3, 3) and D_q (m, 3, n) of `turns.momenta` at Q (m, n), spacecraft axes."""
    kernel = ArmKernel([arm], "free-floating", turns.momenta, rows=len(Q))
    D, D_q = kernel({"q": Q})
    return np.asarray(D), np.asarray(D_q)


def turns_of_spacecraft(arm: SpaceArm, Q: Array, rates: Array, h: Array) -> Array:
    """Compute the turns (m, 3, 3) of the spacecraft in intervals without momentum.

    Args:
        arm: The arm.
        Q: (m, 2, n) joint positions at the Gauss points of each interval.
        rates: (m, 2, n) their derivatives by the curve's parameter.
        h: (m,) lengths of the intervals.
    """
    kernel = ArmKernel([arm], "free-floating", turns.turn, rows=len(h))
    return np.asarray(kernel({"q": Q, "dq": rates, "h": h}))


def turns_and_effects(arm: SpaceArm, Q: Array, rates: Array, h: Array) -> Turns:
    """Compute `turns_of_spacecraft`, and how they depend on the curve."""
    kernel = ArmKernel([arm], "free-floating", turns.turn_and_effects, rows=len(h))
    return Turns(*kernel({"q": Q, "dq": rates, "h": h}))


def chained(T: Array) -> Array:
    """Return the products T_0 T_1 ... T_i of rotations (..., m, 3, 3), for each i."""
    found, m = T.copy(), T.shape[-3]
    if m > 1:  # those of pairs are every second one of them
        found[..., 1::2, :, :] = chained(T[..., : m - 1 : 2, :, :] @ T[..., 1::2, :, :])
        found[..., 2::2, :, :] = found[..., 1 : m - 1 : 2, :, :] @ T[..., 2::2, :, :]
    return found


def carried_along(cfg: Configuration, rows: int) -> dict[str, Any]:
    """Return momentum (rows, 6) and wheels (rows, w) that stay what they are, as `Drifting` has."""
    kept = {"momentum": cfg.momentum, "wheels": cfg.wheels}
    return {name: np.tile(value, (rows, 1)) for name, value in kept.items()}


def samples(cfgs: Sequence[Configuration]) -> dict[str, Any]:
    """Return q (m, n) and base (m, 7) of configurations, as `Motion` has them."""
    if isinstance(cfgs, Walk):
        return {"q": cfgs.q.copy(), "base": cfgs.bases}
    base = [pin.SE3ToXYZQUAT(cfg.base) for cfg in cfgs]
    return {"q": np.array([cfg.q for cfg in cfgs]), "base": np.array(base)}
