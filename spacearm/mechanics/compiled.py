"""An arm as records for the compiled kernels. Imports numba, so import it only where it is used."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.kernels import cpu
from spacearm.kernels import minors as determinants
from spacearm.kernels.floating import BODY, Bodies, Indices
from spacearm.kernels.lanes import LARGEST_ANGLE
from spacearm.kernels.quantities import QUANTITIES
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import FREE_TWIST, BaseMode
from spacearm.model.scale import radians

Z = np.array([0.0, 0.0, 1.0])


def measures(arm: SpaceArm, q: Array, wants_condition: bool) -> dict[str, Array]:
    """Compute the `QUANTITIES` at q (n, m), each (m,)."""
    rows, scale = np.array(arm.task.indices), arm.task.scale[:, 0].copy()
    values = np.empty((len(QUANTITIES), q.shape[1]))
    cpu.measures(*bodies(arm), arm.n, rows, scale, _all_joints(arm, q), wants_condition, values)
    return dict(zip(QUANTITIES, values, strict=True))


def distances(arm: SpaceArm, q: Array) -> dict[str, Array]:
    """Compute the quantities `NEARNESS` at q (n, m): (m,) and (m, n)."""
    rows, scale = np.array(arm.task.indices), arm.task.scale[:, 0].copy()
    v = np.empty((1 + arm.n, q.shape[1]))
    cpu.distances(*bodies(arm), rows, scale, radians(arm), _all_joints(arm, q), v)
    return {"distance": v[0], "away": v[1:].T}


def measures_on_card(arm: SpaceArm, q: Array, wants_condition: bool) -> dict[str, Array]:
    """Compute `measures` on the graphics card."""
    from spacearm.kernels.cuda import THREADS, cuda, kernel

    q = _all_joints(arm, q)
    N, m = q.shape
    values = cuda.device_array((len(QUANTITIES), m))
    b, tip, E = bodies(arm)
    rows, scale = np.array(arm.task.indices), arm.task.scale[:, 0].copy()
    launch = kernel(N, arm.n)[-(-m // THREADS), THREADS]
    b, E, rows, scale, q = map(cuda.to_device, (b, E, rows, scale, q))
    launch(b, tip, E, rows, scale, q, wants_condition, values)
    return dict(zip(QUANTITIES, values.copy_to_host(), strict=True))


def no_card() -> str | None:
    """Say why no graphics card can be used, or return None if one can."""
    try:
        from spacearm.kernels.cuda import cuda
    except ImportError as error:
        return str(error)
    return None if cuda.is_available() else "no NVIDIA driver or no card answers"


def jacobians(arm: SpaceArm, q: Array) -> Array:
    """Compute the generalized Jacobians (m, 6, n) at q (n, m)."""
    J = np.empty((q.shape[1], 6, arm.n))
    cpu.jacobians(*bodies(arm), _all_joints(arm, q), J)
    return J


class Reactions(NamedTuple):
    """J*, the connection and the tip pose of m configurations, in spacecraft axes.

    Attributes:
        J: (m, 6, n) J* [m/rad], [1].
        A: (m, 3, n) the connection -D^-1 D_q of (33c): w_0 = A dq.
        r: (m, 3) the tip from the system CM [m].
        R: (m, 3, 3) attitude of the tip.
    """

    J: Array
    A: Array
    r: Array
    R: Array


def reactions(arm: SpaceArm, q: Array) -> Reactions:
    """Compute J*, the connection and the tip pose at q (n, m)."""
    m, n = q.shape[1], arm.n
    at = Reactions(np.empty((m, 6, n)), np.empty((m, 3, n)), np.empty((m, 3)), np.empty((m, 3, 3)))
    cpu.reactions(*bodies(arm), _all_joints(arm, q), *at)
    model, frame = arm.model, arm.model.frames[arm.tip_frame]
    own = arm.tree.joints[model.names[frame.parentJoint]].axis if frame.parentJoint > 1 else Z
    return at._replace(R=at.R @ (_z_to(own).T @ frame.placement.rotation))


def minors(arm: SpaceArm, q: Array, mode: BaseMode, rows: Indices, columns: Indices) -> Array:
    """Compute determinants (m, c) at q (n, m), up to one positive factor; see `kernels.minors`.

    Args:
        arm: The arm.
        q: (n, m) joint positions.
        mode: What the spacecraft does.
        rows: (k,) rows of momentum, or of the twist of the tip if the spacecraft is held.
        columns: (c, k) columns of each minor: 0 to 5 the tip's twist, 6 + j joint j.
    """
    return _minors(arm, q, mode, rows, columns, np.empty((0, len(columns))))


def sizes_of_minors(
    arm: SpaceArm, q: Array, mode: BaseMode, rows: Indices, columns: Indices
) -> tuple[Array, Array]:
    """Compute `minors` and the products of the lengths of their columns, which bound them."""
    sizes = np.empty((q.shape[1], len(columns)))
    return _minors(arm, q, mode, rows, columns, sizes), sizes


def _minors(
    arm: SpaceArm, q: Array, mode: BaseMode, rows: Indices, columns: Indices, sizes: Array
) -> Array:
    row, column = _units(arm, mode == "free-floating")
    values = np.empty((q.shape[1], len(columns)))
    determinants.minors(
        *bodies(arm), arm.n, list(FREE_TWIST).index(mode), rows, columns, row, column,
        _all_joints(arm, q), values, sizes,
    )  # fmt: skip
    return values


def _units(arm: SpaceArm, floating: bool) -> tuple[Array, Array]:
    """Return factors of rows (6,) and columns (6 + n,) that make them of order one.

    They are made of the arm's size and of the mass that each joint moves, so that neither tiny nor
    huge arms, nor very light spacecraft, leave the range of floating-point numbers.
    """
    b, _, E = bodies(arm)
    reach = np.linalg.norm(b["t"], axis=1).sum() + np.linalg.norm(E)
    M = float(b[0]["carried"])
    gyration = float(np.sqrt(np.trace(b["I"], axis1=1, axis2=2).sum() / M))
    L = float(reach + np.linalg.norm(b["c"], axis=1).max() + gyration) or 1.0
    row = np.repeat((1.0 / M, 1.0 / (M * L)) if floating else (1.0, L), 3)
    column = np.ones(6 + arm.n)
    column[3:6] = 1.0 / L
    share = b["m"] / M
    for i in range(len(b) - 1, 0, -1):
        if not b[i]["on_chain"]:
            share[b[i]["parent"]] += share[i]
    for i in range(1, len(b)):
        inner = share[b[i]["parent"]] if b[i]["on_chain"] else share[i]
        column[6 + b[i]["column"]] = (1.0 if b[i]["slides"] else 1.0 / L) / (
            inner if floating and inner > 0.0 else 1.0
        )
        if b[i]["on_chain"]:
            share[i] += share[b[i]["parent"]]
    return row, column


def tips(arm: SpaceArm, q: Array, mode: BaseMode) -> Array:
    """Compute the tip (m, 3) from the system CM, or a fixed spacecraft's own, at q (n, m) [m]."""
    r = np.empty((q.shape[1], 3))
    determinants.tips(*bodies(arm), mode == "fixed", _all_joints(arm, q), r)
    return r


@lru_cache(maxsize=64)
def bodies(arm: SpaceArm) -> tuple[Bodies, int, Array]:
    """Return the constants of the bodies, the tip's body and the tip (3,) in its frame [m]."""
    model, names = arm.model, list(arm.model.names)
    joints = [arm.tree.joints[name] for name in names[2:]]
    coupling = np.eye(arm.n) if arm.coupling is None else arm.coupling
    frame = model.frames[arm.tip_frame]
    chain = [int(i) for i in model.supports[frame.parentJoint]]
    turn = [np.eye(3), *(_z_to(joint.axis) for joint in joints)]
    b = np.zeros(model.njoints - 1, BODY)  # Pinocchio's joint 1 carries the spacecraft, body 0
    for i, S in enumerate(turn):
        inertia = model.inertias[i + 1]
        b[i]["m"] = b[i]["carried"] = inertia.mass
        b[i]["c"], b[i]["I"] = S.T @ inertia.lever, S.T @ inertia.inertia @ S
        if i > 0:
            parent, placement = int(model.parents[i + 1]) - 1, model.jointPlacements[i + 1]
            b[i]["parent"] = parent
            b[i]["slides"] = joints[i - 1].kind == "prismatic"
            b[i]["on_chain"] = i + 1 in chain
            b[i]["column"] = column = int(np.abs(coupling[i - 1]).argmax())
            b[i]["gain"] = coupling[i - 1, column]
            b[i]["E"] = turn[parent].T @ placement.rotation @ S
            b[i]["t"] = turn[parent].T @ placement.translation
    for i in range(len(b) - 1, 0, -1):
        b[b[i]["parent"]]["carried"] += b[i]["carried"]
    tip = frame.parentJoint - 1
    return b, tip, turn[tip].T @ frame.placement.translation


def _z_to(axis: Array) -> Array:
    """Return a rotation (3, 3) that takes z to the axis."""
    return pin.Quaternion.FromTwoVectors(Z, axis).matrix()


def _all_joints(arm: SpaceArm, q: Array) -> Array:
    """Return positions (N, m) of all joints, mimic joints too, large angles reduced to a turn."""
    if arm.coupling is not None:
        q = arm.coupling @ q + arm.offsets[:, None]
    turns = ~bodies(arm)[0]["slides"][1:]
    if (np.abs(q[turns]) > LARGEST_ANGLE).any():
        q[turns] = np.arctan2(np.sin(q[turns]), np.cos(q[turns]))
    return q
