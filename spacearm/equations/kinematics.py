"""The structure and the numbers of a floating arm, where its bodies are, their momentum, and J*.

The equations of a floating arm stand here once, as plain array code for NumPy, JAX and symbols. All
quantities are relative to the system CM and in spacecraft axes; twists and momenta are [linear;
angular]. `xp` is the array library: `compiler.numbers`, `compiler.symbols`, `jax.numpy`, or
`numpy`, whose arrays may hold the symbols of CasADi. Nothing branches on numbers or writes into
arrays, so that derivatives can be taken through it.

With s_i the axis of joint i as a twist and I_i the inertia of all that it carries, the momentum
per joint rate is A_q = [I_i s_i]. That of the whole per twist of the spacecraft is A_b = diag(M 1,
D). Then J* = J_q - J_b A_b^-1 A_q, equation (35) of Papadopoulos & Dubowsky (1993), DOI
10.1115/1.2897406. The tests hold this to `mechanics.jacobian`, which takes the momentum matrix
from Pinocchio, and to `mechanics.barycentric_formulation`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.equations.linear_algebra import solve

Array = npt.NDArray[np.float64]
Mode = Literal["free-floating", "attitude-controlled", "fixed"]


class Parameters(NamedTuple):
    """The numbers of an arm with N joints, in the frames of its model; a pytree of JAX.

    Body 0 is the spacecraft, joint i = 1..N carries body i, whose frame stands in that joint. A
    link that is fixed to another belongs to its body.

    Attributes:
        masses: (N + 1,) mass of each body [kg].
        centres: (N + 1, 3) its CM in its frame [m].
        inertias: (N + 1, 3, 3) its inertia about that CM, axes of its frame [kg m^2].
        joint_positions: (N, 3) origin of each joint in the frame of the body before it [m].
        joint_rotations: (N, 3, 3) attitude of the joint at zero in that frame.
        tip_positions: (tips, 3) origin of each tip in the frame of the body it is fixed to [m].
        tip_rotations: (tips, 3, 3) its attitude in that frame.
    """

    masses: Any
    centres: Any
    inertias: Any
    joint_positions: Any
    joint_rotations: Any
    tip_positions: Any
    tip_rotations: Any


@dataclass(frozen=True, eq=False)
class Structure:
    """How the bodies of an arm hang together, and what the spacecraft does.

    Structures with the same numbers are equal, so that what is compiled for one serves the other.

    Attributes:
        n: Number of joints that count.
        parents: (N + 1,) body that the joint of each starts from; parents come first, 0 is its own.
        slides: (N + 1,) whether the joint of each body is prismatic.
        gains: (N, n) rates of all joints per rate of those that count.
        offsets: (N,) positions of all joints at q = 0 [rad] or [m].
        turns: (N + 1, 3, 3) take z to the axis of the joint, in the frame of its body.
        tips: Number of the body that each tip is fixed to.
        rows: (k,) rows of the task in the stacked twists of all tips.
        scale: (k, 1) their factors.
        mode: What the spacecraft does.
        normal: Normal axis (0, 1, 2) of an arm that is known to move in a plane, else None.
    """

    n: int
    parents: tuple[int, ...]
    slides: tuple[bool, ...]
    gains: Array
    offsets: Array
    turns: Array
    tips: tuple[int, ...]
    rows: tuple[int, ...]
    scale: Array
    mode: Mode
    normal: int | None = None

    @cached_property
    def slide(self) -> Array:
        """(N, 1) 1 where a joint is prismatic, else 0."""
        return np.array(self.slides[1:])[:, None] * 1.0

    @cached_property
    def carries(self) -> Array:
        """(N + 1, N + 1) 1 where joint i (row; 0 is the whole) carries body j, else 0."""
        found = np.eye(len(self.parents))
        for i in range(len(found) - 1, 0, -1):
            found[self.parents[i]] += found[i]
        return found

    @cached_property
    def reaches(self) -> Array:
        """(tips, N) 1 where a joint moves a tip, else 0."""
        return self.carries[1:, self.tips].T

    @cached_property
    def _key(self) -> tuple[Any, ...]:
        arrays = (self.gains, self.offsets, self.turns, self.scale)
        discrete = (self.n, self.parents, self.slides, self.tips, self.rows, self.mode, self.normal)
        return (*discrete, *(array.tobytes() for array in arrays))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Structure) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


Z = np.array([0.0, 0.0, 1.0])
#: Elements of a symmetric matrix (3, 3) that determine it, (6,) each.
ROWS, COLUMNS = np.triu_indices(3)
#: Which of them stands where.
SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
#: Take [force; torque] to [torque; force], which change with a motion as [linear; angular] do.
TWIST = np.array([3, 4, 5, 0, 1, 2])


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
        carried: Masses (N, 1), first moments (N, 3) and inertias (N, 3, 3) that the joints carry.
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
    carried: tuple[Any, Any, Any]


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
    turn = 1.0 - tree.slide
    v, w = tree.slide * u + turn * xp.cross(arm, u), turn * u
    s = xp.concatenate([v, w], axis=1)
    m, moment, I = (gathered(xp, tree, values) for values in (masses, moments, whole))
    carried = m[1:], moment[1:], I[1:, SYMMETRIC]
    P = momenta(xp, *carried, s)
    return Posture(
        M, r_cm, tips, R[body] @ (own[body] @ p.tip_rotations), masses, x,
        inertias[:, SYMMETRIC], I[0, SYMMETRIC], s, P, R @ own, a - r_cm, carried,
    )  # fmt: skip


def gathered(xp: Any, tree: Structure, values: Any) -> Any:
    """Return the sums of values (N + 1, ...) over all that each joint carries; 0 is the whole."""
    sums = list(values)
    for i in range(len(sums) - 1, 0, -1):
        sums[tree.parents[i]] = sums[tree.parents[i]] + sums[i]
    return xp.stack(sums)


def outwards(xp: Any, tree: Structure, base: Any, s: Any) -> Any:
    """Return the sums (N + 1, 6) over all joints that carry a body, and the base's own."""
    sums = [base]
    for i in range(1, len(tree.parents)):
        sums.append(sums[tree.parents[i]] + s[i - 1])
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


def connection(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute -D^-1 D_q (3, n) of (33c): the spacecraft turns with w_0 = connection dq."""
    return connection_at(xp, tree, posture(xp, tree, p, q))


def connection_at(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute the connection (3, n) of a posture."""
    return response(xp, tree, at)[3:] @ tree.gains


def jacobian(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute J* (6 tips, n) of (35), in the mode of the structure."""
    return jacobian_at(xp, tree, posture(xp, tree, p, q))


def jacobian_at(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute J* (6 tips, n) of a posture."""
    X, v, w = response(xp, tree, at), at.s[:, :3], at.s[:, 3:]
    blocks = []
    for tip in range(len(tree.tips)):
        r, reaches = at.tip_positions[tip], tree.reaches[tip][:, None]
        angular = reaches * w + X[3:].T
        linear = reaches * v + X[:3].T + xp.cross(angular, r)
        blocks.append(xp.concatenate([linear, angular], axis=1).T)
    return xp.concatenate(blocks, axis=0) @ tree.gains


def base_twist(xp: Any, tree: Structure, at: Posture, h: Any) -> Any:
    """Compute M_bb^-1 h (6, m), the spacecraft's twist about the system CM, of what is free of it.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        at: The posture.
        h: (6, m) momenta of the whole.
    """
    rest = np.zeros((3, h.shape[1]))
    linear = rest if tree.mode == "fixed" else h[:3] * (1.0 / at.M)
    angular = solve(xp, at.D, h[3:]) if tree.mode == "free-floating" else rest
    return xp.concatenate([linear, angular], axis=0)


def response(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute the spacecraft's twist (6, N) about the system CM per unit rate of the joints."""
    return base_twist(xp, tree, at, -at.P.T)


def slopes(xp: Any, tree: Structure, at: Posture, force: Any, ways: Iterable[Any]) -> list[Any]:
    """Compute the gradients (n,) of force . J* dq by the joints, for several dq.

    With the spacecraft's twist v_b = -A_b^-1 A_q dq and y = A_b^-1 J_b^T force each is that of
    force . (J_b v_b + J_q dq) - y . (A_b v_b + A_q dq), in which v_b and y count as constant, and
    a joint turns all that it carries as one body.

    Args:
        xp: The array library.
        tree: The structure of the arm.
        at: The posture.
        force: (6 tips,) forces and torques at the tips.
        ways: (n,) the dq.
    """
    s, r, f = at.s, at.tip_positions, force.reshape(-1, 6)
    linear, angular = f[:, :3], f[:, 3:]
    wrenches = xp.concatenate([linear, angular + xp.cross(r, linear)], axis=1)
    y = base_twist(xp, tree, at, wrenches.sum(axis=0)[:, None])[:, 0]
    turned = across(xp, s, y[None])
    beside = tree.reaches.T @ wrenches - momenta(xp, *at.carried, y[None])
    own = momenta(xp, *at.carried, turned) + across(xp, s, beside[:, TWIST])[:, TWIST]
    found = []
    for way in ways:
        rates = (tree.gains @ way)[:, None]
        below = [np.zeros(6)] * len(tree.parents)
        for i in range(len(s), 0, -1):
            inner = tree.parents[i]
            below[inner] = below[inner] + (below[i] + rates[i - 1] * at.P[i - 1])
        base = base_twist(xp, tree, at, -below[0][:, None])[:, 0]
        twists = outwards(xp, tree, base, rates * s)
        tips = twists[list(tree.tips)]
        v, w = tips[:, :3] + xp.cross(tips[:, 3:], r), tips[:, 3:]
        lever = tree.reaches.T @ (xp.cross(linear, v) + xp.cross(angular, w))
        parts = twists[1:] * own + turned * xp.stack(below[1:])
        found.append(tree.gains.T @ (parts.sum(axis=1) - (s[:, 3:] * lever).sum(axis=1)))
    return found


def across(xp: Any, s: Any, x: Any) -> Any:
    """Return how twists x (m, 6) change as bodies move by twists s (m, 6)."""
    v, w = s[:, :3], s[:, 3:]
    linear = xp.cross(w, x[:, :3]) + xp.cross(v, x[:, 3:])
    return xp.concatenate([linear, xp.cross(w, x[:, 3:])], axis=1)


def task_jacobian(xp: Any, tree: Structure, p: Parameters, q: Any) -> Any:
    """Compute the rows (k, n) of J* that the task names, scaled."""
    return task_jacobian_at(xp, tree, posture(xp, tree, p, q))


def task_jacobian_at(xp: Any, tree: Structure, at: Posture) -> Any:
    """Compute the `task_jacobian` of a posture."""
    return tree.scale * jacobian_at(xp, tree, at)[np.array(tree.rows)]
