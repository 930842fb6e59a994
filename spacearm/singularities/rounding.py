"""Accuracy: how many digits of J* and sigma_min the arithmetic leaves.

Positions, momenta and inertias are sums of rounded terms, and where the terms cancel, as in the
inertia of a heavy payload about the spacecraft, taken to the system CM, or on a way out and back
by fixed joints, digits are lost. With bounds E for these errors from the size of the terms, from
the URDF's numbers on, A_b X = A_q and J* = J_q - J_b X give

    |dX|  <= (1 - |A_b^-1| E_b)^-1 |A_b^-1| (E_q + E_b |X|)
    |dJ*| <= E_Jq + E_Jb (|X| + |dX|) + |J_b A_b^-1| (E_q + E_b (|X| + |dX|))

and Weyl's inequality |d sigma| <= ||dJ*||. |.| is the matrix of 2-norms of the linear and angular
3-vectors and 3 x 3 blocks: units are not mixed, and nothing depends on the attitude. Perturbation
of linear systems: Higham, Accuracy and Stability of Numerical Algorithms (2002), section 7.2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.model.configuration import Configuration
from spacearm.model.mode import BaseMode, free_components

ROUNDING = 4.0 * float(np.finfo(np.float64).eps)
"""Relative error of a term for each joint, movable or fixed, that it is carried across."""


class ErrorBars(NamedTuple):
    """How far computed numbers can be from those of exact arithmetic.

    Of the arithmetic only: the numbers of the URDF, those given to `SpaceArm.replace` and joint
    positions count as exact, although they are known to far fewer digits. So does the CM of a
    spacecraft whose mass or inertia was replaced. What is made of them does not: rotations from
    roll, pitch and yaw, links that fixed and locked joints merge, positions of mimic joints.

    Attributes:
        sigma: Bound for every singular value of the task Jacobian, in the same unit. A sigma_min
            below it may be an exact zero.
        jacobian: (6, n) bounds for the entries of J*, rows as in `generalized_jacobian`.
    """

    sigma: float
    jacobian: Array


def error_bars(cfg: Configuration, *, mode: BaseMode = "free-floating") -> ErrorBars:
    """Error bars of `generalized_jacobian` and of the singular values in `singularity`.

    See the module's docstring. Infinite where rounding alone could make A_b singular.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does; see `generalized_jacobian`.

    Raises:
        ConfigurationError: `mode` is none of the three.
    """
    f = free_components(mode)
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
    of_J = np.linalg.norm(scale * _norms(generalized_jacobian(cfg, mode=mode), 1))
    sigma = np.linalg.norm(scale * E) + rounding * of_J
    return ErrorBars(float(sigma), np.repeat(E, 3, axis=0))


def _norms(matrix: Array, columns: int) -> Array:
    """2-norms of the blocks of 3 rows and 1 or 3 columns."""
    rows, width = matrix.shape
    blocks = matrix.reshape(rows // 3, 3, width // columns, columns).swapaxes(1, 2)
    return np.linalg.norm(blocks, 2, axis=(2, 3))


class _Sizes(NamedTuple):
    """Sums of absolute values over what each of the model's joints carries, the spacecraft first.

    About the spacecraft's frame, where Pinocchio takes them. What is near may have a long way to
    it: a distance adds up the links of the model, where fixed joints are merged, a way all links
    of the tree.
    """

    m: Array  # mass [kg]
    s: Array  # first moment, by distance [kg m]
    w: Array  # first moment, by way [kg m]
    i: Array  # second moment, distance by way, three times, and inertia, twice [kg m^2]


def _sizes(cfg: Configuration, terms: Array) -> tuple[_Sizes, Array, Array, float]:
    """The sizes, the way to each tip, the joints on it (tips, nv - 5), the rounding of a term.

    Args:
        cfg: The configuration.
        terms: (nv - 6,) sizes of what adds up to the positions of the model's joints.
    """
    arm, tree, model = cfg.arm, cfg.arm.tree, cfg.arm.model
    joints = tree.depth_first()
    links = [tree.root, *(joint.child for joint in joints)]
    crossed = np.zeros((len(links), len(joints)))  # 1 where a joint is on the way to a link
    for j, joint in enumerate(joints):
        crossed[j + 1] = crossed[links.index(joint.parent)]
        crossed[j + 1, j] = 1.0
    moving = np.array([joint.movable for joint in joints])
    carried = np.column_stack((np.ones(len(links)), crossed[:, moving]))

    term = np.zeros(len(joints))
    term[moving] = terms
    slides = [joint.kind == "prismatic" for joint in joints]
    slid = np.where(slides, term, [joint.slid for joint in joints])
    sums_of_angles = 0.0 * term if arm.coupling is None else np.where(slides, 0.0, term)
    turns = crossed @ (1.0 + sums_of_angles)
    placements = [placement.translation for placement in model.jointPlacements[2:]]
    distance = crossed[:, moving] @ (_lengths(placements) + slid[moving])
    way = crossed @ (_lengths([joint.origin.translation for joint in joints]) + slid)

    tips = [links.index(tip) for tip in arm.tips]
    bodies = [k for k, link in enumerate(links) if tree.links[link] is not None]
    u = ROUNDING * (1.0 + max(len(bodies), turns[bodies + tips].max()))
    m, CM, I = zip(*(tree.links[links[k]] for k in bodies), strict=True)
    frames = [model.frames[model.getFrameId(links[k], pin.BODY)].placement for k in bodies]
    r = [frame.act(pose.translation) for frame, pose in zip(frames, CM, strict=True)]
    far = way[bodies] + _lengths([pose.translation for pose in CM])
    near = distance[bodies] + _lengths(r) + u * far
    i = 3.0 * np.multiply(m, near * far) + 2.0 * np.linalg.norm(I, 2, axis=(1, 2))
    each = np.array([m, m * near, m * far, i])
    return _Sizes(*(each @ carried[bodies])), way[tips], carried[tips], u


def _lengths(vectors: list[Array]) -> Array:
    return np.linalg.norm(vectors, axis=1)


def _rounding(cfg: Configuration) -> tuple[Array, Array, Array, Array, float]:
    """E_b (2, 2), E_q (2, n), E_Jb (2 tips, 2), E_Jq (2 tips, n), and the rounding of a term.

    A joint that turns gives momentum up to 2 s and, about the CM at a distance up to c, angular
    momentum up to i + 2 c s: m r^2 of the body and twice m r in its lever arm. A length has the
    error of its way, so that in each product of two lengths one is a distance and one a way; an
    inertia is turned from both sides.
    """
    arm = cfg.arm
    coupling = np.eye(arm.n) if arm.coupling is None else np.abs(arm.coupling)
    (m, s, w, i), ways, moves_tip, u = _sizes(cfg, coupling @ np.abs(cfg.q) + np.abs(arm.offsets))
    c, way_to_c = s[0] / m[0], w[0] / m[0]
    turning = np.array([2.0 * w, i + c * w + way_to_c * s])
    sliding = np.array([m, w + way_to_c * m])
    slides = [arm.tree.joints[name].kind == "prismatic" for name in arm.model.names[2:]]
    E_b = np.column_stack((sliding[:, 0], turning[:, 0]))
    E_q = np.where(slides, sliding[:, 1:], turning[:, 1:]) @ coupling
    E_Jb = [[[1.0, way], [0.0, 1.0]] for way in ways]
    E_J = [np.where(slides, [[1.0], [0.0]], [[way], [1.0]]) for way in ways]
    E_Jq = (moves_tip[:, None, 1:] * E_J) @ coupling
    return u * E_b, u * E_q, u * np.concatenate(E_Jb), u * np.concatenate(E_Jq), u
