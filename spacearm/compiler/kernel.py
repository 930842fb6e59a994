"""Traced functions as machine code that runs over many lanes, on several threads."""

from __future__ import annotations

import ctypes
import gc
from array import array
from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from threading import Lock
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.compiler.lanes import STACK, Lanes
from spacearm.compiler.machine import Code, fuses, is_kept, width
from spacearm.compiler.symbols import Rows, Traced, trace
from spacearm.processes import Threads

Array = npt.NDArray[np.float64]

PREPARE = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
RUN = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, *[ctypes.c_int64] * 3)
#: A function outside: number of the lane, what it is given, where its status and numbers go.
OUTSIDE = ctypes.CFUNCTYPE(
    None, ctypes.c_int64, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_double)
)
#: Each thread takes so many shares of the lanes, one after the other, since some take longer.
SHARES = 8
#: Levels of optimisation: the second takes LLVM five times as long, and runs twice as fast.
QUICK, FAST = 0, 1
#: Time for each line of code that LLVM takes for the second [s].
SECONDS_A_LINE = 6e-5
_begin, _buffer = ctypes.addressof, ctypes.c_char.from_buffer
#: Numbers in a line of the processor's cache.
LINE = 8
#: So many blocks of lanes are one share if one thread runs.
FEW = 64


class Kernel:
    """Machine code of a function of arrays, over many lanes; several threads may call it.

    It is compiled quickly, and once more for speed when it has run about as long as that takes.
    Both give the same values to the bit.

    Args:
        traced: The function.
        lanes: Number of lanes computed side by side; what suits the processor if None.
        contract: Whether a b + c is rounded once on processors that can; without, arithmetic is
            NumPy's to the bit.
        fast: Whether it is compiled for speed at once.

    Attributes:
        lanes: Number of lanes computed side by side.
        stack: Stack that a call of the machine code needs [bytes]: the larger of a bound for code
            that is compiled quickly, the sizes of all values in it, and an estimate for optimised
            code, twice the values alive at once. Functions of the system's library and functions
            outside come on top.
    """

    def __init__(
        self, traced: Traced, lanes: int | None = None, contract: bool = True, fast: bool = False
    ) -> None:
        self.lanes = width() if lanes is None else lanes
        self._inputs, self._numbers = traced.inputs, traced.numbers  # without the expressions,
        self._tables, self._outside = traced.tables, tuple(traced.outside)  # which take memory
        self._single, self._prepared = traced.single, len(traced.shared.written) + 1
        fused = contract and fuses()
        whole = Lanes(traced, self.lanes, fused, optimised=True)
        self._text = text = whole.text()
        self.stack, memory = whole.stack, whole.memory
        level = FAST if fast or is_kept(text, FAST) else QUICK
        if level == QUICK and whole.unshared <= STACK:
            self.stack = whole.unshared
        elif level == QUICK:
            cut = Lanes(traced, self.lanes, fused)
            text = cut.text()
            self.stack, memory = max(self.stack, cut.stack), max(memory, cut.memory)
        self._memory = memory * self.lanes
        self._free: list[tuple[int, Array]] = []
        self._left: float | None = SECONDS_A_LINE * self._text.count("\n")
        self._improving, self._codes = Lock(), list[Code]()
        self._shapes = [o.shape if isinstance(o, Rows) else np.shape(o) for o in traced.outputs]
        self._compile(text, level)
        self._last: tuple[bytes | None, Array, int] = None, np.empty(0), 0

    def __call__(
        self,
        inputs: Mapping[str, Array],
        numbers: Mapping[str, Any] | None = None,
        tables: Mapping[str, Array] | None = None,
        outside: Mapping[str, Callable[..., None]] | None = None,
        *,
        out: Sequence[Array | None] = (),
        threads: int = 1,
    ) -> Any:
        """Compute all lanes.

        Args:
            inputs: (m, *shape) of each input, a row for each lane.
            numbers: What all lanes share.
            tables: (rows, columns) of each table, at least one row.
            outside: Functions outside, called as function(lane, values, results): see `OUTSIDE`.
                The last lanes may be computed twice. When one raises an exception, no other is
                called, and the exception is raised here when all lanes are done.
            out: (m, *shape) arrays to write to, in the order of the outputs; C-contiguous.
            threads: Number of threads.

        Returns:
            (m, *shape) of each output, one array or a tuple, as the function returns them.

        Raises:
            ValueError: An argument is missing, or has another shape.
        """
        W = self.lanes
        given = [_array(inputs, name, shape) for name, shape in self._inputs.items()]
        m = len(given[0]) if given else 1
        for name, values in zip(self._inputs, given, strict=True):
            if len(values) != m:
                raise ValueError(f"{name} has {len(values)} rows, not {m}")
        outputs = self._outputs(m, out)
        looked = [_array(tables, t.name, (t.columns,)) for t in self._tables.values()]
        for name, table in zip(self._tables, looked, strict=True):
            if len(table) == 0:
                raise ValueError(f"{name} has no rows")
        shared = self._shared(numbers)
        if m > 0:
            results = outputs
            if m < W:  # lanes that are left over repeat the last one
                given = [a.take(np.arange(W), axis=0, mode="clip") for a in given]
                results = [np.empty((W, *o.shape[1:])) for o in outputs]
            calls = [_Call(_named(outside, name), m - 1) for name in self._outside]
            arrays = [*given, *results, *looked]
            places = [*map(_address, arrays), *(call.address for call in calls)]
            arguments = array("q", [*places, *(len(a) - 1 for a in arrays)])
            self._in_shares(arguments.buffer_info()[0], shared[2], max(m, W), threads)
            if m < W:
                for place, result in zip(outputs, results, strict=True):
                    place[:] = result[:m]
            for call in calls:
                if call.failure is not None:
                    raise call.failure
        return outputs[0] if self._single else tuple(outputs)

    def _compile(self, text: str, level: int) -> None:
        """Compile a text, or take what is kept."""
        code = Code(text, level)
        self._codes.append(code)  # other threads may still run what was compiled before
        self._prepare = PREPARE(code.address("prepare"))
        self._run = RUN(code.address("run"))
        if level == FAST:
            self._left = None

    def _improve(self, seconds: float) -> None:
        """Compile for speed if it has run long enough, in one thread; the others go on."""
        with self._improving:
            if self._left is None:
                return
            self._left -= seconds
            if self._left > 0.0:
                return
            self._left = None
        self._compile(self._text, FAST)

    def _outputs(self, m: int, out: Sequence[Array | None]) -> list[Array]:
        """Return the arrays that are written to."""
        if len(out) > len(self._shapes):
            raise ValueError(f"out: {len(out)} arrays for {len(self._shapes)} outputs")
        found = []
        for i, (shape, place) in enumerate(zip_longest(self._shapes, out)):
            shape = (m, *shape)
            if place is None:
                place = np.empty(shape)
            elif place.shape != shape or place.dtype != np.float64 or not place.flags.carray:
                given = f"{place.dtype} {place.shape}"
                raise ValueError(f"out[{i}]: {given} is not C-contiguous writeable float64 {shape}")
            found.append(place)
        return found

    def _shared(self, numbers: Mapping[str, Any] | None) -> tuple[bytes | None, Array, int]:
        """Return what all lanes share: the numbers, what is computed of them, and its address."""
        values = []
        for name, shape in self._numbers.items():
            value = np.asarray(_named(numbers, name), dtype=np.float64)
            if value.shape != shape:
                raise ValueError(f"{name}: {value.shape} is not {shape}")
            values.append(value.tobytes())
        given, last = b"".join(values), self._last
        if last[0] != given:  # otherwise it is as it was when this was called last
            shared = np.zeros(self._prepared)
            shared[: len(given) // 8] = np.frombuffer(given)
            self._prepare(_address(shared))
            lanes = np.repeat(shared, self.lanes)
            last = self._last = given, lanes, _address(lanes)
        return last

    def _borrowed(self) -> tuple[int, Array]:
        """Return the address of memory that no other thread uses, on a line of the cache."""
        try:
            return self._free.pop()
        except IndexError:
            memory = np.empty(self._memory + LINE)
            return -(-_address(memory) // (8 * LINE)) * 8 * LINE, memory

    def _in_shares(self, arguments: int, shared: int, rows: int, threads: int) -> None:
        """Run all blocks of lanes; the last one ends with the last row."""
        blocks = -(-rows // self.lanes)
        shares = 1 if threads == 1 and blocks <= FEW else min(blocks, SHARES * threads)

        def run(share: int) -> None:
            begin, end = blocks * share // shares, blocks * (share + 1) // shares
            begun = perf_counter()
            memory = self._borrowed()
            self._run(arguments, shared, memory[0], rows - self.lanes, begin, end)
            self._free.append(memory)
            if self._left is not None:
                self._improve(perf_counter() - begun)

        if threads > 1 and shares > 1:
            with Threads(min(threads, shares)) as pool:
                list(pool.map(run, range(shares)))
        else:
            for share in range(shares):
                run(share)


class _Call:
    """A function outside as machine code calls it.

    Args:
        function: The function.
        last: Number of the last lane.

    Attributes:
        address: Where it is called, as long as this lives.
        failure: The first exception that it raised.
    """

    def __init__(self, function: Callable[..., None], last: int) -> None:
        self.failure: BaseException | None = None
        self._function, self._last = function, last
        self._call = OUTSIDE(self._run)
        self.address = int(ctypes.cast(self._call, ctypes.c_void_p).value or 0)

    def _run(self, lane: int, values: Any, results: Any) -> None:
        if self.failure is None:
            try:
                self._function(min(lane, self._last), values, results)
            except BaseException as failure:
                self.failure = failure
        if self.failure is not None:
            results[0] = 1.0


def _named(arguments: Mapping[str, Any] | None, name: str) -> Any:
    """Return an argument by its name."""
    if arguments is None or name not in arguments:
        raise ValueError(f"{name} is not given")
    return arguments[name]


def _array(arguments: Mapping[str, Any] | None, name: str, shape: tuple[int, ...]) -> Array:
    """Return an argument (m, *shape) as numbers that lie one after the other."""
    found = np.ascontiguousarray(_named(arguments, name), dtype=np.float64)
    if found.shape[1:] != shape:
        raise ValueError(f"{name}: {found.shape} is not ({', '.join(('m', *map(str, shape)))})")
    return found


def _address(values: Array) -> int:
    """Return where the numbers of an array lie, quickly where it is writeable and not empty."""
    try:
        return _begin(_buffer(values.data))
    except (TypeError, ValueError):
        return int(values.__array_interface__["data"][0])


def compiled(
    function: Callable[..., Any],
    inputs: Mapping[str, tuple[int, ...]],
    numbers: Mapping[str, tuple[int, ...]] | None = None,
    tables: Mapping[str, int] | None = None,
    outside: Mapping[str, int] | None = None,
    *,
    lanes: int | None = None,
    contract: bool = True,
    fast: bool = False,
) -> Kernel:
    """Trace a function and compile it; see `symbols.trace` and `Kernel`."""
    collects = gc.isenabled()
    gc.disable()  # all expressions live until the end; looking for others takes a tenth more
    try:
        return Kernel(trace(function, inputs, numbers, tables, outside), lanes, contract, fast)
    finally:
        if collects:
            gc.enable()
