"""Errors travel; arguments that make no sense are said by name and value."""

import inspect
import pickle
import types
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import spacearm as sa
from spacearm import errors

KINDS = [
    kind
    for kind in vars(errors).values()
    if isinstance(kind, type) and issubclass(kind, (sa.SpaceArmError, sa.ModelWarning))
]


@pytest.mark.parametrize("kind", KINDS)
def test_errors_travel_between_processes(kind):
    extra = {
        sa.SweepError: ({"shells 0": "why"},),
        sa.NoSolutionError: (sa.Joints([0.1, 0.2]),),
    }.get(kind, ())
    error = kind("what happened", *extra)
    twin = pickle.loads(pickle.dumps(error))
    assert type(twin) is kind
    assert str(twin) == "what happened"
    assert vars(twin) == vars(error)


def arm():
    return sa.load("planar2")


def rest(*_):
    return np.zeros(2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: sa.simulate(arm().at([0, 1]), rest, "1"), "duration is '1'; give a number"),
        (lambda: sa.Integration(dt="1"), "dt is '1'; give a number"),
        (lambda: sa.Integration(atol=-1.0), "atol is -1.0"),
        (lambda: sa.Integration(rtol=-1.0), "rtol is -1.0"),
        (lambda: sa.Integration(rtol=1e-15), "rtol is 1e-15; .* from 2"),
        (lambda: sa.Integration(method=["BDF"]), "method is \\['BDF'\\]; give 'auto'"),
        (
            lambda: sa.simulate(arm().at([0, 1]), rest, 1.0, mode=["fixed"]),
            "mode is .*; give 'fr",
        ),
        (lambda: sa.Search(method=["straight"]), "method is .*; give a text"),
        (lambda: sa.Search(seed=1.0), "seed is 1.0; give a whole number"),
        (lambda: sa.Search(timeout=np.nan), "timeout is nan"),
        (lambda: sa.singular_set(arm()).sample(3.0), "m is 3.0; give a whole number"),
        (
            lambda: sa.singular_set(arm()).sample(-1),
            "m is -1; give a whole number from 0 to",
        ),
        (lambda: sa.singular_set(sa.load("chaser7")).sample(1.5), "m is 1.5"),
        (
            lambda: sa.singular_set(arm()).roots([0, 1], 1.0),
            "joint is 1.0; give a whole",
        ),
        (lambda: sa.singular_set(arm()).roots([0, 1], "q3"), "unknown joint 'q3'.*q2"),
        (lambda: sa.singular_map(arm(), ("q1", "q2", "q1")), "joints is .*; give 2 values"),
        (lambda: sa.singular_map(arm(), points=9.5), "points is 9.5"),
        (lambda: sa.workspace(arm(), effort=1.5), "effort is 1.5"),
        (lambda: arm().at([0, 1], base=1), "base is an int; give it as sa.pose"),
        (lambda: sa.plan(arm().at([0, 1]), (1, 2, 3)), "goal is .*; give 2 finite numbers"),
        (lambda: sa.mount("ur5", 5), "bus is 5; give sa.Bus.* or a path"),
        (lambda: sa.DampedLeastSquares(target=(1, 1), threshold=0.0), "threshold is 0.0"),
        (lambda: sa.JointPD([0, 1], kp="a", kd=1)(0, arm().at([0, 1]), np.zeros(2)), "kp is 'a'"),
        (lambda: sa.JointPD([0, 1], 1, np.nan)(0, arm().at([0, 1]), np.zeros(2)), "kd is nan"),
        (lambda: sa.evaluate(arm(), [[0, 1]] * 99, threads=1.0), "threads is 1.0"),
        (
            lambda: sa.risk_profile(arm(), bins=0),
            "bins is 0; give a whole number from 1 to",
        ),
        (lambda: sa.risk_profile(arm(), bins=2.5), "bins is 2.5; give their number, or increasing"),
        (lambda: sa.risk_profile(arm(), bins="many"), "bins is 'many'"),
        (lambda: sa.risk_profile(arm(), samples=9.5), "samples is 9.5; give a whole number"),
        (lambda: sa.risk_profile(arm(), sigma_min=1, distance=2), "give only one of them"),
        (
            lambda: sa.pose_risk(arm(), poses=0),
            "poses is 0; give a whole number from 1 to",
        ),
        (lambda: sa.pose_risk(arm(), poses=1.5), "poses is 1.5"),
    ],
)
def test_arguments_that_make_no_sense(call, message):
    with pytest.raises(sa.ConfigurationError, match=message):
        call()


def test_numbers_of_numpy_are_numbers():
    few = {"samples": np.int64(50), "bins": np.int32(4), "threads": np.int64(1)}
    assert len(sa.risk_profile(arm(), **few).count) == 4
    assert sa.load("planar2", locked={"joint_2": np.float32(0.5)}).n == 1
    kept = sa.Constraints(clearance=np.float32(0.01))
    soon = sa.Search(timeout=np.float32(30), seed=np.int64(1))
    plan = sa.plan(arm().at([0.3, 1.2]), sa.Joints([0.4, 1.1]), constraints=kept, search=soon)
    assert plan.clearance == np.float32(0.01)
    assert len(sa.singular_set(arm()).sample(np.int64(3))) == 3
    assert (
        sa.simulate(
            arm().at([0, 1]),
            rest,
            np.float32(0.5),
            integration=sa.Integration(rtol=np.float64(1e-6)),
        ).t[-1]
        == 0.5
    )


@pytest.mark.parametrize(
    ("load", "kind", "name"),
    [
        (sa.load, "model", "planar2"),
        (lambda path: sa.mount(path, sa.Bus(mass=100, size=(1, 1, 1))), "arm", "ur5"),
    ],
)
def test_a_path_is_a_file_and_a_name_is_text(load, kind, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    message = f"{name}: no such file; the {kind} of that name is '{name}', as text"
    with pytest.raises(sa.ModelError, match=message):
        load(Path(name))
    with pytest.raises(sa.ModelError, match="nowhere: no such file"):
        load(Path("nowhere"))
    Path(name).write_bytes(sa.load("planar2").path.read_bytes())
    assert load(Path(name)).n == 2


def test_joints_are_named_alike():
    one = sa.singular_set(arm())
    roots = [one.roots([0.3, 0.4], joint).angles for joint in (1, "joint_2", "q2", np.int64(1))]
    for other in roots[1:]:
        np.testing.assert_array_equal(other, roots[0])
    assert sa.singular_map(arm(), ("q2", "joint_1"), points=3).joints == ("joint_2", "joint_1")


def test_large_results_are_shown_in_a_line():
    nobody = sa.risk_profile(arm(), bins=[10.0, 11.0], samples=2000)
    assert "no configuration in any class" in repr(nobody)
    shown = repr(sa.pose_risk(arm(), poses=50, samples=500))
    assert shown.startswith("PoseRisk(50 poses, within 5° of a singular posture")
    assert len(shown) < 150
    shells = [repr(component) for component in sa.singular_set(arm()).components()]
    assert any(shell.endswith("R from 0.3510638 to 0.5536773 m)") for shell in shells)


def test_warnings_point_outside_the_package():
    """Frames of the package are skipped; those of a package with a similar name are not."""
    for name, inside in (("spacearm.anywhere", True), ("spacearms", False)):
        module = types.ModuleType(name)
        module.warn = errors.warn
        exec(compile("def f(): warn('look')", f"{name}.py", "exec"), vars(module))
        with pytest.warns(sa.ModelWarning, match="look") as caught:
            module.f()
        assert (caught[0].filename == __file__) == inside


def test_messages_are_bounded_however_many_names_there_are_and_however_long():
    many = [f"link_{i}" for i in range(80_000)]
    message = errors.unknown("link", "x" * 10**6, many)
    assert "and 79,990 more" in message
    assert len(message) < 1000
    assert errors.listed(many[:11]).endswith("link_9 and 1 more")
    assert errors.listed(many[:10]).endswith("link_8, link_9")
    for kind in KINDS:
        if issubclass(kind, sa.SpaceArmError) and kind is not sa.SweepError:
            assert len(str(kind("y" * 10**7))) < 5000
    with pytest.warns(sa.ModelWarning) as caught:
        errors.warn("z" * 10**7)
    assert len(str(caught[0].message)) < 5000


UNSEEN = [*"\u061c\u200b\u200c\u200d\u200e\u200f\u2060\ufeff\U000e0000\U000e0041\U000e007f"]


@pytest.mark.parametrize(
    "bad", ["\x1b[2J", "\x9b31m", "\x07", "\u202e", "\x7f", "\ud800", "\r", *UNSEEN]
)
def test_messages_hold_nothing_that_commands_a_terminal(bad):
    assert bad not in str(sa.ModelError(f"link {bad} is odd"))
    assert str(sa.ModelError(f"link {bad} is odd")).isprintable()
    with pytest.warns(sa.ModelWarning) as caught:
        errors.warn(f"link {bad} is odd")
    assert str(caught[0].message).isprintable()


class Gradient:
    """A tensor that wants a gradient, as torch has them."""

    def __array__(self, *_, **__):
        raise RuntimeError("Can't call numpy() on Tensor that requires grad.")


FIRST_DAY = {
    "an arm for a configuration": (
        lambda: sa.generalized_jacobian(arm(), [0, 1]),
        r"sa.generalized_jacobian: cfg is a SpaceArm; give a configuration: arm.at\(q\)",
    ),
    "the same in a report": (
        lambda: sa.singularity(arm(), [0, 1]),
        r"cfg is a SpaceArm; give a configuration: arm.at\(q\)",
    ),
    "numbers for a configuration": (
        lambda: sa.momentum_matrix([0, 1]),
        r"sa.momentum_matrix: cfg is \[0, 1\]; give a configuration: arm.at\(q\)",
    ),
    "a name for an arm": (
        lambda: sa.workspace("planar2"),
        r"arm is 'planar2'; give an arm: arm = sa.load\(...\)",
    ),
    "a configuration for an arm": (
        lambda: sa.singular_set(arm().at([0, 1])),
        "arm is a Configuration; give its .arm",
    ),
    "a model of Pinocchio": (
        lambda: sa.evaluate(pin.Model(), [[0, 1]]),
        "arm is a Model; give an arm: arm = sa.load",
    ),
    "a word for a law": (
        lambda: sa.simulate(arm().at([0, 1]), "joints", 5),
        "controller is 'joints'; give a function of 3 arguments",
    ),
    "a class for a law": (
        lambda: sa.simulate(arm().at([0, 1]), sa.JointPD, 5),
        "controller is the class JointPD; give",
    ),
    "the text of a URDF": (
        lambda: sa.load('<robot name="r"><link name="bus"/></robot>'),
        "is the text of a robot file, not its path; write it to a file first",
    ),
    "the text of a URDF for an arm": (
        lambda: sa.mount('<?xml version="1.0"?><robot/>', sa.Bus(mass=9, size=(1, 1, 1))),
        "is the text of a robot file",
    ),
    "an address": (lambda: sa.load("https://example.org/arm.urdf"), "nothing is downloaded"),
    "a number for a robot": (lambda: sa.load(5), "source is 5; give a text or a path"),
    "a configuration for q": (
        lambda: arm().at(arm().at([0.0, 0.0])),
        "q is a Configuration; give its .q",
    ),
    "a configuration for a goal": (
        lambda: sa.plan(arm().at([0.0, 1.0]), arm().at([0.0, 0.5])),
        r"goal is a Configuration; give sa.Joints\(its .q\)",
    ),
    "a number for what is uncertain": (
        lambda: sa.uncertain(arm(), 0.1),
        r'spread is 0.1; give .*such as {"link_2":{"mass":0.05}}',
    ),
    "a model for an arm to mount": (
        lambda: sa.mount("planar2", sa.Bus(mass=9, size=(1, 1, 1))),
        r"planar2 has a spacecraft; sa.load\('planar2'\) loads it",
    ),
    "a robot for a study": (lambda: sa.Study.read(arm().path), r"the study \S+urdf is not TOML"),
    "an uncertain arm to view": (
        lambda: sa.view(sa.uncertain(arm(), {"link_1": {"mass": 0.1}})),
        "an UncertainArm cannot be shown; give a SpaceArm",
    ),
    "a number for a path": (
        lambda: sa.view(arm(), open=False).save(3),
        "save: path is 3; give a text or a path",
    ),
    "a tensor with a gradient": (lambda: arm().at(Gradient()), "q does not hold numbers: .*grad"),
    "the same in a batch": (lambda: sa.evaluate(arm(), Gradient()), "Q"),
}


@pytest.mark.parametrize("name", FIRST_DAY)
def test_mistakes_of_the_first_day(name):
    call, message = FIRST_DAY[name]
    with pytest.raises((sa.ConfigurationError, sa.ModelError), match=message):
        call()


def test_a_folder_names_the_robots_in_it(tmp_path):
    for name in ("b.urdf", "a.xacro", "notes.txt"):
        (tmp_path / name).write_text("")
    message = "is a folder; give the path of one of those in it: a.xacro, b.urdf"
    for path in (tmp_path, str(tmp_path)):
        with pytest.raises(sa.ModelError, match=message):
            sa.load(path)


def test_what_pinocchio_users_have_is_taken():
    model = sa.load("planar2").model
    wrapper = pin.RobotWrapper(model)
    J = sa.generalized_jacobian(sa.load(wrapper, tip="tip", task="x y").at([0.3, 0.9]))
    assert J.shape == (6, 2)


def test_checked_functions_keep_their_names_and_their_help():
    for name in ("singularity", "evaluate", "plan", "generalized_jacobian"):
        function = getattr(sa, name)
        assert function.__name__ == name
        assert "Args:" in function.__doc__
        assert {"arm", "cfg", "start"} & set(inspect.signature(function).parameters)


def test_a_part_of_the_package_that_is_called_names_what_to_call():
    with pytest.raises(
        TypeError, match=r"is a part of the package, no function; call sa\.design\."
    ):
        sa.design(arm())
