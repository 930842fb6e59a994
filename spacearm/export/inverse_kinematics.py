"""Tasks and barriers of a floating arm for pink's inverse kinematics, `pink.solve_ik`.

pink's configuration is that of the arm's model: pose of the spacecraft and joint positions. Its
displacements have 6 + n components, of which the first six follow from the others by conservation
of momentum: `MomentumConservation` says so as a constraint. Nothing here imports pink; its solver
asks tasks, constraints and barriers for matrices, and these classes have them.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, finite, numbers_of, plain, positive
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.mechanics.batch import evaluate
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import PoseLike, sound_pose
from spacearm.model.joints import joint_scales
from spacearm.signatures import checked

Matrices = tuple[Array, Array]


@checked
class _OfArm:
    """What knows an arm, and pink's configurations of it."""

    #: Names of what else is given.
    GIVEN: ClassVar[tuple[str, ...]] = ()

    def __init__(self, arm: SpaceArm) -> None:
        if arm.coupling is not None:
            raise UnsupportedError(
                f"{arm.name}: joints mimic others, which pink's configuration does not know; lock "
                "their leaders with locked={...}"
            )
        arm.require_one_tip()
        self.arm = arm

    def to_dict(self) -> dict[str, Any]:
        """Return the arm's name and what else is given as plain data."""
        return {"arm": self.arm.name, **{name: plain(getattr(self, name)) for name in self.GIVEN}}

    def configuration(self, configuration: Any) -> Configuration:
        """Return a configuration of pink as one of the arm.

        Raises:
            ConfigurationError: It is not of this arm's model.
        """
        q = np.asarray(configuration.q)
        if len(q) != self.arm.model.nq:
            raise ConfigurationError(
                f"the configuration has {len(q)} numbers, {self.arm.name} has "
                f"{self.arm.model.nq}: make it of arm.model, pink.Configuration(arm.model, "
                "arm.model.createData(), arm.at(q).full)"
            )
        return self.arm.at(q[7:], base=pin.XYZQUATToSE3(q[:7]))


@checked
class GeneralizedJacobianTask(_OfArm):
    """A task of pink: the tip at a pose, moved by J*.

    The task rows of the arm count, scaled as in `task_jacobian`: rows of length are divided by the
    task's length where there are angles too.

    Args:
        arm: The arm.
        target: Pose of the tip in the inertial frame; `set_target` changes it.
        cost: Weight of the error, a number or (k,).
        gain: Share of the error that a step takes away, 0 to 1.
        lm_damping: Levenberg-Marquardt damping per squared error.

    Raises:
        UnsupportedError: The arm has several tips, or joints that mimic others.

    Example:
        >>> import pinocchio as pin
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> task = sa.GeneralizedJacobianTask(arm, sa.pose(xyz=(1.5, 0.5, 0.0)))
        >>> task.target.translation
        array([1.5, 0.5, 0. ])
    """

    GIVEN = ("target", "cost", "gain", "lm_damping")

    def __init__(
        self,
        arm: SpaceArm,
        target: PoseLike,
        *,
        cost: float | ArrayLike = 1.0,
        gain: float = 1.0,
        lm_damping: float = 0.0,
    ) -> None:
        super().__init__(arm)
        given, k = numbers_of(cost, "cost"), arm.task.k
        self.cost = finite(given if given.ndim else np.full(k, given), (k,), "cost")
        self.gain = gain
        self.lm_damping = lm_damping
        self.set_target(target)

    def set_target(self, target: PoseLike) -> None:
        """Set the desired pose of the tip."""
        self.target = sound_pose(target, "target")

    def compute_error(self, configuration: Any) -> Array:
        """Compute the error (k,), tip less target: distance, and rotation vector [rad]."""
        cfg = self.configuration(configuration)
        turn = pin.log3(cfg.tip.rotation @ self.target.rotation.T)
        error = np.concatenate((cfg.tip.translation - self.target.translation, turn))
        return self.arm.task.jacobian(error[:, None], cfg.base.rotation)[:, 0]

    def compute_jacobian(self, configuration: Any) -> Array:
        """Compute (k, 6 + n): J* for the joints, zeros for the spacecraft, which follows them."""
        J = task_jacobian(self.configuration(configuration))
        return np.hstack((np.zeros((len(J), 6)), J))

    def compute_qp_objective(self, configuration: Any) -> Matrices:
        """Compute H (6 + n, 6 + n) and c (6 + n,) of cost 1/2 |J v + gain error|^2."""
        J = self.cost[:, None] * self.compute_jacobian(configuration)
        error = self.cost * self.gain * self.compute_error(configuration)
        damping = self.lm_damping * float(error @ error)
        return J.T @ J + damping * np.eye(J.shape[1]), J.T @ error

    def __repr__(self) -> str:
        return f"GeneralizedJacobianTask({self.arm.label}, task {self.arm.task.names!r})"


@checked
class MomentumConservation(_OfArm):
    """A constraint of pink: the spacecraft moves so that the momentum stays zero, (33c).

    Give it to `pink.solve_ik` among `constraints`, without which the spacecraft would not move.

    Args:
        arm: The arm.

    Raises:
        UnsupportedError: The arm has several tips, or joints that mimic others.

    Example:
        >>> import spacearm as sa
        >>> sa.MomentumConservation(sa.load("planar2"))
        MomentumConservation(planar2)
    """

    gain = 1.0

    def compute_error(self, _: Any) -> Array:
        """Return zeros (6,)."""
        return np.zeros(6)

    def compute_jacobian(self, configuration: Any) -> Array:
        """Compute [1, A_b^-1 A_q] (6, 6 + n), which the displacements keep at zero."""
        A = self.configuration(configuration).A
        return np.hstack((np.eye(6), np.linalg.solve(A[:, :6], A[:, 6:])))

    def __repr__(self) -> str:
        return f"MomentumConservation({self.arm.label})"


@checked
class SingularityBarrier(_OfArm):
    """A barrier of pink: the singular set is kept at a distance in joint space.

    The control barrier function is h = d - margin, d the distance of `sa.evaluate` [rad]; the
    solver keeps dh/dt >= -gain h, so that h stays positive. Near the set the gradient of d is the
    unit vector along the gradient of S.

    Args:
        arm: The arm.
        margin: Least distance to the singular set [rad].
        gain: How fast the margin may be approached [1/s].

    Raises:
        ConfigurationError: The margin or the gain is not positive.
        UnsupportedError: The arm has several tips, or joints that mimic others.

    Example:
        >>> import spacearm as sa
        >>> sa.SingularityBarrier(sa.load("chaser7"), margin=0.05)
        SingularityBarrier(chaser7, margin 0.05 rad, gain 10 1/s)
    """

    GIVEN = ("margin", "gain")
    dim = 1

    def __init__(self, arm: SpaceArm, margin: float, *, gain: float = 10.0) -> None:
        super().__init__(arm)
        self.margin, self.gain = positive(margin, "margin"), positive(gain, "gain")

    def compute_barrier(self, configuration: Any) -> Array:
        """Compute h (1,) [rad]."""
        return self._near(configuration)[0]

    def compute_jacobian(self, configuration: Any) -> Array:
        """Compute the gradient (1, 6 + n) of h; zeros for the spacecraft."""
        return self._near(configuration)[1]

    def _near(self, configuration: Any) -> Matrices:
        """Compute h and its gradient."""
        cfg = self.configuration(configuration)
        near = evaluate(self.arm, cfg.q[None], ("distance", "away"))
        slope = near["away"] / joint_scales(self.arm) ** 2
        return near["distance"] - self.margin, np.hstack((np.zeros((1, 6)), slope))

    def compute_qp_objective(self, _: Any) -> Matrices:
        """Return zeros: the barrier adds no cost."""
        size = 6 + self.arm.n
        return np.zeros((size, size)), np.zeros(size)

    def compute_qp_inequalities(self, configuration: Any, dt: float = 1e-3) -> Matrices:
        """Compute G (1, 6 + n) and (1,) of -dh/dq v / dt <= gain h."""
        h, slope = self._near(configuration)
        if not np.isfinite(h).all():  # nothing near, to first order
            return np.zeros_like(slope), np.ones(1)
        return -slope / dt, self.gain * h

    def __repr__(self) -> str:
        return (
            f"SingularityBarrier({self.arm.label}, margin {self.margin:g} rad, "
            f"gain {self.gain:g} 1/s)"
        )
