"""A search for nearest singular postures that shares nothing with the package.

Singular postures are those of which J*^T u = 0 for a unit vector u. They are looked for by

- sign changes of det(J*), and least values of sigma_min, along lines through the posture;
- descents on sigma_min along its gradient;
- the Levenberg-Marquardt method on J*^T u = 0, |u| = 1, from random postures, with u of any
  singular value;
- Newton's method on u^T J* V = 0, V the vectors of sigma_min and the null space.

From each of them two methods lead along the singular set to the nearest point: the point nearest to
the posture on the set linearised there, again and again; and a step towards the posture, then back
onto the set, which needs no dimension of the set. All is repeated in the ball about the posture
whose radius is the distance of the nearest one found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from helpers.numeric_arm import Mode, NumericArm

FARTHEST, ROUNDS = 6.0, 3
"""Radius of the first ball [rad], and the largest number of balls."""
LINES, POINTS = 24, 40
"""Random lines through the posture, and points on half of each."""
STARTS = 32
"""Starts of each method in a ball."""
MARQUARDT, DESCENT, NEWTON, LANDING, BACK, SHRINKING = 15, 12, 24, 10, 4, 20
"""Largest numbers of steps: of the Levenberg-Marquardt method, along the gradient, along the set,
onto it, onto it from near by, and towards the posture."""
EQUATIONS = (1e-7, 0.03)
"""Shares of the largest slope up to which slopes are none, each in turn: some vanish on the set."""
SHARES = np.array([0.5, 0.1, 0.02, 0.003, 0.0004])
"""Steps towards the posture, as shares of the distance."""
ENDS, SHRUNK = 16, 6
"""Ends that are moved along the set, and those that are moved towards the posture."""
STRIDE, RESTING = 0.3, 1e-10
"""Longest step, and steps that are none [rad]."""
ROUNDING = 1e-14
"""Share of the norm of J* up to which sigma_min is zero."""
LEAST_GAIN = 1e-7
"""Share of the distance by which shrinking goes on."""


@dataclass(frozen=True, eq=False)
class IndependentSearch:
    """The search about one posture; offsets are from there [rad].

    Attributes:
        arm: The arm.
        q: (n,) the posture.
        rng: Draws lines and starts.
        mode: What the spacecraft does.
        limits: Whether only postures within the joint limits count.
    """

    arm: NumericArm
    q: np.ndarray
    rng: np.random.Generator
    mode: Mode = "free-floating"
    limits: bool = False

    @property
    def k(self) -> int:
        """Number of task components."""
        return len(self.arm.rows)

    @property
    def square(self) -> bool:
        """Whether J* has a determinant."""
        return self.k == self.arm.n

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest offsets (n,)."""
        unbounded = np.full(self.arm.n, np.inf)
        if not self.limits:
            return -unbounded, unbounded
        return self.arm.lower - self.q, self.arm.upper - self.q

    @cached_property
    def scales(self) -> tuple[float, float]:
        """The largest norm of J* and the usual sigma_min, of postures anywhere."""
        rng = np.random.Generator(np.random.PCG64(0))
        J = self.arm.jacobians(rng.uniform(-np.pi, np.pi, (64, self.arm.n)), self.mode)
        sigma = np.linalg.svd(J, compute_uv=False)[:, -1]
        return float(np.linalg.norm(J, axis=(1, 2)).max()), float(np.median(sigma))

    @property
    def zero(self) -> float:
        """Largest sigma_min of singular postures."""
        return ROUNDING * self.scales[0]

    @property
    def possible(self) -> bool:
        """Whether sigma_min is surely not zero everywhere."""
        rng = np.random.Generator(np.random.PCG64(0))
        whole = replace(self.arm, task="pose")
        J = whole.jacobians(rng.uniform(-np.pi, np.pi, (8, self.arm.n)), self.mode)
        return self.scales[1] > 1e3 * ROUNDING * float(np.linalg.norm(J, axis=(1, 2)).max())

    # --- values ---------------------------------------------------------------------------------

    def sigma(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return sigma_min (m,), and det(J*) of square arms; else ones."""
        J = self.arm.jacobians(self.q + X, self.mode)
        det = np.linalg.det(J) if self.square else np.ones(len(X))
        return np.linalg.svd(J, compute_uv=False)[:, -1], det

    def on_set(self, X: np.ndarray) -> np.ndarray:
        """Tell at which offsets (m, n) sigma_min is zero within rounding."""
        return self.sigma(X)[0] <= self.zero

    def linearised(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return values (m, r) that vanish together on the set and their slopes (m, r, n).

        They are the entries of u^T J [v, null space], with u and v those of the least singular
        value where they are computed, so that all but the first are zero there.
        """
        motions = self.arm.motions(self.q + X, self.mode)
        U, sigma, VT = np.linalg.svd(self.arm.jacobians_of(motions))
        T = self.arm.slopes_of(motions, U[:, :, -1])
        slopes = VT[:, self.k - 1 :] @ T.swapaxes(1, 2)
        values = np.zeros(slopes.shape[:2])
        values[:, 0] = sigma[:, -1]
        return values, slopes

    def residual(self, X: np.ndarray, U: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return J*^T u (m, n), J* and u^T dJ*/dq_j (m, n, n) at offsets X (m, n)."""
        motions = self.arm.motions(self.q + X, self.mode)
        J = self.arm.jacobians_of(motions)
        return (U[:, None] @ J)[:, 0], J, self.arm.slopes_of(motions, U)

    def within(self, X: np.ndarray) -> np.ndarray:
        """Move offsets (m, n) into the limits."""
        return np.clip(X, *self.bounds)

    # --- the search -----------------------------------------------------------------------------

    def nearest(self) -> tuple[float, np.ndarray]:
        """Return distance and offset of the nearest singular posture found; inf if none is."""
        best = np.zeros((0, self.arm.n))
        scanned = np.concatenate((np.zeros((1, self.arm.n)), self.crossings(FARTHEST)))
        radius = self.reach(self.nearest_of(self.landed(self.within(scanned)), 1))
        for _ in range(ROUNDS):
            best = self.nearest_of(np.concatenate((best, self._ends_in(1.05 * radius))), 1)
            if self.reach(best) > radius * (1.0 - 1e-2):
                break
            radius = self.reach(best)
        return (float(np.linalg.norm(best[0])), best[0]) if len(best) else (np.inf, best)

    def reach(self, best: np.ndarray) -> float:
        """Return the distance of the nearest offsets (1, n), or how far is searched without any."""
        return float(np.linalg.norm(best[0])) if len(best) else FARTHEST

    def _ends_in(self, radius: float) -> np.ndarray:
        """Return the singular postures (m, n) that starts in a ball lead to, the nearest first."""
        lines, ball, other = self.crossings(radius), *self._in_ball(2, radius)
        origin = np.zeros((1, self.arm.n))
        starts = self.within(np.concatenate((origin, lines, ball)))
        ways = self.within(np.concatenate((origin, lines[::4], other)))
        rough = np.concatenate((starts, self.descended(starts), self.marquardt(ways)))
        first = self.nearest_of(np.concatenate((self.landed(rough), self.along(starts))), ENDS)
        second = self.nearest_of(np.concatenate((first, self.along(first))), SHRUNK)
        third = self.shrunk(second)
        return self.nearest_of(np.concatenate((third, self.along(third))), SHRUNK)

    def nearest_of(self, X: np.ndarray, most: int) -> np.ndarray:
        """Return the nearest of offsets (m, n) that lie apart, the nearest first."""
        return _apart(_nearest_first(self.unwound(X)), most)

    def unwound(self, X: np.ndarray) -> np.ndarray:
        """Return offsets (m, n) without whole turns, where there are no limits."""
        return X if self.limits else (X + np.pi) % (2.0 * np.pi) - np.pi

    def _in_ball(self, m: int, radius: float) -> np.ndarray:
        """Draw m times offsets (m, `STARTS`, n); small ones are as many as large ones."""
        X = self.rng.normal(size=(m, STARTS, self.arm.n))
        size = radius * self.rng.uniform(0.0, 1.0, (m, STARTS, 1))
        return X / np.linalg.norm(X, axis=2)[..., None] * size

    def crossings(self, radius: float) -> np.ndarray:
        """Return where det(J*) changes its sign along lines, and where sigma_min is least."""
        n = self.arm.n
        ways = self.rng.normal(size=(LINES, n))
        g = self.linearised(np.zeros((1, n)))[1][0]
        ways = np.concatenate((ways, g[np.linalg.norm(g, axis=1) > 0.0], np.eye(n)))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        s = np.linspace(-1.0, 1.0, 2 * POINTS + 1)
        s = radius * s * (0.2 + 0.8 * np.abs(s))
        X = ways[:, None] * s[:, None]
        sigma, det = (x.reshape(len(ways), -1) for x in self.sigma(X.reshape(-1, n)))
        i, j = np.nonzero(np.sign(det[:, 1:]) != np.sign(det[:, :-1]))
        a, b = np.abs(det[i, j]), np.abs(det[i, j + 1])
        share = a / np.maximum(a + b, 1e-300)
        roots = ways[i] * (s[j] + share * (s[j + 1] - s[j]))[:, None]
        i, j = np.nonzero((sigma[:, 1:-1] <= sigma[:, :-2]) & (sigma[:, 1:-1] <= sigma[:, 2:]))
        least = ways[i] * s[j + 1][:, None]
        roots, least = (_nearest_first(points)[:STARTS] for points in (roots, least))
        return np.concatenate((roots, least))

    def landed(self, X: np.ndarray, steps: int = LANDING) -> np.ndarray:
        """Return the singular postures that Newton's method reaches from X (m, n)."""
        X, share = self._each(X)
        moving = np.arange(len(X))
        for _ in range(steps):
            moved = self._step(X[moving], share[moving])
            rests = np.linalg.norm(moved - X[moving], axis=1) <= RESTING
            X[moving] = moved
            moving = moving[~rests]
            if not moving.size:
                break
        return X[self.on_set(X)]

    def _each(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return offsets (m, n) once for each of the `EQUATIONS`, and these (m,)."""
        shares = EQUATIONS[: 1 if self.square else None]
        return np.tile(X, (len(shares), 1)), np.repeat(shares, len(X))

    def along(self, X: np.ndarray) -> np.ndarray:
        """Return what is singular of the offsets that lead from X (m, n) along the set.

        Steps grow shorter where they do not come to rest; in the end they lead onto the set.
        """
        X, share = self._each(X)
        longest, before = np.full(len(X), STRIDE), np.zeros_like(X)
        found, moving = [X[self.on_set(X)]], np.arange(len(X))
        for step in range(NEWTON):
            at = X[moving]
            way = self._step(at, share[moving], -at, longest[moving]) - at
            turned = (way * before[moving]).sum(axis=1) < 0.0
            longest[moving] *= np.where(turned, 0.6, 1.05)
            X[moving], before[moving] = at + way, way
            moving = moving[np.linalg.norm(way, axis=1) > RESTING]
            if not moving.size:
                break
            if step % 8 == 7:
                found.append(X[self.on_set(X)])
        return np.concatenate((*found, self.landed(X)))

    def _step(
        self,
        X: np.ndarray,
        share: np.ndarray,
        wish: np.ndarray | None = None,
        longest: np.ndarray | float = STRIDE,
    ) -> np.ndarray:
        """Step from X (m, n) to the point of the linearised set nearest to X + wish.

        Args:
            X: The offsets.
            share: (m,) slopes that are a smaller share of the largest one are not equations.
            wish: (m, n) where to; zeros if None.
            longest: Longest step [rad].
        """
        wish = np.zeros_like(X) if wish is None else wish
        values, slopes = self.linearised(X)
        low, high = self.bounds
        free = np.ones_like(X)
        way = wish
        for _ in range(3 if self.limits else 1):
            wanted = -values - (slopes @ wish[:, :, None])[..., 0]
            part = slopes * free[:, None]
            way = wish + (np.linalg.pinv(part, rcond=share) @ wanted[:, :, None])[..., 0]
            beyond = (X + way < low) | (X + way > high)
            if not beyond.any():
                break
            wish = np.where(beyond, np.clip(X + way, low, high) - X, wish)
            free = free * ~beyond
        size = np.linalg.norm(way, axis=1)
        way = way * np.minimum(1.0, longest / np.maximum(size, 1e-300))[:, None]
        return self.within(X + way)

    def descended(self, X: np.ndarray) -> np.ndarray:
        """Return where descents on sigma_min along its gradient lead from X (m, n)."""
        for _ in range(DESCENT):
            values, slopes = self.linearised(X)
            g = slopes[:, 0]
            length = values[:, 0] / np.maximum((g * g).sum(axis=1), 1e-300)
            size = length * np.linalg.norm(g, axis=1)
            length = length * np.minimum(1.0, STRIDE / np.maximum(size, 1e-300))
            X = self.within(X - length[:, None] * g)
        return X

    def marquardt(self, X: np.ndarray) -> np.ndarray:
        """Return where the Levenberg-Marquardt method on J*^T u = 0 leads from X (m, n).

        It starts with u of the least singular value, of the second, and of any.
        """
        n, k = self.arm.n, self.k
        if not len(X):
            return X
        left = np.linalg.svd(self.arm.jacobians(self.q + X, self.mode))[0]
        chosen = np.arange(len(X)) % min(k, 3)
        U = left[np.arange(len(X)), :, k - 1 - chosen]
        low, high = self.bounds
        damping = np.full(len(X), 1e-2)
        F, J, T = self.residual(X, U)
        for _ in range(MARQUARDT):
            slope, size = np.linalg.norm(T, axis=(1, 2)), np.linalg.norm(J, axis=(1, 2))
            scale = np.maximum(np.stack((slope, size), axis=1), 1e-300)
            K = np.zeros((len(X), n + 1, n + k))
            K[:, :n, :n] = T.swapaxes(1, 2) / scale[:, :1, None]
            K[:, :n, n:] = J.swapaxes(1, 2) / scale[:, 1:, None]
            K[:, n, n:] = U
            gradient = (K[:, :n].swapaxes(1, 2) @ F[:, :, None])[..., 0]
            stuck = (low >= X) & (gradient[:, :n] > 0.0) | (high <= X) & (gradient[:, :n] < 0.0)
            K[:, :, :n] *= ~stuck[:, None]
            gradient[:, :n] *= ~stuck
            normal = K.swapaxes(1, 2) @ K + damping[:, None, None] * np.eye(n + k)
            step = -np.linalg.solve(normal, gradient[:, :, None])[..., 0]
            dx = step[:, :n] / scale[:, :1]
            dx *= np.minimum(1.0, STRIDE / np.maximum(np.linalg.norm(dx, axis=1), 1e-300))[:, None]
            tried = self.within(X + dx)
            turned = U + step[:, n:] / scale[:, 1:]
            turned /= np.linalg.norm(turned, axis=1)[:, None]
            new_F, new_J, new_T = self.residual(tried, turned)
            better = np.linalg.norm(new_F, axis=1) < np.linalg.norm(F, axis=1)
            damping = np.clip(np.where(better, damping / 5.0, 4.0 * damping), 1e-13, 1e3)
            X, U = (np.where(better[:, None], *pair) for pair in ((tried, X), (turned, U)))
            J, T = (np.where(better[:, None, None], *pair) for pair in ((new_J, J), (new_T, T)))
            F = np.where(better[:, None], new_F, F)
        return X

    def shrunk(self, X: np.ndarray) -> np.ndarray:
        """Move singular postures X (m, n) towards the origin, and back onto the set."""
        n, size = X.shape[1], np.linalg.norm(X, axis=1)
        moving = size > 0.0
        for _ in range(SHRINKING):
            at = np.flatnonzero(moving)
            if not at.size:
                break
            tried, share = self._each(((1.0 - SHARES)[:, None, None] * X[at]).reshape(-1, n))
            for _ in range(BACK):
                tried = self._step(tried, share)
            distance = np.where(self.on_set(tried), np.linalg.norm(tried, axis=1), np.inf)
            distance = distance.reshape(-1, len(at))
            best, column = distance.argmin(axis=0), np.arange(len(at))
            nearer = distance[best, column]
            moving[at] = nearer < size[at] * (1.0 - LEAST_GAIN)
            better = nearer < size[at]
            X[at[better]] = tried.reshape(-1, len(at), n)[best, column][better]
            size[at[better]] = nearer[better]
        return X


def _nearest_first(X: np.ndarray) -> np.ndarray:
    """Return offsets (m, n) in the order of their distances."""
    return X[np.argsort(np.linalg.norm(X, axis=1))]


def _apart(X: np.ndarray, most: int) -> np.ndarray:
    """Return the first of offsets (m, n) that lie apart."""
    chosen: list[np.ndarray] = []
    for x in X:
        if len(chosen) == most:
            break
        if all(np.abs(x - other).max() > 0.02 for other in chosen):
            chosen.append(x)
    return np.array(chosen).reshape(-1, X.shape[1])
