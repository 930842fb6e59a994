"""Slow, independent formulas: the closed forms of the paper's planar example."""

from __future__ import annotations

import numpy as np

m0, m1, m2 = 40.0, 4.0, 3.0
I0, I1, I2 = 6.667, 0.333, 0.250
r0 = l1 = r1 = l2 = r2 = 0.5
M = m0 + m1 + m2

alpha = r0 * m0 / M
beta = (r1 * (m0 + m1) + l1 * m0) / M
gamma = l2 * (m0 + m1) / M + r2


def planar_inertias(q1, q2):
    """D0, D1, D2 of appendix A."""
    d00 = I0 + m0 * (m1 + m2) / M * r0**2
    d10 = m0 * r0 / M * (l1 * (m1 + m2) + r1 * m2) * np.cos(q1)
    d20 = m0 * m2 / M * r0 * l2 * np.cos(q1 + q2)
    d11 = I1 + m0 * m1 / M * l1**2 + m1 * m2 / M * r1**2 + m0 * m2 / M * (l1 + r1) ** 2
    d21 = (m1 * m2 / M * r1 * l2 + m0 * m2 / M * l2 * (l1 + r1)) * np.cos(q2)
    d22 = I2 + m2 * (m0 + m1) / M * l2**2
    return d00 + d10 + d20, d10 + d11 + d21, d20 + d21 + d22


def planar_jacobian(q1, q2):
    """0J* of equation (39b), (2, 2), spacecraft axes."""
    D0, D1, D2 = planar_inertias(q1, q2)
    D = D0 + D1 + D2
    s1, c1, s12, c12 = np.sin(q1), np.cos(q1), np.sin(q1 + q2), np.cos(q1 + q2)
    return (
        np.array(
            [
                [-(beta * s1 + gamma * s12) * D0, beta * s1 * D2 - gamma * s12 * (D0 + D1)],
                [
                    (beta * c1 + gamma * c12) * D0 - alpha * (D1 + D2),
                    -(alpha + beta * c1) * D2 + gamma * c12 * (D0 + D1),
                ],
            ]
        )
        / D
    )


def planar_singularity(q1, q2):
    """S of equation (41)."""
    D0, D1, D2 = planar_inertias(q1, q2)
    return (
        alpha * beta * D2 * np.sin(q1)
        + beta * gamma * D0 * np.sin(q2)
        - alpha * gamma * D1 * np.sin(q1 + q2)
    )


def planar_radius(q1, q2):
    """R, distance of the tip from the system CM, equation (45)."""
    cross = alpha * beta * np.cos(q1) + alpha * gamma * np.cos(q1 + q2) + beta * gamma * np.cos(q2)
    return np.sqrt(alpha**2 + beta**2 + gamma**2 + 2 * cross)
