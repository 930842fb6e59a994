"""Capacity: which momenta wheels can take up, and in what time, whatever the way."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.optimize import linprog

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError, listed
from spacearm.planning.wheels.limits import Wheels

MANY = 12
"""Number of wheels up to which all combinations of their limits are looked at."""
UNLIMITED = 1e6
"""What stands for a wheel without a limit, times the momentum."""
SPANNED = 1e-6
"""Share of a momentum that may be across the axes of the wheels."""


def least_time(wheels: Wheels, momentum: Array, attitude: Array | None) -> float:
    """Return a time [s] below which no motion ends at rest, from torque and capacity.

    At rest the wheels hold the whole momentum, A s = T^T h. From what they hold at the start each
    comes no farther than its torque leads in the time.

    Args:
        wheels: The wheels.
        momentum: (3,) angular momentum about the system CM [N m s], inertial axes.
        attitude: (3, 3) attitude at the end; None for any.

    Raises:
        NoSolutionError: They cannot hold it in any time; says why.
    """
    h = float(np.linalg.norm(momentum))
    if h == 0.0 and attitude is None:
        return 0.0
    if (full := np.abs(wheels.start) > wheels.capacity).any():
        name = wheels.names[int(full.argmax())]
        raise NoSolutionError(
            f"wheel {name} holds {wheels.start[full][0]:.4g} N m s at the start, of at most "
            f"{wheels.capacity[full][0]:.4g}; unload it first"
        )
    scale = max(h, float(np.abs(wheels.start).max()))
    capacity = np.minimum(wheels.capacity, UNLIMITED * scale)
    torque = np.minimum(wheels.torque, UNLIMITED * scale)
    if attitude is not None:
        return _at_attitude(wheels, attitude.T @ momentum, capacity, torque)
    most = _most(wheels.axes, capacity)
    if most < h:
        raise NoSolutionError(
            f"at rest the wheels hold all of the momentum, {h:.4g} N m s, and those of this "
            f"spacecraft hold at most {most:.4g} N m s together, whatever the attitude; unload "
            "momentum by thrusters first, or add wheels"
        )
    short = h - float(np.linalg.norm(wheels.axes @ wheels.start))
    return max(0.0, short / _most(wheels.axes, torque))


def _at_attitude(wheels: Wheels, h: Array, capacity: Array, torque: Array) -> float:
    """Return the least time in which wheels come to hold h (3,), spacecraft axes."""
    held = np.linalg.pinv(wheels.axes) @ h
    across = float(np.linalg.norm(wheels.axes @ held - h))
    if across > SPANNED * np.linalg.norm(h):
        raise NoSolutionError(
            f"at rest at final_attitude {across:.4g} of the {np.linalg.norm(h):.4g} N m s would be "
            f"across the axes of the wheels {listed(wheels.names)}, which cannot hold it; leave "
            "final_attitude open, give one that turns their axes to the momentum, or add wheels"
        )
    w, axes = len(held), wheels.axes
    U, sigma, Vt = np.linalg.svd(axes)
    rank = int((sigma > SPANNED * sigma[0]).sum())
    rows = sigma[:rank, None] * Vt[:rank]  # without those that are zero
    within = np.vstack((np.eye(w), -np.eye(w)))
    found = linprog(
        np.append(np.zeros(w), 1.0),
        A_ub=np.column_stack((within, -np.tile(torque, 2))),
        b_ub=np.concatenate((wheels.start, -wheels.start)),
        A_eq=np.column_stack((rows, np.zeros(rank))),
        b_eq=U.T[:rank] @ h,
        bounds=[*zip(-capacity, capacity, strict=True), (0.0, None)],
    )
    if found.x is None:
        needed = ", ".join(
            f"{name} {s:.4g} of at most {c:.4g}"
            for name, s, c in zip(wheels.names, held, wheels.capacity, strict=True)
        )
        raise NoSolutionError(
            f"at rest at final_attitude the wheels would hold more than they can ({needed} N m s, "
            "shared evenly); leave final_attitude open, or unload momentum first"
        )
    return float(found.x[-1])


def _most(axes: Array, each: Array) -> float:
    """Return the largest length of A s where no wheel has more than (w,); convex: at a corner."""
    if len(each) > MANY:
        return float(each.sum())
    corners = np.array(list(product((-1.0, 1.0), repeat=len(each)))) * each
    return float(np.linalg.norm(corners @ axes.T, axis=1).max())
