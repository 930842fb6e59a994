"""Wheels: bodies that spin on joints that are not the arm's, and hold momentum.

A balanced wheel spins about its axis a at the rate W relative to the link that carries it. It
leaves the mass distribution unchanged and adds I W a to the angular momentum, with I its moment of
inertia about a. It is therefore treated as a part of that link that holds momentum.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, plain
from spacearm.description.bodies import Joint
from spacearm.description.tree import Tree
from spacearm.errors import ModelError, UnsupportedError
from spacearm.results import Cell, Column, Table

#: Share of its size or moment of inertia by which a wheel may be out of balance.
BALANCED = 1e-6
#: Index of the spacecraft's joint in the model.
SPACECRAFT = 1
#: Shares of a limit, and of a load, that are rounding.
ROUNDING, SPANNED = 1e-9, 1e-6


class Wheel(NamedTuple):
    """A wheel, or another body that holds angular momentum about an axis.

    Attributes:
        name: Name of its joint.
        frame: Index of the frame of the link that carries it, in the model.
        axis: (3,) unit vector of its axis, in that frame.
        torque: Largest torque of its motor, the effort limit of the joint [N m]; inf if none.
        capacity: Largest momentum that it holds, its moment of inertia times the velocity limit of
            the joint [N m s]; inf where one of them is not given.
    """

    name: str
    frame: int
    axis: Array
    torque: float
    capacity: float

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data; limits that it does not have are None."""
        limits = {"torque": self.torque, "capacity": self.capacity}
        return {
            "name": self.name,
            "frame": self.frame,
            "axis": self.axis.tolist(),
            **plain(limits),
        }


def wheels_of(tree: Tree, model: pin.Model, path: Path) -> tuple[Wheel, ...]:
    """Return the wheels of a tree, in the order of its joints.

    Raises:
        ModelError: One carries a joint, or is not balanced.
    """
    joints = [joint for joint in tree.depth_first() if joint.kind == "wheel"]
    for joint in joints:
        if fault := _fault(tree, joint):
            raise ModelError(f"{path}: wheel {joint.name!r} {fault}; leave it a joint")
    return tuple(
        Wheel(
            j.name, model.getFrameId(j.parent, pin.BODY), j.origin.rotation @ j.axis, j.effort,
            _capacity(tree, j),
        )
        for j in joints
    )  # fmt: skip


def carried(model: pin.Model, wheels: Sequence[Wheel]) -> list[Wheel]:
    """Return the wheels that are on links that move with the arm, not on the spacecraft."""
    return [wheel for wheel in wheels if model.frames[wheel.frame].parentJoint != SPACECRAFT]


def axes_of(model: pin.Model, wheels: Sequence[Wheel]) -> Array:
    """Return the axes (3, w) of wheels, spacecraft axes.

    Raises:
        UnsupportedError: A wheel is on a link that moves.
    """
    for wheel in carried(model, wheels):
        raise UnsupportedError(
            f"wheel {wheel.name!r} is on link {model.frames[wheel.frame].name!r}, which moves with "
            "the arm; the attitude is held by wheels on the spacecraft"
        )
    axes = [model.frames[wheel.frame].placement.rotation @ wheel.axis for wheel in wheels]
    return np.array(axes).reshape(-1, 3).T


def held_about_any_axis(model: pin.Model, wheels: Sequence[Wheel]) -> float:
    """Return the momentum that wheels can hold about any axis, shared as by `WheelLoad` [N m s].

    Raises:
        UnsupportedError: A wheel is on a link that moves.
    """
    axes = axes_of(model, wheels)
    if np.linalg.matrix_rank(axes) < 3:
        return 0.0
    capacity = np.array([wheel.capacity for wheel in wheels])
    return float((capacity / np.linalg.norm(np.linalg.pinv(axes), axis=1)).min())


class WheelLoad(NamedTuple):
    """What each of some wheels holds and gives at most, beside what it can.

    Attributes:
        wheels: The wheels.
        momentum: (w,) the largest momentum of each [N m s].
        torque: (w,) the largest torque of each [N m].
        across: Largest part of momentum and torque that is across all of their axes, as a share of
            the whole; they cannot take it.
    """

    wheels: tuple[Wheel, ...]
    momentum: Array
    torque: Array
    across: float = 0.0

    @classmethod
    def of(
        cls, model: pin.Model, wheels: tuple[Wheel, ...], held: Array, torque: Array
    ) -> WheelLoad:
        """Share momentum and torque (m, 3) out by the pseudo-inverse of the axes.

        Args:
            model: The model of the arm.
            wheels: Its wheels, on the spacecraft.
            held: (m, 3) momentum that they hold together, spacecraft axes [N m s].
            torque: (m, 3) torque that they give together [N m].

        Raises:
            UnsupportedError: A wheel is on a link that moves.
        """
        axes = axes_of(model, wheels)
        shares, across, each = np.linalg.pinv(axes), 0.0, []
        for whole in (held, torque):
            own = whole @ shares.T
            size = np.abs(whole).max(initial=0.0)
            if size > 0.0:
                across = max(across, float(np.abs(whole - own @ axes.T).max() / size))
            each.append(np.abs(own).max(axis=0))
        return cls(wheels, each[0], each[1], across)

    @property
    def exceeded(self) -> list[str]:
        """What is more than the wheels can, a phrase each, with by how much."""
        found = []
        for wheel, h, tau in zip(self.wheels, self.momentum, self.torque, strict=True):
            for value, most, unit in ((h, wheel.capacity, "N m s"), (tau, wheel.torque, "N m")):
                if value > most * (1.0 + ROUNDING):
                    times = f"{value / most:.3g} times" if most > 0.0 else "more than"
                    found.append(
                        f"wheel {wheel.name}: {value:.4g} {unit}, {times} its limit of "
                        f"{most:.4g} {unit}"
                    )
        if self.across > SPANNED:
            found.append(f"{self.across:.1%} of it is across the axes of all wheels")
        return found

    @property
    def slower(self) -> float:
        """How many times as slowly the motion stays within what the wheels have; inf if never.

        Momentum falls with the speed, torque with its square.
        """
        if self.across > SPANNED:
            return np.inf
        most = np.array([(wheel.capacity, wheel.torque) for wheel in self.wheels]).T
        with np.errstate(divide="ignore", invalid="ignore"):
            momentum, torque = np.nan_to_num(
                np.array([self.momentum, self.torque]) / most, posinf=np.inf
            )
        return float(max(momentum.max(), np.sqrt(torque.max())))

    def in_time(self, duration: float) -> str:
        """Say how long a motion beyond the limits of the wheels lasts within them.

        Args:
            duration: How long the motion takes [s].
        """
        if not 1.0 < self.slower < np.inf:
            return ""
        took = np.ceil(duration * self.slower)
        return f"within these limits the same motion takes at least {took:.0f} s"

    def table(self, case: str = "") -> Table:
        """Return the load of each wheel beside its limits.

        Args:
            case: What was done to the wheels, for the title.
        """
        columns = ("wheel", Column("momentum", "N m s"), Column("of at most", "N m s"),
                   Column("torque", "N m"), Column("of at most", "N m"))  # fmt: skip
        rows = [
            (w.name, h, _limit(w.capacity), tau, _limit(w.torque))
            for w, h, tau in zip(self.wheels, self.momentum, self.torque, strict=True)
        ]
        return Table(columns, rows, "Wheels, largest load" + f", {case}" * bool(case))


def _limit(value: float) -> Cell:
    """Return a limit as a cell."""
    return value if np.isfinite(value) else "no limit"


def wheel_table(model: pin.Model, wheels: Sequence[Wheel]) -> Table:
    """Return axis, torque and capacity of wheels, and the link that carries each."""
    columns = ("wheel", "on", "axis in that link", Column("torque", "N m"),
               Column("capacity", "N m s"))  # fmt: skip
    rows = [
        (w.name, model.frames[w.frame].name, w.axis, _limit(w.torque), _limit(w.capacity))
        for w in wheels
    ]
    return Table(columns, rows, "Wheels")


def _capacity(tree: Tree, wheel: Joint) -> float:
    """Return the largest momentum of a wheel [N m s]; inf if it is not known."""
    moment = tree.spin_inertia(wheel)
    return moment * wheel.velocity if moment > 0.0 else np.inf


def _fault(tree: Tree, wheel: Joint) -> str | None:
    """Say why a joint is not a wheel; None if it is one."""
    whole, carried = tree.carried(wheel)
    if carried:
        return f"carries joint {carried[0].name!r}"
    if whole.mass == 0.0:
        return None
    off_axis = np.linalg.norm(np.cross(wheel.axis, whole.lever))
    moment = float(np.trace(whole.inertia))
    if off_axis > BALANCED * np.sqrt(moment / whole.mass):
        return f"is not balanced: its CM is {off_axis:.3g} m off its axis"
    a, I = np.outer(wheel.axis, wheel.axis), whole.inertia
    spin = float(wheel.axis @ I @ wheel.axis)
    round_one = spin * a + (moment - spin) / 2.0 * (np.eye(3) - a)
    if np.abs(I - round_one).max() > BALANCED * moment:
        return "is not balanced: its inertia is not the same all round its axis"
    return None
