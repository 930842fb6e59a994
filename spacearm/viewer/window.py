"""Window: a meshcat scene kept in this process, for any number of browsers and for files.

`meshcat.Visualizer` uses it in place of meshcat's own window: no second process, no ZeroMQ socket,
and one port for everything. It builds on private modules of meshcat, whose version is pinned.
"""

from __future__ import annotations

import base64
import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import umsgpack
from meshcat.servers.tree import SceneTree, find_node, walk
from meshcat.servers.zmqserver import VIEWER_ROOT

from spacearm.viewer.outbox import DELETE, Key

VIEWER_SCRIPT = Path(VIEWER_ROOT) / "main.min.js"
PAGE = Path(__file__).parent / "page"


class Window:
    """The drawing commands of a scene that are still valid, each passed on to the listeners.

    Attributes:
        listeners: Functions that are called with every command: what it is about, and it, packed.
        recorder: If set, it takes the commands in place of the window.
    """

    def __init__(self) -> None:
        self._tree = SceneTree()
        self._lock = threading.RLock()
        self.listeners: list[Callable[[Key, bytes], None]] = []
        self.recorder: Callable[[dict[str, Any]], None] | None = None

    def send(self, command: Any) -> None:
        """Take a meshcat command: set_object, set_transform, set_property, ..., delete."""
        content = command.lower()
        if self.recorder:
            self.recorder(content)
            return
        kind, path = content["type"], [part for part in content["path"].split("/") if part]
        data = umsgpack.packb(content)
        with self._lock:
            if kind == DELETE:
                find_node(self._tree, path[:-1]).pop(path[-1], None)
            else:
                node = find_node(self._tree, path)
                if kind == "set_property":
                    node.properties = [p for p in node.properties if p[0] != content["property"]]
                    node.properties.append((content["property"], data))
                else:
                    setattr(node, kind.removeprefix("set_"), data)
            key = Key(tuple(path), content.get("property", kind))
            for listener in self.listeners:
                listener(key, data)

    def commands(self) -> list[bytes]:
        """Return the commands that draw the present scene."""
        with self._lock:
            return list(self._commands())

    def _commands(self) -> Iterator[bytes]:
        for node in walk(self._tree):
            if node.object is not None:
                yield node.object
            for _, data in node.properties:
                yield data
            if node.transform is not None:
                yield node.transform
        for node in walk(self._tree):  # once all objects are there
            if node.animation is not None:
                yield node.animation

    def static_html(self, title: str, about: dict[str, Any]) -> str:
        """Return a page that shows the scene without a server or a network.

        Args:
            title: Title of the page.
            about: Data for the script of the page: layers, and the time span of an animation.
        """
        commands = [base64.b64encode(data).decode() for data in self.commands()]
        parts = {
            "TITLE": title.replace("&", "&amp;").replace("<", "&lt;"),
            "STYLE": (PAGE / "page.css").read_text(encoding="utf-8"),
            "VIEWER": VIEWER_SCRIPT.read_text(encoding="utf-8"),
            "ABOUT": _script_json(about),
            "COMMANDS": _script_json(commands),
            "SCENE": (PAGE / "scene.js").read_text(encoding="utf-8").replace("export ", ""),
        }
        page = (PAGE / "saved.html").read_text(encoding="utf-8")
        pieces = page.split("%%")
        return "".join(parts.get(piece, piece) for piece in pieces)


def _script_json(value: Any) -> str:
    """Write JSON that may stand inside a <script> element."""
    return json.dumps(value).replace("</", "<\\/")
