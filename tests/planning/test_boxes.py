"""Plans through boxes in which no posture is singular."""

import numpy as np
import pytest

import spacearm as sa


@pytest.fixture(scope="module")
def boxes():
    return sa.free_boxes(sa.load("planar2"), share=0.97)


@pytest.mark.slow
def test_boxes_lead_to_joint_positions_that_a_straight_motion_does_not(boxes):
    arm, rng = boxes.arm, np.random.default_rng(0)
    S, singular = sa.singularity_polynomial(arm), sa.singular_set(arm)
    search = sa.Search(method="boxes", boxes=boxes)
    done = 0
    while done < 3:
        q0, q1 = rng.uniform(-3.0, 3.0, (2, 2))
        if S(q0) * S(q1) < 0.0 or singular.is_free(np.array([q0, q1])):
            continue
        if not all(((boxes.lower <= q) & (q <= boxes.upper)).all(axis=1).any() for q in (q0, q1)):
            continue
        plan = sa.plan(arm.at(q0), sa.Joints(q1), search=search)
        assert (plan.method, plan.certificate.free) == ("boxes", True)
        np.testing.assert_allclose(plan.q[-1], q1, atol=1e-12)
        done += 1


def test_boxes_lead_to_joint_positions_alone(boxes):
    search = sa.Search(method="boxes", boxes=boxes, timeout=0.5)
    with pytest.raises(sa.NoSolutionError, match="boxes lead to joint positions"):
        sa.plan(boxes.arm.at([0.3, 1.2]), (0.9, 1.4), search=search)


def test_boxes_of_another_arm_and_no_boxes_are_refused(boxes):
    arm = sa.load("planar2").replace(base_mass=80.0)
    with pytest.raises(sa.ConfigurationError, match="boxes are those of planar2"):
        sa.plan(
            arm.at([0.3, 1.2]), sa.Joints([0.5, 1.0]), search=sa.Search(boxes=boxes, method="boxes")
        )
    with pytest.raises(sa.ConfigurationError, match='method "boxes" needs boxes'):
        sa.Search(method="boxes")
