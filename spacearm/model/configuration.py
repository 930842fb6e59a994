"""Configuration: one posture of an arm and one pose of its spacecraft, computed once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, finite, read_only
from spacearm.errors import UnsupportedError, called_from_outside, listed
from spacearm.model.frames import LWA, PoseLike, sound_pose
from spacearm.model.joints import joint_vector
from spacearm.model.limits import outside_limits, warn_outside

if TYPE_CHECKING:
    from spacearm.model.arm import SpaceArm

AT_REST = np.zeros(6)
"""Momentum of a system at rest, and of wheels that do not spin."""
MOMENTUM = "[linear [kg m/s]; angular about the system CM [kg m^2/s]]"
"""What the six numbers of a momentum are, for messages."""
AT_REST.flags.writeable = False


@dataclass(frozen=True, eq=False, repr=False)
class Configuration:
    """A posture q and a spacecraft pose, with the two matrices that everything follows from.

    Made by `SpaceArm.at`, with its kinematics computed. It never changes: arrays are read-only,
    `base` and `tip` are copies.

    The base columns of `A` and `J` act on the spacecraft's twist in spacecraft axes, Pinocchio's
    convention; products such as J_b A_b^-1 do not depend on it. `momentum_matrix` gives them for
    inertial axes.

    Attributes:
        arm: The arm.
        q: (n,) joint angles [rad] or displacements [m].
        wheels: (w,) angular momentum that each wheel of the arm holds about its axis [N m s].
        stored: (6,) momentum that all wheels hold, [linear (zero); angular], inertial axes; the
            total momentum is A_b v_b + A_q dq + stored.
        momentum: (6,) total momentum of the system, which is constant while nothing acts from
            outside: [linear; angular about the system CM], inertial axes, that of the wheels
            included [kg m/s], [kg m^2/s].
        com: (3,) system centre of mass in the inertial frame [m].
        A: (6, 6 + n) centroidal momentum matrix [A_b A_q], rows [linear; angular about the
            system CM], inertial axes.
        J: (6, 6 + n) Jacobian [J_b J_q] of the tip, rows [linear; angular], inertial axes; of
            several tips (6 tips, 6 + n), stacked.
    """

    arm: SpaceArm
    q: Array
    wheels: Array
    stored: Array
    momentum: Array
    com: Array
    A: Array
    J: Array
    _base: pin.SE3
    _tips: tuple[pin.SE3, ...]

    @property
    def base(self) -> pin.SE3:
        """Pose of the spacecraft frame in the inertial frame."""
        return self._base.copy()

    @property
    def tip(self) -> pin.SE3:
        """Pose of the tip frame in the inertial frame.

        Raises:
            UnsupportedError: The arm has several tips; see `tips`.
        """
        self.arm.require_one_tip()
        return self._tips[0].copy()

    @property
    def tips(self) -> tuple[pin.SE3, ...]:
        """Poses of the frames of all tips in the inertial frame."""
        return tuple(tip.copy() for tip in self._tips)

    @property
    def outside_limits(self) -> tuple[str, ...]:
        """Names of the joints that are outside their limits."""
        return outside_limits(self.arm, self.q)

    @property
    def full(self) -> Array:
        """(nq,) configuration of the Pinocchio model: [x y z, qx qy qz qw, joints]."""
        return np.concatenate((pin.SE3ToXYZQUAT(self._base), self.arm.all_joints(self.q)))

    @property
    def full_at_origin(self) -> Array:
        """(nq,) the same with the spacecraft at the origin, where orbits cost no digits."""
        full = self.full
        full[:3] = 0.0
        return full

    def with_momentum(self, momentum: npt.ArrayLike) -> Configuration:
        """Return the same posture, pose and wheels with another total momentum (6,).

        Raises:
            ConfigurationError: It has the wrong shape or is not finite.
        """
        return replace(self, momentum=read_only(finite(momentum, (6,), "momentum", MOMENTUM)))

    def centred(self, com: Array) -> Configuration:
        """Return the same posture and attitude with the system CM at `com` (3,) [m]."""
        by = com - self.com
        base, *tips = (pin.SE3(pose) for pose in (self._base, *self._tips))
        for pose in (base, *tips):
            pose.translation += by
        return replace(self, com=self.com + by, _base=base, _tips=tuple(tips))

    def to_dict(self) -> dict[str, Any]:
        """Return the configuration as plain data; poses are x y z [m] and a quaternion xyzw.

        Of several tips, `tip` has the poses of all.
        """
        tips = [pin.SE3ToXYZQUAT(tip).tolist() for tip in self._tips]
        return {
            "arm": self.arm.name,
            "joints": list(self.arm.joint_names),
            "q": self.q.tolist(),
            "base": pin.SE3ToXYZQUAT(self._base).tolist(),
            "tip": tips[0] if len(tips) == 1 else tips,
            "com": self.com.tolist(),
            "wheels": self.wheels.tolist(),
            "momentum": self.momentum.tolist(),
            "outside_limits": list(self.outside_limits),
        }

    def __repr__(self) -> str:
        base = np.array2string(pin.SE3ToXYZQUAT(self.base), precision=6, separator=", ")
        q = np.array2string(self.q, precision=6, separator=", ")
        return f"Configuration({self.arm.name}, q={q}, base(xyz, xyzw)={base})"


def configure(
    arm: SpaceArm,
    q: npt.ArrayLike,
    base: PoseLike | None,
    wheels: npt.ArrayLike | None,
    momentum: npt.ArrayLike | None,
) -> Configuration:
    """Return the configuration of an arm; arguments, checked, and errors as for `SpaceArm.at`.

    Warns:
        ModelWarning: `SpaceArm.at` was called from outside this package, with joints outside their
            limits or that look like degrees.
    """
    base = pin.SE3.Identity() if base is None else sound_pose(base, "base")
    cfg = kinematics(arm, joint_vector(arm, q, "q"), base)
    if called_from_outside(2):
        warn_outside(arm, cfg.q)
    if momentum is not None:
        cfg = cfg.with_momentum(momentum)
    return cfg if wheels is None else _spinning(cfg, wheels)


def _spinning(cfg: Configuration, wheels: npt.ArrayLike) -> Configuration:
    """Return the configuration with momentum in the wheels (w,), checked."""
    arm = cfg.arm
    names = listed([wheel.name for wheel in arm.wheels]) or "no wheel"
    h = finite(wheels, (len(arm.wheels),), "wheels", f"[N m s], one for each of: {names}")
    stored = np.zeros(6)
    data = arm.borrow()
    pin.framesForwardKinematics(arm.model, data, cfg.full_at_origin)
    for wheel, spin in zip(arm.wheels, h, strict=True):
        stored[3:] += data.oMf[wheel.frame].rotation @ wheel.axis * spin
    arm.give_back(data)
    for array in (h, stored):
        array.flags.writeable = False
    return replace(cfg, wheels=h, stored=stored)


def still_wheels(cfg: Configuration, what: str) -> None:
    """Refuse wheels that hold momentum.

    Args:
        cfg: The configuration.
        what: Why they are refused, for the message.

    Raises:
        UnsupportedError: A wheel holds momentum.
    """
    if cfg.wheels.any():
        raise UnsupportedError(f"the wheels of {cfg.arm.name} hold momentum, and {what}")


def kinematics(arm: SpaceArm, q: Array, base: pin.SE3, com: Array | None = None) -> Configuration:
    """Compute the configuration at q and base, which are not checked and not copied.

    Args:
        arm: The arm.
        q: (n,) joint positions [rad] or [m].
        base: Pose of the spacecraft frame in the inertial frame.
        com: (3,) where the system CM is, to which the base is moved; None if it stays.
    """
    model = arm.model
    full = np.zeros(model.nq)  # at the origin: far from it, as in orbit, digits would be lost
    full[3:7] = pin.SE3ToXYZQUAT(base)[3:]
    full[7:] = arm.all_joints(q)

    data = arm.borrow()
    A = arm.project(pin.computeCentroidalMap(model, data, full))
    frames = [pin.computeFrameJacobian(model, data, full, frame, LWA) for frame in arm.tip_frames]
    J = arm.project(frames[0] if len(frames) == 1 else np.vstack(frames))
    if com is not None:
        base.translation = com - data.com[0]
    com = data.com[0] + base.translation
    tips = [pin.updateFramePlacement(model, data, frame).copy() for frame in arm.tip_frames]
    for tip in tips:
        tip.translation += base.translation
    arm.give_back(data)

    wheels = np.zeros(len(arm.wheels))
    for array in (q, wheels, com, A, J):
        array.flags.writeable = False
    return Configuration(arm, q, wheels, AT_REST, AT_REST, com, A, J, base, tuple(tips))
