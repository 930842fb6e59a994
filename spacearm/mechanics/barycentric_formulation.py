"""The barycentric formulation of Papadopoulos & Dubowsky, equation by equation.

Dynamic Singularities in Free-Floating Space Manipulators, J. Dyn. Sys. Meas. Control 115(1), 44-52
(1993), DOI 10.1115/1.2897406; here for any joint axes and link frames.

Body 0 is the spacecraft, bodies 1..N the links, joint k joins body k-1 to body k; CM stands for
centre of mass. r_k goes from body k's CM to joint k+1, and l_k to joint k. For the body that
carries the tip E, r_E goes to the tip. All vectors are in spacecraft axes (the paper's left
superscript 0) unless said otherwise.

Nothing here uses the centroidal momentum matrix: the tests compare the two routes to J*.
"""

from __future__ import annotations

from itertools import count

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError, listed
from spacearm.model.arm import Configuration
from spacearm.results import Column, Description, Result, Table
from spacearm.signatures import checked


class VirtualManipulator(Result):
    """A chain of constant links from the system CM to the tip.

    Vafa & Dubowsky, Int. J. Robot. Res. 9(4), 3-21 (1990), DOI 10.1177/027836499000900401. Its
    first link turns with the spacecraft about the system CM (the virtual ground), link i with
    body i; its end is the tip in every posture.

    Attributes:
        ground: (3,) the system CM, inertial axes [m].
        links: (N + 1, 3) the vectors v_iN,E, inertial axes [m].
        jacobian: (6, n) of its end with the first link held still, [J12; J22], inertial axes:
            the Jacobian of the attitude-controlled system.
    """

    ground: Array
    links: Array
    jacobian: Array

    @property
    def points(self) -> Array:
        """(N + 2, 3) the ground, the virtual joints and the end, inertial frame [m]."""
        return self.ground + np.vstack((np.zeros(3), np.cumsum(self.links, axis=0)))

    @property
    def end(self) -> Array:
        """(3,) the end, which is the tip, inertial frame, equation (3) [m]."""
        return self.ground + self.links.sum(axis=0)

    def describe(self) -> Description:
        """Describe the links and the end of the chain."""
        rows = [(i, link, np.linalg.norm(link)) for i, link in enumerate(self.links)]
        return Description(
            title=f"{len(self.links)} links",
            verdict=f"end at {np.round(self.end, 6)} m",
            tables=[Table(("link", Column("vector", "m"), Column("length", "m")), rows)],
        )


class Barycentric(Result):
    """The quantities of section II of the paper at one configuration.

    Attributes:
        M: Total mass [kg].
        mu: (N + 2,) mass distribution mu_0..mu_(N+1), equation (7).
        r: (N + 1, 3) r_0..r_N [m]; zero for the last body, whose weight in (8) is zero.
        l: (N + 1, 3) l_0..l_N [m]; zero for the spacecraft, whose weight in (8) is zero.
        c: (N + 1, 3) barycentres c_i from the bodies' CMs, equation (8) [m].
        v: (N + 1, N + 1, 3) v[i, k] = v_ik, equation (12) [m].
        rho: (N + 1, 3) from the system CM to the bodies' CMs, equation (11) [m].
        v_E: (N + 1, 3) v_iN,E: the links of the virtual manipulator [m].
        D_ij: (N + 1, N + 1, 3, 3) equations (21)-(23) [kg m^2].
        D_j: (N + 1, 3, 3) sums of D_ij over i, equation (34b).
        D: (3, 3) sum of D_j: the inertia of the whole system about its CM, equation (34b). The
            angular momentum is D w_0 + D_q dq, equation (20).
        Dq: (3, n) D_q, equation (34b).
        F: (N + 1, 3, n) w_j = w_0 + F_j dq, equations (30) and (31).
        J11: (3, 3) equation (34a) [m].
        J12: (3, n) equation (34a) [m].
        J22: (3, n) equation (34a).
        T0: (3, 3) spacecraft attitude, spacecraft to inertial axes, equation (27).
        r_cm: (3,) system CM, inertial frame [m].
    """

    M: float
    mu: Array
    r: Array
    l: Array
    c: Array
    v: Array
    rho: Array
    v_E: Array
    D_ij: Array
    D_j: Array
    D: Array
    Dq: Array
    F: Array
    J11: Array
    J12: Array
    J22: Array
    T0: Array
    r_cm: Array

    def describe(self) -> Description:
        """Describe the mass distribution, the bodies' CMs and their barycentres."""
        columns = ("body", "mass distribution", Column("CM from the system CM", "m"),
                   Column("barycentre from its CM", "m"))  # fmt: skip
        bodies = zip(count(), self.mu, self.rho, self.c, strict=False)
        return Description(
            title=f"{len(self.c)} bodies",
            verdict=f"{self.M:.6g} kg",
            notes=["equations (7), (11) and (8), spacecraft axes"],
            tables=[Table(columns, list(bodies))],
        )

    @property
    def base_rates(self) -> Array:
        """(3, n) w-map: w_0 = -D^-1 D_q dq in spacecraft axes, equation (33c)."""
        return -np.linalg.solve(self.D, self.Dq)

    def generalized_jacobian(self) -> Array:
        """Compute J* = diag(T_0, T_0) 0J* (6, n), inertial axes, equation (35)."""
        w = self.base_rates
        return np.vstack((self.T0 @ (self.J11 @ w + self.J12), self.T0 @ (w + self.J22)))

    @property
    def virtual_manipulator(self) -> VirtualManipulator:
        """The virtual manipulator, from the barycentric vectors."""
        jacobian = np.vstack((self.T0 @ self.J12, self.T0 @ self.J22))
        return VirtualManipulator(self.r_cm, self.v_E @ self.T0.T, jacobian)


@checked
def barycentric(cfg: Configuration) -> Barycentric:
    """Compute the quantities of equations (2)-(35) at a configuration.

    Args:
        cfg: The configuration.

    Returns:
        All of these quantities, under the paper's symbols.

    Raises:
        UnsupportedError: The arm has a prismatic joint, or movable joints beside the chain that
            carries the tip. (Side branches with locked joints are part of the body they sit on.)

    Example:
        >>> import spacearm as sa
        >>> cfg = sa.load("planar2").at([0.3, 1.2])
        >>> b = sa.barycentric(cfg)
        >>> b.mu.round(4)  # equation (7)
        array([0.    , 0.8511, 0.9362, 1.    ])
        >>> bool(abs(b.generalized_jacobian() - sa.generalized_jacobian(cfg)).max() < 1e-12)
        True
    """
    chain = _Chain(cfg)
    N, m, M = chain.N, chain.m, float(chain.m.sum())
    r, l, p_E, tip = chain.r, chain.l, chain.p_E, chain.tip_body
    mu = np.concatenate(([0.0], np.cumsum(m) / M))  # (7)
    c = l * mu[:-1, None] + r * (1.0 - mu[1:, None])  # (8)
    c_star, r_star, l_star = -c, r - c, l - c  # (9)
    v = np.array([  # (12)
        [r_star[i] if i < k else c_star[i] if i == k else l_star[i] for k in range(N + 1)]
        for i in range(N + 1)
    ])  # fmt: skip
    rho = v.sum(axis=0)  # (11)
    v_E = v[:, tip].copy()
    v_E[tip] += p_E

    D_ij = np.empty((N + 1, N + 1, 3, 3))
    for i in range(N + 1):
        for j in range(N + 1):
            if i < j:  # (21)
                D_ij[i, j] = -M * _about(l_star[j], r_star[i])
            elif i > j:  # (23)
                D_ij[i, j] = -M * _about(r_star[j], l_star[i])
            else:  # (22)
                D_ij[i, i] = chain.I[i] + sum(m[k] * _about(v[i, k], v[i, k]) for k in range(N + 1))
    F = np.array(
        [np.where(np.arange(N) < j, chain.u.T, 0.0) @ chain.C for j in range(N + 1)]
    )  # (31)
    D_j = D_ij.sum(axis=0)  # (34b)
    D, Dq = D_j.sum(axis=0), np.einsum("jab,jbn->an", D_j, F)
    cross = [pin.skew(v_iE) for v_iE in v_E]
    J11, J22 = -sum(cross, np.zeros((3, 3))), F[tip]  # (34a)
    J12 = -sum((cross[i] @ F[i] for i in range(1, N + 1)), np.zeros(F[0].shape))
    r_cm = chain.T0 @ (chain.first_cm - rho[0]) + cfg.base.translation
    inertias = D_ij, D_j, D, Dq
    return Barycentric(
        M, mu, r, l, c, v, rho, v_E, *inertias, F, J11, J12, J22, T0=chain.T0, r_cm=r_cm
    )


def _about(a: Array, b: Array) -> Array:
    """Return (a . b) 1 - a b, which for a = b is the inertia of a unit mass at a."""
    return a @ b * np.eye(3) - np.outer(a, b)


def euler_parameters(axis: Array, angle: float) -> tuple[Array, float]:
    """Return e = a sin(theta / 2), n = cos(theta / 2) of a turn theta [rad] about a, (28)."""
    return axis * np.sin(angle / 2.0), float(np.cos(angle / 2.0))


def attitude(e: Array, n: float) -> Array:
    """Return T_0 = (n^2 - e^T e) 1 + 2 e e^T + 2 n [e]x (3, 3), equations (27) and (29)."""
    return (n * n - e @ e) * np.eye(3) + 2.0 * np.outer(e, e) + 2.0 * n * pin.skew(e)


def euler_parameter_rates(e: Array, n: float, w: Array) -> tuple[Array, float]:
    """Return edot = ([e]x + n 1) w / 2, ndot = -e^T w / 2 for w in spacecraft axes, (36)."""
    return (pin.skew(e) @ w + n * w) / 2.0, float(-e @ w) / 2.0


class _Chain:
    """Bodies, CMs and joints of a serial chain in the paper's notation, spacecraft axes.

    Attributes:
        N: Number of moving bodies.
        m: (N + 1,) masses.
        I: (N + 1, 3, 3) inertias about the bodies' CMs.
        u: (N, 3) joint axes.
        r: (N + 1, 3) from the CMs to the next joint.
        l: (N + 1, 3) from the CMs to the joint before.
        p_E: (3,) from the CM of the body that carries the tip to the tip.
        tip_body: Number of that body.
        C: (N, n) rates of the joints per rate of the arm's joints (mimic joints follow).
        first_cm: (3,) from the spacecraft frame's origin to the spacecraft's CM.
    """

    def __init__(self, cfg: Configuration) -> None:
        arm, model = cfg.arm, cfg.arm.model
        self.N = N = model.njoints - 2
        joints = [arm.tree.joints[name] for name in list(model.names)[2:]]
        if list(model.parents)[2:] != list(range(1, N + 1)):
            chain = {joint.name for joint in arm.tree.chain(arm.tip)}
            beside = [joint.name for joint in joints if joint.name not in chain]
            raise UnsupportedError(
                f"{arm.name}: joints beside the chain to the tip can move ({listed(beside)}); "
                "the barycentric formulation is for one chain: lock them with locked={...}, or use "
                "generalized_jacobian"
            )
        for joint in joints:
            if joint.kind == "prismatic":
                raise UnsupportedError(
                    f"{arm.name}: joint {joint.name!r} is prismatic; the barycentric vectors are "
                    "constant for revolute joints only: use generalized_jacobian"
                )
        bodies, frame = model.inertias[1:], model.frames[arm.tip_frame]
        angles = arm.all_joints(cfg.q)
        T = [np.eye(3)]  # body axes to spacecraft axes
        for k, joint in enumerate(joints, start=1):
            mounting = model.jointPlacements[k + 1].rotation
            T.append(T[-1] @ mounting @ attitude(*euler_parameters(joint.axis, angles[k - 1])))
        next_joint = [model.jointPlacements[k + 1].translation for k in range(1, N + 1)]
        lever = [body.lever for body in bodies]
        self.m = np.array([body.mass for body in bodies])
        self.I = np.array([T[k] @ body.inertia @ T[k].T for k, body in enumerate(bodies)])
        self.u = np.array([T[k] @ joint.axis for k, joint in enumerate(joints, start=1)])
        self.r = np.array([T[k] @ (next_joint[k] - lever[k]) for k in range(N)] + [np.zeros(3)])
        self.l = np.array([np.zeros(3)] + [-T[k] @ lever[k] for k in range(1, N + 1)])
        self.tip_body = frame.parentJoint - 1
        at = T[self.tip_body]
        self.p_E = at @ (frame.placement.translation - lever[self.tip_body])
        self.C = np.eye(N) if arm.coupling is None else arm.coupling
        self.first_cm = lever[0]
        *e, eta = pin.Quaternion(cfg.base.rotation).coeffs()
        self.T0 = attitude(np.array(e), eta)
