"""Proven curves: on the set all along, refused where there is none."""

import numpy as np
import pytest

import spacearm as sa
from spacearm.polynomial.jets import Chart, Jets
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.workspaces.extent import Box
from spacearm.workspaces.proven import Equations, tubes


def equations(functions, n, low=-np.pi, high=np.pi):
    box = Box.of(np.full(n, low), np.full(n, high), limits=True)
    fitted = [TrigPolynomial.fit(f, n) for f in functions]
    return Equations([Jets.of(f, Chart.turning(n)) for f in fitted], box)


def circle(Q, size=0.5):
    """A closed curve about the origin: cos q1 + cos q2 = 2 - size."""
    return np.cos(Q[:, 0]) + np.cos(Q[:, 1]) - 2.0 + size


def test_a_closed_curve_is_proven_all_around():
    f = equations([circle], 2)
    turn = np.linspace(0.0, 2.0 * np.pi, 41)
    chain = f.onto(0.7 * np.stack((np.cos(turn), np.sin(turn)), axis=1))
    (tube,) = tubes(f, chain)
    assert tube.error < 1e-9
    assert np.abs(circle(tube.points)).max() < 1e-12
    steps = np.linalg.norm(np.diff(tube.points, axis=0), axis=1)
    assert steps.sum() == pytest.approx(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum(), 1e-3)


def test_curves_of_two_equations():
    """All points along them are common roots."""

    def plane(Q):
        return np.sin(Q[:, 2]) - 0.3 * np.sin(Q[:, 0])

    f = equations([circle, plane], 3)
    turn = np.linspace(0.0, 3.0, 20)
    chain = f.onto(0.7 * np.stack((np.cos(turn), np.sin(turn), 0.0 * turn), axis=1))
    (tube,) = tubes(f, chain)
    for g in (circle, plane):
        assert np.abs(g(tube.points)).max() < 1e-12


def test_no_curve_is_proven_where_the_set_is_cut():
    """Two lines that come near to each other: a chain from one to the other is not one curve."""

    def two_lines(Q):
        x = np.cos(2.0 * Q[:, 0])
        return np.cos(Q[:, 1]) + 0.5 * x - 0.48

    f = equations([two_lines], 2)
    x = np.linspace(0.5, 1.2, 30)
    top = 0.48 - 0.5 * np.cos(2.0 * x)
    there = np.stack((x, np.arccos(np.clip(top, -1.0, 1.0))), axis=1)
    across = np.concatenate((there, there[::-1] * (1.0, -1.0)))  # jumps from y to -y
    pieces = tubes(f, across)
    assert len(pieces) == 2
    for piece in pieces:
        assert (piece.points[:, 1] > 0.0).all() or (piece.points[:, 1] < 0.0).all()


def test_no_curve_is_proven_through_a_crossing():
    """sin q1 sin q2 = 0: all derivatives vanish where its lines meet."""
    f = equations([lambda Q: np.sin(Q[:, 0]) * np.sin(Q[:, 1])], 2)
    chain = np.stack((np.linspace(-1.0, 1.0, 9), np.zeros(9)), axis=1)
    pieces = tubes(f, chain)
    assert len(pieces) >= 2
    for piece in pieces:
        assert not (piece.points[:, 0].min() < 0.0 < piece.points[:, 0].max())


def test_curves_stay_within_the_limits():
    """A chain that leaves the box, or that runs along the border outside, is not proven."""
    f = equations([lambda Q: circle(Q, 0.3)], 2, -0.6, 0.6)
    turn = np.linspace(-0.5, 0.5, 11)
    beyond = 0.77 * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    assert tubes(f, np.clip(beyond, -0.6, 0.6)) == []
    x = np.linspace(0.51, 0.6, 7)
    pieces = tubes(f, np.stack((x, np.arccos(1.7 - np.cos(x))), axis=1))
    assert pieces
    assert all((np.abs(piece.points) <= 0.6).all() for piece in pieces)


def test_the_set_of_an_arm_is_followed_between_neighbours():
    found = sa.singular_set(sa.load("planar2"))
    box = Box.of(found.arm.lower, found.arm.upper, limits=False)
    f = Equations([Jets.of(found.S, Chart.turning(2))], box)
    for component in found.components():
        (tube,) = tubes(f, component.points)
        assert np.abs(found.S(tube.points)).max() < 1e-12 * found.S.scale
