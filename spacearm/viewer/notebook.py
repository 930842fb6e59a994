"""Notebook: whether code runs in one."""

from __future__ import annotations

import sys


def in_notebook() -> bool:
    """Whether an IPython kernel runs this code."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and hasattr(shell, "kernel")
