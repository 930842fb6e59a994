"""Bounds on momentum, joint torques and payload loads between the samples of a joint motion.

Between two times h apart a twice differentiable quantity differs from the straight line through its
values by at most h^2 / 8 times a bound on its second derivative. `bounded_peaks` halves intervals
until that term is small wherever the quantity is near its largest value.

The bounds on derivatives are majorants: a quantity f has b_0, b_1, ... with |d^i f / dt^i| <= b_i,
and products follow by Leibniz' rule. All vectors are expressed in spacecraft axes, as seen from the
spacecraft. Rotations have R' = R [u] dq, and all lengths are constant but those of sliding joints.

A floating spacecraft has the angular velocity w_0 of D w_0 = h_0 - h, with the locked inertia D of
the system, the momentum h of the joint motion, and the momentum on board h_0, which is constant
along inertial axes. As D is at least its least eigenvalue, the derivatives of w_0 follow one after
the other. The derivative of a vector along inertial axes is x' + w_0 x x. The torque of joint i is

    tau_i = e_i . sum_k ((r_k - p_i) x m_k a_k + dL_k / dt)

over the bodies k that it carries: e_i its axis, p_i a point of it, r_k their CMs, a_k the
accelerations of these, and L_k = R_k I_k R_k^T (w_0 + w_k) (Siciliano et al., Robotics (2009),
section 7.5, DOI 10.1007/978-1-84628-642-1). The wrench of a hand at a tip that the joint moves
counts as that of a body there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.interpolate import PPoly

from spacearm.arrays import Array, Integers
from spacearm.mechanics.jacobian import turning_axes
from spacearm.model.arguments import FLOATING, BaseMode, free_components
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.wheels import Wheel

#: Derivatives of the joint positions that the bounds take.
DERIVATIVES = 4
#: Index of the spacecraft's joint in the model.
ROOT = 1
#: Largest share of a peak by which its bound may exceed the largest value found.
MARGIN = 5e-3
#: How many times intervals near a peak are halved at most.
HALVINGS = 16
#: Share of the momentum on board that is rounding.
ROUNDING = 1e-12


class Peaks(NamedTuple):
    """Largest absolute values of k quantities over a time.

    Attributes:
        t: (k,) when the largest value found is reached [s].
        found: (k,) the largest value found.
        bound: (k,) certified upper bound.
    """

    t: Array
    found: Array
    bound: Array


def bounded_peaks(
    values: Callable[[Array], Array],
    bends: Callable[[Array, Array], Array],
    t: Array,
    margin: float = MARGIN,
    allowed: Array | float = 0.0,
    groups: Integers | None = None,
) -> Peaks:
    """Bound the largest absolute values of k functions of time.

    Intervals are halved where the bound exceeds the largest value found by more than the margin,
    and what is allowed.

    Args:
        values: Takes times (p,) and returns values (p, k), or lengths (p, k) of vectors.
        bends: Takes the beginnings (p,) and widths (p,) of intervals and returns bounds (p, k) on
            the second derivatives.
        t: (m,) times between which the functions are twice differentiable, increasing [s].
        margin: Largest share of a peak by which its bound may exceed the largest value found.
        allowed: (k,) values up to which a bound may be looser than that.
        groups: (k,) numbers of groups; the margin is a share of the largest peak of the group then.
    """
    at = np.abs(values(t))
    own = np.arange(at.shape[1]) if groups is None else groups
    same = own[:, None] == own
    best, when = at.max(axis=0), t[at.argmax(axis=0)]
    bound = best.copy()
    begin, width, ends = t[:-1], np.diff(t), np.maximum(at[:-1], at[1:])
    left, right = at[:-1], at[1:]
    for halving in range(HALVINGS + 1):
        if not len(begin):
            break
        upper = ends + width[:, None] ** 2 / 8.0 * bends(begin, width)
        room = margin * np.where(same, best, 0.0).max(axis=1)
        doubtful = (upper > np.maximum(best + room, allowed)).any(axis=1)
        if halving == HALVINGS:
            doubtful[:] = False
        bound = np.maximum(bound, upper[~doubtful].max(axis=0, initial=0.0))
        begin, width, left, right = (x[doubtful] for x in (begin, 0.5 * width, left, right))
        if not len(begin):
            break
        middle = np.abs(values(begin + width))
        higher = middle.max(axis=0) > best
        when = np.where(higher, (begin + width)[middle.argmax(axis=0)], when)
        best = np.maximum(best, middle.max(axis=0))
        begin, width = np.append(begin, begin + width), np.tile(width, 2)
        left, right = np.vstack((left, middle)), np.vstack((middle, right))
        ends = np.maximum(left, right)
    return Peaks(when, best, np.maximum(bound, best))


def joint_bounds(way: PPoly, begin: Array, width: Array) -> Array:
    """Bound joint positions (n,) over time and their derivatives (d + 1, n, p) on intervals.

    Args:
        way: Piecewise polynomials of degree 5 at most; no interval has a knot inside.
        begin: (p,) beginnings of the intervals [s].
        width: (p,) their widths [s].
    """
    derivatives = [np.abs(way(begin, order)) for order in range(6)]
    joints = [
        sum(derivatives[k + i] * width[:, None] ** i / math.factorial(i) for i in range(6 - k))
        for k in range(DERIVATIVES + 1)
    ]
    return np.swapaxes(np.array(joints), 1, 2)


@dataclass(frozen=True, eq=False)
class BodyBounds:
    """Bounds on the motion of one body as seen from the spacecraft, (d, p) each.

    Attributes:
        parent: Its joint's parent in the model.
        slides: Whether its joint is prismatic.
        mass: Its mass [kg].
        inertia: Largest eigenvalue of its inertia about its CM [kg m^2].
        rotation: Bounds of its rotation.
        place: Bounds of the origin of its joint, a sum along the chain [m].
        cm: Bounds of its CM, likewise [m].
        spin: Bounds of its angular velocity [rad/s].
    """

    parent: int
    slides: bool
    mass: float
    inertia: float
    rotation: Array
    place: Array
    cm: Array
    spin: Array

    @property
    def momentum(self) -> Array:
        """Bounds of its angular momentum about the spacecraft's CM (d - 1, p) [N m s]."""
        square = product(self.rotation[:-1], self.rotation[:-1])
        return self.mass * product(self.cm[:-1], self.cm[1:]) + self.inertia * product(
            square, self.spin
        )

    @property
    def moment_of_inertia(self) -> Array:
        """Bounds of its moment of inertia about the spacecraft's CM (d, p) [kg m^2]."""
        square = product(self.rotation, self.rotation)
        return self.mass * product(self.cm, self.cm) + self.inertia * square


def bodies_of(arm: SpaceArm, joints: Array) -> dict[int, BodyBounds]:
    """Bound the motion of all bodies that joints move, by the joints of the model.

    Args:
        arm: The arm.
        joints: (d + 1, n, p) bounds on the joint positions and their first d derivatives.
    """
    model, C = arm.model, np.eye(arm.n) if arm.coupling is None else np.abs(arm.coupling)
    moved = np.einsum("jn,dnp->jdp", C, joints)
    moved[:, 0] += np.abs(arm.offsets)[:, None]
    still: Array = np.zeros(joints[:, 0].shape)
    unit = still.copy()
    unit[0] = 1.0
    rotation, place, spin = {ROOT: unit}, {ROOT: still}, {ROOT: still[1:]}
    base = model.inertias[ROOT].lever
    found = dict[int, BodyBounds]()
    for joint in range(ROOT + 1, model.njoints):
        parent, x = model.parents[joint], moved[joint - ROOT - 1]
        offset = model.jointPlacements[joint].translation - (base if parent == ROOT else 0.0)
        R, p, w = rotation[parent], place[parent], spin[parent]
        p = p + np.linalg.norm(offset) * R
        slides = arm.tree.joints[model.names[joint]].kind == "prismatic"
        if slides:
            p = p + product(R, x)
        else:
            w = w + product(R[:-1], x[1:])
            R = product(R, turned(x))
        rotation[joint], place[joint], spin[joint] = R, p, w
        body: pin.Inertia = model.inertias[joint]
        found[joint] = BodyBounds(
            parent=parent,
            slides=slides,
            mass=float(body.mass),
            inertia=float(np.linalg.norm(body.inertia, 2)),
            rotation=R,
            place=p,
            cm=p + np.linalg.norm(body.lever) * R,
            spin=w,
        )
    return found


def momentum_bounds(arm: SpaceArm, joints: Array) -> Array:
    """Return bounds (d, p) on h and its first d - 1 derivatives, one for each of p intervals.

    Args:
        arm: The arm.
        joints: (d + 1, n, p) bounds on the joint positions and their first d derivatives.
    """
    return _momentum(arm, [*bodies_of(arm, joints).values()])


def _momentum(arm: SpaceArm, bodies: Sequence[BodyBounds]) -> Array:
    carried = _carried(bodies)
    own = sum(body.momentum for body in bodies)
    return np.asarray(own + product(carried[:-1], carried[1:]) / arm.mass)


def _carried(bodies: Sequence[BodyBounds]) -> Array:
    """Bound the sum of mass times CM of the moving bodies [kg m]."""
    return np.asarray(sum(body.mass * body.cm for body in bodies))


class OnBoard(NamedTuple):
    """Momentum that a floating spacecraft has besides that of its joint motion.

    Attributes:
        momentum: Size of the angular momentum of the whole system [N m s].
        stored: Bound on the size of the momentum that its wheels hold, in any posture [N m s].
        axes: Axes of the spacecraft about which it rotates: of a planar arm the normal of its plane
            alone, unless momentum across it rotates the spacecraft about the others.
    """

    momentum: float
    stored: float
    axes: tuple[int, ...]

    @classmethod
    def of(cls, start: Configuration) -> OnBoard:
        """Return what is on board at the start of a motion."""
        arm, axes = start.arm, turning_axes(start.arm)
        held = [start.with_wheels(each).stored[3:] for each in np.diag(start.wheels)]
        wheels = np.array(held).reshape(-1, 3)
        moves = np.array([_parent(arm, wheel) != ROOT for wheel in arm.wheels], dtype=bool)
        on_spacecraft = np.linalg.norm(wheels[~moves].sum(axis=0))
        on_links = np.linalg.norm(wheels[moves], axis=1).sum()
        vectors = np.vstack((start.momentum[3:], wheels)) @ start.base.rotation
        across = np.delete(np.abs(vectors), axes, axis=1)
        if across.max(initial=0.0) > ROUNDING * np.abs(vectors).max():
            axes = (0, 1, 2)
        momentum = float(np.linalg.norm(start.momentum[3:]))
        return cls(momentum, float(on_spacecraft + on_links), axes)


class BodyLoad(NamedTuple):
    """A body in the gripper, whose load on the grapple is bounded.

    Attributes:
        joint: The joint of the model that moves it.
        mass: Its mass [kg].
        inertia: Largest eigenvalue of its inertia about its CM [kg m^2].
        place: The tip in the frame of that joint (3,) [m].
        com: Distance of its CM from the tip [m].
    """

    joint: int
    mass: float
    inertia: float
    place: Array
    com: float


class HandLoad(NamedTuple):
    """A hand that gives a shared target a constant linear part of the wrench that moves it.

    Attributes:
        joint: The joint of the model that moves the hand.
        place: The tip in the frame of that joint (3,) [m].
        parts: (2, 2) largest singular values of the blocks of the map from the wrench that moves
            the target, about its frame, to that of the hand, about the tip; target axes.
    """

    joint: int
    place: Array
    parts: Array


@dataclass(frozen=True, eq=False)
class SystemBounds:
    """Bounds on the motion of the whole system.

    Attributes:
        bodies: Those of its bodies, by the joints of the model.
        com: Those of the system CM seen from the spacecraft where the spacecraft yields, else zero.
        turn: Those of the angular velocity of the spacecraft.
    """

    bodies: dict[int, BodyBounds]
    com: Array
    turn: Array

    @classmethod
    def of(
        cls,
        arm: SpaceArm,
        mode: BaseMode,
        way: PPoly,
        begin: Array,
        width: Array,
        on_board: OnBoard,
    ) -> SystemBounds:
        """Bound the motion of an arm; arguments as of `load_bends`."""
        named = bodies_of(arm, joint_bounds(way, begin, width))
        bodies = [*named.values()]
        com = _carried(bodies) / arm.mass * (free_components(mode) > 0)
        turn = np.zeros_like(bodies[0].spin)
        if mode == FLOATING:
            turn = _base_turn(arm, bodies, way(begin), width, on_board)
        return cls(named, com, turn)

    def force(self, mass: float, place: Array) -> Array:
        """Bound the force (3, p) that moves a mass at a place seen from the spacecraft."""
        place = place + self.com
        velocity = place[1:] + product(self.turn, place[:-1])
        return np.asarray(mass * (velocity[1:] + product(self.turn[:-1], velocity[:-1])))

    def moment(self, largest: float, body: BodyBounds) -> Array:
        """Bound the moment (3, p) that turns a part of a body about its CM.

        Args:
            largest: Largest eigenvalue of the inertia of that part [kg m^2].
            body: The body.
        """
        square = product(body.rotation[:-1], body.rotation[:-1])
        momentum = largest * product(square, self.turn + body.spin)
        return self._derivative(momentum)

    def joint_torques(
        self,
        arm: SpaceArm,
        bodies: dict[int, BodyBounds],
        on_board: OnBoard,
        loads: Sequence[tuple[int, Array, Array, Array]] = (),
    ) -> Array:
        """Bound the second derivatives (p, n) of the torques that move bodies and loads.

        Args:
            arm: The arm.
            bodies: The bodies that the joints move, in this motion.
            on_board: The momentum on board.
            loads: Joint, place, force and moment about the place of each load besides.
        """
        forces = {joint: self.force(body.mass, body.cm) for joint, body in bodies.items()}
        moments = {joint: self.moment(body.inertia, body) for joint, body in bodies.items()}
        for wheel, axis in _gyrations(arm, on_board, bodies):
            moments[wheel] = moments[wheel] + self._derivative(axis[:-1])
        acting = [(joint, bodies[joint].cm, forces[joint], moments[joint]) for joint in bodies]
        acting += loads
        bends = np.zeros((len(bodies), self.turn.shape[1]))
        for i, (joint, body) in enumerate(bodies.items()):
            total: Array = np.zeros_like(self.turn[:-1])
            for mover, place, force, moment in acting:
                if not _carries(bodies, joint, mover):
                    continue
                if body.slides:
                    total = total + force
                else:
                    total = total + product(place - body.place, force) + moment
            bends[i] = product(body.rotation, total)[2]
        C = np.eye(arm.n) if arm.coupling is None else np.abs(arm.coupling)
        return bends.T @ C

    def _derivative(self, vector: Array) -> Array:
        """Bound the derivative of a vector along inertial axes."""
        return vector[1:] + product(self.turn[:-1], vector[:-1])


def load_bends(
    arm: SpaceArm,
    mode: BaseMode,
    way: PPoly,
    begin: Array,
    width: Array,
    on_board: OnBoard,
    held: BodyLoad | None = None,
) -> Array:
    """Bound the second derivatives of joint torques and of a payload's load (p, n + 2).

    The load is the force and the moment about the tip that move the payload.

    Args:
        arm: The arm, with the payload.
        mode: What the spacecraft does.
        way: Joint positions (n,) over time, as of `joint_bounds`.
        begin: (p,) beginnings of the intervals [s].
        width: (p,) their widths [s].
        on_board: The momentum on board.
        held: The payload; without one its load is zero.
    """
    system = SystemBounds.of(arm, mode, way, begin, width, on_board)
    torques = system.joint_torques(arm, system.bodies, on_board)
    load = np.zeros((2, len(begin)))
    if held is not None:
        force, moment, _ = _wrench(system, held)
        load[0], load[1] = force[2], moment[2]
    return np.hstack((torques, load.T))


def shared_load_bends(
    arm: SpaceArm,
    free: SpaceArm,
    way: PPoly,
    begin: Array,
    width: Array,
    on_board: OnBoard,
    target: BodyLoad,
    hands: Sequence[HandLoad],
) -> Array:
    """Bound the second derivatives of joint torques and of what hands give a shared target.

    The wrench that moves the target is W = (f; n), n about its frame. In the axes of the target
    hand i gives it B_i W with B_i constant. The joint torques move the arms alone, and load each
    tip with what its hand gives. The spacecraft floats.

    Args:
        arm: The arms with the target, which is fixed to the first tip.
        free: The arms without it.
        way: Joint positions (n,) over time, as of `joint_bounds`.
        begin: (p,) beginnings of the intervals [s].
        width: (p,) their widths [s].
        on_board: The momentum on board.
        target: The target; its place is that of its frame.
        hands: The hands.

    Returns:
        (p, n + 2 h), of each hand the force and the moment about its tip after the torques.
    """
    system = SystemBounds.of(arm, FLOATING, way, begin, width, on_board)
    alone = bodies_of(free, joint_bounds(way, begin, width))
    force, moment, rotation = _wrench(system, target)
    along = product(rotation, force), product(rotation, moment)  # target axes
    loads, given = list[tuple[int, Array, Array, Array]](), list[Array]()
    for hand in hands:
        own = [part[0] * along[0] + part[1] * along[1] for part in hand.parts]
        given += [each[2] for each in own]
        body = alone[hand.joint]
        place = body.place + np.linalg.norm(hand.place) * body.rotation
        push, turn = (product(rotation, each) for each in own)
        loads.append((hand.joint, place, push, turn))
    torques = system.joint_torques(free, alone, on_board, loads)
    return np.hstack((torques, np.array(given).T))


def _wrench(system: SystemBounds, held: BodyLoad) -> tuple[Array, Array, Array]:
    """Bound force, and moment about its place, that move a body, and the rotation of the body."""
    body = system.bodies[held.joint]
    place = body.place + np.linalg.norm(held.place) * body.rotation
    lever = held.com * body.rotation
    force = system.force(held.mass, place + lever)
    moment = product(lever, force) + system.moment(held.inertia, body)
    return force, moment, body.rotation


def _carries(bodies: dict[int, BodyBounds], joint: int, body: int) -> bool:
    """Return whether a joint of the model moves a body."""
    while body > joint:
        body = bodies[body].parent if body in bodies else ROOT
    return body == joint


def _gyrations(
    arm: SpaceArm, on_board: OnBoard, bodies: dict[int, BodyBounds]
) -> list[tuple[int, Array]]:
    """Return what wheels on moving links hold: the joint that moves each, and its bounds."""
    joints = [_parent(arm, wheel) for wheel in arm.wheels]
    moved = dict.fromkeys(joint for joint in joints if joint in bodies)
    return [(joint, on_board.stored * bodies[joint].rotation) for joint in moved]


def _parent(arm: SpaceArm, wheel: Wheel) -> int:
    """Return the joint of the model that moves the link that carries a wheel."""
    return int(arm.model.frames[wheel.frame].parentJoint)


def _base_turn(
    arm: SpaceArm, bodies: Sequence[BodyBounds], q: Array, width: Array, on_board: OnBoard
) -> Array:
    """Bound the angular velocity of a floating spacecraft and its derivatives (4, p) [rad/s].

    Args:
        arm: The arm.
        bodies: Bounds on its bodies.
        q: (p, n) joint positions at the beginning of each interval.
        width: (p,) widths of the intervals [s].
        on_board: The momentum on board.
    """
    h, carried = _momentum(arm, bodies), _carried(bodies)
    locked = sum(body.moment_of_inertia for body in bodies)
    locked = np.asarray(locked + product(carried, carried) / arm.mass)
    alone, at_begin = _least_inertias(arm, q, on_board.axes)
    inertia = np.maximum(alone, at_begin - width * locked[1])
    seen = np.zeros_like(h)  # the momentum on board in spacecraft axes
    seen[0] = on_board.momentum
    wheels: Array = np.zeros_like(h)
    wheels[0] = on_board.stored
    if any(_parent(arm, wheel) != ROOT for wheel in arm.wheels):
        wheels = on_board.stored * np.max([body.rotation[:-1] for body in bodies], axis=0)
    turn: Array = np.zeros_like(h)
    for k in range(len(turn)):
        if k:
            seen[k] = sum(math.comb(k - 1, i) * turn[i] * seen[k - 1 - i] for i in range(k))
        moved = sum(math.comb(k, i) * locked[k - i] * turn[i] for i in range(k))
        turn[k] = (seen[k] + wheels[k] + h[k] + moved) / inertia
    return turn


def _least_inertias(arm: SpaceArm, q: Array, about: Sequence[int]) -> tuple[float, Array]:
    """Return the least moment of inertia of the spacecraft alone, and of the system at q (p, n).

    Both are eigenvalues about the given axes of the spacecraft [kg m^2].
    """
    axes = np.ix_(about, about)
    model, data, full = arm.model, arm.borrow(), pin.neutral(arm.model)
    locked = np.empty((len(q), *axes[0].shape[:1], *axes[1].shape[1:]))
    for i, row in enumerate(q):
        full[7:] = arm.all_joints(row)
        pin.ccrba(model, data, full, np.zeros(model.nv))
        locked[i] = data.Ig.inertia[axes]
    arm.give_back(data)
    alone = np.linalg.eigvalsh(model.inertias[ROOT].inertia[axes])[0]
    return float(alone), np.asarray(np.linalg.eigvalsh(locked)[:, 0])


def product(a: Array, b: Array) -> Array:
    """Return bounds (d, p) of a product, by Leibniz' rule, from those of its factors."""
    d = min(len(a), len(b))
    pairs = (a[:d, None] * b[None, :d]).reshape(d * d, -1)
    return np.asarray(_leibniz(d) @ pairs)


@cache
def _leibniz(d: int) -> Array:
    """Return the factors (d, d^2) of pairs of derivatives in the derivatives of a product."""
    counts = np.zeros((d, d, d))
    for k in range(d):
        for i in range(k + 1):
            counts[k, i, k - i] = math.comb(k, i)
    return counts.reshape(d, d * d)


def turned(angle: Array) -> Array:
    """Return bounds (d, p) of the rotation by an angle about a fixed axis, from its bounds."""
    rows = [np.ones_like(angle[0])]
    for k in range(1, len(angle)):
        rows.append(sum(math.comb(k - 1, i) * rows[i] * angle[k - i] for i in range(k)))
    return np.array(rows)
