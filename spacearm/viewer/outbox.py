"""Outbox: what a browser has yet to be sent, bounded by what there is to show."""

from __future__ import annotations

from typing import NamedTuple


class Key(NamedTuple):
    """What a message is about; a later one about the same replaces one that still waits.

    Attributes:
        path: The node of the scene, one name a level; empty for the panel.
        what: The kind of message, or the property of the node.
    """

    path: tuple[str, ...]
    what: str


DELETE = "delete"
"""Kind of the message that a node is gone, with all below it."""
BUNDLE = 50_000
"""Size from which drawing commands are no more sent together [bytes]."""


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
            depth = len(key.path)
            kept = self._waiting.items()
            self._waiting = {k: m for k, m in kept if k.path[:depth] != key.path}
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
