"""Reaction: how the spacecraft turns and shifts while the joints move, at zero momentum.

The system CM stays where it is, and the attitude follows equation (33c), w_0 = -D^-1 D_q dq. In
spacecraft axes the right-hand side depends on q alone, so that along a straight segment of joint
space the attitude is an ordinary differential equation in one variable, T' = T [w(s)]x.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.model.configuration import Configuration, still_wheels
from spacearm.model.joints import joint_vector

STEP = 0.05
"""Largest joint motion [rad] or [m] of one step of the integration along a segment."""


def move(cfg: Configuration, q: npt.ArrayLike) -> Configuration:
    """The configuration after the joints have moved straight from cfg.q to q.

    The spacecraft floats without momentum. Integrated by the fourth-order Magnus method with two
    Gauss points a step (Iserles & Norsett, Phil. Trans. R. Soc. A 357, 983-1019 (1999),
    DOI 10.1098/rsta.1999.0362), which stays on the rotation group; its error falls with the
    fourth power of `STEP` and is below 1e-8 rad per radian of joint motion for the catalogue.

    Args:
        cfg: Where the motion starts.
        q: (n,) where the joints end [rad] or [m].

    Raises:
        ConfigurationError: q has the wrong shape or is not finite.
        UnsupportedError: The wheels hold momentum.
    """
    still_wheels(cfg, "the spacecraft then turns with time, not with the joints alone")
    arm = cfg.arm
    dq = joint_vector(arm, q, "q") - cfg.q
    steps = max(1, math.ceil(np.abs(dq).max() / STEP))
    T = cfg.base.rotation
    for step in range(steps):
        w1, w2 = (
            _attitude_rate(arm.at(cfg.q + (step + s) / steps * dq), dq / steps) for s in GAUSS
        )
        T = T @ pin.exp3((w1 + w2) / 2.0 + math.sqrt(3.0) / 12.0 * np.cross(w1, w2))
    attitude = pin.Quaternion(T).normalized().matrix()
    return arm.at(cfg.q + dq, base=pin.SE3(attitude, np.zeros(3))).centred(cfg.com)


GAUSS = (0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0)


def quaternion_rate(quaternion: Array, w: Array) -> Array:
    """(4,) rate of the attitude as a quaternion xyzw under w in inertial axes, equation (36)."""
    e, n = quaternion[:3], quaternion[3]
    return 0.5 * np.append(n * w - pin.skew(e) @ w, -e @ w)


def _attitude_rate(cfg: Configuration, dq: Array) -> Array:
    """(3,) w_0 in spacecraft axes; A's lower left block is zero: w_0 = -D^-1 D_q dq."""
    return -np.linalg.solve(cfg.A[3:, 3:6], cfg.A[3:, 6:] @ dq)
