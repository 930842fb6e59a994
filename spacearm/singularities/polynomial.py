"""The singularity polynomial of an arm.

S(q) = det [A_b A_q; J_b J_q] (task rows) = det(A_b) det(J*_task) has no division in it: it is a
trigonometric polynomial of low degree in each joint, and vanishes exactly where the task Jacobian
is singular, since det(A_b) = M^3 det(D) never does. The degrees found are those of the form that
is rooted at the tip: for a full pose of six joints degree_j <= 6 - j, so that the last joint (and
the last body's inertia) does not matter and the fifth is eliminated in closed form.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError
from spacearm.mechanics.jacobian import generalized_jacobian
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.model.mode import BaseMode
from spacearm.polynomial.trig import TrigPolynomial

ROUNDING = 1e-14
"""Distances below this share of the arm's size are zero."""
NEVER = 1e-9
"""A task whose condition is worse than this everywhere is one that the arm can never do."""


def singularity_polynomial(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> TrigPolynomial:
    """S(q), which vanishes exactly where the task Jacobian is singular, up to a constant factor.

    For planar arms only the angular momentum about the normal of the plane couples, and the scalar
    inertia about it takes the place of det(D); then S is equation (41) of Papadopoulos &
    Dubowsky (1993), DOI 10.1115/1.2897406. Linear rows of mixed tasks are divided by the task's
    length, which is a constant factor.

    Where the spacecraft is attitude-controlled or fixed, the inertia does not take part and S is
    the determinant of that Jacobian itself.

    Args:
        arm: An arm with as many joints as its task has rows, all of them turning.
        mode: What the spacecraft does; see `generalized_jacobian`.

    Returns:
        Polynomial of the n joint angles, in the order of q.

    Raises:
        UnsupportedError: The arm is redundant (lock a joint or add task rows), has prismatic
            or mimic joints, or can never do the task.
    """
    check_square(arm)
    rng = np.random.default_rng(0)
    probes = [arm.at(q) for q in rng.uniform(-np.pi, np.pi, (32, arm.n))]
    normal = plane_of_motion(arm, probes)
    jacobians = np.array([_task_jacobian(cfg, mode) for cfg in probes])
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
        J = np.array([_task_jacobian(cfg, mode) for cfg in cfgs]) / J_unit
        det: Array = np.linalg.det(J)
        if mode != "free-floating":
            return det
        D = np.array([cfg.A[3:, 3:6] for cfg in cfgs]) / D_unit
        det *= np.linalg.det(D) if normal is None else D[:, normal, normal]
        return det

    return TrigPolynomial.fit(S, arm.n, rng=rng)


@lru_cache(maxsize=16)
def radius_squared(arm: SpaceArm, mode: BaseMode = "free-floating") -> TrigPolynomial:
    """R^2, the squared distance of the tip from the system CM, equation (43) [m^2].

    For a fixed spacecraft from its own CM, to which that of the system tends as it grows heavy.
    """

    def sampler(Q: Array) -> Array:
        tips = np.array([tip_from_centre(arm, q, mode) for q in Q])
        return (tips**2).sum(axis=1)

    return TrigPolynomial.fit(sampler, arm.n)


def distances(arm: SpaceArm, Q: Array, mode: BaseMode = "free-floating") -> Array:
    """(m,) R, to rounding, at configurations (m, n): where R is small, R^2 would not tell [m]."""
    R = np.array([np.linalg.norm(tip_from_centre(arm, q, mode)) for q in Q])
    R[ROUNDING * np.sqrt(radius_squared(arm, mode).scale) > R] = 0.0
    return R


def tip_from_centre(arm: SpaceArm, q: Array, mode: BaseMode = "free-floating") -> Array:
    """(3,) the tip from the system CM (from its own CM if the spacecraft is fixed) [m].

    In spacecraft axes.
    """
    cfg = arm.at(q)
    centre = arm.model.inertias[1].lever if mode == "fixed" else cfg.com
    return cfg.tip.translation - centre


def _task_jacobian(cfg: Configuration, mode: BaseMode) -> Array:
    return cfg.arm.task.jacobian(generalized_jacobian(cfg, mode=mode), cfg.base.rotation)


def check_square(arm: SpaceArm) -> None:
    """Refuses arms that have no singularity polynomial.

    Raises:
        UnsupportedError: Joints slide or mimic others, or are not as many as the task has rows.
    """
    k, n = arm.task.k, arm.n
    if arm.slides.any():
        sliding = [name for name, slides in zip(arm.joint_names, arm.slides, strict=True) if slides]
        raise UnsupportedError(
            f"{arm.name}: joints {', '.join(sliding)} slide, and S is no trigonometric polynomial "
            "in them; lock them with locked={...}"
        )
    if arm.coupling is not None:
        raise UnsupportedError(
            f"{arm.name}: joints that mimic others make S a polynomial of multiples of the angles; "
            "lock their leaders with locked={...}"
        )
    if n > k:
        raise UnsupportedError(
            f"{arm.name}: {n} joints for {k} task rows ({arm.task.names}): the arm is redundant "
            f"and has no determinant; lock {n - k} joint(s), for instance "
            f"locked={{{arm.joint_names[-1]!r}: 0.0}}, or take a task with {n} rows"
        )
    if n < k:
        raise UnsupportedError(
            f"{arm.name}: {n} joints for {k} task rows ({arm.task.names}): the arm can never do "
            f"this task; take one with {n} rows"
        )


def plane_of_motion(arm: SpaceArm, probes: list[Configuration]) -> int | None:
    """The axis of a planar arm whose motion stays in the plane, inertia products included."""
    normal = arm.tree.plane_normal()
    if normal is None:
        return None
    across = [i for i in range(3) if i != normal]
    A = np.array([cfg.A[3:] for cfg in probes])
    leaks = np.abs(A[:, across, 6:]).max() + np.abs(A[:, across, 3 + normal]).max()
    return normal if leaks <= 1e-12 * np.abs(A).max() else None
