"""Grasp a turning body, then bring the joints to rest with it."""

import numpy as np

import spacearm as sa

arm = sa.load("planar2")
hold = sa.JointPD(target=[0.3, 1.2], kp=8.0, kd=12.0)
body = sa.Grasp(mass=5.0, inertia=0.2 * np.eye(3), twist=[0.02, 0.0, 0.0, 0.0, 0.0, 0.05])
flight = sa.simulate_phases(arm.at([0.3, 1.2]), [sa.Phase(hold, 1.0, body), sa.Phase(hold, 20.0)])
print("the grasp lost", f"{flight.captures[0].energy_lost:.2e} J")
print("joint rates at the end", np.abs(flight.phases[-1].dq[-1]).max().round(6), "rad/s")
sa.plot(flight.phases[-1]).savefig("capture_and_detumble.png")
