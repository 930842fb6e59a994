"""The nearest singular point as an equation, against the search that lands and settles."""

import numpy as np
import pytest

import spacearm as sa
from spacearm.compiler import numbers
from spacearm.equations.measures import nearest
from spacearm.mechanics.arm_kernels import ArmKernel, parameters_of, structure_of
from spacearm.mechanics.distance import FADING, distance_at
from spacearm.model.joints import joint_scales
from spacearm.singularities.nearest import nearest_locally

MODE = "free-floating"


def found_by(arm, Q, between, rest=1e-13):
    """What the equation gives for configurations Q (m, n), compiled, and of the first by NumPy."""
    unit = joint_scales(arm)
    shared = {"fading": FADING, "radians": unit, "between": np.array(between), "rest": rest}
    kernel = ArmKernel([arm], MODE, nearest, {"most": 40})
    found = kernel({"q": Q}, shared)
    tree, p = structure_of(arm, MODE), parameters_of(arm)
    with np.errstate(all="ignore"):
        one = nearest(numbers, tree, p, q=Q[0], most=40, **shared)
    np.testing.assert_allclose(found[0], one, rtol=0.0, atol=1e-10)
    return found


@pytest.mark.parametrize(("name", "task"), [("planar3", "x y"), ("chaser7", "pose")])
def test_the_nearest_point_is_that_of_the_search(name, task):
    arm, rng = sa.load(name, task=task), np.random.default_rng(4)
    Q = rng.uniform(-2.0, 2.0, (12, arm.n))
    on_it = [s[0] for q in Q if (s := nearest_locally(arm, MODE, q)) is not None]
    near = np.array([q + 0.01 * rng.normal(size=arm.n) / np.sqrt(arm.n) for q in on_it])
    known = [nearest_locally(arm, MODE, q) for q in near]
    found = found_by(arm, near, (0.0, 1.0))
    rests = found[:, 1] <= 1e-13
    assert rests.mean() > 0.8
    for q, (point, far), row in zip(near[rests], np.array(known, dtype=object)[rests], found[rests],
                                    strict=True):  # fmt: skip
        assert row[0] == pytest.approx(far, abs=1e-10)
        np.testing.assert_allclose(q + joint_scales(arm) * row[2:], point, rtol=0.0, atol=1e-7)


def test_where_it_is_not_wanted_the_distance_is_that_to_first_order():
    arm = sa.load("planar3", task="x y")
    Q = np.array([[0.2, 0.6, -0.4], [0.3, 1.2, 0.5]])
    found = found_by(arm, Q, (np.inf, 0.0))
    first = [distance_at(arm.at(q), MODE, None) for q in Q]
    np.testing.assert_allclose(found[:, 0], first, rtol=1e-9, atol=1e-12)
    assert not found[:, 1].any()
