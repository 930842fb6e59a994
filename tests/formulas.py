"""Formulas that matter, each with a way to break it, for `mutants`."""

from __future__ import annotations

from typing import NamedTuple


class Mutant(NamedTuple):
    """One broken formula.

    Attributes:
        formula: What is broken, with its equation number in the paper.
        file: Module of the package that holds it.
        text: How the formula stands there, once.
        broken: What takes its place.
        tests: The test files that concern it.
    """

    formula: str
    file: str
    text: str
    broken: str
    tests: str


BARYCENTRIC = [
    Mutant(*row, "test_barycentric")
    for row in (
        (
            "(2) system CM", "barycentric.py", "(chain.first_cm - rho[0])",
            "(chain.first_cm + rho[0])",
        ),
        ("(3) tip from its body's CM", "barycentric.py", "v_E[tip] += p_E", "v_E[tip] -= p_E"),
        (
            "(7) mass distribution", "barycentric.py",
            "np.concatenate(([0.0], np.cumsum(m) / M))",
            "np.concatenate((np.cumsum(m) / M, [1.0]))",
        ),
        ("(8) barycentres", "barycentric.py", "c = l * mu[:-1, None]", "c = l * mu[1:, None]"),
        ("(9) barycentric vectors", "barycentric.py", "= -c, r - c, l - c", "= c, r - c, l - c"),
        ("(11) CMs from the system CM", "barycentric.py", "v.sum(axis=0)", "v.sum(axis=1)"),
        (
            "(12) selection law", "barycentric.py",
            "r_star[i] if i < k else c_star[i] if i == k else l_star[i]",
            "l_star[i] if i < k else c_star[i] if i == k else r_star[i]",
        ),
        (
            "(21) inertia of pairs, i < j", "barycentric.py",
            "np.outer(l_star[j], r_star[i])", "np.outer(r_star[i], l_star[j])",
        ),
        (
            "(22) inertia of augmented bodies", "barycentric.py",
            "identity - np.outer(v[i, k], v[i, k])", "identity + np.outer(v[i, k], v[i, k])",
        ),
        (
            "(23) inertia of pairs, i > j", "barycentric.py",
            "r_star[j] @ l_star[i] * identity -", "r_star[j] @ l_star[i] * identity +",
        ),
        (
            "(27) attitude of Euler parameters", "barycentric.py",
            "+ 2.0 * n * _cross(e)", "- 2.0 * n * _cross(e)",
        ),
        (
            "(27) scalar part", "barycentric.py",
            "(n * n - e @ e) * np.eye", "(n * n + e @ e) * np.eye",
        ),
        ("(28) half angles", "barycentric.py", "np.sin(angle / 2.0)", "np.sin(angle)"),
        ("(29) twice e e^T", "barycentric.py", "+ 2.0 * np.outer(e, e)", "+ np.outer(e, e)"),
        ("(31) rates of the bodies", "barycentric.py", "np.arange(N) < j", "np.arange(N) <= j"),
        (
            "(33c) reaction", "barycentric.py",
            "return -np.linalg.solve(self.D", "return np.linalg.solve(self.D",
        ),
        ("(34a) J11", "barycentric.py", "J11=-sum(", "J11=sum("),
        ("(34a) J12", "barycentric.py", "range(1, N + 1)), np.zeros(F", "range(1, N)), np.zeros(F"),
        ("(34a) J22", "barycentric.py", "J22=F[tip]", "J22=F[N]"),
        ("(34b) D", "barycentric.py", "D=D_j.sum(axis=0)", "D=D_j[1:].sum(axis=0)"),
        ("(34b) D_j", "barycentric.py", "D_j = D_ij.sum(axis=0)", "D_j = D_ij.sum(axis=1)"),
        ("(34b) D_q", "barycentric.py", '"jab,jbn->an"', '"jba,jbn->an"'),
        ("(35) J*", "barycentric.py", "self.T0 @ (w + self.J22)", "self.T0.T @ (w + self.J22)"),
        (
            "(36) rates of Euler parameters", "barycentric.py",
            "(_cross(e) @ w + n * w) / 2.0", "(n * w - _cross(e) @ w) / 2.0",
        ),
        ("(36) scalar part", "barycentric.py", "float(-e @ w) / 2.0", "float(e @ w) / 2.0"),
        (
            "virtual manipulator's [J12; J22]", "barycentric.py",
            "np.vstack((self.T0 @ self.J12,", "np.vstack((self.J12,",
        ),
        (
            "virtual manipulator", "barycentric.py",
            "self.v_E @ self.T0.T, jacobian", "self.v_E @ self.T0, jacobian",
        ),
    )
]  # fmt: skip

ACCURACY = [
    Mutant(*row, "test_accuracy")
    for row in (
        (
            "error bars: rounding of the rotations", "accuracy.py",
            "turns = crossed @ (1.0 +", "turns = crossed @ (0.01 +",
        ),
        ("error bars: rounding of a term", "accuracy.py", "ROUNDING = 4.0", "ROUNDING = 0.02"),
        (
            "error bars: sums of many bodies", "accuracy.py",
            "max(len(bodies), turns[bodies + tips].max())", "turns[bodies + tips].max()",
        ),
        (
            "error bars: angles of mimic joints are sums", "accuracy.py",
            "np.where(slides, 0.0, term)", "0.0 * term",
        ),
        (
            "error bars: displacements", "accuracy.py",
            "np.where(slides, term,", "np.where(slides, 0.0,",
        ),
        (
            "error bars: displacements locked", "accuracy.py",
            "[joint.slid for joint in joints]", "0.0",
        ),
        (
            "error bars: ways by fixed frames", "accuracy.py",
            "way = crossed @ (_lengths([joint", "way = distance + 0.0 * crossed @ (_lengths([joint",
        ),
        (
            "error bars: ways to CMs", "accuracy.py",
            "far = way[bodies] +", "far = distance[bodies] +",
        ),
        (
            "error bars: CMs in the model", "accuracy.py",
            "near = distance[bodies] + _lengths(r) + u * far", "near = distance[bodies]",
        ),
        ("error bars: turning, momentum", "accuracy.py", "2.0 * w,", "0.0 * w,"),
        ("error bars: turning, inertia", "accuracy.py", "i + c * w", "0.05 * i + c * w"),
        ("error bars: inertias", "accuracy.py", "2.0 * np.linalg", "0.05 * np.linalg"),
        ("error bars: second moments", "accuracy.py", "3.0 * np.multiply", "0.0 * np.multiply"),
        ("error bars: turning, CM", "accuracy.py", "+ c * w + way_to_c * s", ""),
        ("error bars: sliding, CM", "accuracy.py", "w + way_to_c * m", "0.0 * m"),
        ("error bars: tip and spacecraft", "accuracy.py", "[[1.0, way], [", "[[1.0, 0.0], ["),
        ("error bars: tip and joints", "accuracy.py", "[[way], [1.0]]", "[[0.0], [1.0]]"),
        ("error bars: E_b amplified", "accuracy.py", "np.eye(len(G)) - G", "np.eye(len(G))"),
        ("error bars: of X", "accuracy.py", "X = X + np.linalg.solve", "X = np.linalg.solve"),
        (
            "accuracy of a joint welded far turned", "parts.py",
            "pin.AngleAxis(float(value), self.axis).matrix()", "pin.exp3(self.axis * value)",
        ),
    )
]  # fmt: skip

MUTANTS = [
    *BARYCENTRIC,
    *ACCURACY,
    # --- momentum and Jacobians -------------------------------------------------------------
    Mutant(
        "A_b in inertial axes", "momentum.py",
        "np.hstack((A[:, :3] @ R.T,", "np.hstack((A[:, :3] @ R,",
        "test_momentum",
    ),
    Mutant(
        "base velocity", "momentum.py", "h - A_q @ joint_vector", "h + A_q @ joint_vector",
        "test_momentum test_jacobian",
    ),
    Mutant(
        "J* = J_q - J_b A_b^-1 A_q", "jacobian.py",
        "J_star: Array = J[:, 6:] - J[:, :f] @ np", "J_star: Array = J[:, 6:] + J[:, :f] @ np",
        "test_jacobian test_barycentric",
    ),
    Mutant(
        "attitude control leaves three components", "jacobian.py",
        '"attitude-controlled": 3', '"attitude-controlled": 6', "test_jacobian test_singularity",
    ),
    Mutant(
        "derivative of J*", "jacobian.py",
        "dA[:, :f, 6:] - dA[:, :f, :f] @ X", "dA[:, :f, 6:] + dA[:, :f, :f] @ X", "test_jacobian",
    ),
    Mutant(
        "rate of J*", "jacobian.py",
        "pin.skew(base_velocity(cfg, dq, momentum)[3:])",
        "pin.skew(base_velocity(cfg, dq, momentum)[3:]).T",
        "test_jacobian",
    ),
    Mutant(
        "drift of prescribed motion", "jacobian.py",
        "drift = J @ dq + cfg.J", "drift = J @ dq - cfg.J", "test_multi_arm",
    ),
    Mutant(
        "drift J_b A_b^-1 h, every joint free", "jacobian.py",
        "J[:, free], drift)", "J[:, free], drift * bool(rates))", "test_multi_arm",
    ),
    Mutant(
        "(36) rate of the attitude", "reaction.py",
        "n * w - pin.skew(e) @ w", "n * w + pin.skew(e) @ w", "test_following test_simulation",
    ),
    Mutant(
        "(33c) integrated: Magnus' commutator", "reaction.py",
        "+ math.sqrt(3.0) / 12.0 * np.cross(w1, w2)", "- math.sqrt(3.0) / 12.0 * np.cross(w1, w2)",
        "test_motion",
    ),
    Mutant(
        "(33c) differentiated along a curve", "curve.py",
        "pin.skew(a) @ db - pin.skew(b) @ da", "pin.skew(a) @ db + pin.skew(b) @ da",
        "test_planning",
    ),
    # --- singularities ----------------------------------------------------------------------
    Mutant(
        "(37) lost directions", "singularity.py", "lost=U[:, rank:]", "lost=V[:, rank:]",
        "test_singularity",
    ),
    Mutant(
        "gradient of sigma_min", "singularity.py", "@ dJ @ V[:, k - 1]", "@ dJ @ V[:, n - 1]",
        "test_singularity",
    ),
    Mutant(
        "kinematic or dynamic", "singularity.py",
        '"kinematic" if fixed_rank < k', '"kinematic" if fixed_rank == k', "test_singularity",
    ),
    Mutant(
        "S = det(A_b) det(J*), spatial", "singularity_polynomial.py",
        "det *= np.linalg.det(D) if", "det /= np.linalg.det(D) if", "test_singular_set",
    ),
    Mutant(
        "(41) S of planar arms", "singularity_polynomial.py",
        "else D[:, normal, normal]", "else 1.0", "test_singular_set",
    ),
    Mutant(
        "(43) R^2", "singularity_polynomial.py",
        "cfg.tip.translation - centre", "cfg.tip.translation + centre",
        "test_workspace",
    ),
    Mutant(
        "roots of degree one", "line.py", "cosine = -c / r", "cosine = c / r", "test_polynomial",
    ),
    Mutant(
        "(44) shells: largest distance", "shells.py",
        "(-1.0, order[: -STARTS - 1 : -1])", "(1.0, order[: -STARTS - 1 : -1])", "test_workspace",
    ),
    Mutant(
        "free workspace: every direction", "free_workspace.py",
        "self.reached(hardest).all() and self.reached(others).all()",
        "self.reached(hardest).any()", "test_workspace",
    ),
    Mutant(
        "free workspace: where it may end", "free_workspace.py",
        'else "attitude-controlled"', 'else "free-floating"', "test_workspace",
    ),
    Mutant(
        "roots of higher degree", "line.py",
        "companion[:, :, -1] = -monic", "companion[:, :, -1] = monic", "test_polynomial",
    ),
    Mutant(
        "redundant arms: u^T J* V = 0", "found_set.py",
        "u, V = U[:, -1]", "u, V = U[:, 0]", "test_singular_set",
    ),
    Mutant(
        "certificate: off the chord", "certificate.py",
        "step) / 8.0", "step) / 800.0", "test_singular_set test_polynomial",
    ),
    Mutant(
        "certificate: bound of the curvature", "certificate.py",
        "0.5 * B * h * h", "0.0005 * B * h * h", "test_singular_set test_polynomial",
    ),
    Mutant(
        "derivative of a polynomial", "polynomial.py",
        "self.coefficients * (1j * self._k(j))", "self.coefficients * (-1j * self._k(j))",
        "test_polynomial",
    ),
    Mutant(
        "bound of the curvature", "polynomial.py",
        "float((size * a * b).sum())", "float((size * a * b).sum()) / 16.0",
        "test_polynomial test_singular_set",
    ),
    # --- dynamics and control ---------------------------------------------------------------
    Mutant(
        "H*, the inertia that joints feel", "dynamics.py",
        "H: Array = M[6:, 6:] - M[6:, :f]", "H: Array = M[6:, 6:] + M[6:, :f]", "test_dynamics",
    ),
    Mutant(
        "c* of the reduced form", "dynamics.py",
        "c_star = c[6:] - M[6:, :f]", "c_star = c[6:] + M[6:, :f]", "test_dynamics",
    ),
    Mutant(
        "classical acceleration", "dynamics.py",
        "a[:3] += pin.skew(v[3:6])", "a[:3] -= pin.skew(v[3:6])", "test_dynamics",
    ),
    Mutant(
        "gyration of wheels", "dynamics.py",
        "np.cross(J @ full, spin * wheel.axis)", "np.cross(spin * wheel.axis, J @ full)",
        "test_wheels",
    ),
    Mutant(
        "(42) transposed Jacobian", "control.py",
        "kd * (self.feed(t, cfg) - J @ dq)", "kd * (self.feed(t, cfg) + J @ dq)", "test_simulation",
    ),
    Mutant(
        "balance of a capture", "capture.py",
        "M @ before + cfg.J.T @ M_t @ t", "M @ before - cfg.J.T @ M_t @ t", "test_capture",
    ),
    Mutant(
        "twist of a captured target", "capture.py",
        "t[:3] - np.cross(t[3:], lever)", "t[:3] + np.cross(t[3:], lever)", "test_capture",
    ),
    # --- compiled ---------------------------------------------------------------------------
    Mutant(
        "kernel: a joint turns", "kernels/floating.py",
        "R_y * cos - R_x * sin", "R_y * cos + R_x * sin", "test_batch",
    ),
    Mutant(
        "kernel: parallel axes", "kernels/floating.py",
        "dot(IX, Y) - m * x * y", "dot(IX, Y) + m * x * y", "test_batch",
    ),
    Mutant(
        "kernel: (34a) J11 acts as a cross product", "kernels/floating.py",
        "J11_X = cross(X, r_E)", "J11_X = cross(r_E, X)", "test_batch",
    ),
]  # fmt: skip
