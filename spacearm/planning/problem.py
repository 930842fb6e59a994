"""Problem: what is to be planned, and whether it can be done at all."""

from __future__ import annotations

import time
from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, NoSolutionError
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.model.frames import sound_pose
from spacearm.model.joints import joint_vector
from spacearm.motion.following import follow
from spacearm.motion.goal import Goal, as_goal, goal_pose, out_of_reach
from spacearm.planning.collisions import Collisions, Contact, collision_geometry
from spacearm.planning.guesses import Search
from spacearm.planning.many_curves import turning_axes
from spacearm.planning.optimiser import ARRIVED, Task
from spacearm.planning.result import Joints, certified
from spacearm.singularities.report import NO_INVERSE, singular_values, singularity

Motion = list[Configuration]

WAVES = 3
"""Number of sines of curves and loops."""
SHARE = 0.002
"""The clearance where none is asked for, as a share of the median sigma_min in joint space; no more
than half of what the start has."""
AMPLE = 0.2
"""The clearance that is aimed at first, likewise."""
PROBES = 200


@dataclass
class Problem:
    """What is to be planned.

    Attributes:
        start: Where the motion begins.
        task: What it must achieve.
        ample: Clearance that is aimed at first.
        seed: Of the first guesses.
        deadline: `time.monotonic` at which the search is given up.
        collisions: The bodies that must not meet; None if that does not matter.
        best: The last attempt that is no solution.
        note: What a method found out besides.
    """

    start: Configuration
    task: Task
    ample: float
    seed: int
    deadline: float
    collisions: Collisions | None
    best: Motion | None = None
    note: str = ""

    def checked(self, motion: Motion) -> Motion:
        """A motion that arrives, if it keeps clearance and limits.

        Raises:
            NoSolutionError: It does not.
        """
        sigma = [singular_values(cfg)[-1] for cfg in motion]
        worst = int(np.argmin(sigma))
        if sigma[worst] < self.task.clearance:
            raise NoSolutionError(
                f"sigma_min falls to {sigma[worst]:.2g} at q = {_numbers(motion[worst].q)}, below "
                f"the clearance of {self.task.clearance:.2g}"
            )
        q = np.array([cfg.q for cfg in motion])
        over = np.maximum(q - self.task.upper, self.task.lower - q).max(axis=0)
        if over.max() > 1e-9:
            name = self.start.arm.joint_names[int(over.argmax())]
            raise NoSolutionError(f"joint {name!r} goes {over.max():.2g} beyond its limit")
        proof = certified(self.start.arm, q)
        if proof is not None and proof.at is not None:
            raise NoSolutionError(f"a singularity is met at q = {_numbers(proof.at)}")
        if (contact := self.contact(q)) is not None:
            raise NoSolutionError(str(contact))
        return motion

    def contact(self, path: Array) -> Contact | None:
        """Where bodies meet on straight joint segments (m, n), if they matter."""
        self.in_time()
        return self.collisions.contact(path) if self.collisions else None

    def search(self, start: Configuration, task: Task) -> Search:
        """Guesses for motions from a configuration."""
        return Search(start, task, WAVES, np.random.default_rng(self.seed))

    def in_time(self) -> None:
        """Raises NoSolutionError once the time is up."""
        if time.monotonic() > self.deadline:
            raise NoSolutionError("the time is up (timeout)", self.best)


def what_it_takes(
    cfg: Configuration,
    goal: Goal | Joints,
    clearance: float | None,
    final_attitude: npt.ArrayLike | pin.SE3 | float | None,
    limits: bool,
    seed: int,
) -> tuple[Task, float]:
    """What a motion must achieve, arguments as in `plan`; the ample clearance.

    Raises:
        NoSolutionError: No motion can do that.
    """
    lower, upper = _bounds(cfg, limits)
    least, ample = _clearance(cfg, clearance, seed)
    task = Task(
        tip=None if isinstance(goal, Joints) else _reachable(cfg, goal_pose(cfg, goal), limits),
        q=joint_vector(cfg.arm, goal.q, "goal") if isinstance(goal, Joints) else None,
        attitude=None if final_attitude is None else _attitude(cfg, final_attitude),
        clearance=least,
        lower=lower,
        upper=upper,
    )
    if task.q is not None:
        _check_joints(cfg, task.q, task)
    return task, ample


def bodies_apart(cfg: Configuration, task: Task) -> Collisions:
    """The bodies that must not meet.

    Raises:
        NoSolutionError: They do, at the start or at the goal.
    """
    bodies = collision_geometry(cfg.arm)
    for what, q in (("start", cfg.q), ("goal", task.q)):
        if q is not None and bodies and (contact := bodies.contact(q[None])) is not None:
            raise NoSolutionError(
                f"the {what} is in collision: {contact}; collisions=False ignores it"
            )
    return bodies


def _bounds(cfg: Configuration, limits: bool) -> tuple[Array, Array]:
    """(n,) each: where the joints may be.

    Raises:
        NoSolutionError: The start is beyond them.
    """
    arm, free = cfg.arm, np.full(cfg.arm.n, np.inf)
    if not limits:
        return -free, free
    _check_within(arm, "start", cfg.q, arm.lower, arm.upper)
    return arm.lower, arm.upper


def _check_within(arm: SpaceArm, what: str, q: Array, lower: Array, upper: Array) -> None:
    """Raises NoSolutionError where joint positions (n,) are beyond their limits."""
    beyond = (q < lower) | (q > upper)
    if beyond.any():
        j = int(np.flatnonzero(beyond)[0])
        raise NoSolutionError(
            f"{what} of joint {arm.joint_names[j]!r} is {q[j]:.6g}, beyond its limits "
            f"{lower[j]:.6g} and {upper[j]:.6g}; limits=False ignores them"
        )


def _reachable(cfg: Configuration, goal: pin.SE3, limits: bool) -> pin.SE3:
    """The goal, unless it is farther from the system CM than the stretched virtual manipulator.

    Raises:
        NoSolutionError: It is; carries the way of the tip towards it as far as J* leads.
    """
    if far := out_of_reach(cfg, goal):
        line = follow(cfg.arm, cfg.q, [as_goal(cfg, goal)], base=cfg.base, limits=limits)
        raise NoSolutionError(far, [line.at(i) for i in range(len(line.t))])
    return goal


def _check_joints(cfg: Configuration, q: Array, task: Task) -> None:
    """Raises NoSolutionError where no motion can lead to joint positions q (n,)."""
    _check_within(cfg.arm, "goal", q, task.lower, task.upper)
    here, there = (singularity(cfg.arm.at(x)).determinant for x in (cfg.q, q))
    if here is not None and there is not None and here * there <= 0.0:
        raise NoSolutionError(
            f"det J* is {here:.3g} at the start and {there:.3g} at the goal: every way between "
            "them meets a singularity; lead the tip there and leave the joints open"
        )
    if (sigma := singular_values(cfg.arm.at(q))[-1]) < task.clearance:
        raise NoSolutionError(
            f"the goal has sigma_min {sigma:.3g}, below the clearance of {task.clearance:.3g}"
        )


def _attitude(cfg: Configuration, attitude: npt.ArrayLike | pin.SE3) -> Array:
    """(3, 3) the attitude asked for.

    Raises:
        NoSolutionError: A planar arm cannot turn its spacecraft there.
    """
    rotation = _rotation(cfg.arm, attitude)
    axes = turning_axes(cfg.arm)
    turn = pin.log3(cfg.base.rotation.T @ rotation)
    if len(axes) == 1 and np.linalg.norm(np.delete(turn, axes[0])) > ARRIVED:
        raise NoSolutionError(
            f"final_attitude is no turn about {'xyz'[axes[0]]} of the spacecraft from its start, "
            f"and {cfg.arm.name} turns it about nothing else"
        )
    return rotation


def _rotation(arm: SpaceArm, attitude: npt.ArrayLike | pin.SE3) -> Array:
    """(3, 3) a rotation from what final_attitude may be."""
    normal = arm.tree.plane_normal()
    given = attitude.rotation if isinstance(attitude, pin.SE3) else attitude
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape == () and normal is not None and np.isfinite(values):
        return pin.exp3(float(values) * np.eye(3)[normal])
    if values.shape != (3, 3):
        raise ConfigurationError(
            f"final_attitude is {attitude!r}; give a (3, 3) rotation matrix, a pin.SE3"
            + (", or an angle [rad]" if normal is not None else "")
        )
    return sound_pose(pin.SE3(values, np.zeros(3)), "final_attitude").rotation


def _clearance(cfg: Configuration, clearance: float | None, seed: int) -> tuple[float, float]:
    """The least sigma_min on the way, and an ample one.

    Raises:
        NoSolutionError: The start has less.
    """
    sigma = singular_values(cfg)
    if sigma[-1] <= NO_INVERSE * sigma[0]:
        raise NoSolutionError(
            f"the start is singular (sigma_min {sigma[-1]:.1e} of {sigma[0]:.1e}); leave it first "
            "along sa.singularity(cfg).gradient"
        )
    rng = np.random.default_rng(seed)
    Q = rng.uniform(-np.pi, np.pi, (PROBES, cfg.arm.n))
    median = float(np.median([singular_values(cfg.arm.at(q))[-1] for q in Q]))
    most = 0.5 * float(sigma[-1])
    if clearance is None:
        return min(SHARE * median, most), min(AMPLE * median, most)
    if not isinstance(clearance, Real) or not 0.0 <= clearance < np.inf:
        raise ConfigurationError(f"clearance is {clearance!r}; give a number from 0 on")
    if sigma[-1] < clearance:
        raise NoSolutionError(
            f"the start has sigma_min {sigma[-1]:.3g}, below the clearance of {clearance:.3g}"
        )
    return float(clearance), min(AMPLE * median, most)


def _numbers(q: Array) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in q) + ")"
