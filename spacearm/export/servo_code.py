"""The servo as C99: structs of what it is told, keeps, remembers and says, and a step."""

from __future__ import annotations

from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from spacearm.compiler import symbols
from spacearm.compiler.c_code import Code, elements, fields, initialiser, number, operations
from spacearm.compiler.symbols import trace
from spacearm.equations import servo as ticks
from spacearm.equations.kinematics import Parameters, Structure
from spacearm.equations.servo import Limits, Memory, Seen, Tick, packed, shapes, unpacked
from spacearm.servo.servo import Servo

#: The structs by what their names end with.
STRUCTS = {"seen": Seen, "limits": Limits, "memory": Memory, "tick": Tick}
#: Those that a step reads.
TAKEN = ("seen", "limits", "memory")


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
        seen, limits, memory = (unpacked(STRUCTS[x], given[x], n, tips) for x in TAKEN)
        tick, memory = ticks.step(
            symbols, tree, numbers, seen, limits, memory, servo.frame, servo.keep_attitude
        )
        return packed((*tick, *memory), symbols)

    traced = trace(step, {ending: (ticks.size(STRUCTS[ending], n, tips),) for ending in TAKEN})
    known = {ending: shapes(kind, n, tips) for ending, kind in STRUCTS.items()}
    inputs = [text for ending in TAKEN for text in elements(known[ending], f"{ending}->")]
    outputs = [*elements(known["tick"], "tick->"), *elements(known["memory"], "next.")]
    body = code.body(traced, inputs, outputs)
    values = map(number, packed(ticks.unknowing(n, np.zeros(n))))
    start = dict(zip(elements(known["memory"]), values, strict=True))
    start |= {f"q[{i}]": f"q[{i}]" for i in range(n)}
    structs = (
        f"typedef struct {{\n{fields(of)}\n}} {name}_servo_{ending};\n"
        for ending, of in known.items()
    )
    words = {
        "name": name, "N": str(n), "body": body,
        "start": "\n".join(f"    memory->{place} = {x};" for place, x in start.items()),
        "operations": f"{operations(traced):,}", "structs": "\n".join(structs),
        "values": ",\n".join(f"    {initialiser(value)}" for value in servo.limits),
        "frame": servo.frame, "causes": ", ".join(ticks.CAUSES),
        "halts": ", ".join(f"{i} {halt}" for i, halt in enumerate(ticks.HALTS) if halt),
    }  # fmt: skip
    return template("servo.h").substitute(words), template("servo.c").substitute(words)


def template(name: str) -> Template:
    """Return a text of the folder c, in which words with a dollar sign stand for others."""
    return Template(Path(__file__).with_name("c").joinpath(name).read_text(encoding="utf-8"))
