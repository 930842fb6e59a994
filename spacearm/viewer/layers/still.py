"""Still: a picture of the bodies made without a browser, for where no script may run."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import meshcat.geometry as g
import numpy as np
import pinocchio as pin

from spacearm.arrays import Array
from spacearm.model.arm import Configuration
from spacearm.viewer.layers.shapes import Y_TO_Z, DrawnShape

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
