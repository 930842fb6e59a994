"""A motion as an MCAP file of ROS 2 messages, which `ros2 bag play`, RViz and Foxglove read."""

from __future__ import annotations

import io
from importlib import import_module
from typing import Any

import numpy as np

from spacearm.errors import UnsupportedError
from spacearm.motion.motion import Motion

WORLD = "world"
"""ROS's name of the inertial frame."""
JOINTS_AND_BASE = ("q", "dq", "torque", "base")
"""Quantities that have messages of their own."""
STAMP = "builtin_interfaces/Time stamp\nstring frame_id"
TIME = "int32 sec\nuint32 nanosec"
TRANSFORM = "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
VECTOR, QUATERNION = ("\n".join(f"float64 {x}" for x in letters) for letters in ("xyz", "xyzw"))


def _definition(own: str, **others: str) -> str:
    """Return the definition of a message with those of the messages in it."""
    parts = (f"\n{'=' * 80}\nMSG: {name.replace('__', '/')}\n{x}" for name, x in others.items())
    return own + "".join(parts) + "\n"


DEFINITIONS = {
    "sensor_msgs/msg/JointState": _definition(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
        "float64[] effort",
        std_msgs__Header=STAMP,
        builtin_interfaces__Time=TIME,
    ),
    "tf2_msgs/msg/TFMessage": _definition(
        "geometry_msgs/TransformStamped[] transforms",
        geometry_msgs__TransformStamped=(
            "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
        ),
        std_msgs__Header=STAMP,
        builtin_interfaces__Time=TIME,
        geometry_msgs__Transform=TRANSFORM,
        geometry_msgs__Vector3=VECTOR,
        geometry_msgs__Quaternion=QUATERNION,
    ),
    "std_msgs/msg/Float64": _definition("float64 data"),
    "std_msgs/msg/Float64MultiArray": _definition(
        "std_msgs/MultiArrayLayout layout\nfloat64[] data",
        std_msgs__MultiArrayLayout=("std_msgs/MultiArrayDimension[] dim\nuint32 data_offset"),
        std_msgs__MultiArrayDimension="string label\nuint32 size\nuint32 stride",
    ),
}
"""As ROS 2 has them; MCAP files bring the definitions of their messages."""


def mcap(motion: Motion) -> bytes:
    """Write a motion: /joint_states, /tf of the spacecraft, and each other quantity by its name.

    Raises:
        UnsupportedError: The library is not installed (pip install 'spacearm[mcap]').
    """
    try:
        library = import_module("mcap_ros2.writer")
    except ImportError:
        raise UnsupportedError(
            "mcap-ros2-support is not installed: pip install 'spacearm[mcap]'"
        ) from None
    buffer = io.BytesIO()
    writer = library.Writer(buffer)
    schemas = {name: writer.register_msgdef(name, text) for name, text in DEFINITIONS.items()}
    data = motion.to_xarray()
    q, dq, base = (data[name].values for name in ("q", "dq", "base"))
    effort = data["torque"].values if "torque" in data else np.empty((len(motion), 0))
    others = {str(name): x for name, x in data.data_vars.items() if name not in JOINTS_AND_BASE}
    names, root = list(motion.arm.joint_names), motion.arm.tree.root
    for i, since in enumerate(np.asarray(motion.t) - motion.t[0]):
        time = round(1e9 * since)
        header = {"stamp": {"sec": time // 10**9, "nanosec": time % 10**9}, "frame_id": WORLD}
        joints = {
            "header": header,
            "name": names,
            "position": q[i].tolist(),
            "velocity": dq[i].tolist(),
            "effort": effort[i].tolist(),
        }
        transform = _transform(base[i])
        placed = {"header": header, "child_frame_id": root, "transform": transform}
        messages = [
            ("/joint_states", "sensor_msgs/msg/JointState", joints),
            ("/tf", "tf2_msgs/msg/TFMessage", {"transforms": [placed]}),
            *(_quantity(name, values, i) for name, values in others.items()),
        ]
        for topic, kind, message in messages:
            writer.write_message(topic, schemas[kind], message, log_time=time, sequence=i)
    writer.finish()
    return buffer.getvalue()


def _transform(pose: Any) -> dict[str, dict[str, float]]:
    """Return a pose (7,) as a Transform."""
    values = pose.tolist()
    return {
        "translation": dict(zip("xyz", values[:3], strict=True)),
        "rotation": dict(zip("xyzw", values[3:], strict=True)),
    }


def _quantity(name: str, values: Any, i: int) -> tuple[str, str, dict[str, Any]]:
    """Return topic, type and message of a row of numbers at a time."""
    row = values.values[i]
    if row.ndim == 0:
        return f"/{name}", "std_msgs/msg/Float64", {"data": float(row)}
    dims = [
        {"label": str(dim), "size": row.shape[j], "stride": int(np.prod(row.shape[j:]))}
        for j, dim in enumerate(values.dims[1:])
    ]
    message = {"layout": {"dim": dims, "data_offset": 0}, "data": row.ravel().tolist()}
    return f"/{name}", "std_msgs/msg/Float64MultiArray", message
