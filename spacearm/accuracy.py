"""Accuracy: how many digits of J* and sigma_min the arithmetic leaves.

Positions, momenta and inertias are sums of rounded terms, and where the terms cancel, as in the
inertia of a heavy payload about the spacecraft, taken to the system CM, digits are lost. With
bounds E for these errors from the size of the terms, A_b X = A_q and J* = J_q - J_b X give

    |dX|  <= (1 - |A_b^-1| E_b)^-1 |A_b^-1| (E_q + E_b |X|)
    |dJ*| <= E_Jq + E_Jb (|X| + |dX|) + |J_b A_b^-1| (E_q + E_b (|X| + |dX|))

and Weyl's inequality |d sigma| <= ||dJ*||. |.| is the matrix of 2-norms of the linear and angular
3-vectors and 3 x 3 blocks: units are not mixed, and nothing depends on the attitude. Perturbation
of linear systems: Higham, Accuracy and Stability of Numerical Algorithms (2002), section 7.2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spacearm.arrays import Array
from spacearm.configuration import Configuration
from spacearm.jacobian import BaseMode, free_components, generalized_jacobian

ROUNDING = 4.0 * float(np.finfo(np.float64).eps)
"""Relative error of a term for each joint that it is carried across."""


class ErrorBars(NamedTuple):
    """How far computed numbers can be from those of exact arithmetic.

    Of the arithmetic only: masses, lengths and joint positions count as exact, although they are
    known to far fewer digits.

    Attributes:
        sigma: Bound for every singular value of the task Jacobian, in the same unit. A sigma_min
            below it may be an exact zero.
        jacobian: (6, n) bounds for the entries of J*, rows as in `generalized_jacobian`.
    """

    sigma: float
    jacobian: Array


def error_bars(cfg: Configuration, base: BaseMode = "free-floating") -> ErrorBars:
    """Error bars of `generalized_jacobian` and of the singular values in `singularity`.

    See the module's docstring. Infinite where rounding alone could make A_b singular.

    Args:
        cfg: The configuration.
        base: What the spacecraft does; see `generalized_jacobian`.

    Raises:
        ConfigurationError: `base` is none of the three.
    """
    f = free_components(base)
    E_b, E_q, E_Jb, E_Jq, rounding = _rounding(cfg)
    free = slice(f // 3)
    E_b, E_q, E_Jb = E_b[free, free], E_q[free], E_Jb[:, free]
    inverse = np.linalg.inv(cfg.A[:f, :f])
    A_inv, X = _norms(inverse, 3), _norms(inverse @ cfg.A[:f, 6:], 1)
    G = A_inv @ E_b
    if np.abs(np.linalg.eigvals(G)).max(initial=0.0) >= 1.0:
        return ErrorBars(np.inf, np.full_like(cfg.J[:, 6:], np.inf))
    X = X + np.linalg.solve(np.eye(len(G)) - G, A_inv @ (E_q + E_b @ X))
    E = E_Jq + E_Jb @ X + _norms(cfg.J[:, :f] @ inverse, 3) @ (E_q + E_b @ X)
    task = cfg.arm.task
    scale = np.zeros((len(E), 1))
    scale[[index // 3 for index in task.indices]] = task.scale
    of_J = np.linalg.norm(scale * _norms(generalized_jacobian(cfg, base), 1))
    sigma = np.linalg.norm(scale * E) + rounding * of_J
    return ErrorBars(float(sigma), np.repeat(E, 3, axis=0))


def _norms(matrix: Array, columns: int) -> Array:
    """2-norms of the blocks of 3 rows and 1 or 3 columns."""
    rows, width = matrix.shape
    blocks = matrix.reshape(rows // 3, 3, width // columns, columns).swapaxes(1, 2)
    norms: Array = np.linalg.norm(blocks, 2, axis=(2, 3))
    return norms


class _Sizes(NamedTuple):
    """Sums of absolute values over what each of the model's joints carries, the spacecraft first.

    About the spacecraft's frame, where Pinocchio takes them, distances counted along the links.
    """

    slides: Array  # whether the joint is prismatic
    reach: Array  # its distance [m]
    turns: Array  # rotations up to it, and angles [rad] that mimic joints add up
    m: Array  # mass [kg]
    s: Array  # first moment [kg m]
    i: Array  # second moment and inertia [kg m^2]


def _sizes(cfg: Configuration, coupling: Array) -> _Sizes:
    arm, model = cfg.arm, cfg.arm.model
    size = coupling @ np.abs(cfg.q) + np.abs(arm.offsets)  # of the terms of a joint position
    slides = [False, *(arm.tree.joints[name].kind == "prismatic" for name in model.names[2:])]
    parents = [int(parent) - 1 for parent in model.parents[1:]]
    reach, turns, m, s, i = np.zeros((5, len(parents)))
    for j, inertia in enumerate(model.inertias[1:]):
        if j > 0:
            link, moved = model.jointPlacements[j + 1].translation, size[j - 1]
            sum_of_angles = 0.0 if slides[j] or arm.coupling is None else moved
            reach[j] = reach[parents[j]] + np.linalg.norm(link) + (moved if slides[j] else 0.0)
            turns[j] = turns[parents[j]] + 1.0 + sum_of_angles
        far = reach[j] + np.linalg.norm(inertia.lever)
        m[j], s[j] = inertia.mass, inertia.mass * far
        i[j] = inertia.mass * far**2 + np.linalg.norm(inertia.inertia, 2)
    for j in range(len(m) - 1, 0, -1):
        for carried in (m, s, i):
            carried[parents[j]] += carried[j]
    return _Sizes(np.array(slides), reach, turns, m, s, i)


def _rounding(cfg: Configuration) -> tuple[Array, Array, Array, Array, float]:
    """E_b (2, 2), E_q (2, n), E_Jb (2 tips, 2), E_Jq (2 tips, n), and the rounding of a term.

    A joint that turns gives momentum up to 2 s and, about the CM at a distance up to c, angular
    momentum up to 3 i + 2 c s.
    """
    arm, model = cfg.arm, cfg.arm.model
    coupling = np.eye(arm.n) if arm.coupling is None else np.abs(arm.coupling)
    slides, reach, turns, m, s, i = _sizes(cfg, coupling)
    c = s[0] / m[0]
    turning = np.array([2.0 * s, 3.0 * i + 2.0 * c * s])
    sliding = np.array([m, s + c * m])
    E_b = np.column_stack((sliding[:, 0], turning[:, 0]))
    E_q = np.where(slides, sliding, turning)[:, 1:] @ coupling
    E_Jb, E_J = np.empty((len(arm.tips), 2, 2)), np.zeros((len(arm.tips), 2, len(m)))
    for tip, frame in enumerate(model.frames[index] for index in arm.tip_frames):
        r_E = reach[frame.parentJoint - 1] + np.linalg.norm(frame.placement.translation)
        E_Jb[tip] = [[1.0, r_E], [0.0, 1.0]]
        for j in model.supports[frame.parentJoint][2:]:
            E_J[tip, :, j - 1] = (1.0, 0.0) if slides[j - 1] else (r_E, 1.0)
    E_Jq = E_J.reshape(-1, len(m))[:, 1:] @ coupling
    u = ROUNDING * (1.0 + float(turns.max()))
    return u * E_b, u * E_q, u * E_Jb.reshape(-1, 2), u * E_Jq, u
