"""Viewer: the scene on show, in the browser, in a notebook, in files and pictures."""

from __future__ import annotations

import html
import os
import tempfile
import threading
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import ConfigurationError, unknown
from spacearm.files import write
from spacearm.model.configuration import Configuration
from spacearm.motion.motion import Motion
from spacearm.viewer.panel.choices import chosen, offered
from spacearm.viewer.panel.comparison import WORDS, Comparison, compared
from spacearm.viewer.panel.joint_map import joint_map
from spacearm.viewer.panel.motions import account
from spacearm.viewer.panel.opening import opening_posture
from spacearm.viewer.pictures import render
from spacearm.viewer.scene import LAYERS
from spacearm.viewer.server import Server
from spacearm.viewer.session import Session, number
from spacearm.viewer.stage import Stage
from spacearm.viewer.window import Window

SHELL_COLORS = (0x56B4E9, 0xD55E00, 0x009E73, 0xCC79A7)


class Viewer:
    """A scene of one arm: in the browser, in a notebook, in a file.

    Attributes:
        window: The drawing.
    """

    def __init__(self, cfg: Configuration, motion: Motion | None = None) -> None:
        self.window = Window()
        self._lock = threading.RLock()
        self._server: Server | None = None
        self._edition = 0
        self._stage = Stage(self.window, Session(cfg.arm, cfg), motion)
        self._given: Comparison | None = None

    @property
    def session(self) -> Session:
        """The configuration on show, and how the panel moves it."""
        return self._stage.session

    def _change_arm(self, message: dict[str, Any]) -> None:
        """Show the arm that the page asks for, in the present posture if it has the same joints."""
        before = self.session
        with tempfile.TemporaryDirectory() as folder:
            arm, origin, said = chosen(before.cfg, before.origin, message, Path(folder))
            arm.require_one_tip()
            same = arm.joint_names == before.arm.joint_names
            q = before.cfg.q if same else opening_posture(arm)
            session = Session(arm, arm.at(q, base=before.cfg.base if same else None), origin)
            session.mode, session.note = before.mode, said
            with self.window.replaced():
                self._stage = Stage(self.window, session)
        self._given = None
        self._edition += 1

    # --- what is shown ----------------------------------------------------------------------

    def show(self, q: npt.ArrayLike, *, base: pin.SE3 | None = None) -> None:
        """Show another configuration.

        Args:
            q: (n,) joint positions [rad] or [m].
            base: Pose of the spacecraft; the present one if None.

        Raises:
            ConfigurationError: q or base has the wrong shape or is not finite.
        """
        with self._lock:
            cfg = self.session.cfg
            self.session.show(cfg.arm.at(q, base=cfg.base if base is None else base))
        self._changed()

    def compare(self, other: Any) -> None:
        """Play another motion in step with the present one, as a ghost.

        Args:
            other: The motion, or a mode: "free-floating", "attitude-controlled" or "fixed" is the
                same joint motion with the spacecraft doing that. None ends the comparison.

        Raises:
            ConfigurationError: It is neither, or no motion plays.
            UnsupportedError: The wheels hold momentum.
        """
        with self._lock:
            if not (motion := self._stage.motion):
                raise ConfigurationError("there is no motion to compare; view one")
            found = None if other is None else compared(motion, other)
            if found and not isinstance(other, str):
                self._given = found
            self._stage.compare(found)
        self._changed()

    def _compare_with(self, asked: object) -> None:
        """Compare the motion with what the page names: a mode, what was given, or nothing."""
        if asked == "given" and self._given:
            self.compare(self._given.motion)
        else:
            self.compare(str(asked) if asked else None)

    @property
    def configuration(self) -> Configuration:
        """The configuration on show, moved in the page or by `show`."""
        with self._lock:
            return self.session.cfg

    @property
    def q(self) -> Array:
        """(n,) joint positions on show [rad] or [m]."""
        return self.configuration.q.copy()

    def shells(self, radii: Sequence[float]) -> None:
        """Draw translucent spheres about the system CM.

        Args:
            radii: Radii [m].

        Raises:
            ConfigurationError: A radius is not positive and finite.
        """
        colors = [SHELL_COLORS[i % len(SHELL_COLORS)] for i in range(len(radii))]
        for radius in radii:
            if not 0.0 < radius < np.inf:
                raise ConfigurationError(f"shell radius is {radius}; give a positive length")
        self._stage.scene.shells(list(zip(radii, colors, strict=True)))
        self._changed()

    def layer(self, name: str, visible: bool) -> None:
        """Show or hide a layer, one of `spacearm.viewer.scene.LAYERS`.

        Raises:
            ConfigurationError: There is no such layer.
        """
        if name not in LAYERS:
            raise ConfigurationError(unknown("layer", name, LAYERS))
        self._stage.show_layer(name, visible)
        self._changed()

    def _changed(self) -> None:
        if self._server:
            self._server.refresh()
        else:
            self.draw()

    # --- the panel (see server.Panel) -------------------------------------------------------

    def handle(self, message: object) -> dict[str, Any] | None:
        """Do what a message of the page asks; return what the one who asked is told."""
        with self._lock:
            kind = message.get("do") if isinstance(message, dict) else None
            if isinstance(message, dict) and kind == "layer":
                self.layer(str(message.get("name")), bool(message.get("visible")))
            elif isinstance(message, dict) and kind == "time" and self._stage.motion:
                self._stage.seek(number(message.get("t"), "time"))
            elif isinstance(message, dict) and kind == "compare":
                self._compare_with(message.get("with"))
            elif kind == "motion":
                return {"motion": self._told_motion()}
            elif isinstance(message, dict) and kind == "arm":
                self._change_arm(message)
            elif isinstance(message, dict) and kind == "map":
                return {"map": joint_map(self.session.cfg, message.get("joints"))}
            else:
                self.session.handle(message)
        return None

    def readout(self) -> dict[str, Any]:
        """Return what the panel shows of the configuration."""
        with self._lock:
            stage = self._stage
            state = {"hidden": sorted(stage.hidden), "t": stage.time, "played": stage.played}
            return {**self.session.readout(), **state, "edition": self._edition}

    def draw(self) -> None:
        """Draw the configuration."""
        with self._lock:
            self._stage.draw()

    def about(self) -> dict[str, Any]:
        """Return what the page needs once."""
        session = self.session
        more = {"layers": LAYERS, "motion": self._told_motion(), "edition": self._edition}
        return {**session.about(), **more, "choices": offered(session.arm, session.origin)}

    def _told_motion(self) -> dict[str, Any] | None:
        """Return what the page needs of the motion, and what it can be compared with."""
        if not (motion := self._stage.motion):
            return None
        ways = {words: mode for mode, words in WORDS.items()}
        given = {} if self._given is None else {self._given.name: "given"}
        return {**account(motion, self._stage.other), "ways": {**ways, **given}}

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

    def _served(self, port: int | None) -> Server:
        if self._server is None:
            self._server = Server(self, port)
        return self._server

    def close(self) -> None:
        """End the server and free its port; files and pictures can still be made."""
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

    def _repr_html_(self) -> str:
        """Embed the scene in a notebook as a page of its own, which stays without a server."""
        source = html.escape(self.html())
        style = "width: 100%; height: 480px; border: 0"
        return f'<iframe srcdoc="{source}" style="{style}"></iframe>'

    def __repr__(self) -> str:
        return f"Viewer({self.session.arm.name}, {self.url or 'not served'})"
