"""The polynomials of an arm: S, the maximal minors of J*, the squared distance of the tip.

S(q) = det [A_b A_q; J_b J_q] (task rows) = det(A_b) det(J*_task) has no division in it: it is a
trigonometric polynomial of low degree in each joint. It vanishes exactly where the task Jacobian
is singular, since det(A_b) = M^3 det(D) never does. The degrees are those of the same determinant
with the tip as root body. For the full pose of six joints degree_j <= 6 - j, so that the last
joint (and the last body's inertia) does not matter and the fifth is eliminated in closed form.

For columns C of the J* of a redundant arm, as many as the task has rows k, det [A_b A_C; J_b J_C]
is det(A_b) det(J*[:, C]), a polynomial like S. J* has rank k - 1 or less exactly where all of
these minors vanish. Let k - 1 columns B be independent: then those with B and one column more
suffice. Seen from the tip held still, column j is the momentum of all on the spacecraft's side of
joint j. So the minors of the full pose that consist of B, the first five columns and one more form
a triangle (`Triangle`): the one with column j has degree 1 in joint j - 1 and does not contain
joint j or later ones.

A sliding joint d = centre + half cos(angle) enters by its angle, see `Chart`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import combinations

import numpy as np

from spacearm.arrays import Array, Integers
from spacearm.errors import UnsupportedError, listed
from spacearm.mechanics import batch
from spacearm.mechanics.batch import tips_from_centre
from spacearm.mechanics.distance import is_singular, linearise, lose_rank
from spacearm.mechanics.jacobian import plane_of_motion, probes, task_jacobian
from spacearm.model.arguments import BaseMode, require_possible
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.polynomial.jets import Chart, Jets
from spacearm.polynomial.triangle import Triangle, eliminate, find_triangle, share_root
from spacearm.polynomial.trig import NotPolynomialError, Sampler, TrigPolynomial, degrees_of
from spacearm.signatures import checked
from spacearm.singularities.immaterial_masses import SameSet

#: Share of the arm's size below which distances are zero.
ROUNDING = 1e-14
#: Share of the product of the lengths of its columns below which a determinant is zero.
ROUNDING_OF_MINORS = 1e-13
#: Why arms with such joints have no singularity polynomial.
MIMIC = (
    "joints that mimic others make S a polynomial of multiples of the angles; lock their leaders "
    "with locked={...}"
)


@checked
def singularity_polynomial(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> TrigPolynomial:
    """Compute S(q), which vanishes exactly where the task Jacobian is singular.

    It is unique up to a constant factor, and fitted once for each arm and mode.

    For planar arms only the angular momentum about the normal of the plane couples, and the scalar
    inertia about it takes the place of det(D). Then S is equation (41) of Papadopoulos & Dubowsky
    (1993), DOI 10.1115/1.2897406. Linear rows of mixed tasks are divided by the task's length,
    which is a constant factor.

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
    check_square(arm)
    return _fitted(SameSet.of(arm, mode))


@lru_cache(maxsize=16)
def _fitted(same: SameSet) -> TrigPolynomial:
    """Fit S(q), once for all arms with the same singular set."""
    (S,) = minor_polynomials(same.arm, [range(same.arm.n)], mode=same.mode)
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
    with fitting(arm, "the determinant of J*"):
        return TrigPolynomial.fit_each(minor_sampler(arm, minors, mode), arm.n)


@contextmanager
def fitting(arm: SpaceArm, what: str) -> Iterator[None]:
    """Say of which arm a function is that cannot be fitted, and what to do.

    Raises:
        NotPolynomialError: A fit failed: the values are little more than rounding where masses or
            lengths differ by many orders of magnitude, or where joints slide far.
    """
    try:
        yield
    except NotPolynomialError:
        raise NotPolynomialError(f"{arm.name}: {lost_in_rounding(arm, what)}") from None


def lost_in_rounding(arm: SpaceArm, what: str) -> str:
    """Say that a function of an arm cannot be fitted, and what to do."""
    masses = [inertia.mass for inertia in arm.model.inertias if inertia.mass > 0.0]
    nearer = "set nearer limits of sliding joints with arm.replace(lower=, upper=)"
    remedy = nearer if arm.slides.any() else "check masses and lengths, or choose another task"
    return (
        f"{what} (task {arm.task.names!r}) is lost in rounding, as bodies have masses from "
        f"{min(masses):.3g} to {max(masses):.3g} kg; {remedy}"
    )


def minor_sampler(arm: SpaceArm, minors: Iterable[Sequence[int]], mode: BaseMode) -> Sampler:
    """Return the function that computes minors at positions (m, n), see `minor_polynomials`.

    Joints may slide.

    Raises:
        UnsupportedError: The task is one that the arm can never do.
    """
    require_possible(arm, mode)
    sampler = _sampler_of_one_tip if len(arm.tips) == 1 else _sampler_of_several_tips
    return sampler(arm, np.array([*minors]), mode)


def _sampler_of_one_tip(arm: SpaceArm, minors: Integers, mode: BaseMode) -> Sampler:
    """Return the function that computes minors from the momentum seen from the tip."""
    rows, free = _rows_and_free_directions(arm, mode)
    columns = np.array([[*free, *joints] for joints in 6 + minors])
    seen = _columns_at_random(arm, mode)[:, rows]
    chosen = seen[:, :, columns].swapaxes(1, 2)
    sizes = np.linalg.norm(chosen, axis=2).prod(axis=2)
    idle = np.abs(seen[:, :, 6:]).max(axis=(0, 1)) <= ROUNDING  # their length is rounding as well
    vanish = np.abs(np.linalg.det(chosen)) <= ROUNDING_OF_MINORS * sizes
    if (idle[minors].any(axis=1) | vanish).all():
        raise UnsupportedError(
            f"{arm.name}: all minors of J* vanish within rounding: the joints hardly move the rows "
            f"of the task {arm.task.names!r}; choose other rows"
        )
    return lambda Q: batch.minors(arm, Q, mode, rows, columns)


@lru_cache(maxsize=16)
def _columns_at_random(arm: SpaceArm, mode: BaseMode) -> Array:
    """Return the columns that minors take determinants of, at three random positions."""
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (3, arm.n))
    return batch.columns_seen(arm, Q, mode)


def _sampler_of_several_tips(arm: SpaceArm, minors: Integers, mode: BaseMode) -> Sampler:
    """Return the function that computes minors as det(D) det(J*), one by one."""
    D_unit = max(np.abs(cfg.A[3:, 3:6]).max() for cfg in probes(arm))
    at_probes = np.array([task_jacobian(cfg, mode=mode) for cfg in probes(arm)])
    J_unit = np.abs(at_probes).max()

    def sampler(Q: Array) -> Array:
        cfgs = [arm.at(q) for q in Q]
        J = np.array([task_jacobian(cfg, mode=mode) for cfg in cfgs]) / J_unit
        values = np.linalg.det(np.moveaxis(J[:, :, minors], 2, 1))
        if mode != "free-floating":
            return values
        D = np.array([cfg.A[3:, 3:6] for cfg in cfgs]) / D_unit
        return values * np.linalg.det(D)[:, None]

    return sampler


def _rows_and_free_directions(arm: SpaceArm, mode: BaseMode) -> tuple[Integers, list[int]]:
    """Return the rows that count, and the directions of the tip's twist that the task leaves free.

    For a floating spacecraft the rows are those of momentum: six, or three in the plane of a
    planar arm; else those of the task, without free directions.
    """
    task = [int(i) for i in arm.task.indices]
    if mode != "free-floating":
        return np.array(task), []
    normal = plane_of_motion(arm)
    rows = list(range(6)) if normal is None else [*{0, 1, 2} - {normal}, 3 + normal]
    return np.array(rows), [i for i in rows if i not in task]


def radius_squared(arm: SpaceArm, *, mode: BaseMode = "free-floating") -> TrigPolynomial:
    """Compute R^2(q), the squared distance of the tip from the system CM, equation (43) [m^2].

    For a fixed spacecraft from its own CM, the limit of the system CM as its mass grows. Fitted
    once for each arm and mode.
    """
    return _fitted_radius_squared(arm, mode)


@lru_cache(maxsize=16)
def _fitted_radius_squared(arm: SpaceArm, mode: BaseMode) -> TrigPolynomial:
    """Fit R^2(q)."""
    if arm.slides.any() or arm.coupling is not None:
        raise UnsupportedError(
            f"{arm.name}: the distance of the tip from the system CM is known as a polynomial only "
            "for revolute joints that do not mimic others; lock the others with locked={...}"
        )
    with fitting(arm, "the distance of the tip from the system CM"):
        return TrigPolynomial.fit(
            lambda Q: (tips_from_centre(arm, Q, mode) ** 2).sum(axis=1), arm.n
        )


def distances(arm: SpaceArm, Q: Array, mode: BaseMode) -> Array:
    """Compute R (m,) at configurations (m, n) to rounding, also where R^2 is rounding [m]."""
    R = np.linalg.norm(tips_from_centre(arm, Q, mode), axis=1)
    R[ROUNDING * np.sqrt(radius_squared(arm, mode=mode).scale) > R] = 0.0
    return R


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
        return f"{which} prismatic, and S not a trigonometric polynomial in {what}: locked={{...}}"
    if arm.coupling is not None:
        return MIMIC
    if n > k:
        return (
            f"{n} joints for {k} task rows ({arm.task.names}): the arm is redundant "
            f"and has no determinant; {to_square(arm)}"
        )
    return arm.fault_of_task() if n < k else None


def to_square(arm: SpaceArm) -> str:
    """Say what gives a redundant arm as many joints as task rows: locks, or a longer task."""
    n, more = arm.n, arm.n - arm.task.k
    lock = f"locked={{{arm.joint_names[-1]!r}: 0.0}}"
    longer = f", or take a task with {n} rows" if n <= 6 * len(arm.tips) else ""
    return f"lock {more} joint{'s' * (more > 1)}, for instance {lock}{longer}"


#: A sliding joint without limits is covered this far to both sides of zero [m].
ANYWHERE = 1.0
#: Random configurations that tell minors that vanish everywhere from others.
PROBES = 256
#: Highest degree looked for in one joint.
HIGHEST = 12
#: Share of the largest minor below which one vanishes everywhere.
ABSENT = 1e-11
#: Half width of the boxes in which a few minors are compared [rad], and the power of their width
#: that the number of boxes falls with; configurations that they lie about.
HALF_WIDTH, POWER, COMPARED = 0.2, 2.0, 128
#: Largest number of maximal minors.
MOST_MINORS = 500
#: Largest number of coefficients of minors that are used together.
MOST_COEFFICIENTS = 1_000_000
#: The same of two, the fewest that tell a path across the roots of one from a singular one.
MOST_OF_TWO = 4_000_000
#: The same of all minors, beyond which a few of them prove more in the same time.
MOST_OF_ALL = 200_000
#: The same of several tips, for a proof that nobody has asked for by itself.
MOST_OF_SEVERAL_TIPS = 20_000
#: Number of choices of the columns B that are tried.
BASES = 3
#: Singular configurations found otherwise, which the triangle must give.
SEARCHES = 8
#: Share of the scale below which a polynomial vanishes along a line.
VANISHES = 1e-8

Columns = tuple[int, ...]


def chart_of(arm: SpaceArm) -> Chart:
    """Return the ranges of sliding joints: their limits, `ANYWHERE` where there are none."""
    low = np.where(np.isfinite(arm.lower), arm.lower, -ANYWHERE)
    high = np.where(np.isfinite(arm.upper), arm.upper, ANYWHERE)
    flat = high - low <= 0.0
    low, high = low - ANYWHERE * flat, high + ANYWHERE * flat
    return Chart(
        arm.slides,
        np.where(arm.slides, (low + high) / 2.0, 0.0),
        np.where(arm.slides, (high - low) / 2.0, 1.0),
    )


@dataclass(frozen=True, eq=False)
class Minors:
    """The maximal minors of an arm; made by `minors_of`.

    Attributes:
        arm: The arm.
        mode: What the spacecraft does.
        chart: The angles of which the minors are polynomials.
        degrees: The degrees of each minor in each joint, by its columns; without those that vanish
            identically.
    """

    arm: SpaceArm
    mode: BaseMode
    chart: Chart
    degrees: dict[Columns, tuple[int, ...]]
    _fitted: dict[Columns, Jets] = field(default_factory=dict, repr=False)
    _rounding: set[Columns] = field(default_factory=set, repr=False)

    def __getitem__(self, columns: Columns) -> Jets:
        """Return one minor, of scale 1; fitted when it is first asked for."""
        if columns not in self._fitted:
            sampler = _of_angles(self.arm, self.mode, self.chart, [columns])
            with fitting(self.arm, "a minor of J*"):
                (f,) = TrigPolynomial.fit_each(sampler, self.arm.n, highest=HIGHEST)
            self._fitted[columns] = Jets.of(f, self.chart)
        return self._fitted[columns]

    @property
    def size(self) -> int:
        """Number of coefficients of all minors."""
        return self._size(list(self.degrees))

    def every(self) -> list[Jets]:
        """Return all minors that do not vanish identically, or as many as may be kept.

        Of too many those with the fewest coefficients: where one of them is not zero the arm is
        regular, as with all; where these are zero, others may tell.

        Raises:
            UnsupportedError: They are of several tips and too many, or two alone are too large.
        """
        own = sorted(self.degrees, key=lambda C: self._size([C]))
        if len(self.arm.tips) > 1:
            return self._together(own, MOST_COEFFICIENTS)
        sizes = np.cumsum([self._size([C]) for C in own])
        return self._together(own[: max(2, int((sizes <= MOST_COEFFICIENTS).sum()))], MOST_OF_TWO)

    @property
    def few(self) -> list[Jets]:
        """Minors that prove much for the time they take.

        Where one is not zero the arm is regular; where all are zero it need not be singular.

        Raises:
            UnsupportedError: They have too many coefficients.
        """
        return self._together(self._few, MOST_COEFFICIENTS)

    @cached_property
    def _few(self) -> list[Columns]:
        """The columns of `few`.

        Each one added is that with which proofs take the fewest coefficients times boxes. The
        width of a box goes with |a|, where a sum of the minors has value 1 in its middle and the
        squares of its changes in the box, of the slopes together and of what bends one by one, are
        least, 1 / |a|^2; it counts as a share of that with all minors.
        """
        own = [*self.degrees]
        sizes = np.array([self._size([C]) for C in own])
        f = _of_angles(self.arm, self.mode, self.chart, own)
        at = self.chart.angles(self.chart.draw(np.random.default_rng(0), COMPARED))
        ends = [(f(at - dx), f(at + dx)) for dx in HALF_WIDTH * np.eye(self.arm.n)]
        value, tiny = f(at), np.finfo(np.float64).tiny
        bent = [np.sqrt(np.abs(0.5 * (start + end) - value)) for start, end in ends]
        unit = np.sqrt((np.sum(bent, axis=0) ** 4).mean(axis=0)) + tiny
        v, slopes = value / unit, np.stack([(end - start) / (2.0 * unit) for start, end in ends], 2)

        def widths(some: list[int]) -> Array:
            S, values = slopes[:, some].swapaxes(1, 2), v[:, some, None]
            b = S @ values
            solved = np.linalg.solve(np.eye(len(ends)) + S @ S.swapaxes(1, 2), b)
            square = (values**2).sum(axis=(1, 2)) - (b * solved).sum(axis=(1, 2))
            return np.asarray(np.sqrt(np.maximum(square, tiny)))

        whole, chosen, least = widths([*range(len(own))]), list[int](), np.inf
        while len(chosen) < len(own):
            every = [[*chosen, i] for i in range(len(own)) if i not in chosen]
            total = np.array([sizes[some].sum() for some in every])
            boxes = [((whole / widths(some)) ** POWER).mean() for some in every]
            work = np.where(total <= MOST_COEFFICIENTS, total * boxes, np.inf)
            if work.min() >= least and len(chosen) >= self.codimension:
                break
            least, chosen = work.min(), every[int(np.argmin(work))]
        return [own[i] for i in chosen]

    def _together(self, columns: list[Columns], most: int) -> list[Jets]:
        """Return several minors, without those that are mostly rounding.

        Raises:
            UnsupportedError: They have too many coefficients.
        """
        if (size := self._size(columns)) > most:
            raise UnsupportedError(
                f"{self.arm.name}: {len(columns)} minors of J* have {size:.3g} coefficients, of "
                f"which {most:.0e} at most are kept; lock joints"
            )
        found = []
        for C in columns:
            try:
                found += [] if C in self._rounding else [self[C]]
            except UnsupportedError:
                self._rounding.add(C)
        return found

    def _size(self, columns: list[Columns]) -> int:
        """Return how many coefficients minors have."""
        return sum(math.prod(2 * d + 1 for d in self.degrees[C]) for C in columns)

    def _minors_with(self, B: Columns) -> list[Columns]:
        """Return the columns B with one more, where that minor does not vanish identically."""
        every = (tuple(sorted((*B, j))) for j in range(self.arm.n) if j not in B)
        return [C for C in every if C in self.degrees]

    @property
    def codimension(self) -> int:
        """Number of equations that singular configurations fulfil."""
        return self.arm.n - self.arm.task.k + 1

    @property
    def triangle(self) -> Triangle | None:
        """The minors that give the whole singular set; None if no choice of columns does so."""
        return self._chosen[0]

    @cached_property
    def sifted(self) -> bool:
        """Whether roots of the triangle need not be singular: at some of them B is dependent.

        That is so if it takes joints that the triangle gives to make B dependent; otherwise it
        takes values of the free joints that are never drawn. Of one polynomial all roots count.
        """
        triangle, B = self._chosen
        rng = np.random.default_rng(1)
        for _ in range(SEARCHES if triangle is not None and self.codimension > 1 else 0):
            q = lose_rank(self.arm, self.chart.draw(rng), self.mode, B)
            if q is not None and triangle is not None:
                given = list(triangle.joints)
                q[given] = self.chart.draw(rng)[given]
                if not is_singular(self.arm, q, self.mode, B):
                    return True
        return False

    @cached_property
    def _chosen(self) -> tuple[Triangle | None, Columns]:
        """The triangle, if there is one, and the columns B of its minors.

        A choice of k - 1 columns B does if the minors with B form a triangle and

        - do not all vanish on a set of one dimension less than joint space;
        - give all singular configurations where B is independent (`Triangle.escapes`);
        - configurations at which B is dependent are singular only in a set of fewer dimensions.

        Where no minors form a triangle, a resultant of two may make one, as for "x y" with n = 3.

        Checked is the first on a random line along each joint, in complex numbers; the others near
        thousands of roots, and by a search for singular configurations and for dependent columns.
        """
        k, n = self.arm.task.k, self.arm.n
        choices = []
        for B in combinations(range(n), k - 1):
            own = self._minors_with(B)
            found = find_triangle([self.degrees[C] for C in own]) if own else None
            size = self._size(own)
            if found is not None and size <= MOST_COEFFICIENTS:
                order, joints = found
                pairs = zip(order, joints, strict=True)
                work = math.prod(self.degrees[own[i]][j] for i, j in pairs)
                choices.append((work, size, B, [own[i] for i in order], joints))
        for _, _, B, columns, solved in sorted(choices)[:BASES]:
            triangle = Triangle(tuple(self[C].polynomial for C in columns), solved)
            if self._is_whole(triangle, B):
                return triangle, B
        return self._eliminated() if not choices and self.codimension == 2 else (None, ())

    def _eliminated(self) -> tuple[Triangle | None, Columns]:
        """Return a triangle made with the resultant of two minors of degree 1 in one joint."""
        for B in combinations(range(self.arm.n), self.arm.task.k - 1):
            own = self._minors_with(B)
            small = self._size(own) <= MOST_COEFFICIENTS
            for j in range(self.arm.n) if small else ():
                if len(own) == 2 and all(self.degrees[C][j] == 1 for C in own):
                    f, g = (self[C].polynomial for C in own)
                    checks = tuple(self[C].polynomial for C in self.degrees if C not in own)
                    triangle = eliminate(f, g, j, checks)
                    if triangle is not None and self._is_whole(triangle, B):
                        return triangle, B
        return None, ()

    def _is_whole(self, triangle: Triangle, B: Columns) -> bool:
        """Check whether a triangle gives the whole set."""
        if self.codimension == 1:
            return True
        rng = np.random.default_rng(0)
        if _share_factor(triangle.equations, rng):
            return False
        escaped = self.chart.positions(triangle.escapes(rng))
        if any(is_singular(self.arm, q, self.mode) for q in escaped):
            return False
        for _ in range(SEARCHES):
            q = lose_rank(self.arm, self.chart.draw(rng), self.mode)
            if q is not None and (
                is_singular(self.arm, q, self.mode, B) or not _given(triangle, self.chart.angles(q))
            ):
                return False
            q = lose_rank(self.arm, self.chart.draw(rng), self.mode, B)
            if q is not None and is_singular(self.arm, q, self.mode):
                return False
        return True


def has_minors(arm: SpaceArm) -> bool:
    """Check whether an arm has maximal minors, and not too many."""
    return arm.coupling is None and 0 < math.comb(arm.n, arm.task.k) <= MOST_MINORS


def minors_of(arm: SpaceArm, mode: BaseMode) -> Minors:
    """Find the degrees of all maximal minors of an arm, or of one with the same singular set.

    Args:
        arm: The arm.
        mode: What the spacecraft does.

    Raises:
        UnsupportedError: The arm has mimic joints, too many minors or polynomials of too high a
            degree, or can never do its task.
    """
    k, n = arm.task.k, arm.n
    if not has_minors(arm):
        raise UnsupportedError(
            f"{arm.name}: J* has no minors that are polynomials of the joint positions, because "
            f"joints mimic others, or too many of them ({math.comb(n, k)}, at most {MOST_MINORS})"
        )
    return _minors(SameSet.of(arm, mode))


@lru_cache(maxsize=16)
def _minors(same: SameSet) -> Minors:
    arm, mode = same.arm, same.mode
    k, n = arm.task.k, arm.n
    own, every = chart_of(arm), np.array(list(combinations(range(n), k)))
    rng = np.random.default_rng(0)
    probes = own.draw(rng, PROBES)
    size = np.abs(minor_sampler(arm, every, mode)(probes)).max(axis=0)
    some = every[size > ABSENT * size.max()]
    with fitting(arm, "each minor of J*"):
        degrees = degrees_of(_of_angles(arm, mode, own, some), n, HIGHEST, rng)
    each = zip(some.tolist(), degrees.T.tolist(), strict=True)
    return Minors(arm, mode, own, {tuple(C): tuple(d) for C, d in each})


def proving_minors(arm: SpaceArm, mode: BaseMode) -> Sequence[Jets]:
    """Return minors of which one that is not zero proves a configuration regular.

    All, or where these have too many coefficients a few; none where J* has no minors, these have
    too many, too, or they would take too long to fit: those of several tips are computed one by
    one.
    """
    if not has_minors(arm):
        return ()
    with suppress(UnsupportedError):  # too many coefficients, or all are mostly rounding
        minors = minors_of(arm, mode)
        if minors.size <= (MOST_OF_ALL if len(arm.tips) == 1 else MOST_OF_SEVERAL_TIPS):
            return minors.every()
        return minors.few if len(arm.tips) == 1 else ()
    return ()


def minors_for_proofs(arm: SpaceArm, mode: BaseMode) -> list[Jets]:
    """Return the minors that prove configurations regular, the smallest first.

    Raises:
        ConfigurationError: There is no such mode.
        UnsupportedError: There are none, or the arm can never do its task.
    """
    require_possible(arm, mode)
    minors = sorted(proving_minors(arm, mode), key=lambda f: f.polynomial.coefficients.size)
    if not minors:
        raise UnsupportedError(
            f"{arm.name}: J* has no minors that a proof could use, as with joints that mimic "
            "others, too many of them, slides far beyond the arm's length, or masses so different "
            "that minors are lost in rounding; lock joints, set nearer limits of sliding ones with "
            "arm.replace(lower=, upper=), or check the masses"
        )
    return minors


def _of_angles(arm: SpaceArm, mode: BaseMode, own: Chart, columns: Iterable[Columns]) -> Sampler:
    """Return the function that computes minors (m, len(columns)) at angles (m, n)."""
    sampler = minor_sampler(arm, columns, mode)
    return lambda angles: sampler(own.positions(angles))


def _share_factor(polynomials: Sequence[TrigPolynomial], rng: np.random.Generator) -> bool:
    """Check whether polynomials have a common factor: common roots on a line along a joint."""
    n = polynomials[0].n
    for j in range(n):
        line = rng.uniform(-np.pi, np.pi, (1, n))
        along = [f.along(line, (j,))[0] for f in polynomials]
        d = max(len(c) for c in along) // 2
        if d and share_root(np.stack([np.pad(c, d - len(c) // 2) for c in along], axis=1)):
            return True
    return False


def _given(triangle: Triangle, angles: Array) -> bool:
    """Check whether a triangle gives a root: only the first polynomial may vanish on a line.

    Roots beyond the range of a sliding joint have no angles (NaN) and do not count.
    """
    if np.isnan(angles).any():
        return True
    return all(
        np.abs(f.along(angles[None], (j,))).max() > VANISHES * f.scale
        for f, j in zip(triangle.polynomials[1:], triangle.joints[1:], strict=True)
    )


#: Points of a line on which sign changes of S are looked for, from -pi to pi.
LINE = np.linspace(-np.pi, np.pi, 129)


def roots_on_lines(arm: SpaceArm, mode: BaseMode, minors: Sequence[Jets], q: Array) -> Array:
    """Return the offsets (m, n) from q (n,) of roots of S on lines through it; none without S.

    The lines are those along each joint and along the gradient of sigma_min.

    Args:
        arm: The arm.
        mode: What the spacecraft does.
        minors: The minors of J*.
        q: (n,) the configuration.
    """
    unit = joint_scales(arm)
    found = [np.empty((0, arm.n))]
    if len(minors) != 1:
        return found[0]
    (S,) = minors
    angles = S.chart.angles(q)
    for j in np.flatnonzero(S.polynomial.degrees) if np.isfinite(angles).all() else ():
        roots = S.polynomial.roots_along(angles[None], int(j))[0]
        at = np.tile(angles, (len(roots), 1))
        at[:, j] = roots
        offset = (S.chart.positions(at) - q) / unit
        if not arm.slides[j]:
            offset[:, j] = np.angle(np.exp(1j * offset[:, j]))
        found.append(offset[np.isfinite(roots)])
    way = linearise(arm, q[None], mode).rows[0, 0]
    line = LINE[:, None] * way
    value = S(q + unit * line).value
    (before,) = np.nonzero(np.sign(value[1:]) != np.sign(value[:-1]))
    share = value[before] / (value[before] - value[before + 1])
    found.append(line[before] + share[:, None] * (line[before + 1] - line[before]))
    offsets = np.concatenate(found)
    return offsets[np.isfinite(offsets).all(axis=1)]
