"""Pictures: saved pages, what stands in a notebook, and pictures with and without a browser."""

from __future__ import annotations

import base64
import html
import io
import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, Any, BinaryIO

import meshcat.geometry as g
import numpy as np

from spacearm.compiler.machine import processors
from spacearm.errors import SpaceArmError, imported
from spacearm.files import temporary_folder
from spacearm.model.arm import Configuration
from spacearm.viewer.layers import LAYERS
from spacearm.viewer.shapes import Y_TO_Z, DrawnShape, link_poses
from spacearm.viewer.window import PAGE, json_in_html

if TYPE_CHECKING:
    import trimesh

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
HEADLESS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-background-networking", "--no-first-run",
    "--disable-sync", "--disable-component-update", "--hide-scrollbars",
    "--virtual-time-budget=4000",
)  # fmt: skip
#: Longest time that a picture may take, and each further one of a motion [s].
RENDERING, EACH = 120.0, 5.0
#: How names of videos end, and how each is encoded: soon, as a minute is to take half a minute.
VIDEOS = {
    ".gif": (),
    ".mp4": ("-c:v", "libx264", "-preset", "veryfast"),
    ".webm": ("-c:v", "libvpx-vp9", "-deadline", "realtime", "-cpu-used", "8", "-crf", "30"),
}
#: Starts a program that Linux kills when the process that started it ends, even by SIGKILL: prctl
#: with PR_SET_PDEATHSIG (1) and SIGKILL (9).
ENDS_WITH_THIS = (
    sys.executable,
    "-IS",
    "-c",
    "import ctypes, os, sys; ctypes.CDLL(None).prctl(1, 9); os.execv(sys.argv[1], sys.argv[1:])",
)
#: Browsers that draw the pictures of a motion side by side.
BROWSERS_AT_ONCE = 2
PIECE_OF_PICTURE = re.compile(rb'"picture ([A-Za-z0-9+/=]*)(!?)"')
#: Steps of red, green and blue in a GIF, besides the colours of layers and of its first picture.
STEPS = 5


def render(page: str, size: tuple[int, int], scale: int) -> bytes:
    """Render the drawing of a saved page to a PNG picture.

    Args:
        page: The page.
        size: Width and height [px].
        scale: Device pixels per page pixel.

    Raises:
        SpaceArmError: No browser is found, or it draws nothing in `RENDERING`.
    """
    with temporary_folder() as folder:
        picture = folder / "scene.png"
        options = (f"--screenshot={picture}", f"--force-device-scale-factor={scale}")
        command = _command(page, "picture", size, options, folder)
        with _running(command, folder) as browser:
            try:
                _, messages = browser.communicate(timeout=RENDERING)
            except subprocess.TimeoutExpired:
                raise SpaceArmError(
                    f"{command[0]} has not drawn the picture after {RENDERING:g} s; use "
                    ".save(path) and open the page"
                ) from None
        if not picture.is_file():
            raise SpaceArmError(f"the browser drew nothing: {messages.decode()[-300:]}")
        return picture.read_bytes()


def render_frames(page: str, size: tuple[int, int], times: Sequence[float]) -> Generator[bytes]:
    """Render the motion of a saved page to PNG pictures, by `BROWSERS_AT_ONCE` browsers in turn.

    Close the generator: it ends the browsers.

    Args:
        page: The page.
        size: Width and height [px].
        times: When [s].

    Raises:
        SpaceArmError: No browser is found, or it does not draw them all in `RENDERING` and `EACH`.
    """
    side_by_side = min(processors(), BROWSERS_AT_ONCE, len(times))
    with ExitStack() as stack:
        parts = (times[i::side_by_side] for i in range(side_by_side))
        drawn = [stack.enter_context(_drawing(page, size, part)) for part in parts]
        for i in range(len(times)):
            picture = next(drawn[i % side_by_side], None)
            if picture is None:
                raise SpaceArmError(f"the browser drew {i} of {len(times)} pictures")
            yield picture


@contextmanager
def _drawing(page: str, size: tuple[int, int], times: Sequence[float]) -> Iterator[Iterator[bytes]]:
    """Have one browser draw the motion at some times [s], as long as it is waited for."""
    wanted = f"frames={size[0]},{size[1]},{','.join(map(repr, times))}"
    options = ("--dump-dom", "--enable-logging=stderr")
    with temporary_folder() as folder:
        command = _command(page, wanted, size, options, folder)
        with _running(command, folder) as browser:
            assert browser.stderr is not None
            watch = Timer(RENDERING + EACH * len(times), _kill, (browser,))
            watch.start()
            try:
                yield _joined(browser.stderr)
            finally:
                watch.cancel()


@contextmanager
def _running(command: list[str], folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a browser; afterwards none of its processes is left, on Linux even if this one is killed.

    Its own temporary files lie in the folder: a browser that is killed does not remove them. The
    name of that folder is "." for it, since the path of a socket has at most some 100 characters.
    """
    can_end = sys.platform == "linux" and bool(sys.executable)  # an embedded Python has none
    before: tuple[str, ...] = ENDS_WITH_THIS if can_end else ()
    with subprocess.Popen(
        [*before, *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        cwd=folder,
        env={**os.environ, "TMPDIR": "."},
        start_new_session=True,  # its processes are one group
    ) as browser:
        try:
            yield browser
        finally:
            _kill(browser)


def _kill(browser: subprocess.Popen[bytes]) -> None:
    """Kill a browser with the processes that it has started."""
    with suppress(ProcessLookupError, PermissionError):  # all have ended
        os.killpg(browser.pid, signal.SIGKILL)


def _joined(lines: Iterable[bytes]) -> Iterator[bytes]:
    """Join the pieces of pictures in what a browser tells."""
    pieces: list[bytes] = []
    for line in lines:
        if piece := PIECE_OF_PICTURE.search(line):
            pieces.append(piece[1])
            if piece[2]:
                yield base64.b64decode(b"".join(pieces))
                pieces.clear()


def write_video(file: BinaryIO, kind: str, pictures: Iterator[bytes], rate: float) -> None:
    """Encode pictures as a video, one after the other.

    Args:
        file: Where it goes: an open file with a name.
        kind: One of `VIDEOS`.
        pictures: PNG pictures, all of one size.
        rate: Pictures a second.

    Raises:
        UnsupportedError: imageio-ffmpeg is not installed, and `kind` is not ".gif".
        SpaceArmError: The video cannot be encoded.
    """
    if kind == ".gif":
        _write_gif(file, pictures, rate)
        return
    encoder = imported("imageio_ffmpeg", "imageio-ffmpeg", "video").get_ffmpeg_exe()
    read = ("-y", "-loglevel", "error", "-f", "image2pipe", "-framerate", f"{rate}", "-i", "-")
    command = [encoder, *read, *VIDEOS[kind], "-pix_fmt", "yuv420p", "-f", kind[1:], file.name]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        assert run.stdin is not None
        try:
            for picture in pictures:
                run.stdin.write(picture)
        except BrokenPipeError:
            pass  # it says why
        except BaseException:
            run.kill()
            raise
        _, why = run.communicate()
    if run.returncode:
        raise SpaceArmError(f"the video cannot be encoded: {why.decode()[-300:]}")


def _write_gif(file: BinaryIO, pictures: Iterator[bytes], rate: float) -> None:
    """Write a GIF of one palette: of the layers, of its first picture, and some of each kind."""
    from PIL import Image  # slow to import

    drawn = (Image.open(io.BytesIO(picture)).convert("RGB") for picture in pictures)
    first = next(drawn)
    levels = np.linspace(0, 255, STEPS).astype(int)
    some = np.stack(np.meshgrid(levels, levels, levels), axis=-1).ravel().tolist()
    some += [int(color[i : i + 2], 16) for color in LAYERS.values() for i in (1, 3, 5)]
    own = first.quantize(256 - len(some) // 3).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette(own[: 768 - len(some)] + some)
    shown = (each.quantize(palette=palette, dither=Image.Dither.NONE) for each in drawn)
    each = 10 * round(100.0 / rate)  # a GIF counts hundredths of a second
    first = first.quantize(palette=palette, dither=Image.Dither.NONE)
    first.save(file, "GIF", save_all=True, append_images=shown, duration=each, loop=0)


def _command(
    page: str, fragment: str, size: tuple[int, int], options: tuple[str, ...], folder: Path
) -> list[str]:
    """Return the command by which a headless browser opens a page, and ends when it has drawn it.

    Raises:
        SpaceArmError: No browser is found.
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
    address = f"{file.as_uri()}#{fragment}"
    return [str(Path(browser).absolute()), *HEADLESS, *window, *options, address]


def embedded(scene: str, picture: bytes, name: str, invitation: str | None) -> str:
    """Return what stands in the output of a cell.

    The scene needs no server and stays in saved notebooks. The live page takes its place once it
    has told that it is drawn; where it is not reached, may not be framed or has ended, the scene
    stays. Where a notebook is not trusted and its frames are taken out, the picture stays.

    Args:
        scene: A self-contained page.
        picture: PNG picture of the scene.
        name: Name of the arm.
        invitation: Address that leads to the live page once; None if it is not served.
    """
    text = (PAGE / "notebook.html").read_text(encoding="utf-8")
    if invitation is None:
        text = text.partition("<script>")[0]
    parts = {
        "NAME": f"spacearm-{secrets.token_hex(8)}",
        "ARM": html.escape(name),
        "PICTURE": base64.b64encode(picture).decode(),
        "INVITATION": json_in_html(invitation),
        "SCENE": html.escape(scene),
    }
    return re.sub(rf"\$({'|'.join(parts)})", lambda mark: parts[mark[1]], text)


#: Direction to the light: right, up, towards the viewer.
LIGHT = np.array([0.35, 0.55, 0.75]) / np.linalg.norm([0.35, 0.55, 0.75])
#: Brightness of what faces away from the light.
DARKEST = 0.35
#: Longest edge of a triangle, as a share of the largest body: small ones hide each other well.
PIECE = 0.05


def still(cfg: Configuration, shapes: Sequence[DrawnShape], view: Sequence[float]) -> bytes:
    """Draw the bodies of a configuration as a PNG picture, seen from far away, without a browser.

    Args:
        cfg: The configuration.
        shapes: What is drawn of each link.
        view: (3,) direction towards the viewer.
    """
    from matplotlib.collections import PolyCollection  # slow to import
    from matplotlib.figure import Figure

    pose_of = link_poses(cfg.arm, cfg)
    parts: list[Any] = [
        _mesh(geometry).apply_transform(pose_of(link).homogeneous @ pose)
        for link, pose, geometry, _ in shapes
    ]
    longest = PIECE * max(part.scale for part in parts)
    parts = [part.subdivide_to_size(longest) for part in parts]
    colors = np.repeat([shape.color[:3] for shape in shapes], [len(p.faces) for p in parts], axis=0)
    toward = np.asarray(view) / np.linalg.norm(view)
    across = np.cross((0.0, 0.0, 1.0) if abs(toward[2]) < 0.999 else (0.0, 1.0, 0.0), toward)
    across /= np.linalg.norm(across)
    picture = np.column_stack([across, np.cross(toward, across), toward])
    corners = np.concatenate([part.triangles for part in parts]) @ picture
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    facing = np.abs(normals @ LIGHT) / lengths
    colors = colors * (DARKEST + (1.0 - DARKEST) * facing)[:, None]
    order = corners[..., 2].mean(axis=1).argsort()  # those in front over those behind
    figure = Figure(figsize=(6.4, 4.0))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), aspect="equal")
    axes.set_axis_off()
    painted = PolyCollection(
        corners[order, :, :2], facecolors=colors[order], edgecolors="face", linewidths=0.4
    )
    axes.add_collection(painted)
    axes.autoscale_view()
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=100, transparent=True)
    return file.getvalue()


def _mesh(geometry: Any) -> trimesh.Trimesh:
    """Return a geometry of meshcat as a mesh."""
    import trimesh.creation  # slow to import

    if isinstance(geometry, g.TriangularMeshGeometry):
        return trimesh.Trimesh(geometry.vertices, geometry.faces, process=False)
    if isinstance(geometry, g.Box):
        return trimesh.creation.box(geometry.lengths)
    if isinstance(geometry, g.Sphere):
        return trimesh.creation.icosphere(2, geometry.radius)
    made = trimesh.creation.cylinder(geometry.radiusTop, geometry.height, sections=24)
    return made.apply_transform(Y_TO_Z.T)
