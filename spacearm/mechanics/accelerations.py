"""Forward dynamics of many states at once, by compiled kernels."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import numpy.typing as npt

from spacearm.arrays import NO_NUMBERS, Array
from spacearm.errors import ConfigurationError, ModelError
from spacearm.mechanics.blocks import (
    FEW,
    Progress,
    checked_output,
    joint_rows,
    read_block,
    run_blocks,
)
from spacearm.mechanics.dynamics import forward_dynamics
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode, free_components


@of_arm
def joint_accelerations(
    arm: SpaceArm,
    Q: npt.ArrayLike,
    dQ: npt.ArrayLike,
    tau: npt.ArrayLike,
    *,
    mode: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
    out: Array | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Array:
    """Compute the joint accelerations of many states, as `forward_dynamics` does of one.

    Compiled kernels compute 32 states side by side on each thread. No external wrenches act, and
    wheels hold no momentum.

    Args:
        arm: The arm.
        Q: (m, n) joint positions [rad] or [m], in any memory order, or a memory map; it is read
            block by block, as all of these are.
        dQ: (m, n) joint rates [rad/s] or [m/s].
        tau: (m, n) joint torques [N m] or forces [N].
        mode: What the spacecraft does; see `generalized_jacobian`.
        momentum: (6,) or (m, 6) [linear; angular about the system CM] in spacecraft axes; zero if
            None. It counts for a free-floating spacecraft only, and of it the angular part.
        out: (m, n) array to write to.
        threads: Number of threads; one per available processor if None.
        progress: Called as progress(done, m) after each block.

    Returns:
        (m, n) accelerations [rad/s^2] or [m/s^2]. Rows with numbers that are not finite give NaN,
        and so do states whose mass matrix is not positive definite.

    Raises:
        ConfigurationError: An argument has the wrong shape, or there is no such mode.

    Example:
        >>> import spacearm as sa
        >>> still = [[0, 0], [0, 0]]
        >>> sa.joint_accelerations(
        ...     sa.load("planar2"), [[0.3, 1.2], [0.0, 0.0]], still, [[1, 0], [1, 0]]
        ... ).round(4)
        array([[ 0.6307, -0.6049],
               [ 0.9111, -1.4652]])
    """
    free_components(mode)
    given = {"Q": Q, "dQ": dQ, "tau": tau}
    arrays = {name: joint_rows(arm, values, name) for name, values in given.items()}
    m = len(arrays["Q"])
    if odd := [name for name, values in arrays.items() if len(values) != m]:
        raise ConfigurationError(
            f"{odd[0]} has {len(arrays[odd[0]])} rows and Q {m}; give one for each state"
        )
    h = _momenta(momentum, m)
    result = np.empty((m, arm.n)) if out is None else checked_output(out, (m, arm.n), "out")

    compute = _compiled if m >= FEW else _singly

    def do(block: slice) -> None:
        q, dq, torques = (read_block(values, block) for values in arrays.values())
        result[block] = compute(arm, mode, q, dq, torques, np.ascontiguousarray(h[block, 3:].T)).T

    run_blocks(do, m, threads, progress, [*arrays.values(), result])
    return result


def _momenta(momentum: npt.ArrayLike | None, m: int) -> Array:
    """Return momenta as (m, 6).

    Raises:
        ConfigurationError: They have another shape.
    """
    try:
        h = np.zeros(6) if momentum is None else np.asarray(momentum, dtype=float)
    except NO_NUMBERS as error:
        raise ConfigurationError(f"momentum holds no numbers: {error}") from None
    if h.shape not in ((6,), (m, 6)):
        raise ConfigurationError(f"momentum has shape {h.shape}, not (6,) or ({m}, 6)")
    return np.broadcast_to(h, (m, 6))


def _compiled(arm: SpaceArm, mode: BaseMode, q: Array, dq: Array, tau: Array, h: Array) -> Array:
    """Compute the accelerations (n, m); importing the kernels takes half a second."""
    from spacearm.mechanics.compiled import accelerations

    return accelerations(arm, mode, q, dq, tau, h)


def _singly(arm: SpaceArm, mode: BaseMode, q: Array, dq: Array, tau: Array, h: Array) -> Array:
    """Compute the accelerations (n, m) without compiled code."""
    ddq = np.full(q.shape, np.nan)
    everything = np.vstack((q, dq, tau, h))
    for i in np.flatnonzero(np.isfinite(everything).all(axis=0)):
        momentum = np.concatenate((np.zeros(3), h[:, i]))
        with suppress(ModelError):
            at = arm.at(q[:, i])
            ddq[:, i] = forward_dynamics(at, dq[:, i], tau[:, i], mode=mode, momentum=momentum).ddq
    return ddq
