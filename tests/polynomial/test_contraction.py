"""Sums over axes of tensors of waves: small and large, by NumPy and compiled."""

import numpy as np
import pytest

from spacearm.polynomial import contraction


@pytest.mark.parametrize(
    ("shape", "keep"),
    [
        ((3, 5), ()),  # machine code alone, once there are many
        ((5, 1, 3), (0,)),
        ((1, 1), ()),
        ((3,), (0,)),  # nothing is summed
        ((3, 3, 5, 7), (1, 3)),  # more than SMALL: products of matrices
        ((3, 5, 3, 3, 3), ()),
    ],
)
@pytest.mark.parametrize("points", [0, 1, 3, 130, contraction.BLOCK + 5])
def test_sums_are_the_definition_whether_compiled_or_not(shape, keep, points, monkeypatch):
    rng = np.random.default_rng(len(shape) + points)
    tensor, Q = rng.normal(size=shape), rng.uniform(-4.0, 4.0, (points, len(shape)))
    waves = [
        np.hstack((np.cos(k * q), np.sin(k[1:] * q)))
        for q, k in ((Q[:, [j]], np.arange(size // 2 + 1)) for j, size in enumerate(shape))
    ]
    names, summed = "abcdef"[: len(shape)], [j for j in range(len(shape)) if j not in keep]
    wanted = np.einsum(
        ",".join([names, *(f"z{names[j]}" for j in summed), "z"])
        + "->"
        + "".join(names[j] for j in keep)
        + "z",
        tensor,
        *(waves[j] for j in summed),
        np.ones(points),
    )
    for many in (1 << 60, -1):  # by NumPy, and at once by machine code
        monkeypatch.setattr(contraction, "MANY", many)
        found = contraction.contract(tensor, Q, keep)
        assert found.shape == wanted.shape
        assert np.abs(found - wanted).max(initial=0.0) <= 1e-13 * np.abs(tensor).sum()
        doubled = contraction.contract(tensor, Q, keep, lambda block: 2.0 * block)
        np.testing.assert_array_equal(doubled, 2.0 * found)
