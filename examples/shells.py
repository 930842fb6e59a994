"""Where singularities can be met, as shells about the system's centre of mass: figure 8."""

import spacearm as sa

space = sa.workspace(sa.load("planar2"))
print("singularities can be met between", space.pdw.round(4).tolist(), "m")
sa.plot(space).savefig("shells.png")
print("and never between", space.piw.round(4).tolist(), "m")
