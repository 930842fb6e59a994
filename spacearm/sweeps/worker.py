"""One chunk computed and written, in any process."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

from spacearm.errors import SpaceArmError, StoreError
from spacearm.sweeps.store import Store
from spacearm.sweeps.study import Chunk, Recipe, remade

Outcome = Literal["kept", "computed"]


def do(recipe: Recipe, path: str, chunk: Chunk) -> Outcome:
    """Compute a chunk and write it, unless it is there and sound.

    Returns:
        "computed", or "kept" if it was there.

    Raises:
        StoreError: The store cannot be read or written, or the study not be made here.
    """
    store = _store(recipe, path)
    if store.is_done(chunk):
        return "kept"
    store.write(chunk, store.study.compute(chunk))
    return "computed"


@lru_cache(maxsize=4)
def _store(recipe: Recipe, path: str) -> Store:
    try:
        study = remade(recipe)
    except SpaceArmError as error:  # it could be made where the sweep began
        raise StoreError(f"a worker cannot make the study: {error}") from None
    return Store(path, study)
