"""Questions to arms that are known in intervals only: distances, free paths, shells, plans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, within_100
from spacearm.errors import ConfigurationError, NoSolutionError, listed
from spacearm.model.arm import Configuration
from spacearm.model.joints import joint_vector
from spacearm.motion.goal import Goal, Origin
from spacearm.planning.planner import plan
from spacearm.planning.request import Constraints, Joints, Search
from spacearm.planning.result import Plan
from spacearm.polynomial.certificate import certify
from spacearm.polynomial.jets import Jets
from spacearm.results import Cell, Column, Description, Measure, Result, Table, Tone
from spacearm.signatures import checked
from spacearm.singularities.abstract_set import path_rows
from spacearm.singularities.polynomials import check_square, singularity_polynomial
from spacearm.singularities.report import singularity
from spacearm.uncertainty.family import Family, family_of
from spacearm.uncertainty.intervals import UncertainArm
from spacearm.workspaces.path_dependent import workspace
from spacearm.workspaces.shells import merged, without

SAMPLES = 200
"""Default number of random arms."""
MOST_CORNERS, MOST_CORNERS_OF_SHELLS = 8, 5
"""Parameters up to which all corners of the box are tried, for distances and for shells."""
MOST_BOXES = 400
"""Boxes of parameters that a proof may look at."""
CLEARANCES = (0.1, 1.0, 2.0, 4.0, 7.0, 11.0, 16.0)
"""Clearances that are asked of plans, one after the other, until one is robust [deg]."""


@checked
@dataclass(frozen=True, eq=False, repr=False)
class DistanceRange(Result):
    """The distance to the singular set over all arms tried, to first order.

    Each is `sa.singularity(cfg).distance` of its arm: near the singular set the distance, far away
    a hint. The range is no bound, except where an arm is `singular`.

    Attributes:
        nominal: That of the arm as described [rad].
        low: The least [rad]; 0 where `singular`.
        high: The largest [rad].
        singular: Whether det(J*) changes its sign between two arms tried: an arm between them is
            singular. False says nothing.
        least: The values at which it is least, by name; those of that arm where `singular`.
        distances: (m,) those of all arms tried, random ones first [rad].
        tried: Number of arms tried; between them it may be less or more.
        random: How many of them are random, as the distributions have it.
        immaterial: Names of the uncertain numbers on which no singular configuration depends, and
            so no distance; they stay as described.
    """

    nominal: float
    low: float
    high: float
    singular: bool
    least: dict[str, float]
    distances: Array
    tried: int
    random: int
    immaterial: tuple[str, ...]

    def percentile(self, share: float) -> float:
        """Return the distance that so many per cent of the random arms do not exceed [rad].

        Raises:
            ConfigurationError: The share is none from 0 to 100.
        """
        shares = within_100(share, "share")
        return float(np.percentile(self.distances[: self.random], shares))

    def describe(self) -> Description:
        """Describe the range, and the values at which the distance is least."""
        low, high, nominal = np.degrees([self.low, self.high, self.nominal])
        least = "0°, an arm between is singular," if self.singular else f"{low:.4g}°"
        facts: dict[str, Cell] = {
            "as described, to first order": Measure(self.nominal, "rad"),
            "least found": Measure(self.low, "rad"),
            "det(J*) changes its sign": self.singular,
            "largest, to first order": Measure(self.high, "rad"),
            **{f"least with {name}": value for name, value in self.least.items()},
        }
        if self.immaterial:
            facts["whatever the"] = listed(self.immaterial)
        return Description(
            title=f"distance to the singular set of {self.tried:,} arms",
            verdict=f"{least} to {high:.4g}°, {nominal:.4g}° as described, to first order",
            tables=[Table.facts(facts)],
        )


@checked
@dataclass(frozen=True, eq=False, repr=False)
class RobustCertificate(Result):
    """Whether a path meets no singularity, for all values in the intervals.

    Attributes:
        free: Whether it is free for all of them: proven, rounding included.
        verdict: "free"; "singular": at the values `values` S changes sign at `at`, which is proven;
            "undecided": the boxes of `MOST_BOXES` did not decide.
        values: The counterexample, by name, without `immaterial`; None unless singular.
        at: (n,) where on the path that arm is singular; None unless singular.
        boxes: Number of boxes of parameters looked at.
        immaterial: Names of the uncertain numbers on which no singular configuration depends; the
            verdict holds for any value of theirs (see `UncertainArm.relevant`).
    """

    free: bool
    verdict: str
    values: dict[str, float] | None
    at: Array | None
    boxes: int
    immaterial: tuple[str, ...]

    def __bool__(self) -> bool:
        return self.free

    def describe(self) -> Description:
        """Describe the verdict, and the counterexample where there is one."""
        facts: dict[str, Cell] = {"boxes of parameters": self.boxes, **(self.values or {})}
        if self.at is not None:
            facts["joint positions there [rad]"] = self.at
        if self.immaterial:
            facts["whatever the"] = listed(self.immaterial)
        with_ = ", ".join(f"{name} {value:.5g}" for name, value in (self.values or {}).items())
        tones: dict[str, Tone] = {"free": "good", "singular": "bad"}
        return Description(
            title="path for all values in the intervals",
            verdict=self.verdict + (f" with {with_}" if with_ else ""),
            tone=tones.get(self.verdict, "caution"),
            tables=[Table.facts(facts)],
        )


@checked
def distance_range(
    uncertain: UncertainArm, q: npt.ArrayLike, *, samples: int = SAMPLES, seed: int = 0
) -> DistanceRange:
    """Compute the range of the distance to the singular set over arms from the intervals.

    The arms are random ones, and those with all parameters at ends of their intervals if there are
    up to 8 parameters. Their distances are those of `singularity`, to first order, and the true
    range may be wider. It begins at 0 where det(J*) changes its sign between two of them.

    Numbers of the last link and of what it holds stay as described where the task is the full pose:
    the distance does not depend on them.

    Args:
        uncertain: The arm; see `uncertain`.
        q: (n,) joint positions [rad] or [m].
        samples: Number of random arms.
        seed: Of these.

    Returns:
        The least and the largest distance, and the values with the least.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> about = sa.uncertain(arm, {"link_1": {"mass": 0.1}})
        >>> found = sa.distance_range(about, np.radians([-65, 30]), samples=10)
        >>> found.low < found.nominal < found.high
        True
    """
    arm, immaterial = uncertain.arm, uncertain.beside(uncertain.relevant())
    q, uncertain = joint_vector(arm, q, "q"), uncertain.relevant()
    samples = samples if uncertain.parameters else 1
    shares = uncertain.tried(samples, seed, MOST_CORNERS)
    reports = [singularity(uncertain.realise(t).at(q)) for t in shares]
    found = np.array([report.distance for report in reports])
    nominal = float(singularity(arm.at(q)).distance)
    least, low = shares[int(np.argmin(found))], min(nominal, float(found.min()))
    values = np.array([report.determinant or 0.0 for report in reports])
    singular = bool(arm.n == arm.task.k and values.min() <= 0.0 <= values.max())
    if singular:
        least, low = _singular_between(uncertain, q, shares, values), 0.0
    return DistanceRange(
        nominal=nominal,
        low=low,
        high=max(nominal, float(found.max())),
        singular=singular,
        least=uncertain.named(least),
        distances=found,
        tried=len(found),
        random=samples,
        immaterial=immaterial,
    )


def _singular_between(uncertain: UncertainArm, q: Array, shares: Array, values: Array) -> Array:
    """Return the shares (p,) of a singular arm between the two of least and largest det(J*)."""
    from scipy.optimize import brentq  # slow to import

    low, high = shares[int(np.argmin(values))], shares[int(np.argmax(values))]

    def determinant(s: float) -> float:
        return singularity(uncertain.realise(low + s * (high - low)).at(q)).determinant or 0.0

    return low + float(brentq(determinant, 0.0, 1.0)) * (high - low)


@checked
def is_free_for_all(uncertain: UncertainArm, path: npt.ArrayLike) -> RobustCertificate:
    """Prove that a path in joint space meets no singularity, for all values in the intervals.

    S is a polynomial of the parameters; its Bernstein coefficients over the box are trigonometric
    polynomials of the joints, between which S lies. The path is free if they all keep one sign on
    it; else the box is halved. A corner at which S changes sign is a counterexample.

    Numbers of the last link and of what it holds are left out where the task is the full pose: the
    proof holds for any value of theirs.

    Args:
        uncertain: An arm of revolute joints, as many as its task has rows.
        path: (m, n) joint positions, joined by straight segments.

    Returns:
        The proof, or values for which the path is singular.

    Raises:
        UnsupportedError: The arm has no singularity polynomial, or too many numbers are uncertain
            for the proof.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> about = sa.uncertain(arm, {"link_1": {"mass": 0.1}})
        >>> sa.is_free_for_all(about, np.radians([[-65, 30], [20, 60]])).free
        True
    """
    rows = path_rows(uncertain.arm, path)
    check_square(uncertain.arm)
    relevant = uncertain.relevant()
    return replace(_decided(relevant, rows), immaterial=uncertain.beside(relevant))


def _decided(uncertain: UncertainArm, rows: Array) -> RobustCertificate:
    """Prove that no value of the numbers makes a path through rows (m, n) singular."""
    if not uncertain.parameters:
        proof = certify([Jets.of(singularity_polynomial(uncertain.arm))], rows)
        if proof.verdict == "singular":
            return RobustCertificate(False, "singular", {}, proof.at, 0, ())
        return RobustCertificate(proof.free, proof.verdict, None, None, 0, ())
    open_, looked = [family_of(uncertain)], 0
    while open_ and looked < MOST_BOXES:
        box = open_.pop()
        looked += 1
        proofs = [certify([jets], rows) for jets in box.jets()]
        numbers, corners = box.corners()
        for number, corner in zip(numbers, corners, strict=True):
            if proofs[number].verdict == "singular":
                at = proofs[number].at
                return RobustCertificate(False, "singular", uncertain.named(corner), at, looked, ())
        signs = {bool(f(rows[0]) > 0.0) for f in box.control}
        ends = {bool(box.control[number](rows[0]) > 0.0) for number in numbers}
        if all(proofs) and len(signs) == 1:
            continue
        if len(ends) == 2:  # S changes sign at the start itself, between two corners
            return _at_start(box, uncertain, rows[0], looked)
        open_ += box.halves(int(np.argmax(box.high - box.low)))
    verdict = "undecided" if open_ else "free"
    return RobustCertificate(not open_, verdict, None, None, looked, ())


def _at_start(box: Family, uncertain: UncertainArm, q: Array, looked: int) -> RobustCertificate:
    """Return the values between two corners for which the start of a path is singular."""
    numbers, corners = box.corners()
    values = [box.control[number](q) for number in numbers]
    low, high = corners[int(np.argmin(values))], corners[int(np.argmax(values))]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if box(q, middle[None])[0] < 0.0 else (low, middle)
    return RobustCertificate(False, "singular", uncertain.named(low), q.copy(), looked, ())


@checked
def robust_plan(
    uncertain: UncertainArm,
    start: Configuration,
    goal: Goal | Joints,
    *,
    via: Sequence[Goal | Joints] = (),
    final_attitude: npt.ArrayLike | pin.SE3 | float | None = None,
    duration: float | None = None,
    origin: Origin = "spacecraft",
    constraints: Constraints = Constraints(),
    search: Search = Search(),
) -> tuple[Plan, RobustCertificate]:
    """Plan a motion that meets no singularity, for all values in the intervals.

    It is planned for the arm as described, with growing clearance until the proof holds. The joints
    then move as planned whatever the values are; where the tip and the spacecraft come to does
    depend on them, and is not made robust.

    Args:
        uncertain: An arm of revolute joints, as many as its task has rows.
        start: Where it begins, a configuration of `uncertain.arm`.
        goal: As for `plan`; so are the others.
        via: Goals on the way.
        final_attitude: Attitude of the spacecraft at the end.
        duration: When the motion ends [s].
        origin: Where the inertial frame has its origin.
        constraints: What must hold; the clearance asked for is the least that is tried.
        search: How to look for each plan, and for how long.

    Returns:
        The plan and the proof.

    Raises:
        ConfigurationError: The start is of another arm, or an argument does not make sense.
        NoSolutionError: No plan was found, or none that holds for all values: carries the last.

    Example:
        >>> import spacearm as sa
        >>> about = sa.uncertain(sa.load("planar2"), {"link_2": {"mass": 0.1}})
        >>> plan, proof = sa.robust_plan(about, about.arm.at([0.3, 1.2]), sa.Joints([0.6, 0.9]))
        >>> proof.free
        True
    """
    if not isinstance(start, Configuration) or start.arm is not uncertain.arm:
        raise ConfigurationError(
            "start is no configuration of the uncertain arm; make it by uncertain.arm.at(q)"
        )
    last: Plan | None = None
    for clearance in CLEARANCES:
        least = max(float(np.radians(clearance)), constraints.clearance or 0.0)
        try:
            last = plan(
                start,
                goal,
                via=via,
                final_attitude=final_attitude,
                duration=duration,
                origin=origin,
                constraints=replace(constraints, clearance=least),
                search=search,
            )
        except NoSolutionError:
            break
        proof = is_free_for_all(uncertain, last.q)
        if proof:
            return last, proof
    raise NoSolutionError(
        f"{uncertain.arm.name}: no plan with a clearance up to {CLEARANCES[-1]:g}° is free of "
        "singularities for all values in the intervals; narrow them, or go elsewhere",
        last,
    )


@checked
@dataclass(frozen=True, eq=False, repr=False)
class ShellBands(Result):
    """The path dependent workspace over all arms tried.

    Attributes:
        low: (k, 2) inner bound of each shell, its least and largest value [m].
        high: (k, 2) outer bound of each shell, likewise [m].
        always: (a, 2) distances from the system CM that are path dependent for all arms tried [m].
        sometimes: (b, 2) those that are for some [m].
        tried: Number of arms tried.
    """

    low: Array
    high: Array
    always: Array
    sometimes: Array
    tried: int

    def describe(self) -> Description:
        """Describe in which bands the bounds of each shell lie."""
        number = len(self.low)
        bands = {
            Column("inner bound from", "m", ".4f"): self.low[:, 0],
            Column("inner bound to", "m", ".4f"): self.low[:, 1],
            Column("outer bound from", "m", ".4f"): self.high[:, 0],
            Column("outer bound to", "m", ".4f"): self.high[:, 1],
        }
        return Description(
            title=f"path dependent workspace of {self.tried:,} arms",
            verdict=f"{number} shells" if number else "shells of different number",
            tables=[Table.by_columns(bands)],
        )


@checked
def shell_bands(uncertain: UncertainArm, *, samples: int = 50, seed: int = 0) -> ShellBands:
    """Compute the bands in which the shells of the path dependent workspace lie.

    Each arm's shells are computed as by `workspace`; the bands are those of the arms tried.

    Args:
        uncertain: An arm with as many revolute joints as its task has rows.
        samples: Number of random arms; the corners of up to 5 parameters are tried besides.
        seed: Of these.

    Returns:
        The bands, and what is path dependent for all arms tried and for some.

    Raises:
        UnsupportedError: The arm has no shells; see `workspace`.

    Example:
        >>> import spacearm as sa
        >>> about = sa.uncertain(sa.load("planar2"), {"link_2": {"mass": 0.1}})
        >>> len(sa.shell_bands(about, samples=1).low)
        2
    """
    shares = uncertain.tried(samples, seed, MOST_CORNERS_OF_SHELLS)
    found = [workspace(uncertain.arm).pdw]
    found += [workspace(uncertain.realise(t)).pdw for t in shares]
    numbers = {len(pdw) for pdw in found}
    bounds: Any = np.array(found) if len(numbers) == 1 else np.zeros((1, 0, 2))
    low, high = np.stack((bounds.min(axis=0), bounds.max(axis=0)), axis=2).swapaxes(0, 1)
    sometimes = merged([shell for pdw in found for shell in pdw])
    gaps = merged([gap for pdw in found for gap in without(sometimes, pdw)])
    return ShellBands(
        low=low,
        high=high,
        always=without(sometimes, gaps),
        sometimes=sometimes,
        tried=len(found),
    )
