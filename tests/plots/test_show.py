"""sa.plot: a figure of every result, in axes of one's own where one panel is enough."""

import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from helpers.arms import planar_pair
from helpers.catching import caught, flown
from helpers.closed import roomy
from helpers.labels import touching
from matplotlib.figure import Figure

import spacearm as sa
from spacearm.plots.drawings import MODULES, kinds_of
from spacearm.plots.show import plot
from spacearm.plots.style import COLOURS, DRAWINGS, figure, style
from spacearm.polynomial import level_set
from spacearm.results import Result

Q6 = np.radians([0, 60, -100, -50, 30, 0])
SINGULAR = np.radians([-65, -11.4108])


LAW = sa.JointPD(target=[0.4, 1.2], kp=5.0, kd=9.0)


def unsure(arm):
    """The arm with the mass of a link in an interval."""
    return sa.uncertain(arm, {"link_2": {"mass": 0.1}})


def line(cfg):
    """A short straight path of the tip from a posture."""
    home = cfg.centred(np.zeros(3)).tip
    return [home, pin.SE3(home.rotation, home.translation + np.array([-0.1, 0.1, 0.1]))]


def identified():
    holding = sa.load("planar2").grasp(2.0, 0.1 * np.eye(3)).at([0.3, 1.2])
    law, coarse = sa.JointPD([0.9, 0.4], kp=5.0, kd=9.0), sa.Integration(dt=0.1)
    return sa.identify(sa.simulate(holding, law, 2.0, integration=coarse), sa.load("planar2"))


@pytest.fixture(scope="module")
def few():
    """Some results that are drawn at once, as `results` has them."""
    planar, spatial = sa.load("planar2"), sa.load("mda6")
    flat, cfg = planar.at(SINGULAR), spatial.at(Q6)
    goal = [(1.2, 1.0)]
    run = sa.simulate(planar.at([0.3, 1.2]), LAW, 0.2)
    return {
        "a spatial arm": (spatial, 1),
        "a planar configuration": (flat, 1),
        "a singular report": (sa.singularity(flat), 3),
        "a reaction": (sa.reaction(run), 4),
        "collisions": (
            sa.collision_check(run, sa.Obstacle.sphere(0.2, sa.pose((3.0, 0.0, 0.0)))),
            1,
        ),
        "collisions of a posture": (sa.collision_check(cfg), 1),
        "spatial barycentric": (sa.barycentric(cfg), 1),
        "a map": (sa.singular_map(planar, points=21), 2),
        "a large set": (sa.singular_set(spatial), 1),
        "a workspace": (sa.workspace(planar), 1),
        "a followed path": (sa.follow(planar.at([0.3, 1.2]), goal), 4),
        "a plan": (sa.plan(planar.at([0.3, 1.2]), sa.Joints([0.5, 1.0])), 4),
    }


@pytest.fixture(scope="module")
def results(few):
    """One result of every kind that can be drawn, and how many panels its figure has."""
    planar, spatial = sa.load("planar2"), sa.load("mda6")
    flat, cfg = planar.at(SINGULAR), spatial.at(Q6)
    redundant = sa.load("planar3", task="x y")
    run = sa.simulate(planar.at([0.3, 1.2]), LAW, 0.2)
    design = sa.design.workspaces(planar, {"base_inertia": np.array([1.0, 2.0])})
    return few | {
        "a planar arm": (planar, 1),
        "an arm with two tips": (sa.load("dual_ur5", tip=("left", "right")), 1),
        "a report of two tips": (two_tips(), 3),
        "a held target": (held(), 1),
        "a report of one": (held().report(), 1),
        "a spatial configuration": (cfg, 1),
        "a planar arm in a tilted plane": (planar.at(SINGULAR, base=tilted()), 1),
        "a regular report": (sa.singularity(cfg), 3),
        "error bars": (sa.error_bars(cfg), 1),
        "a momentum matrix": (sa.momentum_matrix(cfg), 1),
        "a prescribed motion": (sa.prescribed_motion(cfg, {"joint_2": 0.1}), 1),
        "dynamics": (sa.forward_dynamics(cfg, np.zeros(6), np.ones(6)), 4),
        "attitudes of a planar arm": (
            sa.feasible_attitudes(
                planar.at([0, 1]), [(1.5, 0.2), (1.5, 0.5)], all_branches=True, samples=24
            ),
            1,
        ),
        "attitudes of a spatial arm": (
            sa.feasible_attitudes(spatial.at(Q6), line(cfg), samples=72, refine=1),
            2,
        ),
        "a catch": (caught(), 3),
        "a held body": (identified(), 1),
        "runs of a catch": (flown(), 1),
        "a level reach": (
            sa.level_reach(planar.at([-0.6, 1.4]), 0.03, directions=12, planned=True, cell=0.1),
            1,
        ),
        "a level reach in space": (sa.level_reach(spatial.at(Q6), 0.01, directions=30), 1),
        "a level envelope": (
            sa.level_envelope(planar.at([-0.6, 1.4]), [0.02], [20.0, 200.0], directions=8),
            2,
        ),
        "a level envelope without a line": (
            sa.level_envelope(planar.at([-0.6, 1.4]), [0.02], [20.0], directions=4, travel=50.0),
            2,
        ),
        "a momentum budget": (
            sa.momentum_budget(planar.at([-0.6, 1.4], momentum=[0, 0, 0, 0, 0, 1])),
            2,
        ),
        "a range of distances": (sa.distance_range(unsure(planar), [0.3, 0.8], samples=5), 1),
        "bands of shells": (sa.shell_bands(unsure(planar), samples=2), 1),
        "a wheel sizing": (sa.size_wheels(planar, tip_speed=0.1, samples=30), 1),
        "a capture": (sa.capture(cfg, [0, 0, 0.1, 0.05, 0.1, 0], 50.0, 4.0 * np.eye(3)), 4),
        "a target": (sa.Target(sa.Bus(9.0, size=(1, 2, 1))), 1),
        "an obstacle": (sa.Obstacle.robot(planar.at([0.3, 1.2])), 1),
        "planar barycentric": (sa.barycentric(flat), 1),
        "a planar chain": (sa.barycentric(flat).virtual_manipulator, 1),
        "a spatial chain": (sa.barycentric(cfg).virtual_manipulator, 1),
        "a polynomial of one angle": (sa.singularity_polynomial(planar).fix({0: 0.3}), 1),
        "a polynomial of two angles": (sa.singularity_polynomial(planar), 2),
        "a polynomial of six angles": (sa.singularity_polynomial(spatial), 1),
        "points": (sa.singular_set(planar, mode="fixed"), 1),
        "curves": (sa.singular_set(planar), 1),
        "a searched set": (sa.singular_set(redundant), 1),
        "a nearest singular posture": (sa.singular_set(planar).nearest([0.3, 0.4]), 1),
        "a path dependent point": (sa.workspace(planar).regions((0.9, 1.3)), 1),
        "a path independent point": (sa.workspace(planar).regions((0.9, 0.3)), 1),
        "a risk profile": (sa.risk_profile(planar, samples=2000), 1),
        "risks of poses": (sa.pose_risk(spatial, poses=20, samples=2000), 1),
        "a trajectory": (run, 4),
        "a flight": (sa.simulate_phases(planar.at([0.3, 1.2]), [sa.Phase(LAW, 0.2)]), 5),
        "designs": (design, 1),
        "many runs": (sa.simulate_many([planar.at([0.3, 1.2])] * 3, LAW, 0.2), 2),
        "an uncertain arm": (unsure(planar), 1),
        "a free box": (sa.free_box(planar.at([0.3, 1.2])), 1),
        "free boxes of two joints": (sa.free_boxes(planar, most=400), 1),
        "free boxes": (sa.free_boxes(spatial, most=50), 1),
        "a map of a closed chain": (held().map(points=5), 2),
        "a regrasp": (regrasped(), 4),
        "a certificate": (sa.singular_set(planar).is_free([[0.3, 1.2], [-0.3, -1.2]]), 1),
        "numbers": (sa.evaluate(planar, np.ones((5, 2)), quantities=("sigma_min", "distance")), 2),
        "Jacobians": (sa.generalized_jacobians(spatial, np.ones((3, 6))), 1),
        "a connection": (sa.connected(planar.at([0.3, 1.2]), planar.at([0.4, 1.2])), 1),
        **{what: (store, 1 + ("one arm" in what)) for what, store in stores().items()},
    }


def stores():
    """What `sweep` returns for each of its quantities, with designs and without."""
    rng = np.random.default_rng(0)
    arms = {"arm": ["a", "b"]}
    times = {"base_inertia": ("base_inertia", [1.0, 2.0], {"units": "times the inertia"})}
    joints = {"q1": ("q1", [0.0, 1.0, 2.0], {"units": "rad or m"}), "q2": ("q2", [0.0, 1.0])}
    runs, blocks = rng.random((1, 2, 9)) > 0.5, rng.integers(1, 9, (2, 2, 3, 4))
    maps = ("arm", "base_inertia", "q1", "q2"), rng.random((2, 2, 3, 2)), {"units": "m/rad"}
    one = {"arm": ["a"]}
    return {
        "a store of shells": xr.Dataset(
            {"fraction": (("arm", "base_inertia"), rng.random((2, 2)))}, arms | times
        ),
        "a store of one design of an arm": xr.Dataset({"fraction": (("arm",), [0.4])}, one),
        "a store of runs": xr.Dataset(
            {"success": (("arm", "base_inertia", "run"), runs)}, one | times
        ),
        "a store of risks": xr.Dataset(
            {
                name: (("arm", "base_inertia", "block", "radius"), values)
                for name, values in (("near", blocks), ("configurations", blocks + 5))
            },
            arms | times,
        ),
        "a store of maps": xr.Dataset({"sigma_min": maps}, arms | times | joints),
        "a store of maps of one arm": xr.Dataset(
            {"sigma_min": (maps[0], maps[1][:1, :1], maps[2])},
            one | {"base_inertia": [1.0]} | joints,
        ),
    }


def tilted():
    return pin.SE3(pin.exp3(np.array([1.1, -0.7, 0.0])), np.zeros(3))


def two_tips():
    arm = sa.load("dual_ur5", tip=("left", "right"))
    return sa.singularity(arm.at(np.linspace(-1.0, 1.0, arm.n)))


def held():
    ends = {"left": sa.pose((-0.3, 0, 0)), "right": sa.pose((0.3, 0, 0))}
    rod = sa.Target(sa.Bus(5.0, size=(1, 0.1, 0.1)), sa.pose((0, 1.5, 0)))
    return sa.hold(planar_pair().at([2.0, -1.2, 1.1, 1.2]), rod, ends)


def regrasped():
    pair, _ = roomy(1, tries=2)
    tip = pair.arm.tips[0]
    grasp = pair.grasps[tip] * sa.pose((0.05, -0.05, 0.02), (0.1, 0.2, -0.1))
    return pair.regrasp(tip, grasp, approach=0.05, constraints=sa.Constraints(limits=False))


@pytest.mark.slow
def test_every_result_has_a_figure_whose_labels_do_not_touch(results, monkeypatch):
    """It goes into given axes and subfigures, too."""
    for what, (thing, count) in results.items():
        drawn = plot(thing)
        assert isinstance(drawn, Figure), what
        assert len(drawn.axes) == count, what
        assert not touching(drawn, monkeypatch), what
        alone = [axes for axes in drawn.axes if axes.get_label() != "<colorbar>"]
        mine = Figure()
        kinds = ["3d" if axes.name == "3d" else None for axes in alone]
        panels = [mine.add_subplot(1, len(kinds), i + 1, projection=k) for i, k in enumerate(kinds)]
        assert plot(thing, ax=panels if len(panels) > 1 else panels[0]) is mine, what
        for axes in panels:
            assert axes.has_data() or axes.patches or axes.collections or axes.texts, what
        whole = Figure()
        left, right = whole.subfigures(1, 2)
        assert plot(thing, ax=right) is whole, what
        assert not left.axes
        assert [axes.name for axes in whole.axes if axes.get_label() != "<colorbar>"] == [
            axes.name for axes in alone
        ]


@pytest.mark.slow
def test_no_kind_of_drawing_is_untested(results):
    drawn = {kind for thing, _ in results.values() for kind in kinds_of(thing)}
    assert drawn >= set(DRAWINGS)


def test_panels_that_do_not_fit_are_refused_before_anything_is_drawn(few):
    two, space = Figure().subplots(1, 2), Figure().add_subplot(projection="3d")
    message = "this drawing has 4 panels: give a figure or a subfigure, or axes with"
    for ax in (two, two[0], [*two, space, space], "here", [1, 2, 3, 4]):
        with pytest.raises(sa.ConfigurationError, match=message):
            plot(few["a reaction"][0], ax=ax)
    assert not any(axes.has_data() for axes in (*two, space))
    with pytest.raises(sa.ConfigurationError, match="this drawing has one panel"):
        plot(few["a map"][0], ax=two)


NOTEBOOK = """
from IPython.core.displayhook import CapturingDisplayHook
from IPython.core.displaypub import CapturingDisplayPublisher
from IPython.core.interactiveshell import InteractiveShell

shell = InteractiveShell.instance()
shell.enable_gui = print
publisher = shell.display_pub = CapturingDisplayPublisher()
shell.display_trap.hook = CapturingDisplayHook(shell, publisher.outputs)
begin = [
    "%matplotlib inline", "import matplotlib.pyplot as plt", "import spacearm as sa",
    "arm = sa.load('planar2'); cfg = arm.at([0.3, 1.2])",
]
new = "figure, axes = plt.subplots()"
for cell in (
    *begin,
    "sa.plot(cfg)",
    f"{new}; sa.plot(cfg, ax=axes)",
    f"{new}; sa.plot(cfg, ax=axes); figure",
    f"{new}; drawn = sa.plot(cfg, ax=axes)",
    "figure",
    "figure = plt.figure(); sa.plot(sa.singularity(cfg), ax=figure); figure",
):
    publisher.outputs.clear()
    assert shell.run_cell(cell).success, cell
    print(sum("image/png" in output["data"] for output in publisher.outputs))
"""


@pytest.mark.slow
def test_a_notebook_shows_every_figure_once():
    """As value of a cell, as pyplot's own, as both, and later again."""
    run = subprocess.run(
        [sys.executable, "-c", NOTEBOOK], capture_output=True, text=True, check=True
    )
    shown = [line for line in run.stdout.splitlines() if line.isdigit()]
    assert shown == ["0"] * 4 + ["1"] * 6


def test_axes_of_the_wrong_kind_are_refused(few):
    flat, space = Figure().add_subplot(), Figure().add_subplot(projection="3d")
    with pytest.raises(sa.ConfigurationError, match="projection '3d'"):
        plot(few["a map"][0], ax=space)
    with pytest.raises(sa.ConfigurationError, match="projection='3d'"):
        plot(few["a spatial arm"][0], ax=flat)
    with pytest.raises(sa.ConfigurationError, match="give Matplotlib axes, a figure or"):
        plot(few["a map"][0], ax="here")


def test_options_reach_the_drawing(few):
    drawn = plot(few["a planar configuration"][0], color="#ff0000", label=False)
    assert drawn.axes[0].lines[0].get_color() == "#ff0000"
    assert not drawn.axes[0].texts
    drawn = plot(few["a followed path"][0], target=(1.2, 1.0))
    assert "target" in [text.get_text() for text in drawn.axes[0].get_legend().get_texts()]


@pytest.mark.parametrize(
    ("what", "takes"),
    [
        ("a reaction", "none"),
        ("a map", "box"),
        ("a workspace", "path, profile"),
        ("a plan", "target"),
    ],
)
def test_an_unknown_option_is_named(few, what, takes):
    with pytest.raises(sa.ConfigurationError, match=f"no option 'colour'; it takes: {takes}"):
        plot(few[what][0], colour="red")


def test_of_a_plan_and_its_proof_the_plan_is_drawn():
    """As `sa.robust_plan` returns them."""
    arm = sa.load("planar2")
    way = sa.follow(arm.at([0.3, 1.2]), [(1.5, 1.2)])
    proof = sa.is_free_for_all(unsure(arm), way.q[[0, -1]])
    assert len(plot((way, proof)).axes) == len(plot(way).axes)


@pytest.mark.parametrize("thing", [None, 3, "planar2", {"file": "a.csv"}, {}, np.zeros(0), [1]])
def test_what_cannot_be_drawn_is_told_what_can(thing):
    with pytest.raises(
        sa.ConfigurationError, match=r"no drawing of .*(Configuration.*Workspace|sa\.evaluate)"
    ):
        plot(thing)


WORDS_ALONE = ("Certificate", "RobustCertificate", "ServoStep", "Watched")
"""Results that are a verdict or an instant: a card has their words and numbers."""


def test_every_public_result_class_has_a_drawing_or_a_card():
    classes = [getattr(sa, name) for name in sa.__all__]
    results = [kind for kind in classes if isinstance(kind, type) and issubclass(kind, Result)]
    assert len(results) > 20
    assert len(MODULES) > 5  # their import enters all drawings
    own = set(DRAWINGS) - {"Described"}
    left = {kind.__name__ for kind in results if not {k.__name__ for k in kind.__mro__} & own}
    assert left == set(WORDS_ALONE)


@pytest.mark.slow
def test_a_real_store_is_drawn(tmp_path):
    pytest.importorskip("zarr")
    study = """
    arms = ["planar2"]
    [parameters]
    base_inertia = [1, 5]
    [shells]
    """
    store = sa.sweep(sa.Study.parse(study), tmp_path / "store", workers=1)
    drawn = plot(store)
    assert drawn.axes[0].get_ylabel() == "path independent share [%]"
    (curve,) = drawn.axes[0].lines
    shares = 100.0 * store["fraction"].values[0]
    np.testing.assert_allclose(curve.get_ydata(), shares, atol=1e-12)


def test_a_dataset_of_something_else_is_refused():
    with pytest.raises(sa.ConfigurationError, match=r"spacearm\.simulate_many returns"):
        plot(xr.Dataset({"a": 1}))


def test_a_set_that_no_joint_decides_is_refused():
    arm = sa.load("planar2", task="rz", locked={"joint_2": 0.3})
    with pytest.raises(sa.UnsupportedError, match="no joint decides whether the arm is singular"):
        plot(sa.singular_set(arm))


@pytest.mark.slow
def test_the_surface_of_a_set_leaves_the_seams_of_the_torus_open(monkeypatch):
    arm = sa.load("mda6", task="position", locked={"joint_4": 0.0, "joint_5": 0.3, "joint_6": 0.0})
    found = sa.singular_set(arm)
    surface = level_set.surface(found.S, resolution=0.3)  # a coarse one
    monkeypatch.setattr(type(found), "surface", lambda _: surface)
    shown = plot(found)
    shown.canvas.draw()
    (drawn,) = shown.axes[0].collections
    assert 0 < len(drawn.get_facecolor()) < len(surface.triangles)


def test_labels_of_bodies_do_not_stand_over_each_other(few):
    axes = plot(few["spatial barycentric"][0]).axes[0]
    assert "4–6" in [text.get_text().strip() for text in axes.texts]  # the wrist of mda6


def test_one_posture_has_no_time(few):
    axes = plot(few["collisions of a posture"][0]).axes[0]
    assert "time" not in axes.get_xlabel() + axes.get_ylabel()
    assert "time" in plot(few["collisions"][0]).axes[0].get_xlabel()


def test_the_lost_direction_goes_through_the_tip(few):
    report = few["a singular report"][0]
    line = plot(report).axes[0].lines[-1].get_xydata()
    tip = report.configuration.tip.translation[:2]
    np.testing.assert_allclose(line.mean(axis=0), tip, atol=1e-12)
    np.testing.assert_allclose(abs((line[1] - tip) @ report.available[:, 0]), 0.0, atol=1e-9)


def test_samples_are_drawn_over_the_joints_that_show_structure(few):
    """Joint 6 changes nothing, joint 1 little: the elbow turns joint 3, the wrist joint 5."""
    axes = plot(few["a large set"][0]).axes[0]
    drawn = {axes.get_xlabel(), axes.get_ylabel()}
    assert drawn & {"joint_3 [deg]", "joint_5 [deg]"}
    assert not drawn & {"joint_1 [deg]", "joint_6 [deg]"}


def test_a_notebook_shows_the_last_line_of_a_cell():
    with style():
        drawn = figure(2, 1)
        drawn.subplots()
    png, size = drawn._repr_png_()
    assert png.startswith(b"\x89PNG")
    assert size == {"width": 180, "height": 90}


@pytest.mark.slow
def test_a_map_shows_the_joint_limits_and_its_colours_reach_as_far_as_it_does():
    arm = sa.load("mda6")
    found = sa.singular_map(arm, ("joint_2", "joint_3"), points=7)
    np.testing.assert_array_equal(found.joint_limits[0], (arm.lower[1], arm.upper[1]))
    axes, bar = sa.plot(found).axes
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        "outside the joint limits"
    ]
    most = np.degrees(found.distance.max())
    assert min(most, 45.0) <= bar.get_ylim()[1] <= max(2.5 * most, 1.0)
    whole = sa.plot(sa.singular_map(sa.load("planar2"), points=7))
    assert whole.axes[0].get_legend() is None


def test_the_style_is_a_sheet_of_matplotlib_and_postures_show_velocities():
    import matplotlib.pyplot as plt

    with plt.style.context("spacearm.paper"):
        assert plt.rcParams["axes.titlelocation"] == "left"
        assert plt.rcParams["axes.prop_cycle"].by_key()["color"] == list(COLOURS)
    cfg = sa.load("planar2").at(np.radians([-65, -11.41]))
    plain, more = sa.plot(cfg), sa.plot(cfg, velocities=True)
    assert len(more.axes[0].lines) == len(plain.axes[0].lines) + 1
    assert any("no motion" in text.get_text() for text in more.axes[0].texts)
    with pytest.raises(sa.UnsupportedError, match="tip velocities"):
        sa.plot(sa.load("planar3").at([0.1, 0.2, 0.3]), velocities=True)


@pytest.mark.parametrize(
    ("option", "value", "named"),
    [
        ("path", "abc", "path is 'abc'"),
        ("path", [1.0, 2.0], r"path is \[1.0, 2.0\]"),
        ("path", np.zeros((0, 2)), "path is array"),
        ("path", [[1e308, 0.0]], r"path is \[\[1e\+308"),
        ("path", [[1.0, 2.0], [3.0]], "path is"),
        ("profile", 3, "profile is 3"),
        ("workspace", "abc", "workspace is 'abc'"),
        ("box", np.eye(2), "box is array"),
        ("color", "abc", "color is 'abc'"),
        ("color", (1.0, 2.0, 3.0), "color is"),
        ("label", np.eye(2), "label is"),
        ("chain", "abc", "chain is 'abc'"),
    ],
)
def test_options_of_a_wrong_kind_are_named(option, value, named, shown_things):
    with pytest.raises(sa.ConfigurationError, match=named):
        sa.plot(shown_things[option], **{option: value})


@pytest.fixture(scope="module")
def shown_things():
    """What takes each option."""
    arm = sa.load("planar2")
    reach = sa.workspace(arm, effort=20)
    cfg = arm.at([0.3, 1.2])
    return {
        "path": reach,
        "profile": reach,
        "workspace": sa.Motion(arm, [0.0, 1.0], [[0.3, 1.2], [0.4, 1.1]], np.eye(7)[[6, 6]]),
        "box": sa.singular_map(arm, points=5),
        "color": cfg,
        "label": arm,
        "chain": sa.barycentric(cfg),
    }


def test_a_map_outlines_a_box_that_holds_its_joints():
    arm, q = sa.load("planar3"), [0.2, 1.1, -0.7]
    box, joints = sa.free_box(arm.at(q)), ("joint_2", "joint_3")
    drawn = sa.plot(sa.singular_map(arm, joints, q, 9), box=box).axes[0]
    outline = np.radians(drawn.patches[0].get_bbox().get_points())
    ends = np.clip([box.lower[1:], box.upper[1:]], -3.0 * np.pi, 3.0 * np.pi)
    np.testing.assert_allclose(outline, ends, atol=1e-12)
    first = int(np.argmin(box.upper - box.lower))
    others = [name for j, name in enumerate(arm.joint_names) if j != first]
    beyond = np.array(q)
    beyond[first] = box.upper[first] + 0.01
    outside = sa.singular_map(arm, tuple(others), beyond, 9)
    with pytest.raises(sa.ConfigurationError, match=f"holds joint_{first + 1} outside the box"):
        sa.plot(outside, box=box)
    with pytest.raises(sa.ConfigurationError, match="box is of planar3, the map of planar2"):
        sa.plot(sa.singular_map(sa.load("planar2"), points=9), box=box)
