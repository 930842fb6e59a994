"""Many configurations at once: measures of singularity and Jacobians."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.equations.jacobian import jacobian
from spacearm.equations.measures import measures
from spacearm.errors import ConfigurationError, unknown
from spacearm.mechanics.blocks import Progress, checked_output, fill, joint_rows
from spacearm.mechanics.jacobian import generalized_jacobian, singular_values_of, task_jacobian
from spacearm.mechanics.many import WIDE, ArmKernel, arms_kernel, worth_compiling
from spacearm.mechanics.nearness import distances
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode

QUANTITIES = ("sigma_min", "manipulability", "condition", "determinant", "radius")
"""The measures that take J* alone."""
NEARNESS = ("distance", "away")
"""Those that take its derivative: a number, and a vector over the joints."""
SINGLY = 1e-4
"""Time that the measures of one configuration take without compiled code [s]."""


@of_arm
def evaluate(
    arm: SpaceArm,
    Q: npt.ArrayLike,
    quantities: Sequence[str] = QUANTITIES,
    *,
    out: Mapping[str, Array] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Array]:
    """Compute measures of singularity at many configurations of the free-floating arm.

    Compiled code gives the same numbers as `singularity` does one by one: singular values by
    bidiagonal reduction and qd transforms, to a few units of rounding of the largest singular
    value (the tests allow 2e-14 of it against numpy's svd), at singular configurations too.

    Args:
        arm: The arm.
        Q: (m, n) joint positions [rad] or [m], in any memory order, or a memory map; it is read
            block by block.
        quantities: Of "sigma_min" (least singular value of the task Jacobian), "manipulability"
            (product of the singular values), "condition" (largest over least), "determinant"
            (equation (37); NaN unless the task has as many rows as the arm has joints) and "radius"
            (R of equation (43), distance of the tip from the system CM [m]); and, not by default
            because they take the derivative of J*, "distance" (to the singular set [rad], far from
            it to first order) and "away" (its gradient: the joint motion per radian of distance
            that leads away), as in `SingularityReport`. Together these two take two to four times
            as long as sigma_min: `python benchmarks/distance.py` prints it.
        out: Arrays to write to, memory maps included, for some or all of the quantities.
        threads: Number of threads; one per available processor if None.
        progress: Called as progress(done, m) after each block.

    Returns:
        An array (m,) for each quantity, (m, n) for "away". Rows of Q that are not finite give NaN.

    Raises:
        ConfigurationError: Q or `out` has the wrong shape, or a quantity does not exist.
        UnsupportedError: The arm has several tips.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> Q = np.array([[0.3, 1.2], [0.0, 0.0]])
        >>> sa.evaluate(sa.load("planar2"), Q, ["sigma_min"])["sigma_min"].round(4)
        array([0.2865, 0.    ])
    """
    if isinstance(quantities, str):
        quantities = (quantities,)
    out = {} if out is None else out
    for name in (*quantities, *out):
        if name not in (*QUANTITIES, *NEARNESS):
            raise ConfigurationError(unknown("quantity", name, (*QUANTITIES, *NEARNESS)))
    if extra := set(out) - set(quantities):
        raise ConfigurationError(
            f"out has arrays for {', '.join(sorted(extra))}, which quantities does not name"
        )
    Q = joint_rows(arm, Q, "Q")
    m = len(Q)
    shapes = {name: (m, arm.n) if name == "away" else (m,) for name in quantities}
    results = {
        name: checked_output(out[name], shape, f"out[{name!r}]")
        if name in (out or {})
        else np.empty(shape)
        for name, shape in shapes.items()
    }
    arm.require_one_tip()
    own = tuple(name for name in QUANTITIES if name in results)
    near = [name for name in NEARNESS if name in results]
    kernel = _measures(arm, own, m) if own and worth_compiling(m, SINGLY) else None

    def compute(rows: dict[str, Array], places: dict[str, Array | None]) -> dict[str, Array]:
        if kernel:
            written = kernel(rows, out=[places[name] for name in own])
            found = dict(zip(own, written, strict=True))
        else:
            found = _measures_singly(arm, rows["q"], own)
        if near:
            found |= zip(NEARNESS, distances(arm, rows["q"], many=m), strict=True)
        return found

    fill(results, {"q": Q}, compute, threads, progress)
    return results


def conditions(arm: SpaceArm, Q: Array, mode: BaseMode) -> Array:
    """Compute the condition numbers (m,) of the task Jacobian at Q (m, n) in a mode."""
    if worth_compiling(len(Q), SINGLY):
        (found,) = _measures(arm, ("condition",), len(Q), mode)({"q": Q})
        return np.asarray(found)
    sigma = [singular_values_of(task_jacobian(arm.at(q), mode=mode)) for q in Q]
    return np.array([s[0] / s[-1] if s[-1] > 0.0 else np.inf for s in sigma])


def _measures(
    arm: SpaceArm, names: tuple[str, ...], m: int, mode: BaseMode = "free-floating"
) -> ArmKernel:
    """Return the compiled measures of m configurations."""
    return arms_kernel(
        [arm], mode, measures, (("q", (arm.n,)),), options=(("names", names),), lanes=WIDE, rows=m
    )


@of_arm
def generalized_jacobians(
    arm: SpaceArm,
    Q: npt.ArrayLike,
    *,
    out: Array | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Array:
    """Compute J* of equation (35) at many configurations, in spacecraft axes.

    Args:
        arm: The arm.
        Q: (m, n) joint positions, as in `evaluate`.
        out: (m, 6, n) array to write to.
        threads: As in `evaluate`.
        progress: As in `evaluate`.

    Returns:
        (m, 6, n) rows [linear [m/rad]; angular] as `generalized_jacobian` gives them with the
        spacecraft's axes along the inertial ones. Rows of Q that are not finite give NaN.

    Raises:
        ConfigurationError: Q or `out` has the wrong shape.
        UnsupportedError: The arm has several tips.

    Example:
        >>> import spacearm as sa
        >>> sa.generalized_jacobians(sa.load("planar2"), [[0.3, 1.2], [0.0, 0.0]]).shape
        (2, 6, 2)
    """
    arm.require_one_tip()
    Q = joint_rows(arm, Q, "Q")
    m = len(Q)
    J = np.empty((m, 6, arm.n)) if out is None else checked_output(out, (m, 6, arm.n), "out")
    shape = (("q", (arm.n,)),)
    kernel = (
        arms_kernel([arm], "free-floating", jacobian, shape, rows=m)
        if worth_compiling(m, SINGLY)
        else None
    )

    def compute(rows: dict[str, Array], places: dict[str, Array | None]) -> dict[str, Array]:
        if kernel is None:
            return {"J": _jacobians_singly(arm, rows["q"])}
        return {"J": kernel(rows, out=[places["J"]])}

    fill({"J": J}, {"q": Q}, compute, threads, progress)
    return J


def _measures_singly(arm: SpaceArm, Q: Array, names: tuple[str, ...]) -> dict[str, Array]:
    """Compute measures at Q (m, n), (m,) each, without compiled code."""
    found = {name: np.full(len(Q), np.nan) for name in names}
    for i, q in enumerate(Q if names else ()):
        cfg = arm.at(q)
        J = task_jacobian(cfg)
        sigma = singular_values_of(J)
        own = {
            "sigma_min": sigma[-1],
            "manipulability": sigma.prod(),
            "condition": sigma[0] / sigma[-1] if sigma[-1] > 0.0 else np.inf,
            "determinant": np.linalg.det(J) if arm.task.k == arm.n else np.nan,
            "radius": np.linalg.norm(cfg.tip.translation - cfg.com),
        }
        for name in names:
            found[name][i] = own[name]
    return found


def _jacobians_singly(arm: SpaceArm, Q: Array) -> Array:
    """Compute the generalized Jacobians (m, 6, n) at Q (m, n) without compiled code."""
    return np.array([generalized_jacobian(arm.at(q)) for q in Q]).reshape(len(Q), 6, arm.n)
