"""Files: written beside their place and renamed, so that no half file is ever there; models."""

from __future__ import annotations

import tempfile
from pathlib import Path

from spacearm.errors import SpaceArmError


def models_folder() -> Path:
    """Where the models are: in the installed package, or beside it in a source tree."""
    package = Path(__file__).resolve().parent
    installed = package / "models"
    return installed if installed.is_dir() else package.parent / "models"


def write(path: Path, content: bytes) -> Path:
    """Writes a file, whole or not at all.

    Raises:
        SpaceArmError: It cannot be written.
    """
    beside: Path | None = None
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".", delete=False) as file:
            beside = Path(file.name)
            file.write(content)
        beside.chmod(0o644)
        beside.replace(path)
    except OSError as error:
        if beside:
            beside.unlink(missing_ok=True)
        raise SpaceArmError(f"{path} cannot be written: {error.strerror}") from None
    return path
