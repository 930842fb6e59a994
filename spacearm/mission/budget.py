"""Momentum on board: what it does to a posture, and how long the arm can make up for it.

Without external torques the angular momentum h stays, whatever the joints do. With the joints
locked the system turns as one body, w = D^-1 h, and the tip drifts. The tip stays where it is while
the joints move at dq = -J*^+ J_b A_b^-1 h, as long as J* and the joint limits allow; compare Nanos
& Papadopoulos, On the dynamics and control of free-floating space manipulator systems in the
presence of angular momentum, Front. Robot. AI 4:26 (2017), DOI 10.3389/frobt.2017.00026. The
spacecraft stays at rest while the arm carries all of it, D_q dq = h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, positive
from spacearm.errors import ConfigurationError
from spacearm.mechanics.jacobian import base_velocity, momentum_matrix, prescribed_motion
from spacearm.mission.attitudes import turning_axis
from spacearm.model.arguments import BaseMode, of_configuration
from spacearm.model.arm import Configuration, still_wheels
from spacearm.motion.following import Segment
from spacearm.motion.goal import goal_rows
from spacearm.motion.leading import ENDS, Led, Settings, lead_all, table_of
from spacearm.motion.motion import Motion
from spacearm.results import Cell, Description, Measure, Result, Table, joint_measures

HORIZON = 3600.0
"""Default longest time looked at [s]."""
SAMPLES = 101
"""Samples of the motions."""
CARRIED = 1e-9
"""Share of the momentum that the arm may leave to the spacecraft."""
STEP = 0.05
"""Largest joint motion of a step while the arm carries the momentum [rad] or [m]."""


@dataclass(frozen=True, eq=False, repr=False)
class MomentumBudget(Result):
    """What momentum on board does to a posture, and how long the arm can make up for it.

    Attributes:
        configuration: The posture, the pose of the spacecraft and the momentum.
        spin: (3,) angular velocity of the whole system with its joints locked, inertial axes
            [rad/s].
        drift: (6,) twist of the tip then [m/s], [rad/s], inertial axes.
        rates: (n,) joint rates that hold the tip in the task's rows at first [rad/s] or [m/s].
        holds: How long these hold the tip [s]; at most `horizon`.
        ended: What ends it: "horizon", "singularity", "joint limit" or "cannot" where J* lacks the
            direction of the drift at once.
        holding: The motion that holds the tip; of one sample where it cannot.
        carries: How long the arm can carry all of the momentum, the spacecraft at rest [s].
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
            else f"the arm holds the tip for {self.holds:.4g} s ({self.ended})"
        )
        rest = (
            "it cannot bring the spacecraft to rest"
            if self.carrying_ended == "cannot" and self.carries == 0.0
            else f"it keeps the spacecraft at rest for {self.carries:.4g} s ({self.carrying_ended})"
        )
        return (
            f"Joints locked, all turns at {turn:.4g}°/s; {still}, {rest}. No motion of the arm "
            "takes the momentum away: that takes thrusters, or wheels with this momentum."
        )

    def describe(self) -> Description:
        """Describe what the momentum does, and how long the arm can make up for it."""
        arm = self.configuration.arm
        rates = joint_measures(self.rates, arm.slides, per="/s")
        facts: dict[str, Cell] = {
            "spin, joints locked": Measure(self.spin, "rad/s"),
            "drift of the tip": Measure(self.drift[:3], "m/s"),
            "turn of the tip": Measure(self.drift[3:], "rad/s"),
            **{
                f"{name} to hold the tip": x for name, x in zip(arm.joint_names, rates, strict=True)
            },
            "tip held for": Measure(self.holds, "s"),
            "tip held until": self.ended,
            "spacecraft at rest for": Measure(self.carries, "s"),
            "spacecraft at rest until": self.carrying_ended,
        }
        return Description(title=arm.name, verdict=self.verdict, tables=[Table.facts(facts)])


@of_configuration
def momentum_budget(
    cfg: Configuration, *, horizon: float = HORIZON, limits: bool = True
) -> MomentumBudget:
    """Compute what momentum on board does to a posture, and how long the arm can make up for it.

    Detumbling by the arm alone does not exist: joint torques are internal, and the angular momentum
    stays. The arm can hold its tip, or keep the spacecraft at rest, for a while.

    Args:
        cfg: The posture and the momentum, which must be angular: linear momentum moves everything
            alike. The wheels must be still.
        horizon: The longest time looked at [s].
        limits: Whether joint limits count.

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
    holds, ended, holding = _hold(cfg, horizon, limits)
    carries, why, carrying = _carry(cfg, horizon, limits)
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


def _hold(cfg: Configuration, horizon: float, limits: bool) -> tuple[float, str, Motion]:
    """Hold the tip: return how long, what ends it, and the motion.

    The path of the tip is one point, its length the share of the horizon that has passed.
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
    kind = "horizon" if ended == 0 else ENDS[ended]
    return horizon * lasts, kind, _motion(cfg, horizon * shares, q, turned)


def _carry(cfg: Configuration, horizon: float, limits: bool) -> tuple[float, str, Motion]:
    """Keep the spacecraft at rest: return how long, what ends it, and the motion.

    The joints have the least rates with D_q dq = h, by the classical Runge-Kutta method.
    """
    arm, h, q, t = cfg.arm, cfg.momentum[3:], cfg.q, 0.0
    rows, times = [q], [t]

    def rate(q: Array) -> Array:
        """Return the joint rates (n,), NaN where none have the momentum."""
        if np.isnan(q).any():
            return q
        D_q = momentum_matrix(arm.at(q, base=cfg.base)).A_q[3:]
        dq = np.linalg.lstsq(D_q, h, rcond=1e-9)[0]
        carried = np.linalg.norm(D_q @ dq - h) <= CARRIED * np.linalg.norm(h)
        return dq if carried else np.full(arm.n, np.nan)

    ended = "horizon"
    while t < horizon and ended == "horizon":
        k1 = rate(q)
        step = min(STEP / float(np.abs(k1).max()), horizon - t)
        k2 = rate(q + 0.5 * step * k1)
        k3 = rate(q + 0.5 * step * k2)
        dq = (k1 + 2.0 * k2 + 2.0 * k3 + rate(q + step * k3)) / 6.0
        if np.isnan(dq).any():
            ended = "cannot"
            break
        if limits:
            with np.errstate(divide="ignore"):
                room = np.where(dq > 0.0, arm.upper - q, q - arm.lower) / np.abs(dq)
            if float(np.nanmin(room)) < step:
                step, ended = max(float(np.nanmin(room)), 0.0), "joint limit"
        q, t = q + step * dq, t + step
        rows.append(q)
        times.append(t)
    t_, keep = np.unique(times, return_index=True)
    return t, ended, _motion(cfg, t_, np.array(rows)[keep], None)


def _motion(cfg: Configuration, t: Array, q: Array, attitude: Array | None) -> Motion:
    """Return a motion with the system CM where it is; the attitude that of cfg if None."""
    poses = []
    for i, row in enumerate(q):
        R = cfg.base.rotation if attitude is None else pin.Quaternion(attitude[i]).matrix()
        there = cfg.arm.at(row, base=pin.SE3(R, np.zeros(3))).centred(cfg.com)
        poses.append(pin.SE3ToXYZQUAT(there.base))
    mode: BaseMode = "free-floating" if attitude is not None else "attitude-controlled"
    return Motion(cfg.arm, t, q, np.array(poses), mode=mode)
