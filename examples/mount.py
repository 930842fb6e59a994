"""Any arm on any bus."""

import spacearm as sa

arm = sa.mount("vispa", sa.Bus(mass=200.0, size=(1.0, 1.0, 1.0)))
print(arm)
cfg = arm.at([0.2, -0.6, 1.1, 0.3, 0.8, 0.0])
print(sa.singularity(cfg))
sa.plot(cfg).savefig("mount.png")
