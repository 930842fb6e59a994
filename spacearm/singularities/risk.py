"""Share of configurations near a singularity, over the tip's distance from the system CM or pose.

A point belongs to the path dependent workspace as soon as one of the configurations that reach it
is singular. For spatial arms often every point does: Calzolari, Lampariello & Giordano,
Singularity maps of space robots and their application to gradient-based trajectory planning
(2020). These statistics give the share of configurations near a singularity instead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any, ClassVar

import numpy as np
import scipy

from spacearm.arrays import (
    LARGEST,
    NO_NUMBERS,
    Array,
    ArrayLike,
    Booleans,
    Integers,
    Progress,
    floats,
    generator,
    plain,
    whole,
    within,
)
from spacearm.equations.measures import nearest
from spacearm.errors import ConfigurationError, StoppedError, UnsupportedError
from spacearm.mechanics.arm_kernels import WIDE, ArmKernel
from spacearm.mechanics.batch import Rows, fill, measured, tips_from_centre
from spacearm.mechanics.distance import FADING, distances
from spacearm.model.arguments import FLOATING, BaseMode, impossible, require_possible
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.processes import check_memory
from spacearm.results import Column, Description, Measure, Result, Table
from spacearm.signatures import checked, shown
from spacearm.singularities.nearest import local_offsets

#: Default distance to the singular set up to which a configuration is near a singularity [rad].
NEAR = float(np.radians(5.0))
#: How many times that the first-order estimate may be where the distance is searched.
LOOKED = 3.0
#: Places about a configuration from which the search begins too.
BESIDE = 8
#: Steps of a descent at most, and the last one [rad].
STEPS, AT_REST = 60, 1e-7
#: What the shares are, in a sentence.
SEARCHED = (
    "found by search: a singular posture that the search misses makes the share too small; the "
    "standard error is that of the sample alone"
)
#: Number of configurations drawn at once.
BLOCK = 1_000_000
#: Numbers that are kept of each sample besides its joints.
MEASURED = 8
#: Memory for each neighbour of a pose: its distance, its number, its value, whether it is near.
NEIGHBOUR_BYTES = 25.0


class RiskProfile(Result):
    """The share of configurations near a singularity, over the distance of the tip from the CM.

    Configurations are uniform in joint space (within the joint limits if these count). Distances
    are searched, see `risk_profile`: what the search misses makes shares too small.

    Attributes:
        edges: (bins + 1,) edges of the distance classes [m].
        count: (bins,) configurations in each class.
        share: (bins,) share of them near a singularity; NaN where there are none.
        error: (bins,) standard error of the share, of the sample alone.
        kinematic: (bins,) the part of the share that is near a singular configuration of the arm on
            a fixed spacecraft too, by the same distance; the rest is dynamic. NaN where near is
            said by sigma_min.
        mode: What the spacecraft does.
        measure: "sigma_min" or "distance".
        bound: Value of the measure up to which a configuration counts as near.
        unit: Its unit.
    """

    edges: Array
    count: Array
    share: Array
    error: Array
    kinematic: Array
    mode: BaseMode
    measure: str
    bound: float
    unit: str

    JSON: ClassVar[Mapping[str, str]] = {"error": "standard_error", "unit": "bound_unit"}

    @property
    def radius(self) -> Array:
        """(bins,) middles of the classes [m]."""
        return 0.5 * (self.edges[:-1] + self.edges[1:])

    not_checked = "collisions"

    @property
    def overall(self) -> float:
        """Share of the configurations of all classes near a singularity; NaN if there are none."""
        return self._mean(self.share)

    @property
    def overall_error(self) -> float:
        """Standard error of `overall`, of the sample alone."""
        return float(np.sqrt(self.overall * (1.0 - self.overall) / (self.count.sum() or np.nan)))

    @property
    def overall_kinematic(self) -> float:
        """The part of `overall` that is near a singularity on a fixed spacecraft too."""
        return self._mean(self.kinematic)

    @property
    def overall_dynamic(self) -> float:
        """The rest of `overall`."""
        return self.overall - self.overall_kinematic

    def _mean(self, share: Array) -> float:
        filled = self.count > 0.0
        total = float(self.count.sum()) or np.nan
        return float((self.count * share)[filled].sum() / total)

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data, with the shares of all classes."""
        names = ("overall", "overall_error", "overall_kinematic", "overall_dynamic")
        return {**super().to_dict(), **{name: plain(getattr(self, name)) for name in names}}

    def describe(self) -> Description:
        """Describe the share of each distance class."""
        verdict = "no configuration in any class"
        if self.count.any():
            peak = int(np.nanargmax(self.share))
            verdict = (
                f"{self.overall:.2%} of all, standard error {self.overall_error:.2%}; "
                f"at most {self.share[peak]:.1%} at R = {self.radius[peak]:.3g} m"
            )
        notes = ["R: distance of the tip from the system CM"]
        classes = {
            Column("R from", "m", ".4f"): self.edges[:-1],
            Column("to", "m", ".4f"): self.edges[1:],
            Column("share", "", ".1%"): self.share,
            Column("standard error", "", ".1%"): self.error,
            Column("postures", "", ",.0f"): self.count,
        }
        if self.measure == "distance":
            notes.append(SEARCHED)
            if self.count.any():
                notes.insert(
                    0,
                    f"dynamic {self.overall_dynamic:.2%}, kinematic {self.overall_kinematic:.2%}: "
                    "near a singular posture of the arm on a fixed spacecraft too",
                )
            classes[Column("of it kinematic", "", ".1%")] = self.kinematic
        return Description(
            title=f"{self.mode}, share of {self.count.sum():,.0f} postures {nearness(self)}",
            verdict=verdict,
            notes=notes,
            tables=[Table.by_columns(classes)],
        )


@checked
def risk_profile(
    arm: SpaceArm,
    *,
    mode: BaseMode = FLOATING,
    limits: bool = False,
    sigma_min: float | None = None,
    distance: float | None = None,
    bins: int | ArrayLike = 40,
    samples: int = 200_000,
    seed: int | Sequence[int] = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> RiskProfile:
    """Estimate the share of configurations near a singularity, by distance of the tip from the CM.

    A configuration is near if a search finds a singular one within `distance`. Those whose
    first-order estimate is up to `LOOKED` times that are searched, from themselves and from places
    beside them. What the search misses makes the share too small; the standard error is that of the
    sample alone.

    Args:
        arm: Any arm.
        mode: What the spacecraft does; see `generalized_jacobian`.
        limits: Whether configurations are drawn within the joint limits; else from the full turn.
            Prismatic joints are always drawn within their limits.
        sigma_min: Least singular value up to which a configuration is near, instead of `distance`.
        distance: Distance to the singular set up to which a configuration is near [rad]; 5 degrees
            if neither is given.
        bins: Number of distance classes between the least and the largest distance drawn, or their
            edges [m], increasing; distances outside the edges are not counted.
        samples: Number of configurations.
        seed: Seed of the sample.
        threads: Number of threads; see `evaluate`.
        progress: Called now and then as progress(done, samples).

    Returns:
        The share of near configurations in each class, with its error.

    Raises:
        ConfigurationError: bins, samples or the bounds are not valid.
        UnsupportedError: The arm has several tips or a prismatic joint without limits, or can never
            do its task.
        StoppedError: Ctrl-C; carries the profile of the configurations done.

    Example:
        >>> import spacearm as sa
        >>> sa.risk_profile(sa.load("planar2"), bins=4, samples=2000).share.round(2)
        array([0.17, 0.  , 0.02, 0.08])
    """
    edges = None if isinstance(bins, Integral) else _edges(bins)
    least = whole(bins, "bins", 1) if edges is None else 1
    samples = whole(samples, "samples", least)
    measure, bound, unit = _near(arm, mode, sigma_min, distance)
    Q = uniform(arm, limits, samples, generator(seed))
    values = {name: np.full(samples, np.nan) for name in (measure, "radius", "fixed")}
    stopped = False
    try:
        _measure(arm, mode, Q, bound, values, threads, progress)
    except KeyboardInterrupt:
        stopped = True
    done = ~np.isnan(values[measure]) & ~np.isnan(values["radius"])
    if stopped and not done.any():
        raise KeyboardInterrupt
    near, R = values[measure][done] <= bound, values["radius"][done]
    if edges is None:
        edges = np.linspace(R.min(), R.max(), least + 1)
    count = np.histogram(R, edges)[0].astype(np.float64)
    fixed = near & (values["fixed"][done] <= bound)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.histogram(R[near], edges)[0] / count
        error = np.sqrt(share * (1.0 - share) / count)
        kinematic = np.histogram(R[fixed], edges)[0] / count
    if measure == "sigma_min":
        kinematic = np.full_like(share, np.nan)
    profile = RiskProfile(edges, count, share, error, kinematic, mode, measure, bound, unit)
    if stopped:
        raise StoppedError(f"{len(R):,} of {samples:,} postures done", profile)
    return profile


def _measure(
    arm: SpaceArm,
    mode: BaseMode,
    Q: Array,
    bound: float,
    values: dict[str, Array],
    threads: int | None,
    progress: Progress | None,
) -> None:
    """Measure configurations Q (m, n), block by block.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        Q: The configurations.
        bound: Up to which value of the measure they are near.
        values: Arrays (m,) to write to: "sigma_min" or "distance", "radius", and "fixed", the
            distance of those that are near to the nearest singular configuration with the
            spacecraft fixed.
        threads: Number of threads.
        progress: Called as progress(done, m).
    """
    arm.require_one_tip()
    many = len(Q)

    def compute(rows: Rows, _: Mapping[str, Array | None]) -> dict[str, Array]:
        q = rows["q"]
        found = {"radius": np.linalg.norm(tips_from_centre(arm, q, mode), axis=1)}
        found["fixed"] = np.full(len(q), np.inf)
        if "sigma_min" in values:
            return found | {"sigma_min": measured(arm, q, ("sigma_min",), mode, many=many)[0]}
        found["distance"] = distances_near(arm, mode, q, bound, many)
        near = np.flatnonzero(found["distance"] <= bound)
        if mode == "fixed":
            found["fixed"] = found["distance"]
        elif near.size:
            found["fixed"][near] = distances_near(arm, "fixed", q[near], bound, many)
        return found

    fill(values, {"q": Q}, compute, threads, progress)


def distances_near(arm: SpaceArm, mode: BaseMode, Q: Array, bound: float, many: int) -> Array:
    """Return the distances (m,) to the singular set of configurations Q (m, n) [rad].

    They are searched where the first-order estimate is up to `LOOKED` times a bound, and estimates
    elsewhere. Descents begin at each configuration and, unless one ends within the bound, at
    `BESIDE` places as far from it as the best of them has come, in ways that are the same for all.
    Zeros where J* has lost rank everywhere.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        Q: The configurations, a block of `many`.
        bound: The bound [rad].
        many: How many there are in all.
    """
    if impossible(arm, mode):
        return np.zeros(len(Q))
    found, _ = distances(arm, Q, mode, many=many)
    left = np.flatnonzero(found <= LOOKED * bound)
    if not left.size:
        return found
    kernel = ArmKernel([arm], mode, nearest, {"most": STEPS}, lanes=WIDE, rows=many)
    numbers = {"fading": FADING, "radians": joint_scales(arm), "rest": AT_REST}
    numbers["between"] = np.array([0.0, np.inf])

    def descended(rows: Integers, begin: Array) -> tuple[Array, Booleans]:
        result = kernel({"q": Q[rows], "begin": begin}, numbers)
        ended = (result[:, 1] <= AT_REST) & np.isfinite(result[:, 0])
        return np.where(ended, result[:, 0], np.inf), ended

    first, ended = descended(left, np.zeros((len(left), arm.n)))
    further = np.linalg.norm(local_offsets(arm, mode, Q[left[~ended]]), axis=1)
    first[~ended] = np.where(np.isnan(further), np.inf, further)
    found[left] = first
    ways = np.random.Generator(np.random.PCG64(0)).normal(size=(BESIDE, arm.n))
    for way in ways / np.linalg.norm(ways, axis=1)[:, None]:
        left = left[(found[left] > bound) & (found[left] <= LOOKED * bound)]
        if left.size:
            again, _ = descended(left, found[left][:, None] * way)
            found[left] = np.minimum(found[left], again)
    return found


def _edges(bins: object) -> Array:
    """Check the edges of the distance classes."""
    try:
        edges = floats(bins)
    except NO_NUMBERS:
        edges = np.empty(0)
    if edges.ndim != 1 or len(edges) < 2 or not (np.diff(edges) > 0.0).all():
        raise ConfigurationError(f"bins is {shown(bins)}; give their number, or increasing edges")
    return edges


class PoseRisk(Result):
    """Share of configurations near a singularity for sampled tip poses.

    The spacecraft's attitude is free. Tip poses with the same position of the system CM in tip axes
    are therefore reached by the same configurations, and that position stands for the pose.

    Attributes:
        centre: (m, 3) the system CM in tip axes, for each pose [m].
        share: (m,) share near a singularity among the configurations that nearly reach the pose.
        within: (m,) largest distance of their system CM from `centre` [m].
        measure: "sigma_min" or "distance".
        bound: Value of the measure up to which a configuration counts as near.
        unit: Its unit.
    """

    centre: Array
    share: Array
    within: Array
    measure: str
    bound: float
    unit: str

    not_checked = "collisions"

    def describe(self) -> Description:
        """Describe mean and largest share, and how near the configurations come to the poses."""
        quantiles = {f"{p} % of the poses at most": np.percentile(self.share, p) for p in (50, 90)}
        facts = {
            "mean": self.share.mean(), **quantiles, "largest": self.share.max()
        }  # fmt: skip
        table = Table.facts({name: Measure(x, "", ".1%") for name, x in facts.items()}, "Share")
        return Description(
            title=f"{len(self.share)} poses, {nearness(self)}",
            verdict=f"share {self.share.mean():.1%} on average, at most {self.share.max():.1%}",
            notes=[
                "of each pose the configurations that nearly reach it, within "
                f"{self.within.max():.3g} m of the system CM"
            ],
            tables=[table],
        )


@checked
def pose_risk(
    arm: SpaceArm,
    *,
    limits: bool = False,
    sigma_min: float | None = None,
    distance: float | None = None,
    poses: int = 200,
    neighbours: int = 100,
    samples: int = 20_000,
    seed: int = 0,
) -> PoseRisk:
    """Estimate the share of configurations near a singularity, by tip pose.

    The poses are those of uniform configurations.

    Args:
        arm: Any arm.
        limits: As in `risk_profile`.
        sigma_min: As in `risk_profile`.
        distance: As in `risk_profile`.
        poses: Number of tip poses.
        neighbours: Number of configurations for each pose, those nearest to it.
        samples: Number of configurations that they are taken from.
        seed: Seed of the sample.

    Returns:
        The share of near configurations at each pose.

    Raises:
        ConfigurationError: A number is not valid, or there are fewer samples than poses or
            neighbours.
        UnsupportedError: The arm has several tips or a prismatic joint without limits, or can never
            do its task.

    Example:
        >>> import spacearm as sa
        >>> sa.pose_risk(sa.load("mda6"), poses=5, samples=500).share.shape
        (5,)
    """
    from spacearm.mechanics.floating import reactions

    poses, neighbours = whole(poses, "poses", 1), whole(neighbours, "neighbours", 1)
    if whole(samples, "samples", 1) < max(poses, neighbours):
        raise ConfigurationError(
            f"{poses} poses with {neighbours} neighbours out of {samples} samples; give no fewer "
            "samples than either"
        )
    measure, bound, unit = _near(arm, FLOATING, sigma_min, distance)
    what = f"{poses:,} poses with {neighbours:,} neighbours each"
    check_memory(NEIGHBOUR_BYTES * poses * neighbours, what, "use fewer of either")
    Q = uniform(arm, limits, samples, generator(seed))
    values = {name: np.full(samples, np.nan) for name in (measure, "radius", "fixed")}
    _measure(arm, FLOATING, Q, bound, values, None, None)
    value = values[measure]
    at = reactions(arm, Q)
    centres = -np.einsum("mij,mi->mj", at.R, at.r)  # tip axes
    apart: Any
    near: Any
    apart, near = scipy.spatial.KDTree(centres).query(centres[:poses], k=neighbours)
    apart, near = apart.reshape(poses, -1), near.reshape(poses, -1)
    share = (value[near] <= bound).mean(axis=1)
    return PoseRisk(centres[:poses], share, apart[:, -1], measure, bound, unit)


def _near(
    arm: SpaceArm, mode: BaseMode, sigma_min: float | None, distance: float | None
) -> tuple[str, float, str]:
    """Return what measures whether a configuration is near, up to which value, and its unit."""
    require_possible(arm, mode)
    if sigma_min is not None and distance is not None:
        raise ConfigurationError(
            f"sigma_min is {sigma_min} and distance {distance}; give only one of them to say what "
            "near means"
        )
    if sigma_min is not None:
        return "sigma_min", within(sigma_min, "sigma_min", 0.0), arm.sigma_unit
    near = NEAR if distance is None else distance
    return "distance", within(near, "distance", 0.0, LARGEST, "an angle [rad]"), "rad"


def check_slides(arm: SpaceArm) -> None:
    """Refuse arms with a prismatic joint without limits.

    Raises:
        UnsupportedError: There is one.
    """
    for j in np.flatnonzero(arm.slides & np.isinf(arm.upper - arm.lower)):
        name = arm.joint_names[j]
        raise UnsupportedError(f"{arm.name}: joint {name!r} slides without limits; lock it")


def uniform(arm: SpaceArm, limits: bool, m: int, rng: np.random.Generator) -> Array:
    """Draw m uniform configurations (m, n), within the joint limits or from the full turn.

    Raises:
        SpaceArmError: They, and what is measured at them, need more memory than is free.
    """
    check_slides(arm)
    need = 8.0 * m * (arm.n + MEASURED)
    check_memory(need, f"{m:,} samples of {arm.n} joints", "use fewer samples")
    low, high = ranges_of(arm, limits)
    Q = np.empty((m, arm.n))
    for begin in range(0, m, BLOCK):  # so that Ctrl-C need not wait
        Q[begin : begin + BLOCK] = rng.uniform(low, high, (min(m - begin, BLOCK), arm.n))
    return Q


def ranges_of(arm: SpaceArm, limits: bool) -> tuple[Array, Array]:
    """Return the least and largest joint positions (n,) of uniform configurations."""
    span = arm.upper - arm.lower
    turns = (span >= 2.0 * np.pi) & (arm.coupling is None or np.isinf(span))
    kept = arm.slides | (limits & ~turns)
    return np.where(kept, arm.lower, -np.pi), np.where(kept, arm.upper, np.pi)


def nearness(risk: RiskProfile | PoseRisk) -> str:
    """Return which postures count as near a singularity, in words."""
    if risk.measure == "distance":
        return f"within {np.degrees(risk.bound):.3g}° of a singular posture"
    return f"with sigma_min up to {risk.bound:.3g} {risk.unit}"
