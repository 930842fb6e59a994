"""Singularity conditions of arms with the structure of Canadarm2, attitude-controlled.

Three consecutive joints have parallel axes. Chen, Zhang, Jia & Sun, Singularity Analysis of
Redundant Space Robot with the Structure of Canadarm2, Mathematical Problems in Engineering (2014),
DOI 10.1155/2014/735030, split the Jacobian of the virtual manipulator into four blocks, one of them
zero. In axes of which z is that of joints 3, 4, 5, with rows (w_z, v_x, v_y) and (w_x, w_y, v_z),

    J* = [[P, B], [0, G]],    P of joints 3, 4, 5,    G of joints 1, 2, 6, 7.

J* loses rank where G has less than rank 3, and where the elbow is straight or folded (det P = 0)
so that n^T P = 0 for some n, and the square [G; n^T B] loses rank too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import spacearm as sa

PLANAR, SPATIAL = [5, 0, 1], [3, 4, 2]
"""Rows of the tip's twist that joints 3, 4, 5 move, and those that they do not."""
PARALLEL, OTHERS = [2, 3, 4], [0, 1, 5, 6]


class Blocks(NamedTuple):
    """The blocks of J*, lengths in those of the arm."""

    P: np.ndarray
    B: np.ndarray
    zero: np.ndarray
    G: np.ndarray


def blocks(arm: sa.SpaceArm, q: np.ndarray) -> Blocks:
    """Split J* of an attitude-controlled arm."""
    cfg = arm.at(q)
    J = sa.generalized_jacobian(cfg, mode="attitude-controlled")
    z = J[3:, PARALLEL[0]]
    x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    x /= np.linalg.norm(x)
    axes = np.array((x, np.cross(z, x), z))
    length = np.linalg.norm(J[:3, PARALLEL[0]])
    J = np.vstack((axes @ J[:3] / length, axes @ J[3:]))
    return Blocks(
        J[np.ix_(PLANAR, PARALLEL)],
        J[np.ix_(PLANAR, OTHERS)],
        J[np.ix_(SPATIAL, PARALLEL)],
        J[np.ix_(SPATIAL, OTHERS)],
    )


def left(arm: sa.SpaceArm, q: np.ndarray) -> float:
    """Return how far a configuration is from the nearer condition: 0 where one holds."""
    P, B, _, G = blocks(arm, q)
    U, sizes, _ = np.linalg.svd(P)
    wider = np.linalg.svd(np.vstack((G, U[:, -1] @ B)), compute_uv=False)
    return float(min(np.linalg.svd(G, compute_uv=False)[-1], np.hypot(sizes[-1], wider[-1])))
