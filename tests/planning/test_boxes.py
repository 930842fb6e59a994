"""Plans through boxes in which no posture is singular."""

import numpy as np
import pytest
from helpers.arms import chosen

import spacearm as sa
from spacearm.mechanics.floating import walk
from spacearm.planning.problem import Problem
from spacearm.planning.request import PlanRequest
from spacearm.planning.tree import Tree


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


@pytest.mark.slow
def test_boxes_lead_to_points_from_starts_beside_them():
    """A goal is where the tip comes by a random way on one side, so that there is a plan."""
    arm, rng = sa.load("planar2"), chosen(3)
    boxes, beside = sa.free_boxes(arm, share=0.7), 0
    search = sa.Search(method="boxes", boxes=boxes)
    while beside < 2:
        way = rng.uniform(-2.5, 2.5, 2) + np.linspace(0.0, 1.0, 40)[:, None] * rng.normal(size=2)
        at = sa.evaluate(arm, way, ["distance"])
        if np.abs(way).max() > 3.0 or at["distance"].min() < 0.05:
            continue
        if ((boxes.lower <= way[0]) & (way[0] <= boxes.upper)).all(axis=1).any():
            continue
        beside += 1
        start = arm.at(way[0])
        goal = walk(start, way)[-1].tip
        plan = sa.plan(start, goal, search=search)
        assert (plan.method, plan.certificate.free) == ("boxes", True)
        np.testing.assert_allclose(plan[-1].tip.translation[:2], goal.translation[:2], atol=1e-6)


def test_a_shortened_motion_ends_at_the_joint_positions_asked_for():
    """Variants of a motion to joint positions move every corner but its ends."""
    arm = sa.load("planar2")
    start, q = arm.at([0.3, 1.2]), np.array([1.1, 0.8])
    asked = PlanRequest.of(
        start, sa.Joints(q), "spacecraft", sa.Constraints(), sa.Search(), (), None, None
    )
    problem = Problem.of(asked)
    tree = Tree(problem.guesses(start, problem.target), problem.collisions)
    variants = tree._variants(np.array([start.q, [0.5, 1.6], q]))
    assert (variants[:, 0] == start.q).all()
    assert (variants[:, -1] == q).all()
    assert np.ptp(variants[:, 1], axis=0).min() > 0.0


def test_boxes_of_another_arm_and_no_boxes_are_refused(boxes):
    arm = sa.load("planar2").replace(base_mass=80.0)
    with pytest.raises(sa.ConfigurationError, match="boxes are those of planar2"):
        sa.plan(
            arm.at([0.3, 1.2]), sa.Joints([0.5, 1.0]), search=sa.Search(boxes=boxes, method="boxes")
        )
    with pytest.raises(sa.ConfigurationError, match='method "boxes" needs boxes'):
        sa.Search(method="boxes")
