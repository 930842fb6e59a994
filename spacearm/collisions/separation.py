"""Separation: the bodies of an arm and of obstacles, and the proof that none meet on a motion.

Distances are those of coal through Pinocchio. A motion is proven free by conservative advancement.
On a piece of it two bodies come nearer to each other by no more than the joints and the spacecraft
move them. coal has that for two bodies on given paths, not for the bodies of a chain.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Integers, counted
from spacearm.collisions.bodies import Geometry, but_for, own_pairs, without_shapes
from spacearm.collisions.obstacles import Obstacle, ObstacleLike, obstacles_of
from spacearm.collisions.swept_motion import (
    Floating,
    InJointSpace,
    Recorded,
    SweptMotion,
    interpolated,
)
from spacearm.errors import UnsupportedError, listed
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion
from spacearm.results import Cell, Description, Measure, Result, Table
from spacearm.signatures import checked


class Contact(NamedTuple):
    """Two bodies that touch, or come nearer than the margin of an obstacle.

    Attributes:
        q: (n,) joint positions there.
        links: Their names.
        t: When, from the beginning of the motion [s]; NaN where no times are known.
        distance: How far they are apart [m], negative where they overlap.
        margin: How far they must be apart [m].
    """

    q: Array
    links: tuple[str, str]
    t: float
    distance: float
    margin: float

    def __str__(self) -> str:
        values = ", ".join(f"{x:.4g}" for x in self.q)
        a, b = map(repr, self.links)
        what = f"{a} meets {b}"
        if self.margin and self.distance > 0.0:
            what = f"{a} comes as near as {self.distance:.3g} m to {b}, within its margin"
            what += f" of {self.margin:g} m,"
        when = "" if np.isnan(self.t) else f" after {self.t:.4g} s"
        return f"{what} at q = ({values}){when}"


class Collisions:
    """The bodies of an arm and obstacles, and the pairs of them that must not meet.

    Links that a joint of the description connects may touch, locked and fixed ones included, and
    bodies that touch in every posture.

    Attributes:
        bodies: All bodies of the arm.
        obstacles: The obstacles.
        account: What is checked and what is not, in one sentence.
        without: The links without usable shapes, which are not checked.

    Args:
        arm: The arm.
        obstacles: The obstacles; bodies of the arm meet them, obstacles may meet each other.
        touching: Pairs of links of the arm that may touch, such as a hand and what it holds.

    Raises:
        ModelError: Collision geometry of a link is faulty.
    """

    def __init__(
        self,
        arm: SpaceArm,
        obstacles: Sequence[Obstacle] = (),
        touching: Collection[frozenset[str]] = (),
    ) -> None:
        self.arm, self.obstacles = arm, tuple(obstacles)
        own = own_pairs(arm)
        self.bodies = own.bodies
        apart = [
            (i, j)
            for i, j in own.pairs
            if frozenset((own.bodies[i].link, own.bodies[j].link)) not in touching
        ]
        self._parts = [(o, part) for o in obstacles for part in o.parts]
        first, against = len(self.bodies), []
        self._moving = {first + j for j, (o, _) in enumerate(self._parts) if o.moves}
        for j, (obstacle, _) in enumerate(self._parts):
            free = set(obstacle.may_touch)
            against += [(i, first + j) for i, b in enumerate(self.bodies) if b.link not in free]
        self._own = len(apart)
        self._pairs = [*apart, *against]
        solids = [(body.joint, body.pose, body.shape) for body in self.bodies]
        solids += [(0, pin.SE3.Identity(), part.shape) for _, part in self._parts]
        self._geometry = Geometry(arm, solids, self._pairs)
        margins = [self._parts[b - first][0].margin for _, b in against]
        self._margins = np.append(np.zeros(self._own), margins)
        self._near = own.close + self._margins
        self.without = own.without
        self.account = _account(own.account, self.obstacles)

    def __bool__(self) -> bool:
        """Whether any bodies may meet."""
        return bool(self._pairs)

    def links(self, pair: int) -> tuple[str, str]:
        """Return the names of the bodies of a pair."""
        names = [body.link for body in self.bodies]
        names += [o.name + f" ({part.link})" * bool(part.link) for o, part in self._parts]
        a, b = self._pairs[pair]
        return names[a], names[b]

    def distances(self, q: Array) -> Array:
        """Return distances (own pairs,) of the arm's bodies, negative where they overlap [m]."""
        return self._distances(self.arm.all_joints(q), None, 0.0, np.arange(self._own))

    def gaps(self, q: Array, pairs: Integers | None = None) -> Array:
        """Return how far bodies of the arm are from contact (pairs,) [m], negative in contact.

        Args:
            q: (n,) joint positions.
            pairs: The numbers of the pairs; all of the arm's bodies if None.
        """
        pairs = np.arange(self._own) if pairs is None else pairs
        return self._distances(self.arm.all_joints(q), None, 0.0, pairs) - self._near[pairs]

    def gap_slope(self, q: Array, pair: int) -> Array:
        """Return the derivative (n,) of the gap of a pair of the arm's bodies [m/rad]."""
        slope = self._geometry.slope(self.arm.all_joints(q), pair)
        return slope if self.arm.coupling is None else slope @ self.arm.coupling

    def touch(self, q: Array) -> bool:
        """Tell whether bodies of the arm meet each other at joint positions (n,)."""
        return bool((self.gaps(q) < 0.0).any())

    def touching(self, q: Array) -> list[tuple[str, str]]:
        """Return the names of the bodies of the arm that meet each other at positions (n,)."""
        pairs = np.flatnonzero(self.distances(q) < self._near[: self._own])
        return list(dict.fromkeys(self.links(int(pair)) for pair in pairs))

    def clear(self, cfg: Configuration, com: Array) -> bool:
        """Tell whether the bodies of a configuration meet none of the bodies that rest.

        Args:
            cfg: The configuration.
            com: (3,) where its system CM stands [m].
        """
        resting = [
            i for i, p in enumerate(self._pairs) if i < self._own or p[1] not in self._moving
        ]
        base = pin.SE3ToXYZQUAT(cfg.centred(com).base)
        joints, pairs = self.arm.all_joints(cfg.q), np.array(resting, dtype=np.int64)
        return bool((self._distances(joints, base, 0.0, pairs) >= self._near[pairs]).all())

    def margins(self, motion: SweptMotion, u: float) -> Array:
        """Return distances less margins (pairs,) at a point of a motion [m]."""
        here = np.arange(len(self._pairs))
        full = motion.full(u)
        return self._distances(full[7:], full[:7], motion.time(u), here) - self._margins

    def _distances(self, joints: Array, base: Array | None, t: float, pairs: Integers) -> Array:
        """Return distances of some pairs (pairs,) [m].

        Args:
            joints: (nv - 6,) positions of the model's joints.
            base: (7,) pose of the spacecraft; any if None.
            t: Time [s]; NaN where no pair has an obstacle.
            pairs: Numbers of the pairs.
        """
        placed: dict[int, pin.SE3] = {}
        if base is not None and not np.isnan(t):  # without a time only bodies of the arm are met
            poses = (pose for obstacle in self.obstacles for pose in obstacle.poses(t))
            placed = dict(enumerate(poses, len(self.bodies)))
        return self._geometry.distances(joints, pairs, base, placed)

    def contact(
        self, way: Array | SweptMotion, check_time: Callable[[], None] = lambda: None
    ) -> Contact | None:
        """Find a contact on a motion; None if there is proven to be none.

        Args:
            way: The motion; or (m, n) joint positions on straight segments: then the bodies of the
                arm are checked against each other only.
            check_time: Called now and then; it may raise an error to end the search.
        """
        motion = way if isinstance(way, SweptMotion) else InJointSpace(self.arm, way)
        pairs = np.arange(len(self._pairs) if motion is way else self._own)
        if not len(pairs):
            return None
        way = self._travel(motion).T
        waiting = [(0.0, len(motion) - 1.0, way[0], way[-1], pairs)]
        while waiting:
            check_time()
            low, high, before, after, pairs = waiting.pop()
            u = 0.5 * (low + high)
            full = motion.full(u)
            distance = self._distances(full[7:], full[:7], motion.time(u), pairs)
            short = distance - self._near[pairs]
            if short.min() < 0.0:
                worst = int(short.argmin())
                pair = int(pairs[worst])
                return Contact(
                    motion.joints(u), self.links(pair), motion.time(u), float(distance[worst]),
                    float(self._margins[pair]),
                )  # fmt: skip
            here = interpolated(way, u)
            half = np.maximum(here - before, after - here)[pairs]
            half += self._approach(motion, pairs, low, high)
            left = pairs[short <= half]
            if len(left):
                waiting += [(u, high, here, after, left), (low, u, before, here, left)]
        return None

    def _approach(self, motion: SweptMotion, pairs: Integers, low: float, high: float) -> Array:
        """Return how far the obstacles of some pairs move from the middle at most (pairs,) [m]."""
        if not any(obstacle.moves for obstacle in self.obstacles):
            return np.zeros(len(pairs))
        t0, t, t1 = (motion.time(x) for x in (low, 0.5 * (low + high), high))
        part_of = {
            i: max(o.motion.moved(part, t0, t), o.motion.moved(part, t, t1))
            for i, (o, part) in enumerate(self._parts, len(self.bodies))
        }
        return np.array([part_of.get(self._pairs[i][1], 0.0) for i in pairs])

    def _travel(self, motion: SweptMotion) -> Array:
        """Return how far the bodies of all pairs move against each other up to each row at most.

        Those of the arm: (pairs, m) [m]. The obstacles' own motion is not in it.
        """
        way = self.gains(motion.hull) @ motion.steps.T
        if len(self._pairs) > self._own:
            body = motion.swept(self.bodies)
            way = np.vstack((way, [body[a] for a, _ in self._pairs[self._own :]]))
        return np.hstack((np.zeros((len(way), 1)), way.cumsum(axis=1)))

    def gains(self, path: Array) -> Array:
        """Return how far joints move two bodies of the arm against each other at most [m/rad].

        A joint does so if it carries only one of them. Sliding joints between it and the body make
        its lever longer, by no more than their largest displacement on the path.

        Args:
            path: (m, n) joint positions whose convex hull holds the motion.

        Returns:
            (own pairs, n) the bounds.
        """
        arm, (gains, longer) = self.arm, self._levers
        if longer:
            gains, out = gains.copy(), np.abs([arm.all_joints(q) for q in path]).max(axis=0)
            for pair, joint, slides in longer:
                gains[pair, joint] += out[slides].sum()
        return gains if arm.coupling is None else gains @ np.abs(arm.coupling)

    @cached_property
    def _levers(self) -> tuple[Array, list[tuple[int, int, list[int]]]]:
        """The same without the displacements, and which slides add to that of a pair and joint."""
        gains, longer = np.zeros((self._own, self.arm.model.nv - 6)), []
        for pair, (i, j) in enumerate(self._pairs[: self._own]):
            a, b = self.bodies[i], self.bodies[j]
            for body, other in ((a, b), (b, a)):
                for joint in body.reach.keys() - other.reach.keys():
                    gains[pair, joint - 2] = body.reach[joint]
                    if slides := body.slides[joint]:
                        longer.append((pair, joint - 2, slides))
        return gains, longer


def _account(own: str, obstacles: Sequence[Obstacle]) -> str:
    """Return what a check covers, in one sentence."""
    if not obstacles:
        return own
    names = listed([o.name + f" ({o.margin:g} m off)" * bool(o.margin) for o in obstacles])
    touch = [f"{link} may touch {o.name}" for o in obstacles for link in o.may_touch]
    allowed = f", {listed(touch)}" * bool(touch)
    return f"{own}; obstacles: {names}{allowed}"


@lru_cache(maxsize=16)
def collision_geometry(arm: SpaceArm) -> Collisions:
    """Return the collisions of an arm alone, made once; errors as for `Collisions`."""
    return Collisions(arm)


class CollisionReport(Result):
    """Whether the bodies of an arm meet each other or obstacles, from `sa.collision_check`.

    Attributes:
        apart: Whether none do, proven for the whole motion.
        contact: The first contact that was found, None if there is none.
        t: (m,) times of the samples [s].
        distance: (m,) least distance there, less the margins of obstacles [m]; negative where they
            are not kept.
        nearest: The two bodies that come nearest at a sample.
        checked: What the check covers and what it does not, in one sentence.
        unchecked: The links without usable shapes, which the verdict leaves out.
    """

    apart: bool
    contact: Contact | None
    t: Array
    distance: Array
    nearest: tuple[str, str]
    checked: str
    unchecked: tuple[str, ...]

    @property
    def not_checked(self) -> str:
        """The links that the verdict leaves out, in words; empty if there are none."""
        return without_shapes(self.unchecked)

    @property
    def story(self) -> str:
        """The verdict in one sentence."""
        if self.contact is not None:
            return str(self.contact)
        a, b = self.nearest
        bodies = "bodies with shapes" if self.unchecked else "bodies"
        near = f"{a!r} comes nearest, to {self.distance.min():.4g} m of {b!r}"
        return f"no {bodies} meet, proven; {near}{but_for(self.not_checked)}"

    def describe(self) -> Description:
        """Describe the verdict, the bodies that come nearest and what was checked."""
        nearest: dict[str, Cell] = {
            "nearest bodies": f"{self.nearest[0]}, {self.nearest[1]}",
            "least distance, less margins": Measure(float(self.distance.min()), "m"),
        }
        return Description(
            title="collisions",
            verdict=self.story,
            tone="good" if self.apart else "bad",
            notes=[self.checked],
            tables=[Table.facts(nearest)],
        )


@checked
def collision_check(
    thing: Configuration | Motion,
    obstacles: ObstacleLike | Sequence[ObstacleLike] = (),
    *,
    progress: Callable[[float, float], object] | None = None,
) -> CollisionReport:
    """Check whether the bodies of an arm meet each other or obstacles.

    Args:
        thing: A configuration; or a motion, which is checked between its samples as `Motion.at`
            has it, a `Plan` as it is flown: distances are not samples but bounds.
        obstacles: What must not be met besides; see `plan`.
        progress: Called after every sample as progress(done, samples).

    Returns:
        Whether they stay apart, where not, and the distances at the samples.

    Raises:
        ConfigurationError: An argument is of the wrong kind.
        ModelError: Collision geometry of a link is faulty.
        UnsupportedError: No two bodies have shapes that could meet.

    Example:
        >>> import numpy as np, pinocchio as pin, spacearm as sa
        >>> box = sa.Obstacle.box(0.2, pin.SE3(np.eye(3), np.array([1.2, 0.4, 0.0])))
        >>> sa.collision_check(sa.load("planar2").at([0.3, 0.2]), box).apart
        False
    """
    return contacts_of(thing, obstacles, progress=progress)


def contacts_of(
    thing: Configuration | Motion,
    obstacles: ObstacleLike | Sequence[ObstacleLike],
    touching: Collection[frozenset[str]] = (),
    *,
    progress: Callable[[float, float], object] | None = None,
) -> CollisionReport:
    """Check bodies as `collision_check`, with pairs of links that may touch."""
    motion, bodies = _moving(thing, obstacles, touching)
    margins = [bodies.margins(motion, float(i)) for i in counted(range(len(motion)), progress)]
    rows = np.array(margins)
    contact = bodies.contact(motion)
    return CollisionReport(
        apart=contact is None,
        contact=contact,
        t=np.array(motion.t, dtype=np.float64),
        distance=rows.min(axis=1),
        nearest=bodies.links(int(rows.min(axis=0).argmin())),
        checked=bodies.account,
        unchecked=bodies.without,
    )


def contact_on(
    thing: Configuration | Motion,
    obstacles: ObstacleLike | Sequence[ObstacleLike],
    check_time: Callable[[], None] = lambda: None,
) -> Contact | None:
    """Return a contact on a motion as `collision_check` does, without distances at its samples.

    Args:
        thing: The configuration, or the motion.
        obstacles: What else must not be met.
        check_time: As of `Collisions.contact`.
    """
    otherwise = ", or ask for no check: collisions=False"
    motion, bodies = _moving(thing, obstacles, otherwise=otherwise)
    return bodies.contact(motion, check_time)


def _moving(
    thing: Configuration | Motion,
    obstacles: ObstacleLike | Sequence[ObstacleLike],
    touching: Collection[frozenset[str]] = (),
    otherwise: str = "",
) -> tuple[SweptMotion, Collisions]:
    """Return a motion as it is flown, and the bodies that must not meet on it.

    Raises:
        UnsupportedError: There are none.
    """
    motion: SweptMotion
    if isinstance(thing, Configuration):
        start, begin = thing, 0.0
        motion = Floating([thing], np.zeros(1))
    else:
        recorded = Motion.of(thing)
        start, begin = recorded[0], float(recorded.t[0])
        flown = getattr(thing, "swept", None)
        motion = flown if isinstance(flown, SweptMotion) else Recorded(recorded)
    bodies = Collisions(motion.arm, obstacles_of(obstacles, start, begin), touching)
    if not bodies:
        few = "no two bodies with shapes" if bodies.bodies else "no shapes"
        raise UnsupportedError(
            f"{motion.arm.name} has {few} that could meet; give its links collision geometry or "
            f"visuals{otherwise}"
        )
    return motion, bodies
