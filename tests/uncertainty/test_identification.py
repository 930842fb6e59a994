"""Held bodies are identified from rates: exactly without noise, within their covariance with it."""

from functools import cache

import numpy as np
import pytest

import spacearm as sa
from spacearm.uncertainty import identification

MASS, COM = 50.0, np.array([0.1, -0.05, 0.4])
INERTIA = np.array([[4.0, 0.3, -0.2], [0.3, 3.0, 0.1], [-0.2, 0.1, 2.5]])
KNOWN = sa.load("mda6")
COARSE = sa.Integration(dt=0.1)


@cache
def measured(momentum: bool = True) -> sa.Trajectory:
    """A motion of all joints with the body in the hand, with momentum on board."""
    h = [1.0, 2.0, -1.0, 3.0, -2.0, 4.0] if momentum else np.zeros(6)
    start = KNOWN.grasp(MASS, INERTIA, COM).at([0, 1, -1.5, -0.9, 0.3, 0], momentum=h)
    law = sa.JointPD(start.q + np.array([0.8, -0.5, 0.9, 0.7, -0.8, 0.9]), kp=50, kd=60)
    return sa.simulate(start, law, 10.0, integration=COARSE)


@pytest.mark.parametrize("momentum", [True, False])
def test_without_noise_the_body_is_found_whatever_the_momentum(momentum):
    """Mass, CM, inertia and the momentum, to the tolerance of the simulation."""
    run = measured(momentum)
    found = sa.identify(run, KNOWN)
    assert found.mass == pytest.approx(MASS, rel=1e-6)
    np.testing.assert_allclose(found.com, COM, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.inertia, INERTIA, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.momentum, run.momentum[0], rtol=0, atol=1e-5)
    assert len(found.unexcited) == 0


def test_rates_by_splines_will_do():
    """Positions and poses only: rates are those of splines through them."""
    run = measured()
    found = sa.identify(sa.Motion(run.arm, run.t, run.q, run.base), KNOWN)
    assert found.mass == pytest.approx(MASS, rel=2e-2)
    np.testing.assert_allclose(found.com, COM, rtol=0, atol=2e-2)


@pytest.mark.slow
def test_errors_are_as_large_as_their_covariance_says_and_the_mass_is_not_biased():
    """Noise in all rates: 12 estimates, errors over deviations, a chi^2 of 12 x 10 numbers."""
    run, rng = measured(), np.random.default_rng(1)
    twists, noise = identification._twists(run), np.array([1e-3, 5e-4, 2e-3])
    truth = np.array(sa.identify(run, KNOWN).parameters)  # equal to the body to 1e-6, see above
    squares, masses = [], []
    for _ in range(12):
        found = sa.identify(
            run,
            KNOWN,
            dq=run.dq + noise[2] * rng.normal(size=run.dq.shape),
            twist=twists + np.repeat(noise[:2], 3) * rng.normal(size=twists.shape),
            noise=noise,
        )
        off = found.parameters - truth
        squares.append(off @ np.linalg.solve(found.covariance, off))
        masses.append(off[0] / np.sqrt(found.covariance[0, 0]))
        assert 0.9 < found.misfit < 1.1
    assert 60.0 < sum(squares) < 200.0  # chi^2 of 120 degrees has the deviation 15.5
    assert abs(np.mean(masses)) < 4.0 / np.sqrt(12)


def test_what_a_plane_does_not_excite_is_named_and_the_body_can_exist():
    """In the plane turns about z tell Izz; Ixx, Ixy and Iyy stay unknown, the body possible."""
    arm = sa.load("planar2")
    start = arm.grasp(3.0, 0.4 * np.eye(3), (0.1, 0.2, 0)).at([0.3, 1.2])
    found = sa.identify(
        sa.simulate(start, sa.JointPD([1.0, 0.2], kp=5, kd=5), 8.0, integration=COARSE), arm
    )
    assert found.mass == pytest.approx(3.0, rel=1e-5)
    assert found.inertia[2, 2] == pytest.approx(0.4, rel=1e-5)
    assert len(found.unexcited) == 3
    np.testing.assert_allclose(found.unexcited[:, [0, 1, 2, 3, 7, 8, 9]], 0.0, rtol=0, atol=1e-6)
    assert found.holding.mass == pytest.approx(arm.mass + 3.0, rel=1e-5)
    with pytest.raises(sa.UnsupportedError, match="Ixx"):
        found.uncertain()
    assert "not excited" in found.describe().notes[1]


def test_the_uncertain_arm_holds_the_body_and_its_deviations():
    """Its intervals are three deviations about the estimate, and hold the truth."""
    run, rng = measured(), np.random.default_rng(2)
    dq = run.dq + 2e-4 * rng.normal(size=run.dq.shape)
    found = sa.identify(run, KNOWN, dq=dq, noise=(1e-6, 1e-6, 2e-4))
    about = found.uncertain()
    assert about.arm.mass == pytest.approx(KNOWN.mass + found.mass)
    mass = next(p for p in about.parameters if p.kind == "mass")
    assert mass.low < MASS < mass.high
    assert mass.high - mass.low == pytest.approx(6.0 * found.deviations[0], rel=0.02)


def test_a_flight_is_taken_from_the_last_grasp_on():
    """The arm of the flight is known; what was grasped is not looked at."""
    start = KNOWN.at([0, 1, -1.5, -0.9, 0.3, 0])
    law = sa.JointPD(start.q + 0.5, kp=50, kd=60)
    body = sa.Grasp(mass=MASS, inertia=INERTIA, com=COM, twist=(0.01, 0, 0, 0, 0.02, 0))
    flight = sa.simulate_phases(start, [sa.Phase(law, 1.0, body), sa.Phase(law, 5.0)])
    assert sa.identify(flight).mass == pytest.approx(MASS, rel=1e-5)
    alone = sa.simulate_phases(start, [sa.Phase(law, 1.0)])
    with pytest.raises(sa.UnsupportedError, match="holds nothing"):
        sa.identify(alone)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"arm": sa.load("planar2")}, "other joints"),
        ({"dq": [1.0]}, "dq"),
        ({"twist": [[0.0] * 6]}, "twist"),
        ({"noise": (1.0, 0.0, 1.0)}, "noise"),
    ],
)
def test_mistakes_are_named(change, words):
    """Each error names the argument."""
    with pytest.raises(sa.ConfigurationError, match=words):
        sa.identify(measured(), **({"arm": KNOWN} | change))


def test_at_rest_nothing_is_excited():
    """An arm that does not move tells nothing."""
    still = KNOWN.at([0, 1, -1.5, -0.9, 0.3, 0])
    base = [still.base] * 5
    motion = sa.Motion.of(
        type("Still", (), {"arm": KNOWN, "t": range(5), "q": [still.q] * 5, "base": base})()
    )
    with pytest.raises(sa.NoSolutionError, match="excites none"):
        sa.identify(motion)
