"""Server: one page on one port of this machine, with one WebSocket for scene and panel.

Binary messages to the browser are drawing commands of meshcat; text messages are JSON, readouts
and errors for the panel. Text messages from the browser are requests of the panel.
"""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from typing import Any, Protocol

import tornado.httpserver
import tornado.web
import tornado.websocket

from spacearm.errors import SpaceArmError
from spacearm.viewer.window import PAGE, VIEWER_SCRIPT, Window

LOOPBACK = "127.0.0.1"
FIRST_PORT, LAST_PORT = 7400, 7500
LARGEST_MESSAGE = 100_000
PAUSE = 0.001
"""Time for which messages are collected before the scene is drawn once for all of them [s]."""


class Panel(Protocol):
    """The interface of what the server shows."""

    window: Window

    def handle(self, message: object) -> None:
        """Do what a message asks.

        Raises:
            SpaceArmError: It cannot be done.
        """

    def readout(self) -> dict[str, Any]:
        """Return what the panel shows of the present state."""

    def draw(self) -> None:
        """Draw the present state."""

    def about(self) -> dict[str, Any]:
        """Return what the page needs once."""


class Server:
    """A server of a panel, in a thread of its own, until it is closed.

    Attributes:
        port: The port, on 127.0.0.1.
        url: Address of the page.

    Raises:
        SpaceArmError: The port is in use.
    """

    def __init__(self, panel: Panel, port: int | None = None) -> None:
        listener = _listen(port)
        self.port = int(listener.getsockname()[1])
        self.url = f"http://{LOOPBACK}:{self.port}/"
        self._panel = panel
        self._browsers: set[_Socket] = set()
        self._stale = False
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(
            target=self._loop.run_until_complete, args=(self._serve(listener),), daemon=True
        )
        self._thread.start()
        panel.window.listeners.append(self._broadcast)

    def close(self) -> None:
        """End the thread and free the port."""
        if self._thread.is_alive():
            self._panel.window.listeners.remove(self._broadcast)
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(timeout=5.0)

    def refresh(self) -> None:
        """Draw the state and send it to every browser, soon, and once for many calls."""
        self._loop.call_soon_threadsafe(self._mark_stale)

    async def _serve(self, listener: socket.socket) -> None:
        hosts = {f"{LOOPBACK}:{self.port}", f"localhost:{self.port}"}
        options = {"server": self, "hosts": hosts}
        files = {"index.html", "page.css", "page.js", "scene.js"}
        application = tornado.web.Application([
            (r"/socket", _Socket, options),
            (r"/(meshcat\.js)", _File, {"path": VIEWER_SCRIPT, "hosts": hosts}),
            *((rf"/({name})", _File, {"path": PAGE / name, "hosts": hosts}) for name in files),
            (r"/()", _File, {"path": PAGE / "index.html", "hosts": hosts}),
        ], websocket_max_message_size=LARGEST_MESSAGE)  # fmt: skip
        server = tornado.httpserver.HTTPServer(application)
        server.add_socket(listener)
        await self._stop.wait()
        server.stop()
        for browser in list(self._browsers):
            browser.close(1001, "spacearm has ended")
        await server.close_all_connections()

    # --- in the server's thread -------------------------------------------------------------

    def opened(self, browser: _Socket) -> None:
        """Send everything to a new browser."""
        self._panel.draw()
        self._browsers.add(browser)
        browser.tell({"about": self._panel.about(), "readout": self._panel.readout()})
        for data in self._panel.window.commands():
            browser.draw(data)
        browser.tell({"complete": True})

    def closed(self, browser: _Socket) -> None:
        """Forget a browser."""
        self._browsers.discard(browser)

    def received(self, browser: _Socket, text: str | bytes) -> None:
        """Do what a browser asks, or send it the error."""
        try:
            self._panel.handle(json.loads(text))
        except SpaceArmError as error:
            browser.tell({"error": str(error)})
        except (ValueError, RecursionError) as error:  # json's, numbers of thousands of digits too
            browser.tell({"error": f"not understood: {error}"})
        self._mark_stale()

    def _mark_stale(self) -> None:
        if not self._stale:
            self._stale = True
            self._loop.call_later(PAUSE, self._flush)

    def _flush(self) -> None:
        self._stale = False
        readout = self._panel.readout()
        for browser in list(self._browsers):
            browser.tell({"readout": readout})  # before the drawing, which is slower in a browser
        self._panel.draw()

    def _draw(self, data: bytes) -> None:
        for browser in list(self._browsers):
            browser.draw(data)

    def _broadcast(self, data: bytes) -> None:
        """Pass a drawing command on, from any thread."""
        if threading.current_thread() is self._thread:
            self._draw(data)
        else:
            self._loop.call_soon_threadsafe(self._draw, data)


class _OwnHostOnly(tornado.web.RequestHandler):
    """Refuses host names that are not this machine's, against DNS rebinding by other pages."""

    _hosts: set[str]

    def prepare(self) -> None:
        if self.request.host not in self._hosts:
            raise tornado.web.HTTPError(403, reason="this host name is not served")


class _File(_OwnHostOnly):
    def initialize(self, path: Any, hosts: set[str]) -> None:
        self._path, self._hosts = path, hosts

    def get(self, name: str) -> None:
        kinds = {"css": "text/css", "js": "text/javascript"}
        kind = kinds.get(name.rpartition(".")[2], "text/html")
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Content-Security-Policy", "frame-ancestors 'self'")
        self.write(self._path.read_bytes())


class _Socket(_OwnHostOnly, tornado.websocket.WebSocketHandler):
    def initialize(self, server: Server, hosts: set[str]) -> None:
        self._server, self._hosts = server, hosts

    def check_origin(self, origin: str) -> bool:
        return origin in {f"http://{host}" for host in self._hosts}

    def open(self, *_: str, **__: str) -> None:
        self.set_nodelay(True)
        self._server.opened(self)

    def on_message(self, message: str | bytes) -> None:
        self._server.received(self, message)

    def on_close(self) -> None:
        self._server.closed(self)

    def tell(self, content: dict[str, Any]) -> None:
        self._send(json.dumps(content, allow_nan=False), binary=False)

    def draw(self, data: bytes) -> None:
        self._send(data, binary=True)

    def _send(self, data: str | bytes, binary: bool) -> None:
        try:
            sent = self.write_message(data, binary)
        except tornado.websocket.WebSocketClosedError:
            self._server.closed(self)
        else:
            sent.add_done_callback(lambda future: future.exception())  # a tab closed while it came


def _listen(port: int | None) -> socket.socket:
    """Open a socket on the port asked for, or on the first free one of spacearm's range."""
    for candidate in range(FIRST_PORT, LAST_PORT) if port is None else [port]:
        listener = socket.socket()
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((LOOPBACK, candidate))
            listener.listen(128)
            listener.setblocking(False)
        except (OSError, OverflowError):
            listener.close()
        else:
            return listener
    asked = f"every port from {FIRST_PORT} to {LAST_PORT}" if port is None else f"port {port}"
    raise SpaceArmError(f"{asked} of {LOOPBACK} is in use or not allowed; give another with port=")
