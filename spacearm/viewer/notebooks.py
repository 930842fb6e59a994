"""Notebooks: the scene in the output of a cell, and over it the live page while it is served."""

from __future__ import annotations

import base64
import html
import json
import re
import secrets

from spacearm.viewer.window import PAGE


def embedded(scene: str, picture: bytes, name: str, invitation: str | None) -> str:
    """Return what stands in the output of a cell.

    The scene needs no server and stays in saved notebooks. The live page takes its place once it
    has told that it is drawn; where it is not reached, may not be framed or has ended, the scene
    stays. Where a notebook is not trusted and its frames are taken out, the picture stays.

    Args:
        scene: A self-contained page.
        picture: PNG picture of the scene.
        name: Name of the arm.
        invitation: Address that leads to the live page once; None if it is not served.
    """
    text = (PAGE / "notebook.html").read_text(encoding="utf-8")
    if invitation is None:
        text = text.partition("<script>")[0]
    parts = {
        "NAME": f"spacearm-{secrets.token_hex(8)}",
        "ARM": html.escape(name),
        "PICTURE": base64.b64encode(picture).decode(),
        "INVITATION": json.dumps(invitation),
        "SCENE": html.escape(scene),
    }
    return re.sub(rf"\$({'|'.join(parts)})", lambda mark: parts[mark[1]], text)
