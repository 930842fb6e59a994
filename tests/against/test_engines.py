"""Against independent engines, each where it is installed; conventions.py says how they map."""

import numpy as np
import pytest
from comparison import UNLIKE, compared, differences, main, relative, states, subjects, suits
from conventions import ENGINES, MODULES, Spacearm

import spacearm as sa
from spacearm.mechanics.arm_kernels import worth_compiling
from spacearm.mechanics.batch import SINGLY

ARMS = subjects()


def suited(engine, name):
    """The arm, unless the engine is missing or does not suit it."""
    pytest.importorskip(MODULES[engine], reason="pip install spacearm[against]")
    arm = ARMS[name]
    if not suits(engine, name, arm):
        pytest.skip(UNLIKE.get((engine, name), "spartpy's velocities are those of serial arms"))
    return arm


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("engine", ENGINES)
def test_everything_agrees(engine, name):
    arm = suited(engine, name)
    for quantity, difference in compared(arm, ENGINES[engine]).items():
        assert difference < 1e-10, quantity


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("engine", ENGINES)
def test_accelerations_of_many_states_agree(engine, name):
    """`joint_accelerations` in compiled code, on so many states that they are taken."""
    arm = suited(engine, name)
    there, some = ENGINES[engine](arm), list(states(arm))
    theirs = np.array([there(state).acceleration[6:] for state in some])
    Q, dQ, tau = (np.array(x) for x in zip(*((s.cfg.q, s.v[6:], s.tau) for s in some), strict=True))
    h = [Spacearm()(s).momentum.reshape(2, 3) @ s.cfg.base.rotation for s in some]
    many = next(m for m in range(1, 10**4) if worth_compiling(m * len(some), SINGLY))
    rows = [np.tile(x, (many, 1)) for x in (Q, dQ, tau, np.reshape(h, (-1, 6)))]
    ours = sa.joint_accelerations(arm, *rows[:3], momentum=rows[3])
    size = np.abs(theirs).max(axis=1, keepdims=True)
    np.testing.assert_allclose(ours[: len(some)] / size, theirs / size, rtol=0, atol=1e-10)


@pytest.mark.parametrize("number", [np.nan, np.inf])
@pytest.mark.parametrize("quantity", ["com", "momentum", "acceleration"])
def test_numbers_that_are_not_finite_are_no_agreement(quantity, number):
    answers = Spacearm()(next(states(ARMS["planar2"])))
    assert max(differences(answers, answers).values()) == 0.0
    spoiled = answers._replace(**{quantity: getattr(answers, quantity) * number})
    for pair, whose in (((answers, spoiled), "their"), ((spoiled, answers), "our")):
        with pytest.raises(ValueError, match=f"{whose} {quantity}: not finite"):
            differences(*pair)
    assert np.isnan(relative(np.ones(6), np.full(6, np.nan), 3))


def test_a_missing_engine_is_named_and_an_error_where_all_install(monkeypatch, capsys):
    for name in MODULES:  # none is imported: on a platform that is not theirs they may crash
        monkeypatch.setitem(MODULES, name, "engine_that_is_not_there")
    for machine, code in ((("linux", "x86_64"), 1), (("darwin", "arm64"), 0)):
        monkeypatch.setattr("sys.platform", machine[0])
        monkeypatch.setattr("platform.machine", lambda machine=machine: machine[1])
        assert main(["--engines"]) == code
        assert "Drake is not compared: No module named 'engine_that" in capsys.readouterr().out


def test_mujoco_refuses_the_inertia_that_ets7_was_published_with():
    pytest.importorskip("mujoco")
    with pytest.raises(ValueError, match=r"A \+ B >= C(.|\n)*link_5"):
        ENGINES["MuJoCo"](sa.load("ets7"))


def test_drake_replaces_the_inertia_that_ets7_was_published_with():
    pytest.importorskip("pydrake")
    plant = ENGINES["Drake"](sa.load("ets7")).plant
    for link, kept in (("link_4", True), ("link_5", False)):
        inertia = plant.GetBodyByName(link).default_spatial_inertia()
        published = sa.load("ets7").tree.links[link].inertia
        com = inertia.get_com()
        found = inertia.Shift(com).CalcRotationalInertia().CopyToFullMatrix3()
        assert (np.abs(found - published).max() < 1e-12) == kept
