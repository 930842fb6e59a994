"""The servo as C, compiled as strictly as can be, beside the servo itself."""

import ctypes
import subprocess

import numpy as np
import pytest
from helpers.c_compiler import COMPILER, NUMBERS, STRICT, compiled_code

import spacearm as sa
from spacearm.equations import servo as ticks
from spacearm.equations.servo import Memory, Seen, Tick, packed

DT = 0.01
DRIVER = """
void many(int m, const double *given, double *found);
void many(int m, const double *given, double *found)
{
    const int seen = (int)(sizeof(NAME_servo_seen) / sizeof(double));
    const int memory = (int)(sizeof(NAME_servo_memory) / sizeof(double));
    const int tick = (int)(sizeof(NAME_servo_tick) / sizeof(double));
    int i;
    for (i = 0; i < m; i++) {
        NAME_servo_memory after = *(const NAME_servo_memory *)(given + seen);
        NAME_servo_step((const NAME_servo_seen *)given, &NAME_servo_nominal, &after,
                        (NAME_servo_tick *)found);
        *(NAME_servo_memory *)(found + tick) = after;
        given += seen + memory;
        found += tick + memory;
    }
}
"""


class Code:
    """A servo and its C code, compiled."""

    def __init__(self, servo, folder):
        header, source = sa.to_c(servo.arm, folder, servo=servo, mode=servo.mode)
        driver, shared = folder / "driver.c", folder / "servo.so"
        text = f'#include "{header.name}"\n' + DRIVER.replace("NAME", header.stem)
        driver.write_text(text, encoding="utf-8")
        command = [
            COMPILER,
            *STRICT,
            "-O1",
            "-shared",
            "-fPIC",
            source,
            driver,
            "-o",
            shared,
            "-lm",
        ]
        subprocess.run(command, check=True)
        self.servo, self.header, self.library = servo, header, ctypes.CDLL(str(shared))
        self.library.many.argtypes = [ctypes.c_int, NUMBERS, NUMBERS]
        self.n, self.tips = servo.arm.n, len(servo.arm.tips)
        self.tick = ticks.size(Tick, self.n, self.tips)

    def __call__(self, given):
        found = np.empty((len(given), self.tick + ticks.size(Memory, self.n, self.tips)))
        self.library.many(len(given), np.ascontiguousarray(given), found)
        return found

    def begun(self, q):
        """The memory of `NAME_servo_begin`."""
        memory = np.full(ticks.size(Memory, self.n, self.tips), np.nan)
        function = getattr(self.library, f"{self.header.stem}_servo_begin")
        function.argtypes, function.restype = [NUMBERS, NUMBERS], None
        function(np.asarray(q, dtype=float), memory)
        return memory


def compared(code, flights, steps, tick=DT):
    """Fly with random twists and broken input now and then; compare each step, from one memory."""
    servo, rng, n, size = code.servo, np.random.default_rng(0), code.n, 6 * code.tips
    memory, q = [], rng.uniform(-2.0, 2.0, (flights, n))
    for i, one in enumerate(q):
        if i < 8:
            servo.start((one, [0, 0, 0, 1]))
            memory.append(packed(servo.memory))
        else:
            memory.append(packed(ticks.unknowing(n, one)))
    memory, turn = np.array(memory), rng.normal(size=(flights, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    A, P, halted = 0.2 * rng.normal(size=(flights, size)), rng.uniform(0, 6, (flights, 1)), 0
    for i in range(steps):
        twist, dt, h = A * np.sin(0.02 * i + P), np.full((flights, 1), tick), np.zeros((flights, 6))
        seen = np.concatenate(Seen(q, turn, twist, dt, h), axis=1)
        broken = rng.random(flights) < 0.002
        column = rng.integers(0, seen.shape[1], flights)
        bad = rng.choice([np.nan, np.inf, -np.inf, 1e300, -1.0, 0.0, 5.0], flights)
        seen[broken, column[broken]] = bad[broken]
        given = np.concatenate((seen, memory), axis=1)
        found = code(given)
        wanted = servo._kernel({"given": given}, servo._numbers)
        halted += (wanted[:, code.tick - 1] > 0.0).sum()
        np.testing.assert_array_equal(found[:, code.tick - 1], wanted[:, code.tick - 1])
        # the last digit of what is given may count for more: where it is guessed anew or not
        last = (-1.0) ** np.arange(given.shape[1]) * np.finfo(float).eps
        other = servo._kernel({"given": given * (1.0 + last)}, servo._numbers)
        slack = 1e-9 + 8.0 * np.abs(other[:, :n] - wanted[:, :n])
        assert (np.abs(found[:, :n] - wanted[:, :n]) <= slack).all()
        assert (slack < 1e-8).mean() > 0.9
        q, memory = q + tick * wanted[:, :n], wanted[:, code.tick :]
    assert halted > 0
    return wanted


@compiled_code
@pytest.mark.slow
def test_a_million_steps_are_those_of_the_servo(tmp_path):
    servo = sa.Servo(sa.load("planar2"), rates=0.8, accelerations=2.0)
    code = Code(servo, tmp_path)
    assert "operations" in code.header.read_text(encoding="utf-8")
    np.testing.assert_array_equal(code.begun([0.3, 1.2]), packed(ticks.unknowing(2, [0.3, 1.2])))
    compared(code, 2000, 500)


@compiled_code
@pytest.mark.slow
def test_options_are_compiled_in(tmp_path):
    arm = sa.load("planar3")
    servo = sa.Servo(arm, rates=0.5, accelerations=1.0, mode="attitude-controlled", wheels=2.0,
                     frame="tip")  # fmt: skip
    compared(Code(servo, tmp_path), 50, 100, tick=0.1)  # in which the search has many parts


@compiled_code
@pytest.mark.slow
def test_steps_of_no_length_and_numbers_that_are_not_finite_halt_it(tmp_path):
    servo = sa.Servo(sa.load("planar2"), rates=0.8, accelerations=2.0)
    code = Code(servo, tmp_path)
    servo.start(([0.3, 1.2], [0, 0, 0, 1]))
    memory = packed(servo.memory)
    for dt, broken, halt in ((1e-308, False, "dt"), (DT, True, "numbers"), (DT, False, "")):
        seen = packed(Seen([0.3, 1.2], [0, 0, 0, 1], [0.1, 0, 0, 0, 0, 0], dt, np.zeros(6)))
        given = np.concatenate((seen, memory))
        if broken:
            given[len(seen) + 2 : len(seen) + 4] = np.nan  # the rates that were wished
        found = code(given[None])[0]
        assert ticks.HALTS[int(found[code.tick - 1])] == halt
        assert np.isfinite(found[:2]).all()
        assert np.isfinite(found[code.tick :]).all()


def test_a_servo_of_another_arm_is_refused(tmp_path):
    servo = sa.Servo(sa.load("planar3"))
    with pytest.raises(sa.ConfigurationError, match="planar3"):
        sa.to_c(sa.load("planar2"), tmp_path, servo=servo)
    assert not list(tmp_path.iterdir())
