"""Distances to first order of ten thousand postures, by compiled code."""

import matplotlib.pyplot as plt
import numpy as np

import spacearm as sa

arm = sa.load("chaser7")
Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (10_000, arm.n))
distance = np.degrees(sa.evaluate(arm, Q, ["distance"])["distance"])
print(f"within 5 degrees of a singular posture, to first order: {(distance < 5).mean():.1%}")
plt.hist(distance[distance < 90], 60)
plt.xlabel("distance to the singular set, to first order [deg]")
plt.ylabel("postures")
plt.savefig("batch.png")
