"""Report of a closed chain: what the hands can no longer do, the way out, and maps of that.

Target and hands at rest have no momentum whatever the target weighs, so that the chain is singular
exactly where the stacked J* of the free hands loses rank. Distances along closure follow from the
same derivatives as those of free hands, taken along the joint motions that keep the grasps closed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from spacearm import results
from spacearm.arrays import Array, Progress, counted, within
from spacearm.closure.closed_distances import OPEN, ClosedSearch, closed_distances
from spacearm.closure.closing import Closure, closed_motions, named, placed
from spacearm.description.loops import balls
from spacearm.errors import ConfigurationError, listed, require_known
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.mechanics.target import Target
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration
from spacearm.model.frames import pose_facts
from spacearm.model.joints import joint_scales
from spacearm.singularities.nearest import angle, nearness
from spacearm.singularities.report import FAR, Kind, singularity, to_first_order

#: What a unit of wrench, lost by the hands, does to the target at most if it squeezes it only.
SQUEEZE = 1e-2
#: How far hinges lock that are what is near, as shares of the distance: least, and most.
LOCKING = (0.1, 1.1)
#: Most points along each direction.
MOST_POINTS = 401


class HeldReport(results.Result):
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
        distance: How far the nearest singular posture along closure is [rad]. If `nearest` is
            there, it is the distance of that one, an upper bound found by search. Else it is a
            first-order estimate, which may be several times too long or somewhat too short; inf
            where no small motion along closure reaches a singular posture.
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
    kind: Kind
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
            near = nearness(self.distance, self.distance_proven)
            return f"{kind}, along closure: {near}{self._locking}"
        if self.distance > FAR:
            return f"{kind}, along closure: {to_first_order(self.distance)}"
        far = f"about {angle(self.distance)} away along closure, first-order estimate"
        return f"{kind}: a singular posture {far}{self._locking}"

    @property
    def _locking(self) -> str:
        """Which hinges lock no farther away, and that the ball joint that they stand for does not.

        The angles of three hinges in a row lock where the one in the middle is at 90 degrees.
        """
        cfg = self.configuration
        for hinges in balls(cfg.arm.whole):
            if hinges[1] in cfg.arm.joint_names:
                middle = float(cfg.q[cfg.arm.joint_names.index(hinges[1])])
                room = abs(np.arccos(np.clip(abs(np.sin(middle)), 0.0, 1.0)))
                least, most = (share * self.distance for share in LOCKING)
                if least <= max(room, self.tolerance) and room <= max(most, self.tolerance):
                    return (
                        f"; {listed(hinges)} stand for a ball joint and lock {angle(room)} away, "
                        "where the ball joint itself is not singular"
                    )
        return ""

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain data, with the verdict."""
        return {**super().to_dict(), "verdict": self.verdict}

    not_checked = "collisions, and forces of the grasps"

    def describe(self) -> results.Description:
        """Describe verdict, directions of what is held, and joint motions."""
        arm, what = self.configuration.arm, _moved(self.target)
        columns: dict[results.Column | str, Any] = {
            "joint": arm.joint_names, "q": results.joint_measures(self.configuration.q, arm.slides)
        }  # fmt: skip
        if self.nearest is not None:
            columns["nearest singular"] = results.joint_measures(self.nearest, arm.slides)
        motions = {"away": self.away} if self.away.any() else {}
        motions |= {f"internal {i}": m for i, m in enumerate(self.internal.T, 1)}
        columns |= {name: results.without_noise(motion) for name, motion in motions.items()}
        moved = self.target.pose if self.target else self.configuration.base
        facts: dict[str, results.Cell] = {
            **pose_facts(moved, f"place of {what}"),
            f"directions of {what}": f"{self.available.shape[1]} of {len(self.lost)}",
            "manipulability": results.Measure(self.manipulability, "", ".6g"),
        }
        if self.distance_proven:
            facts["singular posture, closed or not, proven"] = (
                f"none nearer than {angle(self.distance_proven, down=True)}"
            )
        sigma = np.pad(self.sigma, (0, len(self.lost) - len(self.sigma)))
        directions = np.hstack((self.available, self.lost)).T
        moves = self.available.shape[1]
        rows = [
            ("available" if i < moves else "lost", sigma[i], *results.without_noise(direction))
            for i, direction in enumerate(directions)
        ]
        lost = f"; {what} cannot move in {len(self.lost) - moves} of {len(self.lost)} directions"
        return results.Description(
            title=f"{arm.name} holding {named(self.target)}, {self.mode}",
            verdict=self.verdict + lost * (moves < len(self.lost)),
            tone="good" if self.kind == "regular" else "bad",
            notes=[
                "Where it is singular does not depend on what the target weighs; sigma and "
                "manipulability do."
            ]
            * (self.target is not None),
            tables=[
                results.Table.facts(facts),
                results.Table(
                    ["", results.Column("sigma", "", ".4g"), *arm.task.rows],
                    rows,
                    f"Directions of {what}",
                ),
                results.Table.by_columns(
                    columns, "Posture; joint motions that keep the grasps closed"
                ),
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
    tolerance = within(tolerance, "tolerance", 0.0, np.pi, "an angle [rad]")
    closed = closed_motions(cfg, target, mode)
    mode = "fixed" if target is None else mode
    arm, unit, Z, T = cfg.arm, joint_scales(cfg.arm), closed.motions, closed.held
    near = closed_distances(cfg, closed, mode)
    deficit = int(np.count_nonzero(near.distances <= tolerance))
    U, sigma, VT = np.linalg.svd(T)
    kind: Kind = "regular"
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
        search = ClosedSearch(Closure(arm, tuple(grasps.values()), False, False), mode)
        search.look(cfg, target)
        nearest = search.nearest(cfg.q)
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


def _moved(target: Target | None) -> str:
    return target.name if target else "the spacecraft"


class ClosedMap(results.Result):
    """Distances to singular postures over two directions of what is held, from `Held.map`.

    Attributes:
        configuration: The configuration in the middle.
        target: What is held, at its pose in the middle; None for the fixed world, where the
            spacecraft moves instead.
        mode: What the spacecraft does.
        axes: The two directions, rows of the task.
        moves: (2, N) how far it is moved along, or turned about, each [m] or [rad].
        distance: (N, N) first-order estimate of how far the nearest singular posture along closure
            is [rad], by moves along the first and the second; NaN where nothing closed was reached.
            Errors as of `HeldReport.distance`.
        sigma_min: (N, N) the least singular value of its map, of `HeldReport.sigma`; NaN there too.
        q: (N, N, n) joint positions [rad] or [m].
    """

    configuration: Configuration
    target: Target | None
    mode: BaseMode
    axes: tuple[str, str]
    moves: Array
    distance: Array
    sigma_min: Array
    q: Array

    not_checked = "collisions, and postures to which what is held does not lead along this grid"

    def describe(self) -> results.Description:
        """Describe how much of the grid is closed, and the least distance on it."""
        arm = self.configuration.arm
        there = np.isfinite(self.sigma_min)
        least = float(np.min(self.distance, initial=np.inf, where=there))
        facts = {
            f"moved along {axis}": results.Measure(moves[[0, -1]], "m" if len(axis) == 1 else "rad")
            for axis, moves in zip(self.axes, self.moves, strict=True)
        }
        facts["least distance, first-order estimate"] = results.Measure(least, "rad")
        return results.Description(
            title=f"{arm.name} holding {named(self.target)}, {self.mode}: over "
            f"{' and '.join(self.axes)}",
            verdict=f"{100.0 * there.mean():.3g} % of the grid closes",
            tables=[results.Table.facts(facts)],
        )


def closed_map(
    cfg: Configuration,
    target: Target | None,
    closure: Closure,
    axes: tuple[str, str],
    span: tuple[float, float],
    points: int,
    mode: BaseMode,
    progress: Progress | None,
) -> ClosedMap:
    """Map a closed chain; arguments as of `Held.map`.

    Each posture is closed from a neighbour, from the middle on.

    Raises:
        ConfigurationError: An axis is not a row of the task, or span or points is not valid.
    """
    task, mode = cfg.arm.task, "fixed" if target is None else mode
    require_known("row", axes, task.rows, "axes: ")
    if axes[0] == axes[1] or min(span) <= 0.0 or not np.isfinite(span).all():
        raise ConfigurationError(
            f"axes are {axes} and span {span}; give two rows, and how far to move along each"
        )
    if points % 2 == 0 or not 3 <= points <= MOST_POINTS:
        raise ConfigurationError(f"points is {points}; give an odd number, 3 to {MOST_POINTS}")
    rows = replace(task, tips=1).jacobian(np.eye(6), cfg.base.rotation)
    ways = [rows[task.rows.index(axis)] / np.linalg.norm(rows[task.rows.index(axis)])
            for axis in axes]  # fmt: skip
    moves = np.outer(span, np.linspace(-1.0, 1.0, points))
    home, middle = target.pose if target else cfg.base, points // 2
    distance, sigma = np.full((2, points, points), np.nan)
    Q = np.full((points, points, cfg.arm.n), np.nan)
    for i, j, k, l in counted([*_outwards(points)], progress):
        start = cfg.q if (i, j) == (middle, middle) else Q[k, l]
        if np.isfinite(start).all():
            by = moves[0, i] * ways[0] + moves[1, j] * ways[1]
            pose = pin.SE3(pin.exp3(by[3:]) @ home.rotation, home.translation + by[:3])
            X = cfg.base.actInv(pose) if target else pose.inverse()
            q, _ = closure.solved(start, X)
            if max(closure.gaps(q, X)) <= OPEN:
                there, held = placed(cfg, target, q, X)
                closed = closed_motions(there, held, mode)
                distance[i, j] = closed_distances(there, closed, mode).distances[-1]
                sigma[i, j] = np.linalg.svd(closed.held, compute_uv=False)[-1]
                Q[i, j] = q
    return ClosedMap(cfg, target, mode, axes, moves, distance, sigma, Q)


def _outwards(points: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield the indices of a grid, and those of a neighbour that came before; the middle first."""
    middle = points // 2
    order = sorted(range(points), key=lambda i: abs(i - middle))
    for i in order:
        for j in order:
            inner = int(np.sign(middle - j))
            k = i if inner else i + int(np.sign(middle - i))
            yield i, j, k, j + inner
