"""The search for events, step by step."""

import ast
from pathlib import Path

import numpy as np
import pytest

import spacearm as sa
from spacearm.motion import following
from spacearm.motion.events import EVENT_KINDS, EVENTS, NEAR, first_fall

SOURCES = Path(sa.__file__).parent
#: Where the kind of an event is a variable: the kinds that it may have there.
VARIABLE = {
    "closure/target_runs.py": {"grasp", "joint limit", "wheel full"},
    "motion/following.py": set(following.ENDS),
    "motion/leading.py": set(following.ENDS),
    "motion/run.py": set(EVENTS),
}


def emitted(path):
    """The kinds of the events that a module makes."""
    text = path.read_text(encoding="utf-8")
    uses = "motion.events" in text or "motion import events" in text
    if "class Event(" in text or not uses:
        return set()
    found = set()
    for call in ast.walk(ast.parse(text)):
        if not isinstance(call, ast.Call) or ast.unparse(call.func) not in (
            "Event",
            "events.Event",
        ):
            continue
        if len(call.args) < 4:  # one of another kind
            continue
        kind = call.args[1]
        if isinstance(kind, ast.Constant):
            found.add(kind.value)
        else:
            found |= VARIABLE[path.relative_to(SOURCES).as_posix()]
    return found


def test_the_docstring_of_an_event_lists_all_kinds_that_occur():
    kinds = set().union(*(emitted(path) for path in sorted(SOURCES.rglob("*.py"))))
    assert kinds == set(EVENT_KINDS)
    doc = " ".join(sa.Event.__doc__.split())
    assert [kind for kind in EVENT_KINDS if f'"{kind}"' not in doc] == []


@pytest.mark.parametrize("off", [0.0, 1e-18, -1e-18])
def test_an_event_between_two_steps_is_found(off):
    """The same place as the end of a step and as the start of the next differs by rounding."""

    def first(t):
        return np.array([1.0, 1e-3 * (1.0 - t) + 1e-18])

    def second(t):
        return np.array([1.0, off - 1e-3 * (t - 1.0)])

    assert first_fall(first, first(0.0), first(1.0), 0.0, 1.0) is None
    t, which = first_fall(second, first(1.0), second(2.0), 1.0, 2.0)
    assert (t, which) == (pytest.approx(1.0, abs=1e-12), 1)


def across(arm, rng):
    """Ends of a straight segment in joint space that meets the singular set in its middle."""
    (q,) = sa.singular_set(arm).sample(1, rng)
    way = rng.normal(size=arm.n)
    way *= 0.06 / np.linalg.norm(way)
    return q - way, q + way


def check_of_the_exact_set(arm, event, before):
    """At the event the set is half a degree away, by a search of its own, and not before."""
    near = sa.singular_set(arm).nearest(event.q)
    nearest, distance = near.q, near.distance
    assert distance == pytest.approx(NEAR, abs=1e-8)
    np.testing.assert_allclose(event.nearest, nearest, atol=1e-6)
    assert sa.singularity(arm.at(event.nearest)).sigma_min < 1e-9
    for q in before:
        assert sa.singular_set(arm).nearest(q).distance > NEAR


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_simulation_meets_the_exact_set_of_a_redundant_arm(seed, tmp_path):
    arm = sa.load("servicer_panda")
    start, end = across(arm, np.random.default_rng(seed))
    law = sa.JointPD(target=end, kp=40.0, kd=15.0)
    run = sa.simulate(arm.at(start), law, 4.0, stop=["singularity"])
    event = run.events[-1]
    assert (event.kind, event.t) == (run.ended, run.t[-1])
    check_of_the_exact_set(arm, event, run.q[:-1][-3:])
    run.save(tmp_path / "run.npz")
    (*_, kept) = sa.Trajectory.load(tmp_path / "run.npz", arm).events
    np.testing.assert_array_equal(kept.nearest, event.nearest)
    many = sa.simulate_many([arm.at(start)] * 2, law, 4.0)  # memory that is used again
    np.testing.assert_allclose(many.first_singularity, event.t, rtol=1e-6, atol=0)


def test_a_path_of_the_tip_ends_at_the_exact_set_of_a_redundant_arm():
    arm = sa.load("chaser7")
    start = arm.at([0.3, 0.5, -0.4, 0.9, 0.2, 0.7, 0.1])
    beyond = start.tip.copy()
    beyond.translation *= 20.0 / np.linalg.norm(beyond.translation)
    motion = sa.follow(start, [beyond], limits=False)
    assert motion.ended == "singularity"
    near = sa.singular_set(arm).nearest(motion.q[-1])
    nearest, distance = near.q, near.distance
    assert distance == pytest.approx(NEAR, abs=1e-7)
    assert f"at q = {arm.in_words(nearest)}:" in motion.reason
    assert sa.singular_set(arm).nearest(motion.q[-5]).distance > NEAR


def test_a_moving_target_is_no_event_while_the_tip_is_with_it_from_the_start():
    """One that is caught up with is; a target at rest where the tip is counts at once."""
    cfg = sa.load("planar2").at([0.3, 1.2])
    here = cfg.tip.translation[:2]

    def reached(offset, speed):
        start = here + np.array([offset, 0.0])
        target = start if speed == 0.0 else lambda t: start + np.array([speed * t, 0.0])
        run = sa.simulate(cfg, sa.TransposedJacobian(target=target, kp=20.0, kd=60.0), 20.0)
        return [event for event in run.events if event.kind == "target"]

    assert reached(0.0, 0.0)[0].t == 0.0
    assert all(event.t > 0.0 for event in reached(0.0, -0.01))
    caught = reached(-0.05, -0.001)
    assert caught
    assert "moving target" in caught[0].detail
