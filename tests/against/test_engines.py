"""Against independent engines, each where it is installed; conventions.py says how they map."""

import numpy as np
import pytest
from comparison import UNLIKE, compared, subjects, suits
from conventions import ENGINES, MODULES

import spacearm as sa

ARMS = subjects()


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("engine", ENGINES)
def test_everything_agrees(engine, name):
    pytest.importorskip(MODULES[engine], reason="pip install spacearm[against]")
    arm = ARMS[name]
    if not suits(engine, name, arm):
        pytest.skip(UNLIKE.get((engine, name), "spartpy's velocities are those of serial arms"))
    for quantity, difference in compared(arm, ENGINES[engine]).items():
        assert difference < 1e-10, quantity


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
