"""Recorder: drawings at successive times as one meshcat animation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array

FRAMES_PER_SECOND = 30
TYPES = {"position": "vector3", "scale": "vector3", "quaternion": "quaternion", "visible": "bool"}


class Recorder:
    """Takes drawing commands in place of the window and keeps what changes, frame by frame.

    Attributes:
        frame: The frame that commands belong to.
    """

    def __init__(self) -> None:
        self.frame = 0.0
        self._tracks: dict[str, dict[str, list[dict[str, Any]]]] = {}

    def __call__(self, content: dict[str, Any]) -> None:
        """Record a lowered set_transform or set_property command at the current frame."""
        if content["type"] == "set_property":
            self._key(content["path"], content["property"], content["value"])
        elif content["type"] == "set_transform":
            matrix = np.array(content["matrix"]).reshape(4, 4).T
            scale = np.linalg.norm(matrix[:3, :3], axis=0)
            self._key(content["path"], "position", matrix[:3, 3].tolist())
            self._key(content["path"], "scale", scale.tolist())
            quaternion = pin.Quaternion(matrix[:3, :3] / scale).normalized().coeffs()
            self._key(content["path"], "quaternion", quaternion.tolist())

    def _key(self, path: str, name: str, value: Any) -> None:
        keys = self._tracks.setdefault(path, {}).setdefault(name, [])
        keys.append({"time": self.frame, "value": value})

    def poses(self, frames: int) -> dict[str, Array]:
        """Return (frames, 7) position [m] and quaternion x, y, z, w of nodes placed in each."""
        found = {}
        for path, tracks in self._tracks.items():
            places, turns = tracks.get("position", []), tracks.get("quaternion", [])
            if len(places) == frames:
                rows = [(*a["value"], *b["value"]) for a, b in zip(places, turns, strict=True)]
                found[path] = np.array(rows)
        return found

    def lower(self) -> dict[str, Any]:
        """Return the animation as a meshcat command."""
        return {
            "type": "set_animation",
            "path": "",
            "options": {"play": False, "repetitions": 1},
            "animations": [
                {
                    "path": path,
                    "clip": {
                        "fps": FRAMES_PER_SECOND,
                        "name": "motion",
                        "tracks": [
                            {"name": f".{name}", "type": TYPES[name], "keys": keys}
                            for name, keys in tracks.items()
                        ],
                    },
                }
                for path, tracks in self._tracks.items()
            ],
        }
