"""Serial arms of which only the numbers are known, with J* and its derivative in NumPy.

Nothing of the package computes here, so that what it computes can be compared with. Motions are
pairs [velocity of the point at the system CM; angular velocity], expressed in the spacecraft frame.
A body's momentum is its spatial inertia C times its motion. If joint j, whose motion is S_j, turns,
all bodies behind it move, and with ad(S) V = [S, V], the commutator of two motions,

    dS_i = ad(S_j) S_i,  dC = -ad(S_j)^T C - C ad(S_j),

for i > j and the sum C_j of the inertias behind joint j. The rest is the product rule.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

import spacearm as sa
from helpers.arms import frame, joint, link, load_text, robot

Mode = Literal["free-floating", "attitude-controlled", "fixed"]

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
ALL_OF = {"pose": "x y z rx ry rz", "position": "x y z", "orientation": "rx ry rz"}
BASE_MOTIONS: dict[Mode, int] = {"free-floating": 6, "attitude-controlled": 3, "fixed": 0}
"""Number of the base's motions that are free: of the first three it translates."""


class Motions(NamedTuple):
    """The motions of m postures, expressed in the spacecraft frame.

    Attributes:
        S: (m, n, 6) motion of each joint.
        A: (m, n, 6) momentum of each joint's motion.
        C: (m, n, 6, 6) spatial inertia of all bodies behind each joint.
        W: (m, n, 6) what the base's motion is opposite to while one joint moves.
        G: (m, 6, 6) base motion per momentum: of the momentum A rates it has W = G A.
        tip: (m, 3) the end-effector from the system CM [m].
    """

    S: np.ndarray
    A: np.ndarray
    C: np.ndarray
    W: np.ndarray
    G: np.ndarray
    tip: np.ndarray


@dataclass(frozen=True)
class NumericArm:
    """A serial arm of revolute joints; link 0 is the spacecraft.

    Attributes:
        mass: (n + 1,) masses [kg].
        com: (n + 1, 3) centres of mass in the links' frames [m].
        inertia: (n + 1, 3, 3) inertias about them [kg m^2].
        place: (n, 3) where joint i is in the frame of link i [m].
        axis: (n, 3) unit axes.
        tip: (3,) the end-effector in the last link's frame [m].
        task: The task.
        lower: (n,) lower joint limits [rad].
        upper: (n,) upper joint limits [rad].
    """

    mass: np.ndarray
    com: np.ndarray
    inertia: np.ndarray
    place: np.ndarray
    axis: np.ndarray
    tip: np.ndarray
    task: str
    lower: np.ndarray
    upper: np.ndarray

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.axis)

    @property
    def rows(self) -> list[int]:
        """Components of the end-effector's twist that the task describes."""
        words = [ALL_OF.get(word, word) for word in self.task.split()]
        return [COMPONENTS.index(word) for word in " ".join(words).split()]

    @property
    def length(self) -> float | None:
        """What divides the linear components of a mixed task [m]; None of others."""
        mixed = min(self.rows) < 3 <= max(self.rows)
        return 1.0 if mixed else None

    def loaded(self) -> sa.SpaceArm:
        """Return the arm as the package reads it from a URDF file."""
        names = ["bus", *(f"link_{i}" for i in range(1, self.n + 1))]
        elements = [
            link(name, repr(float(self.mass[i])), self.com[i], self.inertia[i])
            for i, name in enumerate(names)
        ]
        for i in range(self.n):
            low, high = float(self.lower[i]), float(self.upper[i])
            limit = f'<limit lower="{low!r}" upper="{high!r}" effort="10" velocity="1"/>'
            where = {"xyz": self.place[i], "axis": self.axis[i], "inside": limit}
            elements.append(joint(f"j{i + 1}", names[i], names[i + 1], **where))
        elements += [frame("tip"), joint("end", names[-1], "tip", "fixed", xyz=self.tip)]
        return load_text(robot(*elements), tip="tip", task=sa.Task(self.task, length=self.length))

    def motions(self, Q: np.ndarray, mode: Mode) -> Motions:
        """Compute the motions of postures Q (m, n)."""
        m, n = Q.shape
        R, r = np.tile(np.eye(3), (m, 1, 1)), np.zeros((m, 3))
        axes, hinges = np.empty((2, m, n, 3))
        inertias, centres = np.empty((m, n + 1, 3, 3)), np.empty((m, n + 1, 3))
        inertias[:, 0], centres[:, 0] = self.inertia[0], self.com[0]
        for i in range(n):
            r = r + R @ self.place[i]
            axes[:, i], hinges[:, i] = R @ self.axis[i], r
            R = R @ rotations(self.axis[i], Q[:, i])
            inertias[:, i + 1] = R @ self.inertia[i + 1] @ R.swapaxes(1, 2)
            centres[:, i + 1] = r + R @ self.com[i + 1]
        total = self.mass.sum()
        middle = (self.mass @ centres) / total
        S = np.concatenate((cross(hinges - middle[:, None], axes), axes), axis=2)
        bodies = spatial_inertias(self.mass, centres - middle[:, None], inertias)
        behind = np.cumsum(bodies[:, ::-1], axis=1)[:, ::-1]
        C = behind[:, 1:]
        A = (C @ S[..., None])[..., 0]
        free, G = BASE_MOTIONS[mode], np.zeros((m, 6, 6))
        G[:, :3, :3] = (free >= 3) * np.eye(3) / total
        if free == 6:
            G[:, 3:, 3:] = np.linalg.inv(behind[:, 0, 3:, 3:])
        return Motions(S, A, C, A @ G, G, r + R @ self.tip - middle)

    def jacobians(self, Q: np.ndarray, mode: Mode = "free-floating") -> np.ndarray:
        """Compute J* (m, k, n) at Q (m, n), expressed in the spacecraft frame."""
        return self.jacobians_of(self.motions(Q, mode))

    def jacobians_of(self, motions: Motions) -> np.ndarray:
        """Compute J* (m, k, n) of some motions."""
        P = motions.S - motions.W
        linear = P[..., :3] + cross(P[..., 3:], motions.tip[:, None])
        J = np.concatenate((linear / (self.length or 1.0), P[..., 3:]), axis=2)
        return J[..., self.rows].swapaxes(1, 2)

    def slopes_of(self, motions: Motions, U: np.ndarray) -> np.ndarray:
        """Compute u^T dJ*/dq_j (m, n, n), j first, of some motions.

        Args:
            motions: The motions.
            U: (m, k) one u for each posture.
        """
        full = np.zeros((len(U), 6))
        full[:, self.rows] = U
        full[:, :3] /= self.length or 1.0
        S, A, C, W, G, tip = motions
        P = S - W
        y = full.copy()
        y[:, 3:] += cross(tip, full[:, :3])
        z = (y[:, None] @ G)[:, 0]
        tips = S[..., :3] + cross(S[..., 3:], tip[:, None])
        a = commutators(S, z[:, None])
        Ca = (C @ a[..., None])[..., 0]
        Cz = (C @ z[:, None, :, None])[..., 0]
        g = -Ca - transposed_commutators(S, Cz)
        behind = np.triu(np.ones((self.n, self.n)), 1)  # joint i behind joint j
        before = np.tril(np.ones((self.n, self.n)), -1)
        St, At, Wt = (motion.swapaxes(1, 2) for motion in (S, A, W))
        T = cross(tips, full[:, None, :3]) @ P[..., 3:].swapaxes(1, 2)
        T += (transposed_commutators(S, y[:, None]) @ St) * behind
        T += (a @ At) * (1.0 - before) - (g @ St) * before + g @ Wt
        return T


def rotations(axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the rotations (m, 3, 3) about an axis, by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + s * K + (1.0 - c) * (K @ K)


def spatial_inertias(mass: np.ndarray, com: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Return the spatial inertias (m, b, 6, 6) of bodies about the origin."""
    x, y, z = np.moveaxis(com, -1, 0)
    o = np.zeros_like(x)
    K = np.stack((o, -z, y, z, o, -x, -y, x, o), axis=-1).reshape(*x.shape, 3, 3)
    M = mass[:, None, None]
    I = np.empty((*x.shape, 6, 6))
    I[..., :3, :3] = M * np.eye(3)
    I[..., :3, 3:] = -M * K
    I[..., 3:, :3] = M * K
    I[..., 3:, 3:] = inertia - M * (K @ K)
    return I


def commutators(S: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Return ad(S) V of motions (..., 6)."""
    v, w = S[..., :3], S[..., 3:]
    linear = cross(w, V[..., :3]) + cross(v, V[..., 3:])
    return np.concatenate((linear, cross(w, V[..., 3:])), axis=-1)


def transposed_commutators(S: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return ad(S)^T h of motions and momenta (..., 6)."""
    v, w = S[..., :3], S[..., 3:]
    linear, angular = h[..., :3], h[..., 3:]
    moment = -cross(v, linear) - cross(w, angular)
    return np.concatenate((-cross(w, linear), moment), axis=-1)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a x b of vectors (..., 3)."""
    a, b = np.broadcast_arrays(a, b)
    c = np.empty(a.shape)
    c[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    c[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    c[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return c
