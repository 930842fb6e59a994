"""Design sweeps: physics, labels, interruption."""

import json
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from helpers.arms import load_text, random_chain
from helpers.commands import spacearm

import spacearm as sa
from spacearm.workspaces.design import optimise_mount, vary, workspaces

ARM = sa.load("planar2")


def test_vary_changes_what_it_names():
    arm = vary(ARM, {"base_mass": 80, "mount_y": 0.1, "mass:link_1": 8, "payload": 5})
    assert arm.mass == pytest.approx(80 + 8 + 3 + 5)
    np.testing.assert_allclose(arm.mount.translation, (0.5, 0.1, 0), atol=1e-12)
    inertia = vary(ARM, {"base_inertia": 3}).model.inertias[1].inertia
    np.testing.assert_allclose(inertia, 3 * ARM.model.inertias[1].inertia, atol=1e-9)
    assert vary(ARM, {}).mass == ARM.mass
    link = [arm.model.getJointId("joint_1"), ARM.model.getJointId("joint_1")]
    heavy, light = arm.model.inertias[link[0]], ARM.model.inertias[link[1]]
    np.testing.assert_allclose(heavy.inertia, 2 * light.inertia, atol=1e-9)


def rebuilt(text, link, length, mass):
    """The robot's file with one link of the same shape: lengths and masses times factors."""
    root = ElementTree.fromstring(text)

    def times(element, names, factor):
        for name in names:
            values = [factor * float(x) for x in element.get(name).split()]
            element.set(name, " ".join(map(repr, values)))

    (part,) = (each for each in root.iter("link") if each.get("name") == link)
    for origin in part.iter("origin"):
        times(origin, ["xyz"], length)
    for joint in root.iter("joint"):
        if joint.find("parent").get("link") == link:
            times(joint.find("origin"), ["xyz"], length)
    times(part.find("inertial/mass"), ["value"], mass)
    axes = [f"i{a}{b}" for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")]
    times(part.find("inertial/inertia"), axes, mass * length**2)
    return ElementTree.tostring(root, encoding="unicode")


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("link", ["link_1", "link_3", "link_4"])
def test_links_of_other_length_and_mass_are_those_of_a_file_written_by_hand(seed, link):
    """Of the same shape, whether another joint, the tip or the frame of a fixed one is next."""
    text, k, m = random_chain(seed, 4), 1.7, 0.6
    arm = load_text(text, tip="tip", task="position")
    before, part = arm.tree.length(link, arm.tips), arm.tree.links[link]
    changed = vary(arm, {f"length:{link}": k * before, f"mass:{link}": m * part.mass})
    wanted = load_text(rebuilt(text, link, k, m), tip="tip", task="position")
    assert changed.tree.length(link, arm.tips) == pytest.approx(k * before, rel=1e-12)
    q = np.random.default_rng(seed).uniform(-1, 1, arm.n)
    for got, want in ((changed.at(q).A, wanted.at(q).A), (changed.at(q).J, wanted.at(q).J)):
        np.testing.assert_allclose(got, want, atol=1e-12 * np.abs(want).max())


def test_all_lengths_of_an_arm_scale_its_jacobian():
    """Lengths and the bus times k: the linear rows of J* are k times as large."""
    k, q = 2.5, [0.4, 1.1]
    change = {
        f"length:{link}": k * ARM.tree.length(link, ARM.tips) for link in ("link_1", "link_2")
    }
    larger = vary(ARM, {**change, "base_inertia": k**2, "mount_x": k * ARM.mount.translation[0]})
    J, wanted = sa.generalized_jacobian(larger.at(q)), k * sa.generalized_jacobian(ARM.at(q))
    np.testing.assert_allclose(J[:2], wanted[:2], atol=1e-12 * np.abs(wanted).max())


def test_shapes_grow_with_their_link():
    """Those of the link and of all that is fixed to it, for collisions too."""
    arm = sa.load("mda6")
    link = arm.tree.movable(arm.tip)[2].child
    k, length, compared = 1.5, arm.tree.length(link, arm.tips), 0
    longer = arm.replace(link_length={link: k * length})
    for name in arm.tree.lumps[arm.tree.body_of[link]]:
        old, new = arm.tree.visuals.get(name), longer.tree.visuals.get(name)
        for a, b in zip(old.collision if old else (), new.collision if new else (), strict=True):
            np.testing.assert_allclose(b.pose.translation, k * a.pose.translation, atol=1e-12)
            first, second = (np.hstack(list(shape.geometry)) for shape in (a, b))
            np.testing.assert_allclose(second, k * first, atol=1e-12)
            compared += 1
    assert compared


def test_a_heavier_bus_is_of_the_same_shape_in_designs_too():
    bus = ARM.model.inertias[1]
    found = vary(ARM, {"base_mass": 3 * bus.mass, "base_inertia": 2}).model.inertias[1]
    np.testing.assert_allclose(found.inertia, 6 * bus.inertia, rtol=1e-12, atol=1e-9)


def test_a_payload_moves_the_cm_and_no_singularity():
    """Singularities do not depend on the last body; distances from the CM shrink by M / M'."""
    loaded = vary(ARM, {"payload": 13.0})
    rng = np.random.default_rng(0)
    for q in sa.singular_set(ARM).sample(20, rng):
        assert sa.singularity(loaded.at(q)).sigma_min < 1e-12
    scale = ARM.mass / loaded.mass
    np.testing.assert_allclose(sa.workspace(loaded).pdw, scale * sa.workspace(ARM).pdw, atol=1e-9)


@pytest.mark.slow
def test_a_sweep_equals_its_points():
    result = workspaces(ARM, {"base_inertia": [1, 5], "mount_x": [0.0, 0.3, 0.5]}, risk_bins=4)
    assert result["piw"].dims == ("base_inertia", "mount_x")
    assert result["done"].all()
    for k in (1, 5):
        for x in (0.0, 0.3, 0.5):
            alone = sa.workspace(vary(ARM, {"base_inertia": k, "mount_x": x}))
            here = result.sel(base_inertia=k, mount_x=x)
            assert float(here["piw"]) == pytest.approx(alone.volumes["piw"])
            assert float(here["fraction"]) == pytest.approx(alone.fraction)
            np.testing.assert_allclose(here["pdw"].dropna("shell"), alone.pdw, atol=1e-12)
    assert result["risk"].sizes["class"] == 4
    numbers = [x for x in result.variables.values() if x.dtype.kind != "U"]
    assert all("units" in x.attrs for x in numbers)
    one = sa.risk_profile(vary(ARM, {"base_inertia": 5, "mount_x": 0.3}), bins=9)
    assert float(result["near_share"].sel(base_inertia=5, mount_x=0.3)) == one.overall
    told = float(result["near_error"].sel(base_inertia=5, mount_x=0.3))
    whole = sa.risk_profile(vary(ARM, {"base_inertia": 5, "mount_x": 0.3}), bins=1)
    assert told == pytest.approx(one.overall_error) == pytest.approx(whole.error[0])
    assert (result["fraction"].sel(mount_x=0.0) > 0.999).all()  # r_0 = 0
    assert (result["fraction"].diff("base_inertia") >= -1e-9).all()


def test_ctrl_c_keeps_what_is_done():
    def stop(done, _):
        if done == 2:
            raise KeyboardInterrupt

    result = workspaces(ARM, {"mount_x": [0.1, 0.2, 0.3, 0.4]}, progress=stop)
    assert result["done"].values.tolist() == [True, True, False, False]
    assert np.isfinite(result["piw"].values[:2]).all()
    assert np.isnan(result["piw"].values[2:]).all()


@pytest.mark.slow
def test_the_best_mount_is_nearest_the_spacecraft_s_cm():
    told = []
    best = optimise_mount(
        ARM, {"mount_x": (0.1, 0.8)}, most=12, progress=lambda *both: told.append(both)
    )
    assert [done for done, _ in told] == list(range(1, best.tried + 1))
    assert all(done <= total for done, total in told)
    assert best.mount.translation[0] == pytest.approx(0.1, abs=1e-2)
    assert best.workspace.fraction > sa.workspace(ARM).fraction
    assert isinstance(best.mount, pin.SE3)
    assert best.tried >= 10


def run(*arguments, cwd):
    return spacearm("design", *arguments, cwd=cwd)


@pytest.mark.slow
@pytest.mark.parametrize(
    "ranges",
    [("--vary", "base_inertia=1:20:3", "--vary", "mount_x=0:0.5:2"), ("--vary", "mount_x=0:0.5:2")],
)
def test_command_prints_and_draws(ranges, tmp_path):
    done = run("planar2", *ranges, "--output", "d.svg", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "100.00%" in done.stdout  # mounted at the spacecraft's CM
    assert "35.92%" in done.stdout
    assert "<svg" in (tmp_path / "d.svg").read_text()


def test_command_as_json(tmp_path):
    done = run("planar2", "--vary", "mass:link_1=4:8:2", "--json", cwd=tmp_path)
    data = json.loads(done.stdout)
    varied = [design["parameters"] for design in data["designs"]]
    assert varied == [{"mass:link_1": 4.0}, {"mass:link_1": 8.0}]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("planar2",), "Missing option '--vary'"),
        (("planar2", "--vary", "mount_x=a:b"), "--vary mount_x=a:b"),
        (("planar2", "--vary", "mount_x=0:1:0"), "LOW:HIGH:COUNT"),
        (("planar2", "--vary", "mount_x=0:1", "--output", "d.gif"), "gif"),
        (("planar2", "--vary", "base_mass=-3"), "positive"),
    ],
)
def test_bad_commands(arguments, message, tmp_path):
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: vary(ARM, {"base_weight": 3}), sa.ConfigurationError, "base_mass"),
        (lambda: vary(ARM, {"base_mass": -3}), sa.ModelError, "positive"),
        (lambda: vary(ARM, {"mass:wing": 3}), sa.ModelError, "wing"),
        (lambda: vary(ARM, {"length:wing": 3}), sa.ModelError, "wing"),
        (lambda: vary(ARM, {"length:link_1": 0}), sa.ModelError, "positive"),
        (lambda: vary(ARM, {f"length:{ARM.tree.root}": 2}), sa.ModelError, "spacecraft"),
        (lambda: vary(ARM, {"width:link_1": 2}), sa.ConfigurationError, "length:LINK"),
        (lambda: vary(ARM, {"payload": -1}), sa.ModelError, "payload"),
        (lambda: workspaces(ARM, {}), sa.ConfigurationError, "one or more"),
        (lambda: workspaces(ARM, {"base_mass": []}), sa.ConfigurationError, "one or more"),
        (lambda: optimise_mount(ARM, {}), sa.ConfigurationError, "bounds"),
        (lambda: optimise_mount(ARM, {"mount_x": (1, 0)}), sa.ConfigurationError, "low < high"),
        (lambda: optimise_mount(ARM, {"payload": (0, 1)}), sa.ConfigurationError, "mount_x"),
    ],
)
def test_bad_input(call, error, message):
    with pytest.raises(error, match=message):
        call()
