"""Work: one chunk done, in whatever process."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

from spacearm.store import Store
from spacearm.study import Chunk, Recipe, remade

Outcome = Literal["kept", "computed"]


def do(recipe: Recipe, path: str, chunk: Chunk) -> Outcome:
    """Computes a chunk and writes it, unless it is there and sound.

    Returns:
        Which of the two was the case.

    Raises:
        StoreError: The store cannot be read or written.
    """
    store = _store(recipe, path)
    if store.is_done(chunk):
        return "kept"
    store.write(chunk, store.study.compute(chunk))
    return "computed"


@lru_cache(maxsize=4)
def _store(recipe: Recipe, path: str) -> Store:
    return Store(path, remade(recipe))
