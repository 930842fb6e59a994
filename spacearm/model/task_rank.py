"""What an arm can do at all: the rank of momentum and tip twist at random postures.

Momentum and tip twist follow from the free components of the spacecraft's twist and from the joint
rates, [h; t] = [[A_b A_q]; [J_b J_q]] [v_b; dq]. The rank of this matrix is that of A_b and that of
its Schur complement J_q - J_b A_b^-1 A_q = J*. It is the same at almost all postures, so that a few
random ones tell it: rows of J* that depend on each other there do so everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.description.tree import Tree, coupling
from spacearm.model.frames import LWA
from spacearm.model.task import ROWS, Rows, Task

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
        return max(int(np.count_nonzero(values > NO_RANK)) for values in sigma) - free

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
