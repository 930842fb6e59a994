"""Joints: the n joints that count, their names, limits and units, and the model's joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TypedDict

import numpy as np
import pinocchio as pin

from spacearm import errors
from spacearm.arrays import LARGEST, Array, ArrayLike, Booleans, numbers_of, read_only
from spacearm.description.tree import Tree
from spacearm.errors import ConfigurationError
from spacearm.model.task import Task
from spacearm.signatures import checked

#: How far outside its limits a joint still counts as at the limit [rad], for values in degrees.
ROUNDING = 1e-9
TURN = 2.0 * np.pi
_warned: set[tuple[str, int]] = set()


@checked
@dataclass(frozen=True, eq=False, repr=False)
class JointSpace:
    """What is known of the joints of a `SpaceArm`, whose docstring explains the attributes."""

    name: str
    tree: Tree
    model: pin.Model
    task: Task
    tips: tuple[str, ...]
    joint_names: tuple[str, ...]
    coupling: Array | None
    offsets: Array
    lower: Array
    upper: Array

    @property
    def label(self) -> str:
        """The robot's name, its middle left out where it is too long to read."""
        return errors.shortened(self.name, errors.LONGEST_NAME)

    @property
    def n(self) -> int:
        """Number of movable joints."""
        return len(self.joint_names)

    @property
    def slides(self) -> Booleans:
        """(n,) which joints are prismatic; the others are revolute."""
        return np.array([self.tree.joints[name].kind == "prismatic" for name in self.joint_names])

    @property
    def mass(self) -> float:
        """Total mass M [kg]."""
        return float(sum(inertia.mass for inertia in self.model.inertias))

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of each joint position: "rad" or "m"."""
        return tuple("m" if slides else "rad" for slides in self.slides)

    @property
    def sigma_unit(self) -> str:
        """Unit of the singular values of the task Jacobian: of task rows over joint rates."""
        rate = "m" if self.slides.all() else "(rad or m)" if self.slides.any() else "rad"
        row = "1" if self.task.mixed else "rad" if min(self.task.indices) >= 3 else "m"
        return f"{row}/{rate}"

    @property
    def travel_unit(self) -> str:
        """Unit of sums over all joints: of angles, displacements or both."""
        return "m" if self.slides.all() else "rad and m" if self.slides.any() else "rad"

    def in_words(self, q: Array) -> str:
        """Return joint positions for people: angles in degrees, displacements in metres.

        Args:
            q: (n,) joint positions [rad] or [m].
        """
        words = (
            f"{x:.4g} m" if slides else f"{np.degrees(x):.4g}°"
            for x, slides in zip(q, self.slides, strict=True)
        )
        return f"({', '.join(words)})"

    def all_joints(self, q: Array) -> Array:
        """Return the positions (nv - 6,) of all joints of the model at q (n,)."""
        return q if self.coupling is None else self.coupling @ q + self.offsets

    def all_rates(self, dq: Array) -> Array:
        """Return the rates (nv - 6,) of all joints of the model at joint rates dq (n,)."""
        return dq if self.coupling is None else self.coupling @ dq

    def project(self, matrix: Array) -> Array:
        """Reduce a matrix (m, nv) over the model's joints to the n joints, (m, 6 + n)."""
        if self.coupling is None:
            return matrix
        return np.hstack((matrix[:, :6], matrix[:, 6:] @ self.coupling))


class JointLimits(TypedDict, total=False):
    """Limits of joints, as keywords of `SpaceArm.replace`; its docstring explains them."""

    lower: ArrayLike | Mapping[str, float] | None
    upper: ArrayLike | Mapping[str, float] | None


def joint_vector(arm: JointSpace, values: ArrayLike, what: str) -> Array:
    """Return a checked copy of one finite number per joint, (n,).

    Args:
        arm: The arm.
        values: What was given.
        what: Name of the argument.

    Raises:
        ConfigurationError: It has another shape, or a number is not finite; names the joint.
    """
    vector = _one_per_joint(arm, values, what)
    sound = np.abs(vector) <= LARGEST
    if not sound.all():
        worst = int(np.flatnonzero(~sound)[0])
        raise ConfigurationError(
            f"{what} of joint {arm.joint_names[worst]!r} is {vector[worst]:g}; give a finite "
            f"number up to {LARGEST:g}"
        )
    return vector


def _one_per_joint(arm: JointSpace, values: object, what: str) -> Array:
    """Return a copy of one number per joint, (n,), finite or not."""
    vector = numbers_of(values, what)
    if vector.shape != (arm.n,):
        raise ConfigurationError(
            f"{what} has shape {vector.shape}; {arm.name} needs ({arm.n},), one number for each "
            f"of: {errors.listed(arm.joint_names)}"
        )
    return vector


def by_joint(arm: JointSpace, values: object, what: str) -> Mapping[str, float]:
    """Return numbers by joint that are given so, or one for each joint in the order of q.

    Args:
        arm: The arm.
        values: What was given; None gives no numbers.
        what: Name of the argument.

    Raises:
        ConfigurationError: It is neither.
    """
    if values is None or isinstance(values, Mapping):
        return values or {}
    numbers = _one_per_joint(arm, values, what)
    return dict(zip(arm.joint_names, numbers.tolist(), strict=True))


def joint_name(arm: JointSpace, text: str) -> str:
    """Return the name of a joint that is given by it, or by its number as q1, q2, ...

    Raises:
        ConfigurationError: There is no such joint.
    """
    numbers = {f"q{i}": name for i, name in enumerate(arm.joint_names, start=1)}
    if text in arm.joint_names:
        return text
    if text not in numbers:
        raise ConfigurationError(errors.unknown("joint", text, [*arm.joint_names, *numbers]))
    return numbers[text]


def outside_limits(arm: JointSpace, q: Array) -> tuple[str, ...]:
    """Return the names of the joints that are outside their limits at q (n,)."""
    outside = (q < arm.lower - ROUNDING) | (q > arm.upper + ROUNDING)
    return tuple(arm.joint_names[j] for j in np.flatnonzero(outside))


def warn_outside(arm: JointSpace, q: Array, what: str = "q") -> None:
    """Warn of joint positions outside the limits, or that look like degrees.

    Joints without limits look like degrees where all angles are whole numbers and one of them is
    more than a turn. Each line of the caller outside the package is warned once.

    Args:
        arm: The arm.
        q: (n,) joint positions.
        what: Name of the argument.

    Warns:
        ModelWarning: There are such joints; names them, their values and their limits.
    """
    names = outside_limits(arm, q)
    angles = np.abs(np.where(arm.slides, 0.0, q))
    turned = bool((angles > TURN).any())
    odd = names or (turned and (angles == np.round(angles)).all())
    if not odd or (site := errors.call_site()) in _warned:
        return
    _warned.add(site)
    hint = "; angles are in radians: np.radians(...) turns degrees into them" if turned else ""
    if names:
        one = arm.joint_names.index(names[0])
        unit = "m" if arm.slides[one] else "rad"
        limits = f"{arm.lower[one]:.4g} to {arm.upper[one]:.4g} {unit}"
        rest = f"; so is {errors.listed(names[1:])}" if len(names) > 1 else ""
        problem = f"joint {names[0]!r} at {q[one]:.6g} {unit} is outside its limits, {limits}{rest}"
    else:
        one = int(np.argmax(angles))
        at = f"joint {arm.joint_names[one]!r} at {q[one]:.6g} rad"
        problem = f"{at} has {angles[one] / TURN:.3g} turns"
    errors.warn(f"{what} of {arm.name}: {problem}{hint}")


@lru_cache(maxsize=64)
def joint_scales(arm: JointSpace) -> Array:
    """Return what counts as a radian of each joint in distances in joint space, (n,).

    1 [rad] for revolute joints. Of a sliding joint [m] its travel between the limits counts as one
    turn, but no longer way than the arm's length, the sum of the distances between its joints up
    to the tip, counts as a radian: by that way a turn of one radian moves the tip at most. A
    sliding joint without limits counts by that length (1 m if it is zero).
    """
    length = max(map(arm.tree.way_to, arm.tips))
    travel = (arm.upper - arm.lower) / TURN
    limited = np.isfinite(travel) & (travel > 0.0)
    slide = np.where(limited, np.minimum(travel, length or np.inf), length or 1.0)
    return read_only(np.where(arm.slides, slide, 1.0))
