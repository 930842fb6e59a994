"""Both arms hold one panel, lead it past a boom, squeeze it by 20 N on the way, and regrasp."""

import numpy as np

import spacearm as sa

arm = sa.load("dual_ur5", tip=["left", "right"])
panel = sa.Target(sa.Bus(90, size=(0.1, 1.0, 0.5), name="panel"), sa.pose((0.7, 0, 0.9)))
forward = (0, np.pi / 2, 0)  # z of the hands points into what they hold
handles = {tip: sa.pose((-0.15, y, 0), forward) for tip, y in (("left", 0.35), ("right", -0.35))}
held = sa.hold(arm.at([-0.2, -1.4, 1.4, 0, 1.4, -1.6] * 2), panel, handles, fixed=True)
print(held.report().verdict)

goal = panel.pose * sa.pose((-0.1, 0.1, 0.1))
boom = sa.Obstacle.sphere(0.015, panel.pose * sa.pose((-0.05, 0.535, -0.185)))
straight = held.follow([goal])
print("straight:", held.collision_check(straight, boom).story)
way = held.plan(goal, constraints=sa.Constraints(obstacles=boom), search=sa.Search(seed=2))
print("planned:", way.reason)

squeeze = {"left": (0, -20, 0, 0, 0, 0), "right": (0, 20, 0, 0, 0, 0)}
coarse = sa.Integration(rtol=1e-6, atol=1e-8)
run = held.simulate(sa.Tracking(way), way.t[-1], squeeze=squeeze, integration=coarse)
for tip, wrench in run.grasps.items():
    print(f"{tip}: up to {np.linalg.norm(wrench[:, :3], axis=1).max():.1f} N")
print(f"grasps open by {run.gap.max():.0e} m at most")
step = held.regrasp("left", sa.pose((-0.15, 0.25, 0.15), forward))
print(step.describe().verdict)
# sa.view(held) shows the panel, to be dragged by both arms; sa.view(way) plays a motion
sa.plot(held.after(run)).savefig("hold.png")
