"""Follow a tumbling target with pink: plain least squares, damped, and damped with a barrier.

Needs pip install "spacearm[pink]".
"""

import logging

import matplotlib.pyplot as plt
import numpy as np
import pink
import pinocchio as pin

import spacearm as sa

STEP, TIME = 0.1, 20.0
Q0 = [-0.66, -0.12, -1.13, 0.07, -0.27, -1.29, -1.2]
RATE = np.radians([-1.7, -1.8, 1.7])  # of the target [rad/s]
MARGIN = np.radians(3.0)

logging.disable(logging.WARNING)  # joints turn past their limits where least squares fails


def follow(arm, *, damping, barriers=()):
    """Return errors [m], distances to the singular set [rad] and joint rates [rad/s] over time."""
    start = arm.at(Q0)
    fixture = start.tip
    centre = fixture.act(np.array([0.0, 0.0, 0.5]))  # half a metre inside the target
    task = sa.GeneralizedJacobianTask(arm, fixture)
    configuration = pink.Configuration(arm.model, arm.model.createData(), start.full)
    errors, distances, rates = [], [], []
    for i in range(round(TIME / STEP)):
        turn = pin.exp3(RATE * STEP * (i + 1))
        offset = fixture.translation - centre
        task.set_target(pin.SE3(turn @ fixture.rotation, centre + turn @ offset))
        velocity = pink.solve_ik(
            configuration, [task], STEP, solver="daqp", damping=damping, limits=[],
            constraints=[sa.MomentumConservation(arm)], barriers=barriers, safety_break=False,
        )  # fmt: skip
        configuration.integrate_inplace(velocity, STEP)
        cfg = task.configuration(configuration)
        errors.append(np.linalg.norm(cfg.tip.translation - task.target.translation))
        distances.append(sa.evaluate(arm, [cfg.q], ["distance"])["distance"][0])
        rates.append(np.abs(velocity[6:]).max())
    return np.array(errors), np.array(distances), np.array(rates)


def main():
    """Print errors, distances and rates of three ways to solve."""
    arm = sa.load("chaser7")
    runs = {
        "least squares": follow(arm, damping=1e-12),
        "damped": follow(arm, damping=1e-4),
        "damped, barrier": follow(arm, damping=1e-4, barriers=[sa.SingularityBarrier(arm, MARGIN)]),
    }
    print(f"{'':18}{'error [m]':>12}{'nearest [deg]':>15}{'rate [deg/s]':>14}")
    for name, (errors, distances, rates) in runs.items():
        nearest, fastest = np.degrees(distances.min()), np.degrees(rates.max())
        print(f"{name:18}{errors.max():12.3g}{nearest:15.2f}{fastest:14.3g}")
        plt.plot(STEP * np.arange(1, len(distances) + 1), np.degrees(distances), label=name)
    plt.axhline(np.degrees(MARGIN), color="grey", ls=":", label="margin of the barrier")
    plt.ylim(0, 30)
    plt.xlabel("time [s]")
    plt.ylabel("distance to the singular set, to first order [deg]")
    plt.legend()
    plt.savefig("pink_barrier.png")


if __name__ == "__main__":
    main()
