"""An arm as records for the compiled kernels. Imports numba, so import it only where it is used."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.kernels import cpu
from spacearm.kernels import minors as determinants
from spacearm.kernels.floating import BODY, Bodies, Indices
from spacearm.kernels.lanes import LARGEST_ANGLE
from spacearm.kernels.quantities import NEARNESS, QUANTITIES
from spacearm.mechanics.nearness import FADING, Tangent, refined
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import FREE_TWIST, BaseMode
from spacearm.model.scale import radians

Z = np.array([0.0, 0.0, 1.0])
ENDLESS = 1e100
"""Mass [kg] and inertia [kg m^2] beside which those of any arm are nothing."""


def measures(arm: SpaceArm, q: Array, wants_condition: bool) -> dict[str, Array]:
    """Compute the `QUANTITIES` at q (n, m), each (m,)."""
    values = np.empty((len(QUANTITIES), q.shape[1]))
    q = all_positions(arm, q)
    cpu.measures(*bodies(arm), arm.n, *_task(arm), q, wants_condition, values)
    return dict(zip(QUANTITIES, values, strict=True))


def tangent(
    arm: SpaceArm, Q: Array, mode: BaseMode = "free-floating", fading: float = FADING
) -> Tangent:
    """Compute how the singular set looks from configurations Q (m, n); see `nearness.tangent`."""
    return _tangent(arm, Q, mode, arm.n - arm.task.k + 1, cpu.distances, fading)


def distances(arm: SpaceArm, q: Array, mode: BaseMode = "free-floating") -> dict[str, Array]:
    """Compute the quantities `NEARNESS` at q (n, m): (m,) and (m, n)."""
    return _distances(arm, q, cpu.distances, mode)


def _distances(
    arm: SpaceArm, q: Array, kernel: Callable[..., None], mode: BaseMode = "free-floating"
) -> dict[str, Array]:
    """Compute `distances` by a kernel with the arguments of `cpu.distances`."""
    if arm.n < arm.task.k:  # singular everywhere; NaN stays NaN
        zero = 0.0 * q.sum(axis=0)
        return {"distance": zero, "away": np.repeat(zero[:, None], arm.n, axis=1)}

    def look(Q: Array, fading: float) -> Tangent:  # one row is not enough for the second step
        return _tangent(arm, Q, mode, arm.n - arm.task.k + 1, kernel, fading)

    first = _tangent(arm, q.T, mode, 1, kernel)
    return dict(zip(NEARNESS, refined(arm, q.T, first, look), strict=True))


def _tangent(
    arm: SpaceArm,
    Q: Array,
    mode: BaseMode,
    rows: int,
    kernel: Callable[..., None],
    fading: float = FADING,
) -> Tangent:
    """Compute `tangent`, some rows of it, by a kernel with the arguments of `cpu.distances`."""
    m, n = Q.shape
    v = np.empty((2 + rows * n, m))
    kernel(*bodies(arm, mode), *_task(arm), radians(arm), fading, all_positions(arm, Q.T), v)
    v[2:] = np.where((v[0] == 0.0) & np.isnan(v[2:]), 0.0, v[2:])  # singular all around
    return Tangent(v[0], v[1], v[2:].reshape(rows, n, m).transpose(2, 0, 1))


def _task(arm: SpaceArm) -> tuple[Indices, Array]:
    """Return the rows of the twist that the task has, and their factors, (k,) each."""
    return np.array(arm.task.indices), arm.task.scale[:, 0].copy()


def measures_on_card(arm: SpaceArm, q: Array, wants_condition: bool) -> dict[str, Array]:
    """Compute `measures` on the graphics card."""
    from spacearm.kernels.cuda import launched, measures

    q = all_positions(arm, q)
    values = np.empty((len(QUANTITIES), q.shape[1]))
    kernel = measures(len(q), arm.n)
    launched(kernel, *bodies(arm), *_task(arm), q, wants_condition, values)
    return dict(zip(QUANTITIES, values, strict=True))


def distances_on_card(arm: SpaceArm, q: Array, _: bool = False) -> dict[str, Array]:
    """Compute `distances` on the graphics card."""
    from spacearm.kernels.cuda import distances, launched

    rows = arm.n - arm.task.k + 1
    return _distances(arm, q, partial(launched, distances(len(bodies(arm)[0]) - 1, arm.n, rows)))


def no_card() -> str | None:
    """Say why no graphics card can be used, or return None if one can."""
    try:
        from spacearm.kernels.cuda import cuda
    except ImportError as error:
        return str(error)
    return None if cuda.is_available() else "no NVIDIA driver or no card answers"


def jacobians(arm: SpaceArm, q: Array, mode: BaseMode = "free-floating") -> Array:
    """Compute the generalized Jacobians (m, 6, n) at q (n, m)."""
    J = np.empty((q.shape[1], 6, arm.n))
    cpu.jacobians(*bodies(arm, mode), all_positions(arm, q), J)
    return J


def singular_values(arm: SpaceArm, q: Array, mode: BaseMode) -> Array:
    """Compute the singular values (m, min(k, n)) of the task Jacobians at q (n, m)."""
    task = arm.task
    J = task.components(jacobians(arm, q, mode), task.axes(np.eye(3)))
    return np.linalg.svd(task.scale * J, compute_uv=False)


class OnBody(NamedTuple):
    """A frame of the arm, as the kernels want it.

    Attributes:
        body: Number of the body that it is fixed to.
        p: (3,) its origin in the frame of that body [m].
        rotation: (3, 3) its attitude in that frame.
    """

    body: int
    p: Array
    rotation: Array


def frame_on_body(arm: SpaceArm, frame: int) -> OnBody:
    """Return where a frame of the arm's model is fixed."""
    model, at = arm.model, arm.model.frames[frame]
    own = arm.tree.joints[model.names[at.parentJoint]].axis if at.parentJoint > 1 else Z
    turn = _z_to(own).T
    return OnBody(at.parentJoint - 1, turn @ at.placement.translation, turn @ at.placement.rotation)


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


def unit_of_minors(arm: SpaceArm, mode: BaseMode, rows: Indices, columns: Indices) -> Array:
    """Return the positive factors (c,) by which `minors` of an arm are scaled."""
    row, column = _units(arm, mode == "free-floating")
    return np.asarray(row[rows].prod() * column[columns].prod(axis=1))


def _minors(
    arm: SpaceArm, q: Array, mode: BaseMode, rows: Indices, columns: Indices, sizes: Array
) -> Array:
    row, column = _units(arm, mode == "free-floating")
    values = np.empty((q.shape[1], len(columns)))
    determinants.minors(
        *bodies(arm), arm.n, list(FREE_TWIST).index(mode), rows, columns, row, column,
        all_positions(arm, q), values, sizes,
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
    determinants.tips(*bodies(arm), mode == "fixed", all_positions(arm, q), r)
    return r


@lru_cache(maxsize=64)
def bodies(arm: SpaceArm, mode: BaseMode = "free-floating") -> tuple[Bodies, int, Array]:
    """Return the constants of the bodies, the tip's body and the tip (3,) in its frame [m].

    A spacecraft that does not turn has no end of inertia, one that is fixed no end of mass too.
    """
    tip = frame_on_body(arm, arm.tip_frame)
    b = all_bodies(arm, mode).copy()
    for i in arm.model.supports[arm.model.frames[arm.tip_frame].parentJoint]:
        if i > 1:
            b[int(i) - 1]["on_chain"] = True
    return b, tip.body, tip.p


@lru_cache(maxsize=64)
def all_bodies(arm: SpaceArm, mode: BaseMode = "free-floating") -> Bodies:
    """Return the constants of the bodies, no chain to a tip marked."""
    model, names = arm.model, list(arm.model.names)
    joints = [arm.tree.joints[name] for name in names[2:]]
    coupling = np.eye(arm.n) if arm.coupling is None else arm.coupling
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
            b[i]["column"] = column = int(np.abs(coupling[i - 1]).argmax())
            b[i]["gain"] = coupling[i - 1, column]
            b[i]["E"] = turn[parent].T @ placement.rotation @ S
            b[i]["t"] = turn[parent].T @ placement.translation
    if mode != "free-floating":
        b[0]["I"] = ENDLESS * np.eye(3)
    if mode == "fixed":
        b[0]["m"] = b[0]["carried"] = ENDLESS
    for i in range(len(b) - 1, 0, -1):
        b[b[i]["parent"]]["carried"] += b[i]["carried"]
    return b


def _z_to(axis: Array) -> Array:
    """Return a rotation (3, 3) that takes z to the axis."""
    return pin.Quaternion.FromTwoVectors(Z, axis).matrix()


def all_positions(arm: SpaceArm, q: Array) -> Array:
    """Return positions (N, m) of all joints, mimic joints too, large angles reduced to a turn."""
    q = np.ascontiguousarray(q)
    if arm.coupling is not None:
        q = arm.coupling @ q + arm.offsets[:, None]
    turns = ~all_bodies(arm)["slides"][1:]
    if (np.abs(q[turns]) > LARGEST_ANGLE).any():
        q[turns] = np.arctan2(np.sin(q[turns]), np.cos(q[turns]))
    return q
