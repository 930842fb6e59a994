"""The singular set of an arm, of the kind that exists for it."""

from __future__ import annotations

from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.singularities.abstract_set import SingularSet
from spacearm.singularities.exact_set import ExactSet
from spacearm.singularities.polynomial import singularity_polynomial
from spacearm.singularities.searched_set import FoundSet


def singular_set(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> SingularSet:
    """Return the set of all singular configurations of an arm.

    Args:
        arm: The arm.
        mode: What the spacecraft does; see `generalized_jacobian`. Attitude-controlled and fixed
            spacecraft leave the kinematic singularities only.

    Returns:
        The whole set, exactly (`complete` is true), for an arm with as many revolute joints as
        task rows. For redundant arms and arms with prismatic or mimic joints a `FoundSet`: its
        `sample` and `nearest` return what a search finds.

    Raises:
        UnsupportedError: The arm can never do its task.
    """
    turns = not arm.slides.any() and arm.coupling is None
    if arm.n >= arm.task.k and not (arm.n == arm.task.k and turns):
        return FoundSet(arm, mode)
    return ExactSet(arm, mode, singularity_polynomial(arm, mode=mode))
