"""Momentum on board: what it does to a posture, and how long the arm can compensate for it.

Without external torques the angular momentum h stays, whatever the joints do. With the joints
locked the system turns as one body, w = D^-1 h, and the tip drifts. The tip stays where it is
while the joints move at dq = -J*^+ J_b A_b^-1 h, as long as J* and the joint limits allow. Compare
Nanos & Papadopoulos, On the dynamics and control of free-floating space manipulator systems in the
presence of angular momentum, Front. Robot. AI 4:26 (2017), DOI 10.3389/frobt.2017.00026. The
spacecraft stays at rest while the arm carries all of it, D_q dq = h.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

from spacearm.arrays import Array, Progress, positive
from spacearm.errors import ConfigurationError
from spacearm.mechanics.jacobian import base_velocity, momentum_matrix, prescribed_motion
from spacearm.mission.attitudes import turning_axis
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, still_wheels
from spacearm.motion.events import first_fall
from spacearm.motion.following import Segment
from spacearm.motion.goal import goal_rows
from spacearm.motion.leading import ENDS, Led, Settings, lead_all, table_of
from spacearm.motion.motion import Motion
from spacearm.results import Cell, Description, Measure, Result, Table, joint_measures
from spacearm.signatures import checked

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver

#: Default longest time looked at [s].
HORIZON = 3600.0
#: Samples of the motion that holds the tip.
SAMPLES, MOST_SAMPLES = 101, 3201
#: How far its spline may be from it between samples, before these are doubled [rad] or [m].
HELD = 1e-6
#: Share of the momentum that the arm may leave to the spacecraft: at rows of the motion that
#: carries it, and halfway between them.
CARRIED, LACKING = 1e-9, 1e-4
#: Joint motion of the first step of that motion, and below which it ends [rad] or [m].
STEP, FINEST = 0.05, 1e-5
#: Error of its steps, relative to joint positions and absolute [rad] or [m].
RTOL = 1e-9
#: Rows into which a step is cut, the fewest that lack no more momentum than they may.
PARTS = (1, 2, 4, 8, 16, 32, 64)


class MomentumBudget(Result):
    """What momentum on board does to a posture, and how long the arm can compensate for it.

    Attributes:
        configuration: The posture, the pose of the spacecraft and the momentum.
        spin: (3,) angular velocity of the whole system with its joints locked, inertial axes
            [rad/s].
        drift: (6,) twist of the tip while the joints are locked [m/s], [rad/s], inertial axes.
        rates: (n,) joint rates that hold the tip in the task's rows at first [rad/s] or [m/s].
        holds: How long the joints hold the tip by least rates [s]; at most `horizon`. With more
            joints than task components another motion may hold it longer: a lower bound.
        ended: What ends it: "horizon", "singularity", "joint limit" or "cannot" where J* lacks the
            direction of the drift at once.
        holding: The motion that holds the tip; of one sample where it cannot.
        carries: How long the arm carries all of the momentum by least rates, the spacecraft at rest
            [s]. Another motion may carry it longer: a lower bound of what the arm can do.
        carrying_ended: What ends that: "horizon", "joint limit" or "cannot" where no joint rates
            have this momentum (or none any more).
        carrying: The motion that does so; of one sample where there is none.
        horizon: The longest time looked at [s].
    """

    configuration: Configuration
    spin: Array
    drift: Array
    rates: Array
    holds: float
    ended: str
    holding: Motion
    carries: float
    carrying_ended: str
    carrying: Motion
    horizon: float

    @property
    def verdict(self) -> str:
        """The answer in two sentences."""
        turn = np.degrees(np.linalg.norm(self.spin))
        still = (
            "the arm cannot hold the tip"
            if self.ended == "cannot"
            else f"the arm holds the tip for {self._longer}{self.holds:.4g} s ({self.ended})"
        )
        rest = (
            "it cannot bring the spacecraft to rest"
            if self.carrying_ended == "cannot" and self.carries == 0.0
            else f"it keeps the spacecraft at rest for at least {self.carries:.4g} s "
            f"({self.carrying_ended})"
        )
        return (
            f"Joints locked, the system rotates at {turn:.4g}°/s; {still}, {rest}. No motion of "
            "the arm removes the momentum: that takes thrusters, or wheels with this capacity."
        )

    @property
    def _longer(self) -> str:
        """The words before a time that another motion may exceed."""
        arm = self.configuration.arm
        return "at least " if arm.n > arm.task.k else ""

    not_checked = "collisions, joint rates"

    def describe(self) -> Description:
        """Describe what the momentum does, and how long the arm can compensate for it."""
        arm = self.configuration.arm
        rates = joint_measures(self.rates, arm.slides, per="/s")
        facts: dict[str, Cell] = {
            "spin, joints locked": Measure(self.spin, "rad/s"),
            "drift of the tip": Measure(self.drift[:3], "m/s"),
            "turn of the tip": Measure(self.drift[3:], "rad/s"),
            **{
                f"{name} to hold the tip": x for name, x in zip(arm.joint_names, rates, strict=True)
            },
            f"tip held for {self._longer}".rstrip(): Measure(self.holds, "s"),
            "tip held until": self.ended,
            "spacecraft at rest for at least": Measure(self.carries, "s"),
            "spacecraft at rest until": self.carrying_ended,
        }
        return Description(
            title=arm.name,
            verdict=self.verdict,
            tables=[Table.facts(facts)],
        )


@checked
def momentum_budget(
    cfg: Configuration,
    *,
    horizon: float = HORIZON,
    limits: bool = True,
    progress: Progress | None = None,
) -> MomentumBudget:
    """Compute what momentum on board does to a posture, and how long the arm can compensate for it.

    Detumbling by the arm alone does not exist: joint torques are internal, and the angular momentum
    stays. The arm can hold its tip, or keep the spacecraft at rest, for a while. Both times are
    those of the motion with the least joint rates at each instant; they are lower bounds where
    other motions do the same (see `MomentumBudget`).

    Args:
        cfg: The posture and the momentum, which must be angular: linear momentum moves everything
            alike. The wheels must be still.
        horizon: The longest time looked at [s].
        limits: Whether joint limits count.
        progress: Called as progress(done, 1000); the motions may end before the horizon.

    Returns:
        The turn and the drift with locked joints, and how long the arm can do what.

    Raises:
        ConfigurationError: The momentum is zero or has a linear part, or the horizon is not
            positive.
        UnsupportedError: The wheels hold momentum, the arm has several tips or fewer joints than
            task rows, or the task singles out directions that turn with the spacecraft.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([-0.6, 1.4], momentum=[0, 0, 0, 0, 0, 0.5])
        >>> sa.momentum_budget(cfg).ended
        'singularity'
    """
    arm = cfg.arm
    arm.require_one_tip()
    turning_axis(arm)
    still_wheels(cfg, "which is momentum already; give the whole momentum and leave wheels out")
    h = cfg.momentum
    if h[:3].any() or not h[3:].any():
        raise ConfigurationError(
            f"momentum is {h.tolist()}; give an angular momentum, without a linear part: "
            "arm.at(q, momentum=[0, 0, 0, hx, hy, hz])"
        )
    horizon = positive(horizon, "horizon", "time [s]")
    split = prescribed_motion(cfg, {})
    J, drift = goal_rows(cfg, split.jacobian), goal_rows(cfg, split.drift)
    rates = -np.linalg.pinv(J) @ drift
    told = progress or (lambda *_: None)
    holds, ended, holding = _hold(cfg, horizon, limits, lambda s: told(int(500 * s), 1000))
    carries, why, carrying = _carry(
        cfg, horizon, limits, lambda t: told(500 + int(500 * t / horizon), 1000)
    )
    told(1000, 1000)
    return MomentumBudget(
        configuration=cfg,
        spin=base_velocity(cfg, np.zeros(arm.n))[3:],
        drift=split.drift,
        rates=rates,
        holds=holds,
        ended=ended,
        holding=holding,
        carries=carries,
        carrying_ended=why,
        carrying=carrying,
        horizon=horizon,
    )


def _hold(
    cfg: Configuration, horizon: float, limits: bool, tell: Callable[[float], object]
) -> tuple[float, str, Motion]:
    """Hold the tip: return how long, what ends it, and the motion.

    The path of the tip is one point, its length the share of the horizon that has passed. The
    samples lie closer where the joints move faster.
    """
    tip, attitude = cfg.centred(np.zeros(3)).tip, np.asarray(pin.SE3ToXYZQUAT(cfg.base)[3:])
    settings = Settings(horizon * cfg.momentum[3:], limits, tolerance=1e-9)

    def led(shares: Array) -> Led:
        m = len(shares)
        held = [[Segment(share, lambda _: tip, lambda _: np.zeros(6), True)] for share in shares]
        return lead_all(
            cfg.arm, np.tile(cfg.q, (m, 1)), np.tile(attitude, (m, 1)), table_of(held),
            np.arange(m), settings,
        )  # fmt: skip

    whole = led(np.ones(1))
    lasts, ended = float(whole.s[0]), int(whole.ended[0])
    if lasts <= 1e-9:
        return 0.0, "cannot", _motion(cfg, np.zeros(1), cfg.q[None], attitude[None])
    shares = np.linspace(0.0, lasts, SAMPLES)
    found = led(shares[1:] * (1.0 - 1e-9))
    q, turned = np.vstack((cfg.q, found.q)), np.vstack((attitude, found.attitude))
    while len(shares) < MOST_SAMPLES:
        tell(len(shares) / MOST_SAMPLES)
        travel = np.linalg.norm(np.diff(q, axis=0), axis=1)
        passed = np.append(0.0, np.cumsum(travel + travel.mean() + np.finfo(float).tiny))
        even = np.linspace(0.0, passed[-1], 2 * len(shares) - 1)
        way, shares = CubicSpline(shares, q), np.interp(even, passed, shares)
        found = led(shares[1:] * (1.0 - 1e-9))
        q, turned = np.vstack((cfg.q, found.q)), np.vstack((attitude, found.attitude))
        if np.abs(way(shares) - q).max() < HELD:
            break
    kind = "horizon" if ended == 0 else ENDS[ended]
    return horizon * lasts, kind, _motion(cfg, horizon * shares, q, turned)


def _carry(
    cfg: Configuration, horizon: float, limits: bool, tell: Callable[[float], object]
) -> tuple[float, str, Motion]:
    """Keep the spacecraft at rest: return how long, what ends it, and the motion.

    The joints have the least rates with D_q dq = h. Where D_q loses the direction of h these grow
    beyond all bounds: the steps, whose error is controlled, shrink there, and the motion ends. The
    straight lines between its rows have the momentum too, but for the share `LACKING`.
    """
    from scipy.integrate import DOP853  # slow to import

    arm, h, q = cfg.arm, cfg.momentum[3:], cfg.q
    bounds = np.array((arm.lower, arm.upper)) if limits else np.tile([[-np.inf], [np.inf]], arm.n)
    lower, upper = np.minimum(bounds[0], q), np.maximum(bounds[1], q)

    def carried(q: Array) -> Array:
        """Return D_q (3, n)."""
        return momentum_matrix(arm.at(q, base=cfg.base)).A_q[3:]

    def lacking(D_q: Array, dq: Array) -> float:
        """Return the share of the momentum that joint rates lack."""
        return float(np.linalg.norm(D_q @ dq - h) / np.linalg.norm(h))

    def rate(_: float, q: Array) -> Array:
        """Return the joint rates (n,), NaN where none have the momentum."""
        if np.isfinite(q).all():
            dq = np.linalg.lstsq(D_q := carried(q), h, rcond=1e-9)[0]
            if lacking(D_q, dq) <= CARRIED:
                return dq
        return np.full(arm.n, np.nan)

    def room(q: Array) -> Array:
        """Return how far (1,) the joints are from their limits, negative beyond."""
        return np.minimum(q - lower, upper - q).min(keepdims=True)

    def replays(t: Array, q: Array) -> bool:
        """Whether the straight lines between rows have the momentum."""
        dq = np.diff(q, axis=0) / np.diff(t)[:, None]
        middle = 0.5 * (q[1:] + q[:-1])
        return all(lacking(carried(middle[i]), dq[i]) <= LACKING for i in range(len(dq)))

    times, rows = [np.zeros(1)], [q[None]]
    fastest = float(np.abs(rate(0.0, q)).max())
    if np.isnan(fastest):
        return 0.0, "cannot", _motion(cfg, times[0], rows[0], None)
    first, ended = min(STEP / fastest, horizon), ""
    method: Callable[..., OdeSolver] = DOP853
    solver = method(rate, 0.0, q, horizon, first_step=first, rtol=RTOL, atol=RTOL)
    while not ended:
        tell(solver.t)
        if solver.step():
            ended = "cannot"
            break
        piece, begin, end, before = solver.dense_output(), solver.t_old, solver.t, rows[-1][-1]

        def roomy(t: float, piece: Any = piece) -> Array:
            return room(piece(t))

        fall = first_fall(roomy, room(before), room(solver.y), begin, end)
        if fall:
            end, ended = fall[0], "joint limit"
        elif end == horizon:
            ended = "horizon"
        elif np.abs(solver.y - before).max() < FINEST:
            ended = "cannot"
        if end > begin:
            tried = (np.linspace(begin, end, parts + 1) for parts in PARTS)
            t = next((t for t in tried if replays(t, piece(t).T)), None)
            if t is None:
                ended = "cannot"
            else:
                times.append(t[1:])
                rows.append(piece(t[1:]).T)
    t_, q_ = np.concatenate(times), np.vstack(rows)
    return float(t_[-1]), ended, _motion(cfg, t_, q_, None)


def _motion(cfg: Configuration, t: Array, q: Array, attitude: Array | None) -> Motion:
    """Return a motion with the system CM where it is; the attitude that of cfg if None."""
    poses = []
    for i, row in enumerate(q):
        R = cfg.base.rotation if attitude is None else pin.Quaternion(attitude[i]).matrix()
        there = cfg.arm.at(row, base=pin.SE3(R, np.zeros(3))).centred(cfg.com)
        poses.append(pin.SE3ToXYZQUAT(there.base))
    mode: BaseMode = "free-floating" if attitude is not None else "attitude-controlled"
    return Motion(cfg.arm, t, q, np.array(poses), mode=mode)
