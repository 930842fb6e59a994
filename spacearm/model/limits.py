"""Limits: which joints are outside theirs, and the warning of it, once a line of the caller."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.errors import call_site, listed, warn
from spacearm.model.joints import Jointed

ROUNDING = 1e-9
"""How far outside its limits a joint still counts as at the limit [rad], for values in degrees."""
ONE_TURN = 2.0 * np.pi
_warned: set[tuple[str, int]] = set()


class Limited(Jointed, Protocol):
    """What has n joints with limits: an arm."""

    @property
    def lower(self) -> Array:
        """(n,) lower limits [rad] or [m]."""

    @property
    def upper(self) -> Array:
        """(n,) upper limits [rad] or [m]."""

    @property
    def slides(self) -> npt.NDArray[np.bool_]:
        """(n,) which joints slide."""


def outside_limits(arm: Limited, q: Array) -> tuple[str, ...]:
    """Return the names of the joints that are outside their limits at q (n,)."""
    outside = (q < arm.lower - ROUNDING) | (q > arm.upper + ROUNDING)
    return tuple(arm.joint_names[j] for j in np.flatnonzero(outside))


def warn_outside(arm: Limited, q: Array, what: str = "q") -> None:
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
    turned = np.abs(np.where(arm.slides, 0.0, q)).max(initial=0.0) > ONE_TURN
    whole = bool((q == np.round(q))[~arm.slides].all())
    if not names and not (turned and whole):
        return
    site = call_site()
    if site in _warned:
        return
    _warned.add(site)
    hint = "; angles are in radians: np.radians(...) turns degrees into them" if turned else ""
    if names:
        one = arm.joint_names.index(names[0])
        unit = "m" if arm.slides[one] else "rad"
        limits = f"{arm.lower[one]:.4g} to {arm.upper[one]:.4g} {unit}"
        rest = f"; so is {listed(names[1:])}" if len(names) > 1 else ""
        problem = f"joint {names[0]!r} at {q[one]:.6g} {unit} is outside its limits, {limits}{rest}"
    else:
        one = int(np.argmax(np.abs(np.where(arm.slides, 0.0, q))))
        turns = abs(q[one]) / ONE_TURN
        problem = f"joint {arm.joint_names[one]!r} at {q[one]:.6g} rad has {turns:.3g} turns"
    warn(f"{what} of {arm.name}: {problem}{hint}")
