"""Capture of a moving, tumbling target: the velocities of all bodies just after the grasp.

The grasp is a plastic impact: impulses at the tip fix the target to it in an instant. With
v = (v_b, dq), the target's twist t at the tip, the tip's Jacobian J and the target's spatial
inertia M_t at the tip, the impulse balances of arm and target add up to

    (M + J^T M_t J) v+ = M v- + J^T M_t t-,

the balance of generalized momentum with the mass matrix of the arm that holds the target. v+ is the
projection of (v-, t-) onto the motions in which the target is fixed to the tip, in the metric of
the kinetic energy, which therefore cannot grow. Braked joints add the constraint dq+ = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, Result, finite
from spacearm.errors import ConfigurationError, unknown
from spacearm.mechanics.dynamics import generalized_velocity, in_inertial_axes
from spacearm.mechanics.momentum import mass_matrix, require_positive_definite
from spacearm.model.arguments import of_configuration
from spacearm.model.arm import Configuration, still_wheels
from spacearm.model.frames import LWA

JointState = Literal["free", "braked"]


@dataclass(frozen=True, eq=False, repr=False)
class Capture(Result):
    """The arm with its target just after the grasp.

    Attributes:
        configuration: Configuration of the arm that holds the target, with the momentum of both:
            where the motion that follows starts.
        twist: (6,) twist of the spacecraft, [linear [m/s]; angular [rad/s]], inertial axes.
        dq: (n,) joint rates [rad/s] or [m/s].
        momentum: (6,) total momentum, [linear [kg m/s]; angular about the system CM [kg m^2/s]],
            inertial axes.
        impulse: (6,) impulse of the target on the tip, [linear [N s]; angular about the tip
            frame's origin [N m s]], inertial axes.
        energy_lost: Kinetic energy lost in the impact [J], never negative.
    """

    configuration: Configuration
    twist: Array
    dq: Array
    momentum: Array
    impulse: Array
    energy_lost: float

    JSON: ClassVar[Mapping[str, str]] = {"impulse": "tip_impulse"}

    @property
    def velocities(self) -> dict[str, Array]:
        """Twists (6,) of the links' frames by link name, [linear; angular], inertial axes."""
        cfg = self.configuration
        model, data = cfg.arm.model, pin.Data(cfg.arm.model)
        turned = (cfg.base.rotation.T @ self.twist.reshape(2, 3).T).T
        v = np.concatenate((turned.ravel(), cfg.arm.all_rates(self.dq)))
        pin.forwardKinematics(model, data, cfg.full_at_origin, v)
        frames = {link: model.getFrameId(link, pin.BODY) for link in cfg.arm.tree.links}
        return {
            link: pin.getFrameVelocity(model, data, frame, LWA).vector
            for link, frame in frames.items()
        }

    def __repr__(self) -> str:
        name = self.configuration.arm.name
        return f"Capture({name}: {self.energy_lost:.6g} J lost, w_0 = {self.twist[3:]} rad/s)"


@of_configuration
def capture(
    cfg: Configuration,
    target_twist: npt.ArrayLike,
    mass: float,
    inertia: npt.ArrayLike | None = None,
    com: npt.ArrayLike = (0.0, 0.0, 0.0),
    *,
    dq: npt.ArrayLike | None = None,
    joints: JointState = "free",
) -> Capture:
    """Compute the velocities just after the tip has grasped a moving, tumbling target.

    The grasp is a plastic impact at the tip,

        (M + J^T M_t J) v+ = M v- + J^T M_t t-,

    with v = (v_b, dq), the target's twist t and spatial inertia M_t at the tip: linear and angular
    momentum of arm and target together are conserved.

    Args:
        cfg: The arm at the moment of the grasp, with its momentum before.
        target_twist: (6,) the target before, [velocity of its CM [m/s]; angular velocity [rad/s]],
            inertial axes.
        mass: Mass of the target [kg].
        inertia: (3, 3) its inertia about its CM, tip axes [kg m^2]; a point mass if None.
        com: (3,) its CM in the tip frame [m].
        dq: (n,) joint rates before [rad/s] or [m/s]; zeros if None.
        joints: "free": the joints give way, as motor torques give no impulse in an instant;
            "braked": brakes hold them at rest from then on.

    Returns:
        What moves how just after the grasp, and the energy lost.

    Raises:
        ConfigurationError: An argument has the wrong shape or is not finite.
        ModelError: No rigid body can have this mass and inertia, or the mass matrix of the arm is
            not positive definite.
        UnsupportedError: The arm has several tips, or its wheels hold momentum.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.capture(cfg, [0.02, 0, 0, 0, 0, 0.03], mass=5.0)
        Capture(planar2: 0.000164513 J lost, w_0 = [ 0.         0.        -0.0001994] rad/s)
    """
    if joints not in get_args(JointState):
        raise ConfigurationError(unknown("joints", joints, get_args(JointState)))
    still_wheels(cfg, "how their motors bear an impact is not known; take them as joints")
    rates = np.zeros(cfg.arm.n) if dq is None else dq
    before = generalized_velocity(cfg, rates)
    held = cfg.arm.grasp(mass, inertia, com).at(cfg.q, base=cfg.base)
    M_t = _target(cfg, mass, inertia, com)
    t = _at_tip(cfg, target_twist, com)
    M, M_held = mass_matrix(cfg), mass_matrix(held)
    require_positive_definite(cfg.arm, M, "the mass matrix M")
    h = M @ before + cfg.J.T @ M_t @ t
    f = len(h) if joints == "free" else 6
    after = np.zeros_like(h)
    after[:f] = np.linalg.solve(M_held[:f, :f], h[:f])
    dv, dt = after - before, cfg.J @ after - t
    momentum = held.A @ after
    return Capture(
        configuration=held.with_momentum(momentum),
        twist=in_inertial_axes(cfg, after[:6]),
        dq=after[6:],
        momentum=momentum,
        impulse=-M_t @ dt,
        energy_lost=float(dv @ M @ dv + dt @ M_t @ dt) / 2.0,
    )


def _target(
    cfg: Configuration, mass: float, inertia: npt.ArrayLike | None, com: npt.ArrayLike
) -> Array:
    """Return M_t (6, 6), the target's spatial inertia at the tip frame's origin, inertial axes."""
    R = cfg.tip.rotation
    I = np.zeros((3, 3)) if inertia is None else np.asarray(inertia)
    return pin.Inertia(mass, R @ np.asarray(com), R @ I @ R.T).matrix()


def _at_tip(cfg: Configuration, target_twist: npt.ArrayLike, com: npt.ArrayLike) -> Array:
    """Return t- (6,), the target's twist at the tip frame's origin, from that of its CM."""
    t = finite(target_twist, (6,), "target_twist", "[linear [m/s]; angular [rad/s]]")
    lever = cfg.tip.rotation @ np.asarray(com)
    return np.concatenate((t[:3] - np.cross(t[3:], lever), t[3:]))
