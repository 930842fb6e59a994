"""What the motions of an arm do to its spacecraft: turns if it floats, wheels or thrusters if not.

With the attitude held, the arm has the angular momentum D_q dq about the system CM, and wheels must
take up the opposite; the torque they give is its derivative.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, Progress, Result, finite
from spacearm.errors import ConfigurationError
from spacearm.mechanics.dynamics import inverse_dynamics
from spacearm.mechanics.floating import walk
from spacearm.mechanics.jacobian import base_velocity, momentum_matrix
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.motion.motion import Motion
from spacearm.motion.playable import Playable
from spacearm.motion.trajectory import Trajectory
from spacearm.planning.result import Plan


@dataclass(frozen=True, eq=False, repr=False)
class Reaction(Result):
    """What a motion of the arm does to its spacecraft, and what holding the attitude takes.

    All vectors are in spacecraft axes, momenta about the system CM.

    Attributes:
        arm: The arm.
        t: (m,) times [s].
        excursion: (m, 3) rotation vector of the floating spacecraft from its attitude at the start
            [rad].
        rate: (m, 3) angular velocity of the floating spacecraft [rad/s].
        momentum: (m, 3) angular momentum D_q dq of the joint motion while the attitude is held
            [N m s].
        on_board: (m, 3) angular momentum of the whole system [N m s], in the spacecraft axes of the
            start; what wrenches add counts.
        torque: (m, 3) torque on the spacecraft that holds its attitude, the derivative of
            `momentum` [N m].
        camera: (3,) unit vector of a camera's line of sight; None for the worst one.
    """

    arm: SpaceArm
    t: Array
    excursion: Array
    rate: Array
    momentum: Array
    on_board: Array
    torque: Array
    camera: Array | None = field(default=None)

    JSON: ClassVar[Mapping[str, str]] = {"momentum": "joint_momentum", "torque": "holding_torque"}

    @cached_property
    def angle(self) -> Array:
        """(m,) turn of the floating spacecraft from its attitude at the start [rad]."""
        return np.linalg.norm(self.excursion, axis=1)

    @cached_property
    def wheels(self) -> Array:
        """(m, 3) momentum that wheels hold while they hold the attitude [N m s]."""
        return np.asarray(self.on_board - self.momentum)

    @cached_property
    def impulse(self) -> Array:
        """(3,) angular impulse of thrusters that hold the attitude, about each axis [N m s].

        It is the integral of the torque's size; thrusters with lever arm a take impulse / a [N s].
        """
        return np.asarray(np.abs(np.diff(self.momentum, axis=0)).sum(axis=0))

    @cached_property
    def pointing(self) -> Array:
        """(m,) angle between the camera's line of sight and that at the start, floating [rad].

        Without a camera the largest that any camera has: the turn of the spacecraft.
        """
        if self.camera is None:
            return self.angle
        lines = np.array([pin.exp3(turn) @ self.camera for turn in self.excursion])
        across = np.linalg.norm(np.cross(self.camera, lines), axis=1)
        return np.asarray(np.arctan2(across, lines @ self.camera))

    @cached_property
    def smear(self) -> Array:
        """(m,) speed at which the line of sight turns, floating; the worst one without a camera.

        In [rad/s]: times the exposure it is the smear of a picture.
        """
        turning = self.rate if self.camera is None else np.cross(self.rate, self.camera)
        return np.linalg.norm(turning, axis=1)

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data, with the largest of each kind and the impulse."""
        return super().to_dict() | {
            "largest_angle": float(self.angle.max()),
            "largest_pointing": float(self.pointing.max()),
            "largest_smear": float(self.smear.max()),
            "largest_wheels": np.abs(self.wheels).max(axis=0).tolist(),
            "largest_holding_torque": np.abs(self.torque).max(axis=0).tolist(),
            "thruster_impulse": self.impulse.tolist(),
        }

    def __repr__(self) -> str:
        wheels = np.linalg.norm(self.wheels, axis=1).max()
        torque = np.linalg.norm(self.torque, axis=1).max()
        return (
            f"Reaction({self.arm.name}, {self.t[-1] - self.t[0]:.4g} s: floating it turns by up to "
            f"{np.degrees(self.angle.max()):.4g}°; held, wheels take {wheels:.4g} N m s and "
            f"{torque:.4g} N m)"
        )


def reaction(
    motion: Playable,
    *,
    camera: npt.ArrayLike | None = None,
    progress: Progress | None = None,
) -> Reaction:
    """Compute what a motion does to the spacecraft, and what holding the attitude takes.

    The joints move as they do in the motion. Floating, the spacecraft turns as in the motion if it
    floats there (with wheels and momentum as they were), else by w_0 = -D^-1 D_q dq, equation
    (33c). Held at its attitude of the start, it
    needs wheels with the momentum -D_q dq, besides what is on board, and a torque that is the
    derivative of D_q dq; this is the torque that `inverse_dynamics` reports as the reaction.

    Accelerations are differences of the rates over the samples: sample finely, above all motions
    that are not smooth. A `Plan` knows its own: it begins and ends at rest.

    Args:
        motion: Any motion of the package, or an object with arm, t, q and base; see `Motion.of`.
        camera: (3,) a camera's line of sight in spacecraft axes.
        progress: Called now and then as progress(done, samples).

    Returns:
        Turns and rates if it floats; momentum, torque and impulse if it is held; over time.

    Raises:
        ConfigurationError: The motion has fewer than two samples, or `camera` is no direction.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> way = sa.follow(arm, [0.3, 1.2], [(1.5, 1.2)])
        >>> bool(sa.reaction(way).angle.max() < 0.1)
        True
    """
    run = Motion.of(motion)
    if len(run) < 2:
        raise ConfigurationError("the motion has one sample only; a reaction needs two or more")
    sight = None if camera is None else _unit(camera)
    floating = list(run) if run.mode == "free-floating" else _floating(run)
    start = floating[0].base.rotation
    on_board: Array = np.zeros((len(run), 6))
    if isinstance(run, Plan) or (isinstance(run, Trajectory) and run.mode == "free-floating"):
        on_board = run.momentum
    excursion = np.array([pin.log3(start.T @ cfg.base.rotation) for cfg in floating])
    own: Array | None = getattr(run, "ddq", None)
    if own is None:
        own = np.gradient(run.dq, run.t, axis=0, edge_order=2 if len(run) > 2 else 1)
    momentum, rate, torque = np.zeros((3, len(run), 3))
    for i, (cfg, afloat) in enumerate(zip(run, floating, strict=True)):
        momentum[i] = _held(cfg) @ run.dq[i]
        rate[i] = afloat.base.rotation.T @ base_velocity(afloat, run.dq[i])[3:]
        torque[i] = _taken(cfg, run.dq[i], own[i])
        if progress:
            progress(i + 1, len(run))
    return Reaction(
        run.arm, run.t, excursion, rate, momentum, on_board[:, 3:] @ start, torque, sight
    )


def _held(cfg: Configuration) -> Array:
    """Return D_q (3, n), in spacecraft axes."""
    return np.asarray(cfg.base.rotation.T @ momentum_matrix(cfg).A_q[3:])


def _taken(cfg: Configuration, dq: Array, ddq: Array) -> Array:
    """Return the torque (3,) that holds the attitude, in spacecraft axes."""
    found = inverse_dynamics(cfg, dq, ddq, mode="attitude-controlled")
    return np.asarray(cfg.base.rotation.T @ found.reaction[3:])


def _floating(run: Motion) -> list[Configuration]:
    """Return the configurations of the same joint motion with the spacecraft floating."""
    return walk(run.arm.at(run.q[0], base=run[0].base), run.q)


def _unit(camera: npt.ArrayLike) -> Array:
    """Return a direction as a unit vector."""
    line = finite(camera, (3,), "camera", "of the line of sight in spacecraft axes")
    length = float(np.linalg.norm(line))
    if length == 0.0:
        raise ConfigurationError("camera is zero; give the direction of its line of sight")
    return line / length
