"""Which texts of a figure touch each other, and which leave it."""

from itertools import combinations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

TOUCH = 0.5
"""Overlap [px] that nobody sees."""


def drawn_texts(figure, monkeypatch):
    """Draw a figure; return its texts as they stand there, and the corners (4, 2) of each [px]."""
    found, draw = [], Text.draw

    def recorded(text, renderer, *args, **options):
        draw(text, renderer, *args, **options)
        if text.get_visible() and text.get_text().strip():
            found.append((text.get_text().strip(), _corners(text, renderer)))

    with monkeypatch.context() as patch:
        patch.setattr(Text, "draw", recorded)
        FigureCanvasAgg(figure).draw()
    return found


def touching(figure, monkeypatch):
    """Return the pairs of texts that overlap each other."""
    texts = drawn_texts(figure, monkeypatch)
    return [(a, b) for (a, at), (b, there) in combinations(texts, 2) if not _apart(at, there)]


def outside(figure, monkeypatch):
    """Return the texts that leave the figure."""
    size = figure.bbox.size + 1.0
    texts = drawn_texts(figure, monkeypatch)
    return [text for text, at in texts if (at < -1.0).any() or (at > size).any()]


def _corners(text, renderer):
    """Return the corners of a text, which may be turned; its box is the one around it."""
    box, angle = Text.get_window_extent(text, renderer), np.radians(text.get_rotation())
    text.set_rotation(0.0)
    half = Text.get_window_extent(text, renderer).size / 2.0
    text.set_rotation(np.degrees(angle))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return (signs * half) @ turn.T + 0.5 * (box.p0 + box.p1)


def _apart(one, other):
    """Return whether a line separates two rectangles."""
    for edges in (one, other):
        for normal in (edges[1] - edges[0], edges[2] - edges[1]):
            n = normal / (np.linalg.norm(normal) or 1.0)
            a, b = one @ n, other @ n
            if a.max() <= b.min() + TOUCH or b.max() <= a.min() + TOUCH:
                return True
    return False
