"""The singular set of an arm, of the kind that exists for it."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import NoSolutionError, UnsupportedError
from spacearm.mechanics.blocks import Progress
from spacearm.model.arguments import BaseMode, of_arm
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.polynomial.certificate import Certificate
from spacearm.polynomial.jets import Chart
from spacearm.polynomial.triangle import Triangle
from spacearm.singularities.abstract_set import SingularSet
from spacearm.singularities.closest import nearest_singular
from spacearm.singularities.exact_set import ExactSet
from spacearm.singularities.free_paths import prove_free
from spacearm.singularities.minors import has_minors, minors_of
from spacearm.singularities.polynomial import singularity_polynomial
from spacearm.singularities.searched_set import FoundSet


@of_arm
def singular_set(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> SingularSet:
    """Return the set of all singular configurations of an arm.

    Args:
        arm: The arm.
        mode: What the spacecraft does; see `generalized_jacobian`. Attitude-controlled and fixed
            spacecraft have singular sets of their own.

    Returns:
        The whole set, exactly (`complete` is true), for arms with as many joints as task rows, for
        redundant arms with six rows of the full pose or "x y rz" in the plane, and for others whose
        minors form a triangle, as `Minors.triangle` checks. For other redundant arms and for mimic
        joints a `FoundSet`: its `sample` and `nearest` return what a search finds; its `is_free`
        proves paths free of all.

    Raises:
        UnsupportedError: The arm can never do its task.

    Example:
        >>> import spacearm as sa
        >>> found = sa.singular_set(sa.load("planar2"))
        >>> found.complete, found.roots([0.3, 0.0], "joint_2").angles.round(4)
        (True, array([-3.0748,  0.0841]))
    """
    k, n = arm.task.k, arm.n
    turns = not arm.slides.any() and arm.coupling is None
    if n < k or (n == k and turns):
        S = singularity_polynomial(arm, mode=mode)
        joint = min(reversed(range(n)), key=lambda j: S.degrees[j] or S.coefficients.size)
        return ExactSet(arm, mode, Triangle((S,), (joint,)), Chart.turning(n))
    if has_minors(arm):
        minors = minors_of(arm, mode)
        if minors.triangle is not None:
            return ExactSet(arm, mode, minors.triangle, minors.chart, minors.sifted)
    return FoundSet(arm, mode)


def prove_regular(
    arm: SpaceArm,
    q: Array,
    *,
    mode: BaseMode = "free-floating",
    progress: Progress | None = None,
) -> Certificate | None:
    """Return the proof that straight segments through rows q (m, n) meet no singularity.

    For redundant arms a few minors do as a rule, and all of them tell the most; neither needs to
    know whether the singular set is whole.

    None where the minors of J* are no polynomials, as for mimic joints, or too large.
    """
    with suppress(UnsupportedError):
        if arm.n > arm.task.k and has_minors(arm):
            minors = minors_of(arm, mode)
            if minors.few:
                proof = prove_free(arm, mode, minors.few, q, limits=False, progress=progress)
                if proof.free:
                    return proof
            return prove_free(arm, mode, minors.every(), q, limits=False, progress=progress)
    with suppress(UnsupportedError):
        return singular_set(arm, mode=mode).clearance(q, progress=progress)
    return None


def nearest_posture(
    cfg: Configuration, mode: BaseMode, progress: Progress | None = None
) -> tuple[Array | None, float]:
    """Find the singular configuration nearest to cfg, and its distance, as `SingularSet.nearest`.

    Returns:
        (n,) the configuration and its distance [rad]; None and inf if none was found. An arm that
        can never do its task is singular where it is.
    """
    arm, S = cfg.arm, None
    if arm.n < arm.task.k:
        return cfg.q.copy(), 0.0
    if arm.n == arm.task.k:
        with suppress(UnsupportedError):  # sliding or mimic joints, several tips
            S = singularity_polynomial(arm, mode=mode)
    try:
        return nearest_singular(arm, mode, cfg.q, S=S, progress=progress)
    except NoSolutionError:
        return None, np.inf
