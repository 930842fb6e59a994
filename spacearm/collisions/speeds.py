"""Speeds: how fast the joints of a floating arm can move the points of its bodies, at most.

At zero momentum the spacecraft reacts to joint rates dq so that the kinetic energy T is least of
all motions with these rates: dT/dv_b = h = 0, and T is a convex square in v_b. So where one joint
moves at unit rate, 2 T is no more than the inertia E of what it carries about its axis, the motion
with the spacecraft at rest, and no more than that of all the rest, the motion with what it carries
at rest. A body of mass m and least inertia I has a part of T: a point at r from its CM moves by no
more than |v| + r |w|, where m |v|^2 + I |w|^2 <= E, hence by no more than sqrt(E (1/m + r^2/I)).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.collisions.bodies import Body
from spacearm.errors import UnsupportedError
from spacearm.model.arm import SpaceArm


def inertial_speeds(arm: SpaceArm, bodies: Sequence[Body], out: Array) -> Array:
    """Return how fast points of bodies move in inertial axes per joint rate at most (bodies, n).

    In [m/rad], at zero momentum.

    Args:
        arm: The arm.
        bodies: The bodies.
        out: (N,) largest displacements of the model's joints on the way [rad] or [m].

    Raises:
        UnsupportedError: The spacecraft has no inertia, which leaves its motion without bound.
    """
    E = _inertias_moved(arm, out)
    lever = float(np.linalg.norm(arm.model.inertias[1].lever))
    speeds = np.zeros((len(bodies), arm.model.nv - 6))
    for speed, body in zip(speeds, bodies, strict=True):
        supports = list(arm.model.supports[body.joint])[2:]
        far = body.far + sum(out[j - 2] for j in supports if _slides(arm, j)) + lever
        with_spacecraft = np.sqrt(E * _mobility(arm, 1, far))
        for joint, reach in body.reach.items():
            with_spacecraft[joint - 2] += reach + out[body.slides[joint]].sum()
        own = arm.model.inertias[body.joint]
        points = _extent_about(body, own.lever)
        by_itself = np.sqrt(E * _mobility(arm, body.joint, points))
        speed[:] = np.minimum(with_spacecraft, by_itself)
    if not np.isfinite(speeds).all():
        raise UnsupportedError(
            f"{arm.name}: the spacecraft has no inertia about some axis, so nothing bounds how far "
            "it turns; obstacles cannot be checked"
        )
    return speeds if arm.coupling is None else speeds @ np.abs(arm.coupling)


def _mobility(arm: SpaceArm, joint: int, far: float) -> float:
    """Return 1/m + r^2/I of the body at a joint, for points up to `far` from its CM."""
    inertia, normal = arm.model.inertias[joint], arm.tree.plane_normal()
    about_cm = inertia.inertia
    least = float(np.linalg.eigvalsh(about_cm)[0])
    if normal is not None and joint == 1:
        least = float(about_cm[normal, normal])
    if inertia.mass <= 0.0 or least <= 0.0:
        return np.inf
    return 1.0 / inertia.mass + far * far / least


def _inertias_moved(arm: SpaceArm, out: Array) -> Array:
    """Return the bounds E (N,) of the inertia that each joint moves [kg m^2], or mass [kg].

    Distances between bodies are no longer than the way along the joints between them.
    """
    model, joints = arm.model, range(2, arm.model.njoints)
    steps = np.zeros(model.njoints)
    for j in joints:
        steps[j] = np.linalg.norm(model.jointPlacements[j].translation)
        steps[j] += out[j - 2] if _slides(arm, j) else 0.0
    ways = [frozenset(model.supports[k]) for k in range(model.njoints)]
    bounds = np.zeros(len(joints))
    for j in joints:
        carried, rest = 0.0, 0.0
        for k in range(1, model.njoints):
            body = model.inertias[k]
            far = sum(steps[i] for i in ways[j] ^ ways[k]) + np.linalg.norm(body.lever)
            part = body.mass
            if not _slides(arm, j):
                part = body.mass * far**2 + float(np.linalg.eigvalsh(body.inertia)[-1])
            carried, rest = (carried + part, rest) if j in ways[k] else (carried, rest + part)
        bounds[j - 2] = min(carried, rest)
    return bounds


def _slides(arm: SpaceArm, joint: int) -> bool:
    return bool(arm.tree.joints[arm.model.names[joint]].kind == "prismatic")


def _extent_about(body: Body, cm: Array) -> float:
    """Return how far points of a body are from the CM of what its joint carries at most [m]."""
    shape = body.shape
    shape.computeLocalAABB()
    return float(np.linalg.norm(body.pose.act(shape.aabb_center) - cm) + shape.aabb_radius)


def helix(start: pin.SE3, end: pin.SE3) -> tuple[float, float]:
    """Return how far the origin of a frame moves between two poses at most [m], and the turn [rad].

    For any motion at a constant rate of turn, on the straight line or on the screw between them.
    """
    turn = float(np.linalg.norm(pin.log3(start.rotation.T @ end.rotation)))
    straight = float(np.linalg.norm(end.translation - start.translation))
    return straight * (0.5 * turn / np.sin(0.5 * turn) if turn > 1e-9 else 1.0), turn
