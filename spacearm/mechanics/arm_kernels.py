"""The equations of an arm over many configurations: traced, compiled and kept for arms of a kind.

Few configurations are answered by the reference, or by the equations run over numbers: compiling
takes some tenths of a second. The choice depends on the amount of work alone, so that the same
call gives the same digits.

For many configurations the numbers that are zero or one by the structure of the arm are compiled
in, and the others are arguments. So arms that differ in masses and lengths only run the same
machine code. For fewer all numbers are arguments, so that all arms whose joints follow each other
alike do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from threading import RLock
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.compiler import expressions
from spacearm.compiler.expressions import LongTapeError
from spacearm.equations.kinematics import Parameters, Structure
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm

#: Held while something is compiled, so that two threads do not compile the same.
COMPILING = RLock()
Z = np.array([0.0, 0.0, 1.0])
Shape = tuple[int, ...]

#: What must take longer without compiled code is compiled: who asks once often asks again [s].
WORTH = 5e-3
#: The same where nobody asks again [s].
WORTH_ONCE = 0.1
#: Time that the equations take by numbers, for one configuration [s].
BY_NUMBERS = 1e-3
#: For so many configurations the zeros and ones of an arm are compiled in, which saves a third of
#: the time that they take.
MANY = 10_000
#: Number of arms whose numbers and functions are kept, with the arms: some 0.3 MB each.
KEPT_ARMS = 64
#: Lanes of functions that wait for divisions in loops, more than fit a register.
WIDE = 8


def worth_compiling(rows: int, seconds: float = BY_NUMBERS, once: bool = False) -> bool:
    """Return whether to compile for so many configurations.

    Args:
        rows: Their number.
        seconds: What one takes without.
        once: Whether nobody asks again.
    """
    return rows * seconds >= (WORTH_ONCE if once else WORTH)


def evaluated(
    arm: SpaceArm,
    mode: BaseMode,
    function: Callable[..., Any],
    inputs: Mapping[str, Array],
    numbers: Mapping[str, Any] | None = None,
    *,
    options: Mapping[str, Any] | None = None,
    once: bool = False,
) -> Any:
    """Compute an equation of an arm for many configurations, compiled if that is worth it.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        function: As in `ArmKernel`.
        inputs: (m, ...) arrays by name, a row for each configuration.
        numbers: What all of them share.
        options: As in `ArmKernel`.
        once: As in `worth_compiling`.

    Returns:
        (m, ...) what the function returns, an array or a tuple.
    """
    m = len(next(iter(inputs.values())))
    if m == 0 or worth_compiling(m, once=once):
        kernel = ArmKernel([arm], mode, function, options, rows=m)
        with suppress(LongTapeError):
            return kernel(inputs, numbers)
    from spacearm.compiler import numbers as by_numbers

    tree, p, shared = structure_of(arm, mode), parameters_of(arm), {**(options or {})}
    shared |= {name: np.asarray(value, dtype=float) for name, value in (numbers or {}).items()}
    arrays = {name: np.asarray(values, dtype=float) for name, values in inputs.items()}
    with np.errstate(all="ignore"):
        found = [
            function(by_numbers, tree, p, **shared, **{name: x[i] for name, x in arrays.items()})
            for i in range(m)
        ]
    if isinstance(found[0], tuple):
        return tuple(np.array(values) for values in zip(*found, strict=True))
    return np.array(found)


@lru_cache(maxsize=KEPT_ARMS)
def structure_of(arm: SpaceArm, mode: BaseMode = "free-floating") -> Structure:
    """Return the structure of an arm in a mode."""
    model, names = arm.model, list(arm.model.names)
    joints = [arm.tree.joints[name] for name in names[2:]]
    turns = (pin.Quaternion.FromTwoVectors(Z, joint.axis).matrix() for joint in joints)
    return Structure(
        n=arm.n,
        parents=(0, *(int(parent) - 1 for parent in list(model.parents)[2:])),
        slides=(False, *(joint.kind == "prismatic" for joint in joints)),
        gains=np.eye(arm.n) if arm.coupling is None else np.asarray(arm.coupling),
        offsets=np.array(arm.offsets, dtype=float),
        turns=_whole(np.array([np.eye(3), *turns], dtype=float)),
        tips=tuple(model.frames[frame].parentJoint - 1 for frame in arm.tip_frames),
        rows=tuple(int(row) for row in arm.task.indices),
        scale=np.array(arm.task.scale, dtype=float),
        mode=mode,
    )


@lru_cache(maxsize=KEPT_ARMS)
def parameters_of(arm: SpaceArm) -> Parameters:
    """Return the numbers of an arm."""
    model = arm.model
    inertias = [model.inertias[i] for i in range(1, model.njoints)]
    joints = [model.jointPlacements[i] for i in range(2, model.njoints)]
    tips = [model.frames[frame].placement for frame in arm.tip_frames]
    return Parameters(
        masses=np.array([body.mass for body in inertias]),
        centres=np.array([body.lever for body in inertias]),
        inertias=np.array([body.inertia for body in inertias]),
        joint_positions=np.array([joint.translation for joint in joints]),
        joint_rotations=_whole(np.array([joint.rotation for joint in joints])),
        tip_positions=np.array([tip.translation for tip in tips]),
        tip_rotations=_whole(np.array([tip.rotation for tip in tips])),
    )


def _whole(rotations: Array) -> npt.NDArray[np.float64]:
    """Return rotations without the rounding of right angles, which would be compiled as numbers."""
    whole = np.rint(rotations)
    return np.where(np.abs(rotations - whole) <= 1e-15, whole + 0.0, rotations).astype(np.float64)


class ArmKernel:
    """A function of arms in a mode as machine code, called as a `Kernel` is.

    It is compiled when it is first called with arguments of some names and shapes. Where the arms
    differ their numbers are arguments of each lane: it is called with `lanes_of`, the number of the
    arm of each lane.

    Args:
        arms: One arm, or several of one structure.
        mode: What the spacecraft does.
        function: Called as function(xp, structure, parameters, **options, **arguments), a function
            of a module; it is traced.
        options: What is known while tracing, by name; can be hashed.
        outside: Names and numbers of results of functions that are called as it runs.
        lanes: Number of lanes side by side; what suits the processor if None.
        rows: For about how many configurations it is called. For few the frames of the bodies are
            not those of the arm: z is the axis of their joint.
        fast: As of `Kernel`.
    """

    def __init__(
        self,
        arms: Sequence[SpaceArm],
        mode: BaseMode,
        function: Callable[..., Any],
        options: Mapping[str, Any] | None = None,
        *,
        outside: Mapping[str, int] | None = None,
        lanes: int | None = None,
        rows: float = MANY,
        fast: bool = False,
    ) -> None:
        number = {arm: i for i, arm in enumerate(dict.fromkeys(arms))}
        self._arms, self._mode, self._special = tuple(number), mode, rows >= MANY
        self._each = [number[arm] for arm in arms] if len(number) > 1 else [0]
        known, calls = tuple((options or {}).items()), tuple((outside or {}).items())
        self._what = function, known, calls, lanes, fast
        self._found: dict[Any, tuple[Any, Array]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process needs; the machine code is made there."""
        return vars(self) | {"_found": {}}

    def __call__(
        self,
        inputs: Mapping[str, Array],
        numbers: Mapping[str, Any] | None = None,
        tables: Mapping[str, Array] | None = None,
        lanes_of: Any = None,
        **how: Any,
    ) -> Any:
        """Compute all lanes; see `Kernel`. `lanes_of` numbers the arm of each lane.

        Raises:
            LongTapeError: The arm has so many joints that the function is not compiled.
        """
        given, looked = dict(numbers or {}), dict(tables or {})
        shapes = (
            tuple((name, values.shape[1:]) for name, values in inputs.items()),
            tuple((name, np.shape(values)) for name, values in given.items()),
            tuple((name, table.shape[1]) for name, table in looked.items()),
        )
        if shapes not in self._found:
            kernel_of = _kernel_of_one if len(self._arms) == 1 else _kernel_of_many
            kernel, own = kernel_of(self._arms, self._mode, self._special, shapes, self._what)
            self._found[shapes] = kernel, own[self._each]
        kernel, own = self._found[shapes]
        if len(own) > 1:
            inputs = {"own": own[lanes_of], **inputs}
        else:
            given["own"] = own[0]
        return kernel(inputs, given, looked, **how)


def _kernel(
    arms: tuple[SpaceArm, ...], mode: BaseMode, special: bool, shapes: Any, what: Any
) -> tuple[Any, Array]:
    """Return a function of different arms, and the numbers (arms, p) that are its arguments.

    Where it is special, zeros and ones of the arms are compiled in.
    """
    flat = np.array([_numbers(arm, special) for arm in arms])
    sizes = tuple(np.shape(values) for values in _arrays(arms[0], special))
    if special:
        vary = ~(np.isin(flat[0], (0.0, 1.0, -1.0)) & (flat == flat[0]).all(axis=0))
    else:
        vary = np.repeat(np.arange(len(sizes)) != TURNS, [np.prod(size) for size in sizes])
    pattern = np.where(vary, 2.0, flat[0]).tobytes()
    tree = structure_of(arms[0], mode)
    bare = replace(tree, turns=np.zeros_like(tree.turns), scale=np.zeros_like(tree.scale))
    with COMPILING:
        kernel = _compiled(bare, pattern, sizes, len(arms) > 1, shapes, what)
    if kernel is None:
        raise LongTapeError(
            f"{arms[0].name}: with {arms[0].n} joints this takes more than {expressions.LONGEST:,} "
            "operations, the most that are compiled; lock joints"
        )
    return kernel, flat[:, vary]


_kernel_of_one = lru_cache(maxsize=KEPT_ARMS)(_kernel)
#: Of many arms the last ones are kept alone.
_kernel_of_many = lru_cache(maxsize=1)(_kernel)
#: Place of the turns among the arrays of an arm.
TURNS = len(Parameters._fields)


def _arrays(arm: SpaceArm, own: bool) -> tuple[Array, ...]:
    """Return the numbers of an arm: its parameters, the turns of its joints, the task's scale.

    They are in its own frames, or in those without turns: z is the axis of each joint.
    """
    tree, p = structure_of(arm), parameters_of(arm)
    if own:
        return (*p, tree.turns, tree.scale)
    S = tree.turns
    back, inner, body = S.swapaxes(1, 2), list(tree.parents[1:]), list(tree.tips)
    turned = Parameters(
        masses=p.masses,
        centres=_times(back, p.centres),
        inertias=back @ p.inertias @ S,
        joint_positions=_times(back[inner], p.joint_positions),
        joint_rotations=back[inner] @ p.joint_rotations @ S[1:],
        tip_positions=_times(back[body], p.tip_positions),
        tip_rotations=back[body] @ p.tip_rotations,
    )
    return (*turned, np.broadcast_to(np.eye(3), S.shape), tree.scale)


def _times(rotations: Array, vectors: Array) -> Array:
    """Return rotations (m, 3, 3) times vectors (m, 3)."""
    return np.asarray((rotations @ vectors[..., None])[..., 0])


@lru_cache(maxsize=KEPT_ARMS)
def _numbers(arm: SpaceArm, own: bool) -> Array:
    """Return the numbers of an arm as one vector."""
    return np.concatenate([np.ravel(values) for values in _arrays(arm, own)])


@lru_cache(maxsize=256)
def _compiled(
    tree: Structure, pattern: bytes, sizes: tuple[Shape, ...], each: bool, shapes: Any, what: Any
) -> Any:
    """Trace and compile a function for arms of one structure, whose numbers are arguments.

    Returns None where it takes more operations than are compiled.
    """
    from spacearm.compiler import symbols
    from spacearm.compiler.kernel import compiled

    known, (function, options, outside, lanes, fast) = np.frombuffer(pattern), what

    def traced(own: Any, **arguments: Any) -> Any:
        flat = known.astype(object)
        flat[known == 2.0] = own
        parts = np.split(flat, np.cumsum([int(np.prod(shape)) for shape in sizes])[:-1])
        *p, turns, scale = (symbols.asarray(part.reshape(shape))
                            for part, shape in zip(parts, sizes, strict=True))  # fmt: skip
        arm = replace(tree, turns=turns, scale=scale)
        return function(symbols, arm, Parameters(*p), **dict(options), **arguments)

    inputs, numbers, tables = map(dict, shapes)
    varied = {"own": (int((known == 2.0).sum()),)}
    inputs, numbers = (varied | inputs, numbers) if each else (inputs, varied | numbers)
    try:
        return compiled(traced, inputs, numbers, tables, dict(outside), lanes=lanes, fast=fast)
    except LongTapeError:
        return None
