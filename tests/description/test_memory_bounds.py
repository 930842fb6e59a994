"""Files that ask for more memory than they have bytes: it is bounded before it is allocated."""

import pytest
from helpers.memory import run_within

pytest.importorskip("resource")

ENOUGH = 3.0
"""Address space of a process that reads a hostile file [GB]."""
MUCH = 700
"""Memory that reading one takes at most, that of the imported libraries included [MB]."""

MJCF = """<mujoco>{size}<asset>{assets}</asset><worldbody><body name="bus"><freejoint/>
<geom size="1"/>{geom}<body pos="1 0 0"><joint/><geom size=".1"/></body></body></worldbody></mujoco>
"""
MADE = '<mesh name="m" builtin="{}" params="{}"/>'
ASSETS = {
    "plate": MADE.format("plate", "5000 5000"),
    "thin plate": MADE.format("plate", "1 25000000"),
    "supertorus": MADE.format("supertorus", "5000 .5 1 1"),
    "supersphere": MADE.format("supersphere", "5000 1 1"),
    "wedge": MADE.format("wedge", "5000 5000 60 45 0"),
    "cone": MADE.format("cone", "25000000 .5"),
    "box": MADE.format("box", "300 300 300 1 1 1"),
    "many plates": "".join(
        MADE.format("plate", "200 200").replace('"m"', f'"m{i}"') for i in range(900)
    ),
    "height fields": "".join(
        f'<hfield name="h{i}" nrow="1000" ncol="1000" size="1 1 1 1"/>' for i in range(1500)
    ),
    "textures": "".join(
        f'<texture name="t{i}" type="2d" builtin="flat" width="1000" height="1000"/>'
        for i in range(1500)
    ),
}
SIZES = {
    "user data": '<size nuser_body="9000000" nuser_geom="9000000" nuser_jnt="9000000"/>',
    "an arena": '<size memory="900G"/>',
    "contacts": '<size njmax="900000" nconmax="90000"/>',
}
LOAD = """
try:
    print(sa.load({!r}).n)
except sa.SpaceArmError as error:
    print(error)
"""


def load_within(path, gigabytes=ENOUGH):
    """What loading a file says, with little memory."""
    said, peak = run_within(gigabytes, LOAD.format(str(path)))
    assert peak < MUCH, said
    return said


@pytest.mark.slow
@pytest.mark.parametrize("case", [*ASSETS, *SIZES])
def test_an_mjcf_that_asks_for_much_memory_takes_little_here(case, tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "robot.xml"
    text = MJCF.format(size=SIZES.get(case, ""), assets=ASSETS.get(case, ""), geom="")
    path.write_text(text, encoding="utf-8")
    said = load_within(path)
    assert said == "1" or "numbers" in said or "is not read in 60 s and 1 GB" in said
