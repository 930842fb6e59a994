"""All singular postures of a planar arm, as curves over its joints: figure 4 of the paper."""

import spacearm as sa

found = sa.singular_map(sa.load("planar2"), points=61)
sa.plot(found).savefig("singular_map.png")
print(len(found.curves), "curves, drawn in singular_map.png")
