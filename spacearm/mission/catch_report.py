"""Report of a catch: the motion until contact and the braking after it, with their margins."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, plain
from spacearm.collisions.bodies import but_for
from spacearm.errors import NoSolutionError, listed
from spacearm.mechanics.dynamics import momentum_and_torque, spacecraft_twist
from spacearm.mechanics.target import Target
from spacearm.mission.braking import Braking
from spacearm.mission.kept_limits import CatchLimits, with_checks
from spacearm.model.arguments import FLOATING, HELD, BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.motion.controllers import Tracking
from spacearm.motion.events import Event
from spacearm.motion.flights import Flight, Grasp, Phase, joined, simulate_phases
from spacearm.motion.following import Followed
from spacearm.motion.motion import Motion
from spacearm.motion.plant import Integration, Motors, Plant, WheelHold
from spacearm.planning.reactions import Wheels
from spacearm.planning.result import Plan
from spacearm.planning.strategies.detumbling import least_time
from spacearm.results import Cell, Column, Description, Measure, Result, Table
from spacearm.singularities.nearest import angle

#: Rate at which wheels take up a tumble [1/s], and how many times its inverse they are given.
DAMPED, SETTLED = 0.5, 12.0
#: What `to_dict` of a catch has under its own name.
TOLD = (
    "arm", "mode", "grapple", "begin", "distance_proven", "place_error", "turn_error",
    "twist_error", "torque", "momentum", "wheel_load", "base_rotation", "tumble", "not_checked",
)  # fmt: skip


class Candidate(NamedTuple):
    """A time and a grapple frame, and what came of it.

    Attributes:
        t: Time of contact [s].
        grapple: The grapple frame.
        caught: Whether a motion catches the target there.
        story: How near to the singular set it comes, or why there is none.
    """

    t: float
    grapple: str
    caught: bool
    story: str

    def to_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return self._asdict()


class Catch(Result, kw_only=True):
    """How an arm catches a target, from `sa.catch`.

    Time begins with the start, when the target is at its time 0. The arm rests until `begin`, moves
    as `plan` to the stand-off, then as `chase` until contact. `brake` brings the joints to rest
    with the target in the hand. `plan`, `chase` and `brake` have clocks of their own.

    Errors at contact are those of the planned motion, with momentum on board too. The simulation of
    `fly` adds the error of its own integration, which falls with `Integration.rtol`: the place is
    then off by at most about `rtol` times the distance of the tip from the system CM more.

    Attributes:
        target: The target.
        grapple: The grapple frame that is grasped; with several tips, the frame of each.
        t: Time of contact [s].
        begin: When the arm begins to move [s].
        plan: The motion to the stand-off, from rest to rest.
        chase: The motion from there to contact, which ends with the twist of the frame.
        brake: The motion of the arm with the target, from contact until its joints rest.
        distance_proven: No singular posture is nearer to both motions than this, proven [rad].
        place_error: Planned distance of the tip from the grapple frame at contact [m].
        turn_error: Planned angle between them [rad].
        twist_error: (6,) planned twist of the tip less that of the frame [m/s], [rad/s].
        torque: (n,) largest torques from the stand-off on and while braking [N m] or [N]: upper
            bounds at every instant.
        limits: The limits that it keeps, and that `fly` checks along the simulation.
        momentum: (6,) momentum of arm and target together about the CM of both [kg m/s], [N m s].
        wheels: The wheels, with their limits; None where the spacecraft has none.
        wheel_load: Largest momentum and torque of the wheels that hold the attitude, a sentence for
            each of the three motions; empty if the spacecraft floats.
        tried: All that was tried, in that order.
    """

    target: Target
    grapple: str | Mapping[str, str]
    t: float
    begin: float
    plan: Plan
    chase: Followed
    brake: Braking
    distance_proven: float
    place_error: float
    turn_error: float
    twist_error: Array
    torque: Array
    limits: CatchLimits
    momentum: Array
    wheels: Wheels | None
    wheel_load: tuple[str, ...]
    tried: tuple[Candidate, ...]

    @property
    def arm(self) -> SpaceArm:
        """The arm, without the target."""
        return self.plan.arm

    @property
    def mode(self) -> BaseMode:
        """What the spacecraft does."""
        return self.plan.mode

    @property
    def frames(self) -> Mapping[str, str]:
        """The grapple frame that each tip grasps."""
        given = self.grapple
        return {self.arm.tip: given} if isinstance(given, str) else given

    @property
    def clearance(self) -> float:
        """How far singular postures are [rad]: proven; with several hands an upper bound."""
        return self.distance_proven

    @property
    def margin(self) -> str:
        """How far singular postures are, in words."""
        return f"no singular posture nearer than {angle(self.clearance, down=True)}, proven"

    @cached_property
    def approach(self) -> Motion:
        """The motion from the start to contact, as one."""
        return joined(self.plan, self.chase, begin=self.begin)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the motion up to contact, as `Motion.save`.

        Args:
            path: The file, NPZ.
        """
        self.approach.save(path)

    def fly(
        self,
        actual: Target | None = None,
        *,
        plant: Plant = Plant(),
        integration: Integration = Integration(),
        progress: Callable[[float, float], object] | None = None,
    ) -> Flight:
        """Simulate the catch: `sa.Tracking` leads the joints, the grasp is a plastic impact.

        From contact on the wheels in the description of a floating spacecraft give a torque against
        its turning, within the least of their torques and capacities. They do so until it is at
        rest or they are full; `Flight.left_over` is what they do not hold. Wheels that hold the
        attitude give the planned torques.

        Args:
            actual: The true target, if it differs from the planned one in mass, inertia or motion:
                the tip grasps it wherever it is then.
            plant: What else acts, as in `simulate`.
            integration: How it is integrated.
            progress: Called now and then as progress(t, duration).

        Returns:
            The flight: "approach", "closing in", "braking", and "detumbling" if wheels do that.
            `Flight.limits` has every limit of the catch with its largest value in the simulation;
            one that is exceeded is an event "limit exceeded", too. The event "grasp" says how far
            the tip was from the grapple frame then, as simulated.

        Raises:
            SpaceArmError: As `simulate_phases` raises.
        """
        target = (actual or self.target).relative_to(self.plan[0])
        grasp = grasp_of(target, self.t, self.chase[-1].tip)
        begun = replace(self.plan, t=self.begin + self.plan.t)
        rests = replace(self.brake, t=self.brake.t - self.brake.t[-1])  # it has ended
        damper = self._damper() if plant.wheels is None else None
        damped = replace(plant, wheels=damper) if damper is not None else plant
        stages = [
            ("approach", begun, None, plant),
            ("closing in", self.chase, grasp, plant),
            ("braking", self.brake, None, damped),
            *[("detumbling", rests, None, damped)] * (damper is not None),
        ]
        mode, phases = self.mode, []
        for name, motion, then, acting in stages:
            lasts = self._settling() if motion is rests else float(motion.t[-1])
            if mode == HELD and self.arm.wheels and plant.wheels is None:
                acting = replace(plant, wheels=_motors(motion, self.wheels))
            flown = FLOATING if acting.wheels is not None else mode
            phase = Phase(Tracking(motion), lasts, then, mode=flown, plant=acting, name=name)
            phases.append(replace(phase, integration=integration))
        flight = simulate_phases(self.plan[0], phases, progress=progress)
        return with_checks(self._with_errors(flight, target), self.limits)

    def _with_errors(self, flight: Flight, target: Target) -> Flight:
        """Return a flight whose grasp says how far the tip was from the grapple frame, as flown."""
        events = list[Event]()
        (name,) = self.frames.values()
        for event in flight.events:
            if event.kind == "grasp" and name in target.grapples:
                off = flight.phases[1][-1].tip.actInv(target.at(event.t, name).pose)
                gap = float(np.linalg.norm(off.translation))
                turn = float(np.linalg.norm(pin.log3(off.rotation)))
                detail = f"{event.detail}; tip off the grapple frame by {gap:.1e} m, {turn:.1e} rad"
                event = event._replace(detail=detail)
            events.append(event)
        return replace(flight, events=tuple(events))

    def _damper(self) -> WheelHold | None:
        """Return the law by which wheels take up the tumble, if there are any."""
        if self.wheels is None or self.mode != FLOATING:
            return None
        D = self.brake[-1].A[3:, 3:6]
        return WheelHold(
            stiffness=0.0, damping=DAMPED * float(np.linalg.norm(D, 2)),
            torque=float(self.wheels.torque.min()), capacity=float(self.wheels.capacity.min()),
        )  # fmt: skip

    def _settling(self) -> float:
        """Return how long wheels are given to take up the tumble [s]."""
        wheels = self.wheels
        h = 0.0 if wheels is None else float(np.linalg.norm(self.momentum[3:]))
        return SETTLED / DAMPED + (h / float(wheels.torque.min()) if wheels is not None else 0.0)

    @property
    def rest(self) -> str:
        """Whether wheels of a floating spacecraft can bring it to rest afterwards, in words."""
        if self.mode != FLOATING:
            return "the wheels hold all momentum once the joints rest"
        if self.wheels is None:
            return "the spacecraft has no wheels, and turns on"
        try:
            least = least_time(self.wheels, self.momentum[3:], None)
        except NoSolutionError as error:
            return f"the wheels cannot bring it to rest: {error}"
        return f"the wheels can hold the momentum, and take at least {least:.4g} s to take it up"

    @property
    def base_rotation(self) -> float:
        """Largest rotation of the spacecraft from the start until the joints rest [rad]."""
        first = pin.Quaternion(self.plan.base[0, 3:])
        bases = np.vstack([motion.base for motion in (self.plan, self.chase, self.brake)])
        return max(first.angularDistance(pin.Quaternion(base[3:])) for base in bases)

    @property
    def tumble(self) -> Array:
        """(3,) angular velocity of arm and target once the joints rest, inertial axes [rad/s]."""
        return spacecraft_twist(self.brake[-1], np.zeros(self.arm.n), self.mode)[3:]

    @property
    def not_checked(self) -> str:
        """What the answer does not cover: of collisions, and of the forces."""
        before = f"{self.plan.not_checked}; " * bool(self.plan.not_checked)
        return (
            f"{before}torques up to the stand-off; sensors and forces of the contact itself; "
            "collisions while the arm is braked with the target in its hand"
        )

    def describe(self) -> Description:
        """Describe when and where it catches, with what margins, and what was tried."""
        rates = np.linalg.norm(self.twist_error.reshape(-1, 2, 3), axis=2).max(axis=0)
        facts: dict[str, Cell] = {
            "begins to move": Measure(self.begin, "s"),
            "at the stand-off": Measure(self.begin + self.plan.t[-1], "s"),
            "contact": Measure(self.t, "s"),
            "joints at rest": Measure(self.t + self.brake.t[-1], "s"),
            "planned tip off the grapple frame": Measure(self.place_error, "m", ".1e"),
            "planned tip turned off it": Measure(self.turn_error, "rad", ".1e"),
            "planned relative velocity": Measure(float(rates[0]), "m/s", ".1e"),
            "planned relative angular velocity": Measure(float(rates[1]), "rad/s", ".1e"),
            "largest torques": Measure(self.torque, "N m"),
            "force at the grapple": Measure(float(self.brake.borne[0]), "N"),
            "moment about it": Measure(float(self.brake.borne[1]), "N m"),
            "largest rotation of the base": Measure(self.base_rotation, "rad"),
            "angular momentum afterwards": Measure(self.momentum[3:], "N m s"),
            "angular rate afterwards": Measure(float(np.linalg.norm(self.tumble)), "rad/s"),
        }
        rows = [(c.t, c.grapple, "caught" if c.caught else "not", c.story) for c in self.tried]
        columns = (Column("contact", "s"), Column("grapple frame"), Column(""), Column(""))
        return Description(
            title=f"{self.arm.name} and {self.target.name}",
            verdict=f"caught by {listed(list(self.frames.values()))} after {self.t:.4g} s"
            f"{but_for(self.plan.not_checked)}",
            tone="good",
            notes=[self.margin, self.plan.checked, self.rest, *self._wheels()],
            tables=[Table.facts(facts), Table(columns, rows, "Tried")],
        )

    def _wheels(self) -> list[str]:
        """Say what the wheels take on each part of the way."""
        parts = zip(("to the stand-off", "closing in", "braking"), self.wheel_load, strict=False)
        return [f"{part}, {load}" for part, load in parts if load]

    def to_dict(self) -> dict[str, Any]:
        """Return all but the parts of the motion as plain data; the motion up to contact as one."""
        told = {name: getattr(self, name) for name in TOLD}
        told |= {
            "target": self.target.name,
            "contact": self.t,
            "standing": self.begin + self.plan.t[-1],
            "rest": self.t + self.brake.t[-1],
            "borne": self.brake.borne,
            "afterwards": self.rest,
            "contacts": self.tried,
            **{name: getattr(self.approach, name) for name in ("t", "q", "base")},
        }
        return {name: plain(value) for name, value in told.items()}


def _motors(motion: Motion, wheels: Wheels | None) -> Motors:
    """Return the torques of wheels that hold the attitude of a motion, over time."""
    assert wheels is not None
    shares, way, arm = wheels.shares, motion.spline, motion.arm

    def torques(t: float) -> Array:
        s = np.clip([t], *motion.t[[0, -1]])
        return -shares @ momentum_and_torque(arm, way(s), way(s, 1), way(s, 2))[1][0]

    return torques


def in_hand(target: Target, t: float, tip: pin.SE3) -> dict[str, Any]:
    """Return mass, inertia and CM of a target at a time, in the axes of the tip, for a grasp."""
    seen = tip.actInv(target.at(t).pose)
    R = seen.rotation
    return {
        "mass": target.mass,
        "inertia": R @ target.inertia @ R.T,
        "com": seen.act(target.com),
    }


def grasp_of(target: Target, t: float, tip: pin.SE3) -> Grasp:
    """Return the grasp of a target at a time [s] by a tip."""
    frame = target.at(t)
    v, w = frame.twist[:3], frame.twist[3:]
    twist = np.concatenate((v + np.cross(w, frame.pose.rotation @ target.com), w))
    return Grasp(**in_hand(target, t, tip), twist=twist)
