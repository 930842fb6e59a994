"""Viewer: the scene on show, in the browser, in a notebook, in files and pictures."""

from __future__ import annotations

import math
import os
import threading
import webbrowser
import zipfile
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pinocchio as pin

from spacearm.arrays import Array, ArrayLike, positive
from spacearm.collisions.obstacles import ObstacleLike, obstacles_of
from spacearm.errors import ConfigurationError, require_known
from spacearm.files import name_part, temporary_folder, write_by
from spacearm.mission.attitudes import FeasibleAttitudes
from spacearm.mission.catch_report import Catch
from spacearm.model.arm import Configuration
from spacearm.motion.flights import Flight
from spacearm.motion.motion import Motion
from spacearm.signatures import checked
from spacearm.viewer.choices import chosen, number, offered
from spacearm.viewer.jobs import BackgroundJob, layer, planning
from spacearm.viewer.layers import LAYERS
from spacearm.viewer.motions import WORDS, Comparison, account, compared
from spacearm.viewer.pictures import VIDEOS, embedded, render, render_frames, still, write_video
from spacearm.viewer.readouts import joint_map
from spacearm.viewer.server import Server
from spacearm.viewer.session import Session, opening_posture
from spacearm.viewer.stage import Stage
from spacearm.viewer.window import Window
from spacearm.workspaces.path_dependent import Workspace

#: Pictures a second that browsers show of a GIF at most.
MOST_OF_GIF = 50.0
#: Largest number of pictures of a motion.
MOST_PICTURES = 3000


@checked
class Viewer:
    """A scene of one arm: in the browser, in a notebook, in a file.

    Attributes:
        window: The drawing.
    """

    def __init__(self, shown: Configuration | Session, motion: Motion | None = None) -> None:
        session = shown if isinstance(shown, Session) else Session(shown.arm, shown)
        self.window = Window()
        self._server: Server | None = None
        self._lock = threading.RLock()
        self._edition = 0
        self._stage = Stage(self.window, session, motion)
        self._given: Comparison | None = None
        self._job = BackgroundJob(self._lock, self._changed, self._finished)
        self._plan: tuple[Motion | None, str] = (None, "")  # the last of the page, and as code
        self._asked = ""  # the code of the one that is searched

    @property
    def session(self) -> Session:
        """The configuration on show, and how the panel moves it."""
        return self._stage.session

    # --- what is shown ----------------------------------------------------------------------

    def show(self, q: ArrayLike, *, base: pin.SE3 | None = None) -> None:
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

    @property
    def configuration(self) -> Configuration:
        """The configuration on show, moved in the page or by `show`."""
        with self._lock:
            return self.session.cfg

    @property
    def q(self) -> Array:
        """(n,) joint positions on show [rad] or [m]."""
        return self.configuration.q.copy()

    def shells(self, radii: Sequence[float] | Workspace) -> None:
        """Draw a workspace cut open, or translucent spheres about the system CM.

        Args:
            radii: The workspace, or radii [m].

        Raises:
            ConfigurationError: A radius is not positive and finite.
        """
        with self._lock:
            if isinstance(radii, Workspace):
                self._stage.show_computed("shells", radii)
            else:
                self._stage.scene.shells([positive(r, "shell radius", "length") for r in radii])
        self._changed()

    def attitudes(self, found: FeasibleAttitudes) -> None:
        """Draw the attitudes of the spacecraft from which the tip can follow a path.

        Args:
            found: What `sa.feasible_attitudes` has found.
        """
        with self._lock:
            self._stage.show_computed("attitudes", found)
        self._changed()

    def target(self, catch: Catch) -> None:
        """Draw the target of the catch that plays, with its grapple frames and the stand-off.

        Args:
            catch: What `sa.catch` has found; `sa.view(catch)` plays its flight.
        """
        with self._lock:
            self._stage.show_target(catch)
        self._changed()

    def layer(self, name: str, visible: bool) -> None:
        """Show or hide a layer, one of `spacearm.viewer.layers.LAYERS`.

        Raises:
            ConfigurationError: There is no such layer.
        """
        require_known("layer", name, LAYERS)
        self._stage.show_layer(name, visible)
        self._changed()

    def obstacles(self, obstacles: ObstacleLike | Sequence[ObstacleLike]) -> None:
        """Draw obstacles besides those of the motion; plans of the page hold them off.

        Args:
            obstacles: As `sa.plan` takes them.

        Raises:
            ConfigurationError: They are none.
        """
        with self._lock:
            self._stage.obstruct(obstacles_of(obstacles, self.session.cfg))
        self._changed()

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
        self._job.cancel()
        if self._server:
            self._server.close()
            self._server = None

    # --- to keep ----------------------------------------------------------------------------

    def html(self) -> str:
        """Return one self-contained page with the scene as it is, or with the whole motion.

        A motion has at least 15 frames a second, but at most 9000 in all, evenly spread. Between
        them the page interpolates. The map of two joints is that of the posture; of a motion those
        of postures on the way, if other joints move.
        """
        return self._page(self._stage.maps())

    def _page(self, maps: Sequence[dict[str, Any]] = ()) -> str:
        with self._lock:
            self.draw()
            self._stage.animate()
            shown = {"about": self.about(), "readout": self.readout(), "maps": maps}
            return self.window.static_html(f"{self.session.arm.name} - spacearm", shown)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write `html` to a file, whole or not at all.

        Returns:
            The path.

        Raises:
            SpaceArmError: The file cannot be written.
        """
        return write_by(Path(path), lambda file: file.write(self.html().encode("utf-8")))

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
        return write_by(Path(path), lambda file: file.write(render(self._page(), size, scale)))

    def frames(
        self,
        path: str | os.PathLike[str],
        size: tuple[int, int] = (900, 600),
        per_second: float = 25.0,
        progress: Callable[[int, int], object] | None = None,
    ) -> Path:
        """Render the motion to PNG pictures in a ZIP archive, by a headless browser.

        The pictures are evenly spread from the start of the motion to its end, and numbered from 1.
        Edges are not smoothed. The archive is there once it is whole.

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
        times = self._times(positive(per_second, "per_second", "pictures for each second"))
        name = name_part(self.session.arm.name)

        def fill(file: BinaryIO) -> None:
            with (
                closing(self._pictures(size, times, progress)) as pictures,
                zipfile.ZipFile(file, "w") as archive,  # PNG is compressed already
            ):
                for i, picture in enumerate(pictures, 1):
                    archive.writestr(f"{name}_{i:04}.png", picture)

        return write_by(Path(path), fill)

    def video(
        self,
        path: str | os.PathLike[str],
        size: tuple[int, int] = (900, 600),
        per_second: float = 25.0,
        progress: Callable[[int, int], object] | None = None,
    ) -> Path:
        """Render the motion to a video that takes as long as the motion, by a headless browser.

        A legend in the corner names the layers that are shown, except grid and bodies, and the
        colours of workspaces, risk and attitudes.

        MP4 (H.264) and WebM (VP9) need imageio-ffmpeg (pip install 'spacearm[video]'); GIF does
        not, and its pictures stand for whole hundredths of a second.

        Args:
            path: The file to write: .mp4, .webm or .gif.
            size: Width and height of the video [px], even numbers.
            per_second: Pictures for each second of the motion.
            progress: Called with the number of pictures drawn and how many there will be.

        Returns:
            The path.

        Raises:
            ConfigurationError: There is no motion, the name ends otherwise, a size is odd,
                `per_second` is not positive, over 50 for a GIF, or there would be over 3000
                pictures.
            UnsupportedError: imageio-ffmpeg is not installed.
            SpaceArmError: No browser is found, it does not draw them all, or the file cannot be
                written.
        """
        kind = Path(path).suffix.lower()
        if kind not in VIDEOS:
            raise ConfigurationError(f"{path} is not a video; use {', '.join(VIDEOS)}")
        if any(edge < 2 or edge % 2 for edge in size):
            raise ConfigurationError(f"size is {size}; codecs need even numbers of pixels")
        rate = positive(per_second, "per_second", "pictures for each second")
        if kind == ".gif":
            if rate > MOST_OF_GIF:
                raise ConfigurationError(
                    f"per_second is {rate:g}; a GIF shows at most {MOST_OF_GIF:g} pictures a second"
                )
            rate = 100.0 / round(100.0 / rate)
        times = self._times(rate)

        def fill(file: BinaryIO) -> None:
            with closing(self._pictures(size, times, progress)) as pictures:
                write_video(file, kind, pictures, rate)

        return write_by(Path(path), fill)

    def _times(self, rate: float) -> list[float]:
        """Return when to take pictures of the motion, so many for each second.

        Raises:
            ConfigurationError: There is no motion, or there would be too many pictures.
        """
        if not self._stage.motion:
            raise ConfigurationError("there is no motion to take pictures of; view one")
        first, last = self._stage.span
        count = math.ceil((last - first) * rate) + 1
        if count > MOST_PICTURES:
            raise ConfigurationError(
                f"{last - first:.4g} s with per_second={rate:g} make {count:,} pictures; take at "
                f"most {MOST_PICTURES}"
            )
        times: list[float] = np.linspace(first, last, count).tolist()
        return times

    def _pictures(
        self,
        size: tuple[int, int],
        times: Sequence[float],
        progress: Callable[[int, int], object] | None,
    ) -> Generator[bytes]:
        """Render PNG pictures of the motion at some times [s]; report how many there are.

        Close the generator: it ends the browsers.
        """
        with closing(render_frames(self._page(), size, times)) as pictures:
            for i, picture in enumerate(pictures, 1):
                yield picture
                if progress:
                    progress(i, len(times))

    def _repr_html_(self) -> str:
        """Stand in a notebook: live while it is served, and a scene of its own once it is not."""
        with self._lock:
            scene, cfg, shapes = self._page(), self.configuration, self._stage.scene.bodies.shapes
            picture = still(cfg, shapes, self.about()["view"])
        invitation = self._server.invitation() if self._server else None
        return embedded(scene, picture, cfg.arm.name, invitation)

    def __repr__(self) -> str:
        return f"Viewer({self.session.arm.label}, {self.url or 'not served'})"

    # --- the panel (see server.Panel) -------------------------------------------------------

    def handle(self, message: object, client: object = None) -> dict[str, Any] | None:
        """Do what a message of the page asks; return the answer to the sender."""
        asked = message if isinstance(message, dict) else {}
        with self._lock:
            stage = self._stage
            match asked.get("do"):
                case "layer":
                    self.layer(str(asked.get("name")), bool(asked.get("visible")))
                case "time" if stage.motion:
                    stage.seek(number(asked.get("t"), "time"))
                case "compare":
                    other = asked.get("with")
                    given = self._given.motion if self._given and other == "given" else None
                    self.compare(given or str(other or "") or None)
                case "plan":
                    function, code = planning(stage)
                    self._job.start("plan", function, client)
                    self._asked = code
                case "compute":
                    self._job.start(*layer(stage, asked.get("what"), asked.get("path")), client)
                case "cancel":
                    self._job.cancel()
                case "poses":
                    return {"poses": stage.poses()}
                case "motion":
                    return {"motion": self._told_motion()}
                case "land":
                    if flown := stage.session.landed():
                        self._given = None
                        stage.play(flown)
                case "arm":
                    self._change_arm(asked)
                case "map":
                    session = stage.session
                    return {"map": joint_map(session.cfg, asked.get("joints"), session.spacecraft)}
                case _:
                    stage.session.handle(message)
        return None

    def _change_arm(self, message: dict[str, Any]) -> None:
        """Show the arm that the page asks for, in the present posture if it has the same joints."""
        before = self.session
        with temporary_folder() as folder:
            arm, origin, said = chosen(before.cfg, before.origin, message, folder)
            arm.require_one_tip()
            same = arm.joint_names == before.arm.joint_names
            q = before.cfg.q if same else opening_posture(arm)
            session = Session(arm, arm.at(q, base=before.cfg.base if same else None), origin)
            session.mode = before.mode
            session.handle({"do": "spacecraft", "mode": before.spacecraft})
            session.note = said
            with self.window.replaced():
                self._stage = Stage(self.window, session)
        self._job.cancel()
        self._given = None
        self._edition += 1

    def _changed(self) -> None:
        """Send the present state to the browsers, or draw it."""
        if self._server:
            self._server.refresh()
        else:
            self.draw()

    def _finished(self, name: str, result: Any) -> None:
        """Show what a worker process has computed."""
        if name == "plan":
            self._given = None
            plan = replace(result, arm=self.session.arm)
            self._plan = plan, self._asked
            self._stage.play(plan)
        elif name == "ranges":
            self.session.box = result if result.mode == self.session.spacecraft else None
        else:
            self._stage.show_computed(name, result)

    def left(self, client: object) -> None:
        """End what a client of the page has asked for, who is gone."""
        with self._lock:
            self._job.left(client)

    def readout(self) -> dict[str, Any]:
        """Return what the panel shows of the configuration."""
        with self._lock:
            stage = self._stage
            state = {"hidden": sorted(stage.hidden), "t": stage.time, "played": stage.played}
            state |= {"motion": stage.motion is not None, "edition": self._edition}
            state |= {"legend": [key._asdict() for key in stage.legend]}
            plan, code = self._plan
            if plan is not None and plan is stage.motion:
                at = plan.at(stage.time).q
                state |= {"python": code} if np.array_equal(at, self.session.cfg.q) else {}
            return {**self.session.readout(), **state, **self._job.readout()}

    def draw(self) -> None:
        """Draw the configuration."""
        with self._lock:
            self._stage.draw()

    def about(self) -> dict[str, Any]:
        """Return what the page needs once."""
        session = self.session
        return {
            **session.about(),
            "layers": LAYERS,
            "grid": self._stage.scene.grid._asdict(),
            "motion": self._told_motion(),
            "edition": self._edition,
            "choices": offered(session.arm, session.origin),
        }

    def _told_motion(self) -> dict[str, Any] | None:
        """Return what the page needs of the motion, and what it can be compared with."""
        if not (motion := self._stage.motion):
            return None
        flown = isinstance(motion, Flight)
        ways: dict[str, str] = {} if flown else {words: mode for mode, words in WORDS.items()}
        given = {} if self._given is None else {self._given.name: "given"}
        return {**account(motion, self._stage.other), "ways": {**ways, **given}}
