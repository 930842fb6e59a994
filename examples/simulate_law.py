"""Transposed Jacobian control meets a singularity and stays there: figure 6 of the paper."""

import numpy as np

import spacearm as sa

arm = sa.load("planar2")
law = sa.TransposedJacobian(target=(1.5, 1.5), kp=5.0, kd=15.0)  # from the system's CM
q0, base = np.radians([-57.936, 60.337]), sa.pose(rpy=(0.0, 0.0, np.radians(21.0)))
run = sa.simulate(arm.at(q0, base=base), law, 40.0, origin="cm")
sa.plot(run).savefig("simulate_law.png")
print(run)
for event in run.events:
    print(f"{event.t:.2f} s: {event.kind}, {event.detail}")
