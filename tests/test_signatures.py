"""Arguments of a wrong kind, missing or unknown: each message names the argument and the remedy."""

import inspect
import json
import os
import pydoc
import re
import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest

import spacearm as sa
from spacearm import signatures
from spacearm.signatures import checked, fits

PYTHONS = re.compile(
    r"object has no attribute|unexpected keyword|positional argument|not subscriptable|not iterable"
    r"|not callable|unsupported operand|could not broadcast|shapes \(|must be real number"
    r"|cannot be interpreted|inhomogeneous|object of type|could not convert|argument must be"
    r"|has no len|dimension mismatch|index out of|truth value"
)
"""What messages of Python and NumPy say, and ours must not."""
LIMIT = 0.3
"""Seconds after which a call counts as accepted: it computes."""


@pytest.mark.parametrize(
    ("hint", "good", "bad"),
    [
        (float, [1, 1.5, np.float32(2), np.int64(3), np.array(1.0)], ["1", None, True, [1.0], 1j]),
        (int, [1, np.int32(2)], [1.5, "1", None, True, np.float64(2), np.array(2)]),
        (tuple[int, ...], [(1, 2), np.array([1, 2])], [np.array(1), np.ones(2), (1.0,)]),
        (bool, [True, np.bool_(False)], [1, "yes", None]),
        (str, ["a"], [1, None, ["a"]]),
        (float | None, [None, 1.0], ["1", [1.0]]),
        (Literal["a", "b"], ["a"], ["c", None, ["a"], 1]),
        (Sequence[float], [[0.1], (1, 2.0), np.array([0.1, 0.2])], [0.1, np.array(0.1), ["a"]]),
        (Sequence[str], [["a"], ("a", "b"), []], ["a", [1], None, {"a": 1}]),
        (Mapping[str, float], [{"a": 1.0}, {}], [["a"], {"a": "b"}, {1: 1.0}, 0.1]),
        (tuple[str, str], [("a", "b"), ["a", "b"]], [("a",), "ab", None, ("a", 1)]),
        (Callable[[int, int], object], [print, max, lambda *_: 0], [lambda _: 0, 1, sa.JointPD]),
        (npt.ArrayLike, [1, [1.0, 2.0], np.eye(2)], [None, {}, sa.Search(), print]),
        (pin.SE3 | npt.ArrayLike, [pin.SE3.Identity(), np.eye(4)], [None, {}, print]),
        (str | os.PathLike[str], ["a", Path("a")], [1, None, ["a"]]),
        (sa.Search | None, [sa.Search(), None], [{"seed": 1}, sa.Search]),
    ],
)
def test_what_fits_an_annotation(hint, good, bad):
    assert [value for value in good if not fits(value, hint)] == []
    assert [value for value in bad if fits(value, hint)] == []


def test_a_function_is_checked_by_its_annotations_and_quotes_its_docstring():
    @checked
    def weigh(mass: float, *, names: Sequence[str] = (), search: sa.Search | None = None) -> object:
        """Weigh something.

        Args:
            mass: Mass [kg]. More of it.
            names: Of the parts.
            search: How to look.
        """
        return mass, names, search

    assert weigh(2.0, names=["a"]) == (2.0, ["a"], None)
    for call, message in {
        lambda: weigh("2"): r"weigh: mass is '2'; give a number \(mass: Mass \[kg\]\)",
        lambda: weigh(): r"weigh needs mass; give a number",
        lambda: weigh(2.0, names="ab"): "names is 'ab'; give a list, each entry a text",
        lambda: weigh(2.0, timeout=1): r"takes no timeout; give search=sa.Search\(timeout=...\)",
        lambda: weigh(2.0, name=1): "unknown argument of .*'name'; valid, nearest first: names",
        lambda: weigh(2.0, ["a"]): r"was given \['a'\] after all .*: mass; give by name: names",
    }.items():
        with pytest.raises(sa.ConfigurationError, match=message):
            call()


def test_messages_name_what_is_public():
    """What to give for an argument: no name of ours that a user cannot write."""
    for name in set(sa.__all__) - {"__version__"}:
        thing = getattr(sa, name)
        methods = [m for m in vars(thing).values() if inspect.isfunction(m)]
        for function in [thing, *methods] if inspect.isclass(thing) else [thing]:
            for hint in signatures._hints(function).values():
                named = re.findall(r"\bsa\.(\w+)", signatures._words(hint))
                assert set(named) <= set(sa.__all__), f"{name}: {named}"
    with pytest.raises(sa.ConfigurationError, match=r"give a configuration: arm.at\(q\), or a mot"):
        sa.free_box([0.3, 1.2])


def test_shapes_of_arrays_are_those_of_the_docstring():
    @checked
    class Matrix:
        n = 2

        def rows(self, A: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> object:
            """Do something.

            Args:
                A: (..., 3 n, m) some rows.
                b: (m,) a column.
            """
            return A, b

    given = Matrix()
    assert given.rows(np.ones((5, 6, 4)), np.ones(4))
    for A, b, name in (
        ((6, 4), (3,), "b"),
        ((4, 4), (4,), "A"),
        ((6,), (6,), "A"),
        ((6, 4), (4, 1), "b"),
    ):
        with pytest.raises(sa.ConfigurationError, match=rf"rows: {name} is an array of shape"):
            given.rows(np.ones(A), np.ones(b))
    with pytest.raises(
        sa.ConfigurationError, match=r"R is an array of shape \(2,\); give \(3, 3\)"
    ):
        sa.load("planar2").task.axes(np.ones(2))


def test_what_the_package_gives_itself_is_not_checked(monkeypatch):
    """Copies neither, although `dataclasses` makes them; those that users make are."""
    checks, check = [], signatures.check
    start = sa.load("planar2").at([0.3, 1.2])
    monkeypatch.setattr(signatures, "check", lambda *given: (checks.append(given), check(*given)))
    sa.follow(start, [(1.5, 1.2)])
    assert [thing.__name__ for thing, *_ in checks] == ["follow"]
    checks.clear()
    start.arm.replace(lower=[0.0, 1.0], mount=start.arm.mount)
    assert [thing.__name__ for thing, *_ in checks] == ["replace"]
    with pytest.raises(sa.ConfigurationError, match="seed is 'a'; give a whole number"):
        replace(sa.Search(), seed="a")


def test_options_that_are_handed_on_are_checked_as_given_by_users():
    with pytest.raises(sa.ConfigurationError, match=r"argument of sa\.workspace 'nonsense'"):
        sa.design.shell_measures(sa.load("planar2"), nonsense=1)


def test_keys_of_unpacked_options_are_arguments_like_others():
    parameters = inspect.signature(sa.SpaceArm.replace).parameters
    assert [*parameters][-2:] == ["lower", "upper"]
    assert {parameters[side].kind for side in ("lower", "upper")} == {parameters["tip"].kind}
    assert "upper: 'ArrayLike | Mapping[str, float] | None' = None" in pydoc.plain(
        pydoc.render_doc(sa.SpaceArm.replace)
    )


def things(folder):
    """What is in the hands of somebody who makes mistakes: planar2, and what was made of it."""
    arm = sa.load("planar2")
    cfg = arm.at([0.3, 1.2])
    apart = sa.Constraints(collisions=False)
    uncertain = sa.uncertain(arm, {"link_2": {"mass": 0.1}})
    motion = sa.plan(cfg, sa.Joints([0.4, 1.1]), constraints=apart)
    law = sa.JointPD([0.4, 1.1], 1.0, 1.0)
    objects = [
        arm,
        cfg,
        motion,
        sa.simulate(cfg, law, 0.2),
        uncertain,
        sa.singular_set(arm),
        sa.singular_set(sa.load("chaser7")),
        sa.singularity_polynomial(arm),
        sa.workspace(arm, effort=2000),
        sa.distance_range(uncertain, [0.3, 1.2], samples=10),
        sa.free_box(cfg),
        sa.free_boxes(arm, share=0.3),
        sa.size_wheels(arm, motion),
        sa.level_reach(cfg, 0.1),
        sa.feasible_attitudes(cfg, [[1.0, 1.0], [1.01, 1.0]], samples=20),
        sa.Obstacle.box((0.1, 0.1, 0.1)),
        sa.Tracking(motion),
        arm.task,
        law,
        *(kind(target=[0.9, 1.4]) for kind in (sa.ResolvedRate, sa.DampedLeastSquares)),
        sa.TransposedJacobian(target=[0.9, 1.4], kp=1, kd=1),
        apart,
        sa.Servo(arm),
        sa.view(cfg, open=False),
    ]
    motion.save(folder / "plan.npz")
    return arm, cfg, uncertain, motion, law, objects


def right(arm, cfg, uncertain, motion, law):
    """Right arguments by name; others are 1.0."""
    planar, tip = [0.3, 1.2], cfg.tip.translation[:2]
    return {
        "arm": arm, "cfg": cfg, "start": cfg, "goal": [0.9, 1.4], "q": planar, "q0": planar,
        "q1": [0.4, 1.0], "Q": [planar], "dq": planar, "dQ": [planar], "tau": planar, "ddq": planar,
        "duration": 0.2, "controller": law, "uncertain": uncertain, "motion": motion,
        "thing": motion, "phases": [sa.Phase(law, 0.2)], "starts": [cfg],
        "spread": {"link_2": {"mass": 0.1}}, "samples": 20, "m": 3, "tilts": [0.1],
        "base_masses": [100.0, 200.0], "target_twist": np.eye(6)[5], "rates": {"q1": 0.1},
        "source": "planar2", "bus": sa.Bus(mass=100, size=(1, 1, 1)), "about": cfg,
        "study": "study.toml", "store": "store", "folder": "code", "momentum": np.zeros(6),
        "com": np.zeros(3), "J": np.eye(6, 2), "rows": np.eye(2), "share": 0.5, "shares": [0.5],
        "size": [0.1, 0.1, 0.1], "point": [0.9, 0.9], "postures": cfg, "target": [0.9, 1.4],
        "effort": 10, "poses": 5, "rng": np.random.default_rng(0), "i": 0, "seed": 0, "corners": 2,
        "ranges": {"joint_1": (-1.0, 1.0)}, "other": uncertain, "text": "", "names": "x y",
        "joint": 0, "order": 1, "angles": {0: 0.1}, "j": 0, "shape": (8, 8), "keep": (0,),
        "centre": np.zeros(2), "half": np.full(2, 0.1), "offset": np.zeros(2), "R": np.eye(3),
        "axes": np.eye(3), "mount": pin.SE3.Identity(), "path": [tip, tip + 0.01],
        "parameters": {"base_mass": [100.0]}, "servo": sa.Servo(arm), "posture": cfg,
        "seen": sa.Servo(arm).seen(cfg, [0.1, 0.0], 0.1),
        "twist": [0.1, 0.0], "messages": [{"t": 0.0, "q": planar}],
    }  # fmt: skip


OWN = {"DampedLeastSquares.damped_rates": {"J": np.eye(2)}}
"""Right arguments of one function that have other shapes than elsewhere."""


def wrong(arm, cfg, motion):
    """Plausible mistakes, by name."""
    return {
        "0.1": 0.1, "-1": -1, "0": 0, "nan": np.nan, "1e9": 10**9, "1j": 1j, "True": True,
        "None": None, "a name": "nowhere", "no text": "", "a path": Path("nowhere.csv"),
        "its text": "none/x.csv", "nothing": [], "nine": [float(i) for i in range(9)],
        "a list of names": ["a"], "rows of two lengths": [[1.0, 2.0], [3.0]],
        "a cube": np.ones((3, 3, 3)), "an array of nine": np.ones(9), "a scalar": np.array(1.0),
        "no mapping": {}, "an unknown name": {"nowhere": 1},
        "a text for a number": {"q1": "x"}, "numbers for names": {1: 2}, "an arm": arm,
        "arms": (arm, arm), "a configuration": cfg, "configurations": [cfg], "Nones": [None],
        "a motion": motion, "a function": lambda *_: None, "a function of t": lambda _: 3.0,
        "a class": sa.JointPD, "an object": object(), "a module": np, "a search": sa.Search(),
    }  # fmt: skip


def calls(objects):
    """Public functions, constructors of what a caller gives, and methods, by name."""
    for name in sa.__all__:
        thing = getattr(sa, name)
        if inspect.ismodule(thing):
            parts = ((part, getattr(thing, part)) for part in thing.__all__)
            yield from (
                (f"{name}.{part}", given)
                for part, given in parts
                if not (inspect.isclass(given) and issubclass(given, tuple))
            )
        elif inspect.isclass(thing) and not issubclass(thing, (BaseException, tuple)):
            made = "Result" in {kind.__name__ for kind in thing.__mro__} or inspect.isabstract(
                thing
            )
            if not made:
                yield name, thing
            yield from (
                (f"{name}.{part}", getattr(thing, part))
                for part, method in inspect.getmembers_static(thing)
                if isinstance(method, classmethod) and part[0] != "_"
            )
        elif inspect.isroutine(thing):
            yield name, thing
    for thing in objects:
        for part, method in inspect.getmembers_static(type(thing)):
            if inspect.isfunction(method) and part[0] != "_":
                yield f"{type(thing).__name__}.{part}", getattr(thing, part)


def outcomes(call, cases):
    """Make calls in a process of their own; what each said, or nothing if it was accepted.

    What takes too long ends the process: the next one goes on, with three of an argument at most.
    """
    told, slow = [], dict.fromkeys((argument for argument, *_ in cases), 0)
    while cases := [case for case in cases if slow[case[0]] < 3]:
        get, put = os.pipe()
        child = os.fork()
        if not child:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            for _, _, arguments in cases:
                signal.setitimer(signal.ITIMER_REAL, LIMIT)
                said = ["", ""]
                try:
                    call(**arguments)
                except BaseException as error:
                    said = [type(error).__name__, str(error)[:300]]
                signal.setitimer(signal.ITIMER_REAL, 0.0)
                os.write(put, json.dumps(said).encode() + b"\n")
            os._exit(0)
        os.close(put)
        with os.fdopen(get, "rb") as pipe:
            said = [json.loads(line) for line in pipe]
        ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        told += [(*case[:2], *words) for case, words in zip(cases, said, strict=False)]
        if ended:
            argument, what, _ = cases[len(said)]
            late = ended == -signal.SIGALRM
            slow[argument] += late
            told.append((argument, what, "late" if late else f"ended by {ended}", ""))
        cases = cases[len(said) + 1 :]
    return told


PARTS = 8
"""Into which the public functions are divided."""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="runs each call in a process of its own")
@pytest.mark.parametrize("part", range(PARTS))
def test_mistakes_get_messages_of_our_own(part, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", lambda _: True)
    arm, cfg, uncertain, motion, law, objects = things(tmp_path)
    known, mistakes = right(arm, cfg, uncertain, motion, law), wrong(arm, cfg, motion)
    ours = {name for name in sa.__all__ if name.endswith("Error")}
    faults, count = [], 0
    for name, call in [*calls(objects)][part::PARTS]:
        parameters = inspect.signature(call).parameters.values()
        given = [p for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
        base = {p.name: known.get(p.name, 1.0) for p in given if p.default is p.empty}
        base |= OWN.get(name, {})
        cases = [(p.name, what, value) for p in given for what, value in mistakes.items()]
        cases = [*cases, ("nonsense", "unknown", 1)]
        for argument, what, kind, message in outcomes(
            call, [(argument, what, base | {argument: value}) for argument, what, value in cases]
        ):
            count += 1
            if kind not in ("", "late") and (kind not in ours or PYTHONS.search(message)):
                faults.append(f"{name}({argument}={what}): {kind}: {message}")
    assert count > 10_000 / PARTS / 2
    assert faults == []
