"""Published numbers: each as close as rounding in print allows, and listed in the documentation."""

from pathlib import Path

import pytest
from published import rows, table

PAGE = Path(__file__).resolve().parents[2] / "docs" / "validation.md"


@pytest.mark.slow
def test_published_numbers_are_met_and_listed():
    for row in rows():
        assert abs(row.computed - row.published) <= row.within, row
    assert table() in PAGE.read_text(encoding="utf-8")
