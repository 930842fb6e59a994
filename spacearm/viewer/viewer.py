"""Viewer: the scene on show, in the browser, in a notebook, in files and pictures."""

from __future__ import annotations

import math
import os
import webbrowser
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np

from spacearm.arrays import positive
from spacearm.errors import ConfigurationError
from spacearm.files import name_part, write, write_by
from spacearm.model.arm import Configuration
from spacearm.motion.motion import Motion
from spacearm.viewer.host import Host
from spacearm.viewer.layers.still import still
from spacearm.viewer.notebooks import embedded
from spacearm.viewer.pictures import render, render_frames
from spacearm.viewer.server import Server

MOST_PICTURES = 3000
"""Largest number of pictures of a motion."""


class Viewer(Host):
    """A scene of one arm: in the browser, in a notebook, in a file.

    Attributes:
        window: The drawing.
    """

    def __init__(self, cfg: Configuration, motion: Motion | None = None) -> None:
        self._server: Server | None = None
        super().__init__(cfg, motion)

    # --- in the browser ---------------------------------------------------------------------

    @property
    def url(self) -> str | None:
        """Address of the page, with the token that opens it; None while it is not served."""
        return self._server.url if self._server else None

    def serve(self, port: int | None = None) -> str:
        """Serve the page on 127.0.0.1, to those who have its address: there is a token in it.

        Args:
            port: The port; the first free one from 7400 on if None.

        Returns:
            Its address.

        Raises:
            SpaceArmError: The port is in use.
        """
        return self._served(port).url

    def open(self, port: int | None = None) -> None:
        """Serve the page and open it in the browser; arguments and errors as for `serve`."""
        webbrowser.open(self._served(port).invitation())

    def _changed(self) -> None:
        """Send the present state to the browsers, or draw it."""
        if self._server:
            self._server.refresh()
        else:
            super()._changed()

    def _served(self, port: int | None) -> Server:
        if self._server is None:
            self._server = Server(self, port)
        return self._server

    def close(self) -> None:
        """End the server and free its port; files and pictures can still be made."""
        self._job.cancel()
        if self._server:
            self._server.close()
            self._server = None

    # --- to keep ----------------------------------------------------------------------------

    def html(self) -> str:
        """Return one self-contained page with the scene as it is, or with the whole motion.

        A motion has at least 30 frames a second, but at most 9000 in all, evenly spread. Between
        them the page interpolates.
        """
        with self._lock:
            self.draw()
            self._stage.animate()
            about = {"about": self.about(), "readout": self.readout()}
            return self.window.static_html(f"{self.session.arm.name} - spacearm", about)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write `html` to a file, whole or not at all.

        Returns:
            The path.

        Raises:
            SpaceArmError: The file cannot be written.
        """
        return write(Path(path), self.html().encode("utf-8"))

    def png(
        self, path: str | os.PathLike[str], size: tuple[int, int] = (1200, 800), scale: int = 1
    ) -> Path:
        """Render the scene to a PNG picture, by a headless browser on this machine.

        Args:
            path: The file to write.
            size: Width and height of the page [px].
            scale: Device pixels per page pixel.

        Returns:
            The path.

        Raises:
            SpaceArmError: No browser is found, it draws nothing in two minutes, or the file cannot
                be written.
        """
        return write(Path(path), render(self.html(), size, scale))

    def frames(
        self,
        path: str | os.PathLike[str],
        size: tuple[int, int] = (1200, 800),
        per_second: float = 30.0,
        progress: Callable[[int, int], object] | None = None,
    ) -> Path:
        """Render the motion to PNG pictures in a ZIP archive, by a headless browser.

        The pictures are evenly spread from the start of the motion to its end, and numbered from 1.
        Some thirty of them are in memory at a time; the archive is there once it is whole.

        Args:
            path: The archive to write.
            size: Width and height of the pictures [px].
            per_second: Pictures for each second of the motion.
            progress: Called with the number of pictures written and how many there will be.

        Returns:
            The path.

        Raises:
            ConfigurationError: There is no motion, `per_second` is not positive, or there would be
                over 3000 pictures.
            SpaceArmError: No browser is found, it does not draw them all, or the file cannot be
                written.
        """
        if not self._stage.motion:
            raise ConfigurationError("there is no motion to take pictures of; view one")
        first, last = self._stage.span
        rate = positive(per_second, "per_second", "pictures for each second")
        count = math.ceil((last - first) * rate) + 1
        if count > MOST_PICTURES:
            raise ConfigurationError(
                f"{last - first:.4g} s with per_second={rate:g} make {count:,} pictures; take at "
                f"most {MOST_PICTURES}"
            )
        times = np.linspace(first, last, count).tolist()
        name = name_part(self.session.arm.name)

        def fill(file: BinaryIO) -> None:
            with zipfile.ZipFile(file, "w") as archive:  # PNG is compressed already
                for i, picture in enumerate(render_frames(self.html(), size, times), 1):
                    archive.writestr(f"{name}_{i:04}.png", picture)
                    if progress:
                        progress(i, count)

        return write_by(Path(path), fill)

    def _repr_html_(self) -> str:
        """Stand in a notebook: live while it is served, and a scene of its own once it is not."""
        with self._lock:
            scene, cfg, shapes = self.html(), self.configuration, self._stage.scene.shapes
            picture = still(cfg, shapes, self.about()["view"])
        invitation = self._server.invitation() if self._server else None
        return embedded(scene, picture, cfg.arm.name, invitation)

    def __repr__(self) -> str:
        return f"Viewer({self.session.arm.name}, {self.url or 'not served'})"
