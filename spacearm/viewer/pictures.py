"""Pictures: a page rendered by a headless browser of this machine."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from spacearm.errors import SpaceArmError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
HEADLESS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-background-networking", "--no-first-run",
    "--disable-sync", "--disable-component-update", "--hide-scrollbars",
    "--virtual-time-budget=4000",
)  # fmt: skip
RENDERING = 120.0
"""Longest time that a picture may take [s]."""


def render(page: str, size: tuple[int, int], scale: int) -> bytes:
    """Render the drawing of a saved page to a PNG picture.

    Args:
        page: The page.
        size: Width and height [px].
        scale: Device pixels per page pixel.

    Raises:
        SpaceArmError: No browser is found, or it draws nothing in `RENDERING`.
    """
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        raise SpaceArmError(
            f"no browser to render with; install one of {', '.join(BROWSERS)} "
            "(Debian: apt-get install chromium), or use .save(path) and open the page"
        )
    with tempfile.TemporaryDirectory() as folder:
        file, picture = Path(folder, "scene.html"), Path(folder, "scene.png")
        file.write_text(page, encoding="utf-8")
        options = [
            *HEADLESS, f"--user-data-dir={folder}/profile", f"--screenshot={picture}",
            f"--window-size={size[0]},{size[1]}", f"--force-device-scale-factor={scale}",
        ]  # fmt: skip
        command = [browser, *options, file.as_uri() + "#picture"]
        try:
            run = subprocess.run(command, capture_output=True, timeout=RENDERING, check=False)
        except subprocess.TimeoutExpired:
            raise SpaceArmError(
                f"{browser} has not drawn the picture after {RENDERING:g} s; use .save(path) "
                "and open the page"
            ) from None
        if not picture.is_file():
            raise SpaceArmError(f"{browser} drew nothing: {run.stderr.decode()[-300:]}")
        return picture.read_bytes()
