"""How large must momentum wheels be to hold the attitude while the tip moves at 0.1 m/s?"""

import numpy as np

import spacearm as sa

sizing = sa.size_wheels(sa.load("chaser7"), tip_speed=0.1, samples=200)
print(f"median {np.median(sizing.momentum):.1f} N m s, most {sizing.momentum.max():.1f}")
sa.plot(sizing).savefig("wheels.png")
