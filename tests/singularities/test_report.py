"""The singularity report."""

import json

import numpy as np
import pinocchio as pin
import pytest
from helpers import reference
from helpers.arms import chains, load_text, random_base, random_chain, random_configuration, trees
from hypothesis import assume, given
from scipy.optimize import brentq

import spacearm as sa
from spacearm.mechanics.jacobian import singular_values


def test_figure_3_is_a_dynamic_singularity():
    """q = (-65, -11.41) deg at an attitude of 40 deg: the paper's figure 3."""
    attitude = pin.SE3(pin.utils.rotate("z", np.radians(40)), np.zeros(3))
    report = sa.singularity(sa.load("planar2").at(np.radians([-65, -11.41]), base=attitude))
    assert report.kind == "dynamic"
    assert report.rank == 1
    assert np.degrees(report.distance) == pytest.approx(8.0e-4, rel=5e-3)
    assert report.sigma_min < 1e-5
    R = attitude.rotation[:2, :2]
    U, _, VT = np.linalg.svd(R @ reference.planar_jacobian(*np.radians([-65, -11.41])))
    assert abs(report.available[:, 0] @ U[:, 0]) == pytest.approx(1, abs=1e-12)
    assert abs(report.lost[:, 0] @ U[:, 1]) == pytest.approx(1, abs=1e-12)
    assert abs(report.null_space[:, 0] @ VT[1]) == pytest.approx(1, abs=1e-12)


def test_the_root_beside_figure_3():
    """At q1 = -65 deg the exact singular q2 is -11.4108 deg, and sigma_min is rounding there."""
    q1 = np.radians(-65)
    q2 = brentq(lambda q2: reference.planar_singularity(q1, q2), -0.3, -0.1, xtol=1e-15)
    assert np.degrees(q2) == pytest.approx(-11.4108, abs=5e-5)
    report = sa.singularity(sa.load("planar2").at([q1, q2]))
    assert report.sigma_min < 1e-14
    assert report.condition > 1e13


@pytest.mark.parametrize("q", [(0, 0), (0, np.pi), (np.pi, 0)])
def test_stretched_and_folded_planar2_is_kinematic(q):
    report = sa.singularity(sa.load("planar2").at(q))
    assert (report.kind, report.rank) == ("kinematic", 1)


def test_only_kinematic_singularities_are_left_without_free_floating():
    cfg = sa.load("planar2").at(np.radians([-65, -11.41]))
    for mode in ("attitude-controlled", "fixed"):
        assert sa.singularity(cfg, mode=mode).kind == "regular"


@given(trees())
def test_report_is_consistent(cfg):
    report = sa.singularity(cfg)
    J, k, n = report.jacobian, cfg.arm.task.k, cfg.arm.n
    assert report.available.shape == (k, report.rank)
    assert report.lost.shape == (k, k - report.rank)
    assert report.null_space.shape == (n, n - report.rank)
    directions = np.hstack((report.available, report.lost))
    assert np.allclose(directions.T @ directions, np.eye(k), atol=1e-12)
    scale = report.sigma[0]
    lost = report.sigma[report.rank :].max(initial=0.0) + 1e-14 * scale
    assert np.abs(report.lost.T @ J).max(initial=0.0) <= lost
    assert np.abs(J @ report.null_space).max(initial=0.0) <= lost
    assert report.rank == (report.distances > report.tolerance).sum()
    assert list(report.distances) == sorted(report.distances, reverse=True)
    assert report.manipulability == pytest.approx(np.prod(report.sigma))
    if k == n:
        assert abs(report.determinant) == pytest.approx(report.manipulability, rel=1e-6, abs=1e-14)
    else:
        assert report.determinant is None
    assert (report.kind == "regular") == (report.rank == k)


@pytest.mark.slow
@given(trees())
def test_attitude_does_not_matter(cfg):
    for task in ("pose", "x y", "z", "x y rz", "y rx", "orientation", "x y z rz", "rx ry"):
        arm = cfg.arm.replace(task=sa.Task(task, 0.7) if sa.Task(task).mixed else task)
        here, there = (
            singular_values(arm.at(cfg.q, base=base)) for base in (cfg.base, pin.SE3.Identity())
        )
        assert np.allclose(here, there, atol=1e-12 * (1 + there[0]))


@pytest.mark.slow
@given(chains())
def test_gradient_agrees_with_central_differences(cfg):
    report = sa.singularity(cfg)
    gaps = np.append(np.abs(np.diff(report.sigma)), report.sigma_min)
    assume(len(report.gradient) >= cfg.arm.task.k and gaps[-2:].min() > 1e-3)
    h = 1e-6
    differences = [
        (
            singular_values(cfg.arm.at(cfg.q + step, base=cfg.base))[-1]
            - singular_values(cfg.arm.at(cfg.q - step, base=cfg.base))[-1]
        )
        / (2 * h)
        for step in np.eye(cfg.arm.n) * h
    ]
    # differences of sigma_min carry its rounding, 1e-16 * sigma_max / h
    scale = max(np.abs(report.gradient).max(), 1e-3 * report.sigma[0])
    assert np.abs(differences - report.gradient).max() < 1e-6 * scale


def test_fewer_joints_than_rows_is_a_kinematic_loss():
    report = sa.singularity(sa.load("planar2", task="pose").at([0.3, 0.4]))
    assert report.kind == "kinematic"
    assert report.sigma.shape == (6,)
    assert (report.rank, report.sigma_min, report.condition) == (2, 0.0, np.inf)
    assert report.lost.shape == (6, 4)
    assert not report.gradient.any()


def test_redundant_arms_keep_a_still_motion():
    arm = sa.load("chaser7")
    cfg = random_configuration(arm, 3)
    report = sa.singularity(cfg)
    assert report.null_space.shape == (7, 1)
    assert np.abs(sa.generalized_jacobian(cfg) @ report.null_space).max() < 1e-12


def test_mixed_tasks_are_scaled_by_the_length_and_say_so():
    arm = sa.load("mda6")
    cfg = random_configuration(arm, 6)
    report, J = sa.singularity(cfg), sa.generalized_jacobian(cfg)
    assert report.length == arm.task.length > 5.0
    assert np.allclose(report.jacobian, np.vstack((J[:3] / report.length, J[3:])))
    assert sa.singularity(arm.replace(task="position").at(cfg.q)).length is None


def test_tolerance_decides_the_rank():
    cfg = sa.load("planar2").at(np.radians([-65, -11.4]))
    d = sa.singularity(cfg).distance
    assert sa.singularity(cfg, tolerance=1.01 * d).rank == 1
    assert sa.singularity(cfg, tolerance=0.99 * d).rank == 2


@pytest.mark.parametrize("tolerance", [-1e-3, 3.2, np.nan])
def test_a_tolerance_that_is_no_angle_is_refused(tolerance):
    with pytest.raises(sa.ConfigurationError, match="tolerance is"):
        sa.singularity(sa.load("planar2").at([0, 0]), tolerance=tolerance)


def test_to_dict_is_plain_data():
    report = sa.singularity(sa.load("planar2").at([0.3, 0.4]))
    entries = json.loads(json.dumps(report.to_dict()))
    assert entries["sigma"] == list(report.sigma)
    assert entries["kind"] == "regular"
    assert "sigma_min=" in repr(report)


def test_task_axes_stay_inertial_in_the_plane_and_tilt_out_of_it():
    task = sa.Task("x y")
    turn = pin.utils.rotate("z", 1.2)
    assert np.allclose(task.axes(turn), np.eye(3))
    assert np.allclose(
        sa.Task("pose").axes(random_base(np.random.default_rng(1)).rotation), np.eye(3)
    )
    R = random_base(np.random.default_rng(2)).rotation
    axes = task.axes(R)
    assert np.allclose(axes[:, 2], R[:, 2])
    assert np.allclose(axes.T @ axes, np.eye(3))
    assert np.allclose(sa.Task("x rz").axes(R), R)
    flip = np.diag([1.0, -1.0, -1.0])
    assert np.allclose(task.axes(flip)[:, 2], flip[:, 2])


@pytest.mark.parametrize("names", ["", "x x", "pose x", 7])
def test_bad_tasks_are_refused(names):
    with pytest.raises(sa.ConfigurationError):
        sa.Task(names)


@pytest.mark.parametrize("length", [0.0, -1.0, np.nan, np.inf])
def test_bad_lengths_are_refused(length):
    with pytest.raises(sa.ConfigurationError, match="task length is"):
        sa.Task("pose", length)


def test_a_chain_of_zero_motion_is_reported_not_crashed():
    arm = load_text(random_chain(1, 3), tip="link_1", task="z", joints="all")
    assert sa.singularity(arm.at([0, 0, 0])).sigma.shape == (1,)


@pytest.mark.parametrize(("name", "beside"), [("planar2", False), ("vispa_cubesat", True)])
def test_attitude_control_leaves_kinematic_singularities_where_cms_are_in_line(name, beside):
    """Section VI of the paper; CMs beside the lines between joints leave others."""
    arm, mode = sa.load(name), "attitude-controlled"
    Q = sa.singular_set(arm, mode=mode).sample(20, np.random.default_rng(0))
    reports = [sa.singularity(arm.at(q), mode=mode) for q in Q]
    assert ("dynamic" in {report.kind for report in reports}) == beside
    assert not any(report.kind == "regular" for report in reports)
    for report in reports:
        held = sa.singularity(report.configuration, mode="fixed", exact=True).distance
        assert held < 2e-4 if report.kind == "kinematic" else held > 0.5e-4
