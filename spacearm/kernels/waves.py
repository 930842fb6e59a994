"""Real waves 1, cos q, ..., cos d q, sin q, ..., sin d q at many angles."""

from __future__ import annotations

from spacearm.kernels.cpu import kernel
from spacearm.kernels.lanes import Lanes, sine_cosine


@kernel
def fill_waves(q: Lanes, rows: Lanes) -> None:
    """Write the waves at angles (m,) to rows (2 d + 1, m), d > 0."""
    d = rows.shape[0] // 2
    rows[0] = 1.0
    c, s = rows[1], rows[d + 1]
    sine_cosine(q, s, c)
    for k in range(1, d):
        for i in range(q.shape[0]):
            rows[k + 1, i] = c[i] * rows[k, i] - s[i] * rows[d + k, i]
            rows[d + k + 1, i] = s[i] * rows[k, i] + c[i] * rows[d + k, i]
