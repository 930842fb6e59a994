"""Pictures: saved pages, what stands in a notebook, and pictures with and without a browser."""

from __future__ import annotations

import base64
import html
import io
import json
import math
import re
import secrets
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import meshcat.geometry as g
import numpy as np

from spacearm.compiler.machine import processors
from spacearm.errors import SpaceArmError, imported
from spacearm.model.arm import Configuration
from spacearm.viewer.shapes import Y_TO_Z, DrawnShape, link_poses
from spacearm.viewer.window import PAGE

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
#: How names of videos end, and the codec of each.
VIDEOS = {".gif": "", ".mp4": "libx264", ".webm": "libvpx-vp9"}
#: Pictures of a motion that a browser makes, which are held in memory, and browsers at a time.
AT_ONCE, BROWSERS_AT_ONCE = 300, 2
FRAME = re.compile(rb"data:image/png;base64,([A-Za-z0-9+/=]+)")


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
    """Render the motion of a saved page to PNG pictures, `AT_ONCE` by each start of a browser.

    Up to `BROWSERS_AT_ONCE` draw side by side.

    Args:
        page: The page.
        size: Width and height [px].
        times: When [s].

    Raises:
        SpaceArmError: No browser is found, or it draws nothing in `RENDERING` and `EACH`.
    """
    side_by_side = min(processors(), BROWSERS_AT_ONCE)
    each = min(AT_ONCE, math.ceil(len(times) / side_by_side))
    parts = [times[first : first + each] for first in range(0, len(times), each)]
    with ThreadPoolExecutor(side_by_side) as pool:
        for first in range(0, len(parts), side_by_side):
            drawn = pool.map(partial(_frames, page, size), parts[first : first + side_by_side])
            yield from chain.from_iterable(drawn)


def _frames(page: str, size: tuple[int, int], times: Sequence[float]) -> list[bytes]:
    """Render the motion to PNG pictures by one start of the browser."""
    with tempfile.TemporaryDirectory() as folder:
        longest = RENDERING + EACH * len(times)
        wanted = f"frames={size[0]},{size[1]},{','.join(map(repr, times))}"
        run = _browse(page, wanted, size, ("--dump-dom",), Path(folder), longest)
    found = FRAME.findall(run.stdout)
    if len(found) != len(times):
        raise SpaceArmError(
            f"the browser drew {len(found)} of {len(times)} pictures: {run.stderr.decode()[-300:]}"
        )
    return [base64.b64decode(picture) for picture in found]


def write_video(
    file: BinaryIO, kind: str, pictures: Iterator[bytes], size: tuple[int, int], rate: float
) -> None:
    """Encode pictures as a video, one after the other.

    Args:
        file: Where it goes: an open file with a name.
        kind: One of `VIDEOS`.
        pictures: PNG pictures, all of one size.
        size: Their width and height [px].
        rate: Pictures a second.

    Raises:
        UnsupportedError: imageio-ffmpeg is not installed, and `kind` is not ".gif".
        SpaceArmError: The video cannot be encoded.
    """
    from PIL import Image  # slow to import

    drawn = (Image.open(io.BytesIO(picture)).convert("RGB") for picture in pictures)
    if kind == ".gif":
        first = next(drawn)
        each = 10 * round(100.0 / rate)  # a GIF counts hundredths of a second
        first.save(file, "GIF", save_all=True, append_images=drawn, duration=each, loop=0)
        return
    encoder = imported("imageio_ffmpeg", "imageio-ffmpeg", "video").write_frames(
        file.name, size, fps=rate, codec=VIDEOS[kind], macro_block_size=2,
        output_params=["-f", kind[1:]],
    )  # fmt: skip
    try:
        encoder.send(None)
        for picture in drawn:
            encoder.send(picture.tobytes())
    finally:
        encoder.close()


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
        "INVITATION": json.dumps(invitation),
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
