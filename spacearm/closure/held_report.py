"""Report of a closed chain: what the hands can no longer do to what they hold, and the way out.

Target and hands at rest have no momentum whatever the target weighs, so that the chain is singular
exactly where the stacked J* of the free hands loses rank. Distances along closure follow from the
same derivatives as those of free hands, taken along the joint motions that keep the grasps closed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, Progress
from spacearm.closure.closed_motions import ClosedMotions, closed_motions
from spacearm.closure.closing import Closure, placed
from spacearm.errors import ConfigurationError
from spacearm.mechanics.distance import Linearisation, RankDistances, project, rank_distances
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.mechanics.target import Target
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration
from spacearm.model.joints import joint_scales
from spacearm.results import (
    Cell,
    Column,
    Description,
    Measure,
    Result,
    Table,
    joint_measures,
    without_noise,
)
from spacearm.singularities.nearest import angle, nearness
from spacearm.singularities.report import FAR, singularity
from spacearm.singularities.rounding import error_bars

HeldKind = Literal["regular", "closure", "kinematic", "dynamic"]

SQUEEZE = 1e-2
"""What a unit of wrench, lost by the hands, does to the target at most if it squeezes it only."""
STEPS, STRIDE = 60, 0.3
"""Steps to the nearest singular posture at most, and the longest [rad]."""
THERE, SETTLED = 1e-8, 1e-6
"""Distance from the set at which a posture is singular, and the last step [rad]."""


class HeldReport(Result):
    """What the hands can do to what they hold, from `Held.report`.

    Directions are given in the task's rows as in `SingularityReport`: those of the twist of the
    target's frame, or of the spacecraft's where the fixed world is held.

    Attributes:
        configuration: The configuration.
        target: The target, where it is held; None for the fixed world.
        mode: What the spacecraft does; "fixed" where the fixed world is held, since momentum does
            not count then.
        kind: "regular"; "closure" if the grasps lose rank, so that a squeeze needs no torque;
            else "kinematic" if it is singular with the spacecraft fixed too; else "dynamic".
        distance: How far the nearest singular posture along closure is [rad]: with `nearest` that
            of the one found, so that none that is nearest of all is farther; else to first order,
            an estimate. inf where no small motion along closure reaches one.
        distance_proven: No singular posture is nearer than this [rad], proven, closed or not; zero
            where nothing is proven, as without `exact`.
        away: (n,) joint motion [rad] or [m] along closure, per radian, that leads away from it.
        nearest: (n,) the nearest singular posture found along closure, if `exact` asked for it and
            one was found; else None.
        mobility: Number of directions in which what is held can move at postures nearby.
        sigma: (min(k, p),) singular values of its map: its twist by unit joint motions [rad] that
            keep the grasps closed, of which p are independent; they depend on the target's mass.
        manipulability: The product of the first `mobility` of them.
        available: (k, a) orthonormal directions in which it can move.
        lost: (k, k - a) orthonormal directions in which it cannot.
        internal: (n, m) joint motions that keep the grasps closed and what is held at rest.
        tolerance: Distance up to which a posture is singular [rad].
    """

    configuration: Configuration
    target: Target | None
    mode: BaseMode
    kind: HeldKind
    distance: float
    distance_proven: float
    away: Array
    nearest: Array | None
    mobility: int
    sigma: Array
    manipulability: float
    available: Array
    lost: Array
    internal: Array
    tolerance: float

    @property
    def verdict(self) -> str:
        """The answer in one sentence."""
        kind = self.kind if self.kind == "regular" else f"{self.kind} singularity"
        if not self.mobility:
            return f"{kind}: the chain is rigid, and what is held cannot move"
        if self.nearest is not None:
            return f"{kind}, along closure: {nearness(self.distance, self.distance_proven)}"
        if self.distance > FAR:
            return f"{kind}: no singular posture is near along closure, to first order"
        far = angle(self.distance)
        return f"{kind}: a singular posture about {far} away along closure, to first order"

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data, with the verdict."""
        return {**super().to_dict(), "verdict": self.verdict}

    not_checked = "collisions, and forces of the grasps"

    def describe(self) -> Description:
        """Describe verdict, directions of what is held, and joint motions."""
        arm, what = self.configuration.arm, _moved(self.target)
        columns: dict[Column | str, Any] = {
            "joint": arm.joint_names, "q": joint_measures(self.configuration.q, arm.slides)
        }  # fmt: skip
        if self.nearest is not None:
            columns["nearest singular"] = joint_measures(self.nearest, arm.slides)
        motions = {"away": self.away} if self.away.any() else {}
        motions |= {f"internal {i}": m for i, m in enumerate(self.internal.T, 1)}
        columns |= {name: without_noise(motion) for name, motion in motions.items()}
        moved = self.target.pose if self.target else self.configuration.base
        facts: dict[str, Cell] = {
            f"place of {what}": Measure(moved.translation, "m"),
            "roll, pitch, yaw": Measure(pin.rpy.matrixToRpy(moved.rotation), "rad"),
            f"directions of {what}": f"{self.available.shape[1]} of {len(self.lost)}",
            "manipulability": Measure(self.manipulability, "", ".6g"),
        }
        if self.distance_proven:
            facts["singular posture, closed or not, proven"] = (
                f"none nearer than {angle(self.distance_proven, down=True)}"
            )
        sigma = np.pad(self.sigma, (0, len(self.lost) - len(self.sigma)))
        directions = np.hstack((self.available, self.lost)).T
        moves = self.available.shape[1]
        rows = [
            ("available" if i < moves else "lost", sigma[i], *without_noise(direction))
            for i, direction in enumerate(directions)
        ]
        lost = f"; {what} cannot move in {len(self.lost) - moves} of {len(self.lost)} directions"
        return Description(
            title=f"{arm.name} holding {self.target.name if self.target else 'the fixed world'}, "
            f"{self.mode}",
            verdict=self.verdict + lost * (moves < len(self.lost)),
            tone="good" if self.kind == "regular" else "bad",
            notes=[
                "Where it is singular does not depend on what the target weighs; sigma and "
                "manipulability do."
            ]
            * (self.target is not None),
            tables=[
                Table.facts(facts),
                Table(
                    ["", Column("sigma", "", ".4g"), *arm.task.rows], rows, f"Directions of {what}"
                ),
                Table.by_columns(columns, "Posture; joint motions that keep the grasps closed"),
            ],
        )


def held_report(
    cfg: Configuration,
    target: Target | None,
    grasps: Mapping[str, pin.SE3],
    mode: BaseMode,
    tolerance: float,
    exact: bool,
    progress: Progress | None,
) -> HeldReport:
    """Report what the tips can do to what they hold; arguments as of `Held.report`.

    Raises:
        ConfigurationError: `mode` or `tolerance` is not valid.
    """
    if not 0.0 <= tolerance <= np.pi:
        raise ConfigurationError(f"tolerance is {tolerance}; give an angle from 0 to pi [rad]")
    closed = closed_motions(cfg, target, mode)
    mode = "fixed" if target is None else mode
    arm, unit, Z, T = cfg.arm, joint_scales(cfg.arm), closed.motions, closed.held
    near = closed_distances(cfg, closed, mode)
    deficit = int(np.count_nonzero(near.distances <= tolerance))
    U, sigma, VT = np.linalg.svd(T)
    kind: HeldKind = "regular"
    if deficit:
        u = np.linalg.svd(task_jacobian(cfg, mode=mode) * unit)[0][:, : min(arm.task.k, arm.n)]
        squeezes = np.linalg.norm(u[:, -deficit:].T @ closed.grasps, axis=1) < SQUEEZE
        fixed = closed_distances(cfg, closed, "fixed").distances <= tolerance
        kind = "closure" if squeezes.all() else "kinematic" if fixed.any() else "dynamic"
    mobility = min(T.shape)
    moves = mobility - (deficit if kind in ("kinematic", "dynamic") else 0)
    distance, away = float(near.distances[-1]), unit * (Z @ near.rows[0])
    hands, nearest = None, None
    if exact:
        hands = singularity(cfg, mode=mode, exact=True, progress=progress)
        nearest = nearest_closed(
            cfg, target, Closure(arm, tuple(grasps.values()), False, False), mode
        )
    if nearest is not None:
        distance = float(np.linalg.norm((nearest - cfg.q) / unit))
        away = (cfg.q - nearest) / distance if distance > tolerance else away
    return HeldReport(
        configuration=cfg,
        target=target,
        mode=mode,
        kind=kind,
        distance=distance,
        distance_proven=hands.distance_proven if hands else 0.0,
        away=away,
        nearest=nearest,
        mobility=mobility,
        sigma=sigma,
        manipulability=float(np.prod(sigma)),
        available=U[:, :moves],
        lost=U[:, moves:],
        internal=unit[:, None] * (Z @ VT[moves:].T),
        tolerance=tolerance,
    )


def closed_distances(cfg: Configuration, closed: ClosedMotions, mode: BaseMode) -> RankDistances:
    """Compute how far along closure the stacked J* of the hands loses rank, to first order.

    Of arms with fewer joints than rows it is the joint motions that become dependent.
    """
    unit, Z = joint_scales(cfg.arm), closed.motions
    J = task_jacobian(cfg, mode=mode) * unit
    dJ = task_jacobian_derivative(cfg, mode=mode) * unit * unit[:, None, None]
    along = np.tensordot(Z.T, dJ, axes=1)
    if J.shape[0] > J.shape[1]:
        J, along = J.T, along.swapaxes(1, 2)
    if not Z.shape[1]:  # rigid
        return RankDistances(np.full(len(J), np.inf), 0.0, np.zeros((1, 0)))
    return rank_distances(J, along, error_bars(cfg, mode=mode).sigma * float(unit.max()))


def nearest_closed(
    cfg: Configuration, target: Target | None, closure: Closure, mode: BaseMode
) -> Array | None:
    """Return the singular posture (n,) found nearest to a closed one along closure, if any.

    The steps lead to the point nearest to the start on the set as it is linearised along closure,
    as in `mechanics.distance`; closure follows after each.
    """
    unit, start, step = joint_scales(cfg.arm), cfg.q, np.inf
    for _ in range(STEPS):
        closed = closed_motions(cfg, target, mode)
        near = closed_distances(cfg, closed, mode)
        if not np.isfinite(near.distances[-1]):
            return None
        if near.distances[-1] <= THERE and step <= SETTLED:
            return cfg.q
        seen = Linearisation(near.distances[-1:], np.array([near.sigma]), near.rows[None])
        offset = closed.motions.T @ ((cfg.q - start) / unit)
        way = project(seen, offset[None])[0] - offset
        step = float(np.linalg.norm(way))
        q = cfg.q + unit * (closed.motions @ way) * min(1.0, STRIDE / step)
        frame = cfg.base.actInv(target.pose if target else pin.SE3.Identity())
        cfg, target = placed(cfg, target, *closure.solved(q, frame))
    return None


def _moved(target: Target | None) -> str:
    return target.name if target else "the spacecraft"
