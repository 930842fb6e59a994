"""What files name: found beside them and in packages, and refused anywhere else."""

import json
import os
import warnings
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import trimesh
from helpers.arms import joint, link, robot

import spacearm as sa
from spacearm.description.readers import packages as packages_module
from spacearm.description.readers.packages import OutsideError, Packages
from spacearm.description.shapes import read_mesh
from spacearm.files import lies_in, named_files
from spacearm.servo.watching import recorded

#: Numbers that no arm of a test has by chance: coordinates, masses and names of secret files.
SECRET, MASS, NAME = 0.777125, 777125.0, "classified_part"
#: Ways to name a file SECRET of a folder "outside" beside the folder of the robot.
WAYS = {
    "above": "../outside/{}",
    "absolute": "{folder}/outside/{}",
    "a link": "link_to_{}",
    "a folder that is a link": "linked/{}",
    "file": "file://{folder}/outside/{}",
    "percent-encoded": "%2e%2e%2foutside/{}",
    "percent-encoded in file": "file://{folder}/%6futside/{}",
    "Windows": "..\\outside\\{}",
    "through itself": "inner/../../outside/{}",
}


@pytest.fixture
def home(tmp_path):
    """Return the folder of a robot, a repository, beside a folder of secret files."""
    folder = tmp_path / "robot"
    (folder / ".git").mkdir(parents=True)
    (folder / "inner").mkdir()
    (tmp_path / "outside").mkdir()
    (folder / "linked").symlink_to(tmp_path / "outside", target_is_directory=True)
    return folder


def secret(home, name, content):
    """Write a secret file, and a link to it in the folder of the robot; return the ways to it."""
    path = home.parent / "outside" / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    (home / f"link_to_{name}").symlink_to(path)
    return {way: text.format(name, folder=home.parent) for way, text in WAYS.items()}


def solid():
    return trimesh.creation.box((SECRET, SECRET, SECRET))


# --- what a mesh names --------------------------------------------------------------------------


def gltf(folder, uri, data):
    """Write a glTF file of one triangle whose buffer has a name."""
    view = {"buffer": 0, "byteLength": 36}
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": uri, "byteLength": len(data)}],
        "bufferViews": [view],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
             "min": [0, 0, 0], "max": [1, 1, 1]}
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }  # fmt: skip
    path = folder / "mesh.gltf"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


CORNERS = np.array([[0, 0, 0], [SECRET, 0, 0], [0, 0, SECRET]], dtype=np.float32).tobytes()


@pytest.mark.parametrize("way", WAYS)
def test_buffers_outside_the_folder_of_a_mesh_are_refused(way, home):
    uri = secret(home, "buffer.bin", CORNERS)[way]
    with pytest.raises(sa.ModelError) as caught:
        read_mesh(gltf(home, uri, CORNERS))
    assert repr(uri) in str(caught.value)
    assert str(SECRET)[:6] not in str(caught.value)


def test_buffers_beside_a_mesh_and_in_its_package_are_read(home):
    (home / "inner" / "a b.bin").write_bytes(CORNERS)
    mesh = read_mesh(gltf(home, "inner/a%20b.bin", CORNERS))
    assert np.abs(mesh.vertices).max() == pytest.approx(SECRET)
    (home / "meshes").mkdir()
    other = gltf(home / "meshes", "../inner/a%20b.bin", CORNERS)
    with pytest.raises(sa.ModelError, match=r"a%20b\.bin.* in none of its packages"):
        read_mesh(other)
    (home / "package.xml").write_text("<package><name>robot</name></package>")
    assert np.abs(read_mesh(other).vertices).max() == pytest.approx(SECRET)


def test_a_mesh_and_its_buffer_may_be_links_to_one_folder(home):
    """As `colcon build --symlink-install` installs the files of a package."""
    source = home.parent / "outside"
    (source / "part.bin").write_bytes(CORNERS)
    mesh = gltf(source, "part.bin", CORNERS)
    for file in (mesh, source / "part.bin"):
        (home / file.name).symlink_to(file)
    assert np.abs(read_mesh(home / mesh.name).vertices).max() == pytest.approx(SECRET)


def test_a_device_or_a_pipe_is_no_buffer(home):
    os.mkfifo(home / "pipe.bin")
    with pytest.raises(sa.ModelError, match=r"pipe\.bin.*a device or a pipe"):
        read_mesh(gltf(home, "pipe.bin", CORNERS))


def obj(home, name):
    (home / "mesh.obj").write_text(f"mtllib {name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n")
    return home / "mesh.obj"


def ply(home, name):
    text = trimesh.creation.box().export(file_type="ply", encoding="ascii").decode()
    (home / "mesh.ply").write_text(
        text.replace("element vertex", f"comment TextureFile {name}\nelement vertex", 1)
    )
    return home / "mesh.ply"


def dae(home, name):
    text = trimesh.creation.box().export(file_type="dae").decode()
    image = f'<library_images><image id="i"><init_from>{name}</init_from></image></library_images>'
    (home / "mesh.dae").write_text(text.replace("<library_effects", f"{image}<library_effects", 1))
    return home / "mesh.dae"


def textured(home, name):
    (home / "buffer.bin").write_bytes(CORNERS)
    path = gltf(home, "buffer.bin", CORNERS)
    document = json.loads(path.read_text())
    document["images"] = [{"uri": name}]
    document["textures"] = [{"source": 0}]
    document["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    document["meshes"][0]["primitives"][0]["material"] = 0
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize("write", [obj, ply, dae, textured])
@pytest.mark.parametrize("way", WAYS)
def test_materials_and_pictures_of_meshes_are_never_opened(write, way, home, monkeypatch):
    name = secret(home, "material.mtl", "newmtl m\nKd 0.777125 0 0\n")[way]
    path, opened = write(home, name), []
    original = os.open

    def listed(file, *arguments, **options):
        opened.append(str(file))
        return original(file, *arguments, **options)

    monkeypatch.setattr(os, "open", listed)
    monkeypatch.setattr("builtins.open", _recording(open, opened))
    assert len(read_mesh(path).faces)
    assert any(str(path) in file for file in opened)
    assert not [file for file in opened if "material.mtl" in file]


def _recording(original, opened):
    def recorded(file, *arguments, **options):
        opened.append(str(file))
        return original(file, *arguments, **options)

    return recorded


# --- what a robot file names --------------------------------------------------------------------


def arm_with(mesh):
    shape = f"<{{0}}><geometry><mesh filename={json.dumps(mesh)}/></geometry></{{0}}>"
    inside = shape.format("visual") + shape.format("collision")
    return robot(link("bus", 50.0), link("arm", inside=inside), joint("elbow", "bus", "arm"))


RELATIVE = [way for way in WAYS if "absolute" not in way and "file" not in way]
ABSOLUTE = ("absolute", "file", "percent-encoded in file")


@pytest.mark.parametrize("way", RELATIVE)
def test_meshes_that_relative_names_lead_out_to_are_refused(way, home):
    name = secret(home, "part.stl", solid().export(file_type="stl"))[way]
    path = home / "robot.urdf"
    path.write_text(arm_with(name))
    with pytest.warns(sa.ModelWarning, match=r"meshes not read") as caught:
        arm = sa.load(path)
    (said,) = [str(w.message) for w in caught if "meshes not read" in str(w.message)]
    assert "part.stl" in said
    assert "packages=[FOLDER]" in said
    assert arm.tree.visuals["arm"].visual[0].geometry.file is None
    assert str(SECRET)[:6] not in str(arm.tree.visuals)
    trusted = sa.load(path, packages=home.parent)
    assert trusted.tree.visuals["arm"].visual[0].reach() > SECRET / 2


@pytest.mark.parametrize("way", ABSOLUTE)
def test_meshes_by_absolute_paths_are_read_if_they_are_named_as_meshes(way, home):
    """As expanded xacro sources, `to_urdf` and `to_sdf` name them."""
    name = secret(home, "part.stl", solid().export(file_type="stl"))[way]
    path = home / "robot.urdf"
    path.write_text(arm_with(name))
    assert sa.load(path).tree.visuals["arm"].visual[0].reach() > SECRET / 2
    other = secret(home, "notes", solid().export(file_type="stl"))["absolute"]
    (home / "disguised.stl").symlink_to(other)
    path.write_text(arm_with(f"{home}/disguised.stl"))
    with pytest.warns(sa.ModelWarning, match=r"meshes not read .*disguised\.stl.*notes"):
        assert sa.load(path).tree.visuals["arm"].visual[0].geometry.file is None


INERTIA = "<inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>"


def sdf_link(name, mass, inside=""):
    return f"<link name='{name}'><inertial><mass>{mass}</mass>{INERTIA}</inertial>{inside}</link>"


def sdf(*parts):
    return f"<sdf version='1.9'><model name='m'>{''.join(parts)}</model></sdf>"


HINGE = (
    "<joint name='j' type='revolute'><parent>bus</parent><child>arm</child>"
    "<axis><xyz>0 0 1</xyz></axis></joint>"
)


def refused(home, name, text, told, **options):
    """Load a robot file that names a secret one, and see that it is refused without its content."""
    path = home / name
    path.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sa.ModelWarning)
        with pytest.raises(sa.ModelError) as caught:
            sa.load(path, **options)
    message = str(caught.value)
    assert told in message
    assert NAME not in message
    assert "777" not in message
    return message


@pytest.mark.parametrize("way", WAYS)
def test_includes_of_an_sdf_outside_its_packages_are_refused(way, home):
    name = secret(home, "part.sdf", sdf(sdf_link(NAME, MASS)))[way]
    include = f"<include><uri>{name}</uri></include>"
    text = sdf(sdf_link("bus", 50), sdf_link("arm", 1), HINGE, include)
    refused(home, "robot.sdf", text, "part.sdf")
    (home / "folder").mkdir()
    model = "<model><sdf version='x'>../../outside/part.sdf</sdf></model>"
    (home / "folder" / "model.config").write_text(model)
    refused(home, "robot.sdf", text.replace(name, "folder"), "part.sdf")


@pytest.mark.parametrize("way", [way for way in WAYS if "file" not in way and "%" not in WAYS[way]])
def test_includes_of_an_mjcf_outside_its_packages_are_refused(way, home, monkeypatch):
    body = f"<body name='{NAME}'><geom size='1' mass='777125'/></body>"
    content = f"<mujocoinclude>{body}</mujocoinclude>"
    name = secret(home, "part.xml", content)[way]
    monkeypatch.setattr(mujoco.MjSpec, "from_file", None)
    for naming in (
        "<worldbody><include file={0}/></worldbody>",
        "<asset><model name='m' file={0}/></asset><worldbody/>",
        "<compiler assetdir={1}/><asset><model name='m' file={2}/></asset><worldbody/>",
    ):
        folder, _, last = name.replace("\\", "/").rpartition("/")
        words = (json.dumps(word) for word in (name, folder, last))
        text = f"<mujoco>{naming.format(*words)}</mujoco>"
        refused(home, "robot.xml", text, "part.xml")


@pytest.mark.parametrize("way", RELATIVE)
def test_meshes_of_an_mjcf_outside_its_packages_are_refused(way, home, monkeypatch):
    name = secret(home, "part.stl", solid().export(file_type="stl"))[way]
    monkeypatch.setattr(mujoco.MjSpec, "from_file", None)
    asset = f"<asset><mesh name='p' file={json.dumps(name)}/></asset>"
    flex = f"<flexcomp name='f' type='mesh' file={json.dumps(name)}/>"
    body = "<body><freejoint/><geom type='mesh' mesh='p'/></body>"
    for inside in (f"{asset}<worldbody>{body}</worldbody>", f"<worldbody>{flex}</worldbody>"):
        refused(home, "robot.xml", f"<mujoco>{inside}</mujoco>", "part.stl")


def test_an_mjcf_that_mujoco_reads_otherwise_is_refused(home, monkeypatch):
    """Its bytes name a file that a parser, which knows the encoding, does not see."""
    monkeypatch.setattr(mujoco.MjSpec, "from_file", None)
    secret(home, "part.xml", "<mujocoinclude/>")
    for encoding in ("utf-7", "iso-2022-jp"):
        written = f'<?xml version="1.0" encoding="{encoding}"?><mujoco/>'
        refused(home, "robot.xml", written, encoding)


@pytest.mark.parametrize("encoding", ["utf8", "latin1", "cp1252", "iso8859-1"])
def test_an_mjcf_may_state_its_encoding_by_any_of_its_names(encoding, home):
    body = "<body><freejoint/><geom size='1'/><body><joint/><geom size='1'/></body></body>"
    written = f"<mujoco><worldbody>{body}</worldbody></mujoco>"
    path = home / "robot.xml"
    path.write_text(f'<?xml version="1.0" encoding="{encoding}"?>{written}')
    assert sa.load(path).n == 1


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    "naming", ["<xacro:include filename='{}'/>", "<a b=\"${{xacro.load_yaml('{}')}}\"/>"]
)
def test_files_of_a_xacro_source_outside_its_packages_are_refused(way, naming, home):
    content = f"<robot><link name='{NAME}'/></robot>" if "include" in naming else f"{NAME}: 777125"
    name = secret(home, "part.yaml", content)[way]
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    arm = robot(link("bus", 50.0), link("arm"), joint("elbow", "bus", "arm"))
    text = arm.replace("<robot", f"<robot {space}").replace(
        "</robot>", naming.format(name.replace("\\", "\\\\")) + "</robot>"
    )
    refused(home, "robot.xacro", text, "part.yaml")


def test_an_srdf_that_is_a_link_to_elsewhere_is_not_read(home):
    joints = joint("elbow", "bus", "arm"), joint("wrist", "arm", "hand")
    path = home / "r.urdf"
    path.write_text(robot(link("bus", 50.0), link("arm"), link("hand"), *joints))
    named = '<group name="g"><chain base_link="bus" tip_link="arm"/></group>'
    content = f'<robot name="r">{named}</robot>'
    secret(home, "r.srdf", content)
    assert sa.load(path).tip == "hand"
    (home / "r.srdf").write_text(content)
    assert sa.load(path).tip == "arm"


# --- packages -----------------------------------------------------------------------------------


def package(folder, name):
    folder.mkdir(parents=True)
    (folder / "package.xml").write_text(f"<package><name>{name}</name></package>")
    (folder / "part.stl").write_bytes(solid().export(file_type="stl"))
    return folder


def test_a_link_to_elsewhere_is_a_package_if_a_package_xml_says_so(home):
    elsewhere = home.parent / "outside"
    package(elsewhere / "theirs", "theirs")
    (elsewhere / "bare").mkdir()
    (elsewhere / "bare" / "part.stl").write_bytes(b"solid")
    for name in ("theirs", "bare"):
        (home / name).symlink_to(elsewhere / name, target_is_directory=True)
    packages = Packages(home / "robot.urdf")
    assert packages.mesh("package://theirs/part.stl") == home / "theirs" / "part.stl"
    with pytest.raises(OutsideError, match=r"part\.stl"):
        packages.mesh("package://bare/part.stl")
    with pytest.raises(OutsideError, match=r"outside"):
        Packages(home / "robot.urdf").mesh("package://theirs/../bare/part.stl")


@pytest.mark.parametrize("by", ["packages", "ROS_PACKAGE_PATH"])
def test_installed_packages_of_links_are_followed(by, home, monkeypatch):
    """As `colcon build --symlink-install` makes them, where the user names the installation."""
    source = package(home.parent / "source" / "parts", "parts")
    installed = home.parent / "install" / "parts"
    installed.mkdir(parents=True)
    for name in ("package.xml", "part.stl"):
        (installed / name).symlink_to(source / name)
    folders = [home.parent / "install"] if by == "packages" else []
    if not folders:
        monkeypatch.setenv(by, str(home.parent / "install"))
    packages = Packages(home / "robot.urdf", folders)
    assert packages.mesh("package://parts/part.stl") == installed / "part.stl"


def test_a_robot_file_that_is_a_link_names_files_on_both_sides(home):
    (home / "robot.urdf").write_text("")
    (home / "inner" / "part.stl").write_bytes(b"solid")
    other = home.parent / "other"
    (other / "meshes").mkdir(parents=True)
    (other / "meshes" / "part.stl").write_bytes(b"solid")
    (other / "robot.urdf").symlink_to(home / "robot.urdf")
    packages = Packages(other / "robot.urdf")
    assert packages.mesh("inner/part.stl") == home / "inner" / "part.stl"
    assert packages.mesh("meshes/part.stl") == other / "meshes" / "part.stl"


def test_top_folders_and_the_home_folder_are_not_around_a_file_that_a_link_leads_to(
    tmp_path, monkeypatch
):
    """As /tmp on macOS, a link to /private/tmp, and home folders that are links."""
    assert Packages(Path("/private/tmp/arm/arm.urdf")).around == [Path("/private/tmp/arm")]
    disk, user = tmp_path / "disk", tmp_path / "user"
    (disk / "arm").mkdir(parents=True)
    user.symlink_to(disk)
    monkeypatch.setattr(Path, "home", lambda: user)
    assert Packages(user / "arm" / "arm.urdf").around == [user / "arm", disk / "arm"]


ABOVE = [
    ("/workspace/urdf", True),
    ("/mnt/disk/robot/urdf", True),
    ("/mnt/c/Users/somebody/robot/urdf", True),
    ("/data/of/project/home/robot/urdf", True),
    ("/home/somebody/robot/urdf", True),
    ("/Users/somebody/robot/urdf", True),
    ("/opt/robot/urdf", True),
    ("/urdf", False),
    ("/tmp/urdf", False),
    ("/opt/urdf", False),
    ("/mnt/urdf", False),
    ("/mnt/c/urdf", False),
    ("/media/somebody/urdf", False),
    ("/export/home/somebody/urdf", False),
    ("/var/home/somebody/urdf", False),
    ("/mnt/c/Users/somebody/urdf", False),
    ("/var/tmp/urdf", False),
    ("/private/tmp/urdf", False),
    ("/usr/share/urdf", False),
    ("/root/urdf", False),
    ("/home/somebody/urdf", False),
    ("/Users/somebody/urdf", False),
]


@pytest.mark.parametrize(("folder", "read"), ABOVE)
def test_the_folder_above_counts_unless_it_is_a_home_or_of_the_system(folder, read):
    packages = Packages(Path(folder, "arm.urdf"))
    assert packages.holds(Path(folder, "meshes", "arm.stl"))
    assert packages.holds(Path(folder).parent / "meshes" / "arm.stl") == read
    assert not packages.holds(Path(folder).parent / ".hidden" / "arm.stl")


def test_homes_of_other_users_are_not_above_a_robot_file(tmp_path, monkeypatch):
    pwd = pytest.importorskip("pwd")
    (tmp_path / "bob").symlink_to(tmp_path / "disk")
    users = [SimpleNamespace(pw_dir=home) for home in ("/", "", str(tmp_path / "bob"))]
    monkeypatch.setattr(pwd, "getpwall", lambda: users)
    packages_module._homes.cache_clear()
    try:
        for home in (tmp_path / "bob", tmp_path / "disk"):
            above = [Packages(home / inner / "arm.urdf").around for inner in ("urdf", "robot/urdf")]
            assert above[0][0] == home / "urdf"
            assert home not in above[0]
            assert home / "robot" in above[1]
    finally:
        packages_module._homes.cache_clear()


def test_the_home_folder_is_not_above_a_robot_file(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    for folder, read in ((tmp_path / "urdf", False), (tmp_path / "robot" / "urdf", True)):
        mesh = folder.parent / "meshes" / "part.stl"
        for place in (folder, mesh.parent):
            place.mkdir(parents=True)
        mesh.write_bytes(solid().export(file_type="stl"))
        (folder / "arm.urdf").write_text(arm_with("../meshes/part.stl"))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            arm = sa.load(folder / "arm.urdf")
        assert (arm.tree.visuals["arm"].visual[0].geometry.file == mesh) == read
        said = " ".join(str(w.message) for w in caught)
        assert (str(mesh) in said and "packages=[FOLDER]" in said) == (not read)
        named = sa.load(folder / "arm.urdf", packages=folder.parent)
        assert named.tree.visuals["arm"].visual[0].geometry.file == mesh


def test_names_that_no_file_can_have_name_none(home):
    for name in ("a\0b.stl", "x" * 5000, "a/" * 3000 + "b.stl", "\ud800.stl", "", ".", "//", "~"):
        assert named_files(name, [home], lambda file: lies_in(file, [home])) == ([], [])
        assert Packages(home / "robot.urdf").mesh(name) is None


def test_loops_of_links_are_no_files(home):
    (home / "one.stl").symlink_to(home / "two.stl")
    (home / "two.stl").symlink_to(home / "one.stl")
    assert Packages(home / "robot.urdf").mesh("one.stl") is None


def test_a_mesh_of_an_included_sdf_stays_in_the_packages(home):
    """Its names are those of the included file; a name that leads out stays one that does."""
    secret(home, "part.stl", solid().export(file_type="stl"))
    (home / "inner" / "own.stl").write_bytes(solid().export(file_type="stl"))
    for name, reach in (("own.stl", SECRET / 2), ("../../outside/part.stl", 0.0)):
        geometry = f"<geometry><mesh><uri>{name}</uri></mesh></geometry>"
        arm = sdf_link("arm", 1, f"<visual name='v'>{geometry}</visual>")
        (home / "inner" / "arm.sdf").write_text(sdf(arm).replace("'m'", "'a'"))
        hinge = HINGE.replace("<child>arm", "<child>a::arm")
        include = "<include><uri>inner/arm.sdf</uri></include>"
        (home / "robot.sdf").write_text(sdf(sdf_link("bus", 50), include, hinge))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sa.ModelWarning)
            loaded = sa.load(home / "robot.sdf")
        assert loaded.tree.visuals["a::arm"].visual[0].reach() >= reach
        assert bool(reach) == (loaded.tree.visuals["a::arm"].visual[0].geometry.file is not None)


BAD_NAMES = {"NUL": "a\0b", "overlong": "a" * 5000, "deep": "a/" * 3000 + "b", "half": "\ud800"}


@pytest.mark.parametrize("name", BAD_NAMES.values(), ids=BAD_NAMES)
def test_names_that_a_caller_gives_and_no_file_can_have(name, tmp_path):
    folder = tmp_path / name
    with pytest.raises(sa.ConfigurationError, match="is not a folder"):
        sa.load("planar2", packages=folder)
    for suffix in (".jsonl", ".mcap"):
        with pytest.raises(sa.ConfigurationError, match=r"cannot be read|\[\.\.\.\]"):
            list(recorded(tmp_path / f"{name}{suffix}", "/joint_states"))


@pytest.mark.parametrize("name", ["a" * 5000, "a/" * 3000 + "b"], ids=["overlong", "deep"])
@pytest.mark.parametrize(
    "naming",
    [
        "<xacro:include filename='{}'/>",
        "<xacro:include filename='{}*'/>",
        "<xacro:include filename='$(find {})/x'/>",
        "<xacro:arg name='q' default='{}'/><xacro:include filename='$(arg q)/x'/>",
        "<a b=\"${{xacro.load_yaml('{}')}}\"/>",
    ],
)
def test_names_in_a_xacro_source_that_no_file_can_have(naming, name, tmp_path):
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    arm = robot(link("bus", 50.0), link("arm"), joint("elbow", "bus", "arm"))
    text = arm.replace("<robot", f"<robot {space}")
    path = tmp_path / "robot.xacro"
    path.write_text(text.replace("</robot>", naming.format(name) + "</robot>"))
    if "*" in naming:  # no file is included
        with pytest.warns(sa.ModelWarning, match="a"):
            sa.load(path)
        return
    with pytest.raises(sa.ModelError, match=r"robot\.xacro: is a xacro source"):
        sa.load(path)


@pytest.mark.parametrize("name", ["a" * 5000, "a/" * 3000 + "b"], ids=["overlong", "deep"])
def test_names_in_an_mjcf_and_an_sdf_that_no_file_can_have(name, tmp_path):
    told = refused(tmp_path, "robot.xml", f"<mujoco><include file='{name}'/></mujoco>", "compiled")
    assert len(told) < 5000
    mesh = f"<asset><mesh name='p' file='{name}.stl'/></asset>"
    arm = "<body><joint/><geom size='1'/><geom type='mesh' mesh='p' mass='0'/></body>"
    body = f"<body><freejoint/><geom size='1'/>{arm}</body>"
    (tmp_path / "robot.xml").write_text(f"<mujoco>{mesh}<worldbody>{body}</worldbody></mujoco>")
    with pytest.warns(sa.ModelWarning, match="meshes not found"):
        assert sa.load(tmp_path / "robot.xml").n == 1
    include = f"<include><uri>{name}</uri></include>"
    refused(tmp_path, "robot.sdf", sdf(sdf_link("bus", 50), include), "not found")
