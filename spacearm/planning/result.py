"""Results of planning: a joint motion that arrives, or whether two postures are connected."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from scipy.interpolate import BSpline, PPoly

from spacearm.arrays import Array, Integers, plain, read_only
from spacearm.collisions.bodies import but_for, left_out
from spacearm.collisions.obstacles import Obstacle
from spacearm.collisions.swept_motion import Floating, Flown, SweptMotion
from spacearm.errors import NoSolutionError
from spacearm.mechanics.floating import bases, placed, samples
from spacearm.model.arguments import FLOATING
from spacearm.model.arm import AT_REST, Configuration, SpaceArm
from spacearm.motion.motion import AnyMotion, Drifting
from spacearm.planning import timing
from spacearm.planning.many_curves import FlownRows
from spacearm.planning.reactions import boundless
from spacearm.polynomial.certificate import Certificate
from spacearm.polynomial.tubes import of_spline
from spacearm.results import Cell, Description, Measure, Result, Table, joint_measures
from spacearm.singularities.immaterial_masses import payload_note
from spacearm.singularities.nearest import NearestSingular, nearness
from spacearm.singularities.sets import nearest_on_way, prove_regular, prove_way

#: How far the splines that are flown may be from chords that stand for them, about [rad].
SPLINE = 1e-4
IGNORED = "collisions NOT checked (collisions=False)"
FAILED = "collisions NOT checked of this attempt"


class Attempt(NamedTuple):
    """One method and what came of it.

    Attributes:
        method: Its name.
        arrived: Whether it gave the plan.
        story: Joint travel and distance to the singular set of the plan, or where and why the
            method failed.
    """

    method: str
    arrived: bool
    story: str

    def to_dict(self) -> dict[str, Any]:
        """Return the attempt as plain data."""
        return self._asdict()


class ArrivalError(NamedTuple):
    """How far from its last row a plan ends as flown.

    Attributes:
        tip: Distance of the tip from where it should be, of several tips the largest [m].
        attitude: Angle between the attitude of the spacecraft and that of the last row [rad].
    """

    tip: float
    attitude: float


class Plan(Drifting, kw_only=True):
    """A motion of the joints from rest, from `sa.plan`: a `Motion` with more to it.

    `sa.Tracking` leads the joints through the rows along quintic splines; `arrival_error` says how
    exactly they arrive. `nearest` and `certificate` hold for these splines, rounding included;
    joint limits, contacts and obstacles are checked along them too. The straight lines between the
    rows keep the velocity limits of the URDF.

    Attributes:
        method: The method that found it.
        clearance: Least distance to the singular set that was asked for [rad]; the one that is
            proven, as a rule larger, is `certificate.clearance`.
        checked: What the check of collisions covers and what it does not, in one sentence.
        apart: Whether it is proven that no two of the bodies checked meet; None if none were.
        tried: All methods that were tried, in order.
        wheel_load: Largest momentum and torque of the wheels while they hold the attitude, in one
            sentence, bounds between the rows included; empty if the spacecraft floats.
        obstacles: What else the plan keeps off; the file of a plan does not contain them.
        final_rates: (n,) joint rates at the end [rad/s] or [m/s], zero where the plan ends at rest.
    """

    method: str
    clearance: float
    checked: str
    apart: bool | None
    tried: tuple[Attempt, ...]
    wheel_load: str = ""
    obstacles: tuple[Obstacle, ...] = field(default=(), metadata={"in_file": False})
    final_rates: Array

    @classmethod
    def of_rows(
        cls,
        method: str,
        rows: Sequence[Configuration],
        rates: Array,
        *,
        t: Array | None = None,
        momentum: Array = AT_REST,
        **fields: Any,
    ) -> Plan:
        """Return the plan that leads through some configurations.

        Args:
            method: The method that found it.
            rows: The configurations, seen from the system CM.
            rates: (n,) largest joint rates [rad/s] or [m/s].
            t: (m,) times of the rows [s]; from rest to rest within these rates if None.
            momentum: (6,) momentum on board, with which the system CM drifts on.
            **fields: Other fields of the plan, by name.
        """
        arm, along = rows[0].arm, samples(rows)
        t = timing.rest_to_rest_times(along["q"], rates) if t is None else t
        along["base"][:, :3] += np.outer(t, momentum[:3] / arm.mass)
        unknown: dict[str, Any] = {"clearance": 0.0, "checked": FAILED, "apart": None, "tried": ()}
        wheels = np.zeros((len(rows), len(arm.wheels)))
        still = {"momentum": np.tile(momentum, (len(rows), 1)), "wheels": wheels}
        still["final_rates"] = np.zeros(arm.n)
        return cls(arm=arm, method=method, t=t, **along, **(unknown | still | fields))

    @cached_property
    def dq(self) -> Array:
        """(m, n) joint rates [rad/s] or [m/s], zero at the start and at corners."""
        return self._rates(1)

    @cached_property
    def ddq(self) -> Array:
        """(m, n) joint accelerations [rad/s^2] or [m/s^2], zero at both ends and at corners."""
        return self._rates(2)

    @property
    def _has_rates(self) -> bool:
        return len(self) > 1

    @cached_property
    def spline(self) -> PPoly:
        """Joint positions (n,) over time as flown: quintic through the rows, at rest at corners."""
        return self._flown.spline

    @cached_property
    def wheel_spline(self) -> BSpline | None:
        """What wheels hold (w,) over time [N m s], where a floating spacecraft is detumbled."""
        return self._flown.spins if self.mode == FLOATING else None

    def _rates(self, order: int) -> Array:
        """Return the derivatives (m, n) of the joint positions."""
        if len(self) == 1:
            return read_only(np.zeros_like(self.q))
        rates = self.spline(self.t, order)
        rates[timing.corners(np.diff(self.q, axis=0))] = 0.0  # without rounding
        if order == 1:
            rates[-1] = self.final_rates
        return read_only(rates)

    @cached_property
    def arrival_error(self) -> ArrivalError:
        """How far from its last row the plan ends as `sa.Tracking` flies it, through its rows."""
        if self.mode != FLOATING or len(self) == 1:
            return ArrivalError(0.0, 0.0)
        end, T = self[-1], self._flown.attitudes(parts=4)[-1]
        pairs = zip(placed(end, end.q, T).tips, end.tips, strict=True)
        off = max(float(np.linalg.norm(a.translation - b.translation)) for a, b in pairs)
        return ArrivalError(off, float(np.linalg.norm(pin.log3(T.T @ end.base.rotation))))

    @cached_property
    def swept(self) -> SweptMotion:
        """What is flown, as checks of collisions see it."""
        if len(self) == 1:
            return Floating([self._start], self.t)
        floats = self.mode == FLOATING
        arm = self.arm if floats else boundless(self.arm)
        turning = self._flown.turning if floats else 0.0
        points = of_spline(self.spline, np.inf)
        speed = float(np.linalg.norm(self._drift))
        return Flown(arm, points, self.t, self._flown_base, turning, speed)

    def _flown_base(self, u: float) -> pin.SE3:
        """Return the pose of the base between two samples, of which u counts the first."""
        floats = self.mode == FLOATING
        i = min(int(u), len(self) - 1)
        t = float(np.interp(u, np.arange(len(self)), self.t))
        R = self._attitudes[i if floats else 0]
        if floats and t > self.t[i]:
            share = (t - self.t[i]) / (self.t[i + 1] - self.t[i])
            times = np.linspace(self.t[i], t, 2 + int(self._steps[i] * share))
            R = self._flown.attitudes_from(R, times)[-1]
        pose = placed(self._start, self.spline(t), R).base
        return pin.SE3(pose.rotation, pose.translation + t * self._drift)

    @cached_property
    def _start(self) -> Configuration:
        return self[0]

    @cached_property
    def _attitudes(self) -> list[Array]:
        return [cfg.base.rotation for cfg in self]

    @cached_property
    def _steps(self) -> Integers:
        return self._flown.steps(0.5)

    @property
    def _drift(self) -> Array:
        """Velocity of the system CM [m/s]."""
        return self.momentum[0, :3] / self.arm.mass

    @cached_property
    def _flown(self) -> FlownRows:
        return FlownRows(self._start, self.t, self.q, self.wheels, self.final_rates)

    @property
    def length(self) -> float:
        """Joint travel, the sum over all joints [rad] or [m]."""
        return float(np.abs(np.diff(self.q, axis=0)).sum())

    @property
    def control_points(self) -> Array:
        """(pieces, 6, n) control points of the splines that are flown."""
        if len(self) == 1:
            return super().control_points
        return of_spline(self.spline, SPLINE)

    @cached_property
    def nearest(self) -> NearestSingular | None:
        """The singular posture nearest to what is flown, found, and how near none is, proven.

        None where no search finds one.
        """
        return nearest_on_way(self.arm, self.mode, self.control_points)

    @cached_property
    def certificate(self) -> Certificate | None:
        """The proof that what is flown meets no singularity; its clearance is the largest proven.

        None where there is none for the arm, see `prove_regular`.
        """
        proof = prove_regular(self.arm, self.q, mode=self.mode)
        if not proof:
            return proof
        near = self.nearest
        if near is not None and near.distance_proven:
            return replace(proof, clearance=near.distance_proven)
        flown = prove_way(self.arm, self.mode, self.control_points)
        return proof if flown is None else replace(flown, margin=proof.margin)

    @property
    def clear(self) -> str:
        """How far the flown motion stays from singular postures: proven and found, in words."""
        if self.nearest is None:
            return "the search found no singular posture; one may be missed"
        return nearness(self.nearest.distance, self.nearest.distance_proven)

    @property
    def wheels_act(self) -> bool:
        """Whether wheels change what they hold."""
        return bool(self.wheel_load)

    @property
    def travel(self) -> str:
        """The joint travel in words, with its unit."""
        return f"joint travel {self.length:.4g} {self.arm.travel_unit}"

    @property
    def story(self) -> str:
        """The method that found the plan, its joint travel and its duration, in one line."""
        return f"{self.method}: {self.travel}, {self.t[-1]:.3g} s{but_for(self.not_checked)}"

    @property
    def not_checked(self) -> str:
        """What the check of collisions left out; empty if nothing."""
        return left_out(self.checked) if self.apart else "collisions"

    def to_dict(self) -> dict[str, Any]:
        """Return all fields and quantities as plain data, joint travel and certificate too."""
        near = self.nearest
        return super().to_dict() | {
            "travel": self.length,
            "certificate": plain(self.certificate),
            "nearest": None if near is None else plain(near.q),
            "distance": None if near is None else near.distance,
            "distance_proven": 0.0 if near is None else near.distance_proven,
            "arrival_error": self.arrival_error._asdict(),
        }

    def describe(self) -> Description:
        """Describe the motion, what is proven of it, and the methods that were tried."""
        motion = super().describe()
        met = {True: "none, proven", False: "not proven", None: "not checked"}
        apart = met[self.apart]
        if self.apart and self.not_checked:
            apart = f"none between the bodies checked, proven{but_for(self.not_checked)}"
        proof = None if self.certificate is None else bool(self.certificate)
        facts: dict[str, Cell] = {
            "singularities": met[proof],
            "clearance": self.clear,
            "clearance asked for": Measure(self.clearance, "rad"),
            "least sigma_min": Measure(float(self.sigma_min.min()), self.arm.sigma_unit),
            "collisions": apart,
            "flown, the tip ends off by": Measure(self.arrival_error.tip, "m", ".1e"),
            "flown, the spacecraft ends off by": Measure(self.arrival_error.attitude, "rad", ".1e"),
        }
        if self.final_rates.any():
            ends = joint_measures(self.final_rates, self.arm.slides, "/s")
            facts |= {
                f"ends, {name} at": x for name, x in zip(self.arm.joint_names, ends, strict=True)
            }
        wheels = [f"wheels: {self.wheel_load}"] if self.wheel_load else []
        tried = [(a.method, "arrives" if a.arrived else "fails", a.story) for a in self.tried]
        return replace(
            motion,
            verdict=f"planned ({self.method}): {self.travel}, {self.t[-1]:.4g} s"
            f"{but_for(self.not_checked)}",
            notes=[
                *motion.notes,
                self.checked,
                *wheels,
                payload_note(self.arm, self.mode),
                *self._drifting(),
            ],
            tables=[
                *motion.tables,
                Table.facts(facts, "On the way"),
                Table(("method", "", ""), tried, "Tried"),
            ],
        )

    def _drifting(self) -> list[str]:
        """Say what no motion of arm and wheels takes away: the linear momentum."""
        p = self.momentum[-1, :3]
        if not p.any():
            return []
        speed = float(np.linalg.norm(p)) / self.arm.mass
        words = ", ".join(f"{x:.4g}" for x in p)
        return [
            f"linear momentum of ({words}) kg m/s stays: the system CM drifts on at {speed:.4g} "
            "m/s, and only thrusters stop it"
        ]


def landed(
    plan: AnyMotion, attitude: Array | None = None, on_the_way: Sequence[int] = ()
) -> AnyMotion:
    """Return a plan bent a little, so that it ends as flown with the attitude that it should.

    Motions that are not plans stay.

    Args:
        plan: The plan.
        attitude: (3, 3) the attitude; that of its last row if None.
        on_the_way: Numbers of rows that it passes with their attitudes, too.

    Raises:
        NoSolutionError: It cannot be; carries the rows.
    """
    if not isinstance(plan, Plan) or plan.mode != FLOATING or len(plan) == 1:
        return plan
    start, h = plan[0], plan.momentum[0, :3]
    wanted = {i: plan[i].base.rotation for i in on_the_way}
    wanted[len(plan) - 1] = plan[-1].base.rotation if attitude is None else attitude
    try:
        rows, attitudes = plan._flown.landed(wanted)
    except NoSolutionError as error:
        raise NoSolutionError(str(error), [*plan]) from None
    base = bases(start, rows.q, attitudes)
    base[:, :3] += np.outer(plan.t, h / plan.arm.mass)
    return replace(plan, q=rows.q, base=base)


def best_attempt(cfg: Configuration, rows: object, tried: Iterable[Attempt] = ()) -> Plan:
    """Return the best attempt: rows that do not solve the problem, or the start alone."""
    best = rows if isinstance(rows, Sequence) else [cfg]
    return Plan.of_rows("best attempt", best, timing.largest_rates(cfg.arm), tried=tuple(tried))


Answer: TypeAlias = Literal["yes", "no", "unknown"]


class Connection(Result):
    """Whether a joint path without singularities leads from one posture to another.

    Attributes:
        arm: The arm.
        answer: "yes", by `path`; "no", proven; "unknown", where a search found no path and nothing
            proves that there is none.
        reason: How it is known, or what was tried.
        path: (m, n) joint positions, straight between the rows; no rows where the answer is not
            "yes".
        certificate: The proof that the path meets no singularity, else None.
    """

    arm: SpaceArm
    answer: Answer
    reason: str
    path: Array = field(default_factory=lambda: np.empty((0, 0)))
    certificate: Certificate | None = None

    not_checked = "collisions"

    def describe(self) -> Description:
        """Describe the answer and how it is known."""
        proven = {"yes": "yes, by a path that is proven free", "no": "no, proven"}
        facts: dict[str, Cell] = {"reason": self.reason}
        if self.answer == "yes":
            facts["joint travel"] = Measure(
                float(np.abs(np.diff(self.path, axis=0)).sum()), self.arm.travel_unit
            )
            facts["rows"] = len(self.path)
        return Description(
            title=f"{self.arm.name}: connected without a singularity",
            verdict=proven.get(self.answer, self.answer),
            tables=[Table.facts(facts)],
        )
