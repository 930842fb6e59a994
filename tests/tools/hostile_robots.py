"""Hostile robot files: xacro, MJCF, SDF and SRDF, and names that no robot has."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from xml.sax.saxutils import quoteattr

import mujoco  # noqa: F401  (it starts a program when it is imported: not in a case)
import numpy as np
from helpers.formats import as_mjcf, as_sdf
from hostile import OURS, FaultError
from mutations import HOSTILE, changed_text, mutated, renamed

import spacearm as sa
from spacearm.description.readers.formats import read

SPACE = 'xmlns:xacro="http://ros.org/wiki/xacro"'
PARTS = f"""<robot {SPACE}>
  <xacro:macro name="body" params="name mass:=2 *at"><link name="${{name}}">
    <inertial><mass value="${{mass}}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
    </inertial></link><joint name="${{name}}_joint" type="continuous"><parent link="bus"/>
    <child link="${{name}}"/><xacro:insert_block name="at"/><axis xyz="0 0 1"/></joint>
  </xacro:macro>
</robot>
"""
XACRO = f"""<robot name="r" {SPACE}>
  <xacro:include filename="parts.xacro"/>
  <xacro:arg name="mass" default="50"/>
  <xacro:property name="sizes" value="${{xacro.load_yaml('sizes.yaml')}}"/>
  <xacro:property name="d" value="${{sizes['arm']['length'] / 2}}"/>
  <link name="bus"><inertial><mass value="$(arg mass)"/>
    <inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <xacro:body name="arm" mass="${{max(1, 2 * d)}}"><origin xyz="${{d}} 0 0"/></xacro:body>
  <xacro:if value="${{len(sizes['names']) > 1}}">
    <xacro:body name="mast"><origin xyz="0 ${{pi / 4}} 0" rpy="0 0 ${{radians(30)}}"/></xacro:body>
  </xacro:if>
  <xacro:unless value="false"><link name="eye"/></xacro:unless>
  <joint name="bolt" type="fixed"><parent link="arm"/><child link="eye"/></joint>
</robot>
"""
YAML = """arm: {length: 1.0, mass: &m 2.0}
names: [arm, mast]
angle: !degrees 30
other: {mass: *m}
"""
MJCF = """<mujoco model="m">
  <compiler angle="degree" autolimits="true" meshdir="."/>
  <option gravity="0 0 0" timestep="0.002"/>
  <include file="part.xml"/>
  <default><joint axis="0 1 0" range="-90 90"/><default class="thick">
    <geom type="capsule" size=".1 .4" density="100" rgba="1 0 0 1"/></default></default>
  <asset><mesh name="cube" vertex="0 0 0 1 0 0 0 1 0 0 0 1" scale="1 1 1"/>
    <hfield name="ground" nrow="3" ncol="3" size="1 1 1 1" elevation="0 0 0 0 1 0 0 0 0"/>
    <material name="red" rgba="1 0 0 1"/></asset>
  <worldbody><light pos="0 0 3"/><body name="bus"><freejoint/>
    <geom type="box" size=".5 .5 .5" mass="50" material="red"/>
    <body name="a" pos="1 0 0"><joint name="ja"/><geom class="thick"/>
      <body name="b" pos="0 0 .8" euler="0 30 0"><joint name="jb" type="hinge" ref="30"/>
        <geom type="mesh" mesh="cube" density="10"/>
        <geom type="sphere" size=".1" fromto="0 0 0 0 0 1"/>
        <site name="tool" pos="0 0 .2"/></body></body></body></worldbody>
  <equality><joint joint1="jb" joint2="ja" polycoef="0 1 0 0 0"/></equality>
  <actuator><motor joint="ja" gear="2"/></actuator>
  <keyframe><key name="home" qpos="0 0 0 1 0 0 0 .1 .2"/></keyframe>
</mujoco>
"""
PART = """<mujocoinclude><asset>
  <texture name="t" type="2d" builtin="flat" width="4" height="4"/></asset></mujocoinclude>
"""
UNIT = "<inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>"
SDF = f"""<?xml version='1.0'?>
<sdf version='1.9'><world name='w'><include><uri>part.sdf</uri><pose>5 0 0 0 0 0</pose></include>
<model name='m'>
  <link name='bus'><inertial><mass>50</mass>{UNIT}</inertial></link>
  <link name='a'><pose relative_to='f'>0 0 0 0 0 0</pose><inertial auto='true'/>
    <collision name='c'><density>100</density><geometry><cylinder><radius>.1</radius>
    <length>1</length></cylinder></geometry></collision></link>
  <frame name='f' attached_to='bus'><pose degrees='true'>1 0 0 0 0 30</pose></frame>
  <joint name='j' type='revolute'><parent>bus</parent><child>a</child>
    <axis><xyz expressed_in='f'>0 0 1</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis>
  </joint>
  <model name='inner'><link name='b'><pose>2 0 0 0 0 0</pose><inertial><mass>2</mass>{UNIT}
    </inertial></link></model>
  <joint name='k' type='prismatic'><parent>a</parent><child>inner::b</child>
    <axis><xyz>1 0 0</xyz><mimic joint='j'><multiplier>2</multiplier></mimic></axis></joint>
</model></world></sdf>
"""
PART_SDF = f"""<sdf version='1.9'><model name='p'><link name='x'><inertial><mass>1</mass>{UNIT}
</inertial></link></model></sdf>"""
SRDF = """<?xml version="1.0"?><robot name="planar3">
  <group name="arm"><chain base_link="bus" tip_link="link_3"/></group>
  <group name="hand"><link name="tip"/></group>
  <group_state name="home" group="arm"><joint name="joint_1" value="0.1"/>
    <joint name="joint_2" value="0.2"/></group_state>
  <end_effector name="ee" parent_link="tip" group="hand"/>
  <virtual_joint name="v" type="fixed" parent_frame="world" child_link="bus"/>
  <disable_collisions link1="link_1" link2="link_2" reason="Adjacent"/></robot>
"""


def _xacro(_: np.random.Generator) -> dict[str, str]:
    return {"robot.xacro": XACRO, "parts.xacro": PARTS, "sizes.yaml": YAML}


def _mjcf(rng: np.random.Generator) -> dict[str, str]:
    if rng.random() < 0.5:
        return {"robot.xml": MJCF, "part.xml": PART}
    return {"robot.xml": as_mjcf(read(OURS[rng.integers(len(OURS))]), rng)}


def _sdf(rng: np.random.Generator) -> dict[str, str]:
    if rng.random() < 0.5:
        return {"robot.sdf": SDF, "part.sdf": PART_SDF}
    version = str(rng.choice(["1.4", "1.6", "1.7", "1.9"]))
    return {"robot.sdf": as_sdf(read(OURS[rng.integers(len(OURS))]), rng, version)}


def _srdf(_: np.random.Generator) -> dict[str, str]:
    planar3 = next(path for path in OURS if path.stem == "planar3")
    return {"planar3.urdf": planar3.read_text(encoding="utf-8"), "planar3.srdf": SRDF}


def _spoilt(name: str, text: str, rng: np.random.Generator) -> bytes:
    return changed_text(text, rng) if name.endswith("yaml") else mutated(text, rng)


def _asked(arm: sa.SpaceArm, rng: np.random.Generator) -> None:
    """A posture of an arm: every number is finite."""
    cfg = arm.at(rng.uniform(-1, 1, arm.n))
    report = sa.singularity(cfg)
    repr(arm), repr(report)
    if not (np.isfinite(report.sigma).all() and np.isfinite(sa.momentum_matrix(cfg).A_b).all()):
        raise FaultError("numbers that are not finite")


def formats(rng: np.random.Generator, folder: Path, named: set[str]) -> None:
    """A robot in xacro, MJCF or SDF, or with an SRDF, one of whose files is wrong."""
    files = (_xacro, _mjcf, _sdf, _srdf)[rng.integers(4)](rng)
    first = next(iter(files))
    spoilt = list(files)[-1] if first.endswith(".urdf") else str(rng.choice(list(files)))
    for name, text in files.items():
        content = _spoilt(name, text, rng) if name == spoilt else text.encode()
        (folder / name).write_bytes(content)
    named.update(files)
    check = str(rng.choice(["error", "warn", "accept", "accept"]))
    if rng.random() < 0.3:
        _asked(sa.mount(first, sa.Bus(mass=100, size=(1, 1, 1)), check=check), rng)
        return
    _asked(sa.load(first, check=check), rng)


# --- names ------------------------------------------------------------------------------------

NAMES = (
    "</script><script>x=1</script>", "<!--<script>", "]]>", "a&amp;b", "'\"", "a,b", "a=b", "a/b",
    "..", "CON", "a\\b", "%s%n", "{a}", "$\\frac{$", "$a$", "*/ int x; /*", "??/", "\\n", "\\u0022",
    "int", "__import__('os')", "=1+1", "-rf", "a" * 300, "\u2028", "\u202e", "\u200b", "\U0001f916",
    "\u0661", " ", "\t", "\n", "[red]", "[/]", "#{a}", "1", "1e5", "nan", "x y", "all", "base",
    "world", "a::b", "a.b", "home", *HOSTILE,
)  # fmt: skip
"""What robots, links and joints may be called, for pages, C, tables, TeX and terminals."""
WRITTEN = tuple(quoteattr(name.replace("\x00", ""))[1:-1].replace('"', "&quot;") for name in NAMES)
"""The same as attributes of XML."""


class _Scripts(HTMLParser):
    """Counts the scripts of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def handle_starttag(self, tag: str, _: object) -> None:
        """One more script."""
        self.count += tag == "script"


def _scripts(text: str) -> int:
    parser = _Scripts()
    parser.feed(text)
    return parser.count


def names(rng: np.random.Generator, folder: Path, named: set[str]) -> None:
    """A robot whose names are hostile, written in each format, read again, drawn and shown."""
    text = next(path for path in OURS if path.stem == "planar2").read_text(encoding="utf-8")
    for _ in range(rng.integers(1, 3)):
        text = renamed(text, rng, WRITTEN)
    (folder / "robot.urdf").write_bytes(text.encode("utf-8", "surrogatepass"))
    named.add("robot.urdf")
    arm = sa.load("robot.urdf", check="accept")
    way = sa.Motion(arm, [0.0, 1.0], [[0.3, 0.9], [0.4, 0.8]], np.tile(np.eye(7)[6], (2, 1)))
    repr(arm), repr(sa.singularity(way[0])), arm.to_dict()
    kind = str(rng.choice(["urdf", "mjcf", "sdf", "c", "page", "plot", "table", "saved"]))
    if kind in ("urdf", "mjcf", "sdf"):
        write = {"urdf": sa.SpaceArm.to_urdf, "mjcf": sa.to_mjcf, "sdf": sa.to_sdf}[kind]
        file = f"again.{ {'mjcf': 'xml'}.get(kind, kind) }"
        named.add(file)
        again = sa.load(write(arm, file), check="accept")
        if not np.isclose(again.mass, arm.mass):
            raise FaultError(f"as {kind} it is another one")
    elif kind == "c":
        named.add("code")
        sa.to_c(arm, "code")
    elif kind == "page":
        named.update(("page.html", "plain.html"))
        sa.view(arm, open=False).save("page.html")
        sa.view(_plain(), open=False).save("plain.html")
        pages = [Path(name).read_text(encoding="utf-8") for name in ("page.html", "plain.html")]
        if _scripts(pages[0]) != _scripts(pages[1]):
            raise FaultError("a name of a robot ends or begins a script")
    elif kind == "plot":
        named.add("plot.svg")
        sa.plot(sa.singular_map(arm, points=5)).savefig("plot.svg")
    elif kind == "table":
        named.update(("way.csv", "way.json"))
        sa.write_motion(way, "way.json")
        lines = sa.write_motion(way, "way.csv").read_text(encoding="utf-8").split("\n")
        if len({line.count(",") for line in lines if line}) != 1:
            raise FaultError("a name parts a table's cells")
    else:
        named.add("way.npz")
        way.save("way.npz")
        sa.Motion.load("way.npz", arm)


def _plain() -> sa.SpaceArm:
    return sa.load("planar2")
