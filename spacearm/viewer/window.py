"""Window: a meshcat scene kept in this process, for any number of browsers and for files.

`meshcat.Visualizer` uses it in place of meshcat's own window: no second process, no ZeroMQ socket,
and one port for everything.
"""

from __future__ import annotations

import base64
import html
import json
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import umsgpack
from meshcat.servers.zmqserver import VIEWER_ROOT


class Key(NamedTuple):
    """What a message is about; a later one about the same replaces one that still waits.

    Attributes:
        path: The node of the scene, one name a level; empty for the panel.
        what: The kind of message, or the property of the node.
    """

    path: tuple[str, ...]
    what: str


M = TypeVar("M")
#: Kind of the message that a node is gone, with all below it.
DELETE = "delete"
#: Size from which drawing commands are no more sent together [bytes].
BUNDLE = 50_000


class Outbox:
    """Messages to one browser in their order, of each kind only the latest.

    A browser that reads slowly, or not at all, gets the latest state when it reads again: what
    waits never grows beyond one scene and one answer of each kind.
    """

    def __init__(self) -> None:
        self._waiting: dict[Key, str | bytes] = {}

    def put(self, key: Key, message: str | bytes) -> None:
        """Add a message, in the place of one of the same key that waits."""
        if key.what == DELETE:
            self._waiting = _without(self._waiting, key.path)
        self._waiting[key] = message

    def take(self) -> str | bytes | None:
        """Take the message that waits the longest; None if there is none.

        Drawing commands, which are bytes, come together with those behind them: each in turn,
        after its length in four bytes, the lowest first.
        """
        bundle = bytearray()
        while self._waiting and len(bundle) < BUNDLE:
            key = next(iter(self._waiting))
            message = self._waiting[key]
            if isinstance(message, str):
                if bundle:
                    break
                return str(self._waiting.pop(key))
            del self._waiting[key]
            bundle += len(message).to_bytes(4, "little") + message
        return bytes(bundle) or None

    def __len__(self) -> int:
        return len(self._waiting)


def _without(messages: dict[Key, M], path: tuple[str, ...]) -> dict[Key, M]:
    """Return messages without those about a node and all below it."""
    return {key: m for key, m in messages.items() if key.path[: len(path)] != path}


PAGE = Path(__file__).parent / "page"
#: What the page is built on, by the names that it asks for.
LIBRARIES = {
    "meshcat.js": Path(VIEWER_ROOT) / "main.min.js",
    "uplot.js": PAGE / "uplot" / "uplot.js",
    "uplot.css": PAGE / "uplot" / "uplot.css",
}
#: Modules of a saved page, each after those that it needs.
SAVED = (
    "format.js", "scene.js", "ticks.js", "camera.js", "readouts.js", "playback.js", "chart.js",
    "archive.js", "map.js", "record.js", "touch.js", "saved.js",
)  # fmt: skip


class Window:
    """The drawing commands of a scene that are still valid, each passed on to the listeners.

    Attributes:
        listeners: Functions that are called with every command: what it is about, and it, packed.
        recorder: If set, it takes the commands in place of the window.
    """

    def __init__(self) -> None:
        self._scene: dict[Key, bytes] = {}
        self._lock = threading.RLock()
        self.listeners: list[Callable[[Key, bytes], None]] = []
        self.recorder: Callable[[dict[str, Any]], None] | None = None
        self._replacing = False

    def send(self, command: Any) -> None:
        """Take a meshcat command: set_object, set_transform, set_property, ..., delete."""
        content = command.lower()
        if self.recorder:
            self.recorder(content)
            return
        path = tuple(part for part in content["path"].split("/") if part)
        key, data = Key(path, content.get("property", content["type"])), umsgpack.packb(content)
        with self._lock:
            if key.what == DELETE:
                self._scene = _without(self._scene, path)
            else:
                self._scene[key] = data
            if not self._replacing:  # browsers load the new scene as a whole
                for listener in self.listeners:
                    listener(key, data)

    @contextmanager
    def replaced(self) -> Iterator[None]:
        """Draw another scene in place of the present one, which stays if that fails."""
        with self._lock:
            before, self._scene = self._scene, {}
            self._replacing = True
            try:
                yield
            except BaseException:
                self._scene = before
                raise
            finally:
                self._replacing = False

    def commands(self) -> list[bytes]:
        """Return the commands that draw the present scene, those that make its objects first."""
        with self._lock:
            return [self._scene[key] for key in sorted(self._scene, key=_rank)]

    def static_html(self, title: str, shown: dict[str, Any]) -> str:
        """Return a page that shows the scene without a server or a network.

        Args:
            title: Title of the page.
            shown: What its script shows: `about` and `readout` of a panel.
        """
        commands = [base64.b64encode(data).decode() for data in self.commands()]
        data = f"const DATA = {json_in_html(shown)};\nconst COMMANDS = {json_in_html(commands)};\n"
        libraries = "\n".join(_text(LIBRARIES[name]) for name in ("meshcat.js", "uplot.js"))
        parts = {
            '<link rel="stylesheet" href="uplot.css">': f"<style>{_text(LIBRARIES['uplot.css'])}",
            '<link rel="stylesheet" href="page.css">': f"{_text(PAGE / 'page.css')}</style>",
            '<script src="meshcat.js"></script>': f"<script>{libraries}</script>",
            '<script src="uplot.js"></script>': "",
            '<script type="module" src="page.js"></script>': (
                f'<script type="module">{data}{"".join(map(_module, SAVED))}</script>'
            ),
            "<title>spacearm</title>": f"<title>{html.escape(title)}</title>",
            "<body>": '<body class="saved">',
        }
        marks = "|".join(map(re.escape, parts))
        return re.sub(marks, lambda mark: parts[mark[0]], _text(PAGE / "index.html"))


def _rank(key: Key) -> int:
    """Return when a command is sent: objects, their properties, their places, motions of them."""
    return {"set_object": 0, "set_transform": 2, "set_animation": 3}.get(key.what, 1)


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _module(name: str) -> str:
    """Return a module of the page to stand with others in one script."""
    return re.sub(r"(?m)^import [^;]*;\n|^export ", "", _text(PAGE / name))


#: What HTML or JavaScript may take for a mark or the end of a line, as JSON writes it.
MARKS = {ord(mark): f"\\u{ord(mark):04x}" for mark in "<>&\u2028\u2029"}


def json_in_html(value: Any) -> str:
    """Write a value as JSON that may stand anywhere in a page: in a script or an attribute."""
    return json.dumps(value).translate(MARKS)
