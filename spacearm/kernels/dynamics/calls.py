"""Calls of functions outside: those that numba compiled, and Python's through ctypes.

Those from outside have the signature status = function(t, x, out) with addresses of numbers that
they read and write; a status other than 0 ends the run. The functions are known by their own
addresses, so that one compiled integrator serves them all.

The kernels of this folder call each other in the same way where that saves compile time: numba
links whatever a function calls into it and optimises it all again.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cached_property
from importlib import import_module
from typing import Any

import numba
import numpy as np
from numba.core import types
from numba.extending import intrinsic

from spacearm.arrays import Array
from spacearm.kernels.kept import keep
from spacearm.kernels.lanes import SETTINGS, Record, step

inline: Any = intrinsic  # typed in part only
CFunc: Any = import_module("numba.core.ccallback").CFunc
ir: Any = import_module("llvmlite.ir")

SAID = "simulation, about 30 s"
"""What is said when they are compiled, for all that the first run needs."""
SIGNATURE = "int64(float64, CPointer(float64), CPointer(float64))"
OUTSIDE: Any = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p)


@inline
def call(_: Any, _address: Any, _t: Any, _x: Any, _out: Any) -> Any:
    """Call the function at an address; x and out are addresses as well."""

    def code(_: Any, builder: Any, __: Any, values: Any) -> Any:
        pointer = ir.DoubleType().as_pointer()
        kind = ir.FunctionType(ir.IntType(64), [ir.DoubleType(), pointer, pointer])
        function = builder.inttoptr(values[0], kind.as_pointer())
        return builder.call(
            function,
            [values[1], builder.inttoptr(values[2], pointer), builder.inttoptr(values[3], pointer)],
        )

    return types.int64(types.intp, types.float64, types.intp, types.intp), code


@inline
def jump(_: Any, _address: Any, _context: Any, _t: Any, _y: Any, _dy: Any) -> Any:
    """Call the `entry` at an address."""

    def code(_: Any, builder: Any, __: Any, values: Any) -> Any:
        whole, real = ir.IntType(64), ir.DoubleType()
        kind = ir.FunctionType(whole, [whole, real, whole, whole])
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), list(values[1:]))

    whole = types.int64
    return whole(whole, whole, types.float64, whole, whole), code


@step
def rate_at(x: Record, t: float, y: Array, dy: Array) -> int:
    """Compute the rate dy of a state y of a context by its function `rate`."""
    return int(jump(x.rate, x.here, t, y.ctypes.data, dy.ctypes.data))


class Entry:
    """A function that compiled code calls by its address, compiled when that is asked for.

    Args:
        source: A function (address of a context, t, address of y, address of dy) -> status.
    """

    def __init__(self, source: Callable[..., Any]) -> None:
        self.source = source

    @cached_property
    def compiled(self) -> Any:
        """The compiled function, kept on disk."""
        signature = types.int64(types.int64, types.float64, types.int64, types.int64)
        kernel = CFunc(self.source, (signature.args, signature.return_type), {}, SETTINGS)
        keep(kernel, SAID).compile()
        return kernel

    @cached_property
    def address(self) -> int:
        """Its address."""
        return int(self.compiled.address)


def compiled(source: Callable[..., Any]) -> Any:
    """Compile a function (t, x, out) -> status; keep what is returned as long as it is called."""
    return numba.cfunc(SIGNATURE)(source)


def outside(function: Callable[[float, Array, Array], object], reads: int, writes: int) -> Any:
    """Return a function in Python as one that compiled code can call; keep what is returned.

    Args:
        function: Called as function(t, x, out); returns what is true if it failed, must not raise.
        reads: Size of x, which it must not change or keep.
        writes: Size of out.
    """
    pointer = ctypes.POINTER(ctypes.c_double)
    views: dict[int, Array] = {}

    def view(address: int, size: int) -> Array:
        if address not in views:
            views[address] = np.ctypeslib.as_array(ctypes.cast(address, pointer), (size,))
        return views[address]

    def run(t: float, x: int, out: int) -> int:
        return int(bool(function(t, view(x, reads), view(out, writes))))

    return OUTSIDE(run)


def address(function: Any) -> int:
    """Return the address of what `compiled` or `outside` returned; 0 for None."""
    if function is None:
        return 0
    if hasattr(function, "address"):
        return int(function.address)
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)
