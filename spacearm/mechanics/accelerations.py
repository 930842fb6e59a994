"""Forward dynamics of many states at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import NO_NUMBERS, Array
from spacearm.equations.dynamics import loaded_accelerations
from spacearm.errors import ConfigurationError, ModelError, unknown
from spacearm.mechanics.blocks import Progress, checked_output, fill, joint_rows
from spacearm.mechanics.dynamics import forward_dynamics
from spacearm.mechanics.many import arms_kernel, worth_compiling
from spacearm.model.arguments import of_arm
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode, free_components

SINGLY = 1e-4
"""Time that one state takes without compiled code [s]."""

Rows = Mapping[str, Array]
"""Rows of the states by name."""


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

    Compiled code computes some states side by side on each thread. Vectors are in spacecraft axes,
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
    loads = {} if momentum is None and not spin.any() else {"h": h[:, 3:], "spin": spin}
    rows = {"q": arrays["Q"], "dq": arrays["dQ"], "tau": arrays["tau"], **loads}
    links = tuple(wrenches or ())
    for link, values in (wrenches or {}).items():
        if link not in arm.tree.links:
            raise ConfigurationError(unknown("link", link, arm.tree.links))
        rows[_wrench(link)] = _rows(values, m, 6, f"the wrench on {link!r}")
    result = np.empty((m, arm.n)) if out is None else checked_output(out, (m, arm.n), "out")
    kernel = _compiled(arm, mode, bool(loads), links) if worth_compiling(m, SINGLY) else None

    def compute(rows: Rows, places: dict[str, Array | None]) -> Rows:
        if kernel is None:
            return {"ddq": _singly(arm, mode, links, rows)}
        return {"ddq": kernel(rows, places["ddq"])}

    fill({"ddq": result}, rows, compute, threads, progress)
    return result


def _wrench(link: str) -> str:
    """Return the name of the rows of the wrench on a link."""
    return f"wrench on {link}"


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


def _compiled(
    arm: SpaceArm, mode: BaseMode, loaded: bool, links: tuple[str, ...]
) -> Callable[[Rows, Array | None], Array]:
    """Return the function that computes accelerations (m, n) by compiled code."""
    frames = [arm.model.frames[arm.model.getFrameId(link, pin.BODY)] for link in links]
    wheels = [arm.model.frames[wheel.frame] for wheel in arm.wheels] if loaded else []
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("q", "dq", "tau"), (arm.n,))
    shapes |= {"h": (3,), "spin": (len(wheels),)} if loaded else {}
    shapes |= {"wrenches": (len(links), 6)} if links else {}
    kernel = arms_kernel(
        [arm], mode, loaded_accelerations, tuple(shapes.items()),
        (("axes", (len(wheels), 3)), ("points", (len(links), 3))),
        options=(
            ("wheels", tuple(int(wheel.parentJoint) - 1 for wheel in wheels)),
            ("pushed", tuple(int(frame.parentJoint) - 1 for frame in frames)),
        ),
    )  # fmt: skip
    axes = [
        wheel.placement.rotation @ own.axis for wheel, own in zip(wheels, arm.wheels, strict=False)
    ]
    known = {
        "axes": np.array(axes).reshape(-1, 3),
        "points": np.array([frame.placement.translation for frame in frames]).reshape(-1, 3),
    }

    def compute(rows: Rows, place: Array | None) -> Array:
        given = dict(rows)
        if links:
            given["wrenches"] = np.stack([rows[_wrench(link)] for link in links], axis=1)
        found: Array = kernel(given, known, out=[place])
        return found

    return compute


def _singly(arm: SpaceArm, mode: BaseMode, links: tuple[str, ...], rows: Rows) -> Array:
    """Compute accelerations (m, n) without compiled code."""
    ddq, momentum = np.full(rows["q"].shape, np.nan), np.zeros(6)
    for i in range(len(ddq)):
        spin = rows["spin"][i] if "spin" in rows else None
        momentum[3:] = rows["h"][i] if "h" in rows else 0.0
        with suppress(ModelError):
            ddq[i] = forward_dynamics(
                arm.at(rows["q"][i], wheels=spin), rows["dq"][i], rows["tau"][i], mode=mode,
                momentum=momentum, wrenches={link: rows[_wrench(link)][i] for link in links},
            ).ddq  # fmt: skip
    return ddq
