"""A hundred dispersed starts under one law, side by side in compiled code."""

import matplotlib.pyplot as plt
import numpy as np

import spacearm as sa

law = sa.JointPD(target=[0.5, 1.0], kp=5.0, kd=9.0)
Q0 = np.random.default_rng(0).normal([0.3, 1.2], 0.05, (100, 2))
arm = sa.load("planar2")
runs = sa.simulate_many([arm.at(q) for q in Q0], law, 2.0)
turn = np.degrees(runs.turn.values)
print(f"the spacecraft turns by {turn.mean():.2f} degrees, standard deviation {turn.std():.2f}")
plt.scatter(*np.degrees(Q0).T, c=turn)
plt.colorbar(label="turn of the spacecraft [deg]")
plt.xlabel("joint_1 at the start [deg]")
plt.ylabel("joint_2 at the start [deg]")
plt.savefig("monte_carlo.png")
