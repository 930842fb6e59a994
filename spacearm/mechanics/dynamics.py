"""Forward and inverse dynamics of a floating arm, and the impact of a grasp.

With the spacecraft's twist v_b and M = [[M_bb, M_bq], [M_qb, M_qq]] the equations of motion are
M (dv_b, ddq) + c = (F_b, tau), without gravity. Where conservation of momentum determines the
spacecraft's motion, eliminating dv_b leaves the *reduced form*

    H*(q) ddq + c*(q, dq) = tau,   H* = M_qq - M_qb M_bb^-1 M_bq = M_qq - A_q^T I_c^-1 A_q,

with I_c = diag(M 1, D) and the generalized inertia H*: Papadopoulos & Dubowsky, On the nature of
control algorithms for free-floating space manipulators (IEEE Trans. Robot. Autom., 1991).

The grasp of a moving target is a plastic impact: impulses at the tip fix the target to it in an
instant. With v = (v_b, dq), the target's twist t at the tip, the tip's Jacobian J and the target's
spatial inertia M_t at the tip, the impulse balances of arm and target add up to

    (M + J^T M_t J) v+ = M v- + J^T M_t t-,

the balance of generalized momentum with the mass matrix of the arm that holds the target. v+ is the
projection of (v-, t-) onto the motions in which the target is fixed to the tip, in the metric of
the kinetic energy, which therefore cannot grow. Braked joints add the constraint dq+ = 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
import pinocchio as pin
import scipy

from spacearm import results
from spacearm.arrays import Array, ArrayLike, finite, positive
from spacearm.errors import ModelError, require_known
from spacearm.model.arguments import BaseMode, free_components
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import LWA
from spacearm.model.joints import joint_vector
from spacearm.results import Description, Measure, Result
from spacearm.signatures import checked

#: Link name -> (6,) [force [N]; torque [N m]] at the origin of the link's frame, inertial axes.
Wrenches = Mapping[str, ArrayLike]

M_BB = "the spacecraft's block M_bb of the mass matrix"
H_STAR = "the generalized inertia H*"
D_LOCKED = "the locked inertia D about the system CM"


class Dynamics(Result):
    """Joint accelerations and torques of one state, with the spacecraft's motion.

    Attributes:
        arm: The arm.
        ddq: (n,) joint accelerations [rad/s^2] or [m/s^2].
        tau: (n,) joint torques [N m] or forces [N].
        base_acceleration: (6,) acceleration of the spacecraft frame's origin, [linear [m/s^2];
            angular [rad/s^2]], inertial axes.
        reaction: (6,) external wrench that holds the spacecraft, [force [N]; torque [N m]] at the
            origin of its frame, inertial axes. For an attitude-controlled spacecraft it is the
            torque that wheels or thrusters must give, for a free-floating one zero.
        twist: (6,) twist of the spacecraft in this state, inertial axes.
    """

    arm: SpaceArm
    ddq: Array
    tau: Array
    base_acceleration: Array
    reaction: Array
    twist: Array

    not_checked = "limits of joints and torques, collisions"

    def describe(self) -> Description:
        """Describe accelerations, torques and the wrench that holds the spacecraft."""
        slides = self.arm.slides
        forces = zip(results.without_noise(self.tau), slides, strict=True)
        columns: dict[results.Column | str, Sequence[results.Cell]] = {
            "joint": self.arm.joint_names,
            "acceleration": results.joint_measures(self.ddq, slides, per="/s²"),
            "torque or force": [Measure(x, "N" if slide else "N m") for x, slide in forces],
        }
        facts: dict[str, results.Cell] = {
            "acceleration": Measure(self.base_acceleration[:3], "m/s²"),
            "angular acceleration": Measure(self.base_acceleration[3:], "rad/s²"),
            "velocity": Measure(self.twist[:3], "m/s"),
            "angular velocity": Measure(self.twist[3:], "rad/s"),
            "force that holds it": Measure(self.reaction[:3], "N"),
            "torque that holds it": Measure(self.reaction[3:], "N m"),
        }
        return Description(
            title=f"{self.arm.name}, dynamics of one state",
            notes=["inertial axes"],
            tables=[results.Table.by_columns(columns), results.Table.facts(facts, "Spacecraft")],
        )


@checked
def generalized_inertia(cfg: Configuration, *, mode: BaseMode = "free-floating") -> Array:
    """Compute the generalized inertia H* = M_qq - M_qb M_bb^-1 M_bq.

    Args:
        cfg: The configuration.
        mode: What the spacecraft does; see `generalized_jacobian`. The inertia of an
            attitude-controlled or fixed spacecraft counts as infinite in the components that are
            held.

    Returns:
        (n, n) H*, symmetric and positive definite [kg m^2], [kg m] or [kg].

    Raises:
        ModelError: The mass matrix is not positive definite.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.generalized_inertia(cfg).round(3)
        array([[2.349, 0.796],
               [0.796, 0.83 ]])
    """
    f = free_components(mode)
    M = mass_matrix(cfg)
    H = M[6:, 6:] - M[6:, :f] @ solve(cfg.arm, M[:f, :f], M[:f, 6:], M_BB)
    require_positive_definite(cfg.arm, H, H_STAR)
    return 0.5 * (H + H.T)


@checked
def forward_dynamics(
    cfg: Configuration,
    dq: ArrayLike,
    tau: ArrayLike,
    *,
    mode: BaseMode = "free-floating",
    wrenches: Wrenches | None = None,
) -> Dynamics:
    """Compute the accelerations under joint torques; of many states, see `joint_accelerations`.

    Wheels keep their rates relative to the links that carry them, by their motors.

    Args:
        cfg: The configuration. Only the linear part of its momentum counts for an
            attitude-controlled spacecraft, nothing for a fixed one.
        dq: (n,) joint rates [rad/s] or [m/s].
        tau: (n,) joint torques [N m] or forces [N].
        mode: What the spacecraft does; see `generalized_jacobian`.
        wrenches: External wrenches on links (contacts, thrusters).

    Returns:
        The accelerations, and what holds the spacecraft.

    Raises:
        ConfigurationError: An argument has the wrong shape, is not finite or names no link.
        ModelError: The mass matrix is not positive definite.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.forward_dynamics(cfg, dq=[0, 0], tau=[1, 0]).ddq.round(4)
        array([ 0.6307, -0.6049])
    """
    f, tau = free_components(mode), joint_vector(cfg.arm, tau, "tau")
    v, M, c, X = _state(cfg, generalized_velocity(cfg, dq, mode), wrenches, f)
    H = M[6:, 6:] - M[6:, :f] @ X[:, :-1]
    c_star = c[6:] - M[6:, :f] @ X[:, -1]
    return _dynamics(cfg, v, M, c, X, solve(cfg.arm, H, tau - c_star, H_STAR))


@checked
def inverse_dynamics(
    cfg: Configuration,
    dq: ArrayLike,
    ddq: ArrayLike,
    *,
    mode: BaseMode = "free-floating",
    wrenches: Wrenches | None = None,
) -> Dynamics:
    """Compute the joint torques for given joint accelerations.

    The spacecraft moves as the momentum of the configuration and its mode demand.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].
        ddq: (n,) joint accelerations [rad/s^2] or [m/s^2].
        mode: As in `forward_dynamics`.
        wrenches: As in `forward_dynamics`.

    Returns:
        The torques, and what holds the spacecraft.

    Raises:
        ConfigurationError: An argument has the wrong shape, is not finite or names no link.
        ModelError: The mass matrix of the spacecraft's motion is not positive definite.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> held = sa.inverse_dynamics(cfg, [0, 0], [1, 0], mode="attitude-controlled")
        >>> held.reaction[5].round(3)  # torque that holds the attitude [N m]
        np.float64(7.802)
    """
    ddq = joint_vector(cfg.arm, ddq, "ddq")
    v = generalized_velocity(cfg, dq, mode)
    return _dynamics(cfg, *_state(cfg, v, wrenches, free_components(mode)), ddq)


@checked
def kinetic_energy(cfg: Configuration, dq: ArrayLike, *, mode: BaseMode = "free-floating") -> float:
    """Compute the kinetic energy of all bodies [J], without the spin of wheels.

    Args:
        cfg: The configuration.
        dq: (n,) joint rates [rad/s] or [m/s].
        mode: As in `forward_dynamics`.

    Returns:
        The energy [J].

    Raises:
        ConfigurationError: An argument has the wrong shape or is not finite.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> round(sa.kinetic_energy(cfg, [0.1, 0.2]), 4)
        0.0443
    """
    v = generalized_velocity(cfg, dq, mode)
    return float(0.5 * v @ mass_matrix(cfg) @ v)


def spacecraft_twist(cfg: Configuration, dq: ArrayLike, mode: BaseMode = "free-floating") -> Array:
    """Return the spacecraft's twist (6,) in any mode, inertial axes; see `forward_dynamics`."""
    return in_inertial_axes(cfg, generalized_velocity(cfg, dq, mode)[:6])


def in_inertial_axes(cfg: Configuration, twists: Array) -> Array:
    """Turn twists or wrenches (..., 6) from spacecraft axes to inertial axes."""
    turned = twists.reshape(-1, 3) @ cfg.base.rotation.T
    return turned.reshape(twists.shape)


def generalized_velocity(
    cfg: Configuration, dq: ArrayLike, mode: BaseMode = "free-floating"
) -> Array:
    """Return (6 + n,) the spacecraft's twist in its own axes, from the momentum, and the rates.

    Raises:
        ModelError: The momentum matrix is singular.
    """
    f, dq = free_components(mode), joint_vector(cfg.arm, dq, "dq")
    v = np.concatenate((np.zeros(6), dq))
    h = cfg.momentum - cfg.stored - cfg.A[:, 6:] @ dq
    if f:
        *_, v[:f], info = scipy.linalg.lapack.dgesv(cfg.A[:f, :f], h[:f])
        if info:
            D = cfg.A[3:, 3:6] @ cfg.base.rotation.T
            raise not_positive_definite(cfg.arm, D, D_LOCKED)
    return v


def bias_forces(cfg: Configuration, v: Array, wrenches: Wrenches | None) -> Array:
    """Compute c (6 + n,) of M (dv_b, ddq) + c = (reaction, tau), external wrenches included."""
    arm = cfg.arm
    full = np.concatenate((v[:6], arm.all_rates(v[6:])))
    data = arm.borrow()
    c = np.array(pin.rnea(arm.model, data, cfg.full_at_origin, full, np.zeros_like(full)))
    c = c if arm.coupling is None else arm.project(c[None])[0]
    for link, values in (wrenches or {}).items():
        require_known("link", link, arm.tree.links)
        wrench = finite(values, (6,), f"the wrench on {link!r}", "[force [N]; torque [N m]]")
        frame = arm.model.getFrameId(link, pin.BODY)
        J = pin.computeFrameJacobian(arm.model, data, cfg.full_at_origin, frame, LWA)
        c = c - arm.project(J).T @ wrench
    for wheel, spin in zip(arm.wheels, cfg.wheels, strict=True):
        frame, q = wheel.frame, cfg.full_at_origin
        J = pin.computeFrameJacobian(arm.model, data, q, frame, pin.LOCAL)[3:]
        c = c + arm.project(J).T @ np.cross(J @ full, spin * wheel.axis)  # the wheel's gyration
    arm.give_back(data)
    return c


def motor_reactions(cfg: Configuration, torques: Array) -> Array:
    """Compute the generalized forces (6 + n,) by which the motors of wheels push off.

    Args:
        cfg: The configuration.
        torques: (w,) what each wheel takes up [N m].
    """
    arm, data = cfg.arm, cfg.arm.borrow()
    force = np.zeros(6 + arm.n)
    for wheel, torque in zip(arm.wheels, torques, strict=True):
        args = arm.model, data, cfg.full_at_origin, wheel.frame, pin.LOCAL
        force -= arm.project(pin.computeFrameJacobian(*args)[3:]).T @ (torque * wheel.axis)
    arm.give_back(data)
    return force


def _state(
    cfg: Configuration, v: Array, wrenches: Wrenches | None, f: int
) -> tuple[Array, Array, Array, Array]:
    """Return v, M, c and X = M_bb^-1 [M_bq, c_b] (f, n + 1), with which dv_b = -X (ddq, 1)."""
    M, c = mass_matrix(cfg), bias_forces(cfg, v, wrenches)
    return v, M, c, solve(cfg.arm, M[:f, :f], np.column_stack((M[:f, 6:], c[:f])), M_BB)


def _dynamics(cfg: Configuration, v: Array, M: Array, c: Array, X: Array, ddq: Array) -> Dynamics:
    """Assemble the result from the joint accelerations."""
    f = len(X)
    a = np.concatenate((np.zeros(6), ddq))
    a[:f] = -X @ np.append(ddq, 1.0)
    force = M @ a + c
    force[:f] = 0.0
    a[:3] += pin.skew(v[3:6]) @ v[:3]  # from spatial to classical acceleration
    acceleration, reaction, twist = in_inertial_axes(cfg, np.array((a[:6], force[:6], v[:6])))
    return Dynamics(cfg.arm, ddq, force[6:], acceleration, reaction, twist)


def mass_matrix(cfg: Configuration) -> Array:
    """Compute the mass matrix M (6 + n, 6 + n), the spacecraft's twist in its own axes."""
    arm = cfg.arm
    data = arm.borrow()
    upper = np.triu(pin.crba(arm.model, data, cfg.full_at_origin))
    arm.give_back(data)
    M = upper + upper.T
    np.fill_diagonal(M, upper.diagonal())
    return M if arm.coupling is None else arm.project(arm.project(M).T)


def require_positive_definite(arm: SpaceArm, M: Array, name: str) -> None:
    """Refuse a matrix of inertias that is not positive definite; M may be (0, 0).

    Raises:
        ModelError: It is not; says so of `name`, with its least eigenvalue.
    """
    solve(arm, M, np.zeros(len(M)), name)


def solve(arm: SpaceArm, M: Array, b: Array, name: str) -> Array:
    """Compute M^-1 b of a symmetric positive definite M by Cholesky factors.

    Raises:
        ModelError: M, which is called `name`, is not positive definite.
    """
    if not len(M):
        return b
    _, x, info = scipy.linalg.lapack.dposv(M, b)
    if info:
        raise not_positive_definite(arm, M, name)
    return x


def not_positive_definite(arm: SpaceArm, M: Array, name: str) -> ModelError:
    """Return the error for a matrix of inertias that no rigid bodies can have."""
    least = np.linalg.eigvalsh(0.5 * (M + M.T))[0]
    return ModelError(
        f"{arm.name}: {name} is not positive definite (least eigenvalue {least:.3g}): no rigid "
        "bodies have such masses and inertias; correct those that loading with check='error' "
        "names, or replace them"
    )


JointState = Literal["free", "braked"]


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

    not_checked = "forces of the contact, limits of the motors, collisions"

    def describe(self) -> Description:
        """Describe the velocities, the momentum and the impulse of the grasp."""
        cfg, angular = self.configuration, self.twist[3:]
        rates = results.joint_measures(self.dq, cfg.arm.slides, per="/s")
        facts: dict[str, results.Cell] = {
            "spacecraft, velocity": Measure(self.twist[:3], "m/s"),
            "spacecraft, angular velocity": Measure(angular, "rad/s"),
            "momentum": Measure(self.momentum[:3], "kg m/s"),
            "angular momentum about the CM": Measure(self.momentum[3:], "kg m²/s"),
            "impulse on the tip": Measure(self.impulse[:3], "N s"),
            "angular impulse on the tip": Measure(self.impulse[3:], "N m s"),
            **dict(zip(cfg.arm.joint_names, rates, strict=True)),
        }
        turn = np.degrees(np.linalg.norm(angular))
        return Description(
            title=f"{cfg.arm.name} after the grasp",
            verdict=f"{self.energy_lost:.6g} J lost, the spacecraft turns at {turn:.3g}°/s",
            notes=["inertial axes; a plastic impact"],
            tables=[results.Table.facts(facts)],
        )


def momentum_and_torque(arm: SpaceArm, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
    """Compute D_q dq (p, 3) and its derivative, the attitude held: what wheels must take up.

    [N m s] and [N m], about the system CM, spacecraft axes.

    Args:
        arm: The arm.
        q: (p, n) joint positions [rad] or [m].
        dq: (p, n) rates.
        ddq: (p, n) accelerations.
    """
    model, data, full = arm.model, arm.borrow(), pin.neutral(arm.model)
    C = np.eye(arm.n) if arm.coupling is None else arm.coupling
    v, a = np.zeros((2, len(q), model.nv))
    v[:, 6:], a[:, 6:] = dq @ C.T, ddq @ C.T
    momentum, torque = np.empty((2, len(q), 3))
    for i, row in enumerate(q):
        full[7:] = arm.all_joints(row)
        pin.computeCentroidalMomentumTimeVariation(model, data, full, v[i], a[i])
        momentum[i], torque[i] = data.hg.angular, data.dhg.angular
    arm.give_back(data)
    return momentum, torque


@checked
def capture(
    cfg: Configuration,
    target_twist: ArrayLike,
    mass: float,
    inertia: ArrayLike | None = None,
    com: ArrayLike = (0.0, 0.0, 0.0),
    *,
    dq: ArrayLike | None = None,
    joints: JointState = "free",
) -> Capture:
    """Compute the velocities just after the tip has grasped a moving, tumbling target.

    The grasp is a plastic impact at the tip,

        (M + J^T M_t J) v+ = M v- + J^T M_t t-,

    with v = (v_b, dq), the target's twist t and spatial inertia M_t at the tip: linear and angular
    momentum of arm and target together are conserved. Wheels keep what they hold.

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
        UnsupportedError: The arm has several tips.

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> sa.capture(cfg, [0.02, 0, 0, 0, 0, 0.03], mass=5.0)
        Capture(planar2 after the grasp: 0.000164513 J lost, the spacecraft turns at 0.0114°/s)
    """
    rates = np.zeros(cfg.arm.n) if dq is None else dq
    mass = positive(mass, "mass", "mass [kg]")
    before = generalized_velocity(cfg, rates)
    held = cfg.arm.grasp(mass, inertia, com).at(cfg.q, base=cfg.base)
    R = cfg.tip.rotation
    lever = R @ finite(com, (3,), "com", "[m]")
    moments = np.zeros((3, 3)) if inertia is None else inertia
    I = finite(moments, (3, 3), "inertia", "[kg m^2]")
    M_t = pin.Inertia(mass, lever, R @ I @ R.T).matrix()
    t = finite(target_twist, (6,), "target_twist", "[linear [m/s]; angular [rad/s]]")
    t[:3] -= np.cross(t[3:], lever)
    M, M_held = mass_matrix(cfg), mass_matrix(held)
    require_positive_definite(cfg.arm, M, "the mass matrix M")
    h = M @ before + cfg.J.T @ M_t @ t
    f = len(h) if joints == "free" else 6
    after = np.zeros_like(h)
    after[:f] = solve(cfg.arm, M_held[:f, :f], h[:f], "the mass matrix with the target")
    dv, dt = after - before, cfg.J @ after - t
    held = held.with_wheels(cfg.wheels)  # which spin on as they do, relative to the spacecraft
    momentum = held.A @ after + held.stored
    return Capture(
        configuration=held.with_momentum(momentum),
        twist=in_inertial_axes(cfg, after[:6]),
        dq=after[6:],
        momentum=momentum,
        impulse=-M_t @ dt,
        energy_lost=float(dv @ M @ dv + dt @ M_t @ dt) / 2.0,
    )
