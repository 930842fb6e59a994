"""What was caught: mass, CM and inertia of the held body from measured rates.

With v = (v_b, dq), the measured rates at a time, the momentum of arm and held body about a fixed
point is

    H = (G(q) + K(q) M V(q)) v,   M = [[m 1, -[m c]x], [[m c]x, I]],

G that of the known arm, V v the twist of the tip in its own axes, K its axes and lever. M is
linear in the ten parameters m, m c and I of the body about the tip, and H, which nobody needs to
know, is kept. The estimate is that of maximum likelihood where all rates have noise. The residuals
are weighted by the noise that they carry, which depends on the body too, so that noisy rates do
not make it lighter than it is. See Murotsu, Senda, Ozaki & Tsujio, Parameter identification of
unknown object handled by free-flying space robot (J. Guid. Control Dyn. 17(3), 1994, DOI
10.2514/3.21225); bodies that can exist are parameterised as in Rucker & Wensing, Smooth
parameterization of rigid-body inertia (IEEE Robot. Autom. Lett. 7(2), 2022, DOI
10.1109/LRA.2022.3144517).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, RotationSpline

from spacearm.arrays import Array, ArrayLike, finite
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.mechanics.dynamics import generalized_velocity
from spacearm.model.arm import SpaceArm
from spacearm.motion.flights import Flight
from spacearm.motion.motion import Motion, Trajectory
from spacearm.results import Column, Description, Measure, Result, Table
from spacearm.signatures import checked, shown
from spacearm.uncertainty.intervals import UncertainArm, uncertain

#: The ten parameters, in Pinocchio's order: mass, mass times CM, inertia about the tip's origin.
NAMES = ("m", "m cx", "m cy", "m cz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
UNITS = ("kg", *("kg m",) * 3, *("kg m^2",) * 6)
#: Directions known to this share of the body, or better, are excited.
KNOWN = 0.2
#: Singular values below this share of the largest are rounding.
ROUNDING = 1e-9
#: Most evaluations of the residuals with their derivatives.
SWEEPS = 30
#: Radius of gyration of the ball that stands in where nothing is known, over the arm's length.
BALL = 0.1
#: Share of mass and inertia that those of the uncertain arm do not fall below.
LEAST = 1e-2


class Identified(Result, kw_only=True):
    """The body that a hand holds, from `sa.identify`.

    Attributes:
        arm: The arm, without the body.
        mass: Mass of the body [kg].
        com: (3,) its CM in the tip frame [m].
        inertia: (3, 3) its inertia about its CM, tip axes [kg m^2].
        parameters: (10,) estimates of m [kg], m c [kg m] and the inertia about the tip's origin [kg
            m^2], tip axes, as Ixx Ixy Iyy Ixz Iyz Izz. Mass, CM and inertia follow from them; if no
            body can have these values, from the most likely ones that a body can have.
        covariance: (10, 10) their covariance, as far as the motion excited them.
        unexcited: (k, 10) directions of the parameters that the motion did not excite; along them
            the body is a guess: the smallest change from a small ball.
        momentum: (6,) momentum of arm and body, [linear [kg m/s]; angular about the common CM
            [kg m^2/s]], inertial axes.
        misfit: Root mean square of the residuals over the noise: about 1 where the noise is as
            given and the arm as described. Without `noise` it is the noise that was found, taken
            as equal for all rates.
        rows: How many instants were measured.
    """

    arm: SpaceArm
    mass: float
    com: Array
    inertia: Array
    parameters: Array
    covariance: Array
    unexcited: Array
    momentum: Array
    misfit: float
    rows: int

    JSON: ClassVar[Mapping[str, str]] = {
        "mass": "held_mass",
        "com": "held_com",
        "inertia": "held_inertia",
        "parameters": "held_parameters",
        "rows": "instants",
    }

    @property
    def holding(self) -> SpaceArm:
        """The arm with the body in its hand."""
        return self.arm.grasp(self.mass, self.inertia, self.com)

    @property
    def sizes(self) -> Array:
        """(10,) sizes of the parameters: mass times powers of the radius of gyration at the tip."""
        return _sizes(self.mass, _gyration(pin.Inertia(self.mass, self.com, self.inertia)))

    @property
    def deviations(self) -> tuple[float, Array, Array]:
        """Standard deviations of mass [kg], CM (3,) [m] and principal moments (3,) [kg m^2].

        Infinite where a direction that the motion did not excite changes them.
        """
        body = pin.Inertia(self.mass, self.com, self.inertia)
        at, axes = body.toDynamicParameters(), np.linalg.eigh(self.inertia)[1]

        def told(parameters: Array) -> Array:
            other = pin.Inertia.FromDynamicParameters(parameters)
            moments = np.einsum("ji,jk,ki->i", axes, other.inertia, axes)
            return np.concatenate(([other.mass], other.lever, moments))

        steps = 1e-6 * np.diag(self.sizes)
        rates = [(told(at + step) - told(at - step)) / (2.0 * step.max()) for step in steps]
        J = np.array(rates).T
        sd = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", J, self.covariance, J), 0.0))
        if len(self.unexcited):
            moved = np.abs(J @ self.unexcited.T).max(axis=1)
            sd[moved > 1e-6 * np.abs(J).max(axis=1)] = np.inf
        return float(sd[0]), sd[1:4], sd[4:]

    def uncertain(self) -> UncertainArm:
        """Return the arm with the body, its parameters known as normal distributions.

        The factor of the inertia covers the principal moment that is known worst.

        Raises:
            UnsupportedError: The motion did not excite all that counts.
        """
        mass, com, moments = self.deviations
        if not np.isfinite([mass, *com, *moments]).all():
            raise UnsupportedError(
                f"the motion did not excite {_told(self.unexcited)} of the body; move the joints "
                "and turn the hand about more axes, and measure again"
            )
        arm = self.holding
        payload = next(link for link in arm.whole.links if link not in self.arm.whole.links)
        share = float((moments / np.linalg.eigvalsh(self.inertia)).max())
        spread = {
            "mass": _normal(self.mass, mass, LEAST * self.mass),
            "inertia": _normal(1.0, share, LEAST),
            "com": [_normal(0.0, float(sd), -np.inf) for sd in com],
        }
        return uncertain(arm, {payload: spread})

    not_checked = "errors of joint positions, poses and of the arm's own masses"

    def describe(self) -> Description:
        """Describe the body, how well it is known, and what was not excited."""
        mass, com, moments = self.deviations
        columns = (Column(""), Column("estimate"), Column("standard deviation"))
        values = [("mass", self.mass, mass, "kg")]
        values += [(f"CM {x}", c, s, "m") for x, c, s in zip("xyz", self.com, com, strict=True)]
        principal = np.linalg.eigvalsh(self.inertia)
        values += [
            (f"principal moment {i + 1}", I, s, "kg m^2")
            for i, (I, s) in enumerate(zip(principal, moments, strict=True))
        ]
        rows = [
            (name, Measure(x, unit), Measure(s, unit) if np.isfinite(s) else "not excited")
            for name, x, s, unit in values
        ]
        missing = f"not excited: {_told(self.unexcited)}" if len(self.unexcited) else ""
        return Description(
            title=f"what {self.arm.name} holds",
            verdict=f"{self.mass:.5g} kg" if np.isfinite(mass) else "its mass is not known",
            tone="caution" if missing else "good",
            notes=[f"{self.rows} instants, misfit {self.misfit:.2g}", *([missing] * bool(missing))],
            tables=[Table(columns, rows)],
        )


@checked
def identify(
    motion: Motion,
    arm: SpaceArm | None = None,
    *,
    dq: ArrayLike | None = None,
    twist: ArrayLike | None = None,
    noise: ArrayLike | None = None,
) -> Identified:
    """Identify the body that a floating arm holds, from measured joint rates and spacecraft rates.

    The momentum is linear in the body's ten inertial parameters, and it is conserved. No torque is
    needed, but nothing may push from outside, and the wheels must keep what they hold.

    Args:
        motion: What was measured: joint positions and poses of the spacecraft. From a `Flight` it
            uses what follows the last grasp.
        arm: The arm as it is known, without the body; that of the motion if None, of a flight
            that of its first phase.
        dq: (m, n) measured joint rates [rad/s] or [m/s]; those of the motion if None.
        twist: (m, 6) measured twists of the spacecraft, inertial axes; if None those of a
            simulation, else by splines through the poses.
        noise: (3,) standard deviations of the measured velocity of the spacecraft [m/s], of its
            angular velocity [rad/s], and of joint rates [rad/s] or [m/s]; if None they are taken as
            equal, and found from the residuals.

    Returns:
        The body, its covariance, and the directions that the motion did not excite.

    Raises:
        ConfigurationError: An argument has the wrong shape, or there are too few rows.
        UnsupportedError: The arm has several tips, the spacecraft does not float, or nothing is
            held at the end of the flight.
        NoSolutionError: The motion excites nothing.

    Example:
        >>> import numpy as np
        >>> import spacearm as sa
        >>> arm = sa.load("mda6")
        >>> start = arm.grasp(50.0, 4.0 * np.eye(3), (0.1, 0, 0.4)).at([0, 1, -1.5, -0.9, 0.3, 0])
        >>> run = sa.simulate(start, sa.JointPD(start.q + 0.5, kp=50, kd=60), 10.0)
        >>> found = sa.identify(run, arm)
        >>> round(found.mass, 3), found.com.round(3).tolist()
        (50.0, [0.1, 0.0, 0.4])
    """
    if isinstance(motion, Flight):
        arm = arm or motion.phases[0].arm
        motion = motion.phases[-1]
        if motion.arm.mass <= arm.mass:
            raise UnsupportedError(
                f"{arm.name} holds nothing at the end of the flight; give the phase in which it "
                "does, identify(flight.phases[i], arm)"
            )
    arm = arm or motion.arm
    arm.require_one_tip()
    if arm.joint_names != motion.arm.joint_names:
        raise ConfigurationError(
            f"arm {arm.name} has other joints than the motion, whose arm is {motion.arm.name}"
        )
    if motion.mode != "free-floating":
        raise UnsupportedError(f"the spacecraft is {motion.mode}; the momentum is kept afloat only")
    m, n = len(motion), arm.n
    if 6 * m < 17:
        raise ConfigurationError(f"the motion has {m} rows; give three or more")
    rates = motion.dq if dq is None else finite(dq, (m, n), "dq", "[rad/s] or [m/s]")
    twists = _twists(motion) if twist is None else finite(twist, (m, 6), "twist", "[m/s], [rad/s]")
    deviations = np.ones(3) if noise is None else finite(noise, (3,), "noise", "(deviations)")
    if deviations.min() <= 0.0:
        raise ConfigurationError(f"noise is {shown(noise)}; give three deviations above 0")
    data = _Data.of(arm, motion, rates, twists, np.repeat(deviations, (3, 3, n)))
    return _estimated(arm, data, noise is None)


class _Data(NamedTuple):
    """What was measured, and what is known of the arm there; see the module.

    Attributes:
        G: (m, 6, 6 + n) momentum of the arm about the point `about`.
        K: (m, 6, 6) from momentum about the tip in its own axes to that about the point.
        V: (m, 6, 6 + n) from rates to the twist of the tip in its own axes.
        v: (m, 6 + n) rates, the spacecraft's in its own axes.
        stored: (m, 6) what the wheels hold.
        noise: (6 + n,) standard deviations of the rates.
        about: (3,) the point [m].
        size: (10,) sizes of the ten parameters for a body of the arm's mass and length.
        com: (3,) CM of the arm [m], mass times it and the tip's pose, of the first row.
    """

    G: Array
    K: Array
    V: Array
    v: Array
    stored: Array
    noise: Array
    about: Array
    size: Array
    tip: pin.SE3
    com: Array

    @classmethod
    def of(cls, arm: SpaceArm, motion: Motion, dq: Array, twist: Array, noise: Array) -> _Data:
        """Return what was measured of a motion."""
        cfgs = [arm.at(q, base=motion[i].base) for i, q in enumerate(motion.q)]
        about = np.mean([cfg.com for cfg in cfgs], axis=0)
        wheels = getattr(motion, "wheels", np.zeros((len(cfgs), len(arm.wheels))))
        G, K, V, v = [], [], [], []
        for cfg, rates, moved in zip(cfgs, dq, twist, strict=True):
            R, hand = cfg.base.rotation, cfg.tip.rotation
            G.append(pin.SE3(np.eye(3), cfg.com - about).toDualActionMatrix() @ cfg.A)
            K.append(pin.SE3(hand, cfg.tip.translation - about).toDualActionMatrix())
            V.append(np.kron(np.eye(2), hand.T) @ cfg.J)
            v.append(np.concatenate((moved[:3] @ R, moved[3:] @ R, rates)))
        stored = [
            cfg.with_wheels(held).stored if arm.wheels else np.zeros(6)
            for cfg, held in zip(cfgs, wheels, strict=True)
        ]
        length = float(np.mean([np.linalg.norm(c.tip.translation - c.com) for c in cfgs]))
        return cls(
            np.array(G), np.array(K), np.array(V), np.array(v), np.array(stored), noise, about,
            _sizes(arm.mass, length), cfgs[0].tip, cfgs[0].com,
        )  # fmt: skip

    def columns(self) -> Array:
        """Return (m, 6, 10) what a unit of each parameter adds to the momentum."""
        units = np.array([spatial(one) for one in np.eye(10)])
        moved = np.einsum("mij,mj->mi", self.V, self.v)
        return np.einsum("mab,kbc,mc->mak", self.K, units, moved)

    def roots(self, parameters: Array) -> Array:
        """Return (m, 6, 6) inverse Cholesky factors of the noise of the momentum."""
        A = self.G + self.K @ spatial(parameters) @ self.V
        noisy = A * self.noise
        try:
            return np.linalg.inv(np.linalg.cholesky(noisy @ noisy.transpose(0, 2, 1)))
        except np.linalg.LinAlgError:
            raise ConfigurationError(
                f"noise is {self.noise[[0, 3, 6]]}, so that the noise of the momentum has a "
                "singular covariance in double precision; give deviations of similar sizes"
            ) from None


def _estimated(arm: SpaceArm, data: _Data, scaled: bool) -> Identified:
    """Return the estimate; `scaled` where the size of the noise is not known."""
    Y, own, size = data.columns(), np.einsum("mij,mj->mi", data.G, data.v) + data.stored, data.size
    m = len(own)
    regressor = np.concatenate((Y * size, np.broadcast_to(-np.eye(6), (m, 6, 6))), axis=2)

    def residual(x: Array) -> Array:
        r = own + regressor @ x
        return np.einsum("mij,mj->mi", data.roots(x[:10] * size), r).ravel()

    x = np.zeros(16)
    for _ in range(2):
        L = data.roots(x[:10] * size)
        rows, right = (L @ regressor).reshape(-1, 16), np.einsum("mij,mj->mi", L, own).ravel()
        lengths = np.linalg.norm(rows, axis=0)
        lengths = np.maximum(lengths, ROUNDING * lengths.max())
        x = -np.linalg.lstsq(rows / lengths, right, rcond=ROUNDING)[0] / lengths
    x = least_squares(residual, x, x_scale="jac", xtol=1e-9, ftol=1e-9, max_nfev=SWEEPS).x
    off = residual(x)
    misfit = float(np.sqrt(off @ off / (6 * m - 16)))
    rows = (data.roots(x[:10] * size) @ regressor).reshape(-1, 16)
    Q = np.linalg.qr(rows[:, 10:])[0]
    told = rows[:, :10] - Q @ (Q.T @ rows[:, :10])
    _, s, axes = np.linalg.svd(told, full_matrices=False)
    s = np.maximum(s, np.finfo(float).tiny)
    spread = (misfit if scaled else 1.0) / s
    still = arm.mass * np.linalg.norm(rows[:, 10:], ord=2)  # of rates of 1 m/s
    known = (s > ROUNDING * max(s[0], still)) & (spread < KNOWN * np.linalg.norm(x[:10]))
    if not known.any():
        raise NoSolutionError(
            "the motion excites none of the ten parameters of what the hand holds; move the "
            "joints, farther or faster"
        )
    covariance = (axes[known].T * spread[known] ** 2) @ axes[known]
    parameters = x[:10] * size
    body = _possible(x[:10], s, axes, known, size)
    tip, com = data.tip, data.com
    held = tip.act(body.lever)
    common = (arm.mass * com + body.mass * held) / (arm.mass + body.mass)
    H = x[10:]
    return Identified(
        arm=arm,
        mass=float(body.mass),
        com=np.array(body.lever),
        inertia=np.array(body.inertia),
        parameters=parameters,
        covariance=covariance * np.outer(size, size),
        unexcited=_unit(axes[~known] * size),
        momentum=np.append(H[:3], H[3:] - np.cross(common - data.about, H[:3])),
        misfit=misfit,
        rows=m,
    )


def _possible(x: Array, s: Array, axes: Array, known: Array, size: Array) -> pin.Inertia:
    """Return the most likely body that can exist.

    Args:
        x: (10,) estimates over their sizes.
        s: (10,) inverse deviations along the axes.
        axes: (10, 10) the axes, in rows.
        known: (10,) which of them the motion excited.
        size: (10,) sizes of the parameters.
    """
    pseudo = pin.PseudoInertia.FromDynamicParameters(x * size).toMatrix()
    if known.all() and np.linalg.eigvalsh(pseudo).min() > 0.0:
        return pin.Inertia.FromDynamicParameters(x * size)
    mass = max(float(axes[known].T[0] @ (axes[known] @ x)), BALL**2)
    ball = np.array([mass, 0, 0, 0, *(mass * BALL**2 * np.array([1, 0, 1, 0, 0, 1]))])
    wanted = np.where(known, axes @ x, axes @ ball)
    weights = np.where(known, s / s[0], 1e-3 * s[known].min() / s[0])

    def body(theta: Array) -> pin.Inertia:
        return pin.LogCholeskyParameters(theta).toInertia()

    def off(theta: Array) -> Array:
        return weights * (axes @ np.array(body(theta).toDynamicParameters()) - wanted)

    start = np.append(0.5 * np.log([mass, *[0.5 * BALL**2] * 3]), np.zeros(6))  # the ball
    theta = least_squares(off, start, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    found = np.array(body(theta).toDynamicParameters()) * size
    return pin.Inertia.FromDynamicParameters(found)


def spatial(parameters: Array) -> Array:
    """Return M (6, 6) of the ten parameters; see the module."""
    m, h = parameters[0], pin.skew(parameters[1:4])
    xx, xy, yy, xz, yz, zz = parameters[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.block([[m * np.eye(3), -h], [h, inertia]])


def _twists(motion: Motion) -> Array:
    """Return the twists (m, 6) of the spacecraft, inertial axes."""
    if isinstance(motion, Trajectory):
        rows = []
        for cfg, dq in zip(motion, motion.dq, strict=True):
            v = generalized_velocity(cfg, dq)[:6].reshape(2, 3)
            rows.append((v @ cfg.base.rotation.T).ravel())
        return np.array(rows)
    v = CubicSpline(motion.t, motion.base[:, :3])(motion.t, 1)
    turning = RotationSpline(motion.t, Rotation.from_quat(motion.base[:, 3:]))
    w = turning(motion.t, 1)  # in the axes of the spacecraft
    return np.hstack((v, turning(motion.t).apply(w)))


def _sizes(mass: float, length: float) -> Array:
    """Return the sizes (10,) of the parameters of a body of a mass and a length."""
    return mass * np.repeat([1.0, length, length**2], (1, 3, 6))


def _gyration(body: pin.Inertia) -> float:
    """Return a length of a body: its radius of gyration about the tip [m]."""
    about = float(np.trace(body.inertia)) / 2.0 + body.mass * float(body.lever @ body.lever)
    return float(np.sqrt(about / body.mass))


def _unit(rows: Array) -> Array:
    """Return rows of length 1."""
    return np.array(rows / np.linalg.norm(rows, axis=1, keepdims=True)).reshape(-1, 10)


def _normal(mean: float, sd: float, least: float) -> object:
    """Return a normal distribution cut at `least`."""
    from scipy.stats import truncnorm  # slow to import

    return truncnorm((least - mean) / sd, np.inf, mean, sd)


def _told(directions: Array) -> str:
    """Name directions of the parameters by their largest parts."""
    words = []
    for row in directions:
        most = np.abs(row).max()
        parts = [f"{x / most:+.2g} {name}" for x, name in zip(row, NAMES, strict=True)
                 if abs(x) > 0.1 * most]  # fmt: skip
        words.append(" ".join(parts))
    return "; ".join(words)
