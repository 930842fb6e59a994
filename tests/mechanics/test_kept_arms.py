"""Arms that are no longer used are let go, but for the last ones."""

import gc
import weakref

import numpy as np
import pytest

import spacearm as sa
from spacearm.mechanics import arm_kernels
from spacearm.mechanics.arm_kernels import KEPT_ARMS, structure_of


def alive(arms):
    gc.collect()
    return sum(arm() is not None for arm in arms)


def test_few_arms_are_kept_of_many():
    arm = sa.load("planar2")
    seen = []
    for mass in np.linspace(1.0, 2.0, 3 * KEPT_ARMS):
        other = arm.replace(payload=mass)
        structure_of(other)
        arm_kernels._numbers(other, True)
        seen.append(weakref.ref(other))
    del other
    assert 0 < alive(seen) <= KEPT_ARMS + 1


@pytest.mark.slow
def test_few_arms_are_kept_of_many_that_are_queried():
    arm = sa.load("planar2")
    seen = []
    for mass in np.linspace(1.0, 2.0, 3 * KEPT_ARMS):
        other = arm.replace(payload=mass)
        sa.singularity(other.at([0.3, 1.2]))
        sa.evaluate(other, np.full((3, 2), 0.3))
        seen.append(weakref.ref(other))
    del other
    assert 0 < alive(seen) <= KEPT_ARMS + 1
