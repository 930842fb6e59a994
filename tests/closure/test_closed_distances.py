"""Distances along closure: what is searched, against a search that shares nothing with it."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.closed import closed
from scipy.optimize import minimize

import spacearm as sa


def open_by(cfg, grasps):
    """How far two tips are from one place of what they hold, (6,)."""
    frames = [tip * grasp.inverse() for tip, grasp in zip(cfg.tips, grasps.values(), strict=True)]
    return pin.log6(frames[0].actInv(frames[1])).vector


def least_of(cfg):
    """Least over largest singular value of the rows of momentum and hands."""
    A_b, A_q = sa.momentum_matrix(cfg)
    R = np.kron(np.eye(2), cfg.base.rotation)
    rows = np.vstack((np.hstack((A_b, A_q)), np.hstack((cfg.J[:, :6] @ R.T, cfg.J[:, 6:]))))
    sigma = np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None], compute_uv=False)
    return sigma[-1] / sigma[0]


def determinant(cfg):
    """Determinant of the same rows, which changes its sign where they lose rank."""
    A_b, A_q = sa.momentum_matrix(cfg)
    R = np.kron(np.eye(2), cfg.base.rotation)
    rows = np.vstack((np.hstack((A_b, A_q)), np.hstack((cfg.J[:, :6] @ R.T, cfg.J[:, 6:]))))
    return np.linalg.det(rows / np.linalg.norm(rows, axis=1)[:, None])


def found_otherwise(held, starts):
    """The nearest closed singular posture that SciPy's SLSQP finds: how far it is."""
    arm, q0, best = held.arm, held.q, np.inf
    scale = abs(determinant(held.configuration))

    def equations(q):
        cfg = arm.at(q)
        return np.append(open_by(cfg, held.grasps), determinant(cfg) / scale)

    for start in starts:
        done = minimize(
            lambda q: float((q - q0) @ (q - q0)), start, jac=lambda q: 2.0 * (q - q0),
            method="SLSQP", constraints={"type": "eq", "fun": equations},
            options={"maxiter": 100, "ftol": 1e-9},
        )  # fmt: skip
        if np.abs(equations(done.x)).max() < 1e-6:
            best = min(best, float(np.linalg.norm(done.x - q0)))
    return best


def test_the_posture_found_is_closed_and_singular():
    """By rows of momentum and hands, and by the tips alone; the estimate is 1.6 times too long."""
    held = closed(3)
    search = held.carrying.search("free-floating")
    distance = search.look(held.configuration, held.target, tries=1)
    nearest = search.nearest(held.q)
    there = held.arm.at(nearest)
    assert np.abs(open_by(there, held.grasps)).max() < 1e-8
    assert least_of(there) < 1e-8 < 1e-3 * least_of(held.configuration)
    assert distance == pytest.approx(np.linalg.norm(nearest - held.q), rel=1e-12)
    assert held.report().distance > 1.5 * distance


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 4, 7, 13, 15, 18])
def test_no_other_search_finds_a_nearer_one(seed):
    """Of random pairs of arms whose first-order estimates are up to three times too long."""
    held = closed(seed)
    report = held.report(exact=True)
    rng = np.random.default_rng(seed)
    starts = held.q + rng.normal(size=(8, held.arm.n)) * 0.5 * report.distance / np.sqrt(12.0)
    other = found_otherwise(held, [held.q, *starts])
    assert np.isfinite(other)
    assert report.distance <= 1.0001 * other


@pytest.mark.slow
def test_a_path_knows_the_nearest_singular_posture_found():
    """At each row no farther than a search from there finds, within a thousandth of it."""
    held = closed(15)
    place = held.target.pose.copy()
    place.translation = place.translation + np.array([0.02, 0.01, -0.02])
    way = held.follow([place], limits=False)
    estimate = held.report().distance
    assert way.closure_distance[0] < 0.5 * estimate
    apart = np.linalg.norm(np.diff(way.q, axis=0), axis=1)
    assert (np.abs(np.diff(way.closure_distance)) <= apart + 1e-9).all()
    end = held.after(way).report(exact=True)
    assert way.closure_distance[-1] <= 1.001 * end.distance
