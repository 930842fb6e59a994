"""The servo at run time: commanded twists of the tip become joint rates that keep off the set."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from copy import copy
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from spacearm.arrays import (
    NO_NUMBERS,
    SMALLEST,
    Array,
    ArrayLike,
    Progress,
    floats,
    plain,
    positive,
    shape_of,
)
from spacearm.equations import servo as ticks
from spacearm.equations.servo import Frame, Limits, Memory, Seen, Tick, packed, unpacked
from spacearm.errors import ConfigurationError, UnsupportedError, listed, require_known
from spacearm.mechanics.arm_kernels import ArmKernel
from spacearm.mechanics.distance import FADING
from spacearm.model.arguments import BaseMode, free_components, require_possible
from spacearm.model.arm import Configuration, SpaceArm
from spacearm.model.frames import PoseLike
from spacearm.model.joints import joint_scales
from spacearm.results import Cell, Description, Measure, Result, Table, joint_measures
from spacearm.servo.watching import Watched, joint_states, watched
from spacearm.signatures import checked, shown
from spacearm.singularities.nearest import NearestSearch, angle
from spacearm.singularities.sets import singular_set

#: A configuration, or joint positions (n,) and the pose of the spacecraft.
Posture: TypeAlias = Configuration | tuple[ArrayLike, PoseLike]
#: Attitude of a spacecraft, on which no distance depends.
AT_REST = np.array([0.0, 0.0, 0.0, 1.0])
FRAMES = ("inertial", "spacecraft", "tip")
#: Stand for limits of joints and of wheels that there are not.
UNLIMITED, NO_BUDGET = 1e6, 1e30
#: Distances that are kept, and from which on nothing is slowed [rad].
STOP, SLOW = float(np.radians(5.0)), float(np.radians(15.0))
#: Longest time of a step [s]: up to it the search keeps its pace.
LONGEST = ticks.LOOKS * ticks.LASTS
#: Share of the motion below which something is said to slow it.
SEEN = 0.999
#: Why the servo halts.
HALTED = {
    "q": "the joint positions are not finite numbers",
    "quaternion": "the attitude is not a unit quaternion",
    "twist": "the commanded twist is not finite",
    "dt": f"dt is not a time from {ticks.SHORTEST:g} s to {LONGEST:g} s",
    "momentum": "the momentum is not finite",
    "jump": "a joint has moved faster than twice its largest rate since the last step",
    "search": "the nearest singular postures are being looked for",
    "numbers": "a number that is remembered is not finite; the search begins anew",
}


class ServoStep(Result):
    """What `Servo.step` returns: joint rates, and what limits them.

    Attributes:
        arm: The arm.
        rates: (n,) joint rates [rad/s] or [m/s] until the next step.
        distance: Distance of the nearest singular posture that the servo follows [rad]; inf if it
            knows none. It is found, so the nearest of all is no farther, except for the last step
            along the set, and for single steps in valleys of sigma_min, where the distance to first
            order takes a point to be nearly on the set that is far from it. A posture that it has
            stopped following still counts, ever farther away, up to `slow`.
        distance_proven: No singular posture is nearer than this [rad]: what was proven when the
            servo was started, less the joint motion since then; zero where nothing is proven.
        nearest: (n,) that singular posture.
        away: (n,) joint motion [rad] or [m] per radian of distance that leads away from it.
        lost: (6 tips,) direction of the twist that is being lost, towards the set, in the axes of
            the commanded twist.
        closing: Rate at which the distance falls [rad/s].
        done: Share of the commanded twist, of its task rows, that is done: the component of the
            tip's motion along it. 0 if the tip rests or moves against it, as it may while the arm
            brakes or leaves `stop`; 1 if all is done, or nothing is commanded.
        slowed: What slows the motion, with the share that it leaves: "lost direction" (that of
            `lost` alone), "approach" (to the set), "rate", "wheels", "position", "acceleration"
            and "stopping distance". The last means that the arm could not stop any more, or that
            the next step is so late that the arm would outrun the search.
        halted: Why the arm is brought to rest; empty if it is not.
    """

    arm: SpaceArm
    rates: Array
    distance: float
    distance_proven: float
    nearest: Array
    away: Array
    lost: Array
    closing: float
    done: float
    slowed: dict[str, float]
    halted: str

    @property
    def verdict(self) -> str:
        """What happens, in one sentence."""
        if self.halted:
            return f"halts: {self.halted}"
        if np.isinf(self.distance):
            where = "no singular posture is known"
        else:
            where = f"a singular posture found {angle(self.distance)} away"
        if self.slowed:
            where += f"; slowed by {listed(list(self.slowed))}"
        return f"{where}; {self.done:.0%} of the commanded motion is done"

    not_checked = "collisions"

    def describe(self) -> Description:
        """Describe rates, the nearest singular posture, and what slows the motion."""
        slides = self.arm.slides
        joints = Table.by_columns({
            "joint": self.arm.joint_names,
            "rate": joint_measures(self.rates, slides, "/s"),
            "nearest singular": joint_measures(self.nearest, slides),
            "away, per rad": joint_measures(self.away, slides),
        })  # fmt: skip
        facts: dict[str, Cell] = {
            "proven that none is nearer than": Measure(self.distance_proven, "rad"),
            "distance falls by": Measure(self.closing, "rad/s"),
            "direction that is being lost": self.lost,
        }
        facts |= {
            f"{cause} leaves": Measure(share, "", ".0%") for cause, share in self.slowed.items()
        }
        return Description(
            title=self.arm.name,
            verdict=self.verdict,
            tone="bad" if self.halted else "caution" if self.slowed else "good",
            tables=[joints, Table.facts(facts)],
        )


@checked
class Servo:
    """A servo: turns commanded twists of the tip into joint rates that keep off the singular set.

    Far from the set the rates are J*^+ v, with J* in the middle of the way that they lead until the
    next step. Nearer than `slow` only the direction that is being lost is slowed. The distance that
    it knows then falls ever more slowly towards `stop`; motions along the set and away from it stay
    free. Redundant arms raise the distance by their null space. Joint limits,
    rates and accelerations are kept by scaling, which keeps the direction, so that the arm can
    always brake before a limit. Whatever the input, no step exceeds them: invalid input brings the
    arm to rest, and the step says why.

    The distance is that to the nearest of the singular postures that the servo has found and
    follows from step to step. `start` searches for them as `SingularSet.nearest` does, and each
    step looks for nearer ones. Only within `ServoStep.distance_proven` is it proven that none is
    missed; beyond, it is tested. Far from the set a nearer one may be missed for a while. So it is
    not guaranteed that the arm stays farther than `stop`: where the set branches, a branch may be
    found late, and the arm be degrees nearer by then, in short steps as in long ones.

    The theory: control barrier functions, Ames, Xu, Grizzle & Tabuada, IEEE Trans. Autom. Control
    62(8), 3861-3876 (2017), DOI 10.1109/TAC.2016.2638961; damping of the vanishing direction alone,
    Chiaverini, IEEE Trans. Robot. Autom. 13(3), 398-410 (1997).

    Args:
        arm: The arm.
        stop: Distance to the singular set that is kept [rad].
        slow: Distance beyond which nothing is slowed [rad].
        tau: Time constant with which `stop` is approached [s].
        rates: Largest joint rates, one or (n,) [rad/s] or [m/s]; those of the description if None.
        accelerations: Largest joint accelerations, one or (n,) [rad/s^2] or [m/s^2]; none if None.
        mode: What the spacecraft does; see `generalized_jacobian`.
        frame: Axes of the twists: "inertial", "spacecraft", or "tip" (each tip's own).
        keep_attitude: Whether the null space of a redundant arm, such as its second arm, turns the
            spacecraft as little as it can.
        wheels: Largest angular momentum of the moving arm that wheels have to take up [N m s]; None
            for any.

    Raises:
        ConfigurationError: An argument does not make sense.
        UnsupportedError: The arm has fewer joints than the task has rows, can never do its task, or
            has no null space to keep the attitude with.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> servo = sa.Servo(arm, rates=0.5)
        >>> cfg = arm.at([0.3, 1.2])
        >>> servo.start(cfg)
        >>> step = servo.step(cfg, [0.1, 0, 0, 0, 0, 0], 0.01)
        >>> step.rates.round(3), step.done
        (array([-0.107, -0.107]), 1.0)
    """

    def __init__(
        self,
        arm: SpaceArm,
        *,
        stop: float = STOP,
        slow: float = SLOW,
        tau: float = 0.5,
        rates: ArrayLike | None = None,
        accelerations: ArrayLike | None = None,
        mode: BaseMode = "free-floating",
        frame: Frame = "inertial",
        keep_attitude: bool = False,
        wheels: float | None = None,
    ) -> None:
        free_components(mode)  # raises for one that does not exist
        require_possible(arm, mode)
        if arm.n < arm.task.k:
            raise UnsupportedError(
                f"{arm.name} has {arm.n} joints and its task {arm.task.k} rows, so that it is "
                "singular everywhere; name fewer rows: task=..."
            )
        require_known("frame", frame, FRAMES)
        if keep_attitude and (arm.n == arm.task.k or mode != "free-floating"):
            raise UnsupportedError(
                f"{arm.name}: keep_attitude takes a free-floating arm with more joints than the "
                f"{arm.task.k} rows of its task; it has {arm.n} ({mode})"
            )
        if not SMALLEST <= stop < slow <= np.pi:
            raise ConfigurationError(
                f"stop is {stop:g} and slow {slow:g}; give {SMALLEST:g} <= stop < slow <= pi [rad]"
            )
        described = [arm.tree.joints[name].velocity for name in arm.joint_names]
        self.arm, self.mode, self.frame, self.keep_attitude = arm, mode, frame, keep_attitude
        rate = _limits(arm, described if rates is None else rates, "rates")
        free = np.inf if accelerations is None else accelerations
        budget = NO_BUDGET if wheels is None else positive(wheels, "wheels", "momentum [N m s]")
        self.limits = Limits(
            np.maximum(arm.lower, -UNLIMITED), np.minimum(arm.upper, UNLIMITED), rate,
            _limits(arm, free, "accelerations"), stop, slow, positive(tau, "tau", "time [s]"),
            budget, LONGEST, FADING, joint_scales(arm),
        )  # fmt: skip
        options = {"frame": frame, "keep_attitude": keep_attitude}
        self._kernel = ArmKernel([arm], mode, ticks.flat_step, options, lanes=1, fast=True)
        self._numbers = {"limits": packed(self.limits)}
        self._size = ticks.size(Tick, arm.n, len(arm.tips))
        self._anchor, self._radius = np.zeros(arm.n), 0.0
        self.memory = ticks.unknowing(arm.n, np.zeros(arm.n))
        self.tick(self.seen((np.zeros(arm.n), AT_REST), np.zeros(arm.task.k), LONGEST))  # compiles
        self.memory = ticks.unknowing(arm.n, np.zeros(arm.n))

    def to_dict(self) -> dict[str, Any]:
        """Return arm, options and limits as plain data."""
        options = {name: plain(getattr(self, name)) for name in ("mode", "frame", "keep_attitude")}
        limits = {name: plain(value) for name, value in self.limits._asdict().items()}
        return {"arm": self.arm.name, **options, "limits": limits}

    def __repr__(self) -> str:
        stop, slow = np.degrees((self.limits.stop, self.limits.slow))
        return f"Servo({self.arm.name}, {self.mode}: slows from {slow:.3g}°, stops at {stop:.3g}°)"

    def tick(self, seen: Seen) -> Tick:
        """Take a step of `equations.servo` and remember it."""
        n, tips, given = self.arm.n, len(self.arm.tips), packed((*seen, *self.memory))
        found = self._kernel({"given": given[None]}, self._numbers)[0]
        self.memory = unpacked(Memory, found[self._size :], n, tips)
        return unpacked(Tick, found[: self._size], n, tips)

    def seen(self, posture: Posture, twist: ArrayLike, dt: float) -> Seen:
        """Return the input of a step; invalid numbers are left for the step to detect.

        Raises:
            ConfigurationError: Something has the wrong shape.
        """
        n, momentum = self.arm.n, np.zeros(6)
        if isinstance(posture, Configuration):
            q, turn = posture.q, pin.SE3ToXYZQUAT(posture.base)[3:]
            momentum = posture.momentum - posture.stored
        else:
            given, base = _pair(posture)
            q, turn = _numbers(given, (n,), "q"), _quaternion(base)
        return Seen(q, turn, self.tip_twists(twist), _numbers(dt, (), "dt"), momentum)

    def tip_twists(self, twist: ArrayLike) -> Array:
        """Return the twists (6 tips,) of a commanded twist, as `step` takes it.

        Raises:
            ConfigurationError: It has the wrong shape.
        """
        rows, size = self.arm.task.indices, 6 * len(self.arm.tips)
        if len(rows) == size or shape_of(twist) != (len(rows),):
            return _numbers(twist, (size,), "twist")
        twists = np.zeros(size)
        twists[list(rows)] = _numbers(twist, (len(rows),), "twist")
        return twists

    def start(
        self, posture: Posture, *, prove: bool = False, progress: Progress | None = None
    ) -> None:
        """Begin at rest at a posture: search for the singular postures about it.

        Without it the first steps search, with the arm at rest.

        Args:
            posture: A configuration, or (q, base).
            prove: Whether to prove a distance within which there is none, as `SingularSet.nearest`
                does; this takes seconds.
            progress: Called as progress(done, total) by that proof.

        Raises:
            ConfigurationError: The posture does not make sense.
        """
        cfg = posture if isinstance(posture, Configuration) else self.arm.at(_pair(posture)[0])
        if cfg.arm is not self.arm:
            raise ConfigurationError(
                f"the posture is of {cfg.arm.name}, the servo of {self.arm.name}"
            )
        unit = joint_scales(self.arm)
        search = NearestSearch(self.arm, self.mode, cfg.q[None])
        found = search.ends()[: ticks.KEPT]
        self.memory = ticks.unknowing(self.arm.n, cfg.q, cfg.q / unit + found)
        self.memory = self.memory._replace(count=float(ticks.SEARCH))
        self._anchor, self._radius = cfg.q / unit, 0.0
        if prove and len(found):
            all_of_it = singular_set(self.arm, mode=self.mode)
            self._radius = all_of_it.nearest(cfg.q, progress=progress).distance_proven

    def step(self, posture: Posture, twist: ArrayLike, dt: float) -> ServoStep:
        """Return the joint rates of the next time step.

        Args:
            posture: Where the arm is: a configuration, or (q, base). The momentum of a
                configuration counts.
            twist: (6 tips,) the commanded twist of the tips [linear [m/s]; angular [rad/s]], or
                (k,) its task rows.
            dt: Time until the next step [s], from 1e-9 s to 0.1 s.

        Returns:
            The rates, the distance, what is being lost and slowed; a halt with its reason if the
            input is not valid.
        """
        tick = self.tick(self.seen(posture, twist, dt))
        gone = np.linalg.norm(self.memory.q / joint_scales(self.arm) - self._anchor)
        halted = ticks.HALTS[int(tick.halt)]
        slowed = {
            cause: float(share)
            for cause, share in zip(ticks.CAUSES, tick.shares, strict=True)
            if share < SEEN and not halted
        }
        return ServoStep(
            self.arm, tick.rates, float(tick.distance), max(0.0, self._radius - float(gone)),
            tick.nearest, tick.away, tick.lost,
            float(tick.closing), float(tick.done), slowed, HALTED.get(halted, ""),
        )  # fmt: skip

    def watch(self, messages: Iterable[Any], *, ahead: float = 5.0) -> Iterator[Watched]:
        """Watch joint states from elsewhere, and warn ahead of time; the servo itself stays as is.

        Args:
            messages: `JointState`s, or messages in the order of their times: mappings, texts of
                JSON, or ROS 2's JointState. They have `t` (or `time`, or a `header` with a `stamp`)
                and `q` (n,), or `name` and `position`, and `dq` or `velocity` if they know it.
            ahead: How far ahead to warn [s].

        Yields:
            For each message, how near the set is, and when it will be at `stop`.

        Raises:
            ConfigurationError: A message is not a joint state of the arm.

        Example:
            >>> import spacearm as sa
            >>> servo = sa.Servo(sa.load("planar2"))
            >>> states = ({"t": 0.1 * i, "q": [0.3, 1.2 - 0.05 * i]} for i in range(20))
            >>> [state.t for state in servo.watch(states) if state.level == "warning"][0]
            0.1
        """
        eye = copy(self)
        nothing = np.zeros(self.arm.task.k)

        def follow(q: Array, dt: float) -> Tick:
            seen = eye.seen((q, AT_REST), nothing, dt)
            if ticks.HALTS[int((tick := eye.tick(seen)).halt)]:
                eye.start((q, AT_REST))  # the first, a jump, or long after: all is searched anew
                tick = eye.tick(seen)
            return tick

        states = joint_states(self.arm, messages)
        return watched(self.arm, self.limits, follow, states, positive(ahead, "ahead", "time [s]"))


def _limits(arm: SpaceArm, values: ArrayLike, name: str) -> Array:
    """Return the largest rates or accelerations (n,), checked."""
    try:
        found = np.broadcast_to(floats(values), (arm.n,))
    except NO_NUMBERS:
        found = np.zeros(0)
    if found.shape != (arm.n,) or not (found >= SMALLEST).all():
        raise ConfigurationError(
            f"{name} is {shown(values)}; give a number from {SMALLEST:g} on, or one for each of: "
            f"{listed(arm.joint_names)}"
        )
    return np.minimum(found, UNLIMITED)


def _pair(posture: object) -> tuple[Any, Any]:
    """Return (q, base) as they are given."""
    if not isinstance(posture, (tuple, list)) or len(posture) != 2:
        raise ConfigurationError(f"posture is {shown(posture)}; give a configuration, or (q, base)")
    return posture[0], posture[1]


def _numbers(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Return numbers of a shape, finite or not."""
    try:
        found = floats(values)
    except NO_NUMBERS:
        found = np.empty(0)
    if found.shape != shape:
        wanted = f"{' x '.join(map(str, shape))} numbers" if shape else "a number"
        raise ConfigurationError(f"{name} is {shown(values, 60)}; give {wanted}")
    return found


def _quaternion(base: PoseLike) -> Array:
    """Return the quaternion xyzw of a pose, or of x y z and a quaternion; NaN if it has none."""
    if isinstance(base, pin.SE3):
        R = base.rotation
    else:
        shape = shape_of(base)
        if shape in ((4,), (7,)):
            return _numbers(base, shape, "base")[-4:]
        R = _numbers(base, (4, 4), "base")[:3, :3]
    if not np.abs(R.T @ R - np.linalg.det(R) * np.eye(3)).max() <= ticks.UNIT_LENGTH:
        return np.full(4, np.nan)
    return np.asarray(pin.Quaternion(R).normalized().coeffs())
