"""From which attitudes of the spacecraft can the tip follow a line?"""

import numpy as np

import spacearm as sa

start = sa.load("planar2").at(np.radians([-57.936, 60.337]))
found = sa.feasible_attitudes(start, [(2.0, 0.0), (1.5, 1.5)])
sa.plot(found).savefig("attitudes.png")
print("from", np.degrees(found.intervals).round(2).tolist(), "degrees")
