"""Joint states from elsewhere: when they come near the set, ahead of time, whatever they hold."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.commands import spacearm

import spacearm as sa
from spacearm.servo.watching import recorded


def approach(count=60):
    """States of an arm that goes straight to a singular posture, at a constant rate."""
    arm = sa.load("planar2")
    start = np.radians([30.0, 40.0])
    nearest = sa.singular_set(arm).nearest(start)
    rate = (nearest.q - start) / nearest.distance * 0.2  # 0.2 rad/s towards it
    return (
        arm,
        nearest.distance,
        [{"t": 0.05 * i, "q": start + 0.05 * i * rate} for i in range(count)],
    )


def test_it_warns_when_stop_is_so_far_ahead():
    arm, distance, states = approach()
    servo = sa.Servo(arm)
    found = list(servo.watch(states, ahead=2.0))
    for one in found[1:]:
        left = distance - 0.2 * one.t
        np.testing.assert_allclose(one.distance, abs(left), rtol=0, atol=2e-3)
        wanted = (
            "stop" if left < np.radians(5.0)
            else "warning" if left < np.radians(15.0) or (left - np.radians(5.0)) / 0.2 < 2.0
            else "clear"
        )  # fmt: skip
        assert one.level == wanted or abs(one.ahead - 2.0) < 0.02
    first = next(one for one in found if one.level == "warning")
    np.testing.assert_allclose(first.ahead, 2.0, rtol=0, atol=0.06)
    assert "in 2.0 s at this rate" in first.verdict or "in 1.9 s" in first.verdict


def test_messages_long_after_each_other_are_searched_anew_and_warned_of():
    arm, distance, states = approach(50)
    found = list(sa.Servo(arm).watch([*states[:3], *states[3::12]]))
    for one in found:
        np.testing.assert_allclose(one.distance, abs(distance - 0.2 * one.t), rtol=0, atol=2e-3)
    assert [one.pause > 0.0 for one in found] == [False] * 4 + [True] * (len(found) - 4)
    assert "0.60 s after the message before" in found[-1].verdict
    regular = [{"t": 0.1 * i, "q": states[2 * i]["q"]} for i in range(20)]  # but for rounding
    assert not any(one.pause for one in sa.Servo(arm).watch(regular))


def test_jumps_are_searched_anew():
    arm = sa.load("planar2")
    rng = np.random.default_rng(1)
    states = [{"t": float(i), "q": rng.uniform(-3.0, 3.0, 2)} for i in range(4)]
    for one, state in zip(sa.Servo(arm).watch(states), states, strict=True):
        found = sa.singular_set(arm).nearest(state["q"])
        np.testing.assert_allclose(one.distance, found.distance, rtol=1e-3, atol=1e-6)


def test_messages_of_all_kinds_say_the_same():
    arm, _, states = approach(2)
    names = list(arm.joint_names)[::-1]
    stamped = [{"sec": int(s["t"]), "nanosec": round(1e9 * (s["t"] % 1.0))} for s in states]
    as_ros = [
        {"header": {"stamp": stamp}, "name": names, "position": s["q"][::-1], "velocity": []}
        for s, stamp in zip(states, stamped, strict=True)
    ]
    as_objects = [
        SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace(**stamp)), name=names,
                        position=s["q"][::-1], velocity=[], effort=[])
        for s, stamp in zip(states, stamped, strict=True)
    ]  # fmt: skip
    as_text = [json.dumps({"t": s["t"], "q": s["q"].tolist()}) for s in states]
    servo = sa.Servo(arm)
    wanted = [one.to_dict() for one in servo.watch(states)]
    for messages in (as_ros, as_objects, ["", *as_text, "\n"]):
        for one, other in zip(servo.watch(messages), wanted, strict=True):
            np.testing.assert_allclose(one.distance, other["distance"], rtol=0, atol=1e-9)
            np.testing.assert_allclose(one.closing, other["closing"], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("message", "fault"),
    [
        ("{", "finite"),
        ({"t": 0.2, "q": [np.nan, 1.0]}, "finite"),
        ({"t": np.nan, "q": [0.1, 1.0]}, "finite"),
        ({"t": "now", "q": [0.1, 1.0]}, "finite"),
        ({"t": 0.2, "q": [0.1]}, "finite"),
        ({"t": 0.2, "q": "far"}, "finite"),
        ({"t": 0.2, "q": [10**400, 1.0]}, "finite"),
        ({"t": 0.1, "q": [0.3, 1.2]}, "is not after"),
        ({"t": -5.0, "q": [0.3, 1.2]}, "is not after"),
    ],
)
def test_what_makes_no_sense_is_a_fault_and_the_next_goes_on(message, fault):
    servo = sa.Servo(sa.load("planar2"))
    good = {"t": 0.1, "q": [0.3, 1.2]}
    first, bad, last = servo.watch([good, message, {"t": 0.3, "q": [0.3, 1.2]}])
    assert bad.level == "fault"
    assert fault in bad.verdict
    np.testing.assert_allclose(last.distance, first.distance, rtol=1e-9, atol=0)


def test_messages_about_the_joints_of_others_are_left_out():
    servo = sa.Servo(sa.load("planar2"))
    other = {"t": 0.1, "name": ["finger"], "position": [0.02]}
    found = list(servo.watch([other, {"t": 0.1, "q": [0.3, 1.2]}, other]))
    assert [one.t for one in found] == [0.1]


@pytest.mark.parametrize("message", [{}, [], 3, "3", {"t": 1, "name": ["a"], "position": [1]}])
def test_what_is_no_joint_state_is_named(message):
    servo = sa.Servo(sa.load("planar2"))
    with pytest.raises(sa.ConfigurationError, match="message 1 is not a joint state of planar2"):
        list(servo.watch([message]))


def test_the_command_reads_lines_and_recordings(tmp_path):
    arm, _, states = approach()
    lines = tmp_path / "states.jsonl"
    lines.write_text(
        "".join(json.dumps({"t": s["t"], "q": s["q"].tolist()}) + "\n" for s in states)
    )
    code, out, _ = spacearm("watch", "planar2", lines)
    assert code == 3
    assert "warning" in out
    assert "to stop in" in out
    _, out, _ = spacearm("watch", "planar2", lines, "--json")
    assert [json.loads(line)["level"] for line in out.splitlines()][-1] == "stop"
    pytest.importorskip("mcap_ros2")
    motion = sa.Motion(
        arm, [s["t"] for s in states], [s["q"] for s in states], np.tile(np.eye(7)[6], (60, 1))
    )
    recording = sa.write_motion(motion, tmp_path / "states.mcap")
    code, out, _ = spacearm("watch", "planar2", recording)
    assert code == 3
    assert "60 joint states" in out
    code, _, err = spacearm("watch", "planar2", recording, "--topic", "/other")
    assert code == 2
    assert "has no message on /other" in err
    recording.write_bytes(recording.read_bytes()[:500])
    code, _, err = spacearm("watch", "planar2", recording)
    assert code == 2
    assert "cannot be read" in err


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A recording of two joint states."""
    pytest.importorskip("mcap_ros2")
    arm, _, states = approach(2)
    motion = sa.Motion(
        arm, [s["t"] for s in states], [s["q"] for s in states], np.tile(np.eye(7)[6], (2, 1))
    )
    return sa.write_motion(motion, tmp_path_factory.mktemp("mcap") / "states.mcap")


def test_what_the_library_prints_of_a_damaged_recording_is_not_shown(recording, tmp_path, capsys):
    path = tmp_path / "damaged.mcap"
    path.write_bytes(recording.read_bytes().replace(b"float64[] velocity", b"float64[] velo__ty"))
    with pytest.raises(sa.ConfigurationError, match="velo__ty"):
        list(recorded(path, "/joint_states"))
    assert capsys.readouterr() == ("", "")


def test_damaged_recordings_are_refused_whatever_is_damaged(recording, tmp_path):
    content, refused = recording.read_bytes(), 0
    for seed in range(150):
        rng, changed = np.random.default_rng(seed), bytearray(content)
        for _ in range(10):
            changed[rng.integers(len(changed))] = rng.integers(256)
        path = tmp_path / "damaged.mcap"
        path.write_bytes(changed)
        try:
            list(recorded(path, "/joint_states"))
        except sa.ConfigurationError:
            refused += 1
    assert refused > 50
