"""The equations of a floating arm, written once for NumPy, JAX and symbols.

All quantities are relative to the system CM and in spacecraft axes, as in `kernels.floating`;
twists and momenta are [linear; angular]. `xp` is the array library: `jax.numpy`, or `numpy`, whose
arrays may hold numbers or the symbols of CasADi or of `expressions`. Nothing here compares numbers
or writes into arrays, so that derivatives can be taken through it.

With s_i the axis of joint i as a twist and I_i the inertia of all that it carries, the momentum of
the joints is A_q = [I_i s_i], that of the whole A_b = diag(M 1, D), and J* = J_q - J_b A_b^-1 A_q.
"""

from __future__ import annotations

from itertools import combinations
from math import comb
from typing import Any, NamedTuple

import numpy as np

from spacearm.export.parameters import Parameters, Structure

Z = np.array([0.0, 0.0, 1.0])
MOST_MINORS = 250
"""Maximal minors of a task Jacobian that S is made of; more would make endless code."""


class Posture(NamedTuple):
    """Where all bodies are, and what their joints carry.

    Attributes:
        M: (1,) mass of the whole [kg].
        r_cm: (3,) system CM from the spacecraft frame [m].
        tip_positions: (tips, 3) the tips from the system CM [m].
        tip_rotations: (tips, 3, 3) their attitudes.
        masses: (N + 1, 1) of the bodies [kg].
        moments: (N + 1, 3) their first moments about the system CM [kg m].
        inertias: (N + 1, 3, 3) their inertias about the system CM [kg m^2].
        D: (3, 3) inertia of the whole, of (33c).
        s: (N, 6) axes of the joints.
        P: (N, 6) momentum of what the joints carry, per unit rate.
    """

    M: Any
    r_cm: Any
    tip_positions: Any
    tip_rotations: Any
    masses: Any
    moments: Any
    inertias: Any
    D: Any
    s: Any
    P: Any


def posture(xp: Any, tree: Structure, p: Parameters, q: Any) -> Posture:
    """Place all bodies at joint positions q (n,)."""
    R, a = _places(xp, tree, p, tree.gains @ q + tree.offsets)
    S = tree.turns
    body = np.array(tree.tips)
    masses = p.masses[:, None]
    M = masses.sum(axis=0)
    own = S.transpose(0, 2, 1)
    rho = a + (R @ (own @ p.centres[..., None]))[..., 0]
    r_cm = (masses * rho).sum(axis=0) / M
    x = rho - r_cm
    turned = R @ own
    inertias = turned @ p.inertias @ turned.swapaxes(1, 2) + masses[..., None] * _about(x)
    moments = masses * x
    ends = R[body] @ own[body]
    tips = a[body] + (ends @ p.tip_positions[..., None])[..., 0] - r_cm
    m = tree.carries[1:] @ masses
    moment = tree.carries[1:] @ moments
    I = (tree.carries @ inertias.reshape(-1, 9)).reshape(-1, 3, 3)
    u, arm = R[1:] @ Z, a[1:] - r_cm
    slides = tree.bodies["slides"][1:, None] * 1.0
    v, w = slides * u + (1.0 - slides) * xp.cross(arm, u), (1.0 - slides) * u
    linear = m * v + xp.cross(w, moment)
    angular = (I[1:] @ w[..., None])[..., 0] + xp.cross(moment, v)
    return Posture(
        M, r_cm, tips, ends @ p.tip_rotations, masses, moments, inertias, I[0],
        xp.concatenate([v, w], axis=1), xp.concatenate([linear, angular], axis=1),
    )  # fmt: skip


def _places(xp: Any, tree: Structure, p: Parameters, q: Any) -> tuple[Any, Any]:
    """Place the frames of all bodies, z along the axis of their joint, at positions q (N,).

    Returns:
        (N + 1, 3, 3) attitudes and (N + 1, 3) positions in the spacecraft frame.
    """
    sin, cos, b, S = xp.sin(q), xp.cos(q), tree.bodies, tree.turns
    R, a = [np.eye(3)], [np.zeros(3)]
    for i in range(1, len(b)):
        inner, at = int(b[i]["parent"]), slice(i - 1, i)
        before = R[inner] @ S[inner].T
        E = before @ p.joint_rotations[i - 1] @ S[i]
        origin = a[inner] + before @ p.joint_positions[i - 1]
        if b[i]["slides"]:
            a.append(origin + E[:, 2] * q[at])
            R.append(E)
        else:
            a.append(origin)
            X, Y = E[:, 0], E[:, 1]
            turned = [X * cos[at] + Y * sin[at], Y * cos[at] - X * sin[at], E[:, 2]]
            R.append(xp.stack(turned, axis=1))
    return xp.stack(R), xp.stack(a)


def _about(x: Any) -> Any:
    """Return the inertia (m, 3, 3) of unit masses at x (m, 3)."""
    return (x * x).sum(axis=1)[:, None, None] * np.eye(3) - x[:, :, None] * x[:, None, :]


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


def connection(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute -D^-1 D_q (3, n) of (33c): the spacecraft turns with w_0 = connection dq."""
    return _response(xp, tree, posture(xp, tree, p, q))[3:] @ tree.gains


def jacobian(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute J* (6 tips, n) of (35), in the mode of the structure."""
    return _jacobian(xp, tree, posture(xp, tree, p, q))


def _jacobian(xp: Any, tree: Structure, at: Posture) -> Any:
    X, v, w = _response(xp, tree, at), at.s[:, :3], at.s[:, 3:]
    blocks = []
    for tip in range(len(tree.tips)):
        r, reaches = at.tip_positions[tip], tree.reaches[tip][:, None]
        linear = reaches * (v + xp.cross(w, r)) + X[:3].T + xp.cross(X[3:].T, r)
        angular = reaches * w + X[3:].T
        blocks.append(xp.concatenate([linear, angular], axis=1).T)
    return xp.concatenate(blocks, axis=0) @ tree.gains


def _response(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute the spacecraft's twist (6, N) about the system CM per unit rate of the joints."""
    rest = np.zeros((3, len(tree.gains)))
    linear = rest if tree.mode == "fixed" else -at.P[:, :3].T / at.M
    angular = solve(xp, at.D, -at.P[:, 3:].T) if tree.mode == "free-floating" else rest
    return xp.concatenate([linear, angular], axis=0)


def task_jacobian(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute the rows (k, n) of J* that the task names, scaled."""
    return tree.scale * jacobian(xp, tree, p, q)[np.array(tree.rows)]


def singularity(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute S, which is zero exactly where the task Jacobian is singular.

    S = det(D) det(J*) if there are as many joints as task rows: equation (41) of a planar arm, of
    which only the inertia about the normal of its plane counts. Of a redundant arm S is
    det(D)^2 det(J* J*^T), the sum of the squares of all maximal minors; zero if the joints are
    fewer than the rows. Spacecraft that do not float have S without D. Arms with more than
    `MOST_MINORS` of them have the determinant itself, which rounding spares less near the set.
    """
    k, n = len(tree.rows), tree.n
    if k > n:
        return 0.0 * q[0]
    at = posture(xp, tree, p, q)
    J = tree.scale * _jacobian(xp, tree, at)[np.array(tree.rows)]
    many = comb(n, k) > MOST_MINORS
    found = minors(J @ J.T if many else J)
    if tree.mode == "free-floating":
        i = tree.normal
        D = minors(at.D) if i is None else at.D[i, i : i + 1]
        found = found * (D * D if many else D)
    return found[0] if many or k == n else (found * found).sum()


def generalized_inertia(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute the generalized inertia H* (n, n) of a floating arm."""
    return _inertia(xp, tree, posture(xp, tree, p, q))


def _inertia(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute M_qq - M_qb M_bb^-1 M_bq: between joints one of which carries the other s_i . P_j."""
    carries = tree.carries[1:, 1:]
    half = carries * (at.s @ at.P.T)
    M_qq = half + half.T - np.eye(len(carries)) * half
    free = M_qq + at.P @ _response(xp, tree, at)
    return tree.gains.T @ free @ tree.gains


def forward_dynamics(xp: Any, tree: Structure, p: Parameters, q: Any, dq: Any, tau: Any) -> Any:
    """Compute the joint accelerations (n,) at zero momentum: H* ddq + c* = tau."""
    at = posture(xp, tree, p, q)
    c = bias(xp, tree, at, dq)
    return solve(xp, _inertia(xp, tree, at), (tau - c)[:, None])[:, 0]


def bias(xp: Any, tree: Structure, at: Posture, dq: Any) -> Any:
    """Compute c* (n,), the torques that keep the joint rates constant.

    With nu_i the twists of the bodies and a_i the sum of nu_k x s_k dq_k over the joints k that
    carry them, their accelerations while spacecraft and joints have none, the wrenches on them are
    f_i = I_i a_i + nu_i x* I_i nu_i. The torques are those that the joints transmit, s_i . f, less
    what accelerating the spacecraft takes of them.
    """
    rates = (tree.gains @ dq)[:, None]
    X = _response(xp, tree, at)
    outer = tree.carries[1:].T
    s = at.s * rates
    nu = outer @ s + (X @ rates)[:, 0]
    a = outer @ _crossed(xp, nu[1:], s)
    f = _momenta(xp, at, a) + _crossed_force(xp, nu, _momenta(xp, at, nu))
    carried = tree.carries @ f
    return tree.gains.T @ ((at.s * carried[1:]).sum(axis=1) + X.T @ carried[0])


def _momenta(xp: Any, at: Posture, nu: Any) -> Any:
    """Compute the momenta (N + 1, 6) of the bodies at twists nu (N + 1, 6)."""
    v, w = nu[:, :3], nu[:, 3:]
    linear = at.masses * v + xp.cross(w, at.moments)
    angular = (at.inertias @ w[..., None])[..., 0] + xp.cross(at.moments, v)
    return xp.concatenate([linear, angular], axis=1)


def _crossed(xp: Any, a: Any, b: Any) -> Any:
    """Compute the twists a x b, (m, 6)."""
    v = xp.cross(a[:, 3:], b[:, :3]) + xp.cross(a[:, :3], b[:, 3:])
    return xp.concatenate([v, xp.cross(a[:, 3:], b[:, 3:])], axis=1)


def _crossed_force(xp: Any, a: Any, h: Any) -> Any:
    """Compute the wrenches a x* h of momenta h carried along by twists a, (m, 6)."""
    torque = xp.cross(a[:, 3:], h[:, 3:]) + xp.cross(a[:, :3], h[:, :3])
    return xp.concatenate([xp.cross(a[:, 3:], h[:, :3]), torque], axis=1)


def solve(xp: Any, A: Any, B: Any) -> Any:
    """Compute A^-1 B of a positive definite A (n, n), B (n, m), by elimination without pivots."""
    pivot = A[:1, :1]
    if A.shape[0] == 1:
        return B / pivot
    share = A[1:, :1] / pivot
    rest = solve(xp, A[1:, 1:] - share * A[:1, 1:], B[1:] - share * B[:1])
    return xp.concatenate([(B[:1] - A[:1, 1:] @ rest) / pivot, rest], axis=0)


def minors(A: Any) -> Any:
    """Compute all maximal minors of A (k, n), k <= n, by expansion row by row, without division.

    Returns:
        (c,) determinants of the columns in the order of `itertools.combinations`.
    """
    k, n = A.shape
    found = A[0]
    number: dict[tuple[int, ...], int] = {(j,): j for j in range(n)}
    for r in range(1, k):
        columns = [*combinations(range(n), r + 1)]
        without = [[number[c[:j] + c[j + 1 :]] for j in range(r + 1)] for c in columns]
        sign = np.array([(-1.0) ** (r + j) for j in range(r + 1)])
        found = (A[r][np.array(columns)] * found[np.array(without)] * sign).sum(axis=1)
        number = {c: i for i, c in enumerate(columns)}
    return found
