"""Draws the pictures of README.md and docs/ anew.

    python notebooks/pictures.py                  # all of them
    python notebooks/pictures.py figure_7 plan    # some

Needs `pip install -e '.[test]'`, and chromium for the picture of the browser view.
"""

from __future__ import annotations

import sys
from io import BytesIO
from itertools import product
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from zipfile import ZipFile

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image
from playwright.sync_api import sync_playwright

import spacearm as sa
from spacearm.plots.configurations import draw_posture, draw_velocities
from spacearm.plots.style import BLUE, GREEN, GREY, RED, style
from spacearm.polynomial.level_set import surface
from spacearm.polynomial.univariate import wrap

FOLDER = Path(__file__).parent / "pictures"
START = np.radians([-57.936, 60.337])
"""The posture of figure 5 of the paper, with the tip at (2, 0) m."""
TARGET = np.array([1.5, 1.5])


def start(attitude: float) -> pin.SE3:
    """The spacecraft at the start of figures 5 and 7, the system CM at the origin."""
    turned = pin.SE3(pin.utils.rotate("z", np.radians(attitude)), np.zeros(3))
    return sa.load("planar2").at(START, base=turned).centred(np.zeros(3)).base


def singular_posture() -> Figure:
    """Figure 3 of the paper beside a posture a few degrees of arc away, and where both lie."""
    arm = sa.load("planar2")
    attitude = pin.SE3(pin.utils.rotate("z", np.radians(40)), np.zeros(3))
    singular, regular = np.radians([-65, -11.41]), np.radians([-65, -75])
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 4.6), layout="constrained")
    for axes, q, title in (
        (left, regular, "Regular: the tip moves every way"),
        (middle, singular, "Dynamic singularity: one way is lost"),
    ):
        draw_posture(axes, arm.at(q, base=attitude))
        draw_velocities(axes, arm.at(q, base=attitude))
        axes.set(xlim=(-0.9, 3.1), ylim=(-1.9, 1.5), title=title, adjustable="box")
    left.text(1.15, -1.78, "tip velocities for unit joint rates", color=BLUE, ha="center")

    sa.plot(sa.singular_map(arm), ax=right)
    for q, name, color, ink in (
        (singular, "singular", RED, "white"),
        (regular, "regular", BLUE, "black"),
    ):
        right.plot(*np.degrees(q), "o", color=color, ms=8, mec="white")
        right.annotate(name, np.degrees(q), (8, 6), textcoords="offset points", color=ink)
    right.set_title("Where: the dark valleys in joint space")
    return figure


def view() -> None:
    """The page of `spacearm view planar2 --deg -65 -11.41 --attitude 0 0 40`."""
    attitude = pin.SE3(pin.utils.rotate("z", np.radians(40)), np.zeros(3))
    viewer = sa.view(sa.load("planar2").at(np.radians([-65, -11.41]), base=attitude), open=False)
    with sync_playwright() as playwright:
        options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=which("chromium"), args=options)
        page = browser.new_page(viewport={"width": 1366, "height": 820})
        page.goto(viewer.serve())
        page.wait_for_selector("body[data-ready=yes]", state="attached")
        page.wait_for_timeout(1500)
        page.screenshot(path=FOLDER / "view.png")
        browser.close()
    viewer.close()


def simulation_planar2() -> Figure:
    """Figures 5 and 6: the transposed Jacobian law meets a singularity and never arrives."""
    law = sa.TransposedJacobian(target=TARGET, kp=5, kd=15)
    run = sa.simulate(sa.load("planar2").at(START, base=start(21.0)), law, 200.0)
    return sa.plot(run, target=TARGET)


def figure_7() -> Figure:
    """To C, nine times round a square, then to the target."""
    arm, C = sa.load("planar2"), np.array([1.0, 0.0])
    square = [C + 0.2 * np.array(p) for p in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    path = [C, *(9 * square), square[0], C, TARGET]
    run = sa.follow(arm.at(START, base=start(20.94)), path, limits=False)
    return sa.plot(sa.workspace(arm), path=run.tip[:, :2])


def plan_planar2() -> Figure:
    """The open problem: from the start of figure 5 to its target, and arrive."""
    arm = sa.load("planar2")
    found = sa.plan(arm.at(START, base=start(21.0)), TARGET)
    return sa.plot(found, target=TARGET, workspace=sa.workspace(arm))


def map_planar2() -> Figure:
    """Figure 4: the picture of `spacearm map planar2`."""
    return sa.plot(sa.singular_map(sa.load("planar2")))


def workspace_planar2() -> Figure:
    """The rings of figure 7: the picture of `spacearm workspace planar2`."""
    return sa.plot(sa.workspace(sa.load("planar2")))


def construction() -> Figure:
    """The singular set of a 7-joint servicer in three joints: where two minors vanish together."""
    found = sa.singular_set(sa.load("chaser7"))
    q, joints = np.array([0.0, 0.4, -0.5, 0.3, 1.0, 2.0, 0.1]), [3, 4, 5]
    held = {j: float(q[j]) for j in range(len(q)) if j not in joints}
    figure = plt.figure(figsize=(7.2, 6.0))
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    for minor, colour in zip(found.triangle.polynomials, (GREY, BLUE), strict=True):
        mesh = surface(minor.fix(held))
        corners = np.degrees(mesh.vertices[mesh.triangles])
        inside = np.ptp(corners, axis=1).max(axis=1) < 180.0  # not across the seams of the torus
        axes.add_collection3d(Poly3DCollection(corners[inside], fc=colour, ec="none", alpha=0.08))
    for curve in found.curves(joints, q):
        points = np.degrees(wrap(curve[:, joints]))
        points[np.abs(np.diff(points, axis=0, prepend=points[:1])).max(axis=1) > 180.0] = np.nan
        axes.plot(*points.T, color=RED, lw=2.5, zorder=10)
    turn = range(-120, 121, 60)
    axes.set(xticks=turn, yticks=turn, zticks=turn, xlim=(-180, 180), ylim=(-180, 180))
    axes.set(zlim=(-180, 180), xlabel="q4 [deg]", ylabel="q5 [deg]", zlabel="q6 [deg]")
    axes.view_init(elev=20.0, azim=-62.0)
    return figure


def distance() -> Figure:
    """What the distance to the singular set is: the radius of the largest circle free of it."""
    arm, q = sa.load("planar2"), np.radians([40.0, 60.0])
    near = sa.singular_set(arm).nearest(q)
    nearest, radius = near.q, near.distance
    figure, axes = plt.subplots(figsize=(6.4, 5.6), layout="constrained")
    for curve in sa.singular_set(arm).curves():
        for turns in product((-360.0, 0.0, 360.0), repeat=2):
            axes.plot(*(np.degrees(curve) + turns).T, color=RED, lw=2)
    axes.add_patch(Circle(np.degrees(q), np.degrees(radius), color=BLUE, alpha=0.15))
    axes.annotate("", np.degrees(nearest), np.degrees(q), arrowprops={"arrowstyle": "->", "lw": 2})
    axes.plot(*np.degrees(q), "o", color=BLUE, ms=8)
    axes.plot(*np.degrees(nearest), "o", color=RED, ms=8)
    axes.annotate("posture", np.degrees(q), (8, 6), textcoords="offset points")
    below = {"textcoords": "offset points", "ha": "center"}
    axes.annotate("nearest singular posture", np.degrees(nearest), (30, -30), **below)
    turn = range(-180, 181, 90)
    axes.set(xlim=(-180, 180), ylim=(-180, 180), xticks=turn, yticks=turn, aspect="equal")
    axes.set(xlabel="q1 [deg]", ylabel="q2 [deg]", title=f"Distance {np.degrees(radius):.1f}°")
    return figure


def payload() -> Figure:
    """A heavy hand lowers sigma_min, and moves no singular posture."""
    arm, q = sa.load("mda6"), np.radians([20.0, 60.0, -100.0, -50.0, 30.0, 0.0])
    turn = np.linspace(-180.0, 180.0, 721)
    Q = np.tile(q, (len(turn), 1))
    Q[:, 2] = np.radians(turn)
    figure, axes = plt.subplots(figsize=(7.2, 4.0), layout="constrained")
    for root in np.degrees(sa.singular_set(arm).roots(q, "joint_3").angles):
        axes.axvline(root, color=RED, lw=1.5, ls=":")
    for mass, colour in ((0.0, BLUE), (50.0, GREEN), (500.0, GREY)):
        sigma = sa.evaluate(arm.replace(payload=mass), Q, ("sigma_min",))["sigma_min"]
        axes.plot(turn, sigma, color=colour, lw=2, label=f"{mass:g} kg in the hand")
    axes.set(xlabel="q3 [deg]", xlim=(-180, 180), xticks=range(-180, 181, 90), ylim=(0, None))
    axes.set(ylabel="least singular value of J*", title="mda6: the zeros stand still")
    axes.legend()
    return figure


def closed_loop() -> Figure:
    """The joints go once round a square and come back; the spacecraft does not."""
    arm, steps = sa.load("planar2"), np.radians([(0, 0), (110, 0), (110, 110), (0, 110), (0, 0)])
    motion = [arm.at(np.radians([-80.0, 20.0]) + steps[0]).centred(np.zeros(3))]
    for step in steps[1:]:
        motion.append(sa.move(motion[-1], np.radians([-80.0, 20.0]) + step))
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.6), layout="constrained")
    corners = np.degrees([cfg.q for cfg in motion])
    axes[0].plot(*corners.T, "o-", color=BLUE, lw=2)
    axes[0].set(xlabel="q1 [deg]", ylabel="q2 [deg]", aspect="equal", title="The joints: a loop")
    for ax, cfg, when in ((axes[1], motion[0], "Before"), (axes[2], motion[-1], "After")):
        draw_posture(ax, cfg)
        turned = np.degrees(pin.log3(cfg.base.rotation)[2])
        ax.set(xlim=(-2.2, 2.2), ylim=(-2.2, 2.2), adjustable="box")
        ax.set_title(f"{when}: attitude {turned:.1f}°")
    return figure


def reach() -> None:
    """A clip: a straight line ends at a singularity; the plan turns the spacecraft and arrives."""
    begin = sa.load("planar2").at(START, base=start(21.0))
    line, found = sa.follow(begin, [TARGET], limits=False), sa.plan(begin, TARGET)
    figure, (space, gauge) = plt.subplots(
        1, 2, figsize=(6.2, 4.2), width_ratios=(5, 1), layout="constrained"
    )
    clip: list[Image.Image] = []
    for run, count, words in (
        (line, 20, "straight to the target: the hand stops, singular"),
        (found, 50, "planned: the spacecraft turns, the hand arrives"),
    ):
        for i in np.linspace(0, len(run) - 1, count).astype(int).tolist():
            space.clear()
            gauge.clear()
            space.plot(*np.transpose([line.tip[0, :2], TARGET]), "--", color=GREY, lw=1)
            draw_posture(space, run[i])
            space.plot(*run.tip[: i + 1, :2].T, color=BLUE, lw=1.5)
            space.plot(*line.tip[-1, :2], "x", color=RED, ms=8, visible=run is found)
            space.plot(*TARGET, "*", color=RED, ms=14)
            space.set(xlim=(-1.2, 2.6), ylim=(-1.4, 2.2), title=words, adjustable="box")
            space.set(xlabel="", ylabel="")
            away = np.degrees(run.distance[i])
            gauge.bar(0, away, color=RED if away < 5 else GREEN)
            gauge.set(ylim=(0, 90), xlim=(-0.5, 0.5), xticks=[], title=f"{away:.0f}°")
            gauge.set(ylabel="to the nearest singular posture found [deg]")
            picture = BytesIO()
            figure.savefig(picture, dpi=80)
            clip.append(Image.open(picture))
        clip += 8 * clip[-1:]
    first, *others = clip
    whole = {"save_all": True, "append_images": others, "duration": 100, "loop": 0}
    first.save(FOLDER / "reach.webp", quality=40, method=6, **whole)


def catch() -> None:
    """A clip: chaser7 catches a box that tumbles."""
    start = sa.load("chaser7").at([0, 0.6, 0, 1.2, 0, 0.8, 0])
    debris = sa.Target(
        sa.Bus(60, size=(0.6, 0.6, 0.8), name="debris"),
        sa.pose((5.0, 0.25, -0.75), (0.1, 0.2, 0)),
        twist=(0, 0.002, 0, 0.02, 0.03, 0.02),
        grapples={"side": sa.pose((-0.35, 0, 0), (0, np.pi / 2, 0))},
    )
    viewer = sa.view(sa.catch(start, debris, window=(10, 30), wanted=1), open=False)
    for layer in ("virtual manipulator", "ellipsoid", "goal", "grid"):
        viewer.layer(layer, False)
    with TemporaryDirectory() as folder:
        archive = viewer.frames(Path(folder) / "catch.zip", (480, 320), per_second=3.0)
        with ZipFile(archive) as file:
            first, *others = [Image.open(BytesIO(file.read(name))) for name in file.namelist()]
    whole = {"save_all": True, "append_images": others, "duration": 100, "loop": 0}
    first.save(FOLDER / "catch.webp", quality=40, method=6, **whole)


PICTURES = (
    singular_posture, distance, closed_loop, map_planar2, workspace_planar2, simulation_planar2,
    figure_7, plan_planar2, view, construction, payload, catch, reach,
)  # fmt: skip

if __name__ == "__main__":
    wanted = sys.argv[1:] or [draw.__name__ for draw in PICTURES]
    if unknown := set(wanted) - {draw.__name__ for draw in PICTURES}:
        sys.exit(f"no picture {', '.join(unknown)}; see {__file__}")
    for draw in PICTURES:
        if draw.__name__ in wanted:
            with style():
                figure = draw()
                if figure is not None:  # the view and the clips write their own
                    figure.savefig(FOLDER / f"{draw.__name__}.png", dpi=110)
