"""Many configurations at once: singular values and Jacobians by compiled kernels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, UnsupportedError, unknown
from spacearm.kernels.quantities import NEARNESS, QUANTITIES
from spacearm.mechanics.blocks import (
    FEW,
    Progress,
    checked_output,
    joint_rows,
    read_block,
    run_blocks,
)
from spacearm.mechanics.jacobian import (
    generalized_jacobian,
    singular_values_of,
    task_jacobian,
    task_jacobian_derivative,
)
from spacearm.mechanics.nearness import nearness_of, refined_at
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm

CARD_BLOCK = 2**20
"""Configurations per block on a graphics card."""


@of_arm
def evaluate(
    arm: SpaceArm,
    Q: npt.ArrayLike,
    quantities: Sequence[str] = QUANTITIES,
    *,
    out: Mapping[str, Array] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
) -> dict[str, Array]:
    """Compute measures of singularity at many configurations of the free-floating arm.

    Compiled kernels give the same numbers as `singularity` does one by one: singular values by
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
        device: "cuda" computes on an NVIDIA graphics card: `pip install "spacearm[gpu]"`.

    Returns:
        An array (m,) for each quantity, (m, n) for "away". Rows of Q that are not finite give NaN.

    Raises:
        ConfigurationError: Q or `out` has the wrong shape, or a quantity or device does
            not exist.
        UnsupportedError: The arm has several tips, or no graphics card can be used.

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
    kernels = _kernels(arm, device, m >= FEW, set(quantities))

    def do(block: slice) -> None:
        q = read_block(Q, block)
        for kernel in kernels:
            for name, values in kernel(q).items():
                if name in results:
                    results[name][block] = values

    if device == "cuda":
        run_blocks(do, m, 1, progress, [Q, *results.values()], CARD_BLOCK)
    else:
        run_blocks(do, m, threads, progress, [Q, *results.values()])
    return results


def _kernels(
    arm: SpaceArm, device: str, many: bool, names: set[str]
) -> list[Callable[[Array], dict[str, Array]]]:
    """Return the functions that compute quantities at q (n, m), those that are asked for."""
    kernels: list[Callable[[Array], dict[str, Array]]] = []
    card = _card(device)
    if names & set(QUANTITIES) or not names:
        measures = card.measures_on_card if card else _compiled().measures if many else _measures
        kernels.append(lambda q: measures(arm, q, "condition" in names))
    if names & set(NEARNESS):
        distances = (
            card.distances_on_card if card else _compiled().distances if many else _distances
        )
        kernels.append(lambda q: distances(arm, q))
    return kernels


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
    jacobians = _compiled().jacobians if m >= FEW else _jacobians

    def do(block: slice) -> None:
        J[block] = jacobians(arm, read_block(Q, block))

    run_blocks(do, m, threads, progress, [Q, J])
    return J


def _compiled() -> Any:
    """Import the compiled kernels, which takes half a second."""
    from spacearm.mechanics import compiled

    return compiled


def _card(device: str) -> Any:
    """Return the compiled kernels of a graphics card, or None for the processor."""
    if device == "cpu":
        return None
    if device != "cuda":
        raise ConfigurationError(unknown("device", device, ("cpu", "cuda")))
    if fault := _compiled().no_card():
        raise UnsupportedError(
            f"device 'cuda' cannot be used: {fault}; it takes an NVIDIA graphics card and "
            "pip install 'spacearm[gpu]'; device='cpu' works everywhere"
        )
    return _compiled()


def _measures(arm: SpaceArm, q: Array, _: bool) -> dict[str, Array]:
    """Compute the measures at q (n, m) by name, each (m,), without compiled code."""
    values = {name: np.full(q.shape[1], np.nan) for name in QUANTITIES}
    for i in np.flatnonzero(np.isfinite(q).all(axis=0)):
        cfg = arm.at(q[:, i])
        J = task_jacobian(cfg)
        sigma = singular_values_of(J)
        values["sigma_min"][i] = sigma[-1]
        values["manipulability"][i] = sigma.prod()
        values["condition"][i] = sigma[0] / sigma[-1] if sigma[-1] > 0.0 else np.inf
        values["determinant"][i] = np.linalg.det(J) if arm.task.k == arm.n else np.nan
        values["radius"][i] = np.linalg.norm(cfg.tip.translation - cfg.com)
    return values


def _distances(arm: SpaceArm, q: Array) -> dict[str, Array]:
    """Compute the quantities `NEARNESS` at q (n, m), without compiled code."""
    arm.require_one_tip()
    m = q.shape[1]
    distance, away = np.full(m, np.nan), np.full((m, arm.n), np.nan)
    for i in np.flatnonzero(np.isfinite(q).all(axis=0)):
        cfg = arm.at(q[:, i])
        near = nearness_of(arm, task_jacobian(cfg), task_jacobian_derivative(cfg))
        distance[i], away[i] = refined_at(cfg, near, "free-floating")
    return {"distance": distance, "away": away}


def _jacobians(arm: SpaceArm, q: Array) -> Array:
    """Compute the generalized Jacobians (m, 6, n) at q (n, m), without compiled code."""
    J = np.full((q.shape[1], 6, arm.n), np.nan)
    for i in np.flatnonzero(np.isfinite(q).all(axis=0)):
        J[i] = generalized_jacobian(arm.at(q[:, i]))
    return J
