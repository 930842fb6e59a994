"""Risk: how likely singularities are at each distance of the tip from the system CM.

Position shells of spatial arms tend to swallow everything (Calzolari, Lampariello & Giordano 2020,
"Singularity maps of space robots and their application to gradient-based trajectory planning"): a
point belongs to the path dependent workspace as soon as one of the configurations that reach it is
singular. The profile tells what share of them is near a singularity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from spacearm.arrays import Array, Result, whole
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.mechanics.batch import evaluate
from spacearm.model.arm import SpaceArm
from spacearm.model.mode import BaseMode
from spacearm.singularities.polynomial import singularity_polynomial

TENTH = 0.1
"""Share of the median of sigma_min that counts as near a singularity unless a bound is given."""


@dataclass(frozen=True, eq=False, repr=False)
class RiskProfile(Result):
    """The share of configurations near a singularity, over the distance of the tip from the CM.

    Configurations are uniform in joint space (within the joint limits if these count).

    Attributes:
        edges: (bins + 1,) edges of the distance classes [m].
        count: (bins,) configurations in each class.
        share: (bins,) share of them near a singularity; NaN where there are none.
        error: (bins,) standard error of the share.
        measure: "sigma_min" or "distance".
        bound: Up to which value of the measure counts as near.
        unit: Its unit.
    """

    edges: Array
    count: Array
    share: Array
    error: Array
    measure: str
    bound: float
    unit: str

    @property
    def radius(self) -> Array:
        """(bins,) middles of the classes [m]."""
        return 0.5 * (self.edges[:-1] + self.edges[1:])

    def __repr__(self) -> str:
        near = f"{self.measure} <= {self.bound:.3g} {self.unit}"
        if not self.count.any():
            return f"RiskProfile({near}: no configuration in any class)"
        peak = int(np.nanargmax(self.share))
        most = f"at most {self.share[peak]:.1%} at R = {self.radius[peak]:.3g} m"
        return f"RiskProfile({near}: {most})"


def risk_profile(
    arm: SpaceArm,
    *,
    mode: BaseMode = "free-floating",
    limits: bool = False,
    sigma_min: float | None = None,
    distance: float | None = None,
    bins: int | npt.ArrayLike = 40,
    samples: int = 200_000,
    seed: int | Sequence[int] = 0,
    threads: int | None = None,
) -> RiskProfile:
    """How likely a singularity is near, for each distance of the tip from the system CM.

    Args:
        arm: Any arm.
        mode: "free-floating"; others are not supported.
        limits: Whether configurations are drawn within the joint limits or from the full turn.
            Sliding joints are always drawn within theirs.
        sigma_min: Near means a least singular value up to this; a tenth of its median if None.
        distance: Near means a joint distance to the singular set up to this [rad], to first order
            |S| / |grad S|: for arms that have a singularity polynomial; instead of sigma_min.
        bins: Number of distance classes between the least and the largest distance drawn, or
            their edges [m], growing; what lies outside of these is not counted.
        samples: Number of configurations.
        seed: Of the sample.
        threads: How many to use; see `evaluate`.

    Raises:
        ConfigurationError: bins, samples or both bounds do not make sense.
        UnsupportedError: The arm has a sliding joint without limits, no polynomial where `distance`
            is asked for, or the spacecraft does not float.
    """
    if mode != "free-floating":
        raise UnsupportedError(f"risk profiles are for free-floating spacecraft; mode is {mode!r}")
    if sigma_min is not None and distance is not None:
        raise ConfigurationError(
            f"sigma_min is {sigma_min} and distance {distance}; give only one of them to say what "
            "near means"
        )
    edges = None if isinstance(bins, Integral) else _edges(bins)
    least = whole(bins, "bins", 1) if edges is None else 1
    samples = whole(samples, "samples", least)
    Q = _uniform(arm, limits, samples, np.random.default_rng(seed))
    values = evaluate(arm, Q, ("sigma_min", "radius"), threads=threads)
    if distance is None:
        measure, unit, value = "sigma_min", arm.sigma_unit, values["sigma_min"]
        bound = _bound(value, sigma_min)
    else:
        S = singularity_polynomial(arm)
        slope = np.linalg.norm(S.gradient(Q), axis=1)
        value = np.abs(S(Q)) / np.maximum(slope, 1e-300)
        measure, unit, bound = "distance", "rad", distance
    R = values["radius"]
    if edges is None:
        edges = np.linspace(R.min(), R.max(), least + 1)
    count = np.histogram(R, edges)[0].astype(np.float64)
    near = np.histogram(R[value <= bound], edges)[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = near / count
        error = np.sqrt(share * (1.0 - share) / count)
    return RiskProfile(edges, count, share, error, measure, bound, unit)


def _edges(bins: object) -> Array:
    """The edges of the distance classes, checked."""
    try:
        edges = np.asarray(bins, dtype=np.float64)
    except (TypeError, ValueError):
        edges = np.empty(0)
    if edges.ndim != 1 or len(edges) < 2 or not (np.diff(edges) > 0.0).all():
        raise ConfigurationError(f"bins is {bins!r}; give their number, or growing edges")
    return edges


class PoseRisk(NamedTuple):
    """The share of configurations near a singularity for sampled tip poses.

    The spacecraft's attitude is free, so that a tip pose counts by where the system CM lies as seen
    from the tip: poses that agree in that are reached by the same configurations.

    Attributes:
        centre: (m, 3) the system CM in tip axes, for each pose [m].
        share: (m,) share of the configurations that nearly reach the pose which are near a
            singularity.
        within: (m,) how far their system CM is from `centre`, at most [m].
        bound: Up to which sigma_min counts as near.
    """

    centre: Array
    share: Array
    within: Array
    bound: float

    def __repr__(self) -> str:
        return (
            f"PoseRisk({len(self.share)} poses, sigma_min <= {self.bound:.3g}: "
            f"{self.share.mean():.1%} on average, at most {self.share.max():.1%}, among "
            f"configurations within {self.within.max():.3g} m)"
        )


def pose_risk(
    arm: SpaceArm,
    *,
    limits: bool = False,
    sigma_min: float | None = None,
    poses: int = 200,
    neighbours: int = 100,
    samples: int = 20_000,
    seed: int = 0,
) -> PoseRisk:
    """How likely a singularity is near, for tip poses that uniform configurations lead to.

    Args:
        arm: Any arm.
        limits: As in `risk_profile`.
        sigma_min: As in `risk_profile`.
        poses: Number of tip poses.
        neighbours: Configurations for each: those that come nearest to the pose.
        samples: Configurations they are taken from.
        seed: Of the sample.

    Raises:
        ConfigurationError: A number is none, or there are fewer samples than poses or neighbours.
    """
    poses, neighbours = whole(poses, "poses", 1), whole(neighbours, "neighbours", 1)
    if whole(samples, "samples", 1) < max(poses, neighbours):
        raise ConfigurationError(
            f"{poses} poses with {neighbours} neighbours out of {samples} samples; give no fewer "
            "samples than either"
        )
    Q = _uniform(arm, limits, samples, np.random.default_rng(seed))
    value = evaluate(arm, Q, ["sigma_min"])["sigma_min"]
    bound = _bound(value, sigma_min)
    cfgs = (arm.at(q) for q in Q)
    centres = np.array([cfg.tip.actInv(cfg.com) for cfg in cfgs])
    distance: Any
    near: Any
    distance, near = KDTree(centres).query(centres[:poses], k=neighbours)
    distance, near = distance.reshape(poses, -1), near.reshape(poses, -1)
    share = (value[near] <= bound).mean(axis=1)
    return PoseRisk(centres[:poses], share, distance[:, -1], bound)


def _bound(sigma_min: Array, asked: float | None) -> float:
    return TENTH * float(np.median(sigma_min)) if asked is None else asked


def check_slides(arm: SpaceArm) -> npt.NDArray[np.bool_]:
    """(n,) which joints slide.

    Raises:
        UnsupportedError: One does so without limits.
    """
    endless = np.flatnonzero(arm.slides & np.isinf(arm.upper - arm.lower))
    if len(endless):
        name = arm.joint_names[endless[0]]
        raise UnsupportedError(f"{arm.name}: joint {name!r} slides without limits; lock it")
    return arm.slides


def _uniform(arm: SpaceArm, limits: bool, m: int, rng: np.random.Generator) -> Array:
    sliding = check_slides(arm)
    span = arm.upper - arm.lower
    turns = (span >= 2.0 * np.pi) & (arm.coupling is None or np.isinf(span))
    kept = sliding | (limits & ~turns)
    low, high = np.where(kept, arm.lower, -np.pi), np.where(kept, arm.upper, np.pi)
    return rng.uniform(low, high, (m, arm.n))
