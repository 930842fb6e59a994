"""Pictures: pages rendered by a headless browser of this machine."""

from __future__ import annotations

import base64
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from spacearm.errors import SpaceArmError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
HEADLESS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-background-networking", "--no-first-run",
    "--disable-sync", "--disable-component-update", "--hide-scrollbars",
    "--virtual-time-budget=4000",
)  # fmt: skip
RENDERING, EACH = 120.0, 5.0
"""Longest time that a picture may take, and each further one of a motion [s]."""
AT_ONCE = 30
"""Pictures of a motion that are made, and held in memory, at a time."""
FRAME = re.compile(rb'class="frame" src="data:image/png;base64,([A-Za-z0-9+/=]+)"')


def render(page: str, size: tuple[int, int], scale: int) -> bytes:
    """Render the drawing of a saved page to a PNG picture.

    Args:
        page: The page.
        size: Width and height [px].
        scale: Device pixels per page pixel.

    Raises:
        SpaceArmError: No browser is found, or it draws nothing in `RENDERING`.
    """
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder, "scene.png")
        options = (f"--screenshot={picture}", f"--force-device-scale-factor={scale}")
        run = _browse(page, "picture", size, options, Path(folder), RENDERING)
        if not picture.is_file():
            raise SpaceArmError(f"the browser drew nothing: {run.stderr.decode()[-300:]}")
        return picture.read_bytes()


def render_frames(page: str, size: tuple[int, int], times: Sequence[float]) -> Iterator[bytes]:
    """Render the motion of a saved page to PNG pictures, `AT_ONCE` by each start of the browser.

    Args:
        page: The page.
        size: Width and height [px].
        times: When [s].

    Raises:
        SpaceArmError: No browser is found, or it draws nothing in `RENDERING` and `EACH`.
    """
    for first in range(0, len(times), AT_ONCE):
        some = times[first : first + AT_ONCE]
        with tempfile.TemporaryDirectory() as folder:
            longest = RENDERING + EACH * len(some)
            wanted = f"frames={size[0]},{size[1]},{','.join(map(repr, some))}"
            run = _browse(page, wanted, size, ("--dump-dom",), Path(folder), longest)
        found = FRAME.findall(run.stdout)
        if len(found) != len(some):
            raise SpaceArmError(
                f"the browser drew {first + len(found)} of {len(times)} pictures: "
                f"{run.stderr.decode()[-300:]}"
            )
        yield from map(base64.b64decode, found)


def _browse(
    page: str,
    fragment: str,
    size: tuple[int, int],
    options: tuple[str, ...],
    folder: Path,
    longest: float,
) -> subprocess.CompletedProcess[bytes]:
    """Open a page in a headless browser, which ends when it has drawn it.

    Raises:
        SpaceArmError: No browser is found, or it takes too long.
    """
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        raise SpaceArmError(
            f"no browser to render with; install one of {', '.join(BROWSERS)} "
            "(Debian: apt-get install chromium), or use .save(path) and open the page"
        )
    file = folder / "scene.html"
    file.write_text(page, encoding="utf-8")
    window = (f"--user-data-dir={folder}/profile", f"--window-size={size[0]},{size[1]}")
    command = [browser, *HEADLESS, *window, *options, f"{file.as_uri()}#{fragment}"]
    try:
        return subprocess.run(command, capture_output=True, timeout=longest, check=False)
    except subprocess.TimeoutExpired:
        raise SpaceArmError(
            f"{browser} has not drawn the picture after {longest:g} s; use .save(path) "
            "and open the page"
        ) from None
