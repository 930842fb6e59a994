"""Path independent, path dependent and free workspace of a floating arm, and regions of points.

Dynamic singularities depend on the joints only, but after different paths the tip reaches a point
with different joint positions. A singular configuration puts the tip at a distance R from the
system CM, which does not move. The distances of all singular configurations are shells, the *path
dependent workspace* (PDW). The other reachable distances, where no path meets a singularity, are
the *path independent workspace* (PIW). Papadopoulos & Dubowsky (1993), section V, equations (43) to
(47), DOI 10.1115/1.2897406.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, finite, generator, plain, shape_of, whole
from spacearm.errors import ConfigurationError, StoppedError, UnsupportedError
from spacearm.mechanics.batch import tips_from_centre
from spacearm.model.arguments import FLOATING, BaseMode, require_possible
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.polynomial.newton import meeting
from spacearm.results import Cell, Column, Description, Measure, Result, Table, joint_measures
from spacearm.signatures import checked
from spacearm.singularities.exact_set import ExactSet
from spacearm.singularities.polynomials import radius_squared
from spacearm.singularities.risk import RiskProfile, check_slides, risk_profile
from spacearm.workspaces.extent import Box, largest_distance_within
from spacearm.workspaces.free import free_workspace
from spacearm.workspaces.proven import Proven, left_out, prove_shells
from spacearm.workspaces.sampled import STARTS, SingularSampler, singular_near
from spacearm.workspaces.shells import (
    TOLERANCE,
    Shell,
    ShellSearch,
    exact_set,
    members,
    merged,
    without,
)
from spacearm.workspaces.statements import MEANING, RangeStatement, statements

#: Cosine between the normal of a planar arm and the inertial axis from which it stands in plane.
UPRIGHT = 1.0 - 1e-9
#: Singular configurations sampled in the search for one at a given distance.
SAMPLE = 20_000
#: Number of them, nearest to that distance, from which Newton's method starts.
BEST = 20


class Region(Result):
    """Kind of a point of the workspace, with singular configurations that reach it.

    Attributes:
        kind: "unreachable"; "path independent": no path to it meets a singularity there; or
            "path dependent": after some paths the arm is singular when the tip is there.
        radius: Distance of the point from the system CM [m].
        singular: Singular configurations with the tip at the point and the system CM at the
            origin, one for each shell that contains the point; empty unless path dependent.
        point: (3,) the point from the system CM, inertial axes [m].
    """

    kind: Literal["unreachable", "path independent", "path dependent"]
    radius: float
    singular: tuple[Configuration, ...]
    point: Array

    not_checked = "joint limits, collisions"

    def describe(self) -> Description:
        """Describe the point, and the singular configurations with the tip there."""
        names = self.singular[0].arm.joint_names if self.singular else ()
        rows = [
            (name, *(joint_measures(cfg.q, cfg.arm.slides)[j] for cfg in self.singular))
            for j, name in enumerate(names)
        ]
        found = [f"singular posture {i + 1}" for i in range(len(self.singular))]
        facts: dict[str, Cell] = {
            "point from the system CM": Measure(self.point, "m"),
            "distance from the system CM": Measure(self.radius, "m"),
        }
        return Description(
            title=f"a point {self.radius:.4g} m from the system CM",
            verdict=self.kind,
            tone="good" if self.kind == "path independent" else "bad",
            tables=[Table.facts(facts), *([Table(("joint", *found), rows)] if rows else [])],
        )


def position(
    arm: SpaceArm, point: ArrayLike, mode: BaseMode, start: Configuration | None = None
) -> Array:
    """Check a point and return it as (3,) from the system CM, inertial axes.

    Args:
        arm: The arm.
        point: (3,) the point [m], or (2,) in the plane of a planar arm.
        mode: What the spacecraft does.
        start: A configuration in whose inertial frame it is given; from the system CM if None.

    Raises:
        ConfigurationError: It is no such point, or a planar arm is tilted at the start.
    """
    normal = arm.tree.plane_normal()
    meaning = "[m], from the system CM" if start is None else "[m], in the inertial frame of start"
    centre = np.zeros(3) if start is None else centre_of(start, mode)
    if start is not None and normal is not None and start.base.rotation[normal, normal] < UPRIGHT:
        raise ConfigurationError(
            "start is tilted out of the inertial plane; give the point from the system CM, along "
            "the plane of the arm, and no start"
        )
    if normal is None:
        return finite(point, (3,), "point", meaning) - centre
    in_plane = shape_of(point) == (2,)
    p = finite(point, (2,) if in_plane else (3,), "point", f"{meaning}, or 2 in the plane")
    if not in_plane:
        return p - centre
    return np.insert(p - np.delete(centre, normal), normal, _height(arm, normal, mode))


def centre_of(cfg: Configuration, mode: BaseMode) -> Array:
    """Return (3,) what distances count from: the system CM, or that of a fixed spacecraft."""
    return cfg.base.act(cfg.arm.model.inertias[1].lever) if mode == "fixed" else cfg.com


def off_plane(arm: SpaceArm, point: Array, mode: BaseMode) -> float:
    """Compute the distance of a point (3,) from the plane of a planar arm's tip [m]."""
    normal = arm.tree.plane_normal()
    return 0.0 if normal is None else abs(float(point[normal]) - _height(arm, normal, mode))


def _height(arm: SpaceArm, normal: int, mode: BaseMode) -> float:
    """Compute the offset of a planar arm's tip from the system CM along the normal [m]."""
    return float(tips_from_centre(arm, np.zeros((1, arm.n)), mode)[0, normal])


def singular_at(
    point: Array, found: ExactSet, box: Box, shells: Iterable[Shell]
) -> tuple[Configuration, ...]:
    """Find a singular configuration with the tip at the point (3,) for each shell around it."""
    arm, mode, R = found.arm, found.mode, float(np.linalg.norm(point))
    equations = found.triangle.equations
    R2 = radius_squared(arm, mode=mode)
    Q = members(found, box, SAMPLE, np.random.default_rng(0))
    near = Q[np.argsort(np.abs(R2(Q) - R * R))[:BEST]]
    results = []
    for shell in shells:
        if shell.radius[0] - 1e-9 <= R <= shell.radius[1] + 1e-9:
            starts = [*shell.at[np.argsort(np.abs(shell.radius - R))[:1]], *near]
            meetings = (meeting(equations, R2, R * R, start) for start in starts)
            inside = (box.fold(q) for q in meetings if q is not None and box.holds(box.fold(q)))
            singular = (q for q in inside if found.are_singular(q[None])[0])
            if (q := next(singular, None)) is not None:
                results.append(_brought_to(arm, q, point, mode))
    return tuple(results)


def _brought_to(arm: SpaceArm, q: Array, point: Array, mode: BaseMode) -> Configuration:
    """Turn the configuration about the CM so that the tip, at its distance, is at the point."""
    cfg = arm.at(q)
    centre = centre_of(cfg, mode)
    tip = cfg.tip.translation - centre
    normal = arm.tree.plane_normal()
    if normal is None or not tip.any():
        R = pin.Quaternion.FromTwoVectors(tip, point).matrix()
    else:
        n = np.eye(3)[normal]
        along = tip @ point - (n @ tip) * (n @ point)
        R = pin.exp3(np.arctan2(n @ np.cross(tip, point), along) * n)
    return arm.at(q, base=pin.SE3(R, -R @ centre))


#: Number of joints up to which branch and bound proves the bounds.
MOST_CERTIFIED = 3
#: Default number of singular configurations from which shells of larger arms are searched.
EFFORT = 200_000

#: Share of the work that searches for bounds are, where curves are proven besides.
SEARCHES = 0.2
#: Share of the largest distance up to which a gap counts as certified.
SMALL = 1e-4
#: Singular configurations to search from where branch and bound adds what they miss.
FEW = 2000
#: Step of the grid on which surfaces are looked for first [rad]. Branch and bound adds what it
#: misses; a finer one is taken if the result is not certified.
COARSE = 2.0 * np.pi / 96.0
Kind = Literal["certified", "found", "sampled", "stopped"]
_STOPPED: Kind = "stopped"


class Workspace(Result):
    """Distances R of the tip from the system CM: reachable, path dependent, path independent.

    "certified": both sides are proven up to `gap`, rounding included. No singular configuration
    puts the tip outside `pdw`: for up to three joints by branch and bound, for more by bounds of
    the tip's distance. At all distances within `pdw` some posture is singular: `proof` has curves
    in the singular set along which the distance takes all these values.

    "found": the largest and least distances that a search from `effort` singular configurations
    met. `covered` is the part that is proven; the rest may differ by `gap`. This happens to arms of
    more than three joints whose shells leave out reachable distances, often because of joint
    limits.

    "sampled": distances of `effort` singular configurations that a search found; those of
    neighbours in one range differ by at most `resolution`. This holds for arms whose singular set
    no polynomials give: most redundant arms with other tasks than the full pose, sliding and mimic
    joints. Nothing is certified. A search that misses singular configurations makes `pdw` too small
    and `piw` too large.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        limits: Whether joint limits count.
        reachable: (1, 2) reachable distances [m].
        pdw: (k, 2) path dependent workspace: distances of singular configurations [m], disjoint.
        piw: (k, 2) path independent workspace: the rest of the reachable distances [m].
        shells: A shell for each piece of the singular set that was found.
        reachable_at: (2, n) configurations of the least and the largest distance.
        kind: "certified", "found", "sampled" or, after Ctrl-C, "stopped": these distances are
            attained, others are missing.
        gap: Largest distance by which R may lie outside of `reachable` or `pdw`, and largest range
            of R within `pdw` at which nothing may be singular [m]: proven, but for "sampled" with
            configurations as singular that are so up to rounding. inf with more than six
            sliding joints. NaN if stopped.
        effort: Number of singular configurations that were sampled; 0 by branch and bound.
        covered: (k, 2) distances at all of which some posture is proven to be singular [m].
        proof: Curves in the singular set, points (m, n) along each, that prove them.
        resolution: If "sampled", the largest difference of neighbouring distances in one range of
            `pdw` [m]; else 0.
        configurations: (m, n) if "sampled", some of the singular configurations, by distance.
        statements: What is certified about each range of `reachable`, `pdw` and `piw`, in this
            order; of a workspace that is empty too.
    """

    arm: SpaceArm
    mode: BaseMode
    limits: bool
    reachable: Array
    pdw: Array
    piw: Array
    shells: tuple[Shell, ...]
    reachable_at: Array
    kind: Kind
    gap: float
    effort: int
    covered: Array
    proof: tuple[Array, ...]
    resolution: float
    configurations: Array
    statements: tuple[RangeStatement, ...]

    JSON: ClassVar[Mapping[str, str]] = {"kind": "bounds"}

    @property
    def planar(self) -> bool:
        """Whether the arm moves in a plane, so that shells are rings."""
        return self.arm.tree.plane_normal() is not None

    @property
    def volumes(self) -> dict[str, float]:
        """Volumes [m^3] of reachable, pdw and piw; areas [m^2] for planar arms."""
        names = ("reachable", "pdw", "piw")
        return {name: self._volume(getattr(self, name)) for name in names}

    @property
    def fraction(self) -> float:
        """Path independent share of the reachable workspace; 0 or 1 if this is a mere sphere."""
        volumes = self.volumes
        if volumes["reachable"] == 0.0:
            return float(not len(self.pdw))
        return volumes["piw"] / volumes["reachable"]

    def _volume(self, radii: Array) -> float:
        power = 2 if self.planar else 3
        factor = np.pi if self.planar else 4.0 / 3.0 * np.pi
        return float(factor * (radii[:, 1] ** power - radii[:, 0] ** power).sum())

    @cached_property
    def free(self) -> Array:
        """(k, 2) free workspace: distances at which every point is reached at every attitude [m].

        As defined by Vafa and Dubowsky, from a numerical search for tip positions. Its bounds are
        exact if the arm has as many joints as the position has components and no joint limits
        count, else accurate to 1e-4 of the largest radius.

        Raises:
            UnsupportedError: The arm has sliding or mimic joints.
        """
        if self.arm.slides.any() or self.arm.coupling is not None:
            raise UnsupportedError(
                f"{self.arm.name}: the attitude-independent workspace is computed for independent "
                "revolute joints only; lock the sliding joints, and those that others mimic"
            )
        return free_workspace(self.arm, self.mode, self.limits, self.reachable[0])

    def regions(self, point: ArrayLike, *, start: Configuration | None = None) -> Region:
        """Decide whether a point is unreachable, path independent or path dependent.

        Args:
            point: (3,) from the system CM in inertial axes [m], or (2,) in the plane of a planar
                arm, beside which all points are unreachable.
            start: A configuration in whose inertial frame the point is given, such as the start of
                a plan; if None, the point is given from the system CM.

        Raises:
            ConfigurationError: The point has the wrong shape or is not finite.
        """
        p = position(self.arm, point, self.mode, start)
        R = float(np.linalg.norm(p))
        beside = off_plane(self.arm, p, self.mode) > TOLERANCE
        if beside or not _within(R, self.reachable):
            return Region("unreachable", R, (), p)
        if not _within(R, self.pdw):
            return Region("path independent", R, (), p)
        box = Box.of(self.arm.lower, self.arm.upper, self.limits)
        exact = exact_set(self.arm, self.mode)
        if exact is not None:
            return Region("path dependent", R, singular_at(p, exact, box, self.shells), p)
        q = singular_near(self.arm, self.mode, self.limits, R, self.configurations)
        found = () if q is None else (_brought_to(self.arm, q, p, self.mode),)
        return Region("path dependent", R, found, p)

    def profile(self, **options: Any) -> RiskProfile:
        """Estimate how likely singularities are at each distance; see `risk_profile`.

        Args:
            **options: Options of `risk_profile`.
        """
        return risk_profile(self.arm, mode=self.mode, limits=self.limits, **options)

    def to_dict(self) -> dict[str, Any]:
        """Return fields, `fraction` and `volumes` as plain JSON data, those of a plane as `areas`.

        Left out are `free`, which takes as long to compute as the rest, and `proof` and
        `configurations`, which are long.
        """
        sizes = "areas" if self.planar else "volumes"
        long = ("proof", "configurations")
        own = {name: value for name, value in super().to_dict().items() if name not in long}
        return own | plain({sizes: self.volumes, "fraction": self.fraction})

    @property
    def not_checked(self) -> str:
        """What the answer does not cover."""
        return "collisions" if self.limits else "joint limits, collisions"

    def describe(self) -> Description:
        """Describe reachable, path dependent and path independent distances, and what is proven.

        The free workspace is among them where it has been computed.
        """
        how: str = self.kind
        if self.effort:
            how += f" from {self.effort:,} singular configurations"
        if self.kind == "sampled":
            how += f", resolution {self.resolution:.3g} m; not certified"
            if np.isfinite(self.gap):
                how += f"; distances may be off by up to {self.gap:.3g} m"
        elif self.kind != "stopped":
            how += f", proven to {self.gap:.3g} m"
        ranges = {"reachable": self.reachable, "path dependent": self.pdw,
                  "path independent": self.piw}  # fmt: skip
        if "free" in vars(self):
            ranges["free"] = self.free
        rows: list[tuple[Cell, ...]] = []
        for name, radii in ranges.items():
            sizes = [self._volume(radii), *[None] * len(radii)]
            stated = [one for one in self.statements if one.workspace == name]
            words = [_in_words(one) for one in stated] or ["by numerical search"] * len(radii)
            rows += [(name, *row) for row in zip(*radii.T, sizes, words, strict=False)]
            rows += [(name, "none", "", "", *words[:1])] if not len(radii) else []
        used = {one.bounds for one in self.statements} - {"certified"}
        meanings = [f"{word}: {meaning}" for word, meaning in MEANING.items() if word in used]
        size = Column("area", "m²", ".7g") if self.planar else Column("volume", "m³", ".7g")
        distances = (Column("from", "m", ".7f"), Column("to", "m", ".7f"))
        return Description(
            title=f"{self.arm.name}, {self.mode}",
            verdict=f"{self.fraction:.2%} of the reachable workspace is path independent",
            notes=[f"distances of the tip from the system CM ({how})", *meanings],
            tables=[Table(("workspace", *distances, size, "bounds"), rows)],
        )

    def __repr__(self) -> str:
        def text(radii: Array) -> str:
            return " ".join(f"[{low:.7g}, {high:.7g}]" for low, high in radii) or "none"

        return (
            f"Workspace({self.arm.label}, {self.mode}, {self.kind}: reachable "
            f"{text(self.reachable)}, PDW {text(self.pdw)}, PIW {text(self.piw)} m)"
        )


@checked
def workspace(
    arm: SpaceArm,
    *,
    mode: BaseMode = "free-floating",
    limits: bool = False,
    effort: int | None = None,
    seed: int = 0,
    progress: Callable[[float, float], object] | None = None,
) -> Workspace:
    """Compute the path dependent and path independent workspaces of an arm.

    Section V of Papadopoulos & Dubowsky (1993), DOI 10.1115/1.2897406.

    Args:
        arm: Any arm with one tip. The bounds are certified, as a rule, for revolute joints, as many
            as the task has rows, for redundant arms with the full pose or "x y rz" in the plane,
            and for three joints with "x y"; of other arms they are sampled.
        mode: What the spacecraft does. "fixed" leaves only the kinematic singularities, and
            distances count from the spacecraft's own CM. "attitude-controlled" leaves only these
            too if the CM of each link is on the line between its joints (section VI).
        limits: Whether only configurations within the joint limits count; if not, every joint
            turns freely, as in the paper.
        effort: Singular configurations to search from, for arms of more than three joints; 200,000
            by default. If the bounds are sampled, uniform configurations from which singular ones
            are searched; 40,000 by default.
        seed: Seed of that search.
        progress: Called now and then as progress(done, 1).

    Returns:
        The radii of all workspaces, and how far they are proven.

    Raises:
        ConfigurationError: An argument is not valid.
        UnsupportedError: The arm has several tips or a prismatic joint without limits, or can never
            do its task.
        StoppedError: Ctrl-C; carries the workspace as far as it is known.

    Example:
        >>> import spacearm as sa
        >>> sa.workspace(sa.load("planar2")).pdw.round(4)  # the paper: 0.352 0.554, 1.436 2.288
        array([[0.3511, 0.5537],
               [1.4362, 2.2872]])
    """
    if effort is not None:
        effort = whole(effort, "effort", 1)
    require_possible(arm, FLOATING)
    rng = generator(seed)
    found = exact_set(arm, mode)
    if found is None:
        starts = STARTS if effort is None else effort
        return _sampled_workspace(arm, mode, limits, starts, rng, progress)
    if effort is None:
        effort = EFFORT
    box = Box.of(arm.lower, arm.upper, limits)
    points = rng.uniform(box.low, box.high, (4096, arm.n))
    small = arm.n <= MOST_CERTIFIED
    part = 1.0 if small else SEARCHES

    def searching(share: float, _: float) -> None:
        if progress:
            progress(part * share, 1.0)

    def proving(share: float) -> None:
        if progress:
            progress(part + (1.0 - part) * share, 1.0)

    search, shells = ShellSearch(arm, mode, box, searching), list[Shell]()
    reach = [search.about((), points)]

    def known(
        proof: Proven | None = None,
        outside: float = np.nan,
        beyond: float = np.nan,
        farthest: float = 0.0,
    ) -> Workspace:
        reachable = merged([shell.radius for shell in reach])
        pdw = merged([shell.radius for shell in shells])
        piw = without(reachable, pdw, TOLERANCE)
        kind, gap, uncovered = _STOPPED, np.nan, np.full(len(pdw), np.nan)
        small_enough = max(TOLERANCE, SMALL * farthest)
        if proof is not None:
            uncovered = _widest_left(pdw, proof.radii)
            gap = max(outside, beyond, float(uncovered.max(initial=0.0)))
            kind = "certified" if gap <= small_enough else "found"
        return Workspace(
            arm=arm,
            mode=mode,
            limits=limits,
            reachable=reachable,
            pdw=pdw,
            piw=piw,
            shells=tuple(sorted(shells, key=lambda shell: shell.radius[0])),
            reachable_at=reach[0].at,
            kind=kind,
            gap=gap,
            effort=0 if small else effort,
            covered=np.empty((0, 2)) if proof is None else proof.radii,
            proof=() if proof is None else proof.curves,
            resolution=0.0,
            configurations=np.empty((0, arm.n)),
            statements=statements(
                reachable,
                pdw,
                piw,
                beyond=beyond,
                outside=outside,
                uncovered=uncovered,
                certified=small_enough,
            ),
        )

    def keep(so_far: list[Shell]) -> None:
        shells[:] = so_far

    try:
        if small:
            reach, reach_gap = search.proven((), reach)
            farthest = float(reach[0].radius[1])
        else:
            farthest = largest_distance_within(arm, mode, box, reach[0].radius)
        surfaces = small and found.codimension == 1 and found.dimension == 2
        for resolution in (COARSE, 0.0) if surfaces else (0.0,):
            if small and found.codimension == 1:
                keep(search.exact(found, resolution))
            else:
                keep(search.sampled(found, FEW if small else effort, rng, reach[0].at, keep))
            if small:
                equations = found.triangle.equations
                proven, gap = search.proven(equations, shells, lambda q: _is_member(found, q))
                keep(proven)
            else:
                gap = left_out(found, box, merged([shell.radius for shell in shells]), farthest)
                reach_gap = gap  # it bounds the distances beyond both ends
            proof = prove_shells(found, box, shells, farthest, proving)
            result = known(proof, min(gap, farthest), min(reach_gap, farthest), farthest)
            if result.kind == "certified":
                break
    except KeyboardInterrupt:
        why = "shells may be missing, or wider than found so far"
        raise StoppedError(why, known()) from None
    return result


def _widest_left(ranges: Array, parts: Array) -> Array:
    """Return the width of the widest part of each range (k, 2) that parts (m, 2) leave, (k,)."""
    left = [without(one[None], parts) for one in ranges]
    return np.array([float(np.diff(rest).max(initial=0.0)) for rest in left])


def _is_member(found: ExactSet, q: Array) -> bool:
    """Check whether a root (n,) of the equations of a singular set is singular."""
    return bool(found.are_singular(q[None])[0])


def _sampled_workspace(
    arm: SpaceArm,
    mode: BaseMode,
    limits: bool,
    starts: int,
    rng: np.random.Generator,
    progress: Callable[[float, float], object] | None,
) -> Workspace:
    """Compute the workspaces of an arm by a search for singular configurations."""
    arm.require_one_tip()
    check_slides(arm)

    def searching(share: float) -> None:
        if progress:
            progress(share, 1.0)

    sampler = SingularSampler(arm, mode, limits, rng, searching)
    sampler.find_reach()
    stopped = False
    try:
        sampler.search(starts)
        sampler.walk_into_gaps()
    except KeyboardInterrupt:
        stopped = True
    found = sampler.result()
    reachable = found.reachable[None]
    pdw = merged([shell.radius for shell in found.shells])
    piw = without(reachable, pdw, TOLERANCE)
    stated = statements(
        reachable,
        pdw,
        piw,
        beyond=np.nan if stopped else max(found.reachable[0], found.farthest - found.reachable[1]),
        outside=np.nan if stopped else found.gap,
        uncovered=np.full(len(pdw), found.resolution),
        certified=max(TOLERANCE, SMALL * float(found.reachable[1])),
        sampled=True,
    )
    result = Workspace(
        arm=arm,
        mode=mode,
        limits=limits,
        reachable=reachable,
        pdw=pdw,
        piw=piw,
        shells=tuple(found.shells),
        reachable_at=found.reachable_at,
        kind="stopped" if stopped else "sampled",
        gap=np.nan if stopped else found.gap,
        effort=found.found,
        covered=np.empty((0, 2)),
        proof=(),
        resolution=found.resolution,
        configurations=found.configurations,
        statements=stated,
    )
    if stopped:
        raise StoppedError("singular configurations may be missing", result)
    return result


def _in_words(one: RangeStatement) -> str:
    """Write what is certified about a range."""
    if not np.isfinite(one.error):
        return one.bounds
    if one.bounds == "certified":
        return f"certified to {one.error:.2g} m"
    return f"{one.bounds}, off by at most {one.error:.2g} m"


def _within(R: float, radii: Array) -> bool:
    """Check whether R is in one of the ranges (k, 2)."""
    return bool(((radii[:, 0] - TOLERANCE <= R) & (radii[:, 1] + TOLERANCE >= R)).any())
