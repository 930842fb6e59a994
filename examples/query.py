"""How near to a dynamic singularity is a posture, and what can the tip not do there?"""

import numpy as np

import spacearm as sa

arm = sa.load("planar2")
report = sa.singularity(arm.at(np.radians([-65.0, -11.41])), exact=True)  # figure 3 of the paper
print(report.verdict)
print("the tip cannot move along", report.lost.round(3))
sa.plot(report).savefig("query.png")
