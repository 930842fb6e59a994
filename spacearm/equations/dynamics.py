"""The equations of motion of a floating arm in the reduced form H* ddq + c* = tau.

With the momenta P of what each joint carries, and M_bb = diag(M 1, D), H* = M_qq - P M_bb^-1 P^T
and c* = c - P M_bb^-1 c_b: Papadopoulos & Dubowsky, IEEE Trans. Robot. Autom. 7(6), 750-758 (1991),
DOI 10.1109/70.105384. The tests hold this to `mechanics.dynamics`, which takes the mass matrix and
the bias forces from Pinocchio.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from spacearm.equations.jacobian import base_twist
from spacearm.equations.linear import eliminated, pivots, solve
from spacearm.equations.posture import COLUMNS, ROWS, SYMMETRIC, Posture, about, posture
from spacearm.equations.structure import Parameters, Structure


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


def loads_on(
    xp: Any,
    at: Posture,
    h: Any,
    held: Sequence[tuple[int, Any]] = (),
    torques: Sequence[tuple[int, Any]] = (),
    wrenches: Sequence[tuple[int, Any, Any, Any]] = (),
) -> Loads:
    """Return what acts on the bodies, spacecraft axes.

    Args:
        xp: The array library.
        at: The posture.
        h: (3,) angular momentum of the whole.
        held: Body, and momentum (3,) of a wheel that it carries.
        torques: Body, and torque (3,) on it.
        wrenches: Body, point from the system CM, force and moment there, (3,) each.
    """
    rest = [np.zeros(3)] * len(at.masses)
    momenta, forces, moments = [*rest], [*rest], [*rest]
    for body, momentum in held:
        momenta[body] = momenta[body] + momentum
    for body, torque in torques:
        moments[body] = moments[body] + torque
    for body, r, force, moment in wrenches:
        forces[body] = forces[body] + force
        moments[body] = moments[body] + moment + xp.cross(r - at.centres[body], force)
    pushed = xp.concatenate([xp.stack(forces), xp.stack(moments)], axis=1)
    return Loads(h, xp.stack(momenta), pushed)


def generalized_inertia(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute the generalized inertia H* (n, n) of a floating arm."""
    return inertia(xp, tree, posture(xp, tree, p, q))


def inertia(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute M_qq - M_qb M_bb^-1 M_bq: between joints one of which carries the other s_i . P_j.

    These products are taken at joint i: about the system CM, far from light wrists, they would lose
    digits.
    """
    carries = tree.carries[1:, 1:]
    v, w = _own(tree, at)
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
    at = posture(xp, tree, p, q)
    c = bias(xp, tree, at, dq)
    return solve(xp, inertia(xp, tree, at), (tau - c)[:, None])[:, 0]


def accelerations(
    xp: Any, tree: Structure, at: Posture, dq: Any, tau: Any, loads: Loads | None = None
) -> Any:
    """Compute ddq (n,) of H* ddq + c* = tau; NaN where H* or D is not positive definite."""
    H = inertia(xp, tree, at)
    free = (tau - bias(xp, tree, at, dq, loads))[:, None]
    found = solve(xp, H, free)[:, 0]
    sizes = [*pivots(H), *(pivots(at.D) if tree.mode == "free-floating" else [])]
    definite = sizes[0] > 0.0
    for size in sizes[1:]:
        definite = xp.logical_and(definite, size > 0.0)
    return xp.where(definite, found, np.nan)


def loaded_accelerations(
    xp: Any, tree: Structure, p: Parameters, *, q: Any, dq: Any, tau: Any, axes: Any, points: Any,
    h: Any = None, spin: Any = (), wrenches: Any = (), wheels: tuple[int, ...] = (),
    pushed: tuple[int, ...] = (),
) -> Any:  # fmt: skip
    """Compute the joint accelerations (n,) of a state; vectors in spacecraft axes.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        p: Its numbers.
        q: (n,) joint positions.
        dq: (n,) joint rates.
        tau: (n,) joint torques.
        axes: (w, 3) axes of the wheels in the frames of the bodies that carry them.
        points: (k, 3) points that wrenches act at, likewise [m].
        h: (3,) angular momentum about the system CM; None for zero.
        spin: (w,) momentum that each wheel holds.
        wrenches: (k, 6) [force; torque].
        wheels: The bodies that carry the wheels.
        pushed: The bodies that the wrenches act on.
    """
    at = posture(xp, tree, p, q)
    if h is None and not pushed:
        return accelerations(xp, tree, at, dq, tau)
    loads = loads_on(
        xp,
        at,
        np.zeros(3) if h is None else h,
        held=[(body, spin[i] * (at.rotations[body] @ axes[i])) for i, body in enumerate(wheels)],
        wrenches=[
            (
                body,
                at.origins[body] + at.rotations[body] @ points[i],
                wrenches[i, :3],
                wrenches[i, 3:],
            )
            for i, body in enumerate(pushed)
        ],
    )
    return accelerations(xp, tree, at, dq, tau, loads)


def inverse_dynamics(xp: Any, tree: Structure, at: Posture, dq: Any, ddq: Any) -> Any:
    """Compute the torques tau (n,) at zero momentum: H* ddq + c* = tau."""
    return inertia(xp, tree, at) @ ddq + bias(xp, tree, at, dq)


def twists(
    xp: Any, tree: Structure, at: Posture, dq: Any, loads: Loads | None = None
) -> tuple[Any, Any]:
    """Compute the twists (N + 1, 6) of the bodies, beside a system CM at rest, and s dq (N, 6)."""
    rates = tree.gains @ dq
    s = at.s * rates[:, None]
    h = -(rates @ at.P)
    if loads is not None:
        h = h + xp.concatenate([np.zeros(3), loads.h - loads.held.sum(axis=0)], axis=0)
    return _outwards(xp, tree, base_twist(xp, tree, at, h[:, None])[:, 0], s), s


def _outwards(xp: Any, tree: Structure, base: Any, s: Any) -> Any:
    """Compute the sums (N + 1, 6) over all joints that carry a body, and the base's own."""
    sums = [base]
    for i in range(1, len(tree.parents)):
        sums.append(sums[tree.parents[i]] + s[i - 1])
    return xp.stack(sums)


def bias(xp: Any, tree: Structure, at: Posture, dq: Any, loads: Loads | None = None) -> Any:
    """Compute c* (n,), the torques that keep the joint rates constant.

    With nu_i the twists of the bodies, the sums a_i of nu_k x s_k dq_k over the joints k that carry
    them are their accelerations while spacecraft and joints have none. Newton's and Euler's
    equations give force and torque that each body takes, F and N what each joint transmits, about
    itself. Accelerating the spacecraft takes P M_bb^-1 c_b of that.
    """
    nu, s = twists(xp, tree, at, dq, loads)
    a = _outwards(xp, tree, np.zeros(6), _crossed(xp, nu[1:], s))
    v, w, r = nu[:, :3], nu[:, 3:], at.centres
    spin = (at.inertias @ w[..., None])[..., 0]
    swing = v + xp.cross(w, r)
    force = at.masses * (a[:, :3] + xp.cross(a[:, 3:], r) + xp.cross(w, swing))
    torque = (at.inertias @ a[:, 3:, None])[..., 0]
    if loads is not None:
        spin = spin + loads.held
        force = force - loads.wrenches[:, :3]
        torque = torque - loads.wrenches[:, 3:]
    torque = torque + xp.cross(w, spin)
    F, N = [*force], [*(torque + xp.cross(r - at.origins, force))]
    for i in range(len(F) - 1, 0, -1):
        inner = tree.parents[i]
        F[inner] = F[inner] + F[i]
        N[inner] = N[inner] + N[i] + xp.cross(at.origins[i] - at.origins[inner], F[i])
    v, w = _own(tree, at)
    c = (v * xp.stack(F[1:]) + w * xp.stack(N[1:])).sum(axis=1)
    c_b = xp.concatenate([F[0], N[0] + xp.cross(at.origins[0], F[0])], axis=0)
    return tree.gains.T @ (c - at.P @ base_twist(xp, tree, at, c_b[:, None])[:, 0])


def _own(tree: Structure, at: Posture) -> tuple[Any, Any]:
    """Return what each joint does at its own origin per unit rate: velocities and turns (N, 3)."""
    slides = np.array(tree.slides[1:])[:, None] * 1.0
    return slides * at.s[:, :3], at.s[:, 3:]


def _carried(xp: Any, tree: Structure, at: Posture) -> tuple[Any, Any]:
    """Compute first moments (N, 3) and inertias (N, 3, 3) of what joints carry, about each."""
    r = at.centres - at.origins
    m, s = [*at.masses], [*(at.masses * r)]
    I = [*(at.inertias[:, ROWS, COLUMNS] + about(r, at.masses * r))]
    for i in range(len(I) - 1, 0, -1):
        if (inner := tree.parents[i]) > 0:
            e = (at.origins[i] - at.origins[inner])[None]
            mean = s[i] + 0.5 * m[i] * e
            I[inner] = I[inner] + I[i] + (about(e, mean) + about(mean, e))[0]
            m[inner], s[inner] = m[inner] + m[i], s[inner] + s[i] + m[i] * e[0]
    return xp.stack(s[1:]), xp.stack(I[1:])[:, SYMMETRIC]


def _crossed(xp: Any, a: Any, b: Any) -> Any:
    """Compute the twists a x b, (m, 6)."""
    v = xp.cross(a[:, 3:], b[:, :3]) + xp.cross(a[:, :3], b[:, 3:])
    return xp.concatenate([v, xp.cross(a[:, 3:], b[:, 3:])], axis=1)
