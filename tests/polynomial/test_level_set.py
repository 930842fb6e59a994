"""Zero sets of functions on the torus as triangles: closed surfaces of known shape."""

from collections import Counter

import numpy as np
import pytest

from spacearm.polynomial.level_set import _isosurface, lines
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
