"""Datasets: designs, stores of sweeps, many simulated runs, and numbers of many configurations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError
from spacearm.plots import style

if TYPE_CHECKING:
    import xarray as xr

#: Curves in one drawing.
MOST_CURVES = 12


@style.draws()
def draw_dataset(result: xr.Dataset, ax: Any) -> Any:
    """Draw a dataset of spacearm: designs, the store of a sweep, or many runs.

    Designs and stores are drawn over their axes with more than one value: over one as a curve, over
    two as a map, of others at their first value; several arms as a curve each.

    Args:
        result: What `spacearm.design.workspaces`, `sweep` or `simulate_many` returns.
        ax: Matplotlib axes to draw into, two for many runs; None for a new figure.

    Raises:
        ConfigurationError: The dataset is none of these.
    """
    if "success" in result and result["success"].dims == ("run",):
        return _draw_runs(result, ax)
    values = _measure(result)
    axes = style.axes_for(ax, 7.2, 4.8)
    names = [str(name) for name in values.dims]
    arms = "arm" in names and values.sizes["arm"] > 1
    varied = [name for name in names if name != "arm" and values.sizes[name] > 1]
    if not varied:
        varied = [name for name in names if name != "arm"][:1]
    shown = varied[:1] if arms else varied[:2]
    others = [name for name in names if name not in shown and not (arms and name == "arm")]
    values = values.isel(dict.fromkeys(others, 0))
    labels = [_label(result, name) for name in shown]
    if not shown:
        places = np.arange(values.size)
        axes.bar(places, np.atleast_1d(values.values), color=style.BLUE)
        axes.set_xticks(places, [str(arm) for arm in np.atleast_1d(values["arm"].values)])
        axes.set(ylabel=values.name)
    elif len(shown) == 1:
        curves = [values.isel(arm=i) for i in range(values.sizes["arm"])] if arms else [values]
        for i, curve in enumerate(curves[:MOST_CURVES]):
            label = str(curve["arm"].values) if arms else None
            color = style.COLOURS[i % len(style.COLOURS)]
            axes.plot(result[shown[0]], curve, "o-", color=color, lw=2, label=label)
        top = 1.05 * float(np.nanmax(values, initial=0.0)) or 1.0
        axes.set(xlabel=labels[0], ylabel=values.name, ylim=(0.0, top))
        if arms:
            axes.legend(frameon=False)
    else:
        image = axes.pcolormesh(
            result[shown[0]], result[shown[1]], values.transpose(*shown[1::-1]), cmap="cividis"
        )
        axes.figure.colorbar(image, ax=axes, label=values.name)
        axes.set(xlabel=labels[0], ylabel=labels[1])
    fixed = [name for name in others if name != "arm" and name in result.coords]
    at = [f"{name} {result[name].values[0]:.4g}" for name in fixed]
    style.entitle(axes, ", ".join([*_what(result, arms), *at]))
    return axes


def _measure(result: xr.Dataset) -> xr.DataArray:
    """Return what is drawn of designs or of a store; its name says what it is, with the unit.

    Raises:
        ConfigurationError: There is nothing to draw.
    """
    if "near_share" in result and not (result["fraction"] > 0.0).any():
        return (100.0 * result["near_share"]).rename("postures near a singular one [%]")
    if "fraction" in result:
        return (100.0 * result["fraction"]).rename("path independent share [%]")
    if "success" in result:
        share = 100.0 * result["success"].mean("run")
        return share.rename("runs that reach the target [%]")
    if {"near", "configurations"} <= set(result):
        counts = result[["near", "configurations"]].sum("block")
        share = 100.0 * counts["near"] / counts["configurations"].where(counts.configurations > 0)
        return share.rename("configurations near a singularity [%]")
    for name, words in (("distance", "distance, to first order"), ("sigma_min", "sigma_min")):
        if name in result and "units" in result[name].attrs:
            return result[name].rename(f"{words} [{result[name].attrs['units']}]")
    raise ConfigurationError(
        "the dataset has nothing that can be drawn; give one that spacearm.design.workspaces, "
        "spacearm.sweep or spacearm.simulate_many returns"
    )


def _label(result: xr.Dataset, name: str) -> str:
    """Return the label of an axis."""
    units = result[name].attrs.get("units") if name in result.coords else None
    return f"{name} [{units}]" if units else name


def _what(result: xr.Dataset, arms: bool) -> list[str]:
    """Return whose numbers they are."""
    told = [str(result.attrs[name]) for name in ("arm", "base_mode") if name in result.attrs]
    if told or arms or "arm" not in result.coords:
        return told
    return [str(np.atleast_1d(result["arm"].values)[0])]


def _draw_runs(result: xr.Dataset, ax: Any) -> Any:
    """Draw over time which share of the runs has come to what, and how far spacecraft turn."""
    _, (times, turns) = style.panels_for(ax, lambda whole: whole.subplots(1, 2), 10.0, 4.4)
    m, end = result.sizes["run"], float(np.max(result["t"]))
    share = 100.0 * np.arange(1, m + 1) / m
    for name, words, color in (
        ("time_to_target", "target reached", style.BLUE),
        ("first_singularity", "singularity met", style.RED),
    ):
        t = np.sort(result[name].values[np.isfinite(result[name].values)])
        x, y = np.append(t, end), np.append(share[: len(t)], share[len(t) - 1] if len(t) else 0.0)
        times.step(np.append(0.0, x), np.append(0.0, y), where="post", color=color, label=words)
    turns.plot(np.degrees(np.sort(result["turn"].values)), share, color=style.GREY, lw=2)
    times.set(xlabel="time [s]", ylabel="share of the runs [%]", ylim=(0.0, 101.0))
    times.legend(frameon=False)
    turns.set(xlabel="largest turn of the spacecraft [°]", ylim=(0.0, 101.0))
    style.entitle(
        times,
        f"{result.attrs.get('arm', 'runs')}, {result.attrs.get('base_mode', '')}: "
        f"{int(result['success'].sum())} of {m} runs reach the target",
    )
    return times


@style.draws()
def draw_rows(result: dict[str, Array] | np.ndarray[Any, Any], ax: Any) -> Any:
    """Draw numbers of many configurations over their rows: each quantity in a panel of its own.

    Args:
        result: What `evaluate` returns, or an array whose first axis is that of the configurations.
        ax: Axes, one for each quantity; or a figure or subfigure; None for a new figure.

    Raises:
        ConfigurationError: These are not numbers, or of no configuration.
    """
    named = result if isinstance(result, dict) else {"value": result}
    numbers = {str(name): np.asarray(values) for name, values in named.items()}
    if not numbers or not all(
        x.ndim and x.size and x.dtype.kind in "biuf" for x in numbers.values()
    ):
        raise ConfigurationError(
            "there is no drawing of this: draw the arrays of numbers that sa.evaluate returns, "
            "with a row for each configuration"
        )
    many = len(numbers)

    def parts(whole: Any) -> list[Any]:
        return list(np.ravel(whole.subplots(many, 1, sharex=True)))

    _, panels = style.panels_for(ax, parts, 8.0, 1.4 + 2.0 * many)
    for axes, (name, values) in zip(panels, numbers.items(), strict=True):
        columns = values.reshape(len(values), -1)
        places = [", ".join(map(str, at)) for at in np.ndindex(values.shape[1:])]
        style.draw_curves(axes, np.arange(float(len(values))), columns[:, :MOST_CURVES], places)
        axes.set(ylabel=name)
        if values.ndim > 1:
            style.legend_beside(axes)
        if len(places) > MOST_CURVES:
            style.entitle(axes, f"the first {MOST_CURVES} of {len(places)} columns")
    panels[-1].set(xlabel="row")
    return panels[0]
