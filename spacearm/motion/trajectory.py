"""Trajectory: a motion of a floating arm in time, with all that was computed on the way."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array, Result
from spacearm.errors import ConfigurationError
from spacearm.files import opened, write
from spacearm.mechanics.dynamics import kinetic_energy, spacecraft_twist
from spacearm.mechanics.momentum import momentum_matrix
from spacearm.model.arm import SpaceArm
from spacearm.model.configuration import Configuration
from spacearm.model.mode import BaseMode, free_components
from spacearm.motion.events import Event
from spacearm.motion.motion import unit_quaternions
from spacearm.singularities.report import singular_values

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

UNITS = {
    "t": "s", "q": "rad or m", "dq": "rad/s or m/s", "base": "m, quaternion xyzw",
    "tip": "m, quaternion xyzw", "torque": "N m or N", "momentum": "kg m/s, kg m^2/s",
    "energy": "J", "work": "J", "sigma_min": "as in sa.singularity",
}  # fmt: skip
COLUMNS = {
    "q": "joint", "dq": "joint", "torque": "joint", "base": "pose", "tip": "pose",
    "momentum": "component",
}  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Result):
    """A motion in time; it plays in `sa.view`.

    Attributes:
        arm: The arm.
        mode: What the spacecraft did.
        t: (m,) times [s].
        q: (m, n) joint positions [rad] or [m].
        dq: (m, n) joint rates [rad/s] or [m/s].
        base: (m, 7) poses of the spacecraft: position [m], quaternion xyzw, inertial frame.
        tip: (m, 7) poses of the tip, likewise.
        torque: (m, n) joint torques [N m] or forces [N].
        momentum: (m, 6) [linear [kg m/s]; angular about the system CM [kg m^2/s]], inertial axes.
        energy: (m,) kinetic energy [J].
        work: (m,) work of the torques since the start [J].
        exchanged: Work that they did and took back in all [J].
        sigma_min: (m,) least singular value of the task Jacobian.
        events: What happened on the way.
        ended: Why it ended: "duration", the kind of the event that stopped it, or what failed.
    """

    arm: SpaceArm
    mode: BaseMode
    t: Array
    q: Array
    dq: Array
    base: Array
    tip: Array
    torque: Array
    momentum: Array
    energy: Array
    work: Array
    exchanged: float
    sigma_min: Array
    events: tuple[Event, ...]
    ended: str

    @classmethod
    def of(
        cls,
        start: Configuration,
        mode: BaseMode,
        t: Array,
        rows: Sequence[tuple[Configuration, Array, Array, Array, float]],
        exchanged: float,
        events: tuple[Event, ...],
        ended: str,
    ) -> Trajectory:
        """From (configuration, rates, torques, momentum, work) at each time."""
        momentum, energy, sigma_min = [], [], []
        for cfg, dq, _, h, _ in rows:
            matrix = momentum_matrix(cfg)
            momentum.append(matrix.A_b @ spacecraft_twist(cfg, dq, mode, h) + matrix.A_q @ dq)
            energy.append(kinetic_energy(cfg, dq, mode=mode, momentum=h))
            sigma_min.append(singular_values(cfg, mode=mode)[-1])
        cfgs = [row[0] for row in rows]
        return cls(
            arm=start.arm,
            mode=mode,
            t=t,
            q=np.array([cfg.q for cfg in cfgs]),
            dq=np.array([row[1] for row in rows]),
            base=np.array([pin.SE3ToXYZQUAT(cfg.base) for cfg in cfgs]),
            tip=np.array([pin.SE3ToXYZQUAT(cfg.tip) for cfg in cfgs]),
            torque=np.array([row[2] for row in rows]),
            momentum=np.array(momentum),
            energy=np.array(energy),
            work=np.array([row[4] for row in rows]),
            exchanged=exchanged,
            sigma_min=np.array(sigma_min),
            events=events,
            ended=ended,
        )

    @property
    def turnover(self) -> float:
        """The energies that came and went [J]: the largest there was, and all work."""
        return float(self.energy.max() + self.exchanged)

    @property
    def imbalance(self) -> float:
        """Largest difference of energy and work, over the turnover."""
        off = float(np.abs(self.energy - self.energy[0] - self.work).max())
        return off / self.turnover if self.turnover > 0.0 else 0.0

    @property
    def drift(self) -> float:
        """Largest change of the momentum that is kept, over what the joints alone brought."""
        f = free_components(self.mode)
        brought = [momentum_matrix(self.at(i)).A_q[:f] @ dq for i, dq in enumerate(self.dq)]
        change = np.abs(self.momentum[:, :f] - self.momentum[0, :f]).max(initial=0.0)
        most = np.abs([*brought, self.momentum[0, :f]]).max(initial=0.0)
        return float(change / most) if most > 0.0 else 0.0

    def at(self, index: int) -> Configuration:
        """The configuration of one time."""
        return self.arm.at(self.q[index], base=pin.XYZQUATToSE3(self.base[index]))

    def to_xarray(self) -> xr.Dataset:
        """All arrays, labelled, with units in their attributes."""
        import xarray as xr

        data = {}
        for name in (name for name in UNITS if name != "t"):
            dims = ("t", COLUMNS[name]) if name in COLUMNS else ("t",)
            data[name] = (dims, getattr(self, name), {"unit": UNITS[name]})
        labels = {"t": self.t, "joint": list(self.arm.joint_names)}
        attrs = {"arm": self.arm.name, "mode": self.mode, "ended": self.ended}
        return xr.Dataset(data, coords=labels, attrs=attrs)

    def plot(self, target: npt.ArrayLike | None = None) -> Figure:
        """Tip path, attitude, joints and sigma_min, as figures 5 and 6 of the paper show them.

        Args:
            target: (3,) a point to mark on the tip path [m], or (2,) in the plane of a planar arm.

        Returns:
            A matplotlib figure; `figure.savefig(path)` writes it, notebooks show it.
        """
        from spacearm.plots.motions import draw_motion  # imports matplotlib

        return draw_motion(self, target)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes all arrays and events to a NumPy file; the arm is not in it."""
        buffer = io.BytesIO()
        arrays = {name: getattr(self, name) for name in UNITS}
        events = {
            "event_t": np.array([event.t for event in self.events]),
            "event_q": np.array([event.q for event in self.events]).reshape(-1, self.arm.n),
            "event_kind": np.array([event.kind for event in self.events], dtype=str),
            "event_detail": np.array([event.detail for event in self.events], dtype=str),
        }
        words = {name: np.array(getattr(self, name)) for name in ("mode", "ended", "exchanged")}
        joints = {"joints": np.array(self.arm.joint_names)}
        np.savez(buffer, allow_pickle=False, **arrays, **events, **words, **joints)
        write(Path(path), buffer.getvalue())

    @classmethod
    def load(cls, path: str | os.PathLike[str], arm: SpaceArm) -> Trajectory:
        """Reads what `save` wrote, for the same arm.

        Raises:
            ConfigurationError: The file is no trajectory, or one of an arm with other joints.
        """
        data = _arrays(path)
        try:
            names = _names(data["joints"])
            mode = {name: name for name in get_args(BaseMode)}[str(data["mode"])]
            _check(data, len(names))
        except (ValueError, KeyError) as error:
            raise ConfigurationError(f"{path} is no saved trajectory: {error}") from None
        if names != arm.joint_names:
            raise ConfigurationError(
                f"{path} is a trajectory of joints {', '.join(names)[:200]}; {arm.name} has "
                f"{', '.join(arm.joint_names)}"
            )
        events = (data[f"event_{name}"] for name in ("t", "kind", "q", "detail"))
        return cls(
            arm=arm,
            mode=mode,
            **{name: data[name] for name in UNITS},
            exchanged=float(data["exchanged"]),
            events=tuple(
                Event(float(t), str(kind), q, str(detail))
                for t, kind, q, detail in zip(*events, strict=True)
            ),
            ended=str(data["ended"]),
        )

    def __repr__(self) -> str:
        first = f", first {self.events[0].kind} at {self.events[0].t:.4g} s" if self.events else ""
        return (
            f"Trajectory({self.arm.name}, {self.mode}: {self.t[-1]:.6g} s, {len(self.t)} times, "
            f"ended by {self.ended}{first})"
        )


def _arrays(path: str | os.PathLike[str]) -> dict[str, npt.NDArray[Any]]:
    """The arrays of a NumPy file that `save` may have written."""
    try:
        with opened(Path(path)) as file, np.load(file, allow_pickle=False) as arrays:
            held = sum(entry.file_size for entry in arrays.zip.infolist())
            packed = held > os.fstat(file.fileno()).st_size
            data = {} if packed else dict(arrays)
    except Exception as error:  # whatever zipfile and NumPy make of a damaged file
        raise ConfigurationError(f"{path} is no saved trajectory: {error}") from None
    if packed:
        raise ConfigurationError(
            f"{path} holds more data than it has bytes (compressed?): write it by save"
        )
    return data


def _names(joints: npt.NDArray[Any]) -> tuple[str, ...]:
    """The names of the joints; texts of no letters take no bytes, and might be any number."""
    if joints.dtype.kind != "U" or joints.itemsize == 0:
        raise ValueError(f"joints holds {joints.dtype} of shape {joints.shape}, not names")
    return tuple(str(name) for name in joints.ravel())


def _check(data: Mapping[str, npt.NDArray[Any]], n: int) -> None:
    """Raises a ValueError that names the array whose shape or values `save` would not write."""
    m, k, sizes = data["t"].size, data["event_t"].size, {"joint": n, "pose": 7, "component": 6}
    shapes: dict[str, tuple[int, ...]] = {
        name: (m, sizes[COLUMNS[name]]) if name in COLUMNS else (m,) for name in UNITS
    }
    shapes |= {"event_t": (k,), "event_q": (k, n), "exchanged": ()}
    words = {"event_kind": (k,), "event_detail": (k,), "ended": ()}
    for name, shape in (shapes | words).items():
        array, kind = data[name], "U" if name in words else "f"
        if array.shape != shape or array.dtype.kind != kind:
            raise ValueError(f"{name} holds {array.dtype} of shape {array.shape}, not {shape}")
        if kind == "f" and not np.isfinite(array).all():
            raise ValueError(f"{name} holds numbers that are not finite")
    for name in ("base", "tip"):
        if not unit_quaternions(data[name]):
            raise ValueError(f"{name} holds quaternions that are not of length 1")
    if (data["sigma_min"] < 0.0).any():
        raise ValueError("sigma_min is negative")
    if m == 0 or (np.diff(data["t"]) <= 0.0).any():
        raise ValueError("t does not grow")
