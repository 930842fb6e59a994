"""The search for events, step by step."""

import numpy as np
import pytest

from spacearm.motion.events import EventFinder, EventFunction


@pytest.mark.parametrize("off", [0.0, 1e-18, -1e-18])
def test_an_event_between_two_steps_is_found(off):
    """The same place as the end of a step and as the start of the next differs by rounding."""
    distance = EventFunction("joint limit", "elbow", lambda _, y: float(y[0]), falling=True)
    finder = EventFinder([distance], 1, 0.0, np.array([1e-3]))
    assert finder.in_step(lambda t: np.array([1e-3 * (1.0 - t) + 1e-18]), 1.0) == []
    (event,) = finder.in_step(lambda t: np.array([off - 1e-3 * (t - 1.0)]), 2.0)
    assert event.t == pytest.approx(1.0, abs=1e-12)
