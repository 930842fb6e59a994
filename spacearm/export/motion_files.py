"""A motion as a table, for MATLAB, for ROS 2, and as labelled arrays in NetCDF and Zarr."""

from __future__ import annotations

import io
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, imported, listed, require_known
from spacearm.files import decoded, read, write, write_folder
from spacearm.model.arm import SpaceArm
from spacearm.motion.motion import Motion
from spacearm.motion.motion_file import Quantity
from spacearm.signatures import checked

#: Largest size of a table of what was measured [bytes].
LARGEST_MEASURED = 10**8
#: Names of columns by what they stand for; those of wheels are numbers.
COLUMNS = {"component": ("px", "py", "pz", "hx", "hy", "hz"), "axis": ("x", "y", "z")}


@checked
def write_motion(motion: Motion, path: str | os.PathLike[str]) -> Path:
    """Write a motion for other programs, in the format that the suffix names.

    - .csv: a table with a line a time; the first line names the columns with their units.
    - .mat: a MATLAB file with an array for each quantity, `joint` names and `units`.
    - .json: a JointTrajectory as ROS 2's messages have it (trajectory_msgs): names of the joints,
      and points with positions, velocities and time from start.
    - .mcap: ROS 2 messages as bags hold them (extra `mcap`): /joint_states, /tf of the spacecraft
      in "world", and each other quantity on a topic of its name; time starts at 0.
    - .nc: NetCDF, as `Motion.to_xarray` has it.
    - .zarr: the same in a folder, Zarr's second format (extra `sweep`).

    `Motion.save` writes files that `Motion.load` reads.

    Args:
        motion: Any motion: a trajectory, a followed path, a plan.
        path: The file to write.

    Returns:
        The path.

    Raises:
        ConfigurationError: The suffix is none of these.
        UnsupportedError: What was given is not a motion, or the extra is not installed.
        SpaceArmError: The file cannot be written.

    Example:
        >>> import spacearm as sa
        >>> way = sa.follow(sa.load("planar2").at([0.3, 1.2]), [(1.5, 1.2)])
        >>> path = sa.write_motion(way, "way.csv")
        >>> path.read_text().split(",")[:2]
        ['t [s]', 'q joint_1 [rad]']
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".zarr":
        return _zarr(motion, path)
    require_known("suffix of a motion's file", suffix, (*WRITERS, ".zarr"))
    return write(path, WRITERS[suffix](motion))


def _csv(motion: Motion) -> bytes:
    """Write a table."""
    heads, columns = ["t [s]"], [np.asarray(motion.t)]
    for name, values in motion.to_xarray().data_vars.items():
        unit = values.attrs["units"]
        if values.ndim == 1:
            heads.append(f"{name} [{unit}]")
            columns.append(values.values)
            continue
        kind, size = str(values.dims[-1]), values.shape[-1]
        own = _columns(motion.arm, kind, unit, size)
        links = [""]
        if "link" in values.dims:
            links = [f"{link} ".replace(",", "_") for link in values["link"].values.tolist()]
        heads += [f"{name} {link}{column}" for link in links for column in own]
        columns += list(values.values.reshape(len(values), -1).T)
    text = io.StringIO()
    text.write(",".join(heads) + "\n")
    np.savetxt(text, np.column_stack(columns), fmt="%.17g", delimiter=",")
    return text.getvalue().encode()


def read_measured(path: Path, arm: SpaceArm) -> tuple[Motion, Array | None, Array | None]:
    """Read what was measured of an arm from a table with the heads that `write_motion` writes.

    Args:
        path: The table, CSV. Other columns than these are left alone.
        arm: The arm.

    Returns:
        The motion, of columns "t", "q JOINT" and "base x" to "base qw"; joint rates (m, n), of
        "dq JOINT", and twists (m, 6), of "twist vx" to "twist wz", where there are such columns.

    Raises:
        ConfigurationError: The file is no such table, or a column is missing or in other units.
    """
    try:
        first, *lines = decoded(read(path, LARGEST_MEASURED)).splitlines()
        values = np.array([[float(x) for x in line.split(",")] for line in lines if line.strip()])
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{path} is not a CSV table with a header: {error}") from None
    heads = [head.strip() for head in first.split(",")]
    if values.ndim != 2 or values.shape[1] != len(heads):
        raise ConfigurationError(f"{path}: give {len(heads)} numbers in a line, as in the header")
    pose = [f"base {column}" for column in _columns(arm, "pose")]
    twist = [*(f"twist v{x} [m/s]" for x in "xyz"), *(f"twist w{x} [rad/s]" for x in "xyz")]
    q, dq = (
        [
            f"{name} {column}"
            for column in _columns(arm, "joint", Quantity(unit, "joint").unit_for(arm.slides))
        ]
        for name, unit in (("q", "rad or m"), ("dq", "rad/s or m/s"))
    )

    def columns(wanted: list[str]) -> Array:
        if missing := [head for head in wanted if head not in heads]:
            raise ConfigurationError(f"{path} has no column {missing[0]!r}; it has {listed(heads)}")
        return values[:, [heads.index(head) for head in wanted]]

    def given(wanted: list[str]) -> Array | None:
        return columns(wanted) if any(head in heads for head in wanted) else None

    motion = Motion(arm, columns(["t [s]"])[:, 0], columns(q), columns(pose))
    return motion, given(dq), given(twist)


def _columns(arm: SpaceArm, kind: str, unit: str = "", size: int = 0) -> list[str]:
    """Return the heads of the columns of a quantity; a comma in them would part cells."""
    if kind == "pose":
        return [*(f"{x} [m]" for x in "xyz"), *(f"q{x} [1]" for x in "xyzw")]
    if kind == "joint":
        units = unit.split(", ") if ", " in unit else [unit] * arm.n
        names = (name.replace(",", "_") for name in arm.joint_names)
        return [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    columns = COLUMNS.get(kind) or tuple(str(i + 1) for i in range(size))
    return [f"{column} [{unit.replace(',', ';')}]" for column in columns]


def _mat(motion: Motion) -> bytes:
    """Write a MATLAB file."""
    data = motion.to_xarray()
    content: dict[str, Any] = {str(name): values.values for name, values in data.data_vars.items()}
    content |= {"t": motion.t[:, None], "arm": motion.arm.name}
    names = {str(name): x.values for name, x in data.coords.items() if name != "t"}
    content |= {name: np.array(words, dtype=object) for name, words in names.items()}
    content["units"] = {str(name): values.attrs["units"] for name, values in data.data_vars.items()}
    file: Any = io.BytesIO()  # which the stubs of scipy do not know
    scipy.io.savemat(file, content, long_field_names=True)
    return bytes(file.getvalue())


def _joint_trajectory(motion: Motion) -> bytes:
    """Write a JointTrajectory."""
    points = [
        {"positions": q.tolist(), "velocities": dq.tolist(), "time_from_start": _stamp(t)}
        for t, q, dq in zip(motion.t - motion.t[0], motion.q, motion.dq, strict=True)
    ]
    message = {"joint_names": list(motion.arm.joint_names), "points": points}
    return json.dumps(message, indent=1).encode() + b"\n"


def _stamp(t: float) -> dict[str, int]:
    """Return a time [s] as ROS has it."""
    seconds, nanoseconds = divmod(round(1e9 * t), 10**9)
    return {"sec": seconds, "nanosec": nanoseconds}


def _zarr(motion: Motion, path: Path) -> Path:
    """Write Zarr, whose third format has no strings yet."""
    imported("zarr", "Zarr", "sweep")
    data = motion.to_xarray()
    return write_folder(path, lambda folder: data.to_zarr(folder, zarr_format=2), ".zgroup")


#: ROS's name of the inertial frame.
WORLD = "world"
#: Quantities that have messages of their own.
JOINTS_AND_BASE = ("q", "dq", "torque", "base")
#: Fields of messages as ROS 2 has them.
MESSAGES: dict[str, list[str]] = json.loads(
    Path(__file__).with_name("ros_messages.json").read_text(encoding="utf-8")
)
WRITTEN = (
    "sensor_msgs/JointState", "tf2_msgs/TFMessage", "std_msgs/Float64", "std_msgs/Float64MultiArray"
)  # fmt: skip


def _definition(message: str) -> str:
    """Return the definition of a message with those of all messages in it."""
    parts = [message]
    for part in parts:  # which grows
        kinds = [re.split(r"[ \[]", line)[0] for line in MESSAGES[part]]
        parts += [kind for kind in kinds if kind in MESSAGES and kind not in parts]
    texts = {part: "\n".join(MESSAGES[part]) for part in parts}
    inner = (f"\n{'=' * 80}\nMSG: {part}\n{texts[part]}" for part in parts[1:])
    return texts[message] + "".join(inner) + "\n"


def _mcap(motion: Motion) -> bytes:
    """Write a motion: /joint_states, /tf of the spacecraft, and each other quantity by its name.

    Raises:
        UnsupportedError: The library is not installed (pip install 'spacearm[mcap]').
    """
    library = imported("mcap_ros2.writer", "mcap-ros2-support", "mcap")
    buffer = io.BytesIO()
    writer = library.Writer(buffer)
    schemas = {
        name: writer.register_msgdef(name.replace("/", "/msg/"), _definition(name))
        for name in WRITTEN
    }
    data = motion.to_xarray()
    q, dq, base = (data[name].values for name in ("q", "dq", "base"))
    effort = data["torque"].values if "torque" in data else np.empty((len(motion), 0))
    others = {str(name): x for name, x in data.data_vars.items() if name not in JOINTS_AND_BASE}
    names, root = list(motion.arm.joint_names), motion.arm.tree.root
    for i, t in enumerate(motion.t - motion.t[0]):
        header = {"stamp": _stamp(t), "frame_id": WORLD}
        joints = {"header": header, "name": names, "position": q[i].tolist()}
        joints |= {"velocity": dq[i].tolist(), "effort": effort[i].tolist()}
        placed = {"header": header, "child_frame_id": root, "transform": _transform(base[i])}
        messages = [
            ("/joint_states", "sensor_msgs/JointState", joints),
            ("/tf", "tf2_msgs/TFMessage", {"transforms": [placed]}),
            *(_quantity(name, values, i) for name, values in others.items()),
        ]
        for topic, kind, message in messages:
            time = round(1e9 * t)
            writer.write_message(topic, schemas[kind], message, log_time=time, sequence=i)
    writer.finish()
    return buffer.getvalue()


def _transform(pose: Any) -> dict[str, dict[str, float]]:
    """Return a pose (7,) as a Transform."""
    place, turn = (dict(zip("xyzw", part.tolist(), strict=False)) for part in np.split(pose, [3]))
    return {"translation": place, "rotation": turn}


def _quantity(name: str, values: Any, i: int) -> tuple[str, str, dict[str, Any]]:
    """Return topic, type and message of a row of numbers at a time."""
    row = values.values[i]
    if row.ndim == 0:
        return f"/{name}", "std_msgs/Float64", {"data": float(row)}
    dims = [
        {"label": str(dim), "size": row.shape[j], "stride": int(np.prod(row.shape[j:]))}
        for j, dim in enumerate(values.dims[1:])
    ]
    message = {"layout": {"dim": dims, "data_offset": 0}, "data": row.ravel().tolist()}
    return f"/{name}", "std_msgs/Float64MultiArray", message


WRITERS: dict[str, Callable[[Motion], bytes]] = {
    ".csv": _csv,
    ".mat": _mat,
    ".json": _joint_trajectory,
    ".mcap": _mcap,
    ".nc": lambda motion: bytes(motion.to_xarray().to_netcdf()),
}
