"""Free boxes: ranges of the joints in which no configuration is singular, proven.

A box is grown from a configuration, or from the ranges of a motion, one side at a time: a side
moves on as soon as the slab that it adds is proven free (`polynomial.free_regions`), and stops
where a singular configuration is found in the slab. What is nearest to the side is proven first:
where the effort ends, the side moves through what is proven. With a clearance the slab counts with
everything that is no farther from it.

One polynomial S that changes its sign at singular configurations keeps it in a box if |S| is not
zero where it is least (`free_regions.shrunk`): a slab counts as a whole then. With a clearance all
cells are proven.

The box may have coordinates beyond the joints, whose ranges stand from the beginning: the numbers
of an arm that are known in intervals (`uncertainty.robust_boxes`).
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import numpy as np
import scipy

from spacearm.arrays import Array, ArrayLike, Progress, floats, numbers_of, positive, shape_of
from spacearm.errors import ConfigurationError, NoSolutionError
from spacearm.files import write
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_name, joint_scales
from spacearm.polynomial.free_regions import Effort, Region, Roots, halved, shrunk
from spacearm.polynomial.newton import shortened
from spacearm.polynomial.tubes import ROUNDING, about_box
from spacearm.results import Cell, Description, Result, Table, joint_measures
from spacearm.signatures import checked, shown
from spacearm.singularities.immaterial_masses import payload_note
from spacearm.singularities.nearest import STRIDE, NearestSearch
from spacearm.singularities.polynomials import chart_of, minors_for_proofs

#: How far before a singular configuration a side stops, as a share of the width of its joint, which
#: counts as no less than so much; and how many times as far at most.
SHARE, LEAST_WIDTH, MORE = 0.0085, 0.02, 1.15
#: Cells, and random configurations, that are looked at together.
BATCH = 512
#: Clouds of configurations about a singular one, each half as wide, to look for nearer ones in.
POLISHED = 14
#: Starts of a search for singular configurations, about one that was found and in a whole slab, and
#: of several minors from cells; steps of each of these.
FEW, MANY, DESCENT = 64, 256, 12
#: Distance to first order up to which such a search has arrived.
ON_THE_SET = 1e-9
#: Half width of cells that are not halved; parts of a way to a root.
NARROW, PARTS = 1e-7, 64
TURN = 2.0 * np.pi
#: How far beyond a range joint positions may be by rounding, as a share of one plus themselves.
ROUNDED = 1e-13
#: How many times as many cells a slab gets as long as no part of it worth a move is proven.
PATIENCE = 3
#: Coefficients of polynomials that get the whole effort; of larger ones a cell takes longer.
LARGE = 40_000

Side = Literal["lower", "upper"]
SIDES: tuple[Side, Side] = ("lower", "upper")
Why = Literal["singular", "limit", "turn", "irrelevant", "undecided"]
WORDS: dict[Why, str] = {
    "singular": "a singular posture",
    "limit": "its limit",
    "turn": "nothing: a whole turn is free",
    "irrelevant": "nothing: it does not matter",
    "undecided": "the proof ended here",
}


class Postures(Protocol):
    """What has an arm and joint positions: a `Configuration` or a `Motion`."""

    @property
    def arm(self) -> SpaceArm:
        """The arm."""

    @property
    def q(self) -> Array:
        """(n,) or (m, n) joint positions."""


class Stop(NamedTuple):
    """What stops a side of a box.

    Attributes:
        joint: Name of the joint.
        side: Which end of its range.
        why: "singular": `at` is singular, just beyond the side, or nearer to it than the clearance;
            "limit": the range allowed ends; "turn": all angles are free; "irrelevant": no singular
            configuration depends on the joint; "undecided": the budget of the proof ended.
        at: (n,) the singular configuration; None if there is none.
        values: Of a box for all values of uncertain numbers those with which it is singular.
    """

    joint: str
    side: Side
    why: Why
    at: Array | None
    values: dict[str, float] | None = None


class FreeBox(Result):
    """Ranges of the joints in which no configuration is singular: proven, rounding included.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        lower: (n,) least position of each joint [rad] or [m]; -inf where any is free.
        upper: (n,) largest position; inf where any is free.
        clearance: Every singular configuration is farther than this from every one in the box
            [rad]; sliding joints count as in `SingularityReport.radian`.
        stops: What stops each side, lower and upper of one joint after the other.
        cells: Number of cells that the proof took.
        uncertain: Intervals of uncertain numbers by name: nothing in the ranges is singular for any
            value in them (`free_box_for_all`). All other numbers are those of the arm.
    """

    arm: SpaceArm
    mode: BaseMode
    lower: Array
    upper: Array
    clearance: float
    stops: tuple[Stop, ...]
    cells: int
    uncertain: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The ends of each joint's range by its name."""
        ends = zip(self.lower.tolist(), self.upper.tolist(), strict=True)
        return dict(zip(self.arm.joint_names, ends, strict=True))

    def contains(self, postures: Postures | ArrayLike) -> bool:
        """Check whether joint positions are in the box, of a motion also those between its rows.

        Args:
            postures: A configuration, a motion, or (n,) or (m, n) joint positions.

        Raises:
            ConfigurationError: They have another shape.
        """
        way = getattr(postures, "control_points", getattr(postures, "q", postures))
        q = numbers_of(way, "postures")
        if not q.ndim or q.shape[-1] != self.arm.n:
            raise ConfigurationError(f"postures has shape {q.shape}; give (m, {self.arm.n})")
        beyond = np.maximum(self.lower - q, q - self.upper)  # the proof reaches a little farther
        return bool((beyond <= ROUNDED * (1.0 + np.abs(q))).all())

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the box as a TOML file, in radians and metres.

        Args:
            path: The file to write.

        Returns:
            The path.

        Raises:
            SpaceArmError: The file cannot be written.
        """
        lines = [
            f"# No configuration of {json.dumps(self.arm.name)} in these ranges is singular.",
            *(f"# For {name} from {a!r} to {b!r}." for name, (a, b) in self.uncertain.items()),
            f"arm = {json.dumps(self.arm.name)}",
            f"mode = {json.dumps(self.mode)}",
            f"clearance = {float(self.clearance)!r}",
            "",
            "[ranges]",
            *(f"{json.dumps(name)} = [{a!r}, {b!r}]" for name, (a, b) in self.ranges.items()),
        ]
        return write(Path(path), ("\n".join(lines) + "\n").encode())

    not_checked = "collisions, rates, whether another box has more volume"

    def describe(self) -> Description:
        """Describe the ranges, and what stops each side."""
        slides, names = self.arm.slides, self.arm.joint_names
        why = [WORDS[stop.why] for stop in self.stops]
        ends = {
            "joint": names,
            "lower": joint_measures(self.lower, slides),
            "upper": joint_measures(self.upper, slides),
            "width": joint_measures(self.upper - self.lower, slides),
            "lower stopped by": why[::2],
            "upper stopped by": why[1::2],
        }
        found = {
            f"{stop.joint}, {stop.side}": joint_measures(stop.at, slides)
            for stop in self.stops
            if stop.at is not None
        }
        columns: dict[str, Sequence[Cell]] = {"joint": names, **found}
        tables = [Table.by_columns(ends)]
        if found:
            tables.append(Table.by_columns(columns, "Singular postures that stop a side"))
        if self.uncertain:
            facts = {
                name: f"{low:.6g} to {high:.6g}" for name, (low, high) in self.uncertain.items()
            }
            tables.append(Table.facts(facts, "For all values of"))
        open_ = sum(stop.why == "undecided" for stop in self.stops)
        return Description(
            title=f"{self.arm.name}, {self.mode}",
            verdict=f"no posture in these joint ranges is singular, proven{self._with_clearance}",
            tone="good",
            notes=[
                payload_note(self.arm, self.mode),
                *[f"{open_} sides may go on: the proof ended there."] * bool(open_),
            ],
            tables=tables,
        )

    @property
    def _with_clearance(self) -> str:
        degrees = np.degrees(self.clearance)
        return f", nor any within {degrees:.4g}° of them" if self.clearance else ""


@checked
def free_box(
    about: Postures,
    *,
    joints: Sequence[str] = (),
    at_least: float | None = None,
    within: tuple[ArrayLike, ArrayLike] | None = None,
    clearance: float = 0.0,
    mode: BaseMode = "free-floating",
    effort: float = 1.0,
    progress: Progress | None = None,
) -> FreeBox:
    """Find joint ranges about a configuration or a motion in which nothing is singular, proven.

    All sides grow at the same pace until each is stopped, so that the box is large and balanced;
    that no other box has more volume is not proven. Sides stop within 1 % of the width of their
    joint before a singular configuration. Joints on which no singular configuration depends get
    their whole range.

    Args:
        about: A configuration, or a motion, whose joint positions are all in the box.
        joints: Joints whose ranges grow first, as wide as they can; the others grow afterwards.
        at_least: Width that every range must have [rad], grown first; sliding joints count as in
            `SingularityReport.radian`.
        within: (n,) least and (n,) largest positions allowed; the joint limits if None.
        clearance: How far every singular configuration must be from every one in the box [rad].
        mode: What the spacecraft does; see `generalized_jacobian`.
        effort: Factor on the number of cells that the proof may take. The time grows with it; sides
            that are undecided because the proof ended may move on with more.
        progress: Called now and then as progress(done, most); it may end before.

    Returns:
        The box.

    Raises:
        ConfigurationError: `about` is outside the range allowed, or an argument makes no sense.
        UnsupportedError: J* has no minors that a proof could use, as with mimic joints.
        NoSolutionError: The ranges of `about` are not proven free, or are not as wide as asked for.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> box = sa.free_box(arm.at([0.3, 1.2]))
        >>> box.contains([0.4, 1.3]), box.contains([0.3, 0.0])
        (True, False)
    """
    minors = minors_for_proofs(about.arm, mode)
    size = sum(minor.polynomial.coefficients.size for minor in minors)
    share = positive(effort, "effort", "a factor") * min(1.0, LARGE / size)

    def region(*where: Array) -> Region:
        return Roots(minors, *where)

    cells = Effort(0.4, math.ceil(400_000 * share), math.ceil(20_000 * share))
    return grown(about, region, mode, joints, at_least, within, clearance, progress, cells).box()


def grown(
    about: Postures,
    region: Callable[[Array, Array, Array, Array], Region],
    mode: BaseMode,
    joints: Sequence[str],
    at_least: float | None,
    within: tuple[ArrayLike, ArrayLike] | None,
    clearance: float,
    progress: Progress | None,
    effort: Effort,
) -> Growth:
    """Grow a box about postures as `free_box` does.

    `region` returns what proves, of origin, unit, least and largest x of the joints, (n,) each.
    """
    arm = about.arm
    way = np.asarray(getattr(about, "control_points", about.q)).reshape(-1, arm.n)
    if clearance:
        positive(clearance, "clearance", "angle [rad]")
    named = [arm.joint_names.index(joint_name(arm, name)) for name in joints]
    widths = None if at_least is None else positive(at_least, "at_least", "width [rad]")
    ends = np.array(range_allowed(arm, way, within))
    growth = Growth(region, arm, mode, np.clip(way, *ends), ends, clearance, progress, effort)
    growth.start()
    if widths is not None:
        growth.grow(growth.relevant, widths)
        growth.check_widths(widths)
    growth.grow(named)
    growth.grow(growth.relevant)
    return growth


def range_allowed(
    arm: SpaceArm, rows: Array, within: tuple[ArrayLike, ArrayLike] | None
) -> tuple[Array, Array]:
    """Return the least and largest positions allowed, (n,) each.

    Raises:
        ConfigurationError: They do not hold all rows (m, n).
    """
    low, high = arm.lower, arm.upper
    if within is not None:
        whole = shape_of(within) == (2, arm.n)  # infinite ends are allowed
        given = floats(within if whole else np.nan)
        if np.isnan(given).any():
            raise ConfigurationError(
                f"within is {shown(within)}; give (lower, upper), {arm.n} numbers each"
            )
        low, high = given
    outside = np.maximum(low - rows, rows - high) > ROUNDED * (1.0 + np.abs(rows))
    if outside.any():
        i, j = np.argwhere(outside)[0]
        raise ConfigurationError(
            f"joint {arm.joint_names[j]!r} is at {rows[i, j]:.9g}, outside the range allowed, "
            f"{low[j]:.9g} to {high[j]:.9g}; give another with within="
        )
    return low, high


class Growth:
    """A box that grows, in x = (q - origin) / unit; its sides are numbered (joint, 0 or 1).

    Args:
        region: Returns what proves it.
        arm: The arm.
        mode: What the spacecraft does.
        rows: (m, n) configurations that it starts from.
        ends: (2, n) least and largest positions allowed.
        clearance: How far from the box singular configurations must be.
        progress: Called with the progress on the cells.
        effort: How it grows, and how long.
    """

    def __init__(
        self,
        region: Callable[[Array, Array, Array, Array], Region],
        arm: SpaceArm,
        mode: BaseMode,
        rows: Array,
        ends: Array,
        clearance: float,
        progress: Progress | None,
        effort: Effort,
    ) -> None:
        self.arm, self.mode, self.ends = arm, mode, ends
        self.clearance, self.progress, self.effort = clearance, progress, effort
        unit, origin, chart = joint_scales(arm), rows[0], chart_of(arm)
        far = np.where(arm.slides, chart.half, TURN)
        middle = np.where(arm.slides, chart.centre, origin)
        allowed = np.clip(ends, middle - far, middle + far)
        x = (rows - origin) / unit
        self.extent = np.stack((-x.min(axis=0), x.max(axis=0)), axis=1)  # of each side, outwards
        self.bound = np.maximum(np.abs(allowed - origin).T / unit[:, None], self.extent)
        low, high = -self.bound[:, 0] - clearance, self.bound[:, 1] + clearance
        self.origin, self.unit, n = origin, unit, arm.n
        self.region = region(origin, unit, low, high)
        self.relevant = [int(j) for j in np.flatnonzero(self.region.relevant[:n])]
        more = len(self.region.relevant) - n
        self.extent = np.vstack((self.extent, np.ones((more, 2))))
        self.clear = np.where(self.region.relevant, clearance, 0.0)
        self.clear[n:] = 0.0
        self.stopped: dict[tuple[int, int], tuple[Why, Array | None]] = {}
        self.found: list[Array] = []
        self.cells = 0
        self.rng = np.random.default_rng(0)
        self.alone = self.region.alone
        self.whole = self.alone and not clearance
        self.sign = np.sign(self.region.values(np.zeros((1, n + more)))[0])

    def corners(self) -> tuple[Array, Array]:
        """Return the corners of the box, (n,) each; zeros of joints that do not matter."""
        return self.reduced(-self.extent[:, 0]), self.reduced(self.extent[:, 1])

    def reduced(self, X: Array) -> Array:
        """Return x (..., n) with zeros for the joints that do not matter."""
        return np.where(self.region.relevant, X, 0.0)

    def start(self) -> None:
        """Prove the box that is there before any side has moved.

        Raises:
            NoSolutionError: It is not proven; carries the singular configuration if one is there.
        """
        low, high = self.corners()
        proven, root = self.prove(low, high, None)
        if proven < np.inf:
            near = "" if root is None else ": a singular posture is in them or too near"
            raise NoSolutionError(
                f"{self.arm.name}: the joint ranges of the start are not proven free of "
                f"singularities{near}; give a part of the motion, or a smaller clearance",
                None if root is None else self.positions(root),
            )

    def check_widths(self, least: float) -> None:
        """Check that all ranges are as wide as asked for.

        Raises:
            NoSolutionError: One is not; carries the box that there is.
        """
        widths = self.extent.sum(axis=1)
        short = [j for j in self.relevant if widths[j] < least * (1.0 - 1e-9)]
        if short:
            j = short[0]
            raise NoSolutionError(
                f"{self.arm.name}: the range of {self.arm.joint_names[j]!r} is proven to "
                f"{np.degrees(widths[j]):.4g} of the {np.degrees(least):.4g} degrees asked for; "
                "ask for less, or start elsewhere",
                self.box(),
            )

    def positions(self, x: Array) -> Array:
        """Return the joint positions of x (n,)."""
        return np.asarray(self.origin + self.unit * x[: self.arm.n])

    def grow(self, joints: Sequence[int], widest: float = np.inf) -> None:
        """Move the sides of joints outwards, in turn, until all are stopped or as wide as asked."""
        step = dict.fromkeys([(j, s) for j in joints for s in (0, 1)], self.effort.step)
        moving = [side for side in step if side not in self.stopped]
        while moving:
            for side in moving:
                self.move(side, step, widest)
            moving = [side for side in moving if side not in self.stopped]
            moving = [side for side in moving if self.extent[side[0]].sum() < widest]

    def move(
        self, side: tuple[int, int], step: dict[tuple[int, int], float], widest: float
    ) -> None:
        """Move one side outwards by its step, or less; or say why it has stopped."""
        (j, s), here = side, self.extent[side]
        width, margin = float(self.extent[j].sum()), self.margin(side)
        if width >= widest:
            return
        root, cap = self.nearest_to(side)
        turn = np.inf if self.arm.slides[j] else TURN - self.extent[j, 1 - s]
        if here >= min(self.bound[side], turn):
            self.stopped[side] = ("turn" if here >= turn else "limit", None)
        elif cap - here <= MORE * margin:
            self.stopped[side] = ("singular", root)
        elif step[side] < margin / 4.0 or self.effort.spent(self.cells):
            self.stopped[side] = ("undecided", None)
        else:
            wanted = here + widest - width
            to = min(here + step[side], self.bound[side], turn, cap - margin, wanted)
            low, high = self.corners()
            start, end = (low, high) if s else (high, low)
            start[j], end[j] = (here, to) if s else (-here, -to)
            proven, root = self.prove(*((start, end) if s else (end, start)), side)
            self.extent[side] = min(max(proven - NARROW, here), to)
            if root is not None:
                self.found.append(root)
            elif proven < to:
                step[side] = (to - here) / 2.0 if self.whole else proven - here

    def margin(self, side: tuple[int, int]) -> float:
        """Return how far before a singular x a side stops."""
        return SHARE * max(float(self.extent[side[0]].sum()), LEAST_WIDTH)

    def nearest_to(self, side: tuple[int, int]) -> tuple[Array | None, float]:
        """Return the singular x that stops a side first, and how far the side may be."""
        if not self.found:
            return None, np.inf
        X, (j, s) = np.array(self.found), side
        ahead = (X[:, j] if s else -X[:, j]) > self.extent[side] - 1e-9
        far = np.where(ahead, self.room(X, 0.0, side), np.inf)
        best = int(np.argmin(far))
        return X[best], float(far[best])

    def room(self, centre: Array, half: Array | float, side: tuple[int, int]) -> Array:
        """Return how far a side may be before cells are in the box or nearer than the clearance."""
        (j, s), (low, high) = side, self.corners()
        beyond = np.maximum(np.maximum(low - centre - half, centre - half - high), 0.0)
        beyond[:, j] = 0.0
        gap = self.clear.max() ** 2 - (beyond**2).sum(axis=1)
        begin = ((2 * s - 1) * centre - half)[:, j]
        return np.where(gap >= -1e-12, begin - np.sqrt(np.maximum(gap, 0.0)), np.inf)

    def box(self) -> FreeBox:
        """Return the box."""
        edges = self.positions(-self.extent[:, 0]), self.positions(self.extent[:, 1])
        at_end = (np.isclose(x, end, 1e-15, 1e-15) for x, end in zip(edges, self.ends, strict=True))
        lower, upper = (np.where(*z) for z in zip(at_end, self.ends, edges, strict=True))
        stops = []
        for j, name in enumerate(self.arm.joint_names):
            whole = any(self.stopped.get((j, s), ("",))[0] == "turn" for s in (0, 1))
            if whole or j not in self.relevant:
                lower[j], upper[j] = self.ends[:, j]
            for s, side in enumerate(SIDES):
                why, x = self.stopped.get((j, s), ("undecided", None))
                if whole or j not in self.relevant:
                    why, x = ("turn" if j in self.relevant else "irrelevant"), None
                stops.append(Stop(name, side, why, None if x is None else self.positions(x)))
        return FreeBox(
            arm=self.arm,
            mode=self.mode,
            lower=lower,
            upper=upper,
            clearance=float(self.clearance),
            stops=tuple(stops),
            cells=self.cells,
        )

    # --- the proof of a slab ------------------------------------------------------------------

    def prove(
        self, low: Array, high: Array, side: tuple[int, int] | None
    ) -> tuple[float, Array | None]:
        """Prove that no singular x is in a slab or nearer than the clearance, or find one.

        Returns:
            How far the side may be, infinity if all is proven; and the singular x (n,), or None.
        """
        if (root := self.crossing(low, high, side)) is not None:
            return -np.inf, root
        outer = np.array((low - self.clear, high + self.clear))
        centre, half = outer.mean(axis=0), 0.5 * (outer[1] - outer[0]) * (1.0 + ROUNDING)
        cells = [centre[None], half[None], np.zeros(1, dtype=int), np.full(1, -np.inf)]
        looked, box = 0, self.corners()
        enough = -np.inf if side is None else self.extent[side] + self.margin(side)
        while len(cells[0]):
            order = np.argsort(cells[3], kind="stable")
            centre, half, age, begin = (part[order[:BATCH]] for part in cells)
            later = [part[order[BATCH:]] for part in cells]
            inside = about_box(centre, half, low, high, c) if (c := self.clearance) else None
            trial = self.region.tried(centre, half, age, inside)
            looked, self.cells = looked + trial.work, self.cells + trial.work
            if self.progress:
                self.progress(min(self.cells, self.effort.cells), self.effort.cells)
            beyond = trial.value * self.sign < 0.0
            left = ~trial.free | beyond
            parts = (centre, half, age, trial.taken, trial.steady * self.sign, beyond)
            centre, half, age, taken, rising, beyond = (part[left] for part in parts)
            if not len(centre):
                cells = later
                continue
            root = None
            if beyond.any():
                root = self.crossing(low, high, side, centre[beyond])
            elif not self.alone and looked > BATCH:
                smallest = np.argsort(half.max(axis=1))[:FEW]
                root = self.crossing(low, high, side, centre[smallest])
            narrow = half.max(axis=1).min() < NARROW
            proven = float(begin[left][0]) if root is None else -np.inf
            most = self.effort.slab * (PATIENCE if -np.inf < proven < enough else 1)
            done = looked >= most or self.effort.spent(self.cells)
            if root is not None or done or narrow:
                return proven, root
            if not self.clearance:
                ends = np.minimum(low, box[0]), np.maximum(high, box[1])
                left, centre, half = shrunk(centre, half, rising, *ends)
                centre, half, age, taken = (part[left] for part in (centre, half, age, taken))
            centre, half = halved(centre, half, np.where(half > 0.0, taken, 0.0))
            near = self.away(centre, half, low, high) <= self.clearance
            begin = np.full(len(centre), -np.inf)
            if side is not None and not self.whole:
                begin = self.room(centre, half, side)
            new = (part[near] for part in (centre, half, np.tile(age, 2), begin))
            cells = [np.concatenate(parts) for parts in zip(new, later, strict=True)]
        return np.inf, None

    def away(self, centre: Array, half: Array | float, low: Array, high: Array) -> Array:
        """Return how far cells are from a slab, rounded down."""
        beyond = np.maximum(np.maximum(low - centre - half, centre - half - high), 0.0)
        return np.asarray(np.linalg.norm(beyond, axis=1) * (1.0 - 1e-12))

    def crossing(
        self,
        low: Array,
        high: Array,
        side: tuple[int, int] | None,
        X: Array | None = None,
    ) -> Array | None:
        """Return a singular x in a slab, near the box; None if none is seen.

        Args:
            low: (n,) lower corner of the slab.
            high: (n,) upper corner.
            side: The side that moves.
            X: Where to look first, (m, n); random ones if None.
        """
        best: Array | None = None
        start, end = low - self.clear, high + self.clear
        for i in range(POLISHED):
            if X is None:
                starts = FEW if i else MANY, len(low)
                spread = self.rng.uniform(-0.5, 0.5, starts) * (end - start)
                middle = 0.5 * (start + end) if best is None else best
                X = np.clip(middle + spread * 0.6**i, start, end)
            seen = [*self.roots_from(X, low, high, side, start, end)]
            seen = seen if best is None else [best, *seen]
            if not seen:
                break
            best = seen[int(np.argmin(self.gaps(np.array(seen), low, high, side)))]
            if side is not None and not self.clearance:  # only nearer ones count from now on
                (end if side[1] else start)[side[0]] = best[side[0]]
            X = None
        if best is None or not self.alone:
            return best
        return self.root(*self.between(best, low, high, side))

    def roots_from(
        self,
        X: Array,
        low: Array,
        high: Array,
        side: tuple[int, int] | None,
        start: Array,
        end: Array,
    ) -> Array:
        """Return singular x (k, n) in a slab, or no farther from it than the clearance.

        A minor that is alone changes its sign on the way there: x is just beyond. Several are
        followed by the Gauss-Newton method, between `start` and `end`; coordinates that would leave
        them stay where they are.
        """
        if not self.alone:
            n = self.arm.n  # of uncertain numbers the middle is searched
            search = NearestSearch(self.arm, self.mode, self.origin[None], start[:n], end[:n])
            X = X[:, :n]
            for _ in range(DESCENT):
                distance, _, rows = search.linearise(X)
                way = np.minimum(distance, STRIDE)[:, None] * rows[:, 0]
                free = np.where(search.within(X - way) == X, 0.0, way)
                share = (way**2).sum(axis=1) / np.maximum((free**2).sum(axis=1), 1e-300)
                X = search.within(X - shortened(share[:, None] * free, STRIDE))
            X = X[search.linearise(X).distance <= ON_THE_SET]
            X = np.pad(X, ((0, 0), (0, len(start) - n)))
            return X[self.away(X, 0.0, low, high) <= self.clearance]
        X = X[self.away(X, 0.0, low, high) <= self.clearance]
        X = X[self.region.values(X) * self.sign < 0.0] if len(X) else X
        if not len(X):
            return X
        x = X[np.argmin(self.gaps(X, low, high, side))]
        return self.between(x, low, high, side)[1][None]

    def clipped(self, X: Array, low: Array, high: Array, side: tuple[int, int] | None) -> Array:
        """Return the points nearest to x (m, n) on the side from which a slab grows."""
        if side is None:
            return np.zeros_like(X)
        j, s = side
        low, high = low.copy(), high.copy()
        low[j] = high[j] = low[j] if s else high[j]
        return np.clip(X, low, high)

    def gaps(self, X: Array, low: Array, high: Array, side: tuple[int, int] | None) -> Array:
        """Return how far x (m, n) are from that side."""
        return np.asarray(np.linalg.norm(X - self.clipped(X, low, high, side), axis=1))

    def between(
        self, x: Array, low: Array, high: Array, side: tuple[int, int] | None
    ) -> tuple[Array, Array]:
        """Return the ends of the first part of the way from that side to x (n,) with a root."""
        edge = self.clipped(x[None], low, high, side)
        way = edge + np.linspace(0.0, 1.0, PARTS + 1)[:, None] * (x - edge)
        other = self.region.values(way[1:-1]) * self.sign < 0.0
        first = int(np.argmax(np.append(other, True)))
        return way[first], way[first + 1]

    def root(self, here: Array, there: Array) -> Array:
        """Return the root between x (n,) of different signs."""

        def value(share: float) -> float:
            return float(self.region.values((here + share * (there - here))[None])[0])

        if value(0.0) * value(1.0) >= 0.0:  # one of them is as good as zero
            return there
        return here + scipy.optimize.brentq(value, 0.0, 1.0, xtol=1e-12) * (there - here)
