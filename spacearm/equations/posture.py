"""Where all bodies are, and what their joints carry: the first pass of all equations.

The equations of a floating arm stand here once, as plain array code for NumPy, JAX and symbols. All
quantities are relative to the system CM and in spacecraft axes; twists and momenta are [linear;
angular]. `xp` is the array library: `compiler.numbers`, `compiler.symbols`, `jax.numpy`, or
`numpy`, whose arrays may hold the symbols of CasADi. Nothing branches on numbers or writes into
arrays, so that derivatives can be taken through it.

With s_i the axis of joint i as a twist and I_i the inertia of all that it carries, the momentum of
the joints is A_q = [I_i s_i], that of the whole A_b = diag(M 1, D).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from spacearm.equations.structure import Parameters, Structure

Z = np.array([0.0, 0.0, 1.0])
ROWS, COLUMNS = np.triu_indices(3)
"""Elements of a symmetric matrix (3, 3) that tell it, (6,) each."""
SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Which of them stands where."""


class Posture(NamedTuple):
    """Where all bodies are, and what their joints carry.

    Attributes:
        M: (1,) mass of the whole [kg].
        r_cm: (3,) system CM from the spacecraft frame [m].
        tip_positions: (tips, 3) the tips from the system CM [m].
        tip_rotations: (tips, 3, 3) their attitudes.
        masses: (N + 1, 1) of the bodies [kg].
        centres: (N + 1, 3) their CMs from the system CM [m].
        inertias: (N + 1, 3, 3) their inertias about their CMs [kg m^2].
        D: (3, 3) inertia of the whole, of (33c).
        s: (N, 6) axes of the joints.
        P: (N, 6) momentum of what the joints carry, per unit rate.
        rotations: (N + 1, 3, 3) attitudes of the bodies' frames.
        origins: (N + 1, 3) these frames from the system CM [m].
    """

    M: Any
    r_cm: Any
    tip_positions: Any
    tip_rotations: Any
    masses: Any
    centres: Any
    inertias: Any
    D: Any
    s: Any
    P: Any
    rotations: Any
    origins: Any


def posture(xp: Any, tree: Structure, p: Parameters, q: Any) -> Posture:
    """Place all bodies at joint positions q (n,)."""
    R, a = _places(xp, tree, p, tree.gains @ q + tree.offsets)
    S, body = tree.turns, np.array(tree.tips)
    own = S.transpose(0, 2, 1)
    masses = p.masses[:, None]
    M = masses.sum(axis=0)
    rho = a + (R @ (own @ p.centres[..., None]))[..., 0]
    r_cm = (masses * rho).sum(axis=0) * (1.0 / M)
    x = rho - r_cm
    moments = masses * x
    half = R @ (own @ p.inertias @ S)
    inertias = (half[:, ROWS] * R[:, COLUMNS]).sum(axis=2)
    whole = inertias + about(x, moments)
    tips = a[body] + (R[body] @ (own[body] @ p.tip_positions[..., None]))[..., 0] - r_cm
    u, arm = R[1:] @ Z, a[1:] - r_cm
    slides = np.array(tree.slides[1:])[:, None] * 1.0
    v, w = slides * u + (1.0 - slides) * xp.cross(arm, u), (1.0 - slides) * u
    s = xp.concatenate([v, w], axis=1)
    m, moment, I = (gathered(xp, tree, values) for values in (masses, moments, whole))
    P = momenta(xp, m[1:], moment[1:], I[1:, SYMMETRIC], s)
    return Posture(
        M, r_cm, tips, R[body] @ (own[body] @ p.tip_rotations), masses, x,
        inertias[:, SYMMETRIC], I[0, SYMMETRIC], s, P, R @ own, a - r_cm,
    )  # fmt: skip


def gathered(xp: Any, tree: Structure, values: Any) -> Any:
    """Return the sums of values (N + 1, ...) over all that each joint carries; 0 is the whole."""
    sums = list(values)
    for i in range(len(sums) - 1, 0, -1):
        sums[tree.parents[i]] = sums[tree.parents[i]] + sums[i]
    return xp.stack(sums)


def momenta(xp: Any, m: Any, moment: Any, I: Any, s: Any) -> Any:
    """Compute the momenta (m, 6) of masses, first moments and inertias that have twists s."""
    v, w = s[:, :3], s[:, 3:]
    linear = m * v + xp.cross(w, moment)
    angular = (I @ w[..., None])[..., 0] + xp.cross(moment, v)
    return xp.concatenate([linear, angular], axis=1)


def _places(xp: Any, tree: Structure, p: Parameters, q: Any) -> tuple[Any, Any]:
    """Place the frames of all bodies, z along the axis of their joint, at positions q (N,).

    Returns:
        (N + 1, 3, 3) attitudes and (N + 1, 3) positions in the spacecraft frame.
    """
    sin, cos, S = xp.sin(q), xp.cos(q), tree.turns
    R, a = [np.eye(3)], [np.zeros(3)]
    for i in range(1, len(tree.parents)):
        inner, at = tree.parents[i], slice(i - 1, i)
        own = S[inner].T
        E = R[inner] @ (own @ p.joint_rotations[i - 1] @ S[i])
        origin = a[inner] + R[inner] @ (own @ p.joint_positions[i - 1])
        if tree.slides[i]:
            a.append(origin + E[:, 2] * q[at])
            R.append(E)
        else:
            a.append(origin)
            X, Y = E[:, 0], E[:, 1]
            turned = [X * cos[at] + Y * sin[at], Y * cos[at] - X * sin[at], E[:, 2]]
            R.append(xp.stack(turned, axis=1))
    return xp.stack(R), xp.stack(a)


def about(x: Any, moments: Any) -> Any:
    """Return the inertias (m, 6) of masses at x (m, 3) with first moments (m, 3)."""
    squares = (x * moments).sum(axis=1)[:, None]
    return squares * np.eye(3)[ROWS, COLUMNS] - moments[:, ROWS] * x[:, COLUMNS]


def momentum(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute A_q (6, n), the momentum per unit rate of the joints that count."""
    return posture(xp, tree, p, q).P.T @ tree.gains


def base_inertia(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute D (3, 3), the inertia of the whole about the system CM."""
    return posture(xp, tree, p, q).D


def centre(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute the system CM (3,) from the spacecraft frame."""
    return posture(xp, tree, p, q).r_cm


def tip_position(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute the tips (tips, 3) from the system CM; (3,) of one tip."""
    return _single(tree, posture(xp, tree, p, q).tip_positions)


def tip_rotation(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute the attitudes (tips, 3, 3) of the tips; (3, 3) of one tip."""
    return _single(tree, posture(xp, tree, p, q).tip_rotations)


def _single(tree: Structure, values: Any) -> Any:
    """Return the values of the tips without the first axis if there is one tip."""
    return values[0] if len(tree.tips) == 1 else values
