"""Random samples of configurations, from which risks are estimated."""

import numpy as np

import spacearm as sa
from spacearm.singularities import risk


def test_a_sample_does_not_depend_on_how_many_are_drawn_at_once(monkeypatch):
    arm = sa.load("mda6")
    at_once = risk.uniform(arm, True, 100, np.random.default_rng(3))
    monkeypatch.setattr(risk, "BLOCK", 7)
    np.testing.assert_array_equal(risk.uniform(arm, True, 100, np.random.default_rng(3)), at_once)
