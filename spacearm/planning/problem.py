"""Problem: what a joint motion must achieve, checked before the search, and the check of it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias, TypeVar

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, finite
from spacearm.collisions.separation import Collisions, Contact, collision_geometry
from spacearm.collisions.swept_motion import Curved, Floating, SweptMotion
from spacearm.errors import ImpossibleError, NoSolutionError, UnsupportedError
from spacearm.mechanics.batch import evaluate
from spacearm.mechanics.distance import distance_at
from spacearm.mechanics.floating import Walk, attitudes
from spacearm.mechanics.jacobian import singular_values, task_jacobian, turning_axes
from spacearm.model.arguments import FLOATING, HELD, BaseMode
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import sound_pose
from spacearm.model.joints import joint_vector
from spacearm.motion.following import follow
from spacearm.motion.goal import as_goal, goal_pose, out_of_reach
from spacearm.planning.account import SearchAccount, TimeUpError
from spacearm.planning.guesses import GuessFinder
from spacearm.planning.optimiser import ARRIVED, Target
from spacearm.planning.reactions import largest_turn
from spacearm.planning.request import Joints, PlanRequest
from spacearm.planning.result import IGNORED, Attempt, Plan, best_attempt
from spacearm.planning.timing import rest_to_rest_times
from spacearm.singularities.nearest import NearestSearch, angle, nearest_locally
from spacearm.singularities.polynomials import proving_minors
from spacearm.singularities.report import NO_INVERSE, TOLERANCE
from spacearm.singularities.sets import prove_regular, prove_way
from spacearm.singularities.sides import dividable, on_the_other_side, parted, separated

#: The configurations along a motion, which is straight in joint space between them.
Rows: TypeAlias = Sequence[Configuration]
#: The same, or a plan.
Way = TypeVar("Way", bound="Rows | Plan")

#: Time for a look at the sides on which a goal is reached [s], and searches for postures there.
SIDE_TIME, SIDE_SEARCHES = 1.0, 100
#: Number of sines of curves and loops.
WAVES = 3
#: What joints may be beyond their limits [rad] or [m].
ROUNDING = 1e-12
#: Postures looked at to prove that no bodies meet on the splines that are flown.
MOST_LOOKS = 50_000
#: Rows that are walked or proven regular between two looks at the clock.
TOGETHER = 100
#: The clearance where none is asked for, but no more than half of what the start has [rad].
LEAST = float(np.radians(0.1))
#: The clearance that is aimed at first, likewise.
AMPLE = float(np.radians(6.0))


class InContactError(NoSolutionError):
    """Bodies meet on a motion that keeps all other constraints."""


@dataclass
class Problem:
    """What a joint motion must achieve at zero momentum, and the check of it.

    Attributes:
        request: What was asked.
        target: What the motion must achieve.
        ample: Clearance that is aimed at first.
        collisions: The bodies that must not meet; None if collisions do not count.
        best: The last attempt that is not a solution.
        note: Remark of a method on its solution.
    """

    request: PlanRequest
    target: Target
    ample: float
    collisions: Collisions | None
    best: Rows | None = None
    note: str = ""

    @classmethod
    def of(cls, request: PlanRequest) -> Problem:
        """Return the problem of leading tips, or the joints, to a goal.

        Raises:
            NoSolutionError: No motion can solve it; carries the best attempt.
        """
        cfg, goal, attitude = request.start, request.goal, request.final_attitude
        limits = request.constraints.limits
        tip, q, aims = None, None, request.aims
        try:
            for name, aim in aims.items():
                if far := out_of_reach(*aim):
                    raise ImpossibleError(f"impossible, proven: {name}: {far}")
            lower, upper = bounds_of(cfg, limits)
            least, ample = clearance_of(cfg, request.constraints.clearance)
            if isinstance(goal, Joints):
                q = joint_vector(cfg.arm, goal.q, "goal")
            elif not aims:
                tip = _reachable(cfg, goal_pose(cfg, goal, "goal"), limits, request.account)
            target = Target(
                tip=tip,
                q=q,
                attitude=None if attitude is None else _attitude(cfg, attitude),
                clearance=least,
                lower=lower,
                upper=upper,
                tips=tuple(pose for _, pose in aims.values()),
                twist=request.final_twist,
            )
            if q is not None:
                _check_joints(cfg, q, target)
            return cls(request, target, ample, bodies_apart(request, target))
        except NoSolutionError as error:
            raise type(error)(str(error), best_attempt(cfg, error.best)) from None

    def require_side(self) -> None:
        """Raise an ImpossibleError if the goal is proven to be on the other side of the set."""
        if self._apart:
            alone = best_attempt(self.start, None)
            raise ImpossibleError(f"impossible, proven: {self._apart}", alone)

    @cached_property
    def _apart(self) -> str:
        """Why the goal is on the other side of the singular set; empty if that is not proven."""
        tip, target, arm = self.target.tip, self.target, self.start.arm
        if target.q is not None and not self.request.held:
            return separated(self.start, arm.at(target.q), self.request.constraints.limits)
        if tip is None or self.request.held or not dividable(arm):
            return ""
        account = SearchAccount(SIDE_TIME)
        finder = GuessFinder(self.start, target, WAVES, np.random.default_rng(0), account)
        with suppress(TimeUpError):
            finder.ends(np.pi, SIDE_SEARCHES)
        found = account.postures
        if found["reached"] != found["side"] + found["limits"]:
            return ""
        return on_the_other_side(self.start, tip, finder.axes, target.lower, target.upper)

    @property
    def start(self) -> Configuration:
        """Configuration in which the motion begins."""
        return self.request.start

    @property
    def account(self) -> SearchAccount:
        """The time of the search, and what stops it."""
        return self.request.account

    @property
    def keep(self) -> float | None:
        """Largest turn of the spacecraft on the way [rad]; None for any."""
        return self.request.constraints.keep_attitude

    @cached_property
    def rates(self) -> Array:
        """(n,) largest joint rates [rad/s] or [m/s]."""
        return self.request.constraints.joint_rates(self.start.arm)

    @property
    def rng(self) -> np.random.Generator:
        """The random numbers of this round."""
        return np.random.default_rng((self.request.search.seed, self.account.rounds))

    def check(self, rows: Way) -> Way:
        """Return rows that arrive if they keep clearance, joint limits and distance between bodies.

        Raises:
            NoSolutionError: They do not.
        """
        arm, q = self.start.arm, joints_of(rows)
        proven, mode = self._proven
        distance = self._distances(q)
        worst = int(np.argmin(distance))
        if distance[worst] < self.target.clearance:
            found = nearest_locally(proven, mode, q[worst])
            near = distance[worst] if found is None else found[1]
            if distance[worst] < 0.0 or near < self.target.clearance:
                raise self._failure(
                    "singular",
                    f"a singular posture is found {angle(max(near, 0.0))} from "
                    f"q = {arm.in_words(q[worst])}, and the clearance is "
                    f"{angle(self.target.clearance)}",
                )
        if over := beyond_limits(arm, q, self.target.lower, self.target.upper):
            raise self._failure("limits", over)
        self._check_turn(rows)
        for i in range(0, max(len(q) - 1, 1), TOGETHER):
            self.account.check_time()
            proof = prove_regular(proven, q[i : i + TOGETHER + 1], mode=mode)
            if proof is None:
                break
            if proof.at is not None:
                met = "is met" if proof.verdict == "singular" else "is near"
                where = arm.in_words(proof.at)
                raise self._failure("singular", f"a singularity {met} at q = {where}")
        if (contact := self.contact(rows[0], q, rows=rows)) is not None:
            raise InContactError(str(contact))
        return rows

    @property
    def _proven(self) -> tuple[SpaceArm, BaseMode]:
        """The arm of which singular postures count, and what its spacecraft does."""
        held = self.request.held
        return (held, HELD) if held else (self.start.arm, FLOATING)

    def _failure(self, cause: str, why: str, rows: object = None) -> NoSolutionError:
        """Count what stops a motion, by the words of `account.WAYS`; return the error for it."""
        self.account.ways[cause] += 1
        return NoSolutionError(why, rows)

    def _distances(self, q: Array) -> Array:
        """Return the distances to the singular set (m,), negative on the other side [rad]."""
        arm = self.start.arm
        if len(arm.tips) == 1:
            return evaluate(arm, q, ("distance",))["distance"]
        rows = [arm.at(row) for row in q]
        J = np.array([task_jacobian(cfg) for cfg in rows])
        sign = np.sign(np.linalg.det(J)) if arm.n == arm.task.k else np.ones(len(q))
        return sign[0] * sign * np.array([distance_at(cfg, FLOATING) for cfg in rows])

    def check_bent(self, found: Plan) -> None:
        """Check what `arrived` does not prove of a plan whose rows have passed `check`, but bent.

        Raises:
            NoSolutionError: It does not keep all constraints.
        """
        with suppress(UnsupportedError):
            if proving_minors(*self._proven):
                self._check_turn(found)
                return
        self.check(found)

    def _check_turn(self, rows: Rows | Plan) -> None:
        """Raise a NoSolutionError if the spacecraft turns too far."""
        if self.keep is None:
            return
        turn = largest_turn([*rows])
        self.note = f"the spacecraft turns by at most {turn:.2g} rad, between the rows too"
        if turn > self.keep:
            raise self._failure(
                "turn",
                f"the spacecraft turns by up to {angle(turn)}, and keep_attitude allows "
                f"{angle(self.keep)}",
                rows,
            )

    def contact(
        self,
        start: Configuration,
        path: Array,
        before: float = 0.0,
        rows: Rows | Plan | None = None,
    ) -> Contact | None:
        """Return a contact on straight joint segments; None if none is there or counts.

        Args:
            start: Where the motion begins.
            path: (m, n) the segments, the first row start.q.
            before: When it begins [s].
            rows: The configurations, where they are known; they matter to obstacles only.
        """
        self.account.check_time()
        if self.collisions is None:
            return None
        way: Array | SweptMotion = path
        if self.collisions.obstacles:
            times = before + rest_to_rest_times(path, self.rates)
            way = Floating([*(rows or self.walk(start, path))], times)
        contact = self.collisions.contact(way, self.account.check_time)
        if contact is not None:
            self.account.ways["contact"] += 1
            self.account.contacts[" meets ".join(map(repr, contact.links))] += 1
        return contact

    def stopped(self, q: Array) -> str:
        """Return why a motion cannot go through joint positions (n,), in words, or nothing.

        Joint limits and contacts of the arm's own bodies count.
        """
        self.account.check_time()
        over = np.maximum(q - self.target.upper, self.target.lower - q)
        if over.max() > 0.0:
            self.account.ways["limits"] += 1
            return f"joint {self.start.arm.joint_names[int(over.argmax())]!r} reaches its limit"
        if self.collisions is not None and self.collisions.touch(q):
            self.account.ways["contact"] += 1
            return "bodies meet"
        return ""

    def walk(self, start: Configuration, path: Array) -> Walk:
        """Return the configurations along straight joint segments (m, n), as `floating.walk`."""
        T = start.base.rotation[None]
        for i in range(1, len(path), TOGETHER):
            self.account.check_time()
            turns = T[0].T @ attitudes(start, path[i - 1 : i + TOGETHER])[1:]
            T = np.concatenate((T, T[-1] @ turns))
        return Walk(start, path, T)

    def guesses(self, start: Configuration, target: Target) -> GuessFinder:
        """Return the finder of first guesses for motions from a configuration."""
        seed = self.request.search.seed
        rng = self.rng if self.account.rounds else np.random.default_rng(seed)
        return GuessFinder(start, target, WAVES, rng, self.account, self.collisions)

    def plan(self, method: str, rows: Rows, request: PlanRequest, **timing: Array) -> Plan:
        """Return the plan that passes rows, seen from the system CM, which are not checked.

        Args:
            method: The method that found the rows.
            rows: The rows.
            request: What is asked: this problem's, or with the momentum that it leaves out.
            **timing: Times, what the wheels hold, and the joint rates at the end, as `Plan` has
                them; from rest to rest if there are none.
        """
        return Plan.of_rows(
            method,
            rows,
            self.rates,
            momentum=request.start.momentum,
            clearance=self.target.clearance,
            obstacles=request.obstacles,
            **timing,
        )

    def arrived(self, found: Plan, failed: Iterable[Attempt]) -> Plan:
        """Return a plan that has passed `check`, with what that covers and what failed before.

        Raises:
            NoSolutionError: What is flown is not proven to keep all constraints.
        """
        last = Attempt(found.method, True, "; ".join(filter(None, (found.travel, self.note))))
        if broken := broken_as_flown(found, self.request):
            raise self._failure(*broken, [*found])
        return covered(replace(found, tried=(*failed, last)), self.request.constraints.collisions)


def joints_of(rows: Rows | Plan) -> Array:
    """Return the joint positions (m, n) of rows."""
    return rows.q if isinstance(rows, Walk | Plan) else np.array([cfg.q for cfg in rows])


def travel(rows: Rows) -> float:
    """Return the sum of the motions of all joints [rad] or [m]."""
    return float(np.abs(np.diff(joints_of(rows), axis=0)).sum())


def beyond_limits(arm: SpaceArm, q: Array, lower: Array, upper: Array) -> str:
    """Say which joint goes farthest beyond limits (n,) at positions (..., n), if one does."""
    over = np.maximum(q - upper, lower - q).reshape(-1, arm.n).max(axis=0)
    name = arm.joint_names[int(over.argmax())]
    return f"joint {name!r} goes {over.max():.2g} beyond its limit" if over.max() > 0.0 else ""


def broken_as_flown(found: Plan, request: PlanRequest) -> tuple[str, str] | None:
    """Return what a plan breaks as flown, along the splines through its rows; None for nothing.

    Clearance is proven where J* has minors, as are joint limits and that no bodies meet.

    Returns:
        The word of `account.WAYS`, and why.

    Raises:
        NoSolutionError: The proof that no bodies meet takes too long.
    """
    arm, points, keep = found.arm, found.control_points, request.constraints
    proven, mode = (request.held, HELD) if request.held else (arm, FLOATING)
    proof = prove_way(proven, mode, points, found.clearance)
    if not (proof is None or proof or proof.at is None):
        much = angle(proof.clearance, down=True) if proof.clearance else "nothing"
        where = proven.in_words(proof.at)
        asked = angle(found.clearance)
        return "singular", f"of the clearance of {asked}, {much} is proven, up to q = {where}"
    limits = arm.lower - ROUNDING, arm.upper + ROUNDING
    if keep.limits and (over := beyond_limits(arm, points, *limits)):
        return "limits", f"between rows {over}"
    looks = itertools.count()

    def look() -> None:
        request.account.check_time()
        if next(looks) > MOST_LOOKS:
            raise NoSolutionError("bodies come too near to each other to be proven apart")

    if keep.collisions and (contact := contact_as_flown(found, look)):
        return "contact", f"as flown {contact}"
    return None


def contact_as_flown(found: Plan, check_time: Callable[[], None] = lambda: None) -> Contact | None:
    """Return a contact of a plan as flown, obstacles included; None if there is proven to be none.

    Errors of `check_time` are raised.
    """
    if not found.obstacles:
        way = Curved(found.arm, found.control_points) if len(found) > 1 else found.q
        return collision_geometry(found.arm).contact(way, check_time)
    return Collisions(found.arm, found.obstacles).contact(found.swept, check_time)


def covered(found: Plan, collisions: bool = True) -> Plan:
    """Return a plan that has passed the check of contacts, with what that covers."""
    if not collisions:
        return replace(found, checked=IGNORED, apart=None)
    bodies = Collisions(found.arm, found.obstacles)
    return replace(found, checked=bodies.account, apart=True if bodies.bodies else None)


def bodies_apart(request: PlanRequest, target: Target) -> Collisions | None:
    """Return the bodies that must not meet; None if collisions do not count.

    Raises:
        NoSolutionError: Some meet at the start or at the goal.
    """
    if not request.constraints.collisions:
        return None
    cfg, obstacles = request.start, request.obstacles
    bodies = Collisions(cfg.arm, obstacles) if obstacles else collision_geometry(cfg.arm)
    if obstacles and not bodies.bodies:
        raise UnsupportedError(
            f"{cfg.arm.name} has no shapes that could be held off obstacles; give its links "
            "collision geometry or visuals"
        )
    ends: dict[str, Array | SweptMotion] = {"start": Floating([cfg], np.zeros(1))}
    if target.q is not None:
        ends["goal"] = target.q[None]
    for what, way in ends.items():
        if (contact := bodies.contact(way)) is not None:
            remedy = "collisions=False ignores it"
            if any(contact.links[1].startswith(obstacle.name) for obstacle in obstacles):
                remedy = "move the obstacle, lower its margin, or name the link in its may_touch"
            raise NoSolutionError(f"the {what} is in collision: {contact}; {remedy}")
    return bodies


def bounds_of(cfg: Configuration, limits: bool) -> tuple[Array, Array]:
    """Return the least and the largest joint positions (n,).

    Raises:
        NoSolutionError: The start is beyond the limits.
    """
    arm, free = cfg.arm, np.full(cfg.arm.n, np.inf)
    if not limits:
        return -free, free
    _check_within(arm, "start", cfg.q, arm.lower, arm.upper)
    return arm.lower, arm.upper


def _check_within(arm: SpaceArm, what: str, q: Array, lower: Array, upper: Array) -> None:
    """Raise a NoSolutionError if joint positions (n,) are beyond their limits."""
    beyond = (q < lower) | (q > upper)
    if beyond.any():
        j = int(np.flatnonzero(beyond)[0])
        raise NoSolutionError(
            f"{what} of joint {arm.joint_names[j]!r} is {q[j]:.6g}, beyond its limits "
            f"{lower[j]:.6g} and {upper[j]:.6g}; limits=False ignores them"
        )


def _reachable(cfg: Configuration, goal: pin.SE3, limits: bool, account: SearchAccount) -> pin.SE3:
    """Return the goal if the stretched virtual manipulator is long enough for it.

    Raises:
        ImpossibleError: It is not; carries the motion towards the goal as far as J* leads, or the
            start alone where the time does not suffice for it.
    """
    far = out_of_reach(cfg, goal)
    if not far:
        return goal
    best = [cfg]
    with suppress(TimeUpError):
        account.check_time()
        best = list(follow(cfg, [as_goal(cfg, goal)], limits=limits, progress=account.tick))
    raise ImpossibleError(f"impossible, proven: {far}", best)


def _check_joints(cfg: Configuration, q: Array, target: Target) -> None:
    """Raise a NoSolutionError if no motion can lead to joint positions q (n,).

    An ImpossibleError where that is proven.
    """
    _check_within(cfg.arm, "goal", q, target.lower, target.upper)
    if apart := parted(cfg, cfg.arm.at(q)):
        raise ImpossibleError(f"impossible, proven: {apart}")
    _check_clear(cfg.arm.at(q), "goal", target.clearance)


def _attitude(cfg: Configuration, attitude: ArrayLike | pin.SE3) -> Array:
    """Return the attitude (3, 3) asked for.

    Raises:
        NoSolutionError: A planar arm cannot turn its spacecraft there.
    """
    rotation = _rotation(cfg.arm, attitude)
    axes = turning_axes(cfg.arm)
    turn = pin.log3(cfg.base.rotation.T @ rotation)
    if len(axes) == 1 and np.linalg.norm(np.delete(turn, axes[0])) > ARRIVED:
        raise ImpossibleError(
            f"impossible, proven: final_attitude is not a turn about {'xyz'[axes[0]]} of the "
            f"spacecraft from its start, and {cfg.arm.name} turns it about nothing else"
        )
    return rotation


def _rotation(arm: SpaceArm, attitude: ArrayLike | pin.SE3) -> Array:
    """Return the rotation (3, 3) that final_attitude stands for."""
    normal = arm.tree.plane_normal()
    given = attitude.rotation if isinstance(attitude, pin.SE3) else attitude
    meaning = "(a rotation matrix), a pin.SE3"
    if normal is not None:
        if not np.iterable(given):
            angle = finite(given, (), "final_attitude", "[rad], a (3, 3) rotation or a pin.SE3")
            return pin.exp3(float(angle) * np.eye(3)[normal])
        meaning += ", or an angle [rad]"
    R = finite(given, (3, 3), "final_attitude", meaning)
    return sound_pose(pin.SE3(R, np.zeros(3)), "final_attitude").rotation


def clearance_of(cfg: Configuration, clearance: float | None) -> tuple[float, float]:
    """Return the least distance to the singular set on the way [rad], and the one to aim at first.

    Raises:
        NoSolutionError: The start has less.
    """
    sigma = singular_values(cfg)
    near = nearest_locally(cfg.arm, FLOATING, cfg.q)
    distance = distance_at(cfg, FLOATING) if near is None else near[1]
    if sigma[-1] <= NO_INVERSE * sigma[0]:
        values = f"sigma_min {sigma[-1]:.1e} of {sigma[0]:.1e}"
        if distance > TOLERANCE:
            raise NoSolutionError(
                f"J* has no inverse at the start ({values}) nor around it: {cfg.arm.name} has no "
                "joint that moves the tip in some direction; take a task with fewer rows"
            )
        raise NoSolutionError(
            f"the start is singular ({values}); leave it first along sa.singularity(cfg).gradient"
        )
    ample = min(AMPLE, 0.5 * distance)
    if clearance is None:
        return min(LEAST, 0.5 * distance), ample
    _check_clear(cfg, "start", float(clearance))
    return float(clearance), ample


def _check_clear(cfg: Configuration, what: str, clearance: float) -> None:
    """Raise a NoSolutionError if a singular posture is found nearer than a clearance [rad]."""
    near = NearestSearch(cfg.arm, FLOATING, cfg.q[None]).nearest() if clearance else None
    if near is not None and (distance := float(np.linalg.norm(near))) < clearance:
        raise NoSolutionError(
            f"a singular posture is found {angle(distance)} from the {what}, and the clearance is "
            f"{angle(clearance)}"
        )
