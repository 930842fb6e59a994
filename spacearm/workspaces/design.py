"""Design studies: the effect of masses, inertias and the mounting point on an arm's workspaces.

Section VI of Papadopoulos & Dubowsky (1993): a larger spacecraft inertia shrinks the path dependent
workspace, and an arm mounted at the spacecraft's CM has none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from spacearm.arrays import NO_NUMBERS, ArrayLike, Progress, counted, finite, floats, named, whole
from spacearm.errors import ConfigurationError, require_known, unknown
from spacearm.model.arguments import BaseMode
from spacearm.model.arm import SpaceArm
from spacearm.signatures import checked, shown
from spacearm.singularities.risk import risk_profile
from spacearm.workspaces.path_dependent import Workspace, workspace

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Mounted", "optimise_mount", "shell_measures", "vary", "workspaces"]

#: Most designs of a grid in memory, times the classes of their risk profiles.
MOST = 1_000_000
MOUNTS = ("mount_x", "mount_y", "mount_z")
#: Design parameters and their units.
PARAMETERS = {
    "base_mass": "kg",
    "base_inertia": "times the inertia",
    **dict.fromkeys(MOUNTS, "m"),
    "payload": "kg at the tip",
    "mass:LINK": "kg",
    "length:LINK": "m",
}


#: What goes with a parameter.
GOES_WITH = {
    "base_mass": "the inertia of the spacecraft is in proportion",
    "base_inertia": "its mass stays",
    "mass": "the inertia of the link is in proportion",
    "length": "the link keeps its mass, its inertia goes with the square of the length",
}


def unit_of(parameter: str) -> str:
    """Return the unit of a design parameter."""
    kind, sign, _ = parameter.partition(":")
    return PARAMETERS[f"{kind}:LINK" if sign else parameter]


class Mounted(NamedTuple):
    """An arm mounted for the largest path independent workspace found.

    Attributes:
        arm: The arm.
        mount: Pose of its first joint in the spacecraft frame.
        workspace: Its workspace.
        tried: Number of mounting points tried.
    """

    arm: SpaceArm
    mount: pin.SE3
    workspace: Workspace
    tried: int

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain JSON data."""
        return named(self)


@checked
def vary(arm: SpaceArm, parameters: Mapping[str, float]) -> SpaceArm:
    """Return the arm with some design parameters changed.

    Args:
        arm: The arm.
        parameters: Values by name: "base_mass" (mass of the spacecraft [kg], its inertia in
            proportion), "base_inertia" (a factor of that inertia), "mount_x", "mount_y", "mount_z"
            (first joint in the spacecraft frame [m]), "payload" (point mass at the tip [kg]). Of a
            link: "mass:LINK" [kg] and "length:LINK" [m], as of a body of the same shape; see
            `SpaceArm.replace`.

    Returns:
        Another arm; the one given stays as it is.

    Raises:
        ConfigurationError: A name is none of these.
        ModelError: No rigid body can have such a mass.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> sa.design.vary(arm, {"payload": 10.0, "mount_x": 0.2})
        SpaceArm(planar2: 2 joints, 57 kg, tip 'tip', task 'x y')
    """
    mount = arm.mount
    links: dict[str, dict[str, float]] = {"mass": {}, "length": {}}
    for name, value in parameters.items():
        if name in MOUNTS:
            mount.translation[MOUNTS.index(name)] = value
        elif name.partition(":")[0] in links and ":" in name:
            kind, _, link = name.partition(":")
            links[kind][link] = float(value)
        elif name not in PARAMETERS:
            raise ConfigurationError(unknown("design parameter", name, PARAMETERS))
    inertia, base_mass = None, parameters.get("base_mass")
    if "base_inertia" in parameters:
        spacecraft = arm if base_mass is None else arm.replace(base_mass=base_mass)
        inertia = parameters["base_inertia"] * spacecraft.model.inertias[1].inertia
    return arm.replace(
        base_mass=base_mass,
        base_inertia=inertia,
        mount=mount if set(MOUNTS) & set(parameters) else None,
        link_mass=links["mass"],
        link_length=links["length"],
        payload=parameters.get("payload"),
    )


@checked
def shell_measures(arm: SpaceArm, **options: Any) -> dict[str, Any]:
    """Compute the sizes and shells of an arm's workspaces, the quantities kept of each design.

    Args:
        arm: The design.
        **options: Options of `workspace`.

    Returns:
        `piw` and `reachable` (volumes [m^3], areas [m^2] for planar arms), `fraction` (path
        independent share), `pdw` (k, 2) (radii [m]), `bounds` (how the radii are known:
        "certified", "found" or "sampled"), `gap` (by how much they may be off [m]) and
        `resolution` (of sampled ones [m]); see `Workspace`.

    Raises:
        UnsupportedError: As of `workspace`.

    Example:
        >>> import spacearm as sa
        >>> round(sa.design.shell_measures(sa.load("planar2"))["fraction"], 4)
        0.3592
    """
    found = workspace(arm, **options)
    sizes = {name: found.volumes[name] for name in ("piw", "reachable")}
    return {
        **sizes,
        "fraction": found.fraction,
        "pdw": found.pdw,
        "bounds": found.kind,
        "gap": found.gap,
        "resolution": found.resolution,
    }


@checked
def workspaces(
    arm: SpaceArm,
    parameters: Mapping[str, ArrayLike],
    *,
    mode: BaseMode = "free-floating",
    limits: bool = False,
    effort: int | None = None,
    risk_bins: int = 0,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute workspaces over a grid of designs, in memory; `spacearm.sweep` is for large grids.

    Args:
        arm: The arm to start from.
        parameters: Values by name; see `vary`. All combinations are computed.
        mode: See `workspace`.
        limits: See `workspace`.
        effort: See `workspace`.
        risk_bins: Classes of the risk profile, from the least to the largest distance of each
            design; no profile if 0. It tells designs apart whose workspaces are path dependent
            everywhere.
        progress: Called as progress(done, total) after each design.

    Returns:
        Labelled arrays over the parameters: `piw` and `reachable` (volumes [m^3], areas [m^2] for
        planar arms), `fraction` (path independent share), `pdw` (shell, bound: radii [m], NaN
        where there are fewer shells), `bounds` (how the radii are known: "certified", "found" or
        "sampled"; empty where not done), `gap` and `resolution` (see `Workspace` [m]), `done`.
        With `risk_bins` also `risk` (class) and `near_share` (share of all postures within 5
        degrees of a singular one, found by search) with its standard error, `near_error`.
        After Ctrl-C the designs done so far are returned; `done` marks them.

    Raises:
        ConfigurationError: A parameter does not exist or has no values.
        UnsupportedError: The arm has several tips or a prismatic joint without limits, or can never
            do its task.

    Example:
        >>> import spacearm as sa
        >>> arm = sa.load("planar2")
        >>> sa.design.workspaces(arm, {"base_inertia": [1, 5]}).fraction.values.round(4)
        array([0.3592, 0.37  ])
    """
    import xarray as xr

    try:
        axes = {name: np.atleast_1d(floats(v)) for name, v in parameters.items()}
    except NO_NUMBERS:
        axes = {}
    whole(risk_bins, "risk_bins", 0)
    if not axes or any(values.size == 0 or values.ndim != 1 for values in axes.values()):
        raise ConfigurationError(
            f"parameters are {shown(dict(parameters))}; give numbers for one or more"
        )
    shape = tuple(len(values) for values in axes.values())
    whole(math.prod(shape) * max(risk_bins, 1), "number of designs, times risk_bins", 1, MOST)
    units = {"piw": "", "reachable": "", "fraction": "1", "gap": "m", "resolution": "m"}
    numbers = {name: np.full(shape, np.nan) for name in units}
    bounds = np.full(shape, "", dtype="U9")
    done = np.zeros(shape, dtype=bool)
    risk, near = np.full((*shape, risk_bins), np.nan), np.full((*shape, 2), np.nan)
    radii: dict[tuple[int, ...], np.ndarray] = {}
    options = {} if effort is None else {"effort": effort}
    designs = list(product(*map(range, shape)))
    vary(arm, {name: values[0] for name, values in axes.items()})  # checks the names
    try:
        for at in counted(designs, progress):
            values = {name: float(axes[name][i]) for name, i in zip(axes, at, strict=True)}
            varied = vary(arm, values)
            found = shell_measures(varied, mode=mode, limits=limits, **options)
            radii[at] = found.pop("pdw")
            bounds[at] = found.pop("bounds")
            for name, value in found.items():
                numbers[name][at] = value
            if risk_bins:
                profile = risk_profile(varied, mode=mode, limits=limits, bins=risk_bins)
                risk[at] = profile.share
                near[at] = profile.overall, profile.overall_error
            done[at] = True
    except KeyboardInterrupt:
        pass
    most = max((len(r) for r in radii.values()), default=0)
    pdw = np.full((*shape, most, 2), np.nan)
    for at, r in radii.items():
        pdw[at][: len(r)] = r
    names, volume = tuple(axes), "m^2" if arm.tree.plane_normal() is not None else "m^3"
    units.update(piw=volume, reachable=volume)
    data: dict[str, Any] = {n: (names, x, {"units": units[n]}) for n, x in numbers.items()}
    data["done"] = names, done, {"units": "1"}
    data["bounds"] = names, bounds, {"units": "1"}
    data["pdw"] = (*names, "shell", "bound"), pdw, {"units": "m"}
    if risk_bins:
        data["risk"] = (*names, "class"), risk, {"units": "1"}
        data["near_share"] = names, near[..., 0], {"units": "1"}
        data["near_error"] = names, near[..., 1], {"units": "1"}
    coords: dict[str, Any] = {"bound": ["least", "largest"]}
    for name, x in axes.items():
        coords[name] = name, x, {"units": unit_of(name)}
    return xr.Dataset(data, coords, {"arm": arm.name, "base_mode": mode, "limits": int(limits)})


@checked
def optimise_mount(
    arm: SpaceArm,
    bounds: Mapping[str, tuple[float, float]],
    *,
    mode: BaseMode = "free-floating",
    limits: bool = False,
    most: int = 120,
    progress: Progress | None = None,
) -> Mounted:
    """Find the mounting point with the largest path independent workspace.

    A global search (DIRECT; Jones, Perttunen & Stuckman 1993, DOI 10.1007/BF00941892), then
    Nelder and Mead's method from the best point.

    Args:
        arm: The arm.
        bounds: (low, high) of each of "mount_x", "mount_y", "mount_z" [m]; others stay.
        mode: See `workspace`.
        limits: See `workspace`.
        most: Largest number of mounting points that the global search tries.
        progress: Called as progress(done, total) after each mounting point; both searches together
            try at most about 2 `most`.

    Returns:
        The arm at its best mounting point, with its workspace.

    Raises:
        ConfigurationError: A name or a bound is not valid.

    Example:
        >>> import spacearm as sa
        >>> best = sa.design.optimise_mount(sa.load("planar2"), {"mount_x": (0, 0.5)}, most=5)
        >>> round(best.workspace.fraction, 2)  # of 0.36: the mount has moved towards the CM
        0.96
    """
    from scipy.optimize import Bounds, direct, minimize  # slow to import

    for name, (low, high) in bounds.items():
        require_known("mounting coordinate", name, MOUNTS)
        ends = finite((low, high), (2,), f"bounds of {name}", "[m]")
        if not ends[0] < ends[1]:
            raise ConfigurationError(f"bounds of {name} are {low}, {high}; give low < high [m]")
    if not bounds:
        raise ConfigurationError(f"no bounds; give them for one or more of: {', '.join(MOUNTS)}")
    tried: dict[tuple[float, ...], Workspace] = {}

    def loss(x: np.ndarray) -> float:
        key = tuple(map(float, x))
        if key not in tried:
            moved = vary(arm, dict(zip(bounds, key, strict=True)))
            tried[key] = workspace(moved, mode=mode, limits=limits)
            if progress:
                progress(len(tried), max(2 * most, len(tried)))
        return -tried[key].volumes["piw"]

    most = whole(most, "most", 1)
    box = list(bounds.values())
    start = direct(loss, Bounds(*np.array(box).T), maxfun=most, locally_biased=True).x
    minimize(loss, start, method="Nelder-Mead", bounds=box, options={"xatol": 1e-6, "maxfev": most})
    best = max(tried.values(), key=lambda found: found.volumes["piw"])
    return Mounted(best.arm, best.arm.mount, best, len(tried))
