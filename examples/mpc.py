"""Figure 5 by model predictive control: arrive where transposed Jacobian control stalls.

The optimal control problem has the exact constraint S(q) >= margin. CasADi solves it again and
again from the current state. The true spacecraft is 5 percent heavier than the controller assumes.
Needs pip install "spacearm[casadi]".
"""

import casadi
import matplotlib.pyplot as plt
import numpy as np

import spacearm as sa

START, ATTITUDE, GOAL = np.radians([-57.936, 60.337]), np.radians(21.0), np.array([1.5, 1.5])
NODES, STEP, HELD = 60, 0.5, 5  # controls, their length [s], how many are used before the next plan
FASTEST, MARGIN = 0.6, 0.3  # rate of a joint [rad/s], least S


def plan(fly, state, centre, nodes, guess):
    """Return states (3, nodes + 1) [attitude, q] and rates (2, nodes) that lead to the goal."""
    problem = casadi.Opti()
    x, u = problem.variable(3, nodes + 1), problem.variable(2, nodes)

    def rate(x, u):
        return casadi.vertcat(fly.connection(x[1:])[2, :] @ u, u)

    def tip(x):
        r, sin, cos = fly.tip_position(x[1:]), casadi.sin(x[0]), casadi.cos(x[0])
        return centre + casadi.vertcat(cos * r[0] - sin * r[1], sin * r[0] + cos * r[1])

    problem.subject_to(x[:, 0] == state)
    problem.subject_to(problem.bounded(-FASTEST, casadi.vec(u), FASTEST))
    for k in range(nodes):
        k1 = rate(x[:, k], u[:, k])
        k2 = rate(x[:, k] + 0.5 * STEP * k1, u[:, k])
        k3 = rate(x[:, k] + 0.5 * STEP * k2, u[:, k])
        k4 = rate(x[:, k] + STEP * k3, u[:, k])
        problem.subject_to(x[:, k + 1] == x[:, k] + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        problem.subject_to(fly.S(x[1:, k + 1]) >= MARGIN)
    problem.minimize(STEP * casadi.sumsqr(u) + 1e3 * casadi.sumsqr(tip(x[:, -1]) - GOAL))
    problem.set_initial(x, guess[0])
    problem.set_initial(u, guess[1])
    problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    solved = problem.solve()
    return solved.value(x), solved.value(u).reshape(2, nodes)


def placed(arm, attitude):
    """Return the start of figure 5, the tip at (2, 0)."""
    cfg = arm.at(START, base=sa.pose(rpy=(0.0, 0.0, attitude)))
    offset = np.array([2.0, 0.0, 0.0]) - cfg.tip.translation
    return arm.at(START, base=sa.pose(xyz=offset, rpy=(0.0, 0.0, attitude)))


def main():
    """Print how near both laws come to the goal."""
    arm = sa.load("planar2")
    bus = arm.model.inertias[1]
    real = arm.replace(base_mass=1.05 * bus.mass, base_inertia=bus.inertia)
    fly, cfg = sa.to_casadi(arm), placed(real, ATTITUDE)
    guess = np.tile(np.append(ATTITUDE, START)[:, None], NODES + 1), np.zeros((2, NODES))
    least, path = np.inf, [cfg.tip.translation[:2]]
    for done in range(0, NODES, HELD):
        R = cfg.base.rotation
        state = np.append(np.arctan2(R[1, 0], R[0, 0]), cfg.q)
        centre = cfg.tip.translation[:2] - R[:2, :2] @ fly.tip_position(cfg.q).full()[:2, 0]
        x, u = plan(fly, state, centre, NODES - done, guess)
        for k in range(HELD):
            cfg = sa.move(cfg, cfg.q + STEP * u[:, k])
            least = min(least, sa.singularity(cfg, exact=True).distance)
            path.append(cfg.tip.translation[:2])
        guess = x[:, HELD:], u[:, HELD:]
    law = sa.TransposedJacobian(target=GOAL, kp=5.0, kd=15.0)
    base = placed(arm, ATTITUDE).base
    stalled = sa.simulate(arm.at(START, base=base), law, 40.0)
    misses = {
        "transposed Jacobian, 40 s": np.linalg.norm(stalled.tip[-1][:2] - GOAL),
        "predictive control, 30 s": np.linalg.norm(cfg.tip.translation[:2] - GOAL),
    }
    for name, miss in misses.items():
        print(f"{name:28}{miss:10.4f} m from the goal")
    print(f"singular posture found at{np.degrees(least):14.2f} degrees")
    plt.plot(*stalled.tip[:, :2].T, label="transposed Jacobian")
    plt.plot(*np.transpose(path), label="predictive control")
    plt.plot(*GOAL, "k+", ms=12, label="goal")
    plt.axis("equal")
    plt.xlabel("x [m]")
    plt.ylabel("y [m]")
    plt.legend()
    plt.savefig("mpc.png")


if __name__ == "__main__":
    main()
