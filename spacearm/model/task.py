"""Task: the rows of the tip's twist that count, and the length that makes them comparable.

What an arm can do at all is the rank of momentum and tip twist at random postures. They follow from
the free components of the spacecraft's twist and from the joint rates,
[h; t] = [[A_b A_q]; [J_b J_q]] [v_b; dq]. The rank of this matrix is that of A_b and that of its
Schur complement J_q - J_b A_b^-1 A_q = J*. It is the same at almost all postures, so that a few
random ones tell it: rows of J* that depend on each other there do so everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, positive, whole
from spacearm.description.tree import Tree, coupling
from spacearm.errors import ConfigurationError, ModelError, unknown
from spacearm.model.frames import LWA
from spacearm.signatures import checked

#: Names of rows.
Rows: TypeAlias = Sequence[str]
#: Most tips of a task.
MOST_TIPS = 100
ROWS = ("x", "y", "z", "rx", "ry", "rz")
ALIASES = {"pose": ROWS, "position": ROWS[:3], "orientation": ROWS[3:]}


@checked
@dataclass(frozen=True)
class Task:
    """The rows of the tip's twist that count.

    The rows are directions fixed to the spacecraft, as in equation (37), which takes the
    determinant of 0J*: whether a posture is singular then depends on the joints only, not on
    the attitude. Their components are given along the task axes (see `axes`), which are the
    inertial axes wherever the task allows it.

    Attributes:
        names: Rows, as "x y rz" in any order, or "pose", "position", "orientation".
        length: Length [m] that divides the linear rows where linear and angular rows are both
            present. None where there is nothing to scale; before an arm is loaded with the task
            also for the arm's own length, that of its chain from the first joint to the tip.
        tips: Number of tips; their rows are stacked, all rows of the first tip first. Set by the
            arm that is loaded with the task.

    Raises:
        ConfigurationError: A row is unknown or named twice, or the length is not positive or has
            nothing to scale.
    """

    names: str
    length: float | None = None
    tips: int = 1

    def __post_init__(self) -> None:
        whole(self.tips, "tips of a task", 1, MOST_TIPS)
        if self.length is not None:
            positive(self.length, "task length", "length [m]")
        if self.length is not None and not self.mixed:
            raise ConfigurationError(
                f"task {self.names!r} has rows of one kind only: a length of {self.length} m "
                "would scale nothing; leave it out"
            )
        if not self.rows or len(set(self.rows)) != len(self.rows):
            raise ConfigurationError(
                f"task {self.names!r} must name at least one row and none twice; "
                f"rows: {' '.join(ROWS)}"
            )

    @cached_property
    def rows(self) -> tuple[str, ...]:
        """The rows by name, in the order given."""
        names = self.names.replace(",", " ").split()
        if len(names) == 1 and names[0] in ALIASES:
            return ALIASES[names[0]]
        for name in names:
            if name not in ROWS:
                raise ConfigurationError(unknown("task row", name, (*ROWS, *ALIASES)))
        return tuple(names)

    @cached_property
    def indices(self) -> list[int]:
        """Indices of the rows in the stacked twists [linear; angular] of all tips."""
        return [6 * tip + ROWS.index(row) for tip in range(self.tips) for row in self.rows]

    def to_dict(self) -> dict[str, Any]:
        """Return rows, length and number of tips as plain data."""
        return {"rows": list(self.rows), "length": self.length, "tips": self.tips}

    @property
    def k(self) -> int:
        """Number of rows of all tips."""
        return len(self.rows) * self.tips

    @property
    def mixed(self) -> bool:
        """Whether linear and angular rows are both present."""
        return len({index % 6 // 3 for index in self.indices}) == 2

    @cached_property
    def scale(self) -> Array:
        """(k, 1) factors of the rows: 1 / length for linear rows of a mixed task, else 1."""
        linear = np.array(self.indices)[:, None] % 6 < 3
        return np.where(linear & self.mixed, 1.0 / (self.length or 1.0), 1.0)

    @cached_property
    def singled_out(self) -> frozenset[int]:
        """The axes (0, 1, 2) that the linear or the angular rows lie along or are normal to."""
        rows = ({i % 3 for i in self.indices if i % 6 // 3 == kind} for kind in (0, 1))
        alone = (row if len(row) == 1 else {0, 1, 2} - row for row in rows)
        return frozenset(axis for axes in alone if len(axes) == 1 for axis in axes)

    def axes(self, R: Array) -> Array:
        """Compute the task axes at the spacecraft attitude R.

        A task with all three linear rows or none, and all three angular rows or none, is the same
        along any axes: its axes are the inertial axes. A task that singles out one direction, or
        the plane normal to it (the "x y" of a planar arm), has the inertial axes turned with that
        direction by the smallest rotation. So turns about the direction leave them inertial. Upside
        down the smallest rotation is not unique; there half a turn about the next axis comes first.
        A task that singles out several directions has the axes of the spacecraft.

        Args:
            R: (3, 3) spacecraft attitude, spacecraft to inertial axes.

        Returns:
            (3, 3) columns: the task axes x, y, z in inertial axes.
        """
        if not self.singled_out:
            return np.eye(3)
        if len(self.singled_out) > 1:
            return R
        (axis,) = self.singled_out
        turned = np.eye(3)
        if R[axis, axis] < 1e-9 - 1.0:
            turned = 2.0 * np.outer(turned[axis - 2], turned[axis - 2]) - turned
        e = turned[:, axis]
        cosine = e @ R[:, axis]
        sine = pin.skew(e) @ R[:, axis]
        K = pin.skew(sine)
        rest = 1.0 + cosine if cosine > 0.0 else sine @ sine / (1.0 - cosine)
        tilt = np.eye(3) + K + K @ K / rest  # rest = 1 + cosine, without cancellation
        return tilt @ turned

    def jacobian(self, J: Array, R: Array) -> Array:
        """Return the task's rows of a Jacobian, along the task axes, scaled.

        Args:
            J: (..., 6 tips, m) Jacobian, rows [linear; angular] of each tip, inertial axes.
            R: (3, 3) spacecraft attitude.

        Returns:
            (..., k, m) task Jacobian; linear rows in [m], or divided by `length` if mixed.
        """
        return self.scale * self.components(J, self.axes(R))

    def components(self, J: Array, axes: Array) -> Array:
        """Return the task's rows (..., k, m) of a Jacobian, unscaled.

        Args:
            J: (..., 6 tips, m) Jacobian, inertial axes.
            axes: (3, 3) columns: the axes along which the rows are taken.
        """
        turned = axes.T @ J.reshape(*J.shape[:-2], 2 * self.tips, 3, J.shape[-1])
        return turned.reshape(J.shape)[..., self.indices, :]


def with_length(task: Task, tree: Tree, tips: Sequence[str], path: Path) -> Task:
    """Return a task for these tips, with a length.

    Raises:
        ModelError: A mixed task needs a length, and the arm has none.
    """
    task = replace(task, tips=len(tips))
    if task.mixed and task.length is None:
        length = max(map(tree.way_to, tips))
        if length == 0.0:
            raise ModelError(
                f"{path}: the joints and the tip {tips[0]!r} are at one point, so that the arm has "
                "no length to scale a mixed task with; correct their poses in the file, or give a "
                "length: task=Task('pose', length=...)"
            )
        task = replace(task, length=length)
    return task


def usual_task(tree: Tree, tips: Sequence[str]) -> Task:
    """Return the rows of the plane of a planar arm, else pose from 6 joints on, else position."""
    n = min(sum(joint.mimic is None for joint in tree.movable(tip)) for tip in tips)
    if (normal := tree.plane_normal()) is not None:
        x, y = (axis for i, axis in enumerate("xyz") if i != normal)
        return Task(f"{x} {y} r{'xyz'[normal]}" if n >= 3 else f"{x} {y}")
    return Task("pose" if n >= 6 else "position")


#: Random postures; one with full rank is enough.
POSTURES = 3
#: Singular value of a part of the scaled matrix up to which it is rounding.
NO_RANK = 1e-12
#: Other tasks that a message names.
MOST_TOLD = 3


class MovableRows:
    """Which rows of the tips' twists the joints can move, at almost all postures.

    Args:
        tree: The tree.
        tips: Its tip links.
        model: Its Pinocchio model.
    """

    def __init__(self, tree: Tree, tips: Sequence[str], model: pin.Model) -> None:
        rng, data, (C, offsets) = np.random.default_rng(0), model.createData(), coupling(tree)
        frames = [model.getFrameId(tip, pin.BODY) for tip in tips]
        self.tips, self.n, self._matrices = len(tips), C.shape[1], list[Array]()
        for _ in range(POSTURES):
            joints = C @ rng.uniform(-np.pi, np.pi, self.n) + offsets
            full = np.concatenate(([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], joints))
            A = pin.computeCentroidalMap(model, data, full)
            J = [pin.computeFrameJacobian(model, data, full, frame, LWA) for frame in frames]
            whole = np.vstack((A / A[0, 0], *J))
            self._matrices.append(_scaled(np.hstack((whole[:, :6], whole[:, 6:] @ C))))

    def rank(self, rows: Rows, free: int = 6) -> int:
        """Return the rank of these rows of J* of all tips, at almost all postures.

        Args:
            rows: Names of rows.
            free: Number of free components of the spacecraft's twist; see `free_components`.
        """
        twists = [6 + 6 * tip + ROWS.index(row) for tip in range(self.tips) for row in rows]
        part = np.ix_([*range(free), *twists], [*range(free), *range(6, 6 + self.n)])
        sigma = [np.linalg.svd(matrix[part], compute_uv=False) for matrix in self._matrices]
        return max(0, *(int(np.count_nonzero(values > NO_RANK)) - free for values in sigma))

    def can(self, rows: Rows, free: int = 6) -> bool:
        """Whether J* of these rows of all tips has full rank at almost all postures."""
        return len(rows) > 0 and self.rank(rows, free) == self.tips * len(rows)

    def default(self, usual: Task) -> Task:
        """Return the usual task, or if it is impossible the rows that move, where they do together.

        Those of the usual task come before others, and those that move on a fixed base before those
        that only the reaction of the spacecraft moves.
        """
        if self.can(usual.rows):
            return usual
        parts = [
            [row for row in rows if self.rank([row], free)]
            for free in (0, 6)
            for rows in (usual.rows, ROWS)
        ]
        return next((Task(" ".join(part)) for part in parts if self.can(part)), usual)

    def tasks(self, rows: Rows, free: int) -> list[Rows]:
        """Return the tasks that the arm can do with most of these rows; of all rows, if of none."""
        for known in (rows, ROWS):
            for count in range(min(self.n // self.tips, len(known)), 0, -1):
                if found := [some for some in combinations(known, count) if self.can(some, free)]:
                    return list[Rows](found)
        return []

    def fault(self, task: Task, usual: Task, free: int = 6) -> str:
        """Say why a task is impossible at every posture and which would do; "" if it is possible.

        Args:
            task: The task.
            usual: The task that arms of this kind have by default.
            free: Number of free components of the spacecraft's twist.
        """
        if self.can(task.rows, free):
            return ""
        moved = [row for row in task.rows if self.rank([row], free)]
        still = [row for row in task.rows if row not in moved]
        one = len(still) == 1
        why = [f"{'row' if one else 'rows'} {' '.join(still)} never move{'s' * one}"] * bool(still)
        if moved and not self.can(moved, free):
            left, rank = self.tips * len(moved), self.rank(moved, free)
            joints = f"{self.n} joint{'s' * (self.n > 1)} can move"
            of = f"of the {left} rows {' '.join(moved)}" + " of all tips" * (self.tips > 1)
            why.append(f"{joints} only {rank} {of} independently")
        likely = [rows for rows in (moved, usual.rows) if self.can(rows, free)]
        others = likely[:1] or self.tasks(task.rows, free)
        named = [f"task={' '.join(other)!r}" for other in others[:MOST_TOLD]]
        would = f"{' or '.join(named)} would do" if named else "no task of this tip would do"
        reason = f"{' and '.join(why)}; {would}"
        return f"the task {task.names!r} is impossible at every posture: {reason}"


def _scaled(matrix: Array) -> Array:
    """Return momentum per mass and twists without units, rows and columns of length 1 or 0."""
    length = np.abs(matrix[6:9, 3:]).max() or 1.0
    linear = np.arange(len(matrix)) % 6 < 3
    matrix = matrix / np.where(linear, length, 1.0)[:, None]
    matrix[3:6] /= length**2
    matrix[:, :3] *= length
    for axis in (1, 0, 1):
        size = np.linalg.norm(matrix, axis=axis, keepdims=True)
        matrix = matrix / np.where(size > 0.0, size, 1.0)
    return matrix
