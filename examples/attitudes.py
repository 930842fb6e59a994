"""From which attitudes of the spacecraft can the tip follow a line?"""

import numpy as np

import spacearm as sa

q0 = np.radians([-57.936, 60.337])
found = sa.feasible_attitudes(sa.load("planar2"), [(2.0, 0.0), (1.5, 1.5)], q0)
sa.plot(found).savefig("attitudes.png")
print("from", np.degrees(found.intervals).round(2).tolist(), "degrees")
