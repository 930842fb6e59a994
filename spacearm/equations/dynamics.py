"""The equations of motion of a floating arm in the reduced form H* ddq + c* = tau.

With the momenta P of what each joint carries, and M_bb = diag(M 1, D), H* = M_qq - P M_bb^-1 P^T
and c* = c - P M_bb^-1 c_b: Papadopoulos & Dubowsky, IEEE Trans. Robot. Autom. 7(6), 750-758 (1991),
DOI 10.1109/70.105384. The tests hold this to `mechanics.dynamics`, which takes the mass matrix and
the bias forces from Pinocchio.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from spacearm.equations import kinematics
from spacearm.equations.kinematics import Parameters, Posture, Structure
from spacearm.equations.linear_algebra import eliminated, pivots, solve


class Loads(NamedTuple):
    """What acts on the bodies besides the joints, about the system CM in spacecraft axes.

    Attributes:
        h: (3,) angular momentum of the whole, that of the wheels included [N m s]; counts for a
            free-floating spacecraft.
        held: (N + 1, 3) momentum that the wheels on each body hold [N m s].
        wrenches: (N + 1, 6) [force; torque about its CM] on each body from outside and from its
            wheels. motors [N], [N m].
    """

    h: Any
    held: Any
    wrenches: Any


def unloaded(at: Posture) -> Loads:
    """Return the loads of an arm on which nothing acts."""
    count = len(at.masses)
    return Loads(np.zeros(3), np.zeros((count, 3)), np.zeros((count, 6)))


def generalized_inertia(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute the generalized inertia H* (n, n) of a floating arm."""
    return inertia(xp, tree, kinematics.posture(xp, tree, p, q))


def inertia(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute M_qq - M_qb M_bb^-1 M_bq: between joints one of which carries the other s_i . P_j.

    These products are taken at joint i: about the system CM, far from light wrists, they would lose
    digits.
    """
    carries = tree.carries[1:, 1:]
    v, w = tree.slide * at.s[:, :3], at.s[:, 3:]  # of each joint at its own origin
    linear = at.P[:, :3]
    moments, I = _carried(xp, tree, at)
    spins = (I @ w[..., None])[..., 0] + xp.cross(moments, v)
    between = at.origins[None, 1:] - at.origins[1:, None]
    moved = spins + xp.cross(between, linear[None])
    half = carries * (v @ linear.T + (w[:, None] * moved).sum(axis=2))
    M_qq = half + half.T - np.eye(len(carries)) * half
    return tree.gains.T @ (M_qq - _of_base(tree, at)) @ tree.gains


def _of_base(tree: Structure, at: Posture) -> Any:
    """Compute M_qb M_bb^-1 M_bq (N, N), each product of two joints once."""
    found = np.zeros((len(at.P), len(at.P)))
    if tree.mode != "fixed":
        found = found + at.P[:, :3] @ at.P[:, :3].T * (1.0 / at.M)
    D, h = at.D, at.P[:, 3:]
    while tree.mode == "free-floating" and len(D):
        found = found + h[:, :1] @ h[:, :1].T * (1.0 / D[:1, 0])
        h = h[:, 1:] - h[:, :1] * (D[1:, 0] * (1.0 / D[:1, 0]))
        D = eliminated(D)
    return found


def forward_dynamics(xp: Any, tree: Structure, p: Parameters, q: Any, dq: Any, tau: Any) -> Any:
    """Compute the joint accelerations (n,) at zero momentum: H* ddq + c* = tau."""
    at = kinematics.posture(xp, tree, p, q)
    free = (tau - bias(xp, tree, at, dq, unloaded(at)))[:, None]
    return solve(xp, inertia(xp, tree, at), free)[:, 0]


def accelerations(xp: Any, tree: Structure, at: Posture, dq: Any, tau: Any, loads: Loads) -> Any:
    """Compute ddq (n,) of H* ddq + c* = tau; NaN where H* or D is not positive definite."""
    H = inertia(xp, tree, at)
    free = (tau - bias(xp, tree, at, dq, loads))[:, None]
    found = solve(xp, H, free)[:, 0]
    sizes = [*pivots(H), *(pivots(at.D) if tree.mode == "free-floating" else [])]
    definite = sizes[0] > 0.0
    for size in sizes[1:]:
        definite = xp.logical_and(definite, size > 0.0)
    return xp.where(definite, found, np.nan)


def inverse_dynamics(xp: Any, tree: Structure, at: Posture, dq: Any, ddq: Any) -> Any:
    """Compute the torques tau (n,) at zero momentum: H* ddq + c* = tau."""
    return inertia(xp, tree, at) @ ddq + bias(xp, tree, at, dq, unloaded(at))


def twists(xp: Any, tree: Structure, at: Posture, dq: Any, loads: Loads) -> tuple[Any, Any]:
    """Compute the twists (N + 1, 6) of the bodies, with the system CM at rest, and s dq (N, 6)."""
    rates = tree.gains @ dq
    s = at.s * rates[:, None]
    own = loads.h - loads.held.sum(axis=0)
    h = xp.concatenate([np.zeros(3), own], axis=0) - rates @ at.P
    base = kinematics.base_twist(xp, tree, at, h[:, None])[:, 0]
    return kinematics.outwards(xp, tree, base, s), s


def bias(xp: Any, tree: Structure, at: Posture, dq: Any, loads: Loads) -> Any:
    """Compute c* (n,), the torques that keep the joint rates constant.

    With nu_i the twists of the bodies, the sums a_i of nu_k x s_k dq_k over the joints k that carry
    them are their accelerations while spacecraft and joints have none. Newton's and Euler's
    equations give force and torque that each body takes, F what each joint transmits, about the
    system CM. Accelerating the spacecraft takes P M_bb^-1 F_0 of that.
    """
    nu, s = twists(xp, tree, at, dq, loads)
    v, w, r = nu[:, :3], nu[:, 3:], at.centres
    a = kinematics.outwards(xp, tree, np.zeros(6), kinematics.across(xp, nu[1:], s))
    spin = (at.inertias @ w[..., None])[..., 0] + loads.held
    moved = a[:, :3] + xp.cross(a[:, 3:], r) + xp.cross(w, v + xp.cross(w, r))
    force = at.masses * moved - loads.wrenches[:, :3]
    torque = (at.inertias @ a[:, 3:, None])[..., 0] + xp.cross(w, spin) - loads.wrenches[:, 3:]
    wrenches = xp.concatenate([force, torque + xp.cross(r, force)], axis=1)
    F = kinematics.gathered(xp, tree, wrenches)
    base = kinematics.base_twist(xp, tree, at, F[0][:, None])[:, 0]
    return tree.gains.T @ ((at.s * F[1:]).sum(axis=1) - at.P @ base)


def _carried(xp: Any, tree: Structure, at: Posture) -> tuple[Any, Any]:
    """Compute first moments (N, 3) and inertias (N, 3, 3) of what joints carry, about each."""
    r = at.centres - at.origins
    m, s = [*at.masses], [*(at.masses * r)]
    six = at.inertias[:, kinematics.ROWS, kinematics.COLUMNS]
    I = [*(six + kinematics.about(r, at.masses * r))]
    for i in range(len(I) - 1, 0, -1):
        if (inner := tree.parents[i]) > 0:
            e = (at.origins[i] - at.origins[inner])[None]
            mean = s[i] + 0.5 * m[i] * e
            I[inner] = I[inner] + I[i] + (kinematics.about(e, mean) + kinematics.about(mean, e))[0]
            m[inner], s[inner] = m[inner] + m[i], s[inner] + s[i] + m[i] * e[0]
    return xp.stack(s[1:]), xp.stack(I[1:])[:, kinematics.SYMMETRIC]
