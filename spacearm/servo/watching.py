"""Streams of joint states from elsewhere: how near the singular set they come, ahead of time."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from spacearm.arrays import NO_NUMBERS, Array, floats, shape_of
from spacearm.equations.servo import HALTS, Limits, Tick
from spacearm.errors import ConfigurationError, SpaceArmError, imported, listed
from spacearm.model.arm import SpaceArm
from spacearm.model.joints import joint_scales
from spacearm.results import Cell, Description, Measure, Result, Table, Tone, joint_measures
from spacearm.singularities.nearest import angle

Level = Literal["clear", "warning", "stop", "fault"]
TONES: dict[Level, Tone] = {"clear": "good", "warning": "caution", "stop": "bad", "fault": "bad"}
#: Names of what tells the time in a message.
TIMES = ("t", "time", "stamp", "header")


class JointState(NamedTuple):
    """What a stream says at an instant.

    Attributes:
        t: Time [s].
        q: (n,) joint positions [rad] or [m].
        dq: (n,) joint rates [rad/s] or [m/s]; None if it does not say.
    """

    t: float
    q: Array
    dq: Array | None = None


class Watched(Result):
    """What `Servo.watch` says about one joint state of a stream.

    Attributes:
        arm: The arm.
        t: Time [s].
        q: (n,) joint positions.
        distance: Distance of the nearest singular posture that is followed [rad], as
            `ServoStep.distance`; inf if none is known, or for a fault.
        nearest: (n,) that posture.
        closing: Rate at which the distance falls [rad/s].
        ahead: Time until the distance is `stop`, at this rate [s]; inf if it does not fall.
        level: "stop" nearer than `stop`; "warning" nearer than `slow`, or `stop` is ahead; "fault"
            if the message is not valid; else "clear".
        fault: What is wrong with the message.
        pause: Time since the message before [s], where a servo follows no further in one step, so
            that the posture is searched anew; else 0.
    """

    arm: SpaceArm
    t: float
    q: Array
    distance: float
    nearest: Array
    closing: float
    ahead: float
    level: Level
    fault: str
    pause: float = 0.0

    @property
    def verdict(self) -> str:
        """What there is to say, in one sentence."""
        if self.fault:
            return f"fault: {self.fault}"
        if math.isinf(self.distance):
            return f"{self.level}: no singular posture is known"
        said = f"{self.level}: a singular posture found {angle(self.distance)} away"
        said += f", to stop in {self.ahead:.1f} s at this rate" if self.ahead < 1e3 else ""
        return said + (f"; {self.pause:.2f} s after the message before" if self.pause else "")

    not_checked = "collisions, joint limits"

    def describe(self) -> Description:
        """Describe the posture, and how fast which singular posture comes nearer."""
        slides = self.arm.slides
        columns: dict[str, Any] = {
            "joint": self.arm.joint_names,
            "q": joint_measures(self.q, slides),
        }
        columns["nearest singular"] = joint_measures(self.nearest, slides)
        facts: dict[str, Cell] = {
            "time": Measure(self.t, "s"), "distance falls by": Measure(self.closing, "rad/s")
        }  # fmt: skip
        return Description(
            title=self.arm.name,
            verdict=self.verdict,
            tone=TONES[self.level],
            tables=[Table.by_columns(columns), Table.facts(facts)],
        )


def watched(
    arm: SpaceArm, limits: Limits, follow: Callable[[Array, float], Tick],
    states: Iterable[JointState], ahead: float,
) -> Iterator[Watched]:  # fmt: skip
    """Yield what is to say of joint states, one by one; see `Servo.watch`.

    Args:
        arm: The arm.
        limits: What the servo keeps.
        follow: Follows the set to joint positions (n,), so long after the last [s].
        states: The states.
        ahead: How far ahead to warn [s].
    """
    last, unit = None, joint_scales(arm)
    for state in states:
        q = state.q
        if not (np.isfinite(q).all() and math.isfinite(state.t)):
            yield _fault(arm, state, "the joint positions, or the time, are not finite numbers")
            continue
        if last is not None and state.t <= last.t:
            yield _fault(arm, state, f"its time, {state.t:g} s, is not after {last.t:g} s")
            continue
        since = math.inf if last is None else state.t - last.t
        tick, dq = follow(q, since), state.dq
        if dq is None:
            dq = np.zeros(arm.n) if last is None else (q - last.q) / since
        closing = -float((tick.away / unit) @ (dq / unit))
        distance = float(tick.distance)
        left = max(distance - limits.stop, 0.0) / closing if closing > 0.0 else math.inf
        near = distance < limits.slow or left < ahead
        level: Level = "stop" if distance < limits.stop else "warning" if near else "clear"
        late = last is not None and HALTS[int(tick.halt)] == "dt" and since > limits.longest
        pause = since if late else 0.0
        yield Watched(arm, state.t, q, distance, tick.nearest, closing, left, level, "", pause)
        last = JointState(state.t, q)


def _fault(arm: SpaceArm, state: JointState, why: str) -> Watched:
    """Return the fault that reports an invalid message."""
    none = np.full(arm.n, np.nan)
    return Watched(arm, state.t, state.q, math.inf, none, 0.0, math.inf, "fault", why)


def joint_states(arm: SpaceArm, messages: Iterable[Any]) -> Iterator[JointState]:
    """Yield the joint states in messages: texts of JSON, mappings, or messages of ROS 2.

    A message has `t` (or `time`, or a `header` with a `stamp`) and `q` (n,), or `name` and
    `position`, as sensor_msgs/JointState has them, and `dq` or `velocity` if it knows them. Empty
    lines are left out, and messages that name joints of others only; what cannot be read is a state
    of NaN.

    Args:
        arm: The arm.
        messages: The messages, in the order of their times.

    Raises:
        ConfigurationError: A message lacks joints of the arm, or is not a joint state at all; or
            all are of others.
    """
    mine, others = False, 0
    for i, message in enumerate(messages, 1):
        if isinstance(message, str | bytes) and not message.strip():
            continue
        state = message if isinstance(message, JointState) else _joint_state(arm, message, i)
        if state is None:
            others = others or i
        else:
            mine = True
            yield state
    if others and not mine:
        raise _no_state(arm, others)


def _no_state(arm: SpaceArm, number: int) -> ConfigurationError:
    return ConfigurationError(
        f"message {number} is not a joint state of {arm.name}; give t and q, or name and position "
        f"of: {listed(arm.joint_names)}"
    )


def _joint_state(arm: SpaceArm, message: Any, number: int) -> JointState | None:
    """Return the joint state in message `number`, None if it is of other joints.

    Of a message that cannot be read it is a state of NaN.
    """
    try:
        if isinstance(message, str):
            message = message.encode()  # of bytes, json knows the byte-order mark
        if isinstance(message, bytes):
            message = json.loads(message)
        return _parsed_state(arm, message, number)
    except SpaceArmError:
        raise
    except (*NO_NUMBERS, IndexError):
        return JointState(math.nan, np.full(arm.n, np.nan))


def _parsed_state(arm: SpaceArm, message: Any, number: int) -> JointState | None:
    """Return the joint state in a parsed message, as `_joint_state`; it may raise anything."""

    def get(of: Any, *names: str) -> Any:
        given = [of.get(n) if isinstance(of, Mapping) else getattr(of, n, None) for n in names]
        return next((value for value in given if value is not None), None)

    time, q, dq = (
        get(message, *TIMES),
        get(message, "q", "position"),
        get(message, "dq", "velocity"),
    )
    stamp = get(time, "stamp") or time
    if (seconds := get(stamp, "sec", "secs")) is not None:
        stamp = seconds + 1e-9 * (get(stamp, "nanosec", "nsecs") or 0)
    names = get(message, "name", "names")
    names = arm.joint_names if names is None else list(names)
    if q is not None and names and not set(arm.joint_names) & set(names):
        return None
    if q is None or not set(arm.joint_names) <= set(names):
        raise _no_state(arm, number)
    place = [names.index(name) for name in arm.joint_names]
    told = [q, dq] if dq is not None and shape_of(dq) == (len(names),) else [q]
    return JointState(float(stamp), *(floats(x)[place] for x in told))


def recorded(path: Path, topic: str) -> Iterator[Any]:
    """Yield the messages of a topic of an MCAP file, or the lines of any other file.

    Raises:
        UnsupportedError: The library for MCAP is not installed (pip install 'spacearm[mcap]').
        ConfigurationError: The file cannot be read, or has no message of the topic.
    """
    if path.suffix.lower() != ".mcap":
        try:
            with path.open(encoding="utf-8-sig") as file:
                yield from file
        except FileNotFoundError:
            raise ConfigurationError(f"{path} cannot be read: no such file") from None
        except (OSError, ValueError) as error:  # ValueError: no such name, or no text
            raise ConfigurationError(f"{path} cannot be read: {error}") from None
        return
    reader = imported("mcap.reader", "mcap-ros2-support", "mcap")
    decoder = imported("mcap_ros2.decoder", "mcap-ros2-support", "mcap")
    some = False
    try:
        with path.open("rb") as file:
            recording = reader.SeekingReader(
                file,
                decoder_factories=[decoder.DecoderFactory()],
                record_size_limit=path.stat().st_size,
            )
            messages = recording.iter_decoded_messages(topics=[topic])
            while True:
                with redirect_stderr(StringIO()):  # the library prints what it raises, too
                    one = next(messages, None)
                if one is None:
                    break
                some = True
                yield one.decoded_message
    except Exception as error:  # the libraries decode what the file says, and raise anything
        why = str(error) or type(error).__name__
        raise ConfigurationError(f"{path} cannot be read: {why}") from None
    if not some:
        raise ConfigurationError(f"{path} has no message on {topic}; name another: --topic")
