"""The singularity polynomial of an arm.

S(q) = det [A_b A_q; J_b J_q] (task rows) = det(A_b) det(J*_task) has no division in it: it is a
trigonometric polynomial of low degree in each joint. It vanishes exactly where the task Jacobian
is singular, since det(A_b) = M^3 det(D) never does. The degrees are those of the same determinant
with the tip as root body: for the full pose of six joints degree_j <= 6 - j, so that the last joint
(and the last body's inertia) does not matter and the fifth is eliminated in closed form.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError, listed
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.model.mode import BaseMode
from spacearm.polynomial.trig import TrigPolynomial

ROUNDING = 1e-14
"""Share of the arm's size below which distances are zero."""
NEVER = 1e-9
"""A task whose sigma_min / sigma_max is below this everywhere is one that the arm can never do."""


def singularity_polynomial(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> TrigPolynomial:
    """Compute S(q), which vanishes exactly where the task Jacobian is singular.

    It is unique up to a constant factor, and fitted once for each arm and mode.

    For planar arms only the angular momentum about the normal of the plane couples, and the scalar
    inertia about it takes the place of det(D); then S is equation (41) of Papadopoulos &
    Dubowsky (1993), DOI 10.1115/1.2897406. Linear rows of mixed tasks are divided by the task's
    length, which is a constant factor.

    For attitude-controlled and fixed spacecraft S is the determinant of their Jacobian itself.

    Args:
        arm: An arm with as many joints as its task has rows, all of them revolute.
        mode: What the spacecraft does; see `generalized_jacobian`.

    Returns:
        Polynomial of the n joint angles, in the order of q.

    Raises:
        UnsupportedError: The arm is redundant (lock a joint or add task rows), has prismatic
            or mimic joints, or can never do the task.
    """
    return _fitted(arm, mode)


@lru_cache(maxsize=16)
def _fitted(arm: SpaceArm, mode: BaseMode) -> TrigPolynomial:
    """Fit S(q); arguments in one spelling, so that the cache knows them again."""
    check_square(arm)
    rng = np.random.default_rng(0)
    probes = [arm.at(q) for q in rng.uniform(-np.pi, np.pi, (32, arm.n))]
    normal = plane_of_motion(arm, probes)
    jacobians = np.array([task_jacobian(cfg, mode=mode) for cfg in probes])
    sigma = np.linalg.svd(jacobians, compute_uv=False)
    if (sigma[:, -1] <= NEVER * sigma[:, 0]).all():
        raise UnsupportedError(
            f"{arm.name}: the task {arm.task.names!r} is singular at every configuration; choose "
            "rows that the arm can move along"
        )

    D_unit = max(np.abs(cfg.A[3:, 3:6]).max() for cfg in probes)  # neither tiny nor huge arms
    J_unit = np.abs(jacobians).max()  # may leave the range of floating-point numbers

    def S(Q: Array) -> Array:
        cfgs = [arm.at(q) for q in Q]
        J = np.array([task_jacobian(cfg, mode=mode) for cfg in cfgs]) / J_unit
        det = np.linalg.det(J)
        if mode != "free-floating":
            return det
        D = np.array([cfg.A[3:, 3:6] for cfg in cfgs]) / D_unit
        return det * (np.linalg.det(D) if normal is None else D[:, normal, normal])

    return TrigPolynomial.fit(S, arm.n, rng=rng)


def radius_squared(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> TrigPolynomial:
    """Compute R^2(q), the squared distance of the tip from the system CM, equation (43) [m^2].

    For a fixed spacecraft from its own CM, the limit of the system CM as its mass grows. Fitted
    once for each arm and mode.
    """
    return _fitted_radius_squared(arm, mode)


@lru_cache(maxsize=16)
def _fitted_radius_squared(arm: SpaceArm, mode: BaseMode) -> TrigPolynomial:
    """Fit R^2(q)."""

    def sampler(Q: Array) -> Array:
        return (tips_from_centre(arm, Q, mode) ** 2).sum(axis=1)

    return TrigPolynomial.fit(sampler, arm.n)


def distances(arm: SpaceArm, Q: Array, mode: BaseMode) -> Array:
    """Compute R (m,) at configurations (m, n) to rounding, also where R^2 is rounding [m]."""
    R = np.linalg.norm(tips_from_centre(arm, Q, mode), axis=1)
    R[ROUNDING * np.sqrt(radius_squared(arm, mode=mode).scale) > R] = 0.0
    return R


def tips_from_centre(arm: SpaceArm, Q: Array, mode: BaseMode) -> Array:
    """Compute the tip (m, 3) relative to the system CM at configurations (m, n).

    In spacecraft axes [m]; relative to the spacecraft's own CM if it is fixed.
    """
    cfgs = [arm.at(q) for q in Q]
    centres = [arm.model.inertias[1].lever if mode == "fixed" else cfg.com for cfg in cfgs]
    return np.array([cfg.tip.translation for cfg in cfgs]) - centres


def check_square(arm: SpaceArm, so: str = "") -> None:
    """Refuse arms that have no singularity polynomial.

    Args:
        arm: The arm.
        so: What the message ends with.

    Raises:
        UnsupportedError: Joints are prismatic or mimic others, or are not as many as the task has
            rows.
    """
    if why := _why_not_square(arm):
        raise UnsupportedError(f"{arm.name}: {why}{so and '; '}{so}")


def _why_not_square(arm: SpaceArm) -> str | None:
    """Say why an arm has no singularity polynomial; None if it has one."""
    k, n = arm.task.k, arm.n
    if arm.slides.any():
        sliding = [name for name, slides in zip(arm.joint_names, arm.slides, strict=True) if slides]
        return (
            f"joints {listed(sliding)} slide, and S is no trigonometric polynomial "
            "in them; lock them with locked={...}"
        )
    if arm.coupling is not None:
        return (
            "joints that mimic others make S a polynomial of multiples of the angles; "
            "lock their leaders with locked={...}"
        )
    if n > k:
        return (
            f"{n} joints for {k} task rows ({arm.task.names}): the arm is redundant "
            f"and has no determinant; lock {n - k} joint(s), for instance "
            f"locked={{{arm.joint_names[-1]!r}: 0.0}}, or take a task with {n} rows"
        )
    if n < k:
        return (
            f"{n} joints for {k} task rows ({arm.task.names}): the arm can never do "
            f"this task; take one with {n} rows"
        )
    return None


def plane_of_motion(arm: SpaceArm, probes: list[Configuration]) -> int | None:
    """Return the normal axis of a planar arm whose inertias keep it in the plane, else None."""
    normal = arm.tree.plane_normal()
    if normal is None:
        return None
    across = [i for i in range(3) if i != normal]
    A = np.array([cfg.A[3:] for cfg in probes])
    leaks = np.abs(A[:, across, 6:]).max() + np.abs(A[:, across, 3 + normal]).max()
    return normal if leaks <= 1e-12 * np.abs(A).max() else None
