"""Catch tumbling debris, fly it a hundred times, and find out what was caught."""

import numpy as np

import spacearm as sa

start = sa.load("chaser7").at([0, 0.6, 0, 1.2, 0, 0.8, 0])
debris = sa.Target(
    sa.Bus(60, size=(0.6, 0.6, 0.8), name="debris"),
    sa.pose((5.0, 0.25, -0.75), (0.1, 0.2, 0)),
    twist=(0, 0.002, 0, 0.02, 0.03, 0.02),
    grapples={"side": sa.pose((-0.35, 0, 0), (0, np.pi / 2, 0))},
)
catch = sa.catch(start, debris, window=(10, 30), wanted=1)
print(catch)
runs = sa.fly_many(catch, sa.TargetErrors(delay=0.2), sampling=sa.Sampling(period=0.1, delay=0.1))
print(runs)
sa.plot(runs).savefig("catch.png")

# it is heavier than planned with
flight = catch.fly(debris.scaled(1.2, 0.9), integration=sa.Integration(rtol=1e-6, atol=1e-8))
found = sa.identify(flight)
print(f"it turns on at {np.degrees(np.linalg.norm(catch.tumble)):.3f} deg/s, and weighs", found)
