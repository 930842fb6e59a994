"""Many configurations or states at once: measures, Jacobians, accelerations, determinants.

Configurations are read, checked and done in blocks, on several threads with little memory.
"""

from __future__ import annotations

import math
import mmap
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import (
    LARGEST,
    MOST_THREADS,
    Array,
    ArrayLike,
    Integers,
    Progress,
    numbers_of,
    whole,
)
from spacearm.compiler.expressions import LongTapeError
from spacearm.compiler.machine import processors
from spacearm.equations import measures
from spacearm.equations.kinematics import jacobian
from spacearm.equations.plant import Pushed, Setup, loaded_accelerations
from spacearm.errors import ConfigurationError, ModelError, listed, require_known
from spacearm.mechanics import arm_kernels
from spacearm.mechanics.arm_kernels import ArmKernel, evaluated, worth_compiling
from spacearm.mechanics.distance import distances
from spacearm.mechanics.dynamics import forward_dynamics
from spacearm.mechanics.jacobian import generalized_jacobian, singular_values_of, task_jacobian
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.processes import Threads, check_memory
from spacearm.signatures import checked

#: Configurations per thread and block: their data fit the processor cache.
BLOCK = 16384
#: So many are not divided between threads: to start one takes as long.
LEAST = 1024

#: Number of blocks after which pages of memory maps are released.
BLOCKS_MAPPED = 32


def results_for(array: Array | None, shape: tuple[int, ...], what: str) -> Array:
    """Check an array of floats that results are written to, or make one if None."""
    if array is None:
        remedy = "give fewer rows, or a numpy.memmap to write to as out"
        check_memory(8.0 * math.prod(map(float, shape)), f"{what} of shape {shape}", remedy)
        return np.empty(shape)
    if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype.kind != "f":
        raise ConfigurationError(
            f"{what} is {getattr(array, 'dtype', type(array).__name__)} of shape "
            f"{np.shape(array)}; give an array of floats of shape {shape}"
        )
    if not array.flags.writeable:
        raise ConfigurationError(f"{what} is read-only; give one that can be written to")
    return array


def joint_rows(arm: SpaceArm, values: ArrayLike, what: str) -> Array:
    """Check values (m, n), a row for each state, and return them, not copied if they are an array.

    Raises:
        ConfigurationError: They are not numbers, or have another shape.
    """
    array: npt.NDArray[Any] = values if isinstance(values, np.ndarray) else numbers_of(values, what)
    if array.size == 0 and array.ndim < 2:
        array = array.reshape(0, arm.n)
    if array.dtype.kind not in "fiu" or array.ndim != 2 or array.shape[1] != arm.n:
        raise ConfigurationError(
            f"{what} has shape {array.shape} and type {array.dtype}; {arm.name} needs real numbers "
            f"of shape (m, {arm.n}), one column for each of: {listed(arm.joint_names)}"
        )
    return array


def read_block(Q: Array, block: slice) -> tuple[npt.NDArray[np.float64], Integers]:
    """Read one block of Q (m, n), and the numbers of its rows that are not joint positions.

    These rows are zero.
    """
    q = np.ascontiguousarray(Q[block], dtype=np.float64)
    none = np.zeros(0, dtype=np.intp)
    if not q.size or (q.min() >= -LARGEST and q.max() <= LARGEST):
        return q, none
    wrong = np.flatnonzero(~(np.abs(q) <= LARGEST).all(axis=1))
    q = q.copy()
    q[wrong] = 0.0
    return q, wrong


def fill(
    results: Mapping[str, Array],
    rows: Mapping[str, Array],
    compute: Callable[[dict[str, Array], dict[str, Array | None]], Mapping[str, Array]],
    threads: int | None,
    progress: Progress | None,
) -> None:
    """Compute results (m, ...) of rows (m, ...), block by block, on several threads.

    Args:
        results: What is written to; NaN where a row is not finite.
        rows: What is read.
        compute: Gives results of some rows; also takes the places that compiled code may write to.
        threads: Number of threads; one per available processor if None.
        progress: Called as progress(done, m) after each block.
    """

    def do(block: slice) -> None:
        read = {name: read_block(values, block) for name, values in rows.items()}
        places: dict[str, Array | None] = {name: values[block] for name, values in results.items()}
        for name, place in places.items():
            if place is not None and (place.dtype != np.float64 or not place.flags.c_contiguous):
                places[name] = None
        found = compute({name: values for name, (values, _) in read.items()}, places)
        for name, values in results.items():
            if found[name] is not places[name]:
                values[block] = found[name]
            for _, wrong in read.values():
                values[block][wrong] = np.nan

    m = len(next(iter(rows.values())))
    threads = processors() if threads is None else whole(threads, "threads", 1, MOST_THREADS)
    size = min(BLOCK, max(-(-m // threads), LEAST))
    blocks = [slice(i, min(i + size, m)) for i in range(0, m, size)]
    maps = [_memory_map(array) for array in (*rows.values(), *results.values())]
    with Threads(threads) as pool:
        done = pool.map(do, blocks) if len(blocks) > 1 else map(do, blocks)
        try:
            for i, _ in enumerate(done):
                for memory_map in maps if i % BLOCKS_MAPPED == 0 else ():
                    if memory_map is not None:
                        memory_map.madvise(mmap.MADV_DONTNEED)
                if progress:
                    progress(blocks[i].stop, m)
        except BaseException:  # Ctrl-C too: only what has begun is waited for
            pool.shutdown(cancel_futures=True)
            raise


def _memory_map(array: Array) -> mmap.mmap | None:
    """Return the memory map behind an array, if any: its pages can be released once used."""
    owner: object = array
    while isinstance(owner, np.ndarray):
        if isinstance(owner, np.memmap) and owner.mode == "c":
            return None  # changes to a private copy are in memory only
        owner = owner.base
    return owner if isinstance(owner, mmap.mmap) else None


#: The measures that take J* alone.
QUANTITIES = ("sigma_min", "manipulability", "condition", "determinant", "radius")
#: Those that take its derivative: a number, and a vector over the joints.
NEARNESS = ("distance", "away")
#: Time that one configuration or state takes without compiled code [s].
SINGLY = 1e-4
#: Rows of states by name.
Rows = Mapping[str, Array]


@checked
def evaluate(
    arm: SpaceArm,
    Q: ArrayLike,
    quantities: str | Sequence[str] = QUANTITIES,
    *,
    out: Mapping[str, Array] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Array]:
    """Compute measures of singularity at many configurations of the free-floating arm.

    Compiled code gives the same numbers as `singularity` does one by one. Singular values come from
    bidiagonal reduction and qd transforms, to a few rounding units of the largest one, at singular
    configurations too (the tests allow 2e-14 of it against numpy's svd).

    Args:
        arm: The arm.
        Q: (m, n) joint positions [rad] or [m], in any memory order, or a memory map; it is read
            block by block.
        quantities: Of "sigma_min" (least singular value of the task Jacobian), "manipulability"
            (product of the singular values), "condition" (largest over least), "determinant"
            (equation (37); NaN unless the task has as many rows as the arm has joints) and
            "radius" (R of equation (43), distance of the tip from the system CM [m]). Not by
            default, because they take the derivative of J*: "distance" (to the singular set, to
            first order [rad]) and "away" (its gradient: the joint motion per radian of distance
            that leads away), as by `singularity` without a search. Together these two take two to
            four times as long as sigma_min: `python benchmarks/distance.py` prints it.
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
    require_known("quantity", (*quantities, *out), (*QUANTITIES, *NEARNESS))
    if extra := set(out) - set(quantities):
        raise ConfigurationError(
            f"out has arrays for {', '.join(sorted(extra))}, which quantities does not name"
        )
    Q = joint_rows(arm, Q, "Q")
    m = len(Q)
    shapes = {name: (m, arm.n) if name == "away" else (m,) for name in quantities}
    results = {
        name: results_for(out.get(name), shape, f"out[{name!r}]") for name, shape in shapes.items()
    }
    arm.require_one_tip()
    own = tuple(name for name in QUANTITIES if name in results)

    def compute(rows: Rows, places: Mapping[str, Array | None]) -> dict[str, Array]:
        written = [places[name] for name in own]
        found = dict(zip(own, measured(arm, rows["q"], own, many=m, out=written), strict=True))
        near = () if len(own) == len(results) else distances(arm, rows["q"], many=m)
        return found | dict(zip(NEARNESS, near, strict=False))

    fill(results, {"q": Q}, compute, threads, progress)
    return results


def conditions(arm: SpaceArm, Q: Array, mode: BaseMode) -> Array:
    """Compute the condition numbers (m,) of the task Jacobian at Q (m, n) in a mode."""
    return np.asarray(measured(arm, Q, ("condition",), mode)[0])


def measured(
    arm: SpaceArm,
    Q: Array,
    names: tuple[str, ...],
    mode: BaseMode = "free-floating",
    *,
    many: int = 0,
    out: Sequence[Array | None] = (),
) -> Sequence[Array]:
    """Compute measures (m,) at Q (m, n), a block of `many`, where compiled code may write."""
    rows = max(len(Q), many)
    if names and worth_compiling(rows, SINGLY):
        wide, known = arm_kernels.WIDE, {"names": names}
        kernel = ArmKernel([arm], mode, measures.measures, known, lanes=wide, rows=rows)
        with suppress(LongTapeError):
            return kernel({"q": Q}, out=out)
    columns = np.full((len(names), len(Q)), np.nan)
    for i, q in enumerate(Q if names else ()):
        cfg = arm.at(q)
        J = task_jacobian(cfg, mode=mode)
        sigma = singular_values_of(J)
        own = {
            "sigma_min": sigma[-1],
            "manipulability": sigma.prod(),
            "condition": sigma[0] / sigma[-1] if sigma[-1] > 0.0 else np.inf,
            "determinant": np.linalg.det(J) if arm.task.k == arm.n else np.nan,
            "radius": np.linalg.norm(cfg.tip.translation - cfg.com),
        }
        columns[:, i] = [own[name] for name in names]
    return [*columns]


@checked
def generalized_jacobians(
    arm: SpaceArm,
    Q: ArrayLike,
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
    J = results_for(out, (len(Q), 6, arm.n), "out")
    kernel = ArmKernel([arm], "free-floating", jacobian, rows=len(Q))

    def compute(rows: Rows, places: Mapping[str, Array | None]) -> Rows:
        if worth_compiling(len(Q), SINGLY):
            with suppress(LongTapeError):
                return {"J": kernel(rows, out=[places["J"]])}
        return {"J": np.array([generalized_jacobian(arm.at(q)) for q in rows["q"]])}

    fill({"J": J}, {"q": Q}, compute, threads, progress)
    return J


@checked
def joint_accelerations(
    arm: SpaceArm,
    Q: ArrayLike,
    dQ: ArrayLike,
    tau: ArrayLike,
    *,
    mode: BaseMode = "free-floating",
    momentum: ArrayLike | None = None,
    wheels: ArrayLike | None = None,
    wrenches: Mapping[str, ArrayLike] | None = None,
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
    given = {"Q": Q, "dQ": dQ, "tau": tau}
    arrays = {name: joint_rows(arm, values, name) for name, values in given.items()}
    m = len(arrays["Q"])
    if odd := [name for name, values in arrays.items() if len(values) != m]:
        raise ConfigurationError(
            f"{odd[0]} has {len(arrays[odd[0]])} rows and Q {m}; give one for each state"
        )
    h = _rows(momentum, m, 6, "momentum")
    spin = _rows(wheels, m, len(arm.wheels), "wheels")
    rows = dict(zip(("q", "dq", "tau"), arrays.values(), strict=True))
    if momentum is not None or spin.any():
        rows |= {"h": h[:, 3:], "spin": spin}
    for link, values in (wrenches or {}).items():
        require_known("link", link, arm.tree.links)
        rows[f"wrench on {link}"] = _rows(values, m, 6, f"the wrench on {link!r}")
    result, links = results_for(out, (m, arm.n), "out"), tuple(wrenches or ())
    run = _accelerated if worth_compiling(m, SINGLY) else _accelerated_singly

    def compute(rows: Rows, places: Mapping[str, Array | None]) -> Rows:
        return {"ddq": run(arm, mode, links, rows, places["ddq"])}

    fill({"ddq": result}, rows, compute, threads, progress)
    return result


def _rows(values: ArrayLike | None, m: int, width: int, what: str) -> Array:
    """Return numbers as (m, width), a row for each state, zeros if None.

    Raises:
        ConfigurationError: They are not numbers, or have another shape than (width,) or (m,
            width).
    """
    rows = np.zeros(width) if values is None else numbers_of(values, what)
    if rows.shape not in ((width,), (m, width)):
        raise ConfigurationError(f"{what} has shape {rows.shape}, not ({width},) or ({m}, {width})")
    return np.broadcast_to(rows, (m, width))


def _accelerated(
    arm: SpaceArm, mode: BaseMode, links: tuple[str, ...], rows: Rows, place: Array | None
) -> Array:
    """Compute accelerations (m, n) by compiled code, of arms too long for that one by one."""
    frames = arm.model.frames
    pushed = [frames[arm.model.getFrameId(link, pin.BODY)] for link in links]
    wheels = arm.wheels if "spin" in rows else ()
    axes = [frames[wheel.frame].placement.rotation @ wheel.axis for wheel in wheels]
    setup = Setup(
        wheels=tuple(int(frames[wheel.frame].parentJoint) - 1 for wheel in wheels),
        pushed=tuple(Pushed(int(frame.parentJoint) - 1, False) for frame in pushed),
    )
    points = [frame.placement.translation for frame in pushed]
    placed = np.concatenate([np.zeros(3), *axes, *points, np.zeros(9 * len(links))])
    given = {name: values for name, values in rows.items() if not name.startswith("wrench")}
    if links:
        given["wrenches"] = np.stack([rows[f"wrench on {link}"] for link in links], axis=1)
    kernel = ArmKernel([arm], mode, loaded_accelerations, {"setup": setup})
    with suppress(LongTapeError):
        return kernel(given, {"placed": placed}, out=[place])
    return _accelerated_singly(arm, mode, links, rows, place)


def _accelerated_singly(
    arm: SpaceArm, mode: BaseMode, links: tuple[str, ...], rows: Rows, _: Array | None
) -> Array:
    """Compute accelerations (m, n) without compiled code."""
    ddq, momentum = np.full(rows["q"].shape, np.nan), np.zeros(6)
    for i in range(len(ddq)):
        spin = rows["spin"][i] if "spin" in rows else None
        momentum[3:] = rows["h"][i] if "h" in rows else 0.0
        with suppress(ModelError):
            ddq[i] = forward_dynamics(
                arm.at(rows["q"][i], wheels=spin, momentum=momentum),
                rows["dq"][i], rows["tau"][i], mode=mode,
                wrenches={link: rows[f"wrench on {link}"][i] for link in links},
            ).ddq  # fmt: skip
    return ddq


def minors(arm: SpaceArm, Q: Array, mode: BaseMode, rows: Integers, columns: Integers) -> Array:
    """Compute determinants (m, c) at Q (m, n), up to one positive factor.

    Args:
        arm: The arm, with one tip.
        Q: (m, n) joint positions.
        mode: What the spacecraft does.
        rows: (k,) rows of momentum, or of the twist of the tip if the spacecraft is held.
        columns: (c, k) columns of each minor: 0 to 5 the tip's twist, 6 + j joint j.
    """
    row, column = _units(arm, mode == "free-floating")
    options = {"rows": tuple(rows.tolist()), "chosen": tuple(map(tuple, columns.tolist()))}
    units = {"row_unit": row, "column_unit": column}
    return evaluated(arm, mode, measures.determinants, {"q": Q}, units, options=options)


def columns_seen(arm: SpaceArm, Q: Array, mode: BaseMode) -> Array:
    """Compute the columns (m, 6, 6 + n) of which `minors` takes determinants, for a check."""
    row, column = _units(arm, mode == "free-floating")
    return row[:, None] * evaluated(arm, mode, measures.columns, {"q": Q}, once=True) * column


def tips_from_centre(arm: SpaceArm, Q: Array, mode: BaseMode) -> Array:
    """Compute the tip (m, 3) from the system CM, or a fixed spacecraft's own, at Q (m, n) [m].

    In spacecraft axes.

    Raises:
        UnsupportedError: The arm has several tips.
    """
    arm.require_one_tip()
    if not len(Q) or worth_compiling(len(Q), SINGLY):
        return evaluated(arm, mode, measures.tip_from_centre, {"q": Q})
    hub = arm.model.inertias[1].lever
    cfgs = (arm.at(q) for q in Q)
    return np.array([c.tips[0].translation - (hub if mode == "fixed" else c.com) for c in cfgs])


@lru_cache(maxsize=64)
def _units(arm: SpaceArm, floating: bool) -> tuple[Array, Array]:
    """Return factors of rows (6,) and columns (6 + n,) that make them of order one.

    They are made of the arm's size and of the mass that each joint moves, so that neither tiny nor
    huge arms, nor very light spacecraft, leave the range of floating-point numbers.
    """
    tree, p = arm_kernels.structure_of(arm), arm_kernels.parameters_of(arm)
    M = float(p.masses.sum())
    reach = np.linalg.norm(p.joint_positions, axis=1).sum() + np.linalg.norm(p.tip_positions[0])
    moments = np.trace(p.inertias, axis1=1, axis2=2).sum()
    gyration = float(np.sqrt(abs(moments) / M))  # impossible moments, if accepted, are negative
    L = float(reach + np.linalg.norm(p.centres, axis=1).max() + gyration) or 1.0
    row = np.repeat((1.0 / M, 1.0 / (M * L)) if floating else (1.0, L), 3)
    column = np.ones(6 + arm.n)
    column[3:6] = 1.0 / L
    share = measures.moved(tree) @ p.masses / M
    for i, j in zip(*np.nonzero(tree.gains), strict=True):
        column[6 + j] = 1.0 if tree.slides[i + 1] else 1.0 / L
        if floating and share[i] > 0.0:
            column[6 + j] /= share[i]
    return row, column
