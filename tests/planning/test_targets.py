"""What plans refuse at the start."""

import numpy as np
import pytest
from helpers.arms import frame, joint, link, load_text, robot

import spacearm as sa


def rods(axes):
    """Rods along x, joined about axes: those about x are in one line, and turn them about it."""
    parts, before, x = [link("bus", 100.0, inertia=15.0 * np.eye(3))], "bus", 0.6
    for i, axis in enumerate(axes):
        inertia = np.diag([1e-3, 0.4, 0.4])
        parts.append(link(f"link_{i}", 5.0, com=(0.5, 0, 0), inertia=inertia))
        axis = np.eye(3)["xyz".index(axis)]
        parts.append(joint(f"joint_{i}", before, f"link_{i}", xyz=(x, 0, 0), axis=axis))
        before, x = f"link_{i}", 1.0
    parts += [frame("tip"), joint("to_tip", before, "tip", "fixed", xyz=(1.0, 0, 0), inside="")]
    return load_text(robot(*parts), tip="tip", task="pose")


@pytest.mark.slow
def test_an_arm_with_joints_in_one_line_is_told_that_it_cannot_do_the_task():
    with pytest.raises(sa.NoSolutionError, match="no joint that moves the tip in some direction"):
        sa.plan(rods("xzxxxyx").at(np.full(7, 0.4)), sa.Joints(np.full(7, 0.5)))
    plan = sa.plan(rods("xzyxzyx").at(np.full(7, 0.4)), sa.Joints(np.full(7, 0.5)))
    assert plan.certificate is None or plan.certificate.free
