"""Singular maps, sets and polynomials: figure 4 of Papadopoulos & Dubowsky (1993)."""

from __future__ import annotations

from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, NoSolutionError, UnsupportedError
from spacearm.model.arm import SpaceArm
from spacearm.plots import style
from spacearm.polynomial.trig import TrigPolynomial
from spacearm.results import short_names
from spacearm.singularities.abstract_set import SingularSet

if TYPE_CHECKING:
    from spacearm.closure.held_report import ClosedMap
    from spacearm.planning.result import Connection
    from spacearm.singularities.box_graph import FreeBoxes
    from spacearm.singularities.joint_boxes import FreeBox
    from spacearm.singularities.map import SingularMap

#: Distance beyond which the colours of a map do not change [deg].
FAR = 45.0
#: What the colours of a map are.
FIRST_ORDER = "joint motion to a singular posture, to first order [deg]"
#: Where the outline of a range without end is drawn, out of sight [rad].
ENDLESS = 3.0 * np.pi
#: Ends of the colours of maps on which all distances are less [deg].
SCALES = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0)
#: Bins along each joint in which samples are counted to find the joints that show structure.
BINS = 18
#: Samples drawn of an exact set, and of one whose every sample takes a search.
MOST_SAMPLED, MOST_FOUND = 4000, 200
#: Samples up to which each is drawn as a larger dot.
FEW_SAMPLES = 1000


@style.draws(size=(7.2, 6.0))
def draw_map(result: SingularMap, axes: Any, *, box: FreeBox | None = None) -> None:
    """Draw the distance to first order over two joints, with the exact curves where known.

    Figure 4 of Papadopoulos & Dubowsky (1993) for planar2.

    Args:
        result: The map.
        axes: Where it is drawn.
        box: Joint ranges in which no posture is singular, to be outlined.

    Raises:
        ConfigurationError: The joints that are held are outside the box, or it is of another arm.
    """
    degrees = np.degrees(result.angles)
    _draw_distance(axes, degrees, degrees, result.distance)
    _draw_curves(axes, result.curves or [])
    _angle_axes(axes, result.joints)
    _draw_limits(axes, np.degrees(result.joint_limits))
    if box is not None:
        _draw_ranges(axes, result, box)
    what = "distance to first order" if result.curves is None else "singular set (curves)"
    held = ", ".join(
        f"{name}\N{NO-BREAK SPACE}{np.degrees(x):.4g}" for name, x in result.held.items() if x
    )
    others = "" if all(result.held.values()) else ", others\N{NO-BREAK SPACE}0"
    where = f"\n{held}\N{NO-BREAK SPACE}deg{others}" if held else ""
    style.entitle(axes, f"{result.arm}: {what}{where}")


@style.draws(size=(7.2, 6.0))
def draw_closed_map(result: ClosedMap, axes: Any) -> None:
    """Draw how far singular postures are while what is held moves in two directions.

    Args:
        result: The map; what is white does not close.
        axes: Where it is drawn.
    """
    turns = [len(axis) > 1 for axis in result.axes]
    x, y = (np.degrees(m) if t else m for m, t in zip(result.moves, turns, strict=True))
    _draw_distance(axes, x, y, result.distance)
    units = ["deg" if turn else "m" for turn in turns]
    axes.set_xlabel(f"moved along {result.axes[0]} [{units[0]}]")
    axes.set_ylabel(f"moved along {result.axes[1]} [{units[1]}]")
    axes.plot(0.0, 0.0, "+", color=style.RED)
    style.entitle(axes, result.describe().headline)


def _draw_distance(axes: Any, x: Array, y: Array, distance: Array) -> None:
    """Draw distances (m, k) over two directions, in colours up to the largest one."""
    shown = np.degrees(distance.T)
    most = float(np.max(shown, initial=0.0, where=np.isfinite(shown)))
    far = next((scale for scale in SCALES if most <= scale), FAR)
    image = axes.pcolormesh(
        x, y, np.minimum(shown, far), vmin=0.0, vmax=far, cmap="cividis", rasterized=True
    )
    beyond = "max" if most > far else "neither"
    axes.figure.colorbar(image, ax=axes, label=FIRST_ORDER, shrink=0.9, extend=beyond)


@style.draws()
def draw_singular_set(result: SingularSet, ax: Any) -> Any:
    """Draw a singular set over the joints that matter to it.

    Complete sets of one dimension are drawn as curves, those of two as a surface, all others as
    samples over the two joints that show most of their structure.

    Args:
        result: The set.
        ax: Matplotlib axes to draw into, three-dimensional ones for a surface; None for a new
            figure.

    Raises:
        UnsupportedError: The set is empty or the whole joint space.
    """
    arm, what = result.arm, "singular set"
    relevant = result.relevant if result.complete else ()
    if result.complete and (not relevant or _rootless(result)):
        raise UnsupportedError(
            f"{arm.name}, {result.mode}: no joint decides whether the arm is singular; there is "
            "nothing to draw"
        )
    names = [arm.joint_names[j] for j in relevant]
    if not result.complete:
        samples = result.sample(MOST_FOUND, np.random.default_rng(0))
        axes = _draw_samples(arm, samples, ax)
        what = f"{len(samples)} singular configurations found"
    elif result.dimension == 2 and len(relevant) == 3:
        axes = style.axes_for(ax, 6.8, 6.0, spatial=True)
        _draw_surface(axes, result)
        _angle_axes(axes, names)
    elif result.dimension == 1:
        axes = style.axes_for(ax, 6.4, 6.0, spatial=len(relevant) == 3)
        _draw_curves(axes, [curve[:, relevant] for curve in result.curves()])
        _angle_axes(axes, names)
    else:
        axes = _draw_samples(arm, result.sample(MOST_SAMPLED, np.random.default_rng(0)), ax)
    style.entitle(axes, f"{arm.name}, {result.mode}: {what}")
    return axes


def _rootless(result: SingularSet) -> bool:
    """Return whether no line of many meets the set."""
    try:
        result.sample(1, np.random.default_rng(0))
    except NoSolutionError:
        return True
    return False


def _draw_curves(axes: Any, curves: list[Array]) -> None:
    for curve in curves:
        axes.plot(*_on_screen(np.degrees(curve)).T, color=style.RED, lw=2.0)


def _draw_limits(axes: Any, limits: Array) -> None:
    """Hatch what lies outside the limits (2, 2) of both joints [deg]."""
    look = {"facecolor": "none", "edgecolor": "white", "hatch": "///", "lw": 0.0}
    label = "outside the joint limits"
    for span, (low, high) in zip((axes.axvspan, axes.axhspan), limits, strict=True):
        for first, last in ((-180.0, max(low, -180.0)), (min(high, 180.0), 180.0)):
            if last > first:
                span(first, last, **look, label=label)
                label = "_the same"
    if label == "_the same":
        axes.legend(loc="upper right", facecolor=style.GREY, labelcolor="white", framealpha=0.9)


def _draw_ranges(axes: Any, result: SingularMap, box: FreeBox) -> None:
    """Outline the ranges of both joints of a map, also whole turns away."""
    if box.arm.name != result.arm:
        raise ConfigurationError(f"box is of {box.arm.name}, the map of {result.arm}")
    outside = [name for name, x in result.held.items()
               if not box.ranges[name][0] <= x <= box.ranges[name][1]]  # fmt: skip
    if outside:
        raise ConfigurationError(
            f"the map holds {', '.join(outside)} outside the box; draw one with q in it"
        )
    (left, right), (low, high) = (np.degrees(np.clip(box.ranges[name], -ENDLESS, ENDLESS))
                                  for name in result.joints)  # fmt: skip
    label = "no singular posture, proven"
    for x, y in product((0.0, -360.0, 360.0), repeat=2):
        axes.add_patch(
            Rectangle((left + x, low + y), right - left, high - low, fill=False, lw=2.5,
                      edgecolor=style.GREEN, label=label)
        )  # fmt: skip
        label = "_the same"
    axes.legend(loc="upper right", facecolor=style.GREY, labelcolor="white", framealpha=0.9)


def _draw_surface(axes: Any, result: SingularSet) -> None:
    mesh = result.surface()
    corners = np.degrees(mesh.vertices)[mesh.triangles]
    across = (np.ptp(corners, axis=1) > 180.0).any(axis=1)
    axes.add_collection3d(
        Poly3DCollection(corners[~across], facecolors=style.RED, alpha=0.6, shade=True, lw=0)
    )
    axes.set_box_aspect((1, 1, 1))


def _draw_samples(arm: SpaceArm, samples: Array, ax: Any) -> Any:
    """Draw samples over two joints, or a histogram over the only joint of an arm."""
    axes = style.axes_for(ax, 6.4, 6.0)
    shown = samples * np.where(arm.slides, 1.0, 180.0 / np.pi)
    labels = _joint_labels(arm)
    if arm.n == 1:
        axes.hist(shown[:, 0], bins=BINS**2, color=style.RED)
        axes.set(xlabel=labels[0], ylabel="samples")
        return axes
    i, j = max(combinations(range(arm.n), 2), key=lambda pair: _structure(shown[:, pair]))
    size = 3.0 if len(samples) > FEW_SAMPLES else 7.0
    axes.plot(shown[:, i], shown[:, j], ".", color=style.RED, ms=size, alpha=0.6, clip_on=False)
    if not arm.slides[[i, j]].any():
        _angle_axes(axes, (arm.joint_names[i], arm.joint_names[j]))
    axes.set(xlabel=labels[i], ylabel=labels[j])
    return axes


def _joint_labels(arm: SpaceArm) -> list[str]:
    """Return the labels of axes of joints, with units."""
    joints = zip(short_names(arm.joint_names), arm.slides, strict=True)
    return [f"{name} [{'m' if slides else 'deg'}]" for name, slides in joints]


def _structure(points: Array) -> float:
    """Return how far (m, 2) samples are from uniform: the sum of squared counts of their bins."""
    return float(np.square(np.histogramdd(points, BINS)[0]).sum())


def _angle_axes(axes: Any, names: Any) -> None:
    """Set all axes to one turn, in degrees, with the names of their joints."""
    turn = range(-180, 181, 60) if len(names) == 2 else range(-120, 121, 60)
    for axis, name in zip("xyz", short_names(names), strict=False):
        axes.set(
            **{f"{axis}lim": (-180, 180), f"{axis}ticks": turn, f"{axis}label": f"{name} [deg]"}
        )
    if len(names) == 2:
        axes.set(aspect="equal")


def _on_screen(curve: Array) -> Array:
    """Fold a curve on the torus into -180 .. 180, broken where it leaves the screen."""
    folded = 180.0 - (180.0 - curve) % 360.0
    jumps = np.flatnonzero(np.abs(np.diff(folded, axis=0)).max(axis=1) > 180.0) + 1
    return np.insert(folded, jumps, np.nan, axis=0)


#: Values along each angle.
POINTS = 361


@style.draws()
def draw_polynomial(result: TrigPolynomial, ax: Any) -> Any:
    """Draw a polynomial of one or two angles with its zeros, one of more by its coefficients.

    The order of a coefficient c_k is |k_1| + ... + |k_n|.

    Args:
        result: The polynomial.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    axes = style.axes_for(ax, 7.2, 4.4 if result.n != 2 else 6.0)
    draw = {1: _draw_curve, 2: _draw_map}.get(result.n, _draw_coefficients)
    draw(axes, result)
    style.entitle(axes, f"Trigonometric polynomial of degrees {result.degrees}")
    return axes


def _draw_curve(axes: Any, S: TrigPolynomial) -> None:
    q = np.linspace(-np.pi, np.pi, POINTS)
    axes.axhline(0.0, color=style.GREY, lw=0.8)
    axes.plot(np.degrees(q), S(q[:, None]), color=style.BLUE, lw=2)
    roots = S.roots(np.zeros(1), 0).angles
    axes.plot(np.degrees(roots), np.zeros(len(roots)), "o", color=style.RED)
    axes.set(xlim=(-180, 180), xticks=range(-180, 181, 60), xlabel="q1 [deg]", ylabel="value")


def _draw_map(axes: Any, S: TrigPolynomial) -> None:
    q = np.linspace(-np.pi, np.pi, POINTS)
    grid = np.stack(np.meshgrid(q, q, indexing="ij"), axis=-1)
    values = S(grid.reshape(-1, 2)).reshape(POINTS, POINTS).T
    degrees, most = np.degrees(q), float(np.abs(values).max()) or 1.0
    image = axes.pcolormesh(
        degrees, degrees, values, cmap="RdBu_r", vmin=-most, vmax=most, rasterized=True
    )
    axes.figure.colorbar(image, ax=axes, label="value; zero on the black lines", shrink=0.9)
    if values.min() < 0.0 < values.max():
        axes.contour(degrees, degrees, values, levels=[0.0], colors="black", linewidths=1.5)
    turn = range(-180, 181, 60)
    axes.set(xlabel="q1 [deg]", ylabel="q2 [deg]", xticks=turn, yticks=turn, aspect="equal")


def _draw_coefficients(axes: Any, S: TrigPolynomial) -> None:
    sizes = np.abs(S.coefficients)
    order = sum(
        np.abs(index - degree)
        for index, degree in zip(np.indices(sizes.shape), S.degrees, strict=True)
    )
    kept = sizes > np.finfo(np.float64).eps * max(S.scale, 1e-300)
    axes.semilogy(
        np.broadcast_to(order, sizes.shape)[kept], sizes[kept], "o", color=style.BLUE, alpha=0.4
    )
    axes.set(xlabel="order of the coefficient", ylabel="size of the coefficient")
    axes.xaxis.get_major_locator().set_params(integer=True)
    style.write_powers(axes.yaxis)


@style.draws()
def draw_free_box(result: FreeBox, ax: Any) -> Any:
    """Draw the range of each joint that is proven free, in its limits or in one turn.

    Args:
        result: The box.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    arm = result.arm
    axes = style.axes_for(ax, 7.2, 1.2 + 0.45 * arm.n)
    scale = np.where(arm.slides, 1.0, 180.0 / np.pi)
    wide = np.where(arm.slides, 1.0, np.pi)
    for j in range(arm.n):
        left = arm.lower[j] if np.isfinite(arm.lower[j]) else -wide[j]
        right = arm.upper[j] if np.isfinite(arm.upper[j]) else wide[j]
        low, high = np.clip((result.lower[j], result.upper[j]), left, right) * scale[j]
        left, right = left * scale[j], right * scale[j]
        axes.barh(j, right - left, left=left, height=0.5, color=style.GREY, alpha=0.25)
        axes.barh(j, high - low, left=low, height=0.5, color=style.GREEN)
    axes.set_yticks(range(arm.n), short_names(arm.joint_names))
    axes.invert_yaxis()
    axes.set(xlabel="joint position [°] or [m]")
    style.entitle(
        axes, f"{arm.name}, {result.mode}: no singular posture in the green ranges, proven"
    )
    return axes


@style.draws(size=(7.2, 5.2))
def draw_free_boxes(result: FreeBoxes, axes: Any) -> None:
    """Draw the boxes over two joints; of more joints the share that the largest of them cover.

    Args:
        result: The boxes.
        axes: Where it is drawn.
    """
    arm = result.arm
    covered = 100.0 * np.cumsum(np.sort(result.volumes)[::-1])
    if arm.n == 2:
        scale = np.where(arm.slides, 1.0, 180.0 / np.pi)
        for low, high in zip(scale * result.lower, scale * result.upper, strict=True):
            axes.add_patch(
                Rectangle(low, *(high - low), facecolor=style.GREEN, edgecolor="white", lw=0.3)
            )
        axes.autoscale_view()
        labels = _joint_labels(arm)
        axes.set(xlabel=labels[0], ylabel=labels[1])
    else:
        axes.plot(np.arange(1, len(covered) + 1), covered, color=style.GREEN, lw=2)
        axes.set(xlabel="largest boxes", ylabel="share of the range covered [%]")
    whole = covered[-1] if len(covered) else 0.0
    style.entitle(
        axes,
        f"{arm.name}, {result.mode}: {len(covered):,} boxes without singular posture, proven\n"
        f"{whole:.3g} % of the range",
    )


@style.draws(size=(7.2, 4.6))
def draw_connection(result: Connection, axes: Any) -> None:
    """Draw the joints along the path that connects both postures.

    Args:
        result: The connection.
        axes: Where it is drawn.
    """
    scale = np.where(result.arm.slides, 1.0, 180.0 / np.pi)
    if len(result.path):
        way = np.append(0.0, np.linalg.norm(np.diff(result.path, axis=0), axis=1).cumsum())
        path = scale * result.path
        style.draw_curves(axes, way, path, short_names(result.arm.joint_names), marker="o")
        axes.legend(frameon=False)
    axes.set(xlabel="length of the joint path [rad] or [m]", ylabel="joint position [°] or [m]")
    style.entitle(axes, f"{result.arm.name}, connected without singularity: {result.answer}")
