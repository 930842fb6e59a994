"""Does a heavier spacecraft help? Path dependent share of the reach over its inertia."""

import spacearm as sa

arm = sa.load("planar2")
for inertia in (2.0, 6.667, 20.0, 60.0):
    changed = sa.design.vary(arm, {"base_inertia": inertia / 6.667})
    outer = sa.workspace(changed).pdw
    print(f"{inertia:7.3f} kg m^2: shells {outer.round(3).tolist()} m")
study = sa.design.workspaces(arm, {"base_inertia": [0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 3.0]})
sa.plot(study).savefig("design_study.png")
