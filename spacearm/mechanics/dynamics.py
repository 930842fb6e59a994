"""Dynamics: how joint torques move a floating arm, and what torques a motion takes.

With the spacecraft's twist v_b and M = [[M_bb, M_bq], [M_qb, M_qq]] the equations of motion are
M (dv_b, ddq) + c = (F_b, tau), without gravity. Where momentum decides the spacecraft's motion,
dv_b is eliminated and the *reduced form*

    H*(q) ddq + c*(q, dq) = tau,   H* = M_qq - M_qb M_bb^-1 M_bq = M_qq - A_q^T I_c^-1 A_q

is left, I_c = diag(M 1, D): the inertia that the joints feel, as in Papadopoulos & Dubowsky, On the
nature of control algorithms for free-floating space manipulators (IEEE Trans. Robot. Autom., 1991).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.linalg.lapack import dgesv, dposv

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, unknown
from spacearm.mechanics.momentum import momentum_vector
from spacearm.model.configuration import Configuration
from spacearm.model.frames import LWA
from spacearm.model.joints import joint_vector
from spacearm.model.mode import BaseMode, free_components

Wrenches = Mapping[str, npt.ArrayLike]
"""Link name -> (6,) [force [N]; torque [N m]] at the origin of the link's frame, inertial axes."""


class Dynamics(NamedTuple):
    """What torques do, or take.

    Attributes:
        ddq: (n,) joint accelerations [rad/s^2] or [m/s^2].
        tau: (n,) joint torques [N m] or forces [N].
        base_acceleration: (6,) acceleration of the spacecraft frame's origin, [linear [m/s^2];
            angular [rad/s^2]], inertial axes.
        reaction: (6,) wrench on the spacecraft that holds what is held, [force [N]; torque [N m]]
            at the origin of its frame, inertial axes: the torque that wheels or jets must give to
            an attitude-controlled one; zero where nothing is held.
        twist: (6,) twist of the spacecraft now, inertial axes.
    """

    ddq: Array
    tau: Array
    base_acceleration: Array
    reaction: Array
    twist: Array


def generalized_inertia(cfg: Configuration, *, mode: BaseMode = "free-floating") -> Array:
    """(n, n) H*, the inertia that the joints feel; see the module's docstring."""
    f = free_components(mode)
    M = mass_matrix(cfg)
    H: Array = M[6:, 6:] - M[6:, :f] @ _solve(M[:f, :f], M[:f, 6:])
    return 0.5 * (H + H.T)


def forward_dynamics(
    cfg: Configuration,
    dq: npt.ArrayLike,
    tau: npt.ArrayLike,
    *,
    mode: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
    wrenches: Wrenches | None = None,
) -> Dynamics:
    """The accelerations under joint torques.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].
        tau: (n,) joint torques [N m] or forces [N].
        mode: What the spacecraft does; see `generalized_jacobian`.
        momentum: (6,) [linear; angular about the system CM], inertial axes; zero if None. What is
            held takes no part: of an attitude-controlled spacecraft's only the linear one counts.
        wrenches: External wrenches on links (contacts, thrusters).

    Wheels keep their rates relative to the links that carry them, by their motors.

    Raises:
        ConfigurationError: An argument has the wrong shape, is not finite or names no link.
    """
    f = free_components(mode)
    tau = joint_vector(cfg.arm, tau, "tau")
    v = generalized_velocity(cfg, dq, mode, momentum)
    M, c = mass_matrix(cfg), _bias(cfg, v, wrenches)
    X = _eliminated(M, c, f)
    H = M[6:, 6:] - M[6:, :f] @ X[:, :-1]
    c_star = c[6:] - M[6:, :f] @ X[:, -1]
    return _dynamics(cfg, v, M, c, X, _solve(H, tau - c_star))


def inverse_dynamics(
    cfg: Configuration,
    dq: npt.ArrayLike,
    ddq: npt.ArrayLike,
    *,
    mode: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
    wrenches: Wrenches | None = None,
) -> Dynamics:
    """The joint torques that accelerations take, the spacecraft moving as it does.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].
        ddq: (n,) joint accelerations [rad/s^2] or [m/s^2].
        mode: As in `forward_dynamics`.
        momentum: As in `forward_dynamics`.
        wrenches: As in `forward_dynamics`.
    """
    ddq = joint_vector(cfg.arm, ddq, "ddq")
    v = generalized_velocity(cfg, dq, mode, momentum)
    M, c = mass_matrix(cfg), _bias(cfg, v, wrenches)
    return _dynamics(cfg, v, M, c, _eliminated(M, c, free_components(mode)), ddq)


def kinetic_energy(
    cfg: Configuration,
    dq: npt.ArrayLike,
    *,
    mode: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
) -> float:
    """The kinetic energy of all bodies [J], without the spin of wheels.

    Arguments as in `forward_dynamics`.
    """
    v = generalized_velocity(cfg, dq, mode, momentum)
    return float(0.5 * v @ mass_matrix(cfg) @ v)


def spacecraft_twist(
    cfg: Configuration,
    dq: npt.ArrayLike,
    mode: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
) -> Array:
    """(6,) twist of the spacecraft, inertial axes, whatever it does; see `forward_dynamics`."""
    return in_inertial_axes(cfg, generalized_velocity(cfg, dq, mode, momentum)[:6])


def in_inertial_axes(cfg: Configuration, twists: Array) -> Array:
    """(..., 6) twists or wrenches at the spacecraft's origin from its axes into inertial ones."""
    turned: Array = twists.reshape(-1, 3) @ cfg.base.rotation.T
    return turned.reshape(twists.shape)


def generalized_velocity(
    cfg: Configuration, dq: npt.ArrayLike, mode: BaseMode, momentum: npt.ArrayLike | None
) -> Array:
    """(6 + n,) the spacecraft's twist in its own axes, as momentum demands, and the joint rates."""
    f, dq = free_components(mode), joint_vector(cfg.arm, dq, "dq")
    v = np.concatenate((np.zeros(6), dq))
    h = momentum_vector(momentum) - cfg.stored - cfg.A[:, 6:] @ dq
    v[:f] = dgesv(cfg.A[:f, :f], h[:f])[2] if f else 0.0
    return v


def mass_matrix(cfg: Configuration) -> Array:
    """(6 + n, 6 + n) M."""
    arm = cfg.arm
    data = arm.borrow()
    upper = np.triu(pin.crba(arm.model, data, cfg.full_at_origin))
    arm.give_back(data)
    M = upper + upper.T
    np.fill_diagonal(M, upper.diagonal())
    return M if arm.coupling is None else arm.project(arm.project(M).T)


def _bias(cfg: Configuration, v: Array, wrenches: Wrenches | None) -> Array:
    """(6 + n,) c, external wrenches included, of M (dv_b, ddq) + c = (reaction, tau)."""
    arm = cfg.arm
    full = np.concatenate((v[:6], arm.all_rates(v[6:])))
    data = arm.borrow()
    c = np.array(pin.rnea(arm.model, data, cfg.full_at_origin, full, np.zeros_like(full)))
    c = c if arm.coupling is None else arm.project(c[None])[0]
    for link, values in (wrenches or {}).items():
        if link not in arm.tree.links:
            raise ConfigurationError(unknown("link", link, arm.tree.links))
        wrench = np.array(values, dtype=np.float64)
        if wrench.shape != (6,) or not np.isfinite(wrench).all():
            raise ConfigurationError(f"the wrench on {link!r} is {values!r}; give 6 finite numbers")
        frame = arm.model.getFrameId(link, pin.BODY)
        J = pin.computeFrameJacobian(arm.model, data, cfg.full_at_origin, frame, LWA)
        c = c - arm.project(J).T @ wrench
    for wheel, spin in zip(arm.wheels, cfg.wheels, strict=True):
        frame, q = wheel.frame, cfg.full_at_origin
        J = pin.computeFrameJacobian(arm.model, data, q, frame, pin.LOCAL)[3:]
        c = c + arm.project(J).T @ np.cross(J @ full, spin * wheel.axis)  # the wheel's gyration
    arm.give_back(data)
    return c


def _eliminated(M: Array, c: Array, f: int) -> Array:
    """(f, n + 1) X = M_bb^-1 [M_bq, c_b], with which dv_b = -X (ddq, 1)."""
    return _solve(M[:f, :f], np.column_stack((M[:f, 6:], c[:f])))


def _solve(M: Array, b: Array) -> Array:
    """M^-1 b of a symmetric positive definite M, by Cholesky's factors."""
    return dposv(M, b)[1] if len(M) else b


def _dynamics(cfg: Configuration, v: Array, M: Array, c: Array, X: Array, ddq: Array) -> Dynamics:
    """All of the motion once the joint accelerations are known."""
    f = len(X)
    a = np.concatenate((np.zeros(6), ddq))
    a[:f] = -X @ np.append(ddq, 1.0)
    force = M @ a + c
    force[:f] = 0.0
    a[:3] += pin.skew(v[3:6]) @ v[:3]  # from spatial to classical acceleration
    acceleration, reaction, twist = in_inertial_axes(cfg, np.array((a[:6], force[:6], v[:6])))
    return Dynamics(ddq, force[6:], acceleration, reaction, twist)
