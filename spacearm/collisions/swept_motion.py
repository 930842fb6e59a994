"""Swept motion: a motion for collision checks, at any point between its rows.

Joint positions are linear between the rows. What the spacecraft does between them is what tells one
kind of motion from the other.

At zero momentum the spacecraft reacts to joint rates dq so that the kinetic energy T is least of
all motions with these rates: dT/dv_b = h = 0, and T is a convex square in v_b. So where one joint
moves at unit rate, 2 T is at most the inertia E of what it carries about its axis: the motion with
the spacecraft at rest. It is also at most the inertia of all the rest: the motion with what it
carries at rest. A body of mass m and least inertia I has a part of T: m |v|^2 + I |w|^2 <= E. A
point at r from its CM moves at |v| + r |w| at most, hence at sqrt(E (1/m + r^2/I)) at most.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.collisions.bodies import Body, extent, slides_along
from spacearm.errors import UnsupportedError
from spacearm.mechanics.floating import move
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion


class SweptMotion(ABC):
    """A motion of an arm.

    Attributes:
        arm: The arm.
        path: (m, n) its rows.
        t: (m,) its times [s].
    """

    def __init__(self, arm: SpaceArm, path: Array, t: Array) -> None:
        self.arm, self.path, self.t = arm, path, t

    def __len__(self) -> int:
        return len(self.path)

    def joints(self, u: float) -> Array:
        """Return the joint positions (n,) at row u, between rows if it is not a whole number."""
        return interpolated(self.path, u)

    def time(self, u: float) -> float:
        """Return the time at row u [s]."""
        return float(interpolated(self.t, u))

    def full(self, u: float) -> Array:
        """Return the configuration (nq,) of the Pinocchio model at row u."""
        base = pin.SE3ToXYZQUAT(self.base(u))
        return np.concatenate((base, self.arm.all_joints(self.joints(u))))

    @property
    def hull(self) -> Array:
        """(p, n) joint positions whose convex hull holds the motion."""
        return self.path

    @property
    def steps(self) -> Array:
        """(m - 1, n) how fast joints move at most between rows, for a unit of u."""
        return np.abs(np.diff(self.path, axis=0))

    @property
    def out(self) -> Array:
        """(N,) largest displacements of the model's joints [rad] or [m]."""
        return np.abs([self.arm.all_joints(q) for q in self.hull]).max(axis=0)

    @abstractmethod
    def base(self, u: float, /) -> pin.SE3:
        """Return the pose of the spacecraft at row u."""

    @abstractmethod
    def swept(self, bodies: Sequence[Body]) -> Array:
        """Return how far bodies move between rows at most (bodies, m - 1) [m], inertial axes."""


class InJointSpace(SweptMotion):
    """A joint motion alone: it says nothing about the spacecraft, which only obstacles ask for."""

    def __init__(self, arm: SpaceArm, path: Array) -> None:
        super().__init__(arm, path, np.full(len(path), np.nan))

    def base(self, _u: float, /) -> pin.SE3:
        """Return the identity."""
        return pin.SE3.Identity()

    def swept(self, bodies: Sequence[Body]) -> Array:
        """Return zeros."""
        return np.zeros((len(bodies), len(self) - 1))


class Curved(InJointSpace):
    """A joint motion along polynomials, alone.

    Args:
        arm: The arm.
        points: (m, d + 1, n) control points of the polynomials, in the order of the motion.
    """

    def __init__(self, arm: SpaceArm, points: Array) -> None:
        super().__init__(arm, np.vstack((points[:, 0], points[-1:, -1])))
        self.points = points

    def joints(self, u: float) -> Array:
        """Return the joint positions (n,), by de Casteljau's algorithm."""
        i = min(int(u), len(self.points) - 1)
        b = self.points[i]
        while len(b) > 1:
            b = b[:-1] + (u - i) * np.diff(b, axis=0)
        return np.asarray(b[0])

    @property
    def hull(self) -> Array:
        """All control points."""
        return self.points.reshape(-1, self.arm.n)

    @property
    def steps(self) -> Array:
        """Bounds by the control points of the derivatives."""
        degree = self.points.shape[1] - 1
        return degree * np.abs(np.diff(self.points, axis=1)).max(axis=1, initial=0.0)


class Flown(Curved):
    """A motion along polynomials, the spacecraft as its joints, momentum and wheels turn it.

    Args:
        arm: The arm, on a spacecraft that floats.
        points: (m, d + 1, n) control points of the polynomials.
        t: (m + 1,) times at their ends [s].
        base: Returns the pose of the spacecraft at row u.
        momentum: What turns it besides the joints at most [N m s].
        speed: That of the system CM [m/s].
    """

    def __init__(
        self,
        arm: SpaceArm,
        points: Array,
        t: Array,
        base: Callable[[float], pin.SE3],
        momentum: float,
        speed: float,
    ) -> None:
        super().__init__(arm, points)
        self.t, self._base, self._momentum, self._speed = t, base, momentum, speed

    def base(self, u: float) -> pin.SE3:
        """Return the pose of the spacecraft."""
        return self._base(u)

    def swept(self, bodies: Sequence[Body]) -> Array:
        """Return the ways by `inertial_speeds`, and those of the turn that momentum makes.

        The system turns by it as a rigid body about its CM, which is no farther than the farthest
        CM of a body; no inertia is less than that of the spacecraft alone.
        """
        arm, out = self.arm, self.out
        ways = inertial_speeds(arm, bodies, out) @ self.steps.T
        if not self._momentum and not self._speed:
            return ways
        turn = self._momentum / _least_inertia(arm, 1)
        steps = _steps_along(arm, out)
        lever = max(
            steps[list(arm.model.supports[k])].sum() + np.linalg.norm(body.lever)
            for k, body in enumerate(arm.model.inertias)
        )
        far = [body.far + sum(out[j] for j in _sliding(arm, body)) + lever for body in bodies]
        return np.asarray(ways + np.outer(self._speed + turn * np.array(far), np.diff(self.t)))


class Floating(SweptMotion):
    """A motion at zero momentum: between its rows the spacecraft reacts as it really does.

    Args:
        rows: Its configurations.
        t: (m,) its times [s].
    """

    def __init__(self, rows: Sequence[Configuration], t: Array) -> None:
        super().__init__(rows[0].arm, np.array([cfg.q for cfg in rows]), t)
        self.rows = rows

    def base(self, u: float) -> pin.SE3:
        """Return the pose of the spacecraft, by `move` from the row before."""
        i = min(int(u), len(self) - 1)
        return self.rows[i].base if u == i else move(self.rows[i], self.joints(u)).base

    def swept(self, bodies: Sequence[Body]) -> Array:
        """Return the ways by `inertial_speeds`."""
        return inertial_speeds(self.arm, bodies, self.out) @ self.steps.T


class Recorded(SweptMotion):
    """The samples of a motion: joints and poses of the base are linear between them."""

    def __init__(self, motion: Motion) -> None:
        super().__init__(motion.arm, motion.q, motion.t)
        self.motion = motion

    def base(self, u: float) -> pin.SE3:
        """Return the pose of the spacecraft."""
        i = min(int(u), max(len(self) - 2, 0))
        j = min(i + 1, len(self) - 1)
        return pin.SE3.Interpolate(self._poses[i], self._poses[j], u - i)

    def at(self, t: float) -> Configuration:
        """Return the configuration at a time; the first or last one outside the motion."""
        u = float(np.interp(t, self.motion.t, np.arange(len(self))))
        return self.arm.at(self.joints(u), base=self.base(u))

    @cached_property
    def _poses(self) -> list[pin.SE3]:
        """The poses of the spacecraft at the samples."""
        return [cfg.base for cfg in self.motion]

    def swept(self, bodies: Sequence[Body]) -> Array:
        """Return the ways of the spacecraft's frame, of its turn and of the joints, in sum."""
        return np.array([self.way(body) for body in bodies]).reshape(len(bodies), len(self) - 1)

    def way(self, body: Body) -> Array:
        """Return how far a body moves between rows at most (m - 1,) [m]."""
        origin, turn, joints, out = self._parts
        way = origin + (body.far + sum(out[j] for j in _sliding(self.arm, body))) * turn
        for joint, reach in body.reach.items():
            way = way + (reach + out[body.slides[joint]].sum()) * joints[:, joint - 2]
        return np.asarray(way)

    @cached_property
    def _parts(self) -> tuple[Array, Array, Array, Array]:
        """How far frame and turn of the spacecraft (m - 1,) and joints (m - 1, N) go; `out`."""
        origin, turn = np.array([helix(a, b) for a, b in pairwise(self._poses)]).reshape(-1, 2).T
        full = np.array([self.arm.all_joints(q) for q in self.path])
        return origin, turn, np.abs(np.diff(full, axis=0)), self.out


def _sliding(arm: SpaceArm, body: Body) -> set[int]:
    """Return the sliding joints that carry a body, counted from the first joint of the arm."""
    between = {j for one in body.slides.values() for j in one}
    return between | {j - 2 for j in body.reach if slides_along(arm, j)}


def interpolated(rows: Array, u: float) -> Array:
    """Return the value at row u, linear between whole numbers."""
    i = min(int(u), max(len(rows) - 2, 0))
    return rows[i] + (u - i) * (rows[min(i + 1, len(rows) - 1)] - rows[i])


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
        far = body.far + sum(out[j - 2] for j in supports if slides_along(arm, j)) + lever
        with_spacecraft = np.sqrt(E * _mobility(arm, 1, far))
        for joint, reach in body.reach.items():
            with_spacecraft[joint - 2] += reach + out[body.slides[joint]].sum()
        own = arm.model.inertias[body.joint]
        about_cm = pin.SE3(body.pose.rotation, body.pose.translation - own.lever)
        points = extent(about_cm, body.shape)
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
    mass, least = arm.model.inertias[joint].mass, _least_inertia(arm, joint)
    return 1.0 / mass + far * far / least if mass > 0.0 and least > 0.0 else np.inf


def _least_inertia(arm: SpaceArm, joint: int) -> float:
    """Return the least inertia of the body at a joint about its CM, of a plane about its normal."""
    about_cm, normal = arm.model.inertias[joint].inertia, arm.tree.plane_normal()
    if normal is not None and joint == 1:
        return float(about_cm[normal, normal])
    return float(np.linalg.eigvalsh(about_cm)[0])


def _steps_along(arm: SpaceArm, out: Array) -> Array:
    """Return how far each joint's frame is from the one before at most (njoints,) [m]."""
    steps = np.zeros(arm.model.njoints)
    for j in range(2, arm.model.njoints):
        steps[j] = np.linalg.norm(arm.model.jointPlacements[j].translation)
        steps[j] += out[j - 2] if slides_along(arm, j) else 0.0
    return steps


def _inertias_moved(arm: SpaceArm, out: Array) -> Array:
    """Return the bounds E (N,) of the inertia that each joint moves [kg m^2], or mass [kg].

    Distances between bodies are no longer than the way along the joints between them.
    """
    model, joints = arm.model, range(2, arm.model.njoints)
    steps = _steps_along(arm, out)
    ways = [frozenset(model.supports[k]) for k in range(model.njoints)]
    bounds = np.zeros(len(joints))
    for j in joints:
        carried, rest = 0.0, 0.0
        for k in range(1, model.njoints):
            body = model.inertias[k]
            far = sum(steps[i] for i in ways[j] ^ ways[k]) + np.linalg.norm(body.lever)
            part = body.mass
            if not slides_along(arm, j):
                part = body.mass * far**2 + float(np.linalg.eigvalsh(body.inertia)[-1])
            carried, rest = (carried + part, rest) if j in ways[k] else (carried, rest + part)
        bounds[j - 2] = min(carried, rest)
    return bounds


def helix(start: pin.SE3, end: pin.SE3) -> tuple[float, float]:
    """Return how far the origin of a frame moves between two poses at most [m], and the turn [rad].

    For any motion at a constant rate of turn, on the straight line or on the screw between them.
    """
    turn = float(np.linalg.norm(pin.log3(start.rotation.T @ end.rotation)))
    straight = float(np.linalg.norm(end.translation - start.translation))
    return straight * (0.5 * turn / np.sin(0.5 * turn) if turn > 1e-9 else 1.0), turn
