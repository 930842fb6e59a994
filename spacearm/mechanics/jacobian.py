"""The centroidal momentum matrix, the generalized Jacobian J*, and their derivatives.

Zero momentum, A_b v_b + A_q dq = 0, gives the spacecraft's twist v_b = -X dq, X = A_b^-1 A_q.
The tip moves with J_b v_b + J_q dq = J* dq, hence

    J* = J_q - J_b A_b^-1 A_q        (equations (1) and (35) by another route).

Only the free components of v_b count, the first f of six: all six if the spacecraft floats, the
three linear ones if its attitude is controlled, none if it is fixed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike
from spacearm.errors import ModelError, listed, require_known
from spacearm.model.arguments import BaseMode, free_components
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import LWA
from spacearm.model.joints import joint_vector
from spacearm.results import Cell, Description, Measure, Result, Table, without_noise
from spacearm.signatures import checked


class MomentumMatrix(Result):
    """The centroidal momentum matrix [A_b A_q]: h = A_b v_b + A_q dq.

    h is the momentum [linear; angular about the system CM] in inertial axes. Spinning wheels add
    their own, `Configuration.stored`.

    Iterating over it gives A_b and A_q.

    Attributes:
        arm: The arm.
        A_b: (6, 6) acts on the spacecraft's twist in inertial axes [kg, kg m, kg m^2].
        A_q: (6, n) acts on the joint rates.
    """

    arm: SpaceArm
    A_b: Array
    A_q: Array

    def __iter__(self) -> Iterator[Array]:
        return iter((self.A_b, self.A_q))

    def describe(self) -> Description:
        """Describe the momentum that unit velocities bring."""
        columns = ("", *(f"v{a}" for a in "xyz"), *(f"w{a}" for a in "xyz"), *self.arm.joint_names)
        names = [f"{of} {a}" for of in ("momentum", "angular momentum") for a in "xyz"]
        blocks = np.hstack((self.A_b, self.A_q))
        rows: list[list[Cell]] = [
            [name, *map(float, without_noise(row))] for name, row in zip(names, blocks, strict=True)
        ]
        return Description(
            title=f"{self.arm.name}, momentum of unit velocities",
            notes=["kg m/s, kg m²/s about the system CM, of unit rates in SI units; inertial axes"],
            tables=[Table(columns, rows)],
        )


@checked
def momentum_matrix(cfg: Configuration) -> MomentumMatrix:
    """Compute the centroidal momentum matrix, split into its base and joint blocks.

    The spacecraft's twist v_b is that of the spacecraft frame's origin, in inertial axes.
    A_b = [[M 1, -M [c]x], [0, I_c]] with c from the spacecraft origin to the system CM and I_c
    the locked inertia about the system CM, so that det(A_b) = M^3 det(D) with D of (33c).

    Source: theory of the centroidal momentum matrix in Orin, Goswami & Lee, Auton. Robots 35,
    161-176 (2013), DOI 10.1007/s10514-013-9341-4.

    Args:
        cfg: The configuration.

    Returns:
        Both blocks; `A_b, A_q = momentum_matrix(cfg)`.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> A_b, A_q = sa.momentum_matrix(cfg)
        >>> A_b.shape, A_q.shape, A_b[0, 0].round(9)  # the total mass [kg]
        ((6, 6), (6, 2), np.float64(47.0))
    """
    R = cfg.base.rotation
    A = cfg.A
    base = np.hstack((A[:, :3] @ R.T, A[:, 3:6] @ R.T))
    base.flags.writeable = False
    return MomentumMatrix(cfg.arm, base, A[:, 6:])


@checked
def base_velocity(cfg: Configuration, dq: ArrayLike) -> Array:
    """Compute the spacecraft's twist from the momentum: v_b = A_b^-1 (h - h_w - A_q dq).

    h is the total momentum (`Configuration.momentum`), h_w the part that the wheels hold
    (`Configuration.stored`). At zero momentum the angular part is equation (33c) of Papadopoulos &
    Dubowsky (1993), w_0 = -D^-1 D_q dq.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].

    Returns:
        (6,) twist [linear [m/s]; angular [rad/s]] of the spacecraft frame's origin, inertial axes.

    Raises:
        ConfigurationError: dq has the wrong shape or is not finite.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.base_velocity(cfg, [0.1, 0.2])[5].round(4)  # the spacecraft turns back [rad/s]
        np.float64(-0.0597)
    """
    A_b, A_q = momentum_matrix(cfg)
    h = cfg.momentum - cfg.stored
    return solve_locked(A_b, h - A_q @ joint_vector(cfg.arm, dq, "dq"))


def drift_of(momentum: Array, impulse: Array, brought: Array, free: int) -> float:
    """Return the change of the momentum that is kept, over what the joints alone brought.

    Args:
        momentum: (m, 6) momentum over time.
        impulse: (m, 6) what wrenches added to it.
        brought: (m, 6) momentum that the joint rates bring with the spacecraft at rest.
        free: How many components are kept.
    """
    change = np.abs((momentum - impulse - momentum[0])[:, :free]).max(initial=0.0)
    sizes = (np.abs(h[:, :free]).max(initial=0.0) for h in (brought, momentum[:1], impulse))
    most = max(sizes)
    return float(change / most) if most > 0.0 else 0.0


def solve_locked(A_b: Array, b: Array) -> Array:
    """Compute A_b^-1 b, A_b the inertia of the system with its joints locked.

    Args:
        A_b: (..., f, f) the part of the momentum matrix for the twist of the spacecraft; or D.
        b: (f,) or (..., f, k) momenta.

    Raises:
        ModelError: A_b is singular within rounding.
    """
    try:
        return np.asarray(np.linalg.solve(A_b, b))
    except np.linalg.LinAlgError:
        raise ModelError(
            "the inertia of the system with its joints locked is singular within rounding: its "
            "masses or lengths differ by more orders of magnitude than double precision holds; "
            "correct those that loading with check='error' names"
        ) from None


def base_response(A: Array, f: int = 6) -> Array:
    """Compute X = A_b^-1 A_q: the spacecraft moves with v_b = -X dq at zero momentum.

    Args:
        A: (6, 6 + n) the momentum matrix [A_b A_q].
        f: Number of free components of v_b.

    Returns:
        (f, n) X.
    """
    return solve_locked(A[:f, :f], A[:f, 6:])


@checked
def generalized_jacobian(cfg: Configuration, *, mode: BaseMode = "free-floating") -> Array:
    """Compute J* with [rdot_E; w_E] = J* dq at zero momentum, equation (35).

    Papadopoulos & Dubowsky, J. Dyn. Sys. Meas. Control 115(1), 44-52 (1993),
    DOI 10.1115/1.2897406; Umetani & Yoshida, IEEE Trans. Robot. Autom. 5(3), 303-314 (1989),
    DOI 10.1109/70.34766. `Barycentric.generalized_jacobian` computes the same by the paper's
    own equations.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does: "free-floating" (linear and angular momentum zero),
            "attitude-controlled" (w_0 = 0, linear momentum zero: section VI of the paper) or
            "fixed" (the earth-bound arm).

    Returns:
        (6, n) J*, rows [linear [m/rad]; angular], inertial axes, for the tip frame's origin. For
        several tips (6 tips, n), stacked in the order of `arm.tips`.

    Raises:
        ConfigurationError: `mode` is none of the three.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.generalized_jacobian(cfg)[:2].round(3)
        array([[-0.698, -0.865],
               [ 0.339, -0.042]])
    """
    f = free_components(mode)
    return cfg.J[:, 6:] - cfg.J[:, :f] @ base_response(cfg.A, f)


@checked
def fixed_base_jacobian(cfg: Configuration) -> Array:
    """Return J_q, the Jacobian of the same arm on a fixed base.

    Args:
        cfg: The configuration.

    Returns:
        (6, n) Jacobian, rows [linear; angular], inertial axes, for the tip frame's origin.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.fixed_base_jacobian(cfg)[:2].round(3)
        array([[-1.293, -0.997],
               [ 1.026,  0.071]])
    """
    return generalized_jacobian(cfg, mode="fixed")


class PrescribedMotion(Result):
    """The tip's twist J dq + drift while some joints move at prescribed rates.

    Attributes:
        arm: The arm.
        joints: The other joints, whose rates dq are free, in the model's order.
        jacobian: (6, m) their columns of J*, rows [linear; angular], inertial axes; stacked for
            several tips.
        drift: (6,) the tip's twist at dq = 0, from the prescribed rates and the momentum.
    """

    arm: SpaceArm
    joints: tuple[str, ...]
    jacobian: Array
    drift: Array

    def describe(self) -> Description:
        """Describe the tip's twist by the drift and unit rates of each free joint."""
        parts = {"velocity": "m/s", "angular velocity": "rad/s"}
        tips = self.arm.tips if len(self.arm.tips) > 1 else ("tip",)
        rows: list[list[Cell]] = [
            [f"{tip}, {name}", *(Measure(column, unit) for column in part)]
            for tip, own in zip(tips, self._parts(), strict=True)
            for (name, unit), part in zip(parts.items(), own, strict=True)
        ]
        columns = ("", "drift", *(f"unit rate of {name}" for name in self.joints))
        return Description(
            title=f"{self.arm.name}, while other joints than {listed(self.joints)} are prescribed",
            notes=["inertial axes; the twist of the tip is the drift and the free joints' part"],
            tables=[Table(columns, rows)],
        )

    def _parts(self) -> Array:
        """Return drift and columns by tip and part: (tips, 2, 1 + m, 3)."""
        both = np.column_stack((self.drift, self.jacobian))
        return both.reshape(-1, 2, 3, both.shape[1]).swapaxes(2, 3)


@checked
def prescribed_motion(
    cfg: Configuration, rates: Mapping[str, float], *, mode: BaseMode = "free-floating"
) -> PrescribedMotion:
    """Split J* into the columns of free joints and the drift of prescribed ones.

    The prescribed joints may be those of a second arm. With momentum h the tip's twist is
    J* dq + J_b A_b^-1 h; components of h that a held spacecraft takes up do not count.

    Args:
        cfg: The configuration.
        rates: Rates [rad/s] or [m/s] of the prescribed joints by name; zero for one that rests.
        mode: What the spacecraft does; see `generalized_jacobian`.

    Returns:
        Columns of the free joints and the drift: twist = jacobian @ dq + drift.

    Raises:
        ConfigurationError: A joint does not exist, or a value is not finite.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> motion = sa.prescribed_motion(cfg, {"joint_1": 0.1})
        >>> motion.joints, motion.drift[:2].round(4)
        (('joint_2',), array([-0.0698,  0.0339]))
    """
    arm, f = cfg.arm, free_components(mode)
    require_known("joint", rates, arm.joint_names, "rates: ")
    dq = joint_vector(arm, [rates.get(name, 0.0) for name in arm.joint_names], "the rate")
    J = generalized_jacobian(cfg, mode=mode)
    h = (cfg.momentum - cfg.stored)[:f]
    free = [name not in rates for name in arm.joint_names]
    names = tuple(name for name in arm.joint_names if name not in rates)
    drift = J @ dq + cfg.J[:, :f] @ solve_locked(cfg.A[:f, :f], h)
    return PrescribedMotion(arm, names, J[:, free], drift)


@checked
def generalized_jacobian_derivative(
    cfg: Configuration, *, mode: BaseMode = "free-floating"
) -> Array:
    """Compute dJ*/dq_j for every joint j at constant spacecraft pose.

    It follows from dA/dq_j and dJ/dq_j, which Pinocchio computes analytically, by differentiating
    J* = J_q - J_b X with A_b X = A_q.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does; see `generalized_jacobian`.

    Returns:
        (n, 6, n): entry j is the partial derivative of J* with respect to q_j.

    Raises:
        ConfigurationError: `mode` is none of the three.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.generalized_jacobian_derivative(cfg).shape
        (2, 6, 2)
    """
    f = free_components(mode)
    dA, dJ = matrix_derivatives(cfg.arm, cfg.full_at_origin)
    X = base_response(cfg.A, f)
    dX = solve_locked(cfg.A[:f, :f], dA[:, :f, 6:] - dA[:, :f, :f] @ X)
    return np.asarray(dJ[..., 6:] - dJ[..., :f] @ X - cfg.J[:, :f] @ dX)


@checked
def generalized_jacobian_rate(cfg: Configuration, dq: ArrayLike) -> Array:
    """Compute dJ*/dt of the free-floating system for joint rates dq.

    The spacecraft moves as momentum conservation demands: the rate includes the turning of
    J* = diag(T_0, T_0) 0J*(q) with the attitude.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].

    Returns:
        (6, n) time derivative of J*, inertial axes.

    Raises:
        ConfigurationError: dq has the wrong shape or is not finite.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.generalized_jacobian_rate(cfg, [0.1, 0.2])[:2].round(3)
        array([[-0.062, -0.039],
               [-0.114, -0.185]])
    """
    dq = joint_vector(cfg.arm, dq, "dq")
    w_0 = pin.skew(base_velocity(cfg, dq)[3:])
    turning = np.kron(np.eye(2 * len(cfg.arm.tips)), w_0) @ generalized_jacobian(cfg)
    return np.tensordot(dq, generalized_jacobian_derivative(cfg), axes=1) + turning


def task_jacobian(
    cfg: Configuration, *, mode: BaseMode = "free-floating", axes: Array | None = None
) -> Array:
    """Compute the task's rows of J*, linear rows of mixed tasks divided by the task's length.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does; see `generalized_jacobian`.
        axes: (3, 3) columns: the axes along which the rows count, in inertial axes; the task axes
            if None.

    Returns:
        (k, n) task Jacobian.
    """
    return _task_rows(cfg, generalized_jacobian(cfg, mode=mode), axes)


def task_jacobian_derivative(
    cfg: Configuration, *, mode: BaseMode = "free-floating", axes: Array | None = None
) -> Array:
    """Compute the derivative (n, k, n) of `task_jacobian`: entry j is that with respect to q_j."""
    return _task_rows(cfg, generalized_jacobian_derivative(cfg, mode=mode), axes)


def singular_values(
    cfg: Configuration, *, mode: BaseMode = "free-floating", axes: Array | None = None
) -> Array:
    """Compute the singular values (k,) of the task Jacobian, largest first.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does; see `generalized_jacobian`.
        axes: (3, 3) columns: the axes along which the task's rows count, in inertial axes; the
            task axes if None.
    """
    return singular_values_of(task_jacobian(cfg, mode=mode, axes=axes))


def singular_values_of(J: Array) -> Array:
    """Return the k singular values of J (k, n), largest first; zeros at the end if n < k."""
    sigma = np.linalg.svd(J, compute_uv=False)
    return np.append(sigma, np.zeros(len(J) - len(sigma)))


def matrix_derivatives(arm: SpaceArm, full: Array) -> tuple[Array, Array]:
    """Compute dA/dq_j (n, 6, 6 + n) and dJ/dq_j (n, 6 tips, 6 + n).

    These are their rates at dq = e_j with the spacecraft at rest.

    Args:
        arm: The arm.
        full: (nq,) configuration of its Pinocchio model.
    """
    model, data, dA, dJ = arm.model, arm.borrow(), [], []
    for dq in np.eye(arm.n):
        v = np.concatenate((np.zeros(6), arm.all_rates(dq)))
        dA.append(arm.project(pin.computeCentroidalMapTimeVariation(model, data, full, v)))
        pin.computeJointJacobiansTimeVariation(model, data, full, v)
        rates = [pin.getFrameJacobianTimeVariation(model, data, tip, LWA) for tip in arm.tip_frames]
        dJ.append(arm.project(np.vstack(rates)))
    arm.give_back(data)
    return np.array(dA), np.array(dJ)


def _task_rows(cfg: Configuration, J: Array, axes: Array | None) -> Array:
    """Take the task's rows of J (..., 6, n), scaled."""
    task = cfg.arm.task
    along = task.axes(cfg.base.rotation) if axes is None else axes
    return task.scale * task.components(J, along)


def probes(arm: SpaceArm) -> list[Configuration]:
    """Return a few random configurations."""
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (8, arm.n))
    return [arm.at(q) for q in Q]


def plane_of_motion(arm: SpaceArm) -> int | None:
    """Return the normal axis of a planar arm whose inertias keep it in the plane, else None."""
    normal = arm.tree.plane_normal()
    if normal is None:
        return None
    across = [i for i in range(3) if i != normal]
    A = np.array([cfg.A[3:] for cfg in probes(arm)])
    leaks = np.abs(A[:, across, 6:]).max() + np.abs(A[:, across, 3 + normal]).max()
    return normal if leaks <= 1e-12 * np.abs(A).max() else None


@lru_cache(maxsize=64)
def turning_axes(arm: SpaceArm) -> tuple[int, ...]:
    """Return the axes about which an arm turns its spacecraft: the normal of a plane, or all."""
    normal = plane_of_motion(arm)
    return (0, 1, 2) if normal is None else (normal,)
