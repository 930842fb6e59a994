"""Session: the configuration on show, moved by the panel's messages and read out for the panel.

It knows no browser and no drawing: messages and answers are plain dictionaries for JSON.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.closure.closed_distances import ClosedSearch
from spacearm.closure.closing import Closure, Gaps, closed_motions, placed
from spacearm.closure.held_report import held_report
from spacearm.closure.holding import CLOSED, Held, hold
from spacearm.closure.target_paths import with_target
from spacearm.errors import ConfigurationError, listed, require_known, unknown
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.mechanics.target import Target
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, SpaceArm, kinematics
from spacearm.model.joints import joint_scales
from spacearm.motion.motion import Motion
from spacearm.results import short_names
from spacearm.servo.servo import FRAMES
from spacearm.singularities.joint_boxes import FreeBox
from spacearm.singularities.nearest import NearestSingular, angle
from spacearm.singularities.report import (
    FAR,
    TOLERANCE,
    SingularityReport,
    searched,
    singularity,
)
from spacearm.singularities.sets import nearest_on_way
from spacearm.viewer import readouts
from spacearm.viewer.choices import Origin, number, numbers, placement
from spacearm.viewer.motions import HandFlight, mode_named, moved

MODES = ("posture", "free-floating")
#: Largest reach of a slider from home [rad] or [m]: four turns, or 25 m.
FARTHEST = 25.0
#: Arms of more joints are shown with the first-order estimate: their search takes minutes.
SEARCHED = 20
#: Longest joint motion on which the reaction of the spacecraft is integrated [rad] or [m].
LONGEST = 4.0 * FARTHEST


class Session:
    """The configuration on show, and the two ways of moving it.

    Attributes:
        arm: The arm.
        cfg: The configuration on show.
        report: Its singularity report, with the nearest singular configuration found, of arms of up
            to `SEARCHED` joints.
        origin: Where it comes from.
        mode: "posture": the attitude stays while joints move; "free-floating": the spacecraft turns
            as momentum conservation demands.
        spacecraft: What the spacecraft does, which decides what is singular. Unless it is
            "free-floating", it decides how the spacecraft moves, too.
        note: What the last request did, in one line; empty if there is nothing to say.
        goal: Pose of the tip to plan to; None if there is none.
        blocked: Why the tip did not follow the last pull; empty if it did.
        box: Joint ranges in which no posture is singular; None if none were asked for.
        flight: The flight by hand that goes on; None if there is none.
        fly: Whether the page begins with one.
    """

    def __init__(self, arm: SpaceArm, cfg: Configuration, origin: Origin | None = None) -> None:
        self.arm = arm
        self.origin = origin or Origin.of(arm)
        self.mode = "posture"
        self.spacecraft: BaseMode = "free-floating"
        self.note = ""
        self.blocked = ""
        self.goal: pin.SE3 | None = None
        self.box: FreeBox | None = None
        self.flight: HandFlight | None = None
        self.fly = False
        self._grip = 0.0
        self._grabbed: pin.SE3 | None = None
        self._rng = np.random.default_rng(0)
        self._handlers: dict[str, Callable[[dict[str, Any]], None]] = {
            "joint": self._joint,
            "joints": self._joints,
            "fly": self._fly,
            "grab": self._grab,
            "goal": self._goal,
            "attitude": self._attitude,
            "posture": self._posture,
            "mode": self._mode,
            "spacecraft": self._spacecraft,
            "home": lambda _: self._home(),
            "nearest": lambda _: self._nearest(),
            "random": lambda _: self._random(),
        }
        self.show(cfg)

    def show(self, cfg: Configuration) -> None:
        """Show a configuration."""
        self.cfg = cfg
        report, mode = singularity(cfg, mode=self.spacecraft), self.spacecraft
        self.report: SingularityReport = report
        if cfg.arm.n <= SEARCHED:
            found = nearest_on_way(cfg.arm, mode, cfg.q[None, None], proven=False)
            self.report = searched(report, found)

    def go(self, q: Array) -> None:
        """Move the joints straight to q (n,); in free-floating mode the spacecraft reacts.

        Raises:
            ConfigurationError: The motion is too long to integrate the reaction.
        """
        way = float(np.abs(q - self.cfg.q).max())
        if way > LONGEST and self._moves == "free-floating":
            raise ConfigurationError(
                f"a joint would move by {way:.4g} rad or m; the spacecraft is followed over at "
                f"most {LONGEST:g}: switch to posture"
            )
        self.show(self.moved(self.cfg, q))

    @property
    def led(self) -> bool:
        """Whether there is one thing that can be dragged: a tip, or what several hold."""
        return len(self.arm.tips) == 1

    def place(self, cfg: Configuration) -> pin.SE3:
        """Return the pose of what is dragged; of several tips that of the first."""
        return cfg.tips[0]

    def jacobian(self, cfg: Configuration) -> Array:
        """Return the task's rows (k, n) of its twist by the joint rates."""
        return task_jacobian(cfg, mode=self._moves)

    def moved(self, cfg: Configuration, q: Array) -> Configuration:
        """Return a configuration after the joints have moved straight to q (n,)."""
        return moved(cfg, q, self._moves)

    @property
    def home(self) -> Array:
        """(n,) home positions of the joints."""
        return self.arm.home

    @property
    def range(self) -> tuple[Array, Array]:
        """Ends of the sliders: the joint limits, at most `FARTHEST` from home.

        Half a turn or a metre where there are no limits.
        """
        free = np.where(self.arm.slides, 1.0, math.pi)
        lower, upper = self.arm.lower, self.arm.upper
        return (
            np.where(np.isfinite(lower), np.maximum(lower, self.home - FARTHEST), -free),
            np.where(np.isfinite(upper), np.minimum(upper, self.home + FARTHEST), free),
        )

    def handle(self, message: object) -> None:
        """Do what a message of the panel asks.

        Raises:
            ConfigurationError: The message is unknown, or a value in it is not valid.
        """
        kind = message.get("do") if isinstance(message, dict) else message
        if not isinstance(message, dict) or str(kind) not in self._handlers:
            raise ConfigurationError(unknown("message", str(kind)[:40], self._handlers))
        self.note = self.blocked = ""
        self._handlers[str(kind)](message)

    def _joint(self, message: dict[str, Any]) -> None:
        self._move([message.get("index")], [message.get("value")])

    def _joints(self, message: dict[str, Any]) -> None:
        indices, values = message.get("indices"), message.get("values")
        if not (isinstance(indices, list) and isinstance(values, list)):
            raise ConfigurationError("joints: give lists of indices and values")
        if len(indices) != len(values) or len(indices) > self.arm.n:
            raise ConfigurationError(
                f"joints: {len(indices)} indices and {len(values)} values; give a value for each"
            )
        self._move(indices, values)

    def _move(self, indices: Sequence[object], values: Sequence[object]) -> None:
        self.go(self._wanted(indices, values))

    def _wanted(self, indices: Sequence[object], values: Sequence[object]) -> Array:
        """Return the joint positions on show with some changed, which are checked."""
        q = self.cfg.q.copy()
        for index, given in zip(indices, values, strict=True):
            value, j = number(given, "value"), readouts.joint_number(index, self.arm)
            lower, upper = (end[j] for end in self.range)
            slack = 1e-6 * (upper - lower)  # a slider's end is rounded
            if not lower - slack <= value <= upper + slack:
                slides = bool(self.arm.slides[j])
                at, low, high = (readouts.joint_value(x, slides) for x in (value, lower, upper))
                name = self.arm.joint_names[j]
                raise ConfigurationError(f"{name} at {at} is outside its range ({low} to {high})")
            q[j] = value
        return q

    def _grab(self, message: dict[str, Any]) -> None:
        """Pull the tip by a shift [m] and a turn [rad] from where it was grabbed."""
        if not self.led:
            self.arm.require_one_tip()
        grip = number(message.get("grip"), "grip")
        if grip != self._grip or self._grabbed is None:
            self._grip, self._grabbed = grip, self.place(self.cfg)
        shift, turn = (numbers(message.get(x) or [0.0] * 3, 3, x) for x in ("shift", "turn"))
        grabbed = self._grabbed
        goal = pin.SE3(pin.exp3(turn) @ grabbed.rotation, grabbed.translation + shift)
        cfg, why = pulled(self, goal)
        self.blocked = why and f"{why}{self._meanwhile}"
        self.show(cfg)

    @property
    def _meanwhile(self) -> str:
        """What the spacecraft does while something is dragged, in words."""
        held = self.spacecraft == "free-floating" and self.mode == "posture"
        does = "keeps the attitude shown" if held else f"is {self.spacecraft}"
        return f", while the spacecraft {does}"

    def _fly(self, message: dict[str, Any]) -> None:
        """Lead the tip with a twist for some seconds, by the servo, in axes of a frame."""
        twist, seconds = numbers(message.get("twist"), 6, "twist"), number(message.get("dt"), "dt")
        frame: Any = message.get("frame")
        require_known("frame", str(frame)[:40], FRAMES)
        flight = self.flight
        if flight is None or flight.cfg is not self.cfg:
            flight = self.flight = HandFlight(self.cfg, self.spacecraft)
        step = flight.fly(twist, max(seconds, 0.0), frame)
        near = None
        if math.isfinite(step.distance):
            q = flight.cfg.q
            far = float(np.linalg.norm((step.nearest - q) / self.report.radian))
            near = NearestSingular(self.arm, self.spacecraft, q, False, step.nearest, far, 0.0)
        self.cfg = flight.cfg
        self.report = searched(singularity(flight.cfg, mode=self.spacecraft), near)

    def landed(self) -> Motion | None:
        """End the flight by hand; return its motion, None if nothing has moved."""
        flight, self.flight = self.flight, None
        return None if flight is None else flight.motion

    def _flown(self) -> dict[str, Any] | None:
        """Return what the panel shows of the flight by hand."""
        if self.flight is None or (step := self.flight.step) is None:
            return None
        return {
            "moving": bool(step.rates.any()),
            "done": step.done,
            "slowed": step.halted or listed(list(step.slowed)),
            "lost": self.flight.lost.tolist(),
        }

    def _goal(self, message: dict[str, Any]) -> None:
        """Set the goal of plans: the tip's pose, with a position and an attitude if given."""
        if not self.led:
            self.arm.require_one_tip()
        goal = self.place(self.cfg).copy()
        if message.get("position") is not None:
            goal.translation = numbers(message["position"], 3, "position")
        if message.get("rpy") is not None:
            goal.rotation = pin.rpy.rpyToMatrix(numbers(message["rpy"], 3, "rpy"))
        self.goal = goal

    @property
    def _moves(self) -> BaseMode:
        """What the spacecraft does while joints move here; a posture is set by hand."""
        by_hand = self.spacecraft == "free-floating" and self.mode == "posture"
        return "fixed" if by_hand else self.spacecraft

    def _attitude(self, message: dict[str, Any]) -> None:
        R = pin.rpy.rpyToMatrix(numbers(message.get("rpy"), 3, "attitude"))
        self.show(self.arm.at(self.cfg.q, base=pin.SE3(R, self.cfg.base.translation)))

    def _posture(self, message: dict[str, Any]) -> None:
        """Show joint positions and a pose of the spacecraft as given, in any mode."""
        q = numbers(message.get("q"), self.arm.n, "q")
        self.show(self.arm.at(q, base=placement(message.get("base"), "base")))

    def _mode(self, message: dict[str, Any]) -> None:
        mode = str(message.get("mode"))
        require_known("mode", mode[:40], MODES)
        self.mode = mode

    def _spacecraft(self, message: dict[str, Any]) -> None:
        self.spacecraft, self.box = mode_named(message.get("mode")), None
        self.show(self.cfg)

    def _home(self) -> None:
        """Move the joints home; in posture mode turn the spacecraft back too."""
        if self.mode == "posture" and self.spacecraft == "free-floating":
            self.show(self.arm.at(self.home))
        else:
            self.go(self.home)

    def _random(self) -> None:
        self.go(self._rng.uniform(*self.range))

    def _nearest(self) -> None:
        """Go to the nearest singular configuration in joint space, inside the limits or not."""
        found = self.report
        if found.nearest is None:
            raise ConfigurationError(
                f"{self.arm.name}: the search found no singular configuration; one may be missed"
            )
        if found.distance == 0.0:
            raise ConfigurationError(f"{self.arm.name} is singular here already")
        way = found.nearest - self.cfg.q
        self.go(found.nearest)
        self.note = f"went {angle(found.distance)}: {readouts.turns(self.arm, way)}"

    def about(self) -> dict[str, Any]:
        """Return what the panel needs once: model, task, unit and joints."""
        return {
            **readouts.about(self.arm, self.led),
            "joints": readouts.joints(self.arm, *self.range),
            "fly": self.fly,
        }

    def as_python(self, cfg: Configuration) -> str:
        """Write a configuration of the arm on show as Python code."""
        source, _, locked, made, changed = self.origin
        code = readouts.as_python(cfg, source, locked, made)
        lacks = "# without what was changed in Python: locked joints, masses, lengths\n"
        return lacks * changed + code

    def readout(self) -> dict[str, Any]:
        """Return what the panel shows of the configuration."""
        code = self.as_python(self.cfg)
        if self.spacecraft != "free-floating":
            code += f"report = sa.singularity(cfg, mode={self.spacecraft!r})\n"
        return {
            "mode": self.mode,
            "note": self.note,
            "blocked": self.blocked,
            "spacecraft": self.spacecraft,
            "flight": self._flown(),
            "goal": None if self.goal is None else readouts.pose(self.goal),
            "box": self.box and readouts.ranges(self.box, self.cfg.q, *self.range),
            **readouts.readout(self.report, self.place(self.cfg) if self.led else None),
            "python": code,
        }


# --- the tip pulled -----------------------------------------------------------------------------

MOST_STEPS = 40
#: Damping of the first step, over the largest singular value squared.
START = 1e-4
#: Share of the largest singular value within which the tip counts as there [rad].
CLOSE = 2e-3
#: Largest joint motion of one step [rad] or [m].
STRIDE = 0.3
#: Damping, likewise, from which on no step helps.
HOPELESS = 1e3
#: Share of the error that has to be left at most after a step that counts.
LESS = 1.0 - 1e-6
#: Joint motions by which a singular posture is left [rad] or [m].
BENDS = (0.1, -0.1, 0.02, -0.02)


def pulled(session: Session, goal: pin.SE3) -> tuple[Configuration, str]:
    """Bring what is dragged to a pose, or as near as it comes, along the rows of the task.

    Levenberg's and Marquardt's method: steps along lost directions are damped away, and it slides
    along those that are left. Joints stop at the ends of their ranges.

    Args:
        session: What is on show.
        goal: The pose in the inertial frame.

    Returns:
        The configuration, and why it is not where it was pulled to; empty if it is.
    """
    cfg, (lower, upper) = session.cfg, session.range

    def left_of(cfg: Configuration) -> Array:
        return _error(cfg, session.place(cfg), goal)

    def tried(step: Array) -> tuple[Configuration, Array, float]:
        try:
            trial = session.moved(cfg, np.clip(cfg.q + step, lower, upper))
        except ConfigurationError:  # grasps that do not close there
            return cfg, error, np.inf
        left = left_of(trial)
        return trial, left, float(np.linalg.norm(left))

    error, damping, stopped = left_of(cfg), START, np.zeros(cfg.arm.n, dtype=bool)
    size, largest = float(np.linalg.norm(error)), 0.0
    for _ in range(MOST_STEPS):
        J = session.jacobian(cfg)
        largest = float(np.linalg.norm(J, 2))
        if size <= 0.1 * CLOSE * largest:
            break
        J = np.where(stopped, 0.0, J)
        weight = damping * (largest**2 or 1.0)  # J is zero where the tip has no motion at all
        normal = J.T @ J + weight * np.eye(cfg.arm.n)
        step = np.linalg.solve(normal, J.T @ error)
        step *= min(1.0, STRIDE / max(float(np.abs(step).max()), 1e-12))
        found = tried(step)
        hit = (np.clip(cfg.q + step, lower, upper) != cfg.q + step) & ~stopped
        if found[2] < size * LESS:
            (cfg, error, size), damping = found, max(0.2 * damping, 1e-9)
        elif hit.any():
            stopped |= hit
        elif damping < HOPELESS:
            damping *= 10.0
        else:  # on the singular set: out of it by the joint motion that leaves the tip at rest
            still = np.linalg.svd(J)[2][-1]
            found = min((tried(bend * still) for bend in BENDS), key=lambda one: one[2])
            if found[2] >= size * LESS:
                break
            (cfg, error, size), damping = found, START
    return cfg, _reason(session, cfg, error, largest)


def _error(cfg: Configuration, place: pin.SE3, goal: pin.SE3) -> Array:
    """Return the task's rows (k,) of the twist that leads to a goal in one second, scaled."""
    way = goal.translation - place.translation
    turn = pin.log3(goal.rotation @ place.rotation.T)
    twist = np.concatenate((way, turn))[:, None]
    task = replace(cfg.arm.task, tips=1)
    return (task.scale * task.components(twist, task.axes(cfg.base.rotation)))[:, 0]


def _reason(session: Session, cfg: Configuration, error: Array, largest: float) -> str:
    """Return why what is dragged is not at its goal; empty if it is."""
    if np.linalg.norm(error) <= CLOSE * largest:
        return ""
    arm, (lower, upper) = cfg.arm, session.range
    room = 1e-6 * (upper - lower)
    pull = session.jacobian(cfg).T @ error
    pushed = ((cfg.q >= upper - room) & (pull > 0.0)) | ((cfg.q <= lower + room) & (pull < 0.0))
    if pushed.any():
        names = short_names(arm.joint_names)
        ends = [names[j] for j in np.flatnonzero(pushed)]
        place = "the end of its range" if len(ends) == 1 else "the ends of their ranges"
        where = f"{'is' if len(ends) == 1 else 'are'} at {place}"
        return f"The tip cannot follow: {listed(ends)} {where}"
    singular = "the posture is singular: " if len(error) <= arm.n else ""
    return f"The tip cannot follow: {singular}in this direction it has no motion left"


# --- the first posture --------------------------------------------------------------------------

#: Distance to the singular set from which on a posture is good to begin with [rad].
REGULAR = math.radians(10.0)
TRIES = 40
#: Largest joint positions tried, from zero or the limit nearest to it [rad] or [m].
BENT = 1.0


def opening_posture(arm: SpaceArm) -> Array:
    """Return the joint positions (n,) with which the viewer begins, the same at every call.

    The home positions, if the robot's file states any that are not zero. Else zeros, or the limits
    nearest to them, if that is far enough from the singular set. Else a
    posture bent by at most a radian: the first of `TRIES` that is far enough, or the farthest of
    them. Joints at a limit are bent away from it, so that the tip can be pulled all around.

    Args:
        arm: The arm.
    """
    home = np.clip(np.zeros(arm.n), arm.lower, arm.upper)
    if (arm.home != home).any():
        return arm.home
    rng = np.random.default_rng(0)
    bends = np.where(arm.slides, 0.2, 1.0) * rng.uniform(-BENT, BENT, (TRIES, arm.n)).round(2)
    best, farthest = home, _distance(arm, home)
    for bend in bends:
        if farthest >= REGULAR:
            break
        there = home + bend
        inside = (arm.lower <= there) & (there <= arm.upper)  # else bent the other way
        q = np.clip(np.where(inside, there, home - bend), arm.lower, arm.upper)
        distance = _distance(arm, q)
        if distance > farthest:
            best, farthest = q, distance
    return best


def _distance(arm: SpaceArm, q: Array) -> float:
    """Return the distance to the singular set, 0 where it is singular by rounding alone."""
    report = singularity(arm.at(q))
    return report.distance if report.kind == "regular" else 0.0


# --- arms that hold one thing -------------------------------------------------------------------

#: Most steps by which a slider moves a joint of a closed chain, and how near it comes [rad], [m].
CLOSING, NEAR_VALUE = 30, 1e-4
#: Most random postures that are tried until one closes.
RANDOM = 20


class HeldSession(Session):
    """A session of arms that hold one thing, which is dragged; all that moves keeps the grasps.

    Its report is that of what is held: its directions, and distances along closure.

    Args:
        held: What is held, and how.
    """

    def __init__(self, held: Held) -> None:
        cfg, self._target, self._grasps = held.configuration, held.target, held.grasps
        self._free = cfg.arm
        limits = not cfg.outside_limits
        self._closure = Closure(cfg.arm, tuple(self._grasps.values()), False, limits)
        drawn = cfg
        if held.target is not None:
            first = self._grasps[cfg.arm.tips[0]]
            drawn, _ = with_target(cfg, held.target, first.inverse())
        self._begin = drawn
        super().__init__(drawn.arm, drawn)
        if held.target is None:
            self._spacecraft({"mode": "fixed"})

    @property
    def held(self) -> Held:
        """How it is held in the posture on show."""
        hands, grasps = self._hands(self.cfg), self._grasps
        return hold(hands, self._there(hands), grasps, limits=self._closure.limits)

    def _hands(self, cfg: Configuration) -> Configuration:
        return kinematics(self._free, cfg.q.copy(), cfg.base)

    def _there(self, hands: Configuration) -> Target | None:
        """Return the target where the first hand holds it."""
        first = self._grasps[hands.arm.tips[0]].inverse()
        return self._target and self._target.replace(pose=hands.tips[0] * first)

    def place(self, cfg: Configuration) -> pin.SE3:
        """Return the pose of what is held; of the fixed world that of the spacecraft."""
        there = self._there(self._hands(cfg))
        return cfg.base if there is None else there.pose

    @property
    def led(self) -> bool:
        """What is held is dragged."""
        return True

    def jacobian(self, cfg: Configuration) -> Array:
        """Return the task's rows (k, n) of its twist, by joint motions that keep the grasps."""
        return self._map(cfg, self._moves)

    def _map(self, cfg: Configuration, mode: BaseMode) -> Array:
        hands = self._hands(cfg)
        closed = closed_motions(hands, self._there(hands), mode)
        return closed.held @ closed.motions.T / joint_scales(self._free)

    def moved(self, cfg: Configuration, q: Array) -> Configuration:
        """Return a configuration after the joints have moved straight to the closed ones near q.

        Raises:
            ConfigurationError: There are none.
        """
        hands = self._hands(cfg)
        held = self._there(hands)
        first = self._grasps[hands.arm.tips[0]].inverse()
        frame = kinematics(self._free, q.copy(), pin.SE3.Identity()).tips[0] * first
        q, X = self._closure.solved(q, frame)
        there, _ = placed(hands, held, q, X)
        if max(Gaps.of(there.tips, there.base * X, self._closure.grasps)) > CLOSED:
            raise ConfigurationError("the grasps do not close near that posture")
        if held is None:
            return cfg.arm.at(q, base=there.base)
        return moved(cfg, q, self._moves)

    def show(self, cfg: Configuration) -> None:
        """Show a configuration, closed."""
        cfg = self.moved(cfg, cfg.q)
        hands = self._hands(cfg)
        held = held_report(
            hands, self._there(hands), self._grasps, self.spacecraft, TOLERANCE, False, None
        )
        sigma = np.pad(held.sigma, (0, len(held.lost) - len(held.sigma)))
        self.cfg = cfg
        self.report = replace(
            singularity(cfg, mode=self.spacecraft),
            sigma=sigma,
            sigma_min=float(sigma[-1]),
            condition=float(sigma[0] / sigma[-1]) if sigma[-1] > 0.0 else np.inf,
            manipulability=held.manipulability,
            determinant=None,
            distance=held.distance if held.distance <= FAR else np.inf,
            distance_proven=0.0,
            nearest=None,
            away=held.away,
            kind=held.kind,
            rank=held.available.shape[1],
            available=held.available,
            lost=held.lost,
            null_space=held.internal,
            jacobian=self._map(cfg, self.spacecraft),
        )

    def _move(self, indices: Sequence[object], values: Sequence[object]) -> None:
        """Move joints to values, the others so that the grasps stay closed."""
        wanted = self._wanted(indices, values)
        changed = np.flatnonzero(wanted != self.cfg.q)
        cfg, left = self.cfg, np.inf
        for _ in range(CLOSING):
            q = cfg.q.copy()
            q[changed] = wanted[changed]
            there = self.moved(cfg, q)
            off = float(np.abs(there.q - wanted)[changed].max(initial=0.0))
            if off >= left:
                break
            cfg, left = there, off
            if left <= NEAR_VALUE:
                break
        self.show(cfg)
        if left > NEAR_VALUE:
            self.blocked = "The grasps let the joint go no farther"

    @property
    def _meanwhile(self) -> str:
        """What the spacecraft does; of the fixed world it is dragged itself."""
        return "" if self._target is None else super()._meanwhile

    def _attitude(self, message: dict[str, Any]) -> None:
        if self._target is None:
            raise ConfigurationError(
                "the hands hold the fixed world, and the spacecraft with it; drag the spacecraft"
            )
        super()._attitude(message)

    def _home(self) -> None:
        """Return to the posture with which it began."""
        self.show(self._begin)

    def _random(self) -> None:
        for _ in range(RANDOM):
            with suppress(ConfigurationError):
                return super()._random()
        raise ConfigurationError(f"of {RANDOM} random postures none is near a closed one")

    def _nearest(self) -> None:
        """Go to the nearest singular posture found along closure."""
        hands, mode = self._hands(self.cfg), self.spacecraft
        search = ClosedSearch(self._closure, mode)
        search.look(hands, self._there(hands))
        found = search.nearest(hands.q)
        if found is None:
            raise ConfigurationError("no singular posture was found along closure")
        far = float(np.linalg.norm((found - hands.q) / joint_scales(self._free)))
        way = found - hands.q
        self.show(self.moved(self.cfg, found))
        self.note = f"went {angle(far)} along closure: {readouts.turns(self.arm, way)}"
