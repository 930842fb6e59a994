"""Notebooks: the scene in the output of a cell, and over it the live page while it is served."""

from __future__ import annotations

import html
import json
import secrets

from spacearm.viewer.window import PAGE


def embedded(scene: str, invitation: str | None) -> str:
    """Return what stands in the output of a cell.

    The scene needs no server and stays in saved notebooks. The live page takes its place once it
    has told that it is drawn; where it is not reached, may not be framed or has ended, and where
    a notebook is not trusted to run scripts, the scene stays.

    Args:
        scene: A self-contained page.
        invitation: Address that leads to the live page once; None if it is not served.
    """
    quoted = html.escape(scene)
    if invitation is None:
        style = "width: 100%; height: 560px; border: 0"
        return f'<iframe title="spacearm" srcdoc="{quoted}" style="{style}"></iframe>'
    text = (PAGE / "notebook.html").read_text(encoding="utf-8")
    name = f"spacearm-{secrets.token_hex(8)}"
    for mark, words in (("NAME", name), ("INVITATION", json.dumps(invitation)), ("SCENE", quoted)):
        text = text.replace(f"${mark}", words)
    return text
