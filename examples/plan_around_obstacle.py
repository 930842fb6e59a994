"""Plan past a box that floats in the way."""

import spacearm as sa

arm = sa.load("planar2")
box = sa.Obstacle.box((0.2, 0.2, 0.2), sa.pose(xyz=(1.9, 0.55, 0.0)))
plan = sa.plan(
    arm.at([-0.6, 1.2]), sa.Joints([0.5, 1.2]), constraints=sa.Constraints(obstacles=[box])
)
sa.plot(plan).savefig("plan_around_obstacle.png")
print(plan.method, "with", len(plan), "rows")
