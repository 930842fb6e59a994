"""Feasible attitudes, level reach, reactions, wheels, momentum budgets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.patches import Wedge

from spacearm.arrays import Array
from spacearm.plots import style
from spacearm.results import short_names

if TYPE_CHECKING:
    from spacearm.mission.attitudes import FeasibleAttitudes
    from spacearm.mission.budget import MomentumBudget
    from spacearm.mission.catch_report import Catch
    from spacearm.mission.dispersions import CatchRuns
    from spacearm.mission.level import LevelEnvelope, LevelReach
    from spacearm.mission.reactions import Reaction, WheelSizing


@style.draws()
def draw_attitudes(result: FeasibleAttitudes, ax: Any) -> Any:
    """Draw the feasible attitudes: a ring of a planar arm, a map of directions of others.

    The map shows the direction of the spacecraft's z axis, equal areas as such, and at each the
    share of feasible rolls about it.

    Args:
        result: The attitudes.
        ax: Matplotlib axes to draw into; None for a new figure.
    """
    if result.intervals is not None:
        axes = style.axes_for(ax, 6.4, 6.0)
        _draw_ring(axes, result, result.intervals)
    else:
        axes = style.axes_for(ax, 8.4, 5.0)
        _draw_directions(axes, result)
    return axes


@style.draws(size=(8.0, 7.2), panels=lambda whole: whole.subplots(3, 1, sharex=True))
def draw_catch(result: Catch, panels: Any) -> None:
    """Draw over time how near the grapple frame and the singular set are, and the joint rates.

    Args:
        result: The catch.
        panels: Where it is drawn.
    """
    gap, clear, rates = panels
    way, target, brake = result.approach, result.target, result.brake
    tips = np.array([[tip.translation for tip in cfg.tips] for cfg in way])
    frames = [[target.at(t, frame).pose.translation for frame in result.frames.values()]
              for t in way.t.tolist()]  # fmt: skip
    style.draw_curves(gap, way.t, np.linalg.norm(tips - frames, axis=2), tuple(result.frames))
    if len(result.frames) > 1:
        style.legend_beside(gap)
    gap.set(ylabel="tip to grapple\nframe [m]", ylim=(0.0, None))
    grasped = getattr(result, "grasped", {})  # by several hands
    how = "to first order" if grasped else "found"
    clear.plot(way.t, np.degrees(way.distance), color=style.GREEN, label=how)
    if result.distance_proven:
        clear.axhline(np.degrees(result.distance_proven), color=style.GREY, ls=":", label="proven")
    clear.set(ylabel="to the nearest singular\nposture [°]", ylim=(0.0, None))
    style.legend_beside(clear)
    begin, standing = result.begin, result.begin + result.plan.t[-1]
    t = np.concatenate(
        (result.begin + result.plan.t, standing + result.chase.t, result.t + brake.t)
    )
    all_rates = np.degrees(np.concatenate((result.plan.dq, result.chase.dq, brake.dq)))
    style.draw_curves(rates, t, all_rates, short_names(way.arm.joint_names))
    style.legend_beside(rates)
    slides = "°/s, m/s" if way.arm.slides.any() else "°/s"
    rates.set(xlabel="time [s]", ylabel=f"joint rates [{slides}]")
    for panel in panels:
        for when in {begin, standing, *grasped.values(), result.t}:
            panel.axvline(when, color=style.GREY, lw=0.8, ls="--", zorder=0)
    style.entitle(
        gap,
        f"{way.arm.name} catches {target.name}: moves at {begin:.3g} s, at the stand-off at "
        f"{standing:.3g} s, contact at {result.t:.4g} s",
    )


@style.draws(size=(6.8, 4.2))
def draw_catch_runs(result: CatchRuns, axes: Any) -> None:
    """Draw how the errors at contact are distributed, over what the envelope allows.

    Args:
        result: The runs.
        axes: Where it is drawn.
    """
    shares = np.linspace(0.0, 100.0, len(result.caught))
    words = {"place": "place", "turn": "angle", "velocity": "velocity", "rate": "angular velocity"}
    for name, color in zip(words, style.COLOURS, strict=False):
        off = np.sort(getattr(result, name)) / getattr(result.envelope, name)
        axes.plot(off, shares, color=color, label=words[name])
    axes.axvline(1.0, color=style.GREY, ls="--", label="envelope")
    axes.set(xlabel="at contact, over the envelope", ylabel="runs [%]", xlim=(0.0, None))
    style.legend_beside(axes)
    style.entitle(axes, f"{result.catch.arm.name}: {result.share:.1%} of {len(shares)} runs caught")


@style.draws(size=(8.0, 8.4), panels=lambda whole: whole.subplots(4, 1, sharex=True))
def draw_reaction(result: Reaction, panels: Any) -> None:
    """Draw over time the rotation of a free-floating base, and the loads of attitude control.

    Args:
        result: The reaction.
        panels: Where it is drawn.
    """
    turns, wheels, torque, camera = panels
    turned = np.degrees(result.excursion)
    for axes, along in ((turns, turned), (wheels, result.wheels), (torque, result.torque)):
        style.draw_curves(axes, result.t, along, "xyz")
    turns.plot(result.t, np.degrees(result.angle), color=style.GREY, ls="--", label="angle")
    if result.wheel_torque.size:
        simulated = np.degrees(result.simulated_angle)
        turns.plot(result.t, simulated, color=style.RED, label="angle as simulated")
    style.legend_beside(turns)
    camera.plot(result.t, np.degrees(result.smear), color=style.RED)
    turns.set_ylabel("rotation,\nfree-floating [°]")
    wheels.set_ylabel("wheel momentum,\ncontrolled [N m s]")
    torque.set_ylabel("torque,\ncontrolled [N m]")
    camera.set(xlabel="time [s]", ylabel="line of sight,\nfree-floating [°/s]")
    what = "any line of sight" if result.camera is None else "the line of sight"
    rotated, pointed = (np.degrees(x.max()) for x in (result.angle, result.pointing))
    style.entitle(
        turns,
        f"{result.arm.name}, free-floating: base by up to {rotated:.3g}°, {what} by {pointed:.3g}°",
    )


@style.draws(size=(7.2, 4.6))
def draw_wheel_sizing(result: WheelSizing, axes: Any) -> None:
    """Draw which share of the cases a momentum of the wheels covers.

    Args:
        result: The sizing.
        axes: Where it is drawn.
    """
    share = 100.0 * (np.arange(len(result.momentum)) + 1.0) / len(result.momentum)
    for name, along, color, width in zip(
        ("any axis", *"xyz"), (result.momentum, *result.axes.T), (style.GREY, *style.COLOURS),
        (2.0, 1.5, 1.5, 1.5), strict=False,
    ):  # fmt: skip
        reached = np.sort(along)
        axes.plot(np.append(reached[0], reached), np.append(0.0, share), color=color, lw=width,
                  label=f"about {name}")  # fmt: skip
    axes.axvline(np.percentile(result.momentum, 99.0), color=style.RED, lw=1, ls=":")
    axes.set(xlabel="momentum of the wheels [N m s]", ylabel=f"{result.cases} covered [%]")
    axes.set_ylim(0.0, 101.0)
    axes.legend(frameon=False)
    speed = "" if result.cases == "motions" else f", tip speed {result.tip_speed:g} m/s"
    style.entitle(axes, f"{result.arm.name}{speed}: 99 % below the dotted line")


def _draw_ring(axes: Any, result: FeasibleAttitudes, intervals: Array) -> None:
    axes.add_patch(Wedge((0, 0), 1.0, 0, 360, width=0.22, facecolor="#e8ebee", edgecolor="none"))
    for low, high in np.degrees(intervals):
        axes.add_patch(Wedge((0, 0), 1.0, low, high, width=0.22, facecolor=style.GREEN))
        if high - low < 359.9:
            for end in np.radians((low, high)):
                edge = np.array([np.cos(end), np.sin(end)])
                style.annotate(axes, f"{np.degrees(end):.2f}°", edge, "black", towards=edge)
    started = result.ended != 6
    top = float(np.nanmax(result.distance, initial=0.0)) or 1.0
    radius = np.where(started, 0.72 * result.distance / top, np.nan)
    axes.plot(
        radius * np.cos(result.angle), radius * np.sin(result.angle), color=style.BLUE, lw=1.5
    )
    for angle in np.arange(-135, 181, 45):
        at = np.radians(angle)
        axes.plot([0.78 * np.cos(at), 0.76 * np.cos(at)], [0.78 * np.sin(at), 0.76 * np.sin(at)],
                  color=style.GREY)  # fmt: skip
        axes.text(0.68 * np.cos(at), 0.68 * np.sin(at), f"{angle}°", color=style.GREY, ha="center",
                  va="center", fontsize=9)  # fmt: skip
    axes.set(xlim=(-1.3, 1.3), ylim=(-1.3, 1.3), aspect="equal")
    axes.set_axis_off()
    style.entitle(
        axes,
        f"{result.arm.name}: the path can be followed from {result.share:.1%} of the attitudes\n"
        f"green: margin {np.degrees(result.margin):.3g}° kept; blue: least distance to the\n"
        f"singular set, to first order, up to {np.degrees(top):.3g}°",
        fontsize=10,
    )


def _draw_directions(axes: Any, result: FeasibleAttitudes) -> None:
    middle, share = result.by_direction
    around = np.degrees(np.arctan2(middle[:, 1], middle[:, 0]))
    shown = axes.scatter(
        around, middle[:, 2], c=100.0 * share, cmap="cividis", marker="D", vmin=0.0,
        s=90.0 * 192.0 / len(middle),
    )  # fmt: skip
    axes.figure.colorbar(shown, ax=axes, label="feasible rolls about that axis [%]")
    axes.set(
        xlim=(-180, 180), ylim=(-1.02, 1.02), xlabel="longitude of the spacecraft's z axis [°]",
        ylabel="sine of its latitude",
    )  # fmt: skip
    axes.set_xticks(range(-180, 181, 60))
    ball = "" if result.ball is None else f", a ball of {np.degrees(result.ball.radius):.3g}°"
    style.entitle(
        axes,
        f"{result.arm.name}: the path can be followed from {result.share:.1%} of the attitudes"
        f"{ball}",
    )


@style.draws(size=(6.8, 6.2), spatial=lambda result: result.axis is None)
def draw_level(result: LevelReach, axes: Any) -> None:
    """Draw where the tip can go with a level spacecraft.

    Args:
        result: The reach.
        axes: Where it is drawn.
    """
    rows = [i for i in range(3) if i != result.axis]
    ends = (result.tip + result.straight[:, None] * result.direction)[:, rows]
    cells = result.point[1:, rows]
    if result.axis is None:
        axes.scatter(*ends.T, color=style.BLUE, s=6, label="straight lines end")
    else:
        axes.fill(*ends.T, color=style.BLUE, alpha=0.35, label="straight lines")
    if len(cells):
        axes.scatter(*cells.T, color=style.ORANGE, s=10, marker="s", label="broken lines")
    axes.scatter(*result.tip[rows][:, None], color="black", marker="P", label="start")
    style.equal_axes(axes, "".join("xyz"[i] for i in rows))
    axes.legend(frameon=False, loc="upper right")
    style.entitle(
        axes,
        f"{result.arm.name}: the tip, the spacecraft turned by at most "
        f"{np.degrees(result.tilt):.3g}°\nfrom the system CM",
    )


@style.draws(size=(10.0, 4.4), panels=lambda whole: whole.subplots(1, 2))
def draw_envelope(result: LevelEnvelope, panels: Any) -> None:
    """Draw reach and turn over the mass of the bus.

    Args:
        result: The envelope.
        panels: Where it is drawn.
    """
    reach, turn = panels
    for j, tilt in enumerate(result.tilt):
        color = style.COLOURS[j % len(style.COLOURS)]
        label = f"turned by {np.degrees(tilt):.3g}°"
        reach.plot(result.base_mass, result.mean[:, j], "o-", color=color, label=label)
        reach.plot(result.base_mass, result.least[:, j], ":", color=color)
    for axes in panels:
        axes.set(xscale="log", xlabel="mass of the bus [kg]")
        axes.set_xticks(result.base_mass, [f"{mass:g}" for mass in result.base_mass])
        axes.set_xticks([], minor=True)
    reach.set(ylabel="straight lines reach [m]")
    reach.legend(frameon=False)
    turn.set(ylabel=f"turn by {result.travel:g} m of the tip [°]")
    if result.followed.any():
        for turns, look, label in (
            (result.turn, "o-", "median"), (result.largest_turn, ":", "worst"),
        ):  # fmt: skip
            turn.plot(result.base_mass, np.degrees(turns), look, color=style.BLUE, label=label)
        turn.set(yscale="log")
        style.write_powers(turn.yaxis)
        turn.legend(frameon=False)
    else:
        turn.set(xlim=reach.get_xlim(), yticks=[])
        turn.text(0.5, 0.5, "no line can be followed so far", transform=turn.transAxes, ha="center",
                  color=style.GREY)  # fmt: skip
    style.entitle(reach, f"{result.arm.name}: mean over directions, dotted the worst")


@style.draws(size=(10.0, 4.2), panels=lambda whole: whole.subplots(1, 2, sharey=True))
def draw_budget(result: MomentumBudget, panels: Any) -> None:
    """Draw the joints over time while they hold the tip, and while they hold the spacecraft.

    Args:
        result: The budget.
        panels: Where it is drawn.
    """
    for axes, run, title in (
        (panels[0], result.holding, f"tip held for {result.holds:.4g} s: {result.ended}"),
        (
            panels[1],
            result.carrying,
            f"spacecraft at rest for at least {result.carries:.4g} s: {result.carrying_ended}",
        ),
    ):
        style.draw_curves(axes, run.t, run.q, short_names(run.arm.joint_names))
        axes.set(xlabel="time [s]")
        style.entitle(axes, title, fontsize=11)
    panels[0].set_ylabel("joints [rad] or [m]")
    style.legend_beside(panels[1])
