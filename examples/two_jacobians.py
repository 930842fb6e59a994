"""The Jacobian of a floating arm is not that of the same arm on a fixed base."""

import spacearm as sa

cfg = sa.load("planar2").at([0.3, 1.2])
print("floating", sa.generalized_jacobian(cfg)[:2].round(3), sep="\n")
print("fixed", sa.fixed_base_jacobian(cfg)[:2].round(3), sep="\n")
sa.plot(cfg, velocities=True).savefig("two_jacobians.png")
