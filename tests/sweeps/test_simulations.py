"""Simulations as a quantity of a study."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.sweeps import files

import spacearm as sa
from spacearm.sweeps.study import Chunk

STUDY = """
arms = ["planar2"]
seed = 4
chunk = 3

[parameters]
base_inertia = [1, 2]

[simulation]
controller = {law = "TransposedJacobian", target = [1.5, 1.5], kp = 5, kd = 15}
start.q = [-1.011, 1.053]
start.spread = 0.02
start.attitude = [0, 0, 0.3665]
duration = 8.0
runs = 5
"""


@pytest.fixture
def study():
    pytest.importorskip("tomllib")
    return sa.Study.parse(STUDY)


def test_runs_of_a_chunk_are_those_of_simulate_many(study):
    assert study.count("simulation") == 4
    found = study.compute(Chunk("simulation", 1))
    box = study.box(Chunk("simulation", 1))
    assert box[-1] == slice(3, 5)
    arm = sa.design.vary(study.arms["planar2"], {"base_inertia": 1.0})
    start = np.array([-1.011, 1.053])
    Q0 = start + 0.02 * np.random.default_rng((4, 0, 3)).normal(size=(2, 2))
    turned = pin.SE3(pin.rpy.rpyToMatrix(0, 0, 0.3665), np.zeros(3))
    law = sa.TransposedJacobian(target=[1.5, 1.5], kp=5.0, kd=15.0)
    for i, q0 in enumerate(Q0):
        run = sa.simulate(
            arm.at(q0, base=turned),
            law,
            8.0,
            origin="cm",
            integration=sa.Integration(rtol=1e-6, atol=1e-8, dt=0.04),
        )
        assert found["first_singularity"][0, 0, i] == pytest.approx(run.singular_times[0], abs=1e-9)
        assert not found["success"][0, 0, i]
        assert np.isnan(found["time_to_target"][0, 0, i])
        assert not found["failed"][0, 0, i]
        assert found["least_distance"][0, 0, i] == pytest.approx(run.distance.min(), abs=1e-6)
        turns = [np.linalg.norm(pin.log3(run[0].base.rotation.T @ c.base.rotation)) for c in run]
        assert found["turn"][0, 0, i] == pytest.approx(max(turns), abs=1e-6)


@pytest.mark.slow
def test_the_store_is_the_same_whole_and_resumed(study, tmp_path):
    pytest.importorskip("zarr")
    whole, parts = tmp_path / "whole.zarr", tmp_path / "parts.zarr"
    ds = sa.sweep(study, whole, workers=1)
    assert ds["success"].dims == ("arm", "base_inertia", "run")
    assert ds.sizes["run"] == 5
    assert np.isfinite(ds["least_distance"]).all()
    sa.sweep(study, parts, workers=1)
    kept = files(parts)
    for name in ("chunks/simulation/c/2", "turn/c/0/1/0"):
        (parts / name).unlink()
    sa.sweep(study, parts, workers=1)
    assert files(parts) == kept == files(whole)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("kp = 5, ", "", "kp"),
        ("[1.5, 1.5]", "[1.5]", "task"),
        ("[-1.011, 1.053]", "[0.1]", "q is"),
        ("spread = 0.02", "spread = -1", "spread"),
        ("runs = 5", "runs = 0", "runs"),
        ("TransposedJacobian", "optimal", "law"),
        ("duration = 8.0", 'duration = 8.0\nplant.limits = ["speed"]', "limits"),
        ("duration = 8.0", "", "duration"),
    ],
)
def test_what_makes_no_sense_is_refused(old, new, message):
    pytest.importorskip("tomllib")
    with pytest.raises(sa.SpaceArmError, match=message):
        sa.Study.parse(STUDY.replace(old, new))


def test_dispersed_rates_attitudes_and_noise_are_those_of_simulate_many():
    pytest.importorskip("tomllib")
    more = """start.rate_spread = [0.01, 0.02]
start.attitude_spread = [0, 0, 0.1]
sampling = {period = 0.1, delay = 0.05, position_noise = 1e-3, seed = 5}
"""
    study = sa.Study.parse(STUDY.replace("duration = 8.0", more + "duration = 2.0"))
    found = study.compute(Chunk("simulation", 1))
    arm = sa.design.vary(study.arms["planar2"], {"base_inertia": 1.0})
    rng = np.random.default_rng((4, 0, 3))
    Q0 = np.array([-1.011, 1.053]) + 0.02 * rng.normal(size=(2, 2))
    rates = np.array([0.01, 0.02]) * rng.normal(size=(2, 2))
    turns = np.array([0.0, 0.0, 0.1]) * rng.normal(size=(2, 3))
    law = sa.TransposedJacobian(target=[1.5, 1.5], kp=5.0, kd=15.0)
    for i in range(2):
        R = pin.rpy.rpyToMatrix(0, 0, 0.3665) @ pin.exp3(turns[i])
        noisy = sa.Sampling(period=0.1, delay=0.05, position_noise=1e-3, seed=5 + 3 + i)
        run = sa.simulate(
            arm.at(Q0[i], base=pin.SE3(R, np.zeros(3))), law, 2.0, dq=rates[i], origin="cm",
            sampling=noisy, integration=sa.Integration(rtol=1e-6, atol=1e-8, dt=0.01),
        )  # fmt: skip
        turned = [np.linalg.norm(pin.log3(run[0].base.rotation.T @ c.base.rotation)) for c in run]
        assert found["turn"][0, 0, i] == pytest.approx(max(turned), abs=1e-6)
    for wrong in ("attitude_spread = [0, 1]", "rate_spread = -1", "rate_spread = [1, 2, 3]"):
        name = wrong.partition(" ")[0]
        with pytest.raises(sa.ConfigurationError, match=name):
            sa.Study.parse(STUDY.replace("duration = 8.0", f"start.{wrong}\nduration = 2.0"))
    noise = "sampling = {period = 0.1, rate_noise = [1, 2, 3]}\nduration = 2.0"
    with pytest.raises(sa.ConfigurationError, match="rate_noise"):
        sa.Study.parse(STUDY.replace("duration = 8.0", noise))
