"""The generalized Jacobian and its singular values to 50 digits, from the definitions."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import mpmath as mp
from lxml import etree

mp.mp.dps = 50


def matrix(values) -> mp.matrix:
    return mp.matrix([[mp.mpf(x) for x in row] for row in values])


def vector(values) -> mp.matrix:
    return mp.matrix([mp.mpf(x) for x in values])


def cross(a, b) -> mp.matrix:
    return mp.matrix(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def turned(axis, angle) -> mp.matrix:
    """Rodrigues' formula."""
    K = mp.matrix([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return mp.eye(3) + mp.sin(angle) * K + (1 - mp.cos(angle)) * K * K


class Pose(NamedTuple):
    """A pose to 50 digits, as rows of numbers."""

    rotation: list
    translation: list


def numbers(element, attribute) -> list[float]:
    return [float(word) for word in element.get(attribute, "0 0 0").split()]


def pose(origin) -> Pose:
    """Of a URDF's <origin xyz rpy>: R_z(yaw) R_y(pitch) R_x(roll)."""
    roll, pitch, yaw = vector(numbers(origin, "rpy"))
    x, y, z = columns(mp.eye(3))
    R = turned(z, yaw) * turned(y, pitch) * turned(x, roll)
    return Pose(R.tolist(), numbers(origin, "xyz"))


def as_written(tree, text: str):
    """The tree with poses and axes from the numbers of its URDF, in which they are complete."""
    robot = etree.fromstring(text.encode())
    joints, links = dict(tree.joints), dict(tree.links)
    for joint in robot.iter("joint"):
        name, axis = joint.get("name"), numbers(joint.find("axis"), "xyz")
        joints[name] = replace(joints[name], origin=pose(joint.find("origin")), axis=axis)
    for inertial in robot.iter("inertial"):
        name = inertial.getparent().get("name")
        links[name] = links[name]._replace(origin=pose(inertial.find("origin")))
    return replace(tree, joints=joints, links=links)


def coupled(tree) -> tuple[dict, dict]:
    """Of every movable joint its rates per rate of the leading ones, and its position at q = 0."""
    order = [joint.name for joint in tree.leading()]
    rates = {name: mp.eye(len(order))[i, :] for i, name in enumerate(order)}
    offsets = {name: mp.mpf(0) for name in order}
    following = [joint for joint in tree.joints.values() if joint.mimic]
    while following:
        joint = following.pop(0)
        leader, multiplier, offset = joint.mimic
        if leader in rates:
            rates[joint.name] = mp.mpf(multiplier) * rates[leader]
            offsets[joint.name] = mp.mpf(multiplier) * offsets[leader] + mp.mpf(offset)
        else:
            following.append(joint)
    return rates, offsets


def momentum_and_jacobian(cfg, tree=None) -> tuple[mp.matrix, mp.matrix]:
    """[A_b A_q] and [J_b J_q] of an arm with one tip, all sums link by link, inertial axes.

    Momentum about the system CM is that of links that move as joint k, or the spacecraft along
    or about an axis, moves them: h = sum m v, and sum R I R^T w + m (p - c) x v. No sums
    that the library or Pinocchio make are taken from them. `tree`: instead of the arm's own.
    """
    tree, tip = tree or cfg.arm.tree, cfg.arm.tip
    rates, offsets = coupled(tree)
    motions = [(mp.zeros(3, 1), e) for e in columns(mp.eye(3))]  # (angular, velocity of origin)
    motions += [(e, mp.zeros(3, 1)) for e in columns(mp.eye(3))]
    C = [mp.eye(6).tolist()[k] + [mp.mpf(0)] * cfg.arm.n for k in range(6)]  # their rates
    R, p = {tree.root: mp.eye(3)}, {tree.root: mp.zeros(3, 1)}
    movers = {tree.root: range(6)}  # what moves each link
    for joint in tree.depth_first():
        parent, child = joint.parent, joint.child
        p[child] = p[parent] + R[parent] * vector(joint.origin.translation)
        R[child], movers[child] = R[parent] * matrix(joint.origin.rotation), movers[parent]
        if joint.movable:
            movers[child] = [*movers[parent], len(motions)]
            C.append([mp.mpf(0)] * 6 + list(rates[joint.name]))
            q = (rates[joint.name] * vector(cfg.q))[0] + offsets[joint.name]
            axis = vector(joint.axis) / mp.norm(vector(joint.axis))
            u = R[child] * axis
            if joint.kind == "prismatic":
                p[child] = p[child] + q * u
                motions.append((mp.zeros(3, 1), u))
            else:
                R[child] = R[child] * turned(axis, q)
                motions.append((u, -cross(u, p[child])))

    bodies = [(link, part) for link, part in tree.links.items() if part]
    CM = {link: p[link] + R[link] * vector(part.origin.translation) for link, part in bodies}
    M = mp.fsum(mp.mpf(part.mass) for _, part in bodies)
    c = sum((mp.mpf(part.mass) * CM[link] for link, part in bodies), mp.zeros(3, 1)) / M
    A, J = mp.zeros(6, len(motions)), mp.zeros(6, len(motions))
    for link, part in bodies:
        m, axes = mp.mpf(part.mass), R[link] * matrix(part.origin.rotation)
        I = axes * matrix(part.inertia) * axes.T
        for column in movers[link]:
            w, v = motions[column]
            v_k = v + cross(w, CM[link])
            h = I * w + m * cross(CM[link] - c, v_k)
            for x in range(3):
                A[x, column] += m * v_k[x]
                A[3 + x, column] += h[x]
    for column in movers[tip]:
        w, v = motions[column]
        v_E = v + cross(w, p[tip])
        for x in range(3):
            J[x, column], J[3 + x, column] = v_E[x], w[x]
    return A * mp.matrix(C), J * mp.matrix(C)


def generalized_jacobian(cfg, mode="free-floating", tree=None) -> mp.matrix:
    """J* of an arm with one tip, the spacecraft's frame the inertial one."""
    A, J = momentum_and_jacobian(cfg, tree)
    f = {"free-floating": 6, "attitude-controlled": 3, "fixed": 0}[mode]
    return J[:, 6:] - (J[:, :f] * A[:f, :f] ** -1 * A[:f, 6:] if f else mp.zeros(6, cfg.arm.n))


def minor(cfg, joints, mode="free-floating") -> mp.mpf:
    """det [A_b A_q; J_b J_q] with the columns of some joints and the task's rows."""
    A, J = momentum_and_jacobian(cfg)
    f = {"free-floating": 6, "attitude-controlled": 3, "fixed": 0}[mode]
    taken = [*range(f), *(6 + j for j in joints)]
    rows = [[A[i, j] for j in taken] for i in range(f)]
    rows += [[J[i, j] for j in taken] for i in cfg.arm.task.indices]
    return mp.det(mp.matrix(rows))


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
