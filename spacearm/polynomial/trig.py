"""Trigonometric polynomials of several angles: exact functions from few samples.

A real trigonometric polynomial on the n-torus,

    f(q) = sum_k c_k exp(i k.q),   k in Z^n, |k_j| <= d_j,   c_-k = conj(c_k),

has prod(2 d_j + 1) coefficients and is known everywhere from as many samples on a tensor grid, by
one fast Fourier transform. Along one joint, with z = exp(i q_j), it is z^-d times a polynomial of
degree 2d in z, whose roots on the unit circle are its real roots: for d = 1, a cos q + b sin q + c
vanishes at q = atan2(b, a) +- acos(-c / hypot(a, b)). From the coefficients come bounds that hold
everywhere, |df/dq_j| <= sum |c_k| |k_j| and |d2f/dq_i dq_j| <= sum |c_k| |k_i| |k_j|, and with
them certificates that a box or a segment holds no root.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array, plain
from spacearm.errors import ConfigurationError, UnsupportedError
from spacearm.polynomial.univariate import Complex, Roots, distinct, line_roots, orders

Sampler = Callable[[Array], Array]

MOST_SAMPLES = 10_000_000
"""Largest number of samples of a fit, to bound its memory."""
NOISE = 1e-12
"""Share of the scale below which coefficients and values are rounding."""
BLOCK = 1 << 21
"""Largest number of complex numbers that an evaluation holds at once."""


@dataclass(frozen=True, eq=False, repr=False)
class TrigPolynomial:
    """A real trigonometric polynomial of n angles.

    Attributes:
        coefficients: (2 d_1 + 1, ..., 2 d_n + 1) complex, c_k at index k + d.
    """

    coefficients: Complex

    # --- what it is -------------------------------------------------------------------------

    @property
    def n(self) -> int:
        """Number of angles."""
        return self.coefficients.ndim

    @property
    def degrees(self) -> tuple[int, ...]:
        """Degree in each angle."""
        return tuple(size // 2 for size in self.coefficients.shape)

    @cached_property
    def scale(self) -> float:
        """Sum of |c_k|, a bound of all values."""
        return float(np.abs(self.coefficients).sum())

    def __repr__(self) -> str:
        return f"TrigPolynomial(degrees {self.degrees}, {self.coefficients.size} coefficients)"

    def to_dict(self) -> dict[str, Any]:
        """Return the degrees and the coefficients, each as [re, im], as plain JSON data."""
        return {"degrees": plain(self.degrees), "coefficients": plain(self.coefficients)}

    @classmethod
    def fit(
        cls,
        sampler: Sampler,
        n: int,
        *,
        highest: int = 8,
        noise: float = 1e-11,
        rng: np.random.Generator | None = None,
    ) -> TrigPolynomial:
        """Fit a function that is a trigonometric polynomial, exactly.

        Args:
            sampler: Takes (m, n) angles, returns (m,) real values.
            n: Number of angles.
            highest: Highest degree looked for in one angle.
            noise: Share of the largest value that counts as rounding.
            rng: For the lines along which degrees are found and the points of the final check.

        Raises:
            UnsupportedError: The function is no trigonometric polynomial up to that degree, gives
                values that are not finite, or has too many coefficients.
        """
        each = cls.fit_each(lambda Q: sampler(Q)[:, None], n, highest=highest, noise=noise, rng=rng)
        return each[0]

    @classmethod
    def fit_each(
        cls,
        sampler: Sampler,
        n: int,
        *,
        highest: int = 8,
        noise: float = 1e-11,
        rng: np.random.Generator | None = None,
    ) -> list[TrigPolynomial]:
        """Fit the components of a vector, as `fit`; the sampler returns (m, components) values."""
        rng = rng or np.random.default_rng(0)
        degrees = [_degree(sampler, n, j, highest, noise, rng) for j in range(n)]
        shape = [2 * d + 1 for d in degrees]
        if math.prod(shape) > MOST_SAMPLES:
            raise UnsupportedError(
                f"a trigonometric polynomial of degrees {tuple(degrees)} has "
                f"{math.prod(shape):.3g} coefficients, of which {MOST_SAMPLES:.0e} at most are "
                "kept; lock joints"
            )
        axes = np.meshgrid(*(2.0 * np.pi * np.arange(s) / s for s in shape), indexing="ij")
        values = sampler(np.stack([axis.ravel() for axis in axes], axis=1))
        spectra = np.fft.fftn(values.reshape(*shape, -1), axes=range(n)) / math.prod(shape)
        fitted = [cls(c) for c in np.moveaxis(np.fft.fftshift(spectra, axes=range(n)), -1, 0)]
        Q = rng.uniform(-np.pi, np.pi, (16, n))
        wanted = sampler(Q)
        error = float(np.abs(np.stack([f(Q) for f in fitted], axis=1) - wanted).max())
        size = max(float(np.abs(wanted).max()), float(np.abs(values).max()))
        if not error <= 100.0 * noise * size:
            raise UnsupportedError(
                f"the function is not band-limited: a trigonometric polynomial of degrees "
                f"{tuple(degrees)} misses it by {error:.3g} (its size is {size:.3g})"
            )
        return fitted

    # --- values -----------------------------------------------------------------------------

    def __call__(self, Q: npt.ArrayLike) -> Any:
        """Evaluate at (n,) or (m, n) angles: a float or (m,)."""
        points = np.asarray(Q, dtype=np.float64)
        values = self.along(np.atleast_2d(points), ()).real
        return float(values[0]) if points.ndim == 1 else values

    def along(self, Q: Array, keep: tuple[int, ...]) -> Complex:
        """Compute the coefficients that remain when all angles but those in `keep` are fixed.

        Args:
            Q: (m, n) angles; those in `keep` do not matter.
            keep: Numbers of the angles that remain, in growing order.

        Returns:
            (m, 2 d_j + 1 for j in keep) complex coefficients; (m,) if `keep` is empty.
        """
        if Q.ndim != 2 or Q.shape[1] != self.n:
            raise ConfigurationError(f"angles have shape {Q.shape}; give (m, {self.n})")
        rest = sorted(set(range(self.n)) - set(keep), key=lambda j: self.degrees[j])
        C = np.transpose(self.coefficients, (*keep, *rest))
        shape = C.shape[: len(keep)]
        if not rest:
            return np.broadcast_to(C, (len(Q), *shape))
        values = np.empty((len(Q), *shape), dtype=complex)
        block = max(1, BLOCK * C.shape[-1] // C.size)
        for start in range(0, len(Q), block):
            q = Q[start : start + block]
            waves = [np.exp(1j * np.outer(q[:, j], orders(self.degrees[j]))) for j in rest]
            partial = waves.pop() @ C.reshape(-1, C.shape[-1]).T
            while waves:
                E = waves.pop()
                partial = (partial.reshape(len(q), -1, E.shape[1]) @ E[:, :, None])[..., 0]
            values[start : start + block] = partial.reshape(len(q), *shape)
        return values

    def fix(self, angles: Mapping[int, float]) -> TrigPolynomial:
        """Return the polynomial of the other angles with some fixed."""
        point = np.zeros((1, self.n))
        for j, angle in angles.items():
            point[0, j] = angle
        keep = tuple(j for j in range(self.n) if j not in angles)
        return TrigPolynomial(self.along(point, keep)[0])

    def shifted(self, offset: Array) -> TrigPolynomial:
        """Return the polynomial q -> f(q + offset)."""
        waves = [np.exp(1j * self._k(j) * offset[j]) for j in range(self.n)]
        return TrigPolynomial(math.prod(waves, start=self.coefficients))

    def grid(self, shape: tuple[int, ...]) -> Array:
        """Evaluate on a tensor grid, by one zero-padded inverse FFT.

        Args:
            shape: Points N_j in each angle; point i stands at 2 pi i / N_j.

        Returns:
            (N_1, ..., N_n) values.
        """
        if any(2 * d >= N for N, d in zip(shape, self.degrees, strict=True)):
            raise ConfigurationError(
                f"a grid of {shape} is too coarse for degrees {self.degrees}; take more than "
                "twice the degree in each angle"
            )
        padded = np.zeros(shape, dtype=complex)
        wrapped = [orders(d).astype(int) % N for d, N in zip(self.degrees, shape, strict=True)]
        padded[np.ix_(*wrapped)] = self.coefficients
        return np.fft.ifftn(padded, norm="forward").real

    # --- derivatives ------------------------------------------------------------------------

    def derivative(self, j: int) -> TrigPolynomial:
        """Return the partial derivative with respect to angle j."""
        return TrigPolynomial(self.coefficients * (1j * self._k(j)))

    def gradient(self, Q: npt.ArrayLike) -> Array:
        """Compute the gradient at (n,) or (m, n) angles, of the same shape."""
        parts = [self.derivative(j)(Q) for j in range(self.n)]
        return np.stack(parts, axis=-1)

    def hessian(self, Q: npt.ArrayLike) -> Array:
        """Compute the second derivatives (n, n) or (m, n, n)."""
        rows = [self.derivative(j).gradient(Q) for j in range(self.n)]
        return np.stack(rows, axis=-1)

    def _k(self, j: int) -> Array:
        """Return the orders k_j, shaped to multiply the coefficients."""
        shape = [1] * self.n
        shape[j] = -1
        return orders(self.degrees[j]).reshape(shape)

    # --- roots ------------------------------------------------------------------------------

    def roots(self, q: npt.ArrayLike, j: int) -> Roots:
        """Find all real roots along angle j, the others as in q (n,)."""
        line = self.along(np.asarray(q, dtype=np.float64)[None], (j,))[0]
        if np.abs(line).max() <= NOISE * self.scale:
            return Roots(np.empty(0), np.empty(0, dtype=int), True)
        angles, multiplicity = distinct(line_roots(line[None])[0])
        return Roots(angles, multiplicity, False)

    def roots_along(self, Q: Array, j: int) -> Array:
        """Find the real roots (m, 2 d_j) along angle j for Q (m, n); NaN where there are fewer."""
        return line_roots(self.along(Q, (j,)))

    # --- bounds -----------------------------------------------------------------------------

    @cached_property
    def lipschitz(self) -> Array:
        """(n,) L_j >= |df/dq_j| everywhere."""
        size = np.abs(self.coefficients)
        return np.array([float((size * np.abs(self._k(j))).sum()) for j in range(self.n)])

    @cached_property
    def curvature(self) -> Array:
        """(n, n) B_ij >= |d2f/dq_i dq_j| everywhere."""
        size, k = np.abs(self.coefficients), [np.abs(self._k(j)) for j in range(self.n)]
        return np.array([[float((size * a * b).sum()) for b in k] for a in k])

    def sign(self, centre: npt.ArrayLike, half: npt.ArrayLike) -> npt.NDArray[np.int_]:
        """Certify signs over boxes: +1 or -1 where no root can be, else 0.

        Args:
            centre: (m, n) centres.
            half: (m, n) half widths.
        """
        c, h = np.atleast_2d(np.asarray(centre, float)), np.atleast_2d(np.asarray(half, float))
        second = 0.5 * np.einsum("mi,ij,mj->m", h, self.curvature, h)
        first = np.einsum("mj,mj->m", np.abs(self.gradient(c)), h)
        change = np.minimum(first + second, h @ self.lipschitz) + NOISE * self.scale
        values = self(c)
        return np.where(np.abs(values) > change, np.sign(values), 0.0).astype(int)


def _degree(
    sampler: Sampler, n: int, j: int, highest: int, noise: float, rng: np.random.Generator
) -> int:
    """Find the degree in angle j: where the spectra along a few random lines end."""
    N = 2 * highest + 3
    lines = rng.uniform(-np.pi, np.pi, (4, 1, n)).repeat(N, axis=1)
    lines[:, :, j] = 2.0 * np.pi * np.arange(N) / N
    values = sampler(lines.reshape(-1, n)).reshape(4, N, -1)
    if not np.isfinite(values).all():
        raise UnsupportedError("the function gives values that are not finite")
    spectrum = np.abs(np.fft.rfft(values, axis=1)).max(axis=(0, 2))
    above = np.flatnonzero(spectrum > noise * spectrum.max())
    degree = int(above[-1]) if len(above) else 0
    if degree > highest:
        raise UnsupportedError(
            f"the function is not band-limited in angle {j}: its degree is above {highest}"
        )
    return degree
