"""Error bars: bounds of the rounding errors of J* and of its singular values.

Positions, momenta and inertias are sums of rounded terms. Digits are lost where the terms cancel,
as in the inertia of a heavy payload about the spacecraft, taken to the system CM, or along fixed
joints that lead out and back. A term of size t has an error of at most u t, where u grows with the
number of bodies and joints (`_sizes`).

Size of the terms. A length in the arm is a *distance*, the sum of the link lengths of the model,
where fixed joints are merged. Its error is u times its *way*, the sum of all link lengths of the
tree. With mass m, first moments s (by distance) and w (by way) and second moment i of all that a
joint carries, and c and c' how far the system CM is, by distance and by way, a unit rate gives

    prismatic joint: linear momentum m, angular momentum about the CM up to w + c' m;
    revolute joint:  linear momentum up to 2 w, angular momentum about the CM up to i + c w + c' s,

in which one length of each product is a distance and one a way. u times these sizes are the bounds
E_b and E_q for the entries of A_b and A_q. Those for J_b and J_q are u times 1 and u times the way
to the tip.

Propagation. With A_b X = A_q and J* = J_q - J_b X,

    |dX|  <= (1 - |A_b^-1| E_b)^-1 |A_b^-1| (E_q + E_b |X|)
    |dJ*| <= E_Jq + E_Jb (|X| + |dX|) + |J_b A_b^-1| (E_q + E_b (|X| + |dX|))

and Weyl's inequality |d sigma| <= ||dJ*||. |.| is the matrix of 2-norms of the linear and angular
3-vectors and 3 x 3 blocks, so that units are not mixed and nothing depends on the attitude.
Perturbation of linear systems: Higham, Accuracy and Stability of Numerical Algorithms (2002),
section 7.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.mechanics.jacobian import generalized_jacobian, solve_locked, task_jacobian
from spacearm.model.arguments import BaseMode, free_components
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.results import Cell, Column, Description, Result, Table
from spacearm.signatures import checked

#: Relative error of a term for each joint, movable or fixed, that it is carried across.
ROUNDING = 4.0 * float(np.finfo(np.float64).eps)


class ErrorBars(Result):
    """Bounds of the rounding errors of J* and of the singular values.

    They cover the arithmetic only. The numbers of the URDF, those given to `SpaceArm.replace`,
    joint positions and the CM of a spacecraft whose mass or inertia was replaced count as exact.
    All that is computed from them is covered: rotations from roll, pitch and yaw, links merged by
    fixed and locked joints, positions of mimic joints.

    Attributes:
        arm: The arm.
        sigma: Bound for every singular value of the task Jacobian, in its unit. A sigma_min below
            it may be an exact zero.
        jacobian: (6, n) bounds for the entries of J*, rows as in `generalized_jacobian`.
    """

    arm: SpaceArm
    sigma: float
    jacobian: Array

    not_checked = "errors of the description itself"

    def describe(self) -> Description:
        """Describe the bound of the singular values and the largest one of each column of J*."""
        columns: dict[Column | str, Sequence[Cell]] = {
            "joint": self.arm.joint_names,
            Column("largest error in its column of J* [SI]", "", ".2e"): self.jacobian.max(axis=0),
        }
        return Description(
            title=f"{self.arm.name}, rounding errors",
            verdict=f"singular values are exact to {self.sigma:.3g} {self.arm.sigma_unit}",
            tables=[Table.by_columns(columns)],
        )


@checked
def error_bars(cfg: Configuration, *, mode: BaseMode = "free-floating") -> ErrorBars:
    """Compute error bars of `generalized_jacobian` and of the singular values in `singularity`.

    A rounding analysis of the sums, Weyl's inequality for the singular values. Infinite where
    rounding alone could make A_b singular.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does; see `generalized_jacobian`.

    Returns:
        Bounds for each entry of J* and for all singular values.

    Raises:
        ConfigurationError: `mode` is none of the three.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.error_bars(cfg).sigma < 1e-12  # m/rad
        True
    """
    f = free_components(mode)
    E_b, E_q, E_Jb, E_Jq, rounding = _rounding(cfg)
    free = slice(f // 3)
    E_b, E_q, E_Jb = E_b[free, free], E_q[free], E_Jb[:, free]
    inverse = solve_locked(cfg.A[:f, :f], np.eye(f))
    A_inv, X = _norms(inverse, 3), _norms(inverse @ cfg.A[:f, 6:], 1)
    G = A_inv @ E_b
    if np.abs(np.linalg.eigvals(G)).max(initial=0.0) >= 1.0:
        return ErrorBars(cfg.arm, np.inf, np.full_like(cfg.J[:, 6:], np.inf))
    X = X + np.linalg.solve(np.eye(len(G)) - G, A_inv @ (E_q + E_b @ X))
    E = E_Jq + E_Jb @ X + _norms(cfg.J[:, :f] @ inverse, 3) @ (E_q + E_b @ X)
    task = cfg.arm.task
    scale = np.zeros((len(E), 1))
    scale[[index // 3 for index in task.indices]] = task.scale
    of_J = np.linalg.norm(scale * _norms(generalized_jacobian(cfg, mode=mode), 1))
    sigma = np.linalg.norm(scale * E) + rounding * of_J
    return ErrorBars(cfg.arm, float(sigma), np.repeat(E, 3, axis=0))


def proven_sign(cfg: Configuration, *, mode: BaseMode = "free-floating") -> int:
    """Return the sign of det J*, 1 or -1, if it is proven; 0 where rounding could change it.

    No matrix nearer than sigma_min is singular, so that the sign is right where sigma_min is more
    than its error bar.

    Args:
        cfg: The configuration, of a square task.
        mode: What the spacecraft does.
    """
    J = task_jacobian(cfg, mode=mode)
    certain = np.linalg.svd(J, compute_uv=False)[-1] > error_bars(cfg, mode=mode).sigma
    return int(np.sign(np.linalg.det(J))) if certain else 0


def _norms(matrix: Array, columns: int) -> Array:
    """Compute the 2-norms of the blocks of 3 rows and 1 or 3 columns."""
    rows, width = matrix.shape
    blocks = matrix.reshape(rows // 3, 3, width // columns, columns).swapaxes(1, 2)
    return np.linalg.norm(blocks, 2, axis=(2, 3))


def _sizes(cfg: Configuration, terms: Array) -> tuple[Array, Array, Array, float]:
    """Add up the sizes of the terms.

    Args:
        cfg: The configuration.
        terms: (nv - 6,) sizes of the terms that add up to the positions of the model's joints.

    Returns:
        Moments (4, nv - 5) about the spacecraft's frame of all that is carried, absolute values
        summed, by the spacecraft and by each joint of the model: mass m [kg], first moment by
        distance s and by way w [kg m], and i, three times the second moment (distance times way)
        and twice the inertia about the bodies' own CMs, which is turned from both sides [kg m^2].
        The way to each tip; the joints on it (tips, nv - 5), 1 or 0, the spacecraft first; the
        rounding u of a term.
    """
    arm, s = cfg.arm, _structure(cfg.arm)
    term = np.zeros(len(s.slides))
    term[s.moving] = terms
    slid = np.where(s.slides, term, s.slid)
    sums_of_angles = 0.0 * term if arm.coupling is None else np.where(s.slides, 0.0, term)
    turns = s.crossed @ (1.0 + sums_of_angles)
    distance = s.crossed[:, s.moving] @ (s.placements + slid[s.moving])
    way = s.crossed @ (s.origins + slid)
    u = ROUNDING * (1.0 + max(len(s.bodies), turns[s.bodies + s.tips].max()))
    far = way[s.bodies] + s.to_CM
    near = distance[s.bodies] + s.lever + u * far
    each = np.array([s.mass, s.mass * near, s.mass * far, 3.0 * s.mass * near * far + s.inertia])
    return each @ s.carried[s.bodies], way[s.tips], s.carried[s.tips], u


class _Structure:
    """What of the sizes does not depend on the configuration.

    Attributes:
        crossed: (links, joints) 1 where a joint of the tree is on the way to a link.
        carried: (links, nv - 5) the same for the model's joints, the spacecraft first.
        moving: (joints,) which joints are the model's.
        slides: (joints,) which are prismatic.
        slid: (joints,) how far locked joints have slid [m].
        placements: (nv - 6,) lengths between the model's joints [m].
        origins: (joints,) lengths between those of the tree [m].
        bodies: Numbers of the links that have mass.
        tips: Numbers of the tips.
        mass: (bodies,) masses [kg].
        to_CM: (bodies,) lengths from their frames to their CMs [m].
        lever: (bodies,) lengths from the model's joints to their CMs [m].
        inertia: (bodies,) twice the norms of their inertias [kg m^2].
    """

    def __init__(self, arm: SpaceArm) -> None:
        tree, model = arm.tree, arm.model
        joints = tree.depth_first()
        links = [tree.root, *(joint.child for joint in joints)]
        self.crossed = np.zeros((len(links), len(joints)))
        for j, joint in enumerate(joints):
            self.crossed[j + 1] = self.crossed[links.index(joint.parent)]
            self.crossed[j + 1, j] = 1.0
        self.moving = np.array([joint.movable for joint in joints])
        self.carried = np.column_stack((np.ones(len(links)), self.crossed[:, self.moving]))
        self.slides = np.array([joint.kind == "prismatic" for joint in joints])
        self.slid = np.array([joint.slid for joint in joints])
        self.placements = _lengths([place.translation for place in model.jointPlacements[2:]])
        self.origins = _lengths([joint.origin.translation for joint in joints])
        self.tips = [links.index(tip) for tip in arm.tips]
        self.bodies = [k for k, link in enumerate(links) if tree.links[link] is not None]
        mass, CM, I = zip(*(tree.links[links[k]] for k in self.bodies), strict=True)
        frames = [model.frames[model.getFrameId(links[k], pin.BODY)] for k in self.bodies]
        lever = [f.placement.act(pose.translation) for f, pose in zip(frames, CM, strict=True)]
        self.mass, self.lever = np.array(mass), _lengths(lever)
        self.to_CM = _lengths([pose.translation for pose in CM])
        self.inertia = 2.0 * np.linalg.norm(I, 2, axis=(1, 2))


_structure = lru_cache(maxsize=16)(_Structure)


def _lengths(vectors: list[Array]) -> Array:
    """Compute the lengths of vectors."""
    return np.linalg.norm(vectors, axis=1)


def _rounding(cfg: Configuration) -> tuple[Array, Array, Array, Array, float]:
    """Bound the errors of A and J: E_b (2, 2), E_q (2, n), E_Jb (2 tips, 2), E_Jq (2 tips, n), u.

    See the module's docstring for the bounds.
    """
    arm = cfg.arm
    coupling = np.eye(arm.n) if arm.coupling is None else np.abs(arm.coupling)
    sizes, ways, moves_tip, u = _sizes(cfg, coupling @ np.abs(cfg.q) + np.abs(arm.offsets))
    mass, first, first_by_way, second = sizes
    c, way_to_c = first[0] / mass[0], first_by_way[0] / mass[0]
    turning = np.array([2.0 * first_by_way, second + c * first_by_way + way_to_c * first])
    sliding = np.array([mass, first_by_way + way_to_c * mass])
    slides = [arm.tree.joints[name].kind == "prismatic" for name in arm.model.names[2:]]
    E_b = np.column_stack((sliding[:, 0], turning[:, 0]))
    E_q = np.where(slides, sliding[:, 1:], turning[:, 1:]) @ coupling
    E_Jb = [[[1.0, way], [0.0, 1.0]] for way in ways]
    E_J = [np.where(slides, [[1.0], [0.0]], [[way], [1.0]]) for way in ways]
    E_Jq = (moves_tip[:, None, 1:] * E_J) @ coupling
    return u * E_b, u * E_q, u * np.concatenate(E_Jb), u * np.concatenate(E_Jq), u
