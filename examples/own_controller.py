"""A control law of your own: any function of time, configuration and rates that returns torques."""

import numpy as np

import spacearm as sa


def law(t, cfg, dq):
    """Swing about a posture, with damping."""
    return 2.0 * (np.array([0.3, 1.2]) + 0.2 * np.sin(t) - cfg.q) - 3.0 * dq


run = sa.simulate(sa.load("planar2").at([0.3, 1.2]), law, 5.0)
print(f"the spacecraft turned by up to {np.degrees(np.abs(sa.reaction(run).angle).max()):.2f} deg")
sa.plot(sa.reaction(run)).savefig("own_controller.png")
