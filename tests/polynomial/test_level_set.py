"""Zero sets of functions on the torus as triangles: closed surfaces of known shape."""

from collections import Counter

import numpy as np
import pytest

from spacearm.polynomial.level_set import (
    _hides_something,
    _isosurface,
    lines,
    rough_surface,
    surface,
)
from spacearm.polynomial.newton import shortened
from spacearm.polynomial.trig import TrigPolynomial

N = 24
ANGLES = 2 * np.pi * np.arange(N) / N + 0.0123


def shape(values):
    """How many triangles meet at the edges, and the Euler characteristic."""
    points, triangles = _isosurface(values)
    sides = np.sort(np.stack((triangles, np.roll(triangles, 1, axis=1)), axis=-1), axis=-1)
    edges = Counter(map(tuple, sides.reshape(-1, 2).tolist()))
    assert len(np.unique(triangles)) == len(points)
    return set(edges.values()), len(points) - len(edges) + len(triangles)


@pytest.mark.parametrize(
    ("function", "characteristic"),
    [
        (lambda x, y, z: np.cos(x) + np.cos(y) + np.cos(z) - 2.5, 2),  # nearly a sphere
        (lambda x, y, z: 2.5 - np.cos(x) - np.cos(y) - np.cos(z), 2),
        (lambda x, y, z: np.cos(x) + 0 * y + 0 * z, 0),  # two tori
        (lambda x, y, z: np.cos(x) + np.cos(y) + np.cos(z), -4),  # Schwarz's P surface
        (lambda x, y, z: np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x), -8),
    ],
)
def test_surfaces_are_closed_and_of_the_right_shape(function, characteristic):
    values = function(*np.meshgrid(ANGLES, ANGLES, ANGLES, indexing="ij"))
    assert shape(values) == ({2}, characteristic)


def test_any_signs_give_a_closed_surface():
    """Noise has every case of every tetrahedron in it."""
    values = np.random.default_rng(1).normal(size=(8, 8, 8))
    assert shape(values)[0] <= {2}


def test_the_points_are_where_the_function_is_zero():
    x = np.meshgrid(ANGLES, ANGLES, ANGLES, indexing="ij")[0]
    values = np.cos(x)
    points, triangles = _isosurface(values)
    step = 2 * np.pi / N
    found = np.unique(np.round((ANGLES[0] + points[:, 0] * step) % np.pi, 2))
    np.testing.assert_allclose(found, np.pi / 2, atol=0.02)
    corners = points[triangles]
    corners -= N * np.round((corners - corners[:, :1]) / N)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert 0.5 * np.linalg.norm(normals, axis=1).sum() == pytest.approx(2 * N**2, rel=0.01)


def test_nothing_is_found_where_there_is_nothing():
    points, triangles = _isosurface(np.ones((4, 4, 4)))
    assert points.shape == triangles.shape == (0, 3)


@pytest.mark.parametrize("eps", [1e-3, 1e-5, 1e-9, -1e-5, -1e-9])
def test_necks_narrower_than_a_cell_part_the_lines_that_they_should(eps):
    """sin q1 sin q2 + eps: two loops, each in a square where the product has the sign of -eps."""
    c = np.array([[-1.0, 0.0, 1.0], [0.0, 4.0 * eps, 0.0], [1.0, 0.0, -1.0]], complex) / 4.0
    found = lines(TrigPolynomial(c))
    assert len(found) == 2
    for loop in found:
        sines = np.sin(loop)
        assert (sines.prod(axis=1) + eps) == pytest.approx(0.0, abs=1e-11)
        assert (np.abs(np.sign(sines).sum(axis=0)) == len(loop)).all()


def polynomial(seed, level):
    """A polynomial of three angles; its zero set has the more and smaller pieces the higher."""
    rng = np.random.default_rng(seed)
    c = rng.normal(size=(5, 5, 3)) + 1j * rng.normal(size=(5, 5, 3))
    c[2, 2, 1] += level
    return TrigPolynomial(c + np.conj(c[::-1, ::-1, ::-1]))


def test_points_of_a_rough_surface_are_near_the_set_and_connected_as_those_on_it():
    S = polynomial(1, 6.0)
    rough, exact = rough_surface(S, resolution=0.14), surface(S, resolution=0.14)
    assert (rough.triangles == exact.triangles).all()
    off = np.abs(np.angle(np.exp(1j * (rough.vertices - exact.vertices))))
    assert 1e-6 < off.max() < 0.14
    assert np.abs(S(exact.vertices)).max() < 1e-11 * S.scale


@pytest.mark.parametrize(("radius", "hidden"), [(0.05, True), (0.3, False)])
def test_a_piece_between_the_points_of_a_grid_is_noticed(radius, hidden):
    """A ball about a point that is in the middle of a cell."""
    step = 2 * np.pi / N
    c = np.zeros((3, 3, 3), complex)
    for at in ((0, 1, 1), (1, 0, 1), (1, 1, 0), (2, 1, 1), (1, 2, 1), (1, 1, 2)):
        c[at] = 0.5
    c[1, 1, 1] = -3.0 + 0.5 * radius**2
    S = TrigPolynomial(c).shifted(np.full(3, -0.5 * step))
    values = S.grid((N, N, N))
    assert (values > 0.0).any() != hidden
    assert _hides_something(S, values, step) == hidden


def test_steps_are_shortened_and_what_is_not_finite_is_no_step():
    steps = np.array([[3.0, 4.0], [0.03, 0.04], [np.inf, 1.0], [np.nan, 0.0], [-1e300, 0.0]])
    expected = [[0.06, 0.08], [0.03, 0.04], [0.0, 0.0], [0.0, 0.0], [-0.1, 0.0]]
    np.testing.assert_allclose(shortened(steps, 0.1), expected, rtol=1e-12, atol=1e-300)
