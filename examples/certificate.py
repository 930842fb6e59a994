"""Prove a joint path free of singularities, or name the one that is on it."""

import spacearm as sa

found = sa.singular_set(sa.load("planar2"))
print(found.is_free([0.3, 0.5], [0.9, 1.4]))
print(found.is_free([0.3, 0.5], [0.3, -0.5]))
sa.plot(found).savefig("certificate.png")
