"""Plans keep the clearance asked for by proof, along what is flown; none is proven that is not."""

import numpy as np
import pytest
from helpers.arms import load_text, random_chain

import spacearm as sa
from spacearm.mechanics.distance import lose_rank
from spacearm.model.joints import joint_scales


def nearest_found(plan, rng, starts=60):
    """Search singular postures about what `sa.Tracking` flies; the distance of the best one."""
    arm, unit, best = plan.arm, joint_scales(plan.arm), np.inf
    flown = np.array([sa.Tracking(plan).wanted(t)[0] for t in np.linspace(0, plan.t[-1], 4000)])
    for _ in range(starts):
        way = rng.normal(size=arm.n)
        start = flown[rng.integers(len(flown))] + unit * 0.3 * rng.uniform() * way
        q = lose_rank(arm, start, plan.mode)
        if q is not None:
            best = min(best, np.linalg.norm((flown - q) / unit, axis=1).min())
    return best


def planned(arm, rng, clearance, far=0.6, **options):
    """Return a plan between random postures of an arm, without collisions."""
    for _ in range(30):
        q = np.clip(rng.uniform(-2, 2, arm.n), arm.lower, arm.upper)
        goal = np.clip(q + rng.uniform(-far, far, arm.n), arm.lower, arm.upper)
        try:
            return sa.plan(
                arm.at(q),
                sa.Joints(goal),
                constraints=sa.Constraints(clearance=clearance, collisions=False),
                search=sa.Search(timeout=10),
                **options,
            )
        except sa.NoSolutionError:
            continue
    raise AssertionError("no plan found")


@pytest.mark.parametrize(
    ("seed", "n", "task", "mode"),
    [
        (1, 3, "position", "free-floating"),
        (2, 4, "position", "free-floating"),
        pytest.param(3, 6, "pose", "attitude-controlled", marks=pytest.mark.slow),
        pytest.param(4, 7, "pose", "free-floating", marks=pytest.mark.slow),
    ],
)
def test_the_clearance_asked_for_is_proven_of_what_is_flown(seed, n, task, mode):
    arm, rng = load_text(random_chain(seed, n), task=task), np.random.default_rng(seed)
    plan = planned(arm, rng, 0.05, mode=mode)
    proof, near = plan.certificate, plan.nearest
    assert proof.free
    assert proof.clearance * (1 + 1e-9) >= 0.05
    assert proof.clearance <= near.distance
    assert nearest_found(plan, rng) >= proof.clearance * (1 - 1e-3)  # flown is sampled
    told = plan.to_dict()
    assert told["certificate"]["clearance"] == told["distance_proven"] == proof.clearance
    assert told["distance"] == near.distance
    facts = dict(plan.describe().tables[-2].rows)
    assert "proven" in facts["clearance"]


def test_no_plan_has_more_clearance_than_its_start():
    arm = sa.load("planar2")
    start = arm.at([0.3, 0.5])
    distance = sa.singular_set(arm).nearest(start.q).distance
    kept = sa.Constraints(clearance=1.01 * distance)
    with pytest.raises(sa.NoSolutionError, match="from the start, and the clearance is"):
        sa.plan(start, (0.9, 1.4), constraints=kept)


@pytest.mark.slow
def test_a_path_has_a_nearest_singular_posture():
    """Of planar2 in closed form: the set is known along each line."""
    arm = sa.load("planar2")
    found = sa.singular_set(arm)
    plan = sa.plan(arm.at([0.3, 1.2]), (0.9, 1.4))
    near = found.nearest(plan)
    assert near.distance == pytest.approx(plan.nearest.distance, rel=1e-12)
    flown = np.array([sa.Tracking(plan).wanted(t)[0] for t in np.linspace(0, plan.t[-1], 500)])
    curves = np.vstack(found.curves(resolution=0.01))
    gaps = [np.linalg.norm((curves - q + np.pi) % (2 * np.pi) - np.pi, axis=1) for q in flown]
    assert near.distance == pytest.approx(np.min(gaps), abs=3e-3)
    assert near.distance_proven >= near.distance - 2e-4
    assert found.is_free(plan, clearance=0.99 * near.distance).clearance == 0.99 * near.distance
    assert not found.is_free(plan, clearance=1.01 * near.distance)
    rows = found.nearest(plan.q)  # straight between them
    assert rows.distance == pytest.approx(near.distance, abs=1e-3)
