"""Viewer: the scene on show, in the browser, in a notebook, in files and pictures."""

from __future__ import annotations

import html
import math
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
from spacearm.singularities.report import singularity
from spacearm.viewer.layers.loads import LoadLayer
from spacearm.viewer.layers.obstacles import ObstacleLayer
from spacearm.viewer.panel.choices import chosen, offered
from spacearm.viewer.panel.joint_map import joint_map
from spacearm.viewer.panel.motions import account
from spacearm.viewer.panel.opening import opening_posture
from spacearm.viewer.pictures import render
from spacearm.viewer.recorder import FRAMES_PER_SECOND, Recorder
from spacearm.viewer.scene import LAYERS, Scene
from spacearm.viewer.server import Server
from spacearm.viewer.session import Session, number
from spacearm.viewer.window import Window

MOST_FRAMES = 9000
"""Largest number of frames of a motion in a page; each takes some kilobytes."""
SHELL_COLORS = (0x56B4E9, 0xD55E00, 0x009E73, 0xCC79A7)


class Viewer:
    """A scene of one arm: in the browser, in a notebook, in a file.

    Attributes:
        session: The configuration on show, and how the panel moves it.
        window: The drawing.
    """

    def __init__(self, cfg: Configuration, motion: Motion | None = None) -> None:
        self.window = Window()
        self._lock = threading.RLock()
        self._server: Server | None = None
        self._edition = 0
        self._start(Session(cfg.arm, cfg), motion)

    def _start(self, session: Session, motion: Motion | None = None) -> None:
        """Show an arm in place of the present one, if there is one."""
        self._scene = Scene(self.window, session.arm)
        self.session, self._motion = session, motion
        self._hidden: set[str] = set()
        self._time = float(motion.t[0]) if motion else 0.0
        root, moved = self._scene.root, getattr(motion, "obstacles", ())
        self._obstacles = ObstacleLayer(root["obstacles"], moved)
        self._loads = LoadLayer(root, session.cfg, motion, self._scene.size)
        self.draw()
        if motion:
            self._scene.show_motion(motion)

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
                self._start(session)
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
        self._scene.shells(list(zip(radii, colors, strict=True)))
        self._changed()

    def layer(self, name: str, visible: bool) -> None:
        """Show or hide a layer, one of `spacearm.viewer.scene.LAYERS`.

        Raises:
            ConfigurationError: There is no such layer.
        """
        if name not in LAYERS:
            raise ConfigurationError(unknown("layer", name, LAYERS))
        self._hidden = self._hidden - {name} if visible else self._hidden | {name}
        self._scene.show_layer(name, visible)
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
            elif isinstance(message, dict) and kind == "time" and self._motion:
                self._seek(self._motion, message.get("t"))
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
            more = {"hidden": sorted(self._hidden), "t": self._time, "edition": self._edition}
            return {**self.session.readout(), **more}

    def draw(self) -> None:
        """Draw the configuration."""
        with self._lock:
            self._scene.draw(self.session.cfg, self.session.report)
            self._obstacles.draw(self._time)
            self._loads.draw(self.session.cfg, self._time)

    def about(self) -> dict[str, Any]:
        """Return what the page needs once."""
        motion = account(self._motion) if self._motion else None
        more = {"layers": LAYERS, "motion": motion, "edition": self._edition}
        return {
            **self.session.about(),
            **more,
            "choices": offered(self.session.arm, self.session.origin),
        }

    def _seek(self, motion: Motion, t: object) -> None:
        self._time = float(np.clip(number(t, "time"), motion.t[0], motion.t[-1]))
        self.session.show(motion.at(self._time))

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
            if self._motion:
                self._animate(self._motion)
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

    # --- motions ----------------------------------------------------------------------------

    def _animate(self, motion: Motion) -> None:
        """Record the motion into the window."""
        first, last = float(motion.t[0]), float(motion.t[-1])
        recorder = Recorder()
        self.window.recorder = recorder
        try:
            frames = min(math.ceil((last - first) * FRAMES_PER_SECOND) + 1, MOST_FRAMES)
            for t in np.linspace(first, last, frames):
                recorder.frame = float(t - first) * FRAMES_PER_SECOND
                cfg = motion.at(float(t))
                self._scene.draw(cfg, singularity(cfg))
                self._obstacles.draw(float(t))
                self._loads.draw(cfg, float(t))
        finally:
            self.window.recorder = None
        self.window.send(recorder)
