"""Momentum: the centroidal momentum matrix and what its conservation does to the spacecraft."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, plain
from spacearm.errors import ConfigurationError
from spacearm.model.configuration import Configuration
from spacearm.model.joints import joint_vector


class MomentumMatrix(NamedTuple):
    """h = A_b v_b + A_q dq: [linear; angular about the system CM] momentum, inertial axes.

    Wheels that spin add what they hold, `Configuration.stored`.

    Attributes:
        A_b: (6, 6), acts on the spacecraft's twist in inertial axes [kg, kg m, kg m^2].
        A_q: (6, n), acts on the joint rates.
    """

    A_b: Array
    A_q: Array

    def to_dict(self) -> dict[str, Any]:
        """Both blocks as nested lists."""
        return {name: plain(block) for name, block in self._asdict().items()}


def momentum_matrix(cfg: Configuration) -> MomentumMatrix:
    """The centroidal momentum matrix split in its base and joint blocks.

    The spacecraft's twist v_b is that of the spacecraft frame's origin, in inertial axes.
    A_b = [[M 1, -M [c]x], [0, I_c]] with c from the spacecraft origin to the system CM and I_c
    the locked inertia about the system CM, so that det(A_b) = M^3 det(D) with D of (33c).

    Source: theory of the centroidal momentum matrix in Orin, Goswami & Lee, Auton. Robots 35,
    161-176 (2013), DOI 10.1007/s10514-013-9341-4.
    """
    R = cfg.base.rotation
    A = cfg.A
    base = np.hstack((A[:, :3] @ R.T, A[:, 3:6] @ R.T))
    base.flags.writeable = False
    return MomentumMatrix(base, A[:, 6:])


def base_velocity(
    cfg: Configuration, dq: npt.ArrayLike, momentum: npt.ArrayLike | None = None
) -> Array:
    """The spacecraft's twist that keeps the momentum: v_b = A_b^-1 (h - h_w - A_q dq).

    h_w is what the wheels hold (`Configuration.stored`): h is the momentum of all.

    With zero momentum its angular part is equation (33c) of Papadopoulos & Dubowsky (1993),
    w_0 = -D^-1 D_q dq.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].
        momentum: (6,) h = [linear [kg m/s]; angular about the system CM [kg m^2/s]], inertial
            axes; zero if None.

    Returns:
        (6,) twist [linear [m/s]; angular [rad/s]] of the spacecraft frame's origin, inertial axes.

    Raises:
        ConfigurationError: dq or momentum has the wrong shape or is not finite.
    """
    A_b, A_q = momentum_matrix(cfg)
    h = momentum_vector(momentum) - cfg.stored
    return np.linalg.solve(A_b, h - A_q @ joint_vector(cfg.arm, dq, "dq"))


def momentum_vector(momentum: npt.ArrayLike | None) -> Array:
    """A checked (6,) momentum; zero if None."""
    try:
        h = np.zeros(6) if momentum is None else np.array(momentum, dtype=np.float64)
    except (TypeError, ValueError):
        h = np.empty(0)
    if h.shape != (6,) or not np.isfinite(h).all():
        raise ConfigurationError(
            f"momentum must be 6 finite numbers [linear; angular about the CM]; got {momentum!r}"
        )
    return h
