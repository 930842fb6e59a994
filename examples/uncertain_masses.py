"""How near is the singular set if a mass is known only to 10 percent?"""

import numpy as np

import spacearm as sa

about = sa.uncertain(sa.load("planar2"), {"link_1": {"mass": 0.1}})
found = sa.distance_range(about, np.radians([-65.0, 30.0]), samples=50)
low, high = np.degrees([found.low, found.high])
print(f"between {low:.2f} and {high:.2f} degrees")
sa.plot(found).savefig("uncertain_masses.png")
