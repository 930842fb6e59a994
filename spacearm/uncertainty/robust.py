"""Questions about arms known only in intervals: distances, free paths, shells, plans."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, Progress, counted, within
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError, listed
from spacearm.model.arguments import FLOATING, require_possible
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.joints import joint_vector
from spacearm.motion.goal import Goal, Origin
from spacearm.planning.account import SHORTEST, SearchAccount, TimeUpError
from spacearm.planning.planner import plan
from spacearm.planning.request import Constraints, Joints, Search
from spacearm.planning.result import Plan
from spacearm.results import Cell, Column, Description, Measure, Result, Table, Tone
from spacearm.signatures import checked
from spacearm.singularities.abstract_set import Path, control_points
from spacearm.singularities.nearest import angle
from spacearm.singularities.regularity import Finding, look
from spacearm.singularities.sets import nearest_on_way
from spacearm.uncertainty.intervals import UncertainArm
from spacearm.workspaces.path_dependent import workspace
from spacearm.workspaces.shells import exact_set, merged, without

#: Default number of random arms.
SAMPLES = 200
#: Parameters up to which all corners of the box are tried, for distances and for shells.
MOST_CORNERS, MOST_CORNERS_OF_SHELLS = 8, 5
#: How often nearer ends of all parameters are looked for where not all corners are tried.
ROUNDS = 3
#: Clearances that are asked of plans, one after the other, until one is robust [deg].
CLEARANCES = (0.1, 1.0, 2.0, 4.0, 7.0, 11.0, 16.0)


class DistanceRange(Result):
    """How far the singular postures are that were found for arms from the intervals.

    Each distance is that of the nearest singular posture found of one arm, as by
    `SingularSet.nearest`. So an arm from the intervals comes as near as `low` or nearer; others may
    come nearer or stay farther away than those tried.

    Attributes:
        nominal: Distance of the arm as described [rad].
        low: Least distance found [rad]; 0 where `singular`.
        high: Largest distance of the arms tried [rad].
        singular: Whether an arm from the intervals is singular at the posture itself.
        regular: Whether no arm from the intervals is, proven, rounding included. Where neither
            `singular` nor `regular` holds, the question is open.
        least: The values with which the distance is least, by name; where `singular`, those of the
            singular arm.
        distances: (m,) distances of all arms tried, random ones first [rad].
        tried: Number of arms tried.
        random: How many of them are random, drawn from the distributions.
        immaterial: Names of the uncertain numbers on which no singular configuration depends, and
            so no distance; they stay as described.
    """

    nominal: float
    low: float
    high: float
    singular: bool
    regular: bool
    least: dict[str, float]
    distances: Array
    tried: int
    random: int
    immaterial: tuple[str, ...]

    def percentile(self, share: float) -> float:
        """Return the distance that so many per cent of the random arms do not exceed [rad].

        Raises:
            ConfigurationError: The share is not from 0 to 100.
        """
        shares = within(share, "share", 0.0, 100.0)
        return float(np.percentile(self.distances[: self.random], shares))

    not_checked = "joint limits of the singular postures, collisions"

    def describe(self) -> Description:
        """Describe the range, and the values at which the distance is least."""
        low, high, nominal = map(angle, (self.low, self.high, self.nominal))
        itself = "one of the arms is singular at the posture itself"
        if not self.singular:
            known = "ruled out, proven" if self.regular else "NOT ruled out"
            itself = f"that {itself} is {known}"
        facts: dict[str, Cell] = {
            "found, as described": Measure(self.nominal, "rad"),
            "found, least": Measure(self.low, "rad"),
            "found, largest of the arms tried": Measure(self.high, "rad"),
            **{f"least with {name}": value for name, value in self.least.items()},
        }
        if self.immaterial:
            facts["whatever the"] = listed(self.immaterial)
        return Description(
            title=f"singular postures of {self.tried:,} arms",
            verdict=f"found {low} to {high} away, {nominal} as described; {itself}",
            notes=["Arms that were not tried may come nearer or stay farther away."],
            tables=[Table.facts(facts)],
        )


class RobustCertificate(Result):
    """Whether a path meets no singularity, for all values in the intervals.

    Attributes:
        free: Whether the path is free for all values: proven, rounding included.
        verdict: "free"; "singular": with these `values` the arm is singular at `at`; "undecided":
            the budget of the proof ended first.
        values: The counterexample, by name, without `immaterial`; None unless singular.
        at: (n,) where on the path that arm is singular; None unless singular.
        pieces: Number of pieces of path and parameters looked at.
        immaterial: Names of the uncertain numbers on which no singular configuration depends; the
            verdict holds for any of their values (see `UncertainArm.relevant`).
    """

    free: bool
    verdict: str
    values: dict[str, float] | None
    at: Array | None
    pieces: int
    immaterial: tuple[str, ...]

    def __bool__(self) -> bool:
        return self.free

    not_checked = "joint limits, collisions, rates"

    def describe(self) -> Description:
        """Describe the verdict, and the counterexample where there is one."""
        facts: dict[str, Cell] = {
            "pieces of path and parameters": self.pieces,
            **(self.values or {}),
        }
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
    uncertain: UncertainArm,
    q: ArrayLike,
    *,
    samples: int = SAMPLES,
    seed: int = 0,
    progress: Progress | None = None,
) -> DistanceRange:
    """Find how far the nearest singular postures of arms from the intervals are.

    The arms are random ones and, with up to 8 parameters, those with all parameters at ends of
    their intervals; with more parameters it searches for ends that come nearer. The least distance
    found is 0 if an arm is singular at the posture itself. That no arm is singular there is proven
    where possible, as by `is_free_for_all`.

    Numbers of the last link and of what it holds stay as described where the task is the full pose:
    the distance does not depend on them.

    Args:
        uncertain: The arm; see `uncertain`.
        q: (n,) joint positions [rad] or [m].
        samples: Number of random arms.
        seed: Of these.
        progress: Called as progress(done, total) after each arm.

    Returns:
        The least and the largest distance found, and the values that give the least.

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
    more = ROUNDS if len(uncertain.parameters) > MOST_CORNERS else 0
    total = len(shares) + more * (2 * len(uncertain.parameters) + 1)

    def found_of(some: Array, done: int) -> Array:
        tell = progress and (lambda i, _: progress(done + i, total))
        return np.array([_found(uncertain.realise(t), q) for t in counted(some, tell)])

    found = found_of(shares, 0)
    for _ in range(more):  # corners were not tried: towards a nearer one, each parameter by itself
        best, p = shares[int(np.argmin(found))], len(uncertain.parameters)
        ends = np.repeat(best[None], 2 * p, axis=0)
        ends[range(2 * p), np.repeat(np.arange(p), 2)] = np.tile((0.0, 1.0), p)
        values = found_of(ends, len(found))
        corner = values.reshape(p, 2).argmin(axis=1).astype(np.float64)[None]
        shares = np.vstack((shares, ends, corner))
        found = np.concatenate((found, values, found_of(corner, len(found) + 2 * p)))
    nominal = _found(arm, q)
    least, low = shares[int(np.argmin(found))], min(nominal, float(found.min()))
    itself = Finding(False, None, None, 0)
    with suppress(UnsupportedError):  # several tips: it stays open
        itself = look(uncertain, q[None, None])
    if itself.shares is not None:
        least, low = itself.shares, 0.0
    return DistanceRange(
        nominal=nominal,
        low=low,
        high=max(nominal, float(found.max())),
        singular=itself.shares is not None,
        regular=itself.free,
        least=uncertain.named(least),
        distances=found,
        tried=len(found),
        random=samples,
        immaterial=immaterial,
    )


def _found(arm: SpaceArm, q: Array) -> float:
    """Return how far the nearest singular posture found of an arm is [rad]; inf if none was."""
    near = nearest_on_way(arm, FLOATING, q[None, None], proven=False)
    return np.inf if near is None else near.distance


@checked
def is_free_for_all(
    uncertain: UncertainArm, path: Path, *, progress: Progress | None = None
) -> RobustCertificate:
    """Prove that a path in joint space meets no singularity, for all values in the intervals.

    The momenta seen from the tip are enclosed for pieces of the path and all values at once; pieces
    that are not proven are halved, along the path or along a parameter
    (`spacearm.singularities.regularity`). Any number of parameters will do. For arms with as many
    joints as task rows, values for which the path is singular are found by the sign of det(J*).

    Numbers of the last link and of what it holds are left out where the task is the full pose: the
    proof holds for any of their values.

    Args:
        uncertain: An arm with one tip; its sliding joints may not move along the path.
        path: (m, n) joint positions, joined by straight segments; or a motion: of plans the way
            that is flown.
        progress: Called as progress(done, 1000), in thousandths of the path and the intervals.

    Returns:
        The proof, or values for which the path is singular.

    Raises:
        UnsupportedError: The arm has several tips, can never do its task, or a sliding joint moves.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> about = sa.uncertain(arm, {"link_1": {"mass": 0.1}})
        >>> sa.is_free_for_all(about, np.radians([[-65, 30], [20, 60]])).free
        True
    """
    way, relevant = control_points(uncertain.arm, path), uncertain.relevant()
    require_possible(uncertain.arm, FLOATING)
    found = look(relevant, way, progress)
    singular = found.shares is not None
    return RobustCertificate(
        free=found.free,
        verdict="free" if found.free else "singular" if singular else "undecided",
        values=None if found.shares is None else relevant.named(found.shares),
        at=found.at,
        pieces=found.pieces,
        immaterial=uncertain.beside(relevant),
    )


@checked
def robust_plan(
    uncertain: UncertainArm,
    start: Configuration,
    goal: Goal | Joints,
    *,
    via: Sequence[Goal | Joints] = (),
    final_attitude: ArrayLike | pin.SE3 | float | None = None,
    duration: float | None = None,
    origin: Origin = "spacecraft",
    constraints: Constraints = Constraints(),
    search: Search = Search(),
) -> tuple[Plan, RobustCertificate]:
    """Plan a motion that meets no singularity, for all values in the intervals.

    It plans for the arm as described, with growing clearance until the proof holds. The joints then
    move as planned, whatever the values are. Where the tip and the spacecraft arrive depends on the
    values, and is not made robust.

    Args:
        uncertain: An arm with one tip and no sliding joints.
        start: Where it begins, a configuration of `uncertain.arm`.
        goal: As for `plan`, like the arguments below.
        via: Goals on the way.
        final_attitude: Attitude of the spacecraft at the end.
        duration: When the motion ends [s].
        origin: Where the inertial frame has its origin.
        constraints: What must hold; the clearance asked for is the least that is tried.
        search: How to look for each plan; `timeout` is for the whole call [s].

    Returns:
        The plan and the proof.

    Raises:
        ConfigurationError: The start is of another arm, or an argument does not make sense.
        NoSolutionError: No plan was found, or none that is proven for all values; carries the last.

    Example:
        >>> import spacearm as sa
        >>> about = sa.uncertain(sa.load("planar2"), {"link_2": {"mass": 0.1}})
        >>> plan, proof = sa.robust_plan(about, about.arm.at([0.3, 1.2]), sa.Joints([0.6, 0.9]))
        >>> proof.free
        True
    """
    if not isinstance(start, Configuration) or start.arm is not uncertain.arm:
        raise ConfigurationError(
            "start is not a configuration of the uncertain arm; make it by uncertain.arm.at(q)"
        )
    last: Plan | None = None
    account, tried = SearchAccount(search.timeout), 0
    for clearance in CLEARANCES:
        if account.left <= 0.0:
            break
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
                search=replace(search, timeout=max(account.left, SHORTEST)),
            )
            proof = is_free_for_all(uncertain, last, progress=account.tick)
        except (NoSolutionError, TimeUpError):
            break
        tried += 1
        if proof:
            return last, proof
    which = "no plan that was found"
    if tried:
        which = f"no plan with a clearance up to {CLEARANCES[tried - 1]:g}°"
    count = f"{tried} of {len(CLEARANCES)} clearances were tried"
    if account.left <= 0.0:
        count = f"the search ended after {account.limit}, when {count}; give a longer timeout"
    raise NoSolutionError(
        f"{uncertain.arm.name}: {which} is free of singularities for all values in the intervals "
        f"({count}); narrow them, or go elsewhere",
        last,
    )


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

    not_checked = "joint limits, collisions"

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
            verdict=f"{number} shell{'s' * (number != 1)}"
            if number
            else "shells of different number",
            notes=["Arms that were not tried may have shells outside these bands."],
            tables=[Table.by_columns(bands)],
        )


@checked
def shell_bands(
    uncertain: UncertainArm, *, samples: int = 50, seed: int = 0, progress: Progress | None = None
) -> ShellBands:
    """Compute the bands in which the shells of the path dependent workspace lie.

    The shells of each arm are computed as by `workspace`. The bands are those of the arms tried;
    they do not bound the shells of others.

    Args:
        uncertain: An arm with as many revolute joints as its task has rows.
        samples: Number of random arms; the corners of up to 5 parameters are tried besides.
        seed: Of these.
        progress: Called as progress(done, total) after each arm.

    Returns:
        The bands, and what is path dependent for all arms tried and for some.

    Raises:
        UnsupportedError: No polynomials give the singular set of the arm, so that its shells are
            sampled; see `workspace`.

    Example:
        >>> import spacearm as sa
        >>> about = sa.uncertain(sa.load("planar2"), {"link_2": {"mass": 0.1}})
        >>> len(sa.shell_bands(about, samples=1).low)
        2
    """
    if exact_set(uncertain.arm, "free-floating") is None:
        raise UnsupportedError(
            f"{uncertain.arm.name}: no polynomials give the singular set of this arm, so that its "
            "shells are sampled, too coarse for bands; compare sa.workspace of single arms"
        )
    shares = uncertain.tried(samples, seed, MOST_CORNERS_OF_SHELLS)
    arms = [uncertain.arm, *map(uncertain.realise, shares)]
    found = [workspace(arm).pdw for arm in counted(arms, progress)]
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
