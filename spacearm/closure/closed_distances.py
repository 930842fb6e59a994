"""Distances to singular postures along closure: first-order estimates, and searches.

The postures in which all grasps are closed are a surface in joint space, and the singular ones
among them do not depend on where spacecraft and target are. The distance along closure is the
joint-space distance (Euclidean norm) to the nearest of them. A search finds an upper bound.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.closure.closing import ClosedMotions, Closure, closed_motions, placed
from spacearm.mechanics.distance import Linearisation, RankDistances, project, rank_distances
from spacearm.mechanics.jacobian import task_jacobian, task_jacobian_derivative
from spacearm.mechanics.target import Target
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import Configuration, kinematics
from spacearm.model.joints import joint_scales
from spacearm.singularities.rounding import error_bars

#: Steps to the nearest singular posture at most, and the longest [rad].
STEPS, STRIDE = 60, 0.3
#: Distance from the set at which a posture is singular, and the last step [rad].
THERE, SETTLED = 1e-8, 1e-6
#: By what the share of a step along the set is changed after a longer step, and after a shorter.
SLOWER, FASTER = 0.5, 1.3
#: What may be left open of a closed posture.
OPEN = 1e-9
#: Random postures from which a search begins besides the posture itself.
TRIES = 12
#: How far they are, as shares of the distance known; the longest [rad].
SHARES, FAR = (0.2, 1.0), 1.0
#: How many times the distance along closure the first-order estimate may be.
TOO_LONG = 10.0


def closed_distances(
    cfg: Configuration, closed: ClosedMotions, mode: BaseMode, ranks: int | None = None
) -> RankDistances:
    """Estimate to first order how far along closure the stacked J* of the hands loses rank.

    Of arms with fewer joints than rows it is the joint motions that become dependent.

    Args:
        cfg: The configuration of the free hands.
        closed: The joint motions that keep the grasps closed.
        mode: What the spacecraft does.
        ranks: As of `rank_distances`.
    """
    unit, Z = joint_scales(cfg.arm), closed.motions
    J = task_jacobian(cfg, mode=mode) * unit
    dJ = task_jacobian_derivative(cfg, mode=mode) * unit * unit[:, None, None]
    along = np.tensordot(Z.T, dJ, axes=1)
    if J.shape[0] > J.shape[1]:
        J, along = J.T, along.swapaxes(1, 2)
    if not Z.shape[1]:  # rigid
        return RankDistances(np.full(len(J), np.inf), 0.0, np.zeros((1, 0)))
    floor = error_bars(cfg, mode=mode).sigma * float(unit.max())
    return rank_distances(J, along, floor, ranks=ranks)


def nearest_closed(
    cfg: Configuration,
    target: Target | None,
    closure: Closure,
    mode: BaseMode,
    begin: Array | None = None,
) -> Array | None:
    """Return the singular posture (n,) along closure to which a descent leads, if it does.

    The steps lead to the point nearest to the configuration on the set as it is linearised along
    closure, as in `mechanics.distance`; closure follows after each. Steps that grow, as where the
    set is bent more than the sphere about the configuration, are shortened along the set.

    Args:
        cfg: The configuration of the free hands, closed.
        target: The target, where it is; None for the fixed world.
        closure: The equations of closure.
        mode: What the spacecraft does.
        begin: (n,) where the descent begins; at the configuration if None.
    """
    unit, start, step, share = joint_scales(cfg.arm), cfg.q, np.inf, 1.0
    if begin is not None:
        cfg, target = _closed_at(cfg, target, closure, begin)
    for _ in range(STEPS):
        closed = closed_motions(cfg, target, mode)
        near = closed_distances(cfg, closed, mode, ranks=1)
        if not np.isfinite(near.distances[-1]):
            return None
        if near.distances[-1] <= THERE and step <= SETTLED:
            frame = _frame(cfg, closure, cfg.q)
            return cfg.q if max(closure.gaps(cfg.q, frame)) <= OPEN else None
        seen = Linearisation(near.distances[-1:], np.array([near.sigma]), near.rows[None])
        offset = closed.motions.T @ ((cfg.q - start) / unit)
        way = project(seen, offset[None])[0] - offset
        before, step = step, float(np.linalg.norm(way))
        share = share * SLOWER if step > before else min(1.0, share * FASTER)
        to_set = near.rows[0] * (near.rows[0] @ way)
        way = to_set + share * (way - to_set)
        way *= min(1.0, STRIDE / (float(np.linalg.norm(way)) or 1.0))
        cfg, target = _closed_at(cfg, target, closure, cfg.q + unit * (closed.motions @ way))
    return None


def _closed_at(
    cfg: Configuration, target: Target | None, closure: Closure, q: Array
) -> tuple[Configuration, Target | None]:
    """Return the closed configuration next to joint positions (n,), and what is held there."""
    return placed(cfg, target, *closure.solved(q, _frame(cfg, closure, q)))


def _frame(cfg: Configuration, closure: Closure, q: Array) -> pin.SE3:
    """Return what the first tip holds in the spacecraft's frame, at joint positions (n,)."""
    hands = kinematics(cfg.arm, q.copy(), pin.SE3.Identity())
    return hands.tips[0] * closure.grasps[0].inverse()


class ClosedSearch:
    """Search for the singular postures nearest to closed ones.

    What was found for one posture serves all postures of the chain.

    Attributes:
        found: (n,) each, the singular postures found.

    Args:
        closure: The equations of closure.
        mode: What the spacecraft does.
    """

    def __init__(self, closure: Closure, mode: BaseMode) -> None:
        self._closure, self._mode = closure, mode
        self._unit = joint_scales(closure.arm)
        self._rng = np.random.default_rng(0)
        self.found: list[Array] = []

    def distance(self, q: Array) -> float:
        """Return how far the nearest singular posture found is from joints (n,) [rad], or inf."""
        if not self.found:
            return np.inf
        ways = (np.array(self.found) - q) / self._unit
        return float(np.linalg.norm(ways, axis=1).min())

    def nearest(self, q: Array) -> Array | None:
        """Return the singular posture (n,) found nearest to joints (n,), if there is one."""
        if not self.found:
            return None
        ways = (np.array(self.found) - q) / self._unit
        return self.found[int(np.linalg.norm(ways, axis=1).argmin())]

    def look(self, cfg: Configuration, target: Target | None, tries: int = TRIES) -> float:
        """Search from a posture on; return how far the nearest found is [rad], or inf.

        Descents begin at the nearest one known, at the posture itself, and at random closed
        postures.

        Args:
            cfg: The configuration of the free hands, closed.
            target: The target, where it is; None for the fixed world.
            tries: Number of random postures.
        """
        begins = [self.nearest(cfg.q)]
        if begins[0] is not None:
            begins.append(None)
        for begin in begins:
            self._descend(cfg, target, begin)
        motions = closed_motions(cfg, target, self._mode).motions
        for _ in range(tries if motions.shape[1] else 0):
            way = motions @ self._rng.normal(size=motions.shape[1])
            way *= self._rng.uniform(*SHARES) / float(np.linalg.norm(way))
            at = cfg.q + min(FAR, self.distance(cfg.q)) * self._unit * way
            self._descend(cfg, target, at)
        return self.distance(cfg.q)

    def _descend(self, cfg: Configuration, target: Target | None, begin: Array | None) -> None:
        found = nearest_closed(cfg, target, self._closure, self._mode, begin)
        if found is not None:
            self.found.append(found)

    def least(self, cfg: Configuration, target: Target | None, within: float) -> float:
        """Return a distance [rad]: the smaller of first-order estimate and nearest one found.

        Searched where the first-order estimate is up to `TOO_LONG` times `within`; elsewhere it is
        the estimate.

        Args:
            cfg: The configuration of the free hands, closed.
            target: The target, where it is; None for the fixed world.
            within: Distance that matters [rad].
        """
        known = self.distance(cfg.q)
        if known < within:
            return known
        closed = closed_motions(cfg, target, self._mode)
        estimate = float(closed_distances(cfg, closed, self._mode, ranks=1).distances[-1])
        if estimate <= TOO_LONG * within:
            known = self.look(cfg, target, tries=0)
        return min(estimate, known)
