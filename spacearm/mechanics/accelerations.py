"""Forward dynamics of many states at once, by compiled kernels."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import NO_NUMBERS, Array
from spacearm.errors import ConfigurationError, ModelError, unknown
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

Floats = npt.NDArray[np.float64]


class States(NamedTuple):
    """What the accelerations of m states depend on, the states innermost.

    Attributes:
        q: (n, m) joint positions.
        dq: (n, m) joint rates.
        tau: (n, m) joint torques.
        h: (3, m) angular momentum about the system CM, spacecraft axes.
        spin: (w, m) momentum that each wheel holds.
        wrench: (k, 6, m) wrench on each of the links that one acts on, spacecraft axes.
    """

    q: Floats
    dq: Floats
    tau: Floats
    h: Floats
    spin: Floats
    wrench: Floats


@of_arm
def joint_accelerations(
    arm: SpaceArm,
    Q: npt.ArrayLike,
    dQ: npt.ArrayLike,
    tau: npt.ArrayLike,
    *,
    mode: BaseMode = "free-floating",
    momentum: npt.ArrayLike | None = None,
    wheels: npt.ArrayLike | None = None,
    wrenches: Mapping[str, npt.ArrayLike] | None = None,
    out: Array | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Array:
    """Compute the joint accelerations of many states, as `forward_dynamics` does of one.

    Compiled kernels compute 32 states side by side on each thread. Vectors are in spacecraft axes,
    in which the states need no attitude.

    Args:
        arm: The arm.
        Q: (m, n) joint positions [rad] or [m], in any memory order, or a memory map; it is read
            block by block, as all of these are.
        dQ: (m, n) joint rates [rad/s] or [m/s].
        tau: (m, n) joint torques [N m] or forces [N].
        mode: What the spacecraft does; see `generalized_jacobian`.
        momentum: (6,) or (m, 6) [linear; angular about the system CM] in spacecraft axes, that of
            the wheels included; zero if None. It counts for a free-floating spacecraft only, and
            of it the angular part.
        wheels: (w,) or (m, w) momentum that each wheel of the arm holds [N m s]; zeros if None.
            Wheels keep their rates relative to the links that carry them.
        wrenches: Link name -> (6,) or (m, 6) external [force [N]; torque [N m]] at the origin of
            the link's frame, in spacecraft axes (`forward_dynamics` takes inertial axes).
        out: (m, n) array to write to.
        threads: Number of threads; one per available processor if None.
        progress: Called as progress(done, m) after each block.

    Returns:
        (m, n) accelerations [rad/s^2] or [m/s^2]. Rows with numbers that are not finite give NaN,
        and so do states whose mass matrix is not positive definite.

    Raises:
        ConfigurationError: An argument has the wrong shape, or there is no such mode or link.

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
    h = _rows(momentum, m, 6, "momentum")
    spin = _rows(wheels, m, len(arm.wheels), "wheels")
    pushed = {}
    for link, values in (wrenches or {}).items():
        if link not in arm.tree.links:
            raise ConfigurationError(unknown("link", link, arm.tree.links))
        pushed[link] = _rows(values, m, 6, f"the wrench on {link!r}")
    result = np.empty((m, arm.n)) if out is None else checked_output(out, (m, arm.n), "out")

    compute = _compiled if m >= FEW else _singly

    def do(block: slice) -> None:
        q, dq, torques = (read_block(values, block) for values in arrays.values())
        wrench = np.empty((len(pushed), 6, q.shape[1]))
        for own, values in zip(wrench, pushed.values(), strict=True):
            own[:] = read_block(values, block)
        x = States(q, dq, torques, read_block(h[:, 3:], block), read_block(spin, block), wrench)
        result[block] = compute(arm, mode, list(pushed), x).T

    everything = [*arrays.values(), h, spin, *pushed.values(), result]
    run_blocks(do, m, threads, progress, everything)
    return result


def _rows(values: npt.ArrayLike | None, m: int, width: int, what: str) -> Array:
    """Return numbers as (m, width), a row for each state, zeros if None.

    Raises:
        ConfigurationError: They are no numbers, or have another shape than (width,) or (m, width).
    """
    try:
        rows = np.zeros(width) if values is None else np.asarray(values, dtype=float)
    except NO_NUMBERS as error:
        raise ConfigurationError(f"{what} holds no numbers: {error}") from None
    if rows.shape not in ((width,), (m, width)):
        raise ConfigurationError(f"{what} has shape {rows.shape}, not ({width},) or ({m}, {width})")
    return np.broadcast_to(rows, (m, width))


def _compiled(arm: SpaceArm, mode: BaseMode, links: list[str], x: States) -> Array:
    """Compute the accelerations (n, m); importing the kernels takes half a second."""
    from spacearm.kernels.dynamics.many.equations import accelerations
    from spacearm.kernels.dynamics.many.loads import ON_BODY, Loads
    from spacearm.mechanics.compiled import all_bodies, all_positions, frame_on_body

    wheel, pushed = np.zeros(len(arm.wheels), ON_BODY), np.zeros(len(links), ON_BODY)
    for record, own in zip(wheel, arm.wheels, strict=True):
        place = frame_on_body(arm, own.frame)
        record["body"], record["v"] = place.body, place.rotation @ own.axis
    for record, link in zip(pushed, links, strict=True):
        place = frame_on_body(arm, arm.model.getFrameId(link, pin.BODY))
        record["body"], record["v"] = place.body, place.p
    loads, ddq = Loads(wheel, x.spin, pushed, x.wrench), np.empty_like(x.dq)
    b, q = all_bodies(arm), all_positions(arm, x.q)
    accelerations(b, free_components(mode), q, x.dq, x.tau, x.h, loads, ddq)
    return ddq


def _singly(arm: SpaceArm, mode: BaseMode, links: list[str], x: States) -> Array:
    """Compute the accelerations (n, m) without compiled code."""
    ddq, m = np.full(x.q.shape, np.nan), x.q.shape[1]
    everything = np.vstack([values.reshape(-1, m) for values in x])
    for i in np.flatnonzero(np.isfinite(everything).all(axis=0)):
        momentum = np.concatenate((np.zeros(3), x.h[:, i]))
        wrenches = {link: x.wrench[o, :, i] for o, link in enumerate(links)}
        with suppress(ModelError):
            at = arm.at(x.q[:, i], wheels=x.spin[:, i])
            ddq[:, i] = forward_dynamics(
                at, x.dq[:, i], x.tau[:, i], mode=mode, momentum=momentum, wrenches=wrenches
            ).ddq
    return ddq
