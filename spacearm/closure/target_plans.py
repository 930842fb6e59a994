"""Plans of a held target: from pose to pose, past obstacles and singular postures of the chain.

A tree of postures is grown from the start. Each branch leads the target straight towards a random
pose, in steps of J* with closure pulled back, until something stops it; from its end the goal is
tried. The spacecraft turns by the way, so that a posture is known by its way only. Branches begin
where others end, and all of a way is led anew when a corner of it is left out. The way that is
returned is led as `Held.follow` leads, at rest at each corner.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.special import betaincinv

from spacearm.arrays import Array, generator
from spacearm.closure import target_paths
from spacearm.closure.target_paths import Carrying, FollowedTarget, Frame, TargetCurve
from spacearm.collisions.bodies import but_for, left_out
from spacearm.collisions.obstacles import obstacles_of
from spacearm.collisions.separation import Collisions, Contact, contacts_of
from spacearm.collisions.swept_motion import Floating
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration
from spacearm.motion import following
from spacearm.planning.account import SearchAccount, TimeUpError
from spacearm.planning.problem import LEAST
from spacearm.planning.request import Constraints, Search
from spacearm.planning.timing import PEAK, rate_bounds
from spacearm.results import Description, Measure, Table
from spacearm.singularities.nearest import angle

#: Length of a step along a branch [rad], [m].
STRIDE = 0.05
#: Most steps of a branch; how many lie between two looks at the distance along closure.
MOST_STEPS, EACH = 400, 4
#: Share of the way to the goal that a branch has at least.
SHORT = 0.05
#: How far random poses lie beside the straight way, as shares of its length.
DETOURS = (0.3, 0.6, 1.0, 2.0)
#: How far a corner is drawn to the line beside it, as shares of the way.
DRAWN = (0.5, 0.2)
#: Share of a piece up to which a row is at its end.
THERE = 1e-9
#: What stops branches, and what to relax.
STOPS = {
    "contact": ("met something", "move the obstacles, or plan without them: collisions=False"),
    "singular": ("came too near to a singular posture", "ask for a smaller clearance"),
    "limits": ("left the joint limits", "limits=False ignores them"),
    "turn": ("turned the spacecraft too far", "allow a larger keep_attitude"),
    "long": ("took too many steps", "take a nearer goal"),
}


class TargetPlan(FollowedTarget, kw_only=True):
    """The planned motion of arms whose held target comes to a pose, from `Held.plan`.

    The target goes straight from corner to corner and rests at each; joint rates are smooth.

    Attributes:
        clearance: How far singular postures along closure were to be at least [rad].
        checked: What the proof that nothing meets covers, in one sentence; empty if none was asked
            for.
    """

    clearance: float
    checked: str

    @property
    def not_checked(self) -> str:
        """What the answer does not cover."""
        left = left_out(self.checked)
        return f"{left}; " * bool(left) + target_paths.BETWEEN

    def describe(self) -> Description:
        """Describe the motion, and what was checked of it at the rows and between them."""
        motion = super().describe()
        facts = {"clearance asked for, checked at the rows": Measure(self.clearance, "rad")}
        notes = [*motion.notes, *filter(None, [self.checked])]
        verdict = motion.verdict + but_for(left_out(self.checked))
        tables = [*motion.tables, Table.facts(facts)]
        return replace(motion, verdict=verdict, notes=notes, tables=tables)


class Node(NamedTuple):
    """A posture of the tree.

    Attributes:
        cfg: The configuration.
        pose: Where the target is, in the frame of the goal.
        parent: Number of the node before; -1 of the start.
    """

    cfg: Configuration
    pose: pin.SE3
    parent: int


class TargetTree:
    """The search for a way of a held target.

    Attributes:
        stops: What stopped how many branches, by the words of `STOPS`.
        contacts: How many of them which contact stopped, in words.
        nearest: How near to the goal a branch came, as a share of the whole way.

    Args:
        carrying: The arms with the target.
        goal: Pose of the target's frame.
        frame: Where it is given.
        mode: What the spacecraft does.
        constraints: What must hold.
        search: How to look.

    Raises:
        SpaceArmError: As `Held.plan` raises.
    """

    def __init__(
        self,
        carrying: Carrying,
        goal: pin.SE3,
        frame: Frame,
        mode: BaseMode,
        constraints: Constraints,
        search: Search,
    ) -> None:
        arm, start = carrying.arm, carrying.start
        if start.momentum.any() or start.wheels.any():
            raise UnsupportedError(
                "the start has momentum on board, and the spacecraft turns with time, which plans "
                "of a held target do not reckon with; Held.follow(path, times=...) leads it along "
                "corners"
            )
        if constraints.wheels is not None or search.method != "auto":
            raise ConfigurationError(
                "a held target is planned without limits of wheels, by one method; leave out "
                "wheels= of Constraints and method= of Search"
            )
        target_paths.check_chain(carrying, mode, constraints.limits, False)
        self.carrying, self.goal, self.frame, self.mode = carrying, goal, frame, mode
        self.constraints = constraints
        self.account = SearchAccount(float(search.timeout), search.progress)
        self.rng, self.stops, self.contacts = generator(search.seed), Counter[str](), Counter[str]()
        bodies = Collisions(arm, obstacles_of(constraints.obstacles, start), carrying.touching)
        self.bodies = bodies if constraints.collisions and bodies else None
        self.length = arm.task.length or 1.0
        self.near = carrying.search(mode)
        self.near.look(*carrying.hands(start))
        here = self.near.least(*carrying.hands(start), np.inf)
        least = constraints.clearance
        self.clearance = min(LEAST, 0.5 * here) if least is None else float(least)
        if here < self.clearance:
            raise NoSolutionError(
                f"a singular posture is about {angle(here)} along closure from the start, and the "
                f"clearance is {angle(self.clearance)}; ask for less, or start elsewhere"
            )
        if word := self.stopped(start, 0):
            raise NoSolutionError(
                f"the start {STOPS[word][0]}{', '.join(('', *self.contacts))}; {STOPS[word][1]}"
            )
        self.nodes = [Node(start, carrying.aim(start, frame).tip, -1)]
        self.far = self.apart(self.nodes[0].pose, goal)
        self.nearest = 1.0

    def plan(self) -> TargetPlan:
        """Return the motion; errors as of `Held.plan`."""
        why, best = "", None
        try:
            for way in self.ways():
                found, why = self.flown(way)
                if not why:
                    return found
                best = found
        except TimeUpError as error:
            found_one = f"; what was found {why}" * bool(why)
            why = f"{error}, {self.account.limit}: {self.story}{found_one}"
        except KeyboardInterrupt:
            self.account.end()
            why = "stopped by Ctrl-C"
        whose = self.carrying.arm.name
        raise self.account.failure(f"{whose}: no way of the target to the goal; {why}", best)

    def flown(self, way: Sequence[pin.SE3]) -> tuple[TargetPlan, str]:
        """Lead the target along a way exactly; return the motion, and what it breaks."""
        carrying, mode, constraints = self.carrying, self.mode, self.constraints
        start = carrying.start
        seen = carrying.aim(start, self.frame)
        pieces = following.segments(seen, way, None)

        def curve(at: Configuration, piece: following.Segment) -> TargetCurve:
            return TargetCurve(carrying, at, piece, mode, constraints.limits, self.frame)

        led, told = following.told_along(
            start, seen, pieces, 1.0, False, curve, self.account.tick, what="target"
        )
        t, rate, bend = resting(led.s, led.dq, pieces, constraints.joint_rates(carrying.arm))
        told |= {"t": t, "dq": rate[:, None] * led.dq, "jumps": ()}
        told["ddq"] = rate[:, None] ** 2 * led.ddq + bend[:, None] * led.dq
        kept = np.append(np.diff(t) > 0.0, True)  # of rows at the end of a piece the last one
        rows = [cfg for cfg, keep in zip(led.rows, kept, strict=True) if keep]
        told = {name: x[kept] if isinstance(x, np.ndarray) else x for name, x in told.items()}
        plan = TargetPlan(
            mode=mode,
            clearance=self.clearance,
            checked="" if self.bodies is None else self.bodies.account,
            **told,
            **carrying.told(mode, rows, self.near),
        )
        if not plan.arrived:
            return plan, f"ends on the way: {plan.reason}"
        slower = float((rate_bounds(plan.spline) / constraints.joint_rates(carrying.arm)).max())
        if slower > 1.0:  # between the rows
            plan = replace(plan, t=slower * plan.t, dq=plan.dq / slower, ddq=plan.ddq / slower**2)
        near = [self.near.least(*carrying.hands(cfg), self.clearance) for cfg in rows]
        if min(float(plan.closure_distance.min()), *near) < self.clearance:
            return plan, "comes nearer to a singular posture than the clearance"
        most = constraints.keep_attitude
        if most is not None and max(_turn(start, cfg) for cfg in rows) > most:
            return plan, "turns the spacecraft too far"
        met: Contact | None = None
        if self.bodies is not None:
            met = contacts_of(plan, constraints.obstacles, carrying.touching).contact
        return plan, "" if met is None else str(met)

    def apart(self, a: pin.SE3, b: pin.SE3) -> float:
        """Return the length of the straight way between two poses [m]; turns count by the task."""
        turn = float(np.linalg.norm(pin.log3(a.rotation.T @ b.rotation)))
        return float(np.hypot(np.linalg.norm(b.translation - a.translation), self.length * turn))

    def stopped(self, cfg: Configuration, step: int) -> str:
        """Return what stops a branch at a configuration, a word of `STOPS`; empty if nothing."""
        arm, most = cfg.arm, self.constraints.keep_attitude
        if self.constraints.limits and ((cfg.q < arm.lower) | (cfg.q > arm.upper)).any():
            return "limits"
        if most is not None and _turn(self.carrying.start, cfg) > most:
            return "turn"
        if self.bodies is not None and not self.bodies.clear(cfg, cfg.com):
            met = self.bodies.contact(Floating([cfg], np.zeros(1)))
            self.contacts[" meets ".join(map(repr, met.links)) if met else ""] += 1
            return "contact"
        if step % EACH:
            return ""
        near = self.near.least(*self.carrying.hands(cfg), self.clearance)
        return "singular" if near < self.clearance else ""

    def branch(self, cfg: Configuration, to: pin.SE3) -> tuple[list[Configuration], str]:
        """Lead the target straight to a pose; return the rows, and what stopped it, if anything."""
        self.account.check_time()
        rows = [cfg]
        for piece in following.segments(self.carrying.aim(cfg, self.frame), [to], None):
            curve = TargetCurve(self.carrying, cfg, piece, self.mode, False, self.frame)
            y = following.state_of(cfg, 0.0)
            for step in range(1, MOST_STEPS + 1):
                rate = curve.rate(0.0, y)
                if rate[-1] <= 0.0:
                    return rows, "singular"
                rate = curve.rate(0.0, y + 0.5 * STRIDE * rate)
                last = y[-1] + STRIDE * rate[-1] >= piece.length
                y = y + rate * ((piece.length - y[-1]) / rate[-1] if last else STRIDE)
                there = curve.configuration(y)
                if word := self.stopped(there, 0 if last else step):
                    return rows, word
                rows.append(there)
                if last:
                    break
            else:
                return rows, "long"
        return rows, ""

    def ways(self) -> Iterator[list[pin.SE3]]:
        """Yield corners of ways to the goal, each shortened, then as it was found."""
        yield from self.landed(0)
        size = 0
        while True:
            to = self._anywhere(DETOURS[size % len(DETOURS)])
            size += 1
            near = int(np.argmin([self.apart(node.pose, to) for node in self.nodes]))
            new = self._grown(near, to)
            if new is not None:
                yield from self.landed(new)

    def _anywhere(self, share: float) -> pin.SE3:
        """Return a random pose beside the straight way."""
        start = self.nodes[0].pose
        turn = pin.log3(self.goal.rotation @ start.rotation.T)
        along = self.rng.uniform(-0.2, 1.2)
        beside = share * self.far / np.sqrt(6.0) * self.rng.normal(size=(2, 3))
        place = start.translation + along * (self.goal.translation - start.translation) + beside[0]
        return pin.SE3(pin.exp3(beside[1] / self.length + along * turn) @ start.rotation, place)

    def _grown(self, node: int, to: pin.SE3) -> int | None:
        """Return the number of the node to which a branch leads, None if it is too short."""
        begin = self.nodes[node]
        if self.apart(begin.pose, to) < SHORT * self.far:
            return None
        return self._kept(node, *self.branch(begin.cfg, to))

    def _kept(self, node: int, rows: list[Configuration], word: str) -> int | None:
        """Add the end of a branch from a node, a step back from what stopped it, if anything."""
        if word:
            self.stops[word] += 1
            rows = rows[:-1] or rows
        pose = self.carrying.aim(rows[-1], self.frame).tip
        if self.apart(self.nodes[node].pose, pose) < SHORT * self.far:
            return None
        self.nodes.append(Node(rows[-1], pose, node))
        self.nearest = min(self.nearest, self.apart(pose, self.goal) / self.far)
        return len(self.nodes) - 1

    def landed(self, node: int) -> Iterator[list[pin.SE3]]:
        """Yield corners of the ways that lead from a node straight to the goal."""
        rows, word = self.branch(self.nodes[node].cfg, self.goal)
        if word:
            self._kept(node, rows, word)
            return
        corners = [self.goal]
        while node > 0:
            corners.append(self.nodes[node].pose)
            node = self.nodes[node].parent
        way = corners[::-1]
        if len(way) > 1:
            yield self.shortened(way)
        yield way

    def travel(self, way: Sequence[pin.SE3], most: float = np.inf) -> float:
        """Return the joint travel of a way through corners; inf if it is stopped, or above most."""
        cfg, length = self.carrying.start, 0.0
        for corner in way:
            rows, word = self.branch(cfg, corner)
            length += sum(float(np.abs(b.q - a.q).sum()) for a, b in pairwise(rows))
            if word or length >= most:
                return np.inf
            cfg = rows[-1]
        return length

    def shortened(self, way: list[pin.SE3]) -> list[pin.SE3]:
        """Return corners of a shorter way, as far as the time allows.

        Corners are left out one after the other, then drawn to the lines beside them.
        """
        try:
            best = self.travel(way)
            for other in [*way[:-1]]:
                fewer = [corner for corner in way if corner is not other]
                if (length := self.travel(fewer, best)) < best:
                    way, best = fewer, length
            for i in range(len(way) - 1):
                before = way[i - 1] if i else self.nodes[0].pose
                middle = pin.SE3.Interpolate(before, way[i + 1], 0.5)
                for share in DRAWN:
                    other = pin.SE3.Interpolate(way[i], middle, share)
                    drawn = [*way[:i], other, *way[i + 1 :]]
                    if (length := self.travel(drawn, best)) < best:
                        way, best = drawn, length
                        break
        except TimeUpError:
            pass
        return way

    @property
    def story(self) -> str:
        """How far the search came, what stopped it most, and what to relax, in words."""
        come = f"{len(self.nodes) - 1} branches tried, none of which reaches the goal"
        if not self.stops:
            return come
        counts = [f"{count} {STOPS[word][0]}" for word, count in self.stops.most_common()]
        counts += [f"most often {what}" for what, _ in self.contacts.most_common(1)]
        left = f"the nearest leaves {100.0 * self.nearest:.0f} % of the way"
        return f"{come}, {left}; {', '.join(counts)}. {_relax(self.stops.most_common(1)[0][0])}"


def resting(
    s: Array, dq: Array, pieces: Sequence[following.Segment], rates: Array
) -> tuple[Array, Array, Array]:
    """Return times (m,) of rows, and first and second derivative of s by the time.

    Each piece is passed from rest to rest, as fast as the joint rates allow.

    Args:
        s: (m,) path behind each row.
        dq: (m, n) derivative of the joints by s.
        pieces: The pieces of the path.
        rates: (n,) largest joint rates [rad/s] or [m/s].
    """
    lengths = np.array([piece.length for piece in pieces])
    ends = np.cumsum(lengths)
    i = np.minimum(np.searchsorted(ends * (1.0 + THERE), s), len(ends) - 1)
    share = (s - (ends - lengths)[i]) / lengths[i]
    share = np.where(share > 1.0 - THERE, 1.0, np.clip(share, 0.0, 1.0))
    steep = np.array([(np.abs(dq[i == k]) / rates).max(initial=0.0) for k in range(len(ends))])
    duration = PEAK * lengths * steep
    x = betaincinv(3.0, 3.0, share)  # the inverse of 10 x^3 - 15 x^4 + 6 x^5
    t = (np.cumsum(duration) - duration)[i] + x * duration[i]
    pace = lengths[i] / duration[i]
    rate = 30.0 * x**2 * (1.0 - x) ** 2 * pace
    return t, rate, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) * pace / duration[i]


def _turn(a: Configuration, b: Configuration) -> float:
    return float(np.linalg.norm(pin.log3(a.base.rotation.T @ b.base.rotation)))


def _relax(word: str) -> str:
    return f"To relax: {STOPS[word][1]}, or give a longer timeout or another seed"
