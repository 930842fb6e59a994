"""Workspaces, risk profiles, designs and bands: figure 7 of Papadopoulos & Dubowsky (1993)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.patches import Annulus, Circle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from spacearm.arrays import Array, ArrayLike, finite, shape_of
from spacearm.errors import ConfigurationError
from spacearm.mechanics.batch import tips_from_centre
from spacearm.plots import style
from spacearm.signatures import shown
from spacearm.singularities.risk import PoseRisk, RiskProfile, nearness

if TYPE_CHECKING:
    from spacearm.uncertainty.identification import Identified
    from spacearm.uncertainty.robust import DistanceRange, ShellBands
    from spacearm.workspaces.path_dependent import Workspace

#: Axes of risks.
BY_DISTANCE: Any = {
    "xlabel": "distance of the tip from the system CM [m]",
    "ylabel": "configurations near a singularity [%]",
    "ylim": (0.0, None),
}


@style.draws()
def draw_workspace(
    result: Workspace,
    ax: Any,
    *,
    path: ArrayLike | None = None,
    profile: RiskProfile | None = None,
) -> Any:
    """Draw a workspace: for planar arms figure 7 of Papadopoulos & Dubowsky (1993).

    Args:
        result: The workspace.
        path: (m, 2) or (m, 3) a tip path from the system CM to draw over a planar one [m].
        profile: A risk profile to draw beside the shells of a spatial arm.
        ax: Matplotlib axes to draw into, three-dimensional ones for a spatial arm, and others
            for a profile; or a figure or subfigure; None for a new figure.

    Raises:
        ConfigurationError: `ax` is of the wrong kind, or `path` is no path.
    """
    if result.planar:
        axes = style.axes_for(ax, 7.2, 6.4)
        _draw_rings(axes, result, None if path is None else _points(path))
        return axes
    if profile is None:
        axes = style.axes_for(ax, 6.4, 5.4, spatial=True)
        _draw_cut_away(axes, result)
        return axes

    def parts(whole: Any) -> list[Any]:
        return [whole.add_subplot(1, 2, 1, projection="3d"), whole.add_subplot(1, 2, 2)]

    _, (space, beside) = style.panels_for(ax, parts, 11.0, 5.4)
    _draw_cut_away(space, result)
    draw_profile(profile, beside)
    return space


@style.draws(size=(7.2, 4.4))
def draw_profile(result: RiskProfile, axes: Any) -> None:
    """Draw the share of configurations near a singularity over the distance from the CM.

    Args:
        result: The risk profile.
        axes: Where it is drawn.
    """
    share, error = 100.0 * result.share, 100.0 * result.error
    axes.fill_between(
        result.radius, share - 2 * error, share + 2 * error, color=style.RED, alpha=0.25
    )
    axes.plot(result.radius, share, color=style.RED, lw=2)
    axes.set(**BY_DISTANCE)
    style.entitle(axes, f"postures {nearness(result)}")


@style.draws(size=(7.2, 4.4))
def draw_pose_risk(result: PoseRisk, axes: Any) -> None:
    """Draw the share of near-singular configurations of each pose over its distance from the CM.

    Args:
        result: The risk of sampled tip poses.
        axes: Where it is drawn.
    """
    mean = float(result.share.mean())
    axes.plot(
        np.linalg.norm(result.centre, axis=1), 100.0 * result.share, "o", color=style.RED, alpha=0.6
    )
    axes.axhline(100.0 * mean, color=style.GREY, lw=1, ls=":")
    axes.set(**BY_DISTANCE)
    style.entitle(axes, f"{len(result.share)} tip poses, {nearness(result)}\nmean {mean:.1%}")


def _points(path: ArrayLike) -> Array:
    """Return the points (m, 2) or (m, 3) of a path, checked."""
    shape = shape_of(path)
    if len(shape) != 2 or shape[0] == 0 or shape[1] not in (2, 3):
        raise ConfigurationError(f"path is {shown(path)}; give points [m], 2 or 3 numbers in a row")
    return finite(path, shape, "path", "[m]")


def _draw_rings(axes: Any, result: Workspace, path: Array | None) -> None:
    outer = float(result.reachable[0, 1])
    axes.add_patch(Circle((0, 0), outer, facecolor="none", edgecolor=style.GREY, lw=1.5))
    regions = (
        ("path independent", result.piw, style.GREEN),
        ("path dependent", result.pdw, style.ORANGE),
    )
    for label, radii, color in regions:
        for low, high in radii:
            draw_ring(axes, (0.0, 0.0), low, high, 1e-3 * outer, facecolor=color, alpha=0.45)
        if len(radii):
            low, high = radii[np.argmax(radii[:, 1] - radii[:, 0])]
            at = 0.5 * (low + high)
            if high - low > 0.15 * outer:
                axes.text(0, at, label, ha="center", va="center", fontweight="bold")
            else:
                style.annotate(axes, label, np.array([0.0, at]), "black")
    ends = np.unique(np.concatenate([result.reachable.ravel(), result.pdw.ravel()]).round(9))
    ends = ends[ends > 0]
    for R, angle in zip(ends, np.radians(np.linspace(-15, -75, len(ends))), strict=True):
        towards = np.array([np.cos(angle), np.sin(angle)])
        axes.annotate(
            f"{R:.4g}", R * towards, 1.15 * outer * towards, va="center", ha="center",
            arrowprops={"arrowstyle": "-", "color": style.GREY, "lw": 0.8},
        )  # fmt: skip
    if path is not None:
        rows = [i for i in range(3) if i != result.arm.tree.plane_normal()]
        x, y = path.T if path.shape[1] == 2 else path[:, rows].T
        axes.plot(x, y, color=style.BLUE, lw=2)
        axes.plot(x[0], y[0], "o", color=style.BLUE)
        style.annotate(axes, "tip path", np.array([x[0], y[0]]), style.BLUE)
    _about_cm(axes, 1.3 * outer)
    style.entitle(axes, _title(result))


def draw_ring(
    axes: Any, centre: tuple[float, float], low: float, high: float, least: float, **look: Any
) -> None:
    """Draw the ring between two radii; one that is narrower than `least` gets this width."""
    width = max(high - low, least)
    ring = Annulus(centre, high, width) if width < high else Circle(centre, high)
    ring.set(**look)
    axes.add_patch(ring)


def _about_cm(axes: Any, reach: float) -> None:
    """Mark the system CM in the middle of axes that reach so far."""
    axes.plot(0, 0, marker="P", color="black", ms=9)
    where, span = "from the system CM [m]", (-reach, reach)
    axes.set(xlim=span, ylim=span, aspect="equal", xlabel=where, ylabel=where)


def _draw_cut_away(axes: Any, result: Workspace) -> None:
    """Draw spheres with a quarter cut out; the cut faces show the workspaces.

    On a cut face the tip along the curves that prove the distances.
    """
    outer = float(result.reachable[0, 1])
    polar, around = np.linspace(0, np.pi, 40), np.linspace(0, 1.5 * np.pi, 60)
    sphere = np.stack((
        np.outer(np.sin(polar), np.cos(around)),
        np.outer(np.sin(polar), np.sin(around)),
        np.outer(np.cos(polar), np.ones_like(around)),
    ))  # fmt: skip
    color = style.ORANGE if len(result.pdw) and result.pdw[-1, 1] >= outer - 1e-9 else style.GREEN
    axes.plot_surface(*(outer * sphere), color=color, alpha=0.25, linewidth=0)
    for i, curve in enumerate(result.proof):
        x, y, z = tips_from_centre(result.arm, curve, result.mode).T
        out = np.hypot(x, y)  # turned about z, to a cut face
        label = "tip on singular curves" if i == 0 else None
        axes.plot(
            out, np.full_like(z, -0.01 * outer), z, color=style.BLUE, lw=1.8, zorder=9, label=label
        )
    if result.proof:
        axes.legend(loc="upper left")
    for label, radii, color in (
        ("path independent", result.piw, style.GREEN), ("path dependent", result.pdw, style.ORANGE)
    ):  # fmt: skip
        for low, high in radii:
            arc = np.stack((np.sin(polar), np.cos(polar)))
            ring = np.concatenate((high * arc, low * arc[:, ::-1]), axis=1)
            for face in ([ring[0], 0 * ring[0], ring[1]], [0 * ring[0], -ring[0], ring[1]]):
                axes.add_collection3d(Poly3DCollection([np.array(face).T], color=color, alpha=0.8))
        if len(radii):
            low, high = radii[-1]
            axes.text(0.55 * (low + high), 0, 0, label, zorder=10)
    span = (-outer, outer)
    axes.set(xlim=span, ylim=span, zlim=span, xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(elev=22, azim=-45)
    style.entitle(axes, _title(result))


def _title(result: Workspace) -> str:
    share = f"{result.fraction:.1%} path independent"
    return f"{result.arm.name}, {result.mode}: {share} ({result.kind})"


@style.draws(size=(7.2, 4.2))
def draw_distance_range(result: DistanceRange, axes: Any) -> None:
    """Draw how the distances of all arms tried are spread.

    Args:
        result: The range.
        axes: Where it is drawn.
    """
    axes.hist(np.degrees(result.distances), bins=30, color=style.BLUE, alpha=0.6)
    axes.axvline(np.degrees(result.nominal), color=style.RED, label="as described")
    axes.set(xlabel="distance of the singular posture found [°]", ylabel="arms")
    axes.legend(frameon=False)
    low, high = np.degrees((result.low, result.high))
    style.entitle(axes, f"{result.tried} arms: {low:.4g}° to {high:.4g}°")


@style.draws(size=(6.6, 6.2))
def draw_shell_bands(result: ShellBands, axes: Any) -> None:
    """Draw where the workspace is path dependent for all arms tried, and for some.

    Args:
        result: The bands.
        axes: Where it is drawn.
    """
    outer = float(result.sometimes.max(initial=0.0)) or 1.0
    for ranges, color, label in (
        (result.sometimes, style.GREY, "path dependent for some"),
        (result.always, style.ORANGE, "path dependent for all"),
    ):
        for i, (low, high) in enumerate(ranges):
            look = {"facecolor": color, "alpha": 0.55, "label": label if i == 0 else None}
            draw_ring(axes, (0.0, 0.0), low, high, 1e-3 * outer, **look)
    _about_cm(axes, 1.25 * outer)
    axes.legend(frameon=False, loc="upper right")
    style.entitle(axes, f"{result.tried} arms")


@style.draws(size=(6.4, 3.6))
def draw_identified(result: Identified, axes: Any) -> None:
    """Draw the ten parameters with two standard deviations, over mass and radius of gyration.

    Args:
        result: What was identified.
        axes: Where it is drawn.
    """
    from spacearm.uncertainty.identification import NAMES  # slow to import

    size = result.sizes
    deviations = np.sqrt(result.covariance.diagonal()) / size
    moved = np.abs(result.unexcited).max(axis=0, initial=0.0) > 0.01
    for these, color, what in (
        (~moved, style.BLUE, "identified"),
        (moved, style.RED, "not excited"),
    ):
        rows = np.flatnonzero(these)
        if len(rows):
            axes.errorbar(rows, (result.parameters / size)[rows], 2.0 * deviations[rows], fmt="o",
                          color=color, capsize=4.0, label=what)  # fmt: skip
    axes.axhline(0.0, color=style.GREY, lw=0.8, zorder=0)
    axes.set_xticks(range(len(NAMES)), NAMES, rotation=45)
    axes.set(ylabel="over powers of mass and\nradius of gyration about the tip")
    style.legend_beside(axes)
    style.entitle(axes, f"held by {result.arm.name}: {result.mass:.4g} kg")
