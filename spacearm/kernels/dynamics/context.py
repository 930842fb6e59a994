"""The context of a run: one record with all that its compiled functions read and write.

Compiled functions pass it to each other by its address, and take from it views of the arrays whose
sizes differ from arm to arm; `memory.Memory` owns
these arrays.

The state of a run is one array y: positions q (n) and rates dq (n) of the joints, the spacecraft's
attitude as a quaternion xyzw, the system CM (3) [m], the momentum [linear; angular about the system
CM] (6) in inertial axes, the work (4) of torques, passive joints, wrenches and wheels [J], and what
each wheel holds (w) [N m s].
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, TypeAlias

import numpy as np
from numba import types

from spacearm.kernels.dynamics.calls import inline
from spacearm.kernels.dynamics.masses import SWUNG, WHOLE, Moving
from spacearm.kernels.floating import BODY, Bodies, Indices, Numbers
from spacearm.kernels.lanes import Record, record, step

carray: Any = import_module("numba").carray  # typed in part only

FRAME = record(
    ("body", np.int64),  # body that it is fixed to
    ("p", np.float64, 3),  # its origin in the frame of that body [m]
    ("R", np.float64, (3, 3)),  # its attitude in that frame
    ("own", np.int64),  # whether a wrench on it is along its own axes, not the inertial ones
)
"""A tip, or another frame of the arm."""

WHEEL = record(
    ("body", np.int64),  # body that carries it
    ("axis", np.float64, 3),  # in the frame of that body
    ("torque", np.float64),  # largest torque of its motor [N m]
    ("capacity", np.float64),  # largest momentum that it holds [N m s]
    ("spread", np.float64, 3),  # its share of a torque on the spacecraft
    ("rate", np.float64),  # of what it holds [N m]
)
"""A wheel."""

LAW = record(
    ("kind", np.int64),  # one of those in `laws`
    ("entry", np.int64),  # address of its function
    ("f", np.int64),  # free components of the spacecraft's twist that the law assumes
    ("tip", np.int64),  # tip that it leads
    ("k", np.int64),  # number of task rows
    ("rows", np.int64, 6),  # the rows
    ("scale", np.float64, 6),  # their factors
    ("axis", np.int64),  # normal that goal axes tilt with; -1 for the inertial axes
    ("pose", np.int64),  # whether the target is a pose; of a law outside whether it sees J*
    ("moving", np.int64),  # address of the target as a function of time; 0 for a fixed one
    ("call", np.int64),  # address of the law itself, if it is none of those here; else 0
    ("servo", np.float64),
    ("damping", np.float64),
    ("threshold", np.float64),
    ("rests", np.int64),  # whether a redundant arm tends to its posture of rest
    ("least", np.float64),  # share of sigma_max below which J* has no inverse
)
"""A control law; what has one number for each joint or row stands in `LAW_ARRAYS`."""

EVENT = record(
    ("kind", np.int64),  # one of those in `events`
    ("entry", np.int64),  # address of its function
    ("index", np.int64),  # joint, law or wheel
    ("bound", np.float64),
    ("falling", np.int64),  # whether only a fall through zero counts
    ("stops", np.int64),  # whether it ends the run
    ("call", np.int64),  # address of its function, if it is outside
    ("last", np.float64),  # its function at the last look
    ("now", np.float64),
)
"""A function of time and state whose root is an event."""

FOUND = record(("t", np.float64), ("which", np.int64))
"""An event that was found."""

KP, KD, TARGET, REST, ACTS = range(5)
"""Rows of the arrays of a law: gains, target (joint positions, a point, or position and attitude of
a pose), posture of rest, share of the torque that each joint takes (1 or 0)."""
STIFFNESS, RELAXED, DAMPING, FRICTION, SLIP, EFFORT, SPEED = range(7)
"""Rows of the array of joints: spring [N m/rad], where it is at rest [rad], viscous [N m s/rad] and
dry friction [N m], the rate [rad/s] at which that is tanh(1) of its value, largest torque [N m] and
rate [rad/s]."""

WORKS = 4
"""Works in the state: of torques, passive joints, wrenches, wheels."""
ROOM = 256
"""Events that a run keeps before they are taken from it."""
PACE = 1000
"""Number of steps over which progress is watched."""

ARRAYS: dict[str, tuple[str, ...]] = {
    "b": ("N+1",), "offsets": ("N",), "joints": ("7", "n"),
    "tip": ("tips",), "rows": ("k",), "scale": ("k",),
    "wheel": ("wheels",), "asked": ("wheels",), "pushed": ("pushes",), "push": ("pushes", "6"),
    "law": ("laws",), "of_law": ("laws", "5", "size"),
    "body": ("N+1",), "whole": ("1",), "angle": ("3", "N"),
    "H": ("n", "n"), "D_q": ("n", "3"), "P": ("n", "3"), "X": ("n", "3"),
    "c": ("n",), "force": ("n",), "ddq": ("n",), "dq": ("n",),
    "at": ("tips", "3"), "turned": ("tips", "3", "3"), "J": ("6*tips", "n"),
    "task": ("6", "n"), "V": ("3", "n"), "tau": ("n",), "one": ("n",), "held": ("n",),
    "goal": ("3", "size"), "error": ("2", "6"), "seen": ("states+30+6*n",),
    "y": ("states",), "f_y": ("states",), "before": ("states",), "mid": ("states",),
    "K": ("16", "states"), "F": ("7", "states"), "Z": ("3", "states"), "W": ("3", "states"),
    "G": ("3", "states"), "jacobian": ("states", "states"), "real": ("states", "states"),
    "complex": ("states", "states"), "order": ("2", "states"), "solution": ("states",),
    "t_out": ("outputs",), "y_out": ("outputs", "states"), "pace": ("1000",),
    "observed": ("outputs", "n+21"), "event": ("events",), "found": ("256",),
    "q_found": ("256", "n"), "look": ("k", "n"), "look_U": ("k", "k"), "look_sigma": ("k",),
    "look_V": ("n", "n"), "look_L": ("n+1", "2*n"), "look_u": ("k",), "look_y": ("states",),
    "look_q": ("n",),
    "radian": ("n",),
}  # fmt: skip
"""The arrays and their shapes, which depend on the sizes of an arm."""

KINDS: dict[str, Any] = {
    "b": BODY, "tip": FRAME, "pushed": FRAME, "wheel": WHEEL, "law": LAW, "event": EVENT,
    "found": FOUND, "body": SWUNG, "whole": WHOLE,
    "rows": np.int64, "order": np.int64, "complex": np.complex128, "solution": np.complex128,
}  # fmt: skip
"""Types of those that are not plain numbers."""

SIZES = ("n", "N", "tips", "k", "wheels", "pushes", "laws", "size", "states", "outputs", "events")

CONTEXT = record(
    *((name, np.int64) for name in SIZES),
    *((f"_{name}", np.int64) for name in ARRAYS),  # addresses
    ("here", np.int64),  # address of the context itself
    ("settle", np.int64),  # addresses of functions: see `calls.jump`
    ("bias", np.int64),
    ("torques", np.int64),
    ("rate", np.int64),
    ("aim", np.int64),
    ("push", np.int64),
    ("spin", np.int64),
    ("balance", np.int64),
    ("explicit", np.int64),
    ("polynomial", np.int64),
    ("implicit_step", np.int64),  # 0 until it is wanted, as the next
    ("implicit_state", np.int64),
    ("look", np.int64),
    ("f", np.int64),  # free components of the spacecraft's twist: 6, 3 or 0
    ("wrench", np.int64),  # address of the wrenches as a function of time; 0 for none
    ("motor", np.int64),  # that of the torques of the wheels, likewise
    ("holds", np.int64),  # whether the wheels hold the attitude `level`
    ("stiffness", np.float64),  # of their law [N m/rad]
    ("damping", np.float64),  # likewise [N m s/rad]
    ("level", np.float64, (3, 3)),
    ("base", np.float64, 3),  # position of the spacecraft, where it is fixed [m]
    ("R", np.float64, (3, 3)),  # attitude of the spacecraft
    ("A", np.float64, (3, 3)),  # goal axes
    ("U", np.float64, (6, 6)),  # of a singular value decomposition
    ("sigma", np.float64, 6),
    ("t", np.float64),  # time [s]
    ("began", np.float64),  # time at which the last step began [s]
    ("end", np.float64),  # when to stop [s]
    ("step", np.float64),  # length of the next step [s]
    ("rtol", np.float64),
    ("atol", np.float64),
    ("last_step", np.float64),  # Radau: step and error before, for its prediction of the next
    ("last_error", np.float64),
    ("eigenvalue", np.float64),  # that limits steps of DOP853 and RKC [1/s]
    ("exchanged", np.float64),  # work done and taken back [J]
    ("counted", np.float64),  # number of components that errors are averaged over
    ("coupled", np.int64),  # leading components of the state that its rate depends on
    ("switches", np.int64),  # whether the method may change
    ("implicit", np.int64),  # the method: 0 DOP853, 1 that of `implicit_step`
    ("mild", np.int64),  # whether that is RKC, else Radau
    ("stages", np.int64),  # of the last step of RKC
    ("cubic", np.int64),  # whether that of `implicit_step` took the last step
    ("dense", np.int64),  # whether the polynomial of the last step is known
    ("stiff", np.int64),  # DOP853 and RKC: steps that look stiff; Radau: steps that do not
    ("calm", np.int64),  # steps until stiffness counts again
    ("patience", np.int64),  # how many there were the last time
    ("known", np.int64),  # Jacobian or eigenvalue 0 unknown, 1 of an earlier state, 2 of this one
    ("factored", np.int64),  # Radau: whether the factors belong to the step
    ("steps", np.int64),
    ("rates", np.int64),  # number of evaluations of the rate
    ("written", np.int64),  # outputs written
    ("happened", np.int64),  # events found
    ("looked", np.int64),  # whether the distance to the singular set is known, at `look_q`
    ("stopped", np.int64),  # number of the event that ended the run; -1 for none
)
"""All that a run reads and writes."""

Context: TypeAlias = Record
"""A record CONTEXT."""


@inline
def pointer(_: Any, _address: Any) -> Any:
    """Return an address as a pointer."""

    def code(context: Any, builder: Any, _: Any, values: Any) -> Any:
        return builder.inttoptr(values[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), code


@step
def vec(address: int, n: int) -> Numbers:
    """Return the n numbers at an address."""
    return carray(pointer(address), (n,), np.float64)


@step
def mat(address: int, n: int, m: int) -> Numbers:
    """Return the (n, m) numbers at an address."""
    return carray(pointer(address), (n, m), np.float64)


@step
def cube(address: int, n: int, m: int, k: int) -> Numbers:
    """Return the (n, m, k) numbers at an address."""
    return carray(pointer(address), (n, m, k), np.float64)


@step
def whole_numbers(address: int, n: int, m: int) -> Indices:
    """Return the (n, m) whole numbers at an address."""
    return carray(pointer(address), (n, m), np.int64)


@step
def context_at(address: int) -> Context:
    """Return the context at an address."""
    return carray(pointer(address), (1,), CONTEXT)[0]


@step
def bodies_of(x: Context) -> Bodies:
    """Return the bodies."""
    return carray(pointer(x._b), (x.N + 1,), BODY)


@step
def frame_of(x: Context, i: int) -> Record:
    """Return a tip."""
    return carray(pointer(x._tip), (x.tips,), FRAME)[i]


@step
def pushed_of(x: Context, i: int) -> Record:
    """Return a frame that a wrench acts on."""
    return carray(pointer(x._pushed), (x.pushes,), FRAME)[i]


@step
def wheel_of(x: Context, i: int) -> Record:
    """Return a wheel."""
    return carray(pointer(x._wheel), (x.wheels,), WHEEL)[i]


@step
def law_of(x: Context, i: int) -> Record:
    """Return a control law."""
    return carray(pointer(x._law), (x.laws,), LAW)[i]


@step
def event_of(x: Context, i: int) -> Record:
    """Return an event function."""
    return carray(pointer(x._event), (x.events,), EVENT)[i]


@step
def found_of(x: Context, i: int) -> Record:
    """Return an event that was found."""
    return carray(pointer(x._found), (ROOM,), FOUND)[i]


@step
def moving_of(x: Context) -> Moving:
    """Return the work arrays of the equations of motion."""
    n = x.n
    return Moving(
        carray(pointer(x._body), (x.N + 1,), SWUNG),
        carray(pointer(x._whole), (1,), WHOLE),
        mat(x._angle, 3, x.N),
        mat(x._H, n, n),
        mat(x._D_q, n, 3),
        mat(x._P, n, 3),
        mat(x._X, n, 3),
        vec(x._c, n),
        vec(x._force, n),
        vec(x._ddq, n),
    )
