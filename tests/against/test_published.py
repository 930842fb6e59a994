"""Published numbers: each as close as rounding in print allows, and listed in the documentation."""

from pathlib import Path

import numpy as np
import pytest
from canadarm2 import blocks, left
from published import rows, table

import spacearm as sa

PAGE = Path(__file__).resolve().parents[2] / "docs" / "validation.md"


@pytest.mark.slow
def test_published_numbers_are_met_and_listed():
    for row in rows():
        assert abs(row.computed - row.published) <= row.within, row
    assert table() in PAGE.read_text(encoding="utf-8")


def test_the_conditions_of_canadarm2_are_those_of_an_attitude_that_is_held():
    """The block is zero in any posture; where the spacecraft floats other postures are singular."""
    arm = sa.load("ssrms")
    Q = np.random.default_rng(0).uniform(-3.0, 3.0, (200, 7))
    assert max(np.abs(blocks(arm, q).zero).max() for q in Q) < 1e-14
    assert min(left(arm, q) for q in Q) > 1e-3
    floating = (sa.singular_set(arm).sample(200) + np.pi) % (2.0 * np.pi) - np.pi
    assert np.median([left(arm, q) for q in floating]) > 0.01
