"""Arms of many joints in a row are shown at once."""

from helpers.arms import load_text
from helpers.long_arms import in_a_row

import spacearm as sa
from spacearm.viewer.session import Session


def test_a_long_arm_is_shown_with_the_first_order_estimate():
    arm = load_text(in_a_row(40))
    cfg = arm.at([0.1] * 40)
    session = Session(arm, cfg)
    assert session.report.distance == sa.singularity(cfg).distance
    assert session.report.distance_proven is None or session.report.distance_proven == 0.0
