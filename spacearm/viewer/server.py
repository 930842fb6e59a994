"""Server: one page on one port of this machine, with one WebSocket for scene and panel.

Binary messages to the browser are drawing commands of meshcat, as `Outbox.take` packs them; text
messages are JSON, readouts and errors for the panel. Text messages from the browser are requests of
the panel.

Whoever has the address has the token in it, which is new for each server: other users of this
machine, other pages, and tabs that another server left open get no further than the door.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
import threading
import time
from contextlib import suppress
from typing import Any, Protocol

import tornado.httpserver
import tornado.iostream
import tornado.web
import tornado.websocket
from numpy.linalg import LinAlgError

from spacearm.errors import SpaceArmError
from spacearm.viewer.window import LIBRARIES, PAGE, Key, Outbox, Window

LOOPBACK = "127.0.0.1"
FIRST_PORT, LAST_PORT = 7400, 7500


def listen(port: int | None) -> socket.socket:
    """Open a socket on the port asked for, or on the first free one of spacearm's range or at all.

    A notebook may show more scenes than the range has ports.
    """
    ports = [*range(FIRST_PORT, LAST_PORT), 0] if port is None else [port]
    for candidate in (number for number in ports if 0 <= number < 2**16):
        with suppress(OSError):
            listener = socket.create_server((LOOPBACK, candidate), backlog=128)
            listener.setblocking(False)
            return listener
    asked = "every port" if port is None else f"port {port}"
    raise SpaceArmError(f"{asked} of {LOOPBACK} is in use or not allowed; give another with port=")


#: Size of the body of a request, and of a message of the page, which may bring a file [bytes].
LARGEST_BODY, LARGEST_MESSAGE = 100_000, 2_000_000
#: Time that a request may take to come in [s].
SLOWEST = 30.0
#: Time for which messages are collected before the scene is drawn once for all of them [s].
PAUSE = 0.001
#: Time for which a ticket is valid [s]: notebooks, where it stands, can be read by others.
PATIENCE = 120.0
#: Pages that may frame the page: those of this machine.
FRAMED_BY = " ".join(f"{way}://{host}:*" for way in ("http", "https")
                     for host in (LOOPBACK, "localhost"))  # fmt: skip


class Panel(Protocol):
    """The interface of what the server shows."""

    window: Window

    def handle(self, message: object, client: object) -> dict[str, Any] | None:
        """Do what a message of a client asks, and return what else it is sent.

        Raises:
            SpaceArmError: It cannot be done.
        """

    def left(self, client: object) -> None:
        """End what was begun for a client that is gone."""

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
        url: Address of the page, with the token.

    Raises:
        SpaceArmError: The port is in use.
    """

    def __init__(self, panel: Panel, port: int | None = None) -> None:
        listener = listen(port)
        self.port = int(listener.getsockname()[1])
        self._token = secrets.token_urlsafe(16)
        self._tickets: dict[str, float] = {}
        self.url = f"http://{LOOPBACK}:{self.port}/?token={self._token}"
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

    def invitation(self) -> str:
        """Return an address that leads to the page once, within `PATIENCE`.

        Other users see the command that starts a browser, and the address in it.
        """
        now = time.monotonic()
        for ticket, end in list(self._tickets.items()):  # the server's thread redeems some
            if end <= now:
                self._tickets.pop(ticket, None)
        ticket = secrets.token_urlsafe(16)
        self._tickets[ticket] = now + PATIENCE
        return f"http://{LOOPBACK}:{self.port}/?ticket={ticket}"

    def admits(self, token: str) -> bool:
        """Whether this is the token of the server."""
        return secrets.compare_digest(token.encode(), self._token.encode())

    def redeem(self, ticket: str) -> bool:
        """Whether this is a ticket of the server; it can be used once."""
        return time.monotonic() < self._tickets.pop(ticket, 0.0)

    def refresh(self) -> None:
        """Draw the state and send it to every browser, soon, and once for many calls."""
        self._loop.call_soon_threadsafe(self._mark_stale)

    async def _serve(self, listener: socket.socket) -> None:
        options = {"server": self, "hosts": {f"{LOOPBACK}:{self.port}", f"localhost:{self.port}"}}
        own = {path.name: path for path in (*PAGE.glob("*.js"), *PAGE.glob("*.css"))}
        application = tornado.web.Application([
            (r"/", _Page, options),
            (r"/socket", _Socket, options),
            *((f"/({name})", _File, {**options, "path": path})
              for name, path in (own | LIBRARIES).items()),
        ], websocket_max_message_size=LARGEST_MESSAGE, log_function=lambda _: None)  # fmt: skip
        server = tornado.httpserver.HTTPServer(
            application,
            max_body_size=LARGEST_BODY,
            max_buffer_size=2 * LARGEST_MESSAGE,
            idle_connection_timeout=SLOWEST,
            body_timeout=SLOWEST,
        )
        server.add_socket(listener)
        await self._stop.wait()
        server.stop()
        for browser in list(self._browsers):
            browser.hang_up()
        await server.close_all_connections()

    # --- in the server's thread -------------------------------------------------------------

    def opened(self, browser: _Socket) -> None:
        """Send everything to a new browser."""
        self._panel.draw()
        self._browsers.add(browser)
        browser.tell({"about": self._panel.about(), "readout": self._panel.readout()})
        for i, data in enumerate(self._panel.window.commands()):
            browser.draw(Key((), f"scene {i}"), data)
        browser.tell({"complete": True})

    def closed(self, browser: _Socket) -> None:
        """Forget a browser, and end what it has asked for."""
        self._browsers.discard(browser)
        self._panel.left(browser)

    def received(self, browser: _Socket, text: str | bytes) -> None:
        """Do what a browser asks, or send it the error."""
        try:
            if answer := self._panel.handle(json.loads(text), browser):
                browser.tell(answer)
        except SpaceArmError as error:
            browser.tell({"error": str(error)})
        except LinAlgError as error:
            browser.tell({"error": f"the posture is singular ({error}); move another joint first"})
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
        for browser in list(self._browsers):
            browser.tell({"drawn": readout["t"]})

    def _draw(self, key: Key, data: bytes) -> None:
        for browser in list(self._browsers):
            browser.draw(key, data)

    def _broadcast(self, key: Key, data: bytes) -> None:
        """Pass a drawing command on, from any thread."""
        if threading.current_thread() is self._thread:
            self._draw(key, data)
        else:
            self._loop.call_soon_threadsafe(self._draw, key, data)


class _Door(tornado.web.RequestHandler):
    """Refuses host names that are not this machine's, against DNS rebinding by other pages."""

    def initialize(self, server: Server, hosts: set[str], path: Any = None) -> None:
        self._server, self._hosts, self._path = server, hosts, path

    def prepare(self) -> None:
        if self.request.host not in self._hosts:
            raise tornado.web.HTTPError(403, reason="this host name is not served")

    def set_default_headers(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Security-Policy", f"frame-ancestors {FRAMED_BY}")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("X-Content-Type-Options", "nosniff")

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        """Log faults of this program; refused requests may hold anything, and say nothing here."""
        if not isinstance(error, tornado.web.HTTPError):
            super().log_exception(kind, error, trace)

    def _has_token(self) -> bool:
        return self._server.admits(self.get_query_argument("token", ""))


class _File(_Door):
    """A file of the package, which is not secret."""

    def get(self, name: str) -> None:
        kind = {"css": "text/css", "js": "text/javascript"}[name.rpartition(".")[2]]
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.write(self._path.read_bytes())


class _Page(_Door):
    """The page, for those who have its token; a ticket is exchanged for the token."""

    def get(self) -> None:
        if self._server.redeem(self.get_query_argument("ticket", "")):
            self.redirect(self._server.url)
            return
        known = self._has_token()
        self.set_status(200 if known else 403)
        self.write((PAGE / ("index.html" if known else "ended.html")).read_bytes())


class _Socket(_Door, tornado.websocket.WebSocketHandler):
    """The connection to one browser."""

    def prepare(self) -> None:
        """Refuse other pages: the framework asks `check_origin` only for what it takes for one."""
        super().prepare()
        if not self._has_token():
            raise tornado.web.HTTPError(403, reason="the token is not that of this server")
        for header in ("Origin", "Sec-WebSocket-Origin"):
            if not all(map(self.check_origin, self.request.headers.get_list(header))):
                raise tornado.web.HTTPError(403, reason="pages of other origins are not served")

    def check_origin(self, origin: str) -> bool:
        return origin in {f"http://{host}" for host in self._hosts}

    def open(self, *_: str, **__: str) -> None:
        self.set_nodelay(True)
        self._outbox = Outbox()
        self._sending: asyncio.Task[None] | None = None
        self._server.opened(self)

    def on_message(self, message: str | bytes) -> None:
        self._server.received(self, message)

    def on_close(self) -> None:
        self._server.closed(self)

    def tell(self, content: dict[str, Any]) -> None:
        """Send the panel a message; a later one with the same first key replaces it."""
        self._post(Key((), next(iter(content))), json.dumps(content, allow_nan=False))

    def draw(self, key: Key, data: bytes) -> None:
        """Send the scene a drawing command."""
        self._post(key, data)

    def hang_up(self) -> None:
        """Close the connection; a browser that does not read gets no farewell."""
        connection, sending = self.ws_connection, self._sending
        self.close(1001, "spacearm has ended")
        if sending and not sending.done():
            sending.cancel()
            if connection and connection.stream:
                connection.stream.close()

    def _post(self, key: Key, message: str | bytes) -> None:
        self._outbox.put(key, message)
        if self._sending is None or self._sending.done():
            self._sending = asyncio.ensure_future(self._send())

    async def _send(self) -> None:
        """Send what waits, each message when the one before is on its way."""
        gone = (tornado.websocket.WebSocketClosedError, tornado.iostream.StreamClosedError)
        with suppress(*gone):  # a tab that is closed tells the server by on_close
            while (message := self._outbox.take()) is not None:
                await self.write_message(message, isinstance(message, bytes))
