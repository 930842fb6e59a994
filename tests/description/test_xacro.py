"""xacro: sources expanded, packages found, arguments asked for by name, and nothing else run."""

import os
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from helpers.arms import joint, link
from lxml import etree

import spacearm as sa
from spacearm.description.readers import source as limits
from spacearm.description.readers import xacro as reader
from spacearm.description.readers.packages import Packages
from spacearm.description.readers.xacro_expansion import Expansion
from spacearm.description.readers.xacro_expressions import Evaluator, ExpressionError

SPACE = 'xmlns:xacro="http://ros.org/wiki/xacro"'
PARTS = f"""<robot {SPACE}>
  <xacro:macro name="body" params="name mass"><link name="${{name}}"><inertial>
    <mass value="${{mass}}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
  </inertial></link></xacro:macro>
</robot>
"""
ARM = """<link name="bus"><inertial><mass value="50"/>
    <inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><mass value="2"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="elbow" type="continuous"><parent link="bus"/><child link="arm"/>
    <origin xyz="0.5 0 0"/><axis xyz="0 0 1"/></joint>"""


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def source(inside, name="r"):
    return f'<robot name="{name}" {SPACE}>\n  {inside}\n</robot>\n'


def package(folder, name):
    return write(folder / "package.xml", f"<package><name>{name}</name></package>").parent


def of_bodies(inside=""):
    return source(
        f"""<xacro:property name="mass" value="${{10 * 5}}"/>
  <xacro:include filename="parts.xacro"/>{inside}
  <xacro:body name="bus" mass="${{mass}}"/>
  <xacro:body name="arm" mass="2"/>
  <joint name="elbow" type="continuous"><parent link="bus"/><child link="arm"/></joint>"""
    )


@pytest.mark.parametrize("name", ["robot.xacro", "robot.urdf.xacro", "robot.urdf"])
def test_sources_are_expanded_whatever_they_are_called(name, tmp_path):
    write(tmp_path / "parts.xacro", PARTS)
    path = write(tmp_path / name, of_bodies())
    arm = sa.load(path)
    assert [body.mass for body in list(arm.model.inertias)[1:]] == [50.0, 2.0]
    assert arm.name == "r"
    assert arm.notes == ()
    assert sa.mount(path, sa.Bus(mass=9, size=(1, 1, 1)), name="arm").mass == 61.0


def test_the_working_directory_does_not_matter(tmp_path, monkeypatch):
    write(tmp_path / "parts.xacro", PARTS)
    write(tmp_path / "robot.xacro", of_bodies())
    monkeypatch.chdir(tmp_path)
    assert sa.load("robot.xacro").mass == 52.0
    monkeypatch.chdir("/")
    assert sa.load(os.path.relpath(tmp_path / "robot.xacro")).mass == 52.0


# --- packages -------------------------------------------------------------------------------


@pytest.fixture
def repository(tmp_path):
    """Two packages side by side, in folders of other names than theirs."""
    package(tmp_path / "repo" / "arm_ros2", "arm_description")
    package(tmp_path / "repo" / "extra" / "shared", "common_parts")
    write(tmp_path / "repo" / "extra" / "shared" / "xacro" / "parts.xacro", PARTS)
    body = of_bodies().replace("parts.xacro", "$(find common_parts)/xacro/parts.xacro")
    return write(tmp_path / "repo" / "arm_ros2" / "urdf" / "robot.xacro", body)


def test_packages_of_the_same_repository_are_found_by_their_manifest(repository):
    assert sa.load(repository).mass == 52.0


@pytest.mark.parametrize("way", ["option", "itself", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"])
def test_packages_elsewhere(way, repository, tmp_path, monkeypatch):
    parts = repository.parents[2] / "extra" / "shared"
    folder = tmp_path / "elsewhere" / "share" / "common_parts"
    folder.parent.mkdir(parents=True)
    parts.rename(folder)
    (repository.parents[2] / ".git").mkdir()  # where the search around the file ends
    with pytest.raises(sa.ModelError, match=r"'common_parts', which was not found; .*packages="):
        sa.load(repository)
    if way in ("option", "itself"):
        given = folder.parent if way == "option" else folder
        assert sa.load(repository, packages=given).mass == 52.0
        assert sa.load(repository, packages=[str(given)]).mass == 52.0
    else:
        above = folder.parent if way.startswith("ROS") else folder.parents[1]
        monkeypatch.setenv(way, os.pathsep.join(("", "/nowhere", str(above))))
        assert sa.load(repository).mass == 52.0


def test_packages_that_are_no_folder():
    with pytest.raises(sa.ConfigurationError, match="packages: nowhere is not a folder"):
        sa.load("planar2", packages=["nowhere"])
    with pytest.raises(sa.ConfigurationError, match="packages is 3; give a text or a path"):
        sa.load("planar2", packages=3)


def test_meshes_of_packages(repository):
    mesh = '<visual><geometry><mesh filename="package://common_parts/a.stl"/></geometry></visual>'
    text = source(ARM.replace('<link name="arm">', f'<link name="arm">{mesh}'))
    path = write(repository.parent / "with_mesh.urdf", text)
    with pytest.warns(sa.ModelWarning, match=r"meshes not found.*package://common_parts/a\.stl"):
        assert "meshes not found" in sa.load(path).notes[0]
    file = write(repository.parents[2] / "extra" / "shared" / "a.stl", "")
    assert sa.load(path).tree.visuals["arm"].visual[0].geometry.file == file


def test_files_of_a_package_under_another_name_are_found_around_the_source(tmp_path):
    include = source('<xacro:include filename="$(find abb_support)/urdf/parts.xacro"/>' + ARM)
    path = write(tmp_path / "abb" / "urdf" / "robot.xacro", include)
    with pytest.raises(sa.ModelError, match="package 'abb_support', which was not found; name"):
        sa.load(path)
    write(tmp_path / "abb" / "urdf" / "parts.xacro", PARTS)
    assert sa.load(path).n == 1


def test_a_missing_package_matters_only_where_it_is_read(tmp_path):
    controller = "<gazebo><parameters>$(find not_here)/config/a.yaml</parameters></gazebo>"
    path = write(tmp_path / "robot.xacro", source(ARM + controller))
    assert sa.load(path).n == 1


def test_simulator_files_of_missing_packages_are_left_out_with_a_warning(tmp_path):
    extra = '<xacro:include filename="$(find sim)/arm.gazebo.xacro"/><xacro:arm_gazebo mode="1"/>'
    path = write(tmp_path / "robot.xacro", source(ARM + extra))
    with pytest.warns(sa.ModelWarning, match=r"package 'sim'.*left out"):
        assert sa.load(path).n == 1
    part = extra.replace("gazebo", "hand")
    with pytest.raises(sa.ModelError, match="package 'sim', which was not found"):
        sa.load(write(tmp_path / "robot.xacro", source(ARM + part)))


# --- arguments ------------------------------------------------------------------------------


def test_arguments(tmp_path):
    inside = """<xacro:arg name="mass" default="50"/><xacro:arg name="heavy" default="false"/>
      <xacro:if value="$(arg heavy)"><xacro:property name="m" value="9000"/></xacro:if>
      <xacro:unless value="$(arg heavy)">
        <xacro:property name="m" value="$(arg mass)"/></xacro:unless>
      """
    text = source(inside + ARM.replace('"50"', '"${m}"'), name="arm_$(arg mass)")
    path = write(tmp_path / "robot.xacro", text)
    assert sa.load(path).mass == 52.0
    arm = sa.load(path, xacro_args={"mass": 70})
    assert (arm.mass, arm.name) == (72.0, "arm_70")
    assert sa.load(path, xacro_args={"heavy": True}).mass == 9002.0
    with pytest.raises(
        sa.ModelError, match=r"unknown xacro argument 'mas'; valid, nearest.*: mass"
    ):
        sa.load(path, xacro_args={"mas": 70})
    with pytest.raises(sa.ConfigurationError, match=r"xacro_args is 3; give a mapping \{name"):
        sa.load(path, xacro_args=3)


def test_missing_arguments_are_listed_at_once_with_their_choices(tmp_path):
    inside = """<!-- colour of the paint: red, green or blue -->
      <xacro:arg name="colour"/><xacro:arg name="dof"/>
      <xacro:arg name="size"/><xacro:arg name="id"/>
      <xacro:property name="n" value="$(arg dof)"/>
      <xacro:if value="${n == 6}"/><xacro:if value="${n == 7}"/>
      <xacro:include filename="$(find robots)/config/$(arg size)/sizes.xacro"/>"""
    package(tmp_path, "robots")
    for size in ("large", "small"):
        write(tmp_path / "config" / size / "sizes.xacro", source(""))
    (tmp_path / "config" / "none").mkdir()
    path = write(tmp_path / "urdf" / "robot.xacro", source(inside + ARM))
    with pytest.raises(sa.ModelError) as error:
        sa.load(path, xacro_args={"id": 1})
    message = str(error.value)
    assert "colour (red, green, blue); dof (6, 7); size (large, small); give" in message
    assert 'xacro_args={"colour": "red", "dof": "6", "size": "large"}' in message
    given = {"colour": "red", "dof": 6, "size": "small", "id": 1}
    assert sa.load(path, xacro_args=given).n == 1


@pytest.mark.parametrize("given", [{}, {"kind": "mini"}])
def test_a_value_without_a_file_is_met_with_those_that_have_one(given, tmp_path):
    inside = """<xacro:arg name="kind" default="none"/>
      <xacro:property name="data" value="${xacro.load_yaml('../config/$(arg kind)/mass.yaml')}"/>"""
    for kind in ("big", "small"):
        write(tmp_path / "config" / kind / "mass.yaml", "bus: {mass: 70.0}")
    text = source(inside + ARM.replace('"50"', '"${data.bus.mass}"'))
    path = write(tmp_path / "urdf" / "robot.xacro", text)
    with pytest.raises(sa.ModelError, match=r"argument kind is '\w+'.*choose another: big, small"):
        sa.load(path, xacro_args=given)
    assert sa.load(path, xacro_args={"kind": "big"}).mass == 72.0


def test_a_source_that_only_defines_macros(tmp_path):
    path = write(tmp_path / "parts.xacro", PARTS)
    write(tmp_path / "robot.xacro", of_bodies())
    match = r"only defines macros \(body\), for other files to use; load one.*: robot.xacro"
    with pytest.raises(sa.ModelError, match=match):
        sa.load(path)
    with pytest.raises(sa.ModelError, match="describes no links"):
        sa.load(write(tmp_path / "colours.xacro", source("")))


# --- faults ---------------------------------------------------------------------------------

FAULTS = {
    "an unknown macro": ("<xacro:limb/>", "unknown macro name: xacro:limb"),
    "an unknown name": (
        '<link name="${x}"/>',
        r"name 'x' is not defined.*evaluating expression 'x'.*load the file that includes this",
    ),
    "a link of another file": (
        '<joint name="j" type="fixed"><parent link="no"/><child link="bus"/></joint>',
        "unknown link 'no'.*name one, or load the file that includes this one",
    ),
    "no such file": ('<xacro:include filename="a.xacro"/>', r"a\.xacro: no such file"),
    "no XML": ('<xacro:include filename="broken.xacro"/>', "broken.xacro is not XML .*line 1"),
    "no YAML": ("${xacro.load_yaml('broken.yaml')}", "broken.yaml is not YAML"),
    "itself": ('<xacro:include filename="robot.xacro"/>', "call themselves"),
    "an unknown substitution": ("$(anon x)", r"unknown substitution '\$\(anon x\)'"),
    "text for a number": ('<xacro:if value="maybe"/>', "not a boolean expression"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_name_the_source_and_the_remedy(case, tmp_path):
    inside, message = FAULTS[case]
    write(tmp_path / "broken.xacro", "<robot>")
    write(tmp_path / "broken.yaml", "a: [")
    path = write(tmp_path / "robot.xacro", source(ARM + inside))
    with warnings.catch_warnings(), pytest.raises(sa.ModelError, match=message) as error:
        sa.load(path)
    assert str(error.value).startswith(str(path))
    assert "; " in str(error.value)


def test_faults_in_macros_name_them(tmp_path):
    write(tmp_path / "parts.xacro", PARTS.replace("${mass}", "${mas}"))
    path = write(tmp_path / "robot.xacro", of_bodies())
    with pytest.raises(sa.ModelError, match=r"'mas' is not defined.*in macro 'body'"):
        sa.load(path)


def test_warnings_of_a_source_are_ours(tmp_path, capfd):
    inside = "${xacro.warning('the data is old')}${xacro.message('hello')}"
    path = write(tmp_path / "robot.xacro", source(ARM + inside))
    with pytest.warns(sa.ModelWarning, match="xacro: the data is old"):
        assert sa.load(path).notes == ("xacro: the data is old",)
    assert capfd.readouterr() == ("", "")


# --- nothing else is run --------------------------------------------------------------------


def doubled(inner, outer):
    """Return an expression that takes a list for x, 40 times over."""
    for _ in range(40):
        inner = f"(lambda x: [{outer}])({inner})"
    return inner


ATTACKS = {
    "open": "open('run', 'w')",
    "import": "__import__('os').mkdir('run')",
    "class": "().__class__.__base__.__subclasses__()",
    "nested class": "[x.__class__ for x in (1,)]",
    "lambda": "(lambda: ''.__class__)()",
    "format": "'{0.__class__}'.format('')",
    "format map": "'{a.__class__}'.format_map(dict(a=''))",
    "f-string": "f'{().__class__}'",
    "generator frame": "(x for x in [1]).gi_frame.f_globals",
    "type": "python.type('')",
    "vars": "python.vars(python.list)",
    "method of a type": "str.mro()",
    "function globals": "xacro.load_yaml.func_globals",
    "globals of a closure": "xacro.arg.__globals__",
    "builtins": "__builtins__",
    "subscript": "math['__loader__']",
    "update of the room": "math.update(pi=3)",
    "getattr": "getattr('', 'upper')",
    "walrus": "(__builtins__ := 1)",
    "a long power": "9**9**9**9",
    "a long text": "'a' * 10**10",
    "a long list": "[0] * 10**10",
    "a long sum": "'a' * 10**5 + 'a' * 10**5",
    "a long shift": "1 << 10**10",
    "a long range": "list(range(10**10))",
    "a wide format": "'%1000000000d' % 1",
    "a wide f-string": "f'{1:1000000000}'",
    "a factorial": "math.factorial(10**8)",
    "rounding": "round(1, -10**9)",
    "lists in lists": "[[['a' * 1000] * 1000] * 1000]",
    "lists doubled": doubled("[1]", "x, x"),
    "lists doubled and written": f"str({doubled('[1]', 'x, x')})",
    "pairs doubled": doubled("[1]", "*zip(x, x)"),
    "lists that grow": "[a.append(a) for a in [[1]] for i in range(9)]",
    "endless": "[0 for a in range(10**5) for b in range(10**5)]",
    "endless maps": "list(map(lambda a: list(map(lambda b: 0, range(9**5))), range(9**5)))",
}


SLOW = {"endless maps": pytest.mark.slow}  # a million steps of a file are
IN_FILES = [pytest.param("${%s}", case, marks=SLOW.get(case, ())) for case in ATTACKS]
IN_FILES += [("$(eval %s)", case) for case in ATTACKS if ")" not in ATTACKS[case]]  # xacro's end


@pytest.mark.parametrize(("form", "case"), IN_FILES)
def test_expressions_reach_nothing(form, case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = form % ATTACKS[case].replace("<", "&lt;")
    inside = f'<xacro:property name=\'x\' value="{text}"/><link name="a${{x}}"/>'
    path = write(tmp_path / "robot.xacro", source(ARM + inside))
    with pytest.raises(sa.ModelError, match="xacro source"):
        sa.load(path)
    assert [file.name for file in tmp_path.iterdir()] == ["robot.xacro"]


@pytest.mark.parametrize("case", ATTACKS)
def test_the_evaluator_refuses_them_by_itself(case, tmp_path):
    room = Expansion(tmp_path / "r.xacro", Packages(tmp_path / "r.xacro"), {})._xacro
    with pytest.raises((ExpressionError, NameError, KeyError, TypeError, SyntaxError)):
        Evaluator(most=20_000).evaluate(ATTACKS[case], room.Table(room._global_symbols))


BOMBS = {
    "aliases": "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 40)),
    "merges": "".join(f"a{i}: &a{i} {{<<: [*a{i - 1}, *a{i - 1}]}}\n" for i in range(1, 40)),
    "a loop": "a1: &a1 [*a1]\n",
    "levels": "a1: " + "[" * 100_000,
    "size": "a1: " + "a" * 1_000_001,
}


@pytest.mark.slow
@pytest.mark.parametrize("case", BOMBS)
def test_yaml_is_bounded_before_it_is_built(case, tmp_path):
    write(tmp_path / "bomb.yaml", "a0: &a0 {x: 1}\n" + BOMBS[case])
    inside = """<xacro:property name="x" value="${xacro.load_yaml('bomb.yaml')}"/><a b="${x}"/>"""
    path = write(tmp_path / "robot.xacro", source(ARM + inside))
    with pytest.raises(sa.ModelError, match=r"more than 100,000 items|too deep|larger than 1 MB"):
        sa.load(path)


@pytest.mark.parametrize("text", ["$(env HOME)", "$(cwd)", "$(env PATH)"])
def test_the_system_is_not_asked(text, tmp_path):
    path = write(tmp_path / "robot.xacro", source(ARM + f'<gazebo a="{text}"/>'))
    with pytest.raises(sa.ModelError, match=r"asks for .*nothing outside its packages is read"):
        sa.load(path)


def test_optional_variables_of_the_environment_are_taken_as_unset(tmp_path, monkeypatch):
    monkeypatch.setenv("MASS", "70")
    path = write(tmp_path / "robot.xacro", source(ARM.replace('"50"', '"$(optenv MASS 60)"')))
    with pytest.warns(sa.ModelWarning, match="environment is not read"):
        assert sa.load(path).mass == 62.0


@pytest.mark.parametrize(
    "inside",
    [
        '<xacro:include filename="%s"/>',
        "${xacro.load_yaml('%s')}",
        '<xacro:include filename="../../secrets/*.xacro"/>',
    ],
)
def test_files_outside_the_packages_are_not_read(inside, tmp_path):
    secret = write(tmp_path / "secrets" / "secret.xacro", source('<link name="secret"/>'))
    inside = inside % secret if "%s" in inside else inside
    path = write(tmp_path / "repo" / "urdf" / "robot.xacro", source(ARM + inside))
    (tmp_path / "repo" / ".git").mkdir()
    with pytest.raises(sa.ModelError, match=r"secret\.xacro, which is in none of its packages"):
        sa.load(path)


@pytest.mark.parametrize("name", [".secret.yaml", ".ssh/config.yaml"])
def test_hidden_files_are_not_read(name, tmp_path):
    write(tmp_path / name, "a: 1")
    path = write(tmp_path / "robot.xacro", source(ARM + f"${{xacro.load_yaml('{name}')}}"))
    with pytest.raises(sa.ModelError, match="is in none of its packages"):
        sa.load(path)


def test_a_source_right_below_the_root_reads_its_own_folder_only():
    packages = Packages(Path("/robot.xacro"))
    assert packages.holds(Path("/parts.xacro"))
    assert not packages.holds(Path("/etc/passwd"))


def test_an_sdf_in_xacro(tmp_path):
    unit = "<inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>"
    inertial = f"<inertial><mass>{{}}</mass>{unit}</inertial>"
    model = (
        f'<sdf {SPACE} version="1.9"><xacro:property name="d" value="0.4"/><model name="m">'
        f'<link name="bus">{inertial.format("${100*d}")}</link>'
        f'<link name="a"><pose>${{d}} 0 0 0 0 0</pose>{inertial.format(2)}</link>'
        '<joint name="j" type="revolute"><parent>bus</parent><child>a</child>'
        "<axis><xyz>0 0 1</xyz></axis></joint></model></sdf>"
    )
    arm = sa.load(write(tmp_path / "robot.sdf.xacro", model))
    assert (arm.n, arm.mass) == (1, 42.0)
    assert arm.model.jointPlacements[2].translation[0] == 0.4


def test_other_formats_in_xacro(tmp_path):
    path = write(tmp_path / "robot.xacro", f'<mujoco {SPACE}><xacro:if value="0"/></mujoco>')
    with pytest.raises(sa.ModelError, match="is an MJCF in xacro; expand it first: xacro FILE"):
        sa.load(path)
    path = write(tmp_path / "robot.xacro", f"<test {SPACE}/>")
    with pytest.raises(sa.ModelError, match="its root element is <test>; a URDF starts with"):
        sa.load(path)


def test_entities_of_included_files_are_refused(tmp_path):
    write(tmp_path / "parts.xacro", '<!DOCTYPE r [<!ENTITY a "aaaa">]><robot a="&a;"/>')
    path = write(tmp_path / "robot.xacro", of_bodies())
    with pytest.raises(sa.ModelError, match=r"parts\.xacro declares a DOCTYPE"):
        sa.load(path)


def test_macros_that_multiply_are_stopped(tmp_path):
    levels = "".join(
        f'<xacro:macro name="m{i}"><xacro:m{i + 1}/><xacro:m{i + 1}/></xacro:macro>'
        for i in range(40)
    )
    text = source(ARM + levels + '<xacro:macro name="m40"/><xacro:m0/>')
    with pytest.raises(sa.ModelError, match="steps to expand"):
        sa.load(write(tmp_path / "robot.xacro", text))


def test_the_room_is_new_for_every_file(tmp_path):
    first = write(tmp_path / "a.xacro", source(ARM + '<xacro:property name="pi" value="3"/>'))
    second = write(tmp_path / "b.xacro", source(ARM.replace('"50"', '"${pi}"')))
    sa.load(first)
    assert sa.load(second).mass == pytest.approx(2.0 + 3.141592653589793)


def test_expressions_as_files_use_them(tmp_path):
    masses = {
        "${radians(180) / pi * 7}": 7.0,
        "${max([1, 7, 3])}": 7.0,
        "${sum_}": 7.0,
        "${[m for m in (5, 7) if m &gt; 6][0]}": 7.0,
        "${'7.0'.split('.')[0]}": 7.0,
        "${dict(a=7)['a']}": 7.0,
        "${data['arm'].mass if 'arm' in data else 0}": 7.0,
        "${len(list(map(lambda i: i, range(7))))}": 7.0,
        "${'%d' % 7}": 7.0,
        "${python.sum([3, 4])}": 7.0,
        "$(eval 3 + 4)": 7.0,
    }
    write(tmp_path / "data.yaml", "arm: {mass: 7, angle: !degrees 90}")
    given = """<xacro:property name="data" value="${xacro.load_yaml('data.yaml')}"/>
      <xacro:property name="sum_" value="${3 + 4}"/>"""
    for text, mass in masses.items():
        path = write(tmp_path / "r.xacro", source(given + ARM.replace('"50"', f'"{text}"')))
        assert sa.load(path).mass == mass + 2.0, text


def test_a_source_equals_the_urdf_it_stands_for(tmp_path):
    plain = "".join((link("bus", 50.0), link("arm"), joint("elbow", "bus", "arm", axis=(0, 0, 1))))
    bodies = plain.replace("50.0", "${40 + 10}")
    a = sa.load(write(tmp_path / "a.urdf", f'<robot name="r">{plain}</robot>'))
    b = sa.load(write(tmp_path / "b.xacro", source(bodies)))
    assert a.to_dict() | {"path": ""} == b.to_dict() | {"path": ""}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of xacro, on Python 3.10
def test_sources_expand_as_by_the_program_itself(tmp_path):
    import xacro

    write(tmp_path / "parts.xacro", PARTS)
    more = """<xacro:property name="names" value="${['a', 'b']}"/>
      <xacro:macro name="all" params="left:=^ *block"><xacro:if value="${len(left) &gt; 0}">
        <xacro:body name="${left[0]}_link" mass="${2 ** len(left) + 0.5}"/>
        <xacro:insert_block name="block"/>
        <xacro:all left="${left[1:]}"><b/></xacro:all></xacro:if></xacro:macro>
      <xacro:all left="${names}"><note text="$(arg text) ${'%.3f' % (pi / 2)}"/></xacro:all>"""
    inside = '<xacro:arg name="text" default="half of pi:"/>' + more
    path = write(tmp_path / "robot.xacro", of_bodies(inside))
    ours = Expansion(path, Packages(path), {}).urdf()
    theirs = xacro.process_file(str(path), mappings={}).toxml()
    trees = [list(etree.fromstring(text).iter(etree.Element)) for text in (ours, theirs)]
    facts = [[(e.tag, dict(e.attrib)) for e in tree] for tree in trees]
    assert facts[0] == facts[1]
    assert ("note", {"text": "half of pi: 1.571"}) in facts[0]


def test_a_name_given_twice_is_found_where_it_is_written(tmp_path):
    write(tmp_path / "parts.xacro", PARTS)
    again = source(
        '<xacro:include filename="parts.xacro"/>' + ARM + '<xacro:body name="arm" mass="1"/>'
    )
    path = write(tmp_path / "robot.xacro", again)
    called = r"line 2 of parts\.xacro, called in line (\d+) of robot\.xacro"
    where = rf"'arm' \(line 4 of robot\.xacro and {called}\); rename one"
    with pytest.raises(sa.ModelError, match=where) as told:
        sa.load(path)
    line = int(re.search(called, str(told.value))[1])
    assert '<xacro:body name="arm"' in path.read_text().splitlines()[line - 1]


def test_namespaces_need_no_declaration(tmp_path):
    write(tmp_path / "parts.xacro", PARTS.replace(SPACE, ""))
    extra = '<drake:linear_bushing_rpy name="elbow" ignition:frame="arm"/>'
    path = write(tmp_path / "robot.xacro", of_bodies(extra).replace(SPACE, ""))
    assert sa.load(path).joint_names == ("elbow",)


@pytest.mark.slow
def test_what_takes_many_steps_is_expanded_in_a_process_of_its_own_to_the_same(
    tmp_path, monkeypatch
):
    write(tmp_path / "parts.xacro", PARTS)
    path = write(tmp_path / "r.xacro", of_bodies('<xacro:arg name="a" default="1"/>'))
    here = sa.load(path)
    monkeypatch.setattr(reader, "FEW_STEPS", 3)
    apart = sa.load(path)
    assert apart.notes == here.notes
    np.testing.assert_array_equal(apart.at([0.3]).A, here.at([0.3]).A)
    monkeypatch.setattr(limits, "SECONDS", 0.05)
    with pytest.raises(sa.ModelError, match=r"is large, and is not read in 0\.05 s"):
        sa.load(path)
    monkeypatch.setattr(limits, "SECONDS", 60.0)
    with pytest.raises(sa.ModelError, match="unknown xacro argument 'b'"):
        sa.load(path, xacro_args={"b": "1"})
