"""The singular set of an arm, of the kind that exists for it: exact, or found by a search.

A redundant arm loses rank where n - k + 1 equations hold (`lose_rank`). Where its minors give no
exact set these are solved from many starts, so that singular configurations may be missed. That a
path is free of them can be proven all the same, by minors (`Minors`) or by momenta
(`regularity`).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from spacearm.arrays import Array, Progress, whole
from spacearm.errors import NoSolutionError, UnsupportedError
from spacearm.mechanics.distance import led_near, lose_rank
from spacearm.model.arguments import BaseMode, impossible, require_possible
from spacearm.model.arm import SpaceArm
from spacearm.polynomial.certificate import Certificate
from spacearm.polynomial.jets import Chart
from spacearm.polynomial.triangle import Triangle
from spacearm.polynomial.trig import NotPolynomialError
from spacearm.polynomial.tubes import straight
from spacearm.signatures import checked
from spacearm.singularities import polynomials
from spacearm.singularities.abstract_set import (
    SingularSet,
    check_sampled,
    path_rows,
    prove_clear,
    prove_free,
)
from spacearm.singularities.exact_set import ExactSet
from spacearm.singularities.nearest import NearestSingular, search_and_proof
from spacearm.singularities.regularity import has_momenta, prove_by_momenta

#: Starts after which a search ends, and how many more each one found is worth.
FRUITLESS, EACH = 100, 20


@checked
@dataclass(frozen=True, eq=False, repr=False)
class FoundSet(SingularSet):
    """Singular configurations found by a search: of arms whose minors form no triangle.

    These are arms with mimic joints, most redundant arms with other tasks than the full pose,
    redundant arms of special build that are not free-floating, and arms whose determinant of J* is
    lost in rounding. `sample` and `nearest` return what the search finds. `is_free` and `clearance`
    prove paths free of all singular configurations, found or not. All other methods raise
    `UnsupportedError`.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
    """

    #: Other singular configurations may exist beside those found.
    complete = False

    def _unsupported(self, *_: object, **__: object) -> NoReturn:
        """Raise UnsupportedError: the set is not known as a whole, and why."""
        raise UnsupportedError(
            f"{self.arm.name}: {why_incomplete(self.arm)}; a FoundSet has only .sample, .nearest, "
            ".is_free and .clearance"
        )

    roots = solve = curves = surface = components = _unsupported

    S = relevant = dimension = property(_unsupported)

    @property
    def codimension(self) -> int:
        """Number of equations that singular configurations fulfil, as a rule."""
        return self.arm.n - self.arm.task.k + 1

    def __repr__(self) -> str:
        return f"FoundSet({self.arm.label}, {self.mode}: by search, may miss configurations)"

    def sample(self, m: int, rng: np.random.Generator | None = None) -> Array:
        """Search for m singular configurations (m, n) from uniform starts, of no set distribution.

        Raises:
            ConfigurationError: m is not a whole number from 0 on.
            NoSolutionError: None of the starts, 100 and 20 more for each singular configuration
                found, leads to a further one; carries those found.
        """
        m, rng = whole(m, "m", 0), rng or np.random.default_rng()
        check_sampled(self.arm, m)
        found, starts, chart = list[Array](), 0, polynomials.chart_of(self.arm)
        while len(found) < m:
            if starts >= FRUITLESS + EACH * len(found):
                raise NoSolutionError(
                    f"{self.arm.name}: {len(found)} of {m} singular configurations found from "
                    f"{starts} starts; there may be few or none, as they fulfil {self.codimension} "
                    f"equations in {self.arm.n} joint positions",
                    found,
                )
            drawn = chart.draw(rng, min(m - len(found), EACH))
            for start in led_near(self.arm, drawn, self.mode, m):
                q, starts = lose_rank(self.arm, start, self.mode), starts + 1
                if q is not None:
                    found.append(q)
        return np.array(found).reshape(m, self.arm.n)


def why_incomplete(arm: SpaceArm) -> str:
    """Say why the singular set of an arm is not known as a whole."""
    if arm.coupling is not None:
        return polynomials.MIMIC
    k, n = arm.task.k, arm.n
    if n == k and arm.slides.any():
        return (
            "the determinant of J* is no polynomial that can be used, because joints slide too far "
            "or it has too many coefficients; set nearer limits of sliding joints with "
            "arm.replace(lower=, upper=), or lock joints"
        )
    if n == k:
        return polynomials.lost_in_rounding(arm, "the determinant of J*")
    return (
        f"{n} joints for {k} task rows ({arm.task.names}): the minors of J* do not give "
        f"the singular set joint by joint; {polynomials.to_square(arm)}"
    )


@checked
def singular_set(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> SingularSet:
    """Return the set of all singular configurations of an arm.

    Args:
        arm: The arm.
        mode: What the spacecraft does; see `generalized_jacobian`. Attitude-controlled and fixed
            spacecraft have singular sets of their own.

    Returns:
        The whole set, exactly (`complete` is true), for arms with as many joints as task rows. The
        same for redundant arms with six rows of the full pose or "x y rz" in the plane, and for
        others whose minors form a triangle, as `Minors.triangle` checks. For other redundant arms,
        for mimic joints, and where masses differ so much that the determinant is lost in rounding,
        a `FoundSet`: its `sample` and `nearest` return what a search finds; its `is_free` is still
        a proof.

    Raises:
        UnsupportedError: The arm can never do its task.

    Example:
        >>> import spacearm as sa
        >>> found = sa.singular_set(sa.load("planar2"))
        >>> found.complete, found.roots([0.3, 0.0], "joint_2").angles.round(4)
        (True, array([-3.0748,  0.0841]))
    """
    require_possible(arm, mode)
    k, n = arm.task.k, arm.n
    turns = not arm.slides.any() and arm.coupling is None
    if n == k and turns:
        try:
            S = polynomials.singularity_polynomial(arm, mode=mode)
        except NotPolynomialError:  # lost in rounding
            return FoundSet(arm, mode)
        joint = min(reversed(range(n)), key=lambda j: S.degrees[j] or S.coefficients.size)
        return ExactSet(arm, mode, Triangle((S,), (joint,)), Chart.turning(n))
    with suppress(UnsupportedError):  # no minors, or some of them are little more than rounding
        minors = polynomials.minors_of(arm, mode)
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

    None where J* has no minors of a size that could be used, and the arm has several tips or a
    sliding joint, or does not float.

    Raises:
        UnsupportedError: The arm can never do its task.
    """
    require_possible(arm, mode)
    redundant = arm.n > arm.task.k and polynomials.has_minors(arm)
    with suppress(UnsupportedError):
        if redundant:
            minors = polynomials.minors_of(arm, mode)
            if minors.few:
                proof = prove_free(arm, mode, minors.few, q, limits=False, progress=progress)
                if proof.free:
                    return proof
            return prove_free(arm, mode, minors.every(), q, limits=False, progress=progress)
    if redundant and has_momenta(arm, mode):  # these cost less than minors so large
        proof = prove_by_momenta(arm, straight(path_rows(arm, q)), progress)
        if proof.free:
            return proof
    with suppress(UnsupportedError):
        return singular_set(arm, mode=mode).clearance(q, progress=progress)
    return None


def prove_way(
    arm: SpaceArm, mode: BaseMode, way: Array, at_least: float = 0.0
) -> Certificate | None:
    """Return the proof that no singular configuration is nearer to a way, as `prove_clear`.

    Without minors of J* of a size that could be used, that the way itself meets none; None where
    that has no proof either, as `prove_regular`.
    """
    for clearance in dict.fromkeys((at_least, 0.0)):
        with suppress(UnsupportedError):
            return prove_clear(arm, mode, way, clearance)
    return None


def nearest_on_way(
    arm: SpaceArm,
    mode: BaseMode,
    way: Array,
    progress: Progress | None = None,
    proven: bool = True,
) -> NearestSingular | None:
    """Find the singular configuration nearest to a way, as `SingularSet.nearest`; None if none was.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        way: (m, d, n) control points, as for `nearest_singular`.
        progress: As in `SingularSet.nearest`.
        proven: Whether to prove that none is nearer.
    """
    return search_on_way(arm, mode, way, progress, proven)[0]


def search_on_way(
    arm: SpaceArm,
    mode: BaseMode,
    way: Array,
    progress: Progress | None = None,
    proven: bool = True,
) -> tuple[NearestSingular | None, float]:
    """Find what `nearest_on_way` returns, and how far no singular configuration is [rad].

    An arm that can never do its task is singular where it is.

    Args:
        arm: The arm.
        mode: As of `nearest_on_way`.
        way: As of `nearest_on_way`.
        progress: As of `nearest_on_way`.
        proven: As of `nearest_on_way`.
    """
    if impossible(arm, mode):
        q = way[0, 0]
        return NearestSingular(arm, mode, q, False, q, 0.0, 0.0), 0.0
    minors = polynomials.proving_minors(arm, mode) if proven else ()
    return search_and_proof(arm, mode, way, minors=minors, progress=progress)
