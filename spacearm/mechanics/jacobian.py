"""The generalized Jacobian J*, the fixed-base Jacobian, and their derivatives.

Zero momentum, A_b v_b + A_q dq = 0, gives the spacecraft's twist v_b = -X dq, X = A_b^-1 A_q.
The tip moves with J_b v_b + J_q dq = J* dq, hence

    J* = J_q - J_b A_b^-1 A_q        (equations (1) and (35) by another route).

Where the spacecraft is held, only the part of v_b that is free takes part: all six components
when it floats, the three linear ones when its attitude is controlled, none when it is fixed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, unknown
from spacearm.mechanics.momentum import base_velocity, momentum_vector
from spacearm.model.configuration import Configuration
from spacearm.model.frames import LWA
from spacearm.model.joints import joint_vector
from spacearm.model.mode import BaseMode, free_components


def generalized_jacobian(cfg: Configuration, *, mode: BaseMode = "free-floating") -> Array:
    """J* with [rdot_E; w_E] = J* dq at zero momentum, equation (35).

    Papadopoulos & Dubowsky, J. Dyn. Sys. Meas. Control 115(1), 44-52 (1993),
    DOI 10.1115/1.2897406; Umetani & Yoshida, IEEE Trans. Robot. Autom. 5(3), 303-314 (1989),
    DOI 10.1109/70.34766. `Barycentric.generalized_jacobian` computes the same by the paper's
    own equations.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does: "free-floating" (linear and angular momentum zero),
            "attitude-controlled" (w_0 = 0, linear momentum zero: section VI of the paper) or
            "fixed" (the earth-bound arm).

    Returns:
        (6, n) J*, rows [linear [m/rad]; angular], inertial axes, for the tip frame's origin. Of
        several tips (6 tips, n), stacked in the order of `arm.tips`.

    Raises:
        ConfigurationError: `mode` is none of the three.
    """
    f = free_components(mode)
    A, J = cfg.A, cfg.J
    return J[:, 6:] - J[:, :f] @ np.linalg.solve(A[:f, :f], A[:f, 6:])


def fixed_base_jacobian(cfg: Configuration) -> Array:
    """J_q, the Jacobian of the same arm on a base that does not move.

    Returns:
        (6, n) Jacobian, rows [linear; angular], inertial axes, for the tip frame's origin.
    """
    return generalized_jacobian(cfg, mode="fixed")


class PrescribedMotion(NamedTuple):
    """How the tip moves with some joints while others move as prescribed: J dq + drift.

    Attributes:
        joints: The other joints, whose rates dq are free, in the model's order.
        jacobian: (6, m) their J, rows [linear; angular], inertial axes; stacked for several tips.
        drift: (6,) the tip's twist while they rest, from the prescribed rates and the momentum.
    """

    joints: tuple[str, ...]
    jacobian: Array
    drift: Array


def prescribed_motion(
    cfg: Configuration,
    rates: Mapping[str, float],
    *,
    mode: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
) -> PrescribedMotion:
    """J* of some joints with the rates of the others prescribed, such as a second arm's.

    The columns of J* part in two, and J* dq + J_b A_b^-1 h is the tip's twist with momentum h.

    Args:
        cfg: The configuration.
        rates: Rates [rad/s] or [m/s] of the prescribed joints by name; zero for one that rests.
        mode: What the spacecraft does; see `generalized_jacobian`.
        momentum: (6,) momentum, zero if None; what a held spacecraft takes up is left out.

    Raises:
        ConfigurationError: A joint does not exist, or a value is not finite.
    """
    arm, f = cfg.arm, free_components(mode)
    for name in rates:
        if name not in arm.joint_names:
            raise ConfigurationError(f"rates: {unknown('joint', name, arm.joint_names)}")
    dq = joint_vector(arm, [rates.get(name, 0.0) for name in arm.joint_names], "the rate")
    J = generalized_jacobian(cfg, mode=mode)
    h = (momentum_vector(momentum) - cfg.stored)[:f]
    free = [name not in rates for name in arm.joint_names]
    names = tuple(name for name in arm.joint_names if name not in rates)
    drift = J @ dq + cfg.J[:, :f] @ np.linalg.solve(cfg.A[:f, :f], h)
    return PrescribedMotion(names, J[:, free], drift)


def generalized_jacobian_derivative(
    cfg: Configuration, *, mode: BaseMode = "free-floating"
) -> Array:
    """dJ*/dq_j for every joint j, the spacecraft's pose held.

    From dA/dq_j and dJ/dq_j, which Pinocchio computes analytically, by differentiating
    J* = J_q - J_b X with A_b X = A_q.

    Returns:
        (n, 6, n): entry j is the partial derivative of J* with respect to q_j.
    """
    f = free_components(mode)
    A, J = cfg.A, cfg.J
    dA, dJ = _partial_derivatives(cfg)
    X = np.linalg.solve(A[:f, :f], A[:f, 6:])
    dX = np.linalg.solve(A[:f, :f], dA[:, :f, 6:] - dA[:, :f, :f] @ X)
    return dJ[..., 6:] - dJ[..., :f] @ X - J[:, :f] @ dX


def generalized_jacobian_rate(
    cfg: Configuration, dq: npt.ArrayLike, momentum: npt.ArrayLike | None = None
) -> Array:
    """dJ*/dt of the free-floating system along the motion with joint rates dq.

    The spacecraft moves as momentum conservation demands, so that the rate includes the turning
    of J* = diag(T_0, T_0) 0J*(q) with the attitude.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].
        momentum: (6,) momentum, zero if None; see `base_velocity`.

    Returns:
        (6, n) time derivative of J*, inertial axes.
    """
    dq = joint_vector(cfg.arm, dq, "dq")
    w_0 = pin.skew(base_velocity(cfg, dq, momentum)[3:])
    turning = np.kron(np.eye(2 * len(cfg.arm.tips)), w_0) @ generalized_jacobian(cfg)
    return np.tensordot(dq, generalized_jacobian_derivative(cfg), axes=1) + turning


def _partial_derivatives(cfg: Configuration) -> tuple[Array, Array]:
    """(n, ., 6 + n) each: dA/dq_j and dJ/dq_j, as the rates at dq = e_j with the base at rest."""
    arm, full = cfg.arm, cfg.full_at_origin
    dA, dJ = (np.empty((arm.n, *matrix.shape)) for matrix in (cfg.A, cfg.J))
    data = arm.borrow()
    for j, dq in enumerate(np.eye(arm.n)):
        v = np.concatenate((np.zeros(6), arm.all_rates(dq)))
        dA[j] = arm.project(pin.computeCentroidalMapTimeVariation(arm.model, data, full, v))
        pin.computeJointJacobiansTimeVariation(arm.model, data, full, v)
        rates = [
            pin.getFrameJacobianTimeVariation(arm.model, data, frame, LWA)
            for frame in arm.tip_frames
        ]
        dJ[j] = arm.project(np.vstack(rates))
    arm.give_back(data)
    return dA, dJ
