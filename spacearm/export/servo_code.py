"""The servo as C99: structs of what it is told, keeps, remembers and says, and a step."""

from __future__ import annotations

from string import Template
from typing import Any

import numpy as np

from spacearm.compiler import symbols
from spacearm.compiler.c_code import Code, number, operations
from spacearm.compiler.symbols import trace
from spacearm.equations import servo as ticks
from spacearm.equations.kinematics import Parameters, Structure
from spacearm.equations.servo import (
    CAUSES,
    HALTS,
    Limits,
    Memory,
    Seen,
    Tick,
    packed,
    shapes,
    unpacked,
)
from spacearm.servo.servo import Servo

STRUCTS = {"seen": Seen, "limits": Limits, "memory": Memory, "tick": Tick}
"""The structs by what their names end with."""
TAKEN = ("seen", "limits", "memory")
"""Those that a step reads."""


def servo_code(
    code: Code, name: str, tree: Structure, numbers: Parameters, servo: Servo
) -> tuple[str, str]:
    """Return declarations and definitions of a servo as C.

    Args:
        code: Takes the functions of its parts.
        name: What all names begin with.
        tree: The structure of the arm.
        numbers: Its numbers, as arrays of objects.
        servo: The servo, whose options are compiled in and whose limits are a constant.
    """
    n, tips = tree.n, len(tree.tips)

    def step(**given: Any) -> Any:
        seen, limits, memory = (
            unpacked(STRUCTS[ending], given[ending], n, tips) for ending in TAKEN
        )
        tick, memory = ticks.step(
            symbols, tree, numbers, seen, limits, memory, servo.frame, servo.keep_attitude
        )
        return packed((*tick, *memory), symbols)

    traced = trace(step, {ending: (ticks.size(STRUCTS[ending], n, tips),) for ending in TAKEN})
    inputs = [
        text for ending in TAKEN for text in _elements(STRUCTS[ending], f"{ending}->", n, tips)
    ]
    outputs = [*_elements(Tick, "tick->", n, tips), *_elements(Memory, "next.", n, tips)]
    body = code.body(traced, inputs, outputs)
    start = [
        f"    memory->{place} = {f'q[{i}]' if which == 'q' else number(value)};"
        for which, values in ticks.unknowing(n, np.zeros(n))._asdict().items()
        for i, (place, value) in enumerate(
            zip(_places(which, np.shape(values)), np.ravel(values), strict=True)
        )
    ]
    structs = (_struct(name, ending, kind, n, tips) for ending, kind in STRUCTS.items())
    words = {
        "name": name, "N": str(n), "body": body, "start": "\n".join(start),
        "operations": f"{operations(traced):,}", "structs": "\n".join(structs),
        "values": ",\n".join(f"    {_initialiser(value)}" for value in servo.limits),
        "frame": servo.frame, "causes": ", ".join(CAUSES),
        "halts": ", ".join(f"{i} {halt}" for i, halt in enumerate(HALTS) if halt),
    }  # fmt: skip
    return DECLARATIONS.substitute(words), DEFINITIONS.substitute(words)


def _places(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the elements of a field as C, one after the other."""
    return [name + "".join(f"[{i}]" for i in index) for index in np.ndindex(shape)]


def _elements(kind: Any, before: str, n: int, tips: int) -> list[str]:
    """Return the elements of a struct as C, in the order of `packed`."""
    return [
        before + place
        for name, shape in shapes(kind, n, tips).items()
        for place in _places(name, shape)
    ]


def _struct(name: str, ending: str, kind: Any, n: int, tips: int) -> str:
    """Return the declaration of a struct."""
    fields = (
        f"    double {field}{''.join(f'[{size}]' for size in shape)};"
        for field, shape in shapes(kind, n, tips).items()
    )
    return "typedef struct {\n" + "\n".join(fields) + f"\n}} {name}_servo_{ending};\n"


def _initialiser(value: Any) -> str:
    """Return a number, or numbers, as C initialises a field."""
    return f"{{{', '.join(map(number, value))}}}" if np.ndim(value) else number(float(value))


DECLARATIONS = Template("""\
/* The servo: what it is told, what it keeps, what it remembers, what it says. SI units, radians;
 * the twist in axes of: $frame. shares[] is what each of these leaves of the motion: $causes.
 * halt is 0, or why the arm is brought to rest: $halts. */
$structs
extern const ${name}_servo_limits ${name}_servo_nominal; /* what it keeps unless told otherwise */

/* At rest at q; it searches before it moves. */
void ${name}_servo_begin(const double q[$N], ${name}_servo_memory *memory);

/* A step: tick->rates are the joint rates until the next. At most $operations operations. */
void ${name}_servo_step(const ${name}_servo_seen *seen, const ${name}_servo_limits *limits,
                        ${name}_servo_memory *memory, ${name}_servo_tick *tick);
""")

DEFINITIONS = Template("""\
const ${name}_servo_limits ${name}_servo_nominal = {
$values
};

void ${name}_servo_begin(const double q[$N], ${name}_servo_memory *memory)
{
$start
}

void ${name}_servo_step(const ${name}_servo_seen *seen, const ${name}_servo_limits *limits,
                        ${name}_servo_memory *memory, ${name}_servo_tick *tick)
{
    ${name}_servo_memory next;
$body
    *memory = next;
}
""")
