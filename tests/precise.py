"""The generalized Jacobian and its singular values to 50 digits, from the definitions."""

from __future__ import annotations

import mpmath as mp

mp.mp.dps = 50


def matrix(values) -> mp.matrix:
    return mp.matrix([[mp.mpf(float(x)) for x in row] for row in values])


def vector(values) -> mp.matrix:
    return mp.matrix([mp.mpf(float(x)) for x in values])


def cross(a, b) -> mp.matrix:
    return mp.matrix(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def turned(axis, angle) -> mp.matrix:
    """Rodrigues' formula."""
    K = mp.matrix([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return mp.eye(3) + mp.sin(angle) * K + (1 - mp.cos(angle)) * K * K


def generalized_jacobian(cfg, base="free-floating") -> mp.matrix:
    """J* of an arm with one tip, the spacecraft's frame the inertial one, all sums body by body.

    Momentum about the system CM is that of bodies that move as joint k, or the spacecraft along
    or about an axis, moves them: h = sum m v, and sum R I R^T w + m (p - c) x v.
    """
    arm, model = cfg.arm, cfg.arm.model
    positions = [mp.mpf(float(x)) for x in cfg.q]
    if arm.coupling is not None:
        positions = list(matrix(arm.coupling) * mp.matrix(positions) + vector(arm.offsets))
    R, p = [mp.eye(3)], [mp.zeros(3, 1)]
    motions = [(mp.zeros(3, 1), e) for e in columns(mp.eye(3))]  # (angular, velocity of origin)
    motions += [(e, mp.zeros(3, 1)) for e in columns(mp.eye(3))]
    for j, q in enumerate(positions, start=1):
        joint, placement = arm.tree.joints[model.names[j + 1]], model.jointPlacements[j + 1]
        parent = model.parents[j + 1] - 1
        axis = vector(joint.axis) / mp.norm(vector(joint.axis))
        E = R[parent] * matrix(placement.rotation)
        slides = joint.kind == "prismatic"
        R.append(E if slides else E * turned(axis, q))
        p.append(p[parent] + R[parent] * vector(placement.translation))
        u = E * axis
        if slides:
            p[j] = p[j] + q * u
        motions.append((mp.zeros(3, 1), u) if slides else (u, -cross(u, p[j])))
    bodies = range(len(R))
    m = [mp.mpf(float(inertia.mass)) for inertia in model.inertias[1:]]
    CM = [p[k] + R[k] * vector(model.inertias[k + 1].lever) for k in bodies]
    I = [R[k] * matrix(model.inertias[k + 1].inertia) * R[k].T for k in bodies]
    M = mp.fsum(m)
    c = sum((m[k] * CM[k] for k in bodies), mp.zeros(3, 1)) / M
    frame = model.frames[arm.tip_frame]
    at = frame.parentJoint - 1
    r_E = p[at] + R[at] * vector(frame.placement.translation)

    A, J = mp.zeros(6, len(motions)), mp.zeros(6, len(motions))
    for column, (w, v) in enumerate(motions):
        carried = [column < 6 or column - 4 in list(model.supports[k + 1]) for k in bodies]
        for k in bodies:
            if carried[k]:
                v_k = v + cross(w, CM[k])
                h = I[k] * w + m[k] * cross(CM[k] - c, v_k)
                for x in range(3):
                    A[x, column] += m[k] * v_k[x]
                    A[3 + x, column] += h[x]
        if carried[at]:
            v_E = v + cross(w, r_E)
            for x in range(3):
                J[x, column], J[3 + x, column] = v_E[x], w[x]
    f = {"free-floating": 6, "attitude-controlled": 3, "fixed": 0}[base]
    J_star = J[:, 6:]
    if f:
        J_star = J_star - J[:, :f] * A[:f, :f] ** -1 * A[:f, 6:]
    return J_star if arm.coupling is None else J_star * matrix(arm.coupling)


def columns(a) -> list[mp.matrix]:
    return [a[:, j] for j in range(a.cols)]


def singular_values(cfg, J: mp.matrix) -> list[mp.mpf]:
    """Of the task rows of J, largest first, at the identity attitude."""
    task = cfg.arm.task
    scaled = mp.matrix(task.k, J.cols)
    for row, (index, scale) in enumerate(zip(task.indices, task.scale[:, 0], strict=True)):
        for column in range(J.cols):
            scaled[row, column] = J[index, column] * mp.mpf(float(scale))
    sigma = mp.svd_r(scaled if scaled.rows <= scaled.cols else scaled.T, compute_uv=False)
    return [*sigma, *[mp.mpf(0)] * (task.k - len(sigma))]
