"""The nearest singular posture of a six-joint arm, from the complete set."""

import numpy as np

import spacearm as sa

arm = sa.load("mda6")
q = np.radians([10.0, 40.0, 70.0, 20.0, 50.0, 0.0])
found = sa.singular_set(arm)
report = sa.singularity(arm.at(q), exact=True)
print("complete:", found.complete)
print(f"nearest: {np.degrees(report.distance):.2f} degrees away")
sa.plot(arm.at(report.nearest)).savefig("nearest_singularity.png")
