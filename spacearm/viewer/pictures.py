"""Pictures: saved pages, what stands in a notebook, and pictures with and without a browser."""

from __future__ import annotations

import base64
import html
import io
import json
import re
import secrets
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.errors import SpaceArmError
from spacearm.model.arm import Configuration
from spacearm.viewer.shapes import Y_TO_Z, DrawnShape
from spacearm.viewer.window import PAGE

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


MARGIN = 0.06
"""Share of the picture that stays free at each side."""
FINER = 2
"""Points of the drawing for each pixel, in either direction."""
LIGHT = np.array([0.35, 0.55, 0.75])
"""Direction to the light: right, up, towards the viewer."""
DARKEST = 0.35
"""Brightness of what faces away from the light."""
LARGE = 6.0
"""Longest edge of a triangle that is painted by points, others one by one [px]."""


def still(
    cfg: Configuration,
    shapes: Sequence[DrawnShape],
    view: Sequence[float],
    size: tuple[int, int] = (640, 400),
) -> bytes:
    """Draw the bodies of a configuration as a PNG picture, seen from far away.

    Args:
        cfg: The configuration.
        shapes: What is drawn of each link.
        view: (3,) direction towards the viewer.
        size: Width and height [px].
    """
    from matplotlib.image import imsave  # slow to import

    corners, colors = _triangles(cfg, shapes)
    toward = np.asarray(view) / np.linalg.norm(view)
    across = np.cross((0.0, 0.0, 1.0) if abs(toward[2]) < 0.999 else (0.0, 1.0, 0.0), toward)
    across /= np.linalg.norm(across)
    corners = corners @ np.column_stack([across, np.cross(toward, across), toward])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    facing = np.abs(normals @ LIGHT) / np.maximum(lengths[:, 0] * np.linalg.norm(LIGHT), 1e-300)
    colors = colors * (DARKEST + (1.0 - DARKEST) * facing)[:, None]

    wide, high = FINER * np.array(size)
    flat = corners[..., :2].reshape(-1, 2)
    low, span = flat.min(axis=0), np.maximum(np.ptp(flat, axis=0), 1e-9)
    scale = (1.0 - 2.0 * MARGIN) * float(np.min([wide, high] / span))
    corners[..., :2] = (corners[..., :2] - low - span / 2.0) * scale + [wide / 2.0, high / 2.0]

    picture = np.zeros((high, wide, 4))
    depth = np.full((high, wide), -np.inf)
    edges = np.linalg.norm(corners[:, :, :2] - np.roll(corners[:, :, :2], 1, axis=1), axis=2)
    large = edges.max(axis=1) > LARGE
    _paint_small(picture, depth, corners[~large], colors[~large])
    for triangle, color in zip(corners[large], colors[large], strict=True):
        _paint_large(picture, depth, triangle, color)
    small = picture.reshape(size[1], FINER, size[0], FINER, 4).mean(axis=(1, 3))
    small[..., :3] /= np.maximum(small[..., 3:], 1e-9)
    file = io.BytesIO()
    imsave(file, np.clip(small[::-1], 0.0, 1.0), format="png")
    return file.getvalue()


def _paint_small(picture: Array, depth: Array, corners: Array, colors: Array) -> None:
    """Paint triangles by points a pixel apart, those in front over those behind.

    Args:
        picture: (height, width, 4) picture, from below.
        depth: (height, width) how near what is painted there is.
        corners: (m, 3, 3) corners [px]: right, up, towards the viewer.
        colors: (m, 3) colours.
    """
    count = int(LARGE) + 1
    i, j = np.triu_indices(count)
    shares = np.column_stack([i, j - i, count - 1 - j]) / (count - 1)
    for part in np.array_split(np.arange(len(corners)), len(corners) // 2000 + 1):
        points = np.einsum("ks,msd->mkd", shares, corners[part]).reshape(-1, 3)
        at = points[:, 1].astype(int), points[:, 0].astype(int)
        order = np.flatnonzero(points[:, 2] > depth[at])
        order = order[np.argsort(points[order, 2], kind="stable")]
        at = at[0][order], at[1][order]
        depth[at] = points[order, 2]  # of points of one pixel the last one stays
        picture[at] = np.append(colors[part], np.ones((len(part), 1)), axis=1)[order // len(shares)]


def _paint_large(picture: Array, depth: Array, corners: Array, color: Array) -> None:
    """Paint one triangle, pixel by pixel, where it is in front; arguments as above."""
    low = np.floor(corners[:, :2].min(axis=0)).astype(int)
    top = np.ceil(corners[:, :2].max(axis=0)).astype(int) + 1
    box = slice(low[1], top[1]), slice(low[0], top[0])
    edges = (corners[:2, :2] - corners[2, :2]).T
    if abs(np.linalg.det(edges)) < 1e-6:
        return  # seen from its edge
    y, x = np.mgrid[box]
    first, second = np.einsum(
        "ij,jrc->irc", np.linalg.inv(edges), np.stack([x, y]) - corners[2, :2, None, None]
    )
    third = 1.0 - first - second
    near = first * corners[0, 2] + second * corners[1, 2] + third * corners[2, 2]
    seen = (first >= 0) & (second >= 0) & (third >= 0) & (near > depth[box])
    depth[box][seen] = near[seen]
    picture[box][seen] = [*color, 1.0]


def _triangles(cfg: Configuration, shapes: Sequence[DrawnShape]) -> tuple[Array, Array]:
    """Return the triangles (m, 3, 3) of bodies in the inertial frame and their colours (m, 3)."""
    model = cfg.arm.model
    data = pin.Data(model)
    pin.framesForwardKinematics(model, data, cfg.full)
    corners, colors = [], []
    for link, pose, geometry, color in shapes:
        placed = data.oMf[model.getFrameId(link, pin.BODY)].homogeneous @ pose
        vertices, faces = _mesh(geometry)
        vertices = vertices @ placed[:3, :3].T + placed[:3, 3]
        corners.append(vertices[faces])
        colors.append(np.tile(color[:3], (len(faces), 1)))
    return np.concatenate(corners), np.concatenate(colors)


def _mesh(geometry: Any) -> tuple[Array, Array]:
    """Return the vertices and faces of a geometry of meshcat."""
    if isinstance(geometry, g.TriangularMeshGeometry):
        return np.asarray(geometry.vertices, dtype=np.float64), np.asarray(geometry.faces)
    import trimesh.creation  # slow to import

    if isinstance(geometry, g.Box):
        made = trimesh.creation.box(geometry.lengths)
    elif isinstance(geometry, g.Sphere):
        made = trimesh.creation.icosphere(2, geometry.radius)
    else:
        made = trimesh.creation.cylinder(geometry.radiusTop, geometry.height, sections=24)
        made.apply_transform(Y_TO_Z.T)
    return np.asarray(made.vertices), np.asarray(made.faces)
