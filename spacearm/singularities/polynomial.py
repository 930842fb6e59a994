"""The singularity polynomial of an arm.

S(q) = det [A_b A_q; J_b J_q] (task rows) = det(A_b) det(J*_task) has no division in it: it is a
trigonometric polynomial of low degree in each joint. It vanishes exactly where the task Jacobian
is singular, since det(A_b) = M^3 det(D) never does. The degrees are those of the same determinant
with the tip as root body: for the full pose of six joints degree_j <= 6 - j, so that the last joint
(and the last body's inertia) does not matter and the fifth is eliminated in closed form.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from spacearm.arrays import Array
from spacearm.errors import UnsupportedError, listed
from spacearm.mechanics import batch
from spacearm.mechanics.jacobian import task_jacobian
from spacearm.model.arguments import BaseMode, of_arm
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.polynomial.fit import Sampler
from spacearm.polynomial.trig import TrigPolynomial

Indices = npt.NDArray[np.int_]

ROUNDING = 1e-14
"""Share of the arm's size below which distances are zero."""
ROUNDING_OF_MINORS = 1e-13
"""Share of the product of the lengths of its columns below which a determinant is zero."""
NEVER = 1e-9
"""A task whose sigma_min / sigma_max is below this everywhere is one that the arm can never do."""


@of_arm
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

    Example:
        >>> import spacearm as sa
        >>> sa.singularity_polynomial(sa.load("mda6")).degrees  # the last joint does not matter
        (2, 4, 3, 2, 1, 0)
    """
    return _fitted(arm, mode)


@lru_cache(maxsize=16)
def _fitted(arm: SpaceArm, mode: BaseMode) -> TrigPolynomial:
    """Fit S(q); arguments in one spelling, so that the cache knows them again."""
    check_square(arm)
    (S,) = minor_polynomials(arm, [range(arm.n)], mode=mode)
    return S


def minor_polynomials(
    arm: SpaceArm, minors: Iterable[Sequence[int]], *, mode: BaseMode = "free-floating"
) -> list[TrigPolynomial]:
    """Compute maximal minors of the task Jacobian, times det(A_b), as trigonometric polynomials.

    m_C(q) = det [A_b A_C; J_b J_C] (task rows) = det(A_b) det(columns C of J*_task), up to one
    positive factor for all; `singularity_polynomial` has the details.

    Args:
        arm: An arm of revolute joints.
        minors: For each minor the numbers of the joints whose columns it takes, from 0 on, as many
            as the task has rows.
        mode: What the spacecraft does; see `generalized_jacobian`.

    Returns:
        A polynomial of all n joint angles for each minor, with the degrees that it has itself.

    Raises:
        UnsupportedError: They have too many coefficients, or the task is one that the arm can
            never do.
    """
    return TrigPolynomial.fit_each(minor_sampler(arm, minors, mode), arm.n)


def minor_sampler(arm: SpaceArm, minors: Iterable[Sequence[int]], mode: BaseMode) -> Sampler:
    """Return the function that computes minors at positions (m, n), see `minor_polynomials`.

    Joints may slide.

    Raises:
        UnsupportedError: The task is one that the arm can never do.
    """
    sampler = _sampler_of_one_tip if len(arm.tips) == 1 else _sampler_of_several_tips
    return sampler(arm, np.array([*minors]), mode)


def _sampler_of_one_tip(arm: SpaceArm, minors: Indices, mode: BaseMode) -> Sampler:
    """Return the function that computes minors from the momentum seen from the tip."""
    rows, free = _rows_and_free_directions(arm, mode)
    columns = np.array([[*free, *joints] for joints in 6 + minors])
    if columns.shape[1] != len(rows):  # the task has rows that a planar arm cannot do
        raise _impossible(arm)
    seen = _columns_at_random(arm, mode)[:, rows]
    chosen = seen[:, :, columns].swapaxes(1, 2)
    sizes = np.linalg.norm(chosen, axis=2).prod(axis=2)
    idle = np.abs(seen[:, :, 6:]).max(axis=(0, 1)) <= ROUNDING  # their length is rounding as well
    vanish = np.abs(np.linalg.det(chosen)) <= ROUNDING_OF_MINORS * sizes
    if (idle[minors].any(axis=1) | vanish).all():
        raise _impossible(arm)
    return lambda Q: batch.minors(arm, Q, mode, rows, columns)


@lru_cache(maxsize=16)
def _columns_at_random(arm: SpaceArm, mode: BaseMode) -> Array:
    """Return the columns that minors take determinants of, at three random positions."""
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (3, arm.n))
    return batch.columns_seen(arm, Q, mode)


def comparable_sampler(arm: SpaceArm, like: SpaceArm) -> Sampler:
    """Return the function that computes S of an arm, with the factor of another's.

    Both have the same joints; S is then a polynomial of the arm's masses and moments.
    """
    rows, free = _rows_and_free_directions(like, "free-floating")
    columns = np.array([[*free, *range(6, 6 + like.n)]])
    mine, its = (batch.unit_of_minors(one, "free-floating", rows, columns) for one in (arm, like))
    return lambda Q: batch.minors(arm, Q, "free-floating", rows, columns) * (its / mine)


def _impossible(arm: SpaceArm) -> UnsupportedError:
    return UnsupportedError(
        f"{arm.name}: the task {arm.task.names!r} is singular at every configuration; choose rows "
        "that the arm can move along"
    )


def _sampler_of_several_tips(arm: SpaceArm, minors: Indices, mode: BaseMode) -> Sampler:
    """Return the function that computes minors as det(D) det(J*), one by one."""
    D_unit = max(np.abs(cfg.A[3:, 3:6]).max() for cfg in probes(arm))
    at_probes = np.array([task_jacobian(cfg, mode=mode) for cfg in probes(arm)])
    J_unit = np.abs(at_probes).max()
    sigma = np.linalg.svd(at_probes, compute_uv=False)
    if (sigma[:, -1] <= NEVER * sigma[:, 0]).all():
        raise _impossible(arm)

    def sampler(Q: Array) -> Array:
        cfgs = [arm.at(q) for q in Q]
        J = np.array([task_jacobian(cfg, mode=mode) for cfg in cfgs]) / J_unit
        values = np.linalg.det(np.moveaxis(J[:, :, minors], 2, 1))
        if mode != "free-floating":
            return values
        D = np.array([cfg.A[3:, 3:6] for cfg in cfgs]) / D_unit
        return values * np.linalg.det(D)[:, None]

    return sampler


def _rows_and_free_directions(arm: SpaceArm, mode: BaseMode) -> tuple[Indices, list[int]]:
    """Return the rows that count, and the directions of the tip's twist that the task leaves free.

    For a floating spacecraft the rows are those of momentum: six, or three in the plane of a
    planar arm; else those of the task, without free directions.
    """
    task = [int(i) for i in arm.task.indices]
    if mode != "free-floating":
        return np.array(task), []
    normal = plane_of_motion(arm, probes(arm)) if arm.tree.plane_normal() is not None else None
    rows = list(range(6)) if normal is None else [*{0, 1, 2} - {normal}, 3 + normal]
    return np.array(rows), [i for i in rows if i not in task]


def probes(arm: SpaceArm) -> list[Configuration]:
    """Return a few random configurations."""
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (8, arm.n))
    return [arm.at(q) for q in Q]


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
    arm.require_one_tip()
    return batch.tips_from_centre(arm, np.asarray(Q, dtype=np.float64), mode)


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
        one = len(sliding) == 1
        which = f"joint {sliding[0]} is" if one else f"joints {listed(sliding)} are"
        what = "its position; lock it" if one else "their positions; lock them"
        return f"{which} prismatic, and S is no trigonometric polynomial in {what}: locked={{...}}"
    if arm.coupling is not None:
        return (
            "joints that mimic others make S a polynomial of multiples of the angles; "
            "lock their leaders with locked={...}"
        )
    if n > k:
        return (
            f"{n} joints for {k} task rows ({arm.task.names}): the arm is redundant "
            f"and has no determinant; {to_square(arm)}"
        )
    if n < k:
        return (
            f"{n} joints for {k} task rows ({arm.task.names}): the arm can never do "
            f"this task; take one with {n} rows"
        )
    return None


def to_square(arm: SpaceArm) -> str:
    """Say what gives a redundant arm as many joints as task rows: locks, or a longer task."""
    n, lock = arm.n, f"locked={{{arm.joint_names[-1]!r}: 0.0}}"
    longer = f", or take a task with {n} rows" if n <= 6 * len(arm.tips) else ""
    return f"lock {n - arm.task.k} joint(s), for instance {lock}{longer}"


def plane_of_motion(arm: SpaceArm, probes: list[Configuration]) -> int | None:
    """Return the normal axis of a planar arm whose inertias keep it in the plane, else None."""
    normal = arm.tree.plane_normal()
    if normal is None:
        return None
    across = [i for i in range(3) if i != normal]
    A = np.array([cfg.A[3:] for cfg in probes])
    leaks = np.abs(A[:, across, 6:]).max() + np.abs(A[:, across, 3 + normal]).max()
    return normal if leaks <= 1e-12 * np.abs(A).max() else None
