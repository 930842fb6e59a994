"""Machine code needs no more stack than its kernel says, however long a function is."""

import os
import re
import subprocess
import sys
from pathlib import Path

import llvmlite.binding as llvm
import numpy as np
import pytest
from helpers.arms import load_text
from helpers.assembly import stacks
from helpers.long_arms import SCRIPT, in_a_row

import spacearm as sa
from spacearm.compiler import expressions, kernel, lanes, symbols
from spacearm.compiler.kernel import compiled
from spacearm.compiler.symbols import while_any
from spacearm.errors import UnsupportedError
from spacearm.mechanics import arm_kernels, distance, floating

PROCESSORS = [("x86_64-unknown-linux-gnu", cpu) for cpu in ("x86-64", "haswell", "skylake-avx512")]
PROCESSORS += [("aarch64-unknown-linux-gnu", "generic"), ("arm64-apple-darwin", "apple-m1")]


@pytest.fixture(scope="module", autouse=True)
def targets():
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()


def everything(x, u):
    """Use all that has values on the way: masks, tables of signs, loops, angles, branches."""
    for turn in range(8):
        angle = x * (1.0 + turn) + u
        x = np.where(np.sin(angle) > 0.3 * u, np.cos(angle), np.minimum(x, np.floor(x * u)))
        x = np.maximum(np.exp(-x * x), np.arctan2(x, u)) + np.rint(x)

    def step(y, z):
        y = y - 0.5 * np.sin(y)
        return y, z + y, (y * y).sum() > 1e-3

    y, z = while_any(step, x, 0.0 * x, most=9)
    return x, y + z, np.abs(z) > 1.0


def text_of(function, width, optimised, **shapes):
    written = lanes.Lanes(symbols.trace(function, **shapes), width, True, optimised)
    return written.text(), written.stack


def machine_of(triple, cpu, level):
    target = llvm.Target.from_triple(triple)
    return target.create_target_machine(cpu=cpu, opt=level, codemodel="jitdefault")


@pytest.mark.slow
@pytest.mark.parametrize("width", [1, 2, 4, 8])
@pytest.mark.parametrize(("triple", "cpu"), PROCESSORS)
def test_the_bound_is_one_on_every_processor(width, triple, cpu):
    check_bound(width, triple, cpu)


@pytest.mark.parametrize(("triple", "cpu"), [PROCESSORS[1], PROCESSORS[-1]])
def test_the_bound_is_one(triple, cpu):
    check_bound(4, triple, cpu)


def check_bound(width, triple, cpu):
    for level in (kernel.QUICK, kernel.FAST):
        optimised = level == kernel.FAST
        text, bound = text_of(everything, width, optimised, inputs={"x": (6,)}, numbers={"u": ()})
        found = stacks(text, machine_of(triple, cpu, level))
        assert 64 < max(found["run"], found["prepare"]) <= bound <= lanes.STACK


@pytest.mark.parametrize(("cpu", "bytes_"), [("haswell", 32), ("skylake-avx512", 64)])
def test_vectors_lie_aligned_on_the_stack(cpu, bytes_):
    text, _ = text_of(lambda x: np.sin(x)[::-1] * x, bytes_ // 8, True, inputs={"x": (40,)})
    assembly = machine_of(PROCESSORS[0][0], cpu, kernel.FAST).emit_assembly(
        llvm.parse_assembly(text)
    )
    run = assembly[assembly.index("\nrun:") :]
    assert re.search(r"\(%rsp\), %[yz]mm|%[yz]mm\d+, \d*\(%rsp\)", run)
    assert f"andq\t$-{bytes_}, %rsp" in run


@pytest.mark.slow
@pytest.mark.parametrize("n", [3, 7, 10])
def test_kernels_of_arms_need_no_more_than_their_bound(n, monkeypatch, tmp_path):
    monkeypatch.setenv("SPACEARM_CACHE", str(tmp_path))
    made, quick = [], []
    whole = kernel.Kernel._compile

    def noted(self, text, level):
        if level == kernel.QUICK:
            made.append(self)
            quick.append(text)
        whole(self, text, level)

    monkeypatch.setattr(kernel.Kernel, "_compile", noted)
    arm_kernels._compiled.cache_clear()
    arm = sa.load("chaser7") if n == 7 else load_text(in_a_row(n))
    Q = np.random.default_rng(0).uniform(-3, 3, (50, n))
    if n >= arm.task.k:
        distance.linearise(arm, Q)
        sa.evaluate(arm, Q)
    sa.joint_accelerations(arm, Q, Q, Q)
    floating.turns_and_effects(arm, np.stack([Q, Q], axis=1), np.stack([Q, Q], axis=1), Q[:, 0])
    assert len(made) >= 2
    for each, text in zip(made, quick, strict=True):
        assert each.stack <= lanes.STACK
        slow = machine_of(*PROCESSORS[2], kernel.QUICK)
        assert max(stacks(text, slow).values()) <= each.stack
        for triple, cpu in (PROCESSORS[2], PROCESSORS[-1]):
            fast = machine_of(triple, cpu, kernel.FAST)
            assert max(stacks(each._text, fast).values()) <= each.stack


def test_optimised_kernels_of_an_arm_are_not_cut():
    arm, known = sa.load("chaser7"), {"fading": (), "radians": (7,)}

    def near(q, fading, radians):
        tree, p = arm_kernels.structure_of(arm), arm_kernels.parameters_of(arm)
        return distance.distance(symbols, tree, p, q=q, fading=fading, radians=radians)

    shapes = {"inputs": {"q": (7,)}, "numbers": known}
    cut, _ = text_of(near, 8, False, **shapes)
    whole, _ = text_of(near, 8, True, **shapes)
    assert "@lanes_0" in cut
    assert "@lanes_0" not in whole


def test_optimised_code_computes_the_same_to_the_bit(monkeypatch, tmp_path):
    monkeypatch.setenv("SPACEARM_CACHE", str(tmp_path))
    x, u = np.random.default_rng(0).uniform(-2, 2, (11, 6)), {"u": 0.7}
    monkeypatch.setattr(kernel, "STACK", 0)
    monkeypatch.setattr(lanes, "SECTION", 2000)
    monkeypatch.setattr(kernel, "SECONDS_A_LINE", 1e9)
    made = compiled(everything, {"x": (6,)}, {"u": ()})
    quick = made({"x": x}, u)
    made._improve(np.inf)
    assert len(made._codes) == 2
    for a, b in zip(quick, made({"x": x}, u), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("section", [1, 300, 5000])
@pytest.mark.parametrize("width", [1, 4, 8])
def test_sections_compute_what_the_whole_does_to_the_bit(section, width, monkeypatch):
    x, u = np.random.default_rng(0).uniform(-2, 2, (11, 6)), {"u": 0.7}
    shapes = {"x": (6,)}, {"u": ()}
    monkeypatch.setattr(
        kernel, "Lanes", lambda traced, width, fused, **_: lanes.Lanes(traced, width, fused)
    )
    monkeypatch.setattr(lanes, "STACK", 10**9)
    monkeypatch.setattr(lanes, "SECTION", 10**9)
    whole = compiled(everything, *shapes, lanes=width)
    monkeypatch.setattr(lanes, "SECTION", section)
    cut = compiled(everything, *shapes, lanes=width)
    assert cut.stack < whole.stack
    for a, b in zip(whole({"x": x}, u), cut({"x": x}, u), strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_is_too_long_is_refused_with_the_bound(monkeypatch):
    monkeypatch.setattr(expressions, "LONGEST", 50)
    with pytest.raises(UnsupportedError, match=r"more than 50 operations.*lock joints"):
        compiled(lambda x: np.sin(x), {"x": (60,)})


def runs(path: Path, n: int, tmp_path: Path):
    path.write_text(in_a_row(n), encoding="utf-8")
    environment = {"SPACEARM_CACHE": str(tmp_path), "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, "-c", SCRIPT, str(path)],
        env=os.environ | environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("n", [7, 15, 20, 40, 100])
def test_arms_answer_in_threads_with_little_stack(n, tmp_path):
    done = runs(tmp_path / "long.urdf", n, tmp_path)
    assert (done.returncode, done.stdout) == (0, "answered\n"), done.stderr
