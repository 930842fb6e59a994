"""Wheels that hold the attitude: the momentum and the torque that they need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from spacearm.arrays import Array, Progress, Result, positive, whole
from spacearm.errors import ConfigurationError, NoSolutionError
from spacearm.mechanics.distance import distance_at
from spacearm.mechanics.jacobian import momentum_matrix, task_jacobian
from spacearm.mission.reactions import reaction
from spacearm.model.arguments import HELD, of_arm
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.playable import Playable
from spacearm.singularities.risk import NEAR, uniform

PERCENTILES = (50.0, 90.0, 95.0, 99.0, 100.0)
"""Those that are reported."""


@dataclass(frozen=True, eq=False, repr=False)
class WheelSizing(Result):
    """The momentum, and of motions the torque, that wheels need to hold the attitude.

    A case is a motion, or a posture at which the tip moves at a speed in the worst direction.

    Attributes:
        arm: The arm.
        cases: "motions" or "postures".
        tip_speed: Speed of the tip [m/s], or [rad/s] of a task without linear rows; NaN of motions.
        axes: (m, 3) largest momentum about each axis of the spacecraft [N m s].
        momentum: (m,) largest momentum about any axis [N m s].
        torque: (m, 3) largest torque about each axis [N m]; NaN of postures.
        q: (m, n) the postures; of motions the posture with the largest momentum.
        left_out: Share of the postures drawn that were left out, nearer to a singularity of the
            held arm than `near`: there the joints, and the momentum, would be without bound.
        near: That distance [rad]; zero of motions.
    """

    arm: SpaceArm
    cases: str
    tip_speed: float
    axes: Array
    momentum: Array
    torque: Array
    q: Array
    left_out: float
    near: float

    JSON: ClassVar[Mapping[str, str]] = {
        "axes": "axis_momentum",
        "momentum": "wheel_momentum",
        "torque": "holding_torque",
    }

    @cached_property
    def worst(self) -> int:
        """Number of the case with the largest momentum."""
        return int(np.argmax(self.momentum))

    def covering(self, percent: float) -> tuple[Array, float]:
        """Return the momentum about each axis (3,) and about any that covers a share of the cases.

        Args:
            percent: The share, up to 100.
        """
        each = np.percentile(self.axes, percent, axis=0)
        return np.asarray(each), float(np.percentile(self.momentum, percent))

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data, with the percentiles of the momentum."""
        found = {f"{p:g}": float(np.percentile(self.momentum, p)) for p in PERCENTILES}
        return super().to_dict() | {"percentiles": found}

    def __repr__(self) -> str:
        about = f"{len(self.momentum)} {self.cases}"
        if self.cases == "postures":
            about += (
                f" at {self.tip_speed:g} m/s" if self._linear else f" at {self.tip_speed:g} rad/s"
            )
        half, most = (float(np.percentile(self.momentum, p)) for p in (50.0, 99.0))
        return (
            f"WheelSizing({self.arm.name}, {about}: median {half:.4g} N m s, 99 % below "
            f"{most:.4g}, worst {self.momentum.max():.4g})"
        )

    @property
    def _linear(self) -> bool:
        return min(self.arm.task.indices) < 3


@of_arm
def size_wheels(
    arm: SpaceArm,
    motions: Playable | Sequence[Playable] | None = None,
    *,
    tip_speed: float | None = None,
    samples: int = 2000,
    near: float = NEAR,
    seed: int = 0,
    progress: Progress | None = None,
) -> WheelSizing:
    """Compute the momentum that wheels need to hold the attitude against the arm's motions.

    For motions it is the largest they have on the way, with the torque; see `reaction`. For a tip
    speed it is that of each of many postures, uniform within the joint limits, while the tip moves
    at this speed in the worst direction and does not turn: the largest singular value of
    D_q J^+, J the Jacobian with the attitude held. It grows in proportion to the speed.

    Args:
        arm: The arm.
        motions: A motion or several, all of this arm.
        tip_speed: Speed of the tip [m/s] instead; [rad/s] for a task without linear rows.
        samples: Number of postures.
        near: Distance to the singularities of the held arm below which postures are left out
            [rad]; the joint rates grow there without bound.
        seed: Of the postures.
        progress: Called now and then as progress(done, cases).

    Returns:
        The momentum of each case, about each axis and about any.

    Raises:
        ConfigurationError: Neither motions nor a speed is given, or both, or motions of other arms.
        UnsupportedError: The arm has several tips, or a sliding joint without limits.
        NoSolutionError: All postures are near singularities.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> slow, fast = (sa.size_wheels(arm, tip_speed=v, samples=50) for v in (0.1, 0.2))
        >>> round(float(fast.momentum.max() / slow.momentum.max()), 6)
        2.0
    """
    if (motions is None) == (tip_speed is None):
        raise ConfigurationError("give motions or tip_speed, one of them")
    if motions is not None:
        given = list(motions) if isinstance(motions, Sequence) else [motions]
        return _of_motions(arm, given, progress)
    arm.require_one_tip()
    speed = positive(tip_speed, "tip_speed", "speed [m/s]")
    Q = uniform(arm, True, whole(samples, "samples", 1), np.random.default_rng(seed))
    cfgs: list[Configuration] = []
    moved: list[Array] = []
    for i, cfg in enumerate(map(arm.at, Q)):
        if distance_at(cfg, HELD) > near:
            cfgs.append(cfg)
            moved.append(speed * momentum_by_speed(cfg))
        if progress:
            progress(i + 1, len(Q))
    if not cfgs:
        raise NoSolutionError(
            f"all {samples} postures of {arm.name} are within {np.degrees(near):.3g}° of a "
            "singularity of the arm with its attitude held; lower near, or take a smaller task"
        )
    G = np.array(moved)
    return WheelSizing(
        arm=arm,
        cases="postures",
        tip_speed=speed,
        axes=np.linalg.norm(G, axis=2),
        momentum=np.linalg.norm(G, ord=2, axis=(1, 2)),
        torque=np.full((len(G), 3), np.nan),
        q=np.array([cfg.q for cfg in cfgs]),
        left_out=1.0 - len(cfgs) / len(Q),
        near=near,
    )


def momentum_by_speed(cfg: Configuration) -> Array:
    """Compute the angular momentum (3, r) by each linear task row of the tip's velocity.

    The attitude is held, and what the task has besides stays at rest; [N m s] by [m/s]. For tasks
    without linear rows it is by each row [rad/s]. Spacecraft and task axes, redundant arms with the
    least joint rates.
    """
    task, R = cfg.arm.task, cfg.base.rotation
    J = task_jacobian(cfg, mode=HELD) / task.scale
    D_q = R.T @ momentum_matrix(cfg).A_q[3:]
    rows = [i for i, row in enumerate(task.indices) if row < 3] or list(range(task.k))
    return np.asarray((D_q @ np.linalg.pinv(J))[:, rows])


def _of_motions(
    arm: SpaceArm, motions: Sequence[Playable], progress: Progress | None
) -> WheelSizing:
    """Size wheels for motions."""
    if not motions:
        raise ConfigurationError("motions is empty; give one motion or several")
    for i, motion in enumerate(motions):
        if motion.arm.joint_names != arm.joint_names:
            raise ConfigurationError(
                f"motion {i} is one of {motion.arm.name}, with other joints than {arm.name}"
            )
    found = []
    for i, motion in enumerate(motions):

        def tell(done: int, of: int, before: int = i) -> None:
            if progress:
                progress(before * of + done, len(motions) * of)

        found.append(reaction(motion, progress=tell))
    sizes = [np.linalg.norm(each.wheels, axis=1) for each in found]
    where = [int(np.argmax(size)) for size in sizes]
    return WheelSizing(
        arm=arm,
        cases="motions",
        tip_speed=np.nan,
        axes=np.array([np.abs(each.wheels).max(axis=0) for each in found]),
        momentum=np.array([size.max() for size in sizes]),
        torque=np.array([np.abs(each.torque).max(axis=0) for each in found]),
        q=np.array([motion.q[i] for motion, i in zip(motions, where, strict=True)]),
        left_out=0.0,
        near=0.0,
    )
