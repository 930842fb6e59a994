"""Free rotation: how a rigid body turns without torque, in closed form at any time.

In principal axes the angular velocity is w_n = A_n cn(u), w_s = A_s sn(u), w_d = A_d dn(u) with u
= p t + u_0 (Jacobi; Landau & Lifshitz, Mechanics, section 37). Here d is the axis that the
rotation stays about, s the intermediate one and n the other. With l = I w and z = l / |l| in body
axes, one principal axis e turns about the momentum at the rate

    psi' = (2 T / |l| - w_e z_e) / (1 - z_e^2),

T being the kinetic energy. This is an even function of u with the period 2 K, so that its cosine
series, computed from samples of one period, converges geometrically and is integrated term by term.
Of d and n that axis is taken which stays farther from the momentum: psi' is smooth then, for a pure
spin and near axes of symmetry too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from spacearm.arrays import Array, ArrayLike

#: Share of the largest coefficient of a series below which its last ones are their own rounding.
TAIL = 1e-15
#: Most samples of a period.
MOST_SAMPLES = 2**16
#: Share of a mean up to which it and the next one are equal but for rounding.
ROUNDING = 1e-15
#: Least 1 - m: 0 would be that of a motion that ends in a spin about the middle axis.
LEAST = 1e-40


class _Spin(NamedTuple):
    """Angular velocity of a body without torque in principal axes, as elliptic functions.

    Attributes:
        axes: Numbers of the principal axes n, s and d.
        amplitudes: (3,) A_n, A_s, A_d, with the sign of w_d [rad/s].
        p: Derivative of u by time [1/s].
        u0: u at time 0.
        m1: 1 - m of the elliptic functions; m itself would lose it near the middle axis.
        half: Half their period, 2 K, which is that of psi'.
    """

    axes: tuple[int, int, int]
    amplitudes: Array
    p: float
    u0: float
    m1: float
    half: float

    def at(self, u: Array) -> Array:
        """Return the angular velocity (..., 3) at u, principal axes."""
        halves = np.rint(u / self.half)
        sign = 1.0 - 2.0 * np.remainder(halves, 2.0)
        sn, cn, dn = elliptic(u - self.half * halves, self.m1)
        w = np.empty((*u.shape, 3))
        w[..., self.axes] = np.stack((sign * cn, sign * sn, dn), axis=-1) * self.amplitudes
        return w


def elliptic(u: Array, m1: float) -> tuple[Array, Array, Array]:
    """Compute sn, cn and dn of u, from -K to K, by descending Landen transformations.

    SciPy's functions take m, in which a 1 - m below 1e-16 is lost. See DLMF, 22.20(ii).

    Args:
        u: Arguments.
        m1: 1 - m, above zero.
    """
    a, b, steps = 1.0, math.sqrt(m1), list[tuple[float, float, float]]()
    while a - b > ROUNDING * a:
        a, b, c = (a + b) / 2.0, math.sqrt(a * b), (a - b) / 2.0
        steps.append((a, b, c))
    phi = 2.0 ** len(steps) * a * u
    for a, b, c in reversed(steps):
        sin, cos = np.sin(phi), np.cos(phi)
        phi = (phi + np.arctan2(c * sin, np.hypot(a * cos, b * sin))) / 2.0  # arcsin(c sin / a)
    sn, cn = np.sin(phi), np.cos(phi)
    return sn, cn, np.sqrt(cn**2 + m1 * sn**2)


def _spin(moments: Array, w: Array) -> _Spin | None:
    """Return the motion from w (3,) on, for rising principal moments (3,); None: a steady spin."""
    # |l|^2 - 2 T I_s decides about which axis, without a difference of large numbers
    above = moments[2] * (moments[2] - moments[1]) * w[2] ** 2
    below = moments[0] * (moments[1] - moments[0]) * w[0] ** 2
    axes = (0, 1, 2) if above > below else (2, 1, 0)
    (I_n, I_s, I_d), (w_n, w_s, w_d) = moments[list(axes)], w[list(axes)]
    if I_d == I_s or not (w_n or w_s) or not (w_d or w_s):
        return None
    to_s = math.sqrt(I_s * (I_d - I_s) / (I_n * (I_d - I_n)))
    to_d = math.sqrt(I_s * (I_s - I_n) / (I_d * (I_d - I_n)))
    A_n = math.hypot(w_n, to_s * w_s)
    A_d = math.copysign(math.hypot(w_d, to_d * w_s), w_d)
    if A_d == 0.0:
        return None
    n = to_d / to_s * w_n
    m1 = min(1.0, max(LEAST, (w_d - n) * (w_d + n) / A_d**2))
    handed = 1.0 if axes == (0, 1, 2) else -1.0
    p = handed * A_d * (I_d - I_n) / I_s * to_s
    cos, sin = w_n / A_n, to_s * w_s / A_n
    u0 = sin * scipy.special.elliprf(cos**2, cos**2 + m1 * sin**2, 1.0)
    half = 2.0 * float(scipy.special.ellipkm1(m1))
    u0 = u0 if cos >= 0.0 else math.copysign(half, sin) - u0
    return _Spin(axes, np.array([A_n, A_n / to_s, A_d]), p, float(u0), m1, half)


class FreeRotation:
    """The rotation of a rigid body without torque.

    Attributes:
        fastest: A bound of its angular velocity at all times [rad/s].

    Args:
        inertia: (3, 3) inertia about its CM, body axes [kg m^2].
        attitude: (3, 3) rotation from body axes to inertial ones at time 0.
        w: (3,) its angular velocity at time 0, inertial axes [rad/s].
    """

    def __init__(self, inertia: Array, attitude: Array, w: Array) -> None:
        self._moments, axes = np.linalg.eigh(inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        self._attitude, self._axes, self._w = attitude, axes, w
        w0 = axes.T @ attitude.T @ w
        l0 = self._moments * w0
        self.fastest = float(np.linalg.norm(l0) / self._moments[0])
        self._spin = spin = _spin(self._moments, w0)
        if spin is None:
            return
        n, _, d = spin.axes
        most = np.abs(spin.amplitudes * self._moments[list(spin.axes)])
        self._e = n if most[0] < most[2] else d
        self._coefficients = _cosines(self._rate, spin.half)
        self._start = attitude @ axes @ self._triad(l0)

    def at(self, t: ArrayLike) -> tuple[Array, Array]:
        """Return attitudes (..., 3, 3) and angular velocities (..., 3), inertial axes [rad/s].

        Args:
            t: (...,) times [s].
        """
        t = np.asarray(t, dtype=np.float64)
        if self._spin is None:
            return _turned(t[..., None] * self._w) @ self._attitude, np.tile(self._w, (*t.shape, 1))
        u = self._spin.p * t + self._spin.u0
        w = self._spin.at(u)
        turned = _turned(self._psi(t)[..., None] * np.array([0.0, 0.0, 1.0]))
        back = np.swapaxes(self._triad(w * self._moments), -1, -2)
        R = self._start @ turned @ back  # from principal axes
        return R @ self._axes.T, np.einsum("...ij,...j->...i", R, w)

    def _triad(self, l: Array) -> Array:
        """Return axes (..., 3, 3), in columns: e across l (..., 3), their product, l."""
        z = l / np.linalg.norm(l, axis=-1, keepdims=True)
        x = -z * z[..., self._e, None]
        x[..., self._e] += 1.0
        x /= np.linalg.norm(x, axis=-1, keepdims=True)
        return np.stack((x, np.cross(z, x), z), axis=-1)

    def _rate(self, u: Array) -> Array:
        """Return the rate psi' of e about the momentum at u [rad/s]."""
        assert self._spin is not None
        w = self._spin.at(u)
        w, l = np.delete(w, self._e, axis=-1), np.linalg.norm(w * self._moments, axis=-1)
        across = w * np.delete(self._moments, self._e)
        return np.asarray(l * (w * across).sum(axis=-1) / (across**2).sum(axis=-1))

    def _psi(self, t: Array) -> Array:
        """Return the angle by which e has turned about the momentum at t [rad]."""
        assert self._spin is not None
        mean, others = self._coefficients[0], self._coefficients[1:]
        k = 2.0 * np.pi / self._spin.half * np.arange(1, len(others) + 1)
        middle, width = (self._spin.u0 + 0.5 * self._spin.p * t), 0.5 * self._spin.p * t
        waves = np.cos(middle[..., None] * k) * np.sinc(width[..., None] * k / np.pi)
        return np.asarray(t * (mean + waves @ others))


def _cosines(function: Callable[[Array], Array], period: float) -> Array:
    """Return the coefficients of c_0 + sum of c_k cos(2 pi k u / period), an even function of u."""
    count = 32
    while True:
        c = np.fft.rfft(function(period / count * np.arange(count))).real / count
        c[1:] *= 2.0
        large = np.flatnonzero(np.abs(c) > TAIL * np.abs(c).max())
        if count == MOST_SAMPLES or large[-1] < count // 4:
            return np.asarray(c[: large[-1] + 1])
        count *= 2


def _turned(v: Array) -> Array:
    """Return the rotations (..., 3, 3) of rotation vectors (..., 3)."""
    R = scipy.spatial.transform.Rotation.from_rotvec(v.reshape(-1, 3)).as_matrix()
    return np.asarray(R).reshape(*v.shape, 3)
