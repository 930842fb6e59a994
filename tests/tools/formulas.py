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
    Mutant(*row, "mechanics/test_barycentric_formulation")
    for row in (
        (
            "(2) system CM", "mechanics/barycentric_formulation.py", "(chain.first_cm - rho[0])",
            "(chain.first_cm + rho[0])",
        ),
        ("(3) tip from its body's CM", "mechanics/barycentric_formulation.py", "v_E[tip] += p_E", "v_E[tip] -= p_E"),
        (
            "(7) mass distribution", "mechanics/barycentric_formulation.py",
            "np.concatenate(([0.0], np.cumsum(m) / M))",
            "np.concatenate((np.cumsum(m) / M, [1.0]))",
        ),
        ("(8) barycentres", "mechanics/barycentric_formulation.py", "c = l * mu[:-1, None]", "c = l * mu[1:, None]"),
        ("(9) barycentric vectors", "mechanics/barycentric_formulation.py", "= -c, r - c, l - c", "= c, r - c, l - c"),
        ("(11) CMs from the system CM", "mechanics/barycentric_formulation.py", "v.sum(axis=0)", "v.sum(axis=1)"),
        (
            "(12) selection law", "mechanics/barycentric_formulation.py",
            "r_star[i] if i < k else c_star[i] if i == k else l_star[i]",
            "l_star[i] if i < k else c_star[i] if i == k else r_star[i]",
        ),
        (
            "(21) inertia of pairs, i < j", "mechanics/barycentric_formulation.py",
            "_about(l_star[j], r_star[i])", "_about(r_star[i], l_star[j])",
        ),
        (
            "(22) inertia of augmented bodies", "mechanics/barycentric_formulation.py",
            "sum(m[k] * _about(v[i, k], v[i, k])", "sum(-m[k] * _about(v[i, k], v[i, k])",
        ),
        (
            "(23) inertia of pairs, i > j", "mechanics/barycentric_formulation.py",
            "-M * _about(r_star[j], l_star[i])", "M * _about(r_star[j], l_star[i])",
        ),
        (
            "(27) attitude of Euler parameters", "mechanics/barycentric_formulation.py",
            "+ 2.0 * n * pin.skew(e)", "- 2.0 * n * pin.skew(e)",
        ),
        (
            "(27) scalar part", "mechanics/barycentric_formulation.py",
            "(n * n - e @ e) * np.eye", "(n * n + e @ e) * np.eye",
        ),
        ("(28) half angles", "mechanics/barycentric_formulation.py", "np.sin(angle / 2.0)", "np.sin(angle)"),
        ("(29) twice e e^T", "mechanics/barycentric_formulation.py", "+ 2.0 * np.outer(e, e)", "+ np.outer(e, e)"),
        ("(31) rates of the bodies", "mechanics/barycentric_formulation.py", "np.arange(N) < j", "np.arange(N) <= j"),
        (
            "(33c) reaction", "mechanics/barycentric_formulation.py",
            "return -np.linalg.solve(self.D", "return np.linalg.solve(self.D",
        ),
        ("(34a) J11", "mechanics/barycentric_formulation.py", "J11, J22 = -sum(", "J11, J22 = sum("),
        ("(34a) J12", "mechanics/barycentric_formulation.py", "range(1, N + 1)), np.zeros(F", "range(1, N)), np.zeros(F"),
        ("(34a) J22", "mechanics/barycentric_formulation.py", "F[tip]  # (34a)", "F[N]  # (34a)"),
        ("(34b) D", "mechanics/barycentric_formulation.py", "Dq = D_j.sum(axis=0)", "Dq = D_j[1:].sum(axis=0)"),
        ("(34b) D_j", "mechanics/barycentric_formulation.py", "D_j = D_ij.sum(axis=0)", "D_j = D_ij.sum(axis=1)"),
        ("(34b) D_q", "mechanics/barycentric_formulation.py", '"jab,jbn->an"', '"jba,jbn->an"'),
        ("(35) J*", "mechanics/barycentric_formulation.py", "self.T0 @ (w + self.J22)", "self.T0.T @ (w + self.J22)"),
        (
            "(36) rates of Euler parameters", "mechanics/barycentric_formulation.py",
            "(pin.skew(e) @ w + n * w) / 2.0", "(n * w - pin.skew(e) @ w) / 2.0",
        ),
        ("(36) scalar part", "mechanics/barycentric_formulation.py", "float(-e @ w) / 2.0", "float(e @ w) / 2.0"),
        (
            "virtual manipulator's [J12; J22]", "mechanics/barycentric_formulation.py",
            "np.vstack((self.T0 @ self.J12,", "np.vstack((self.J12,",
        ),
        (
            "virtual manipulator", "mechanics/barycentric_formulation.py",
            "self.v_E @ self.T0.T, jacobian", "self.v_E @ self.T0, jacobian",
        ),
    )
]  # fmt: skip

ACCURACY = [
    Mutant(*row, "singularities/test_rounding")
    for row in (
        (
            "error bars: rounding of the rotations", "singularities/rounding.py",
            "turns = s.crossed @ (1.0 +", "turns = s.crossed @ (0.01 +",
        ),
        ("error bars: rounding of a term", "singularities/rounding.py", "ROUNDING = 4.0", "ROUNDING = 0.02"),
        (
            "error bars: sums of many bodies", "singularities/rounding.py",
            "max(len(s.bodies), turns[s.bodies + s.tips].max())", "turns[s.bodies + s.tips].max()",
        ),
        (
            "error bars: angles of mimic joints are sums", "singularities/rounding.py",
            "np.where(s.slides, 0.0, term)", "0.0 * term",
        ),
        (
            "error bars: displacements", "singularities/rounding.py",
            "np.where(s.slides, term,", "np.where(s.slides, 0.0,",
        ),
        (
            "error bars: displacements locked", "singularities/rounding.py",
            "[joint.slid for joint in joints]", "[0.0 for joint in joints]",
        ),
        (
            "error bars: ways by fixed frames", "singularities/rounding.py",
            "way = s.crossed @ (s.origins + slid)", "way = distance",
        ),
        (
            "error bars: ways to CMs", "singularities/rounding.py",
            "far = way[s.bodies] +", "far = distance[s.bodies] +",
        ),
        (
            "error bars: CMs in the model", "singularities/rounding.py",
            "near = distance[s.bodies] + s.lever + u * far", "near = distance[s.bodies]",
        ),
        ("error bars: turning, momentum", "singularities/rounding.py", "2.0 * first_by_way,", "0.0 * first_by_way,"),
        ("error bars: turning, inertia", "singularities/rounding.py", "second + c * first_by_way", "0.05 * second + c * first_by_way"),
        ("error bars: inertias", "singularities/rounding.py", "2.0 * np.linalg", "0.05 * np.linalg"),
        ("error bars: second moments", "singularities/rounding.py", "3.0 * s.mass * near", "0.0 * s.mass * near"),
        ("error bars: turning, CM", "singularities/rounding.py", "+ c * first_by_way + way_to_c * first", ""),
        ("error bars: sliding, CM", "singularities/rounding.py", "first_by_way + way_to_c * mass", "0.0 * mass"),
        ("error bars: tip and spacecraft", "singularities/rounding.py", "[[1.0, way], [", "[[1.0, 0.0], ["),
        ("error bars: tip and joints", "singularities/rounding.py", "[[way], [1.0]]", "[[0.0], [1.0]]"),
        ("error bars: E_b amplified", "singularities/rounding.py", "np.eye(len(G)) - G", "np.eye(len(G))"),
        ("error bars: of X", "singularities/rounding.py", "X = X + np.linalg.solve", "X = np.linalg.solve"),
        (
            "accuracy of a joint welded far turned", "description/bodies.py",
            "pin.AngleAxis(float(value), self.axis).matrix()", "pin.exp3(self.axis * value)",
        ),
    )
]  # fmt: skip

EQUATIONS = [
    # Those that concern them compare with Pinocchio, SciPy, NumPy or the barycentric route.
    Mutant(formula, f"equations/{file}.py", text, broken, tests)
    for file, tests, rows in (
        ("kinematics", "equations/test_configurations export/test_equations", (
            ("posture: a joint turns", "Y * cos[at] - X * sin[at]", "Y * cos[at] + X * sin[at]"),
            ("posture: a joint slides", "origin + E[:, 2] * q[at]", "origin - E[:, 2] * q[at]"),
            ("posture: parallel axes", "squares * np.eye(3)[ROWS, COLUMNS] -", "squares * np.eye(3)[ROWS, COLUMNS] +"),
            ("posture: from the system CM", "x = rho - r_cm", "x = rho + r_cm"),
            ("posture: bodies that joints carry", "= sums[tree.parents[i]] + sums[i]", "= 1.0 * sums[tree.parents[i]]"),
            ("posture: linear momentum", "m * v + xp.cross(w, moment)", "m * v + xp.cross(moment, w)"),
            ("posture: angular momentum", "+ xp.cross(moment, v)", "- xp.cross(moment, v)"),
        )),
        ("kinematics", "equations/test_configurations export/test_equations", (
            ("(35) J*: linear momentum", "reaches * v + X[:3].T", "reaches * v - X[:3].T"),
            ("(35) J*: (34a) J11 acts as a cross product", "X[:3].T + xp.cross(angular, r)", "X[:3].T + xp.cross(r, angular)"),
            ("(33c) the spacecraft turns", "solve(xp, at.D, h[3:])", "solve(xp, at.D, -h[3:])"),
            ("J* dq without J*", "-below[0]", "below[0]"),
        )),
        ("measures", "export/test_equations mechanics/test_batch", (
            ("S = det(D) det(J*)", "return D * linear_algebra.determinant(xp, J)", "return linear_algebra.determinant(xp, J)"),
            ("S of redundant arms", "(found * found).sum()", "found.sum()"),
            ("manipulability", "product = product * entry", "product = product + entry"),
        )),
        ("dynamics", "export/test_equations equations/test_plant", (
            ("H*, compiled", "(M_qq - _of_base(", "(M_qq + _of_base("),
        )),
        ("measures", "equations/test_configurations singularities/test_distance", (
            ("distance to first order, compiled", "sigma * way / xp", "sigma * full / xp"),
            ("distance: the null space counts", "kept.append(row * linear_algebra", "kept.append(0.0 * row * linear_algebra"),
        )),
        ("measures", "equations/test_configurations", (
            ("minors seen from the tip", "turned = xp.cross(M * r,", "turned = xp.cross(-M * r,"),
            ("what moves while the tip stands still", "1.0 - carries, carries)", "carries, 1.0 - carries)"),
        )),
        ("linear_algebra", "equations/test_singular_values", (
            ("Householder: no cancellation", "xp.where(x[0] > 0.0, -norm, norm)", "xp.where(x[0] > 0.0, norm, -norm)"),
            ("Laguerre's bound", "2.0 * h * (g[j] * g[j])", "0.5 * h * (g[j] * g[j])"),
            ("qd transform", "E.append(e[j] * ratio)", "E.append(e[j] / ratio)"),
            ("twisted factorisation", "xp.where(twist > i + 0.5, -plus[i]", "xp.where(twist > i + 0.5, plus[i]"),
        )),
        ("laws", "motion/test_controllers equations/test_plant", (
            ("PD control of joints", "kp * error - kd * dq", "kp * error + kd * dq"),
            ("velocity of moving targets", "before, after) / (2.0 * INSTANT)", "before, after) / INSTANT"),
            ("attitude of a quaternion", "(n * X + X @ X)", "(X @ X - n * X)"),
            ("(36) rate of the attitude, compiled", "n * w + xp.cross(e, w)", "n * w - xp.cross(e, w)"),
            ("error of a goal", "end - ((A.T @ start", "end - ((A @ start"),
        )),
        ("plant", "motion/test_plant equations/test_plant", (
            ("torques of springs", "-spring - given", "spring - given"),
            ("torques are cut", "-effort), effort)", "-effort), 2.0 * effort)"),
            ("motors react on bodies", "moments[body] - rate * axis", "moments[body] + rate * axis"),
            ("wrenches act at a point", "xp.cross(r - at.centres[body], force)", "xp.cross(r + at.centres[body], force)"),
        )),
        ("laws", "equations/test_laws", (
            ("rotation vectors of large turns", "S[i] + (1.0 - trace)", "S[i] + (1.0 + trace)"),
        )),
        ("turns", "mechanics/test_connection", (
            ("(33c) the momentum stays zero as joints move", "w, -solve(xp, at.D, slopes)", "w, solve(xp, at.D, slopes)"),
            ("turns: (x - sin x) / x^3", "(x - sin) / (x * z)", "(x + sin) / (x * z)"),
            ("turns: right Jacobian", "np.eye(3) - b * X + c", "np.eye(3) + b * X + c"),
            ("turns: exp([phi]x)", "a * X + b * (X @ X)", "a * X - b * (X @ X)"),
            ("turns: each Gauss point has its share", "[second @ G2, second @ A2]", "[second @ G2, first @ A2]"),
        )),
        ("lines", "equations/test_lines mission/test_attitudes", (
            ("(1) the tip moves along its path", "(velocity + gain", "(2.0 * velocity + gain"),
            ("(1) momentum turns the spacecraft", "@ T - xp.cross(w_h, r)", "@ T + xp.cross(w_h, r)"),
            ("lines: the tip returns to its path", "gain * (place - T @ r)", "gain * (T @ r - place)"),
            ("lines: the tip turns back to its path", "off = 0.5 *", "off = -0.5 *"),
            ("lines: cubic intervals", "u * (1.0 - u) * (1.0 - u), u * u * (u - 1.0)", "u * (1.0 - u) * (1.0 - u), u * u * (1.0 - u)"),
            ("lines: velocity in an interval", "rate * (d01 * (x[1]", "(d01 * (x[1]"),
            ("lines: steps end on the path's end", "beyond = change[n + 4] > ahead + near", "beyond = change[n + 4] > 2.0 * ahead + near"),
            ("Cash & Karp: error of a step", "off = [a - b for", "off = [0.0 * a for"),
            ("lines: least distance between steps", "0.25 * slope * slope / curve", "1.0 * slope * slope / curve"),
            ("lines: turn of the spacecraft", "return 4.0 * xp.arcsin", "return 2.0 * xp.arcsin"),
        )),
        ("reach", "equations/test_reach workspaces/test_extent", (
            ("reach: joints before the middle", "g[k] = -xp.cross(z[k], before)", "g[k] = xp.cross(z[k], before)"),
            ("reach: what the expansion leaves", "(second / 2.0, third / 6.0)", "(second / 20.0, third / 60.0)"),
            ("reach: frames before the middle", "R[k] @ Rz[k - 1].T @ E[k].T", "R[k] @ E[k].T @ Rz[k - 1].T"),
            ("reach: second derivatives", "bend = sign * bend - share", "bend = -sign * bend - share"),
            ("reach: products of two joints", "-0.5 * xp.absolute(bend) * half[i]", "0.5 * xp.absolute(bend) * half[i]"),
            ("reach: largest distance", "xp.maximum(-most, second - size - bent)", "xp.maximum(-most, second - size + bent + most)"),
        )),
        ("integration", "equations/test_integration", (
            ("DOP853: error", "0.01 * _norm(", "1.0 * _norm("),
            ("dense output", "(share if i % 2 == 0 else 1.0 - share)", "(1.0 - share if i % 2 == 0 else share)"),
            ("Rodas5P: stages", "h * of.SLOPES[i] * slope", "0.0 * of.SLOPES[i] * slope"),
            ("step control", "SAFETY * positive ** (-1.0 / order)", "SAFETY * positive ** (-0.5 / order)"),
            ("lanes that end keep their state", "t = xp.where(good,", "t = xp.where(known,"),
        )),
        ("linear_algebra", "export/test_equations equations/test_configurations", (
            ("minors: signs", "(-1.0) ** (r + j)", "(-1.0) ** j"),
        )),
    )
    for formula, text, broken in rows
]  # fmt: skip

COMPILER = [
    Mutant(formula, f"compiler/{file}.py", text, broken, tests)
    for file, tests, rows in (
        ("expressions", "compiler/test_expressions compiler/test_loops", (
            ("folding: x + 0", "return a if b == 0.0 else written", "return 0.0 if b == 0.0 else written"),
            ("folding: a (-b)", "return negative(multiply(a, b.operands[0]))", "return multiply(a, b.operands[0])"),
            ("folding: a + (-b)", "return subtract(a, b.operands[0])", "return subtract(b.operands[0], a)"),
            ("equal operations are one", "else o.hex() for o", "else abs(o) for o"),
            ("masks are captured as numbers", "if e.is_mask:  # variables are numbers", "if False:"),
            ("masks are selected", "both(opposite(mask), b)", "both(mask, b)"),
        )),
        ("symbols", "compiler/test_derivatives", (
            ("derivatives add up", "share + slopes.get(o.number, 0.0)", "share"),
        )),
        ("operations", "compiler/test_derivatives", (
            ("derivative of a quotient", "np.divide(1.0, b), -(v * share))", "np.divide(1.0, b), v * share)"),
            ("derivative of a difference", "(s, -s)", "(s, s)"),
            ("derivative of a smallest number", "_chosen(a < b, s)", "_chosen(b < a, s)"),
            ("derivative of the hyperbolic tangent", "(s * (1.0 - v * v),)", "(s * (1.0 + v * v),)"),
            ("derivative of atan2", "s * (-a / (a * a", "s * (a / (a * a"),
        )),
        ("operations", "compiler/test_angles", (
            ("angles: the third part of pi/2", "2.02226624879595063154e-21", "0.0"),
            ("angles: half turns", "np.floor(0.5 * half_turns)", "np.rint(0.5 * half_turns)"),
            ("angles: what 1 - z/2 loses", "near + (lost + ", "near + ("),
            ("angles: zero keeps its sign", "np.where(size <= 0.0, x, sine)", "sine"),
        )),
        ("instructions", "compiler/test_kernel compiler/test_loops", (
            ("rows are transposed", "[j | half if not j & half", "[j if not j & half"),
        )),
        ("lanes", "compiler/test_kernel compiler/test_loops", (
            ("rows that fill no vector", "self.joined([self.load_one(address, 0) for address in at])", "self.joined([self.load_one(at[0], 0) for address in at])"),
        )),
        ("lanes", "compiler/test_expressions compiler/test_loops compiler/test_kernel", (
            ("lanes: a b - c", "(a, minus) if first", "(a, c) if first"),
            ("lanes: products used once", "and uses[o.number] == 1", "and uses[o.number] >= 1"),
            ("lanes that have ended keep their state", 'found = self.operate(SELECT, runs, found, self.load("%m", state + i))', "pass"),
            ("lanes: tables end", 'i = self.new(f"call i64 @llvm.smin.i64(i64 {i}, i64 {last})", scalars=2)', "pass"),
            ("lanes: rows of turns", "base, lane * size * most)", "base, lane * size)"),
        )),
        ("kernel", "compiler/test_kernel compiler/test_loops", (
            ("the last block ends with the last row", "blocks = -(-rows // self.lanes)", "blocks = rows // self.lanes"),
            ("lanes outside are those there are", "min(lane, self._last)", "lane"),
        )),
        ("machine", "compiler/test_machine", (
            ("cache: checksum", "if hashlib.sha256(code).digest() == checksum else None", ""),
            ("cache: others can write", "not found.st_mode & 0o022", "not found.st_mode & 0o002"),
            ("cache: foreign", "found.st_uid == os.getuid() and", "True and"),
        )),
    )
    for formula, text, broken in rows
]  # fmt: skip

MUTANTS = [
    *BARYCENTRIC,
    *ACCURACY,
    *EQUATIONS,
    *COMPILER,
    # --- momentum and Jacobians -------------------------------------------------------------
    Mutant(
        "A_b in inertial axes", "mechanics/jacobian.py",
        "np.hstack((A[:, :3] @ R.T,", "np.hstack((A[:, :3] @ R,",
        "mechanics/test_momentum",
    ),
    Mutant(
        "base velocity", "mechanics/jacobian.py", "h - A_q @ joint_vector", "h + A_q @ joint_vector",
        "mechanics/test_momentum mechanics/test_jacobian",
    ),
    Mutant(
        "J* = J_q - J_b A_b^-1 A_q", "mechanics/jacobian.py",
        "return cfg.J[:, 6:] - cfg.J", "return cfg.J[:, 6:] + cfg.J",
        "mechanics/test_jacobian mechanics/test_barycentric_formulation",
    ),
    Mutant(
        "attitude control leaves three components", "model/arguments.py",
        '"attitude-controlled": 3', '"attitude-controlled": 6', "mechanics/test_jacobian singularities/test_report",
    ),
    Mutant(
        "derivative of J*", "mechanics/jacobian.py",
        "dA[:, :f, 6:] - dA[:, :f, :f] @ X", "dA[:, :f, 6:] + dA[:, :f, :f] @ X", "mechanics/test_jacobian",
    ),
    Mutant(
        "rate of J*", "mechanics/jacobian.py",
        "pin.skew(base_velocity(cfg, dq)[3:])",
        "pin.skew(base_velocity(cfg, dq)[3:]).T",
        "mechanics/test_jacobian",
    ),
    Mutant(
        "drift of prescribed motion", "mechanics/jacobian.py",
        "drift = J @ dq + cfg.J", "drift = J @ dq - cfg.J", "model/test_multi_arm",
    ),
    Mutant(
        "drift J_b A_b^-1 h, every joint free", "mechanics/jacobian.py",
        "J[:, free], drift)", "J[:, free], drift * bool(rates))", "model/test_multi_arm",
    ),
    Mutant(
        "(36) rate of the attitude along a curve", "motion/following.py",
        "[3:] @ cfg.base.rotation", "[3:] @ cfg.base.rotation.T", "motion/test_following",
    ),
    Mutant(
        "(33c) integrated: Magnus' commutator", "equations/turns.py",
        "+ COMMUTATOR * h * h * xp", "- COMMUTATOR * h * h * xp",
        "mechanics/test_floating",
    ),
    Mutant(
        "(33c) differentiated along a curve", "equations/turns.py",
        "half - bend", "half + bend", "planning/test_planner planning/test_guesses",
    ),
    # --- singularities ----------------------------------------------------------------------
    Mutant(
        "(37) lost directions", "singularities/report.py", "lost=U[:, rank:]", "lost=V[:, rank:]",
        "singularities/test_report",
    ),
    Mutant(
        "gradient of sigma_min", "singularities/report.py", "@ dJ @ V[:, k - 1]", "@ dJ @ V[:, n - 1]",
        "singularities/test_report",
    ),
    Mutant(
        "kinematic or dynamic", "singularities/report.py",
        "> tolerance).all()", "> tolerance).any()", "singularities/test_report",
    ),
    Mutant(
        "distance of redundant arms", "equations/measures.py",
        "x = x - (part @ x) @ part if at_once else x - (part @ x) * part", "x = 1.0 * x", "singularities/test_distance",
    ),
    Mutant(
        "distance where fewer equations hold", "equations/measures.py",
        "ROUNDED * xp.sqrt(size) + fading * sigma", "ROUNDED * xp.sqrt(size)",
        "singularities/test_distance",
    ),
    Mutant(
        "distance where several singular values vanish", "mechanics/distance.py",
        "np.linalg.norm((U.T @ b) / size)", "np.linalg.norm(U.T @ b)", "singularities/test_distance",
    ),
    Mutant(
        "distance with sliding joints", "model/joints.py",
        "np.where(arm.slides, slide, 1.0)", "np.ones(arm.n)", "singularities/test_distance",
    ),
    Mutant(
        "descent to the singular set", "mechanics/distance.py",
        "along[:, 0] -= distance", "along[:, 0] += distance", "singularities/test_distance",
    ),
    Mutant(
        "(41) S of planar arms", "singularities/polynomials.py",
        "- {normal}, 3 + normal]", "- {normal}, 3 + (normal + 1) % 3]", "singularities/test_sets",
    ),
    Mutant(
        "(43) R^2", "singularities/polynomials.py",
        "(tips_from_centre(arm, Q, mode) ** 2)", "(tips_from_centre(arm, Q, mode) ** 4)",
        "workspaces/test_workspace",
    ),
    Mutant(
        "roots of degree one", "polynomial/univariate.py", "cosine = -c / np.hypot", "cosine = c / np.hypot", "polynomial/test_trig",
    ),
    Mutant(
        "(44) shells: largest distance", "workspaces/shells.py",
        "(-1.0, order[: -STARTS - 1 : -1])", "(1.0, order[: -STARTS - 1 : -1])", "workspaces/test_workspace",
    ),
    Mutant(
        "free workspace: every direction", "workspaces/free.py",
        "self.reached(hardest).all() and self.reached(others).all()",
        "self.reached(hardest).any()", "workspaces/test_workspace",
    ),
    Mutant(
        "free workspace: where it may end", "workspaces/free.py",
        'else "attitude-controlled"', 'else "free-floating"', "workspaces/test_workspace",
    ),
    Mutant(
        "roots of higher degree", "polynomial/univariate.py",
        "companion[:, :, -1] = -monic", "companion[:, :, -1] = monic", "polynomial/test_trig",
    ),
    Mutant(
        "loss of rank: found is sigma_min = 0", "mechanics/distance.py",
        "found, before = near.sigma <= LOST * most", "found, before = near.sigma <= 1e-2 * most",
        "singularities/test_sets singularities/test_redundant_sets",
    ),
    Mutant(
        "certificate: off the chord", "polynomial/certificate.py",
        "(high - low) ** 2 / 8.0", "(high - low) ** 2 / 800.0",
        "singularities/test_sets polynomial/test_certificate",
    ),
    Mutant(
        "certificate: bound of the curvature", "polynomial/certificate.py",
        '"mi,ij,mj->m", size, B, size))', '"mi,ij,mj->m", size, 1e-3 * B, size))',
        "singularities/test_sets polynomial/test_certificate",
    ),
    Mutant(
        "derivative of a polynomial", "polynomial/trig.py",
        "self.coefficients * (1j * self._k(j))", "self.coefficients * (-1j * self._k(j))",
        "polynomial/test_trig",
    ),
    Mutant(
        "bound of the curvature", "polynomial/trig.py",
        "tensor[index] = value", "tensor[index] = value / 16.0",
        "polynomial/test_trig singularities/test_sets",
    ),
    # --- dynamics and control ---------------------------------------------------------------
    Mutant(
        "H*, the inertia that joints feel", "mechanics/dynamics.py",
        "H = M[6:, 6:] - M[6:, :f] @ solve", "H = M[6:, 6:] + M[6:, :f] @ solve", "mechanics/test_dynamics",
    ),
    Mutant(
        "c* of the reduced form", "mechanics/dynamics.py",
        "c_star = c[6:] - M[6:, :f]", "c_star = c[6:] + M[6:, :f]", "mechanics/test_dynamics",
    ),
    Mutant(
        "classical acceleration", "mechanics/dynamics.py",
        "a[:3] += pin.skew(v[3:6])", "a[:3] -= pin.skew(v[3:6])", "mechanics/test_dynamics",
    ),
    Mutant(
        "gyration of wheels", "mechanics/dynamics.py",
        "np.cross(J @ full, spin * wheel.axis)", "np.cross(spin * wheel.axis, J @ full)",
        "model/test_wheels",
    ),
    Mutant(
        "(42) transposed Jacobian", "equations/laws.py",
        "kd * (feed - J @ dq)", "kd * (feed + J @ dq)", "motion/test_simulation motion/test_controllers",
    ),
    Mutant(
        "balance of a capture", "mechanics/dynamics.py",
        "M @ before + cfg.J.T @ M_t @ t", "M @ before - cfg.J.T @ M_t @ t", "mechanics/test_impact",
    ),
    Mutant(
        "twist of a captured target", "mechanics/dynamics.py",
        "t[:3] -= np.cross(t[3:], lever)", "t[:3] += np.cross(t[3:], lever)", "mechanics/test_impact",
    ),
]  # fmt: skip
