"""The interface of singular sets: what can be asked of the singular configurations of an arm.

Also what all sets share: the proof that a path in joint space is free of them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from spacearm.arrays import LARGEST, Array, ArrayLike, Progress, finite, named, numbers_of, within
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales, joint_vector, warn_outside
from spacearm.polynomial.certificate import WHOLE, Certificate, certify
from spacearm.polynomial.free_regions import Roots as Region
from spacearm.polynomial.free_regions import most_boxes, prove
from spacearm.polynomial.jets import Jets
from spacearm.polynomial.level_set import Mesh
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.polynomial.tubes import ROUNDING, Tubes, foot, straight
from spacearm.polynomial.univariate import Roots
from spacearm.processes import check_memory
from spacearm.results import Cell, Described, Description, Table
from spacearm.signatures import checked
from spacearm.singularities.immaterial_masses import any_payload, immaterial_links, payload_note
from spacearm.singularities.nearest import NearestSingular, nearest_singular
from spacearm.singularities.polynomials import minors_of, proving_minors
from spacearm.singularities.regularity import has_momenta, prove_by_momenta
from spacearm.singularities.rounding import error_bars


def prove_free(
    arm: SpaceArm,
    mode: BaseMode,
    minors: Sequence[Jets],
    path: ArrayLike,
    limits: bool,
    progress: Progress | None = None,
) -> Certificate:
    """Prove that a path meets no common root of minors, or by momenta where there are none.

    Where all minors vanish within rounding the arm is singular if its sigma_min is too; else it is
    undecided.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        minors: Minors whose common roots hold the whole singular set; none of an arm that
            `has_momenta`.
        path: (m, n) joint positions, at least one.
        limits: Whether only what lies within the joint limits counts.
        progress: Called as progress(done, 1000), in thousandths of the path.
    """
    rows = path_rows(arm, path)

    def singular(q: Array) -> bool:
        cfg = arm.at(q)
        sigma = np.linalg.svd(task_jacobian(cfg, mode=mode), compute_uv=False)[-1]
        return bool(sigma <= error_bars(cfg, mode=mode).sigma)

    def proof_of(ends: Array, told: Progress | None = None) -> Certificate:
        if not minors:
            return prove_by_momenta(arm, straight(ends), told)
        return certify(minors, ends, singular if len(minors) > 1 else None, told)

    if not limits:
        return proof_of(rows, progress)
    margin, noise = np.inf, 0.0
    for number, ends in _within(arm, rows):
        if progress:
            progress(WHOLE * number // len(rows), WHOLE)
        proof = proof_of(ends)
        if not proof:
            return replace(proof, segment=number)
        margin, noise = min(margin, proof.margin), max(noise, proof.noise)
    return Certificate(True, None, None, margin, "free", noise)


def part_of(progress: Progress | None, number: int, parts: int) -> Progress | None:
    """Return a progress callback for one of some parts of the work, numbered from 0 on."""
    if progress is None or parts == 1:
        return progress
    return lambda done, total: progress((done + number * total) // parts, total)


#: How far a chord that stands for several pieces of a path may be from it, over the clearance.
CHORD = 0.02
#: How many times as many boxes as that of a posture the proof of a clearance may take.
MANY = 5


def prove_clear(
    arm: SpaceArm,
    mode: BaseMode,
    way: Array,
    at_least: float,
    limits: bool = False,
    progress: Progress | None = None,
) -> Certificate:
    """Prove that no singular configuration is nearer to a way in joint space than a clearance.

    About it lie tubes, which are divided into boxes until in each of them minors of J* have no
    common root (`polynomial.free_regions`). Where the first boxes do not do, the nearest singular
    configuration is looked for.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        way: (m, d, n) control points of its pieces, as `control_points`.
        at_least: The clearance [rad]; sliding joints count by `SingularityReport.radian`. Zero for
            the way alone.
        limits: Whether only what lies within the joint limits counts.
        progress: Called as progress(done, 1000), in thousandths of the boxes that there may be.

    Returns:
        The certificate. Its `clearance` is what is proven: where it is less than asked for, up to
        a singular configuration beside the way, or as far as the boxes went.

    Raises:
        ConfigurationError: The clearance is not a number from 0 on.
        UnsupportedError: J* has no minors to prove it with, or too large ones.
    """
    at_least = within(at_least, "clearance", 0.0, LARGEST, "an angle [rad]")
    minors = proving_minors(arm, mode)
    if not (minors or at_least or limits) and has_momenta(arm, mode):
        return prove_by_momenta(arm, way, progress)
    if not minors:
        raise UnsupportedError(
            f"{arm.name}: J* has no minors of a size that could prove a clearance; lock joints, or "
            "prove the path free without one"
        )
    unit = joint_scales(arm)
    points = way / unit
    ends = points.min(axis=(0, 1)) - at_least, points.max(axis=(0, 1)) + at_least
    if limits:
        ends = np.maximum(ends[0], arm.lower / unit), np.minimum(ends[1], arm.upper / unit)
    roots = Region(minors, np.zeros(arm.n), unit, *ends)
    each = most_boxes(minors)
    most = boxes = MANY * each
    noise = max(minor.noise() / minor.scale for minor in minors)
    proven = 0.0

    def tried(m: int) -> None:
        nonlocal boxes
        boxes -= m
        if progress:
            progress(WHOLE * (most - boxes) // most, WHOLE)

    # chords that are the way itself tell the most
    for chord, kept in ((CHORD * at_least, most - each), (CHORD * at_least, 0), (0.0, 0)):
        if boxes <= kept:
            break
        proof = prove(roots, Tubes.about(points, at_least, chord), boxes - kept, tried)
        proven = max(proven, proof.radius)
        if not len(proof.open):
            return Certificate(True, None, None, 0.0, "free", noise, at_least)
        with suppress(NoSolutionError):
            if kept and at_least:
                near = nearest_singular(arm, mode, way, limits, minors)
                if near.distance < at_least:
                    proven, at = max(proven, near.distance_proven), foot(points, near.q / unit)[1]
                    return Certificate(False, near.q, at, 0.0, "near", noise, proven)
    at, segment = proof.open[0], foot(points, proof.open[0])[1]
    return Certificate(False, unit * at, segment, 0.0, "undecided", noise, proven)


class Way(Protocol):
    """A motion, as `sa.Motion`: in joint space each piece lies within its control points."""

    @property
    def q(self) -> Array:
        """(m, n) joint positions of its rows."""

    @property
    def control_points(self) -> Array:
        """(pieces, d, n) control points of the way that is flown."""


Path: TypeAlias = ArrayLike | Way


def control_points(arm: SpaceArm, path: Path) -> Array:
    """Return the control points (m, d, n) of a motion, or of straight segments between rows (m, n).

    Raises:
        ConfigurationError: There is no row, or a row is no configuration.
    """
    rows = path_rows(arm, path)
    return np.asarray(getattr(path, "control_points", straight(rows)))


def path_rows(arm: SpaceArm, path: Path) -> Array:
    """Return the checked configurations (m, n) of a path.

    Raises:
        ConfigurationError: There is no row, or a row is not a configuration.
    """
    given = np.atleast_2d(numbers_of(getattr(path, "q", path), "path"))
    if not len(given):
        raise ConfigurationError("path has no rows; give at least one configuration")
    if given.shape[1:] != (arm.n,) or not (np.abs(given) <= LARGEST).all():
        for q in given:
            joint_vector(arm, q, "path")  # says what is wrong with it
    return given


def _within(arm: SpaceArm, path: Array) -> list[tuple[int, Array]]:
    """Return the parts of a path within the joint limits: number of the segment and ends (2, n)."""
    start, end = (path[:-1], path[1:]) if len(path) > 1 else (path, path)
    step = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.stack(((arm.lower - start) / step, (arm.upper - start) / step))
    still, inside = step == 0.0, (start >= arm.lower) & (start <= arm.upper)
    first = np.where(still, 0.0, t.min(axis=0)).max(axis=1, initial=0.0)
    last = np.where(still, 1.0, t.max(axis=0)).min(axis=1, initial=1.0)
    kept = np.flatnonzero((first <= last) & (inside | ~still).all(axis=1))
    return [(int(i), start[i] + np.outer((first[i], last[i]), step[i])) for i in kept]


class Component(NamedTuple):
    """A connected component of the singular set.

    Attributes:
        points: (m, n) points on it.
        radius: (2,) least and largest distance of the tip from the system CM on it [m].
        at: (2, n) configurations at which they are attained.
    """

    points: Array
    radius: Array
    at: Array

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return named(self)

    def __repr__(self) -> str:
        low, high = self.radius
        return f"Component({len(self.points)} points, R from {low:.7g} to {high:.7g} m)"


@checked
@dataclass(frozen=True, eq=False, repr=False)
class SingularSet(Described, ABC):
    """The configurations at which the task Jacobian of an arm is singular; see `singular_set`.

    `sample` and `nearest` work for every arm; `is_free` and `clearance` for all floating arms with
    one tip and no sliding joint, and for others if their minors do not have too many coefficients.
    The other methods raise `UnsupportedError` where the set of this arm does not have what they
    return; the message says why.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
    """

    arm: SpaceArm
    mode: BaseMode

    @property
    @abstractmethod
    def complete(self) -> bool:
        """Whether every singular configuration is in the set: nothing is missed."""

    @property
    @abstractmethod
    def S(self) -> TrigPolynomial:
        """The singularity polynomial, which vanishes on the set and nowhere else."""

    @property
    @abstractmethod
    def relevant(self) -> tuple[int, ...]:
        """Numbers of the joints that S depends on."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Dimension of the set in the space of the relevant joints."""

    @property
    @abstractmethod
    def codimension(self) -> int:
        """Number of equations that singular configurations fulfil: n - k + 1 as a rule."""

    @property
    def any_payload(self) -> bool:
        """Whether the set is the same for every rigid body held at the tips, whatever its mass.

        This holds if the task has all rows of the tip's twist: the full pose, or "x y rz" for an
        arm in the plane and bodies that keep it planar. Distances and certificates then hold for
        every payload too, and for every mass, inertia and CM of the links `any_mass`.
        """
        return any_payload(self.arm, self.mode)

    @property
    def any_mass(self) -> tuple[str, ...]:
        """Links whose mass, inertia and CM do not change the set: those that move as the tip."""
        return immaterial_links(self.arm, self.mode)

    @abstractmethod
    def roots(self, q: ArrayLike, joint: int | str | None = None) -> Roots:
        """Find every singular value of one joint with the others as in q.

        As a rule there are none if the set has at least two dimensions less than joint space;
        `solve` computes several joints from the others.

        Args:
            q: (n,) joint positions; that of the joint itself does not matter.
            joint: Number from 0 on, or name, or q1, q2, .... If None, the last one that follows
                from others; for an arm with as many joints as task rows, the one of least degree.
        """

    @abstractmethod
    def solve(self, q: ArrayLike) -> Array:
        """Find all singular configurations with the free joints as in q, (r, n).

        All joints but `codimension` of them are free; those follow from the free ones, one after
        the other. For the full pose of n revolute joints the joints that follow are 5 to n - 1, or
        others of less degree.
        """

    @abstractmethod
    def sample(self, m: int, rng: np.random.Generator | None = None) -> Array:
        """Sample m singular configurations, (m, n).

        A complete set is covered. If it has one equation, random lines along each of the k joints
        that matter, in turn, give all members that they meet. So the number of samples on a part
        of the set is proportional to its area, to a factor of sqrt(k). If it has more equations,
        the free joints (see `solve`) are uniform, given that a solution exists, and each solution
        has the same probability. Sheets that do not depend on the joint that follows first are
        sampled likewise along other joints. For a searched set no distribution is promised.

        Args:
            m: How many.
            rng: Random number generator; a new one if None.

        Raises:
            ConfigurationError: m is not a whole number from 0 on.
            NoSolutionError: The set is empty, or the search of a set that is not complete found too
                few; carries those found.
        """

    def nearest(
        self, q: Path, *, limits: bool = False, progress: Progress | None = None
    ) -> NearestSingular:
        """Find the singular configuration nearest to a configuration or a path in joint space.

        It is the best of descents from some 200 starts about q. Unless joints mimic others, a proof
        follows that none is nearer (`polynomial.free_regions`): up to 99 % of the distance, for
        redundant arms and paths 90 %. If the proof takes too many boxes, it ends with what is
        proven so far. On a path the search starts from the six places that are nearest to first
        order.

        Args:
            q: (n,) joint positions; rows (m, n) of a path of straight segments; or a motion (for
                plans, as it is flown).
            limits: Whether only configurations within the joint limits count.
            progress: Called now and then as progress(done, most); the search may end earlier.

        Returns:
            Configuration, distance and proven distance.

        Raises:
            NoSolutionError: None was found; says so if it is proven that none is within the limits.
        """
        way, minors = control_points(self.arm, q), proving_minors(self.arm, self.mode)
        try:
            return nearest_singular(self.arm, self.mode, way, limits, minors, progress)
        except NoSolutionError:
            if limits and minors and self._none_within_limits(way[:1, :1]):
                raise NoSolutionError(
                    f"{self.arm.name}: no posture within the joint limits is singular: proven"
                ) from None
            raise

    def _none_within_limits(self, at: Array) -> bool:
        """Tell whether it is proven that none is within the limits, seen from (1, 1, n)."""
        far = np.maximum(self.arm.upper - at, at - self.arm.lower) / joint_scales(self.arm)
        reach = float(np.linalg.norm(far)) * (1.0 + ROUNDING)
        return reach <= LARGEST and bool(prove_clear(self.arm, self.mode, at, reach, limits=True))

    def is_free(
        self,
        q0: Path,
        q1: ArrayLike | None = None,
        *,
        limits: bool = False,
        clearance: float = 0.0,
    ) -> Certificate:
        """Prove that the straight segment from q0 to q1 in joint space meets no singularity.

        An interval is free as soon as one of the minors is certified not to vanish on it.

        Args:
            q0: (n,) joint positions at its start; or a path, as `clearance` takes it.
            q1: (n,) joint positions at its end; not of a path.
            limits: Whether only the part within the joint limits counts.
            clearance: Distance from the segment within which no configuration is singular [rad].

        Returns:
            A certificate, true if the segment is free; else it names the first singular
            configuration, or the first that could not be decided.

        Warns:
            ModelWarning: An end is outside the joint limits, or looks like degrees.
        """
        if q1 is None:
            return self.clearance(q0, limits=limits, at_least=clearance)
        ends = [
            joint_vector(self.arm, finite(q, (self.arm.n,), s), s)
            for q, s in ((q0, "q0"), (q1, "q1"))
        ]
        for q, name in zip(ends, ("q0", "q1"), strict=True):
            warn_outside(self.arm, q, name)
        return self.clearance(ends, limits=limits, at_least=clearance)

    def clearance(
        self,
        path: Path,
        *,
        limits: bool = False,
        at_least: float = 0.0,
        progress: Progress | None = None,
    ) -> Certificate:
        """Prove the same for a path of straight segments, or for a motion.

        Args:
            path: (m, n) joint positions, at least one; or a motion: of plans the way that is flown.
            limits: As in `is_free`.
            at_least: As `clearance` in `is_free`.
            progress: Called now and then as progress(done, 1000), in thousandths of the path.
        """
        way = control_points(self.arm, path)
        twice = bool(at_least) or way.shape[1] > 2
        first, second = (part_of(progress, number, 1 + twice) for number in (0, 1))
        proof = self._proof(path_rows(self.arm, path), limits, first)
        if not (proof and twice):
            return proof
        clear = prove_clear(self.arm, self.mode, way, at_least, limits, second)
        return replace(clear, margin=proof.margin)

    def _proof(self, path: ArrayLike, limits: bool, progress: Progress | None) -> Certificate:
        """Prove that a path meets no singularity."""
        every: Sequence[Jets] = ()
        try:
            every = minors_of(self.arm, self.mode).every()
        except UnsupportedError:  # too many coefficients, or mimic joints
            if not has_momenta(self.arm, self.mode):
                raise
        return prove_free(self.arm, self.mode, every, path, limits, progress)

    @abstractmethod
    def curves(
        self,
        joints: Sequence[int | str] | None = None,
        q: ArrayLike | None = None,
        *,
        resolution: float = 0.0,
    ) -> list[Array]:
        """Trace the set over two revolute joints, or over three where it has two equations.

        Args:
            joints: The joints; those that matter if None, such as the two of planar2 (figure 4).
            q: (n,) positions of the other joints; zeros if None.
            resolution: Pieces that are closer together than this may be joined wrongly, and smaller
                ones missed [rad]; larger values are faster.

        Returns:
            Closed polylines (m, n), every point on the set to rounding, angles continuous along
            each; joints that are not named stand as in q. Where the set has two equations, loops
            smaller than about 2 degrees may be missed.

        Raises:
            UnsupportedError: The set over these joints is not a set of curves.
        """

    @abstractmethod
    def surface(
        self,
        joints: Sequence[int | str] | None = None,
        q: ArrayLike | None = None,
        *,
        resolution: float = 0.0,
    ) -> Mesh:
        """Triangulate the set over three revolute joints, on the 3-torus.

        Args:
            joints: The joints; those that matter if None.
            q: (n,) positions of the other joints; zeros if None.
            resolution: The grid need not be finer than this [rad]; see `curves`.

        Raises:
            UnsupportedError: The set over these joints is not a surface.
        """

    @abstractmethod
    def components(self) -> list[Component]:
        """Find the connected components, each with the range of R, the tip's distance from the CM.

        Raises:
            UnsupportedError: The set has more than two dimensions.
        """

    def to_dict(self) -> dict[str, Any]:
        """Describe the set as plain JSON data: arm, mode, complete, codimension, payload."""
        return {
            "arm": self.arm.name,
            "mode": self.mode,
            "complete": self.complete,
            "codimension": self.codimension,
            "any_payload": self.any_payload,
            "any_mass": list(self.any_mass),
        }

    def describe(self) -> Description:
        """Describe which singular configurations are in the set, and its dimension."""
        facts: dict[str, Cell] = {"equations that they fulfil": self.codimension}
        if self.complete:
            joints = ", ".join(self.arm.joint_names[j] for j in self.relevant)
            facts |= {"dimension": self.dimension, "joints that matter": joints or "none"}
        return Description(
            title=f"{self.arm.name}, {self.mode}",
            verdict="every singular configuration"
            if self.complete
            else "the singular configurations that a search finds; others may exist",
            notes=[payload_note(self.arm, self.mode)],
            tables=[Table.facts(facts)],
        )


#: Memory of a singular configuration in a list of them, beside its numbers.
ROW_BYTES = 150.0


def check_sampled(arm: SpaceArm, m: int) -> None:
    """Refuse to sample more singular configurations of an arm than the free memory has room for.

    Raises:
        SpaceArmError: They need more.
    """
    need = m * (ROW_BYTES + 2 * 8.0 * arm.n)  # in a list first, then in one array
    check_memory(need, f"a sample of {m:,} singular configurations", "take fewer")
