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

from spacearm.arrays import Array
from spacearm.configuration import LWA, Configuration, joint_vector
from spacearm.errors import ConfigurationError, unknown
from spacearm.jacobian import FREE_TWIST, BaseMode
from spacearm.momentum import momentum_vector

Wrenches = Mapping[str, npt.ArrayLike]
"""Link name -> (6,) [force [N]; torque [N m]] at the origin of the link's frame, inertial axes."""


class Dynamics(NamedTuple):
    """What torques do, or take.

    Attributes:
        ddq: (n,) joint accelerations [rad/s^2] or [m/s^2].
        tau: (n,) joint torques [N m] or forces [N].
        base: (6,) acceleration of the spacecraft frame's origin, [linear [m/s^2]; angular
            [rad/s^2]], inertial axes.
        reaction: (6,) wrench on the spacecraft that holds what is held, [force [N]; torque [N m]]
            at the origin of its frame, inertial axes: the torque that wheels or jets must give to
            an attitude-controlled one; zero where nothing is held.
    """

    ddq: Array
    tau: Array
    base: Array
    reaction: Array


def generalized_inertia(cfg: Configuration, base: BaseMode = "free-floating") -> Array:
    """(n, n) H*, the inertia that the joints feel; see the module's docstring."""
    f = _free(base)
    M = _mass_matrix(cfg)
    H: Array = M[6:, 6:] - M[6:, :f] @ np.linalg.solve(M[:f, :f], M[:f, 6:])
    return 0.5 * (H + H.T)


def forward_dynamics(
    cfg: Configuration,
    dq: npt.ArrayLike,
    tau: npt.ArrayLike,
    *,
    base: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
    wrenches: Wrenches | None = None,
) -> Dynamics:
    """The accelerations under joint torques.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].
        tau: (n,) joint torques [N m] or forces [N].
        base: What the spacecraft does; see `generalized_jacobian`.
        momentum: (6,) [linear; angular about the system CM], inertial axes; zero if None. What is
            held takes no part: of an attitude-controlled spacecraft's only the linear one counts.
        wrenches: External wrenches on links (contacts, thrusters).

    Raises:
        ConfigurationError: An argument has the wrong shape, is not finite or names no link.
    """
    f = _free(base)
    tau = joint_vector(cfg.arm, tau, "tau")
    M, c = _terms(cfg, dq, base, momentum, wrenches)
    H = M[6:, 6:] - M[6:, :f] @ np.linalg.solve(M[:f, :f], M[:f, 6:])
    c_star = c[6:] - M[6:, :f] @ np.linalg.solve(M[:f, :f], c[:f])
    ddq = np.linalg.solve(H, tau - c_star)
    return _dynamics(cfg, ddq, M, c, f, dq, base, momentum)


def inverse_dynamics(
    cfg: Configuration,
    dq: npt.ArrayLike,
    ddq: npt.ArrayLike,
    *,
    base: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
    wrenches: Wrenches | None = None,
) -> Dynamics:
    """The joint torques that accelerations take, the spacecraft moving as it does.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].
        ddq: (n,) joint accelerations [rad/s^2] or [m/s^2].
        base: As in `forward_dynamics`.
        momentum: As in `forward_dynamics`.
        wrenches: As in `forward_dynamics`.
    """
    ddq = joint_vector(cfg.arm, ddq, "ddq")
    M, c = _terms(cfg, dq, base, momentum, wrenches)
    return _dynamics(cfg, ddq, M, c, _free(base), dq, base, momentum)


def kinetic_energy(
    cfg: Configuration,
    dq: npt.ArrayLike,
    *,
    base: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
) -> float:
    """The kinetic energy of all bodies [J]; arguments as in `forward_dynamics`."""
    v = _velocity(cfg, dq, base, momentum)
    return float(0.5 * v @ _mass_matrix(cfg) @ v)


def spacecraft_twist(
    cfg: Configuration,
    dq: npt.ArrayLike,
    base: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
) -> Array:
    """(6,) twist of the spacecraft, inertial axes, whatever it does; see `forward_dynamics`."""
    return _turned(cfg, _velocity(cfg, dq, base, momentum)[:6])


def _free(base: str) -> int:
    if base not in FREE_TWIST:
        raise ConfigurationError(unknown("base", base, FREE_TWIST))
    return FREE_TWIST[base]


def _turned(cfg: Configuration, twist: Array) -> Array:
    """A twist or wrench at the spacecraft's origin from its axes into inertial ones."""
    turned: Array = (cfg.base.rotation @ twist.reshape(2, 3).T).T.ravel()
    return turned


def _velocity(
    cfg: Configuration, dq: npt.ArrayLike, base: BaseMode, momentum: npt.ArrayLike | None
) -> Array:
    """(6 + n,) the spacecraft's twist in its own axes, as momentum demands, and the joint rates."""
    f, dq = _free(base), joint_vector(cfg.arm, dq, "dq")
    v = np.concatenate((np.zeros(6), dq))
    h = momentum_vector(momentum) - cfg.A[:, 6:] @ dq
    v[:f] = np.linalg.solve(cfg.A[:f, :f], h[:f])
    return v


def _mass_matrix(cfg: Configuration) -> Array:
    """(6 + n, 6 + n) M."""
    arm = cfg.arm
    data = arm.borrow()
    M = np.array(pin.crba(arm.model, data, cfg.full_at_origin))
    arm.give_back(data)
    M = np.triu(M) + np.triu(M, 1).T
    return M if arm.coupling is None else arm.project(arm.project(M).T)


def _terms(
    cfg: Configuration,
    dq: npt.ArrayLike,
    base: BaseMode,
    momentum: npt.ArrayLike | None,
    wrenches: Wrenches | None,
) -> tuple[Array, Array]:
    """M and c, external wrenches included, of M (dv_b, ddq) + c = (reaction, tau)."""
    arm = cfg.arm
    v = _velocity(cfg, dq, base, momentum)
    full = np.concatenate((v[:6], arm.all_rates(v[6:])))
    still = np.zeros_like(full)
    data = arm.borrow()
    c = np.array(pin.rnea(arm.model, data, cfg.full_at_origin, full, still))
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
    arm.give_back(data)
    return _mass_matrix(cfg), c


def _dynamics(
    cfg: Configuration,
    ddq: Array,
    M: Array,
    c: Array,
    f: int,
    dq: npt.ArrayLike,
    base: BaseMode,
    momentum: npt.ArrayLike | None,
) -> Dynamics:
    """All of the motion once the joint accelerations are known."""
    a = np.concatenate((np.zeros(6), ddq))
    a[:f] = -np.linalg.solve(M[:f, :f], M[:f, 6:] @ ddq + c[:f])
    force = M @ a + c
    force[:f] = 0.0
    v = _velocity(cfg, dq, base, momentum)
    a[:3] += np.cross(v[3:6], v[:3])  # from spatial to classical acceleration
    return Dynamics(ddq, force[6:], _turned(cfg, a[:6]), _turned(cfg, force[:6]))
