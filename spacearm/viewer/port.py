"""Port: a socket of this machine's own that the page is served on."""

from __future__ import annotations

import socket

from spacearm.errors import SpaceArmError

LOOPBACK = "127.0.0.1"
FIRST_PORT, LAST_PORT = 7400, 7500


def listen(port: int | None) -> socket.socket:
    """Open a socket on the port asked for, or on the first free one of spacearm's range or at all.

    A notebook may show more scenes than the range has ports.
    """
    for candidate in [*range(FIRST_PORT, LAST_PORT), 0] if port is None else [port]:
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
    asked = "every port" if port is None else f"port {port}"
    raise SpaceArmError(f"{asked} of {LOOPBACK} is in use or not allowed; give another with port=")
