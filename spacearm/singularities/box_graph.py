"""Free boxes as a graph: a cover of regular configurations, and paths through it.

The range of the joints is halved again and again along the joint that the proof takes most of
(`polynomial.free_regions`), the largest cells first, of these those whose proof lacks least. Cells
that are proven free are the boxes. Two boxes that share a part of a face are joined: a way from one
to the other through that part meets no singular configuration, and needs no further proof.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import cached_property
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy

from spacearm.arrays import Array, ArrayLike, Booleans, Integers, Progress, positive, whole
from spacearm.errors import ConfigurationError, NoSolutionError, StoppedError, StoreError
from spacearm.files import arrays_in, write
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales, joint_vector
from spacearm.polynomial.free_regions import Roots
from spacearm.polynomial.jets import Jets
from spacearm.polynomial.tubes import ROUNDING
from spacearm.processes import check_memory
from spacearm.results import Cell, Column, Description, Result, Table
from spacearm.signatures import checked
from spacearm.singularities.immaterial_masses import digest_of_set
from spacearm.singularities.joint_boxes import TURN, range_allowed
from spacearm.singularities.polynomials import minors_for_proofs

#: Cells that are tried at a time.
BATCH = 4096
#: How much less a cell is worth than its volume the more the proof lacks: a power.
HOPELESS = 0.4
#: Share of the volume that is covered by default, and the largest number of cells.
SHARE, MOST = 0.99, 1_000_000
#: Gap up to which two boxes share a face [rad, m].
TOUCHING = 1e-12
#: Connected parts that are described.
MOST_PARTS = 10
#: Arrays of cells that a search has at a time: those of before and of after it is enlarged.
CELL_NUMBERS = 4
#: Largest size of the cells that a file may hold unpacked [bytes]: some ten million.
LARGEST = 2 * 10**9


class Cells(NamedTuple):
    """A tree of cells, each halved or not; the first is the whole range.

    Attributes:
        low: (m, n) lower corners.
        high: (m, n) upper corners.
        child: (m,) number of the first of the two halves; -1 where it is not halved.
        free: (m,) whether it is proven free.
    """

    low: Array
    high: Array
    child: Integers
    free: Booleans


class FreeBoxes(Result):
    """Boxes that cover regular configurations, joined where they share a part of a face.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        cells: The cells that the range is divided into; those that are `free` are the boxes.
        endless: Numbers of the joints that turn without end, whose range is one whole turn.
    """

    arm: SpaceArm
    mode: BaseMode
    cells: Cells
    endless: tuple[int, ...]

    @cached_property
    def boxes(self) -> Integers:
        """Numbers of the cells that are boxes."""
        return np.flatnonzero(self.cells.free).astype(np.int64)

    @cached_property
    def lower(self) -> Array:
        """(b, n) lower corners of the boxes [rad] or [m]."""
        return self.cells.low[self.boxes]

    @cached_property
    def upper(self) -> Array:
        """(b, n) upper corners of the boxes."""
        return self.cells.high[self.boxes]

    @cached_property
    def volumes(self) -> Array:
        """(b,) shares of the volume of the range, of joints that cannot move left out."""
        width, size = self.upper - self.lower, self.cells.high[0] - self.cells.low[0]
        shares = np.divide(width, size, out=np.ones_like(width), where=size > 0.0)
        return np.asarray(shares.prod(axis=1))

    @property
    def share(self) -> float:
        """Share of the volume of the range that is covered."""
        return float(self.volumes.sum())

    @cached_property
    def _graph(self) -> scipy.sparse.csr_matrix:
        """The distances between the centres of boxes that share a part of a face."""
        one, other = _neighbours(self.cells, self.endless).T
        middle = 0.5 * (self.lower + self.upper)
        way = (middle[other] + self._turns(one, other) - middle[one]) / joint_scales(self.arm)
        size = np.linalg.norm(way, axis=1)
        graph = scipy.sparse.coo_matrix((size, (one, other)), (len(middle), len(middle))).tocsr()
        return graph.maximum(graph.T)

    @cached_property
    def parts(self) -> Integers:
        """(b,) number of the connected part of each box, the largest part first.

        Two boxes of one part are joined by a way that is free. Boxes of two parts may be joined
        by one that is not covered.
        """
        number, labels = scipy.sparse.csgraph.connected_components(self._graph, directed=False)
        sizes = np.bincount(labels, weights=self.volumes, minlength=number)
        rank = np.empty(number, dtype=np.int64)
        rank[np.argsort(-sizes, kind="stable")] = np.arange(number)
        return rank[labels]

    @cached_property
    def part_shares(self) -> npt.NDArray[Any]:
        """Share of the volume of the range that each connected part covers."""
        return np.bincount(self.parts, weights=self.volumes)

    def path(self, q0: ArrayLike, q1: ArrayLike) -> Array:
        """Find a path between two configurations that stays in the boxes, so that it is free.

        Args:
            q0: (n,) where it begins.
            q1: (n,) where it ends; joints that turn without end may end whole turns away.

        Returns:
            (m, n) joint positions, joined by straight segments; each lies in one box.

        Raises:
            NoSolutionError: An end is in no box, or the ends are in different parts. That does not
                prove that there is no path.
        """
        ends = [joint_vector(self.arm, q, name) for q, name in ((q0, "q0"), (q1, "q1"))]
        for at in ends:
            self._box_of(at)
        for _, way in self.ways(ends[0], ends[1][None]):
            return way
        raise NoSolutionError(
            f"{self.arm.name}: the boxes of q0 and q1 are in two connected parts; cover more, "
            "or there may be no way"
        )

    def ways(self, q0: Array, Q: Array) -> Iterator[tuple[int, Array]]:
        """Yield paths as of `path` from a configuration (n,) to others (m, n), the shortest first.

        Those that are in no box, or in another part than q0, are left out.

        Yields:
            The number of the other configuration, and the path.

        Raises:
            NoSolutionError: q0 is in no box.
        """
        first, start = self._box_of(q0)
        held = ((i, self._held(q)) for i, q in enumerate(Q))
        ends = [(i, *found) for i, found in held if found is not None]
        far, before = scipy.sparse.csgraph.dijkstra(
            self._graph, directed=False, indices=np.array(first), return_predecessors=True
        )
        for i, last, end in sorted(ends, key=lambda one: float(far[one[1]])):
            if np.isinf(far[last]):
                return
            chain = [last]
            while chain[-1] != first:
                chain.append(int(before[chain[-1]]))
            yield i, self._through(chain[::-1], q0, start, end)

    def nearest(self, q: Array, most: int) -> Array:
        """Return the points (m, n) nearest to q (n,), one per box, of at most so many boxes.

        Distances count in units of `joint_scales`.
        """
        q = joint_vector(self.arm, q, "q")
        at, most = self._in_range(q), whole(most, "most", 1)
        gap = np.maximum(np.maximum(self.lower - at, at - self.upper), 0.0)
        far = np.linalg.norm(gap / joint_scales(self.arm), axis=1)
        some = np.argsort(far, kind="stable")[:most]
        return np.clip(at, self.lower[some], self.upper[some]) + (q - at)

    def _through(self, chain: list[int], q0: Array, start: Array, end: Array) -> Array:
        """Return the way through boxes that are joined, from q0, which is at `start` in its box."""
        rows, offset, here = [q0], q0 - start, start
        links = np.array([*pairwise(chain)], dtype=np.int64).reshape(-1, 2)
        for (one, other), turns in zip(links, self._turns(*links.T), strict=True):
            low = np.maximum(self.lower[one], self.lower[other] + turns)
            high = np.minimum(self.upper[one], self.upper[other] + turns)
            here = np.clip(here, low, np.maximum(low, high))
            middle = 0.5 * (low + high)
            here = here + 0.5 * (middle - here)  # not along an edge of the box
            rows.append(here + offset)
            here, offset = here - turns, offset + turns
        return np.array([*rows, end + offset])

    def _turns(self, one: Integers, other: Integers) -> Array:
        """Return by what turns (e, n) the others of boxes that are joined are away."""
        turns = np.zeros((len(one), self.arm.n))
        for j in self.endless:
            ways = np.array([[0.0], [TURN], [-TURN]])
            low = np.maximum(self.lower[one, j], self.lower[other, j] + ways)
            high = np.minimum(self.upper[one, j], self.upper[other, j] + ways)
            turns[:, j] = ways[(high - low).argmax(axis=0), 0]
        return turns

    def _box_of(self, q: Array) -> tuple[int, Array]:
        """Return the number of the box that holds a configuration, and where it is in the range."""
        if (found := self._held(q)) is None:
            raise NoSolutionError(
                f"{self.arm.name}: {self.arm.in_words(q)} is in no box; it is near a singular "
                "posture or outside the range that is covered"
            )
        return found

    def _held(self, q: Array) -> tuple[int, Array] | None:
        """Return the same, None if no box holds it."""
        at = self._in_range(q)
        inside = ((self.lower <= at) & (at <= self.upper)).all(axis=1)
        return (int(np.argmax(inside)), at) if inside.any() else None

    def _in_range(self, q: Array) -> Array:
        """Return a configuration (n,) with its endless joints turned to where they are covered."""
        at = q.copy()
        for j in self.endless:
            at[j] = self.cells.low[0, j] + (q[j] - self.cells.low[0, j]) % TURN
        return at

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the cells to a NumPy archive; `load` reads it, `free_boxes` continues from it.

        Args:
            path: The file to write.

        Returns:
            The path.

        Raises:
            SpaceArmError: The file cannot be written.
        """
        buffer = BytesIO()
        names = {"arm": np.array(self.arm.name), "mode": np.array(self.mode)}
        names["bodies"] = np.array(digest_of_set(self.arm, self.mode))
        names["endless"] = np.array(self.endless, dtype=np.int64)
        arrays: dict[str, Any] = names | self.cells._asdict()
        np.savez_compressed(buffer, **arrays)
        return write(Path(path), buffer.getvalue())

    @classmethod
    def load(cls, path: str | os.PathLike[str], arm: SpaceArm, mode: BaseMode) -> FreeBoxes:
        """Read the boxes of an arm; the proof that they are free of singularities is not repeated.

        Args:
            path: A file that `save` has written.
            arm: The arm.
            mode: What the spacecraft does.

        Raises:
            StoreError: The file cannot be read, or is of another arm or mode.
        """
        try:
            file = arrays_in(Path(path), LARGEST)
            names = str(file["arm"]), str(file["mode"])
            bodies = str(file["bodies"])
            cells = Cells(*(file[name] for name in Cells._fields))
            endless = tuple(file["endless"].tolist())
        except KeyError as error:
            raise StoreError(f"{path} holds no boxes: it holds no {error}") from None
        except ValueError as error:
            raise StoreError(f"{path} holds no boxes: {error}") from None
        if names != (arm.name, mode) or cells.low.shape[1:] != (arm.n,):
            raise StoreError(
                f"{path} has the boxes of {names[0]}, {names[1]}; not those of {arm.name}, {mode}"
            )
        if bodies != digest_of_set(arm, mode):
            raise StoreError(
                f"{path} has the boxes of another {arm.name}: its masses, lengths, tips or "
                "task differ; cover this one anew"
            )
        return cls(arm, mode, cells, endless)

    def to_dict(self) -> dict[str, Any]:
        """Return what is covered as plain JSON data: numbers and shares, not the boxes."""
        return {
            "arm": self.arm.name,
            "mode": self.mode,
            "lower": self.cells.low[0].tolist(),
            "upper": self.cells.high[0].tolist(),
            "boxes": len(self.boxes),
            "covered_share": self.share,
            "not_checked": self.not_checked,
            "endless": [self.arm.joint_names[j] for j in self.endless],
            "part_shares": self.part_shares.tolist(),
        }

    not_checked = "collisions; whether parts are connected by what is not covered"

    def describe(self) -> Description:
        """Describe how much is covered, and by which connected parts."""
        shares = self.part_shares[:MOST_PARTS]
        numbers = np.bincount(self.parts, minlength=len(shares))[: len(shares)]
        columns: dict[str | Column, Sequence[Cell]] = {
            "connected part": list(range(1, len(shares) + 1)),
            "boxes": numbers.tolist(),
            Column("share of the range", "%", ".2f"): (100.0 * shares).tolist(),
        }
        return Description(
            title=f"{self.arm.name}, {self.mode}",
            verdict=f"{len(self.boxes):,} boxes cover {100.0 * self.share:.1f} % of the joint "
            f"range, in {len(self.part_shares):,} connected part"
            f"{'s' * (len(self.part_shares) != 1)}: no posture in them is singular, proven",
            tone="good",
            tables=[Table.by_columns(columns, f"The largest {len(shares)} parts")]
            * bool(len(shares)),
        )


@checked
def free_boxes(
    arm: SpaceArm,
    *,
    within: tuple[ArrayLike, ArrayLike] | None = None,
    share: float = SHARE,
    most: int = MOST,
    so_far: FreeBoxes | None = None,
    mode: BaseMode = "free-floating",
    progress: Progress | None = None,
) -> FreeBoxes:
    """Cover regular configurations by boxes in which no configuration is singular, proven.

    Args:
        arm: The arm.
        within: (n,) least and (n,) largest positions; the joint limits if None. For a revolute
            joint infinite ones mean that it turns without end.
        share: Share of the volume of the range to cover.
        most: Largest number of cells, halved ones too.
        so_far: Boxes to go on with, of an arm with the same singular set; their range counts.
        mode: What the spacecraft does; see `generalized_jacobian`.
        progress: Called now and then as progress(done, most); it may end before.

    Returns:
        The boxes, how much they cover, and ways through them.

    Raises:
        ConfigurationError: An argument makes no sense.
        UnsupportedError: J* has no minors that a proof could use, as with mimic joints.
        StoppedError: Ctrl-C; carries the boxes that there are, to go on with.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> boxes = sa.free_boxes(sa.load("planar2"), within=([-np.inf] * 2, [np.inf] * 2))
        >>> boxes.share >= 0.99, len(boxes.part_shares)
        (True, 2)
    """
    most = whole(most, "most", 1)
    share = positive(share, "share", "share of the range", most=1.0)
    minors = minors_for_proofs(arm, mode)
    if so_far is None:
        low, high = range_allowed(arm, np.empty((0, arm.n)), within)
        chart = minors[0].chart
        turns = ~arm.slides & (np.isinf(low) | np.isinf(high))
        endless = tuple(np.flatnonzero(turns).tolist())
        half = np.where(turns, np.pi, chart.half)
        given = np.isfinite(low) & np.isfinite(high) & ~turns
        low = np.where(given, low, chart.centre - half)
        high = np.where(given, high, chart.centre + half)
        cells = Cells(low[None], high[None], np.array([-1]), np.array([False]))
    elif digest_of_set(so_far.arm, so_far.mode) != digest_of_set(arm, mode):
        raise ConfigurationError("so_far has boxes of another arm or mode; give those of this one")
    else:
        cells, endless = so_far.cells, so_far.endless
    covered, stopped = _covered(minors, cells, joint_scales(arm), share, most, progress)
    found = FreeBoxes(arm, mode, covered, endless)
    if stopped:
        raise StoppedError(f"{100.0 * found.share:.1f} % of the joint range covered", found)
    return found


def _covered(
    minors: list[Jets],
    cells: Cells,
    unit: Array,
    share: float,
    most: int,
    progress: Progress | None,
) -> tuple[Cells, bool]:
    """Halve cells that are not proven free, the most promising first, until enough is.

    Returns:
        The cells, and whether Ctrl-C has stopped it.
    """
    origin = 0.5 * (cells.low[0] + cells.high[0])
    roots = Roots(minors, origin, unit, *((c[0] - origin) / unit for c in cells[:2]))
    size = cells.high[0] - cells.low[0]
    count = len(cells.low)
    low, high, child, free = _with_room(cells, max(most - count, 0))

    def volume(at: Integers) -> Array:
        width, counts = high[at] - low[at], roots.relevant & (size > 0.0)
        return np.divide(width, size, out=np.ones_like(width), where=counts).prod(axis=1)

    done = float(volume(np.flatnonzero(cells.free)).sum())
    new = np.flatnonzero((cells.child < 0) & ~cells.free)
    open_, along, worth = new[:0], new[:0], np.empty(0)
    stopped = False
    try:
        while new.size and done < share:
            for at in np.array_split(new, range(BATCH, len(new), BATCH)):
                centre = (0.5 * (low[at] + high[at]) - origin) / unit
                half = 0.5 * (high[at] - low[at]) / unit
                proven, taken = roots.free(centre, half * (1.0 + ROUNDING))
                free[at[proven]] = True
                done += float(volume(at[proven]).sum())
                lack = np.maximum(taken.sum(axis=1), 1.0) ** HOPELESS
                open_ = np.concatenate((open_, at[~proven]))
                along = np.concatenate((along, taken.argmax(axis=1)[~proven]))
                worth = np.concatenate((worth, (volume(at) / lack)[~proven]))
                if progress:
                    progress(min(count, most), most)
            some = min(BATCH, (len(open_) + 3) // 4, max(most - count, 0) // 2)
            order = np.argpartition(-worth, min(some, len(worth) - 1)) if some else open_[:0]
            split, axis = open_[order[:some]], along[order[:some]]
            later = order[some:]
            open_, along, worth = open_[later], along[later], worth[later]
            first = count + 2 * np.arange(some)
            child[split] = first
            for s in (0, 1):
                low[first + s], high[first + s] = low[split], high[split]
            middle = 0.5 * (low[split, axis] + high[split, axis])
            high[first, axis] = low[first + 1, axis] = middle
            count += 2 * some
            new = np.concatenate((first, first + 1))
    except KeyboardInterrupt:
        stopped = True
        child[child >= count] = -1  # halved, but not counted yet
    rows = np.s_[:count]
    kept = Cells(low[rows].copy(), high[rows].copy(), child[rows].copy(), free[rows].copy())
    return kept, stopped


def _with_room(cells: Cells, more: int) -> Cells:
    """Return cells with room for more, which are not halved and not free.

    Raises:
        SpaceArmError: They need more memory than is free.
    """
    n = cells.low.shape[1]
    need = CELL_NUMBERS * 8.0 * (len(cells.low) + more) * (n + 1)
    check_memory(need, f"a search of {len(cells.low) + more:,} boxes", "search fewer boxes")
    room = Cells(
        np.empty((more, n)), np.empty((more, n)), np.full(more, -1), np.zeros(more, dtype=bool)
    )
    return Cells(*(np.concatenate(pair) for pair in zip(cells, room, strict=True)))


def _neighbours(cells: Cells, endless: tuple[int, ...]) -> Integers:
    """Find the pairs (e, 2) of boxes that share a part of a face, by their numbers among boxes.

    Pairs of cells that touch are followed down the tree; across the ends of whole turns too.
    """
    child, holds = cells.child, _holding_boxes(cells)
    wide = np.flatnonzero((cells.low[1:] != cells.low[0]).any(axis=0))  # the others are not halved
    low, high = cells.low[:, wide], cells.high[:, wide]
    size = (high - low).sum(axis=1)
    turns = np.zeros((1 + len(endless), cells.low.shape[1]))
    turns[1 + np.arange(len(endless)), list(endless)] = TURN
    turned = np.arange(len(turns)) > 0
    turns = turns[:, wide]
    a, b = np.zeros((2, len(turns)), dtype=np.int64)
    turn, found = np.arange(len(turns)), [np.empty((0, 2), dtype=np.int64)]
    while len(a):
        across = turned[turn]
        leaf = cells.free[a] & cells.free[b] & ((a != b) | across)
        found.append(np.stack((a[leaf], b[leaf]), axis=1))
        inner_a, inner_b = child[a] >= 0, child[b] >= 0
        alike = (a == b) & ~across
        both = np.flatnonzero(alike & inner_a)
        halve_a = ~alike & inner_a & (~inner_b | (size[a] >= size[b]))
        i, k = np.flatnonzero(halve_a), np.flatnonzero(~alike & inner_b & ~halve_a)
        c, d, e = child[a[both]], child[a[i]], child[b[k]]
        new_a = np.concatenate((c, c + 1, c, d, d + 1, a[k], a[k]))
        new_b = np.concatenate((c, c + 1, c + 1, b[i], b[i], e, e + 1))
        new_turn = turn[np.concatenate((both, both, both, i, i, k, k))]
        kept = holds[new_a] & holds[new_b]
        new_a, new_b, new_turn = new_a[kept], new_b[kept], new_turn[kept]
        overlap = np.minimum(high[new_a], high[new_b] + turns[new_turn])
        overlap -= np.maximum(low[new_a], low[new_b] + turns[new_turn])
        touching = (overlap > -TOUCHING).all(axis=1) & ((overlap <= TOUCHING).sum(axis=1) <= 1)
        a, b, turn = new_a[touching], new_b[touching], new_turn[touching]
    number = np.cumsum(cells.free) - 1
    return number[np.concatenate(found)]


def _holding_boxes(cells: Cells) -> Booleans:
    """Tell which cells are boxes or hold some."""
    holds = cells.free.copy()
    inner = np.flatnonzero(cells.child >= 0)
    first, before = cells.child[inner], -1
    while before != (before := int(holds.sum())):
        holds[inner] = holds[first] | holds[first + 1]
    return holds
