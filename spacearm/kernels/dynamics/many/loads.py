"""Wheels that hold momentum, and external wrenches, of many states: over the lanes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from spacearm.kernels.dynamics.many.work import Swinging, rows, store
from spacearm.kernels.floating import Numbers
from spacearm.kernels.lanes import (
    LANES,
    Vector,
    add,
    cross,
    merged,
    minus,
    read,
    record,
    step,
    times,
    turn,
    vector,
)

ON_BODY = record(
    ("body", np.int64),  # body that carries it
    ("v", np.float64, 3),  # axis of a wheel, or point where a wrench acts [m], in its frame
)
"""An axis or a point that is fixed to a body."""


class Loads(NamedTuple):
    """Wheels and external wrenches of m states.

    Attributes:
        wheel: (w,) records `ON_BODY`.
        spin: (w, m) momentum that each wheel holds [N m s].
        pushed: (k,) records `ON_BODY`.
        wrench: (k, 6, m) [force [N]; torque [N m]] at the point, spacecraft axes.
    """

    wheel: npt.NDArray[np.void]
    spin: Numbers
    pushed: npt.NDArray[np.void]
    wrench: Numbers


@step
def held(m: Swinging, x: Loads, i: int, at: int, l: int) -> Vector:
    """Return the momentum that wheel i holds in state `at`, which is in lane l."""
    own = x.wheel[i]
    return times(x.spin[i, at], turn(rows(m.body[own.body].R, l), read(own.v)))


@merged
def store_momentum(m: Swinging, x: Loads, first: int, there: int) -> None:
    """Take what the wheels hold off the momentum; the rest is that of the bodies."""
    for i in range(len(x.wheel)):
        for l in range(LANES):
            own = held(m, x, i, first + min(l, there - 1), l)
            store(m.h, l, minus(vector(m.h, l), own))


@merged
def apply(m: Swinging, x: Loads, first: int, there: int) -> None:
    """Add the gyration of the wheels to what the bodies take, and take the wrenches off it."""
    for i in range(len(x.wheel)):
        d = m.body[x.wheel[i].body]
        for l in range(LANES):
            own = held(m, x, i, first + min(l, there - 1), l)
            store(d.n, l, add(vector(d.n, l), cross(vector(d.w, l), own)))
    for i in range(len(x.pushed)):
        d, point = m.body[x.pushed[i].body], read(x.pushed[i].v)
        for l in range(LANES):
            w = x.wrench[i, :, first + min(l, there - 1)]
            F, p = (w[0], w[1], w[2]), turn(rows(d.R, l), point)
            store(d.f, l, minus(vector(d.f, l), F))
            store(d.n, l, minus(vector(d.n, l), add((w[3], w[4], w[5]), cross(p, F))))
