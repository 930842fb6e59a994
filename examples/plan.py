"""Plan to a point that a straight line does not reach: figure 5 of the paper."""

import numpy as np

import spacearm as sa

arm, q0 = sa.load("planar2"), np.radians([-57.936, 60.337])
base = sa.pose(rpy=(0.0, 0.0, np.radians(21.0)))
plan = sa.plan(arm.at(q0, base=base), (1.5, 1.5), origin="cm")  # from the system's CM
sa.plot(plan).savefig("plan.png")
print(plan.method, "free of singularities:", plan.certificate.free)
print("tip ends at", (plan.tip[-1, :2] - plan.com[-1, :2]).round(4), "m from there")
