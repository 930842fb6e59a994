"""Files that ask for more memory than they have bytes: it is bounded before it is allocated."""

import pytest
from helpers.collada import COLLADA, NODE, POLYGONS, TRIANGLES
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


READ = """
from pathlib import Path
from spacearm.description.shapes import read_mesh
try:
    print(len(read_mesh(Path({!r})).faces))
except sa.SpaceArmError as error:
    print(error)
"""
PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
PLY += "property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
MESHES = {
    "copies.dae": lambda: COLLADA.format(
        parts=TRIANGLES.format(1000, "0 1 2 " * 1000), nodes=NODE * 9000
    ),
    "corners.dae": lambda: COLLADA.format(parts=POLYGONS.format(400_000_000), nodes=NODE),
    "text.dae": lambda: COLLADA.format(
        parts=TRIANGLES.format(3_000_000, "0 1 2 " * 3_000_000), nodes=NODE
    ),
    "faces.obj": lambda: TRIANGLE + "f 1 2 3\n" * 5_000_000,
    "polygon.obj": lambda: TRIANGLE + "f" + " 1 2 3" * 5_000_000,
    "faces.ply": lambda: PLY.format(3_000_000) + "0 0 0\n1 0 0\n0 1 0\n" + "3 0 1 2\n" * 3_000_000,
    "count.ply": lambda: PLY.format(2**31) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_that_asks_for_much_memory_takes_little_here(name, tmp_path):
    path = tmp_path / name
    path.write_text(MESHES[name](), encoding="utf-8")
    said, peak = run_within(ENOUGH, READ.format(str(path)))
    assert peak < MUCH, said
    assert said.isdecimal() or "cannot be read" in said
