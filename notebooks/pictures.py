"""Draws the pictures of README.md anew.

    python notebooks/pictures.py

Needs `pip install -e '.[test]'` and chromium.
.
"""

from __future__ import annotations

from pathlib import Path
from shutil import which

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin
from matplotlib.patches import Polygon
from playwright.sync_api import sync_playwright

import spacearm as sa
from spacearm.plot import draw_map, draw_workspace, style
from spacearm.plot_motion import draw_motion

FOLDER = Path(__file__).parent / "pictures"
BLUE, RED, GREY, GOLD = "#0072b2", "#d55e00", "#5b6470", "#d9b25f"  # Okabe and Ito: safe for all


def draw_planar2(axes: plt.Axes, cfg: sa.Configuration, label: str) -> None:
    """The posture, the velocities that unit joint rates give to the tip, and what is lost."""
    report = sa.singularity(cfg)
    T = cfg.base.homogeneous
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    axes.add_patch(
        Polygon(corners @ T[:2, :2].T + T[:2, 3], facecolor=GOLD, edgecolor=GREY, alpha=0.9)
    )
    elbows = [cfg.base.act(np.array([0.5, 0.0, 0.0]))]
    elbows.append(cfg.arm.replace(tip="link_2").at(cfg.q, cfg.base).tip.translation)
    elbows.append(cfg.tip.translation)
    joints = np.array(elbows)[:, :2]
    axes.plot(*joints.T, "-o", color=GREY, lw=5, ms=9, mfc="white", mec=GREY)
    axes.plot(*cfg.com[:2], marker="P", ms=9, color="black", ls="none")
    axes.annotate("system CM", cfg.com[:2], (0, -18), textcoords="offset points", ha="center")
    tip, scale = joints[-1], 0.75
    circle = np.array([np.cos(t := np.linspace(0, 2 * np.pi, 200)), np.sin(t)])
    ellipse = tip[:, None] + scale * report.jacobian @ circle
    axes.plot(*ellipse, color=BLUE, lw=2)
    if report.lost.size:
        for sign in (1, -1):
            axes.annotate(
                "",
                tip + sign * 0.8 * report.lost[:, 0],
                tip,
                arrowprops={"arrowstyle": "-|>", "color": RED, "lw": 2.5},
            )
        low = min((tip + sign * 0.85 * report.lost[:, 0] for sign in (1, -1)), key=lambda p: p[1])
        axes.text(*low, "no motion\nthis way", color=RED, va="top", ha="center")
    axes.set_title(label, loc="left", fontsize=11)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")


def singular_posture() -> None:
    """Figure 3 of the paper beside a posture a few degrees of arc away, and where both lie."""
    arm = sa.load("planar2")
    attitude = pin.SE3(pin.utils.rotate("z", np.radians(40)), np.zeros(3))
    singular, regular = np.radians([-65, -11.41]), np.radians([-65, -75])
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 4.6), layout="constrained")
    draw_planar2(left, arm.at(regular, attitude), "Regular: the tip moves every way")
    draw_planar2(middle, arm.at(singular, attitude), "Dynamic singularity: one way is lost")
    left.set_ylabel("y [m]")
    for axes in (left, middle):
        axes.set(xlim=(-0.9, 3.1), ylim=(-1.9, 1.5))
    left.text(1.15, -1.78, "tip velocities for unit joint rates", color=BLUE, ha="center")

    grid = np.radians(np.linspace(-180, 180, 181))
    sigma = np.array([
        [sa.singularity(arm.at([q1, q2])).sigma_min for q1 in grid] for q2 in grid
    ])  # fmt: skip
    degrees = np.degrees(grid)
    image = right.pcolormesh(
        degrees, degrees, np.log10(sigma.clip(1e-3)), cmap="cividis", rasterized=True
    )
    figure.colorbar(image, ax=right, shrink=0.8, label="log10 of sigma_min [m/rad]")
    for q, name, color in ((singular, "singular", RED), (regular, "regular", BLUE)):
        right.plot(*np.degrees(q), "o", color=color, ms=8, mec="white")
        right.annotate(name, np.degrees(q), (8, 6), textcoords="offset points", color="white")
    right.set(xlabel="q1 [deg]", ylabel="q2 [deg]", aspect="equal")
    right.set_title("Where: the dark valleys in joint space", loc="left", fontsize=11)
    right.set_xticks(range(-180, 181, 90))
    right.set_yticks(range(-180, 181, 90))
    figure.savefig(FOLDER / "singular_posture.png", dpi=110)


def browser_view() -> None:
    """The page of `spacearm view planar2 --deg -65 -11.41 --attitude 0 0 40`."""
    attitude = pin.SE3(pin.utils.rotate("z", np.radians(40)), np.zeros(3))
    viewer = sa.view(sa.load("planar2"), np.radians([-65, -11.41]), base=attitude, open=False)
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


def simulation() -> None:
    """Figures 5 and 6: the transposed Jacobian law meets a singularity and never arrives."""
    arm, q = sa.load("planar2"), np.radians([-57.936, 60.337])
    base = arm.at(q, pin.SE3(pin.utils.rotate("z", np.radians(21)), np.zeros(3)))
    law = sa.TransposedJacobian(target=(1.5, 1.5), kp=5, kd=15)
    run = sa.simulate(arm, q, law, 200.0, base=base.centred(np.zeros(3)).base)
    run.plot((1.5, 1.5)).savefig(FOLDER / "simulation_planar2.png", dpi=110)


def figure_7() -> None:
    """To C, nine times round a square, then to the target."""
    arm, q, C = sa.load("planar2"), np.radians([-57.936, 60.337]), np.array([1.0, 0.0])
    start = arm.at(q, pin.SE3(pin.utils.rotate("z", np.radians(20.94)), np.zeros(3)))
    square = [C + 0.2 * np.array(p) for p in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    path = [C, *(9 * square), square[0], C, (1.5, 1.5)]
    base = start.centred(np.zeros(3)).base
    run = sa.follow(arm, q, path, base=base, limits=False)
    figure = draw_workspace(sa.workspace(arm), run.tip[:, :2])
    figure.savefig(FOLDER / "figure_7.png", dpi=110)


def plan() -> None:
    """The open problem: from the start of figure 5 to its target, and arrive."""
    arm, q = sa.load("planar2"), np.radians([-57.936, 60.337])
    start = arm.at(q, pin.SE3(pin.utils.rotate("z", np.radians(21)), np.zeros(3)))
    found = sa.plan(arm, q, (1.5, 1.5), base=start.centred(np.zeros(3)).base)
    figure = draw_motion(found, np.array([1.5, 1.5]), sa.workspace(arm))
    figure.savefig(FOLDER / "plan_planar2.png", dpi=110)


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    singular_posture()
    browser_view()
    simulation()
    figure_7()
    plan()
    with style():
        draw_map(sa.singular_map(sa.load("planar2"))).savefig(FOLDER / "map_planar2.png")
        figure = draw_workspace(sa.workspace(sa.load("planar2")))
        figure.savefig(FOLDER / "workspace_planar2.png", dpi=110)
