"""The work arrays of many states side by side, and how a lane of them is read and written."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.kernels.lanes import LANES, Lanes, Rows, Six, Vector, record, step, vector

SWUNG = record(
    ("R", np.float64, (3, 3, LANES)),  # attitude
    ("a", np.float64, (3, LANES)),  # the joint, from the spacecraft frame [m]
    ("e", np.float64, (3, LANES)),  # the same from the parent's joint
    ("r", np.float64, (3, LANES)),  # the CM, from the joint
    ("J", np.float64, (6, LANES)),  # inertia about the CM
    ("s", np.float64, (3, LANES)),  # sum of mass times position of all that the joint carries,
    ("I", np.float64, (6, LANES)),  # and its inertia, both about the joint
    ("u", np.float64, (3, LANES)),  # angular velocity per rate of the column,
    ("v", np.float64, (3, LANES)),  # and velocity of the body's point at the system CM
    ("w", np.float64, (3, LANES)),  # angular velocity
    ("alpha", np.float64, (3, LANES)),  # angular acceleration while ddq = 0, alpha_0 = 0
    ("acc", np.float64, (3, LANES)),  # acceleration of the joint, likewise
    ("f", np.float64, (3, LANES)),  # force on the body and all that its joint carries,
    ("n", np.float64, (3, LANES)),  # and moment about the joint
)
"""The work data of a body, vectors in spacecraft axes."""


class Swinging(NamedTuple):
    """Work arrays, by lanes; see `masses.Moving`.

    Attributes:
        body: (N + 1,) records `SWUNG`.
        angle: (3, N, LANES) joint positions, their sines and cosines.
        center: (3, LANES) system CM, from the spacecraft frame.
        D: (6, LANES) inertia about it, then its factors.
        H: (n, n, LANES) the lower triangle of M_qq, of H*, then of its factors.
        D_q: (n, 3, LANES) angular momentum about the system CM per joint rate.
        P: (n, 3, LANES) linear momentum per joint rate.
        X: (n, 3, LANES) D^-1 D_q.
        dq: (n, LANES) joint rates.
        h: (3, LANES) angular momentum about the system CM.
        x: (n, LANES) torques, less the bias forces, then joint accelerations.
        least: (LANES,) least pivot of H*.
    """

    body: npt.NDArray[np.void]
    angle: Lanes
    center: Lanes
    D: Lanes
    H: Lanes
    D_q: Lanes
    P: Lanes
    X: Lanes
    dq: Lanes
    h: Lanes
    x: Lanes
    least: Lanes


@step
def swinging(N: int, n: int) -> Swinging:
    """Allocate the work arrays of an arm of N joints with n rates."""
    return Swinging(
        body=np.empty(N + 1, SWUNG),
        angle=np.empty((3, N, LANES)),
        center=np.empty((3, LANES)),
        D=np.empty((6, LANES)),
        H=np.empty((n, n, LANES)),
        D_q=np.empty((n, 3, LANES)),
        P=np.empty((n, 3, LANES)),
        X=np.empty((n, 3, LANES)),
        dq=np.empty((n, LANES)),
        h=np.empty((3, LANES)),
        x=np.empty((n, LANES)),
        least=np.empty(LANES),
    )


@step
def six(x: Lanes, l: int) -> Six:
    """Return lane l of x (6, lanes)."""
    return (x[0, l], x[1, l], x[2, l], x[3, l], x[4, l], x[5, l])


@step
def rows(x: Lanes, l: int) -> Rows:
    """Return lane l of x (3, 3, lanes)."""
    return (vector(x[0], l), vector(x[1], l), vector(x[2], l))


@step
def store(x: Lanes, l: int, a: Vector) -> None:
    """Write lane l of x (3, lanes)."""
    x[0, l], x[1, l], x[2, l] = a


@step
def store_six(x: Lanes, l: int, a: Six) -> None:
    """Write lane l of x (6, lanes)."""
    x[0, l], x[1, l], x[2, l], x[3, l], x[4, l], x[5, l] = a
